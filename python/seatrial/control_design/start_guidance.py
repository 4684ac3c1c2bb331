"""The guidance and the safety reactions that go with start gains.

How late the course follows what guidance asks for sets the lookahead: reference filter, loop, and drift of
the hull. The line of sight asks for a heading ``-atan(y_e / Delta)``; the way of the vehicle, ``psi +
v/U``, follows a time tau later, and the cross-track error is a loop with the crossover ``U / Delta`` behind
that delay. With

    Delta = 2 U tau

a phase margin of 61 deg is left, of 47 deg with the integral (kappa = U/4 takes atan(1/4)), and of 36 deg at
1.6 times that speed. In the vertical plane alike, with ``theta - w/U``. A longer lookahead is smoother and
slower: the integral has learnt the drift after about ten of them. Where the loop of the path would still come
closer to -1 than `least_distance` at some speed, as behind a pitch that overshoots, the distance is longer.
tau is the phase of the linear motion behind lag and dead time at that crossover, over its frequency; the
third-order reference filter has ``3 atan(w / w_r) / w`` of it, 3/w_r when slow.

Turns begin on the identified turning circle (`seatrial.vehicle.steady_state`), half of tau early; a vehicle
with sway turns on the spot instead.

The integral gains are a quarter of the speed in the horizontal plane (critical damping) and a tenth in the
vertical one, where only trim and lift are to be learnt. Turns and accelerations take a share of the largest
demands. The core's default reactions suit a vehicle that is lighter than water, hovers, and has a substitute
for every actuator; where one of these is not so, other reactions are written.

Held by tests/control_design/test_control_design_start.py and tests/flight/test_acceptance_flights.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.control_design.loops import Sampled, plant, reference_drive, restoring_law, sampled
from seatrial.control_design.mode_table import Mode, flies, mode_trim
from seatrial.control_design.operating_points import (
    AutopilotFacts,
    autopilot_facts,
    mode_at,
    mode_law,
    mode_loop,
)
from seatrial.control_design.pole_placement import LoopGain, law, three_digits
from seatrial.control_design.start_gains import StartGains
from seatrial.vehicle.actuators import LOOPS, ROWS, Delay, reach
from seatrial.vehicle.steady_state import turning_radius

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle


@dataclass(frozen=True)
class StartGuidanceSettings:
    """What guidance and safety reactions ask of a vehicle that flies with start gains."""

    #: Lookahead distance over speed and delay of the course: a phase margin of 61 deg.
    lookahead_delays: float = 2.0
    #: Motion of a correction, m/s and rad/s: quadratic damping counts by its secant over that.
    correction_m_s: float = 0.1
    #: Rounds of the search for the delay; each halves what is left, so that a millionth remains.
    delay_rounds: int = 20
    least_distance: float = 0.4  #: Least distance of a path's open loop from -1: a sensitivity of 2.5.
    cruise_share: float = 0.6  #: Cruising speed as a share of the top speed.
    lookahead_lengths: float = 2.0  #: Least lookahead in lengths of the vehicle.
    pitch_max_deg: float = 20.0  #: Largest pitch that is asked for, deg.
    #: Share of the actuators' reach that must hold the pitch against the righting moment.
    pitch_reach_share: float = 0.5
    turn_rate_max_deg_s: float = 20.0  #: Largest turn rate, deg/s, as a survey flies.
    #: Share of the largest demand that guidance may ask for; the rest is left to the loops.
    demand_share: float = 0.5
    speed_up_s: float = 4.0  #: Shortest time from rest to the cruising speed, s.
    #: Share of the course's delay by which a turn begins early: the loop follows a ramp of the heading closer
    #: than a sine.
    turn_delay_share: float = 0.5
    #: Share of the speed that is left while the bow is a right angle off: who can stop turns on the spot.
    turn_speed_share: float = 0.2
    hold_radius_max_m: float = 2.0  #: Largest radius within which a station is held, m.
    watch_radius_ratio: float = 2.5  #: Watch radius over hold radius.
    loiter_radius_min_m: float = 5.0  #: Least radius of a circle in place of a station, m.
    loiter_radius_ratio: float = 1.25  #: Radius of that circle over that of the tightest turn.
    #: Gain of weathervaning over that of holding: well damped in currents from 0.2 m/s on.
    weathervane_ratio: float = 5.0
    surfacing_speed_ratio: float = 1.1  #: Speed while surfacing over that of the slowest level flight.
    stale_velocity_s: float = 20.0  #: Time without a velocity after which the vehicle surfaces, s.
    #: Smallest over largest singular value of what is left below which a lost actuator has no substitute.
    rank_share: float = 0.02


START_GUIDANCE_SETTINGS = StartGuidanceSettings()

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
    tau = _delay_at_crossover(*_followed(vehicle, flight, loop, period_s), reference_rad_s)
    return START_GUIDANCE_SETTINGS.lookahead_delays * flight[1] * tau, tau


def _followed(
    vehicle: Vehicle,
    flight: tuple[Mode, float, dict[str, LoopGain], dict[str, Delay]],
    loop: str,
    period_s: float,
) -> tuple[Sampled, tuple[Array, Array], tuple[str, float, float]]:
    """System, laws and loop of `following_delay` for a flight of `lookahead`."""
    mode, speed, gains, late = flight
    rows = "".join(ROWS[LOOPS.index(name)] for name in LOOPS if name in mode.loops)
    at = mode_trim(vehicle, speed, mode)
    system = sampled(
        plant(vehicle, at, mode.loops, motion=START_GUIDANCE_SETTINGS.correction_m_s),
        late,
        period_s,
        mode.loops,
    )
    own = law({name: gains[name] for name in mode.loops}, speed)
    inertia = float(np.asarray(vehicle.mass_matrix())[LOOPS.index(loop), LOOPS.index(loop)])
    return system, (own, own + restoring_law(vehicle, rows)), (loop, speed, inertia)


def lookahead_of(
    vehicle: Vehicle, autopilot: Autopilot, loop: str, speed: float, *, late_s: Mapping[str, float]
) -> tuple[float, float]:
    """Lookahead distance in m and delay of the course in s that go with an autopilot's own gains.

    `vehicle`: the model; `autopilot`: PID loops; `loop`: "heading" or "pitch"; `speed`: at which the distance
    holds, m/s; `late_s`: age of the measurements per loop, s.

    Examples
    --------
    >>> import seatrial as st
    >>> cwolf, autopilot = st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf")
    >>> distance, tau = lookahead_of(cwolf, autopilot, "heading", 1.951, late_s={})
    >>> abs(distance - autopilot.gains()["guidance.lookahead_m"]) < 0.1
    True
    """
    tau = _delay_at_crossover(*_followed_by(vehicle, autopilot_facts(autopilot), loop, speed, late_s))
    return START_GUIDANCE_SETTINGS.lookahead_delays * speed * tau, tau


def least_lookahead_of(vehicle: Vehicle, facts: AutopilotFacts, loop: str, speed: float) -> float:
    """The shortest lookahead in m behind which an autopilot's own gains keep a path at a speed, m/s.

    Of a loop that works there; zero where any does. Parameters are those of `lookahead_of`.
    """
    return least_lookahead(path_loop(*_followed_by(vehicle, facts, loop, speed, {})))


def _followed_by(
    vehicle: Vehicle, facts: AutopilotFacts, loop: str, speed: float, late_s: Mapping[str, float]
) -> tuple[Sampled, tuple[Array, Array], tuple[str, float, float], float]:
    """System, laws, loop and reference of `following_delay` for an autopilot's own gains."""
    mode = mode_at(facts, speed).name
    at = mode_loop(
        vehicle, facts, mode, speed, measured_late_s=late_s, motion=START_GUIDANCE_SETTINGS.correction_m_s
    )
    own = mode_law(facts, mode, at.loops, speed)
    inertia = float(np.asarray(vehicle.mass_matrix())[LOOPS.index(loop), LOOPS.index(loop)])
    reference = facts.loops[loop].get("reference_rad_s") or np.inf
    return at.system, (own, own + at.known), (loop, speed, inertia), reference


