"""MAVLink telemetry logs (`.tlog`) by pymavlink.

A message type of the vehicle's autopilot is a topic; one of another component, or of another vehicle, is
``TYPE@system.component``. The ground station stamps what it receives, in bursts where the link is slow; where
a message carries the time since its sender booted, that is used, put on the ground station's clock by the
shortest delay of any message of the sender. `epoch_s` is zero.

Each computer that writes into a log counts from an origin of its own: its start, or a wrong date. What the
receiver stamps is late by the transmission, and never early; so the origin of a sender is the least
difference between reception and stamp. Message types of a sender share it where their least differences
agree; a type that differs by more than `shared_clock_s` is stamped by another clock, as of a sensor behind
the sender. A counter of limited width begins again at zero (32 bits of microseconds after 71.6 minutes, of
milliseconds after 49.7 days): how often it did the reception tells, to within half a period. A clock that
falls, or jumps ahead of the reception, was started again or set: from there on it has another origin. Held by
``tests/logs/test_senders.py``.
"""

from __future__ import annotations

import contextlib
import io
import math
import struct
from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from seatrial.base.budget import advance
from seatrial.base.errors import TrialError
from seatrial.logs.log import READING_SETTINGS, Chunk, Event, Gathered, Log, Share, extra, number

_STAMP_BYTES = 8  # of the ground station, before each frame
_BEGIN = struct.Struct(">QBBB")  # of a frame: stamp in us, mark, bytes of payload, flags from version 2 on
_AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1
_GROUND = 255  # the usual system number of a ground station


@dataclass(frozen=True)
class MavlinkSettings:
    """When a file is no telemetry log, and which of its clocks are one."""

    counter_values: float = 2.0**32  #: values of a counter of 32 bits
    unix_from_s: float = 1e9  #: s: a larger time is a date, not the time since boot
    reported_difference_s: float = 0.5  #: s, difference of two clocks that is worth a word
    #: after which a file is judged: pymavlink takes 1.4 s for each MB of what is no message
    judged_bytes: int = 1_000_000
    #: of these bytes in whole messages: a damaged recording loses some percent
    least_whole_share: float = 0.1
    #: s: origins of message types that differ by less are one, for no link holds every message of a type for
    #: longer
    shared_clock_s: float = 2.0
    fall_s: float = 2.0  #: s by which a clock falls that was started again: messages change places by less
    #: s by which stamps jump ahead of their reception where a clock was set: a burst of messages does not
    jump_s: float = 10.0


SETTINGS = MavlinkSettings()


_Sender = tuple[int, int]  # system and component


@dataclass
class Session:
    """Stamps of one message type between two starts of its clock."""

    #: Who stamped which messages, and the number of the first one in its stream.
    sender: Hashable
    stream: Hashable
    first: int
    period_s: float  #: After which the counter begins again; infinite for one that does not.
    reference_s: float  #: Reception less stamp of the first message.
    least_s: float  #: The least of these over all messages.
    count: int  #: Messages.
    origin_s: float  #: Time zero of the clock on the receiver's.
    missed_s: float  #: Periods that the counter lost before the session, s.
    last: tuple[float, float]  #: Stamp, unwrapped, and reception of the last message, s.

    def unwrapped(self, stamp: float, received: float) -> float:
        """The stamp, s, with the periods that its counter lost."""
        if not math.isfinite(self.period_s):
            return stamp
        return stamp + self.period_s * round((received - stamp - self.reference_s) / self.period_s)


