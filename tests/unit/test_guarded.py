"""What a file does to the library that reads it is a refusal in this process, and nothing that it says is executed."""

import io
import os
import pickle
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from click.testing import CliRunner
from refusals import refused

from toppling.models.files import guarded
from toppling.models.files.guarded import read_guarded
from toppling.models.files.mesh_files import read_triangles
from toppling.models.motions.formats import read_file, response, seismic
from toppling.models.scene import Scene
from toppling.orchestrator.cli import cli

READERS = """
import ctypes, os, sys, time
import numpy as np
def good(path):
    print("a library talks"); sys.stdout.flush(); os.write(1, b"in C too")
    return {"name": path.name}, [np.arange(6.0).reshape(2, 3), np.empty((0, 3)), np.arange(3, dtype=np.int32)]
def crash(path):
    ctypes.string_at(0)
def greedy(path):
    return None, [np.ones(int(2e9))]
def hasty(path):
    while True: pass
def asleep(path):
    time.sleep(60)
def panics(path):
    raise SystemExit("no Exception")
"""


@pytest.fixture
def reads(tmp_path, monkeypatch):
    (tmp_path / "hostile_readers.py").write_text(READERS)
    file = tmp_path / "file.dat"
    file.write_text("small")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    guarded.stop()
    yield lambda name: read_guarded(f"hostile_readers:{name}", file)
    guarded.stop()


def test_what_is_read_comes_back_bit_for_bit_whatever_is_printed_meanwhile(reads):
    result, (numbers, none, whole) = reads("good")
    assert result == {"name": "file.dat"}
    np.testing.assert_array_equal(numbers, np.arange(6.0).reshape(2, 3))
    assert none.shape == (0, 3)
    assert whole.dtype == np.int32


@pytest.mark.parametrize(
    ("name", "what"), [("crash", "SIGSEGV"), ("greedy", "memory"), ("panics", "SystemExit: no Exception")]
)
def test_a_fault_of_a_library_is_a_refusal_and_the_next_file_is_read(reads, name, what):
    with refused("file.unreadable", "file.dat", what):
        reads(name)
    assert reads("good")[0] == {"name": "file.dat"}


@pytest.mark.parametrize(
    ("limit", "most", "name", "what"),
    [("_PROCESSOR_S", 1.0, "hasty", "processor time"), ("_PATIENCE", 0.33, "asleep", "1 s")],
)
def test_an_endless_reader_is_stopped_by_its_processor_time_or_the_clock(
    reads, monkeypatch, limit, most, name, what
):
    monkeypatch.setattr(guarded, limit, most)
    with refused("file.unreadable", what):
        reads(name)
    assert not guarded.READERS


def test_a_process_is_reused_and_replaced_when_it_has_ended(reads):
    def process():
        return guarded.READERS[0].process.pid

    reads("good")
    first = process()
    reads("good")
    assert process() == first
    os.kill(first, signal.SIGKILL)
    time.sleep(0.2)
    reads("good")
    assert process() != first


class Trap:
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


def test_no_verb_runs_code_from_a_record(trap, tmp_path):
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


def test_a_mesh_reads_no_file_next_to_it(tmp_path):
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
