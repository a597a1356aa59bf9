"""Two-dimensional reference model of the maps: the rock as a plane body on two contact points.

The section is the vertical plane through the centre of mass along an azimuth; the contact points are where
it cuts the edge of the support, the section's two outermost (Veeraraghavan, Hudnut and Krishnan, figure 7).
The body rocks without slip or bounce (Housner 1963, Yim et al. 1980), shaken by each record's component along its
vector PGA, and a probit surface in PGA and PGV/PGA is fitted to the answers. It is a surrogate of this project, not a
published relation.
"""

import logging
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri

from toppling.models.arrays import Array
from toppling.models.frames import horizontal_unit_vector
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.models.statics import support_polygon_m
from toppling.results.analysis.lognormal import Fit, fit, softened

_log = logging.getLogger(__name__)

TIME_STEP_S = 0.005
"""Time step of the rocking integration, s."""
_SETTLING_S = 10.0
"""Duration of still ground after the record, in which a rocking body falls or comes to rest, s."""
_QUIET_FRACTION = 0.01
"""Fraction of the PGA below which motion before and after the strong shaking is cut off."""
_RECORDS_AT_ONCE = 20
"""Number of records that are integrated together, which bounds memory."""
_MEASURES = ("pga_m_s2", "pgv_pga_s")


@dataclass(frozen=True, eq=False)
class _Section:
    azimuth_deg: float  # of the section's positive direction
    # (2, 2): from corner to centre of mass, horizontal and up; first the corner on the positive side.
    arms_m: Array
    inertia_per_mass_m2: float  # about the centre of mass, axis perpendicular to the section
    offset_m: float = 0.0  # largest distance of a contact point from the plane that it is projected into


def section_along(scene: Scene, azimuth_deg: float) -> _Section | None:
    """Vertical section of a scene through the centre of mass.

    The contact points are where the section's plane cuts the edge of the support. Where it does not on one side of the
    centre of mass (a rock that does not rest as the scan found it), they are the two outermost contact points along the
    section, projected into its plane. None where the centre of mass is not between these either.
    """
    contacts = support_polygon_m(scene.rock, scene.pedestal) - scene.rock.com_m
    along = horizontal_unit_vector(azimuth_deg)
    across = horizontal_unit_vector(azimuth_deg + 90.0)
    place = _crossings(contacts, along, across)
    offset_m = 0.0
    if place is None:
        outermost = contacts[[(contacts @ along).argmin(), (contacts @ along).argmax()]]
        place = np.column_stack([outermost @ along, outermost[:, 2]])
        offset_m = float(np.abs(outermost @ across).max())
        if not place[0, 0] < 0 < place[1, 0]:
            return None
    left, right = place
    inertia = float(across @ scene.rock.inertia_per_mass_m2 @ across)
    return _Section(azimuth_deg, np.array([-right, -left]), inertia, offset_m)


def _crossings(contacts: Array, along: Array, across: Array) -> Array | None:
    """Points (2, 2; along and up) where a section cuts the support's edge; None if not on both sides of the origin."""
    if len(contacts) < 3:
        return None
    start, end = contacts, np.roll(contacts, -1, axis=0)
    side, next_side = start @ across, end @ across
    cut = (side < 0) != (next_side < 0)
    if cut.sum() != 2:
        return None
    share = (side[cut] / (side[cut] - next_side[cut]))[:, None]
    crossing = start[cut] + share * (end[cut] - start[cut])
    place = np.column_stack([crossing @ along, crossing[:, 2]])
    place = place[np.argsort(place[:, 0])]
    return place if place[0, 0] < 0 < place[1, 0] else None