@dataclass
class SenderClocks:
    """Learns the clocks of the senders from all messages, in the order of the file."""

    _sessions: dict[Hashable, list[Session]] = field(default_factory=dict)
    _counts: Counter[Hashable] = field(default_factory=Counter)

    def learn(
        self, sender: Hashable, stream: Hashable, stamp: float, received: float, period_s: float = math.inf
    ) -> None:
        """Take in a message: its stamp and its reception, s, and the period of its counter."""
        sessions = self._sessions.setdefault(stream, [])
        number = self._counts[stream]
        self._counts[stream] += 1
        if sessions:
            session = sessions[-1]
            t = session.unwrapped(stamp, received)
            ahead = t - session.last[0] - (received - session.last[1])
            if t >= session.last[0] - SETTINGS.fall_s and ahead <= SETTINGS.jump_s:
                session.least_s = min(session.least_s, received - t)
                session.count += 1
                session.last = (t, received)
                return
        late = received - stamp
        sessions.append(
            Session(sender, stream, number, period_s, late, late, 1, late, 0.0, (stamp, received))
        )

    def settle(self) -> None:
        """Give the sessions of one clock one origin; to be called after the last message was learnt."""
        clocks: dict[Hashable, list[list[tuple[Session, float]]]] = {}
        every = [session for sessions in self._sessions.values() for session in sessions]
        # The widest counters first: they know how often the narrow ones began again.
        for session in sorted(every, key=lambda candidate: (-candidate.period_s, -candidate.count)):
            own = clocks.setdefault(session.sender, [])
            for clock in own:
                apart = session.least_s - clock[0][0].least_s
                missed = 0.0  # s that the counter lost before the session
                if math.isfinite(session.period_s):
                    missed = session.period_s * round(apart / session.period_s)
                if abs(apart - missed) < SETTINGS.shared_clock_s:
                    clock.append((session, missed))
                    break
            else:
                own.append([(session, 0.0)])
        for clock in (clock for own in clocks.values() for clock in own):
            origin = min(session.least_s - missed for session, missed in clock)
            for session, missed in clock:
                session.origin_s, session.missed_s = origin, missed

    def origins(self) -> Iterator[tuple[Any, Any, float, int]]:
        """Sender, stream, origin in s and number of messages of every session."""
        for sessions in self._sessions.values():
            for session in sessions:
                yield session.sender, session.stream, session.origin_s, session.count

    def replay(self) -> Callable[[Hashable, float, float], float]:
        """Function from stream, stamp and reception to the time in s, for all messages in their order."""
        counts: Counter[Hashable] = Counter()
        places: Counter[Hashable] = Counter()

        def time(stream: Hashable, stamp: float, received: float) -> float:
            sessions = self._sessions[stream]
            place = places[stream]
            if place + 1 < len(sessions) and sessions[place + 1].first == counts[stream]:
                place = places[stream] = place + 1
            counts[stream] += 1
            session = sessions[place]
            return session.origin_s + session.missed_s + session.unwrapped(stamp, received)

        return time


def open_log(path: Path) -> Log:
    """Telemetry log; TrialError if pymavlink is missing or the file holds no MAVLink messages."""
    log = _Telemetry(path, "mavlink", epoch_s=0.0)
    if not log.fields:
        raise TrialError(f"{path}: no MAVLink message in it; is it another kind of file?")
    return log


