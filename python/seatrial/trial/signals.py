"""A signal (one sensor's samples on its own time base), a series (one channel of it), and the report of
what was done to a recording.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.errors import TrialError, nearest
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


Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One fact about a channel of a recording.

    Attributes
    ----------
    severity, channel, message
    count
        Number of samples or events that it concerns.
    kind
        What others ask for: "clock jumped", "uncommanded", "mostly masked", "above the surface", "latency not
        estimated", "sign reversed", "derived"; empty for all else.
    """

    severity: Severity
    channel: str
    message: str
    count: int | None = None
    kind: str = ""

    def __str__(self) -> str:
        number = "" if self.count is None else f"{self.count} "
        return f"{self.severity:<8} {self.channel}: {number}{self.message}"


@dataclass
class RecordingReport(Plain):
    """What is known about a recording: findings, latencies removed and samples masked.

    Attributes
    ----------
    source
        File or frame that was read.
    samples, rate_hz, duration_s
        Common time base.
    findings
        Facts in the order in which they were found.
    latencies
        Delay in s of a sensor against the pose, removed, by sensor ("velocity", "rates").
    tilt
        Direction of gravity in the pose's frame as recorded, north and east of its z in rad, where the pose
        was turned upright.
    masked
        Number of samples kept out of every criterion, by channel.
    corrections
        Key and value of the corrections that were given and applied.
    """

    source: str
    samples: int = 0
    rate_hz: float = 0.0
    duration_s: float = 0.0
    findings: list[Finding] = field(default_factory=list)
    latencies: dict[str, float] = field(default_factory=dict)
    tilt: tuple[float, float] | None = None
    masked: dict[str, int] = field(default_factory=dict)
    corrections: dict[str, Any] = field(default_factory=dict)

    def add(
        self, severity: Severity, channel: str, message: str, count: int | None = None, *, kind: str = ""
    ) -> None:
        """Append a finding; a count of zero is no finding, and one gap, spike or jump is singular."""
        if count == 1:
            message = re.sub(
                r"^(gap|spike|jump|frozen sample|sign flip|NaN or infinite sample|pulse width)s\b",
                r"\1",
                message,
            )
            message = re.sub(r"^samples are no (.*)s \(", r"sample is no \1 (", message)
        if count != 0:
            self.findings.append(Finding(severity, channel, message, count, kind))

    @property
    def errors(self) -> list[str]:
        """Findings with which the recording should not be used as it is, a clause each."""
        wrong = [finding for finding in self.findings if finding.severity == "error"]
        return [str(finding).removeprefix(finding.severity).strip() for finding in wrong]

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
        order = {"error": 0, "warning": 1, "info": 2}
        lines += [str(finding) for finding in sorted(self.findings, key=lambda f: order[f.severity])]
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
    """Samples of one channel at the stamps of its own sensor.

    Attributes
    ----------
    t
        Rising stamps in s, shape (n,), on the clock that stamped them.
    value
        Samples in SI, NED or forward-right-down, shape (n,); NaN where lost.
    clock
        Name of that clock, usually of the file; series of one name share it.
    """

    t: Array
    value: Array
    clock: str = ""


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
