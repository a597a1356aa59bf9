"""What the scan knows about its own result: the standing rock, how sure the split is, and the spread of the numbers."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from toppling.models.errors import InputError
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.hidden_base.statics import on_plane, on_surface
from toppling.models.hidden_base.underside import CORES_OF_HOLES, hidden_base
from toppling.models.rock import Rock
from toppling.models.scan.close import ClosedRock, close_rock
from toppling.models.scan.crevice import refitted
from toppling.models.scan.interface import Interface
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.segment import PEDESTAL, ROCK, Segmentation
from toppling.models.scan.surfels import Surfels
from toppling.models.scene import Scene
from toppling.models.statics import CONTACT_SHARE_OF_HEIGHT

_AZIMUTHS_DEG = np.arange(0.0, 360.0, 10.0)
_SECTORS = 36
_BESIDE_PER_HEIGHT = 0.02
"""Pedestal seen this near to the rock shows the crevice."""
_SUPPORT_PER_HEIGHT = 0.02
"""What lies so near to the interface could touch it."""
_BESIDE_BAND_PER_HEIGHT = 0.1
"""Points this far above or below the interface are enough to fit it anew."""

# What all realisations share, half samples cannot tell: the reconstruction rounds edges off and smooths the hidden
# base. Errors against known rocks bound it (benchmarks/reports/scan.md): seven virtual shapes and two scans of others.
_COM_BIAS_PER_HEIGHT = 0.001
_VOLUME_BIAS_SHARE = 0.003
_INERTIA_BIAS_SHARE = 0.003
_TOPPLING_BIAS_SHARE = 0.02

# What no station saw, no half sample knows either. A smooth closing can miss, or add, as much as a cap with the
# invented share s of the surface: on a ball 3 s^2 - 2 s^3 of the volume. Nineteen scans of four shapes by two to four
# stations on one side, 25 to 72 % invented, were off by 0.03 to 1.2 of it in volume (0.63 rms), and by 0.2 to 1.6 in
# inertia (0.84 rms).
_INVENTED_COM_PER_HEIGHT = 0.2
"""Shift of the centre of mass in each coordinate over height and such a cap's share; those scans: up to 0.24."""
_MUCH_INVENTED = 0.15
"""From this share of the surface on, volume and centre of mass are guesses."""


@dataclass(frozen=True, eq=False)
class ObservedRock:
    """What was seen of rock and pedestal."""

    # (n, 3): points about the interface, scene frame.
    rock_m: NDArray[np.float64]
    pedestal_m: NDArray[np.float64]
    # (n, 3): those of them that shape the base (`near_the_interface`).
    low_m: NDArray[np.float64]
    lit_m: NDArray[np.float64]
    surfels: Surfels
    patches: NDArray[np.bool_]  # (k,): which surfels are the rock's
    height_m: float
    hint: InterfaceHint | None  # the interface as the user knows it


def close_standing(observed: ObservedRock, interface: Interface) -> tuple[ClosedRock, float]:
    """Close the rock on the narrowest feet on which it stands, and say how narrow: it stood when it was scanned."""
    low, lit = interface.over(observed.low_m), interface.over(observed.lit_m)
    cores = CORES_OF_HOLES if observed.hint is None or not observed.hint.encloses else CORES_OF_HOLES[:1]
    for core in cores:
        base = hidden_base(low, lit, observed.height_m, core, observed.hint, interface=interface)
        closed = close_rock(observed.surfels, observed.patches, base, interface)
        if stands(closed.rock, interface) or outside_support_m(closed.rock, interface) > 0.0:
            break  # no feet hold a rock whose centre of mass hangs beside all of its base
    return closed, core


def outside_support_m(rock: Rock, interface: Interface, share: float = _SUPPORT_PER_HEIGHT) -> float:
    """How far the vertical through the centre of mass passes outside all that is within a share of the height."""
    over = interface.over(rock.vertices_m)
    low = over[:, 2] < share * rock.height_m
    if interface.edge is not None:
        low &= interface.edge.carries(over)
    if low.sum() < 3:
        return np.inf
    places = interface.flat(rock.vertices_m)[low, :2]
    if interface.sheet is not None:  # where plumb lines through them pierce the plane, as that of the weight
        places = interface.projected_m(rock.vertices_m[low])
    hull = ConvexHull(places)
    projected = interface.projected_m(rock.com_m[None])[0]
    return float((hull.equations[:, :2] @ projected + hull.equations[:, 2]).max())


