"""The cost of a set of gains.

    J = 10 Q + 30 M + 0.05 (O + T) + s S + 0.1 E

Q is the constraint criterion in s (eq. 55-57 of Taubert et al., 2014, (57) corrected), the mean over
trials, and of the samples the worst or a quantile; M is the shortfall of the margins; both are zero for
feasible gains. O is what is off at the end, in s: the mean offset over the last quarter of the corridor
beyond 1 % of the step, and an integral that is slow. A corridor is wide at its end, as noise needs room, and
the feed-forward knows the drag of the vehicle that the search flies: without O an integral that leaves an
error of the model for a minute would cost nothing. With the integral time T_i = K_P/K_I at the speeds tried

    O = mean((|offset| - 0.01)+ t_until) + 0.1 t_until mean(ln(T_i / T_most)+)
    T_most = max(t_until / 4, T_i of the start gains)

T, the time-weighted error over the time, and E, the rate at which commands move, break the tie. An integral
of violations grows with the square of how far a response leaves its corridor, so that a
search would settle a little outside: the search sees corridors that are narrower by a headroom.

S, the roughness along the breakpoints, keeps a schedule from jumping. Over each three neighbouring points the
divided second difference of ln g with the speed x, in units of the mean spacing h of the points:

    d_i = 2 h^2 [(ln g_{i+1} - ln g_i)/(x_{i+1} - x_i) - (ln g_i - ln g_{i-1})/(x_i - x_{i-1})]
          / (x_{i+1} - x_{i-1})

S is the sum of d_i^2 over all gains: 0 where a gain grows by equal factors, and for the ratio of two
neighbours it is the same whether the gain is in N or kN. Three neighbours of which one is zero (no integral
there) stand aside, and so do points that are not reached. Source: Whittaker (1923), *On a new method of
graduation*, for the sum of squared differences.

Held by tests/tuning/test_tuning_objective.py and tests/tuning/test_gain_smoothness.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.tuning.scope import GainParameters
from seatrial.tuning.step_trial import RIDES_ON, LoopTrials, Rig, Samples

if TYPE_CHECKING:
    from seatrial.control_design.margin_constraint import MarginConstraint

Gains = Mapping[str, ArrayLike]

_NEIGHBOURS = 3  # points that a second difference takes


def roughness(gains: Gains, reachable: ArrayLike, *, speeds_m_s: ArrayLike) -> Array:
    """Sum of squared second differences of ln(gain) along the breakpoints that are reached, (k,),
    dimensionless, of gains (k,) by the names of `Autopilot.gains`. Gains with fewer than three reached
    points cost nothing.

    Examples
    --------
    >>> steady = {f"heading.K_P.{i}": 30.0 * 2.0**i for i in range(1, 7)}
    >>> kinked = steady | {"heading.K_P.3": [240.0, 240.0 * np.e]}
    >>> roughness(kinked, [True] * 6, speeds_m_s=range(6)).round(6)
    array([0., 6.])
    """
    reached, speeds = _points(reachable, speeds_m_s)
    spacing = float(np.diff(speeds).mean())
    count = max((len(np.atleast_1d(np.asarray(values))) for values in gains.values()), default=1)
    total = np.zeros(count)
    for points in _by_gain(gains).values():
        named = [i for i in sorted(points) if i < len(reached) and reached[i]]
        if len(named) < _NEIGHBOURS:
            continue
        values = np.array([np.broadcast_to(np.asarray(gains[points[i]], float), count) for i in named])
        given = values > 0.0
        logarithm = np.log(np.where(given, values, 1.0))
        x = speeds[named, None] / spacing
        slope = np.diff(logarithm, axis=0) / np.diff(x, axis=0)
        second = 2.0 * np.diff(slope, axis=0) / (x[2:] - x[:-2])
        total += np.sum(np.where(given[:-2] & given[1:-1] & given[2:], second, 0.0) ** 2, axis=0)
    return total


def _points(reachable: ArrayLike, speeds_m_s: ArrayLike | Sequence[float]) -> tuple[NDArray[np.bool_], Array]:
    """Both as arrays of the same length."""
    reached, speeds = np.asarray(reachable, dtype=bool), np.asarray(speeds_m_s, dtype=float)
    if reached.shape != speeds.shape or reached.ndim != 1:
        raise CampaignError(
            f"expected as many points reached or not as breakpoints, found {reached.shape} and"
            f" {speeds.shape}; give one of each per point"
        )
    return reached, speeds


def _by_gain(gains: Gains) -> dict[str, dict[int, str]]:
    """Per gain ("heading.K_P") the names of its points by their place from 0."""
    points: dict[str, dict[int, str]] = {}
    for name in gains:
        gain, _, point = name.rpartition(".")
        if gain and point.isdecimal():
            points.setdefault(gain, {})[int(point) - 1] = name
    return points


@dataclass(frozen=True)
class ObjectiveSettings:
    """What counts how much in the objective of a search of gains."""

    headroom_share: float = 0.02  #: By how much the search's corridors are narrower, as a share of the step.
    outside_weight: float = 10.0  #: Weight of a second outside the corridors, against what breaks ties.
    margin_weight: float = 30.0  #: Weight of a margin that is used up, against what breaks ties.
    free_offset_share: float = 0.01  #: Steady offset, as a share of the step, that costs nothing.
    #: Time constant of an error that falls to 2 % by the end of a corridor, over the corridor's time.
    settled_share: float = 0.25
    #: Cost of an integral that is e times slower than that, as a share of the corridor's time.
    slow_integral_weight: float = 0.1
    #: Weight of the time-weighted error, which breaks ties: far below `outside_weight` and `margin_weight`.
    time_weight: float = 0.05
    effort_weight: float = 0.1  #: Weight of the effort, which breaks ties, too.
    #: Weight of the mean over samples beside the worst: every one that gets better counts.
    mean_weight: float = 0.1


SETTINGS = ObjectiveSettings()


@dataclass(frozen=True, eq=False)
class Terms:
    """Parts of the cost of k candidates, (k,) each: Q (s), M, O (s), T (s), S and E (1/s)."""

    violation: Array
    margin: Array
    offset: Array
    time: Array
    roughness: Array
    effort: Array

    def cost(self, smoothness: float) -> Array:
        """J, (k,)."""
        ties = (
            SETTINGS.time_weight * (self.offset + self.time)
            + smoothness * self.roughness
            + SETTINGS.effort_weight * self.effort
        )
        return np.asarray(
            SETTINGS.outside_weight * self.violation + SETTINGS.margin_weight * self.margin + ties
        )


@dataclass(frozen=True, eq=False)
class Flown:
    """What k candidates did with s samples, mean over trials and loops, (k, s) each."""

    violation: Array  #: Q of each sample, s; infinite for what diverged.
    offset: Array  #: Off at the end, s, without the part of a slow integral.
    #: `time`, `effort`: T, s, and E, 1/s.
    time: Array
    effort: Array

    @classmethod
    def none(cls, candidates: int, samples: int) -> Flown:
        """Nothing flown yet: no term is below this."""
        return cls(*(np.zeros((candidates, samples)) for _ in range(4)))

    @property
    def parts(self) -> tuple[Array, ...]:
        """All four, in the order of the attributes."""
        return self.violation, self.offset, self.time, self.effort

    def put(self, rows: ArrayLike, columns: ArrayLike, other: Flown) -> None:
        """Take what some candidates did with some samples."""
        where = np.ix_(np.asarray(rows), np.asarray(columns))
        for own, new in zip(self.parts, other.parts, strict=True):
            own[where] = new


@dataclass(frozen=True, eq=False)
class Still:
    """What of the cost of k candidates takes no flight, (k,) each: M, slow integrals (s, of O), S."""

    margin: Array
    slow: Array
    roughness: Array


@dataclass(frozen=True, eq=False)
class Objective:
    """Cost of candidates of some gains, all others as they are."""

    rig: Rig  #: The closed loop with the gains that are not searched.
    trials: tuple[LoopTrials, ...]  #: One per loop or path of the search.
    samples: Samples  #: What each candidate meets.
    parameters: GainParameters  #: What is searched.
    margins: MarginConstraint | None  #: Limits of the margins; None for none.
    quantile: float  #: Over the samples; 1.0 is the worst.
    smoothness: float  #: Weight of the roughness.
    reached: NDArray[np.bool_]  #: Whether the vehicle reaches each breakpoint.
    #: Gains of the campaign's autopilot, whose integral times are slow enough; none: those of the rig.
    start: Mapping[str, float] | None = None

    def __call__(self, x: Array) -> Array:
        """Costs (k,) of candidates (k, m)."""
        return self.terms(self.parameters.gains(x)).cost(self.smoothness)

    def terms(self, gains: Mapping[str, Array], *, headroom: float = SETTINGS.headroom_share) -> Terms:
        """Parts of the cost of k sets of gains."""
        return self.joined(self.still(gains), self.flown(gains, headroom=headroom))

    def of_samples(self, places: Sequence[int]) -> Objective:
        """The same cost with some of the samples, the vehicle itself first."""
        return replace(self, samples=self.samples.of(places))

    def flown(self, gains: Mapping[str, Array], *, headroom: float = SETTINGS.headroom_share) -> Flown:
        """What k sets of gains do with the samples."""
        k = len(next(iter(gains.values())))
        flown = Flown.none(k, len(self.samples))
        share = 1.0 / len(self.trials)
        for trials in self.trials:
            sums, travel, off = self.rig.violations(trials, self.samples, gains, headroom=headroom)
            flown.violation[:] += share * violated(trials, sums).mean(axis=1)
            flown.time[:] += share * sums[..., 0, 2].mean(axis=1) / trials.until_s
            # What diverges is off without end.
            beyond = (
                np.maximum(np.where(np.isnan(off), np.inf, off) - SETTINGS.free_offset_share, 0.0)
                * trials.until_s
            )
            flown.offset[:] += share * beyond.mean(axis=1)
            flown.effort[:] += share * np.where(np.isnan(travel), np.inf, travel).mean(axis=1)
        return flown

    def still(self, gains: Mapping[str, Array]) -> Still:
        """What takes no flight of the cost of k sets of gains."""
        k = len(next(iter(gains.values())))
        slow = sum(self._slow_integral(trials, gains) for trials in self.trials) / len(self.trials)
        loops = {name.partition(".")[0] for name in gains}
        # Points that another group sets belong to the schedule all the same.
        every = {name: np.full(1, value) for name, value in self.rig.autopilot.gains().items()}
        every = {name: values for name, values in every.items() if name.partition(".")[0] in loops} | dict(
            gains
        )
        named = {name: values for name, values in every.items() if name.rpartition(".")[2].isdigit()}
        rough = (
            roughness(named, self.reached, speeds_m_s=self.rig.autopilot.speeds_m_s) if named else np.zeros(1)
        )
        lacking = np.zeros(k) if self.margins is None else self.margins.shortfall(gains)
        return Still(lacking, np.broadcast_to(slow, (k,)), np.broadcast_to(rough, (k,)))

    def joined(self, still: Still, flown: Flown) -> Terms:
        """Parts of the cost; where a sample was not flown yet, the least that they can be."""
        return Terms(
            violation=robust(flown.violation, self.quantile, nominal=self.samples.nominal),
            margin=still.margin,
            offset=flown.offset.mean(axis=1) + still.slow,
            time=flown.time.mean(axis=1),
            roughness=still.roughness,
            effort=flown.effort.mean(axis=1),
        )

    def _slow_integral(self, trials: LoopTrials, gains: Mapping[str, Array]) -> Array:
        """What integrals cost that are slower than the corridor and the start gains, (k,), s."""
        autopilot, loop = self.rig.autopilot, RIDES_ON.get(trials.loop, trials.loop)
        points = np.asarray(autopilot.speeds_m_s)
        weights = np.array([np.interp(trials.speeds, points, row) for row in np.eye(len(points))]).T

        def integral_time(values: Mapping[str, ArrayLike]) -> Array:
            def of(key: str) -> Array:
                columns = [
                    np.atleast_1d(values.get(f"{loop}.{key}.{n + 1}", 0.0)) for n in range(len(points))
                ]
                return np.asarray(weights @ np.stack(np.broadcast_arrays(*columns)).astype(float))

            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(of("K_P") / of("K_I"))

        now = autopilot.gains()
        enough = np.maximum(
            SETTINGS.settled_share * trials.until_s, integral_time(now if self.start is None else self.start)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            slower = np.log(integral_time({**now, **gains}) / enough)  # nan: neither has an integral
        beyond = np.nan_to_num(np.maximum(slower, 0.0), nan=0.0)
        return np.asarray(SETTINGS.slow_integral_weight * trials.until_s * beyond.mean(axis=0))


def violated(trials: LoopTrials, sums: Array) -> Array:
    """Weighted violation, s, (k, trials, samples), of sums (k, trials, samples, corridors, 3)."""
    weights = np.ones((sums.shape[-2], 2))
    weights[0] = trials.corridor.weight_lower, trials.corridor.weight_upper
    sides = sums[..., :2]
    counted = np.where(np.isfinite(sides) & (weights > 0.0), sides, 0.0)
    diverged = np.isinf(sides).any(axis=(-1, -2))
    return np.where(diverged, np.inf, (counted * weights).sum(axis=(-1, -2)))


def robust(total: Array, quantile: float, *, nominal: int = 0) -> Array:
    """Worst or a quantile over the samples, and a tenth of their mean, (k,), of violations (k, samples). Of
    the first `nominal` samples, the vehicle itself, the worst counts at any quantile: it is what a tuning
    is feasible by.
    """
    sound = np.isfinite(total).all(axis=1)
    bounded = np.where(np.isfinite(total), total, 0.0)
    own, drawn = bounded[:, :nominal], bounded[:, nominal:]
    worst = own.max(axis=1, initial=0.0)
    if drawn.shape[1]:
        worst = np.maximum(worst, np.quantile(drawn, quantile, axis=1))
    cost = worst + SETTINGS.mean_weight * bounded.mean(axis=1)
    return np.where(sound, cost, np.inf)
