"""`toppling plan`: expand a campaign to its jobs without running any."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from toppling.models.errors import counted
from toppling.models.files.folder import new_file
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option

if TYPE_CHECKING:
    from toppling.orchestrator.public.running import Planned


@click.command()
@click.argument("campaign", type=shared.FILE)
@option("--out", "table", type=shared.FILE, help="Write the job table (Parquet).")
@option("--no-estimate", is_flag=True, help="Do not estimate the time.")
@shared.json_option("Print the counts as JSON.")
def plan(campaign: Path, table: Path | None, no_estimate: bool, as_json: bool) -> None:
    """Check CAMPAIGN against its scene and ensemble and count its jobs, without running any.

    It warns of probable mistakes: levels in g, friction in degrees, levels that topple nothing, records scaled more
    than a hundredfold, shaking beyond what was ever recorded. It runs and times a few of the jobs to estimate the
    total time.

    \b
    toppling plan campaign.toml --out jobs.parquet
    """
    from toppling.orchestrator.campaign import Campaign

    chosen = Campaign.read(campaign)  # an invalid campaign is refused before slow imports
    from toppling.orchestrator.advice import estimate, words_of
    from toppling.orchestrator.public.running import plan as expand
    from toppling.orchestrator.terminal import bar

    shared.compile_first()
    with bar("letting rocks stand, counting jobs"):
        found = expand(chosen)
    planned = found.plan
    with bar("timing a few jobs"):
        expected = None if no_estimate else estimate(planned)
    counts = {
        "jobs": len(planned), "plan_id": planned.id, "preset": chosen.preset, "engine": chosen.engine,
        "expected_work_s": expected and round(expected.work_s, 1),
    }  # fmt: skip
    head, notes = _of_many(found, counts) if chosen.sites else _of_rock(found, counts)
    counts["timed_jobs"] = expected.timed if expected else 0
    if table is not None:
        import pyarrow.parquet as pq

        with new_file(table) as hidden:
            pq.write_table(planned.jobs, hidden, compression="zstd")
    if as_json:
        click.echo(json.dumps(counts))
        return
    for line in [*head, *([] if no_estimate else [words_of(expected, len(planned))]), *notes]:
        click.echo(line)
    for sentence in found.warnings:
        click.echo(f"warning: {sentence}", err=True)


def _of_rock(found: "Planned", counts: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Printed lines for one rock, before and after the time estimate; adds to `counts`."""
    from toppling.models.pedestal import ContactProperties
    from toppling.orchestrator.rocks_of_run import settling_notes

    chosen, planned, scene = found.campaign, found.plan, found.scene
    assert scene is not None
    counts |= {
        "records": len(planned.scenes[0].record_sha), "levels": max(len(chosen.pga_m_s2), 1),
        "azimuths": max(len(chosen.azimuth_deg), 1), "frictions": len(chosen.friction),
        "restitutions": len(chosen.restitution), "realisations": chosen.realisations,
        "scene_id": planned.scene_id, "ensemble_id": planned.ensemble_id,
        "settling": found.settling and found.settling.to_json(), "ground": scene.ground.sentence,
        "warnings": found.warnings,
    }  # fmt: skip
    axes = ("records", "levels", "azimuths", "frictions", "restitutions")
    product = " x ".join(counted(counts[name], name.removesuffix("s")) for name in axes)
    if chosen.realisations > 1:
        product += f", spread over {chosen.realisations} realisations"
    head = f"{counted(counts['jobs'], 'job')} = {product}, engine {chosen.engine}, preset {chosen.preset}"
    return [head], settling_notes(scene.with_contact(ContactProperties.of(chosen.friction[0])))


def _of_many(found: "Planned", counts: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Printed lines for an atlas, before and after the time estimate; adds to `counts`."""
    counts |= {"rocks": len(found.plan.scenes), **found.rocks}
    head = [
        f"{counted(counts['jobs'], 'job')} of {counted(counts['rocks'], 'rock')}, "
        "engine {engine}, preset {preset}".format(**counts)
    ]
    for entry, scene in zip(counts["scenes"], found.plan.scenes, strict=True):
        entry["records"] = len(scene.record_sha)
        location = (
            "" if entry["longitude"] is None else f" ({entry['longitude']:.4f}, {entry['latitude']:.4f})"
        )
        jobs, records = counted(entry["jobs"], "job"), counted(entry["records"], "record")
        head.append(f"  {entry['rock']}, {entry['site']}{location}: {jobs} with {records}")
    return head, []
