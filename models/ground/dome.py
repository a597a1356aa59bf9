"""Whether ground is a smooth dome below a rock's flat base, and the polynomial that is its height."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from toppling.models.compiled import Array, Flags
from toppling.models.ground.curved import NO_CURVED, CurvedGround
from toppling.models.ground.mesh import ContactMesh
from toppling.models.relief import height_below

_DEGREE = 4
"""Of the polynomial in two variables."""

_REACH = 1.25
"""Times the base's own, from its centre: within it the polynomial is fitted."""

_SAMPLES = 33
"""Across it in each direction."""

_OFF_SHARE, _OFF_DEG = 1e-4, 2.0
"""Of the rock's size, and of angles: by which triangles may be off the fitted surface."""

_LEAST_TURN_DEG = 2.5
"""By which the surface turns within its reach: one that turns less below the base is a plane (:mod:`ground.plane`)."""

_HOLLOW = 0.02
"""Share of the largest curvature by which the surface may be hollow in the other direction: that of a cylinder."""

_ABOVE_SHARE = 0.005
"""Of the rock's size: ground beside the dome that is higher over the plane is met by a rock that tilts."""

_COPLANAR_SHARE, _WHOLE_SHARE = 1e-5, 2e-3
"""Of the rock's size: triangles so near a plane are in it. Of its area: what a base may lack within its outline."""

_LEAST_DOWNWARD = np.cos(np.radians(15.0))
"""Of the outward normals of a base."""

_LEAST_TILT, _MOST_TILT = np.radians(15.0), np.radians(60.0)
"""Of the base, up to which nothing else of the rock can touch: with less it is no flat base."""

_UNDERRATED = 1.5
"""Times that a place beside an outline is farther from it than from its edges' lines, at most."""

_ZOOMS = 6


def powers() -> Array:
    """Powers (15, 2) of the two variables, in the order of the coefficients."""
    return np.array([(i, j) for j in range(_DEGREE + 1) for i in range(_DEGREE + 1 - j)])


def curved_ground(
    rock: ContactMesh, ground: ContactMesh, placed: tuple[Array, Array], size_m: float
) -> CurvedGround:
    """The dome on which a flat base rolls: `NO_CURVED` where the base is not flat, or the ground no smooth dome.

    Parameters
    ----------
    rock, ground : ContactMesh
        Body axes, support frame.
    placed : (3,) and (3, 3) arrays
        Centre of mass and rotation of the rock where it rests.
    size_m : float
    """
    com, turn = placed
    base = _flat_base(rock, turn, size_m)
    if base is None:
        return NO_CURVED
    corners, normal, tilt = base
    there = corners @ turn.T + com
    centre = there[:, :2].mean(axis=0)
    radius = _REACH * float(np.linalg.norm(there[:, :2] - centre, axis=1).max())
    coefficients = _fitted(ground, centre, radius, size_m)
    if coefficients is None:
        return NO_CURVED
    outside = np.linalg.norm(ground.vertices_m[:, :2] - centre, axis=1) > radius
    if (ground.vertices_m[outside, 2] > _ABOVE_SHARE * size_m).any():
        return NO_CURVED
    # The rock that rests on triangles touches the smooth surface.
    coefficients[0] += _least_gap_m(there, coefficients, centre, radius)
    count, at = len(corners), (coefficients, centre, radius, corners, normal, float(np.cos(tilt)))
    return CurvedGround(*at, np.zeros((count, 6)), np.full(count, 0.5), centre.copy())


def _flat_base(rock: ContactMesh, turn: Array, size_m: float) -> tuple[Array, Array, float] | None:
    """Corners (n, 3) of a flat base, counter-clockwise from above, its outward normal, and how far it may tilt, rad."""
    at = rock.vertices_m[rock.faces]
    area = 0.5 * np.linalg.norm(np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]), axis=1)
    low = rock.normals @ turn[2] < -_LEAST_DOWNWARD
    if not low.any():
        return None
    largest = np.where(low, area, 0.0).argmax()
    normal, offset = rock.normals[largest], rock.offsets_m[largest]
    height = offset - rock.vertices_m @ normal
    in_plane = np.abs(height) <= _COPLANAR_SHARE * size_m
    faces = in_plane[rock.faces].all(axis=1) & (rock.normals @ normal > 0.5)
    one = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    one /= np.linalg.norm(one)
    flat = rock.vertices_m @ np.column_stack(
        [one, np.cross(one, normal)]
    )  # seen from above: against the normal
    used = np.unique(rock.faces[faces])
    hull = ConvexHull(flat[used])
    if not abs(hull.volume - area[faces].sum()) <= _WHOLE_SHARE * hull.volume:
        return None
    beyond = (flat @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1)
    others = np.setdiff1d(np.unique(rock.faces), used)
    tilt = np.arctan2(height[others], _UNDERRATED * np.maximum(beyond[others], 0.0)).min(initial=_MOST_TILT)
    if tilt < _LEAST_TILT:
        return None
    return np.ascontiguousarray(rock.vertices_m[used[hull.vertices]]), normal.copy(), float(tilt)


