"""How long a rock has stood: an age, or a distribution of it as equally likely ages."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from toppling.models.errors import InputError

AGE_SAMPLES = 400


def parse_age(text: str) -> NDArray[np.float64]:
    """Read an age: `20000`, `15000..30000` (uniform) or `20000+-3000` years (normal, cut at zero).

    A path to a CSV with the header `years`, or `years,weight`, is read.

    Raises
    ------
    InputError
        If the text is none of these, or the file has no header.
    """
    levels = (np.arange(AGE_SAMPLES) + 0.5) / AGE_SAMPLES
    try:
        if Path(text).is_file():
            years, weights = _read_ages(Path(text))
            order = np.argsort(years)
            cumulated = np.cumsum(weights[order]) / weights.sum()
            ages = years[order][np.searchsorted(cumulated, levels)]
        elif "+-" in text:
            mean, deviation = map(float, text.split("+-"))
            floor = norm.cdf(0.0, mean, deviation)
            ages = norm.ppf(floor + levels * (1 - floor), mean, deviation)
        elif ".." in text:
            low, high = map(float, text.split(".."))
            ages = low + levels * (high - low)
        else:
            ages = np.array([float(text)])
    except InputError:
        raise
    except ValueError:
        ages = np.array([math.nan])
    if not (np.isfinite(ages).all() and (ages > 0).all()):
        raise InputError(
            what=f"{text!r} is no age",
            where="--age",
            expected="years above zero: 20000, 15000..30000, 20000+-3000, or a CSV of years and weights",
            remedy="leave --age out for the statement about a single event",
        )
    return ages


def _read_ages(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Years and weights of a file, weights of one where it has none."""
    text = path.read_text(
        encoding="utf-8-sig"
    )  # a byte order mark would hide that the first line is a number
    header, *rows = [line for line in text.splitlines() if line.strip()] or [""]
    if _is_number(header.split(",")[0]):
        raise InputError(
            what=f"the first line, {header!r}, is no header",
            where=str(path),
            expected="the header 'years' or 'years,weight', then one age a line",
            remedy="put the header above the ages",
        )
    table = np.loadtxt(rows, delimiter=",", ndmin=2) if rows else np.empty((0, 1))
    years, weights = table[:, 0], table[:, 1] if table.shape[1] > 1 else np.ones(len(table))
    if not (len(years) and table.shape[1] <= 2 and (weights >= 0).all() and 0 < weights.sum() < math.inf):
        msg = "ages and weights, one of them above zero"
        raise ValueError(msg)
    return years, weights


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
