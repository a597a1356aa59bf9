"""`toppling scene`: look at a scene, hand it to other programs."""

from pathlib import Path

import click

from toppling.models.scene import Scene


@click.group()
def scene() -> None:
    """Show a scene or export it.

    \b
    toppling scene show scenes/rock
    toppling scene export scenes/rock rock.glb
    """  # noqa: D301  (\b keeps click from rewrapping the example)


@scene.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Where to write; the scene's folder by default.")
def show(folder: Path, out: Path | None) -> None:
    """Write a picture (scene.png) and a page that turns with the mouse (scene.html).

    \b
    toppling scene show scenes/rock --out pictures
    """  # noqa: D301  (\b keeps click from rewrapping the example)
    from toppling.models.intervals import base_sentences
    from toppling.orchestrator.plan import settling_notes
    from toppling.results.drawing.page import write_scene_page
    from toppling.results.drawing.scene import draw_scene
    from toppling.results.run import rock_name

    loaded = Scene.load(folder)
    target = out or folder
    target.mkdir(parents=True, exist_ok=True)
    notes = settling_notes(loaded)
    draw_scene(loaded, target / "scene.png", notes)
    write_scene_page(loaded, target / "scene.html", rock_name(folder), [*notes, *base_sentences(loaded)])
    click.echo(
        "\n".join([str(target / "scene.png"), str(target / "scene.html"), *notes, *base_sentences(loaded)])
    )


@scene.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.argument("file", type=click.Path(path_type=Path))
def export(folder: Path, file: Path) -> None:
    """Write rock and pedestal as one file: .glb or .gltf (y up, as glTF prescribes), .ply or .obj (z up).

    \b
    toppling scene export scenes/rock rock.glb
    """  # noqa: D301  (\b keeps click from rewrapping the example)
    from toppling.results.drawing.export import export_scene

    export_scene(Scene.load(folder), file)
    click.echo(str(file))
