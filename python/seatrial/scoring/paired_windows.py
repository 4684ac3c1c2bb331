"""One channel of two scores on the same windows: the difference of R2 and the error ratio, with intervals.

Two measures, because they answer two questions.

*Difference of R2*, all samples alike: with the sums of one window over its samples, ``SSE_k`` of squared
errors and ``SST_k`` of the measured about the pooled mean, it is a ratio of sums,
``R2_B - R2_A = sum_k (SSE_A,k - SSE_B,k) / sum_k SST_k``, and the variance of such a
``D = sum y_k / sum x_k`` is that of its linear residuals ``e_k = y_k - D x_k`` (Cochran, *Sampling
Techniques*, 1977, section 6.4). A few bad windows decide it.

*Error ratio*, all windows alike: ``exp(mean_k ln(MAE_B,k / MAE_A,k))``, the factor between the mean absolute
errors in a typical window. A few bad windows do not decide it.

Either has the interval of Student's t with one degree of freedom less than there are windows, the variance
widened by ``(1 + r) / (1 - r)`` where neighbouring windows of a trial resemble one another with a correlation
r > 0.

Held by `test_intervals_of_differences_keep_their_promise` and
`test_neighbours_that_resemble_widen_the_interval`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.scoring.noise_limit import judging
from seatrial.scoring.score import Score
from seatrial.scoring.windows import channel_errors
from seatrial.statistics.blocks import lag_one_correlation, variance_inflation

Interval = tuple[float, float]


@dataclass(frozen=True)
class PairSettings:
    """When windows of two models give an interval."""

    fewest_windows: int = 6  #: Windows below which no interval is given.
    most_alike: float = 0.9  #: Autocorrelation of neighbouring windows that is believed at most.


PAIR_SETTINGS = PairSettings()


@dataclass(frozen=True, eq=False)
class PairedWindows:
    """One channel of two scores on the same windows.

    Attributes
    ----------
    a, b
        `window_sums` of either (n, 4), of the windows in which samples count.
    trial
        Name (n,) of the trial of each of these.
    logs
        `log_errors` (windows,) of all windows, not a number where no sample counts.
    trials
        Name (windows,) of the trial of each.
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
    """Factor between the errors in a typical window from its logarithms (n,); interval as for `ratio`."""
    value = float(logs.mean()) if len(logs) else math.nan
    reach = _reach(logs - value, trial, alpha)
    interval = (math.exp(value - reach), math.exp(value + reach)) if math.isfinite(reach) else None
    return math.exp(value), interval


def _reach(left: Array, trial: NDArray[np.str_], alpha: float) -> float:
    """Half an interval of the mean of which these are the residuals (n,), infinite below six windows."""
    from scipy.stats import t

    n = len(left)
    if n < PAIR_SETTINGS.fewest_windows:
        return math.inf
    memory = lag_one_correlation(left, most=PAIR_SETTINGS.most_alike, together=trial[1:] == trial[:-1])
    variance = float(left @ left) / (n * (n - 1)) * variance_inflation(memory)
    return float(t.ppf(1.0 - 0.5 * alpha, n - 1)) * math.sqrt(variance)
