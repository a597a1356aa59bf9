"""The study's findings are looked for, and told as found: agreement, disagreement, and what the runs cannot tell."""

import pandas as pd
import pytest
from seeded import rows

from toppling.results.analysis.findings import _toppling_levels, findings


@pytest.fixture(scope="module")
def main():
    """Toppling lognormal in PGV toward 135 degrees, whatever the duration."""
    frame = pd.DataFrame(rows(records=40, azimuths=(0.0, 90.0))).astype({"toppled": "boolean"})
    return frame.assign(directionality=0.95)


def found(main, lower=None, weakest_deg=315.0, lines=None):
    lines = pd.DataFrame({"azimuth_deg": []}) if lines is None else lines
    told = findings(main, main if lower is None else lower, weakest_deg, lines)
    return {finding.name: finding for finding in told}


def test_what_the_answers_are_made_of_is_found(main):
    told = found(main, weakest_deg=0.0)
    assert told["probability below 0.2 for PGA < 3 m/s2 and PGV < 0.75 m/s"].agrees is True
    assert told["toppling PGA falls with PGV/PGA"].agrees is True
    assert told["toppling PGV hardly depends on duration"].agrees is not False
    assert found(main)["topplings cluster around the overhang"].agrees is True
    assert told["about half of the records lack strong directionality"].agrees is False
    assert told["lower friction gives more toppling"].agrees is None


def test_duration_is_looked_for_in_the_range_and_direction_of_the_studys_figure(main):
    name = "toppling PGV hardly depends on duration"
    falls = main["toppled"] & (main["pgv_m_s"] > 3.0 / main["duration_energy_s"] + 1.0)
    toward = main["azimuth_deg"] == 0.0
    inside = main.assign(toppled=falls.where(toward, main["toppled"]))
    assert found(inside, weakest_deg=0.0)[name].agrees is False
    assert found(inside, weakest_deg=90.0)[name].agrees is True
    longer = main.assign(toppled=falls, duration_energy_s=main["duration_energy_s"] + 30.0)
    finding = found(
        pd.concat([main, longer.assign(record_id="long" + longer["record_id"])]), weakest_deg=0.0
    )[name]
    assert finding.agrees is True
    assert "of all jobs" in finding.found


def test_an_overhang_elsewhere_is_a_disagreement(main):
    finding = found(main, weakest_deg=90.0)["topplings cluster around the overhang"]
    assert finding.agrees is False
    assert "this rock disagrees" in finding.line


def test_lower_friction_is_told_by_pairs(main):
    lower = pd.DataFrame(rows(records=40, azimuths=(0.0, 90.0), friction=0.6)).astype({"toppled": "boolean"})
    more = lower.assign(toppled=lower["toppled"] | (lower["level_pga_m_s2"] > 8))
    both = pd.concat([main, more], ignore_index=True)
    assert found(main, both)["lower friction gives more toppling"].agrees is True
    fewer = lower.assign(toppled=lower["toppled"] & (lower["level_pga_m_s2"] > 12))
    both = pd.concat([main, fewer], ignore_index=True)
    assert found(main, both)["lower friction gives more toppling"].agrees is False


def test_many_levels_of_a_few_records_tell_nothing_of_friction(main):
    lower = pd.DataFrame(rows(records=40, azimuths=(0.0, 90.0), friction=0.6)).astype({"toppled": "boolean"})
    few = lower["record_id"].isin(lower["record_id"].unique()[:4])
    both = pd.concat([main, lower.assign(toppled=lower["toppled"] | few)], ignore_index=True)
    finding = found(main, both)["lower friction gives more toppling"]
    assert finding.agrees is None
    assert "more in 4 records, less in 0" in finding.found
    assert "percentage points (" in finding.found


def test_reference_lines_in_some_directions_only_are_not_in_every_one(main):
    lines = pd.DataFrame({"azimuth_deg": [0.0, 45.0]})
    assert found(main, lines=lines)["two-contact reference lines in figure 6"].agrees is False


def test_a_record_that_never_topples_has_no_finite_threshold(main):
    record = main["record_id"].iloc[0]
    stands = main.assign(toppled=main["toppled"] & (main["record_id"] != record))
    assert _toppling_levels(stands).loc[record, "pga_m_s2"] == float("inf")