def stands(rock: Rock, interface: Interface) -> bool:
    """Whether the rock stays up by itself."""
    if not interface.is_plane:
        return outside_support_m(rock, interface, CONTACT_SHARE_OF_HEIGHT) < 0.0
    return bool((toppling(rock, interface, _AZIMUTHS_DEG[::3]) > 0.0).all())


def toppling(rock: Rock, interface: Interface, azimuths_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quasi-static toppling accelerations (n,) on the interface plane, or the surface carried below the rock, m/s2."""
    if not interface.is_plane:
        return on_surface(rock, interface, azimuths_deg)
    return on_plane(rock, interface, azimuths_deg)


def slenderness(scene: Scene, nominal_m_s2: list[float] | None = None) -> list[dict[str, float]]:
    """Slenderness angle by the azimuth toward which the rock topples.

    From the accelerations toward evenly spaced azimuths from 0 on where they are known already (`nominal_m_s2`).

    tan(alpha) = a / g (Anooshehpoor, Brune and Zeng 2004), a the quasi-static toppling acceleration of the ground
    the other way: for a flat sharp base the angle between the vertical and the line from the centre of mass to the
    edge about which it tips.
    """
    ground = (_AZIMUTHS_DEG + 180.0) % 360.0
    if nominal_m_s2 is None:
        table = scene.quasi_static_toppling_m_s2(ground)
    else:
        at = 360.0 / len(nominal_m_s2) * np.arange(len(nominal_m_s2))
        table = [(each, float(np.interp(each, at, nominal_m_s2, period=360.0))) for each in ground]
    return [
        {"azimuth_deg": float(azimuth), "alpha_deg": float(np.rad2deg(np.arctan(value / scene.gravity_m_s2)))}
        for azimuth, (_, value) in zip(_AZIMUTHS_DEG, table, strict=True)
    ]


def confidence(
    parts: Segmentation,
    points_m: NDArray[np.float64],
    label: NDArray[np.int8],
    interface: Interface,
    height_m: float,
) -> dict[str, float]:
    """How sure the split is: four numbers, each 0 to 1.

    Returns
    -------
    dict
        `concave_share_of_cut`: share of the cut that runs through creases, 1 where a crevice goes all round.
        `crevice_seen_share`: share of the directions in which the pedestal was seen beside the rock.
        `undisputed_share`: share of the points near the interface whose six nearest neighbours have their label.
        `runner_up`: height of the highest other thing that stands there, over the rock's.
    """
    flat = interface.over(points_m)
    near = (np.abs(flat[:, 2]) < 0.1 * height_m) & (label != 2)
    flat, sides = flat[near], label[near]
    step = max(1, len(flat) // 200_000)
    flat, sides = flat[::step], sides[::step]
    rock, pedestal = flat[sides == ROCK], flat[sides == PEDESTAL]
    neighbours = cKDTree(flat).query(flat, 7)[1][:, 1:]
    alone = (sides[neighbours] != sides[:, None]).any(axis=1)
    beside = pedestal[cKDTree(rock).query(pedestal)[0] < _BESIDE_PER_HEIGHT * height_m]
    centre = 0.5 * (rock[:, :2].min(axis=0) + rock[:, :2].max(axis=0))
    sector = np.floor(np.arctan2(*(beside[:, :2] - centre).T[::-1]) / (2 * np.pi / _SECTORS)).astype(int)
    return {
        "concave_share_of_cut": parts.concave_share,
        "crevice_seen_share": len(np.unique(sector)) / _SECTORS,
        "undisputed_share": 1.0 - float(alone.mean()),
        "runner_up": max((other[3] for other in parts.others), default=0.0) / height_m,
    }


def cap_share(surface_share: float) -> float:
    """Share of a ball's volume in a cap with a share of its surface."""
    return surface_share**2 * (3.0 - 2.0 * surface_share)


def bias_floors(invented_share: float) -> dict[str, float]:
    """Standard deviations that half samples cannot tell: those of rocks seen all round, and of what is invented."""
    cap = cap_share(invented_share)
    return {
        "com_per_height": float(np.hypot(_COM_BIAS_PER_HEIGHT, _INVENTED_COM_PER_HEIGHT * cap)),
        "volume_share": float(np.hypot(_VOLUME_BIAS_SHARE, cap)),
        "inertia_share": float(np.hypot(_INERTIA_BIAS_SHARE, cap)),
        "toppling_share": _TOPPLING_BIAS_SHARE,
    }


def uncertainty(
    observed: ObservedRock,
    interface: Interface,
    core: float,
    invented_share: float,
    realisations: int,
    each: Callable[[], None],
) -> dict[str, Any]:
    """Spread of the numbers over half samples of what was seen (McCarthy 1969).

    Each realisation keeps half of the points (noise and density), half of the directions around the contact for the
    interface's fit (its choice), and draws how wide the feet are in their holes. The spread of an estimate over half
    samples is that of the estimate itself.

    Parameters
    ----------
    observed : ObservedRock
    interface : Interface
    core : float
        Of the feet on which the rock stands.
    invented_share : float
        Of the rock's surface: neither seen nor closed at the interface.
    realisations : int
        0 for none, which gives nothing.
    each : callable
        Called after each.

    Half samples share the reconstruction's bias, so each spread is joined in quadrature with a floor, measured on
    known rocks: 0.1 % of the rock's height in each coordinate of the centre of mass, 0.3 % of volume and inertia,
    2 % of the toppling acceleration. The floors grow with what is invented (`cap_share`): by that share of volume and
    inertia, by a fifth of it of the height in the centre of mass, and by what this shift does to the toppling. An
    invented top counts in the height by as much as it rises above what was seen.

    Returns
    -------
    dict
        Standard deviations with their floors (`bias`), the statics' for the bare interface plane; none where fewer
        than three realisations close, and none of an interface that is given, ends below
        the rock or carries a surface: its error nobody drew.
    """
    if not realisations:
        return {}
    closed = _half_closings(observed, interface, core, realisations, each)
    given = "" if observed.hint is None else "; the error of the interface that is given is not in them"
    found: dict[str, Any] = {
        "method": f"half samples{given}",
        "realisations": realisations,
        "closed": len(closed),
    }
    if len(closed) < 3:
        return found
    return found | _spread(observed, invented_share, closed)


def _half_closings(
    observed: ObservedRock, interface: Interface, core: float, realisations: int, each: Callable[[], None]
) -> list[tuple[Rock, Interface]]:
    """Rocks closed from half samples, each with its interface; fewer where a sample leaves too little."""
    beside = _Beside.of(observed, interface)
    closed = []
    for number in range(realisations):
        rng = np.random.default_rng([2017, number])
        try:
            kept_plane = observed.hint is not None or not interface.is_bare
            plane = interface if kept_plane else _half_fitted(beside, interface, rng)
            drawn = float(np.clip(core + rng.uniform(-0.2, 0.2), 0.0, 0.9))
            low, lit = plane.over(_half(observed.low_m, rng)), plane.over(_half(observed.lit_m, rng))
            base = hidden_base(low, lit, observed.height_m, drawn, observed.hint, rng, plane)
            kept = observed.patches & (rng.random(len(observed.patches)) < 0.5)
            closed.append((close_rock(observed.surfels, kept, base, plane).rock, plane))
        except InputError:
            pass  # counted: a half sample may leave too little
        each()
    return closed


def _spread(
    observed: ObservedRock, invented_share: float, closed: list[tuple[Rock, Interface]]
) -> dict[str, Any]:
    """Standard deviations over half samples, joined with the floors of what all of them share."""
    rocks, planes = zip(*closed, strict=True)
    floor = bias_floors(invented_share)
    height = float(np.mean([rock.height_m for rock in rocks]))
    # a / g is the arm over the height of the centre of mass: a shift moves it by as much over that height.
    raised = [plane.flat(rock.com_m[None])[0, 2] for rock, plane in closed]
    tipped = _INVENTED_COM_PER_HEIGHT * cap_share(invented_share) * height / float(np.mean(raised))
    volume = np.array([rock.volume_m3 for rock in rocks])
    inertia = np.array([rock.inertia_per_mass_m2 for rock in rocks])
    radius = np.sqrt(np.diag(inertia.mean(axis=0)))
    highest = (
        float(observed.surfels.points_m[observed.patches, 2].max()) + observed.surfels.voxel_m
    )  # of what was seen
    top = float(np.median([rock.vertices_m[:, 2].max() for rock in rocks]))
    normals = np.array([plane.normal for plane in planes])
    tilt = np.rad2deg(np.linalg.norm(normals - normals.mean(axis=0), axis=1))
    tilt_std = float(np.sqrt((tilt**2).sum() / (len(tilt) - 1)))
    return {
        "bias": floor | {"toppling_over_gravity": tipped},
        "volume_std_m3": _joined(_std(volume), floor["volume_share"] * volume.mean()),
        "com_std_m": _joined(_std([rock.com_m for rock in rocks]), floor["com_per_height"] * height),
        "inertia_per_mass_std_m2": _joined(_std(inertia), floor["inertia_share"] * np.outer(radius, radius)),
        "height_std_m": _joined(_std([rock.height_m for rock in rocks]), max(top - highest, 0.0)),
        **({"interface_normal_std_deg": tilt_std} if len(set(planes)) > 1 else {}),
        **_toppling_spread(closed, tipped),
    }


def _toppling_spread(closed: list[tuple[Rock, Interface]], tipped: float) -> dict[str, Any]:
    """Standard deviations of toppling acceleration and slenderness by azimuth.

    `tipped` is the part of the error of a / g that comes from what is invented.
    """
    limits = np.array([toppling(rock, plane, _AZIMUTHS_DEG) for rock, plane in closed])
    finite = np.where(np.isfinite(limits), limits, np.nan)
    alpha = np.rad2deg(np.arctan(limits / STANDARD_GRAVITY_M_S2))
    limit_bias = np.hypot(_TOPPLING_BIAS_SHARE * np.nanmean(finite, axis=0), STANDARD_GRAVITY_M_S2 * tipped)
    # tan(alpha) = a / g: d alpha = sin(alpha) cos(alpha) da / a = cos(alpha)^2 da / g
    angle = np.deg2rad(alpha.mean(axis=0))
    alpha_bias = np.rad2deg(
        np.hypot(0.5 * _TOPPLING_BIAS_SHARE * np.sin(2.0 * angle), np.cos(angle) ** 2 * tipped)
    )
    limit_std = _joined(np.nanstd(finite, axis=0, ddof=1), limit_bias)
    return {
        "quasi_static_toppling_m_s2": [
            {"azimuth_deg": float(a), "std": std} for a, std in zip(_AZIMUTHS_DEG, limit_std, strict=True)
        ],
        "slenderness": [
            {"azimuth_deg": float((a + 180.0) % 360.0), "alpha_std_deg": std}
            for a, std in zip(_AZIMUTHS_DEG, _joined(_std(alpha), alpha_bias), strict=True)
        ],
    }


def invention_warning(scene: Scene) -> str | None:
    """Say that much of the rock was not seen, if so, and what follows; nothing for a rock that was seen."""
    share = scene.report.get("surface", {}).get("invented_share", 0.0)
    if share <= _MUCH_INVENTED:
        return None
    return (
        f"warning: {share:.0%} of the rock's surface was not seen and is invented; its volume, centre of mass and "
        f"inertia are guesses, the volume by about ±{cap_share(share):.0%}: scan the rock from the other sides"
    )


def _half(points: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    return points[rng.random(len(points)) < 0.5]


@dataclass(frozen=True, eq=False)
class _Beside:
    """Points on both sides of the interface, from which it is fitted, and the direction in which each lies."""

    points_m: NDArray[np.float64]
    label: NDArray[np.int8]
    sector: NDArray[np.int64]
    height_m: float

    @classmethod
    def of(cls, observed: ObservedRock, interface: Interface) -> "_Beside":
        band = _BESIDE_BAND_PER_HEIGHT * observed.height_m
        flat_rock, flat_pedestal = interface.flat(observed.rock_m), interface.flat(observed.pedestal_m)
        rock, pedestal = np.abs(flat_rock[:, 2]) < band, np.abs(flat_pedestal[:, 2]) < band
        low = flat_rock[rock, :2]
        centre = 0.5 * (low.min(axis=0) + low.max(axis=0))
        offset = np.concatenate([low, flat_pedestal[pedestal, :2]]) - centre
        turn = np.arctan2(offset[:, 1], offset[:, 0]) / (2 * np.pi) + 0.5
        return cls(
            np.concatenate([observed.rock_m[rock], observed.pedestal_m[pedestal]]),
            np.repeat(np.array([ROCK, PEDESTAL], np.int8), [rock.sum(), pedestal.sum()]),
            np.floor(turn * _SECTORS).astype(int) % _SECTORS,
            observed.height_m,
        )


def _half_fitted(beside: _Beside, interface: Interface, rng: np.random.Generator) -> Interface:
    """Interface through the pedestal in half of the directions around the contact."""
    kept = np.isin(beside.sector, rng.choice(_SECTORS, _SECTORS // 2, replace=False)) | (beside.label == ROCK)
    return refitted(beside.points_m[kept], beside.label[kept], interface, beside.height_m)


def _std(values: Any) -> Any:
    return np.std(np.asarray(values, float), axis=0, ddof=1).tolist()


def _joined(spread: Any, floor: Any) -> Any:
    """Root of the sum of squares."""
    return np.hypot(spread, floor).tolist()
