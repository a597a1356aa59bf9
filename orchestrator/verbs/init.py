"""`toppling init`: a campaign file that suits a rock and its records."""

import json
import math
import os
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from toppling.models.errors import InputError, counted
from toppling.models.files.folder import refuse_existing, write_text
from toppling.orchestrator.terminal import bar, duration
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option

if TYPE_CHECKING:
    from toppling.orchestrator.advice import Pilot, Statics
    from toppling.orchestrator.campaign import Campaign
    from toppling.workers.job import Assets


@click.command()
@shared.scene_argument
@shared.ensemble_argument
@option("--out", type=shared.FILE, default=Path("campaign.toml"), help="File to write; must not exist.")
@option(
    "--friction", "frictions", type=click.FloatRange(0, 1.5, min_open=True), multiple=True,
    help="Repeatable. Default: the scene's own.",
)  # fmt: skip
@option("--levels", type=click.IntRange(2), default=12, help="Approximate number of PGA levels.")
@option("--azimuths", type=click.IntRange(1, 360), default=8, help="Number of evenly spaced azimuths.")
@shared.preset_option
def init(
    scene: Path,
    ensemble: Path,
    out: Path,
    frictions: tuple[float, ...],
    levels: int,
    azimuths: int,
    preset: str,
) -> None:
    """Write a campaign for SCENE and ENSEMBLE: levels, azimuths and frictions that suit the rock.

    Levels range from below the least constant acceleration that topples the rock to the level at which most records
    topple it. To find that level, and the time per job, the rock is shaken in trials with up to ten records at
    increasing levels, which takes seconds to a minute. The file explains every value.

    \b
    toppling init scenes/rock ensembles/quakes --out campaign.toml
    """
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.pedestal import ContactProperties
    from toppling.models.scene import Scene
    from toppling.orchestrator.advice import RECORDS, levels_to_try, statics_of, try_out
    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.rocks_of_run import Settlings
    from toppling.workers.job import Assets

    refuse_existing(out)
    rock, motions = Scene.load(scene), Ensemble.load(ensemble)
    frictions = frictions or (rock.contact.friction_static,)
    turned = [round(360.0 * number / azimuths, 6) for number in range(azimuths)]
    axes = {"pga_m_s2": [1.0], "azimuth_deg": turned, "friction": list(frictions), "preset": preset}
    chosen = Campaign.of({"scene": str(scene), "ensemble": str(ensemble), **axes}, Path())
    shared.compile_first()
    with bar("letting the rock stand"):
        Settlings.of(chosen, rock).checked()
        contact = ContactProperties.of(max(frictions))
        statics = statics_of(rock.with_contact(contact))
    _check_least(statics.least_m_s2, scene)
    most = min(RECORDS, len(motions.record_ids)) * len(levels_to_try(statics.least_m_s2))
    with bar("shaking on trial", most) as advance:
        friction = contact.friction_static, contact.friction_kinetic
        pilot = try_out(rock, motions, statics.least_m_s2, turned, friction, preset, advance)
    spaced = levels_between(statics.least_m_s2, pilot.most_at_m_s2, levels)
    jobs = len(motions.record_ids) * len(spaced) * len(turned) * len(frictions)
    workers = os.cpu_count() or 1
    time = f"about {duration(jobs * pilot.job_s / workers)} on {workers} workers"
    head = _HEAD.format(name=shlex.quote(str(out)), jobs=jobs, time=time)
    write_text(head + _keys(out, chosen, Assets(rock, motions), statics, pilot, spaced), out)
    levels_words = f"levels {spaced.start_m_s2:g} to {spaced.stop_m_s2:g} m/s2"
    click.echo(f"{out}: {jobs:,} jobs, {levels_words}, {time}")
    click.echo(f"next: toppling plan {shlex.quote(str(out))}")


def _check_least(least_m_s2: float, scene: Path) -> None:
    from toppling.orchestrator.campaign import LARGEST_PGA_M_S2

    if not 0.0 < least_m_s2 < LARGEST_PGA_M_S2:
        raise InputError(
            "scene.toppling_unusable",
            f"the least constant acceleration that topples the rock is {least_m_s2:.3g} m/s2",
            where=str(scene),
            expected=f"one above 0 and below {LARGEST_PGA_M_S2:g} m/s2",
            remedy="check in the scene's picture that rock and pedestal are separated correctly",
        )


_BELOW_LEAST = 0.9
"""Maximum of the lowest level, as a fraction of the least static toppling acceleration."""

_STEPS_M_S2 = (0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 2.5, 5.0, 10.0)
"""Round steps between levels, m/s²."""


