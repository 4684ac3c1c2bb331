"""The trial of start gains at one supporting speed: all loops on the coupled motion behind lag and dead
time.

Each loop begins with the bandwidth of `seatrial.control_design.loop_gains`; it is moved until the motion
is stable with and without the restoring feed-forward, the phase margin is 35 deg, and the step response
overshoots less than 24 % and settles. Held by tests/test_control_design_start.py.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.control_design.authority import LOOPS, ROWS, Delay
from seatrial.control_design.closed_loop import (
    Plant,
    closed,
    margins,
    plant,
    restoring_law,
    sampled,
    step_response,
)
from seatrial.control_design.loop_gains import (
    USUAL_ERROR,
    USUAL_SHARE,
    Axis,
    LoopGain,
    bandwidth,
    law,
    loop_gain,
)
from seatrial.control_design.mode_table import Mode, flies
from seatrial.control_design.trim import Trim, trim

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["CURRENT_M_S", "OVERSHOOT", "PHASE_DEG", "Trial"]

Array = NDArray[np.float64]

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
