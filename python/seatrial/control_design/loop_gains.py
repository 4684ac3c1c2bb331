"""Start gains of one PID loop at one supporting speed, by pole placement on the vehicle's own model.

Position loops (depth, angles): ``K_P = M w^2 + k``, ``K_D = 2 zeta w' M - d``, ``K_I = (K_P - k/2) w /
12``, and ``w (d + K_D) / (2 zeta)`` instead of ``M w^2`` where that is more; speed loops: ``K_P = M w -
d``, ``K_I = M w^2 / 7``. M is the inertia and d the damping of the row, negative where the hull turns by
itself. k is the stiffness with which the flow upsets the hull, and the righting one, which a feed-forward
at the measured attitude takes away; ``w'^2 = w^2 + k/M``.

The bandwidth w is the largest that both the actuators' delay T and their reach allow: ``w T <= 0.2`` (0.4
for a speed loop), which costs about 25 deg of phase at the crossover, and a usual error (`USUAL_ERROR`)
asks for no more than tau_max.

Source: Fossen (2011), section 12.2.7; Åström and Hägglund (2006), section 7.6. Held by
tests/control_design/test_control_design_start.py.

The trial of start gains at one supporting speed: all loops on the coupled motion behind lag and dead
time.

Each loop begins with the bandwidth of `seatrial.control_design.loop_gains`; it is moved until the motion
is stable with and without the restoring feed-forward, the phase margin is 35 deg, and the step response
overshoots less than 24 % and settles. Held by tests/control_design/test_control_design_start.py.

Gains per sample, as a digital PID without a period writes them, turned into physical ones.

Equation (54) of Taubert et al. (2014) sums errors and takes differences from sample to sample, so that K_I
and K_D absorb the control period. Physical gains do not: another period does not retune the loop.
Held by tests/control_design/test_per_sample.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import VehicleError
from seatrial.control_design.loops import (
    INTEGRATED,
    STATES,
    Plant,
    closed,
    margins,
    plant,
    restoring_law,
    sampled,
    step_response,
)
from seatrial.control_design.mode_table import Mode, flies
from seatrial.control_design.trim import Trim, trim
from seatrial.vehicle.authority import LOOPS, ROWS, Delay

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = [
    "CURRENT_M_S",
    "OVERSHOOT",
    "PHASE_DEG",
    "USUAL_ERROR",
    "LoopGain",
    "Trial",
    "law",
    "loop_gain",
    "physical_gains",
    "three_digits",
]

USUAL_ERROR = {"heave": 2.0, "roll": np.deg2rad(30.0), "pitch": np.deg2rad(30.0), "heading": np.deg2rad(40.0)}
"""Error of a position loop, m or rad, that may just ask for the largest demand."""

USUAL_SHARE = 0.3
"""The same of a speed loop, as a share of the top speed."""

DAMPING_RATIO = 0.9

DELAY_SHARE = {"position": 0.2, "speed": 0.4}

INTEGRAL_SHARE = {"position": 1.0 / 12.0, "speed": 1.0 / 7.0}

_LEAST, _MOST = 0.25, 3.0  # damping already there, or wanting, moves a gain no further than this

_SHORTEST_S = 0.1  # delay of navigation and of what a vehicle file does not tell


@dataclass(frozen=True)
class LoopGain:
    """K_P in N or N m per unit of the error (m/s, m, rad), K_I per s, K_D times s; bandwidth in rad/s."""

    k_p: float
    k_i: float
    k_d: float
    bandwidth: float


@dataclass(frozen=True)
class Axis:
    """One row: inertia, damping, stiffness to add in SI, delay in s, largest demand in N or N m.

    ``usual_error`` is in m/s, m or rad.
    """

    inertia: float
    damping: float
    stiffness: float
    delay_s: float
    tau_max: float
    usual_error: float


def three_digits(value: float) -> float:
    """A number with three digits: start values are no more certain."""
    return float(f"{value:.3g}")


def kind(loop: str) -> str:
    """Whether a loop controls a "speed" or a "position"."""
    return "speed" if loop in ("surge", "sway") else "position"


def bandwidth(loop: str, axis: Axis) -> float:
    """Largest bandwidth in rad/s that delay and reach allow."""
    by_delay = DELAY_SHARE[kind(loop)] / max(axis.delay_s, _SHORTEST_S)
    usual = axis.tau_max / axis.usual_error
    if kind(loop) == "speed":
        return min(by_delay, usual / axis.inertia)
    against_damping = 2.0 * DAMPING_RATIO * usual / max(axis.damping, 1e-9)
    return min(by_delay, float(np.sqrt(usual / axis.inertia)), against_damping)


def loop_gain(loop: str, axis: Axis, omega: float) -> LoopGain:
    """Gains of a loop for a bandwidth in rad/s.

    Examples
    --------
    >>> axis = Axis(131.3, damping=15.0, stiffness=0.0, delay_s=0.4, tau_max=60.0, usual_error=1.3)
    >>> loop_gain("heading", axis, 0.5)
    LoopGain(k_p=32.825, k_i=1.37, k_d=103.17, bandwidth=0.5)
    """
    share = INTEGRAL_SHARE[kind(loop)] * omega
    if kind(loop) == "speed":
        full = axis.inertia * omega
        k_p = max(full - axis.damping, _LEAST * full)
        return LoopGain(k_p, full * share, 0.0, omega)
    own = float(np.hypot(omega, np.sqrt(axis.stiffness / axis.inertia)))
    full = 2.0 * DAMPING_RATIO * own * axis.inertia
    k_d = float(np.clip(full - axis.damping, _LEAST * full, _MOST * full))
    # Where the water damps more than that, the answer is as slow as K_P is small against it.
    k_p = max(axis.inertia * omega**2, omega * (axis.damping + k_d) / (2.0 * DAMPING_RATIO))
    k_p += axis.stiffness
    # The feed-forward carries most of the stiffness: half of it is left to the integral.
    return LoopGain(k_p, (k_p - 0.5 * axis.stiffness) * share, k_d, omega)


def law(gains: dict[str, LoopGain], speed_m_s: float) -> Array:
    """The loops as one matrix K (6, 15) of the deviations and integrals, tau = -K x, at a speed ahead.

    The rate of the depth is ``w - u pitch``.
    """
    full = np.zeros((6, len(STATES)))
    for loop, gain in gains.items():
        row = LOOPS.index(loop)
        state = {"surge": 4, "sway": 5, "heave": 0, "roll": 1, "pitch": 2, "heading": 3}[loop]
        full[row, state] = gain.k_p
        if loop in INTEGRATED:
            full[row, INTEGRATED[loop][1]] = gain.k_i
        if kind(loop) == "position":
            rate = {"heave": 6, "roll": 7, "pitch": 8, "heading": 9}[loop]
            full[row, rate] = gain.k_d
        if loop == "heave":
            full[row, STATES.index("pitch")] -= gain.k_d * speed_m_s
    return full


OVERSHOOT, PHASE_DEG = 0.24, 35.0

CURRENT_M_S = 0.3
"""Current that the gains are made for."""

_SETTLED = 0.05

_OPEN_DEPTH = 1e-6  # rounding of the eigenvalue 1, at ten steps per second e^(1/28 h)

_SETTLING = 90.0  # times 1/bandwidth

_FACTORS = (1.0, 0.9, 0.8, 1.25, 0.7, 1.6, 0.6, 0.5, 2.0, 0.4)

_STIFFNESS = (1.0, 0.7, 0.5)

_TILT = {"K": 1, "M": 2}  # the angle, as a column of K, that a righting moment goes with


@dataclass(frozen=True)
class Trial:
    """Gains of all loops at one speed after another."""

    vehicle: Vehicle
    rows: str
    late: dict[str, Delay]
    period_s: float
    top_m_s: float
    surge_most: float = np.inf
    """Largest proportional gain of the surge, N per m/s."""

    def at(
        self, speed: float, tau_max: dict[str, float], modes: tuple[Mode, ...]
    ) -> tuple[dict[str, LoopGain], list[str]]:
        """Gains per loop, and the loops of a mode that fail their trial."""
        used = [mode for mode in modes if flies(mode, modes, speed)]
        plants = {
            mode.name: plant(self.vehicle, _flight(self.vehicle, speed, mode), mode.loops) for mode in used
        }
        axes = {
            loop: self._axis(loop, tau_max, plants, speed)
            for loop in (LOOPS[ROWS.index(row)] for row in self.rows)
        }
        widths = {loop: bandwidth(loop, axis) for loop, axis in axes.items()}
        widths["surge"] = min(widths["surge"], self.surge_most / axes["surge"].inertia)
        factors, stiff = dict.fromkeys(widths, 1.0), dict.fromkeys(widths, 1.0)

        def gains() -> dict[str, LoopGain]:
            return {
                loop: loop_gain(
                    loop,
                    replace(axes[loop], stiffness=axes[loop].stiffness * stiff[loop]),
                    widths[loop] * factors[loop],
                )
                for loop in widths
            }

        # Pitch and heading first: the other loops ride on them.
        for loop in sorted(widths, key=lambda name: name not in ("pitch", "heading", "roll")):
            for stiff[loop], factors[loop] in product(_STIFFNESS, _FACTORS):
                if all(
                    self._passes(plants[m.name], gains(), m, loop, speed) for m in used if loop in m.loops
                ):
                    break
            else:
                stiff[loop], factors[loop] = 1.0, 1.0
        final = gains()
        weak = []
        for mode in used:
            failing = [
                loop
                for loop in mode.loops
                if not self._passes(plants[mode.name], final, mode, loop, speed, together=True)
            ]
            if failing:
                weak.append(f"{mode.name} at {speed:.2f} m/s ({', '.join(failing)})")
        return final, weak

    def _axis(self, loop: str, tau_max: dict[str, float], plants: dict[str, Plant], speed: float) -> Axis:
        row = ROWS[LOOPS.index(loop)]
        inertia = float(np.asarray(self.vehicle.mass_matrix())[ROWS.index(row), ROWS.index(row)])
        damping = min(_damping(of, row) for of in plants.values())
        upset = max((self._upset(of, speed) for of in plants.values() if row == "M"), default=0.0)
        usual = USUAL_ERROR.get(loop, USUAL_SHARE * self.top_m_s)
        late = self.late[row].total_s
        righting = restoring_law(self.vehicle, row)[ROWS.index(row), _TILT.get(row, 1)]
        stiffness = inertia * upset + max(-float(righting), 0.0)
        # No more than what the reach can hold at twice the usual error.
        held = min(stiffness, 2.0 * tau_max[row] / usual) if row in _TILT else 0.0
        return Axis(inertia, inertia * damping, held, late, tau_max[row], usual)

    def _upset(self, of: Plant, speed: float) -> float:
        """Stiffness over inertia, 1/s^2, with which a pitched hull is upset while its depth is held.

        It meets the flow at its pitch angle, and the Munk moment turns it further. Gains go by the speed over
        ground: a current ahead adds to it in the water.
        """
        if "Z" not in of.rows:
            return 0.0
        most = max(abs(speed), self.top_m_s)
        found = 0.0
        for u in (speed, np.copysign(min(abs(speed) + CURRENT_M_S, most), speed)):
            mode_loops = tuple(LOOPS[ROWS.index(row)] for row in of.rows)
            nu = np.array([u, 0.0, 0.0, 0.0, 0.0, 0.0])
            there = plant(self.vehicle, Trim(u, of.rows, np.zeros(3), nu, np.zeros(6)), mode_loops)
            found = max(found, _upset(there, u))
        return found

    def _passes(
        self,
        of: Plant,
        gains: dict[str, LoopGain],
        mode: Mode,
        loop: str,
        speed: float,
        *,
        together: bool = False,
    ) -> bool:
        """Whether a loop is well behaved, with the loops of the angles or all of the mode closed."""
        first = tuple(name for name in mode.loops if together or name in (loop, "pitch", "heading", "roll"))
        system = sampled(of, self.late, self.period_s, first)
        chosen = law({name: gains[name] for name in first}, speed)
        with_feed_forward = chosen + restoring_law(self.vehicle, of.rows)
        # While the depth is not yet held, it is a pole at 1.
        most = 1.0 - 1e-9 if together else 1.0 + _OPEN_DEPTH
        for k in (chosen, with_feed_forward):
            if np.abs(np.linalg.eigvals(closed(system, k))).max() >= most:
                return False
        if margins(system, with_feed_forward).phase_deg < PHASE_DEG:
            return False
        if loop in ("roll", "pitch") and mode.depth_by == "heave":
            return True  # held level: its reference does not move
        known = self._known(of, loop, with_feed_forward - chosen)
        duration = _SETTLING / gains[loop].bandwidth
        answer = step_response(system, with_feed_forward, loop, duration, known=known)
        tail = answer[-len(answer) // 10 :]
        return bool(answer.max() < 1.0 + OVERSHOOT and np.abs(tail - 1.0).max() < _SETTLED)

    def _known(self, of: Plant, loop: str, forward: Array) -> float:
        """Part of a loop's own gain that does not act on its reference; below zero: of the drag."""
        row = LOOPS.index(loop)
        if ROWS[row] in _TILT:
            return float(forward[row, _TILT[ROWS[row]]])
        if loop not in ("surge", "sway"):
            return 0.0
        place = of.states.index(row + 4)
        return float(np.asarray(self.vehicle.mass_matrix())[row, row] * of.a[place, place])


