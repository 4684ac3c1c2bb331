"""Several topics, files and clocks on rows of one clock: the table that a trial is read from.

Rows are all stamps of all topics; a cell is empty (null) where its topic has no sample at that stamp, or
NaN, so nothing is resampled here. Stamps that meet fill one row. Before that each topic is put in order: rows
without a stamp are left out, rows out of order are sorted, bursts are spread (`seatrial.logs.clock`), of
rows with one stamp the last stays; all of it is reported. A file with a clock of its own is brought to the
first one's: ``t = (stamp - offset_s) / (1 + drift)``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError, printable
from seatrial.logs.clock import spread_bursts, strays
from seatrial.logs.log import Log, Note, Samples, Share

if TYPE_CHECKING:
    import polars as pl

"""What to do about recordings that stand behind one another in a file."""


@dataclass(frozen=True)
class JoinSettings:
    """Which stamps of two topics are one, and where a clock began again."""

    #: s: stamps that differ by less are the same, by the rounding of a text file's six digits
    equal_s: float = 1e-6
    restart_s: float = 2.0  #: s by which stamps fall where a recording begins again
    restart_share: float = 0.1  #: of what went before, by which they fall
    restart_rows: int = 20  #: rows for which they stay below


SETTINGS = JoinSettings()


@dataclass(frozen=True)
class Wanted:
    """One column of the table to make: a field, divided by another one where it is an increment."""

    topic: str
    name: str
    per: str = ""

    @property
    def column(self) -> str:
        """Its name in the table."""
        return f"{self.topic}.{self.name}" + (f"/{self.per}" if self.per else "")


def find_field(log: Log, column: str) -> Wanted | None:
    """Field of a log that ``topic.field`` or ``topic.field/other`` names; None where it has none.

    Of a log with one topic, as a table of text is, the topic may be left out.
    """
    known = [topic for topic in log.fields if column.startswith(topic + ".")]
    for topic in sorted(known, key=len, reverse=True):
        field = _within(log, topic, column.removeprefix(topic + "."))
        if field is not None:
            return field
    return _within(log, next(iter(log.fields)), column) if len(log.fields) == 1 else None


def _within(log: Log, topic: str, name: str) -> Wanted | None:
    fields = log.fields[topic]
    if name in fields:
        return Wanted(topic, name)
    first, _, per = name.partition("/")
    return Wanted(topic, first, per) if first in fields and per in fields else None


@dataclass(frozen=True)
class Clock:
    """Reading of a log's clock at the time zero of the first log's, s, and by how much faster it runs."""

    offset_s: float = 0.0
    drift: float = 0.0


@dataclass
class Joined:
    """The table, the Unix time of its time zero (None where unknown) and what was done."""

    table: pl.DataFrame
    epoch_s: float | None
    notes: list[Note] = field(default_factory=list)


def join(
    logs: Sequence[Log],
    wanted: Sequence[Wanted],
    clocks: Mapping[str, Clock] | None = None,
    share: Share | None = None,
) -> Joined:
    """Columns `wanted` of some logs as one table with the times `t_s` from the first sample on.

    `logs`: a topic is looked for in the order of the logs. `wanted`: columns. `clocks`: clock by file name,
    for logs whose clock is not that of the first.
    """
    import polars as pl

    notes: list[Note] = []
    # Logs with dates meet on that clock, logs without on their own zero.
    epoch = _epoch(logs, notes)
    topics: dict[str, tuple[Log, list[Wanted]]] = {}
    for column in wanted:
        log = next((log for log in logs if column.topic in log.fields), None)
        if log is None:
            raise TrialError(f'no log has the topic "{column.topic}"; the logs are {_named(logs)}')
        topics.setdefault(column.topic, (log, []))[1].append(column)
    parts: list[tuple[str, Array, dict[str, Array]]] = []
    for count, log in enumerate(logs):
        own = {topic: columns for topic, (home, columns) in topics.items() if home is log}
        names = {
            topic: list(dict.fromkeys(n for c in columns for n in (c.name, c.per) if n))
            for topic, columns in own.items()
        }
        clock = (clocks or {}).get(log.path.name, Clock())
        offset = 0.0 if epoch is None else (log.epoch_s or 0.0) - epoch
        for topic, samples in (log.read(names) if names else {}).items():
            t, cells = _ordered(topic, samples, own[topic], notes, log)
            parts.append((topic, (t - clock.offset_s) / (1.0 + clock.drift) + offset, cells))
        if share is not None:
            share((count + 1) / len(logs))
    _together(parts, notes)
    start = min(t[0] for _, t, _ in parts)
    # Seconds since 1970 leave floating point too few digits for microseconds of a trial.
    origin = float(np.floor(start)) if epoch is not None else 0.0
    frame: pl.DataFrame | None = None
    for _, t, cells in parts:
        stamps = np.round((t - origin) / SETTINGS.equal_s) * SETTINGS.equal_s
        # A full join keeps every sample at its own stamp; the resampling comes later.
        part = pl.DataFrame({"t_s": stamps, **cells}, nan_to_null=True).unique(
            "t_s", keep="last", maintain_order=True
        )
        frame = part if frame is None else frame.join(part, on="t_s", how="full", coalesce=True)
    assert frame is not None
    frame = frame.sort("t_s")
    return Joined(frame, None if epoch is None else epoch + origin, notes)


def _named(logs: Sequence[Log]) -> str:
    return ", ".join(log.path.name for log in logs)


def _epoch(logs: Sequence[Log], notes: list[Note]) -> float | None:
    """Unix time to which all logs are brought; None where not all have one."""
    known = [log.epoch_s for log in logs if log.epoch_s is not None]
    if len(known) == len(logs):
        return min(known)
    if known:
        without = ", ".join(log.path.name for log in logs if log.epoch_s is None)
        notes.append(Note.of("no Unix time", without))
    return None


def _parts(t: Array) -> list[tuple[int, int]]:
    """First row and the one after the last of each stretch of stamps (n,) in which the clock runs on.

    It begins again where it falls by two seconds and by a tenth of what went before, and stays there: a row
    out of order comes back at once.
    """
    parts, begin = [], 0
    for at in (np.flatnonzero(np.diff(t) < -SETTINGS.restart_s) + 1).tolist():
        before = t[begin:at].max(initial=-np.inf)
        fall = before - t[at]
        stays = np.all(t[at : at + SETTINGS.restart_rows] < before - 0.5 * fall)
        if stays and fall > max(SETTINGS.restart_s, SETTINGS.restart_share * (before - t[begin])):
            parts.append((begin, at))
            begin = at
    return [*parts, (begin, len(t))]


def _listed(names: Sequence[str], most: int = 20) -> str:
    """Names with a comma between them, the first ones of many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(printable(name, 40) for name in names[:most]) + more


