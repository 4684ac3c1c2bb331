"""The corridor of a loop for which the campaign gives none: what the vehicle's own limits allow, with room.

A step of size s that a largest acceleration a carries out takes at least ``s/a`` for a speed and ``2
sqrt(s/a)`` for a position, speeding up and slowing down; half of the demand is left to everything else.
Dead time, lag and reference filter come on top, and the rise time is twice as much: ``rise = 2 (t + 3 late
+ 3/omega)``. Water that damps the motion, and guidance's own limits of rates, slow it further.

The loop with its start gains, flown in still water, corrects that (`start_metrics`). Where it is slower or
overshoots further, the corridor asks for 5 % less of it: what makes it so, such as fins in slow water,
stays with other gains. Its noise at rest is what sensors, dead band and least thrust leave of a straight
line: the standard deviation over the second half of the time before the step, its trend taken out. No
corridor is narrower than five of them (the share of all instants beyond, were they independent and normal:
6e-7), and no step so small that this would be wider than its band.

Source: bang-bang control of a double integrator, e.g. Bryson and Ho, *Applied Optimal Control* (1975),
section 3.9. Held by tests/tuning/test_tuning_plan.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.control_design.autopilot_facts import AutopilotFacts, autopilot_facts
from seatrial.control_design.corridor import Corridor
from seatrial.control_design.tuning_table import LOOPS, Weights, default_steps
from seatrial.tuning.criterion import step_metrics
from seatrial.tuning.step_trial import LoopTrials, Samples
from seatrial.vehicle.actuators import NOMINAL_V
from seatrial.vehicle.authority import LOOPS as ORDER
from seatrial.vehicle.authority import ROWS, delays, reach

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.tuning.step_trial import Rig

_SEEDS = (11, 12)  # two noises: one may flatter the start gains

_AT_REST = 0.25  # of the step: what moves more at rest, as the deviation, is not held at all


@dataclass(frozen=True)
class StartMetrics:
    """Figures of a loop over its trials; those that are not held at all are left out.

    Attributes
    ----------
    noise
        Largest standard deviation at rest, SI; 0 where no trial is held.
    rise_s, overshoot, settling_s
        Largest of the steps; overshoot as a share of the step. A step that never rises has no rise time, one
        that does not settle takes all of its time. 0 where nothing is held.
    """

    noise: float
    rise_s: float
    overshoot: float
    settling_s: float


def start_metrics(rig: Rig, trials: LoopTrials) -> StartMetrics:
    """Figures of a loop with the rig's gains, the vehicle itself in still water."""
    still = Samples({}, np.zeros((len(_SEEDS), 3)), _SEEDS, len(_SEEDS))
    t, answers = rig.responses(trials, still, {})
    values = answers[trials.names[0]]
    rest = (t > 0.5 * trials.settle_s) & (t <= trials.settle_s)
    there = (t >= trials.settle_s) & (t < trials.settle_s + trials.until_s)
    noises, steps = [0.0], []
    for trial, size in enumerate(trials.sizes):
        for each in values[trial]:
            deviation = _about_a_line(t[rest], each[rest])
            normalised = (each[there] - trials.base(trial)) / size
            if not (np.isfinite(normalised).all() and deviation < _AT_REST * abs(size)):
                continue
            noises.append(deviation)
            metrics = step_metrics(t[there] - trials.settle_s, normalised, band=trials.settled)
            if metrics.overshoot < 1.0:  # an overshoot as large as the step is no response
                steps.append((metrics.rise_s, metrics.overshoot, min(metrics.settling_s, trials.until_s)))
    table = np.array(steps).reshape(-1, 3)
    largest = np.where(np.isfinite(table), table, 0.0).max(axis=0, initial=0.0)
    return StartMetrics(max(noises), *(float(value) for value in largest))


def _about_a_line(t: Array, values: Array) -> float:
    """Standard deviation about the straight line that fits best."""
    if len(t) < 3 or not np.isfinite(values).all():
        return float("inf")
    return float(np.std(values - np.polyval(np.polyfit(t - t[0], values, 1), t - t[0])))


_LEFT = 0.5  # of the reach, to other loops

_ROOM = 2.0  # of the time that the largest acceleration needs: the loop must also brake

_SHORTEST_S, _LONGEST_S = 2.0, 60.0  # rise times that make sense for an underwater vehicle

_OVERSHOOT, _OVERSHOOT_MOST = 0.15, 0.3  # of the step: what a good loop does, and the most that is accepted

_SETTLED, _SETTLED_MOST = 0.08, 0.1  # of the step: band of a settled response

_SETTLING = 2.5  # over the rise, by the limits

_END = 1.6  # over the settling: from there on it only has to stay

_DEVIATIONS = 5.0  # of the answer at rest, that a band has room for

_BETTER = 0.95  # of what the start gains do

_PATHS = {"depth": "pitch", "cross_track": "heading"}


