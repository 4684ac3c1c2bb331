"""Courses that ArduSub's cascade is to follow, flown by a log or made, and flights along them.

A course of a log is a stretch in one mode. Its targets are the logged ones; how fast a target moves, which a
log does not carry for the angles, is what is left of the rate wanted when the angle controller is taken away
(`ardusub_rates`), and the same for depth and place. Where the mode has no control of depth or place, throttle
and sticks stand in. Flights run many cases at once in the core. Held by ``tests/ardusub/test_reflight.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial._core import (
    ardusub_defaults,
    ardusub_fly,
    ardusub_forward_lateral,
    ardusub_frames,
    ardusub_rates,
)
from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, nearest
from seatrial.base.frames import from_euler, matrix
from seatrial.logs.log import Log

if TYPE_CHECKING:
    from seatrial._core import Vehicle

CHANNELS: Mapping[str, tuple[str, str]] = {
    "roll": ("deg", "attitude"),
    "pitch": ("deg", "attitude"),
    "yaw": ("deg", "attitude"),
    "depth": ("m", "depth"),
    "north": ("m", "place"),
    "east": ("m", "place"),
}
"""Loop errors that are compared: unit, and what must be controlled."""


@dataclass(frozen=True)
class FlownSettings:
    """Which stretches of a log are flown again, and what the controllers see."""

    row_s: float = 0.1  #: Time between two rows that are kept of a course, s: that of a log at 10 Hz.
    shortest_s: float = 10.0  #: Shortest stretch of a log that is flown again, s.
    near_s: float = 0.3  #: Longest time between a row and the time for which it stands, s.
    #: Standard deviation of gyro (rad/s) and velocity (m/s) that the controllers see.
    noise: tuple[float, float] = (0.002, 0.005)


SETTINGS = FlownSettings()

_WANTED = 20  # columns of the core's targets


@dataclass(frozen=True, eq=False)
class Course:
    """What a vehicle is to follow."""

    name: str  #: For tables: the mode of the log, or what a made course does.
    t: Array  #: Times (n,) of the rows that are kept, s.
    #: (N, 20), a row per control period; the columns are those of `seatrial._core.ardusub_fly`.
    targets: Array
    period_s: float  #: Control period, s.
    #: `position`, `attitude`, `nu`: state at the beginning: (3,), (3,) rad, (6,).
    position: Array
    attitude: Array
    nu: Array
    integrals: Array  #: Integral parts with which the controllers begin, (7,).
    #: Loop errors by channel that the log has at the rows, (n,) each: target minus measurement.
    measured: Mapping[str, Array] = field(default_factory=dict)
    #: Demands (n, 6) of roll, pitch, yaw, throttle (-1 to 1), forward and lateral that the log has at the
    #: rows; not a number where it has none.
    demands: Array = field(default_factory=lambda: np.full((0, 6), np.nan))

    @property
    def every(self) -> int:
        """Control periods between two rows that are kept."""
        return max(round(SETTINGS.row_s / self.period_s), 1)

    @property
    def channels(self) -> tuple[str, ...]:
        """Loop errors that exist: those whose controllers work all the time."""
        on = {
            "attitude": True,
            "depth": bool(self.targets[:, 16].all()),
            "place": bool(self.targets[:, 17].all()),
        }
        return tuple(name for name, (_, needs) in CHANNELS.items() if on[needs])

    def errors(self, flown: Array) -> dict[str, Array]:
        """Loop errors by channel, (k, n) each, of flights (k, n, 20)."""
        wanted = self.targets[:: self.every]
        angles = wanted[:, :3] - flown[..., 3:6]
        angles = np.degrees((angles + np.pi) % (2.0 * np.pi) - np.pi)
        places = wanted[:, 4:7] - flown[..., :3]
        every = {
            "roll": angles[..., 0], "pitch": angles[..., 1], "yaw": angles[..., 2],
            "depth": places[..., 2], "north": places[..., 0], "east": places[..., 1],
        }  # fmt: skip
        return {name: every[name] for name in self.channels}

    def between(self, first: float, last: float) -> Any:
        """Which rows lie between two times, s: (n,) bool."""
        return (self.t >= first) & (self.t < last)


def still_targets(n: int, *, depth: float = 5.0, place: bool = True, voltage: float = 16.0) -> Array:
    """Targets (n, 20) that rest level at a depth, north and east of zero.

    The attitude is asked for, as by a pilot or a mission: its target moves there.
    """
    targets = np.zeros((n, _WANTED))
    targets[:, 6], targets[:, 13], targets[:, 16], targets[:, 17] = depth, 0.5, 1.0, float(place)
    targets[:, 18], targets[:, 19] = voltage, 1.0
    return targets


@dataclass
class _Rows:
    """Rows of a topic over time."""

    t: Array
    values: Mapping[str, Array]

    def at(self, name: str, t: Array) -> Array:
        """A field at some times, linear between its rows."""
        return np.interp(t, self.t, self.values[name])

    def near(self, t: Array) -> Any:
        """Where a row stands near enough."""
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        gap = np.minimum(np.abs(self.t[after] - t), np.abs(t - self.t[after - 1]))
        return gap <= SETTINGS.near_s


def rows_of(log: Log, topic: str, *names: str) -> _Rows | None:
    """Rows of a topic that are numbers in all these fields; None where there are too few."""
    known = next((candidate for candidate in (topic, f"{topic}[0]") if candidate in log.fields), None)
    if known is None or any(name not in log.fields[known] for name in names):
        return None
    read = log.read({known: names})[known]
    sound = np.all([np.isfinite(read.fields[name]) for name in names], axis=0)
    t, first = np.unique(read.t[sound], return_index=True)
    if len(t) < 2:
        return None
    return _Rows(t, {name: np.asarray(read.fields[name][sound][first], float) for name in names})


def logged_courses(
    log: Log, parameters: Mapping[str, float], *, channels: Sequence[int] = (4, 5)
) -> tuple[Course, ...]:
    """Courses of a log, one for each stretch of ten seconds or more in one mode.

    `log`: with ANG, RATE, PIDR, PIDP, PIDY; PSCD, PIDA and CTUN where depth was controlled, PSCN and PSCE
    where place was; `parameters`: those that the vehicle flew with, by ArduSub's names, as found from the
    log; `channels`: index of the sticks for forward and lateral among those of RCIN. Raises `TrialError`: a
    topic is missing, or no stretch is long enough.
    """
    needed = {
        "ANG": ("DesRoll", "Roll", "DesPitch", "Pitch", "DesYaw", "Yaw"),
        "RATE": ("R", "P", "Y", "YDes", "ROut", "POut", "YOut", "AOut"),
        "XKF1": ("VN", "VE", "VD"),
        "CTUN": ("ThI",),
    }
    read = {name: rows_of(log, name, *fields) for name, fields in needed.items()}
    if missing := [name for name, rows in read.items() if rows is None]:
        raise TrialError(
            f"{log.path}: expected {', '.join(needed)} to fly the log's mission again, found no"
            f" {', '.join(missing)}; let LOG_BITMASK include attitude, PID and the estimator, and log again"
        )
    rows = {name: present for name, present in read.items() if present is not None}
    step = rows_of(log, "ANG", "Dt")
    period = 0.005 if step is None else float(np.median(step.values["Dt"]))
    # The controllers run a whole number of times in a row of the course.
    period = SETTINGS.row_s / max(round(SETTINGS.row_s / min(max(period, 0.001), 0.02)), 1)
    begins = [(event.t, event.text) for event in log.events() if event.kind == "mode"]
    last = float(rows["ANG"].t[-1])
    ends = [t for t, _ in begins[1:]] + [last] * bool(begins)
    # The first rows after a change hold targets of the mode before.
    modes = [
        (t + 2.0 * SETTINGS.row_s, end, name)
        for (t, name), end in zip(begins, ends, strict=True)
        if end - t >= SETTINGS.shortest_s
    ]
    if not modes:
        modes = [(float(rows["ANG"].t[0]) + SETTINGS.row_s, last, "log")]
    made = [_course(log, rows, parameters, period, mode, channels) for mode in modes]
    whole = tuple(course for course in made if course is not None)
    if not whole:
        raise TrialError(
            f"{log.path}: expected a stretch of {SETTINGS.shortest_s:g} s in one mode, found none"
        )
    return whole


def _course(
    log: Log,
    rows: Mapping[str, _Rows],
    parameters: Mapping[str, float],
    period: float,
    mode: tuple[float, float, str],
    channels: Sequence[int],
) -> Course | None:
    begin, end, name = mode
    n = int((end - begin) / SETTINGS.row_s)
    if n * SETTINGS.row_s < SETTINGS.shortest_s - 1.0:
        return None
    every = round(SETTINGS.row_s / period)
    t: Array = np.asarray(begin + period * np.arange(n * every), float)
    kept = t[::every]
    ang, rate, depth, place = rows["ANG"], rows["RATE"], _vertical(log), _plane(log)
    wanted = np.radians([_angle(ang, f"Des{axis}", t) for axis in ("Roll", "Pitch", "Yaw")]).T
    targets = np.zeros((len(t), _WANTED))
    targets[:, :3] = wanted
    targets[:, 3] = _turning(ang, rate, parameters, t)
    targets[:, 13] = rows["CTUN"].at("ThI", t)
    sticks = rows_of(log, "RCIN", *(f"C{k + 1}" for k in channels))
    if sticks is not None:
        for column, k in zip((14, 15), channels, strict=True):
            # Pulses of 1100 to 1900 us about 1500 us are -1 to 1.
            targets[:, column] = sticks.at(f"C{k + 1}", t) / 400.0 - 3.75
    battery = rows_of(log, "BAT", "Volt")
    targets[:, 18] = 16.0 if battery is None else battery.at("Volt", t)
    measured = {
        # The shorter way round.
        axis.lower(): (_angle(ang, f"Des{axis}", kept) - _angle(ang, axis, kept) + 180.0) % 360.0 - 180.0
        for axis in ("Roll", "Pitch", "Yaw")
    }
    position, integrals = np.zeros(3), np.zeros(7)
    demands = np.stack(
        [rate.at(name, kept) for name in ("ROut", "POut", "YOut", "AOut")] + [np.full(n, np.nan)] * 2, 1
    )
    # ArduPilot's throttle runs from 0 to 1, with rest in the middle.
    demands[:, 3] = 2.0 * demands[:, 3] - 1.0
    demands[:, 4:] = targets[::every, 14:16]
    for k, letter in enumerate("RPY"):
        pid = rows_of(log, f"PID{letter}", "I")
        integrals[k] = 0.0 if pid is None else float(pid.at("I", t[:1])[0])
    if depth is not None and depth.near(kept).all():
        targets[:, 16] = 1.0
        p = parameters.get("PSC_D_POS_P", 0.0)
        targets[:, 6] = depth.at("TPD", t)
        # The log has the sum that the rate controller aims at: what the position asks for is taken off again.
        targets[:, 9] = depth.at("TVD", t) - p * (depth.at("TPD", t) - depth.at("PD", t))
        targets[:, 12] = depth.at("DAD", t) + depth.at("AOT", t)
        position[2] = depth.at("PD", t[:1])[0]
        measured["depth"] = depth.at("TPD", kept) - depth.at("PD", kept)
        pid = rows_of(log, "PIDA", "I")
        integrals[4] = 0.0 if pid is None else float(pid.at("I", t[:1])[0])
    if place is not None and place.near(kept).all():
        targets[:, 17] = 1.0
        p, velocity_p = (parameters.get(key, 0.0) for key in ("PSC_NE_POS_P", "PSC_NE_VEL_P"))
        for axis, (letter, channel) in enumerate((("N", "north"), ("E", "east"))):
            wants = {what: place.at(f"{what}{letter}", t) for what in ("TP", "P", "TV", "V", "DA", "TA")}
            targets[:, 4 + axis] = wants["TP"]
            targets[:, 7 + axis] = wants["TV"] - p * (wants["TP"] - wants["P"])
            targets[:, 10 + axis] = wants["DA"]
            position[axis] = wants["P"][0]
            # What is left of the acceleration at the beginning is the integral that the flight starts with.
            left = (wants["TA"] - wants["DA"] - velocity_p * (wants["TV"] - wants["V"]))[: 3 * every]
            integrals[5 + axis] = float(np.mean(left))
            measured[channel] = (wants["TP"] - wants["P"])[::every]
        lean = np.radians(parameters.get("ATC_ANGLE_MAX", 45.0))
        heading = np.radians(_angle(ang, "Yaw", kept))
        wanted_acceleration = np.stack([place.at("TAN", kept), place.at("TAE", kept)], 1)
        demands[:, 4:] = ardusub_forward_lateral(wanted_acceleration, heading, float(lean))
    attitude = np.radians([_angle(ang, axis, t[:1])[0] for axis in ("Roll", "Pitch", "Yaw")])
    ground = np.array([rows["XKF1"].at(f"V{letter}", t[:1])[0] for letter in "NED"])
    nu = np.zeros(6)
    nu[:3] = matrix(from_euler(attitude)).T @ ground
    nu[3:] = np.radians([rate.at(letter, t[:1])[0] for letter in "RPY"])
    return Course(name, kept, targets, period, position, attitude, nu, integrals, measured, demands)


def _angle(rows: _Rows, name: str, t: Array) -> Array:
    """An angle at some times, deg, not wrapped."""
    return np.interp(t, rows.t, np.unwrap(rows.values[name], period=360.0))


def _turning(ang: _Rows, rate: _Rows, parameters: Mapping[str, float], t: Array) -> Array:
    """Rate of the yaw wanted, rad/s: what the angle controller does not explain of the rate wanted."""
    names = ("Roll", "Pitch", "Yaw")
    to = np.radians([_angle(ang, f"Des{axis}", ang.t) for axis in names]).T
    at = np.radians([_angle(ang, axis, ang.t) for axis in names]).T
    gyro = np.radians([rate.at(letter, ang.t) for letter in "RPY"]).T
    p = [parameters.get(f"ATC_ANG_{axis}_P", 6.0) for axis in ("RLL", "PIT", "YAW")]
    most = np.radians([parameters.get(f"ATC_ACC_{axis}_MAX", 1100.0) for axis in "RPY"])
    rate_p = parameters.get("ATC_RAT_YAW_P", 0.0)
    own = np.asarray(ardusub_rates(to, at, np.zeros_like(to), gyro, p, most, 0.0025, yaw_rate_p=rate_p))
    left = np.radians(rate.at("YDes", ang.t)) - own[:, 2]
    # Rows of angle and rate are a period apart: where the target jumps the difference is no rate.
    moved = np.abs(np.gradient(to[:, 2], ang.t))
    left = np.where(np.abs(left) > 2.0 * moved + np.radians(1.0), 0.0, left)
    return np.interp(t, ang.t, left)


def _vertical(log: Log) -> _Rows | None:
    rows = rows_of(log, "PSCD", "TPD", "PD", "TVD", "DAD")
    if rows is None:
        return None
    terrain = rows_of(log, "PSOT", "AOT")
    pushed = np.zeros(len(rows.t))
    if terrain is not None:
        pushed = np.where(terrain.near(rows.t), terrain.at("AOT", rows.t), 0.0)
    return _Rows(rows.t, {**rows.values, "AOT": pushed})


def _plane(log: Log) -> _Rows | None:
    both = [
        rows_of(log, f"PSC{letter}", *(f"{what}{letter}" for what in ("TP", "P", "TV", "V", "DA", "TA")))
        for letter in "NE"
    ]
    north, east = both
    if north is None or east is None:
        return None
    return _Rows(north.t, {**north.values, **{name: east.at(name, north.t) for name in east.values}})


@dataclass(frozen=True, eq=False)
class Rig:
    """What a vehicle's set-up gives: frame, directions of the motors, where the tether pulls."""

    frame: str  #: Name of the frame, as ``FRAME_CONFIG`` has it.
    direction: tuple[int, ...]  #: ``MOT_n_DIRECTION`` of every motor.
    tether_at: tuple[float, float, float] = (-0.2, 0.0, -0.1)  #: (3,), body frame, m.
    #: Standard deviation of gyro (rad/s) and velocity (m/s).
    noise: tuple[float, float] = SETTINGS.noise
    wander_s: float = 1.0  #: Time constant of the wrench that the model does not know, s.
    steady: tuple[float, ...] = (0.0,) * 6  #: Steady wrench (6,) that the model does not know, N and N m.
    #: ``MOT_FV_CPLNG_K``, which counts for the frame Vectored; ArduSub's default where it is None.
    coupling: float | None = None


