"""Start values of an autopilot from the vehicle's model: modes, supporting speeds, gains and limits.

Which loops there are follows from the rows that the actuators can command; gains are placed by
`seatrial.control_design.loop_gains` and tried by `seatrial.control_design.loop_gains`. The largest demand
of a row is 80 % of its reach, half of it where the actuators that give it also drive ahead.

The reference filters are five times as fast as their position loops: they hold back a jump, not the
guidance. A loop has at most 0.2/T of the delay T of its actuators, so that these can still follow a reference
of 1/T. Held by tests/control_design/test_control_design_start.py.

How late the course follows what guidance asks for: reference filter, loop, and drift of the hull.

The line of sight asks for a heading ``-atan(y_e / Delta)``; the way of the vehicle, ``psi + v/U``, follows
a time tau later, and the cross-track error is a loop with the crossover ``U / Delta`` behind that delay. With

    Delta = 2 U tau

a phase margin of 61 deg is left, of 47 deg with the integral (kappa = U/4 takes atan(1/4)), and of 36 deg at
1.6 times that speed. In the vertical plane alike, with ``theta - w/U``. A longer lookahead is smoother and
slower: the integral has learnt the drift after about ten of them.

tau is the phase of the linear motion behind lag and dead time at that crossover, over its frequency; the
third-order reference filter has ``3 atan(w / w_r) / w`` of it, 3/w_r when slow. Held by
tests/control_design/test_control_design_start.py.

The table of the guidance that goes with start gains: distances, limits, station-keeping.

Lookahead distances are twice the speed times the delay of the course (`seatrial.control_design.start_gains`),
the integral gains a quarter of the speed in the horizontal plane (critical damping) and a tenth in the
vertical one, where only trim and lift are to be learnt. Turns and accelerations take a share of the largest
demands.
Held by tests/control_design/test_control_design_start.py.

The table of the reactions that goes with start gains: what the vehicle can still do when something fails.

The core's defaults suit a vehicle that is lighter than water, hovers, and has a substitute for every
actuator. Where one of these is not so, other reactions are written. Held by
tests/control_design/test_control_design_start.py and tests/flight/test_acceptance_flights.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.control_design.loop_gains import LoopGain, Trial, kind, law, three_digits
from seatrial.control_design.loops import Sampled, plant, reference_drive, restoring_law, sampled
from seatrial.control_design.mode_table import CRUISE, Mode, flies, mode_table, supporting_speeds, top_speeds
from seatrial.control_design.trim import Trim, trim
from seatrial.vehicle.actuators import NOMINAL_V, bollard, command
from seatrial.vehicle.authority import LOOPS, ROWS, Delay, commandable, delays, reach
from seatrial.vehicle.stability import neutral_fins
from seatrial.vehicle.steady_state import drivers

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = [
    "CROSSINGS",
    "CRUISE_LEG",
    "LoopStart",
    "StartGains",
    "following_delay",
    "guidance",
    "heavy",
    "lookahead",
    "safety",
    "start_gains",
    "without_substitute",
]

_SHARED, _ALONE = 0.5, 0.8  # share of the reach for a row whose actuators also drive ahead, and for another

_REFERENCE = {"position": 5.0, "speed": 2.0}  # natural frequency of the reference filter over the bandwidth

_DOPPLER_NOISE_M_S = 0.008  # of one ping, that of the typical sensors

_NOISE_SHARE = 0.25


@dataclass(frozen=True)
class LoopStart:
    """A loop's gains at the six supporting speeds; tau_max in N or N m, reference filter in rad/s."""

    gains: tuple[LoopGain, ...]
    tau_max: float
    reference_rad_s: float


@dataclass(frozen=True)
class StartGains:
    """Start values of an autopilot; ``left_out`` says per row why it is not commanded.

    ``late`` is per row the delay that the gains are made for; ``weak`` lists mode, speed and loops where no
    bandwidth met the demands on margins and step response.
    """

    speeds_m_s: tuple[float, ...]
    top_m_s: tuple[float, float]
    loops: dict[str, LoopStart]
    modes: tuple[Mode, ...]
    left_out: dict[str, str]
    period_s: float
    late: dict[str, Delay]
    weak: tuple[str, ...] = field(default=())


