"""What computes here: processors differ in the last bit, by which kernels BLAS and the compiler choose for them."""

import os
import platform
from collections.abc import Collection
from contextlib import suppress
from functools import cache
from pathlib import Path

import llvmlite.binding
import numpy as np
import scipy.linalg  # noqa: F401  (loads SciPy's own BLAS, whose threads are counted too)
from threadpoolctl import threadpool_info, threadpool_limits

KERNEL_VARIABLES = ("OPENBLAS_CORETYPE", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")
"""By which a user chooses kernels: set before the program starts, they hold for all processes that it starts."""


@cache
def processor() -> dict[str, str]:
    """Columns of a row that say what computed it: the processor's model, and the kernels of BLAS and LLVM."""
    llvm = os.environ.get("NUMBA_CPU_NAME") or llvmlite.binding.get_host_cpu_name()
    return {"cpu": _model(), "kernels": f"BLAS {blas_kernel()}, LLVM {llvm}"}


def unlike(kernels: Collection[str]) -> str:
    """What a run on such kernels should say of itself; nothing where all are alike."""
    names = sorted({name for name in kernels if name})
    if len(names) < 2:
        return ""
    return (
        f"the workers compute with unlike kernels ({'; '.join(names)}): rows repeat bit for bit on like machines only, "
        "and near the threshold a last bit may flip a single answer (column kernels says which computed what). "
        "OPENBLAS_CORETYPE and NUMBA_CPU_NAME choose one kernel for all"
    )


def _model() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def one_blas_thread() -> None:
    """Let BLAS compute with one thread in this process, however it was started: with several it may sum otherwise."""
    threadpool_limits(1, user_api="blas")


def blas_kernel() -> str:
    """Kernel that NumPy's OpenBLAS has chosen; where NumPy has another library, that library's name."""
    loaded = [one for one in threadpool_info() if one["user_api"] == "blas"]
    for one in sorted(loaded, key=lambda one: "numpy.libs" not in one["filepath"]):
        return str(one.get("architecture") or one["internal_api"])
    with suppress(KeyError, TypeError):  # one that threadpoolctl does not know, as Apple's
        return str(np.show_config(mode="dicts")["Build Dependencies"]["blas"]["name"])
    return "unknown"
