"""Entries of a run's folder on its rocks: sites, settling, and those that do not stand."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.frames import azimuth_deg, quadrant_of
from toppling.models.pedestal import ContactProperties, Pedestal
from toppling.models.rock import Rock
from toppling.models.scene import Scene
from toppling.models.statics import polygon, quasi_static_toppling_m_s2, support_polygon_m
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import Plan, PlannedScene
from toppling.orchestrator.site_table import Site
from toppling.workers.seating import settled

_REPORTED_FROM_DEG = 0.1
"""Tilt, or displacement as of such a tilt, from which a settling is reported, degrees: the error of an interface."""


@dataclass(frozen=True)
class Settling:
    """Difference between a rock's pose in its scene and the one in which every job begins."""

    tilt_deg: float  # angle between the interface's normal before and after rotation with the rock
    toward_deg: float  # azimuth toward which it tilted
    moved_m: float  # displacement of the vertex that moved farthest
    height_m: float  # of the rock in the scene

    @classmethod
    def between(cls, scanned: Rock, settled: Rock, normal: np.ndarray) -> Settling:
        """Settling of a rock on an interface with this upward normal, from its mesh before and after."""
        before, after = scanned.vertices_m - scanned.com_m, settled.vertices_m - settled.com_m
        turn, _ = Rotation.align_vectors(after, before)
        leant = turn.apply(normal) - normal
        return cls(
            tilt_deg=float(np.rad2deg(2.0 * np.arcsin(min(0.5 * float(np.linalg.norm(leant)), 1.0)))),
            toward_deg=azimuth_deg(leant),
            moved_m=float(np.linalg.norm(settled.vertices_m - scanned.vertices_m, axis=1).max()),
            height_m=scanned.height_m,
        )

    @property
    def moved_deg(self) -> float:
        """Tilt about the rock's lowest point that would move its top as far."""
        return math.degrees(self.moved_m / self.height_m)

    @property
    def sentence(self) -> str | None:
        """Sentence on the settling; None where the rock stands as scanned."""
        if self.tilt_deg >= _REPORTED_FROM_DEG:
            return (
                f"the rock settles by {self.tilt_deg:.1f}° toward {quadrant_of(self.toward_deg)} "
                f"({self.moved_m:.2g} m at its farthest point) before it is shaken"
            )
        if self.moved_deg >= _REPORTED_FROM_DEG:
            return f"the rock settles by {self.moved_m:.2g} m at its farthest point before it is shaken"
        return None

    def to_json(self) -> dict[str, Any]:
        """Fields and sentence, for `run.json`."""
        return {**asdict(self), "sentence": self.sentence}


class Settlings(dict[tuple[float, float], Settling | InputError]):
    """Settling of a nominal rock for each friction, static and kinetic, or the reason why it does not stand."""

    @classmethod
    def of(cls, campaign: Campaign, scene: Scene) -> Settlings:
        """Settle the rock with each friction of a campaign."""
        found = cls()
        for static, kinetic in sorted(set(campaign.friction)):
            try:
                stands = settled(scene.with_contact(ContactProperties.of((static, kinetic))))
                found[static, kinetic] = Settling.between(scene.rock, stands.rock, scene.pedestal.normal)
            except InputError as error:
                other = {"what": f"with friction {static:g}: {error.what}", "where": str(campaign.scene)}
                found[static, kinetic] = InputError(**vars(error) | other)
        return found

    @property
    def problems(self) -> list[InputError]:
        """Reasons why the rock does not stand."""
        return [found for found in self.values() if isinstance(found, InputError)]

    def checked(self) -> Settling | None:
        """Largest settling; InputError if the rock does not stand with every friction, which every job would repeat."""
        for problem in self.problems:
            raise problem
        return self.largest

    @property
    def largest(self) -> Settling | None:
        """Settling with the largest tilt; None if the rock stands with no friction."""
        stands = [found for found in self.values() if isinstance(found, Settling)]
        return max(stands, key=lambda settling: settling.tilt_deg, default=None)


