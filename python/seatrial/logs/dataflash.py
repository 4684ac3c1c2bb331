"""ArduPilot DataFlash logs (`.bin`, and `.log` of text) by pymavlink's index; values cut out in NumPy.

A message type is a topic, ``IMU[0]`` where the type counts instances. Stamps are TimeUS, the time since the
autopilot booted; `epoch_s` comes from the first GPS fix. Units are those of the log's FMTU messages where
it has them. Format: ArduPilot, AP_Logger, LogStructure.
"""

from __future__ import annotations

import contextlib
import io
import mmap
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.logs.formats import extra
from seatrial.logs.log import CHUNK_ROWS, Chunk, Event, Log, Share

__all__ = ["open_log"]

_CODES = {
    "b": "i1", "B": "u1", "M": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8",
    "f": "<f4", "d": "<f8", "g": "<f2", "c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4",
    "n": "S4", "N": "S16", "Z": "S64", "a": "S64",
}  # fmt: skip
_SCALED = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
_INSTANCES = ("I", "Inst", "Instance", "C")  # of types whose FMTU is not logged
_NOT_COUNTED = {"MODE", "PARM", "FMT", "FMTU", "MSG", "UNIT", "MULT", "CMD"}
_GPS_EPOCH_S, _LEAP_S, _WEEK_S = 315_964_800.0, 18.0, 604_800.0


@dataclass(frozen=True)
class _Type:
    """A message type: its packed layout, names and units of its columns, the instance column, its offsets."""

    name: str
    layout: np.dtype[Any]
    codes: str
    units: tuple[str, ...]
    instance: str | None
    offsets: np.ndarray[Any, np.dtype[np.int64]]


def open_log(path: Path) -> Log:
    """DataFlash log, binary or text.

    Raises
    ------
    TrialError
        If pymavlink is missing or the file is no DataFlash log.
    """
    reader = extra("pymavlink.DFReader", path)
    with path.open("rb") as stream:
        text = stream.read(4) == b"FMT,"
    if text:
        return _TextLog(path, "dataflash")

    class Index(reader.DFReader_binary):  # type: ignore[misc,name-defined]
        """pymavlink's index of offsets without its guess of the clock."""

        def init_clock(self) -> None:
            """Stamps are read from each message."""

    try:
        with _silent():
            index = Index(str(path))
    except Exception as error:  # a damaged format message may raise anything in pymavlink
        raise TrialError(
            f"{path}: not readable as a DataFlash log ({type(error).__name__}: {error}); its format messages"
            " are damaged: fetch the file from the vehicle again"
        ) from None
    log = _BinaryLog(path, "dataflash", index=index)
    log._report_damage()
    return log


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep pymavlink's compiled index from writing a line for every byte that it cannot read."""
    kept = os.dup(2)
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


