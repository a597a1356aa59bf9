"""What was seen of a rock, the closing on which it stands, how slender and how sure it is, how its numbers spread."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from toppling.models.arrays import Array, Flags, Indices
from toppling.models.errors import InputError
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.hidden_base.near_interface import NearInterface, SidesSeen
from toppling.models.hidden_base.statics import on_plane, on_surface
from toppling.models.hidden_base.underside import CORES_OF_HOLES, hidden_base
from toppling.models.rock import Rock
from toppling.models.scan.close import COARSE_DEPTH, ClosedRock, close_rock
from toppling.models.scan.doubt import SECTORS, middle, sectors
from toppling.models.scan.interface import Interface, lining, plane_of_lining
from toppling.models.scan.interface_hint import InterfaceHint
from toppling.models.scan.invented import INVENTED_COM_PER_HEIGHT, bias_floors, cap_share
from toppling.models.scan.segment import PEDESTAL, ROCK, Segmentation
from toppling.models.scan.surfels import Surfels
from toppling.models.scene import Scene
from toppling.models.statics import CONTACT_SHARE_OF_HEIGHT

AZIMUTHS_DEG = np.arange(0.0, 360.0, 10.0)
_BESIDE_PER_HEIGHT = 0.02
"""Pedestal seen this near to the rock shows the crevice."""
_SUPPORT_PER_HEIGHT = 0.02
"""What lies so near to the interface could touch it."""


@dataclass(frozen=True, eq=False)
class ObservedRock:
    """What was seen of rock and pedestal."""

    # (n, 3): points about the interface, scene frame.
    rock_m: Array
    pedestal_m: Array
    # (n, 3): those of them that shape the base (`near_the_interface`).
    low_m: Array
    lit_m: Array
    surfels: Surfels
    patches: Flags  # (k,): which surfels are the rock's
    height_m: float
    hint: InterfaceHint | None  # the interface as the user knows it

    @cached_property
    def patches_apart(self) -> float:
        """Median distance of the rock's patches to their fourth neighbours, in their width: 1.1 where they touch."""
        points = self.surfels.points_m[self.patches]
        return float(np.median(cKDTree(points).query(points, k=5)[0][:, 4])) / self.surfels.voxel_m

    def near(self, interface: Interface) -> NearInterface:
        """What shapes the base over an interface, with the rim below sides that were seen higher up only."""
        low, lit = interface.over(self.low_m), interface.over(self.lit_m)
        if not len(low):
            return NearInterface(low, lit, self.height_m)
        sides = SidesSeen.of(
            interface.over(self.surfels.points_m[self.patches]),
            self.surfels.normals[self.patches] @ interface.axes,
            middle(low),
        )
        return NearInterface(low, lit, self.height_m, sides.led_down(0.0))


def close_standing(observed: ObservedRock, interface: Interface) -> tuple[ClosedRock, float]:
    """Close the rock on the narrowest feet on which it stands, and say how narrow: it stood when it was scanned."""
    near = observed.near(interface)
    cores = CORES_OF_HOLES if observed.hint is None or not observed.hint.encloses else CORES_OF_HOLES[:1]
    for core in cores:
        base = hidden_base(near, core, observed.hint, interface=interface)
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
    places = interface.flat(rock.vertices_m)[low, :2]
    if interface.sheet is not None:  # where plumb lines through them pierce the plane, as that of the weight
        places = interface.projected_m(rock.vertices_m[low])
    try:
        hull = ConvexHull(places)
    except (QhullError, ValueError):  # in one line, or fewer than three
        return np.inf
    projected = interface.projected_m(rock.com_m[None])[0]
    return float((hull.equations[:, :2] @ projected + hull.equations[:, 2]).max())


def stands(rock: Rock, interface: Interface) -> bool:
    """Whether the rock stays up by itself."""
    if not interface.is_plane:
        return outside_support_m(rock, interface, CONTACT_SHARE_OF_HEIGHT) < 0.0
    return bool((toppling(rock, interface, AZIMUTHS_DEG[::3]) > 0.0).all())


def toppling(rock: Rock, interface: Interface, azimuths_deg: Array) -> Array:
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
    ground = (AZIMUTHS_DEG + 180.0) % 360.0
    if nominal_m_s2 is None:
        table = scene.quasi_static_toppling_m_s2(ground)
    else:
        at = 360.0 / len(nominal_m_s2) * np.arange(len(nominal_m_s2))
        table = [(each, float(np.interp(each, at, nominal_m_s2, period=360.0))) for each in ground]
    return [
        {"azimuth_deg": float(azimuth), "alpha_deg": float(np.rad2deg(np.arctan(value / scene.gravity_m_s2)))}
        for azimuth, (_, value) in zip(AZIMUTHS_DEG, table, strict=True)
    ]


