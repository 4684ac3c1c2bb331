"""An autopilot file for a vehicle, computed from its model: TOML text with the reasons as comments.

The keys are those of the core's autopilot file; what the vehicle cannot do stands at the head. Guidance and
safety reactions go with the start gains.

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
with sway turns on the spot instead. The integral gains are a quarter of the speed in the horizontal plane
(critical damping) and a tenth in the vertical one, where only trim and lift are to be learnt. Turns and
accelerations take a share of the largest demands. The core's default reactions suit a vehicle that is lighter
than water, hovers, and has a substitute for every actuator; where one of these is not so, others are written.

Held by tests/control_design/test_control_design_start.py, tests/cli/test_cli_autopilot.py and
tests/flight/test_acceptance_flights.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import VehicleError
from seatrial.base.work import one_blas_thread
from seatrial.control_design.loops import (
    LOOP_OF,
    LoopGain,
    Sampled,
    law,
    plant,
    reference_drive,
    restoring_law,
    rows_of,
    sampled,
)
from seatrial.control_design.lqr import lqr_autopilot
from seatrial.control_design.operating_points import (
    AutopilotFacts,
    Mode,
    autopilot_facts,
    flies,
    mode_at,
    mode_law,
    mode_loop,
    mode_trim,
)
from seatrial.control_design.start_gains import LoopStart, StartGains, start_gains, three_digits
from seatrial.flight.checks import started_for
from seatrial.vehicle.actuators import LOOPS, ROWS, Delay, reach
from seatrial.vehicle.steady_state import turning_radius

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle


@dataclass(frozen=True)
class StartAutopilotSettings:
    """What an autopilot with start values asks of a vehicle: control period, allocation, guidance, safety."""

    #: Thrust from which a motor starts, as a share of that at its minimum revolutions: noise stays below it.
    start_share: float = 2.0
    stop_share: float = 0.2  #: Thrust at which it stops, by the same share: it stops late, and seldom.
    other_thruster_cost: float = 0.05  #: Cost of thrusters that do not drive, against those that do.
    #: Shortest control period, s, for which gains are made: the design samples the vehicle's motion.
    shortest_period_s: float = 0.005
    longest_period_s: float = 1.0  #: Longest control period, s.
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


SETTINGS = StartAutopilotSettings()

LAWS = ("pid", "lqr")


def start_autopilot(vehicle: Vehicle, *, law: str = "pid", period_s: float = 0.1) -> str:
    """TOML text of an autopilot file with start values for a vehicle, the reasons as comments.

    Parameters
    ----------
    vehicle : Vehicle
    law : str
        Control law: ``pid``, decoupled loops, or ``lqr``, all of a mode at once.
    period_s : float
        Control period, s.

    Raises
    ------
    VehicleError
        The vehicle cannot be steered, or law or period are none.

    Examples
    --------
    >>> import seatrial as st
    >>> text = st.start_autopilot(st.Vehicle.load("lauv"))
    >>> [mode["name"] for mode in st.Autopilot.from_toml(text).modes]
    ['cruise']
    """
    if law not in LAWS:
        raise VehicleError(f"law: expected pid or lqr, found {law!r}")
    least, most = SETTINGS.shortest_period_s, SETTINGS.longest_period_s
    if not least <= period_s <= most:
        raise VehicleError(
            f"period_s: expected a control period from {least:g} to {most:g} s, found {period_s:g}"
        )
    try:
        with one_blas_thread():
            text = autopilot_text(vehicle, start_gains(vehicle, period_s=period_s))
            return lqr_autopilot(vehicle, text) if law == "lqr" else text
    except ValueError as error:
        raise VehicleError(f"{vehicle.name}: no autopilot can be made: {error}") from None


def autopilot_text(vehicle: Vehicle, start: StartGains) -> str:
    """TOML text of the autopilot file of some start values."""
    import tomlkit

    notes = [f"Start values for {vehicle.name}, computed from its model; tune them before they fly at sea."]
    notes += [f"No {LOOP_OF[row]} loop: {why}." for row, why in start.left_out.items()]
    notes += [f"Weak: {place}: little margin or much overshoot; keep away from it." for place in start.weak]
    if start.modes[0].depth_by == "pitch":
        notes.append(
            f"Below {start.speeds_m_s[0]:.2g} m/s through the water the vehicle is not level: plan a higher"
            " speed."
        )
    body = commented(tomlkit.dumps(_tables(vehicle, start)), _reasons(vehicle, start))
    return "".join(f"# {note}\n" for note in notes) + body


def commented(text: str, reasons: Mapping[tuple[str, str], str]) -> str:
    """TOML text with a comment beside each (table, key) that is there, a table within it included."""
    lines, table = [], ""
    for line in text.splitlines():
        header = line.startswith("[")
        if header:
            table = line.strip("[]")
        outer, _, inner = table.rpartition(".")
        why = reasons.get((outer, inner) if header else (table, line.partition(" = ")[0]))
        lines.append(f"{line} # {why}" if why else line)
    return "\n".join(lines) + "\n"


def _tables(vehicle: Vehicle, start: StartGains) -> dict[str, Any]:
    """Tables of the autopilot file of some start values, as nested dictionaries."""
    tables: dict[str, Any] = {
        "format": 1,
        "name": f"{vehicle.name} start",
        "description": started_for(vehicle.name),
        "period_s": start.period_s,
        "control": "pid",
        "schedule": {"speeds_m_s": [round(u, 3) for u in start.speeds_m_s]},
        "modes": [_mode(vehicle, mode) for mode in start.modes],
        "loops": {name: _loop(loop) for name, loop in start.loops.items()},
        "feed_forward": {"restoring": True, "drag": True, "acceleration": True},
        "guidance": guidance(vehicle, start)[0],
    }
    if allocation := _allocation(vehicle, start):
        tables["allocation"] = allocation
    tables["safety"] = safety(vehicle, start)
    return tables


def _allocation(vehicle: Vehicle, start: StartGains) -> dict[str, Any]:
    """Table of the allocation: what differs from the core's defaults."""
    facts = vehicle.actuator_info()
    table: dict[str, Any] = {}
    if any(of["kind"] == "fin" for of in facts.values()):
        table["fin_inflow"] = False
    if any(float(of["minimum_ahead"]) > 0.0 for of in facts.values()):
        table |= {"start_share": SETTINGS.start_share, "stop_share": SETTINGS.stop_share}
        cruising = start.modes[-1].actuators
        others = tuple(name for name in vehicle.actuators if name not in cruising) if cruising else ()
        if others:
            table["weights"] = dict.fromkeys(_grouped(vehicle, others), SETTINGS.other_thruster_cost)
    return table


