"""Scans that tests share, each made once: a stump as tripods see it, the same without clutter, and its survey."""

import numpy as np
import pytest
from virtual_rocks import drawing_few, stump_on_a_slope

from toppling.models.scan import virtual
from toppling.models.scan.survey import survey


@pytest.fixture(scope="session")
def stump():
    """A stump on a slope: the truth, its cloud from five stations, and each point's true label."""
    truth = stump_on_a_slope()
    seen = virtual.scan_around(truth, seed=1, stations=5, resolution_per_height=0.02)
    return truth, *virtual.cloud_of(seen, virtual.DEMO_ORIGIN_M)


@pytest.fixture(scope="session")
def surveyed(stump):
    """What the survey makes of it, with few draws of the base."""
    with drawing_few():
        return survey(stump[1])


@pytest.fixture(scope="session")
def bare():
    """A coarser stump seen from five stations without clutter: the scans, and their cloud."""
    rock, ground = (
        virtual.boulder(2.0, 1.3, 1.0, 3, bumps=0.02, sides=48),
        virtual.ground(5.0, 0.7, 3, bumps_m=0.1, cells=80),
    )
    truth = virtual.on_slope(rock, ground, 6.0, 250.0)
    seen = virtual.scan_around(truth, 1, stations=5, resolution_per_height=0.025, clutter=False)
    return seen, virtual.cloud_of(seen, np.zeros(3))[0]
