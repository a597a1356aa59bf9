"""`toppling scan`: clouds of laser points to a scene."""

import json
from pathlib import Path

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

STAGES = 6


@click.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--out", required=True, type=click.Path(path_type=Path), help="Folder of the scene; must not exist."
)
@click.option(
    "--near",
    type=float,
    nargs=2,
    metavar="X Y",
    help="Survey coordinates near the rock's top, where several stand.",
)
@click.option("--json", "as_json", is_flag=True, help="Print scene.json's content.")
def scan(files: tuple[Path, ...], out: Path, near: tuple[float, float] | None, as_json: bool) -> None:
    """Turn laser scans into a rock on its pedestal.

    FILES are stations of one survey: LAZ, LAS, PLY, PCD, XYZ, PTS, CSV or E57, in metres, z up.

    \b
    toppling scan station1.laz station2.laz --out scenes/rock
    """  # noqa: D301  (\b keeps click from rewrapping the example)
    from models.scan.read import read_clouds
    from models.scan.survey import save_survey, survey

    if out.exists():
        raise FileExistsError(f"{out} exists already: choose another name, or remove it first")
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("reading", total=STAGES)

        def stage(name: str) -> None:
            bar.update(task, advance=1, description=name)

        cloud = read_clouds(files)
        result = survey(cloud, stage, near)
        stage("writing")
        save_survey(result, out)
        bar.update(task, completed=STAGES, description="done")
    scene = result.scene
    if as_json:
        click.echo(json.dumps(scene.to_json()))
        return
    rock, pedestal = scene.rock, scene.pedestal
    click.echo(
        f"{out}: rock of {rock.volume_m3:.4g} m³, {rock.height_m:.3g} m high, on a pedestal that falls "
        f"{pedestal.slope_deg:.2f}° toward azimuth {pedestal.downhill_azimuth_deg:.1f}°; "
        f"see {out / 'scene.png'}"
    )
