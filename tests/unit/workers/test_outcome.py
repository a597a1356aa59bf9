"""When a rock passed its point of no return, from the heights of its centre of mass."""

import numpy as np
import pytest

from toppling.workers.outcome import _last_top

LEVEL_M = 1e-8


@pytest.mark.parametrize(
    ("height_m", "still", "top"),
    [
        ([1.0, 1.2, 1.1, 0.5], 3, 1),  # rises, and falls from there
        ([1.0, 1.2, 1.1, 1.3, 0.5], 4, 3),  # from the later of two tops
        ([1.0, 1.2, 1.1, 1.0, 1.3, 0.5], 2, 1),  # but not from one after the fall
        ([1.0, 1.1, 1.2, 0.5], 1, 2),  # a rise that is going on is followed to its top
        ([1.0, 1.0, 1.0, 1.0, 0.6, 0.2], 5, 3),  # stood, and fell without rising
        ([1.0, 1.05, 1.0, 1.0, 1.0, 0.6], 5, 1),  # rocked, sank, stood lower: the top was before
        ([1.0, 1.0 + 1e-12, 1.0, 1.0 - 1e-12, 0.6], 4, 3),  # at rest but for rounding
        ([1.0, 0.9, 0.5], 2, 0),  # began past its balance
    ],
)
def test_the_top_is_the_last_of_the_highest_before_the_fall(height_m, still, top):
    assert _last_top(np.array(height_m), still, LEVEL_M) == top
