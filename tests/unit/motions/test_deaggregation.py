"""Deaggregations of hazard programs are read as bins of magnitude and distance with what each contributes."""

import math
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from toppling.models.errors import InputError
from toppling.models.motions.deaggregation import read_deaggregation

SAMPLES = Path(__file__).parents[4] / "shared" / "data" / "hazard"

samples = pytest.mark.skipif(
    not SAMPLES.is_dir(), reason="needs the samples of hazard files, ../shared/data/hazard"
)

EDGES = "mag_bin_edges=[5.0, 6.0, 7.0], dist_bin_edges=[0.0, 10.0, 20.0]"


def openquake(
    tmp_path, rows, head=f"investigation_time=50.0, {EDGES}, weights=[0.4, 0.6]", columns="rlz1,rlz0"
):
    path = tmp_path / "Mag_Dist-0.csv"
    path.write_text("\n".join([f'#,,,,,"{head}"', f"imt,iml,poe,mag,dist,{columns}", *rows]))
    return path


@samples
@pytest.mark.parametrize(
    ("name", "poe", "total"), [("Mag_Dist-mean-0_5", 0.1, 0.10062), ("Mag_Dist-0_5", 0.1, 0.10062)]
)
def test_openquakes_bins_combine_to_the_probability_they_are_of(name, poe, total):
    read = read_deaggregation(SAMPLES / "oq_disagg" / f"{name}.csv", poe=poe)
    assert -math.expm1(-math.fsum(one.contribution for one in read.bins)) == pytest.approx(total, rel=2e-3)
    assert read.bins[0].magnitude == (5.0, 6.0)
    assert read.bins[1].distance_km == (10.0, 20.0)
    assert "others with --poe 0.2" in read.of


@samples
def test_region_and_epsilon_are_summed_over():
    one, two, three = (
        read_deaggregation(SAMPLES / "oq_disagg" / f"{name}.csv").bins
        for name in ("Mag_Dist-0_5", "TRT_Mag_Dist-0_5", "Mag_Dist_Eps-mean-0_5")
    )
    for plain, by_region, by_epsilon in zip(one, two, three, strict=True):
        assert by_region.contribution == pytest.approx(plain.contribution, rel=2e-3, abs=1e-7)
        assert by_epsilon.contribution == pytest.approx(plain.contribution, rel=2e-2, abs=1e-6)


@samples
@pytest.mark.parametrize("name", ["Mag-0_5", "Dist-mean-0_5"])
def test_a_deaggregation_over_one_of_both_is_refused(name):
    with pytest.raises(InputError, match="over magnitude and distance is needed"):
        read_deaggregation(SAMPLES / "oq_disagg" / f"{name}.csv")


def test_a_line_of_blanks_in_a_deaggregation_is_no_row(tmp_path):
    row = "PGA,0.2,0.1,5.5,5.0,0.1,0.0"
    assert (
        read_deaggregation(openquake(tmp_path, [row, "  ", " , "])).bins
        == read_deaggregation(openquake(tmp_path, [row])).bins
    )


@samples
def test_nshmps_bins_are_centres_with_per_cent_of_the_total():
    (folder,) = (SAMPLES / "nshmp/hazout_fault_two_gmm/PGA/deagg").glob("*Site1")
    bins = read_deaggregation(folder / "data.csv").bins
    assert (bins[0].magnitude, bins[0].distance_km) == (pytest.approx((5.0, 5.2)), (0.0, 20.0))
    assert bins[0].contribution == pytest.approx(7.30)
    assert math.fsum(one.contribution for one in bins) == pytest.approx(100, abs=0.5)


def test_weights_follow_the_columns_and_not_the_numbers_of_realisations(tmp_path):
    bins = read_deaggregation(openquake(tmp_path, ["PGA,0.2,0.1,5.5,5.0,0.1,0.0"])).bins
    assert bins[0].contribution == pytest.approx(-math.log1p(-0.04))


def test_of_several_motions_the_strongest_is_taken_or_the_one_that_is_asked_for(tmp_path):
    rows = [f"{imt},1,{poe},5.5,5.0,{poe},{poe}" for imt in ("PGA", "PGV") for poe in (0.1, 0.02)]
    path = openquake(tmp_path, rows)
    assert read_deaggregation(path).bins[0].contribution == pytest.approx(-math.log1p(-0.02))
    read = read_deaggregation(path, "PGV", 0.1)
    assert read.bins[0].contribution == pytest.approx(-math.log1p(-0.1))
    assert read.of.startswith("PGV of 1, probability 0.1 in 50.0 years")
    for asked, said in ((("SA(1.0)", None), "not over SA"), ((None, 0.5), "has the probabilities 0.02, 0.1")):
        with pytest.raises(InputError, match=said):
            read_deaggregation(path, *asked)


