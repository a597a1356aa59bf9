"""Warnings of records, as limits of their measures, and refusals of samples that cannot be the ground's."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.models.motions.formats.component import Component
from toppling.models.motions.formats.record_text import PEAK_OFF
from toppling.models.motions.formats.units import UNITS_M_S2
from toppling.models.motions.measures import STANDARD_G_M_S2


@dataclass(frozen=True)
class Warned:
    """A warning: the measure, its limits, and the sentence where the measure is outside them or unknown."""

    measure: str
    least: float
    most: float
    sentence: str = ""

    def applies(self, value: float) -> bool:
        """Whether a value of the measure is outside the limits."""
        return not self.least <= value <= self.most

    def text(self, value: float) -> str:
        """The sentence on a value."""
        return self.sentence.format(value=value, least=self.least, most=self.most)


WARNINGS = {
    "angle": Warned(
        "between_horizontals_deg", 80.0, 100.0,
        "the horizontals are {value:g} degrees apart, not 90: see that their azimuths are right",
    ),
    "pga": Warned("pga_m_s2", 0.0, 3.0 * STANDARD_G_M_S2, "PGA is {value:.3g} m/s2, more than 3 g"),
    "weak": Warned(
        "pga_m_s2", 1e-3, math.inf, "PGA is {value:.2g} m/s2, less than people feel: see that its unit is right",
    ),
    "pgv": Warned("pgv_m_s", 0.0, 3.0, "PGV is {value:.3g} m/s, more than {most:g} m/s"),
    "pulse": Warned(
        "pgv_pga_s", 0.01, 0.4, "PGV/PGA is {value:.2g} s, outside the {least:g} to {most:g} s of nearly all records:"
        " see that its samples are acceleration, and that its time step is right",
    ),
    "pgd": Warned("pgd_m", 0.0, 4.0),
    "factor": Warned("factor", 0.0, 100.0),
}  # fmt: skip
"""By code. Few records exceed 3 g or 3 m/s: a mistaken unit is likelier. PGV/PGA is outside its limits for velocity,
displacement, or a time step in error by ten. The last two are of scaled motions: the largest displacements without the
fling of a fault are some metres (Chi-Chi 1999, TCU068 and TCU052), and a larger factor scales noise, and the spectrum
of a weak earthquake."""
LARGEST_PGV_M_S, LARGEST_PGD_M, LARGEST_FACTOR = (WARNINGS[name].most for name in ("pgv", "pgd", "factor"))
_PEAKS_WORDS = f"PGV above {LARGEST_PGV_M_S:g} m/s, PGD above {LARGEST_PGD_M:g} m"
LIMITS_WORDS = f"{_PEAKS_WORDS}, or scaled above {LARGEST_FACTOR:g}-fold"
_QUESTIONABLE_M_S2 = 5 * STANDARD_G_M_S2
_USUAL_PGA_M_S2, _USUAL_PGV_M_S = 1.5 * STANDARD_G_M_S2, 1.5
_COMMON_UNITS_M_S2 = {name: UNITS_M_S2[name] for name in ("g", "m/s2", "cm/s2", "mm/s2")}
"""Units that are mistaken for each other."""
_CLIPPED_SAMPLES = 10
"""Number of samples at the extreme from which an instrument was clipped."""
_CLIPPED_RUN = 4
"""Number of them in a row."""
_RAIL_FRACTION = 0.95
"""Least distance of a rail as a fraction of the record's farthest sample."""
_RAIL_RUNS = 3
"""Number of runs at a rail that is nearer to the middle, where an offset was removed."""
_SPIKE_RATIO = 8.0
"""Ratio of a sample's distance from its neighbours to the next largest one from which it is a spike."""
_FILLED_GAP_S = 0.5
"""Length of a constant stretch that is a filled gap, s."""
_FILLED_GAP_FRACTION = 0.1
"""Fraction of the peak that the shaking reaches shortly before and after it."""


