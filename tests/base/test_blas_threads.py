"""One thread of the linear algebra: in the command line from the start, in the library around the calls."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from seatrial.base.work import VARIABLES, one_blas_thread

WITHOUT = {key: value for key, value in os.environ.items() if key not in VARIABLES}

COUNT = """
import json, numpy, scipy.linalg
from threadpoolctl import threadpool_info
def most():
    return max(one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas")
"""

VERB = """
import sys
sys.argv = ["seatrial", "--version"]
from seatrial.__main__ import main
try:
    main()
except SystemExit:
    pass
"""

LIBRARY = """
import seatrial as st
from seatrial.base.work import one_blas_thread
from seatrial.base.chunks import work
from seatrial.base.run import RunDirectory, version
import pickle
found = {"before": most()}
with RunDirectory(None):
    found["run"] = most()
    with one_blas_thread():
        found["nested"] = most()
    found["still"] = most()
found["after"] = most()
found["worker"] = work(version("seatrial"), eval, pickle.dumps("most()"), ({"most": most},)).value
found["end"] = most()
print(json.dumps(found))
"""


def told(program: str, **environment: str) -> str:
    run = subprocess.run(
        [sys.executable, "-c", program], env=WITHOUT | environment, capture_output=True, text=True, check=True
    )
    return run.stdout.splitlines()[-1]


needs_two = pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor has one thread")


def test_the_command_line_uses_one_thread_from_the_start() -> None:
    assert told(VERB + COUNT + "print(most())") == "1"
    # NumPy is not loaded before the variables are set, and child processes inherit them.
    probe = "import sys, seatrial.__main__, seatrial.base.work; print('numpy' in sys.modules)"
    assert told(probe) == "False"
    child = "import os; print(os.environ['OPENBLAS_NUM_THREADS'])"
    inherits = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {child!r}])"
    assert told(VERB + inherits) == "1"


@needs_two
@pytest.mark.parametrize("name", ["OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"])
def test_a_number_that_the_user_set_stays(name: str) -> None:
    assert told(VERB + COUNT + "print(most())", **{name: "2"}) == "2"
    assert set(json.loads(told(COUNT + LIBRARY, **{name: "2"})).values()) == {2}


@needs_two
def test_a_call_of_the_library_limits_the_threads_and_gives_them_back() -> None:
    found = json.loads(told(COUNT + LIBRARY))
    assert found["before"] > 1
    assert found == {
        "before": found["before"],
        "run": 1,
        "nested": 1,
        "still": 1,
        "after": found["before"],
        "worker": 1,
        "end": found["before"],
    }


def test_an_error_gives_the_threads_back(monkeypatch: pytest.MonkeyPatch) -> None:
    from threadpoolctl import threadpool_info

    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)

    def most() -> int:
        return max(int(one["num_threads"]) for one in threadpool_info() if one["user_api"] == "blas")

    import scipy.linalg  # noqa: F401

    before = most()

    def fails() -> None:
        with one_blas_thread():
            assert most() == 1
            raise ValueError("inside")

    with pytest.raises(ValueError, match="inside"):
        fails()
    assert most() == before
