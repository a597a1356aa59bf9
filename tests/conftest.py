"""How hypothesis looks for examples in all tests, how processes share them, and fixtures of many."""

import os
import shutil
import signal
import subprocess
import sys
import zipfile
from itertools import chain, groupby
from pathlib import Path

# Processes that test beside each other share the processors: threads of BLAS would only wait for each other.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings

# An example may take long where other tests have the processors: time says nothing about a law.
slow = [HealthCheck.too_slow]
settings.register_profile("seeded", deadline=None, derandomize=True, suppress_health_check=slow)
settings.load_profile("seeded")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Deal the files out to the processes, those of long tests first: none is left at the end with many of them."""
    hands = [[] for _ in range(int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))]
    if len(hands) == 1:
        return

    def long(tests):
        return sum(any(map(test.get_closest_marker, ("thorough", "slow"))) for test in tests)

    files = [list(tests) for _, tests in groupby(items, lambda test: test.path)]
    for tests in sorted(files, key=long, reverse=True):
        min(hands, key=long if long(tests) else len).extend(tests)
    items[:] = chain.from_iterable(hands)


@pytest.fixture(autouse=True)
def _ctrl_c_still_stops_the_tests():
    """A test that calls the command within this process leaves Ctrl-C ignored, as at the command's end."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def few_draws():
    """A hidden base is drawn 12 times."""
    from virtual_rocks import drawing_few

    with drawing_few():
        yield


@pytest.fixture(scope="module")
def no_pictures():
    """A scene's picture is an empty file: for laws about the other files."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("toppling.results.drawing.scene_figures.draw_scene", lambda scene, path: path.touch())
        yield


@pytest.fixture
def drawn_alone(monkeypatch):
    """Say which figures are drawn, as SVG: all others are files without a picture, for laws about the files."""
    from matplotlib.figure import Figure

    def draw(*stems, savefig=Figure.savefig):
        named = tuple(f".{stem}.svg." for stem in stems)

        def saved(figure, place, **options):
            if isinstance(place, Path):
                savefig(figure, place, **options) if place.name.startswith(named) else place.touch()

        monkeypatch.setattr(Figure, "savefig", saved)

    return draw


@pytest.fixture
def empty_figures(drawn_alone):
    """Figures are files without a picture: for laws about the tables beside them."""
    drawn_alone()


@pytest.fixture(scope="module")
def bucket():
    """Name of a bucket on an S3 server on loopback."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer(
        ip_address="127.0.0.1", port=0, verbose=False
    )
    server.start()
    host, port = server.get_host_and_port()
    variables = {
        "AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b", "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
    }  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        for name, value in variables.items():
            patch.setenv(name, value)
        pytest.importorskip("boto3").client("s3").create_bucket(Bucket="bucket")
        yield "bucket"
    server.stop()


ROOT = Path(__file__).parents[1]
ROOMS = ("models", "orchestrator", "results", "workers")


@pytest.fixture(scope="session")
def unpacked(tmp_path_factory):
    """The built wheel, unpacked: what pip would install."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"  # a build inside the checkout would take up what an earlier one left
    for room in ROOMS:
        shutil.copytree(ROOT / room, source / room, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*build, "--wheel-dir", str(folder), str(source)], check=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "unpacked")
    return folder / "unpacked"
