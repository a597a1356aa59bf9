"""What a rock bears that is held by the cliff's face as well, beside which a part of it hangs."""

from __future__ import annotations

import numpy as np

from toppling.models.arrays import Array
from toppling.models.frames import STANDARD_GRAVITY_M_S2, horizontal_unit_vector
from toppling.models.ground.equilibrium import farthest_load, wrenches
from toppling.models.hidden_base.statics import FRICTION
from toppling.models.rock import Rock
from toppling.models.scan.interface import Interface

_BESIDE_PER_HEIGHT, _BELOW_PER_HEIGHT = 0.01, 0.02
"""What hangs so near to the face, and so far below the seat, may rest against it."""
_RESTING_PER_HEIGHT = 1e-3
_MOST_PLACES = 40
"""At the face and on the seat each: the loads that they bear are those of their outermost."""
_MOST_GRAVITIES = 30.0
_OVER_THE_EDGE = 0.5
"""Cosine between the way in which a rock is pushed and that out of the face, above which it tips over the edge."""


def hooked_m_s2(rock: Rock, interface: Interface, azimuths_deg: Array) -> Array:
    """Largest ground accelerations (n,) that seat and cliff's face bear together, m/s2; 0 where nothing hooks it.

    In the pose of the scan, by friction cones: the gap at the face, which nobody saw, is taken as closed. A rock that
    tips over the edge meets the face after a turn by the gap over the depth to which it hangs.

    rock: as it was closed.
    azimuths_deg: (n,), of the ground's acceleration.
    """
    edge, held = interface.edge, np.zeros(len(azimuths_deg))
    if edge is None:
        return held
    over, height = interface.over(rock.vertices_m), rock.height_m
    outside = edge.outside_m(over)
    at_face = (outside > 0.0) & (outside < _BESIDE_PER_HEIGHT * height)
    face = _some(over[at_face & (over[:, 2] < -_BELOW_PER_HEIGHT * height)])
    seat = _some(over[edge.carries(over) & (over[:, 2] < _RESTING_PER_HEIGHT * height)])
    if not len(face) or not len(seat):
        return held
    com = interface.flat(rock.com_m[None])[0]
    up = np.tile([0.0, 0.0, 1.0], (len(seat), 1))
    outward = edge.outward(face)
    columns = wrenches(np.vstack([seat, face]) - com, np.vstack([up, outward]), FRICTION)
    gravity = np.array([0.0, 0.0, -STANDARD_GRAVITY_M_S2]) @ interface.axes
    for row, azimuth in enumerate(azimuths_deg):
        push = -horizontal_unit_vector(float(azimuth)) @ interface.axes
        if push @ outward.mean(axis=0) < _OVER_THE_EDGE:
            continue
        far = farthest_load(columns, gravity, push, rock.half_diagonal_m)
        held[row] = np.clip(far or 0.0, 0.0, _MOST_GRAVITIES * STANDARD_GRAVITY_M_S2)
    return held


def _some(places: Array) -> Array:
    """At most so many of some places (n, 3), the outermost in directions all around and the deepest among them."""
    turn = 2.0 * np.pi * np.arange(_MOST_PLACES // 2) / (_MOST_PLACES // 2)
    level = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))])
    ways = np.vstack([level, 0.3 * level + [0.0, 0.0, -1.0]])
    return places[np.unique((places @ ways.T).argmax(axis=0))] if len(places) else places
