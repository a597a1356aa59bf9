"""Parts of a rock below its seat: what of it hangs beyond the pedestal's edge, and where that edge runs."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Flags
from toppling.models.errors import InputError
from toppling.models.scan.doubt import Doubt, azimuth_told
from toppling.models.scan.interface import Edge, Interface, fit_interface
from toppling.models.scan.measure import ObservedRock
from toppling.models.scan.surfels import Surfels

_PER_HEIGHT = 0.03
_SHARE = 0.002
"""More than this share of the rock's patches so far below the interface are a part of it, not strays."""
_SHARE_AT_EDGE, _AT_EDGE_PER_HEIGHT = 0.0005, 0.012
"""The same where they lie beyond an edge of the pedestal."""
_FACE_PER_HEIGHT = (0.02, 0.3)
"""Depths below the interface between which a cliff's face tells where its edge is ..."""
_FACE_DIP = 0.6
"""... and sine of the steepest that its patches may lean from upright."""
_FACE_ALIKE = 0.97
"""Cosine between the normals of patches of one face."""
_LEAST_FACE, _INNER = 30, 20
_NEAR_PER_HEIGHT = 0.15
"""So near the pedestal's top, or what hangs, a face is that of its edge and not of a lower ledge."""
_CELL_PER_HEIGHT, _BLUR_PER_HEIGHT = 0.03, 0.05
"""One line of the edge stands for the patches of such a cell; places so near have its say."""
_LEAST_SAY, _AROUND = 0.3, 10
"""Of the median line's, the least say of one; and so many lines around tell whether it goes on as they do."""
_OFF_PER_HEIGHT, _MOST_OFF = 0.02, 0.1
"""How far on the wrong side of the edge patches of rock or seat may lie, and in which share of them at most more."""
_BESIDE_PER_HEIGHT = 0.06
"""What is called rock so near to what hangs is no pedestal, however near to its surface."""


def hanging(
    surfels: Surfels, rock: Flags, height_m: float, interface: Interface
) -> tuple[Flags, Interface] | None:
    """Patches (n,) of a rock that hang beyond an edge of its pedestal, and the interface up to that edge.

    rock: (n,), which are the rock's.
    height_m: of the rock.
    interface: a plane.
    Returns None where nothing hangs, or no edge shows.
    """
    hangs = _below(surfels, rock, _AT_EDGE_PER_HEIGHT * height_m, interface)
    if interface.sheet is not None or hangs.sum() <= _SHARE_AT_EDGE * rock.sum():
        return None
    lines = _alike(_edge_lines(surfels, rock, hangs, height_m, interface), height_m)
    if len(lines) == 0:
        return None
    edge = Edge(lines, _BLUR_PER_HEIGHT * height_m)
    hangs &= edge.outside_m(interface.flat(surfels.points_m)) > 0.0
    if hangs.sum() <= _SHARE_AT_EDGE * rock.sum():
        return None
    if not _divides(edge, surfels, rock, height_m, interface):
        return None
    return hangs, replace(interface, edge=edge)


def seat_of(surfels: Surfels, rock: Flags, height_m: float, interface: Interface) -> Interface:
    """The interface fitted without what was seen beside a part that hangs: the land below it."""
    hangs = _below(surfels, rock, _PER_HEIGHT * height_m, interface)
    if hangs.sum() <= _SHARE_AT_EDGE * rock.sum():
        return interface
    low = cKDTree(surfels.points_m[hangs]).query(surfels.points_m)[0] < _BESIDE_PER_HEIGHT * height_m
    kept = rock | ~low
    try:
        return fit_interface(surfels.only(kept), rock[kept])
    except InputError:
        return interface


def beside_hanging(points_m: Array, surfels: Surfels, hangs: Flags, height_m: float) -> Flags:
    """Which points (n,) lie beside the patches (k,) that hang."""
    tree = cKDTree(surfels.points_m[hangs])
    reach = _BESIDE_PER_HEIGHT * height_m
    return np.isfinite(tree.query(points_m, distance_upper_bound=reach)[0])


def strays_at_edge(over: Array, edge: Edge, height_m: float) -> Flags:
    """Which of the rock's points (n, 3: u, v, height over the plane) hang within the edge, where the pedestal is."""
    off_m = 0.5 * _OFF_PER_HEIGHT * height_m
    return np.asarray((over[:, 2] < -off_m) & (edge.outside_m(over) < off_m))


def _below(surfels: Surfels, rock: Flags, depth_m: float, interface: Interface) -> Flags:
    return rock & (interface.over(surfels.points_m)[:, 2] < -depth_m)


