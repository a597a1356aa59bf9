"""What the user knows of where rock and pedestal meet: a measured plane, picked points or a contact outline."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.path import Path as Polygon
from numpy.typing import ArrayLike, NDArray

from toppling.models.errors import InputError, refusals
from toppling.models.frames import plane_axes, plane_normal
from toppling.models.scan.header import TEXT, named_columns
from toppling.models.scan.interface import Interface

_STEEPEST_DEG = 60.0
"""No rock stands on an interface steeper than this without sliding: friction coefficient 1.7."""
_THINNEST = 0.02
"""Picked points whose spread across is less than this share of their spread along lie on one line."""


_unusable = refusals(
    expected="three or more places x,y,z around the contact, in survey coordinates and metres",
    remedy="pick points on the line where rock and pedestal meet, spread around the rock",
)


@dataclass(frozen=True, eq=False)
class InterfaceHint:
    """What the user says about the interface, in the coordinates they said it in."""

    interface: Interface  # taken as it is; its roughness is the misfit of the points that it was given by
    anchors_m: NDArray[np.float64]  # (k, 3): places at the contact, which tell the rock that is meant
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
                f"the slope is {slope_deg} degrees",
                where="--plane",
                expected=f"0 to {_STEEPEST_DEG:.0f} degrees",
                remedy="give X Y Z, the slope, and the azimuth toward which the plane falls (from east to north)",
            )
        point = np.asarray(point_m, float)
        return cls(
            _interface(point, plane_normal(slope_deg, downhill_azimuth_deg), 0.0), point[None], False, "plane"
        )

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
            raise _unusable(f"{len(points)} points are given", where)
        centre = points.mean(axis=0)
        _, spread, axes = np.linalg.svd(points - centre, full_matrices=False)
        if spread[1] <= _THINNEST * spread[0]:
            raise _unusable("the points lie on one line", where)
        normal = axes[2] * (np.sign(axes[2, 2]) or 1.0)
        steep = float(np.rad2deg(np.arccos(min(normal[2], 1.0))))
        if steep > _STEEPEST_DEG:
            raise _unusable(f"the plane through the points slopes by {steep:.0f} degrees", where)
        misfit = float(np.sqrt((((points - centre) @ normal) ** 2).mean()))
        return cls(_interface(centre, normal, misfit), points, kind == "outline", kind)

    @classmethod
    def outline(cls, path: str | Path) -> "InterfaceHint":
        """Contact outline from a file: one vertex x, y, z a line, in order, or as its header names them.

        Raises
        ------
        InputError
            If the file is no such list.
        """
        rows: list[list[float]] = []
        columns = (0, 1, 2)
        try:
            lines = Path(path).read_text(encoding=TEXT).splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise _unusable(f"cannot be read ({error})", str(path)) from None
        for number, line in enumerate(lines, 1):
            words = line.replace(",", " ").replace(";", " ").split()
            try:
                row = [float(word) for word in words]
            except ValueError:
                if rows or number > 1:
                    raise _unusable(f"line {number} is '{line}'", str(path)) from None
                columns = named_columns([line], 3, str(path)) or columns
                continue
            if row:
                if len(row) != 3 or not np.isfinite(row).all():
                    raise _unusable(f"line {number} is '{line}'", str(path))
                rows.append(row)
        points = np.array([[row[column] for column in columns] for row in rows], float).reshape(-1, 3)
        if len(points) > 1 and np.array_equal(points[0], points[-1]):
            points = points[:-1]
        return cls.points(points, "outline")

    def moved(self, shift_m: NDArray[np.float64]) -> "InterfaceHint":
        """The same hint in coordinates from which `shift_m` is taken away."""
        plane = self.interface
        return InterfaceHint(
            Interface(plane.point_m - shift_m, plane.normal, plane.axes, plane.roughness_m),
            self.anchors_m - shift_m,
            self.encloses,
            self.kind,
        )

    def inside(self, flat_m: NDArray[np.float64]) -> NDArray[np.bool_]:
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


def check_near(
    hint: InterfaceHint,
    low_m: NDArray[np.float64],
    high_m: NDArray[np.float64],
    origin_m: NDArray[np.float64],
) -> None:
    """Refuse a hint on a place that the cloud (its bounds in the hint's frame) does not show.

    Raises InputError if an anchor lies outside the cloud.
    """
    beyond = ((hint.anchors_m < low_m) | (hint.anchors_m > high_m)).any(axis=1)
    if beyond.any():
        x, y, z = hint.anchors_m[beyond][0] + origin_m
        raise InputError(
            f"{x:.2f}, {y:.2f}, {z:.2f} lies outside the cloud",
            where=f"the interface's {hint.kind}",
            expected="survey coordinates from {:.2f}, {:.2f}, {:.2f}".format(*(low_m + origin_m))
            + " to {:.2f}, {:.2f}, {:.2f}".format(*(high_m + origin_m)),
            remedy="give places in the coordinates of the clouds, in metres",
        )


def _interface(point: NDArray[np.float64], normal: NDArray[np.float64], misfit_m: float) -> Interface:
    return Interface(point, normal, np.column_stack([*plane_axes(normal), normal]), misfit_m)
