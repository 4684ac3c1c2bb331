"""Whether the channels of a log tell one motion, and what would make them.

Position, depth, velocity, attitude, rates and specific force are tied by kinematics, whatever moves the
vehicle (data compatibility, flight-path reconstruction: Klein and Morelli, Aircraft System Identification,
2006, chapter 10; kinematics: Fossen 2011, chapter 2). The attitude is the reference of time and of angles;
the gyro is compared with it, then the velocity with position and depth, then the specific force. A
correction is proposed if it is five deviations from nothing, not small and makes the channels agree better.
Of the trials of a campaign one correction per key is proposed, to paste into its file. Held by
``tests/inspect/test_consistency.py`` and ``tests/inspect/test_consistency_trials.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.finding import Finding, Severity
from seatrial.base.frames import from_euler, matrix, product, to_euler
from seatrial.base.plain import Plain
from seatrial.base.report import sentence_of
from seatrial.inspect.consistency_current import slow_current
from seatrial.inspect.consistency_sensors import Found, force_found, rates_found, scaled, velocity_found
from seatrial.inspect.corrections import (
    Consistency,
    Correction,
    SlowCurrent,
    beside,
    contradiction_of,
    corrections_of,
)
from seatrial.trial.attitude import AttitudeConvention, as_convention, attitude_convention, certain_tilt
from seatrial.trial.corrections import to_origin
from seatrial.trial.defects import stuck
from seatrial.trial.kinematic_fit import robust_rms
from seatrial.trial.kinematics import Channels, Curve
from seatrial.trial.signals import INPUTS, RecordingReport, Series, checked, own_samples

if TYPE_CHECKING:
    from seatrial.trial.recording import Recording
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class ConsistencySettings:
    """Which channels are compared, and what their units and mounting must be."""

    fewest_samples: int = 50  #: Samples of a channel that can be compared.
    most_pitch: float = 1.7  #: Largest pitch, rad: more are degrees.
    most_roll: float = 3.3  #: Largest roll, rad: more are degrees.
    #: Of a heading error that sway on straight legs shows if the sensor is turned.
    mounted_share: float = 0.5


SETTINGS = ConsistencySettings()


def consistency(series: Mapping[str, Series], *, quaternion: bool = True) -> Consistency:
    """Corrections that would make the channels tell one motion, and what the log cannot tell. ``series`` by
    channel: those of a trial, ``u_water v_water w_water`` through the water, ``ax ay az`` specific force in
    m/s^2, ``cmd.<actuator>`` in any unit, the wrench ``tau.X_n`` ... ``tau.N_nm``. Of a `quaternion` order
    and direction are asked, too, not only the frame. TrialError: an unknown channel, or stamps that do not
    rise.

    >>> import numpy as np
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> found = consistency({"z": Series(t, 2.0 + 0.0 * t), "yaw": Series(t, 0.1 * t)})
    >>> len(found.corrections), found.current
    (0, None)
    """
    given = checked(series)
    known = {name: samples for name, samples in given.items() if len(samples.t) >= SETTINGS.fewest_samples}
    untold = missing(given)
    if few := [name for name in given if name not in known and not name.startswith(INPUTS)]:
        fewest = {"fewest": SETTINGS.fewest_samples}
        untold.insert(0, Finding("few samples", Severity.NOTE, ", ".join(few), fewest))
    contradicted = _stuck(known)
    if not {"pitch", "yaw"} & set(known):
        return Consistency((), tuple(untold), contradicted=tuple(contradicted))
    corrections = _angles(known)
    channels = _curves(known)
    # The attitude is the reference of all that follows: its convention comes first.
    convention = attitude_convention(channels, quaternion=quaternion)
    if convention is not None:
        values = {"sentence": convention.sentence}
        contradicted.append(Finding("attitude convention", Severity.PROBLEM, "attitude", values))
        if not convention.either:  # the others are compared with what the attitude is then
            _turn(channels, convention)
    undecided = convention is not None and convention.either
    sensors = [None if undecided else rates_found(channels), *velocity_found(channels)]
    compared = []
    for sensor in (*(sensor for sensor in sensors if sensor is not None), force_found(channels)):
        if sensor is None:
            continue
        wrong = contradiction_of(sensor)
        if sensor.fit is None:
            if wrong is None:
                untold.append(sensor.why or Finding("too little in common", Severity.NOTE, sensor.of))
            else:
                contradicted.append(wrong)
            continue
        made = corrections_of(sensor, channels, _turned_sensor(channels, sensor))
        if sensor.group == "specific force":  # no trial reads it: nothing to paste
            untold += [
                Finding("specific force", Severity.NOTE, cause=correction.finding) for correction in made
            ]
        else:
            present = {correction.key for correction in corrections}
            corrections += [correction for correction in made if correction.key not in present]
        contradicted += [] if wrong is None else [wrong]
        untold += beside(sensor, channels)
        if sensor.group == "velocity":
            _apply(channels, sensor)
        compared.append((sensor.of, sensor.sizes[0], sensor.fit.after))
    corrections += _frame(channels)
    current = slow_current(channels)
    if isinstance(current, Finding):
        untold.append(current)
    order = sorted(corrections, key=lambda correction: -(correction.before / max(correction.after, 1e-12)))
    return Consistency(
        tuple(order),
        tuple(untold),
        current if isinstance(current, SlowCurrent) else None,
        tuple(compared),
        tuple(contradicted),
    )


def convention_of(series: Mapping[str, Series]) -> AttitudeConvention | None:
    """Convention of a recorded quaternion if it is not the one it was read with; else None."""
    known = {
        name: samples
        for name, samples in checked(series).items()
        if len(samples.t) >= SETTINGS.fewest_samples
    }
    return attitude_convention(_curves(known))


def _curves(known: Mapping[str, Series]) -> Channels:
    return Channels({name: Curve(samples, angle=name in ("roll", "yaw")) for name, samples in known.items()})


def _turn(channels: Channels, convention: AttitudeConvention) -> None:
    """Bring the attitude to what its convention makes of it, in place."""
    old = channels.curves["roll"]
    angles = to_euler(as_convention(channels.rotation(old.t), convention))
    for k, name in enumerate(("roll", "pitch", "yaw")):
        channels.curves[name] = Curve(Series(old.t, angles[:, k], old.clock), angle=name != "pitch")


def _stuck(known: dict[str, Series]) -> list[Finding]:
    """Leave out angles that never change while another one does, in place; which ones."""
    still = stuck({name: known[name].value for name in ("roll", "pitch", "yaw") if name in known})
    for name in still:
        del known[name]
    return [Finding("angle stuck", Severity.PROBLEM, name, {"rad": value}) for name, value in still.items()]


def _angles(known: dict[str, Series]) -> list[Correction]:
    """Turn angles in degrees into radians, in place; the correction that says so."""
    most = {
        name: float(np.abs(known[name].value).max()) for name in ("roll", "pitch", "yaw") if name in known
    }
    jumps = np.abs(np.diff(known["yaw"].value)).max(initial=0.0) if "yaw" in known else 0.0
    degrees = (
        most.get("pitch", 0.0) > SETTINGS.most_pitch
        or most.get("roll", 0.0) > SETTINGS.most_roll
        or 300.0 < jumps < 400.0
    )
    if not degrees:
        return []
    for name in most:
        known[name] = Series(known[name].t, known[name].value * DEGREE, known[name].clock)
    largest = max(most.values())
    finding = Finding("attitude in degrees", Severity.WEAKNESS, "attitude", {"largest_rad": largest})
    sizes = (largest, largest * DEGREE, "largest angle, rad")
    return [Correction("corrections", "scale.attitude", round(DEGREE, 8), 0.0, "", *sizes, finding)]


def _turned_sensor(channels: Channels, velocity: Found) -> bool:
    """Whether a heading error is the velocity sensor's mounting: then it shows sway on straight legs."""
    if velocity.fit is None or "heading" not in velocity.fit.values:
        return False
    t = channels.curves["u"].t
    yaw = channels.at("yaw", t, {})
    rate = np.abs(np.gradient(yaw, t))
    u, v = (channels.at(name, t + channels.delay.get("velocity", 0.0), {}) for name in "uv")
    straight = (rate < np.quantile(rate, 0.5)) & (np.abs(u) > 0.5 * np.quantile(np.abs(u), 0.9))
    if straight.sum() < SETTINGS.fewest_samples:
        return False
    slip = float(np.median(v[straight] / u[straight]))
    # Turned by the heading error the sensor would make the sway vanish.
    return bool(abs(slip + np.tan(velocity.fit.values["heading"])) < SETTINGS.mounted_share * abs(slip))


