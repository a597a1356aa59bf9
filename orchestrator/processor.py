"""What computes here: processors differ in the last bit, by which kernels BLAS and the compiler choose for them."""

import ctypes
import platform
from collections.abc import Collection
from contextlib import suppress
from functools import cache
from pathlib import Path

import llvmlite.binding
import numpy as np

_CORE_NAMES = (
    "scipy_openblas_get_corename64_", "scipy_openblas_get_corename",
    "openblas_get_corename64_", "openblas_get_corename",
)  # fmt: skip


@cache
def processor() -> dict[str, str]:
    """Columns of a row that say what computed it: the processor's model, and the kernels of BLAS and LLVM."""
    return {"cpu": _model(), "kernels": f"BLAS {_blas_kernel()}, LLVM {llvmlite.binding.get_host_cpu_name()}"}


def unlike(kernels: Collection[str]) -> str:
    """What a run on such kernels should say of itself; nothing where all are alike."""
    names = sorted({name for name in kernels if name})
    if len(names) < 2:
        return ""
    return (
        f"the workers compute with unlike kernels ({'; '.join(names)}): rows repeat bit for bit on like machines only, "
        "and near the threshold a last bit may flip a single answer (column kernels says which computed what)"
    )


def _model() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _blas_kernel() -> str:
    """Kernel that OpenBLAS has chosen; where NumPy has another library, that library's name."""
    for path in (Path(np.__file__).parents[1] / "numpy.libs").glob("*openblas*"):
        with suppress(OSError):
            library = ctypes.CDLL(str(path))  # loaded already: NumPy's own
            for name in _CORE_NAMES:
                if hasattr(library, name):
                    ask = getattr(library, name)
                    ask.restype = ctypes.c_char_p
                    return (ask() or b"unknown").decode()
    with suppress(KeyError, TypeError):
        return str(np.show_config(mode="dicts")["Build Dependencies"]["blas"]["name"])
    return "unknown"
