"""Where an autopilot works: what its tables say, modes and speeds, the loop at each, the age of measurements.

The compiled core owns the autopilot file and its defaults; `autopilot_facts` is the one place above it that
reads the tables. All loops of a mode are closed on the linear motion about its trim, behind lag and dead time
of the actuators and the control period. Held by tests/control_design/test_margin_engine.py,
test_margin_sensors.py and test_margin_constraint.py beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import Mission
from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.control_design.loops import (
    LINEAR_MOTION_SETTINGS,
    STATES,
    Sampled,
    level,
    plant,
    restoring_law,
    sampled,
    trim,
)
from seatrial.control_design.mode_table import top_speeds
from seatrial.control_design.pole_placement import LoopGain, law
from seatrial.flight.sensor_channels import sensors_of
from seatrial.vehicle.actuators import LOOPS, NOMINAL_V, ROWS, delays

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.sensors.sensor import Sensor


@dataclass(frozen=True)
class AutopilotMode:
    """A row of the mode table; ``actuators`` are names and groups of those at work, all where empty."""

    name: str
    loops: tuple[str, ...]
    depth_by: str
    from_speed_m_s: float
    hysteresis_m_s: float
    actuators: tuple[str, ...]


@dataclass(frozen=True)
class AutopilotFacts:
    """An autopilot's tables with the core's defaults.

    ``loops`` are the tables of the loops, with scalars where a gain does not change with the speed;
    ``regulators`` is per mode the gain (points, 6, 15) or (6, 15) of ``control = "lqr"``.
    """

    control: str
    period_s: float
    speeds_m_s: tuple[float, ...]
    modes: tuple[AutopilotMode, ...]
    loops: Mapping[str, Mapping[str, Any]]
    restoring: bool
    guidance: Mapping[str, Any]
    safety: Mapping[str, Any]
    regulators: Mapping[str, Array]

    @property
    def hovers(self) -> bool:
        """Whether a mode keeps the depth without speed."""
        return any(mode.depth_by == "heave" for mode in self.modes)

    def mode(self, name: str) -> AutopilotMode:
        """The mode of a name."""
        return next(mode for mode in self.modes if mode.name == name)

    def at_points(self, loop: str, key: str) -> Array:
        """A gain of a loop at every breakpoint of the schedule; 0 where the file has none."""
        return np.broadcast_to(np.asarray(self.loops[loop].get(key, 0.0), dtype=float), len(self.speeds_m_s))

    def gain(self, loop: str, key: str, speed_m_s: float) -> float:
        """A gain of a loop at a desired speed, linear between the breakpoints as in the core."""
        return float(np.interp(speed_m_s, self.speeds_m_s, self.at_points(loop, key)))

    def shares(self, speed_m_s: float) -> Array:
        """Weight of each breakpoint's gains at a desired speed, linear between them as in the core."""
        return np.array([
            np.interp(speed_m_s, self.speeds_m_s, unit) for unit in np.eye(len(self.speeds_m_s))
        ])


def autopilot_facts(autopilot: Autopilot) -> AutopilotFacts:
    """What the tables of an autopilot say.

    Examples
    --------
    >>> import seatrial as st
    >>> [(mode.name, mode.depth_by) for mode in autopilot_facts(st.Autopilot.load("cwolf")).modes]
    [('hover', 'heave'), ('cruise', 'pitch')]
    """
    regulators = autopilot.to_dict().get("lqr", ())
    return AutopilotFacts(
        control=autopilot.control,
        period_s=autopilot.period_s,
        speeds_m_s=tuple(autopilot.speeds_m_s),
        modes=tuple(
            AutopilotMode(
                name=mode["name"],
                loops=tuple(mode["loop_names"]),
                depth_by=mode["depth_by"],
                from_speed_m_s=mode["from_speed_m_s"],
                hysteresis_m_s=mode["hysteresis_m_s"],
                actuators=tuple(mode["actuators"] or ()),
            )
            for mode in autopilot.modes
        ),
        loops=autopilot.loops(),
        restoring=autopilot.feed_forward()["restoring"],
        guidance=autopilot.guidance(),
        safety=autopilot.safety(),
        regulators={table["mode"]: np.asarray(table["gain"], dtype=float) for table in regulators},
    )


