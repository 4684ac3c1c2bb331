"""Signals, one sensor's samples on its own time base, and how they come to one uniform base.

A point of the base is valid where both neighbouring samples are good and no further apart than
`gap_intervals` times the sensor's own usual interval; elsewhere the value is a fill that no criterion may
use. A command is held until the next one, unless a stream of a fixed rate falls silent: then it is unknown
(`silences`). Stamps that came in bursts are spread first, and irregular ones get a base that is fine enough
for all of them (`seatrial.logs.clock`).

In a log of several rates a row has cells of the sensors that sampled then and empty cells elsewhere. A depth
that comes at other times than north and east is another sensor's: a signal of its own. Other components that
come apart (a compass beside roll and pitch) are brought to the stamps of the one with the most samples,
linearly between their own neighbours and nowhere else. Held by ``tests/trial/test_several_rates.py`` and
``test_time_base.py``.

Between the samples of a slow sensor the time base holds straight lines, which no vehicle follows. What is to
be judged on samples alone takes them at the stamps of their own sensors (`own_samples`; held by
``tests/scoring/test_predictions.py``). `RecordingReport` says what was done to a recording.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.channels import ANGLES, CHANNELS
from seatrial.base.errors import TrialError, nearest
from seatrial.base.finding import Finding, Severity, by_severity
from seatrial.base.frames import continuous, to_euler
from seatrial.base.plain import Plain
from seatrial.logs.clock import Spread, base_step, spread_bursts, usual_interval


@dataclass(frozen=True)
class Signal:
    """Samples `y` (m, k) at times `t` (m,) of the `channels` (k names); `bad` (m, k) marks those of no use.

    The attitude is a unit quaternion: four columns q_w q_x q_y q_z that are good or bad together. Where it
    was recorded as angles, ``unknown`` (m, 3) marks those of roll, pitch and yaw that were not measured;
    their place is bridged, and the attitude as a whole is bad there though the other angles are known.
    """

    name: str
    channels: tuple[str, ...]
    t: Array
    y: Array
    bad: Mask
    unknown: Mask | None = None

    @property
    def label(self) -> str:
        """What to call it in a report: a position of the depth alone is the depth."""
        return "depth" if self.name == "position" and self.channels == ("z",) else self.name

    @property
    def good(self) -> Mask:
        """Rows (m,) of which every channel is good."""
        return np.asarray(np.logical_and.reduce(~self.bad, axis=1))

    @property
    def step(self) -> float:
        """Median sampling interval, s."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    @property
    def interval(self) -> float:
        """Longest usual sampling interval, s: what is much longer is a gap."""
        return usual_interval(self.t)

    def masked(self, bad: Mask) -> Signal:
        """The same samples with more of them marked bad; `bad` is (m,) for all channels or (m, k)."""
        more = bad[:, None] if bad.ndim == 1 else bad
        unknown = None if self.unknown is None else self.unknown | np.logical_or.reduce(more, axis=1)[:, None]
        return replace(self, bad=self.bad | more, unknown=unknown)

    def earlier(self, latency: float) -> Signal:
        """The same samples stamped `latency` seconds earlier."""
        return replace(self, t=self.t - latency)


LEVELS = {Severity.NOTE: "info", Severity.WEAKNESS: "warning", Severity.PROBLEM: "error"}
"""Names of the severities in the report of a recording; an error forbids its use as it is."""


@dataclass(frozen=True)
class RecordingFinding(Plain, Finding, only="severity=level channel=subject message count kind"):
    """One fact about a channel of a recording, its `subject`; `count` samples or events show it.

    Its words are those of `seatrial.report.results.trial_findings`.
    """

    count: int | None = None

    @property
    def level(self) -> str:
        """Severity as "info", "warning" or "error"."""
        return LEVELS[self.severity]

    @property
    def message(self) -> str:
        """What was found, to follow channel and count."""
        words = importlib.import_module("seatrial.report.results.trial_findings")
        return str(words.message(self))

    @property
    def line(self) -> str:
        """Channel, count and message."""
        number = "" if self.count is None else f"{self.count} "
        return f"{self.subject}: {number}{self.message}"

    def __str__(self) -> str:
        return f"{self.level:<8} {self.line}"


