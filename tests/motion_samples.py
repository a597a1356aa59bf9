"""Small files of every format, written from one motion, to test readers without an agency's file."""

from pathlib import Path

import numpy as np
import obspy
from obspy.core.inventory import Channel, Inventory, Network, Response, Site, Station
from obspy.core.inventory.response import InstrumentSensitivity

from toppling.models.motions.importing import Import, ImportOptions, import_records, record_files
from toppling.models.motions.metadata import read_table
from toppling.models.motions.record import Record

G = 9.80665
STEP_S = 0.01
COUNT = 400


def shaking(count: int = COUNT, step_s: float = STEP_S, seed: int = 0) -> np.ndarray:
    """Acceleration (n, 3) in m/s2, x east, y north, z up: a burst that begins and ends at rest."""
    rng = np.random.default_rng(seed)
    time = np.arange(count) * step_s
    burst = np.sin(np.pi * time / time[-1]) ** 4
    tones = rng.uniform(0.5, 6, (3, 8))
    phases = rng.uniform(0, 2 * np.pi, (3, 8))
    series = np.sin(2 * np.pi * tones[:, :, None] * time + phases[:, :, None]).sum(axis=1)
    return (np.array([0.9, 0.6, 0.3])[:, None] * burst * series).T


def imported(folder: Path, **options) -> Import:
    """What is read from a folder's files, as its table says where it has one; unprocessed if nothing else is said."""
    table = folder / "table.csv"
    rows = read_table(table) if table.exists() else []
    files = [file for file in record_files([folder]) if file != table]
    return import_records(files, rows, ImportOptions(**{"process": False} | options))


def edited(folder: Path, name: str, *changes, motion: np.ndarray | None = None) -> list[Path]:
    """Write the files of a format, and change their text.

    changes: an old text and a new one, which all files have together at least once, or a function of the text of the
    first file.
    """
    paths = WRITERS[name](folder, shaking() if motion is None else motion)
    for change in changes:
        texts = {path: path.read_text() for path in (paths[:1] if callable(change) else paths)}
        if not callable(change):
            assert any(change[0] in text for text in texts.values()), change
        for path, text in texts.items():
            path.write_text(change(text) if callable(change) else text.replace(*change))
    return paths


def only(outcome: Import) -> Record:
    assert [str(refusal.reason) for refusal in outcome.refusals] == []
    (record,) = outcome.records
    return record


def peak_of(series: np.ndarray) -> float:
    """The sample farthest from zero, with its sign, as headers state it."""
    return float(series[np.abs(series).argmax()])


def rows(values: np.ndarray, form: str, across: int) -> str:
    texts = [format(v, form) for v in values]
    return "".join("".join(texts[i : i + across]) + "\n" for i in range(0, len(texts), across))


def apart(folder: Path, name: str, labels, a: np.ndarray, text) -> list[Path]:
    """A file of each component, whose text is that of its label and its series."""
    paths = [folder / name.format(label) for label in labels]
    for path, label, series in zip(paths, labels, a.T, strict=True):
        path.write_text(text(label, series))
    return paths


def tabled(paths: list[Path], **stated: str) -> list[Path]:
    """Files of a record's components, with the table that states them and more."""
    head, row = ",".join(("rec_id,h1,h2,v", *stated)), ["A", *(path.name for path in paths), *stated.values()]
    paths[0].with_name("table.csv").write_text(f"{head}\n{','.join(row)}\n")
    return paths


def peer(folder: Path, a: np.ndarray) -> list[Path]:
    def text(label, series):
        return (
            f"PEER NGA STRONG MOTION DATABASE RECORD\nTestquake, 1/2/2003, Station, {label}\n"
            f"ACCELERATION TIME SERIES IN UNITS OF G\nNPTS= {len(series):6d}, DT=   .0100 SEC,\n"
            + rows(series / G, "15.7E", 5).replace(" 0.", "  .").replace("-0.", " -.")
        )

    return apart(folder, "RSN9_TEST_STA{}.AT2", ("090", "000", "UP"), a, text)


