"""Where an autopilot works: what its tables say, modes and speeds, the loop at each, the age of measurements.

The compiled core owns the autopilot file and its defaults; `autopilot_facts` is the one place above it that
reads the tables. All loops of a mode are closed on the linear motion about its trim, behind lag and dead time
of the actuators and the control period.

Modes that suit a vehicle follow from the rows that its actuators can command. One that commands the heave
force hovers. A frame that also commands the sway force cruises as it hovers, without swaying; any other
pitches under way, with its depth by pitch, by the actuators that drive it and its fins: a vertical thruster
that only helped the pitch moment would keep crossing its minimum revolutions. The breakpoints span 95 % of
the reachable range; those of a vehicle that cannot hover begin where it flies level.

Held by test_margin_engine.py, test_margin_sensors.py, test_margin_constraint.py and
test_control_design_start.py in tests/control_design.
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
from seatrial.base.errors import CampaignError, VehicleError
from seatrial.control_design.loops import (
    LOOP_OF,
    ROW_OF,
    STATES,
    LoopGain,
    Sampled,
    Trim,
    law,
    level,
    plant,
    restoring_law,
    rows_of,
    sampled,
    trim,
)
from seatrial.control_design.loops import SETTINGS as LINEAR_MOTION_SETTINGS
from seatrial.flight.sensor_channels import sensors_of
from seatrial.vehicle.actuators import LOOPS, NOMINAL_V, ROWS, command, delays, reach
from seatrial.vehicle.steady_state import drivers, steady, unbounded

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
    """An autopilot's tables with the core's defaults: ``loops`` with scalars where a gain does not change
    with the speed, ``regulators`` with the gain (points, 6, 15) or (6, 15) of ``control = "lqr"`` per
    mode.
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
    """What the tables of an autopilot say."""
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
    """Refuse, with a `CampaignError`, an autopilot whose gains are not those of PID loops."""
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
    """Refuse, with a `VehicleError`, an autopilot of which a loop, an actuator or a limit does not fit the
    vehicle.
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
    """Mean age in s of the measurements of each loop, the older of what it holds and of its rate; 0 for
    perfect sensors (None) and where a kind is missing.

    A sensor tells what was latency_s ago, and holds it until its next sample, 1/rate_hz later, so that the
    hold adds half of that on the average: sample and hold is taken as this dead time, whose phase is the
    same. Source: Åström and Wittenmark, *Computer-Controlled Systems* (1997), section 2.
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
    """Whether each breakpoint (6,) of the schedule lies between the top speeds astern and ahead."""
    astern, ahead = top_speeds(vehicle, voltage_v=voltage_v)
    speeds = np.asarray(autopilot.speeds_m_s)
    return np.asarray((speeds >= astern) & (speeds <= ahead))


def reachable_speeds(vehicle: Vehicle, autopilot: Autopilot) -> list[float]:
    """Speeds in m/s of the breakpoints that the vehicle reaches."""
    reached = reachable_points(vehicle, autopilot)
    return [u for u, hit in zip(autopilot.speeds_m_s, reached, strict=True) if hit]


def operating_points(facts: AutopilotFacts, speeds_m_s: Sequence[float]) -> list[tuple[str, float]]:
    """Mode and speed in m/s of every mode that can work at a speed, and of both at a switching speed: between
    it and its hysteresis below it, either mode may be at work.
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
    """A mode at a desired speed in m/s, before its gains: the sampled plant, and K (6, 15) of the restoring
    feed-forward (``known``); ``trimmed``: whether there is straight level motion at that speed.
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
    """Sampled motion about the trim of a mode at a speed in m/s, measured so late (s, per loop): opened at
    its row of the wrench, dead time of measurements and of actuators are the same. Quadratic damping
    counts by its secant over ``motion``.
    """
    of = facts.mode(mode)
    loops = tuple(loop for loop in LOOPS if loop in of.loops)
    rows = rows_of(loops)
    actuators = at_work(vehicle, of.actuators)
    flight = trim(vehicle, speed_m_s, rows, actuators)
    moved = plant(vehicle, flight or level(speed_m_s, rows, actuators), loops, motion=motion)
    late = {ROW_OF[loop]: (measured_late_s or {}).get(loop, 0.0) for loop in loops}
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


def at_work(vehicle: Vehicle, named: Sequence[str]) -> tuple[str, ...] | None:
    """Actuators of a mode, groups resolved; None for all."""
    facts = vehicle.actuator_info()
    names = tuple(name for name in vehicle.actuators if name in named or facts[name]["group"] in named)
    return names or None


POINTS = 6
"""Number of breakpoints, that of the core."""


@dataclass(frozen=True)
class ModeTableSettings:
    """Which speeds and modes suit a vehicle."""

    #: Share of the reachable speeds that the breakpoints span: at the very end nothing is left to control
    #: with.
    speed_range_share: float = 0.95
    cruise_from_share: float = 0.3  #: Share of the top speed from which cruise takes over from hover.
    slowest_share: float = 0.25  #: Share of the top speed below which fins do not bite any more.
    level_pitch_rad: float = float(np.deg2rad(10.0))  #: Largest pitch of level flight, rad.
    held_share: float = 0.9  #: Share of the actuators' reach that must hold level flight.
    #: Pitch at which cruise may take over from hover, rad: guidance has to learn it, which moves the depth.
    take_over_pitch_rad: float = float(np.deg2rad(1.5))


