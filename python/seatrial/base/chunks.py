"""Chunks of work: cut, run anywhere, kept, and never done twice.

A `Chunk` is a function of a module, what it is called with, and the hash of everything that its result
depends on: its name is the same wherever and whenever it is asked for, and so is its result (to the bit among
the SIMD levels that fuse multiplication and addition, to 1e-9 otherwise). `run_chunks` runs chunks in this
process or on a `Fleet` (`seatrial.base.fleet`), keeps each result in the run directory as soon as it is
there, and takes up what an earlier run kept. Only as many chunks are under way as keep all workers busy, so
that memory does not grow with the work.

A record of every chunk says where and how it was computed:

=========== =============================================================================================
name        SHA-256 of function, part and inputs
part        what it is, for people
simd        instruction set of the core
host, pid   machine and process
wall_s      time that it took, s
attempts    how often it was begun: more than once where a worker was lost
sha256      of its table (Parquet), if its result is one
=========== =============================================================================================

Held by ``tests/base/test_chunks.py``.
"""

from __future__ import annotations

import os
import pickle
import socket
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from seatrial._core import simd_level
from seatrial.base.errors import SeatrialError
from seatrial.base.run import RunDirectory, sha256, version
from seatrial.base.work import one_blas_thread

if TYPE_CHECKING:
    from seatrial.base.fleet import Fleet

V = TypeVar("V")

RECORDS = "chunks.json"
"""File of a run directory with the record of every chunk."""


@dataclass(frozen=True)
class ChunkSettings:
    """How chunks of work go to workers."""

    most_attempts: int = 5  #: Attempts at a chunk whose workers are lost: it may be what kills them.
    #: Chunks under way per worker: one that is worked on, one that waits beside it.
    chunks_per_worker: int = 2


SETTINGS = ChunkSettings()


class Shared:
    """What many chunks are called with, packed for a worker once."""

    def __init__(self, value: Any) -> None:
        self.value = value

    @cached_property
    def packed(self) -> bytes:
        """The value as bytes.

        Raises `SeatrialError`: it cannot leave this process.
        """
        try:
            return pickle.dumps(self.value, protocol=pickle.HIGHEST_PROTOCOL)
        except Exception as error:
            raise SeatrialError(
                f"executor: expected work that can be sent to another process, found {error}; run it without"
                " an executor"
            ) from None


@dataclass(frozen=True)
class Chunk(Generic[V]):
    """A part of some work that can be done anywhere."""

    part: str  #: What it is, for people and as the name of its file.
    inputs: str  #: Hash of everything that the result depends on beside function and part.
    #: Called with the shared value and the arguments; defined in a module, so that others can import it.
    function: Callable[..., V]
    #: `shared`, `arguments`: what it is called with.
    shared: Shared
    arguments: tuple[Any, ...] = ()

    @property
    def name(self) -> str:
        """Hash that is the same on every machine and in every run."""
        return sha256(
            "\n".join([self.function.__module__, self.function.__qualname__, self.part, self.inputs])
        )

    def here(self) -> Answer[V]:
        """Its answer, computed in this process."""
        return _answer(self.function, self.shared.value, self.arguments)

    def order(self) -> tuple[Callable[..., Answer[V]], tuple[Any, ...]]:
        """Function and arguments that make another process compute the answer."""
        return work, (version("seatrial"), self.function, self.shared.packed, self.arguments)


@dataclass(frozen=True)
class Answer(Generic[V]):
    """Result of a chunk, and where it was computed."""

    value: V
    simd: str
    host: str
    pid: int
    wall_s: float


@dataclass(frozen=True)
class Done(Generic[V]):
    """A chunk that is done: its result, its record, and whether an earlier run had kept it."""

    chunk: Chunk[V]
    value: V
    record: Mapping[str, Any]
    kept: bool


@dataclass(frozen=True)
class Format(Generic[V]):
    """How results are kept."""

    #: Plain data (kept as JSON) or the content of a Parquet file.
    pack: Callable[[V], Mapping[str, Any] | bytes]
    unpack: Callable[[Any], V]  #: The result from either.


def as_it_is() -> Format[Any]:
    """Format of results that are not kept."""
    return Format(pack=lambda value: {}, unpack=lambda kept: kept)


def run_chunks(
    chunks: Iterable[Chunk[V]],
    run: RunDirectory,
    form: Format[V],
    *,
    fleet: Fleet | None = None,
    here: Callable[[Chunk[V]], V] | None = None,
    waiting: Callable[[], None] | None = None,
) -> Generator[Done[V], None, None]:
    """Chunks that are done, in their order; each is kept before it is given.

    `chunks`: asked for one by one, as far as workers are free; `run`: where results are kept and found again;
    `fleet`: where to work; in this process when omitted; `here`: the result of a chunk in this process, where
    its function is not told all (progress, for example); `waiting`: called twice a second while a fleet
    works; it may raise KeyboardInterrupt. Raises `SeatrialError`: what a chunk refuses; or workers are lost
    again and again. What was finished before is kept.
    """
    if fleet is None:
        for chunk in chunks:
            finished = _taken_up(chunk, run, form)
            if finished is None:
                finished = _finished(chunk, _here(chunk, here), run, form, attempts=1)
            yield finished
        return
    yield from _Window(chunks, run, form, fleet, waiting).done()