def _reasons(vehicle: Vehicle, start: StartGains) -> Mapping[tuple[str, str], str]:
    """Comments beside table and key."""
    late = guidance(vehicle, start)[1]
    reasons = {
        ("schedule", "speeds_m_s"): "95 % of the reachable range",
        ("guidance", "lookahead_m"): f"2 U tau; the course follows {late['heading']:.2g} s late",
        ("guidance", "integral_gain_m_s"): "U/4: critically damped",
        ("guidance", "turn_speed_share"): "turns on the spot: no waypoint is missed in a bend",
        ("guidance", "turn_radius_m"): "the turning circle at cruising speed",
        ("guidance", "turn_delay_s"): "half of the course's delay",
        ("guidance", "acceleration_max_m_s2"): "a quarter of the thrust, or 4 s to cruising speed",
        (
            "allocation",
            "fin_inflow",
        ): "fins steady the hull by themselves; following a noisy inflow they shake it",
        ("allocation", "weights"): "vertical thrusters do not leave heave to propellers near their minimum",
        ("allocation", "start_share"): "noise stays below it and starts no motor",
        ("allocation", "stop_share"): "below the minimum revolutions: stops late, and seldom",
        ("safety", "stale_velocity"): "a Doppler log without bottom echoes for 10 s is no failure yet",
        ("safety", "surface_speed_m_s"): "fins need it",
        ("safety", "stale_depth"): "heavier than water: with all stopped it would sink",
        ("safety", "depth"): "if it dives against its planes, stop: buoyancy brings it up",
        ("safety", "actuator"): "the rest may not suffice: half of the planes cannot hold the bow up",
    }
    if "pitch" in late:
        reasons["guidance", "lookahead_vertical_m"] = f"the same, {late['pitch']:.2g} s late"
        reasons["guidance", "pitch_max_deg"] = "half of the reach holds it, at most 20"
    return reasons


