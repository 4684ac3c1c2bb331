"""Numbers that stand for "no sample" in a recording: written codes, and values that recur where none can be.

Loggers fill a cell without a sample with a code (-9999, 99999, 65535, the largest number of a type, 1e30), or
with that number in the unit of the column: 16 bits of mm/s end at -32.768 m/s, which is how acoustic Doppler
instruments write a velocity that they could not measure.
Taken as samples they are the largest motion of the log. A number is such a code where the other samples of
its column leave no doubt: it is a usual code and lies outside them by more than their own range; or it recurs
exactly, briefly, and lies ten ranges outside; or it recurs exactly as a lone excursion from which the column
returns to where it was, as a zero in a field that is never zero does. Commands and angles jump by themselves,
so that of them only codes outside of all others count. Held by ``tests/trial/test_sentinels.py``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask, runs

NO_SAMPLE = "stand for no sample"
"""What is said of a number that is a code."""

NO_SAMPLE_WORDS = frozenset({
    *(
        "",
        "-",
        "--",
        "---",
        "n/a",
        "na",
        "#n/a",
        "nan",
        "-nan",
        "null",
        "none",
        "nil",
        "missing",
        "invalid",
        "?",
    )
})
"""Texts in lower case that stand in a cell for no sample."""

# Nines by hand, -999.25 of well logs, the largest and smallest integers of 16 to 64 bits.
_NINES = (99.0, 99.9, 99.99, 999.0, 999.25, 999.9, 999.99, 9999.0, 9999.25, 9999.9, 9999.99, 99999.0)
_INTEGERS = tuple(
    float(value) for bits in (16, 32, 64) for value in (2**bits - 1, 2 ** (bits - 1) - 1, 2 ** (bits - 1))
)
_CODES = np.array(sorted({*_NINES, *_INTEGERS, 99999.99, 999999.0, 9999999.0}))
# The ends of an integer type, written in units of its last digit: tenths to ten thousandths, and 1e-7 deg.
_SCALED = np.unique([value * unit for value in _INTEGERS for unit in (1e-1, 1e-2, 1e-3, 1e-4, 1e-7)])
_SCALED = _SCALED[_SCALED > 1.0]

_EXACT = 1e-6
"""Relative error up to which a number is the end of a type: single precision keeps it to 6e-8."""

_LONG_CODE = 9999.0  # from here on a code is hardly a value that a human or an autopilot commands

_ENORMOUS = (
    1e15  # no quantity of a vehicle in any unit, but time in ns: 1e20, 1e30, the largest float, netCDF's fill
)

_OUTSIDE, _SHORT_OUTSIDE, _FAR_OUTSIDE = 1.0, 3.0, 10.0
"""Ranges of the other samples, by which a long code, a short one and any number that recurs lie outside."""

_FEWEST = 3  # times that a number recurs by which it is a code without being a usual one

_TALL = 20.0  # usual steps of an excursion

_NEAR = 0.1  # of an excursion: how near to the sample before it the one behind it is

_LONGEST = 5  # samples of a lone excursion

_MOST = 0.5  # of the samples: what is there for more than half of a record is no exception

_ENOUGH = 10  # other samples, that tell where the column lies


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
    """Numbers of a column that stand for no sample, in the order of their number.

    Parameters
    ----------
    y : array (m,)
        Cells as recorded, in the recording's unit; NaN where there is none.
    jumps : bool
        Whether the column may jump and return by itself, as commands and angles do.

    Examples
    --------
    >>> y = 15.0 + np.sin(np.arange(50.0))
    >>> y[[7, 30, 31]] = -9999.0
    >>> [(one.value, one.count) for one in sentinels(y)]
    [(-9999.0, 3)]
    """
    known = np.isfinite(y)
    if known.sum() < _ENOUGH:
        return []
    values, counts = np.unique(y[known], return_counts=True)
    wrong = _outside(values, counts, jumps=jumps)
    found = [Sentinel(float(value), y == value) for value in values[wrong]]
    rest = np.isfinite(y) & ~np.isin(y, values[wrong])
    resting = rest.any() and np.ptp(y[rest]) == 0.0
    # Beside a column that rests, and of a number that is no usual code, only brief fills are sure.
    found = [
        one for one in found if (_is_code(np.abs([one.value]))[0] and not resting) or _brief(one.at[known])
    ]
    if not jumps:
        found += _excursions(np.where(rest, y, np.nan), values[(counts >= _FEWEST) & ~wrong])
    return sorted(found, key=lambda one: -one.count)


def _is_code(size: Array) -> Mask:
    """Which numbers without their sign (k,) are usual codes."""
    place = np.clip(np.searchsorted(_SCALED, size), 1, len(_SCALED) - 1)
    away = np.minimum(np.abs(_SCALED[place] - size), np.abs(_SCALED[place - 1] - size))
    usual = np.isin(np.round(size, 2), np.round(_CODES, 2)) | (size > _ENORMOUS)
    return np.asarray(usual | (away <= _EXACT * size))


def _brief(at: Mask) -> bool:
    """Whether a value stands for few samples at a time."""
    return float(np.mean([stop - start for start, stop in runs(at)])) <= _LONGEST / 2.0


def _outside(values: Array, counts: NDArray[np.int_], *, jumps: bool) -> Mask:
    """Which of the distinct `values` (k,), rising, are codes that lie outside of all others."""
    size = np.abs(values)
    code = _is_code(size)
    least = np.where(size >= _LONG_CODE, _OUTSIDE, _SHORT_OUTSIDE)
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
            if not len(rest) or counts[wrong].sum() + counts[end] > _MOST * total:
                continue
            width, apart = float(np.ptp(rest)), float(np.abs(rest - values[end]).min())
            # A column that rests has no range: its own size tells the scale.
            width = width if width > 0.0 else 0.1 * abs(float(rest[0]))
            enough = apart > (least[end] if code[end] else _FAR_OUTSIDE) * width
            if enough and apart > 0.0 and (code[end] or (counts[end] >= _FEWEST and not jumps)):
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
    inside = (starts > 0) & (stops < len(x)) & (stops - starts <= _LONGEST)
    starts, stops, place = starts[inside], stops[inside], place[inside]
    before, after, own = x[starts - 1], x[stops], x[starts]
    tall = np.minimum(np.abs(before - own), np.abs(after - own))
    lone = (tall > _TALL * usual) & (np.abs(after - before) < _NEAR * tall)
    # Nearly every time: a number that the column also passes through is one of its own.
    share = np.bincount(place[lone], (stops - starts)[lone], len(values)) >= 0.8 * counts
    often = np.bincount(place[lone], minlength=len(values)) >= _FEWEST
    found = []
    for k in np.flatnonzero(often & share & (counts <= _MOST * len(x))):
        samples = np.zeros(len(y), bool)
        for run in np.flatnonzero(lone & (place == k)):
            samples[index[starts[run] : stops[run]]] = True
        found.append(Sentinel(float(values[k]), samples))
    return found
