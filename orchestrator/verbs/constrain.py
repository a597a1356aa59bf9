"""`toppling constrain`: what standing rocks say about past ground motion."""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np
import pandas as pd

from toppling.models.errors import InputError
from toppling.models.scene import Scene
from toppling.orchestrator.progress import bar
from toppling.orchestrator.stood import Recorded, check_weighable, read_recorded
from toppling.orchestrator.verbs.hazard import HAZARD_HELP, SITE_HELP, SiteCommand, read_tree
from toppling.results.constraint import bound_table, branch_table, single_event
from toppling.results.drawing.atlas import save_table
from toppling.results.drawing.constraint import constraint_figure
from toppling.results.drawing.style import save, short_name
from toppling.results.exchange import read_curves
from toppling.results.fits import MEASURES, SAMPLES, Lognormal, Resampled, answered, basis_of, bootstrap, fit
from toppling.results.fragility import by_contact
from toppling.results.hazard.ages import parse_age
from toppling.results.hazard.sites import distance_km
from toppling.results.hazard.standing import Standing
from toppling.results.run import open_run
from toppling.results.schema import SCHEMA, describe
from toppling.results.stood import CONTACT, Stood, sentences, told_of, unweighed


@click.command(cls=SiteCommand)
@click.argument("rocks", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="ROCK...")
@click.option(
    "--hazard",
    multiple=True,
    metavar="PATH[=WEIGHT]",
    help=HAZARD_HELP,
)
@click.option(
    "--age", multiple=True,
    help="Years for which each rock has stood: 20000, 15000..30000 (uniform), 20000+-3000 (normal, one sigma) or a "
    "CSV. One age for several rocks counts as an independent date of each, which rejects more than one common date "
    "would.",
)  # fmt: skip
@click.option("--where", help="Only jobs for which this SQL condition holds, such as those of one friction.")
@click.option("--trusted", is_flag=True, help="Let --where read your files.")
@click.option(
    "--stood", multiple=True, type=click.Path(path_type=Path), metavar="FILE",
    help="Recorded motion that the rock is known to have survived (one --stood per file), or an ensemble's folder; it "
    "weights the draws of the base.",
)  # fmt: skip
@click.option(
    "--measure",
    help="Intensity measure (a column of the results). Default: that of the hazard curves, or pgv_m_s.",
)
@click.option(
    "--confidence", type=click.FloatRange(0.5, 1, max_open=True), default=0.95, show_default=True,
    help="Confidence of all bounds; a branch is rejected if its survival is below 1 - confidence.",
)  # fmt: skip
@click.option(
    "--site", type=float, nargs=2, metavar="LON LAT", help=SITE_HELP,
)  # fmt: skip
@click.option("--site-name", hidden=True)
@click.option(
    "--ratio", type=click.FloatRange(0, min_open=True), default=1.0, show_default=True,
    help="Ratio of the peak of the horizontal vector to the hazard's horizontal component.",
)  # fmt: skip
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder for statement, tables and figure."
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def constrain(
    rocks: tuple[Path, ...],
    hazard: tuple[str, ...],
    age: tuple[str, ...],
    where: str | None,
    trusted: bool,
    stood: tuple[Path, ...],
    measure: str | None,
    confidence: float,
    site: tuple[float, float] | None,
    site_name: str | None,
    ratio: float,
    out: Path | None,
    as_json: bool,
) -> None:
    """State which ground motions one or several standing rocks reject.

    A ROCK is a run, or a file of fragility curves (CSV, JSON or NRML) as 'toppling fragility --fit' writes it.
    Without an age the statement is about a single event; with ages, about rates of exceedance; with hazard curves,
    about the rocks' survival under each curve and the weights of the branches. Several rocks share the same events.

    An earthquake recorded near a standing rock tells about its unseen base: with --stood every draw of the base is
    shaken with that record, unscaled and in its own orientation, and weighted by how likely the rock survives it.
    The run must have realisations on a scene with draws.

    \b
    toppling constrain runs/first --where "friction_static = 0.8"
    toppling constrain runs/first --age 15000..30000 --hazard mean.csv=0.6 --hazard high.csv=0.4
    toppling constrain runs/first --stood quake_e.AT2 --stood quake_n.AT2 --stood quake_up.AT2
    """  # noqa: D301
    if age and len(age) not in (1, len(rocks)):
        msg = f"give one --age, or one per rock: got {len(age)} for {len(rocks)} rocks"
        raise click.UsageError(msg)
    if hazard and not age:
        msg = "a hazard curve needs the rocks' --age, to turn rates into probabilities"
        raise click.UsageError(msg)
    if not hazard and (site or site_name or ratio != 1.0):
        msg = f"{'--site' if site or site_name else '--ratio'} applies to hazard curves: give --hazard too"
        raise click.UsageError(msg)
    if where and not all(path.is_dir() for path in rocks):
        msg = "--where selects jobs of runs; a file of curves has none"
        raise click.UsageError(msg)
    if stood and not all(path.is_dir() for path in rocks):
        msg = "--stood weights the bases of runs; a file of curves has none"
        raise click.UsageError(msg)
    asked = _measure(measure)
    files = {path: read_curves(path) for path in rocks if not path.is_dir()}
    known = [name for name in MEASURES if all(name in curves for curves in files.values())]
    tree = read_tree(hazard, site or site_name, ratio, asked, known) if hazard else None
    branches = tree.branches if tree else ()
    over = tree.measure if tree else asked or "pgv_m_s"
    ages = [parse_age(text) for text in age] or [np.array([np.nan])]
    recorded = read_recorded(stood) if stood else None
    runs = {path: _jobs(path, where, trusted, recorded) for path in rocks if path.is_dir()}
    with bar("bootstrap of records", SAMPLES * len(runs)) as advance:
        standing = [
            _standing(name, path, over, runs.get(path), years, seen=advance)
            for name, path, years in zip(
                _names(rocks), rocks, ages * len(rocks) if len(ages) == 1 else ages, strict=True
            )
        ]
    _refuse_twins(rocks, standing)
    told = single_event(standing, confidence)
    if of_bases := [
        {"rock": rock.name, **_of_bases(runs[path], rock.curve)}
        for path, rock in zip(rocks, standing, strict=True)
        if path in runs and runs[path].stood
    ]:
        told["stood"] = of_bases
    if age:
        told["ages_independent"] = sum(len(rock.years) > 1 for rock in standing) > 1
    bound = bound_table(standing, confidence) if age else None
    table = branch_table(standing, branches, confidence) if branches else None
    if table is not None:
        rows = table.astype(object).where(table.notna(), None).to_dict("records")
        told["branches"] = [
            row | _place(branch.curve.site, site) for row, branch in zip(rows, branches, strict=True)
        ]
        told["hazard_ratio"] = ratio
    if bound is not None:
        told["rejected"] = bound.to_dict("records")
    if out:
        out.mkdir(parents=True, exist_ok=True)
        (out / "constraint.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
        for name, kept in (("rejected", bound), ("branches", table)):
            if kept is not None:
                save_table(kept, out / f"{name}.csv")
        if bound is not None:
            save(constraint_figure(bound, branches, confidence, table, standing), out / "constraint")
    click.echo(json.dumps(told, indent=1) if as_json else _words(told))


def _refuse_twins(rocks: tuple[Path, ...], standing: list[Standing]) -> None:
    """Refuse a rock that is given twice, by its scene's hash or else its file: it would count twice."""
    seen: dict[str, Path] = {}
    for path, rock in zip(rocks, standing, strict=True):
        basis = rock.curve.basis
        of = basis.scene_id if basis else str(path.resolve())
        if of in seen:
            raise InputError(
                what=f"is the same rock as {seen[of]}" + (f" (scene {of})" if basis else ""),
                where=str(path),
                expected="each rock once",
                remedy="leave one of the two out",
            )
        seen[of] = path


def _names(rocks: tuple[Path, ...]) -> list[str]:
    """Last part of each path, or the whole paths where these are not distinct."""
    stems = [path.stem for path in rocks]
    return stems if len(set(stems)) == len(stems) else [str(path) for path in rocks]


def _place(taken: tuple[float, float] | None, asked: tuple[float, float] | None) -> dict[str, float]:
    """Site of a hazard curve, and its distance from the site requested."""
    if taken is None:
        return {}
    place = {"site_longitude_deg": taken[0], "site_latitude_deg": taken[1]}
    return place | ({"site_distance_km": float(distance_km(*taken, asked))} if asked else {})


def _measure(asked: str | None) -> str | None:
    if asked and asked not in MEASURES:
        raise InputError(
            what=f"{asked!r} is not an intensity measure with a fragility",
            where="--measure",
            expected=f"one of {', '.join(MEASURES)}",
            remedy="leave it out to use that of the hazard curves, or pgv_m_s",
        )
    return asked


@dataclass(frozen=True, eq=False)
class _Jobs:
    """Weighted jobs of one contact of a run, and what weights their bases."""

    path: Path
    frame: pd.DataFrame
    stood: Stood | None


def _standing(
    name: str, path: Path, measure: str, jobs: _Jobs | None, years: np.ndarray, seen: Callable[[], None]
) -> Standing:
    """A rock with the fragility of a run, with bootstrap samples of its records, or of a file."""
    curve, resampled = (read_curves(path).get(measure), None) if jobs is None else _fit(jobs, measure, seen)
    if curve is None:
        raise InputError(
            what=f"has no fragility over {measure}",
            where=str(path),
            expected="a lognormal fragility over the measure of the hazard",
            remedy="'toppling fragility RUN --fit' lists the measures that have one",
        )
    return Standing(name, curve, years, resampled)


def _jobs(path: Path, where: str | None, trusted: bool, recorded: Recorded | None) -> _Jobs:
    """The jobs requested, with the weights of their records and bases."""
    run = open_run(path)
    stood = run.stood()
    bare = run.frame(where, trusted=trusted)
    jobs = run.weighted(bare, stood)
    if where and jobs.empty:
        raise InputError(
            what=f"no job satisfies {where}",
            where=str(path),
            expected="a condition that some jobs satisfy",
            remedy="'toppling query RUN --describe' names columns and units",
        )
    planned, done = run.planned(), run.table().num_rows
    if planned and done < planned:
        left = f"{planned - done:,} of {planned:,} jobs have not run, and the others are not a random sample"
        click.echo(f"{path}: {left}: finish the run with 'toppling run' before you rely on it", err=True)
    contacts = by_contact(answered(jobs))
    if len(contacts) > 1:
        raise InputError(
            what=f"has {len(contacts)} contacts: {', '.join(contacts)}",
            where=str(path),
            expected="jobs of one contact",
            remedy='choose one, such as --where "friction_static = 0.8"',
        )
    if recorded:
        if stood:
            stood.refuse_twins(recorded.motions)
        also = _weighed(path, bare, recorded)
        stood = stood.joined(also) if stood else also
        jobs = run.weighted(bare, stood)
    return _Jobs(path, jobs, stood)


def _weighed(path: Path, jobs: pd.DataFrame, recorded: Recorded) -> Stood:
    """Weights of a run's bases from motions that its rock survived; the shakes are not kept."""
    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.cluster import local
    from toppling.orchestrator.progress import watcher
    from toppling.orchestrator.run import RunError, weigh

    campaign = Campaign.read(path / "campaign.toml")
    scene = Scene.load(campaign.scene)
    check_weighable(scene, jobs["base"].nunique(), str(path))
    (contact,) = jobs[CONTACT].drop_duplicates().itertuples(index=False, name=None)
    one = replace(campaign, friction=(contact[:2],), restitution=(contact[2],))
    with TemporaryDirectory(prefix="toppling-stood-") as place:
        recorded.write(Path(place))
        try:
            with watcher() as watch, local(os.cpu_count() or 1) as client:
                return weigh(one, recorded, Path(place), client, watch)
        except RunError as stopped:
            raise click.ClickException(str(stopped)) from None


def _fit(jobs: _Jobs, measure: str, seen: Callable[[], None]) -> tuple[Lognormal | None, Resampled | None]:
    """Fragility of a run, and of bootstrap samples of its records."""
    heard = _heard(jobs.frame, measure)
    fitted = fit(heard, [measure]) if len(heard) else None
    if fitted is None or (curve := fitted.lognormal) is None:
        return None, None
    return replace(curve, basis=basis_of(jobs.frame, measure)), bootstrap(heard, fitted, seen=seen)


def _heard(jobs: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Jobs with an answer whose measure is known."""
    return answered(jobs[jobs[measure] > 0] if measure in jobs else jobs[:0])


def _of_bases(jobs: _Jobs, curve: Lognormal) -> dict[str, Any]:
    """What the motions that a rock survived say about its base, and the resulting shift of the median."""
    assert jobs.stood is not None
    told = told_of(jobs.stood, jobs.frame)
    alike = fit(_heard(unweighed(jobs.frame), curve.measure), [curve.measure]).lognormal
    (of_contact,) = told.pop("contacts")
    return {
        **told,
        **of_contact,
        "median_bases_alike": None if alike is None else alike.median,
        "median_shift_percent": None if alike is None else 100.0 * (curve.median / alike.median - 1.0),
    }


def _words(told: dict) -> str:
    unit, measure = describe(SCHEMA.field(told["measure"]))["unit"], short_name(told["measure"])
    stood = "the rock has stood" if len(told["rocks"]) == 1 else "the rocks have stood"
    lines = [
        f"{rock['name']}: median {rock['median']:.3g} {unit}, beta {rock['beta']:.2f}"
        for rock in told["rocks"]
    ]
    lines.append(
        f"At {100 * told['confidence']:g} % confidence no single event has exceeded a {measure} of "
        f"{told['unexceeded']:.3g} {unit} while {stood}."
    )
    if told["unexceeded_low"] is None:
        lines.append(
            "  its uncertainty from the choice of records is unknown: this needs a run with enough records"
        )
    else:
        high = told["unexceeded_high"]
        ends = (
            f"{told['unexceeded_low']:.3g} {f'{unit} or more' if high is None else f'to {high:.3g} {unit}'}"
        )
        unfit = max(rock["samples_without_fit"] for rock in told["rocks"])
        bare = f"; {unfit} of {SAMPLES} bootstrap samples have no fit and count as unbounded" if unfit else ""
        lines.append(
            f"  {ends} with other records like these (95 %{bare}), as the jobs come from few earthquakes"
        )
    for rock in told.get("stood", ()):
        lines += [f"  {sentence}" for sentence in sentences({**rock, "contacts": [rock]})]
        if rock["median_shift_percent"]:
            lines.append(
                f"  with equal weights the median of {rock['rock']} would be {rock['median_bases_alike']:.3g} "
                f"{unit}: the weights shift it by {rock['median_shift_percent']:+.1f} %"
            )
    for rock in told["rocks"]:
        if rock.get("without_answer"):
            jobs = rock["without_answer"] + rock["jobs"]
            lines.append(
                f"  {rock['without_answer']:,} of {jobs:,} jobs of {rock['name']} have no answer and are left out: "
                "jobs near the threshold rock longest and most often lack one"
            )
        if "strongest_shaken" not in rock:
            lines.append(
                f"  the jobs behind the curve of {rock['name']} are unknown, so this may be an extrapolation"
            )
        elif told["unexceeded"] > rock["strongest_shaken"]:
            seen = f"{rock['toppled']} toppled of {rock['jobs']} jobs, {rock['records']} records"
            lines.append(
                f"  this extrapolates beyond the strongest shaking of {rock['name']}, "
                f"{rock['strongest_shaken']:.3g} {unit} ({seen})"
            )
    if told.get("ages_independent"):
        lines.append(
            "The ages of the rocks are taken as independent, as if each rock had been dated separately."
        )
    if told.get("hazard_ratio") == 1.0:
        lines.append(
            "The hazard is taken to be for the peak of the horizontal vector (SA: the largest of all azimuths); "
            "give --ratio if it is for another component."
        )
    for branch in told.get("branches", ()):
        verdict = "rejected" if branch["rejected"] else "kept"
        lines.append(
            f"{branch['branch']}: topples at {branch['toppling_rate']:.2e} a year, "
            f"survival {branch['survival']:.3g}, {verdict}; "
            + (
                "the rocks survive under no branch"
                if branch["posterior_weight"] is None
                else f"weight {branch['prior_weight']:.3g} becomes {branch['posterior_weight']:.3g}"
            )
        )
        lines += _over_records(branch, 1.0 - told["confidence"])
        if "site_longitude_deg" in branch:
            away = branch.get("site_distance_km")
            lines.append(
                f"  taken at longitude {branch['site_longitude_deg']:g}, latitude {branch['site_latitude_deg']:g}"
                + ("" if away is None else f", {away:.1f} km from --site")
            )
        lines += _outside(branch, 1.0 - told["confidence"])
    branches = told.get("branches", ())
    if branches and all(branch["rejected"] for branch in branches):
        ranked = branches[0]["posterior_weight"] is not None
        lines.append("Every branch is rejected" + (": the weights only rank them." if ranked else "."))
    rejected = told.get("rejected", ())
    lines += [
        f"a {measure} of {row[told['measure']]:.3g} {unit} or more is rejected at return periods below "
        f"{row['rejected_return_years']:,.0f} years"
        for row in rejected[9::10]
    ]
    return "\n".join(lines)


def _over_records(branch: dict, least: float) -> list[str]:
    """State the interval of a branch's survival over records, and whether the verdict depends on them."""
    low, high = branch["survival_low"], branch["survival_high"]
    if low is None:
        return []
    hangs = "; the verdict depends on them" if low < least <= high else ""
    return [f"  survival {low:.3g} to {high:.3g} with other records like these (95 %){hangs}"]


def _outside(branch: dict, least: float) -> list[str]:
    """State the rate that may lie outside a hazard curve's points, and whether the verdict depends on it."""
    shares = {
        "beyond the curve's last point": branch["unstated_above"],
        "below its first point, if its initial slope continues": branch["unstated_below"],
    }
    lines = [
        f"  {100 * share:.0f} % of its toppling rate may lie {where}: not counted"
        for where, share in shares.items()
        if share > 0.01
    ]
    if branch["survival_least"] < least <= branch["survival"]:
        lines.append(
            f"  including it, survival would be {branch['survival_least']:.3g} and the branch rejected: give a curve "
            "that extends further"
        )
    return lines
