"""What lies in a scanned scene's folder beside the scene: what was said of the scan, and pictures."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toppling.models.errors import InputError
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.scan.hints_file import KEYS, CloudHints, plain
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.placement import control_point_lines
from toppling.models.scene import Scene
from toppling.models.spelling import did_you_mean

if TYPE_CHECKING:
    from toppling.models.scan.placement import Placement
    from toppling.models.scan.read import Cloud
    from toppling.models.scan.reference import Reference
    from toppling.models.scan.survey import SeparatedMeshes


def check_hints(hints: Mapping[str, object]) -> None:
    """Refuse a keyword that is no hint, as Python does.

    Raises TypeError with the hint that was probably meant.
    """
    for name in hints:
        if name not in KEYS:
            raise TypeError(f"'{name}' is no hint of a scan: {did_you_mean(name, KEYS, ', '.join(KEYS))}")


def placed_cloud(files: Sequence[Path], hints: CloudHints) -> "Cloud":
    """Points of files in metres, z up, by what the files and the user say.

    Raises InputError if a file cannot be read, or what is said contradicts itself.
    """
    from toppling.models.scan.parts import files_with, labelled, parts_of
    from toppling.models.scan.read import read_clouds

    if (hints.get("rock") or hints.get("pedestal")) and hints.get("near"):
        raise InputError(
            "--near is given with --rock or --pedestal",
            where="--near",
            expected="one word on which rock is meant",
            remedy="leave out --near: what was separated is known",
        )
    placement, system = placed_by(hints)
    parts = parts_of(hints.get("rock"), hints.get("pedestal"))
    every = files_with(files, parts)
    return labelled(read_clouds(every, hints.get("units"), placement, system), every, parts)


def brought_apart(files: Sequence[Path], hints: CloudHints, cloud: "Cloud") -> "SeparatedMeshes | None":
    """Rock and pedestal if the user has given each as a mesh; else None.

    cloud: of the files, as :func:`placed_cloud` read them.
    """
    from toppling.models.scan.parts import files_with, parts_of
    from toppling.models.scan.survey import SeparatedMeshes

    parts = parts_of(hints.get("rock"), hints.get("pedestal"))
    every = files_with(files, parts)
    if None in parts or len(every) != len(parts):
        return None
    body, surface = (
        next(
            (mesh for path, mesh in zip(every, cloud.meshes, strict=True) if part and part.among(path)), None
        )
        for part in parts
    )
    return None if body is None or surface is None else SeparatedMeshes(body, surface)


def placed_by(hints: CloudHints) -> "tuple[Placement, Reference | None]":
    """How coordinates become metres, z up, and their coordinate system if the user names one.

    Raises InputError if what is said contradicts itself.
    """
    from toppling.models.scan.placement import placement_of
    from toppling.models.scan.reference import of_user

    crs, length, gcp = hints.get("crs"), hints.get("length"), hints.get("gcp")
    if crs and length:
        raise InputError(
            "--crs is given with --length",
            where="--crs",
            expected="a coordinate system of surveyed coordinates",
            remedy="give control points (--gcp), which place the model in it, or leave --crs out",
        )
    system = of_user(crs) if crs else None
    units = system["metres_per_unit"] if system else (1.0, 1.0)
    return placement_of(hints.get("up"), length, gcp, units), system


def of_base(hints: Mapping[str, Any]) -> dict[str, Any]:
    """What hints say of the base, as :func:`inspection_of` takes it."""
    return {
        "pulls": hints.get("pull") or (), "touching_m": hints.get("touch") or (), "open_m": hints.get("daylight") or (),
        "base": hints.get("base"), "touch_only": bool(hints.get("touch_only")),
    }  # fmt: skip


def hints_said(given: Mapping[str, Any], inspection: Inspection) -> dict[str, Any]:
    """What was said of a scan, as `hints.toml` has it: what files hold, and not where they lie."""
    known = {
        "touch": inspection.touching_m, "daylight": inspection.open_m, "pull": inspection.pulls,
        "base": inspection.base, "touch_only": inspection.touch_only,
    }  # fmt: skip
    gcp, outline = given.get("gcp"), given.get("outline")
    said = {**given, **known, "gcp": control_point_lines(gcp) if gcp else None}
    if isinstance(outline, str | Path):
        said["outline"] = InterfaceHint.outline(outline).anchors_m
    return {key: plain(key, said.get(key)) for key in KEYS}


def pictured(scene: Scene) -> tuple[Callable[[Path], None], list[str]]:
    """What draws a scene's pictures into its folder, and what the user should know of its rest and base."""
    from toppling.models.hidden_base.intervals import base_sentences
    from toppling.orchestrator.settling_notes import draw_settling, settling_notes
    from toppling.results.drawing.scene_figures import draw_scene

    notes = settling_notes(scene) + base_sentences(scene.report)

    def draw(folder: Path) -> None:
        draw_scene(scene, folder / "scene.png", notes)
        draw_settling(scene, folder / "settling.png")

    return draw, [*notes]
