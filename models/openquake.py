"""First line of OpenQuake's CSV files: key-value pairs, since engine 3 in one quoted cell."""

import re

_PAIR = re.compile(r"\b(\w++)=('[^']*'|\"[^\"]*\"|\[[^\]]*\]|\([^)]*\)|[^,]*)")


def header_values(line: str) -> dict[str, str]:
    r"""Key-value pairs of the first line, without quotes; lists keep their brackets.

    Examples
    --------
    >>> header_values('#,,"kind=\'mean\', investigation_time=50.0, weights=[0.4, 0.6]"')
    {'kind': 'mean', 'investigation_time': '50.0', 'weights': '[0.4, 0.6]'}
    """
    # Quotes inside a quoted CSV cell are doubled.
    text = line.lstrip("#,;\t ").strip()
    if text.startswith('"'):
        text = text[1:].removesuffix('"').replace('""', '"')
    return {key: value.strip().strip("'\"") for key, value in _PAIR.findall(text)}


def numbers(text: str) -> list[float]:
    """Parse a list of numbers; empty if it is invalid.

    Examples
    --------
    >>> numbers("[5.0, 6.0]")
    [5.0, 6.0]
    """
    try:
        return [float(word) for word in text.strip("[]() ").split(",") if word.strip()]
    except ValueError:
        return []