def _delay_at_crossover(
    system: Sampled, laws: tuple[Array, Array], loop: tuple[str, float, float], reference_rad_s: float
) -> float:
    """Delay of the course in s at the crossover of a line of sight that is made for this delay."""
    tau = 3.0 / reference_rad_s + system.period_s
    for _ in range(START_GUIDANCE_SETTINGS.delay_rounds):
        late = following_delay(
            system, laws, loop, reference_rad_s, 1.0 / (START_GUIDANCE_SETTINGS.lookahead_delays * tau)
        )
        tau = max(0.5 * tau + 0.5 * late, system.period_s)
    return tau


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
    lag = -float(np.angle(_course(system, laws, loop, omega))) % (2.0 * np.pi)
    lag -= 2.0 * np.pi if lag > 1.5 * np.pi else 0.0
    return (lag + 3.0 * float(np.arctan(omega / reference_rad_s))) / omega


def _course(
    system: Sampled, laws: tuple[Array, Array], loop: tuple[str, float, float], omega: float
) -> complex:
    """Angle of the course over a filtered reference of the loop's angle, at omega (rad/s)."""
    name, speed, inertia = loop
    z = np.exp(1j * omega * system.period_s)
    step, drive = reference_drive(system, laws, name, (1j * omega, inertia))
    x = np.linalg.solve(z * np.eye(len(step)) - step, drive)
    (angle, factor), (flow, sign) = _WAY[name]
    answer = factor * x[system.seen[system.columns.index(angle)]]
    return complex(answer + sign * x[system.seen[system.columns.index(flow)]] / speed)


