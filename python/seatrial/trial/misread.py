"""Cells that mean something else than they say: a unit that changes within a channel, numbers for "no
sample".

*Units*: from one row on, values are as many times larger as two units differ. Another firmware, a logger
that was restarted or two tables pasted behind one another write the first part in deg/s and the second in
rad/s. Nothing else multiplies a channel: its value, its noise and its rounding all at once, from one sample
to the next, and no other sensor with it. Two signs are sought, each needs all of its conditions:

*the level*: a value away from zero jumps, in one sample, to a multiple that is a ratio of two units to within
3 %, and would have gone on smoothly without; the steps from sample to sample grow with it.

*the scale*, for a channel around zero (rates, sway) and factors of ten or more: first, second and third
differences all grow by the ratio to within 1.6, in the next dozen samples as in the next hundreds. A vehicle
that begins to move changes the first differences far more than the third, which are the sensor's noise.

Channels of one sensor agree: each has the change, or none of the signs of it. Other sensors that show the
motion go on as before; two sensors that change their units in the same row excuse one another. Held by
``tests/trial/test_unit_changes.py`` and, that no recording has one, by
``tests/intake/test_import_recordings.py``.

*Numbers for "no sample"*: loggers fill a cell without a sample with a code (-9999, 99999, 65535, the
largest number of a type, 1e30), or with that number in the unit of the column: 16 bits of mm/s end at
-32.768 m/s, which is how acoustic Doppler instruments write a velocity that they could not measure. Taken
as samples they are the largest motion of the log. A number is such a code where the other samples of its
column leave no doubt: it is a usual code and lies outside them by more than their own range; or it recurs
exactly, briefly, and lies ten ranges outside; or it recurs exactly as a lone excursion from which the
column returns to where it was, as a zero in a field that is never zero does. Commands and angles jump by
themselves, so that of them only codes outside of all others count. Held by
``tests/trial/test_sentinels.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.frames import to_euler
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


@dataclass(frozen=True)
class MisreadSettings:
    """Signs of a unit that changes within a channel, and of numbers that stand for no sample."""

    scale_alone_ratio: float = 10.0  #: ratios of units from here on show in the scale alone
    scale_samples: int = 200  #: samples on either side that tell a scale
    scale_samples_near: int = 12  #: samples on either side that tell a scale close to the change
    fewest_scale_samples: int = 30  #: fewer tell no scale over the long reach
    level_error: float = 0.03  #: relative error of a ratio of levels
    #: ordinary steps by which a level must jump, and by which it must be away from zero
    level_steps: float = 5.0
    gap_intervals: float = 5.0  #: intervals: across a longer one a vehicle may have moved anywhere
    together_samples: int = 5  #: samples between the changes of channels that are one
    most_candidates: int = 40  #: places of a channel that are looked at
    few_samples: int = 5  #: samples that tell a level, and differences that tell a scale
    #: relative error up to which a number is the end of a type: single precision keeps it to 6e-8
    code_rounding: float = 1e-6
    long_code: float = 9999.0  #: from here on a code is hardly a value that a human or an autopilot commands
    enormous: float = 1e15  #: no quantity of a vehicle is as large in any unit
    long_code_ranges: float = 1.0  #: a long code lies outside the other samples by so many of their ranges
    short_code_ranges: float = 3.0  #: a short code by so many
    any_code_ranges: float = 10.0  #: any number that recurs by so many
    fewest_times: int = 3  #: a number that recurs so often is a code without being a usual one
    excursion_steps: float = 20.0  #: usual steps of an excursion
    returned_share: float = 0.1  #: of an excursion: how near to the sample before it the one behind it is
    longest_excursion: int = 5  #: samples of a lone excursion
    #: of the samples: what is there for more than half of a record is no exception
    largest_share: float = 0.5
    enough_others: int = 10  #: other samples, that tell where the column lies


SETTINGS = MisreadSettings()


_SCALE, _NEAR_SCALE, _LOOSE = math.log(1.6), math.log(2.5), math.log(4.0)
"""Of the logarithm of a ratio of scales: over many samples, over few, and beside a level."""

_OTHERS = math.log(3.0)  # by which the scale of another sensor may change


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
        if fresh.sum() < 2 * SETTINGS.fewest_scale_samples:
            return None
        steps = np.diff(t)
        gaps = np.concatenate([[0], np.cumsum(steps > SETTINGS.gap_intervals * float(np.median(steps)))])[
            fresh
        ]
        return cls(sensor, name, t[fresh], y[fresh], np.concatenate([[True], np.diff(gaps) == 0]))

    @property
    def interval(self) -> float:
        """Usual interval, s."""
        return float(np.median(np.diff(self.t)))

    def scale(self, order: int, start: int, stop: int) -> float:
        """Mean logarithm of the differences of an order within the samples start to stop; NaN without any."""
        size = np.abs(np.diff(self.y[max(start, 0) : stop], order))
        moving = size > 1e-12 * float(np.abs(self.y[max(start, 0) : stop]).max(initial=0.0))
        return float(np.log(size[moving]).mean()) if moving.sum() >= SETTINGS.few_samples else math.nan

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

    ``factor`` is what the samples show, above one for larger.
    """

    sensor: str
    name: str
    at: int
    t: float
    interval: float
    ratio: float
    larger: bool
    factor: float

    def near(self, t: float, interval: float) -> bool:
        """Whether a time lies within some samples of the change."""
        return abs(self.t - t) <= SETTINGS.together_samples * max(self.interval, interval)


