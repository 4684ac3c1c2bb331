"""What actuators do and can do: pushes in words, limits and groups; reach, delay and coupling of each axis.

The force is the model's own, behind the whole chain from command to wrench: the vehicle is held (no axis
free) until the motor has settled, at rest for a thruster, in a steady flow from ahead for a fin. A sentence
per actuator shows a wrong sign before any trial.

The reach of a row of the wrench is the largest force or moment with the other rows of the autopilot at zero
and the surge force free: a linear programme over the actuators' thrust between their largest commands, taken
from the vehicle's own chain at a speed ahead. Held by ``tests/check/test_check.py`` and
``tests/control_design/test_control_design.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES

if TYPE_CHECKING:
    from seatrial._core import Vehicle

NOMINAL_V = 14.8
"""Supply voltage at which tables of thrust are read: four lithium cells."""


@dataclass(frozen=True)
class ActuatorSettings:
    """What an actuator counts for, and when actuators command a row of the wrench."""

    under_way_m_s: float = 1.5  #: Speed ahead at which a fin is judged, m/s.
    main_share: float = 0.5  #: Share of the largest force from which it is what an actuator mainly does.
    minor_share: float = 0.05  #: Share of the largest force below which it is not worth a word.
    #: Share of the largest entry of the allocation matrix from which a row counts as driven.
    driven_share: float = 0.02
    lever_m: float = 0.02  #: Lever of a force below which it counts as no turning moment, m.
    #: Wrench about O per newton, 1 and m, from which a thruster serves a row.
    direct_wrench: tuple[float, ...] = (0.5, 0.5, 0.5, 0.03, 0.03, 0.03)
    #: Share of what the strongest actuator gives from which an actuator counts for a row.
    part_share: float = 0.1
    ramp_share: float = 0.1  #: Share of the largest command that a small correction asks for.
    nothing_n: float = 1e-3  #: Force or moment that is nothing, N or N m.
    #: Singular value, as a share of the largest, below which actuators command nothing in practice.
    weak_share: float = 0.02


SETTINGS = ActuatorSettings()

_USUAL = {"rpm": 2000.0, "us": 400.0, "N": 100.0, "rad": 0.35}

_FORCES = (("ahead", "astern"), ("to starboard", "to port"), ("down", "up"))

# In the order of importance at the helm: heading, trim, heel.
_TURNS = (
    (5, "bow to starboard", "bow to port"),
    (4, "bow up", "bow down"),
    (3, "heel to starboard", "heel to port"),
)


@dataclass(frozen=True)
class Push:
    """Wrench (6,) in N and N m about O of one actuator for a command away from neutral.

    ``speed_m_s`` is the vehicle's speed ahead, zero for a thruster; a fin's wrench is what its deflection
    changes there.
    """

    actuator: str
    step: float
    unit: str
    wrench: tuple[float, ...]
    speed_m_s: float = 0.0

    @property
    def size(self) -> str:
        """The command as a person reads it: radians with degrees behind."""
        degrees = f" ({np.rad2deg(self.step):+.0f} deg)" if self.unit == "rad" else ""
        return f"{self.step:+g} {self.unit}{degrees}"

    @property
    def words(self) -> str:
        """Forces and turns in words: ``19 N ahead, bow to port``; what is minor follows."""
        forces = np.array(self.wrench[:3])
        largest = float(np.abs(forces).max(initial=0.0))
        turns = [
            (positive if self.wrench[axis] > 0.0 else negative, abs(self.wrench[axis]))
            for axis, positive, negative in _TURNS
        ]
        strongest = max(moment for _, moment in turns)
        if largest < 1e-9 and strongest < 1e-9:
            return "no force"
        spoken = [(axis, f) for axis, f in enumerate(forces) if abs(f) > SETTINGS.minor_share * largest]
        main = [_force(axis, f) for axis, f in spoken if abs(f) >= SETTINGS.main_share * largest]
        minor = [_force(axis, f) for axis, f in spoken if abs(f) < SETTINGS.main_share * largest]
        turning = [
            word
            for word, m in turns
            if m > SETTINGS.lever_m * largest and m >= 0.1 * strongest and strongest > 1e-9
        ]
        sentence = ", ".join(main + turning)
        return sentence + (f"; also {', '.join(minor)}" if minor else "")

    def __str__(self) -> str:
        way = f" at {self.speed_m_s:g} m/s" if self.speed_m_s else ""
        return f"{self.size} on {self.actuator}{way}: {self.words}"


def pushes(vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> tuple[Push, ...]:
    """What every actuator does at half its largest command, in the vehicle's order.

    A command above neutral, then one below; a direction that its motor does not have (largest command
    zero) is left out.
    """
    facts = vehicle.actuator_info()
    effects = []
    for name in vehicle.actuators:
        for sign in (1.0, -1.0):
            way = -sign if facts[name]["reversed"] else sign
            if not can_push(facts[name], way):
                continue
            step = sign * half(facts[name], way)
            commands = {name: facts[name]["neutral"] + step}
            speed = SETTINGS.under_way_m_s if facts[name]["kind"] == "fin" else 0.0
            wrench = bollard(vehicle, commands, voltage_v=voltage_v, speed_m_s=speed)
            if speed:
                wrench = wrench - bollard(vehicle, {}, voltage_v=voltage_v, speed_m_s=speed)
            effects.append(Push(name, step, facts[name]["unit"], tuple(map(float, wrench)), speed))
    return tuple(effects)


def bollard(
    vehicle: Vehicle, commands: Mapping[str, float], *, voltage_v: float = NOMINAL_V, speed_m_s: float = 0.0
) -> Array:
    """Wrench (6,) in N and N m about O after the motors have settled under steady commands.

    The vehicle is held at rest, or at a speed ahead.
    """
    from seatrial._core import State

    start = State(nu=[speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0])
    t = np.linspace(0.0, settling_s(vehicle), 101)
    inputs: dict[str, ArrayLike] = {name: np.full(len(t), value) for name, value in commands.items()}
    run = vehicle.simulate(t, inputs, start, free="", voltage_v=voltage_for(vehicle, t, voltage_v))
    wrench: Array = np.asarray(run.tau)[-1]
    return wrench


def settling_s(vehicle: Vehicle) -> float:
    """Time in s after which every motor follows its command, after a full reversal, too."""
    values, facts = vehicle.coefficients(), vehicle.actuator_info()
    times = [0.0]
    for name in vehicle.actuators:
        lags = 10.0 * max(values.get(f"{name}.T_1", 0.0), values.get(f"{name}.T_t", 0.0))
        rates = [rate for key in ("n_acc", "n_dec") if (rate := values.get(f"{name}.{key}", 0.0)) > 0.0]
        way = 2.0 * max(largest(facts[name], 1.0), largest(facts[name], -1.0))
        times.append(lags + (way / min(rates) if rates else 0.0))
    return 5.0 + max(times)


def voltage_for(vehicle: Vehicle, t: Array, voltage_v: float) -> Array | None:
    """Supply voltage (n,) where a table of the vehicle needs one."""
    needed = any(facts["needs_voltage"] for facts in vehicle.actuator_info().values())
    return np.full(len(t), voltage_v) if needed else None


def beyond_tables(vehicle: Vehicle, voltage_v: float) -> list[str]:
    """Sentence per table of thrust that does not reach to this supply voltage in V."""
    return [
        f"Supply: {voltage_v:g} V lies outside the {lowest:g} to {highest:g} V of the table {name},"
        " which is read at its edge"
        for name, (lowest, highest) in vehicle.table_voltages().items()
        if not lowest <= voltage_v <= highest
    ]


def actuator_groups(vehicle: Vehicle) -> dict[str, list[str]]:
    """Actuators of each group, in the vehicle's order; one without a group is its own."""
    groups: dict[str, list[str]] = {}
    facts = vehicle.actuator_info()
    for actuator in vehicle.actuators:
        groups.setdefault(str(facts[actuator]["group"]) or actuator, []).append(actuator)
    return groups


