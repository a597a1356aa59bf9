"""A hint that comes later draws the base anew, as a scan with that hint from the start does."""

import json
import shutil

import numpy as np
import pytest
from click.testing import CliRunner
from refusals import refused, states

from toppling.models.errors import InputError
from toppling.models.files.digest import seal_archive
from toppling.models.files.schemas import GEOMETRY, LABELS, SCAN_DATA
from toppling.models.frames import quadrant_of
from toppling.models.hidden_base.inspection import Inspection, inspection_of
from toppling.models.scan.hints_file import HINTS, KEYS, hints_text, read_hints, write_hints
from toppling.models.scan.survey import CachedScan, save_survey, survey
from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli as main
from toppling.orchestrator.public.making import of_base, stated_hints

pytestmark = pytest.mark.usefixtures("few_draws", "no_pictures")


@pytest.fixture(scope="module")
def rock(surveyed, tmp_path_factory):
    return save_survey(surveyed, tmp_path_factory.mktemp("again") / "rock")


def described(folder):
    return json.loads((folder / "scene.json").read_text())


def bearable(scene):
    """A pull toward 40 degrees that half of the drawn bases bear."""
    table = described(scene)["report"]["unseen_base"]["toppling"]
    row = min(table, key=lambda value: abs(value["azimuth_deg"] - 220.0))
    return row["median_m_s2"] / 9.81


@pytest.fixture(scope="module")
def later(rock):
    again = ["scan", "--again", str(rock), "--out", str(rock.with_name("later"))]
    done = CliRunner().invoke(main, [*again, "--pull", "N50E", f"{bearable(rock)}"])
    assert done.exit_code == 0, done.output
    downhill = described(rock.with_name("later"))["interface"]["downhill_azimuth_deg"]
    assert f"° toward {quadrant_of(downhill)}; see" in done.output
    return rock.with_name("later")


def test_a_scene_with_a_later_hint_outlines_its_contacts_for_maps_too(later):
    found, features = described(later), json.loads((later / "contacts.geojson").read_text())["features"]
    stated = [found["interface"], *found["interface"]["outlines"]]
    for feature, outline in zip(features, stated, strict=True):
        ring = np.array(feature["geometry"]["coordinates"][0][:-1])
        np.testing.assert_allclose(ring, np.array(outline["outline_m"]) + found["origin_m"], atol=1e-4)


@pytest.mark.thorough
def test_a_later_hint_gives_the_scene_of_a_scan_with_it_from_the_start(stump, rock, later):
    pulls = tuple(map(tuple, read_hints(later / HINTS)["pull"]))
    start = survey(stump[1], inspection=Inspection(pulls=pulls)).scene
    assert described(later)["id"] == start.id != described(rock)["id"]
    assert described(later)["report"]["unseen_base"] == start.report["unseen_base"]


def test_a_refused_hint_leaves_the_scene_as_it_was(rock):
    before = {path.name: path.read_bytes() for path in (rock).iterdir()}
    done = CliRunner().invoke(main, ["scan", "--again", str(rock), "--touch", "9,9,9"])
    assert done.exit_code == 1
    assert {path.name: path.read_bytes() for path in (rock).iterdir()} == before


@pytest.mark.parametrize("option", ["--near 1 2", "--plane 0 0 0 5 N40E", "--units mm", "--point 1,2,3"])
def test_what_needs_the_clouds_is_refused(rock, option):
    done = CliRunner().invoke(main, ["scan", "--again", str(rock), *option.split()])
    assert done.exit_code == 2
    assert "new scan of the clouds" in done.output


def test_a_cached_scene_is_read_only_whole(rock, tmp_path):
    shutil.copytree(rock, tmp_path, dirs_exist_ok=True)
    whole = (tmp_path / SCAN_DATA).read_bytes()
    rng = np.random.default_rng(1)
    for place in rng.integers(0, len(whole), 12):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        (tmp_path / SCAN_DATA).write_bytes(bytes(damaged))
        with pytest.raises(InputError) as error:
            CachedScan.read(tmp_path)
        assert SCAN_DATA in str(error.value)
    (tmp_path / SCAN_DATA).unlink()
    with refused("scan.not_kept", SCAN_DATA):
        CachedScan.read(tmp_path)


@pytest.fixture(scope="module")
def other(rock, later):
    other = shutil.copytree(later, rock.with_name("other"))
    np.savez_compressed(other / LABELS, label=np.zeros(9, np.int8))
    seal_archive(other / LABELS)
    block = Scene.block(0.2, 0.3, 0.5).save(rock.with_name("block"))
    for name in ("rock.ply", "pedestal.ply"):
        shutil.copyfile(block / name, other / name)
    return other


