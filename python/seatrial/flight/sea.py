"""`SeaState`: the waves that a flight meets. The core makes the water's motion from it (``flight/waves.rs``).

Tests: ``tests/flight/test_waves.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.flight.checks import within

CALM = (0.0, 8.0, 0.0, 0.0, 3.3)
"""The core's row for no waves."""

LIMITS: dict[str, tuple[float, float, str]] = {
    "height_m": (0.0, 20.0, "m"),
    "period_s": (1.0, 30.0, "s"),
    "toward_deg": (-360.0, 360.0, "degrees"),
    "spreading_deg": (0.0, 60.0, "degrees"),
    "peakedness": (1.0, 7.0, "without unit, 1 (Pierson-Moskowitz) to 7"),
}
"""Least, most and unit of every number of a sea state."""


@dataclass(frozen=True)
class SeaState:
    """Waves of a JONSWAP spectrum in deep water, by linear theory.

    A vehicle meets their orbital velocity and acceleration at its place and depth; the phases go by the seed.

    Attributes
    ----------
    height_m
        Significant wave height, m: four standard deviations of the surface.
    period_s
        Peak period, s.
    toward_deg
        Where the waves go, degrees from north over east; as that of a current, not as that of a wind.
    spreading_deg
        Standard deviation of the directions of the components; 0: long-crested.
    peakedness
        The peak enhancement factor; 3.3 for a young sea, 1 for Pierson-Moskowitz's grown one.

    Raises
    ------
    SimulationError
        A number is none, or one that no sea has.

    Examples
    --------
    >>> SeaState(0.5, 6.0, toward_deg=90.0)
    SeaState(height_m=0.5, period_s=6.0, toward_deg=90.0, spreading_deg=0.0, peakedness=3.3)
    """

    height_m: float
    period_s: float
    toward_deg: float = 0.0
    spreading_deg: float = 0.0
    peakedness: float = 3.3

    def __post_init__(self) -> None:
        for name, (least, most, unit) in LIMITS.items():
            within(f"waves: {name}", getattr(self, name), (least, most), unit)
        shortest = float(steepest_period(self.height_m))
        if self.period_s < shortest:
            raise SimulationError(
                f"waves: expected a significant height of at most a {1 / STEEPEST:.0f}th of the length of a"
                f" wave of the peak period, {self.height_m * (self.period_s / shortest) ** 2:.2g} m at"
                f" {self.period_s:g} s, found {self.height_m:g} m; steeper seas break"
            )

    @classmethod
    def of_row(cls, row: ArrayLike) -> SeaState | None:
        """Sea state of a row of the core; None for a calm one."""
        height, period, toward, spreading, peakedness = np.asarray(row, float).tolist()
        turned = math.degrees(toward), math.degrees(spreading)
        return cls(height, period, *turned, peakedness) if height > 0.0 else None

    @property
    def row(self) -> tuple[float, float, float, float, float]:
        """The same in SI and rad, as the core takes it."""
        toward, spreading = math.radians(self.toward_deg), math.radians(self.spreading_deg)
        return self.height_m, self.period_s, toward, spreading, self.peakedness


STEEPEST = 1.0 / 15.0
"""Steepest sea, height over wave length: DNV-RP-C205 (2010), section 3.5.4, at peak periods up to 8 s."""


def steepest_period(height_m: Any) -> Any:
    """Shortest peak period, s, of a sea of this significant height, m, that does not break, in deep water."""
    return np.sqrt(2.0 * math.pi * np.asarray(height_m) / (9.81 * STEEPEST))


def checked_seas(given: Any) -> tuple[tuple[SeaState | None, ...], bool]:
    """Sea states, one for all cases or one each, and whether they differ from case to case.

    Raises SimulationError where one of them is none.
    """
    if given is None or isinstance(given, SeaState):
        return (given,), False
    seas = tuple(given) if isinstance(given, Sequence) and not isinstance(given, str) else ("",)
    for sea in seas:
        if not (sea is None or isinstance(sea, SeaState)):
            raise SimulationError(
                f"waves: expected st.SeaState(height_m, period_s, toward_deg=...), found {given!r}"
            )
    return seas, True


def sea_rows(seas: Sequence[SeaState | None]) -> Array:
    """The sea states (k, 5) as the core takes them."""
    return np.array([CALM if sea is None else sea.row for sea in seas])
