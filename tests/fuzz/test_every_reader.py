"""Whatever a file holds, it is read as a sound object or refused by name: soon, in little memory, with nothing left."""

import math
import os
import re
import resource
import shutil
import signal
import tempfile
from pathlib import Path

import numpy as np
import psutil
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from reader_samples import READERS

from toppling.models.errors import InputError
from toppling.models.files import guarded
from toppling.orchestrator.terminal import plain_text

FEW, MANY = 300, 10_000
"""Damaged files over all readers: where a reader has changed, and with the slow tests."""
SECONDS, MEMORY_BYTES, FEW_BYTES = 2.0, 1 << 30, 100_000_000
LARGEST_REQUEST_BYTES = 4 << 30
"""No single allocation may be larger: it fails, instead of the machine."""

TOKENS = [
    b"NaN", b"inf", b"-1", b"0", b"1e308", b"-1e308", b"1e-300", b"1e400", b"999999999", b"4294967295",
    b"9999999999999999999", b"9" * 400, b"9" * 5000, b"", b"-", b"*******", b"null", b"true", b"[]", b"{}", b'"x"',
    b'["fast"]', b"[[[[[[", b"'", b'"', b"\xff\xfe", b"\0", b"\r", b"\r\n", b",", b";", b"/&", b"#", b"<!DOCTYPE x>",
    b"\x1a", b"\x0c", b"\x85", b"\xb2", b"0,5", b"G", b"PA", b"M/S**2 ",
]  # fmt: skip
WORDS = [
    b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\0\0", b"\0\0\xf0\x7f", b"\0\0\xc8\x42",
]  # fmt: skip

places = st.integers(0, (1 << 20) - 1)
"""Share of the file or, for every second change, of its head, where headers are."""
changes = st.one_of(
    st.tuples(st.just("flip"), places, st.integers(0, 7)),
    st.tuples(st.just("cut"), places),
    st.tuples(st.just("delete"), places, st.integers(1, 600)),
    st.tuples(st.just("repeat"), places, st.integers(1, 600), st.integers(1, 3)),
    st.tuples(st.just("number"), places, st.sampled_from(TOKENS)),
    st.tuples(st.just("number"), places, st.sampled_from(TOKENS)),
    st.tuples(st.just("insert"), places, st.sampled_from(TOKENS)),
    st.tuples(st.just("word"), places, st.sampled_from(WORDS)),
    st.tuples(st.just("long"), places, st.sampled_from([b"1", b" ", b"x", b"1 ", b"["]), st.just(5000)),
    st.tuples(st.just("long"), places, st.sampled_from([b"1", b" ", b"x", b"1 ", b"["]), st.just(140_000)),
    st.tuples(st.just("line"), places, st.integers(0, 3)),
    st.tuples(st.just("ends"), st.sampled_from([b"\r", b"\r\n", b"\n\n", b" "])),
    st.tuples(st.just("noise"), places, st.binary(min_size=1, max_size=64)),
    st.tuples(st.just("system"), st.sampled_from(["utf-16", "utf-16-be", "commas", "end of file", "zeros", "upper"])),
)  # fmt: skip


def of_another_system(content: bytes, direction: str) -> bytes:
    """Content as a program of another system, country or habit writes it."""
    if direction.startswith("utf"):
        return content.decode("latin-1").encode(direction)
    filled = {"end of file": content + b"\x1a" * 128, "zeros": content + bytes(512), "upper": content.upper()}
    return filled.get(direction, content.replace(b",", b";").replace(b".", b","))


