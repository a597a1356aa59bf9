"""Files become records: oriented, processed where they need it, each shaking once, doubts told."""

from pathlib import Path

import numpy as np
import obspy
import pytest
from motion_samples import (
    STEP_S,
    WRITERS,
    columns,
    edited,
    imported,
    peer,
    shaking,
    single_column,
    tabled,
    write_counts,
)
from obspy.core.inventory import Response
from refusals import left_out, refused

from toppling.models.motions.formats.component import Component
from toppling.models.motions.importing import ImportOptions, import_records, record_files
from toppling.models.motions.metadata import read_table
from toppling.models.motions.motion import Motion
from toppling.models.motions.processing import end_at_rest
from toppling.models.motions.quality import check_samples, warnings_of
from toppling.models.motions.record import Record


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

    def change(a):
        a[place] = value
        return a

    return change


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda a: 30 * a, "record.too_strong"), (clipped, "record.clipped"),
        (at((217, 1), 20.0), "record.spike"), (at((slice(150, 230), 0), 0.0), "record.filled_gap")
    ],
)  # fmt: skip
def test_what_no_ground_does_is_questioned_with_its_file_and_read_if_asked_for(change, code, tmp_path):
    peer(tmp_path, change(shaking()))
    left_out(imported(tmp_path), code, ".AT2:5")
    assert imported(tmp_path, doubtful=True).records


@pytest.mark.parametrize("step_s", [0.00833, 0.01, 0.0237])
def test_duplicate_records_are_found_at_any_two_time_steps(step_s, tmp_path):
    a = shaking(2000)
    peer(tmp_path, a)
    # tones of up to 6 Hz, which each of the steps holds
    times = np.arange(0, 1999 * STEP_S, step_s)
    other = np.column_stack([np.interp(times, np.arange(2000) * STEP_S, column) for column in a.T])
    np.savetxt(tmp_path / "rec.txt", np.column_stack([times, other]), fmt="%.6f")
    tabled([tmp_path / "rec.txt"] * 3, unit="m/s2", processing="corrected")
    outcome = imported(tmp_path, process=None)
    assert len(outcome.records) == 1
    left_out(outcome, "record.given_twice")


@pytest.mark.parametrize("names", [("peer", "esm"), *((n, n) for n in ("peer", "esm", "cosmos_v2", "knet"))])
def test_a_record_that_is_given_twice_is_retained_once_unless_folders_are_sites(names, tmp_path):
    for folder, name in zip("ab", names, strict=True):
        (tmp_path / folder).mkdir()
        WRITERS[name](tmp_path / folder, shaking())
    outcome = imported(tmp_path)
    assert len(outcome.records) == 1
    left_out(outcome, "record.given_twice")
    outcome = imported(tmp_path, folders_apart=True)
    assert [Path(record.files[0]).parent.name for record in outcome.records] == ["a", "b"]
    assert len({record.record_id for record in outcome.records}) == 2
    assert not outcome.refusals


def test_collinear_horizontals_are_refused_and_oblique_horizontals_resolved(tmp_path):
    a = shaking()

    def with_azimuths(h1, h2):
        tabled(columns(tmp_path, a), unit="m/s2", h1_azimuth=f"{h1}", h2_azimuth=f"{h2}")
        return imported(tmp_path)

    left_out(with_azimuths(10, 25), "record.horizontals_parallel", 10, 25)
    (record,) = with_azimuths(90, 30).records
    # what was read along 90 degrees is x; along 30 degrees from north, x sin 30 + y cos 30 was read
    x, y, _ = record.motion.acceleration_m_s2.T
    assert np.allclose(x, a[:, 0], atol=1e-6)
    assert np.allclose(x * np.sin(np.pi / 6) + y * np.cos(np.pi / 6), a[:, 1], atol=1e-6)