def check_samples(component: Component) -> None:
    """Refuse a channel whose samples cannot be the ground's.

    Raises InputError: with file and sample.
    """
    a = component.acceleration_m_s2
    peak = float(np.abs(a).max())
    _other_peak(component, a, peak)
    if peak > _QUESTIONABLE_M_S2:
        _refuse_sample("record.too_strong", component, int(np.abs(a).argmax()),
            f"the peak is {peak:.4g} m/s2, beyond 5 g" + _explained(peak, 0.0, component.stated_unit_m_s2),
            "a peak below 5 g",
            "name the right unit in the metadata table, or accept it with --doubtful")  # fmt: skip
    if peak == 0:
        _refuse_sample("record.all_zero", component, 0, "all samples are zero", "a motion",
            "leave the record out")  # fmt: skip
    _clipped(component, a)
    _spike(component, a)
    _filled_gap(component, a, peak)


def check_apart(channels: Sequence[Component]) -> None:
    """Refuse two channels of one record with the same samples: one file that was given twice.

    Raises InputError: with both files.
    """
    for first, other in combinations(channels, 2):
        a, b = (c.acceleration_m_s2 for c in (first, other))
        count = min(len(a), len(b))
        if np.array_equal(a[:count], b[:count]) or np.array_equal(a[:count], -b[:count]):
            other.refuse("record.same_samples", f"the samples are those of {first.where}, another component",
                "components of one shaking, each with its own samples",
                "give each component's own file, or accept it with --doubtful")  # fmt: skip


def warnings_of(
    measures: Mapping[str, float], unit_m_s2: float | None = None, baseline: bool = True
) -> tuple[str, ...]:
    """Warnings of a record by its measures, with the unit that would explain an extreme peak.

    unit_m_s2: unit that the samples were read in, where a person or a header named it.
    baseline: whether the agency or the program has corrected the baseline.
    """
    found = {
        code: warning.text(measures[warning.measure])
        for code, warning in WARNINGS.items()
        if warning.sentence and warning.applies(measures.get(warning.measure, warning.least))
    }
    strong = [found.pop(code) for code in ("pga", "pgv") if code in found]
    if strong:
        found.pop("pulse", None)
        pga_m_s2, pgv_m_s = measures["pga_m_s2"], measures["pgv_m_s"]
        if not baseline and not WARNINGS["pga"].applies(pga_m_s2):
            explained = ": its baseline is not corrected"
        else:
            explained = _explained(pga_m_s2, pgv_m_s, unit_m_s2)
        return (*found.values(), ", ".join(strong) + explained)
    return tuple(found.values())


def _explained(pga_m_s2: float, pgv_m_s: float, unit_m_s2: float | None) -> str:
    """Confusion of units that would explain unusual peaks, by the least factor; empty if none does."""
    mistaken = sorted(
        (taken / meant, taken_name, meant_name)
        for taken_name, taken in _COMMON_UNITS_M_S2.items()
        for meant_name, meant in _COMMON_UNITS_M_S2.items()
        if meant < taken and (unit_m_s2 is None or math.isclose(taken, unit_m_s2, rel_tol=0.01))
    )
    for factor, taken_name, meant_name in mistaken:
        if pga_m_s2 <= factor * _USUAL_PGA_M_S2 and pgv_m_s <= factor * _USUAL_PGV_M_S:
            return (
                f": if its samples are in {meant_name} and not in {taken_name},"
                f" the peak is {pga_m_s2 / factor:.3g} m/s2"
            )
    return ""


def _other_peak(component: Component, a: np.ndarray, peak: float) -> None:
    """Refuse samples whose peak, about zero or their mean, is far from that in the file's own header."""
    stated = component.stated_peak_m_s2
    peaks = (peak, float(np.abs(a - a.mean()).max()))
    if not stated or not component.unit_known or any(1 / PEAK_OFF < p / stated < PEAK_OFF for p in peaks):
        return
    _refuse_sample(
        "record.peak_contradicted",
        component,
        int(np.abs(a).argmax()),
        f"the peak is {peak:.4g} m/s2, and {stated:.4g} m/s2 by the file's header",
        "samples whose peak is that of the header",
        "correct the unit or scale in the header, or fetch the file again, or accept it with --doubtful",
    )


