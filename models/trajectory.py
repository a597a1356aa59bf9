"""Trajectory of a rock during a shake, as arrays."""

from dataclasses import dataclass

from toppling.models.arrays import Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a rock relative to its pedestal."""

    time_s: Array  # (n,)
    position_m: Array  # (n, 3): centre of mass, scene frame
    # (n, 4): rotation to the current pose in scene axes, from the pose in which the rock was seated, or from that of
    # the scene if its start was given.
    quaternion_xyzw: Array
