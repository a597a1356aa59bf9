"""Rounded bases stand for smooth surfaces: refined, they lie on them, and topple as they do."""

import math

import numpy as np
import pytest
from reference.bodies import revolved, round_cap

from toppling.models.rock import Rock
from toppling.models.round_base import refined, rounded_base_of
from toppling.models.scene import Scene
from toppling.models.shapes import box

G = 9.81


def smooth_cap_m_s2(rock, radius_m=0.65, half_width_m=0.3):
    """Largest g X / Z of a rolling cap up to its rim: X = d sin t, Z = rho - d cos t, d the centre's height over the
    centre of mass."""
    d = radius_m - rock.com_m[2]
    t = np.linspace(0.0, math.asin(half_width_m / radius_m), 2001)
    return (G * d * np.sin(t) / (radius_m - d * np.cos(t))).max()


@pytest.mark.parametrize("edge_m", [0.08, 0.04])
def test_vertices_of_a_refined_cap_lie_on_its_sphere(edge_m):
    rock = Rock.from_triangles(*round_cap(edge_m))
    finer = refined(rock)
    below = finer.vertices_m[finer.vertices_m[:, 2] < 0.99 * (0.65 - math.sqrt(0.65**2 - 0.3**2))]
    assert len(below) > 4 * (rock.vertices_m[:, 2] < 0.07).sum()
    # The middle of a cubic misses its arc in the fourth order of its angle.
    assert np.abs(np.linalg.norm(below - [0.0, 0.0, 0.65], axis=1) - 0.65).max() < 0.65 * (edge_m / 0.65) ** 4


@pytest.mark.parametrize("edge_m", [0.08, 0.04])
def test_a_coarse_cap_states_its_error_and_refined_topples_like_the_smooth_one(edge_m):
    coarse, fine = (Scene.from_mesh(round_cap(edge_m), refine=each) for each in (False, True))
    exact = smooth_cap_m_s2(coarse.rock)
    found, finer = (
        min(a for _, a in scene.quasi_static_toppling_m_s2([0.0, 120.0])) for scene in (coarse, fine)
    )
    # The error of facets is of first order: one halving takes half of it.
    stated = coarse.rounded_base.change
    assert coarse.rounded_base.is_coarse
    assert found * (1.0 - 2.3 * stated) < exact < found * (1.0 - 1.5 * stated)
    assert exact * 0.99 < finer < 1.15 * exact
    assert fine.rounded_base.change < 0.4 * stated


@pytest.mark.parametrize("sides", [4, 6, 12, 48])
def test_a_flat_base_is_left_as_it_is(sides):
    rock = Rock.from_triangles(*revolved([(0.3, 0.0), (0.35, 0.1), (0.3, 1.0)], sides))
    assert refined(rock) is rock
    block = box(0.2, 0.2, 0.6)
    assert refined(block) is block
    assert rounded_base_of(block) is None


def test_a_flat_base_with_a_rounded_border_stays_flat():
    border = [(0.3 + 0.05 * math.sin(t), 0.05 - 0.05 * math.cos(t)) for t in np.radians([0, 15, 30, 45, 60])]
    finer = refined(Rock.from_triangles(*revolved([*border, (0.36, 1.0)], 32)))
    assert finer.vertices_m[:, 2].min() > -1e-9


def test_a_fine_cap_is_kept_and_not_warned_of():
    ball = Rock.from_triangles(*round_cap(0.03, radius_m=3.0))
    assert refined(ball) is ball
    assert not rounded_base_of(ball).is_coarse
