"""A sound file for every reader of the program, and how it is read: what the fuzzer mutates and calls."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import open3d as o3d
import pye57
import pyproj
import trimesh
from cloud_samples import las, ptx
from hazard_samples import NSHMP_RATES, nshmp_curves, openquake_curves, realisations, service_answer
from motion_samples import STEP_S, WRITERS, shaking
from scipy.spatial.transform import Rotation
from small_campaigns import VERSIONS

from toppling.models.files.mesh_files import read_header, read_triangles
from toppling.models.hidden_base.inspection import inspection_of
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.formats.response import responses
from toppling.models.motions.importing import ImportOptions, import_records, record_files
from toppling.models.motions.metadata import read_table
from toppling.models.motions.motion import Motion
from toppling.models.motions.record import Record
from toppling.models.motions.selection import read_deaggregation
from toppling.models.rock import Rock
from toppling.models.scan import meshes
from toppling.models.scan.hints_file import plain, read_hints
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.placement import placement_of
from toppling.models.scan.read import read_clouds
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import plan
from toppling.orchestrator.run_folder import prepare
from toppling.orchestrator.site_table import read_sites
from toppling.orchestrator.status import state_of
from toppling.results.analysis.exchange import read_curves, write_curves
from toppling.results.analysis.lognormal import Basis, Lognormal
from toppling.results.hazard.ages import parse_age
from toppling.results.hazard.places import read_faults
from toppling.results.hazard.readers import Hints, read_hazard
from toppling.results.hazard.readers.event_sets import read_events
from toppling.results.reader import open_run


@dataclass(frozen=True)
class Reader:
    """How to write sound files into a folder, and to read them: `read` returns what must be finite.

    `victims` are the names of the files to damage; all if there are none.
    """

    write: Callable[[Path], Any]
    read: Callable[[Path], Any]
    victims: tuple[str, ...] = ()


POINTS_M = np.random.default_rng(1).uniform(0.0, 5.0, (1100, 3)).round(3)
BOX = trimesh.creation.box((0.4, 0.5, 1.2))


def _write_las_of_feet(path: Path) -> None:
    words = pyproj.CRS.from_user_input("EPSG:2229+6360").to_wkt("WKT1_GDAL")
    version = "1.4" if path.suffix == ".las" else "1.2"
    las(path, POINTS_M, wkt=words, keys=[(1024, 1), (3072, 2229), (4099, 9003)], version=version)


def _write_e57(path: Path) -> None:
    with pye57.E57(str(path), mode="w") as file:
        for points in np.split(POINTS_M, 2):
            columns = {f"cartesian{axis}": values for axis, values in zip("XYZ", points.T, strict=True)}
            file.write_scan_raw(columns, rotation=np.array([0.6, 0.0, 0.0, 0.8]), translation=np.ones(3))


def _write_tensor(path: Path, **options: bool) -> None:
    o3d.t.io.write_point_cloud(path, o3d.t.geometry.PointCloud(POINTS_M), **options)


def _write_text(path: Path, form: str, head: str = "") -> None:
    path.write_text(head + _rows(form))


def _rows(form: str) -> str:
    return "".join(form.format(*point) for point in POINTS_M)


CLOUDS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "cloud.las": ("cloud.las", lambda path: las(path, POINTS_M)),
    "cloud.laz": ("cloud.laz", lambda path: las(path, POINTS_M)),
    "cloud.e57": ("cloud.e57", _write_e57),
    "cloud.ptx": ("cloud.ptx", lambda path: ptx(path, [(POINTS_M, Rotation.identity(), np.zeros(3))])),
    "cloud.ply": ("cloud.ply", lambda path: _write_tensor(path)),
    "cloud ascii.ply": ("cloud.ply", lambda path: _write_tensor(path, write_ascii=True)),
    "cloud.pcd": ("cloud.pcd", lambda path: _write_tensor(path)),
    "cloud ascii.pcd": ("cloud.pcd", lambda path: _write_tensor(path, write_ascii=True)),
    "cloud compressed.pcd": ("cloud.pcd", lambda path: _write_tensor(path, compressed=True)),
    "cloud of feet.las": ("cloud.las", _write_las_of_feet),
    "cloud of feet.laz": ("cloud.laz", _write_las_of_feet),
    "cloud with commas.txt": (
        "cloud.txt",
        lambda path: path.write_bytes(
            ("# Höhe\r\nx;y;z\r\n" + _rows("{};{};{}\r\n").replace(".", ",")).encode("cp1252") + b"\x1a"
        ),
    ),
    "cloud.xyz": ("cloud.xyz", lambda path: _write_text(path, "{} {} {}\n")),
    "cloud.pts": ("cloud.pts", lambda path: _write_text(path, "{} {} {} 7\n", f"{len(POINTS_M)}\n")),
    "cloud.csv": ("cloud.csv", lambda path: _write_text(path, "{},{},{}\n", "x,y,z\n")),
}
MESHES = ("box.stl", "box.obj", "box.off", "box.glb", "box.gltf", "box.ply", "box ascii.ply", "box ascii.stl")


MODELS = ("model.obj", "model.stl", "model.off", "model.glb", "model.ply")
"""Photogrammetry's: read as clouds."""


