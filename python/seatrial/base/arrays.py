"""What a bounded search keeps: candidates and costs, the best distinct ones, history and elapsed time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array"]

Array = NDArray[np.float64]

Mask = NDArray[np.bool_]
