"""The first page: the answer, its picture with the parts of its interval, and what would change it."""

from collections.abc import Iterator
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from toppling.models.errors import counted
from toppling.results.analysis import CONFIDENCE
from toppling.results.analysis.audit_statistics import audits_of
from toppling.results.analysis.fits import observed_fractions
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.analysis.resampling import narrowed_by
from toppling.results.analysis.unphysical import unphysical_of
from toppling.results.drawing import sentences
from toppling.results.drawing.report.content import Contact, Content
from toppling.results.drawing.run_figures import draw_curve, draw_fractions
from toppling.results.drawing.sentences import other_records, percent, what_topples
from toppling.results.drawing.side_by_side_figures import thumbnail
from toppling.results.drawing.style import (
    ALARM_COLOUR,
    MAIN_COLOUR,
    digits,
    measure_label,
    png_bytes,
    printed_unit,
    short_name,
    style,
    within,
)
from toppling.results.drawing.templates import Document, block
from toppling.results.run_integrity import LEAST_JOBS


def first_screen(content: Content, document: Document) -> dict[str, Any]:
    """Name of the rock, what topples it, the curve and the interval's parts, and what would change the answer."""
    lines = [_what_topples(content), _how_likely(content), _constraint_sentence(content)]
    picture = png_bytes(thumbnail(content.scene, None)) if content.scene else b""
    remark = document.remark
    return {
        "rock": content.run.rock,
        "unfinished": remark and f"This run is unfinished: {remark}. All numbers rest on those that have.",
        "answers": [*lines, *sentences.answer(content.statement or {})],
        "view": picture and block("picture", png=picture, words=f"the rock {content.run.rock}"),
        "figure": document.figure(lambda width: _headline_figure(content, width), _caption(content)),
        "changes": list(_what_would_change(content)),
    }


def answer(content: Content) -> list[str]:
    """Sentences that state the headline's result, and the largest part of its interval."""
    return list(filter(None, (_what_topples(content), _what_narrows(content))))


def _what_topples(content: Content) -> str:
    contact, count = content.chief, content.frame["friction_static"].nunique()
    words = contact.words + (f", the highest of {count} frictions" if count > 1 else "")
    if contact.headline is None:
        return (
            f"The rock toppled in {contact.toppled} of {len(contact.known):,} shakings with an answer "
            f"({words}): " + _no_curve(contact)
        )
    return what_topples(contact.headline, words, content.on_single_base)


def _what_narrows(content: Content) -> str:
    curve = content.chief.headline
    return (
        narrowed_by(curve.interval_parts, content.run.scene_report())
        if curve and not curve.is_beyond_shaken
        else ""
    )


def _what_would_change(content: Content) -> Iterator[str]:
    """Sentences on limits of the headline: interval, other frictions, unphysical shaking, unanswered jobs, audits."""
    if narrows := _what_narrows(content):
        yield narrows
    for other in content.contacts:
        if other.words != content.chief.words:
            curve, single = other.headline, content.run.on_single_base(other.jobs)
            yield (
                what_topples(curve, other.words, single)
                if curve
                else f"With {other.words}: {_no_curve(other)}"
            )
    if (beyond := unphysical_of(content.run, content.frame)) is not None:
        yield f"{beyond.sentence}."
    if content.years is None:
        yield "An age (--age 15000..30000): with one the report rejects rates of exceedance, and tests a --hazard."
    audits = audits_of(content.run).values()
    yield from (f"{audit.sentence}." for audit in audits)
    if not audits:
        yield (
            f"This run has no audit of {LEAST_JOBS} jobs: 'toppling audit RUN' repeats a sample with finer steps and "
            "states how far its answers may be off."
        )


def _no_curve(contact: Contact) -> str:
    problems = [model.problem for model in contact.models if model.problem]
    return f"no curve can be fitted ({problems[0]})." if problems else "no curve can be fitted."


