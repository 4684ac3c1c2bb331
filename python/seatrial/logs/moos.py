"""MOOS `.alog`: lines of time since the start, variable, source and value.

A variable is a topic with the field ``value``; where its value is a list of ``name=number`` pairs, as in a
node report, each name is a field. `epoch_s` is the LOGSTART of the header.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from seatrial.base.errors import TrialError
from seatrial.logs.log import READING_SETTINGS, Chunk, Event, Gathered, Log, Share

_PAIR = re.compile(r"([A-Za-z_]\w{0,63})=([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?=,|$)")
_MODES = ("MODE", "DEPLOY", "IVPHELM_STATE")
_LONGEST_LINE = 65_536  # bytes: a longer entry is no channel


def open_log(path: Path) -> Log:
    """Log of a MOOS community.

    Raises
    ------
    TrialError
        If no line of the file is an entry of an alog.
    """
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
