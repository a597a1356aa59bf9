"""Deaggregations are read as bins of what each contributes, records are chosen, and weighted by them."""

import dataclasses
import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference.idealised import full_sine
from refusals import refused

from toppling.models.motions.ensemble import Ensemble
from toppling.models.motions.record import Record
from toppling.models.motions.selection import Choice, hazard_weights, read_deaggregation, select

EDGES = "mag_bin_edges=[5.0, 6.0, 7.0], dist_bin_edges=[0.0, 10.0, 20.0]"


def openquake(
    rows, head=f"investigation_time=50.0, {EDGES}, weights=[0.4, 0.6]", columns="mag,dist,rlz1,rlz0"
):
    return "\n".join([f'#,,,,,"{head}"', f"imt,iml,poe,{columns}", *rows])


def written(folder, text):
    (folder / "Mag_Dist-0.csv").write_text(text)
    return folder / "Mag_Dist-0.csv"


def nshmp(folder):
    """`data.csv` of nshmp-haz: centres and means of distance and magnitude, epsilon, per cent of the total."""
    folder.mkdir(exist_ok=True)
    path = folder / "data.csv"
    path.write_text(
        "     r,      r\u0305,    m,    m\u0305,     ε\u0305,    Σε\n"
        " 10.00,  12.10, 5.10, 5.10,  2.50, 20.00\n"
        " 10.00,  11.40, 5.30, 5.31,  2.20, 30.00\n"
        " 10.00,  10.90, 5.70, 5.69,  1.90, 49.75\n"
        " 30.00,  24.00, 5.10, 5.10,  3.30,  0.25\n"
        " 50.00,  41.00, 5.30, 5.28,  4.10,     T\n"
    )
    return path


@pytest.mark.parametrize(("columns", "fractions"), [("mean", [1.0]), ("rlz1,rlz0", [1.75, 0.5])])
def test_openquakes_bins_combine_to_the_probability_they_are_of(tmp_path, columns, fractions):
    rows = [
        f"PGA,{iml},{poe},{place},{','.join(str(share * p * poe) for share in fractions)}"
        for iml, poe in (("0.3", 0.1), ("0.2", 0.2))
        for place, p in (("5.5,5.0", 0.4), ("5.5,15.0", 0.5), ("6.5,15.0", 0.2))
    ]
    read = read_deaggregation(written(tmp_path, openquake(rows, columns=f"mag,dist,{columns}")), poe=0.1)
    assert -math.expm1(-math.fsum(read.bins["contribution"])) == pytest.approx(1.0 - 0.96 * 0.95 * 0.98)
    assert read.bins.iloc[:2, :4].to_numpy().tolist() == [[5.0, 6.0, 0.0, 10.0], [5.0, 6.0, 10.0, 20.0]]
    assert "others with --poe 0.2" in read.of


@pytest.mark.parametrize("by", ["trt", "eps"])
def test_region_and_epsilon_are_summed_over(tmp_path, by):
    """Two parts of 10 % and 20 % are 28 %, as of independent events."""
    rows = [f"PGA,0.2,0.1,{part},5.5,5.0,{p}" for part, p in (("-1.0", 0.1), ("1.0", 0.2))]
    bins = read_deaggregation(written(tmp_path, openquake(rows, columns=f"{by},mag,dist,mean"))).bins
    assert bins["contribution"].tolist() == pytest.approx([-math.log1p(-0.28)])


def test_nshmps_bins_are_centres_with_per_cent_of_the_total(tmp_path):
    bins = read_deaggregation(nshmp(tmp_path)).bins
    assert bins.iloc[0, :4].tolist() == [5.0, 5.2, 0.0, 20.0]
    assert bins["contribution"].tolist() == [20.0, 30.0, 49.75, 0.25, 0.0]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("summary.txt", "  r: min = 0.0, max = 100.0, Δ = 10.0\n  m: min = 5.0, max = 8.0, Δ = 0.1\n"),
        ("config.json", '{"deagg": {"bins": {"Δr": 10.0, "Δm": 0.1}}}'),
    ],
)
def test_widths_of_nshmps_bins_are_those_that_a_file_of_the_calculation_states(tmp_path, name, text):
    path = nshmp(tmp_path / "site")
    (path.with_name(name) if name == "summary.txt" else tmp_path / name).write_text(text, encoding="utf-8")
    assert read_deaggregation(path).bins.iloc[0, :4].tolist() == [5.05, 5.15, 5.0, 15.0]


NAMES = "magnitude_low,magnitude_high,distance_low_km,distance_high_km,contribution\n"


@pytest.mark.parametrize(
    "text",
    [
        NAMES + "5,6,0,10,30\n6,7,10,20,70\n",
        "# at the rock\n" + NAMES.replace(",", ";") + "5,0;6,0;0;10;30\n6;7;10;20;70\n",
        NAMES.replace("\n", ",eps\n") + "5,6,0,10,10,0\n5,6,0,10,20,1\n6,7,10,20,70,0\n",
    ],
)
def test_a_table_states_the_edges_of_bins_and_parts_of_a_bin_are_summed(tmp_path, text):
    bins = read_deaggregation(written(tmp_path, text)).bins
    assert bins.to_numpy().tolist() == [[5.0, 6.0, 0.0, 10.0, 30.0], [6.0, 7.0, 10.0, 20.0, 70.0]]


