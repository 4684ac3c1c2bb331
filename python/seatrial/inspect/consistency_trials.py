"""Consistency of the trials of a campaign, and what to paste into its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.channels import DEGREE
from seatrial.base.finding import Finding, Severity
from seatrial.base.frames import from_euler, product, to_euler
from seatrial.base.plain import Plain
from seatrial.base.report import sentence_of
from seatrial.inspect.consistency import consistency
from seatrial.inspect.corrections import Consistency, Correction, SlowCurrent
from seatrial.trial.corrections import to_origin
from seatrial.trial.resampling import own_samples
from seatrial.trial.signals import RecordingReport, Series

if TYPE_CHECKING:
    from seatrial.trial.recording import Recording
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class Proposal(Plain, without="finding", also="text"):
    """One key of a campaign that its trials propose, with the trials; ``done``: reading does it by itself."""

    finding: Finding
    trials: tuple[str, ...]
    effect: float
    done: bool

    @property
    def text(self) -> str:
        """What was found, its effect, and what to write where."""
        return sentence_of(self.finding, "consistency")


def series_of(recording: Recording) -> dict[str, Series]:
    """Channels of a recording at the stamps of their sensors, as the corrections given say."""
    signals = to_origin(recording.signals, recording.positions, RecordingReport(recording.file))
    series = {name: Series(t, y) for name, (t, y) in own_samples(signals).items()}
    for name, signal in signals.items():
        for k, channel in enumerate(signal.channels):
            keys = {"water velocity": channel, "force": f"tau.{channel}_n", "moment": f"tau.{channel}_nm"}
            key = name if name.startswith("cmd.") else keys.get(name)
            if key is not None:
                good = ~signal.bad[:, k]
                series[key] = Series(signal.t[good], signal.y[good, k])
    return series


def consistency_of_recording(recording: Recording) -> Consistency:
    """What would make the channels of a recording tell one motion, beyond the corrections that it has."""
    result = consistency(series_of(recording), quaternion="q_w" in recording.sources)
    if "current" in recording.signals:
        result = replace(result, current=None)
    given = recording.corrections.given | {f"{sensor}_m": arm for sensor, arm in recording.positions.items()}
    return replace(result, corrections=tuple(_on_top(proposal, given) for proposal in result.corrections))


_TELLS_DELAY = ("z", "u", "v", "w", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class LateVelocity:
    """A velocity that reading leaves late: of which trial, by how much (s), and the line that corrects it.

    ``before`` and ``after`` are the root mean square differences in m/s between the rate of depth and the
    velocity, with the delay and without it.
    """

    trial: str
    delay_s: float
    line: str
    before: float
    after: float
    problem: str

    @property
    def spoils(self) -> bool:
        """Whether the channels contradict one another so much that no coefficient is to be had from them."""
        return self.before > 1.5 * self.after  # an estimate on a rate that errs so much more is none

    @property
    def finding(self) -> Finding:
        """The delay, with what it does to the rate of depth and the line that corrects it."""
        return Finding("late velocity", Severity.DANGER, self.trial, asdict(self))


def late_velocity(
    trials: Mapping[str, Trial], recordings: Mapping[str, Recording | None], *, problem: str
) -> LateVelocity | None:
    """A late velocity that reading leaves; None where there is none.

    Reading removes what it can estimate from the position. Where that comes too slowly or not at all, the
    depth tells, as in `check`: here of the shortest such trial, and of nothing but the delay. A trial without
    its recording tells nothing. `problem` is what `seatrial check` is to be given, for the message.
    """

    def left(trial: Trial) -> bool:
        if not {"x", "y"} & set(trial.channels):
            return True
        return any(
            finding.subject == "velocity" and finding.kind == "latency not estimated"
            for finding in trial.report.findings
        )

    # One trial tells, and the shortest costs least.
    name = min(
        (name for name, trial in trials.items() if left(trial)),
        key=lambda name: len(trials[name]),
        default="",
    )
    recording = recordings.get(name)
    if recording is None or "delay_s.velocity" in recording.corrections.given:
        return None
    series = {
        channel: samples for channel, samples in series_of(recording).items() if channel in _TELLS_DELAY
    }
    for proposal in consistency(series).corrections:
        if proposal.key == "delay_s.velocity":
            delay = float(proposal.value)
            return LateVelocity(name, delay, proposal.line, proposal.before, proposal.after, problem)
    return None


def _on_top(correction: Correction, given: Mapping[str, Any]) -> Correction:
    """The correction with the value that a key needs which holds one already."""
    key, value = correction.key, correction.value
    before = given.get(key)
    if before is None or key.startswith("axes."):
        return correction
    if key.startswith(("signs.", "scale.")):
        value = type(value)(value * before)
    elif key == "tilt_deg.velocity":
        both = product(from_euler(np.array(value) * DEGREE), from_euler(np.array(before) * DEGREE))
        value = [round(float(angle) / DEGREE, 3) for angle in to_euler(both)]
    elif isinstance(value, list):
        value = [round(float(x + y), 3) for x, y in zip(value, before, strict=True)]
    else:
        value = float(f"{value + before:.6g}")
    finding = replace(correction.finding, values={**correction.finding.values, "given": key})
    return replace(correction, value=value, finding=finding)


def proposals(
    by_trial: Mapping[str, Consistency],
    reports: Mapping[str, RecordingReport],
    clocks: Mapping[str, Mapping[str, str]] | None = None,
) -> tuple[Proposal, ...]:
    """One proposal a key over all trials, what reading leaves first, then the largest effect.

    `clocks`: by trial, of which file's clock the import proposed the delay of a sensor already.
    """
    by_key: dict[tuple[str, str], list[tuple[str, Correction]]] = {}
    for name, result in by_trial.items():
        for correction in result.corrections:
            by_key.setdefault((correction.table, correction.key), []).append((name, correction))
    made = []
    for entries in by_key.values():
        trials = tuple(name for name, _ in entries)
        best = max((correction for _, correction in entries), key=_effect)
        done = all(_done(correction.key, reports[name]) for name, correction in entries)
        kind, _, sensor = best.key.partition(".")
        files = {(clocks or {}).get(name, {}).get(sensor, "") for name in trials} - {""}
        place, averaged = _place(dict(entries), len(by_trial))
        values = {
            "trials": trials,
            "range": _range(entries),
            "of": best.of,
            "before": best.before,
            "after": best.after,
            "place": place,
            "averaged": averaged,
            "clocks": sorted(files) if kind == "delay_s" else [],
            "done": done,
        }
        finding = Finding("correction proposed", Severity.WEAKNESS, best.key, values, best.finding)
        made.append(Proposal(finding, trials, _effect(best), done))
    made += [
        _current(name, current)
        for name, result in by_trial.items()
        if (current := accepted(result)) is not None
    ]
    return tuple(sorted(made, key=lambda proposal: (proposal.done, -proposal.effect)))


def _place(entries: Mapping[str, Correction], count: int) -> tuple[str, bool]:
    """What to write where, as `seatrial import` drafts it: the trials' mean (True), or each trial's value."""
    first = next(iter(entries.values()))
    if first.table == "clocks" or count == 1:
        return f"[{first.table}] {first.line}", False
    if not common(entries, count):
        lines = (f"[trials.{name}.{own.table}] {own.line}" for name, own in entries.items())
        return ", ".join(lines), False
    if len({repr(own.value) for own in entries.values()}) == 1:
        return f"[{first.table}] {first.line}", False
    return f"[{first.table}] {replace(first, value=mean(entries)[1]).line}", True


def common(entries: Mapping[str, Correction], count: int) -> bool:
    """Whether a correction is one of the vehicle: all trials that could tell it agree, and most tell it."""
    if 2 * len(entries) <= count:
        return False
    values = [np.atleast_1d(np.array(correction.value)) for correction in entries.values()]
    if not all(np.issubdtype(value.dtype, np.number) for value in values):
        return all(np.array_equal(values[0], value) for value in values)
    off, _ = mean(entries)
    return bool(off < 4.0)  # deviations that trials are apart whose corrections are not one


def mean(entries: Mapping[str, Correction]) -> tuple[float, Any]:
    """How many deviations the trials are apart, root mean square, and their mean, weighed by deviations."""
    x = np.array([np.atleast_1d(np.array(correction.value, float)) for correction in entries.values()])
    sd = np.array([
        np.broadcast_to(np.array(correction.sd, float), x.shape[1:]) for correction in entries.values()
    ])
    if not (sd > 0.0).any():
        return (np.inf if np.ptp(x, axis=0).any() else 0.0), next(iter(entries.values())).value
    weight = 1.0 / np.maximum(sd, 1e-12 + 1e-3 * sd.max()) ** 2
    mean = np.sum(weight * x, axis=0) / np.sum(weight, axis=0)
    apart = np.sqrt(np.mean(weight * (x - mean) ** 2, axis=0)) if len(x) > 1 else np.zeros(x.shape[1])
    value = next(iter(entries.values())).value
    rounded = [float(f"{x:.4g}") for x in mean]
    return float(apart.max()), rounded if isinstance(value, list) else rounded[0]


def accepted(result: Consistency) -> SlowCurrent | None:
    """The slow current if a trial gains by taking it over; reading takes that of a water velocity itself."""
    current = result.current
    return current if current is not None and current.legs and current.worth else None


def _current(name: str, current: SlowCurrent) -> Proposal:
    ratios = [before / max(after, 1e-12) for before, after in zip(current.before, current.after, strict=True)]
    finding = Finding("current proposed", Severity.WEAKNESS, name, {"current": current})
    return Proposal(finding, (name,), max(ratios), False)


def _effect(correction: Correction) -> float:
    return correction.before / max(correction.after, 1e-12)


def _range(entries: list[tuple[str, Correction]]) -> tuple[float, float] | None:
    """From which to which value the trials go, where there are several numbers."""
    values = [correction.value for _, correction in entries]
    if len(values) < 2 or not all(isinstance(x, float) for x in values) or min(values) == max(values):
        return None
    return min(values), max(values)


def _done(key: str, report: RecordingReport) -> bool:
    """Whether reading corrected it by itself."""
    kind, _, name = key.partition(".")
    if kind == "delay_s":
        return name in report.latencies
    if key == "tilt_deg.frame":
        return report.tilt is not None
    return kind == "signs" and any(
        finding.subject == name and finding.kind == "sign reversed" for finding in report.findings
    )
