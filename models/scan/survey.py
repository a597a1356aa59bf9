"""From clouds to a scene: the whole of `toppling scan`, and its intermediate results, cached beside the scene."""

import dataclasses
import json
import os
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array, Flags, at_most, bounds_of, inside_box
from toppling.models.errors import InputError, refusals
from toppling.models.files import digest
from toppling.models.files.folder import new_folder, replaced_folder
from toppling.models.files.schemas import GEOMETRY, LABELS, SCAN_DATA, read_own
from toppling.models.hidden_base.draw_bases import ContradictionError
from toppling.models.hidden_base.gap import hidden_base
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.near_interface import near_the_interface
from toppling.models.hidden_base.standing import base_unseen, check_inspection
from toppling.models.lengths import too_large
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock, check_size
from toppling.models.scan.close import SHARES, ClosedRock, close_rock
from toppling.models.scan.crevice import check_seen, judge_crevice, seen_apart
from toppling.models.scan.ground import Ground, level_surface, pedestal_ground, pedestal_surface
from toppling.models.scan.hints_file import outside_cloud
from toppling.models.scan.interface import UPWARD, Interface, Sheet, fit_interface
from toppling.models.scan.interface_hint import InterfaceHint, check_near
from toppling.models.scan.meshes import Mesh
from toppling.models.scan.parts import as_labelled
from toppling.models.scan.plausible import mesh_note, step_note
from toppling.models.scan.read import Cloud
from toppling.models.scan.register import Registered, registered
from toppling.models.scan.scan_warnings import left_over, warnings_of, with_unseen_range
from toppling.models.scan.segment import (
    NEITHER,
    PEDESTAL,
    ROCK,
    Segmentation,
    cut_over,
    label_surfels,
    relabelled,
    segment,
    without_ground,
)
from toppling.models.scan.surfels import SAMPLED_POINTS, Surfels
from toppling.models.scan.surroundings import mesh_surroundings, surroundings_met
from toppling.models.scan.uncertainty import ObservedRock, check_above, slenderness, spread_of
from toppling.models.scene import Scene

SCHEMA_VERSION = 7
_MOST_BYTES = 2 << 30
"""Unpacked; a scan of 20 million points keeps less than a tenth of this."""

_unusable = refusals(
    expected=f"a scene of 'toppling scan' with its {SCAN_DATA}, as written",
    remedy="scan the clouds again with the hint",
)


