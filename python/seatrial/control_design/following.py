"""How late the course follows what guidance asks for: reference filter, loop, and drift of the hull.

The line of sight asks for a heading ``-atan(y_e / Delta)``; the way of the vehicle, ``psi + v/U``, follows
a time tau later, and the cross-track error is a loop with the crossover ``U / Delta`` behind that delay. With

    Delta = 2 U tau

a phase margin of 61 deg is left, of 47 deg with the integral (kappa = U/4 takes atan(1/4)), and of 36 deg at
1.6 times that speed. In the vertical plane alike, with ``theta - w/U``. A longer lookahead is smoother and
slower: the integral has learnt the drift after about ten of them.

tau is the phase of the linear motion behind lag and dead time at that crossover, over its frequency; the
third-order reference filter has ``3 atan(w / w_r) / w`` of it, 3/w_r when slow. Held by
tests/test_control_design_start.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.control_design.authority import LOOPS, ROWS, Delay
from seatrial.control_design.closed_loop import Sampled, plant, reference_drive, restoring_law, sampled
from seatrial.control_design.loop_gains import LoopGain, law
from seatrial.control_design.mode_table import Mode
from seatrial.control_design.trim import Trim, trim

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["CROSSINGS", "following_delay", "lookahead"]

Array = NDArray[np.float64]

CROSSINGS = 2.0
"""Lookahead distance over speed and delay."""

MOTION = 0.1
"""In m/s and rad/s, of a correction: quadratic damping counts by its secant over that."""

_ROUNDS = 20
_WAY = {"heading": ((3, 1.0), (5, 1.0)), "pitch": ((2, 1.0), (6, -1.0))}
"""Angle of the course: the angle that is controlled, and the cross-flow over the speed with its sign."""


def lookahead(
    vehicle: Vehicle,
    flight: tuple[Mode, float, dict[str, LoopGain], dict[str, Delay]],
    loop: str,
    reference_rad_s: float,
    period_s: float,
) -> tuple[float, float]:
    """Lookahead distance in m of "heading" or "pitch", and the delay in s that it is made for.

    ``flight`` is the mode, the speed in m/s, the gains of its loops there, and the delays of its rows.
    """
    mode, speed, gains, late = flight
    rows = "".join(ROWS[LOOPS.index(name)] for name in LOOPS if name in mode.loops)
    at = trim(vehicle, speed, rows, mode.actuators) or Trim(
        speed, rows, np.zeros(3), np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(6), mode.actuators
    )
    system = sampled(plant(vehicle, at, mode.loops, motion=MOTION), late, period_s, mode.loops)
    own = law({name: gains[name] for name in mode.loops}, speed)
    both = (own, own + restoring_law(vehicle, rows))
    inertia = float(np.asarray(vehicle.mass_matrix())[LOOPS.index(loop), LOOPS.index(loop)])
    tau = 3.0 / reference_rad_s
    for _ in range(_ROUNDS):
        crossover = 1.0 / (CROSSINGS * tau)
        tau = 0.5 * tau + 0.5 * following_delay(
            system, both, (loop, speed, inertia), reference_rad_s, crossover
        )
    return CROSSINGS * speed * tau, tau


def following_delay(
    system: Sampled,
    laws: tuple[Array, Array],
    loop: tuple[str, float, float],
    reference_rad_s: float,
    omega: float,
) -> float:
    """Delay in s at omega (rad/s) from the angle that guidance asks for to the angle of the course.

    ``laws`` are those of the loops, without and with the feed-forward at the measured attitude; ``loop`` its
    name, the speed in m/s and the inertia of the row, which is fed forward.
    """
    name, speed, inertia = loop
    own, fed = laws
    z = np.exp(1j * omega * system.period_s)
    step, drive = reference_drive(system, (own, fed), name, (1j * omega, inertia))
    x = np.linalg.solve(z * np.eye(len(step)) - step, drive)
    (angle, one), (flow, sign) = _WAY[name]
    answer = one * x[system.seen[system.columns.index(angle)]]
    answer += sign * x[system.seen[system.columns.index(flow)]] / speed
    lag = -float(np.angle(answer)) % (2.0 * np.pi)
    lag -= 2.0 * np.pi if lag > 1.5 * np.pi else 0.0
    return (lag + 3.0 * float(np.arctan(omega / reference_rad_s))) / omega
