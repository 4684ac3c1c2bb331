"""Times of a log: columns that are a time, their unit and clock, and the stamps of one sensor.

Intervals that alternate (0.1 and 0.2 s) or scatter have no one interval: a gap is measured by their 85th
percentile, and a time base as fine as their 20th has a place for nearly every sample. Samples that a receiver
handed over in a burst are spread over the time since the burst before, so that none is stamped later than it
came. Held by ``tests/logs/test_log_times.py`` and ``tests/trial/test_time_base.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from seatrial.base.arrays import Array, Mask, runs
from seatrial.base.errors import printable
from seatrial.logs.log import Log, Note

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class ClockSettings:
    """What makes a column a time, and what tells gaps, bursts and damaged stamps of a sensor."""

    counter_values: float = 2.0**32  #: values of a counter of 32 bits
    #: share of them at either end within which it may begin again: 43 s of microseconds, longer than any gap
    #: that a sample should bridge
    counter_ends: float = 0.01
    #: of the rows with a header's stamp above which it is that of the row, not of one of several topics
    row_stamp_share: float = 0.95
    unix_from_s: float = 9e8  #: s since 1970, in 1998: no time since a start is so long
    along_rows: float = 0.999  #: correlation of a column with its rows that makes it a time though steps fall
    long_quantile: float = 0.85  #: of the intervals: what is much longer is a gap
    #: of the intervals: the step of a time base with a place for nearly every sample
    short_quantile: float = 0.2
    irregular_ratio: float = 1.5  #: long over short interval, above which the median is no common interval
    finest_share: float = 0.25  #: of the median: shorter intervals are an accident of the stamps
    burst_share: float = 0.1  #: of the mean interval: stamps that are closer came in one burst
    bursting_share: float = 0.3  #: of intervals within bursts that makes bursts evident
    steady_ratio: float = 1.6  #: of the time per sample among the bursts, for a sensor that samples evenly
    longest_ratio: float = 1.5  #: times the usual time per sample: a longer one is a gap before the burst
    fewest_stamps: int = 20  #: that show bursts
    block_stamps: int = 50  #: stamps whose median is compared with those of their neighbours
    far_spreads: float = 10.0  #: spreads of the neighbours' medians beyond which a stamp is no time
    slack_s: float = 1.0  #: s beyond which it is none at least
    stray_share: float = 0.01  #: of damaged stamps, above which they may be right
    strays_in_a_row: int = 3  #: rows of damaged stamps, above which they may be right


SETTINGS = ClockSettings()


_DAY_S = 86_400.0  # of 24 hours: leap seconds do not count in logs
_SPREADSHEET_EPOCH_D = 25_569.0  # 1970-01-01 in days of a spreadsheet
_DATENUM_EPOCH_D = 719_529.0  # and in those of MATLAB

NEAR_S = _DAY_S
"""A message's stamp that lies further from its reception is of another clock, as of a simulator."""

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

_BARE = re.compile(r"^(t[_ ]?(s|ms|us|ns|min|h|d|sec|msec|usec|nsec)|time(us|ms|ns))$", re.IGNORECASE)
_HEADER = re.compile(r"(^|.*[./_])header[./_](time)?stamp$", re.IGNORECASE)
"""A flattened message: when it was measured; the record beside it says when it was written."""


@dataclass(frozen=True)
class TimeScale:
    """How the numbers of a time column become seconds: ``(value - origin) * factor``."""

    factor: float  #: s per unit of the column.
    #: Its number at the Unix epoch, in its unit; 0 for Unix times and for times since some start.
    origin: float = 0.0
    unix: bool = False  #: Whether the result is Unix time.
    how: str = ""  #: What was taken for what, for a note; "" where the log states it.


def is_time(name: str) -> bool:
    """Whether a field's name says that it is a time.

    Examples
    --------
    >>> [is_time(name) for name in ("Time", "TimeUS", "t_s", "timestamp_us", "thrust", "settle_time_gain")]
    [True, True, True, True, False, False]
    """
    plain = re.sub(r"[\[(].*[\])]", "", name).strip()
    return bool(_BARE.match(plain) or _NAMES.match(plain))


def is_header_stamp(name: str) -> bool:
    """Whether a column is the stamp of a flattened message's header.

    Examples
    --------
    >>> [is_header_stamp(name) for name in ("field.header.stamp", "/dvl/header/stamp", "%time")]
    [True, True, False]
    """
    return bool(_HEADER.match(name))


