"""Points that a cloud holds more than once say no more than once."""

import numpy as np
import pytest
from cloud_samples import las, ply
from refusals import refused

from toppling.models.scan.read import read_clouds
from toppling.models.scan.register import copies, registered
from toppling.models.scan.survey import work_out


def write_xyz(path, points_m):
    np.savetxt(path, points_m, fmt="%.6f")


WRITERS = {"las": las, "ply": ply, "xyz": write_xyz}


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("times", [2, 23])
def test_repeated_points_are_read_once(tmp_path, suffix, times):
    rng = np.random.default_rng(times)
    once = rng.uniform(0.0, 12.0, (1500, 3)).round(3)
    WRITERS[suffix](tmp_path / f"cloud.{suffix}", rng.permutation(np.repeat(once, times, axis=0)))
    fitted = registered(read_clouds([tmp_path / f"cloud.{suffix}"])).cloud
    assert fitted.files == ((f"cloud.{suffix}", 1500),)
    assert fitted.sources[0].left_out == 1500 * (times - 1)
    assert fitted.sources[0].note == f"{1500 * (times - 1)} points are copies of others and were left out"
    found = np.unique((fitted.points_m + fitted.origin_m).round(3), axis=0)
    np.testing.assert_allclose(found, np.unique(once, axis=0), atol=1e-9)


def test_no_two_different_points_are_taken_for_copies():
    grid = np.stack(np.meshgrid(*[np.arange(60) * 2.0**-7] * 3), axis=-1).reshape(-1, 3)
    assert copies(np.vstack([grid, -grid[grid.all(axis=1)]])) is None
    assert copies(np.vstack([grid, grid, grid])).sum() == 2 * len(grid)


@pytest.fixture(scope="module")
def seen(stump, tmp_path_factory):
    points_m = stump[1].points_m[::2]
    file = tmp_path_factory.mktemp("whole") / "once.ply"
    ply(file, points_m)
    return points_m, file


@pytest.mark.thorough
def test_tiles_that_overlap_give_the_rock_of_the_whole(seen, tmp_path):
    points_m, file = seen
    once = work_out(read_clouds([file]))[0]
    ply(tmp_path / "west.ply", points_m[points_m[:, 0] < 0.6])
    ply(tmp_path / "east.ply", points_m[points_m[:, 0] > -0.6])
    tiled = work_out(read_clouds([tmp_path / "west.ply", tmp_path / "east.ply"]))[0]
    rock, whole = tiled.closed.rock, once.closed.rock
    assert rock.volume_m3 == pytest.approx(whole.volume_m3, rel=0.01)
    apart_m = rock.com_m + tiled.origin_m - whole.com_m - once.origin_m
    assert np.linalg.norm(apart_m) < 0.005 * whole.height_m


@pytest.mark.parametrize("different", [1, 5, 998])
def test_a_cloud_of_few_points_repeated_many_times_is_refused(tmp_path, different):
    times = 20_000 // different
    once = np.random.default_rng(different).uniform(0.0, 2.0, (different, 3)).round(3)
    write_xyz(tmp_path / "cloud.xyz", np.vstack([np.repeat(once, times, axis=0), [[9.0, 9.0, 9.0]]]))
    with refused("cloud.too_few_points", different + 1, times * different + 1):
        registered(read_clouds([tmp_path / "cloud.xyz"]))
