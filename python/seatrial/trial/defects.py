"""Defects of sensors found from their samples alone: frozen, jumping, spiking, constant, saturated.

A sample found bad is masked; nothing is put in its place. Thresholds are relative to the record's own
ordinary motion (its 95th and 98th percentiles), so that no vehicle's size or speed is assumed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.rotation import angle_between, conjugate, continuous, product
from seatrial.trial.signals import RecordingReport, Signal

__all__ = ["mark"]

_MEASURED = ("position", "depth", "attitude", "velocity", "water velocity", "rates")

_TRUSTED_AFTER_S = 5.0
"""A pose between two jumps less than this apart is taken for a wrong solution of the positioning system."""

_BELIEVED = 3.0  # a pose may move this many times faster than its speed sensor says

_ROUNDED_SHARE = 0.01  # a rounded sensor repeats single channels in more than this share of its samples

_CHANCE = 3  # repeats in a row of a depth of its own stamps that mean nothing

# A slower sensor written at the table's rate repeats at least this share of its samples, in many short runs.
_HELD_SHARE, _HELD_RUNS = 0.05, 20


def mark(signals: Mapping[str, Signal], report: RecordingReport) -> dict[str, Signal]:
    """The same signals with bad samples marked, every kind of defect reported."""
    marked = dict(signals)
    measured = [name for name in _MEASURED if name in signals]
    repeated = {name: _repeats(signals[name].y) for name in measured}
    frozen: dict[str, Mask] = {}
    for name in measured:
        signal = signals[name]
        peers = [repeated[other] for other in measured if np.array_equal(signals[other].t, signal.t)]
        at_rest = np.logical_and.reduce(peers) if len(peers) > 1 else repeated[name]
        frozen[name] = _frozen(signal, repeated[name], at_rest, report)
        marked[name] = signal.masked(frozen[name])
    for name, speedometer in (("position", "velocity"), ("depth", "velocity"), ("attitude", "rates")):
        if name in marked:
            jumps = _between_jumps(marked[name], signals.get(speedometer), report)
            marked[name] = marked[name].masked(jumps)
    if "position" in marked and "attitude" in marked and _one_sensor(frozen):
        marked["position"] = marked["position"].masked(~marked["attitude"].good)
        marked["attitude"] = marked["attitude"].masked(~marked["position"].good)
    for name in ("velocity", "water velocity", "rates"):
        if name in marked:
            marked[name] = marked[name].masked(_spikes(marked[name], report))
    for name in measured:
        _report_constant(signals[name], report)
    _report_commands(signals, report)
    return marked


def _one_sensor(frozen: Mapping[str, Mask]) -> bool:
    """Whether position and attitude drop out together, as those of one positioning system do."""
    position, attitude = frozen["position"], frozen["attitude"]
    return bool(position.any()) and np.array_equal(position, attitude)


def _repeats(y: Array) -> Mask:
    same = np.all((y[1:] == y[:-1]) | (np.isnan(y[1:]) & np.isnan(y[:-1])), axis=1)
    return np.concatenate([[False], same])


def _runs(mask: Mask) -> Iterator[tuple[int, int]]:
    """Start and end (exclusive) of every run of marked samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _frozen(signal: Signal, repeated: Mask, at_rest: Mask, report: RecordingReport) -> Mask:
    """Samples that repeat the one before although the vehicle moves: a jump ends them or noise ceases.

    A sensor has noise if its channels never repeat one without the other, as rounded or simulated ones do.
    While every sensor repeats, or from the first sample on, the vehicle is at rest in a record without noise.
    """
    result = np.zeros(len(repeated), bool)
    runs = list(_runs(repeated))
    if not runs:
        return result
    lengths = np.array([stop - start for start, stop in runs])
    usual = 0
    if len(runs) >= _HELD_RUNS and repeated.mean() > _HELD_SHARE:
        usual = 3 * int(np.quantile(lengths, 0.9))
        moves = 1.0 - repeated.mean()
        if 0.2 < moves < 1.0:
            report.add(
                "info",
                signal.name,
                "samples repeat the one before: "
                f"a sensor of about {moves / signal.step:.2g} Hz in a table of {1.0 / signal.step:.3g} Hz",
                int(repeated.sum()),
            )
    # A sensor with noise never repeats one channel alone; a rounded or simulated one does.
    alone = np.any(signal.y[1:] == signal.y[:-1], axis=1) & ~repeated[1:]
    noisy = signal.y.shape[1] > 1 and alone.mean() < _ROUNDED_SHARE
    increment = np.linalg.norm(np.diff(signal.y, axis=0), axis=1)
    ordinary = float(np.nanmedian(increment[increment > 0.0])) if (increment > 0.0).any() else 0.0
    # Rounded samples of a pressure cell repeat by chance, a drop-out is longer than that.
    if signal.name == "depth":
        usual = max(usual, _CHANCE)
    events = 0
    for start, stop in runs:
        jumps = stop < len(repeated) and increment[stop - 1] > 3.0 * ordinary
        moving = noisy and start > 1 and not at_rest[start:stop].all()
        if stop - start > usual and (jumps or moving):
            result[start:stop] = True
            events += 1
    plural = "" if events == 1 else "s"
    report.add(
        "warning", signal.name, f"frozen samples in {events} drop-out{plural}; masked", int(result.sum())
    )
    return result


