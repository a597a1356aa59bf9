"""What a scan has worked out, kept beside its scene: a hint on the base then draws it anew without the clouds."""

import dataclasses
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.files import digest
from toppling.models.files.schemas import GEOMETRY, LABELS, WORKED_OUT, read_own
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.near_interface import near_the_interface
from toppling.models.hidden_base.standing import base_unseen, check_inspection
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.close import SHARES, ClosedRock
from toppling.models.scan.interface import Interface, Sheet
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.measure import ObservedRock, slenderness
from toppling.models.scan.read import Cloud
from toppling.models.scan.segment import PEDESTAL, ROCK
from toppling.models.scan.surfels import Surfels
from toppling.models.scene import Scene

SCHEMA_VERSION = 7
_MOST_BYTES = 2 << 30
"""Unpacked; a scan of 20 million points keeps less than a tenth of this."""

_unusable = refusals(
    expected=f"a scene of 'toppling scan' with its {WORKED_OUT}, as written",
    remedy="scan the clouds again with the hint",
)


@dataclass(frozen=True, eq=False)
class WorkedOut:
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
    said: Mapping[str, Any] = field(default_factory=dict)

    def with_hints(self, given: Inspection) -> "WorkedOut":
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

    def scene(self) -> tuple[Scene, "WorkedOut"]:
        """Draw the hidden base and make the scene; beside it the same with `unaided`, for the next hint.

        Raises
        ------
        InputError
            If the inspection contradicts what was seen.
        """
        self.inspection.check(*self.bounds_m)
        known = self.inspection.moved(self.origin_m)
        check_inspection(self.observed, self.interface, known)
        parts = (self.observed, self.interface, self.closed, self.pedestal)
        rock, unseen, standing = base_unseen(*parts, known, self.unaided)
        scene = Scene(rock, self.pedestal, origin_m=self.origin_m, unseen=unseen)
        # Of the draws: the closed rock's own may lie beside the weight, which each of them encloses.
        contacts = standing["contacts"]
        outlined = {name: contacts.pop(name) for name in ("outline_m", "outlines")}
        interface = {**self.report["interface"], **outlined}
        report = {
            **self.report,
            "interface": interface,
            "slenderness": slenderness(scene),
            "unseen_base": standing,
        }
        unaided = standing.get("without_inspection", standing.get("toppling"))
        return dataclasses.replace(scene, report=report), dataclasses.replace(self, unaided=unaided)

    def write(self, path: Path) -> None:
        """Write the file, with its digest."""
        np.savez(path, told=np.array(json.dumps(self._told())), **self._arrays())
        digest.seal_archive(path)

    def _told(self) -> dict[str, Any]:
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
            "said": dict(self.said),
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
    def read(cls, scene: Path) -> "WorkedOut":
        """Read what the scan of a scene's folder has worked out.

        Raises
        ------
        InputError
            If the folder keeps nothing of a scan, or a file there is damaged, of another scene or another version.
        """
        path = scene / WORKED_OUT
        if not path.is_file():
            raise _unusable("scan.not_kept", f"keeps no {WORKED_OUT}", scene)
        if not (scene / "scene.json").is_file():
            raise _unusable("scan.not_kept", "keeps no scene.json", scene)
        read_own(scene, (*GEOMETRY, LABELS, WORKED_OUT), stated=True)
        try:
            with zipfile.ZipFile(path) as archive:
                if sum(each.file_size for each in archive.infolist()) > _MOST_BYTES:
                    raise _unusable(
                        "file.too_large", f"would unpack to more than {_MOST_BYTES >> 30} GB", path
                    )
            with np.load(path, allow_pickle=False) as kept:
                arrays = {name: kept[name] for name in kept.files}
            told = json.loads(str(arrays["told"]))
            if told["schema_version"] != SCHEMA_VERSION:
                raise _unusable(
                    "document.schema_version", f"is of schema version {told['schema_version']}", path
                )
            return cls._of(arrays, told)
        except InputError:
            raise
        except Exception as error:  # NumPy and zipfile raise whatever their parsers raise
            raise _unusable(
                "file.unreadable", f"cannot be read ({type(error).__name__}: {error})", path
            ) from error

    @classmethod
    def _of(cls, arrays: dict[str, Any], told: dict[str, Any]) -> "WorkedOut":
        plane, surfels, bounds = arrays["plane"], arrays["surfels"], arrays["bounds"]
        sheet = None if told["sheet"] is None else Sheet.of(told["sheet"])
        interface = Interface(plane[0], plane[1], plane[2:], told["roughness_m"], sheet)
        hint = None
        if told["hint"] is not None:
            kind, encloses = told["hint"]
            hint = InterfaceHint(interface, arrays["anchors"], encloses, kind)
        rock_m, pedestal_m, height = arrays["rock_points"], arrays["pedestal_points"], told["height_m"]
        low, lit = near_the_interface(interface.over(rock_m), interface.over(pedestal_m), height)
        patches = Surfels(surfels[:, :3], surfels[:, 3:6], surfels[:, 6], told["voxel_m"])
        observed = ObservedRock(
            rock_m, pedestal_m, rock_m[low], pedestal_m[lit], patches, arrays["patches"], height, hint
        )
        rock = Rock.from_triangles(arrays["rock_vertices"], arrays["rock_faces"], where=WORKED_OUT)
        surface = (arrays["pedestal_vertices"], arrays["pedestal_faces"]) if told["surface"] else (None, None)
        inspection = Inspection(
            arrays["touching"],
            arrays["open"],
            tuple((float(a), float(r)) for a, r in told["pulls"]),
            told["base"],
            bool(told["touch_only"]),
        )
        return cls(
            observed=observed,
            interface=interface,
            closed=ClosedRock(rock, *told["shares"]),
            pedestal=Pedestal(*arrays["pedestal_plane"], *surface),
            origin_m=bounds[0],
            bounds_m=bounds[1:],
            report=told["report"],
            inspection=inspection,
            unaided=told["unaided"],
            said=told["said"],
        )
