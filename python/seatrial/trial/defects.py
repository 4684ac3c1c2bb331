"""Defects of sensors found from their samples alone: frozen, jumping, spiking, constant, saturated.

A sample found bad is masked; nothing is put in its place. Thresholds are relative to the record's own
ordinary motion (its 95th and 98th percentiles), so that no vehicle's size or speed is assumed. Stamps of
arrival jitter: a motion is never taken over less than the sensor's usual interval. A filter that corrects its
estimate now and then makes small steps that stay, while a wrong solution comes back; where steps recur and
stay, only what stands out of them is a jump or ends a freeze.

A rare fast motion (the release of a roll decay in a quiet record) stands out of the ordinary as a spike
does. Two things tell them apart: a motion has neighbours that move too, a spike stands alone between quiet
samples; and another sensor shows a motion (the derivative of the attitude that of a gyro, the derivative of
the position that of a Doppler log, and the other way round). Held by ``tests/trial/test_defects.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.channels import ANGLES
from seatrial.base.frames import angle_between, conjugate, continuous, product, to_euler
from seatrial.trial.columns import GROUPS
from seatrial.trial.signals import RecordingReport, Signal

_MEASURED = ("position", "depth", "attitude", "velocity", "water velocity", "rates")


@dataclass(frozen=True)
class DefectSettings:
    """What makes samples frozen, jumping, constant or impossible."""

    #: s: a pose between two jumps less than this apart is a wrong solution of the positioning system
    longest_wrong_fix_s: float = 5.0
    usual_pulses_us: tuple[float, float] = (700.0, 2500.0)  #: us, pulse widths of motors and servos
    longest_pulse_us: float = 3000.0  #: us: a longer pulse width is impossible
    #: m: rounding, drift and waves bring a vehicle at the surface no higher for most of a record
    above_surface_m: float = 0.3
    #: of a command's samples up to which impossible ones are damage and not another unit
    damaged_share: float = 0.01
    believed_speeds: float = 3.0  #: a pose may move this many times faster than its speed sensor says
    #: a rounded sensor repeats single channels in more than this share of its samples
    rounded_share: float = 0.01
    repeats_by_chance: int = 3  #: repeats in a row of a scalar that mean nothing
    stuck_rad: float = 1e-6  #: rad: less than any sensor's noise, more than the rounding of quaternions
    cancelled_share: float = 0.5  #: of the largest jump, that may be left of jumps which cancel
    #: a slower sensor written at the table's rate repeats at least this share of its samples
    held_share: float = 0.05
    held_runs: int = 20  #: and does so in at least so many runs


SETTINGS = DefectSettings()


@dataclass(frozen=True)
class _Spike:
    """What makes samples that stand alone a spike of the sensor."""

    longest: int = 3  # samples in a row
    far: float = 8.0  # it stands out by this many times what 95 % of the samples do
    window: int = 7  # samples of the running median that it stands out of
    neighbours: int = 5  # samples on both sides of it
    moves: float = 0.1  # a neighbour moves if it stands out by this share of the spike
    changes: float = 0.25  # or if it changes by this share from sample to sample
    most_alone: int = 3  # neighbours that may: those of two spikes do, or of a step between two samples
    shown: float = 0.5  # share of it that another sensor must show within a second to make it a motion
    unusual: float = 5.0  # medians by which that sensor must stand out of its own noise


@dataclass(frozen=True)
class _Correction:
    """What makes lone steps the corrections of a sensor's filter."""

    # A sensor corrects itself that makes this many lone steps beyond so many medians of its steps. Of
    # Gaussian noise 0.07 % are as large.
    outstanding: float = 5.0
    fewest: int = 10
    # Of random steps one in eight is undone by the next one to 30 %, of wrong solutions one in two.
    undone: float = 0.3
    returning: float = 0.3
    # Of exponentially distributed corrections one in a thousand is beyond ten of their medians.
    largest: float = 10.0
    small: float = 0.1  # of the record's motion: what corrects an estimate of it usually


_SPIKE, _CORRECTION = _Spike(), _Correction()


