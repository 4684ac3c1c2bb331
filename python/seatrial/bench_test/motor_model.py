"""A motor and the record of a step test: the chain of limits and lag, its coordinates, its response.

``command -> static limits -> rate limit -> dead time T_t -> K_V / (T_1 s + 1)`` (Taubert et al. 2014,
equation 34 and figures 4-6 (static behaviour, rate limits, step response)). The response is exact in
continuous time (`seatrial._core.motor_response`), so that neither dead time nor time constant is bound to
the samples. Coordinates are the parameters themselves, but for the rate limits their reciprocals, in s per
unit of the command: a ramp's length is proportional to them and no limit at all is zero, not infinity.

`recommended_steps` is a step test that determines every parameter: a staircase of small commands (n_min),
steps too small for the rate limit to matter (T_1, T_t), large steps to both sides (n_acc, n_dec), beyond the
limits (n_max), and full reversals, each held until the motor has settled.

In a record a command is held from its stamp until the next (zero-order hold); the first one counts as held
long before. Revolutions may be sampled at times of their own and may be missing (NaN). Unit: that of the
command, counted from neutral and positive ahead. Held by ``tests/bench_test/test_motor_reference.py`` and
``tests/bench_test/test_motor_dynamics.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, VehicleError

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

_LEAST_SAMPLES = 20  # twice the parameters of a motor, about


@dataclass(frozen=True, eq=False)
class StepRecord:
    """Commands and measured revolutions of one actuator.

    Parameters
    ----------
    t : array, shape (n,)
        Times of the commands, s, strictly rising.
    command : array, shape (n,)
        Commands, from neutral, positive ahead; NaN repeats the one before.
    measured : array, shape (n,) or (k,)
        Measured revolutions in the unit in which the motor is to be known; NaN is a drop-out.
    name : str
        Name of the actuator. Records of one name belong to one actuator.
    t_measured : array, shape (k,), optional
        Times of the measurements, s, strictly rising, where they are not those of the commands.

    Raises
    ------
    TrialError
        Lengths that differ, times that do not rise, no finite command, an infinite value or fewer than
        20 measurements.

    Examples
    --------
    >>> import numpy as np
    >>> t = 0.1 * np.arange(100)
    >>> record = StepRecord(t, np.where(t < 1.0, 0.0, 500.0), np.where(t < 1.3, 0.0, 500.0), "SbU")
    >>> record.held[1].tolist()
    [0.0, 500.0]
    """

    t: ArrayLike
    command: ArrayLike
    measured: ArrayLike
    name: str = "motor"
    t_measured: ArrayLike | None = None

    def __post_init__(self) -> None:
        own = {"t": self.t, "command": self.command, "measured": self.measured}
        own["t_measured"] = self.t if self.t_measured is None else self.t_measured
        arrays = {key: np.array(value, dtype=float) for key, value in own.items()}
        for key, column in arrays.items():
            if column.ndim != 1:
                raise TrialError(
                    f"{self._where}: {key} has shape {column.shape}; expected one number per sample"
                )
            if np.isinf(column).any():
                row = int(np.flatnonzero(np.isinf(column))[0])
                raise TrialError(f"{self._where}: {key} is infinite in row {row}; leave it out or write NaN")
            column.setflags(write=False)
            object.__setattr__(self, key, column)
        for times, values in (("t", "command"), ("t_measured", "measured")):
            self._rising(times, arrays[times])
            if len(arrays[times]) != len(arrays[values]):
                raise TrialError(
                    f"{self._where}: {values} has {len(arrays[values])} samples and {times}"
                    f" {len(arrays[times])}; expected one time per sample"
                )
        if not np.isfinite(arrays["command"]).any():
            raise TrialError(f"{self._where}: no command is a number; check the column of the commands")
        count = int(np.isfinite(arrays["measured"]).sum())
        if count < _LEAST_SAMPLES:
            raise TrialError(
                f"{self._where}: the record is too short: {count} measured revolutions, expected at least"
                f" {_LEAST_SAMPLES}; log a longer stretch"
            )

    @property
    def _where(self) -> str:
        return f"step record {self.name}"

    def _rising(self, key: str, times: Array) -> None:
        with np.errstate(invalid="ignore"):
            bad = np.flatnonzero(~(np.diff(times) > 0))
        if len(times) == 0 or not np.isfinite(times).all() or len(bad):
            row = int(bad[0]) + 1 if len(bad) else 0
            raise TrialError(
                f"{self._where}: {key} does not rise at row {row}; expected strictly rising times in s; sort"
                " the record or drop its double rows"
            )

    @cached_property
    def held(self) -> tuple[Array, Array]:
        """Times and values (h,) of the commands, without repetitions."""
        t, command = np.asarray(self.t), np.asarray(self.command)
        given = np.isfinite(command)
        t, command = t[given], command[given]
        new = np.concatenate([[True], np.diff(command) != 0])
        return t[new], command[new]

    @cached_property
    def sampled(self) -> tuple[Array, Array]:
        """Times and values (k,) of the measurements that are numbers, from the first command on."""
        t, measured = np.asarray(self.t_measured), np.asarray(self.measured)
        kept = np.isfinite(measured) & (t >= self.held[0][0])
        return t[kept], measured[kept]

    @cached_property
    def sample_s(self) -> float:
        """Median time between measurements, s."""
        return float(np.median(np.diff(np.asarray(self.t_measured))))


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


@dataclass(frozen=True)
class MotorTestSettings:
    """Which steps are recommended for a motor."""

    unknown_lag_s: float = 0.3  #: Where the records do not tell the lag, s.
    rest_s: float = 1.5  #: Length of a plateau, s, or `rest_samples` if that is longer.
    rest_samples: float = 8.0  #: Length of a plateau in samples.
    stagger: float = 0.6180339887  #: Golden section: steps meet the samples at evenly spread phases.


STEP_SETTINGS = MotorTestSettings()


def recommended_steps(
    motor: Mapping[str, Any], *, sample_s: float = 0.1, stagger: bool = True
) -> tuple[Array, Array]:
    """Times (n,) in s and commands (n,) of a step test, each command held until the next time.

    Parameters
    ----------
    motor : mapping
        What is known or guessed of the motor, as in the vehicle file's ``[motors.NAME]``; ``maximum_ahead``
        is needed.
    sample_s : float
        Time between samples of the log, s.
    stagger : bool
        Let the steps fall between the samples at ever other phases. Without it they fall on samples, for a
        logger that can do no other.

    Raises
    ------
    VehicleError
        There is no largest command, or the sample time is not positive.

    Examples
    --------
    >>> t, command = recommended_steps({"maximum_ahead": 2000.0, "minimum_ahead": 150.0})
    >>> print(command.max(), command.min())
    2300.0 -2300.0
    """
    known = MotorModel.from_table(motor)
    if not all(math.isfinite(limit) and limit > 0 for limit in known.n_max):
        raise VehicleError(
            "a step test needs the largest command; found no maximum_ahead in the motor's table; give"
            " maximum_ahead (and maximum_astern where it differs) in the unit of the command"
        )
    if not sample_s > 0:
        raise VehicleError(f"a step test needs a sample time above zero, found sample_s = {sample_s:g} s")
    sides = [_sequence(known, side) for side in (0, 1)]
    ahead, astern = (known.n_max[side] for side in (0, 1))
    # Full reversals take the longest way: they show the rate limits of both directions.
    reversals = [0.9 * ahead, -0.9 * astern, 0.9 * ahead, -0.9 * astern, 0.0]
    commands = np.array([0.0, *sides[0], *sides[1], *reversals])
    rest = max(STEP_SETTINGS.rest_s, STEP_SETTINGS.rest_samples * sample_s)
    holds = [_hold(known, commands[max(k - 1, 0)], commands[k]) + rest for k in range(len(commands))]
    t = np.concatenate([[0.0], np.cumsum(holds)[:-1]])
    # Commands change at samples; the stagger moves them within, which tells the dead time to a part of one.
    t = np.ceil(t / sample_s) * sample_s
    if stagger:
        t[1:] += sample_s * ((STEP_SETTINGS.stagger * np.arange(1, len(t))) % 1.0)
    return np.append(t, t[-1] + holds[-1]), np.append(commands, 0.0)


def _sequence(known: MotorModel, side: int) -> list[float]:
    """Commands of one direction, beginning and ending at the smallest command."""
    sign = 1.0 - 2.0 * side
    top = known.n_max[side]
    low = known.n_min[side] or 0.1 * top
    # A change that the rate limit passes in a third of the time constant shows the lag alone.
    rate = min(known.n_acc[side], known.n_dec[side], 10.0 * top)
    small = min(max(rate * (known.T_1 or STEP_SETTINGS.unknown_lag_s) / 3.0, 0.04 * top), 0.15 * top)
    middle = max(0.5 * top, 2.0 * low)
    staircase = [0.3 * low, 0.0, 0.6 * low, 0.9 * low, 1.3 * low, 2.0 * low, 0.0]
    fine = [middle, middle + small, middle, middle - small, middle, middle + small]
    large = [0.0, 0.9 * top, 1.15 * top, 0.7 * top, 0.0, 0.8 * top, 0.25 * top, 1.15 * top, 0.0]
    return [sign * command for command in (*staircase, *fine, *large)]


def _hold(known: MotorModel, before: float, after: float) -> float:
    """Time in s until the motor has settled."""
    sides = (0, 1)
    slowest = min(min(known.n_acc[side], known.n_dec[side]) for side in sides)
    ramp = abs(after - before) / slowest if math.isfinite(slowest) else 0.0
    return known.T_t + ramp + 5.0 * (known.T_1 or STEP_SETTINGS.unknown_lag_s)
