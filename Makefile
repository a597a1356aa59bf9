# Everything runs in .venv, made from requirements.lock by `make setup`, which every target calls itself.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Containers often set it: each of the hundreds of processes that tests start would then compile what it imports.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup system-libraries demo study examples test end-to-end test-changed test-slow test-all lint compiled format lock site gallery packages clean

help:  ## show the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 20

setup: system-libraries $(STAMP)  ## make .venv with the command toppling, from the lock file

# Python compiles what is imported when it is: pip would compile all of 2 GB.
$(STAMP): requirements.lock pyproject.toml
	@if command -v $(PYTHON) >/dev/null; then $(PYTHON) -m venv $(VENV); \
	elif command -v uv >/dev/null; then \
		echo "make setup: $(PYTHON) not found; uv fetches a Python 3.11 for .venv" >&2; \
		uv venv --quiet --seed --clear --python 3.11 $(VENV); \
	else \
		echo "make setup: $(PYTHON) not found. PyBullet has wheels for CPython 3.11 only: install it, install uv (which fetches it), or name it with 'make PYTHON=/path/to/python3.11 setup'." >&2; exit 1; \
	fi
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --require-hashes --no-deps -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $(STAMP)

system-libraries:
	@sh .ci/system-libraries.sh

demo: setup  ## scan, records, campaign, maps: the whole way on inputs the project makes itself
	$(BIN)/toppling demo

# The demo's folder holds the scene and the records that the examples shake.
demo/scene: setup
	$(BIN)/toppling demo

study: demo/scene  ## the published study on the demo's rock and records; goes on where it was stopped
	$(BIN)/python examples/study.py demo/scene demo/ensemble runs/study

examples: demo/scene  ## the programs of examples/ on the demo's inputs, a few minutes; figures in build/examples
	mkdir -p build/examples
	$(BIN)/python examples/pulse.py demo/scene --out build/examples/pulse.png
	$(BIN)/python examples/ramp.py demo/scene demo/ensemble --out build/examples/ramp.png
	$(BIN)/python examples/accuracy.py demo/scene demo/ensemble --jobs 60 --out build/examples/accuracy.png
	$(BIN)/python examples/study.py demo/scene demo/ensemble build/examples/study --pga-step 3 --directions 2 --preset fast
	@test -z "$(SHAKETABLE)" || $(BIN)/python examples/validation.py $(SHAKETABLE) --mesh $(MESH) --outcome $(OUTCOME) --out build/examples/validation

# Tests of the cluster wait for workers that start and die: two at a time, the slow ones alone, and nothing else beside.
TESTS := "not slow and not thorough"
CLUSTERS := 2
SLOWEST := --durations 60 --durations-min 2
test: setup  ## the fast tests, at most four minutes on two cores
	$(BIN)/python -m pytest -m $(TESTS) $(SLOWEST) --numprocesses logical --dist worksteal --ignore tests/cluster --ignore tests/end_to_end
	$(BIN)/python -m pytest -m $(TESTS) $(SLOWEST) --numprocesses $(CLUSTERS) --dist loadfile tests/cluster

end-to-end: setup  ## the guide, an experiment and the built wheel, minutes
	$(BIN)/python -m pytest -m $(TESTS) $(SLOWEST) --numprocesses logical --dist worksteal tests/end_to_end

test-changed: setup  ## the thorough tests of what has changed since they last passed (.ci/passed.json)
	$(BIN)/python .ci/thorough.py run $(SLOWEST)

test-slow: setup  ## the tests that take minutes
	$(BIN)/python -m pytest -m slow $(SLOWEST) tests

test-all: test end-to-end  ## all tests: fast, thorough (also of what has not changed) and slow
	$(BIN)/python .ci/thorough.py run --all $(SLOWEST)
	$(MAKE) test-slow

# Neither mypy nor the site knows mapped packages: they are shown them as the wheel lays them out.
packages:
	@rm -rf build/typing && mkdir -p build/typing/toppling
	@ln -s $(CURDIR)/orchestrator/door/* $(foreach room,models orchestrator results workers,$(CURDIR)/$(room)) build/typing/toppling/

lint: setup packages  ## ruff and the type check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	MYPYPATH=build/typing:benchmarks $(BIN)/mypy build/typing benchmarks examples

compiled: setup  ## compile the inner loop for this machine, which the first test would wait for
	$(BIN)/python -c "from toppling.workers.shaking import compile_once; compile_once()"

format: setup  ## let ruff rewrite what it can
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock: setup  ## resolve the dependencies anew into the two lock files
	$(BIN)/uv pip compile pyproject.toml --extra dev --python-version 3.11 --universal --generate-hashes --no-emit-index-url --no-header --quiet --upgrade -o requirements.lock
	$(BIN)/uv pip compile pyproject.toml --extra cluster --python-version 3.11 --universal --generate-hashes --no-emit-index-url --no-header --quiet --upgrade -o requirements-worker.lock

site: setup packages  ## build the documentation's site into build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict

gallery: setup  ## run the demo and draw the documentation's gallery anew
	$(BIN)/python benchmarks/gallery.py

clean:  ## remove .venv, build files, caches and the folder demo; runs/ stays
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis demo