def mark(signals: Mapping[str, Signal], report: RecordingReport) -> dict[str, Signal]:
    """The same signals with bad samples marked, every kind of defect reported."""
    marked = dict(signals)
    measured = [name for name in _MEASURED if name in signals]
    repeated = {name: _repeats(signals[name].y) for name in measured}
    frozen: dict[str, Mask] = {}
    silent = _silent([signals[name] for name in measured], repeated, report)
    for name in measured:
        signal = signals[name]
        peers = [repeated[other] for other in measured if np.array_equal(signals[other].t, signal.t)]
        at_rest = np.logical_and.reduce(peers) if len(peers) > 1 else repeated[name]
        pause = silent.get(name, np.zeros(len(signal.t), bool))
        frozen[name] = _frozen(signal, repeated[name] & ~pause, at_rest, report)
        marked[name] = signal.masked(frozen[name] | pause)
    speeds = {name: _speed(marked, name) for name in ("velocity", "rates")}
    for name, speedometer in (("position", "velocity"), ("depth", "velocity"), ("attitude", "rates")):
        if name in marked:
            jumps = _between_jumps(marked[name], signals.get(speedometer), report)
            marked[name] = marked[name].masked(jumps)
    if "position" in marked and "attitude" in marked and _one_sensor(frozen):
        marked["position"] = marked["position"].masked(~marked["attitude"].good)
        marked["attitude"] = marked["attitude"].masked(~marked["position"].good)
    for name in ("velocity", "water velocity", "rates"):
        if name in marked:
            marked[name] = marked[name].masked(_spikes(marked[name], speeds.get(name), report))
    for name in measured:
        _report_constant(signals[name], report)
    marked |= _possible_pulses(signals, report)
    _report_commands(marked, report)
    return marked


def _one_sensor(frozen: Mapping[str, Mask]) -> bool:
    """Whether position and attitude drop out together, as those of one positioning system do."""
    position, attitude = frozen["position"], frozen["attitude"]
    return bool(position.any()) and np.array_equal(position, attitude)


def _repeats(y: Array) -> Mask:
    """Samples (m,) equal to the one before in all channels; one without a number repeats nothing."""
    return np.concatenate([[False], np.logical_and.reduce(y[1:] == y[:-1], axis=1)])


def _silent(measured: list[Signal], repeated: Mapping[str, Mask], report: RecordingReport) -> dict[str, Mask]:
    """Rows by signal in which a logger repeated its last row, and behind which all sensors jump: the log has
    a gap. One frozen sensor is its own defect.
    """
    several = [s for s in measured if sum(np.array_equal(s.t, other.t) for other in measured) > 1]
    if len(several) < 2 or any(not np.array_equal(s.t, several[0].t) for s in several):
        return {}
    together = np.logical_and.reduce([repeated[s.name] for s in several])
    usual = _usual_run(together)
    jumps = np.logical_and.reduce([_jumps(s) for s in several])
    pause = np.zeros(len(together), bool)
    for start, stop in runs(together):
        if stop - start > max(usual, 1) and stop < len(together) and jumps[stop]:
            pause[start:stop] = True
    if not pause.any():
        return {}
    t = several[0].t
    longest = max(t[min(stop, len(t) - 1)] - t[start - 1] for start, stop in runs(pause))
    report.warning("rows repeated", "log", count=int(pause.sum()), longest_s=longest)
    return {s.name: pause for s in several}


def _usual_run(repeated: Mask) -> int:
    """Longest run of repeats, samples, that is ordinary: a slower sensor in a table at a higher rate."""
    lengths = [stop - start for start, stop in runs(repeated)]
    if len(lengths) >= SETTINGS.held_runs and repeated.mean() > SETTINGS.held_share:
        return 3 * int(np.quantile(lengths, 0.9))
    return 0


def _increments(signal: Signal) -> Array:
    """Size of the step from the sample before (m,); the first is zero, one to or from no number too."""
    step = np.linalg.norm(np.diff(signal.y, axis=0), axis=1)
    return np.concatenate([[0.0], np.nan_to_num(step)])


