"""Addresses of object stores are no folders of this machine; a shake is of a motion."""

import numpy as np
import pytest
from refusals import refused

from toppling.models.files.folder import local, new_file, new_folder
from toppling.models.files.stores import is_store
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.results.reader import open_run
from toppling.workers.shake import shake

ADDRESSES = [
    "s3://bucket/run", "gs://bucket/run", "S3://BUCKET/x", "az://c/x", "https://host/run", "file://host/x", "memory://x",
    "s4://bucket/run", "any+thing://x",
]  # fmt: skip


@pytest.mark.parametrize("address", ADDRESSES)
def test_addresses_are_refused_as_folders_and_nothing_is_made(address, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for use in (
        local,
        Scene.load,
        Ensemble.load,
        Scene.block(0.2, 0.2, 0.6).save,
        lambda path: new_folder(local(path)).__enter__(),
        lambda path: new_file(local(path)).__enter__(),
    ):
        with refused("file.is_address"):
            use(address)
    if not is_store(address):  # whose runs are brought here
        with refused("file.is_address"):
            open_run(address)
    (tmp_path / "campaign.toml").write_text(
        f'scene = "{address}"\nensemble = "e"\npga_m_s2 = [1]\nazimuth_deg = [0]\nfriction = [1]\n'
    )
    with refused("file.is_address"):
        Campaign.read(tmp_path / "campaign.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["campaign.toml"]


@pytest.mark.parametrize("address", ["file://{}", "file://localhost{}", "FILE://{}", "local://{}"])
def test_addresses_of_this_machine_are_paths(address, tmp_path):
    place = tmp_path / "with a blank"
    given = address.format(str(place).replace(" ", "%20"))
    assert local(given) == place
    Scene.block(0.2, 0.2, 0.6).save(place)
    assert Scene.load(given).id == Scene.load(place).id


@pytest.mark.parametrize("path", ["runs/first", "/data/x:y/run", "../s3/run", "c/a:b", "s3:run"])
def test_paths_with_colons_are_paths(path):
    assert str(local(path)) == path


def test_what_is_no_scene_or_no_motion_is_refused_by_its_kind():
    block, still = Scene.block(0.2, 0.2, 0.6), Motion(np.zeros((10, 3)), 0.01)
    for scene, motion in ((block, np.zeros((10, 3))), (block, None), ("scenes/rock", still), (still, block)):
        with refused("shake.kind_unusable"):
            shake(scene, motion)