@pytest.mark.thorough
@pytest.mark.parametrize("name", [SCAN_DATA, LABELS, *GEOMETRY, "scene.json"])
def test_a_file_of_another_scene_is_refused_by_name(rock, other, tmp_path, name):
    mixed = shutil.copytree(rock, tmp_path / "mixed")
    shutil.copyfile(other / name, mixed / name)
    before = {path.name: path.read_bytes() for path in mixed.iterdir()}
    verbs = [["scan", "--again", str(mixed), "--pull", "N50E", "0.01"]]
    if name not in (SCAN_DATA, LABELS):
        verbs.append(["scene", "show", str(mixed), "--out", str(tmp_path / "shown")])
    for verb in verbs:
        done = CliRunner().invoke(main, verb)
        states(str(done.exception), "scene.file_foreign", name)
    assert {path.name: path.read_bytes() for path in mixed.iterdir()} == before


@pytest.mark.thorough
def test_hints_of_another_scan_do_not_apply_and_a_scene_is_replaced_whole(rock, later, tmp_path):
    mixed = shutil.copytree(rock, tmp_path / "mixed")
    (mixed / HINTS).write_text('near = [1.0, 2.0]\nunits = "mm"\n')
    done = CliRunner().invoke(main, ["scan", "--again", str(mixed), "--pull", "40", f"{bearable(mixed)}"])
    assert done.exit_code == 0, done.output
    assert set(read_hints(mixed / HINTS)) == {"pull"}
    assert described(mixed)["id"] == described(later)["id"]
    assert [path.name for path in tmp_path.iterdir()] == ["mixed"]  # nothing is left beside it, hidden or not


def test_hints_survive_their_file_and_may_be_written_by_hand_as_on_the_command_line(tmp_path):
    hints = {"units": "mm", "near": [1.5, 2.0], "plane": [1.0, 2.0, 3.0, 5.0, 50.0], "pull": [[40.0, 0.21]]}
    (tmp_path / HINTS).write_text(hints_text(hints))
    assert read_hints(tmp_path / HINTS) == hints
    (tmp_path / HINTS).write_text(
        'pull = [["N50E", 0.21]]\ntouch = [[1, 2, 3]]\nplane = [1, 2, 3, 5, "compass:40"]\n'
    )
    by_hand = {"pull": [[40.0, 0.21]], "touch": ["1.0,2.0,3.0"], "plane": [1.0, 2.0, 3.0, 5.0, 50.0]}
    assert read_hints(tmp_path / HINTS) == by_hand
    (tmp_path / HINTS).write_text("neer = [1, 2]\n")
    with refused("hint.unknown", "'near'"):
        read_hints(tmp_path / HINTS)


STATED = {
    "up": "-y",
    "crs": "EPSG:32611",
    "rock": "rock.obj",
    "pedestal": "label=2",
    "length": ((1.0, 2.0, 3.0), (4.0, 5.0, 6.5), 1.25),
    "near": (1.5, 2.0),
    "outline": [(0.0, 0.0, 0.1), (1.0, 0.0, 0.1), (0.0, 1.0, 0.1)],
    "touch": [(0.0, 0.0, 1 / 3)],
    "daylight": [(0.5, 0.0, 0.1)],
    "pull": ((40.0, 0.21),),
    "base": "rounded",
    "touch_only": True,
}


def asked(monkeypatch, *options):
    found = {}

    def scan(_files, _out, **given):
        found.update({key: value for key, value in given.items() if key in KEYS and value})
        raise InputError("a.b", "enough", where="here", expected="that", remedy="none")

    monkeypatch.setattr("toppling.orchestrator.public.making.scan", scan)
    done = CliRunner().invoke(main, ["scan", "cloud.xyz", "--out", "nowhere", *map(str, options)])
    assert "enough" in str(done.exception) + done.output, done.output
    return found


def test_all_hints_are_read_back_from_their_file(monkeypatch, tmp_path):
    points = ["a,0,0,0,1,2,3", "b,1,0,0,2,2,3", "c,0,1,0,1,3,3"]
    (tmp_path / "gcp.csv").write_text("\n".join(points))
    (tmp_path / "outline.csv").write_text("\n".join(",".join(map(str, row)) for row in STATED["outline"]))
    hints = stated_hints(
        STATED | {"gcp": tmp_path / "gcp.csv", "outline": tmp_path / "outline.csv"},
        inspection_of(None, **of_base(STATED)),
    )
    assert json.loads(json.dumps(hints)) == hints
    write_hints(tmp_path / HINTS, hints)
    (tmp_path / "gcp.csv").unlink()  # what the files held is kept
    (tmp_path / "outline.csv").unlink()
    assert asked(monkeypatch, "--hints", tmp_path / HINTS) == STATED | {"gcp": points}
