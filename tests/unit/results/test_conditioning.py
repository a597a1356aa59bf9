"""Draws of a base weigh by how often the rock stands on each what it is known to have stood."""

import numpy as np
import pandas as pd
import pytest
from reference.idealised import ricker
from refusals import refused
from seeded import row

from toppling.models.motions.record import Record
from toppling.orchestrator.recorded import Recorded
from toppling.orchestrator.studies.conditioning import (
    by_evidence,
    joined,
    refuse_counted,
    weights_by_contact,
)

CONTACT = (1.0, 1.0, 0.0)
QUAKE, OTHER = (Record.of(name, ricker(1.0, 1.0, along)) for name, along in (("quake", 0.0), ("other", 90.0)))


def weights_by(*records):
    evidence = {
        "records": [one.record_id for one in records], "shas": [one.sha for one in records],
        "azimuths_unknown": ["other"] if OTHER in records else [], "shakes": 8,
    }  # fmt: skip
    return by_evidence({CONTACT: np.array([1.5, 0.5])}, evidence)


def shakes(stands, record="quake"):
    """Rows of shakes: of each base a list of whether the rock stood, or None."""
    table = [
        row(
            f"{record}-{base}-{number}", record_id=record, base=base, toppled=None if one is None else not one
        )
        for base, answers in enumerate(stands)
        for number, one in enumerate(answers)
    ]
    return pd.DataFrame(table).astype({"toppled": "boolean"})


def test_a_weight_is_the_jeffreys_mean_of_standing_over_its_mean():
    weights = weights_by_contact(shakes([[True] * 3 + [False], [False] * 4]), 2)[CONTACT]
    chance = np.array([3.5 / 5.0, 0.5 / 5.0])
    assert weights == pytest.approx(chance / chance.mean())


def test_over_motions_chances_are_multiplied_and_no_weight_becomes_0():
    one, many = shakes([[True] * 8, [False] * 8]), []
    for number in range(400):
        many.append(one.assign(record_id=f"quake {number}"))
    twice = weights_by_contact(pd.concat(many[:2]), 2)[CONTACT]
    assert twice[0] / twice[1] == pytest.approx(17.0**2)
    assert (weights_by_contact(pd.concat(many), 2)[CONTACT] > 0.0).all()


def test_a_base_without_an_answer_is_told_nothing_and_a_motion_without_any_is_refused():
    weights = weights_by_contact(shakes([[True] * 4, [None] * 4, [True] * 4]), 3)[CONTACT]
    assert weights == pytest.approx([1.0, 1.0, 1.0])
    failed = shakes([[None] * 2]).assign(message="InputError: mujoco knows no such pedestal")
    with refused("stood.no_answer", "2"):
        weights_by_contact(failed, 1)


def test_a_motion_that_the_run_counts_is_not_counted_again():
    with refused("record.given_twice"):
        refuse_counted(weights_by(QUAKE), Recorded((QUAKE,), ("quake.AT2",)))
    refuse_counted(weights_by(QUAKE), Recorded((OTHER,), ("other.AT2",)))


def test_weights_by_two_motions_are_multiplied_and_name_both():
    both = joined(weights_by(QUAKE), weights_by(OTHER))
    assert both.by_contact[CONTACT] == pytest.approx([1.8, 0.2])
    assert both.reason == "the rock stood quake and other"
    assert both.remarks == ("Where the components of other pointed is not known: it shook from all sides",)
    assert both.evidence["shakes"] == 8
