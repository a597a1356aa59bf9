"""`toppling magnitudes`: which earthquakes a standing rock excludes, under ground-motion models."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from toppling.models.files.folder import write_text
from toppling.models.files.table import is_numeral, write_csv
from toppling.orchestrator.terminal import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option
from toppling.results.analysis import SAMPLES
from toppling.results.hazard.gmm import MEASURES, MECHANISMS, MODELS, GroundMotionModel
from toppling.results.hazard.places import check_place, read_faults

if TYPE_CHECKING:
    from toppling.results.hazard.magnitudes import Exclusions

_PRINTED_DISTANCES_KM = (1, 2, 5, 10, 20, 50, 100)
"""Distances whose largest allowed magnitudes are printed, km."""


@click.command()
@click.argument("rock", type=shared.PATH, metavar="ROCK")
@option(
    "--model", "models", multiple=True, default=("bssa14",), metavar="NAME[=WEIGHT]",
    help=f"Ground-motion model, repeatable with weights that sum to 1: {', '.join(MODELS)}.",
)  # fmt: skip
@option(
    "--vs30", "vs30_m_s", type=float, required=True,
    help="m/s; shear-wave velocity of the upper 30 m at the rock.",
)  # fmt: skip
@option(
    "--mechanism", type=click.Choice(MECHANISMS), default="SS",
    help="Strike slip, normal, reverse, or unknown (bssa14, cy14).",
)  # fmt: skip
@option("--dip", "dip_deg", type=click.FloatRange(10, 90), default=90.0, help="Degrees, of the fault.")
@option(
    "--depth-top", "depth_top_km", type=click.FloatRange(0, 30), default=0.0, help="km, of its upper edge."
)
@option(
    "--vs30-source", type=click.Choice(("measured", "inferred")), default="measured",
    help="Where Vs30 is from, which changes sigma (ask14, cy14).",
)  # fmt: skip
@option(
    "--hypocentre", "hypocentre_km", type=click.FloatRange(0, 20),
    help="km; depth (cb14); the model's own estimate unless given.",
)  # fmt: skip
@option(
    "--basin", "depth_1_0_km", type=click.FloatRange(0, 3),
    help="km; depth to a shear-wave velocity of 1 km/s at the rock; the model's own estimate unless given.",
)  # fmt: skip
@option("--measure", type=click.Choice(list(MEASURES)), default="pgv_m_s", help="Of the fragility.")
@option(
    "--confidence", type=click.FloatRange(0.5, 1, max_open=True), default=0.95,
    help="Probability of toppling from which on an earthquake is excluded.",
)  # fmt: skip
@option(
    "--events", type=click.IntRange(1), multiple=True, default=(1,),
    help="How often the earthquake has happened while the rock stood; repeatable.",
)  # fmt: skip
@option(
    "--recurrence", type=click.FloatRange(0, min_open=True), multiple=True,
    help="Years; mean recurrence of the earthquake (Poisson), with --age; repeatable.",
)  # fmt: skip
@option("--age", help="Years for which the rock has been as fragile as it is, as in 'toppling constrain'.")
@option("--faults", type=shared.FILE, help="Fault traces (GeoJSON), with --site.")
@option(
    "--site", type=shared.SITE, metavar="LON LAT",
    help="Degrees, or with compass letters; where the rock stands.",
)  # fmt: skip
@option(
    "--deaggregation", type=shared.FILE,
    help="Of the site's hazard, as 'toppling records select' reads it: says which of its earthquakes are excluded.",
)  # fmt: skip
@option(
    "--ratio", type=click.FloatRange(0, min_open=True), default=1.0,
    help="Ratio of the peak of the horizontal vector to the models' component (RotD50).",
)  # fmt: skip
@option("--where", help="Only jobs of the run for which this SQL condition holds.")
@shared.trusted_option
@option("--out", type=shared.FOLDER, help="Folder for statement, tables, figures.")
@shared.json_option()
def magnitudes(
    rock: Path,
    models: tuple[str, ...],
    measure: str,
    confidence: float,
    events: tuple[int, ...],
    recurrence: tuple[float, ...],
    age: str | None,
    faults: Path | None,
    site: tuple[float, float] | None,
    deaggregation: Path | None,
    where: str | None,
    trusted: bool,
    out: Path | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """State which earthquakes a standing rock excludes, by models of ground motion.

    It prints the largest magnitude at each distance, and the least distance. ROCK is a run, or a file of fragility
    curves. An earthquake is excluded where a ground-motion model says that it, or so many like it, would have toppled
    the rock with the probability --confidence. All of them share the site's own term. Distance is that to the surface
    above the fault's upper edge, on its footwall. Needs the extra 'gmm' (pip install 'toppling[gmm]').

    \b
    toppling magnitudes runs/first --vs30 760 --events 1 --events 5
    toppling magnitudes runs/first --vs30 760 --recurrence 3000 --age 15000..30000 --model bssa14=0.5 --model cy14=0.5
    toppling magnitudes runs/first --vs30 760 --faults faults.geojson --site -118.1 34.7 --out magnitudes
    """
    from toppling.models.motions.selection import read_deaggregation
    from toppling.orchestrator.public.rocks import names_of, read_jobs, standing_rock
    from toppling.results.hazard import magnitudes as exclusion
    from toppling.results.hazard.ages import age_given, parse_age

    _check_usage(rock, recurrence, age, faults, site, where, models)
    names, weights = _weights(models)
    grid_of = [GroundMotionModel(name, measure, **asked) for name in names]
    traces = read_faults(faults, site) if faults and site else []
    taken_apart = read_deaggregation(deaggregation) if deaggregation else None
    years = parse_age(age) if age else None
    jobs = read_jobs(rock, where, trusted, None) if rock.is_dir() else None
    with bar("bootstrap of records", SAMPLES if jobs else 0) as advance:
        standing = standing_rock(names_of((rock,))[0], rock, measure, jobs, advance)
    grid = exclusion.motion_grid(grid_of, weights)
    at_traces = (
        exclusion.motion_grid(grid_of, weights, [trace.distance_km for trace in traces]) if traces else None
    )
    occurrences = [exclusion.event_count(confidence, count) for count in dict.fromkeys(events)]
    occurrences += [
        exclusion.recurring(confidence, years, every)
        for every in dict.fromkeys(recurrence)
        if years is not None
    ]
    answer = exclusion.Exclusions(
        standing, grid, at_traces, occurrences, traces, exclusion.reference_grid(grid_of, grid)
    )
    statement = answer.statement() | {
        "models": [{"name": name, "weight": weight} for name, weight in zip(names, grid.weights.tolist(), strict=True)],
        **asked, "sigma": exclusion.sigma_parts(answer.reference, measure),
        "effects": exclusion.effects(grid_of, grid), "confidence": confidence,
        "age": age_given(age or ""), "age_years": None if years is None else float(years.mean()),
        "without_site_term": [model.name for model in grid_of if not model.has_site_term],
    }  # fmt: skip
    words = _words(statement)
    if taken_apart:
        bins = exclusion.excluded_bins(taken_apart.bins, grid_of, grid, standing.curve, occurrences)
        statement["deaggregation"] = {"of": taken_apart.of, "bins": bins.to_dict("records")}
        words += exclusion.bins_words(bins)
        if out:
            write_csv(bins, out / "deaggregation.csv")
    if out:
        _write(answer, out, statement)
    click.echo(json.dumps(statement, indent=1, allow_nan=False) if as_json else "\n".join(words))


def _check_usage(
    rock: Path, recurrence: tuple[float, ...], age: str | None, faults: Path | None,
    site: tuple[float, float] | None, where: str | None, models: Sequence[str],
) -> None:  # fmt: skip
    wrong = {
        "--recurrence needs the rock's --age": recurrence and not age,
        "--age applies to --recurrence: give it too": age and not recurrence,
        "--faults needs the rock's place: --site LON LAT": faults and not site,
        "--site applies to --faults": site and not faults,
        "--model names a model twice": len(set(_weights(models)[0])) < len(models),
        "--where selects jobs of runs; a file of curves has none": where and not rock.is_dir(),
    }
    for what in filter(wrong.get, wrong):
        raise click.UsageError(what)
    if site:
        check_place(site)


def _weights(models: Sequence[str]) -> tuple[list[str], list[float]]:
    """Names of models and their weights, by default equal; NaN for what is no number."""
    pairs = [text.lower().partition("=") for text in models]
    weights = [float(weight) if is_numeral(weight) else math.nan for _, _, weight in pairs]
    stated = any(weight for _, _, weight in pairs)
    return [name for name, _, _ in pairs], weights if stated else [1.0 / len(pairs)] * len(pairs)


def _write(answer: "Exclusions", out: Path, statement: dict[str, Any]) -> None:
    """Write statement, tables and figures to a folder."""
    import numpy as np
    import pandas as pd

    from toppling.results.drawing.hazard_figures import faults_figure, magnitudes_figure
    from toppling.results.drawing.style import save
    from toppling.results.hazard import magnitudes as exclusion

    write_text(json.dumps(statement, indent=1, allow_nan=False) + "\n", out / "magnitudes.json")
    limits = float(answer.grid.magnitude[0]), float(answer.grid.magnitude[-1])
    for index, name in enumerate(("largest_magnitudes", "least_distances")):
        parts = [pair[index].assign(occurrence=occurrence) for occurrence, pair in answer.tables.items()]
        write_csv(pd.concat(parts, ignore_index=True), out / f"{name}.csv")
    first = {name: pair[0] for name, pair in answer.tables.items()}
    last = answer.occurrences[-1]
    chances = last.name, exclusion.toppled(answer.grid, answer.rock.curve, last)
    save(magnitudes_figure(first, statement["confidence"], answer.grid, chances), out / "magnitudes")
    if answer.traces:
        write_csv(answer.faults, out / "faults.csv")
        allowed = answer.faults.loc[answer.faults["occurrence"] == last.name, "magnitude"]
        drawn = [
            replace(trace, magnitude=magnitude)
            for trace, magnitude in zip(answer.traces, allowed, strict=True)
        ]
        table = exclusion.least_distances(answer.grid, answer.rock.curve, [], last)
        circles = {
            magnitude: float(np.interp(magnitude, table["magnitude"], table["distance_km"]))
            for magnitude in exclusion.TARGETS
            if limits[0] <= magnitude <= limits[1]
        }
        save(faults_figure(drawn, circles, f"standing, {last.name}", limits), out / "faults")


def _words(statement: dict[str, Any]) -> list[str]:
    from toppling.results.drawing.sentences import LEAST_FRACTION, age_words, fragility_words
    from toppling.results.hazard.magnitudes import REFERENCE

    models = ", ".join(f"{model['name']} ({model['weight']:.3g})" for model in statement["models"])
    lines = []
    at = "at magnitude {:g} and {:g} km".format(*REFERENCE)
    for case in statement["occurrences"]:
        lines.append(f"{case['occurrence'].capitalize()}, at {100 * statement['confidence']:g} %:")
        if case["excludes_nothing"]:
            most, near = statement["magnitude_range"][1], statement["distance_range_km"][0]
            lines.append(f"  nothing is excluded, not even magnitude {most:g} at {near:g} km")
        else:
            lines += [f"  {line}" for line in _distance_lines(case)]
        if case["topples_ergodic"] - case["topples"] > LEAST_FRACTION:
            lines.append(
                f"  {at} they topple it with a probability of {case['topples']:.3f}; were the site's own term drawn "
                f"anew in each earthquake, of {case['topples_ergodic']:.3f}"
            )
    lines += map(_fault_line, statement["faults"])
    lines.append(
        f"{statement['rock']}: {fragility_words(statement, statement['measure'])}{age_words(statement)}; "
        f"models: {models}; Vs30 {statement['vs30_m_s']:g} m/s."
    )
    lines.append(
        "{}, sigma {total:.3f} consists of {between_events:.3f} between events, {between_sites:.3f} between sites "
        "(shared by all earthquakes here) and {remaining:.3f} remaining (Al Atik, 2015, global model).".format(
            at[0].upper() + at[1:], **statement["sigma"]
        )
    )
    if statement["ratio"] == 1.0:
        lines.append(
            "The models' component (RotD50) is taken as the peak of the horizontal vector; give --ratio, about 1.2, to "
            "set it right."
        )
    for effect in statement["effects"]:
        factor, sigma, before = (effect[name] for name in ("median_factor", "sigma", "sigma_before"))
        does = f"the median times {factor:.3f}, sigma {sigma:.3f} instead of {before:.3f}"
        if (factor, sigma) == (1.0, before):
            does = "no effect on the models' motion"
        lines.append(f"{effect['option']} {effect['value']} instead of {effect['instead_of']}, {at}: {does}.")
    if statement["without_site_term"]:
        lines.append(
            f"{', '.join(statement['without_site_term'])}: for hard rock, without a site term; --vs30 is not used."
        )
    return lines


def _distance_lines(case: dict[str, Any]) -> list[str]:
    rows = case["largest_magnitudes"]
    lines = []
    for distance in _PRINTED_DISTANCES_KM:
        row = min(rows, key=lambda row: abs(math.log(row["distance_km"] / distance)))
        if abs(math.log(row["distance_km"] / distance)) > 0.1 or row.get("excluded_magnitudes") == "none":
            continue
        if row["magnitude"] is None:
            lines.append(f"{row['distance_km']:.3g} km: every magnitude of the models is excluded")
            continue
        low, high = row["magnitude_low"], row["magnitude_high"]
        most = "any" if high is None else f"{high:.1f}"
        others = "" if low is None else f" (95 %: {low:.1f} to {most})"
        lines.append(f"{row['distance_km']:.3g} km: magnitudes above {row['magnitude']:.2f}{others}")
    return lines


def _fault_line(fault: dict[str, Any]) -> str:
    allowed = fault.get("excluded_magnitudes")
    limit = (
        "excludes no magnitude" if allowed == "none" else "excludes every magnitude" if allowed == "all"
        else f"excludes magnitudes above {fault['magnitude']:.2f}"
    )  # fmt: skip
    own = ""
    if fault["stated_magnitude"] is not None:
        own = (
            f"; its magnitude {fault['stated_magnitude']:g} topples the rock with a probability of "
            f"{fault['topples']:.2g} an event: "
            f"{'excluded' if fault['excluded'] else 'not excluded'}"
        )
    beyond = "; beyond the models' distances, taken as their farthest" if fault["beyond_models"] else ""
    return f"{fault['fault']}, {fault['distance_km']:.1f} km, {fault['occurrence']}: {limit}{own}{beyond}"
