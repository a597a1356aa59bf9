"""Explanation, remedies and figure for a rock that settles far from its scanned pose."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.scene import Scene
from toppling.models.settling import Settling
from toppling.models.statics import polygon, support_polygon_m, tipping_m_s2
from toppling.workers.seating import settled

_LARGE_FROM_DEG = 1.0
_LARGE_FROM_FRACTION = 0.01
"""Displacement over height from which, as from that tilt, a settling exceeds the error of an interface."""

_WHY_A_SCANNED_ROCK_SETTLES = (
    "it was scanned at rest, so one observation contradicts standing: a rim that is not where it seems, another plane "
    "(--plane), or a wedge or adhesion that holds it"
)

_AZIMUTHS_DEG = range(0, 360, 10)

_Rose = list[tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Settled:
    """A scene as scanned, and after settling, when every job begins."""

    scanned: Scene
    stands: Scene
    settling: Settling

    @classmethod
    def of(cls, scene: Scene) -> "Settled":
        """Settle the rock of a scene; InputError if it does not stand."""
        stands = settled(scene)
        return cls(scene, stands, Settling.between(scene.rock, stands.rock, scene.pedestal.normal))

    @property
    def outline_m(self) -> Array:
        """Corners (k, 3) of the contact's hull as scanned; without a scan, in the initial pose."""
        outline = np.array(self.scanned.report.get("interface", {}).get("outline_m", []), float)
        if len(outline) < 3:
            return support_polygon_m(self.scanned.rock, self.scanned.pedestal)
        return polygon(outline, self.scanned.pedestal.normal, 0.0)

    @property
    def rose_scanned(self) -> _Rose:
        """Least constant acceleration that topples the rock on the contact as scanned, by the ground's azimuth."""
        outline, scene = self.outline_m, self.scanned
        if len(outline) < 3:
            return scene.quasi_static_toppling_m_s2(_AZIMUTHS_DEG)
        return tipping_m_s2(
            outline, scene.rock.com_m, scene.pedestal.normal, scene.gravity_m_s2, _AZIMUTHS_DEG)  # fmt: skip

    @property
    def rose_stands(self) -> _Rose:
        """Least constant acceleration that topples the settled rock, by the ground's azimuth."""
        return self.stands.quasi_static_toppling_m_s2(_AZIMUTHS_DEG)

    @property
    def is_large(self) -> bool:
        """Whether the settling exceeds the interface's error, so that it should be inspected."""
        found = self.settling
        return found.tilt_deg >= _LARGE_FROM_DEG or found.way_m >= _LARGE_FROM_FRACTION * found.height_m

    @property
    def sentences(self) -> list[str]:
        """Sentences on the settling, with an explanation and remedies if it is large."""
        ground, rounded = self.scanned.ground, self.scanned.rounded_base
        found = [
            None if ground.is_plane else ground.sentence,
            self.scanned.report.get("interface", {}).get("beside"),
            rounded.sentence if rounded is not None and (rounded.rolls or rounded.is_coarse) else None,
            self.settling.sentence,
        ]
        sentences = [sentence for sentence in found if sentence]
        if self.settling.sentence and "unseen_base" in self.scanned.report:
            sentences[-1:] = [f"{sentences[-1]}; {_WHY_A_SCANNED_ROCK_SETTLES}"]
        if not (self.is_large and ground.is_plane):  # the explanation applies to a plane
            return sentences
        points = len(support_polygon_m(self.stands.rock, self.stands.pedestal))
        before, after = (min(value for _, value in rose) for rose in (self.rose_scanned, self.rose_stands))
        if self.scanned.report:
            why = "no scanner saw the base, and the surface that closes it does not carry the rock as it was scanned"
            remedy = "where you know that rock and pedestal touch, scan again with --point x,y,z (three or more) or "
            remedy += "--outline FILE; otherwise the answers are those of a rock on these contact points"
        else:
            why = "the mesh is not in a pose in which it rests on its pedestal"
            remedy = "turn it, or give another slope, until it stands as you know it to"
        return [
            *sentences,
            f"what that means: {why}. Settled it stands on {points} contact points, and the least constant "
            f"acceleration that topples it is {after:.3g} m/s2; on the contact "
            f"as scanned it would be {before:.3g} m/s2",
            f"what to do: look at settling.png, which 'toppling scene show' draws; {remedy}",
        ]


def settling_notes(scene: Scene) -> list[str]:
    """Sentences on how a scene's rock stands, or why it does not."""
    try:
        return Settled.of(scene).sentences
    except InputError as error:
        return [f"warning: {error.brief}; no campaign can be run with this scene: {error.remedy}"]


def draw_settling(scene: Scene, path: Path) -> bool:
    """Draw scanned and settled contact and statics if the settling is large; returns whether it is."""
    try:
        found = Settled.of(scene)
    except InputError:
        return False
    if not (found.is_large and scene.ground.is_plane):
        return False
    from toppling.results.drawing.roses import draw_settled

    draw_settled(found.scanned, found.stands, found.outline_m, found.rose_scanned, found.rose_stands, path)
    return True
