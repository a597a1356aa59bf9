"""Ground that is a smooth dome below a flat base: its polynomial, and where a face, edges and corners are nearest."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from toppling.models.compiled import Array, Flags, Vector, compiled, inner
from toppling.models.ground.contacts import CONTACT
from toppling.models.ground.mesh import ContactMesh
from toppling.models.ground.rigid import cross, dot, minus, move, plus, rotation_of, turned
from toppling.models.relief import height_below

FIRST_KEY = 3 << 60
"""Of contacts: corners, then edges, then the face."""

_ROUNDS = 30
"""Of Newton's method, at most."""

_CYLINDRICAL = 1e-4
"""Share of its square that the product of two curvatures must have: with less, edges alone touch the dome."""

_LEVEL = 1e-12
"""Slope that is none."""


class CurvedGround(NamedTuple):
    """A dome in the support frame, and the flat base over it in body axes."""

    coefficients: Array  # (15,): of the height, as `powers` orders them; none where the ground is no dome
    centre_m: Array  # (2,)
    radius_m: float  # within which it is one, and unit of the polynomial's variables
    corners: Array  # (n, 3): of the base, counter-clockwise from above
    normal: Array  # (3,): out of the base
    least_upward: float  # cosine of the base's tilt up to which nothing else of the rock can touch
    placed: Array  # (n, 6): corners in a pose; height of the dome there, its slopes
    shares: Array  # (n,): where the edges touched last
    place: Array  # (2,): where the face did


_NOWHERE = np.zeros(0), np.zeros(2), 1.0, np.zeros((0, 3)), np.zeros(3), 1.0
NO_CURVED = CurvedGround(*_NOWHERE, np.zeros((0, 6)), np.zeros(0), np.zeros(2))
"""That of ground which is no dome."""


def untouched(on: CurvedGround) -> CurvedGround:
    """The same, with the places from which Newton's method starts as they were at first."""
    return on._replace(
        placed=np.zeros_like(on.placed), shares=np.full_like(on.shares, 0.5), place=on.centre_m.copy()
    )


@inner
def curved_contacts(on: CurvedGround, pose: Array, margin_m: float, turn: Array, out: Any) -> int:
    """Contacts with gaps up to a margin, in a pose (7,); how many, -1 where the base is not over the dome."""
    rotation_of(pose, turn)
    down = turned(turn, on.normal)
    if -down[2] < on.least_upward or not _place(on, pose, turn):
        return -1
    corners, count = len(on.corners), 0
    nearer = _nearer_within(on, corners - 1)
    for k in range(corners):
        before, nearer = nearer, _nearer_within(on, k)
        a, b = on.placed[k], on.placed[(k + 1) % corners]
        if nearer:
            way = minus(b, a)
            p = plus(a, _least_share(on, k, a, way), way)
            count = _add(out, count, FIRST_KEY + corners + k, p, _height(on, p[0], p[1]), margin_m, pose)
        elif not before:  # else an edge beside the corner is nearer than it
            count = _add(out, count, FIRST_KEY + k, a, (a[3], a[4], a[5]), margin_m, pose)
    if _touches_within(on, down):
        x, y = on.place[0], on.place[1]
        z = on.placed[0, 2] - ((x - on.placed[0, 0]) * down[0] + (y - on.placed[0, 1]) * down[1]) / down[2]
        count = _add(out, count, FIRST_KEY + 2 * corners, (x, y, z), _height(on, x, y), margin_m, pose)
    return count