def _write_mesh(name: str, path: Path) -> None:
    kind = "stl_ascii" if name == "box ascii.stl" else path.suffix[1:]
    options: dict[str, Any] = {"box ascii.ply": {"encoding": "ascii"}}.get(name, {})
    written = BOX.export(file_type=kind, **options | ({"embed_buffers": True} if kind == "gltf" else {}))
    if isinstance(written, dict):
        written = written["model.gltf"]
    path.write_bytes(written.encode() if isinstance(written, str) else written)


def _read_mesh(path: Path) -> Any:
    if path.suffix == ".ply":
        read_header(path)
    return Rock.from_triangles(*read_triangles(path), where=str(path)).inertia_per_mass_m2


def _read_cloud(path: Path) -> Any:
    return read_clouds([path]).points_m


def _read_model(path: Path) -> Any:
    with patch.object(meshes, "FEWEST", 2000):  # what is read is tried, not a million points on it
        return _read_cloud(path)


def _read_records(folder: Path) -> Any:
    """Records as 'records import' makes them; a file that is refused is told, not raised."""
    table = folder / "table.csv"
    outcome = import_records(
        [file for file in record_files([folder]) if file != table],
        read_table(table) if table.exists() else [],
        ImportOptions(doubtful=True),
    )
    if not outcome.records and outcome.refusals:
        raise outcome.refusals[0].reason
    return [[*r.motion.acceleration_m_s2.ravel(), *r.intensity.values()] for r in outcome.records]


def _write_station_xml(folder: Path) -> None:
    for path in WRITERS["miniseed"](folder, shaking(150)):
        if path.suffix != ".xml":
            path.unlink(missing_ok=True)


def _read_station_xml(folder: Path) -> Any:
    for path in folder.glob("*.xml"):
        responses(path)
    return []


def _write_scene(folder: Path) -> None:
    report = {
        "surface": {"seen_share": 0.9, "closed_share": 0.1, "invented_share": 0.0},
        "uncertainty": {"com_std_m": [0.01, 0.01, 0.02], "volume_std_m3": 0.1},
        "interface": {"roughness_m": 0.01, "outline_m": [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]]},
        "registration": {"stations": 1, "residual_m": None},
    }
    block = Scene.block(0.15, 0.2, 0.6)
    Scene(block.rock, block.pedestal, report=report).save(folder / "scene")
    _unseal(folder / "scene" / "scene.json")


def _unseal(document: Path) -> None:
    """Take the digest out, or it would tell every damage before the document is looked at: a stranger's has none."""
    read = json.loads(document.read_text())
    del read["digest"]
    document.write_text(json.dumps(read, indent=1))


def _read_scene(folder: Path) -> Any:
    from toppling.results.drawing.scene_figures import numbers_of

    scene = Scene.load(folder / "scene")
    numbers_of(scene)
    return scene.rock.vertices_m


def _write_ensemble(folder: Path) -> None:
    Ensemble.write(folder / "ensemble", [Record.of("A", Motion(shaking(150), STEP_S))])


def _read_ensemble(folder: Path) -> Any:
    ensemble = Ensemble.load(folder / "ensemble")
    return [ensemble.record(name).motion.acceleration_m_s2 for name in ensemble.record_ids]


CAMPAIGN = """scene = "scene"
ensemble = "ensemble"
pga_m_s2 = { start = 1.0, stop = 5.0, step = 1.0 }
azimuth_deg = { start = 0, stop = 350, step = 10 }
friction = [0.8, [0.9, 0.7]]
restitution = [0.0, 0.1]
realisations = 4
preset = "fast"
records = ["A"]
peak_displacement_m = 0.5
"""


