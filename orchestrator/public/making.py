"""Scenes from point clouds, new draws of a scene's hidden base, and the further files of a scene's folder."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from toppling.models.errors import InputError, did_you_mean
from toppling.models.files.folder import refuse_existing
from toppling.models.files.schemas import LABELS
from toppling.models.hidden_base.inspection import Inspection, inspection_of
from toppling.models.hidden_base.intervals import base_sentences
from toppling.models.scan.hints_file import HINTS, KEYS, CloudHints, Hints, Place, plain, write_hints
from toppling.models.scan.interface_hint import InterfaceHint, hint_of
from toppling.models.scan.parts import files_with, labelled, parts_of
from toppling.models.scan.placement import Placement, Reference, control_point_lines, of_user, placement_of
from toppling.models.scan.read import Cloud, read_clouds
from toppling.models.scan.survey import CachedScan, SeparatedMeshes, Survey, save_survey, survey
from toppling.models.scan.uncertainty import invention_warning
from toppling.models.scene import Scene
from toppling.orchestrator.public import paths_of, unseen
from toppling.orchestrator.rocks_of_run import draw_settling, settling_notes
from toppling.results.drawing.scene_figures import draw_scene


@dataclass(frozen=True, eq=False)
class Scanned:
    """A rock on its pedestal, made from clouds.

    Parameters
    ----------
    scene : Scene
    folder : Path
        Folder of the scene, with figures.
    notes : list of str
        Limitations of the scene.
    """

    scene: Scene
    folder: Path
    notes: list[str]


def scan(
    files: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    contact: str | Path | None = None,
    advance: Callable[..., None] = unseen,
    **hints: Unpack[Hints],
) -> Scanned:
    """Turn laser scans or photogrammetry into a rock on its pedestal, as `toppling scan` does, in a new folder.

    Parameters
    ----------
    files : path or sequence of path
        Stations of one survey, or pieces of one model.
    out : path
        The scene's folder, which must not exist.
    contact : path, optional
        File of places that touch, or where light passes.
    advance : callable
        Called with (1, what) at each stage.
    **hints
        `units`, `up`, `length`, `gcp`, `crs`, `rock`, `pedestal`, `near`, `plane`, `point`, `outline`, `touch`,
        `daylight`, `pull`, `base`, `touch_only`, as the options of `toppling scan`: lengths in metres, angles in
        degrees, survey coordinates.

    Raises
    ------
    InputError
        If the folder exists, a file cannot be read, or no rock is found in the clouds.
    """
    for name in hints:
        if name not in KEYS:
            raise TypeError(f"'{name}' is no hint of a scan: {did_you_mean(name, KEYS, ', '.join(KEYS))}")
    folder = Path(out)
    refuse_existing(folder)
    inspection = inspection_of(contact, **of_base(hints))
    hint = hint_of(hints.get("plane"), list(hints.get("point", ())), hints.get("outline"))
    stage = partial(advance, 1)

    advance(0, "reading")
    cloud, meshes = placed_cloud(paths_of(files), hints)
    make = partial(survey, cloud, stage, hints.get("near"), hint, inspection)
    try:
        result = make() if meshes is None else meshes.surveyed(make, hinted=not inspection.says_nothing)
    except InputError as error:
        raise in_files(error, [name for name, _ in cloud.files], contact) from None
    advance(1, "letting the rock stand")
    return Scanned(result.scene, folder, written(result, folder, stated_hints(hints, inspection), advance))


def written(
    result: Survey,
    folder: Path,
    stated: dict[str, Any],
    advance: Callable[..., None] = unseen,
    replaces: bool = False,
) -> list[str]:
    """Write the scene of a scan with its figures and hints; returns notes for the user."""
    draw, notes = _pictured(result.scene)
    advance(1, "writing")

    def also(folder: Path) -> None:
        write_hints(folder / HINTS, stated)
        draw(folder)

    if result.cached is not None:
        result = replace(result, cached=replace(result.cached, stated=stated))
    save_survey(result, folder, also, replaces)
    warning = invention_warning(result.scene)
    return [*notes, *result.notes, *([warning] if warning else [])]


def in_files(error: InputError, files: list[str], contact: str | Path | None) -> InputError:
    """Name the files in an error that concerns all of them."""
    of_contact = contact is not None and error.where.startswith(f"{Path(contact)}, ")
    if of_contact or error.where in files:
        return error
    names = ", ".join(files[:3]) + (" ..." if len(files) > 3 else "")
    return InputError(**vars(error) | {"where": f"{names}: {error.where}"})


def scan_again(
    scene: str | Path,
    out: str | Path | None = None,
    *,
    contact: str | Path | None = None,
    touch: Sequence[Place] = (),
    daylight: Sequence[Place] = (),
    pull: Sequence[tuple[float, float]] = (),
    base: str | None = None,
    touch_only: bool = False,
    advance: Callable[..., None] = unseen,
) -> Scanned:
    """Draw the base of a scanned scene again from the data that its scan has stored: no clouds are read.

    Parameters
    ----------
    scene : path
        Folder of a scene of :func:`scan`.
    out : path, optional
        A new folder for the result. Default: it takes the place of the scene.
    contact, touch, daylight, pull, base, touch_only
        As of :func:`scan`; those that are given replace the former ones of their kind.
    advance : callable
        Called with (1, what) at each stage.

    Raises
    ------
    InputError
        If the folder keeps nothing of a scan, a file in it is of another scene, or a hint contradicts what was seen;
        the scene is then left as it is.
    """
    folder = Path(scene)
    advance(0, "reading")
    stored = CachedScan.read(folder).with_hints(
        inspection_of(contact, pull, touch, daylight, base, touch_only)
    )
    advance(1, "drawing the hidden base")
    drawn, stored = stored.scene()
    advance(1, "writing")
    return written_again(folder, None if out is None else Path(out), drawn, stored)


def written_again(
    scene: Path, out: Path | None, drawn: Scene, stored: CachedScan, replaces: bool = False
) -> Scanned:
    """Write a scene with a newly drawn base in place of the former scene, or to another folder.

    scene: folder of the former scene.
    replaces: whether the other folder may exist.
    """
    with np.load(scene / LABELS) as stored_labels:
        again = Survey(drawn, stored_labels["label"], (), stored)
    target, stated = out or scene, stated_hints(stored.stated, stored.inspection)
    return Scanned(drawn, target, written(again, target, stated, replaces=replaces or out is None))


def placed_cloud(files: Sequence[Path], hints: CloudHints) -> tuple[Cloud, SeparatedMeshes | None]:
    """Points of files in metres, z up, by the files' and the user's information; rock and pedestal if given as meshes.

    Raises InputError if a file cannot be read, or hints are inconsistent.
    """
    if (hints.get("rock") or hints.get("pedestal")) and hints.get("near"):
        raise InputError(
            "parts.near_needless",
            "--near is given with --rock or --pedestal",
            where="--near",
            expected="one word on which rock is meant",
            remedy="leave out --near: what was separated is known",
        )
    placement, system = placed_by(hints)
    parts = parts_of(hints.get("rock"), hints.get("pedestal"))
    every = files_with(files, parts)
    if not every:
        raise InputError(
            "scan.no_files",
            "no file is given",
            where="FILES",
            expected="clouds or meshes of one rock",
            remedy="check the pattern that the paths are from",
        )
    cloud = labelled(read_clouds(every, hints.get("units"), placement, system), every, parts)
    if None in parts or len(every) != len(parts):
        return cloud, None
    meshes = dict(zip(every, cloud.meshes, strict=True))
    body, surface = (
        next((mesh for path, mesh in meshes.items() if part and part.among(path)), None) for part in parts
    )
    return cloud, None if body is None or surface is None else SeparatedMeshes(body, surface)


def placed_by(hints: CloudHints) -> tuple[Placement, Reference | None]:
    """Transformation of coordinates to metres, z up, and the coordinate system if the user gives one.

    Raises InputError if hints are inconsistent.
    """
    crs, length, gcp = hints.get("crs"), hints.get("length"), hints.get("gcp")
    if crs and length:
        raise InputError(
            "placement.given_twice",
            "--crs is given with --length",
            where="--crs",
            expected="a coordinate system of surveyed coordinates",
            remedy="give control points (--gcp), which place the model in it, or leave --crs out",
        )
    system = of_user(crs) if crs else None
    units = system["metres_per_unit"] if system else (1.0, 1.0)
    return placement_of(hints.get("up"), length, gcp, units), system


def of_base(hints: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of :func:`inspection_of` from hints on the base."""
    return {
        "pulls": hints.get("pull") or (), "touching_m": hints.get("touch") or (), "open_m": hints.get("daylight") or (),
        "base": hints.get("base"), "touch_only": bool(hints.get("touch_only")),
    }  # fmt: skip


def hints_on_base(known: Inspection) -> dict[str, Any]:
    """Hints on the base, by name, from an inspection."""
    return {
        "touch": known.touching_m.tolist(), "daylight": known.open_m.tolist(),
        "pull": [list(pull) for pull in known.pulls], "base": known.base, "touch_only": known.touch_only,
    }  # fmt: skip


def stated_hints(given: Mapping[str, Any], inspection: Inspection) -> dict[str, Any]:
    """Hints of a scan for `hints.toml`, with the content of files instead of their paths."""
    gcp, outline = given.get("gcp"), given.get("outline")
    stated = {**given, **hints_on_base(inspection), "gcp": control_point_lines(gcp) if gcp else None}
    if isinstance(outline, str | Path):
        stated["outline"] = InterfaceHint.outline(outline).anchors_m
    return {key: plain(key, stated.get(key)) for key in KEYS}


def _pictured(scene: Scene) -> tuple[Callable[[Path], None], list[str]]:
    """Function that draws a scene's figures into its folder, and notes on its settling and base."""
    notes = settling_notes(scene) + base_sentences(scene.report)

    def draw(folder: Path) -> None:
        draw_scene(scene, folder / "scene.png")
        draw_settling(scene, folder / "settling.png")

    return draw, [*notes]
