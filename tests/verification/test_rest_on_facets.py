"""A rock that has come to rest on ground that is no plane: how long it is left alone, and that this changes nothing."""

import math

import numpy as np
import pytest
import trimesh
from refusals import refused
from scipy.spatial.transform import Rotation
from test_ground import block, block_on, strips

from toppling.models.compiled import compiled
from toppling.models.ground.equilibrium import are_held, held_until, wrenches
from toppling.models.ground.points import contact_of
from toppling.models.ground.stepping import TOUCHING_SHARE
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.options import PRESETS
from toppling.workers.problem import Problem
from toppling.workers.seating import settled
from toppling.workers.shaking import Shaking, shake

STEP_S = 0.01
SURFACES = [(15, 15), (0, 15), (0, -15)]


def burst(seed, peak_m_s2=6.0, lasting_s=2.0):
    """Noise that rocks a block and topples none of these, (n, 3)."""
    count = round(lasting_s / STEP_S)
    time_s = np.arange(count) * STEP_S
    random = np.random.default_rng(seed)
    waves = [np.sin(2 * math.pi * (f * time_s + random.random())) for f in random.uniform(1.0, 4.0, 8)]
    azimuth_rad = random.uniform(0.0, 2 * math.pi)
    along = peak_m_s2 * np.hanning(count) * sum(waves) / np.abs(sum(waves)).max()
    return np.column_stack([along * math.cos(azimuth_rad), along * math.sin(azimuth_rad), 0.0 * along])


def turning(most_m_s2, lasting_s, turns):
    """A horizontal acceleration that grows steadily as it turns, (n, 3)."""
    share = np.arange(round(lasting_s / STEP_S)) / round(lasting_s / STEP_S)
    angle = 2 * math.pi * turns * share
    return most_m_s2 * np.column_stack([share * np.cos(angle), share * np.sin(angle), 0.0 * share])


def on_support(scene, pose):
    """A pose of a trajectory in the axes of the ground's contacts, (7,)."""
    contact, turn = contact_of(scene), contact_of(scene).scene_from_support
    turned = Rotation.from_quat([*pose[3:6] @ turn, pose[6]])
    attitude = turned * Rotation.from_quat(contact.start_quaternion_xyzw)
    return np.concatenate([(pose[:3] - contact.origin_m) @ turn, attitude.as_quat()])


def poses(result):
    path = result.trajectory
    return np.asarray(path.time_s), np.hstack([path.position_m, path.quaternion_xyzw])


@pytest.mark.parametrize(("left", "right"), SURFACES)
def test_a_rest_on_facets_is_the_same_skipped_or_stepped_through(left, right):
    scene, weak = block_on(left, right), turning(0.2, 8.0, 5.0)
    motion = Motion(np.vstack([burst(3), weak, burst(13, 4.0), weak]), STEP_S)
    short, whole = (shake(scene, motion, "fast", shortcuts=entry, trajectory=True) for entry in (True, False))
    assert short.max_tilt_deg > 0.5  # it has rocked
    assert whole.skipped_s == 0.0
    assert short.skipped_s > 12.0  # of two times eight
    assert short.steps < 0.6 * whole.steps
    (time_s, pose), (every_s, every) = poses(short), poses(whole)
    same = np.minimum(np.searchsorted(every_s, time_s - 1e-9), len(every_s) - 1)
    assert np.abs(every_s[same] - time_s).max() < 1e-9
    apart = np.abs(every[same] - pose).max(axis=1)
    assert apart[time_s < 10.5].max() < TOUCHING_SHARE * scene.grounded.size_m  # the first rest, and its end
    assert (short.outcome, short.max_tilt_deg) == (whole.outcome, pytest.approx(whole.max_tilt_deg, rel=1e-3))


