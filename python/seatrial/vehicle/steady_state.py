"""Steady motion: speed against revolutions, power, endurance and range, turns by thrusters.

All of it is simulated with the whole chain until nothing changes any more. Ahead, thrust and drag balance,
tau_X(n, u) + X(u) = 0 with the other axes held. Endurance is the battery over hotel load and propulsion, both
at the bus; the range is speed times endurance, in still water. A turn is in the horizontal plane: roll, pitch
and heave are held. Held by ``tests/vehicle/test_performance.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import DivergenceError, VehicleError
from seatrial.vehicle.actuators import (
    NOMINAL_V,
    ROWS,
    can_push,
    command,
    commandable,
    largest,
    settling_s,
    thrusts,
    voltage_for,
)
from seatrial.vehicle.stability import positive_damping

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seatrial._core import Vehicle

_PULL = "k_tether"


@dataclass(frozen=True)
class SteadyStateSettings:
    """When a motion counts as steady, and which speeds and turns are tabled."""

    #: Length of a round, s: a vehicle settles within minutes; the last tenth of a round is judged.
    round_s: float = 240.0
    sample_s: float = 0.25  #: Time between two samples, s.
    most_rounds: int = 10  #: Rounds after which a motion counts as not settling: 40 minutes.
    #: Change over the last tenth of a round up to which a motion is steady, m/s and rad/s.
    steady_change: float = 1e-6
    #: Fastest speed, m/s, with a margin over underwater vehicles: above it, damping or thrust has a wrong
    #: size.
    fastest_m_s: float = 15.0
    #: Shares of the largest command: the rows of a table of speeds.
    speed_shares: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8, 1.0)
    #: Shares of the largest command: the rows of a table of turns.
    turn_shares: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0)
    drives_share: float = 0.3  #: Share of its thrust along x from which an actuator drives ahead.
    #: Round steps of speeds, kn; the first one that gives fewer than eight rows is taken.
    steps_kn: tuple[float, ...] = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0)
    #: Difference of thrust and drag, as a share of the drag, that the bisection leaves: more was not reached.
    balanced_share: float = 1e-6
    fin_turn_share: float = 0.5  #: Share of the largest angle and thrust of a turn by fins.
    steers_share: float = 0.5  #: Share of its moment about z from which a fin steers.
    turn_s: float = 120.0  #: Time within which the tightest turn settles, s.
    turn_samples: int = 241  #: Samples of that turn: one each half second.
    straight_rad_s: float = 1e-6  #: Turn rate up to which a vehicle goes straight, rad/s.
    #: Turn rate at the start, rad/s: an exact balance of an unstable hull does not stay straight.
    first_rate_rad_s: float = 1e-3


SETTINGS = SteadyStateSettings()


@dataclass(frozen=True)
class Steady:
    """Velocities (6,) in m/s and rad/s, wrench (6,) in N and N m, and actuators in their own unit.

    Where the motion never settles (``settled`` is false) they are means over the last 24 s.
    """

    nu: Array
    tau: Array
    actuators: dict[str, float]
    settled: bool


def without_pull(vehicle: Vehicle) -> Vehicle:
    """The vehicle on a tether that never becomes taut: itself where it has no spring."""
    return vehicle.with_coefficients({_PULL: 0.0}) if vehicle.coefficients().get(_PULL) else vehicle


def steady(
    vehicle: Vehicle,
    commands: Mapping[str, float],
    *,
    free: str,
    voltage_v: float,
    nu: ArrayLike = (0.0,) * 6,
) -> Steady:
    """Motion that the vehicle settles into under steady commands, the other axes held.

    A tether drags, and does not pull: a vehicle at its end settles into no motion.

    `commands`: in the actuators' own units; neutral where absent; `free`: axes that move, letters of XYZKMN;
    the others keep their initial velocity; `voltage_v`: supply voltage at which tables of thrust are read, V;
    `nu`: initial velocities, m/s and rad/s.

    Examples
    --------
    >>> import seatrial as st
    >>> ahead = dict.fromkeys(["SbU", "SbL", "PU", "PL"], 1000.0)
    >>> round(float(steady(st.Vehicle.load("cwolf"), ahead, free="X", voltage_v=14.8).nu[0]), 2)
    1.55
    """
    from seatrial._core import State

    # A stretched tether would end every motion at its length.
    vehicle = without_pull(vehicle)
    t = np.arange(0.0, SETTINGS.round_s, SETTINGS.sample_s)
    inputs: dict[str, ArrayLike] = {name: np.full(len(t), value) for name, value in commands.items()}
    state = State(nu=nu)
    for _ in range(SETTINGS.most_rounds):
        try:
            run = vehicle.simulate(t, inputs, state, free=free, voltage_v=voltage_for(vehicle, t, voltage_v))
        except DivergenceError:
            nothing = np.full(6, np.nan)
            return Steady(nothing, nothing, dict.fromkeys(commands, math.nan), settled=False)
        last = np.asarray(run.nu)[-len(t) // 10 :]
        signals = {name: float(np.asarray(y)[-1]) for name, y in run.actuators.items()}
        settled = bool(np.ptp(last, axis=0).max() < SETTINGS.steady_change)
        if settled:
            break
        # The next round goes on from here, back at the origin.
        state = State(attitude=run.attitude[-1], nu=last[-1], actuators=dict(signals))
    wrench = np.asarray(run.tau)[-len(last) :]
    if settled:
        return Steady(last[-1], wrench[-1], signals, settled)
    # A motion that keeps swinging is shown by its mean.
    return Steady(last.mean(axis=0), wrench.mean(axis=0), signals, settled)


KNOT_M_S = 1852.0 / 3600.0  # a nautical mile an hour, by definition

TURN_KINDS = {
    "under way": 0.5,
    "inner side stopped": 0.0,
    "inner side half astern": -0.5,
    "on the spot": -1.0,
}
"""Command of the inner side as a share of the outer side's."""


