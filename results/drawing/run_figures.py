"""Writes the figures of a run and their tables to a folder."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from toppling.models.files.table import write_csv
from toppling.models.motions.measures import OPENQUAKE
from toppling.results.analysis import fits, lognormal, resampling
from toppling.results.analysis.exchange import write_curves
from toppling.results.analysis.fragility import (
    DIRECTION_BINS,
    DirectionCells,
    Plane,
    beyond,
    by_contact,
    cells,
    compare_frictions,
    contact_words,
    sector_share,
    topple_rose,
    unplaced,
)
from toppling.results.drawing.fit_figures import fit_figure
from toppling.results.drawing.maps import direction_figure, friction_figure, map_figure
from toppling.results.drawing.roses import rose_figure
from toppling.results.drawing.style import save, short_name
from toppling.results.reader import Completeness

FIT_PARTS = 20
"""Steps of progress for the fits of a contact, which take longer than a figure (one step)."""


def write_maps(
    frame: pd.DataFrame,
    folder: Path,
    planes: Iterable[Plane],
    directions: int = DIRECTION_BINS,
    reference: pd.DataFrame | None = None,
    run: Completeness | None = None,
) -> Iterator[Path]:
    """Write the maps of each plane, over all directions and by direction, and the number of jobs on none.

    frame: rows of results; several contacts have a subfolder each.
    folder: output folder, created if absent; files of the same names are replaced.
    directions: number of direction bins of the vector PGA.
    reference: from `analysis.plane_reference.reference_lines`, drawn over the cells of PGV/PGA and PGA.
    run: completeness of the run; an unfinished run is marked above each figure.
    Yields each file, once it is complete.
    """
    planes = list(planes)
    for contact, jobs in by_contact(frame).items():
        target = folder / contact
        left_out, title = [], contact_words(jobs, frame)
        for plane in planes:
            outside = beyond(jobs, plane)
            left_out.append((plane.name, len(jobs), unplaced(jobs, plane), outside))
            yield write_csv(cells(jobs, plane), target / f"{plane.name}.csv")
            yield from save(map_figure(jobs, plane, title), target / plane.name, _remark(run))
            if not plane.by_direction:
                continue
            split = DirectionCells.of(jobs, plane, directions)
            stem = target / f"{plane.name}_by_direction"
            left_out.append((stem.name, len(jobs), split.unplaced, outside))
            yield write_csv(split.table, stem.with_name(f"{stem.name}.csv"))
            lines = reference if plane.name == "pga_pgv_pga" else None
            if lines is not None:
                yield write_csv(lines, stem.with_name(f"{stem.name}_reference.csv"))
            yield from save(direction_figure(split, title, lines), stem, _remark(run))
        counts = pd.DataFrame(left_out, columns=["map", "jobs", "unplaced", "beyond"])
        yield write_csv(counts, target / "unplaced.csv")


def write_directions(
    frame: pd.DataFrame,
    quasi_static: pd.DataFrame | None,
    folder: Path,
    sector_deg: tuple[float, float] | None,
    run: Completeness | None = None,
) -> Iterator[Path]:
    """Write the rose of toppling azimuths, the fraction in an optional sector, and the quasi-static limit.

    Yields each file, once it is complete.
    """
    for contact, jobs in by_contact(frame).items():
        target = folder / contact
        rose, sector = topple_rose(jobs), None
        yield write_csv(rose, target / "directions.csv")
        (target / "sector.csv").unlink(missing_ok=True)
        if sector_deg is not None:
            sector = sector_share(jobs, *sector_deg)
            yield write_csv(pd.DataFrame([sector]), target / "sector.csv")
        yield from save(rose_figure(rose, quasi_static, sector), target / "directions", _remark(run))


def write_friction(
    frame: pd.DataFrame, folder: Path, plane: Plane, run: Completeness | None = None
) -> Iterator[Path]:
    """Write the comparison of each friction with the highest, cell by cell and job by job.

    Several scenes, presets or restitutions have a subfolder each.

    Yields each file, once it is complete; none for a single friction.
    """
    for surroundings, table, jobs in compare_frictions(frame, plane):
        target = folder / surroundings
        yield write_csv(table, target / "friction_cells.csv")
        yield write_csv(jobs, target / "friction_jobs.csv")
        yield from save(friction_figure(table, jobs), target / "friction", _remark(run))


def write_fits(
    frame: pd.DataFrame,
    folder: Path,
    name: str,
    samples: int = resampling.SAMPLES,
    advance: Callable[[float, str], object] = lambda _, __: None,
    run: Completeness | None = None,
) -> Iterator[Path]:
    """Write the fits of each contact: curves with intervals, surfaces, ranking, calibration, exchange files.

    frame: rows of results.
    name: name of the rock in exchange files.
    samples: number of bootstrap samples of records.
    advance: called with the steps done for a contact, of FIT_PARTS, and the name of the next one.
    run: completeness of the run, stored with curves; an unfinished run is marked above the figure.
    Yields each file, once it is complete.
    """
    for contact, jobs in by_contact(frame).items():
        target = folder / contact / "fits"
        former_files = [file for stem in ("curves", "fits", "surface") for file in target.glob(f"{stem}.*")]
        for former in (*former_files, target / "calibration.csv"):
            former.unlink(missing_ok=True)  # files of measures that have no fit any more are not overwritten
        yield from _write_contact(jobs, target, name, samples, advance, run)


def _write_contact(
    jobs: pd.DataFrame,
    target: Path,
    name: str,
    samples: int,
    advance: Callable[[float, str], object],
    run: Completeness | None,
) -> Iterator[Path]:
    advance(0, "ranking of the measures")
    parts = 0

    def notify(measures: Sequence[str]) -> None:
        names = " and ".join(map(short_name, measures))
        advance(FIT_PARTS / parts, f"bootstrap of the fit over {names}")

    contact = fits.ContactFits(jobs, samples, run, notify=notify)
    yield write_csv(contact.ranking, target / "measures.csv")
    both = [names for names in lognormal.SURFACES if set(names) <= set(contact.measures)]
    parts = len(contact.measures) + len(both) * len(lognormal.LINKS)
    of_two = [contact.fitted(names, link) for names in both for link in lognormal.LINKS]
    models = [*contact.models, *of_two]
    yield write_csv(fits.summary(models), target / "fits.csv")
    surfaces = [
        replace(surface, basis=fits.basis_of(jobs, surface.measures[0], run))
        for model in of_two
        if model.measures == lognormal.SURFACES[0] and (surface := model.surface)
    ]
    if curves := list(contact.curves.values()):
        for suffix in (".csv", ".json"):
            yield write_curves(target / f"curves{suffix}", curves, name, surfaces)
        if any(curve.measure in OPENQUAKE for curve in curves):
            yield write_curves(target / "curves.xml", curves, name)
        chosen = contact.best or curves[0]
        calibrated = fits.calibration(contact.known, fits.out_of_fold(contact.known, [chosen.measure]))
        yield write_csv(calibrated, target / "calibration.csv")
        observed = fits.observed_fractions(contact.known, chosen.measure)
        figure = fit_figure(chosen, observed, contact.ranking, calibrated)
        yield from save(figure, target / "fits", _remark(run))


def _remark(run: Completeness | None) -> str:
    return run.remark if run else ""