def time_fields(names: Sequence[str]) -> list[str]:
    """Those of `names` that may be the time, the likeliest first: stamps of a message before its record's."""

    def rank(name: str) -> tuple[int, int]:
        if is_header_stamp(name):
            return -1, names.index(name)
        plain = name.strip("%# ").lower()
        exact = ("t_s", "t", "time", "timestamp", "time_s", "timeus", "timems", "stamp", "__time", "datetime")
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
    suffix = re.search(
        r"(?:_|(?<=[a-z])(?=[A-Z]))(s|sec|ms|msec|us|usec|ns|nsec|min|h|MS|US|NS)$", name.strip()
    )
    return _UNITS[suffix[1].lower()] if suffix else None


class Counter32:
    """Counts of a counter of 32 bits, chunk by chunk in their order, made to go on past its end.

    Milliseconds since a start end after 49.7 days, microseconds after 71.6 minutes. A count near the end with
    one near the beginning behind it is the next one; any other fall is a clock that began again.

    Examples
    --------
    >>> counter = Counter32()
    >>> counter.of(np.array([4294967000.0, 4294967200.0, 104.0])).tolist()
    [4294967000.0, 4294967200.0, 4294967400.0]
    >>> counter.of(np.array([304.0])).tolist()
    [4294967600.0]
    """

    def __init__(self) -> None:
        self._last, self._added = np.nan, 0.0

    def of(self, values: Array) -> Array:
        """The counts (n,), NaN where there is none."""
        known = np.flatnonzero(np.isfinite(values))
        counts = values[known]
        if not len(counts) or np.abs(counts).max() > SETTINGS.counter_values:
            return values
        steps = np.diff(counts, prepend=counts[0] if np.isnan(self._last) else self._last)
        near = (
            np.abs(np.abs(steps) - SETTINGS.counter_values) <= SETTINGS.counter_ends * SETTINGS.counter_values
        )
        added = self._added - SETTINGS.counter_values * np.cumsum(np.where(near, np.sign(steps), 0.0))
        self._last, self._added = float(counts[-1]), float(added[-1])
        if not added.any():
            return values
        result = np.array(values, float)
        result[known] += added
        return result


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


def clock_times(cells: pl.Series) -> tuple[Array, bool] | None:
    """Seconds (n,) of a column of dates, times of day or durations, typed or as text; None for other columns.

    With it whether they are Unix times. NaN where a cell is empty or neither.

    Examples
    --------
    >>> import polars as pl
    >>> clock_times(pl.Series(["23:59:59.5", "00:00:00.5"]))[0].tolist()
    [86399.5, 86400.5]
    """
    import polars as pl

    if cells.dtype == pl.Date:  # a day is no time of a sample
        return None
    if cells.dtype.is_temporal():
        unit = {"ms": 1e-3, "us": 1e-6}.get(str(getattr(cells.dtype, "time_unit", "")), 1e-9)
        t = np.asarray(cells.to_physical().cast(pl.Float64).to_numpy().astype(float) * unit)
        return (_over_midnight(t), False) if cells.dtype == pl.Time else (t, cells.dtype != pl.Duration)
    if cells.dtype not in (pl.String, pl.Categorical, pl.Enum):
        return None
    text = cells.cast(pl.String).str.strip_chars()
    if text.cast(pl.Float64, strict=False).is_not_null().any():
        return None
    return seconds(text)


def _over_midnight(t: Array) -> Array:
    """Times of day (n,), s, that go on where the clock starts again; NaN stays."""
    known = np.flatnonzero(np.isfinite(t))
    result = np.array(t, float)
    result[known] += _DAY_S * np.cumsum(np.diff(t[known], prepend=t[known][:1]) < -0.5 * _DAY_S)
    return result


def after(t: Array, last: float) -> Array:
    """Times of day (n,), s, of a chunk, with the days that passed before it; `last`: of the chunk before."""
    known = t[np.isfinite(t)]
    if not len(known) or not np.isfinite(last):
        return t
    return np.asarray(t + _DAY_S * max(np.round((last - known[0]) / _DAY_S), 0.0))


_ZONE = r"^(.*\d)\s*(?:[Zz]|UTC|GMT|([+-]\d{2}):?(\d{2})?)$"
_CLOCK = r"^(\d{1,2}):(\d{2}):(\d{2}(?:\.\d+)?)\s*(?:([Aa]|[Pp])[Mm])?$"
_DATES = ("%Y-%m-%dT%H:%M:%S%.f", "%Y-%m-%d %H:%M:%S%.f", "%Y/%m/%d %H:%M:%S%.f", "%d.%m.%Y %H:%M:%S%.f",
          "%d/%m/%Y %H:%M:%S%.f", "%m/%d/%Y %H:%M:%S%.f", "%Y%m%d %H:%M:%S%.f", "%Y%m%dT%H%M%S%.f",
          "%m/%d/%Y %I:%M:%S%.f %p", "%d/%m/%Y %I:%M:%S%.f %p", "%Y-%m-%d %I:%M:%S%.f %p")  # fmt: skip


