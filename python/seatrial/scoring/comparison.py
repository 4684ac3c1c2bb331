"""Which of several vehicles predicts the same trials better, and whether the trials can tell.

Every vehicle is simulated in the same windows, each restarted from the measured state, so that the windows
pair the vehicles. Two measures are judged: the difference of R2, which a few bad
windows decide, and the ratio of the mean errors in a typical window. The question which vehicle is better has
one answer, the error ratio over all channels alike; the channels say where. The channels' intervals hold
jointly, for both measures and all vehicles (Bonferroni): one that leaves "no difference" out is a difference
that the windows tell.

Held by `test_difference_is_that_of_the_scores`, `test_two_names_of_one_vehicle_are_not_told_apart` and
`test_the_better_vehicle_is_named`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Unpack

import numpy as np

from seatrial.base.channels import AXES
from seatrial.base.errors import TrialError
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, words_about
from seatrial.scoring.baseline_fit import fit_baselines
from seatrial.scoring.score import Score, ScoreOptions, score
from seatrial.scoring.windows import Predictions, Window, limits_of
from seatrial.trial.trial import Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle
import math

from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.scoring.windows import channel_errors, judging
from seatrial.statistics.blocks import lag_one_correlation, variance_inflation

Interval = tuple[float, float]
Verdict = Literal["better", "worse", "mixed", "not told apart", "too few windows", "diverged"]


@dataclass(frozen=True)
class Overall:
    """How a vehicle differs from the reference, named `against`, over all channels.

    `error_ratio`: mean absolute error of the vehicle over that of the reference in a typical window, the
    channels' logarithms averaged in every window; `error_interval` holds at the comparison's level, None with
    too few windows or where a simulation diverged. `windows`: those that count. `verdict`: "better" or
    "worse" where the interval leaves one out; "not told apart", "too few windows" or "diverged".
    """

    vehicle: str
    against: str
    error_ratio: float
    error_interval: Interval | None
    windows: int
    verdict: Verdict


@dataclass(frozen=True)
class Difference:
    """How a vehicle differs from the reference in one channel, otherwise as `Overall`.

    `r2`, `mae`: scores of the reference and of the vehicle, in this order; mae in SI. `r2_difference`: R2 of
    the vehicle minus that of the reference. Both intervals hold jointly with those of all channels and
    vehicles. The `verdict` is also "mixed", where they contradict one another.
    """

    vehicle: str
    against: str
    channel: str
    r2: tuple[float, float]
    mae: tuple[float, float]
    r2_difference: float
    r2_interval: Interval | None
    error_ratio: float
    error_interval: Interval | None
    windows: int
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class Comparison(Reported, Plain, only="reference level vehicles=scores overall differences sentences"):
    """Scores of several vehicles on the same windows, side by side; printed, a table and sentences.

    `scores`: score of every vehicle by name, the reference first. `overall`: an `Overall` per further
    vehicle: which one is better. `differences`: a `Difference` per further vehicle and channel: where.
    `level`: probability with which the intervals of the vehicles hold together, and those of all channels.
    """

    scores: dict[str, Score]
    overall: tuple[Overall, ...]
    differences: tuple[Difference, ...]
    level: float

    @property
    def reference(self) -> str:
        """Name of the vehicle that the others are compared with."""
        return next(iter(self.scores))

    @property
    def trials(self) -> tuple[str, ...]:
        """Names of the trials."""
        return self.scores[self.reference].trials

    def of(self, vehicle: str) -> dict[str, Difference]:
        """Differences of one vehicle from the reference, by channel."""
        return {d.channel: d for d in self.differences if d.vehicle == vehicle}

    def sentences(self) -> tuple[str, ...]:
        """What the windows tell of every further vehicle, and what they do not."""
        return tuple(words_about(self, "score"))

    def __repr__(self) -> str:
        return f"Comparison({', '.join(self.scores)} on {', '.join(self.trials)})"


def compare(
    vehicles: Mapping[str, Vehicle | Predictions],
    trials: Trial | Sequence[Trial],
    *,
    training: Trial | Sequence[Trial] = (),
    level: float = 0.95,
    **options: Unpack[ScoreOptions],
) -> Comparison:
    """Comparison of vehicles on the same windows of the same trials; the first one is the reference.

    Parameters
    ----------
    vehicles
        Models, or predictions of others, by the names under which they are to be shown, at least two. All are
        judged on the windows and channels that every table of predictions covers.
    trials, training
        As for `seatrial.score`.
    level
        Probability with which all intervals hold together.
    **options
        ahead_s, channels, start_s, stop_s, free_run, input, free, measured, own_stamps: as for
        `seatrial.score`.

    Raises
    ------
    TrialError
        There is one vehicle only, the level is no probability, or as for `seatrial.score`.

    Examples
    --------
    >>> import numpy as np
    >>> import seatrial as st
    >>> from seatrial.scoring.comparison import compare
    >>> vehicle, t = st.Vehicle.load("cwolf"), np.arange(0.0, 120.0, 0.1)
    >>> commands = {name: 300.0 * np.sin(t / 5.0) + 800.0 for name in vehicle.actuators}
    >>> run = vehicle.simulate(t, commands)
    >>> columns = {"t_s": t, "u_m_s": run.nu[:, 0]} | {f"cmd.{n}": c for n, c in commands.items()}
    >>> found = compare(
    ...     {"own": vehicle, "heavier": vehicle.with_coefficients({"X_udot": -60.0})}, st.Trial.read(columns)
    ... )
    >>> found.of("heavier")["u"].verdict
    'worse'
    """
    if len(vehicles) < 2:
        raise TrialError(
            f"compare: expected two vehicles or more, found {len(vehicles)}; use score for a single one"
        )
    if not 0.0 < level < 1.0:
        raise TrialError(f"compare: level: expected a probability between 0 and 1, found {level!r}")
    own = [trials] if isinstance(trials, Trial) else list(trials)
    model = next((vehicle for vehicle in vehicles.values() if not isinstance(vehicle, Predictions)), None)
    limits = limits_of(own, model)
    scores = {
        name: score(vehicle, trials, **options, training=None, limits=limits)
        for name, vehicle in vehicles.items()
    }
    scores = _shared(scores, {n: v for n, v in vehicles.items() if isinstance(v, Predictions)})
    first, *others = scores
    learnt = [training] if isinstance(training, Trial) else training
    baselines = fit_baselines(
        learnt,
        vehicle=model,
        input=options.get("input"),
        free=options.get("free", "".join(AXES)),
        measured=options.get("measured", ""),
    )
    simple = baselines.r2(scores[first].windows, scores[first].evidence, limits)
    scores = {name: replace(scored, baselines=simple) for name, scored in scores.items()}
    # A channel that never moves has no R2, and one that is replayed is no evidence.
    compared = [c for c, channel in scores[first].items() if not (np.isnan(channel.r2) or channel.replayed)]
    alpha = (1.0 - level) / max(len(others), 1)
    pairs = {
        (name, channel): PairedWindows.of(scores[first], scores[name], channel)
        for name in others
        for channel in compared
    }
    return Comparison(
        scores,
        overall=tuple(_overall(first, name, [pairs[name, c] for c in compared], alpha) for name in others),
        differences=tuple(
            _difference(scores, first, name, channel, pair=pair, alpha=alpha / (2 * len(compared)))
            for (name, channel), pair in pairs.items()
        ),
        level=level,
    )


def _shared(scores: dict[str, Score], tables: Mapping[str, Predictions]) -> dict[str, Score]:
    """The scores on what every table of predictions covers: its windows, and its channels."""
    if not tables:
        return scores
    common = [c for c in next(iter(scores.values())) if all(c in scores[name] for name in tables)]
    spans = set.intersection(*({_span_of(w) for w in scores[name].windows} for name in tables))
    source = " and ".join(table.source for table in tables.values())
    return {
        name: scored.only(np.array([_span_of(w) in spans for w in scored.windows]), common, source)
        for name, scored in scores.items()
    }


def _span_of(window: Window) -> tuple[str, int, int]:
    return window.trial.name, window.start, window.stop


def _overall(first: str, name: str, pairs: Sequence[PairedWindows], alpha: float) -> Overall:
    """Difference of one vehicle from the first over all channels, interval of confidence 1 - alpha."""
    if not pairs or any(pair.diverged for pair in pairs):
        return Overall(name, first, np.nan, None, 0, "diverged" if pairs else "too few windows")
    table = np.array([pair.logs for pair in pairs])
    known = np.isfinite(table).any(axis=0)
    factor, interval = typical(np.nanmean(table[:, known], axis=0), pairs[0].trials[known], alpha=alpha)
    verdict = "too few windows" if interval is None else _verdict((0.0, 0.0), interval)
    return Overall(name, first, factor, interval, int(known.sum()), verdict)


def _difference(
    scores: Mapping[str, Score], first: str, name: str, channel: str, *, pair: PairedWindows, alpha: float
) -> Difference:
    """Difference of one vehicle from the first in one channel, with intervals of confidence 1 - alpha."""
    a, b = scores[first][channel], scores[name][channel]
    r2, r2_interval = b.r2 - a.r2, None
    factor, interval = np.nan, None
    verdict: Verdict = "diverged"
    if not pair.diverged:
        r2, r2_interval = ratio(pair.a[:, 0] - pair.b[:, 0], pair.a[:, 2], pair.trial, alpha=alpha)
        factor, interval = typical(pair.logs[np.isfinite(pair.logs)], pair.trial, alpha=alpha)
        verdict = _verdict(r2_interval, interval)
    return Difference(
        vehicle=name,
        against=first,
        channel=channel,
        r2=(a.r2, b.r2),
        mae=(a.mae, b.mae),
        r2_difference=r2,
        r2_interval=r2_interval,
        error_ratio=factor,
        error_interval=interval,
        windows=len(pair.trial),
        verdict=verdict,
    )


def _verdict(r2: Interval | None, error: Interval | None) -> Verdict:
    """What the intervals of both differences say together."""
    if r2 is None or error is None:
        return "too few windows"
    better = r2[0] > 0.0 or error[1] < 1.0
    worse = r2[1] < 0.0 or error[0] > 1.0
    if better and worse:
        return "mixed"
    return "better" if better else "worse" if worse else "not told apart"


@dataclass(frozen=True)
class PairSettings:
    """When windows of two models give an interval."""

    fewest_windows: int = 6  #: Windows below which no interval is given.
    most_alike: float = 0.9  #: Autocorrelation of neighbouring windows that is believed at most.


PAIR_SETTINGS = PairSettings()


@dataclass(frozen=True, eq=False)
class PairedWindows:
    """One channel of two scores on the same windows.

    `a`, `b`: `window_sums` of either (n, 4), of the windows in which samples count; `trial` (n,) names the
    trial of each. `logs`: `log_errors` (windows,) of all windows, not a number where no sample counts;
    `trials` (windows,) names the trial of each.
    """

    a: Array
    b: Array
    trial: NDArray[np.str_]
    logs: Array
    trials: NDArray[np.str_]

    @classmethod
    def of(cls, first: Score, second: Score, channel: str) -> PairedWindows:
        """Windows of one channel of two scores."""
        a, b = window_sums(first, channel), window_sums(second, channel)
        trials = np.array([window.trial.name for window in first.windows])
        counted = a[:, 3] > 0
        logs = np.full(len(a), np.nan)
        logs[counted] = log_errors(a[counted, 1] / a[counted, 3], b[counted, 1] / b[counted, 3])
        return cls(a[counted], b[counted], trials[counted], logs, trials)

    @property
    def diverged(self) -> bool:
        """Whether one of the simulations is not finite."""
        return not (np.isfinite(self.a).all() and np.isfinite(self.b).all())


def window_sums(score: Score, channel: str) -> Array:
    """Sums (windows, 4) of one channel: squared errors, absolute errors, measured squared, samples; SI.

    Zero for windows of trials that cannot judge the channel.
    """
    judged = judging(channel, score.windows, score.limits)
    rows = np.zeros((len(score.windows), 4))
    kept = {id(window) for window in judged}
    places = (place for place, window in enumerate(score.windows) if id(window) in kept)
    for place, error, away in zip(places, *channel_errors(channel, judged), strict=True):
        rows[place] = float(error @ error), float(np.abs(error).sum()), float(away @ away), len(error)
    return rows


def ratio(y: Array, x: Array, trial: NDArray[np.str_], *, alpha: float) -> tuple[float, Interval | None]:
    """Ratio of the sums of y and x (n,) and its interval of confidence 1 - alpha, None below six windows.

    So is the difference of R2: ``sum_k (SSE_A,k - SSE_B,k) / sum_k SST_k`` over the windows, all samples
    alike; a few bad windows decide it. The variance of ``D = sum y_k / sum x_k`` is that of its linear
    residuals ``e_k = y_k - D x_k`` (Cochran, *Sampling Techniques*, 1977, section 6.4).

    Sums are per window, in the order of time within a trial; x is positive in total. `trial` (n,) names the
    trial of each window: only windows of one trial are neighbours.
    """
    total = float(x.sum())
    if not total > 0.0:
        return math.nan, None
    value = float(y.sum()) / total
    reach = _reach(y - value * x, trial, alpha) * len(y) / total
    return value, (value - reach, value + reach) if math.isfinite(reach) else None


def log_errors(a: Array, b: Array) -> Array:
    """Logarithm (n,) of the errors b over the errors a of every window."""
    # Two perfect windows are alike, and one of them is not infinitely better than rounding.
    least = 1e-9 * max(float(a.max(initial=0.0)), float(b.max(initial=0.0)), 1e-300)
    return np.asarray(np.log(np.maximum(b, least) / np.maximum(a, least)))


def typical(logs: Array, trial: NDArray[np.str_], *, alpha: float) -> tuple[float, Interval | None]:
    """Factor between the errors in a typical window from its logarithms (n,); interval as for `ratio`.

    ``exp(mean_k ln(MAE_B,k / MAE_A,k))``, all windows alike: a few bad ones do not decide it.
    """
    value = float(logs.mean()) if len(logs) else math.nan
    reach = _reach(logs - value, trial, alpha)
    interval = (math.exp(value - reach), math.exp(value + reach)) if math.isfinite(reach) else None
    return math.exp(value), interval


def _reach(left: Array, trial: NDArray[np.str_], alpha: float) -> float:
    """Half an interval of the mean of which these are the residuals (n,), infinite below six windows.

    Student's t with one degree of freedom less than there are windows, the variance widened by ``(1 + r) /
    (1 - r)`` where neighbouring windows of a trial resemble one another with a correlation r > 0.
    """
    from scipy.stats import t

    n = len(left)
    if n < PAIR_SETTINGS.fewest_windows:
        return math.inf
    memory = lag_one_correlation(left, most=PAIR_SETTINGS.most_alike, together=trial[1:] == trial[:-1])
    variance = float(left @ left) / (n * (n - 1)) * variance_inflation(memory)
    return float(t.ppf(1.0 - 0.5 * alpha, n - 1)) * math.sqrt(variance)
