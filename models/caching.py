"""Caching of functions of an immutable object on it, and what it shows of itself at a prompt."""

from collections import OrderedDict
from collections.abc import Callable
from functools import wraps
from html import escape
from typing import Any, Concatenate, ParamSpec, TypeVar

_Owner = TypeVar("_Owner")
_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")

MOST = 8
"""Maximum number of cached results per object and function; the least recently used is dropped."""


class _Answers(OrderedDict[Any, Any]):
    """Cached results of a function for an object, which are not pickled with it."""

    def __reduce__(self) -> tuple[type["_Answers"], tuple[()]]:
        return _Answers, ()


def cached(
    function: Callable[Concatenate[_Owner, _Given], _Found],
) -> Callable[Concatenate[_Owner, _Given], _Found]:
    """Cache the results of a function on its first argument, a frozen object.

    The other arguments must be hashable and positional.
    """
    name = f"{function.__module__}.{function.__qualname__}"

    @wraps(function)
    def answer(owner: _Owner, *args: _Given.args, **none: _Given.kwargs) -> _Found:
        answers: _Answers = owner.__dict__.setdefault(name, _Answers())
        if args not in answers:
            answers[args] = function(owner, *args, **none)
            if len(answers) > MOST:
                answers.popitem(last=False)
        answers.move_to_end(args)
        return answers[args]

    return answer


class Described:
    """A class whose `_facts` (quantity: value in words) are its printed form, and a table in notebooks."""

    def _facts(self) -> dict[str, object]:
        raise NotImplementedError

    def __repr__(self) -> str:
        facts = ", ".join(f"{name}: {value}" for name, value in self._facts().items())
        return f"{type(self).__name__}({facts})"

    def _repr_html_(self) -> str:
        facts = {escape(name): escape(str(value)) for name, value in self._facts().items()}
        rows = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in facts.items())
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"