def confidence(
    parts: Segmentation, points_m: Array, label: NDArray[np.int8], interface: Interface, height_m: float
) -> dict[str, float]:
    """How sure the split is: four numbers, each 0 to 1.

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
    alone = (sides[cKDTree(flat).query(flat, 7)[1][:, 1:]] != sides[:, None]).any(axis=1)
    reach = _BESIDE_PER_HEIGHT * height_m
    beside = pedestal[cKDTree(rock).query(pedestal, distance_upper_bound=reach)[0] < reach]
    return {
        "concave_share_of_cut": parts.concave_share,
        "crevice_seen_share": len(np.unique(sectors(beside[:, :2] - middle(rock)))) / SECTORS,
        "undisputed_share": 1.0 - float(alone.mean()),
        "runner_up": max((other[3] for other in parts.others), default=0.0) / height_m,
    }


_LEAST_CLOSED = 3
"""Fewer half samples give no spread."""
_ENOUGH = 4
"""So many half samples are enough where their spreads add next to nothing to the floors."""
_ADDS_NOTHING = 1.0 / 3.0
"""A spread of this share of its floor: joined they are 1.05 of it."""


def uncertainty(
    observed: ObservedRock,
    interface: Interface,
    core: float,
    surface: ClosedRock,
    realisations: int,
    each: Callable[[], None],
) -> dict[str, Any]:
    """Spread of the numbers over half samples of what was seen (McCarthy 1969).

    Each realisation keeps half of the points (noise and density), half of the directions around the contact for the
    interface's fit (its choice), and draws how wide the feet are in their holes. The spread of an estimate over half
    samples is that of the estimate itself. Where those of four tell next to nothing beside the floors, no more are
    drawn.

    Half samples share the reconstruction's bias, so each spread is joined in quadrature with a floor. The floors grow
    with what is invented (`cap_share`): by that share of volume and inertia, by a fifth of it of the height in the
    centre of mass, and by what this shift does to the toppling; with the share of the crown that was not seen, that of
    the height.

    core: of the feet on which the rock stands.
    surface: the rock closed from all that was seen.
    realisations: at most; 0 for none, which gives nothing.
    each: called after each.
    Returns standard deviations with their floors (`bias`), the statics' for the bare interface plane; none where fewer
    than three realisations close, and none of an interface that is given, ends below the rock or carries a surface: its
    error nobody drew.
    """
    if not realisations:
        return {}
    draw = partial(_HalfSample.drawn, observed, core, _half_fits(observed, interface))
    spreads = partial(_spreads, surface)
    closed, tried = _half_samples(draw, spreads, realisations, each)
    given = "" if observed.hint is None else "; the error of the interface that is given is not in them"
    found: dict[str, Any] = {"method": f"half samples{given}", "realisations": tried, "closed": len(closed)}
    if len(closed) < _LEAST_CLOSED:
        return found
    return found | _told(closed, spreads(closed), surface)


@dataclass(frozen=True, eq=False)
class _HalfSample:
    """A rock closed from half of what was seen, its interface, and what topples it by azimuth (`AZIMUTHS_DEG`)."""

    rock: Rock
    interface: Interface
    limits_m_s2: Array

    @classmethod
    def drawn(
        cls, observed: ObservedRock, core: float, half_fitted: "_HalfFit", rng: np.random.Generator
    ) -> "_HalfSample":
        """Close a half sample; InputError if it leaves too little."""
        plane = half_fitted(rng)
        drawn = float(np.clip(core + rng.uniform(-0.2, 0.2), 0.0, 0.9))
        near = observed.near(plane)
        near = replace(near, low=_half(near.low, rng), lit=_half(near.lit, rng))
        base = hidden_base(near, drawn, observed.hint, rng, plane)
        kept = observed.patches & (rng.random(len(observed.patches)) < 0.5)
        rock = close_rock(observed.surfels, kept, base, plane, COARSE_DEPTH).rock
        return cls(rock, plane, toppling(rock, plane, AZIMUTHS_DEG))


_HalfFit = Callable[[np.random.Generator], Interface]


def _half_fits(observed: ObservedRock, interface: Interface) -> _HalfFit:
    """What fits the interface in half of the directions around the contact; it refuses, not this, what has no rim."""
    if observed.hint is not None or not interface.is_bare:
        return lambda _: interface

    @cache
    def seen_beside() -> tuple[Array, Indices]:
        places = observed.surfels.points_m[lining(observed.surfels, observed.patches)]
        return places, sectors(interface.flat(places)[:, :2] - middle(interface.flat(observed.low_m)))

    def half_fitted(rng: np.random.Generator) -> Interface:
        places, sector = seen_beside()
        return plane_of_lining(places[np.isin(sector, rng.choice(SECTORS, SECTORS // 2, replace=False))])

    return half_fitted


Spreads = dict[str, tuple[Array, Array]]
"""By a number's name in the report: its standard deviation over half samples, and the floor of what they share."""


