"""Every command and every block of code in README and guide does what it shows, on one small example.

A comment above a block says where it is only looked at: `parsed` for what needs a network, another machine or a person
(its options are read as the command line reads them), `slow` for what takes minutes.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import click
import laspy
import numpy as np
import pytest
import trimesh
import yaml
from click.testing import CliRunner
from hazard_samples import event_set, openquake_curves, realisations

from toppling.models.files.mesh_files import write_ply
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.hidden_base.rough_base import with_rough_base
from toppling.models.motions.synthetic import synthetic_ensemble
from toppling.models.scan.virtual import demo_scan
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.cli import cli
from toppling.orchestrator.verbs.shared_options import QUEUES
from toppling.results.reader import open_run

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs" / "guide").glob("*.md"))]
SMALLER = {
    "--count 140": "--count 3",
    "fragility runs/first --fit": "fragility runs/first --fit --samples 20",
    "report runs/first": "report runs/first --samples 10",
    "init scenes/rock ensembles/quakes": "init scenes/rock ensembles/quakes --levels 3 --azimuths 2 --preset fast",
}
"""What a test writes in place of what a page says, to be done in seconds."""

AT2_NAMES = {"e": "090", "n": "000", "up": "UP"}
"""How the files of a record's components say where they point."""

RUN_TOPPLING = "from toppling.orchestrator.cli import main\nif __name__ == '__main__': main()"

SITE = {"DASK_JOBQUEUE__SLURM__CORES": "8", "DASK_JOBQUEUE__SLURM__MEMORY": "16GB"}
"""What the page on clusters has a site put into jobqueue.yaml."""

SHELL = {"git", "mkdir", "docker", "export", "dask", "srun", "until"}
"""Other programs that the pages name."""

BLOCK = re.compile(
    r"(?:<!-- (?P<how>parsed|slow)[^>]*-->\n)?```(?P<kind>\w*)\n(?P<text>.*?)^```$", re.M | re.S
)


@dataclass(frozen=True)
class Block:
    kind: str
    text: str
    how: str


def blocks(page):
    return [
        Block(found["kind"], found["text"], found["how"] or "") for found in BLOCK.finditer(page.read_text())
    ]


def commands(text):
    """Words of each command, comments left out; a quoted text may go over several lines."""
    begun = ""
    for line in text.replace("\\\n", " ").splitlines(keepends=True):
        begun += line
        try:
            words = shlex.split(begun, comments=True)
        except ValueError:  # no closing quotation yet
            continue
        begun = ""
        if words:
            yield words
    assert not begun, "a quotation is not closed"


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """What the pages take as given: a rock, six records with their table, seismograms and hazard curves."""
    folder = tmp_path_factory.mktemp("guide")
    block = Scene.block(0.2, 0.25, 0.6)
    fine = Scene.from_mesh(
        trimesh.remesh.subdivide_to_size(block.rock.vertices_m, block.rock.faces, max_edge=0.1)
    )
    rough = with_rough_base(fine, std_m=(0.001, 0.002), wavelength_m=0.1, band_m=0.05, draws=4)
    rough.save(folder / "scenes" / "rock")
    Scene.block(0.3, 0.25, 0.8).save(folder / "scenes" / "second")
    write_ply(folder / "rock.ply", block.rock.vertices_m, block.rock.faces)
    (folder / "records").mkdir()
    (folder / "simulated").mkdir()
    table = ["h1,h2,v,event,station,mag,dist_km"]
    for record in synthetic_ensemble(6, 3):
        name = f"{record.record_id}.csv"
        time_s = np.arange(len(record.motion.acceleration_m_s2)) * record.motion.time_step_s
        columns = np.column_stack([time_s, record.motion.acceleration_m_s2])
        header = "time (s),EW (m/s2),NS (m/s2),UD (m/s2)"
        np.savetxt(folder / "records" / name, columns, delimiter=",", header=header, comments="", fmt="%.7g")
        table.append(
            f"{name},{name},{name},{record.event},{record.station},{record.magnitude},{record.distance_km}"
        )
    (folder / "records" / "catalog.csv").write_text("\n".join(table) + "\n")
    for component, name_of in enumerate(("e", "n", "up")):
        series = record.motion.acceleration_m_s2[:, component] / STANDARD_GRAVITY_M_S2
        title = f"PEER NGA STRONG MOTION DATABASE RECORD\nQuake, 1/2/2003, Station, {AT2_NAMES[name_of]}\n"
        title += "ACCELERATION TIME SERIES IN UNITS OF G\n"
        count = f"NPTS= {len(series):6d}, DT= {record.motion.time_step_s:8.4f} SEC,\n"
        lines = "".join(f"{value:15.7E}\n" for value in series)
        (folder / f"quake_{name_of}.AT2").write_text(title + count + lines)
    shutil.copy(folder / "records" / name, folder / "simulated" / "motion.csv")
    result = "simulated/motion.csv"
    (folder / "table.csv").write_text(f"h1,h2,v,event,station\n{result},{result},{result},scenario,Echo\n")
    for curve, factor in (("mean.csv", 1.0), ("high.csv", 3.0)):
        rows = "".join(
            f"{pgv},{factor * 1e-4 * pgv**-2:.3g}\n" for pgv in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0)
        )
        (folder / curve).write_text(f"pgv_m_s,annual_rate\n{rows}")
    write_outputs(folder)
    trace = {"type": "LineString", "coordinates": [[-118.6, 34.8], [-117.6, 34.6]]}
    (folder / "faults.geojson").write_text(
        json.dumps({"type": "Feature", "properties": {"name": "F"}, "geometry": trace})
    )
    (folder / "second.csv").write_text("rock,measure,median,beta\nsecond,pgv_m_s,1.0,0.3\n")
    return folder