def pushed_axes(vehicle: Vehicle) -> str:
    """Letters of the axes ``XYZKMN`` that thrusters push directly; all where there is no actuator."""
    facts = vehicle.actuator_info()
    thrusters = [k for k, name in enumerate(vehicle.actuators) if facts[name]["kind"] != "fin"]
    if not vehicle.actuators:
        return "XYZKMN"
    matrix = np.abs(np.asarray(vehicle.allocation_matrix()).reshape(6, -1)[:, thrusters])
    rows = zip(AXES, matrix, SETTINGS.direct_wrench, strict=True)
    return "".join(axis for axis, row, least in rows if row.max(initial=0.0) >= least)


def fins_and_groups(vehicle: Vehicle) -> tuple[str, ...]:
    """Names of the fins, and of the groups that are made of fins."""
    facts = vehicle.actuator_info()
    fins = [name for name in vehicle.actuators if facts[name]["kind"] == "fin"]
    groups = [group for group, own in actuator_groups(vehicle).items() if set(own) <= set(fins)]
    return tuple(dict.fromkeys([*fins, *groups]))


def largest(facts: Mapping[str, Any], sign: float) -> float:
    """Largest step of a command away from neutral that pushes along (sign > 0) or against the direction.

    In its unit; a usual one where there is no limit. Of a reversed motor it is the command that changes sign.
    """
    limit = float(facts["maximum_ahead" if sign > 0.0 else "maximum_astern"])
    return limit if np.isfinite(limit) and limit > 0.0 else _USUAL[str(facts["unit"])]


