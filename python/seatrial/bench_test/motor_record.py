"""Step record: what was asked of a motor and what it did, each at its own times.

A command is held from its stamp until the next (zero-order hold); the first one counts as held long before.
Revolutions may be sampled at times of their own and may be missing (NaN). Unit: that of the command, counted
from neutral and positive ahead. Held by `tests/bench_test/test_motor_dynamics.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError

__all__ = ["StepRecord"]

_LEAST_SAMPLES = 20


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
        for key, one in arrays.items():
            if one.ndim != 1:
                raise TrialError(
                    f"{self._where}: {key} has shape {one.shape}; expected one number per sample"
                )
            if np.isinf(one).any():
                row = int(np.flatnonzero(np.isinf(one))[0])
                raise TrialError(f"{self._where}: {key} is infinite in row {row}; leave it out or write NaN")
            one.setflags(write=False)
            object.__setattr__(self, key, one)
        for times, values in (("t", "command"), ("t_measured", "measured")):
            self._rising(times, arrays[times])
            if len(arrays[times]) != len(arrays[values]):
                raise TrialError(
                    f"{self._where}: {values} has {len(arrays[values])} samples and {times}"
                    f" {len(arrays[times])}; expected one time per sample"
                )
        if not np.isfinite(arrays["command"]).any():
            raise TrialError(f"{self._where}: no command is a number; check the column of the commands")
        found = int(np.isfinite(arrays["measured"]).sum())
        if found < _LEAST_SAMPLES:
            raise TrialError(
                f"{self._where}: the record is too short: {found} measured revolutions, expected at least"
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
