"""Pictures say what they show: nothing stretched, nothing past its end, no claim that the jobs do not bear."""

import numpy as np
import pandas as pd
import pytest
from refusals import refused
from seeded import rows

from toppling.models.files.digest import write_json
from toppling.results.analysis.fits import answered, headline
from toppling.results.analysis.fragility import contact_words
from toppling.results.analysis.lognormal import fit
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.sections import methods_section
from toppling.results.drawing.report.write import write_pdf
from toppling.results.drawing.side_by_side_figures import across_date_line
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


def test_a_contact_whose_friction_realisations_drew_is_not_named_by_one_number(jobs):
    one = jobs.assign(friction_static=0.8, friction_kinetic=0.8, friction_factor=1.0)
    assert contact_words(one, one) == "μ = 0.8"
    near = one.assign(friction_factor=np.linspace(0.98, 1.08, len(one)))
    assert contact_words(near, near) == "μ about 0.8"
    wide = one.assign(friction_factor=np.linspace(0.625, 1.25, len(one)))
    assert contact_words(wide, wide) == "μ 0.5 to 1"


@pytest.mark.parametrize(("engine", "other"), [("pybullet", "Todorov"), ("mujoco", "Coumans")])
def test_methods_name_and_cite_the_engine_that_shook_and_no_other(tmp_path, engine, other):
    write_json(tmp_path / "run.json", {"engine": ENGINES[engine].citation})
    write_part(tmp_path, [row | {"engine": engine} for row in rows(records=3, azimuths=(0.0,))])
    methods, _, cited = methods_section(Content(open_run(tmp_path)), Document())
    written = " ".join([methods["text"], *cited["texts"]])
    assert f"on {ENGINES[engine].title} ({ENGINES[engine].authors}), following" in written
    assert other not in written


def test_where_nothing_prints_a_pdf_it_is_said_what_would(monkeypatch, tmp_path):
    monkeypatch.setitem(__import__("sys").modules, "weasyprint", None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with refused("package.not_installed"):
        write_pdf("<p>text</p>", tmp_path / "report.pdf")
    assert not (tmp_path / "report.pdf").exists()


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ((179.95, -179.95), (179.95, 180.05)),
        ((7.0, -118.0), (7.0, -118.0)),
        ((175.0, -175.0, 170.0), (175.0, 185.0, 170.0)),
    ],
)
def test_neighbours_across_the_date_line_are_neighbours_on_the_map(given, shown):
    points = np.column_stack([given, np.zeros(len(given))])
    np.testing.assert_allclose(across_date_line(points)[:, 0], shown)