def path_loop(
    system: Sampled, laws: tuple[Array, Array], loop: tuple[str, float, float], reference_rad_s: float
) -> Array:
    """Open loop of the line of sight for a lookahead of one metre, complex, over `PATH_RAD_S`.

    ``U/(j w) F(j w) G(j w)``: the course follows a filtered reference by ``G``, the reference filter is
    ``F``. Over a lookahead distance it is the open loop of the path. Parameters are those of
    `following_delay`.
    """
    speed = loop[1]
    course = np.array([_course(system, laws, loop, omega) for omega in PATH_RAD_S])
    s = 1j * PATH_RAD_S
    return np.asarray(speed / s * (1.0 / (1.0 + s / reference_rad_s)) ** 3 * course)


PATH_RAD_S = np.geomspace(0.01, 8.0, 120)
"""Frequencies at which the loop of a path is judged, rad/s."""

INTEGRAL_SHARES = {"cross_track": 0.25, "depth": 0.1}
"""Integral gain of a path over the speed that it holds for."""


def guidance(vehicle: Vehicle, start: StartGains) -> tuple[dict[str, Any], dict[str, float]]:
    """Table of the guidance, in m, m/s and deg, and the course's delay in s per "heading" and "pitch"."""
    cruise = START_GUIDANCE_SETTINGS.cruise_share * start.top_m_s[1]
    mass = float(np.asarray(vehicle.mass_matrix())[0, 0])
    length = vehicle.geometry().get("length", 1.0)
    mode = next(m for m in start.modes if flies(m, start.modes, cruise))
    by_pitch = mode.depth_by == "pitch"
    surge, heading = start.loops["surge"], start.loops["heading"]
    turn = _steady_turn(vehicle, cruise, START_GUIDANCE_SETTINGS.demand_share * heading.tau_max)
    tightest = 0.0 if "heave" in start.loops else _tightest(vehicle, start)
    circle = 1.5 * cruise / max(min(turn, np.deg2rad(START_GUIDANCE_SETTINGS.turn_rate_max_deg_s)), 1e-3)
    table: dict[str, Any] = {"method": "integral"}
    late: dict[str, float] = {}
    for key, loop in (("lookahead_m", "heading"), ("lookahead_vertical_m", "pitch")):
        if loop == "heading" or by_pitch:
            distance, late[loop] = _lookahead(vehicle, start, mode, loop)
            table[key] = _widened(
                vehicle, start, loop, max(distance, START_GUIDANCE_SETTINGS.lookahead_lengths * length)
            )
    hold = min(0.2 * float(np.median([gain.bandwidth for gain in surge.gains])), 0.2)
    table |= {
        "lookahead_speed_m_s": start.speeds_m_s[_nearest(start, cruise)],
        "integral_gain_m_s": INTEGRAL_SHARES["cross_track"] * cruise,
        "integral_gain_vertical_m_s": INTEGRAL_SHARES["depth"] * cruise,
        "speed_max_m_s": 0.9 * start.speeds_m_s[-1],
        "acceleration_max_m_s2": min(
            0.5 * START_GUIDANCE_SETTINGS.demand_share * surge.tau_max / mass,
            cruise / START_GUIDANCE_SETTINGS.speed_up_s,
        ),
        "turn_rate_max_deg_s": float(min(START_GUIDANCE_SETTINGS.turn_rate_max_deg_s, np.rad2deg(turn))),
        "loiter_radius_m": max(
            START_GUIDANCE_SETTINGS.loiter_radius_min_m,
            circle,
            START_GUIDANCE_SETTINGS.loiter_radius_ratio * tightest,
        ),
        "hold_gain_per_s": hold,
    }
    if "sway" not in start.loops:  # else it slows down and turns on the spot
        table["turn_radius_m"] = turning_radius(vehicle, cruise) or cruise / np.deg2rad(
            START_GUIDANCE_SETTINGS.turn_rate_max_deg_s
        )
        table["turn_delay_s"] = START_GUIDANCE_SETTINGS.turn_delay_share * late["heading"]
    if "heave" in start.loops:
        radius = float(np.clip(length, 0.5, START_GUIDANCE_SETTINGS.hold_radius_max_m))
        table |= {
            "hold_radius_m": radius,
            "watch_radius_m": START_GUIDANCE_SETTINGS.watch_radius_ratio * radius,
        }
        table["depth_rate_max_m_s"] = steady_speed(
            vehicle, np.zeros(6), 2, START_GUIDANCE_SETTINGS.demand_share * start.loops["heave"].tau_max
        )
        if "sway" in start.loops:
            table["turn_speed_share"] = START_GUIDANCE_SETTINGS.turn_speed_share
        else:
            table["weathervane_gain_rad_m"] = START_GUIDANCE_SETTINGS.weathervane_ratio * hold
    if by_pitch:
        table["pitch_max_deg"] = _largest_pitch(vehicle, start, cruise)
        pitch = start.loops["pitch"].gains[_nearest(start, cruise)].bandwidth
        table["pitch_rate_max_deg_s"] = 0.5 * table["pitch_max_deg"] * pitch
    return {
        key: value if isinstance(value, str) else three_digits(value) for key, value in table.items()
    }, late


