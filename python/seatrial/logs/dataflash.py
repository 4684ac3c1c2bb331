"""ArduPilot DataFlash logs (`.bin`, and `.log` of text).

A message type is a topic, ``IMU[0]`` where the type counts instances. Stamps are TimeUS, the time since the
autopilot booted; `epoch_s` comes from the first GPS fix. Units are those of the log's FMTU messages where
it has them. Format: ArduPilot, AP_Logger, LogStructure.

A message is its header (A3 95 and the number of its type) and a body whose length the FMT message of the
type states; nothing marks its end. It counts where the next header, or the end of the log, follows its last
byte: so a damaged header costs two messages, and reading goes on at the next header. What was skipped is
noted with its place and its time. The file is mapped, not loaded, and passed over block by block; what stays
is the place of every message, four bytes each below 4 GiB.
"""

from __future__ import annotations

import contextlib
import itertools
import mmap
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.logs.clock import Counter32
from seatrial.logs.log import READING_SETTINGS, Chunk, Event, Gathered, Log, Note, Share, extra

_CODES = {
    "b": "i1", "B": "u1", "M": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8",
    "f": "<f4", "d": "<f8", "g": "<f2", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4",
    "n": "S4", "N": "S16", "Z": "S64", "a": "S64",
}  # fmt: skip
_SCALED = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
_INSTANCES = ("I", "Inst", "Instance", "C")  # of types whose FMTU is not logged
_NOT_COUNTED = {"MODE", "PARM", "FMT", "FMTU", "MSG", "UNIT", "MULT", "CMD"}
_GPS_EPOCH_S, _LEAP_S, _WEEK_S = 315_964_800.0, 18.0, 604_800.0  # 6 January 1980; leap seconds since 2017

_TABLES = {"FMT", "FMTU", "UNIT", "MULT"}  # of the log itself: no measurements
_PREFIXES = {1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "µ", 1e-9: "n"}

_HEADER = b"\xa3\x95"
_FMT, _FMT_BYTES = 128, 89  # the message that describes a type: its number and length, by ArduPilot's format
_NARROW = 4  # bytes of a stamp that a counter of 32 bits made


@dataclass(frozen=True)
class DataflashSettings:
    """How much of a log is looked at together, and which instances are damaged numbers."""

    longest_message: int = 255  #: bytes of a message
    search_bytes: int = 1 << 24  #: bytes in which messages are looked for
    read_bytes: int = 1 << 26  #: bytes that are read at a time
    checked_messages: int = 1 << 20  #: messages whose stamps are looked at together
    median_messages: int = 64  #: messages whose median stamp is compared with those before and after
    stray_share: float = 0.002  #: of a damaged log's messages below which an instance is a damaged number


SETTINGS = DataflashSettings()


Bytes = np.ndarray[Any, np.dtype[np.uint8]]
Places = np.ndarray[Any, np.dtype[np.integer[Any]]]


@dataclass(frozen=True)
class _Type:
    """A message type: its packed layout, names and units of its columns, the instance column, its offsets."""

    name: str
    layout: np.dtype[Any]
    codes: str
    units: tuple[str, ...]
    instance: str | None
    offsets: Places


def open_log(path: Path) -> Log:
    """DataFlash log, binary or text; TrialError if the file is no DataFlash log."""
    with path.open("rb") as stream:
        head = stream.read(4)
        if head == b"FMT,":
            return _TextLog(path, "dataflash")
        if not head:
            raise TrialError(f"{path}: the file is empty; expected a log")
        data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    return _BinaryLog(path, "dataflash", data=data)


