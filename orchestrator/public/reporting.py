"""Queries and reports of runs."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

from toppling.models.errors import UsageError
from toppling.models.files.documents import without_machine
from toppling.models.files.folder import write_text
from toppling.orchestrator.public import unseen
from toppling.orchestrator.run_folder import place_in
from toppling.results.analysis import HEADLINE_MEASURE, SAMPLES
from toppling.results.queries import ask
from toppling.results.reader import Run, open_run


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
