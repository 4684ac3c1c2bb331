"""Constraint criterion of a set-point response: the area outside its corridor, and metrics of the response.

``Q = WI_u * under + WI_o * over`` with ``under = sum max(C_u - y, 0) dt`` and ``over = sum max(y - C_o, 0)
dt`` over the control periods of the corridor, in s (Taubert et al. 2014, (55)-(57), with ``y - C_o`` in the
second term, where ``y - C_u`` is printed). The sum is the definition, not an approximation of an integral: a
sampled controller acts once per period, and the core adds up the same numbers. ``Q = 0`` where the response
stays inside; among those the tie-breaker decides, the time-weighted absolute error (ITAE) ``sum t |y -
target| dt`` in s^2 (Graham and Lathrop, 1953).

Held by tests/control_design/test_corridor.py and tests/tuning/test_corridor_core.py.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.control_design.corridor import Corridor
from seatrial.control_design.operating_points import AutopilotFacts, autopilot_facts
from seatrial.control_design.tuning_table import LOOPS, Weights, default_steps
from seatrial.tuning.step_trial import LoopTrials, Samples
from seatrial.vehicle.actuators import LOOPS as ORDER
from seatrial.vehicle.actuators import NOMINAL_V, ROWS, delays, reach

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.tuning.step_trial import Rig


@dataclass(frozen=True)
class CriterionSettings:
    """How a step response is measured, and what room a default corridor leaves."""

    begun_share: float = 0.05  #: Share of the step at which the dead time ends.
    rise_from_share: float = 0.1  #: Share of the step from which the rise time counts.
    risen_share: float = 0.9  #: Share of the step at which a response has risen.
    steady_share: float = 0.1  #: Last share of a record, over which a steady error is averaged.
    uneven_share: float = 1e-6  #: How far a gap of the grid may differ from the others, as a share.
    noise_seeds: tuple[int, int] = (11, 12)  #: Seeds of two noises: one alone may flatter the start gains.
    #: Standard deviation at rest, as a share of the step, above which a loop does not hold at all.
    held_share: float = 0.25
    reach_share: float = 0.5  #: Share of the reach that is left to other loops.
    #: Rise time over the time that the largest acceleration needs: the loop must also brake.
    time_ratio: float = 2.0
    shortest_rise_s: float = 2.0  #: Shortest rise time that makes sense for an underwater vehicle, s.
    longest_rise_s: float = 60.0  #: Longest rise time that makes sense for an underwater vehicle, s.
    usual_overshoot: float = 0.15  #: Overshoot of a good loop, as a share of the step.
    largest_overshoot: float = 0.3  #: Largest overshoot that is accepted, as a share of the step.
    usual_band: float = 0.08  #: Band of a settled response, as a share of the step.
    largest_band: float = 0.1  #: Widest band that still counts as settled, as a share of the step.
    settling_ratio: float = 2.5  #: Settling time over rise time, by the vehicle's limits.
    end_ratio: float = 1.6  #: End of the corridor over settling time: from there on it only has to stay.
    band_deviations: float = 5.0  #: Standard deviations of the response at rest that a band has room for.
    improvement_share: float = 0.95  #: What a corridor asks for over what the start gains do.


SETTINGS = CriterionSettings()


@dataclass(frozen=True)
class StepMetrics:
    """Figures of a step response: shares of the step, times in s since it, inf where never in the record."""

    dead_s: float  #: Until 5 % of the step are reached for the first time.
    rise_s: float  #: Until 90 % are reached for the first time.
    rise_10_90_s: float  #: From 10 to 90 %.
    #: `overshoot`, `undershoot`: largest excess above the new set point, and largest way below the old one.
    overshoot: float
    undershoot: float
    settling_s: float  #: From then on the response stays within the band.
    steady_error: float  #: Mean of what is missing to the set point over the last tenth of the record.


def normalised(response: ArrayLike, before: ArrayLike, after: ArrayLike) -> Array:
    """Response (..., n) as a share of its step: 0 at the set point before, 1 at that after (...), in the same
    unit.

    Examples
    --------
    >>> normalised([1.0, 0.8, 0.5], 1.0, 0.6).round(2).tolist()
    [0.0, 0.5, 1.25]
    """
    start, end = (np.asarray(value, dtype=float)[..., None] for value in (before, after))
    if np.any(start == end):
        raise SimulationError(
            "a step response needs two set points, found the same before and after; give a step that is not 0"
        )
    shares: Array = (np.asarray(response, dtype=float) - start) / (end - start)
    return shares


def violations(t: ArrayLike, y: ArrayLike, corridor: Corridor) -> Array:
    """Area below the lower and above the upper bound (..., 2) in s, without weights, of normalised responses
    (..., n) on an even grid (n,) of control periods, s since the step; infinite for one that is not finite
    anywhere.

    Examples
    --------
    >>> from seatrial.control_design.corridor import Corridor
    >>> corridor = Corridor([(1.0, 0.9)], [(0.0, 1.1), (4.0, 1.1)])
    >>> violations([0.0, 1.0, 2.0, 3.0], [[0.0, 0.8, 1.3, 1.0]], corridor).round(3).tolist()
    [[0.1, 0.2]]
    """
    at, response, period = _grid(t, y)
    lower, upper = corridor.sampled(at)
    with np.errstate(invalid="ignore"):
        outside = np.stack([np.maximum(lower - response, 0.0), np.maximum(response - upper, 0.0)], axis=-2)
    return _total(outside, response[..., None, :], period)


def criterion(t: ArrayLike, y: ArrayLike, corridor: Corridor) -> Array:
    """Constraint criterion Q (...) in s: weighted area outside the corridor, 0 where a response stays inside.

    Examples
    --------
    >>> from seatrial.control_design.corridor import Corridor
    >>> corridor = Corridor([(1.0, 0.9)], [(0.0, 1.1), (4.0, 1.1)], weight_upper=2.0)
    >>> round(float(criterion([0.0, 1.0, 2.0, 3.0], [0.0, 0.8, 1.3, 1.0], corridor)), 3)
    0.5
    """
    areas = violations(t, y, corridor)
    weights = corridor.weight_lower, corridor.weight_upper
    # A side of weight zero stays out of it, an infinite area included, unless the response diverged.
    parts = [w * areas[..., k] if w > 0.0 else np.zeros(areas.shape[:-1]) for k, w in enumerate(weights)]
    diverged = np.isinf(areas).any(axis=-1)
    return np.asarray(np.where(diverged, np.inf, parts[0] + parts[1]))


def time_weighted_error(t: ArrayLike, y: ArrayLike, corridor: Corridor) -> Array:
    """Time-weighted absolute error (...) in s^2 over the corridor: the tie-breaker of feasible responses."""
    at, response, period = _grid(t, y)
    with np.errstate(invalid="ignore"):
        weighed = corridor.clock(at) * np.abs(response - corridor.target)
    return _total(weighed, response, period)


def step_metrics(t: ArrayLike, y: ArrayLike, *, band: float = 0.05) -> StepMetrics:
    """Figures of one normalised step response (n,) over rising times since the step, s; `band`: half-width of
    the band in which it settles, a share of the step. Between samples by linear interpolation.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 30.0, 0.01)
    >>> found = step_metrics(t, 1.0 - np.exp(-t / 2.0))
    >>> round(found.rise_s, 2), round(found.settling_s, 2), found.overshoot
    (4.61, 5.99, 0.0)
    """
    at, response = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    if at.ndim != 1 or response.shape != at.shape:
        raise SimulationError(
            f"a step response: expected times and values (n,), found {at.shape} and {response.shape}"
        )
    at, response = at[at >= 0.0], response[at >= 0.0]
    if len(at) < 2 or np.any(np.diff(at) <= 0.0):
        raise SimulationError(
            f"a step response: expected two or more rising times from the step on, found {len(at)}"
            f" {'that do not rise' if len(at) > 1 else 'sample(s)'}; sort the samples or record longer"
        )
    # What diverged has no figures; infinite ones fail every limit.
    if not np.isfinite(response).all():
        return StepMetrics(*[math.inf] * 7)
    risen, from_ten = (
        _first(at, response, SETTINGS.risen_share),
        _first(at, response, SETTINGS.rise_from_share),
    )
    tail = at >= at[-1] - SETTINGS.steady_share * (at[-1] - at[0])
    return StepMetrics(
        dead_s=_first(at, response, SETTINGS.begun_share),
        rise_s=risen,
        rise_10_90_s=risen - from_ten if math.isfinite(risen) else math.inf,
        overshoot=max(float(response.max()) - 1.0, 0.0),
        undershoot=max(-float(response.min()), 0.0),
        settling_s=_settled(at, np.abs(response - 1.0) - band),
        steady_error=float(np.mean(1.0 - response[tail])),
    )


def _first(at: Array, response: Array, level: float) -> float:
    """First time in s at which a level is reached from below."""
    reached = np.flatnonzero(response >= level)
    return _crossing(at, response - level, int(reached[0])) if len(reached) else math.inf


def _settled(at: Array, outside: Array) -> float:
    """Time in s after which a signal stays at or below zero."""
    last = np.flatnonzero(outside > 0.0)
    if not len(last):
        return float(at[0])
    return _crossing(at, outside, int(last[-1]) + 1) if last[-1] + 1 < len(at) else math.inf


def _crossing(at: Array, signal: Array, k: int) -> float:
    """Time in s of the zero between the samples k - 1 and k."""
    if k == 0:
        return float(at[0])
    share = signal[k - 1] / (signal[k - 1] - signal[k])
    return float(at[k - 1] + share * (at[k] - at[k - 1]))


def _grid(t: ArrayLike, y: ArrayLike) -> tuple[Array, Array, float]:
    """Times (n,), responses (..., n) and the control period in s."""
    at, response = np.asarray(t, dtype=float), np.asarray(y, dtype=float)
    if at.ndim != 1 or response.shape[-1:] != at.shape:
        raise SimulationError(
            f"responses to hold against a corridor: expected times (n,) and values (..., n), found {at.shape}"
            f" and {response.shape}"
        )
    if len(at) < 2:
        raise SimulationError("responses to hold against a corridor: expected two or more periods, found one")
    period = float(at[-1] - at[0]) / (len(at) - 1)
    gaps = np.diff(at)
    if not (period > 0.0 and np.abs(gaps - period).max() <= SETTINGS.uneven_share * period):
        raise SimulationError(
            f"responses to hold against a corridor: expected one sample per control period, found gaps from"
            f" {gaps.min():.4g} to {gaps.max():.4g} s; resample them evenly"
        )
    return at, response, period


def _total(values: Array, response: Array, period: float) -> Array:
    """Sum (...) over the periods, infinite where the response is not finite."""
    finite = np.isfinite(response).all(axis=-1)
    return np.asarray(np.where(finite, np.sum(values, axis=-1) * period, np.inf))


@dataclass(frozen=True)
class StartMetrics:
    """Figures of a loop over its trials; those that are not held at all are left out."""

    noise: float  #: Largest standard deviation at rest, SI; 0 where no trial is held.
    #: `rise_s`, `overshoot`, `settling_s`: largest of the steps; overshoot as a share of the step. A step
    #: that never rises has no rise time, one that does not settle takes all of its time. 0 where nothing is
    #: held.
    rise_s: float
    overshoot: float
    settling_s: float


def start_metrics(rig: Rig, trials: LoopTrials) -> StartMetrics:
    """Figures of a loop with the rig's gains, the vehicle itself in still water. The noise at rest is the
    standard deviation over the second half of the time before the step, its trend taken out.
    """
    still = Samples(
        {}, np.zeros((len(SETTINGS.noise_seeds), 3)), SETTINGS.noise_seeds, len(SETTINGS.noise_seeds)
    )
    t, answers = rig.responses(trials, still, {})
    values = answers[trials.names[0]]
    rest = (t > 0.5 * trials.settle_s) & (t <= trials.settle_s)
    there = (t >= trials.settle_s) & (t < trials.settle_s + trials.until_s)
    noises, steps = [0.0], []
    for trial, size in enumerate(trials.sizes):
        for each in values[trial]:
            deviation = _about_a_line(t[rest], each[rest])
            normalised = (each[there] - trials.base(trial)) / size
            if not (np.isfinite(normalised).all() and deviation < SETTINGS.held_share * abs(size)):
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


_PATHS = {"depth": "pitch", "cross_track": "heading"}


def steps_above_noise(
    loop: str, noise: float, *, top_m_s: float, largest: float = math.inf
) -> tuple[float, float]:
    """Steps of a loop in both directions whose band the answer's noise (standard deviation at rest, SI) does
    not fill, in the file's unit, at most `largest`.

    Examples
    --------
    >>> steps_above_noise("surge", 0.0, top_m_s=2.0)
    (0.3, -0.3)
    >>> steps_above_noise("surge", 0.008, top_m_s=2.0)
    (0.5, -0.5)
    """
    usual = default_steps(loop, top_m_s=top_m_s, largest=largest)[0]
    needed = SETTINGS.band_deviations * noise / SETTINGS.usual_band / LOOPS[loop].to_si
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
    """Corridor for some steps of a loop or path, in the file's unit, at the speeds of its trials.

    A step of size s that a largest acceleration a carries out takes at least ``s/a`` for a speed and ``2
    sqrt(s/a)`` for a position, speeding up and slowing down; half of the demand is left to everything else.
    Dead time, lag and reference filter come on top, and the rise time is twice as much: ``rise = 2 (t + 3
    late + 3/omega)``. Water that damps the motion, and guidance's own limits of rates, slow it further. Where
    the loop with its start gains (`start_metrics`) is slower or overshoots further, the corridor asks for 5 %
    less of that. No corridor is narrower than five standard deviations of the noise at rest (were they
    independent and normal, 6e-7 of all instants are beyond). Source: bang-bang control of a double
    integrator, e.g. Bryson and Ho, *Applied Optimal Control* (1975), section 3.9.
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
        most = max(SETTINGS.reach_share * tau / inertia, 1e-6)
        least = size / most if loop in ("surge", "sway") else 2.0 * float(np.sqrt(size / most))
        least = max(least, _by_rate(facts, loop, size))
    # No more is asked than a little better than the start gains, within what makes sense.
    start = StartMetrics(0.0, 0.0, 0.0, 0.0) if start is None else start
    rise = float(
        np.clip(
            max(SETTINGS.time_ratio * (least + late_s), SETTINGS.improvement_share * start.rise_s),
            SETTINGS.shortest_rise_s,
            SETTINGS.longest_rise_s,
        )
    )
    settling = float(
        np.clip(
            SETTINGS.improvement_share * start.settling_s,
            SETTINGS.settling_ratio * rise,
            2.0 * SETTINGS.settling_ratio * rise,
        )
    )
    noise = SETTINGS.band_deviations * start.noise / (min(abs(step) for step in steps) * entry.to_si)
    rise, settling = (float(f"{value:.2g}") for value in (rise, settling))
    overshoot = SETTINGS.improvement_share * start.overshoot
    overshoot = np.clip(overshoot, SETTINGS.usual_overshoot, SETTINGS.largest_overshoot)
    return Corridor.from_figures(
        rise_s=rise,
        overshoot=float(f"{overshoot:.2g}"),
        settling_s=settling,
        settled=float(f"{np.clip(noise, SETTINGS.usual_band, SETTINGS.largest_band):.2g}"),
        until_s=float(f"{SETTINGS.end_ratio * settling:.3g}"),
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
