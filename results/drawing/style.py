"""Common style of all figures: sizes, colours, axis labels, and atomic writing of files."""

import io
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
import seaborn as sns
from matplotlib.axis import XAxis, YAxis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from matplotlib.transforms import Bbox

from toppling.models.files.folder import new_file
from toppling.results.hazard.measure_names import is_spectral, period_s
from toppling.results.schema import SCHEMA, SHORT_NAMES, describe

FULL_WIDTH_IN = 7.0
"""Width of a printed page, inches (178 mm)."""

HALF_WIDTH_IN = 3.6
"""Width of a printed column, inches, and of a screen of 400 pixels, where letters are then 12 pixels high."""

COLOURS = sns.color_palette("viridis", as_cmap=True)
"""Perceptually uniform colour map, legible in grey and with all kinds of colour vision."""

THIN_ALPHA = 0.45
"""Opacity of a cell of few records: pale, but its colour is recognised."""

MAIN_COLOUR = COLOURS(0.35)
ROCK_COLOUR, PEDESTAL_COLOUR = "#d9a066", "#7d8b99"
CONTACT_COLOUR, CLIFF_COLOUR = "#0057b7", "#1a1a1a"
ALARM_COLOUR = "#b3261e"
"""Colour of the point of no return; its lines are also dashed, so that colour alone carries no information."""

LINE_IN = 0.15
"""Height of a line of text above or below a figure, inches."""

LETTERS_PER_IN = 15.0
"""Number of characters per inch of such a line."""

_STYLE = {
    "savefig.dpi": 200,
    "svg.fonttype": "none",  # text stays text, to be searched and edited
    "svg.hashsalt": "toppling",  # the same table gives the same file
    "axes.linewidth": 0.6,
    "font.size": 8,
    "axes.labelsize": 8,
    "axes.titlesize": 8,
    "figure.titlesize": 8.5,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "legend.fontsize": 7,
}


@contextmanager
def style() -> Iterator[None]:
    """Context with Seaborn's ticks in sizes for print, independent of a user's `matplotlibrc`."""
    with mpl.rc_context():
        mpl.rcdefaults()
        settings: dict = {**sns.axes_style("ticks"), **sns.plotting_context("paper"), **_STYLE}
        mpl.rcParams.update(settings)
        yield


def save(figure: Figure, stem: Path, remark: str = "") -> list[Path]:
    """Write a figure as PNG and SVG, each atomically.

    remark: text above the figure, such as that of an unfinished run (`results.completeness`).
    """
    written = []
    with style():
        box = _headed(figure, remark)
        for suffix, metadata in ((".png", {"Software": None}), (".svg", {"Date": None})):
            target = stem.with_name(stem.name + suffix)
            with new_file(target) as hidden:
                figure.savefig(hidden, format=suffix[1:], metadata=metadata, bbox_inches=box)
            figure.set_layout_engine("none")  # the layout is fixed after the first format, which saves time
            written.append(target)
    return written


def png_bytes(figure: Figure, remark: str = "") -> bytes:
    """Content of a PNG file of a figure, with an optional remark above it."""
    drawn = io.BytesIO()
    with style():
        box = _headed(figure, remark)
        figure.savefig(drawn, format="png", metadata={"Software": None}, bbox_inches=box)
    return drawn.getvalue()


def _headed(figure: Figure, remark: str) -> Bbox | None:
    """Write a remark above a figure; returns the box to save, which includes the remark."""
    if not remark:
        return None
    width, height = figure.get_size_inches()
    lines = textwrap.wrap(f"Unfinished run: {remark}", int(LETTERS_PER_IN * width))
    strip = LINE_IN * (len(lines) + 0.5)
    figure.text(
        0.5, 1.0 + 0.25 * LINE_IN / height, "\n".join(lines), ha="center", va="bottom", color=ALARM_COLOUR,
        weight="bold", size=8,
    )  # fmt: skip
    return Bbox.from_bounds(0.0, 0.0, width, height + strip)


def svg_text(figure: Figure) -> str:
    """SVG element of a figure, for embedding in a page."""
    drawn = io.StringIO()
    with style():
        figure.savefig(drawn, format="svg", metadata={"Date": None}, transparent=True, bbox_inches="tight")
    text = drawn.getvalue()
    return text[text.index("<svg") :]


def short_name(measures: str) -> str:
    """Printed name of an intensity measure, or of several joined by ' + '."""
    return " + ".join(
        SHORT_NAMES.get(name) or (f"SA({period_s(name):g} s)" if is_spectral(name) else name)
        for name in measures.split(" + ")
    )


def cut(name: str, letters: int = 24) -> str:
    """Abbreviate a name to a number of letters."""
    return name if len(name) <= letters else f"{name[: letters - 1]}…"


def unit_of(measure: str) -> str:
    """Unit of an intensity measure: a column of the results, or a spectral acceleration at any period."""
    return "m/s2" if is_spectral(measure) else describe(SCHEMA.field(measure))["unit"]


def printed_unit(measure: str) -> str:
    """Printed unit of an intensity measure."""
    return with_superscripts(unit_of(measure))


def with_superscripts(unit: str) -> str:
    """Unit with superscripts: m/s² for m/s2."""
    return unit.replace("m/s2", "m/s²").replace("m3", "m³").replace("m2", "m²")


def measure_label(measure: str) -> str:
    """Axis label of an intensity measure."""
    return f"{short_name(measure)} ({printed_unit(measure)})"


def digits(value: float | None) -> str:
    """Format a number with three significant digits, without powers of ten to a million; empty for None and NaN.

    Examples
    --------
    >>> digits(1.0), digits(17.04), digits(0.4), digits(960.0), digits(999.7), digits(1234.0)
    ('1.00', '17.0', '0.400', '960', '1,000', '1,230')
    """
    if value is None or value != value:
        return ""
    rounded = float(f"{value:.3g}")
    return f"{rounded:,.0f}" if 1e3 <= abs(rounded) < 1e6 else f"{rounded:#.3g}".rstrip(".")


def within(value: float, strongest: float | None, weakest: float | None = None) -> str:
    """Format a number with three significant digits, or as beyond the strongest or under the weakest shaking."""
    if weakest is not None and value < weakest:
        return f"under {digits(weakest)}"
    return f"beyond {digits(strongest)}" if strongest is not None and value > strongest else digits(value)


def plain_log(axis: XAxis | YAxis) -> None:
    """Label a logarithmic axis at 1, 2 and 5 of each decade, or more often where it is short, without powers of ten."""
    low, high = axis.get_view_interval()
    short = MaxNLocator(5, steps=(1, 2, 5, 10))
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if high > 5.0 * low else short)
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())
