"""What a job's identity covers."""

from dataclasses import replace

import numpy as np
import pytest

from models import Scene
from models.motions.ensemble import Ensemble
from models.motions.synthetic import synthetic_ensemble
from workers.job import Assets, JobSpec, prepared


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    return Ensemble.write(tmp_path_factory.mktemp("quakes"), synthetic_ensemble(1, 3))


def drawn_com_m(scene, ensemble, realisation):
    record = ensemble.record(ensemble.record_ids[0])
    spec = JobSpec(
        scene.id,
        record.record_id,
        record.sha,
        5.0,
        0.0,
        0.8,
        0.8,
        0.0,
        realisation=realisation,
        preset="fast",
    )
    return prepared(spec, Assets(scene, ensemble))[0].rock.com_m


def test_what_a_realisation_draws_from_is_in_the_scenes_id(ensemble):
    bare = Scene.block(0.2, 0.2, 0.6)
    scanned = [replace(bare, report={"uncertainty": {"com_std_m": [spread] * 3}}) for spread in (0.002, 0.02)]
    assert len({scene.id for scene in (bare, *scanned)}) == 3
    assert replace(bare, report={"uncertainty": {}}).id == bare.id
    offsets = [drawn_com_m(scene, ensemble, 1) - scene.rock.com_m for scene in scanned]
    assert np.linalg.norm(offsets[1]) > 2.0 * np.linalg.norm(
        offsets[0]
    )  # other draws too: the seed is the id
    assert (drawn_com_m(bare, ensemble, 0) == bare.rock.com_m).all()