def start_gains(vehicle: Vehicle, *, period_s: float = 0.1, voltage_v: float = NOMINAL_V) -> StartGains:
    """Start values of an autopilot for a vehicle.

    Parameters
    ----------
    vehicle : Vehicle
    period_s : float
        Control period, s.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

    Raises
    ------
    ValueError
        A vehicle that cannot be steered: no thrust ahead, no heading, or neither heave force nor pitch.

    Examples
    --------
    >>> import seatrial as st
    >>> start = start_gains(st.Vehicle.load("cwolf"))
    >>> [(mode.name, mode.depth_by) for mode in start.modes]
    [('hover', 'heave'), ('cruise', 'pitch')]
    >>> sorted(start.left_out)
    ['K', 'Y']
    """
    top = top_speeds(vehicle, voltage_v=voltage_v)
    left_out = commandable(vehicle, 0.6 * top[1], voltage_v=voltage_v)
    rows = "".join(row for row in ROWS if row not in left_out)
    if "X" not in rows or "N" not in rows or not {"Z", "M"} & set(rows):
        missing = "; ".join(f"{row}: {why}" for row, why in left_out.items())
        raise ValueError(
            f"expected a vehicle that commands X, N and Z or M; {missing};"
            " give its actuators in the vehicle file"
        )
    late = {row: _with_hold(delay, period_s) for row, delay in delays(vehicle, rows).items()}
    rows = _without_stiff_roll(vehicle, rows, late, left_out)
    speeds = supporting_speeds(vehicle, rows, top)
    modes = mode_table(vehicle, rows, top)
    limits = [reach(vehicle, u, rows, voltage_v=voltage_v) for u in speeds]
    shares = {row: _share(vehicle, row) for row in rows}
    # Ahead only: a propeller that turns against the flow pushes harder than it can be asked to.
    slow = [limit for u, limit in zip(speeds, limits, strict=True) if u >= 0.0]
    slow += [reach(vehicle, 0.0, rows, voltage_v=voltage_v)] if "Z" in rows else []
    largest = {row: max(_usable(limit, row, shares) for limit in slow) for row in rows}
    largest["X"] = max(largest["X"], 1.05 * _drag(vehicle, speeds[-1]))
    design = Trial(vehicle, rows, late, period_s, top[1], _quiet(vehicle, voltage_v))
    found: dict[str, list[LoopGain]] = {LOOPS[ROWS.index(row)]: [] for row in rows}
    weak: list[str] = []
    for u, limit in zip(speeds, limits, strict=True):
        allowed = {row: _usable(limit, row, shares) for row in rows}
        gains, short = design.at(u, allowed, modes)
        weak += short
        for loop, gain in gains.items():
            found[loop].append(gain)
    loops = {}
    for loop, placed in found.items():
        used = [
            gain.bandwidth
            for u, gain in zip(speeds, placed, strict=True)
            if u > -CRUISE * top[1] and any(loop in m.loops and flies(m, modes, u) for m in modes)
        ]
        reference = _REFERENCE[kind(loop)] * float(np.median(used or [gain.bandwidth for gain in placed]))
        loops[loop] = LoopStart(tuple(placed), largest[ROWS[LOOPS.index(loop)]], reference)
    return StartGains(tuple(speeds), top, loops, modes, left_out, period_s, late, tuple(weak))


def _quiet(vehicle: Vehicle, voltage_v: float) -> float:
    """Surge gain in N per m/s at which noise of the velocity asks for a quarter of the least thrust, or inf.

    More of it starts and stops propellers that are asked for about their minimum revolutions.
    """
    facts = vehicle.actuator_info()
    least = {}
    for name, sense in drivers(vehicle).items():
        side = "minimum_ahead" if sense > 0.0 else "minimum_astern"
        least[name] = command(facts[name], sense * float(facts[name][side]) / _largest(facts[name], sense))
    thrust = float(bollard(vehicle, least, voltage_v=voltage_v)[0])
    return _NOISE_SHARE * thrust / _DOPPLER_NOISE_M_S if thrust > 0.0 else np.inf


def _largest(facts: dict[str, Any], sense: float) -> float:
    return float(facts["maximum_ahead" if sense > 0.0 else "maximum_astern"])


def _with_hold(delay: Delay, period_s: float) -> Delay:
    """The delay with the half period that a held demand is late on average."""
    return replace(delay, ramp_s=delay.ramp_s + 0.5 * period_s)


