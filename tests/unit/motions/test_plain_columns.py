"""Plain columns are the components that their names say, or are refused."""

from pathlib import Path

import numpy as np
import pytest
from motion_samples import STEP_S, shaking
from refusals import left_out, refused

from toppling.models.motions.formats import read_file
from toppling.models.motions.importing import ImportOptions, import_records
from toppling.models.motions.metadata import read_table

UP_NORTH_EAST = [2, 1, 0]
AS_IT_IS = ImportOptions(process=False)


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
        "Zeit [s];UD [m/s2];NS [m/s2];EW [m/s2]",
        "Time (s),Vertical (m/s^2),North-South (m/s^2),East-West (m/s^2)",
        "time,acc_ud_m_s2,acc_ns_m_s2,acc_ew_m_s2",
        "epoch,up_m_s2,north_m_s2,east_m_s2",
        "unix_time,UD (m/s2),NS (m/s2),EO (m/s2)",
        "# units= m/s^2\n# orientation= UP,0,90\n#\n# Column 4: component (+ is 090)",
        "time_s,up_m_s2,north_m_s2,east_m_s2",
        "Time (s),Up (m/s2),North (m/s2),East (m/s2),",
        "Station ROCK\nrecorded at night\nTime (s),UD,NS,EW",
        '"Time (s)","Acc, UD (m/s2)","Acc, NS (m/s2)","Acc, EW (m/s2)"',
    ],
)
def test_columns_are_the_components_of_their_names_in_any_order(header, comma, tmp_path):
    a = shaking()
    outcome = imported(table_of(tmp_path, header, a[:, UP_NORTH_EAST], comma))
    assert [str(refusal.reason) for refusal in outcome.refusals] == []
    (record,) = outcome.records
    assert record.north_known
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 2e-6


@pytest.mark.parametrize("date", ["Date", "Datum", "fecha"])
def test_a_date_and_a_time_of_day_in_cells_of_their_own_are_one_time(date, tmp_path):
    a, path = shaking(), tmp_path / "rec.csv"
    seconds = 86398.0 + STEP_S * np.arange(len(a))  # past midnight
    clock = [f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:05.2f}" for s in seconds]
    rows = [
        f"01.03.2024;{when};{';'.join(f'{x:.6f}' for x in row)}" for when, row in zip(clock, a, strict=True)
    ]
    path.write_text("\n".join([f"{date};Time;EW (m/s2);NS (m/s2);UD (m/s2)", *rows]) + "\n")
    (record,) = import_records([path], options=AS_IT_IS).records
    assert record.motion.time_step_s == STEP_S
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 2e-6


def test_samples_that_fill_lines_may_be_spaced_by_intervals_of_a_step_in_their_heading(tmp_path):
    a = shaking()
    for name, series in zip(("N20W", "S70W", "VERT"), a.T, strict=True):
        head = f"COMP. {name}\nNO. OF POINTS: {len(a)}  EQUALLY SPACED INTERVALS OF: {STEP_S:.3f} SEC  UNIT: CM/SEC/SEC"
        lines = [" ".join(f"{100 * x:.4f}" for x in series[i : i + 8]) for i in range(0, len(a), 8)]
        (tmp_path / f"051WCW_{name}.dat").write_text("\n".join([head, *lines]) + "\n")
    (record,) = import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS).records
    assert record.north_known
    assert record.motion.time_step_s == STEP_S
    assert np.abs(record.motion.acceleration_m_s2[:, 2] - a[:, 2]).max() < 2e-6


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
        "time,UD,NS,humidity",
        "UD,NS,EW,time",
        "time,NS,NS,UD",
        "recorded at night",
        "# t first second third",
    ],
)
def test_names_that_are_no_components_are_refused_with_their_line(header, tmp_path):
    path = table_of(tmp_path, f"# a title\n{header}", shaking())
    with refused("record.columns_unknown", "rec.csv:2", 4, "NS", "delete this line"):
        read_file(path)


