"""Logs of many flights: beyond some memory they go to a file without a name, and read back the same."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import seatrial as st

pytestmark = pytest.mark.long

MIB = 2**20

MISSION = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
limits = { max_depth_m = 20.0, max_time_s = 90.0 }
legs = [{ north_m = 30.0, east_m = 0.0, depth_m = 5.0 }]
"""
FLY = """
import sys
from pathlib import Path
import numpy as np
import seatrial as st
mission = st.Mission.from_toml('''
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
limits = { max_depth_m = 20.0, max_time_s = 9000.0 }
legs = [{ north_m = 3000.0, east_m = 0.0, depth_m = 5.0 }]
''')
cases = int(sys.argv[1])
def fly(seeds):
    coarse = st.Conditions(max_step_s=0.1, max_time_s=1000.0)
    return st.fly_batch("cwolf", "cwolf", mission, seeds=seeds, conditions=coarse, logs=True)
"""


def run(code: str, cases: int, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", FLY + textwrap.dedent(code), str(cases)],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"TMPDIR": str(folder), "OPENBLAS_NUM_THREADS": "1"},
    )


def test_logs_of_many_flights_need_little_memory(tmp_path: Path) -> None:
    """Of 600 MiB of logs at most 256 stay in memory; those in the file are the same as alone."""
    done = run(
        """
        flights = fly(range(cases))
        peak = 1024 * int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
        size = sum(flights.log(case).nbytes for case in range(cases))
        last = cases - 1
        same = np.array_equal(flights.log(last), fly([0, last]).log(1), equal_nan=True)
        print(peak, size, same, len(flights.t(last)) == len(flights.log(last)))
        """,
        109,
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    peak, size, same, rows = done.stdout.split()
    assert int(size) > 600 * MIB
    assert int(peak) < 560 * MIB
    assert (same, rows) == ("True", "True")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_takes_no_logs_is_named(tmp_path: Path) -> None:
    done = run("fly(range(cases))", 60, tmp_path / "nowhere")
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert f"go to a temporary file in {tmp_path / 'nowhere'}, which cannot be written" in last
    assert "set TMPDIR to a folder with more space" in last


def test_the_last_of_many_flies_as_its_neighbours_do() -> None:
    """A flight without a neighbour has no vector lanes and other roundings; none of many is left alone."""
    mission = st.Mission.from_toml(MISSION)

    def fly(count: int) -> st.Flights:
        seeds = [7] * count
        return st.fly_batch(
            "cwolf",
            "cwolf",
            mission,
            seeds=seeds,
            conditions=st.Conditions(max_time_s=3.0),
            logs=True,
            threads=1,
        )

    pair = fly(2)
    for count in range(2, 40):
        assert np.array_equal(fly(count).log(count - 1), pair.log(0), equal_nan=True)


@pytest.mark.parametrize("logs", [True, False])
def test_flights_are_the_same_after_a_pickle(logs: bool) -> None:
    mission = st.Mission.from_toml(MISSION)
    flights = st.fly_batch(
        "cwolf", "cwolf", mission, seeds=range(20), conditions=st.Conditions(max_time_s=20.0), logs=logs
    )
    again = pickle.loads(pickle.dumps(flights))
    assert len(again) == 20
    for case in (0, 19):
        assert np.array_equal(again.log(case), flights.log(case), equal_nan=True)
        assert np.array_equal(again.t(case), flights.t(case))
    with pytest.raises(st.SimulationError, match="case: expected below 20, found 20"):
        again.log(20)
