"""Plain columns are the components that their names say, or are refused."""

import numpy as np
import pytest
from motion_samples import COUNT, STEP_S, shaking
from refusals import left_out, refused

from toppling.models.motions.formats import read_file
from toppling.models.motions.importing import ImportOptions, import_records
from toppling.models.motions.metadata import read_table

A = shaking()
UP_NORTH_EAST = A[:, [2, 1, 0]]
AS_IT_IS = ImportOptions(process=False)
NAMED = "Time (s),EW (m/s2),NS (m/s2),UD (m/s2)"
WITHIN_M_S2 = 1e-5


def seconds(n):
    return f"{n * STEP_S:.2f},"


def uncounted(n):
    return ""


def rows(motion=A, before=seconds, end="\n"):
    """Rows of a motion, with something before its numbers."""
    return "".join(f"{before(n)}{','.join(f'{x:.6f}' for x in row)}{end}" for n, row in enumerate(motion))


def parted(separator, text, decimal="."):
    """Another separator, and another decimal sign, where blanks or commas part numbers with points."""
    return text.replace(",", separator).replace(".", decimal)


def clock(n):
    return f"2016-04-1{5 + n // 300}T{'00:00' if n >= 300 else '23:59'}:{(57 + n * STEP_S) % 60:05.2f}Z,"


def half_day(n):
    return f"03/14/2023 {'12:00' if n >= 300 else '11:59'}:{(57 + n * STEP_S) % 60:05.2f} {'PA'[n < 300]}M,"


def date_and_time(n):
    s = 86398.0 + n * STEP_S  # past midnight
    return f"01.03.2024;{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:05.2f};"


def since_1970(base, ticks):
    return lambda n: f"{base + ticks * n},"


def zone(name):
    return lambda n: f"2024-01-01T16:{n // 6000:02}:{n // 100 % 60:02}.{n % 100:02}{name},"


HEAD_OF_COUNTERS = (
    "PLACE : X\nSAMPLING INTERVAL(sec) : 0.01\nRAW PGA (gal): 3\n\nACCELERATION (m/s2)\n  E-W    N-S    U-D\n"
)
SEMICOLONS = {number: ";".join(f"{x:.6f}" for x in row) for number, row in enumerate(A)}
AXES = ",AccX (m/s2),AccY (m/s2),AccZ (m/s2),GyrX (rad/s),Temp (C)\n"
SIX = np.hstack([A, A[:, :2]])
RESULTANT = np.column_stack([A, np.linalg.norm(A, axis=1)])
GLUED = 0.9 * A / np.abs(A).max()

