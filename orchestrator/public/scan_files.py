"""What lies in a scanned scene's folder beside the scene: what was said of the scan, and pictures."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from toppling.models.scan.inspection import Inspection
from toppling.models.scene import Scene


def hints_said(given: Mapping[str, Any], inspection: Inspection) -> dict[str, Any]:
    """What was said of a scan, as `hints.toml` has it."""
    said = {name: given.get(name) for name in ("units", "near", "plane")}
    said["point"] = [_as_text(each) for each in given.get("point") or ()]
    said["touch"] = [_as_text(each) for each in inspection.touching_m]
    said["daylight"] = [_as_text(each) for each in inspection.open_m]
    return said | {"pull": [list(each) for each in inspection.pulls]}


def _as_text(place: str | Sequence[float]) -> str:
    return place if isinstance(place, str) else ",".join(repr(float(each)) for each in place)


def pictured(scene: Scene) -> tuple[Callable[[Path], None], list[str]]:
    """What draws a scene's pictures into its folder, and what the user should know of its rest and base."""
    from toppling.models.intervals import base_sentences
    from toppling.orchestrator.settling_told import draw_settling, settling_notes
    from toppling.results.drawing.scene import draw_scene

    notes = settling_notes(scene) + base_sentences(scene.report)

    def draw(folder: Path) -> None:
        draw_scene(scene, folder / "scene.png", notes)
        draw_settling(scene, folder / "settling.png")

    return draw, [*notes]