@dataclass
class RecordingReport(Plain):
    """What is known about a recording: findings, latencies removed and samples masked."""

    source: str  #: File or frame that was read.
    #: Common time base.
    samples: int = 0
    rate_hz: float = 0.0
    duration_s: float = 0.0
    #: Facts in the order in which they were found.
    findings: list[RecordingFinding] = field(default_factory=list)
    #: Delay in s of a sensor against the pose, removed, by sensor ("velocity", "rates").
    latencies: dict[str, float] = field(default_factory=dict)
    #: Direction of gravity in the pose's frame as recorded, north and east of its z in rad, where the pose
    #: was turned upright.
    tilt: tuple[float, float] | None = None
    #: Number of samples kept out of every criterion, by channel.
    masked: dict[str, int] = field(default_factory=dict)
    #: Key and value of the corrections that were given and applied.
    corrections: dict[str, Any] = field(default_factory=dict)

    def info(self, kind: str, channel: str, *, count: int | None = None, **values: Any) -> None:
        """Note a fact about a channel; a count of zero is none, here and below."""
        self._add(Severity.NOTE, kind, channel, count, values)

    def warning(
        self,
        kind: str,
        channel: str,
        *,
        count: int | None = None,
        cause: Finding | None = None,
        **values: Any,
    ) -> None:
        """Note what the user should look at."""
        self._add(Severity.WEAKNESS, kind, channel, count, values, cause)

    def error(self, kind: str, channel: str, *, count: int | None = None, **values: Any) -> None:
        """Note what forbids the use of the recording as it is."""
        self._add(Severity.PROBLEM, kind, channel, count, values)

    def _add(
        self,
        severity: Severity,
        kind: str,
        channel: str,
        count: int | None,
        values: Mapping[str, Any],
        cause: Finding | None = None,
    ) -> None:
        if count != 0:
            finding = RecordingFinding(kind, severity, channel, values, cause, count=count)
            self.findings.append(finding)

    @property
    def errors(self) -> list[str]:
        """Findings with which the recording should not be used as it is, a clause each."""
        return [finding.line for finding in self.findings if finding.severity == Severity.PROBLEM]

    def __str__(self) -> str:
        lines = [f"{self.source}: {self.samples} samples, {self.duration_s:.1f} s at {self.rate_hz:.4g} Hz"]
        if self.masked:
            by_count: dict[int, list[str]] = {}
            for channel, count in self.masked.items():
                by_count.setdefault(count, []).append(channel)
            shares = [
                f"{' '.join(channels)} {count} ({100.0 * count / self.samples:.1f} %)"
                for count, channels in by_count.items()
                if count
            ]
            lines.append(f"{'masked':<8} {', '.join(shares) or 'no sample'}")
        lines += map(str, by_severity(self.findings))
        return "\n".join(lines)


CHANNEL_GROUPS = {
    "position": ("x", "y"),
    "depth": ("z",),
    "velocity": ("u", "v", "w"),
    "water velocity": ("u_water", "v_water", "w_water"),
    "rates": ("p", "q", "r"),
    "attitude": ("roll", "pitch", "yaw"),
    "specific force": ("ax", "ay", "az"),
}
"""Channels that one instrument gives, by its name: m, m/s, rad/s, rad, m/s^2; earth NED, body FRD."""

INPUTS = ("cmd.", "meas.", "tau.")
"""Begins of the names of what drives the vehicle: commands, measured actuators, a wrench."""


@dataclass(frozen=True, eq=False)
class Series:
    """Samples of one channel at the stamps of its own sensor."""

    t: Array  #: Rising stamps in s, shape (n,), on the clock that stamped them.
    value: Array  #: Samples in SI, NED or forward-right-down, shape (n,); NaN where lost.
    clock: str = ""  #: Name of that clock, usually of the file; series of one name share it.