def seconds(cells: pl.Series) -> tuple[Array, bool] | None:
    """Seconds of cells that hold dates or times of day as text, and whether they are Unix times.

    A zone behind a time (``Z``, ``UTC``, ``+02``, ``+0200``, ``+02:00``) is subtracted; a date without one is
    taken for UTC.

    Shape (n,), NaN where a cell is neither; None where hardly any cell is.

    Examples
    --------
    >>> import polars as pl
    >>> seconds(pl.Series(["1970-01-02T02:00:00.5+02:00", "1970-01-02T00:00:01 UTC"]))[0].tolist()
    [86400.5, 86401.0]
    """
    import polars as pl

    table = cells.cast(pl.String).str.strip_chars().alias("text").to_frame()
    # Zones are taken off first: one file may mix them, as about a change of summer time.
    zone = pl.col("text").str.extract_groups(_ZONE).struct.rename_fields(["time", "hours", "minutes"])
    table = table.with_columns(zone.struct.unnest())
    hours = pl.col("hours").cast(pl.Float64, strict=False).fill_null(0.0)
    minutes = pl.col("minutes").cast(pl.Float64, strict=False).fill_null(0.0)
    west = pl.col("hours").str.starts_with("-").fill_null(value=False)
    table = table.select(
        pl.coalesce("time", "text").str.replace(r",(\d+)", ".$1").alias("text"),
        (3600.0 * hours + 60.0 * pl.when(west).then(-minutes).otherwise(minutes)).alias("ahead"),
    )
    text, ahead = table["text"], table["ahead"].to_numpy()
    some = max(int(text.is_not_null().sum()), 1)
    clock = text.str.extract_groups(_CLOCK).struct.unnest()
    if clock.to_series(0).is_not_null().sum() > 0.9 * some:
        h, m, s = (clock.to_series(k).cast(pl.Float64, strict=False).to_numpy() for k in range(3))
        # 12 AM is 0 h, 12 PM is 12 h.
        half = clock.to_series(3).str.to_lowercase()
        h = np.where(half.is_not_null(), h % 12.0 + 12.0 * (half == "p").fill_null(value=False), h)
        return _over_midnight((h * 3600.0 + m * 60.0 + s - ahead) % _DAY_S), False
    for form in _DATES:
        dates = text.str.to_datetime(form, strict=False, time_unit="us")
        if dates.is_not_null().sum() > 0.9 * some:
            return dates.to_physical().cast(pl.Float64).to_numpy().astype(float) * 1e-6 - ahead, True
    return None


def unfit(name: str, numbers: Array, cells: Sequence[str | None], row: int) -> Note:
    """Why the column `name` is no time: its `numbers` (n,) and `cells`, the first in line `row`.

    Examples
    --------
    >>> str(unfit("time", np.array([3.0, 3.0]), ["3", "3"], 2))
    'column "time" is 3 in all of the first 2 rows; expected times that rise: write the time of each row'
    """
    given = [(k, cell) for k, cell in enumerate(cells) if cell]
    known = np.flatnonzero(np.isfinite(numbers))
    if not given:
        return Note.of("time empty", name, where="")
    # Half: a single damaged cell is no reason against a column.
    if len(known) <= 0.5 * len(given):
        k, cell = next((k, cell) for k, cell in given if not np.isfinite(numbers[k]))
        return Note.of("time of unknown form", name, cell=cell, line=row + k)
    if np.ptp(numbers[known]) == 0.0:
        return Note.of("time constant", name, value=float(numbers[known[0]]), rows=len(known))
    falls = np.diff(numbers[known]) < 0.0
    if not falls.any():
        return Note.of("time empty", name, where=" in most rows")
    k = int(np.argmax(falls))
    beside = [(float(numbers[at]), row + int(at)) for at in known[k : k + 2]]
    return Note.of("time falls", name, falls=beside)


def joined_names(units: Mapping[str, str]) -> tuple[str, str] | None:
    """Names of seconds and nanoseconds that make one stamp together, as ROS exports write them; or None."""
    names = {name.lower(): name for name in units}
    for whole, rest in (("secs", "nsecs"), ("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanoseconds")):
        for low, name in names.items():
            if low == whole or low.endswith(tuple(mark + whole for mark in "._/")):
                partner = low[: len(low) - len(whole)] + rest
                if partner in names:
                    return name, names[partner]
    return None


