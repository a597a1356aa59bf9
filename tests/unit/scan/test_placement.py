"""A model becomes metres with z up by an axis, a length or control points; what contradicts itself is refused."""

import numpy as np
import pytest
from refusals import refused
from scipy.spatial.transform import Rotation

from toppling.models.scan.placement import AXES, fit_control_points, placement_of, similarity, upward
from toppling.models.scan.read import read_clouds

TURN = Rotation.from_euler("zyx", [40.0, -70.0, 15.0], degrees=True).as_matrix()
SCALE, SHIFT_M = 0.0123, np.array([331000.0, 3777000.0, 480.0])
MODEL = np.random.default_rng(4).uniform(-400.0, 400.0, (7, 3))
SURVEYED_M = SCALE * MODEL @ TURN.T + SHIFT_M


def written(path, surveyed=SURVEYED_M, model=MODEL, head="", names=()):
    rows = [",".join(f"{entry:.6f}" for entry in row) for row in np.hstack([model, surveyed])]
    rows = [f"{name},{row}" for name, row in zip(names, rows, strict=True)] if names else rows
    path.write_text(head + "\n".join(rows) + "\n")
    return path


def noisy(sigma_m, seed=0, points=7):
    return SURVEYED_M[:points] + np.random.default_rng(seed).normal(0.0, sigma_m, (points, 3))


