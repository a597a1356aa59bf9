"""Matplotlib without the settings of the working folder, like :mod:`toppling.models.numba_alone`."""

import os
import sys

FILE = "matplotlibrc"


def _import() -> None:
    """Import Matplotlib as if there were no such file here: it looks for it first, whatever its variable says."""
    exists = os.path.exists
    os.path.exists = lambda path: path != FILE and exists(path)
    try:
        import matplotlib.path  # noqa: F401
    finally:
        os.path.exists = exists


if "matplotlib" not in sys.modules and os.path.exists(FILE):  # noqa: PTH110
    _import()
