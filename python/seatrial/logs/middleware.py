"""Logs of middleware: IMC of DUNE (`.lsf`, also packed with gzip), decoded by imcpy, and MOOS (`.alog`).

An LSF file is a row of IMC packets: a header of 20 bytes (synchronisation number, message, size, time stamp
in s Unix time, source and entity, destination and entity), the content, and a check sum. A message type of
the vehicle is a topic, ``Type[entity]`` where several entities send it, and ``Type@source`` for another
system that it hears, whose clock is brought to the vehicle's where it differs. Only the framing is read here:
imcpy's own reader of files loads and writes a pickle beside the log, which may hold code.

An alog has lines of time since the start, variable, source and value. A variable is a topic with the field
``value``; where its value is a list of ``name=number`` pairs, as in a node report, each name is a field.
`epoch_s` is the LOGSTART of the header.
"""

from __future__ import annotations

import math
import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from seatrial.base.budget import advance
from seatrial.base.errors import TrialError
from seatrial.logs.log import (
    DAMAGED,
    READING_SETTINGS,
    Chunk,
    Event,
    Gathered,
    Log,
    Share,
    extra,
    number,
    unpacked,
)

_HEADER, _FOOTER = 20, 2  # bytes of a message's header and check sum, by the protocol
_SYNC = 0xFE54
_MARK = re.compile(rb"\x54\xfe|\xfe\x54")
_FIRST = 1_000_000_000  # messages that an estimate of the own state counts for: only a vehicle has one


@dataclass(frozen=True)
class ImcSettings:
    """Which clocks of several systems are one, and when a file is damaged."""

    apart_s: float = 1.0  #: s: two systems that keep time differ by less, transmission included
    most_sources: int = 100  #: more systems in one log are damaged numbers


SETTINGS = ImcSettings()


def open_imc(path: Path) -> Log:
    """Log of DUNE; TrialError if imcpy is missing or the file holds no IMC packet."""
    log = _Lsf(path, "imc", epoch_s=0.0)
    if not log.fields:
        raise TrialError(f"{path}: no IMC message in it; is it another kind of file?")
    return log