class TimeColumn(NamedTuple):
    """The column of the time, that of its nanoseconds if there is one, and its scale; None for dates."""

    name: str
    rest: str | None
    scale: TimeScale | None


def time_column(
    units: Mapping[str, str],
    candidates: Sequence[str],
    head: pl.DataFrame,
    numbers: Callable[[pl.Series], Array],
    *,
    first_row: int,
) -> tuple[TimeColumn | None, Note | None]:
    """The time among some columns, and why the likeliest one is none.

    `units`: by column, "" where none is stated. `candidates`: columns that may be the time, the likeliest
    first. `head`: first rows of the table. `numbers`: numbers of a column's cells. `first_row`: line of the
    first row, for the reason.
    """
    why: Note | None = None
    records = [name for name in candidates if not is_header_stamp(name)]

    def rising(name: str) -> tuple[Array, TimeScale] | None:
        values = Counter32().of(numbers(head[name]))
        finite = values[np.isfinite(values)]
        if len(finite) <= 0.5 * head.height or not rises(finite):
            return None
        return values, scale_of(name, units.get(name, ""), values)

    def of_record(stamps: Array) -> bool:
        """Whether the stamps of messages are of the clock of their records, and in every row."""
        if np.ptp(stamps[np.isfinite(stamps)]) == 0.0:
            return False
        for name in records:
            if (record := rising(name)) is not None:
                t = (record[0] - record[1].origin) * record[1].factor
                near = abs(np.nanmedian(t) - np.nanmedian(stamps)) < NEAR_S
                return bool(
                    near and np.isfinite(stamps).mean() >= SETTINGS.row_stamp_share * np.isfinite(t).mean()
                )
        return True

    # Seconds and nanoseconds of one stamp in two columns, as ROS writes them.
    if (pair := joined_names(units)) is not None:
        stamps = numbers(head[pair[0]]) + 1e-9 * numbers(head[pair[1]])
        finite = stamps[np.isfinite(stamps)]
        if len(finite) > 0.5 * head.height and rises(finite) and of_record(stamps):
            return TimeColumn(
                *pair, TimeScale(1.0, unix=bool(np.median(finite) > SETTINGS.unix_from_s))
            ), None
    for name in candidates:
        if (read := rising(name)) is not None:
            values, scale = read
            if not is_header_stamp(name) or of_record((values - scale.origin) * scale.factor):
                return TimeColumn(name, None, scale), None
        elif clock_times(head[name]) is not None:
            return TimeColumn(name, None, None), None
        elif str(head[name].dtype) == "Date":
            why = why or Note.of("days without time", name, first=str(head[name][0]))
        elif name in records or not records:
            why = why or unfit(name, numbers(head[name]), _texts(head[name]), first_row)
    return None, why


class RowStamps:
    """Stamps of the rows of a table, chunk by chunk, by its time column; the log keeps what they tell."""

    def __init__(
        self,
        log: Log,
        column: TimeColumn | None,
        numbers: Callable[[pl.Series], Array],
        dated: Callable[[pl.Series], tuple[Array, bool] | None],
    ) -> None:
        self._log, self._column, self._numbers, self._dated = log, column, numbers, dated
        self._counter, self._last = Counter32(), np.nan
        if column is not None and column.scale is not None:
            if column.scale.how:
                log.remark("scale of time", f'time "{printable(column.name)}"', how=column.scale.how)
            if column.scale.unix:
                log.epoch_s = 0.0

    def of(self, rows: pl.DataFrame) -> Array:
        """Stamps (n,) in s of the next rows, NaN where there is none."""
        if self._column is None:
            return np.full(rows.height, np.nan)
        name, rest, scale = self._column
        if scale is None:
            if (dates := self._dated(rows[name])) is None:
                return np.full(rows.height, np.nan)
            if dates[1]:
                self._log.epoch_s = 0.0
                return dates[0]
            t = after(dates[0], self._last)
            self._last = float(np.nanmax(t))
            return t
        with np.errstate(invalid="ignore", over="ignore"):  # damaged numbers
            t = (self._counter.of(self._numbers(rows[name])) - scale.origin) * scale.factor
            return t if rest is None else np.asarray(t + 1e-9 * self._numbers(rows[rest]))