@pytest.mark.parametrize(
    ("unit", "one_m_s2"),
    [
        ("g", 9.80665), ("cm/s²", 0.01), ("m/s^2", 1.0), ("10^-2 m/s2", 0.01), ("×10⁻³ g", 9.80665e-3),
        ("2e-3 g", 0.01961330),
    ],
)  # fmt: skip
def test_a_unit_in_the_names_needs_no_table(unit, one_m_s2, tmp_path):
    a = shaking()
    path = table_of(tmp_path, f"t,E ({unit}),N ({unit}),UP ({unit})", a / one_m_s2)
    (record,) = import_records([path], options=ImportOptions(process=False)).records
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 1e-5


@pytest.mark.parametrize(
    "units",
    ["s,cm/s2,cm/s2,cm/s2", "(s),(cm/s²),(cm/s²),(cm/s²)", "sec, Gal, Gal, Gal", "# s,cm/s2,cm/s2,cm/s2"],
)
def test_units_may_stand_in_a_line_below_the_names(units, tmp_path):
    a = shaking()
    path = table_of(tmp_path, f"{'# ' * units.startswith('#')}Time,EW,NS,UD\n{units}", a * 100)
    (record,) = import_records([path], options=ImportOptions(process=False)).records
    assert record.north_known
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 1e-5


def test_a_unit_of_the_table_that_contradicts_the_names_is_refused_with_its_row(tmp_path):
    path = table_of(tmp_path, "t,E (g),N (g),UP (g)", shaking() / 9.80665)
    assert len(imported(path, unit="g").records) == 1
    left_out(
        imported(path, unit="gal"), "record.unit_contradicted", "0.01 m/s2", "9.80665 m/s2", "table.csv:2"
    )


def test_names_whose_unit_is_none_leave_it_to_the_table(tmp_path):
    path = table_of(tmp_path, "t,E (raw),N (raw),UP (raw)", shaking())
    left_out(import_records([path]), "record.unit_unknown")
    assert len(imported(path).records) == 1


@pytest.mark.parametrize(("unit", "one_s"), [("ms", 1000.0), ("min", 1 / 60)])
def test_times_in_another_unit_are_read_as_such(unit, one_s, tmp_path):
    path = table_of(tmp_path, f"t ({unit}),E,N,UP", shaking(), step=one_s * STEP_S)
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
    with refused("record.columns_are_integrals", "rec.csv:1"):
        read_file(path)


