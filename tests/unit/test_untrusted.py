"""Nothing that came as data is executed: files of every kind whose reading would run code, or read other files."""

import io
import os
import pickle
import subprocess
import sys

import pytest
from click.testing import CliRunner
from refusals import refused

from toppling.models.files.mesh_files import read_triangles
from toppling.models.motions.formats import response, seismic
from toppling.models.motions.formats.reading import read_file
from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli


class Trap:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.fixture
def trap(tmp_path):
    """A malicious file under a record's name, and the mark that shows that it ran."""
    mark = tmp_path / "executed"
    record = tmp_path / "records" / "quake.AT2"
    record.parent.mkdir()
    record.write_bytes(pickle.dumps(Trap(mark), protocol=0))  # protocol 0 is text without a zero byte
    return record, mark


def test_the_trap_works_on_a_reader_that_guesses(trap):
    import obspy

    record, mark = trap
    with pytest.raises(TypeError, match="Unknown format"):
        obspy.read(io.BytesIO(record.read_bytes()))
    assert mark.exists()


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_a_pickle_is_no_record(trap, protocol):
    record, mark = trap
    record.write_bytes(pickle.dumps(Trap(mark), protocol=protocol))
    with refused("record.format_unknown"):
        read_file(record)
    assert not mark.exists()


def test_no_verb_runs_what_a_record_says(trap, tmp_path):
    record, mark = trap
    Scene.block(half_width=0.2, half_depth=0.2, half_height=0.6).save(tmp_path / "scene")
    cloud = record.with_name("cloud.ply")
    cloud.write_bytes(record.read_bytes())
    for words in (
        ["records", "import", str(record.parent), "--out", str(tmp_path / "ensemble")],
        ["check", str(tmp_path / "scene"), str(record.parent)],
        ["scan", str(cloud), "--out", str(tmp_path / "rock")],
    ):
        CliRunner().invoke(cli, words)
        assert not mark.exists(), words


def test_station_xml_names_no_other_file(tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("of another account")
    station = tmp_path / "station.xml"
    station.write_text(
        f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY secret SYSTEM "{secret.as_uri()}">]>'
        '<FDSNStationXML xmlns="http://www.fdsn.org/xml/station/1" schemaVersion="1.1">'
        "<Source>&secret;</Source><Created>2020-01-01T00:00:00</Created></FDSNStationXML>"
    )
    with refused("document.has_entities"):
        response.responses(station)


def test_a_mesh_reads_no_file_beside_it(tmp_path):
    (tmp_path / "rock.obj").write_text("mtllib /etc/hostname\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(read_triangles(tmp_path / "rock.obj")[1]) == 1
    (tmp_path / "rock.gltf").write_text(
        '{"asset": {"version": "2.0"}, "buffers": [{"uri": "/etc/hostname", "byteLength": 1}]}'
    )
    with refused("file.unreadable"):
        read_triangles(tmp_path / "rock.gltf")


@pytest.mark.parametrize("name", ["rock.xaml", "rock.zip", "rock.pkl", "rock"])
def test_a_mesh_of_a_format_that_is_not_listed_is_refused(tmp_path, name):
    (tmp_path / name).write_bytes(b"anything")
    with refused("mesh.format_unknown"):
        read_triangles(tmp_path / name)


def test_only_formats_that_are_parsed_are_read():
    assert "PICKLE" not in seismic.FORMATS
    assert all(callable(seismic.recogniser(name)) for name in seismic.FORMATS)


@pytest.mark.thorough
@pytest.mark.parametrize("module", ["toppling.models.scan.survey", "toppling.results.drawing.style"])
def test_settings_of_matplotlib_in_the_working_folder_are_not_read(module, tmp_path):
    (tmp_path / "matplotlibrc").write_bytes(b"figure.dpi: 3\nbackend: module://evil\n\xff\n")
    program = f"import {module}, matplotlib; print(matplotlib.rcParams['figure.dpi'])"
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.stdout.strip(), done.stderr) == ("100.0", "")
