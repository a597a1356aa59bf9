"""Shake an experiment's tests as campaigns whose realisations draw what nobody measured, until the shares are known.

Everything here is fixed before any outcome is looked at, and the same for every specimen.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client
from numpy.typing import ArrayLike, NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.files import digest
from toppling.models.files.folder import new_folder
from toppling.models.hidden_base.rough_base import TOLERANCE_SHARE, Standing, with_rough_base
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import motion_sha
from toppling.models.motions.shaketable import BAND_HZ, Experiment
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import ProgressCallback
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.run import run
from toppling.results.analysis.prediction_scores import share
from toppling.results.reader import open_run
from toppling.workers.engines import ENGINES
from toppling.workers.unmeasured import Unmeasured

_FRICTION = (0.5, 1.0)
"""Granite on steel or concrete."""
_RESTITUTION = (0.0, 0.3)
_ABOVE_BAND = (0.0, 0.6)
"""Share of the motion in the octave below the band's end: accelerometers that were looked at show .55, of which part
is noise of the table's bearings."""
_YAW_DEG = 5.0
"""How well a heavy rock is set down along the table's axis."""
_BASE_STD_PER_HEIGHT, _BASE_WAVELENGTH_PER_HEIGHT = (1 / 2000, 1 / 500), 0.2
"""Error of a mesh from photographs where it meets the table, about a thousandth of its size, and how far it reaches."""
_BASE_BAND_PER_HEIGHT = 0.1
"""What stands so close to the table is seen worst."""
_STANDING = Standing(attitude_std_deg=3.0, least_toppling_m_s2=0.25)
"""The mesh is upright as the rock stood, by eye; it stood by itself and through the weakest motions: half of .05 g."""
_FIRST_DRAWS = 12
"""Of every test; then as many again, and so on, of those whose share is not known well enough."""


@dataclass(frozen=True)
class Sampling:
    """How the tests are shaken."""

    engine: str
    preset: str
    most_draws: int  # realisations of a test at most
    error: float  # standard error of a test's share below which it is not shaken again
    seed: int = 0  # of the bases


@dataclass(frozen=True, eq=False)
class Shaken:
    """What the draws say."""

    nominal: Array  # (tests,): the mesh as it is: 1 toppled, 0 stands, NaN without an answer
    # (draws, tests): the same of the draws. A test on which the first ones agreed is not shaken again: the
    # others are taken to say the same.
    toppled: Array
    shaken: NDArray[np.int64]  # (tests,): draws that were shaken, of each test


def specimen(
    mesh: Path | tuple[ArrayLike, ArrayLike],
    sampling: Sampling,
    progress: Callable[[int], None] = lambda _: None,
    tolerance_share: float = TOLERANCE_SHARE,
) -> Scene:
    """The specimen on a level table, with draws of its base.

    progress: told of each draw.
    tolerance_share: what contact points may leave out of a draw, of its standard deviation.
    Raises InputError if the mesh is none, or the rock hardly ever stands on such bases.
    """
    scene = Scene.from_mesh(mesh, 0.5 * sum(_FRICTION))
    height_m = scene.rock.height_m
    return with_rough_base(
        scene,
        std_m=(_BASE_STD_PER_HEIGHT[0] * height_m, _BASE_STD_PER_HEIGHT[1] * height_m),
        wavelength_m=_BASE_WAVELENGTH_PER_HEIGHT * height_m,
        band_m=_BASE_BAND_PER_HEIGHT * height_m,
        draws=sampling.most_draws,
        standing=_STANDING,
        seed=sampling.seed,
        progress=progress,
        tolerance_share=tolerance_share,
    )


def drawn_bases(sampling: Sampling) -> dict[str, Any]:
    """How the bases are drawn, for who reads the scores."""
    return {
        "seed": sampling.seed,
        "base_std_per_height": list(_BASE_STD_PER_HEIGHT),
        "base_wavelength_per_height": _BASE_WAVELENGTH_PER_HEIGHT,
        "base_band_per_height": _BASE_BAND_PER_HEIGHT,
        "standing": asdict(_STANDING),
    }


def unmeasured(engine: str) -> Unmeasured:
    """Distributions of what nobody measured; some engines know no restitution."""
    restitution = _RESTITUTION if ENGINES[engine].restitution else None
    return Unmeasured(_FRICTION, restitution, _YAW_DEG, True, BAND_HZ, _ABOVE_BAND)


