"""Every format gives back the motion that was written in it; damage is named with its line."""

import os
from pathlib import Path

import numpy as np
import obspy
import pytest
from motion_samples import COUNT, STEP_S, WRITERS, columns, imported, only, peer, shaking
from obspy.core.inventory import Channel, Inventory, Network, Response, Station
from refusals import left_out, refused, tells

from toppling.models.motions.formats import read_file
from toppling.models.motions.formats.component import bearing, code_direction
from toppling.models.motions.importing import import_records
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import end_at_rest
from toppling.models.motions.record import Record

# what each format's printing rounds off, m/s2: half of its last digit
ROUNDING = {
    "pairs_v1": 5e-4, "geonet_v2a": 5e-5, "geonet_v1a": 5e-5, "cwb": 5e-6, "smc": 5e-5, "miniseed_in_pieces": 3e-6,
    "miniseed": 3e-6, "knet": 2e-6,
}  # fmt: skip
RAW = {"csmip_v1", "pairs_v1", "bhrc", "cosmos_v1", "geonet_v1a", "unam", "cwb", "knet", "miniseed", "sac"}
RAW |= {"miniseed_in_pieces"}
UNORIENTED = {"pairs_v1"}


@pytest.mark.parametrize("name", WRITERS)
def test_a_motion_comes_back_from_every_format_as_it_was_written(name, tmp_path):
    a = shaking()
    WRITERS[name](tmp_path, a)
    record = only(imported(tmp_path))
    motion = record.motion
    assert motion.time_step_s == pytest.approx(STEP_S, rel=1e-9)
    assert len(motion.acceleration_m_s2) == COUNT
    expected = a
    if name == "bhrc":  # written along 352 and 82 degrees
        turn = np.deg2rad([90 - 352, 90 - 82])
        expected = a.copy()
        expected[:, :2] = a[:, :2] @ np.column_stack([np.cos(turn), np.sin(turn)]).T
    assert np.abs(motion.acceleration_m_s2 - expected).max() <= 1.5 * ROUNDING.get(name, 1e-5) + 1e-5
    assert record.north_known is (name not in UNORIENTED)


@pytest.mark.parametrize("name", WRITERS)
def test_uncorrected_records_are_processed_and_corrected_ones_left_alone(name, tmp_path):
    WRITERS[name](tmp_path, shaking())
    (record,) = imported(tmp_path, process=None).records
    assert any("high-pass" in step for step in record.history) is (name in RAW)
    assert (record.quality == "corrected") is (name not in RAW)


def test_the_two_peer_headers_mean_the_same(tmp_path):
    for style in (False, True):
        (tmp_path / str(style)).mkdir()
        peer(tmp_path / str(style), shaking(), old_style=style)
    a, b = (imported(tmp_path / style).records[0] for style in ("False", "True"))
    assert a.sha == b.sha


@pytest.mark.parametrize(
    ("title", "event", "station", "label"),
    [
        ("Nowhere-02, 3/14/1999, Hill Street, 35", "Nowhere-02", "Hill Street", "35"),
        ("Far Isle, Nowhere-03, 3/14/1999, ABC080, E", "Far Isle, Nowhere-03", "ABC080", "E"),
        ("Nowhere, 3/14/1999, Dam, left abutment, 35", "Nowhere", "Dam, left abutment", "35"),
        ("Nowhere, 3/14/1999, Dam (left, top), 35", "Nowhere", "Dam (left, top)", "35"),
        (
            "NOWHERE 03/14/79 15:09, HILL ST., 035 (XYZ STATION 12)",
            "NOWHERE 03/14/79 15:09",
            "HILL ST.",
            "035",
        ),
        ("NOWHERE 03/14/79 1509, HILL STREET #5, UP", "NOWHERE 03/14/79 1509", "HILL STREET #5", "UP"),
        ("Nowhere, Hill Street, 35", "Nowhere", "Hill Street", "35"),
        ("a record of ours", "a record of ours", "", ""),
    ],
)
def test_the_titles_of_peer_are_event_station_and_component(title, event, station, label, tmp_path):
    path = peer(tmp_path, shaking())[0]
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], title, *lines[2:]]) + "\n")
    (component,) = read_file(path)
    assert (component.event, component.station, component.label) == (event, station, label)
    assert component.direction == bearing(label)


