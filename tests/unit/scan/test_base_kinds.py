"""How likely kinds of bases are by the rim that was seen."""

import numpy as np
import pytest

from toppling.models.hidden_base.gap import GapDraw
from toppling.models.hidden_base.kinds import BEFORE, shares_by_evidence

NEAR, FAR = 0.0, -1e4


@pytest.mark.parametrize(("rough", "rounded"), [(NEAR, FAR), (FAR, NEAR)])
def test_no_rim_rules_a_rough_base_or_a_rounded_one_out(rough, rounded):
    """Their priors miss some bases: one is 1e4 units of likelihood away, and keeps a fifth of the weight."""
    likelihood = {"flat": FAR, "rough": rough, "rounded": rounded}
    gaps = [GapDraw(np.zeros(3), each, 0, kind, each) for kind, each in likelihood.items()]
    shares = shares_by_evidence(gaps)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["flat"] == 0.0
    assert 0.2 < min(shares["rough"], shares["rounded"]) < 0.3


def test_a_rim_that_tells_nothing_leaves_kinds_as_likely_as_before():
    gaps = [GapDraw(np.zeros(3), -7.0, 0, kind, -7.0) for kind in BEFORE]
    assert shares_by_evidence(gaps) == pytest.approx(BEFORE)
