"""The process of `models.files.guarded`: takes requests from its input, reads a file under limits, answers in bytes.

A request is a line of JSON. An answer is the length of its header, the header in JSON, and the arrays' bytes. Nothing
is pickled. The limits are those of the operating system: of memory beyond what the libraries take, and of processor
time.
"""

import importlib
import json
import os
import resource
import selectors
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from toppling.models.errors import InputError

_IDLE_S = 20.0
"""Without a request for so long the process ends."""


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
            _answer(json.loads(line), answers)


def _answer(request: dict[str, Any], answers: BinaryIO) -> None:
    arrays: list[NDArray] = []
    answer: dict[str, Any]
    try:
        module, _, name = request["reader"].partition(":")
        for library in (*request["libraries"], module):
            importlib.import_module(library)
        read = getattr(sys.modules[module], name)
        _limit(request["memory_bytes"], request["processor_s"])
        said, arrays = read(Path(request["path"]))
        arrays = [np.ascontiguousarray(array) for array in arrays]
        answer = {"said": said, "arrays": [(array.dtype.str, array.shape) for array in arrays]}
    except InputError as error:
        answer = {"refusal": vars(error) | {"where": error.where}}
    except MemoryError:
        answer = {"failure": f"it needs more than {request['memory_bytes'] / 1e6:.0f} MB of memory"}
    except BaseException as error:  # a panic of Rust is no Exception
        told = str(error).strip().partition("\n")[0]  # what follows is for the library's authors
        answer = {"failure": f"{type(error).__name__}: {told[:500]}"}
    _unlimit()
    if "said" not in answer:
        arrays = []
    header = json.dumps(answer).encode()
    answers.write(len(header).to_bytes(8, "big") + header)
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