@dataclass(frozen=True)
class _Levels:
    """Evenly spaced levels, including the stop."""

    start_m_s2: float
    stop_m_s2: float
    step_m_s2: float

    def __len__(self) -> int:
        return round((self.stop_m_s2 - self.start_m_s2) / self.step_m_s2) + 1


def levels_between(least_m_s2: float, most_m_s2: float, count: int) -> _Levels:
    """About `count` levels at round numbers, from below the least to the largest acceleration or above.

    Examples
    --------
    >>> levels_between(2.17, 18.3, 12)
    _Levels(start_m_s2=1.0, stop_m_s2=19.0, step_m_s2=2.0)
    """
    low = _BELOW_LEAST * least_m_s2
    step = min(_STEPS_M_S2, key=lambda size: abs(math.log((most_m_s2 - low) / (size * max(count - 1, 1)))))
    # On the grid of a finer round number if necessary, so that a coarse step still begins above zero.
    grid = step if low >= step else max((size for size in _STEPS_M_S2 if size <= low), default=low)
    start = math.floor(low / grid + 1e-9) * grid
    stop = start + math.ceil((most_m_s2 - start) / step - 1e-9) * step
    return _Levels(round(start, 6), round(stop, 6), step)


_HEAD = """\
# A campaign, written by 'toppling init'. Change what you like, then:
#   toppling plan {name}
#   toppling run {name} --out runs/first
# {jobs:,} jobs: {time} of this machine.
"""


def _keys(
    out: Path, chosen: "Campaign", assets: "Assets", statics: "Statics", pilot: "Pilot", levels: _Levels
) -> str:
    """TOML of values that suit a rock, with the reasons as comments."""
    from toppling.orchestrator.advice import least_static
    from toppling.orchestrator.campaign import KEYS

    scene, ensemble = (
        _quoted(os.path.relpath(folder.absolute(), out.absolute().parent))
        for folder in (chosen.scene, chosen.ensemble)
    )
    start, stop, step = (f"{number:g}" for number in (levels.start_m_s2, levels.stop_m_s2, levels.step_m_s2))
    azimuths = ", ".join(f"{azimuth:g}" for azimuth in chosen.azimuth_deg)
    friction = ", ".join(f"{static:g}" for static, _ in chosen.friction)
    keys = {key.name: key for key in KEYS}
    draws = "" if assets.scene.unseen is None else _realisations_line(len(levels) * len(chosen.azimuth_deg))
    written = {"preset", "realisations"} if draws else {"preset"}
    more = "\n".join(key.line for key in KEYS if key.example and key.name not in written)
    # JSON strings are valid TOML.
    return f"""
scene = {scene}  # folders are relative to this file
ensemble = {ensemble}  # {counted(len(assets.ensemble.record_ids), "record")}

# pga_m_s2: {keys["pga_m_s2"].help}.
# The least constant acceleration that topples the rock as it is in the scene is {least_static(statics)}.
# {_pilot_sentence(pilot)}
pga_m_s2 = {{ start = {start}, stop = {stop}, step = {step} }}  # {len(levels)} levels, the stop included; or a list

# azimuth_deg: {keys["azimuth_deg"].help}.
azimuth_deg = [{azimuths}]

# friction: {keys["friction"].help}. [0.6, 0.8] compares two and doubles the jobs;
# [[0.8, 0.6]] has 0.8 at rest and 0.6 in a slip.
friction = [{friction}]

preset = {_quoted(chosen.preset)}  # {keys["preset"].help}: {keys["preset"].values}
{draws}
# More keys:
{more}
"""


def _realisations_line(points: int) -> str:
    """Line for `realisations`: enough to represent the unknown base, but at most the number of jobs per record."""
    from toppling.orchestrator.advice import REALISATIONS

    return f"""
# realisations: how many the jobs of each record are spread over; their number stays. The rock's base is hidden: one is
# the scene as it is, each other has one of the bases that agree with the scan, and a friction about the one above.
realisations = {min(REALISATIONS, points)}
"""


def _pilot_sentence(pilot: "Pilot") -> str:
    shaken = len(pilot.topples_at_m_s2)
    first = min(pilot.topples_at_m_s2)
    if not pilot.toppled:
        return f"On trial none of {counted(shaken, 'record')} toppled it up to {pilot.highest_m_s2:.3g} m/s2."
    return (
        f"On trial the first of {counted(shaken, 'record')} toppled it at {first:.3g} m/s2, "
        f"and {pilot.toppled} of them up to {pilot.most_at_m_s2:.3g} m/s2."
    )


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
