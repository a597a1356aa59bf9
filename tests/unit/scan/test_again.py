"""A hint that comes later draws the base anew, as a scan with that hint from the start does."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from toppling.models.errors import InputError
from toppling.models.scan import virtual, virtual_shapes
from toppling.models.scan.hints_file import HINTS, hints_text, read_hints
from toppling.models.scan.worked_out import KEPT, WorkedOut
from toppling.orchestrator.cli import cli as main


@pytest.fixture(scope="module")
def clouds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("again")
    truth = virtual.on_slope(
        virtual_shapes.boulder(2.0, 1.3, 1.0, 3, bumps=0.02, sides=64),
        virtual_shapes.ground(5.0, 0.7, 3, bumps_m=0.1), 6.0, 250.0,
    )  # fmt: skip
    scans = virtual.scan_around(truth, seed=1, stations=5, resolution_per_height=0.02)
    cloud, _ = virtual.cloud_of(scans, virtual.DEMO_ORIGIN_M)
    np.savetxt(folder / "cloud.xyz", cloud.points_m + cloud.origin_m, fmt="%.5f")
    done = CliRunner().invoke(
        main, ["scan", str(folder / "cloud.xyz"), "--out", str(folder / "rock"), "--bootstrap", "0"]
    )
    assert done.exit_code == 0, done.output
    return folder


def described(folder):
    return json.loads((folder / "scene.json").read_text())


def bearable(scene):
    """A pull toward 40 degrees that half of the drawn bases bear."""
    table = described(scene)["report"]["unseen_base"]["toppling"]
    row = min(table, key=lambda each: abs(each["azimuth_deg"] - 220.0))
    return row["median_m_s2"] / 9.81


def test_a_later_hint_gives_the_scene_of_a_scan_with_it_from_the_start(clouds):
    ratio = bearable(clouds / "rock")
    later = [
        "scan",
        "--again",
        str(clouds / "rock"),
        "--out",
        str(clouds / "later"),
        "--pull",
        "N50E",
        f"{ratio}",
    ]
    done = CliRunner().invoke(main, later)
    assert done.exit_code == 0, done.output
    start = ["scan", str(clouds / "cloud.xyz"), "--out", str(clouds / "start"), "--bootstrap", "0"]
    done = CliRunner().invoke(main, [*start, "--hints", str(clouds / "later" / HINTS)])
    assert done.exit_code == 0, done.output
    one, other = described(clouds / "later"), described(clouds / "start")
    assert one["id"] == other["id"] != described(clouds / "rock")["id"]
    assert one["report"]["unseen_base"] == other["report"]["unseen_base"]
    assert read_hints(clouds / "later" / HINTS) == read_hints(clouds / "start" / HINTS)
    # In place, the former scene is replaced whole.
    done = CliRunner().invoke(main, ["scan", "--again", str(clouds / "start"), "--pull", "40", f"{ratio}"])
    assert done.exit_code == 0, done.output
    assert described(clouds / "start")["id"] == one["id"]
    assert not [each.name for each in clouds.iterdir() if each.name.startswith(".")]


def test_a_refused_hint_leaves_the_scene_as_it_was(clouds):
    before = {each.name: each.read_bytes() for each in (clouds / "rock").iterdir()}
    done = CliRunner().invoke(main, ["scan", "--again", str(clouds / "rock"), "--pull", "40", "2.9"])
    assert done.exit_code != 0
    assert {each.name: each.read_bytes() for each in (clouds / "rock").iterdir()} == before


@pytest.mark.parametrize("option", ["--near 1 2", "--plane 0 0 0 5 N40E", "--units mm", "--point 1,2,3"])
def test_what_needs_the_clouds_is_refused(clouds, option):
    done = CliRunner().invoke(main, ["scan", "--again", str(clouds / "rock"), *option.split()])
    assert done.exit_code == 2
    assert "new scan of the clouds" in done.output


def test_what_was_kept_is_read_only_whole(clouds, tmp_path):
    whole = (clouds / "rock" / KEPT).read_bytes()
    rng = np.random.default_rng(1)
    for place in rng.integers(0, len(whole), 12):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        (tmp_path / KEPT).write_bytes(bytes(damaged))
        with pytest.raises(InputError):
            WorkedOut.read(tmp_path)
    (tmp_path / KEPT).unlink()
    with pytest.raises(InputError, match="keeps no"):
        WorkedOut.read(tmp_path)


def test_hints_survive_their_file(tmp_path):
    said = {"units": "mm", "near": [1.5, 2.0], "plane": [1.0, 2.0, 3.0, 5.0, 50.0], "pull": [[40.0, 0.21]]}
    (tmp_path / HINTS).write_text(hints_text(said))
    assert read_hints(tmp_path / HINTS) == said
    (tmp_path / HINTS).write_text("neer = [1, 2]\n")
    with pytest.raises(InputError, match="did you mean 'near'"):
        read_hints(tmp_path / HINTS)