@dataclass
class _Telemetry(Log):
    _units: dict[str, dict[str, str]] = field(default_factory=dict)
    _events: list[Event] = field(default_factory=list)
    _clocks: SenderClocks = field(default_factory=SenderClocks)
    _vehicle: int = 0  # its system number

    def __post_init__(self) -> None:
        places = whole = 0
        modes: dict[int, list[Event]] = {}
        spoken: Counter[int] = Counter()
        units: dict[_Sender, dict[str, dict[str, str]]] = {}
        parameters: dict[int, dict[str, float]] = {}
        mavutil = extra("pymavlink.mavutil", self.path)
        for message, _ in self._messages():
            kind = message.get_type()
            if kind.startswith("BAD_DATA"):
                places += 1
                continue
            whole += _STAMP_BYTES + len(message.get_msgbuf())
            if kind.startswith("UNKNOWN"):
                continue
            values = dict(_flat(message))
            system, component = sender = _sender(message)
            # Of several systems the vehicle is the one whose autopilot speaks most.
            spoken[system] += component == _AUTOPILOT
            known = units.setdefault(sender, {}).setdefault(_kind(message), {})
            if sum(map(len, units.values())) > READING_SETTINGS.most_topics:
                raise TrialError(
                    f"{self.path}: more than {READING_SETTINGS.most_topics} topics; the file is damaged"
                )
            # A field appears when a message first has it: arrays have one per element.
            for name in values:
                if name not in known:
                    known[name] = str(message.fieldunits_by_name.get(name.partition("[")[0], ""))
            received = float(message._timestamp)
            # The time since boot, beside the reception, tells the clock of its sender.
            boot = _since_boot(message)
            if boot is not None:
                self._clocks.learn(sender, (sender, kind), boot[0], received, boot[1])
            if kind == "PARAM_VALUE":
                own = parameters.setdefault(system, {})
                own[str(message.param_id)] = float(message.param_value)
            elif kind == "STATUSTEXT":
                self._events.append(Event(received, "message", str(message.text)))
            elif kind == "HEARTBEAT" and component == _AUTOPILOT and system != _GROUND:
                now, own_modes = str(mavutil.mode_string_v10(message)), modes.setdefault(system, [])
                if not own_modes or now != own_modes[-1].text:
                    own_modes.append(Event(received, "mode", now))
        del spoken[_GROUND]
        # Events, parameters and bare topic names are those of the vehicle alone.
        self._vehicle = max(spoken, key=lambda system: spoken[system], default=0)
        self._units = {self._topic(sender, name): f for sender, k in units.items() for name, f in k.items()}
        self._events += modes.get(self._vehicle, [])
        self.parameters = parameters.get(self._vehicle) or next(iter(parameters.values()), {})
        self._clocks.settle()
        self._report_clocks()
        size = self.path.stat().st_size
        lost = size - whole
        if places:
            self.note("bytes lost", lost=lost, size=size, records=False, places=places)
        elif lost > 0:
            self.note("cut within message", "message", bytes=lost)

    @property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Units by field by topic."""
        return {topic: dict(names) for topic, names in self._units.items() if names}

    def events(self) -> list[Event]:
        """Changes of mode and messages of the autopilot."""
        return sorted(self._events)

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the fields wanted."""
        gathered = Gathered(wanted)
        time = self._clocks.replay()
        for count, (message, done) in enumerate(self._messages()):
            if share is not None and count % 4096 == 0:
                share(done)
            kind = message.get_type()
            if kind.startswith(("BAD_DATA", "UNKNOWN")):
                continue
            sender, stamp, boot = _sender(message), float(message._timestamp), _since_boot(message)
            if boot is not None:
                stamp = time((sender, kind), boot[0], stamp)
            topic = self._topic(sender, _kind(message))
            if topic not in wanted:
                continue
            chunk = gathered.add(topic, stamp, dict(_flat(message)))
            if chunk is not None:
                yield chunk
        yield from gathered.rest()

    def _topic(self, sender: _Sender, kind: str) -> str:
        return kind if sender == (self._vehicle, _AUTOPILOT) else f"{kind}@{sender[0]}.{sender[1]}"

    def _report_clocks(self) -> None:
        """Say which senders have a clock of their own, and by how much it differs from the autopilot's."""
        apart: dict[tuple[_Sender, float], list[str]] = {}
        first: float | None = None
        autopilot = (self._vehicle, _AUTOPILOT)
        for sender, (_, kind), origin, _ in sorted(
            self._clocks.origins(), key=lambda clock: (clock[0] != autopilot, -clock[3])
        ):
            first = origin if first is None else first
            if abs(origin - first) > SETTINGS.reported_difference_s:
                apart.setdefault((sender, round(origin - first, 1)), []).append(kind)
        for (sender, seconds), kinds in apart.items():
            component = f"{sender[0]}.{sender[1]}"
            self.remark("component clock", component, kinds=list(dict.fromkeys(kinds)), began_s=seconds)

    def _messages(self) -> Iterator[tuple[Any, float]]:
        """Messages and the share of the file up to each."""
        mavutil = extra("pymavlink.mavutil", self.path)
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            stream = mavutil.mavlogfile(str(self.path), robust_parsing=True)
        size = max(self.path.stat().st_size, 1)
        judged = stream.f = _Judged(stream.f, self.path)
        try:
            while True:
                try:
                    message = _whole(stream) or stream.recv_msg()
                except TrialError:
                    raise
                except Exception as error:  # a damaged frame may raise anything in pymavlink
                    self.note("stopped", "message", error=type(error).__name__)
                    return
                if message is None:
                    return
                if not message.get_type().startswith("BAD_DATA"):
                    judged.whole += _STAMP_BYTES + len(message.get_msgbuf())
                advance(judged.place / size)
                yield message, judged.place / size
        finally:
            stream.close()


