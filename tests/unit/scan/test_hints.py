"""What hints of the base may say: pulls that some base bears, places at the base, a scene within its own interval."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import trimesh
from patches import LEVEL
from refusals import refused

from toppling.models.hidden_base import draw_bases as unseen
from toppling.models.hidden_base import evidence as base_kinds
from toppling.models.hidden_base.draw_bases import AZIMUTHS_DEG, DrawnBases, draw_bases
from toppling.models.hidden_base.evidence import OTHER_ERRORS_SHARE
from toppling.models.hidden_base.gap import GapDraw, hidden_base
from toppling.models.hidden_base.inspection import Inspection, inspection_of
from toppling.models.hidden_base.observed import reliefs
from toppling.models.hidden_base.standing import check_inspection, nominal_draw, pulls_beyond
from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.read import Cloud
from toppling.models.scan.surfels import Surfels
from toppling.models.scan.survey import survey
from toppling.models.scan.uncertainty import ObservedRock
from toppling.models.statics import quasi_static_toppling_m_s2
from toppling.orchestrator.public.making import in_files

HEIGHT_M, RADIUS_M, PITCH_M = 2.0, 0.5, 0.02
STD_M = np.full(3, 0.004)


def seen_as(side, floor):
    out = side * [1.0, 1.0, 0.0] / np.linalg.norm(side[:, :2], axis=1)[:, None]
    patches = Surfels(side, out, np.zeros(len(side)), PITCH_M)
    return ObservedRock(side, floor, side, floor, patches, np.ones(len(side), bool), HEIGHT_M, None)


@pytest.fixture(scope="module")
def column():
    """A column whose side was seen down to a rim that hangs, its pedestal up to it; its smooth base and its mesh."""
    turn = np.arange(0.0, 2.0 * np.pi, PITCH_M / RADIUS_M)
    ring = RADIUS_M * np.column_stack([np.cos(turn), np.sin(turn)])
    side = np.vstack([np.column_stack([ring, np.full(len(ring), h)]) for h in np.arange(0.01, 0.3, PITCH_M)])
    grid = np.arange(-1.2, 1.2, PITCH_M)
    floor = np.array([(x, y, 0.0) for x in grid for y in grid if np.hypot(x, y) > RADIUS_M])
    observed = seen_as(side, floor)
    mesh = trimesh.creation.cylinder(RADIUS_M, HEIGHT_M, sections=64)
    mesh.apply_translation([0.0, 0.0, 0.5 * HEIGHT_M])
    return observed, Rock.from_triangles(mesh.vertices, mesh.faces), hidden_base(observed.near(LEVEL))


@pytest.fixture
def few_candidates(monkeypatch):
    for name, number in (("CANDIDATES", 12), ("DRAWS", 12)):
        monkeypatch.setattr(unseen, name, number)
    monkeypatch.setattr(unseen, "reliefs", lambda width_m: reliefs(width_m)[::9])
    monkeypatch.setattr(unseen, "bowls", lambda width_m: base_kinds.bowls(width_m)[:2])


def drawn_with(column, *pulls, **known):
    observed, rock, base = column
    return draw_bases(observed, LEVEL, rock, base, STD_M, Inspection(pulls=pulls, **known))


@pytest.mark.thorough
def test_a_pull_that_no_drawn_base_bears_is_reported_with_what_they_bear(column, few_candidates):
    known = Inspection(pulls=((30.0, 2.0),))
    (result,) = pulls_beyond(drawn_with(column, *known.pulls), known)
    assert (result["azimuth_deg"], result["ratio"]) == (30.0, 2.0)
    assert 0.0 < result["low"] < result["high"] < 1.0


def drawn_of(toppling_m_s2, distinct=True):
    count = len(toppling_m_s2)
    gaps = [GapDraw(np.zeros(4), 0.0, number) for number in range(count)]
    com_m, taken_m3 = np.zeros((count, 3)), np.linspace(0.0, 0.2, count)
    return DrawnBases(
        None, gaps if distinct else gaps[:1] * count, com_m, taken_m3, np.asarray(toppling_m_s2), STD_M
    )


BLOCK = trimesh.creation.box([0.6, 0.6, 1.2])
BLOCK.apply_translation([0.0, 0.0, 0.6])
STANDING = Rock.from_triangles(BLOCK.vertices, BLOCK.faces)
SMOOTH = np.array(
    quasi_static_toppling_m_s2(STANDING, Pedestal(LEVEL.point_m, LEVEL.normal), 9.81, AZIMUTHS_DEG)
)[:, 1]


def on_bases(halves):
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    base = UnseenBase(0.05, tuple(BaseDraw(half * corners) for half in halves))
    return base, drawn_of([SMOOTH * half / 0.3 for half in halves])


def test_the_nominal_scene_stands_on_the_draw_nearest_to_their_median_on_which_it_is_at_rest():
    base, drawn = on_bases([0.26, 0.29, 0.31, 0.3, 0.27])
    assert drawn.likeliest[:2] == [1, 3]
    assert nominal_draw(drawn, base, STANDING, LEVEL) == 1
    aside = dataclasses.replace(STANDING, com_m=STANDING.com_m + np.array([0.295, 0.0, 0.0]))
    assert nominal_draw(drawn, base, aside, LEVEL) == 3
    beyond = dataclasses.replace(STANDING, com_m=STANDING.com_m + np.array([0.4, 0.0, 0.0]))
    assert nominal_draw(drawn, base, beyond, LEVEL) is None


def test_few_distinct_draws_state_no_narrower_a_centre_of_mass_than_was_known_before():
    single = drawn_of(np.full((48, 24), 3.0), distinct=False)
    assert single.distinct == 1
    low, _, high = single.com_interval_m().T
    np.testing.assert_allclose(high - low, 2.0 * 1.645 * STD_M)
    low, _, high = single.interval_m_s2()
    assert (high > low).all()


def contacts(*heights_m):
    places = np.array([[0.1 * number, 0.0, height] for number, height in enumerate(heights_m)])
    return Inspection(places, file="looked.csv", lines=tuple(range(2, 2 + len(places))))


def test_a_contact_high_above_the_interface_is_refused_with_file_line_and_height(column):
    with refused("base.place_off_interface", "0.8 m", "40 %", "1 more of 3") as error:
        check_inspection(column[0], LEVEL, contacts(0.01, 0.8, -0.9))
    assert error.value.where == "looked.csv, line 3"
    check_inspection(column[0], LEVEL, contacts(0.0, 0.03))


def test_a_contact_outside_the_base_is_refused_with_file_and_line(column):
    adjacent = Inspection(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), file="looked.csv", lines=(4, 7))
    with refused("base.place_off_base") as error:
        check_inspection(column[0], LEVEL, adjacent)
    assert error.value.where == "looked.csv, line 7"


def test_daylight_is_shown_farther_in_front_of_the_crevice_than_a_touch(column):
    """A side that has risen by 3 % of the height there lets light through, and touches nothing."""
    near, far = (np.array([[RADIUS_M + share * HEIGHT_M, 0.0, 0.0]]) for share in (0.08, 0.15))
    check_inspection(column[0], LEVEL, Inspection(open_m=near))
    for place in (Inspection(near), Inspection(open_m=far)):
        with refused("base.place_off_base"):
            check_inspection(column[0], LEVEL, place)


FEET_M = np.array([[0.3, 0.0, 0.0], [-0.2, 0.25, 0.0], [-0.2, -0.25, 0.0]])


def raised(column, rise_m):
    """The column with its side seen down to so much above the pedestal, light passing below it."""
    before, rock, _ = column
    side = before.rock_m + np.array([0.0, 0.0, rise_m])
    below = before.pedestal_m * (1.0 - 2.0 * rise_m / RADIUS_M)
    observed = seen_as(side, np.vstack([before.pedestal_m, below]))
    return observed, rock, hidden_base(observed.near(LEVEL))


@pytest.mark.thorough
def test_a_flat_base_is_likely_where_the_rim_goes_down_to_the_pedestal_and_no_more_where_it_hangs(
    column, few_candidates
):
    closed = drawn_with(column).kind_weights
    hanging = drawn_with(raised(column, 0.06)).kind_weights
    assert sum(closed.values()) == pytest.approx(1.0)
    assert closed["flat"] > 0.75 * base_kinds.BEFORE["flat"]  # the rim contradicts no kind
    assert hanging["flat"] < 0.01


def test_a_flat_base_topples_over_its_edge(column, few_candidates):
    drawn = drawn_with(column, base="flat")
    assert drawn.kinds == {"flat": unseen.DRAWS}
    assert drawn.distinct == unseen.DRAWS  # by the centre of mass
    # A column of radius r and height h: g r / (h / 2). The edge is known to half of the points' pitch.
    edge = 9.80665 * RADIUS_M / (0.5 * HEIGHT_M)
    assert np.median(drawn.toppling_m_s2) == pytest.approx(edge, rel=0.5 * PITCH_M / RADIUS_M + 0.02)


def test_a_rock_whose_weight_passes_outside_all_its_possible_contacts_is_refused(column, few_candidates):
    observed, rock, base = column
    with refused("base.contradicted"):
        drawn_with((observed, rock.moved(np.eye(3), np.array([1.3 * RADIUS_M, 0.0, 0.0])), base))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["rough", "rounded"])
def test_draws_are_of_the_stated_kind(column, few_candidates, kind):
    assert drawn_with(column, base=kind).kinds == {kind: unseen.DRAWS}


@pytest.mark.thorough
def test_contacts_open_no_later_than_the_rock_overturns(column, few_candidates):
    drawn = drawn_with(column)
    assert (drawn.lift_off_m_s2 <= drawn.toppling_m_s2 * (1.0 + 1e-9)).all()
    assert (drawn.lift_off_m_s2 < 0.9 * drawn.toppling_m_s2).any()  # some draw rolls before


@pytest.mark.thorough
def test_a_rock_that_touches_nowhere_else_touches_at_these_places_alone(column, few_candidates):
    drawn = drawn_with(column, touching_m=FEET_M, touch_only=True)
    places = drawn.part.observed.places_m
    for gap in drawn.gaps:
        touching = places[gap.gap_m <= 0.0]
        np.testing.assert_allclose(np.sort(touching, axis=0), np.sort(FEET_M[:, :2], axis=0), atol=1e-9)
    free = drawn_with(column, touching_m=FEET_M)
    assert any((gap.gap_m <= 0.0).sum() > len(FEET_M) for gap in free.gaps)


@pytest.mark.thorough
def test_a_touch_shown_in_front_of_the_crevice_is_at_the_edge(column, few_candidates):
    toward = np.deg2rad([20.0, 140.0, 260.0])
    shown = 1.15 * RADIUS_M * np.column_stack([np.cos(toward), np.sin(toward), np.zeros(3)])
    drawn = drawn_with(column, touching_m=shown)
    reach = np.linalg.norm(drawn.part.observed.places_m, axis=1).max()
    assert reach < RADIUS_M + PITCH_M  # no contact in the air beside the rock
    edge = 9.80665 * RADIUS_M / (0.5 * HEIGHT_M)
    assert (drawn.toppling_m_s2 < 1.1 * edge).all()


def test_touching_nowhere_else_needs_three_places_and_no_flat_base():
    around = np.full(3, -1.0), np.full(3, 1.0)
    with refused("base.too_few_touches", 2):
        Inspection(FEET_M[:2], touch_only=True).check(*around)
    with refused("base.flat_touches_everywhere"):
        Inspection(FEET_M, touch_only=True, base="flat").check(*around)
    Inspection(FEET_M, touch_only=True, base="rough").check(*around)


def test_draws_that_are_alike_leave_the_errors_that_no_draw_shows():
    drawn = drawn_of([SMOOTH, SMOOTH])
    low, median, high = drawn.interval_m_s2()
    np.testing.assert_allclose(median - low, 1.645 * OTHER_ERRORS_SHARE * SMOOTH)
    np.testing.assert_allclose(high - median, 1.645 * OTHER_ERRORS_SHARE * SMOOTH)


def test_a_file_distinguishes_places_that_touch_from_places_with_daylight(tmp_path):
    path = tmp_path / "looked.csv"
    path.write_text("x,y,z,kind\n331250.1,3777309.2,480.3,touch\n331251,3777310,480.2,daylight\n# end\n")
    found = inspection_of(path, [(135.0, 0.32)])
    assert found.touching_m.tolist() == [[331250.1, 3777309.2, 480.3]]
    assert found.open_m.tolist() == [[331251.0, 3777310.0, 480.2]]
    assert found.pulls == ((135.0, 0.32),)
    assert (found.file, found.lines) == (str(path), (2, 3))
    np.testing.assert_allclose(
        found.moved(np.array([331250.0, 3777309.0, 480.0])).touching_m, [[0.1, 0.2, 0.3]]
    )


@pytest.mark.parametrize(
    "pull", [(np.nan, 0.3), (90.0, 0.0), (90.0, -0.2), (90.0, 30.0), (500.0, 0.1), (360.0, 0.1), (-1.0, 0.1)]
)
def test_a_pull_beyond_the_round_or_with_a_force_beyond_reason_is_refused(pull):
    with refused("base.pull_unusable"):
        inspection_of(None, [pull])


def test_a_place_outside_the_cloud_is_refused_before_the_cloud_is_split(tmp_path, monkeypatch):
    path = tmp_path / "looked.csv"
    path.write_text("x,y,z,kind\n101,201,51,touch\n# mixed up\n201,101,51,daylight\n102,201,51,touch\n")
    points = np.random.default_rng(1).uniform(-3.0, 3.0, (500, 3))
    cloud = Cloud(points, np.array([100.0, 200.0, 50.0]), np.zeros(500, np.int16), (("a.xyz", 500),))
    monkeypatch.setattr("toppling.models.scan.survey.registered", lambda _: pytest.fail("registered"))
    with refused("hint.outside_cloud", "201.00", "101.00", "51.00") as error:
        survey(cloud, inspection=inspection_of(path))
    assert error.value.where == f"{path}, line 4"
    # The verb leaves the name of the file that is wrong as it is.
    assert in_files(error.value, (Path("a.xyz"),), path) is error.value
