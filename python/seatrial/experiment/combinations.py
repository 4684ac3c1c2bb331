"""Actuator combinations: which actuators together push a vehicle along or about one axis, and their commands.

A combination is the least-norm pattern of thrusts of one actuator group for one row of the wrench,
``f = pinv(B_controllable) e_i`` (Fossen 2011, section 12.3, with lengths scaled by half the hull); where no
group alone can do it, all actuators together. Patterns add as thrusts; the inverse of each actuator's
characteristic at rest turns thrusts into commands, so that the limits of the motors hold. A fin's is that at
1 m/s ahead: the force grows with the square of the speed, its share of the largest one stays.

Held by ``tests/experiment/test_manoeuvre.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, MOTIONS
from seatrial.base.errors import VehicleError
from seatrial.vehicle.actuators import (
    NOMINAL_V,
    actuator_groups,
    command,
    commanded_rows,
    settling_s,
    voltage_for,
)

if TYPE_CHECKING:
    from seatrial._core import Vehicle

AHEAD = {"slow": 0.12, "half": 0.35, "full": 0.75}
"""Thrust ahead as a share of the largest, by the engine telegraph's words."""


@dataclass(frozen=True)
class CombinationSettings:
    """Which combinations of actuators drive an axis."""

    pure_share: float = 0.5  #: Of a pattern's wrench that lies in the row of the axis that it drives.
    #: All together are a combination of their own where they push that much purer than a group.
    purer_by: float = 0.02
    #: Cosine of the angle (8 degrees) below which two combinations are the same trial.
    parallel: float = 0.99
    weak_share: float = 0.02  #: Of the largest singular value: smaller ones command nothing in practice.
    points: int = 100  #: Commands per side at which thrust is computed.
    samples_per_point: int = 8  #: Samples of the simulation at each, of which the last counts.
    way_m_s: float = 1.0  #: Speed at which a fin's force is read, m/s.


SETTINGS = CombinationSettings()
_DIGITS = {"rpm": 1, "us": 1, "N": 2}


@dataclass(frozen=True)
class Combination:
    """Thrusts (actuators,) in N of one actuator group for a wrench of one along an axis, N or N m.

    ``group`` is "all" where all actuators work together. ``purity`` is the share of its wrench, with moments
    taken at half the hull's length, that lies in the axis: one where it pushes nothing else. One that
    ``needs_way`` moves fins: at rest it does nothing.
    """

    axis: str
    group: str
    thrusts: tuple[float, ...]
    purity: float
    needs_way: bool = False

    @property
    def motion(self) -> str:
        """The motion that it drives: "surge", "yaw"."""
        return MOTIONS[self.axis]


