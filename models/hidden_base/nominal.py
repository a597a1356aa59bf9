"""The base on which a scanned scene itself stands: its smooth closing, or the draw nearest to the draws' median."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import cKDTree

from toppling.models.arrays import Array, Indices
from toppling.models.frames import STANDARD_GRAVITY_M_S2
from toppling.models.ground.body import GroundedBody
from toppling.models.hidden_base.draws import BaseDraw, UnseenBase
from toppling.models.hidden_base.evidence import Pulls, fits
from toppling.models.hidden_base.from_scan import AZIMUTHS_DEG, DrawnBases
from toppling.models.hidden_base.inspection import Inspection
from toppling.models.hidden_base.statics import FRICTION, carried
from toppling.models.hidden_base.underside import LEAST_GAP_PER_HEIGHT, Base
from toppling.models.kept import kept
from toppling.models.pedestal import Pedestal
from toppling.models.rock import Rock
from toppling.models.scan.crevice import grid_triangles
from toppling.models.scan.interface import Interface, between_nodes, lattice
from toppling.models.scan.measure import toppling
from toppling.models.statics import equilibrium_possible

_AROUND_LATTICES = 12.0
"""Distance beyond the rim over which a rock is tipped on the surface."""

Planes = Array
"""(k, 3): heights h = a + b u + c v."""
_ROUNDING = 1e-6
"""Share of the height within which a vertex lies in the base that closed the rock."""


def bases_on_surface(
    drawn: DrawnBases,
    rock: Rock,
    base: Base,
    interface: Interface,
    height_m: float,
    *,
    as_closed: bool = False,
) -> tuple[Rock, UnseenBase, int | None]:
    """The rock on the draw nearest to the draws' median, all draws for it, and which one that is.

    rock: closed with `base`.
    interface: with a surface.
    height_m: of the rock.
    as_closed: the rock stays as it was closed.
    Returns Rock, UnseenBase, int or None: None where the rock stays as it was closed, or is at rest on none of the
    draws; it then does so too.
    """
    numbers = _base_vertices(rock, base, interface, height_m)
    places = [_moved(rock.vertices_m[numbers], drawn, gap.gap_m, interface) for gap in drawn.gaps]
    nominal = None
    likeliest = np.argsort(drawn.apart(drawn.toppling_m_s2), kind="stable").tolist()
    for number in [] if as_closed else likeliest:
        vertices = rock.vertices_m.copy()
        vertices[numbers] = interface.scene(places[number])
        standing = Rock.from_triangles(vertices, rock.faces, where="closed rock")
        ground = surface_of(interface)
        body = GroundedBody.of(standing, ground, STANDARD_GRAVITY_M_S2, (FRICTION, FRICTION))
        if body.stands(body.touching(body.pose)):
            rock, nominal = standing, number
            break
    draws = [
        BaseDraw(interface.support(interface.scene(place)), com_m - rock.com_m)
        for place, com_m in zip(places, drawn.com_m, strict=True)
    ]
    return rock, UnseenBase(0.0, tuple(draws), vertices=numbers), nominal


def _base_vertices(rock: Rock, base: Base, interface: Interface, height_m: float) -> Indices:
    """Numbers of the rock's vertices that lie in the hidden part of its base."""
    over = interface.over(rock.vertices_m)
    closed = between_nodes(
        over[:, :2], interface.lattice_m, lambda nodes: np.asarray(base.grid.at(base.height_m, nodes))
    )
    hidden = base.hidden.ravel()[base.grid.index(over)]
    return np.flatnonzero(hidden & (np.abs(over[:, 2] - closed) < _ROUNDING * height_m))


def _moved(vertices_m: Array, drawn: DrawnBases, gap_m: Array, interface: Interface) -> Array:
    """Vertices of the base as u, v and height over the plane, with the gap of a draw."""
    flat, places = interface.flat(vertices_m), drawn.part.observed.places_m
    gap = LinearNDInterpolator(places, gap_m)(flat[:, :2])
    gap = np.where(np.isfinite(gap), gap, NearestNDInterpolator(places, gap_m)(flat[:, :2]))
    touching = np.flatnonzero(gap_m <= 0.0)
    gap[cKDTree(flat[:, :2]).query(places[touching])[1]] = 0.0
    moved = np.column_stack([flat[:, :2], gap])
    return moved + interface.rise(moved)


@kept
def surface_of(interface: Interface) -> Pedestal:
    """The pedestal below a rock as its interface describes it: the carried surface as a mesh, or the endless plane."""
    sheet = interface.sheet
    if sheet is None:
        return Pedestal(interface.point_m, interface.normal)
    reach = _AROUND_LATTICES * sheet.lattice_m
    nodes = lattice(sheet, sheet.ring_m.min(axis=0) - reach, sheet.ring_m.max(axis=0) + reach)
    flat = np.column_stack([nodes.reshape(-1, 2), sheet.at(nodes).ravel()])
    return Pedestal(
        interface.point_m, interface.normal, interface.scene(flat), grid_triangles(nodes.shape[:2])
    )


