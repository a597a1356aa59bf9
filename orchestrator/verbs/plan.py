"""`toppling plan`: expand a campaign to its jobs without running any."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from toppling.models.files.folder import new_file
from toppling.orchestrator.verbs.shared_options import FILE, json_option, option, workers_option

if TYPE_CHECKING:
    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.plan import Plan


@click.command()
@click.argument("campaign", type=FILE)
@option("--out", "table", type=FILE, help="Write the job table (Parquet).")
@workers_option("Local workers assumed for the time estimate.")
@option("--no-estimate", is_flag=True, help="Do not estimate the time.")
@json_option("Print the counts as JSON.")
def plan(campaign: Path, table: Path | None, workers: int | None, no_estimate: bool, as_json: bool) -> None:
    """Check CAMPAIGN against its scene and ensemble and count its jobs, without running any.

    It warns of probable mistakes: levels in g, friction in degrees, levels that topple nothing, records scaled more
    than a hundredfold, shaking beyond what was ever recorded. It runs and times a few of the jobs to estimate the
    total time.

    \b
    toppling plan campaign.toml --out jobs.parquet
    """
    from toppling.orchestrator.campaign import Campaign

    chosen = Campaign.read(campaign)  # one that is refused is refused before the others are imported

    if chosen.sites:
        _plan_atlas(chosen, table, workers, estimated=not no_estimate, as_json=as_json)
        return
    from toppling.models.contact import ContactProperties
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.scene import Scene
    from toppling.orchestrator.estimate import estimate, words_of
    from toppling.orchestrator.progress import bar
    from toppling.orchestrator.public.running import plan as expand
    from toppling.orchestrator.settling_notes import settling_notes

    with bar("letting the rock stand, counting jobs"):
        found = expand(chosen)
    planned, warnings = found.plan, found.warnings
    scene, ensemble = Scene.load(chosen.scene), Ensemble.load(chosen.ensemble)
    with bar("timing a few jobs"):
        expected = None if no_estimate else estimate(planned, scene, ensemble)
    counts = {
        "jobs": len(planned), "records": len(planned.scenes[0].record_sha), "levels": max(len(chosen.pga_m_s2), 1),
        "azimuths": max(len(chosen.azimuth_deg), 1), "frictions": len(chosen.friction),
        "restitutions": len(chosen.restitution), "realisations": chosen.realisations, "preset": chosen.preset,
        "engine": chosen.engine,
        "scene_id": planned.scene_id, "ensemble_id": planned.ensemble_id, "plan_id": planned.id,
        "settling": found.settling and found.settling.to_json(), "ground": scene.ground.sentence, "warnings": warnings,
        "expected_work_s": expected and round(expected.work_s, 1), "timed_jobs": expected.timed if expected else 0,
    }  # fmt: skip
    _write(planned, table)
    if as_json:
        click.echo(json.dumps(counts))
        return
    click.echo(
        "{jobs} jobs = {records} records x {levels} levels x {azimuths} azimuths x {frictions} frictions x "
        "{restitutions} restitutions x {realisations} realisations, engine {engine}, preset {preset}".format(
            **counts
        )
    )
    if not no_estimate:
        click.echo(words_of(expected, len(planned), workers))
    for sentence in settling_notes(scene.with_contact(ContactProperties.of(chosen.friction[0]))):
        click.echo(sentence)
    for sentence in warnings:
        click.echo(f"warning: {sentence}", err=True)
    click.echo(f"scene {planned.scene_id}, ensemble {planned.ensemble_id}, plan {planned.id}")


def _write(planned: "Plan", table: Path | None) -> None:
    import pyarrow.parquet as pq

    if table is not None:
        with new_file(table) as hidden:
            pq.write_table(planned.jobs, hidden, compression="zstd")


def _plan_atlas(
    chosen: "Campaign", table: Path | None, workers: int | None, *, estimated: bool, as_json: bool
) -> None:
    """Count the jobs of many rocks, and name those that do not stand."""
    from toppling.orchestrator.estimate import estimate_atlas, words_of
    from toppling.orchestrator.plan import plan_of
    from toppling.orchestrator.progress import bar
    from toppling.orchestrator.rocks_of_run import scene_entries, settlings_of

    with bar("letting the rocks stand, counting jobs"):
        planned = plan_of(chosen)
        entries = scene_entries(planned, settlings_of(planned))
    with bar("timing a few jobs"):
        expected = estimate_atlas(planned) if estimated else None
    for one, scene in zip(entries["scenes"], planned.scenes, strict=True):
        one["records"] = len(scene.record_sha)
    counts = {"jobs": len(planned), "rocks": len(planned.scenes), "plan_id": planned.id, **entries}
    counts |= {"preset": chosen.preset, "engine": chosen.engine}
    counts |= {"expected_work_s": expected and round(expected.work_s, 1)}
    _write(planned, table)
    if as_json:
        click.echo(json.dumps(counts))
        return
    click.echo(
        f"{len(planned)} jobs of {len(planned.scenes)} rocks, engine {chosen.engine}, preset {chosen.preset}"
    )
    for one in entries["scenes"]:
        location = "" if one["longitude"] is None else f" ({one['longitude']:.4f}, {one['latitude']:.4f})"
        click.echo(
            f"  {one['rock']}, {one['site']}{location}: {one['jobs']} jobs with {one['records']} records"
        )
    if estimated:
        click.echo(words_of(expected, len(planned), workers))
    for one in entries["scenes"]:
        if one["problem"]:
            click.echo(f"warning: {one['rock']}: {one['problem']}", err=True)
    for one in entries["left_out"]:
        click.echo(f"warning: {one['rock']} is left out: {one['why']}", err=True)
