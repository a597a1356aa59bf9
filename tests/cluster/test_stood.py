"""From the command line: a motion that the rock stood weights the draws of its base."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from reference.idealised import ricker
from refusals import flip, refused
from small_campaigns import campaign_in

from toppling import run
from toppling.models.errors import InputError
from toppling.models.hidden_base.unseen_base import BaseDraw, UnseenBase
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.recorded import SHAKES
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.task import versions
from toppling.results.reader import open_run
from toppling.results.store import write_part
from toppling.results.weights import WEIGHTS_FILE
from toppling.workers.job import Assets, run_job

WEIGHTS = pytest.approx([17.0 / 9.0, 1.0 / 9.0])
"""Weights of a base on which the rock always stood, and of a base on which it never did."""


def toppling(*words):
    done = CliRunner().invoke(cli, [str(word) for word in words])
    if isinstance(done.exception, InputError):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A block on one stable and one weak base, and pulses that topple it on the weak one, or on none."""
    place = tmp_path_factory.mktemp("stood")
    half_m = (0.15, 0.06)
    feet = [np.array([[x, y, 0.0] for x in (-w, w) for y in (-0.2, 0.2)]) for w in half_m]
    bases = UnseenBase(0.05, tuple(BaseDraw(v) for v in feet))
    axes = {"azimuth_deg": [0], "realisations": 3, "preset": "fast", "audit": 0}
    levels = [0.8, 1.2, 1.6, 2, 2.5, 3, 4, 6, 8]
    scene = replace(Scene.block(0.15, 0.2, 0.6), unseen=bases)
    campaign_in(place, [0.5 + 0.2 * n for n in range(5)], scene, pga_m_s2=levels, **axes)
    Scene.block(0.15, 0.2, 0.6).save(place / "bare")
    for name, pga_m_s2, azimuths in (
        ("strong", 2.0, (0.0, 90.0)), ("weak", 0.3, (0.0, 90.0)), ("across", 2.0, (90.0, 180.0)),
    ):  # fmt: skip
        motion = ricker(pga_m_s2, 1.2, 90.0 if name == "across" else 0.0)
        Ensemble.write(place / name, [Record.of(name, motion, component_azimuths_deg=azimuths)])
    (place / "strong.toml").write_text((place / "campaign.toml").read_text() + 'stood = ["strong"]\n')
    return place


@pytest.fixture(scope="module")
def plain(folder):
    """A run whose jobs this process has done."""
    planned = plan_of(Campaign.read(folder / "campaign.toml"))
    prepare(folder / "run", planned, dict(versions()))
    assets = Assets(Scene.load(folder / "scene"), Ensemble.load(folder / "ensemble"))
    rows = [run_job(planned.spec(job), assets) | {"attempt": 1} for job in range(len(planned))]
    write_part(folder / "run", rows)
    return folder / "run"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("motion", "weights"), [("strong", WEIGHTS), ("weak", [1.0, 1.0]), ("across", [1.0, 1.0])]
)
def test_a_motion_weighs_bases_by_how_often_the_rock_stood_it_as_it_was_recorded(
    motion, weights, folder, plain
):
    """Along y, across the line in which they differ, the two bases are one."""
    asked = ("constrain", plain, "--measure", "pga_m_s2", "--json")
    without = json.loads(toppling(*asked).stdout)
    read = json.loads(toppling(*asked, "--stood", folder / motion).stdout)
    (base,) = read.pop("stood")
    assert [base["weights"]["0"], base["weights"]["1"]] == weights
    assert ([Path(f).name for f in base["files"]], base["bases"], base["shakes"]) == ([motion], 2, SHAKES)
    if motion == "strong":
        assert base["effective_bases"] == pytest.approx(1.117, abs=1e-3)
        assert base["median_shift_percent"] > 10.0
    else:
        assert read == without


@pytest.mark.thorough
def test_a_campaigns_weights_are_the_same_on_any_number_of_workers_and_as_constrain_finds_them(
    folder, plain, client
):
    run(folder / "strong.toml", folder / "strong-2", cluster=client)
    toppling("run", folder / "strong.toml", "--out", folder / "strong-1", "--workers", 1)
    first, two = (open_run(folder / f"strong-{workers}") for workers in (1, 2))
    ((weights,), (again,)) = (run.weights().by_contact.values() for run in (first, two))
    assert (weights == again).all()
    assert list(weights) == WEIGHTS
    assert (first.path / WEIGHTS_FILE).read_bytes() == (two.path / WEIGHTS_FILE).read_bytes()
    assert set(first.frame()["job_id"]) == set(open_run(plain).frame()["job_id"])  # the shakes are the same
    assert first.provenance()["plan_id"] != open_run(plain).provenance()["plan_id"]  # what they say is not
    asked = ("--measure", "pga_m_s2", "--json")
    read, later = (
        json.loads(toppling("constrain", run, *asked, *also).stdout)
        for run, also in ((first.path, ()), (plain, ("--stood", folder / "strong")))
    )
    assert read["unexceeded"] == pytest.approx(later["unexceeded"])
    assert read["stood"][0]["weights"] == later["stood"][0]["weights"]
    with refused("record.given_twice", "strong"):
        toppling("constrain", first.path, *asked, "--stood", folder / "strong")
    state = json.loads(toppling("status", first.path, "--json").stdout)
    assert state["stood"]["contacts"][0]["effective_bases"] == pytest.approx(1.117, abs=1e-3)
    # The folder repeats itself, and damaged weights stop it.
    toppling("run", first.path / "campaign.toml", "--out", first.path)
    flip(first.path / WEIGHTS_FILE)
    with refused("file.damaged", first.path / WEIGHTS_FILE):
        toppling("run", folder / "strong.toml", "--out", first.path)


@pytest.mark.parametrize(
    ("change", "code", "named"),
    [
        (('scene = "scene"', 'scene = "bare"'), "draws.missing", ""),
        (("realisations = 3", "realisations = 1"), "run.no_realisations", "3"),
        (("[4]", '["torn.v2"]'), "record.format_unknown", "torn.v2"),
        (("[4]", '["nowhere"]'), "file.absent", "nowhere"),
        (("[4]", '["strong", "twin"]'), "record.given_twice", "twin"),
        (("[4]", '"strong"'), "campaign.value_unusable", "'strong'"),
    ],
)
def test_what_cannot_weigh_bases_is_refused_by_name_before_a_run_begins(folder, change, code, named):
    (folder / "torn.v2").write_text("no record\n")
    if not (folder / "twin").exists():
        motion = Ensemble.load(folder / "strong").record("strong").motion
        Ensemble.write(folder / "twin", [Record.of("twin", motion, component_azimuths_deg=(0.0, 90.0))])
    text = (folder / "strong.toml").read_text()
    text = (
        text.replace('stood = ["strong"]', f"stood = {change[1]}")
        if change[0] == "[4]"
        else text.replace(*change)
    )
    (folder / "wrong.toml").write_text(text)
    with refused(code, named):
        toppling("run", folder / "wrong.toml", "--out", folder / "wrong")
    assert not (folder / "wrong").exists()