def write_outputs(folder):
    """OpenQuake's event set of two branches of 100 years, its tree, and an output of nshmp-haz, of two sites each."""
    sites = {"aa": (-118.1, 34.2), "bb": (-118.0, 34.3)}
    fields = [f"{event},{5 + event},{site}" for event in range(8) for site in sites]
    event_set(
        folder / "openquake_events", ["event_id,gmv_PGV,custom_site_id", *fields],
        [f"{n},{n},{n % 2},{n + 1},1" for n in range(8)], {"A~A": 0.6, "A~B": 0.4}, sites,
        investigation_time=50.0, ses_per_logic_tree_path=2,
    )  # fmt: skip
    levels_cm_s = np.array([5, 10, 20, 50, 100, 200, 400, 800])
    tree, output = folder / "openquake_output", folder / "hazout"
    (output / "PGV").mkdir(parents=True)
    tree.mkdir()
    for number, factor in enumerate((1.0, 3.0)):
        kind, poes = f"rlz-{number:03}", -np.expm1(-50 * factor * 1e-4 * (levels_cm_s / 100) ** -2.0)
        rows = [(name, (east, 34.2), poes) for name, east in (("a", -118.1), ("b", -118.5))]
        for imt, levels in (("PGV", levels_cm_s), ("PGA", levels_cm_s / 100)):
            openquake_curves(tree / f"hazard_curve-{kind}-{imt}.csv", kind, imt, levels, rows)
    realisations(tree, (0.6, 0.4))
    row = ",".join(f"{rate:.8e}" for rate in 1e-4 * (levels_cm_s / 100) ** -2.0)
    (output / "config.json").write_text('{"hazard": {"valueFormat": "ANNUAL_RATE"}}')
    (output / "PGV" / "curves.csv").write_text(
        f"name,lon,lat,{','.join(map(str, levels_cm_s))}\n"
        f"Concord CA,-122.00000,37.95000,{row}\nOakland CA,-122.30000,37.80000,{row}\n"
    )


@pytest.fixture(scope="module")
def example(inputs):
    """Folder of the guide with the ensemble, and with the campaign and the run that the campaign's page makes."""
    folder = inputs.with_name(f"{inputs.name}-run")
    shutil.copytree(inputs, folder)
    guide = ROOT / "docs" / "guide"
    for block in [blocks(guide / "records.md")[0], *blocks(guide / "campaign.md")]:
        if block.kind == "toml":
            Campaign.read(folder / "campaign.toml")  # what 'init' wrote
        execute(block, folder)
    return folder


