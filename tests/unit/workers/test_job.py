"""What a job's identity covers, and what its realisation draws."""

from dataclasses import replace

import numpy as np
import pytest

from toppling.models.hidden_base.draws import BaseDraw, UnseenBase
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.synthetic import synthetic_ensemble
from toppling.models.pedestal import ContactProperties
from toppling.models.scene import Scene
from toppling.workers.job import Assets, JobSpec, prepared


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    return Ensemble.write(tmp_path_factory.mktemp("quakes"), synthetic_ensemble(1, 3))


def realised(scene, ensemble, realisation):
    """The scene that a job of this realisation shakes."""
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


def test_each_realisation_stands_on_its_own_drawn_base_and_the_first_on_the_scenes(ensemble):
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