def cosmos_counts(folder: Path, a: np.ndarray, gain: float) -> None:
    """COSMOS counts of a recorder of one volt a count and a sensor of one volt per g, before the gain."""
    (path,) = WRITERS["cosmos_v1"](folder, a)
    unknown = f"{-999:13.6f}"
    text = path.read_text().replace("units=g.     (02)", "units=counts(50)").replace(" g at ", " counts at ")
    lines = text.splitlines()
    for start in [i for i, line in enumerate(lines) if "Real-header" in line]:
        for number, value in ((22, 1e6), (42, 1.0), (47, gain)):
            line, place = start + 1 + (number - 1) // 6, 13 * ((number - 1) % 6)
            assert lines[line][place : place + 13] == unknown
            lines[line] = f"{lines[line][:place]}{value:13.5f}{lines[line][place + 13 :]}"
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(("header", "gain"), [(1.0, 1.0), (4.0, 4.0), (-999.0, 1.0)])
def test_counts_of_cosmos_are_divided_by_the_sensors_gain_where_it_is_known(header, gain, tmp_path):
    a = shaking()
    cosmos_counts(tmp_path, a, header)
    (record,) = imported(tmp_path).records
    assert np.abs(record.motion.acceleration_m_s2 * gain - a).max() < 2e-5
    assert any(f"gain {gain:g}" in step for step in record.history)


@pytest.mark.parametrize("gain", [0.0, -2.0])
def test_a_sensor_of_no_gain_is_refused(gain, tmp_path):
    cosmos_counts(tmp_path, shaking(), gain)
    left_out(
        imported(tmp_path, process=None),
        "record.header_unreadable",
        "sensor gain (real header 47)",
        f"{gain:g}",
    )


def test_counts_without_a_response_are_refused(tmp_path):
    WRITERS["miniseed"](tmp_path, shaking(), response=False)
    outcome = imported(tmp_path, process=None)
    assert not outcome.records
    left_out(outcome, "record.unit_unknown", "StationXML")


@pytest.mark.parametrize(
    ("label", "direction"),
    [
        ("090", 90.0), ("360 DEG", 0.0), ("N28W", 332.0), ("S62W", 242.0), ("N90E", 90.0), ("S10E", 170.0),
        ("UP", "up"), ("UD", "up"), ("DWN", "down"), ("EW", 90.0), ("NS", 0.0), ("N37.5E", 37.5),
        ("27.0", 27.0), ("090.0", 90.0), ("90.", 90.0), ("270 DEG.", 270.0), ("-90", 270.0), ("-45", 315.0),
        ("-0", 0.0), ("-UP", "down"), ("-Z", "down"), ("-E", 270.0), ("-N37E", 217.0), ("--", None),
        ("L", None), ("", None), ("400", None), ("-400", None), ("N120E", None),
    ],
)  # fmt: skip
def test_bearings_are_read_as_they_are_written(label, direction):
    assert bearing(label) == direction


def test_channels_that_are_only_numbered_have_no_azimuth(tmp_path):
    a = shaking()
    for path, number in zip(WRITERS["esm"](tmp_path, a), "23Z", strict=True):
        header, samples = path.read_text().split("STREAM: HN", 1)
        path.write_text(f"{header}STREAM: HN{number}{samples[1:]}")
    time = np.arange(COUNT) * STEP_S
    other = shaking(seed=1)
    for number, column in enumerate(other.T, 1):
        np.savetxt(tmp_path / f"single.{number}", np.column_stack([time, column]), fmt="%.6f")
    table = np.column_stack([time, shaking(seed=2)])
    np.savetxt(tmp_path / "rec.txt", table, fmt="%.6f", header="time 1 2 Z", comments="")
    (tmp_path / "table.csv").write_text(
        "rec_id,h1,h2,v,unit,processing\nA,rec.txt,rec.txt,rec.txt,m/s2,corrected\n"
        "B,single.1,single.2,single.3,m/s2,corrected\n"
    )
    outcome = imported(tmp_path, process=None)
    assert [str(refusal.reason) for refusal in outcome.refusals] == []
    assert [record.north_known for record in outcome.records] == [False] * 3