def _tightest(vehicle: Vehicle, start: StartGains) -> float:
    """Radius in m of the tightest circle that the vehicle turns at every speed ahead; zero without any."""
    radii = (turning_radius(vehicle, speed) for speed in start.speeds_m_s if speed > 0.0)
    return max((radius for radius in radii if radius is not None), default=0.0)


def _widened(vehicle: Vehicle, start: StartGains, loop: str, distance: float) -> float:
    """The lookahead distance in m, longer where the path's loop would come close to -1 at some speed.

    It holds for the cruising speed, shrinks below it to a half at the least and stays above it.
    """
    cruise = start.speeds_m_s[_nearest(start, START_GUIDANCE_SETTINGS.cruise_share * start.top_m_s[1])]
    least = 0.0
    for k, speed in enumerate(start.speeds_m_s):
        mode = next((mode for mode in start.modes if flies(mode, start.modes, speed)), None)
        if speed <= 0.0 or mode is None or loop not in mode.loops:
            continue
        if loop == "pitch" and mode.depth_by != "pitch":
            continue
        gains = {name: of.gains[k] for name, of in start.loops.items()}
        open_loop = path_loop(
            *_followed(vehicle, (mode, speed, gains, start.late), loop, start.period_s),
            start.loops[loop].reference_rad_s,
        )
        least = max(least, least_lookahead(open_loop) / lookahead_share(speed, cruise))
    return max(distance, least)


def lookahead_share(speed: float, holds: float) -> float:
    """Share of a lookahead distance at a speed, m/s, where it holds for another, as in the core."""
    return float(np.clip(speed / holds, 0.5, 1.0)) if holds > 0.0 else 1.0