@pytest.mark.parametrize(
    ("rows", "head", "said"),
    [
        (["PGA,0.2,0.1,5.5,5.0,1.2,0.0"], None, "states the probability '1.2'"),
        (["PGA,0.2,0.1,8.5,5.0,0.1,0.0"], None, "in none of its bins"),
        (["PGA,0.2,0.1,5.5,5.0,0.1"], None, "has not the header's 7 columns"),
        (["PGA,0.2,0.1,5.5,5.0,0.1"], None, "columns but 6"),
        (["PGA,0.2,0.1,5.5,5.0,0.1,0.0", '"' + "9" * 200_000], None, r"csv:4: is no CSV"),
        (["PGA,0.2,0.1,5.5,5.0,0.1,0.0"], f"{EDGES}, weights=[0.4, 0.5]", "sum to 0.9"),
        (["PGA,0.2,0.1,5.5,5.0,0.1,0.0"], "weights=[0.4, 0.6]", "states no mag_bin_edges"),
        ([], None, "has no row"),
    ],
)  # fmt: skip
def test_a_damaged_deaggregation_is_refused_by_name(tmp_path, rows, head, said):
    path = openquake(tmp_path, rows, head) if head else openquake(tmp_path, rows)
    with pytest.raises(InputError, match=said):
        read_deaggregation(path)


@samples
def test_neighbouring_bins_share_their_edge_so_that_no_magnitude_falls_between():
    (folder,) = (SAMPLES / "nshmp/hazout_fault_two_gmm/PGA/deagg").glob("*Site1")
    edges = {one.magnitude for one in read_deaggregation(folder / "data.csv").bins}
    lows, highs = ({edge[side] for edge in edges} for side in (0, 1))
    assert lows - highs == {min(lows)}


@pytest.mark.parametrize(
    "text",
    [
        "magnitude_low,magnitude_high,distance_low_km,distance_high_km,contribution\n5,6,0,10,30\n6,7,10,20,70\n",
        "# at the rock\nMagnitude,Distance (km),Contribution (%)\n5.5,5,30\n6.5,15,70\n",
        "Mw;R_km;%\n5,5;5,0;30\n6,5;15,0;70\n",
        "r\tmag\teps\tcontribution\n5\t5.5\t0\t10\n5\t5.5\t1\t20\n15\t6.5\t0\t70%\n",
    ],
)
def test_a_persons_bins_may_be_edges_or_centres_and_are_the_same(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text)
    one, two = read_deaggregation(path).bins
    assert (one.magnitude, one.distance_km, one.contribution) == ((5.0, 6.0), (0.0, 10.0), 30.0)
    assert (two.magnitude, two.distance_km, two.contribution) == ((6.0, 7.0), (10.0, 20.0), 70.0)


@given(st.floats(0.1, 0.5), st.integers(2, 9), st.integers(0, 2))
def test_rounded_centres_of_equal_bins_are_read_and_others_refused(tmp_path_factory, width, count, digits):
    path = tmp_path_factory.mktemp("bins") / "table.csv"
    centres = [round(5.0 + width * n, 2) for n in range(count)]
    rows = "".join(f"{m},{r},1,234\n" for m in centres for r in (5, 15))
    path.write_text("M,R,contribution\n" + rows.replace("1,234", '"1,234"' if digits else "1234"))
    assert {one.contribution for one in read_deaggregation(path).bins} == {1234.0}
    path.write_text(f"M,R,contribution\n5,5,1\n5,15,1\n6,{15 + 10 * (digits + 1.5)},1\n")
    with pytest.raises(InputError, match="not equally wide"):
        read_deaggregation(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("magnitude,distance_km,contribution\n5.5,5,-1\n6.5,15,2\n", "not a bin"),
        ("magnitude,distance_km,contribution\n5.5,,1\n6.5,15,2\n", "not a bin"),
        (
            "magnitude,distance (m),contribution\n5.5,5000,1\n6.5,15000,2\n",
            r"distances under 'distance \(m\)'",
        ),
        ("M,Rrup [mi],share\n5.5,5,1\n6.5,15,2\n", "distances under"),
        ("M,R,%\n5.5,5,1\n5.5,15,1\n6.5,50,2\n", "not equally wide: 5, 15, 50"),
        ('M,R,%\n5.5,5,"0,5"\n6.5,15,"1,5"\n', "not a bin"),
        ("magnitude,distance_km,contribution\n5.5,5,1\n", "one bin of distance or magnitude"),
        ("magnitude,site,contribution\n5.5,5,1\n", "not a bin"),
        ("magnitude,distance_km,contribution\n", "no bin below the names"),
        ("", "no bin below the names"),
    ],
)
def test_what_is_no_bin_of_a_persons_table_is_refused(tmp_path, text, said):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        read_deaggregation(path)


def test_a_first_column_called_by_a_number_sign_makes_the_header_no_remark(tmp_path):
    (tmp_path / "d.csv").write_text("# by hand\n#,mag,dist,share\n1,6,10,2\n2,7,30,3\n")
    assert [one.contribution for one in read_deaggregation(tmp_path / "d.csv").bins] == [2, 3]


def test_a_bracket_that_nobody_closes_is_looked_at_once(tmp_path):
    """By the square of the length, minutes."""
    (tmp_path / "d.csv").write_text(f"mag,dist,share,{'(' * 100_000}\n6,10,2,\n7,30,3,\n")
    start = time.process_time()
    assert len(read_deaggregation(tmp_path / "d.csv").bins) == 2
    assert time.process_time() - start < 5


@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_decimal_comma_before_three_digits_is_one_where_others_are(separator, tmp_path):
    rows = ["M,R,share", "6|5,12|5,0|125", "7|5,12|5,12|375"]
    text = "\n".join(rows).replace(",", separator).replace("|", ",")
    (tmp_path / "d.csv").write_text(text + "\n" + separator.join(["6,5", "22,5", "1"]) + "\n")
    assert sorted(one.contribution for one in read_deaggregation(tmp_path / "d.csv").bins) == [
        0.125,
        1.0,
        12.375,
    ]
