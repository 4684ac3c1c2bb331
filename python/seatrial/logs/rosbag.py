"""ROS 1 and ROS 2 bags by rosbags; no ROS needed. MCAP files are read by `mcap`.

Message definitions come with the bag; where a ROS 2 bag has none, those of the distribution Humble are taken,
with a note.

A ROS 1 bag that was cut off has no index; its records are read from the front. It is a row of records, each a
header of ``name=value`` fields and data, with their lengths in front; a chunk holds packed records of
connections (topic, type, definition) and messages (bag format 2.0, wiki.ros.org/Bags/Format/2.0). What is
whole is read, up to the first record that is not. Held by ``tests/logs/test_rosbag1.py``.
"""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

from seatrial.base.errors import TrialError, foreign
from seatrial.logs.formats import Unpacked, extra
from seatrial.logs.log import Log
from seatrial.logs.messages import UNPACKERS, Bag, Message, learnt, unpacked_chunk


def open_log(path: Path) -> Log:
    """Bag.

    Raises
    ------
    TrialError
        If a package is missing or the bag holds no message that can be read.
    """
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


_MAGIC = b"#ROSBAG V2.0\n"

_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7  # opcodes of records, by the format
_STAMPED = ("conn", "time")  # fields of a message, of four and eight bytes
_LONGEST_HEADER, _LARGEST_CHUNK = 1 << 20, 1 << 28  # bytes: a recorder writes chunks of 768 KiB


class _Damaged(Exception):
    """The records end here."""


def open_cut(path: Path) -> Bag | None:
    """Log of what is whole in a ROS 1 bag without an index; None for any other file."""
    if path.is_dir():  # of ROS 2
        return None
    with path.open("rb") as file:
        if file.readline(32) != _MAGIC:
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
                    inside = _unpacked(header, data) if _code(header) == _CHUNK else [record]
                    yield from self._told(inside, topics, file.tell() / size)
            except _Damaged as error:
                self.note("stopped", "part", error=str(error))

    def _told(self, records: Any, topics: set[str] | None, share: float) -> Iterator[Message]:
        for header, data in records:
            if _code(header) == _CONNECTION:
                self._connect(header, data)
            elif _code(header) == _MESSAGE and [len(header.get(name, b"")) for name in _STAMPED] == [4, 8]:
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
    return header, _part(file, file.read(4), _LARGEST_CHUNK, whole=_code(header) != _CHUNK)


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


def _unpacked(header: dict[str, bytes], data: bytes) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """Records of a chunk."""
    try:
        file = BytesIO(unpacked_chunk(header.get("compression", b"none").decode(), data))
    except Exception as error:  # damaged data may raise anything in an unpacker
        raise _Damaged(f"a chunk that cannot be unpacked, {type(error).__name__}") from None
    while (record := _record(file)) is not None:
        yield record
