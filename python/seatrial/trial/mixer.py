"""From sticks, radio and servo channels to the commands of actuators.

A stick is a column between its ends, -1 to 1 about its trim. An output is ``neutral + full clip(sum of factor
times stick, -1, 1)``, a command or a component of the wrench. Between its samples a stick is held, as a pilot
holds it. Frames of ArduSub by name: the factors of its motors (ArduPilot, AP_Motors6DOF, at 0fd5fbf2), which
are the commands only where no stabilisation adds to the sticks (mode MANUAL) and no motor is at its limit.
Held by ``tests/trial/test_mixer.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import ACTUATOR_UNITS, unit_factor
from seatrial.base.errors import TrialError, nearest
from seatrial.trial.columns import GROUPS
from seatrial.trial.table import numbers

if TYPE_CHECKING:
    import polars as pl

_STICKS = ("roll", "pitch", "yaw", "throttle", "forward", "lateral")

_YAW_AHEAD = {"1": (0, 0, -1, 0, 1, 0), "2": (0, 0, 1, 0, 1, 0)}
_VECTORED = {
    "1": (0, 0, 1, 0, -1, 1),
    "2": (0, 0, -1, 0, -1, -1),
    "3": (0, 0, -1, 0, 1, 1),
    "4": (0, 0, 1, 0, 1, -1),
}

FRAMES: dict[str, dict[str, tuple[float, ...]]] = {
    "BLUEROV1": {
        **_YAW_AHEAD,
        "3": (-0.5, 0.5, 0, 0.45, 0, 0),
        "4": (0.5, 0.5, 0, 0.45, 0, 0),
        "5": (0, -1, 0, 1, 0, 0),
        "6": (-0.25, 0, 0, 0, 0, 1),
    },
    "VECTORED": {**_VECTORED, "5": (1, 0, 0, -1, 0, 0), "6": (-1, 0, 0, -1, 0, 0)},
    "VECTORED_6DOF": {
        **_VECTORED,
        "5": (1, -1, 0, -1, 0, 0),
        "6": (-1, -1, 0, -1, 0, 0),
        "7": (1, 1, 0, -1, 0, 0),
        "8": (-1, 1, 0, -1, 0, 0),
    },
    "VECTORED_6DOF_90DEG": {
        "1": (1, 1, 0, 1, 0, 0),
        "2": (0, 0, 1, 0, 1, 0),
        "3": (1, -1, 0, 1, 0, 0),
        "4": (0, 0, 0, 0, 0, 1),
        "5": (0, 0, 0, 0, 0, 1),
        "6": (-1, 1, 0, 1, 0, 0),
        "7": (0, 0, -1, 0, 1, 0),
        "8": (-1, -1, 0, 1, 0, 0),
    },
    "SIMPLEROV_3": {**_YAW_AHEAD, "3": (0, 0, 0, -1, 0, 0)},
    "SIMPLEROV_4": {**_YAW_AHEAD, "3": (0, 0, 0, -1, 0, 0), "4": (0, 0, 0, -1, 0, 0)},
    "SIMPLEROV_5": {
        **_YAW_AHEAD,
        "3": (0, 0, 0, -1, 0, 0),
        "4": (0, 0, 0, -1, 0, 0),
        "5": (0, 0, 0, 0, 0, 1),
    },
}
"""Factors of roll, pitch, yaw, throttle, forward and lateral by motor number, of ArduSub's frames in the
order of FRAME_CONFIG.
"""

FRAME_NAMES = tuple(FRAMES)
"""Frames by the number of FRAME_CONFIG; 7 is a custom one, whose factors no parameter tells."""

WRENCH = tuple(column for group in GROUPS if group.name in ("force", "moment") for column in group.columns)
"""Outputs that are components of the wrench: the names of a trial's columns."""

_NEUTRAL_US, _FULL_US = 1500.0, 400.0  # of a frame's motors


@dataclass(frozen=True)
class Stick:
    """A column of the log that becomes -1 to 1."""

    column: str  #: Its name; ``topic.field`` in a log of topics.
    #: Value at rest and at the ends, in the column's own unit.
    trim: float = 1500.0
    min: float = 1100.0
    max: float = 1900.0
    dead_zone: float = 0.0  #: Distance from trim below which it counts as zero, in the column's unit.
    reversed: bool = False  #: Whether a larger value is less.

    def value(self, y: Array) -> Array:
        """Deflection of samples (n,), -1 to 1.

        Examples
        --------
        >>> Stick("RCIN.C4").value(np.array([1100.0, 1500.0, 1700.0, 2000.0])).tolist()
        [-1.0, 0.0, 0.5, 1.0]
        """
        away = y - self.trim
        away = np.sign(away) * np.maximum(np.abs(away) - self.dead_zone, 0.0)
        span = np.where(away > 0.0, self.max - self.trim, self.trim - self.min) - self.dead_zone
        deflection = np.clip(away / span, -1.0, 1.0)
        return np.asarray(-deflection if self.reversed else deflection)


@dataclass(frozen=True)
class Output:
    """What sticks command: ``neutral + full clip(sum of mix times stick, -1, 1)`` in `unit`."""

    mix: Mapping[str, float]
    full: float
    neutral: float = 0.0
    unit: str | None = None


