"""`toppling scan`: from point clouds to a scene."""

import json
from pathlib import Path

import click

from toppling.models.errors import InputError
from toppling.models.lengths import METRES
from toppling.models.scene import Scene
from toppling.orchestrator.progress import bar
from toppling.orchestrator.public import REALISATIONS
from toppling.orchestrator.verbs.options import PATH, json_option

LEAST_REALISATIONS = 3
"""Fewer give no spread."""


def _enough(_: click.Context, __: click.Parameter, realisations: int) -> int:
    if 0 < realisations < LEAST_REALISATIONS:
        raise click.BadParameter(
            f"{realisations} give no spread: give 0 for none, or at least {LEAST_REALISATIONS}."
        )
    return realisations


@click.command()
@click.argument("files", nargs=-1, required=True, type=PATH)
@click.option("--out", required=True, type=PATH, help="Folder of the scene; must not exist.")
@click.option(
    "--units",
    type=click.Choice(list(METRES)),
    help="Unit of the coordinates; it wins over what the files say. Metres where neither says anything.",
)
@click.option(
    "--near",
    type=float,
    nargs=2,
    metavar="X Y",
    help="Survey coordinates near the top of your rock, where several rocks stand.",
)
@click.option(
    "--plane",
    type=float,
    nargs=5,
    metavar="X Y Z SLOPE AZIMUTH",
    help="The measured interface: one of its points, its slope and the azimuth of its dip, degrees from east to north.",
)
@click.option(
    "--point",
    "points",
    multiple=True,
    metavar="X,Y,Z",
    help="A place where rock and pedestal meet, in survey coordinates; give three or more.",
)
@click.option(
    "--outline",
    type=PATH,
    metavar="FILE",
    help="CSV of the contact's outline: x,y,z of one vertex per line, in order, in survey coordinates.",
)
@click.option(
    "--contact",
    type=PATH,
    metavar="FILE",
    help="CSV of places at the base: x,y,z,touch where rock and pedestal touch, x,y,z,daylight where light passes.",
)
@click.option(
    "--pull",
    "pulls",
    type=float,
    nargs=2,
    multiple=True,
    metavar="AZIMUTH RATIO",
    help="A pull or tilt test: the azimuth of the pull, 0 to 360 degrees counter-clockwise from east, and the largest "
    "force that the rock bore, over its weight.",
)
@click.option(
    "--bootstrap",
    type=click.IntRange(min=0),
    default=REALISATIONS,
    show_default=True,
    callback=_enough,
    help=f"Half samples for the uncertainty, at least {LEAST_REALISATIONS}; 0 for none.",
)
@json_option("Print the content of scene.json.")
def scan(
    files: tuple[Path, ...],
    out: Path,
    units: str | None,
    near: tuple[float, float] | None,
    plane: tuple[float, ...] | None,
    points: tuple[str, ...],
    outline: Path | None,
    contact: Path | None,
    pulls: tuple[tuple[float, float], ...],
    bootstrap: int,
    as_json: bool,
) -> None:
    """Turn laser scans into a rock on its pedestal.

    FILES are stations of one survey: LAZ, LAS, PLY, PCD, XYZ, PTS, TXT, CSV or E57, z up, in the unit that they state,
    or in metres. Rock and pedestal are separated automatically; if you know better where they meet, use --plane,
    --point or --outline.

    No laser sees the base of the rock. The command draws bases that are consistent with the scan and on which the rock
    stands as scanned, and keeps them in the scene. --contact, --pull and --outline narrow them down.

    \b
    toppling scan station1.laz station2.laz --out scenes/rock
    toppling scan cloud.e57 --out scenes/rock --point 331250.1,3777309.2,480.3 \\
        --point 331251.0,3777310.4,480.2 --point 331249.4,3777310.8,480.4
    toppling scan cloud.e57 --out scenes/rock --contact looked.csv --pull 135 0.32
    """
    from toppling.models.scan.survey import STAGES
    from toppling.orchestrator.public.making import scan as scanned

    with bar("scan", STAGES + bootstrap + 3) as advance:
        made = scanned(
            files, out, units=units, near=near, plane=plane, points=[_coordinates(point) for point in points],
            outline=outline, contact=contact, pulls=pulls, bootstrap=bootstrap, advance=advance,
        )  # fmt: skip
    click.echo(json.dumps(made.scene.to_json(), allow_nan=False) if as_json else _told(made.scene, out))
    for note in made.notes:
        click.echo(note, err=as_json)


def _told(scene: Scene, out: Path) -> str:
    """Say what the scan found in one line."""
    rock, pedestal = scene.rock, scene.pedestal
    return (
        f"{out}: rock of {rock.volume_m3:.4g} m³, {rock.height_m:.3g} m high, on a pedestal that dips "
        f"{pedestal.slope_deg:.2f}° toward azimuth {pedestal.downhill_azimuth_deg:.1f}°; "
        f"see {out / 'scene.png'}"
    )


def _coordinates(text: str) -> tuple[float, ...]:
    try:
        x, y, z = (float(word) for word in text.replace(",", " ").split())
    except ValueError:
        raise InputError(
            f"'{text}' is not a place",
            where="--point",
            expected="three numbers: x,y,z in survey coordinates",
            remedy="write it like --point 331250.1,3777309.2,480.3",
        ) from None
    return x, y, z
