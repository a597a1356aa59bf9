"""`toppling init`: a campaign file that suits a rock and its records."""

import os
from pathlib import Path

import click

from toppling.models.files.folder import new_file, refuse_existing
from toppling.orchestrator.verbs.options import (
    FILE,
    ensemble_argument,
    option,
    preset_option,
    scene_argument,
    workers_option,
)


@click.command()
@scene_argument
@ensemble_argument
@option("--out", type=FILE, default=Path("campaign.toml"), help="File to write; must not exist.")
@option(
    "--friction", "frictions", type=click.FloatRange(0, 1.5, min_open=True), multiple=True,
    help="Repeatable. Default: the scene's own.",
)  # fmt: skip
@option("--levels", type=click.IntRange(2), default=12, help="Approximate number of PGA levels.")
@option("--azimuths", type=click.IntRange(1, 360), default=8, help="Number of evenly spaced azimuths.")
@preset_option
@workers_option("Local workers assumed for the time estimate.")
def init(
    scene: Path,
    ensemble: Path,
    out: Path,
    frictions: tuple[float, ...],
    levels: int,
    azimuths: int,
    preset: str,
    workers: int | None,
) -> None:
    """Write a campaign for SCENE and ENSEMBLE: levels, azimuths and frictions that suit the rock.

    Levels range from below the least constant acceleration that topples the rock to the level at which most records
    topple it. To find that level, and the time per job, the rock is shaken in trials with up to ten records at
    increasing levels, which takes seconds to a minute. The file explains every value.

    \b
    toppling init scenes/rock ensembles/quakes --out campaign.toml
    """
    from toppling.models.contact import ContactProperties
    from toppling.models.motions.ensemble import Ensemble
    from toppling.models.scene import Scene
    from toppling.orchestrator.campaign import Campaign
    from toppling.orchestrator.campaign_template import CampaignTemplate, even_azimuths_deg, levels_between
    from toppling.orchestrator.pilot import RECORDS, levels_to_try, statics_of, try_out
    from toppling.orchestrator.progress import bar, duration
    from toppling.orchestrator.stands import Settlings

    refuse_existing(out)
    rock, motions = Scene.load(scene), Ensemble.load(ensemble)
    frictions = frictions or (rock.contact.friction_static,)
    turned = even_azimuths_deg(azimuths)
    axes = {"pga_m_s2": [1.0], "azimuth_deg": turned, "friction": list(frictions), "preset": preset}
    chosen = Campaign.of({"scene": str(scene), "ensemble": str(ensemble), **axes}, Path())
    with bar("letting the rock stand"):
        Settlings.of(chosen, rock).checked()
        contact = ContactProperties.of(max(frictions))
        statics = statics_of(rock.with_contact(contact))
    _check_least(statics.least_m_s2, scene)
    most = min(RECORDS, len(motions.record_ids)) * len(levels_to_try(statics.least_m_s2))
    with bar("shaking on trial", most) as advance:
        friction = contact.friction_static, contact.friction_kinetic
        pilot = try_out(rock, motions, statics.least_m_s2, turned, friction, preset, advance)
    spaced = levels_between(statics.least_m_s2, pilot.most_at_m_s2, levels)
    records, workers = len(motions.record_ids), workers or os.cpu_count() or 1
    folder = out.absolute().parent
    starter = CampaignTemplate(
        name=str(out), scene=os.path.relpath(scene.absolute(), folder),
        ensemble=os.path.relpath(ensemble.absolute(), folder), records=records, statics=statics, pilot=pilot,
        levels=spaced, azimuths_deg=turned, frictions=frictions, preset=preset, workers=workers,
        bases=0 if rock.unseen is None else len(rock.unseen),
    )  # fmt: skip
    with new_file(out) as hidden:
        hidden.write_text(starter.text(), encoding="utf-8")
    jobs = records * len(spaced) * len(turned) * len(frictions)
    click.echo(
        f"{out}: {jobs} jobs, levels {spaced.start_m_s2:g} to {spaced.stop_m_s2:g} m/s2, "
        f"about {duration(jobs * pilot.job_s / workers)} on {workers} workers"
    )
    click.echo(f"next: toppling plan {out}")


def _check_least(least_m_s2: float, scene: Path) -> None:
    from toppling.models.errors import InputError
    from toppling.orchestrator.campaign import LARGEST_PGA_M_S2

    if not 0.0 < least_m_s2 < LARGEST_PGA_M_S2:
        raise InputError(
            f"the least constant acceleration that topples the rock is {least_m_s2:.3g} m/s2",
            where=str(scene),
            expected=f"one above 0 and below {LARGEST_PGA_M_S2:g} m/s2",
            remedy="check in the scene's picture that rock and pedestal are separated correctly",
        )