@dataclass(frozen=True, eq=False)
class Cases:
    """What differs between k flights; an array of one row counts for all."""

    seeds: NDArray[np.int_]  #: (k,) whole numbers.
    coefficients: Mapping[str, Array]  #: Of the vehicle, (k,) by name.
    current: Array  #: (k, 3), NED, m/s.
    wander: Array  #: (k, 6) standard deviation of the wrench that the model does not know, N and N m.
    tether: Array  #: (k, 3), NED, N.
    #: (k, 3): thrust over that of the voltage at the beginning, its fall per s, its fall at full load.
    supply: Array

    @classmethod
    def of(
        cls,
        k: int,
        *,
        seed: int = 0,
        coefficients: Mapping[str, Array] | None = None,
        current: ArrayLike = (0.0, 0.0, 0.0),
        wander: ArrayLike = (0.0,) * 6,
        tether: ArrayLike = (0.0, 0.0, 0.0),
        supply: ArrayLike = (1.0, 0.0, 0.0),
    ) -> Cases:
        """Cases with numbers from a seed on; what is one row counts for all."""

        def rows(values: ArrayLike) -> Array:
            own = np.asarray(values, float)
            return np.asarray(np.broadcast_to(own, (k, own.shape[-1])))

        return cls(
            np.arange(seed, seed + k), dict(coefficients or {}), rows(current), rows(wander), rows(tether),
            rows(supply),
        )  # fmt: skip

    def __len__(self) -> int:
        """Number of cases."""
        return len(self.seeds)

    def take(self, which: ArrayLike) -> Cases:
        """Some of them."""
        own = np.asarray(which)
        return replace(
            self, seeds=self.seeds[own], current=self.current[own], wander=self.wander[own],
            tether=self.tether[own], supply=self.supply[own],
            coefficients={name: values[own] for name, values in self.coefficients.items()},
        )  # fmt: skip


