"""A rock's way through a shake, as plain arrays."""

from dataclasses import dataclass

from toppling.models.arrays import Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of a rock relative to its pedestal.

    Parameters
    ----------
    time_s : (n,) array
    position_m : (n, 3) array
        Centre of mass, scene frame.
    quaternion_xyzw : (n, 4) array
        Rotation to the present pose, scene axes: from that in which the rock was seated, or, where its start was given,
        from that of the scene.
    """

    time_s: Array
    position_m: Array
    quaternion_xyzw: Array