@dataclass(frozen=True)
class Mixer:
    """Sticks, outputs and the constant supply voltage of a log without commands."""

    inputs: Mapping[str, Stick] = field(default_factory=dict)  #: Sticks by name.
    #: By actuator, or by a column of the wrench such as "tau.X_n".
    outputs: Mapping[str, Output] = field(default_factory=dict)
    #: A name in `FRAMES`, the vehicle's actuators in the order of the frame's motor numbers ("thruster_1",
    #: "thruster_2", ... when omitted), and those of them whose direction is reversed. Its inputs are called
    #: roll, pitch, yaw, throttle, forward and lateral; one that is not given is zero.
    frame: str | None = None
    motors: Sequence[str] = ()
    reversed: Sequence[str] = ()
    supply_v: float | None = None  #: Supply voltage where none is recorded, V.

    @property
    def columns(self) -> list[str]:
        """Columns of the log that it reads."""
        return [stick.column for stick in self.inputs.values()]

    def complaint(self) -> str | None:
        """What contradicts itself, with what to do about it; None when nothing does."""
        for name, stick in self.inputs.items():
            rest = min(stick.trim - stick.min, stick.max - stick.trim)
            if not 0.0 <= stick.dead_zone < rest:
                return (
                    f"inputs.{name}: expected min < trim < max and a dead zone inside, found min"
                    f" {stick.min:g}, trim {stick.trim:g}, max {stick.max:g}, dead_zone"
                    f" {stick.dead_zone:g}; set reversed = true for a channel that runs backwards"
                )
        for name, output in self.outputs.items():
            for given in output.mix:
                if given not in self.inputs:
                    return f"outputs.{name}.mix: unknown input {given!r}{nearest(given, self.inputs)}"
        return self._frame_complaint()

    def _frame_complaint(self) -> str | None:
        if self.frame is None:
            given = "motors" if self.motors else "reversed" if self.reversed else ""
            return (
                f"{given}: expected a frame whose motors they are, found none; add frame" if given else None
            )
        if self.frame not in FRAMES:
            return f"frame: unknown frame {self.frame!r}{nearest(self.frame, FRAMES)}"
        count = len(FRAMES[self.frame])
        if len(self.names) != count:
            return (
                f"motors: expected {count} actuators, one per motor of {self.frame}, found {len(self.names)}"
            )
        for name in self.reversed:
            if name not in self.names:
                return f"reversed: unknown motor {name!r}{nearest(name, self.names)}"
        for name in (*self.names, *self.outputs):
            if [*self.names, *self.outputs].count(name) > 1:
                return f"motors: {name!r} is commanded twice; name it once in motors or outputs"
        if not set(self.inputs) & set(_STICKS):
            return f"inputs: {self.frame} needs at least one of {', '.join(_STICKS)}; add a stick"
        return None

    @property
    def names(self) -> list[str]:
        """Actuators of the frame's motors in order."""
        if self.frame is None:
            return []
        return list(self.motors) or [f"thruster_{number}" for number in FRAMES.get(self.frame, {})]

    def all_outputs(self) -> dict[str, Output]:
        """Outputs with those of the frame's motors."""
        outputs: dict[str, Output] = {}
        if self.frame is not None:
            for name, factors in zip(self.names, FRAMES[self.frame].values(), strict=True):
                sign = -1.0 if name in self.reversed else 1.0
                mix = {
                    stick: sign * factor
                    for stick, factor in zip(_STICKS, factors, strict=True)
                    if factor != 0.0 and stick in self.inputs
                }
                outputs[name] = Output(mix, _FULL_US, _NEUTRAL_US, "us")
        return outputs | dict(self.outputs)

    def mixed(
        self, table: pl.DataFrame, file: str, given: Mapping[str, object] | None = None
    ) -> pl.DataFrame:
        """Table of a log with the commands, the wrench and the voltage as canonical columns.

        `table`: with the columns of the sticks. A row without a sample of any of its sticks has none of an
        output. `file`: what to call the log in messages. `given`: column map, which may not give the same
        columns.
        """
        import polars as pl

        if (wrong := self.complaint()) is not None:
            raise TrialError(f"{file}: mixer: {wrong}")
        sticks, sampled = {}, {}
        for name, stick in self.inputs.items():
            where = f"{file}: mixer, inputs.{name}"
            if stick.column not in table.columns:
                raise TrialError(
                    f'{where}: there is no column "{stick.column}" in the recording'
                    f"{nearest(stick.column, table.columns)}"
                )
            y = numbers(table[stick.column], f"inputs.{name}", file)
            sampled[name] = np.isfinite(y)
            if not sampled[name].any():
                raise TrialError(f"{where}: no cell of {stick.column} has a number; choose another column")
            # Held from sample to sample; at rest before the first one.
            last = np.maximum.accumulate(np.where(sampled[name], np.arange(len(y)), -1))
            sticks[name] = stick.value(np.where(last >= 0, y[np.maximum(last, 0)], stick.trim))
        # Outputs in the order of actuators, each in the unit of its command.
        columns: dict[str, Array] = {}
        for name, output in self.all_outputs().items():
            total = np.zeros(table.height)
            for stick_name, factor in output.mix.items():
                total += factor * sticks[stick_name]
            scale = 1.0
            if output.unit is not None:
                scale = unit_factor(output.unit, _units(name), f"{file}: mixer, outputs.{name}")
            rows = np.logical_or.reduce([sampled[s] for s in output.mix] or [np.ones(table.height, bool)])
            values = scale * (output.neutral + output.full * np.clip(total, -1.0, 1.0))
            columns[name if name in WRENCH else f"cmd.{name}"] = np.where(rows, values, np.nan)
        if self.supply_v is not None:
            columns["voltage_v"] = np.full(table.height, self.supply_v)
        # What is given twice would be taken from either.
        for name in columns:
            if name in table.columns or name in (given or {}):
                raise TrialError(
                    f"{file}: mixer: {name} is in the recording or its column map, too; take one of them out"
                )
        return table.with_columns([
            pl.Series(name, values, nan_to_null=True) for name, values in columns.items()
        ])


def _units(output: str) -> tuple[str, ...]:
    if output not in WRENCH:
        return ACTUATOR_UNITS
    return ("N",) if output.endswith("_n") else ("N*m",)