def columns(folder: Path, a: np.ndarray) -> list[Path]:
    def text(_, series):
        return "".join(f"{n * STEP_S:012.8f} {value:.6f}\n" for n, value in enumerate(series))

    paths = apart(folder, "20220917_STA1_{}.acc", "ENZ", a, text)
    return tabled(paths, unit="m/s2", processing="corrected", event="Testquake", mag="6.5", dist_km="12")


def single_column(folder: Path, a: np.ndarray) -> list[Path]:
    """Acceleration alone: unit and time step are the table's to say."""

    def text(_, series):
        return "# plain\n" + "".join(f"{value * 100:.4f}\n" for value in series)

    paths = apart(folder, "STA2_{}.txt", "ENZ", a, text)
    return tabled(paths, unit="gal", dt="0.01", processing="corrected")


def _volume_1_head(channel: str, count: int, length: float, units: str) -> str:
    return (
        "UNCORRECTED ACCELEROGRAM DATA              PROCESSED: 02/08/94, TEST\n"
        "TESTQUAKE\nJANUARY 17, 1994 04:31 PST\n14403-S3492-94021.02\n"
        "STATION NO. 14403   33.929N, 118.260W     SMA-1  S/N 3492\nTEST SCHOOL\n"
        f"{channel}\nTESTQUAKE\nHYPOCENTER: 34.215N, 118.538W, H=18KM. ML=6.6, MW=6.7\n"
        "INSTR PERIOD =  .0397 SEC,  DAMPING =  .592,  SENSITIVITY = 1.77 CM/G.\n"
        f"NO. OF POINTS =  {count:5d}  RECORD LENGTH = {length:.3f} SEC\n{units}\nRMS ACCEL =  .021 G.\n"
        + rows(np.zeros(100), "5.0f", 16)
        + rows(np.zeros(50), "10.3f", 8)
    )


def csmip_v1(folder: Path, a: np.ndarray) -> list[Path]:
    text = ""
    for number, (label, series) in enumerate((("90 DEG", a[:, 0]), ("360 DEG", a[:, 1]), ("UP", a[:, 2])), 1):
        text += _volume_1_head(
            f"CHAN  {number}:  {label}",
            len(series),
            len(series) * STEP_S,
            f"UNITS OF UNCOR ACCEL IS G.                 MAX  = {peak_of(series) / G:7.3f} G, AT   1.000 SEC.",
        )
        text += f"{len(series):5d} POINTS OF ACCEL DATA EQUALLY SPACED AT .010 SEC.  (UNITS: G)\n"
        text += (
            rows(series / G, "9.6f", 8) + f"/&  ----------  END OF DATA FOR CHANNEL  {number}  ----------\n"
        )
    path = folder / "quake.RAW"
    path.write_text(text)
    return [path]


def pairs_v1(folder: Path, a: np.ndarray) -> list[Path]:
    """Pairs of time and acceleration, as CDMG, RENADIC and USC print them."""
    time = np.arange(len(a)) * STEP_S
    text = ""
    for number, (label, series) in enumerate((("L", a[:, 0]), ("V", a[:, 2]), ("T", a[:, 1])), 1):
        text += _volume_1_head(
            f"CHAN  {number}: {label}        (STA CHN:  {number})",
            len(series),
            time[-1],
            f"UNITS OF UNCOR ACCEL ARE SEC AND G/10.     MAX  = {peak_of(series) / G:7.3f} G",
        ).replace("TESTQUAKE\nHYP", "UNIVERSIDAD DE CHILE - RENADIC\nHYP")
        text += rows(np.column_stack([time, series / G * 10]).ravel(), "7.3f", 10)
        text += f"/&  ----------  END OF DATA FOR CHANNEL {number}  ----------\n"
    path = folder / "station.v1"
    path.write_text(text)
    return [path]


