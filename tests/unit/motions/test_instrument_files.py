"""miniSEED in pieces, SAC of any convention, and peaks that a mistaken unit would explain."""

import gzip
from pathlib import Path

import numpy as np
import obspy
import pytest
from motion_samples import STEP_S, only, sac, shaking
from refusals import refused

from toppling.models.motions.formats import read_file
from toppling.models.motions.importing import ImportOptions, import_records
from toppling.models.motions.metadata import read_table
from toppling.models.motions.quality import warnings_of

START = obspy.UTCDateTime(2020, 1, 1)
COUNTS = np.random.default_rng(3).integers(-1000, 1000, 1000).astype(np.int32)


def pieces(path, *parts: tuple[int, int, float], change=lambda data: data):
    """A file of pieces of one channel: first and last sample of each, and by which share of a sample it is late."""
    traces = []
    for place, (first, last, late) in enumerate(parts):
        data = COUNTS[first:last].copy()
        header = {"network": "XX", "station": "TST", "channel": "HNE", "delta": STEP_S}
        header["starttime"] = START + (first + late) * STEP_S
        traces.append(obspy.Trace(change(data) if place else data, header))
    obspy.Stream(traces).write(str(path), format="MSEED")
    return path


@pytest.mark.parametrize(
    "parts",
    [
        [(0, 600, 0), (400, 1000, 0)], [(0, 600, 0), (600, 1000, 0)], [(600, 1000, 0), (0, 600, 0)],
        [(0, 1000, 0), (200, 700, 0)], [(0, 1000, 0), (0, 1000, 0)],
        [(0, 300, 0), (200, 700, 0), (500, 1000, 0)], [(0, 600, 0), (600, 1000, 0.3)],
        [(0, 600, 0), (600, 1000, -0.4)],
    ],
)  # fmt: skip
def test_pieces_of_a_channel_that_fit_are_one(parts, tmp_path):
    (found,) = read_file(pieces(tmp_path / "r.mseed", *parts))
    assert found.acceleration_m_s2.tolist() == COUNTS.tolist()
    overlap = sum(b - a for a, b, _ in parts) > 1000
    assert any("came twice" in text for text in found.warnings) is overlap


@pytest.mark.parametrize(
    ("parts", "change", "code", "named"),
    [
        ([(0, 600, 0), (400, 1000, 0)], lambda data: data + 1, "record.overlap", "2 s"),
        ([(0, 1000, 0), (500, 700, 0)], lambda data: data[::-1].copy(), "record.overlap", "2 s"),
        ([(0, 600, 0), (700, 1000, 0)], lambda data: data, "record.gap", "1 s"),
        ([(0, 600, 0), (601, 1000, 0)], lambda data: data, "record.gap", "0.01 s"),
    ],
)
def test_pieces_that_do_not_fit_are_refused_as_gap_or_overlap(parts, change, code, named, tmp_path):
    with refused(code, named):
        read_file(pieces(tmp_path / "r.mseed", *parts, change=change))


def turned(folder, order: str, **channels: tuple[float, float]) -> None:
    """SAC files with other azimuths and inclinations, in one order of bytes."""
    for path in sac(folder, shaking()):
        trace = obspy.read(str(path))[0]
        trace.stats.sac.cmpaz, trace.stats.sac.cmpinc = channels[trace.stats.channel[-1]]
        trace.write(str(path), format="SAC", byteorder=order)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("channels", "told"),
    [
        ({"E": (90, 90), "N": (0, 90), "Z": (0, 0)}, 0),  # SAC's own: from the vertical
        ({"E": (90, 0), "N": (0, 0), "Z": (0, -90)}, 2),  # SEED's dip
        ({"E": (90, 0), "N": (0, 0), "Z": (0, 90)}, 3),
        ({"E": (0, 0), "N": (0, 0), "Z": (0, 0)}, 2),  # never set
    ],
)
def test_the_channels_code_decides_where_sacs_inclination_contradicts_it(channels, told, order, tmp_path):
    turned(tmp_path, order, **channels)
    outcome = import_records(
        sorted(tmp_path.glob("*.sac")), read_table(tmp_path / "table.csv"), ImportOptions(process=False)
    )
    record = only(outcome)
    assert np.abs(record.motion.acceleration_m_s2 - shaking()).max() < 1e-6
    assert sum("the code decides" in text for _, text in outcome.warnings) == told


def changed_sac(folder, change):
    """The first channel with something changed."""
    path = sac(folder, shaking())[0]
    trace = obspy.read(str(path))[0]
    change(trace)
    trace.write(str(path), format="SAC")
    return path


@pytest.mark.parametrize(("idep", "quantity"), [(6, "displacement"), (7, "velocity"), (50, "volts")])
def test_sac_of_another_quantity_is_refused_by_its_name(idep, quantity, tmp_path):
    with refused("record.not_acceleration", idep, quantity):
        read_file(changed_sac(tmp_path, lambda trace: trace.stats.sac.update({"idep": idep})))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_of_sac_that_are_not_finite_are_refused(bad, tmp_path):
    with refused("record.sample_out_of_range", "sample 17 of HNE", f"{bad:g}"):
        read_file(changed_sac(tmp_path, lambda trace: trace.data.put(17, bad)))


@pytest.mark.parametrize(
    ("pga", "pgv", "unit", "told"),
    [
        (20.0, 2.0, None, []),
        (36.0, 1.0, 9.80665, ["more than 3 g", "in m/s2 and not in g, the peak is 3.67 m/s2"]),
        (267.0, 20.0, None, ["in cm/s2 and not in m/s2, the peak is 2.67 m/s2", "PGV is 20 m/s"]),
        (8.0, 4.5, None, ["PGV is 4.5 m/s, more than 3 m/s: if its samples are in m/s2 and not in g"]),
        (1e9, 1e9, 1.0, ["PGA is 1e+09 m/s2"]),
    ],
)
def test_a_peak_beyond_nature_is_told_with_the_unit_that_would_explain_it(pga, pgv, unit, told):
    found = warnings_of({"pga_m_s2": pga, "pgv_m_s": pgv}, unit)
    assert bool(found) is bool(told)
    assert all(text in found[0] for text in told)


KINEMETRICS = Path(obspy.__file__).parent / "io" / "kinemetrics" / "tests" / "data"


def test_an_episensors_file_says_its_unit_and_which_channel_is_vertical(tmp_path):
    packed = KINEMETRICS / "STNA.20020722.044649.evt.gz"
    (tmp_path / "rec.evt").write_bytes(gzip.decompress(packed.read_bytes()))
    found = read_file(tmp_path / "rec.evt")
    assert [(each.label, each.direction) for each in found] == [("X", None), ("Y", None), ("Z", "up")]
    by_obspy = obspy.read(str(tmp_path / "rec.evt"), apply_calib=True)
    for each, trace in zip(found, by_obspy, strict=True):  # which takes g to be 9.81
        np.testing.assert_allclose(each.acceleration_m_s2, trace.data * 9.80665 / 9.81, rtol=1e-9)
