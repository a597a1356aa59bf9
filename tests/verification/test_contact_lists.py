"""Contacts are those of the pose, however many features lie near and whatever was looked at before."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from toppling.models.compiled import compiled
from toppling.models.ground.contacts import CONTACT, LEANING, MOST, contacts_at, contacts_in
from toppling.models.ground.mesh import contact_mesh
from toppling.models.ground.pairs import REACH, no_pairs, refresh
from toppling.models.rock import Rock

REACH_M = 0.1
PLENTY = 1 << 16


def rough_pair(seed=7):
    """A cobble of 642 rough vertices, 2 mm above ground of 1800 rough triangles."""
    random = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    cobble = ball.vertices * (1.0 + 0.01 * random.standard_normal((len(ball.vertices), 1))) * [1.0, 1.0, 0.5]
    cobble = Rock.from_triangles(cobble, ball.faces, where="cobble")
    along = np.linspace(-0.6, 0.6, 31)
    east_m, north_m = (axis.ravel() for axis in np.meshgrid(along, along))
    ground_m = np.column_stack([east_m, north_m, 0.004 * random.standard_normal(len(east_m))])
    corner = (np.arange(30)[:, None] * 31 + np.arange(30)).ravel()
    lower, upper = corner[:, None] + [0, 1, 32], corner[:, None] + [0, 32, 31]
    body_m = cobble.vertices_m - cobble.com_m
    rock = contact_mesh(body_m, cobble.faces, body_m.min(axis=0), body_m.max(axis=0), REACH_M)
    box = np.full(3, -0.7), np.full(3, 0.7)
    ground = contact_mesh(ground_m, np.vstack([lower, upper]), *box, REACH_M)
    pose = np.array([0.0, 0.0, ground_m[:, 2].max() - body_m[:, 2].min() + 0.002, 0.0, 0.0, 0.0, 1.0])
    return rock, ground, pose


@compiled
def looked_along(rock, ground, pairs, poses, margins_m, out, keys, gaps_m):
    """Note the contacts of one pose after the other, all from the pairs of the first."""
    refresh(rock, ground, poses[0], 0.08, pairs)
    for k in range(len(poses)):
        for i in range(contacts_in(rock, ground, pairs, poses[k], margins_m[k], LEANING, out)):
            keys[k, i], gaps_m[k, i] = out[i].key, out[i].gap_m


def contacts_anew(rock, ground, pose, margin_m, room):
    out = np.zeros(MOST, CONTACT)
    count = contacts_at(rock, ground, pose, margin_m, LEANING, no_pairs(room), out)
    return dict(zip(out["key"][:count].tolist(), out["gap_m"][:count].tolist(), strict=True))


def test_contacts_from_step_to_step_are_those_that_are_found_anew():
    rock, ground, start = rough_pair()
    random = np.random.default_rng(3)
    poses, turn = [start], Rotation.identity()
    for _ in range(60):
        turn = Rotation.from_rotvec(0.002 * random.standard_normal(3)) * turn
        poses.append(np.concatenate([poses[-1][:3] + 4e-4 * random.standard_normal(3), turn.as_quat()]))
    margins_m = random.choice([0.001, 0.003, 0.02], len(poses))
    keys = np.full((len(poses), MOST), -1)
    gaps_m = np.zeros((len(poses), MOST))
    out = np.zeros(MOST, CONTACT)
    looked_along(rock, ground, no_pairs(PLENTY), np.array(poses), margins_m, out, keys, gaps_m)
    for pose, margin_m, known, gap_m in zip(poses, margins_m, keys, gaps_m, strict=True):
        found = dict(zip(known[known >= 0].tolist(), gap_m[known >= 0].tolist(), strict=True))
        anew = contacts_anew(rock, ground, pose, margin_m, PLENTY)
        assert found.keys() == anew.keys()
        assert all(abs(found[key] - anew[key]) < 1e-12 for key in anew)
    assert max((known >= 0).sum() for known in keys) > 10


def test_contacts_that_are_too_many_to_list_from_afar_are_listed_from_nearer():
    rock, ground, pose = rough_pair()
    pose[2] -= min(contacts_anew(rock, ground, pose, 0.03, PLENTY).values())
    pairs, out = no_pairs(200), np.zeros(MOST, CONTACT)
    contacts_at(rock, ground, pose, 0.08, LEANING, pairs, out)
    assert pairs.lengths_m[REACH] < 0.08
    assert pairs.every.found.max() < 200
    touching = contacts_anew(rock, ground, pose, 0.0005, PLENTY)
    assert len(touching) >= 1
    assert touching.keys() <= contacts_anew(rock, ground, pose, 0.08, 200).keys()
