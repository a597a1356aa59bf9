"""A row says what computed it."""

import os
import re
import subprocess
import sys

from toppling.orchestrator.task import processor
from toppling.results.schema import SCHEMA, describe


def test_the_processor_and_its_kernels_are_known_here_and_no_part_of_an_answer():
    result = processor()
    assert {describe(SCHEMA.field(name))["group"] for name in result} == {"provenance"}
    assert set(result) == {"cpu", "kernels"}
    assert result["cpu"]
    assert re.fullmatch(r"BLAS \S.*, LLVM \S+", result["kernels"])
    assert "unknown" not in result["kernels"]


def test_another_kernel_of_blas_is_seen():
    """And the processor that code is made for is told rather than the one here."""
    program = "from toppling.orchestrator.task import processor; print(processor()['kernels'])"
    env = {"OPENBLAS_CORETYPE": "Haswell", "NUMBA_CPU_NAME": "generic"}
    asked = [sys.executable, "-P", "-c", program]
    done = subprocess.run(asked, env=env, capture_output=True, text=True, check=True)
    assert done.stdout == "BLAS Haswell, LLVM generic\n"


def test_a_worker_computes_with_one_thread_however_it_was_started():
    program = """
from threadpoolctl import threadpool_info
from toppling.orchestrator.task import single_blas_thread
before = {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}
single_blas_thread()
print(*before, *(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"))
"""
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], env={"OPENBLAS_NUM_THREADS": "2"}, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout.split() == [str(min(2, os.cpu_count() or 1)), "1", "1"]  # NumPy's and SciPy's