@dataclass
class _BinaryLog(Log):
    index: Any = field(kw_only=True, repr=False)

    def __post_init__(self) -> None:
        self._types = dict(self._layouts())
        self.index.offsets = None  # lists of numbers: eight times the size of the arrays
        self.epoch_s = self._epoch()
        self.parameters = self._parameters()

    def _layouts(self) -> Iterator[tuple[str, _Type]]:
        for number, offsets in enumerate(self.index.offsets):
            form = self.index.formats.get(number)
            if form is None or not len(offsets):
                continue
            codes = form.format.rstrip("\0")
            names = list(form.columns)
            if len(names) != len(codes) or len(set(names)) != len(names):
                self.note(f"{form.name}: {len(codes)} values for {len(names)} columns; left out")
                continue
            layout = np.dtype([(name, _CODES[code]) for name, code in zip(names, codes, strict=True)])
            if layout.itemsize + 3 != form.len:
                self.note(f"{form.name}: {layout.itemsize + 3} bytes expected, {form.len} stated; left out")
                continue
            where = np.asarray(offsets, np.int64)
            whole = where + form.len <= self.index.data_len
            instance = form.instance_field
            if instance is None and form.name not in _NOT_COUNTED:
                instance = next((n for n in _INSTANCES if n in names and codes[names.index(n)] in "bB"), None)
            units = tuple(form.units) if form.units else ("",) * len(names)
            yield form.name, _Type(form.name, layout, codes, units, instance, where[whole])

    def _rows(self, kind: _Type, begin: int = 0, end: int | None = None) -> np.ndarray[Any, Any]:
        """Messages of a type as records."""
        where = kind.offsets[begin:end]
        data: mmap.mmap = self.index.data_map
        raw = np.frombuffer(data, np.uint8)
        cells = raw[where[:, None] + np.arange(3, kind.layout.itemsize + 3)]
        return np.ascontiguousarray(cells).view(kind.layout)[:, 0]

    def _numbers(self, kind: _Type, rows: np.ndarray[Any, Any], name: str) -> Array:
        code = kind.codes[(kind.layout.names or ()).index(name)]
        return np.asarray(rows[name].astype(float) * _SCALED.get(code, 1.0))

    def _stamps(self, kind: _Type, rows: np.ndarray[Any, Any]) -> Array:
        names = kind.layout.names or ()
        for name, factor in (("TimeUS", 1e-6), ("TimeMS", 1e-3)):
            if name in names:
                return np.asarray(rows[name].astype(float) * factor)
        return np.full(len(rows), np.nan)

    @cached_property
    def _instances(self) -> dict[str, tuple[int, ...]]:
        """Instances by type."""
        found: dict[str, tuple[int, ...]] = {}
        for name, kind in self._types.items():
            if kind.instance is not None:
                seen: set[int] = set()
                for begin in range(0, len(kind.offsets), CHUNK_ROWS):
                    rows = self._rows(kind, begin, begin + CHUNK_ROWS)
                    if rows[kind.instance].dtype.kind in "iu":
                        seen.update(np.unique(rows[kind.instance]).tolist())
                found[name] = tuple(sorted(seen))
        return found

    @cached_property
    def _topics(self) -> dict[str, tuple[str, int | None]]:
        """Type and instance by topic."""
        topics: dict[str, tuple[str, int | None]] = {}
        for name in self._types:
            for one in self._instances.get(name) or (None,):
                topics[name if one is None else f"{name}[{one}]"] = (name, one)
        return topics

    @cached_property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Units by field by topic; text is no field."""
        result = {}
        for topic, (name, _) in self._topics.items():
            kind = self._types[name]
            columns = zip(kind.layout.names or (), kind.codes, kind.units, strict=True)
            result[topic] = {
                column: unit
                for column, code, unit in columns
                if code not in "nNZa" and column not in ("TimeUS", "TimeMS", kind.instance)
            }
        return result

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the fields wanted, type after type."""
        by_type: dict[str, list[str]] = {}
        for topic in wanted:
            by_type.setdefault(self._topics[topic][0], []).append(topic)
        total = sum(len(self._types[name].offsets) for name in by_type) or 1
        done = 0
        for name, topics in by_type.items():
            kind = self._types[name]
            for begin in range(0, len(kind.offsets), CHUNK_ROWS):
                rows = self._rows(kind, begin, begin + CHUNK_ROWS)
                for topic in topics:
                    one = self._topics[topic][1]
                    own = rows if one is None else rows[rows[kind.instance] == one]
                    if len(own):
                        columns = [self._numbers(kind, own, column) for column in wanted[topic]]
                        values = np.stack(columns, axis=1) if columns else np.empty((len(own), 0))
                        yield Chunk(topic, self._stamps(kind, own), values)
                done += len(rows)
                if share is not None:
                    share(done / total)

    def _text(self, kind: _Type, rows: np.ndarray[Any, Any], name: str) -> list[str]:
        return [cell.decode("utf-8", "replace") for cell in rows[name].tolist()]

    def _epoch(self) -> float | None:
        kind = self._types.get("GPS")
        if kind is None or not {"GWk", "GMS", "Status"} <= set(kind.layout.names or ()):
            return None
        rows = self._rows(kind)
        fixed = rows[(rows["Status"] >= 3) & (rows["GWk"] > 1000)]
        if not len(fixed):
            return None
        gps = fixed["GWk"][0] * _WEEK_S + fixed["GMS"][0] * 1e-3
        return float(_GPS_EPOCH_S + gps - _LEAP_S - self._stamps(kind, fixed[:1])[0])

    def _parameters(self) -> dict[str, float]:
        kind = self._types.get("PARM")
        if kind is None or not {"Name", "Value"} <= set(kind.layout.names or ()):
            return {}
        rows = self._rows(kind)
        values = self._numbers(kind, rows, "Value").tolist()
        return dict(zip(self._text(kind, rows, "Name"), values, strict=True))

    def events(self) -> list[Event]:
        """Changes of mode and messages of the autopilot."""
        events = []
        said = self._types.get("MSG")
        if said is not None and "Message" in (said.layout.names or ()):
            rows = self._rows(said)
            texts = self._text(said, rows, "Message")
            events += [
                Event(t, "message", s) for t, s in zip(self._stamps(said, rows).tolist(), texts, strict=True)
            ]
        kind = self._types.get("MODE")
        if kind is not None and "Mode" in (kind.layout.names or ()):
            names = _modes(self.path, [event.text for event in events])
            rows = self._rows(kind)
            for t, number in zip(self._stamps(kind, rows).tolist(), rows["Mode"].tolist(), strict=True):
                events.append(Event(t, "mode", names.get(int(number), str(number))))
        return sorted(events)

    def _report_damage(self) -> None:
        known = sum(len(kind.offsets) * (kind.layout.itemsize + 3) for kind in self._types.values())
        lost = self.index.data_len - known
        if known == 0:
            raise TrialError(
                f"{self.path}: not a DataFlash log: it holds no message; is it another .bin file?"
            )
        if lost > 1024 + 0.001 * self.index.data_len:
            self.note(f"{lost} of {self.index.data_len} bytes are no readable messages; the others were read")


