"""A row says what computed it."""

import os
import re
import subprocess
import sys

import pyarrow.parquet as pq
from seeded import row

from toppling.models.files.digest import write_table
from toppling.orchestrator.code_identity import processor
from toppling.results.reader import open_run
from toppling.results.schema import ADDED_LATER, SCHEMA, describe
from toppling.results.store import compact, write_part


def test_the_processor_and_its_kernels_are_known_here_and_no_part_of_an_answer():
    result = processor()
    assert {describe(SCHEMA.field(name))["group"] for name in result} == {"provenance"}
    assert set(result) == {"cpu", "kernels"} < set(ADDED_LATER)
    assert result["cpu"]
    assert re.fullmatch(r"BLAS \S.*, LLVM \S+", result["kernels"])
    assert "unknown" not in result["kernels"]


def test_another_kernel_of_blas_is_seen():
    """And the processor that code is made for is told rather than the one here."""
    program = "from toppling.orchestrator.code_identity import processor; print(processor()['kernels'])"
    env = {"OPENBLAS_CORETYPE": "Haswell", "NUMBA_CPU_NAME": "generic"}
    asked = [sys.executable, "-P", "-c", program]
    done = subprocess.run(asked, env=env, capture_output=True, text=True, check=True)
    assert done.stdout == "BLAS Haswell, LLVM generic\n"


def test_a_worker_computes_with_one_thread_however_it_was_started():
    program = """
from threadpoolctl import threadpool_info
from toppling.orchestrator.code_identity import single_blas_thread
before = {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}
single_blas_thread()
print(*before, *(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"))
"""
    done = subprocess.run(
        [sys.executable, "-P", "-c", program], env={"OPENBLAS_NUM_THREADS": "2"}, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout.split() == [str(min(2, os.cpu_count() or 1)), "1", "1"]  # NumPy's and SciPy's


def test_results_of_before_these_columns_are_read_with_nulls(tmp_path):
    part = write_part(tmp_path, [row("a", toppled=True, cpu="of today")])
    write_table(pq.read_table(part).drop_columns(list(ADDED_LATER)), part)
    write_part(tmp_path, [row("b", toppled=True, cpu="of today")])
    for run in (open_run(tmp_path), open_run(compact(tmp_path).parent)):
        assert sorted(run.table()["cpu"].to_pylist(), key=str) == [None, "of today"]
        assert run.sql("select count(*) n from results where cpu is null")["n"].to_pylist() == [1]
