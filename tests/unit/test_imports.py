"""The rooms stay apart: who may import whom, in every module, imports inside functions included."""

import ast
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("models", "workers", "orchestrator", "results")

FORBIDDEN = {
    "models": {"workers", "results", "orchestrator", "pybullet", "dask", "distributed"},
    "workers": {"results", "orchestrator", "open3d", "dask", "distributed"},
    "orchestrator": {"pybullet", "open3d"},
    "results": {"workers", "orchestrator", "pybullet", "open3d", "dask", "distributed"},
}
ONLY_UNDER = {
    "open3d": "models/scan",
    "pybullet": "workers",
    "dask": "orchestrator",
    "distributed": "orchestrator",
    "dask_jobqueue": "orchestrator",
    "obspy": "models/motions",
    "seaborn": "results/drawing",
    "PIL": "results/drawing",
    "matplotlib": "results/drawing",
    "numba": "models/compiled.py",
}
DOOR = "toppling.orchestrator.door"
"""Is `toppling` itself: what the orchestrator names as public is for it."""
PRIVATE_NAMES = 15
UNPICKLERS = {"pickle", "cPickle", "dill", "joblib", "shelve", "marshal"}


def modules():
    return [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]


@cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def importing(path):
    return [node for node in ast.walk(tree(path)) if isinstance(node, ast.Import | ast.ImportFrom | ast.Call)
            and (not isinstance(node, ast.Call) or called(node) == "import_module")]  # fmt: skip


def called(node):
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


@cache
def imported(path):
    return tuple(_imported(path))


