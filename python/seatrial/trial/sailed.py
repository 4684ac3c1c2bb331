"""Field missions: generated trials that an autopilot sails, through waves and a current that changes.

The table ``[sailed]`` of a recipe names autopilot and mission; the truth vehicle flies it in closed loop
(`seatrial.flight`). What its instruments would have logged of the flight is then drawn as of any generated
trial. The autopilot steers by instruments of the same kinds, whose errors are drawn apart from those of the
log. Held by ``tests/trial/test_sailed.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from seatrial.base.arrays import Array
from seatrial.base.errors import SeatrialError, TrialError
from seatrial.base.toml_file import Name, NotNegative, Number, Positive, Section
from seatrial.flight.fly import fly
from seatrial.flight.mission import Mission
from seatrial.flight.sea import SeaState
from seatrial.sensors.ideal import at_sea
from seatrial.sensors.sensor import TYPICAL, Sensor
from seatrial.trial.truth import Truth

if TYPE_CHECKING:
    from seatrial._core import Autopilot, State
    from seatrial.flight.flight import Flight

__all__ = ["Current", "Sailed", "SailedTable", "WavesTable"]

OWN, PERFECT = "truth", "perfect"
"""Sensors that the autopilot steers by: those of the truth file, or such without error."""

_HOUR_S = 3600.0

_TICK = 1e-6


class SailedTable(Section):
    """What sails the trial: an autopilot on a mission, by file or built-in name, and what it steers by."""

    autopilot: Name
    mission: Name
    sensors: Name = OWN


class WavesTable(Section):
    """The sea that the vehicle meets."""

    height_m: NotNegative
    period_s: Positive
    toward_deg: Number = 0.0
    spreading_deg: NotNegative = 0.0
    peakedness: Positive = 3.3


class Current(Section):
    """Current over ground, NED: where the trial begins; the rest needs an autopilot.

    ``end_…`` is what it has grown to at the end of ``duration_s``, steadily; ``walk_m_s`` the standard
    deviation after an hour of a random walk, ``turbulence_m_s`` that of turbulence, both north and east.
    """

    north_m_s: Number = 0.0
    east_m_s: Number = 0.0
    down_m_s: Number = 0.0
    end_north_m_s: Number | None = None
    end_east_m_s: Number | None = None
    end_down_m_s: Number | None = None
    walk_m_s: NotNegative = 0.0
    turbulence_m_s: NotNegative = 0.0
    turbulence_times_s: Annotated[tuple[Positive, Positive], Field()] = (60.0, 2.0)

    @property
    def at_start(self) -> Array:
        """Velocity at the beginning (3,), m/s."""
        return np.array([self.north_m_s, self.east_m_s, self.down_m_s])

    @property
    def change(self) -> Array:
        """Steady change until the end (3,), m/s."""
        ends = (self.end_north_m_s, self.end_east_m_s, self.end_down_m_s)
        start = self.at_start
        return np.array([0.0 if end is None else end - start[axis] for axis, end in enumerate(ends)])

    @property
    def varies(self) -> bool:
        """Whether it is anything but steady."""
        return bool(self.change.any()) or self.walk_m_s > 0.0 or self.turbulence_m_s > 0.0


@dataclass(frozen=True)
class Sailed:
    """How a trial is sailed.

    Attributes
    ----------
    where
        The recipe, for messages.
    truth
        The vehicle that sails; the autopilot believes in the one that the truth file starts from.
    autopilot, mission
        What steers, and where to.
    sensors
        What it steers by: {kind: sensor}, "typical", a path, or None for perfect ones.
    current, waves
        The water.
    initial
        Where it begins; None: at rest at the mission's start.
    duration_s, rate_hz
        Longest duration and rate of the log.
    bottom_depth_m, voltage_v
        As of any recipe.
    """

    where: str
    truth: Truth
    autopilot: Autopilot
    mission: Mission
    sensors: Mapping[str, Sensor] | str | Path | None
    current: Current
    waves: SeaState | None
    initial: State | None
    duration_s: float
    rate_hz: float
    bottom_depth_m: float | None
    voltage_v: float | None

    @classmethod
    def of(
        cls, table: SailedTable, path: Path, truth: Truth, *, waves: WavesTable | None, **rest: Any
    ) -> Sailed:
        """Sailed trial of a recipe; files are relative to it.

        Raises
        ------
        TrialError
            Autopilot, mission or waves are not usable.
        """
        from seatrial._core import Autopilot

        def beside(name: str) -> str | Path:
            return path.parent / name if name.endswith(".toml") else name

        with _said(f"{path}: sailed, key autopilot"):
            autopilot = Autopilot.load(beside(table.autopilot))
        with _said(f"{path}: sailed, key mission"):
            mission = Mission.load(beside(table.mission))
        with _said(f"{path}: waves"):
            sea = None if waves is None else SeaState(**waves.model_dump())
        sensors: Mapping[str, Sensor] | str | Path | None = at_sea(truth.sensors)
        if table.sensors != OWN:
            sensors = None if table.sensors == PERFECT else beside(table.sensors)
        if isinstance(sensors, str) and sensors != TYPICAL:
            raise TrialError(
                f'{path}: sailed, key sensors: expected "{OWN}", "{PERFECT}", "{TYPICAL}" or a file that ends'
                f" in .toml, found {sensors!r}"
            )
        return cls(str(path), truth, autopilot, mission, sensors, waves=sea, **rest)

    def fly(self, seed: int) -> Flight:
        """Flight of the truth vehicle with this seed of waves, current and sensors' errors.

        Raises
        ------
        TrialError
            The flight cannot be flown, or diverges.
        """
        water = self.current
        with _said(self.where):
            flight = fly(
                self.truth.vehicle,
                self.autopilot,
                self.mission,
                model=self.truth.base,
                sensors=self.sensors,
                current=water.at_start,
                current_trend=water.change * (_HOUR_S / self.duration_s),
                current_walk=water.walk_m_s,
                turbulence=water.turbulence_m_s,
                turbulence_times_s=water.turbulence_times_s,
                waves=self.waves,
                initial=self.initial,
                seabed=self.bottom_depth_m,
                voltage_v=self.voltage_v,
                seed=seed,
                max_time_s=self.duration_s,
            )
        if flight.diverged:
            raise TrialError(
                f"{self.where}: the flight diverges after {flight.t[-1]:.0f} s; check autopilot, sensors,"
                " waves and the truth's coefficients with seatrial fly"
            )
        return flight

    def every(self, flight: Flight) -> int:
        """Control periods per row of the log.

        Raises
        ------
        TrialError
            They do not fit together.
        """
        ratio = 1.0 / (self.rate_hz * flight.period_s)
        if round(ratio) < 1 or abs(ratio - round(ratio)) > _TICK * ratio:
            raise TrialError(
                f"{self.where}: key rate_hz: expected that of the autopilot, {1.0 / flight.period_s:g} Hz, or"
                f" a whole fraction of it, found {self.rate_hz:g}"
            )
        return round(ratio)


@contextmanager
def _said(where: str) -> Iterator[None]:
    """Errors inside, as one of the trial, begun with where it was."""
    try:
        yield
    except SeatrialError as error:
        raise TrialError(f"{where}: {error}") from None