def checked(series: Mapping[str, Series]) -> dict[str, Series]:
    """The series without lost samples; inputs (`INPUTS`) keep their names."""
    known = [channel for channels in CHANNEL_GROUPS.values() for channel in channels]
    result = {}
    for name, samples in series.items():
        if name not in known and not name.startswith(INPUTS):
            raise TrialError(f'"{name}" is no channel{nearest(name, known)}')
        t, value = np.asarray(samples.t, float), np.asarray(samples.value, float)
        if t.ndim != 1 or t.shape != value.shape:
            raise TrialError(
                f"{name}: expected stamps and samples of one length, found shapes {t.shape} and {value.shape}"
            )
        good = np.isfinite(t) & np.isfinite(value)
        if np.any(np.diff(t[good]) <= 0.0):
            raise TrialError(
                f"{name}: expected rising stamps; sort the samples and leave out repeated stamps"
            )
        if good.any():
            result[name] = Series(t[good], value[good], samples.clock)
    return result


@dataclass(frozen=True)
class ResamplingSettings:
    """How the time base is chosen, what is a gap, and when a stream of commands is silent."""

    #: usual intervals between neighbours from which there is a gap: one lost sample is one
    gap_intervals: float = 1.9
    equal_share: float = 1e-6  #: of an interval: times that are closer are the same
    #: of a time base, or `most_per_row` per row of the recording, whichever is more
    most_samples: int = 1_000_000
    most_per_row: int = 4  #: samples per row of the recording
    silent_s: float = 2.0  #: s: a stream of a fixed rate is not silent for longer
    silent_intervals: float = 10.0  #: nor for more usual intervals
    regular_share: float = 0.98  #: of a stream's intervals that are usual ones if its rate is fixed
    regular_spread: float = 2.5  #: factor by which usual intervals may differ
    fewest_commands: int = 100  #: samples that show a fixed rate
    shortest_commands_s: float = 20.0  #: s with samples that show a fixed rate
    most_silences: int = 3  #: a stream with more silences that never repeats a row may log changes only
    #: of the samples of the busiest component: below, the components come from several sensors
    shared_share: float = 0.5
    row_share: float = 0.9  #: of the rows: a sensor with samples in so many makes the rows a time base
    uneven_ratio: float = 1.5  #: of the usual intervals to the base's, above which the base is worth a word
    fewest_samples: int = 10  #: of a sensor that may set the time base
    motion_blocks: int = 200  #: parts of a record whose motion is compared


SETTINGS = ResamplingSettings()


def uniform(t: Array, rate_hz: float | None, file: str = "recording") -> Array:
    """Uniform times in s from the first sample on, shape (n,), at `rate_hz` or the rate that suits `t`."""
    usual = float(np.median(np.diff(t)))
    step = 1.0 / rate_hz if rate_hz else base_step(t)
    if not rate_hz and step == usual:
        # The mean interval of an evenly sampled log is exact where the median carries the clock's rounding.
        mean = (t[-1] - t[0]) / (len(t) - 1)
        step = mean if abs(mean - step) * len(t) < 0.1 * step else step
    count = int(np.floor((t[-1] - t[0]) / step + 1e-3)) + 1
    if count > max(SETTINGS.most_samples, SETTINGS.most_per_row * len(t)):
        row = int(np.argmax(np.diff(t)))
        raise TrialError(
            f"{file}: t_s: a base of {1.0 / step:.4g} Hz over {t[-1] - t[0]:.4g} s would have {count:.3g}"
            f" samples for {len(t)} rows; the longest gap, {t[row + 1] - t[row]:.4g} s, comes after row"
            f" {row + 1}. Cut the recording there into trials, check the unit of the time, or give a lower"
            " rate_hz"
        )
    return np.asarray(t[0] + step * np.arange(count))


def held(signal: Signal, t: Array) -> Array:
    """Means of a command over the steps that begin at the uniform times `t`, shape (n, k); before the first
    stamp the first acts. With the mean of a step, which the simulation holds, every command acts at its own
    stamp; the value at the step's beginning would come late by half a step on average.
    """
    step = (t[-1] - t[0]) / (len(t) - 1) if len(t) > 1 else 1.0
    # Stamps that are those of the base but for rounding are the base's; seconds since 1970 are coarse.
    places = (signal.t - t[0]) / step
    whole = np.round(places)
    tick = max(SETTINGS.equal_share, 4.0 * float(np.spacing(abs(t[-1]))) / step)
    places = np.where(np.abs(places - whole) <= tick, whole, places)
    begins = np.arange(len(t), dtype=float)
    before = np.maximum(np.searchsorted(places, begins, side="right") - 1, 0)
    value = signal.y[before]
    # Every later command of a step adds its change, for the share of the step that is left.
    inside = (places > 0.0) & (places < len(t)) & (places != np.floor(places))
    inside[:1] = False
    samples = np.flatnonzero(inside)
    steps = np.floor(places[samples]).astype(np.int_)
    share = 1.0 - (places[samples] - steps)
    change = signal.y[samples] - signal.y[samples - 1]
    result = np.array(value, dtype=float)
    np.add.at(result, steps, share[:, None] * change)
    return result


