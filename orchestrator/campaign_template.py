"""The campaign file that `toppling init` writes: values that suit a rock, each with its reason beside it."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass

from toppling.orchestrator.advice import REALISATIONS, least_static
from toppling.orchestrator.campaign import KEYS
from toppling.orchestrator.pilot import Pilot, Statics
from toppling.orchestrator.progress import duration

_BELOW_LEAST = 0.9
"""The lowest level is at most this share of the least static toppling acceleration."""

_STEPS_M_S2 = (0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True)
class Levels:
    """Evenly spaced levels, the stop included."""

    start_m_s2: float
    stop_m_s2: float
    step_m_s2: float

    def __len__(self) -> int:
        return round((self.stop_m_s2 - self.start_m_s2) / self.step_m_s2) + 1


def levels_between(least_m_s2: float, most_m_s2: float, count: int) -> Levels:
    """About so many levels at round numbers, from below the first acceleration to the second one or above.

    Examples
    --------
    >>> levels_between(2.17, 18.3, 12)
    Levels(start_m_s2=1.0, stop_m_s2=19.0, step_m_s2=2.0)
    """
    low = _BELOW_LEAST * least_m_s2
    step = min(_STEPS_M_S2, key=lambda one: abs(math.log((most_m_s2 - low) / (one * max(count - 1, 1)))))
    # On the grid of the next finer round number, so that a coarse step still begins above zero.
    grid = step if low >= step else max((one for one in _STEPS_M_S2 if one <= low), default=low)
    start = math.floor(low / grid + 1e-9) * grid
    stop = start + math.ceil((most_m_s2 - start) / step - 1e-9) * step
    return Levels(round(start, 6), round(stop, 6), step)


def even_azimuths_deg(count: int) -> list[float]:
    """So many azimuths, evenly around, from east on."""
    return [round(360.0 * number / count, 6) for number in range(count)]


@dataclass(frozen=True, kw_only=True)
class CampaignTemplate:
    """What the file says, and how it was found."""

    name: str
    scene: str
    ensemble: str
    records: int
    statics: Statics
    pilot: Pilot
    levels: Levels
    azimuths_deg: Sequence[float]
    frictions: Sequence[float]
    preset: str
    workers: int
    bases: int

    def text(self) -> str:
        """The file: TOML with comments."""
        levels = len(self.levels)
        jobs = self.records * levels * len(self.azimuths_deg) * len(self.frictions)
        start, stop, step = (
            f"{one:g}" for one in (self.levels.start_m_s2, self.levels.stop_m_s2, self.levels.step_m_s2)
        )
        azimuths, friction = (
            ", ".join(f"{one:g}" for one in values) for values in (self.azimuths_deg, self.frictions)
        )
        keys = {key.name: key for key in KEYS}
        more = "\n".join(
            _realisations_line(self.bases) if key.name == "realisations" and self.bases else key.line
            for key in KEYS
            if key.example and key.name != "preset"
        )
        # Strings of JSON are TOML's too.
        return f"""\
# A campaign, written by 'toppling init'. Change what you like, then:
#   toppling plan {self.name}
#   toppling run {self.name} --out runs/first
# {jobs} jobs: about {duration(jobs * self.pilot.job_s / self.workers)} on {self.workers} workers of this machine.

scene = {_quoted(self.scene)}  # folders are relative to this file
ensemble = {_quoted(self.ensemble)}  # {self.records} records

# pga_m_s2: {keys["pga_m_s2"].help}.
# The least constant acceleration that topples the rock is {least_static(self.statics)}.
# {_pilot_sentence(self.pilot)}
pga_m_s2 = {{ start = {start}, stop = {stop}, step = {step} }}  # {levels} levels, the stop included; or a list

# azimuth_deg: {keys["azimuth_deg"].help}.
azimuth_deg = [{azimuths}]

# friction: {keys["friction"].help}. [0.6, 0.8] compares two and doubles the jobs;
# [[0.8, 0.6]] has 0.8 at rest and 0.6 in a slip.
friction = [{friction}]

preset = {_quoted(self.preset)}  # {keys["preset"].help}: {keys["preset"].values}

# More keys:
{more}
"""


def _realisations_line(bases: int) -> str:
    one_each = f"each other takes one of the {bases} drawn bases and a friction of its own"
    return f"# realisations = {REALISATIONS}  # 1 (left out) shakes the nominal base alone; {one_each}"


def _pilot_sentence(pilot: Pilot) -> str:
    shaken = len(pilot.topples_at_m_s2)
    first = min(pilot.topples_at_m_s2)
    if not pilot.toppled:
        return f"On trial none of {shaken} records toppled it up to {pilot.highest_m_s2:.3g} m/s2."
    return (
        f"On trial the first of {shaken} records toppled it at {first:.3g} m/s2, and {pilot.toppled} of them up to "
        f"{pilot.most_at_m_s2:.3g} m/s2."
    )


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
