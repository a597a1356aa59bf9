"""What a scan costs and how right it is: time and memory by number of points, errors and toppling answers by shape.

Puts its tables into benchmarks/reports/scan.md.

    .venv/bin/python benchmarks/scan.py accuracy [--shape NAME ...] [--scans FOLDER]
    .venv/bin/python benchmarks/scan.py blind [--first 101] [--count 16]
    .venv/bin/python benchmarks/scan.py family [--first 0] [--count 40]
    .venv/bin/python benchmarks/scan.py base [--first 201] [--count 60] [--fragility ENSEMBLE] [--rocks 12] [--jobs 200]
        [--hints]
    .venv/bin/python benchmarks/scan.py answers ENSEMBLE [--shape NAME ...] [--scans FOLDER] [--jobs 500]
    .venv/bin/python benchmarks/scan.py cost [--million 1 5 10 20]

FOLDER holds scans of known rocks from elsewhere: NAME.truth.json, NAME.truth_rock.ply, and NAME.laz or .ply.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import laspy
import numpy as np
from blind_rocks import base_rock, blind_rock, true_hints
from comparison import Job, Setting, answers, draw_jobs
from numpy.typing import NDArray
from pages import put, table
from scipy.stats import t as student_t
from squat_rocks import member, outside_the_contact

from toppling.models.errors import InputError
from toppling.models.files.mesh_files import read_triangles
from toppling.models.frames import plane_normal, rotation_between
from toppling.models.motions.ensemble import Ensemble
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan import virtual
from toppling.models.scan.read import Cloud, read_clouds
from toppling.models.scan.survey import Survey, survey
from toppling.models.scene import Scene
from toppling.models.statics import quasi_static_toppling_m_s2
from toppling.orchestrator.rocks_of_run import Settled
from toppling.workers.options import PRESETS

PAGE = Path(__file__).parent / "reports" / "scan.md"
AZIMUTHS_DEG = np.arange(0.0, 360.0, 10.0)
FAST = Setting(PRESETS["fast"])
LIMIT_S, LIMIT_GB = 70.0, 2.5
"""What a scan of twenty million points may cost: processor time and memory."""


def block() -> virtual.Truth:
    """Upright block of rough sides on a slope."""
    rock = virtual.boulder(2.0, 1.1, 0.9, 11, bumps=0.015, squareness=0.8)
    return virtual.on_slope(rock, virtual.ground(5.0, 0.7, 11, bumps_m=0.08), 4.0, 300.0)


def stump() -> virtual.Truth:
    """Boulder on a broad base."""
    rock = virtual.boulder(2.0, 1.3, 1.0, 3, bumps=0.02)
    return virtual.on_slope(rock, virtual.ground(5.0, 0.7, 3, bumps_m=0.1), 6.0, 250.0)


def leaning() -> virtual.Truth:
    """Boulder with a nose, whose narrow base lies in the shadow of its belly."""
    rock = virtual.boulder(3.0, 1.9, 1.0, 7, bumps=0.03, nose=0.25, nose_azimuth_deg=70.0)
    return virtual.on_slope(rock, virtual.ground(8.0, 0.8, 7, bumps_m=0.15), 8.0, 70.0)


def hour_glass() -> virtual.Truth:
    """Boulder on a neck of its own width."""
    rock = virtual.boulder(2.0, 1.5, 0.8, 5, bumps=0.02)
    return virtual.on_slope(rock, virtual.ground(5.0, 0.42, 5, neck_drop_m=0.8, bumps_m=0.05), 3.0, 10.0)


def rock_in_a_crevice(seed: int) -> virtual.Truth:
    """Boulder between two walls that reach to half its height."""
    rock = virtual.boulder(3.0, 2.0, 1.5, seed, bumps=0.03)
    pedestal = virtual.ground(9.0, 1.0, seed, bumps_m=0.15)
    wall, faces = virtual.lathe(np.full((12, 4), 0.9), np.linspace(-0.2, 1.4, 12), np.zeros((12, 2)), 4)
    walls = [
        virtual.Body(wall * [1.0, 3.0, 1.0] + [x, 0.0, 0.0], faces, virtual.PEDESTAL) for x in (-2.1, 2.1)
    ]
    return virtual.on_slope(rock, pedestal, 4.0, 120.0, *walls)


SHAPES: dict[str, Callable[[], virtual.Truth]] = {
    "Echo Cliffs": lambda: virtual.echo_cliffs_like(0),
    "stump": stump,
    "block": block,
    "leaning boulder": leaning,
    "hour-glass": hour_glass,
    "in a crevice": lambda: rock_in_a_crevice(4),
    "one of two": lambda: virtual.two_rocks_side_by_side(2),
}
CAUSES_OF = ("Echo Cliffs", "echo_like")
"""Shapes of which the benchmark of answers tells what each error costs."""
TOPS_M_S2 = 0.5 * 2.0 ** (0.5 * np.arange(17))
"""Highest levels tried, until half of the jobs topple."""
BASES_SHAKEN = 16
"""Draws of the base that predict a fragility."""
TRIED = 60
"""Jobs that find the levels."""
FIRST_COLUMN = {
    "accuracy": "shape", "blind": "rock", "family": "rock", "answers": "shape", "cost": "asked for",
}  # fmt: skip
"""Columns of the table of every command."""


def errors(found: Scene, true: Scene) -> dict[str, float]:
    """Errors of a scene in the units of the targets; of the toppling acceleration the least one too."""
    rock, known = found.rock, true.rock
    turn = (found.pedestal.downhill_azimuth_deg - true.pedestal.downhill_azimuth_deg + 180.0) % 360.0 - 180.0
    seen, right = _toppling(found), _toppling(true)
    flat = _toppling(on_plane(true))
    principal = np.linalg.eigvalsh(rock.inertia_per_mass_m2) / np.linalg.eigvalsh(known.inertia_per_mass_m2)
    moved = rock.com_m + found.origin_m - known.com_m - true.origin_m
    return {
        "volume %": 100 * (rock.volume_m3 / known.volume_m3 - 1),
        "centre of mass, % of height": 100 * float(np.linalg.norm(moved)) / known.height_m,
        "inertia %": 100 * float(np.abs(principal - 1).max()),
        "slope °": found.pedestal.slope_deg - true.pedestal.slope_deg,
        "its azimuth °": turn,
        "toppling, rms %": 100 * float(np.sqrt(np.mean((seen / right - 1) ** 2))),
        "worst %": 100 * float(np.abs(seen / right - 1).max()),
        "worst of the plane's %": 100 * float(np.abs(seen / flat - 1).max()),
        "plane against meshes, worst %": 100 * float(np.abs(flat / right - 1).max()),
        "least true m/s²": float(right.min()),
    }


def _toppling(scene: Scene, azimuths_deg: NDArray[np.float64] = AZIMUTHS_DEG) -> NDArray[np.float64]:
    table = quasi_static_toppling_m_s2(scene.rock, scene.pedestal, 9.81, azimuths_deg)
    return np.array(table)[:, 1]


@dataclass(frozen=True, eq=False)
class Known:
    """A scan of a known rock: its cloud, each point's true label, and the true meshes as a scene."""

    cloud: Cloud
    label: NDArray[np.int8]
    true: Scene
    near_m: tuple[float, float] | None = None

    @classmethod
    def of(cls, truth: virtual.Truth, stations: list[virtual.Station], *, pointed_at: bool = True) -> "Known":
        """A virtual rock as surveyed, with a word on where its top is unless it is to be found without."""
        cloud, label = virtual.cloud_of(stations, virtual.DEMO_ORIGIN_M)
        true = Scene(truth.rock, truth.pedestal, origin_m=virtual.DEMO_ORIGIN_M)
        top = true.rock.vertices_m[np.argmax(true.rock.vertices_m[:, 2]), :2] + virtual.DEMO_ORIGIN_M[:2]
        return cls(cloud, label, true, (float(top[0]), float(top[1])) if pointed_at else None)