def silences(t: Array, y: Array, base: Array) -> list[tuple[float, float]]:
    """Spans (start, end) in s of `base` (n,) in which a stream (m, k) of commands of a fixed rate fell silent
    and is unknown. A stream that is logged when it changes, or now and then, holds until the next sample.
    """
    if len(t) < SETTINGS.fewest_commands:
        return []
    intervals = np.diff(t)
    usual = float(np.median(intervals))
    limit = max(SETTINGS.silent_s, SETTINGS.silent_intervals * usual)
    long = intervals > limit
    steady = (intervals < SETTINGS.regular_spread * usual) & (intervals > usual / SETTINGS.regular_spread)
    if steady.mean() < SETTINGS.regular_share or float(intervals[~long].sum()) < SETTINGS.shortest_commands_s:
        return []
    # Rows that go on while all commands rest: the log has every sample, not every change.
    rests = runs(np.logical_and.reduce(y[1:] == y[:-1], axis=1) & ~long)
    resting = any(t[stop] - t[start] > limit for start, stop in rests)
    if long.sum() > SETTINGS.most_silences and not resting:
        return []
    edges = [float(base[0]), *t.tolist(), float(base[-1])]
    return [(start, end) for start, end in pairwise(edges) if end - start > limit]


def linear(signal: Signal, t: Array) -> tuple[Array, Mask]:
    """Values (n, k) at the times `t` and which of them are valid (n, k)."""
    if signal.name == "attitude":
        return _attitude(signal, t)
    columns = [
        between(signal.t, signal.y[:, k], signal.bad[:, k], t, signal.interval)
        for k in range(signal.y.shape[1])
    ]
    return np.stack([y for y, _ in columns], axis=1), np.stack([valid for _, valid in columns], axis=1)


def _attitude(signal: Signal, t: Array) -> tuple[Array, Mask]:
    """Chord between neighbouring attitudes, normalised: at ordinary rates the great circle to 1e-6 rad."""
    good = signal.good
    if not good.any():
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), np.zeros((len(t), 4), bool)
    # Without a copy where every sample is good: an attitude of a long log is large.
    q, times = (signal.y, signal.t) if good.all() else (signal.y[good], signal.t[good])
    q, _ = continuous(q)
    value = np.stack([np.interp(t, times, q[:, k]) for k in range(4)], axis=1)
    value /= np.linalg.norm(value, axis=1)[:, None]
    _, valid = between(signal.t, signal.y[:, 0], signal.bad[:, 0], t, signal.interval)
    return value, np.repeat(valid[:, None], 4, axis=1)


def angles(signal: Signal, t: Array) -> tuple[Array, Mask]:
    """Attitude (n, 4) at the times `t` and which of roll, pitch and yaw (n, 3) are valid: other than by
    `linear`, an angle that is missing for a while leaves the others valid.
    """
    if signal.unknown is None:
        q, valid = linear(signal, t)
        return q, valid[:, :3]
    lost = np.logical_and.reduce(signal.unknown, axis=1)
    q, _ = _attitude(replace(signal, bad=np.repeat(lost[:, None], 4, axis=1)), t)
    masks = [between(signal.t, signal.y[:, 0], signal.unknown[:, k], t, signal.interval)[1] for k in range(3)]
    return q, np.stack(masks, axis=1)


