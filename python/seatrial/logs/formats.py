"""Which reader a file needs, told by its first bytes and its ending.

A reader is a module with ``open_log(path) -> Log``. A further format is one more module and one more row in
`FORMATS`. Packages that only one format needs are imported by its module, when such a file is opened.
"""

from __future__ import annotations

import gzip
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from seatrial.base.budget import Budget, advance
from seatrial.base.errors import TrialError, nearest, reason
from seatrial.logs.log import reading

if TYPE_CHECKING:
    from seatrial.logs.log import Log

DAMAGED = (OSError, EOFError, zlib.error)
"""What reading a file raises that is damaged or packed and cut short."""


@dataclass(frozen=True)
class Format:
    """A format of logs: the module that reads it, its file endings, how its files begin, what it is.

    ``cpu_s_per_mb`` is the processor time that an honest file may take per MB and pass, s: some five times
    the 0.9 (MAVLink of short messages, MCAP, ROS bags, chunks packed several times), 0.5 (IMC), 0.2 (MOOS,
    text of DataFlash) and 0.05 s/MB (tables, arrays) that were measured.
    """

    module: str
    endings: tuple[str, ...]
    magic: tuple[bytes, ...]
    description: str
    cpu_s_per_mb: float = 0.2

    @property
    def budget(self) -> Budget:
        """What reading a file of this format may cost."""
        return Budget(cpu_s_per_mb=self.cpu_s_per_mb)


FORMATS: dict[str, Format] = {
    "dataflash": Format("dataflash", (".bin",), (b"\xa3\x95", b"FMT, "), "ArduPilot DataFlash log", 1.0),
    "mavlink": Format("mavlink", (".tlog",), (), "MAVLink telemetry log", 5.0),
    "ulog": Format("ulog", (".ulg", ".ulog"), (b"ULog\x01\x12\x35",), "PX4 ULog", 0.3),
    "rosbag": Format("rosbag", (".bag", ".db3"), (b"#ROSBAG V", b"SQLite format 3"), "ROS bag", 5.0),
    "mcap": Format("mcap", (".mcap",), (b"\x89MCAP",), "MCAP", 5.0),
    "matlab": Format("matlab", (".mat",), (b"MATLAB ", b"\x89HDF\r\n"), "MATLAB file"),
    "moos": Format("moos", (".alog",), (b"%%",), "MOOS alog", 1.0),
    "imc": Format("imc", (".lsf", ".lsf.gz"), (b"\x54\xfe", b"\xfe\x54"), "IMC log of DUNE (LSF)", 3.0),
    "parquet": Format("parquet", (".parquet", ".pq"), (b"PAR1",), "Apache Parquet", 0.3),
    "csv": Format("delimited", (".csv", ".tsv", ".txt", ".dat", ".csv.gz"), (), "table of text"),
}
"""Formats by name."""

_BINARY = ("dataflash", "mavlink", "ulog", "rosbag", "mcap", "matlab", "imc", "parquet")
_TEXT = frozenset(b"\t\n\r") | frozenset(range(32, 127))  # a binary log with another name is no such text


@dataclass(frozen=True)
class FormatSettings:
    """How much of a file is read to tell its format, or unpacked at a time."""

    head_bytes: int = 512  #: in which the signatures of all formats lie, the tag of a TAR file last
    unpacked_bytes: int = 65_536  #: that are unpacked at a time
    packing_ratio: float = 10.0  #: times as long is what gzip packed
    #: s that a second look has whatever opening took: with it both stay within 10 s
    least_budget_s: float = 2.0


SETTINGS = FormatSettings()


