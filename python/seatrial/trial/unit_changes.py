"""A unit that changes within a channel: from one row on, values are as many times larger as two units differ.

Another firmware, a logger that was restarted or two tables pasted behind one another write the first part in
deg/s and the second in rad/s. Nothing else multiplies a channel: its value, its noise and its rounding all at
once, from one sample to the next, and no other sensor with it. Two signs are sought, each needs all of its
conditions:

*the level*: a value away from zero jumps, in one sample, to a multiple that is a ratio of two units to within
3 %, and would have gone on smoothly without; the steps from sample to sample grow with it.

*the scale*, for a channel around zero (rates, sway) and factors of ten or more: first, second and third
differences all grow by the ratio to within 1.6, in the next dozen samples as in the next hundreds. A vehicle
that begins to move changes the first differences far more than the third, which are the sensor's noise.

Channels of one sensor agree: each has the change, or none of the signs of it. Other sensors that show the
motion go on as before; two sensors that change their units in the same row excuse one another. Held by
``tests/trial/test_unit_changes.py`` and, that no recording has one, by
``tests/intake/test_import_recordings.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.rotation import to_euler
from seatrial.trial.signals import RecordingReport, Signal

_LENGTHS = {1000.0: ("m", "mm"), 100.0: ("m", "cm"), 3.28084: ("m", "ft")}

_SPEEDS = {
    1000.0: ("m/s", "mm/s"),
    100.0: ("m/s", "cm/s"),
    3.6: ("m/s", "km/h"),
    3.28084: ("m/s", "ft/s"),
    1.943844: ("m/s", "kn"),
}

_RATIOS: dict[str, dict[float, tuple[str, str]]] = {
    "position": _LENGTHS,
    "depth": _LENGTHS,
    "attitude": {180.0 / math.pi: ("rad", "deg")},
    "velocity": _SPEEDS,
    "water velocity": _SPEEDS,
    "rates": {180.0 / math.pi: ("rad/s", "deg/s")},
}
"""By sensor the ratios of units, with the unit before and after a jump upwards."""

_LARGE = 10.0  # ratios from here on show in the scale alone

_LONG, _SHORT, _FEWEST = 200, 12, 30  # samples on either side that tell a scale, and the least of them

_LEVEL = 0.03  # relative error of a ratio of levels

_STEP = 5.0  # ordinary steps by which a level must jump, and from which zero is away

_SCALE, _NEAR_SCALE, _LOOSE = math.log(1.6), math.log(2.5), math.log(4.0)
"""Of the logarithm of a ratio of scales: over many samples, over few, and beside a level."""

_OTHERS = math.log(3.0)  # by which the scale of another sensor may change

_GAP = 5.0  # intervals: across a longer one a vehicle may have moved anywhere

_TOGETHER = 5  # samples between the changes of channels that are one

_MOST = 40  # candidates of a channel

_FEW = 5  # samples that tell a level, and differences that tell a scale


@dataclass(frozen=True)
class _Channel:
    """Distinct samples `y` (n,) of a channel at times `t` (n,).

    ``unbroken`` (n,): whether no gap lies before a sample.
    """

    sensor: str
    name: str
    t: Array
    y: Array
    unbroken: Mask

    @classmethod
    def of(cls, sensor: str, name: str, t: Array, y: Array) -> _Channel | None:
        """None with too few samples for a scale on either side."""
        # A slow sensor in a fast table repeats its samples: only new ones tell.
        fresh = np.concatenate([[True], np.diff(y) != 0.0])
        if fresh.sum() < 2 * _FEWEST:
            return None
        steps = np.diff(t)
        gaps = np.concatenate([[0], np.cumsum(steps > _GAP * float(np.median(steps)))])[fresh]
        return cls(sensor, name, t[fresh], y[fresh], np.concatenate([[True], np.diff(gaps) == 0]))

    @property
    def interval(self) -> float:
        """Usual interval, s."""
        return float(np.median(np.diff(self.t)))

    def scale(self, order: int, start: int, stop: int) -> float:
        """Mean logarithm of the differences of an order within the samples start to stop; NaN without any."""
        size = np.abs(np.diff(self.y[max(start, 0) : stop], order))
        told = size > 1e-12 * float(np.abs(self.y[max(start, 0) : stop]).max(initial=0.0))
        return float(np.log(size[told]).mean()) if told.sum() >= _FEW else math.nan

    def growth(self, at: int, order: int, width: int) -> float:
        """Logarithm of the scale from sample `at` on over the scale before it; NaN where it is not told."""
        return self.scale(order, at, at + width) - self.scale(order, at - width, at)

    def steps(self) -> tuple[Array, Array]:
        """Logarithms (n-1,) of the steps from sample to sample, and their cumulated sum (n,)."""
        logs = np.log(np.abs(np.diff(self.y)))
        return logs, np.concatenate([[0.0], np.cumsum(logs)])


@dataclass(frozen=True)
class _Change:
    """From sample `at` (time `t`) of a channel on, values are larger or smaller by the ratio of two units.

    ``found`` is the factor as seen, above one for larger.
    """

    sensor: str
    name: str
    at: int
    t: float
    interval: float
    ratio: float
    larger: bool
    found: float

    def near(self, t: float, interval: float) -> bool:
        """Whether a time lies within some samples of the change."""
        return abs(self.t - t) <= _TOGETHER * max(self.interval, interval)


def report_unit_changes(signals: Mapping[str, Signal], time: Array, report: RecordingReport) -> None:
    """Report every change of a unit within a channel, with its row and time; nothing is converted.

    Parameters
    ----------
    signals
        By sensor, in SI as the column map says.
    time : ndarray, shape (m,)
        Stamps of the rows, s.
    report : RecordingReport
    """
    found = [change for one in _channels(signals) for change in _candidates(one)]
    if not found:
        return
    # The other channels are made again: all of them at once would double the memory of a long log.
    for one in _channels(signals):
        found = [change for change in found if _goes_on(one, change, found)]
    while found:
        first = min(found, key=lambda change: change.t)
        together = [
            one
            for one in found
            if (one.sensor, one.ratio, one.larger) == (first.sensor, first.ratio, first.larger)
            and one.near(first.t, first.interval)
        ]
        row = int(np.searchsorted(time, first.t - 1e-9)) + 1
        names = " ".join(dict.fromkeys(one.name for one in together))
        report.add("error", names, _sentence(first, row, len(names.split())))
        found = [one for one in found if not any(one is told for told in together)]


def _sentence(change: _Change, row: int, count: int) -> str:
    """What changes where, and what to do."""
    units = _RATIOS[change.sensor][change.ratio]
    before, after = units if change.larger else units[::-1]
    word, found = ("larger", change.found) if change.larger else ("smaller", 1.0 / change.found)
    return (
        f"the unit changes within the channel{'s' if count > 1 else ''}: from row {row} (t ="
        f" {change.t:.6g} s) on, values are {found:.3g} times {word}, as {after} after {before} would be"
        f" ({change.ratio:.4g} times); convert one part, or cut the recording there into two trials, each"
        " with its unit"
    )


def _channels(signals: Mapping[str, Signal]) -> Iterator[_Channel]:
    """Channels of all sensors, one after the other; an attitude as roll, pitch and yaw."""
    for sensor in _RATIOS:
        if (signal := signals.get(sensor)) is None or not signal.good.any():
            continue
        names, y, bad = signal.channels, signal.y, signal.bad
        if sensor == "attitude":
            names, y = ("roll", "pitch", "yaw"), np.full((len(signal.t), 3), np.nan)
            y[signal.good] = np.unwrap(to_euler(signal.y[signal.good]), axis=0)
            bad = np.repeat(~signal.good[:, None], 3, axis=1)
        for k, name in enumerate(names):
            good = ~bad[:, k] & np.isfinite(y[:, k])
            if (one := _Channel.of(sensor, name, signal.t[good], y[good, k])) is not None:
                yield one


def _candidates(one: _Channel) -> Iterator[_Change]:
    """Changes that have the signs of one by themselves."""
    for at in sorted({*_jumps(one), *_turns(one)}):
        if not _SHORT // 2 <= at <= len(one.y) - _SHORT // 2:
            continue
        level = _level(one, at) if one.unbroken[at] else None
        growths = [one.growth(at, order, _LONG) for order in (1, 2, 3)]
        for ratio in _RATIOS[one.sensor]:
            for factor in (ratio, 1.0 / ratio):
                # A scale that is not told, of a table without noise, contradicts no level.
                apart = [abs(growth - math.log(factor)) for growth in growths]
                if level is not None and abs(math.log(level / factor)) < _LEVEL:
                    loose = _LOOSE if ratio >= _LARGE else _SCALE
                    found = None if any(gap > loose for gap in apart) else level
                elif ratio >= _LARGE and all(gap < _SCALE for gap in apart) and _sharp(one, at, factor):
                    found = math.exp(float(np.mean(growths)))
                else:
                    continue
                if found is not None:
                    t = float(one.t[at])
                    yield _Change(one.sensor, one.name, at, t, one.interval, ratio, factor > 1.0, found)


def _jumps(one: _Channel) -> list[int]:
    """Samples that are reached by a step far larger than those around them."""
    logs, total = one.steps()
    places = np.arange(len(logs))
    low, high = np.maximum(places - _SHORT, 0), np.minimum(places + 1 + _SHORT, len(logs))
    before = (total[places] - total[low]) / np.maximum(places - low, 1)
    after = (total[high] - total[places + 1]) / np.maximum(high - places - 1, 1)
    large = np.flatnonzero(logs > np.maximum(before, after) + math.log(_STEP))
    return [int(k) + 1 for k in large[np.argsort(-logs[large])][:_MOST]]


def _turns(one: _Channel) -> list[int]:
    """Samples at which the scale of the steps changes most, by a factor of five or more."""
    _, total = one.steps()
    last = len(one.y) - 1
    places = np.arange(1, last)
    low, high = np.maximum(places - _LONG, 0), np.minimum(places + _LONG, last)
    # The step into a sample is the one between the units: it counts for neither side.
    before = (total[places - 1] - total[low]) / np.maximum(places - 1 - low, 1)
    after = (total[high] - total[places]) / np.maximum(high - places, 1)
    score = np.where((places - low > _SHORT) & (high - places >= _SHORT), np.abs(after - before), 0.0)
    found: list[int] = []
    while len(found) < _MOST and score.max(initial=0.0) > math.log(_STEP):
        at = int(score.argmax())
        found.append(_sharpest(total, int(places[at])))
        score[max(at - _LONG, 0) : at + _LONG] = 0.0
    return found


def _sharpest(total: Array, at: int) -> int:
    """Sample near `at` that best parts large steps from small ones: least scatter of their logarithms.

    ``total`` (n,): cumulated logarithms of the steps.
    """
    last = len(total) - 1
    low, high = max(at - _LONG // 4, 2), min(at + _LONG // 4, last - 1)
    start, stop = max(low - _LONG, 0), min(high + _LONG, last)
    places = np.arange(low, high)
    sums = total[places - 1] - total[start], total[stop] - total[places]
    parted = sums[0] ** 2 / np.maximum(places - 1 - start, 1) + sums[1] ** 2 / np.maximum(stop - places, 1)
    return int(places[parted.argmax()])


def _level(one: _Channel, at: int) -> float | None:
    """Ratio of the levels where a value away from zero jumps to a multiple; None where none does."""
    before, after = one.y[at - _FEW : at], one.y[at : at + _FEW]
    # Straight lines through the samples on both sides, met half way: a vehicle moves on meanwhile.
    x = np.arange(_FEW)
    left = float(np.polyval(np.polyfit(x, before, 1), _FEW - 0.5))
    right = float(np.polyval(np.polyfit(x, after, 1), -0.5))
    if left * right <= 0.0:
        return None
    found = right / left
    scale = one.scale(1, at - _LONG, at)
    usual = math.exp(scale) if scale == scale else 0.0
    if min(abs(float(np.median(before))), abs(float(np.median(after))) / found) < 4.0 * _STEP * usual:
        return None
    return found if abs(one.y[at] - one.y[at - 1]) > _STEP * usual * max(1.0, found) else None


def _sharp(one: _Channel, at: int, factor: float) -> bool:
    """Whether few samples on both sides show the factor, too, and the value goes on without it."""
    if min(at, len(one.y) - at) < _FEWEST:
        return False
    near = (one.growth(at, order, _SHORT) for order in (1, 3))
    if not all(abs(growth - math.log(factor)) < _NEAR_SCALE for growth in near):
        return False
    usual = math.exp(one.scale(1, at - _LONG, at))
    return not one.unbroken[at] or abs(one.y[at] / factor - one.y[at - 1]) < 4.0 * _STEP * usual


def _goes_on(other: _Channel, change: _Change, found: list[_Change]) -> bool:
    """Whether a channel goes on as before across a change of another one, or changes with it."""
    for one in found:
        # A sensor that changes its own unit there excuses all of its channels, those of the same sensor none.
        alike = one.sensor == other.sensor and (one.sensor != change.sensor or one.name == other.name)
        if alike and one.near(change.t, change.interval):
            return True
    growth = other.growth(int(np.searchsorted(other.t, change.t)), 3, _LONG)
    goal = math.log(change.ratio) * (1.0 if change.larger else -1.0)
    if growth != growth:
        return True
    if other.sensor == change.sensor and abs(growth - goal) < min(_OTHERS, 0.5 * abs(goal)):
        return True  # a component that changes with it, and has no level by which to know the ratio
    return abs(growth) <= min(_OTHERS, 0.7 * abs(goal))
