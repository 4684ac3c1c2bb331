"""Drives: which actuators together push a vehicle along or about one axis, and with which commands.

A drive is the least-norm pattern of thrusts of one actuator group for one row of the wrench,
``f = pinv(B_controllable) e_i`` (Fossen 2011, section 12.3, with lengths scaled by half the hull); where no
group alone does it, all actuators together. Patterns add as thrusts; the inverse of each actuator's
characteristic at rest turns thrusts into commands, so that the limits of the motors hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.campaign_file import AXES
from seatrial.check.actuators import NOMINAL_V, bollard, command, largest
from seatrial.check.plausibility import commanded_rows
from seatrial.parameters import actuator_groups
from seatrial.search import Array

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["MOTIONS", "Drive", "Thrusters"]

MOTIONS = dict(zip(AXES, ("surge", "sway", "heave", "roll", "pitch", "yaw"), strict=True))
"""The motion along or about the axis of each letter."""

_PURE = 0.5  # a pattern drives an axis if this share of its wrench lies in that row
_PARALLEL = 0.99
_WEAK = 0.02  # singular values below this share of the largest command nothing in practice
_SHARES = np.linspace(0.0, 1.0, 21) ** 0.5  # about even in thrust, which grows with the square
_DIGITS = {"rpm": 1, "us": 1, "N": 2}


@dataclass(frozen=True)
class Drive:
    """Thrusts (actuators,) in N of one actuator group for a wrench of one along an axis, N or N m.

    ``group`` is empty where all actuators work together.
    """

    axis: str
    group: str
    thrusts: tuple[float, ...]

    @property
    def motion(self) -> str:
        """The motion that it drives: "surge", "yaw"."""
        return MOTIONS[self.axis]


class Thrusters:
    """The actuators of a vehicle as manoeuvres use them: drives, limits, commands for thrusts.

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
        Largest thrusts (actuators,) in N against and along their directions.
    drives
        One `Drive` per axis and actuator group that can command it.

    Examples
    --------
    >>> import seatrial as st
    >>> thrusters = Thrusters(st.Vehicle.load("cwolf"))
    >>> [(drive.motion, drive.group) for drive in thrusters.drives]
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
        self.drives = _drives(vehicle, self._matrix)

    def drives_of(self, axis: str) -> list[Drive]:
        """Drives of the axis of this letter, the strongest first."""
        found = [drive for drive in self.drives if drive.axis == axis]
        return sorted(found, key=lambda drive: -self.reach(drive))

    def reach(self, drive: Drive, bias: Array | None = None) -> float:
        """Largest wrench along the drive's axis, N or N m, in both senses, besides thrusts (actuators,)."""
        pattern = np.array(drive.thrusts)
        held = np.zeros(len(pattern)) if bias is None else bias
        room = np.minimum(self.upper - held, held - self.lower)
        used = np.abs(pattern) > 1e-9
        return max(float((room[used] / np.abs(pattern[used])).min(initial=np.inf)), 0.0)

    def push(self, drive: Drive, level: Array, bias: Array | None = None) -> Array:
        """Thrusts (n, actuators) in N for levels (n,) from -1 to 1 of what the drive reaches.

        Without thrusts besides, +1 and -1 are the largest in their own sense: a propeller is weaker astern.
        """
        pattern, level = np.array(drive.thrusts), np.asarray(level, dtype=float)
        if bias is not None:
            return np.outer(level * self.reach(drive, bias), pattern)
        ends = [self._one_sided(pattern), self._one_sided(-pattern)]
        return np.outer(np.where(level > 0.0, level * ends[0], level * ends[1]), pattern)

    def commands(self, thrusts: Array) -> dict[str, Array]:
        """Commands {actuator: (n,)} in their own units for thrusts (n, actuators), held within the limits."""
        found = {}
        for name, (force, share), wanted in zip(self.names, self._curves, thrusts.T, strict=True):
            shares = np.where(np.abs(wanted) < 1e-9, 0.0, np.interp(wanted, force, share))
            values = np.array([command(self._facts[name], float(s)) for s in shares])
            found[name] = np.round(values, _DIGITS.get(str(self._facts[name]["unit"]), 4))
        return found

    def trim(self) -> Array:
        """Thrusts (actuators,) in N that carry the net weight of the level vehicle; zero where none can."""
        none = np.zeros(len(self.names))
        heave = self.drives_of("Z")
        if not heave:
            return none
        needed = -float(np.asarray(self.vehicle.forces(np.zeros(6), (0.0, 0.0, 0.0))["restoring"])[2])
        return none if abs(needed) > 0.5 * self.reach(heave[0]) else needed * np.array(heave[0].thrusts)

    def _one_sided(self, pattern: Array) -> float:
        """Largest factor with which a pattern stays inside the limits."""
        used = np.abs(pattern) > 1e-9
        ends = np.where(pattern > 0.0, self.upper, self.lower)[used] / pattern[used]
        return max(float(ends.min(initial=np.inf)), 0.0)

    def _curve(self, name: str) -> tuple[Array, Array]:
        """Thrust in N, strictly rising, and the share of the largest command that gives it, motor settled."""
        facts = self._facts[name]
        wrench = np.asarray(facts["wrench"], dtype=float)
        row = int(np.argmax(np.abs(wrench)))
        shares = np.concatenate([-_SHARES[:0:-1], _SHARES])
        force = np.array([
            bollard(self.vehicle, {name: command(facts, float(s))}, voltage_v=self.voltage_v)[row] / wrench[row]
            for s in shares
        ])
        force[len(_SHARES) - 1] = 0.0
        keep = np.zeros(len(shares), dtype=bool)
        keep[len(_SHARES) - 1] = True
        for sign, order in ((1.0, range(len(_SHARES), len(shares))), (-1.0, range(len(_SHARES) - 2, -1, -1))):
            last = 0.0
            for k in order:
                if sign * force[k] > last + 1e-9:
                    keep[k], last = True, sign * force[k]
        return force[keep], shares[keep]