def rows_of(motion: np.ndarray, before=lambda number: "", after: str = "") -> str:
    """Rows of a motion, with something before its numbers."""
    lines = (f"{before(n)}{','.join(f'{x:.6f}' for x in row)}{after}" for n, row in enumerate(motion))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("header", "before"),
    [
        ("no,Time (s),EW (m/s2),NS (m/s2),UD (m/s2)\n", lambda n: f"{n},{n * STEP_S:.2f},"),
        (",time (ms),EW (m/s2),NS (m/s2),UD (m/s2)\n", lambda n: f"{n},{n * STEP_S * 1000:g},"),
        ("Time (microseconds),EW (m/s2),NS (m/s2),UD (m/s2)\n", lambda n: f"{n * STEP_S * 1e6:.0f},"),
        (
            "time,EW (m/s2),NS (m/s2),UD (m/s2)\n",
            lambda n: (
                f"2016-04-1{5 + n // 300}T{'00:00' if n >= 300 else '23:59'}:{(57 + n * STEP_S) % 60:05.2f}Z,"
            ),
        ),
        ("SITE CODE= 47\nSAMPLING RATE= 100Hz\nUNIT = m/s2\nEW,NS,UD\n", lambda n: ""),
        ("# dt: 0.01 s\nn,EW (m/s2),NS (m/s2),UD (m/s2)\n", lambda n: f"{n},"),
        (
            "PLACE : X\nSAMPLING INTERVAL(sec) : 0.01\nRAW PGA (gal): 3\n\nACCELERATION (m/s2)\n  E-W    N-S    U-D\n",
            lambda n: "",
        ),
        ("# units: m/s^2\nt,EW,NS,UD\n", lambda n: f"{n * STEP_S:.2f},"),
        (
            "datetime,EW (m/s2),NS (m/s2),UD (m/s2)\n",
            lambda n: (
                f"03/14/2023 {'12:00' if n >= 300 else '11:59'}:{(57 + n * STEP_S) % 60:05.2f} {'PA'[n < 300]}M,"
            ),
        ),
        ("date time,EW (m/s2),NS (m/s2),UD (m/s2)\n", lambda n: f"14.03.2023 10:00:{n * STEP_S:05.2f},"),
        ("s,m/s2,m/s2,m/s2\ntime,east,north,up\n", lambda n: f"{n * STEP_S:.2f},"),
        ("Time,Acc_EW,Acc_NS,Acc_UD\n(s),(m/s2),(m/s2),(m/s2)\n", lambda n: f"{n * STEP_S:.2f},"),
        ("# field_unit: UTC, m/s**2\nTime,EW,NS,UD\n", lambda n: f"{n * STEP_S:.2f},"),
        ("Time,EW m/s/s,NS in m/s2,Acc. UD m/s^2\n", lambda n: f"{n * STEP_S:.2f},"),
        ("# full scale 4 g; units: m/s2\nTime,EW,NS,UD\n", lambda n: f"{n * STEP_S:.2f},"),
        ("# Aceleracion en m/s^2\nTime,EW,NS,UD\n", lambda n: f"{n * STEP_S:.2f},"),
        (
            "INTERVALO DE MUESTREO, C1-C3 (s) : /.01/.01/.01\nUNIDAD : m/s2\nEW,NS,UD\n",
            lambda n: "",
        ),
        ("Sampling rate ADC16: 100 Hz\nunits: m/s2\nEW,NS,UD\n", lambda n: ""),
        (
            "time (s),EW (m/s2),NS (m/s2),UD (m/s2)\n",
            lambda n: f"{'# S waves' + chr(10) if n == 150 else ''}{n * STEP_S:.2f},",
        ),
    ],
)
def test_the_time_is_found_whatever_counts_or_tells_it(header, before, tmp_path):
    a = shaking()
    path = tmp_path / "rec.csv"
    path.write_text(header + rows_of(a, before))
    (record,) = import_records([path], options=ImportOptions(process=False)).records
    assert record.motion.time_step_s == pytest.approx(STEP_S)
    assert record.north_known
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 2e-6


def test_numbers_in_quotes_and_text_below_them_are_the_same_record(tmp_path):
    a = shaking()
    header = '"Time (s)","EW (m/s2)","NS (m/s2)","UD (m/s2)"\n'
    path = tmp_path / "rec.csv"
    body = rows_of(a, lambda n: f"{n * STEP_S:.2f},").replace(",", '","').replace("\n", '"\n"')
    path.write_text(header + '"' + body.removesuffix('"') + "Max,3,4,5\nEND OF FILE\n")
    outcome = import_records([path], options=ImportOptions(process=False))
    assert np.abs(outcome.records[0].motion.acceleration_m_s2 - a).max() < 2e-6
    assert "text below the samples is left out: 'Max,3,4,5'" in outcome.warnings[0][1]


def test_velocity_and_displacement_behind_the_acceleration_are_left_out_by_their_names(tmp_path):
    a = shaking()
    paths = []
    for label, series in (("E", a[:, 0]), ("N", a[:, 1]), ("Z", a[:, 2])):
        paths.append(tmp_path / f"rec_{label}.csv")
        velocity = np.cumsum(series) * STEP_S
        table = np.column_stack([series, 100 * velocity, 100 * np.cumsum(velocity) * STEP_S])
        header = "Time (s),Acceleration (m/s2),Velocity (cm/s),Displacement (cm)\n"
        paths[-1].write_text(header + rows_of(table, lambda n: f"{n * STEP_S:.2f},"))
    (record,) = import_records(paths, options=ImportOptions(process=False)).records
    assert np.abs(record.motion.acceleration_m_s2 - a).max() < 2e-6