def format_of(path: Path) -> str:
    """Name of the format of a file; of a ROS 2 bag also its folder."""
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return "rosbag"
        raise TrialError(f"{path}: expected a log, but this is a folder; give its files")
    if path.is_symlink() and not path.exists():
        raise TrialError(
            f"{path}: expected a log, but this is a link that leads to no file, or back to itself; give the"
            " path of the file"
        )
    if not path.exists():
        raise TrialError(f"{path}: expected a log, but this does not exist; give the path of a file")
    if not path.is_file():
        raise TrialError(f"{path}: expected a log, but this is no regular file; give the path of a file")
    head = _head(path)
    if not head:
        raise TrialError(f"{path}: the file is empty; expected a log")
    for name, entry in FORMATS.items():
        if head.startswith(entry.magic) and entry.magic:
            return name
    # A telemetry log begins with a stamp in us, then the mark of a MAVLink frame.
    if len(head) > 8 and head[8] in (0xFD, 0xFE) and 9e14 < int.from_bytes(head[:8], "big") < 5e15:
        return "mavlink"
    ending = path.name.lower()
    text = all(byte in _TEXT for byte in head)
    for name, entry in FORMATS.items():
        if ending.endswith(entry.endings) and not (text and name in _BINARY):
            return name
    if b"\0" not in head or head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "csv"
    known = ", ".join(f"{entry.description} ({'/'.join(entry.endings)})" for entry in FORMATS.values())
    raise TrialError(f"{path}: no known format; expected one of: {known}")


def open_log(path: str | Path, reader: str | Callable[[Path], Log] | None = None) -> Log:
    """A log, open for reading.

    Parameters
    ----------
    path
        File, or folder of a ROS 2 bag.
    reader
        Name of a format in `FORMATS`, or a function from a path to a `Log`; told from the file when omitted.

    Raises
    ------
    TrialError
        If the file is in no known format, is not what it says it is, or a package is missing.
    """
    path = Path(path)
    if callable(reader):
        return reader(path)
    if reader is not None and reader not in FORMATS:
        raise TrialError(f'{path}: unknown reader "{reader}"{nearest(reader, FORMATS)}')
    name = format_of(path) if reader is None else reader
    entry = FORMATS[name]
    budget = entry.budget
    if not path.is_dir() and is_packed(path):
        budget = replace(budget, cpu_s_per_mb=SETTINGS.packing_ratio * budget.cpu_s_per_mb)
    begun_s = time.thread_time()
    with reading(path, entry.description, budget):
        log: Log = import_module(f"seatrial.logs.{entry.module}").open_log(path)
    # What a file of any small size may take, it takes once: opening reads some formats as a whole.
    log.budget = replace(
        budget, cpu_s=max(budget.cpu_s - time.thread_time() + begun_s, SETTINGS.least_budget_s)
    )
    return log


def extra(package: str, path: Path) -> Any:
    """A package that only some formats need."""
    try:
        return import_module(package)
    except ImportError:
        raise TrialError(
            f'{path}: reading this format needs the package "{package.partition(".")[0]}", which is not '
            "installed; install the readers: pip install 'seatrial[logs]'"
        ) from None


class Unpacked:
    """A packed stream: all that is before the damage, and no more than honest text unpacks to."""

    def __init__(self, path: Path, opener: Callable[..., Any] = gzip.open) -> None:
        self._path, self._size = path, path.stat().st_size
        self._file = path.open("rb")
        self._stream = opener(self._file, "rb")
        self.tell = self._file.tell
        self._given = 0  # bytes so far
        self._failed: Exception | None = None

    def read(self, size: int) -> bytes:
        """`size` bytes, fewer at the end or before the damage."""
        if self._failed is not None:
            raise self._failed
        content = bytearray()
        try:
            while len(content) < size and (
                part := self._stream.read1(min(size - len(content), SETTINGS.unpacked_bytes))
            ):
                content += part
        except DAMAGED as error:
            if not content:
                raise
            self._failed = error
        self._given += len(content)
        advance(self.tell() / self._size)
        if self._given > Budget().stream_of(packed := self.tell()):
            raise TrialError(
                f"{self._path}: its first {packed:,} bytes unpack to {self._given:,}; no log is packed more"
                f" than {Budget().unpacked_ratio:g} times: it is made to fill the memory, fetch it again"
            )
        return bytes(content)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()
        self._file.close()


def is_packed(path: Path) -> bool:
    """Whether gzip packed a file."""
    with path.open("rb") as stream:
        return stream.read(2) == b"\x1f\x8b"


def unpacked(path: Path) -> Any:
    """A binary stream of a file, unpacked where gzip packed it; its `tell` is the place in the file."""
    return Unpacked(path) if is_packed(path) else path.open("rb")


def _head(path: Path) -> bytes:
    try:
        with unpacked(path) as stream:
            head: bytes = stream.read(SETTINGS.head_bytes)
    except DAMAGED as error:
        raise TrialError(f"{path}: cannot be read: {reason(error)}") from None
    return head
