"""The page of an atlas: a card a rock, fragilities beside each other, where the rocks stand, what they share."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pandas as pd

from toppling.models.files.documents import listed
from toppling.models.scene import Scene
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.analysis.resampling import narrowed_by
from toppling.results.analysis.side_by_side import CommonJobs, RockResults
from toppling.results.drawing.roses import wind_of
from toppling.results.drawing.sentences import interval_words
from toppling.results.drawing.side_by_side_figures import fragilities_figure, thumbnail
from toppling.results.drawing.style import digits, png_bytes, printed_unit, short_name, within
from toppling.results.drawing.templates import Block, Document, block, rendered
from toppling.results.reader import Run

REPORT = "report.html"
_COLUMNS = {
    "rock": "rock",
    "site": "site",
    "median": "half topple at",
    "median_low": "from",
    "median_high": "to",
    "beta": "beta",
    "least_quasi_static_m_s2": "least constant (m/s²)",
    "falls_toward_deg": "falls toward (azimuth, °)",
    "falls_toward_bearing_deg": "(bearing, °)",
    "records": "records",
    "jobs": "jobs",
    "toppled": "toppled",
    "remark": "remark",
}


def gallery_page(
    title: str,
    atlases: Sequence[Run],
    rocks: Sequence[RockResults],
    common: CommonJobs,
    measure: str,
    folder: Path,
    advance: Callable[[], object] = lambda: None,
) -> str:
    """HTML of the page, with its pictures inside.

    atlases: that the rocks are of.
    measure: that all fragilities are over.
    folder: of the page, from which reports are linked.
    advance: called after each rock's picture.
    """
    unfinished = [f"{run.name}: {run.completeness().remark}" for run in atlases if run.completeness().remark]
    document = Document("; ".join(unfinished))
    cards = []
    for rock in rocks:
        cards.append(_card(rock, folder))
        advance()
    first: list[Block] = [*summary(rocks, common, measure)]
    caption = (
        f"Left: toppling probability over {short_name(measure)}, a lognormal curve for each rock with its 95 % band. "
        "Right: the intensity at which half of the shakings topple each, with its 95 % interval over records and bases."
    )
    first.append(document.figure(lambda width: fragilities_figure(rocks, measure, width), caption))
    frame = pd.DataFrame([_stated(rock) for rock in rocks])[list(_COLUMNS)].rename(columns=_COLUMNS)
    numbers = (
        f"Fragility of each rock over {short_name(measure)} (in {printed_unit(measure)}, with 95 % intervals), and the "
        "least constant acceleration that topples it."
    )
    table = document.table(frame.dropna(axis="columns", how="all"), numbers)
    return rendered("atlas.html", title=f"toppling: {title}", heading=title, unfinished=unfinished, first=first,
        sections=[("Table", [table])], cards=cards)  # fmt: skip


def _stated(rock: RockResults) -> dict[str, Any]:
    """Row of a rock, with intensities that no job had stated as such, as in sentences."""
    row, curve = rock.row, rock.curve
    ends = {name: row[name] for name in ("median", "median_low", "median_high") if row[name] is not None}
    return row | ({name: within(value, *curve.shaken) for name, value in ends.items()} if curve else {})


def summary(rocks: Sequence[RockResults], common: CommonJobs, measure: str) -> list[str]:
    """Results of an atlas in a few sentences."""
    drawn = sorted(((rock.curve, rock) for rock in rocks if rock.curve), key=lambda both: both[0].median)
    several, have = "s" if len(rocks) != 1 else "", "has" if len(drawn) == 1 else "have"
    found = [f"Of {len(rocks)} rock{several} {len(drawn)} {have} a fragility over {short_name(measure)}."]
    if drawn:
        (least, weakest), (most, firmest) = drawn[0], drawn[-1]
        first, last = (", the weakest,", ", the firmest,") if len(drawn) > 1 else ("", "")
        found[0] += f" Half of the shakings topple {weakest.name}{first} {_at(weakest, least)}"
        found[0] += f", and {firmest.name}{last} {_at(firmest, most)}." if last else "."
    remedies: dict[str, list[str]] = {}
    for curve, rock in drawn:
        remedies.setdefault(narrowed_by(curve.interval_parts, rock.run.scene_report()), []).append(rock.name)
    found += [f"{listed(names)}: {text[0].lower()}{text[1:]}" for text, names in remedies.items() if text]
    if several:
        found.append(common.sentence)
    if bare := [f"{rock.name} ({rock.why_not})" for rock in rocks if rock.curve is None]:
        found.append(f"Without a fragility: {'; '.join(bare)}.")
    left_out = {
        entry["rock"]: entry["why"] for rock in rocks for entry in rock.run.provenance().get("left_out") or ()
    }
    if left_out:
        found.append(f"Left out: {'; '.join(f'{name}: {why}' for name, why in left_out.items())}.")
    return found


def _at(rock: RockResults, curve: Lognormal) -> str:
    """Intensity at which half of the shakings topple a rock, with its interval."""
    median = within(curve.median, *curve.shaken)
    at = f"{'' if curve.is_beyond_shaken else 'at '}{median} {printed_unit(curve.measure)}"
    return at + interval_words(curve.numbers, *curve.shaken) + (rock.single_base and f" {rock.single_base}")


def _card(rock: RockResults, folder: Path) -> dict[str, Any]:
    row = rock.row
    median = rock.why_not if rock.curve is None else f"half topple {_at(rock, rock.curve)}"
    weakest = "topples statically toward no azimuth"
    if rock.least is not None:
        weakest = (
            f"falls most easily toward {wind_of(row['falls_toward_deg'])} (arrow; bearing "
            f"{row['falls_toward_bearing_deg']:.0f}°), at {digits(rock.least['value'])} m/s² of constant acceleration"
        )
        low, high, level = rock.least[["low_m_s2", "high_m_s2", "level"]]
        if level == level:
            weakest += f" ({100 * level:.0f} % of its bases: {digits(low)} to {digits(high)})"
    place = row["site"] if row["site"] not in (None, rock.name) else ""
    report = rock.run.path / REPORT
    lines = [
        place,
        median,
        weakest,
        f"{row['toppled']} of {row['jobs']} jobs topple it ({row['records']} records)",
        rock.contact,
        row["remark"] or "",
    ]
    picture = None
    if (rock.run.scene_folder / "scene.json").exists():
        drawn = thumbnail(Scene.load(rock.run.scene_folder), rock.weakest_azimuth_deg)
        picture = block("picture", png=png_bytes(drawn), words=f"the rock {rock.name}")
    return {
        "name": rock.name, "picture": picture, "lines": list(filter(None, lines)),
        "report": quote(os.path.relpath(report, folder)) if report.exists() else "",
    }  # fmt: skip
