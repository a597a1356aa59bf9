"""What a document asks for is bounded before it is made: each refused by name, at once, in little memory."""

import json
import time
import tracemalloc

import numpy as np
import pytest
from refusals import states
from small_campaigns import run_document

from toppling.models.errors import InputError
from toppling.models.files.documents import read_toml
from toppling.models.motions.metadata import read_table
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import high_pass
from toppling.models.rock import Rock
from toppling.models.scene import Scene
from toppling.models.shapes import box
from toppling.orchestrator.campaign import MOST_JOBS, Campaign
from toppling.results import run_integrity

SECONDS, MEMORY_BYTES = 1.0, 300e6
AXES = {"scene": '"s"', "ensemble": '"e"', "pga_m_s2": "[1.0]", "azimuth_deg": "[0]", "friction": "[0.8]"}


def refusal(call, *arguments):
    """Message on input that must be refused within a second and 300 MB."""
    start = time.process_time()
    with pytest.raises(InputError) as error:
        call(*arguments)
    assert time.process_time() - start < SECONDS
    tracemalloc.start()
    with pytest.raises(InputError):
        call(*arguments)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < MEMORY_BYTES
    assert len(str(error.value)) < 1000
    return str(error.value)


VALUES = {
    "realisations": ("1_000_000_000", "1e9", "9" * 400, "true"),
    "azimuth_deg": (
        "{ start = 0, stop = 359, step = 1e-6 }", "{ start = 0, stop = 359, step = 1e-300 }",
        "{ start = -1e308, stop = 1e308, step = 1e-308 }",
    ),
    "pga_m_s2": (f"{{ start = 1, stop = {'9' * 400}, step = 1 }}", f"[{'9' * 400}]"),
    "friction": (f"[{'9' * 400}]", "[[[[[0.8]]]]]"), "restitution": ("[nan]",), "preset": ('["fast"]', "{ fast = 1 }"),
    "records": ('["A", 1]',), "peak_displacement_m": ("1e400",),
}  # fmt: skip
"""What no key of a campaign may be."""


def campaign_of(keys):
    return "".join(f"{name} = {text}\n" for name, text in keys.items())


NO_QUOTE_CLOSES = '"' + "x" * 200_000
TEXTS = [
    *(
        (Campaign.read, campaign_of({**AXES, key: value}), (f": {key}: ",))
        for key, values in VALUES.items() for value in values
    ),
    (Campaign.read, "a = " + "[" * 200_000, ("[document.unreadable]", "nested too deep")),
    (Campaign.read, ".".join(["a"] * 100_000) + " = 1", ("[document.too_deep]", "100")),
    (Campaign.read, "realisations = " + "9" * 5000, ("[document.unreadable]", "4300 digits")),
    (Campaign.read, "#" * 3_000_000, ("[file.too_large]", "3 MB")),
    (Campaign.read, "\0", ("[document.unreadable]",)),
    (read_toml, 'scene = "C:\\users\\rock"', ("[document.unreadable]", "write paths with /")),
    (read_toml, 'scene = "D:\\Cliffs"', ("[document.unreadable]", "write paths with /")),
    (read_toml, "scene = rock", ("[document.unreadable]", "put text between quotes")),
    (read_toml, "pga_m_s2 = [2]\npga_m_s2 = [3]", ("[document.unreadable]", "state each key once")),
    (read_table, "h1,h2\n" + NO_QUOTE_CLOSES, ("[table.unreadable]",)),
    *(
        (read_table, f"h1,h2,{column}\na,b,{value}\n", (":2: ",))
        for column, value in (("dt", "1e308"), ("dt", "1e-300"), ("dt", "nan"), ("mag", "1e308"), ("unit", "1e308 g"))
    ),
]  # fmt: skip
"""Files that are refused: by what reader, and what is named."""


@pytest.mark.parametrize(
    ("read", "text", "named"), TEXTS, ids=lambda part: getattr(part, "__name__", str(part)[:40])
)
def test_what_a_file_asks_for_is_refused_by_name_before_it_is_made(tmp_path, read, text, named):
    path = tmp_path / ("file.toml" if read in (Campaign.read, read_toml) else "file.csv")
    path.write_text(text)
    message = refusal(read, path)
    assert str(path) in message
    assert [name for name in named if name not in message] == []


