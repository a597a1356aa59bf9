"""Ground control points: the similarity that carries a model onto its survey, and the point that does not fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import f as f_distribution

from toppling.models.arrays import Array
from toppling.models.errors import InputError, refusals
from toppling.models.scan.header import TEXT

_ONE_LINE = 0.02
"""Points whose spread across is less than this share of that along lie on one line, about which the model can turn."""
_LARGEST_SHARE = 0.02
"""Of the points' extent: residuals above it are mistakes and no scatter."""
_SIGNIFICANT = 1e-4
"""Chance that scatter alone makes one of the points stand out as a mistake."""
_LARGEST_BYTES = 1 << 20

_unusable = refusals(
    expected="three or more lines of six numbers: x,y,z in the model, then x,y,z as surveyed; a name may stand before",
    remedy="give one line for each control point; a line of column names may come first",
)


@dataclass(frozen=True, eq=False)
class Fit:
    """Similarity from model to survey: surveyed = scale turn model + shift."""

    # Metres of a unit, and its standard deviation over it by the scatter of the points; NaN for exact points.
    scale: float
    scale_share_std: float
    turn: Array  # (3, 3)
    shift_m: Array  # (3,)
    residuals_m: Array  # (n,): distance of each point from where it was surveyed
    names: tuple[str, ...]

    @property
    def told(self) -> str:
        """Say it."""
        each = ", ".join(f"{name} {off:.2g}" for name, off in zip(self.names, self.residuals_m, strict=True))
        return (
            f"{len(self.names)} control points, {self.scale:.6g} m a unit (± {self.scale_share_std:.1%}, so the volume "
            f"± {3.0 * self.scale_share_std:.1%}), residuals in m: {each}"
        )


def similarity(model: Array, surveyed: Array, mirrored: bool = False) -> tuple[float, Array, Array]:
    """Scale, rotation and shift from (n, 3) to (n, 3) with the least squared residuals (Umeyama 1991).

    `mirrored`: a rotation with a reflection, which no model needs but an exchange of axes makes.
    """
    middle, centre = model.mean(axis=0), surveyed.mean(axis=0)
    own, other = model - middle, surveyed - centre
    left, stretch, right = np.linalg.svd(other.T @ own)
    handed = np.linalg.det(left) * np.linalg.det(right) * (-1.0 if mirrored else 1.0)
    sign = np.array([1.0, 1.0, np.sign(handed)])
    turn = (left * sign) @ right
    scale = float((stretch * sign).sum() / (own**2).sum())
    return scale, turn, centre - scale * turn @ middle


def fit_control_points(given: str | Path | Sequence[str], metres_per_unit: object = (1.0, 1.0)) -> Fit:
    """Fit control points.

    given: a file, or its lines.
    metres_per_unit: of surveyed coordinates, across and upward.
    Raises InputError if the file cannot be read, its points lie on one line, or one of them or all do not fit.
    """
    path = str(given) if isinstance(given, str | Path) else "--gcp"
    names, rows = _rows(control_point_lines(given), path)
    across, up = np.asarray(metres_per_unit, float)
    model, surveyed = rows[:, :3], rows[:, 3:] * (across, across, up)
    for side, places in (("model", model), ("survey", surveyed)):
        spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
        if spread[1] <= _ONE_LINE * spread[0]:
            raise _unusable(
                f"the points lie on one line in the {side}, about which the model could turn", path
            )
    scale, turn, shift = similarity(model, surveyed)
    residuals = np.linalg.norm(scale * model @ turn.T + shift - surveyed, axis=1)
    _check_fit(model, surveyed, residuals, names, path)
    free = 3 * len(rows) - 7
    spread_m = np.sqrt(((surveyed - surveyed.mean(axis=0)) ** 2).sum())
    return Fit(scale, float(np.sqrt((residuals**2).sum() / free) / spread_m), turn, shift, residuals, names)


def _squares(model: Array, surveyed: Array, mirrored: bool = False) -> float:
    scale, turn, shift = similarity(model, surveyed, mirrored)
    return float(((scale * model @ turn.T + shift - surveyed) ** 2).sum())


def _check_fit(model: Array, surveyed: Array, off: Array, names: tuple[str, ...], path: str) -> None:
    """Refuse points that no similarity carries into each other, naming the one without which the others fit."""
    count, size = len(model), float(np.ptp(surveyed, axis=0).max())
    large = off.max() > _LARGEST_SHARE * size
    expected = "control points that one scale, one rotation and one shift carry onto the survey"
    if large and _squares(model, surveyed, mirrored=True) < 0.01 * (off**2).sum():
        raise InputError(
            "the points fit when mirrored",
            where=path,
            expected=expected,
            remedy="exchange two of the columns of one side: one of the two systems is left-handed (north before east, "
            "or heights downward)",
        )
    if count > 3:
        others = [_squares(model[keep], surveyed[keep]) for keep in ~np.eye(count, dtype=bool)]
        worst, rest = int(np.argmin(others)), min(others)
        free = 3 * (count - 1) - 7
        tiny = (1e-9 * size) ** 2
        by_chance = count * f_distribution.sf(((off**2).sum() - rest) / 3.0 * free / max(rest, tiny), 3, free)
        alone = rest / (count - 1) < (0.5 * _LARGEST_SHARE * size) ** 2
        if (off**2).sum() > count * tiny and alone and (by_chance < _SIGNIFICANT or large):
            raise InputError(
                f"point {names[worst]} does not fit: with it the points are off by up to {off.max():.3g} m, without it "
                f"by {np.sqrt(rest / (count - 1)):.2g} m",
                where=path,
                expected=expected,
                remedy=f"correct point {names[worst]} or leave it out: it may be another mark's, mistyped or in "
                "another order",
            )
    if large:
        raise InputError(
            f"the points do not fit: off by up to {off.max():.3g} m, where they span {size:.3g} m; "
            f"{names[int(off.argmax())]} is off most",
            where=path,
            expected=expected,
            remedy="check the order of points and columns, and that each point is the same mark on both sides; a "
            "fourth point would show which one is wrong",
        )


def control_point_lines(given: str | Path | Sequence[str]) -> list[str]:
    """Lines of a file of control points, or the same lines.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    if not isinstance(given, str | Path):
        return list(given)
    path = Path(given)
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise _unusable("is larger than 1 MB", path)
        return path.read_text(encoding=TEXT).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise _unusable(f"cannot be read ({error})", path) from None


def _rows(lines: Sequence[str], path: str) -> tuple[tuple[str, ...], Array]:
    """Names of the points, and their six coordinates (n, 6)."""
    names: list[str] = []
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        words = line.replace(",", " ").replace(";", " ").split()
        if not words or words[0].startswith("#"):
            continue
        numbers = _numbers(words[-6:])
        if numbers is None or len(words) not in (6, 7):
            if not rows and _numbers(words[1:]) is None:
                continue
            raise _unusable(f"line {number} is '{line}'", path)
        names.append(words[0] if len(words) == 7 else f"{len(rows) + 1} (line {number})")
        rows.append(numbers)
    if len(rows) < 3:
        raise _unusable(f"holds {len(rows)} points", path)
    return tuple(names), np.array(rows)


def _numbers(words: list[str]) -> list[float] | None:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() else None