def _write_run(folder: Path) -> None:
    _write_scene(folder)
    _write_ensemble(folder)
    axes = {"pga_m_s2": [1.0], "azimuth_deg": [0], "friction": [0.9]}
    campaign = Campaign.of({"scene": "scene", "ensemble": "ensemble", **axes}, folder)
    prepare(
        folder / "run", plan(campaign, Scene.load(campaign.scene), Ensemble.load(campaign.ensemble)), VERSIONS
    )
    _unseal(folder / "run" / "run.json")
    (folder / "run" / "run.log").write_text('{"event": "rows stored", "workers": 2, "deaths": 0}\n')


def _read_run(folder: Path) -> Any:
    state = state_of(folder / "run")
    run = open_run(folder / "run")
    run.planned(), run.scene(), run.describe()
    return [state["jobs"]]


def _write_curves(suffix: str) -> Callable[[Path], None]:
    curve = Lognormal("pga_m_s2", 2.0, 0.4, Basis("scene", 100, 40, 10, 0, 8.0, 200, 100), (1.8, 2.2))
    return lambda folder: write_curves(folder / f"curves{suffix}", [curve])


def _read_curves(folder: Path) -> Any:
    (path,) = folder.iterdir()
    return [value for curve in read_curves(path).values() for value in (curve.median, curve.beta)]


HAZARD = "pga_m_s2,annual_rate\n0.5,1e-2\n1.0,3e-3\n2.0,5e-4\n4.0,1e-5\n"
CYBERSHAKE = "# Curves: 1\n# Name: CS Run 9306\n1.0E-4\t0.097\n1.0E-2\t0.05\n1.0E-1\t0.004\n1.0\t0.0\n"
SERVICE = json.dumps(service_answer(new=False, label="Annual Frequency of Exceedence"))


def _write_openquake(folder: Path, kind: str = "mean") -> None:
    rows = [("rock", (-118.1, 34.2), (0.39, 0.14, 0.024, 0.00049))]
    openquake_curves(folder / "site.csv", kind, "PGA", (0.05, 0.1, 0.2, 0.4), rows)


def _write_realisations(folder: Path) -> None:
    realisations(folder, [1.0])
    _write_openquake(folder, "rlz-000")


def _read_hazard(path: Path, hints: Hints | None = None) -> Any:
    trees = read_hazard(path, hints=hints or Hints())
    return [
        value
        for tree in trees
        for branch in tree.branches
        for value in (branch.weight, *branch.curve.levels, *branch.curve.annual_rate)
    ]


def _read_campaign(path: Path) -> Any:
    campaign = Campaign.read(path)
    campaign.check_jobs(1)
    return [*campaign.pga_m_s2, *campaign.azimuth_deg, *campaign.restitution]


def _of_file(name: str, text: str, read: Callable[[Path], Any]) -> Reader:
    return Reader(lambda folder: (folder / name).write_text(text), lambda folder: read(folder / name))


DEAGGREGATION = (
    "magnitude_low,magnitude_high,distance_low_km,distance_high_km,contribution\n5,6,0,20,0.3\n6,7,0,20,0.7\n"
)
NSHMP_BINS = (
    "     r,      r\u0305,    m,    m\u0305,    Σε\n 10.00,  12.65, 5.10, 5.10,  7.30\n"
    " 30.00,  31.00, 5.30, 5.31,     T\n"
)
OPENQUAKE_BINS = (
    '#,,,,,"investigation_time=50.0, mag_bin_edges=[5.0, 6.0, 7.0], dist_bin_edges=[0.0, 10.0, 20.0], '
    'weights=[0.4, 0.6]"\nimt,iml,poe,mag,dist,rlz1,rlz0\nPGA,0.2,0.1,5.5,5.0,0.04,0.05\n'
    "PGA,0.2,0.1,6.5,15.0,0.01,0.0\n"
)
FAULTS = json.dumps({
    "type": "FeatureCollection",
    "features": [{
        "type": "Feature", "properties": {"name": "Fault", "magnitude": 7.1},
        "geometry": {"type": "LineString", "coordinates": [[-118.0, 34.25], [-117.5, 34.5]]},
    }],
})  # fmt: skip
TABLE = "rec_id,event,station,mag,dist_km,h1,h2,v,unit,dt,processing,corner_hz\nA,Q,S,6.5,12,a,b,c,gal,0.01,raw,0.1\n"

