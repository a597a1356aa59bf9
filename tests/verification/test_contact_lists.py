"""Contacts are those of the pose, however many features lie near and whatever was looked at before."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from toppling.models.compiled import compiled
from toppling.models.ground.contacts import CONTACT, LEANING, MOST, contacts_in
from toppling.models.ground.facets import NO_FACETS
from toppling.models.ground.mesh import contact_mesh
from toppling.models.ground.pairs import REACH, empty_lists, find, latest_pairs
from toppling.models.ground.stepping import contacts_at
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
def looked_along(rock, ground, lists, poses, margins_m, out, keys, gaps_m, found_in):
    """Note the contacts of one pose after the other, and in which the pairs were found."""
    for k in range(len(poses)):
        find(rock, ground, poses[k], margins_m[k], lists)
        for i in range(contacts_in(rock, ground, latest_pairs(lists), poses[k], margins_m[k], LEANING, out)):
            keys[k, i], gaps_m[k, i] = out[i].key, out[i].gap_m
        found_in[k] = latest_pairs(lists).pose[0]


def segments_apart_m(starts, directions):
    """Distances (a, b) of two sets of segments, from many places on each of the first."""
    (a, b), (u, v) = starts, directions
    along = np.linspace(0.0, 1.0, 201)
    places = a[:, None, :] + along[None, :, None] * u[:, None, :]
    offset = places[:, :, None, :] - b
    share = ((offset * v).sum(axis=3) / (v * v).sum(axis=1)).clip(0.0, 1.0)
    return np.linalg.norm(offset - share[..., None] * v, axis=3).min(axis=1)


def lists_of(rock, room=PLENTY):
    return empty_lists(0.3, float(np.linalg.norm(rock.vertices_m, axis=1).max()), room)


def looked_along_all(rock, ground, poses, margins_m):
    """Contacts by key and gap of each pose, and how often pairs were found anew."""
    keys, gaps_m = np.full((len(poses), MOST), -1), np.zeros((len(poses), MOST))
    found_in, out = np.zeros(len(poses)), np.zeros(MOST, CONTACT)
    looked_along(rock, ground, lists_of(rock), np.array(poses), margins_m, out, keys, gaps_m, found_in)
    contacts = [
        dict(zip(key[key >= 0].tolist(), gap_m[key >= 0].tolist(), strict=True))
        for key, gap_m in zip(keys, gaps_m, strict=True)
    ]
    return contacts, int((np.diff(found_in) != 0.0).sum())


def contacts_anew(rock, ground, pose, margin_m, room):
    out = np.zeros(MOST, CONTACT)
    count = contacts_at((rock, ground, NO_FACETS), pose, margin_m, LEANING, lists_of(rock, room), out)
    return dict(zip(out["key"][:count].tolist(), out["gap_m"][:count].tolist(), strict=True))


def test_contacts_from_step_to_step_are_those_that_are_found_anew():
    rock, ground, start = rough_pair()
    random = np.random.default_rng(3)
    poses, turn = [start], Rotation.identity()
    for _ in range(60):
        turn = Rotation.from_rotvec(0.002 * random.standard_normal(3)) * turn
        poses.append(np.concatenate([poses[-1][:3] + 4e-4 * random.standard_normal(3), turn.as_quat()]))
    margins_m = random.choice([0.001, 0.003, 0.02], len(poses))
    contacts, _ = looked_along_all(rock, ground, poses, margins_m)
    for pose, margin_m, found in zip(poses, margins_m, contacts, strict=True):
        anew = contacts_anew(rock, ground, pose, margin_m, PLENTY)
        assert found.keys() == anew.keys()
        assert all(abs(found[key] - anew[key]) < 1e-12 for key in anew)
    assert max(map(len, contacts)) > 10


def test_pairs_that_serve_miss_no_contact_of_a_rock_that_rocks_and_slides():
    rock, ground, _ = rough_pair()
    at = np.linspace(0.0, 1.0, 4000)
    tilts = np.column_stack([0.12 * np.sin(9.0 * at), 0.08 * np.sin(14.0 * at), 0.3 * at])
    turns = Rotation.from_rotvec(tilts)
    lowest_m = [turn.apply(rock.vertices_m)[:, 2].min() for turn in turns]  # the rock stays at the ground
    places = np.column_stack([0.1 * at, 0.05 * np.sin(6.0 * at), 0.002 - np.array(lowest_m)])
    poses = np.column_stack([places, turns.as_quat()])
    contacts, searched = looked_along_all(rock, ground, poses, np.full(len(at), 0.001))
    assert 1 < searched < len(at) / 4
    for pose, found in zip(poses[::10], contacts[::10], strict=True):
        assert found.keys() == contacts_anew(rock, ground, pose, 0.001, PLENTY).keys()
    assert sum(map(len, contacts)) > len(at)


def test_nearly_flat_edges_touch_along_a_direction_out_of_both_bodies():
    """Two finely meshed caps, one above the other: no contact has a gap below none, or a normal that points down."""
    x_m, y_m = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-0.5, 0.5, 21)] * 2, indexing="ij"))
    corner = (np.arange(20)[:, None] * 21 + np.arange(20)).ravel()
    faces = np.vstack([corner[:, None] + [0, 21, 22], corner[:, None] + [0, 22, 1]])
    cap_m = np.column_stack([x_m, y_m, -(x_m**2 + y_m**2) / 16.0])
    box = np.full(3, -1.0), np.full(3, 1.0)
    ground = contact_mesh(cap_m, faces, *box, REACH_M)
    rock = contact_mesh(
        Rotation.from_euler("z", 0.4).apply(cap_m * [1.0, 1.0, -1.0]), faces[:, ::-1], *box, REACH_M
    )
    out = np.zeros(MOST, CONTACT)
    pose = np.array([0.003, 0.002, 0.0004, 0.0, 0.0, 0.0, 1.0])
    found = out[: contacts_at((rock, ground, NO_FACETS), pose, 0.008, LEANING, lists_of(rock), out)]
    assert found["gap_m"].min() > 0.0
    assert found["normal"][:, 2].min() > 0.99
    assert (found["key"] >= 2 << 60).sum() >= 10


def test_contacts_that_are_too_many_to_list_from_afar_are_listed_from_nearer():
    rock, ground, pose = rough_pair()
    pose[2] -= min(contacts_anew(rock, ground, pose, 0.03, PLENTY).values())
    lists, out = lists_of(rock, 200), np.zeros(MOST, CONTACT)
    contacts_at((rock, ground, NO_FACETS), pose, 0.08, LEANING, lists, out)
    (listed,) = np.flatnonzero(lists.pairs.lengths_m[:, REACH])
    assert lists.pairs.lengths_m[listed, REACH] < 0.08
    assert lists.pairs.found.max() < 200
    touching = contacts_anew(rock, ground, pose, 0.0005, PLENTY)
    assert len(touching) >= 1
    assert touching.keys() <= contacts_anew(rock, ground, pose, 0.08, 200).keys()


@pytest.mark.parametrize(
    ("place_m", "slopes"),
    [
        ((-0.01, -0.5, 0.001), {0.0, 0.5}),  # over the level face, in front of the one that rises beside it
        ((-0.04, -0.2, -0.01), {1.0}),  # beyond the level face, where the third falls away
    ],
)
def test_a_hollows_face_reaches_on_below_the_other_face_and_no_farther(place_m, slopes):
    ground_m = np.array([[0, -1, 0], [0, 0, 0], [-0.1, -1, 0], [1, -0.5, 0.5], [-1.1, -1, -1]], float)
    box = np.full(3, -1.0), np.full(3, 1.0)
    ground = contact_mesh(ground_m, np.array([[0, 1, 2], [0, 3, 1], [2, 1, 4]]), *box, REACH_M)
    needle_m = np.array([[0, 0, 0], [0.01, 0, 1], [-0.01, 0.01, 1], [-0.01, -0.01, 1]], float)
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]])
    rock = contact_mesh(needle_m, faces, needle_m.min(axis=0), needle_m.max(axis=0), REACH_M)
    pose, out = np.array([*place_m, 0.0, 0.0, 0.0, 1.0]), np.zeros(MOST, CONTACT)
    count = contacts_at((rock, ground, NO_FACETS), pose, 0.05, LEANING, lists_of(rock), out)
    of_tip = out[:count][out["key"][:count] < 1 << 60]
    steep = np.hypot(of_tip["normal"][:, 0], of_tip["normal"][:, 1]) / of_tip["normal"][:, 2]
    assert set(steep.round(2)) == slopes


def test_beyond_the_end_of_a_mesh_and_below_it_nothing_is_inside_the_ground():
    ground_m = np.array([[0, -1, 0], [1, -1, 0], [1, 0, 0], [0, 0, 0]], float)
    box = np.full(3, -1.0), np.full(3, 1.0)
    ground = contact_mesh(ground_m, np.array([[0, 1, 2], [0, 2, 3]]), *box, REACH_M)
    needle_m = np.array([[0, 0, 0], [0.01, 0, 1], [-0.01, 0.01, 1], [-0.01, -0.01, 1]], float)
    faces = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]])
    rock = contact_mesh(needle_m, faces, needle_m.min(axis=0), needle_m.max(axis=0), REACH_M)
    out = np.zeros(MOST, CONTACT)
    for place_m in ((-0.02, -0.5, -0.01), (0.5, 0.02, -0.01), (-0.02, 0.02, -0.01)):
        pose = np.array([*place_m, 0.0, 0.0, 0.0, 1.0])
        found = out[: contacts_at((rock, ground, NO_FACETS), pose, 0.05, LEANING, lists_of(rock), out)]
        assert found["gap_m"].min(initial=0.0) >= 0.0


def test_a_nearly_flat_edge_that_crosses_the_end_of_a_mesh_is_pushed_up():
    """Both ways along the normal of two such edges hardly lead into a body."""
    ground_m = np.array([[0, -1, 0], [1, -1, 0], [1, 0, 0], [0, 0, 0]], float)
    box = np.full(3, -1.0), np.full(3, 1.0)
    ground = contact_mesh(ground_m, np.array([[0, 1, 2], [0, 2, 3]]), *box, REACH_M)
    roof_m = [(x, y, z) for x in (-0.3, 0.3) for y, z in ((0.0, 0.0), (-0.3, 1e-3), (0.3, 1e-3), (0.0, 0.5))]
    rock_mesh = trimesh.convex.convex_hull(np.array(roof_m))
    vertices_m, faces = np.array(rock_mesh.vertices), np.array(rock_mesh.faces)
    rock = contact_mesh(vertices_m, faces, vertices_m.min(axis=0), vertices_m.max(axis=0), REACH_M)
    out, across = np.zeros(MOST, CONTACT), 0
    for tilt in np.radians(np.linspace(-3.0, 3.0, 13)):
        turn = Rotation.from_rotvec([0.0, tilt, 0.0]).as_quat()
        pose = np.array([0.02, -0.5, 0.0, *turn])
        found = out[: contacts_at((rock, ground, NO_FACETS), pose, 0.02, LEANING, lists_of(rock), out)]
        of_edges = found[found["key"] >> 60 == 2]
        across += len(of_edges)
        assert (of_edges["normal"][:, 2] > 0.0).all()
    assert across > 0


@compiled
def listed_edges(rock, ground, pose, margin_m, lists):
    find(rock, ground, pose, margin_m, lists)
    return latest_pairs(lists).found[2]


@pytest.mark.thorough
def test_long_edges_are_listed_with_all_edges_of_the_ground_within_the_reach():
    """A cube over a few wide ridges: its edges cross them far from their own middles."""
    cube = trimesh.creation.box((0.38, 0.38, 0.38))
    rock = contact_mesh(cube.vertices, cube.faces, *cube.bounds, REACH_M)
    along = np.linspace(-4.0, 4.0, 62)
    ridged_m = np.array([(x, y, 0.05 * (i % 2)) for i, x in enumerate(along) for y in (-4.0, 4.0)])
    first = 2 * np.arange(61)[:, None]
    faces = np.vstack([first + np.array(corners) for corners in ([0, 2, 3], [0, 3, 1])])
    ground = contact_mesh(ridged_m, faces, np.full(3, -4.0), np.full(3, 4.0), REACH_M)
    random = np.random.default_rng(5)
    found = 0
    for _ in range(100):
        turn = Rotation.from_euler(
            "zyx", random.uniform([-90.0, -20.0, -20.0], [90.0, 20.0, 20.0]), degrees=True
        )
        corners = turn.apply(rock.vertices_m)
        place = np.array([*random.uniform(-1.0, 1.0, 2), 0.05 - corners[:, 2].min()])
        pose, lists = np.concatenate([place, turn.as_quat()]), lists_of(rock)
        count, pairs = listed_edges(rock, ground, pose, 0.4 * REACH_M, lists), lists.pairs
        ends, other = (place + corners)[rock.edges], ground.vertices_m[ground.edges]
        apart_m = segments_apart_m(
            (ends[:, 0], other[:, 0]), (ends[:, 1] - ends[:, 0], other[:, 1] - other[:, 0])
        )
        of_rock, of_ground = pairs.first[lists.latest[0], 2, :count], pairs.second[lists.latest[0], 2, :count]
        assert (pairs.apart_m[lists.latest[0], 2, :count] <= apart_m[of_rock, of_ground] + 1e-12).all()
        listed = set(zip(of_rock, of_ground, strict=True))
        assert (
            set(zip(*np.nonzero(apart_m < 0.99 * pairs.lengths_m[lists.latest[0], REACH]), strict=True))
            <= listed
        )
        found += count
    assert found > 200
