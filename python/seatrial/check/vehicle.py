"""A vehicle before its model is trusted: signs, units, speeds, stability.

On course and pitch stability there is a warning where a value is doubtful, and a note where it is usual. A
slender hull without enough lift behind is driven round by the Munk moment (Fossen 2011, chapter 12), which
is a warning. A vehicle that is hardly longer than wide has no stable course either, and thrusters hold it.
Held by tests/check/test_check.py and tests/check/test_check_fins.py.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.finding import Finding
from seatrial.base.plain import plain
from seatrial.base.report import listed
from seatrial.check.file_check import FileCheck, note, warning
from seatrial.problem.settings import STRIPS
from seatrial.vehicle.actuators import NOMINAL_V, Push, advised_rows, beyond_tables, commanded_rows, pushes
from seatrial.vehicle.stability import Statics, damping_gain, growth, positive_damping, statics
from seatrial.vehicle.steady_state import (
    KNOT_M_S,
    Speed,
    Turn,
    cruise,
    drivers,
    farthest,
    fin_turn,
    refuse_impossible_speed,
    round_speeds_kn,
    rudders,
    speeds,
    turn_kinds,
    turning_senses,
    turns,
    unbounded,
)
from seatrial.vehicle.steady_state import SETTINGS as STEADY_STATE

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class VehicleCheckSettings:
    """From where on a value of a vehicle file is doubted. Wide limits find wrong units and wrong signs."""

    #: Growth rate, 1/s, up to which a plane is stable: what doubles in ten minutes is as good as stable.
    neutral_growth: float = 1e-3
    #: Share of the top speed at which a plane that is unstable is so at rest.
    slow_share: float = 0.02
    #: Advised share of the speed at which pitch gives way, as the advice of a flight that failed.
    safe_share: float = 0.75
    #: Length over the larger of diameter and height from which on a hull is slender.
    slender_ratio: float = 3.0
    #: Net buoyancy over the weight: a submerged vehicle is trimmed to a few tenths of a per cent.
    net_buoyancy_share: float = 0.05
    #: Density of water, kg/m3: hot water, the Dead Sea.
    densities_kg_m3: tuple[float, float] = (950.0, 1300.0)
    #: Mass over that of the water in the hull's box.
    mass_shares: tuple[float, float] = (0.02, 1.2)
    #: Moment of inertia over that of a solid box of the hull's measures.
    inertia_ratios: tuple[float, float] = (0.1, 10.0)
    #: Moment of inertia over the sum of the other two: values of three digits may pass the bound of a body.
    triangle_ratio: float = 1.005
    #: Added mass over the vehicle's own.
    added_mass_ratio: float = 10.0
    #: Rate, rad/s, of a servo: fast ones move 60 degrees in 0.05 s, with a margin.
    servo_rate: float = 25.0
    servo_lag_s: float = 2.0  #: Lag or dead time, s: servos lag by less than a second.
    motor_lag_s: float = 10.0  #: Lag or dead time of a motor, s.
    #: Thrust of an actuator over the weight.
    thrust_ratio: float = 10.0
    #: Area of a fin over that of the hull seen from the side.
    fin_area_share: float = 0.5


SETTINGS = VehicleCheckSettings()

# By unit of the command what actuators of underwater vehicles have, with a margin: ducted propellers of large
# vehicles turn with 100 rpm, hobby motors with 10,000; pulses are 1500 +- 600 us from neutral; the strongest
# thrusters push 10 kN.
_LIMITS = {"rpm": (30.0, 2e4), "us": (20.0, 1e3), "N": (0.05, 2e4), "rad": (0.035, 1.571)}

_MOMENT = {"course": ("N", 5), "pitch": ("M", 4)}

_INERTIAS = ("I_x", "I_y", "I_z")


@dataclass(frozen=True, repr=False)
class VehicleCheck(FileCheck, without="findings", also="notes warnings"):
    """What was found about a vehicle; printed, a page of sentences.

    Attributes
    ----------
    pushes
        What each actuator does, ahead, and astern where it can.
    speeds, turns
        Steady motion by simulation, at shares of the largest command.
    cruises
        What it takes to run ahead at given speeds.
    statics
        Buoyancy and natural periods.
    rows
        Rows of the wrench that can be commanded.
    """

    pushes: tuple[Push, ...]
    speeds: tuple[Speed, ...]
    cruises: tuple[Speed, ...]
    turns: tuple[Turn, ...]
    statics: Statics
    rows: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        data = super().to_dict()
        data["pushes"] = [plain(push) | {"sentence": str(push)} for push in self.pushes]
        for key, rows in (("speeds", self.speeds), ("cruises", self.cruises)):
            data[key] = [plain(row) | {"speed_kn": row.speed_kn, "range_km": row.range_km} for row in rows]
        data["statics"]["net_n"] = self.statics.net_n
        return data

    def by_actuator(self) -> list[list[Push]]:
        """The pushes of every actuator: ahead, and astern where it can."""
        pushes: dict[str, list[Push]] = {}
        for push in self.pushes:
            pushes.setdefault(push.actuator, []).append(push)
        return list(pushes.values())


def check_vehicle(
    vehicle: Vehicle, *, voltage_v: float = NOMINAL_V, speeds_kn: Sequence[float] | None = None
) -> VehicleCheck:
    """Check of a vehicle: every actuator's force in words, speeds, turns, statics, stability, warnings.

    Parameters
    ----------
    vehicle : Vehicle
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.
    speeds_kn : sequence of float, optional
        Speeds through the water for which revolutions, power, endurance and range are given, kn; round ones
        up to the top speed when missing.

    Raises
    ------
    VehicleError
        It would be faster than any underwater vehicle: damping is missing, or the thrust has a wrong size.

    Examples
    --------
    >>> import seatrial as st
    >>> print(check_vehicle(st.Vehicle.load("cwolf")).pushes[0])
    +1000 rpm on SbU: 19 N ahead, bow to port, bow down; also 5.2 N to starboard, 5.3 N up
    """
    rows = speeds(vehicle, voltage_v=voltage_v)
    refuse_impossible_speed(vehicle, rows)
    cruises, missed = _cruises(vehicle, rows, speeds_kn, voltage_v)
    turning = turns(vehicle, voltage_v=voltage_v)
    rest = statics(vehicle)
    able = tuple(commanded_rows(vehicle))
    running = [row.speed_m_s for row in rows if row.speed_m_s > 1e-3]
    findings = (
        *_at_rest(rest),
        *_fastest(vehicle, rows, voltage_v),
        *missed,
        *_turns(vehicle, turning),
        *_fin_turn(vehicle, voltage_v),
        note("rows commanded", able=able, lacking=tuple(row for row in AXES if row not in able)),
        *_unused_rows(vehicle, able),
        *(warning("thrust table exceeded", sentence=text) for text in beyond_tables(vehicle, voltage_v)),
        *_static_doubts(rest),
        *implausible(vehicle),
        *(stability(vehicle, running, able) if running else ()),
        *_energy(vehicle, running),
    )
    return VehicleCheck(
        name=vehicle.name,
        description=vehicle.description,
        findings=findings,
        pushes=pushes(vehicle, voltage_v=voltage_v),
        speeds=rows,
        cruises=cruises,
        turns=turning,
        statics=rest,
        rows=able,
    )


def _at_rest(rest: Statics) -> list[Finding]:
    """Net buoyancy and natural periods."""
    notes = [note("buoyancy", net_n=rest.net_n, share=rest.net_n / rest.weight_n)]
    pairs = (("roll", rest.roll_period_s), ("pitch", rest.pitch_period_s))
    if periods := {axis: period for axis, period in pairs if period is not None}:
        notes.append(note("natural periods", periods_s=periods, b_over_g_m=rest.b_over_g_m))
    return notes


def _static_doubts(rest: Statics) -> list[Finding]:
    """Angles that do not right themselves at rest, and a buoyancy that is far from the weight."""
    pairs = (("roll", rest.roll_period_s), ("pitch", rest.pitch_period_s))
    doubts = []
    if unstable := [axis for axis, period in pairs if period is None]:
        doubts.append(warning("not stable at rest", listed(unstable), b_over_g_m=rest.b_over_g_m))
    if abs(rest.net_n) > SETTINGS.net_buoyancy_share * rest.weight_n:
        doubts.append(warning("net buoyancy", net_n=rest.net_n, share=rest.net_n / rest.weight_n))
    return doubts


def _cruises(
    vehicle: Vehicle, rows: tuple[Speed, ...], speeds_kn: Sequence[float] | None, voltage_v: float
) -> tuple[tuple[Speed, ...], list[Finding]]:
    """Cruises at the speeds asked for, and a note for each that cannot be held."""
    if not rows:
        return (), []
    top = rows[-1].speed_kn
    cruises, missed = [], []
    for speed in round_speeds_kn(top) if speeds_kn is None else speeds_kn:
        row = cruise(vehicle, speed * KNOT_M_S, voltage_v=voltage_v)
        if row is not None:
            cruises.append(row)
        elif speeds_kn is not None:
            missed.append(note("speed too high" if speed > top else "speed too low", kn=speed, top_kn=top))
    return tuple(cruises), missed


def _fastest(vehicle: Vehicle, rows: tuple[Speed, ...], voltage_v: float) -> list[Finding]:
    """Top speed and endurance, or why there are none."""
    if not rows:
        missing = not drivers(vehicle)
        return [note("no driver") if missing else note("no steady speed", sentence=unbounded(vehicle))]
    top = rows[-1]
    notes = [note("top speed", m_s=top.speed_m_s, kn=top.speed_kn, command=top.command, unit=top.unit)]
    if (far := farthest(vehicle, voltage_v=voltage_v)) is not None:
        farthest_at = {"m_s": far.speed_m_s, "endurance_h": far.endurance_h, "range_km": far.range_km}
        notes.append(note("endurance", top_h=top.endurance_h, **farthest_at))
    elif top.power_w is not None:
        notes.append(note("no battery"))
    else:
        facts = vehicle.actuator_info()
        kinds = {str(facts[name]["characteristic"]) for name in drivers(vehicle)}
        notes.append(note("no power", characteristics=kinds))
    return notes


def _turns(vehicle: Vehicle, turning: tuple[Turn, ...]) -> list[Finding]:
    """Turns by opposite sides at half of the largest command, and how many never become steady."""
    if not drivers(vehicle):
        return []
    if not turning_senses(vehicle):
        return [] if rudders(vehicle) else [note("no turn")]
    missing = len(turn_kinds(vehicle)) * len(STEADY_STATE.turn_shares) - len(turning)
    steady = [
        note(f"turn {turn.kind}", turn=turn)
        for turn in turning
        if turn.kind in ("under way", "on the spot") and turn.share == 0.5
    ]
    return [note("turns never steady", count=missing), *steady] if missing else steady


def _fin_turn(vehicle: Vehicle, voltage_v: float) -> list[Finding]:
    """A turn by movable fins, where there are any that turn it."""
    steering = rudders(vehicle)
    if not steering or not drivers(vehicle):
        return []
    turn = fin_turn(vehicle, voltage_v=voltage_v)
    names = " and ".join(dict.fromkeys(str(vehicle.actuator_info()[n]["group"] or n) for n in steering))
    return [note("fin turn never steady", names) if turn is None else note("fin turn", names, turn=turn)]


def stability(vehicle: Vehicle, running: Sequence[float], able: Collection[str]) -> list[Finding]:
    """Findings on course and pitch stability at half and top speed, ahead and astern. `running`: steady
    speeds ahead, rising, m/s; `able`: rows that the actuators command independently.
    """
    middle, top = running[len(running) // 2], running[-1]
    slender = _slender(vehicle)
    findings = []
    for plane in _MOMENT:
        worst, rate = max(((s, growth(vehicle, s, plane)) for s in (middle, top)), key=lambda pair: pair[1])
        fins = _fins(vehicle, plane)
        if rate <= SETTINGS.neutral_growth:
            halves = np.log(2.0) / max(-rate, 1e-9)
            findings.append(note("plane stable", plane, halves_s=halves, fins=fins))
        else:
            ahead = {"m_s": worst, "doubles_s": np.log(2.0) / rate, "fins": fins}
            limit = 0.0 if fins or slender else _steady_to(vehicle, plane, worst)
            if _MOMENT[plane][0] in able and not slender and not fins:
                findings.append(note("plane unstable and held", plane, **ahead))
            elif limit > 0.0:
                safe = SETTINGS.safe_share * limit
                findings.append(warning("plane stable up to", plane, m_s=limit, safe_m_s=safe))
            else:
                findings.append(warning("plane unstable", plane, **ahead, slender=slender))
        astern = growth(vehicle, -0.5 * middle, plane)
        if astern > SETTINGS.neutral_growth:
            doubles = np.log(2.0) / astern
            findings.append(note("plane unstable astern", plane, m_s=0.5 * middle, doubles_s=doubles))
    return findings


def _steady_to(vehicle: Vehicle, plane: str, top_m_s: float) -> float:
    """Speed ahead up to which a plane is stable without control, m/s, by bisection; 0 where it never is."""
    low, high = 0.0, top_m_s
    if growth(vehicle, SETTINGS.slow_share * top_m_s, plane) > SETTINGS.neutral_growth:
        return 0.0
    while high - low > 0.005:
        middle = 0.5 * (low + high)
        grows = growth(vehicle, middle, plane) > SETTINGS.neutral_growth
        low, high = (low, middle) if grows else (middle, high)
    return low


def _fins(vehicle: Vehicle, plane: str) -> list[str]:
    """Movable fins that steer in the plane, by group where they have one."""
    matrix, row = np.asarray(vehicle.allocation_matrix()), _MOMENT[plane][1]
    facts = vehicle.actuator_info()
    names = [
        str(facts[name]["group"] or name)
        for k, name in enumerate(vehicle.actuators)
        if facts[name]["kind"] == "fin" and abs(matrix[row, k]) > 0.1 * np.abs(matrix[3:, k]).max()
    ]
    return list(dict.fromkeys(names))


def _slender(vehicle: Vehicle) -> bool:
    """Whether the hull is slender; one without measures is taken for slender."""
    box = vehicle.geometry()
    return not box or box["length"] > SETTINGS.slender_ratio * max(box["diameter"], box["height"])


def _energy(vehicle: Vehicle, running: Sequence[float]) -> list[Finding]:
    """A motion to which damping and lift add energy."""
    gain = damping_gain(vehicle, [s for speed in (running or [1.0]) for s in (speed, -speed)])
    if gain is None:
        return []
    fins = any(facts["kind"] == "fin" for facts in vehicle.actuator_info().values())
    values = {"m_s": gain.speed_m_s, "motion": gain.words, "power_w": gain.power_w, "fins": fins}
    return [warning("energy added", **values)]


def implausible(vehicle: Vehicle) -> list[Finding]:
    """Values that are probably wrong: units, signs, rows that no actuator commands."""
    hull = (_density, _size, _inertia, _triangle, _signs)
    actuators = (_motors, _ranges, _thrust, _strips, _tether, _positions, _rows)
    return [finding for doubts in (*hull, *actuators) for finding in doubts(vehicle)]


def _density(vehicle: Vehicle) -> list[Finding]:
    rho = vehicle.environment()["rho"]
    least, most = SETTINGS.densities_kg_m3
    return [] if least <= rho <= most else [warning("density", rho_kg_m3=rho)]


def _size(vehicle: Vehicle) -> list[Finding]:
    values, box = vehicle.coefficients(), vehicle.geometry()
    if not box or _density(vehicle):  # without the density no mass of water is known
        return []
    displaced = vehicle.environment()["rho"] * box["length"] * box["diameter"] * box["height"]
    share = values["m"] / displaced
    least, most = SETTINGS.mass_shares
    numbers = {"m_kg": values["m"], "displaced_kg": displaced, "percent": 100.0 * share}
    if share > most:
        return [warning("mass above displaced", **numbers)]
    return [warning("mass far below displaced", **numbers)] if share < least else []


def _inertia(vehicle: Vehicle) -> list[Finding]:
    values, box = vehicle.coefficients(), vehicle.geometry()
    if not box:
        return []
    spans = {
        "I_x": (box["diameter"], box["height"]),
        "I_y": (box["length"], box["height"]),
        "I_z": (box["length"], box["diameter"]),
    }
    ratios = {name: values[name] * 12.0 / (values["m"] * (a * a + b * b)) for name, (a, b) in spans.items()}
    least, most = SETTINGS.inertia_ratios
    return [
        warning("inertia", name, kg_m2=values[name], ratio=ratio)
        for name, ratio in ratios.items()
        if not least < ratio < most
    ]


def _triangle(vehicle: Vehicle) -> list[Finding]:
    """No body has a moment of inertia above the sum of the other two, whatever point they are about."""
    values = vehicle.coefficients()
    doubts = []
    for name in _INERTIAS:
        others = [other for other in _INERTIAS if other != name]
        most = sum(values[other] for other in others)
        if values[name] > SETTINGS.triangle_ratio * most:
            sums = {"others": " + ".join(others), "sum_kg_m2": most}
            doubts.append(warning("inertia above sum", name, kg_m2=values[name], **sums))
    return doubts


class _ByFault:
    """Names of actuators by the fault that they share: one finding names all of them."""

    def __init__(self) -> None:
        self._names: defaultdict[tuple[str, tuple[tuple[str, Any], ...]], list[str]] = defaultdict(list)

    def add(self, kind: str, name: str, **values: Any) -> None:
        """Notes a fault of an actuator."""
        self._names[kind, tuple(values.items())].append(name)

    def findings(self) -> list[Finding]:
        """A warning per fault."""
        return [
            warning(kind, listed(list(dict.fromkeys(names))), **dict(values))
            for (kind, values), names in self._names.items()
        ]


def _motors(vehicle: Vehicle) -> list[Finding]:
    """Motors whose least speed lies above their largest."""
    faults = _ByFault()
    for name, facts in vehicle.actuator_info().items():
        for side in ("ahead", "astern"):
            least, most = float(facts[f"minimum_{side}"]), float(facts[f"maximum_{side}"])
            if least > most > 0.0:
                faults.add("least speed above largest", name, side=side, least=least, most=most)
    return faults.findings()


def _ranges(vehicle: Vehicle) -> list[Finding]:
    """Limits, lags, areas and thrusts that no actuator of this kind has, as with degrees or percent."""
    values, box = vehicle.coefficients(), vehicle.geometry()
    weight = values["m"] * vehicle.environment()["g"]
    faults = _ByFault()
    for name, facts in vehicle.actuator_info().items():
        fin, unit = facts["kind"] == "fin", str(facts["unit"])
        least, most = _LIMITS[unit]
        for side in ("ahead", "astern"):
            limit = float(facts[f"maximum_{side}"])
            if 0.0 < limit < least or most < limit < np.inf:
                usual = {"least": least, "most": most, "unit": unit}
                faults.add("limit of command", name, side=side, limit=limit, **usual)
        # A lag in ms or a rate in deg/s is a hundred times too large: wide limits find both.
        lag = max(values.get(f"{name}.T_1", 0.0), values.get(f"{name}.T_t", 0.0))
        if lag > (SETTINGS.servo_lag_s if fin else SETTINGS.motor_lag_s):
            faults.add("lag", name, lag_s=lag)
        rate = values.get(f"{name}.n_acc", 0.0)
        if fin and rate > SETTINGS.servo_rate:
            faults.add("servo rate", name, rate=rate, if_degrees=np.deg2rad(rate))
    # An area in cm2 is ten thousand times too large.
    for fin in vehicle.to_dict().get("fins", []):
        area = float(fin["area_m2"])
        if box and area > SETTINGS.fin_area_share * box["length"] * max(box["diameter"], box["height"]):
            faults.add("fin area", str(fin["name"]), area_m2=area)
    for push in pushes(vehicle):
        force = float(np.linalg.norm(push.wrench[:3]))
        if force > SETTINGS.thrust_ratio * weight:
            faults.add("thrust above weight", push.actuator, force_n=force, ratio=force / weight)
    return faults.findings()


def _thrust(vehicle: Vehicle) -> list[Finding]:
    """Thrust falls with the inflow: its slope over the speed is negative."""
    values = vehicle.coefficients()
    wrong = [name for name in vehicle.actuators if values.get(f"{name}.p2", 0.0) > 0.0]
    return [warning("thrust grows with inflow", listed(wrong))] if wrong else []


def _signs(vehicle: Vehicle) -> list[Finding]:
    """Diagonal damping is negative in Fossen's convention, added mass is not far above the vehicle's own."""
    values = vehicle.coefficients()
    doubts = [
        warning("positive damping", name, value=value) for name, value in positive_damping(vehicle).items()
    ]
    for row, axis in zip(AXES, VELOCITIES, strict=True):
        own = values["m"] if row in "XYZ" else values[f"I_{'xyz'['KMN'.index(row)]}"]
        added = -values.get(f"{row}_{axis}dot", 0.0)
        if added > SETTINGS.added_mass_ratio * own or added < 0.0:
            doubts.append(warning("added mass", f"{row}_{axis}dot", value=-added, own=own))
    return doubts


def _strips(vehicle: Vehicle) -> list[Finding]:
    """Cross-flow drag that stands in a vehicle twice: by strips and as quadratic damping."""
    values = vehicle.coefficients()
    return [
        warning("cross-flow drag twice", name, included=both)
        for name, made in STRIPS.items()
        if values.get(name) and (both := [coefficient for coefficient in made if values.get(coefficient)])
    ]


def _tether(vehicle: Vehicle) -> list[Finding]:
    """A tether that is made fast and does nothing."""
    values = vehicle.coefficients()
    if vehicle.to_dict().get("tether") is None or values.get("A_tether") or values.get("k_tether"):
        return []
    return [warning("tether without effect")]


def _positions(vehicle: Vehicle) -> list[Finding]:
    """Actuators and centres that lie outside the hull."""
    box, values = vehicle.geometry(), vehicle.coefficients()
    if not box:
        return []
    half = 0.5 * np.array([box["length"], box["diameter"], box["height"]])
    doubts = [
        warning("actuator outside hull", name, position_m=facts["position"])
        for name, facts in vehicle.actuator_info().items()
        if facts["position"] is not None and np.any(np.abs(facts["position"]) > 2.0 * half)
    ]
    for centre, letter in (("gravity", "g"), ("buoyancy", "b")):
        levers = np.array([values.get(f"{axis}_{letter}", 0.0) for axis in "xyz"])
        if np.any(np.abs(levers) > half):
            doubts.append(warning("centre outside hull", centre, letter=letter))
    return doubts


def _rows(vehicle: Vehicle) -> list[Finding]:
    """What is wrong with the key controllable, and what the actuators can command."""
    able, declared, advised = commanded_rows(vehicle), vehicle.controllable, advised_rows(vehicle)
    doubts = [
        warning("row listed twice", row, count=declared.count(row))
        for row in dict.fromkeys(declared)
        if declared.count(row) > 1
    ]
    if lacking := [row for row in declared if row not in able]:
        return [*doubts, warning("rows not commanded", ", ".join(lacking), advised=advised)]
    if declared and not _steers(declared) and _steers(advised):
        doubts.append(warning("rows do not steer", ", ".join(declared), advised=advised))
    return doubts


def _steers(rows: Collection[str]) -> bool:
    """Whether an autopilot can steer with these rows: surge, yaw, and heave or pitch."""
    return {"X", "N"} <= set(rows) and bool({"Z", "M"} & set(rows))


def _unused_rows(vehicle: Vehicle, able: Collection[str]) -> list[Finding]:
    """Rows that the actuators can command and the vehicle file leaves out of controllable."""
    unused = [row for row in able if row not in vehicle.controllable]
    return [note("rows left out", ", ".join(unused))] if unused else []
