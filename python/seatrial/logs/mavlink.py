"""MAVLink telemetry logs (`.tlog`) by pymavlink.

A message type of the vehicle's autopilot is a topic; one of another component is ``TYPE@system.component``.
The ground station stamps what it receives, in bursts where the link is slow; where a message carries the
time since boot, that is used, put on the ground station's clock by the shortest delay of any message.
`epoch_s` is zero.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from seatrial.base.errors import TrialError
from seatrial.logs.formats import extra
from seatrial.logs.log import MOST_TOPICS, Chunk, Event, Log, Share
from seatrial.logs.rows import LONGEST_ARRAY, Gathered, number

__all__ = ["open_log"]

_STAMP_BYTES = 8
_AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1
_GROUND = 255  # the usual system number of a ground station
_TIMES = ("time_boot_ms", "time_usec")


def open_log(path: Path) -> Log:
    """Telemetry log.

    Raises
    ------
    TrialError
        If pymavlink is missing or the file holds no MAVLink messages.
    """
    log = _Telemetry(path, "mavlink", epoch_s=0.0)
    if not log.fields:
        raise TrialError(f"{path}: no MAVLink message in it; is it another kind of file?")
    return log


@dataclass
class _Telemetry(Log):
    _units: dict[str, dict[str, str]] = field(default_factory=dict)
    _events: list[Event] = field(default_factory=list)
    _boot: dict[int, float] = field(default_factory=dict)  # Unix time of boot by system

    def __post_init__(self) -> None:
        places = whole = 0
        mode: str | None = None
        mavutil = extra("pymavlink.mavutil", self.path)
        for message, _ in self._messages():
            kind = message.get_type()
            if kind.startswith(("BAD_DATA", "UNKNOWN")):
                places += kind.startswith("BAD_DATA")
                whole += 0 if kind.startswith("BAD_DATA") else _STAMP_BYTES + len(message.get_msgbuf())
                continue
            whole += _STAMP_BYTES + len(message.get_msgbuf())
            values = dict(_flat(message))
            topic = _topic(message)
            known = self._units.setdefault(topic, {})
            if len(self._units) > MOST_TOPICS:
                raise TrialError(f"{self.path}: more than {MOST_TOPICS} topics; the file is damaged")
            for name in values:
                if name not in known:
                    known[name] = str(message.fieldunits_by_name.get(name.partition("[")[0], ""))
            received = float(message._timestamp)
            boot = _since_boot(message)
            if boot is not None:
                system = message.get_srcSystem()
                self._boot[system] = min(self._boot.get(system, math.inf), received - boot)
            if kind == "PARAM_VALUE":
                self.parameters[str(message.param_id)] = float(message.param_value)
            elif kind == "STATUSTEXT":
                self._events.append(Event(received, "message", str(message.text)))
            elif kind == "HEARTBEAT" and "@" not in topic:
                now = str(mavutil.mode_string_v10(message))
                if now != mode:
                    self._events.append(Event(received, "mode", now))
                    mode = now
        size = self.path.stat().st_size
        lost = size - whole
        if places:
            self.note(
                f"{lost:,} of {size:,} bytes ({100.0 * lost / size:.2g} %) are no whole messages, in"
                f" {places:,} {'places' if places > 1 else 'place'}; they were skipped, the others read"
            )
        elif lost > 0:
            self.note(f"cut off within its last message: its {lost} bytes are left out")

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
        for count, (message, done) in enumerate(self._messages()):
            if share is not None and count % 4096 == 0:
                share(done)
            kind = message.get_type()
            if kind.startswith(("BAD_DATA", "UNKNOWN")):
                continue
            topic = _topic(message)
            if topic not in wanted:
                continue
            boot = _since_boot(message)
            origin = self._boot.get(message.get_srcSystem())
            stamp = float(message._timestamp) if boot is None or origin is None else origin + boot
            chunk = gathered.add(topic, stamp, dict(_flat(message)))
            if chunk is not None:
                yield chunk
        yield from gathered.rest()

    def _messages(self) -> Iterator[tuple[Any, float]]:
        """Messages and the share of the file up to each."""
        mavutil = extra("pymavlink.mavutil", self.path)
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            stream = mavutil.mavlogfile(str(self.path), robust_parsing=True)
        size = max(self.path.stat().st_size, 1)
        try:
            while True:
                try:
                    message = stream.recv_msg()
                except Exception as error:  # a damaged frame may raise anything in pymavlink
                    self.note(
                        f"stopped at a damaged message ({type(error).__name__}); what came before was read"
                    )
                    return
                if message is None:
                    return
                yield message, stream.f.tell() / size
        finally:
            stream.close()


def _topic(message: Any) -> str:
    kind = str(message.get_type())
    system, component = message.get_srcSystem(), message.get_srcComponent()
    if kind in ("NAMED_VALUE_FLOAT", "NAMED_VALUE_INT"):
        kind = f"{kind}.{message.name}"
    instance = getattr(message, "_instance_field", None)
    if instance is not None and number(getattr(message, instance, None)) is not None:
        kind = f"{kind}[{getattr(message, instance)}]"
    return kind if component == _AUTOPILOT and system != _GROUND else f"{kind}@{system}.{component}"


def _flat(message: Any) -> Iterator[tuple[str, float]]:
    """Numeric fields of a message, arrays by index."""
    instance = getattr(message, "_instance_field", None)
    for name in message.get_fieldnames():
        value = getattr(message, name)
        if name == instance:
            continue
        plain = number(value)
        if plain is not None:
            yield name, plain
        elif isinstance(value, list | tuple) and len(value) <= LONGEST_ARRAY:
            for k, cell in enumerate(value):
                plain = number(cell)
                if plain is not None:
                    yield f"{name}[{k}]", plain


def _since_boot(message: Any) -> float | None:
    """Time since the sender booted, s; None where the message does not carry it."""
    value = getattr(message, "time_boot_ms", None)
    if value:
        return float(value) * 1e-3
    value = getattr(message, "time_usec", None)
    if value and value < 1e15:  # else Unix time
        return float(value) * 1e-6
    return None
