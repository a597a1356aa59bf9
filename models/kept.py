"""What follows from an object alone, worked out once: the object owns it, and takes it along when it goes."""

from collections import OrderedDict
from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

_Owner = TypeVar("_Owner")
_Given = ParamSpec("_Given")
_Found = TypeVar("_Found")

MOST = 8
"""Answers that an object keeps of one function, by the other arguments; the one unused for longest goes."""


class _Answers(OrderedDict[Any, Any]):
    """Answers of a function about one object; they stay behind when the object is sent to another process."""

    def __reduce__(self) -> tuple[type["_Answers"], tuple[()]]:
        return _Answers, ()


def kept(
    function: Callable[Concatenate[_Owner, _Given], _Found],
) -> Callable[Concatenate[_Owner, _Given], _Found]:
    """Keep the answers of a function with its first argument: a frozen object, told from others by its identity.

    The other arguments, which need a hash, come by position.
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