def _deviation(y: Array, window: int) -> Array:
    """Distance of each row from the running median of its neighbourhood, shape (m,)."""
    from scipy.ndimage import median_filter

    centre = median_filter(y, size=(window, 1), mode="nearest")
    return np.asarray(np.linalg.norm(y - centre, axis=1))


def _between_jumps(signal: Signal, speedometer: Signal | None, report: RecordingReport) -> Mask:
    """Samples of a pose between two jumps that follow each other closely, and those beside a single jump.

    A jump is faster than ordinary motion and than the velocity or rate sensor says, where there is one.
    """
    good = np.flatnonzero(signal.good)
    result = np.zeros(len(signal.t), bool)
    if len(good) < 3:
        return result
    t, y = signal.t[good], signal.y[good]
    if signal.name == "attitude":
        y, _ = continuous(y)
        turn = 2.0 * product(conjugate(y[:-1]), y[1:])[:, 1:]
        speed = angle_between(y[:-1], y[1:]) / np.diff(t)
        rate = turn / np.diff(t)[:, None]
    else:
        rate = np.diff(y, axis=0) / np.diff(t)[:, None]
        speed = np.linalg.norm(rate, axis=1)
    deviation = _deviation(rate, 11)
    # A jump stands out of the record's own motion, and of what the speed sensor shows there.
    threshold = max(10.0 * np.quantile(deviation, 0.95), 3.0 * np.quantile(speed, 0.98))
    limit = np.maximum(threshold, _BELIEVED * _speed_near(speedometer, t[1:]))
    jump = np.flatnonzero((deviation > threshold) & (speed > limit))
    if len(jump) == 0:
        return result
    starts = np.concatenate([[0], jump + 1])
    ends = np.concatenate([jump, [len(t) - 1]])
    for start, end in zip(starts, ends, strict=True):
        whole = start == 0 and end == len(t) - 1
        if not whole and t[end] - t[start] < _TRUSTED_AFTER_S:
            result[good[start : end + 1]] = True
    result[good[jump]] = result[good[jump + 1]] = True
    report.add(
        "warning",
        signal.name,
        f"jumps faster than any ordinary motion; {int(result.sum())} samples beside them, "
        f"or between two less than {_TRUSTED_AFTER_S:g} s apart, masked",
        len(jump),
    )
    return result


def _speed_near(speedometer: Signal | None, t: Array) -> Array:
    """Highest speed (m,) that a sensor shows within a second of the times t, whatever signs and latency."""
    from scipy.ndimage import maximum_filter1d

    if speedometer is None or not speedometer.good.any():
        return np.zeros(len(t))
    good = speedometer.good
    width = 2 * round(1.0 / speedometer.step) + 1
    highest = maximum_filter1d(np.linalg.norm(speedometer.y[good], axis=1), width)
    return np.asarray(np.interp(t, speedometer.t[good], highest))


def _spikes(signal: Signal, report: RecordingReport) -> Mask:
    """Up to three samples in a row that stand far out of their neighbourhood."""
    good = np.flatnonzero(signal.good)
    result = np.zeros(len(signal.t), bool)
    if len(good) < 7:
        return result
    y = signal.y[good]
    deviation = _deviation(y, 7)
    size = np.linalg.norm(y - np.median(y, axis=0), axis=1)
    far = deviation > max(10.0 * np.quantile(deviation, 0.95), float(np.quantile(size, 0.98)), 1e-9)
    for start, stop in _runs(far):
        if stop - start <= 3:
            result[good[start:stop]] = True
    report.add("warning", signal.name, "spikes masked", int(result.sum()))
    return result


def _report_constant(signal: Signal, report: RecordingReport) -> None:
    if signal.name == "attitude":
        if np.ptp(signal.y, axis=0).max() == 0.0:
            report.add("warning", "attitude", "constant over the whole recording; a sensor that is off?")
        return
    good = signal.good
    for k, channel in enumerate(signal.channels):
        y = signal.y[good, k]
        if len(y) and np.ptp(y) == 0.0:
            report.add(
                "warning", channel, f"constant at {y[0]:.6g} over the whole recording; a sensor that is off?"
            )


def _report_commands(signals: Mapping[str, Signal], report: RecordingReport) -> None:
    """Actuators that never move, and those that stay at the extremes of what was commanded."""
    still, limited = [], []
    for name, signal in signals.items():
        if not name.startswith("cmd."):
            continue
        y = signal.y[:, 0]
        actuator = name.removeprefix("cmd.")
        if np.ptp(y) == 0.0:
            still.append(actuator)
            continue
        for extreme in (y.min(), y.max()):
            share = float(np.mean(y == extreme))
            if share > 0.02 and len(np.unique(y)) > 10:
                limited.append(f"{actuator} {extreme:.6g} ({100.0 * share:.0f} %)")
    if still:
        report.add(
            "warning",
            "commands",
            f"never change, so nothing about them can be identified: {', '.join(still)}",
        )
    if limited:
        report.add(
            "warning", "commands", f"stay at their extreme values, perhaps saturated: {', '.join(limited)}"
        )