@dataclass(frozen=True, eq=False)
class CachedScan:
    """Everything that a scan found out before the hidden base was drawn."""

    observed: ObservedRock
    interface: Interface
    closed: ClosedRock
    pedestal: Pedestal
    origin_m: Array  # (3,)
    bounds_m: Array  # (2, 3): lowest and highest survey coordinates of the clouds
    report: dict[str, Any]  # of the scene, without what depends on the base
    inspection: Inspection  # what the user knows of the base, survey coordinates
    # Intervals of the toppling acceleration without that knowledge, once they are known.
    unaided: list[dict[str, float]] | None = None
    # What the user said of the clouds and the interface, as `hints.toml` has it.
    stated: Mapping[str, Any] = field(default_factory=dict)

    def with_hints(self, given: Inspection) -> "CachedScan":
        """Replace what is known of the base by what is given, kind by kind."""
        known = self.inspection
        places = given if len(given.places_m) else known
        merged = dataclasses.replace(
            places,
            pulls=given.pulls or known.pulls,
            base=given.base or known.base,
            touch_only=given.touch_only or places.touch_only,
        )
        return dataclasses.replace(self, inspection=merged)

    def cloud(self) -> tuple[Cloud, NDArray[np.int8]]:
        """What is kept of the cloud, about the interface and in patches, and the label of each point."""
        observed = self.observed
        parts = (observed.surfels.points_m, observed.rock_m, observed.pedestal_m)
        patches = np.where(observed.patches, ROCK, PEDESTAL)
        sides = np.repeat([ROCK, PEDESTAL], [len(observed.rock_m), len(observed.pedestal_m)])
        points = np.concatenate(parts)
        station = np.zeros(len(points), np.int32)
        return Cloud(points, self.origin_m, station, ()), np.append(patches, sides).astype(np.int8)

    def scene(self) -> tuple[Scene, "CachedScan"]:
        """Draw the hidden base and make the scene; beside it the same with `unaided`, for the next hint.

        Raises
        ------
        InputError
            If the inspection contradicts what was seen.
        """
        self.inspection.check(*self.bounds_m)
        known = self.inspection.moved(self.origin_m)
        parts = (self.observed, self.interface, self.closed, self.pedestal)
        rock, unseen, standing = base_unseen(*parts, known, self.unaided)
        # Of the draws: the closed rock's own may lie beside the weight, which each of them encloses.
        contacts = standing["contacts"]
        outlined = {name: contacts.pop(name) for name in ("outline_m", "outlines")}
        interface = {**self.report["interface"], **outlined}
        report = {**self.report, "interface": interface, "unseen_base": standing}
        scene = Scene(rock, self.pedestal, origin_m=self.origin_m, unseen=unseen, report=report)
        report["slenderness"] = slenderness(scene)
        unaided = standing.get("without_inspection", standing.get("toppling"))
        return scene, dataclasses.replace(self, unaided=unaided)

    def write(self, path: Path) -> None:
        """Write the file, with its digest."""
        np.savez(path, told=np.array(json.dumps(self._metadata())), **self._arrays())
        digest.seal_archive(path)

    def _metadata(self) -> dict[str, Any]:
        observed, hint = self.observed, self.observed.hint
        return {
            "schema_version": SCHEMA_VERSION,
            "voxel_m": observed.surfels.voxel_m,
            "height_m": observed.height_m,
            "roughness_m": self.interface.roughness_m,
            "sheet": None if self.interface.sheet is None else self.interface.sheet.to_json(),
            "shares": [getattr(self.closed, share) for share in SHARES],
            "hint": None if hint is None else [hint.kind, hint.encloses],
            "pulls": self.inspection.pulls,
            "base": self.inspection.base,
            "touch_only": self.inspection.touch_only,
            "surface": not self.pedestal.is_plane,
            "report": self.report,
            "unaided": self.unaided,
            "said": dict(self.stated),
        }

    def _arrays(self) -> dict[str, Any]:
        observed, hint, rock, ground = self.observed, self.observed.hint, self.closed.rock, self.pedestal
        surfels = observed.surfels
        arrays: dict[str, Any] = {
            "rock_points": observed.rock_m,
            "pedestal_points": observed.pedestal_m,
            "surfels": np.column_stack([surfels.points_m, surfels.normals, surfels.roughness]),
            "patches": observed.patches,
            "plane": np.vstack([self.interface.point_m, self.interface.normal, self.interface.axes]),
            "anchors": np.zeros((0, 3)) if hint is None else hint.anchors_m,
            "rock_vertices": rock.vertices_m,
            "rock_faces": rock.faces,
            "pedestal_plane": np.vstack([ground.point_m, ground.normal]),
            "bounds": np.vstack([self.origin_m, self.bounds_m]),
            "touching": self.inspection.touching_m,
            "open": self.inspection.open_m,
        }
        if ground.vertices_m is not None and ground.faces is not None:
            arrays |= {"pedestal_vertices": ground.vertices_m, "pedestal_faces": ground.faces}
        return arrays

    @classmethod
    def read(cls, scene: Path) -> "CachedScan":
        """Read what the scan of a scene's folder has worked out.

        Raises
        ------
        InputError
            If the folder keeps nothing of a scan, or a file there is damaged, of another scene or another version.
        """
        path = scene / SCAN_DATA
        if not path.is_file():
            raise _unusable("scan.not_kept", f"keeps no {SCAN_DATA}", scene)
        if not (scene / "scene.json").is_file():
            raise _unusable("scan.not_kept", "keeps no scene.json", scene)
        read_own(scene, (*GEOMETRY, LABELS, SCAN_DATA))
        try:
            with zipfile.ZipFile(path) as archive:
                if sum(member.file_size for member in archive.infolist()) > _MOST_BYTES:
                    raise _unusable(
                        "file.too_large", f"would unpack to more than {_MOST_BYTES >> 30} GB", path
                    )
            with np.load(path, allow_pickle=False) as stored:
                arrays = {name: stored[name] for name in stored.files}
            meta = json.loads(str(arrays["told"]))
            if meta["schema_version"] != SCHEMA_VERSION:
                raise _unusable(
                    "document.schema_version", f"is of schema version {meta['schema_version']}", path
                )
            return cls._of(arrays, meta)
        except InputError:
            raise
        except Exception as error:  # NumPy and zipfile raise whatever their parsers raise
            raise _unusable(
                "file.unreadable", f"cannot be read ({type(error).__name__}: {error})", path
            ) from error

    @classmethod
    def _of(cls, arrays: dict[str, Any], meta: dict[str, Any]) -> "CachedScan":
        plane, surfels, bounds = arrays["plane"], arrays["surfels"], arrays["bounds"]
        sheet = None if meta["sheet"] is None else Sheet.of(meta["sheet"])
        interface = Interface(plane[0], plane[1], plane[2:], meta["roughness_m"], sheet)
        hint = None
        if meta["hint"] is not None:
            kind, encloses = meta["hint"]
            hint = InterfaceHint(interface, arrays["anchors"], encloses, kind)
        rock_m, pedestal_m, height = arrays["rock_points"], arrays["pedestal_points"], meta["height_m"]
        low, lit = near_the_interface(interface.over(rock_m), interface.over(pedestal_m), height)
        patches = Surfels(surfels[:, :3], surfels[:, 3:6], surfels[:, 6], meta["voxel_m"])
        observed = ObservedRock(
            rock_m, pedestal_m, rock_m[low], pedestal_m[lit], patches, arrays["patches"], height, hint
        )
        rock = Rock.from_triangles(arrays["rock_vertices"], arrays["rock_faces"], where=SCAN_DATA)
        surface = (arrays["pedestal_vertices"], arrays["pedestal_faces"]) if meta["surface"] else (None, None)
        inspection = Inspection(
            arrays["touching"],
            arrays["open"],
            tuple((float(a), float(r)) for a, r in meta["pulls"]),
            meta["base"],
            bool(meta["touch_only"]),
        )
        return cls(
            observed=observed,
            interface=interface,
            closed=ClosedRock(rock, *meta["shares"]),
            pedestal=Pedestal(*arrays["pedestal_plane"], *surface),
            origin_m=bounds[0],
            bounds_m=bounds[1:],
            report=meta["report"],
            inspection=inspection,
            unaided=meta["unaided"],
            stated=meta["said"],
        )