SAME = {
    # what counts or tells the time
    "numbered": "no," + NAMED + "\n" + rows(before=lambda n: f"{n},{n * STEP_S:.2f},"),
    "numbered, ms": ",time (ms)" + NAMED[8:] + "\n" + rows(before=lambda n: f"{n},{n * STEP_S * 1000:g},"),
    "microseconds": "Time (microseconds)" + NAMED[8:] + "\n" + rows(before=lambda n: f"{n * STEP_S * 1e6:.0f},"),
    "a clock": "time" + NAMED[8:] + "\n" + rows(before=clock),
    "a rate": "SITE CODE= 47\nSAMPLING RATE= 100Hz\nUNIT = m/s2\nEW,NS,UD\n" + rows(before=uncounted),
    "dt above": "# dt: 0.01 s\nn" + NAMED[8:] + "\n" + rows(before=lambda n: f"{n},"),
    "an interval": HEAD_OF_COUNTERS + rows(before=uncounted),
    "units above": "# units: m/s^2\nt,EW,NS,UD\n" + rows(),
    "half a day": "datetime" + NAMED[8:] + "\n" + rows(before=half_day),
    "a date": "date time" + NAMED[8:] + "\n" + rows(before=lambda n: f"14.03.2023 10:00:{n * STEP_S:05.2f},"),
    "units first": "s,m/s2,m/s2,m/s2\ntime,east,north,up\n" + rows(),
    "units in brackets": "Time,Acc_EW,Acc_NS,Acc_UD\n(s),(m/s2),(m/s2),(m/s2)\n" + rows(),
    "field_unit": "# field_unit: UTC, m/s**2\nTime,EW,NS,UD\n" + rows(),
    "units in words": "Time,EW m/s/s,NS in m/s2,Acc. UD m/s^2\n" + rows(),
    "full scale": "# full scale 4 g; units: m/s2\nTime,EW,NS,UD\n" + rows(),
    "Spanish": "# Aceleracion en m/s^2\nTime,EW,NS,UD\n" + rows(),
    "slashes": "INTERVALO DE MUESTREO, C1-C3 (s) : /.01/.01/.01\nUNIDAD : m/s2\nEW,NS,UD\n" + rows(before=uncounted),
    "ADC16": "Sampling rate ADC16: 100 Hz\nunits: m/s2\nEW,NS,UD\n" + rows(before=uncounted),
    "a remark amid": NAMED + "\n" + rows(before=lambda n: ("# S waves\n" if n == 150 else "") + seconds(n)),
    "timestamp": "timestamp" + AXES + rows(SIX, since_1970(1700000000000, 10)),
    "t_ns": "t_ns" + AXES + rows(SIX, since_1970(1700000000000000000, 10**7)),
    "time in ns": "time" + AXES + rows(SIX, since_1970(1700000000000000000, 10**7)),
    **{
        f"zone {name}": "time,E (m/s2),N (m/s2),Z (m/s2)\n" + rows(before=zone(name))
        for name in ("Z", "+09:00", "-07:00", "")
    },
    **{
        f"{date} and time": f"{date};Time;EW (m/s2);NS (m/s2);UD (m/s2)\n"
        + "".join(f"{date_and_time(n)}{SEMICOLONS[n]}\n" for n in range(COUNT))
        for date in ("Date", "Datum", "fecha")
    },
    # units in the names, or in a line below them
    **{
        f"E ({unit})": f"t,E ({unit}),N ({unit}),UP ({unit})\n" + rows(A / one)
        for unit, one in (
            ("g", 9.80665), ("cm/s²", 0.01), ("m/s^2", 1.0), ("10^-2 m/s2", 0.01), ("×10⁻³ g", 9.80665e-3),
            ("2e-3 g", 0.01961330),
        )
    },
    **{
        f"below: {units}": f"{'# ' * units.startswith('#')}Time,EW,NS,UD\n{units}\n" + rows(A * 100)
        for units in ("s,cm/s2,cm/s2,cm/s2", "(s),(cm/s²),(cm/s²),(cm/s²)", "sec, Gal, Gal, Gal",
                      "# s,cm/s2,cm/s2,cm/s2")
    },
    # other languages
    **{
        names: names + "\n" + rows()
        for names in (
            "Zeit (s),Beschleunigung Ost (m/s2),Beschleunigung Nord (m/s2),Beschleunigung Vertikal (m/s2)",
            "Tiempo (s),Aceleración E-O (m/s2),Aceleración N-S (m/s2),Aceleración V (m/s2)",
            "t (s),Este-Oeste (m/s2),Norte-Sur (m/s2),Vertical (m/s2)",
            "Tempo (s),Est (m/s2),Nord (m/s2),Verticale (m/s2)",
            "时间(s),东西(m/s2),南北(m/s2),竖向(m/s2)",
            "t / s,a_E / m s^-2,a_N / m s^-2,a_Z / m s^-2",
        )
    },
    # what stands beside the components, between the numbers and below them
    "a phone": "Time (s),Linear Acceleration x (m/s^2),Linear Acceleration y (m/s^2),Linear Acceleration z (m/s^2),"
    "Absolute acceleration (m/s^2)\n" + rows(RESULTANT),
    "a resultant": NAMED + ",Resultant (m/s2)\n" + rows(RESULTANT),
    "decimal commas beside times with points": "time (s);E (m/s2);N (m/s2);Z (m/s2)\n"
    + "".join(f"{n * STEP_S:.6f};{SEMICOLONS[n].replace('.', ',')}\n" for n in range(COUNT)),
}  # fmt: skip
"""Texts of one motion: in each the time, the unit and the directions are said another way."""

