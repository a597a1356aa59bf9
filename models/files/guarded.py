"""Readers whose libraries may crash, or take all memory, run in a process of their own, under limits.

A file that a stranger sent may hit a fault in a library's C, C++ or Rust, which ends its process. The process that
reads is another one: what ends there is a refusal here, with the file's name. One such process is kept for the next
file and ends by itself when none comes.

A request is a line of JSON. An answer is the length of its header, the header in JSON, and the arrays' bytes. Nothing
is pickled. The limits are those of the operating system: of memory beyond what the libraries take, and of processor
time.
"""

import atexit
import importlib
import json
import os
import resource
import selectors
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError, refusals
from toppling.models.files.given import open_given

_MEMORY_BYTES = 768 << 20
"""Memory that reading any file may take."""
_MEMORY_PER_BYTE = 100
"""Memory that it may take for each byte of the file besides: a LAZ needs 30 at most to become points."""
_PROCESSOR_S = 3.0
"""Processor time that reading any file may take, s: the first of a format pays for what its library imports."""
_PROCESSOR_S_PER_MB = 2.0
"""Processor time that it may take for each megabyte besides, s: the slowest format takes 0.3."""
_PATIENCE = 100.0
"""Ratio of wall-clock to processor time that is allowed: other work and slow file systems are no fault of a file."""
_THREADS = 4
"""Number of threads of the libraries there: each has a stack and an arena that count as memory."""
_LENGTH = struct.Struct(">Q")
"""Length of a header in bytes, which precedes it."""
_IDLE_S = 20.0
"""Time without a request after which the process ends."""
_Read = tuple[Any, list[NDArray]]


_damaged = refusals(
    expected="a whole file of the format that its name says",
    remedy="export or fetch the file again; convert it if its program writes an uncommon variant",
)


def read_guarded(reader: str, path: Path, libraries: Sequence[str] = ()) -> _Read:
    """Call a reader in the guarded process.

    reader: `module:function`; the function takes a Path and returns what JSON can say, and arrays.
    libraries: modules imported before the limits are set, as they take memory of their own.
    Raises InputError if the reader refuses the file, raises anything else, crashes, or needs more memory or time than
    any sound file of its size.
    """
    with open_given(path, _damaged) as file:
        size_mb = os.fstat(file.fileno()).st_size / 1e6
    request = {
        "reader": reader,
        "path": os.path.abspath(path),  # noqa: PTH100  (resolve would name what a link points to)
        "libraries": list(libraries),
        "memory_bytes": _MEMORY_BYTES + int(_MEMORY_PER_BYTE * size_mb * 1e6),
        "processor_s": _PROCESSOR_S + _PROCESSOR_S_PER_MB * size_mb,
    }
    with _LOCK:
        try:
            answer, arrays = _ask(request)
        except _EndedError as end:
            raise _damaged("file.unreadable", str(end), path) from end
    if "refusal" in answer:
        where = str(answer["refusal"]["where"] or request["path"])
        where = where.replace(str(request["path"]), str(path))  # as it was asked for
        raise InputError(**(answer["refusal"] | {"where": where}))
    if "failure" in answer:
        raise _damaged("file.unreadable", f"cannot be read ({answer['failure']})", path)
    return answer["result"], arrays


@dataclass(frozen=True)
class _Reader:
    """The process, and whose it is: a fork of its owner must not speak with it."""

    process: subprocess.Popen
    owner: int


class _EndedError(Exception):
    """The process ended, or was ended, before it answered: how, in words."""


_LOCK = threading.Lock()
READERS: list[_Reader] = []


def _ask(request: dict[str, Any]) -> _Read:
    """Send a request and take the answer; a process that ended while it was idle is started anew."""
    for _ in range(2):
        process = _running()
        try:
            process.stdin.write(json.dumps(request).encode() + b"\n")  # type: ignore[union-attr]
            process.stdin.flush()  # type: ignore[union-attr]
            return _answer(process, request)
        except (BrokenPipeError, EOFError):
            code = process.wait()
            READERS.clear()
            if code != 0:
                break
        except BaseException:  # half an answer is no beginning of the next
            stop()
            raise
    raise _EndedError(_how_it_ended(code, request))


def _answer(process: subprocess.Popen, request: dict[str, Any]) -> _Read:
    patience_s = _PATIENCE * request["processor_s"]
    with selectors.DefaultSelector() as ready:
        ready.register(process.stdout, selectors.EVENT_READ)  # type: ignore[arg-type]
        if not ready.select(patience_s):
            stop()
            raise _EndedError(f"cannot be read: its reader gave no answer for {patience_s:.0f} s")
    length = bytearray(_LENGTH.size)
    _fill(process, length)
    header = bytearray(*_LENGTH.unpack(length))
    _fill(process, header)
    answer = json.loads(header)
    arrays = []
    for kind, shape in answer.pop("arrays", ()):
        array = np.empty(prod(shape), np.dtype(kind))
        if array.size:
            _fill(process, array.data.cast("B"))
        arrays.append(array.reshape(shape))
    return answer, arrays


