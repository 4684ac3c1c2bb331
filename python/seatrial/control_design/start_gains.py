"""Start values of an autopilot from the vehicle's model: modes, supporting speeds, gains and limits.

Which loops there are follows from the rows that the actuators can command; gains are placed by
`seatrial.control_design.loop_gains` and tried by `seatrial.control_design.loop_trial`. The largest demand
of a row is 80 % of its reach, half of it where the actuators that give it also drive ahead.

The reference filters are five times as fast as their position loops: they hold back a jump, not the
guidance. A loop has at most 0.2/T of the delay T of its actuators, so that these can still follow a reference
of 1/T. Held by tests/test_control_design_start.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.check.actuators import NOMINAL_V, bollard, command
from seatrial.check.performance import drivers
from seatrial.check.stability import neutral_fins
from seatrial.control_design.authority import LOOPS, ROWS, Delay, commandable, delays, reach
from seatrial.control_design.loop_gains import LoopGain, kind
from seatrial.control_design.loop_trial import Trial
from seatrial.control_design.mode_table import CRUISE, Mode, flies, mode_table, supporting_speeds, top_speeds

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["LoopStart", "StartGains", "start_gains"]

Array = NDArray[np.float64]

_SHARED, _ALONE = 0.5, 0.8  # share of the reach for a row whose actuators also drive ahead, and for another
_REFERENCE = {"position": 5.0, "speed": 2.0}  # natural frequency of the reference filter over the bandwidth
_DOPPLER_NOISE_M_S = 0.008  # of one ping, that of the typical sensors
_NOISE_SHARE = 0.25


@dataclass(frozen=True)
class LoopStart:
    """A loop's gains at the six supporting speeds; tau_max in N or N m, reference filter in rad/s."""

    gains: tuple[LoopGain, ...]
    tau_max: float
    reference_rad_s: float


@dataclass(frozen=True)
class StartGains:
    """Start values of an autopilot; ``left_out`` says per row why it is not commanded.

    ``late`` is per row the delay that the gains are made for; ``weak`` lists mode, speed and loops where no
    bandwidth met the demands on margins and step response.
    """

    speeds_m_s: tuple[float, ...]
    top_m_s: tuple[float, float]
    loops: dict[str, LoopStart]
    modes: tuple[Mode, ...]
    left_out: dict[str, str]
    period_s: float
    late: dict[str, Delay]
    weak: tuple[str, ...] = field(default=())


def start_gains(vehicle: Vehicle, *, period_s: float = 0.1, voltage_v: float = NOMINAL_V) -> StartGains:
    """Start values of an autopilot for a vehicle.

    Parameters
    ----------
    vehicle : Vehicle
    period_s : float
        Control period, s.
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

    Raises
    ------
    ValueError
        A vehicle that cannot be steered: no thrust ahead, no heading, or neither heave force nor pitch.

    Examples
    --------
    >>> import seatrial as st
    >>> start = start_gains(st.Vehicle.load("cwolf"))
    >>> [(mode.name, mode.depth_by) for mode in start.modes]
    [('hover', 'heave'), ('cruise', 'pitch')]
    >>> sorted(start.left_out)
    ['K', 'Y']
    """
    top = top_speeds(vehicle, voltage_v=voltage_v)
    left_out = commandable(vehicle, 0.6 * top[1], voltage_v=voltage_v)
    rows = "".join(row for row in ROWS if row not in left_out)
    if "X" not in rows or "N" not in rows or not {"Z", "M"} & set(rows):
        missing = "; ".join(f"{row}: {why}" for row, why in left_out.items())
        raise ValueError(
            f"expected a vehicle that commands X, N and Z or M; {missing};"
            " give its actuators in the vehicle file"
        )
    late = {row: _with_hold(delay, period_s) for row, delay in delays(vehicle, rows).items()}
    rows = _without_stiff_roll(vehicle, rows, late, left_out)
    speeds = supporting_speeds(vehicle, rows, top)
    modes = mode_table(vehicle, rows, top)
    limits = [reach(vehicle, u, rows, voltage_v=voltage_v) for u in speeds]
    shares = {row: _share(vehicle, row) for row in rows}
    # Ahead only: a propeller that turns against the flow pushes harder than it can be asked to.
    slow = [limit for u, limit in zip(speeds, limits, strict=True) if u >= 0.0]
    slow += [reach(vehicle, 0.0, rows, voltage_v=voltage_v)] if "Z" in rows else []
    largest = {row: max(_usable(limit, row, shares) for limit in slow) for row in rows}
    largest["X"] = max(largest["X"], 1.05 * _drag(vehicle, speeds[-1]))
    design = Trial(vehicle, rows, late, period_s, top[1], _quiet(vehicle, voltage_v))
    found: dict[str, list[LoopGain]] = {LOOPS[ROWS.index(row)]: [] for row in rows}
    weak: list[str] = []
    for u, limit in zip(speeds, limits, strict=True):
        allowed = {row: _usable(limit, row, shares) for row in rows}
        gains, short = design.at(u, allowed, modes)
        weak += short
        for loop, gain in gains.items():
            found[loop].append(gain)
    loops = {}
    for loop, placed in found.items():
        used = [
            gain.bandwidth
            for u, gain in zip(speeds, placed, strict=True)
            if u > -CRUISE * top[1] and any(loop in m.loops and flies(m, modes, u) for m in modes)
        ]
        reference = _REFERENCE[kind(loop)] * float(np.median(used or [gain.bandwidth for gain in placed]))
        loops[loop] = LoopStart(tuple(placed), largest[ROWS[LOOPS.index(loop)]], reference)
    return StartGains(tuple(speeds), top, loops, modes, left_out, period_s, late, tuple(weak))


