"""The command says which earthquakes a rock excludes, and writes what it says."""

import json

import pytest
from click.testing import CliRunner

from toppling.orchestrator.cli import cli
from toppling.results.analysis.exchange import write_curves
from toppling.results.analysis.lognormal import Lognormal

pytest.importorskip("pygmm", reason="the optional extra 'gmm' is not installed")


@pytest.fixture
def curves(tmp_path):
    return str(
        write_curves(
            tmp_path / "rock.json", [Lognormal("pgv_m_s", 0.25, 0.3), Lognormal("pga_m_s2", 3.0, 0.3)]
        )
    )


@pytest.fixture
def faults(tmp_path):
    path = tmp_path / "faults.geojson"
    line = {"type": "LineString", "coordinates": [[-119.0, 34.75], [-117.0, 34.75]]}
    feature = {"type": "Feature", "properties": {"name": "north", "mag": 7.8}, "geometry": line}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return str(path)


def magnitudes(*arguments):
    return CliRunner().invoke(cli, ["magnitudes", *arguments, "--vs30", "760"])


def test_a_fault_whose_own_earthquake_would_have_toppled_the_rock_is_excluded(curves, faults, tmp_path):
    out = tmp_path / "out"
    asked = [curves, "--events", "5", "--faults", faults, "--site", "-118", "34.7", "--out", str(out)]
    done = magnitudes(*asked)
    assert done.exit_code == 0, done.output
    assert "its magnitude 7.8 topples with" in done.output
    (fault,) = json.loads((out / "magnitudes.json").read_text())["faults"]
    assert fault["excluded"] is True
    assert fault["magnitude"] < 7.8
    assert fault["distance_km"] == pytest.approx(5.56, abs=0.01)
    names = ("faults.csv", "faults.png", "magnitudes.png", "largest_magnitudes.csv", "least_distances.csv")
    assert {*names} <= {path.name for path in out.iterdir()}


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (["--recurrence", "3000"], 2), (["--age", "3000"], 2), (["--site", "1", "2"], 2), (["--faults", "FAULTS"], 2),
        (["--where", "true"], 2), (["--model", "bssa14=0.4", "--model", "cy14=0.4"], 1),
        (["--model", "bssa14", "--model", "bssa14"], 1), (["--model", "none"], 1),
        (["--mechanism", "U", "--model", "ask14"], 1), (["--faults", "FAULTS", "--site", "34.7", "-118.1"], 1),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_refused_before_anything_is_written(
    curves, faults, tmp_path, options, code
):
    out = tmp_path / "out"
    done = magnitudes(curves, *(faults if one == "FAULTS" else one for one in options), "--out", str(out))
    assert done.exit_code == code
    assert done.exception is not None
    assert not out.exists()
