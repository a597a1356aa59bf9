"""The four walks of what the program carries: through how many functions and files, how often back and up.

    make demo && .venv/bin/python benchmarks/walks.py [job | record | points | map] [--list]

A *stop* is a function, comprehensions aside, that is given what is carried or hands it back, counted once; a *return*
an entry into a file that was left before, stops in the order in which they are first entered; a *climb* a call from a
file to another that imports it, directly or not. Properties count; a job's shake and a record's steps do not.
"""

import ast
import contextlib
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from distributed import Client, LocalCluster

import toppling.models
from toppling.models.motions.ensemble import Ensemble
from toppling.models.scene import Scene
from toppling.orchestrator import rocks_of_run, task
from toppling.workers.job import Assets, JobSpec, identity

ROOT = Path(toppling.models.__path__[0]).resolve().parent
DEMO = Path(__file__).parents[1] / "demo"
ROOMS = ("models", "workers", "orchestrator", "results")
INSIDE = tuple(f"{ROOT / room}/" for room in ROOMS)
MANY = 1000
"""Rows from which on an array is a cloud."""

Stop = tuple[str, str]


def imported_from() -> dict[str, set[str]]:
    """For each file of the house all that it imports, directly or not."""
    direct: dict[str, set[str]] = {}
    for path in (path for room in ROOMS for path in (ROOT / room).rglob("*.py")):
        froms = [node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.ImportFrom)]
        names = [f"{node.module}.{entry.name}" for node in froms for entry in node.names]
        names += [str(node.module) for node in froms]
        files = {"/".join(name.split(".")[1:]) + ".py" for name in names if name.startswith("toppling.")}
        direct[str(path.relative_to(ROOT))] = files
    while True:
        further = {
            file: taken.union(*(direct.get(value, set()) for value in taken))
            for file, taken in direct.items()
        }
        if further == direct:
            return direct
        direct = further


class Walk:
    """The stops of what is carried, while the block runs, in all threads of this process."""

    def __init__(self, tracked: Callable[[Any], bool], left_out: str) -> None:
        self.tracked, self.left_out = tracked, left_out
        self.stops: dict[Stop, None] = {}
        self.calls: dict[tuple[Stop, Stop], None] = {}
        self._thread = threading.local()

    def __enter__(self) -> "Walk":
        threading.setprofile(self._look)
        sys.setprofile(self._look)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)
        threading.setprofile(None)

    def _look(self, frame: FrameType, event: str, handed: Any) -> None:
        code = frame.f_code
        if event not in ("call", "return") or not code.co_filename.startswith(INSIDE):
            return
        above: list[tuple[FrameType, bool]] = self._thread.__dict__.setdefault("above", [])
        if event == "return":
            while above and above.pop()[0] is not frame:
                pass
        hidden = bool(above) and above[-1][1]
        count = code.co_argcount + code.co_kwonlyargcount
        values = (
            [handed] if event == "return" else [frame.f_locals.get(name) for name in code.co_varnames[:count]]
        )
        if not hidden and any(map(self.tracked, values)):
            self._note(code, above)
        if event == "call":
            above.append((frame, hidden or code.co_name == self.left_out))

    def _note(self, code: Any, above: list[tuple[FrameType, bool]]) -> None:
        if code.co_qualname.endswith(">") or (
            code.co_name.startswith("__") and code.co_name not in ("__init__", "__call__")
        ):
            return
        stop = str(Path(code.co_filename).relative_to(ROOT)), code.co_qualname
        self.stops.setdefault(stop)
        if above:
            caller = above[-1][0].f_code
            self.calls.setdefault(
                ((str(Path(caller.co_filename).relative_to(ROOT)), caller.co_qualname), stop)
            )

    def counted(self) -> dict[str, int]:
        """Stops, files, returns, climbs."""
        files = [file for file, _ in self.stops]
        legs = [file for before, file in zip(["", *files], files, strict=False) if file != before]
        imports = imported_from()
        climbs = {
            (a, b)
            for a, b in self.calls
            if a[0] in imports.get(b[0], ()) and b[0] not in imports.get(a[0], ())
        }
        for a, b in sorted(climbs):
            print(f"  climbs: {':'.join(a)} -> {':'.join(b)}")
        return {
            "stops": len(files),
            "files": len(set(files)),
            "returns": len(legs) - len(set(legs)),
            "climbs": len(climbs),
        }


def of_kind(kinds: tuple[str, ...], more: Callable[[Any], bool] = lambda _: False) -> Callable[[Any], bool]:
    """Whether something, or the first of a sequence, is of a class of the house with one of some names, or more."""

    def tracked(value: Any, deep: bool = True) -> bool:
        if type(value).__name__ in kinds and type(value).__module__.startswith("toppling."):
            return True
        return (
            deep and isinstance(value, list | tuple) and bool(value) and tracked(value[0], False)
        ) or more(value)

    return tracked


