"""A rock that hangs over an edge and hooks the cliff's face as it is pushed outward."""

import numpy as np
import pytest
from patches import LEVEL

from toppling.models.hidden_base.statics import hooked_m_s2
from toppling.models.rock import Rock
from toppling.models.scan.interface import Edge, Interface

FRICTION, HANGS_M, EDGE_M = 0.8, 0.3, 0.1


def hook():
    """A slab over x = -0.4 to 0.2 with a leg beyond the edge, as a prism along y."""
    outline = np.array(
        [[-0.4, 0], [EDGE_M + 1e-3, 0], [EDGE_M + 1e-3, -HANGS_M], [0.2, -HANGS_M], [0.2, 1.4], [-0.4, 1.4]]
    )
    ends = [np.column_stack([outline[:, 0], np.full(6, y), outline[:, 1]]) for y in (-0.3, 0.3)]
    cap = np.array([[0, 1, 5], [1, 4, 5], [1, 2, 3], [1, 3, 4]])
    around = np.arange(6)
    after = np.roll(around, -1)
    sides = [np.column_stack([around, around + 6, after]), np.column_stack([after, around + 6, after + 6])]
    return Rock.from_triangles(np.vstack(ends), np.vstack([cap, cap[:, ::-1] + 6, *sides]))


def test_a_hooked_rock_is_held_by_the_moment_of_the_face_at_the_depth_of_its_leg():
    """Balance about the edge and of forces, with friction mu at seat and face both."""
    rock = hook()
    along = np.linspace(-1.0, 1.0, 21)
    lines = np.column_stack([np.full(21, EDGE_M), along, np.ones(21), np.zeros(21)])
    level = Interface(np.zeros(3), np.array([0.0, 0.0, 1.0]), np.eye(3), 0.0, edge=Edge(lines, 0.03))
    over, away, along_edge = hooked_m_s2(rock, level, np.array([180.0, 0.0, 90.0]))
    arm, height = EDGE_M + 1e-3 - rock.com_m[0], rock.com_m[2]
    depth = HANGS_M / (1.0 - FRICTION**2)
    assert over == pytest.approx(9.81 * (arm + FRICTION * depth) / (height + depth), rel=0.01)
    assert away == along_edge == 0.0


def test_a_pedestal_without_an_edge_hooks_nothing():
    np.testing.assert_array_equal(hooked_m_s2(hook(), LEVEL, np.array([0.0, 180.0])), 0.0)