def test_two_horizontals_with_names_need_no_vertical_if_it_may_be_missing(tmp_path):
    a = shaking()
    path = tmp_path / "rec.csv"
    path.write_text("time,NS (m/s2),EW (m/s2)\n" + rows_of(a[:, [1, 0]], lambda n: f"{n * STEP_S:.2f},"))
    left_out(import_records([path]), "record.vertical_missing")
    (record,) = import_records([path], options=ImportOptions(process=False, missing_vertical=True)).records
    assert np.abs(record.motion.acceleration_m_s2[:, :2] - a[:, :2]).max() < 2e-6


@pytest.mark.parametrize(
    ("header", "code", "named"),
    [
        ("", "record.columns_unnamed", "3 columns"),
        ("Time (weeks),NS (m/s2),EW (m/s2)\n", "record.time_unit_unknown", "'weeks'"),
        ("Time (s),NS (cm/s),EW (cm/s)\n", "record.not_acceleration", "velocity"),
    ],
)
def test_columns_that_might_be_something_else_are_refused_by_their_cause(header, code, named, tmp_path):
    path = tmp_path / "rec.csv"
    path.write_text(header + rows_of(shaking()[:, :2], lambda n: f"{n * STEP_S:.2f},"))
    with refused(code, named):
        read_file(path)


@pytest.mark.parametrize("count", [400, 300])
def test_a_first_line_of_two_numbers_is_count_and_step_if_it_counts_the_rows(count, tmp_path):
    path = tmp_path / "rec.txt"
    path.write_text(f"{count} 0.02\n" + rows_of(shaking()[:, :1]))
    (component,) = read_file(path)
    assert component.time_step_s == 0.02 if count == 400 else np.isnan(component.time_step_s)


def test_two_units_in_the_text_above_are_none(tmp_path):
    path = tmp_path / "rec.csv"
    path.write_text(
        "# units: gal\n# acceleration in g\nt,N,E,Z\n" + rows_of(shaking(), lambda n: f"{n * STEP_S:.2f},")
    )
    left_out(import_records([path]), "record.unit_unknown")


def test_numbers_that_fill_their_columns_are_parted_before_their_signs(tmp_path):
    a = 0.9 * shaking() / np.abs(shaking()).max()
    path = tmp_path / "rec.txt"
    lines = [f"{n * STEP_S:7.3f}" + "".join(f"{100 * x:7.3f}" for x in row) for n, row in enumerate(a)]
    path.write_text("Time (s) EW (gal) NS (gal) UD (gal)\n" + "\n".join(lines) + "\n")
    assert any(len(line.split()) < 4 for line in lines)
    read = np.column_stack([component.acceleration_m_s2 for component in read_file(path)])
    assert np.abs(read - a).max() < 1e-5


def test_a_resultant_is_no_component_and_two_stations_are_refused_by_their_names(tmp_path):
    a = shaking()
    path = tmp_path / "rec.csv"
    header = "Time (s),EW (m/s2),NS (m/s2),UD (m/s2)"
    more = np.column_stack([a, np.linalg.norm(a, axis=1)])
    path.write_text(f"{header},Resultant (m/s2)\n" + rows_of(more, lambda n: f"{n * STEP_S:.2f},"))
    assert len(read_file(path)) == 3
    path.write_text(
        f"{header},B_EW (m/s2),B_NS (m/s2),B_UD (m/s2)\n"
        + rows_of(np.hstack([a, a]), lambda n: f"{n * STEP_S:.2f},")
    )
    with refused("record.columns_unknown", "7 columns"):
        read_file(path)


@pytest.mark.parametrize(
    "header",
    [
        "Zeit (s),Beschleunigung Ost (m/s2),Beschleunigung Nord (m/s2),Beschleunigung Vertikal (m/s2)",
        "Tiempo (s),Aceleración E-O (m/s2),Aceleración N-S (m/s2),Aceleración V (m/s2)",
        "t (s),Este-Oeste (m/s2),Norte-Sur (m/s2),Vertical (m/s2)",
        "Tempo (s),Est (m/s2),Nord (m/s2),Verticale (m/s2)",
        "时间(s),东西(m/s2),南北(m/s2),竖向(m/s2)",
        "t / s,a_E / m s^-2,a_N / m s^-2,a_Z / m s^-2",
    ],
)
def test_directions_are_read_in_other_languages(header, tmp_path):
    (record,) = import_records([table_of(tmp_path, header, shaking())], options=AS_IT_IS).records
    np.testing.assert_allclose(record.motion.acceleration_m_s2, shaking(), atol=1e-5)