def mode_at(facts: AutopilotFacts, speed_m_s: float) -> AutopilotMode:
    """The mode that works at a desired speed in m/s."""
    reached = [mode for mode in facts.modes[1:] if speed_m_s >= mode.from_speed_m_s]
    return (reached or list(facts.modes[:1]))[-1]


def refuse_other_laws(autopilot: Autopilot) -> None:
    """Refuse an autopilot whose gains are not those of PID loops.

    Raises `CampaignError`: its control is another one.
    """
    control = autopilot_facts(autopilot).control
    if control != "pid":
        raise CampaignError(
            f'{autopilot.name}: expected control = "pid", whose gains can be tuned, found "{control}";'
            " begin with an autopilot of PID loops"
        )


_ANY_MISSION = """
format = 1
name = "fit"
speed_m_s = 1.0
acceptance_radius_m = 1.0
[[legs]]
north_m = 100.0
east_m = 0.0
"""


def refuse_misfit(autopilot: Autopilot, vehicle: Vehicle) -> None:
    """Refuse an autopilot that cannot steer a vehicle.

    Raises `VehicleError`: a loop, an actuator or a limit of the autopilot does not fit.
    """
    autopilot.engage(vehicle, Mission.from_toml(_ANY_MISSION))


_READ = {
    "surge": ("dvl",),
    "sway": ("dvl",),
    "heave": ("depth", "dvl"),
    "roll": ("attitude", "gyro"),
    "pitch": ("attitude", "gyro"),
    "heading": ("attitude", "gyro"),
}
"""Per loop the kinds of sensor that it closes on: of what it holds, and of its rate."""


def measurement_delays(
    sensors: Mapping[str, Sensor] | str | Path | None, vehicle: Vehicle
) -> dict[str, float]:
    """Mean age in s of the measurements of each loop, the older of those that it closes on.

    A sensor tells what was latency_s ago, and holds it until its next sample: 1/rate_hz later, so that the
    hold adds half of that on the average. Sample and hold is taken as this dead time: its phase is the same,
    its fall in magnitude is left out. A loop counts with the older of its measurements, of what it holds and
    of that one's rate. A sensor without rate_hz is as fast as the control period. Source: Åström and
    Wittenmark, *Computer-Controlled Systems* (1997), section 2.

    Nothing is late where sensors are perfect (None), nor where a kind is missing. Raises TrialError where a
    file or a kind is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> found = measurement_delays("typical", st.Vehicle.load("cwolf"))
    >>> {loop: round(late, 3) for loop, late in found.items() if loop in ("surge", "heading")}
    {'surge': 0.22, 'heading': 0.07}
    """
    there = sensors_of(sensors, vehicle) or {}
    return {
        loop: max((_age(there[kind]) for kind in kinds if kind in there), default=0.0)
        for loop, kinds in _READ.items()
    }


def _age(sensor: Sensor) -> float:
    """Mean age of what a sensor shows, s."""
    return sensor.latency_s + (0.0 if sensor.rate_hz is None else 0.5 / sensor.rate_hz)


def reachable_points(
    vehicle: Vehicle, autopilot: Autopilot, *, voltage_v: float = NOMINAL_V
) -> NDArray[np.bool_]:
    """Whether each breakpoint (6,) of the schedule lies between the top speeds astern and ahead.

    Tables of thrust are read at `voltage_v`, V.

    Examples
    --------
    >>> import seatrial as st
    >>> reachable_points(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"))
    array([ True,  True,  True,  True,  True,  True])
    """
    astern, ahead = top_speeds(vehicle, voltage_v=voltage_v)
    speeds = np.asarray(autopilot.speeds_m_s)
    return np.asarray((speeds >= astern) & (speeds <= ahead))


def reachable_speeds(vehicle: Vehicle, autopilot: Autopilot) -> list[float]:
    """Speeds in m/s of the breakpoints that the vehicle reaches."""
    reached = reachable_points(vehicle, autopilot)
    return [u for u, hit in zip(autopilot.speeds_m_s, reached, strict=True) if hit]


