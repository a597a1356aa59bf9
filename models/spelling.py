"""Words as they are written: what a misspelt one was probably meant to be, and the plural."""

from collections.abc import Iterable
from difflib import get_close_matches

_LONGEST = 60
"""Letters of a word that a person may have misspelt; comparing costs their square."""


def counted(number: int, noun: str) -> str:
    """A number of things in words.

    Examples
    --------
    >>> counted(1, "record"), counted(12000, "record")
    ('1 record', '12,000 records')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word that is most like another one, in any case; None where none is like it.

    Examples
    --------
    >>> nearest("standart", ["fast", "standard", "reference"])
    'standard'
    >>> nearest("pga", ["scene", "pga_m_s2"])
    'pga_m_s2'
    """
    if len(word) > _LONGEST:
        return None
    by_lower = {name.lower(): name for name in known}
    asked = word.lower()
    for name in by_lower:
        if asked and (name.startswith(asked) or asked.startswith(name)):
            return by_lower[name]
    found = get_close_matches(asked, by_lower, n=1, cutoff=0.6)
    return by_lower[found[0]] if found else None


def did_you_mean(word: object, known: Iterable[str], otherwise: str) -> str:
    """Say what a word was probably meant to be, or something else where nothing is like it.

    Examples
    --------
    >>> did_you_mean("fsat", ["fast", "standard"], "take 'standard' if unsure")
    "did you mean 'fast'?"
    """
    found = nearest(word, known) if isinstance(word, str) else None
    return f"did you mean {found!r}?" if found else otherwise