def own(name: str) -> Known:
    """A virtual shape, scanned from six stations at 0.6 % of its height."""
    truth = SHAPES[name]()
    return Known.of(truth, virtual.scan_around(truth, seed=1))


def blind(seed: int) -> tuple[str, Known]:
    """A random rock that nothing was tuned on, its name saying pedestal and survey."""
    truth, kind, stations = blind_rock(seed)
    name = f"{seed}: {truth.rock.height_m:.1f} m, {kind}, {len(stations)} stations"
    return name, Known.of(truth, stations, pointed_at=False)


def on_a_known_base(seed: int) -> tuple[str, Known]:
    """A random rock on a base of one of five kinds, half of some rims hidden; its name says which."""
    rock = base_rock(seed)
    name = f"{seed}: {rock.kind}" + (", half of the rim hidden" if rock.half_hidden else "")
    return name, Known.of(rock.truth, rock.stations)


def base_coverage(found: Scene, true: Scene) -> dict[str, float]:
    """How often the stated intervals hold what is true, how wide they are, and how far their middle is off.

    `smooth closing` is the toppling acceleration of the rock closed without regard to its standing, as before there
    were draws.
    """
    stated = found.report["unseen_base"]
    if "toppling" not in stated:
        return {"contradicted": 1.0}
    azimuths = np.array([entry["azimuth_deg"] for entry in stated["toppling"]])
    low, median, high = (
        np.array([entry[key] for entry in stated["toppling"]])
        for key in ("low_m_s2", "median_m_s2", "high_m_s2")
    )
    right = _toppling(true, azimuths)
    nominal = _toppling(found, azimuths)
    return {
        "held by 90 % interval, %": 100 * float(((low <= right) & (right <= high)).mean()),
        "width, % of median": 100 * float(np.median((high - low) / median)),
        "median off by, %": 100 * float(np.median(np.abs(median / right - 1))),
        "nominal off by, %": 100 * float(np.median(np.abs(nominal / right - 1))),
        "settles, °": Settled.of(found).settling.tilt_deg,
    }


