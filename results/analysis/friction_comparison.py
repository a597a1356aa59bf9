"""Comparison of frictions: equal cells, and equal jobs, under two pairs of coefficients."""

from collections.abc import Iterator

import pandas as pd

from toppling.results.analysis.fragility import CONTACT_COLUMNS, FRICTION, Plane, by_contact, cells

_SURROUNDINGS = [name for name in CONTACT_COLUMNS if name not in FRICTION]
_JOB = [*_SURROUNDINGS, "record_id", "level_pga_m_s2", "azimuth_deg", "realisation"]

_Friction = tuple[float, float]
"""Static and kinetic coefficient."""


def friction_words(static: float, kinetic: float) -> str:
    """Format a pair of coefficients: 0.8 where they are equal, or 0.8 (0.6 kinetic)."""
    return f"{static:g}" if static == kinetic else f"{static:g} ({kinetic:g} kinetic)"


def frictions(frame: pd.DataFrame) -> list[_Friction]:
    """Distinct pairs of static and kinetic friction, ascending."""
    return sorted(frame[FRICTION].drop_duplicates().itertuples(index=False, name=None))


def by_surroundings(frame: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Rows of each scene, engine, preset and restitution with several frictions to compare."""
    parts = by_contact(frame, _SURROUNDINGS)
    return {name: jobs for name, jobs in parts.items() if len(frictions(jobs)) > 1}


def compare_frictions(frame: pd.DataFrame, plane: Plane) -> Iterator[tuple[str, pd.DataFrame, pd.DataFrame]]:
    """Compare each friction with the highest, for each of `by_surroundings`: yield its name, cells and jobs."""
    for name, jobs in by_surroundings(frame).items():
        reference = frictions(jobs)[-1]
        table, pairs = compare_cells(jobs, plane, reference), compare_jobs(jobs, reference)
        if len(table) and len(pairs):
            yield name, table, pairs


def compare_cells(frame: pd.DataFrame, plane: Plane, reference: _Friction) -> pd.DataFrame:
    """Toppling probability of each cell under each friction and under a reference friction.

    Only jobs that were answered under both are compared, so that differences are due to friction.

    frame: rows of results of one scene, preset and restitution (`by_surroundings`).
    reference: static and kinetic friction on the horizontal axis.
    Returns DataFrame: one row per friction and cell: friction_static, friction_kinetic, the cell's bounds, records,
    probability, wilson_low, wilson_high, thin; with the prefix `reference_` frictions and probabilities of the
    reference.
    """
    answered = frame[frame["toppled"].notna()]
    base = _under(answered, reference)
    tables = []
    for friction in frictions(answered):
        if friction == reference:
            continue
        jobs = _under(answered, friction)
        shared = base[_JOB].merge(jobs[_JOB])
        ours, theirs = (cells(part.merge(shared), plane) for part in (jobs, base))
        bounds = [name for name in ours.columns if name.endswith(("_low", "_high")) and "wilson" not in name]
        numbers = ["probability", "wilson_low", "wilson_high"]
        renamed = theirs[[*bounds, *numbers]].rename(columns={name: f"reference_{name}" for name in numbers})
        both = ours[[*bounds, "records", *numbers, "thin"]].merge(renamed, on=bounds)
        tables.append(both.assign(**_named(friction, reference)))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def compare_jobs(frame: pd.DataFrame, reference: _Friction) -> pd.DataFrame:
    """Pair each job with its equivalent under a reference friction, and count how the answers differ.

    Returns DataFrame: one row per friction: friction_static, friction_kinetic, those of the reference, numbers of pairs
    of which both, neither, only_this or only_reference toppled.
    """
    lines = []
    for friction, pairs in _paired_jobs(frame, reference).groupby(FRICTION):
        this, that = pairs["toppled"], pairs["toppled_reference"]
        lines.append({
            **_named(friction, reference), "pairs": len(pairs),
            "both": int((this & that).sum()), "neither": int((~this & ~that).sum()),
            "only_this": int((this & ~that).sum()), "only_reference": int((~this & that).sum()),
        })  # fmt: skip
    return pd.DataFrame(lines)


def _paired_jobs(frame: pd.DataFrame, reference: _Friction) -> pd.DataFrame:
    """Jobs with an answer under both frictions: `toppled` and, under the reference, `toppled_reference`."""
    answered = frame[frame["toppled"].notna()].astype({"toppled": bool})
    is_reference = (answered[FRICTION].to_numpy() == reference).all(axis=1)
    base = answered.loc[is_reference, [*_JOB, "toppled"]]
    return answered[~is_reference].merge(base, on=_JOB, suffixes=("", "_reference"), validate="many_to_one")


def _under(frame: pd.DataFrame, friction: _Friction) -> pd.DataFrame:
    return frame[(frame[FRICTION].to_numpy() == friction).all(axis=1)]


def _named(friction: _Friction, reference: _Friction) -> dict[str, float]:
    names = [*FRICTION, *(f"reference_{name}" for name in FRICTION)]
    return dict(zip(names, (*friction, *reference), strict=True))