def bhrc(folder: Path, a: np.ndarray) -> list[Path]:
    text = ""
    for label, series in (("L1", a[:, 0]), ("V2", a[:, 2]), ("T3", a[:, 1])):
        text += (
            "* VOL1DS FILE:  5520/01\nInst Type = SSA-2\nOrigin Time : 2012/08/11   12:23:16\n\n"
            f"{label[0]}\n\nCOMP {label}\n"
            "Ahar                      Station   38.474 N 47.059 E   Altitude 1360m   Azimuth L 352   T 82\n"
            "Epicenter 38.520 N 46.860 E   (BHRC   )\nINSTR PERIOD =  .019 SEC   DAMPING =  .640\n"
            f"NO. OF POINTS =  {len(series):5d}      DURATION =  {len(series) * STEP_S:.3f}\n"
            "UNITS ARE SECONDS AND G/10\n\n"
            + rows(np.zeros(98), "5.0f", 14)
            + rows(np.zeros(35), "13.6E", 5)
            + rows(series / G * 10, "13.6E", 10)
            + "/&\n"
        )
    path = folder / "5520-1.V1"
    path.write_text(text)
    return [path]


def csmip_v2(folder: Path, a: np.ndarray) -> list[Path]:
    text = ""
    for number, (label, series) in enumerate(
        (("180 Deg", -a[:, 1]), ("90 Deg", a[:, 0]), ("Up", a[:, 2])), 1
    ):
        text += (
            f"Corrected accelerogram   89486-N2628-22354.08       Chan  {number}: {label}     from\nUncorrected\n"
            "Rcrd of Tue Dec 20, 2022\nPreliminary\n89486-N2628\nStation No. 89486   40.585N, 124.146W\n"
            f"Test - 701 S. Blvd.            CGS   Data: Acceleration\nChan  {number}: {label}\n"
            + 9
            * "x\n"
            + f"Peak acceleration = {peak_of(series) * 100:10.3f}    cm/sec/sec  at    1.000   sec.\n"
            "Peak   velocity   =     1.000      cm/sec    at    1.000   sec.\n" + 6 * "x\n"
        )
        text += rows(np.zeros(100), "5.0f", 16) + rows(np.zeros(100), "10.3f", 8)
        for kind, unit in (
            ("accel", "cm/sec2. (8f10.5)"),
            ("veloc", "cm/sec.  (8f10.6)"),
            ("displ", "cm.      (8f10.7)"),
        ):
            text += f" {len(series)} points of {kind} data equally spaced at 0.010 sec, in {unit}\n"
            text += rows(series * 100 if kind == "accel" else np.zeros(len(series)), "10.5f", 8)
        text += f"/&  ----------  End of data for channel  {number}  ----------\n"
    path = folder / "sample.v2"
    path.write_text(text)
    return [path]


def cosmos(folder: Path, a: np.ndarray, corrected: bool = True) -> list[Path]:
    text = ""
    for number, (label, series) in enumerate((("360 deg", a[:, 1]), ("Up", a[:, 2]), ("90 deg", a[:, 0])), 1):
        reals = np.full(100, -999.0)
        reals[61] = STEP_S * 1000
        unit, factor = ("cm/sec2(04)", 100.0) if corrected else ("g.     (02)", 1 / G)
        peak = f"{peak_of(series) * factor:.3f} {unit.partition('(')[0].rstrip('. ')}"
        text += (
            f"{'Corrected' if corrected else 'Uncorrected'} acceleration  (Format v01.20 with 13 text lines)\n"
            "Record of Testquake of Tue Aug 28, 2018\nHypocenter: 34.0 -118.0 H= 10km Mw=6.8\nOrigin: 2018\n"
            "Statn No: 05- 23837 Code:CE-23837  CGS  Test\nCoords: 34.063  -117.785\nRecorder: Etna\n"
            f"Rcrd start time: 8/29/2018\nSta Chan  {number}: {label} (Rcrdr Chan  {number})\nRaw\n"
            f"Processed: Max = {peak} at 1.0 sec\nRecord filtered\n"
            "Values used when parameter is unknown: -999, -999.0\n"
        )
        text += " 100 Integer-header values follow on  10 lines, Format= (10I8)\n"
        text += rows(np.where(np.arange(100) == 0, 2 if corrected else 1, -999), "8.0f", 10)
        text += " 100 Real-header values follow on  17 lines, Format= (6F13.6)\n" + rows(reals, "13.6f", 6)
        text += f'   1 Comment line(s) follow, each starting with a "|":\n|<SCNL>23837.HN{number}.CE.--\n'
        text += f"   {len(series)} acceleration pts, approx {len(series) * STEP_S:3.0f} secs, units={unit},"
        text += "Format=(8f11.6)\n"
        text += rows(series * factor, "11.6f", 8) + f"End-of-data for Chan  {number} acceleration\n"
    path = folder / ("sample.V2C" if corrected else "sample.V1C")
    path.write_text(text)
    return [path]


