"""Hash of the code that determines results, and the processor, which decides their last bit."""

import hashlib
import os
import platform
from contextlib import suppress
from functools import cache
from pathlib import Path

import llvmlite.binding
import numpy as np
import scipy.linalg  # noqa: F401  (loads SciPy's own BLAS, whose threads are counted too)
from threadpoolctl import threadpool_info, threadpool_limits

import toppling.models
import toppling.workers

_ROOMS = tuple(Path(room.__path__[0]) for room in (toppling.models, toppling.workers))
_NOT_OF_SHAKES = ("scan", "motions/formats")
"""Folders of `models` that only make scenes and records, which have their own hashes."""

SOURCES = {
    f"{room.name}/{path.relative_to(room)}": path.read_bytes()
    for room in _ROOMS
    for path in room.rglob("*.py")
    if not any(path.is_relative_to(room / folder) for folder in _NOT_OF_SHAKES)
}
"""Sources at the start of this process: files edited later differ from the loaded code."""


@cache
def code() -> str:
    """Hash of all code that determines results."""
    digest = hashlib.blake2b(digest_size=8)
    for name, source in sorted(SOURCES.items()):
        digest.update(name.encode() + hashlib.blake2b(source).digest())
    return digest.hexdigest()


KERNEL_VARIABLES = ("OPENBLAS_CORETYPE", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
"""Environment variables that select kernels; set before the program starts, they apply to all its child processes."""


@cache
def processor() -> dict[str, str]:
    """Columns of a row that identify the processor's model and the kernels of BLAS and LLVM."""
    llvm = os.environ.get("NUMBA_CPU_NAME") or llvmlite.binding.get_host_cpu_name()
    return {"cpu": _model(), "kernels": f"BLAS {_blas_kernel()}, LLVM {llvm}"}


def _model() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def single_blas_thread() -> None:
    """Limit BLAS to one thread in this process: several may sum in a different order."""
    threadpool_limits(1, user_api="blas")


def _blas_kernel() -> str:
    """Kernel selected by NumPy's OpenBLAS, or the name of another BLAS library."""
    loaded = [library for library in threadpool_info() if library["user_api"] == "blas"]
    for library in sorted(loaded, key=lambda library: "numpy.libs" not in library["filepath"]):
        return str(library.get("architecture") or library["internal_api"])
    with suppress(KeyError, TypeError):  # a library unknown to threadpoolctl, such as Apple's
        return str(np.show_config(mode="dicts")["Build Dependencies"]["blas"]["name"])
    return "unknown"