READERS: dict[str, Reader] = {
    **{
        name: Reader(
            lambda folder, f=file, w=write: w(folder / f), lambda folder, f=file: _read_cloud(folder / f)
        )
        for name, (file, write) in CLOUDS.items()
    },
    **{
        name: Reader(
            lambda folder, n=name: _write_mesh(n, folder / f"box.{n.rpartition('.')[2]}"),
            lambda folder, n=name: _read_mesh(folder / f"box.{n.rpartition('.')[2]}"),
        )
        for name in MESHES
    },
    **{
        name: Reader(
            lambda folder, n=name: _write_mesh(n, folder / n), lambda folder, n=name: _read_model(folder / n)
        )
        for name in MODELS
    },
    **{
        f"record {name}": Reader(lambda folder, w=write: w(folder, shaking(150)), _read_records)
        for name, write in WRITERS.items()
    },
    "StationXML": Reader(_write_station_xml, _read_station_xml),
    "metadata table": _of_file("table.csv", TABLE, lambda path: [e.time_step_s for e in read_table(path)]),
    **{
        f"deaggregation{of}": _of_file(
            "bins.csv", text, lambda path: read_deaggregation(path).bins["contribution"].tolist()
        )
        for of, text in (
            ("", DEAGGREGATION),
            (" of nshmp-haz", NSHMP_BINS),
            (" of OpenQuake", OPENQUAKE_BINS),
        )
    },
    "outline": _of_file(
        "outline.csv",
        "x,y,z\n0,0,0\n1,0,0\n1,1,0.1\n0,1,0\n",
        lambda path: InterfaceHint.outline(path).anchors_m,
    ),
    "places of contact": _of_file(
        "contact.csv",
        "x,y,z,kind\n0,0,0,touch\n1,0,0,daylight\n",
        lambda path: inspection_of(path).touching_m,
    ),
    "control points": _of_file(
        "points.csv",
        "".join(f"{x},{y},{x * y},{x + 9},{y},{x * y}\n" for x in (0, 1) for y in (0, 2)),
        lambda path: placement_of(gcp=path).shift_m,
    ),
    "hints": _of_file(
        "hints.toml",
        'near = [1.5, 2.0]\npoint = ["1.0,2.0,3.5"]\nunits = "m"\n',
        lambda path: plain("near", read_hints(path).get("near", ())),
    ),
    "fault traces": _of_file(
        "faults.geojson",
        FAULTS,
        lambda path: [fault.distance_km for fault in read_faults(path, (-118.0, 34.0))],
    ),
    "events": _of_file(
        "events.csv",
        "annual_rate,PGA (g),PGV (cm/s)\n0.01,0.1,5.0\n0.001,0.4,30.0\n",
        lambda path: [len(branch.rate) for branch in read_events(path).branches],
    ),
    "table of rocks": _of_file(
        "rocks.csv",
        "scene,longitude,latitude,age,friction\na,-118.0,34.0,15 ka,0.7\n",
        lambda path: [s.friction for s in read_sites(path)],
    ),
    "scene": Reader(_write_scene, _read_scene),
    "scene.json": Reader(_write_scene, _read_scene, ("scene.json",)),
    "ensemble": Reader(_write_ensemble, _read_ensemble),
    "campaign": _of_file("campaign.toml", CAMPAIGN, _read_campaign),
    "run": Reader(_write_run, _read_run, ("run.json", "run.log")),
    **{
        f"curves{suffix}": Reader(_write_curves(suffix), _read_curves) for suffix in (".xml", ".csv", ".json")
    },
    "hazard": _of_file("site.csv", HAZARD, _read_hazard),
    "hazard of OpenQuake": Reader(_write_openquake, lambda folder: _read_hazard(folder / "site.csv")),
    "hazard of nshmp-haz": Reader(
        lambda folder: nshmp_curves(folder / "total.csv", NSHMP_RATES["curves"]),
        lambda folder: _read_hazard(folder / "total.csv", Hints(measure="pga_m_s2", years=0.0)),
    ),
    "hazard of CyberShake": _of_file(
        "USC_ERF36_Run9306_SA_3sec_RotD50_2022_12_21.txt", CYBERSHAKE, _read_hazard
    ),
    "hazard of the web service": _of_file("answer.json", SERVICE, _read_hazard),
    "hazard's realisations": Reader(_write_realisations, _read_hazard),
    "ages": _of_file("ages.csv", "years,weight\n15000,1\n20000,2\n", lambda path: parse_age(str(path))),
}
