"""Import of Numba without the settings of a file `.numba_config.yaml` in the working folder.

Numba reads that file whenever it is imported and whenever it compiles, and has no setting that prevents this.
"""

import os
import sys

FILE = ".numba_config.yaml"


def _import() -> None:
    """Import Numba without the working folder's file."""
    exists = os.path.exists
    os.path.exists = lambda path: path != FILE and exists(path)
    try:
        import numba  # noqa: F401
    finally:
        os.path.exists = exists


if "numba" not in sys.modules and os.path.exists(FILE):  # noqa: PTH110
    _import()

import numba  # noqa: E402
import numba.core.caching  # noqa: E402
from numba.core import config  # noqa: E402

config._config_fname = (
    os.devnull
)  # no regular file, so that there is nothing to read when something is compiled
config._env_reloader.reset()  # of who had imported Numba before

__all__ = ["numba"]
