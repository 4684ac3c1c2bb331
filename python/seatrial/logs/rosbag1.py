"""ROS 1 bags without an index, as a recorder leaves them that was cut off: their records from the front.

A bag is a row of records, each a header of ``name=value`` fields and data, with their lengths in front; a
chunk holds packed records of connections (topic, type, definition) and messages (bag format 2.0,
wiki.ros.org/Bags/Format/2.0). What is whole is read, up to the first record that is not. Held by
``tests/logs/test_rosbag1.py``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from seatrial.base.budget import claim
from seatrial.logs.formats import extra
from seatrial.logs.messages import Bag, Message, learnt

_MAGIC = b"#ROSBAG V2.0\n"

_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7

_STAMPED = ("conn", "time")  # fields of a message, of four and eight bytes

_LONGEST_HEADER, _LARGEST_CHUNK = 1 << 20, 1 << 28  # bytes: a recorder writes chunks of 768 KiB

_NOTE = "has no index, as after a recorder that was cut off: read from the front, up to the damaged part"


class _Damaged(Exception):
    """The records end here."""


def open_cut(path: Path) -> Bag | None:
    """Log of what is whole in a ROS 1 bag without an index; None for any other file.

    Raises
    ------
    TrialError
        No message of it can be read.
    """
    if path.is_dir():  # of ROS 2
        return None
    with path.open("rb") as file:
        if file.readline(32) != _MAGIC:
            return None
    log = _Cut(path, "rosbag")
    log.note(_NOTE)
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
                self.note(f"stopped at a damaged part ({error}); what came before was read")

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
                name: one for name, one in types.items() if name not in self._store.fielddefs
            })
        except Exception as error:  # a damaged definition may raise anything in rosbags
            self.note(f"{topic}: messages of the unknown type {kind} ({type(error).__name__}); left out")
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
    found, at = {}, 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from("<I", data, at)
        name, equals, value = data[at + 4 : at + 4 + length].partition(b"=")
        if not equals or at + 4 + length > len(data):
            raise _Damaged("a header that is none")
        found[name.decode(errors="replace")] = value
        at += 4 + length
    return found


def _code(header: dict[str, bytes]) -> int:
    return header.get("op", b"\0")[0] if header.get("op") else 0


def _unpacked(header: dict[str, bytes], data: bytes) -> Iterator[tuple[dict[str, bytes], bytes]]:
    """Records of a chunk."""
    from io import BytesIO

    size = struct.unpack("<I", header["size"])[0] if len(header.get("size", b"")) == 4 else 0
    if size > _LARGEST_CHUNK:
        raise _Damaged("a chunk of impossible size")
    packing = header.get("compression", b"none")
    claim(2 * size)
    try:
        if packing == b"bz2":
            import bz2

            data = bz2.BZ2Decompressor().decompress(data, size)
        elif packing == b"lz4":
            from lz4.frame import LZ4FrameDecompressor

            data = LZ4FrameDecompressor().decompress(data, size)
    except Exception as error:  # damaged data may raise anything in an unpacker
        raise _Damaged(f"a chunk that cannot be unpacked, {type(error).__name__}") from None
    file = BytesIO(data)
    while (record := _record(file)) is not None:
        yield record