def _jumps(signal: Signal) -> Mask:
    """Samples (m,) whose step from the one before is larger than three ordinary ones and any correction."""
    increment = _increments(signal)
    moved = increment[increment > 0.0]
    usual = float(np.median(moved)) if len(moved) else 0.0
    return increment > max(3.0 * usual, _corrections(np.diff(signal.y, axis=0), _wide(signal, signal.y)))


def _wide(signal: Signal, y: Array) -> float:
    """Extent of most of the motion of a pose `y` (m, k): m, or rad of an attitude."""
    y = y[:, np.isfinite(y).any(axis=0)]  # a channel without a number says nothing of the motion
    if not y.size:
        return 0.0
    spread = np.nanquantile(y, 0.95, axis=0) - np.nanquantile(y, 0.05, axis=0)
    return float(np.linalg.norm(spread)) * (2.0 if signal.name == "attitude" else 1.0)


def _corrections(steps: Array, wide: float) -> float:
    """Size up to which a sensor's steps (m, k) may be corrections of its filter, which recur, stay and are
    small beside the motion `wide`; zero if it makes none. Steps to a wrong solution and back cancel.
    """
    size = np.nan_to_num(np.linalg.norm(steps, axis=1))
    moved = size[size > 0.0]
    if not len(moved):
        return 0.0
    # A step that stands alone: a motion has neighbours that move too.
    beside = np.pad(size, 1)
    alone = np.maximum(beside[:-2], beside[2:]) < _SPIKE.changes * size
    large = np.flatnonzero((size > _CORRECTION.outstanding * float(np.median(moved))) & alone)
    if len(large) < _CORRECTION.fewest:
        return 0.0
    left = np.linalg.norm(steps[large[1:]] + steps[large[:-1]], axis=1)
    undone = left < _CORRECTION.undone * np.maximum(size[large[1:]], size[large[:-1]])
    usual = float(np.median(size[large]))
    return (
        0.0
        if undone.mean() > _CORRECTION.returning or usual > _CORRECTION.small * wide
        else _CORRECTION.largest * usual
    )


def _frozen(signal: Signal, repeated: Mask, at_rest: Mask, report: RecordingReport) -> Mask:
    """Samples that repeat the one before although the vehicle moves: a jump ends them or noise ceases. While
    every sensor repeats, or from the first sample on, the vehicle is at rest in a record without noise.
    """
    result = np.zeros(len(repeated), bool)
    pauses = list(runs(repeated))
    if not pauses:
        return result
    usual = _usual_run(repeated)
    moves = 1.0 - repeated.mean()
    if usual and 0.2 < moves < 1.0:
        rates = {"rate_hz": moves / signal.step, "table_hz": 1.0 / signal.step}
        report.info("held samples", signal.label, count=int(repeated.sum()), **rates)
    # A sensor with noise never repeats one channel alone; a rounded or simulated one does.
    alone = np.any(signal.y[1:] == signal.y[:-1], axis=1) & ~repeated[1:]
    noisy = signal.y.shape[1] > 1 and alone.mean() < SETTINGS.rounded_share
    jumps = _jumps(signal)
    # Rounded samples of a pressure cell repeat by chance, a drop-out is longer than that.
    if signal.y.shape[1] == 1:
        usual = max(usual, SETTINGS.repeats_by_chance)
    events = 0
    for start, stop in pauses:
        ends = stop < len(repeated) and jumps[stop]
        moving = noisy and start > 1 and not at_rest[start:stop].all()
        if stop - start > usual and (ends or moving):
            result[start:stop] = True
            events += 1
    report.warning("frozen", signal.label, count=int(result.sum()), drop_outs=events)
    return result


def _deviation(y: Array, window: int) -> Array:
    """Distance of each sample from the running median of its neighbourhood, by channel, shape as y."""
    from scipy.ndimage import median_filter

    return np.asarray(np.abs(y - median_filter(y, size=(window, 1), mode="nearest")))