def rises(values: Array) -> bool:
    """Whether numbers rise, but for some that came out of order, or many that did within bursts."""
    steps = np.diff(values)
    if len(steps) == 0:
        return True
    if not np.median(values[-3:]) > np.median(values[:3]):  # one stamp may be damaged
        return False
    along = np.corrcoef(values, np.arange(len(values)))[0, 1]
    return bool(np.mean(steps >= 0.0) > 0.9 or (np.mean(steps >= 0.0) > 0.5 and along > SETTINGS.along_rows))


def _texts(cells: pl.Series) -> list[str | None]:
    import polars as pl

    return cells.cast(pl.String, strict=False).to_list()


class Spread(NamedTuple):
    """Stamps of a burst spread over the time it took: times in s (n,), number of bursts, time per sample."""

    t: Array
    bursts: int
    step_s: float


def usual_interval(t: Array) -> float:
    """Longest usual interval of rising stamps in s; infinite for fewer than two.

    Examples
    --------
    >>> t = np.cumsum(np.tile([0.1, 0.2], 50))
    >>> round(usual_interval(t), 3), round(base_step(t), 3)
    (0.2, 0.1)
    """
    if len(t) < 2:
        return np.inf
    intervals = np.diff(t)
    return float(max(np.median(intervals), np.quantile(intervals, SETTINGS.long_quantile)))


def strays(t: Array) -> Mask:
    """Stamps (n,) far from those before and after them: single damaged rows.

    Examples
    --------
    >>> t = np.arange(500.0)
    >>> t[[90, 499]] = 1e18, -5e6
    >>> np.flatnonzero(strays(t)).tolist()
    [90, 499]
    """
    count = len(t) // SETTINGS.block_stamps
    if count < 2:
        return np.zeros(len(t), bool)
    middle = np.median(t[: count * SETTINGS.block_stamps].reshape(count, SETTINGS.block_stamps), axis=1)
    near = np.stack([np.r_[middle[0], middle[:-1]], middle, np.r_[middle[1:], middle[-1]]])
    least, most = near.min(axis=0), near.max(axis=0)
    slack = np.maximum(SETTINGS.slack_s, SETTINGS.far_spreads * (most - least))
    block = np.minimum(np.arange(len(t)) // SETTINGS.block_stamps, count - 1)
    far = (t < (least - slack)[block]) | (t > (most + slack)[block])
    few = far.mean() < SETTINGS.stray_share and all(
        end - begin <= SETTINGS.strays_in_a_row for begin, end in runs(far)
    )
    return np.asarray(far & few)


def base_step(t: Array) -> float:
    """Step in s of a time base that has a place for nearly every sample at the rising stamps `t`.

    The median interval; where intervals differ much, the short one, its rate to three digits.
    """
    if len(t) < 2:
        return np.inf
    intervals = np.diff(t)
    short, middle, long = np.quantile(intervals, [SETTINGS.short_quantile, 0.5, SETTINGS.long_quantile])
    if SETTINGS.finest_share * middle < short and long > SETTINGS.irregular_ratio * short:
        return 1.0 / float(f"{1.0 / short:.3g}")
    return float(middle)


def spread_bursts(t: Array) -> Spread | None:
    """Stamps `t` (n,), which do not fall, spread evenly over each burst; None where no bursts are evident.

    Bursts are evident where many stamps are nearly the same and the time per sample, from one burst to the
    next, is steady all the same.

    Examples
    --------
    >>> spread = spread_bursts(np.repeat(np.arange(1.0, 21.0), 5))
    >>> spread.bursts, spread.t[5:10].round(2).tolist()
    (20, [1.2, 1.4, 1.6, 1.8, 2.0])
    """
    if len(t) < SETTINGS.fewest_stamps or t[-1] <= t[0]:
        return None
    intervals = np.diff(t)
    near = intervals < SETTINGS.burst_share * float(intervals.mean())
    if near.mean() < SETTINGS.bursting_share:
        return None
    last = np.append(np.flatnonzero(~near), len(t) - 1)  # of each burst
    sizes = np.diff(last, prepend=-1)
    received = t[last]
    each = np.diff(received) / sizes[1:]
    if len(each) < SETTINGS.fewest_stamps // 4 or np.quantile(
        each, 0.85
    ) > SETTINGS.steady_ratio * np.quantile(each, 0.15):
        return None
    step = float(np.median(each))
    spacing = np.concatenate([[step], np.minimum(each, SETTINGS.longest_ratio * step)])
    burst = np.repeat(np.arange(len(sizes)), sizes)
    behind = last[burst] - np.arange(len(t))
    return Spread(received[burst] - behind * spacing[burst], len(sizes), step)
