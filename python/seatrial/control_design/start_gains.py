"""Start gains of an autopilot from the vehicle's model: modes, breakpoints, gains and largest demands.

Which loops there are follows from the rows that the actuators can command. Each loop begins with gains by
pole placement. Position loops (depth, angles): ``K_P = M w^2 + k``, ``K_D = 2 zeta w' M - d``, ``K_I = (K_P -
k/2) w / 12``, and ``w (d + K_D) / (2 zeta)`` instead of ``M w^2`` where that is more; speed loops: ``K_P = M
w - d``, ``K_I = M w^2 / 7``. M is the inertia and d the damping of the row, negative where the hull turns by
itself. k is the stiffness with which the flow upsets the hull, and the righting one, which a feed-forward at
the measured attitude takes away; ``w'^2 = w^2 + k/M``. The bandwidth w is the largest that both the
actuators' delay T and their reach allow: ``w T <= 0.2`` (0.4 for a speed loop), which costs about 25 deg of
phase at the crossover, and a usual error (`USUAL_ERROR`) asks for no more than tau_max.

The bandwidth is then moved in a trial of all loops on the coupled motion behind lag and dead time, until the
motion is stable with and without the restoring feed-forward, the phase margin is 35 deg, gain margin and
sensitivity are accepted (`seatrial.control_design.tuning_table.ACCEPTED`), and the step response overshoots
less than 24 % and settles.

The largest demand of a row is 80 % of its reach, half of it where the actuators that give it also drive
ahead. The reference filters are five times as fast as their position loops: they hold back a jump, not the
guidance. A loop has at most 0.2/T of the delay T of its actuators, so that these can still follow a
reference of 1/T.

Source: Fossen (2011), section 12.2.7; Åström and Hägglund (2006), section 7.6; gains per sample: Taubert et
al. (2014), equation (54). Held by tests/control_design/test_control_design_start.py and
tests/control_design/test_per_sample.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import VehicleError
from seatrial.control_design.loops import (
    LOOP_OF,
    ROW_OF,
    LoopGain,
    Plant,
    kind,
    law,
    level,
    plant,
    restoring_law,
    sampled,
    step_response,
)
from seatrial.control_design.margins import decibel, least_margins, small, spectral_radius
from seatrial.control_design.operating_points import (
    POINTS,
    Mode,
    breakpoint_speeds,
    flies,
    mode_table,
    mode_trim,
    top_speeds,
)
from seatrial.control_design.operating_points import SETTINGS as MODE_TABLE_SETTINGS
from seatrial.vehicle.actuators import (
    LOOPS,
    NOMINAL_V,
    ROWS,
    Delay,
    bollard,
    command,
    commandable,
    delays,
    reach,
)
from seatrial.vehicle.stability import neutral_fins
from seatrial.vehicle.steady_state import drivers

if TYPE_CHECKING:
    from seatrial._core import Vehicle


USUAL_ERROR = {"heave": 2.0, "roll": np.deg2rad(30.0), "pitch": np.deg2rad(30.0), "heading": np.deg2rad(40.0)}
"""Error of a position loop, m or rad, that may just ask for the largest demand."""


DELAY_SHARE = {"position": 0.2, "speed": 0.4}

INTEGRAL_SHARE = {"position": 1.0 / 12.0, "speed": 1.0 / 7.0}


@dataclass(frozen=True)
class Axis:
    """One row: inertia, damping, stiffness to add in SI, delay in s, largest demand in N or N m, usual error
    in m/s, m or rad.
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


def bandwidth(loop: str, axis: Axis) -> float:
    """Largest bandwidth in rad/s that delay and reach allow."""
    by_delay = DELAY_SHARE[kind(loop)] / max(axis.delay_s, SETTINGS.shortest_delay_s)
    usual = axis.tau_max / axis.usual_error
    if kind(loop) == "speed":
        return min(by_delay, usual / axis.inertia)
    against_damping = 2.0 * SETTINGS.damping_ratio * usual / max(axis.damping, 1e-9)
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
        k_p = max(full - axis.damping, SETTINGS.gain_share_min * full)
        return LoopGain(k_p, full * share, 0.0, omega)
    own = float(np.hypot(omega, np.sqrt(axis.stiffness / axis.inertia)))
    full = 2.0 * SETTINGS.damping_ratio * own * axis.inertia
    k_d = float(np.clip(full - axis.damping, SETTINGS.gain_share_min * full, SETTINGS.gain_share_max * full))
    # Where the water damps more than that, the answer is as slow as K_P is small against it.
    k_p = max(axis.inertia * omega**2, omega * (axis.damping + k_d) / (2.0 * SETTINGS.damping_ratio))
    k_p += axis.stiffness
    # The feed-forward carries most of the stiffness: half of it is left to the integral.
    return LoopGain(k_p, (k_p - 0.5 * axis.stiffness) * share, k_d, omega)


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
            if len(values) != POINTS:
                raise VehicleError(
                    f"{loop}.{name}: expected {POINTS} gains per sample, one per breakpoint, found"
                    f" {len(values)}"
                )
            # Ten digits: a period of 0.1 s leaves 0.41 as 0.41.
            physical[loop][key] = [float(f"{value * factor:.10g}") for value in values]
    return physical


