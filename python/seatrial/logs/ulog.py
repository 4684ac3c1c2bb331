"""PX4 ULog by pyulog.

A topic is a uORB topic, with ``.1`` after it for further instances; stamps are the time since boot. pyulog
keeps every sample of the topics that it reads, so a large log is read in groups of topics of bounded size.
"""

from __future__ import annotations

import contextlib
import io
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.base.errors import TrialError
from seatrial.logs.formats import extra
from seatrial.logs.log import CHUNK_ROWS, Chunk, Event, Log, Share

__all__ = ["open_log"]

_GROUP_BYTES = 200_000_000


def open_log(path: Path) -> Log:
    """ULog file.

    Raises
    ------
    TrialError
        If pyulog is missing or the file is no ULog.
    """
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
        self._sizes = _sizes(self.path)
        for group in self._groups(self._sizes):
            whole = self._parse(group)
            for data in whole.data_list:
                names = [entry.field_name for entry in data.field_data]
                if "timestamp" not in names:
                    self.note(f"{_topic(data)}: its samples have no timestamp; left out")
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
                    self.note(f"clock: time zone offset {origin} s as logged, not applied")
            if whole.file_corruption:
                self.note("parts of the file are damaged; the others were read")
            if whole.dropouts:
                lost = sum(dropout.duration for dropout in whole.dropouts) * 1e-3
                self.note(f"{len(whole.dropouts)} drop-outs of the logger, {lost:.3g} s in all")
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
                for begin in range(0, len(stamps), CHUNK_ROWS):
                    part = slice(begin, begin + CHUNK_ROWS)
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
        said = io.StringIO()
        try:
            with contextlib.redirect_stdout(said):
                return package.ULog(str(self.path), list(names), True)
        except Exception as error:  # a damaged header may raise anything in pyulog
            raise TrialError(
                f"{self.path}: not readable as a ULog ({type(error).__name__}: {error}); fetch the file again"
            ) from None


def _topic(data: Any) -> str:
    return f"{data.name}.{data.multi_id}" if data.multi_id else str(data.name)


def _numbered(topic: str) -> bool:
    return topic.rpartition(".")[2].isdigit() and "." in topic


def _sizes(path: Path) -> dict[str, int]:
    """Bytes of samples by uORB name: the frames of the file are walked over, not read.

    A frame is its size (2 bytes), its kind (1 byte) and its content; kind "A" names a subscription, "D" is a
    sample.
    """
    names: dict[int, str] = {}
    sizes: dict[str, int] = {}
    with path.open("rb") as stream:
        stream.seek(16)
        while len(head := stream.read(3)) == 3:
            size, kind = struct.unpack("<HB", head)
            body = stream.read(size)
            if kind == ord("A") and size > 3:
                number = int.from_bytes(body[1:3], "little")
                names[number] = body[3:].decode("utf-8", "replace")
                sizes.setdefault(names[number], 0)
            elif kind == ord("D") and size > 2:
                name = names.get(int.from_bytes(body[:2], "little"))
                if name is not None:
                    sizes[name] += size
    return sizes