def _fitted(ground: ContactMesh, centre: Array, radius: float, size_m: float) -> Array | None:
    """Coefficients (15,) of a smooth dome within a circle; None where the ground there is none."""
    ticks = np.linspace(-1.0, 1.0, _SAMPLES)
    grid = np.array([(x, y) for x in ticks for y in ticks if x * x + y * y <= 1.0])
    height = height_below(centre + radius * grid, ground.vertices_m, ground.faces, highest=True)
    if not np.isfinite(height).all():
        return None
    exponents = powers()
    terms = (grid[:, None, :] ** exponents).prod(axis=2)
    coefficients = np.linalg.lstsq(terms, height, rcond=None)[0]
    if np.abs(terms @ coefficients - height).max() > _OFF_SHARE * size_m:
        return None
    if not _is_dome(coefficients, grid, radius) or not _follows(ground, coefficients, centre, radius).all():
        return None
    return coefficients


def _is_dome(coefficients: Array, grid: Array, radius: float) -> bool:
    """Whether a polynomial curves downward at places in its unit circle, and not too little."""
    xx, xy, yy = (_derived(coefficients, grid, *each) / radius**2 for each in ((2, 0), (1, 1), (0, 2)))
    mean, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    least, most = mean - apart, mean + apart
    turn_deg = np.degrees(-least * radius)
    return bool((turn_deg > _LEAST_TURN_DEG).all() and (most <= -_HOLLOW * least).all())


def _follows(ground: ContactMesh, coefficients: Array, centre: Array, radius: float) -> Flags:
    """Whether the triangles whose middle lies in the circle have the fitted surface's normal."""
    middle = (ground.vertices_m[ground.faces].mean(axis=1)[:, :2] - centre) / radius
    within = (middle**2).sum(axis=1) < 1.0
    slopes = [_derived(coefficients, middle[within], *each) / radius for each in ((1, 0), (0, 1))]
    normal = np.column_stack([-slopes[0], -slopes[1], np.ones(len(slopes[0]))])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    follows: Flags = (normal * ground.normals[within]).sum(axis=1) >= np.cos(np.radians(_OFF_DEG))
    return follows


def _derived(coefficients: Array, places: Array, along_x: int, along_y: int) -> Array:
    """A derivative of the polynomial with respect to its variables, at places (n, 2)."""
    factor, exponents = np.ones(len(coefficients)), powers().astype(float)
    for axis, times in ((0, along_x), (1, along_y)):
        for _ in range(times):
            factor *= exponents[:, axis]
            exponents[:, axis] = np.maximum(exponents[:, axis] - 1.0, 0.0)
    return (places[:, None, :] ** exponents).prod(axis=2) @ (factor * coefficients)


def _least_gap_m(corners_m: Array, coefficients: Array, centre: Array, radius: float) -> float:
    """Least height of a base (n, 3) over the surface."""
    hull = ConvexHull(corners_m[:, :2])
    plane = np.linalg.lstsq(
        np.column_stack([corners_m[:, :2], np.ones(len(corners_m))]), corners_m[:, 2], rcond=None
    )[0]
    at, wide, least = centre, radius, np.inf
    for _ in range(_ZOOMS):
        ticks = np.linspace(-wide, wide, _SAMPLES)
        places = at + np.array([(x, y) for x in ticks for y in ticks])
        within = (places @ hull.equations[:, :2].T + hull.equations[:, 2] <= 1e-12).all(axis=1)
        places = np.vstack([places[within], corners_m[:, :2]])
        gaps = places @ plane[:2] + plane[2] - _derived(coefficients, (places - centre) / radius, 0, 0)
        at, least, wide = places[gaps.argmin()], float(gaps.min()), 0.15 * wide
    return least
