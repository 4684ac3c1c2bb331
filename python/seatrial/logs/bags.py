"""Logs of messages: ROS 1 and ROS 2 bags, and MCAP files; no ROS needed.

Fields are learnt from the first messages of each topic: the numbers of a message with their path,
``twist.twist.linear.x``; short arrays by index. The stamp is the message's own ``header.stamp`` where it has
one near the time of reception, else the time of reception. A computer whose clock is wrong stamps all its
messages wrong by the same time: where none of the first messages of a topic arrives within `wrong_clock_s` of
its stamp, the stamps are moved by the shortest delay, with a remark. `epoch_s` is zero where stamps are Unix
times.

Bags are read by rosbags. Message definitions come with the bag; where a ROS 2 bag has none, those of the
distribution Humble are taken, with a note. A ROS 1 bag that was cut off has no index; its records are read
from the front, up to the first that is not whole. It is a row of records, each a header of ``name=value``
fields and data, with their lengths in front; a chunk holds packed records of connections (topic, type,
definition) and messages (bag format 2.0, wiki.ros.org/Bags/Format/2.0). Held by
``tests/logs/test_rosbag1.py``.

MCAP (https://mcap.dev/spec) holds messages of ROS 2 (CDR), ROS 1 and JSON; others are noted. A file is a row
of records (kind, 1 byte; length, 8 bytes; content), most of them chunks of packed records. The framing is
read here and the records by mcap: mcap's own reader stops at the first damage, and asks for as much memory as
a damaged length says, up to 4 GiB. After damage, reading goes on at the next chunk.
"""

from __future__ import annotations

import contextlib
import json
import math
import mmap
import sqlite3
import struct
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, lru_cache, partial
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from seatrial.base.budget import Budget, advance, claim
from seatrial.base.errors import TrialError, foreign, printable
from seatrial.logs.clock import NEAR_S
from seatrial.logs.log import READING_SETTINGS, Chunk, Gathered, Log, Share, Unpacked, extra, number


@dataclass(frozen=True)
class SenderSettings:
    """How fields and the sender's clock are learnt from the first messages of a topic."""

    learning_messages: int = 3  #: of a topic, from which its fields are learnt
    timed_messages: int = 50  #: of a topic with stamps of its own, that tell its clock
    #: s, shortest delay that is worth a word; a stamp later than its reception by as much is of a wrong clock
    late_s: float = 1.0
    wrong_clock_s: float = 10.0  #: s, shortest delay that only a wrong clock has
    deepest: int = 8  #: messages within one another: deeper ones are damaged or hostile
    unix_from_s: float = 9e8  #: s: a larger time is a date (1998), not the time since boot


SETTINGS = SenderSettings()

UNPACKERS = {"bz2": "bz2", "lz4": "lz4.frame", "zstd": "zstandard"}
"""Packages by the name that bags and MCAP files give to a packing."""


class Message(NamedTuple):
    """A message as its file holds it: topic, time of reception in s, what decodes it, share of the file."""

    topic: str
    received: float
    decode: Callable[[], Any]
    share: float


def learnt(log: Bag) -> Bag:
    """A log of messages, after its fields were learnt."""
    log.learn()
    if not log.fields:
        raise TrialError(
            f"{log.path}: no message with numbers in it" + "".join(f"; {note}" for note in log.notes[:3])
        )
    return log


def unpacked_chunk(packing: str, data: bytes) -> bytes:
    """Content of packed data, up to where they are cut off."""
    if packing in ("", "none"):
        return data
    if packing not in UNPACKERS:
        raise ValueError(f"packing {packing}")
    most, content = Budget().unpacked_of(len(data)), bytearray()
    stream = extra(UNPACKERS[packing], Path("log")).open(BytesIO(data), "rb")
    with suppress(EOFError):
        while part := stream.read(1 << 20):
            content += part
            if len(content) > most:
                raise ValueError(f"a chunk of {len(data):,} bytes unpacks to more than {most:,}")
            claim(len(content))  # an array of bytes grows by an eighth, and is copied
    return bytes(content)