@contextlib.contextmanager
def here() -> Iterator[Client]:
    """A cluster of one worker in this process."""
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        Client(cluster.scheduler_address) as client,
    ):
        yield client


def job() -> Walk:
    """From a campaign's file to the row in the results, the shake itself replaced."""
    from toppling.orchestrator.public.running import run

    def row_of(spec: JobSpec, assets: Assets) -> dict[str, Any]:  # noqa: ARG001
        answer = {"status": "ok", "outcome": "toppled", "toppled": True, "pga_m_s2": spec.pga_m_s2}
        return {**identity(spec), **answer, "wall_s": 0.1, "physics_version": "0", "friction_factor": 1.0}

    def as_it_is(scene: Scene, pool: Any = None) -> Scene:  # noqa: ARG001
        return scene

    task.run_job, task.compile_once, rocks_of_run.settled = row_of, lambda: None, as_it_is
    kinds = (
        "Campaign", "Plan", "PlannedScene", "Planned", "JobSpec", "_Session", "Work", "Execution", "Dispatch",
        "Batch",
    )  # fmt: skip
    folder = Path(tempfile.mkdtemp())
    record = Ensemble.load(DEMO / "ensemble").record_ids[0]
    (folder / "campaign.toml").write_text(
        f'scene = "{DEMO}/scene"\nensemble = "{DEMO}/ensemble"\nrecords = ["{record}"]\npga_m_s2 = [3.0]\n'
        'azimuth_deg = [0.0]\nfriction = [0.8]\naudit = 0\npreset = "fast"\n'
    )
    with Walk(of_kind(kinds, is_row), "run_job") as walk:
        run(folder / "campaign.toml", folder / "run", cluster=here())
    return walk


def record() -> Walk:
    """From a file of samples to the integrator that a shake is stepped with."""
    from toppling.models.motions.importing import import_records, record_files
    from toppling.workers.shaking import compile_once, shake

    folder = Path(tempfile.mkdtemp())
    time_s = np.arange(0.0, 20.0, 0.01)
    pulse = 3.0 * np.sin(2.0 * np.pi * time_s) * np.exp(-((time_s - 8.0) ** 2) / 8.0)
    table = pd.DataFrame(
        {"time (s)": time_s, "EW (m/s2)": pulse, "NS (m/s2)": 0.5 * pulse, "UD (m/s2)": 0.2 * pulse}
    )
    (folder / "files").mkdir()
    table.to_csv(folder / "files" / "quake.csv", index=False)
    block = Scene.block(0.2, 0.2, 0.6, friction=0.8)
    kinds = ("Component", "Candidate", "Record", "Motion", "Imposed", "Import", "Problem", "Shaking")
    compile_once()
    with Walk(of_kind(kinds, lambda value: is_array(value) and len(value) > MANY), "run") as walk:
        found = import_records(record_files([folder / "files"]))
        Ensemble.write(folder / "quakes", found.records)
        ensemble = Ensemble.load(folder / "quakes")
        shake(block, ensemble.motion(ensemble.record_ids[0], pga_m_s2=5.0, azimuth_deg=40.0), "fast")
    return walk


def points() -> Walk:
    """From files of points to a scene on disk."""
    from toppling.orchestrator.public.making import scan

    files = sorted((DEMO / "scan").glob("*.ply"))
    tracked = of_kind(
        ("Cloud", "Rock", "Interface", "Scene"), lambda value: is_array(value) and len(value) > MANY
    )
    with Walk(tracked, "") as walk:
        scan(files, Path(tempfile.mkdtemp()) / "scene")
    return walk


def rows_to_map() -> Walk:
    """From the rows of a run to the figure of a map."""
    from toppling.results.analysis.fragility import PLANES
    from toppling.results.drawing.maps import map_figure
    from toppling.results.reader import open_run

    with Walk(of_kind(("Run",), lambda value: isinstance(value, pd.DataFrame | pa.Table)), "") as walk:
        run = open_run(DEMO / "run")
        plane = PLANES["pga_pgv"]
        map_figure(run.weighted(run.frame()), plane)
    return walk


def is_row(value: object) -> bool:
    """Whether something is the row of a job, or a list or table of such."""
    if isinstance(value, list) and value:
        value = value[0]
    return "job_id" in (
        value if isinstance(value, dict) else value.column_names if isinstance(value, pa.Table) else ()
    )


def is_array(value: object) -> bool:
    """Whether something is an array of places or of three components, (n, 3)."""
    return isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == 3


WALKS: dict[str, Callable[[], Walk]] = {"job": job, "record": record, "points": points, "map": rows_to_map}

if __name__ == "__main__":
    named = [value for value in sys.argv[1:] if value in WALKS]
    for name in named or WALKS:
        walked = WALKS[name]()
        if "--list" in sys.argv:
            print(*(f"  {file}: {function}" for file, function in walked.stops), sep="\n")
        print(name, walked.counted(), flush=True)
