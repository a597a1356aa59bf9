"""What a scan leaves unexplained is one warning with what was seen; only what statics rules out is refused."""

import dataclasses
import re

import numpy as np
import pytest
from patches import BLOCK, LEVEL, VOXEL_M, box, ground, seen_of, together, wall
from refusals import refused
from scipy.spatial import cKDTree

from toppling.models.arrays import inside_box
from toppling.models.errors import InputError
from toppling.models.scan import segment, virtual
from toppling.models.scan.candidates import (
    Candidate,
    cut_between,
    find_candidates,
    neighbourhood,
    seen_and_support,
    with_rivals,
)
from toppling.models.scan.close import ClosedRock
from toppling.models.scan.interface import fit_interface
from toppling.models.scan.interface_hint import InterfaceHint, hint_of
from toppling.models.scan.scan_warnings import (
    check_seen_enough,
    left_over,
    unseen_range,
    unseen_rim,
    warnings_of,
    with_unseen_range,
)
from toppling.models.scan.segment import ROCK, choose, patches_around
from toppling.models.scan.surfels import Surfels, orient, thin
from toppling.models.scan.survey import survey
from toppling.models.scan.uncertainty import ObservedRock, check_above
from toppling.models.scene import Scene

CUBE = Scene.block(0.25, 0.25, 0.5).rock


def kinds(rock, rest, **given):
    """Warnings of a rock that is closed as a block and whose cloud is its patches."""
    observed = dataclasses.replace(seen_of(rock, rest), **given)
    closed = ClosedRock(CUBE, 1.0, 0.0, 0.0, 0.0)
    found = warnings_of(observed, LEVEL, closed, CUBE.vertices_m, np.zeros(len(CUBE.vertices_m)), np.zeros(3))
    return {entry.kind: entry.sentence for entry in found}


def test_a_lateral_contact_above_the_interface_is_warned_of_with_its_direction():
    neighbour = box((0.26, -0.3, 0.0), (0.8, 0.3, 0.6))
    found = kinds(BLOCK, together(ground(), neighbour))
    assert list(found) == ["contact"]
    assert "toward E" in found["contact"]


def column(radius_at, height=1.0):
    """Top and side of a round rock whose radius at each height is given, as patches."""
    z = np.arange(0.5 * VOXEL_M, height, 0.5 * VOXEL_M)
    radius = radius_at(z)
    slope = np.gradient(radius, z)
    turn = np.arange(0.0, 2 * np.pi, VOXEL_M / radius.max())
    direction = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(len(turn))])
    points = radius[:, None, None] * direction + z[:, None, None] * [0.0, 0.0, 1.0]
    normals = direction - slope[:, None, None] * [0.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    end = radius[-1]
    top, up = wall((-end, -end, height), (2 * end, 0, 0), (0, 2 * end, 0), (0, 0, 1))
    inside = np.hypot(*top[:, :2].T) < radius[-1]
    return together((points.reshape(-1, 3), normals.reshape(-1, 3)), (top[inside], up[inside]))


def arc(z, radius):
    """How far an arc that is level at height 0 and upright at its radius stands out."""
    return radius * (1.0 - np.sqrt(1.0 - np.clip(1.0 - z / radius, 0.0, 1.0) ** 2))


@pytest.mark.parametrize("given", [None, hint_of((0.0, 0.0, 0.0, 0.0, 0.0))])
@pytest.mark.parametrize("radius_m", [0.2, 0.3])
def test_a_rock_that_a_fillet_joins_to_its_pedestal_is_a_question_and_no_refusal(radius_m, given):
    rock = column(lambda z: 0.25 + arc(z, radius_m))
    assert list(kinds(rock, ground(0.27 + arc(0.01, radius_m)), hint=given)) == ["contact"]


@pytest.mark.parametrize(("sides", "blind_deg", "toward_deg"), [("e", 350.0, 180.0), ("ens", 170.0, 180.0)])
def test_directions_without_a_view_are_warned_of(sides, blind_deg, toward_deg):
    result = unseen_range(seen_of(box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0), sides), ground()), LEVEL)
    assert result == pytest.approx((blind_deg, toward_deg), abs=12.0)


