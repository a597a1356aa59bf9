"""Hints on where rock and pedestal meet: a measured plane, picked points or a contact outline."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.path import Path as Polygon
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Flags
from toppling.models.errors import InputError, refusals
from toppling.models.files.table import Table, places_in
from toppling.models.frames import plane_normal, quadrant_of, slope_of_normal
from toppling.models.scan.hints_file import outside_cloud
from toppling.models.scan.interface import Interface, fit_interface
from toppling.models.scan.placement import COLLINEAR
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.text import named_columns

_STEEPEST_DEG = 60.0
"""No rock stands on an interface steeper than this without sliding: friction coefficient 1.7."""


_unusable = refusals(
    expected="three or more places x,y,z around the contact, in survey coordinates and metres",
    remedy="pick points on the line where rock and pedestal meet, spread around the rock",
)


@dataclass(frozen=True, eq=False)
class InterfaceHint:
    """Hint on the interface, in the coordinates in which it was given."""

    interface: Interface  # taken as it is; its roughness is the misfit of the points that it was given by
    anchors_m: Array  # (k, 3): places at the contact, which tell the rock that is meant
    # Whether the anchors are the contact's outline, in order: the rock rests inside it and nowhere else.
    encloses: bool
    kind: str  # `plane`, `points` or `outline`

    @classmethod
    def plane(cls, point_m: ArrayLike, slope_deg: float, downhill_azimuth_deg: float) -> "InterfaceHint":
        """Interface measured in the field: a point of it, its slope and the azimuth toward which it falls.

        Raises
        ------
        InputError
            If the slope is none that a rock can stand on.
        """
        if not 0.0 <= slope_deg <= _STEEPEST_DEG:
            raise InputError(
                "interface.slope_out_of_range",
                f"the slope is {slope_deg} degrees",
                where="--plane",
                expected=f"0 to {_STEEPEST_DEG:.0f} degrees",
                remedy="give X Y Z, the slope, and the azimuth toward which the plane falls (from east to north)",
            )
        point = np.asarray(point_m, float)
        plane = Interface.through(point, plane_normal(slope_deg, downhill_azimuth_deg))
        return cls(plane, point[None], False, "plane")

    @classmethod
    def points(cls, points_m: ArrayLike, kind: str = "points") -> "InterfaceHint":
        """Three or more points picked on the line where rock and pedestal meet.

        Raises
        ------
        InputError
            If they are fewer than three, lie on one line, or on a plane that no rock can stand on.
        """
        points = np.atleast_2d(np.asarray(points_m, float))
        where = f"--{kind.removesuffix('s')}"
        if len(points) < 3:
            raise _unusable("interface.too_few_places", f"{len(points)} points are given", where)
        centre = points.mean(axis=0)
        _, spread, axes = np.linalg.svd(points - centre, full_matrices=False)
        if spread[1] <= COLLINEAR * spread[0]:
            raise _unusable("interface.places_on_a_line", "the points lie on one line", where)
        normal = axes[2] * (np.sign(axes[2, 2]) or 1.0)
        steep = float(np.rad2deg(np.arccos(min(normal[2], 1.0))))
        if steep > _STEEPEST_DEG:
            raise _unusable(
                "interface.slope_out_of_range",
                f"the plane through the points slopes by {steep:.0f} degrees",
                where,
            )
        misfit = float(np.sqrt((((points - centre) @ normal) ** 2).mean()))
        return cls(Interface.through(centre, normal, misfit), points, kind == "outline", kind)

    @classmethod
    def outline(cls, path: str | Path) -> "InterfaceHint":
        """Contact outline from a file: one vertex x, y, z a line, in order, or as its header names them.

        Raises
        ------
        InputError
            If the file is no such list.
        """
        table = Table.read(Path(path), _unusable, coordinates=True)
        header, places = places_in(table, slice(3), (3,), _unusable)
        columns = named_columns([header], 3, str(path)) or (0, 1, 2)
        points = np.array([numbers for _, _, numbers in places], float).reshape(-1, 3)[:, columns]
        if len(points) > 1 and np.array_equal(points[0], points[-1]):
            points = points[:-1]
        return cls.points(points, "outline")

    def moved(self, shift_m: Array) -> "InterfaceHint":
        """Hint in coordinates from which `shift_m` is taken away."""
        plane = replace(self.interface, point_m=self.interface.point_m - shift_m)
        return replace(self, interface=plane, anchors_m=self.anchors_m - shift_m)

    def inside(self, flat_m: Array) -> Flags:
        """Which points (..., 2), u and v on the interface, lie inside the outline."""
        ring = Polygon(self.interface.flat(self.anchors_m)[:, :2])
        return ring.contains_points(flat_m.reshape(-1, 2)).reshape(flat_m.shape[:-1])


def hint_of(
    plane: Sequence[float] | None = None,
    points: Sequence[Sequence[float]] = (),
    outline: str | Path | Sequence[Sequence[float]] | None = None,
) -> InterfaceHint | None:
    """Hint from the command line's options, of which one may be given; an outline by its file or its vertices.

    Raises
    ------
    InputError
        If several are given, or the one that is given cannot be used.
    """
    given = [
        name for name, value in (("--plane", plane), ("--point", points), ("--outline", outline)) if value
    ]
    if len(given) > 1:
        raise InputError(
            "interface.given_twice",
            f"{' and '.join(given)} are given together",
            where="the interface",
            expected="one word on the interface",
            remedy="keep the one that you trust most: an outline says more than points, points more than a plane",
        )
    if plane:
        return InterfaceHint.plane(plane[:3], plane[3], plane[4])
    if points:
        return InterfaceHint.points(points)
    if isinstance(outline, str | Path):
        return InterfaceHint.outline(outline)
    return InterfaceHint.points(outline, "outline") if outline else None


def check_near(hint: InterfaceHint, bounds_m: Array) -> None:
    """Refuse a hint on a place that a cloud, by its lowest and highest survey coordinates (2, 3), does not show."""
    low_m, high_m = bounds_m
    beyond = ((hint.anchors_m < low_m) | (hint.anchors_m > high_m)).any(axis=1)
    if beyond.any():
        raise outside_cloud(hint.anchors_m[beyond][0], low_m, high_m, f"the interface's {hint.kind}")


OFF_PER_HEIGHT = 0.015
"""Largest distance of a measured interface from what was seen, over the rock's height."""
_AGREES_PER_HEIGHT = 0.002
"""Distance from what was seen within which a picked place agrees with it, over the rock's height."""
_POINTED_PER_HEIGHT = 0.05
"""Largest mean distance of picked places, over the rock's height; farther away another pedestal was
meant. One of them may be off by twice as much."""
_FOOT_PER_HEIGHT = 0.1
"""Height over the pedestal below which patches are of the rock's foot, over the rock's height."""
_ON_VOXELS = 2.0
"""Distance from the nearest patch, in their width, up to which a place lies on what was seen."""
_PLANE_PER_OFF = 1.0 / 3.0
"""Roughness of a pedestal over how far places lie off it, below which the places are off and not its plane."""


