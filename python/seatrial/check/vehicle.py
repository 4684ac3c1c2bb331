"""A vehicle before its model is trusted: signs, speeds, stability, implausible numbers.

On course and pitch stability there is a warning where a value is doubtful, and a note where it is usual. A
slender hull without enough lift behind is driven round by the Munk moment (Fossen 2011, chapter 12), which
is a warning. A vehicle that is hardly longer than wide has no stable course either, and thrusters hold it.
Held by tests/check/test_check.py and tests/check/test_check_fins.py.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.report import Reported
from seatrial.check.plausibility import implausible, unused_rows
from seatrial.vehicle.actuators import NOMINAL_V, Push, beyond_tables, pushes
from seatrial.vehicle.authority import commanded_rows
from seatrial.vehicle.stability import Statics, damping_gain, growth, statics
from seatrial.vehicle.steady_state import (
    KNOT_M_S,
    TURN_SHARES,
    FinTurn,
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

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_GROWS = 1e-3  # 1/s; what grows more slowly than in ten minutes is as good as stable

_SLOW = 0.02  # of the top speed: what is unstable even there, is so at rest
_MARGIN = 0.75  # of the speed at which pitch gives way: what the advice of a flight that failed leaves, too

_SLENDER = 3.0  # length over the larger of diameter and height

_LIFT = {"course": "N_uv, N_ur, Y_uv, Y_ur", "pitch": "M_uw, M_uq, Z_uw, Z_uq"}

_MOMENT = {"course": ("N", 5), "pitch": ("M", 4)}


def stability_sentences(
    vehicle: Vehicle, running: Sequence[float], able: Collection[str]
) -> tuple[list[str], list[str]]:
    """Notes and warnings on course and pitch stability at half and top speed, ahead and astern.

    `running` are steady speeds ahead, rising, m/s; `able` rows of the wrench that the actuators command
    independently.
    """
    middle, top = running[len(running) // 2], running[-1]
    notes, warnings = [], []
    for plane in _LIFT:
        worst, rate = max(((s, growth(vehicle, s, plane)) for s in (middle, top)), key=lambda pair: pair[1])
        held = ", fins at neutral" if _fins(vehicle, plane) else ""
        if rate <= _GROWS:
            time = np.log(2.0) / max(-rate, 1e-9)
            notes.append(
                f"{plane.capitalize()} stable ahead{held}: a disturbance halves in {_time(time)} or less"
            )
        else:
            doubles = f"unstable at {worst:.2f} m/s{held}: without control a disturbance doubles in"
            doubles += f" {_time(np.log(2.0) / rate)}"
            limit = 0.0 if held or _slender(vehicle) else _steady_to(vehicle, plane, worst)
            if _MOMENT[plane][0] in able and not _slender(vehicle) and not held:
                notes.append(
                    f"{plane.capitalize()} {doubles}; usual for a hull that is not slender, and its actuators"
                    " can hold it"
                )
            elif limit > 0.0:
                warnings.append(
                    f"{plane} rights itself up to {limit:.2f} m/s, and no actuator holds it above: {SLOWER}"
                    f" {_MARGIN * limit:.2f} m/s or slower, or raise the buoyancy over the weight (z_b)"
                )
            else:
                warnings.append(f"{plane} {doubles}. {_cure(vehicle, plane)}")
        astern = growth(vehicle, -0.5 * middle, plane)
        if astern > _GROWS:
            notes.append(
                f"{plane.capitalize()} unstable astern: at {0.5 * middle:.2f} m/s a disturbance doubles in"
                f" {_time(np.log(2.0) / astern)}"
            )
    return notes, warnings


def _steady_to(vehicle: Vehicle, plane: str, top_m_s: float) -> float:
    """Speed ahead up to which a plane is stable without control, m/s, by bisection; 0 where it never is."""
    low, high = 0.0, top_m_s
    if growth(vehicle, _SLOW * top_m_s, plane) > _GROWS:
        return 0.0
    while high - low > 0.005:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if growth(vehicle, middle, plane) > _GROWS else (middle, high)
    return low


def _cure(vehicle: Vehicle, plane: str) -> str:
    lift = _LIFT[plane]
    fins = _fins(vehicle, plane)
    if not fins and not _slender(vehicle):
        remedy = "Usual for a hull that is not slender, but no actuator holds it: keep the vehicle slower"
        return remedy + (", or raise the buoyancy over the weight (z_b)" if plane == "pitch" else "")
    if not fins:
        return (
            f"Lift of hull and fixed fins ({lift}) balances the Munk moment of a slender hull; give it where"
            " the vehicle has fins"
        )
    return (
        f"Too little lift aft against the Munk moment; {IF_STABLE}, check {lift} of the"
        f" hull, and area and C_L_alpha of {' and '.join(fins)}"
    )


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
    return not box or box["length"] > _SLENDER * max(box["diameter"], box["height"])


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 99.5 else f"{seconds / 60.0:.0f} min"


_NO_POWER = {"direct": "thrust commanded in newtons", "table": "a table of thrust"}


@dataclass(frozen=True, repr=False)
class VehicleCheck(Reported):
    """What was found about a vehicle; printed, a page of sentences.

    Attributes
    ----------
    name, description
        Of the vehicle.
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
    notes, warnings
        Sentences about what is worth knowing, and about what is probably wrong.
    """

    name: str
    description: str
    pushes: tuple[Push, ...]
    speeds: tuple[Speed, ...]
    cruises: tuple[Speed, ...]
    turns: tuple[Turn, ...]
    statics: Statics
    rows: tuple[str, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        data = asdict(self)
        data["pushes"] = [asdict(push) | {"sentence": str(push)} for push in self.pushes]
        for key, rows in (("speeds", self.speeds), ("cruises", self.cruises)):
            data[key] = [asdict(row) | {"speed_kn": row.speed_kn, "range_km": row.range_km} for row in rows]
        data["statics"]["net_n"] = self.statics.net_n
        return data

    def sentences(self) -> list[str]:
        """A sentence per actuator, its directions in one."""
        return [
            " | ".join([str(first), *(f"{push.step:+g}: {push.words}" for push in others)])
            for first, *others in self.by_actuator()
        ]

    def by_actuator(self) -> list[list[Push]]:
        """The pushes of every actuator: ahead, and astern where it can."""
        pushes: dict[str, list[Push]] = {}
        for push in self.pushes:
            pushes.setdefault(push.actuator, []).append(push)
        return list(pushes.values())


IF_STABLE = "if the real vehicle is stable"
SLOWER = "plan missions at"


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
        Speeds through the water at which revolutions, power, endurance and range are told, kn; round ones up
        to the top speed when missing.

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
    notes = [
        *_statics_notes(rest),
        *_speed_notes(vehicle, rows, voltage_v),
        *missed,
        *_turn_notes(vehicle, turning),
        *_fin_turn_notes(vehicle, voltage_v),
        _row_note(able),
        *unused_rows(vehicle, able),
    ]
    warnings = [*beyond_tables(vehicle, voltage_v), *_static_warnings(rest), *implausible(vehicle)]
    if running:
        motion, unstable = stability_sentences(vehicle, running, able)
        notes, warnings = notes + motion, warnings + unstable
    gain = damping_gain(vehicle, [s for speed in (running or [1.0]) for s in (speed, -speed)])
    if gain is not None:
        warnings.append(
            f"{_forces(vehicle)} add energy: at {gain.speed_m_s:+.2f} m/s along x a disturbance of"
            f" {gain.words} receives {gain.power_w:.3g} W; check signs and sizes of the off-diagonal and lift"
            " coefficients"
        )
    return VehicleCheck(
        name=vehicle.name,
        description=vehicle.description,
        pushes=pushes(vehicle, voltage_v=voltage_v),
        speeds=rows,
        cruises=cruises,
        turns=turning,
        statics=rest,
        rows=able,
        notes=tuple(notes),
        warnings=tuple(warnings),
    )


def _forces(vehicle: Vehicle) -> str:
    """What takes energy from a vehicle."""
    fins = any(facts["kind"] == "fin" for facts in vehicle.actuator_info().values())
    return "damping, lift and fins at neutral" if fins else "damping and lift"


def _statics_notes(rest: Statics) -> list[str]:
    share = 100.0 * rest.net_n / rest.weight_n
    kind, motion = ("buoyant", "rises") if rest.net_n > 0.0 else ("heavy", "sinks")
    buoyancy = (
        "neutrally buoyant"
        if abs(share) < 0.01
        else f"{abs(rest.net_n):.3g} N {kind} ({_percent(share)} of its weight): it {motion} with motors"
        " stopped"
    )
    notes = [f"Buoyancy: {buoyancy}"]
    periods = [("roll", rest.roll_period_s), ("pitch", rest.pitch_period_s)]
    spoken = ", ".join(f"{name} {period:.3g} s" for name, period in periods if period is not None)
    if spoken:
        notes.append(
            f"Natural periods: {spoken} (centre of buoyancy {1e3 * rest.b_over_g_m:.3g} mm above gravity)"
        )
    return notes


def _static_warnings(rest: Statics) -> list[str]:
    lines = []
    if unstable := [
        n for n, p in (("roll", rest.roll_period_s), ("pitch", rest.pitch_period_s)) if p is None
    ]:
        place = f"is {1e3 * abs(rest.b_over_g_m):.3g} mm below" if rest.b_over_g_m < 0.0 else "is not above"
        lines.append(
            f"{' and '.join(unstable)} not stable at rest: the centre of buoyancy {place} the centre of"
            " gravity; z points down, so z_b has to be smaller than z_g"
        )
    if abs(rest.net_n) > 0.05 * rest.weight_n:
        lines.append(
            f"B - m g = {rest.net_n:+.4g} N is {_percent(100.0 * rest.net_n / rest.weight_n)} of the weight;"
            " a submerged vehicle is trimmed to a few tenths of a per cent. Is B in N?"
        )
    return lines


def _percent(share: float) -> str:
    """A share in per cent with its sign: two digits of a small one, no decimals of a large one."""
    return f"{share:+.0f} %" if abs(share) >= 9.95 else f"{share:+.2g} %"


def _cruises(
    vehicle: Vehicle, rows: tuple[Speed, ...], speeds_kn: Sequence[float] | None, voltage_v: float
) -> tuple[tuple[Speed, ...], list[str]]:
    """Cruises at the speeds asked for, and a sentence for each that cannot be held."""
    if not rows:
        return (), []
    top = rows[-1].speed_kn
    asked = round_speeds_kn(top) if speeds_kn is None else speeds_kn
    cruises, missed = [], []
    for speed in asked:
        row = cruise(vehicle, speed * KNOT_M_S, voltage_v=voltage_v)
        if row is not None:
            cruises.append(row)
        elif speeds_kn is not None:
            limit = f"more than its top speed of {top:.1f} kn"
            slow = "less than the slowest that its motors hold"
            missed.append(f"Speed: {speed:g} kn is {limit if speed > top else slow}")
    return tuple(cruises), missed


def _speed_notes(vehicle: Vehicle, rows: tuple[Speed, ...], voltage_v: float) -> list[str]:
    if not rows:
        return (
            ["Speed: no actuator drives ahead"] if not drivers(vehicle) else [f"Speed: {unbounded(vehicle)}"]
        )
    top = rows[-1]
    notes = [f"Top speed: {top.speed_m_s:.2f} m/s ({top.speed_kn:.1f} kn) at {top.command:.4g} {top.unit}"]
    if (far := farthest(vehicle, voltage_v=voltage_v)) is not None:
        notes.append(
            f"Endurance: {top.endurance_h:.2g} h at top speed; farthest at {far.speed_m_s:.2f} m/s:"
            f" {far.endurance_h:.2g} h, {far.range_km:.0f} km"
        )
    elif top.power_w is not None:
        notes.append("Endurance: not known without [power]: hotel_w and battery_wh")
    else:
        facts = vehicle.actuator_info()
        kinds = {str(facts[name]["characteristic"]) for name in drivers(vehicle)}
        silent = [words for kind, words in _NO_POWER.items() if kind in kinds]
        why = " and ".join(silent) or "a characteristic without power_w_s3"
        notes.append(f"Endurance: not known; {why} says nothing about power")
    return notes


def _turn_notes(vehicle: Vehicle, turning: tuple[Turn, ...]) -> list[str]:
    if not drivers(vehicle):
        return []
    if not turning_senses(vehicle):
        if rudders(vehicle):
            return []
        return ["Turn: not computed; no two actuators that drive ahead lie on opposite sides"]
    missing = len(turn_kinds(vehicle)) * len(TURN_SHARES) - len(turning)
    notes = [f"Turn: {missing} of the turns tried never become steady and are left out"] if missing else []
    for turn in turning:
        if turn.kind == "under way" and turn.share == 0.5:
            notes.append(
                f"Turn under way, outer side at {turn.command:.4g} {turn.unit}, inner at half: radius"
                f" {_radius(turn)}, {abs(turn.rate_deg_s):.1f} deg/s at {turn.speed_m_s:.2f} m/s"
            )
        elif turn.kind == "on the spot" and turn.share == 0.5:
            notes.append(
                f"Turn on the spot, both sides opposed at {turn.command:.4g} {turn.unit}:"
                f" {abs(turn.rate_deg_s):.1f} deg/s (O moves at {turn.speed_m_s:.2f} m/s)"
            )
    return notes


def _fin_turn_notes(vehicle: Vehicle, voltage_v: float) -> list[str]:
    """A turn by movable fins, where there are any that turn it."""
    steering = rudders(vehicle)
    if not steering or not drivers(vehicle):
        return []
    turn = fin_turn(vehicle, voltage_v=voltage_v)
    names = " and ".join(dict.fromkeys(str(vehicle.actuator_info()[n]["group"] or n) for n in steering))
    if turn is None:
        return [f"Turn by {names}: it never becomes steady"]
    return [
        f"Turn by {names} at {turn.fin_deg:.2g} deg, all ahead at {turn.command:.4g} {turn.unit}: radius"
        f" {_radius(turn)}, {abs(turn.rate_deg_s):.1f} deg/s at {turn.speed_m_s:.2f} m/s, roll and pitch held"
    ]


def _radius(turn: Turn | FinTurn) -> str:
    return f"{turn.radius_m:.{2 if turn.radius_m < 10.0 else 1}f} m"


def _row_note(able: tuple[str, ...]) -> str:
    lacking = [row for row in "XYZKMN" if row not in able]
    return f"Commanded independently: {' '.join(able) or 'nothing'}" + (
        f"; not: {' '.join(lacking)}" if lacking else ""
    )