_LATER_SUB_MODES = {20: "MOTOR_DETECT", 21: "SURFTRAK"}
"""Modes of ArduSub 4.5 and later by their number (ArduSub's documentation), which pymavlink does not name."""


def _modes(path: Path, messages: Sequence[str]) -> dict[int, str]:
    """Name by number of the flight modes of the firmware that wrote the messages."""
    mavutil = extra("pymavlink.mavutil", path)
    tables = (
        ("ArduRover", "mode_mapping_rover"),
        ("ArduCopter", "mode_mapping_acm"),
        ("ArduPlane", "mode_mapping_apm"),
    )
    for firmware, table in tables:
        if any(firmware in text for text in messages):
            return dict(getattr(mavutil, table, {}))
    return _LATER_SUB_MODES | dict(getattr(mavutil, "mode_mapping_sub", {}))


@dataclass
class _TextLog(Log):
    """The text form: a line a message, FMT lines first."""

    def __post_init__(self) -> None:
        self._columns: dict[str, tuple[list[str], str]] = {}
        with self.path.open(encoding="utf-8", errors="replace") as stream:
            for line in stream:
                cells = [cell.strip() for cell in line.rstrip("\r\n").split(",")]
                if cells[0] == "FMT" and len(cells) > 5:
                    self._columns[cells[3]] = (cells[5:], cells[4])
                elif cells[0] == "PARM" and len(cells) > 3:
                    with contextlib.suppress(ValueError):
                        self.parameters[cells[2]] = float(cells[3])

    @cached_property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Columns by type."""
        return {
            name: {
                column: ""
                for column, code in zip(columns, codes, strict=False)
                if code not in "nNZa" and column not in ("TimeUS", "TimeMS")
            }
            for name, (columns, codes) in self._columns.items()
        }

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the columns wanted."""
        rows: dict[str, list[list[float]]] = {name: [] for name in wanted}
        size = max(self.path.stat().st_size, 1)
        done = 0
        with self.path.open("rb") as stream:
            for raw in stream:
                done += len(raw)
                cells = [cell.strip() for cell in raw.decode("utf-8", "replace").split(",")]
                name = cells[0]
                if name not in rows:
                    continue
                columns = self._columns[name][0]
                values = dict(zip(columns, cells[1:], strict=False))
                time = _float(values.get("TimeUS")) * 1e-6
                time = _float(values.get("TimeMS")) * 1e-3 if np.isnan(time) else time
                rows[name].append([time, *(_float(values.get(column)) for column in wanted[name])])
                if len(rows[name]) >= CHUNK_ROWS:
                    yield _chunk(name, rows[name])
                    rows[name] = []
                    if share is not None:
                        share(done / size)
        for name, left in rows.items():
            if left:
                yield _chunk(name, left)


def _float(cell: str | None) -> float:
    try:
        return float(cell) if cell else np.nan
    except ValueError:
        return np.nan


def _chunk(name: str, rows: list[list[float]]) -> Chunk:
    values = np.array(rows)
    return Chunk(name, values[:, 0], values[:, 1:])