def ensemble_of(
    folder: Path, experiment: Experiment, progress: Callable[[], None] = lambda: None
) -> Ensemble:
    """The tests' motions as an ensemble in the folder, written unless an earlier call did."""
    target = folder / "ensemble"
    if not target.exists():
        measured = []
        for record in experiment.records():
            measured.append(record)
            progress()
        with new_folder(target) as staging:
            Ensemble.write(staging, measured)
    found = Ensemble.load(target)
    asked = [test.record_id for test in experiment.tests]
    shas = [motion_sha(motion, 0.0) for motion in experiment.motions]
    if dict(zip(asked, shas, strict=True)) != {name: found.sha(name) for name in found.record_ids}:
        raise _foreign("holds the motions of other tests", target, f"the motions of {len(asked)} tests")
    return found


def scene_of(
    folder: Path, mesh: Path, sampling: Sampling, progress: Callable[[int], None] = lambda _: None
) -> Scene:
    """The specimen with its bases in the folder, drawn unless an earlier call did."""
    target, settings = folder / "scene", folder / "bases_drawn.json"
    if not target.exists():
        digest.write_json(settings, drawn_bases(sampling))
        specimen(mesh, sampling, progress).save(target)
    if not settings.exists() or digest.read_json(settings) != drawn_bases(sampling):
        expected = (
            f"seed {sampling.seed} and the distribution of this version, as {settings.name} states them"
        )
        raise _foreign("holds bases that were drawn otherwise", target, expected)
    found = Scene.load(target)
    bare = Scene.from_mesh(mesh, 0.5 * sum(_FRICTION))
    few = found.unseen is None or len(found.unseen) < sampling.most_draws
    if few or replace(found, unseen=None).id != bare.id:
        expected = f"the rock of {mesh} with {sampling.most_draws} bases"
        raise _foreign("holds another specimen, or too few bases", target, expected)
    return found


def _foreign(what: str, target: Path, expected: str) -> InputError:
    remedy = "give another --out, or remove the folder"
    return InputError(what, where=str(target), expected=expected, remedy=remedy)


def shake_tests(
    folder: Path,
    experiment: Experiment,
    sampling: Sampling,
    cluster: Callable[[], AbstractContextManager[Client]],
    watcher: Callable[[], AbstractContextManager[ProgressCallback]],
) -> Shaken:
    """Shake all tests, then those whose share is uncertain with more draws; what was done before is not done again.

    Raises InputError, RunError as :func:`orchestrator.run.run`.
    """
    ids = [test.record_id for test in experiment.tests]
    answers = np.full((sampling.most_draws + 1, len(ids)), np.nan)
    shaken = np.zeros(len(ids), np.int64)
    uncertain = np.ones(len(ids), bool)
    first, last = 0, min(_FIRST_DRAWS, sampling.most_draws)
    while uncertain.any():
        campaign = Campaign(
            scene=folder / "scene",
            ensemble=folder / "ensemble",
            pga_m_s2=(),
            azimuth_deg=(0.0,),
            friction=((0.5 * sum(_FRICTION),) * 2,),
            realisations=last + 1 - first,
            first_realisation=first,
            preset=sampling.preset,
            engine=sampling.engine,
            records=tuple(np.array(ids)[uncertain].tolist()),
            unmeasured=unmeasured(sampling.engine),
            audit=0,
        )
        target = folder / f"realisations_{first}_{last}"
        with watcher() as watch:
            run(plan_of(campaign), target, cluster(), watch)
        _collect(target, ids, answers)
        shaken[uncertain] = last
        _, error = share(answers[1 : last + 1])
        uncertain &= error > sampling.error
        if last == sampling.most_draws:
            break
        first, last = last + 1, min(2 * last, sampling.most_draws)
    toppled = answers[1 : int(shaken.max()) + 1]
    return Shaken(answers[0], _agreed(toppled, shaken), shaken)


def _collect(target: Path, ids: list[str], answers: Array) -> None:
    """Enter a run's answers, (realisations, tests)."""
    frame = open_run(target).frame()
    column = frame["record_id"].map({name: number for number, name in enumerate(ids)})
    toppled = frame["toppled"].astype("Float64").to_numpy(float, na_value=np.nan)
    answers[frame["realisation"], column] = toppled


def _agreed(toppled: Array, shaken: NDArray[np.int64]) -> Array:
    """Fill in what was not shaken because the draws before agreed."""
    filled = toppled.copy()
    for test, draws in enumerate(shaken):
        filled[draws:, test] = np.round(np.nanmean(toppled[:draws, test])) if draws else np.nan
    return filled
