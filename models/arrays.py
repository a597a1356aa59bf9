"""The array that nearly every function takes and returns."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
