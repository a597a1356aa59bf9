"""Campaigns of many rocks: each is shaken as if alone, and takes its turn."""

import numpy as np
import pytest
from reference.idealised import ricker
from refusals import refused

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.dispatch import Dispatch
from toppling.orchestrator.plan import JOBS_OF_A_SCENE, plan, plan_of, taking_turns
from toppling.orchestrator.site_table import read_sites, sites_text

AXES = {"pga_m_s2": [2, 4, 8], "azimuth_deg": [0, 90], "friction": [0.8]}


def pulses(period_s, stations=("A", "B")):
    return [
        Record.of(f"{station}{n}", ricker(2.0, period_s + 0.4 * n, 0.01), station=station)
        for station in stations
        for n in range(2)
    ]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("atlas")
    for number, width in enumerate((0.15, 0.2, 0.3)):
        Scene.block(width, 0.25, 0.8).save(place / "scenes" / f"block{number}")
    Ensemble.write(place / "quakes", pulses(0.5))
    Ensemble.write(place / "own", pulses(0.8))
    (place / "sites.csv").write_text(
        "scene,site,longitude,latitude,ensemble,seismograms,age,friction\n"
        "scenes/block0,A,-117.5,34.25,,own,15000..30000,\n"
        "scenes/block1,B,-117.8,34.5,,own,,0.7\n"
    )
    return place


@pytest.fixture(scope="module")
def campaign(folder):
    return Campaign.of(
        {"scenes": ["scenes/*"], "sites": "sites.csv", "ensemble": "quakes", **AXES}, folder, "c.toml"
    )


@pytest.fixture(scope="module")
def planned(campaign):
    return plan_of(campaign)


def test_a_job_of_an_atlas_is_the_job_of_the_rock_alone(campaign, planned):
    together = set(planned.ids)
    for site in campaign.sites:
        alone = campaign.of_site(site)
        ids = plan(alone, Scene.load(alone.scene), Ensemble.load(alone.ensemble)).ids
        assert ids <= together
        together -= ids
    assert not together
    assert [planned.spec(row).job_id for row in range(len(planned))] == planned.jobs["job_id"].to_pylist()


def test_seismograms_that_several_rocks_name_go_to_the_rock_at_their_station(planned):
    records = [sorted(scene.record_sha) for scene in planned.scenes]
    assert records == [["A0", "A1"], ["B0", "B1"], ["A0", "A1", "B0", "B1"]]
    assert planned.scenes[1].campaign.friction == ((0.7, 0.7),)
    assert planned.scenes[2].campaign.friction == ((0.8, 0.8),)


def test_every_job_lasts_as_its_own_record(planned):
    rows = [planned.spec(row) for row in range(len(planned))]
    of = {scene.scene_id: scene.duration_s for scene in planned.scenes}
    assert planned.columns["duration_s"].tolist() == [of[spec.scene_id][spec.record_id] for spec in rows]