class Thrusters:
    """The actuators of a vehicle as manoeuvres use them: combinations, limits, commands for thrusts.

    Parameters
    ----------
    vehicle : Vehicle
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

    Attributes
    ----------
    names
        Actuators in the vehicle's order.
    lower, upper
        Largest thrusts (actuators,) in N against and along their directions, of fins at 1 m/s ahead.
    combinations
        One `Combination` per axis and actuator group that can command it.

    Examples
    --------
    >>> import seatrial as st
    >>> thrusters = Thrusters(st.Vehicle.load("cwolf"))
    >>> [(combination.motion, combination.group) for combination in thrusters.combinations]
    [('surge', 'stern'), ('pitch', 'stern'), ('yaw', 'stern'), ('heave', 'vertical'), ('pitch', 'vertical')]
    """

    def __init__(self, vehicle: Vehicle, *, voltage_v: float = NOMINAL_V) -> None:
        self.vehicle, self.voltage_v = vehicle, voltage_v
        self.names: tuple[str, ...] = tuple(vehicle.actuators)
        self._facts = vehicle.actuator_info()
        self._matrix = np.asarray(vehicle.allocation_matrix(), dtype=float).reshape(6, -1)
        self._curves = [self._curve(name) for name in self.names]
        self.lower = np.array([curve[0][0] for curve in self._curves])
        self.upper = np.array([curve[0][-1] for curve in self._curves])
        self.combinations = _combinations(vehicle, self._matrix)

    def combinations_of(self, axis: str) -> list[Combination]:
        """Combinations of the axis of this letter, the purest first."""
        return sorted(
            (combination for combination in self.combinations if combination.axis == axis),
            key=lambda combination: -combination.purity,
        )

    @property
    def drivers(self) -> list[Combination]:
        """Combinations that drive the vehicle ahead from rest, the purest first."""
        return [combination for combination in self.combinations_of("X") if not combination.needs_way]

    def reach(self, combination: Combination, besides: Array | None = None) -> tuple[float, float]:
        """Largest wrenches against and along the axis, N or N m, beside other thrusts (actuators,)."""
        pattern = np.array(combination.thrusts)
        held = np.zeros(len(pattern)) if besides is None else besides
        return self._room(-pattern, held), self._room(pattern, held)

    def push(
        self, combination: Combination, level: Array, besides: Array | None = None, *, even: bool = True
    ) -> Array:
        """Thrusts (n, actuators) in N for levels (n,) from -1 to 1 of what the combination reaches.

        Even, +1 and -1 push equally hard where levels of both signs are asked and both can be given;
        otherwise each is the largest in its own sense, and a propeller is weaker astern.
        """
        against, along = self.reach(combination, besides)
        level = np.asarray(level, dtype=float)
        if even and level.min(initial=0.0) < 0.0 < level.max(initial=0.0) and min(against, along) > 0.0:
            against = along = min(against, along)
        return np.outer(level * np.where(level > 0.0, along, against), combination.thrusts)

    def ahead(self, word: str) -> Array:
        """Thrusts (actuators,) in N for a word of the engine telegraph: "slow", "half" or "full" ahead."""
        surge = self.drivers
        if not surge or word not in AHEAD:
            reason = f"expected one of {', '.join(AHEAD)}" if surge else "nothing drives this vehicle ahead"
            raise VehicleError(f"ahead {word!r}: {reason}")
        return np.asarray(self.push(surge[0], np.array([AHEAD[word]]), even=False)[0])

    def commands(self, thrusts: Array) -> dict[str, Array]:
        """Commands {actuator: (n,)} in their own units for thrusts (n, actuators), held within the limits."""
        series: dict[str, Array] = {}
        for name, (force, values), wanted in zip(self.names, self._curves, thrusts.T, strict=True):
            neutral = float(self._facts[name]["neutral"])
            given = np.where(np.abs(wanted) < 1e-9, neutral, np.interp(wanted, force, values))
            series[name] = np.asarray(
                np.round(given, _DIGITS.get(str(self._facts[name]["unit"]), 4)), dtype=float
            )
        return series

    def trim(self) -> Array:
        """Thrusts (actuators,) in N that carry the net weight of the level vehicle; zero where none can."""
        none = np.zeros(len(self.names))
        heave = [combination for combination in self.combinations_of("Z") if not combination.needs_way]
        if not heave:
            return none
        needed = -float(np.asarray(self.vehicle.forces(np.zeros(6), (0.0, 0.0, 0.0))["restoring"])[2])
        return none if abs(needed) > 0.5 * min(self.reach(heave[0])) else needed * np.array(heave[0].thrusts)

    def _room(self, pattern: Array, held: Array) -> float:
        """Largest factor with which a pattern added to thrusts stays inside the limits."""
        used = np.abs(pattern) > 1e-9
        ends = (np.where(pattern > 0.0, self.upper, self.lower) - held)[used] / pattern[used]
        return max(float(ends.min(initial=np.inf)), 0.0)

    def _curve(self, name: str) -> tuple[Array, Array]:
        """Thrust in N, strictly rising, and the command that gives it, motor settled."""
        from seatrial._core import State

        facts = self._facts[name]
        wrench = np.asarray(facts["wrench"], dtype=float)
        row = int(np.argmax(np.abs(wrench)))
        shares = np.linspace(-1.0, 1.0, 2 * SETTINGS.points + 1)
        # One run with the vehicle held: every command stands until the motor follows it.
        hold = settling_s(self.vehicle)
        t = np.arange(SETTINGS.samples_per_point * len(shares)) * hold / SETTINGS.samples_per_point
        commands = np.array([command(facts, float(share)) for share in shares])
        way = SETTINGS.way_m_s if facts["kind"] == "fin" else 0.0
        run = self.vehicle.simulate(
            t,
            {name: np.repeat(commands, SETTINGS.samples_per_point)},
            State(nu=[way, 0.0, 0.0, 0.0, 0.0, 0.0]),
            free="",
            voltage_v=voltage_for(self.vehicle, t, self.voltage_v),
            max_step_s=hold,
        )
        force = (
            np.asarray(run.tau)[SETTINGS.samples_per_point - 1 :: SETTINGS.samples_per_point, row]
            / wrench[row]
        )
        keep = [SETTINGS.points]
        for order in (range(SETTINGS.points + 1, len(shares)), range(SETTINGS.points - 1, -1, -1)):
            last = 0.0
            for k in order:
                if (k - SETTINGS.points) * force[k] > 0.0 and abs(force[k]) > last + 1e-9:
                    keep.append(k)
                    last = abs(float(force[k]))
        keep.sort()
        return np.where(np.arange(len(shares)) == SETTINGS.points, 0.0, force)[keep], commands[keep]


