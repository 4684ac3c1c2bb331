"""Reproducible draws: the random numbers of draw i depend on seed, cause and i alone, not on how many draws.

Philox is a counter-based generator: its output is a keyed bijection of a counter, so that streams whose
counters differ never meet (Salmon, Moraes, Dror and Shaw 2011, *Parallel random numbers: as easy as 1, 2,
3*, SC'11). The key holds the seed and the cause, the counter the number of the draw and of the attempt; a
stream may run for 2^64 blocks before it would meet the next attempt. A draw can therefore be repeated alone,
and a further cause changes none of the others. Held by ``tests/identification/test_fitted.py`` and
``tests/verification/test_draws.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError

_HALF_STEP = 2.0**-54  # NumPy's uniforms are multiples of 2^-53, 0 among them, whose quantile may be infinite


def generator(seed: int, number: int, *, cause: int, attempt: int = 0) -> np.random.Generator:
    """Generator of one draw of one cause.

    `seed`, `number`: from 0 on. `cause`: different causes are independent. `attempt`: for draws that are
    repeated until they are possible.

    Examples
    --------
    >>> bool(generator(1, 7, cause=0).random() == generator(1, 7, cause=0).random())
    True
    """
    return np.random.Generator(np.random.Philox(key=[seed, cause], counter=[0, attempt, number, 0]))


def uniforms(seed: int, numbers: Sequence[int], *, cause: int, width: int) -> Array:
    """Numbers (k, width) strictly between 0 and 1, a row per draw.

    `numbers`: of the draws. `width`: the first columns do not depend on it.

    Examples
    --------
    >>> many = uniforms(1, range(10), cause=3, width=4)
    >>> bool((many[7] == uniforms(1, [7], cause=3, width=4)[0]).all())
    True
    """
    rows = [generator(seed, number, cause=cause).random(width) for number in numbers]
    return np.maximum(np.array(rows).reshape(len(rows), width), _HALF_STEP)


def checked_numbers(numbers: int | ArrayLike) -> list[int]:
    """Numbers of draws: 0 to k - 1 for k, or those given.

    Raises SimulationError where they are not whole numbers from 0 on.

    Examples
    --------
    >>> checked_numbers(3), checked_numbers([41])
    ([0, 1, 2], [41])
    """
    if isinstance(numbers, int | np.integer) and not isinstance(numbers, bool) and numbers >= 0:
        return list(range(int(numbers)))
    try:
        given = np.asarray(numbers)
    except ValueError:
        given = np.empty(())
    if given.ndim != 1 or (given.size and (given.dtype.kind not in "iu" or given.min() < 0)):
        raise SimulationError(
            f"draws: expected how many, or their numbers, whole and from 0 on, found {numbers!r}"
        )
    return [int(number) for number in given]