Progress = Callable[[str], None]

STAGES = 6
OUTLINES = "contacts.geojson"
_BESIDE_PER_HEIGHT, _UNDERSIDE_PER_HEIGHT = 0.1, 0.25
"""Heights over the interface up to which points of the pedestal, and of the rock, tell about it and the base."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What a scan became."""

    scene: Scene
    label: NDArray[np.int8]  # (n,): per point of the cloud: 0 rock, 1 pedestal, 2 neither
    # What the user should know of the clouds: units that were converted, points left out, coarse steps, a size.
    notes: tuple[str, ...] = ()
    cached: CachedScan | None = None  # what is kept for hints that come later


def survey(
    cloud: Cloud,
    progress: Progress = lambda _: None,
    near_m: tuple[float, float] | None = None,
    hint: InterfaceHint | None = None,
    inspection: Inspection | None = None,
) -> Survey:
    """Register, segment, close and measure.

    Parameters
    ----------
    cloud : Cloud
    progress : callable
        Called with the name of each of the `STAGES` as it begins.
    near_m : pair of float, optional
        Survey coordinates x, y near the top of the rock that is meant, where several stand.
    hint : InterfaceHint, optional
        The interface as the user knows it, survey coordinates.
    inspection : Inspection, optional
        What the user knows of the base, survey coordinates.

    Raises
    ------
    InputError
        If the cloud shows no rock that stands on a pedestal, one that hangs below its base, or one of a size that no
        rock has; or what the user says of the base contradicts it.
    """
    result, label, notes = work_out(cloud, progress, near_m, hint, inspection)
    progress("drawing the hidden base")
    scene, cached = result.scene()
    return Survey(scene, label, notes, cached)


