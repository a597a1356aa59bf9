"""What is no free rigid block is named, and refused where the answer would mean nothing; planes carry what stands."""

import contextlib
import dataclasses
import warnings

import numpy as np
import pytest
from patches import BLOCK, LEVEL, VOXEL_M, ball_at, box, doubted, ground, kinds, seen_of, together, wall
from refusals import refused

from toppling.models import shapes
from toppling.models.errors import InputError
from toppling.models.scan import virtual
from toppling.models.scan.candidates import Candidate
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.foot import check_not_sunk, creased_share, embedded
from toppling.models.scan.freedom import check_seen_enough, doubts, unseen_range
from toppling.models.scan.hanging import check_above
from toppling.models.scan.interface import fit_interface
from toppling.models.scan.interface_hint import hint_of
from toppling.models.scan.one_block import weakest_joint
from toppling.models.scan.segment import PEDESTAL, ROCK, find_carried, upper_of
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.survey import survey, work_out
from toppling.models.scene import Scene


@pytest.mark.parametrize(
    ("low", "high", "named"),
    [
        (None, None, set()),
        ((0.26, -0.3, 0.0), (0.8, 0.3, 0.6), {"leaning"}),  # it touches high up
        ((0.7, -1.0, 0.0), (0.9, 1.0, 0.9), {"in reach"}),
        ((0.7, -1.0, 0.0), (0.9, 1.0, 0.2), set()),
        ((1.3, -1.0, 0.0), (1.5, 1.0, 0.9), set()),
    ],
)
def test_what_stands_nearer_than_the_rock_is_high_is_named_and_a_low_or_far_one_is_not(low, high, named):
    found = kinds(BLOCK, ground() if low is None else together(ground(), box(low, high)))
    assert (named <= found) if "leaning" in named else (found == named)


def test_a_neighbour_that_was_taken_for_a_part_of_the_rock_is_refused_unless_the_user_says_that_it_is_one():
    neighbour = ball_at((0.72, 0.0, 0.4))
    observed = seen_of(together(ball_at((0.0, 0.0, 0.4)), neighbour), ground(0.62))
    with refused("rock.several_blocks"):
        doubted(observed)
    found = {each.kind: each.sentence for each in doubted(observed, separated=True)}
    assert "azimuth" in found["leaning"]


WALL_BESIDE = box((0.26, -0.7, 0.0), (1.1, 0.7, 0.9), "ens")


@pytest.mark.parametrize(("rock", "two"), [(together(BLOCK, WALL_BESIDE), True), (BLOCK, False)])
def test_a_wall_that_was_taken_for_a_part_of_the_rock_is_named_in_a_cloud_of_few_points_too(rock, two):
    few = np.random.default_rng(1).random(len(rock[0])) < 1.0 / 7.0
    found = {
        each.kind: each.sentence for each in doubted(seen_of((rock[0][few], rock[1][few]), ground(0.62)))
    }
    assert ("two blocks that touch" in found.get("leaning", "")) == two


@pytest.mark.parametrize("rock", [BLOCK, box((-0.8, -0.25, 0.0), (0.8, 0.25, 0.6))])
def test_one_block_has_no_joint(rock):
    joint = weakest_joint(seen_of(rock, ground()), LEVEL)
    assert joint is None or joint.creased_share < 0.2


def test_many_points_at_one_place_rise_beside_nothing():
    observed = seen_of(BLOCK, ground())
    points = np.vstack([observed.surfels.points_m, np.tile([0.6, 0.0, 0.8], (40, 1))])
    label = np.append(np.where(observed.patches, ROCK, PEDESTAL), np.full(40, PEDESTAL))
    assert doubts(observed, LEVEL, points, label) == []


@pytest.mark.parametrize(("beside_m", "named"), [(0.0, False), (0.3, True)])
def test_points_on_the_closed_rock_that_joined_none_of_its_patches_do_not_rise_beside_it(beside_m, named):
    """Half of a block was seen by few points alone, as by far stations."""
    half = box((-0.25, -0.25, 0.0), (0.0, 0.25, 1.0))
    few, ups = box((0.0, -0.25, 0.0), (0.25, 0.25, 1.0), "ens")
    rest = together(ground(), (few[::3] + beside_m * np.array([1.0, 0.0, 0.0]), ups[::3]))
    whole = shapes.box(0.25, 0.25, 0.5).moved(np.eye(3), (0.0, 0.0, 0.5))
    found = doubted(seen_of(half, rest), closed=whole)
    assert ("in reach" in {each.kind for each in found}) == named


