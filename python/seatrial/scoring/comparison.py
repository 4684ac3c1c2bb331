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

from seatrial.base.channels import readable
from seatrial.base.errors import TrialError
from seatrial.base.plain import Plain
from seatrial.base.report import Report, Reported, Section, Table
from seatrial.scoring.baseline_fit import fit_baselines
from seatrial.scoring.baselines import not_beaten
from seatrial.scoring.noise_limit import limits_of
from seatrial.scoring.paired_windows import PAIR_SETTINGS, PairedWindows, ratio, typical
from seatrial.scoring.score import Score, kind, score
from seatrial.scoring.windows import Predictions, Window, score_text
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
        simpler = [
            f"{name} does not beat a baseline in {where}."
            for name, scored in self.scores.items()
            if (where := not_beaten(scored.evidence, scored.baselines))
        ]
        return (*(sentence(self, name) for name in self.scores if name != self.reference), *simpler)

    def __repr__(self) -> str:
        return f"Comparison({', '.join(self.scores)} on {', '.join(self.trials)})"

    def report(self) -> Report:
        """Which vehicle predicts best, by how much, what to do next; then all channels."""
        return _report(self)


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


SMALL = 0.02
"""A difference of R2 below this is small, even where it is told."""


def _report(comparison: Comparison) -> Report:
    """Three lines, a sentence per further vehicle, a row per channel and vehicle."""
    reference, overall = comparison.reference, comparison.overall
    better = [other for other in overall if other.verdict == "better"]
    told = [other for other in overall if other.verdict in ("better", "worse")]
    first = min(
        told or overall, key=lambda other: other.error_ratio if np.isfinite(other.error_ratio) else np.inf
    )
    size = f"{first.error_ratio:.2f} times" if np.isfinite(first.error_ratio) else "not comparable with"
    good = (
        f"the error of {first.vehicle} in a typical window is {size} that of {reference} ({first.windows}"
        f" windows on {', '.join(comparison.trials)})"
    )
    worst = next_step = ""
    if better:
        worse = [d for d in comparison.of(first.vehicle).values() if d.verdict == "worse"]
        worst = (
            f"{first.vehicle} is worse in {_listed(worse)}"
            if worse
            else "no channel of the better one is worse"
        )
        next_step = f"use {first.vehicle}"
    elif all(other.verdict == "worse" for other in overall):
        worst, next_step = _weakness(comparison), f"keep {reference}"
    else:
        why = "" if first.verdict == "not told apart" else f" ({first.verdict})"
        worst = f"these windows do not tell {reference} and {first.vehicle} apart{why}"
        next_step = "add trials or restart more often (--ahead); until then either will do"
    return Report(
        title=f"{reference} against {', '.join(other.vehicle for other in overall)}",
        outcome=_outcome(comparison),
        good=good,
        worst=worst,
        next_step=next_step,
        sections=(
            Section(
                sentences=comparison.sentences(), tables=(_table(comparison), _beside_baselines(comparison))
            ),
        ),
    )


def _outcome(comparison: Comparison) -> str:
    """Which vehicle predicts better, in a few words."""
    overall, reference = comparison.overall, comparison.reference
    if len(overall) == 1:
        names = {"better": overall[0].vehicle, "worse": reference}
        verdict = overall[0].verdict
        return f"{names[verdict]} predicts better" if verdict in names else verdict
    better, worse = (sum(other.verdict == word for other in overall) for word in ("better", "worse"))
    return f"of {len(overall)} others {better} predict better than {reference}, {worse} worse"


def _weakness(comparison: Comparison) -> str:
    """Where the best vehicle, the reference, is beaten all the same: by another one, or by a baseline."""
    for name in comparison.scores:
        if beaten := [channel for channel in comparison.of(name).values() if channel.verdict == "better"]:
            return f"{name} is better in {_listed(beaten)}"
    own = comparison.scores[comparison.reference]
    if simpler := not_beaten(own.evidence, own.baselines):
        return f"{comparison.reference} does not beat a baseline in {simpler}"
    return f"nothing stands out: no other vehicle is better than {comparison.reference} in any channel"


