"""Magnitudes and distances that standing excludes, faults around a rock, and ground-motion models."""

import json
import math
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import refused
from scipy.stats import norm

from toppling.orchestrator.cli import cli
from toppling.results.analysis.exchange import write_curves
from toppling.results.analysis.lognormal import Lognormal
from toppling.results.hazard.gmm import MODELS, GroundMotionModel
from toppling.results.hazard.magnitudes import (
    bins_words,
    effects,
    event_count,
    excluded_bins,
    largest_magnitudes,
    least_distances,
    motion_grid,
    recurring,
    reference_grid,
    sigma_parts,
    toppled,
    toppling_probability,
)
from toppling.results.hazard.places import azimuthal_km, distance_km, read_faults

needs_models = pytest.mark.skipif(find_spec("pygmm") is None, reason="the extra 'gmm' is not installed")


@dataclass(frozen=True)
class Simple:
    """ln PGV = -2 + 1.2 (M - 6) - 1.3 ln(R / 10 km), spread 0.6: invertible by hand."""

    shift: float = 0.0
    between_sites: float = 0.0
    magnitudes: tuple[float, float] = (4.5, 8.5)
    distances_km: tuple[float, float] = (1.0, 300.0)

    def motion(self, magnitude, distance_km):
        magnitude, distance = np.asarray(magnitude), np.asarray(distance_km)
        mean = -2.0 + self.shift + 1.2 * (magnitude - 6) - 1.3 * np.log(distance / 10)
        return mean, np.full(np.shape(mean), 0.6), np.full(np.shape(mean), self.between_sites)


ROCK = Lognormal("pgv_m_s", 0.35, 0.3)
GRID = motion_grid([Simple()], [1.0])


@settings(max_examples=40)
@given(st.floats(-3, 1), st.floats(0.2, 1.0), st.floats(0.05, 2.0), st.floats(0.0, 0.8))
def test_a_lognormal_motion_topples_a_lognormal_fragility_as_the_integral_does(mean, sigma, median, beta):
    rock = Lognormal("pgv_m_s", median, beta)
    z = np.linspace(-8.0, 8.0, 2001)
    integral = rock.probability(np.exp(mean + sigma * z)) @ (norm.pdf(z) / norm.pdf(z).sum())
    # A step lies within one of 2000 steps of the integral.
    assert toppling_probability(rock, mean, sigma) == pytest.approx(integral, abs=2e-3)


@pytest.mark.parametrize("events", [1, 5])
def test_the_largest_magnitude_agrees_with_the_closed_form(events):
    confidence = 0.95
    table = largest_magnitudes(GRID, ROCK, [], event_count(confidence, events))
    chance = 1 - (1 - confidence) ** (1 / events)
    wanted = math.log(0.35) + norm.ppf(chance) * math.hypot(0.6, 0.3)
    magnitude = 6 + (wanted + 2.0 + 1.3 * np.log(table["distance_km"] / 10)) / 1.2
    finite = np.isfinite(table["magnitude"])
    within = 1e-6 if events == 1 else 1e-3  # the probit of several is not straight between magnitudes
    assert table["magnitude"][finite].tolist() == pytest.approx(magnitude[finite].tolist(), abs=within)
    assert (magnitude[table["magnitude"] == math.inf] > 8.5).all()
    assert (magnitude[table["magnitude"] == -math.inf] < 4.5).all()


def test_the_least_distance_is_the_inverse_of_the_largest_magnitude():
    occurrence = event_count(0.95)
    distances = least_distances(GRID, ROCK, [], occurrence)
    within = distances[(distances["distance_km"] > 1.0) & np.isfinite(distances["distance_km"])]
    there = motion_grid([Simple()], [1.0], within["distance_km"])
    back = largest_magnitudes(there, ROCK, [], occurrence)["magnitude"]
    inside = within["magnitude"].between(4.55, 8.45).to_numpy()
    assert back[inside].tolist() == pytest.approx(within["magnitude"][inside].tolist(), abs=1e-6)


def test_survival_of_a_recurring_source_follows_its_poisson_count():
    years, probability = np.linspace(10_000, 20_000, 401), np.array([0.0, 0.03, 0.4, 1.0])
    exact = np.exp(-probability[:, None] * years / 2000.0).mean(axis=1)
    assert recurring(0.95, years, 2000.0).survival(probability) == pytest.approx(exact, rel=1e-4)


@pytest.mark.parametrize("events", [1, 10])
def test_earthquakes_at_a_site_topple_as_drawn_earthquakes_with_its_site_term(events):
    random, site_term = np.random.default_rng(0), 0.4
    grid = motion_grid([Simple(0.3, site_term), Simple(-0.3, site_term)], [0.7, 0.3])
    at = grid.magnitude.searchsorted(6.5), grid.distance_km.searchsorted(10.0)
    fallen = []
    for mean, weight in zip(grid.mean[:, *at], grid.weights, strict=True):
        site = site_term * random.standard_normal((100_000, 1))
        own = math.sqrt(0.6**2 - site_term**2) * random.standard_normal((100_000, events))
        topples = random.random(own.shape) < ROCK.probability(np.exp(mean + site + own))
        fallen.append(weight * topples.any(axis=1).mean())
    found = toppled(grid, ROCK, event_count(0.95, events))[at]
    assert found == pytest.approx(sum(fallen), abs=4e-3)
    anew = toppled(replace(grid, between_sites=0.0 * grid.sigma), ROCK, event_count(0.95, events))[at]
    assert (anew > found + 0.05) == (events == 10)
    assert (anew == pytest.approx(found, abs=1e-6)) == (events == 1)