def settlings_of(plan: Plan) -> list[Settlings]:
    """Settling of each rock of a plan."""
    return [Settlings.of(scene.campaign, Scene.load(scene.campaign.scene)) for scene in plan.scenes]


def site_in_run(scene: PlannedScene) -> Site:
    """Row of a rock in the run's table of rocks."""
    assert scene.site is not None
    own = None if scene.ensemble_place == "ensemble" else Path(scene.ensemble_place)
    return dataclasses.replace(scene.site, scene=Path(scene.scene_place), ensemble=own, seismograms=None)


def rows_without_stand(plan: Plan, settlings: Sequence[Settlings]) -> Iterator[dict[str, Any]]:
    """Rows of the jobs on rocks that do not stand."""
    from toppling.orchestrator.task import lost_row  # with Dask

    unstable = {
        scene.scene_id: (scene.rock, settles)
        for scene, settles in zip(plan.scenes, settlings, strict=True)
        if settles.problems
    }
    for row in range(len(plan)) if unstable else ():
        spec = plan.spec(row)
        rock, settlings_here = unstable.get(spec.scene_id, (None, Settlings()))
        why = settlings_here.get((spec.friction_static, spec.friction_kinetic))
        if isinstance(why, InputError):
            yield {**lost_row(spec, "failed", str(why)), "rock": rock, "attempt": 1}


def scene_entries(plan: Plan, settlings: Sequence[Settlings]) -> dict[str, Any]:
    """Entries of `run.json` on the settling of a single rock, or on each rock of an atlas.

    Raises InputError if a single rock does not stand.
    """
    largest = [rock.largest and rock.largest.to_json() for rock in settlings]
    if not plan.campaign.sites:
        settlings[0].checked()
        return {"settling": largest[0]}
    counts = np.bincount(plan.columns["scene_id"], minlength=len(plan.scenes)).tolist()
    entries = []
    for scene, settles, jobs, most in zip(plan.scenes, settlings, counts, largest, strict=True):
        site = scene.site
        assert site is not None
        entries.append({
            "rock": site.rock, "scene_id": scene.scene_id, "ensemble_id": scene.ensemble_id,
            "ensemble": scene.ensemble_place, "site": site.site, "longitude": site.longitude,
            "latitude": site.latitude, "age": site.age, "problem": "; ".join(map(str, settles.problems)) or None,
            "jobs": jobs, "settling": most,
        })  # fmt: skip
    left_out = [{"rock": rock, "why": why} for rock, why in plan.left_out]
    return {"settling": None, "scenes": entries, "left_out": left_out}


_LARGE_FROM_DEG = 1.0
"""Tilt, or displacement as of such a tilt, from which a settling exceeds the error of an interface."""

_WHY_A_SCANNED_ROCK_SETTLES = (
    "it was scanned at rest, so one observation contradicts standing: a rim that is not where it seems, another plane "
    "(--plane), or a wedge or adhesion that holds it"
)

AZIMUTHS_DEG = range(0, 360, 10)

_Rose = list[tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Settled:
    """A scene as scanned, and after settling, when every job begins."""

    scanned: Scene
    stands: Scene
    settling: Settling

    @classmethod
    def of(cls, scene: Scene) -> Settled:
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
            return scene.quasi_static_toppling_m_s2(AZIMUTHS_DEG)
        plane = Pedestal(scene.pedestal.point_m, scene.pedestal.normal)
        over_m = (outline - plane.point_m) @ plane.normal
        on_outline = dataclasses.replace(scene.rock, feet_m=outline - over_m[:, None] * plane.normal)
        return quasi_static_toppling_m_s2(on_outline, plane, scene.gravity_m_s2, AZIMUTHS_DEG)

    @property
    def rose_stands(self) -> _Rose:
        """Least constant acceleration that topples the settled rock, by the ground's azimuth."""
        return self.stands.quasi_static_toppling_m_s2(AZIMUTHS_DEG)

    @property
    def is_large(self) -> bool:
        """Whether the settling exceeds the interface's error, so that it should be inspected."""
        return max(self.settling.tilt_deg, self.settling.moved_deg) >= _LARGE_FROM_DEG

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