def _edge_lines(surfels: Surfels, rock: Flags, hangs: Flags, height_m: float, interface: Interface) -> Array:
    """Lines (k, 4) in which the planes of a cliff's patches meet the interface: u, v and the unit normal outward."""
    flat, normals = interface.flat(surfels.points_m), surfels.normals @ interface.axes
    deep, least = _FACE_PER_HEIGHT[1] * height_m, _FACE_PER_HEIGHT[0] * height_m
    face = ~rock & (flat[:, 2] < -least) & (flat[:, 2] > -deep) & (np.abs(normals[:, 2]) < _FACE_DIP)
    # Where a face ends, normals of patches are between two surfaces'.
    around = cKDTree(surfels.points_m).query(surfels.points_m[face], _AROUND)[1][:, 1:]
    alike = np.abs(np.einsum("kij,kj->ki", surfels.normals[around], surfels.normals[face]))
    face[face] = np.median(alike, axis=1) > _FACE_ALIKE
    top = _top(surfels, rock, flat, height_m, interface)
    if face.sum() < _LEAST_FACE or top.sum() < _INNER:
        return np.zeros((0, 4))
    across = np.linalg.norm(normals[face, :2], axis=1, keepdims=True)
    outward = normals[face, :2] / across
    places = flat[face, :2] + outward * (normals[face, 2:] / across) * flat[face, 2:]
    near = cKDTree(np.vstack([flat[top, :2], flat[hangs, :2]])).query(places)[0] < _NEAR_PER_HEIGHT * height_m
    if near.sum() < _LEAST_FACE:
        return np.zeros((0, 4))
    face[face] = near
    outward, places = outward[near], places[near]
    # Which side of a face is air is not told by a sky that the rock hides, but by where the top lies.
    inner = flat[top][cKDTree(flat[top]).query(flat[face], range(1, _INNER + 1))[1], :2].mean(axis=1)
    outward[((flat[face, :2] - inner) * outward).sum(axis=1) < 0.0] *= -1.0
    say = 1.0 / (least - flat[face, 2])
    cell = np.unique(np.floor(places / (_CELL_PER_HEIGHT * height_m)), axis=0, return_inverse=True)[1].ravel()
    total = [np.bincount(cell, say * each) for each in np.column_stack([places, outward]).T]
    whole = np.bincount(cell, say)
    lines = np.column_stack(total) / whole[:, None]
    length = np.linalg.norm(lines[:, 2:], axis=1)
    kept = (length > 0.5) & (whole > _LEAST_SAY * np.median(whole))
    lines[:, 2:] /= length[:, None]
    return lines[kept]


def _alike(lines: Array, height_m: float) -> Array:
    """Lines that go on as most of those around them, turned to the mean of their ways.

    Patches in the crevice beside the rock are no cliff's face, and a turn of one line counts for much below the rock.
    """
    for _ in range(2):
        if len(lines) <= _AROUND:
            return lines
        around = cKDTree(lines[:, :2]).query(lines[:, :2], _AROUND + 1)[1]
        others = lines[around[:, 1:]]
        off = ((lines[:, None, :2] - others[..., :2]) * others[..., 2:]).sum(axis=2)
        turned = (lines[:, None, 2:] * others[..., 2:]).sum(axis=2)
        fits = np.abs(np.median(off, axis=1)) < _OFF_PER_HEIGHT * height_m
        mean = lines[around, 2:].mean(axis=1)
        mean /= np.linalg.norm(mean, axis=1)[:, None]
        lines = np.column_stack([lines[:, :2], mean])[fits & (np.median(turned, axis=1) > 0.5)]
    return lines


def _top(surfels: Surfels, rock: Flags, flat: Array, height_m: float, interface: Interface) -> Flags:
    """Which patches are the pedestal's, at the interface and facing up."""
    level = np.abs(flat[:, 2]) < _FACE_PER_HEIGHT[0] * height_m
    return np.asarray(~rock & level & (surfels.normals @ interface.normal > _FACE_DIP))


def _divides(edge: Edge, surfels: Surfels, rock: Flags, height_m: float, plane: Interface) -> bool:
    """Whether the edge parts what hangs from the seat around the rock's foot."""
    flat = plane.flat(surfels.points_m)
    seat = _top(surfels, rock, flat, height_m, plane)
    seat &= cKDTree(surfels.points_m[rock]).query(surfels.points_m)[0] < 3.0 * surfels.voxel_m
    off_m = _OFF_PER_HEIGHT * height_m
    deep = _below(surfels, rock, _PER_HEIGHT * height_m, plane)
    within = (edge.outside_m(flat[deep]) < -off_m).mean() if deep.any() else 0.0
    beyond = (edge.outside_m(flat[seat]) > off_m).mean() if seat.any() else 1.0
    return bool(max(within, beyond) <= _MOST_OFF)


def check_above(observed: ObservedRock, interface: Interface) -> None:
    """Refuse a rock that goes below its interface where no edge of the pedestal shows: it would get a foot there.

    Raises InputError if more than strays of it were seen below the interface, within the edge of the pedestal.
    """
    over = interface.over(observed.surfels.points_m[observed.patches])
    below = over[:, 2] < -_PER_HEIGHT * observed.height_m
    if interface.edge is not None:
        below &= interface.edge.outside_m(over) < -_OFF_PER_HEIGHT * observed.height_m
    if below.mean() <= _SHARE:
        return
    # A tenth of them may be strays.
    deepest = -float(np.quantile(over[below, 2], 0.1))
    raise InputError(
        "rock.hangs_below_interface",
        f"{below.mean():.1%} of the rock's seen surface hangs below the interface, by up to about {deepest:.2g} m",
        where="interface",
        expected="a rock above the plane on which it meets its pedestal, but for what hangs beyond a seen edge",
        remedy="scan the cliff's face beside and below what hangs; one that is sunk in the ground is held by it and is "
        "not supported; if what hangs there is pedestal, crop the cloud, or say where rock and pedestal meet by "
        "--plane, --point or --outline",
    )


def hanging_doubt(observed: ObservedRock, interface: Interface) -> Doubt | None:
    """What follows from a part of the rock that hangs beyond the pedestal's edge."""
    if interface.edge is None:
        return None
    over = interface.over(observed.surfels.points_m[observed.patches])
    hangs = over[over[:, 2] < -_AT_EDGE_PER_HEIGHT * observed.height_m]
    toward = azimuth_told(hangs[:, :2].mean(axis=0) - over[:, :2].mean(axis=0), interface)
    return Doubt(
        "hanging",
        f"a part of the rock hangs beyond the pedestal's edge, up to {-np.quantile(hangs[:, 2], 0.02):.2g} m below its "
        f"seat, toward {toward}: it weighs, and touches nothing there. A rock that hooks the cliff as it tips "
        "that way is held longer: the interval's upper end says how long, shakes do not know of it",
    )
