"""Which loads of a motion decide whether a rock at rest is held."""

import numpy as np
import pytest

from toppling.workers.standing import _outermost

RANDOM = np.random.default_rng(5)


@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, 1.0), (1.0, -1.0), (-0.3, 1.0)])
def test_of_loads_along_one_line_the_two_farthest_apart_decide(way):
    shares = RANDOM.uniform(-3.0, 3.0, 20)
    loads = np.column_stack([np.outer(shares, way), np.full(20, -9.81)])
    ends = loads[[shares.argmin(), shares.argmax()]]
    assert {tuple(each) for each in _outermost(loads)} == {tuple(each) for each in ends}


def test_every_load_is_a_mixture_of_those_that_decide():
    loads = RANDOM.normal(size=(200, 3)) * (2.0, 2.0, 1.0) - (0.0, 0.0, 9.81)
    leaning, few = loads[:, :2] / -loads[:, 2:], _outermost(loads)
    for angle in np.arange(0.0, 2.0 * np.pi, 0.1):
        way = np.array([np.cos(angle), np.sin(angle)])
        assert (leaning @ way).max() == pytest.approx((few[:, :2] / -few[:, 2:] @ way).max())


def test_one_load_decides_for_itself():
    assert (_outermost(np.array([[0.0, 0.0, -9.81]])) == (0.0, 0.0, -9.81)).all()
