"""The response of a rock to one sawtooth of velocity (Veeraraghavan, Hudnut and Krishnan 2017, figure 8).

    python examples/pulse.py demo/scene --azimuth 135 --out pulse.png

The velocity of the ground rises to PGV in a quarter of the period, falls to -PGV in a half of it and returns to rest.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from toppling import Motion, Scene, shake

TIME_STEP_S = 0.005
RESPONSE_S = 6.0
"""How long the response is followed after the pulse."""


def sawtooth(pgv_m_s: float, period_s: float, azimuth_deg: float) -> Motion:
    """Accelerations of +-4 PGV / period, whose velocity reaches PGV, along an azimuth."""
    time_s = np.arange(0.0, period_s + RESPONSE_S, TIME_STEP_S)
    velocity = np.interp(time_s / period_s, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])
    acceleration = np.gradient(velocity, TIME_STEP_S)
    reached = np.abs(np.cumsum(0.5 * TIME_STEP_S * (acceleration[1:] + acceleration[:-1]))).max()
    azimuth = np.radians(azimuth_deg)
    return Motion(
        np.outer(pgv_m_s / reached * acceleration, [np.cos(azimuth), np.sin(azimuth), 0.0]), TIME_STEP_S
    )


def tilt_deg(quaternion_xyzw: np.ndarray) -> np.ndarray:
    """Angle between the vertical and where each rotation carries it."""
    x, y = quaternion_xyzw[:, 0], quaternion_xyzw[:, 1]
    return np.degrees(np.arccos(np.clip(1.0 - 2.0 * (x**2 + y**2), -1.0, 1.0)))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("--pgv", type=float, default=5.0, help="m/s")
    parser.add_argument("--period", type=float, default=3.5, help="s")
    parser.add_argument("--azimuth", type=float, default=135.0, help="degrees counter-clockwise from east")
    parser.add_argument("--out", type=Path, default=Path("pulse.png"))
    asked = parser.parse_args()
    scene, motion = Scene.load(asked.scene), sawtooth(asked.pgv, asked.period, asked.azimuth)
    result = shake(scene, motion, trajectory=True)
    moved = result.trajectory
    assert moved is not None  # it was asked for
    azimuth = np.radians(asked.azimuth)
    along = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    figure, (ground, tilt, path) = plt.subplots(3, 1, figsize=(4.5, 5.0), sharex=True, layout="constrained")
    ground.plot(motion.time_s, motion.velocity_at(motion.time_s) @ along, color="0.2")
    ground.set(ylabel="ground velocity (m/s)")
    tilt.plot(moved.time_s, tilt_deg(moved.quaternion_xyzw), color="0.2")
    tilt.set(ylabel="tilt (°)")
    path.plot(moved.time_s, (moved.position_m - moved.position_m[0]) @ along, color="0.2")
    path.set(ylabel="centre of mass,\nrelative to the ground (m)", xlabel="time (s)")
    title = f"PGV {asked.pgv:g} m/s, period {asked.period:g} s,\nazimuth {asked.azimuth:g}°: {result.outcome}"
    ground.set_title(title)
    figure.savefig(asked.out, dpi=150)
    print(f"{result.outcome}, largest tilt {result.max_tilt_deg:.1f} degrees; {asked.out}")


if __name__ == "__main__":
    main()
