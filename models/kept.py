"""Caching of functions of an immutable object: the results are stored on the object, and freed with it."""

from collections import OrderedDict
from collections.abc import Callable
from functools import wraps
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


def kept(
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