@pytest.mark.parametrize(
    ("code", "direction"), [("0", 0.0), ("1", None), ("3", None), ("90", 90.0), ("E", 90.0)]
)
def test_a_code_is_a_number_of_a_channel_or_a_direction(code, direction):
    assert code_direction(code) == direction


@pytest.mark.parametrize("name", WRITERS)
def test_a_truncated_file_is_refused_and_named(name, tmp_path):
    files = [path for path in WRITERS[name](tmp_path, shaking()) if path.suffix != ".xml"]
    victim = files[0]
    content = victim.read_bytes()
    victim.write_bytes(content[: int(0.7 * len(content))])
    outcome = imported(tmp_path)
    assert not outcome.records
    assert any(str(victim) in refusal.reason.where for refusal in outcome.refusals)


@pytest.mark.parametrize("first", [18, 30, -5])
def test_a_k_net_component_that_lacks_five_lines_anywhere_is_refused(tmp_path, first):
    """In the middle they would shift the rest by .4 s, which no length of the other components tells."""
    victim = next(path for path in WRITERS["knet"](tmp_path, shaking()) if path.suffix == ".NS")
    lines = victim.read_text().splitlines(keepends=True)
    del lines[first : first + 5 if first > 0 else None]
    victim.write_text("".join(lines))
    outcome = imported(tmp_path, process=None)
    assert not outcome.records
    (told,) = [refusal.reason for refusal in outcome.refusals if str(victim) in refusal.reason.where]
    tells(str(told), "record.count_contradicted", 360, 400)


@pytest.mark.parametrize("step", ["1e308", "1e-300", "1e5", "9" * 400])
def test_a_time_step_that_no_instrument_has_is_refused(tmp_path, step):
    for path in WRITERS["peer"](tmp_path, shaking()):
        path.write_text(path.read_text().replace("DT=   .0100", f"DT= {step}"))
    outcome = imported(tmp_path, doubtful=True)
    assert not outcome.records
    codes = {refusal.reason.code for refusal in outcome.refusals}
    assert codes == {"record.header_unreadable" if float(step) == np.inf else "record.step_out_of_range"}


def test_a_line_without_end_is_refused_with_its_number(tmp_path):
    victim = WRITERS["peer"](tmp_path, shaking())[0]
    lines = victim.read_text().split("\n")
    lines[6] += " 1" * 100_000
    victim.write_text("\n".join(lines))
    outcome = imported(tmp_path, process=None)
    assert f"{victim}:7" in [refusal.reason.where for refusal in outcome.refusals]


def test_a_file_that_is_none_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "quake.AT2")
    left_out(import_records([tmp_path / "quake.AT2"]), "file.not_regular")


def test_components_of_slightly_different_length_are_cut_to_what_they_share(tmp_path):
    path = columns(tmp_path, shaking())[0]
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:-3]))
    (record,) = imported(tmp_path, process=None).records
    assert len(record.motion.acceleration_m_s2) == COUNT - 3
    assert any("cut to the 397 they share" in step for step in record.history)


def damaged(path: Path, line: int, old: str, new: str) -> None:
    lines = path.read_text().splitlines(keepends=True)
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    path.write_text("".join(lines))


@pytest.mark.parametrize(("write", "line", "place"), [(peer, 42, 2), *((columns, n, 1) for n in (2, 3, 150))])
def test_nan_is_refused_with_its_line_wherever_it_is(write, line, place, tmp_path):
    path = write(tmp_path, shaking())[0]
    number = path.read_text().splitlines()[line - 1].split()[place]
    damaged(path, line, number, "NaN".rjust(len(number)))
    with refused("record.number_unreadable", f"{path}:{line}", "'NaN'"):
        read_file(path)


@pytest.mark.parametrize("files", ["E,E,Z", "E,N,N", "E,N,E"])
def test_a_row_that_names_one_file_twice_is_refused_with_its_line(tmp_path, files):
    columns(tmp_path, shaking())
    table = tmp_path / "table.csv"
    head, row = table.read_text().splitlines()[:2]
    for old, new in zip("ENZ", files.split(","), strict=True):
        row = row.replace(f"STA1_{old}.", f"STA1_*{new}.")
    table.write_text(f"{head}\n{row.replace('*', '')}\n")
    outcome = imported(tmp_path, process=None)
    assert not outcome.records
    assert ("metadata.file_repeated", f"{table}:2") in [
        (r.reason.code, r.reason.where) for r in outcome.refusals
    ]


