"""An autopilot before it steers: modes, gains, safety in words; with a vehicle what it cannot do there.

The core refuses what does not fit (a loop whose row the vehicle file does not call controllable, an unknown
actuator); here stands what is possible and probably not meant. Held by tests/test_check_autopilot.py.
"""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.check.actuators import NOMINAL_V
from seatrial.check.safety_text import safety_sentences

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle

__all__ = ["AutopilotCheck", "GainRow", "ModeRow", "check_autopilot"]

_UNITS = {"surge": "N", "sway": "N", "heave": "N", "roll": "N m", "pitch": "N m", "heading": "N m"}
_GAINS = ("K_P", "K_I_per_s", "K_D_s")
_POINTS = 6


@dataclass(frozen=True)
class ModeRow:
    """A row of the mode table; no actuators means all."""

    name: str
    from_speed_m_s: float
    loops: tuple[str, ...]
    depth_by: str
    actuators: tuple[str, ...]


@dataclass(frozen=True)
class GainRow:
    """A gain of a loop at the six supporting points, physical: N or N m per m/s, m or rad."""

    loop: str
    gain: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class AutopilotCheck:
    """What was found about an autopilot; printed, a page of sentences.

    Attributes
    ----------
    name, description
        Of the autopilot.
    period_s, control
        Control period, and ``pid`` or ``lqr``.
    speeds_m_s
        Supporting points of the gains.
    modes, gains
        The mode table, and the gains of the loops.
    safety
        A sentence per watch.
    notes, warnings
        Sentences about what is worth knowing, and about what is probably not meant.
    """

    name: str
    description: str
    period_s: float
    control: str
    speeds_m_s: tuple[float, ...]
    modes: tuple[ModeRow, ...]
    gains: tuple[GainRow, ...]
    safety: tuple[str, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        parts = [f"{self.name}: {self.description}".rstrip(": "), *self.notes, *self.safety]
        return "\n".join([*parts, *(f"WARNING {text}" for text in self.warnings)])


def check_autopilot(
    autopilot: Autopilot, *, vehicle: Vehicle | None = None, voltage_v: float = NOMINAL_V
) -> AutopilotCheck:
    """Check of an autopilot, by itself or on a vehicle.

    Parameters
    ----------
    autopilot : Autopilot
    vehicle : Vehicle, optional
        On which it is to work.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

    Raises
    ------
    VehicleError
        The autopilot does not fit the vehicle.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial._core import Autopilot
    >>> found = check_autopilot(Autopilot.load("cwolf"), vehicle=st.Vehicle.load("cwolf"))
    >>> [mode.name for mode in found.modes]
    ['hover', 'cruise']
    """
    tables: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    guidance = tables["guidance"]
    modes = tuple(
        ModeRow(
            name=mode["name"],
            from_speed_m_s=mode.get("from_speed_m_s", 0.0),
            loops=tuple(mode["loops"]),
            depth_by=mode["depth_by"],
            actuators=tuple(mode.get("actuators", ())),
        )
        for mode in tables["modes"]
    )
    hovers = any(mode.depth_by == "heave" for mode in modes)
    notes = [
        f"Control: {tables['control'].upper()} every {autopilot.period_s:g} s",
        f"Guidance: {guidance['method']}, lookahead {guidance['lookahead_m']:g} m, pitch to"
        f" {guidance['pitch_max_deg']:g} deg, speed to {guidance['speed_max_m_s']:g} m/s",
        *_loop_notes(tables),
    ]
    if not hovers:
        notes.append(
            "No mode keeps the depth without speed: station-keeping is a circle of"
            f" {guidance['loiter_radius_m']:g} m"
        )
    warnings: list[str] = []
    if vehicle is not None:
        from seatrial.check.autopilot_vehicle import on_vehicle

        told, wrong = on_vehicle(autopilot, tables, modes, vehicle, voltage_v=voltage_v)
        notes, warnings = notes + told, wrong
    return AutopilotCheck(
        name=autopilot.name,
        description=autopilot.description,
        period_s=autopilot.period_s,
        control=tables["control"],
        speeds_m_s=tuple(autopilot.speeds_m_s),
        modes=modes,
        gains=tuple(_gains(tables)),
        safety=tuple(
            safety_sentences(tables["safety"], hovers=hovers, loiter_radius_m=guidance["loiter_radius_m"])
        ),
        notes=tuple(notes),
        warnings=tuple(warnings),
    )


def _gains(tables: dict[str, Any]) -> list[GainRow]:
    """Gains that are not zero at every point."""
    rows = []
    for loop, table in tables["loops"].items():
        for gain in _GAINS:
            value = table.get(gain, 0.0)
            values = tuple(map(float, np.broadcast_to(value, _POINTS)))
            if any(values):
                rows.append(GainRow(loop, gain, values))
    return rows


def _loop_notes(tables: dict[str, Any]) -> list[str]:
    notes = []
    for loop, table in tables["loops"].items():
        shaped = table.get("reference_rad_s")
        reference = f"reference filtered at {shaped:g} rad/s" if shaped else "reference not filtered"
        notes.append(
            f"{loop.capitalize()}: at most {table['tau_max']:g} {_UNITS[loop]}, {reference}, anti-windup"
            f" {table['anti_windup']}"
        )
    if tables.get("lqr"):
        notes.append(f"LQR: gains of {', '.join(table['mode'] for table in tables['lqr'])}")
    return notes
