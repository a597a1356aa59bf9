"""Files, functions and signatures that one can take in at once."""

import ast
from functools import cache
from pathlib import Path

import toppling

ROOT = Path(__file__).parents[2]
ROOMS = ("models", "workers", "orchestrator", "results")
FILE_LINES, FUNCTION_LINES, PARAMETERS = 800, 80, 7
SOURCE_LINES, TEST_LINES = 58_108, 27_571
"""Lines in all. Each landing that removes some lowers these; nothing raises them."""

WORDS_OF_DOCS = 13_000
CONSTRUCTORS = {"with_rough_base", "boulder", "ground"}
"""Functions that make a scene or a mesh from what they are given; class methods that make their class are too."""


def modules():
    return [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]


@cache
def functions(path):
    """Functions of a module, named by their places: classes of a file may have functions of the same name."""
    return [
        (f"{path.relative_to(ROOT)}:{node.lineno}:{node.name}", node)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]


def parameters(function):
    """Number of parameters, those that a method or a compiled property binds by itself aside."""
    args = function.args
    named = [*args.posonlyargs, *args.args, *args.kwonlyargs]
    return len(named) - (bool(named) and named[0].arg in ("self", "cls"))


def may_take_many(function):
    """Verbs of the command line and of Python, and public constructors, have as many as there is to ask."""
    made_by = [ast.unparse(value) for value in function.decorator_list]
    verb = any(entry.startswith("click.command") or ".command(" in entry for entry in made_by)
    constructor = "classmethod" in made_by and not function.name.startswith("_")
    return verb or constructor or function.name in CONSTRUCTORS or function.name in toppling.__all__


def over(sizes, most):
    return {name: size for name, size in sizes.items() if size > most}


def test_no_file_is_longer_than_eight_hundred_lines():
    sizes = {str(path.relative_to(ROOT)): path.read_text("utf-8").count("\n") for path in modules()}
    assert over(sizes, FILE_LINES) == {}


def test_the_source_and_the_tests_have_no_more_lines_than_they_had():
    assert sum(path.read_text("utf-8").count("\n") for path in modules()) <= SOURCE_LINES
    assert sum(path.read_text("utf-8").count("\n") for path in (ROOT / "tests").rglob("*.py")) <= TEST_LINES


def test_the_docs_have_no_more_words_than_their_limit():
    """Reports, which benchmarks write elsewhere, and the table of codes do not count."""
    pages = [path for path in (ROOT / "docs").rglob("*.md") if path.name != "errors.md"]
    text = " ".join(path.read_text("utf-8") for path in pages)
    assert sum(any(letter.isalnum() for letter in word) for word in text.split()) <= WORDS_OF_DOCS


def test_no_function_is_longer_than_eighty_lines():
    sizes = {name: node.end_lineno - node.lineno + 1 for path in modules() for name, node in functions(path)}
    assert over(sizes, FUNCTION_LINES) == {}


def test_no_signature_has_more_than_seven_parameters_but_of_verbs_and_public_constructors():
    sizes = {
        name: parameters(node)
        for path in modules()
        for name, node in functions(path)
        if not may_take_many(node)
    }
    assert over(sizes, PARAMETERS) == {}