def work_out(
    cloud: Cloud | Registered,
    progress: Progress = lambda _: None,
    near_m: tuple[float, float] | None = None,
    hint: InterfaceHint | None = None,
    inspection: Inspection | None = None,
) -> tuple[CachedScan, NDArray[np.int8], tuple[str, ...]]:
    """Everything of :func:`survey` but the hidden base, the label of each point, and notes."""
    inspection = inspection or Inspection()
    inspection.check(*cloud.bounds_m)
    progress("registering stations")
    fitted = cloud if isinstance(cloud, Registered) else registered(cloud)
    cloud = fitted.cloud
    near = None if near_m is None else _inside_cloud(near_m, cloud)
    if hint is not None:
        check_near(hint, cloud.bounds_m)
        hint = hint.moved(cloud.origin_m)
    progress("splitting rock from pedestal")
    if cloud.label is None:
        parts = segment(cloud.points_m, cloud.origin_m, near, hint)
    else:
        parts = as_labelled(cloud.points_m, cloud.label, hint)
    hint = parts.hint
    progress("fitting the interface")
    parts, interface = _classified(cloud, parts, hint)
    seen = _seen(cloud, parts, hint, interface)
    check_size(seen.observed.height_m, "units")
    check_above(seen.observed, seen.interface)
    check_inspection(seen.observed, seen.interface, inspection.moved(cloud.origin_m))
    progress("closing the rock")
    try:
        closed = seen.closed
    except InputError as error:
        raise with_unseen_range(error, seen.observed, seen.interface, cloud.origin_m) from error
    leaves, doubted = left_over(closed.rock, seen.observed)
    if doubted:
        seen = _seen(cloud, relabelled(cloud.points_m, parts, leaves, NEITHER), hint, interface)
        closed = seen.closed
    observed, interface, height_m = seen.observed, seen.interface, seen.observed.height_m
    notes = [f"{source.name}: {source.note}" for source in cloud.sources if source.note]
    if cloud.coarsest is not None:
        notes.append(step_note(cloud.coarsest.step_m, height_m, cloud.coarsest.name))
    if cloud.label is None and len(observed.low_m):
        notes.append(mesh_note(cloud.edge_m(*bounds_of(observed.low_m)), observed.surfels.voxel_m))
    doubted += warnings_of(observed, interface, closed, cloud.points_m, seen.label, cloud.origin_m)
    progress("meshing the pedestal")
    ground = pedestal_ground(observed.surfels, seen.pedestal, closed.rock, interface)
    if seen.in_reach.any():
        around = mesh_surroundings(observed.surfels, observed.patches, seen.in_reach, interface, height_m)
        ground = ground.with_surroundings(around, interface, height_m)
    report = {
        **_surface_report(closed, interface, "fit" if hint is None else hint.kind, ground),
        **({"not_free": {doubt.kind: doubt.sentence for doubt in doubted}} if doubted else {}),
        "segmentation": {
            "rock_points": int((seen.label == ROCK).sum()),
            "pedestal_points": int((seen.label == PEDESTAL).sum()),
            "neither_points": int((seen.label == NEITHER).sum()),
            "resolution_m": parts.surfels.voxel_m,
            "other_candidates": [{"top_m": [*other[:3]], "height_m": other[3]} for other in parts.others],
        },
        "registration": fitted.report,
        "files": [source.to_json() for source in cloud.sources]
        or [{"name": name, "points": points} for name, points in cloud.files],
        "uncertainty": spread_of(closed),
    }
    notes += [*parts.notes, too_large(height_m, closed.rock.volume_m3)]
    notes += [doubt.sentence for doubt in doubted]
    seat = ground.pedestal, cloud.origin_m, fitted.bounds_m
    cached = CachedScan(observed, interface, closed, *seat, report, inspection)
    return cached, seen.label, tuple(filter(None, notes))


def _inside_cloud(near_m: tuple[float, float], cloud: Cloud) -> Array:
    """x, y near the rock's top in the cloud's frame, refused where the cloud shows nothing."""
    near, (low, high) = np.asarray(near_m, float), cloud.bounds_m[:, :2]
    if not ((near >= low) & (near <= high)).all():
        raise outside_cloud(near_m, low, high, "--near", "x and y of the rock's top")
    return near - cloud.origin_m[:2]