def smc(folder: Path, a: np.ndarray) -> list[Path]:
    def text(label, series):
        integers = np.full(48, -32768)
        integers[[12, 15, 16]] = 0 if label == "up" else 90, 2, len(series)
        integers[13] = {"up": -32768}.get(label) or int(label)
        reals = np.full(50, 1.7e38)
        reals[[1, 5, 16]] = 1 / STEP_S, 6.9, 40.0
        reals[[29, 31]] = 100 * series.max(), 100 * series.min()
        words = [_short_exponent(value) for value in 100 * series]
        return (
            "2 CORRECTED ACCELEROGRAM\n*\nA020A\n     1989  10  18    0004 Testquake, CA\n"
            "Moment Mag=      7.1\n"
            f"station = Test City  component=    {label}\n"
            "epicentral dist =     40.0\ninst type=SMA-1\n*\n*\n*\n"
            + rows(integers, "10d", 8)
            + rows(reals, "15.7E", 5)
            + "|\n|comment\n"
            + "".join("".join(words[i : i + 8]) + "\n" for i in range(0, len(words), 8))
        )

    return apart(folder, "np01_{}.smc", ("90", "360", "up"), a, text)


def _short_exponent(value: float) -> str:
    mantissa, exponent = f"{value:.4E}".split("E")
    return f"{float(mantissa):7.4f}E{max(int(exponent), -9):+d}"


def geonet(folder: Path, a: np.ndarray, corrected: bool = True) -> list[Path]:
    text = ""
    # N28W is 332 degrees from north, S62W 242
    axes = {name: np.deg2rad(90 - bearing) for name, bearing in (("N28W", 332), ("S62W", 242))}
    along = {name: a[:, 0] * np.cos(angle) + a[:, 1] * np.sin(angle) for name, angle in axes.items()}
    for name, series in (*along.items(), ("Up", a[:, 2])):
        how = (
            "Instrument corrected data at 0.010 sec intervals"
            if corrected
            else "Raw readings in units of 1.00 mm/s/s  at intervals of 0.010 s"
        )
        text += (
            f"{'Corrected' if corrected else 'Uncorrected'} accelerogram 20161113_110256_WTMC_20 GNS Science\n"
            "Site WTMC      42 37 10S  173 03 13E     Cusp file\nFarm\nInstrument\nResolution\nAccelerogram\n"
            "5 km south-west\n2016 November 13         11:02:56 UT\n"
            "Epicentre  42 41 33S 173 01 19E  Bearing S18W  Dist    9km  Depth   15km Mw 7.82\n"
            f"Number of points  {len(series)}\n{how}\nFilter\nComponent {name}\n"
            f"Acceleration:  peak   {peak_of(series) * 1000:.1f} mm/s/s at  1.00 sec\nV\nD\n"
        )
        integers = np.zeros(40)
        integers[33:36] = len(series), len(series) * corrected, 0
        text += rows(integers, "8.0f", 10) + rows(np.zeros(60), "8.2f", 10)
        text += rows(series * 1000, "8.1f", 10)
        if corrected:
            text += rows(np.zeros(len(series)), "8.2f", 10)
    path = folder / ("sample.V2A" if corrected else "sample.V1A")
    path.write_text(text)
    return [path]


