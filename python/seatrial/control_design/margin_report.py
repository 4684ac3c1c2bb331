"""Margins of an autopilot on a vehicle's model in tables: per speed for a glance, per loop for the report.

Both ask `seatrial.control_design.margins` at the operating points of the autopilot. A motion that neither
grows nor dies away within an hour (an undamped roll that nothing commands) counts as neutral. Held by
tests/control_design/test_autopilot_margins.py, and against python-control by
tests/control_design/test_margin_engine.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.control_design.loops import LOOP_OF, Sampled, closed
from seatrial.control_design.lqr import Tolerances
from seatrial.control_design.margins import (
    LawMargins,
    LoopMargins,
    decibel,
    law_margins,
    least_of,
    neutral_radius,
    refined_margins,
    small,
    spectral_radius,
)
from seatrial.control_design.operating_points import (
    AutopilotFacts,
    autopilot_facts,
    measurement_delays,
    mode_at,
    mode_law,
    mode_loop,
    operating_points,
    reachable_speeds,
    top_speeds,
)
from seatrial.control_design.tuning_table import ACCEPTED
from seatrial.vehicle.actuators import NOMINAL_V

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.sensors.sensor import Sensor

_STATES = ("depth", "roll", "pitch", "heading", "speed", "sway", "heave", "roll", "pitch", "heading")
"""The first states of the closed loop in words, rates as what they move."""


@dataclass(frozen=True)
class MarginReportSettings:
    """What the tables of margins name and where they look."""

    named_share: float = 0.3  #: Share of what moves most from which a state is named as growing, too.
    speeds_tried: int = 61  #: Number of speeds at which the sound range is looked for.


SETTINGS = MarginReportSettings()


@dataclass(frozen=True)
class MarginRow(Plain, also="verdict"):
    """Margins of a mode at a desired speed in m/s.

    ``phase_deg``, ``gain`` (a factor upwards) and ``delay_s`` are the least over the rows of the wrench, each
    opened alone, ``sensitivity`` the largest |1/(1 + L)|; in ``doubles_s`` a motion doubles, None where none
    grows, and ``grows`` is what moves most in it. ``loop`` is nearest to its accepted margins, or furthest
    short of them.
    """

    mode: str
    speed_m_s: float
    phase_deg: float
    gain: float
    delay_s: float
    sensitivity: float
    doubles_s: float | None
    grows: str
    trimmed: bool
    loop: str = ""

    @property
    def sound(self) -> bool:
        """Whether nothing grows and the margins are accepted."""
        return self.doubles_s is None and not self._small

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if self.doubles_s is not None:
            return f"{self.grows}: x2 in {self.doubles_s:.2g} s"
        return small_margins(self._small) or "sound"

    @property
    def weakness(self) -> str:
        """What grows, or the weakest loop and the margins that fall short with what is accepted."""
        if self.doubles_s is not None:
            return f"a motion grows ({self.grows})"
        figures = {
            "phase": f"phase {self.phase_deg:.0f} deg of {ACCEPTED.phase_deg:g}",
            "gain": f"gain {float(decibel(self.gain)):.1f} dB of {ACCEPTED.gain_db:g}",
            "sensitivity": f"sensitivity {self.sensitivity:.2g}, at most {ACCEPTED.sensitivity:g}",
        }
        shortfalls = ", ".join(figures[name] for name in self._small)
        return f"{self.loop} has little margin ({shortfalls})" if shortfalls else ""

    @property
    def _small(self) -> tuple[str, ...]:
        return small(self.phase_deg, float(decibel(self.gain)), self.sensitivity)


def small_margins(short: Sequence[str]) -> str:
    """The margins that fall short in words; nothing where none does."""
    return f"little margin: {', '.join(short)}" if short else ""


def autopilot_margins(
    vehicle: Vehicle,
    autopilot: Autopilot,
    *,
    speeds_m_s: Sequence[float] | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
) -> list[MarginRow]:
    """Margins of the mode that works at each desired speed.

    Parameters
    ----------
    vehicle : Vehicle
        The model, as good as it is.
    autopilot : Autopilot
    speeds_m_s : sequence of float, optional
        Desired speeds, m/s; the breakpoints when missing.
    sensors : mapping of str to Sensor, "typical" or a file, optional
        Whose latency and interval the loops bear; perfect ones when missing.

    Examples
    --------
    >>> import seatrial as st
    >>> rows = autopilot_margins(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"))
    >>> sorted({row.mode for row in rows})
    ['cruise', 'hover']
    """
    facts = autopilot_facts(autopilot)
    speeds = facts.speeds_m_s if speeds_m_s is None else speeds_m_s
    late = measurement_delays(sensors, vehicle)
    return [_at(vehicle, facts, mode_at(facts, speed).name, float(speed), late) for speed in speeds]


def sound_speeds(
    vehicle: Vehicle, autopilot: Autopilot, *, voltage_v: float = NOMINAL_V
) -> tuple[float, float] | None:
    """Least and largest desired speed ahead in m/s between which every margin is sound; None without any.

    They are looked for between the breakpoints, too, from the slowest sound one upwards, as far as the
    vehicle goes at that supply voltage. Sensors are perfect.
    """
    points = autopilot.speeds_m_s
    facts = autopilot_facts(autopilot)
    first, last = max(points[0], 0.0), min(points[-1], top_speeds(vehicle, voltage_v=voltage_v)[1])
    least = largest = None
    for speed in np.linspace(first, last, SETTINGS.speeds_tried) if last >= first else ():
        if _at(vehicle, facts, mode_at(facts, speed).name, float(speed)).sound:
            largest = float(speed)
            least = largest if least is None else least
        elif least is not None:  # speeds beyond the first weak one count no more
            break
    return None if least is None or largest is None else (least, largest)


def _at(
    vehicle: Vehicle, facts: AutopilotFacts, mode: str, speed: float, late: Mapping[str, float] | None = None
) -> MarginRow:
    at = mode_loop(vehicle, facts, mode, speed, measured_late_s=late)
    gain = mode_law(facts, mode, at.loops, speed) + at.known
    rows = law_margins(at.system, gain)
    reached = least_of(rows.values())
    doubles, grows = None, ""
    if reached.radius > neutral_radius(at.system.period_s):
        doubles = float(at.system.period_s * np.log(2.0) / np.log(reached.radius))
        grows = _moves_most(closed(at.system, gain), at.system)
    return MarginRow(
        mode=mode,
        speed_m_s=speed,
        phase_deg=reached.phase_deg,
        gain=reached.gain,
        delay_s=reached.delay_s,
        sensitivity=reached.sensitivity,
        doubles_s=doubles,
        grows=grows,
        trimmed=at.trimmed,
        loop=LOOP_OF[min(rows, key=lambda row: _share(rows[row]))],
    )


def _share(of: LawMargins) -> float:
    """Least margin as a share of the accepted one."""
    return min(
        of.phase_deg / ACCEPTED.phase_deg,
        float(decibel(of.gain)) / ACCEPTED.gain_db,
        ACCEPTED.sensitivity / of.sensitivity,
    )


def _moves_most(step: Array, system: Sampled) -> str:
    """What moves, against what is tolerated, in the motion that grows fastest: the most first."""
    values, vectors = np.linalg.eig(step)
    vector = np.abs(vectors[:, np.abs(values).argmax()])
    tolerated = Tolerances().of_states()
    sizes: dict[str, float] = {}
    for place, column in zip(system.seen, system.columns, strict=True):
        if column < len(_STATES):
            name = _STATES[column]
            sizes[name] = max(sizes.get(name, 0.0), float(vector[place]) / tolerated[column])
    much = [name for name in sizes if sizes[name] >= SETTINGS.named_share * max(sizes.values())]
    return " and ".join(sorted(much, key=lambda name: -sizes[name])[:2])


@dataclass(frozen=True)
class ReportedMargins(Plain):
    """Margins of a loop in a mode at a desired speed in m/s, the other loops closed; None, with its frequency
    in rad/s, where nothing bounds one.
    """

    #: `mode`, `speed_m_s`, `loop`: which.
    mode: str
    speed_m_s: float
    loop: str
    #: Whether nothing grows with all loops closed; otherwise the margins are distances from the other side.
    stable: bool
    #: `gain_up_db`, `gain_up_rad_s`: by how much the gain may rise.
    gain_up_db: float | None
    gain_up_rad_s: float | None
    #: `gain_down_db`, `gain_down_rad_s`: by how much it may fall, positive.
    gain_down_db: float | None
    gain_down_rad_s: float | None
    #: `phase_deg`, `phase_rad_s`: phase margin.
    phase_deg: float | None
    phase_rad_s: float | None
    #: `delay_s`, `delay_rad_s`: delay that may be added.
    delay_s: float | None
    delay_rad_s: float | None
    disk: float  #: Balanced disk margin, at most 2.
    #: `disk_gain_db`, `disk_phase_deg`: gain (either way) and phase that it stands for; the gain is None
    #: where any is tolerated.
    disk_gain_db: float | None
    disk_phase_deg: float | None
    sensitivity: float  #: Largest |1/(1 + L)|.

    @property
    def verdict(self) -> str:
        """Unstable, or which margins fall short of the accepted ones; nothing where all are accepted."""
        if not self.stable:
            return "unstable"
        phase, gain = (np.inf if m is None else m for m in (self.phase_deg, self.gain_up_db))
        return small_margins(small(phase, gain, self.sensitivity))


def report_margins(
    vehicle: Vehicle,
    autopilot: Autopilot,
    speeds_m_s: Sequence[float] | None = None,
    *,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
) -> list[ReportedMargins]:
    """Margins per mode, speed and loop of an autopilot, PID loops or a regulator, on a vehicle's model; at
    desired speeds in m/s and the switching speeds between them, by default the breakpoints that the
    vehicle reaches.

    Examples
    --------
    >>> import seatrial as st
    >>> found = report_margins(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"), [3.021])
    >>> [(row.mode, row.loop, round(row.gain_up_db), round(row.phase_deg)) for row in found]
    [('cruise', 'surge', 38, 95), ('cruise', 'pitch', 28, 89), ('cruise', 'heading', 29, 65)]
    """
    facts = autopilot_facts(autopilot)
    late = measurement_delays(sensors, vehicle)
    reported = []
    speeds = reachable_speeds(vehicle, autopilot) if speeds_m_s is None else speeds_m_s
    for mode, speed in operating_points(facts, speeds):
        at = mode_loop(vehicle, facts, mode, speed, measured_late_s=late)
        law = mode_law(facts, mode, at.loops, speed) + at.known
        stable = spectral_radius(at.system, law) <= neutral_radius(at.system.period_s)
        rows, disks = refined_margins(at.system, law)
        for row, loop in enumerate(at.loops):
            reported.append(ReportedMargins(mode, speed, loop, stable, **_reported(rows, disks, row)))
    return reported


def _reported(of: LoopMargins, disks: Array, row: int) -> dict[str, Any]:
    """Margins of a row by the names of `ReportedMargins`, None where nothing bounds them."""
    margins: dict[str, float | None] = {}
    for name, value, rad_s in (
        ("gain_up_db", decibel(of.gain[row]), of.gain_rad_s),
        ("gain_down_db", decibel(of.reduction[row]), of.reduction_rad_s),
        ("phase_deg", of.phase_deg[row], of.phase_rad_s),
        ("delay_s", of.delay_s[row], of.delay_rad_s),
    ):
        bounded = bool(np.isfinite(rad_s[row]))
        margins[name] = float(value) if bounded else None
        margins[f"{name.rpartition('_')[0]}_rad_s"] = float(rad_s[row]) if bounded else None
    half = 0.5 * float(disks[row])
    return margins | {
        "disk": 2.0 * half,
        "disk_gain_db": float(decibel((1.0 + half) / (1.0 - half))) if half < 1.0 else None,
        "disk_phase_deg": float(np.rad2deg(2.0 * np.arctan(half))),
        "sensitivity": float(of.sensitivity[row]),
    }
