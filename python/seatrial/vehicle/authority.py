"""What the actuators can do for each row of the wrench: reach, delay, coupling, rows that can be commanded.

The reach of a row is the largest force or moment with the other rows of the autopilot at zero and the
surge force free: a linear programme over the actuators' thrust between their largest commands, taken from
the vehicle's own chain at a speed ahead. Held by ``tests/control_design/test_control_design.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES
from seatrial.base.report import listed
from seatrial.vehicle.actuators import NOMINAL_V, bollard, can_push, command
from seatrial.vehicle.stability import statics

if TYPE_CHECKING:
    from seatrial._core import Vehicle

ROWS = AXES
"""Rows of the wrench."""

LOOPS = ("surge", "sway", "heave", "roll", "pitch", "heading")
"""The loop of each row of the wrench."""


@dataclass(frozen=True)
class AuthoritySettings:
    """When actuators command a row, and when a vehicle is neutral."""

    #: Share of what the strongest actuator gives from which an actuator counts for a row.
    part_share: float = 0.1
    ramp_share: float = 0.1  #: Share of the largest command that a small correction asks for.
    #: Buoyancy less weight, as a share of the weight, up to which a vehicle is neutral.
    neutral_share: float = 1e-4
    nothing_n: float = 1e-3  #: Force or moment that is nothing, N or N m.
    #: Singular value, as a share of the largest, below which actuators command nothing in practice.
    weak_share: float = 0.02
    met_share: float = 0.99  #: Share of a demand that counts as met.


SETTINGS = AuthoritySettings()


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
    matrix, values = np.asarray(vehicle.allocation_matrix()), vehicle.coefficients()
    facts, by_row = vehicle.actuator_info(), {}
    for row in rows:
        strength = np.abs(matrix[ROWS.index(row)])
        taking = [
            name
            for name, part in zip(vehicle.actuators, strength, strict=True)
            if part > SETTINGS.part_share * strength.max()
        ]
        by_row[row] = Delay(
            lag_s=max((values.get(f"{name}.T_1", 0.0) for name in taking), default=0.0),
            dead_s=max((values.get(f"{name}.T_t", 0.0) for name in taking), default=0.0),
            ramp_s=max(
                (_ramp(facts[name], values.get(f"{name}.n_acc", 0.0)) for name in taking), default=0.0
            ),
        )
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


def _ramp(facts: dict[str, object], rate: float) -> float:
    largest = float(str(facts["maximum_ahead"]))
    return SETTINGS.ramp_share * largest / rate if rate > 0.0 and np.isfinite(largest) else 0.0


_MOTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")


def authority_in_words(vehicle: Vehicle, speed_m_s: float) -> list[str]:
    """What can be commanded at a speed ahead, and what the loss of each actuator leaves, a sentence each.

    As ``Vehicle.authority_sentences``; where the only thrust ahead is lost, the speed and the force of fins
    go with it.
    """
    sentences = vehicle.authority_sentences(speed_m_s)
    only = _only_thrust(vehicle)
    if only is None or speed_m_s <= 0.0:
        return sentences
    still = set(_commanded(vehicle, 0.0)) - {"surge"}
    gone = [motion for motion in _commanded(vehicle, speed_m_s) if motion not in still]
    words = (
        f"After the loss of {only} nothing drives the vehicle: its speed decays, its fins lose their force"
    )
    if gone:
        words += f", and {listed(gone)} {'is' if len(gone) == 1 else 'are'} lost"
    words += f"; {_way_up(vehicle)}."
    loss = (f"After the loss of {only} ", f"Nothing remains after the loss of {only}.")
    return [words if sentence.startswith(loss) else sentence for sentence in sentences]


def _only_thrust(vehicle: Vehicle) -> str | None:
    """The one actuator that drives a vehicle with fins ahead; None where there are several or no fins."""
    facts, ahead = vehicle.actuator_info(), np.abs(np.asarray(vehicle.allocation_matrix())[0])
    fins = [name for name in vehicle.actuators if facts[name]["kind"] == "fin"]
    driving = [
        name
        for name, part in zip(vehicle.actuators, ahead, strict=True)
        if name not in fins and part > SETTINGS.part_share * ahead.max()
    ]
    return driving[0] if fins and len(driving) == 1 else None


def _commanded(vehicle: Vehicle, speed_m_s: float) -> list[str]:
    """Motions that can be commanded independently at a speed ahead."""
    rows = vehicle.authority(speed_m_s)
    return [
        motion
        for row, motion in zip(ROWS, _MOTIONS, strict=True)
        if rows[row]["controlled_share"] >= SETTINGS.met_share
    ]


def _way_up(vehicle: Vehicle) -> str:
    """Whether a vehicle without thrust comes up."""
    rest = statics(vehicle)
    if rest.net_n > SETTINGS.neutral_share * rest.weight_n:
        return f"only its buoyancy of {rest.net_n:+.2g} N brings it up"
    return 'and it is not buoyant: neither reaction of the safety, "surface" or "abort", brings it up'
