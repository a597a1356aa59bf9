"""Where a rock can touch an uneven pedestal, as feet over a plane.

What decides when rock and pedestal touch is the clearance between them. Over the interface plane, the clearance of a
point of the rock is its height less that of the pedestal below it, and that of a point of the pedestal (a bump, the
edge of a cliff) is the height of the rock's surface above it less its own. A foot is such a point with its clearance
as height: a body with these feet on the bare plane touches where the rock touches the pedestal, at the same moments
of a rocking motion. It keeps the plane's normal at every contact, and carries the relief along when it slides, so it
holds for relief that is flat against its distance and for slips that are short against it.
"""

from functools import lru_cache
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from models.errors import InputError
from models.frames import plane_axes
from models.pedestal import Pedestal
from models.rock import Rock

Array = NDArray[np.float64]


@lru_cache(maxsize=8)  # rocks and pedestals compare by identity
def contact_feet_m(rock: Rock, pedestal: Pedestal) -> Array:
    """Points of the rock that can touch the interface plane, the pedestal's relief taken into them.

    Returns
    -------
    (n, 3) array
        Scene frame; their height over the interface plane is the clearance. On an endless plane these are the vertices
        of the rock's convex hull, on a surface those of the convex hull of all feet.

    Raises
    ------
    InputError
        If the pedestal does not lie below the rock.
    """
    if pedestal.vertices_m is None or pedestal.faces is None:
        return rock.hull_vertices_m
    frame = np.vstack([*plane_axes(pedestal.normal), pedestal.normal])
    rock_points = (rock.vertices_m - pedestal.point_m) @ frame.T
    ground = (pedestal.vertices_m - pedestal.point_m) @ frame.T
    under_rock = height_below(rock_points[:, :2], ground, pedestal.faces, highest=True)
    over_ground = height_below(ground[:, :2], rock_points, rock.faces, highest=False)
    rims = _rim_crossings(ground, pedestal.faces, rock_points, rock.faces)
    over_rims = height_below(rims[:, :2], rock_points, rock.faces, highest=False)
    feet = np.vstack(
        [
            rock_points - np.column_stack([np.zeros((len(rock_points), 2)), under_rock]),
            np.column_stack([ground[:, :2], over_ground - ground[:, 2]]),
            np.column_stack([rims[:, :2], over_rims - rims[:, 2]]),
        ]
    )
    feet = feet[np.isfinite(feet[:, 2])]
    if len(feet) < 3:
        raise InputError(
            f"only {len(feet)} points of rock and pedestal lie over each other",
            where="scene",
            expected="a pedestal below the rock",
            remedy="check that rock and pedestal share one frame",
        )
    # The centre of mass gives flat sets of feet a hull, and is never its lowest point.
    com = (rock.com_m - pedestal.point_m) @ frame.T
    corners = ConvexHull(np.vstack([feet, com])).vertices
    return feet[corners[corners < len(feet)]] @ frame + pedestal.point_m


def _rim_crossings(
    ground: Array, ground_faces: NDArray[np.int64], rock: Array, rock_faces: NDArray[np.int64]
) -> Array:
    """Points (k, 3) of the pedestal's rim above or below edges of the rock, where a rim's contact begins or ends."""
    edges = np.sort(ground_faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    pairs, count = np.unique(edges, axis=0, return_counts=True)
    rim = ground[pairs[count == 1]]
    low, high = rock[:, :2].min(axis=0), rock[:, :2].max(axis=0)
    rim = rim[((rim[:, :, :2].max(axis=1) >= low) & (rim[:, :, :2].min(axis=1) <= high)).all(axis=1)]
    other = rock[np.unique(np.sort(rock_faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)][
        :, :, :2
    ]
    other_start, other_way = other[:, 0], other[:, 1] - other[:, 0]
    found = [np.zeros((0, 3))]
    for start, end in rim:
        way, offset = end - start, other_start - start[:2]
        cross = way[0] * other_way[:, 1] - way[1] * other_way[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            here = (offset[:, 0] * other_way[:, 1] - offset[:, 1] * other_way[:, 0]) / cross
            there = (offset[:, 0] * way[1] - offset[:, 1] * way[0]) / cross
        met = (here >= 0) & (here <= 1) & (there >= 0) & (there <= 1)
        found.append(start + here[met, None] * way)
    return np.vstack(found)


def height_below(places_m: Array, vertices_m: Array, faces: NDArray[np.int64], *, highest: bool) -> Array:
    """Height of a triangulated surface at places of the plane.

    Parameters
    ----------
    places_m : (n, 2) array
    vertices_m : (k, 3) array
        Height in the third column.
    faces : (m, 3) int array
    highest : bool
        Whether the highest or the lowest of several layers counts.

    Returns
    -------
    (n,) array
        NaN where there is no triangle.
    """
    corners = vertices_m[faces]
    flat = corners[:, :, :2]
    edge1, edge2 = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    upright = np.abs(area) < 1e-12 * (np.ptp(vertices_m[:, :2], axis=0) ** 2).sum()
    corners, flat, edge1, edge2, area = (a[~upright] for a in (corners, flat, edge1, edge2, area))
    centre = flat.mean(axis=1)
    reach = np.linalg.norm(flat - centre[:, None], axis=2).max(axis=1)
    found = cKDTree(places_m).query_ball_point(centre, (1.0 + 1e-6) * reach) if len(places_m) else []
    count = np.array([len(each) for each in found], int)
    place = np.fromiter(chain.from_iterable(found), int, count.sum())
    face = np.repeat(np.arange(len(count)), count)
    offset = places_m[place] - flat[face, 0]
    share1 = (offset[:, 0] * edge2[face, 1] - offset[:, 1] * edge2[face, 0]) / area[face]
    share2 = (edge1[face, 0] * offset[:, 1] - edge1[face, 1] * offset[:, 0]) / area[face]
    inside = (share1 >= -1e-9) & (share2 >= -1e-9) & (share1 + share2 <= 1 + 1e-9)
    rise1, rise2 = corners[:, 1, 2] - corners[:, 0, 2], corners[:, 2, 2] - corners[:, 0, 2]
    layer = corners[face, 0, 2] + share1 * rise1[face] + share2 * rise2[face]
    height = np.full(len(places_m), -np.inf if highest else np.inf)
    outermost = np.maximum if highest else np.minimum
    outermost.at(height, place[inside], layer[inside])
    return np.where(np.isfinite(height), height, np.nan)