def test_two_blocks_one_upon_the_other_are_named():
    # The lower block's top shows around the upper one.
    lower, upper = box((-0.25, -0.25, 0.0), (0.25, 0.25, 0.5)), box((-0.17, -0.17, 0.5), (0.17, 0.17, 1.0))
    shown = np.abs(lower[0][:, :2]).max(axis=1) > 0.16
    assert "stack" in kinds(together((lower[0][shown], lower[1][shown]), upper), ground())


def column(radius_at, height=1.0):
    """Top and side of a round rock whose radius at each height is given, as patches."""
    z = np.arange(0.5 * VOXEL_M, height, 0.5 * VOXEL_M)
    radius = radius_at(z)
    slope = np.gradient(radius, z)
    turn = np.arange(0.0, 2 * np.pi, VOXEL_M / radius.max())
    way = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))])
    points = radius[:, None, None] * way + z[:, None, None] * [0.0, 0.0, 1.0]
    normals = way - slope[:, None, None] * [0.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    top, up = wall(
        (-radius[-1], -radius[-1], height), (2 * radius[-1], 0, 0), (0, 2 * radius[-1], 0), (0, 0, 1)
    )
    inside = np.hypot(*top[:, :2].T) < radius[-1]
    return together((points.reshape(-1, 3), normals.reshape(-1, 3)), (top[inside], up[inside]))


def arc(z, radius):
    """How far an arc that is level at height 0 and upright at its radius stands out."""
    return radius * (1.0 - np.sqrt(1.0 - np.clip(1.0 - z / radius, 0.0, 1.0) ** 2))


@pytest.mark.parametrize("radius_m", [0.03, 0.05, 0.1, 0.2])
def test_a_rock_that_a_fillet_joins_to_its_pedestal_is_refused_unless_the_user_says_where_they_meet(radius_m):
    rock = column(lambda z: 0.25 + arc(z, radius_m))
    observed = seen_of(rock, ground(0.27 + radius_m))
    with refused("rock.goes_on_below"):
        doubted(observed)
    said = dataclasses.replace(observed, hint=hint_of((0.0, 0.0, 0.0, 0.0, 0.0)))
    assert "attached" in {each.kind for each in doubted(said)}


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_a_rock_on_a_neck_is_refused(share):
    def radius(z):
        return (
            0.3 * share
            + arc(z, 0.06)
            + np.where(z > 0.14, np.minimum((z - 0.14) / 0.02, 1.0), 0.0) * (0.3 - 0.3 * share)
        )

    with refused("rock.goes_on_below"):
        doubted(seen_of(column(radius), ground(0.3 * share + 0.08)))


def test_soil_along_a_third_of_the_rim_attaches_no_rock():
    free, soiled = column(lambda z: np.full_like(z, 0.25)), column(lambda z: 0.25 + arc(z, 0.05))

    def toward(part, some):
        kept = (np.abs(np.arctan2(*part[0][:, 1::-1].T)) < np.pi / 3) == some
        return part[0][kept], part[1][kept]

    assert "attached" not in kinds(together(toward(free, False), toward(soiled, True)), ground(0.32))


@pytest.mark.parametrize(("joint_m", "told"), [(0.0, False), (0.002, True), (0.01, True)])
def test_an_open_joint_between_flush_blocks_is_told_by_the_points_in_it(joint_m, told):
    observed = seen_of(BLOCK, ground())
    rng = np.random.default_rng(3)
    on, out = (np.repeat(part, 20, axis=0) for part in box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0)))
    along = np.cross(out, rng.normal(size=out.shape))
    points = on + 0.5 * VOXEL_M * along / np.linalg.norm(along, axis=1, keepdims=True)
    points += rng.normal(0.0, 4e-4, (len(points), 1)) * out
    # A level ray that meets the joint goes on into it.
    within = (np.abs(points[:, 2] - 0.47) < 0.5 * joint_m) & (out[:, 2] == 0.0)
    points[within] -= rng.uniform(0.005, 0.1, (within.sum(), 1)) * out[within]
    label = np.full(len(points), ROCK)
    found = doubts(observed, LEVEL, points, label)
    assert [each.kind for each in found] == ["stack"] * told
    if told:
        assert "0.47 m" in found[0].sentence or "0.48 m" in found[0].sentence


