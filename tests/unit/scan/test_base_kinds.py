"""How likely kinds of bases are by the rim that was seen."""

import numpy as np
import pytest

from toppling.models.hidden_base.evidence import BEFORE, bowls, mixed_weights, shares_by_evidence
from toppling.models.hidden_base.gap import GapDraw

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


def test_a_rim_tells_shapes_of_one_kind_apart_as_little_as_kinds_and_standing_in_full():
    """Errors of neighbouring places of a rim are not independent: its likelihood counts to the power 0.15."""
    seen = [GapDraw(np.zeros(3), each, 0, "rounded", each) for each in (0.0, -10.0)]
    first, second = mixed_weights(seen, {"rounded": 1.0})
    assert second / first == pytest.approx(np.exp(-1.5))
    cost = [GapDraw(np.zeros(3), each, 0, "rounded", 0.0) for each in (0.0, -2.0)]
    first, second = mixed_weights(cost, {"rounded": 1.0})
    assert second / first == pytest.approx(np.exp(-2.0))


@pytest.mark.parametrize("number", range(len(bowls(1.0))))
def test_a_rounded_base_lies_as_tilted_as_its_weight_turned_it(number):
    """Whichever its shape: the slope of its middle line is not known before within 3 degrees."""
    across = np.linspace(-0.5, 0.5, 11)
    places = np.stack(np.meshgrid(across, across), axis=-1).reshape(-1, 2)
    slope = places[:, 0] / (places[:, 0] @ places[:, 0])
    covariance = bowls(1.0)[number].covariance(places)
    assert np.sqrt(slope @ covariance @ slope) > np.tan(np.deg2rad(2.8))