def report_unit_changes(signals: Mapping[str, Signal], time: Array, report: RecordingReport) -> None:
    """Report every change of a unit within a channel, with its row and time; nothing is converted.

    Signals are in SI as the column map says; `time` (m,) are the stamps of the rows, s.
    """
    changes = [change for channel in _channels(signals) for change in _candidates(channel)]
    if not changes:
        return
    # The other channels are made again: all of them at once would double the memory of a long log.
    for channel in _channels(signals):
        changes = [change for change in changes if _goes_on(channel, change, changes)]
    while changes:
        first = min(changes, key=lambda change: change.t)
        together = [
            change
            for change in changes
            if (change.sensor, change.ratio, change.larger) == (first.sensor, first.ratio, first.larger)
            and change.near(first.t, first.interval)
        ]
        row = int(np.searchsorted(time, first.t - 1e-9)) + 1
        names = " ".join(dict.fromkeys(change.name for change in together))
        report.error(
            "unit changes",
            names,
            row=row,
            t_s=first.t,
            factor=first.factor,
            larger=first.larger,
            units=_RATIOS[first.sensor][first.ratio],
            ratio=first.ratio,
        )
        changes = [change for change in changes if not any(change is other for other in together)]


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
            if (channel := _Channel.of(sensor, name, signal.t[good], y[good, k])) is not None:
                yield channel


def _candidates(channel: _Channel) -> Iterator[_Change]:
    """Changes that have the signs of one by themselves."""
    for at in sorted({*_jumps(channel), *_turns(channel)}):
        if not SETTINGS.scale_samples_near // 2 <= at <= len(channel.y) - SETTINGS.scale_samples_near // 2:
            continue
        level = _level(channel, at) if channel.unbroken[at] else None
        growths = [channel.growth(at, order, SETTINGS.scale_samples) for order in (1, 2, 3)]
        for ratio in _RATIOS[channel.sensor]:
            for factor in (ratio, 1.0 / ratio):
                # A scale that is not told, of a table without noise, contradicts no level.
                apart = [abs(growth - math.log(factor)) for growth in growths]
                if level is not None and abs(math.log(level / factor)) < SETTINGS.level_error:
                    loose = _LOOSE if ratio >= SETTINGS.scale_alone_ratio else _SCALE
                    seen = None if any(gap > loose for gap in apart) else level
                elif (
                    ratio >= SETTINGS.scale_alone_ratio
                    and all(gap < _SCALE for gap in apart)
                    and _sharp(channel, at, factor)
                ):
                    seen = math.exp(float(np.mean(growths)))
                else:
                    continue
                if seen is not None:
                    t = float(channel.t[at])
                    yield _Change(
                        channel.sensor, channel.name, at, t, channel.interval, ratio, factor > 1.0, seen
                    )