def _clipped(component: Component, a: np.ndarray) -> None:
    """Refuse flat tops at a rail: reached in mid-course, and as far out as the record goes, or reached again and again.

    A flat top below the peak of the other sign, or one whose neighbours are the next value that the file can write, is
    how an analogue trace was digitised.
    """
    middle = np.median(a)
    farthest, peak = np.abs(a - middle).max(), np.abs(a).max()
    values = np.unique(a)
    quantum = np.diff(values).min() if len(values) > 1 else 0.0
    for extreme in (a.max(), a.min()):
        count = int((a == extreme).sum())
        flat = [run for run in _runs(a == extreme) if _ends_in_mid_course(a, run, quantum)]
        if count < _CLIPPED_SAMPLES or not flat:
            continue
        share = max(abs(extreme) / peak, abs(extreme - middle) / farthest)
        if share >= _RAIL_FRACTION or (len(flat) >= _RAIL_RUNS and abs(extreme - middle) > 0.5 * farthest):
            start, end = max(flat, key=lambda run: run[1] - run[0])
            _refuse_sample("record.clipped", component, start,
                f"{count} samples, {end - start} in a row, are at the extreme {extreme:.4g} m/s2: clipped",
                "a record within the instrument's range",
                "leave the record out, or accept it with --doubtful")  # fmt: skip


def _ends_in_mid_course(a: np.ndarray, run: tuple[int, int], quantum: float) -> bool:
    """Whether a flat run is long, and both samples beside it are more than one step of the values away."""
    start, end = run
    if end - start < _CLIPPED_RUN:
        return False
    differences = [abs(a[at] - a[start]) for at in (start - 1, end) if 0 <= at < len(a)]
    return not differences or min(differences) > 1.5 * quantum


def _spike(component: Component, a: np.ndarray) -> None:
    if len(a) < 20:
        return
    bend = np.abs(a[1:-1] - 0.5 * (a[:-2] + a[2:]))
    worst = int(bend.argmax())
    others = np.delete(bend, slice(max(worst - 2, 0), worst + 3))
    if bend[worst] > _SPIKE_RATIO * others.max():
        _refuse_sample("record.spike", component, worst + 1,
            f"the sample {a[worst + 1]:.4g} m/s2 stands {bend[worst] / others.max():.0f} times farther"
            " from its neighbours than any other: a spike", "a record without spikes",
            "replace the sample, or accept it with --doubtful")  # fmt: skip


def _filled_gap(component: Component, a: np.ndarray, peak: float) -> None:
    least = max(int(_FILLED_GAP_S / component.time_step_s), 10)
    for start, end in _runs(np.diff(a) == 0):
        if end - start < least or start < 1 or end + 1 >= len(a):
            continue
        before, after = a[max(start - least, 0) : start], a[end + 1 : end + 1 + least]
        if min(np.abs(before - a[start]).max(), np.abs(after - a[start]).max()) > _FILLED_GAP_FRACTION * peak:
            seconds = (end - start) * component.time_step_s
            _refuse_sample("record.filled_gap", component, start,
                f"the samples stay at {a[start]:.4g} m/s2 for {seconds:.3g} s amid the shaking: a filled gap",
                "an unbroken record",
                "cut the record before the gap, or accept it with --doubtful")  # fmt: skip


def _runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """First place of every run, and the place behind it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(start), int(end)) for start, end in edges.reshape(-1, 2)]


def _refuse_sample(
    code: str, component: Component, sample: int, what: str, expected: str, remedy: str
) -> None:
    time = sample * component.time_step_s
    component.refuse(code, f"{what} (sample {sample}, {time:.3f} s)", expected, remedy)


def is_beyond(factor: ArrayLike, pgv_m_s: ArrayLike, pgd_m: ArrayLike) -> NDArray[np.bool_]:
    """Whether scaled motions exceed all recorded ones by their factor, PGV or PGD."""
    limits = ((factor, LARGEST_FACTOR), (pgv_m_s, LARGEST_PGV_M_S), (pgd_m, LARGEST_PGD_M))
    return np.logical_or.reduce([np.asarray(value, float) > limit for value, limit in limits])


def words(factor: float, pgv_m_s: float, pgd_m: float) -> str:
    """A motion after scaling, in words.

    Examples
    --------
    >>> words(42.3, 7.04, 5.1)
    '42-fold, PGV 7.0 m/s, PGD 5.1 m'
    """
    scaled = "" if factor != factor else f"{factor:.0f}-fold, " if factor >= 10.0 else f"{factor:.1f}-fold, "
    return f"{scaled}PGV {pgv_m_s:.1f} m/s, PGD {pgd_m:.1f} m"