def _apply(channels: Channels, velocity: Found) -> None:
    """Bring the velocity to what the current is estimated from: scale and yaw of the attitude."""
    values = {} if velocity.fit is None else velocity.fit.values
    if "scale.velocity" in values:
        scaled(channels, dict.fromkeys("uvw", 1.0 + values["scale.velocity"]))
    if "heading" in values and "yaw" in channels.curves:
        old = channels.curves["yaw"]
        channels.curves["yaw"] = Curve(Series(old.t, old.values + values["heading"], old.clock))


def _frame(channels: Channels) -> list[Correction]:
    """Tilt of a pose's earth frame against gravity, where a whole pose came from one instrument."""
    whole = {"x", "y", "z", "roll", "pitch", "yaw"}
    if not whole <= set(channels.curves) or channels.group("z") != "position":
        return []
    t = channels.curves["roll"].t
    q = from_euler(np.stack([channels.at(name, t, {}) for name in ("roll", "pitch", "yaw")], axis=1))
    tilted = certain_tilt(q)
    if tilted is None or not tilted.trusted:
        return []
    north, east = tilted.direction
    sd = tilted.deviation / DEGREE
    value = [round(float(np.arcsin(x)) / DEGREE, 3) for x in (north, east)]
    values = {"tilt_deg": tilted.angle / DEGREE, "sd_deg": sd}
    finding = Finding("frame tilted", Severity.WEAKNESS, "pose", values)
    sizes = (_upright(q, np.zeros(2)), _upright(q, tilted.direction), "upright of the body and gravity, rad")
    return [Correction("corrections", "tilt_deg.frame", value, [sd, sd], "deg", *sizes, finding)]