def _extent(deviation: Array, at: int) -> tuple[int, int]:
    """Start and end (exclusive) of the samples in a row that stand out half as far as sample `at` or more."""
    first = max(at - _SPIKE.window, 0)
    high = deviation[first : at + _SPIKE.window + 1] > 0.5 * deviation[at]
    before, after = high[: at - first][::-1], high[at - first :]
    start = at - (int(np.argmin(before)) if not before.all() else len(before))
    return start, at + (int(np.argmin(after)) if not after.all() else len(after))


def _alone(y: Array, deviation: Array, at: int) -> bool:
    """Whether few samples around sample `at` stand out or change as it does: inertia spreads a motion over
    several samples.
    """
    first, last = max(at - _SPIKE.neighbours, 0), at + _SPIKE.neighbours + 1
    outstanding = int(np.sum(deviation[first:last] > _SPIKE.moves * deviation[at]))
    changing = int(np.sum(np.abs(np.diff(y[first:last])) > _SPIKE.changes * deviation[at]))
    return outstanding <= _SPIKE.most_alone and changing <= _SPIKE.most_alone + 1


def _between_jumps(signal: Signal, speedometer: Signal | None, report: RecordingReport) -> Mask:
    """Samples of a pose between two jumps that follow each other closely, and beside a single jump: faster
    than ordinary motion and than the velocity or rate sensor says, where there is one.
    """
    good = np.flatnonzero(signal.good)
    result = np.zeros(len(signal.t), bool)
    if len(good) < 3:
        return result
    t, y = signal.t[good], signal.y[good]
    # Two samples that arrive together are a usual interval apart in truth.
    lasts, wide = np.maximum(np.diff(t), signal.step), _wide(signal, y)
    if signal.name == "attitude":
        y, _ = continuous(y)
        steps = 2.0 * product(conjugate(y[:-1]), y[1:])[:, 1:]
        speed = angle_between(y[:-1], y[1:]) / lasts
    else:
        steps = np.diff(y, axis=0)
        speed = np.linalg.norm(steps, axis=1) / lasts
    deviation = np.linalg.norm(_deviation(steps / lasts[:, None], 11), axis=1)
    # A jump stands out of the record's own motion and corrections, and of what the speed sensor shows there.
    threshold = max(
        10.0 * np.quantile(deviation, 0.95),
        3.0 * np.quantile(speed, 0.98),
        _corrections(steps, wide) / signal.step,
    )
    limit = np.maximum(threshold, SETTINGS.believed_speeds * _speed_near(speedometer, t[1:]))
    jump = np.flatnonzero((deviation > threshold) & (speed > limit))
    if speedometer is None:  # nothing else tells a fast motion from a wrong solution
        jump = np.array([at for at in jump.tolist() if _alone(speed, deviation, at)], int)
    if len(jump) == 0:
        return result
    starts = np.concatenate([[0], jump + 1])
    ends = np.concatenate([jump, [len(t) - 1]])
    for place, (start, end) in enumerate(zip(starts, ends, strict=True)):
        if t[end] - t[start] >= SETTINGS.longest_wrong_fix_s:
            continue
        # At an end of the record nothing tells on which side of the jump the pose is right.
        edge = start == 0 or end == len(t) - 1
        if edge or _wrong(steps, jump, place, t, wide):
            result[good[start : end + 1]] = True
    result[good[jump]] = result[good[jump + 1]] = True
    report.warning(
        "jumps",
        signal.label,
        count=len(jump),
        samples=int(result.sum()),
        apart_s=SETTINGS.longest_wrong_fix_s,
    )
    return result


def _wrong(steps: Array, jump: NDArray[np.intp], place: int, t: Array, wide: float) -> bool:
    """Whether the pose between jumps `place` - 1 and `place` is a wrong solution, alone or of several in a
    row: jumps beside it cancel, or are as wide as much of the record's motion, which no correction is.
    """
    size = np.linalg.norm(steps[jump], axis=1)
    if size[place - 1 : place + 1].max() > _CORRECTION.small * wide:
        return True
    for first in range(place - 1, -1, -1):
        if first < place - 1 and t[jump[first + 1]] - t[jump[first] + 1] > SETTINGS.longest_wrong_fix_s:
            return False
        for last in range(place, len(jump)):
            if t[jump[last]] - t[jump[last - 1] + 1] > SETTINGS.longest_wrong_fix_s:
                break
            left = float(np.linalg.norm(steps[jump[first : last + 1]].sum(axis=0)))
            if left < SETTINGS.cancelled_share * float(size[first : last + 1].max()):
                return True
    return False