@dataclass
class Bag(Log):
    """A file of messages whose fields are learnt from the first of each topic."""

    _names: dict[str, dict[str, str]] = field(default_factory=dict)
    _moved: dict[str, float] = field(default_factory=dict)  # s that a topic's own stamps are moved by

    @abstractmethod
    def messages(self, topics: set[str] | None) -> Iterator[Message]:
        """Messages of some topics, or of all."""

    def learn(self) -> None:
        """Learn the fields of each topic from its first messages."""
        seen: Counter[str] = Counter()
        delays: dict[str, list[float]] = {}
        advance(0.0)
        for message in self.messages(None):
            advance(message.share)
            if seen[message.topic] >= (
                SETTINGS.timed_messages if message.topic in delays else SETTINGS.learning_messages
            ):
                continue
            seen[message.topic] += 1
            if len(seen) > READING_SETTINGS.most_topics:
                raise TrialError(
                    f"{self.path}: more than {READING_SETTINGS.most_topics} topics; the file is damaged"
                )
            values = self._decoded(message)
            if values:
                known = self._names.setdefault(message.topic, {})
                known.update(dict.fromkeys(values, ""))
                stamp = _own_stamp(values)
                if stamp is not None and abs(message.received - stamp) < NEAR_S:
                    delays.setdefault(message.topic, []).append(message.received - stamp)
            if self.epoch_s is None and message.received > SETTINGS.unix_from_s:
                self.epoch_s = 0.0
        self._judge_clocks({topic: min(late) for topic, late in delays.items()})

    def _judge_clocks(self, shortest: Mapping[str, float]) -> None:
        """Move the stamps of clocks that are wrong, and say so of late ones; by the shortest delay, s."""
        for late in sorted({
            round(late, 1) for late in shortest.values() if not -SETTINGS.late_s < late < SETTINGS.late_s
        }):
            topics = [topic for topic, own in shortest.items() if round(own, 1) == late]
            named = ", ".join(printable(topic) for topic in topics)
            if 0.0 < late < SETTINGS.wrong_clock_s:
                self.remark("late stamps", named, late_s=late)
                continue
            self._moved |= {topic: shortest[topic] for topic in topics}
            self.remark("sender clock", named, late_s=late)

    @property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Fields by topic; a bag states no units."""
        return self._names

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the fields wanted."""
        gathered = Gathered(wanted)
        advance(0.0)
        for count, message in enumerate(self.messages(set(wanted))):
            advance(message.share)
            if share is not None and count % 4096 == 0:
                share(message.share)
            values = self._decoded(message)
            if values is not None:
                stamp = _stamp(values, message.received, self._moved.get(message.topic, 0.0))
                chunk = gathered.add(message.topic, stamp, values)
                if chunk is not None:
                    yield chunk
        yield from gathered.rest()

    def _decoded(self, message: Message) -> dict[str, float] | None:
        try:
            numbers: dict[str, float] = {}
            _flatten("", {"": message.decode()}, -1, numbers)  # without a name: it may be a bare number
            return numbers
        except Exception as error:  # a damaged message may raise anything in the decoder
            self.note("not decoded", message.topic, error=type(error).__name__)
            return None


_WHOLE = 2**53  # whole numbers below it are floats, too


def _flatten(path: str, value: Any, depth: int, numbers: dict[str, float]) -> None:
    """Put the numbers of a message into `numbers` by their path."""
    if isinstance(value, np.ndarray):
        if value.dtype.kind in "biuf" and value.size <= READING_SETTINGS.longest_array:
            for k, cell in enumerate(value.ravel().tolist()):
                numbers[f"{path}[{k}]"] = float(cell)
        return
    members: Iterable[tuple[str, Any]] = ()
    if depth >= SETTINGS.deepest:
        pass
    elif isinstance(value, Mapping):
        members = ((f"{path}.{name}", cell) for name, cell in value.items()) if path else value.items()
    elif isinstance(value, list | tuple):
        if len(value) <= READING_SETTINGS.longest_array:
            members = ((f"{path}[{k}]", cell) for k, cell in enumerate(value))
    elif hasattr(value, "__dataclass_fields__"):
        members = ((inner, getattr(value, name)) for name, inner in _members(value.__class__, path))
    for inner, cell in members:
        # Nearly every member is a number: these calls decide how long a log takes.
        if type(cell) is float:
            numbers[inner] = cell
        elif type(cell) is int and -_WHOLE < cell < _WHOLE:
            numbers[inner] = float(cell)
        elif (plain := number(cell)) is not None:
            numbers[inner] = plain
        elif cell is not None and type(cell) is not str:
            _flatten(inner, cell, depth + 1, numbers)