@dataclass(frozen=True)
class StartGainSettings:
    """How poles are placed, and what start gains leave to other rows, tolerate, and try in turn."""

    shared_reach: float = 0.5  #: Share of the reach for a row whose actuators also drive ahead.
    own_reach: float = 0.8  #: Share of the reach for a row with actuators of its own.
    #: Noise of one ping of the Doppler log, m/s: that of the typical sensors.
    doppler_noise_m_s: float = 0.008
    #: Share of the least thrust that this noise may ask for: it starts no motor.
    noise_thrust_share: float = 0.25
    overshoot_max: float = 0.24  #: Largest overshoot of a step response, as a share of the step.
    phase_margin_deg: float = 35.0  #: Least phase margin, deg: 5 deg more than what is accepted.
    current_m_s: float = 0.3  #: Current that the gains are made for, m/s.
    #: Band about the set point in the last tenth of a step response, as a share of the step: the usual 5 %.
    settled_band: float = 0.05
    #: Excess over 1 of the eigenvalue of a depth that is not held yet: rounding; at ten steps per second a
    #: growth e-fold in 28 h.
    open_depth_excess: float = 1e-6
    step_bandwidths: float = 90.0  #: Length of a step response, times one over the bandwidth.
    #: Factors on the bandwidth, tried in this order: those near 1 first.
    bandwidth_factors: tuple[float, ...] = (1.0, 0.9, 0.8, 1.25, 0.7, 1.6, 0.6, 0.5, 2.0, 0.4)
    #: Shares of the wanted stiffness, tried from the stiffest on.
    stiffness_shares: tuple[float, float, float] = (1.0, 0.7, 0.5)
    #: Error of a speed loop that may just ask for the largest demand, as a share of the top speed.
    usual_speed_share: float = 0.3
    damping_ratio: float = 0.9  #: Damping ratio of the placed poles: hardly an overshoot, and still fast.
    #: Least gain as a share of that without the water's damping: damping that is there takes no more away.
    gain_share_min: float = 0.25
    gain_share_max: float = 3.0  #: Largest gain by the same share: damping that wants adds no more.
    #: Delay of navigation and of what a vehicle file does not tell, s: no loop counts on less.
    shortest_delay_s: float = 0.1


SETTINGS = StartGainSettings()

_REFERENCE = {"position": 5.0, "speed": 2.0}  # natural frequency of the reference filter over the bandwidth


@dataclass(frozen=True)
class LoopStart:
    """A loop's gains at the six breakpoints; tau_max in N or N m, reference filter in rad/s."""

    gains: tuple[LoopGain, ...]
    tau_max: float
    reference_rad_s: float


