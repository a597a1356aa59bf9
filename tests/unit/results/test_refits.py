"""Fits, and many at once, are those of statsmodels one after another."""

import numpy as np
import pandas as pd
import pytest
from seeded import rows
from statsmodels.genmod.families import Binomial
from statsmodels.genmod.families.links import Logit, Probit
from statsmodels.genmod.generalized_linear_model import GLM

from toppling.results.analysis.lognormal import design_of, fit, grouped
from toppling.results.analysis.resampling import refitted


def by_statsmodels(design, share, trials, link):
    some = trials > 0
    family = Binomial(link={"probit": Probit, "logit": Logit}[link]())
    return GLM(share[some], design[some], family, var_weights=trials[some]).fit(tol=1e-12).params


@pytest.mark.parametrize("link", ["probit", "logit"])
@pytest.mark.parametrize("measures", [("pgv_m_s",), ("pga_m_s2", "pgv_m_s")])
def test_fits_of_resampled_records_are_those_of_statsmodels(link, measures):
    frame = pd.DataFrame(rows(records=12))
    frame["record_weight"] = np.random.default_rng(1).uniform(0.2, 2.0, 12)[
        pd.factorize(frame["record_id"])[0]
    ]
    groups = grouped(frame, measures)
    design, codes = design_of(groups, measures), pd.factorize(groups["record_id"])[0]
    share, trials = groups["share"].to_numpy(), groups["trials"].to_numpy()
    drawn = np.random.default_rng(2).multinomial(12, np.full(12, 1 / 12), 20)[:, codes]
    start = fit(frame, measures, link).coefficients
    assert start == pytest.approx(by_statsmodels(design, share, trials, link), rel=1e-6, abs=1e-6)
    found = list(refitted(design, share, trials, link, start, drawn))
    for once, weight in zip(found, drawn, strict=True):
        assert once == pytest.approx(by_statsmodels(design, share, trials * weight, link), rel=1e-6, abs=1e-6)


def test_separated_answers_and_too_few_jobs_have_no_end_of_the_search_and_hold_up_no_other():
    design = np.column_stack([np.ones(6), np.arange(6.0)])
    share = np.array([0.0, 0.0, 1.0, 0.0, 1.0, 1.0])
    weights = np.array([[1, 1, 1, 1, 1, 1], [1, 1, 0, 0, 1, 1], [0, 0, 0, 1, 0, 0]])
    whole, separated, single = refitted(design, share, np.ones(6), "probit", (0.0, 0.5), weights)
    assert np.isfinite(whole).all()
    assert np.isnan(separated).all()
    assert np.isnan(single).all()