@pytest.mark.parametrize(("left", "right"), SURFACES)
def test_a_rock_at_rest_is_left_alone_as_long_as_there_is_an_equilibrium(left, right):
    """By programmes over the cones of its contacts, asked for every sample."""
    scene, push = block_on(left, right), turning(5.0, 20.0, 7.3)
    body, begin_s = scene.grounded, 8.0
    quiet = np.zeros((round((begin_s - 2.0) / STEP_S), 3))
    result = shake(scene, Motion(np.vstack([burst(3), quiet, push]), STEP_S), "fast", trajectory=True)
    time_s, pose = poses(result)
    at_rest = pose[np.searchsorted(time_s, begin_s) - 1]
    moved = np.abs(pose - at_rest).max(axis=1) > 1e-6
    leaves_s = time_s[np.flatnonzero(moved & (time_s > begin_s))[0]] - begin_s
    near = body.contacts(on_support(scene, at_rest), 1e-5 * body.size_m)
    first_s = []
    for friction in (scene.contact.friction_static, 1.01 * scene.contact.friction_static):
        columns = wrenches(near["arm_m"], near["normal"], friction)
        loads = np.array([body.load_m_s2(value) for value in push])
        first_s.append(STEP_S * np.flatnonzero(~are_held(columns, loads, body.size_m))[0])
    assert first_s[0] - STEP_S < leaves_s < first_s[1] + 0.1
    assert result.skipped_s > 0.9 * leaves_s


@compiled
def _held_until(rock):
    return held_until(rock, 0)


def test_a_contact_that_hangs_over_its_facet_holds_nothing():
    """By so little that it would come down in one step, were the rock free; it is listed, since it carried before."""
    scene, short_m = block_on(15, 15), 1.5e-5
    vertices = scene.rock.vertices_m.copy()
    vertices[np.lexsort((vertices[:, 2] > 0.3, -vertices[:, 0] - vertices[:, 1]))[0], 2] += short_m
    ground = scene.pedestal.vertices_m, scene.pedestal.faces
    body = Scene.from_mesh((vertices, scene.rock.faces), pedestal=ground, friction=0.8).grounded
    near = body.contacts(body.resting_pose, 2.0 * short_m)
    assert (near["gap_m"] > 0.9 * short_m).sum() == 1 < len(near)
    away = np.linspace(0.5, -0.5, 101)  # at first from that foot, then onto it
    excitation = np.hstack([np.outer(away, [1.0, 1.0, 0.0]), np.zeros((101, 3))])
    rock = body.clockless(body.resting_pose, 0.0027)._replace(excitation=excitation)
    rock.counts[0] = len(near)
    rock.contacts[: len(near)] = near
    assert abs(away[_held_until(rock)]) < 0.02


def test_a_rock_that_rocks_slowly_on_two_of_its_legs_has_not_lodged():
    """At the end of a swing it is as slow as one at rest, but nothing holds it, below it or beside it."""
    scene, tilt = block_on(15, 15), Rotation.from_rotvec([0.0, -math.radians(3.0), 0.0])
    shaking = Shaking(
        Problem(scene, Motion(np.zeros((2, 3)), STEP_S), PRESETS["fast"], 0.0027, None, True), None
    )
    feet = scene.grounded.contacts(scene.grounded.resting_pose, 1e-6)
    pivot = feet["place_m"][feet["place_m"][:, 0] < 0.0].mean(axis=0)
    shaking.sim.counts[1], shaking.sim.time_s[1] = 1, 1.0
    pose, start = shaking.sim.pose[1], shaking.sim.pose[0]
    pose[:3] = pivot + tilt.apply(start[:3] - pivot)
    pose[3:] = (tilt * Rotation.from_quat(start[3:])).as_quat()
    result = shaking.result("rest", trajectory=False)
    assert (result.outcome, result.toppled) == ("moved", False)


@pytest.mark.parametrize("ground", [None, strips([(-6.0, -0.6), (0.0, 0.0), (6.0, -0.6)])])
def test_a_rock_that_is_balanced_is_at_rest_for_statics_where_it_is_for_shakes(ground):
    """On its tip an icosahedron falls; over a ridge a slab tilts until its base lies on a side of it."""
    tall = trimesh.creation.icosahedron()
    tall.apply_transform(trimesh.geometry.align_vectors(tall.vertices[0], [0.0, 0.0, -1.0]))
    falls = Scene.from_mesh((tall.vertices - [0.0, 0.0, tall.bounds[0, 2]], tall.faces), pedestal=ground)
    assert {limits.tips_m_s2 for limits in falls.statics([0.0, 90.0])} == {0.0}
    with refused("rock.does_not_stand"):
        settled(falls)
    slab = block(ground, half_height=0.08)
    rests = settled(slab)
    moved_m = np.abs(rests.rock.vertices_m - slab.rock.vertices_m).max()
    assert moved_m == pytest.approx(0.0 if ground is None else 0.1 * 0.2, rel=0.1, abs=1e-9)
    assert np.array(slab.statics([0.0, 90.0])) == pytest.approx(
        np.array(rests.statics([0.0, 90.0])), rel=1e-3
    )
