"""The data of a report, computed once: the run's jobs, fits of each contact, and the standing rock's constraint."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.motions.ensemble import CATALOG, Ensemble
from toppling.models.motions.measures import COMPARED
from toppling.models.scene import Scene
from toppling.results.analysis import fits, lognormal, ranking, regression, resampling
from toppling.results.analysis.constraint import Constraint
from toppling.results.analysis.fragility import FRICTION, by_contact, contact_words
from toppling.results.completeness import Completeness
from toppling.results.drawing.style import printed_unit
from toppling.results.hazard.survival import Standing
from toppling.results.hazard.tree import HazardTree
from toppling.results.hazard.update import Update
from toppling.results.reader import Run

CONFIDENCE = 0.95

HEADLINE_MEASURE = "pgv_m_s"
"""Measure of the report's first sentence if it has a fit, as in 'toppling constrain': hazard curves of it exist."""


@dataclass(frozen=True, eq=False)
class Contact:
    """Jobs of one scene, preset and contact, with their fits."""

    words: str  # what distinguishes it from others, such as "μ = 0.8"
    jobs: pd.DataFrame  # all of its jobs, with or without an answer
    samples: int  # bootstrap samples of the fits

    @cached_property
    def known(self) -> pd.DataFrame:
        """Jobs with an answer."""
        return fits.answered(self.jobs)

    @property
    def toppled(self) -> int:
        """Number of jobs that toppled the rock."""
        return int(self.known["toppled"].sum())

    @cached_property
    def ranking(self) -> pd.DataFrame:
        """Measures of intensity, best first."""
        return ranking.compare_measures(self.known)

    @cached_property
    def models(self) -> list[tuple[regression.Fit, lognormal.Resampled | None]]:
        """Fit of each single measure with its samples, in the ranking's order."""
        singles = [name for name in self.ranking["measures"] if name in COMPARED]
        models = [regression.fit(self.known, [name]) for name in singles]
        return [
            (one, None if one.problem else resampling.bootstrap(self.known, one, self.samples))
            for one in models
        ]

    @property
    def best(self) -> tuple[lognormal.Lognormal, lognormal.Resampled | None] | None:
        """Curve of the best predictor that may represent the run."""
        return (
            self.curve_of(chosen.measures[0])
            if (chosen := fits.headline([one for one, _ in self.models]))
            else None
        )

    @property
    def headline(self) -> tuple[lognormal.Lognormal, lognormal.Resampled | None] | None:
        """Curve that the report begins with; None where too few topple for one."""
        if self.toppled < fits.FEW_TOPPLED:
            return None
        return self.curve_of(HEADLINE_MEASURE) or self.best

    def curve_of(self, measure: str) -> tuple[lognormal.Lognormal, lognormal.Resampled | None] | None:
        """Curve over a measure with its samples; None where it has no fit."""
        return next(
            (
                (one.lognormal, drawn)
                for one, drawn in self.models
                if one.measures == (measure,) and one.lognormal
            ),
            None,
        )


@dataclass(frozen=True, eq=False)
class Content:
    """A run as its report sees it."""

    run: Run
    samples: int = resampling.SAMPLES  # bootstrap samples of the fits
    years: Array | None = None  # (n,): equally likely ages of the standing rock
    tree: HazardTree | None = None  # asked about; it needs an age

    @cached_property
    def frame(self) -> pd.DataFrame:
        """All rows, weighted if the run's records or bases have unequal weights."""
        frame = self.run.weighted(self.run.frame())
        if not frame["toppled"].notna().any():
            raise InputError(
                what=f"{len(frame)} jobs, none with an answer",
                where=str(self.run.path),
                expected="finished jobs",
                remedy="'toppling status RUN' shows how far the run is",
            )
        return frame

    @cached_property
    def completeness(self) -> Completeness:
        """How many of the run's jobs have run."""
        return self.run.completeness()

    @cached_property
    def contacts(self) -> list[Contact]:
        """Contacts of the run."""
        return [
            Contact(contact_words(jobs, self.frame), jobs, self.samples)
            for jobs in by_contact(self.frame).values()
        ]

    @property
    def chief(self) -> Contact:
        """The contact that the report begins with: that of the highest friction."""
        return max(self.contacts, key=lambda one: tuple(one.jobs[FRICTION].iloc[0]))

    @cached_property
    def scene(self) -> Scene | None:
        """The run's scene, where it holds one."""
        folder = self.run.scene_folder
        return (
            Scene.load(folder)
            if (folder / "scene.json").exists() and (folder / "rock.ply").exists()
            else None
        )

    @cached_property
    def ensemble(self) -> Ensemble | None:
        """The run's records, where it holds them."""
        folder = self.run.ensemble_folder
        return Ensemble.load(folder) if (folder / CATALOG).exists() else None

    @cached_property
    def standing(self) -> Standing | None:
        """The chief contact's rock, over the hazard's measure or the headline's; None where that has no fit."""
        measure = self.tree.measure if self.tree else None
        found = self.chief.curve_of(measure) if measure else self.chief.headline
        if found is None or self.chief.toppled < fits.FEW_TOPPLED:
            return None
        curve, resampled = found
        basis = fits.basis_of(self.chief.jobs, curve.measure, self.completeness)
        curve = replace(resampling.with_interval(curve, resampled), basis=basis)
        return Standing(
            self.run.rock, curve, np.array([np.nan]) if self.years is None else self.years, resampled
        )

    @cached_property
    def constraint(self) -> Constraint | None:
        """What the standing rock says, with its age and under the hazard where these are known."""
        if self.standing is None:
            return None
        update = Update([self.standing], self.tree, CONFIDENCE) if self.tree else None
        return Constraint([self.standing], CONFIDENCE, update, dated=self.years is not None)

    @cached_property
    def statement(self) -> dict[str, Any] | None:
        """The same as a statement."""
        return None if self.constraint is None else self.constraint.summary()

    @property
    def extrapolated(self) -> str:
        """A remark if the statement about a single event is an extrapolation; empty otherwise."""
        if self.statement is None or self.standing is None or self.standing.curve.basis is None:
            return ""
        strongest = self.standing.curve.basis.strongest_shaken
        if self.statement["unexceeded"] <= strongest:
            return ""
        unit = printed_unit(self.statement["measure"])
        return f"an extrapolation beyond the strongest shaking, {strongest:.2g} {unit}"
