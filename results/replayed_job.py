"""Replay of one shake: scene, motion and the rock's trajectory, as numbers."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from toppling.models.arrays import Array
from toppling.models.motions.motion import Motion
from toppling.models.rock import Trajectory
from toppling.models.scene import Scene
from toppling.results.schema import described_table

STILL_FRACTION = 1e-3
"""Displacement of the centre of mass, as a fraction of the rock's height, below which the rock is at rest."""

_LEAD_S = 0.5
"""Time shown before the rock begins to move, s."""


@dataclass(frozen=True, eq=False)
class Replay:
    """A rock's trajectory under a ground motion, in the pedestal's frame."""

    scene: Scene  # in the initial pose of the trajectory
    motion: Motion  # as imposed
    trajectory: Trajectory  # quaternions rotate from the pose in the scene
    topple_time_s: float | None = None  # time of the point of no return

    @property
    def tilt_deg(self) -> Array:
        """Tilt (n,): angle between the interface's normal and the same body axis in the current pose."""
        return self.tilts_deg(self.trajectory.quaternion_xyzw)

    def tilts_deg(self, quaternion_xyzw: Array) -> Array:
        """Tilt (k,) of rotations (k, 4), relative to the trajectory's first pose."""
        turns, normal = Rotation.from_quat(quaternion_xyzw), self.scene.pedestal.normal
        first = Rotation.from_quat(self.trajectory.quaternion_xyzw[0])
        rotated = (turns * first.inv()).apply(normal)
        return np.rad2deg(np.arctan2(np.linalg.norm(np.cross(normal, rotated), axis=1), rotated @ normal))

    def ground_m_s2(self, time_s: ArrayLike) -> Array:
        """Ground acceleration (k, 3) at given times; zero after the motion."""
        times, motion = np.asarray(time_s, float), self.motion
        axes = [np.interp(times, motion.time_s, axis, right=0.0) for axis in motion.acceleration_m_s2.T]
        return np.stack(axes, axis=-1)

    def at(self, time_s: Array) -> tuple[Array, Array]:
        """Centres of mass (k, 3) and rotations (k, 4), interpolated at given times."""
        path = self.trajectory
        position = np.column_stack([np.interp(time_s, path.time_s, axis) for axis in path.position_m.T])
        times, first = np.unique(path.time_s, return_index=True)
        if len(times) < 2:
            return position, np.repeat(path.quaternion_xyzw[:1], len(time_s), axis=0)
        turns = Slerp(times, Rotation.from_quat(path.quaternion_xyzw[first]))
        return position, turns(np.clip(time_s, times[0], times[-1])).as_quat()

    def shown_s(self) -> tuple[float, float]:
        """Start and end of the part in which the rock moves; the whole motion where it stays at rest."""
        path = self.trajectory
        off = np.linalg.norm(path.position_m - path.position_m[0], axis=1)
        moving = np.flatnonzero(off > STILL_FRACTION * self.scene.rock.height_m)
        if not len(moving):
            return 0.0, max(float(path.time_s[-1]), self.motion.duration_s)
        return max(float(path.time_s[moving[0]]) - _LEAD_S, 0.0), float(path.time_s[-1])


def trajectory_table(replay: Replay) -> pa.Table:
    """Trajectory as a table, one row per pose, with units and descriptions in the fields' metadata."""
    path = replay.trajectory
    ground = replay.ground_m_s2(path.time_s)
    velocity = replay.motion.velocity_at(path.time_s)
    off = path.position_m - path.position_m[0]
    columns: list[tuple[str, Array, str, str]] = [
        ("time_s", path.time_s, "s", "time from the start of the motion"),
        *_three("com_{}_m", path.position_m, "m", "centre of mass in the pedestal's frame"),
        *(
            (f"turn_{axis}", part, "1", f"quaternion from the pose at the start, {axis}")
            for axis, part in zip("xyzw", path.quaternion_xyzw.T, strict=True)
        ),
        (
            "tilt_deg",
            replay.tilt_deg,
            "deg",
            "angle between the interface's normal and where the rock carried it",
        ),
        ("displacement_m", np.hypot(*off.T[:2]), "m", "displacement of the centre of mass, horizontal"),
        *_three("ground_{}_m_s2", ground, "m/s2", "acceleration of the ground"),
        *_three("ground_{}_m_s", velocity, "m/s", "velocity of the ground"),
    ]
    return described_table((name, pa.array(values), unit, text) for name, values, unit, text in columns)


def _three(name: str, values: Array, unit: str, text: str) -> list[tuple[str, Array, str, str]]:
    axes = (("x", "east"), ("y", "north"), ("z", "up"))
    return [
        (name.format(axis), part, unit, f"{text}, {toward}")
        for (axis, toward), part in zip(axes, values.T, strict=True)
    ]
