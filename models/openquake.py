"""The first line of OpenQuake's CSV files: pairs of key and value, quoted as one cell since engine 3, bare before."""

import re

_PAIR = re.compile(r"\b(\w++)=('[^']*'|\"[^\"]*\"|\[[^\]]*\]|\([^)]*\)|[^,]*)")


def header_values(line: str) -> dict[str, str]:
    r"""Pairs of the first line, their values bare of quotes; lists keep their brackets.

    Examples
    --------
    >>> header_values('#,,"kind=\'mean\', investigation_time=50.0, weights=[0.4, 0.6]"')
    {'kind': 'mean', 'investigation_time': '50.0', 'weights': '[0.4, 0.6]'}
    """
    # The cell is quoted as CSV does it, so that quotes inside it are doubled.
    text = line.lstrip("#,;\t ").strip()
    if text.startswith('"'):
        text = text[1:].removesuffix('"').replace('""', '"')
    return {key: value.strip().strip("'\"") for key, value in _PAIR.findall(text)}


def numbers(text: str) -> list[float]:
    """Numbers of a list as it stands there; none where it is no list of numbers.

    Examples
    --------
    >>> numbers("[5.0, 6.0]")
    [5.0, 6.0]
    """
    try:
        return [float(word) for word in text.strip("[]() ").split(",") if word.strip()]
    except ValueError:
        return []