@dataclass(frozen=True)
class StartGains:
    """Start values of an autopilot; why rows are ``left_out``, delay per row (``late``), and mode, speed and
    loops where no bandwidth met the demands on margins and step response (``weak``).
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
    """Start values of an autopilot for a vehicle at a control period in s and a supply in V; a `ValueError`
    for one that cannot be steered: no thrust ahead, no heading, or neither heave force nor pitch.
    """
    if not vehicle.actuators:
        raise ValueError(
            "the vehicle has no actuators; give its [[thrusters]] or [[fins]] in the vehicle file"
        )
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
    speeds = breakpoint_speeds(vehicle, rows, top)
    modes = mode_table(vehicle, rows, top)
    limits = [reach(vehicle, u, rows, voltage_v=voltage_v) for u in speeds]
    shares = {row: _share(vehicle, row) for row in rows}
    # Ahead only: a propeller that turns against the flow pushes harder than it can be asked to.
    slow = [limit for u, limit in zip(speeds, limits, strict=True) if u >= 0.0]
    slow += [reach(vehicle, 0.0, rows, voltage_v=voltage_v)] if "Z" in rows else []
    largest = {row: max(_usable(limit, row, shares) for limit in slow) for row in rows}
    largest["X"] = max(largest["X"], 1.05 * _drag(vehicle, speeds[-1]))
    design = Trial(vehicle, rows, late, period_s, top[1], _quiet(vehicle, voltage_v))
    gains_of: dict[str, list[LoopGain]] = {LOOP_OF[row]: [] for row in rows}
    weak: list[str] = []
    for u, limit in zip(speeds, limits, strict=True):
        allowed = {row: _usable(limit, row, shares) for row in rows}
        gains, short = design.at(u, allowed, modes)
        weak += short
        for loop, gain in gains.items():
            gains_of[loop].append(gain)
    loops = {}
    for loop, placed in gains_of.items():
        used = [
            gain.bandwidth
            for u, gain in zip(speeds, placed, strict=True)
            if u > -MODE_TABLE_SETTINGS.cruise_from_share * top[1]
            and any(loop in m.loops and flies(m, modes, u) for m in modes)
        ]
        reference = _REFERENCE[kind(loop)] * float(np.median(used or [gain.bandwidth for gain in placed]))
        loops[loop] = LoopStart(tuple(placed), largest[ROW_OF[loop]], reference)
    return StartGains(tuple(speeds), top, loops, modes, left_out, period_s, late, tuple(weak))


def _quiet(vehicle: Vehicle, voltage_v: float) -> float:
    """Surge gain in N per m/s at which noise of the velocity asks for a quarter of the least thrust, or inf:
    more of it starts and stops propellers near their minimum revolutions.
    """
    facts = vehicle.actuator_info()
    least = {}
    for name, sense in drivers(vehicle).items():
        side = "minimum_ahead" if sense > 0.0 else "minimum_astern"
        least[name] = command(facts[name], sense * float(facts[name][side]) / _largest(facts[name], sense))
    thrust = float(bollard(vehicle, least, voltage_v=voltage_v)[0])
    return SETTINGS.noise_thrust_share * thrust / SETTINGS.doppler_noise_m_s if thrust > 0.0 else np.inf


def _largest(facts: dict[str, Any], sense: float) -> float:
    return float(facts["maximum_ahead" if sense > 0.0 else "maximum_astern"])


def _with_hold(delay: Delay, period_s: float) -> Delay:
    """The delay with the half period that a held demand is late on average."""
    return replace(delay, ramp_s=delay.ramp_s + 0.5 * period_s)


def _share(vehicle: Vehicle, row: str) -> float:
    matrix = np.abs(np.asarray(vehicle.allocation_matrix()))[ROWS.index(row)]
    driving = [k for k, name in enumerate(vehicle.actuators) if name in drivers(vehicle)]
    return (
        SETTINGS.shared_reach
        if row != "X" and matrix[driving].max(initial=0.0) > 0.5 * matrix.max()
        else SETTINGS.own_reach
    )


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
            mode.name: plant(self.vehicle, mode_trim(self.vehicle, speed, mode), mode.loops) for mode in used
        }
        axes = {
            loop: self._axis(loop, tau_max, plants, speed) for loop in (LOOP_OF[row] for row in self.rows)
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
            for stiff[loop], factors[loop] in product(SETTINGS.stiffness_shares, SETTINGS.bandwidth_factors):
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
        row = ROW_OF[loop]
        inertia = float(np.asarray(self.vehicle.mass_matrix())[ROWS.index(row), ROWS.index(row)])
        damping = min(_damping(of, row) for of in plants.values())
        upset = max((self._upset(of, speed) for of in plants.values() if row == "M"), default=0.0)
        usual = USUAL_ERROR.get(loop, SETTINGS.usual_speed_share * self.top_m_s)
        late = self.late[row].total_s
        righting = restoring_law(self.vehicle, row)[ROWS.index(row), _TILT.get(row, 1)]
        stiffness = inertia * upset + max(-float(righting), 0.0)
        # No more than what the reach can hold at twice the usual error.
        held = min(stiffness, 2.0 * tau_max[row] / usual) if row in _TILT else 0.0
        return Axis(inertia, inertia * damping, held, late, tau_max[row], usual)

    def _upset(self, of: Plant, speed: float) -> float:
        """Stiffness over inertia, 1/s^2, with which a pitched hull is upset by the flow while its depth is
        held; a current ahead adds to the speed over ground by which gains go.
        """
        if "Z" not in of.rows:
            return 0.0
        most = max(abs(speed), self.top_m_s)
        upset = 0.0
        for u in (speed, np.copysign(min(abs(speed) + SETTINGS.current_m_s, most), speed)):
            mode_loops = tuple(LOOP_OF[row] for row in of.rows)
            there = plant(self.vehicle, level(u, of.rows), mode_loops)
            upset = max(upset, _upset(there, u))
        return upset

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
        most = 1.0 - 1e-9 if together else 1.0 + SETTINGS.open_depth_excess
        for k in (chosen, with_feed_forward):
            if spectral_radius(system, k) >= most:
                return False
        reached = least_margins(system, with_feed_forward)
        if reached.phase_deg < SETTINGS.phase_margin_deg or small(
            reached.phase_deg, float(decibel(reached.gain)), reached.sensitivity
        ):
            return False
        if loop in ("roll", "pitch") and mode.depth_by == "heave":
            return True  # held level: its reference does not move
        known = self._known(of, loop, with_feed_forward - chosen)
        duration = SETTINGS.step_bandwidths / gains[loop].bandwidth
        answer = step_response(system, with_feed_forward, loop, duration, known=known)
        tail = answer[-len(answer) // 10 :]
        return bool(
            answer.max() < 1.0 + SETTINGS.overshoot_max and np.abs(tail - 1.0).max() < SETTINGS.settled_band
        )

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
    """Damping over inertia, 1/s, of a row: the lesser of its own and of that with a free cross-flow settled,
    which the Munk moment may make negative.
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
