"""Gains of one PID loop at one speed by pole placement on the vehicle's own model, and the law of all loops.

Position loops (depth, angles): ``K_P = M w^2 + k``, ``K_D = 2 zeta w' M - d``, ``K_I = (K_P - k/2) w /
12``, and ``w (d + K_D) / (2 zeta)`` instead of ``M w^2`` where that is more; speed loops: ``K_P = M w -
d``, ``K_I = M w^2 / 7``. M is the inertia and d the damping of the row, negative where the hull turns by
itself. k is the stiffness with which the flow upsets the hull, and the righting one, which a feed-forward
at the measured attitude takes away; ``w'^2 = w^2 + k/M``.

The bandwidth w is the largest that both the actuators' delay T and their reach allow: ``w T <= 0.2`` (0.4
for a speed loop), which costs about 25 deg of phase at the crossover, and a usual error (`USUAL_ERROR`)
asks for no more than tau_max.

Source: Fossen (2011), section 12.2.7; Åström and Hägglund (2006), section 7.6; gains per sample: Taubert et
al. (2014), equation (54). Held by tests/control_design/test_control_design_start.py and
tests/control_design/test_per_sample.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import VehicleError
from seatrial.control_design.loops import INTEGRATED, STATES
from seatrial.vehicle.actuators import LOOPS

USUAL_ERROR = {"heave": 2.0, "roll": np.deg2rad(30.0), "pitch": np.deg2rad(30.0), "heading": np.deg2rad(40.0)}
"""Error of a position loop, m or rad, that may just ask for the largest demand."""


@dataclass(frozen=True)
class PolePlacementSettings:
    """How poles of a loop are placed."""

    #: Error of a speed loop that may just ask for the largest demand, as a share of the top speed.
    usual_speed_share: float = 0.3
    damping_ratio: float = 0.9  #: Damping ratio of the placed poles: hardly an overshoot, and still fast.
    #: Least gain as a share of that without the water's damping: damping that is there takes no more away.
    gain_share_min: float = 0.25
    gain_share_max: float = 3.0  #: Largest gain by the same share: damping that wants adds no more.
    #: Delay of navigation and of what a vehicle file does not tell, s: no loop counts on less.
    shortest_delay_s: float = 0.1


POLE_PLACEMENT_SETTINGS = PolePlacementSettings()

DELAY_SHARE = {"position": 0.2, "speed": 0.4}

INTEGRAL_SHARE = {"position": 1.0 / 12.0, "speed": 1.0 / 7.0}


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
    by_delay = DELAY_SHARE[kind(loop)] / max(axis.delay_s, POLE_PLACEMENT_SETTINGS.shortest_delay_s)
    usual = axis.tau_max / axis.usual_error
    if kind(loop) == "speed":
        return min(by_delay, usual / axis.inertia)
    against_damping = 2.0 * POLE_PLACEMENT_SETTINGS.damping_ratio * usual / max(axis.damping, 1e-9)
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
        k_p = max(full - axis.damping, POLE_PLACEMENT_SETTINGS.gain_share_min * full)
        return LoopGain(k_p, full * share, 0.0, omega)
    own = float(np.hypot(omega, np.sqrt(axis.stiffness / axis.inertia)))
    full = 2.0 * POLE_PLACEMENT_SETTINGS.damping_ratio * own * axis.inertia
    k_d = float(
        np.clip(
            full - axis.damping,
            POLE_PLACEMENT_SETTINGS.gain_share_min * full,
            POLE_PLACEMENT_SETTINGS.gain_share_max * full,
        )
    )
    # Where the water damps more than that, the answer is as slow as K_P is small against it.
    k_p = max(
        axis.inertia * omega**2, omega * (axis.damping + k_d) / (2.0 * POLE_PLACEMENT_SETTINGS.damping_ratio)
    )
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


_POINTS = 6  # breakpoints of a schedule in the core's autopilot file


def physical_gains(
    loops: Mapping[str, Mapping[str, Sequence[float]]], *, period_s: float
) -> dict[str, dict[str, list[float]]]:
    """Gains of an autopilot file, per loop ``K_P``, ``K_I_per_s`` and ``K_D_s`` at six breakpoints.

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
                    f"{loop}.{name}: expected {_POINTS} gains per sample, one per breakpoint, found"
                    f" {len(values)}"
                )
            # Ten digits: a period of 0.1 s leaves 0.41 as 0.41.
            physical[loop][key] = [float(f"{value * factor:.10g}") for value in values]
    return physical