def _share(vehicle: Vehicle, row: str) -> float:
    matrix = np.abs(np.asarray(vehicle.allocation_matrix()))[ROWS.index(row)]
    driving = [k for k, name in enumerate(vehicle.actuators) if name in drivers(vehicle)]
    return _SHARED if row != "X" and matrix[driving].max(initial=0.0) > 0.5 * matrix.max() else _ALONE


def _usable(limit: dict[str, Array], row: str, shares: dict[str, float]) -> float:
    low, high = limit[row]
    return shares[row] * float(high if row == "X" else min(high, -low))


def _drag(vehicle: Vehicle, speed: float) -> float:
    nu = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    force = sum(np.asarray(term) for term in vehicle.forces(nu, np.zeros(3)).values())
    return -float((force + neutral_fins(vehicle, nu[None])[0])[0])


def _without_stiff_roll(vehicle: Vehicle, rows: str, late: dict[str, Delay], left_out: dict[str, str]) -> str:
    """The rows without a roll moment that is too slow for the hull's own righting."""
    if "K" not in rows:
        return rows
    tilted = np.zeros((2, 3))
    tilted[:, 0] = [1e-5, -1e-5]
    moment = np.asarray(vehicle.forces(np.zeros((2, 6)), tilted)["restoring"])[:, 3]
    own = np.sqrt(max(-(moment[0] - moment[1]) / 2e-5, 0.0) / np.asarray(vehicle.mass_matrix())[3, 3])
    possible = 0.2 / late["K"].total_s
    if own <= 2.0 * possible:
        return rows
    left_out["K"] = (
        f"the hull rights itself at {own:.1f} rad/s, faster than the actuators' {possible:.1f} rad/s allow"
    )
    return rows.replace("K", "")


CROSSINGS = 2.0
"""Lookahead distance over speed and delay."""

MOTION = 0.1
"""In m/s and rad/s, of a correction: quadratic damping counts by its secant over that."""

_ROUNDS = 20

_WAY = {"heading": ((3, 1.0), (5, 1.0)), "pitch": ((2, 1.0), (6, -1.0))}
"""Angle of the course: the angle that is controlled, and the cross-flow over the speed with its sign."""


def lookahead(
    vehicle: Vehicle,
    flight: tuple[Mode, float, dict[str, LoopGain], dict[str, Delay]],
    loop: str,
    reference_rad_s: float,
    period_s: float,
) -> tuple[float, float]:
    """Lookahead distance in m of "heading" or "pitch", and the delay in s that it is made for.

    ``flight`` is the mode, the speed in m/s, the gains of its loops there, and the delays of its rows.
    """
    mode, speed, gains, late = flight
    rows = "".join(ROWS[LOOPS.index(name)] for name in LOOPS if name in mode.loops)
    at = trim(vehicle, speed, rows, mode.actuators) or Trim(
        speed, rows, np.zeros(3), np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(6), mode.actuators
    )
    system = sampled(plant(vehicle, at, mode.loops, motion=MOTION), late, period_s, mode.loops)
    own = law({name: gains[name] for name in mode.loops}, speed)
    both = (own, own + restoring_law(vehicle, rows))
    inertia = float(np.asarray(vehicle.mass_matrix())[LOOPS.index(loop), LOOPS.index(loop)])
    tau = 3.0 / reference_rad_s
    for _ in range(_ROUNDS):
        crossover = 1.0 / (CROSSINGS * tau)
        tau = 0.5 * tau + 0.5 * following_delay(
            system, both, (loop, speed, inertia), reference_rad_s, crossover
        )
    return CROSSINGS * speed * tau, tau


def following_delay(
    system: Sampled,
    laws: tuple[Array, Array],
    loop: tuple[str, float, float],
    reference_rad_s: float,
    omega: float,
) -> float:
    """Delay in s at omega (rad/s) from the angle that guidance asks for to the angle of the course.

    ``laws`` are those of the loops, without and with the feed-forward at the measured attitude; ``loop`` its
    name, the speed in m/s and the inertia of the row, which is fed forward.
    """
    name, speed, inertia = loop
    own, fed = laws
    z = np.exp(1j * omega * system.period_s)
    step, drive = reference_drive(system, (own, fed), name, (1j * omega, inertia))
    x = np.linalg.solve(z * np.eye(len(step)) - step, drive)
    (angle, one), (flow, sign) = _WAY[name]
    answer = one * x[system.seen[system.columns.index(angle)]]
    answer += sign * x[system.seen[system.columns.index(flow)]] / speed
    lag = -float(np.angle(answer)) % (2.0 * np.pi)
    lag -= 2.0 * np.pi if lag > 1.5 * np.pi else 0.0
    return (lag + 3.0 * float(np.arctan(omega / reference_rad_s))) / omega


