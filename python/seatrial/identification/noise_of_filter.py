"""The noise of a navigation filter from what an identified model leaves unexplained.

From every fitted sample the model takes one step. What it misses of the smoothed velocities, over the step,
is a residual acceleration a(t), and F = M a the force that it lacks. Two processes stand for it (Farrell
2008, section 4.6): a Gauss-Markov force with the memory that the residual shows between one and three
seconds, and for what is left white acceleration with the same area under its autocovariance. The mean is
kept: a constant force that the model misses is part of the force. Residuals of held-out samples are not
looked at. What smoothing takes out of the residual is missing: the force comes out some 10 % low.

Tests: ``tests/identification/test_noise_of_filter.py``. Figures: ``docs/validation.md``, "Navigation filter".
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES
from seatrial.base.errors import NumericalError, TrialError
from seatrial.estimation.step import STEP_SETTINGS, stage_step
from seatrial.scoring.record import Record, Replay, Segment

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.identification.identification import Identification
    from seatrial.problem.problem import Problem


@dataclass(frozen=True)
class FilterNoiseSettings:
    """How the noise of a navigation filter is read from what one step of the model misses."""

    #: Shorter lag between which the memory of the force is read, s: beyond what the smoothing of velocities
    #: joins.
    near_s: float = 1.0
    #: Longer lag, s.
    far_s: float = 3.0
    #: Longest step of the simulation, s, where no rate of the vehicle asks for a shorter one.
    substep_s: float = 0.05
    #: Substeps of a sample at most: poles up to 2,500 1/s at 10 Hz.
    most_substeps: int = 1000
    #: Distance from the log after one step, over the reach of the log's velocities, that tells nothing: the
    #: model diverges there, and the square of what it misses may be no number.
    diverged_reach: float = 1e3
    #: Shortest and longest time constant that is told, s: no memory, and a constant force.
    memory_s: tuple[float, float] = (0.5, 300.0)
    #: Least white noise, m/s and rad/s after a second.
    least_white: float = 5e-4
    #: Default of a filter for the force of a velocity that no trial measures
    #: (``docs/theory/navigation_filter.md``).
    default_force: float = 0.03
    #: Its default for the white acceleration.
    default_white: float = 0.005


SETTINGS = FilterNoiseSettings()


_LEAST = np.array([0.005, 0.005, 0.005, 0.004, 0.001, 0.001])
"""Least deviation of the force over the diagonal of the mass matrix, m/s^2 and rad/s^2: of an exact model."""


class FilterNoise(TypedDict):
    """Keywords of `seatrial.NavigationFilter`: force (6,), its time constant, white acceleration (6,); SI."""

    force: Array
    force_time_s: float
    acceleration: Array


def filter_noise(fit: Identification) -> FilterNoise:
    """Noise of a navigation filter on the identified vehicle, from the residuals of the fitted samples.

    Parameters
    ----------
    fit : Identification
        With its campaign: its trials are read again.

    Returns
    -------
    FilterNoise
        ``force`` (6,), deviations of the unmodelled force in N and N m, ``force_time_s``, its time constant,
        and ``acceleration`` (6,), deviations of the velocities in m/s and rad/s after a second of white
        acceleration: keywords of `seatrial.NavigationFilter`. The vehicle that `seatrial.identify` gives has
        them in its file, so that a filter on it takes them by itself.

    Raises
    ------
    TrialError
        No trial has three seconds of fitted samples without a gap.
    """
    return residual_noise(fit.vehicle, _fitted_records(fit.problem))


def with_model_error(vehicle: Vehicle, problem: Problem) -> Vehicle:
    """The identified vehicle with ``[model_error]`` in its file: `filter_noise` of its campaign.

    Without the table where no trial has enough fitted samples.
    """
    try:
        return vehicle.with_model_error(**residual_noise(vehicle, _fitted_records(problem)))
    except TrialError:
        return vehicle.without_model_error()


def _fitted_records(problem: Problem) -> list[Record]:
    """Trials of a campaign, of which the fitted samples count."""
    records = []
    for name in problem.trials:
        trial = problem.trials[name]
        fitted = ~problem.held_out(name)[: len(trial.t)] & trial.startable
        records.append(Record(trial, problem.input_of(name), trial.valid & fitted[:, None]))
    return records


def residual_noise(vehicle: Vehicle, records: Iterable[Record]) -> FilterNoise:
    """The same of a vehicle on records, of which the samples of a velocity count where it does.

    Raises TrialError: no record has three seconds of samples that count without a gap. Raises NumericalError:
    the vehicle diverges over one sample of so many that none of three seconds is left.
    """
    mass = np.asarray(vehicle.mass_matrix())
    lags = ("none", "sample", "near", "far")
    sums = {lag: (np.zeros(6), np.zeros(6), np.zeros(6)) for lag in lags}
    steps = []
    lost = 0
    for record in records:
        dt = record.trial.dt
        steps.append(dt)
        acceleration, known, diverged = _residual(vehicle, record)
        lost += diverged
        force = acceleration @ mass.T
        for lag, count in zip(
            lags, (0, 1, round(SETTINGS.near_s / dt), round(SETTINGS.far_s / dt)), strict=True
        ):
            both: Mask = np.asarray(known[: len(known) - count] & known[count:])
            summed, pushed, number = sums[lag]
            sums[lag] = (
                summed + _products(acceleration, count, both),
                pushed + _products(force, count, both),
                number + both.sum(axis=0),
            )
    covered: Mask = np.asarray(sums["far"][2] >= 2)
    if not covered.any() and lost:
        raise NumericalError(f"the vehicle diverges over one sample at {lost} samples of the log")
    if not covered.any():
        raise TrialError(
            f"filter noise: expected a trial with {SETTINGS.far_s:g} s of fitted samples without a gap,"
            f" found none;"
            " hold out less, or give NavigationFilter its force and acceleration"
        )
    moved = {
        lag: np.where(covered, total / np.maximum(count, 1), 0.0) for lag, (total, _, count) in sums.items()
    }
    forced = {
        lag: np.where(covered, total / np.maximum(count, 1), 0.0) for lag, (_, total, count) in sums.items()
    }
    dt = float(np.mean(steps))
    time_s = _memory(moved)
    slow = np.clip(forced["near"] * math.exp(SETTINGS.near_s / time_s), 0.0, forced["none"])
    share = np.divide(slow, forced["none"], out=np.zeros(6), where=forced["none"] > 0.0)
    # What the slow force leaves of the acceleration, and for how long it remembers itself.
    fast = moved["none"] * (1.0 - share)
    after = moved["sample"] - moved["none"] * share * math.exp(-dt / time_s)
    kept = np.clip(np.divide(after, fast, out=np.zeros(6), where=fast > 0.0), 0.1, 0.9)
    white = np.sqrt(2.0 * fast * dt / -np.log(kept))
    inertia = np.diag(mass)
    return FilterNoise(
        force=np.where(
            covered, np.maximum(np.sqrt(slow), _LEAST * inertia), SETTINGS.default_force * inertia
        ),
        force_time_s=time_s,
        acceleration=np.where(covered, np.maximum(white, SETTINGS.least_white), SETTINGS.default_white),
    )


def _products(series: Array, lag: int, both: Mask) -> Array:
    """Sum (6,) of the products of values that lie a lag apart, where both are known (n, 6)."""
    return np.asarray((series[: len(series) - lag] * series[lag:] * both).sum(axis=0))


def _memory(moved: dict[str, Array]) -> float:
    """Time constant in s from the autocovariances (6,) at the two lags, every axis in units of its own."""
    scale = np.where(moved["none"] > 0.0, moved["none"], np.inf)
    near, far = (float((moved[lag] / scale).clip(0.0).sum()) for lag in ("near", "far"))
    if near <= 0.0:
        return SETTINGS.memory_s[0]
    if far >= near:
        return SETTINGS.memory_s[1]
    decay = math.log(near / max(far, 1e-9 * near))
    return float(np.clip((SETTINGS.far_s - SETTINGS.near_s) / decay, *SETTINGS.memory_s))


def _residual(vehicle: Vehicle, record: Record) -> tuple[Array, Mask, int]:
    """Acceleration (n, 6) that a step of the model misses, m/s^2 and rad/s^2, and where it is known.

    And at how many samples it is not, because the model diverges.
    """
    trial = record.trial
    counted = record.counted[:, :6]
    known = np.vstack([counted[:-1] & counted[1:], np.zeros((1, 6), bool)])
    places = np.flatnonzero(known.any(axis=1))
    residual = np.zeros(counted.shape)
    if not len(places):
        return residual, known, 0
    states = trial.state(slice(None))
    begun = zip(*(map(tuple, part[places].tolist()) for part in states), strict=True)
    segments = tuple(Segment(0, k, k + 2, *state) for k, state in zip(places.tolist(), begun, strict=True))
    whole = Record(trial, record.input, np.ones_like(record.counted))
    substeps = _substeps(vehicle, record)
    shown = Replay(vehicle, (whole,), segments, substeps=substeps, starts_count=True).simulated()
    after = np.array([channels[1, :6] for channels in shown])
    residual[places] = (states[2][places + 1] - after) / trial.dt
    reach = np.maximum(np.abs(np.where(counted, states[2], 0.0)).max(axis=0), 1e-3)
    near = np.abs(residual) * trial.dt < SETTINGS.diverged_reach * reach  # false where it is no number
    finite: Mask = np.asarray(near.all(axis=1))[:, None]
    diverged = int((known.any(axis=1) & ~finite[:, 0]).sum())
    return np.where(finite, residual, 0.0), np.asarray(known & finite), diverged


def _substeps(vehicle: Vehicle, record: Record) -> int:
    """Steps of a sample that follow the vehicle's fastest pole at the speeds of the record."""
    trial = record.trial
    speeds = np.nan_to_num(np.abs(trial.nu)).max(axis=0)
    rate = stage_step(vehicle, (), free="".join(AXES), speeds=speeds, dt=trial.dt).rate
    needed = max(trial.dt / SETTINGS.substep_s, trial.dt * rate / STEP_SETTINGS.search_rate_limit)
    return int(min(max(math.ceil(needed - 1e-9), 1), SETTINGS.most_substeps))