@pytest.mark.parametrize("corner_hz", [-1.0, 0.0, 50.0])
def test_a_corner_that_no_filter_has_leaves_its_record_out(tmp_path, corner_hz):
    columns(tmp_path, shaking())
    outcome = imported(tmp_path, process=True, corner_hz=corner_hz)
    assert not outcome.records
    left_out(outcome, "motion.corner_out_of_range", "below 50 Hz")


def test_two_time_steps_are_refused(tmp_path):
    paths = peer(tmp_path, shaking())
    damaged(paths[1], 4, ".0100", ".0050")
    left_out(imported(tmp_path, process=None), "record.step_contradicted", "0.01 s", "0.005 s")


@pytest.mark.parametrize(
    "printed", [lambda time: f"{time:.8f}", lambda time: repr(round(time, 8)), "{:.4e}".format]
)
def test_a_gap_in_the_times_is_refused_with_its_line(printed, tmp_path):
    path = columns(tmp_path, shaking())[0]
    rows = [line.split() for line in path.read_text().splitlines()]
    lines = [f"{printed(float(time))} {' '.join(values)}\n" for time, *values in rows]
    path.write_text("".join(lines[:100] + lines[109:]))
    with refused("record.step_uneven", "acc:101", "0.1 s"):
        read_file(path)


def test_a_file_without_a_header_or_of_no_format_is_refused(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("this is no record\n" * 20)
    with refused("record.format_unknown"):
        read_file(path)
    path.write_bytes(b"")
    with refused("file.empty"):
        read_file(path)


def test_a_missing_vertical_is_refused_unless_asked_for(tmp_path):
    a = shaking()
    columns(tmp_path, a)
    table = tmp_path / "table.csv"
    table.write_text(table.read_text().replace("20220917_STA1_Z.acc", ""))
    (tmp_path / "20220917_STA1_Z.acc").unlink()
    left_out(imported(tmp_path, process=None), "record.vertical_missing")
    (record,) = imported(tmp_path, missing_vertical=True).records
    assert np.all(record.motion.acceleration_m_s2[:, 2] == 0)


def clipped(a):
    most = 0.35 * np.abs(a).max()
    return np.clip(a, -most, most)


def at(place, value):
    """A motion with other samples at a place."""

    def change(a):
        a[place] = value
        return a

    return change


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda a: 30 * a, "record.too_strong"), (clipped, "record.clipped"),
        (at((217, 1), 20.0), "record.spike"), (at((slice(150, 230), 0), 0.0), "record.filled_gap"),
    ],
)  # fmt: skip
def test_what_no_ground_does_is_doubted_with_its_file_and_read_if_asked_for(change, code, tmp_path):
    peer(tmp_path, change(shaking()))
    left_out(imported(tmp_path), code, ".AT2:5")
    assert imported(tmp_path, doubtful=True).records


@pytest.mark.parametrize("step_s", [0.00833, 0.01, 0.0237])
def test_two_records_that_are_one_are_found_at_any_two_time_steps(step_s, tmp_path):
    a = shaking(2000)
    peer(tmp_path, a)
    # tones of up to 6 Hz, which each of the steps holds
    times = np.arange(0, 1999 * STEP_S, step_s)
    other = np.column_stack([np.interp(times, np.arange(2000) * STEP_S, column) for column in a.T])
    np.savetxt(tmp_path / "rec.txt", np.column_stack([times, other]), fmt="%.6f")
    table = tmp_path / "table.csv"
    table.write_text("rec_id,h1,h2,v,unit,processing\nA,rec.txt,rec.txt,rec.txt,m/s2,corrected\n")
    outcome = imported(tmp_path, process=None)
    assert len(outcome.records) == 1
    left_out(outcome, "record.given_twice")


