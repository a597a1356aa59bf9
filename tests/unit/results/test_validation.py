"""Scores of probabilities, and draws that learn from every record but the one foretold."""

import numpy as np
import pandas as pd
import pytest

from toppling.results.analysis.prediction_scores import (
    _weighted_draws,
    calibration,
    intervals,
    learnt,
    scores,
    share,
    simple_rules,
    were_a_draw_true,
)

RECORDS, EACH = 20, 8
GROUP = np.repeat([f"record {k}" for k in range(RECORDS)], EACH)


def experiment(right):
    """Draws (2, tests), and outcomes that are those of the first with such a probability, else the second's."""
    random = np.random.default_rng(5)
    draws = random.random((2, RECORDS * EACH)) < 0.5
    follows = random.random(RECORDS * EACH) < right
    return draws.astype(float), np.where(follows, draws[0], draws[1])


def test_calibrated_probabilities_have_slope_one_and_overconfident_ones_less():
    random = np.random.default_rng(7)
    odds = random.normal(0.0, 2.0, 4000)
    overturned = random.random(4000) < 1.0 / (1.0 + np.exp(-odds))
    calibrated = scores(overturned, 1.0 / (1.0 + np.exp(-odds)))
    overconfident = scores(overturned, 1.0 / (1.0 + np.exp(-2.0 * odds)))
    # Some four standard errors of the slope of as many outcomes.
    assert calibrated["calibration_slope"] == pytest.approx(1.0, abs=0.15)
    assert overconfident["calibration_slope"] == pytest.approx(0.5, abs=0.08)
    assert overconfident["brier"] > calibrated["brier"]
    assert overconfident["log_loss"] > calibrated["log_loss"]


def test_scores_count_calls_at_one_half():
    overturned = np.array([True, True, True, False, False])
    told = scores(overturned, np.array([0.9, 0.5, 0.2, 0.7, 0.1]))
    assert (told["recall"], told["specificity"]) == (pytest.approx(2 / 3), 0.5)
    assert told["balanced_accuracy"] == pytest.approx(7 / 12)
    assert told["brier"] == pytest.approx((0.01 + 0.25 + 0.64 + 0.49 + 0.01) / 5)
    assert list(told["confusion"].values()) == [2, 1, 1, 1]


def test_where_nothing_overturned_recall_is_unknown_and_not_zero():
    told = scores(np.zeros(4, bool), np.full(4, 0.2))
    assert told["recall"] is None
    assert told["balanced_accuracy"] is None
    assert told["specificity"] == 1.0


def test_a_share_tells_its_error_and_leaves_out_what_has_no_answer():
    toppled = np.array([[1.0, 0.0, np.nan], [1.0, 0.0, 1.0], [0.0, 0.0, np.nan]])
    mean, error = share(toppled)
    np.testing.assert_allclose(mean, [2.5 / 4, 0.5 / 4, 1.5 / 2])
    assert error[2] > error[0]
    assert (share(np.tile(toppled, (20, 1)))[1] < error).all()


def test_the_outcomes_of_a_record_do_not_change_what_is_foretold_of_it():
    draws, overturned = experiment(0.8)
    first = learnt(draws, overturned, GROUP)
    hidden = GROUP == "record 3"
    again = learnt(draws, np.where(hidden, ~overturned.astype(bool), overturned), GROUP)
    np.testing.assert_array_equal(again[hidden], first[hidden])
    assert (again[~hidden] != first[~hidden]).any()


def test_learning_finds_the_draw_that_is_right_and_how_often():
    draws, overturned = experiment(0.8)
    weights, (stands, topples) = _weighted_draws(draws, overturned, GROUP)
    assert weights[0] == pytest.approx(0.8, abs=0.08)
    assert stands < 0.1
    assert topples > 0.9
    unlearnt = scores(overturned, share(draws)[0])
    assert scores(overturned, learnt(draws, overturned, GROUP))["brier"] < unlearnt["brier"]


