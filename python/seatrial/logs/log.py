"""A log of any format: topics with fields, read in chunks, and what each field holds.

A topic is what one instrument or process wrote at its own stamps: a message type, a ROS topic, a MOOS
variable, a CSV file. Every format gives the same three things: the topics with their fields, their samples in
chunks of bounded size, and notes on what could not be read. A reader converts nothing but time, which is in
seconds: units, signs and frames stay those of the log, and the column map converts them once
(`seatrial.trial.columns`).

A file's first bytes and its ending tell its format. A further format is one more function from a path to a
`Log` and one more row in `FORMATS`. Packages that only one format needs are imported when such a file is
opened.

A log is untrusted: a reader never executes what a file holds, allocates no more than a chunk for what a
header promises, and reads a damaged file up to where it is damaged, with a note.
"""

from __future__ import annotations

import gzip
import math
import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from importlib import import_module
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.budget import Budget, advance, guarded, size_of
from seatrial.base.errors import TrialError, nearest, printable, reason
from seatrial.base.finding import Finding, Severity


@dataclass(frozen=True)
class ReadingSettings:
    """How much of a log is kept, read at a time and told."""

    chunk_rows: int = 65_536  #: most rows of a chunk: it bounds the memory, not what a log may hold
    most_notes: int = 200  #: more tell nobody more
    most_topics: int = 10_000  #: a log with more is damaged or hostile
    most_fields: int = 10_000  #: the same: a PX4 log has some 3,000 fields
    most_named: int = 12  #: names in a message
    #: longer ones are images, point clouds or spectra and no channels of a trial; a covariance has 36
    longest_array: int = 36


READING_SETTINGS = ReadingSettings()


Share = Callable[[float], None]
"""Called with the share of the file that was read, 0 to 1."""


class Chunk(NamedTuple):
    """Samples of one topic in the order of the file."""

    topic: str  #: Its name.
    t: Array  #: Stamps in s, shape (n,), in the log's own clock; NaN where a row has none.
    values: Array  #: The fields asked for, shape (n, k); NaN where a cell is empty or no number.


class Note(Finding):
    """What a reader left out or assumed; as text the words of `seatrial.report.results.trial_findings`."""

    @classmethod
    def of(cls, kind: str, subject: str = "", **values: Any) -> Note:
        """A note of a kind about a topic or column."""
        return cls(kind, Severity.NOTE, subject, values)

    def __str__(self) -> str:
        return str(import_module("seatrial.report.results.trial_findings").note(self))


class Event(NamedTuple):
    """Something a log says in words: a change of mode, a message of the autopilot. `t` in s."""

    t: float
    kind: str
    text: str


class Samples(NamedTuple):
    """All samples of one topic: stamps in s, shape (n,), and by field an array (n,)."""

    t: Array
    fields: dict[str, Array]


class Field(NamedTuple):
    """What one field of a topic holds."""

    name: str  #: Within its topic; ``topic.field`` in a column map.
    unit: str  #: As the log states it; "" where it does not.
    samples: int  #: Finite numbers.
    #: Of these, in the unit of the log; NaN where there are none.
    minimum: float
    maximum: float
    mean: float
    deviation: float
    #: Share of the samples that equal the one before: near 1 for a value that was only written again.
    repeated: float


@dataclass(frozen=True)
class Topic:
    """What one topic holds."""

    #: Its name, and its rows.
    name: str
    samples: int
    #: First and last stamp, in the log's own clock.
    start_s: float
    end_s: float
    interval_s: float  #: Median time between samples.
    longest_s: float  #: Longest time between samples.
    disordered: int  #: Rows whose stamp is not later than the one before.
    fields: tuple[Field, ...]  #: In the order of the log.
    kind: str = ""  #: Message type, where the format states one: it says more than a field's name.
    of_file: bool = False  #: Whether its name is that of the file, which says nothing about its fields.

    @property
    def rate_hz(self) -> float:
        """Mean rate over the time between the first and last stamp; 0 for fewer than two different stamps."""
        span = self.end_s - self.start_s
        return (self.samples - 1) / span if self.samples > 1 and span > 0.0 else 0.0


