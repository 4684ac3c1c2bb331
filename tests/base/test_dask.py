"""A real Dask scheduler and workers on loopback: lost ones, a killed client, results to the bit."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import seatrial as st
from seatrial._core import simd_level
from seatrial.base.chunks import run_chunks
from seatrial.base.errors import SeatrialError, TrialError
from seatrial.base.fleet import fleet_of
from seatrial.base.run import RunDirectory
from seatrial.verification import missions
from tests.base.chunk_work import FORM, squares
from tests.verification.verifying import campaign

REPOSITORY = Path(__file__).parents[2]


class Cluster:
    """A scheduler and workers as processes of their own, which the test kills and stops."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address, self.folder = f"tcp://127.0.0.1:{self.port}", folder
        self.workers: list[subprocess.Popen[str]] = []
        self.scheduler = self._start("scheduler", "--port", str(self.port))

    def _start(self, *arguments: str, **environment: str) -> subprocess.Popen[str]:
        # One script stands for `dask scheduler` and `dask worker`.
        return self.process("-m", "dask", *arguments, "--host", "127.0.0.1", "--no-dashboard", **environment)

    def process(self, *arguments: str, **environment: str) -> subprocess.Popen[str]:
        """A process of Python in the repository."""
        log = (self.folder / f"log-{time.monotonic_ns()}").open("w")
        around = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(REPOSITORY)} | environment
        return subprocess.Popen(
            [sys.executable, *arguments], cwd=self.folder, env=around, stdout=log, stderr=log, text=True
        )

    def worker(self, **environment: str) -> subprocess.Popen[str]:
        """One more worker."""
        options = ("--nthreads", "1", "--no-nanny", "--local-directory", str(self.folder))
        self.workers.append(self._start("worker", self.address, *options, **environment))
        return self.workers[-1]

    def restart_scheduler(self) -> None:
        """Kill the scheduler, with which its workers end, and start all again."""
        end(self.scheduler)
        for worker in self.workers:
            end(worker)
        self.scheduler = self._start("scheduler", "--port", str(self.port))

    def stop(self) -> None:
        """Stop all that was started."""
        for process in (*self.workers, self.scheduler):
            end(process)


def end(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGKILL)
    process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    made = Cluster(tmp_path_factory.mktemp("dask"))
    yield made
    made.stop()


def until(happened: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + 60.0
    while not happened():
        assert time.monotonic() < end_s, what
        time.sleep(0.02)


@pytest.mark.long
def test_a_verification_on_workers_of_other_simd_levels_is_the_local_one(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit by bit, as both levels fuse; every chunk says which one flew it."""
    levels = {simd_level(), "avx2"} if simd_level() == "avx512" else {simd_level()}
    for level in levels:
        cluster.worker(SEATRIAL_SIMD=level)
    monkeypatch.setattr(missions, "MISSION_SETTINGS", missions.MissionSettings(chunk=4))
    asked = campaign(tmp_path)
    local = asked.verify(runs=18, work=st.Work(run_dir=tmp_path / "local"))
    told: list[str] = []
    with fleet_of(cluster.address, tell=told.append) as fleet:
        assert fleet is not None
        until(lambda: fleet.alive() and fleet.slots == len(levels), "workers")
        found = asked.verify(runs=18, work=st.Work(run_dir=tmp_path / "dask", executor=fleet))
    assert found.requirements[0].to_dict() == local.requirements[0].to_dict()
    for path in [tmp_path / "local" / "missions.parquet", *(tmp_path / "local" / "stages").glob("*.parquet")]:
        assert (tmp_path / "dask" / path.relative_to(tmp_path / "local")).read_bytes() == path.read_bytes()
    records = json.loads((tmp_path / "dask" / "chunks.json").read_text())
    assert {one["simd"] for one in records} == levels
    assert os.getpid() not in {one["pid"] for one in records}
    assert len(records) == len(found.records) == 5
    # A user's mistake that only a worker meets comes back as it is.
    with (
        RunDirectory(None) as run,
        fleet_of(cluster.address) as fleet,
        pytest.raises(TrialError, match="number 1: expected another one; choose it"),
    ):
        list(run_chunks(squares(3, bad=1), run, FORM, fleet=fleet))
    with pytest.raises(SeatrialError, match="no Dask scheduler answers there"), fleet_of("tcp://127.0.0.1"):
        pass


@pytest.mark.long
def test_nothing_is_lost_when_worker_client_and_scheduler_are_killed(
    cluster: Cluster, tmp_path: Path
) -> None:
    """The result is that of an undisturbed run, and no finished chunk is computed again."""
    count = 40

    def client() -> subprocess.Popen[str]:
        return cluster.process(
            "-m", "tests.base.chunk_work", str(tmp_path), cluster.address, str(count), "0.15"
        )

    def kept() -> dict[str, int]:
        """How often each number was computed whose result is in the run directory."""
        names = [path.stem for path in (tmp_path / "run.partial" / "stages").glob("*.json")]
        computed = Counter(path.name.partition("-")[0] for path in tmp_path.glob("*-*-*"))
        return {name: computed[name.split("_")[1].partition("-")[0]] for name in names}

    def more(than: int) -> None:
        begun = len(kept())
        until(lambda: len(kept()) >= begun + than, f"{than} chunks more")

    for _ in range(2 - sum(worker.poll() is None for worker in cluster.workers)):
        cluster.worker()
    first = client()
    more(4)
    end(cluster.workers[-1])
    more(4)
    end(first)
    before = kept()
    cluster.worker()
    second = client()
    more(4)
    cluster.restart_scheduler()
    survived = kept()
    cluster.worker()
    assert second.wait(timeout=120) == 0
    results = [json.loads(path.read_text()) for path in (tmp_path / "run.partial" / "stages").glob("*.json")]
    assert {one["part"]: one["result"]["square"] for one in results} == {
        f"number {n}": n * n for n in range(count)
    }
    after = kept()
    assert len(before) >= 8
    assert len(survived) >= len(before) + 4
    assert {name: after[name] for name in before | survived} == before | survived
    assert max(one["attempts"] for one in results) > 1
