"""Predictions of a log in windows restarted every few seconds, and how far a valid model may miss it.

A closed loop hides errors of its model: the autopilot pushes harder, and the path is kept. It cannot hide
that the commands which it gave do not belong to the motion that followed: windows restarted from the smoothed
log and driven by the logged commands show that. Held by ``tests/verification/test_recorded_validity.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial._core import initial_names
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import TrialError, nearest
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import clause_of
from seatrial.scoring.record import Record, Replay, restarted
from seatrial.scoring.windows import default_input, predict, windows
from seatrial.trial.trial import Input

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class SpreadSettings:
    """How a log is cut into windows, and how far a valid model may miss it."""

    least_samples: int = 8  #: Fewer samples per window tell nothing of how an error grows.
    #: Longest step of the integration, s; the rates of vehicles of a metre and more stay well below its
    #: inverse.
    substep_s: float = 0.05
    steep: float = math.radians(70.0)  #: Pitch, rad, beyond which roll and yaw do not count.
    bins: int = 12  #: Parts of the time since a restart.
    normal_95: float = 1.959964  #: Quantile of the normal distribution for 95 % between both ends.
    #: Channel of every initial condition in the core's order: position, attitude, velocity.
    initial_places: tuple[int, ...] = (6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 4, 5)
    nominal: float = 0.05  #: Share of a valid model's samples outside a band of 95 %.
    least_share: float = 0.10  #: Share of a channel outside the band below which nothing is called wrong.
    grid: int = 32  #: Shares at which the tail is computed; between them it is nearly straight.
    quantiles: int = 64  #: Quantiles that stand for the distribution of a share.


SPREAD_SETTINGS = SpreadSettings()


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of what one window shows, (n, 12, d) by directions and (n, 12, 12) by its start."""

    by_direction: Array
    by_start: Array


@dataclass(frozen=True, eq=False)
class PredictedLog:
    """A log cut into windows, and what a vehicle predicts in them.

    `replay`: the log's windows as the model replays them. `predicted`, `residual`: per window (n, 12), SI:
    what the vehicle shows, and measured minus that, zero where it does not count.
    """

    replay: Replay
    predicted: tuple[Array, ...]
    residual: tuple[Array, ...]

    @property
    def vehicle(self) -> Vehicle:
        """The model."""
        return self.replay.vehicle

    @property
    def trial(self) -> Trial:
        """The log."""
        return self.replay.records[0].trial

    @property
    def input(self) -> Input:
        """What drives the vehicle: "commands", "measured" or "tau"."""
        return self.replay.records[0].input

    @property
    def spans(self) -> tuple[tuple[int, int], ...]:
        """First sample of every window, and one past its last."""
        return tuple((segment.start, segment.stop) for segment in self.replay.segments)

    @cached_property
    def counted(self) -> tuple[Mask, ...]:
        """Samples (n, 12) of every window that count: not the first, no masked one."""
        return tuple(self.replay.counted(index) for index in range(len(self.replay.segments)))

    @property
    def channels(self) -> list[str]:
        """Channels of which any sample counts, in the order of `CHANNELS`."""
        any_of = np.logical_or.reduce([mask.any(axis=0) for mask in self.counted])
        return [name for name, here in zip(CHANNELS, any_of, strict=True) if here]

    def since_restart(self, window: int) -> Array:
        """Times (n,) since the restart of a window, s."""
        first, last = self.spans[window]
        return np.asarray((np.arange(last - first)) * self.trial.dt)

    def times(self, window: int) -> Array:
        """Times (n,) of a window in the log's own time, s."""
        return np.asarray(self.trial.t[slice(*self.spans[window])])

    def of(self, changes: Mapping[str, float]) -> list[Array]:
        """Residuals (n, 12) of every window for the vehicle with other coefficients, SI."""
        return replace(self.replay, names=tuple(changes)).residuals(list(changes.values()))

    def in_water(self, current: Array) -> PredictedLog:
        """The same windows in another steady current (2,) or (3,), north, east, down, m/s."""
        water = np.tile(np.append(current, 0.0)[:3], (len(self.trial), 1))
        record = replace(self.replay.records[0], trial=replace(self.trial, current=water))
        replay = replace(self.replay, records=(record,))
        shown = replay.simulated()
        return PredictedLog(replay, tuple(shown), tuple(replay.errors_of(shown)))

    def without(self, axes: str) -> PredictedLog:
        """The same windows, of which no channel of these axes (letters) counts."""
        if not axes:
            return self
        record = self.replay.records[0]
        counted = record.counted.copy()
        counted[:, [place for place in range(len(CHANNELS)) if AXES[place % 6] in axes]] = False
        replay = replace(self.replay, records=(replace(record, counted=counted),))
        return PredictedLog(replay, self.predicted, tuple(replay.errors_of(self.predicted)))

    def slopes(
        self, directions: Sequence[Mapping[str, float]], *, current: bool = False
    ) -> tuple[Slopes, ...]:
        """Derivatives per window by directions of the coefficients, then by a current north and east.

        A direction holds the changes of coefficients that go with one unit of it. With `current` two more
        columns tell of a steady current, m/s.
        """
        names = sorted({name for direction in directions for name in direction})
        present = self.vehicle.coefficients()
        rows = np.array(
            [[direction.get(name, 0.0) for name in names] for direction in directions], dtype=float
        )
        nuisances = ["current_north", "current_east"] if current else []
        slopes = replace(self.replay, names=tuple(names)).sensitivities(
            np.array([present.get(name, 0.0) for name in names]),
            rows.reshape(len(directions), len(names)),
            nuisances=nuisances,
            initials=initial_names(),
        )
        count = len(directions) + len(nuisances)
        return tuple(Slopes(slope[:, :, :count], slope[:, :, count:]) for _, slope in slopes)