@pytest.mark.parametrize("names", [("peer", "esm"), *((n, n) for n in ("peer", "esm", "cosmos_v2", "knet"))])
def test_a_record_that_is_given_twice_is_kept_once_unless_folders_are_sites(names, tmp_path):
    for folder, name in zip("ab", names, strict=True):
        (tmp_path / folder).mkdir()
        WRITERS[name](tmp_path / folder, shaking())
    outcome = imported(tmp_path)
    assert len(outcome.records) == 1
    left_out(outcome, "record.given_twice")
    outcome = imported(tmp_path, folders_apart=True)
    assert [Path(one.files[0]).parent.name for one in outcome.records] == ["a", "b"]
    assert len({one.record_id for one in outcome.records}) == 2
    assert not outcome.refusals


def test_horizontals_along_one_line_are_refused_and_oblique_ones_resolved(tmp_path):
    a = shaking()
    columns(tmp_path, a)
    table = tmp_path / "table.csv"
    lines = table.read_text().splitlines()

    def with_azimuths(h1, h2):
        table.write_text(f"{lines[0]},h1_azimuth,h2_azimuth\n{lines[1]},{h1},{h2}\n")
        return imported(tmp_path, process=None)

    left_out(with_azimuths(10, 25), "record.horizontals_parallel", 10, 25)
    (record,) = with_azimuths(90, 30).records
    # what was read along 90 degrees is x; along 30 degrees from north, x sin 30 + y cos 30 was read
    x, y, _ = record.motion.acceleration_m_s2.T
    assert np.allclose(x, a[:, 0], atol=1e-6)
    assert np.allclose(x * np.sin(np.pi / 6) + y * np.cos(np.pi / 6), a[:, 1], atol=1e-6)


@pytest.mark.parametrize(("unit", "one_m_s"), [("M/S", 1.0), ("nm/s ", 1e-9), ("CM/SEC", 0.01)])
def test_a_seismometers_response_is_removed_and_the_xmls_azimuths_orient(unit, one_m_s, tmp_path):
    """Ground velocity by a broadband seismometer whose horizontals are at 30 and 120 degrees from north."""
    a = shaking(4000)
    velocity = np.zeros_like(a)
    velocity[1:] = np.cumsum(0.5 * STEP_S * (a[1:] + a[:-1]), axis=0)
    turned = {"1": 30.0, "2": 120.0}
    series = {
        code: velocity[:, 0] * np.sin(np.deg2rad(angle)) + velocity[:, 1] * np.cos(np.deg2rad(angle))
        for code, angle in turned.items()
    } | {"Z": velocity[:, 2]}
    gain, corner = 1e6, 2 * np.pi / 120
    poles = [corner * (-0.707 + 0.707j), corner * (-0.707 - 0.707j)]
    channels = []
    for code, counts in series.items():
        header = {"network": "XX", "station": "BB", "channel": f"HH{code}", "delta": STEP_S}
        trace = obspy.Trace(np.round(counts * gain).astype(np.int32), header)
        trace.stats.starttime = obspy.UTCDateTime(2020, 1, 1)
        trace.write(str(tmp_path / f"BB.HH{code}.mseed"), format="MSEED")
        response = Response.from_paz(
            [0, 0], poles, gain, 1.0, input_units="M/S", output_units="COUNTS", normalization_factor=1.0
        )
        for part in (response.instrument_sensitivity, response.response_stages[0]):
            part.input_units = unit
        response.instrument_sensitivity.value *= one_m_s
        response.response_stages[0].stage_gain *= one_m_s
        angles = {"azimuth": turned.get(code, 0), "dip": -90 if code == "Z" else 0}
        channels.append(Channel(f"HH{code}", "", 0, 0, 0, 0, response=response, **angles))
    Inventory([Network("XX", [Station("BB", 0, 0, 0, channels=channels)])], source="test").write(
        str(tmp_path / "BB.xml"), format="STATIONXML"
    )
    (record,) = imported(tmp_path).records
    assert record.north_known
    assert any("response removed" in step for step in record.history)
    # the burst's 0.5 to 6 Hz lie far inside of the band in which the response is removed
    error = np.abs(record.motion.acceleration_m_s2 - a).max()
    assert error < 0.02 * np.abs(a).max()


