"""Import of libraries without their settings from the working folder, which precede even environment variables."""

import importlib
import os
import sys


def import_alone(library: str, file: str) -> None:
    """Import a library, unless it is imported, while its file of settings in the working folder seems not to exist."""
    if library.partition(".")[0] in sys.modules or not os.path.exists(file):  # noqa: PTH110
        return
    exists = os.path.exists
    os.path.exists = lambda path: path != file and exists(path)
    try:
        importlib.import_module(library)
    finally:
        os.path.exists = exists
