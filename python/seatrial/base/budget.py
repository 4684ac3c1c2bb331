"""What the reading of a stranger's file may cost, and the wrapper that makes one sentence of all that fails.

A file of two kilobytes can ask a parser for all memory and hours of work. `Budget` says what a file of a size
may take; `guarded` holds a block of code to it: a thread beside it looks at the processor time of the block
and at the memory of the process, and ends the block where either is spent. That works inside parsers that
know nothing of it, in one process, on every system. A parser of C is ended when it returns: what it allocates
in one go is asked for before, with `claim`.

Whatever else a parser raises becomes the error of the caller's kind, with the parser's as its cause; NumPy
and other libraries warn nobody in the meantime. Held by ``tests/base/test_budget.py``.
"""

from __future__ import annotations

import ctypes
import errno
import math
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seatrial.base.errors import SeatrialError, TrialError, foreign, reason

_MB = 1e6  # bytes

_LOOK_S = 0.02
"""Interval at which the spending is looked at: Python allocates some 20 MB in that time."""


@dataclass(frozen=True)
class Budget:
    """What a stranger's file may cost.

    The constant parts are what a hostile file of any small size gets; the parts in proportion to the size
    keep honest large files far from the limits: they are several times what the recordings of the tests take.
    """

    #: Processor time, s, whatever the size: a file of a few kilobytes takes some milliseconds, and the
    #: libraries that are loaded meanwhile one or two seconds.
    cpu_s: float = 8.0
    #: More of it per MB of the file, s. Tables of text and arrays take 0.02 to 0.1 s; formats whose messages
    #: Python decodes one by one state more in their row of `seatrial.logs.log.FORMATS`.
    cpu_s_per_mb: float = 0.2
    #: Growth of the process, MB, whatever the size: libraries 150 MB, a block of text and its table 200 MB.
    memory_mb: float = 600.0
    #: More of it per MB of the file. A number of two bytes becomes one of eight, which is there as a chunk,
    #: as a column and in the joined table.
    memory_mb_per_mb: float = 20.0
    #: `unpacked_mb`, `stream_mb`, `unpacked_ratio`: most MB to which a packed array or chunk, and a packed
    #: stream, may unpack: that much, and so many times what it takes. Text of a vehicle that lies still is
    #: packed 50 times; deflate reaches 1,000 times with nothing but zeros, as a single channel that never
    #: changes does.
    unpacked_mb: float = 100.0
    stream_mb: float = 32.0
    unpacked_ratio: float = 200.0

    def cpu_of(self, size: int, share: float = 1.0) -> float:
        """Processor time for a file of `size` bytes of which a share was read, s.

        What is not yet read counts as tables of text do, which suffices to look for it, unpack or sort it.
        """
        plain = min(Budget.cpu_s_per_mb, self.cpu_s_per_mb)
        return self.cpu_s + (plain + (self.cpu_s_per_mb - plain) * share) * size / _MB

    def memory_of(self, size: int) -> float:
        """Growth of the process for a file of `size` bytes, MB."""
        return self.memory_mb + self.memory_mb_per_mb * size / _MB

    def unpacked_of(self, packed: int) -> int:
        """Bytes to which `packed` bytes of an array or a chunk may unpack."""
        return int(self.unpacked_mb * _MB + self.unpacked_ratio * packed)

    def stream_of(self, packed: int) -> int:
        """Bytes to which the first `packed` bytes of a stream may unpack."""
        return int(self.stream_mb * _MB + self.unpacked_ratio * packed)


class _Spent(BaseException):
    """The budget of a block is spent; no ``except Exception`` of a parser takes it."""


_METERS = threading.local()
"""Blocks that are held to a budget, by thread: the outermost first."""


class _Meter:
    """Ends the block of the thread that made it when the budget is spent."""

    def __init__(self, budget: Budget, size: int) -> None:
        self.memory_mb, self.spent, self.share = budget.memory_of(size), "", math.nan
        self._budget, self._size = budget, size
        # A kind of its own: of nested blocks each ends its own.
        self.kind = type("_SpentHere", (_Spent,), {})
        self._thread = threading.get_ident()
        self._clock = _clock_of(self._thread)
        self._begun = self._clock()
        self._before = _resident_mb()
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._look, daemon=True)
        self._watch.start()

    def _look(self) -> None:
        while not self._over.wait(_LOOK_S):
            cpu_s = self._budget.cpu_of(self._size, 1.0 if math.isnan(self.share) else self.share)
            if self._clock() - self._begun > cpu_s:
                self.spent = f"{cpu_s:.0f} s of processor time"
            elif self.too_much(0):
                self.spent = f"{self.memory_mb:,.0f} MB of memory"
            with self._lock:
                if self.spent and not self._over.is_set():
                    _raise_in(self._thread, self.kind)
                    return

    def too_much(self, more: int) -> bool:
        """Whether `more` bytes beside what the process has taken since are over the budget."""
        return _resident_mb() - self._before + more / _MB > self.memory_mb

    def close(self) -> None:
        """Look no more; what was raised and did not arrive is taken back."""
        with self._lock:
            self._over.set()
            if self.spent:
                _raise_in(self._thread, None)