def test_every_beginning_of_an_atlas_has_equally_many_jobs_of_its_rocks_up_to_a_batch():
    orders = [np.arange(start, start + 1000) for start in (0, 1000, 2000)]
    order = taking_turns(orders)
    assert sorted(order) == list(range(3000))
    for beginning in range(0, 3001, 100):
        counts = np.bincount(order[:beginning] // 1000, minlength=3)
        assert np.ptp(counts) <= JOBS_OF_A_SCENE


def test_every_batch_is_of_a_single_rock():
    scene = np.repeat(np.arange(5), 40)
    order = taking_turns([np.flatnonzero(scene == number) for number in range(5)])
    dispatch, seen = Dispatch(order, np.ones(200), scene=scene), []
    while batch := dispatch.next_batch(3, room=17):
        assert len({scene[job] for job in batch.jobs}) == 1
        done = max(1, len(batch.jobs) // 2)
        seen += batch.jobs[:done]
        dispatch.came_back(batch, done)
    assert sorted(seen) == list(range(200))


def test_the_table_in_a_run_reads_back_as_it_was(campaign, tmp_path):
    (tmp_path / "sites.csv").write_text("# toppling-sha256:0\n" + sites_text(campaign.sites))
    read = read_sites(tmp_path / "sites.csv")
    out = [[e.rock, e.site, e.longitude, e.latitude, e.age, e.friction] for e in read]
    assert out[0] == ["block0", "A", -117.5, 34.25, "15000..30000", None]
    assert [e.rock for e in read] == [s.rock for s in campaign.sites]
    assert out[1][5] == 0.7


@pytest.mark.parametrize(
    ("change", "want"),
    [
        ({"scene": "scenes/block0"}, "campaign.key_not_of_many"), ({"precision": 0.1}, "campaign.key_not_of_many"),
        ({"scenes": ["nothing/*"]}, "rocks.no_scene"), ({"ensemble": None}, "campaign.key_missing"),
    ],
)  # fmt: skip
def test_what_does_not_suit_many_rocks_is_refused(folder, change, want):
    content = {"scenes": ["scenes/*"], "sites": "sites.csv", "ensemble": "quakes", **AXES, **change}
    with refused(want):
        Campaign.of({key: value for key, value in content.items() if value is not None}, folder)


def test_a_rock_that_is_there_under_two_names_is_refused(folder, tmp_path):
    Scene.load(folder / "scenes" / "block0").save(tmp_path / "again")
    content = {"scenes": [str(folder / "scenes" / "*"), "again"], "ensemble": str(folder / "quakes"), **AXES}
    with refused("rock.given_twice"):
        plan_of(Campaign.of(content, tmp_path))


def test_a_scene_that_cannot_be_read_is_left_out_and_reported(folder, tmp_path):
    Scene.block(0.1, 0.2, 0.7).save(tmp_path / "broken")
    (tmp_path / "broken" / "rock.ply").write_bytes(b"ply\n")
    content = {"scenes": [str(folder / "scenes" / "*"), "broken"], "ensemble": str(folder / "quakes"), **AXES}
    planned = plan_of(Campaign.of(content, tmp_path))
    assert [s.rock for s in planned.scenes] == ["block0", "block1", "block2"]
    (left_out,) = planned.left_out
    assert left_out[0] == "broken"
    assert "rock.ply" in left_out[1]


def test_seismograms_of_no_site_are_refused_by_name(folder):
    (folder / "far.csv").write_text("scene,site,seismograms\nscenes/block0,A,own\nscenes/block1,C,own\n")
    content = {"sites": "far.csv", **AXES}
    with refused("rocks.no_record"):
        plan_of(Campaign.of(content, folder))


PLAIN = "scene,site,longitude,latitude\nrock,Zürich,-117.5,34.25\n"
SEMICOLONS = PLAIN.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize(
    "content",
    [
        PLAIN.encode("utf-8-sig"), PLAIN.encode("cp1252"), PLAIN.encode("utf-16"), SEMICOLONS.encode("cp1252"),
        "Latitude;SITE; Longitude ;Scene\n34,25;Zürich;-117,5;rock\n".encode(),
    ],
)  # fmt: skip
def test_a_table_reads_the_same_however_a_spreadsheet_writes_it(content, tmp_path):
    (tmp_path / "rocks.csv").write_bytes(content)
    (site,) = read_sites(tmp_path / "rocks.csv")
    assert (site.rock, site.site, site.longitude, site.latitude) == ("rock", "Zürich", -117.5, 34.25)


def test_rocks_are_named_as_people_name_them(tmp_path):
    (tmp_path / "rocks.csv").write_text("scene,rock,site\na,\"O'Brien's Rock #3 (north)\",St. John's & co\n")
    (site,) = read_sites(tmp_path / "rocks.csv")
    assert (site.rock, site.site) == ("O'Brien's Rock #3 (north)", "St. John's & co")
    for wrong in ("a/b", "..", "<b>", "a?b", "-a", "a."):
        (tmp_path / "rocks.csv").write_text(f"scene,rock\na,{wrong}\n")
        with refused("campaign.value_unusable"):
            read_sites(tmp_path / "rocks.csv")


REFUSED = {
    "table.row_wrong_length": ["scene,longitude,latitude\nrock,-117,5,34,25\n"],
    "campaign.value_unusable": [
        "scene,longitude,latitude\nrock,543.5,34\n", "scene,longitude,latitude\nrock,-117,91\n",
        "scene,longitude,latitude\nrock,11855,34\n", "scene,longitude,latitude\nrock,east,1\n",
        "scene,longitude,latitude\nrock,34.25,-117.5\n", "scene,longitude,latitude\nrock,34.25N,117.5W\n",
        "scene,longitude,latitude\nrock,117.5X,34.25\n", "scene,age\nrock,-5\n", "scene,age\nrock,old\n",
        "scene,age\nrock,/etc/passwd\n", "scene,age,site\na,,A\nb,30..10,B\n", "scene;age;site\na;;A\nb;0;B\n",
        "scene,rock\na,../x\n",
    ],
    "rocks.place_incomplete": ["scene,longitude\nrock,1\n"],
    "campaign.key_unknown": [
        "scene,longitud\nrock,1\n", "scene,colour\nrock,red\n", "scene,age (ka)\nrock,15..30\n"
    ],
    "file.absent": ["scene\tensemble\na\t\nb\tnowhere\n", "scene,seismograms\na,\nb,none.v2\n"],
    "rocks.records_given_twice": ["scene,ensemble,seismograms\na,own,own\n"],
    "rocks.column_repeated": ["scene,Scene\nrock,other\n"],
    "rocks.name_repeated": ["scene\nrock\nrock\n"],
    "rocks.no_scene_column": ["rock\nx\n", "scenes/rock,Echo,-118,34\n", "", "PK\0\0"],
    "rocks.empty": ["scene\n"],
}  # fmt: skip


@pytest.mark.parametrize(("code", "text"), [(code, v) for code, all_of in REFUSED.items() for v in all_of])
def test_what_a_table_cannot_mean_is_refused_by_place(code, text, tmp_path):
    """A wrong cell by its rock and its column."""
    (tmp_path / "own").mkdir()
    (tmp_path / "rocks.csv").write_text(text)
    with refused(code, "rocks.csv"):
        read_sites(tmp_path / "rocks.csv")
    if text.startswith("scene,age,site"):
        with refused(code, "rocks.csv, rock 2: age", "30..10"):
            read_sites(tmp_path / "rocks.csv")