def _mode(vehicle: Vehicle, mode: Mode) -> dict[str, Any]:
    row: dict[str, Any] = {"name": mode.name, "loops": list(mode.loops), "depth_by": mode.depth_by}
    if mode.from_speed_m_s is not None:
        row["from_speed_m_s"] = three_digits(mode.from_speed_m_s)
        row["hysteresis_m_s"] = three_digits(0.15 * mode.from_speed_m_s)
    if mode.actuators is not None:
        row["actuators"] = _grouped(vehicle, mode.actuators)
    return row


def _grouped(vehicle: Vehicle, names: tuple[str, ...]) -> list[str]:
    """Groups where all their actuators are named, and names."""
    facts = vehicle.actuator_info()
    grouped: list[str] = []
    for name in names:
        group = str(facts[name]["group"])
        whole = group and all(other in names for other in vehicle.actuators if facts[other]["group"] == group)
        if (group if whole else name) not in grouped:
            grouped.append(group if whole else name)
    return grouped


def _loop(loop: LoopStart) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for key, values in (
        ("K_P", [gain.k_p for gain in loop.gains]),
        ("K_I_per_s", [gain.k_i for gain in loop.gains]),
        ("K_D_s", [gain.k_d for gain in loop.gains]),
    ):
        rounded = [three_digits(value) for value in values]
        if any(rounded):
            table[key] = rounded[0] if len(set(rounded)) == 1 else rounded
    table["tau_max"] = three_digits(loop.tau_max)
    table["anti_windup"] = "back-calculation"
    table["reference_rad_s"] = three_digits(loop.reference_rad_s)
    return table


_WAY = {"heading": ((3, 1.0), (5, 1.0)), "pitch": ((2, 1.0), (6, -1.0))}
"""Angle of the course: the angle that is controlled, and the cross-flow over the speed with its sign."""


def lookahead(
    vehicle: Vehicle,
    flight: tuple[Mode, float, dict[str, LoopGain], dict[str, Delay]],
    loop: str,
    reference_rad_s: float,
    period_s: float,
) -> tuple[float, float]:
    """Lookahead distance in m of "heading" or "pitch", and the delay in s that it is made for, of a
    ``flight``: mode, speed in m/s, gains of its loops there, delays of its rows.
    """
    tau = _delay_at_crossover(*_followed(vehicle, flight, loop, period_s), reference_rad_s)
    return SETTINGS.lookahead_delays * flight[1] * tau, tau


def _followed(
    vehicle: Vehicle,
    flight: tuple[Mode, float, dict[str, LoopGain], dict[str, Delay]],
    loop: str,
    period_s: float,
) -> tuple[Sampled, tuple[Array, Array], tuple[str, float, float]]:
    """System, laws and loop of `following_delay` for a flight of `lookahead`."""
    mode, speed, gains, late = flight
    rows = rows_of(mode.loops)
    at = mode_trim(vehicle, speed, mode)
    system = sampled(
        plant(vehicle, at, mode.loops, motion=SETTINGS.correction_m_s), late, period_s, mode.loops
    )
    own = law({name: gains[name] for name in mode.loops}, speed)
    inertia = float(np.asarray(vehicle.mass_matrix())[LOOPS.index(loop), LOOPS.index(loop)])
    return system, (own, own + restoring_law(vehicle, rows)), (loop, speed, inertia)


def lookahead_of(
    vehicle: Vehicle, autopilot: Autopilot, loop: str, speed: float, *, late_s: Mapping[str, float]
) -> tuple[float, float]:
    """Lookahead distance in m and delay of the course in s that go with an autopilot's own gains, of a loop
    ("heading" or "pitch") at a speed in m/s with the age of the measurements per loop in s.

    Examples
    --------
    >>> import seatrial as st
    >>> cwolf, autopilot = st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf")
    >>> distance, tau = lookahead_of(cwolf, autopilot, "heading", 1.951, late_s={})
    >>> abs(distance - autopilot.gains()["guidance.lookahead_m"]) < 0.1
    True
    """
    tau = _delay_at_crossover(*_followed_by(vehicle, autopilot_facts(autopilot), loop, speed, late_s))
    return SETTINGS.lookahead_delays * speed * tau, tau