@lru_cache(maxsize=4096)
def _members(message: Any, path: str) -> tuple[tuple[str, str], ...]:
    """Name and path of each field of a message type, shared by the topics of that type."""
    names = (name for name in message.__dataclass_fields__ if not name.startswith("__"))
    return tuple((name, f"{path}.{name}" if path else name) for name in names)


def _own_stamp(values: Mapping[str, float]) -> float | None:
    """Stamp of a message's header in s; None where it has none."""
    for seconds, rest in (("header.stamp.sec", "header.stamp.nanosec"), ("timestamp.sec", "timestamp.nsec")):
        if seconds in values:
            stamp = values[seconds] + 1e-9 * values.get(rest, 0.0)
            return stamp if math.isfinite(stamp) else None
    return None


def _stamp(values: Mapping[str, float], received: float, moved: float) -> float:
    """Stamp of a message in s: of its header where it is near the reception, else the reception."""
    stamp = _own_stamp(values)
    return received if stamp is None or abs(stamp - received) >= NEAR_S else stamp + moved


def open_bag(path: Path) -> Log:
    """Bag; TrialError if a package is missing or the bag holds no message that can be read."""
    try:
        return learnt(_Ros(path, "rosbag"))
    except TrialError:
        if (cut := open_cut(path)) is not None:
            return cut
        raise


@cache
def _bound_rosbags(path: Path) -> None:
    """Give rosbags unpackers and a reader of databases that are bounded; its own take what a bag says."""
    ros1, ros2 = extra("rosbags.rosbag1.reader", path), extra("rosbags.rosbag2.reader", path)
    mcap, sqlite = (extra(f"rosbags.rosbag2.storage_{name}", path) for name in ("mcap", "sqlite3"))
    bounded = {packing: partial(unpacked_chunk, packing) for packing in UNPACKERS}

    class Checked(sqlite.Sqlite3Reader):  # type: ignore[misc,name-defined]
        def open(self) -> None:
            if why := _missing(Path(self.path)):
                raise ros2.ReaderError(why)
            super().open()

    def opened(file: BinaryIO, mode: str) -> Unpacked:
        return Unpacked(Path(file.name), extra("zstandard", path).open)

    ros1.decompressors.update(bounded)
    ros2.zstd = mcap.zstd = SimpleNamespace(
        decompress=bounded["zstd"], open=opened, compress=ros2.zstd.compress
    )
    mcap.lz4_decompress = bounded["lz4"]
    ros2.DirectoryReader.STORAGE_PLUGINS = {**ros2.DirectoryReader.STORAGE_PLUGINS, "sqlite3": Checked}
    ros2.Reader.STORAGE_PLUGINS = {**ros2.Reader.STORAGE_PLUGINS, ".db3": Checked}


class _Ros(Bag):
    """A bag of ROS 1 or ROS 2 by rosbags."""

    def messages(self, topics: set[str] | None) -> Iterator[Message]:
        _bound_rosbags(self.path)
        highlevel = extra("rosbags.highlevel", self.path)
        typesys = extra("rosbags.typesys", self.path)
        store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        with contextlib.ExitStack() as stack:
            try:
                bag = stack.enter_context(highlevel.AnyReader([self.path], default_typestore=store))
            except Exception as error:  # a damaged bag may raise anything in rosbags
                why = f"not readable as a bag ({foreign(error)})"
                raise TrialError(
                    f"{self.path}: {why}; fetch the bag again, or repair it with `rosbag reindex` or"
                    " `ros2 bag reindex`"
                ) from None
            if bag.is2 and not any(connection.msgdef.data for connection in bag.connections):
                self.remark("no definitions")
            used = [c for c in bag.connections if topics is None or c.topic in topics]
            known = []
            for connection in used:
                self.kinds[connection.topic] = connection.msgtype
                if connection.msgtype in bag.typestore.fielddefs:
                    known.append(connection)
                else:
                    self.note("unknown type", connection.topic, type=connection.msgtype, error="")
            if not known:
                return
            total, count = max(bag.message_count, 1), 0
            stream = bag.messages(connections=known)
            while True:
                try:
                    connection, received, data = next(stream)
                except StopIteration:
                    return
                except Exception as error:  # a damaged chunk may raise anything in rosbags
                    self.note("stopped", "part", error=type(error).__name__)
                    return
                count += 1

                def decode(data: Any = data, kind: str = connection.msgtype) -> Any:
                    return bag.deserialize(data, kind)

                yield Message(connection.topic, received * 1e-9, decode, count / total)