def least_lookahead(open_loop: Array) -> float:
    """The shortest lookahead in m whose `path_loop` stays `least_distance` away from -1."""
    distances = np.geomspace(0.05, 1000.0, 400)
    apart = np.abs(1.0 + open_loop / distances[:, None]).min(axis=1)
    close = np.flatnonzero(apart < START_GUIDANCE_SETTINGS.least_distance)
    return float(distances[min(close[-1] + 1, len(distances) - 1)]) if len(close) else 0.0


def _lookahead(vehicle: Vehicle, start: StartGains, mode: Mode, loop: str) -> tuple[float, float]:
    """Lookahead distance in m of a loop at the cruising speed, and the delay of the course in s."""
    k = _nearest(start, START_GUIDANCE_SETTINGS.cruise_share * start.top_m_s[1])
    flight = mode, start.speeds_m_s[k], {name: of.gains[k] for name, of in start.loops.items()}, start.late
    return lookahead(vehicle, flight, loop, start.loops[loop].reference_rad_s, start.period_s)


def _nearest(start: StartGains, speed: float) -> int:
    """Index of the breakpoint nearest to a speed."""
    return int(np.argmin(np.abs(np.array(start.speeds_m_s) - speed)))


def _largest_pitch(vehicle: Vehicle, start: StartGains, speed: float) -> float:
    """Pitch in deg that half of the reach holds against the righting moment at a speed, at most 20."""
    rows = "".join(row for row in ROWS if row not in start.left_out and row != "Z")
    low, high = reach(vehicle, speed, rows)["M"]
    angles = np.deg2rad(np.arange(1.0, START_GUIDANCE_SETTINGS.pitch_max_deg + 0.5))
    attitude = np.stack([0.0 * angles, angles, 0.0 * angles], axis=1)
    righting = np.asarray(vehicle.forces(np.zeros((len(angles), 6)), attitude)["restoring"])[:, 4]
    holdable = np.abs(righting) <= START_GUIDANCE_SETTINGS.pitch_reach_share * min(high, -low)
    return float(np.rad2deg(angles[holdable][-1])) if holdable.any() else 1.0


def _steady_turn(vehicle: Vehicle, speed: float, moment: float) -> float:
    """Turning rate in rad/s at which damping balances a yaw moment, the hull not drifting."""
    return steady_speed(vehicle, np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), 5, moment)


def steady_speed(vehicle: Vehicle, nu: Array, axis: int, force: float) -> float:
    """Velocity of an axis in m/s or rad/s at which damping balances a force in N or N m, up to 2.

    `nu` (6,) holds the other velocities, `axis` is an index in it.
    """
    velocities = np.linspace(0.0, 2.0, 401)
    motion = np.tile(nu, (len(velocities), 1))
    motion[:, axis] = velocities
    terms: Mapping[str, Any] = vehicle.forces(motion, np.zeros(3))
    damping = -(np.asarray(terms["damping"]) + np.asarray(terms["lift"]))[:, axis]
    return float(velocities[np.searchsorted(np.maximum.accumulate(damping), force, side="right") - 1])


def safety(vehicle: Vehicle, start: StartGains) -> dict[str, Any]:
    """Table of the reactions that differ from the core's defaults."""
    table: dict[str, Any] = {}
    hovers = start.modes[0].depth_by == "heave"
    if not hovers:
        table["surface_speed_m_s"] = three_digits(
            START_GUIDANCE_SETTINGS.surfacing_speed_ratio * start.speeds_m_s[0]
        )
    table["stale_velocity"] = {"after_s": START_GUIDANCE_SETTINGS.stale_velocity_s, "reaction": "surface"}
    if heavy(vehicle):
        for group, after in (("depth", 5.0), ("attitude", 2.0), ("rates", 2.0)):
            table[f"stale_{group}"] = {"after_s": after, "reaction": "surface"}
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
    irreplaceable = []
    for k, name in enumerate(vehicle.actuators):
        values = np.linalg.svd(np.delete(matrix, k, axis=1), compute_uv=False)
        if len(values) < len(rows) or values[-1] < START_GUIDANCE_SETTINGS.rank_share * values[0]:
            irreplaceable.append(name)
    return tuple(irreplaceable)
