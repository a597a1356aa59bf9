"""The unseen base of a rock: draws of the feet it may stand on, of its centre of mass and of its pose.

What decides where rock and pedestal touch is the clearance between them, so a base is kept as feet over the interface
plane (:mod:`models.relief`) with their clearance as height, those within a band over the plane. Feet above the band
were seen, and are those of the scene's meshes for every draw.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.caching import cached
from toppling.models.errors import InputError, refusals
from toppling.models.files.digest import BLANK, KEY, read_json, seal
from toppling.models.files.documents import shown
from toppling.models.frames import plane_axes
from toppling.models.pedestal import Pedestal
from toppling.models.relief import contact_feet_m
from toppling.models.rock import Rock

SCHEMA_VERSION = 1
_DECIMALS = 7
"""Lengths are kept to a tenth of a micrometre, in memory as on disk, so that a scene's id survives the disk."""
_LEAST_DOWN = -0.2
"""Faces whose unit normal points less far down come to lie on the pedestal only where the rock has toppled."""


_no_draws = refusals(
    expected=f"draws of the base of schema version {SCHEMA_VERSION}, as written beside the scene",
    remedy="make the scene anew with 'toppling scan', or remove the file and scan again",
)


@dataclass(frozen=True, eq=False)
class BaseDraw:
    """One base that agrees with all that was seen."""

    # (n, 3): coordinates u, v along the interface plane (`models.frames.plane_axes`) and the clearance, in
    # the pose at rest. Where the clearance is 0 the rock touches.
    feet_m: Array
    # (3,): from the scene's centre of mass to the drawn one, scene axes, before the turn.
    com_offset_m: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    # (3,): rotation vector about the scene's origin, scene axes, from the pose of the scene to that at rest;
    # zero for a base on which the rock stands as scanned.
    turn_rad: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    # (3,): translation that follows the turn.
    shift_m: Array = dataclasses.field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            rounded = np.round(np.asarray(getattr(self, field.name), float), _DECIMALS) + 0.0  # no minus zero
            object.__setattr__(self, field.name, rounded)

    @property
    def tilt_deg(self) -> float:
        """Angle by which the pose at rest is turned from that of the scene."""
        return float(np.rad2deg(np.linalg.norm(self.turn_rad)))


def draw_of(realisation: int, count: int) -> int | None:
    """Which of so many draws a realisation of a campaign takes; None for realisation 0, the nominal scene.

    Every draw once in each round of as many realisations as there are draws. Only the first round is in order: what
    else a realisation draws (`workers.unmeasured`) fills its intervals in steps of powers of two, and would go with the
    base.
    """
    if realisation == 0:
        return None
    turn, place = divmod(realisation - 1, count)
    return place if turn == 0 else int(np.random.default_rng([2030, turn]).permutation(count)[place])


@dataclass(frozen=True, eq=False)
class UnseenBase:
    """Draws of a base, each as likely as the others."""

    band_m: float  # clearance below which a draw's feet replace those of the scene's meshes
    draws: tuple[BaseDraw, ...]
    # Draw whose feet the scene itself stands on, in its own pose and with its own centre of mass; None for
    # those of its meshes.
    nominal: int | None = None
    # (n,): over a surface: which vertices of the rock's mesh the feet of each draw are, in their order. Their
    # third coordinate is then the height over the interface plane and not the clearance, and the rock touches
    # where its mesh does.
    vertices: Indices | None = None

    def __len__(self) -> int:
        return len(self.draws)

    def number_of(self, realisation: int) -> int | None:
        """Which draw a realisation of a campaign takes (:func:`draw_of`)."""
        return draw_of(realisation, len(self.draws))

    def realised(self, rock: Rock, pedestal: Pedestal, number: int) -> Rock:
        """The rock with the feet, the centre of mass and the pose of one draw."""
        draw = self.draws[number]
        frame = np.vstack([*plane_axes(pedestal.normal), pedestal.normal])
        turn = Rotation.from_rotvec(draw.turn_rad).as_matrix()
        moved = dataclasses.replace(rock, com_m=rock.com_m + draw.com_offset_m)
        if self.vertices is not None:
            vertices = rock.vertices_m.copy()
            vertices[self.vertices] = draw.feet_m @ frame + pedestal.point_m
            return dataclasses.replace(moved, vertices_m=vertices).moved(turn, draw.shift_m)
        moved = moved.moved(turn, draw.shift_m)
        high = feet_above_m(rock, pedestal, self.band_m) @ turn.T + draw.shift_m
        return dataclasses.replace(moved, feet_m=np.vstack([draw.feet_m @ frame + pedestal.point_m, high]))

    def on_feet_of(self, rock: Rock, pedestal: Pedestal, number: int) -> Rock:
        """The rock with the feet of one draw, as it stands and with its own centre of mass."""
        return dataclasses.replace(rock, feet_m=self.realised(rock, pedestal, number).feet_m)

    @property
    def digest(self) -> bytes:
        """Hash of all draws."""
        content = hashlib.sha256(repr(float(self.band_m)).encode())
        if self.nominal is not None:
            content.update(repr(self.nominal).encode())
        if self.vertices is not None:
            content.update(np.ascontiguousarray(self.vertices, "<i8").tobytes())
        for draw in self.draws:
            for field in dataclasses.fields(draw):
                array = np.ascontiguousarray(getattr(draw, field.name), "<f8")
                content.update(repr(array.shape).encode())
                content.update(array.tobytes())
        return content.digest()

    def write(self, path: Path) -> None:
        """Write the draws as JSON with its digest, one draw a line."""
        lines = ",\n".join(
            json.dumps({name: value.tolist() for name, value in vars(draw).items()}) for draw in self.draws
        )
        head = f'"{KEY}": "{BLANK}", "schema_version": {SCHEMA_VERSION}, "band_m": {float(self.band_m)!r}'
        if self.nominal is not None:
            head += f', "nominal": {self.nominal}'
        if self.vertices is not None:
            head += f', "vertices": {json.dumps(self.vertices.tolist())}'
        path.write_text(f'{{{head}, "draws": [\n{lines}\n]}}\n')
        seal(path)

    @classmethod
    def read(cls, path: Path) -> UnseenBase:
        """Read what :meth:`write` wrote.

        Raises
        ------
        InputError
            If the file is not whole or of another schema.
        """
        try:
            content = read_json(path)
            if content["schema_version"] != SCHEMA_VERSION:
                raise _no_draws(
                    "document.schema_version", f"schema version {content['schema_version']}", path
                )
            draws = tuple(BaseDraw(**_checked(draw)) for draw in content["draws"])
            band_m, nominal = float(content["band_m"]), content.get("nominal")
            vertices = _numbers(content.get("vertices"), draws)
        except InputError:
            raise
        except (OSError, UnicodeDecodeError, KeyError, TypeError, ValueError, OverflowError) as error:
            raise _no_draws(
                "draws.unreadable", f"is not whole ({type(error).__name__}: {error})", path
            ) from None
        if not draws or not (band_m > 0.0 or (vertices is not None and band_m == 0.0)):
            raise _no_draws("draws.value_unusable", f"{len(draws)} draws below {band_m} m", path)
        if nominal is not None and (type(nominal) is not int or not 0 <= nominal < len(draws)):
            raise _no_draws(
                "draws.value_unusable", f"nominal is {shown(nominal)}, of {len(draws)} draws", path
            )
        return cls(band_m, draws, nominal, vertices)