_TABLES = ("topics", "messages")


def _missing(path: Path) -> str:
    """Clause on what the database of a ROS 2 bag lacks; "" where it is whole."""
    try:
        with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as data:
            rows = data.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
            columns = [row for name in _TABLES for row in data.execute(f"PRAGMA table_xinfo({name})")]
    except sqlite3.Error:  # who reads it says so
        return ""
    if any(column[6] > 1 for column in columns):
        return f"{path.name} has a column that SQLite computes, which no recorder writes: it may be endless"
    tables = " and ".join(f'"{name}"' for name in _TABLES if (name,) not in rows)
    return f"{path.name} has no table {tables}, as rosbag2 writes: the messages are missing" if tables else ""


_BAG_MAGIC = b"#ROSBAG V2.0\n"

_BAG_MESSAGE, _BAG_CHUNK, _BAG_CONNECTION = 2, 5, 7  # opcodes of records, by the format
_STAMPED = ("conn", "time")  # fields of a message, of four and eight bytes
_LONGEST_HEADER, _LARGEST_CHUNK = 1 << 20, 1 << 28  # bytes: a recorder writes chunks of 768 KiB


class _Damaged(Exception):
    """The records end here."""


def open_cut(path: Path) -> Bag | None:
    """Log of what is whole in a ROS 1 bag without an index; None for any other file."""
    if path.is_dir():  # of ROS 2
        return None
    with path.open("rb") as file:
        if file.readline(32) != _BAG_MAGIC:
            return None
    log = _Cut(path, "rosbag")
    log.note("no index")
    return learnt(log)


@dataclass
class _Cut(Bag):
    """A bag of ROS 1 by its records."""

    _topics: dict[int, tuple[str, str]] = field(default_factory=dict)
    _store: Any = None

    def messages(self, topics: set[str] | None) -> Iterator[Message]:
        size = max(self.path.stat().st_size, 1)
        if self._store is None:
            typesys = extra("rosbags.typesys", self.path)
            self._store = typesys.get_typestore(typesys.Stores.EMPTY)
        with self.path.open("rb") as file:
            file.readline(32)
            try:
                while (record := _record(file)) is not None:
                    header, data = record
                    inside = _chunk_records(header, data) if _code(header) == _BAG_CHUNK else [record]
                    yield from self._told(inside, topics, file.tell() / size)
            except _Damaged as error:
                self.note("stopped", "part", error=str(error))

    def _told(self, records: Any, topics: set[str] | None, share: float) -> Iterator[Message]:
        for header, data in records:
            if _code(header) == _BAG_CONNECTION:
                self._connect(header, data)
            elif _code(header) == _BAG_MESSAGE and [len(header.get(name, b"")) for name in _STAMPED] == [
                4,
                8,
            ]:
                topic, kind = self._topics.get(struct.unpack("<I", header["conn"])[0], ("", ""))
                if not topic or (topics is not None and topic not in topics):
                    continue
                seconds, nanoseconds = struct.unpack("<II", header["time"])

                def decode(data: bytes = data, kind: str = kind) -> Any:
                    return self._store.deserialize_ros1(data, kind)

                yield Message(topic, seconds + 1e-9 * nanoseconds, decode, share)

    def _connect(self, header: dict[str, bytes], data: bytes) -> None:
        """Learn a connection's topic and type, once."""
        number = struct.unpack("<I", header["conn"])[0] if len(header.get("conn", b"")) == 4 else -1
        if number < 0 or number in self._topics:
            return
        typesys = extra("rosbags.typesys", self.path)
        inner = _fields(data)
        topic = header.get("topic", b"").decode(errors="replace")
        kind = inner.get("type", b"").decode(errors="replace")
        kind = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        text = inner.get("message_definition", b"").decode(errors="replace")
        self._topics[number] = ("", "")
        try:
            types = typesys.get_types_from_msg(text, kind)
            self._store.register({
                name: fields for name, fields in types.items() if name not in self._store.fielddefs
            })
        except Exception as error:  # a damaged definition may raise anything in rosbags
            self.note("unknown type", topic, type=kind, error=type(error).__name__)
            return
        self._topics[number] = (topic, kind)
        self.kinds[topic] = kind


