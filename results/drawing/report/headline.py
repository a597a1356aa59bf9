"""The first screen: three sentences and one picture with the result."""

import pandas as pd
from matplotlib.figure import Figure

from toppling.models.spelling import counted
from toppling.results.analysis.bases import narrowed_by
from toppling.results.analysis.fits import FEW_TOPPLED
from toppling.results.analysis.ranking import observed_shares
from toppling.results.drawing.constraint_words import ages_words
from toppling.results.drawing.fit_figures import draw_curve, draw_shares
from toppling.results.drawing.report.content import CONFIDENCE, Contact, Content
from toppling.results.drawing.report.document import Document, heading, paragraph, safe
from toppling.results.drawing.sentences import percent, what_topples
from toppling.results.drawing.style import (
    ALARM_COLOUR,
    HALF_WIDTH_IN,
    MAIN_COLOUR,
    measure_label,
    printed_unit,
    short_name,
    style,
)

_NAMED_CURVES = 5
"""Rejected hazard curves that the first screen names; a table lists all."""


def first_screen(content: Content, document: Document) -> str:
    """Name of the rock, three sentences, one picture."""
    said = *answer(content), _how_likely(content), _what_standing_says(content)
    sentences = "".join(map(paragraph, said))
    if unfinished := _unfinished_sentence(content):
        sentences = f'<p class="alarm">{safe(unfinished)}</p>{sentences}'
    picture = document.figure(
        lambda width: _headline_figure(content, width), _caption(content), HALF_WIDTH_IN
    )
    return f'{heading(content.run.rock, 1)}<div class="first"><div>{sentences}</div>{picture}</div>'


def answer(content: Content) -> list[str]:
    """What topples the rock, and what would narrow the interval, a sentence each."""
    return list(filter(None, (_what_topples(content), _what_narrows(content))))


def _unfinished_sentence(content: Content) -> str:
    remark = content.completeness.remark
    return f"This run is unfinished: {remark}. All numbers below rest on those that have." if remark else ""


def _what_topples(content: Content) -> str:
    contact = content.chief
    if contact.headline is None:
        return (
            f"The rock toppled in {contact.toppled} of {len(contact.known):,} shakings with an answer "
            f"({contact.words}): " + _no_curve(contact)
        )
    return what_topples(contact.headline, contact.words, content.on_one_base)


def _what_narrows(content: Content) -> str:
    curve = content.chief.headline
    return (
        narrowed_by(curve.interval_parts, content.run.scene_report())
        if curve and not curve.is_beyond_shaken
        else ""
    )


def _no_curve(contact: Contact) -> str:
    if contact.toppled < FEW_TOPPLED:
        return f"fewer than {FEW_TOPPLED} topplings are too few for a curve."
    problems = [one.problem for one in contact.models if one.problem]
    return f"no curve can be fitted ({problems[0]})." if problems else "no curve can be fitted."


def _how_likely(content: Content) -> str:
    contact = content.chief
    known = contact.known
    weight = known.get("base_weight", pd.Series(1.0, known.index))
    levels = known["level_pga_m_s2"]
    share = (weight * known["toppled"]).groupby(levels).sum() / weight.groupby(levels).sum()
    weighted = ", with weighted bases" if "base_weight" in known else ""
    shares = [f"{percent(share.iloc[k])} at {share.index[k]:g} m/s²" for k in _ends_and_middle(share)]
    return (
        f"Of {len(known):,} shakings ({counted(known['record_id'].nunique(), 'record')}, scaled to a PGA of "
        f"{share.index[0]:g} to {share.index[-1]:g} m/s², {known['azimuth_deg'].nunique()} azimuths) "
        f"{contact.toppled:,} topple it, {percent(contact.toppled / len(known))}{weighted}: {', '.join(shares)}."
    )