def neutral(vehicle: Vehicle) -> dict[str, float]:
    """Command without thrust of every actuator, in its own unit."""
    facts = vehicle.actuator_info()
    return {name: float(facts[name]["neutral"]) for name in vehicle.actuators}


def strongest(vehicle: Vehicle, name: str) -> tuple[float, float]:
    """Least and greatest command of an actuator, in its own unit."""
    facts = vehicle.actuator_info()[name]
    ends = [float(facts["neutral"]) + sign * largest(facts, sign) for sign in (-1.0, 1.0)]
    return ends[0], ends[1]


def _drives(vehicle: Vehicle, matrix: Array) -> tuple[Drive, ...]:
    """Drives of every group, then of all actuators together for the axes that no group drives."""
    rows = [row for row in AXES if row in (vehicle.controllable or commanded_rows(vehicle))]
    if matrix.shape[1] == 0 or not rows:
        return ()
    lever = max(0.5 * vehicle.geometry().get("length", 2.0), 1e-6)
    scale = np.array([1.0, 1.0, 1.0, lever, lever, lever])
    scaled = matrix / scale[:, None]
    places = {name: k for k, name in enumerate(vehicle.actuators)}
    groups = [(group, [places[name] for name in names]) for group, names in actuator_groups(vehicle).items()]
    everything = ("", list(places.values()))
    found: list[Drive] = []
    for group, members in [*(groups if len(groups) > 1 else []), everything]:
        accepted: list[Array] = []
        tried = [_pattern(scaled, rows, members, axis) for axis in rows]
        for purity, axis, pattern in sorted(tried, key=lambda entry: (-entry[0], AXES.index(entry[1]))):
            if purity < _PURE or (not group and any(drive.axis == axis for drive in found)):
                continue
            unit = pattern / np.linalg.norm(pattern)
            if any(abs(unit @ other) > _PARALLEL for other in accepted):
                continue
            accepted.append(unit)
            pushed = float(matrix[AXES.index(axis)] @ pattern)
            found.append(Drive(axis, group, tuple(float(x) for x in pattern / pushed)))
    order = [group for group, _ in groups] + [""]
    return tuple(sorted(found, key=lambda drive: (order.index(drive.group), AXES.index(drive.axis))))


def _pattern(scaled: Array, rows: list[str], members: list[int], axis: str) -> tuple[float, str, Array]:
    """Share of the wrench in the row of the axis, the axis, and thrusts (actuators,) for it."""
    places = [AXES.index(row) for row in rows]
    inverse = np.linalg.pinv(scaled[np.ix_(places, members)], rcond=_WEAK)
    thrusts = np.zeros(scaled.shape[1])
    thrusts[members] = inverse[:, rows.index(axis)]
    size = np.linalg.norm(scaled[:, members] @ thrusts[members])
    along = float(scaled[AXES.index(axis)] @ thrusts)
    return (along / size if size > 1e-9 else 0.0), axis, thrusts