def _whole(stream: Any) -> Any:
    """Message of a whole frame that begins here; None, and nothing is read, where it takes a search.

    pymavlink's own way from byte to message, which finds its place again behind damage, takes twice as long.
    """
    if stream.first_byte or stream.mav.buf_len():  # the version is not known yet, or a search is under way
        return None
    if stream._last_message.get_type() == "BAD_DATA":  # pymavlink looks for a likely stamp behind it
        return None
    frame = stream.f.frame()
    if frame is None:
        return None
    stamp_us, content = frame
    try:
        message = stream.mav.decode(content)
    except Exception:  # damaged: pymavlink says where the next one begins
        message = None
    if message is None or message.get_type().startswith("UNKNOWN"):
        stream.f.back(_STAMP_BYTES + len(content))
        return None
    message._timestamp = stream._timestamp = stream._last_timestamp = stamp_us * 1e-6
    stream._last_message = message
    return message


class _Judged:
    """A file of which a reader looks for messages; it ends the search where hardly any is found.

    pymavlink searches the whole rest of a file within one call.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file, self._path = file, path
        self.tell, self.close = file.tell, file.close
        self.whole = 0
        self.place = file.tell()

    def frame(self) -> tuple[int, bytearray] | None:
        """Stamp in us and bytes of the frame that begins here; None, and nothing is read, where none does."""
        content = self._file.read(_BEGIN.size)
        if len(content) == _BEGIN.size:
            stamp_us, mark, payload, flags = _BEGIN.unpack(content)
            # Bytes after these, for the marks of version 1, and of version 2 without and with a signature.
            header = {(0xFE, flags): 5, (0xFD, 0): 9, (0xFD, 1): 9 + 13}.get((mark, flags))
            if header is not None:
                content += self._file.read(header + payload)
                if len(content) == _BEGIN.size + header + payload:
                    self.place += len(content)
                    return stamp_us, bytearray(content[_STAMP_BYTES:])
        self._file.seek(-len(content), io.SEEK_CUR)
        return None

    def back(self, count: int) -> None:
        """Go back by some bytes."""
        self._file.seek(-count, io.SEEK_CUR)
        self.place -= count

    def read(self, count: int) -> bytes:
        """Some bytes."""
        self.place += count
        if self.place > SETTINGS.judged_bytes and self.whole < SETTINGS.least_whole_share * self.place:
            raise TrialError(
                f"{self._path}: {self.whole:,} of its first {self.place:,} bytes are whole MAVLink messages,"
                " expected nearly all; it is damaged, or another kind of file: give the log as recorded"
            )
        return self._file.read(count)


def _sender(message: Any) -> _Sender:
    return message.get_srcSystem(), message.get_srcComponent()


def _kind(message: Any) -> str:
    """Message type, with the name or instance that it carries."""
    kind = str(message.get_type())
    if kind in ("NAMED_VALUE_FLOAT", "NAMED_VALUE_INT"):
        kind = f"{kind}.{message.name}"
    instance = getattr(message, "_instance_field", None)
    if instance is not None and number(getattr(message, instance, None)) is not None:
        kind = f"{kind}[{getattr(message, instance)}]"
    return kind


def _flat(message: Any) -> Iterator[tuple[str, float]]:
    """Numeric fields of a message, arrays by index."""
    instance = getattr(message, "_instance_field", None)
    for name in message.fieldnames:
        value = getattr(message, name)
        if name == instance:
            continue
        if type(value) in (float, int):
            yield name, float(value)
        elif isinstance(value, list | tuple) and len(value) <= READING_SETTINGS.longest_array:
            for k, cell in enumerate(value):
                plain = number(cell)
                if plain is not None:
                    yield f"{name}[{k}]", plain


def _since_boot(message: Any) -> tuple[float, float] | None:
    """Time since the sender booted and the period of its counter, s; None where none is carried."""
    kind: Any = type(message)
    for name, unit, period in _counters(kind):
        value = getattr(message, name)
        if value and value * unit < SETTINGS.unix_from_s:
            return float(value) * unit, period
    return None


@cache
def _counters(kind: Any) -> tuple[tuple[str, float, float], ...]:
    """Fields of a message type that count since boot: name, unit and period, s."""
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    return tuple(
        (name, unit, SETTINGS.counter_values * unit if types[name] == "uint32_t" else math.inf)
        for name, unit in (("time_boot_ms", 1e-3), ("time_usec", 1e-6))
        if name in types
    )