def can_push(facts: Mapping[str, Any], sign: float) -> bool:
    """Whether the actuator pushes along (sign > 0) or against its direction: its largest step is not zero."""
    return float(facts["maximum_ahead" if sign > 0.0 else "maximum_astern"]) > 0.0


def half(facts: Mapping[str, Any], sign: float) -> float:
    """Half of `largest`, in two digits."""
    step = 0.5 * largest(facts, sign)
    digits = 1 - int(np.floor(np.log10(step)))
    return float(round(step, digits))


def command(facts: Mapping[str, Any], share: float) -> float:
    """Command for a share from -1 to 1 of the largest step; positive thrust is along the direction."""
    sense = -1.0 if facts["reversed"] else 1.0
    return float(facts["neutral"]) + sense * share * largest(facts, share)


def _force(axis: int, force: float) -> str:
    return f"{abs(force):.2g} N {_FORCES[axis][0 if force > 0.0 else 1]}"


def drivers(vehicle: Vehicle) -> dict[str, tuple[str, ...]]:
    """Actuators that drive an axis in the first place, by its letter; axes without any are absent.

    What drives it less than half as strongly does so aside: the stern thrusters of a torpedo trim it, its
    vertical ones lift it. Fins count however small their entry: their force grows with the speed.

    Examples
    --------
    >>> import seatrial
    >>> drivers(seatrial.Vehicle.load("cwolf"))["Z"]
    ('VTB', 'VTS')
    """
    allocation = np.abs(np.asarray(vehicle.allocation_matrix()))
    finned = any(facts["kind"] == "fin" for facts in vehicle.actuator_info().values())
    names_by_axis = {}
    for axis, row in zip(AXES, allocation, strict=True):
        most = float(row.max(initial=0.0))
        if most > (0.0 if finned else SETTINGS.driven_share * float(allocation.max(initial=0.0))):
            names_by_axis[axis] = tuple(
                name
                for name, entry in zip(vehicle.actuators, row, strict=True)
                if entry >= SETTINGS.main_share * most
            )
    return names_by_axis


ROWS = AXES
"""Rows of the wrench."""

LOOPS = ("surge", "sway", "heave", "roll", "pitch", "heading")
"""The loop of each row of the wrench."""


@dataclass(frozen=True)
class Delay:
    """How late a row of the wrench follows its demand, s: lag, dead time, ramp of a small correction."""

    lag_s: float
    dead_s: float
    ramp_s: float

    @property
    def total_s(self) -> float:
        """Sum of the three: the phase that it costs at low frequencies, in s."""
        return self.lag_s + self.dead_s + self.ramp_s