def test_a_single_azimuth_turns_nothing_and_is_reported(tmp_path):
    tabled(single_column(tmp_path, shaking()), unit="gal", dt="0.01", h1_azimuth="40", processing="corrected")
    rename = {"STA2_E": "a", "STA2_N": "b"}
    outcome = renamed(tmp_path, rename)
    assert not outcome.records[0].north_known
    assert ["azimuth 40" in text for _, text in outcome.warnings] == [True]


@pytest.mark.parametrize(
    ("names", "known"),
    [
        (("horizon", "trace"), False), (("first_run", "first_one"), False), (("ST_down", "ST_dune"), False),
        (("STN", "STE"), True), (("st_n", "st_e"), True), (("ST.HNN", "ST.HNE"), True),
    ],
)  # fmt: skip
def test_letters_at_the_ends_of_names_are_directions_where_the_names_differ_in_nothing_else(
    names, known, tmp_path
):
    single_column(tmp_path, shaking())
    outcome = renamed(tmp_path, dict(zip(("STA2_E", "STA2_N"), names, strict=True)))
    (record,) = outcome.records
    assert record.north_known is known
    order = [1, 0, 2] if known else [0, 1, 2]
    np.testing.assert_allclose(record.motion.acceleration_m_s2, shaking()[:, order], atol=1e-6)


def renamed(folder, names):
    """Import a table and its files, of which some get other names."""
    table = folder / "table.csv"
    for old, new in names.items():
        (folder / f"{old}.txt").rename(folder / f"{new}.txt")
        table.write_text(table.read_text().replace(f"{old}.", f"{new}."))
    return imported(folder, process=False)


def test_components_that_begin_apart_are_refused_where_a_start_time_is_missing(tmp_path):
    paths = edited(tmp_path, "esm")
    for path, second in zip(paths, ("00.000", "00.500"), strict=False):
        stated = f"DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS: 20200101_0000{second}"
        path.write_text(path.read_text().replace("USER20:", stated))
    left_out(imported(tmp_path), "record.start_missing", "does not say when it begins")


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
    response = Response.from_paz(
        [0, 0], poles, gain, 1.0, input_units="M/S", output_units="COUNTS", normalization_factor=1.0
    )
    for part in (response.instrument_sensitivity, response.response_stages[0]):
        part.input_units = unit
    response.instrument_sensitivity.value *= one_m_s
    response.response_stages[0].stage_gain *= one_m_s
    channels = {
        f"HH{code}": (gain * counts, turned.get(code, 0), -90 if code == "Z" else 0)
        for code, counts in series.items()
    }
    write_counts(tmp_path, channels, response)
    (record,) = imported(tmp_path).records
    assert record.north_known
    assert any("response removed" in step for step in record.history)
    # the burst's 0.5 to 6 Hz lie far inside of the band in which the response is removed
    error = np.abs(record.motion.acceleration_m_s2 - a).max()
    assert error < 0.02 * np.abs(a).max()


@pytest.mark.parametrize("letter", "ENZ")
def test_an_uncorrected_channel_makes_its_record_uncorrected(letter, tmp_path):
    (path,) = (p for p in WRITERS["esm"](tmp_path, shaking()) if f"HN{letter}" in p.name)
    header, samples = path.read_text().split("PROCESSING: manual (Paolucci et al., 2011)")
    path.write_text(f"{header}PROCESSING: NONE{samples}")
    (record,) = imported(tmp_path, process=None).records
    assert record.quality == "processed"


def test_esm_components_are_aligned_by_the_time_of_their_first_sample(tmp_path):
    motion = shaking()
    for path in WRITERS["esm"](tmp_path, motion):
        at = "101.000" if "HNE" in path.name else "100.600"
        header = f"DATE_TIME_FIRST_SAMPLE_YYYYMMDD_HHMMSS: 20160824_013{at}\nNDATA"
        path.write_text(path.read_text().replace("NDATA", header))
    (record,) = imported(tmp_path).records
    late = round(0.4 / STEP_S)
    expected = np.column_stack([motion[:-late, 0], motion[late:, 1:]])
    assert record.motion.acceleration_m_s2 == pytest.approx(expected, abs=1e-4)


