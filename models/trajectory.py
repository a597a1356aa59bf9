"""A rock's way through a shake, as plain arrays."""

from dataclasses import dataclass

from toppling.models.arrays import Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a rock relative to its pedestal."""

    time_s: Array  # (n,)
    position_m: Array  # (n, 3): centre of mass, scene frame
    # (n, 4): rotation to the present pose, scene axes: from that in which the rock was seated, or, where its
    # start was given, from that of the scene.
    quaternion_xyzw: Array
