"""Windows: parts of a trial that a model is simulated in from the measured state, and its errors there.

What no model of the vehicle can predict of them is the noise of the sensors and the motion by waves
(`ceiling`, ``tests/scoring/test_noise_limit.py``).

A window starts at the smoothed measured state; its first sample and masked ones do not count. Angles are
compared along the shorter way round. The step is halved until the simulated velocities no longer change: an
error is the model's, not the step's. Held by ``tests/scoring/test_score.py``.

A model from elsewhere is a table of times and channels (`Predictions`), to be scored beside ours. The table
has stamps of its own. At the samples of a trial a channel is read off linearly, angles the shorter way
round, and only between stamps that are no gap apart. Units come from the header: canonical names
(``u_m_s``, ``yaw_deg``), or a channel's name with its unit (``u [knot]``, ``yaw [rad]``). A column
``trial`` tells the trials apart. Held by ``tests/scoring/test_predictions.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import nuisance_names
from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import ANGLES, CHANNELS, deviations, difference
from seatrial.base.errors import TrialError, nearest
from seatrial.logs.clock import usual_interval
from seatrial.scoring.record import Record, Replay, cut_spans, restarted
from seatrial.trial.columns import GROUPS, columns_of, parse
from seatrial.trial.recording import FORMATS, RawTable, read_table
from seatrial.trial.signals import RecordingReport, own_samples
from seatrial.trial.table import signals, time_base
from seatrial.trial.trial import Input, Trial

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial
from collections.abc import Iterable
from typing import TYPE_CHECKING

from seatrial.base.channels import AXES, VELOCITIES
from seatrial.inspect.feedback import LEAST_S, feedback
from seatrial.inspect.verdict import Verdict, blind, judge_trial
from seatrial.inspect.waves import commanded, waves

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial


REPLAYED = "replayed"
"""What a table shows in place of the R2 of a channel whose axis follows the recording."""

BLIND = "feedback"
"""What a table shows in place of the R2 of a channel on whose axis commands answer waves."""


@dataclass(frozen=True)
class WindowSettings:
    """How exactly windows are simulated, and where predictions have a gap."""

    converged: float = 5e-3  #: Change by halving the step, in standard deviations of the simulated velocity.
    most_substeps: int = 64  #: Per sample, within which the simulation must have converged.
    gap: float = 1.5  #: Times the usual interval between two predictions.


SETTINGS = WindowSettings()


@dataclass(frozen=True, eq=False)
class Window:
    """Samples `start` to `stop` (exclusive) of a trial and the channels simulated there (n, 12), SI.

    With ``own_stamps`` it is compared at the stamps of each sensor instead of the trial's time base.
    """

    trial: Trial
    start: int
    stop: int
    simulated: Array
    own_stamps: bool = False

    def compared(self, channel: str) -> tuple[Array, Array]:
        """Simulated and measured samples (m,) of a channel that count, SI: not the first, no masked one."""
        k = CHANNELS.index(channel)
        if self.own_stamps and channel in self.trial.samples:
            times = self.trial.t[self.start : self.stop]
            t, y = self.trial.samples[channel]
            inside = (t > times[0]) & (t <= times[-1])
            track = self.simulated[:, k]
            with np.errstate(invalid="ignore"):  # a simulation that diverged
                path = np.unwrap(track) if channel in ANGLES else track
            return np.interp(t[inside], times, path), y[inside]
        samples = slice(self.start + 1, self.stop)
        counted = self.trial.valid[samples, k]
        return self.simulated[1:, k][counted], self.trial.observed[samples, k][counted]


@dataclass(frozen=True)
class ChannelScore:
    """Score of one channel: R2, mean absolute and root mean square error in SI, number of samples.

    Of a ``replayed`` channel they say nothing of the vehicle: its axis follows the recording. A ``blind``
    channel has none (NaN, no samples): in all of the trials the commands of its axis answer waves.
    """

    r2: float
    mae: float
    rmse: float
    n: int
    replayed: bool = False
    blind: bool = False

    @property
    def text(self) -> str:
        """R2 in three decimals, or why there is none."""
        return BLIND if self.blind else REPLAYED if self.replayed else score_text(self.r2)


def windows(
    trial: Trial, ahead_s: float, *, start_s: float | None = None, stop_s: float | None = None
) -> tuple[list[tuple[int, int]], int, int]:
    """Windows (start, stop) in samples, one following the other, and how many start late or are left out.

    A window starts at a sample where it may (`Trial.startable`), the next one where the last one ended.
    """
    if start_s is not None and stop_s is not None and not start_s < stop_s:
        raise TrialError(
            f"{trial.name}: start_s, stop_s: expected a start before the stop, found {start_s:g} s and"
            f" {stop_s:g} s; exchange them"
        )
    first = 0 if start_s is None else int(np.searchsorted(trial.t, start_s - 1e-9))
    last = len(trial) if stop_s is None else int(np.searchsorted(trial.t, stop_s - 1e-9))
    length = last if np.isinf(ahead_s) else max(1, round(ahead_s / trial.dt))
    spans = cut_spans(trial, first, last, length + 1)
    planned = [first, *(stop - 1 for _, stop in spans)]
    late = sum(start > plan for (start, _), plan in zip(spans, planned, strict=False))
    starts = [*(start for start, _ in spans), last - 1]
    left_out = sum((start - plan) // length for start, plan in zip(starts, planned, strict=True))
    if not spans:
        raise TrialError(
            f"{trial.name}: no window can start from {trial.t[0] if start_s is None else start_s:g} s "
            f"to {trial.t[-1] if stop_s is None else stop_s:g} s: every sample there is masked or outside "
            f"the record; see the trial's report{''.join(f': {error}' for error in trial.report.errors[:1])}"
        )
    return spans, late, left_out


def default_input(vehicle: Vehicle, trial: Trial) -> Input:
    """What drives the vehicle in a trial: its commands, else measured signals, else the recorded wrench."""
    for name, recorded in (("commands", trial.commands), ("measured", trial.measured)):
        if vehicle.actuators and all(actuator in recorded for actuator in vehicle.actuators):
            return "commands" if name == "commands" else "measured"
    if trial.tau is not None:
        return "tau"
    missing = [actuator for actuator in vehicle.actuators if actuator not in trial.commands]
    raise TrialError(
        f"{trial.name}: nothing drives the vehicle {vehicle.name}: expected commands of all its "
        f"actuators, their measured signals or a wrench; no column cmd.{', cmd.'.join(missing)}"
    )


def predict(
    vehicle: Vehicle,
    trial: Trial,
    spans: Sequence[tuple[int, int]],
    *,
    input: Input | None = None,
    free: str = "XYZKMN",
    measured: str = "",
    nuisance: Mapping[str, float] | None = None,
) -> list[Window]:
    """Windows of a trial simulated from the smoothed state at their start, channels in SI.

    The step of the record is halved until no velocity changes by more than 0.5 % of its standard deviation.
    Nuisance parameters by name say what the record's sensors and the water add to the motion.
    """
    chosen = input or default_input(vehicle, trial)
    _check_inputs(vehicle, trial, chosen)
    record = Record(trial, chosen, trial.valid)
    replay = Replay(vehicle, (record,), tuple(restarted(trial, spans)), free=free, measured=measured)
    row = np.array([[(nuisance or {}).get(name, 0.0) for name in nuisance_names()]])
    result: list[Window] = []
    substeps = 1
    while substeps <= SETTINGS.most_substeps:
        tracks = replace(replay, substeps=substeps).simulated(nuisance=row)
        coarser = result
        result = [
            Window(trial, start, stop, track) for (start, stop), track in zip(spans, tracks, strict=True)
        ]
        if coarser and _converged(coarser, result):
            break
        substeps *= 2
    return result


def _check_inputs(vehicle: Vehicle, trial: Trial, chosen: Input) -> None:
    if chosen == "tau":
        return
    recorded = trial.commands if chosen == "commands" else trial.measured
    column = "cmd" if chosen == "commands" else "meas"
    missing = [actuator for actuator in vehicle.actuators if actuator not in recorded]
    if missing:
        raise TrialError(
            f"{trial.name}: the vehicle {vehicle.name} has actuators without a recorded signal: "
            f"{', '.join(missing)}; map the columns {column}.{missing[0]} ..."
        )
    tables = any(facts["needs_voltage"] for facts in vehicle.actuator_info().values())
    if trial.voltage_v is None and tables:
        raise TrialError(
            f"{trial.name}: the thrust tables of the vehicle {vehicle.name} depend on the supply voltage, "
            'which is not recorded; map the column voltage_v, or use input="tau"'
        )


def _converged(coarser: Sequence[Window], finer: Sequence[Window]) -> bool:
    """Whether no simulated velocity changed noticeably; what diverges with every step counts as converged."""
    a = np.concatenate([window.simulated[:, :6] for window in coarser])
    b = np.concatenate([window.simulated[:, :6] for window in finer])
    known = np.isfinite(a) & np.isfinite(b)
    if not np.array_equal(np.isfinite(a), np.isfinite(b)):
        return False
    with np.errstate(over="ignore", invalid="ignore"):  # a simulation that is about to diverge
        change = np.where(known, a - b, 0.0).std(axis=0)
        return bool(np.all(change <= SETTINGS.converged * np.where(known, b, 0.0).std(axis=0) + 1e-12))


def channel_errors(name: str, simulated: Sequence[Window]) -> tuple[list[Array], list[Array]]:
    """Simulated minus measured, and measured minus the mean of all, (n,) per window and both in SI.

    Only samples that count are among them: not the first one of a window, no masked one.
    """
    errors, measured = [], []
    for window in simulated:
        predicted, seen = window.compared(name)
        measured.append(seen)
        with np.errstate(invalid="ignore"):  # a simulation that diverged
            errors.append(difference(predicted, seen, name))
    if not any(len(part) for part in measured):
        return errors, measured
    ends = np.cumsum([len(part) for part in measured])
    return errors, np.split(deviations(np.concatenate(measured), name), ends[:-1])


def covered(simulated: Sequence[Window], channels: Sequence[str]) -> Mask:
    """Windows (windows,) in which every sample that counts is predicted, in all of the channels."""
    return np.array([
        all(np.isfinite(window.compared(name)[0]).all() for name in channels) for window in simulated
    ])


def score_text(value: float) -> str:
    """An R2 in three decimals, in short where it is far below zero, in words where there is none."""
    if not math.isfinite(value):
        return "none" if math.isnan(value) else "diverged"
    return f"{value:.3f}" if value > -10.0 else f"{value:.0f}" if value > -1e5 else "diverged"


_TIMES = ("t", "time", "timestamp")
_TRIAL = "trial"
_BRACKETS = re.compile(r"\s*(.*?)\s*[\[(]([^\])]*)[\])]\s*$")
Samples = Mapping[str, tuple[Array, Array]]
"""Stamps in s (m,) and values in SI (m,) by channel."""


@dataclass(frozen=True, eq=False)
class Predictions:
    """What another model predicts, made by `read`.

    `name`, `source`: what to call it, and the file. `samples`: by trial, "" for any, what is predicted:
    stamps in s and values in SI by channel.
    """

    name: str
    source: str
    samples: Mapping[str, Samples]

    @classmethod
    def read(
        cls, source: Any, *, columns: Mapping[str, Any] | None = None, name: str | None = None
    ) -> Predictions:
        """Predictions from a table of text, a Parquet file or a frame.

        Parameters
        ----------
        source
            Path or frame. Time in s from the same start as the trial's, a column per channel.
        columns
            As for `Trial.read`, where the header does not say it.
        name
            What to call it; the file's stem when omitted.

        Raises
        ------
        TrialError
            The table cannot be read, a channel has no unit, or none is there.

        Examples
        --------
        >>> t = np.arange(0.0, 2.0, 0.1)
        >>> found = Predictions.read({"time": t, "u_m_s": t, "yaw_deg": 10.0 * t})
        >>> list(found.samples[""])
        ['u', 'yaw']
        """
        recording = read_table(source, columns=columns_of(columns))
        table, file = recording.table, recording.file
        parts: dict[str, pl.DataFrame] = {"": table}
        if _TRIAL in table.columns:
            parts = {
                str(key[0]): part.drop(_TRIAL)
                for key, part in table.partition_by(_TRIAL, as_dict=True, maintain_order=True).items()
            }
        read = {trial: _samples(recording._replace(table=part), columns) for trial, part in parts.items()}
        return cls(name or Path(file).stem, file, read)

    @property
    def channels(self) -> list[str]:
        """Channels that are predicted, in the order of `CHANNELS`."""
        return [name for name in CHANNELS if any(name in samples for samples in self.samples.values())]

    def on(self, trial: Trial) -> Array:
        """Predictions at the samples of a trial, (n, 12) in SI; NaN where nothing is predicted."""
        own = self.samples.get(trial.name, self.samples.get(""))
        if own is None:
            raise TrialError(
                f'{self.source}: column {_TRIAL}: expected rows of the trial "{trial.name}", found those of'
                f" {', '.join(self.samples)}{nearest(trial.name, self.samples)}"
            )
        track = np.full((len(trial), len(CHANNELS)), np.nan)
        for channel, (t, y) in own.items():
            track[:, CHANNELS.index(channel)] = _between(trial.t, t, y, channel)
        return track


def is_table(path: str) -> bool:
    """Whether a name is that of a table of predictions, and not of a vehicle."""
    return path.lower().endswith((*FORMATS["csv"], *FORMATS["parquet"]))


def _samples(recording: RawTable, columns: Mapping[str, Any] | None) -> Samples:
    table, file, units, _ = recording
    entries = _short_names(table.columns, units, file) | dict(columns or {})
    sources = parse(entries, table.columns, file, units)
    recording.refuse_twice(source.column for source in sources.values())
    kept = {name: source for name, source in sources.items() if not name.startswith(("cmd.", "meas."))}
    t = time_base(table, kept["t_s"], file)
    known = signals(table, t, kept, file, RecordingReport(file)) if len(kept) > 1 else {}
    samples = own_samples(known)
    if not samples:
        raise TrialError(
            f"{file}: no channel is predicted; expected a column such as u_m_s, yaw_deg or u [m/s]"
        )
    return samples


def _short_names(present: list[str], units: Mapping[str, str], file: str) -> dict[str, Any]:
    """Column map of a header with plain names: a time, and channels with their units."""
    canonical = {
        channel: column
        for group in GROUPS
        for column, channel in zip(group.columns, group.channels, strict=True)
        if channel in CHANNELS
    }
    entries: dict[str, Any] = {}
    for column in present:
        brackets = _BRACKETS.match(column)
        name, unit = brackets.groups() if brackets else (column, units.get(column, ""))
        if name.lower() in _TIMES and "t_s" not in present:
            entries["t_s"] = {"from": column} | ({"unit": unit} if unit else {})
        elif name in canonical and canonical[name] not in present:
            if not unit:
                raise TrialError(
                    f'{file}: column "{column}": expected its unit in the header, "{name} [...]", or the'
                    f" name {canonical[name]}"
                )
            entries[canonical[name]] = {"from": column, "unit": unit}
    return entries


def _between(at: Array, t: Array, y: Array, channel: str) -> Array:
    """Values between stamps (m,) at other times (n,); NaN outside and in gaps."""
    if len(t) < 2:
        return np.full(len(at), np.nan)
    rounding = 1e-6 * max(1.0, abs(float(t[-1])) * 1e-3)
    path = np.unwrap(y) if channel in ANGLES else y
    values = np.interp(at, t, path)
    after = np.clip(np.searchsorted(t, at - rounding), 0, len(t) - 1)
    before = np.clip(np.searchsorted(t, at + rounding, side="right") - 1, 0, len(t) - 1)
    gap = t[after] - t[before] > SETTINGS.gap * usual_interval(t)
    outside = (at < t[0] - rounding) | (at > t[-1] + rounding)
    return np.where(gap | outside, np.nan, values)


_NORMAL = 1.4826  # deviation of a normal distribution over its median absolute value


@dataclass(frozen=True)
class NoiseLimitSettings:
    """How noise and waves are told apart from motion."""

    orders: tuple[int, ...] = (2, 3, 4, 5)  #: Of the differences that leave the noise.
    fewest_samples: int = 10  #: Samples that tell a noise.
    #: A wave peak begins at its frequency divided by this, as in `seatrial.inspect.waves`.
    below_peak: float = 1.35


NOISE_SETTINGS = NoiseLimitSettings()


@dataclass(frozen=True)
class Unpredictable:
    """Variances by velocity channel, SI: of sensor noise and of motion by waves; period of these, s.

    ``period_s`` is None where no waves are seen. ``blind`` has the letters of the axes whose commands
    answer waves: a replay of them without the waves judges no model (`seatrial.inspect.verdict.blind`).
    """

    noise: Mapping[str, float]
    wave: Mapping[str, float]
    period_s: float | None
    blind: str = ""


@dataclass(frozen=True)
class Band:
    """R2 of one channel below wave frequencies and from there on; NaN where nothing moves."""

    below: float
    at: float


_CALM = Unpredictable({}, {}, None)


def unpredictable(trial: Trial, verdicts: Mapping[str, Verdict]) -> Unpredictable:
    """What no model of the vehicle can predict of a whole trial: a part of it may be too short to see waves.

    `verdicts` are of `seatrial.inspect.verdict.judge_trial` on it; empty without a vehicle.
    """
    noise = {c: _noise(trial, c) for c in trial.channels if c in VELOCITIES}
    swell = waves(trial)
    if swell is not None and commanded(trial, swell) and not any(loop.closed for loop in feedback(trial)):
        swell = None
    if swell is None:
        return Unpredictable(noise, {}, None, blind(verdicts))
    wave = {c: 0.5 * a**2 for c, a in swell.amplitude.items() if c in VELOCITIES}
    return Unpredictable(noise, wave, swell.period_s, blind(verdicts))


def limits_of(trials: Sequence[Trial], vehicle: Vehicle | None) -> dict[str, Unpredictable]:
    """By trial what no model can predict; without a vehicle no axis is left out."""
    limits = {}
    for trial in trials:
        long = (bool(trial.commands) or trial.tau is not None) and len(trial) * trial.dt >= LEAST_S
        limits[trial.name] = unpredictable(
            trial, judge_trial(trial, vehicle) if vehicle is not None and long else {}
        )
    return limits


def axis_of(channel: str) -> str:
    """Letter of the axis that a channel belongs to: an angle to that of its rate."""
    return AXES[CHANNELS.index(channel) % 6]


def judging(channel: str, judged: Sequence[Window], limits: Mapping[str, Unpredictable]) -> list[Window]:
    """Windows of those trials on which a replay can judge a model in this channel."""
    axis = axis_of(channel)
    return [w for w in judged if (own := limits.get(w.trial.name)) is None or axis not in own.blind]


def ceiling(
    judged: Sequence[Window], channels: Iterable[str], limits: Mapping[str, Unpredictable]
) -> dict[str, float]:
    """R2 that a perfect model of the vehicle, which knows no waves, could reach at most, at least zero.

    ``1 - sum (sigma_noise^2 + sigma_wave^2) / SST`` by velocity channel, summed over the samples that count,
    each with the variances of its trial. Coloured noise, and that of a rate that was differentiated from
    angles, are underestimated: the figure is an upper limit.

    `limits` go by the name of the trial; a channel is left out where a trial has none.
    """
    reachable = {}
    for channel in channels:
        windows = judging(channel, judged, limits)
        away = channel_errors(channel, windows)[1] if channel in VELOCITIES else []
        sst = sum(float(deviation @ deviation) for deviation in away)
        known = [limits.get(window.trial.name, _CALM) for window in windows]
        if sst > 0.0 and all(channel in limit.noise for limit in known):
            lost = sum(
                len(y) * (limit.noise[channel] + limit.wave.get(channel, 0.0))
                for y, limit in zip(away, known, strict=True)
            )
            reachable[channel] = max(1.0 - lost / sst, 0.0)
    return reachable


def bands(
    judged: Sequence[Window], channels: Iterable[str], limits: Mapping[str, Unpredictable]
) -> dict[str, Band]:
    """R2 by velocity channel below wave frequencies and from there on, where the channel shows the waves.

    The cosine transform (DCT-II, orthonormal) of a window's errors and of its measured deviations parts both
    sums of squares exactly.
    """
    from scipy.fft import dct

    wavy = {name: limit for name, limit in limits.items() if limit.period_s is not None}
    by_channel = {}
    for channel in channels:
        windows = [
            w for w in judging(channel, judged, limits) if channel in wavy.get(w.trial.name, _CALM).wave
        ]
        if channel not in VELOCITIES or not windows:
            continue
        sums = np.zeros((2, 2))  # errors and deviations, below and from the waves on
        for window, error, away in zip(windows, *channel_errors(channel, windows), strict=True):
            if not len(error):
                continue
            period_s = wavy[window.trial.name].period_s
            assert period_s is not None
            edge = 1.0 / (NOISE_SETTINGS.below_peak * period_s)
            low = np.arange(len(error)) < 2.0 * edge * len(error) * window.trial.dt
            for row, values in enumerate((error, away)):
                with np.errstate(invalid="ignore", over="ignore"):  # a simulation that diverged
                    power = dct(values, norm="ortho") ** 2
                sums[row] += power[low].sum(), power[~low].sum()
        if sums[1].any():
            with np.errstate(divide="ignore", invalid="ignore"):
                by_channel[channel] = Band(*(1.0 - sums[0] / sums[1]).tolist())
    return by_channel


def _noise(trial: Trial, channel: str) -> float:
    """Variance of the white noise in the samples of a velocity on the time base, SI.

    It is looked for in the samples of the sensor itself; the straight line between two of them has less.
    """
    good = trial.valid[:, CHANNELS.index(channel)]
    # Where a sensor's own samples are not known the time base is taken for its stamps.
    stamps, own = trial.samples.get(channel, (trial.t[good], trial.channel(channel)[good]))
    if len(own) < NOISE_SETTINGS.fewest_samples or not good.any():
        return 0.0
    at = trial.t[good]
    after = np.clip(np.searchsorted(stamps, at - 1e-9), 1, len(stamps) - 1)
    f = np.clip((at - stamps[after - 1]) / np.maximum(np.diff(stamps)[after - 1], 1e-9), 0.0, 1.0)
    return _white(own) * float(np.mean((1.0 - f) ** 2 + f**2))


def _white(y: Array) -> float:
    """Variance of white noise in samples (n,) of a smooth motion.

    Differences of order k have ``binomial(2 k, k)`` times the variance of white noise, and next to nothing of
    the motion (von Neumann et al., *Ann. Math. Stat.* 12 (1941) 153, for the first difference). Steps of the
    motion do not move the median; the order that gives least is taken.
    """
    # Neighbours over a gap are no neighbours, but few beside the others: the median does not see them.
    variances = [
        float(np.median(np.abs(np.diff(y, order)))) ** 2 / math.comb(2 * order, order)
        for order in NOISE_SETTINGS.orders
    ]
    return _NORMAL**2 * min(variances)