def topples(
    arms_m: Array, inertia: Array, unit: Array, record: NDArray[np.intp], pga_m_s2: Array, gravity_m_s2: float
) -> NDArray[np.bool_]:
    """Integrate the rocking of plane bodies, each under its own motion.

    arms_m: (n, 2, 2), `_Section.arms_m` of each body.
    inertia: (n,), `_Section.inertia_per_mass_m2` of each body.
    unit: (k, 2, m), ground acceleration along the section and up over PGA, of m records at k steps of
    `TIME_STEP_S`.
    record: (n,), index of the record that shakes each body.
    pga_m_s2: (n,), PGA that it is scaled to.
    Returns (n,) bool array: whether the body has turned by a right angle.
    """
    squared = (arms_m**2).sum(axis=2)
    inertia_at = inertia[:, None] + squared
    ratio = np.clip((inertia + (arms_m[:, 0] * arms_m[:, 1]).sum(axis=1))[:, None] / inertia_at, 0.0, 1.0)
    angle, rate = np.zeros(len(inertia)), np.zeros(len(inertia))
    pick = np.arange(len(inertia))
    for step in unit:
        push, lift = step[:, record] * pga_m_s2
        down = gravity_m_s2 + lift
        rests = (angle == 0.0) & (rate == 0.0)
        moments = arms_m[:, :, 0] * down[:, None] - arms_m[:, :, 1] * push[:, None]
        # At rest a corner lifts off when the moment about the other corner turns the body away from it.
        starts = np.where(moments[:, 0] > 0, 1, np.where(moments[:, 1] < 0, -1, 0))
        about = np.where(rests, starts < 0, (angle < 0) | ((angle == 0) & (rate < 0))).astype(int)
        x, z = arms_m[pick, about, 0], arms_m[pick, about, 1]
        sine, cosine = np.sin(angle), np.cos(angle)
        turned_x, turned_z = x * cosine + z * sine, z * cosine - x * sine
        torque = turned_x * down - turned_z * push
        torque[rests & (starts == 0)] = 0.0
        rate += TIME_STEP_S * torque / inertia_at[pick, about]
        new = angle + TIME_STEP_S * rate
        lands = angle * new < 0
        # A step that crosses zero ends on the other corner; a rate that gravity undoes in one step counts as rest.
        rate[lands] *= ratio[pick, 1 - about][lands]
        weak = lands & (
            np.abs(rate) < TIME_STEP_S * np.abs(moments[pick, 1 - about]) / inertia_at[pick, 1 - about]
        )
        rate[weak] = 0.0
        angle = np.where(lands, 0.0, new)
        fallen = np.abs(angle) > np.pi / 2
        angle[fallen], rate[fallen] = np.sign(angle[fallen]) * 3.0, 0.0
    return np.abs(angle) > np.pi / 2


def simulate(
    scene: Scene,
    ensemble: Ensemble,
    record_ids: Iterable[str],
    levels_m_s2: Iterable[float],
    azimuths_deg: Iterable[float],
) -> pd.DataFrame:
    """Simulate the plane sections along some azimuths under each record at every level.

    Returns DataFrame: one row per record, level and azimuth with a section: azimuth_deg, record_id, pga_m_s2,
    pgv_pga_s, toppled.
    """
    found = {azimuth: section_along(scene, azimuth) for azimuth in azimuths_deg}
    cuts = [cut for cut in found.values() if cut is not None]
    for sentence in notes(found):
        _log.warning("%s", sentence)
    levels = np.asarray(list(levels_m_s2), float)
    motions = sorted((_along_peak(ensemble, name) for name in record_ids), key=lambda motion: len(motion[2]))
    tables = []
    for first in range(0, len(motions), _RECORDS_AT_ONCE) if cuts else ():
        batch = motions[first : first + _RECORDS_AT_ONCE]
        steps = len(batch[-1][2]) + round(_SETTLING_S / TIME_STEP_S)
        unit = np.zeros((steps, 2, len(batch)))
        for number, (_, _, components) in enumerate(batch):
            unit[: len(components), :, number] = components
        cut, record, level = (grid.ravel() for grid in np.indices((len(cuts), len(batch), len(levels))))
        arms = np.array([section.arms_m for section in cuts])[cut]
        inertia = np.array([section.inertia_per_mass_m2 for section in cuts])[cut]
        toppled = topples(arms, inertia, unit, record, levels[level], scene.gravity_m_s2)
        tables.append(pd.DataFrame({
            "azimuth_deg": np.array([section.azimuth_deg for section in cuts])[cut],
            "record_id": np.array([name for name, _, _ in batch])[record],
            "pga_m_s2": levels[level],
            "pgv_pga_s": np.array([pulse for _, pulse, _ in batch])[record],
            "toppled": toppled,
        }))  # fmt: skip
    columns = ["azimuth_deg", "record_id", "pga_m_s2", "pgv_pga_s", "toppled"]
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=columns)


