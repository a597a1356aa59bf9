"""The compose file for real: image, containers, a container killed, another cut from the network, the same rows.

Starts an engine of its own where none runs and the test may (root, Debian's `docker.io`, `docker-compose` and
`debootstrap`). Where no image can be pulled, it makes its own base image with `debootstrap`.
"""

import os
import shutil
import subprocess
import tempfile
import time
import uuid
from pathlib import Path

import pytest
from answers import answers_of, differences, sorted_answers

from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator.campaign import Campaign
from toppling.orchestrator.plan import plan
from toppling.workers.job import Assets, run_job

PROJECT = Path(__file__).parents[2]
PULLED_BASE = "python:3.11-slim"
OWN_BASE = "toppling-test-base"
IMAGE = "toppling-test"
AUTHORITIES = Path("/etc/ssl/certs/ca-certificates.crt")
WORKERS = 3
# So that a worker without a network is missed soon.
OVERRIDE = 'services: {scheduler: {environment: {DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL: "10s"}}}\n'


def call(*command, **options):
    done = subprocess.run(command, capture_output=True, text=True, **options)
    assert done.returncode == 0, (
        f"{' '.join(map(str, command))}:\n{done.stdout[-2000:]}\n{done.stderr[-3000:]}"
    )
    return done.stdout


def works(*command):
    return (
        shutil.which(command[0]) is not None and subprocess.run(command, capture_output=True).returncode == 0
    )


@pytest.fixture(scope="module")
def engine():
    """A container engine that answers to `docker`."""
    if shutil.which("docker") is None:
        pytest.skip("no docker: apt-get install docker.io docker-compose debootstrap")
    if works("docker", "info"):
        yield
        return
    if os.geteuid() != 0 or shutil.which("dockerd") is None:
        pytest.skip("no container engine runs, and only root can start one with dockerd")
    folder = Path(tempfile.mkdtemp(prefix="toppling-engine-"))
    socket = f"unix://{folder}/docker.sock"
    command = [
        "dockerd",
        "--host",
        socket,
        "--pidfile",
        str(folder / "pid"),
        "--exec-root",
        str(folder / "exec"),
    ]
    # Images outlive the test, or each would build them anew.
    data = Path("/var/tmp/toppling-test-engine")
    with (folder / "log").open("w") as told:
        daemon = subprocess.Popen([*command, "--data-root", str(data)], stdout=told, stderr=told)
    before = os.environ.get("DOCKER_HOST")
    os.environ["DOCKER_HOST"] = socket
    try:
        end = time.monotonic() + 60
        while not works("docker", "info"):
            if daemon.poll() is not None or time.monotonic() > end:
                pytest.skip(f"dockerd does not start here: {(folder / 'log').read_text()[-600:]}")
            time.sleep(0.5)
        yield
    finally:
        daemon.terminate()
        daemon.wait(60)
        subprocess.run(
            ["umount", str(folder / "exec/netns/default")], capture_output=True
        )  # the engine leaves it
        shutil.rmtree(folder, ignore_errors=True)
        os.environ.pop("DOCKER_HOST")
        if before is not None:
            os.environ["DOCKER_HOST"] = before


@pytest.fixture(scope="module")
def image(engine, tmp_path_factory):
    """The project's image, built from its Dockerfile as it stands."""
    call(
        "docker", "build", "--network", "host", "--build-arg", f"BASE={_base(tmp_path_factory)}",
        "--tag", IMAGE, str(PROJECT), env={**os.environ, "DOCKER_BUILDKIT": "0"},
    )  # fmt: skip
    return IMAGE


def _base(tmp_path_factory):
    if works("docker", "image", "inspect", OWN_BASE):
        return OWN_BASE
    if works("timeout", "120", "docker", "pull", PULLED_BASE):
        return PULLED_BASE
    if shutil.which("debootstrap") is None:
        pytest.skip(f"{PULLED_BASE} cannot be pulled, and there is no debootstrap to make a base image")
    root = tmp_path_factory.mktemp("base") / "root"
    packages = "ca-certificates,python3.11,python3.11-venv,python3-distutils,python3-lib2to3"
    call("debootstrap", "--variant=minbase", f"--include={packages}", "bookworm", str(root))
    # Whom this host trusts, pip inside the image trusts too.
    shutil.copy(AUTHORITIES, root / AUTHORITIES.relative_to("/"))
    (root / "etc/pip.conf").write_text(f"[global]\ncert = {AUTHORITIES}\n")
    packed = subprocess.Popen(["tar", "--directory", str(root), "--create", "."], stdout=subprocess.PIPE)
    call("docker", "import", "-", OWN_BASE, stdin=packed.stdout)
    shutil.rmtree(root)
    return OWN_BASE


@pytest.fixture
def compose(image, tmp_path):
    """`docker compose` with the project's file, a scheduler and workers up."""
    program = ["docker", "compose"] if works("docker", "compose", "version") else ["docker-compose"]
    if not works(*program, "version"):
        pytest.skip("neither 'docker compose' nor docker-compose: apt-get install docker-compose")
    (tmp_path / "override.yml").write_text(OVERRIDE)
    (tmp_path / "runs").mkdir()
    name = f"toppling{uuid.uuid4().hex[:8]}"
    files = ["--file", str(PROJECT / "docker-compose.yml"), "--file", str(tmp_path / "override.yml")]
    environment = {
        **os.environ, "TOPPLING_IMAGE": image, "TOPPLING_RUNS": str(tmp_path / "runs"),
        "TOPPLING_USER": f"{os.getuid()}:{os.getgid()}", "TOPPLING_PORT": "0",
    }  # fmt: skip

    def go(*arguments):
        return [*program, "--project-name", name, *files, *arguments]

    call(*go("up", "--detach", "--no-build", "--scale", f"worker={WORKERS}"), env=environment)
    try:
        yield go, environment, f"{name}_default"
    finally:
        call(*go("down", "--timeout", "5"), env=environment)


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_a_campaign_on_containers_gives_the_rows_of_one_process_whatever_befalls_them(
    compose, inputs, tmp_path
):
    go, environment, network = compose
    runs = tmp_path / "runs"
    shutil.copytree(inputs, runs, dirs_exist_ok=True)
    # Enough jobs for the faults to strike amidst them.
    text = (inputs / "campaign.toml").read_text().replace("[0, 90, 200]", str([*range(0, 360, 6)]))
    (runs / "campaign.toml").write_text(text)
    workers = call(*go("ps", "--quiet", "worker"), env=environment).split()
    assert len(workers) == WORKERS
    command = go("run", "--rm", "-T", "client", "run", "/runs/campaign.toml", "--out", "/runs/first")
    client = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    _wait(lambda: list((runs / "first" / "parts").glob("part-*")) or client.poll() is not None)
    assert client.poll() is None, client.communicate()[0]
    call("docker", "kill", workers[0])
    call("docker", "network", "disconnect", network, workers[1])
    assert client.poll() is None, "the faults came after the end"
    time.sleep(15)
    call("docker", "network", "connect", network, workers[1])
    told, _ = client.communicate(timeout=600)
    assert client.returncode == 0, told
    campaign = Campaign.read(runs / "campaign.toml")
    scene, ensemble = Scene.load(campaign.scene), Ensemble.load(campaign.ensemble)
    planned, assets = plan(campaign, scene, ensemble), Assets(scene, ensemble)
    undisturbed = sorted_answers([run_job(planned.spec(job), assets) for job in range(len(planned))])
    assert differences(answers_of(runs / "first"), undisturbed) == []


def _wait(condition, seconds=180):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.1)
