"""CyberShake's hazard curves, as OpenSHA's plotter writes them: `level<TAB>probability` in g and in one year.

Site, run, period and component stand in the file's name only: USC_ERF36_Run9306_SA_3sec_RotD50_2022_12_21.txt.
"""

import re
from collections.abc import Sequence

from toppling.models.files.table import Table
from toppling.results.hazard.measure_names import imt_of, measure_of
from toppling.results.hazard.readers.assembly import HazardFile, Statement

_NAME = re.compile(
    r"(?P<site>.+?)_ERF\d+_Run(?P<run>\d+)_(?P<imt>SA_(?P<period>\d+(?:[.p]\d+)?)sec|PGA|PGV)"
    r"(?:_(?P<component>[A-Za-z]+\d*))?"
)


def matches(file: HazardFile) -> bool:
    """Whether a file begins as the plotter writes it."""
    return file.lines[0].replace(" ", "").startswith("#Curves:")


def read(file: HazardFile) -> list[Statement]:
    """Read the first curve of a file that CyberShake computed; others are comparisons.

    Raises InputError if neither the file's name nor the user says what it is over.
    """
    named = _NAME.match(file.path.name)
    imt = named["imt"] if named else imt_of(file.measure_elsewhere)[0] if file.measure_elsewhere else ""
    if named and named["period"]:
        imt = f"SA({named['period'].replace('p', '.')})"
    known = measure_of(imt)
    if known is None or (not named and known[0] == "pgv_m_s"):
        file.refuse("hazard.measure_missing",
            "states its measure in its name only, which is not as CyberShake gave it",
            "name it as it was, SITE_ERF36_RunN_SA_3sec_RotD50_DATE.txt, or give --measure")  # fmt: skip
    rows = _first_curve(file, file.lines)
    measure, unit = known
    curve = file.curve(
        measure, [x * unit for x, _ in rows], [p for _, p in rows], file.hints.years or 1.0,
        site_name=named["site"] if named else "", component=(named["component"] or "") if named else "",
    )  # fmt: skip
    return [Statement(curve, calculation=named["run"] if named else "")]


def _first_curve(file: HazardFile, lines: Sequence[str]) -> list[tuple[float, float]]:
    """Points below the first name that contains CyberShake, or below the first name."""
    heads = [index for index, line in enumerate(lines) if line.replace(" ", "").startswith("#Name:")]
    own = [index for index in heads if re.search(r"CS Run|CyberShake", lines[index])]
    start = (own or heads or [0])[0]
    stop = next((index for index in heads if index > start), len(lines))
    rows = Table.of([*[""] * (start + 1), *lines[start + 1 : stop]], file.path).rows
    if other := next((at for at, row in rows if len(row) != 2), None):
        file.refuse("hazard.row_unreadable", f"line {other + 1} is no level and probability")
    if not rows:
        file.refuse("hazard.no_curve", "holds no curve")
    return [(file.number(at + 1, level), file.number(at + 1, value)) for at, (level, value) in rows]
