"""Rocks beside each other: what they share, where they stand, and a page that shows each."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from pyproj import Geod
from reference.idealised import ricker
from small_campaigns import VERSIONS

from toppling.models.files import digest
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.plan import plan_of
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.task import lost_row
from toppling.results.analysis.side_by_side import ARROW_M, compare_rocks, directions_geojson, geojson
from toppling.results.drawing.report.gallery_page import summary
from toppling.results.drawing.side_by_side_figures import scenarios_figure
from toppling.results.drawing.style import digits
from toppling.results.reader import open_run
from toppling.results.store import write_part

MEDIANS = {"firm": 6.0, "weak": 3.0}
SAMPLES = 40
DRAWN = {"azimuth_deg": 90.0, "low_m_s2": 1.0, "median_m_s2": 2.0, "high_m_s2": 4.0}
CODE, EAST_M, NORTH_M = 32611, 480000.0, 3770000.0  # UTM zone 11 north: 9 km west and 34.07 degrees north


def made_up(spec, median, random):
    """A row whose rock topples by a lognormal law in PGA."""
    toppled = bool(np.log(spec.pga_m_s2 / median) / 0.3 > random.normal())
    measures = dict.fromkeys(("pga_m_s2", "pgv_m_s"), spec.pga_m_s2)
    return {
        **lost_row(spec, "ok", ""), **measures, "toppled": toppled, "outcome": "toppled" if toppled else "stands",
        "attempt": 1,
    }  # fmt: skip


@pytest.fixture(scope="module")
def atlas(tmp_path_factory):
    """Two rocks of known medians that share half of their records, and one without an answer."""
    place = tmp_path_factory.mktemp("atlas")
    pulses = [Record.of(f"P{n:02d}", ricker(2.0, 0.5 + 0.05 * n, 0.02)) for n in range(30)]
    Ensemble.write(place / "quakes", pulses[:20])
    Ensemble.write(place / "own", pulses[10:])
    for name, width in (("firm", 0.3), ("silent", 0.26), ("weak", 0.2)):
        Scene.block(width, 0.25, 0.8, friction=0.1 if name == "silent" else 0.8).save(place / "scenes" / name)
    bases = {"level": 0.9, "toppling": [DRAWN]}
    for name, report in (("weak", {"files": [{"epsg": CODE}]}), ("silent", {"unseen_base": bases})):
        document = place / "scenes" / name / "scene.json"
        stated = {**digest.read_json(document), "origin_m": [EAST_M, NORTH_M, 0.0], "report": report}
        digest.write_json(document, stated)
    (place / "sites.csv").write_text(
        "scene,site,longitude,latitude,ensemble,age\nscenes/firm,Echo,-117.5,34.25,,20000\nscenes/weak,Lion,,,own,\n"
        "scenes/silent,,,,,\n"
    )
    axes = {"pga_m_s2": [2, 3, 4.5, 7, 10], "azimuth_deg": [0, 90], "friction": [0.8]}
    planned = plan_of(Campaign.of({"sites": "sites.csv", "ensemble": "quakes", **axes}, place))
    run = place / "run"
    prepare(run, planned, VERSIONS)
    random = np.random.default_rng(46)
    names = {scene.scene_id: scene.rock for scene in planned.scenes}
    specs = [planned.spec(row) for row in range(len(planned))]
    rows = [
        {**made_up(spec, MEDIANS[names[spec.scene_id]], random), "rock": names[spec.scene_id]}
        for spec in specs
        if names[spec.scene_id] in MEDIANS
    ]
    write_part(run, rows)
    return run


@pytest.fixture(scope="module")
def compared(atlas):
    return compare_rocks(open_run(atlas).rocks, "pga_m_s2", SAMPLES)


def placed(atlas, copy, **places):
    shutil.copytree(atlas, copy)
    document = json.loads((copy / "run.json").read_text())
    document.pop("digest")
    for scene in document["scenes"]:
        scene["longitude"], scene["latitude"] = places.get(scene["rock"], (None, None))
    (copy / "run.json").write_text(json.dumps(document))
    return copy


@pytest.mark.thorough
@pytest.mark.parametrize(("weak", "site", "want"), [
    ((178.02, -38.66), None, "scenes/weak lie 1"),
    ((-117.4, 34.3), (-119.0, 34.3), "the hazard's site lie 1"),
    ((-117.4, 34.3), (-117.5, 34.2), None),
    ((-117.4, 34.3), None, None),
])  # fmt: skip
def test_rocks_and_curves_of_a_hazard_lie_within_its_reach(atlas, tmp_path, weak, site, want):
    run = placed(atlas, tmp_path / "run", firm=(-117.5, 34.25), weak=weak)
    curve = "PGA (g),annual_rate\n0.1,1e-2\n0.3,1e-3\n1.0,1e-5\n"
    if site:
        head = (
            "# generated_by='OpenQuake', investigation_time=1.0, imt='PGA'\nlon,lat,poe-0.1,poe-0.3,poe-1.0\n"
        )
        curve = f"{head}{site[0]},{site[1]},1e-2,1e-3,1e-5\n"
    (tmp_path / "hazard.csv").write_text(curve)
    asked = ["constrain", str(run), "--age", "20000", "--measure", "pga_m_s2"]
    answer = CliRunner().invoke(cli, [*asked, "--hazard", str(tmp_path / "hazard.csv")])
    assert (answer.exit_code == 0) == (want is None)
    if want:
        assert want in str(answer.exception)
    bare = CliRunner().invoke(cli, asked).output
    assert ("km apart, and are taken to have felt the same events" in bare) == (weak[0] > 0)


def test_every_rocks_median_is_found_within_its_interval_and_a_rock_without_toppling_has_none(compared):
    rocks = {rock.name: rock for rock in compared[0]}
    for name, median in MEDIANS.items():
        row = rocks[name].row
        assert row["median_low"] < median < row["median_high"]
        assert row["jobs"] == 200
        stated = f"{digits(row['median'])} m/s² (95 %: {digits(row['median_low'])} to "
        assert stated in summary(*compared, "pga_m_s2")[0]
    assert rocks["silent"].curve is None
    assert rocks["silent"].row["remark"]


def test_common_records_are_found_by_content_and_common_levels_by_value(compared):
    shared = compared[1]
    assert shared.records == tuple(f"P{n}" for n in range(10, 20))
    assert (shared.of_records, shared.levels_m_s2) == (30, (2.0, 3.0, 4.5, 7.0, 10.0))


def test_a_fit_to_common_jobs_uses_no_other_jobs(atlas):
    rocks = [rock for rock in open_run(atlas).rocks if rock.rock != "silent"]
    found, shared = compare_rocks(rocks, "pga_m_s2", SAMPLES, only_common=True)
    assert {rock.row["records"] for rock in found} == {len(shared.records)}


def test_a_place_is_that_of_the_table_or_of_the_scans_coordinate_system(compared):
    out = geojson(compared[0])
    points = {f["properties"]["rock"]: f["geometry"]["coordinates"] for f in out["features"]}
    assert points["firm"] == [-117.5, 34.25]
    # 20 km west of the central meridian (117 W) at 34.07 N: 20 km / (111.32 km cos) = .217 degrees; UTM's scale .9996.
    assert points["weak"] == pytest.approx([-117.2169, 34.07], abs=2e-3)
    assert set(points) == {"firm", "weak"}
    assert json.dumps(out, allow_nan=False)


def test_the_map_of_scenarios_holds_every_rock_however_far_from_the_others():
    places = [(-117.5 + 0.01 * number, 34.1) for number in range(6)] + [(-118.9, 34.9)]
    rows = pd.DataFrame(places, columns=["longitude", "latitude"]).assign(outcome="toppled")
    rows["rock"] = rows.index.astype(str)
    matrix = pd.DataFrame({"quake": 1.0}, index=rows["rock"])
    for place in places:
        assert scenarios_figure(rows, matrix).axes[1].viewLim.contains(*place)


def test_directions_of_toppling_are_lines_of_the_lengths_and_bearings_that_they_state(compared):
    toward = np.random.default_rng(5).uniform(0.0, 360.0, 200)
    jobs = pd.DataFrame({"toppled": True, "falls_toward_deg": toward})
    lines = directions_geojson([replace(rock, jobs=jobs) for rock in compared[0]])["features"]
    assert {line["properties"]["rock"] for line in lines} == {"firm", "weak"}
    for name in ("firm", "weak"):
        out = [line["properties"] for line in lines if line["properties"]["rock"] == name]
        assert sum(e["share_of_toppled"] for e in out) == pytest.approx(1.0)
    for line in lines:
        (start, end), out = line["geometry"]["coordinates"], line["properties"]
        forward, _, away_m = Geod(ellps="WGS84").inv(*start, *end)
        assert away_m == pytest.approx(out["length_m"], rel=0.01)  # seven digits are a centimetre
        # The grid of the zone turns by .12 degrees at 20 km from its meridian; short lines are rounded.
        off = (forward - out["falls_toward_bearing_deg"] + 180.0) % 360.0 - 180.0
        assert abs(off) < 0.2 + np.rad2deg(0.02 / away_m)
        assert away_m <= ARROW_M * 1.01


def test_a_rock_falls_opposite_to_the_direction_of_the_ground(compared):
    for row in (rock.row for rock in compared[0] if rock.weakest_azimuth_deg is not None):
        assert (row["falls_toward_deg"] - row["ground_accelerates_toward_deg"]) % 360.0 == 180.0
        for name in ("falls_toward", "ground_accelerates_toward"):
            assert (row[f"{name}_deg"] + row[f"{name}_bearing_deg"]) % 360.0 == 90.0


def test_statics_of_rocks_are_of_their_bases_where_these_are_drawn_and_join_whether_they_slide(atlas):
    asked = "select least_quasi_static_m_s2, quasi_static_toppling[1].slides_m_s2 from scene order by rock"
    least, slides = (column.to_pylist() for column in open_run(atlas).sql(asked).columns)
    assert least == pytest.approx([9.81 * 0.25 / 0.8, 2.0, 9.81 * 0.2 / 0.8])
    assert slides == [None, pytest.approx(0.981), None]
    (drawn,) = (rock.quasi_static() for rock in open_run(atlas).rocks if rock.rock == "silent")
    assert drawn[["low_m_s2", "high_m_s2", "level"]].iloc[0].tolist() == [1.0, 4.0, 0.9]


def test_magnitudes_of_many_rocks_are_refused_with_their_names_and_of_a_single_rock_stated(atlas):
    options = ["--vs30", "760", "--model", "bssa14"]
    refused = CliRunner().invoke(cli, ["magnitudes", str(atlas), *options])
    assert refused.exception.code == "run.several_rocks"
    assert refused.exception.remedy == f"choose one: {atlas / 'scenes' / 'firm'}"
    assert CliRunner().invoke(cli, ["magnitudes", str(atlas / "scenes" / "firm"), *options]).exit_code == 0
