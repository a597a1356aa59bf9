"""What is chosen is what was asked for; weights add up and say what hazard has no record."""

import dataclasses
from itertools import pairwise

import pytest
from reference.idealised import full_sine
from refusals import refused

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.motions.selection import Choice, hazard_weights, read_deaggregation, select


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    sources = {"A1": (6.2, 10.0), "A2": (6.2, 5.0), "A3": (6.2, None), "B1": (7.4, 30.0), "C1": (None, 8.0)}
    records = [
        dataclasses.replace(
            Record.of(name, full_sine(1.0, 0.5), event=f"Event {name[0]}", magnitude=m, distance_km=d),
            components=2 if name == "C1" else 3,
            quality="drifting" if name == "B1" else "corrected",
        )
        for name, (m, d) in sources.items()
    ]
    return Ensemble.write(tmp_path_factory.mktemp("e") / "e", records)


@pytest.mark.parametrize(
    ("choice", "ids"),
    [
        (Choice(), ["A1", "A2", "A3", "B1", "C1"]),
        (Choice(magnitude=(6.0, 7.0)), ["A1", "A2", "A3"]),
        (Choice(distance_km=(0.0, 10.0)), ["A1", "A2", "C1"]),
        (Choice(event="event b"), ["B1"]),
        (Choice(components=3), ["A1", "A2", "A3", "B1"]),
        (Choice(quality=("corrected", "processed")), ["A1", "A2", "A3", "C1"]),
        (Choice(most_per_event=1), ["A2", "B1", "C1"]),
        (Choice(most_per_event=2), ["A1", "A2", "B1", "C1"]),
    ],
)
def test_records_are_chosen(ensemble, choice, ids):
    assert select(ensemble, choice)[0] == ids


def test_a_choice_of_nothing_is_refused_and_names_the_condition_that_left_none(ensemble):
    with refused("selection.none_left", "5 records", "6 to 7: 3 left", "50 to 60 km: 0 left"):
        select(ensemble, Choice(magnitude=(6.0, 7.0), distance_km=(50.0, 60.0)))


@pytest.mark.parametrize("name", ["magnitude", "distance_km", "pga_m_s2", "pgv_pga_s"])
def test_swapped_ends_of_a_range_are_refused_with_the_range_that_was_meant(name):
    with refused("selection.range_reversed", "5 6"):
        Choice(**{name: (6.0, 5.0)})


@pytest.fixture(scope="module")
def pulses(tmp_path_factory):
    """Nine records, each pulse longer than the one before, not in the order of their names."""
    names = [f"P{(7 * place) % 9}" for place in range(9)]
    records = [
        Record.of(name, full_sine(1.0 + 0.1 * place, 0.3 + 0.1 * place)) for place, name in enumerate(names)
    ]
    return Ensemble.write(tmp_path_factory.mktemp("e") / "e", records), names


def test_a_count_spreads_evenly_over_the_ranks_of_pulse_length_with_both_ends(pulses):
    ensemble, names = pulses
    for count in (2, 3, 5, 9, 50):
        kept, _ = select(ensemble, Choice(count=count))
        ranks = sorted(names.index(name) for name in kept)
        assert (ranks[0], ranks[-1], len(ranks)) == (0, 8, min(count, 9))
        steps = [above - below for below, above in pairwise(ranks)]
        assert max(steps) - min(steps) <= 1


def deaggregation(tmp_path, text):
    table = tmp_path / "deaggregation.csv"
    table.write_text(f"magnitude_low,magnitude_high,distance_low_km,distance_high_km,contribution\n{text}")
    return read_deaggregation(table).bins


def test_weights_share_each_bins_contribution_and_add_up_to_one(ensemble, tmp_path):
    bins = deaggregation(tmp_path, "6,7,0,20,30\n7,8,20,40,10\n7,8,0,20,60\n")
    weights, empty = hazard_weights(ensemble, ensemble.record_ids, bins)
    assert weights == pytest.approx({"A1": 0.375, "A2": 0.375, "A3": 0.0, "B1": 0.25, "C1": 0.0})
    assert [b.contribution for b in empty] == [60]
