"""Seismograms at many sites, each shaken with the rocks that stand there."""

from contextlib import contextmanager
from dataclasses import dataclass

import pandas as pd
import pytest
from distributed import Client
from reference.idealised import ricker
from refusals import refused

from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator import cluster
from toppling.orchestrator.site_table import Site
from toppling.orchestrator.studies import seismograms
from toppling.orchestrator.studies.seismograms import (
    Seismogram,
    check_sites,
    matrix_of,
    of_ensemble,
    seismograms_of,
)


@dataclass(frozen=True)
class Judged:
    record_id: str
    outcome: str
    probability: float


def judge(scene, record, factors, preset):
    """A rock as wide as the record is strong topples; one of half a metre does not stand."""
    width = scene.rock.vertices_m[:, 0].max()
    if width > 0.45:
        raise InputError(
            "rock.does_not_stand",
            "left alone, the rock does not stand",
            where="scene",
            expected="one that does",
            remedy="none",
        )
    toppled = record.intensity["pga_m_s2"] > 10 * width
    return Judged(record.record_id, "toppled" if toppled else "stands", float(toppled))


@pytest.fixture(autouse=True)
def judged_by_width(monkeypatch):
    """Workers are threads of this process, which know what is replaced."""

    @contextmanager
    def local(workers):
        with Client(
            n_workers=workers, threads_per_worker=1, processes=False, dashboard_address=None
        ) as client:
            yield client

    monkeypatch.setattr(seismograms, "judged", judge)
    monkeypatch.setattr(cluster, "local", local)


@pytest.fixture(scope="module")
def sites(tmp_path_factory):
    place = tmp_path_factory.mktemp("sites")
    found = []
    for name, width, site in (
        ("narrow", 0.1, "Echo"),
        ("wide", 0.3, "echo"),
        ("falls", 0.5, "Lion"),
        ("lost", 0.2, "Moon"),
    ):
        Scene.block(width, 0.6, 0.8).save(place / name)
        found.append(Site(place / name, name, site, -117.0, 34.0))
    return found


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    folder = tmp_path_factory.mktemp("records")
    records = [
        Record.of(f"{station}{n}", ricker(2.0 * (n + 1), 0.8, 0.01), station=station, event=f"event {n}")
        for station in ("ECHO", "Lion", "Mars")
        for n in range(2)
    ]
    Ensemble.write(folder, records)
    return of_ensemble(folder)


def test_rocks_are_shaken_by_their_own_seismograms_and_an_unstable_rock_delays_no_other(sites, given):
    rows, by_one = (check_sites(sites, given, [1.0], "fast", workers=number) for number in (2, 1))
    pd.testing.assert_frame_equal(rows, by_one)
    of = dict(list(rows.groupby("rock")))
    assert of["narrow"]["record_id"].tolist() == of["wide"]["record_id"].tolist() == ["ECHO0", "ECHO1"]
    assert of["narrow"]["outcome"].tolist() == ["toppled", "toppled"]
    assert of["wide"]["outcome"].tolist() == ["stands", "toppled"]
    assert set(of["falls"]["outcome"]) == {"failed"}
    assert of["falls"]["message"].str.contains("does not stand").all()
    assert of["lost"]["outcome"].tolist() == ["none"]
    matrix = matrix_of(rows)
    assert matrix.loc["wide"].tolist() == [0.0, 1.0]
    assert list(matrix.index) == ["falls", "lost", "narrow", "wide"]
    assert matrix.loc[["falls", "lost"]].isna().all().all()


def test_a_folder_named_as_a_site_stands_for_its_station(sites, tmp_path):
    case = Seismogram(tmp_path, "R", "Mars", "", ("sims/ECHO/strike.csv",))
    assert case.is_at("Echo")
    assert case.scenario == "strike"
    assert seismograms_of(sites[0], sites, [case]) == [case]


def test_seismograms_of_no_site_are_refused(sites, given):
    with refused("rocks.no_seismograms", "2"):
        check_sites(sites[:2], [r for r in given if r.station == "Mars"], [1.0], "fast", workers=1)
