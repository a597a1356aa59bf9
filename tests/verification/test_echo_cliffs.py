"""The study's own rock, as far as it is printed: its sizes, its edge and its statics, and how a slip changes them."""

import dataclasses
import math
import runpy
from pathlib import Path

import numpy as np
import pytest
from reference.closed_forms import slip_of_pulse_m

from toppling.models.frames import horizontal_unit_vector
from toppling.models.motions.motion import Motion
from toppling.models.pedestal import Pedestal
from toppling.workers.shaking import shake

AWAY_DEG, TOWARD_DEG = 135.0, 315.0
"""Ground that accelerates so topples the rock away from the cliff (toward 315 degrees), and over its edge."""


@pytest.fixture(scope="module")
def scene():
    program = Path(__file__).parents[2] / "examples" / "echo_cliffs.py"
    return runpy.run_path(str(program))["echo_cliffs"]()


def along_cliff_m(scene):
    """Distances of the rock's vertices: how far toward the cliff, and beyond its edge, in plan."""
    out = horizontal_unit_vector(scene.pedestal.downhill_azimuth_deg)
    top = scene.pedestal.vertices_m @ scene.pedestal.normal
    edge_m = (scene.pedestal.vertices_m @ out)[np.isclose(top, top.max())].max()
    return scene.rock.vertices_m @ out, edge_m


def test_sizes_are_those_printed(scene):
    toward_m, edge_m = along_cliff_m(scene)
    assert scene.rock.height_m == pytest.approx(14.0, abs=0.1)
    assert np.ptp(toward_m) == pytest.approx(10.0, rel=0.02)
    assert toward_m.max() - edge_m == pytest.approx(4.0, rel=0.1)
    assert scene.pedestal.slope_deg == pytest.approx(5.0)
    assert scene.pedestal.downhill_azimuth_deg == pytest.approx(135.0)


def test_a_quarter_of_the_base_is_beyond_the_edge(scene):
    height_m = (scene.rock.vertices_m - scene.pedestal.point_m) @ scene.pedestal.normal
    base = scene.rock.vertices_m[np.abs(height_m) < 1e-6]
    toward_m, (_, edge_m) = base @ horizontal_unit_vector(135.0), along_cliff_m(scene)
    share = (edge_m - toward_m.mean()) / (0.5 * np.ptp(toward_m))
    beyond = (math.acos(share) - share * math.sqrt(1.0 - share**2)) / math.pi  # of a disc's area
    assert beyond == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("friction", [1.0, 0.6])
def test_static_thresholds_are_those_printed_whatever_the_friction(scene, friction):
    azimuths = [45.0 * number for number in range(8)]
    values = dict(scene.with_friction(friction).quasi_static_toppling_m_s2(azimuths))
    assert values[AWAY_DEG] == pytest.approx(3.65, rel=0.01)
    assert values[TOWARD_DEG] == min(values.values()) == pytest.approx(2.0, rel=0.01)
    assert max(values.values()) == pytest.approx(4.0, rel=0.02)
    # Over a straight edge only the part of an acceleration across it counts (the slope's share apart).
    for azimuth in (0.0, 270.0):
        assert values[azimuth] == pytest.approx(values[TOWARD_DEG] * math.sqrt(2.0), rel=0.015)


FRICTION = 0.15
"""Below the slenderness: the rock slides and does not rock, and comes to rest on the slope (0.087)."""

PUSH_M_S2 = 1.2


def pushed_over_the_edge(scene, lasting_s, engine):
    """What happens under a constant acceleration of the ground that slides the rock toward the cliff."""
    steps = np.zeros((round((lasting_s + 4.0) / 0.01), 3))
    steps[10 : 10 + round(lasting_s / 0.01)] = PUSH_M_S2 * horizontal_unit_vector(TOWARD_DEG)
    return shake(scene.with_friction(FRICTION), Motion(steps, 0.01), engine=engine)


def newmarks_slip_m(lasting_s):
    """Slip of a block on the slope, pushed downhill for so long (Newmark 1965)."""
    return slip_of_pulse_m(FRICTION, math.radians(5.0), PUSH_M_S2 / 9.81, lasting_s)


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_a_rock_that_slides_toward_the_cliff_goes_as_far_as_newmarks_block(scene, engine):
    slid = pushed_over_the_edge(scene, 0.8, engine)
    assert slid.outcome == "moved"
    assert slid.slip_m == pytest.approx(newmarks_slip_m(0.8), rel=0.03)


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_a_rock_that_slides_past_its_balance_falls_where_the_edge_is(scene, engine):
    """Its centre of mass is 1.79 m from the edge; an endless slope stops it after 2.4 m."""
    assert newmarks_slip_m(2.0) > 1.79
    assert pushed_over_the_edge(scene, 2.0, engine).outcome == "toppled"
    endless = dataclasses.replace(scene, pedestal=Pedestal(scene.pedestal.point_m, scene.pedestal.normal))
    assert pushed_over_the_edge(endless, 2.0, engine).outcome == "moved"