CRUISE_LEG = 0.6
"""Cruising speed as a share of the top speed."""

_INTEGRAL, _INTEGRAL_VERTICAL = 0.25, 0.1  # of the cruising speed

_LEAST_LENGTHS = 2.0  # of lookahead

_PITCH_DEG, _HELD = 20.0, 0.5  # largest pitch asked for; share of the reach that holds it

_TURN_DEG_S = 20.0

_SHARE = 0.5  # of the largest demand, for what the guidance asks

_START_S = 4.0  # to the cruising speed, at the least

_TURN_SHARE = 0.2  # of the speed while the bow is a right angle off: who can stop turns on the spot

_HOLD_RADIUS_M, _WATCH = 2.0, 2.5  # largest; watch radius over hold radius

_WEATHERVANE = 5.0  # times the hold gain: well damped in currents from 0.2 m/s on


def guidance(vehicle: Vehicle, start: StartGains) -> tuple[dict[str, Any], dict[str, float]]:
    """Table of the guidance, in m, m/s and deg, and the course's delay in s per "heading" and "pitch"."""
    cruise = CRUISE_LEG * start.top_m_s[1]
    mass = float(np.asarray(vehicle.mass_matrix())[0, 0])
    length = vehicle.geometry().get("length", 1.0)
    mode = next(m for m in start.modes if flies(m, start.modes, cruise))
    by_pitch = mode.depth_by == "pitch"
    surge, heading = start.loops["surge"], start.loops["heading"]
    turn = _steady_turn(vehicle, cruise, _SHARE * heading.tau_max)
    table: dict[str, Any] = {"method": "integral"}
    late: dict[str, float] = {}
    for key, loop in (("lookahead_m", "heading"), ("lookahead_vertical_m", "pitch")):
        if loop == "heading" or by_pitch:
            distance, late[loop] = _lookahead(vehicle, start, mode, loop)
            table[key] = max(distance, _LEAST_LENGTHS * length)
    hold = min(0.2 * float(np.median([gain.bandwidth for gain in surge.gains])), 0.2)
    table |= {
        "lookahead_speed_m_s": start.speeds_m_s[_nearest(start, cruise)],
        "integral_gain_m_s": _INTEGRAL * cruise,
        "integral_gain_vertical_m_s": _INTEGRAL_VERTICAL * cruise,
        "speed_max_m_s": 0.9 * start.speeds_m_s[-1],
        "acceleration_max_m_s2": min(0.5 * _SHARE * surge.tau_max / mass, cruise / _START_S),
        "turn_rate_max_deg_s": float(min(_TURN_DEG_S, np.rad2deg(turn))),
        "loiter_radius_m": max(5.0, 1.5 * cruise / max(min(turn, np.deg2rad(_TURN_DEG_S)), 1e-3)),
        "hold_gain_per_s": hold,
    }
    if "heave" in start.loops:
        radius = float(np.clip(length, 0.5, _HOLD_RADIUS_M))
        table |= {"hold_radius_m": radius, "watch_radius_m": _WATCH * radius}
        table["depth_rate_max_m_s"] = _steady_heave(vehicle, _SHARE * start.loops["heave"].tau_max)
        if "sway" in start.loops:
            table["turn_speed_share"] = _TURN_SHARE
        else:
            table["weathervane_gain_rad_m"] = _WEATHERVANE * hold
    if by_pitch:
        table["pitch_max_deg"] = _largest_pitch(vehicle, start, cruise)
        pitch = start.loops["pitch"].gains[_nearest(start, cruise)].bandwidth
        table["pitch_rate_max_deg_s"] = 0.5 * table["pitch_max_deg"] * pitch
    return {
        key: value if isinstance(value, str) else three_digits(value) for key, value in table.items()
    }, late


def _lookahead(vehicle: Vehicle, start: StartGains, mode: Mode, loop: str) -> tuple[float, float]:
    """Lookahead distance in m of a loop at the cruising speed, and the delay of the course in s."""
    k = _nearest(start, CRUISE_LEG * start.top_m_s[1])
    flight = mode, start.speeds_m_s[k], {name: of.gains[k] for name, of in start.loops.items()}, start.late
    return lookahead(vehicle, flight, loop, start.loops[loop].reference_rad_s, start.period_s)