def test_jobs_are_counted_before_any_is_made(tmp_path):
    axes = {
        "pga_m_s2": {"start": 1, "stop": 10, "step": 0.01},
        "azimuth_deg": {"start": 0, "stop": 350, "step": 0.1},
    }
    campaign = Campaign.of({"scene": "s", "ensemble": "e", "friction": [0.8], **axes}, tmp_path)
    message = refusal(campaign.check_jobs, 100)
    assert "100 records x 901 levels x 3501 azimuths" in message
    assert str(MOST_JOBS) in message
    campaign.check_jobs(3)


@pytest.fixture(scope="module")
def sound_scene(tmp_path_factory):
    block = Scene.block(0.15, 0.2, 0.6)
    report = {
        "surface": {"seen_share": 0.9, "closed_share": 0.1, "invented_share": 0.0},
        "uncertainty": {"com_std_m": [0.01, 0.01, 0.02]},
    }
    return Scene(block.rock, block.pedestal, report=report).save(tmp_path_factory.mktemp("scene") / "scene")


RIGHT = (
    ("id", "text"), ("interface.slope_deg", 7), ("quasi_static_toppling_m_s2", []), ("report", {"x": {}}),
)  # fmt: skip
"""A value of the right kind that is no part of the scene's identity, which is compared last."""


@pytest.mark.parametrize("value", [None, "text", 7, [], {"x": {}}, [[]], 1e300, True])
@pytest.mark.parametrize(
    "place",
    [
        "id", "origin_m", "gravity_m_s2", "rock", "rock.com_m", "rock.inertia_per_mass_m2", "pedestal",
        "pedestal.kind", "interface", "interface.point_m", "interface.normal", "interface.slope_deg", "contact",
        "contact.restitution", "quasi_static_toppling_m_s2", "report", "report.surface", "report.surface.seen_share",
        "report.uncertainty", "report.uncertainty.com_std_m",
    ],
)  # fmt: skip
def test_a_mistyped_value_of_a_scene_is_refused_by_its_place(tmp_path, sound_scene, place, value):
    document = json.loads((sound_scene / "scene.json").read_text())
    del document["digest"]  # a stranger's document carries none
    inner = document
    *above, last = place.split(".")
    for key in above:
        inner = inner[key]
    if (place, value) in RIGHT:
        return
    inner[last] = value
    for name in ("rock.ply", "pedestal.ply"):
        (tmp_path / name).write_bytes((sound_scene / name).read_bytes())
    (tmp_path / "scene.json").write_text(json.dumps(document))
    message = refusal(Scene.load, tmp_path)
    assert place in message.splitlines()[0] or "[scene.changed]" in message


@pytest.mark.parametrize("key", ["sessions", "jobs"])
@pytest.mark.parametrize("value", [None, "text", -1, {}, [7], 1e300, 10**200])
def test_a_run_that_lacks_or_mistypes_a_value_is_refused_by_its_key(tmp_path, key, value):
    result = run_document()
    (tmp_path / "run.json").write_text(json.dumps(result))
    assert run_integrity.run_document(tmp_path)["jobs"] == 3
    (tmp_path / "run.json").write_text(json.dumps(result | {key: value}))
    assert f"{key}" in refusal(run_integrity.run_document, tmp_path)
    del result[key]
    (tmp_path / "run.json").write_text(json.dumps(result))
    states(refusal(run_integrity.run_document, tmp_path), "document.value_missing", key)


@pytest.mark.parametrize("step_s", [1e308, 1e-300, 1e5, 0.0, float("nan")])
def test_a_time_step_that_no_motion_has_is_refused(step_s):
    assert "[motion." in refusal(Motion, np.ones((100, 3)), step_s)


def test_a_corner_that_asks_for_hours_of_zeros_is_refused():
    assert "[motion.corner_out_of_range]" in refusal(high_pass, Motion(np.ones((100, 3)), 0.01), 1e-9)


@pytest.mark.parametrize(
    ("face", "what"),
    [
        ((0, 1, 8), "0, 1, 8, where there are 8"),
        ((0, 1, -1), "0, 1, -1"),
        ((0, 1, 2**40), "mesh.index_out_of_range"),
        ((0.0, 1.0, 2.5), "mesh.index_not_whole"),
    ],
)
def test_a_triangle_between_vertices_that_there_are_not_is_refused(face, what):
    rock = box(0.2, 0.2, 0.5)
    faces = np.array(rock.faces, float if isinstance(face[0], float) else np.int64)
    faces[3] = face
    assert what in refusal(Rock.from_triangles, rock.vertices_m, faces)
