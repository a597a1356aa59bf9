"""What a user knows of the base, as files and options say it."""

from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from toppling.models.hidden_base.inspection import inspection_of
from toppling.models.scan.read import Cloud
from toppling.models.scan.survey import survey
from toppling.orchestrator.public.making import in_files


def test_a_file_tells_places_that_touch_from_places_with_daylight(tmp_path):
    path = tmp_path / "looked.csv"
    path.write_text("x,y,z,kind\n331250.1,3777309.2,480.3,touch\n331251,3777310,480.2,daylight\n# end\n")
    found = inspection_of(path, [(135.0, 0.32)])
    assert found.touching_m.tolist() == [[331250.1, 3777309.2, 480.3]]
    assert found.open_m.tolist() == [[331251.0, 3777310.0, 480.2]]
    assert found.pulls == ((135.0, 0.32),)
    assert (found.file, found.lines) == (str(path), (2, 3))
    np.testing.assert_allclose(
        found.moved(np.array([331250.0, 3777309.0, 480.0])).touching_m, [[0.1, 0.2, 0.3]]
    )


@pytest.mark.parametrize(
    "text", ["", "1,2,3\n", "1,2,3,maybe\n", "x,y,z,kind\n1,2,touch\n", "1,2,inf,touch\n"]
)
def test_a_file_that_says_no_place_is_refused_with_its_line(tmp_path, text):
    path = tmp_path / "looked.csv"
    path.write_text(text)
    with refused("hint.place_unreadable" if text else "hint.no_places"):
        inspection_of(path)


@pytest.mark.parametrize(
    "pull", [(np.nan, 0.3), (90.0, 0.0), (90.0, -0.2), (90.0, 30.0), (500.0, 0.1), (360.0, 0.1), (-1.0, 0.1)]
)
def test_a_pull_beyond_the_round_or_with_a_force_beyond_reason_is_refused(pull):
    with refused("base.pull_unusable"):
        inspection_of(None, [pull])


def test_a_place_outside_the_cloud_is_refused_before_the_cloud_is_split(tmp_path, monkeypatch):
    path = tmp_path / "looked.csv"
    path.write_text("x,y,z,kind\n101,201,51,touch\n# mixed up\n201,101,51,daylight\n102,201,51,touch\n")
    points = np.random.default_rng(1).uniform(-3.0, 3.0, (500, 3))
    cloud = Cloud(points, np.array([100.0, 200.0, 50.0]), np.zeros(500, np.int16), (("a.xyz", 500),))
    monkeypatch.setattr("toppling.models.scan.survey.registered", lambda _: pytest.fail("registered"))
    with refused("hint.outside_cloud", "201.00", "101.00", "51.00") as error:
        survey(cloud, inspection=inspection_of(path))
    assert error.value.where == f"{path}, line 4"
    # The verb leaves the name of the file that is wrong as it is.
    assert in_files(error.value, (Path("a.xyz"),), path) is error.value