@pytest.mark.parametrize("axis", AXES)
def test_every_axis_is_turned_upward_by_a_rotation(axis):
    turn = upward(axis)
    np.testing.assert_allclose(turn @ AXES[axis], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_length_scales_and_an_axis_turns():
    placed = placement_of("y", ((0.0, 0.0, 0.0), (0.0, 3.0, 4.0), 2.5))
    np.testing.assert_allclose(placed.apply(np.array([[0.0, 4.0, 0.0]])), [[0.0, 0.0, 2.0]], atol=1e-12)
    assert placed.by == "--length: 5 units are 2.5 m; --up y"


@pytest.mark.parametrize(
    ("head", "sign", "encoding"),
    [
        *((head, ",", "utf-8") for head in ("", "# marks\n", "name,x,y,z,east,north,height\n", "x,y,z,X,Y,Z\n")),
        ("", ";", "utf-16"), ("", "\t", "utf-8"), ("", " ", "cp1252"),
    ],
)  # fmt: skip
def test_control_points_give_back_the_similarity_that_made_them(tmp_path, head, sign, encoding):
    path = written(tmp_path / "gcp.csv")
    rows = path.read_text()
    path.write_text(head + (rows if sign == "," else rows.replace(",", sign).replace(".", ",")), encoding)
    placed = placement_of(gcp=path)
    assert placed.scale == pytest.approx(SCALE, rel=1e-7)  # written to a micrometre in 10 m
    np.testing.assert_allclose(placed.turn, TURN, atol=1e-6)
    np.testing.assert_allclose(placed.apply(MODEL), SURVEYED_M, atol=2e-6)
    assert placed.says_up
    assert placed.says_scale


def test_no_other_similarity_has_smaller_residuals():
    surveyed = noisy(0.05)

    def squares(scale, turn, shift):
        return ((scale * MODEL @ turn.T + shift - surveyed) ** 2).sum()

    scale, turn, shift = similarity(MODEL, surveyed)
    least = squares(scale, turn, shift)
    for step in np.random.default_rng(1).normal(0.0, 1e-3, (50, 7)):
        other = Rotation.from_rotvec(step[:3]).as_matrix() @ turn
        assert squares(scale * (1.0 + step[3]), other, shift + step[4:]) >= least


@pytest.mark.parametrize("points", [3, 4, 7])
def test_the_stated_scatter_of_the_scale_is_true(tmp_path, points):
    fits = [
        fit_control_points(written(tmp_path / "gcp.csv", noisy(0.01, seed, points), MODEL[:points]))
        for seed in range(200)
    ]
    true = np.std([fit.scale for fit in fits]) / SCALE
    stated = np.sqrt(np.mean([fit.scale_share_std**2 for fit in fits]))
    assert stated == pytest.approx(true, rel=0.2)  # 200 draws tell a standard deviation within 5 %
    assert len(fits[0].residuals_m) == points


@pytest.mark.parametrize("bad", range(7))
@pytest.mark.parametrize("off_m", [0.3, 2.0])
def test_a_bad_point_is_named(tmp_path, bad, off_m):
    surveyed = noisy(0.01)
    surveyed[bad] += off_m * np.array([0.6, -0.64, 0.48])
    names = [f"GCP{number}" for number in range(7)]
    with refused("placement.points_off", bad) as error:
        placement_of(gcp=written(tmp_path / "gcp.csv", surveyed, names=names))
    assert str(tmp_path / "gcp.csv") in error.value.where


@pytest.mark.parametrize("points", [4, 5, 7])
def test_scatter_alone_is_never_called_a_mistake(tmp_path, points):
    for seed in range(300):
        placement_of(gcp=written(tmp_path / "gcp.csv", noisy(0.02, seed, points), MODEL[:points]))


def test_three_points_that_do_not_fit_are_refused_and_two_exchanged_columns_are_named(tmp_path):
    surveyed = SURVEYED_M[:3].copy()
    surveyed[1] += 3.0
    with refused("placement.points_off"):
        placement_of(gcp=written(tmp_path / "gcp.csv", surveyed, MODEL[:3]))
    with refused("placement.mirrored"):
        placement_of(gcp=written(tmp_path / "gcp.csv", SURVEYED_M[:, [1, 0, 2]]))


ON_A_LINE = np.outer(np.linspace(0.0, 1.0, 7), [3.0, 1.0, 2.0])


@pytest.mark.parametrize(
    ("given", "what"),
    [
        *(({"up": axis}, "placement.up_unreadable") for axis in ("w", "0,0,0", "1,2", "nan,0,1", "up")),
        *(({"length": length}, "placement.length_unusable") for length in (
            ((1, 2, 3), (1, 2, 3), 2.0), ((0, 0, 0), (1, 0, 0), 0.0), ((0,) * 3, (1,) * 3, -1))),
        *(({"gcp": {}, **other}, "placement.given_twice") for other in (
            {"up": "y"}, {"length": ((0, 0, 0), (1, 0, 0), 1.0)})),
        ({"gcp": {"surveyed": ON_A_LINE}}, "placement.points_on_a_line"),
        ({"gcp": {"model": ON_A_LINE}}, "placement.points_on_a_line"),
        ({"gcp": {"surveyed": SURVEYED_M[:3], "model": np.ones((3, 3))}}, "placement.points_on_a_line"),
        ({"gcp": "1,2,3,4,5,6\n2,3,4,5,6,7\n"}, "placement.too_few_points"),
        ({"gcp": "1,2,3,4,5,6\n2,3,x,5,6,7\n1,1,1,1,1,1\n"}, "hint.place_unreadable"),
        ({"gcp": "1,2,3\n4,5,6\n7,8,9\n"}, "hint.place_unreadable"),
        ({"gcp": "1,2,3,4,5,6\n2,3,4,5,6,inf\n3,3,3,3,3,3\n"}, "hint.place_unreadable"),
        ({"gcp": ""}, "placement.too_few_points"),
    ],
)  # fmt: skip
def test_text_without_a_place_is_refused(tmp_path, given, what):
    points, path = given.get("gcp"), tmp_path / "gcp.csv"
    if isinstance(points, str):
        path.write_text(points)
    elif points is not None:
        written(path, **points)
    with refused(what):
        placement_of(**given | ({} if points is None else {"gcp": path}))


def geocentric_m(points_m, latitude_deg, longitude_deg, height_m):
    """Points, east, north and up of a place on WGS 84, in axes of the Earth's centre."""
    latitude, longitude = np.deg2rad([latitude_deg, longitude_deg])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )
    half_axes_m = np.array([6378137.0, 6378137.0, 6356752.3142])
    place = half_axes_m**2 * up / np.linalg.norm(half_axes_m * up) + height_m * up
    return points_m @ np.array([east, np.cross(up, east), up]) + place


@pytest.mark.parametrize("place", [(34.1, -117.3, 900.0), (-45.0, 170.0, 0.0), (78.2, 15.6, -30.0)])
def test_geocentric_axes_are_named_with_the_upward_direction_that_places_them(tmp_path, place):
    points = np.random.default_rng(45).uniform(-2.0, 2.0, (2000, 3))
    path = tmp_path / "geocentric.xyz"
    np.savetxt(path, geocentric_m(points, *place), fmt="%.4f")
    with refused("coordinates.geocentric") as error:
        read_clouds([path])
    direction = str(error.value).split("--up=")[1].split(", the way")[0]
    height_m = read_clouds([path], placement=placement_of(up=direction)).points_m[:, 2]
    assert height_m - height_m.mean() == pytest.approx(points[:, 2] - points[:, 2].mean(), abs=1e-3)
