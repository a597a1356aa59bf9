"""Sentences that summarise a fragility at the beginning of pages and commands' output."""

from toppling.results.analysis.lognormal import Lognormal, parts_words
from toppling.results.drawing.style import printed_unit, short_name


def what_topples(curve: Lognormal, contact: str, single_base: bool) -> str:
    """Sentence on the median intensity of a fragility, with its interval by cause.

    contact: words for the contact.
    single_base: whether all jobs are on the same one of the possible bases.
    """
    unit, name, strongest = printed_unit(curve.measure), short_name(curve.measure), curve.strongest_shaken
    rested = contact + (", for one of the bases that the scan allows" if single_base else "")
    if strongest is not None and curve.is_beyond_shaken:
        share = float(curve.probability(strongest))
        return (
            "The shaking that topples the rock in one case in two lies beyond what was run: the strongest had a "
            f"{name} of {strongest:.3g} {unit}, where {percent(share)} topple ({rested})."
        )
    return (
        f"Shaking with a {name} of {curve.median:.2g} {unit}{interval_words(curve)} topples the rock in one case in "
        f"two, and with {curve.intensity(0.05):.2g} {unit} in one in twenty ({rested})."
    )


def interval_words(curve: Lognormal) -> str:
    """The median's 95 % interval with its parts, in brackets after a space; empty where unknown."""
    if curve.median_interval is None:
        return ""
    (low, high), strongest = curve.median_interval, curve.strongest_shaken
    end = f"beyond {strongest:.2g}" if strongest is not None and high > strongest else f"{high:.2g}"
    parts = parts_words(curve.interval_parts)
    return f" (95 %: {low:.2g} to {end}{'; ' if parts else ''}{parts})"


def percent(share: float) -> str:
    """Format a fraction toppled as percentage, or as none or all."""
    return "none" if share == 0 else "all" if share == 1 else f"{100 * share:.0f} %"