@dataclass
class Log(ABC):
    """A log that is open for reading."""

    #: The file, and the name of its format.
    path: Path
    format: str
    #: What could not be read and why; complete after everything was read once.
    findings: list[Note] = field(default_factory=list)
    #: Unix time of stamp zero, s; None where the log does not say. Logs with an epoch share a clock.
    epoch_s: float | None = None
    #: Parameters of the vehicle that the log carries, by name.
    parameters: dict[str, float] = field(default_factory=dict)
    #: How something was read that the log does not state; nothing was lost by it.
    assumptions: list[Note] = field(default_factory=list)
    timeless: Note | None = None  #: Why no row has a time; None where the log has no column for it.
    units_in: str = ""  #: Where a row of the file states the units, as "line 3"; "" where none does.
    #: What the fields without numbers hold instead, by topic and field.
    words: dict[tuple[str, str], str] = field(default_factory=dict)
    kinds: dict[str, str] = field(default_factory=dict)  #: Message type by topic, where the format states it.
    of_file: set[str] = field(default_factory=set)  #: Topics that are called by the file.
    budget: Budget = field(default_factory=Budget)  #: What reading it may cost.

    @property
    @abstractmethod
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Unit ("" where not stated) by field, by topic."""

    @abstractmethod
    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the fields `wanted` by topic, in chunks of at most so many rows."""

    def events(self) -> list[Event]:
        """What the log says in words, in the order of time."""
        return []

    def topics(self, share: Share | None = None) -> list[Topic]:
        """What every topic and field holds, from one pass over the log."""
        with self.guarded():
            wanted = {topic: tuple(fields) for topic, fields in self.fields.items()}
            surveys = {topic: _Survey(fields) for topic, fields in wanted.items()}
            for chunk in self.chunks(wanted, share):
                surveys[chunk.topic].add(chunk)
            surveyed = [
                survey.topic(name, self.fields[name])
                for name, survey in surveys.items()
                if survey.samples > 0
            ]
        return [
            replace(topic, kind=self.kinds.get(topic.name, ""), of_file=topic.name in self.of_file)
            for topic in surveyed
        ]

    def read(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> dict[str, Samples]:
        """All samples of some fields by topic."""
        for topic, names in wanted.items():
            if topic not in self.fields:
                raise TrialError(f'{self.path}: there is no topic "{topic}"{nearest(topic, self.fields)}')
            for name in names:
                if name not in self.fields[topic]:
                    near = nearest(name, self.fields[topic])
                    raise TrialError(f'{self.path}: topic "{topic}" has no field "{name}"{near}')
        with self.guarded():
            parts: dict[str, list[Chunk]] = {topic: [] for topic in wanted}
            for chunk in self.chunks(wanted, share):
                parts[chunk.topic].append(chunk)
            result = {}
            for topic, chunks in parts.items():
                names = wanted[topic]
                t = np.concatenate([chunk.t for chunk in chunks]) if chunks else np.empty(0)
                values = np.concatenate([c.values for c in chunks]) if chunks else np.empty((0, len(names)))
                result[topic] = Samples(t, {name: values[:, k] for k, name in enumerate(names)})
        return result

    def guarded(self) -> AbstractContextManager[None]:
        """What holds a block that reads the log to its budget, and makes one sentence of what it raises."""
        return reading(self.path, self.format, self.budget)

    @property
    def notes(self) -> list[str]:
        """The findings in words."""
        return list(map(str, self.findings))

    @property
    def remarks(self) -> list[str]:
        """The assumptions in words."""
        return list(map(str, self.assumptions))

    def note(self, kind: str, subject: str = "", **values: Any) -> None:
        """Keep a finding, once; of very many only the first."""
        _keep(Note.of(kind, subject, **values), self.findings)

    def remark(self, kind: str, subject: str = "", **values: Any) -> None:
        """Keep an assumption, once."""
        _keep(Note.of(kind, subject, **values), self.assumptions)


def _keep(note: Note, notes: list[Note]) -> None:
    if len(notes) < READING_SETTINGS.most_notes and note not in notes:
        notes.append(note)


class _Survey:
    """Sums over the chunks of one topic."""

    INTERVALS = 100_000  # enough for a median

    def __init__(self, fields: Sequence[str]) -> None:
        k = len(fields)
        self.names = fields
        self.samples = 0
        self.start, self.end = math.inf, -math.inf
        self.last_t = math.nan
        self.longest, self.disordered = 0.0, 0
        self.intervals: list[Array] = []
        self.kept = 0
        self.count, self.repeated = np.zeros(k, int), np.zeros(k, int)
        self.minimum, self.maximum = np.full(k, np.inf), np.full(k, -np.inf)
        self.mean, self.squares = np.zeros(k), np.zeros(k)
        self.last = np.full(k, np.nan)

    def add(self, chunk: Chunk) -> None:
        """Take in a chunk."""
        self.samples += len(chunk.t)
        self._stamps(chunk.t[np.isfinite(chunk.t)])
        values = chunk.values
        before = np.vstack([self.last, values[:-1]])
        self.repeated += (values == before).sum(axis=0)
        self.last = values[-1]
        finite = np.isfinite(values)
        count = finite.sum(axis=0)
        some = count > 0
        filled = np.where(finite, values, 0.0)
        with np.errstate(over="ignore", invalid="ignore"):
            mean = filled.sum(axis=0) / np.maximum(count, 1)
            squares = (np.where(finite, values - mean, 0.0) ** 2).sum(axis=0)
            # Chan, Golub and LeVeque's rule joins the moments of two parts.
            total = self.count + count
            shift = mean - self.mean
            share = count / np.maximum(total, 1)
            self.squares += np.where(some, squares + shift**2 * self.count * share, 0.0)
            self.mean += np.where(some, shift * share, 0.0)
        self.minimum = np.fmin(self.minimum, np.where(finite, values, np.inf).min(axis=0))
        self.maximum = np.fmax(self.maximum, np.where(finite, values, -np.inf).max(axis=0))
        self.count = total

    def _stamps(self, t: Array) -> None:
        if not len(t):
            return
        self.start, self.end = min(self.start, float(t.min())), max(self.end, float(t.max()))
        steps = np.diff(t, prepend=self.last_t)
        steps = steps[np.isfinite(steps)]
        self.last_t = float(t[-1])
        self.longest = max(self.longest, float(steps.max(initial=0.0)))
        self.disordered += int((steps <= 0.0).sum())
        if self.kept < self.INTERVALS:
            self.intervals.append(steps[steps > 0.0][: self.INTERVALS])
            self.kept += len(self.intervals[-1])

    def topic(self, name: str, units: Mapping[str, str]) -> Topic:
        """What was seen."""
        steps = np.concatenate(self.intervals) if self.intervals else np.empty(0)
        none = self.count == 0
        with np.errstate(over="ignore", invalid="ignore"):
            deviation = np.sqrt(self.squares / np.maximum(self.count, 1))
        columns = zip(
            np.where(none, np.nan, self.minimum).tolist(),
            np.where(none, np.nan, self.maximum).tolist(),
            np.where(none, np.nan, self.mean).tolist(),
            np.where(none, np.nan, deviation).tolist(),
            (self.repeated / max(self.samples - 1, 1)).tolist(),
            strict=True,
        )
        known = math.isfinite(self.start)
        return Topic(
            name,
            self.samples,
            self.start if known else math.nan,
            self.end if known else math.nan,
            float(np.median(steps)) if len(steps) else math.nan,
            self.longest if len(steps) else math.nan,
            self.disordered,
            tuple(
                Field(field, units[field], int(count), *numbers)
                for field, count, numbers in zip(self.names, self.count, columns, strict=True)
            ),
        )


def reading(path: Path, format: str, budget: Budget) -> AbstractContextManager[None]:
    """What holds the reading of a file of a format to its budget."""
    remedy = "fetch or write the file again; if it is another format, name its reader"
    return guarded(path, f"reading it as {format}", remedy, size=size_of(path), budget=budget)


def listed(names: Sequence[str]) -> str:
    """The first of `names` for a message, and how many more there are."""
    shown = ", ".join(f'"{printable(name)}"' for name in names[: READING_SETTINGS.most_named])
    return shown + (
        f" and {len(names) - READING_SETTINGS.most_named} more"
        if len(names) > READING_SETTINGS.most_named
        else ""
    )


def stem_of(path: Path) -> str:
    """Name of a file without its ending as text; bytes that are not UTF-8 are replaced."""
    return path.stem.encode(errors="surrogateescape").decode(errors="replace")


class Gathered:
    """Rows of the fields wanted, by topic."""

    def __init__(self, wanted: Mapping[str, Sequence[str]]) -> None:
        self.wanted = wanted
        self.rows: dict[str, list[list[float]]] = {topic: [] for topic in wanted}

    def add(self, topic: str, t: float, values: Mapping[str, float]) -> Chunk | None:
        """Take in a message; a chunk when enough are there."""
        rows = self.rows[topic]
        rows.append([t, *map(values.get, self.wanted[topic], repeat(math.nan))])
        return self._take(topic) if len(rows) >= READING_SETTINGS.chunk_rows else None

    def rest(self) -> Iterator[Chunk]:
        """What is left at the end of the file."""
        for topic, rows in self.rows.items():
            if rows:
                yield self._take(topic)

    def _take(self, topic: str) -> Chunk:
        values = np.array(self.rows[topic], float)
        self.rows[topic] = []
        return Chunk(topic, values[:, 0], values[:, 1:])


def number(value: object) -> float | None:
    """A number or truth value as a float; None for anything else.

    Examples
    --------
    >>> number(True), number(3), number("3"), number(2**2000)
    (1.0, 3.0, None, inf)
    """
    if isinstance(value, bool | int | float | np.number | np.bool_):
        try:
            return float(value)
        except OverflowError:
            return math.inf
    return None


DAMAGED = (OSError, EOFError, zlib.error)
"""What reading a file raises that is damaged or packed and cut short."""


@dataclass(frozen=True)
class Format:
    """A format of logs: the function that opens it, its file endings, how its files begin, what it is.

    ``cpu_s_per_mb`` is the processor time that an honest file may take per MB and pass, s: some five times
    the 0.9 (MAVLink of short messages, MCAP, ROS bags, chunks packed several times), 0.5 (IMC), 0.2 (MOOS,
    text of DataFlash) and 0.05 s/MB (tables, arrays) that were measured.
    """

    reader: str  #: ``bags.mcap`` is the function ``open_mcap`` of the module ``bags``.
    endings: tuple[str, ...]
    magic: tuple[bytes, ...]
    description: str
    cpu_s_per_mb: float = 0.2

    @property
    def budget(self) -> Budget:
        """What reading a file of this format may cost."""
        return Budget(cpu_s_per_mb=self.cpu_s_per_mb)


_IMC_MARKS = (b"\x54\xfe", b"\xfe\x54")  # synchronisation number in either order of bytes

FORMATS: dict[str, Format] = {
    "dataflash": Format("dataflash.log", (".bin",), (b"\xa3\x95", b"FMT, "), "ArduPilot DataFlash log", 1.0),
    "mavlink": Format("mavlink.log", (".tlog",), (), "MAVLink telemetry log", 5.0),
    "ulog": Format("ulog.log", (".ulg", ".ulog"), (b"ULog\x01\x12\x35",), "PX4 ULog", 0.3),
    "rosbag": Format("bags.bag", (".bag", ".db3"), (b"#ROSBAG V", b"SQLite format 3"), "ROS bag", 5.0),
    "mcap": Format("bags.mcap", (".mcap",), (b"\x89MCAP",), "MCAP", 5.0),
    "matlab": Format("array_files.matlab", (".mat",), (b"MATLAB ", b"\x89HDF\r\n"), "MATLAB file"),
    "moos": Format("middleware.moos", (".alog",), (b"%%",), "MOOS alog", 1.0),
    "imc": Format("middleware.imc", (".lsf", ".lsf.gz"), _IMC_MARKS, "IMC log of DUNE (LSF)", 3.0),
    "parquet": Format("array_files.parquet", (".parquet", ".pq"), (b"PAR1",), "Apache Parquet", 0.3),
    "csv": Format("delimited.table", (".csv", ".tsv", ".txt", ".dat", ".csv.gz"), (), "table of text"),
}
"""Formats by name."""

_BINARY = ("dataflash", "mavlink", "ulog", "rosbag", "mcap", "matlab", "imc", "parquet")
_TEXT = frozenset(b"\t\n\r") | frozenset(range(32, 127))  # a binary log with another name is no such text


@dataclass(frozen=True)
class FormatSettings:
    """How much of a file is read to tell its format, or unpacked at a time."""

    head_bytes: int = 512  #: in which the signatures of all formats lie, the tag of a TAR file last
    unpacked_bytes: int = 65_536  #: that are unpacked at a time
    packing_ratio: float = 10.0  #: times as long is what gzip packed
    #: s that a second look has whatever opening took: with it both stay within 10 s
    least_budget_s: float = 2.0


SETTINGS = FormatSettings()


def format_of(path: Path) -> str:
    """Name of the format of a file; of a ROS 2 bag also its folder."""
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return "rosbag"
        raise TrialError(f"{path}: expected a log, but this is a folder; give its files")
    if path.is_symlink() and not path.exists():
        raise TrialError(
            f"{path}: expected a log, but this is a link that leads to no file, or back to itself; give the"
            " path of the file"
        )
    if not path.exists():
        raise TrialError(f"{path}: expected a log, but this does not exist; give the path of a file")
    if not path.is_file():
        raise TrialError(f"{path}: expected a log, but this is no regular file; give the path of a file")
    head = _head(path)
    if not head:
        raise TrialError(f"{path}: the file is empty; expected a log")
    for name, entry in FORMATS.items():
        if head.startswith(entry.magic) and entry.magic:
            return name
    # A telemetry log begins with a stamp in us, then the mark of a MAVLink frame.
    if len(head) > 8 and head[8] in (0xFD, 0xFE) and 9e14 < int.from_bytes(head[:8], "big") < 5e15:
        return "mavlink"
    ending = path.name.lower()
    text = all(byte in _TEXT for byte in head)
    for name, entry in FORMATS.items():
        if ending.endswith(entry.endings) and not (text and name in _BINARY):
            return name
    if b"\0" not in head or head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "csv"
    known = ", ".join(f"{entry.description} ({'/'.join(entry.endings)})" for entry in FORMATS.values())
    raise TrialError(f"{path}: no known format; expected one of: {known}")


def open_log(path: str | Path, reader: str | Callable[[Path], Log] | None = None) -> Log:
    """A log, open for reading.

    Parameters
    ----------
    path
        File, or folder of a ROS 2 bag.
    reader
        Name of a format in `FORMATS`, or a function from a path to a `Log`; told from the file when omitted.

    Raises
    ------
    TrialError
        If the file is in no known format, is not what it says it is, or a package is missing.
    """
    path = Path(path)
    if callable(reader):
        return reader(path)
    if reader is not None and reader not in FORMATS:
        raise TrialError(f'{path}: unknown reader "{reader}"{nearest(reader, FORMATS)}')
    name = format_of(path) if reader is None else reader
    entry = FORMATS[name]
    budget = entry.budget
    if not path.is_dir() and is_packed(path):
        budget = replace(budget, cpu_s_per_mb=SETTINGS.packing_ratio * budget.cpu_s_per_mb)
    begun_s = time.thread_time()
    with reading(path, entry.description, budget):
        module, _, kind = entry.reader.partition(".")
        log: Log = getattr(import_module(f"seatrial.logs.{module}"), f"open_{kind}")(path)
    # What a file of any small size may take, it takes once: opening reads some formats as a whole.
    log.budget = replace(
        budget, cpu_s=max(budget.cpu_s - time.thread_time() + begun_s, SETTINGS.least_budget_s)
    )
    return log


def extra(package: str, path: Path) -> Any:
    """A package that only some formats need."""
    try:
        return import_module(package)
    except ImportError:
        raise TrialError(
            f'{path}: reading this format needs the package "{package.partition(".")[0]}", which is not '
            "installed; install the readers: pip install 'seatrial[logs]'"
        ) from None


class Unpacked:
    """A packed stream: all that is before the damage, and no more than honest text unpacks to."""

    def __init__(self, path: Path, opener: Callable[..., Any] = gzip.open) -> None:
        self._path, self._size = path, path.stat().st_size
        self._file = path.open("rb")
        self._stream = opener(self._file, "rb")
        self.tell = self._file.tell
        self._given = 0  # bytes so far
        self._failed: Exception | None = None

    def read(self, size: int) -> bytes:
        """`size` bytes, fewer at the end or before the damage."""
        if self._failed is not None:
            raise self._failed
        content = bytearray()
        try:
            while len(content) < size and (
                part := self._stream.read1(min(size - len(content), SETTINGS.unpacked_bytes))
            ):
                content += part
        except DAMAGED as error:
            if not content:
                raise
            self._failed = error
        self._given += len(content)
        advance(self.tell() / self._size)
        if self._given > Budget().stream_of(packed := self.tell()):
            raise TrialError(
                f"{self._path}: its first {packed:,} bytes unpack to {self._given:,}; no log is packed more"
                f" than {Budget().unpacked_ratio:g} times: it is made to fill the memory, fetch it again"
            )
        return bytes(content)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()
        self._file.close()


def is_packed(path: Path) -> bool:
    """Whether gzip packed a file."""
    with path.open("rb") as stream:
        return stream.read(2) == b"\x1f\x8b"


def unpacked(path: Path) -> Any:
    """A binary stream of a file, unpacked where gzip packed it; its `tell` is the place in the file."""
    return Unpacked(path) if is_packed(path) else path.open("rb")


def _head(path: Path) -> bytes:
    try:
        with unpacked(path) as stream:
            head: bytes = stream.read(SETTINGS.head_bytes)
    except DAMAGED as error:
        raise TrialError(f"{path}: cannot be read: {reason(error)}") from None
    return head
