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
from typing import TYPE_CHECKING, Literal

import numpy as np

from seatrial.base.errors import TrialError
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, words_about
from seatrial.scoring.baseline_fit import fit_baselines
from seatrial.scoring.noise_limit import limits_of
from seatrial.scoring.paired_windows import PairedWindows, ratio, typical
from seatrial.scoring.score import Score, score
from seatrial.scoring.windows import Predictions, Window
from seatrial.trial.trial import Input, Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle

Verdict = Literal["better", "worse", "mixed", "not told apart", "too few windows", "diverged"]


@dataclass(frozen=True)
class Difference:
    """How a vehicle differs from the reference in one channel.

    Attributes
    ----------
    vehicle, against, channel
        Names of the vehicle, of the reference and of the channel.
    r2, mae
        Scores of the reference and of the vehicle, in this order; mae in SI.
    r2_difference, r2_interval
        R2 of the vehicle minus that of the reference, and the interval that holds jointly at the comparison's
        level; None with too few windows or where a simulation diverged.
    error_ratio, error_interval
        Mean absolute error of the vehicle over that of the reference in a typical window, and its interval.
    windows
        Windows with samples that count.
    verdict
        "better" or "worse" where one of the intervals leaves "no difference" out, "mixed" where they
        contradict one another; "not told apart", "too few windows" or "diverged".
    """

    vehicle: str
    against: str
    channel: str
    r2: tuple[float, float]
    mae: tuple[float, float]
    r2_difference: float
    r2_interval: tuple[float, float] | None
    error_ratio: float
    error_interval: tuple[float, float] | None
    windows: int
    verdict: Verdict


@dataclass(frozen=True)
class Overall:
    """How a vehicle differs from the reference over all channels.

    Attributes
    ----------
    vehicle, against
        Names of the vehicle and of the reference.
    error_ratio, error_interval
        Mean absolute error of the vehicle over that of the reference, the channels' logarithms averaged in
        every window, in a typical window; its interval at the comparison's level.
    windows
        Windows that count.
    verdict
        "better", "worse", "not told apart", "too few windows" or "diverged".
    """

    vehicle: str
    against: str
    error_ratio: float
    error_interval: tuple[float, float] | None
    windows: int
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class Comparison(Reported, Plain, only="reference level vehicles=scores overall differences sentences"):
    """Scores of several vehicles on the same windows, side by side; printed, a table and sentences.

    Attributes
    ----------
    scores
        Score of every vehicle by name, the reference first.
    overall
        An `Overall` per further vehicle: which one is better.
    differences
        A `Difference` per further vehicle and channel: where.
    level
        Probability with which the intervals of the vehicles hold together, and those of all channels.
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
        return tuple(words_about(self, "comparison"))

    def __repr__(self) -> str:
        return f"Comparison({', '.join(self.scores)} on {', '.join(self.trials)})"


def compare(
    vehicles: Mapping[str, Vehicle | Predictions],
    trials: Trial | Sequence[Trial],
    *,
    ahead_s: float = 10.0,
    channels: Sequence[str] | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    free_run: bool = False,
    input: Input | None = None,
    free: str = "XYZKMN",
    measured: str = "",
    own_stamps: bool = False,
    training: Trial | Sequence[Trial] = (),
    level: float = 0.95,
) -> Comparison:
    """Comparison of vehicles on the same windows of the same trials; the first one is the reference.

    Parameters
    ----------
    vehicles
        Models, or predictions of others, by the names under which they are to be shown, at least two. All are
        judged on the windows and channels that every table of predictions covers.
    trials, ahead_s, channels, start_s, stop_s, free_run, input, free, measured, own_stamps, training
        As for `seatrial.score`.
    level
        Probability with which all intervals hold together.

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
        name: score(
            vehicle,
            trials,
            ahead_s=ahead_s,
            channels=channels,
            start_s=start_s,
            stop_s=stop_s,
            free_run=free_run,
            input=input,
            free=free,
            measured=measured,
            own_stamps=own_stamps,
            training=None,
            limits=limits,
        )
        for name, vehicle in vehicles.items()
    }
    scores = _shared(scores, {n: v for n, v in vehicles.items() if isinstance(v, Predictions)})
    first, *others = scores
    learnt = [training] if isinstance(training, Trial) else training
    baselines = fit_baselines(learnt, vehicle=model, input=input, free=free, measured=measured)
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


def _verdict(r2: tuple[float, float] | None, error: tuple[float, float] | None) -> Verdict:
    """What the intervals of both differences say together."""
    if r2 is None or error is None:
        return "too few windows"
    better = r2[0] > 0.0 or error[1] < 1.0
    worse = r2[1] < 0.0 or error[0] > 1.0
    if better and worse:
        return "mixed"
    return "better" if better else "worse" if worse else "not told apart"
