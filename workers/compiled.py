"""How the inner loop is compiled, and where the code that comes of it is kept."""

from __future__ import annotations

from numba import njit

compiled = njit(cache=True, error_model="numpy")
"""For functions that Python calls."""

inner = njit(cache=True, error_model="numpy", no_cpython_wrapper=True)
"""For functions that compiled code calls: to let Python call one takes longer to compile than most of them."""