def _raise_in(thread: int, kind: type[BaseException] | None) -> None:
    """Raise an exception in a thread before its next instruction; None takes back one that did not arrive."""
    value = ctypes.py_object(kind) if kind is not None else None
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), value)


def _clock_of(thread: int) -> Callable[[], float]:
    """Clock of the processor time of a thread; of the process where the system keeps none per thread."""
    if hasattr(time, "pthread_getcpuclockid"):
        number = time.pthread_getcpuclockid(thread)
        return lambda: time.clock_gettime(number)
    return time.process_time


def _resident_mb() -> float:
    """Memory of the process without pages of mapped files, MB; the most so far where only that is known."""
    try:
        pages = Path("/proc/self/statm").read_bytes().split()
        return (int(pages[1]) - int(pages[2])) * os.sysconf("SC_PAGE_SIZE") / _MB
    except (OSError, IndexError, ValueError):  # no Linux
        pass
    try:
        import resource
    except ImportError:  # Windows: only the processor time is held
        return 0.0
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / _MB if sys.platform == "darwin" else most * 1024 / _MB


@contextmanager
def guarded(
    source: str | Path,
    doing: str,
    remedy: str,
    *,
    size: int = 0,
    budget: Budget | None = None,
    refusal: type[SeatrialError] = TrialError,
) -> Iterator[None]:
    """Hold a block that reads what a stranger wrote to a budget, and make one sentence of what it raises.

    `source`: the file, for messages; `doing`: what the block does: "reading this PX4 ULog"; `remedy`: what to
    do where it fails; `size`: bytes of the file, or of all that is read; `budget`: its limits; the usual ones
    when omitted; `refusal`: kind of the error. Raises `SeatrialError`: of the kind `refusal`: the budget is
    spent, or the block raised an error that is none of ours, which is the cause of this one. Our own errors
    and those of a stream that takes no more pass.
    """
    meter = _Meter(budget or Budget(), size)
    # Blocks within blocks: each is ended by its own meter.
    meters = _METERS.__dict__.setdefault("all", [])
    meters.append(meter)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            try:
                yield
            finally:
                meter.close()
                meters.remove(meter)
    except SeatrialError:
        raise
    except BaseException as error:
        if not isinstance(error, Exception) and not isinstance(error, meter.kind) and not _panicked(error):
            raise  # Ctrl-C, or the budget of a block around this one
        if isinstance(error, OSError) and error.errno in _STREAMS:
            raise
        raise refusal(f"{source}: {_why(error, doing, meter, size)}; {remedy}") from error


def claim(size: int) -> None:
    """End the block, as the thread beside it does, unless the budget has `size` bytes of memory left.

    For a parser that takes them in one go.
    """
    for meter in _METERS.__dict__.get("all", []):
        if meter.too_much(size):
            meter.spent = f"{meter.memory_mb:,.0f} MB of memory"
            raise meter.kind


def advance(share: float) -> None:
    """Tell how much of the file was read, 0 to 1: `Budget.cpu_of` grants time for that much and no more."""
    for meter in _METERS.__dict__.get("all", [])[-1:]:
        meter.share = meter.share if meter.share >= share else share


_STREAMS = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT)
"""What a stream or a disk says that takes no more: nothing is wrong with the file that is read."""


def _why(error: BaseException, doing: str, meter: _Meter, size: int) -> str:
    """Clause on why a block failed."""
    if isinstance(error, meter.kind):
        return (
            f"{doing} takes more than {meter.spent}; expected less for {_bytes(size)}: it is damaged or made"
            " to exhaust the machine"
        )
    if isinstance(error, MemoryError):
        return f"{doing} asks for more memory than there is; it is damaged or made to exhaust the machine"
    if isinstance(error, RecursionError):
        return f"{doing} goes deeper than any honest file is nested"
    if isinstance(error, OSError) and error.strerror:
        return f"{doing} failed ({reason(error)})"
    return f"{doing} failed ({foreign(error)})"


def _bytes(size: int) -> str:
    return f"{size:,} bytes" if size < 1e6 else f"{size / _MB:,.0f} MB"


def _panicked(error: BaseException) -> bool:
    """Whether a library of Rust ended a thread of its own: its exception is none of Python's kinds."""
    return type(error).__name__ == "PanicException"


def size_of(path: Path) -> int:
    """Bytes of a file, or of all files in a folder; 0 where there is none."""
    try:
        if path.is_dir():
            return sum(entry.stat().st_size for entry in path.rglob("*") if entry.is_file())
        return path.stat().st_size
    except OSError:  # gone, or not to be looked into: who reads it says so
        return 0