def _damping(of: Plant, row: str) -> float:
    """Damping over inertia, 1/s, of a row: the lesser of its own and of that with a free cross-flow settled.

    A hull that drifts outwards in a turn is turned further by the Munk moment: the sum may be negative.
    """
    place = of.states.index({"X": 4, "Y": 5, "Z": 6, "K": 7, "M": 8, "N": 9}[row])
    own = -float(of.a[place, place])
    passive = {"M": 6, "N": 5}.get(row)
    if passive is None or "XYZ"[passive - 4] in of.rows:
        return own
    flow = of.states.index(passive)
    settled = own + float(of.a[place, flow] * of.a[flow, place] / min(of.a[flow, flow], -1e-3))
    return min(own, settled)


def _upset(of: Plant, speed: float) -> float:
    """Stiffness over inertia, 1/s^2, with which a pitched hull is upset while its depth is held."""
    return max(speed * float(of.a[of.states.index(8), of.states.index(6)]), 0.0)


def _flight(vehicle: Vehicle, speed: float, mode: Mode) -> Trim:
    """The trim of a mode, or level motion where there is none."""
    rows = "".join(ROWS[LOOPS.index(loop)] for loop in LOOPS if loop in mode.loops)
    nu = np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    level = Trim(speed, rows, np.zeros(3), nu, np.zeros(6), mode.actuators)
    return trim(vehicle, speed, rows, mode.actuators) or level


