"""How well a vehicle predicts a trial: the record is simulated in windows restarted from the measured state.

Per channel ``R2 = 1 - SSE / SST``, both sums pooled over all windows and trials, SST about the mean of the
pooled measured samples. A window starts at the smoothed measured state; its first sample and masked ones do
not count. R2 is 1 for a perfect model, 0 for one no better than the mean, negative below. Angles are
compared along the shorter way round. The step is halved until the simulated velocities no longer change: a
score is the model's, not the step's.

Tests: ``tests/scoring/test_score.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from seatrial.base.arrays import Mask
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import TrialError, nearest
from seatrial.base.plain import Plain
from seatrial.base.report import Report, Reported, report_of
from seatrial.base.toml_file import loaded
from seatrial.scoring.baseline_fit import fit_baselines
from seatrial.scoring.baselines import Baselines
from seatrial.scoring.windows import (
    Band,
    ChannelScore,
    Predictions,
    Unpredictable,
    Window,
    axis_of,
    bands,
    ceiling,
    channel_errors,
    covered,
    judging,
    limits_of,
    predict,
    windows,
)
from seatrial.trial.trial import Input, Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True, eq=False)
class Score(
    Plain,
    Reported,
    Mapping[str, ChannelScore],
    only="trials ahead_s windows=windows.__len__ shifted skipped channels baselines ceiling bands blind",
):
    """Scores by channel, ``score["u"].r2``; printed, a table.

    `channels`: score of each channel. `trials`: names of the trials. `ahead_s`: length of a window in s;
    infinite for a free run. `shifted`, `skipped`: windows that started later than planned because the planned
    sample was masked, and those left out. `windows`: what was simulated, for figures. `baselines`: R2 on the
    same windows by baseline (`seatrial.scoring.baselines.BASELINES`) and velocity channel. `limits`: by trial
    what no model of the vehicle can predict (`seatrial.scoring.windows`).
    """

    channels: dict[str, ChannelScore]
    trials: tuple[str, ...]
    ahead_s: float
    shifted: int
    skipped: int
    windows: tuple[Window, ...]
    baselines: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    limits: Mapping[str, Unpredictable] = field(default_factory=dict)

    def __getitem__(self, channel: str) -> ChannelScore:
        return self.channels[channel]

    def __iter__(self) -> Iterator[str]:
        return iter(self.channels)

    def __len__(self) -> int:
        return len(self.channels)

    @property
    def r2(self) -> dict[str, float]:
        """R2 by channel."""
        return {name: channel.r2 for name, channel in self.channels.items()}

    @cached_property
    def ceiling(self) -> dict[str, float]:
        """R2 at most by velocity channel, as noise and waves of the recording let a perfect model reach.

        One that the model beats is disproved, and left out: what was taken for waves was motion. One that it
        beats by no more than chance is reached.
        """
        limits = ceiling(self.windows, self.evidence, self.limits)
        return {
            channel: max(limit, self.r2[channel])
            for channel, limit in limits.items()
            # What leaves less than 80 % of what a ceiling leaves unexplained disproves it.
            if not 1.0 - self.r2[channel] < 0.8 * (1.0 - limit)
        }

    @cached_property
    def bands(self) -> dict[str, Band]:
        """R2 by velocity channel below wave frequencies and from there on, of trials that have waves."""
        return bands(self.windows, self.evidence, self.limits)

    @property
    def evidence(self) -> dict[str, float]:
        """R2 by channel, without replayed and blind ones: those say nothing of the model."""
        return {
            n: channel.r2 for n, channel in self.channels.items() if not (channel.replayed or channel.blind)
        }

    @property
    def _told(self) -> dict[str, float]:
        """R2 by channel that has one and is not replayed."""
        return {
            n: channel.r2
            for n, channel in self.channels.items()
            if np.isfinite(channel.r2) and not channel.replayed
        }

    @property
    def unscored(self) -> str:
        """Why no channel could be scored; empty where one could."""
        if self._told:
            return ""
        if self.blind:
            return self.blind_words
        diverged = [name for name, channel in self.channels.items() if np.isposinf(channel.mae)]
        return f"the simulation diverges in {', '.join(diverged)}" if diverged else "no channel moves"

    @property
    def blind(self) -> dict[str, tuple[str, ...]]:
        """By channel: trials on which it is not judged, because commands of its axis answer waves."""
        hidden = {name: self.limits[name].blind for name in self.trials if name in self.limits}
        names = {c: tuple(n for n in hidden if axis_of(c) in hidden[n]) for c in self.channels}
        return {channel: own for channel, own in names.items() if own}

    @property
    def blind_words(self) -> str:
        """A sentence on the channels that are not judged; empty where all are."""
        by_trials: dict[tuple[str, ...], list[str]] = {}
        for channel, names in self.blind.items():
            by_trials.setdefault(names, []).append(channel)
        return "; ".join(
            f"{', '.join(channels)} {'is' if len(channels) == 1 else 'are'} not scored in {', '.join(names)}:"
            " commands react to waves there, and replaying them without the waves cannot test a model"
            for names, channels in by_trials.items()
        )

    @property
    def mae(self) -> dict[str, float]:
        """Mean absolute error in SI by channel."""
        return {name: channel.mae for name, channel in self.channels.items()}

    def only(self, kept: Mask, channels: Sequence[str], source: str) -> Score:
        """The score on the windows that are `kept`, shape (windows,), and on `channels`, those that it has.

        A `TrialError` that begins with `source` where none is left.
        """
        if not channels or not kept.any():
            spans = {w.trial.name: f"{w.trial.t[0]:g} to {w.trial.t[-1]:g} s" for w in self.windows}
            raise TrialError(
                f"{source}: expected predictions of whole windows of the trials"
                f" ({', '.join(f'{name} {span}' for name, span in spans.items())}) in their channels, found"
                " none; check its times and channels"
            )
        windows = tuple(window for window, keep in zip(self.windows, kept, strict=True) if keep)
        table = {
            name: replace(_channel_score(name, windows, self.limits), replayed=channel.replayed)
            for name, channel in self.channels.items()
            if name in channels
        }
        skipped = self.skipped + len(self.windows) - len(windows)
        return replace(self, channels=table, windows=windows, skipped=skipped, baselines={})

    def __repr__(self) -> str:
        return "Score(" + ", ".join(f"{name} {channel.r2:.3f}" for name, channel in self.items()) + ")"

    def report(self, vehicle: str = "") -> Report:
        """R2 of the best and the worst channel, the worst problem, what to do next; then all channels.

        `vehicle`: name of the vehicle, for the title.
        """
        return report_of(self, vehicle=vehicle)

    def __str__(self) -> str:
        return "\n".join(text for table in self.report().sections[0].tables if (text := table.text()))


class ScoreOptions(TypedDict, total=False):
    """Keywords of `score` that `seatrial.compare` takes as well."""

    ahead_s: float
    channels: Sequence[str] | None
    start_s: float | None
    stop_s: float | None
    free_run: bool
    input: Input | None
    free: str
    measured: str
    own_stamps: bool


def score(
    vehicle: Vehicle | Predictions | str | Path,
    trial: Trial | Sequence[Trial],
    *,
    ahead_s: float = 10.0,
    channels: Sequence[str] | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    free_run: bool = False,
    input: Input | None = None,
    free: str = "XYZKMN",
    measured: str = "",
    nuisances: Mapping[str, Mapping[str, float]] | None = None,
    own_stamps: bool = False,
    training: Baselines | Trial | Sequence[Trial] | None = (),
    limits: Mapping[str, Unpredictable] | None = None,
) -> Score:
    """Score of a vehicle on one trial, or pooled over several, per channel.

    Parameters
    ----------
    vehicle
        The model, a name or a path of one, or what another model predicts.
    trial
        A trial or several; their samples are pooled.
    ahead_s
        The simulation restarts from the measured state after this time, s.
    channels
        Those to score, of `seatrial.base.channels.CHANNELS`; all that the trials have when omitted.
    start_s, stop_s
        Part of the record to score, in the trial's own time, stop excluded; all of it when omitted.
    free_run
        One window over the whole part instead of restarts.
    input
        What drives the vehicle: "commands", "measured" or "tau"; the first that the trial has when omitted.
    free, measured
        Letters of the axes that are simulated and that are replayed from the trial.
    nuisances
        Per trial the nuisance parameters of its record by name, SI, as a joint estimate finds them: a lever
        arm, a tilt, a current. What is compared is then what the sensors show of the simulated motion.
    own_stamps
        Compare with each sensor's own samples at their own stamps instead of the trial's time base.
    training
        Trials that the vehicle was identified from: the baselines are fitted to them, and judged on the same
        windows as the vehicle. Without any, only "hold last" is judged; None judges no baseline
        and estimates no ceiling, and no axis is left out unless ``limits`` say so.
    limits
        What no model can predict, by name of the trial, where it is known already.

    Raises
    ------
    TrialError
        If a channel, an input or the supply voltage is missing, or no window can start.

    Examples
    --------
    >>> import numpy as np
    >>> import seatrial as st
    >>> vehicle, t = st.Vehicle.load("cwolf"), np.arange(0.0, 30.0, 0.1)
    >>> commands = {name: np.where(t < 2.0, 0.0, 800.0) for name in vehicle.actuators}
    >>> run = vehicle.simulate(t, commands)
    >>> trial = st.Trial.read(
    ...     {"t_s": t, "u_m_s": run.nu[:, 0]} | {f"cmd.{name}": signal for name, signal in commands.items()}
    ... )
    >>> st.score(vehicle, trial, free_run=True)["u"].r2 > 0.99
    True
    """
    if isinstance(vehicle, str | Path):
        from seatrial._core import Vehicle

        named: Vehicle = loaded(Vehicle, vehicle)
        vehicle = named
    trials = [trial] if isinstance(trial, Trial) else list(trial)
    if not trials or not all(isinstance(each, Trial) for each in trials):
        given = repr(trial) if trials else "an empty list"
        raise TrialError(f"score: expected a trial or a list of trials, found {given}; see st.Trial.read")
    if not ahead_s > 0.0:
        raise TrialError(f"score: ahead_s: expected a positive time in s, found {ahead_s!r}")
    ahead = np.inf if free_run else float(ahead_s)
    names = _scored(trials, channels)
    # The windows of all trials, simulated or read from a table.
    simulated: list[Window] = []
    shifted = skipped = 0
    for each in trials:
        spans, late, left_out = windows(each, ahead, start_s=start_s, stop_s=stop_s)
        shifted, skipped = shifted + late, skipped + left_out
        if isinstance(vehicle, Predictions):
            track = vehicle.on(each)
            simulated += [Window(each, start, stop, track[start:stop]) for start, stop in spans]
            continue
        own = (nuisances or {}).get(each.name)
        simulated += predict(vehicle, each, spans, input=input, free=free, measured=measured, nuisance=own)
    simulated = [replace(window, own_stamps=own_stamps) for window in simulated]
    model = None if isinstance(vehicle, Predictions) else vehicle
    if limits is None:
        limits = {} if training is None else limits_of(trials, model)
    judged = tuple(each.name for each in trials)
    table = _table(names, simulated, limits, measured)
    result = Score(table, judged, ahead, shifted, skipped, tuple(simulated), limits=limits)
    if isinstance(vehicle, Predictions):
        predicted = [name for name in names if name in vehicle.channels]
        result = result.only(covered(result.windows, predicted), predicted, vehicle.source)
    # What anybody could predict without a model, on the same windows.
    if training is None:
        return result
    if not isinstance(training, Baselines):
        learnt = [training] if isinstance(training, Trial) else training
        training = fit_baselines(learnt, vehicle=model, input=input, free=free, measured=measured)
    return replace(result, baselines=training.r2(result.windows, result.evidence, limits))


def pooled(
    scores: Sequence[Score],
    *,
    channels: Sequence[str],
    measured: str = "",
    training: Baselines | None = None,
    limits: Mapping[str, Unpredictable],
) -> Score:
    """Score of a vehicle over all windows of several scores of it, each on trials of its own, as far ahead.

    The other arguments are as of `score`.
    """
    simulated = tuple(window for part in scores for window in part.windows)
    trials = list({id(window.trial): window.trial for window in simulated}.values())
    result = Score(
        _table(_scored(trials, channels), simulated, limits, measured),
        tuple(name for part in scores for name in part.trials),
        scores[0].ahead_s,
        sum(part.shifted for part in scores),
        sum(part.skipped for part in scores),
        simulated,
        limits=limits,
    )
    if training is None:
        return result
    return replace(result, baselines=training.r2(result.windows, result.evidence, limits))


def _table(
    names: Sequence[str], simulated: Sequence[Window], limits: Mapping[str, Unpredictable], measured: str
) -> dict[str, ChannelScore]:
    """Score per channel."""
    return {
        name: replace(_channel_score(name, simulated, limits), replayed=axis_of(name) in measured)
        for name in names
    }


def _scored(trials: Sequence[Trial], channels: Sequence[str] | None) -> list[str]:
    recorded = [name for name in CHANNELS if any(name in trial.channels for trial in trials)]
    if not recorded:
        raise TrialError(
            f"score: {', '.join(trial.name for trial in trials)}: expected at least one of the channels"
            f" {', '.join(CHANNELS)}, found none; map columns to them"
        )
    for name in channels or ():
        if name not in recorded:
            raise TrialError(f'score: channel "{name}" is not in the trials{nearest(name, recorded)}')
    return [name for name in recorded if channels is None or name in channels]


def _channel_score(
    name: str, simulated: Sequence[Window], limits: Mapping[str, Unpredictable]
) -> ChannelScore:
    """Score over the samples that count, pooled over the windows of trials that can judge."""
    windows = judging(name, simulated, limits)
    if simulated and not windows:
        return ChannelScore(np.nan, np.nan, np.nan, 0, blind=True)
    error, deviation = (np.concatenate([np.zeros(0), *parts]) for parts in channel_errors(name, windows))
    n = len(error)
    if n == 0:
        return ChannelScore(np.nan, np.nan, np.nan, 0)
    if not np.isfinite(error).all():
        return ChannelScore(-np.inf, np.inf, np.inf, n)
    sse, sst = float(error @ error), float(deviation @ deviation)
    r2 = 1.0 - sse / sst if sst > 0.0 else np.nan
    return ChannelScore(r2, float(np.mean(np.abs(error))), float(np.sqrt(sse / n)), n)
