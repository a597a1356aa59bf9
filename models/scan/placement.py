"""How a model's coordinates become metres with z up: its upward axis, a measured length, or ground control points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from toppling.models.arrays import Array
from toppling.models.errors import InputError
from toppling.models.frames import rotation_between
from toppling.models.scan.control_points import fit_control_points

AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}
Length = tuple[Sequence[float], Sequence[float], float]


@dataclass(frozen=True, eq=False)
class Placement:
    """A similarity from a model's coordinates to metres, z up."""

    scale: float = 1.0
    turn: Array = field(default_factory=lambda: np.eye(3))  # (3, 3): rotation
    shift_m: Array = field(default_factory=lambda: np.zeros(3))  # (3,)
    by: str = ""  # who says so; empty if nothing is changed
    # Whether the user said which way is up, and how long a unit is.
    says_up: bool = False
    says_scale: bool = False

    def apply(self, points: Array) -> Array:
        """Metres (n, 3) of places in the model."""
        return self.scale * (points @ self.turn.T) + self.shift_m

    def undo(self, points_m: Array) -> Array:
        """Places of the model (n, 3) that lie there in metres."""
        return ((points_m - self.shift_m) / self.scale) @ self.turn


def placement_of(
    up: str | Sequence[float] | None = None,
    length: Length | None = None,
    gcp: str | Path | Sequence[str] | None = None,
    metres_per_unit: Sequence[float] = (1.0, 1.0),
) -> Placement:
    """Placement by what the user says.

    Parameters
    ----------
    up : str or (3,) floats, optional
        Axis of the model that points upward: one of `AXES`, or a vector.
    length : (p, q, metres), optional
        Two places of the model and the distance between them.
    gcp : path or lines, optional
        Control points, which say scale and attitude too.
    metres_per_unit : (float, float)
        Of surveyed coordinates, across and upward.

    Raises
    ------
    InputError
        If what is said contradicts itself, the length is none, or the points cannot be used.
    """
    if gcp is not None:
        if up or length:
            raise InputError(
                f"--gcp is given with {'--up' if up else '--length'}",
                where="--gcp",
                expected="control points alone: they say scale and attitude",
                remedy="leave out the other option",
            )
        fit = fit_control_points(gcp, metres_per_unit)
        return Placement(
            fit.scale, fit.turn, fit.shift_m, f"--gcp: {fit.told}", says_up=True, says_scale=True
        )
    turn, said = (upward(up), f"--up {_words(up)}") if up else (np.eye(3), "")
    if length is None:
        return Placement(turn=turn, by=said, says_up=bool(up))
    start, end, metres = np.asarray(length[0], float), np.asarray(length[1], float), float(length[2])
    apart = float(np.linalg.norm(end - start))
    if not (0.0 < apart < np.inf and 0.0 < metres < np.inf):
        raise InputError(
            f"two places {apart:g} apart are said to be {metres:g} m apart",
            where="--length",
            expected="two different places X,Y,Z of the model and a length in metres above 0",
            remedy="pick two marks whose distance was measured",
        )
    by = f"--length: {apart:.6g} units are {metres:g} m" + (f"; {said}" if said else "")
    return Placement(metres / apart, turn, by=by, says_up=bool(up), says_scale=True)


def upward(axis: str | Sequence[float]) -> Array:
    """Rotation (3, 3) that carries an axis of a model upward; -z by half a turn about x.

    Raises
    ------
    InputError
        If it is no axis and no vector.

    Examples
    --------
    >>> (upward("y") @ [0.0, 1.0, 0.0]).round(12).tolist(), (upward([0, 0, -2]) @ [1.0, 0.0, -1.0]).tolist()
    ([0.0, 0.0, 1.0], [1.0, 0.0, 1.0])
    """
    try:
        words = axis.replace(",", " ").split() if isinstance(axis, str) else axis
        vector = np.array(AXES.get(str(axis).strip().lower(), words), float)
    except ValueError:
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise InputError(
            f"'{_words(axis)}' is no direction",
            where="--up",
            expected=f"one of {', '.join(AXES)}, or three numbers X,Y,Z that point upward in the model",
            remedy="write it like --up y, or --up 0,0.98,0.17",
        )
    vector /= np.linalg.norm(vector)
    if vector[2] < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    return rotation_between(vector, (0.0, 0.0, 1.0))


def _words(up: str | Sequence[float] | None) -> str:
    return up if isinstance(up, str) else ",".join(f"{each:g}" for each in up or ())
