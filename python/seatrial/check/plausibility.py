"""Values of a vehicle that cannot be meant: wrong units, wrong signs, rows that no actuator commands.

Held by ``tests/check/test_check.py``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.report import listed
from seatrial.problem.parameter import STRIPS
from seatrial.vehicle.actuators import pushes
from seatrial.vehicle.authority import advised_rows, commanded_rows
from seatrial.vehicle.stability import positive_damping

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_INERTIAS = ("I_x", "I_y", "I_z")


def implausible(vehicle: Vehicle) -> list[str]:
    """Sentences about values that are probably wrong, each with what to look at."""
    about = (
        _density,
        _size,
        _inertia,
        _triangle,
        _signs,
        _motors,
        _ranges,
        _thrust,
        _strips,
        _tether,
        _positions,
        _rows,
    )
    return [sentence for of in about for sentence in of(vehicle)]


def _density(vehicle: Vehicle) -> list[str]:
    rho = vehicle.environment()["rho"]
    if 950.0 <= rho <= 1300.0:  # kg/m3: hot water, the Dead Sea
        return []
    return [
        f"rho_kg_m3 = {rho:g} is not the density of water, which is 1000 in a lake and 1025 in the sea; is it"
        " in kg/m3?"
    ]


def _size(vehicle: Vehicle) -> list[str]:
    values, box = vehicle.coefficients(), vehicle.geometry()
    if not box or _density(vehicle):  # without the density no mass of water is known
        return []
    displaced = vehicle.environment()["rho"] * box["length"] * box["diameter"] * box["height"]
    share = values["m"] / displaced
    if share > 1.2:
        return [
            f"m = {values['m']:g} kg is more than the {displaced:.4g} kg of water in a box of the hull's"
            " measures; are the mass in kg and the measures in m?"
        ]
    if share < 0.02:
        return [
            f"m = {values['m']:g} kg is only {100 * share:.2g} % of the {displaced:.4g} kg of water in a box"
            " of the hull's measures; are the mass in kg and the measures in m?"
        ]
    return []


def _inertia(vehicle: Vehicle) -> list[str]:
    values, box = vehicle.coefficients(), vehicle.geometry()
    if not box:
        return []
    spans = {
        "I_x": (box["diameter"], box["height"]),
        "I_y": (box["length"], box["height"]),
        "I_z": (box["length"], box["diameter"]),
    }
    lines = []
    for name, (a, b) in spans.items():
        solid = values["m"] * (a * a + b * b) / 12.0
        if not 0.1 < values[name] / solid < 10.0:
            lines.append(
                f"{name} = {values[name]:.4g} kg m2 is {values[name] / solid:.2g} times that of a solid box"
                " of the hull's measures; is it in kg m2 and about O?"
            )
    return lines


def _triangle(vehicle: Vehicle) -> list[str]:
    """No body has a moment of inertia above the sum of the other two, whatever point they are about."""
    values = vehicle.coefficients()
    lines = []
    for k, name in enumerate(_INERTIAS):
        others = [_INERTIAS[k - 1], _INERTIAS[k - 2]]
        most = sum(values[other] for other in others)
        if values[name] > 1.005 * most:  # values of three digits may pass a bound
            lines.append(
                f"{name} = {values[name]:.4g} kg m2 is more than {' + '.join(sorted(others))} = {most:.4g}"
                " kg m2, which no body has; correct the moments of inertia"
            )
    return lines


def _motors(vehicle: Vehicle) -> list[str]:
    """Motors whose least speed lies above their largest."""
    names_by_fault: defaultdict[str, list[str]] = defaultdict(list)
    for name, facts in vehicle.actuator_info().items():
        for side in ("ahead", "astern"):
            least, most = float(facts[f"minimum_{side}"]), float(facts[f"maximum_{side}"])
            if least > most > 0.0:
                wrong = f"minimum_{side} = {least:g} above maximum_{side} = {most:g}"
                names_by_fault[wrong].append(name)
    return [
        f"{wrong} of {listed(names)}: no command lies between; correct the motor"
        for wrong, names in names_by_fault.items()
    ]


# By unit of the command what actuators of underwater vehicles have, with a margin: ducted propellers of large
# vehicles turn with 100 rpm, hobby motors with 10,000; pulses are 1500 +- 600 us; fast servos move 60 degrees
# in 0.05 s and lag by less than a second; the strongest thrusters push 10 kN.
_LIMITS = {
    "rpm": (30.0, 2e4, "in rpm: rev/s times 60"),
    "us": (20.0, 1e3, "in us from neutral: 1900 us about 1500 us are 400"),
    "N": (0.05, 2e4, "in N"),
    "rad": (0.035, 1.571, "in rad: 20 degrees are 0.349"),
}
_SERVO_RATE, _SERVO_LAG_S, _MOTOR_LAG_S = 25.0, 2.0, 10.0  # rad/s, with the same margin
_STRONGEST = 10.0  # times the weight: thrust of one actuator


def _ranges(vehicle: Vehicle) -> list[str]:
    """Limits, lags, areas and thrusts that no actuator of this kind has, as with degrees or percent."""
    values, box = vehicle.coefficients(), vehicle.geometry()
    weight = values["m"] * vehicle.environment()["g"]
    names_by_fault: defaultdict[str, list[str]] = defaultdict(list)
    for name, facts in vehicle.actuator_info().items():
        fin, unit = facts["kind"] == "fin", str(facts["unit"])
        least, most, how = _LIMITS[unit]
        for side in ("ahead", "astern"):
            limit = float(facts[f"maximum_{side}"])
            if 0.0 < limit < least or most < limit < np.inf:
                what = f"maximum_{side} = {limit:g} is outside the {least:g} to {most:g} {unit}"
                names_by_fault[f"{what} of any such actuator; give it {how}"].append(name)
        # A lag in ms or a rate in deg/s is a hundred times too large: wide limits find both.
        lag = max(values.get(f"{name}.T_1", 0.0), values.get(f"{name}.T_t", 0.0))
        if lag > (_SERVO_LAG_S if fin else _MOTOR_LAG_S):
            names_by_fault[f"lag or dead time of {lag:g} s is longer than any; give it in s"].append(name)
        rate = values.get(f"{name}.n_acc", 0.0)
        if fin and rate > _SERVO_RATE:
            what = f"n_acc_per_s = {rate:g} rad/s is faster than any servo; give it in rad/s:"
            names_by_fault[f"{what} {rate:g} deg/s are {np.deg2rad(rate):.2g}"].append(name)
    tables = {str(fin["name"]): fin for fin in vehicle.to_dict().get("fins", [])}
    # An area in cm2 is ten thousand times too large.
    for name, fin in tables.items():
        area = float(fin["area_m2"])
        # More than half of the hull seen from the side is no fin.
        if box and area > 0.5 * box["length"] * max(box["diameter"], box["height"]):
            what = f"area_m2 = {area:g} is more than half of the hull seen from the side; give it in m2"
            names_by_fault[what].append(name)
    for push in pushes(vehicle):
        force = float(np.linalg.norm(push.wrench[:3]))
        if force > _STRONGEST * weight:
            what = f"pushes with {force:.3g} N, {force / weight:.2g} times the weight of the vehicle"
            names_by_fault[f"{what}; check unit and size of its characteristic"].append(push.actuator)
    return [f"{listed(list(dict.fromkeys(names)))}: {what}" for what, names in names_by_fault.items()]


def _thrust(vehicle: Vehicle) -> list[str]:
    """Thrust falls with the inflow: its slope over the speed is negative."""
    values = vehicle.coefficients()
    wrong = [name for name in vehicle.actuators if values.get(f"{name}.p2", 0.0) > 0.0]
    if not wrong:
        return []
    return [
        f"p2 (alpha2) of {listed(wrong)} is positive: the thrust would grow with the inflow; it is negative"
    ]


def _signs(vehicle: Vehicle) -> list[str]:
    """Diagonal damping is negative in Fossen's convention, added mass is not far above the vehicle's own."""
    values = vehicle.coefficients()
    lines = [
        f"{name} = {value:+.4g} is positive: it drives the vehicle on. Damping derivatives are negative"
        " (force on the vehicle)"
        for name, value in positive_damping(vehicle).items()
    ]
    for row, axis in zip(AXES, VELOCITIES, strict=True):
        own = values["m"] if row in "XYZ" else values[f"I_{'xyz'['KMN'.index(row)]}"]
        added = -values.get(f"{row}_{axis}dot", 0.0)
        if added > 10.0 * own or added < 0.0:
            lines.append(
                f"{row}_{axis}dot = {-added:+.4g} against {own:.4g} of the vehicle itself; added-mass"
                " derivatives are negative and rarely above ten times its own"
            )
    return lines


def _strips(vehicle: Vehicle) -> list[str]:
    """Cross-flow drag that stands in a vehicle twice: by strips and as quadratic damping."""
    values = vehicle.coefficients()
    return [
        f"{listed((name, *both))} are not zero: the strips of {name} already include {listed(both)}; set"
        f" {listed(both)} to 0, unless {'it describes' if len(both) == 1 else 'they describe'} an appendage"
        for name, made in STRIPS.items()
        if values.get(name) and (both := [coefficient for coefficient in made if values.get(coefficient)])
    ]


def _tether(vehicle: Vehicle) -> list[str]:
    """A tether that is made fast and does nothing."""
    values = vehicle.coefficients()
    if vehicle.to_dict().get("tether") is None or values.get("A_tether") or values.get("k_tether"):
        return []
    return [
        "the tether has no effect: A_tether and k_tether are 0; give the drag area A_tether in m2 (drag"
        " coefficient times diameter times the length that is dragged along), or free it in a stage"
    ]


def _positions(vehicle: Vehicle) -> list[str]:
    box, values, lines = vehicle.geometry(), vehicle.coefficients(), []
    if not box:
        return []
    half = 0.5 * np.array([box["length"], box["diameter"], box["height"]])
    for name, facts in vehicle.actuator_info().items():
        if facts["position"] is not None and np.any(np.abs(facts["position"]) > 2.0 * half):
            position = ", ".join(f"{x:g}" for x in facts["position"])
            lines.append(f"{name} at [{position}] m lies far outside the hull; are the positions in m?")
    for centre, letter in (("gravity", "g"), ("buoyancy", "b")):
        levers = np.array([values.get(f"{axis}_{letter}", 0.0) for axis in "xyz"])
        if np.any(np.abs(levers) > half):
            lines.append(
                f"the centre of {centre} lies outside the hull; are x_{letter}, y_{letter}, z_{letter} in m?"
            )
    return lines


def _rows(vehicle: Vehicle) -> list[str]:
    able = commanded_rows(vehicle)
    declared = vehicle.controllable
    advised = advised_rows(vehicle)
    lacking = [row for row in declared if row not in able]
    lines = [
        f"controllable lists {row} {declared.count(row)} times; name each row once"
        for row in dict.fromkeys(declared)
        if declared.count(row) > 1
    ]
    kept = ", ".join(f'"{row}"' for row in advised)
    if not lacking:
        steered = {"X", "N"} <= set(declared) and {"Z", "M"} & set(declared)
        if declared and not steered and {"X", "N"} <= set(advised) and {"Z", "M"} & set(advised):
            lines.append(
                f"controllable = [{', '.join(declared)}] lets no autopilot steer, which needs X, N and Z or"
                f" M; its actuators can command them: give controllable = [{kept}]"
            )
        return lines
    return [
        *lines,
        f"{', '.join(lacking)} {'counts' if len(lacking) == 1 else 'count'} as controllable (every row does"
        " in a file without this key), and the actuators cannot command"
        f" {'it' if len(lacking) == 1 else 'them'} independently of the others; give controllable ="
        f" [{kept}], or correct positions and directions",
    ]


def unused_rows(vehicle: Vehicle, able: Collection[str]) -> list[str]:
    """Sentence about rows that the actuators can command and the vehicle file leaves out of controllable."""
    unused = [row for row in able if row not in vehicle.controllable]
    if not unused:
        return []
    return [f"The actuators can also command {', '.join(unused)}; controllable leaves it out"]
