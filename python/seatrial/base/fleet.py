"""Fleets: workers of a `concurrent.futures` executor or of a Dask cluster, and what to do when some are lost.

Dask (``pip install 'seatrial[distributed]'``) is reached by the address of its scheduler; ``local`` starts as
many worker processes as this machine has processors, ``local:4`` four. Dask itself gives the work of a lost
worker to another one. When the scheduler is lost, the client waits for it, up to five minutes, and sends what
was under way again.

Held by ``tests/base/test_chunks.py`` and ``tests/base/test_dask.py``.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, InvalidStateError
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from seatrial.base.errors import SeatrialError

LOCAL = "local"


@dataclass(frozen=True)
class FleetSettings:
    """How long a scheduler of other machines may take."""

    #: Longest time for a scheduler to answer the first call, s: longer than a slow network takes.
    connect_s: float = 10.0
    restart_s: float = 300.0  #: Longest time for a scheduler that is started again, s.
    look_interval_s: float = 1.0  #: Time between two looks at the workers, s: each asks the scheduler.
    answer_s: float = 5.0  #: Longest time for a scheduler that answered before, s.


SETTINGS = FleetSettings()

Tell = Callable[[str], None]


class Fleet(ABC):
    """Where chunks of work are done."""

    @property
    @abstractmethod
    def slots(self) -> int:
        """Chunks that can be worked on at the same time."""

    @abstractmethod
    def submit(self, name: str, attempt: int, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """What will become of a function's call.

        `name` is a hash of the call: the same name has the same result. Attempts count from 1 on.
        """

    @abstractmethod
    def was_lost(self, error: BaseException) -> bool:
        """Whether an error says that a worker was lost, rather than that the work cannot be done."""

    def alive(self) -> bool:
        """Whether what was submitted is still being worked on."""
        return True

    def recover(self) -> None:  # noqa: B027 (most have nothing to do)
        """Wait until there is somebody to work again; raises `SeatrialError` where there is nobody."""


Workers = Executor | Fleet | str
"""What can be asked to work: an executor, the address of a Dask scheduler, a Dask client or a fleet."""


def threads_of(threads: int | None, executor: Any) -> int | None:
    """Threads of the core for a chunk: one per worker unless given, since a fleet has a worker per core."""
    return 1 if threads is None and executor is not None else threads


@contextlib.contextmanager
def fleet_of(executor: Any, *, tell: Tell | None = None) -> Iterator[Fleet | None]:
    """The fleet that an argument ``executor`` names; what is started for it is stopped at the end.

    `tell`: told a sentence when a worker or the scheduler is lost; a warning of the logger "seatrial" by
    default. Raises `SeatrialError`: it names none, Dask is not installed, or no scheduler answers.
    """
    report = tell or logging.getLogger("seatrial").warning
    client = getattr(executor, "_client", executor)  # the executor that a Dask client gives
    if executor is None or isinstance(executor, Fleet):
        yield executor
    elif isinstance(executor, str):
        with _dask(executor, report) as fleet:
            yield fleet
    elif hasattr(client, "get_executor"):
        fleet = _DaskFleet(client.scheduler.address, report, client=client)
        yield fleet
    elif isinstance(executor, Executor):
        yield _ExecutorFleet(executor)
    else:
        raise SeatrialError(
            f"executor: expected a concurrent.futures executor, a Dask client or the address of a Dask"
            f" scheduler (tcp://HOST:8786), found {type(executor).__name__}"
        )


class _ExecutorFleet(Fleet):
    """Workers of an executor. One whose processes died takes no more work."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    @property
    def slots(self) -> int:
        return int(getattr(self._executor, "_max_workers", 0) or os.cpu_count() or 1)

    def submit(self, name: str, attempt: int, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        try:
            return self._executor.submit(function, *arguments)
        except BrokenExecutor:
            raise self._broken() from None

    def was_lost(self, error: BaseException) -> bool:
        if isinstance(error, BrokenExecutor):
            raise self._broken() from None
        return False

    def _broken(self) -> SeatrialError:
        return SeatrialError(
            f"executor: a worker process of {type(self._executor).__name__} ended, so this executor is"
            " unusable; finished parts are kept in the run directory: run again with a new executor (Dask"
            " replaces lost workers)"
        )


@contextlib.contextmanager
def _dask(address: str, tell: Tell) -> Iterator[Fleet]:
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise SeatrialError(
            "executor: Dask is not installed; install it with pip install 'seatrial[distributed]', here and"
            " on every worker"
        ) from None
    for name in ("distributed.client", "distributed.core", "distributed.scheduler", "distributed.nanny"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what is lost is told in a sentence of our own
    with contextlib.ExitStack() as stack:
        if (workers := _local_workers(address)) is not None:
            cluster = distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
            )
            address = stack.enter_context(cluster).scheduler_address
        elif "://" not in address:
            raise SeatrialError(
                f"executor {address!r}: expected the address of a Dask scheduler such as tcp://HOST:8786, or"
                " local, or local:4 for four worker processes on this machine"
            )
        fleet = _DaskFleet(address, tell)
        stack.callback(fleet.close)
        yield fleet


def _local_workers(address: str) -> int | None:
    """Worker processes that are to be started on this machine; None for an address."""
    name, colon, count = address.partition(":")
    if name != LOCAL:
        return None
    if not colon:
        return os.cpu_count() or 1
    if not count.isdecimal() or int(count) < 1:
        raise SeatrialError(
            f"executor {address!r}: expected local:N with a number of worker processes from 1 on, for example"
            " local:4"
        )
    return int(count)


class _LostError(Exception):
    """What was under way when the connection to the scheduler was lost."""


class _DaskFleet(Fleet):
    """Workers of a Dask cluster by its scheduler's address; a given client is somebody else's to close."""

    def __init__(self, address: str, tell: Tell, *, client: Any = None) -> None:
        self._address, self._tell = address, tell
        self._lock = threading.Lock()
        self._client = _connected(address) if client is None else client
        self._workers: dict[str, int] = self._look() or {}
        self._looked, self._idle = time.monotonic(), False
        self._tell_if_idle()

    @property
    def slots(self) -> int:
        return sum(self._workers.values())

    def submit(self, name: str, attempt: int, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        answer: Future[Any] = Future()
        key = f"seatrial-{name}" if attempt == 1 else f"seatrial-{name}-{attempt}"
        try:
            asked = self._client.submit(function, *arguments, key=key, pure=False)
        except Exception as error:  # Dask raises many kinds when the scheduler has just gone
            if self._client.status == "running":
                raise
            answer.set_exception(_LostError(str(error)))
            return answer

        client = self._client

        # In the client's own loop, which ends with it: Dask calls everything that is told of a finished
        # future in one thread of the process, and a wait there would hold up every fleet after it.
        async def fetch() -> None:
            try:
                value = await client.gather(asked, asynchronous=True)
            except (Exception, asyncio.CancelledError) as error:
                of_the_work = asked.status == "error"
                failed: BaseException = error if of_the_work else _LostError(str(error) or asked.status)
                with contextlib.suppress(InvalidStateError):  # it was cancelled here in the meantime
                    answer.set_exception(failed)
            else:
                with contextlib.suppress(InvalidStateError):
                    answer.set_result(value)

        def cancel(mine: Future[Any]) -> None:
            if mine.cancelled():
                with contextlib.suppress(Exception):  # there may be no scheduler
                    asked.release()  # Dask ends what nobody waits for

        client.loop.add_callback(fetch)
        answer.add_done_callback(cancel)
        return answer

    def was_lost(self, error: BaseException) -> bool:
        lost: tuple[type[BaseException], ...] = (
            _LostError,
            CancelledError,
            asyncio.CancelledError,
            import_module("distributed").KilledWorker,
            import_module("distributed.comm").CommClosedError,
        )
        return isinstance(error, lost)

    def alive(self) -> bool:
        with self._lock:
            return self._alive()

    def recover(self) -> None:
        with self._lock:
            if self._client.status != "running":  # else another thread has done it
                self._recover()

    def _alive(self) -> bool:
        if self._client.status != "running":
            return False
        if time.monotonic() - self._looked < SETTINGS.look_interval_s:
            return True
        workers, self._looked = self._look(), time.monotonic()
        if workers is None:
            return bool(self._client.status == "running")
        for worker in self._workers.keys() - workers.keys():
            self._tell(f"Dask worker {worker} is lost; {len(workers)} left. Others do its work again.")
        self._workers = workers
        self._tell_if_idle()
        return True

    def _recover(self) -> None:
        patience = SETTINGS.restart_s
        self._tell(
            f"Dask scheduler {self._address} is lost: waiting up to {patience:.0f} s for it. Finished parts"
            " are kept."
        )
        end = time.monotonic() + patience
        while True:
            self.close()
            try:
                self._client = _connected(self._address)
                break
            except SeatrialError:
                if time.monotonic() > end:
                    raise
                time.sleep(SETTINGS.look_interval_s)
        self._workers = self._look() or {}
        self._idle = False
        if self._workers:
            self._tell(f"Dask scheduler {self._address} is back; workers: {len(self._workers)}.")
        self._tell_if_idle()

    def close(self) -> None:
        """Leave the cluster."""
        with contextlib.suppress(Exception):
            self._client.close(timeout=SETTINGS.answer_s)

    def _look(self) -> dict[str, int] | None:
        """Threads by address of every worker; None where the scheduler does not answer."""
        try:
            threads = self._client.sync(
                self._client.scheduler.ncores, workers=None, callback_timeout=SETTINGS.answer_s
            )
        except Exception:
            return None
        return dict(threads)

    def _tell_if_idle(self) -> None:
        """Say once that nobody works."""
        if not self._workers and not self._idle:
            self._tell(
                f"Dask scheduler {self._address} has no workers: waiting for one (dask worker"
                f" {self._address})."
            )
        self._idle = not self._workers


def _connected(address: str) -> Any:
    """Client of a scheduler.

    Raises `SeatrialError`: none answers there.
    """
    try:
        return import_module("distributed").Client(address, timeout=SETTINGS.connect_s, set_as_default=False)
    except (OSError, ValueError, RuntimeError, TypeError) as error:
        raise SeatrialError(
            f"executor {address}: no Dask scheduler answers there ({error}); start one (dask scheduler), or"
            " correct the address, which it prints"
        ) from None