@pytest.mark.parametrize(("offset", "told"), [((0.06, 0.06), True), ((0.06, 0.0), True), ((0.0, 0.0), False)])
def test_an_offset_tells_a_stack_whose_joint_is_closed(offset, told):
    lower, upper = box((-0.25, -0.25, 0.0), (0.25, 0.25, 0.5)), box((-0.25, -0.25, 0.5), (0.25, 0.25, 1.0))
    upper = upper[0] + np.append(offset, 0.0), upper[1]
    shown = (lower[0][:, 2] < 0.5) | (lower[0][:, :2] < np.array(offset) - 0.25).any(axis=1)
    below, way = wall((-0.25, -0.25, 0.5), (0.5, 0, 0), (0, 0.5, 0), (0, 0, -1))
    below = below + np.append(offset, 0.0)
    hangs = (below[:, :2] > 0.25).any(axis=1)
    rock = together((lower[0][shown], lower[1][shown]), upper, (below[hangs], way[hangs]))
    assert ("stack" in kinds(rock, ground())) == told


def ellipsoid(half_m, centre_m, but_in=()):
    """What of an ellipsoid lies above the ground, and outside others (half axes, centre)."""
    unit, _ = ball_at((0.0, 0.0, 2.0), 1.0, 9000)
    unit = unit - [0.0, 0.0, 2.0]
    points, normals = unit * half_m + centre_m, unit / half_m
    shown = points[:, 2] > 0.0
    for half, centre in but_in:
        shown &= (((points - centre) / half) ** 2).sum(axis=1) > 1.0
    return points[shown], normals[shown] / np.linalg.norm(normals[shown], axis=1, keepdims=True)


def test_a_stack_whose_joint_lies_in_no_plane_is_named():
    """The joint of a long block across another rises and falls twice around them."""
    lower, upper = ((0.45, 0.2, 0.35), (0.0, 0.0, 0.25)), ((0.18, 0.36, 0.3), (0.0, 0.03, 0.72))
    rock = together(ellipsoid(*lower, [upper]), ellipsoid(*upper, [lower]))
    assert "stack" in kinds(rock, ground(0.3))
    assert "stack" not in kinds(ellipsoid((0.3, 0.25, 0.6), (0.0, 0.0, 0.5)), ground(0.3))


def test_a_shrub_beside_a_rock_is_nothing_that_it_falls_against():
    leaves = np.random.default_rng(5).normal((0.7, 0.0, 0.5), (0.1, 0.3, 0.15), (6000, 3))
    shrub = leaves, np.tile((0.0, 0.0, 1.0), (len(leaves), 1))
    assert kinds(BLOCK, together(ground(), shrub)) == set()
    assert kinds(BLOCK, together(ground(), shrub, box((0.7, -1.0, 0.0), (0.9, 1.0, 0.9)))) == {"in reach"}


def frustum(foot, top, height):
    """Top and sloping sides (n, 3) of a square block that is narrower or wider at its foot."""
    points, normals = box((-1.0, -1.0, 0.0), (1.0, 1.0, height))
    half = foot + (top - foot) * points[:, 2:] / height
    way = (normals[:, 2:] == 0.0) * (foot - top) / height
    tilted = np.column_stack([normals[:, :2], normals[:, 2:] + way])
    return points * np.hstack([half, half, np.ones_like(half)]), tilted / np.linalg.norm(
        tilted, axis=1, keepdims=True
    )


@pytest.mark.parametrize(("foot", "told"), [(0.4, True), (0.3, False), (0.25, False), (0.2, False)])
def test_sides_that_widen_down_to_the_ground_all_around_are_told_as_embedded(foot, told):
    found = embedded(seen_of(frustum(foot, 0.25, 1.0), ground(foot + 0.01)), LEVEL)
    assert (found is not None) == told
    if found is not None:
        assert all(each in found.sentence for each in ("100% of", "9 degrees", "volume", "contact", "probe"))


def test_sides_that_widen_on_one_side_only_are_not_told_as_embedded():
    points, normals = frustum(0.4, 0.25, 1.0)
    steep = points[:, 0] < 0.0
    normals[steep, 2] = np.where(normals[steep, 2] > 0.9, 1.0, 0.0)
    assert embedded(seen_of((points, normals), ground(0.41)), LEVEL) is None