def _speed_near(speedometer: Signal | None, t: Array) -> Array:
    """Highest speed (m,) that a sensor shows within a second of the times t, whatever signs and latency."""
    from scipy.ndimage import maximum_filter1d

    if speedometer is None or not speedometer.good.any():
        return np.zeros(len(t))
    good = speedometer.good
    width = 2 * round(1.0 / speedometer.step) + 1
    highest = maximum_filter1d(np.linalg.norm(speedometer.y[good], axis=1), width)
    return np.asarray(np.interp(t, speedometer.t[good], highest))


def _speed(signals: Mapping[str, Signal], name: str) -> tuple[Array, Array] | None:
    """Times (m,) and speeds (m, 3) that the pose shows for a velocity or rate sensor: body rates by axis; of
    a position, whose axes are not the body's, its speed for each. None without a pose.
    """
    pose = signals.get("attitude" if name == "rates" else "position")
    if pose is None or np.count_nonzero(pose.good) < _SPIKE.window:
        return None
    t, y = pose.t[pose.good], pose.y[pose.good]
    step = np.diff(t)[:, None]
    if name == "rates":
        turn = 2.0 * product(conjugate(y[:-1]), y[1:])
        return 0.5 * (t[1:] + t[:-1]), turn[:, 1:] * np.sign(turn[:, :1]) / step
    rate = np.diff(y, axis=0) / step
    if rate.shape[1] < 3:
        return None
    return 0.5 * (t[1:] + t[:-1]), np.repeat(np.linalg.norm(rate, axis=1)[:, None], 3, axis=1)


def _spikes(signal: Signal, shown: tuple[Array, Array] | None, report: RecordingReport) -> Mask:
    """Up to three samples in a row of a channel that stand alone, far out of their neighbourhood, (m, k).
    `shown`: times and speeds of the same motion by another sensor; what it shows too is no spike.
    """
    from scipy.ndimage import maximum_filter1d

    result = np.zeros(signal.bad.shape, bool)
    axes = "pqr" if signal.name == "rates" else "uvw"
    for k, channel in enumerate(signal.channels):
        good = np.flatnonzero(~signal.bad[:, k])
        if len(good) < _SPIKE.window:
            continue
        y = signal.y[good, k]
        deviation = _deviation(y[:, None], _SPIKE.window)[:, 0]
        far = deviation > max(_SPIKE.far * float(np.quantile(deviation, 0.95)), 1e-9)
        other = None if shown is None else (shown[0], shown[1][:, axes.index(channel[0])])
        for highest in np.flatnonzero(
            far & (deviation == maximum_filter1d(deviation, _SPIKE.window))
        ).tolist():
            start, stop = _extent(deviation, highest)
            if stop - start > _SPIKE.longest or not _alone(y, deviation, highest):
                continue
            if not _confirmed(other, signal.t[good[highest]], deviation[highest]):
                result[good[start:stop], k] = True
        report.warning("spikes", channel, count=int(result[:, k].sum()))
    return result


def _confirmed(shown: tuple[Array, Array] | None, t: float, size: float) -> bool:
    """Whether another sensor shows a motion of this size within a second of the time t, s."""
    if shown is None:
        return False
    times, speed = shown
    near = speed[np.searchsorted(times, t - 1.0) : np.searchsorted(times, t + 1.0)]
    if len(near) < _SPIKE.window // 2:
        return False
    moved = float(np.abs(near - np.median(near)).max())
    noise = float(np.median(np.abs(np.diff(speed))))
    return moved > max(_SPIKE.shown * size, _SPIKE.unusual * noise)