def esm(folder: Path, a: np.ndarray) -> list[Path]:
    def text(letter, series):
        lines = (
            "EVENT_NAME: TEST\nEVENT_ID: EMSC-1\nMAGNITUDE_W: 6.1\nNETWORK: HI\nSTATION_CODE: ARS1\nLOCATION: \n"
            f"EPICENTRAL_DISTANCE_KM: 21.0\nSAMPLING_INTERVAL_S: {STEP_S:.6f}\nNDATA: {len(series)}\n"
            f"STREAM: HN{letter}\nUNITS: cm/s^2\nDATA_TYPE: ACCELERATION\n"
            "PROCESSING: manual (Paolucci et al., 2011)"
        ).split("\n")
        lines += [f"USER{i}:" for i in range(64 - len(lines))] + [f"{v:.6f}" for v in series * 100]
        return "\n".join(lines) + "\n"

    return apart(folder, "HI.ARS1..HN{}.D.20190728.C.ACC.ASC", "ENZ", a, text)


def unam(folder: Path, a: np.ndarray) -> list[Path]:
    count = len(a)
    keys = (
        "CLAVE DE LA ESTACION: PZPU\nORIENTACION C1-C6 (rumbo;orientacion): /V/N00E/N90E\n"
        "INTERVALO DE MUESTREO, C1-C6 (s): /0.01/0.01/0.01\nFECHA DEL SISMO [GMT]: 2017/09/19\n"
        "HORA EPICENTRO (GMT): 18:14:40\nMAGNITUD(ES): /M=7.1\n"
        f"NUM. TOTAL DE MUESTRAS, C1-C6: /{count}/{count}/{count}\nUNIDADES DE LOS DATOS: Gal (cm/s/s)"
    )
    lines = ["*" * 86, "INSTITUTO DE INGENIERIA, UNAM", "ARCHIVO ESTANDAR DE ACELERACION:"]
    lines += ["{:<39}: {}".format(*line.split(": ")) for line in keys.split("\n")]
    columns = "---------+\n   CANAL-1   CANAL-2   CANAL-3\nV N00E N90E\n---------+"
    lines += ["DATOS DE ACELERACION:", *columns.split("\n")]
    lines += ["".join(f"{v:10.4f}" for v in row) for row in a[:, [2, 1, 0]] * 100]
    path = folder / "PZPU1709.191"
    path.write_text("\n".join(lines) + "\n")
    return [path]


def cwb(folder: Path, a: np.ndarray) -> list[Path]:
    time = np.arange(len(a)) * STEP_S
    table = np.column_stack([time, a[:, 2] * 100, a[:, 1] * 100, a[:, 0] * 100])
    path = folder / "1-TST.dat"
    path.write_text(
        "#Earthquake Information\n#Origin Time(GMT+08): 2018/02/06-23:50:42\n#Magnitude(Ml): 6.0\n"
        "#StationCode: TST\n"
        f"#RecordLength(sec): {len(a) * STEP_S:.3f}\n#SampleRate(Hz): 100\n"
        "#AmplitudeUnit:  gal. DCoffset(corr)\n"
        + "".join(
            f"#AmplitudeMAX. {letter}: {series.max():8.3f}~ {series.min():8.3f}\n"
            for letter, series in zip("UNE", table.T[1:], strict=True)
        )
        + "#DataSequence: Time U(+); N(+); E(+)\n#Data: 4F10.3\n"
        + rows(table.ravel(), "10.3f", 4)
    )
    return [path]


