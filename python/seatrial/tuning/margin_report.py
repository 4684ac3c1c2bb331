"""Margins of an autopilot's loops for the report, by python-control.

Each row of the wrench is opened alone, the others closed: a discrete `control.StateSpace`, of which
`control.disk_margins` takes the balanced disk margin, and as frequency response data
`control.stability_margins` the gain and phase margins. Not from the state space: its polynomials have the
poles of the dead time at 0 and of the integrators at 1 several times over, and with CWolf's 22 states a gain
margin of 4.5 comes out as 1.2. Source: Seiler, Packard and Gahinet (2020), *An introduction to disk
margins*, IEEE Control Systems 40(5). Held by tests/test_margin_constraint.py.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.tuning.working_points import reachable_points, working_points

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.closed_loop import Sampled
    from seatrial.sensors.sensor import Sensor

__all__ = ["ReportedMargins", "margin_table", "open_loop", "report_margins"]

Array = NDArray[np.float64]

_FREQUENCIES = 400
_BELOW_NYQUIST = 0.9999  # at half the sampling rate every response is real: it is looked at by itself


@dataclass(frozen=True)
class ReportedMargins:
    """Margins of a loop in a mode at a desired speed in m/s, the other loops closed.

    Each margin is None where nothing bounds it, and so is its frequency in rad/s.

    Attributes
    ----------
    mode, speed_m_s, loop
        Which.
    stable
        Whether nothing grows with all loops closed; otherwise the margins are distances from the other side.
    gain_up_db, gain_up_rad_s
        By how much the gain may rise.
    gain_down_db, gain_down_rad_s
        By how much it may fall, positive.
    phase_deg, phase_rad_s
        Phase margin.
    delay_s, delay_rad_s
        Delay that may be added.
    disk
        Balanced disk margin, at most 2.
    disk_gain_db, disk_phase_deg
        Gain (either way) and phase that it stands for; the gain is None where any is tolerated.
    """

    mode: str
    speed_m_s: float
    loop: str
    stable: bool
    gain_up_db: float | None
    gain_up_rad_s: float | None
    gain_down_db: float | None
    gain_down_rad_s: float | None
    phase_deg: float | None
    phase_rad_s: float | None
    delay_s: float | None
    delay_rad_s: float | None
    disk: float
    disk_gain_db: float | None
    disk_phase_deg: float | None

    def to_dict(self) -> dict[str, Any]:
        """The margins as plain data for JSON."""
        return asdict(self)


def report_margins(
    vehicle: Vehicle,
    autopilot: Autopilot,
    speeds_m_s: Sequence[float] | None = None,
    *,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
) -> list[ReportedMargins]:
    """Margins per mode, speed and loop of an autopilot on a vehicle's model.

    Parameters
    ----------
    vehicle : Vehicle
    autopilot : Autopilot
        PID loops or a regulator.
    speeds_m_s : sequence of float, optional
        Desired speeds, m/s, and the switching speeds between them; the supporting points that the vehicle
        reaches when missing.
    sensors : mapping of str to Sensor, "typical" or a file, optional
        Whose latency and interval the loops bear; perfect ones when missing.

    Examples
    --------
    >>> import seatrial as st
    >>> found = report_margins(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"), [3.021])
    >>> [(row.mode, row.loop, round(row.gain_up_db), round(row.phase_deg)) for row in found]
    [('cruise', 'surge', 38, 95), ('cruise', 'pitch', 28, 89), ('cruise', 'heading', 29, 65)]
    """
    from seatrial.check.autopilot_margins import mode_law, mode_loop, neutral_radius
    from seatrial.control_design.closed_loop import closed, feedback
    from seatrial.tuning.measurement_delay import measurement_delays

    tables: dict[str, Any] = tomllib.loads(autopilot.to_toml())
    if speeds_m_s is None:
        reached = reachable_points(vehicle, autopilot)
        speeds_m_s = [u for u, hit in zip(autopilot.speeds_m_s, reached, strict=True) if hit]
    late = measurement_delays(sensors, vehicle)
    found = []
    for mode, speed in working_points(tables, speeds_m_s):
        at = mode_loop(vehicle, tables, mode, speed, measured_late_s=late)
        law = mode_law(tables, mode, at.loops, speed) + at.known
        radius = np.abs(np.linalg.eigvals(closed(at.system, law))).max()
        stable = bool(radius <= neutral_radius(at.system.period_s))
        gain = feedback(at.system, law)
        for row, loop in enumerate(at.loops):
            margins = _margins(open_loop(at.system, gain, row), at.system.period_s)
            found.append(ReportedMargins(mode, speed, loop, stable, **margins))
    return found


def open_loop(of: Sampled, gain: Array, row: int) -> Any:
    """Discrete `control.StateSpace` of a row opened alone, the others closed by K (rows, state)."""
    import control

    others = [k for k in range(len(gain)) if k != row]
    step = of.phi - of.gamma[:, others] @ gain[others]
    return control.ss(step, of.gamma[:, [row]], gain[[row]], 0.0, of.period_s)


def _margins(loop: Any, period_s: float) -> dict[str, Any]:
    """Margins of an open loop by the names of `ReportedMargins`."""
    import control

    omega = np.geomspace(1e-3, _BELOW_NYQUIST * np.pi / period_s, _FREQUENCIES)
    response = control.frd(loop, omega)
    gains, phases, _, at_gain, at_phase, _ = control.stability_margins(response, returnall=True)
    edge = complex(loop(-1.0))  # a pole may leave through z = -1, half the sampling rate
    if edge.real < 0.0:
        gains, at_gain = np.append(gains, 1.0 / -edge.real), np.append(at_gain, np.pi / period_s)
    decibel = 20.0 * np.log10(gains)
    up, down = decibel > 0.0, decibel <= 0.0
    late = np.deg2rad(phases % 360.0) / at_phase
    disk, disk_gain, disk_phase = (float(value) for value in control.disk_margins(loop, omega))
    least = {
        ("gain_up_db", "gain_up_rad_s"): (decibel[up], at_gain[up]),
        ("gain_down_db", "gain_down_rad_s"): (-decibel[down], at_gain[down]),
        ("phase_deg", "phase_rad_s"): (np.abs(phases), at_phase),
        ("delay_s", "delay_rad_s"): (late, at_phase),
    }
    found: dict[str, Any] = {
        "disk": disk,
        "disk_gain_db": disk_gain if np.isfinite(disk_gain) else None,
        "disk_phase_deg": disk_phase if np.isfinite(disk_phase) else None,
    }
    for names, (values, frequencies) in least.items():
        first = int(np.argmin(values)) if len(values) else None
        for name, column in zip(names, (values, frequencies), strict=True):
            found[name] = None if first is None else float(column[first])
    return found


def margin_table(rows: Sequence[ReportedMargins]) -> str:
    """The margins as a table in text, one line per mode, speed and loop.

    Examples
    --------
    >>> row = ReportedMargins("cruise", 2.0, "heading", True, 29.1, 2.8, None, None, 61.2, 0.35, 3.05, 0.35,
    ...     1.16, 11.5, 60.3)
    >>> print(margin_table([row]))
    mode    m/s    loop     gain up  gain down  phase  delay  disk
                                 dB         dB    deg      s
    cruise   2.00  heading     29.1         -   61.2   3.05  1.16
    """
    lines = [
        "mode    m/s    loop     gain up  gain down  phase  delay  disk",
        "                             dB         dB    deg      s",
    ]

    def number(value: float | None, width: int, digits: int) -> str:
        return f"{'-':>{width}}" if value is None else f"{value:{width}.{digits}f}"

    for row in rows:
        lines.append(
            f"{row.mode:<7} {row.speed_m_s:5.2f}  {row.loop:<7}"
            f"{number(row.gain_up_db, 9, 1)} {number(row.gain_down_db, 10, 1)}"
            f" {number(row.phase_deg, 6, 1)} {number(row.delay_s, 6, 2)} {number(row.disk, 5, 2)}"
            + ("" if row.stable else "  unstable")
        )
    return "\n".join(lines)