_POINTS = 6


def physical_gains(
    loops: Mapping[str, Mapping[str, Sequence[float]]], *, period_s: float
) -> dict[str, dict[str, list[float]]]:
    """Gains of an autopilot file, per loop ``K_P``, ``K_I_per_s`` and ``K_D_s`` at six supporting points.

    ``K_I_per_s = KI / T_s`` and ``K_D_s = KD T_s`` for ``tau = KP e + KI sum(e) - KD (y(k) - y(k-1))``.

    Parameters
    ----------
    loops : mapping
        Per loop the gains per sample ``KP``, ``KI`` and ``KD``, six numbers each, N or N m per unit of error.
    period_s : float
        Control period T_s for which they were found, s.

    Raises
    ------
    VehicleError
        A period that is not positive, a missing gain, or not six numbers.

    Examples
    --------
    >>> gains = {"heading": {"KP": [32.8] * 6, "KI": [0.041] * 6, "KD": [812.0] * 6}}
    >>> {name: values[0] for name, values in physical_gains(gains, period_s=0.1)["heading"].items()}
    {'K_P': 32.8, 'K_I_per_s': 0.41, 'K_D_s': 81.2}
    """
    if not period_s > 0.0:
        raise VehicleError(f"period_s: expected a positive time in s, found {period_s}")
    factors = {"K_P": ("KP", 1.0), "K_I_per_s": ("KI", 1.0 / period_s), "K_D_s": ("KD", period_s)}
    physical: dict[str, dict[str, list[float]]] = {}
    for loop, gains in loops.items():
        physical[loop] = {}
        for key, (name, factor) in factors.items():
            values = list(gains.get(name, ()))
            if len(values) != _POINTS:
                raise VehicleError(
                    f"{loop}.{name}: expected {_POINTS} gains per sample, one per supporting point, found"
                    f" {len(values)}"
                )
            # Ten digits: a period of 0.1 s leaves 0.41 as 0.41.
            physical[loop][key] = [float(f"{value * factor:.10g}") for value in values]
    return physical