def _table(comparison: Comparison) -> Table:
    """Per channel a row per vehicle, with its difference from the reference."""
    scores, reference = comparison.scores, comparison.reference
    differences = {name: comparison.of(name) for name in scores}
    rows = []
    for channel in scores[reference]:
        scale, unit = readable(channel)
        for name, by_channel in scores.items():
            own_score = by_channel[channel]
            cells = [
                channel if name == reference else "",
                name,
                own_score.text,
                "" if own_score.blind else f"{own_score.mae * scale:.4g}",
                unit,
            ]
            if (own := differences[name].get(channel)) is not None:
                cells += [
                    _span(own.r2_difference, own.r2_interval, "+"),
                    _span(own.error_ratio, own.error_interval, ""),
                    own.verdict,
                ]
            rows.append((*cells, *[""] * (8 - len(cells))))
    rows += [
        (
            "all",
            other.vehicle,
            "",
            "",
            "",
            "",
            _span(other.error_ratio, other.error_interval, ""),
            other.verdict,
        )
        for other in comparison.overall
    ]
    skipped = scores[reference].skipped
    title = (
        f"{', '.join(comparison.trials)}: {kind(scores[reference])}"
        f"{f' ({skipped} left out)' if skipped else ''}; intervals against {reference}, together"
        f" {100 * comparison.level:g} %"
    )
    head = ("channel", "vehicle", "R2", "MAE", "unit", "R2 difference", "error ratio", "verdict")
    return Table.of(title, head, rows, left=2)


def _beside_baselines(comparison: Comparison) -> Table:
    """R2 of every vehicle and of the baselines by velocity channel."""
    scores, simple = comparison.scores, comparison.scores[comparison.reference].baselines
    rows = [
        (
            channel,
            *(score_text(scored.r2[channel]) for scored in scores.values()),
            *(score_text(row[channel]) if channel in row else "" for row in simple.values()),
        )
        for channel in scores[comparison.reference].evidence
        if any(channel in row for row in simple.values())
    ]
    return Table.of("R2 beside baselines", ("channel", *scores, *simple), rows)


def sentence(comparison: Comparison, name: str) -> str:
    """What the windows tell of one vehicle against the reference, and what they do not."""
    own, reference = comparison.of(name), comparison.reference
    where = f"On {', '.join(comparison.trials)} ({kind(comparison.scores[reference])})"
    overall = next(other for other in comparison.overall if other.vehicle == name)
    if not own:
        return f"{where}, {name} and {reference} share no channel to be compared in."
    if overall.verdict == "too few windows":
        return (
            f"{where}, nothing can be said of {name} and {reference} beyond their scores: an interval takes"
            f" {PAIR_SETTINGS.fewest_windows} windows; restart the simulation more often or add trials."
        )
    if all(d.r2_difference == 0.0 and d.error_ratio == 1.0 for d in own.values()):
        return f"{where}, {name} and {reference} predict the same."
    diverged = [d.channel for d in own.values() if d.verdict == "diverged"]
    if diverged:
        text = f"{where}, one of {name} and {reference} diverges in {', '.join(diverged)}"
    else:
        interval = overall.error_interval or (np.nan, np.nan)
        text = (
            f"{where}, the error of {name} in a typical window is {overall.error_ratio:.2f} times"
            f" ({interval[0]:.2f} to {interval[1]:.2f}) that of {reference}: "
        ) + {"better": f"{name} predicts better", "worse": f"{reference} predicts better"}.get(
            overall.verdict, "these windows do not tell which one predicts better"
        )
    told = {word: [d for d in own.values() if d.verdict == word] for word in ("better", "worse", "mixed")}
    parts = [f"{name} is {word} in {_listed(channels)}" for word, channels in told.items() if channels]
    open_ = [c for c, d in own.items() if d.verdict == "not told apart"]
    if len(open_) == len(own):
        parts = ["no single channel is told apart"]
    elif open_:
        parts.append(f"{', '.join(open_)} {'is' if len(open_) == 1 else 'are'} not told apart")
    text = ". By channel: ".join([text, "; ".join(parts)]) + "."
    if not diverged and all(abs(d.r2_difference) < SMALL for d in own.values()):
        text += f" No R2 differs by {SMALL:g}: for most uses either will do."
    return text


def _listed(differences: Sequence[Difference]) -> str:
    """Channels with both scores and the error ratio."""
    return ", ".join(
        f"{d.channel} (R2 {d.r2[1]:.3f} against {d.r2[0]:.3f}, error {d.error_ratio:.2f} times)"
        for d in differences
    )


def _span(value: float, interval: tuple[float, float] | None, sign: str) -> str:
    """A value and its interval, in three decimals; in one where there are tens."""

    def decimals(number: float) -> str:
        return f"{number:{sign}.{3 if abs(number) < 9.9995 else 1}f}"

    if interval is None:
        return decimals(value)
    return f"{decimals(value)} ({decimals(interval[0])} to {decimals(interval[1])})"