def test_a_rock_that_does_not_close_is_refused_with_its_place_and_what_was_not_seen():
    observed = seen_of(box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0), "e"), ground())
    error = InputError("scan.not_closed", "no body", where="closing", expected="a rock", remedy="stations")
    found = with_unseen_range(error, observed, LEVEL, np.array([100.0, 200.0, 0.0]))
    assert found.code == "scan.not_closed"
    assert re.search(r"0.99 m high about 100\.\d+, 200\.\d+, no side was seen over 350 degrees", found.what)


@pytest.mark.parametrize(("sides", "what"), [("es", "one side"), ("ewns", "70%")])
def test_a_rock_most_of_which_was_not_seen_is_refused(sides, what):
    observed = seen_of(box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0), sides), ground())
    with refused("rock.mostly_unseen", what):
        check_seen_enough(observed, LEVEL, ClosedRock(CUBE, 0.3, 0.0, 0.7, 0.0))
    check_seen_enough(observed, LEVEL, ClosedRock(CUBE, 0.5, 0.0, 0.5, 0.0))


def test_patches_are_as_wide_as_the_points_of_a_sparse_cloud_lie_apart():
    selected = np.random.default_rng(2).random(len(BLOCK[0])) < 0.2
    surfels, _, _ = patches_around(np.vstack([BLOCK[0][selected], ground()[0]]), BLOCK[0][selected], 1.0)
    apart_m = cKDTree(surfels.points_m).query(surfels.points_m[surfels.points_m[:, 2] > 0.1], 5)[0][:, 4]
    assert surfels.voxel_m > 1.5 * VOXEL_M
    assert np.median(apart_m) < 1.5 * surfels.voxel_m


def test_a_rock_of_which_a_side_hangs_below_its_interface_is_refused():
    check_above(seen_of(BLOCK, ground()), LEVEL)
    hanging = together(BLOCK, box((0.25, -0.25, -0.3), (0.6, 0.25, 0.9)))
    with refused("rock.hangs_below_interface", "0.2"):
        check_above(seen_of(hanging, ground()), LEVEL)


@pytest.mark.parametrize(("leaves", "expected"), [(40, 0), (200, 1)])
def test_patches_off_the_closed_surface_are_omitted_and_many_are_warned_of(leaves, expected):
    random = np.random.default_rng(5)
    bush = np.array([0.9, 0.0, 0.3]) + 0.05 * random.normal(size=(leaves, 3)), random.normal(size=(leaves, 3))
    found, warnings = left_over(CUBE, seen_of(together(BLOCK, bush), ground()))
    assert np.array_equal(np.flatnonzero(found), len(BLOCK[0]) + np.arange(leaves))
    assert [warning.kind for warning in warnings] == ["left_over"] * expected


@pytest.mark.parametrize(("off_m", "expected"), [(0.001, False), (0.01, True)])
def test_a_doubled_surface_lies_off_the_closed_surface(off_m, expected):
    observed, points = seen_of(BLOCK, ground()), BLOCK[0] + off_m * BLOCK[1]
    closed = ClosedRock(CUBE, 1.0, 0.0, 0.0, 0.0)
    found = warnings_of(observed, LEVEL, closed, points, np.zeros(len(points)), np.zeros(3))
    assert [entry.kind for entry in found] == (["surface"] if expected else [])
    with refused("scan.not_closed", "0.03"):
        warnings_of(observed, LEVEL, closed, BLOCK[0] + 0.03 * BLOCK[1], np.zeros(len(points)), np.zeros(3))


@pytest.mark.parametrize("strays", [0, 4])
def test_strays_high_up_the_rock_do_not_turn_the_interface(strays):
    around = ground()
    selected = around[0][:, 1] < -0.26  # the crevice was seen from one side
    noise = np.random.default_rng(2).normal(0.0, 0.002, around[0].shape)
    high = np.linspace([-0.2, -0.28, 0.8], [0.2, -0.28, 1.0], strays)
    up = np.tile((0.0, 0.0, 1.0), (strays, 1))
    seen = seen_of(BLOCK, together(((around[0] + noise)[selected], around[1][selected]), (high, up)))
    found = fit_interface(seen.surfels, seen.patches)
    assert np.rad2deg(np.arccos(found.normal[2])) < 2.0
    assert abs(found.point_m[2]) < 0.01


