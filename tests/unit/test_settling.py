"""How far a rock settles before it is shaken, and where a person is told."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.idealised import ricker
from scipy.spatial.transform import Rotation

from toppling.models.frames import horizontal_unit_vector, plane_normal
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.rocks_of_run import Settling, settling_notes
from toppling.orchestrator.run import run
from toppling.results.reader import open_run
from toppling.results.run_integrity import run_document

ROCK = box(0.3, 0.2, 0.5).moved(np.eye(3), (0.4, -0.3, 0.5))
REPORTED = "the rock settles by 1.0° toward W (0.02 m at its farthest point) before it is shaken"


def leaning(tilt_deg):
    """A scene of a block of .6 x .4 x 1 m that leans toward east over its edge, so that it settles toward west."""
    turn = Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix()
    turned = box(0.3, 0.2, 0.5).moved(turn)
    up = np.array([0.0, 0.0, -turned.vertices_m[:, 2].min()])
    return dataclasses.replace(Scene.block(0.3, 0.2, 0.5), rock=turned.moved(np.eye(3), up))


@given(st.floats(0.0, 40.0), st.floats(0.0, 360.0), st.floats(-180.0, 180.0), st.floats(0.2, 20.0))
def test_a_settling_is_the_turn_that_was_made_and_a_turn_about_the_normal_is_no_tilt(
    slope_deg, azimuth_deg, yaw_deg, tilt_deg
):
    normal = plane_normal(slope_deg, 30.0)
    across = np.cross(normal, horizontal_unit_vector(azimuth_deg))
    tilt = Rotation.from_rotvec(np.deg2rad(tilt_deg) * across / np.linalg.norm(across))
    yaw = Rotation.from_rotvec(np.deg2rad(yaw_deg) * normal)
    found = Settling.between(ROCK, ROCK.moved((tilt * yaw).as_matrix(), (0.1, 0.0, 0.0)), normal)
    # Through the arc's half sine, of rotations fitted to coordinates of size 1.
    assert found.tilt_deg == pytest.approx(tilt_deg, abs=1e-9)
    leant = tilt.apply(normal)[:2] - normal[:2]
    assert horizontal_unit_vector(found.toward_deg)[:2] == pytest.approx(
        leant / np.linalg.norm(leant), abs=1e-8
    )


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    """A campaign on a block that leans by a degree, and on a block that stands."""
    folder = tmp_path_factory.mktemp("inputs")
    Ensemble.write(folder / "ensemble", [Record.of("P", ricker(2.0, 0.6, 0.01))])
    for name, tilt_deg in (("leans", 1.0), ("stands", 0.0)):
        leaning(tilt_deg).save(folder / name)
        axes = {"pga_m_s2": [2], "azimuth_deg": [0], "friction": [0.8, 0.6]}
        text = {"scene": name, "ensemble": "ensemble", **axes}
        (folder / f"{name}.toml").write_text("".join(f"{key} = {json.dumps(text[key])}\n" for key in text))
    return folder


@pytest.mark.parametrize(("name", "stated"), [("leans", REPORTED), ("stands", None)])
def test_a_run_records_and_reports_by_how_much_its_rock_settles(campaigns, tmp_path, caplog, name, stated):
    def refuse(_):
        raise KeyboardInterrupt

    cluster = type("Refuses", (), {"__enter__": refuse, "__exit__": lambda *_: None})()
    with pytest.raises(KeyboardInterrupt):
        run(plan_of(Campaign.read(campaigns / f"{name}.toml")), tmp_path / "run", cluster, lambda _: None)
    assert run_document(tmp_path / "run")["settling"]["sentence"] == stated
    assert open_run(tmp_path / "run").rock == name  # the scene's own name, which the run's copy has lost
    logged = [json.loads(line) for line in (tmp_path / "run" / "run.log").read_text().splitlines()]
    for events in ([entry["event"] for entry in logged], caplog.messages):
        assert [event for event in events if "settles" in event] == ([stated] if stated else [])


@pytest.mark.parametrize(("tilt_deg", "notes"), [(0.0, 0), (0.3, 1), (2.0, 3)])
def test_a_large_settling_is_reported_with_the_toppling_acceleration_of_the_settled_rock(tilt_deg, notes):
    result = settling_notes(leaning(tilt_deg))
    assert len(result) == notes
    if notes == 3:  # of the block that lies flat, by the closed form
        assert f"topples it is {9.81 * 0.2 / 0.5:.3g} m/s2" in result[1]