SETTINGS = ModeTableSettings()


@dataclass(frozen=True)
class Mode:
    """A row of the mode table."""

    name: str
    loops: tuple[str, ...]
    depth_by: str
    from_speed_m_s: float | None = None
    actuators: tuple[str, ...] | None = None
    """Those at work; all when missing."""


def top_speeds(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> tuple[float, float]:
    """Top speeds astern (not positive) and ahead, m/s, straight at the largest commands; a `VehicleError`
    where they have no bound.
    """
    facts, extremes = vehicle.actuator_info(), []
    for share in (-1.0, 1.0):
        commands = {name: command(facts[name], share * sense) for name, sense in drivers(vehicle).items()}
        extremes.append(
            float(steady(vehicle, commands, free="X", voltage_v=voltage_v).nu[0]) if commands else 0.0
        )
    if not np.isfinite(extremes).all():
        raise VehicleError(unbounded(vehicle))
    return min(extremes[0], 0.0), extremes[1]


def breakpoint_speeds(vehicle: Vehicle, rows: str, top: tuple[float, float]) -> list[float]:
    """Six breakpoints in m/s over 95 % of the reachable range; without hovering, of level flight."""
    slowest = SETTINGS.speed_range_share * top[0] if "Z" in rows else _slowest(vehicle, rows, top[1])
    return [float(u) for u in np.linspace(slowest, SETTINGS.speed_range_share * top[1], POINTS)]


def _slowest(vehicle: Vehicle, rows: str, top: float, pitch: float = SETTINGS.level_pitch_rad) -> float:
    """Least speed of level flight, at a pitch (rad) or less, that the actuators can hold; a quarter of the
    top speed or more.
    """
    commanded = rows.replace("Z", "")
    for share in np.linspace(SETTINGS.slowest_share, 0.8, 23):
        flight = trim(vehicle, share * top, commanded)
        if flight is None or abs(flight.attitude[1]) > pitch:
            continue
        low, high = reach(vehicle, share * top, commanded)["M"] if "M" in commanded else (-np.inf, np.inf)
        if SETTINGS.held_share * low < flight.tau[4] < SETTINGS.held_share * high:
            return float(share * top)
    return 0.8 * top


def mode_table(vehicle: Vehicle, rows: str, top: tuple[float, float]) -> tuple[Mode, ...]:
    """The modes for the commanded rows and the top speeds astern and ahead (m/s)."""
    hovers, cruise_from = "Z" in rows, SETTINGS.cruise_from_share * top[1]
    every = tuple(LOOP_OF[row] for row in rows)
    cruising = tuple(loop for loop in every if loop not in ("heave", "sway"))
    modes = [Mode("hover", every, "heave")] if hovers else []
    if hovers and "Y" in rows:
        # A frame with thrusters all around goes down as it is; it only stops to sway.
        without = tuple(loop for loop in every if loop != "sway")
        modes.append(Mode("cruise", without, "heave", cruise_from))
    elif "M" in rows:
        start = driving = None
        if hovers:
            start = max(_slowest(vehicle, rows, top[1], SETTINGS.take_over_pitch_rad), cruise_from)
            driving = _driving(vehicle, rows_of(cruising))
        modes.append(Mode("cruise", cruising, "pitch", start, driving))
    return tuple(modes)


def _driving(vehicle: Vehicle, rows: str) -> tuple[str, ...] | None:
    """Actuators that drive, and fins, where they are not all and command the rows without the others."""
    facts = vehicle.actuator_info()
    names = [name for name in vehicle.actuators if name in drivers(vehicle) or facts[name]["kind"] == "fin"]
    matrix = np.asarray(vehicle.allocation_matrix())[[ROWS.index(row) for row in rows]]
    matrix = matrix[:, [vehicle.actuators.index(name) for name in names]]
    alone = np.linalg.matrix_rank(matrix, tol=0.1 * float(np.abs(matrix).max())) == len(rows)
    return tuple(names) if alone and len(names) < len(vehicle.actuators) else None


def flies(mode: Mode, modes: tuple[Mode, ...], speed: float) -> bool:
    """Whether a mode works at this desired speed: hover astern and up to where cruise takes over."""
    if len(modes) == 1:
        return True
    start = modes[-1].from_speed_m_s or 0.0
    return speed >= start if mode is modes[-1] else speed < start


def mode_trim(vehicle: Vehicle, speed_m_s: float, mode: Mode) -> Trim:
    """The trim of a mode at a speed in m/s, or level motion where there is none."""
    rows = rows_of(mode.loops)
    return trim(vehicle, speed_m_s, rows, mode.actuators) or level(speed_m_s, rows, mode.actuators)