def test_a_crown_that_was_taken_for_pedestal_supports_nothing():
    """Patches seen apart from the others at the top lie nearer to the rock than all of the ground."""
    block = box((-0.25, -0.25, 0.3), (0.25, 0.25, 1.0))
    crown = wall((-0.25, -0.25, 1.01), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 1))
    seen = seen_of(block, together(ground(0.3), crown))
    found = fit_interface(seen.surfels, seen.patches)
    assert (found.normal[2], found.point_m[2]) == pytest.approx((1.0, 0.0), abs=1e-6)


def test_a_crown_goes_on_below_a_belt_that_nobody_saw_and_a_sheet_over_a_rock_stands_on_it():
    seen = (BLOCK[0][:, 2] < 0.6) | (BLOCK[0][:, 2] > 0.7)
    sheet = wall((-0.25, -0.25, 1.1), (0.5, 0, 0), (0, 0.5, 0), (0, 0, 1))
    for points, normals, joined in ((BLOCK[0][seen], BLOCK[1][seen], True), (*together(BLOCK, sheet), False)):
        surfels = Surfels(points, normals, np.zeros(len(points)), VOXEL_M)
        surface, support = seen_and_support(surfels)
        assert (len(surface) > len(neighbourhood(points, VOXEL_M))) == joined
        assert (len(support) > 0) != joined
        assert np.all(points[support[:, 1], 2] > 0.9)


def asked_of(points, *heights):
    """Whether the user is asked which of the creases at some heights is meant."""
    surfels = orient(thin(points, 2.0 * VOXEL_M)[0], 2.0 * VOXEL_M)
    with refused("scan.several_creases") as error:
        choose(find_candidates(points, surfels)[:1], None, np.zeros(3), surfels)
    offered = np.array(re.findall(r"--point [^,]+,[^,]+,([-.0-9]+)", error.value.what), float)
    assert sorted(offered.reshape(-1, 3).mean(axis=1)) == pytest.approx(heights, abs=0.08)


def test_a_plate_with_an_unseen_joint_may_be_the_rock_or_part_of_its_stem():
    points, normals = together(
        box((-0.15, -0.15, 0.0), (0.15, 0.15, 0.6)), box((-0.6, -0.5, 0.75), (0.6, 0.5, 1.0)), ground(0.16)
    )
    asked_of(points[~((normals[:, 2] > 0.5) & (points[:, 2] > 0.5) & (points[:, 2] < 0.7))], 0.0, 0.6)


def test_a_joint_open_on_a_single_side_is_asked_about():
    lower, upper = box((-0.4, -0.4, 0.0), (0.4, 0.4, 0.6)), box((-0.4, -0.4, 0.7), (0.4, 0.4, 1.5))
    inside = box((-0.4, -0.1, 0.6), (0.4, 0.4, 0.7))
    underside = wall((-0.4, -0.4, 0.7), (0.8, 0, 0), (0, 0.3, 0), (0, 0, -1))
    points, normals = together(lower, upper, inside, underside, ground(0.41))
    asked_of(
        points[
            ~((points[:, 2] > 0.55) & (points[:, 2] < 0.71) & (normals[:, 2] > 0.5) & (points[:, 1] > -0.1))
        ],
        0.0,
        0.6,
    )


@pytest.mark.parametrize(("half_m", "code"), [(1.5, "scan.cut_by_survey"), (1.0, None)])
def test_what_ends_where_the_survey_ends_was_not_seen_to_close(half_m, code):
    """A cliff behind the ground, as wide as the survey or with corners that were seen."""
    cliff, floor = (
        box((-half_m, 0.5, 0.0), (half_m, half_m, 2.0), "news" if half_m < 1.5 else "s"),
        ground(0.0),
    )
    points, normals = together(cliff, floor)
    surfels = Surfels(points, normals, np.zeros(len(points)), VOXEL_M)
    rock, loop = np.arange(len(points)) < len(cliff[0]), points[np.abs(points[:, 1] - 0.5) < 0.5 * VOXEL_M]
    thing = Candidate(2.0, points[0], surfels, rock, 0.5, 1.0, loop[loop[:, 2] == 0.0], True)
    if code is None:
        assert choose([thing], None, np.zeros(3), surfels) is thing
    else:
        with refused(code):
            choose([thing], None, np.zeros(3), surfels)


