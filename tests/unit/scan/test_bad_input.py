"""What `toppling scan` says to clouds that it cannot use: exit 1, what, where, what to do, and nothing written."""

import numpy as np
import pytest
from click.testing import CliRunner
from refusals import refused

from toppling.models.errors import InputError
from toppling.models.scan import virtual
from toppling.models.scan.read import Cloud
from toppling.models.scan.register import check_overlap
from toppling.models.scan.segment import segment
from toppling.orchestrator.cli import cli

SEED = 1


@pytest.fixture(scope="module")
def stump(bare):
    return [station.points_m for station in bare[0]], [station.label for station in bare[0]]


def write(path, survey_points):
    np.savetxt(path, survey_points, fmt="%.4f")
    return path


def refusal(folder, files):
    """What a scan says that must fail and leave the folder as it was."""
    before = sorted(folder.rglob("*"))
    done = CliRunner().invoke(cli, ["scan", *map(str, files), "--out", str(folder / "scene")])
    assert isinstance(done.exception, InputError), done.output
    assert sorted(folder.rglob("*")) == before
    return done.exception


def bare_slope(_):
    rng = np.random.default_rng(SEED)
    x, y = rng.uniform(-5, 5, (2, 20_000))
    return [np.column_stack([x, y, 0.1 * x + 0.02 * np.sin(3 * y) + rng.normal(0, 0.003, len(x))])]


def rock_alone(stump):
    points, label = map(np.concatenate, stump)
    return [points[label == 0]]


def pedestal_alone(stump):
    points, label = map(np.concatenate, stump)
    return [points[label == 1]]


def foot_hidden(stump):
    """Nothing seen within 1.2 m of the rock's middle but the rock above half a metre."""
    points, label = map(np.concatenate, stump)
    middle = points[label == 0].mean(axis=0)
    far = np.hypot(*(points - middle)[:, :2].T) > 1.2
    return [points[far | ((label == 0) & (points[:, 2] > 0.5))]]


def apart(stump):
    first, second, third, *_ = stump[0]
    return [first, second, third + np.array([300.0, 0.0, 0.0])]


def in_feet(stump):
    first, second, third, *_ = stump[0]
    return [first, second, third / 0.3048]


def survey_in_feet(stump):
    first, second, third, *_ = (points + virtual.DEMO_ORIGIN_M for points in stump[0])
    return [first, second, third / 0.3048]


def in_millimetres(stump):
    return [np.concatenate(stump[0]) * 1000.0]


def long(make, code):
    return pytest.param(make, "station0.xyz", code, marks=pytest.mark.thorough)


@pytest.mark.parametrize(
    ("make", "where", "code"),
    [
        (rock_alone, "station0.xyz", "scan.nothing_stands"), (apart, "station2.xyz", "scan.no_overlap"),
        *(long(make, "scan.nothing_stands") for make in (bare_slope, pedestal_alone, foot_hidden)),
        (in_feet, "station2.xyz", "scan.station_off"), (survey_in_feet, "station2.xyz", "scan.no_overlap"),
        long(in_millimetres, "rock.height_out_of_range"),
    ],
)  # fmt: skip
def test_a_cloud_without_a_rock_that_stands_is_refused(tmp_path, stump, make, where, code):
    files = [write(tmp_path / f"station{k}.xyz", points) for k, points in enumerate(make(stump))]
    message = refusal(tmp_path, files)
    assert message.code == code
    assert where in message.where


def test_a_place_without_a_nearby_rock_names_no_rock(stump):
    with refused("scan.nothing_near"):
        segment(np.concatenate(stump[0]), np.zeros(3), np.array([5.5, 4.5]))


def views(*points):
    """A cloud of one file a view, each a station, as they are read."""
    files = tuple((f"station{k}", len(point)) for k, point in enumerate(points))
    station = np.repeat(np.arange(len(points), dtype=np.int32), [len(point) for point in points])
    return Cloud(np.concatenate(points), np.zeros(3), station, files)


@pytest.mark.parametrize(("wide", "near_m"), [(2, 0.7), (1, 1.1)])
def test_a_close_view_among_wide_views_is_no_other_unit(stump, wide, near_m):
    middle = np.concatenate(stump[0])[np.concatenate(stump[1]) == 0].mean(axis=0)
    close = stump[0][wide]
    check_overlap(views(*stump[0][:wide], close[np.linalg.norm(close - middle, axis=1) < near_m]))
