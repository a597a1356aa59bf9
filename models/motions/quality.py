"""Doubts about a channel's samples: beyond 5 g, clipped, a spike, a gap that was filled with a constant."""

import numpy as np

from toppling.models.motions.formats.component import Component, refuse

QUESTIONABLE_M_S2 = 5 * 9.80665
CLIPPED_SAMPLES, CLIPPED_RUN = 10, 4
"""So many samples at the extreme, so many of them in a row, are a clipped instrument."""
SPIKE_RATIO = 8.0
"""A lone sample this many times farther from its neighbours than the next farthest is a spike."""
FILLED_GAP_S = 0.5
FILLED_GAP_SHARE = 0.1
"""A constant stretch this long, with this share of the peak shortly before and after, is a filled gap."""


def doubts(component: Component) -> None:
    """Refuse a channel whose samples cannot be the ground's.

    Raises
    ------
    InputError
        At the first doubt, with file and sample.
    """
    a = component.acceleration_m_s2
    peak = float(np.abs(a).max())
    if peak > QUESTIONABLE_M_S2:
        _doubt(
            component,
            int(np.abs(a).argmax()),
            f"the peak is {peak:.4g} m/s2, beyond 5 g",
            "a peak below 5 g",
            "name the right unit in the metadata table, or accept it with --doubtful",
        )
    if peak == 0:
        _doubt(component, 0, "all samples are zero", "a motion", "leave the record out")
    _clipped(component, a)
    _spike(component, a)
    _filled_gap(component, a, peak)


def _clipped(component: Component, a: np.ndarray) -> None:
    for extreme in (a.max(), a.min()):
        start, length = _longest_run(a == extreme)
        count = int((a == extreme).sum())
        if (
            count >= CLIPPED_SAMPLES
            and length >= CLIPPED_RUN
            and abs(extreme - np.median(a)) > 0.5 * np.abs(a - np.median(a)).max()
        ):
            _doubt(
                component,
                start,
                f"{count} samples, {length} in a row, are at the extreme {extreme:.4g} m/s2: clipped",
                "a record within the instrument's range",
                "leave the record out, or accept it with --doubtful",
            )


def _spike(component: Component, a: np.ndarray) -> None:
    if len(a) < 20:
        return
    bend = np.abs(a[1:-1] - 0.5 * (a[:-2] + a[2:]))
    worst = int(bend.argmax())
    others = np.delete(bend, slice(max(worst - 2, 0), worst + 3))
    if bend[worst] > SPIKE_RATIO * others.max():
        _doubt(
            component,
            worst + 1,
            f"the sample {a[worst + 1]:.4g} m/s2 stands {bend[worst] / others.max():.0f} times farther"
            " from its neighbours than any other: a spike",
            "a record without spikes",
            "replace the sample, or accept it with --doubtful",
        )


def _filled_gap(component: Component, a: np.ndarray, peak: float) -> None:
    least = max(int(FILLED_GAP_S / component.time_step_s), 10)
    same = np.diff(a) == 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    for start, end in edges.reshape(-1, 2):
        if end - start < least or start < 1 or end + 1 >= len(a):
            continue
        before, after = a[max(start - least, 0) : start], a[end + 1 : end + 1 + least]
        if min(np.abs(before - a[start]).max(), np.abs(after - a[start]).max()) > FILLED_GAP_SHARE * peak:
            seconds = (end - start) * component.time_step_s
            _doubt(
                component,
                int(start),
                f"the samples stay at {a[start]:.4g} m/s2 for {seconds:.3g} s amid the shaking: a filled gap",
                "an unbroken record",
                "cut the record before the gap, or accept it with --doubtful",
            )


def _longest_run(mask: np.ndarray) -> tuple[int, int]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int))).reshape(-1, 2)
    if not len(edges):
        return 0, 0
    lengths = edges[:, 1] - edges[:, 0]
    longest = int(lengths.argmax())
    return int(edges[longest, 0]), int(lengths[longest])


def _doubt(component: Component, sample: int, what: str, expected: str, remedy: str) -> None:
    time = sample * component.time_step_s
    refuse(
        f"{what} (sample {sample}, {time:.3f} s)",
        component.path,
        component.line,
        expected=expected,
        remedy=remedy,
    )