def test_what_a_phone_works_out_beside_its_axes_is_left_out(tmp_path):
    names = [f"Linear Acceleration {axis} (m/s^2)" for axis in "xyz"]
    header = ",".join(["Time (s)", *names, "Absolute acceleration (m/s^2)"])
    size = np.linalg.norm(shaking(), axis=1, keepdims=True)
    path = table_of(tmp_path, header, np.hstack([shaking(), size]))
    (record,) = import_records([path], options=AS_IT_IS).records
    np.testing.assert_allclose(record.motion.acceleration_m_s2, shaking(), atol=1e-5)


@pytest.mark.parametrize("zone", ["Z", "+09:00", "-07:00", ""])
def test_a_clocks_zone_is_no_matter_of_the_step(zone, tmp_path):
    lines = [
        f"2024-01-01T16:{n // 6000:02}:{n // 100 % 60:02}.{n % 100:02}{zone},"
        + ",".join(f"{v:.6f}" for v in row)
        for n, row in enumerate(shaking())
    ]
    path = tmp_path / "rec.csv"
    path.write_text("\n".join(["time,E (m/s2),N (m/s2),Z (m/s2)", *lines]))
    (record,) = import_records([path]).records
    assert record.motion.time_step_s == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("text", "code", "named"),
    [
        ("# Sampling rate: 200 Hz", "record.step_contradicted", "0.005 s"),
        ("# fs = 50 Hz", "record.step_contradicted", "0.02 s"),
        ("# NPTS = 8000", "record.count_contradicted", 8000),
        ("# acceleration in g", "record.unit_contradicted", "m/s2"),
    ],
)
def test_columns_that_contradict_the_text_above_are_refused(text, code, named, tmp_path):
    path = table_of(tmp_path, f"{text}\nt (s),E (m/s2),N (m/s2),Z (m/s2)", shaking())
    with refused(code, named):
        read_file(path)


def test_a_peak_in_the_text_above_is_that_of_a_component(tmp_path):
    peaks = np.abs(shaking()).max(axis=0)
    for stated, right in ((peaks.max(), True), (peaks.min(), True), (0.01 * peaks.max(), False)):
        header = f"# PGA = {stated:.4f} m/s2\n# NPTS: {len(shaking())}\nt (s),E (m/s2),N (m/s2),Z (m/s2)"
        done = import_records([table_of(tmp_path, header, shaking())], options=AS_IT_IS)
        assert len(done.records) == right
        assert right or done.refusals[0].reason.code == "record.peak_contradicted"


@pytest.mark.parametrize("factor", [1.0, 100.0])
def test_a_unit_of_peaks_is_that_of_samples_that_have_them(factor, tmp_path):
    peaks = factor * np.abs(shaking()).max(axis=0)
    header = (
        f"RAW PGA VALUES (gal): (N-S) {peaks[1]:.3f}, (E-W) {peaks[0]:.3f}, (U-D) {peaks[2]:.3f}\nt,E,N,Z"
    )
    done = import_records([table_of(tmp_path, header, 100.0 * shaking())], options=AS_IT_IS)
    if factor == 100.0:
        np.testing.assert_allclose(done.records[0].motion.acceleration_m_s2, shaking(), atol=1e-5)
    else:
        left_out(done, "record.unit_unknown")


def test_the_unit_that_counts_are_scaled_to_is_not_that_of_the_counts(tmp_path):
    header = "# scale_factor: 427336\n# scale_units: M/S**2\n# field_unit: s, counts\nt,E,N,Z"
    left_out(import_records([table_of(tmp_path, header, shaking())], options=AS_IT_IS), "record.unit_unknown")


