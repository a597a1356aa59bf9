"""Hazard options common to several commands: help texts, sites by coordinates or name, kinds of values."""

import math
import re
from collections.abc import Sequence

import click

from toppling.models.bearings import degrees_of
from toppling.models.files.csv_text import is_numeral
from toppling.orchestrator.verbs.shared_options import option
from toppling.results.hazard.places import SITE_REACH_KM

SITE_HELP = (
    f"Degrees, or a site's name: takes the nearest site of the hazard, within {SITE_REACH_KM:g} km; "
    "repeatable for a set of events, one for each rock."
)


class SiteCommand(click.Command):
    """Command whose --site accepts longitude and latitude, or a name where the command supports it."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Convert coordinates to numbers, and a name to the hidden option --site-name."""
        takes_name = any("--site-name" in parameter.opts for parameter in self.params)
        named: list[str] = []
        words = list(args)
        while words:
            word = words.pop(0)
            place = _place(words) if word == "--site" else None
            if place is not None:
                used, degrees = place
                named += [word, *degrees]
                del words[:used]
            else:
                is_name = takes_name and word == "--site" and words and not is_numeral(words[0])
                named.append("--site-name" if is_name else word)
        return super().parse_args(ctx, named)


def _place(words: Sequence[str]) -> tuple[int, list[str]] | None:
    """Number of words of a location, and its longitude and latitude; None for a name or incomplete coordinates.

    The latitude may come first if compass letters identify it.
    """
    splits = [(2, list(words[:2])), (1, re.split(r"[,;]\s*|\s+", words[0].strip()) if words else [])]
    for used, parts in splits:
        if len(parts) == 2:
            first, second = (part.rstrip(",;") for part in parts)
            for east, north in ((first, second), (second, first)):
                degrees = degrees_of(east, "longitude"), degrees_of(north, "latitude")
                if None not in degrees:
                    return used, [repr(angle) for angle in degrees]
    return None


def _years_of(_context: click.Context, _parameter: click.Parameter, values: str | None) -> float | None:
    """Years of --values, 0 for rates, None if not given; UsageError if neither 'rate' nor a positive number."""
    if values is None:
        return None
    if values.lower() in ("rate", "rates"):
        return 0.0
    years = float(values) if is_numeral(values) else math.nan
    if not 0 < years < math.inf:
        raise click.UsageError(
            f"--values is {values!r}: give 'rate', or the years that probabilities are over"
        )
    return years


values_option = option(
    "--values", "years", metavar="rate|YEARS", callback=_years_of,
    help="What the hazard's values are, where its files do not say: annual rates (rate), or probabilities over so many "
    "years.",
)  # fmt: skip