def known_parameters(values: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
    """Those of some parameters that the cascade has."""
    own = ardusub_defaults()
    return {name: value for name, value in values.items() if name in own}


def fly_course(
    vehicle: Vehicle,
    rig: Rig,
    course: Course,
    parameters: Mapping[str, ArrayLike],
    *,
    cases: Cases,
    threads: int | None = None,
) -> Array:
    """Rows (k, n, 20) of flights along a course, see `seatrial._core.ardusub_fly`.

    `parameters`: by ArduSub's names and units (4.7 and later): a number, or (k,); the default where one is
    missing. Raises `TrialError`: a parameter is none of the cascade's. Raises `SimulationError`: the frame
    does not fit the vehicle, or a number is not finite.
    """
    known = ardusub_defaults()
    for name in parameters:
        if name not in known:
            raise TrialError(f"{name}: expected a parameter of ArduSub's controllers{nearest(name, known)}")
    # The steady wrench is a bias of the vehicle, on top of one that it has.
    steady = dict(zip(("X_0", "Y_0", "Z_0", "K_0", "M_0", "N_0"), rig.steady, strict=True))
    own = vehicle.coefficients()
    bias = {
        name: np.broadcast_to(cases.coefficients.get(name, own.get(name, 0.0)) + value, len(cases))
        for name, value in steady.items()
        if value
    }
    return np.asarray(
        ardusub_fly(
            vehicle, rig.frame, np.asarray(rig.direction, float), course.targets,
            seeds=[int(seed) for seed in cases.seeds], period_s=course.period_s, every=course.every,
            parameters=dict(parameters), coefficients={**cases.coefficients, **bias},
            position=course.position, attitude=course.attitude, nu=course.nu, integrals=course.integrals,
            current=cases.current, wander=cases.wander, wander_s=rig.wander_s, tether=cases.tether,
            tether_at=np.asarray(rig.tether_at), supply=cases.supply, noise=np.asarray(rig.noise),
            coupling=rig.coupling, threads=threads,
        )
    )  # fmt: skip


def check_rig(vehicle: Vehicle, rig: Rig) -> None:
    """Refuse a vehicle whose thrusters push against what frame and directions of the motors tell them.

    Raises `TrialError`: a thruster pushes the wrong way, or their number is not the frame's.
    """
    if wrong := against(vehicle, rig):
        raise TrialError(
            f"{vehicle.name}: {', '.join(wrong)} push against MOT_n_DIRECTION of the log; set reversed of"
            " these thrusters in vehicle.toml the other way, and run again with --vehicle"
        )


def against(vehicle: Vehicle, rig: Rig) -> list[str]:
    """Thrusters that push against what frame and directions of the motors tell them.

    Raises `TrialError`: their number is not the frame's.
    """
    shares = np.asarray(ardusub_frames()[rig.frame])
    columns = np.asarray(vehicle.allocation_matrix())
    if columns.shape[1] != len(shares):
        raise TrialError(
            f"{vehicle.name}: expected the {len(shares)} thrusters of {rig.frame}, found {columns.shape[1]};"
            " give the vehicle with --vehicle"
        )
    signs = [-1.0 if facts["reversed"] else 1.0 for facts in vehicle.actuator_info().values()]
    # Roll, pitch, yaw, throttle (up), forward, lateral.
    pushes = np.stack([columns[3], columns[4], columns[5], -columns[2], columns[0], columns[1]], 1)
    agree = (pushes * shares).sum(axis=1) * np.array(signs) * np.asarray(rig.direction)
    return [
        name for name, agreement in zip(vehicle.actuators, agree.tolist(), strict=True) if agreement < 0.0
    ]