def restarts(
    vehicle: Vehicle,
    trial: Trial,
    *,
    ahead_s: float = 10.0,
    start_s: float | None = None,
    stop_s: float | None = None,
    input: Input | None = None,
) -> PredictedLog:
    """Windows of a log and what a vehicle predicts in them.

    `ahead_s`: length of a window, s. `start_s`, `stop_s`: part of the log, in its own time; all of it when
    omitted. `input`: what drives the vehicle; the first that is recorded when omitted. Raises TrialError: no
    window can start, or an input or the supply voltage is missing.
    """
    chosen = input or default_input(vehicle, trial)
    check_usable(trial, ahead_s)
    trial = under_water(trial, vehicle, start_s=start_s, stop_s=stop_s)
    spans, _, _ = windows(trial, ahead_s, start_s=start_s, stop_s=stop_s)
    # The last window may be a stump of a few samples, which tells nothing.
    full = max(last - first for first, last in spans)
    spans = [span for span in spans if span[1] - span[0] > full // 2] or spans
    prediction = predict(vehicle, trial, spans, input=chosen)
    # Nose up or down, roll and yaw are not told apart.
    steep = np.abs(np.nan_to_num(trial.observed[:, 10])) > SPREAD_SETTINGS.steep
    counted = trial.valid.copy()
    counted[steep, 9] = False
    counted[steep, 11] = False
    replay = Replay(
        vehicle,
        (Record(trial, chosen, counted),),
        tuple(restarted(trial, spans)),
        substeps=max(1, int(np.ceil(trial.dt / SPREAD_SETTINGS.substep_s - 1e-9))),
    )
    shown = tuple(window.simulated for window in prediction)
    return PredictedLog(replay, shown, tuple(replay.errors_of(shown)))


def under_water(
    trial: Trial, vehicle: Vehicle, *, start_s: float | None = None, stop_s: float | None = None
) -> Trial:
    """The trial without the samples at which the hull reaches the surface, where that is known.

    What a changed vehicle does there is far from linear in the change: a lighter one than the log's, that
    floats, rises no further. The rest needs no surface. All samples stay where the part from `start_s` to
    `stop_s` has less than a window under water.
    """
    if trial.surface is None:
        return trial
    depth = trial.observed[:, 8] - trial.surface
    pitch = np.nan_to_num(trial.observed[:, 10])
    # The top of the hull, half a hull of room for thrusters that draw air, and the end that the pitch lifts.
    measures, top = vehicle.geometry(), -float(vehicle.hull_top()[2])
    reach = 2.0 * top + 0.5 * measures.get("length", 0.0) * np.abs(np.sin(pitch))
    wet = ~(depth < reach)
    part = (trial.t >= (-np.inf if start_s is None else start_s)) & (
        trial.t < (np.inf if stop_s is None else stop_s)
    )
    # Ten seconds, a window, are the least that is worth leaving the rest out for.
    if (wet & part).sum() * trial.dt < 10.0:
        return trial
    return replace(trial, valid=trial.valid & wet[:, None], surface=None)


def check_usable(trial: Trial, ahead_s: float) -> None:
    """Refuse a log that measured nothing, a channel without a sample, an interval beyond the windows."""
    if not trial.channels:
        raise TrialError(
            f"{trial.name}: no motion was recorded: expected one at least of u_m_s, p_deg_s, z_m, yaw_deg and"
            " their like; log what the model predicts, or map the columns"
        )
    for name in trial.channels:
        # A position that is never known (fixes at the surface) keeps no window from starting.
        if name not in ("x", "y") and not trial.valid[:, CHANNELS.index(name)].any():
            raise TrialError(
                f"{trial.name}: {name}: expected samples that are numbers, found none that can be used;"
                " correct the column, or leave it out"
            )
    if trial.dt * SPREAD_SETTINGS.least_samples > ahead_s:
        raise TrialError(
            f"{trial.name}: one sample every {trial.dt:.3g} s: expected at least"
            f" {SPREAD_SETTINGS.least_samples} in a window of {ahead_s:g} s; give a log of a higher rate, or"
            " the unit of t_s if its times are not in seconds"
        )


def clustered_share(outside: Sequence[NDArray[np.bool_]]) -> tuple[float, int, float]:
    """Share of true samples, number of samples, and how many independent ones they are worth.

    `outside`: a mask (n,) per window. Neighbouring samples err alike, so a window is a cluster: the share x
    of all samples has the variance of the windows' sums (ratio estimator, Cochran, *Sampling Techniques*
    (1977), chapter 9), widened where neighbouring windows correlate by r > 0, and n samples of B windows are
    worth ``x (1 - x) / var(x) (t_{n-1} / t_{B-1})^2`` independent ones, at least one per window (fewer where
    they correlate), at most n (Korn & Graubard 1998, Survey Methodology 24:193).

    Examples
    --------
    >>> whole = [np.full(100, window % 20 == 0) for window in range(200)]
    >>> share, samples, worth = clustered_share(whole)
    >>> share, samples, round(worth)
    (0.05, 20000, 200)
    """
    from scipy.stats import t as student

    sizes = np.array([len(one) for one in outside], dtype=float)
    hits = np.array([one.sum() for one in outside], dtype=float)[sizes > 0]
    sizes = sizes[sizes > 0]
    n, count = float(sizes.sum()), len(sizes)
    if count < 2:
        return float(hits.sum() / max(n, 1.0)), int(n), float(count)
    share = float(hits.sum() / n)
    away = hits - share * sizes
    variance = count / (count - 1.0) * float(away @ away) / n**2
    # Windows that follow one another may err alike; the correlation of neighbours widens the variance.
    r = float(away[1:] @ away[:-1]) / max(float(away @ away), 1e-300)
    r = min(max(r, 0.0), 0.9)
    variance *= (1.0 + r) / (1.0 - r)
    least = count * (1.0 - r) / (1.0 + r)
    if variance <= 0.0:
        return share, int(n), least
    ratio = student.ppf(0.975, n - 1.0) / student.ppf(0.975, count - 1.0)
    return share, int(n), float(np.clip(share * (1.0 - share) / variance * ratio**2, least, n))


def share_interval(share: float, effective: float) -> tuple[float, float]:
    """Clopper and Pearson's interval of 95 % about a share of so many independent samples, whole or not."""
    from scipy.special import betaincinv

    hits, rest = share * effective, (1.0 - share) * effective
    low = float(betaincinv(hits, rest + 1.0, 0.025)) if hits > 0.0 else 0.0
    high = float(betaincinv(hits + 1.0, rest, 0.975)) if rest > 0.0 else 1.0
    return low, high


@dataclass(frozen=True, eq=False)
class Spread:
    """Standard deviation of a valid model's errors by the time since a restart.

    A model predicts no better than it did where it was known to hold: sensors err, the state at a restart
    errs with them, the water moves, and every model leaves something out.

    `since_s`, `sigma`: times (b,) in s, and the spread of each of `CHANNELS` there, (b, 12), SI; infinite
    where unknown. `noise`: the same in the first moments after a restart, (12,), SI. `windows`: how many
    windows it rests on. `basis`: where it comes from. `effective`: how many independent samples each channel
    rests on, (12,); infinite where it is taken for known.
    """

    since_s: Array
    sigma: Array
    noise: Array
    windows: int
    basis: Finding
    effective: Array = field(default_factory=lambda: np.full(12, np.inf))

    @property
    def source(self) -> str:
        """Where it comes from, in words."""
        return clause_of(self.basis, "mission_log")

    def at(self, since_s: Array) -> Array:
        """Spread (n, 12) at times (n,) since a restart, SI."""
        columns = [np.interp(since_s, self.since_s, column) for column in self.sigma.T]
        return np.stack(columns, axis=1)

    @property
    def factor(self) -> float:
        """Half-width of the 95 % band in units of the spread: Student's, for as few windows as there are."""
        from scipy.stats import t as student

        return float(student.ppf(0.975, max(self.windows - 1, 2)))


def spread_of_reference(references: Sequence[PredictedLog]) -> Spread:
    """Spread over logs on which the model is known to hold: rms, at least the 95 % quantile over 1.96, SI.

    Raises TrialError where there is no log, or fewer than six windows.
    """
    count = sum(len(one.spans) for one in references)
    if count < 6:
        raise TrialError(
            f"reference: expected logs of at least six windows on which the model is known to hold, found"
            f" {count}; give a longer log, or leave it out"
        )
    since = np.concatenate([one.since_restart(w) for one in references for w in range(len(one.spans))])
    error = np.concatenate([part for one in references for part in one.residual])
    counted = np.concatenate([part for one in references for part in one.counted])
    edges = np.linspace(0.0, since.max() + 1e-9, SPREAD_SETTINGS.bins + 1)
    sigma = np.full((SPREAD_SETTINGS.bins, 12), np.inf)
    for b in range(SPREAD_SETTINGS.bins):
        rows = (since >= edges[b]) & (since < edges[b + 1])
        for c in range(12):
            sizes = np.abs(error[rows, c][counted[rows, c]])
            if len(sizes):
                tail = float(np.quantile(sizes, 0.95)) / SPREAD_SETTINGS.normal_95
                sigma[b, c] = max(float(np.sqrt(np.mean(sizes**2))), tail)
    centres = 0.5 * (edges[1:] + edges[:-1])
    for c in range(12):  # a slow log, or fixes now and then, leave bins empty
        here = np.isfinite(sigma[:, c])
        if here.any():
            sigma[:, c] = np.interp(centres, centres[here], sigma[here, c])
    noise = _noise(references)
    names = list(dict.fromkeys(reference.trial.name for reference in references))
    basis = Finding("errors on logs", Severity.NOTE, values={"logs": names, "windows": count})
    spread = Spread(centres, sigma, noise, count, basis)
    return replace(spread, effective=_worth(references, spread))


def spread_of_errors(rms: Mapping[str, float], log: PredictedLog) -> Spread:
    """Spread from a root mean square error per channel: half of it constant, half a random walk, SI.

    Raises TrialError where a channel is unknown or its error no positive number.
    """
    for name, value in rms.items():
        if name not in CHANNELS:
            raise TrialError(f'reference: "{name}" is no channel{nearest(name, CHANNELS)}')
        if not (np.isfinite(value) and value > 0.0):
            raise TrialError(f"reference: {name}: expected a positive error in SI, found {value!r}")
    longest = max(log.since_restart(w)[-1] for w in range(len(log.spans)))
    share = np.linspace(0.0, 1.0, SPREAD_SETTINGS.bins)
    level = np.array([rms.get(name, np.inf) for name in CHANNELS])
    sigma = np.where(np.isfinite(level), level, np.inf) * np.sqrt(0.5 + share)[:, None]
    basis = Finding("errors given", Severity.NOTE)
    return Spread(longest * share, sigma, np.minimum(_noise([log]), sigma[0]), 1_000_000, basis)


def spread_of_noise(log: PredictedLog) -> Spread:
    """Spread from the log's own noise n and what it does to a start: ``n^2 + sum_k (dy/dx0_k n_k)^2``, SI.

    It has no room for what every model leaves out: it suits generated logs and very good models.
    """
    noise = _noise([log])
    slopes = log.slopes([])
    width = max(len(one.by_start) for one in slopes)
    total, seen = np.zeros((width, 12)), np.zeros((width, 1))
    start = np.nan_to_num(noise[list(SPREAD_SETTINGS.initial_places)])
    for one in slopes:
        with np.errstate(over="ignore"):  # an unstable model forgets its start the other way round
            total[: len(one.by_start)] += ((one.by_start * start) ** 2).sum(axis=2)
        seen[: len(one.by_start)] += 1.0
    variance = total / np.maximum(seen, 1.0)
    since = np.arange(width) * log.trial.dt
    keep = np.unique(np.linspace(0, width - 1, 4 * SPREAD_SETTINGS.bins).astype(int))
    sigma = np.sqrt(noise**2 + variance[keep])
    sigma[:, ~np.isfinite(noise)] = np.inf
    return Spread(since[keep], sigma, noise, len(log.spans), Finding("noise alone", Severity.NOTE))


def _worth(references: Sequence[PredictedLog], spread: Spread) -> Array:
    """How many independent samples (12,) the tail of each channel rests on."""
    found = np.full(12, np.inf)
    bands = [
        SPREAD_SETTINGS.normal_95 * spread.at(reference.since_restart(w))
        for reference in references
        for w in range(len(reference.spans))
    ]
    errors = [error for one in references for error in one.residual]
    masks = [mask for one in references for mask in one.counted]
    for c in np.flatnonzero(np.isfinite(spread.sigma).all(axis=0)):
        found[c] = clustered_share([
            (np.abs(e[:, c]) > b[:, c])[m[:, c]] for e, b, m in zip(errors, bands, masks, strict=True)
        ])[2]
    return found


def _noise(logs: Sequence[PredictedLog]) -> Array:
    """Root mean square (12,) of the errors in the first moments after a restart; infinite without any."""
    squares, samples = np.zeros(12), np.zeros(12)
    for log in logs:
        # In the first half second no model error has had the time to show: what is seen is noise.
        rows = max(2, 1 + round(0.5 / log.trial.dt))
        for error, mask in zip(log.residual, log.counted, strict=True):
            squares += (error[:rows] ** 2).sum(axis=0)
            samples += mask[:rows].sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        noise = np.sqrt(squares / samples)
    # A channel that repeats exactly has the noise of its last digit, which is not nothing.
    return np.where(samples > 0, np.maximum(noise, 1e-6), np.inf)


@dataclass(frozen=True, eq=False)
class ExpectedShare:
    """Shares (m,) that a valid model may leave outside, with their weights (m,), from so many draws.

    Of a valid model a share of the samples lies outside the 95 % band: 5 % of them, or more where the vehicle
    has coefficients, or the sensors offsets, that their covariance allows. Where the 5 % themselves rest on a
    reference worth n_r samples, the share x_j of a draw is Beta(n_r x_j, n_r (1 - x_j)).
    """

    shares: Array
    weights: Array
    draws: int

    @classmethod
    def of(cls, shares: Array | None, rests_on: float) -> ExpectedShare:
        """Expected share by draw (k,), nominal without draws, known from so many independent samples.

        `rests_on` is infinite where the nominal share is known.

        Examples
        --------
        >>> known = ExpectedShare.of(None, float("inf"))
        >>> round(known.p(0.2, 40.0), 4)
        0.0007
        """
        from scipy.special import betaincinv

        x = np.maximum(
            np.full(1, SPREAD_SETTINGS.nominal) if shares is None else shares, SPREAD_SETTINGS.nominal
        )
        grid: Array = np.geomspace(
            SPREAD_SETTINGS.nominal, max(float(x.max()), 1.01 * SPREAD_SETTINGS.nominal), SPREAD_SETTINGS.grid
        )
        grid = np.minimum(grid, 1.0 - 1e-9)
        # The tail rises with x ever faster: to the neighbours on the grid is to the safe side.
        place = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, SPREAD_SETTINGS.grid - 2)
        part = np.clip((x - grid[place]) / (grid[place + 1] - grid[place]), 0.0, 1.0)
        low, high = (
            np.bincount(place, 1.0 - part, SPREAD_SETTINGS.grid),
            np.bincount(place + 1, part, SPREAD_SETTINGS.grid),
        )
        weights = np.asarray(low + high, dtype=float)
        held = weights > 0.0
        grid, weights = grid[held], weights[held] / len(x)
        if np.isfinite(rests_on):
            rank = (np.arange(SPREAD_SETTINGS.quantiles) + 0.5) / SPREAD_SETTINGS.quantiles
            spread = betaincinv(rests_on * grid[:, None], rests_on * (1.0 - grid[:, None]), rank)
            grid, weights = (
                spread.ravel(),
                np.repeat(weights / SPREAD_SETTINGS.quantiles, SPREAD_SETTINGS.quantiles),
            )
        return cls(grid, weights, 0 if shares is None else len(x))

    def p(self, share: float, effective: float) -> float:
        """P-value of a share outside of effectively so many independent samples.

        That of h of n* samples is ``(1 + sum_j P(X >= h | n*, x_j)) / (1 + K)``, X binomial (the predictive
        p-value of Box 1980, JRSS A 143:383). The ones are what K draws cannot tell: a vehicle further out
        than all of them is possible (Davison & Hinkley 1997, *Bootstrap Methods*, section 4.2).
        """
        from scipy.special import betainc

        hits = share * effective
        if hits <= 0.0:
            return 1.0
        tail = float(self.weights @ betainc(hits, effective - hits + 1.0, self.shares))
        return (1.0 + self.draws * tail) / (1.0 + self.draws) if self.draws else tail
