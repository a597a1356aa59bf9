"""Standing rocks given as runs or as files of fragility curves."""

import os
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import pandas as pd

from toppling.models.errors import InputError
from toppling.models.motions.measures import COMPARED
from toppling.models.scene import Scene
from toppling.orchestrator.recorded import Recorded, check_weighable
from toppling.results.analysis.exchange import read_curves
from toppling.results.analysis.fits import answered, curve_over, with_measure
from toppling.results.analysis.fragility import by_contact
from toppling.results.analysis.lognormal import Basis, Lognormal, fit
from toppling.results.analysis.resampling import SAMPLES, narrowed_by
from toppling.results.hazard.events import Standing
from toppling.results.hazard.places import SITE_REACH_KM, distance_km
from toppling.results.hazard.tree import HazardTree
from toppling.results.reader import Completeness, open_run
from toppling.results.weights import CONTACT, Weights, unweighted_rows


@dataclass(frozen=True, eq=False)
class Jobs:
    """Weighted jobs of one contact of a run, and the weights of their bases."""

    frame: pd.DataFrame
    weights: Weights | None
    completeness: Completeness
    scan: dict[str, Any]  # report of the scan of the rock


def of_atlases(
    rocks: tuple[Path, ...], ages: tuple[str, ...], asked: str | None
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Replace atlases by their rocks; ages are those given, or else those of the atlas if all rocks have one."""
    measure = "pgv_m_s" if asked is None or "+" in asked else asked
    found: list[tuple[Path, str | None]] = []
    for path in rocks:
        of_atlas = open_run(path).rocks if path.is_dir() else ()
        for rock in of_atlas:
            known = with_measure(rock.frame(), measure)
            if len(known) and fit(known, [measure]).lognormal:
                found.append((rock.path, rock.entry["age"]))
            else:
                few = f"no fragility over {measure}, as {known['toppled'].sum()} of {len(known)} jobs toppled it"
                why = rock.entry["problem"] or few
                click.echo(f"{rock.rock} is left out: {why}", err=True)
        if not of_atlas:
            found.append((path, None))
    stated = tuple(age for _, age in found if age is not None)
    if not ages and 0 < len(stated) < len(found):
        undated = ", ".join(path.name for path, age in found if age is None)
        click.echo(f"ages are left out: the atlas has none of {undated}; --age states one of each", err=True)
    return tuple(path for path, _ in found), ages or (stated if len(stated) == len(found) else ())


def apart_km(paths: Sequence[Path], hazard: HazardTree | None) -> float:
    """Largest distance between rocks whose locations are known from an atlas, km; 0 if unknown.

    Raises InputError if there is a hazard (of a single site), and rocks or its site are farther apart than the reach
    of a site.
    """
    entries = [(str(path), open_run(path).entry) for path in paths if path.is_dir()]
    places = {
        name: (float(entry["longitude"]), float(entry["latitude"]))
        for name, entry in entries
        if entry.get("longitude") is not None and entry.get("latitude") is not None
    }
    pairs = [(rock, other, places[rock], places[other]) for rock, other in combinations(places, 2)]
    if hazard and hazard.site:
        pairs += [(name, "the hazard's site", place, hazard.site) for name, place in places.items()]
    far = [(float(distance_km(*here, there)), rock, other) for rock, other, here, there in pairs]
    widest, first, other = max(far, default=(0.0, "", ""))
    if hazard and widest > SITE_REACH_KM:
        raise InputError(
            "site.far_apart",
            f"{first} and {other} lie {widest:,.0f} km apart",
            where="--hazard",
            expected=f"rocks and curves of one site, within {SITE_REACH_KM:g} km, which feel the same events",
            remedy="constrain each rock by its folder with its own hazard, or give a set of events",
        )
    return max((km for km, _, name in far if name in places), default=0.0)


def common_measures(rocks: Sequence[Path]) -> list[str]:
    """Measures for which all files of curves have a fragility; a run may have all of `COMPARED`."""
    stated = [[*read_curves(path)] if not path.is_dir() else [*COMPARED] for path in rocks]
    ordered = dict.fromkeys([*COMPARED, *stated[0]])
    return [name for name in ordered if all(name in names for names in stated)]


def standing_rock(
    name: str, path: Path, measure: str, jobs: Jobs | None, advance: Callable[[], None]
) -> Standing:
    """Standing rock with the fragility from a run or a file, and bootstrap samples where available."""
    if jobs is None:
        curve = read_curves(path).get(measure)
    else:
        curve = curve_over(jobs.frame, measure, SAMPLES, jobs.completeness, advance)
    if curve is None:
        no_answer = jobs is not None and answered(jobs.frame).empty
        known = with_measure(jobs.frame, measure) if jobs is not None else ()
        why = f": {fit(known, [measure]).problem}" if len(known) else ""
        raise InputError(
            "run.no_answers" if no_answer else "fragility.none",
            what="has no job with an answer" if no_answer else f"has no fragility over {measure}{why}",
            where=str(path),
            expected="a lognormal fragility over the measure of the hazard",
            remedy="'toppling fragility RUN --fit' lists the measures that have one",
        )
    return Standing(name, curve, narrowed_by=narrowed_by(curve.interval_parts, jobs.scan) if jobs else "")


def read_jobs(path: Path, where: str | None, trusted: bool, recorded: Recorded | None) -> Jobs:
    """Selected jobs of a run, with the weights of their records and bases."""
    run = open_run(path).single()
    weights = run.weights()
    bare = run.frame(where, trusted=trusted)
    jobs = run.weighted(bare, weights)
    if where and jobs.empty:
        raise InputError(
            "run.no_job_left",
            what=f"no job satisfies {where}",
            where=str(path),
            expected="a condition that some jobs satisfy",
            remedy="'toppling query RUN --describe' names columns and units",
        )
    contacts = by_contact(answered(jobs))
    if len(contacts) > 1:
        raise InputError(
            "run.several_contacts",
            what=f"has {len(contacts)} contacts: {', '.join(contacts)}",
            where=str(path),
            expected="jobs of one contact",
            remedy='choose one, such as --where "friction_static = 0.8"',
        )
    if recorded:
        weights = _weighed(path, bare, recorded, weights)
        jobs = run.weighted(bare, weights)
    return Jobs(jobs, weights, run.completeness(), run.scene_report())


def _weighed(path: Path, jobs: pd.DataFrame, recorded: Recorded, own: Weights | None) -> Weights:
    """Weights of a run's bases updated by further survived motions; the shakes are not stored."""
    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.cluster import local
    from toppling.orchestrator.run import run as shaken
    from toppling.orchestrator.studies.conditioning import joined, refuse_counted, weigh, weighing
    from toppling.orchestrator.terminal import watcher

    if own:
        refuse_counted(own, recorded)
    run = open_run(path)
    campaign = Campaign.read(run.root / "campaign.toml")
    if campaign.sites:
        campaign = campaign.of_site(next(site for site in campaign.sites if site.rock == run.rock))
    scene = Scene.load(campaign.scene)
    check_weighable(scene, jobs["base"].nunique(), str(path))
    (contact,) = jobs[CONTACT].drop_duplicates().itertuples(index=False, name=None)
    of_contact = replace(campaign, friction=(contact[:2],), restitution=(contact[2],))
    with TemporaryDirectory(prefix="toppling-stood-") as place:
        recorded.write(Path(place))
        with watcher() as watch, local(os.cpu_count() or 1) as client:
            shake = partial(shaken, cluster=nullcontext(client), watch=weighing(watch))
            also = weigh(of_contact, recorded, Path(place), shake)
    return joined(own, also) if own else also


def of_bases(jobs: Jobs, curve: Lognormal) -> dict[str, Any]:
    """Summary of a rock's base weights from survived motions, and the resulting shift of the median."""
    assert jobs.weights is not None
    summary = jobs.weights.summary(jobs.frame)
    alike = fit(with_measure(unweighted_rows(jobs.frame), curve.measure), [curve.measure]).lognormal
    (of_contact,) = summary.pop("contacts")
    return {
        **summary,
        **of_contact,
        "median_bases_alike": None if alike is None else alike.median,
        "median_shift_percent": None if alike is None else 100.0 * (curve.median / alike.median - 1.0),
    }


def refuse_twins(rocks: tuple[Path, ...], rested: Sequence[Basis | None]) -> None:
    """Refuse duplicate rocks, identified by the scene's hash or else the file."""
    seen: dict[str, Path] = {}
    for path, basis in zip(rocks, rested, strict=True):
        of = basis.scene_id if basis else str(path.resolve())
        if of in seen:
            raise InputError(
                "rock.given_twice",
                what=f"is the same rock as {seen[of]}" + (f" (scene {of})" if basis else ""),
                where=str(path),
                expected="each rock once",
                remedy="leave one of the two out",
            )
        seen[of] = path


def names_of(rocks: tuple[Path, ...]) -> list[str]:
    """Names of rocks: those of runs, stems of files, or the whole paths if these are not distinct."""
    stems = [open_run(path).rock if path.is_dir() else path.stem for path in rocks]
    return stems if len(set(stems)) == len(stems) else [str(path) for path in rocks]