REFUSED = {
    **{
        f"names: {names}": (
            f"# a title\n{names}\n" + rows(), "record.columns_unknown", "rec.csv:2", 4, "NS", "delete this line"
        )
        for names in ("time,first,second,third", "time,UD,NS,humidity", "UD,NS,EW,time", "time,NS,NS,UD",
                      "recorded at night", "# t first second third")
    },
    **{
        f"integrals by {unit:g}": (
            rows(np.column_stack([A[:, 0], v, np.cumsum(v) * STEP_S])), "record.columns_are_integrals", "rec.csv:1"
        )
        for unit in (1.0, 100.0) for v in [unit * np.cumsum(A[:, 0]) * STEP_S]
    },
    "no names": (rows(A[:, :2]), "record.columns_unnamed", "3 columns"),
    "weeks": ("Time (weeks),NS (m/s2),EW (m/s2)\n" + rows(A[:, :2]), "record.time_unit_unknown", "'weeks'"),
    "velocity": ("Time (s),NS (cm/s),EW (cm/s)\n" + rows(A[:, :2]), "record.not_acceleration", "velocity"),
    "two stations": (
        NAMED + ",B_EW (m/s2),B_NS (m/s2),B_UD (m/s2)\n" + rows(np.hstack([A, A])), "record.columns_unknown",
        "7 columns",
    ),
    "200 Hz": (f"# Sampling rate: 200 Hz\n{NAMED}\n" + rows(), "record.step_contradicted", "0.005 s"),
    "50 Hz": (f"# fs = 50 Hz\n{NAMED}\n" + rows(), "record.step_contradicted", "0.02 s"),
    "NPTS": (f"# NPTS = 8000\n{NAMED}\n" + rows(), "record.count_contradicted", 8000),
    "in g": (f"# acceleration in g\n{NAMED}\n" + rows(), "record.unit_contradicted", "m/s2"),
}  # fmt: skip
"""Columns that might be something else, or contradict the text above them: the code, and what is named."""

UNIT_UNKNOWN = {
    "two units": "# units: gal\n# acceleration in g\nt,N,E,Z\n" + rows(),
    "counts scaled to a unit": "# scale_factor: 427336\n# scale_units: M/S**2\n# field_unit: s, counts\nt,E,N,Z\n"
    + rows(),
    **{unit: f"t,E ({unit}),N ({unit}),UP ({unit})\n" + rows() for unit in ("raw", "parsec")},
}


def written(folder, text, name="rec.csv"):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def by_table(path, unit="m/s2"):
    table = path.with_name("table.csv")
    table.write_text(
        f"rec_id,h1,h2,v,unit,processing\nA,{path.name},{path.name},{path.name},{unit},corrected\n"
    )
    return import_records([path], read_table(table), ImportOptions())


def check_same(outcome, motion=A, north_known=True):
    assert [str(refusal.reason) for refusal in outcome.refusals] == []
    (record,) = outcome.records
    assert record.motion.time_step_s == pytest.approx(STEP_S)
    assert record.north_known is north_known
    np.testing.assert_allclose(record.motion.acceleration_m_s2, motion, atol=WITHIN_M_S2)


def samples(path):
    return np.column_stack([component.acceleration_m_s2 for component in read_file(path)])


@pytest.mark.parametrize("text", SAME.values(), ids=SAME)
def test_a_motion_is_the_same_whatever_tells_its_time_unit_and_directions(text, tmp_path):
    of_a_phone = "x (m/s" in text.lower()
    check_same(import_records([written(tmp_path, text)], options=AS_IT_IS), north_known=not of_a_phone)


@pytest.mark.parametrize("comma", [True, False])
@pytest.mark.parametrize(
    "header",
    [
        "Time (s),UD (m/s2),NS (m/s2),EW (m/s2)", "Time [s], Up [m/s2], North [m/s2], East [m/s2]",
        "Time (s) UD (m/s2) NS (m/s2) EW (m/s2)", "# t UD NS EW", "# from a shake table\n# t, UD, NS, EW",
        "time,HNZ,HNN,HNE", "\ufefft,acc_Z,acc_N,acc_E", '"Time","Acc. Up","Acc. 000","Acc. 090"',
        "t, -DOWN, -S, -W", "Zeit [s];UD [m/s2];NS [m/s2];EW [m/s2]",
        "Time (s),Vertical (m/s^2),North-South (m/s^2),East-West (m/s^2)", "time,acc_ud_m_s2,acc_ns_m_s2,acc_ew_m_s2",
        "epoch,up_m_s2,north_m_s2,east_m_s2", "unix_time,UD (m/s2),NS (m/s2),EO (m/s2)",
        "# units= m/s^2\n# orientation= UP,0,90\n#\n# Column 4: component (+ is 090)",
        "time_s,up_m_s2,north_m_s2,east_m_s2", "Time (s),Up (m/s2),North (m/s2),East (m/s2),",
        "Station ROCK\nrecorded at night\nTime (s),UD,NS,EW",
        '"Time (s)","Acc, UD (m/s2)","Acc, NS (m/s2)","Acc, EW (m/s2)"',
    ],
)  # fmt: skip
def test_columns_are_the_components_of_their_names_in_any_order(header, comma, tmp_path):
    text = parted(", " if comma else " ", rows(UP_NORTH_EAST))
    check_same(by_table(written(tmp_path, f"{header}\n{text}")))


