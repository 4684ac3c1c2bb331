"""Files of arrays: MATLAB of versions 5 to 7.2, of version 7.3 (HDF5) by h5py, and Apache Parquet by polars.

A structure, or the top of a MATLAB file, whose arrays have one length is a topic; a matrix is a field a
column (``name[0]``, ...). The time is the field that is called so; where a structure has none, the one time
of that length at the top of the file serves. Objects and functions are not read: nothing in a file is ever
run.

A file of version 5 to 7.2 is a header of 128 bytes and data elements: a tag of type and size, then the
content, padded to eight bytes; a variable is an element of type 14 (matrix) whose parts are elements again,
or one of type 15 that is packed with zlib. Every size is checked against the bytes that there are: SciPy's
reader of these files ends the interpreter on some damaged ones. Format: MathWorks, MAT-File Format, 2024,
section 1.

A Parquet file is a table in columns, read in row groups. The names and places of the columns stand at its
end: one that is cut off cannot be read. A part of a column that is damaged is empty, with a note.
"""

from __future__ import annotations

import contextlib
import os
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.budget import Budget, claim
from seatrial.base.errors import TrialError, first_line, printable
from seatrial.logs.clock import (
    Counter32,
    RowStamps,
    TimeColumn,
    TimeScale,
    clock_times,
    joined_names,
    rises,
    scale_of,
    time_column,
    time_fields,
)  # fmt: skip
from seatrial.logs.log import READING_SETTINGS, Chunk, Log, Share, extra, stem_of

if TYPE_CHECKING:
    import polars as pl


@dataclass(frozen=True)
class MatlabSettings:
    """What is a signal, and when a file is damaged."""

    fewest_samples: int = 3  #: of a signal
    deepest: int = 8  #: structures within one another: deeper ones are damaged or hostile
    unpacked_bytes: int = 1 << 22  #: that are unpacked at a time


SETTINGS = MatlabSettings()


def open_matlab(path: Path) -> Log:
    """Log of a MATLAB file.

    Raises
    ------
    TrialError
        If the file cannot be read as one, h5py is missing, or it holds no signals.
    """
    with path.open("rb") as stream:
        head = stream.read(8)
    log = _Matlab(path, "matlab")
    hdf = head.startswith(b"\x89HDF") or _is_hdf(path)
    log._sort(_hdf_arrays(path, log) if hdf else arrays(path, log))
    if not log.fields:
        why = "".join(f"; {note}" for note in log.notes)
        raise TrialError(f"{path}: no signals; expected arrays of equal length, one of them a time{why}")
    return log


@dataclass
class _Matlab(Log):
    _columns: dict[str, dict[str, Array]] = field(default_factory=dict)
    _clocks: dict[str, tuple[Array, TimeScale] | None] = field(default_factory=dict)

    @property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Signals by structure."""
        return {topic: dict.fromkeys(columns, "") for topic, columns in self._columns.items()}

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the signals wanted."""
        for done, (topic, names) in enumerate(wanted.items()):
            columns = self._columns[topic]
            rows = len(next(iter(columns.values())))
            clock = self._clocks[topic]
            for begin in range(0, rows, READING_SETTINGS.chunk_rows):
                part = slice(begin, min(begin + READING_SETTINGS.chunk_rows, rows))
                count = part.stop - part.start
                stamps = np.full(count, np.nan)
                if clock is not None:
                    stamps = (clock[0][part] - clock[1].origin) * clock[1].factor
                values = [columns[name][part] for name in names]
                yield Chunk(topic, stamps, np.stack(values, axis=1) if values else np.empty((count, 0)))
            if share is not None:
                share((done + 1) / len(wanted))

    def _sort(self, arrays: Iterator[tuple[str, str, Array]]) -> None:
        """Put arrays (structure, name, values (n, k)) into topics by structure and length."""
        groups: dict[tuple[str, int], dict[str, Array]] = {}
        count = 0
        for structure, name, values in arrays:
            matrix = values[:, None] if values.ndim == 1 else values
            # Signals in rows: MATLAB users write both ways.
            if matrix.shape[0] < matrix.shape[1] and matrix.shape[0] <= READING_SETTINGS.longest_array:
                matrix = matrix.T
            if (
                matrix.ndim != 2
                or len(matrix) < SETTINGS.fewest_samples
                or matrix.shape[1] > READING_SETTINGS.longest_array
            ):
                continue
            columns = groups.setdefault((structure, len(matrix)), {})
            for k in range(matrix.shape[1]):
                columns[name if matrix.shape[1] == 1 else f"{name}[{k}]"] = matrix[:, k]
                count += 1
            if count > READING_SETTINGS.most_fields:
                raise TrialError(
                    f"{self.path}: more than {READING_SETTINGS.most_fields} signals; the file is damaged"
                )
        # Times at the top of the file serve the structures of their length.
        top = {len(c[n]): c[n] for (s, _), c in groups.items() if not s for n in time_fields(list(c))[:1]}
        for (structure, length), columns in groups.items():
            several = sum(other == structure for other, _ in groups) > 1
            topic = (structure or stem_of(self.path)) + (f" ({length} rows)" if several else "")
            names = [n for n in time_fields(list(columns)) if rises(Counter32().of(columns[n]))]
            time = columns[names[0]] if names else top.get(length)
            self._columns[topic] = columns
            if not structure:
                self.of_file.add(topic)
            if time is None:
                self._clocks[topic] = None
                self.note("no signal of time", topic)
                continue
            time = Counter32().of(time)
            scale = scale_of(names[0] if names else "time", "", time)
            if scale.unix:
                self.epoch_s = 0.0
            if scale.how:
                self.remark("scale of time", f"{topic}: time", how=scale.how)
            self._clocks[topic] = (time, scale)


