"""Files that the program wrote and reads again: a bit that flips, or an end that is lost, is told or has no effect."""

import logging
import random
import shutil

import numpy as np
import pytest
from refusals import refused
from small_campaigns import NEEDED, planned_in

from toppling.models.errors import InputError
from toppling.models.files.digest import read_table
from toppling.models.motions.ensemble import Ensemble
from toppling.models.pedestal import Pedestal
from toppling.models.scene import Scene
from toppling.orchestrator import run_folder
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.journal import journal, last, log_event
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.run_folder import prepare, session
from toppling.orchestrator.status import state_of
from toppling.orchestrator.task import lost_row, versions
from toppling.orchestrator.verbs.replay import specification
from toppling.results.reader import open_run
from toppling.results.store import compact, write_part

SEED = 20260727


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A run that was interrupted, with parts, and the same one complete, on a pedestal that is a surface."""
    folder = tmp_path_factory.mktemp("damage")
    block = Scene.block(0.15, 0.2, 0.6)
    square = np.array([[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [9.0, 9.0, 0.0], [-9.0, 9.0, 0.0]])
    surface = Pedestal(np.zeros(3), np.array([0.0, 0.0, 1.0]), square, np.array([[0, 1, 2], [0, 2, 3]]))
    planned = planned_in(folder, scene=Scene(block.rock, surface), pga_m_s2=[2, 4, 6, 8], preset="fast")
    run = folder / "interrupted"
    prepare(run, planned, dict(versions()))
    rows = [
        lost_row(planned.spec(job), "ok", "") | {"toppled": job % 3 == 0, "attempt": 1}
        for job in range(len(planned))
    ]
    with session(run), journal(run):
        for begin in range(0, 12, 4):
            write_part(run, rows[begin : begin + 4])
            log_event("rows stored", workers=2, deaths=0, again=0)
    shutil.copytree(run, folder / "complete")
    write_part(folder / "complete", rows[12:])
    compact(folder / "complete")
    return folder


def answers_of_scene(run):
    scene = Scene.load(run / "scene")
    pedestal = scene.pedestal
    arrays = (
        scene.rock.vertices_m, scene.rock.faces, pedestal.point_m, pedestal.normal, pedestal.vertices_m,
        pedestal.faces, scene.origin_m,
    )  # fmt: skip
    result = (scene.contact, scene.gravity_m_s2, scene.report, open_run(run).scene().to_pylist())
    return *(array.tobytes() for array in arrays), repr(result)


def answers_of_ensemble(run):
    ensemble = Ensemble.load(run / "ensemble")
    motions = [ensemble.record(name).motion for name in ensemble.record_ids]
    result = repr((ensemble.catalog.to_pylist(), open_run(run).motions().to_pylist()))
    return result, *(
        motion.acceleration_m_s2.tobytes() + bytes(repr(motion.time_step_s), "ascii") for motion in motions
    )


def answers_of_run(run):
    rows = open_run(run).table()
    job = specification(run, read_table(run / "jobs.parquet")["job_id"][0].as_py())
    return repr((state_of(run), rows.to_pylist(), open_run(run).provenance(), last(run, "rows stored"), job))


def answers_to(run, name):
    if name.startswith("scene/"):
        return answers_of_scene(run)
    return answers_of_ensemble(run) if name.startswith("ensemble/") else answers_of_run(run)


def victims(runs):
    for run in ("interrupted", "complete"):
        for path in sorted((runs / run).rglob("*")):
            if path.is_file() and path.name != ".lock":
                yield runs / run, str(path.relative_to(runs / run))


@pytest.mark.thorough
@pytest.mark.parametrize("count", [150, pytest.param(10_000, marks=pytest.mark.slow)])
@pytest.mark.timeout(1800)
def test_a_flipped_bit_or_a_lost_end_of_any_file_is_reported_or_without_effect(runs, count, caplog):
    chance = random.Random(SEED + count)
    files = list(victims(runs))
    names = {name for _, name in files}
    assert names >= {
        "run.json", "run.log", "campaign.toml", "jobs.parquet", "results.parquet", "scene/scene.json", "scene/rock.ply",
        "scene/pedestal.ply", "ensemble/catalog.parquet", "ensemble/motions.parquet",
    }  # fmt: skip
    assert sum(name.startswith("parts/") for name in names) == 3
    undamaged = {file: answers_to(*file) for file in files}
    for _ in range(count):
        run, name = file = chance.choice(files)
        path = run / name
        content = path.read_bytes()
        caplog.clear()
        what = damage(path, chance)
        try:
            with caplog.at_level(logging.WARNING):
                answer, result = answers_to(run, name), caplog.text
        except InputError as error:
            answer, result = None, str(error)
        finally:
            path.write_bytes(content)
        named = path.name in result or path.parent.name in result
        assert named or answer == undamaged[file], f"{name}, {what}: {result or 'silently another answer'}"


def damage(path, chance):
    """Flip a bit of a file, or cut it; a log that a crash cuts is the one of a moment before, and only flipped."""
    content = bytearray(path.read_bytes())
    if chance.random() < 0.2 and path.suffix != ".log":
        at = chance.randrange(len(content))
        path.write_bytes(content[:at])
        return f"cut at {at}"
    bit = chance.randrange(8 * len(content))
    content[bit // 8] ^= 1 << bit % 8
    path.write_bytes(content)
    return f"bit {bit} flipped"


def test_a_run_whose_own_files_are_damaged_does_not_go_on(runs, tmp_path):
    run = shutil.copytree(runs / "interrupted", tmp_path / "run")
    planned = plan_of(Campaign.read(runs / "campaign.toml"))
    prepare(run, planned, dict(versions()))
    for name in NEEDED:
        path = run / name
        content = path.read_bytes()
        path.write_bytes(content[:-9] + bytes([content[-9] ^ 16]) + content[-8:])
        with refused("file.damaged"):
            prepare(run, planned, dict(versions()))
        path.write_bytes(content)
    prepare(run, planned, dict(versions()))


def test_a_folder_that_another_session_began_meanwhile_is_resumed(runs, tmp_path, monkeypatch):
    planned = plan_of(Campaign.read(runs / "campaign.toml"))
    begin = run_folder.begin

    def late(run, *arguments):
        begin(run, *arguments)  # by the other session, between this one's look and its own beginning
        begin(run, *arguments)

    monkeypatch.setattr(run_folder, "begin", late)
    prepare(tmp_path / "run", planned, dict(versions()))
    assert state_of(tmp_path / "run")["jobs"] == len(planned)