@dataclass
class _Lsf(Log):
    _names: dict[str, dict[str, str]] = field(default_factory=dict)
    _events: list[Event] = field(default_factory=list)
    _moved: dict[int, float] = field(default_factory=dict)  # s that the stamps of a source are moved by

    def __post_init__(self) -> None:
        self._imcpy = extra("imcpy", self.path)
        senders: dict[tuple[int, str], Counter[int]] = {}
        kinds: dict[str, Any] = {}
        entities: dict[tuple[int, int], str] = {}
        states: list[tuple[int, Any]] = []
        latest: dict[int, float] = {}
        # By source and other source: s by which the stamps of the first are behind, at least.
        behind: dict[tuple[int, int], float] = {}
        for stamp, source, entity, message, _ in self._messages(None):
            kind = type(message).__name__
            senders.setdefault((source, kind), Counter())[entity] += 1
            kinds.setdefault(kind, message.clone())
            # A log is written as messages arrive: after the latest of every other source.
            for other, t in latest.items():
                if other != source:
                    behind[source, other] = min(behind.get((source, other), math.inf), t - stamp)
            latest[source] = stamp
            if len(latest) > SETTINGS.most_sources:
                raise TrialError(
                    f"{self.path}: more than {SETTINGS.most_sources} sources; the file is damaged"
                )
            if kind == "EntityInfo":
                entities[source, int(message.id)] = str(message.label)
            elif kind == "VehicleState":
                states.append((source, message.clone()))
        counts: Counter[int] = Counter()
        for (source, kind), by_entity in senders.items():
            # The vehicle is who estimates its state; of several the one that says most.
            counts[source] += by_entity.total() + (_FIRST if kind == "EstimatedState" else 0)
        self._vehicle = max(counts, key=lambda source: counts[source], default=0)
        self._entities = entities
        self._several = {key for key, by_entity in senders.items() if len(by_entity) > 1}
        for (source, kind), by_entity in senders.items():
            names = _numeric(kinds[kind])
            for entity in by_entity:
                if names:
                    self._names[self._topic(source, kind, entity)] = dict.fromkeys(names, "")
        for source, message in states:
            if source == self._vehicle:
                self._mode(message)
        for source in counts:
            apart = behind.get((source, self._vehicle), 0.0)
            if abs(apart) > SETTINGS.apart_s:
                self._moved[source] = apart
                self.remark("system clock", str(source), late_s=apart)

    def _mode(self, message: Any) -> None:
        text = str(getattr(message, "op_mode", "")).rpartition(".")[2]
        if not self._events or self._events[-1].text != text:
            self._events.append(Event(float(message.timestamp), "mode", text))

    def _topic(self, source: int, kind: str, entity: int) -> str:
        label = self._entities.get((source, entity), entity)
        name = f"{kind}[{label}]" if (source, kind) in self._several else kind
        return name if source == self._vehicle else f"{name}@{source}"

    @property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Numbers by message type."""
        return self._names

    def events(self) -> list[Event]:
        """Changes of the vehicle's mode of operation."""
        return self._events

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the fields wanted."""
        gathered = Gathered(wanted)
        kinds = {re.split(r"[@[]", topic)[0] for topic in wanted}
        for count, (stamp, source, entity, message, done) in enumerate(self._messages(kinds)):
            if share is not None and count % 4096 == 0:
                share(done)
            topic = self._topic(source, type(message).__name__, entity)
            if topic in wanted:
                values = {name: number(getattr(message, name)) for name in wanted[topic]}
                t = stamp + self._moved.get(source, 0.0)
                chunk = gathered.add(topic, t, {k: v for k, v in values.items() if v is not None})
                if chunk is not None:
                    yield chunk
        yield from gathered.rest()

    def _messages(self, kinds: set[str] | None) -> Iterator[tuple[float, int, int, Any, float]]:
        """Stamp, source, entity and message of the packets of some kinds; share of the file up to each."""
        size = max(self.path.stat().st_size, 1)
        skipped = damaged = unknown = cut = 0
        names: dict[int, str] = {}
        with unpacked(self.path) as stream:
            data = b""
            while True:
                try:
                    block = stream.read(1 << 20)
                except DAMAGED as error:
                    self.note("packing damaged", error=str(error))
                    block = b""
                data += block
                advance(stream.tell() / size)
                begin = 0
                while len(data) - begin >= _HEADER + _FOOTER:
                    order = _order(data, begin)
                    if order is None:
                        following = _MARK.search(data, begin + 1)
                        # The last byte may be the first of a mark.
                        beyond = following.start() if following else len(data) - 1
                        skipped += beyond - begin
                        begin = beyond
                        continue
                    _, kind, length, stamp, source, entity = struct.unpack_from(order + "HHHdHB", data, begin)
                    end = begin + _HEADER + length + _FOOTER
                    # The packet may go on in the next block; at the end of the file it is cut or no packet.
                    if end > len(data):
                        if block:
                            break
                        cut = cut or len(data) - begin
                        begin += 1
                        skipped += 1
                        continue
                    # What kind a number means is known once such a packet was read.
                    if kinds is None or names.get(kind, "") in kinds or kind not in names:
                        try:
                            message = self._imcpy.Packet.deserialize(data[begin:end])
                        except Exception:  # a damaged packet, or a message this imcpy does not know
                            if kind in names or order is None:
                                damaged += 1
                                begin += 1
                            else:
                                unknown += 1
                                begin = end
                            continue
                        cut = 0
                        names[kind] = type(message).__name__
                        if kinds is None or names[kind] in kinds:
                            yield stamp, source, entity, message, stream.tell() / size
                    begin = end
                data = data[begin:]
                if not block:
                    break
        cut = cut or (len(data) if _order(data, 0) is not None else 0)
        skipped += len(data) - cut
        if cut:
            self.note("cut within message", "packet", bytes=cut)
        if skipped:
            self.note("no packets", bytes=skipped)
        if damaged or unknown:
            self.note("packets damaged", damaged=damaged, unknown=unknown)


def _order(data: bytes, begin: int) -> str | None:
    """Byte order of the packet that begins there: "<" or ">"; None if none does."""
    mark = data[begin : begin + 2]
    return {b"\x54\xfe": "<", b"\xfe\x54": ">"}.get(mark)


def _numeric(message: Any) -> list[str]:
    """Names of the numbers of a message."""
    head = {"timestamp", "src", "src_ent", "dst", "dst_ent", "msg_id"}
    names = [name for name in dir(message) if not name.startswith("_") and name not in head]
    return [name for name in names if number(getattr(message, name, None)) is not None]


_PAIR = re.compile(r"([A-Za-z_]\w{0,63})=([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?=,|$)")
_MODES = ("MODE", "DEPLOY", "IVPHELM_STATE")
_LONGEST_LINE = 65_536  # bytes: a longer entry is no channel


def open_moos(path: Path) -> Log:
    """Log of a MOOS community; TrialError if no line of the file is an entry of an alog."""
    log = _Alog(path, "moos")
    if not log.fields:
        raise TrialError(
            f"{path}: no entry in it; expected lines of time, variable, source and value, as pLogger"
            " writes them"
        )
    return log


@dataclass
class _Alog(Log):
    _names: dict[str, dict[str, str]] = field(default_factory=dict)
    _events: list[Event] = field(default_factory=list)

    def __post_init__(self) -> None:
        odd = 0
        for line, _ in self._lines():
            if line.startswith("%"):
                start = re.search(r"LOGSTART\s+(\d+(?:\.\d+)?)", line)
                if start:
                    self.epoch_s = float(start[1])
                continue
            entry = _entry(line)
            if entry is None:
                odd += bool(line.strip())
                continue
            t, variable, text = entry
            values = _values(text)
            if values:
                known = self._names.setdefault(variable, {})
                for name in values:
                    known.setdefault(name, "")
                if len(self._names) > READING_SETTINGS.most_topics:
                    most = READING_SETTINGS.most_topics
                    raise TrialError(f"{self.path}: more than {most} variables; the file is damaged")
            elif variable in _MODES:
                self._events.append(Event(t, "mode", f"{variable} {text[:200]}"))
        with self.path.open("rb") as stream:
            stream.seek(-1, 2)
            if stream.read(1) not in b"\r\n":
                self.note("cut within line")
        if odd:
            self.note("lines of no entry", count=odd)

    @property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Names of the numbers by variable; an alog states no units."""
        return self._names

    def events(self) -> list[Event]:
        """Changes of mode."""
        return sorted(self._events)

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the variables wanted."""
        gathered = Gathered(wanted)
        for count, (line, done) in enumerate(self._lines()):
            if share is not None and count % 16_384 == 0:
                share(done)
            entry = None if line.startswith("%") else _entry(line)
            if entry is None or entry[1] not in wanted:
                continue
            values = _values(entry[2])
            chunk = gathered.add(entry[1], entry[0], values) if values else None
            if chunk is not None:
                yield chunk
        yield from gathered.rest()

    def _lines(self) -> Iterator[tuple[str, float]]:
        size = max(self.path.stat().st_size, 1)
        done = 0
        with self.path.open("rb") as stream:
            while raw := stream.readline(_LONGEST_LINE):
                done += len(raw)
                yield raw.decode("utf-8", "replace").rstrip("\r\n"), done / size


def _entry(line: str) -> tuple[float, str, str] | None:
    """Time in s, variable and value of a line."""
    parts = line.split(None, 3)
    if len(parts) < 3:
        return None
    try:
        t = float(parts[0])
    except ValueError:
        return None
    return (t, parts[1], parts[3].strip() if len(parts) > 3 else "") if math.isfinite(t) else None


def _values(text: str) -> dict[str, float]:
    """Numbers in a value: one, or those of ``name=number`` pairs."""
    try:
        return {"value": float(text)}
    except ValueError:
        return {name: float(number) for name, number in _PAIR.findall(text)[:100]}