def between(times: Array, y: Array, bad: Mask, t: Array, step: float) -> tuple[Array, Mask]:
    """Values (n,) at the times `t` of samples `y` (m,), `step` apart as a rule, and which are valid."""
    good = ~bad
    if not good.any():
        return np.zeros(len(t)), np.zeros(len(t), bool)
    last = len(times) - 1
    tick = SETTINGS.equal_share * step
    before = np.clip(np.searchsorted(times, t + tick, side="right") - 1, 0, last)
    after = np.clip(np.searchsorted(times, t - tick, side="left"), 0, last)
    inside = (t >= times[0] - tick) & (t <= times[-1] + tick)
    near = times[after] - times[before] <= SETTINGS.gap_intervals * step
    return np.interp(t, times[good], y[good]), inside & near & good[before] & good[after]


_BASE = "time base"

_MOVING = ("rates", "attitude", "velocity", "position", "depth", "water velocity")


def common(t: Array, signals: Mapping[str, Signal], rate_hz: float | None, report: RecordingReport) -> Array:
    """Uniform times (n,), s, at `rate_hz`, else at the rate of the rows `t` where a sensor has samples in
    nearly all of them, else at that of the fastest one that shows the motion, to three digits.
    """
    able = [signal for signal in signals.values() if len(signal.t) >= SETTINGS.fewest_samples]
    moving = [signal for signal in able if signal.name in _MOVING] or able
    rows = max((len(signal.t) for signal in moving), default=len(t))
    if rate_hz or rows >= SETTINGS.row_share * len(t):
        step, usual = base_step(t), usual_interval(t)
        if not rate_hz and usual > SETTINGS.uneven_ratio * step:
            report.info("stamps uneven", _BASE, step_s=step, usual_s=usual)
        return uniform(t, rate_hz, report.source)
    if not moving:
        return uniform(t, None, report.source)
    fastest = min(moving, key=lambda signal: base_step(signal.t))
    rate = float(f"{1.0 / base_step(fastest.t):.3g}")
    report.info("stamps of several sensors", _BASE, rate_hz=rate, fastest=fastest.label)
    return uniform(t, rate, report.source)


def evenly_stamped(
    signals: Mapping[str, Signal], t: Array, report: RecordingReport
) -> tuple[dict[str, Signal], Array]:
    """Signals whose stamps came in bursts with the samples of each burst spread, and the times of the rows
    (n,), spread with the sensor whose stamps they are.
    """
    result = dict(signals)
    spreads: dict[bytes, Spread | None] = {}
    by_stamps: dict[bytes, list[str]] = {}
    for name, signal in signals.items():
        stamps = signal.t.tobytes()
        if stamps not in spreads:
            spreads[stamps] = spread_bursts(signal.t)
        spread = spreads[stamps]
        if spread is not None:
            result[name] = replace(signal, t=spread.t)
            by_stamps.setdefault(stamps, []).append(name)
    for stamps, names in by_stamps.items():
        spread = spreads[stamps]
        assert spread is not None
        report.warning("bursts", ", ".join(names), bursts=spread.bursts, step_s=spread.step_s)
        if len(spread.t) >= SETTINGS.row_share * len(t):
            t = spread.t
    return result, t


def instruments(group: str, present: Mask) -> dict[str, list[int]]:
    """Components of a group's columns with any sample by the name of their signal: one, but for a position
    whose depth has other stamps than north and east. `present` (n, k): cells with a sample.
    """
    used = [k for k in range(present.shape[1]) if present[:, k].any()]
    level, depth = [k for k in used if k < 2], [k for k in used if k == 2]
    if group != "position" or not level or not depth or _one_sensor(present):
        return {group: used} if used else {}
    return {"position": level, "depth": depth}


def together(t: Array, y: Array, present: Mask, *, period: float | None = None) -> tuple[Array, Array] | None:
    """Times (m,) and components (m, k) at the stamps of the busiest one; None if they share their stamps.
    `present` (n, k): cells with a sample. An angle with a `period` goes the shorter way round.
    """
    if _one_sensor(present):
        return None
    lead = present[:, int(np.argmax(present.sum(axis=0)))]
    result = np.full((int(lead.sum()), y.shape[1]), np.nan)
    for k in range(y.shape[1]):
        here = present[:, k]
        times, values = t[here], y[here, k]
        bad = ~np.isfinite(values)
        if period is not None and not bad.all():
            values = np.where(bad, 0.0, values)
            values[~bad] = np.unwrap(values[~bad], period=period)
        value, valid = between(times, values, bad, t[lead], usual_interval(times))
        result[:, k] = np.where(valid, value, np.nan)
    return t[lead], result


