"""A signal (one sensor's samples on its own time base), a series (one channel of it), and the report of
what was done to a recording.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.errors import TrialError, nearest
from seatrial.base.finding import Finding, Severity, by_severity
from seatrial.base.plain import Plain
from seatrial.logs.clock import usual_interval


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
class RecordingFinding(Finding):
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

    def to_dict(self) -> dict[str, Any]:
        """Level, channel, message, count and kind as plain data for JSON."""
        return {
            "severity": self.level,
            "channel": self.subject,
            "message": self.message,
            "count": self.count,
            "kind": self.kind,
        }


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