@given(st.floats(0.1, 0.5), st.integers(2, 9), st.floats(1.2, 1.8))
def test_rounded_centres_of_nshmps_equal_bins_are_read_and_others_refused(
    tmp_path_factory, width, count, off
):
    path = tmp_path_factory.mktemp("bins") / "data.csv"
    centres = [round(5.0 + width * n, 2) for n in range(count)]
    path.write_text("r,m,Σε\n" + "".join(f"{r},{m},1\n" for m in centres for r in (5, 15)))
    assert len(read_deaggregation(path).bins) == 2 * count
    path.write_text(f"r,m,Σε\n5,5,1\n15,5,1\n{15 + 10 * off},6,1\n")
    with refused("deaggregation.bins_uneven"):
        read_deaggregation(path)


BIN = "PGA,0.2,0.1,5.5,5.0,0.1,0.0"


@pytest.mark.parametrize(
    ("code", "named", "text"),
    [
        ("deaggregation.value_unreadable", "'1.2'", openquake(["PGA,0.2,0.1,5.5,5.0,1.2,0.0"])),
        ("deaggregation.place_off_bins", 8.5, openquake(["PGA,0.2,0.1,8.5,5.0,0.1,0.0"])),
        ("table.row_wrong_length", "6 columns, the header 7", openquake(["PGA,0.2,0.1,5.5,5.0,0.1"])),
        ("table.unreadable", "csv:4", openquake([BIN, '"' + "9" * 200_000])),
        ("deaggregation.weights_unusable", 0.9, openquake([BIN], f"{EDGES}, weights=[0.4, 0.5]")),
        ("deaggregation.edges_missing", "", openquake([BIN], "weights=[0.4, 0.6]")),
        ("deaggregation.probability_not_there", "", openquake([])),
        *((f"deaggregation.{code}", "", text) for code, text in (
            ("bin_unreadable", NAMES + "5,6,0,10,-1\n"), ("bin_unreadable", NAMES + "5,6,,10,1\n"),
            ("bin_unreadable", NAMES + "6,5,0,10,1\n"), ("bin_width_unknown", "r,m,Σε\n5,5.5,1\n"),
            ("columns_unknown", "magnitude,distance_km,contribution\n5.5,5,1\n"),
            ("columns_unknown", NAMES.replace("_km", "") + "5,6,0,10,1\n"), ("no_bin", NAMES), ("no_bin", ""),
        )),
    ],
)  # fmt: skip
def test_what_is_no_whole_deaggregation_is_refused_by_name(tmp_path, code, named, text):
    with refused(code, named, "Mag_Dist-0.csv"):
        read_deaggregation(written(tmp_path, text))


@pytest.fixture(scope="module")
def ensemble(tmp_path_factory):
    sources = {"A1": (6.2, 10.0), "A2": (6.2, 5.0), "A3": (6.2, None), "B1": (7.4, 30.0), "C1": (None, 8.0)}
    records = [
        dataclasses.replace(
            Record.of(name, full_sine(1.0, 0.5), event=f"Event {name[0]}", magnitude=m, distance_km=d),
            quality="drifting" if name == "B1" else "corrected",
        )
        for name, (m, d) in sources.items()
    ]
    return Ensemble.write(tmp_path_factory.mktemp("e") / "e", records)


@pytest.mark.parametrize(
    ("choice", "ids"),
    [
        (Choice(), ["A1", "A2", "A3", "B1", "C1"]), (Choice(magnitude=(6.0, 7.0)), ["A1", "A2", "A3"]),
        (Choice(distance_km=(0.0, 10.0)), ["A1", "A2", "C1"]), (Choice(event="event b"), ["B1"]),
        (Choice(quality=("corrected", "processed")), ["A1", "A2", "A3", "C1"]),
        (Choice(most_per_event=1), ["A2", "B1", "C1"]), (Choice(most_per_event=2), ["A1", "A2", "B1", "C1"]),
    ],
)  # fmt: skip
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
        selected, _ = select(ensemble, Choice(count=count))
        ranks = sorted(names.index(name) for name in selected)
        assert (ranks[0], ranks[-1], len(ranks)) == (0, 8, min(count, 9))
        steps = [above - below for below, above in pairwise(ranks)]
        assert max(steps) - min(steps) <= 1


def test_weights_divide_every_bins_contribution_and_sum_to_one(ensemble, tmp_path):
    table = tmp_path / "bins.csv"
    table.write_text(f"{NAMES}6,7,0,20,30\n7,8,20,40,10\n7,8,0,20,60\n")
    weights, empty = hazard_weights(ensemble, ensemble.record_ids, read_deaggregation(table).bins)
    assert weights == pytest.approx({"A1": 0.375, "A2": 0.375, "A3": 0.0, "B1": 0.25, "C1": 0.0})
    assert empty["contribution"].tolist() == [60]