def _one_sensor(present: Mask) -> bool:
    """Whether the components that have samples (n, k) have most of them in the same rows."""
    counts = present.sum(axis=0)
    used = counts > 0
    shared = int(np.logical_and.reduce(present[:, used], axis=1).sum())
    return shared >= SETTINGS.shared_share * int(counts.max(initial=0))


def own_samples(
    by_name: Mapping[str, Signal], base: Array | None = None, silent: Mask | None = None
) -> dict[str, tuple[Array, Array]]:
    """Good samples of each channel at the stamps of its sensor: times in s and values in SI (m,). A sensor
    with the stamps of the `base` (n,) has no others and is left out, to save memory; so are samples next to
    those of the base at which the command is unknown, `silent` (n,).
    """
    samples: dict[str, tuple[Array, Array]] = {}
    for name in ("position", "depth", "velocity", "rates"):
        if (signal := by_name.get(name)) is None or _same(signal.t, base):
            continue
        for k, channel in enumerate(signal.channels):
            samples[channel] = _kept(signal.t, signal.y[:, k], ~signal.bad[:, k])
    if (attitude := by_name.get("attitude")) is not None and not _same(attitude.t, base):
        angles = to_euler(attitude.y)
        for k, channel in enumerate(ANGLES):
            good = attitude.good if attitude.unknown is None else ~attitude.unknown[:, k]
            if channel in attitude.channels:
                samples[channel] = _kept(attitude.t, angles[:, k], good)
    if base is not None and silent is not None:
        for channel, (t, y) in samples.items():
            after = np.clip(np.searchsorted(base, t), 1, len(base) - 1)
            samples[channel] = _kept(t, y, ~(silent[after] | silent[after - 1]))
    return {channel: samples[channel] for channel in CHANNELS if channel in samples}


def most_moving(samples: Mapping[str, tuple[Array, Array]], most: int) -> dict[str, tuple[Array, Array]]:
    """At the most `most` samples of each channel, of the stretch of time in which they move most: by the
    standard deviations within `motion_blocks` equal parts as shares of their sum. A short record stays whole.
    """
    longest = max((len(t) for t, _ in samples.values()), default=0)
    if longest <= most:
        return dict(samples)
    edges = np.linspace(
        min(t[0] for t, _ in samples.values() if len(t)),
        max(t[-1] for t, _ in samples.values() if len(t)),
        SETTINGS.motion_blocks + 1,
    )
    motion = np.zeros(SETTINGS.motion_blocks)
    bounds = {channel: np.searchsorted(t, edges) for channel, (t, _) in samples.items()}
    for channel, (_, y) in samples.items():
        # A heading that turns round and round would be as still as none by its wrapped values.
        y = np.unwrap(y) if channel in ANGLES else y
        parts = [y[a:b] for a, b in pairwise(bounds[channel])]
        spread = np.array([np.std(part) if len(part) > 1 else 0.0 for part in parts])
        motion += spread / max(float(spread.sum()), 1e-300)
    # As many blocks as the densest stretch of any channel allows, one at least.
    counts = np.stack([np.diff(limits) for limits in bounds.values()])
    wide = next((k for k in range(SETTINGS.motion_blocks, 1, -1) if _sums(counts, k).max() <= most), 1)
    first = int(np.argmax(_sums(motion[None], wide)[0]))
    return {
        channel: (t[a:b][:most], y[a:b][:most])
        for channel, (t, y) in samples.items()
        for a, b in [(bounds[channel][first], bounds[channel][first + wide])]
    }


def _sums(values: Array, wide: int) -> Array:
    """Sums (k, n - wide + 1) over `wide` neighbours of values (k, n)."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, wide, axis=1).sum(axis=2))


def _same(t: Array, base: Array | None) -> bool:
    """Whether stamps are those of the time base."""
    if base is None or len(t) != len(base) or len(t) < 2:
        return False
    return bool(np.max(np.abs(t - base)) <= SETTINGS.equal_share * (base[1] - base[0]))


def _kept(t: Array, y: Array, good: Mask) -> tuple[Array, Array]:
    """Good samples, without a copy where all are."""
    return (t, y) if good.all() else (t[good], y[good])