def test_times_with_points_may_stand_beside_samples_with_decimal_commas(tmp_path):
    path = table_of(tmp_path, "", shaking(), comma=False)
    rows = [line.split() for line in path.read_text().splitlines() if not line.startswith("#")]
    lines = [";".join([row[0], *(cell.replace(".", ",") for cell in row[1:])]) for row in rows]
    path.write_text("\n".join(["time (s);E (m/s2);N (m/s2);Z (m/s2)", *lines]) + "\n")
    (record,) = import_records([path], options=AS_IT_IS).records
    np.testing.assert_allclose(record.motion.acceleration_m_s2, shaking(), atol=1e-5)


@pytest.mark.parametrize(("name", "since_1970"), [("timestamp", 1.7e12), ("t_ns", 1.7e18), ("time", 1.7e18)])
def test_times_since_1970_go_on_by_the_step_whatever_their_unit(name, since_1970, tmp_path):
    ticks = round(STEP_S * (1e9 if since_1970 > 1e15 else 1e3))
    path = tmp_path / "rec.csv"
    path.write_text(
        f"{name},AccX (m/s2),AccY (m/s2),AccZ (m/s2),GyrX (rad/s),Temp (C)\n"
        + rows_of(np.hstack([shaking(), shaking()[:, :2]]), lambda n: f"{int(since_1970) + ticks * n},")
    )
    (record,) = import_records([path], options=AS_IT_IS).records
    assert record.motion.time_step_s == pytest.approx(STEP_S)
    np.testing.assert_allclose(record.motion.acceleration_m_s2, shaking(), atol=1e-5)


@pytest.mark.parametrize("said", ["Component: {}", "Comp. 1: {}", "COMPONENT {}", "Orientation = {}"])
def test_one_column_points_where_the_text_above_says_whatever_the_files_are_called(said, tmp_path):
    motion = shaking()
    for number, (direction, place) in enumerate((("UP", 2), ("N00E", 1), ("90", 0)), 1):
        head = f"{said.format(direction)}\nUnits: m/s2\nSampling rate: {1 / STEP_S:g} Hz\n"
        (tmp_path / f"quake_{number}.txt").write_text(head + "\n".join(f"{x:.6f}" for x in motion[:, place]))
    (record,) = import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS).records
    np.testing.assert_allclose(record.motion.acceleration_m_s2, motion, atol=1e-5)


def test_a_number_of_a_component_is_no_bearing(tmp_path):
    (tmp_path / "rec.txt").write_text("Component: 2\nUnits: m/s2\nSampling rate: 100 Hz\n0.1\n0.2\n0.3\n")
    assert read_file(tmp_path / "rec.txt")[0].direction is None


@pytest.mark.parametrize("across", [5, 7, 8])
def test_samples_that_fill_lines_are_one_component_where_their_number_and_step_are_stated(across, tmp_path):
    motion = shaking()
    for label, series in zip("ENZ", motion.T, strict=True):
        head = f"ACCELERATION IN CM/S2, COMPONENT {label}\nNPTS= {len(series)}, DT= {STEP_S:.5f} SEC\n"
        words = [f"{100 * x:.4f}" for x in series]
        rows = [" ".join(words[n : n + across]) for n in range(0, len(words), across)]
        (tmp_path / f"rec_{label}.txt").write_text(head + "\n".join(rows))
    (record,) = import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS).records
    np.testing.assert_allclose(record.motion.acceleration_m_s2, motion, atol=1e-5)
    cut = tmp_path / "rec_E.txt"
    cut.write_text("\n".join(cut.read_text().splitlines()[:-5]))
    with refused("record.count_contradicted", len(motion)):
        read_file(cut)


@pytest.mark.parametrize("station", ["RSN953", "CS01"])
def test_a_station_whose_name_ends_like_a_bearing_keeps_its_components_together(station, tmp_path):
    for name, series in zip("ENZ", shaking().T, strict=True):
        rows = "".join(f"{STEP_S * n:.3f},{x:.6f}\n" for n, x in enumerate(series))
        (tmp_path / f"{station}{name}.csv").write_text("time (s),acceleration (m/s2)\n" + rows)
    (record,) = import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS).records
    assert record.motion.time_step_s == STEP_S
