"""Pictures say what they show: nothing stretched, nothing past its end, no claim that the jobs do not bear."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from reference.idealised import full_sine
from refusals import refused
from seeded import rows

from toppling.models.files.digest import write_json
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.synthetic import synthetic_ensemble
from toppling.models.scene import Scene
from toppling.models.trajectory import Trajectory
from toppling.results.analysis.fits import answered, headline
from toppling.results.analysis.fragility import contact_words
from toppling.results.analysis.ranking import calibration, compare_measures, observed_fractions, out_of_fold
from toppling.results.analysis.regression import fit
from toppling.results.drawing.fit_figures import fit_figure
from toppling.results.drawing.record_figures import records_figure, scatter, upper_limit
from toppling.results.drawing.report.content import Content
from toppling.results.drawing.report.document import Document
from toppling.results.drawing.report.methods import methods_section
from toppling.results.drawing.report.write import write_pdf
from toppling.results.drawing.side_by_side_figures import across_date_line
from toppling.results.drawing.trajectory_figures import AFTER_FALL_S, trajectory_figure
from toppling.results.reader import open_run
from toppling.results.replayed_job import Replay
from toppling.results.schema import SCHEMA
from toppling.results.store import write_part
from toppling.workers.engines import ENGINES


def test_an_outlier_stretches_no_axis_and_is_named_with_its_value():
    x, names = np.append(np.linspace(0.05, 0.25, 20), 9.0), [f"record{k}" for k in range(21)]
    assert upper_limit(x) < 0.3
    axes = Figure().add_subplot()
    scatter(axes, x, np.ones(21), names, "k")
    assert axes.get_xlim()[1] < 0.3
    assert axes.get_title("right") == "▶ record20: 9"


def test_an_outlier_on_a_logarithmic_axis_stretches_it_neither_up_nor_down_and_is_named():
    y = np.append(np.geomspace(0.5, 8.0, 30), [1e-3, 1e3])
    axes = Figure().add_subplot()
    scatter(axes, np.linspace(0.1, 0.2, 32), y, [f"record{k}" for k in range(32)], "k")
    bottom, top = axes.get_ylim()
    assert 0.2 < bottom < 0.5
    assert 8.0 < top < 20.0
    assert axes.get_title("right").splitlines() == ["▼ record30: 0.001", "▲ record31: 1e+03"]


def test_the_axis_of_distance_holds_the_farthest_record(tmp_path):
    km = (900.0, 10.0, 11.0, 12.0, 13.0, 14.0)
    made = zip(synthetic_ensemble(len(km), 1), km, strict=True)
    near = [dataclasses.replace(one, distance_km=distance) for one, distance in made]
    source = records_figure(Ensemble.write(tmp_path / "ensemble", near)).axes[2]
    assert source.get_xlim()[1] > 900.0
    assert sorted(np.asarray(source.collections[0].get_offsets())[:, 0]) == sorted(km)


def test_a_figure_of_records_without_magnitudes_states_no_numbers_for_them(tmp_path):
    made = [dataclasses.replace(one, magnitude=None) for one in synthetic_ensemble(1, 1)]
    figure = records_figure(Ensemble.write(tmp_path / "ensemble", made))
    assert not figure.axes[2].axison
    assert "not drawn" in figure.axes[2].get_title()
    assert figure.get_suptitle() == "1 record, 1 event"


def trajectory(end_s):
    time = np.linspace(0.0, end_s, 50)
    zero = np.zeros(50)
    return pd.DataFrame(
        {"time_s": time, "tilt_deg": 10 * time, "com_x_m": zero, "com_y_m": zero, "com_z_m": zero}
    )


def test_three_components_have_three_axes_and_the_motion_ends_soon_after_the_fall():
    motion = full_sine(4.0, 8.0)
    fallen = trajectory_figure(trajectory(3.0), motion, "", topple_time_s=2.0).axes
    standing = trajectory_figure(trajectory(3.0), motion, "").axes
    assert [axes.get_ylabel() for axes in fallen[:3]] == ["east", "north", "up"]
    assert len({axes.get_ylim() for axes in fallen[:3]}) == 1
    assert fallen[0].get_xlim()[1] == pytest.approx(3.0 + AFTER_FALL_S)
    assert standing[0].get_xlim()[1] == pytest.approx(motion.duration_s)
    assert "no return" in [text.get_text() for axes in fallen for text in axes.texts]


@pytest.mark.parametrize("topple_time_s", [None, 7.0])
def test_a_rock_that_moves_on_after_the_motion_is_shown_to_its_last_pose(topple_time_s):
    motion = full_sine(1.0, 8.0)
    drawn = trajectory_figure(trajectory(9.0), motion, "", topple_time_s=topple_time_s).axes
    assert motion.duration_s < 9.0
    assert drawn[0].get_xlim()[1] == pytest.approx(9.0)


@pytest.fixture(scope="module")
def jobs():
    frame = answered(pd.DataFrame(rows(records=20, azimuths=(0.0,)), columns=SCHEMA.names))
    return frame.assign(pga_vertical_m_s2=frame["pgv_m_s"])


def test_a_curve_over_vertical_pga_never_stands_for_a_run(jobs):
    vertical, level = (fit(jobs, [name]) for name in ("pga_vertical_m_s2", "pga_m_s2"))
    assert vertical.lognormal is not None
    assert headline([vertical, level]) is level
    assert headline([vertical]) is None


@pytest.mark.parametrize(("toppled", "is_ranked"), [(9, False), (10, True)])
def test_a_picture_of_too_few_topplings_says_so_and_ranks_nothing(jobs, toppled, is_ranked):
    curve = fit(jobs, ["pgv_m_s"]).lognormal
    ranking = compare_measures(jobs, [["pgv_m_s"], ["pga_m_s2"]], samples=20)
    calibrated = calibration(jobs, out_of_fold(jobs, ["pgv_m_s"]))
    figure = fit_figure(curve, observed_fractions(jobs, "pgv_m_s"), ranking, calibrated, toppled)
    left, middle, _ = figure.axes
    assert ("too few topplings" in left.get_title()) != is_ranked
    assert any("too few topplings" in text.get_text() for text in middle.texts) != is_ranked
    assert ("PGV" in [label.get_text() for label in middle.get_yticklabels()]) == is_ranked


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


def test_a_run_calls_its_rock_as_it_was_called_when_the_run_began(tmp_path):
    (tmp_path / "first").mkdir()
    write_part(tmp_path / "first", rows(records=3, azimuths=(0.0,)))
    (tmp_path / "first" / "campaign.toml").write_text('scene = "scene"\n')  # the run's own copy
    assert open_run(tmp_path / "first").rock == "first"
    write_json(tmp_path / "first" / "run.json", {"rock": "echo_cliffs"})
    assert open_run(tmp_path / "first").rock == "echo_cliffs"


def test_where_nothing_prints_a_pdf_it_is_said_what_would(monkeypatch, tmp_path):
    monkeypatch.setitem(__import__("sys").modules, "weasyprint", None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with refused("package.not_installed"):
        write_pdf("<p>text</p>", tmp_path / "report.pdf")
    assert not (tmp_path / "report.pdf").exists()


def test_a_replay_of_a_rock_that_rests_shows_the_whole_motion():
    scene, motion = Scene.block(0.2, 0.2, 0.6), full_sine(1.0, 2.0)
    rest = Trajectory(np.zeros(1), scene.rock.com_m[None, :], np.array([[0.0, 0.0, 0.0, 1.0]]))
    assert Replay(scene, motion, rest).shown_s() == (0.0, motion.duration_s)


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
