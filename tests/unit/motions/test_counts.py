"""A count that is a little off from whole rows is told; where rows are lost in the middle the file is refused."""

from pathlib import Path

import numpy as np
import pytest
from motion_samples import COUNT, WRITERS, imported, only, shaking
from refusals import left_out, refused

from toppling.models.motions.formats import read_file
from toppling.models.motions.formats.record_text import RecordText

HERE = Path("file.txt")
SPOKEN_COUNT = {  # how a header says 400, and how it would say another number
    "peer": "NPTS= {:6d}",
    "csmip_v1": "{:5d} POINTS",
    "csmip_v2": " {} points of accel",
    "cosmos_v2": "   {} acceleration pts",
    "esm": "NDATA: {}\n",
    "unam": "/{0}/{0}/{0}",
    "pairs_v1": "NO. OF POINTS =  {:5d}",
    "bhrc": "NO. OF POINTS =  {:5d}",
    "smc": "{:10d}",
}


def lines_of(count: int, across: int = 5) -> list[str]:
    """Rows of a smooth series."""
    values = np.sin(np.arange(count) / 20.0)
    return [" ".join(f"{v:.6f}" for v in values[i : i + across]) for i in range(0, count, across)]


def taken(lines: list[str], count: int):
    return RecordText(HERE, lines, 4).counted(-1, count, 0)


@pytest.mark.parametrize("count", [0, 900, 1011, 1100, 2000])
def test_a_count_far_from_the_rows_is_refused(count):
    with refused("record.count_contradicted", 1000, count):
        taken(lines_of(1000), count)


def lost(first, last):
    return lambda lines: lines[:first] + lines[last:]


@pytest.mark.parametrize(
    ("damage", "counted"),
    [
        (lost(3, 4), 995), (lost(60, 62), 990), (lost(100, 130), 850), (lost(194, 196), 990),
        (lambda lines: lines[:61] + lines[60:], 1005), (lambda lines: lines[:1] + lines, 1005),
        (lambda lines: [*lines[:100], lines[100].rsplit(" ", 1)[0], *lines[101:]], 999),
    ],
    ids=["one row lost", "two", "thirty", "near the end", "a row twice", "the first twice", "a row not whole"],
)  # fmt: skip
def test_a_row_in_the_middle_that_is_lost_repeated_or_not_whole_is_refused(damage, counted):
    with refused("record.count_contradicted", counted, 1000):
        taken(damage(lines_of(1000)), 1000)


def miscounted(folder: Path, name: str, off: int) -> None:
    WRITERS[name](folder, shaking())
    spoken = SPOKEN_COUNT[name]
    for path in folder.iterdir():
        text = path.read_text()
        if name != "smc":
            assert spoken.format(COUNT) in text
            text = text.replace(spoken.format(COUNT), spoken.format(COUNT + off))
        else:
            lines = text.split("\n")
            lines[13] = f"{COUNT + off:10d}{lines[13][10:]}"
            text = "\n".join(lines)
        path.write_text(text)


@pytest.mark.parametrize("off", [-3, 2])
@pytest.mark.parametrize("name", sorted(SPOKEN_COUNT))
def test_every_format_with_a_count_that_is_a_little_off_is_read_and_told(name, off, tmp_path):
    miscounted(tmp_path, name, off)
    outcome = imported(tmp_path)
    record = only(outcome)
    assert len(record.motion.acceleration_m_s2) == min(COUNT, COUNT + off)
    assert outcome.warnings
    assert any("where the header counts" in step for step in record.history)


def test_a_component_that_lacks_a_row_which_the_others_have_is_refused(tmp_path):
    path = WRITERS["peer"](tmp_path, shaking())[1]
    lines = path.read_text().splitlines()
    del lines[-1]
    path.write_text("\n".join(lines))
    (component,) = read_file(path)
    assert component.missing == 5
    left_out(imported(tmp_path), "record.count_contradicted", 395, 400)