def test_a_belly_that_hides_its_own_base_stands_on_the_nearest_observed_pedestal():
    ball = column(lambda z: 0.1 + 0.9 * np.sqrt(np.maximum(0.25 - (z - 0.5) ** 2, 0.0)))
    high = ball[0][:, 2] > 0.15
    seen = seen_of((ball[0][high], ball[1][high]), ground(0.4))
    found = fit_interface(seen.surfels, seen.patches)
    assert (found.normal[2], found.point_m[2]) == pytest.approx((1.0, 0.0), abs=1e-6)


def stack(half_m):
    """A statue of 1.2 m on a plinth of .5 m, as patches: whole, statue and plinth, with the ground."""
    plinth = box((-half_m, -half_m, 0.0), (half_m, half_m, 0.5))
    shown = (np.abs(plinth[0][:, :2]).max(axis=1) > 0.26) | (plinth[0][:, 2] < 0.5)
    statue = box((-0.25, -0.25, 0.5), (0.25, 0.25, 1.7))
    points, normals = together((plinth[0][shown], plinth[1][shown]), statue, ground(half_m + 0.01))
    return Surfels(points, normals, np.zeros(len(points)), VOXEL_M)


@pytest.mark.parametrize(("half_m", "height_m"), [(0.6, 1.2), (0.25, 1.7)])
def test_the_upper_rock_of_a_stack_is_meant_where_a_level_plane_supports_it(half_m, height_m):
    surfels = stack(half_m)
    assert find_candidates(surfels.points_m, surfels)[0].height_m == pytest.approx(height_m, abs=0.1)


@pytest.mark.thorough
def test_a_part_of_a_level_face_rises_from_nothing():
    places = np.stack(np.meshgrid(*[np.arange(-1.0, 1.0, 0.03)] * 2, [0.0]), axis=-1).reshape(-1, 3)
    face = Surfels(places, np.tile([0.0, 0.0, 1.0], (len(places), 1)), np.zeros(len(places)), 0.03)
    away = np.hypot(*places[:, :2].T)
    assert cut_between(face, neighbourhood(places, 0.03), away < 0.5, away > 0.9, int(away.argmin())) is None


def test_of_a_stack_whose_joint_shows_from_near_by_the_user_is_asked_which_part_is_meant(monkeypatch):
    points, wide_m = stack(0.33).points_m, 3.0 * VOXEL_M
    surfels = orient(thin(points, wide_m)[0], wide_m)
    with refused("scan.several_creases", "1.67 m high above --point", "1.19 m high above --point") as error:
        choose(find_candidates(points, surfels)[:1], None, np.zeros(3), surfels)
    monkeypatch.setattr(segment, "surfels_of", lambda _: surfels)
    offered = np.array(re.findall(r"--point ([^,]+),([^,]+),([-.0-9]+)", error.value.what), float).reshape(
        -1, 3, 3
    )
    for places_m in offered:
        parts = segment.segment(points, np.zeros(3), hint=InterfaceHint.points(places_m))
        assert parts.hint is None
        assert points[parts.label == ROCK, 2].min() == pytest.approx(places_m[:, 2].mean(), abs=wide_m)
    elsewhere = InterfaceHint.points(offered[1] + [0.0, 0.0, 0.3])
    assert segment.segment(points, np.zeros(3), hint=elsewhere).hint is elsewhere