@dataclass(frozen=True)
class Speed:
    """Steady speed ahead on a straight course; power, endurance and range where they are known.

    ``command`` is the step from neutral in ``unit``; thrust is along x in N at that speed, power that of the
    actuators in W, without the hotel load.
    """

    command: float
    unit: str
    speed_m_s: float
    thrust_n: float
    power_w: float | None
    endurance_h: float | None

    @property
    def speed_kn(self) -> float:
        """Speed in knots."""
        return self.speed_m_s / KNOT_M_S

    @property
    def range_km(self) -> float | None:
        """Distance until the battery is empty."""
        return None if self.endurance_h is None else 3.6 * self.speed_m_s * self.endurance_h


@dataclass(frozen=True)
class Turn:
    """A steady turn to starboard in the horizontal plane; the radius is of the path of O.

    ``command`` and ``inner`` are the steps from neutral of outer and inner side in ``unit``, ``share`` the
    outer one over its largest; ``speed_m_s`` is that along the circle.
    """

    kind: str
    share: float
    command: float
    inner: float
    unit: str
    radius_m: float
    rate_deg_s: float
    speed_m_s: float


def drivers(vehicle: Vehicle) -> dict[str, float]:
    """Actuators that drive ahead, with the sense (+1, -1) in which they do."""
    matrix = np.asarray(vehicle.allocation_matrix())
    sizes = np.linalg.norm(matrix[:3], axis=0)
    return {
        name: float(np.sign(matrix[0, k]))
        for k, name in enumerate(vehicle.actuators)
        if abs(matrix[0, k]) > SETTINGS.drives_share * max(sizes[k], 1e-12)
    }


def speeds(
    vehicle: Vehicle, *, voltage_v: float = NOMINAL_V, shares: Sequence[float] = SETTINGS.speed_shares
) -> tuple[Speed, ...]:
    """Steady speeds at shares of the largest command, all that drive ahead together; empty if none does.

    Shares at which the speed grows beyond all bounds are left out.
    """
    rows = []
    for share in shares if drivers(vehicle) else ():
        run = steady(vehicle, _ahead(vehicle, share), free="X", voltage_v=voltage_v)
        if not np.isfinite(run.nu).all():
            continue
        rows.append(_row(vehicle, share, float(run.nu[0]), float(run.tau[0]), run.actuators))
    return tuple(rows)