def _report_constant(signal: Signal, report: RecordingReport) -> None:
    if signal.name == "attitude":
        if np.ptp(signal.y, axis=0).max() == 0.0:
            report.warning("constant", "attitude")
            return
        euler = to_euler(signal.y[signal.good])
        for angle, value in stuck({name: euler[:, ANGLES.index(name)] for name in signal.channels}).items():
            report.warning("angle constant", angle, value=value)
        return
    good = signal.good
    for k, channel in enumerate(signal.channels):
        y = signal.y[good, k]
        if len(y) and np.ptp(y) == 0.0:
            report.warning("constant", channel, value=float(y[0]))


def stuck(angles: Mapping[str, Array]) -> dict[str, float]:
    """Angles in rad that never change while another one does, and their values; zeros, as of an angle that
    was not recorded, are none.

    >>> stuck({"roll": np.zeros(9), "pitch": np.full(9, 0.1), "yaw": np.arange(9.0)})
    {'pitch': 0.1}
    """
    still = {name: float(y[0]) for name, y in angles.items() if len(y) and np.ptp(y) <= SETTINGS.stuck_rad}
    if len(still) == len(angles):
        return {}
    return {name: value for name, value in still.items() if abs(value) > SETTINGS.stuck_rad}


def report_height(signals: Mapping[str, Signal], report: RecordingReport) -> None:
    """Report a vehicle that is above the surface for most of its record: a depth with the wrong sign."""
    for signal in (signals[name] for name in ("depth", "position") if name in signals):
        if "z" not in signal.channels:
            continue
        place = signal.channels.index("z")
        z = signal.y[~signal.bad[:, place], place]
        above = float(np.mean(z < -SETTINGS.above_surface_m)) if len(z) else 0.0
        if above > 0.5:
            report.warning("above the surface", "z", share=above, median_m=float(np.median(z)))


def _possible_pulses(signals: Mapping[str, Signal], report: RecordingReport) -> dict[str, Signal]:
    """Commands in pulse widths whose impossible samples, as of a flipped bit, hold the one before.
    Revolutions may lie in that range for long: all others must be pulse widths or zero, a damaged one alone.
    """
    mended = {}
    for name, signal in signals.items():
        y = signal.y[:, 0] if name.startswith("cmd.") else np.zeros(0)
        wrong = y > SETTINGS.longest_pulse_us
        if not wrong.any() or wrong.mean() > SETTINGS.damaged_share or (wrong[1:] & wrong[:-1]).any():
            continue
        usual = (y > SETTINGS.usual_pulses_us[0]) & (y < SETTINGS.usual_pulses_us[1])
        if not (usual | wrong | (y == 0.0)).all() or not usual.any():
            continue
        before = np.maximum.accumulate(np.where(wrong, -1, np.arange(len(y))))
        before[before < 0] = int(np.argmin(wrong))  # none before: the first possible one
        mended[name] = replace(signal, y=signal.y[before])
        longest = SETTINGS.longest_pulse_us
        report.warning("pulses too long", name, count=int(wrong.sum()), most_us=longest)
    return mended


def _report_commands(signals: Mapping[str, Signal], report: RecordingReport) -> None:
    """Actuators that never move, and commands that stay at the extremes of what was commanded."""
    still, limited = [], []
    inputs = {n.removeprefix("cmd."): signal.y[:, 0] for n, signal in signals.items() if n.startswith("cmd.")}
    for group in (group for group in GROUPS if group.name in ("force", "moment") and group.name in signals):
        for channel, y in zip(signals[group.name].channels, signals[group.name].y.T, strict=True):
            inputs[group.columns[group.channels.index(channel)]] = y
    for actuator, y in inputs.items():
        if np.ptp(y) == 0.0:
            if f"cmd.{actuator}" in signals:  # of a wrench some components are zero in most vehicles
                still.append(actuator)
            continue
        for extreme in (y.min(), y.max()):
            share = float(np.mean(y == extreme))
            if share > 0.02 and len(np.unique(y)) > 10:
                limited.append((actuator, float(extreme), share))
    if still:
        report.warning("commands constant", "commands", actuators=still)
    if limited:
        report.warning("commands at extremes", "commands", extremes=limited)