@compiled(allocates=True)
def tipped_over_m(
    on: CurvedGround,
    rest: Array,
    up: Array,
    outward: Array,
    turn_rad: float,
    most_rad: float,
    touching_m: float,
) -> float:
    """Greatest height, along a direction, of a rock's centre of mass that is tipped until it sinks or has tipped most.

    From a pose (7,) in which it rests, about its outermost contact, by so much at a time. What it has reached where the
    base is over the dome no longer.
    """
    pose, out = rest.copy(), np.zeros(2 * len(on.corners) + 1, CONTACT)
    turn, spin = np.zeros((3, 3)), np.zeros(6)
    axis = cross(up, outward)
    for k in range(3):
        spin[3 + k] = turn_rad * axis[k]
    highest = dot(pose, up)
    for _ in range(int(most_rad / turn_rad)):
        count = curved_contacts(on, pose, touching_m, turn, out)
        if count <= 0:
            return highest
        pivot = 0
        for k in range(1, count):
            pivot = k if dot(out[k].place_m, outward) > dot(out[pivot].place_m, outward) else pivot
        arm = minus(pose, out[pivot].place_m)
        across, along = cross(axis, arm), (1.0 - math.cos(turn_rad)) * dot(axis, arm)
        for k in range(3):
            there = math.cos(turn_rad) * arm[k] + math.sin(turn_rad) * across[k] + along * axis[k]
            pose[k] = out[pivot].place_m[k] + there
        move(pose, spin, 1.0)
        for _ in range(_ROUNDS):
            rise = _rise_m(out, curved_contacts(on, pose, np.inf, turn, out), up)
            for k in range(3):
                pose[k] += rise * up[k]
            if not abs(rise) > 1e-3 * touching_m:
                break
        height = dot(pose, up)
        if height < highest:
            return highest
        highest = height
    return np.inf


@inner
def _rise_m(contacts: Any, count: int, up: Array) -> float:
    """By how much a rock must rise until it just touches."""
    rise = -np.inf
    for k in range(count):
        rise = max(rise, -contacts[k].gap_m / dot(contacts[k].normal, up))
    return rise if count > 0 else 0.0


@inner
def only_rolls(on: CurvedGround, contacts: Any, count: int) -> bool:
    """Whether a rock touches with no corner, and with nothing but its base."""
    rolls = count > 0
    for k in range(count):
        rolls = rolls and len(on.corners) <= contacts[k].key - FIRST_KEY <= 2 * len(on.corners)
    return rolls


@inner
def _nearer_within(on: CurvedGround, edge: int) -> bool:
    """Whether an edge is nearer to the dome between its ends than at them."""
    a, b = on.placed[edge], on.placed[(edge + 1) % len(on.corners)]
    way = minus(b, a)
    least = _LEVEL * math.sqrt(dot(way, way))
    falls = way[2] - a[4] * way[0] - a[5] * way[1] < -least
    return falls and way[2] - b[4] * way[0] - b[5] * way[1] > least


@inner
def _place(on: CurvedGround, pose: Array, turn: Array) -> bool:
    """Note the corners in a pose, and the dome at them; whether all are over it."""
    for k in range(len(on.corners)):
        p = plus(pose, 1.0, turned(turn, on.corners[k]))
        if (p[0] - on.centre_m[0]) ** 2 + (p[1] - on.centre_m[1]) ** 2 > on.radius_m**2:
            return False
        height = _height(on, p[0], p[1])
        for i in range(3):
            on.placed[k, i], on.placed[k, 3 + i] = p[i], height[i]
    return True


@inner
def _add(out: Any, count: int, key: int, p: Any, height: Vector, margin_m: float, pose: Array) -> int:
    """Note a contact of a place of the rock over the dome's height and slopes there, if it is near."""
    long = math.sqrt(1.0 + height[1] ** 2 + height[2] ** 2)
    gap = (p[2] - height[0]) / long
    if not -margin_m < gap < margin_m or count == len(out):
        return count
    one = out[count]
    one.key, one.gap_m, one.lands, one.floor_m_s = key, gap, 0, 0.0
    one.normal[0], one.normal[1], one.normal[2] = -height[1] / long, -height[2] / long, 1.0 / long
    for k in range(3):
        one.place_m[k], one.arm_m[k], one.impulse[k] = p[k], p[k] - pose[k], 0.0
    return count + 1