@pytest.mark.parametrize(("foot", "named"), [(0.4, True), (0.25, False)])
def test_a_rock_that_hangs_below_the_interface_is_named_embedded_where_its_sides_widen(foot, named):
    hanging = wall((0.0, -0.5, -0.2), (0.0, 1.0, 0.0), (0.0, 0.0, 0.1), (1, 0, 0))
    observed = seen_of(together(frustum(foot, 0.25, 1.0), hanging), ground(foot + 0.01))
    with refused("rock.hangs_below_interface") as error:
        check_above(observed, LEVEL)
    assert ("embedded" in str(error.value)) == named


def ball(centre_m):
    """A ball of radius 0.6 m and the ground around it."""
    return ball_at((0.0, 0.0, centre_m), 0.6, 6000), ground(0.62)


@pytest.mark.parametrize(("centre_m", "told"), [(-0.2, True), (0.0, True), (0.1, True), (0.4, False)])
def test_a_ball_is_told_as_embedded_unless_it_overhangs_its_foot(centre_m, told):
    assert (embedded(seen_of(*ball(centre_m)), LEVEL) is not None) == told


@pytest.mark.parametrize(
    ("centre_m", "given", "sunk"), [(-0.2, False, True), (-0.2, True, False), (0.1, False, False)]
)
def test_a_dome_is_refused_unless_the_user_says_where_it_ends(centre_m, given, sunk):
    observed = dataclasses.replace(
        seen_of(*ball(centre_m)), hint=hint_of((0.0, 0.0, 0.0, 0.0, 0.0)) if given else None
    )
    with pytest.raises(InputError) if sunk else contextlib.nullcontext():
        check_not_sunk(observed, LEVEL)


def scanned(sunk_m, flat_m):
    """A boulder of 2.5 m, widest at 1 m, that lies free or is sunk, as the virtual scanner sees it."""
    vertices, faces = virtual.boulder(2.5, 3.0, 2.0, 5, bumps=0.03, sides=64)
    rock = (vertices - np.array([0.0, 0.0, sunk_m]), faces)
    truth = virtual.on_slope(rock, virtual.ground(5.0, flat_m, 3, bumps_m=0.03), 4.0, 120.0)
    seen = virtual.scan_around(truth, seed=1, stations=6, resolution_per_height=0.015)
    return virtual.cloud_of(seen, virtual.DEMO_ORIGIN_M)[0]


@pytest.mark.slow
@pytest.mark.parametrize(("sunk_m", "flat_m", "told"), [(0.8, 0.2, True), (0.0, 1.2, False)])
def test_a_boulder_sunk_to_its_widest_is_told_and_one_that_lies_free_is_not(sunk_m, flat_m, told):
    kept, _, notes = work_out(scanned(sunk_m, flat_m))
    assert ("embedded" in kept.report.get("not_free", {})) == told
    assert any("may be embedded" in each for each in notes) == told


def test_a_surface_that_goes_on_into_the_ground_is_no_block():
    x, y = np.meshgrid(*2 * [np.arange(-1.5, 1.5, VOXEL_M)])
    r = np.hypot(x, y).ravel()
    z = 0.4 * np.exp(-((r / 0.5) ** 2))
    slope = -2.0 * r / 0.25 * z / np.maximum(r, 1e-9)
    normals = np.column_stack([-slope * x.ravel(), -slope * y.ravel(), np.ones(len(r))])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = np.column_stack([x.ravel(), y.ravel(), z - 0.03])
    rock = points[:, 2] > 0.0
    observed = seen_of((points[rock], normals[rock]), (points[~rock], normals[~rock]))
    with refused("rock.goes_on_below"):
        doubted(observed)
    assert creased_share(seen_of(BLOCK, ground()), LEVEL) == 1.0


@pytest.mark.parametrize(("sides", "blind_deg", "toward_deg"), [("e", 350.0, 180.0), ("ens", 170.0, 180.0)])
def test_the_directions_from_which_nothing_was_seen_are_told(sides, blind_deg, toward_deg):
    rock = box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0), sides)
    told = unseen_range(seen_of(rock, ground()), LEVEL)
    assert told == pytest.approx((blind_deg, toward_deg), abs=12.0)


@pytest.mark.parametrize(("sides", "what"), [("es", "rock.mostly_unseen"), ("ewns", "rock.mostly_unseen")])
def test_a_rock_most_of_which_was_not_seen_is_refused(sides, what):
    observed = seen_of(box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0), sides), ground())
    closed = ClosedRock(Scene.block(0.5, 0.5, 1.0).rock, 0.3, 0.0, 0.7, 0.0)
    with refused(what):
        check_seen_enough(observed, LEVEL, closed)
    check_seen_enough(observed, LEVEL, ClosedRock(closed.rock, 0.5, 0.0, 0.5, 0.0))