def least_lookahead_of(vehicle: Vehicle, facts: AutopilotFacts, loop: str, speed: float) -> float:
    """The shortest lookahead in m behind which an autopilot's own gains keep a path at a speed, m/s; zero
    where any does.
    """
    return least_lookahead(path_loop(*_followed_by(vehicle, facts, loop, speed, {})))


def _followed_by(
    vehicle: Vehicle, facts: AutopilotFacts, loop: str, speed: float, late_s: Mapping[str, float]
) -> tuple[Sampled, tuple[Array, Array], tuple[str, float, float], float]:
    """System, laws, loop and reference of `following_delay` for an autopilot's own gains."""
    mode = mode_at(facts, speed).name
    at = mode_loop(vehicle, facts, mode, speed, measured_late_s=late_s, motion=SETTINGS.correction_m_s)
    own = mode_law(facts, mode, at.loops, speed)
    inertia = float(np.asarray(vehicle.mass_matrix())[LOOPS.index(loop), LOOPS.index(loop)])
    reference = facts.loops[loop].get("reference_rad_s") or np.inf
    return at.system, (own, own + at.known), (loop, speed, inertia), reference


def _delay_at_crossover(
    system: Sampled, laws: tuple[Array, Array], loop: tuple[str, float, float], reference_rad_s: float
) -> float:
    """Delay of the course in s at the crossover of a line of sight that is made for this delay."""
    tau = 3.0 / reference_rad_s + system.period_s
    for _ in range(SETTINGS.delay_rounds):
        late = following_delay(system, laws, loop, reference_rad_s, 1.0 / (SETTINGS.lookahead_delays * tau))
        tau = max(0.5 * tau + 0.5 * late, system.period_s)
    return tau


def following_delay(
    system: Sampled,
    laws: tuple[Array, Array],
    loop: tuple[str, float, float],
    reference_rad_s: float,
    omega: float,
) -> float:
    """Delay in s at omega (rad/s) from the angle that guidance asks for to that of the course. ``laws`` are
    without and with the feed-forward, ``loop`` its name, speed in m/s and inertia, which is fed forward.
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
    """Open loop of the line of sight for a lookahead of one metre, complex, over `PATH_RAD_S`: ``U/(j w) F(j
    w) G(j w)`` with the reference filter ``F`` and the course ``G``. Parameters are those of
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
    cruise = SETTINGS.cruise_share * start.top_m_s[1]
    mass = float(np.asarray(vehicle.mass_matrix())[0, 0])
    length = vehicle.geometry().get("length", 1.0)
    mode = next(m for m in start.modes if flies(m, start.modes, cruise))
    by_pitch = mode.depth_by == "pitch"
    surge, heading = start.loops["surge"], start.loops["heading"]
    turn = _steady_turn(vehicle, cruise, SETTINGS.demand_share * heading.tau_max)
    tightest = 0.0 if "heave" in start.loops else _tightest(vehicle, start)
    circle = 1.5 * cruise / max(min(turn, np.deg2rad(SETTINGS.turn_rate_max_deg_s)), 1e-3)
    table: dict[str, Any] = {"method": "integral"}
    late: dict[str, float] = {}
    for key, loop in (("lookahead_m", "heading"), ("lookahead_vertical_m", "pitch")):
        if loop == "heading" or by_pitch:
            distance, late[loop] = _lookahead(vehicle, start, mode, loop)
            table[key] = _widened(vehicle, start, loop, max(distance, SETTINGS.lookahead_lengths * length))
    hold = min(0.2 * float(np.median([gain.bandwidth for gain in surge.gains])), 0.2)
    table |= {
        "lookahead_speed_m_s": start.speeds_m_s[_nearest(start, cruise)],
        "integral_gain_m_s": INTEGRAL_SHARES["cross_track"] * cruise,
        "integral_gain_vertical_m_s": INTEGRAL_SHARES["depth"] * cruise,
        "speed_max_m_s": 0.9 * start.speeds_m_s[-1],
        "acceleration_max_m_s2": min(
            0.5 * SETTINGS.demand_share * surge.tau_max / mass, cruise / SETTINGS.speed_up_s
        ),
        "turn_rate_max_deg_s": float(min(SETTINGS.turn_rate_max_deg_s, np.rad2deg(turn))),
        "loiter_radius_m": max(SETTINGS.loiter_radius_min_m, circle, SETTINGS.loiter_radius_ratio * tightest),
        "hold_gain_per_s": hold,
    }
    if "sway" not in start.loops:  # else it slows down and turns on the spot
        table["turn_radius_m"] = turning_radius(vehicle, cruise) or cruise / np.deg2rad(
            SETTINGS.turn_rate_max_deg_s
        )
        table["turn_delay_s"] = SETTINGS.turn_delay_share * late["heading"]
    if "heave" in start.loops:
        radius = float(np.clip(length, 0.5, SETTINGS.hold_radius_max_m))
        table |= {"hold_radius_m": radius, "watch_radius_m": SETTINGS.watch_radius_ratio * radius}
        table["depth_rate_max_m_s"] = steady_speed(
            vehicle, np.zeros(6), 2, SETTINGS.demand_share * start.loops["heave"].tau_max
        )
        if "sway" in start.loops:
            table["turn_speed_share"] = SETTINGS.turn_speed_share
        else:
            table["weathervane_gain_rad_m"] = SETTINGS.weathervane_ratio * hold
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
    """The lookahead distance in m, longer where the path's loop would come close to -1 at some speed. It
    holds for the cruising speed, shrinks below it to a half at the least and stays above it.
    """
    cruise = start.speeds_m_s[_nearest(start, SETTINGS.cruise_share * start.top_m_s[1])]
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
    close = np.flatnonzero(apart < SETTINGS.least_distance)
    return float(distances[min(close[-1] + 1, len(distances) - 1)]) if len(close) else 0.0


