"""What a user knows of the base, as files and options say it."""

import numpy as np
import pytest

from toppling.models.errors import InputError
from toppling.models.scan.inspection import Inspection, inspection_of


def test_a_file_tells_places_that_touch_from_places_with_daylight(tmp_path):
    path = tmp_path / "looked.csv"
    path.write_text("x,y,z,kind\n331250.1,3777309.2,480.3,touch\n331251;3777310;480.2;daylight\n# end\n")
    found = inspection_of(path, [(135.0, 0.32)])
    assert found.touching_m.tolist() == [[331250.1, 3777309.2, 480.3]]
    assert found.open_m.tolist() == [[331251.0, 3777310.0, 480.2]]
    assert found.pulls == ((135.0, 0.32),)
    np.testing.assert_allclose(
        found.moved(np.array([331250.0, 3777309.0, 480.0])).touching_m, [[0.1, 0.2, 0.3]]
    )


@pytest.mark.parametrize(
    "text", ["", "1,2,3\n", "1,2,3,maybe\n", "x,y,z,kind\n1,2,touch\n", "1,2,inf,touch\n"]
)
def test_a_file_that_says_no_place_is_refused_with_its_line(tmp_path, text):
    path = tmp_path / "looked.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"line \d|no places"):
        inspection_of(path)


@pytest.mark.parametrize("pull", [(np.nan, 0.3), (90.0, 0.0), (90.0, -0.2), (90.0, 30.0)])
def test_a_pull_with_a_force_beyond_reason_is_refused(pull):
    with pytest.raises(InputError, match="no pull test"):
        inspection_of(None, [pull])


def test_nothing_said_is_known_as_such():
    assert Inspection().says_nothing
    assert not inspection_of(None, [(0.0, 0.2)]).says_nothing