def _upright(q: Array, direction: Array) -> float:
    """Root mean square of ``R c - n``, horizontal, with the best trim c for a gravity direction n (2,)."""
    turned = matrix(q)
    design = turned[:, :2, :2].reshape(-1, 2)
    goal = np.tile(direction, len(q)) - turned[:, :2, 2].ravel()
    trim = np.linalg.lstsq(design, goal, rcond=None)[0]
    return robust_rms((goal - design @ trim).reshape(-1, 2))


def missing(series: Mapping[str, Series]) -> list[Finding]:
    """Channels that are not recorded.

    >>> missing({})[0].subject
    'attitude'
    """
    has = set(series)
    attitude = has & {"roll", "pitch", "yaw"}
    rates = [name for name in "pqr" if name not in has]
    lacking = {
        "attitude": not attitude,
        "roll": attitude and "roll" not in has,
        "pitch": attitude and "pitch" not in has,
        "yaw": attitude and "yaw" not in has,
        " ".join(rates): rates,
        "position": not {"x", "y"} <= has,
        "depth": "z" not in has,
        "velocity over ground": not {"u", "v", "w"} & has,
        "velocity through the water": not {"u_water", "v_water"} <= has,
    }
    return [Finding("not recorded", Severity.NOTE, name) for name, lacks in lacking.items() if lacks]


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
        return sentence_of(self.finding, "trial_findings")


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
    """A late velocity that reading leaves, in the shortest trial where it could not use the position: there
    the depth tells, as in `check`. `problem` is what `seatrial check` is to be given, for the message.
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
    """One proposal a key over all trials, what reading leaves first, then the largest effect. `clocks`: by
    trial and sensor the file whose clock the import proposed already.
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