def _quiet(vehicle: Vehicle, voltage_v: float) -> float:
    """Surge gain in N per m/s at which noise of the velocity asks for a quarter of the least thrust, or inf.

    More of it starts and stops propellers that are asked for about their minimum revolutions.
    """
    facts = vehicle.actuator_info()
    least = {}
    for name, sense in drivers(vehicle).items():
        side = "minimum_ahead" if sense > 0.0 else "minimum_astern"
        least[name] = command(facts[name], sense * float(facts[name][side]) / _largest(facts[name], sense))
    thrust = float(bollard(vehicle, least, voltage_v=voltage_v)[0])
    return _NOISE_SHARE * thrust / _DOPPLER_NOISE_M_S if thrust > 0.0 else np.inf


def _largest(facts: dict[str, Any], sense: float) -> float:
    return float(facts["maximum_ahead" if sense > 0.0 else "maximum_astern"])


def _with_hold(delay: Delay, period_s: float) -> Delay:
    """The delay with the half period that a held demand is late on average."""
    return replace(delay, ramp_s=delay.ramp_s + 0.5 * period_s)


def _share(vehicle: Vehicle, row: str) -> float:
    matrix = np.abs(np.asarray(vehicle.allocation_matrix()))[ROWS.index(row)]
    driving = [k for k, name in enumerate(vehicle.actuators) if name in drivers(vehicle)]
    return _SHARED if row != "X" and matrix[driving].max(initial=0.0) > 0.5 * matrix.max() else _ALONE


def _usable(limit: dict[str, Array], row: str, shares: dict[str, float]) -> float:
    low, high = limit[row]
    return shares[row] * float(high if row == "X" else min(high, -low))


def _drag(vehicle: Vehicle, speed: float) -> float:
    nu = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    force = sum(np.asarray(term) for term in vehicle.forces(nu, np.zeros(3)).values())
    return -float((force + neutral_fins(vehicle, nu[None])[0])[0])


def _without_stiff_roll(vehicle: Vehicle, rows: str, late: dict[str, Delay], left_out: dict[str, str]) -> str:
    """The rows without a roll moment that is too slow for the hull's own righting."""
    if "K" not in rows:
        return rows
    tilted = np.zeros((2, 3))
    tilted[:, 0] = [1e-5, -1e-5]
    moment = np.asarray(vehicle.forces(np.zeros((2, 6)), tilted)["restoring"])[:, 3]
    own = np.sqrt(max(-(moment[0] - moment[1]) / 2e-5, 0.0) / np.asarray(vehicle.mass_matrix())[3, 3])
    possible = 0.2 / late["K"].total_s
    if own <= 2.0 * possible:
        return rows
    left_out["K"] = (
        f"the hull rights itself at {own:.1f} rad/s, faster than the actuators' {possible:.1f} rad/s allow"
    )
    return rows.replace("K", "")
