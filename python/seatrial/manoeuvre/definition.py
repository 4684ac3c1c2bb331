"""What a manoeuvre is: commands over time, and how the vehicle is started."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from seatrial.errors import VehicleError
from seatrial.search import Array
from seatrial.whole_file import write_table

if TYPE_CHECKING:
    import polars as pl

__all__ = ["RATE_HZ", "SETTLE_S", "TURN_BACK_S", "Kind", "Manoeuvre", "Start", "times"]

RATE_HZ = 10.0
"""Samples of commands per second."""

TURN_BACK_S, SETTLE_S = 30.0, 15.0
"""Pauses before a manoeuvre is sailed again: of one that travels, of one that stays in place."""

Kind = Literal["staircase", "coast-down", "zigzag", "spiral", "dive", "free decay", "multisine", "commands"]


@dataclass(frozen=True)
class Start:
    """How a manoeuvre starts: attitude, speed ahead, and that in words for who sails it."""

    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    surge_m_s: float = 0.0
    words: str = "at rest and level"


@dataclass(frozen=True, eq=False)
class Manoeuvre:
    """Open-loop commands over time.

    Attributes
    ----------
    name, kind
        What to call it: "zigzag yaw, half ahead".
    words
        What is done, in a sentence.
    t
        Uniform times in s, shape (n,), from zero on.
    commands
        By actuator (n,), each in its own unit, held from sample to sample.
    start
        State at t = 0.
    pause_s
        Time that it takes to start it again: turning back, tilting the vehicle by hand.
    """

    name: str
    kind: Kind
    words: str
    t: Array
    commands: Mapping[str, Array]
    start: Start = field(default_factory=Start)
    pause_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.t[-1] - self.t[0])

    @property
    def dt(self) -> float:
        """Interval of the samples, s."""
        return self.duration_s / (len(self.t) - 1)

    def repeats(self, budget_s: float) -> int:
        """How often it can be sailed in a time, pauses between included."""
        # A thousandth more than fits: durations are rounded to samples.
        return int((1.001 * budget_s + self.pause_s) // (self.duration_s + self.pause_s))

    def table(self) -> pl.DataFrame:
        """Columns ``t_s, cmd.<actuator> ...``: what `seatrial simulate` and `Trial.read` read."""
        import polars as pl

        return pl.DataFrame(
            {"t_s": np.round(self.t, 6)} | {f"cmd.{name}": np.asarray(y) for name, y in self.commands.items()}
        )

    def write_csv(self, path: str | Path) -> None:
        """Write `table` as comma-separated values.

        Raises
        ------
        TrialError
            The file cannot be written.
        """
        write_table(self.table(), path)


def times(duration_s: float) -> Array:
    """Uniform times (n,) in s from zero to the duration, both included.

    Raises
    ------
    VehicleError
        Less than a second.
    """
    if not (np.isfinite(duration_s) and duration_s >= 1.0):
        raise VehicleError(f"duration: expected at least one second, found {duration_s:g} s")
    return np.arange(round(duration_s * RATE_HZ) + 1) / RATE_HZ
