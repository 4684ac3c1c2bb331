"""Logs of messages: fields are learnt from the first messages of each topic, numbers told by their path.

Fields are the numbers of a message with their path, ``twist.twist.linear.x``; short arrays by index. The
stamp is the message's own ``header.stamp`` where it has one near the time of reception, else the time of
reception. A computer whose clock is wrong stamps all its messages wrong by the same time: where none of the
first messages of a topic arrives within `wrong_clock_s` of its stamp, the stamps are moved by the shortest
delay, with a remark. `epoch_s` is zero where stamps are Unix times.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from seatrial.base.budget import Budget, advance, claim
from seatrial.base.errors import TrialError, printable
from seatrial.logs.clock import NEAR_S
from seatrial.logs.formats import extra
from seatrial.logs.log import READING_SETTINGS, Chunk, Gathered, Log, Share, number


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
        members = ((inner, getattr(value, name)) for name, inner in _members(type(value), path))
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
def _members(message: type, path: str) -> tuple[tuple[str, str], ...]:
    """Name and path of each field of a message type, shared by the topics of that type."""
    names = (name for name in message.__dataclass_fields__ if not name.startswith("__"))  # type: ignore[attr-defined]
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
