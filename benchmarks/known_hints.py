"""What an inspection of a known rock would tell of its base: touches, daylight, a pull, and all of them; all true."""

import numpy as np

from toppling.models.arrays import Array
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.scene import Scene
from toppling.models.statics import quasi_static_toppling_m_s2, support_polygon_m

TOUCHES, DAYLIGHTS = 3, 4
OPEN_PER_HEIGHT = (0.006, 0.03)
"""Clearance through which light is seen to pass at the base."""


def true_hints(true: Scene) -> dict[str, Inspection]:
    """Inspections of a rock, by what they tell, survey coordinates."""
    corners = support_polygon_m(true.rock, true.pedestal) + true.origin_m
    touching = _spread(corners, TOUCHES)
    clearance = (true.rock.vertices_m - true.pedestal.point_m) @ true.pedestal.normal / true.rock.height_m
    low, high = OPEN_PER_HEIGHT
    free = _spread(true.rock.vertices_m[(clearance > low) & (clearance < high)], DAYLIGHTS)
    # On the pedestal, below the rock, where the light falls.
    free = free - np.outer((free - true.pedestal.point_m) @ true.pedestal.normal, true.pedestal.normal)
    pulls = (_pull(true, 0.0), _pull(true, 90.0))
    return {
        "touches": Inspection(touching),
        "touches and nowhere else": Inspection(corners, touch_only=True),
        "daylight": Inspection(open_m=free + true.origin_m),
        "a pull": Inspection(pulls=pulls[:1]),
        "touches, daylight and pulls": Inspection(touching, free + true.origin_m, pulls),
    }


def _pull(true: Scene, toward_deg: float) -> tuple[float, float]:
    """Azimuth of a pull and the largest force over the weight that the rock bears."""
    against = (toward_deg + 180.0) % 360.0
    ((_, borne),) = quasi_static_toppling_m_s2(true.rock, true.pedestal, STANDARD_GRAVITY_M_S2, [against])
    return toward_deg, borne / STANDARD_GRAVITY_M_S2


def _spread(places_m: Array, count: int) -> Array:
    """So many of the places, each as far from the others as it can be."""
    chosen = [int(np.argmax(np.linalg.norm(places_m - places_m.mean(axis=0), axis=1)))]
    while len(chosen) < min(count, len(places_m)):
        away = np.linalg.norm(places_m[:, None] - places_m[chosen], axis=2).min(axis=1)
        chosen.append(int(away.argmax()))
    return places_m[chosen]