def _how_likely(content: Content) -> str:
    known = content.chief.known
    levels, lost = known["level_pga_m_s2"], int(content.frame["toppled"].isna().sum())
    without = (
        f"; {counted(lost, 'job')} without an answer {'is' if lost == 1 else 'are'} left out" if lost else ""
    )
    return (
        f"Of {len(known):,} shakings ({counted(known['record_id'].nunique(), 'record')}, scaled to a PGA of "
        f"{levels.min():g} to {levels.max():g} m/s², {known['azimuth_deg'].nunique()} azimuths) "
        f"{content.chief.toppled:,} topple it, {percent(content.chief.toppled / len(known))}{without}."
    )


def _constraint_sentence(content: Content) -> str:
    event = content.statement
    if event is None:
        return "With so few topplings, its survival says nothing about past shaking."
    measure, ends = event["measure"], (event["unexceeded_low"], event["unexceeded_high"])
    interval = (
        "" if None in ends else f"; {digits(ends[0])} to {digits(ends[1])} with {other_records(event)}, 95 %"
    )
    return (
        f"Since it still stands, no single shaking like these has exceeded a {short_name(measure)} of "
        f"{digits(event['unexceeded'])} {printed_unit(measure)} since it acquired its present shape "
        f"({100 * CONFIDENCE:g} % confidence{interval}{'; ' if content.extrapolated else ''}{content.extrapolated})."
    )


def _caption(content: Content) -> str:
    contact, rock = content.chief, f"the rock {content.run.rock}"
    if contact.headline is None:
        return f"Share of shakings that topple {rock} at each level of PGA ({contact.words}); bars: 95 % intervals."
    name = short_name(contact.headline.measure)
    return (
        f"Toppling probability of {rock} over {name} ({contact.words}). Dots: share of shakings that topple it, with "
        "95 % intervals by earthquake; curve: lognormal fit, with its 95 % band; dashed: one case in two; hatched: "
        "what the standing rock rejects for a single event."
    )


def _headline_figure(content: Content, width_in: float) -> Figure:
    """The curve, or shares by level where there is no curve."""
    contact = content.chief
    with style():
        figure = Figure(figsize=(width_in, 3.0), layout="constrained")
        axes = figure.subplots()
        if contact.headline is not None:
            _draw_headline(axes, content, contact.headline)
            return figure
        observed = observed_fractions(contact.known, "level_pga_m_s2")
        draw_fractions(axes, observed, "value", "probability", fmt="o", ms=3, lw=0.8, color=MAIN_COLOUR)
        axes.set(xlabel=measure_label("level_pga_m_s2"), ylabel="share toppled", ylim=(0, 1))
        axes.set_title(f"{contact.toppled} of {len(contact.known):,} shakings topple it")
    return figure


def _draw_headline(axes: Axes, content: Content, curve: Lognormal) -> None:
    """Fragility curve with what the standing rock rejects."""
    draw_curve(axes, curve, observed_fractions(content.chief.known, curve.measure))
    left, right = axes.get_xlim()
    if curve.median < right:
        axes.plot([curve.median, curve.median, left], [0, 0.5, 0.5], "--", color="0.3", lw=0.8)
    event = content.statement
    if event is not None and event["measure"] == curve.measure:
        limit = event["unexceeded"]
        end = max(right, 1.3 * limit)
        axes.set_xlim(right=end)
        axes.axvspan(limit, end, facecolor="none", edgecolor=ALARM_COLOUR, hatch="////", alpha=0.35, lw=0)
        axes.axvline(limit, color=ALARM_COLOUR, lw=1.0)
        axes.annotate(
            f"not exceeded\n({100 * CONFIDENCE:g} %)", (limit, 0.03), xytext=(-4, 0), textcoords="offset points",
            ha="right", color=ALARM_COLOUR, size=7, bbox={"facecolor": "white", "alpha": 0.85, "lw": 0, "pad": 0.8},
        )  # fmt: skip
    at = "" if curve.is_beyond_shaken else "at "
    median = within(curve.median, *curve.shaken)
    axes.set_title(f"one in two topples {at}{median} {printed_unit(curve.measure)}")
