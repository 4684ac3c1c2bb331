"""Motor model: the chain of limits, rate limit, dead time and lag, and its eleven numbers as coordinates.

``command -> static limits -> rate limit -> dead time T_t -> K_V / (T_1 s + 1)`` (Taubert et al. 2014, figures
6-8 and equation 34). The response is exact in continuous time (`seatrial._core.motor_response`), so that
neither dead time nor time constant is bound to the samples.

Coordinates are the parameters themselves, but for the rate limits their reciprocals, in s per unit of the
command: a ramp's length is proportional to them and no limit at all is zero, not infinity.
Held by `tests/bench_test/test_motor_reference.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.bench_test.motor_record import StepRecord

__all__ = ["NAMES", "RECIPROCAL", "SIDES", "MotorModel", "symbol"]

Pair = tuple[float, float]

SIDES = ("ahead", "astern")

NAMES = (
    "K_V",
    "T_1",
    "T_t",
    *(f"{limit}_{side}" for limit in ("n_min", "n_max", "n_acc", "n_dec") for side in SIDES),
)
"""Parameters in the order of all arrays."""

RECIPROCAL = np.array([name.startswith(("n_acc", "n_dec")) for name in NAMES])
"""Which coordinates (11,) are reciprocals of their parameter."""


@dataclass(frozen=True)
class MotorModel:
    """A motor; pairs are (ahead, astern), positive magnitudes in the unit of the command, rates per s."""

    K_V: float = 1.0
    T_1: float = 0.0
    T_t: float = 0.0
    n_min: Pair = (0.0, 0.0)
    n_max: Pair = (math.inf, math.inf)
    n_acc: Pair = (math.inf, math.inf)
    n_dec: Pair = (math.inf, math.inf)
    dead_band: bool = False

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> MotorModel:
        """Motor of the keys of a vehicle file's ``[motors.NAME]``, with that file's defaults.

        Examples
        --------
        >>> MotorModel.from_table({"maximum_ahead": 2000.0, "n_acc_per_s": 1500.0}).n_dec
        (1500.0, 1500.0)
        """
        highest = float(table.get("maximum_ahead", math.inf))
        lowest = float(table.get("minimum_ahead", 0.0))
        growth = float(table.get("n_acc_per_s", table.get("n_dec_per_s", math.inf)))
        shrink = float(table.get("n_dec_per_s", growth))
        return cls(
            K_V=float(table.get("K_V", 1.0)),
            T_1=float(table.get("T_1_s", 0.0)),
            T_t=float(table.get("T_t_s", 0.0)),
            n_min=(lowest, float(table.get("minimum_astern", lowest))),
            n_max=(highest, float(table.get("maximum_astern", highest))),
            n_acc=(growth, growth),
            n_dec=(shrink, shrink),
            dead_band=table.get("below_minimum", "lift") == "zero",
        )

    @classmethod
    def from_coordinates(cls, x: Array, *, dead_band: bool = False) -> MotorModel:
        """Motor of the coordinates (11,)."""
        numbers = [_reciprocal(v) if r else float(v) for v, r in zip(x, RECIPROCAL, strict=True)]
        low, high, growth, shrink = ((numbers[k], numbers[k + 1]) for k in range(3, len(NAMES), 2))
        return cls(numbers[0], numbers[1], numbers[2], low, high, growth, shrink, dead_band)

    def coordinates(self) -> Array:
        """Coordinates (11,)."""
        pairs = (*self.n_min, *self.n_max, *self.n_acc, *self.n_dec)
        numbers = (self.K_V, self.T_1, self.T_t, *pairs)
        return np.array([_reciprocal(v) if r else float(v) for v, r in zip(numbers, RECIPROCAL, strict=True)])

    def parameters(self) -> dict[str, float]:
        """Parameters by name."""
        pairs = (*self.n_min, *self.n_max, *self.n_acc, *self.n_dec)
        return dict(zip(NAMES, (self.K_V, self.T_1, self.T_t, *pairs), strict=True))

    def response(self, record: StepRecord, at: Array) -> Array:
        """Revolutions (k,) at the times (k,) under the commands of a record."""
        from seatrial._core import motor_response

        t, command = record.held
        return np.asarray(
            motor_response(
                t,
                command,
                at,
                K_V=self.K_V,
                T_1=self.T_1,
                T_t=self.T_t,
                maximum=self.n_max,
                minimum=self.n_min,
                dead_band=self.dead_band,
                n_acc=self.n_acc,
                n_dec=self.n_dec,
            )
        )


def symbol(name: str) -> str:
    """Name of a parameter as it stands in a sentence: "n_max ahead"."""
    for side in SIDES:
        if name.endswith(f"_{side}"):
            return f"{name.removesuffix(f'_{side}')} {side}"
    return name


def _reciprocal(value: float) -> float:
    if math.isinf(value):
        return 0.0
    return 1.0 / float(value) if value > 0 else math.inf