A_MINUTE_S = np.arange(6000) * STEP_S
FLING = np.where(np.abs(A_MINUTE_S - 20.0) < 2.0, 0.4 * np.sin(np.pi * (A_MINUTE_S - 20.0) / 2.0), 0.0)
"""Permanent displacement of a metre in four seconds."""
FAR = 5.0 * (np.pi / 60.0) ** 2 * np.cos(np.pi * A_MINUTE_S / 60.0)
"""Ten metres within a minute, level at the end."""
NO, ALL, EAST = np.zeros((6000, 3)), np.full((6000, 3), 0.02), np.eye(3)[0]


@pytest.mark.parametrize(
    ("added_m_s2", "word", "quality"),
    [
        (NO, "", "sound"), (0.02 * np.eye(3)[2], "", "processed"), (ALL, "", "processed"),
        (FLING[:, None] * EAST, "", "sound"), (FAR[:, None] * EAST, "", "processed"),
        (ALL, "corrected", "corrected"), (NO, "raw", "processed")
    ],
    ids=["at rest", "an offset up", "an offset", "a fling", "a wander", "called corrected", "called raw"],
)  # fmt: skip
def test_columns_are_left_if_they_are_called_corrected_or_do_not_drift(added_m_s2, word, quality, tmp_path):
    # It begins and ends at rest, velocity and displacement zero.
    a = end_at_rest(Motion(shaking(6000), STEP_S)).acceleration_m_s2.copy()
    np.savetxt(tmp_path / "rec.txt", np.column_stack([A_MINUTE_S, a + added_m_s2]), fmt="%.6f")
    tabled([tmp_path / "rec.txt"] * 3, unit="m/s2", processing=word)
    (record,) = imported(tmp_path, process=None).records
    assert record.quality == quality
    if added_m_s2 is ALL and not word:
        # the offset alone reaches 1.2 m/s; processing takes some per cent of a velocity of half a hertz and more
        pgv_m_s = Record.of("a", Motion(a, STEP_S)).intensity["pgv_m_s"]
        assert record.intensity["pgv_m_s"] == pytest.approx(pgv_m_s, rel=0.05)
    if quality in ("sound", "corrected"):
        assert np.abs(record.motion.acceleration_m_s2 - a - added_m_s2).max() < 1e-6  # as it was printed


def test_a_record_that_still_drifts_after_processing_is_reported(tmp_path):
    columns(tmp_path, np.outer(np.sin(np.pi * np.linspace(0.0, 1.0, 1000)) ** 2, [1.0, 0.8, 0.4]))
    outcome = imported(tmp_path, process=True)
    assert [record.quality for record in outcome.records] == ["drifting"]
    assert len(outcome.warnings) == 2  # its pulse is another


def written(folder: Path, name: str, seed: int, *replacements: dict[str, str]) -> list[Path]:
    folder.mkdir()
    changes = [pair for replacement in replacements for pair in replacement.items()]
    return edited(folder, name, *changes, motion=shaking(seed=seed))


def both_imported(folder: Path, events: tuple[str, str], unit: str = ""):
    """What is read of two folders, with a table that names their events."""
    rows = ["event,unit,h1,h2,v"]
    for event, name in zip(events, "ab", strict=True):
        paths = [str(path.relative_to(folder)) for path in sorted((folder / name).iterdir())]
        rows.append(",".join((event, unit, *paths)))
    (folder / "table.csv").write_text("\n".join(rows) + "\n")
    table = read_table(folder / "table.csv")
    return import_records(record_files([folder / "a", folder / "b"]), table, ImportOptions(process=False))


def test_the_tables_events_distinguish_records_whose_headers_do_not(tmp_path):
    for folder, seed in (("a", 0), ("b", 1)):
        written(tmp_path / folder, "smc", seed)
    assert len(both_imported(tmp_path, ("Mainshock", "Aftershock")).records) == 2
    assert len(both_imported(tmp_path, ("Mainshock", "Mainshock")).records) == 1