def _combinations(vehicle: Vehicle, matrix: Array) -> tuple[Combination, ...]:
    """Combinations of every group, then of all actuators together for the axes that no group drives."""
    rows = [row for row in AXES if row in (vehicle.controllable or commanded_rows(vehicle))]
    if matrix.shape[1] == 0 or not rows:
        return ()
    # Moments in the unit of forces: by half the hull as lever.
    lever = max(0.5 * vehicle.geometry().get("length", 2.0), 1e-6)
    scale = np.array([1.0, 1.0, 1.0, lever, lever, lever])
    scaled = matrix / scale[:, None]
    places = {name: k for k, name in enumerate(vehicle.actuators)}
    groups = [(group, [places[name] for name in names]) for group, names in actuator_groups(vehicle).items()]
    everything = ("all", list(places.values()))
    facts = vehicle.actuator_info()
    fins = np.array([facts[name]["kind"] == "fin" for name in vehicle.actuators])
    chosen: list[Combination] = []
    for group, members in [*(groups if len(groups) > 1 else []), everything]:
        # The purest pattern of a group first; one that is nearly parallel to it is the same trial.
        accepted: list[Array] = []
        tried = [_pattern(scaled, rows, members, axis) for axis in rows]
        for purity, axis, pattern in sorted(tried, key=lambda entry: (-entry[0], AXES.index(entry[1]))):
            rival = max(
                (combination.purity for combination in chosen if combination.axis == axis),
                default=SETTINGS.pure_share,
            )
            if purity < SETTINGS.pure_share or (group == "all" and purity < rival + SETTINGS.purer_by):
                continue
            unit = pattern / np.linalg.norm(pattern)
            if any(abs(unit @ other) > SETTINGS.parallel for other in accepted):
                continue
            accepted.append(unit)
            pushed = float(matrix[AXES.index(axis)] @ pattern)
            thrusts = tuple(float(x) for x in pattern / pushed)
            needs_way = bool((np.abs(unit[fins]) > 1e-6).any())
            chosen.append(Combination(axis, group, thrusts, purity, needs_way))
    order = [*(group for group, _ in groups), "all"]
    return tuple(
        sorted(chosen, key=lambda combination: (order.index(combination.group), AXES.index(combination.axis)))
    )


def _pattern(scaled: Array, rows: list[str], members: list[int], axis: str) -> tuple[float, str, Array]:
    """Share of the wrench in the row of the axis, the axis, and thrusts (actuators,) for it."""
    places = [AXES.index(row) for row in rows]
    inverse = np.linalg.pinv(scaled[np.ix_(places, members)], rcond=SETTINGS.weak_share)
    thrusts = np.zeros(scaled.shape[1])
    thrusts[members] = inverse[:, rows.index(axis)]
    size = float(np.linalg.norm(scaled[:, members] @ thrusts[members]))
    along = float(scaled[AXES.index(axis)] @ thrusts)
    return (along / size if size > 1e-9 else 0.0), axis, thrusts