@pytest.mark.parametrize(
    "header", ["", "# made by a program of ours\n", "# t UD NS EW\n# made on a Monday morning\n"]
)
def test_columns_without_names_are_two_horizontals_and_the_vertical(header, tmp_path):
    check_same(by_table(written(tmp_path, header + rows())), north_known=False)


@pytest.mark.parametrize(
    ("text", "code", "named"), [(t, c, named) for t, c, *named in REFUSED.values()], ids=REFUSED
)
def test_columns_that_might_be_something_else_are_refused_by_their_cause(text, code, named, tmp_path):
    with refused(code, *named):
        read_file(written(tmp_path, text))


@pytest.mark.parametrize("text", UNIT_UNKNOWN.values(), ids=UNIT_UNKNOWN)
def test_a_unit_that_nothing_says_is_left_to_the_table(text, tmp_path):
    path = written(tmp_path, text)
    left_out(import_records([path]), "record.unit_unknown")
    assert len(by_table(path).records) == 1


def test_a_unit_of_the_table_that_contradicts_the_names_is_refused_with_its_row(tmp_path):
    path = written(tmp_path, "t,E (g),N (g),UP (g)\n" + rows(A / 9.80665))
    assert len(by_table(path, unit="g").records) == 1
    left_out(
        by_table(path, unit="gal"), "record.unit_contradicted", "0.01 m/s2", "9.80665 m/s2", "table.csv:2"
    )


@pytest.mark.parametrize(("unit", "one_s"), [("ms", 1000.0), ("min", 1 / 60)])
def test_times_in_another_unit_are_read_as_such(unit, one_s, tmp_path):
    path = written(tmp_path, f"t ({unit}),E,N,UP\n" + rows(before=lambda n: f"{n * one_s * STEP_S:.6f},"))
    assert [component.time_step_s for component in read_file(path)] == pytest.approx([STEP_S] * 3)


def test_numbers_that_fill_their_columns_are_parted_before_their_signs(tmp_path):
    lines = [f"{n * STEP_S:7.3f}" + "".join(f"{100 * x:7.3f}" for x in row) for n, row in enumerate(GLUED)]
    assert any(len(line.split()) < 4 for line in lines)
    path = written(tmp_path, "Time (s) EW (gal) NS (gal) UD (gal)\n" + "\n".join(lines))
    assert np.abs(samples(path) - GLUED).max() < WITHIN_M_S2


def test_numbers_in_quotes_and_text_below_them_are_the_same_record(tmp_path):
    quoted = "".join(
        f'"{line.replace(",", chr(34) + "," + chr(34))}"\n' for line in (NAMED + "\n" + rows()).splitlines()
    )
    outcome = import_records([written(tmp_path, quoted + "Max,3,4,5\nEND OF FILE\n")], options=AS_IT_IS)
    check_same(outcome)
    assert "'Max,3,4,5'" in outcome.warnings[0][1]


def test_velocity_and_displacement_behind_the_acceleration_are_left_out_by_their_names(tmp_path):
    for label, series in zip("ENZ", A.T, strict=True):
        velocity = np.cumsum(series) * STEP_S
        table = np.column_stack([series, 100 * velocity, 100 * np.cumsum(velocity) * STEP_S])
        head = "Time (s),Acceleration (m/s2),Velocity (cm/s),Displacement (cm)\n"
        written(tmp_path, head + rows(table), f"rec_{label}.csv")
    check_same(import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS))