@cached
def feet_above_m(rock: Rock, pedestal: Pedestal, band_m: float) -> Array:
    """Feet (n, 3) of rock and pedestal, scene frame, whose clearance is at least so much."""
    feet = contact_feet_m(rock, pedestal)
    return feet[(feet - pedestal.point_m) @ pedestal.normal >= band_m]


def least_feet(feet_m: ArrayLike, high_m: Array, com_m: Array, tolerance_m: float) -> Array:
    """The few feet that decide how a rock rocks: the others lie within a tolerance of their convex hull.

    feet_m: (n, 3), candidates as u, v and clearance.
    high_m: (k, 3), feet above them that stay, same axes.
    com_m: (3,), centre of mass, same axes: it lies within the hull and never at its lower end.
    Returns (m, 3) array: the outermost, and farthest below the hull of those, until none lies farther than the
    tolerance below it.
    """
    feet, fixed = np.asarray(feet_m, float), np.vstack([high_m, com_m])
    try:
        corners = ConvexHull(np.vstack([feet, fixed])).vertices
    except QhullError:
        return feet
    feet = feet[np.sort(corners[corners < len(feet)])]
    touching = feet[:, 2] <= feet[:, 2].min() + 0.1**_DECIMALS
    selected = _outline(feet, touching) | _outline(feet, np.ones(len(feet), bool))
    while True:
        facets = ConvexHull(np.vstack([feet[selected], fixed])).equations
        down = facets[facets[:, 2] < _LEAST_DOWN]
        below = down[:, :3] @ feet.T + down[:, 3:]
        lowest = below.argmax(axis=1)
        worst = np.zeros(len(feet), bool)
        worst[lowest[below[np.arange(len(down)), lowest] > tolerance_m]] = True
        if not (worst & ~selected).any():
            return feet[selected]
        selected |= worst


def _outline(feet: Array, of: Flags) -> Flags:
    """Which feet (n,) are corners of the outline of some of them, seen from below; all of those on one line."""
    numbers = np.flatnonzero(of)
    corners = np.zeros(len(feet), bool)
    try:
        corners[numbers[ConvexHull(feet[numbers, :2]).vertices]] = True
    except (QhullError, ValueError):  # Qhull raises ValueError of fewer than three
        corners[numbers] = True
    return corners


def _numbers(vertices: Any, draws: tuple[BaseDraw, ...]) -> Indices | None:
    """Vertices of the rock that the feet are, refused where they are not those of the draws."""
    if vertices is None:
        return None
    numbers = np.asarray(vertices)
    if numbers.ndim != 1 or numbers.dtype.kind != "i" or (numbers < 0).any():
        msg = "vertices are no list of whole numbers"
        raise ValueError(msg)
    if any(len(draw.feet_m) != len(numbers) for draw in draws):
        msg = f"{len(numbers)} vertices, and draws of another number of feet"
        raise ValueError(msg)
    return numbers.astype(np.int64)


def _checked(draw: Mapping[str, Sequence[Any]]) -> dict[str, Array]:
    """Arrays of a draw, refused where they are not those of one."""
    arrays = {name: np.asarray(value, float) for name, value in draw.items()}
    shapes_fit = arrays["feet_m"].ndim == 2 and arrays["feet_m"].shape[1] == 3 and len(arrays["feet_m"]) > 2
    shapes_fit &= all(arrays[name].shape == (3,) for name in ("com_offset_m", "turn_rad", "shift_m"))
    if not shapes_fit or not all(np.isfinite(array).all() for array in arrays.values()):
        msg = "a draw is not finite, or not of three or more feet and three vectors"
        raise ValueError(msg)
    return arrays
