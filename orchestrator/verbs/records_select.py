"""`toppling records select`: fewer records, or records weighted by a hazard."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from toppling.models.errors import InputError
from toppling.models.spelling import counted
from toppling.orchestrator.misspelt import OneOf
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option

if TYPE_CHECKING:
    from toppling.models.motions.deaggregation import Deaggregation
    from toppling.models.motions.ensemble import Ensemble

_MOST_EMPTY = 6
"""Maximum number of deaggregation bins without a record that are listed, by falling contribution."""


@click.command()
@click.argument("ensemble", type=shared.EXISTING_FOLDER)
@option("--out", required=True, type=shared.FOLDER, help="Folder of the new ensemble.")
@option("--magnitude", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest.")
@option("--distance", "distance_km", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest, km.")
@option("--event", help="Part of the name of the event.")
@option("--components", type=click.IntRange(2, 3), default=2, help="Least number of components.")
@option(
    "--per-event", "most_per_event", type=click.IntRange(min=0), default=0,
    help="Largest number of records per event; the nearest are kept.",
)  # fmt: skip
@option(
    "--quality", multiple=True, type=OneOf(["corrected", "processed", "drifting", "sound", "uncorrected",
    "made"]),
    help="Only records of this quality; repeatable.",
)  # fmt: skip
@option(
    "--pga", "pga_m_s2", type=float, nargs=2, metavar="LOW HIGH",
    help="Least and largest PGA as recorded, m/s2.",
)  # fmt: skip
@option(
    "--pgv-pga", "pgv_pga_s", type=float, nargs=2, metavar="LOW HIGH", help="Least and largest PGV/PGA, s."
)
@option(
    "--count", type=click.IntRange(min=0), default=0,
    help="Largest number of records, spread evenly over the ranks of PGV/PGA of those that the other conditions leave.",
)  # fmt: skip
@option(
    "--deaggregation", type=shared.EXISTING_FILE,
    help="Table that weights the records: CSV with magnitude_low, magnitude_high, distance_low_km, distance_high_km,"
    " contribution; nshmp-haz's data.csv; or OpenQuake's Mag_Dist.",
)  # fmt: skip
@option("--imt", help="Measure of OpenQuake's deaggregation, such as PGV, where it has several.")
@option(
    "--poe", type=float,
    help="Its probability, where it has several; default the least, of the strongest motion.",
)  # fmt: skip
@shared.replace_option
def select(
    ensemble: Path,
    out: Path,
    deaggregation: Path | None,
    imt: str | None,
    poe: float | None,
    replace: bool,
    **asked: Any,
) -> None:
    """Select records of an ensemble, or weight them by a hazard.

    Each condition reports how many records remain.

    \b
    toppling records select ensembles/quakes --out ensembles/near --distance 0 20 --per-event 3
    toppling records select ensembles/quakes --out ensembles/forty --pgv-pga 0.05 0.5 --count 40
    """
    import dataclasses

    from toppling.models.motions.deaggregation import read_deaggregation
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.motions.selection import Choice
    from toppling.models.motions.selection import select as chosen

    refuse_existing_ensemble(out, replace)
    loaded = Ensemble.load(ensemble)
    choice = Choice(**asked)
    names, conditions = chosen(loaded, choice)
    click.echo(f"{counted(len(loaded.record_ids), 'record')} in {ensemble}")
    for condition, left in conditions:
        click.echo(f"{condition}: {left} left")
    if 0 < len(names) < choice.count:
        click.echo(f"fewer than the {choice.count} requested: all that are left were taken", err=True)
    weights = dict(zip(loaded.record_ids, loaded.catalog["weight"].to_pylist(), strict=True))
    if deaggregation:
        weights = _hazard_weights(loaded, names, read_deaggregation(deaggregation, imt, poe))
        names = [name for name in names if weights[name] > 0]
    written = Ensemble.write(
        out, [dataclasses.replace(loaded.record(name), weight=weights[name]) for name in names]
    )
    click.echo(f"{len(written.record_ids)} of {counted(len(loaded.record_ids), 'record')} in {out}")


def _hazard_weights(ensemble: "Ensemble", names: list[str], hazard: "Deaggregation") -> dict[str, float]:
    """Weights of records from a deaggregation; prints the bins that no record represents."""
    from toppling.models.motions.selection import hazard_weights

    if hazard.of:
        click.echo(f"weighted for {hazard.of}")
    weights, empty = hazard_weights(ensemble, names, hazard.bins)
    empty.sort(key=lambda b: -b.contribution)
    for b in empty[:_MOST_EMPTY]:
        click.echo(f"no record for magnitude {b.magnitude}, distance {b.distance_km} km", err=True)
    if empty:
        share = sum(b.contribution for b in empty) / sum(b.contribution for b in hazard.bins)
        more = f"and {len(empty) - _MOST_EMPTY} more bins: " if len(empty) > _MOST_EMPTY else ""
        click.echo(f"{more}{100 * share:.3g} % of the hazard has no record", err=True)
    return weights


def refuse_existing_ensemble(out: Path, replace: bool) -> None:
    """Refuse a folder that contains an ensemble, unless it is to be replaced."""
    from toppling.models.motions.ensemble import CATALOG

    if (out / CATALOG).exists() and not replace:
        raise InputError(
            "ensemble.exists",
            "an ensemble exists there already",
            where=str(out),
            expected="a new folder",
            remedy="choose another --out, or replace it with --replace",
        )
