"""Import of Matplotlib without settings from the working folder, like :mod:`toppling.models.numba_alone`."""

import os
import sys

FILE = "matplotlibrc"


def _import() -> None:
    """Import Matplotlib without the working folder's file, which precedes even its environment variable."""
    exists = os.path.exists
    os.path.exists = lambda path: path != FILE and exists(path)
    try:
        import matplotlib.path  # noqa: F401
    finally:
        os.path.exists = exists


if "matplotlib" not in sys.modules and os.path.exists(FILE):  # noqa: PTH110
    _import()