def work(asked: str, function: Callable[..., V], packed: bytes, arguments: tuple[Any, ...]) -> Answer[V]:
    """Answer to a chunk in a process that was sent one.

    Raises `SeatrialError`: another version of seatrial is installed here.
    """
    if (installed := version("seatrial")) != asked:
        raise SeatrialError(
            f"worker on {socket.gethostname()}: expected seatrial {asked}, found {installed}; install the"
            " same version on all machines"
        )
    with one_blas_thread():
        return _answer(function, _unpacked(packed), arguments)


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Any:
    return pickle.loads(packed)


def _answer(function: Callable[..., V], shared: Any, arguments: tuple[Any, ...]) -> Answer[V]:
    began = time.monotonic()
    value = function(shared, *arguments)
    return Answer(value, simd_level(), socket.gethostname(), os.getpid(), time.monotonic() - began)


def _here(chunk: Chunk[V], here: Callable[[Chunk[V]], V] | None) -> Answer[V]:
    if here is None:
        return chunk.here()
    return _answer(lambda _: here(chunk), None, ())


def _taken_up(chunk: Chunk[V], run: RunDirectory, form: Format[V]) -> Done[V] | None:
    """The chunk as an earlier run kept it."""
    kept = run.finished(chunk.part, chunk.name)
    if kept is None:
        return None
    packed = kept.get("result") if kept.get("sha256") is None else run.table(chunk.part, kept["sha256"])
    if packed is None:
        return None
    return Done(chunk, form.unpack(packed), _record(kept), kept=True)


def _finished(
    chunk: Chunk[V], answer: Answer[V], run: RunDirectory, form: Format[V], *, attempts: int
) -> Done[V]:
    packed = {} if run.path is None else form.pack(answer.value)
    table = packed if isinstance(packed, bytes) else None
    kept = {
        "name": chunk.name,
        "part": chunk.part,
        "simd": answer.simd,
        "host": answer.host,
        "pid": answer.pid,
        "wall_s": answer.wall_s,
        "attempts": attempts,
        "sha256": None if table is None else sha256(table),
    }
    run.keep(chunk.part, chunk.name, kept | ({"result": packed} if table is None else {}), table=table)
    return Done(chunk, answer.value, kept, kept=False)


def _record(kept: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in kept.items() if name not in ("result", "inputs")}


class _Window(Generic[V]):
    """Chunks under way: no more than keep the workers busy, none given before those ahead of it."""

    def __init__(
        self,
        chunks: Iterable[Chunk[V]],
        run: RunDirectory,
        form: Format[V],
        fleet: Fleet,
        waiting: Callable[[], None] | None,
    ) -> None:
        self.chunks, self.run, self.form, self.fleet = enumerate(chunks), run, form, fleet
        self.waiting = waiting or (lambda: None)
        self.pending: dict[Future[Answer[V]], tuple[int, Chunk[V]]] = {}
        self.attempts: dict[int, int] = {}
        self.ready: dict[int, Done[V]] = {}
        self.asked, self.given, self.exhausted = 0, 0, False

    def done(self) -> Iterator[Done[V]]:
        """Chunks in their order."""
        try:
            while True:
                self._fill()
                while self.given in self.ready:
                    finished = self.ready.pop(self.given)
                    self.given += 1
                    yield finished
                    self._fill()
                if self.exhausted and not self.pending and not self.ready:
                    return
                if self.pending:
                    self._collect()
        finally:
            # Ctrl-C or an error: what is under way is of no use to anybody.
            for future in self.pending:
                future.cancel()

    def _fill(self) -> None:
        """Take chunks up or send them off until the workers are busy."""
        room = SETTINGS.chunks_per_worker * max(self.fleet.slots, 1)
        while not self.exhausted and self.asked - self.given < 2 * room and len(self.pending) < room:
            try:
                place, chunk = next(self.chunks)
            except StopIteration:
                self.exhausted = True
                return
            self.asked = place + 1
            kept = _taken_up(chunk, self.run, self.form)
            if kept is None:
                self._send(place, chunk)
            else:
                self.ready[place] = kept
                if place == self.given:
                    return  # so that a long series of kept ones is given one by one

    def _send(self, place: int, chunk: Chunk[V]) -> None:
        attempt = self.attempts[place] = self.attempts.get(place, 0) + 1
        if (most := SETTINGS.most_attempts) < attempt:
            raise SeatrialError(
                f"{chunk.part}: its worker was lost {most} times, perhaps because of this part (out of"
                " memory?); finished parts are kept; run without an executor (without --dask) to see why"
            )
        function, arguments = chunk.order()
        self.pending[self.fleet.submit(chunk.name, attempt, function, *arguments)] = (place, chunk)

    def _collect(self) -> None:
        """Keep what is finished, and send again what was lost."""
        self.waiting()
        # Twice a second the progress is looked at while chunks are under way.
        finished, _ = wait(self.pending, timeout=0.5, return_when=FIRST_COMPLETED)
        lost, errors = [], []
        for future in finished:
            place, chunk = self.pending.pop(future)
            error = future.exception()
            if error is None:
                attempts = self.attempts.pop(place)
                answer = future.result()
                self.ready[place] = _finished(chunk, answer, self.run, self.form, attempts=attempts)
            elif self.fleet.was_lost(error):
                lost.append((place, chunk))
            else:
                errors.append(error)
        if errors:  # after what was finished beside it is kept
            raise errors[0]
        if not self.fleet.alive():
            for future in self.pending:
                future.cancel()
            lost += self.pending.values()
            self.pending.clear()
            self.fleet.recover()
        for place, chunk in sorted(lost, key=lambda each: each[0]):
            self._send(place, chunk)
