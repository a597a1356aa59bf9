"""The spread of toppling goes to the cause that made it."""

import numpy as np
import pandas as pd
import pytest

from toppling.models.errors import InputError
from toppling.results.spread import spreads

RECORDS, DRAWS, AZIMUTHS = 30, 40, 6


def run(records=0.0, base=0.0, friction=0.0, seed=1):
    """Rows of a campaign whose toppling probability is 1/2 and differs as told by record, base and friction."""
    random = np.random.default_rng(seed)
    of_record = records * random.normal(size=RECORDS)
    of_base = base * random.normal(size=DRAWS)
    log_factor = 0.05 * random.normal(size=DRAWS)
    rows = [
        {
            "record_id": f"r{record}", "level_pga_m_s2": 3.0, "azimuth_deg": 60.0 * azimuth, "friction_static": 0.8,
            "friction_kinetic": 0.8, "realisation": draw + 1, "base": draw, "friction_factor": np.exp(log_factor[draw]),
            "toppled": random.random()
            < 0.5 + of_record[record] + of_base[draw] + friction * log_factor[draw] / 0.05,
        }
        for record in range(RECORDS) for draw in range(DRAWS) for azimuth in range(AZIMUTHS)
    ]  # fmt: skip
    return pd.DataFrame(rows).astype({"toppled": "boolean"})


@pytest.mark.parametrize("cause", ["records", "base", "friction"])
def test_a_spread_of_one_cause_is_told_as_that_causes(cause):
    table = spreads(run(**{cause: 0.15}))
    found = table.iloc[0]
    # A standard deviation over 30 or 40 draws is known to some 13 %.
    assert found[cause] == pytest.approx(0.15, rel=0.35)
    assert found[f"share_{cause}"] > 0.85
    assert table.iloc[-1]["jobs"] == RECORDS * DRAWS * AZIMUTHS


def test_chance_alone_is_no_ones_spread():
    found = spreads(run()).iloc[0]
    # Of one entry (six jobs) chance leaves 0.5 / sqrt(6); of a mean over all records almost nothing.
    assert found["left"] == pytest.approx(0.5 / np.sqrt(6.0), rel=0.1)
    assert max(found["records"], found["base"], found["friction"]) < 0.04


def test_a_campaign_without_realisations_is_told_to_have_some():
    frame = run(base=0.1)
    with pytest.raises(InputError, match="realisations"):
        spreads(frame[frame["realisation"] == 1])