def top_speed(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> Speed | None:
    """Steady speed ahead at the largest command; None where nothing drives ahead, or it has no bounds."""
    return next(iter(speeds(vehicle, voltage_v=voltage_v, shares=(1.0,))), None)


def refuse_impossible_speed(vehicle: Vehicle, rows: Sequence[Speed]) -> None:
    """Refuse a vehicle that its thrust drives faster than any underwater vehicle goes.

    Raises `VehicleError`: its damping is missing or far too small, or its thrust far too large.
    """
    top = max(rows, key=lambda row: row.speed_m_s, default=None)
    # Damping of the wrong sign is said coefficient by coefficient, with the rest of the check.
    runaway = top is None and bool(drivers(vehicle)) and not positive_damping(vehicle)
    if not runaway and (top is None or top.speed_m_s <= SETTINGS.fastest_m_s):
        return
    known, fastest = vehicle.coefficients(), SETTINGS.fastest_m_s
    damping = ", ".join(f"{name} = {known.get(name, 0.0):g}" for name in ("X_u", "X_uu"))
    raise VehicleError(
        f"{vehicle.name}: top speed {'without bounds' if top is None else f'{top.speed_m_s:.3g} m/s'} against"
        f" {damping}: faster than any underwater vehicle ({fastest:g} m/s); give X_u and X_uu, or"
        ' [geometry] with shape = "spheroid", "box" or "frame", from which they are filled; else correct the'
        " thrust (N, and p1 in revolutions per second)"
    )


def unbounded(vehicle: Vehicle) -> str:
    """Sentence on a vehicle whose actuators drive it faster and faster, with the damping to look at."""
    wrong = [f"{name} = {value:+.4g}" for name, value in positive_damping(vehicle).items()]
    damping = f"; damping is negative, found {', '.join(wrong)}" if wrong else "; check its damping"
    return (
        f"{vehicle.name} reaches no steady speed at its largest commands: it grows beyond all bounds{damping}"
    )


def farthest(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> Speed | None:
    """Steady speed ahead at which a battery goes farthest; None where power or battery are not known.

    The best of twenty commands, then a bounded search between its neighbours.
    """
    from scipy.optimize import minimize_scalar

    def at(share: float) -> Speed:
        return speeds(vehicle, voltage_v=voltage_v, shares=(share,))[0]

    def loss(share: float) -> float:
        return -(at(share).range_km or 0.0)

    top = top_speed(vehicle, voltage_v=voltage_v)
    if top is None or top.range_km is None:
        return None
    coarse = [0.05 * k for k in range(1, 21)]
    best = coarse[int(np.argmin([loss(share) for share in coarse]))]
    near = (max(best - 0.05, 1e-3), min(best + 0.05, 1.0))
    refined = float(minimize_scalar(loss, bounds=near, method="bounded", options={"xatol": 1e-4}).x)
    return at(min((best, refined), key=loss))


def cruise(vehicle: Vehicle, speed_m_s: float, *, voltage_v: float = NOMINAL_V) -> Speed | None:
    """What it takes to run ahead at a speed through the water; None where it is too fast or slow to be held.

    The command at which thrust and drag of the vehicle, held at that speed, balance, by bisection. Tables of
    thrust are read at `voltage_v`, V.

    Examples
    --------
    >>> import seatrial as st
    >>> round(cruise(st.Vehicle.load("cwolf"), 3.0 * KNOT_M_S).command)
    994
    """
    if not drivers(vehicle):
        return None
    nu = [speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0]
    drag = -float(sum(np.asarray(force)[0] for force in vehicle.forces(nu, np.zeros(3)).values()))

    def held(share: float) -> tuple[float, dict[str, float]]:
        from seatrial._core import State

        t = np.linspace(0.0, settling_s(vehicle), 41)
        commands: dict[str, ArrayLike] = {
            name: np.full(len(t), value) for name, value in _ahead(vehicle, share).items()
        }
        voltage = voltage_for(vehicle, t, voltage_v)
        run = vehicle.simulate(t, commands, State(nu=nu), free="", voltage_v=voltage, max_step_s=0.05)
        signals = {name: float(np.asarray(y)[-1]) for name, y in run.actuators.items()}
        return float(np.asarray(run.tau)[-1, 0]), signals

    low, high = 0.0, 1.0
    if held(high)[0] < drag:
        return None
    # Thrust rises with the command, but jumps at a dead band: bisection needs no slope.
    while high - low > 1e-12:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if held(middle)[0] < drag else (low, middle)
    thrust, signals = held(high)
    # The drag lies within a jump, as below the least revolutions: no command holds this speed.
    if abs(thrust - drag) > SETTINGS.balanced_share * max(abs(drag), 1e-9):
        return None
    return _row(vehicle, high, speed_m_s, thrust, signals)


def round_speeds_kn(top_kn: float) -> list[float]:
    """Round speeds in kn up to the top speed, at most seven."""
    step = next((s for s in SETTINGS.steps_kn if top_kn / s < 8.0), SETTINGS.steps_kn[-1])
    return [step * k for k in range(1, min(int(top_kn / step), 7) + 1)]


def turning_senses(vehicle: Vehicle) -> dict[str, float]:
    """Yaw moment per newton ahead of every actuator that drives; empty where not both sides drive."""
    driving = drivers(vehicle)
    matrix = np.asarray(vehicle.allocation_matrix())
    yaw = {name: driving[name] * float(matrix[5, vehicle.actuators.index(name)]) for name in driving}
    strongest = max((abs(moment) for moment in yaw.values()), default=0.0)
    return yaw if strongest > 1e-3 and min(yaw.values()) < 0.0 < max(yaw.values()) else {}


def turn_commands(vehicle: Vehicle, outer: float, inner: float, *, side: float = 1.0) -> dict[str, float]:
    """Commands for shares of the largest on both sides; the turn is to starboard (side 1) or port (-1)."""
    driving, facts = drivers(vehicle), vehicle.actuator_info()
    return {
        name: command(facts[name], (outer if side * moment > 0.0 else inner) * driving[name])
        for name, moment in turning_senses(vehicle).items()
    }


def turn_kinds(vehicle: Vehicle) -> dict[str, float]:
    """Those of `TURN_KINDS` that the vehicle can do; inner sides astern need actuators that drive astern."""
    if not turning_senses(vehicle):
        return {}
    facts = vehicle.actuator_info()
    astern = all(can_push(facts[name], -sense) for name, sense in drivers(vehicle).items())
    return {kind: ratio for kind, ratio in TURN_KINDS.items() if ratio >= 0.0 or astern}


def turns(
    vehicle: Vehicle, *, voltage_v: float = NOMINAL_V, shares: Sequence[float] = SETTINGS.turn_shares
) -> tuple[Turn, ...]:
    """Steady turns by different thrust on both sides; empty where the actuators that drive cannot turn it.

    The outer side runs at shares of its largest command, the inner side at half of that, stopped, half
    astern or fully opposed; turns that never become steady are left out.
    """
    driving, facts = drivers(vehicle), vehicle.actuator_info()
    circles = []
    for kind, ratio in turn_kinds(vehicle).items():
        for share in shares:
            inner = ratio * share
            circle = _circle(vehicle, turn_commands(vehicle, share, inner), voltage_v)
            if circle is None:
                continue
            first = next(iter(driving))
            outer_step = share * largest(facts[first], driving[first])
            inner_step = inner * largest(facts[first], driving[first] * (1.0 if inner >= 0.0 else -1.0))
            circles.append(Turn(kind, share, outer_step, inner_step, str(facts[first]["unit"]), *circle))
    return tuple(circles)


def _circle(
    vehicle: Vehicle, commands: Mapping[str, float], voltage_v: float
) -> tuple[float, float, float] | None:
    """Radius in m, rate in deg/s and speed in m/s of a steady turn; None for one that swings, or none."""
    turn = steady(vehicle, commands, free="XYN", voltage_v=voltage_v)
    speed, rate = float(np.hypot(turn.nu[0], turn.nu[1])), float(turn.nu[5])
    if not turn.settled or abs(rate) < 1e-4:
        return None
    return speed / abs(rate), float(np.rad2deg(rate)), speed


def _ahead(vehicle: Vehicle, share: float) -> dict[str, float]:
    facts = vehicle.actuator_info()
    return {name: command(facts[name], share * sense) for name, sense in drivers(vehicle).items()}


def _row(vehicle: Vehicle, share: float, speed: float, thrust: float, signals: dict[str, float]) -> Speed:
    facts, driving = vehicle.actuator_info(), drivers(vehicle)
    first = next(iter(driving))
    step, power = share * largest(facts[first], driving[first]), _power(vehicle, signals)
    return Speed(step, str(facts[first]["unit"]), speed, thrust, power, _endurance(vehicle, power))


def _power(vehicle: Vehicle, revolutions: dict[str, float]) -> float | None:
    """Electrical power in W of all actuators at these revolutions per minute; None where it is not known."""
    facts = vehicle.actuator_info()
    total = 0.0
    for name, value in revolutions.items():
        turning = abs(value - float(facts[name]["neutral"])) > 1e-9
        factor = facts[name]["power_w_s3"]
        if turning and factor is None:
            return None
        total += float(factor or 0.0) * abs(value / 60.0) ** 3
    return total


def _endurance(vehicle: Vehicle, power_w: float | None) -> float | None:
    """Time in h until the battery is empty; None where power or battery are not known."""
    supply = vehicle.power()
    if power_w is None or not supply.get("battery_wh"):
        return None
    return float(supply["battery_wh"] / (power_w + supply.get("hotel_w", 0.0)))


@dataclass(frozen=True)
class FinTurn:
    """A steady turn to starboard by fins; the radius is of the path of O.

    ``fin_deg`` is the size of the fins' angle, ``command`` the step from neutral in ``unit`` of what drives
    ahead; ``speed_m_s`` is that along the circle.
    """

    fin_deg: float
    command: float
    unit: str
    radius_m: float
    rate_deg_s: float
    speed_m_s: float


def rudders(vehicle: Vehicle) -> dict[str, float]:
    """Movable fins that turn the vehicle, with the sense (+1, -1) of the command to starboard."""
    matrix, facts = np.asarray(vehicle.allocation_matrix()), vehicle.actuator_info()
    moments = {
        name: matrix[3:, k] for k, name in enumerate(vehicle.actuators) if facts[name]["kind"] == "fin"
    }
    return {
        name: float(np.sign(moment[2]))
        for name, moment in moments.items()
        if abs(moment[2]) > SETTINGS.steers_share * max(float(np.linalg.norm(moment)), 1e-12)
    }


def fin_turn(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> FinTurn | None:
    """Steady turn by the fins that steer; None without such fins, without drive, or where it never settles.

    Rudders are at half their largest angle, all that drives ahead is at half power; roll, pitch and heave are
    held.

    Tables of thrust are read at `voltage_v`, V.

    Examples
    --------
    >>> import seatrial as st
    >>> turn = fin_turn(st.Vehicle.load("lauv"))
    >>> 3.0 < turn.radius_m < 12.0
    True
    """
    steering, driving, facts = rudders(vehicle), drivers(vehicle), vehicle.actuator_info()
    if not steering or not driving:
        return None
    half = SETTINGS.fin_turn_share
    commands = {name: command(facts[name], half * sense) for name, sense in (driving | steering).items()}
    circle = _circle(vehicle, commands, voltage_v)
    if circle is None:
        return None
    first, fin = next(iter(driving)), next(iter(steering))
    angle = float(np.rad2deg(half * largest(facts[fin], steering[fin])))
    return FinTurn(angle, half * largest(facts[first], driving[first]), str(facts[first]["unit"]), *circle)


def turning_radius(vehicle: Vehicle, speed_m_s: float, *, voltage_v: float = NOMINAL_V) -> float | None:
    """Radius in m of the tightest circle at a speed ahead; None where it cannot turn and hold the speed.

    Thrusters give the largest yaw moment that leaves the thrust ahead and the other commanded rows as level
    flight needs them (a linear programme over what each actuator reaches, `seatrial.vehicle.actuators`),
    rudders are hard over in the flow as it is in the turn; sway and yaw then settle while the speed is held.

    The speed is through the water; tables of thrust are read at `voltage_v`, V.

    Examples
    --------
    >>> import seatrial as st
    >>> radius = turning_radius(st.Vehicle.load("remus100"), 1.5)
    >>> 2.0 < radius < 8.0
    True
    """
    from scipy.optimize import linprog

    from seatrial._core import State

    if not vehicle.actuators:
        return None
    missing = commandable(vehicle, speed_m_s, voltage_v=voltage_v)
    if "N" in missing:
        return None
    nu = np.array([speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
    drag = -float(sum(np.asarray(force)[0] for force in vehicle.forces(nu, np.zeros(3)).values()))
    matrix = np.asarray(vehicle.allocation_matrix())
    limits = list(map(tuple, thrusts(vehicle, speed_m_s, voltage_v=voltage_v)))
    # Rows that nothing commands cannot be asked for: the programme would have no solution.
    kept = [row for row in "XZKM" if row not in missing]
    demands = np.array([drag if row == "X" else 0.0 for row in kept])
    solution = linprog(
        -matrix[5], A_eq=matrix[[ROWS.index(row) for row in kept]], b_eq=demands, bounds=limits
    )
    if not solution.success or -solution.fun <= 0.0:
        return None
    facts, t = vehicle.actuator_info(), np.linspace(0.0, SETTINGS.turn_s, SETTINGS.turn_samples)
    hard_over = {
        name: np.full(len(t), command(facts[name], sense)) for name, sense in rudders(vehicle).items()
    }
    # Fins push by the flow of the turn itself, thrusters as the programme says.
    thrusting = np.array([facts[name]["kind"] != "fin" for name in vehicle.actuators])
    wrench = matrix @ np.where(thrusting, solution.x, 0.0)
    # Without a yaw rate the vehicle would stay on its straight course.
    nu[5] = SETTINGS.first_rate_rad_s
    tau, voltage = np.tile(wrench, (len(t), 1)), voltage_for(vehicle, t, voltage_v)
    run = without_pull(vehicle).simulate(t, hard_over, State(nu=nu), free="YN", tau=tau, voltage_v=voltage)
    u, v, *_, rate = np.asarray(run.nu)[-1]
    return float(np.hypot(u, v) / abs(rate)) if abs(rate) > SETTINGS.straight_rad_s else None