@dataclass(frozen=True, eq=False)
class _Seen:
    """What was seen of rock and pedestal."""

    observed: ObservedRock
    label: NDArray[np.int8]  # (n,), of each point
    pedestal: Flags  # (k,): which patches are the pedestal's
    interface: Interface
    in_reach: Flags  # (k,): which are in reach of the tilting rock, and no map of heights shows them

    @property
    def closed(self) -> ClosedRock:
        """The rock closed with its base."""
        observed, interface = self.observed, self.interface
        base = hidden_base(observed.near(interface), observed.hint, interface)
        return close_rock(observed.surfels, observed.patches, base, interface)


def _classified(
    cloud: Cloud, parts: Segmentation, hint: InterfaceHint | None
) -> tuple[Segmentation, Interface]:
    """Rock, pedestal and interface, by the crevice at full resolution."""
    surfels, rock = parts.surfels, parts.surfel_label == ROCK
    interface = fit_interface(surfels, rock) if hint is None else hint.interface
    height = float(np.ptp(surfels.points_m[rock, 2]))
    if hint is None or not hint.encloses:
        plane = None if hint is None else interface
        surface = pedestal_surface(surfels, rock, height, plane)
        if surface is not None and cloud.label is None:
            parts = cut_over(cloud.points_m, parts, surface)
            rock = parts.surfel_label == ROCK
        interface = surface or interface
    if cloud.label is None:
        parts = without_ground(cloud.points_m, parts, interface, height)
        rock = parts.surfel_label == ROCK
        apart = seen_apart(surfels, rock, interface, height)
        near_interface = cloud.points_m, parts.label, interface, height, surfels.voxel_m, apart
        label = judge_crevice(*near_interface, given=hint is not None)
        parts = replace(parts, label=label, surfel_label=label_surfels(surfels, cloud.points_m, label))
        parts = without_ground(cloud.points_m, parts, interface, height)
    return parts, interface


def _seen(cloud: Cloud, parts: Segmentation, hint: InterfaceHint | None, interface: Interface) -> _Seen:
    """What was seen of the parts about their interface."""
    label, surfels, surfel_label = parts.label, parts.surfels, parts.surfel_label
    rock, pedestal = surfel_label == ROCK, surfel_label == PEDESTAL
    height = float(np.ptp(surfels.points_m[rock, 2]))
    in_reach = surroundings_met(surfels, rock, pedestal, interface, height)
    if interface.sheet is None and in_reach.any():
        interface = level_surface(surfels, rock, height, interface)
    if hint is not None:
        top = pedestal & (surfels.normals @ interface.normal > UPWARD)
        top &= np.abs(interface.over(surfels.points_m)[:, 2]) < _BESIDE_PER_HEIGHT * height
        check_seen(int(top.sum()), "pedestal's top", given=True)
    standing, below = _near_interface(cloud.points_m, label, interface, height)
    low, lit = near_the_interface(interface.over(standing), interface.over(below), height)
    observed = ObservedRock(standing, below, standing[low], below[lit], surfels, rock, height, hint)
    return _Seen(observed, label, pedestal, interface, in_reach)


def _near_interface(
    points_m: Array, label: NDArray[np.int8], interface: Interface, height_m: float
) -> tuple[Array, Array]:
    """Rock's and pedestal's points about the interface, each of them thinned evenly if they are more than is needed."""
    over = interface.height_m(points_m)
    rock = np.flatnonzero((label == ROCK) & (over < _UNDERSIDE_PER_HEIGHT * height_m))
    level = np.flatnonzero((label == PEDESTAL) & (np.abs(over) < _BESIDE_PER_HEIGHT * height_m))
    standing, below = points_m[at_most(rock, SAMPLED_POINTS)], points_m[level]
    if len(standing):
        margin = 2.0 * _BESIDE_PER_HEIGHT * height_m
        low, high = bounds_of(standing[:, :2])
        below = below[inside_box(below[:, :2], low - margin, high + margin)]
    return standing, at_most(below, SAMPLED_POINTS)


def _surface_report(
    closed: ClosedRock, interface: Interface, given_by: str, ground: Ground
) -> dict[str, Any]:
    return {
        "interface": {
            "given_by": given_by,
            "roughness_m": interface.roughness_m,
            **({} if interface.sheet is None else {"carried": interface.sheet.sentence}),
            **({} if ground.surroundings is None else {"beside": ground.surroundings}),
            "outline_m": ground.outline_m.tolist(),
            "edges_m": [edge.tolist() for edge in ground.edges_m],
        },
        "surface": {share: getattr(closed, share) for share in SHARES},
    }


