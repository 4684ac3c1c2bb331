"""Which field of a table is its time, and what one of its numbers is in seconds.

A table says it by a name, a unit row or nothing. Dates and times of day are read as written; numbers by
their unit where one is stated, else by size: Unix times in ns, us, ms or s, days of a spreadsheet or of
MATLAB, else seconds since some start, or ms and us where the steps between whole numbers are too long for
samples.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array

if TYPE_CHECKING:
    import polars as pl

__all__ = ["TimeScale", "is_time", "scale_of", "seconds", "time_fields"]

_DAY_S = 86_400.0
_SPREADSHEET_EPOCH_D = 25_569.0  # 1970-01-01 in days of a spreadsheet
_DATENUM_EPOCH_D = 719_529.0  # and in those of MATLAB

_UNITS = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millis": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "usec": 1e-6, "µs": 1e-6, "micros": 1e-6, "microseconds": 1e-6,
    "ns": 1e-9, "nsec": 1e-9, "nsecs": 1e-9, "nanoseconds": 1e-9,
    "min": 60.0, "h": 3600.0, "d": _DAY_S, "days": _DAY_S,
}  # fmt: skip

_NAMES = re.compile(
    r"^[%#]?\s*(t|time|times?tamp|stamp|datetime|date[_ ]?time|date|utc|elapsed|seconds?|secs?|epoch|clock|"
    r"time[_ ]?(boot|since|of)?[_ ]?\w*|.*(time|stamp)(_?(s|sec|ms|us|usec|ns|utc|unix))?)$",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class TimeScale:
    """How the numbers of a time column become seconds: ``(value - origin) * factor``.

    Attributes
    ----------
    factor
        s per unit of the column.
    origin
        Its number at the Unix epoch, in its unit; 0 for Unix times and for times since some start.
    unix
        Whether the result is Unix time.
    how
        What was taken for what, for a note; "" where the log states it.
    """

    factor: float
    origin: float = 0.0
    unix: bool = False
    how: str = ""


def is_time(name: str) -> bool:
    """Whether a field's name says that it is a time.

    Examples
    --------
    >>> [is_time(name) for name in ("Time", "TimeUS", "t_s", "timestamp_us", "thrust", "settle_time_gain")]
    [True, True, True, True, False, False]
    """
    plain = re.sub(r"[\[(].*[\])]", "", name).strip()
    return plain.lower() in ("t_s", "t_ms", "t_us", "timeus", "timems") or bool(_NAMES.match(plain))


def time_fields(names: Sequence[str]) -> list[str]:
    """Those of `names` that may be the time, the likeliest first."""

    def rank(name: str) -> tuple[int, int]:
        plain = name.strip("%# ").lower()
        exact = ("t_s", "t", "time", "timestamp", "time_s", "timeus", "timems", "stamp", "%time", "datetime")
        return (exact.index(plain) if plain in exact else len(exact), names.index(name))

    return sorted((name for name in names if is_time(name)), key=rank)


def stated_unit(name: str, unit: str) -> float | None:
    """Seconds per unit by the unit row, brackets or suffix of a column; None where none says it.

    Examples
    --------
    >>> stated_unit("Time [ms]", ""), stated_unit("TimeUS", ""), stated_unit("time", "s")
    (0.001, 1e-06, 1.0)
    """
    if unit.strip().lower() in _UNITS:
        return _UNITS[unit.strip().lower()]
    bracketed = re.search(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$", name)
    if bracketed and bracketed[1].lower() in _UNITS:
        return _UNITS[bracketed[1].lower()]
    suffix = re.search(r"(?:_|(?<=[a-z])(?=[A-Z]))(s|sec|ms|msec|us|usec|ns|nsec|MS|US|NS)$", name)
    return _UNITS[suffix[1].lower()] if suffix else None


def scale_of(name: str, unit: str, values: Array) -> TimeScale:
    """Scale of a numeric time column from its name, its unit and some of its `values` in order.

    Examples
    --------
    >>> scale_of("Time", "", 1.7e12 + 100.0 * np.arange(50.0)).factor
    0.001
    >>> scale_of("t", "", 0.1 * np.arange(50.0))
    TimeScale(factor=1.0, origin=0.0, unix=False, how='')
    """
    stated = stated_unit(name, unit)
    finite = values[np.isfinite(values)]
    if not len(finite):
        return TimeScale(stated or 1.0)
    size = float(np.median(finite))
    if stated is not None and stated < _DAY_S:
        return TimeScale(stated, unix=9e8 < size * stated < 5e9)
    for factor, word in ((1e-9, "ns"), (1e-6, "us"), (1e-3, "ms"), (1.0, "s")):
        if 9e8 < size * factor < 5e9:  # 1998 to 2128
            return TimeScale(factor, unix=True, how=f"Unix time in {word}")
    steps = np.diff(finite)
    steps = steps[steps > 0.0]
    step = float(np.median(steps)) if len(steps) else 0.0
    if step < 0.01 and 3e4 < size < 8e4 and step > 0.0:
        return TimeScale(_DAY_S, _SPREADSHEET_EPOCH_D, True, "days of a spreadsheet")
    if step < 0.01 and 7e5 < size < 8e5 and step > 0.0:
        return TimeScale(_DAY_S, _DATENUM_EPOCH_D, True, "days of MATLAB (datenum)")
    whole = bool(np.all(finite == np.round(finite)))
    if whole and step >= 1e6:
        return TimeScale(1e-9, how="whole numbers that rise by a million or more: ns")
    if whole and step >= 1e3:
        return TimeScale(1e-6, how="whole numbers that rise by a thousand or more: us")
    if whole and step >= 5.0:
        return TimeScale(1e-3, how="whole numbers that rise by five or more: ms")
    return TimeScale(1.0)


_CLOCK = re.compile(r"^\s*(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)\s*$")
_DATES = ("%Y-%m-%dT%H:%M:%S%.f", "%Y-%m-%d %H:%M:%S%.f", "%Y/%m/%d %H:%M:%S%.f", "%d.%m.%Y %H:%M:%S%.f",
          "%d/%m/%Y %H:%M:%S%.f", "%m/%d/%Y %H:%M:%S%.f", "%Y%m%d %H:%M:%S%.f",
          "%Y%m%dT%H%M%S%.f")  # fmt: skip


def seconds(cells: pl.Series) -> tuple[Array, bool] | None:
    """Seconds of cells that hold dates or times of day as text, and whether they are Unix times.

    Returns
    -------
    tuple or None
        Shape (n,), NaN where a cell is neither; None where hardly any cell is.
    """
    import polars as pl

    text = cells.cast(pl.String).str.strip_chars().str.strip_chars_end("Z")
    some = max(int(text.is_not_null().sum()), 1)
    parts = text.str.extract_groups(_CLOCK.pattern.replace("(?:", "(?:"))
    clock = parts.struct.unnest()
    if clock.width == 3 and clock.to_series(0).is_not_null().sum() > 0.9 * some:
        numbers = [clock.to_series(k).str.replace(",", ".").cast(pl.Float64, strict=False) for k in range(3)]
        t = (numbers[0] * 3600.0 + numbers[1] * 60.0 + numbers[2]).to_numpy().astype(float)
        # Midnight: the clock starts again.
        return t + _DAY_S * np.cumsum(np.diff(t, prepend=t[:1]) < -0.5 * _DAY_S), False
    zone = text.str.replace(r"[+-]\d{2}:?\d{2}$", "")
    for form in _DATES:
        dates = zone.str.to_datetime(form, strict=False, time_unit="us")
        if dates.is_not_null().sum() > 0.9 * some:
            return dates.to_physical().cast(pl.Float64).to_numpy().astype(float) * 1e-6, True
    return None


def joined_names(units: Mapping[str, str]) -> tuple[str, str] | None:
    """Names of seconds and nanoseconds that make one stamp together, as ROS exports write them; or None."""
    names = {name.lower(): name for name in units}
    for whole, rest in (("secs", "nsecs"), ("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanoseconds")):
        for low, name in names.items():
            if low == whole or low.endswith(("." + whole, "_" + whole)):
                partner = low[: len(low) - len(whole)] + rest
                if partner in names:
                    return name, names[partner]
    return None