def _half_samples(
    draw: Callable[[np.random.Generator], _HalfSample],
    spreads: Callable[[list[_HalfSample]], Spreads],
    realisations: int,
    each: Callable[[], None],
) -> tuple[list[_HalfSample], int]:
    """Half samples that closed, and how many were tried: fewer where more would tell nothing."""
    closed: list[_HalfSample] = []
    for number in range(realisations):
        if len(closed) >= _ENOUGH and adds_nothing(spreads(closed)):
            for _ in range(number, realisations):
                each()
            return closed, number
        rng = np.random.default_rng([2017, number])
        with contextlib.suppress(InputError):  # counted: a half sample may leave too little
            closed.append(draw(rng))
        each()
    return closed, realisations


def adds_nothing(spreads: Spreads) -> bool:
    """Whether each number's spread over half samples, rms of its parts, is small beside its floor."""
    norms = ((np.linalg.norm(spread), np.linalg.norm(floor)) for spread, floor in spreads.values())
    return all(bool(spread <= _ADDS_NOTHING * floor) for spread, floor in norms)


def _spreads(surface: ClosedRock, closed: list[_HalfSample]) -> Spreads:
    rocks, floor = [each.rock for each in closed], bias_floors(surface)
    height = float(np.mean([rock.height_m for rock in rocks]))
    volume = np.array([rock.volume_m3 for rock in rocks])
    inertia = np.array([rock.inertia_per_mass_m2 for rock in rocks])
    radius = np.sqrt(np.diag(inertia.mean(axis=0)))
    tipped = _tipped(closed, surface.invented_share)
    limits = np.array([each.limits_m_s2 for each in closed])
    finite = np.where(np.isfinite(limits), limits, np.nan)
    alpha = np.rad2deg(np.arctan(limits / STANDARD_GRAVITY_M_S2))
    # tan(alpha) = a / g: d alpha = sin(alpha) cos(alpha) da / a = cos(alpha)^2 da / g
    angle = np.deg2rad(alpha.mean(axis=0))
    return {
        "volume_std_m3": (_std(volume), np.asarray(floor["volume_share"] * volume.mean())),
        "com_std_m": (_std([rock.com_m for rock in rocks]), np.full(3, floor["com_per_height"] * height)),
        "inertia_per_mass_std_m2": (_std(inertia), floor["inertia_share"] * np.outer(radius, radius)),
        "height_std_m": (_std([rock.height_m for rock in rocks]), np.asarray(floor["height_share"] * height)),
        "quasi_static_toppling_m_s2": (
            np.nanstd(finite, axis=0, ddof=1),
            np.hypot(floor["toppling_share"] * np.nanmean(finite, axis=0), STANDARD_GRAVITY_M_S2 * tipped),
        ),
        "slenderness": (
            _std(alpha),
            np.rad2deg(
                np.hypot(0.5 * floor["toppling_share"] * np.sin(2.0 * angle), np.cos(angle) ** 2 * tipped)
            ),
        ),
    }


def _tipped(closed: list[_HalfSample], invented_share: float) -> float:
    """Part of the error of a / g that comes from what is invented.

    a / g is the arm over the height of the centre of mass: a shift moves it by as much over that height.
    """
    height = float(np.mean([each.rock.height_m for each in closed]))
    raised = [each.interface.flat(each.rock.com_m[None])[0, 2] for each in closed]
    return INVENTED_COM_PER_HEIGHT * cap_share(invented_share) * height / float(np.mean(raised))


def _told(closed: list[_HalfSample], spreads: Spreads, surface: ClosedRock) -> dict[str, Any]:
    """Standard deviations joined with their floors, as the report has them."""
    planes = [each.interface for each in closed]
    normals = np.array([plane.normal for plane in planes])
    tilt = np.rad2deg(np.linalg.norm(normals - normals.mean(axis=0), axis=1))
    tilt_std = float(np.sqrt((tilt**2).sum() / (len(tilt) - 1)))
    joined = {name: np.hypot(spread, floor).tolist() for name, (spread, floor) in spreads.items()}
    limits, angles = joined.pop("quasi_static_toppling_m_s2"), joined.pop("slenderness")
    return {
        "bias": bias_floors(surface) | {"toppling_over_gravity": _tipped(closed, surface.invented_share)},
        **joined,
        **({"interface_normal_std_deg": tilt_std} if len(set(planes)) > 1 else {}),
        "quasi_static_toppling_m_s2": [
            {"azimuth_deg": float(a), "std": std} for a, std in zip(AZIMUTHS_DEG, limits, strict=True)
        ],
        "slenderness": [
            {"azimuth_deg": float((a + 180.0) % 360.0), "alpha_std_deg": std}
            for a, std in zip(AZIMUTHS_DEG, angles, strict=True)
        ],
    }


def _half(points: Array, rng: np.random.Generator) -> Array:
    return points[rng.random(len(points)) < 0.5]


def _std(values: Any) -> Array:
    return np.std(np.asarray(values, float), axis=0, ddof=1)
