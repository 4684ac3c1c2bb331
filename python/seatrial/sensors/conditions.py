"""What sensors need to know of a run besides its motion: the water, the bottom, the supply, the tether."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["Conditions"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Conditions:
    """Circumstances of a run.

    Attributes
    ----------
    vehicle
        That made the run; only a load cell asks for it.
    current
        Velocity of the water over ground, NED, m/s, (3,) or one row per row of the run; None: still water.
    voltage
        Supply in V, one value per row of the run; None: not known.
    bottom_depth_m
        Depth of the bottom below the surface; None: within reach everywhere.
    held
        Whether the vehicle is tied, as in a bollard test.
    """

    vehicle: Vehicle | None = None
    current: Array | None = None
    voltage: Array | None = None
    bottom_depth_m: float | None = None
    held: bool = False

    def water(self, rows: int) -> Array:
        """Velocity of the water, shape (rows, 3), NED, m/s."""
        current = np.zeros(3) if self.current is None else np.asarray(self.current, float)
        return np.asarray(np.broadcast_to(current, (rows, 3)))
