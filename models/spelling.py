"""Suggestions for misspelt words, and plurals."""

from collections.abc import Iterable
from difflib import get_close_matches

_LONGEST = 60
"""Maximum number of letters of a word that is compared, at quadratic cost."""


def counted(number: int, noun: str) -> str:
    """Format a number with a noun in singular or plural.

    Examples
    --------
    >>> counted(1, "record"), counted(12000, "record")
    ('1 record', '12,000 records')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Known word most similar to a word, ignoring case; None if none is similar.

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
    """Suggest a correction of a misspelt word, or return `otherwise` if no known word is similar.

    Examples
    --------
    >>> did_you_mean("fsat", ["fast", "standard"], "take 'standard' if unsure")
    "did you mean 'fast'?"
    """
    found = nearest(word, known) if isinstance(word, str) else None
    return f"did you mean {found!r}?" if found else otherwise