@inner
def _least_share(on: CurvedGround, edge: int, start: Any, way: Any) -> float:
    """Share of the way along an edge at which it is nearest to the dome."""
    low, high, share = 0.0, 1.0, on.shares[edge]
    for _ in range(_ROUNDS):
        x, y = start[0] + share * way[0], start[1] + share * way[1]
        _, right, up = _height(on, x, y)
        bend = _bend(on, x, y)
        slope = way[2] - right * way[0] - up * way[1]
        turns = -(bend[0] * way[0] ** 2 + 2.0 * bend[1] * way[0] * way[1] + bend[2] * way[1] ** 2)
        if slope < 0.0:
            low = share
        else:
            high = share
        then = share - slope / turns if turns > 0.0 else 0.5 * (low + high)
        if not low < then < high:
            then = 0.5 * (low + high)
        done = abs(then - share) < 1e-12
        share = then
        if done:
            break
    on.shares[edge] = share
    return share


@inner
def _touches_within(on: CurvedGround, down: Vector) -> bool:
    """Find where the dome is parallel to the base; whether it is there, and within the base's edges."""
    x, y, found = on.place[0], on.place[1], False
    for _ in range(_ROUNDS):
        _, right, up = _height(on, x, y)
        bend = _bend(on, x, y)
        det, trace = bend[0] * bend[2] - bend[1] ** 2, bend[0] + bend[2]
        if not det > _CYLINDRICAL * trace * trace:
            return False
        a, b = -down[0] / down[2] - right, -down[1] / down[2] - up
        one, other = (bend[2] * a - bend[1] * b) / det, (bend[0] * b - bend[1] * a) / det
        x, y = x + one, y + other
        if (x - on.centre_m[0]) ** 2 + (y - on.centre_m[1]) ** 2 > on.radius_m**2:
            return False
        found = one * one + other * other < 1e-24 * on.radius_m**2
        if found:
            break
    if not found:
        return False
    on.place[0], on.place[1] = x, y
    corners = len(on.corners)
    for k in range(corners):
        a, b = on.placed[k], on.placed[(k + 1) % corners]
        if (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) <= 0.0:
            return False
    return True


@inner
def _height(on: CurvedGround, x_m: float, y_m: float) -> Vector:
    """Height of the dome, m, and its slopes along x and y."""
    c, r = on.coefficients, on.radius_m
    x, y = (x_m - on.centre_m[0]) / r, (y_m - on.centre_m[1]) / r
    # Horner's rule in y, of the polynomials in x that multiply its powers.
    p0 = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * c[4])))
    p1 = c[5] + x * (c[6] + x * (c[7] + x * c[8]))
    p2, p3, p4 = c[9] + x * (c[10] + x * c[11]), c[12] + x * c[13], c[14]
    d0 = c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * 4.0 * c[4]))
    d1, d2, d3 = c[6] + x * (2.0 * c[7] + x * 3.0 * c[8]), c[10] + x * 2.0 * c[11], c[13]
    height = p0 + y * (p1 + y * (p2 + y * (p3 + y * p4)))
    right = (d0 + y * (d1 + y * (d2 + y * d3))) / r
    up = (p1 + y * (2.0 * p2 + y * (3.0 * p3 + y * 4.0 * p4))) / r
    return height, right, up


@inner
def _bend(on: CurvedGround, x_m: float, y_m: float) -> Vector:
    """Second derivatives of the dome's height: along x twice, along both, along y twice, 1/m."""
    c, r = on.coefficients, on.radius_m
    x, y = (x_m - on.centre_m[0]) / r, (y_m - on.centre_m[1]) / r
    e0 = 2.0 * c[2] + x * (6.0 * c[3] + x * 12.0 * c[4])
    e1, e2 = 2.0 * c[7] + x * 6.0 * c[8], 2.0 * c[11]
    d1, d2, d3 = c[6] + x * (2.0 * c[7] + x * 3.0 * c[8]), c[10] + x * 2.0 * c[11], c[13]
    p2, p3, p4 = c[9] + x * (c[10] + x * c[11]), c[12] + x * c[13], c[14]
    return (
        (e0 + y * (e1 + y * e2)) / r**2,
        (d1 + y * (2.0 * d2 + y * 3.0 * d3)) / r**2,
        (2.0 * p2 + y * (6.0 * p3 + y * 12.0 * p4)) / r**2,
    )


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
