"""Queries, reports and fragilities of runs: fits by measure, figures and the tables behind them."""

import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd
import pyarrow as pa

from toppling.models.caching import Described
from toppling.models.errors import InputError, UsageError
from toppling.models.files.documents import without_machine
from toppling.models.files.folder import write_text
from toppling.models.frames import azimuth_of
from toppling.orchestrator.public import unseen
from toppling.orchestrator.run_folder import place_in
from toppling.results.analysis import FEW, HEADLINE_MEASURE, SAMPLES
from toppling.results.analysis import fragility as maps
from toppling.results.analysis.audit_statistics import Audit, audits_of
from toppling.results.analysis.exchange import read_curves
from toppling.results.analysis.fits import answered
from toppling.results.analysis.fragility import by_surroundings, least_sector
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.drawing import run_figures
from toppling.results.queries import ask
from toppling.results.reader import Completeness, Run, open_run


def query(
    runs: Run | str | Path | Sequence[Run | str | Path], sql: str, *, trusted: bool = False
) -> pa.Table:
    """Answer one SELECT over the tables `results`, `motions`, `scene` and `bases` of runs, as `toppling query`.

    Parameters
    ----------
    runs : Run, path, or a sequence of them
    sql : str
        `open_run(RUN).describe()` lists the columns with their units.
    trusted : bool
        Let the query read and write files, as DuckDB can.

    Raises
    ------
    InputError
        If DuckDB refuses the query, or it would pool different experiments.
    """
    several = [runs] if isinstance(runs, Run | str | Path) else runs
    return ask([open_run(run) for run in several], sql, trusted=trusted)


@dataclass(frozen=True)
class Report:
    """A report on a run.

    Parameters
    ----------
    page : Path
        One HTML page that needs no network.
    pdf : Path or None
    """

    page: Path
    pdf: Path | None


def report(
    run: Run | str | Path,
    out: str | Path | None = None,
    *,
    pdf: bool = False,
    age: str | None = None,
    hazard: Sequence[str] = (),
    site: tuple[float, float] | str | None = None,
    measure: str | None = None,
    ratio: float = 1.0,
    years: float | None = None,
    samples: int = SAMPLES,
    advance: Callable[..., None] = unseen,
) -> Report:
    """Write a report on a run as one HTML page, as `toppling report` does.

    Parameters
    ----------
    run : Run or path
        A run of many rocks is shown with all of them side by side.
    out : path or None
        `report.html` in the run's folder unless given; ids, versions and columns go to a JSON file beside it.
    pdf : bool
        Print the page to PDF too, beside it (with Chromium, Chrome or Edge).
    age : str or None
        Years that the rock has stood, as for 'toppling constrain': 20000, 15000..30000, 20000+-3000 or a CSV.
    hazard : sequence of str
        Hazard curves, as for 'toppling constrain', each a path or PATH=WEIGHT; repeatable; they need the age.
    site : (float, float), str or None
        Longitude and latitude, or name, in hazard files of many sites.
    measure : str or None
        Intensity measure of the hazard, a column of the results.
    ratio : float
        Ratio of the peak of the horizontal vector to the hazard's component.
    years : float or None
        Years that the hazard's values are probabilities over, 0 for annual rates, where its files do not say.
    samples : int
        Bootstrap samples of the records.
    advance : callable
        Called after each section.

    Raises
    ------
    InputError
        If the folder is no run, a hazard cannot be read, or it is given without an age.
    """
    from toppling.orchestrator.public.constraining import HazardQuestion, read_tree
    from toppling.orchestrator.public.rocks import apart_km
    from toppling.results.drawing.report.content import Content
    from toppling.results.drawing.report.page import SECTIONS, provenance, report_page, write_pdf
    from toppling.results.hazard.ages import age_given, parse_age

    if hazard and not age:
        raise UsageError(
            "age.needed",
            "a hazard without the rock's age",
            where="hazard",
            expected="an age, which turns rates into probabilities",
            remedy="give the age too: --age 15000..30000, or age='15000..30000' in Python",
        )
    opened = open_run(run)
    target = Path(out) if out else place_in(opened.path, "report.html")
    tree = read_tree(tuple(hazard), HazardQuestion(site, ratio, measure, years)) if hazard else None
    apart_km([opened.path], tree)
    if opened.rocks:
        advance(0, total=2 * len(opened.rocks))
        text = _of_many(opened, target, samples, advance)
    else:
        advance(0, total=len(SECTIONS) + pdf)
        content = Content(opened, samples, parse_age(age) if age else None, age_given(age or ""), tree)
        text = report_page(content, lambda title: advance(doing=f"after {title}"))
    page = write_text(text, target)
    write_text(json.dumps(without_machine(provenance(opened)), indent=1), target.with_suffix(".json"))
    return Report(page, write_pdf(text, target.with_suffix(".pdf")) if pdf else None)


def _of_many(atlas: Run, target: Path, samples: int, advance: Callable[..., None]) -> str:
    from toppling.results.analysis.side_by_side import compare_rocks
    from toppling.results.drawing.report.gallery_page import gallery_page

    rocks, common = compare_rocks(atlas.rocks, HEADLINE_MEASURE, samples, advance=advance)
    return gallery_page(atlas.name, [atlas], rocks, common, HEADLINE_MEASURE, target.parent, advance)


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