def steps_above_noise(
    loop: str, noise: float, *, top_m_s: float, largest: float = math.inf
) -> tuple[float, float]:
    """Steps of a loop in both directions whose band the answer's noise does not fill, in the file's unit.

    `noise` is the standard deviation of the answer at rest, SI; `largest` is what guidance or the vehicle
    allows, in the file's unit.

    Examples
    --------
    >>> steps_above_noise("surge", 0.0, top_m_s=2.0)
    (0.3, -0.3)
    >>> steps_above_noise("surge", 0.008, top_m_s=2.0)
    (0.5, -0.5)
    """
    usual = default_steps(loop, top_m_s=top_m_s, largest=largest)[0]
    needed = _DEVIATIONS * noise / _SETTLED / LOOPS[loop].to_si
    if needed > usual:
        digit = 10.0 ** (math.floor(math.log10(needed)) - 1)
        # At most 2.5 times the usual step.
        usual = min(math.ceil(needed / digit - 1e-9) * digit, 2.5 * usual, largest)
    size = float(f"{usual:.3g}")
    return size, -size


def default_corridor(
    vehicle: Vehicle,
    autopilot: Autopilot,
    loop: str,
    steps: Sequence[float],
    *,
    weights: Weights,
    speeds_m_s: Sequence[float] = (0.0,),
    voltage_v: float = NOMINAL_V,
    start: StartMetrics | None = None,
) -> Corridor:
    """Corridor for some steps of a loop, in the file's unit.

    Parameters
    ----------
    vehicle : Vehicle
    autopilot : Autopilot
    loop : str
        A loop, or a path that rides on one.
    steps : sequence of float
        m/s, m or deg.
    weights : Weights
    speeds_m_s : sequence of float, optional
        Of the trials; fins turn the hull the less the slower it goes.
    voltage_v : float, optional
        Supply at which tables of thrust are read, V.
    start : StartMetrics, optional
        What the loop does with its start gains; by default only the vehicle's limits count.

    Examples
    --------
    >>> import seatrial as st
    >>> cwolf, autopilot = st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf")
    >>> default_corridor(cwolf, autopilot, "heading", [20.0], weights=Weights()).until_s > 10.0
    True
    """
    facts = autopilot_facts(autopilot)
    rider = _PATHS.get(loop, loop)
    row = ROWS[ORDER.index(rider)]
    entry = LOOPS[loop]
    size = max(abs(step) for step in steps) * entry.to_si
    late = delays(vehicle, row)[row].total_s + autopilot.period_s
    omega = facts.loops.get(rider, {}).get("reference_rad_s")
    # What answers late rises late: three delays, and three time constants of the reference filter.
    late_s = 3.0 * late + (3.0 / omega if omega else 0.0)
    # Least time for the step with the acceleration that is left, or by the rate that guidance allows.
    if loop in _PATHS:
        least = _along_a_path(facts, loop, size)
    else:
        slowest = min((abs(speed) for speed in speeds_m_s), default=0.0)
        ends = np.abs(reach(vehicle, slowest if _finned(vehicle) else 0.0, row, voltage_v=voltage_v)[row])
        # The weaker way, at the slowest speed: fins do least there.
        tau = min(float(ends[ends > 0.0].min(initial=np.inf)), facts.loops[rider]["tau_max"])
        inertia = float(np.asarray(vehicle.mass_matrix())[ROWS.index(row), ROWS.index(row)])
        # A least acceleration keeps the rise time of a row without reach finite.
        most = max(_LEFT * tau / inertia, 1e-6)
        least = size / most if loop in ("surge", "sway") else 2.0 * float(np.sqrt(size / most))
        least = max(least, _by_rate(facts, loop, size))
    # No more is asked than a little better than the start gains, within what makes sense.
    start = StartMetrics(0.0, 0.0, 0.0, 0.0) if start is None else start
    rise = float(np.clip(max(_ROOM * (least + late_s), _BETTER * start.rise_s), _SHORTEST_S, _LONGEST_S))
    settling = float(np.clip(_BETTER * start.settling_s, _SETTLING * rise, 2.0 * _SETTLING * rise))
    noise = _DEVIATIONS * start.noise / (min(abs(step) for step in steps) * entry.to_si)
    rise, settling = (float(f"{value:.2g}") for value in (rise, settling))
    return Corridor.from_figures(
        rise_s=rise,
        overshoot=float(f"{np.clip(_BETTER * start.overshoot, _OVERSHOOT, _OVERSHOOT_MOST):.2g}"),
        settling_s=settling,
        settled=float(f"{np.clip(noise, _SETTLED, _SETTLED_MOST):.2g}"),
        until_s=float(f"{_END * settling:.3g}"),
        weight_lower=weights.lower,
        weight_upper=weights.upper,
    )


def _finned(vehicle: Vehicle) -> bool:
    """Whether fins steer it, which do nothing at rest."""
    return any(facts["kind"] == "fin" for facts in vehicle.actuator_info().values())


def _by_rate(facts: AutopilotFacts, loop: str, size: float) -> float:
    """Time that guidance's own limit of the rate asks for, s."""
    rate = np.deg2rad(facts.guidance.get("pitch_rate_max_deg_s", np.inf)) if loop == "pitch" else np.inf
    return float(size / rate)


def _along_a_path(facts: AutopilotFacts, loop: str, size: float) -> float:
    """Time in which line of sight at 1 m/s takes up a step of the path, s: three lookahead distances."""
    key = "lookahead_vertical_m" if loop == "depth" else "lookahead_m"
    return 1.5 * float(facts.guidance[key]) + size
