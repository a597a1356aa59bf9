"""`toppling ramp`: the shake-table protocol of the study's figure 4 on any rock."""

import math
from pathlib import Path
from typing import Any

import click
import pandas as pd

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.files.csv_text import write_csv
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.processes import pool_of
from toppling.orchestrator.progress import bar
from toppling.orchestrator.studies.ramp import Ramp, carry_out, chosen_waveforms, summary, weakest_azimuth_deg
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import of, option
from toppling.workers.seating import settled


@click.command()
@shared.scene_argument
@shared.ensemble_argument
@shared.folder_out
@option(
    "--records",
    help="Ids of the waveforms, separated by commas. Default: ten spread over PGV/PGA, or all if fewer.",
)  # fmt: skip
@option(
    "--azimuth", type=shared.AZIMUTH,
    help="Of the motion, degrees counter-clockwise from x, or a bearing such as N40E. Default: that at which the rock "
    "lifts first.",
)  # fmt: skip
@of(Ramp, "--start", "start_m_s2", type=shared.ABOVE_0)
@of(Ramp, "--step", "step_m_s2", type=shared.ABOVE_0)
@of(Ramp, "--end", "end_m_s2", type=shared.ABOVE_0)
@of(Ramp, "--peak-displacement", type=shared.ABOVE_0, parameter="peak_displacement_m")
@of(Ramp, "--friction", type=click.FloatRange(0))
@of(Ramp, "--restitution", type=click.FloatRange(0, 1))
@shared.preset_option
@option("--three-components", is_flag=True, help="Shake with all components, not only the stronger one.")
@shared.processes_option
def ramp(
    scene: Path,
    ensemble: Path,
    out: Path,
    records: str | None,
    azimuth: float | None,
    peak_displacement: float,
    friction: float,
    three_components: bool,
    workers: int,
    **asked: Any,
) -> None:
    """Shake the rock of SCENE with waveforms of ENSEMBLE, each scaled up step by step until it topples.

    This is the protocol of the study's figure 4 (rock K on a shaking table). It writes ramp.csv (the PGA that topples
    over PGV/PGA, averaged over the levels), levels.csv (every shake) and ramp.png, .svg. The same command resumes an
    interrupted ramp.

    \b
    toppling ramp scenes/rock ensembles/waveforms --out ramp
    """
    rock, motions = Scene.load(scene), Ensemble.load(ensemble)
    names = _named(records, motions) if records else chosen_waveforms(motions)
    protocol = Ramp(
        azimuth_deg=weakest_azimuth_deg(rock, friction) if azimuth is None else azimuth,
        peak_displacement_m=peak_displacement if math.isfinite(peak_displacement) else None,
        friction=friction, uniaxial=not three_components, **asked,
    )  # fmt: skip
    with bar("waveforms", len(names)) as advance, pool_of(workers) as pool:
        levels = carry_out(
            scene.absolute(),
            ensemble.absolute(),
            names,
            protocol,
            out / "waveforms",
            pool,
            lambda _: advance(),
        )
    for path in _write(rock, levels, protocol.azimuth_deg, friction, out):
        click.echo(path)


def _named(records: str, motions: Ensemble) -> list[str]:
    """Ids of records, separated by commas, which an ensemble has."""
    names = [name.strip() for name in records.split(",")]
    if unknown := [name for name in names if name not in set(motions.record_ids)]:
        raise InputError(
            f"no records {', '.join(unknown)}",
            where=str(motions.folder),
            expected=f"ids such as {', '.join(motions.record_ids[:5])}",
            remedy="'toppling records show' lists them",
        )
    return names


def _write(rock: Scene, levels: pd.DataFrame, azimuth_deg: float, friction: float, out: Path) -> list[Path]:
    """Write tables and figure of a ramp."""
    from toppling.results.drawing.study_figures import ramp_figure
    from toppling.results.drawing.style import save

    at_rest = settled(rock.with_contact(ContactProperties.of(friction)))
    ((_, static_m_s2),) = at_rest.quasi_static_toppling_m_s2([azimuth_deg])
    table = summary(levels)
    return [
        write_csv(table, out / "ramp.csv"),
        write_csv(levels, out / "levels.csv"),
        *save(ramp_figure(table, azimuth_deg, static_m_s2), out / "ramp"),
    ]