@needs_models
@pytest.mark.parametrize(
    ("name", "option", "value"),
    [("cy14", "vs30_source", "inferred"), ("cb14", "hypocentre_km", 14.0), ("cy14", "depth_1_0_km", 0.9)],
)
def test_the_effect_of_an_option_is_that_of_leaving_it_out(name, option, value):
    plain, other = (GroundMotionModel(name, "pgv_m_s", 500.0, **asked) for asked in ({}, {option: value}))
    rows = effects([other], motion_grid([other], [1.0]))
    (effect,) = (row for row in rows if row["value"].startswith(str(value)))
    (before, sigma_before, _), (after, sigma, _) = (e.motion(6.5, 10.0) for e in (plain, other))
    assert effect["median_factor"] == pytest.approx(float(np.exp(after - before)))
    assert (effect["sigma"], effect["sigma_before"]) == pytest.approx((float(sigma), float(sigma_before)))
    assert (after, sigma) != (before, sigma_before)


def test_other_records_widen_the_magnitude_to_both_sides():
    z = norm.ppf((np.arange(200) + 0.5) / 200)
    drawn = [Lognormal("pgv_m_s", median, 0.3) for median in 0.35 * np.exp(0.1 * z)]
    table = largest_magnitudes(GRID, ROCK, drawn, event_count(0.95, 5))
    finite = table[np.isfinite(table["magnitude_high"]) & np.isfinite(table["magnitude_low"])]
    # Of the median's logarithm by 0.1 * 1.96, through a slope of 1.2 a magnitude.
    half = (finite["magnitude_high"] - finite["magnitude_low"]) / 2
    assert half.tolist() == pytest.approx([0.1 * 1.96 / 1.2] * len(half), rel=0.06)


@pytest.mark.parametrize("weights", [[0.5, 0.4], [1.2, -0.2], [1.0]])
def test_weights_of_models_that_do_not_sum_to_unity_are_refused(weights):
    with refused("model.weights_unusable", "2"):
        motion_grid([Simple(), Simple()], weights)


@needs_models
def test_boore_and_others_2014_have_their_published_numbers():
    mean, sigma, _ = GroundMotionModel("bssa14", "pga_m_s2", 760.0, "SS").motion(7.0, 20.0)
    assert math.exp(mean) / 9.80665 == pytest.approx(0.14971, rel=1e-4)
    assert float(sigma) == pytest.approx(0.6051, rel=1e-3)
    mean, sigma, _ = GroundMotionModel("bssa14", "pgv_m_s", 760.0, "SS").motion(7.0, 20.0)
    assert math.exp(mean) == pytest.approx(0.12837, rel=1e-4)
    assert float(sigma) == pytest.approx(0.651, rel=1e-3)


@needs_models
@pytest.mark.parametrize("name", MODELS)
def test_every_model_shakes_more_near_by_and_its_sigma_has_three_parts_at_a_site(name):
    model = GroundMotionModel(name, "sa_1s_m_s2", 760.0)
    mean, sigma, between_sites = model.motion([5.5, 6.5, 6.5], [20.0, 20.0, 100.0])
    assert mean[1] > max(mean[0], mean[2])
    assert ((sigma > 0.45) & (sigma < 0.95)).all()
    # Al Atik (2015), magnitude 6.5, 1 s: tau .3508, phi_SS .4257.
    left = np.maximum(sigma[1:] ** 2 - 0.3508**2 - 0.4257**2, 0.0)
    assert between_sites[1:] == pytest.approx(np.sqrt(left))
    parts = sigma_parts(reference_grid([model], motion_grid([model], [1.0])), "sa_1s_m_s2")
    assert parts.pop("total") == pytest.approx(math.hypot(*parts.values()))


@needs_models
@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"name": "gmpe99"}, "model.unknown"), ({"vs30_m_s": 50.0}, "model.vs30_out_of_range"),
        ({"vs30_m_s": math.nan}, "model.vs30_out_of_range"), ({"mechanism": "XX"}, "model.mechanism_unknown"),
        ({"measure": "cav_m_s"}, "measure.unknown"),
    ],
)  # fmt: skip
def test_a_model_that_does_not_cover_what_is_asked_is_refused(options, what):
    with refused(what):
        GroundMotionModel(**{"name": "bssa14", "measure": "pgv_m_s", "vs30_m_s": 760.0, **options})


SITE = (-118.1, 34.7)


def test_a_trace_is_as_far_as_its_nearest_point_not_its_nearest_corner(faults):
    """Along a parallel, as GeoJSON means it, and not along a great circle."""
    (trace,) = read_faults(Path(faults), SITE)
    assert (trace.name, trace.magnitude) == ("north", 7.8)
    assert trace.distance_km == pytest.approx(math.radians(0.05) * 6371, rel=1e-3)