def changed(content: bytes, change: tuple) -> bytes:
    kind, *how = change
    if kind == "system":
        return of_another_system(content, how[0])
    if not content or kind == "ends":
        return content.replace(b"\n", how[0]) if kind == "ends" else content
    of_all = how[0] % 2 or len(content) < 2000
    at = (how[0] >> 1) * (len(content) if of_all else 2000) >> 19
    before, behind = content[:at], content[at:]
    if kind == "flip":
        return before + bytes([behind[0] ^ (1 << how[1])]) + behind[1:]
    if kind == "cut":
        return before
    if kind == "delete":
        return before + behind[how[1] :]
    if kind == "repeat":
        return before + behind[: how[1]] * how[2] + behind
    if kind == "number":  # the next word, whatever it is
        start = next((i for i, byte in enumerate(behind) if byte in b"0123456789-."), 0)
        end = next((i for i in range(start, len(behind)) if behind[i] not in b"0123456789-.eE+"), len(behind))
        return before + behind[:start] + how[1] + behind[end:]
    if kind == "insert":
        return before + how[1] + behind
    if kind == "word":
        return before + how[1] + behind[len(how[1]) :]
    if kind == "long":
        return before + how[1] * (how[2] // len(how[1])) + behind
    if kind == "line":
        lines = content.split(b"\n")
        line = (how[0] >> 1) * len(lines) >> 19
        lines[line : line + 1] = [lines[line]] * (0, 2, 3, 40)[how[1]]
        return b"\n".join(lines)
    return before + how[1] + behind[len(how[1]) :]


class Sample:
    """The sound files of a reader, in memory, and a folder where damaged ones are read."""

    def __init__(self, name: str, folder: Path, scratch: Path) -> None:
        self.reader = READERS[name]
        sound = folder / "sound"
        sound.mkdir()
        self.reader.write(sound)
        self.files = {
            path.relative_to(sound): path.read_bytes() for path in sound.rglob("*") if path.is_file()
        }
        self.folders = [path.relative_to(sound) for path in sound.rglob("*") if path.is_dir()]
        self.victims = [
            name for name in sorted(self.files) if not self.reader.victims or name.name in self.reader.victims
        ]
        self.place, self.scratch = folder / "damaged", scratch

    def lay_out(self, victim: Path | None = None, content: bytes = b"") -> None:
        shutil.rmtree(self.place, ignore_errors=True)
        self.place.mkdir()
        for folder in self.folders:
            (self.place / folder).mkdir(parents=True, exist_ok=True)
        for name, sound in self.files.items():
            (self.place / name).write_bytes(content if name == victim else sound)

    def there(self) -> list[Path]:
        return sorted([*self.place.rglob("*"), *self.scratch.rglob("*")])


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    """The only place for temporary files, of the guarded process too."""
    place = tmp_path_factory.mktemp("scratch")
    guarded.stop()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(place))
        patch.setattr(tempfile, "tempdir", str(place))
        yield place
    guarded.stop()


@pytest.fixture
def sample(request, tmp_path, scratch):
    return Sample(request.param, tmp_path, scratch)


@pytest.fixture
def bounded():
    """No allocation of a hundred gigabytes reaches the machine."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + LARGEST_REQUEST_BYTES, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


def peak_bytes() -> int:
    line = next(
        line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")
    )
    return int(line.split()[1]) * 1024


def spent_s() -> float:
    """Processor time of this process and of those that read for it: another one's work on the machine is not theirs."""
    reading = [
        psutil.Process(reader.process.pid).cpu_times()
        for reader in guarded.READERS
        if reader.process.poll() is None
    ]
    return sum(os.times()[:4]) + sum(entry.user + entry.system for entry in reading)


def outcome(sample: Sample) -> tuple[str, float]:
    """What reading ends with, and how much processor time it takes."""
    start = spent_s()
    try:
        found, refusal = sample.reader.read(sample.place), None
    except InputError as error:
        found, refusal = [], error
    took = spent_s() - start
    if refusal is None:
        assert all(np.isfinite(np.asarray(entry, float)).all() for entry in found)
        return "read", took
    assert all((refusal.where, refusal.expected, refusal.remedy))
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", plain_text(str(refusal)))
    assert len(str(refusal)) < 5000
    return "refused", took


ESCAPES = b"\x1b]0;owned\x07\x1b[31m\x9b2J\x08"


def with_number(content: bytes, share: float, number: bytes) -> bytes:
    """Content with another number in place of one: the first of the rest from a share of it on."""
    found = re.compile(rb"\d+").search(content, int(share * len(content)))
    return content[: found.start()] + number + content[found.end() :] if found else content