@dataclass
class _BinaryLog(Log):
    data: mmap.mmap = field(kw_only=True, repr=False)

    def __post_init__(self) -> None:
        self._raw: Bytes = np.frombuffer(self.data, np.uint8)
        forms = dict(self._forms())
        lengths = np.zeros(256, np.int64)
        for number, (length, kind) in forms.items():
            lengths[number] = length
            if isinstance(kind, Note):
                self.note(kind.kind, kind.subject, **kind.values)
        self._numbered = {n: kind for n, (_, kind) in forms.items() if isinstance(kind, _Type)}
        begins, numbers = _messages(self._raw, lengths, self._release)
        self._damaged = self._report_damage(begins, numbers, lengths)
        if self._damaged:
            near = self._near_in_time(begins, numbers)
            begins, numbers = begins[near], numbers[near]
        self._types: dict[str, _Type] = {}
        for number, kind in self._numbered.items():
            if len(own := begins[numbers == number]):
                self._types[kind.name] = replace(kind, offsets=own)
        if not self._types:
            raise TrialError(
                f"{self.path}: no DataFlash message in it, or its format messages are damaged: fetch the file"
                " from the vehicle again; is it another .bin file?"
            )
        self._name_units()
        self.epoch_s = self._epoch()
        self.parameters = self._parameters()
        self._release()

    def _release(self) -> None:
        """Give back the pages of the file that were read: a log larger than the memory is read as well."""
        if hasattr(mmap, "MADV_DONTNEED"):
            self.data.madvise(mmap.MADV_DONTNEED)

    def _forms(self) -> Iterator[tuple[int, tuple[int, _Type | Note]]]:
        """Length and type (or why it is left out) by number, from the FMT messages."""
        for at in self._found(_HEADER + bytes([_FMT])):
            body = self.data[at + 3 : at + _FMT_BYTES]
            if len(body) < _FMT_BYTES - 3:
                return
            cells = struct.unpack("<BB4s16s64s", body)
            number, length = int(cells[0]), int(cells[1])
            name, codes, columns = (_plain(cell) for cell in cells[2:])
            codes_known = set(codes) <= _CODES.keys() and columns.isprintable()
            if not re.fullmatch(r"\w{1,4}", name, re.ASCII) or not codes_known or length < 3:
                continue  # damaged: as if it were not there
            if number == _FMT and length != _FMT_BYTES:
                continue
            names = columns.split(",") if columns else []
            if len(names) != len(codes) or len(set(names)) != len(names) or not all(names):
                counts = {"values": len(codes), "columns": len(names)}
                yield number, (length, Note.of("columns and values differ", name, **counts))
                continue
            layout = np.dtype([(name, _CODES[code]) for name, code in zip(names, codes, strict=True)])
            if layout.itemsize + 3 != length:
                sizes = {"expected": layout.itemsize + 3, "stated": length}
                yield number, (length, Note.of("length differs", name, **sizes))
                continue
            counters = (n for n in _INSTANCES if n in names and codes[names.index(n)] in "bB")
            instance = None if name in _NOT_COUNTED else next(counters, None)
            none = np.empty(0, np.int64)
            yield number, (length, _Type(name, layout, codes, ("",) * len(names), instance, none))

    def _found(self, mark: bytes) -> Iterator[int]:
        """Places of some bytes in the file."""
        for begin in range(0, len(self.data), SETTINGS.read_bytes):
            at = begin - 1
            while (at := self.data.find(mark, at + 1, begin + SETTINGS.read_bytes + len(mark) - 1)) >= 0:
                yield at
            self._release()

    def _name_units(self) -> None:
        """Give the types the units and instance columns of the log's FMTU, UNIT and MULT messages."""
        labels = {chr(row["Id"]): _plain(row["Label"]) for row in self._table("UNIT", "Id", "Label")}
        factors = {chr(row["Id"]): float(f"{row['Mult']:.7g}") for row in self._table("MULT", "Id", "Mult")}
        for row in self._table("FMTU", "FmtType", "UnitIds", "MultIds"):
            numbered = self._numbered.get(int(row["FmtType"]))
            kind = None if numbered is None else self._types.get(numbered.name)
            if kind is None:
                continue
            columns = kind.layout.names or ()
            ids, scales = _plain(row["UnitIds"]), _plain(row["MultIds"])
            units = []
            for k, code in enumerate(kind.codes):
                unit = labels.get(ids[k : k + 1], "")
                factor = factors.get(scales[k : k + 1], 0.0)
                if unit and code not in _SCALED and factor not in (0.0, 1.0):
                    unit = _PREFIXES[factor] + unit if factor in _PREFIXES else f"{factor:.4g} {unit}"
                units.append(unit)
            counted = ids.find("#")
            instance = columns[counted] if 0 <= counted < len(columns) else kind.instance
            self._types[kind.name] = replace(kind, units=tuple(units), instance=instance)

    def _table(self, name: str, *columns: str) -> np.ndarray[Any, Any] | list[Any]:
        """Messages of a type of the log itself; none where it lacks a column."""
        kind = self._types.get(name)
        return self._rows(kind) if kind is not None and set(columns) <= set(kind.layout.names or ()) else []

    def _rows(self, kind: _Type, begin: int = 0, end: int | None = None) -> np.ndarray[Any, Any]:
        """Messages of a type as records."""
        where, width = kind.offsets[begin:end], kind.layout.itemsize
        cells = np.empty((len(where), width), np.uint8)
        ends = np.searchsorted(
            where, np.arange(SETTINGS.read_bytes, len(self._raw) + SETTINGS.read_bytes, SETTINGS.read_bytes)
        ).tolist()
        for first, last in itertools.pairwise([0, *ends]):
            if first < last:
                cells[first:last] = self._raw[where[first:last, None] + np.arange(3, width + 3)]
            if 0 < first < last:
                self._release()
        return cells.view(kind.layout)[:, 0] if width else np.empty(len(where), kind.layout)

    def _numbers(self, kind: _Type, rows: np.ndarray[Any, Any], name: str) -> Array:
        code = kind.codes[(kind.layout.names or ()).index(name)]
        with np.errstate(invalid="ignore"):  # a damaged number that is no number
            return np.asarray(rows[name].astype(float) * _SCALED.get(code, 1.0))

    def _stamps(self, kind: _Type, rows: np.ndarray[Any, Any], where: Places | None = None) -> Array:
        """Stamps of rows, s; those at the places `where` with the rounds of a counter of 32 bits."""
        names = kind.layout.names or ()
        for name, factor in (("TimeUS", 1e-6), ("TimeMS", 1e-3)):
            if name in names:
                stamps = rows[name].astype(float)
                if rows[name].dtype.itemsize == _NARROW and where is not None:
                    stamps += 2.0**32 * np.searchsorted(self._began_again, where, side="right")
                return np.asarray(stamps * factor)
        return np.full(len(rows), np.nan)

    @cached_property
    def _began_again(self) -> Places:
        """Places of the messages at which a counter of 32 bits went past its end: messages are in order."""
        kinds = [
            kind
            for kind in self._types.values()
            for name in ("TimeUS", "TimeMS")
            if name in (kind.layout.names or ()) and kind.layout[name].itemsize == _NARROW
        ]
        if not kinds:
            return np.empty(0, np.int64)
        places = np.concatenate([kind.offsets.astype(np.int64) for kind in kinds])
        counts = np.concatenate([self._counts(kind) for kind in kinds])
        order = np.argsort(places)
        places, counts = places[order], Counter32().of(counts[order])
        rounds = np.floor(np.maximum.accumulate(counts) / 2.0**32)
        return np.asarray(places[1:][np.diff(rounds) > 0.0])

    def _counts(self, kind: _Type) -> Array:
        name = next(name for name in ("TimeUS", "TimeMS") if name in (kind.layout.names or ()))
        step = READING_SETTINGS.chunk_rows
        begins = range(0, len(kind.offsets), step)
        return np.concatenate([self._rows(kind, k, k + step)[name].astype(float) for k in begins])

    @cached_property
    def _instances(self) -> dict[str, tuple[int, ...]]:
        """Instances by type."""
        instances: dict[str, tuple[int, ...]] = {}
        for name, kind in self._types.items():
            if kind.instance is not None:
                seen: Counter[int] = Counter()
                for begin in range(0, len(kind.offsets), READING_SETTINGS.chunk_rows):
                    rows = self._rows(kind, begin, begin + READING_SETTINGS.chunk_rows)
                    if rows[kind.instance].dtype.kind in "iu":
                        ones, counts = np.unique(rows[kind.instance], return_counts=True)
                        seen.update(dict(zip(ones.tolist(), counts.tolist(), strict=True)))
                least = max(SETTINGS.stray_share * len(kind.offsets), 1.0) if self._damaged else 0.0
                instances[name] = tuple(
                    sorted(instance for instance, count in seen.items() if count > least)
                ) or tuple(seen)
        return instances

    @cached_property
    def _topics(self) -> dict[str, tuple[str, int | None]]:
        """Type and instance by topic."""
        topics: dict[str, tuple[str, int | None]] = {}
        for name in (name for name in self._types if name not in _TABLES):
            for instance in self._instances.get(name) or (None,):
                topics[name if instance is None else f"{name}[{instance}]"] = (name, instance)
        return topics

    @cached_property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Units by field by topic; text is no field."""
        result = {}
        for topic, (name, _) in self._topics.items():
            kind = self._types[name]
            columns = zip(kind.layout.names or (), kind.codes, kind.units, strict=True)
            result[topic] = {
                column: unit
                for column, code, unit in columns
                if code not in "nNZa" and column not in ("TimeUS", "TimeMS", kind.instance)
            }
        return result

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the fields wanted, part of the file after part, type after type in each."""
        by_type: dict[str, list[str]] = {}
        for topic in wanted:
            by_type.setdefault(self._topics[topic][0], []).append(topic)
        size = max(len(self._raw), 1)
        for end in range(SETTINGS.read_bytes, size + SETTINGS.read_bytes, SETTINGS.read_bytes):
            for name, topics in by_type.items():
                kind = self._types[name]
                first, last = np.searchsorted(kind.offsets, (end - SETTINGS.read_bytes, end)).tolist()
                for begin in range(first, last, READING_SETTINGS.chunk_rows):
                    rows = self._rows(kind, begin, min(begin + READING_SETTINGS.chunk_rows, last))
                    offsets = kind.offsets[begin : begin + len(rows)]
                    stamps = self._stamps(kind, rows, offsets)
                    for topic in topics:
                        instance = self._topics[topic][1]
                        mine = slice(None) if instance is None else rows[kind.instance] == instance
                        own = rows[mine]
                        if len(own):
                            columns = [self._numbers(kind, own, column) for column in wanted[topic]]
                            values = np.stack(columns, axis=1) if columns else np.empty((len(own), 0))
                            yield Chunk(topic, stamps[mine], values)
            self._release()
            if share is not None:
                share(min(end / size, 1.0))

    def _text(self, kind: _Type, rows: np.ndarray[Any, Any], name: str) -> list[str]:
        return [cell.decode("utf-8", "replace") for cell in rows[name].tolist()]

    def _epoch(self) -> float | None:
        kind = self._types.get("GPS")
        if kind is None or not {"GWk", "GMS", "Status"} <= set(kind.layout.names or ()):
            return None
        rows = self._rows(kind)
        fixed = rows[(rows["Status"] >= 3) & (rows["GWk"] > 1000)]
        if not len(fixed):
            return None
        gps = fixed["GWk"][0] * _WEEK_S + fixed["GMS"][0] * 1e-3
        return float(_GPS_EPOCH_S + gps - _LEAP_S - self._stamps(kind, fixed[:1])[0])

    def _parameters(self) -> dict[str, float]:
        kind = self._types.get("PARM")
        if kind is None or not {"Name", "Value"} <= set(kind.layout.names or ()):
            return {}
        rows = self._rows(kind)
        values = self._numbers(kind, rows, "Value").tolist()
        return dict(zip(self._text(kind, rows, "Name"), values, strict=True))

    def events(self) -> list[Event]:
        """Changes of mode and messages of the autopilot."""
        events = []
        messages = self._types.get("MSG")
        if messages is not None and "Message" in (messages.layout.names or ()):
            rows = self._rows(messages)
            texts = self._text(messages, rows, "Message")
            stamps = self._stamps(messages, rows).tolist()
            events += [Event(t, "message", text) for t, text in zip(stamps, texts, strict=True)]
        kind = self._types.get("MODE")
        if kind is not None and "Mode" in (kind.layout.names or ()):
            names = _modes(self.path, [event.text for event in events])
            rows = self._rows(kind)
            for t, number in zip(self._stamps(kind, rows).tolist(), rows["Mode"].tolist(), strict=True):
                events.append(Event(t, "mode", names.get(int(number), str(number))))
        return sorted(events)

    def _report_damage(self, begins: Places, numbers: Bytes, lengths: Places) -> bool:
        """Note what is no whole message: how much, where, when; and a log that ends within a message.

        Whether there was any before the end.
        """
        size = len(self._raw)
        gaps, froms, tos = _gaps(begins, numbers, lengths, size)
        if len(gaps) and gaps[-1] == len(begins):
            tail = self.data[int(froms[-1]) :]
            begun = tail[:2] == _HEADER[: len(tail)]
            cut = begun and (len(tail) < 3 or len(tail) < lengths[tail[2]])
            if cut:
                self.note("cut within message", "message", bytes=len(tail))
            if cut or not tail.strip(b"\0") or not tail.strip(b"\xff"):  # a logger fills its last page
                gaps, froms, tos = gaps[:-1], froms[:-1], tos[:-1]
        if not len(gaps):
            return False
        widths = tos - froms
        longest = int(np.argmax(widths))
        worst = gaps[longest]
        self.note(
            "bytes lost",
            lost=int(widths.sum()),
            size=size,
            records=False,
            places=len(gaps),
            longest=int(widths.max()),
            byte=int(froms[longest]),
            since_s=self._when(begins[:worst], numbers[:worst]),
        )
        heads = self._raw[np.minimum(froms[:, None] + np.arange(3), size - 1)]
        foreign = (heads[:, 0] == _HEADER[0]) & (heads[:, 1] == _HEADER[1]) & (lengths[heads[:, 2]] == 0)
        counts = np.bincount(heads[foreign, 2], minlength=256)
        if counts.max() > 2:  # else a damaged number
            foreign_counts = {int(number): int(counts[number]) for number in np.flatnonzero(counts > 2)}
            self.note("types without format", counts=foreign_counts)
        return True

    def _near_in_time(self, begins: Places, numbers: Bytes) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Which messages of a damaged log are stamped like those around them in the file.

        They are written as they happen: a stamp that lies a second outside the medians of the messages before
        and after, `median_messages` at a time, is damaged itself.
        """
        stamped = np.zeros(256, bool)
        for number, kind in self._numbered.items():
            stamped[number] = (kind.layout.names or ("",))[0] == "TimeUS" and kind.codes[0] == "Q"
        counted = stamped[numbers]
        where = begins[counted]
        # Medians of blocks: damaged stamps in a block do not move them.
        parts = len(where) // SETTINGS.median_messages
        if parts < 2:
            return np.ones(len(begins), bool)

        def stamps(at: int) -> Array:
            cells = self._raw[where[at : at + SETTINGS.checked_messages, None] + np.arange(3, 11)]
            self._release()
            return np.asarray(cells.view("<u8")[:, 0].astype(float) * 1e-6)

        slices = range(0, len(where), SETTINGS.checked_messages)
        whole = (
            t[: len(t) - len(t) % SETTINGS.median_messages].reshape(-1, SETTINGS.median_messages)
            for t in map(stamps, slices)
        )
        middle = np.concatenate([np.median(t, axis=1) for t in whole])
        # Each block beside the one before and after: time goes on within a block, too.
        around = np.stack([np.r_[middle[0], middle[:-1]], middle, np.r_[middle[1:], middle[-1]]])
        least, most = around.min(axis=0), around.max(axis=0)
        slack = 1.0 + most - least
        near = np.empty(len(where), bool)
        for at in slices:
            t = stamps(at)
            part = np.minimum(np.arange(at, at + len(t)) // SETTINGS.median_messages, parts - 1)
            near[at : at + SETTINGS.checked_messages] = (t >= (least - slack)[part]) & (
                t <= (most + slack)[part]
            )
        if not near.all():
            self.note("stamps astray", count=int((~near).sum()))
        kept = np.ones(len(begins), bool)
        kept[counted] = near
        return kept

    def _when(self, begins: Places, numbers: Bytes) -> float:
        """Time of the last of some messages since the start of the autopilot, s; NaN where none has one."""
        for at, number in zip(begins[:-20:-1].tolist(), numbers[:-20:-1].tolist(), strict=True):
            kind = self._numbered.get(number)
            if kind is not None:
                t = self._stamps(kind, self._raw[at + 3 : at + 3 + kind.layout.itemsize].view(kind.layout))[0]
                if np.isfinite(t):
                    return float(t)
        return float("nan")


_LATER_SUB_MODES = {20: "MOTOR_DETECT", 21: "SURFTRAK"}
"""Modes of ArduSub 4.5 and later by their number (ArduSub's documentation), which pymavlink does not name."""


def _modes(path: Path, messages: Sequence[str]) -> dict[int, str]:
    """Name by number of the flight modes of the firmware that wrote the messages."""
    mavutil = extra("pymavlink.mavutil", path)
    tables = (
        ("ArduRover", "mode_mapping_rover"),
        ("ArduCopter", "mode_mapping_acm"),
        ("ArduPlane", "mode_mapping_apm"),
    )
    for firmware, table in tables:
        if any(firmware in text for text in messages):
            return dict(getattr(mavutil, table, {}))
    return _LATER_SUB_MODES | dict(getattr(mavutil, "mode_mapping_sub", {}))


@dataclass
class _TextLog(Log):
    """The text form: a line a message, FMT lines first."""

    def __post_init__(self) -> None:
        self._columns: dict[str, tuple[list[str], str]] = {}
        odd, line = 0, "\n"
        with self.path.open(encoding="utf-8", errors="replace") as stream:
            for line in stream:
                cells = [cell.strip() for cell in line.rstrip("\r\n").split(",")]
                known = self._columns.get(cells[0])
                odd += (known is None or len(cells) - 1 < len(known[0])) and cells[0] != "FMT"
                if cells[0] == "FMT" and len(cells) > 5:
                    self._columns[cells[3]] = (cells[5:], cells[4])
                elif cells[0] == "PARM" and len(cells) > 3:
                    with contextlib.suppress(ValueError):
                        self.parameters[cells[2]] = float(cells[3])
        if odd:
            self.note("lines of no type", count=odd)
        if not line.endswith("\n"):
            self.note("cut within line")

    @cached_property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Columns by type."""
        return {
            name: {
                column: ""
                for column, code in zip(columns, codes, strict=False)
                if code not in "nNZa" and column not in ("TimeUS", "TimeMS")
            }
            for name, (columns, codes) in self._columns.items()
            if name not in _TABLES
        }

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the columns wanted."""
        gathered = Gathered(wanted)
        counter = Counter32()  # lines are in the order of time
        size = max(self.path.stat().st_size, 1)
        done = 0
        with self.path.open("rb") as stream:
            for raw in stream:
                done += len(raw)
                cells = [cell.strip() for cell in raw.decode("utf-8", "replace").split(",")]
                name = cells[0]
                if name not in wanted:
                    continue
                columns = self._columns[name][0]
                values = dict(zip(columns, cells[1:], strict=False))
                time = _float(values.get("TimeUS")) * 1e-6
                if np.isnan(time):
                    counts = counter.of(np.array([_float(values.get("TimeMS"))]))
                    time = float(counts[0]) * 1e-3
                numbers = {column: _float(values.get(column)) for column in wanted[name]}
                if (chunk := gathered.add(name, time, numbers)) is not None:
                    yield chunk
                    if share is not None:
                        share(done / size)
        yield from gathered.rest()


def _float(cell: str | None) -> float:
    try:
        return float(cell) if cell else np.nan
    except ValueError:
        return np.nan


def _plain(cell: bytes) -> str:
    """Text of a cell of fixed width."""
    return bytes(cell).partition(b"\0")[0].decode("latin-1")


def _messages(data: Bytes, lengths: Places, release: Callable[[], None]) -> tuple[Places, Bytes]:
    """Begins and type numbers of the whole messages of a log, in its order.

    A header that is followed, after the length of its type, by another header or the end begins a message,
    unless it lies in a message that itself follows another: two bytes of a body may look like a header.
    """
    size = len(data)
    # Block-based loggers fill their last page with zeros or ones.
    filled = size
    for value in (0, 255):
        tail = data[max(size - 2 * SETTINGS.longest_message, 0) :] != value
        filled = min(filled, size - int(np.argmax(tail[::-1])) if tail.any() else size)
    place = np.dtype(np.uint32 if size < 1 << 32 else np.int64)
    begins, kinds = [np.empty(0, place)], [np.empty(0, np.uint8)]
    # Ends of messages, from the beginning of the block.
    marks = np.zeros(SETTINGS.search_bytes + SETTINGS.longest_message + 1, bool)
    marks[0] = True
    reach = 0
    for block in range(0, size - 2, SETTINGS.search_bytes):
        part = data[block : block + SETTINGS.search_bytes + 2]
        at = block + np.flatnonzero((part[:-2] == _HEADER[0]) & (part[1:-1] == _HEADER[1]))
        numbers = data[at + 2]
        ends = at + lengths[numbers]
        whole = (lengths[numbers] > 0) & (ends <= size)
        at, numbers, ends = at[whole], numbers[whole], ends[whole]
        first, second = data[np.minimum(ends, size - 1)], data[np.minimum(ends + 1, size - 1)]
        next_begins = (first == _HEADER[0]) & ((second == _HEADER[1]) | (ends == size - 1))
        linked = next_begins | (ends >= filled)
        at, numbers, ends = at[linked], numbers[linked], ends[linked]
        marks[ends - block] = True
        follows = marks[at - block]
        reached = np.maximum.accumulate(np.r_[reach, np.where(follows, ends, 0)])
        kept = follows | (reached[:-1] <= at)
        # What is left to overlap began in a body, where a damaged message went before; the last one of a
        # block is judged by the first of the next.
        at = np.concatenate([begins.pop().astype(np.int64), at[kept]])
        numbers = np.concatenate([kinds.pop(), numbers[kept]])
        apart = at[:-1] + lengths[numbers[:-1]] <= at[1:]
        begins += [at[:-1][apart].astype(place), at[-1:].astype(place)]
        kinds += [numbers[:-1][apart], numbers[-1:]]
        reach = int(reached[-1])
        marks[: SETTINGS.longest_message + 1] = marks[
            SETTINGS.search_bytes : SETTINGS.search_bytes + SETTINGS.longest_message + 1
        ]
        marks[SETTINGS.longest_message + 1 :] = False
        release()
    return np.concatenate(begins), np.concatenate(kinds)


def _gaps(begins: Places, numbers: Bytes, lengths: Places, size: int) -> tuple[Places, Places, Places]:
    """Which messages, or the end, follow bytes that are no message, and where these begin and end."""
    parts, before = [np.empty((3, 0), np.int64)], 0
    for at in range(0, len(begins), SETTINGS.checked_messages):
        tos = begins[at : at + SETTINGS.checked_messages].astype(np.int64)
        ends = tos + lengths[numbers[at : at + SETTINGS.checked_messages]]
        froms = np.r_[before, ends[:-1]]
        which = np.flatnonzero(tos > froms)
        parts.append(np.stack([at + which, froms[which], tos[which]]))
        before = int(ends[-1])
    if before < size:
        parts.append(np.array([[len(begins)], [before], [size]]))
    gaps, froms, tos = np.concatenate(parts, axis=1)
    return gaps, froms, tos
