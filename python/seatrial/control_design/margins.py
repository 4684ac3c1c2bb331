"""How old the measurements are that each loop closes on, on the average: a dead time of the linear loop.

A sensor tells what was latency_s ago, and holds it until its next sample: 1/rate_hz later, so that the hold
adds half of that on the average. Sample and hold is taken as this dead time: its phase is the same, its fall
in magnitude is left out. A loop counts with the older of its measurements, of what it holds and of that
one's rate. A sensor without rate_hz is as fast as the control period. Source: Åström and Wittenmark,
*Computer-Controlled Systems* (1997), section 2. Held by tests/control_design/test_margin_sensors.py.

Supporting points that a vehicle reaches, and the modes that can work at a speed.

Held by tests/control_design/test_margin_constraint.py.

Margins of an autopilot on a vehicle's model, per mode and speed, and the speeds at which it is sound.

All loops of the mode are closed on the linear motion about its trim, behind lag and dead time of the
actuators and the control period (`seatrial.control_design.loops`), with the restoring feed-forward
where the file has it; each row of the wrench is then opened alone. A motion that neither grows nor dies
away within an hour (an undamped roll that nothing commands) counts as neutral. Held by
tests/control_design/test_autopilot_margins.py.

Margins of an autopilot's loops for the report, by python-control.

Each row of the wrench is opened alone, the others closed: a discrete `control.StateSpace`, of which
`control.disk_margins` takes the balanced disk margin, and as frequency response data
`control.stability_margins` the gain and phase margins. Not from the state space: its polynomials have the
poles of the dead time at 0 and of the integrators at 1 several times over, and with CWolf's 22 states a gain
margin of 4.5 comes out as 1.2. Source: Seiler, Packard and Gahinet (2020), *An introduction to disk
margins*, IEEE Control Systems 40(5). Held by tests/control_design/test_margin_constraint.py.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.flight.sensor_channels import sensors_of
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.loops import Sampled
    from seatrial.sensors.sensor import Sensor

__all__ = [
    "ENOUGH_DEG",
    "MarginRow",
    "ReportedMargins",
    "autopilot_margins",
    "margin_table",
    "measurement_delays",
    "open_loop",
    "reachable_points",
    "report_margins",
    "sound_speeds",
    "working_points",
]

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

    Parameters
    ----------
    sensors : mapping of str to Sensor, "typical" or a file, optional
        By kind; nothing is late where they are perfect (None), nor where a kind is missing.
    vehicle : Vehicle
        The one that carries them.

    Raises
    ------
    TrialError
        The file or a kind is not usable.

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
    """Whether each supporting point (6,) lies between the top speeds astern and ahead.

    Parameters
    ----------
    vehicle : Vehicle
    autopilot : Autopilot
    voltage_v : float, optional
        Supply at which tables of thrust are read, V.

    Examples
    --------
    >>> import seatrial as st
    >>> reachable_points(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"))
    array([ True,  True,  True,  True,  True,  True])
    """
    from seatrial.control_design.mode_table import top_speeds

    astern, ahead = top_speeds(vehicle, voltage_v=voltage_v)
    speeds = np.asarray(autopilot.speeds_m_s)
    return np.asarray((speeds >= astern) & (speeds <= ahead))


def working_points(tables: dict[str, Any], speeds_m_s: Sequence[float]) -> list[tuple[str, float]]:
    """Mode and speed in m/s of every mode that can work at a speed, and of both at a switching speed.

    ``tables`` are those of the autopilot file. Between a switching speed and its hysteresis below it, either
    mode may be at work.
    """
    modes, found = tables["modes"], []
    switching = [float(mode["from_speed_m_s"]) for mode in modes[1:]]
    least, most = min(speeds_m_s), max(speeds_m_s)
    every = {float(u) for u in speeds_m_s} | {u for u in switching if least < u < most}
    for speed in sorted(every):
        for k, mode in enumerate(modes):
            begun = k == 0 or speed >= mode["from_speed_m_s"] - mode["hysteresis_m_s"]
            if begun and (k + 1 == len(modes) or speed <= modes[k + 1]["from_speed_m_s"]):
                found.append((str(mode["name"]), speed))
    return found


ENOUGH_DEG = 35.0
"""Phase margin in deg that start gains are made for."""

_STATES = ("depth", "roll", "pitch", "heading", "speed", "sway", "heave", "roll", "pitch", "heading")
"""The first states of the closed loop in words, rates as what they move."""

_POINTS = 6

_HOUR_S = 3600.0

_MUCH = 0.3  # of what moves most

_FINE = 61  # speeds at which the sound range is looked for


@dataclass(frozen=True)
class MarginRow:
    """Margins of a mode at a desired speed in m/s.

    ``phase_deg``, ``gain`` (a factor upwards) and ``delay_s`` are the least over the rows of the wrench,
    each opened alone; ``doubles_s`` is the time in which a motion doubles, None where none grows, and
    ``grows`` what moves most in it. ``trimmed`` says whether there is straight level motion at that speed.
    """

    mode: str
    speed_m_s: float
    phase_deg: float
    gain: float
    delay_s: float
    doubles_s: float | None
    grows: str
    trimmed: bool

    @property
    def sound(self) -> bool:
        """Whether nothing grows and the phase margin is enough."""
        return self.doubles_s is None and self.phase_deg >= ENOUGH_DEG

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if self.doubles_s is not None:
            return f"{self.grows}: x2 in {self.doubles_s:.2g} s"
        return "sound" if self.sound else "little margin"


def autopilot_margins(
    vehicle: Vehicle, autopilot: Autopilot, *, speeds_m_s: Sequence[float] | None = None
) -> list[MarginRow]:
    """Margins of the mode that works at each desired speed.

    Parameters
    ----------
    vehicle : Vehicle
        The model, as good as it is.
    autopilot : Autopilot
    speeds_m_s : sequence of float, optional
        Desired speeds, m/s; the supporting points when missing.

    Examples
    --------
    >>> import seatrial as st
    >>> rows = autopilot_margins(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"))
    >>> sorted({row.mode for row in rows})
    ['cruise', 'hover']
    """
    tables: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    modes = tables["modes"]
    found = []
    for speed in autopilot.speeds_m_s if speeds_m_s is None else speeds_m_s:
        reached = [mode for mode in modes[1:] if speed >= mode["from_speed_m_s"]]
        found.append(_at(vehicle, tables, (reached or modes[:1])[-1]["name"], float(speed)))
    return found


def sound_speeds(vehicle: Vehicle, autopilot: Autopilot) -> tuple[float, float] | None:
    """Least and largest desired speed ahead in m/s between which every margin is sound; None without any.

    They are looked for between the supporting points, too, from the slowest sound one upwards.
    """
    points = autopilot.speeds_m_s
    grid = np.linspace(max(points[0], 0.0), points[-1], _FINE)
    rows = autopilot_margins(vehicle, autopilot, speeds_m_s=list(grid))
    first = next((k for k, row in enumerate(rows) if row.sound), None)
    if first is None:
        return None
    last = next((k for k in range(first, len(rows)) if not rows[k].sound), len(rows)) - 1
    return float(grid[first]), float(grid[last])


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
    known: NDArray[np.float64]
    trimmed: bool


def mode_loop(
    vehicle: Vehicle,
    tables: dict[str, Any],
    mode: str,
    speed_m_s: float,
    *,
    measured_late_s: Mapping[str, float] | None = None,
) -> ModeLoop:
    """Sampled motion about the trim of a mode at a speed in m/s, of the tables of an autopilot file.

    ``measured_late_s`` is the age in s of what each loop measures, 0 where missing. The loop is opened at
    its row of the wrench: there dead time of its measurements and of its actuators are the same.
    """
    from seatrial.control_design.loops import STATES, plant, restoring_law, sampled
    from seatrial.control_design.trim import Trim, trim
    from seatrial.vehicle.authority import LOOPS, ROWS, delays

    table = next(one for one in tables["modes"] if one["name"] == mode)
    loops = tuple(loop for loop in LOOPS if loop in table["loops"])
    rows = "".join(ROWS[LOOPS.index(loop)] for loop in loops)
    actuators = _at_work(vehicle, table.get("actuators", ()))
    flight = trim(vehicle, speed_m_s, rows, actuators)
    nu = np.array([speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
    about = flight or Trim(speed_m_s, rows, np.zeros(3), nu, np.zeros(6), actuators)
    motion = plant(vehicle, about, loops)
    late = {ROWS[LOOPS.index(loop)]: (measured_late_s or {}).get(loop, 0.0) for loop in loops}
    behind = {
        row: replace(delay, dead_s=delay.dead_s + late[row]) for row, delay in delays(vehicle, rows).items()
    }
    system = sampled(motion, behind, float(tables["period_s"]), loops)
    known = np.zeros((len(ROWS), len(STATES)))
    if tables["feed_forward"]["restoring"]:
        known = restoring_law(vehicle, rows)
    return ModeLoop(mode, speed_m_s, loops, system, known, flight is not None)


def _at(vehicle: Vehicle, tables: dict[str, Any], mode: str, speed: float) -> MarginRow:
    from seatrial.control_design.loops import closed, margins

    at = mode_loop(vehicle, tables, mode, speed)
    gain = mode_law(tables, mode, at.loops, speed) + at.known
    reached = margins(at.system, gain)
    doubles, grows = None, ""
    if reached.radius > neutral_radius(at.system.period_s):
        doubles = float(at.system.period_s * np.log(2.0) / np.log(reached.radius))
        grows = _moves_most(closed(at.system, gain), at.system)
    return MarginRow(
        mode=mode,
        speed_m_s=speed,
        phase_deg=reached.phase_deg,
        gain=reached.gain,
        delay_s=reached.delay_s,
        doubles_s=doubles,
        grows=grows,
        trimmed=at.trimmed,
    )


def neutral_radius(period_s: float) -> float:
    """Largest closed-loop |eigenvalue| per step that counts as neutral: doubling within an hour."""
    return float(2.0 ** (period_s / _HOUR_S))


def _moves_most(step: NDArray[np.float64], system: Sampled) -> str:
    """What moves, against what is tolerated, in the motion that grows fastest: the most first."""
    from seatrial.control_design.lqr import Tolerances

    values, vectors = np.linalg.eig(step)
    vector = np.abs(vectors[:, np.abs(values).argmax()])
    tolerated = Tolerances().of_states()
    sizes: dict[str, float] = {}
    for place, column in zip(system.seen, system.columns, strict=True):
        if column < len(_STATES):
            name = _STATES[column]
            sizes[name] = max(sizes.get(name, 0.0), float(vector[place]) / tolerated[column])
    much = [name for name in sizes if sizes[name] >= _MUCH * max(sizes.values())]
    return " and ".join(sorted(much, key=lambda name: -sizes[name])[:2])


def mode_law(tables: dict[str, Any], mode: str, loops: tuple[str, ...], speed: float) -> NDArray[np.float64]:
    """The control law of a mode at a desired speed as K (6, 15), between the points linear as in the core."""
    from seatrial.control_design.loop_gains import LoopGain, law

    points = tables["schedule"]["speeds_m_s"]
    if tables["control"] == "lqr":
        given = np.asarray(
            next(table["gain"] for table in tables["lqr"] if table["mode"] == mode), dtype=float
        )
        shape = given.shape[-2:]
        flat = np.broadcast_to(given, (_POINTS, *shape)).reshape(_POINTS, -1)
        return np.array([np.interp(speed, points, column) for column in flat.T]).reshape(shape)

    def value(loop: str, key: str) -> float:
        return float(np.interp(speed, points, np.broadcast_to(tables["loops"][loop].get(key, 0.0), _POINTS)))

    gains = {
        loop: LoopGain(value(loop, "K_P"), value(loop, "K_I_per_s"), value(loop, "K_D_s"), np.nan)
        for loop in loops
    }
    return law(gains, speed)


def _at_work(vehicle: Vehicle, named: Any) -> tuple[str, ...] | None:
    """Actuators of a mode, groups resolved; None for all."""
    facts = vehicle.actuator_info()
    found = tuple(name for name in vehicle.actuators if name in named or facts[name]["group"] in named)
    return found or None


_FREQUENCIES = 400

_BELOW_NYQUIST = 0.9999  # at half the sampling rate every response is real: it is looked at by itself


@dataclass(frozen=True)
class ReportedMargins:
    """Margins of a loop in a mode at a desired speed in m/s, the other loops closed.

    Each margin is None where nothing bounds it, and so is its frequency in rad/s.

    Attributes
    ----------
    mode, speed_m_s, loop
        Which.
    stable
        Whether nothing grows with all loops closed; otherwise the margins are distances from the other side.
    gain_up_db, gain_up_rad_s
        By how much the gain may rise.
    gain_down_db, gain_down_rad_s
        By how much it may fall, positive.
    phase_deg, phase_rad_s
        Phase margin.
    delay_s, delay_rad_s
        Delay that may be added.
    disk
        Balanced disk margin, at most 2.
    disk_gain_db, disk_phase_deg
        Gain (either way) and phase that it stands for; the gain is None where any is tolerated.
    """

    mode: str
    speed_m_s: float
    loop: str
    stable: bool
    gain_up_db: float | None
    gain_up_rad_s: float | None
    gain_down_db: float | None
    gain_down_rad_s: float | None
    phase_deg: float | None
    phase_rad_s: float | None
    delay_s: float | None
    delay_rad_s: float | None
    disk: float
    disk_gain_db: float | None
    disk_phase_deg: float | None

    def to_dict(self) -> dict[str, Any]:
        """The margins as plain data for JSON."""
        return asdict(self)


def report_margins(
    vehicle: Vehicle,
    autopilot: Autopilot,
    speeds_m_s: Sequence[float] | None = None,
    *,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
) -> list[ReportedMargins]:
    """Margins per mode, speed and loop of an autopilot on a vehicle's model.

    Parameters
    ----------
    vehicle : Vehicle
    autopilot : Autopilot
        PID loops or a regulator.
    speeds_m_s : sequence of float, optional
        Desired speeds, m/s, and the switching speeds between them; the supporting points that the vehicle
        reaches when missing.
    sensors : mapping of str to Sensor, "typical" or a file, optional
        Whose latency and interval the loops bear; perfect ones when missing.

    Examples
    --------
    >>> import seatrial as st
    >>> found = report_margins(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"), [3.021])
    >>> [(row.mode, row.loop, round(row.gain_up_db), round(row.phase_deg)) for row in found]
    [('cruise', 'surge', 38, 95), ('cruise', 'pitch', 28, 89), ('cruise', 'heading', 29, 65)]
    """
    from seatrial.control_design.loops import closed, feedback

    tables: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    if speeds_m_s is None:
        reached = reachable_points(vehicle, autopilot)
        speeds_m_s = [u for u, hit in zip(autopilot.speeds_m_s, reached, strict=True) if hit]
    late = measurement_delays(sensors, vehicle)
    found = []
    for mode, speed in working_points(tables, speeds_m_s):
        at = mode_loop(vehicle, tables, mode, speed, measured_late_s=late)
        law = mode_law(tables, mode, at.loops, speed) + at.known
        radius = np.abs(np.linalg.eigvals(closed(at.system, law))).max()
        stable = bool(radius <= neutral_radius(at.system.period_s))
        gain = feedback(at.system, law)
        for row, loop in enumerate(at.loops):
            margins = _margins(open_loop(at.system, gain, row), at.system.period_s)
            found.append(ReportedMargins(mode, speed, loop, stable, **margins))
    return found


def open_loop(of: Sampled, gain: Array, row: int) -> Any:
    """Discrete `control.StateSpace` of a row opened alone, the others closed by K (rows, state)."""
    import control

    others = [k for k in range(len(gain)) if k != row]
    step = of.phi - of.gamma[:, others] @ gain[others]
    return control.ss(step, of.gamma[:, [row]], gain[[row]], 0.0, of.period_s)


def _margins(loop: Any, period_s: float) -> dict[str, Any]:
    """Margins of an open loop by the names of `ReportedMargins`."""
    import control

    omega = np.geomspace(1e-3, _BELOW_NYQUIST * np.pi / period_s, _FREQUENCIES)
    response = control.frd(loop, omega)
    gains, phases, _, at_gain, at_phase, _ = control.stability_margins(response, returnall=True)
    edge = complex(loop(-1.0))  # a pole may leave through z = -1, half the sampling rate
    if edge.real < 0.0:
        gains, at_gain = np.append(gains, 1.0 / -edge.real), np.append(at_gain, np.pi / period_s)
    decibel = 20.0 * np.log10(gains)
    up, down = decibel > 0.0, decibel <= 0.0
    late = np.deg2rad(phases % 360.0) / at_phase
    disk, disk_gain, disk_phase = (float(value) for value in control.disk_margins(loop, omega))
    least = {
        ("gain_up_db", "gain_up_rad_s"): (decibel[up], at_gain[up]),
        ("gain_down_db", "gain_down_rad_s"): (-decibel[down], at_gain[down]),
        ("phase_deg", "phase_rad_s"): (np.abs(phases), at_phase),
        ("delay_s", "delay_rad_s"): (late, at_phase),
    }
    found: dict[str, Any] = {
        "disk": disk,
        "disk_gain_db": disk_gain if np.isfinite(disk_gain) else None,
        "disk_phase_deg": disk_phase if np.isfinite(disk_phase) else None,
    }
    for names, (values, frequencies) in least.items():
        first = int(np.argmin(values)) if len(values) else None
        for name, column in zip(names, (values, frequencies), strict=True):
            found[name] = None if first is None else float(column[first])
    return found


def margin_table(rows: Sequence[ReportedMargins]) -> str:
    """The margins as a table in text, one line per mode, speed and loop.

    Examples
    --------
    >>> row = ReportedMargins("cruise", 2.0, "heading", True, 29.1, 2.8, None, None, 61.2, 0.35, 3.05, 0.35,
    ...     1.16, 11.5, 60.3)
    >>> print(margin_table([row]))
    mode    m/s    loop     gain up  gain down  phase  delay  disk
                                 dB         dB    deg      s
    cruise   2.00  heading     29.1         -   61.2   3.05  1.16
    """
    lines = [
        "mode    m/s    loop     gain up  gain down  phase  delay  disk",
        "                             dB         dB    deg      s",
    ]

    def number(value: float | None, width: int, digits: int) -> str:
        return f"{'-':>{width}}" if value is None else f"{value:{width}.{digits}f}"

    for row in rows:
        lines.append(
            f"{row.mode:<7} {row.speed_m_s:5.2f}  {row.loop:<7}"
            f"{number(row.gain_up_db, 9, 1)} {number(row.gain_down_db, 10, 1)}"
            f" {number(row.phase_deg, 6, 1)} {number(row.delay_s, 6, 2)} {number(row.disk, 5, 2)}"
            + ("" if row.stable else "  unstable")
        )
    return "\n".join(lines)