def nested(name: str, depth: int) -> bytes:
    """A document of a name's kind whose parts lie in each other."""
    begin, end = {"json": (b'{"a":', b"}"), "xml": (b"<a>", b"</a>")}.get(
        name.rpartition(".")[2], (b"[", b"]")
    )
    return b"a = " * name.endswith(".toml") + begin * depth + b"1" + end * depth


def truncated(place: Path, content: bytes) -> None:
    place.write_bytes(content)
    os.truncate(place, 1 << 30)


SITUATIONS = {
    "absent": lambda place, _: place.symlink_to("nothing"),
    "FIFO": lambda place, _: os.mkfifo(place),
    "device": lambda place, _: place.symlink_to("/dev/zero"),
    "folder": lambda place, _: place.mkdir(),
    "zeros of 1 GB": lambda place, _: truncated(place, b""),
    "zeros of 1 GB behind": truncated,
    **{
        f"{digits} digits at {share}": lambda place, sound, s=share, d=digits: place.write_bytes(
            with_number(sound, s, b"9" * d)
        )
        for digits in (400, 5000)
        for share in (0.0, 0.4, 0.8)
    },
    **{
        f"depth {depth}": lambda place, _, d=depth: place.write_bytes(nested(place.name, d))
        for depth in (90, 300, 100_000)
    },
    **{
        f"escapes at {share}": lambda place, sound, s=share: place.write_bytes(
            sound[: int(s * len(sound))] + ESCAPES + sound[int(s * len(sound)) :]
        )
        for share in (0.0, 0.3, 0.7)
    },
}  # fmt: skip
"""What may stand where a file is expected."""


@pytest.mark.thorough
@pytest.mark.parametrize("sample", READERS, indirect=True)
def test_what_is_no_such_file_is_refused_at_once_in_little_memory(sample, bounded):
    sample.lay_out()
    assert outcome(sample)[0] == "read"  # and the libraries are loaded
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("hangs"))
    for victim in sample.victims:
        for name, lay in SITUATIONS.items():
            sample.lay_out()
            (sample.place / victim).unlink()
            lay(sample.place / victim, sample.files[victim])
            Path("/proc/self/clear_refs").write_text("5")
            resting = peak_bytes()
            signal.alarm(100)
            took = outcome(sample)[1]
            signal.alarm(0)
            grown = peak_bytes() - resting
            assert took <= SECONDS * (3 if "GB" in name else 1), (victim, name, took)  # a digest takes one
            assert grown <= FEW_BYTES, (victim, name, grown)


@pytest.mark.parametrize(
    "count",
    [
        pytest.param(math.ceil(FEW / len(READERS)), marks=pytest.mark.thorough),
        pytest.param(math.ceil(MANY / len(READERS)), marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("sample", READERS, indirect=True)
def test_a_damaged_file_is_read_soundly_or_refused(sample, count, bounded):
    sample.lay_out()
    assert outcome(sample)[0] == "read"
    apart = bool(guarded.READERS)
    outcomes = []

    @seed(27)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, len(sample.victims) - 1), st.lists(changes, min_size=1, max_size=3))
    def damage(which, damages):
        victim = sample.victims[which]
        content = sample.files[victim]
        for change in damages:
            content = changed(content, change)
        if apart and not guarded.READERS:  # a library that crashed is loaded again before the clock starts
            sample.lay_out()
            outcome(sample)
        sample.lay_out(victim, content)
        before = sample.there()
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory is counted from here
        resting = peak_bytes()
        ended, took = outcome(sample)
        if took > SECONDS:  # the start of a library after a crash is not the file's
            sample.lay_out()
            outcome(sample)
            sample.lay_out(victim, content)
            took = min(took, outcome(sample)[1])
        assert took <= SECONDS
        assert peak_bytes() - resting <= MEMORY_BYTES
        assert sample.there() == before
        outcomes.append(ended)

    damage()
    assert len(outcomes) >= count
