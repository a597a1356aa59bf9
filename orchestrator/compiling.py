"""Compilation of what a shake needs, and its name in progress displays."""

import logging

import numpy as np

from toppling.models.compiled import COMPLETE, FOLDER
from toppling.models.motions.motion import Motion
from toppling.models.scene import Scene
from toppling.workers.shaking import shake

log = logging.getLogger(__name__)

COMPILING = "compiling, once for this machine"
"""Description of the activity for progress displays."""


def is_compiled() -> bool:
    """Whether the compiled code is in the cache of this machine."""
    return FOLDER is not None and (FOLDER / COMPLETE).exists()


def shake_a_block() -> None:
    """Load the compiled code into this process; where it cannot be cached, compile it."""
    shake(Scene.block(0.2, 0.2, 0.6), Motion(np.sin(np.mgrid[0:99, 0:3][0]), 0.01))


def warn_of_no_cache() -> None:
    """Warn that each process compiles, where there is no folder for compiled code."""
    if FOLDER is None:
        log.warning(
            "compiled code cannot be cached: each process compiles first. TOPPLING_CACHE names a folder for the cache"
        )
