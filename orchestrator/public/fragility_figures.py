"""Maps, curves and fits of a run, written to a folder and returned as tables."""

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from toppling.models.caching import Described
from toppling.models.errors import InputError
from toppling.models.frames import azimuth_of
from toppling.orchestrator.public import unseen
from toppling.orchestrator.run_folder import place_in
from toppling.results.analysis import FEW
from toppling.results.analysis import fragility as maps
from toppling.results.analysis.audit_statistics import Audit, audits_of
from toppling.results.analysis.exchange import read_curves
from toppling.results.analysis.fits import answered
from toppling.results.analysis.fragility import by_surroundings, least_sector
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.analysis.resampling import SAMPLES
from toppling.results.drawing import run_figures
from toppling.results.reader import Completeness, Run, open_run


@dataclass(frozen=True, eq=False, repr=False)
class Fragility(Described):
    """Fragility of a rock from a run.

    Parameters
    ----------
    run : Run
    folder : Path
        Folder of the figures and tables.
    files : list of Path
    jobs : DataFrame
        Weighted rows of the results in use.
    completeness : Completeness
    audits : mapping
        Audits of the run, by the engine or preset that repeated its jobs.
    fits : mapping
        Table of fragility by measure for each contact; empty without fits.
    curves : mapping
        Fragility curves by measure, with intervals, for each contact; empty without fits.
    """

    run: Run
    folder: Path
    files: list[Path]
    jobs: pd.DataFrame
    completeness: Completeness
    audits: dict[str, Audit]
    fits: dict[str, pd.DataFrame] = field(default_factory=dict)
    curves: dict[str, dict[str, Lognormal]] = field(default_factory=dict)

    def curve(self, measure: str, contact: str = "") -> Lognormal:
        """Fragility curve over an intensity measure, such as `pgv_m_s`.

        contact: needed where the run has several.
        Raises InputError if there is none: fits were not asked for, or too few jobs topple.
        """
        if measure in self.curves.get(contact, {}):
            return self.curves[contact][measure]
        known = [f"{name} {at}".strip() for at, curves in self.curves.items() for name in curves]
        raise InputError(
            "fragility.no_curve",
            f"no curve over {f'{measure} {contact}'.strip()}; curves are over: {', '.join(known) or 'none'}",
            where=str(self.run.path),
            expected=f"a measure and a contact with a curve, which at least {FEW} toppled jobs bear",
            remedy="correct the name, ask for fit=True, or add levels at which more jobs topple",
        )

    def _facts(self) -> dict[str, object]:
        known = answered(self.jobs)
        counts = {
            "run": self.run.name,
            "jobs": f"{len(known):,}, of which {int(known['toppled'].sum()):,} toppled",
        }
        medians = {
            f"half topple at {contact}".strip(): ", ".join(
                f"{measure} {curve.median:.3g}" for measure, curve in curves.items()
            )
            for contact, curves in self.curves.items()
        }
        return {**counts, **medians, "files": f"{len(self.files)} in {self.folder}"}


def fragility(
    run: Run | str | Path,
    out: str | Path | None = None,
    *,
    where: str | None = None,
    trusted: bool = False,
    directions: int = maps.DIRECTION_BINS,
    sector: tuple[float | str, float | str] | None = None,
    fit: bool = False,
    samples: int = SAMPLES,
    advance: Callable[..., None] = unseen,
) -> Fragility:
    """Draw the fragility maps and curves of a run of one rock, as `toppling fragility` does.

    Parameters
    ----------
    run : Run or path
    out : path or None
        Folder; `fragility` in the run's unless given.
    where : str or None
        Only jobs for which this SQL condition holds, which may read files if it is trusted.
    directions : int
        Direction bins.
    sector : (float or str, float or str) or None
        Sector of azimuths (degrees counter-clockwise from east) or bearings (N40E), whose share of topplings is stated;
        35 degrees around where the least constant acceleration topples the rock to unless given.
    fit : bool
        Fit curves and surfaces too, with so many samples, and rank the intensity measures.
    advance : callable
        Called after each file.

    Raises
    ------
    InputError
        If the folder is no run, or no job has an answer.
    """
    opened = open_run(run)
    jobs = opened.single().jobs(where, trusted=trusted)
    done, quasi_static, audits = opened.completeness(), opened.quasi_static(), audits_of(opened)
    within = (azimuth_of(sector[0]), azimuth_of(sector[1])) if sector else least_sector(quasi_static)
    planes = maps.planes_of(jobs)
    folder = Path(out) if out else place_in(opened.path, "fragility")
    contacts = maps.by_contact(jobs)
    # Of a contact: three files per map (over all directions, and by direction), and four of directions.
    maps_and_roses = 3 * sum(1 + plane.by_direction for plane in planes.values()) + 4
    steps = maps_and_roses + bool(within) + (10 + run_figures.FIT_PARTS) * fit
    advance(0, total=len(contacts) * steps + 4 * len(by_surroundings(jobs)))
    drawing = itertools.chain(
        run_figures.write_maps(jobs, folder, planes.values(), directions, done),
        run_figures.write_directions(jobs, quasi_static, folder, within, done),
        run_figures.write_friction(jobs, folder, planes["pga_pgv"], done),
        run_figures.write_fits(jobs, folder, opened.rock, samples, advance, done) if fit else (),
    )
    written = list(_counted(drawing, advance))
    fitted, curves = (of(folder, contacts if fit else ()) for of in (_fits_in, _curves_in))
    return Fragility(opened, folder, written, jobs, done, audits, fitted, curves)


def _counted(files: Iterable[Path], advance: Callable[..., None]) -> Iterator[Path]:
    for path in files:
        yield path
        advance()


def _fits_in(folder: Path, contacts: Iterable[str]) -> dict[str, pd.DataFrame]:
    tables = {name: folder / name / "fits" / "fits.csv" for name in contacts}
    return {
        name: pd.read_csv(path, dtype={"problem": object}).fillna({"problem": ""})
        for name, path in tables.items()
    }


def _curves_in(folder: Path, contacts: Iterable[str]) -> dict[str, dict[str, Lognormal]]:
    files = {name: folder / name / "fits" / "curves.json" for name in contacts}
    return {name: read_curves(path) if path.exists() else {} for name, path in files.items()}