def _what_standing_says(content: Content) -> str:
    event = content.statement
    if event is None:
        return "With so few topplings, its survival says nothing about past shaking."
    measure = event["measure"]
    said = (
        f"Since it still stands, no single shaking like these has exceeded a {short_name(measure)} of "
        f"{event['unexceeded']:.2g} {printed_unit(measure)} since it acquired its present shape "
        f"({100 * CONFIDENCE:g} % confidence{'; ' if content.extrapolated else ''}{content.extrapolated})"
    )
    if "branches" not in event or content.standing is None:
        return said + "."
    rejected = [branch["name"] for branch in event["branches"] if branch["rejected"]]
    few = rejected[:_NAMED_CURVES]
    named = f" ({', '.join(few)}{', ...' if rejected[len(few) :] else ''})" if rejected else ""
    return (
        f"{said}; {ages_words([content.standing])}, it rejects {len(rejected) or 'none'} of {len(event['branches'])} "
        f"hazard curves{named}."
    )


def _caption(content: Content) -> str:
    contact, rock = content.chief, f"the rock {content.run.rock}"
    if contact.headline is None:
        return f"Share of shakings that topple {rock} at each level of PGA ({contact.words}); bars: 95 %, by record."
    name = short_name(contact.headline.measure)
    return (
        f"Toppling probability of {rock} over {name} ({contact.words}). Dots: share of shakings that topple it, with "
        "95 % intervals by record; curve: lognormal fit, with its 95 % band; dashed: one case in two; hatched: what "
        "the standing rock rejects for a single event."
    )


def _headline_figure(content: Content, width_in: float = HALF_WIDTH_IN) -> Figure:
    """Fragility curve with what the standing rock rejects, or shares by level where there is no curve."""
    contact = content.chief
    with style():
        figure = Figure(figsize=(width_in, 3.0))
        axes = figure.subplots(gridspec_kw={"left": 0.14, "right": 0.96, "bottom": 0.15, "top": 0.9})
        if contact.headline is None:
            observed = observed_shares(contact.known, "level_pga_m_s2")
            draw_shares(axes, observed, "value", "probability", fmt="o", ms=3, lw=0.8, color=MAIN_COLOUR)
            axes.set(xlabel=measure_label("level_pga_m_s2"), ylabel="share toppled", ylim=(0, 1))
            axes.set_title(f"{contact.toppled} of {len(contact.known):,} shakings topple it")
            return figure
        curve = contact.headline
        observed = observed_shares(contact.known, curve.measure)
        draw_curve(axes, curve, observed)
        right = axes.get_xlim()[1]
        if curve.median < right:
            left = axes.get_xlim()[0]
            axes.plot([curve.median, curve.median, left], [0, 0.5, 0.5], "--", color="0.3", lw=0.8)
        event = content.statement
        if event is not None and event["measure"] == curve.measure:
            limit, end = event["unexceeded"], axes.get_xlim()[1]
            end = max(end, 1.3 * limit)
            axes.set_xlim(right=end)
            axes.axvspan(limit, end, facecolor="none", edgecolor=ALARM_COLOUR, hatch="////", alpha=0.35, lw=0)
            axes.axvline(limit, color=ALARM_COLOUR, lw=1.0)
            axes.annotate(
                f"not exceeded\n({100 * CONFIDENCE:g} %)", (limit, 0.22), xytext=(-4, 0), textcoords="offset points",
                ha="right", color=ALARM_COLOUR, size=7, bbox={"facecolor": "white", "alpha": 0.85, "lw": 0, "pad": 0.8},
            )  # fmt: skip
        at = f"beyond {curve.strongest_shaken:.3g}" if curve.is_beyond_shaken else f"at {curve.median:.2g}"
        axes.set_title(f"one in two topples {at} {printed_unit(curve.measure)}")
    return figure


def _ends_and_middle(share: pd.Series) -> list[int]:
    """Places of the least level, of that whose share is nearest one half, and of the largest."""
    middle = int((share - 0.5).abs().to_numpy().argmin())
    return sorted({0, middle, len(share) - 1})
