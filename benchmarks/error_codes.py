"""Table of the codes of errors in docs/errors.md, from where the program raises them.

python -m benchmarks.error_codes
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from pages import put

ROOT = Path(__file__).parents[1]
ROOMS = ("models", "orchestrator", "results", "workers")
CODE = re.compile(r"[a-z]+(_[a-z0-9]+)*\.[a-z][a-z0-9]*(_[a-z0-9]+)*")


def main() -> None:
    """Write the table."""
    put(ROOT / "docs" / "errors.md", "codes", table())


def table() -> str:
    """Rows of code, what is said with it, and the remedy where that is the same whatever was given."""
    text: dict[str, tuple[list[str], list[str]]] = {}
    for _, code, what, remedy in raised():
        for remaining, words in zip(text.setdefault(code, ([], [])), (what, remedy), strict=True):
            if words not in remaining:
                remaining.append(words)
    lines = ["| code | what is wrong | what to do |", "|---|---|---|"]
    for code, (whats, remedies) in sorted(text.items()):
        result = [what for what in whats if re.search("[a-z]{2}", what)]
        what = "; or: ".join(result) or code.partition(".")[2].replace("_", " ")
        lines.append(f"| `{code}` | {_cell(what)} | {_cell(remedies[0]) if len(remedies) == 1 else ''} |")
    return "\n".join(lines)


@cache
def raised() -> tuple[tuple[str, str, str, str], ...]:
    """Room, code, what is wrong and remedy (empty where they are no constant) of each place that names a code."""
    return tuple(_raised())


def _raised() -> Iterator[tuple[str, str, str, str]]:
    trees = {
        path: ast.parse(path.read_text("utf-8"))
        for room in ROOMS
        for path in sorted((ROOT / room).rglob("*.py"))
    }
    makers = {name for tree in trees.values() for name in _makers(tree)} - {"__init__", "_Reader"}
    for path, tree in trees.items():
        remedies = _of_factories(tree)
        for scope in [tree, *(node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))]:
            for call in _calls(scope, makers):
                texts = [*_texts(call, scope), "", "", ""]
                named = {keyword.arg: _words(keyword.value, scope, call.lineno) for keyword in call.keywords}
                remedy = named.get("remedy") or remedies.get(ast.unparse(call.func), texts[2])
                for code in _codes(call.args[0]):
                    yield (
                        path.relative_to(ROOT).parts[0],
                        code,
                        named.get("what", texts[0]),
                        "" if "…" in remedy else remedy,
                    )


def _makers(tree: ast.Module) -> Iterator[str]:
    """Names of what makes an error of a code and what is said with it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and "code" in [arg.arg for arg in node.args.args[:2]]:
            yield node.name
        if isinstance(node, ast.ClassDef) and any("Error" in ast.unparse(base) for base in node.bases):
            yield node.name
    yield from _of_factories(tree)


def _calls(scope: ast.AST, makers: set[str]) -> Iterator[ast.Call]:
    """Calls of a function, or outside of all, that make an error; those of functions within it aside."""
    for node in ast.iter_child_nodes(scope):
        if isinstance(node, ast.Call) and node.args and _name(node.func) in makers:
            yield node
        if not isinstance(node, ast.FunctionDef):
            yield from _calls(node, makers)


def _name(node: ast.AST) -> str:
    return getattr(node, "attr", getattr(node, "id", ""))


def _codes(node: ast.AST) -> list[str]:
    if isinstance(node, ast.IfExp):
        return [*_codes(node.body), *_codes(node.orelse)]
    found = isinstance(node, ast.Constant) and isinstance(node.value, str) and CODE.fullmatch(node.value)
    return [found[0]] if found else []


def _texts(call: ast.Call, scope: ast.AST) -> list[str]:
    """Texts among the arguments behind the code, from what is wrong on; where it was found may stand before."""
    texts = [_words(arg, scope, call.lineno) for arg in call.args[1:]]
    return [text for text in texts if text and not text.startswith("--")]


def _words(node: ast.AST, scope: ast.AST, line: int) -> str:
    """A text with … for each value; that of a variable from where the function sets it last before a line."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)  # type: ignore[misc]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return "".join(_words(entry, scope, line) or "…" for entry in (node.left, node.right))
    if isinstance(node, ast.IfExp):
        return _words(node.body, scope, line)
    if isinstance(node, ast.Name):
        texts = [_words(value, scope, at) for name, value, at in _set(scope) if name == node.id and at < line]
        return texts[-1] if texts else "…" if node.id in ("what", "told", "lacks", "wrong") else ""
    called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
    return "…" if called.endswith(("shown", "str", "join")) and "path" not in ast.unparse(node) else ""


def _set(scope: ast.AST) -> Iterator[tuple[str, ast.AST, int]]:
    """Names that are set, to what, and in which line."""
    for node in ast.walk(scope):
        if not isinstance(node, ast.Assign):
            continue
        target, value = node.targets[0], node.value
        several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        for name, entry in zip(target.elts, value.elts, strict=True) if several else [(target, value)]:  # type: ignore[attr-defined]
            yield ast.unparse(name), entry, node.lineno


def _of_factories(tree: ast.Module) -> dict[str, str]:
    """Remedies of a module's errors of one kind."""
    made = {}
    for name, value, at in _set(tree):
        if isinstance(value, ast.Call) and ast.unparse(value.func) == "refusals":
            made[name] = next(
                _words(keyword.value, tree, at) for keyword in value.keywords if keyword.arg == "remedy"
            )
    return made


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace("<", "&lt;").strip()


if __name__ == "__main__":
    main()