def test_a_neighbour_that_touches_a_rock_is_a_separate_thing():
    low, high = np.array([0.25, 0.15, 0.0]), np.array([0.85, 0.75, 0.9])
    points = together(box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.2)), ground(), box(low, high))[0]
    points = points[~inside_box(points, low - [0.01, 0.0, 0.0], high - 0.001)]
    found = find_candidates(points, orient(thin(points, 3.0 * VOXEL_M)[0], 3.0 * VOXEL_M))
    assert [thing.height_m for thing in found] == pytest.approx([1.2, 0.9], abs=0.1)
    assert found[0].surfels.points_m[found[0].rock, 0].max() < 0.3


def test_of_things_side_by_side_it_is_asked_which_and_not_at_which_crease_they_end():
    tall, low = box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.2)), box((0.27, -0.25, 0.0), (0.75, 0.25, 0.7))
    points, normals = together(tall, low, ground())
    rock = np.arange(len(points)) < len(tall[0]) + len(low[0])
    seen = ~(rock & (np.abs(points[:, 0] - 0.26) < 0.015) & (points[:, 2] < 0.69))  # they touch there
    surfels, rock = Surfels(points[seen], normals[seen], np.zeros(seen.sum()), VOXEL_M), rock[seen]
    upper = Candidate(
        0.5, points[0], surfels, rock & (surfels.points_m[:, 2] > 0.7), 0.5, 1.0, points[:9], True
    )
    both = Candidate(1.2, points[0], surfels, rock, 0.5, 1.0, points[:9], True, (upper,))
    with refused("scan.several_rocks", "2 bodies touch each other there"):
        choose([both], None, np.zeros(3), surfels)
    assert choose([both], np.zeros(2), np.zeros(3), surfels) is both
    with refused("scan.several_creases"):
        choose([dataclasses.replace(upper, rivals=(both,))], np.zeros(2), np.zeros(3), surfels)


@pytest.mark.parametrize("sides", ["horizontal", "up"])
def test_what_is_cut_off_along_a_neck_has_the_cut_along_its_ground_as_rival_at_any_cost(sides):
    """A cap on a stem: patches below the line that face sideways carry nothing, so that the two may be one."""
    surfels = Surfels(*box((-0.25, -0.25, 0.0), (0.25, 0.25, 1.0)), np.zeros(1), VOXEL_M)
    height = surfels.points_m[:, 2]
    cap, whole = (
        Candidate(1.0 - low, np.zeros(3), surfels, height >= low, 0.5, cost, np.zeros((3, 3)), value)
        for low, cost, value in ((0.25, 1.0, sides == "up"), (0.0, 3.0, True))
    )
    assert with_rivals(cap, [cap, whole]).rivals == ((whole,) if sides == "horizontal" else ())
    assert with_rivals(whole, [cap, whole]).rivals == ()


@pytest.mark.slow
@pytest.mark.usefixtures("few_draws")
@pytest.mark.parametrize("hint", [None, hint_of((0.0, 0.0, 0.0, 0.0, 0.0))])
def test_a_statue_on_its_plinth_is_found_without_a_hint_and_with_its_plane(hint):
    vertices, faces = virtual.ground(3.0, 3.0, 1)
    vertices[np.abs(vertices[:, :2]).max(axis=1) > 0.6, 2] -= 0.5
    statue = virtual.boulder(1.2, 0.6, 0.5, 3, bumps=0.02, sides=64)
    truth = virtual.on_slope(statue, (vertices, faces), 0.0, 0.0)
    seen = virtual.scan_around(truth, seed=1, stations=4, resolution_per_height=0.02, clutter=False)
    found = survey(virtual.cloud_of(seen, np.zeros(3))[0], hint=hint)
    assert found.scene.rock.volume_m3 == pytest.approx(truth.rock.volume_m3, rel=0.015)


@pytest.mark.parametrize(("unseen_deg", "warned"), [(100.0, False), (200.0, True)])
def test_a_rim_unseen_around_the_weight_is_warned_of(unseen_deg, warned):
    turn = np.deg2rad(np.arange(0.5, 360.0 - unseen_deg))
    low = 0.3 * np.column_stack([np.cos(turn), np.sin(turn), np.full(len(turn), 0.01)])
    seen = ObservedRock(low, low, low, low, None, None, 1.0, None)
    assert (unseen_rim(seen, LEVEL, np.array([0.0, 0.0, 0.5])) is not None) == warned