@settings(max_examples=40)
@given(st.floats(-180, 180), st.floats(-80, 80), st.floats(-3, 3), st.floats(-3, 3))
def test_the_map_preserves_distances_from_the_rock(longitude, latitude, east, north):
    point = np.array([[longitude + east, latitude + north]])
    mapped = np.hypot(*azimuthal_km(point, (longitude, latitude))[0])
    assert mapped == pytest.approx(float(distance_km(*point[0], (longitude, latitude))), abs=1e-4)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("{", "document.unreadable"),
        ("[]", "document.no_object"),
        ('{"type": "FeatureCollection", "features": []}', "faults.no_line"),
        ('{"type": "LineString", "coordinates": [[400000, 3800000], [400100, 3800000]]}', "faults.line_unusable"),
        ('{"type": "LineString", "coordinates": [[1, 2]]}', "faults.line_unusable"),
        ('{"type": "LineString", "coordinates": [[1, "x"], [2, 3]]}', "faults.line_unusable"),
        ('{"type": "Feature", "properties": {"mag": "big"}, "geometry": {"type": "LineString", '
         '"coordinates": [[1, 2], [2, 3]]}}', "faults.magnitude_unusable"),
    ],
)  # fmt: skip
def test_a_file_that_holds_no_traces_is_refused(tmp_path, text, what):
    path = tmp_path / "faults.geojson"
    path.write_text(text)
    with refused(what):
        read_faults(path, SITE)


def test_bins_of_a_deaggregation_are_excluded_where_their_earthquake_topples_the_rock():
    bins = pd.DataFrame({"magnitude_low": [6.9, 4.9, 8.4], "magnitude_high": [7.1, 5.1, 8.6],
        "distance_low_km": 0.0, "distance_high_km": 10.0, "contribution": [3.0, 1.0, 0.0]})  # fmt: skip
    # Medians of exp(-0.1) and exp(-2.3) at 5 km, but for 1.3 ln 2: 3.6 and 0 standard deviations above the rock's.
    rock = Lognormal("pgv_m_s", math.exp(-3.2 + 1.3 * math.log(2)), 0.1)
    table = excluded_bins(bins, [Simple()], GRID, rock, [event_count(0.95)])
    assert table["share"].tolist() == [0.75, 0.25]
    assert table["topples"].tolist() == pytest.approx([norm.cdf(2.4 / math.hypot(0.6, 0.1)), 0.5])
    assert table["excluded"].tolist() == [True, False]
    assert bins_words(table)[0].startswith("One event: 75 % of the deaggregated hazard, 1 of 2 bins")


@pytest.fixture
def curves(tmp_path):
    made = [Lognormal("pgv_m_s", 0.25, 0.3), Lognormal("pga_m_s2", 3.0, 0.3)]
    return str(write_curves(tmp_path / "rock.json", made))


@pytest.fixture
def faults(tmp_path):
    path = tmp_path / "faults.geojson"
    line = {"type": "LineString", "coordinates": [[-119.0, 34.75], [-117.0, 34.75]]}
    feature = {"type": "Feature", "properties": {"name": "north", "mag": 7.8}, "geometry": line}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return str(path)


def magnitudes(*arguments):
    return CliRunner().invoke(cli, ["magnitudes", *arguments, "--vs30", "760"])


@needs_models
def test_a_fault_whose_own_earthquake_would_have_toppled_the_rock_is_excluded(curves, faults, tmp_path):
    out = tmp_path / "out"
    asked = [curves, "--events", "5", "--faults", faults, "--site", "-118", "34.7", "--out", str(out)]
    done = magnitudes(*asked)
    assert done.exit_code == 0, done.output
    (fault,) = json.loads((out / "magnitudes.json").read_text())["faults"]
    assert fault["excluded"] is True
    assert fault["magnitude"] < 7.8
    assert fault["distance_km"] == pytest.approx(5.56, abs=0.01)
    names = ("faults.csv", "faults.png", "magnitudes.png", "largest_magnitudes.csv", "least_distances.csv")
    assert {*names} <= {path.name for path in out.iterdir()}


@needs_models
@pytest.mark.parametrize(
    ("options", "code"),
    [
        (["--recurrence", "3000"], 2), (["--age", "3000"], 2), (["--site", "1", "2"], 2), (["--faults", "FAULTS"], 2),
        (["--where", "true"], 2), (["--model", "bssa14=0.4", "--model", "cy14=0.4"], 1),
        (["--model", "bssa14", "--model", "bssa14"], 2), (["--model", "none"], 1),
        (["--mechanism", "U", "--model", "ask14"], 1), (["--faults", "FAULTS", "--site", "34.7", "-118.1"], 1),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_refused_before_anything_is_written(
    curves, faults, tmp_path, options, code
):
    out = tmp_path / "out"
    done = magnitudes(curves, *(faults if o == "FAULTS" else o for o in options), "--out", str(out))
    assert done.exit_code == code
    assert done.exception is not None
    assert not out.exists()