def _is_hdf(path: Path) -> bool:
    """Whether a file with a MATLAB header is one of version 7.3."""
    with path.open("rb") as stream:
        return stream.read(520)[512:516] == b"\x89HDF"


def _hdf_arrays(path: Path, log: Log) -> Iterator[tuple[str, str, Array]]:
    h5py = extra("h5py", path)
    with h5py.File(path, "r") as file:
        yield from _walk_hdf("", file, h5py, log, 0)


def _walk_hdf(
    structure: str, group: Any, h5py: Any, log: Log, depth: int
) -> Iterator[tuple[str, str, Array]]:
    for name in group:
        if name.startswith("#"):
            continue
        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink):
            log.note("link", name)
            continue
        value = group[name]
        inner = f"{structure}.{name}" if structure else name
        if isinstance(value, h5py.Group):
            if depth < SETTINGS.deepest:
                yield from _walk_hdf(inner, value, h5py, log, depth + 1)
        elif value.attrs.get("MATLAB_class", b"") in (b"char", b"cell", b"function_handle"):
            continue
        elif value.dtype.kind in "biuf" and value.ndim in (1, 2) and value.size >= SETTINGS.fewest_samples:
            if value.size * 8 > Budget().unpacked_of(path_size(value)):
                log.note("promised too much", inner, count=value.size)
                continue
            claim(value.size * (8 + value.dtype.itemsize))
            cells = np.asarray(value[()], float)
            yield structure, name, np.squeeze(cells.T) if cells.ndim == 2 else cells


def path_size(value: Any) -> int:
    """Bytes that an HDF5 data set takes in its file."""
    return int(value.id.get_storage_size())


_HEADER = 128  # bytes, by the format
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _PACKED = 14, 15  # types of elements, by the format
# Classes of matrices, by the format: structure; object, function, opaque.
_STRUCTURE, _OBJECTS = 2, (3, 16, 17)
_NUMERIC = range(6, 16)  # classes of numbers, by the format: double to uint64


class _Damaged(Exception):
    """An element that does not hold what its tag promises."""


class _Element(NamedTuple):
    kind: int
    content: memoryview
    end: int


def arrays(path: Path, log: Log) -> Iterator[tuple[str, str, Array]]:
    """Structure, name and values (n,) or (n, k) of every numeric array of a file; notes of damage."""
    data = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise TrialError(
            f"{path}: not readable as a MATLAB file: expected the header of version 5 to 7.2 or 7.3; save it"
            " again with -v7"
        )
    whole, at = memoryview(data), _HEADER
    while at < len(data):
        try:
            element = _element(whole, at, order)
        except _Damaged:
            log.note("cut within variable", bytes=len(data) - at)
            # The rest of the file as an element: arrays of a structure that are whole are read.
            kind = int.from_bytes(data[at : at + 4], "little" if order == "<" else "big")
            element = _Element(kind, whole[at + 8 :], len(data))
        try:
            yield from _variable(element, order, log)
        except (_Damaged, zlib.error, struct.error) as error:
            log.note("variable damaged", byte=at, error=str(error))
        at = element.end


