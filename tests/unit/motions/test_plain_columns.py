"""Plain columns are the components that their names say, or are refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_samples import STEP_S, shaking, tabled
from refusals import left_out, refused

from toppling.models.motions.formats import read_file
from toppling.models.motions.importing import ImportOptions, import_records
from toppling.models.motions.metadata import read_table

A = shaking()
AS_IT_IS = ImportOptions(process=False)
NAMED = "Time (s),EW (m/s2),NS (m/s2),UD (m/s2)"
WITHIN_M_S2 = 1e-5


def seconds(n):
    return f"{n * STEP_S:.2f},"


def rows(motion=A, before=seconds, end="\n"):
    return "".join(f"{before(n)}{','.join(f'{x:.6f}' for x in row)}{end}" for n, row in enumerate(motion))


def clock(zone):
    return lambda n: [
        f"2016-04-1{5 + n // 300}T{'00:00' if n >= 300 else '23:59'}:{(57 + n * STEP_S) % 60:05.2f}{zone}"
    ]


def half_day(n):
    return [f"03/14/2023 {'12:00' if n >= 300 else '11:59'}:{(57 + n * STEP_S) % 60:05.2f} {'PA'[n < 300]}M"]


def date_and_time(n):
    s = 86398.0 + n * STEP_S  # past midnight
    return ["01.03.2024", f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:05.2f}"]


def multiples_of(unit_s):
    return lambda n: [f"{n * STEP_S / unit_s:.2f}" if unit_s > 1e-3 else f"{n * STEP_S / unit_s:.0f}"]


TIMES = {
    **{name: ("", [name], multiples_of(1.0)) for name in ("Time (s)", "Zeit [s]", "t / s", "t", "epoch")},
    "milliseconds": ("", ["time (ms)"], multiples_of(1e-3)),
    "microseconds": ("", ["Time (microseconds)"], multiples_of(1e-6)),
    "minutes": ("", ["t (min)"], lambda n: [f"{n * STEP_S / 60.0:.6f}"]),
    "numbered": ("", ["no", "Tempo (s)"], lambda n: [str(n), f"{n * STEP_S:.2f}"]),
    "ms since 1970": ("", ["timestamp"], lambda n: [str(1700000000000 + 10 * n)]),
    **{name: ("", [name], lambda n: [str(1700000000000000000 + 10**7 * n)]) for name in ("t_ns", "time")},
    "half a day": ("", ["datetime"], half_day),
    "a date": ("", ["date time"], lambda n: [f"14.03.2023 10:00:{n * STEP_S:05.2f}"]),
    **{f"{date} and time": ("", [date, "Time"], date_and_time) for date in ("Date", "Datum", "fecha")},
    **{f"a clock {zone}": ("", ["time"], clock(zone)) for zone in ("Z", "+09:00", "-07:00", "")},
    "a rate": ("SITE CODE= 47\nSAMPLING RATE= 100Hz\n", [], lambda n: []),
    "a rate in kHz": ("# sample rate (kHz): 0.1\n", [], lambda n: []),
    "another's rate": ("# original sampling rate: 200 Hz\n# Data sampling rate: 100 sps\n", [], lambda n: []),
    "a converter's rate": ("Sampling rate ADC16: 100 Hz\n", [], lambda n: []),
    "an interval": ("PLACE : X\nSAMPLING INTERVAL(sec) : 0.01\n\n", [], lambda n: []),
    "intervals": ("INTERVALO DE MUESTREO, C1-C3 (s) : /.01/.01/.01\n", [], lambda n: []),
    "a step and numbers": ("# dt: 0.01 s\n", ["n"], lambda n: [str(n)]),
}
"""What tells the time: the text above, the names of columns, and what stands in them."""

DIRECTIONS = [
    ("E", "N", "Z"), ("EW", "NS", "UD"), ("East", "North", "Up"), ("HNE", "HNN", "HNZ"), ("-W", "-S", "-DOWN"),
    ("Acc. 090", "Acc. 000", "Acc. Up"), ("acc_ew", "acc_ns", "acc_ud"), ("a_E", "a_N", "a_Z"), ("EO", "NS", "UD"),
    ("Beschleunigung Ost", "Beschleunigung Nord", "Beschleunigung Vertikal"), ("Est", "Nord", "Verticale"),
    ("Aceleración E-O", "Aceleración N-S", "Aceleración V"), ("Este-Oeste", "Norte-Sur", "Vertical"),
    ("East-West", "North-South", "Vertical"), ("东西", "南北", "竖向"),
]  # fmt: skip
UNITS = {"m/s2": 1.0, "m/s^2": 1.0, "m/s/s": 1.0, "cm/s²": 0.01, "Gal": 0.01, "g": 9.80665}
FACTORS = {"0.01 m/s2": 0.01, "2e-3 g": 0.0196133}
STATED = {
    "({})": "", "[{}]": "", "in {}": "", "above": "# units: {}\n", "as a field": "# field_unit: UTC, {}\n",
    "in Spanish": "# Unidades = {}\n", "beside a scale": "# full scale 4 g; units: {}\n", "below": "", "first": "",
}  # fmt: skip
"""Where the unit is said: in each name, in a line above, or in a line of units below or above the names."""


@st.composite
def columns(draw):
    """The motion in columns, said in a way in which programs and people do."""
    text = draw(st.sampled_from([*STATED]))
    in_names = "{}" in text
    units = UNITS | (FACTORS if text == "({})" else {})
    units = {unit: entry for unit, entry in units.items() if "m/s" in unit or not text.startswith("in ")}
    unit = draw(st.sampled_from([*units]))
    above, times, before = TIMES[draw(st.sampled_from([*TIMES] if in_names or STATED[text] else ["t"]))]
    # Where no time stands before it, a column N counts.
    names = draw(st.sampled_from(DIRECTIONS[not times :]))
    order = draw(st.permutations(range(3)))
    separator, sign = draw(st.sampled_from([",.", ";.", ";,", "\t.", "\t,"]))
    sign = "." if all(cell.isdigit() for cell in before(1)) else sign  # whole numbers and commas are refused
    quote = draw(st.sampled_from(["", '"']))
    motion, named = A[:, order], [names[place] for place in order]
    if draw(st.booleans()) and in_names:
        motion, named = np.column_stack([motion, np.linalg.norm(motion, axis=1)]), [*named, "Resultant"]
    heads = [[*times, *(f"{name} {text.format(unit)}" if in_names else name for name in named)]]
    if not in_names and not STATED[text]:
        heads.insert(text == "below", ["s", *[unit] * len(named)])
    cells = [
        [*before(n), *(f"{x:.7f}".replace(".", sign) for x in row)]
        for n, row in enumerate(motion / units[unit])
    ]
    lines = [separator.join(f"{quote}{cell}{quote}" for cell in row) for row in (*heads, *cells)]
    if draw(st.booleans()):
        lines.insert(150, "# S waves")
    return above + STATED[text].format(unit) + "\n".join(lines) + "\n"


GLUED = 0.9 * A / np.abs(A).max()
REFUSED = {
    **{
        f"names: {names}": (
            f"# a title\n{names}\n" + rows(), "record.columns_unknown", "rec.csv:2", 4, "NS", "delete this line"
        )
        for names in ("time,first,second,third", "time,UD,NS,humidity", "time,NS,NS,UD",
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
    "a row cut short": (f"{NAMED}\n" + rows()[:-12], "record.row_wrong_length", "3 numbers", "401"),
    "NPTS": (f"# NPTS = 8000\n{NAMED}\n" + rows(), "record.count_contradicted", 8000),
    "in g": (f"# unit: g\n{NAMED}\n" + rows(), "record.unit_contradicted", "m/s2"),
}  # fmt: skip
"""Columns that might be something else, or contradict the text above them: the code, and what is named."""

UNIT_UNKNOWN = {
    "two units": "# units: gal\n# unit = g\nt,N,E,Z\n" + rows(),
    "another's unit": "# original unit: gal\n# PGA units: g\nt,N,E,Z\n" + rows(),
    "a sentence": "# acceleration in g\nt,N,E,Z\n" + rows(),
    "counts scaled to a unit": "# scale_factor: 427336\n# scale_units: M/S**2\n# field_unit: s, counts\nt,E,N,Z\n"
    + rows(),
    **{unit: f"t,E ({unit}),N ({unit}),UP ({unit})\n" + rows() for unit in ("raw", "parsec")},
}


def written(folder, text, name="rec.csv"):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def by_table(path, **stated):
    tabled([path] * 3, unit="m/s2", processing="corrected", **stated)
    return import_records([path], read_table(path.with_name("table.csv")), ImportOptions())


def check_same(outcome, motion=A, north_known=True):
    assert [str(refusal.reason) for refusal in outcome.refusals] == []
    (record,) = outcome.records
    assert record.motion.time_step_s == pytest.approx(STEP_S)
    assert record.north_known is north_known
    np.testing.assert_allclose(record.motion.acceleration_m_s2, motion, atol=WITHIN_M_S2)


@settings(max_examples=80)
@given(columns())
def test_a_motion_does_not_depend_on_where_time_unit_and_directions_are_stated(tmp_path_factory, text):
    path = written(tmp_path_factory.mktemp("columns"), text)
    check_same(import_records([path], options=AS_IT_IS))


@pytest.mark.parametrize(
    "header", ["", "# by a program of ours\n", "# t UD NS EW\n# made on a Monday morning\n"]
)
def test_columns_without_names_are_two_horizontals_and_the_vertical(header, tmp_path):
    check_same(by_table(written(tmp_path, header + rows())), north_known=False)


def test_columns_of_a_numbered_file_are_a_single_record(tmp_path):
    path = written(tmp_path, "t,H1 (m/s2),H2 (m/s2),V (m/s2)\n" + rows(), "rot2.csv")
    check_same(import_records([path], options=AS_IT_IS), north_known=False)


def test_the_time_may_stand_behind_the_components(tmp_path):
    table = np.column_stack([A[:, [2, 1, 0]], STEP_S * np.arange(len(A))])
    check_same(by_table(written(tmp_path, "UD,NS,EW,time\n" + rows(table, lambda _: ""))))


@pytest.mark.parametrize(
    ("text", "code", "named"), [(t, c, named) for t, c, *named in REFUSED.values()], ids=REFUSED
)
def test_columns_that_might_be_something_else_are_refused_by_their_cause(text, code, named, tmp_path):
    with refused(code, *named):
        read_file(written(tmp_path, text))


@pytest.mark.parametrize("text", UNIT_UNKNOWN.values(), ids=UNIT_UNKNOWN)
def test_an_unstated_unit_is_left_to_the_table(text, tmp_path):
    path = written(tmp_path, text)
    left_out(import_records([path]), "record.unit_unknown")
    assert len(by_table(path).records) == 1


def test_a_rate_a_minute_is_no_time_step(tmp_path):
    text = "# sampling rate: 6000 samples/min\n" + NAMED.partition(",")[2] + "\n"
    path = written(tmp_path, text + "".join(f"{x:.7f},{y:.7f},{z:.7f}\n" for x, y, z in A))
    left_out(import_records([path]), "record.step_missing")


@pytest.mark.parametrize("names", ["Y,X,Z", "h2,h1,v", "HN2,HN1,HNZ", "T,L,V"])
def test_horizontals_without_bearings_are_in_the_order_of_their_labels(names, tmp_path):
    text = "t," + ",".join(f"{name} (m/s2)" for name in names.split(",")) + "\n" + rows(A[:, [1, 0, 2]])
    check_same(import_records([written(tmp_path, text)], options=AS_IT_IS), north_known=False)


def test_text_that_names_another_quantity_is_reported(tmp_path):
    text = "# Velocity time history\n# Vs30: 400\nt,E,N,Z\n" + rows()
    (warned,) = [text for _, text in by_table(written(tmp_path, text)).warnings]
    assert "Velocity time history" in warned
    assert not by_table(
        written(tmp_path, text.replace("# Vs30", "# Velocity and acceleration\n# Vs30"))
    ).warnings


def test_an_azimuth_of_the_table_counts_and_is_reported_where_it_contradicts_the_file(tmp_path):
    outcome = by_table(written(tmp_path, f"{NAMED}\n" + rows()), h1_azimuth="0", h2_azimuth="90")
    check_same(outcome, A[:, [1, 0, 2]])
    result = [set(text.replace(",", "").split()) for _, text in outcome.warnings]
    assert [words & {"ew", "ns", "0", "90"} for words in result] == [{"ew", "0", "90"}, {"ns", "0", "90"}]


def test_numbers_that_fill_their_columns_are_parted_before_their_signs(tmp_path):
    lines = [f"{n * STEP_S:7.3f}" + "".join(f"{100 * x:7.3f}" for x in row) for n, row in enumerate(GLUED)]
    assert any(len(line.split()) < 4 for line in lines)
    path = written(tmp_path, "Time (s) EW (gal) NS (gal) UD (gal)\n" + "\n".join(lines))
    found = np.column_stack([component.acceleration_m_s2 for component in read_file(path)])
    assert np.abs(found - GLUED).max() < WITHIN_M_S2


def test_accelerations_of_three_files_are_aligned_by_times_and_their_integrals_left_out(tmp_path):
    for late, label, series in zip((0, 20, 3), "ENZ", A.T, strict=True):
        v = 100 * np.cumsum(series) * STEP_S
        table = np.column_stack([series, v, np.cumsum(v) * STEP_S])
        head = "Time (s),Acceleration (m/s2),Velocity (cm/s),Displacement (cm)\n"
        written(tmp_path, head + "".join(rows(table).splitlines(True)[late:]), f"rec_{label}.csv")
    check_same(import_records(sorted(tmp_path.iterdir()), options=AS_IT_IS), A[20:])
