"""The rock as a plane body on two points: the study's two-dimensional reference, drawn over its maps.

    python examples/plane_sections.py demo/scene demo/ensemble runs/study/figures/main

In each direction the section through the centre of mass rocks about the two points where it cuts the edge of the
contact, without slip or bounce (Housner 1963, Yim et al. 1980), under each record's component along its vector PGA.
Lines are of 1 and 99 % toppling, by a probit in PGA and PGV/PGA: a surrogate, no published relation. Of cells, the
folder holds those of `toppling fragility`.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from scipy.optimize import minimize
from scipy.spatial import ConvexHull
from scipy.special import log_ndtr, ndtri

from toppling import Ensemble, Scene

_STEP_S = 0.005
_STILL_S = 10.0
"""Still ground after a record, in which a rocking body falls or comes to rest."""


def section(scene: Scene, azimuth_deg: float) -> tuple[np.ndarray, float]:
    """Arms (2, 2) from the right and left point to the centre of mass, along and up, and inertia per mass about it."""
    turn, rock = np.deg2rad(azimuth_deg), scene.rock
    along, across = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0]])
    gap = (rock.vertices_m - scene.pedestal.point_m) @ scene.pedestal.normal
    contact = rock.vertices_m[gap <= gap.min() + 0.01 * rock.height_m] - rock.com_m
    corners = contact[ConvexHull(contact[:, :2]).vertices]
    ends, side = np.roll(corners, -1, axis=0), corners @ across
    cut = (side < 0) != (ends @ across < 0)
    share = side[cut] / (side - ends @ across)[cut]
    points = corners[cut] + share[:, None] * (ends - corners)[cut]
    place = np.array(sorted(zip(points @ along, points[:, 2], strict=True)))
    return -place[::-1], float(across @ rock.inertia_per_mass_m2 @ across)


def along_peak(ensemble: Ensemble) -> np.ndarray:
    """Acceleration (n, 2, records) along the vector PGA and up, over the PGA, at steps of `_STEP_S`; still behind."""
    records = [ensemble.record(name).motion for name in ensemble.record_ids]
    times_s = np.arange(0.0, max(motion.duration_s for motion in records) + _STILL_S, _STEP_S)
    unit = np.empty((len(times_s), 2, len(records)))
    for number, motion in enumerate(records):
        flat = motion.acceleration_m_s2[:, :2]
        size = np.hypot(*flat.T)
        peak = size.argmax()
        for part, values in enumerate((flat @ flat[peak] / size[peak], motion.acceleration_m_s2[:, 2])):
            unit[:, part, number] = np.interp(times_s, motion.time_s, values / size[peak], right=0.0)
    return unit


def topples(
    arms_m: np.ndarray, inertia: float, unit: np.ndarray, pga_m_s2: np.ndarray, gravity: float
) -> np.ndarray:
    """Whether a section turns by a right angle under each motion (n, 2, records) scaled to each PGA (k,)."""
    inertia_at = inertia + (arms_m**2).sum(axis=1)
    loss = np.clip(
        (inertia + arms_m[0] @ arms_m[1]) / inertia_at, 0.0, 1.0
    )  # of the rate, as it lands on a point
    angle, rate = np.zeros((2, unit.shape[2], len(pga_m_s2)))
    for push, lift in unit[..., None] * pga_m_s2:
        down = gravity + lift
        right, left = (arm[0] * down - arm[1] * push for arm in arms_m)  # moments about both points
        rests = (angle == 0.0) & (rate == 0.0)
        # At rest a point lifts off when the moment about the other one turns the body away from it.
        about = np.where(rests, left < 0, (angle < 0) | ((angle == 0) & (rate < 0))).astype(int)
        x, z = np.moveaxis(arms_m[about], -1, 0)
        sine, cosine = np.sin(angle), np.cos(angle)
        torque = (x * cosine + z * sine) * down - (z * cosine - x * sine) * push
        torque[rests & (right <= 0) & (left >= 0)] = 0.0
        rate = rate + _STEP_S * torque / inertia_at[about]
        new = angle + _STEP_S * rate
        lands = angle * new < 0
        rate = np.where(lands, rate * loss[1 - about], rate)
        # What gravity undoes in one step counts as rest.
        other = np.abs(np.where(about == 0, left, right)) / inertia_at[1 - about]
        rate[lands & (np.abs(rate) < _STEP_S * other)] = 0.0
        angle = np.where(lands, 0.0, new)
        fallen = np.abs(angle) > np.pi / 2
        angle[fallen], rate[fallen] = np.sign(angle[fallen]) * 3.0, 0.0
    return np.abs(angle) > np.pi / 2


def lines(scene: Scene, ensemble: Ensemble, levels: np.ndarray, azimuths_deg: np.ndarray) -> pd.DataFrame:
    """PGA of 1 and of 99 % toppling by PGV/PGA and azimuth."""
    pulse_s, unit = ensemble.catalog["pgv_pga_s"].to_numpy(), along_peak(ensemble)
    at_s, found = np.geomspace(pulse_s.min(), pulse_s.max(), 60), []
    pga, pulse = np.log(np.tile(levels, len(pulse_s))), np.log(np.repeat(pulse_s, len(levels)))
    design = np.column_stack([np.ones(len(pga)), pga, pulse])
    for azimuth in azimuths_deg:
        answers = topples(*section(scene, azimuth), unit, levels, scene.gravity_m_s2).ravel()
        share = np.clip(answers, 1e-6, 1.0 - 1e-6)  # so that answers which a line separates have a fit too

        def loss(c: np.ndarray, share: np.ndarray = share) -> float:
            return -float(share @ log_ndtr(design @ c) + (1.0 - share) @ log_ndtr(-design @ c))

        intercept, on_pga, on_pulse = minimize(loss, [0.0, 1.0, 0.0]).x
        for probability in (0.01, 0.99):
            pga_m_s2 = np.exp((ndtri(probability) - intercept - on_pulse * np.log(at_s)) / on_pga)
            columns = {"azimuth_deg": azimuth, "pgv_pga_s": at_s, "probability": probability}
            found.append(pd.DataFrame(columns | {"pga_m_s2": pga_m_s2}))
    return pd.concat(found, ignore_index=True)


def draw(scene: Scene, ensemble: Ensemble, maps: Path) -> None:
    """Draw the lines over the cells of each direction, and write them as a table."""
    cells = pd.read_csv(maps / "pga_pgv_pga_by_direction.csv")
    azimuths_deg = cells["direction_deg"].unique()
    table = lines(scene, ensemble, cells["level_pga_m_s2"].unique(), azimuths_deg)
    table.to_csv(maps / "plane_sections.csv", index=False)
    columns = min(4, len(azimuths_deg))
    figure, panels = plt.subplots(
        -(-len(azimuths_deg) // columns), columns, figsize=(7.0, 5.0), sharex=True, sharey=True, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axes, azimuth in zip(panels.flat, azimuths_deg, strict=False):
        there = cells[cells["direction_deg"] == azimuth]
        shown = axes.scatter(
            there["pgv_pga_s_low"], there["level_pga_m_s2"], c=there["probability"], vmin=0, vmax=1
        )
        for probability, line in table[table["azimuth_deg"] == azimuth].groupby("probability"):
            axes.plot(line["pgv_pga_s"], line["pga_m_s2"], "k-" if probability > 0.5 else "k--", lw=1.0)
        axes.set(title=f"{azimuth:g}°", ylim=(0.0, 1.1 * cells["level_pga_m_s2"].max()))
    figure.supxlabel("PGV/PGA (s)")
    figure.supylabel("PGA (m/s²); lines: a plane section topples with 1 % (dashed) and 99 %")
    figure.colorbar(shown, ax=panels, label="toppling probability")
    figure.savefig(maps / "plane_sections.png", dpi=150)


if __name__ == "__main__":
    draw(Scene.load(sys.argv[1]), Ensemble.load(sys.argv[2]), Path(sys.argv[3]))