def _element(data: memoryview, at: int, order: str) -> _Element:
    """The element at a place; a small one has its content in its tag."""
    if at + 8 > len(data):
        raise _Damaged("a tag is missing")
    kind, size = struct.unpack_from(order + "II", data, at)
    begin = at + 8
    if kind >> 16:
        kind, size, begin = kind & 0xFFFF, kind >> 16, at + 4
        if size > 4:
            raise _Damaged("a small element is too large")
    if begin + size > len(data):
        raise _Damaged(f"{size} bytes promised, {max(len(data) - begin, 0)} there")
    end = begin + size if kind == _PACKED else at + 8 + (0 if begin == at + 4 else (size + 7) // 8 * 8)
    return _Element(kind, data[begin : begin + size], end)


def _variable(element: _Element, order: str, log: Log) -> Iterator[tuple[str, str, Array]]:
    if element.kind == _PACKED:
        element = _element(memoryview(_unpacked(element.content)), 0, order)
    if element.kind == _MATRIX:
        yield from _matrix("", None, element.content, order, log, 0)


def _unpacked(content: memoryview) -> bytearray:
    """A packed element, piece by piece, so that a budget can end it."""
    most = Budget().unpacked_of(len(content))
    unpacker = zlib.decompressobj()
    whole = bytearray(unpacker.decompress(content, SETTINGS.unpacked_bytes))
    while unpacker.unconsumed_tail:
        if len(whole) > most:
            raise _Damaged(f"more than {most:,} bytes packed into {len(content):,}")
        claim(
            len(whole) // 4 + SETTINGS.unpacked_bytes
        )  # an array of bytes grows by an eighth, and is copied
        whole += unpacker.decompress(unpacker.unconsumed_tail, SETTINGS.unpacked_bytes)
    return whole


def _matrix(
    structure: str, field: str | None, data: memoryview, order: str, log: Log, depth: int
) -> Iterator[tuple[str, str, Array]]:
    """The arrays of a matrix; `field` names it within a structure, where its own name is empty."""
    if not len(data):
        return
    flags = _element(data, 0, order)
    shape = _element(data, flags.end, order)
    called = _element(data, shape.end, order)
    if len(flags.content) < 1 or shape.kind != 5 or len(shape.content) % 4:
        raise _Damaged("no class or shape")
    (word,) = struct.unpack_from(order + "I", flags.content)
    kind, is_complex = word & 0xFF, bool(word & 0x0800)
    sizes = np.frombuffer(shape.content, order + "i4").tolist()
    name = bytes(called.content).decode("latin-1") if field is None else field
    inner = f"{structure}.{name}" if structure else name
    if kind in _OBJECTS:
        log.note("object", inner)
    elif kind == _STRUCTURE and depth < SETTINGS.deepest and sizes == [1, 1]:
        length = _element(data, called.end, order)
        names = _element(data, length.end, order)
        (width,) = struct.unpack_from(order + "i", length.content)
        if width < 1:
            raise _Damaged("no names of fields")
        at = names.end
        for k in range(0, len(names.content) - width + 1, width):
            part = _element(data, at, order)
            own = bytes(names.content[k : k + width]).partition(b"\0")[0].decode("latin-1")
            if part.kind == _MATRIX:
                yield from _matrix(inner, own, part.content, order, log, depth + 1)
            at = part.end
    elif kind in _NUMERIC and not is_complex and len(sizes) == 2 and min(sizes) >= 0:
        values = _element(data, called.end, order)
        code = _NUMBERS.get(values.kind)
        if code is None or len(values.content) != sizes[0] * sizes[1] * np.dtype(code).itemsize:
            raise _Damaged("the numbers do not fill the shape")
        # The numbers as floats, twice: before and after they are put in order.
        claim(16 * sizes[0] * sizes[1])
        cells = np.frombuffer(values.content, np.dtype(order + code)).astype(float)
        matrix = cells.reshape(sizes, order="F")
        yield structure, name, matrix.ravel() if 1 in sizes else matrix


def open_parquet(path: Path) -> Log:
    """Log of a Parquet file: one topic, called by the file's stem.

    Raises
    ------
    TrialError
        If the file is no Parquet file.
    """
    log = _Parquet(path, "parquet")
    log.fields  # noqa: B018 - a damaged file is refused here
    return log


@dataclass
class _Parquet(Log):
    @cached_property
    def _frame(self) -> pl.LazyFrame:
        import polars as pl

        return pl.scan_parquet(self.path, glob=False)

    @cached_property
    def _schema(self) -> pl.Schema:
        import polars as pl

        with self.path.open("rb") as stream:
            begun = stream.read(4) == b"PAR1"
            stream.seek(max(self.path.stat().st_size - 4, 0))
            ended = stream.read(4) == b"PAR1"
        if begun and not ended:
            raise TrialError(
                f"{self.path}: cut off: its end, which says what is in it, is missing; fetch or write the"
                " file again"
            )
        try:
            with _quiet():
                return self._frame.collect_schema()
        except (pl.exceptions.PolarsError, OSError, pl.exceptions.PanicException) as error:
            raise TrialError(
                f"{self.path}: not readable as Parquet ({first_line(error)}); is it another format?"
            ) from None

    @cached_property
    def fields(self) -> Mapping[str, Mapping[str, str]]:
        """Columns of numbers, times, and text that may be either."""
        for name, kind in self._schema.items():
            if kind.is_nested():
                self.note("no numbers", name, found=str(kind))
        kept = {
            name: ""
            for name, kind in self._schema.items()
            if kind.is_numeric()
            or kind.is_temporal()
            or kind.base_type().__name__ in ("Boolean", "Null", "String")
        }
        self.of_file.add(self.topic)
        return {self.topic: kept}

    @property
    def topic(self) -> str:
        """Name of the only topic."""
        return stem_of(self.path)

    @cached_property
    def _clock(self) -> TimeColumn | None:
        """Column of the time; None where there is none."""
        import polars as pl

        names = list(self.fields[self.topic])
        # Text is a time only where no number is.
        candidates = sorted(time_fields(names), key=lambda name: self._schema[name] == pl.String)
        typed = [name for name in names if self._schema[name].is_temporal() and name not in candidates]
        candidates += typed
        if not candidates:
            self.note("no time", why=None)
            return None
        pair = [name for name in joined_names(dict.fromkeys(names, "")) or () if name not in candidates]
        head = self._part(0, min(2_000, self._height), [*candidates, *pair])
        column, why = time_column(dict.fromkeys(names, ""), candidates, head, _numbers, first_row=1)
        if column is None:
            self.timeless = why
            self.note("no time", why=why)
        return column

    def _part(self, begin: int, count: int, names: Sequence[str]) -> pl.DataFrame:
        """Some rows of some columns; empty, with a note, where a column is damaged."""
        import polars as pl

        try:
            with _quiet():
                return self._frame.select(names).slice(begin, count).collect()
        except (pl.exceptions.PolarsError, OSError, pl.exceptions.PanicException) as error:
            if len(names) == 1:
                self.note("column damaged", names[0], error=first_line(error))
                return pl.DataFrame({names[0]: [None] * count}, schema={names[0]: pl.Float64})
        columns = [self._part(begin, count, [name]) for name in names]
        rows = min(column.height for column in columns)
        return pl.concat([column.head(rows) for column in columns], how="horizontal")

    def _word(self, cells: pl.Series, numbers: Array) -> None:
        """Keep what a column without numbers holds instead."""
        if np.isfinite(numbers).any() or cells.null_count() == len(cells):
            return
        if cells.dtype.base_type().__name__ == "String":
            first = str(cells.drop_nulls()[0])
            self.words.setdefault((self.topic, cells.name), f'text, the first "{printable(first, 30)}"')

    @cached_property
    def _height(self) -> int:
        import polars as pl

        try:
            with _quiet():
                return int(self._frame.select(pl.len()).collect().item())
        except (pl.exceptions.PolarsError, OSError, pl.exceptions.PanicException) as error:
            raise TrialError(
                f"{self.path}: not readable as Parquet ({first_line(error)}); the file is damaged: fetch or"
                " write it again"
            ) from None

    def chunks(self, wanted: Mapping[str, Sequence[str]], share: Share | None = None) -> Iterator[Chunk]:
        """Samples of the columns wanted."""
        (topic, names), *_ = wanted.items()
        needed = list(names)
        clock = self._clock
        time = RowStamps(self, clock, _numbers, clock_times)
        if clock is not None:
            needed += [name for name in (clock.name, clock.rest) if name and name not in needed]
        rows = self._height
        claim(8 * rows * len(needed))
        for begin in range(0, rows, READING_SETTINGS.chunk_rows):
            part = self._part(begin, min(READING_SETTINGS.chunk_rows, rows - begin), needed)
            values = [_numbers(part[name]) for name in names]
            for name, value in zip(names, values, strict=True):
                self._word(part[name], value)
            rows_of = np.stack(values, axis=1) if values else np.empty((part.height, 0))
            yield Chunk(topic, time.of(part), rows_of)
            if share is not None:
                share(min(1.0, (begin + READING_SETTINGS.chunk_rows) / rows))


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep polars from writing the trace of each thread that a damaged file stops."""
    kept = os.dup(2)
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _numbers(cells: pl.Series) -> Array:
    """Cells as numbers; dates as Unix times in s."""
    import polars as pl

    if cells.dtype.is_temporal():
        dated = clock_times(cells)
        return np.full(len(cells), np.nan) if dated is None else dated[0]
    return np.asarray(cells.cast(pl.Float64, strict=False).to_numpy().astype(float))
