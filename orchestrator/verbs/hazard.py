"""Hazard on the command line: help that verbs share, a site by place or name, values that are rates or not."""

import math

import click

from toppling.models.files.csv_text import is_numeral
from toppling.results.hazard.sites import SITE_REACH_KM

HAZARD_HELP = (
    "Hazard: a file or folder of OpenQuake (curves, or a tree with realizations.csv), nshmp-haz or CyberShake, or two "
    "columns; repeatable, each a branch with its WEIGHT, and equal weights without. Or one set of events: OpenQuake's "
    "ground-motion fields with the files beside them, CyberShake's intensity measures, a table."
)
SITE_HELP = (
    f"Degrees, or a site's name: takes the nearest site of the hazard, within {SITE_REACH_KM:g} km; "
    "repeatable for a set of events, one for each rock."
)


class SiteCommand(click.Command):
    """A command whose --site takes longitude and latitude, or one name."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Hand a name on as --site-name, which the help does not show."""
        named = list(args)
        for index, word in enumerate(args[:-1]):
            if word == "--site" and not is_numeral(args[index + 1]):
                named[index] = "--site-name"
        return super().parse_args(ctx, named)


def years_of(values: str | None) -> float | None:
    """Years of --values, 0 for rates; None where it is not given.

    Raises click.UsageError if it is neither 'rate' nor a positive number.
    """
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