def thrusts(vehicle: Vehicle, speed_m_s: float, *, voltage_v: float = NOMINAL_V) -> Array:
    """Smallest and largest thrust (actuators, 2) in N along each actuator's column, at a speed ahead.

    A fin's thrust is its force along the normal beyond that at neutral.
    """
    matrix, facts = np.asarray(vehicle.allocation_matrix()), vehicle.actuator_info()
    limits = np.zeros((len(vehicle.actuators), 2))
    idle = bollard(vehicle, {}, voltage_v=voltage_v, speed_m_s=speed_m_s)
    for k, name in enumerate(vehicle.actuators):
        direction = matrix[:3, k] / max(float(matrix[:3, k] @ matrix[:3, k]), 1e-12)
        rest = idle[:3] if facts[name]["kind"] == "fin" else _others(vehicle, name, speed_m_s, voltage_v)
        reached = [0.0]
        for share in (-1.0, 1.0):
            if can_push(facts[name], share):
                commands = {name: command(facts[name], share)}
                wrench = bollard(vehicle, commands, voltage_v=voltage_v, speed_m_s=speed_m_s)
                reached.append(float(direction @ (wrench[:3] - rest)))
        limits[k] = min(reached), max(reached)
    return limits


def _others(vehicle: Vehicle, name: str, speed_m_s: float, voltage_v: float) -> Array:
    """Force (3,) in N of all other actuators at neutral: fins in the flow."""
    if not any(facts["kind"] == "fin" for facts in vehicle.actuator_info().values()):
        return np.zeros(3)
    return bollard(vehicle, {}, voltage_v=voltage_v, speed_m_s=speed_m_s)[:3]


def reach(vehicle: Vehicle, speed_m_s: float, rows: str, *, voltage_v: float = NOMINAL_V) -> dict[str, Array]:
    """Per row of `rows` the smallest and largest force or moment (2,) in N or N m at a speed ahead.

    Rows are those that the autopilot commands, letters of XYZKMN; those not asked for and not X stay at zero.
    Tables of thrust are read at `voltage_v`, V.

    Examples
    --------
    >>> import seatrial as st
    >>> [round(float(x)) for x in reach(st.Vehicle.load("cwolf"), 0.0, "XZMN")["X"]]
    [-220, 308]
    """
    from scipy.optimize import linprog

    matrix = np.asarray(vehicle.allocation_matrix())
    limits = thrusts(vehicle, speed_m_s, voltage_v=voltage_v)
    extremes = {}
    for row in rows:
        # The other rows are kept at zero, all but surge, which is free.
        fixed = [ROWS.index(other) for other in rows if other not in (row, "X")]
        bounds = []
        # linprog minimises: the largest value is the smallest one of the negative.
        for sign in (1.0, -1.0):
            answer = linprog(
                sign * matrix[ROWS.index(row)],
                A_eq=matrix[fixed] if fixed else None,
                b_eq=np.zeros(len(fixed)) if fixed else None,
                bounds=list(map(tuple, limits)),
            )
            bounds.append(sign * float(answer.fun) if answer.success else 0.0)
        extremes[row] = np.array(bounds)
    return extremes


def commandable(vehicle: Vehicle, speed_m_s: float, *, voltage_v: float = NOMINAL_V) -> dict[str, str]:
    """Rows that cannot be commanded at this speed ahead, with the reason; the others can, independently.

    The rows are those that the vehicle file calls controllable; one that has no reach while the others are
    held at zero is left out, moments of roll and pitch first.
    """
    from numpy.linalg import matrix_rank

    matrix = np.asarray(vehicle.allocation_matrix())
    missing = dict.fromkeys(ROWS, "the vehicle file does not call it controllable")
    kept = ""
    for row in [r for r in "XNMZYK" if r in vehicle.controllable]:
        rows = [ROWS.index(r) for r in kept + row]
        scaled = matrix[rows] / np.maximum(np.abs(matrix[rows]).max(axis=1, keepdims=True), 1e-12)
        if matrix_rank(scaled, tol=1e-2) < len(rows):
            missing[row] = "the actuators cannot give it independently of the other rows"
            continue
        kept += row
        del missing[row]
    limits = reach(vehicle, speed_m_s, "".join(r for r in ROWS if r in kept), voltage_v=voltage_v)
    for row, (low, high) in limits.items():
        if high < SETTINGS.nothing_n or (row != "X" and low > -SETTINGS.nothing_n):
            missing[row] = f"the actuators have no reach at {speed_m_s:.2g} m/s"
    return {row: missing[row] for row in ROWS if row in missing}


