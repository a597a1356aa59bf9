"""Objects that Python shows: what they are at a prompt and in a notebook."""

import numpy as np
import pytest
from seeded import rows

from toppling import Motion, Scene, fragility, open_run
from toppling.results.store import write_part


@pytest.fixture
def run(tmp_path):
    write_part(tmp_path, rows(records=12, levels=(4, 8, 12), azimuths=(0.0,)))
    return open_run(tmp_path)


def test_a_motion_has_attributes_of_the_names_it_takes():
    asked = {"acceleration_m_s2": np.ones((3, 3)), "time_step_s": 0.5}
    motion = Motion(**asked)
    for name, value in asked.items():
        np.testing.assert_array_equal(getattr(motion, name), value)


def test_scene_run_and_fragility_print_what_they_are_and_have_a_table_in_notebooks(run, tmp_path):
    drawn = fragility(run, tmp_path / "out", fit=True, samples=5)
    for one, word in ((Scene.block(0.2, 0.2, 0.6), "1.2 m"), (run, "36 of 36"), (drawn, "36, of which")):
        assert repr(one).startswith(f"{type(one).__name__}(")
        assert word in repr(one)
        assert one._repr_html_().startswith("<table>")
        assert word in one._repr_html_()
    assert drawn.curve("pgv_m_s") is drawn.curves[""]["pgv_m_s"]


def test_a_bearing_is_accepted_where_an_azimuth_is():
    block = Scene.block(0.2, 0.3, 0.6)
    assert block.quasi_static_toppling_m_s2(["N40E", "W"]) == block.quasi_static_toppling_m_s2([50.0, 180.0])
