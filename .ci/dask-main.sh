#!/usr/bin/env bash
# By hand, every few weeks: the tests of real workers against the next version of Dask, in an environment of its own.
set -euo pipefail
cd "$(dirname "$0")/.."

python3.11 -m venv build/dask-main
build/dask-main/bin/pip install --quiet --require-hashes --no-deps -r requirements.lock
build/dask-main/bin/pip install --quiet --no-deps --no-build-isolation --editable .
build/dask-main/bin/pip install --quiet --upgrade \
    git+https://github.com/dask/dask git+https://github.com/dask/distributed
build/dask-main/bin/python -m pytest -q tests/cluster tests/unit/orchestrator