def test_headers_of_other_origin_distinguish_records_that_the_table_names_alike(tmp_path):
    written(tmp_path / "a", "smc", 0)
    written(tmp_path / "b", "smc", 1, {"18    0004": "18    0041"})
    assert len(both_imported(tmp_path, ("Testquake", "Testquake")).records) == 2


@pytest.mark.parametrize(("hours_later", "records"), [(0, 1), (34, 2)])
def test_a_name_of_the_table_is_an_event_only_if_the_records_begin_together(hours_later, records, tmp_path):
    for folder, seed in (("a", 0), ("b", 1)):
        (tmp_path / folder).mkdir()
        for path in WRITERS["miniseed"](tmp_path / folder, shaking(seed=seed), response=None):
            stream = obspy.read(str(path))
            stream[0].stats.starttime += 3600 * hours_later * seed
            stream.write(str(path), format="MSEED")
    outcome = both_imported(tmp_path, ("Testquake", "Testquake"), unit="5e-6 m/s2")
    assert len(outcome.records) == records


def channel(acceleration_m_s2):
    return Component(np.asarray(acceleration_m_s2, float), STEP_S, 0.0, Path("quake.v1"), 28, "test")


def digitised(peak_m_s2, flat_m_s2, quantum_m_s2=0.0):
    """An analogue trace, straight between points 0.07 s apart: three are level, beyond is the other sign's peak."""
    points = shaking(600)[::7, 0]
    points *= peak_m_s2 / np.abs(points).max()
    points = points if points.min() == -peak_m_s2 else -points  # the peak is downward
    points = np.minimum(points, 0.8 * flat_m_s2)
    at = int(np.argmax(points))
    points[at - 1 : at + 2] = flat_m_s2
    a = np.interp(np.arange(7 * (len(points) - 1) + 1), 7 * np.arange(len(points)), points)
    return np.round(a / quantum_m_s2) * quantum_m_s2 if quantum_m_s2 else a


@pytest.mark.parametrize("quantum_m_s2", [0.0, 1e-4, 1e-3])
def test_a_flat_top_a_tenth_below_the_peak_of_the_other_sign_is_no_clipping(quantum_m_s2):
    a = digitised(0.196, 0.176, quantum_m_s2=quantum_m_s2)
    assert (a == a.max()).sum() >= 15
    check_samples(channel(a))


@pytest.mark.parametrize(
    ("low", "high", "offset_m_s2"),
    [(-0.3, 0.3, 0.0), (-0.6, 0.6, 0.0), (-0.3, 0.3, 0.4), (-0.6, 0.6, 0.4), (-1.0, 0.55, 0.0)],
)
def test_tops_that_are_cut_at_a_rail_or_two_are_clipped_whatever_the_offset(low, high, offset_m_s2):
    a = shaking(600)[:, 0]
    a /= np.abs(a).max()
    with refused("record.clipped"):
        check_samples(channel(np.clip(a, low, high) + offset_m_s2))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_file_given_as_two_components_is_refused(sign, tmp_path):
    a = shaking()
    a[:, 1] = sign * a[:, 0]
    WRITERS["peer"](tmp_path, a)
    outcome = import_records(record_files([tmp_path]))
    assert outcome.refusals[0].reason.code == "record.same_samples"
    assert len(import_records(record_files([tmp_path]), options=ImportOptions(doubtful=True)).records) == 1


@pytest.mark.parametrize(("step_factor", "expected"), [(0.1, True), (1.0, False), (10.0, True)])
def test_a_time_step_in_error_by_a_factor_of_ten_is_reported_by_the_pulses_length(step_factor, expected):
    a = 0.1 * shaking()
    pgv_m_s = np.abs(np.cumsum(a[:, 0]) * STEP_S).max()
    found = warnings_of({"pgv_pga_s": pgv_m_s * step_factor / np.abs(a[:, 0]).max()})
    assert [("time step" in text) for text in found] == [True] * expected