def notes(found: Mapping[float, _Section | None]) -> Iterator[str]:
    """Remarks on sections that are missing or whose contact points were projected."""
    without = [f"{azimuth:g}" for azimuth, cut in found.items() if cut is None]
    if without:
        azimuths = ", ".join(without)
        yield f"the centre of mass lies beyond all contact points along {azimuths} degrees: no plane reference there"
    if offset := {
        azimuth: cut.offset_m for azimuth, cut in found.items() if cut is not None and cut.offset_m
    }:
        listed = ", ".join(f"{azimuth:g} degrees ({offset_m:.2g} m)" for azimuth, offset_m in offset.items())
        yield f"outermost contact points outside the section are projected into it along {listed}"


def reference_lines(simulated: pd.DataFrame) -> pd.DataFrame:
    """PGA at which the plane body topples with a probability of 1 and 99 %, by PGV/PGA and azimuth.

    Returns DataFrame: azimuth_deg, pgv_pga_s, probability, pga_m_s2; an azimuth whose answers have no fit is left out.
    """
    lines = [pd.DataFrame(columns=["azimuth_deg", "pgv_pga_s", "probability", "pga_m_s2"], dtype=float)]
    for azimuth, jobs in simulated.groupby("azimuth_deg"):
        fitted: Fit = fit(jobs, _MEASURES, least_toppled=1)
        # The answers of few records may be separated by a line: a softened fit then gives a finite, steep curve.
        coefficients = softened(jobs, _MEASURES) if fitted.problem else fitted.coefficients
        if coefficients is None or coefficients[1] <= 0:
            continue
        intercept, on_pga, on_pulse = coefficients
        pulse = np.geomspace(jobs["pgv_pga_s"].min(), jobs["pgv_pga_s"].max(), 60)
        for probability in (0.01, 0.99):
            pga = np.exp((ndtri(probability) - intercept - on_pulse * np.log(pulse)) / on_pga)
            lines.append(
                pd.DataFrame(
                    {"azimuth_deg": azimuth, "pgv_pga_s": pulse, "probability": probability, "pga_m_s2": pga}
                )
            )
    return pd.concat(lines, ignore_index=True)


def _along_peak(ensemble: Ensemble, record_id: str) -> tuple[str, float, Array]:
    """Id, PGV/PGA, and components along the vector PGA and up, resampled to `TIME_STEP_S` and scaled to unit PGA."""
    record = ensemble.record(record_id)
    acceleration, step = record.motion.acceleration_m_s2, record.motion.time_step_s
    size = np.hypot(acceleration[:, 0], acceleration[:, 1])
    peak = int(size.argmax())
    along = acceleration[:, :2] @ (acceleration[peak, :2] / size[peak])
    unit = np.column_stack([along, acceleration[:, 2]]) / size[peak]
    strong = np.flatnonzero(np.abs(unit[:, 0]) > _QUIET_FRACTION)
    unit = unit[max(0, strong[0] - 1) : strong[-1] + 2]
    time = np.arange(0.0, (len(unit) - 1) * step, TIME_STEP_S)
    at = np.arange(len(unit)) * step
    resampled = np.column_stack([np.interp(time, at, part) for part in unit.T])
    return record_id, float(record.intensity["pgv_pga_s"]), resampled
