"""MCAP files: messages of ROS 2 (CDR), ROS 1 and JSON; others are noted.

A file is a row of records (kind, 1 byte; length, 8 bytes; content), most of them chunks of packed records.
The framing is read here and the records by mcap: mcap's own reader stops at the first damage, and asks for
as much memory as a damaged length says, up to 4 GiB. After damage, reading goes on at the next chunk.
Format: MCAP specification, https://mcap.dev/spec.
"""

from __future__ import annotations

import json
import mmap
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

from seatrial.logs.formats import extra
from seatrial.logs.log import Log
from seatrial.logs.messages import Bag, Message, learnt, unpacked_chunk

_MAGIC_BYTES, _TAG_BYTES = 8, 9  # signature of a file; opcode and length of a record, by the format
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _LAST = 2, 3, 4, 5, 6, 15  # opcodes, by the format
_PACKINGS = (b"\4\0\0\0zstd", b"\3\0\0\0lz4")


_CHUNK_HEAD_BYTES = _TAG_BYTES + 28  # of a chunk's record before the name of its packing

_RELEASED_BYTES = 1 << 26  # after which the pages of the file are given back


def open_log(path: Path) -> Log:
    """MCAP file.

    Raises
    ------
    TrialError
        If a package is missing or the file holds no message that can be read.
    """
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
