"""`seatrial.base.chunks` here, on threads and on processes: order, back pressure, what is kept, errors."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from seatrial.base import chunks as chunk_module
from seatrial.base.chunks import Chunk, Shared, run_chunks
from seatrial.base.errors import SeatrialError, TrialError
from seatrial.base.fleet import Fleet, fleet_of
from seatrial.base.run import RunDirectory
from tests.base.chunk_work import FORM, square, squares


def test_results_are_the_same_and_in_order_wherever_they_are_computed() -> None:
    expected = [n * n for n in range(9)]
    spawned = multiprocessing.get_context("spawn")
    for make in (
        lambda: None,
        lambda: ThreadPoolExecutor(3),
        lambda: ProcessPoolExecutor(2, mp_context=spawned),
    ):
        executor = make()
        with RunDirectory(None) as run, fleet_of(executor) as fleet:
            done = list(run_chunks(squares(9, sleep_s=0.01), run, FORM, fleet=fleet))
        assert [one.value["square"] for one in done] == expected
        hosts = {(one.record["host"], one.record["simd"]) for one in done}
        assert len(hosts) == 1
        assert all(one.record["wall_s"] >= 0.01 and one.record["attempts"] == 1 for one in done)
        if isinstance(executor, ProcessPoolExecutor):
            assert os.getpid() not in {one.record["pid"] for one in done}
        if executor is not None:
            executor.shutdown()


class Counting(Fleet):
    """A fleet that loses what it is told to lose and counts what is under way."""

    def __init__(self, losses: int = 0) -> None:
        self.losses, self.under_way, self.most = losses, list[Future[Any]](), 0
        self.late: dict[Future[Any], Callable[[], Any]] = {}

    @property
    def slots(self) -> int:
        return 2

    def submit(self, name: str, attempt: int, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        self.under_way = [future for future in self.under_way if not future.done()]
        future: Future[Any] = Future()
        self.under_way.append(future)
        self.late[future] = lambda: function(*arguments)
        self.most = max(self.most, len(self.under_way))
        if self.losses:
            self.losses -= 1
            future.set_exception(ConnectionResetError())
        elif len(self.under_way) == 4:  # the last one first: order must not come from luck
            for waiting in reversed(self.under_way):
                if not waiting.done():
                    waiting.set_result(self.late[waiting]())
        return future

    def was_lost(self, error: BaseException) -> bool:
        return isinstance(error, ConnectionResetError)


def test_few_chunks_are_asked_for_ahead_and_given_in_order() -> None:
    """Back pressure: of a million chunks only those that keep the workers busy exist."""
    asked = []

    def many() -> Iterator[Chunk[dict[str, Any]]]:
        packed = Shared({})
        for n in range(1_000_000):
            asked.append(n)
            yield Chunk(f"number {n}", "inputs", square, packed, (n,))

    fleet = Counting()
    with RunDirectory(None) as run:
        given = run_chunks(many(), run, FORM, fleet=fleet)
        first = [next(given).value["square"] for _ in range(20)]
        given.close()
    assert first == [n * n for n in range(20)]
    assert fleet.most <= 4
    assert len(asked) <= 20 + 8


def test_a_chunk_whose_worker_is_lost_is_done_again_but_not_for_ever() -> None:
    with RunDirectory(None) as run:
        done = list(run_chunks(squares(4), run, FORM, fleet=Counting(losses=3)))
        assert [one.value["square"] for one in done] == [0, 1, 4, 9]
        assert sorted(one.record["attempts"] for one in done) == [1, 2, 2, 2]
        with pytest.raises(
            SeatrialError, match=r"number 0: its worker was lost 5 times.*run without an executor"
        ):
            list(run_chunks(squares(1), run, FORM, fleet=Counting(losses=99)))


def test_finished_chunks_are_taken_up_and_an_error_ends_the_work(tmp_path: Path) -> None:
    """A user's mistake comes back as it is, is not tried again, and costs no finished chunk."""
    marks = tmp_path / "marks"
    marks.mkdir()
    with (
        ThreadPoolExecutor(1) as pool,
        RunDirectory(tmp_path / "run") as run,
        fleet_of(pool) as fleet,
        pytest.raises(TrialError, match="number 5: expected another one"),
    ):
        list(run_chunks(squares(9, bad=5, folder=str(marks)), run, FORM, fleet=fleet))
    begun = {path.name.partition("-")[0] for path in marks.iterdir()}
    assert {"0", "1", "2", "3", "4"} <= begun
    with RunDirectory(tmp_path / "run") as run:
        done = list(run_chunks(squares(9, folder=str(marks)), run, FORM))
        assert [one.kept for one in done[:5]] == [True] * 5
        assert [one.value["square"] for one in done] == [n * n for n in range(9)]
        # Other inputs are other chunks.
        (other,) = run_chunks([replace(squares(1)[0], inputs="others")], run, FORM)
        assert not other.kept
    counted = [path.name.partition("-")[0] for path in marks.iterdir()]
    assert len([n for n in counted if int(n) < 5]) == 5


def test_a_table_that_is_torn_is_computed_again(tmp_path: Path) -> None:
    form = replace(FORM, pack=lambda value: str(value).encode(), unpack=eval)
    with RunDirectory(tmp_path / "run") as run:
        list(run_chunks(squares(2), run, form))
        tables = sorted((run.workspace / "stages").glob("*.parquet"))
        assert len(tables) == 2
        tables[0].write_bytes(b"torn")
        assert [one.kept for one in run_chunks(squares(2), run, form)] == [False, True]


def test_what_cannot_work_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """An executor whose process died, work that cannot be sent, another version, no executor at all."""
    pool = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))
    with (
        pool,
        RunDirectory(None) as run,
        fleet_of(pool) as fleet,
        pytest.raises(SeatrialError, match="worker process of ProcessPoolExecutor ended"),
    ):
        list(run_chunks([Chunk("exit", "", _exit, Shared(3))], run, FORM, fleet=fleet))
    with RunDirectory(None) as run, pytest.raises(SeatrialError, match="sent to another process"):
        list(run_chunks([Chunk("", "", square, Shared(lambda: 0), (1,))], run, FORM, fleet=Counting()))
    with pytest.raises(SeatrialError, match=r"expected seatrial 0\.0, found .*the same version"):
        chunk_module.work("0.0", square, b"", ())
    for wrong, match in {
        3: "found int",
        "here": "expected the address of a Dask scheduler",
        "local:0": "worker processes from 1 on",
    }.items():
        with pytest.raises(SeatrialError, match=match), fleet_of(wrong):
            pass
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(SeatrialError, match=r"pip install 'seatrial\[distributed\]'"), fleet_of("tcp://x:1"):
        pass


def _exit(code: int) -> dict[str, Any]:
    os._exit(code)