def _nearest(start: StartGains, speed: float) -> int:
    """Index of the supporting point nearest to a speed."""
    return int(np.argmin(np.abs(np.array(start.speeds_m_s) - speed)))


def _largest_pitch(vehicle: Vehicle, start: StartGains, speed: float) -> float:
    """Pitch in deg that half of the reach holds against the righting moment at a speed, at most 20."""
    rows = "".join(row for row in ROWS if row not in start.left_out and row != "Z")
    low, high = reach(vehicle, speed, rows)["M"]
    angles = np.deg2rad(np.arange(1.0, _PITCH_DEG + 0.5))
    attitude = np.stack([0.0 * angles, angles, 0.0 * angles], axis=1)
    righting = np.asarray(vehicle.forces(np.zeros((len(angles), 6)), attitude)["restoring"])[:, 4]
    held = np.abs(righting) <= _HELD * min(high, -low)
    return float(np.rad2deg(angles[held][-1])) if held.any() else 1.0


def _steady_turn(vehicle: Vehicle, speed: float, moment: float) -> float:
    """Turning rate in rad/s at which damping balances a yaw moment, the hull not drifting."""
    return _balance(vehicle, np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), 5, moment)


def _steady_heave(vehicle: Vehicle, force: float) -> float:
    """Sinking speed in m/s at which damping balances a heave force."""
    return _balance(vehicle, np.zeros(6), 2, force)


def _balance(vehicle: Vehicle, nu: Array, axis: int, force: float) -> float:
    velocities = np.linspace(0.0, 2.0, 401)
    motion = np.tile(nu, (len(velocities), 1))
    motion[:, axis] = velocities
    terms: Mapping[str, Any] = vehicle.forces(motion, np.zeros(3))
    damping = -(np.asarray(terms["damping"]) + np.asarray(terms["lift"]))[:, axis]
    return float(velocities[np.searchsorted(np.maximum.accumulate(damping), force, side="right") - 1])


_FASTER = 1.1  # than the slowest level flight, while surfacing

_DOPPLER_S = 20.0

_SINGLE_ACTUATOR = 0.02  # smallest over largest singular value of what is left


def safety(vehicle: Vehicle, start: StartGains) -> dict[str, Any]:
    """Table of the reactions that differ from the core's defaults."""
    table: dict[str, Any] = {}
    hovers = start.modes[0].depth_by == "heave"
    if not hovers:
        table["surface_speed_m_s"] = three_digits(_FASTER * start.speeds_m_s[0])
    table["stale_velocity"] = {"after_s": _DOPPLER_S, "reaction": "surface"}
    if heavy(vehicle):
        for group, after in (("depth", 5.0), ("attitude", 2.0), ("rates", 2.0)):
            table[f"stale_{group}"] = {"after_s": after, "reaction": "surface" if hovers else "abort"}
    elif not hovers:
        table["depth"] = "abort"
    if without_substitute(vehicle, start):
        sinks_or_hovers = hovers or heavy(vehicle)
        reaction = "surface" if sinks_or_hovers else "abort"
        table["actuator"] = {"deviation": 0.2, "after_s": 2.0, "reaction": reaction}
    return table


def heavy(vehicle: Vehicle) -> bool:
    """Whether the vehicle sinks with all actuators at rest."""
    return bool(np.asarray(vehicle.forces(np.zeros((1, 6)), np.zeros(3))["restoring"])[0, 2] > 0.0)


def without_substitute(vehicle: Vehicle, start: StartGains) -> tuple[str, ...]:
    """Actuators without which the rows of the first mode cannot be commanded any more."""
    rows = [LOOPS.index(loop) for loop in start.modes[0].loops]
    matrix = np.asarray(vehicle.allocation_matrix())[rows]
    matrix = matrix / np.abs(matrix).max(axis=1, keepdims=True)
    found = []
    for k, name in enumerate(vehicle.actuators):
        values = np.linalg.svd(np.delete(matrix, k, axis=1), compute_uv=False)
        if len(values) < len(rows) or values[-1] < _SINGLE_ACTUATOR * values[0]:
            found.append(name)
    return tuple(found)