def test_a_cloud_that_was_thinned_too_much_is_named_as_such():
    points, normals = box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0))
    kept = np.random.default_rng(2).random(len(points)) < 0.2
    closed = ClosedRock(Scene.block(0.5, 0.5, 1.0).rock, 0.3, 0.0, 0.7, 0.0)
    with refused("cloud.too_sparse"):
        check_seen_enough(seen_of((points[kept], normals[kept]), ground()), LEVEL, closed)


@pytest.mark.parametrize("strays", [0, 4])
def test_strays_high_up_the_rock_do_not_turn_the_interface(strays):
    block, around = box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0)), ground()
    kept = around[0][:, 1] < -0.26  # the crevice was seen from one side
    noise = np.random.default_rng(2).normal(0.0, 0.002, (len(around[0]), 3))
    high = np.column_stack(
        [np.linspace(-0.2, 0.2, strays), np.full(strays, -0.28), np.linspace(0.8, 1.0, strays)]
    )
    up = np.tile((0.0, 0.0, 1.0), (strays, 1))
    seen = seen_of(block, together(((around[0] + noise)[kept], around[1][kept]), (high, up)))
    found = fit_interface(seen.surfels, seen.patches)
    assert np.rad2deg(np.arccos(found.normal[2])) < 2.0
    assert abs(found.point_m[2]) < 0.01


@pytest.mark.parametrize(
    ("half_m", "foot_m", "is_two"), [(0.6, 0.0, True), (0.6, 0.5, False), (0.25, 0.0, False)]
)
def test_of_what_planes_carry_the_upper_of_a_stack_is_meant(half_m, foot_m, is_two):
    """A statue of 1.2 m on a wider plinth of .5 m, also where both were taken for one.

    Not on a plinth as wide as itself, nor where what was taken for one already ends at the plinth's top.
    """
    plinth = box((-half_m, -half_m, 0.0), (half_m, half_m, 0.5))
    shown = (np.abs(plinth[0][:, :2]).max(axis=1) > 0.26) | (plinth[0][:, 2] < 0.5)
    statue = box((-0.25, -0.25, 0.5), (0.25, 0.25, 1.7))
    points, normals = together((plinth[0][shown], plinth[1][shown]), statue, ground(half_m + 0.01))
    surfels = Surfels(points, normals, np.zeros(len(points)), VOXEL_M)
    heights_m = [each.height_m for each in find_carried(surfels)]
    assert heights_m == pytest.approx([1.2] if half_m > 0.5 else [], abs=0.1)
    foot = np.array([(0.6, 0.0, foot_m), (-0.6, 0.0, foot_m), (0.0, 0.6, foot_m)])
    both = Candidate(1.7, np.zeros(3), surfels, points[:, 2] > 0.03, 1.0, foot)
    assert (upper_of(surfels, both) is not None) == is_two


def test_what_was_cut_off_along_no_line_carries_nothing_and_warns_of_nothing():
    points, normals = box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.7))
    surfels = Surfels(points, normals, np.zeros(len(points)), VOXEL_M)
    alone = Candidate(1.7, np.zeros(3), surfels, points[:, 2] > 0.03, 1.0, np.empty((0, 3)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert upper_of(surfels, alone) is None


@pytest.mark.slow
def test_an_embedded_boulder_is_refused():
    with pytest.raises(InputError) as error:
        survey(scanned(sunk_m=1.3, flat_m=0.2))
    assert "embedded" in str(error.value)


@pytest.mark.slow
@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("hint", [None, hint_of((0.0, 0.0, 0.0, 0.0, 0.0))])
def test_a_statue_on_its_plinth_is_found_without_a_hint_and_with_its_plane(hint):
    vertices, faces = virtual.ground(3.0, 3.0, 1)
    vertices[np.abs(vertices[:, :2]).max(axis=1) > 0.6, 2] -= 0.5
    statue = virtual.boulder(1.2, 0.6, 0.5, 3, bumps=0.02, sides=64)
    truth = virtual.on_slope(statue, (vertices, faces), 0.0, 0.0)
    seen = virtual.scan_around(truth, seed=1, stations=4, resolution_per_height=0.02, clutter=False)
    found = survey(virtual.cloud_of(seen, np.zeros(3))[0], hint=hint, bootstrap=3)
    assert found.scene.rock.volume_m3 == pytest.approx(truth.rock.volume_m3, rel=0.015)
