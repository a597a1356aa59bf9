"""Many rocks in one run, on real workers: rows as of each rock alone, and rocks that fall hold up no other."""

import gc
import shutil
from contextlib import nullcontext

import numpy as np
import pytest
import trimesh
from reference.idealised import ricker
from refusals import refused

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.context import RunProgress, Work
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.run import run
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.task import shake_batch, versions
from toppling.results.reader import open_run


def leaning(folder):
    """A block whose base is cut so obliquely that it falls over."""
    lean = np.deg2rad(40.0)
    low = np.array([(x, y, -1.0 + 0.4 * x * np.tan(lean)) for x in (-0.3, 0.3) for y in (-0.3, 0.3)])
    top = np.array([(x + 3.0, y, 1.0) for x in (-0.3, 0.3) for y in (-0.3, 0.3)])
    hull = trimesh.convex.convex_hull(np.vstack([low, top]))
    Scene.from_mesh((hull.vertices, hull.faces)).save(folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("rocks")
    for name, width in (("narrow", 0.15), ("wide", 0.3)):
        Scene.block(width, 0.25, 0.8).save(place / "scenes" / name)
    leaning(place / "scenes" / "leaning")
    Ensemble.write(place / "quakes", [Record.of(f"P{n}", ricker(2.0, 0.5 + 0.4 * n, 0.01)) for n in range(3)])
    (place / "atlas.toml").write_text(
        'scenes = ["scenes/*"]\nensemble = "quakes"\npga_m_s2 = [2, 4, 8]\nazimuth_deg = [0, 90]\nfriction = [0.8]\n'
        'preset = "fast"\n'
    )
    return place


@pytest.fixture(scope="module")
def atlas(client, folder, tmp_path_factory):
    run_folder = tmp_path_factory.mktemp("run") / "atlas"
    planned = plan_of(Campaign.read(folder / "atlas.toml"))
    assert run(planned, run_folder, nullcontext(client), lambda _: None).done == 2 * 18
    return run_folder


def test_rows_of_an_atlas_equal_its_rocks_own_and_an_unstable_rock_delays_no_other(
    client, folder, atlas, tmp_path
):
    campaign = Campaign.read(folder / "atlas.toml")
    together = open_run(atlas).frame()
    assert sorted(together["rock"].unique()) == ["leaning", "narrow", "wide"]
    for site in campaign.sites:
        of_rock = together[together["rock"] == site.rock]
        if site.rock == "leaning":
            assert set(of_rock["status"]) == {"failed"}
            assert of_rock["message"].str.contains("does not stand").all()
            continue
        run(plan_of(campaign.of_site(site)), tmp_path / site.rock, nullcontext(client), lambda _: None)
        alone = open_run(tmp_path / site.rock).frame().set_index("job_id")
        of_rock = of_rock.set_index("job_id").loc[alone.index]
        for column in ("toppled", "max_tilt_deg", "slip_m", "topple_time_s", "pgv_m_s", "scene_id"):
            assert of_rock[column].equals(alone[column]), column
    again = run(plan_of(campaign), atlas, nullcontext(client), lambda _: None)
    assert (again.done, again.before) == (0, 3 * 18)


def test_a_file_of_another_atlas_is_refused_by_name(folder, tmp_path):
    prepare(tmp_path / "atlas", plan_of(Campaign.read(folder / "atlas.toml")), dict(versions()))
    scenes = tmp_path / "atlas" / "scenes"
    shutil.copyfile(scenes / "narrow" / "scene" / "scene.json", scenes / "wide" / "scene" / "scene.json")
    with refused("run.file_foreign", "scenes/wide/scene/scene.json"):
        open_run(tmp_path / "atlas")


@pytest.mark.thorough
def test_a_worker_holds_no_more_the_more_rocks_it_has_shaken(tmp_path):
    for number in range(36):
        Scene.block(0.15 + 0.005 * number, 0.25, 0.8).save(tmp_path / "scenes" / f"block{number:02d}")
    Ensemble.write(tmp_path / "quakes", [Record.of("P", ricker(2.0, 0.8, 0.01))])
    axes = {"pga_m_s2": [3], "azimuth_deg": [0], "friction": [0.8], "preset": "fast"}
    planned = plan_of(Campaign.of({"scenes": ["scenes/*"], "ensemble": "quakes", **axes}, tmp_path))
    prepare(tmp_path / "run", planned, dict(versions()))
    run_keys = Work(planned, tmp_path / "run", versions(), None, None, RunProgress(36, 0)).run_keys
    alive = []
    for row in range(len(planned)):
        scene = planned.scenes[planned.columns["scene_id"][row]]
        run_key, batch = run_keys[planned.columns["scene_id"][row]], planned.batch(np.array([row]))
        (answer,) = shake_batch(run_key, planned.campaign.settings, batch, 1.0).to_pylist()
        assert (answer["status"], answer["scene_id"]) == ("ok", scene.scene_id)
        if row >= 24:
            gc.collect()
            alive.append(sum(isinstance(value, Scene) for value in gc.get_objects()))
    # Each cache of what is derived from a scene holds eight, some are filled by every third rock only.
    assert max(alive[6:]) == max(alive[:6]) < 36
