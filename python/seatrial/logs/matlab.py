"""MATLAB files: versions 5 to 7.2 (`matlab5`), version 7.3 (HDF5) by h5py.

A structure, or the top of the file, whose arrays have one length is a topic; a matrix is a field a column
(``name[0]``, ...). The time is the field that is called so; where a structure has none, the one time of
that length at the top of the file serves. Objects and functions are not read: nothing in a file is ever
run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.budget import Budget, claim
from seatrial.base.errors import TrialError
from seatrial.logs.clock import Counter32, TimeScale, rises, scale_of, time_fields
from seatrial.logs.formats import extra
from seatrial.logs.log import CHUNK_ROWS, MOST_FIELDS, Chunk, Log, Share, stem_of
from seatrial.logs.matlab5 import arrays
from seatrial.logs.rows import LONGEST_ARRAY

_FEWEST = 3  # samples of a signal
_DEEPEST = 8


def open_log(path: Path) -> Log:
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
            for begin in range(0, rows, CHUNK_ROWS):
                part = slice(begin, min(begin + CHUNK_ROWS, rows))
                count = part.stop - part.start
                stamps = np.full(count, np.nan)
                if clock is not None:
                    stamps = (clock[0][part] - clock[1].origin) * clock[1].factor
                values = [columns[name][part] for name in names]
                yield Chunk(topic, stamps, np.stack(values, axis=1) if values else np.empty((count, 0)))
            if share is not None:
                share((done + 1) / len(wanted))

    def _sort(self, found: Iterator[tuple[str, str, Array]]) -> None:
        """Put arrays (structure, name, values (n, k)) into topics by structure and length."""
        groups: dict[tuple[str, int], dict[str, Array]] = {}
        count = 0
        for structure, name, values in found:
            matrix = values[:, None] if values.ndim == 1 else values
            if matrix.shape[0] < matrix.shape[1] and matrix.shape[0] <= LONGEST_ARRAY:
                matrix = matrix.T
            if matrix.ndim != 2 or len(matrix) < _FEWEST or matrix.shape[1] > LONGEST_ARRAY:
                continue
            columns = groups.setdefault((structure, len(matrix)), {})
            for k in range(matrix.shape[1]):
                columns[name if matrix.shape[1] == 1 else f"{name}[{k}]"] = matrix[:, k]
                count += 1
            if count > MOST_FIELDS:
                raise TrialError(f"{self.path}: more than {MOST_FIELDS} signals; the file is damaged")
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
                self.note(f"{topic}: no signal of its length is a time")
                continue
            time = Counter32().of(time)
            scale = scale_of(names[0] if names else "time", "", time)
            if scale.unix:
                self.epoch_s = 0.0
            if scale.how:
                self.remark(f"{topic}: time: {scale.how}")
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
            log.note(f"{name}: a link to elsewhere, not followed")
            continue
        value = group[name]
        inner = f"{structure}.{name}" if structure else name
        if isinstance(value, h5py.Group):
            if depth < _DEEPEST:
                yield from _walk_hdf(inner, value, h5py, log, depth + 1)
        elif value.attrs.get("MATLAB_class", b"") in (b"char", b"cell", b"function_handle"):
            continue
        elif value.dtype.kind in "biuf" and value.ndim in (1, 2) and value.size >= _FEWEST:
            if value.size * 8 > Budget().unpacked_of(path_size(value)):
                log.note(f"{inner}: {value.size} values promised, more than the file can hold; left out")
                continue
            claim(value.size * (8 + value.dtype.itemsize))
            cells = np.asarray(value[()], float)
            yield structure, name, np.squeeze(cells.T) if cells.ndim == 2 else cells


def path_size(value: Any) -> int:
    """Bytes that an HDF5 data set takes in its file."""
    return int(value.id.get_storage_size())
