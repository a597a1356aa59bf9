"""What is chosen is what was asked for; weights add up and say what hazard has no record."""

import dataclasses

import pytest

from toppling.models.errors import InputError
from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.idealised import full_sine
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
    assert select(ensemble, choice) == ids


def test_a_choice_of_nothing_is_refused(ensemble):
    with pytest.raises(InputError, match="none of 5 records"):
        select(ensemble, Choice(magnitude=(8.0, 9.0)))


def deaggregation(tmp_path, text):
    table = tmp_path / "deaggregation.csv"
    table.write_text(f"magnitude_low,magnitude_high,distance_low_km,distance_high_km,contribution\n{text}")
    return read_deaggregation(table)


def test_weights_share_each_bins_contribution_and_add_up_to_one(ensemble, tmp_path):
    bins = deaggregation(tmp_path, "6,7,0,20,30\n7,8,20,40,10\n7,8,0,20,60\n")
    weights, empty = hazard_weights(ensemble, ensemble.record_ids, bins)
    assert weights == pytest.approx({"A1": 0.375, "A2": 0.375, "A3": 0.0, "B1": 0.25, "C1": 0.0})
    assert [b.contribution for b in empty] == [60]


@pytest.mark.parametrize("row", ["6,7,0,20,-1", "7,6,0,20,1", "6,7,0,twenty,1", "6,7,0"])
def test_a_wrong_bin_is_refused_with_its_line(row, tmp_path):
    with pytest.raises(InputError, match=r"csv:2: not a bin"):
        deaggregation(tmp_path, row + "\n")


def test_weights_survive_the_disk(ensemble, tmp_path):
    written = Ensemble.write(tmp_path / "w", [dataclasses.replace(ensemble.record("A1"), weight=0.25)])
    assert written.record("A1").weight == 0.25