def _contact_outlines(scene: Scene) -> dict[str, Any]:
    """GeoJSON of where a scanned rock may touch its pedestal: polygons in the clouds' coordinates and metres.

    `probability` is the share of the drawn bases whose contacts enclose the polygon; null: it encloses all contacts.
    """
    interface = scene.report["interface"]
    rings = [(None, interface["outline_m"])]
    rings += [(ring["probability"], ring["outline_m"]) for ring in interface.get("outlines", [])]
    return {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": {"probability": probability},
                "geometry": {
                    "type": "Polygon",
                    "coordinates": [(np.array([*ring, ring[0]]) + scene.origin_m).round(4).tolist()],
                },
            }
            for probability, ring in rings
        ],
    }


def save_survey(
    result: Survey,
    folder: str | os.PathLike[str],
    also: Callable[[Path], object] = lambda _: None,
    replaces: bool = False,
) -> Path:
    """Write the scene's folder, complete or not at all, with `labels.npz` and the outlines of its possible contacts.

    also: writes into the folder, such as a picture.

    Raises
    ------
    FileExistsError
        If the folder exists already, and the scene does not replace it.
    """
    target = Path(folder)
    with (replaced_folder if replaces else new_folder)(target) as staging:
        np.savez_compressed(staging / LABELS, label=result.label)
        digest.seal_archive(staging / LABELS)
        if result.cached is not None:
            result.cached.write(staging / SCAN_DATA)
        if result.scene.unseen is not None:
            outlines = json.dumps(_contact_outlines(result.scene), indent=1)
            (staging / OUTLINES).write_text(outlines, encoding="utf-8")
        result.scene.write_into(staging)
        also(staging)
    return target


_ABOVE_SHARE = 0.1
"""Height above its foot of what holds a leaning rock, and how far a rock that settles moves, over its height."""

_AS_GIVEN = "Rock and pedestal are the two meshes as they were given; no base is drawn and no interval stated"
_LEANS = f"the rock leans: without what touches it above its foot it does not stand. {_AS_GIVEN}"
_TOUCHES = f"the rock stands only where the two meshes touch: their gap is open around it. {_AS_GIVEN}"


@dataclass(frozen=True, eq=False)
class SeparatedMeshes:
    """A closed mesh and the mesh on which it rests, survey coordinates."""

    body: Mesh
    surface: Mesh

    @cached_property
    def scene(self) -> Scene | None:
        """The two as they are; None where they are no rock at rest."""
        try:
            return Scene.from_mesh(self.body, pedestal=self.surface, units="m")
        except InputError:
            return None

    def surveyed(self, survey: Callable[[], Survey], hinted: bool) -> Survey:
        """What a survey makes of their points; or the two as they are, where no base that it draws holds the rock.

        hinted: whether the user knows something of the base, which is not set aside.
        """
        if _rises_around(self.surface, self.body[0]) and self.scene is not None and self.scene.grounded.leans:
            return _as_given(self.scene, _LEANS)
        try:
            return survey()
        except ContradictionError:
            if hinted or self.scene is None:
                raise
        return _as_given(self.scene, _TOUCHES)


def _as_given(scene: Scene, note: str) -> Survey:
    return Survey(scene, np.zeros(0, np.int8), (note,))


def _rises_around(surface: Mesh, rock_m: Array) -> bool:
    """Whether a pedestal reaches above the foot of a rock's vertices (n, 3), within reach of them.

    To find the contacts of large meshes takes a minute: where nothing can hold the rock they are not looked for.
    """
    low, high = rock_m.min(axis=0), rock_m.max(axis=0)
    margin_m = _ABOVE_SHARE * float(high[2] - low[2])
    vertices, faces = surface
    corners = vertices[faces]
    first, last = corners.min(axis=1), corners.max(axis=1)
    near = (first[:, :2] <= high[:2] + margin_m) & (last[:, :2] >= low[:2] - margin_m)
    return bool((near.all(axis=1) & (last[:, 2] > low[2] + margin_m)).any())