def commanded_rows(vehicle: Vehicle) -> list[str]:
    """Rows of the wrench that the actuators can command independently, among X Y Z K M N.

    The rows that the vehicle file lists as controllable are tried first; the others join where they can.
    What happens in the rows left out is not asked: a canted propeller may push sideways while it turns.
    """
    order = _by_importance(vehicle)
    declared = [row for row in order if row in vehicle.controllable]
    return _independent(vehicle, (*declared, *(row for row in order if row not in declared)))


def advised_rows(vehicle: Vehicle) -> list[str]:
    """Rows that a vehicle file should call controllable: as many as are independent, what steers it first.

    An autopilot needs surge, yaw, and heave or pitch (`seatrial.control_design.start_gains`), so that these
    come before what the same actuators could do instead.
    """
    return _independent(vehicle, _by_importance(vehicle))


def _by_importance(vehicle: Vehicle) -> str:
    """Rows in the order in which they are needed: surge, yaw, the one that makes depth, the others.

    Stern planes dive by pitch, vertical thrusters by heave, wherever they sit.
    """
    heave = np.abs(np.asarray(vehicle.allocation_matrix()).reshape(6, -1)[2])
    facts = vehicle.actuator_info()
    fins = np.array([facts[name]["kind"] == "fin" for name in vehicle.actuators], bool)
    thrusters = heave[~fins].max(initial=0.0) > SETTINGS.part_share * heave.max(initial=0.0)
    return "XNZMYK" if thrusters else "XNMZYK"


def _independent(vehicle: Vehicle, order: Sequence[str]) -> list[str]:
    """Rows of `order` that the actuators command independently of those before them, as XYZKMN."""
    matrix = np.asarray(vehicle.allocation_matrix())
    if matrix.size == 0:
        return []
    lever = max(0.5 * vehicle.geometry().get("length", 2.0), 1e-6)
    scaled = matrix / np.array([1.0, 1.0, 1.0, lever, lever, lever])[:, None]
    largest = np.linalg.norm(scaled, 2)
    able: list[str] = []
    for row in order:
        tried = scaled[[ROWS.index(name) for name in (*able, row)]]
        sizes = np.linalg.svd(tried, compute_uv=False)
        if len(able) < matrix.shape[1] and sizes[-1] > SETTINGS.weak_share * largest:
            able.append(row)
    return [row for row in ROWS if row in able]


def delays(vehicle: Vehicle, rows: str) -> dict[str, Delay]:
    """How late each row follows its demand: that of the slowest actuator with a part in it."""
    matrix, values, facts = (
        np.asarray(vehicle.allocation_matrix()),
        vehicle.coefficients(),
        vehicle.actuator_info(),
    )
    by_row = {}
    for row in rows:
        strength = np.abs(matrix[ROWS.index(row)])
        least = SETTINGS.part_share * strength.max()
        late = [
            (values.get(f"{name}.T_1", 0.0), values.get(f"{name}.T_t", 0.0),
             _ramp(facts[name], values.get(f"{name}.n_acc", 0.0)))
            for name, entry in zip(vehicle.actuators, strength, strict=True)
            if entry > least
        ]  # fmt: skip
        by_row[row] = Delay(*(max(times) for times in zip((0.0, 0.0, 0.0), *late, strict=True)))
    return by_row


def mixing(vehicle: Vehicle, rows: Sequence[str], actuators: Sequence[str] | None = None) -> Array:
    """Full wrench (6, rows) per unit of each commanded row: what the least-squares allocation brings along.

    A fin at the stern that gives a pitch moment gives a heave force, too. ``actuators`` are those at work,
    all by default.
    """
    matrix = np.asarray(vehicle.allocation_matrix())
    if actuators is not None:
        matrix = matrix * np.array([name in actuators for name in vehicle.actuators])
    chosen = [ROWS.index(row) for row in rows]
    full: Array = matrix @ np.linalg.pinv(matrix[chosen], rcond=1e-3)
    full[np.abs(full) < 1e-12] = 0.0
    return full


def _ramp(facts: Mapping[str, Any], rate: float) -> float:
    """Time of a small correction at a limited rate, s; zero where rate or command have no limit."""
    most = float(facts["maximum_ahead"])
    return SETTINGS.ramp_share * most / rate if rate > 0.0 and np.isfinite(most) else 0.0