def unstated(folder: Path, motion: np.ndarray, header: str = "unit", says: str = "m/s2"):
    """Time and three columns of which the table does not say if they were corrected."""
    time = np.arange(len(motion)) * STEP_S
    np.savetxt(folder / "rec.txt", np.column_stack([time, motion]), fmt="%.6f")
    (folder / "table.csv").write_text(f"rec_id,h1,h2,v,{header}\nA,rec.txt,rec.txt,rec.txt,{says}\n")
    return folder


def long_shaking() -> np.ndarray:
    """A minute that begins and ends at rest, displacement and velocity zero."""
    return end_at_rest(Motion(shaking(6000), STEP_S)).acceleration_m_s2.copy()


def test_columns_that_nobody_calls_corrected_are_left_only_if_their_displacement_does_not_drift(tmp_path):
    a = long_shaking()
    for name, motion in (("sound", a), ("offset", a + np.array([0.0, 0.0, 0.02]))):
        (tmp_path / name).mkdir()
        unstated(tmp_path / name, motion)
    (sound,), (offset,) = (imported(tmp_path / name, process=None).records for name in ("sound", "offset"))
    assert sound.quality == "sound"
    assert np.abs(sound.motion.acceleration_m_s2 - a).max() < 1e-6  # as it was printed
    assert offset.quality == "processed"
    assert not any("agency" in step for step in (*sound.history, *offset.history))


def test_an_offset_of_columns_does_not_become_their_velocity(tmp_path):
    a = long_shaking()
    pgv = Record.of("a", Motion(a, STEP_S)).intensity["pgv_m_s"]
    (record,) = imported(unstated(tmp_path, a + 0.02), process=None).records
    # the offset alone reaches 1.2 m/s; processing takes some per cent of a velocity of half a hertz and more
    assert record.intensity["pgv_m_s"] == pytest.approx(pgv, rel=0.05)


def test_a_permanent_displacement_is_no_drift(tmp_path):
    a = long_shaking()
    time = np.arange(len(a)) * STEP_S - 20.0
    a[:, 0] += np.where(np.abs(time) < 2.0, 0.4 * np.sin(np.pi * time / 2.0), 0.0)  # 1 m in 4 s
    (record,) = imported(unstated(tmp_path, a), process=None).records
    assert record.quality == "sound"


def test_a_far_slow_wander_is_a_drift_though_it_is_level_at_the_end(tmp_path):
    a = long_shaking()
    time = np.arange(len(a)) * STEP_S
    a[:, 1] += 10 * 0.5 * (np.pi / time[-1]) ** 2 * np.cos(np.pi * time / time[-1])  # 10 m within a minute
    (record,) = imported(unstated(tmp_path, a), process=None).records
    assert record.quality == "processed"


@pytest.mark.parametrize(("says", "quality"), [("corrected", "corrected"), ("raw", "processed")])
def test_the_tables_word_on_processing_decides_whatever_drifts(says, quality, tmp_path):
    a = long_shaking() + (0.02 if says == "corrected" else 0.0)
    (record,) = imported(unstated(tmp_path, a, "unit,processing", f"m/s2,{says}"), process=None).records
    assert record.quality == quality


def test_counts_scaled_to_peaks_are_uncorrected_and_their_zero_is_taken_off(tmp_path):
    a = long_shaking()
    peaks, pgv = np.abs(a).max(axis=0), Record.of("a", Motion(a, STEP_S)).intensity["pgv_m_s"]
    unstated(tmp_path, 1000 * a + 350, "pga_h1,pga_h2,pga_v", ",".join(map(str, peaks)))
    for process, quality in ((None, "processed"), (False, "uncorrected")):
        (record,) = imported(tmp_path, process=process).records
        assert record.quality == quality
        # processing takes some per cent of a velocity of half a hertz and more; the zero left in makes 21 m/s
        assert record.intensity["pgv_m_s"] == pytest.approx(pgv, rel=0.05)


@pytest.mark.parametrize("letter", "ENZ")
def test_one_uncorrected_channel_makes_a_record_uncorrected(letter, tmp_path):
    (path,) = (p for p in WRITERS["esm"](tmp_path, shaking()) if f"HN{letter}" in p.name)
    header, samples = path.read_text().split("PROCESSING: manual (Paolucci et al., 2011)")
    path.write_text(f"{header}PROCESSING: NONE{samples}")
    (record,) = imported(tmp_path, process=None).records
    assert record.quality == "processed"