_FRICTION = 0.8
"""With which the nominal rock must stand as scanned."""
_SMOOTH_IS_LIKELY = 0.25
"""Mean deviation of a smooth closing's toppling acceleration from the draws' median; with more the base bulges."""
_NEARLY_ALL = 0.75
"""Share of the azimuths at which the nominal scene topples within the interval; true flat bases do at .79 and more of
them, but for one."""
FLAT_MARGIN = 0.1
"""Share of the median by which a smooth closing may exceed the interval, but for the least azimuths, where no hint says
otherwise: on known flat bases, to which it is true, the draws topple too easily by 5 to 12 %."""


def nominal_draw(
    drawn: DrawnBases,
    unseen: UnseenBase,
    rock: Rock,
    interface: Interface,
    smooth_m_s2: Array,
    smooth_fits: bool | None = None,
    pulls: Pulls = (),
) -> tuple[int | None, bool]:
    """Draw on whose feet the scene stands, and whether the rock is at rest there; None for the smooth closing's feet.

    The smooth closing is nearest to the truth of a flat base, whereas on one that bulges the rock stands too broadly:
    it is taken where its toppling acceleration toward AZIMUTHS_DEG (`smooth_m_s2`) is one that the draws give too, the
    least one included, and where it fits what was seen by inspection (`smooth_fits`; None where nothing was).
    Otherwise the draw nearest to the draws' median is taken, of those on which the rock, with its own centre of mass,
    topples within their interval; if there is none, the nearest one.
    """
    plane = Pedestal(interface.point_m, interface.normal)
    rock = carried(rock, interface)

    def at_rest(standing: Rock) -> bool:
        return bool(equilibrium_possible(standing, plane, STANDARD_GRAVITY_M_S2, _FRICTION, np.zeros(3))[0])

    margin = FLAT_MARGIN if smooth_fits is None else 0.0
    if smooth_is_likely(drawn, smooth_m_s2, margin) and smooth_fits is not False and at_rest(rock):
        return None, True
    second: int | None = None
    for number in np.argsort(drawn.apart(drawn.toppling_m_s2), kind="stable").tolist():
        standing = unseen.on_feet_of(rock, plane, number)
        if not at_rest(standing):
            continue
        if _within_interval(drawn, toppling(standing, interface, AZIMUTHS_DEG)) and fits(
            pulls, _borne_ratios(standing, interface, pulls)
        ):
            return number, True
        second = number if second is None else second
    return second, second is not None


def smooth_is_likely(drawn: DrawnBases, smooth_m_s2: Array, margin: float) -> bool:
    """Whether a smooth closing's toppling acceleration is one that the draws give too."""
    near = bool(drawn.apart(smooth_m_s2) < _SMOOTH_IS_LIKELY)
    return near and _within_interval(drawn, smooth_m_s2, margin)


def _within_interval(drawn: DrawnBases, toppling_m_s2: Array, margin: float = 0.0) -> bool:
    """Whether toppling accelerations (azimuths,) lie within the draws' interval nearly everywhere.

    At the azimuth at which least topples, of the draws and of what is asked, they must; elsewhere they may exceed it by
    a margin, as share of the median.
    """
    low, median, high = drawn.interval_m_s2()
    within = (low <= toppling_m_s2) & (toppling_m_s2 <= high)
    nearly = (low <= toppling_m_s2) & (toppling_m_s2 <= high + margin * median)
    least = [median.argmin(), toppling_m_s2.argmin()]
    return bool(nearly.mean() >= _NEARLY_ALL and within[least].all())


def _borne_ratios(rock: Rock, interface: Interface, pulls: Pulls) -> Array:
    """Largest forces over the weight (pulls,) that a rock bears toward the azimuths of pulls."""
    toward = np.array([(azimuth + 180.0) % 360.0 for azimuth, _ in pulls])
    return toppling(rock, interface, toward) / STANDARD_GRAVITY_M_S2 if len(toward) else toward


def smooth_fits_inspection(
    rock: Rock, base: Base, interface: Interface, inspection: Inspection, height_m: float
) -> bool:
    """Whether a smooth closing touches where rock and pedestal do, is open where light passes, and bears the pulls."""
    touch_m, open_m = (
        base.grid.at(base.height_m, interface.over(places)[:, :2])
        for places in (inspection.touching_m, inspection.open_m)
    )
    least_m = 0.5 * LEAST_GAP_PER_HEIGHT * height_m
    return bool(
        (touch_m < least_m).all()
        and (open_m >= least_m).all()
        and fits(inspection.pulls, _borne_ratios(rock, interface, inspection.pulls))
    )