def execute(block, folder):
    if block.kind == "sh":
        for words in commands(shortened(block.text, folder)):
            look_at(words) if block.how == "parsed" else call(words, folder)
    elif block.kind == "python" and block.how == "parsed":
        compile(block.text, "page", "exec")
    elif block.kind == "python":
        done = subprocess.run(
            [sys.executable, "-c", block.text], cwd=folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{block.text}\n{done.stderr}"
    elif block.kind == "yaml":
        assert yaml.safe_load(block.text)["jobqueue"].keys() <= set(QUEUES)
    elif block.kind == "csv":
        (folder / "sites.csv").write_text(block.text)
    elif block.kind == "toml":
        (folder / "campaign.toml").write_text(block.text)
        Campaign.read(folder / "campaign.toml")
    else:
        pytest.fail(f"a block of no known kind: {block}")


def shortened(text, folder):
    for shown, done in SMALLER.items():
        text = text.replace(shown, done)
    if "3dea16b1" in text:
        rows = open_run(folder / "runs" / "first").sql("select min(job_id) as job from results where toppled")
        text = text.replace("3dea16b1", rows["job"][0].as_py()[:10])
    return text


def call(words, folder):
    assert words[0] == "toppling", words
    if words[1] == "run":  # it starts processes, and takes over signals
        completed = subprocess.run(
            [sys.executable, "-c", RUN_TOPPLING, *words[1:]],
            cwd=folder,
            env=os.environ | SITE,
            capture_output=True,
            text=True,
            check=False,
        )
        assert completed.returncode == 0, f"{words}\n{completed.stdout}\n{completed.stderr}"
        return
    before = Path.cwd()
    os.chdir(folder)
    try:
        done = CliRunner().invoke(cli, words[1:])
    finally:
        os.chdir(before)
    assert done.exit_code == 0, f"{words}\n{done.output}\n{done.exception!r}"


def look_at(words):
    """Read the options of a command as the command line does, without doing it."""
    words = words[words[0] == "nohup" :]
    shell = next((place for place, word in enumerate(words) if word in (">", "2>&1", "&", "&&")), len(words))
    words = words[:shell]
    if words[0] == "make":
        assert f"\n{words[1]}:" in (ROOT / "Makefile").read_text()
    elif words[0] != "toppling":
        assert words[0] in SHELL, words
    else:
        command, context, words = cli, None, words[1:]
        while isinstance(command, click.Group):
            context = command.make_context("toppling", list(words), parent=context)
            _, command, words = command.resolve_command(context, [*context._protected_args, *context.args])
        command.make_context(command.name, list(words), parent=context)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_block_of_a_page_does_what_it_shows(page, request, tmp_path):
    given = request.getfixturevalue("inputs" if page.name == "README.md" else "example")
    if page.name == "campaign.md":  # done already, as the others' example
        assert len(open_run(given / "runs" / "first").frame()) == open_run(given / "runs" / "first").planned()
        return
    folder = tmp_path / "here"
    shutil.copytree(given, folder)
    if page.name == "records.md":
        shutil.rmtree(folder / "ensembles")
    for block in blocks(page):
        if block.how != "slow":
            execute(block, folder)


def write_stations(folder, every):
    """Two LAZ files with each so many-th point of the demo's virtual scan."""
    stations, _ = demo_scan(1)
    for number, group in enumerate((stations[::2], stations[1::2]), 1):
        points_m = np.concatenate([station.points_m for station in group])[::every]
        cloud = laspy.create(point_format=0, file_version="1.2")
        cloud.header.scales, cloud.header.offsets = [1e-4] * 3, points_m.mean(axis=0).round()
        cloud.x, cloud.y, cloud.z = points_m.T
        cloud.write(folder / f"station{number}.laz")


def test_the_page_on_python_goes_from_a_cloud_to_a_constraint(example, tmp_path):
    folder = tmp_path / "here"
    shutil.copytree(example, folder, ignore=shutil.ignore_patterns("rock", "runs"))
    write_stations(folder, 5)
    text = (folder / "campaign.toml").read_text()  # of a block of 1.2 m; the scanned rock is 14 m high
    text = re.sub("pga_m_s2 = {.*}", "pga_m_s2 = [5, 15, 40]", text.replace("[0, 90, 180, 270]", "[0, 180]"))
    (folder / "campaign.toml").write_text(text)
    page = [block.text for block in blocks(ROOT / "docs" / "guide" / "python.md")]
    begin = next(number for number, text in enumerate(page) if "import run, scan" in text)
    execute(Block("python", "\n".join(page[begin : begin + 2]), ""), folder)
    assert Scene.load(folder / "scenes" / "rock").rock.volume_m3 > 100.0
    assert json.loads((folder / "constraint" / "constraint.json").read_text())["rocks"]


@pytest.mark.slow
def test_the_scan_of_the_pages_makes_a_scene(tmp_path):
    write_stations(tmp_path, 1)
    slow = [block for page in PAGES for block in blocks(page) if block.how == "slow"]
    assert slow
    for words in {tuple(words) for block in slow for words in commands(block.text)}:
        call(list(words), tmp_path)
    assert Scene.load(tmp_path / "scenes" / "rock").rock.volume_m3 > 100.0


def test_every_page_of_the_guide_is_in_its_list():
    listed = (ROOT / "docs" / "guide" / "index.md").read_text()
    assert [page.name for page in PAGES[1:] if page.stem != "index" and f"({page.name})" not in listed] == []


@pytest.mark.parametrize(
    "page",
    [
        *PAGES, *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "decisions").glob("*.md")),
        *sorted((ROOT / "benchmarks" / "reports").glob("*.md")),
    ],
    ids=lambda page: f"{page.parent.name}-{page.stem}",
)  # fmt: skip
def test_links_lead_to_pages_and_sections_that_are_there(page):
    def anchors(path):
        heads = re.findall(r"^#+ (.*)$", path.read_text(), re.M)
        return {re.sub(r"[^\w\- ]", "", head).strip().lower().replace(" ", "-") for head in heads}

    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), f"{page.name}: {target}"
        assert not anchor or anchor in anchors(there), f"{page.name}: {target}"


def test_readme_is_no_longer_than_a_newcomer_reads():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 120
    assert len(text.split()) <= 1800
