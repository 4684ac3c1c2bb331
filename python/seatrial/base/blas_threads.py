"""One thread for the linear algebra of NumPy and SciPy: its matrices have tens of rows here.

A second thread makes such a product no faster. It waits for the next one by spinning, which costs processor
time and, on a busy machine, the time of everybody else. What is large runs in threads of the core.

The command line sets the variables that the libraries read when they are loaded (`one_for_this_process`), and
its child processes inherit them. Used as a library, NumPy is loaded already: `one_blas_thread` limits it
while a function works and gives the threads back. A number that the user has set stays in both.

Tests: ``tests/base/test_blas_threads.py``. Figures: ``docs/validation.md``, "Speed".
"""

from __future__ import annotations

import contextlib
import os
import threading

TYPE_CHECKING = False  # `seatrial.__main__` loads this before any library
if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Any

VARIABLES = (
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "OMP_NUM_THREADS",
)
"""What OpenBLAS, MKL, BLIS and Accelerate read; the last counts for most where their own is absent."""


def one_for_this_process() -> None:
    """Set one thread for the linear algebra of this process and its children, before NumPy is loaded.

    Does nothing where the user has set a number for any of the libraries.
    """
    if not any(name in os.environ for name in VARIABLES):
        os.environ.update(dict.fromkeys(VARIABLES[:-1], "1"))


class _Limit:
    """The limit of this process, shared by all threads that work under it."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.users = 0
        self.limiter: Any = None

    def enter(self) -> None:
        """Limit the libraries for the first of the users."""
        with self.lock:
            if self.users == 0:
                # SciPy brings a library of its own, which is limited only once it is loaded.
                import scipy.linalg  # noqa: F401
                from threadpoolctl import threadpool_limits

                self.limiter = threadpool_limits(limits=1, user_api="blas")
            self.users += 1

    def leave(self) -> None:
        """Give the threads back after the last of the users."""
        with self.lock:
            self.users -= 1
            if self.users == 0:
                self.limiter.restore_original_limits()
                self.limiter = None


_LIMIT = _Limit()


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit the linear algebra of this process to one thread for as long as any of these contexts is open.

    Does nothing where the environment says how many threads to use.
    """
    if any(name in os.environ for name in VARIABLES):
        yield
        return
    _LIMIT.enter()
    try:
        yield
    finally:
        _LIMIT.leave()
