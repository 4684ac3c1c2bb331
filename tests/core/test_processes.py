"""Many processes and many threads: the core works after a fork, and refuses what is no number."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import seatrial as st
from seatrial._core import checked_threads

GUARD_S = 120.0

STATUS = Path("/proc/self/status")

USE = """
import multiprocessing, os, sys, warnings
import numpy as np
import seatrial as st
warnings.simplefilter("ignore")  # Python warns of every fork of a process with threads
vehicle = st.Vehicle.load("cwolf")
def use(_=None):
    factors = {"X_uu": np.linspace(1.0, 1.2, 24) * vehicle.coefficients()["X_uu"]}
    runs = st.simulate_batch(vehicle, factors, np.arange(50) * 0.1)
    brief = st.Conditions(max_time_s=5.0)
    flown = st.fly_batch("cwolf", "cwolf", MISSION, seeds=range(3), conditions=brief, logs=True)
    return float(runs.position[:, -1, 0].sum()) + float(np.abs(flown.log(2)).sum())
MISSION = st.Mission.from_toml('''
format = 1
name = "ahead"
speed_m_s = 1.0
acceptance_radius_m = 2.0
limits = { max_depth_m = 20.0, max_time_s = 300.0 }
legs = [{ north_m = 60.0, east_m = 0.0, depth_m = 2.0 }]
''')
alone = use()
"""


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """What a process of its own says; it is ended where it hangs."""
    return subprocess.run(
        [sys.executable, "-c", USE + textwrap.dedent(code)],
        capture_output=True,
        text=True,
        timeout=GUARD_S,
        env=os.environ | environment,
    )


def test_a_child_works_after_a_fork_of_a_process_that_worked() -> None:
    done = run("""
        children = []
        for _ in range(2):
            child = os.fork()
            if not child:
                grandchild = os.fork()  # once more, from a child that has not worked yet
                same = use() == alone
                left = os.waitpid(grandchild, 0)[1] if grandchild else 0
                os._exit(0 if same and left == 0 else 1)
            children.append(child)
        print([os.waitpid(child, 0)[1] for child in children], use() == alone)
    """)
    assert done.stdout == "[0, 0] True\n", done.stderr


def test_a_pool_of_forked_processes_works_while_another_thread_works() -> None:
    done = run("""
        import threading
        busy = threading.Thread(target=lambda: [use() for _ in range(3)])
        busy.start()
        with multiprocessing.get_context("fork").Pool(2) as pool:
            print(set(pool.map(use, range(4))) == {alone})
        busy.join()
    """)
    assert done.stdout == "True\n", done.stderr


SEATRIAL: Any = st  # what its types refuse already

CALLS: dict[str, Callable[[object], object]] = {
    "simulate_batch": lambda n: SEATRIAL.simulate_batch(
        SEATRIAL.Vehicle.load("cwolf"), {"X_uu": np.ones(2)}, np.arange(3) * 0.1, threads=n
    ),
    "fly_batch": lambda n: SEATRIAL.fly_batch("cwolf", "cwolf", "none.toml", threads=n),
    "identify": lambda n: SEATRIAL.identify("none.toml", work=SEATRIAL.Work(threads=n)),
    "leave_one_out": lambda n: SEATRIAL.leave_one_out("none.toml", threads=n),
    "tune": lambda n: SEATRIAL.tune("none.toml", work=SEATRIAL.Work(threads=n)),
    "verify": lambda n: SEATRIAL.verify("none.toml", work=SEATRIAL.Work(threads=n)),
    "plan": lambda n: SEATRIAL.plan("cwolf", threads=n),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("threads", [0, -1, 10**9, 10**30, True, 2.5, "4"])
def test_a_number_of_threads_that_is_none_is_refused_first(name: str, threads: object) -> None:
    with pytest.raises(st.SimulationError) as refusal:
        CALLS[name](threads)
    assert str(refusal.value) == (
        f"threads: expected a whole number from 1 to 1024, or None for all processors, found {threads!r}"
    )


@pytest.mark.parametrize("text", ["0", "-2", "1000000000", "many"])
def test_a_number_of_threads_in_the_environment_is_refused_too(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAYON_NUM_THREADS", text)
    with pytest.raises(st.SimulationError, match=f"RAYON_NUM_THREADS: expected .* 1 to 1024, found .{text}"):
        CALLS["simulate_batch"](None)
    with pytest.raises(st.SimulationError, match="RAYON_NUM_THREADS"):
        CALLS["verify"](None)
    CALLS["simulate_batch"](1)  # a call that says its own


@pytest.mark.parametrize("threads", [None, 1, 1024, np.int64(3)])
def test_a_number_of_threads_is_taken(threads: object) -> None:
    checked_threads(threads)  # type: ignore[arg-type]


def test_the_environment_sets_the_number_of_threads() -> None:
    if not STATUS.exists():
        pytest.skip("this system does not tell how many threads there are")
    done = run(
        f"print([int(line.split()[1]) for line in open({str(STATUS)!r}) if line.startswith('Threads')][0])",
        RAYON_NUM_THREADS="7",
        OPENBLAS_NUM_THREADS="1",
        POLARS_MAX_THREADS="1",
    )
    assert int(done.stdout) >= 8, done.stderr


def test_a_child_that_would_wait_for_polars_is_told_so() -> None:
    done = run("""
        import tempfile, pathlib
        log = pathlib.Path(tempfile.mkdtemp()) / "log.csv"
        log.write_text("t_s,u_m_s,tau.X_n,tau.Y_n,tau.Z_n,tau.K_nm,tau.M_nm,tau.N_nm\\n"
            + "".join(f"{0.1 * k:.1f},1.0{',0.0' * 6}\\n" for k in range(50)))
        trial = st.Trial.read(log)
        def score():
            return st.score(vehicle, [trial], free="X")["u"].r2
        score()
        child = os.fork()
        if not child:
            try:
                st.Trial.read(log)
            except st.SeatrialError as error:
                print(error)
            score()  # what was read before can be used
            sys.stdout.flush()
            os._exit(0)
        print(os.waitpid(child, 0)[1])
    """)
    assert done.stdout.endswith("\n0\n"), done.stderr
    assert 'multiprocessing.get_context("spawn")' in done.stdout
