"""What each actuator does: its push in words, the wrench at bollard pull, limits and groups.

The force is the model's own, behind the whole chain from command to wrench: the vehicle is held (no axis
free) until the motor has settled, at rest for a thruster, in a steady flow from ahead for a fin. A sentence
per actuator shows a wrong sign before any trial. Held by ``tests/check/test_check.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
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
    """What an actuator counts for."""

    under_way_m_s: float = 1.5  #: Speed ahead at which a fin is judged, m/s.
    main_share: float = 0.5  #: Share of the largest force from which it is what an actuator mainly does.
    minor_share: float = 0.05  #: Share of the largest force below which it is not worth a word.
    #: Share of the largest entry of the allocation matrix from which a row counts as driven.
    driven_share: float = 0.02
    lever_m: float = 0.02  #: Lever of a force below which it counts as no turning moment, m.
    #: Wrench about O per newton, 1 and m, from which a thruster serves a row.
    direct_wrench: tuple[float, ...] = (0.5, 0.5, 0.5, 0.03, 0.03, 0.03)


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
    return "".join(
        axis
        for axis, row, least in zip("XYZKMN", matrix, SETTINGS.direct_wrench, strict=True)
        if row.max(initial=0.0) >= least
    )


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