def _imported(path):
    for node in importing(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import hides which room it means"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        else:
            yield from (name.value for name in node.args if isinstance(name, ast.Constant))


def offences(paths, forbidden):
    """Modules that import what they may not, with it."""
    found = {str(path.relative_to(ROOT)): sorted(filter(forbidden, imported(path))) for path in paths}
    return {name: taken for name, taken in found.items() if taken}


def within(*packages):
    """Whether a dotted name lies in one of some packages or modules."""
    return lambda name: any(f"{name}.".startswith(f"{package}.") for package in packages)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_none_that_lies_downstream_of_it(room):
    below = within(*FORBIDDEN[room], *(f"toppling.{name}" for name in FORBIDDEN[room]))
    assert not offences((ROOT / room).rglob("*.py"), below)


ORCHESTRATOR, MODELS, RESULTS = (f"toppling.{room}" for room in ("orchestrator", "models", "results"))
LAYERS = {
    "orchestrator/*.py": [f"{ORCHESTRATOR}.{above}" for above in ("studies", "verbs", "door", "run", "cli")],
    "orchestrator/studies/*.py": [f"{ORCHESTRATOR}.verbs"],
    "orchestrator/public/*.py": [f"{ORCHESTRATOR}.verbs"],
    "models/motions/**/*.py": [f"{MODELS}.scan"],
    "results/*.py": [f"{RESULTS}.{above}" for above in ("precision", "hazard", "analysis", "drawing")],
    **{f"results/{room}/**/*.py": [f"{RESULTS}.drawing"] for room in ("precision", "hazard", "analysis")},
}
"""What modules may not import of their own room: verbs stand above studies, drawing above analyses above readers."""


@pytest.mark.parametrize("paths", LAYERS)
def test_within_a_room_no_module_imports_what_stands_above_it(paths):
    """`run` puts the core of the orchestrator and the studies together; the command stands above both."""
    below = [path for path in ROOT.glob(paths) if path.name not in ("run.py", "cli.py")]
    assert below
    assert not offences(below, within(*LAYERS[paths]))


@pytest.mark.parametrize(("library", "home"), ONLY_UNDER.items())
def test_a_heavy_library_is_imported_in_a_single_room(library, home):
    elsewhere = [path for path in modules() if not path.is_relative_to(ROOT / home)]
    # Geometry of polygons draws nothing.
    assert not offences(elsewhere, lambda name: within(library)(name) and not within("matplotlib.path")(name))


def by_name():
    return {
        ".".join(("toppling", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__"): path
        for path in modules()
    }


def test_imports_go_round_in_no_circle():
    names = by_name()

    def taken(path):
        """Modules of the house that a module imports: of `from package import module` the module alone."""
        for node in importing(path):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names if alias.name in names)
            elif isinstance(node, ast.ImportFrom) and node.module in names:
                full = [f"{node.module}.{alias.name}" for alias in node.names]
                yield from (name if name in names else node.module for name in full)

    order = list(TopologicalSorter({name: set(taken(path)) for name, path in names.items()}).static_order())
    assert len(order) == len(names)


def test_a_function_that_only_its_own_module_uses_begins_with_an_underscore():
    """What has tests of its own is used by them: they take it by a public name."""
    anywhere = [
        path
        for folder in (*ROOMS, "benchmarks", "docs", "tests")
        for path in (ROOT / folder).rglob("*.*")
        if path.suffix in (".py", ".md")
    ]
    anywhere += [ROOT / "Makefile", ROOT / "pyproject.toml"]
    words = Counter(word for path in anywhere for word in set(re.findall(r"\w+", path.read_text("utf-8"))))
    offences = {
        f"{path.relative_to(ROOT)}:{node.name}"
        for path in modules()
        for node in tree(path).body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and words[node.name] == 1
    }
    assert not offences


def test_tests_name_little_that_is_private():
    """Fifteen at most, of modules whose state decides what is tested."""
    taken = re.compile(r"^ *from toppling[\w.]* import (\([^)]*\)|[^(\n]*)$", re.M)
    private = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in (ROOT / "tests").rglob("*.py")
        for names in taken.findall(path.read_text("utf-8"))
        for name in re.findall(r"\b_\w+", names)
    ]
    assert len(private) <= PRIVATE_NAMES, private


def named_in_face(path):
    body = tree(path).body
    (value,) = (
        node.value for node in body if isinstance(node, ast.Assign) and ast.unparse(node.targets) == "__all__"
    )
    return set(ast.literal_eval(value))


def test_every_room_exports_exactly_what_others_import():
    """`__all__` of a room's `__init__`: its modules that are imported from outside of it, and names of its own."""
    names = by_name()
    rooms = {name for name, path in names.items() if path.name == "__init__.py" and name != DOOR}

    def taken_of(full):
        """The room of an imported name, and what of that room: a module, or a name of its face."""
        parts = full.split(".")
        room = next(
            (room for end in range(len(parts), 0, -1) if (room := ".".join(parts[:end])) in rooms), None
        )
        return room, full.removeprefix(f"{room}.").partition(".")[0]

    taken = {room: set() for room in rooms}
    for importer, path in names.items():
        for full in imported(path):
            room, what = taken_of(full)
            if (
                room
                and full != room
                and (importer.startswith(DOOR) or not f"{importer}.".startswith(f"{room}."))
            ):
                taken[room].add(what)
    named = {room: named_in_face(names[room]) for room in rooms}
    unnamed = {room: sorted(taken[room] - named[room]) for room in rooms if taken[room] - named[room]}
    unused = {room: sorted(named[room] - taken[room]) for room in rooms if named[room] - taken[room]}
    assert (unnamed, unused) == ({}, {}), (
        "name it in the room's __init__, or do without; take out what nobody takes"
    )


@pytest.mark.parametrize(("module", "unneeded"), [
    ("models.scene", "numba"), ("orchestrator.status", "numba pandas scipy trimesh distributed"),
])  # fmt: skip
def test_what_takes_long_to_load_is_loaded_by_those_who_need_it(module, unneeded):
    asked = f"import sys, toppling.{module}; sys.exit(bool(set({unneeded.split()}) & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", asked], check=False).returncode == 0


def test_the_help_of_no_verb_loads_what_only_its_work_needs():
    heavy = {"numba", "pandas", "scipy", "trimesh", "matplotlib", "jinja2", "obspy", "distributed", "open3d"}
    verbs = sorted(path.stem for path in (ROOT / "orchestrator/verbs").glob("[!_]*.py"))
    asked = f"""import importlib, sys
for verb in {verbs}:
    importlib.import_module(f"toppling.orchestrator.verbs.{{verb}}")
    if loaded := {heavy} & sys.modules.keys():
        sys.exit(f"{{verb}} loads {{loaded}}")"""
    assert not subprocess.run([sys.executable, "-c", asked], check=False, capture_output=True).stderr


def test_nothing_read_from_disk_can_be_unpickled():
    assert not offences(modules(), within(*UNPICKLERS))