def _record(file: BinaryIO) -> tuple[dict[str, bytes], bytes] | None:
    """Header and data of the next record; None at the end of the file."""
    first = file.read(4)
    if not first:
        return None
    header = _fields(_part(file, first, _LONGEST_HEADER))
    # The last chunk is cut where the recorder was: the messages in it that are whole are told.
    return header, _part(file, file.read(4), _LARGEST_CHUNK, whole=_code(header) != _BAG_CHUNK)


def _part(file: BinaryIO, length: bytes, most: int, *, whole: bool = True) -> bytes:
    count = struct.unpack("<I", length)[0] if len(length) == 4 else most + 1
    if count > most:
        raise _Damaged("a record of impossible length")
    data = file.read(count)
    if whole and len(data) < count:
        raise _Damaged("a record without an end")
    return data


def _fields(data: bytes) -> dict[str, bytes]:
    """Values of a header by name."""
    values, at = {}, 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<I", data, at)
        name, equals, value = data[at + 4 : at + 4 + length].partition(b"=")
        if not equals or at + 4 + length > len(data):
            raise _Damaged("a header that is none")
        values[name.decode(errors="replace")] = value
        at += 4 + length
    return values


def _code(header: dict[str, bytes]) -> int:
    return header.get("op", b"\0")[0] if header.get("op") else 0


def _chunk_records(header: dict[str, bytes], data: bytes) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """Records of a chunk."""
    try:
        file = BytesIO(unpacked_chunk(header.get("compression", b"none").decode(), data))
    except Exception as error:  # damaged data may raise anything in an unpacker
        raise _Damaged(f"a chunk that cannot be unpacked, {type(error).__name__}") from None
    while (record := _record(file)) is not None:
        yield record


_MAGIC_BYTES, _TAG_BYTES = 8, 9  # signature of a file; opcode and length of a record, by the format
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _LAST = 2, 3, 4, 5, 6, 15  # opcodes, by the format
_PACKINGS = (b"\4\0\0\0zstd", b"\3\0\0\0lz4")


_CHUNK_HEAD_BYTES = _TAG_BYTES + 28  # of a chunk's record before the name of its packing

_RELEASED_BYTES = 1 << 26  # after which the pages of the file are given back


def open_mcap(path: Path) -> Log:
    """MCAP file; TrialError if a package is missing or the file holds no message that can be read."""
    return learnt(_Mcap(path, "mcap"))


