"""Plain columns are the components that their names say, or are refused."""

from pathlib import Path

import numpy as np
import pytest
from motion_samples import STEP_S, shaking

from toppling.models.errors import InputError
from toppling.models.motions.formats import read_file
from toppling.models.motions.importing import ImportOptions, import_records
from toppling.models.motions.metadata import read_table

UP_NORTH_EAST = [2, 1, 0]


def table_of(folder: Path, header: str, motion: np.ndarray, comma: bool = True, step: float = STEP_S) -> Path:
    """Time and the motion's columns below a header line."""
    path = folder / "rec.csv"
    table = np.column_stack([np.arange(len(motion)) * step, motion])
    with path.open("w", encoding="utf-8") as file:
        np.savetxt(
            file,
            table,
            fmt="%.6f",
            delimiter=", " if comma else " ",
            header=header,
            comments="" if header else "#",
        )
    return path


def imported(path: Path, unit: str = "m/s2"):
    table = path.with_name("table.csv")
    table.write_text(
        f"rec_id,h1,h2,v,unit,processing\nA,{path.name},{path.name},{path.name},{unit},corrected\n"
    )
    return import_records([path], read_table(table), ImportOptions())


@pytest.mark.parametrize("comma", [True, False])
@pytest.mark.parametrize(
    "header",
    [
        "Time (s),UD (m/s2),NS (m/s2),EW (m/s2)",
        "Time [s], Up [m/s2], North [m/s2], East [m/s2]",
        "Time (s) UD (m/s2) NS (m/s2) EW (m/s2)",
        "# t UD NS EW",
        "# from a shake table\n# t, UD, NS, EW",
        "time,HNZ,HNN,HNE",
        "\ufefft,acc_Z,acc_N,acc_E",
        '"Time","Acc. Up","Acc. 000","Acc. 090"',
        "t, -DOWN, -S, -W",
    ],
)
def test_columns_are_the_components_of_their_names_in_any_order(header, comma, tmp_path):
    a = shaking()
    outcome = imported(table_of(tmp_path, header, a[:, UP_NORTH_EAST], comma))
    assert [str(refusal.reason) for refusal in outcome.refusals] == []
    (record,) = outcome.records
    assert record.north_known
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 2e-6


@pytest.mark.parametrize(
    "header", ["", "# made by a program of ours", "# t UD NS EW\n# made on a Monday morning"]
)
def test_columns_without_names_are_two_horizontals_and_the_vertical(header, tmp_path):
    a = shaking()
    (record,) = imported(table_of(tmp_path, header, a)).records
    assert not record.north_known
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 2e-6


@pytest.mark.parametrize(
    "header",
    [
        "time,first,second,third",
        "time,UD,NS",
        "UD,NS,EW,time",
        "time,NS,NS,UD",
        "recorded at night",
        "# t first second third",
    ],
)
def test_names_that_are_no_components_are_refused_with_their_line(header, tmp_path):
    path = table_of(tmp_path, f"# a title\n{header}", shaking())
    with pytest.raises(InputError, match=r"rec\.csv:2: the names of 4 columns are '.*'") as error:
        read_file(path)
    assert "NS" in error.value.expected
    assert "delete this line" in error.value.remedy


@pytest.mark.parametrize(("unit", "one_m_s2"), [("g", 9.80665), ("cm/s²", 0.01), ("m/s^2", 1.0)])
def test_a_unit_in_the_names_needs_no_table(unit, one_m_s2, tmp_path):
    a = shaking()
    path = table_of(tmp_path, f"t,E ({unit}),N ({unit}),UP ({unit})", a / one_m_s2)
    (record,) = import_records([path], options=ImportOptions(process=False)).records
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 1e-5


@pytest.mark.parametrize(
    "units", ["s,cm/s2,cm/s2,cm/s2", "(s),(cm/s²),(cm/s²),(cm/s²)", "sec, Gal, Gal, Gal"]
)
def test_units_may_stand_in_a_line_below_the_names(units, tmp_path):
    a = shaking()
    path = table_of(tmp_path, f"Time,EW,NS,UD\n{units}", a * 100)
    (record,) = import_records([path], options=ImportOptions(process=False)).records
    assert record.north_known
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 1e-5


def test_a_unit_of_the_table_that_contradicts_the_names_is_refused_with_its_row(tmp_path):
    path = table_of(tmp_path, "t,E (g),N (g),UP (g)", shaking() / 9.80665)
    assert len(imported(path, unit="g").records) == 1
    (refusal,) = imported(path, unit="gal").refusals
    assert "the unit is 0.01 m/s2 by the row, and 9.80665 m/s2 by the names" in refusal.reason.what
    assert refusal.reason.where == f"{tmp_path / 'table.csv'}:2"


def test_names_whose_unit_is_none_leave_it_to_the_table(tmp_path):
    path = table_of(tmp_path, "t,E (raw),N (raw),UP (raw)", shaking())
    assert "in which unit" in import_records([path]).refusals[0].reason.what
    assert len(imported(path).records) == 1


def test_times_in_milliseconds_are_read_as_such(tmp_path):
    path = table_of(tmp_path, "t (ms),E,N,UP", shaking(), step=1000 * STEP_S)
    assert [component.time_step_s for component in read_file(path)] == pytest.approx([STEP_S] * 3)


@pytest.mark.parametrize("letter", "Dd")
def test_fortrans_double_precision_is_read(letter, tmp_path):
    a = shaking()
    path = tmp_path / "rec.txt"
    np.savetxt(path, np.column_stack([np.arange(len(a)) * STEP_S, a]), fmt="%.9E")
    path.write_text(path.read_text().replace("E", letter))
    read = np.column_stack([component.acceleration_m_s2 for component in read_file(path)])
    assert np.abs(read - a).max() < 1e-9


@pytest.mark.parametrize("unit", [1.0, 100.0])
def test_velocity_and_displacement_beside_the_acceleration_are_no_components(unit, tmp_path):
    """Under no names, the three columns would be two horizontals and the vertical."""
    a = shaking()[:, 0]
    velocity = unit * np.cumsum(a) * STEP_S
    path = table_of(tmp_path, "", np.column_stack([a, velocity, np.cumsum(velocity) * STEP_S]))
    with pytest.raises(InputError, match=r"rec\.csv:1: its last two columns are integrals"):
        read_file(path)
