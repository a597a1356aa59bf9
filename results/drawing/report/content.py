"""The data of a report, computed once: the run's jobs, fits of each contact, and the standing rock's constraint."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from toppling.models.arrays import Array
from toppling.models.motions.ensemble import CATALOG, Ensemble
from toppling.models.scene import Scene
from toppling.results.analysis import CONFIDENCE, HEADLINE_MEASURE, fits, resampling
from toppling.results.analysis.constraint import Constraint
from toppling.results.analysis.fragility import FRICTION, by_contact, contact_words
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.drawing.style import digits, printed_unit
from toppling.results.hazard.ages import Exposure, exposure, joint_ages
from toppling.results.hazard.events import Standing
from toppling.results.hazard.tree import HazardTree
from toppling.results.hazard.update import Update
from toppling.results.reader import Completeness, Run


class Contact(fits.ContactFits):
    """A contact as its report sees it."""

    @property
    def headline(self) -> Lognormal | None:
        """Curve that the report begins with; None where there is none."""
        return self.curves.get(HEADLINE_MEASURE) or self.best


@dataclass(frozen=True, eq=False)
class Content:
    """A run as its report sees it."""

    run: Run
    samples: int = resampling.SAMPLES  # bootstrap samples of the fits
    years: Array | None = None  # (n,): equally likely ages of the standing rock
    age: str = ""  # as it was stated
    tree: HazardTree | None = None  # asked about; it needs an age

    @cached_property
    def frame(self) -> pd.DataFrame:
        """All rows, weighted if the run's records or bases have unequal weights."""
        return self.run.jobs()

    @cached_property
    def completeness(self) -> Completeness:
        """Numbers of the run's jobs that are planned and done."""
        return self.run.completeness()

    @cached_property
    def contacts(self) -> list[Contact]:
        """Contacts of the run."""
        return [
            Contact(jobs, self.samples, self.completeness, contact_words(jobs, self.frame))
            for jobs in by_contact(self.frame).values()
        ]

    @property
    def chief(self) -> Contact:
        """The contact that the report begins with: that of the highest friction."""
        return max(self.contacts, key=lambda contact: tuple(contact.jobs[FRICTION].iloc[0]))

    @property
    def on_single_base(self) -> bool:
        """Whether the headline's jobs are on one of the bases that a scan allows."""
        return self.run.on_single_base(self.chief.jobs)

    @cached_property
    def scene(self) -> Scene | None:
        """The run's scene, where it holds one."""
        folder = self.run.scene_folder
        whole = all((folder / name).exists() for name in ("scene.json", "rock.ply"))
        return Scene.load(folder) if whole else None

    @cached_property
    def ensemble(self) -> Ensemble | None:
        """The run's records, where it holds them."""
        folder = self.run.ensemble_folder
        return Ensemble.load(folder) if (folder / CATALOG).exists() else None

    @cached_property
    def standing(self) -> Standing | None:
        """The chief contact's rock, over the hazard's measure or the headline's; None where that has no fit."""
        chief = self.chief
        curve = chief.curves.get(self.tree.measure) if self.tree else chief.headline
        if curve is None:
            return None
        return Standing(self.run.rock, curve, age=self.age)

    @property
    def exposure(self) -> Exposure | None:
        """Constraint on hazard by the standing rock; None where no age is given."""
        return None if self.years is None else exposure(joint_ages([self.years]))

    @cached_property
    def constraint(self) -> Constraint | None:
        """Constraint by the standing rock, with its age and under the hazard where these are known."""
        if self.standing is None:
            return None
        stood, update = self.exposure, None
        if self.tree and stood:
            update = Update.of_curves([self.standing], self.tree, stood, CONFIDENCE)
        return Constraint([self.standing], CONFIDENCE, update, stood)

    @cached_property
    def statement(self) -> dict[str, Any] | None:
        """The constraint as a statement, as `toppling constrain --json` prints it."""
        return None if self.constraint is None else self.constraint.summary()

    @property
    def extrapolated(self) -> str:
        """A remark if the statement about a single event is an extrapolation; empty otherwise."""
        if self.statement is None or self.standing is None or self.standing.fragility.basis is None:
            return ""
        strongest = self.standing.fragility.basis.strongest_shaken
        if self.statement["unexceeded"] <= strongest:
            return ""
        unit = printed_unit(self.statement["measure"])
        return f"an extrapolation beyond the strongest shaking, {digits(strongest)} {unit}"