@dataclass
class _Mcap(Bag):
    """An MCAP file."""

    _schemas: dict[int, Any] = field(default_factory=dict)
    _channels: dict[int, Any] = field(default_factory=dict)

    def learn(self) -> None:
        """Learn the fields of each topic, of what a damaged chunk names from the summary at the end."""
        known = 0
        super().learn()
        while self.notes and known < len(self._channels) and not self._names:
            known = len(self._channels)
            super().learn()

    def messages(self, topics: set[str] | None) -> Iterator[Message]:
        """Messages of some topics, or of all."""
        decoders: dict[int, Callable[[bytes], Any] | None] = {}
        kinds = extra("mcap.records", self.path)
        for record, share in self._records():
            if isinstance(record, kinds.Schema):
                self._schemas[record.id] = record
            elif isinstance(record, kinds.Channel):
                self._channels[record.id] = record
            elif isinstance(record, kinds.Message):
                channel = self._channels.get(record.channel_id)
                if channel is None:
                    self.note("undescribed channel")
                    continue
                if topics is not None and channel.topic not in topics:
                    continue
                if channel.id not in decoders:
                    schema = self._schemas.get(channel.schema_id)
                    self.kinds[channel.topic] = schema.name if schema is not None else ""
                    decoders[channel.id] = self._decoder(self._schemas.get(channel.schema_id), channel)
                decoder = decoders[channel.id]
                if decoder is not None:
                    decode = partial(decoder, record.data)
                    yield Message(channel.topic, record.log_time * 1e-9, decode, share)

    def _records(self) -> Iterator[tuple[Any, float]]:
        """Schemas, channels and messages, and the share of the file up to each."""
        lost = places = first = 0
        with self.path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
            size, at, closed = len(data), _MAGIC_BYTES, False
            while at + _TAG_BYTES <= size and not closed:
                kind = data[at]
                end = at + _TAG_BYTES + int.from_bytes(data[at + 1 : at + _TAG_BYTES], "little")
                if end <= size and (0 < kind <= _LAST or kind >= 128):
                    records, damaged = self._unpacked(kind, data[at + _TAG_BYTES : end])
                else:
                    end, records = _next_chunk(data, at + 1), []
                    damaged = end - at
                    if end == size:  # what is whole in the last chunk
                        for record in self._unpacked(kind, data[at + _TAG_BYTES :])[0]:
                            yield record, 1.0
                        break
                if at // _RELEASED_BYTES < end // _RELEASED_BYTES and hasattr(mmap, "MADV_DONTNEED"):
                    data.madvise(mmap.MADV_DONTNEED)  # pages that were read: a log may outgrow the memory
                if damaged:
                    first = first if places else at
                    lost, places = lost + damaged, places + 1
                for record in records:
                    yield record, end / size
                closed = kind == _FOOTER
                at = end
        if lost:
            self.note("bytes lost", lost=lost, size=size, records=True, places=places, byte=first)
        if not closed:
            self.note("cut within record", bytes=size - at)

    def _unpacked(self, kind: int, content: bytes) -> tuple[list[Any], int]:
        """The schemas, channels and messages of a record, and how many of its bytes are damaged."""
        kinds = extra("mcap.records", self.path)
        source = extra("mcap.data_stream", self.path).ReadDataStream(BytesIO(content))
        try:
            if kind == _CHUNK:
                chunk = kinds.Chunk.read(source)
                inner = unpacked_chunk(chunk.compression, chunk.data)
                return self._inner(inner, len(content)) if inner else ([], len(content))
            if kind == _MESSAGE:
                return [kinds.Message.read(source, len(content))], 0
            if kind in (_SCHEMA, _CHANNEL):
                return [(kinds.Schema if kind == _SCHEMA else kinds.Channel).read(source)], 0
        except Exception:  # a damaged record may raise anything in mcap
            return [], len(content)
        return [], 0

    def _inner(self, content: bytes, most: int) -> tuple[list[Any], int]:
        """The records of an unpacked chunk up to where it is damaged; at most `most` bytes are called so."""
        records: list[Any] = []
        at = lost = 0
        while at < len(content):
            end = at + _TAG_BYTES + int.from_bytes(content[at + 1 : at + _TAG_BYTES], "little")
            if end > len(content) or content[at] not in (_SCHEMA, _CHANNEL, _MESSAGE):
                return records, min(lost + len(content) - at, most)
            unpacked, damaged = self._unpacked(content[at], content[at + _TAG_BYTES : end])
            records += unpacked
            lost += damaged
            at = end
        return records, min(lost, most)

    def _decoder(self, schema: Any, channel: Any) -> Callable[[bytes], Any] | None:
        """What turns the bytes of a channel into a message; None, with a note, for an unknown encoding."""
        if channel.message_encoding == "json":
            return json.loads
        if schema is None or schema.encoding not in ("ros2msg", "ros1msg"):
            what = schema.encoding if schema is not None else channel.message_encoding
            self.note("unknown encoding", channel.topic, encoding=what)
            return None
        typesys = extra("rosbags.typesys", self.path)
        try:
            store = typesys.get_typestore(typesys.Stores.EMPTY)
            store.register(typesys.get_types_from_msg(schema.data.decode(), schema.name))
        except Exception as error:  # a damaged definition may raise anything in rosbags
            self.note("definition damaged", channel.topic, error=type(error).__name__)
            return None
        kind = schema.name if schema.name.count("/") == 2 else schema.name.replace("/", "/msg/", 1)
        if channel.message_encoding == "ros1":
            return lambda data: store.deserialize_ros1(data, kind)
        return lambda data: store.deserialize_cdr(data, kind)


def _next_chunk(data: mmap.mmap, at: int) -> int:
    """Begin of the next chunk, told by the name of its packing; the end of the file where there is none."""
    begins = [len(data)]
    for packing in _PACKINGS:
        place = at
        while (place := data.find(packing, place)) >= 0:
            begin = place - _CHUNK_HEAD_BYTES
            length = int.from_bytes(data[begin + 1 : begin + _TAG_BYTES], "little") if begin >= at else 0
            if begin >= at and data[begin] == _CHUNK and 0 < length <= len(data) - begin - _TAG_BYTES:
                begins.append(begin)
                break
            place += 1
    return min(begins)