def knet(folder: Path, a: np.ndarray) -> list[Path]:
    def text(letters, series):
        header = (
            "Origin Time=2018/01/24 19:51:00\nLat.=41.0\nLong.=142.5\nDepth. (km)=30\nMag.=6.2\n"
            "Station Code=AOM007\nStation Lat.=41.1690\nStation Long.=141.3846\nStation Height(m)=17\n"
            "Record Time=2018/01/24 19:51:36\nSampling Freq(Hz)=100Hz\n"
            f"Duration Time(s)={len(series) * STEP_S:g}\nDir.={'-'.join(letters)}\n"
            f"Scale Factor=2000(gal)/8388608\nMax. Acc. (gal)={np.abs(series).max() * 100:.3f}\n"
            "Last Correction=2018/01/24 19:51:36\nMemo.="
        )
        lines = ["{:<18}{}\n".format(*line.split("=")) for line in header.split("\n")]
        return "".join(lines) + rows(np.round(series * 100 / (2000 / 8388608)).astype(int), "9d", 8)

    return apart(folder, "AOM0071801241951.{}", ("EW", "NS", "UD"), a, text)


def sensitivity(unit: str = "M/S**2", gain: float = 2e5) -> Response:
    return Response(instrument_sensitivity=InstrumentSensitivity(gain, 1.0, unit, "COUNTS"))


COUNTS = sensitivity()


def write_counts(folder: Path, channels: dict, response: Response | None, station: str = "TST") -> list[Path]:
    """MiniSEED of counts and azimuth and dip of each channel, by their code, and the StationXML of their response."""
    paths, result = [], []
    for code, (counts, azimuth, dip) in channels.items():
        header = {"network": "XX", "station": station, "channel": code, "delta": STEP_S}
        trace = obspy.Trace(np.round(counts).astype(np.int32), header)
        trace.stats.starttime = obspy.UTCDateTime(2020, 1, 1)
        paths.append(folder / f"XX.{station}..{code}.mseed")
        trace.write(str(paths[-1]), format="MSEED")
        result.append(Channel(code, "", 0, 0, 0, 0, azimuth=azimuth, dip=dip, response=response))
    if response:
        paths.append(folder / f"XX.{station}.xml")
        network = Network("XX", [Station(station, 0, 0, 0, site=Site("test"), channels=result)])
        Inventory([network], source="test").write(str(paths[-1]), format="STATIONXML")
    return paths


def miniseed(folder: Path, a: np.ndarray, response: Response | None = COUNTS) -> list[Path]:
    """Counts at 200,000 to 1 m/s2, and the StationXML that says so."""
    east, north, up = 2e5 * a.T
    return write_counts(folder, {"HNE": (east, 90, 0), "HNN": (north, 0, 0), "HNZ": (up, 0, -90)}, response)


def sac(folder: Path, a: np.ndarray) -> list[Path]:
    paths = []
    for letter, series, azimuth, inclination in zip("ENZ", a.T, (90, 0, 0), (90, 90, 0), strict=True):
        header = {"network": "XX", "station": "TST", "channel": f"HN{letter}", "delta": STEP_S}
        trace = obspy.Trace(series.astype(np.float32), header)
        trace.stats.sac = {"cmpaz": azimuth, "cmpinc": inclination, "idep": 8}
        path = folder / f"XX.TST.HN{letter}.sac"
        trace.write(str(path), format="SAC")
        paths.append(path)
    return tabled(paths, unit="m/s2")


WRITERS = {
    "peer": peer, "columns": columns, "single_column": single_column, "csmip_v1": csmip_v1, "pairs_v1": pairs_v1,
    "bhrc": bhrc, "csmip_v2": csmip_v2, "cosmos_v2": cosmos,
    "cosmos_v1": lambda folder, a: cosmos(folder, a, corrected=False), "smc": smc, "geonet_v2a": geonet,
    "geonet_v1a": lambda folder, a: geonet(folder, a, corrected=False), "esm": esm, "unam": unam, "cwb": cwb,
    "knet": knet, "miniseed": miniseed, "sac": sac,
}  # fmt: skip