def _lookahead(vehicle: Vehicle, start: StartGains, mode: Mode, loop: str) -> tuple[float, float]:
    """Lookahead distance in m of a loop at the cruising speed, and the delay of the course in s."""
    k = _nearest(start, SETTINGS.cruise_share * start.top_m_s[1])
    flight = mode, start.speeds_m_s[k], {name: of.gains[k] for name, of in start.loops.items()}, start.late
    return lookahead(vehicle, flight, loop, start.loops[loop].reference_rad_s, start.period_s)


def _nearest(start: StartGains, speed: float) -> int:
    """Index of the breakpoint nearest to a speed."""
    return int(np.argmin(np.abs(np.array(start.speeds_m_s) - speed)))


def _largest_pitch(vehicle: Vehicle, start: StartGains, speed: float) -> float:
    """Pitch in deg that half of the reach holds against the righting moment at a speed, at most 20."""
    rows = "".join(row for row in ROWS if row not in start.left_out and row != "Z")
    low, high = reach(vehicle, speed, rows)["M"]
    angles = np.deg2rad(np.arange(1.0, SETTINGS.pitch_max_deg + 0.5))
    attitude = np.stack([0.0 * angles, angles, 0.0 * angles], axis=1)
    righting = np.asarray(vehicle.forces(np.zeros((len(angles), 6)), attitude)["restoring"])[:, 4]
    holdable = np.abs(righting) <= SETTINGS.pitch_reach_share * min(high, -low)
    return float(np.rad2deg(angles[holdable][-1])) if holdable.any() else 1.0


def _steady_turn(vehicle: Vehicle, speed: float, moment: float) -> float:
    """Turning rate in rad/s at which damping balances a yaw moment, the hull not drifting."""
    return steady_speed(vehicle, np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), 5, moment)


def steady_speed(vehicle: Vehicle, nu: Array, axis: int, force: float) -> float:
    """Velocity of an axis (place in nu) in m/s or rad/s at which damping balances a force in N or N m, up to
    2.
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
        table["surface_speed_m_s"] = three_digits(SETTINGS.surfacing_speed_ratio * start.speeds_m_s[0])
    table["stale_velocity"] = {"after_s": SETTINGS.stale_velocity_s, "reaction": "surface"}
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
        if len(values) < len(rows) or values[-1] < SETTINGS.rank_share * values[0]:
            irreplaceable.append(name)
    return tuple(irreplaceable)
