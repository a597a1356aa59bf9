"""What a job's identity covers, and what its realisation draws: the same whatever else is drawn."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record
from toppling.models.motions.synthetic import synthetic_ensemble
from toppling.models.pedestal import ContactProperties
from toppling.models.scene import Scene
from toppling.workers.job import Assets, JobSpec, prepared
from toppling.workers.unmeasured import Unmeasured


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    return Ensemble.write(tmp_path_factory.mktemp("quakes"), synthetic_ensemble(1, 3))


def realised(scene, ensemble, realisation):
    record = ensemble.record(ensemble.record_ids[0])
    spec = JobSpec(
        scene.id,
        record.record_id,
        record.sha,
        5.0,
        0.0,
        0.8,
        0.6,
        0.1,
        realisation=realisation,
        preset="fast",
    )
    return prepared(spec, Assets(scene, ensemble))[0]


def test_what_a_realisation_draws_from_is_in_the_scenes_id(ensemble):
    bare = Scene.block(0.2, 0.2, 0.6)
    scanned = [replace(bare, report={"uncertainty": {"com_std_m": [spread] * 3}}) for spread in (0.002, 0.02)]
    assert len({scene.id for scene in (bare, *scanned)}) == 3
    assert replace(bare, report={"uncertainty": {}}).id == bare.id
    offsets = [realised(scene, ensemble, 1).rock.com_m - scene.rock.com_m for scene in scanned]
    assert np.linalg.norm(offsets[1]) > 2.0 * np.linalg.norm(
        offsets[0]
    )  # other draws too: the seed is the id
    assert (realised(bare, ensemble, 0).rock.com_m == bare.rock.com_m).all()


def test_a_realisation_draws_a_lognormal_factor_on_both_frictions_and_none_in_the_first(ensemble):
    scene, draws = Scene.block(0.2, 0.2, 0.6), 200
    drawn = [realised(scene, ensemble, number).contact for number in range(1, draws + 1)]
    factors = np.array([contact.friction_static for contact in drawn]) / 0.8
    assert [contact.friction_kinetic for contact in drawn] == pytest.approx(0.6 * factors)
    assert {contact.restitution for contact in drawn} == {0.1}
    # Four standard errors of the mean and of the deviation of as many draws.
    assert abs(np.log(factors).mean()) < 4.0 * 0.05 / np.sqrt(draws)
    assert np.log(factors).std() == pytest.approx(0.05, abs=4.0 * 0.05 / np.sqrt(2.0 * draws))
    assert realised(scene, ensemble, 0).contact == ContactProperties(0.8, 0.6, 0.1)


def test_a_realisation_draws_the_same_again_in_a_worker_that_has_forgotten_it(ensemble):
    scene = Scene.block(0.2, 0.2, 0.6)
    first = realised(scene, ensemble, 3)
    again = realised(replace(scene), ensemble, 3)
    assert again is not first
    assert again.contact == first.contact
    assert (again.rock.com_m == first.rock.com_m).all()


def test_every_realisation_stands_on_its_own_drawn_base_and_the_first_on_the_scenes(ensemble):
    corners = np.array([[-0.2, -0.2, 0.0], [0.2, -0.2, 0.0], [0.0, 0.2, 0.0]])
    draws = tuple(BaseDraw(corners * (share, share, 1.0), np.full(3, 0.01 * share)) for share in (1.0, 0.5))
    scene = replace(Scene.block(0.2, 0.2, 0.6), unseen=UnseenBase(0.1, draws))
    assert realised(scene, ensemble, 0).rock.feet_m is None
    for number, draw in ((1, 0), (2, 1), (3, scene.unseen.number_of(3))):
        rock = realised(scene, ensemble, number).rock
        np.testing.assert_allclose(rock.feet_m[:3], draws[draw].feet_m, atol=1e-12)
        assert rock.feet_m[3:, 2].min() >= 0.1
        np.testing.assert_allclose(rock.com_m, scene.rock.com_m + draws[draw].com_offset_m, atol=1e-12)
    contacts = [realised(scene, ensemble, number).contact for number in range(1, 5)]
    assert len(set(contacts)) == 4


ALL = Unmeasured((0.5, 1.0), (0.0, 0.3), 5.0, either_sense=True)
BAND = Unmeasured(band_hz=10.0, above_band=(0.3, 0.6))
NOMINAL = ContactProperties(0.75, 0.7, 0.1)
NUMBERS = range(1, 129)


def test_draws_fill_their_intervals_evenly():
    drawn = [ALL.contact(NOMINAL, number) for number in NUMBERS]
    friction = np.sort([contact.friction_static for contact in drawn])
    restitution = np.sort([contact.restitution for contact in drawn])
    # A sequence of low discrepancy: each of sixteen parts has eight of 128 points, give or take one.
    for values, low, high in ((friction, 0.5, 1.0), (restitution, 0.0, 0.3)):
        assert np.histogram(values, 16, (low, high))[0] == pytest.approx(8, abs=1)
    assert all(contact.friction_kinetic == contact.friction_static for contact in drawn)


def test_the_motion_is_turned_by_the_yaw_and_half_of_the_time_about():
    turns = np.array([ALL.turn_deg(number) for number in NUMBERS])
    about = np.abs(turns) > 90.0
    assert about.sum() == pytest.approx(64, abs=1)
    yaw = np.where(about, turns - 180.0, turns)
    assert np.abs(yaw).max() <= 5.0
    assert abs(yaw.mean()) < 0.2
    assert abs(np.corrcoef(about, yaw)[0, 1]) < 0.15


def test_the_first_realisation_and_what_is_not_named_draw_nothing():
    assert ALL.contact(NOMINAL, 0) == NOMINAL
    assert ALL.turn_deg(0) == 0.0
    bare = Unmeasured()
    assert bare.contact(NOMINAL, 5) == NOMINAL
    assert bare.turn_deg(5) == 0.0
    assert Unmeasured(restitution=(0.0, 0.3)).contact(NOMINAL, 5).friction_static == 0.75


def test_a_job_shakes_with_the_draws_that_its_id_determines(tmp_path):
    along = np.outer(np.sin(np.arange(200) / 10.0), [2.0, 0.0, 0.0])
    record = Record.of("made", Motion(along, 0.01), component_azimuths_deg=(0.0, 90.0))
    assets = Assets(Scene.block(0.2, 0.2, 0.6), Ensemble.write(tmp_path / "one", [record]))
    given = (assets.scene.id, "made", record.sha, record.intensity["pga_m_s2"], 0.0, 0.8, 0.8, 0.0)
    spec = JobSpec(*given, realisation=7, preset="fast", unmeasured=ALL)
    scene, imposed = prepared(spec, assets)
    turn = np.deg2rad(ALL.turn_deg(7))
    np.testing.assert_allclose(
        imposed.motion.acceleration_m_s2[:, :2], along[:, :1] * [np.cos(turn), np.sin(turn)], atol=1e-9
    )
    assert scene.contact == ALL.contact(ContactProperties(0.8, 0.8, 0.0), 7)
    assert spec.job_id != JobSpec(*given, realisation=7, preset="fast").job_id


def test_a_job_adds_what_the_records_band_left_out_and_states_the_records_own_strength(tmp_path):
    noise = np.outer(np.random.default_rng(3).normal(size=400), [1.0, 0.0, 0.0])
    record = Record.of("made", Motion(noise, 0.01), component_azimuths_deg=(0.0, 90.0))
    assets = Assets(Scene.block(0.2, 0.2, 0.6), Ensemble.write(tmp_path / "one", [record]))
    given = (assets.scene.id, "made", record.sha, record.intensity["pga_m_s2"], 0.0, 0.8, 0.8, 0.0)
    nominal, second, third = (
        prepared(JobSpec(*given, realisation=number, preset="fast", unmeasured=BAND), assets)[1]
        for number in (0, 1, 2)
    )
    np.testing.assert_array_equal(nominal.motion.acceleration_m_s2, noise)
    assert second.motion.acceleration_m_s2.shape == third.motion.acceleration_m_s2.shape
    assert not np.array_equal(second.motion.acceleration_m_s2, third.motion.acceleration_m_s2)
    assert second.intensity == third.intensity == nominal.intensity


@pytest.mark.parametrize("draws", [32, 48, 29])
def test_friction_varies_as_much_on_a_base_as_on_all_bases(draws):
    feet_m = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    bases = UnseenBase(0.1, (BaseDraw(feet_m),) * draws)
    realisations = range(1, 20 * draws + 1)
    frame = pd.DataFrame({
        "base": [bases.number_of(realisation) for realisation in realisations],
        "friction": [
            Unmeasured(friction=(0.5, 1.0)).contact(ContactProperties(0.7, 0.7), realisation).friction_static
            for realisation in realisations
        ],
    })  # fmt: skip
    on_one = frame.groupby("base")["friction"]
    assert (on_one.size() == 20).all()
    uniform_std = 0.5 / np.sqrt(12.0)
    assert on_one.std().mean() == pytest.approx(uniform_std, rel=0.1)
