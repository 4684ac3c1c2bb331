"""`Flight`: one closed-loop flight, what was desired, done and achieved at every control period.

Arrays are SI and rad, a row per control period; figures carry units in their names.

Held by ``tests/test_flight.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names
from seatrial.flight.figures_of_flight import CODED, DIVERGED, ending_of, figures_of
from seatrial.flight.flight_log import log_fields
from seatrial.flight.leg_figures import Leg, legs_of
from seatrial.flight.loop_figures import ActuatorUse, Loop, actuators_of, loops_of
from seatrial.flight.route import Route

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Autopilot, Flights, Vehicle
    from seatrial.flight.circumstances import Circumstances
    from seatrial.mission import Mission

__all__ = ["Alert", "Flight"]

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]
Mask = NDArray[np.bool_]

_ABORT = 3


@dataclass(frozen=True)
class Alert:
    """A reaction of the autopilot's safety: when, what it did, why."""

    t_s: float
    reaction: str
    cause: str


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight of a vehicle with its autopilot on a mission.

    Attributes
    ----------
    vehicle, autopilot, mission, route
        What flew, and the mission's waypoints.
    circumstances
        Current, sensors, faults, outages, seed: what the flight was exposed to.
    period_s, t
        Control period; times (n,), s.
    position, euler, nu
        True motion: NED in m, roll pitch yaw in rad, m/s and rad/s; (n, 3), (n, 3), (n, 6).
    altitude, water
        Above the bottom, (n,), m (infinite without one); velocity through the water, (n, 3), m/s.
    measured
        What the autopilot was told, by channel, (n,).
    desired
        By guidance: speed, lateral, heading, pitch, depth, (n,).
    errors
        cross_track, vertical (as guidance saw them, m), and per loop desired less true, (n,).
    distance, leg, holding, done
        To the active waypoint, m; its index; whether station was kept; whether all was done; (n,).
    mode, modes
        Index of the mode, (n,), and the names.
    alert, cause
        Level of the reaction and number of the watch that called for it, (n,); `alerts` in words.
    commands, actuators
        Asked for, and done by the actuators, {name: (n,)} in the unit of the command.
    demanded, achieved
        Wrench of the loops, and what the allocation reached of it, (n, 6), N and N m.
    power, battery
        Electrical power, W, and share of the charge that is left, (n,).
    ending
        "complete", "surfaced", "aborted", "out of time" or "diverged".
    figures
        Figures of the whole flight, units in the names.
    """

    vehicle: Vehicle
    autopilot: Autopilot
    mission: Mission
    route: Route
    circumstances: Circumstances
    period_s: float
    t: Array
    position: Array
    euler: Array
    nu: Array
    altitude: Array
    water: Array
    measured: Mapping[str, Array]
    desired: Mapping[str, Array]
    errors: Mapping[str, Array]
    distance: Array
    leg: Numbers
    holding: Mask
    done: Mask
    mode: Numbers
    modes: tuple[str, ...]
    alert: Numbers
    cause: Numbers
    commands: Mapping[str, Array]
    actuators: Mapping[str, Array]
    demanded: Array
    achieved: Array
    power: Array
    battery: Array
    ending: str
    figures: Mapping[str, float]

    @classmethod
    def of_case(
        cls,
        flights: Flights,
        flown: tuple[Vehicle, Autopilot, Mission, Route],
        circumstances: Circumstances,
        *,
        case: int = 0,
    ) -> Flight:
        """Flight of a case of a batch that kept its log.

        Parameters
        ----------
        flights : Flights
        flown : tuple
            Vehicle, autopilot, mission and its route.
        circumstances : Circumstances
        case : int, optional
        """
        vehicle, autopilot, mission, route = flown
        figures = figures_of(flights)
        return cls(
            vehicle=vehicle,
            autopilot=autopilot,
            mission=mission,
            route=route,
            circumstances=circumstances,
            period_s=autopilot.period_s,
            t=np.asarray(flights.t(case)),
            ending=ending_of(figures, case),
            figures={name: float(values[case]) for name, values in figures.items() if name not in CODED},
            **log_fields(flights, vehicle, autopilot, case),
        )

    @property
    def diverged(self) -> bool:
        """Whether the motion ended in numbers that are none."""
        return self.ending == DIVERGED

    @property
    def complete(self) -> bool:
        """Whether the mission was flown to its end and every waypoint reached."""
        return self.ending == "complete" and all(leg.reached for leg in self.legs)

    @property
    def verdict(self) -> str:
        """How it ended, in words that do not call a mission complete whose waypoints were missed."""
        missed = self.ending == "complete" and not self.complete
        return "flown to its end, waypoints missed" if missed else self.ending

    @property
    def under_way(self) -> Mask:
        """Rows on the mission: not complete yet and without any reaction, (n,)."""
        return np.asarray((self.alert == 0) & ~self.done & np.isfinite(self.position).all(axis=1))

    @cached_property
    def active(self) -> Mask:
        """Loops at work, (n, 6), in the order surge, sway, heave, roll, pitch, heading."""
        table = np.array([one["loops"] for one in self.autopilot.modes]) > 0.5
        live = (self.alert < _ABORT) & np.isfinite(self.nu).all(axis=1)
        return np.asarray(table[self.mode] & live[:, None])

    @cached_property
    def energy_wh(self) -> Array:
        """Electrical energy used up to each row, (n,), Wh."""
        used = np.cumsum(self.power[:-1]) * self.period_s / 3600.0
        return np.concatenate([[0.0], used])

    @property
    def loiter_radius(self) -> float:
        """Radius of the circle that is flown where station cannot be kept, m; 0 for a vehicle that can."""
        can_stop = self.autopilot.modes[0]["depth_by"] == "heave"
        return 0.0 if can_stop else float(self.autopilot.gains().get("guidance.loiter_radius_m", 0.0))

    @cached_property
    def alerts(self) -> tuple[Alert, ...]:
        """Reactions in the order in which they were called for."""
        names = autopilot_names()
        rows = np.flatnonzero(np.diff(self.alert, prepend=0) > 0)
        return tuple(
            Alert(
                float(self.t[row]), names["reactions"][self.alert[row]], names["watches"][self.cause[row] - 1]
            )
            for row in rows
        )

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """What became of every leg, one per waypoint."""
        return legs_of(self)

    @cached_property
    def loops(self) -> dict[str, Loop]:
        """How the control loops did that were at work, by name."""
        return loops_of(self)

    @cached_property
    def actuator_use(self) -> dict[str, ActuatorUse]:
        """What was asked of every actuator, by name."""
        return actuators_of(self)

    def sentences(self) -> list[str]:
        """What happened, in sentences for a reader of a report."""
        from seatrial.flight.flight_text import sentences

        return sentences(self)

    def to_dict(self) -> dict[str, Any]:
        """Figures, legs, loops, actuators, reactions and circumstances as plain data, without the log."""
        from seatrial.flight.flight_text import plain

        return plain(self)

    def table(self) -> pl.DataFrame:
        """Log with the canonical columns of a trial, and beside them what was measured and desired."""
        from seatrial.flight.flight_table import table

        return table(self)

    def write(
        self, folder: str | Path, *, figures: bool = True, beside: Mapping[str, bytes] | None = None
    ) -> Path:
        """Path of a run directory with the flight: JSON, Parquet, inputs and figures.

        Parameters
        ----------
        folder : str or Path
            Made when it does not exist; an earlier run's is replaced.
        figures : bool, optional
            Whether to draw.
        beside : mapping of str to bytes, optional
            Further files by name.

        Raises
        ------
        SeatrialError
            The directory cannot be written.
        """
        from seatrial.flight.flight_files import write

        return write(self, folder, figures=figures, beside=beside)

    def __str__(self) -> str:
        return "\n".join(self.sentences())
