"""An autopilot file for a vehicle, computed from its model: TOML text with the reasons as comments.

The keys are those of the core's autopilot file; what the vehicle cannot do stands at the head. Held by
tests/control_design/test_control_design_start.py, tests/cli/test_cli_autopilot.py and
tests/flight/test_acceptance_flights.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seatrial.base.errors import VehicleError
from seatrial.base.work import one_blas_thread
from seatrial.control_design.lqr import lqr_autopilot
from seatrial.control_design.mode_table import Mode
from seatrial.control_design.pole_placement import three_digits
from seatrial.control_design.start_gains import LoopStart, StartGains, start_gains
from seatrial.control_design.start_guidance import guidance, safety
from seatrial.flight.mismatch import started_for
from seatrial.vehicle.actuators import LOOPS, ROWS

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class StartAutopilotSettings:
    """What stands in the allocation of an autopilot file with start values, and its control periods."""

    #: Thrust from which a motor starts, as a share of that at its minimum revolutions: noise stays below it.
    start_share: float = 2.0
    stop_share: float = 0.2  #: Thrust at which it stops, by the same share: it stops late, and seldom.
    other_thruster_cost: float = 0.05  #: Cost of thrusters that do not drive, against those that do.
    #: Shortest control period, s, for which gains are made: the design samples the vehicle's motion.
    shortest_period_s: float = 0.005
    longest_period_s: float = 1.0  #: Longest control period, s.


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
    notes += [f"No {LOOPS[ROWS.index(row)]} loop: {why}." for row, why in start.left_out.items()]
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