def _jumps(channel: _Channel) -> list[int]:
    """Samples that are reached by a step far larger than those around them."""
    logs, total = channel.steps()
    places = np.arange(len(logs))
    low, high = (
        np.maximum(places - SETTINGS.scale_samples_near, 0),
        np.minimum(places + 1 + SETTINGS.scale_samples_near, len(logs)),
    )
    before = (total[places] - total[low]) / np.maximum(places - low, 1)
    after = (total[high] - total[places + 1]) / np.maximum(high - places - 1, 1)
    large = np.flatnonzero(logs > np.maximum(before, after) + math.log(SETTINGS.level_steps))
    return [int(k) + 1 for k in large[np.argsort(-logs[large])][: SETTINGS.most_candidates]]


def _turns(channel: _Channel) -> list[int]:
    """Samples at which the scale of the steps changes most, by a factor of five or more."""
    _, total = channel.steps()
    last = len(channel.y) - 1
    places = np.arange(1, last)
    low, high = (
        np.maximum(places - SETTINGS.scale_samples, 0),
        np.minimum(places + SETTINGS.scale_samples, last),
    )
    # The step into a sample is the one between the units: it counts for neither side.
    before = (total[places - 1] - total[low]) / np.maximum(places - 1 - low, 1)
    after = (total[high] - total[places]) / np.maximum(high - places, 1)
    score = np.where(
        (places - low > SETTINGS.scale_samples_near) & (high - places >= SETTINGS.scale_samples_near),
        np.abs(after - before),
        0.0,
    )
    turns: list[int] = []
    while len(turns) < SETTINGS.most_candidates and score.max(initial=0.0) > math.log(SETTINGS.level_steps):
        at = int(score.argmax())
        turns.append(_sharpest(total, int(places[at])))
        score[max(at - SETTINGS.scale_samples, 0) : at + SETTINGS.scale_samples] = 0.0
    return turns