def base_fragility(found: Scene, true: Scene, ensemble: Ensemble, count: int) -> dict[str, float]:
    """Share of a campaign that topples the true rock, and the interval that the draws of the base predict."""
    if found.unseen is None:
        return {}
    jobs, _ = jobs_that_half_topple(true, ensemble, count)
    right = float(answers(true, ensemble, jobs, FAST).toppled.mean())
    fractions = [
        float(answers(found.on_base(number), ensemble, jobs, FAST).toppled.mean())
        for number in range(0, len(found.unseen), max(1, len(found.unseen) // BASES_SHAKEN))
    ]
    # Quantiles of so few hold less of the next one than they say: the interval in which it lies if they are normal.
    spread = np.std(fractions, ddof=1) * np.sqrt(1.0 + 1.0 / len(fractions))
    low, high = np.mean(fractions) + spread * student_t(len(fractions) - 1).ppf([0.05, 0.95])
    return {
        "true share toppled, %": 100 * right,
        "predicted low, %": 100 * float(low),
        "predicted high, %": 100 * float(high),
        "held": float(low <= right <= high),
    }


def from_elsewhere(folder: Path, name: str) -> Known:
    """A scan made by another scanner, with its truth beside it."""
    truth = json.loads((folder / f"{name}.truth.json").read_text())
    rock = Rock.from_triangles(*read_triangles(folder / f"{name}.truth_rock.ply"))
    normal = plane_normal(truth["interface_slope_deg"], truth["interface_downhill_azimuth_deg"])
    foot = rock.vertices_m[np.argmin(rock.vertices_m @ normal)]
    pedestal = Pedestal(foot, normal, *read_triangles(folder / f"{name}.truth_pedestal.ply"))
    file = next(path for path in (folder / f"{name}.laz", folder / f"{name}.ply") if path.exists())
    with np.load(folder / f"{name}.truth_labels.npz") as labels:
        label = labels[labels.files[0]]
    return Known(read_clouds([file]), label, Scene(rock, pedestal, origin_m=np.array(truth["offset"])))


def all_known(names: list[str], folder: Path | None) -> Iterator[tuple[str, Known]]:
    """The named shapes, then the scans in the folder."""
    for name in names:
        yield name, own(name)
    for truth_file in sorted(folder.glob("*.truth.json")) if folder else ():
        name = truth_file.name.removesuffix(".truth.json")
        yield name, from_elsewhere(truth_file.parent, name)


def family_row(seed: int) -> tuple[str, dict[str, float]]:
    """A rock of the family from slender to squat: whether it was found, and its errors."""
    drawn = member(seed)
    cloud, label = virtual.cloud_of(drawn.stations, virtual.DEMO_ORIGIN_M)
    begin = time.process_time()
    name = f"{seed}: {drawn.name}"
    try:
        found = survey(cloud)
    except InputError as error:
        print(name, error, flush=True)
        return name, {"found": 0.0}
    adjacent = outside_the_contact(drawn, cloud.points_m, label)
    right = found.label == label
    rock, known = found.scene.rock, drawn.truth.rock
    moved = rock.com_m + found.scene.origin_m - known.com_m - virtual.DEMO_ORIGIN_M
    return name, {
        "found": 1.0,
        "beside the contact right %": 100 * float(right[adjacent].mean()),
        "rock's %": 100 * float(right[adjacent & (label == 0)].mean()),
        "pedestal's %": 100 * float(right[adjacent & (label == 1)].mean()),
        "volume %": 100 * (rock.volume_m3 / known.volume_m3 - 1),
        "centre of mass, % of height": 100 * float(np.linalg.norm(moved)) / known.height_m,
        "slope °": found.scene.pedestal.slope_deg - drawn.truth.pedestal.slope_deg,
        "processor s": time.process_time() - begin,
    }


def on_plane(scene: Scene) -> Scene:
    """A rock on its bare interface plane."""
    return replace(scene, pedestal=Pedestal(scene.pedestal.point_m, scene.pedestal.normal))


def accuracy(known: Known) -> dict[str, float]:
    """Errors of what `toppling scan` makes of a scan, in the units of the targets."""
    found = survey(known.cloud, near_m=known.near_m)
    right = {
        "rock's points right %": 100 * float((found.label[known.label == 0] == 0).mean()),
        "pedestal's %": 100 * float((found.label[known.label == 1] == 1).mean()),
    }
    return right | errors(found.scene, known.true)


def jobs_that_half_topple(scene: Scene, ensemble: Ensemble, count: int) -> tuple[list[Job], float]:
    """Jobs of random record, azimuth and level, and the highest level: such that about half topple the rock."""
    for top in TOPS_M_S2:
        levels = (min(1.0, 0.2 * float(top)), float(top))
        if answers(scene, ensemble, draw_jobs(ensemble, TRIED, levels), FAST).toppled.mean() > 0.4:
            break
    return draw_jobs(ensemble, count, levels, seed=11), float(top)


def agreement(name: str, known: Known, ensemble: Ensemble, count: int) -> dict[str, float]:
    """Share of jobs in which the scan's scene says what the true meshes say, and beside it what else changes answers.

    Answers near the threshold flip with anything: `chaos` is the true scene from a start that is disturbed by a
    millionth of the height.
    """
    true = known.true
    found = survey(known.cloud, near_m=known.near_m).scene
    jobs, top = jobs_that_half_topple(true, ensemble, count)
    true_toppled = answers(true, ensemble, jobs, FAST).toppled
    compared = {"scan": found, "true rock, bare plane": on_plane(true)}
    if name in CAUSES_OF:
        compared |= parts_of_the_error(found, true)
    row = {"levels up to, m/s²": top, "topple %": 100 * float(true_toppled.mean())}
    disturbed = answers(true, ensemble, jobs, replace(FAST, disturbed_toward_deg=0.0)).toppled
    row["chaos, % equal"] = 100 * float((disturbed == true_toppled).mean())
    for what, scene in compared.items():
        row[f"{what}, % equal"] = 100 * float(
            (answers(scene, ensemble, jobs, FAST).toppled == true_toppled).mean()
        )
    return row


def parts_of_the_error(found: Scene, true: Scene) -> dict[str, Scene]:
    """Scenes that are the true one but for one thing that the scan got wrong."""
    shift = found.origin_m - true.origin_m
    turn = rotation_between(true.pedestal.normal, found.pedestal.normal)
    surface = true.pedestal.vertices_m
    sloped = replace(
        true,
        rock=true.rock.moved(turn),
        pedestal=replace(
            true.pedestal,
            point_m=true.pedestal.point_m @ turn.T,
            normal=found.pedestal.normal,
            vertices_m=None if surface is None else surface @ turn.T,
        ),
    )
    return {
        "the scan's mass": replace(true, rock=with_mass(true.rock, found.rock, shift)),
        "the scan's slope": sloped,
        "the scan's feet": replace(found, rock=with_mass(found.rock, true.rock, -shift)),
        "the scan's rock, bare plane": on_plane(found),
    }


def with_mass(rock: Rock, other: Rock, shift_m: NDArray[np.float64]) -> Rock:
    """A rock's surface with the centre of mass and the inertia of another, whose frame lies shifted by so much."""
    return replace(rock, com_m=other.com_m + shift_m, inertia_per_mass_m2=other.inertia_per_mass_m2)


def write_cloud(path: Path, million: float) -> int:
    """Scan the rock like Echo Cliffs as finely as gives so many points, into a LAZ file; how many they are."""
    truth = virtual.echo_cliffs_like(0)
    coarse = 0.006
    few = sum(
        len(entry.points_m) for entry in virtual.scan_around(truth, seed=1, resolution_per_height=coarse)
    )
    stations = virtual.scan_around(
        truth, seed=1, resolution_per_height=coarse * float(np.sqrt(few / (1e6 * million)))
    )
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.offsets, header.scales = virtual.DEMO_ORIGIN_M, np.full(3, 1e-4)
    with laspy.open(path, mode="w", header=header) as file:
        for number, station in enumerate(stations):
            record = laspy.ScaleAwarePointRecord.zeros(len(station.points_m), header=header)
            record.x, record.y, record.z = (station.points_m + virtual.DEMO_ORIGIN_M).T
            record.point_source_id[:] = number
            file.write_points(record)
    return sum(len(entry.points_m) for entry in stations)


def cost(million: float) -> dict[str, float]:
    """Wall time and peak memory of one `toppling scan`, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        cloud = Path(folder) / "cloud.laz"
        # A process of its own, so that the scanner's memory is gone when the scan is measured.
        make = [sys.executable, __file__, "make", str(cloud), str(million)]
        made = subprocess.run(make, check=True, capture_output=True, text=True)
        scan = [str(Path(sys.executable).parent / "toppling"), "scan", str(cloud), "--out", f"{folder}/scene"]
        begin = time.perf_counter()
        with subprocess.Popen(scan, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - begin
        if process.returncode:
            raise RuntimeError(f"scan of {million} million points ended with {process.returncode}")
    return {
        "points, million": int(made.stdout) / 1e6,
        "wall s": wall,
        "processor s": used.ru_utime + used.ru_stime,
        "peak memory GB": used.ru_maxrss * 1024 / 1e9,
    }


def bases(given: argparse.Namespace) -> None:
    """Coverage on known bases by rock, by kind, with true hints, and of a fragility."""
    ensemble = None if given.fragility is None else Ensemble.load(given.fragility)
    rows: dict[str, dict[str, float]] = {}
    fragile: dict[str, dict[str, float]] = {}
    hinted: dict[str, list[dict[str, float]]] = {}
    for number in range(given.count):
        name, known = on_a_known_base(given.first + number)
        try:
            result = survey(known.cloud, near_m=known.near_m)
        except InputError as error:
            print(name, "refused:", error.what, flush=True)
            rows[name] = {"refused": 1.0}
            continue
        rows[name] = base_coverage(result.scene, known.true)
        print(name, {key: round(value, 3) for key, value in rows[name].items()}, flush=True)
        for hint, row in with_hints(result, known.true).items() if given.hints else ():
            hinted.setdefault(hint, []).append(row)
            print(name, hint, {key: round(value, 3) for key, value in row.items()}, flush=True)
        if ensemble is not None and number < given.rocks:
            fragile[name] = base_fragility(result.scene, known.true, ensemble, given.jobs)
            print(fragile[name], flush=True)
    kinds: dict[str, list[dict[str, float]]] = {}
    for name, row in rows.items():
        kinds.setdefault(name.split(": ")[1].split(",")[0], []).append(row)
    put(PAGE, "base", table(rows | {"mean": mean_of(list(rows.values()))}, "rock"))
    put(PAGE, "kinds", table({kind: mean_of(of_kind) for kind, of_kind in kinds.items()}, "kind"))
    if hinted:
        put(PAGE, "hints", table({hint: mean_of(with_it) for hint, with_it in hinted.items()}, "hint"))
    if fragile:
        put(PAGE, "fragility", table(fragile, "rock"))


def with_hints(result: Survey, true: Scene) -> dict[str, dict[str, float]]:
    """Coverage without hints and with each set of true ones; nothing of one that is refused."""
    assert result.cached is not None
    rows = {"none": base_coverage(result.scene, true)}
    for hint, inspection in true_hints(true).items():
        try:
            rows[hint] = base_coverage(result.cached.with_hints(inspection).scene()[0], true)
        except InputError as error:
            rows[hint] = {"refused": 1.0}
            print(hint, "refused:", error.what, flush=True)
    return rows


def mean_of(rows: list[dict[str, float]]) -> dict[str, float]:
    """Number of rows and mean of each column over those that have it; of widths the median."""
    columns = list(dict.fromkeys(column for row in rows for column in row))
    by_column = {column: [row[column] for row in rows if column in row] for column in columns}
    middle = {column: np.median if column.startswith("width") else np.mean for column in columns}
    return {
        "rocks": float(len(rows)),
        **{column: float(middle[column](by_column[column])) for column in columns},
    }


def costs(millions: list[float]) -> Iterator[tuple[str, dict[str, float]]]:
    """Cost by the number of points, up to the first that is beyond what a scan may cost."""
    for million in millions:
        row = cost(million)
        yield f"{million:g} million", row
        if row["processor s"] > LIMIT_S or row["peak memory GB"] > LIMIT_GB:
            print(f"beyond {LIMIT_S} s or {LIMIT_GB} GB: larger clouds are left out", flush=True)
            return


def measured(given: argparse.Namespace) -> Iterator[tuple[str, dict[str, float]]]:
    """Rows of a command's table, each with its name."""
    if given.command == "cost":
        yield from costs(given.million)
    elif given.command in ("blind", "family"):
        for seed in range(given.first, given.first + given.count):
            if given.command == "family":
                yield family_row(seed)
            else:
                name, known = blind(seed)
                yield name, accuracy(known)
    else:
        for name, known in all_known(given.shape, given.scans):
            if given.command == "accuracy":
                yield name, accuracy(known)
            else:
                yield name, agreement(name, known, Ensemble.load(given.ensemble), given.jobs)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    called = {name: commands.add_parser(name) for name in (*FIRST_COLUMN, "base", "make")}
    for name, first, count in (("blind", 101, 16), ("family", 0, 40), ("base", 201, 60)):
        called[name].add_argument("--first", type=int, default=first)
        called[name].add_argument("--count", type=int, default=count)
    called["answers"].add_argument("ensemble", type=Path)
    called["answers"].add_argument("--jobs", type=int, default=500)
    called["base"].add_argument("--fragility", type=Path, metavar="ENSEMBLE")
    called["base"].add_argument("--rocks", type=int, default=12)
    called["base"].add_argument("--jobs", type=int, default=200)
    called["base"].add_argument("--hints", action="store_true", help="with each set of true hints too")
    for name in ("accuracy", "answers"):
        called[name].add_argument("--shape", nargs="*", choices=SHAPES, default=list(SHAPES))
        called[name].add_argument("--scans", type=Path)
    called["cost"].add_argument("--million", nargs="+", type=float, default=[1.0, 5.0, 10.0, 20.0])
    called["make"].add_argument("path", type=Path)
    called["make"].add_argument("million", type=float)
    given = parser.parse_args()
    if given.command == "make":
        print(write_cloud(given.path, given.million))
    elif given.command == "base":
        bases(given)
    else:
        rows: dict[str, dict[str, float]] = {}
        for name, row in measured(given):
            rows[name] = row
            print(name, {key: round(value, 3) for key, value in row.items()}, flush=True)
            put(PAGE, given.command, table(rows, FIRST_COLUMN[given.command]))


if __name__ == "__main__":
    main()