def test_two_horizontals_with_names_need_no_vertical_if_it_may_be_missing(tmp_path):
    path = written(tmp_path, "time,NS (m/s2),EW (m/s2)\n" + rows(A[:, [1, 0]]))
    left_out(import_records([path]), "record.vertical_missing")
    check_same(
        import_records([path], options=ImportOptions(process=False, missing_vertical=True)), A * (1, 1, 0)
    )


@pytest.mark.parametrize("count", [400, 300])
def test_a_first_line_of_two_numbers_is_count_and_step_if_it_counts_the_rows(count, tmp_path):
    (component,) = read_file(written(tmp_path, f"{count} 0.02\n" + rows(A[:, :1], uncounted)))
    assert component.time_step_s == 0.02 if count == 400 else np.isnan(component.time_step_s)


def test_a_peak_in_the_text_above_is_that_of_a_component(tmp_path):
    peaks = np.abs(A).max(axis=0)
    for stated, right in ((peaks.max(), True), (peaks.min(), True), (0.01 * peaks.max(), False)):
        header = f"# PGA = {stated:.4f} m/s2\n# NPTS: {COUNT}\nt (s),E (m/s2),N (m/s2),Z (m/s2)\n"
        done = import_records([written(tmp_path, header + rows())], options=AS_IT_IS)
        assert len(done.records) == right
        assert right or done.refusals[0].reason.code == "record.peak_contradicted"


@pytest.mark.parametrize("factor", [1.0, 100.0])
def test_a_unit_of_peaks_is_that_of_samples_that_have_them(factor, tmp_path):
    east, north, up = factor * np.abs(A).max(axis=0)
    header = f"RAW PGA VALUES (gal): (N-S) {north:.3f}, (E-W) {east:.3f}, (U-D) {up:.3f}\nt,E,N,Z\n"
    done = import_records([written(tmp_path, header + rows(100.0 * A))], options=AS_IT_IS)
    if factor == 100.0:
        check_same(done)
    else:
        left_out(done, "record.unit_unknown")


@pytest.mark.parametrize("said", ["Component: {}", "Comp. 1: {}", "COMPONENT {}", "Orientation = {}"])
def test_one_column_points_where_the_text_above_says_whatever_the_files_are_called(said, tmp_path):
    for number, (direction, place) in enumerate((("UP", 2), ("N00E", 1), ("90", 0)), 1):
        head = f"{said.format(direction)}\nUnits: m/s2\nSampling rate: {1 / STEP_S:g} Hz\n"
        written(tmp_path, head + rows(A[:, [place]], uncounted), f"quake_{number}.txt")
    check_same(import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS))


def test_a_number_of_a_component_is_no_bearing(tmp_path):
    path = written(tmp_path, "Component: 2\nUnits: m/s2\nSampling rate: 100 Hz\n0.1\n0.2\n0.3\n")
    assert read_file(path)[0].direction is None


@pytest.mark.parametrize("across", [5, 7, 8])
@pytest.mark.parametrize(
    ("head", "labels"),
    [
        ("ACCELERATION IN CM/S2, COMPONENT {}\nNPTS= {}, DT= {:.5f} SEC\n", ("E", "N", "Z")),
        (
            "COMP. {}\nNO. OF POINTS: {}  EQUALLY SPACED INTERVALS OF: {:.3f} SEC  UNIT: CM/SEC/SEC\n",
            ("90", "00", "VERT"),
        ),
    ],
)
def test_samples_that_fill_lines_are_one_component_where_their_number_and_step_are_stated(
    head, labels, across, tmp_path
):
    for label, series in zip(labels, A.T, strict=True):
        words = [f"{100 * x:.4f}" for x in series]
        filled = "\n".join(" ".join(words[n : n + across]) for n in range(0, len(words), across))
        path = written(tmp_path, head.format(label, len(series), STEP_S) + filled, f"051WCW_{label}.txt")
    check_same(import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS))
    path.write_text("\n".join(path.read_text().splitlines()[:-5]))
    with refused("record.count_contradicted", COUNT):
        read_file(path)


@pytest.mark.parametrize("station", ["RSN953", "CS01"])
def test_a_station_whose_name_ends_like_a_bearing_keeps_its_components_together(station, tmp_path):
    for name, series in zip("ENZ", A.T, strict=True):
        written(tmp_path, "time (s),acceleration (m/s2)\n" + rows(series[:, None]), f"{station}{name}.csv")
    (record,) = import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS).records
    assert record.motion.time_step_s == STEP_S