def seen_about_points(hint: InterfaceHint, surfels: Surfels, rock: Flags) -> InterfaceHint | None:
    """The pedestal's plane as it was seen, where it is known better than by the places that the user pointed at.

    A place that was clicked lies on what was seen, and beside what was meant by some centimetres, by which a plane
    through a few of them tilts by degrees. Places of which one lies on nothing seen were measured, as below soil. They
    are taken as they are, and so are a plane and an outline.

    rock: (n,), which patches are the rock's, as split by the hint.
    Returns None where the places agree with what was seen, lie too far off or on nothing, or the pedestal is no plane.
    """
    to_seen_m = cKDTree(surfels.points_m).query(hint.anchors_m)[0]
    if hint.kind != "points" or to_seen_m.max() > _ON_VOXELS * surfels.voxel_m:
        return None
    try:
        seen = fit_interface(surfels, rock)
    except InputError:  # next to nothing of it was seen, which is what hints are for
        return None
    height_m = float(np.ptp(surfels.points_m[rock, 2]))
    over_m = seen.flat(hint.anchors_m)[:, 2]
    # Below the whole base: places near each other tell little of how their plane goes on.
    lowest = seen.flat(surfels.points_m[rock])
    low = lowest[:, 2] < _FOOT_PER_HEIGHT * height_m
    lowest = np.vstack([lowest[low], seen.flat(hint.anchors_m)]) * [1.0, 1.0, 0.0]
    off_m = float(np.abs(np.append(over_m, hint.interface.flat(seen.scene(lowest))[:, 2])).max())
    elsewhere = max(abs(over_m.mean()), 0.5 * np.abs(over_m).max()) > _POINTED_PER_HEIGHT * height_m
    agrees, rough = off_m < _AGREES_PER_HEIGHT * height_m, seen.roughness_m > _PLANE_PER_OFF * off_m
    return None if elsewhere or agrees or rough else replace(hint, interface=seen)


def points_text(hint: InterfaceHint, seen: Interface) -> str:
    """Warning that the pedestal's plane was taken as it was seen, instead of given places."""
    heights_m = seen.flat(hint.anchors_m)[:, 2]
    dip_deg, toward_deg = slope_of_normal(seen.normal)
    return (
        f"the places of --point lie {heights_m.min():+.2g} to {heights_m.max():+.2g} m over "
        f"the pedestal that was seen about them, which is a plane within {seen.roughness_m:.2g} m: it was taken "
        f"instead, and dips by {dip_deg:.1f} degrees toward {quadrant_of(toward_deg)}. An interface that is to be "
        "taken as it is given is said by --plane"
    )
