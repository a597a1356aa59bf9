"""`toppling check`: whether given seismograms, unscaled, topple the rock."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from toppling.models.files.documents import MOST_SHOWN
from toppling.orchestrator.cli import SuggestingChoice
from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.records import show_notes, show_table
from toppling.orchestrator.verbs.shared_options import of, option
from toppling.results.run_integrity import SITES_FILE
from toppling.results.schema import TOPPLED_OUTCOMES
from toppling.workers.options import PRESETS

if TYPE_CHECKING:
    import pandas as pd

    from toppling.orchestrator.studies.seismograms import Verdict

_CHECK = "studies.seismograms.check"


@click.command()
@shared.scene_argument
@click.argument("seismograms", nargs=-1, type=shared.PATH)
@of(_CHECK, "--friction", type=shared.ABOVE_0)
@of(_CHECK, "--metadata", type=click.Path(path_type=Path, exists=True))
@of(_CHECK, "--missing-vertical")
@of(_CHECK, "--range", "largest", type=click.FloatRange(1, 10), metavar="N")
@of(_CHECK, "--neighbours", type=click.IntRange(0, 100))
@of(_CHECK, "--preset", type=SuggestingChoice(list(PRESETS)))
@option("--workers", type=click.IntRange(1), help="Of many rocks: processes. Default: one per core.")
@option(
    "--out", type=click.Path(path_type=Path, file_okay=False),
    help="Of many rocks: folder for rows, matrix and figure.",
)  # fmt: skip
@shared.json_option()
def check(
    scene: Path,
    seismograms: tuple[Path, ...],
    workers: int | None,
    out: Path | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """Test whether SEISMOGRAMS, unscaled and in their own directions, topple the rock of SCENE.

    Use it for motions simulated at the site or recorded nearby. SEISMOGRAMS are files or
    folders that 'records import' reads, or folders of ensembles. Near its threshold a millimetre decides whether a
    rock topples, so each seismogram is also shaken a little weaker and a little stronger; the result is the share
    that topples.

    SCENE may also be a table of rocks (CSV, as a campaign's 'sites') or a run of many rocks: each is shaken
    with the seismograms whose station, or folder, is named as its site. The result is a matrix of rocks and scenarios.

    \b
    toppling check scenes/rock simulated.csv --metadata simulated_table.csv
    toppling check scenes/rock ensembles/scenario --friction 0.7 --json
    toppling check sites.csv simulated/ --out checked
    """
    from toppling.orchestrator.studies import seismograms as study

    table = scene / SITES_FILE if (scene / SITES_FILE).is_file() else scene
    if table.is_file():
        _check_table(table, seismograms, as_json=as_json)
        return
    if not seismograms or workers or out:
        raise click.UsageError(
            "--workers and --out apply to a table of rocks"
            if seismograms
            else "Missing argument 'SEISMOGRAMS...'."
        )
    shared.compile_first()
    with bar("shaking") as advance:
        checked = study.check(scene, seismograms, advance=advance, **asked)
    _show_reading(checked.remarks, checked.notes)
    verdicts = checked.verdicts
    if as_json:
        click.echo(json.dumps([asdict(verdict) for verdict in verdicts], indent=1))
    else:
        _show(verdicts, asked["largest"])


def _check_table(table: Path, seismograms: Sequence[Path], *, as_json: bool) -> None:
    """Shake the rocks of a table, each with the seismograms at its site."""
    from toppling.orchestrator.site_table import read_sites
    from toppling.orchestrator.studies import seismograms as study

    asked = click.get_current_context().params
    read = study.read_seismograms(
        seismograms, asked["metadata"], asked["missing_vertical"], folders_apart=True
    )
    _show_reading(read.remarks, read.notes)
    sites = read_sites(table)
    if asked["friction"] is not None:
        sites = tuple(replace(site, friction=asked["friction"]) for site in sites)
    factors = study.neighbouring_factors(asked["largest"], asked["neighbours"])
    shared.compile_first()
    with bar("shaking") as advance:
        rows = study.check_sites(sites, read.found, factors, asked["preset"], asked["workers"], advance)
    matrix = study.matrix_of(rows)
    if out := asked["out"]:
        from toppling.models.files.table import write_csv
        from toppling.results.drawing.side_by_side_figures import scenarios_figure
        from toppling.results.drawing.style import save

        write_csv(rows, out / "rows.csv")
        write_csv(matrix.reset_index(), out / "matrix.csv")
        save(scenarios_figure(rows, matrix), out / "matrix")
    if as_json:
        click.echo(rows.to_json(orient="records", indent=1))
        return
    _show_matrix(rows, matrix)
    if out:
        click.echo(f"{out}: rows.csv, matrix.csv, matrix (PNG, SVG)")


def _show_matrix(rows: "pd.DataFrame", matrix: "pd.DataFrame") -> None:
    shown = matrix.iloc[:, :MOST_SHOWN]
    words = [
        (str(rock), *("-" if math.isnan(share) else f"{share:.2f}" for share in fractions))
        for rock, fractions in shown.iterrows()
    ]
    show_table(("rock", *map(str, shown.columns)), words, (0,))
    if (left := matrix.shape[1] - MOST_SHOWN) > 0:
        click.echo(f"({left} more scenarios: --out and --json give all)")
    toppled = int(rows["outcome"].isin(TOPPLED_OUTCOMES).sum())
    click.echo(
        f"fraction toppled by each seismogram and its scaled copies; unscaled, {toppled} of "
        f"{rows['scenario'].count()} topple their rock"
    )
    for rock, of_rock in rows[rows["message"].notna()].groupby("rock"):
        click.echo(f"{rock}: {of_rock['message'].iloc[0]} ({len(of_rock)} rows)", err=True)


def _show_reading(remarks: Sequence[str], notes: list[tuple[str, str]]) -> None:
    for remark in remarks:
        click.echo(remark, err=True)
    show_notes(notes)


def _show(verdicts: Sequence["Verdict"], largest: float) -> None:
    heads = ("seismogram", "event", "station", "PGA m/s²", "PGV m/s", "as it is", "tilt °", "toppled near it",
             "least factor")  # fmt: skip
    words = [
        (
            verdict.record_id + ("" if verdict.north_known else " (north?)"), verdict.event, verdict.station,
            f"{verdict.pga_m_s2:.2f}", f"{verdict.pgv_m_s:.3f}", verdict.outcome, f"{verdict.max_tilt_deg:.2f}",
            "-" if verdict.probability is None else f"{verdict.toppled} of {verdict.shaken}",
            "-" if verdict.least_factor is None else f"{verdict.least_factor:.3g}",
        )
        for verdict in verdicts
    ]  # fmt: skip
    show_table(heads, words, (0, 1, 2, 5))
    click.echo(
        f"toppled near it: with the seismogram scaled by {1 / largest:.3g} to {largest:.3g} in equal ratios;\n"
        "least factor: the smallest of these that toppled the rock"
    )
    if not all(verdict.north_known for verdict in verdicts):
        click.echo("(north?): unknown directions; the first horizontal component was taken as east")