def _how_it_ended(code: int, request: dict[str, Any]) -> str:
    if code == -signal.SIGXCPU:
        return f"cannot be read in {request['processor_s']:.0f} s of processor time"
    name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    return f"crashed the library that reads it ({name})"


def _running() -> subprocess.Popen:
    if READERS and READERS[0].owner == os.getpid() and READERS[0].process.poll() is None:
        return READERS[0].process
    if READERS and READERS[0].owner == os.getpid():
        stop()
    process = subprocess.Popen(
        # -P: nothing is imported from the folder that the user happens to be in.
        [sys.executable, "-P", "-m", "toppling.models.files.guarded"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | dict.fromkeys(("RAYON_NUM_THREADS", "OMP_NUM_THREADS"), str(_THREADS))
        | {"MALLOC_ARENA_MAX": "2", "OPENBLAS_NUM_THREADS": "1", "RUST_BACKTRACE": "0"},
        start_new_session=True,  # Ctrl-C is for the program, which stops this one
    )  # fmt: skip
    READERS[:] = [_Reader(process, os.getpid())]
    return process


@atexit.register
def stop() -> None:
    """End the process, if one of ours runs."""
    mine = [reader.process for reader in READERS if reader.owner == os.getpid()]
    READERS.clear()
    for process in mine:
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        process.kill()
        process.wait()


def _fill(process: subprocess.Popen, content: bytearray | memoryview) -> None:
    if process.stdout.readinto(content) < len(content):  # type: ignore[union-attr]
        raise EOFError


def main() -> None:
    """Answer requests until there are none."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with selectors.DefaultSelector() as ready:
        ready.register(sys.stdin.buffer, selectors.EVENT_READ)
        # One request at a time: none waits in the buffer while an answer is made.
        while ready.select(_IDLE_S) and (line := sys.stdin.buffer.readline()):
            _serve(json.loads(line), answers)


def _serve(request: dict[str, Any], answers: BinaryIO) -> None:
    arrays: list[NDArray] = []
    answer: dict[str, Any]
    try:
        module, _, name = request["reader"].partition(":")
        for library in (*request["libraries"], module):
            importlib.import_module(library)
        read = getattr(sys.modules[module], name)
        _limit(request["memory_bytes"], request["processor_s"])
        result, arrays = read(Path(request["path"]))
        arrays = [np.ascontiguousarray(array) for array in arrays]
        answer = {"result": result, "arrays": [(array.dtype.str, array.shape) for array in arrays]}
    except InputError as error:
        answer = {"refusal": vars(error) | {"where": error.where}}
    except MemoryError:
        answer = {"failure": f"it needs more than {request['memory_bytes'] / 1e6:.0f} MB of memory"}
    except BaseException as error:  # a panic of Rust is no Exception
        message = str(error).strip().partition("\n")[0]  # what follows is for the library's authors
        answer = {"failure": f"{type(error).__name__}: {message[:500]}"}
    _unlimit()
    if "result" not in answer:
        arrays = []
    header = json.dumps(answer).encode()
    answers.write(_LENGTH.pack(len(header)) + header)
    for array in arrays:
        answers.write(array.data.cast("B") if array.size else b"")
    answers.flush()


def _limit(memory_bytes: int, processor_s: float) -> None:
    """Limit what comes from here on: memory to so much more than is taken now, processor time likewise."""
    with suppress(OSError, ValueError):  # where there is no /proc, or a lower limit already
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        _soft(resource.RLIMIT_AS, pages * resource.getpagesize() + memory_bytes)
    used = resource.getrusage(resource.RUSAGE_SELF)
    with suppress(OSError, ValueError):
        _soft(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime + processor_s) + 1)


def _unlimit() -> None:
    for kind in (resource.RLIMIT_AS, resource.RLIMIT_CPU):
        with suppress(OSError, ValueError):
            _soft(kind, resource.getrlimit(kind)[1])


def _soft(kind: int, limit: int) -> None:
    """Set the limit that counts, never above the one that the system sets."""
    most = resource.getrlimit(kind)[1]
    resource.setrlimit(kind, (limit if most == resource.RLIM_INFINITY else min(limit, most), most))


if __name__ == "__main__":
    main()