def operating_points(facts: AutopilotFacts, speeds_m_s: Sequence[float]) -> list[tuple[str, float]]:
    """Mode and speed in m/s of every mode that can work at a speed, and of both at a switching speed.

    Between a switching speed and its hysteresis below it, either mode may be at work.
    """
    modes, points = facts.modes, []
    switching = [mode.from_speed_m_s for mode in modes[1:]]
    least, most = min(speeds_m_s), max(speeds_m_s)
    every = {float(u) for u in speeds_m_s} | {u for u in switching if least < u < most}
    for speed in sorted(every):
        for k, mode in enumerate(modes):
            begun = k == 0 or speed >= mode.from_speed_m_s - mode.hysteresis_m_s
            if begun and (k + 1 == len(modes) or speed <= modes[k + 1].from_speed_m_s):
                points.append((mode.name, speed))
    return points


@dataclass(frozen=True, eq=False)
class ModeLoop:
    """A mode at a desired speed in m/s, before its gains: the sampled plant and what else acts on it.

    ``known`` is K (6, 15) of the restoring feed-forward, zero where the file has none; ``trimmed`` says
    whether there is straight level motion at that speed.
    """

    mode: str
    speed_m_s: float
    loops: tuple[str, ...]
    system: Sampled
    known: Array
    trimmed: bool


def mode_loop(
    vehicle: Vehicle,
    facts: AutopilotFacts,
    mode: str,
    speed_m_s: float,
    *,
    measured_late_s: Mapping[str, float] | None = None,
    motion: float = LINEAR_MOTION_SETTINGS.small_motion_m_s,
) -> ModeLoop:
    """Sampled motion about the trim of a mode at a speed in m/s.

    ``measured_late_s`` is the age in s of what each loop measures, 0 where missing. The loop is opened at
    its row of the wrench: there dead time of its measurements and of its actuators are the same. Quadratic
    damping counts by its secant over ``motion``, m/s and rad/s.
    """
    of = facts.mode(mode)
    loops = tuple(loop for loop in LOOPS if loop in of.loops)
    rows = "".join(ROWS[LOOPS.index(loop)] for loop in loops)
    actuators = _at_work(vehicle, of.actuators)
    flight = trim(vehicle, speed_m_s, rows, actuators)
    moved = plant(vehicle, flight or level(speed_m_s, rows, actuators), loops, motion=motion)
    late = {ROWS[LOOPS.index(loop)]: (measured_late_s or {}).get(loop, 0.0) for loop in loops}
    behind = {
        row: replace(delay, dead_s=delay.dead_s + late[row]) for row, delay in delays(vehicle, rows).items()
    }
    system = sampled(moved, behind, facts.period_s, loops)
    known = restoring_law(vehicle, rows) if facts.restoring else np.zeros((len(ROWS), len(STATES)))
    return ModeLoop(mode, speed_m_s, loops, system, known, flight is not None)


def mode_law(facts: AutopilotFacts, mode: str, loops: tuple[str, ...], speed_m_s: float) -> Array:
    """The control law of a mode at a desired speed as K (6, 15), without the restoring feed-forward."""
    if facts.control == "lqr":
        given, points = facts.regulators[mode], facts.speeds_m_s
        shape = given.shape[-2:]
        flat = np.broadcast_to(given, (len(points), *shape)).reshape(len(points), -1)
        return np.array([np.interp(speed_m_s, points, column) for column in flat.T]).reshape(shape)

    def gain(loop: str, key: str) -> float:
        return facts.gain(loop, key, speed_m_s)

    gains = {
        loop: LoopGain(gain(loop, "K_P"), gain(loop, "K_I_per_s"), gain(loop, "K_D_s"), np.nan)
        for loop in loops
    }
    return law(gains, speed_m_s)


def _at_work(vehicle: Vehicle, named: Sequence[str]) -> tuple[str, ...] | None:
    """Actuators of a mode, groups resolved; None for all."""
    facts = vehicle.actuator_info()
    names = tuple(name for name in vehicle.actuators if name in named or facts[name]["group"] in named)
    return names or None
