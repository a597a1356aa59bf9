"""Pictures say what they show: nothing stretched, nothing past its end, no claim that the jobs do not bear."""

import pandas as pd
import pytest
from seeded import rows

from toppling.models.files.digest import write_json
from toppling.results.analysis.fits import answered, headline
from toppling.results.analysis.lognormal import fit
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.page import methods_section
from toppling.results.drawing.templates import Document
from toppling.results.reader import open_run
from toppling.results.schema import SCHEMA
from toppling.results.store import write_part
from toppling.workers.engines import ENGINES


@pytest.fixture(scope="module")
def jobs():
    frame = answered(pd.DataFrame(rows(records=20, azimuths=(0.0,)), columns=SCHEMA.names))
    return frame.assign(pga_vertical_m_s2=frame["pgv_m_s"])


def test_a_curve_over_vertical_pga_never_stands_for_a_run(jobs):
    vertical, level = (fit(jobs, [name]) for name in ("pga_vertical_m_s2", "pga_m_s2"))
    assert vertical.lognormal is not None
    assert headline([vertical, level]) is level
    assert headline([vertical]) is None


@pytest.mark.parametrize(("engine", "other"), [("pybullet", "Todorov"), ("mujoco", "Coumans")])
def test_methods_name_and_cite_the_engine_that_shook_and_no_other(tmp_path, engine, other):
    write_json(tmp_path / "run.json", {"engine": ENGINES[engine].citation})
    write_part(tmp_path, [row | {"engine": engine} for row in rows(records=3, azimuths=(0.0,))])
    methods, _, cited = methods_section(Content(open_run(tmp_path)), Document())
    written = " ".join([methods["text"], *cited["texts"]])
    assert f"on {ENGINES[engine].title} ({ENGINES[engine].authors}), following" in written
    assert other not in written
