"""MuJoCo behind the same seam: exact cases with tolerances of its own, our rules of rest and end, what it refuses."""

import engine_cases as case
import numpy as np
import pytest
from engine_cases import G
from refusals import refused

from toppling.models.ground.mesh import contact_mesh
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.workers.engines.mujoco import hollow_m
from toppling.workers.shaking import shake

MUJOCO = {"engine": "mujoco"}

RATIO_TARGET = {"fast": 1e-2, "standard": 1e-2, "reference": 5e-3}
"""An impact is spread over a few steps: measured at most 6.3e-3, 6.3e-3 and 2.7e-3."""


@pytest.mark.parametrize("preset", ["fast", "standard", "reference"])
@pytest.mark.parametrize(("alpha_deg", "share"), [(10, 0.5), (18.4349, 0.5), (30, 0.9)])
def test_a_released_block_lands_in_time_with_housners_restitution(preset, alpha_deg, share):
    landing, ratio, _ = case.free_rocking(alpha_deg, 1.0, share, preset, **MUJOCO)
    assert abs(landing) < 2e-4  # measured 9e-5
    assert abs(ratio) < RATIO_TARGET[preset]


@pytest.mark.parametrize(("preset", "target"), [("fast", 2e-3), ("standard", 2e-4)])
def test_a_pulse_slides_a_block_by_newmarks_slip(preset, target):
    assert abs(case.slip_error(0.6, 0, 0, 1.2, 0.1, preset, 0, **MUJOCO)) < target


@pytest.mark.parametrize(("preset", "target"), [("fast", 2e-3), ("standard", 2e-4)])
@pytest.mark.parametrize("downhill_deg", [135.0, 142.3, 168.0, 180.0])
def test_how_a_block_on_a_slope_is_turned_does_not_change_its_slip(preset, target, downhill_deg):
    """Rounding puts some corners of a block at rest just above the plane, others just below: all of them carry."""
    uphill_deg = downhill_deg + 180.0
    assert abs(case.slip_error(0.6, 5, downhill_deg, 1.2, 0.1, preset, uphill_deg, **MUJOCO)) < target


@pytest.mark.parametrize(("preset", "target"), [("fast", 2.5e-2), ("standard", 8e-3), ("reference", 2.5e-3)])
def test_rolling_over_an_arc_of_corners_converges_with_the_step(preset, target):
    assert abs(case.many_corners_error(16, preset, **MUJOCO)) < target  # measured 1.3e-2, 3.8e-3, 1.1e-3


@pytest.mark.slow
@pytest.mark.parametrize("branch", ["no impact", "after impact"])
@pytest.mark.parametrize("preset", ["fast", "standard", "reference"])
def test_a_full_sine_overturns_from_the_exact_amplitude_on(preset, branch):
    frequency = 4.0 if branch == "no impact" else 3.0
    error = case.full_sine_error(
        18.4349, 0.632, frequency, preset, branch, span=0.05, resolution=5e-4, **MUJOCO
    )
    assert abs(error) < 2e-3  # measured at most 9.8e-4, resolved to 4e-4


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "target"), [("fast", 8e-3), ("standard", 4e-3)])
def test_a_prism_of_many_sides_overturns_from_the_exact_amplitude_on(preset, target):
    error = case.many_contacts_error(24, "edge", preset, span=0.05, resolution=1e-3, **MUJOCO)
    assert abs(error) < target  # measured 4.3e-3 and 2.0e-3


def bursts(slope_deg=0.0):
    """A rock, and a motion with quiet times before, between and after two bursts."""
    rock = box(0.2, 0.25, 0.6)
    scene = Scene.from_mesh((rock.vertices_m, rock.faces), friction=0.7, slope_deg=slope_deg)
    random, quiet = np.random.default_rng(3), np.zeros((300, 3))
    burst = 4.5 * random.uniform(-1.0, 1.0, size=(200, 3))
    return scene, Motion(np.vstack([quiet, burst, quiet, burst, quiet]), 0.02)


@pytest.mark.parametrize("slope_deg", [0.0, 7.0])
def test_a_rock_at_rest_is_skipped_and_goes_on_as_it_lay(slope_deg):
    scene, motion = bursts(slope_deg)
    short, whole = (shake(scene, motion, "fast", shortcuts=on, **MUJOCO) for on in (True, False))
    assert short.skipped_s > 2 * 5.0  # the first quiet time and most of the second
    assert whole.skipped_s == 0.0
    assert short.outcome == whole.outcome
    # A rock set back to its seat starts the second burst from there: the same swing but for chaos.
    assert short.max_tilt_deg == pytest.approx(whole.max_tilt_deg, rel=0.3)


@pytest.mark.parametrize(
    ("contact", "expected"), [({"restitution": 0.2}, "restitution"), ({"friction": (0.8, 0.6)}, "in slip")]
)
def test_what_it_cannot_do_is_refused_by_name(contact, expected):
    with refused("engine.contact_unknown", expected):
        shake(Scene.block(0.2, 0.2, 0.6, **contact), Motion(np.full((9, 3), 0.5 * G), 0.01), **MUJOCO)


def test_a_hollow_spanned_by_two_triangles_is_as_deep_as_their_common_edge():
    """Corners of all its triangles lie on the convex hull."""
    block, rise_m = box(0.5, 0.5, 0.5), 0.013
    sides = [face for face in block.faces if (block.vertices_m[face, 2] < 0.0).any()]
    corner = {
        (x, y): np.flatnonzero((block.vertices_m == (x, y, 0.5)).all(axis=1))[0]
        for x in (-0.5, 0.5)
        for y in (-0.5, 0.5)
    }
    low, right, high, left = (corner[value] for value in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)))
    vertices = block.vertices_m.copy()
    vertices[[right, left], 2] += rise_m
    folded = contact_mesh(
        vertices, np.array([*sides, (low, right, high), (low, high, left)]), -np.ones(3), np.ones(3), 0.1
    )
    exact_m = rise_m / np.sqrt(1.0 + 2.0 * rise_m**2)
    assert 0.0 <= exact_m - hollow_m(folded, 1e-5) <= 1e-5
