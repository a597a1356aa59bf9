"""Which study a folder holds, and which rock it is of."""

import dataclasses

import pytest
from click.testing import CliRunner

from toppling.models.errors import InputError
from toppling.models.files.digest import write_json
from toppling.orchestrator.studies.replication import Study
from toppling.orchestrator.verbs.study import study


def test_a_folder_of_before_engines_could_be_chosen_is_one_of_the_default(tmp_path):
    told = dataclasses.asdict(Study())
    del told["engine"]
    write_json(tmp_path / "study.json", told)
    Study().check(tmp_path)
    with pytest.raises(InputError, match="other engine"):
        Study(engine="mujoco").check(tmp_path)


def test_rock_and_scene_exclude_each_other(tmp_path):
    said = CliRunner().invoke(study, [str(tmp_path / "out"), "--rock", "echo-cliffs", "--scene", "rock"])
    assert said.exit_code == 2
    assert "exclude each other" in said.output
    assert not (tmp_path / "out").exists()
