"""`toppling pulse`: the response of a rock to an idealised pulse, as in the study's figure 8."""

from pathlib import Path

import click

from toppling.models.files.folder import rock_name
from toppling.models.motions import idealised
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.orchestrator.misspelt import OneOf
from toppling.orchestrator.progress import bar
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.replay import replay_of, write_out
from toppling.orchestrator.verbs.shared_options import option
from toppling.results.analysis.friction_comparison import friction_words

_SHAPES = ("sawtooth", "sine", "cosine", "ricker")


@click.command()
@shared.scene_argument
@shared.folder_out
@option(
    "--shape", type=OneOf(list(_SHAPES)), default="sawtooth",
    help="Sawtooth of velocity; sine, cosine or Ricker wavelet of acceleration.",
)  # fmt: skip
@option("--pgv", "pgv_m_s", type=click.FloatRange(0, 100, min_open=True), default=5.0, help="m/s")
@option("--period", "period_s", type=click.FloatRange(0.02, 100), default=3.5, help="s")
@option(
    "--azimuth", type=shared.AZIMUTH, default=0.0,
    help="Direction in which the ground moves first (Ricker: accelerates most), degrees counter-clockwise from east, "
    "or a bearing such as N40E.",
)  # fmt: skip
@option("--friction", type=click.FloatRange(0, min_open=True), help="Default: the scene's own.")
@shared.preset_option
def pulse(
    scene: Path,
    out: Path,
    shape: str,
    pgv_m_s: float,
    period_s: float,
    azimuth: float,
    friction: float | None,
    preset: str,
) -> None:
    """Shake the rock of SCENE with one pulse of velocity and show how it moves.

    It writes the files of 'toppling replay': table, plots, an interactive page that plays the motion, and a GIF. The
    defaults are the pulse of the study's figure 8.

    \b
    toppling pulse scenes/rock --azimuth 135 --out pulse
    """
    loaded = Scene.load(scene)
    if friction is not None:
        loaded = loaded.with_friction(friction)
    motion = _pulse_motion(shape, pgv_m_s, period_s, azimuth)
    with bar("shaking"):
        shown, result = replay_of(loaded, motion, preset)
    friction_text = friction_words(loaded.contact.friction_static, loaded.contact.friction_kinetic)
    title = (
        f"{rock_name(scene)}: {shape}, PGV {pgv_m_s:g} m/s, period {period_s:g} s, azimuth {azimuth:g}°, "
        f"friction {friction_text}: {result.outcome or result.status}"
    )
    write_out(shown, out, title)
    click.echo(title)


def _pulse_motion(shape: str, pgv_m_s: float, period_s: float, azimuth_deg: float) -> Motion:
    """Idealised motion of a shape, scaled to its peak velocity."""
    if shape == "sawtooth":
        return idealised.sawtooth_velocity(pgv_m_s, period_s, azimuth_deg)
    shapes = {"sine": idealised.full_sine, "cosine": idealised.full_cosine, "ricker": idealised.ricker}
    unit = shapes[shape](1.0, period_s, azimuth_deg)
    reached = float((unit.velocity_at(unit.time_s)[:, :2] ** 2).sum(axis=1).max() ** 0.5)
    return shapes[shape](pgv_m_s / reached, period_s, azimuth_deg)
