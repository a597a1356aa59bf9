"""Rocks of the virtual scanner that several tests scan."""

from toppling.models.scan import virtual, virtual_shapes


def stump_on_a_slope():
    """A boulder of 2 m with bumps, on a pedestal that dips 6 degrees."""
    return virtual.on_slope(
        virtual_shapes.boulder(2.0, 1.3, 1.0, 3, bumps=0.02, sides=64),
        virtual_shapes.ground(5.0, 0.7, 3, bumps_m=0.1), 6.0, 250.0,
    )  # fmt: skip
