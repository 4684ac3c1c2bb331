"""PX4 ULog by pyulog.

A topic is a uORB topic, with ``.1`` after it for further instances; stamps are the time since boot. pyulog
keeps every sample of the topics that it reads, so a large log is read in groups of topics of bounded size.

A frame is its size (2 bytes), its kind (1 byte) and its content; it counts where another frame, or the end,
follows. A damaged log goes to pyulog as a copy without what does not count, because pyulog looks for its next
frame only at synchronisation marks, which may be minutes apart. Format: PX4 user guide, ULog file format.
"""

from __future__ import annotations

import contextlib
import io
import math
import mmap
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.base.errors import TrialError, printable
from seatrial.logs.clock import Counter32
from seatrial.logs.log import READING_SETTINGS, Chunk, Event, Log, Share, extra

_GROUP_BYTES = 200_000_000  # of samples read together: bounds the memory
_HEADER_BYTES = 16  # signature, version and time, by the format
_FLAGS = b"\x28\0B"  # the frame of flags: 40 bytes, that of data appended after a crash among them
_LEAST = {
    "B": 40, "F": 4, "I": 3, "M": 4, "P": 3, "Q": 4, "A": 4, "R": 2, "D": 10, "L": 9, "C": 11, "S": 8, "O": 2,
}  # fmt: skip
_FIXED = {"B", "R", "S", "O"}
"""Least bytes of the content by kind of frame; those of the kinds in `_FIXED` always have that many."""
_LARGEST = 65_535  # bytes of a message: its length has two
_FIELD = re.compile(r"(\w+)(?:\[(\d{1,9})\])?\s")
_NARROW = 4  # bytes of a stamp that a counter of 32 bits made
_KEYED = {"I": 0, "P": 0, "M": 1, "Q": 1}  # bytes before the length and text of a key


def open_log(path: Path) -> Log:
    """ULog file; TrialError if pyulog is missing or the file is no ULog."""
    log = _ULog(path, "ulog")
    if not log.fields:
        raise TrialError(f"{path}: the ULog holds no topic with samples")
    return log


@dataclass
class _ULog(Log):
    _units: dict[str, dict[str, str]] = field(default_factory=dict)
    _sizes: dict[str, int] = field(default_factory=dict)  # bytes by uORB name
    _events: list[Event] = field(default_factory=list)

    def __post_init__(self) -> None:
        walk = _Walk(self.path)
        self._sizes = walk.sizes
        if walk.lost:
            size = self.path.stat().st_size
            self.note(
                "bytes lost", lost=walk.lost, size=size, records=False, places=walk.places, byte=walk.first
            )
        if walk.cut:
            self.note("cut within message", "message", bytes=walk.cut)
        # pyulog stops at the first damage: it reads a copy of the whole messages.
        self._copy = walk.copy()
        for group in self._groups(self._sizes):
            whole = self._parse(group)
            for data in whole.data_list:
                names = [entry.field_name for entry in data.field_data]
                if "timestamp" not in names:
                    self.note("no timestamp", _topic(data))
                    continue
                self._units[_topic(data)] = {
                    n: "" for n in names if n != "timestamp" and not n.startswith("_")
                }
            if not self._events:
                self._events = [
                    Event(entry.timestamp * 1e-6, "message", str(entry.message))
                    for entry in whole.logged_messages
                ]
                for name, value in whole.initial_parameters.items():
                    if isinstance(value, int | float) and math.isfinite(value):
                        self.parameters[str(name)] = float(value)
                origin = whole.msg_info_dict.get("time_ref_utc")
                if isinstance(origin, int) and origin > 0:
                    self.remark("time zone", offset_s=origin)
            if whole.file_corruption:
                self.note("parts damaged")
            if whole.dropouts:
                lost = sum(dropout.duration for dropout in whole.dropouts) * 1e-3
                self.note("drop-outs", count=len(whole.dropouts), lost_s=lost)
            del whole

    @property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Fields by topic; a ULog states no units."""
        return self._units

    def events(self) -> list[Event]:
        """Messages that were logged."""
        return sorted(self._events)

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the fields wanted."""
        names = {topic.rpartition(".")[0] if _numbered(topic) else topic for topic in wanted}
        groups = list(self._groups({name: size for name, size in self._sizes.items() if name in names}))
        for done, group in enumerate(groups):
            for data in self._parse(group).data_list:
                topic = _topic(data)
                if topic not in wanted:
                    continue
                columns = [data.data[name] for name in wanted[topic]]
                stamps = data.data["timestamp"]
                if stamps.dtype.itemsize == _NARROW:  # of old loggers
                    stamps = Counter32().of(stamps.astype(float))
                for begin in range(0, len(stamps), READING_SETTINGS.chunk_rows):
                    part = slice(begin, begin + READING_SETTINGS.chunk_rows)
                    with np.errstate(invalid="ignore"):  # a damaged number that is no number
                        values = [np.asarray(column[part], float) for column in columns]
                    rows = np.stack(values, axis=1) if values else np.empty((len(stamps[part]), 0))
                    yield Chunk(topic, np.asarray(stamps[part] * 1e-6, float), rows)
            if share is not None:
                share((done + 1) / len(groups))

    def _groups(self, sizes: Mapping[str, int]) -> Iterator[list[str]]:
        group: list[str] = []
        total = 0
        for name, size in sizes.items():
            if group and total + size > _GROUP_BYTES:
                yield group
                group, total = [], 0
            group.append(name)
            total += size
        if group:
            yield group

    def _parse(self, names: Sequence[str]) -> Any:
        package = extra("pyulog", self.path)
        with contextlib.redirect_stdout(io.StringIO()):
            source = str(self.path) if self._copy is None else self._copy.name
            return package.ULog(source, list(names), True)


