"""`toppling scene`: show a scene, or export it to other programs."""

from pathlib import Path

import click

from toppling.orchestrator.cli import Verbs
from toppling.orchestrator.verbs import shared_options as shared
from toppling.orchestrator.verbs.shared_options import option


@click.group(cls=Verbs)
def scene() -> None:
    """Show a scene or export it.

    \b
    toppling scene show scenes/rock
    toppling scene export scenes/rock rock.glb
    """


@scene.command()
@click.argument("folder", type=shared.PATH)
@option("--out", type=shared.PATH, help="Folder to write to. Default: the scene's folder.")
def show(folder: Path, out: Path | None) -> None:
    """Write scene.png, a picture, and scene.html, an interactive page.

    If the rock settles far before it is shaken, settling.png shows the contact and the toppling acceleration, as
    scanned and as settled.

    \b
    toppling scene show scenes/rock --out pictures
    """
    target = out or folder
    from toppling.orchestrator.terminal import bar

    shared.compile_first()
    with bar("scene", 3) as advance:
        advance(0, "settling")
        from toppling.models.files.folder import rock_name, write_text
        from toppling.models.hidden_base.intervals import base_sentences
        from toppling.models.scene import Scene
        from toppling.orchestrator.rocks_of_run import draw_settling, settling_notes
        from toppling.results.drawing.scene_figures import draw_scene, scene_page

        loaded = Scene.load(folder)
        target.mkdir(parents=True, exist_ok=True)
        notes = settling_notes(loaded) + base_sentences(loaded.report)
        advance(1, "scene.png")
        draw_scene(loaded, target / "scene.png")
        advance(1, "scene.html")
        write_text(scene_page(loaded, rock_name(folder), notes), target / "scene.html")
        drawn = [target / name for name in ("scene.png", "scene.html")]
        advance(1, "settling.png")
        if draw_settling(loaded, target / "settling.png"):
            drawn.append(target / "settling.png")
    click.echo("\n".join([*map(str, drawn), *notes]))


@scene.command()
@click.argument("folder", type=shared.PATH)
@click.argument("file", type=shared.PATH)
def export(folder: Path, file: Path) -> None:
    """Export rock and pedestal as one file.

    The suffix chooses the format: .glb or .gltf (y up, as glTF prescribes), .ply or .obj (z up).

    \b
    toppling scene export scenes/rock rock.glb
    """
    from toppling.models.scene import Scene
    from toppling.results.drawing.scene_figures import export_scene

    export_scene(Scene.load(folder), file)
    click.echo(str(file))
