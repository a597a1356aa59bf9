"""Output of `toppling records`: catalogues, notes, and files left out."""

import json
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

import click

from toppling.models.spelling import counted

if TYPE_CHECKING:
    from rich.table import Table

    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.importing import Import, Refusal


_MOST_NOTES = 20
"""Maximum number of printed notes."""


def import_json(ensemble: "Ensemble", outcome: "Import") -> None:
    """Print the records read and the files left out as JSON."""
    fields = ("code", "what", "where", "remedy")
    left_out = [
        {"subject": r.subject} | {name: getattr(r.reason, name) for name in fields} for r in outcome.refusals
    ]
    document = {
        "ensemble": str(ensemble.folder),
        "id": ensemble.id,
        "records": ensemble.record_ids,
        "left_out": left_out,
        "notes": [{"record": name, "what": what} for name, what in outcome.warnings],
        "unused_rows": outcome.unused_rows,
    }
    click.echo(json.dumps(document))


def show_table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], left: Collection[int], title: str | None = None
) -> None:
    """Print a table of words; the columns `left` are left-aligned."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE, title=title, title_justify="left")
    for index, head in enumerate(heads):
        table.add_column(head, justify="left" if index in left else "right", max_width=28, no_wrap=True)
    for row in rows:
        table.add_row(*row)
    _print(table, 150)


def _print(table: "Table", width: int) -> None:
    """Print a table as wide as the terminal, or `width` characters if the output is not a terminal."""
    from rich.console import Console

    console = Console()
    Console(width=None if console.is_terminal else width, markup=False).print(table)


def show_catalog(rows: list[dict]) -> None:
    """Print an ensemble's records as a table."""
    heads = ("record", "event", "station", "M", "R km", "PGA m/s²", "toward °", "PGV m/s", "PGV/PGA s", "D s",
             "2nd dir.")  # fmt: skip
    words = [
        (
            row["record_id"], row["event"], row["station"],
            "?" if row["magnitude"] is None else f"{row['magnitude']:.1f}",
            "?" if row["distance_km"] is None else f"{row['distance_km']:.1f}",
            f"{row['pga_m_s2']:.2f}", f"{row['ground_accelerates_toward_deg']:.0f}" if row["north_known"] else "?",
            f"{row['pgv_m_s']:.3f}", f"{row['pgv_pga_s']:.3f}", f"{row['duration_energy_s']:.1f}",
            f"{row['directionality']:.2f}",
        )
        for row in rows
    ]  # fmt: skip
    show_table(heads, words, range(3), counted(len(rows), "record"))
    undirected = sum(row["directionality"] > 0.9 for row in rows)
    click.echo(
        "toward: azimuth of the vector PGA, counter-clockwise from east;\n"
        "D: 5 to 95 % of the integral of squared velocity;\n"
        f"2nd dir.: share of PGA reached more than 22.5 degrees away ({undirected} above 0.9)"
    )


def show_notes(notes: list[tuple[str, str]]) -> None:
    """Print warnings on records to standard error, one per line."""
    for name, what in notes[:_MOST_NOTES]:
        click.echo(f"note on {name}: {what}", err=True)
    if len(notes) > _MOST_NOTES:
        rest = len(notes) - _MOST_NOTES
        click.echo(f"{rest} more notes: each record's history has its own ('records show --json')", err=True)


def show_refusals(refusals: "list[Refusal]") -> None:
    """Print a table of files left out, by reason; only the first few places of a reason are listed."""
    if not refusals:
        return
    from rich import box
    from rich.table import Table

    by_reason: dict[tuple[str, str], list[Refusal]] = {}
    for refusal in refusals:
        by_reason.setdefault((refusal.reason.brief, refusal.reason.remedy), []).append(refusal)
    table = Table(box=box.SIMPLE, show_lines=True, title=f"{len(refusals)} left out", title_justify="left")
    for head in ("left out", "why, and what to do"):
        table.add_column(head, overflow="fold", ratio=1)
    for (what, remedy), group in by_reason.items():
        subjects = [
            r.reason.where if r.subject in r.reason.where else f"{r.subject} ({r.reason.where})"
            for r in group
        ]
        table.add_row("\n".join(subjects), f"{what}\n-> {remedy}")
    _print(table, 200)