def _sharpest(total: Array, at: int) -> int:
    """Sample near `at` that best parts large steps from small ones, by the scatter of their logarithms;
    ``total`` (n,) is their cumulated sum.
    """
    last = len(total) - 1
    low, high = max(at - SETTINGS.scale_samples // 4, 2), min(at + SETTINGS.scale_samples // 4, last - 1)
    start, stop = max(low - SETTINGS.scale_samples, 0), min(high + SETTINGS.scale_samples, last)
    places = np.arange(low, high)
    sums = total[places - 1] - total[start], total[stop] - total[places]
    parted = sums[0] ** 2 / np.maximum(places - 1 - start, 1) + sums[1] ** 2 / np.maximum(stop - places, 1)
    return int(places[parted.argmax()])


def _level(channel: _Channel, at: int) -> float | None:
    """Ratio of the levels where a value away from zero jumps to a multiple; None where none does."""
    before, after = channel.y[at - SETTINGS.few_samples : at], channel.y[at : at + SETTINGS.few_samples]
    # Straight lines through the samples on both sides, met half way: a vehicle moves on meanwhile.
    x = np.arange(SETTINGS.few_samples)
    left = float(np.polyval(np.polyfit(x, before, 1), SETTINGS.few_samples - 0.5))
    right = float(np.polyval(np.polyfit(x, after, 1), -0.5))
    if left * right <= 0.0:
        return None
    ratio = right / left
    scale = channel.scale(1, at - SETTINGS.scale_samples, at)
    usual = math.exp(scale) if scale == scale else 0.0
    if (
        min(abs(float(np.median(before))), abs(float(np.median(after))) / ratio)
        < 4.0 * SETTINGS.level_steps * usual
    ):
        return None
    return (
        ratio
        if abs(channel.y[at] - channel.y[at - 1]) > SETTINGS.level_steps * usual * max(1.0, ratio)
        else None
    )


def _sharp(channel: _Channel, at: int, factor: float) -> bool:
    """Whether few samples on both sides show the factor, too, and the value goes on without it."""
    if min(at, len(channel.y) - at) < SETTINGS.fewest_scale_samples:
        return False
    near = (channel.growth(at, order, SETTINGS.scale_samples_near) for order in (1, 3))
    if not all(abs(growth - math.log(factor)) < _NEAR_SCALE for growth in near):
        return False
    usual = math.exp(channel.scale(1, at - SETTINGS.scale_samples, at))
    return (
        not channel.unbroken[at]
        or abs(channel.y[at] / factor - channel.y[at - 1]) < 4.0 * SETTINGS.level_steps * usual
    )


def _goes_on(other: _Channel, change: _Change, changes: list[_Change]) -> bool:
    """Whether a channel goes on as before across a change of another one, or changes with it."""
    for another in changes:
        # A sensor that changes its own unit there excuses all of its channels, those of the same sensor none.
        alike = another.sensor == other.sensor and (
            another.sensor != change.sensor or another.name == other.name
        )
        if alike and another.near(change.t, change.interval):
            return True
    growth = other.growth(int(np.searchsorted(other.t, change.t)), 3, SETTINGS.scale_samples)
    goal = math.log(change.ratio) * (1.0 if change.larger else -1.0)
    if growth != growth:
        return True
    if other.sensor == change.sensor and abs(growth - goal) < min(_OTHERS, 0.5 * abs(goal)):
        return True  # a component that changes with it, and has no level by which to know the ratio
    return abs(growth) <= min(_OTHERS, 0.7 * abs(goal))


# The largest and smallest integers of 16 to 64 bits.
_INTEGERS = tuple(
    float(value) for bits in (16, 32, 64) for value in (2**bits - 1, 2 ** (bits - 1) - 1, 2 ** (bits - 1))
)
# -999.25: well logs
_NINES = (99.0, 99.9, 99.99, 999.0, 999.25, 999.9, 999.99, 9999.0, 9999.25, 9999.9, 9999.99, 99999.0)
_CODES = np.array(sorted({*_NINES, *_INTEGERS, 99999.99, 999999.0, 9999999.0}))  # usual ones
# The ends of an integer type, written in units of its last digit: tenths to ten thousandths, and 1e-7 deg.
_SCALED = np.unique([value * unit for value in _INTEGERS for unit in (1e-1, 1e-2, 1e-3, 1e-4, 1e-7)])
_SCALED = _SCALED[_SCALED > 1.0]  # smaller ones are ordinary values


@dataclass(frozen=True)
class Sentinel:
    """A number that stands for no sample, and at which samples (m,) it does."""

    value: float
    at: Mask

    @property
    def count(self) -> int:
        """How many samples it stands at."""
        return int(self.at.sum())


def sentinels(y: Array, *, jumps: bool = False) -> list[Sentinel]:
    """Numbers of a column that stand for no sample, in the order of their number. Cells (m,) are as recorded,
    NaN where there is none. `jumps`: whether the column jumps and returns by itself, as commands and angles
    do.

    >>> y = 15.0 + np.sin(np.arange(50.0))
    >>> y[[7, 30, 31]] = -9999.0
    >>> [(one.value, one.count) for one in sentinels(y)]
    [(-9999.0, 3)]
    """
    known = np.isfinite(y)
    if known.sum() < SETTINGS.enough_others:
        return []
    values, counts = np.unique(y[known], return_counts=True)
    wrong = _outside(values, counts, jumps=jumps)
    codes = [Sentinel(float(value), y == value) for value in values[wrong]]
    rest = np.isfinite(y) & ~np.isin(y, values[wrong])
    resting = rest.any() and np.ptp(y[rest]) == 0.0
    # Beside a column that rests, and of a number that is no usual code, only brief fills are sure.
    codes = [
        code
        for code in codes
        if (_is_code(np.abs([code.value]))[0] and not resting) or _brief(code.at[known])
    ]
    if not jumps:
        codes += _excursions(np.where(rest, y, np.nan), values[(counts >= SETTINGS.fewest_times) & ~wrong])
    return sorted(codes, key=lambda code: -code.count)


def _is_code(size: Array) -> Mask:
    """Which numbers without their sign (k,) are usual codes."""
    place = np.clip(np.searchsorted(_SCALED, size), 1, len(_SCALED) - 1)
    away = np.minimum(np.abs(_SCALED[place] - size), np.abs(_SCALED[place - 1] - size))
    usual = np.isin(np.round(size, 2), np.round(_CODES, 2)) | (size > SETTINGS.enormous)
    return np.asarray(usual | (away <= SETTINGS.code_rounding * size))


def _brief(at: Mask) -> bool:
    """Whether a value stands for few samples at a time."""
    return float(np.mean([stop - start for start, stop in runs(at)])) <= SETTINGS.longest_excursion / 2.0


def _outside(values: Array, counts: NDArray[np.int_], *, jumps: bool) -> Mask:
    """Which of the distinct `values` (k,), rising, are codes that lie outside of all others."""
    size = np.abs(values)
    code = _is_code(size)
    least = np.where(size >= SETTINGS.long_code, SETTINGS.long_code_ranges, SETTINGS.short_code_ranges)
    wrong = np.zeros(len(values), bool)
    total = float(counts.sum())
    while True:
        # From the outside inwards: the lowest and highest value left, against the rest without codes.
        left = np.flatnonzero(~wrong)
        core = values[~wrong & ~code]
        if not len(core):
            return np.zeros(len(values), bool) if code.all() else wrong
        changed = False
        for end in {int(left[0]), int(left[-1])}:
            rest = core[core != values[end]]
            if not len(rest) or counts[wrong].sum() + counts[end] > SETTINGS.largest_share * total:
                continue
            width, apart = float(np.ptp(rest)), float(np.abs(rest - values[end]).min())
            # A column that rests has no range: its own size tells the scale.
            width = width if width > 0.0 else 0.1 * abs(float(rest[0]))
            enough = apart > (least[end] if code[end] else SETTINGS.any_code_ranges) * width
            if enough and apart > 0.0 and (code[end] or (counts[end] >= SETTINGS.fewest_times and not jumps)):
                wrong[end] = changed = True
        if not changed:
            return wrong


def _excursions(y: Array, values: Array) -> list[Sentinel]:
    """Values that recur as lone excursions of a column (m,), NaN where there is no sample."""
    index = np.flatnonzero(np.isfinite(y))
    x = y[index]
    steps = np.abs(np.diff(x))
    usual = float(np.quantile(steps, 0.75)) if len(steps) else 0.0
    # All runs of equal samples at once: a pass over the column for each of its values would be quadratic.
    starts = np.flatnonzero(np.append(True, x[1:] != x[:-1])) if len(x) else np.empty(0, np.intp)
    stops = np.append(starts[1:], len(x))[: len(starts)]
    place = np.minimum(np.searchsorted(values, x[starts]), len(values) - 1)
    asked = values[place] == x[starts] if len(values) else np.zeros(len(starts), bool)
    starts, stops, place = starts[asked], stops[asked], place[asked]
    counts = np.bincount(place, stops - starts, len(values))
    inside = (starts > 0) & (stops < len(x)) & (stops - starts <= SETTINGS.longest_excursion)
    starts, stops, place = starts[inside], stops[inside], place[inside]
    before, after, own = x[starts - 1], x[stops], x[starts]
    tall = np.minimum(np.abs(before - own), np.abs(after - own))
    lone = (tall > SETTINGS.excursion_steps * usual) & (
        np.abs(after - before) < SETTINGS.returned_share * tall
    )
    # Nearly every time: a number that the column also passes through is one of its own.
    share = np.bincount(place[lone], (stops - starts)[lone], len(values)) >= 0.8 * counts
    often = np.bincount(place[lone], minlength=len(values)) >= SETTINGS.fewest_times
    codes = []
    for k in np.flatnonzero(often & share & (counts <= SETTINGS.largest_share * len(x))):
        samples = np.zeros(len(y), bool)
        for run in np.flatnonzero(lone & (place == k)):
            samples[index[starts[run] : stops[run]]] = True
        codes.append(Sentinel(float(values[k]), samples))
    return codes