def test_draws_on_either_side_of_the_truth_tell_more_together_than_the_better_one_alone():
    random = np.random.default_rng(11)
    strength = random.random(len(GROUP))
    overturned = strength > random.normal(0.5, 0.12, len(GROUP))
    draws = (strength > np.array([[0.35], [0.62]])).astype(float)
    together = scores(overturned, learnt(draws, overturned, GROUP))["brier"]
    alone = [scores(overturned, learnt(draws[[k]], overturned, GROUP))["brier"] for k in (0, 1)]
    assert together < min(alone)


def test_a_draw_without_answers_keeps_at_most_the_weight_it_had_before_any_outcome():
    draws, overturned = experiment(0.8)
    with_silent = np.vstack([draws, np.full(draws.shape[1], np.nan)])
    assert _weighted_draws(with_silent, overturned, GROUP)[0][2] <= 1.0 / 3.0 / RECORDS
    spoilt = learnt(with_silent, overturned, GROUP) - learnt(draws, overturned, GROUP)
    assert np.abs(spoilt).max() < 0.02  # two draws share what one record weighs, then three


def test_simple_rules_find_a_threshold_of_velocity_without_the_record_itself():
    random = np.random.default_rng(3)
    pga = random.uniform(1.0, 6.0, len(GROUP))
    pgv = random.uniform(0.05, 0.6, len(GROUP))
    intensity = pd.DataFrame({"pga_m_s2": pga, "pgv_m_s": pgv, "pgv_pga_s": pgv / pga})
    overturned = pgv > 0.3
    said = simple_rules(intensity, overturned, GROUP)
    for name, probability in said.items():
        assert scores(overturned, probability)["accuracy"] > 0.95, name
    hidden = GROUP == "record 3"
    again = simple_rules(intensity, np.where(hidden, ~overturned, overturned), GROUP)
    for name, probability in said.items():
        np.testing.assert_array_equal(again[name][hidden], probability[hidden], err_msg=name)


@pytest.mark.thorough
def test_intervals_hold_the_score_and_are_wider_of_fewer_records():
    random = np.random.default_rng(4)
    probability = random.random(len(GROUP))
    overturned = random.random(len(GROUP)) < probability
    brier = scores(overturned, probability)["brier"]
    low, high = intervals(overturned, probability, GROUP)["brier"]
    assert low < brier < high
    few = GROUP < "record 13"
    low_few, high_few = intervals(overturned[few], probability[few], GROUP[few])["brier"]
    assert high_few - low_few > high - low


def test_bins_of_the_calibration_plot_hold_every_test_once():
    probability = np.array([0.0, 0.1, 0.5, 1.0])
    bins = calibration(np.array([False, False, True, True]), probability)
    assert bins["tests"].sum() == 4
    assert bins["overturned"].tolist() == [0.0, 1.0, 1.0]


def test_a_specimen_from_the_distribution_drawn_from_scores_as_its_draws_would():
    random = np.random.default_rng(8)
    strength = random.uniform(0.0, 3.0, 120)
    thresholds = random.normal(1.5, 0.4, 60)
    toppled = (strength > thresholds[:, None]).astype(float)
    said = were_a_draw_true(toppled)
    probability, _ = share(toppled)
    held = dict.fromkeys(("brier", "calibration_slope", "balanced_accuracy"), 0)
    for threshold in random.normal(1.5, 0.4, 100):
        found = scores(strength > threshold, probability)
        for name in held:
            held[name] += said[name][0] <= found[name] <= said[name][1]
    # Of 100 at 90 % three standard deviations are 9; the interval's own ends are of 60 draws.
    assert all(abs(count - 90) <= 10 for count in held.values())
    elsewhere = scores(strength > 2.9, probability)
    assert elsewhere["brier"] > said["brier"][1]


def test_tests_of_one_record_have_neither_rules_nor_intervals():
    overturned, group = np.array([True, False, True]), np.array(["record"] * 3)
    intensity = pd.DataFrame({name: [1.0, 2.0, 3.0] for name in ("pga_m_s2", "pgv_m_s", "pgv_pga_s")})
    assert simple_rules(intensity, overturned, group) == {}
    assert intervals(overturned, np.array([0.9, 0.2, 0.6]), group) == {}
