"""A text file is the same record in every encoding, with every end of lines and of files."""

import re

import numpy as np
import pytest
from motion_samples import STEP_S, WRITERS, imported, only, shaking
from refusals import refused

from toppling.models.files.given import text_of
from toppling.models.motions.formats import read_file

TEXT = set(WRITERS) - {"miniseed", "sac"}
READ = {"peer", "csmip_v1", "esm", "columns", "knet"}
"""One of each kind of reader is read in each way, all others in the two that change most."""
WAYS = {
    "DOS": lambda content: content.replace(b"\n", b"\r\n"),
    "old Mac": lambda content: content.replace(b"\n", b"\r"),
    "sent as text twice": lambda content: content.replace(b"\n", b"\r\r\n"),
    "mark of UTF-8": lambda content: b"\xef\xbb\xbf" + content,
    "DOS' end of file": lambda content: content.replace(b"\n", b"\r\n") + b"\x1a" * 200,
    "block filled with zeros": lambda content: content + bytes(512 - len(content) % 512),
    "no end of the last line": lambda content: content.rstrip(b"\n"),
    "blank lines at the end": lambda content: content + b"\n  \n\n",
    "UTF-16 of Windows": lambda content: content.decode().encode("utf-16"),
    "UTF-16 of another order": lambda content: b"\xfe\xff" + content.decode().encode("utf-16-be"),
}


def double_precision(content):
    return re.sub(rb"(\d)E([+-]\d\d)", rb"\1D\2", content)


def decimal_commas(content):
    """Commas in the samples: behind the last line of words, or, where words end the file, behind the first header."""
    lines = content.decode().splitlines()
    worded = {number for number, line in enumerate(lines) if re.search("[A-DF-Za-df-z]", line)}
    first = max(worded) + 1 if max(worded) < len(lines) - 1 else 28
    samples = set(range(first, len(lines))) - worded
    return (
        "\n".join(line.replace(".", ",") if n in samples else line for n, line in enumerate(lines)).encode()
        + b"\n"
    )


@pytest.mark.parametrize(
    ("name", "change"),
    [
        *(
            pytest.param(name, change, id=f"{name}, {way}")
            for name in sorted(READ)
            for way, change in WAYS.items()
        ),
        *(
            (name, WAYS[way])
            for name in sorted(TEXT - READ)
            for way in ("DOS' end of file", "UTF-16 of Windows")
        ),
        *((name, double_precision) for name in ("peer", "bhrc", "smc")),
        *((name, decimal_commas) for name in ("esm", "unam", "csmip_v1", "peer", "cwb")),
    ],
)
def test_a_record_is_the_same_however_its_text_is_written(name, change, tmp_path):
    WRITERS[name](tmp_path, shaking(120))
    expected = only(imported(tmp_path))
    contents = {path: path.read_bytes() for path in tmp_path.iterdir() if path.name != "table.csv"}
    for path, content in contents.items():
        path.write_bytes(change(content))
    assert any(path.read_bytes() != content for path, content in contents.items())
    record = only(imported(tmp_path))
    assert (record.sha, record.event, record.station) == (expected.sha, expected.event, expected.station)


@pytest.mark.parametrize("between", [";", "\t", "; ", "  ", ", "])
@pytest.mark.parametrize("columns", [1, 2, 4])
def test_decimal_commas_are_read_where_something_else_stands_between_numbers(columns, between, tmp_path):
    a = shaking(200)
    table = np.column_stack([np.arange(200) * STEP_S, a])[:, {1: [1], 2: [0, 1], 4: [0, 1, 2, 3]}[columns]]
    lines = [between.join(f"{v:.6f}".replace(".", ",") for v in row) for row in table]
    (tmp_path / "r.txt").write_text("\n".join(lines))
    found = read_file(tmp_path / "r.txt")
    assert np.abs(found[0].acceleration_m_s2 - a[:, 0]).max() < 1e-6
    assert columns == 1 or found[0].time_step_s == STEP_S


@pytest.mark.parametrize("columns", [1, 3])
def test_commas_between_and_within_numbers_are_refused_with_the_cause(columns, tmp_path):
    table = np.column_stack([np.arange(50) * STEP_S, shaking(50)[:, :columns]])
    lines = [",".join(f"{v:.4f}" for v in row).replace(".", ",") for row in table]
    (tmp_path / "r.csv").write_text("\n".join(lines))
    with refused("record.commas_ambiguous"):
        read_file(tmp_path / "r.csv")


@pytest.mark.parametrize("digits", [2, 3, 4, 6])
@pytest.mark.parametrize("step_s", [0.005, 0.01, 1 / 128, 0.02, 1 / 200])
def test_the_step_is_found_whatever_the_digits_of_the_times(step_s, digits, tmp_path):
    a = shaking(2000)[:, 0]
    lines = [f"{i * step_s:.{digits}f} {v:.6f}" for i, v in enumerate(a)]
    (tmp_path / "r.txt").write_text("\n".join(lines))
    (found,) = read_file(tmp_path / "r.txt")
    assert found.time_step_s == pytest.approx(step_s, rel=1e-9)


@pytest.mark.parametrize("content", [b"000001D \0\0\0abc" * 40, b"\x01\0\x02\0\0\0\x03\0" * 100, bytes(200)])
def test_binary_files_are_no_text(content):
    assert text_of(b"x" + content + b"x") is None