def _ordered(
    topic: str, samples: Samples, columns: Sequence[Wanted], notes: list[Note], log: Log
) -> tuple[Array, dict[str, Array]]:
    """Rising stamps of a topic and its columns."""
    t = samples.t
    known = np.isfinite(t)
    if not known.any():
        why = log.timeless or (
            f"there are the columns {_listed(list(log.fields[topic]))}; name its time column (a bollard test"
            " without time is for seatrial bench)"
        )
        raise TrialError(f"{log.path}: topic {topic}: no row has a time; {why}")
    if not known.all():
        notes.append(Note.of("rows without time", topic, rows=int((~known).sum())))
    # Single damaged stamps first: each would look like a restart of the clock.
    rows = np.flatnonzero(known)[strays(t[known])]
    if len(rows):
        known[rows] = False
        first = {"row": int(rows[0]) + 1, "t_s": float(t[rows[0]])}
        notes.append(Note.of("stamps far", topic, rows=len(rows), **first))
    parts = _parts(t[known])
    if len(parts) > 1:
        rows, again = np.flatnonzero(known), parts[1][0]
        begin, end = max(parts, key=lambda part: part[1] - part[0])
        restart = Note.of(
            "time begins again",
            topic,
            times=len(parts) - 1,
            row=int(rows[again]) + 1,
            from_s=float(t[rows[again - 1]]),
            to_s=float(t[rows[again]]),
            taken=(int(rows[begin]) + 1, int(rows[end - 1]) + 1),
        )
        notes.append(restart)
        known[: rows[begin]] = known[rows[end - 1] + 1 :] = False
    # Rows of one recording may be written out of order, as by several threads.
    order = np.flatnonzero(known)[np.argsort(t[known], kind="stable")]
    moved = int((np.diff(t[known]) < 0.0).sum())
    if moved:
        notes.append(Note.of("time backwards", topic, times=moved))
    stamps = t[order]
    if (spread := spread_bursts(stamps)) is not None:
        stamps = spread.t
        notes.append(Note.of("bursts", topic, bursts=spread.bursts, step_s=spread.step_s))
    # Of rows with one stamp the last one is the newest.
    last = np.append(np.diff(stamps) > SETTINGS.equal_s / 2.0, True)
    if not last.all():
        notes.append(Note.of("equal stamps", topic, rows=int((~last).sum())))
    if np.count_nonzero(last) == 1:
        raise TrialError(
            f"{log.path}: topic {topic}: its rows with a time ({len(order):,}) all have the same one,"
            f" {stamps[0]:.10g} s; expected times that rise: write the time of each row"
        )
    order = order[last]
    cells = {}
    for column in columns:
        values = samples.fields[column.name][order]
        if column.per:
            with np.errstate(divide="ignore", invalid="ignore"):
                values = values / samples.fields[column.per][order]
        cells[column.column] = values
    return stamps[last], cells


def _together(parts: Sequence[tuple[str, Array, dict[str, Array]]], notes: list[Note]) -> None:
    """Note topics whose times hardly meet those of the others."""
    first, last = max(t[0] for _, t, _ in parts), min(t[-1] for _, t, _ in parts)
    if first >= last:
        spans = "; ".join(f"{topic} {t[0]:.10g} to {t[-1]:.10g} s" for topic, t, _ in parts[:6])
        raise TrialError(
            f"the times of the topics do not meet: {spans}; the logs' clocks differ in origin: give the"
            " offset of each under [clocks] in the map"
        )
    longest = max(t[-1] - t[0] for _, t, _ in parts)
    for topic, t, _ in parts:
        if t[-1] - t[0] < 0.5 * longest:
            notes.append(Note.of("short", topic, covered_s=float(t[-1] - t[0]), of_s=float(longest)))
