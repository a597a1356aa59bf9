"""Conditioning of the hidden base on survived shaking: each drawn base is shaken with the recorded motion.

The shakes are ordinary campaigns of unscaled motions in their recorded orientation. Their realisations draw the bases,
and friction and other unmeasured parameters as in the run.

A base on which the rock stood in k of n shakes has the survival probability (k + 1/2) / (n + 1) (Jeffreys' prior), so
that no weight is 0. The probabilities of several motions are multiplied.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toppling.models.arrays import Array, jeffreys_mean
from toppling.models.errors import InputError
from toppling.models.scene import Scene
from toppling.orchestrator import recorded as stood
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import ProgressCallback, RunProgress, Work
from toppling.orchestrator.journal import log_event
from toppling.orchestrator.plan import Plan, plan_of
from toppling.results.reader import open_run
from toppling.results.weights import CONTACT, WEIGHTS_FILE, Contact, Weights

if TYPE_CHECKING:
    import pandas as pd

_Run = Callable[..., object]
"""Function that executes a plan in a folder (`orchestrator.run.run`)."""


def lacks_weights(planned: Plan, folder: Path) -> bool:
    """Whether there are survived motions and no weights yet; damaged weights are refused before any work."""
    if planned.recorded and (folder / WEIGHTS_FILE).exists():
        Weights.read(folder)
        return False
    return planned.recorded is not None


def weigh_bases(work: Work, run: _Run) -> None:
    """Compute and write the weights of a run's bases, by `orchestrator.run.run`."""
    planned = work.planned
    assert planned.recorded is not None
    shake = partial(run, cluster=nullcontext(work.client), watch=weighing(work.watch), limits=work.limits)
    weights = weigh(planned.campaign, planned.recorded, work.folder / stood.FOLDER, shake)
    weights.write(work.folder, planned.id)


def weighing(watch: ProgressCallback) -> ProgressCallback:
    """Label a session's progress as conditioning of the bases."""

    def watching(progress: RunProgress) -> None:
        progress.what = "shaking each base with what the rock stood"
        watch(progress)

    return watching


def weigh(campaign: Campaign, recorded: stood.Recorded, folder: Path, shake: _Run) -> Weights:
    """Shake every drawn base with the survived motions, and weight the draws by the results; resumable.

    campaign: source of contacts, engine, preset and unmeasured parameters.
    recorded: survived motions, already written to the folder by `Recorded.write`.
    folder: output folder of the shakes.
    shake: executes a plan in a folder.
    Raises InputError if a motion has no answer, such as where the engine refuses to shake this rock.
    """
    import pandas as pd  # what most runs begin without

    log_event("weighing the bases", records=[record.record_id for record in recorded.records])
    scene = Scene.load(campaign.scene)
    stood.check_weighable(scene, 1, str(campaign.scene))
    assert scene.unseen is not None
    rows = []
    for ensemble in stood.ensembles_in(folder):
        known = ensemble.parent.name == stood.ENSEMBLES[0]
        # Each side is a campaign of its own, in which every base is shaken; a single one would spread bases over sides.
        sides: list[tuple[float, ...]] = [()] if known else [(azimuth,) for azimuth in stood.AZIMUTHS_DEG]
        shakes = len(scene.unseen) * stood.SHAKES // len(sides)
        for number, azimuth in enumerate(sides):
            shaken = replace(
                campaign, ensemble=ensemble, pga_m_s2=(), azimuth_deg=azimuth, realisations=shakes,
                first_realisation=1 + number * shakes, records=None, peak_displacement_m=None, audit=0, stood=(),
                precision=None, target=None,
            )  # fmt: skip
            run = ensemble.parent / f"run{number}"
            shake(plan_of(shaken), run)
            rows.append(open_run(run).frame())
    return by_evidence(weights_by_contact(pd.concat(rows), len(scene.unseen)), _evidence(recorded))


def _evidence(recorded: stood.Recorded) -> dict[str, Any]:
    """Motions in machine-readable form, and the number of shakes per draw and motion."""
    given = zip(recorded.records, recorded.paths, strict=True)
    return {
        "files": sorted({file for record, path in given for file in record.files or (path,)}),
        "records": [record.record_id for record in recorded.records],
        "shas": [record.sha for record in recorded.records],
        "azimuths_unknown": [record.record_id for record in recorded.records if not record.north_known],
        "shakes": stood.SHAKES,
    }


def by_evidence(by_contact: Mapping[Contact, Array], evidence: Mapping[str, Any]) -> Weights:
    """Weights with a description of the motions that they are based on (`_evidence`)."""
    motions, unknown = _and(evidence["records"]), evidence["azimuths_unknown"]
    remarks = [f"Where the components of {_and(unknown)} pointed is not known: it shook from all sides"]
    return Weights(
        by_contact,
        f"the rock stood {motions}",
        f"the probability that the rock stands {motions}, which it is known to have survived, on each drawn base "
        f"({evidence['shakes']} shakings of each)",
        tuple(remarks if unknown else ()),
        evidence,
    )


def refuse_counted(weights: Weights, recorded: stood.Recorded) -> None:
    """Raise InputError for motions that are already part of the weights."""
    if twice := [record.record_id for record in recorded.records if record.sha in weights.evidence["shas"]]:
        raise InputError(
            "record.given_twice",
            f"the run counts {_and(twice)} already",
            where="--stood",
            expected="each motion once: a repeated one would count twice",
            remedy="leave it out: the run's own weights hold it",
        )


def joined(own: Weights, also: Weights) -> Weights:
    """Product of two sets of weights, for the contacts of the second."""
    both = {contact: own.of(contact) * weights for contact, weights in also.by_contact.items()}
    evidence = {
        name: own.evidence[name] + value if isinstance(value, list) else value
        for name, value in also.evidence.items()
    }
    return by_evidence({contact: product / product.mean() for contact, product in both.items()}, evidence)


def weights_by_contact(rows: "pd.DataFrame", draws: int) -> dict[Contact, Array]:
    """Weights of drawn bases from the results of their shakes.

    rows: rows of results; shakes without an answer are ignored.
    draws: number of draws of the base.
    Raises InputError if a motion has no answer at all.
    """
    found = {}
    for contact, jobs in rows.groupby(CONTACT):
        chances = [_chances(str(name), shakes, draws) for name, shakes in jobs.groupby("record_id")]
        log = np.log(chances).sum(axis=0)
        weights = np.exp(np.maximum(log - log.max(), -600.0))  # avoids underflow to 0
        found[tuple(map(float, contact))] = weights / weights.mean()
    return found  # type: ignore[return-value]  # of three columns


def _chances(name: str, shakes: "pd.DataFrame", draws: int) -> Array:
    """Probability that the rock survives a motion on each base; the mean of the others for a base without an answer."""
    known = shakes[shakes["toppled"].notna() & shakes["base"].notna()]
    if not len(known):
        messages = shakes["message"].dropna() if "message" in shakes else shakes["toppled"].dropna()
        reason = messages.mode()
        raise InputError(
            "stood.no_answer",
            f"none of {len(shakes)} shakes with {name} has an answer"
            + (f" ({reason.iloc[0]})" if len(reason) else ""),
            where="--stood",
            expected="a motion that the engine of the run shakes the rock with",
            remedy="see 'toppling records show' of the motion, or leave it out",
        )
    base = known["base"].to_numpy(int)
    answered = np.bincount(base, minlength=draws)
    standing = np.bincount(base[~known["toppled"].to_numpy(bool)], minlength=draws)
    chance = jeffreys_mean(standing, answered)
    return np.where(answered > 0, chance, chance[answered > 0].mean())


def _and(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
