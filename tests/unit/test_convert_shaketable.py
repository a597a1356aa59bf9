"""The converter of the published shake-table tests: the table's motion is fused of what each of two sensors knows."""

import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from toppling.models.errors import InputError
from toppling.models.motions.shaketable import read_experiment

STEP_S = 1 / 800
TIME_S = np.arange(0.0, 12.0, STEP_S)
METRES_A_COUNT = -1.524e-5


@pytest.fixture(autouse=True)
def converter(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    import convert_shaketable

    return convert_shaketable


@pytest.fixture
def read_converted(converter, tmp_path_factory):
    """Convert a folder as it was published and read what was written."""

    def read(folder, outcome):
        out = tmp_path_factory.mktemp("converted") / "out"
        converter.convert(folder, out)
        return read_experiment(out, outcome)

    return read


def moved(frequency_hz, amplitude_m):
    """Displacement and acceleration of a table that swings, faded in and out so that filters have no ends to see."""
    phase = 2.0 * np.pi * frequency_hz * TIME_S
    fade = np.sin(np.pi * TIME_S / TIME_S[-1]) ** 4
    displacement = amplitude_m * fade * np.sin(phase)
    return displacement, np.gradient(np.gradient(displacement, STEP_S), STEP_S)


@pytest.mark.parametrize(
    ("frequency_hz", "amplitude_m"), [(0.5, 0.05), (2.0, 0.01), (4.0, 0.004), (9.0, 0.001)]
)
def test_fusion_gives_the_motion_where_both_sensors_are_right(converter, frequency_hz, amplitude_m):
    displacement, acceleration = moved(frequency_hz, amplitude_m)
    fused = converter.fused_m_s2(acceleration, displacement, STEP_S)
    np.testing.assert_allclose(fused, acceleration, atol=0.02 * np.abs(acceleration).max())


def test_fusion_takes_slow_motion_from_the_displacement_and_fast_motion_from_the_accelerometer(converter):
    slow, slow_acceleration = moved(0.5, 0.05)
    fast, fast_acceleration = moved(12.0, 0.0005)
    drifting = fast_acceleration + 0.3 + 0.05 * TIME_S  # which knows nothing of the slow motion
    rounded = slow + 0.0 * fast
    fused = converter.fused_m_s2(drifting, rounded, STEP_S)
    inner = slice(800, -800)
    right = (slow_acceleration + fast_acceleration)[inner]
    assert np.corrcoef(fused[inner], right)[0, 1] > 0.999
    assert np.std(fused[inner] - right) < 0.03 * np.std(right)


def workbook(path, rows):
    cells = "".join(
        "<row>"
        + "".join(
            f'<c r="{letter}{number}" t="inlineStr"><is><t>{value}</t></is></c>'
            if isinstance(value, str)
            else f'<c r="{letter}{number}"><v>{value}</v></c>'
            for letter, value in zip("ABCD", row, strict=False)
            if value is not None
        )
        + "</row>"
        for number, row in enumerate(rows, 1)
    )
    sheet = f'<worksheet xmlns="urn:sheet"><sheetData>{cells}</sheetData></worksheet>'
    with zipfile.ZipFile(path, "w") as book:
        book.writestr("xl/worksheets/sheet1.xml", sheet)


def raw_folder(folder):
    specimen = "Experimental Results for response-Specimen"
    header = ["Test Number", f"{specimen} 1", f"{specimen} 2", "Specimen 2-Numerical KN=3 KS=1"]
    workbook(folder / "Results.xlsx", [header, [4, 0, 1, 1], [11, None, 0, 0]])
    names = ["Test No. ", "Date", "Test Type", "Ground Motion"]
    workbook(folder / "Records.xlsx", [[], names, [4, 1, "x", "'RSN1_A.xlsx'"], [11, 1, "x", " RSN1_A.AT2 "]])
    displacement, acceleration = moved(2.0, 0.01)
    columns = np.zeros((len(TIME_S), 8))
    columns[:, ::2] = TIME_S[:, None]
    columns[:, 1], columns[:, 5] = acceleration / 9.81, displacement / METRES_A_COUNT
    for number in (4, 11):
        np.savetxt(
            folder / f"Test{number}.txt", columns, fmt="%.6g", delimiter="\t", header="Time", comments=""
        )
    return acceleration


def test_the_experiments_own_files_give_the_same_table_of_tests(tmp_path, read_converted):
    acceleration = raw_folder(tmp_path)
    read = read_converted(tmp_path, "sp2_overturned")
    assert [(test.test_no, test.overturned) for test in read.tests] == [(4, True), (11, False)]
    assert {test.ground_motion for test in read.tests} == {"RSN1_A"}
    assert read.tests[0].predicted == {"dem_sp2_kn3_ks1": True}
    assert read.motions[0].time_step_s == pytest.approx(2 * STEP_S, rel=1e-5)
    along = read.motions[0].acceleration_m_s2[:, 0]
    np.testing.assert_allclose(along, acceleration[::2], atol=0.02 * np.abs(acceleration).max())
    assert len(read_converted(tmp_path, "sp1_overturned").tests) == 1


def test_a_workbook_whose_xml_declares_entities_is_refused(tmp_path, read_converted):
    raw_folder(tmp_path)
    with zipfile.ZipFile(tmp_path / "Results.xlsx", "w") as book:
        book.writestr("xl/worksheets/sheet1.xml", '<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>')
    with pytest.raises(InputError, match="entities"):
        read_converted(tmp_path, "sp2_overturned")


def test_a_text_file_of_unequal_times_is_refused(tmp_path, read_converted):
    raw_folder(tmp_path)
    lines = (tmp_path / "Test4.txt").read_text().splitlines()
    (tmp_path / "Test4.txt").write_text("\n".join(lines[:2000] + lines[2600:]))
    with pytest.raises(InputError, match="equal times"):
        read_converted(tmp_path, "sp2_overturned")


def test_a_text_file_that_is_cut_off_is_told_wherever_the_cut_is(tmp_path, read_converted):
    raw_folder(tmp_path)
    lines = (tmp_path / "Test4.txt").read_text().splitlines()
    (tmp_path / "Test4.txt").write_text("\n".join(lines[:5000]))
    assert "at the end of test 4:" in " ".join(read_converted(tmp_path, "sp2_overturned").warnings)
    (tmp_path / "Test4.txt").write_text("\n".join(lines[:5000]) + "\n6.2")
    with pytest.raises(InputError, match="line 5001 is cut off"):
        read_converted(tmp_path, "sp2_overturned")
    (tmp_path / "Test4.txt").write_text("Time\n")
    with pytest.raises(InputError, match="0 samples"):
        read_converted(tmp_path, "sp2_overturned")


def test_tests_of_unknown_records_count_as_one_record(tmp_path, read_converted):
    raw_folder(tmp_path)
    assert read_converted(tmp_path, "sp2_overturned").warnings == []
    (tmp_path / "Records.xlsx").unlink()
    read = read_converted(tmp_path, "sp2_overturned")
    assert len({test.ground_motion for test in read.tests}) == 1
    assert "not known of tests 4, 11" in " ".join(read.warnings)


CELL = (
    '<worksheet xmlns="urn:sheet"><sheetData><row><c r="A1" t="s"><v>{}</v></c></row></sheetData></worksheet>'
)


def _book(path, content, **parts):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        for name, text in {"xl/worksheets/sheet1.xml": content, **parts}.items():
            book.writestr(name, text)


def _byte(path, mark, offset, value):
    content = bytearray(path.read_bytes())
    content[content.rfind(mark) + offset] = value
    path.write_bytes(content)


def _encrypted(path):
    _book(path, CELL.format(0))
    for mark, offset in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        _byte(path, mark, offset, 1)


def _packed_otherwise(path):
    _book(path, CELL.format(0))
    _byte(path, b"PK\x01\x02", 10, 99)


def _torn(path):
    _book(path, CELL.format(0))
    _byte(path, b"PK\x03\x04", 70, 255)


@pytest.mark.parametrize(
    "make",
    [
        _encrypted,
        _packed_otherwise,
        _torn,
        lambda path: path.write_bytes(b""),
        lambda path: zipfile.ZipFile(path, "w").close(),
        lambda path: _book(path, CELL.format(7)),
        lambda path: _book(path, CELL.format("x")),
        lambda path: _book(path, CELL.format("")),
        lambda path: _book(path, "<a>" * 100_000),
        lambda path: _book(path, CELL.format(0).encode("utf-16")),
        lambda path: _book(path, "\x00"),
        lambda path: _book(path, " " * 60_000_000),
    ],
)
def test_a_workbook_that_is_none_is_refused_by_name(tmp_path, make, read_converted):
    raw_folder(tmp_path)
    make(tmp_path / "Results.xlsx")
    with pytest.raises(InputError) as refusal:
        read_converted(tmp_path, "sp2_overturned")
    assert refusal.value.where.endswith("Results.xlsx")


def test_a_workbook_of_strange_numbers_or_titles_is_read_or_refused(tmp_path, read_converted):
    raw_folder(tmp_path)
    head = ["Test Number", "Experimental Results for response-Specimen 1", "Test Number 2", "Test Naught"]
    for number in ("1e400", "nan", "-inf", "1e300", "4"):
        workbook(tmp_path / "Results.xlsx", [head, [float("4"), 0, None, None], [number, 0, None, None]])
        content = (tmp_path / "Results.xlsx").read_bytes()
        assert content
        assert [test.test_no for test in read_converted(tmp_path, "sp1_overturned").tests] == [4]


def test_a_workbook_with_any_byte_changed_is_read_or_refused(tmp_path, converter):
    raw_folder(tmp_path)
    path, random = tmp_path / "Results.xlsx", np.random.default_rng(20261125)
    sound = path.read_bytes()
    for _ in range(300):
        content = bytearray(sound)
        for at in random.integers(0, len(sound), 2):
            content[at] = random.integers(256)
        path.write_bytes(content)
        with suppress(InputError):
            list(converter.sheet(path))
