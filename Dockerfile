# One image for scheduler, workers and client, so that their versions cannot differ. It holds what shaking needs:
# neither Open3D nor plotting. PyBullet has wheels for CPython 3.11 only.
# A release names its base by digest (docs/guide/cluster.md); the label says which was taken.
ARG BASE=python:3.11-slim
FROM ${BASE}
ARG BASE
LABEL org.opencontainers.image.base.name=${BASE}

ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PYTHONUNBUFFERED=1 PYTHONSAFEPATH=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
WORKDIR /opt/toppling

# The locked dependencies first: they change less often than the code.
COPY requirements-worker.lock ./
# Neither PyBullet's sample robots (150 MB) nor the tests of packages (45 MB) are used.
RUN python3.11 -m venv /opt/venv && /opt/venv/bin/pip install --quiet --require-hashes --no-deps -r requirements-worker.lock \
    && cd /opt/venv/lib/python3.11/site-packages && rm -rf pybullet_data pybullet_envs pybullet_robots pybullet_examples \
    && find . -type d -name tests -prune -exec rm -rf {} +
ENV PATH=/opt/venv/bin:$PATH

# What builds the program is locked too.
COPY requirements.lock pyproject.toml README.md ./
RUN awk '/^[^ ]/ {keep = /^setuptools==/} keep' requirements.lock > build.lock \
    && pip install --quiet --require-hashes --no-deps -r build.lock
COPY models models
COPY workers workers
COPY orchestrator orchestrator
COPY results results
RUN pip install --quiet --no-deps --no-build-isolation .

# Dask reads /etc/dask: scheduler and workers get the settings that keep a crash from costing innocent jobs.
COPY orchestrator/dask.yaml /etc/dask/toppling.yaml

# Compiled code for any processor of this kind, with the answers and the speed of code made for one: each account copies
# it to a folder of its own, since what others may write is not executed.
ENV NUMBA_CPU_NAME=generic TOPPLING_COMPILED=/opt/toppling/compiled
RUN TOPPLING_CACHE=/opt/toppling/compiled python -c "from toppling.workers.shaking import compile_once; compile_once()" \
    && chmod -R a+rX /opt/toppling/compiled

# No writes outside /runs and /tmp, so that any user may be given, Apptainer's included.
RUN useradd --create-home --uid 1000 toppling && mkdir /runs && chown toppling /runs
USER 1000:1000
WORKDIR /runs
CMD ["toppling", "--help"]
