"""Simplex searches (Nelder & Mead 1965, ``scipy``) abreast: one candidate of each in every batch.

A simplex is sequential by nature. Each search runs in its own thread and waits there for the cost of its
candidate, while the caller's thread gathers one request of each into a batch. A round answers every living
search once, so that the course of a search depends on its start alone.
"""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable

import numpy as np

from seatrial.search import Array

DIVERGED = 1e30
"""Cost that stands for an infinite one where the arithmetic of a search needs a number."""

_SIZES = (0.08, 0.04, 0.02)


def simplexes_abreast(
    score: Callable[[Array], Array], starts: Array, *, rounds: int, tolerance: float
) -> None:
    """Ask for the costs of simplex searches in the unit box, one per start, until all have collapsed.

    Parameters
    ----------
    score : callable
        Costs ``(k,)`` of candidates ``(k, m)`` in the unit box; it keeps what it has seen.
    starts : ndarray, shape (k, m)
        First corner of every simplex. Their sizes differ.
    rounds : int
        Number of batches at most.
    tolerance : float
        Spread of the costs at which a simplex has collapsed; its extent must be below 1e-4 as well.
    """
    from scipy.optimize import minimize

    requests: queue.SimpleQueue[tuple[int, Array | BaseException | None]] = queue.SimpleQueue()
    answers: list[queue.SimpleQueue[float | None]] = [queue.SimpleQueue() for _ in starts]

    def search(index: int) -> None:
        def cost(z: Array) -> float:
            requests.put((index, z.copy()))
            answer = answers[index].get()
            if answer is None:
                raise _Halted
            return answer

        options = {
            "initial_simplex": _simplex(starts[index], _SIZES[index % len(_SIZES)]),
            "xatol": 1e-4,
            "fatol": max(tolerance, 1e-13),
            "maxfev": rounds,
            "maxiter": rounds,
            "adaptive": True,
        }
        box = [(0.0, 1.0)] * len(starts[index])
        end: BaseException | None = None
        try:
            minimize(cost, starts[index], method="Nelder-Mead", bounds=box, options=options)
        except _Halted:
            pass
        except BaseException as error:  # raised again in the caller's thread
            end = error
        requests.put((index, end))

    threads = [threading.Thread(target=search, args=(i,), daemon=True) for i in range(len(starts))]
    living = set(range(len(starts)))
    for thread in threads:
        thread.start()
    try:
        while living:
            pending: dict[int, Array] = {}
            while len(pending) < len(living):
                index, request = requests.get()
                if isinstance(request, np.ndarray):
                    pending[index] = request
                else:
                    living.discard(index)
                    if request is not None:
                        raise request
            if pending:
                order = sorted(pending)
                costs = score(np.array([pending[index] for index in order]))
                for index, value in zip(order, costs, strict=True):
                    answers[index].put(float(value) if math.isfinite(value) else DIVERGED)
    finally:
        for index in living:
            answers[index].put(None)
        for thread in threads:
            thread.join()


class _Halted(Exception):
    """Ends a search from outside."""


def _simplex(corner: Array, size: float) -> Array:
    """Vertices ``(m + 1, m)``: the corner and one step along every axis, inside the unit box."""
    steps = np.where(corner + size <= 1.0, size, -size)
    return np.asarray(np.vstack([corner, corner + np.diag(steps)]), dtype=float)