def _topic(data: Any) -> str:
    return f"{data.name}.{data.multi_id}" if data.multi_id else str(data.name)


def _numbered(topic: str) -> bool:
    return topic.rpartition(".")[2].isdigit() and "." in topic


class _Walk:
    """The frames of a file: bytes of samples by uORB name, the parts that hold whole frames, what is lost."""

    def __init__(self, path: Path) -> None:
        self.sizes: dict[str, int] = {}  # bytes of samples by uORB name
        # Bytes that are no whole frames, in how many places, and where the first begins.
        self.lost = self.places = self.first = 0
        self.cut = 0  # bytes of a last frame that the file does not hold whole
        self._path = path
        self._names: dict[int, str] = {}  # of the subscriptions, by number
        self._lengths: dict[int, int] = {}  # of their samples
        self._subscribed: list[str] = []
        self._formats: dict[str, list[tuple[str, int]]] = {}  # types of the fields, and how many of each
        self._parts: list[tuple[int, int]] = []
        if path.stat().st_size <= _HEADER_BYTES:
            return
        with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            self._walk(data)
        self._refuse_too_large()

    def _refuse_too_large(self) -> None:
        """Refuse nested types with more numbers than a message can hold: unpacking them fills the memory.

        A few types of two fields each, nested in one another, name 2^40 numbers. Every type is counted once.
        """
        counts: dict[str, int] = {}
        for name in self._formats:
            path = {name: None}  # types that are being counted: without recursion, for a chain may be long
            while path:
                kind = next(reversed(path))
                nested = [(inner, many) for inner, many in self._formats[kind] if inner in self._formats]
                later = next((inner for inner, _ in nested if inner not in counts), None)
                if later in path:
                    raise TrialError(
                        f'{self._path}: the message type "{printable(kind)}" holds itself; the definitions'
                        " are damaged: fetch the file again"
                    )
                if later is not None:
                    path[later] = None
                    continue
                plain = sum(many for inner, many in self._formats[kind] if inner not in self._formats)
                counts[kind] = plain + sum(many * counts[inner] for inner, many in nested)
                path.popitem()
                if counts[kind] > _LARGEST:
                    raise TrialError(
                        f'{self._path}: the message type "{printable(kind)}" has {counts[kind]:.3g} numbers;'
                        f" a message has at most {_LARGEST:,} bytes: the definitions are damaged, fetch the"
                        " file again"
                    )
        total = sum(counts.get(name, 0) for name in self._subscribed)
        if total > READING_SETTINGS.most_fields:
            raise TrialError(
                f"{self._path}: its topics have {total:,} fields; expected at most"
                f" {READING_SETTINGS.most_fields:,}: the file is damaged, fetch it again"
            )

    def copy(self) -> Any:
        """A temporary file of the header and the whole frames; None where nothing is lost."""
        if not self.lost:
            return None
        copied = tempfile.NamedTemporaryFile(suffix=".ulg")  # noqa: SIM115 - lives as long as the log
        with self._path.open("rb") as stream:
            copied.write(stream.read(_HEADER_BYTES))
            for begin, end in self._parts:
                stream.seek(begin)
                part = stream.read(end - begin)
                if begin == _HEADER_BYTES and part.startswith(_FLAGS):
                    part = _FLAGS + bytes(40) + part[43:]  # the copy has no such places
                copied.write(part)
        copied.flush()
        return copied

    def _walk(self, data: mmap.mmap) -> None:
        at = begin = _HEADER_BYTES
        size = len(data)
        while at < size:
            end = self._end(data, at)
            if end and (end == size or (end < size and self._end(data, end))):
                self._count(data, at, end)
                at = end
                continue
            following = self._next(data, at + 1)
            if following == size and (size - at < 3 or end > size):
                self.cut = size - at
                break
            self._parts.append((begin, at))
            begin = following
            self.first = self.first if self.places else at
            self.places += 1
            self.lost += begin - at
            at = begin
        self._parts.append((begin, at))

    def _next(self, data: mmap.mmap, at: int) -> int:
        """Begin of the next frame that another follows; the end of the file where there is none."""
        while at < len(data):
            end = self._end(data, at)
            if end and end < len(data) and self._end(data, end):
                return at
            at += 1
        return at

    def _end(self, data: mmap.mmap, at: int) -> int:
        """End of the frame that begins there; 0 where none can."""
        if at + 3 > len(data):
            return at + 3 if at < len(data) else 0
        size, kind = data[at] + 256 * data[at + 1], chr(data[at + 2])
        least = _LEAST.get(kind)
        if least is None or size < least or (kind in _FIXED and size != least):
            return 0
        if kind == "D" and len(data) >= at + 5:
            number = self._number(data, at + 3)
            if number not in self._names or self._lengths.get(number, size) != size:
                return 0
        if kind == "A" and len(data) >= at + 6:
            name = data[at + 6 : at + 3 + size]
            if not name.replace(b"_", b"").isalnum():
                return 0
            self._names.setdefault(self._number(data, at + 4), "")  # the frame after it may be its sample
        if kind in ("F", "L", "C"):
            text = data[at + 3 + (_LEAST[kind] if kind != "F" else 0) : at + 3 + size]
            return at + 3 + size if text.isascii() and (kind != "F" or b":" in text) else 0
        if kind in _KEYED:
            length = at + 3 + _KEYED[kind]
            key = data[length + 1 : length + 1 + data[length]] if length < len(data) else b"a"
            if not key.isascii() or not key.decode().isprintable():
                return 0
        return at + 3 + size

    def _count(self, data: mmap.mmap, at: int, end: int) -> None:
        kind = data[at + 2]
        if kind == ord("F"):
            name, _, fields = data[at + 3 : end].decode("utf-8", "replace").partition(":")
            parts = (_FIELD.match(part.strip()) for part in fields.split(";"))
            self._formats[name] = [(part[1], int(part[2] or 1)) for part in parts if part]
        elif kind == ord("A"):
            name = data[at + 6 : end].decode("utf-8", "replace")
            self._names[self._number(data, at + 4)] = name
            self._subscribed.append(name)
            self.sizes.setdefault(name, 0)
        elif kind == ord("D"):
            number = self._number(data, at + 3)
            name = self._names[number]
            if name in self.sizes:  # else its subscription is damaged
                self.sizes[name] += end - at - 3
            self._lengths[number] = end - at - 3

    @staticmethod
    def _number(data: mmap.mmap, at: int) -> int:
        return int.from_bytes(data[at : at + 2], "little")
