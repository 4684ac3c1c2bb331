"""A loop that keeps time: ticks on a fixed grid of the clock, and how well they were kept.

Tick k is due at ``begin + k period``. The lateness of a tick is when the work began less when it was due
(jitter); a tick overruns when its work ends after the next one is due. A late tick moves no later one: the
loop catches up. Held by ``tests/realtime/test_pace.py``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.report import Table

_SPIN_S = 2e-4
"""The last of a wait is spent looking at the clock: sleeping is only that exact."""


@dataclass(frozen=True, eq=False)
class Timing:
    """How a loop kept time.

    Attributes
    ----------
    period_s
        Of the clock.
    lateness, work
        Of each tick, (n,), s.
    overruns
        Ticks whose work ended after the next was due.
    """

    period_s: float
    lateness: Array
    work: Array
    overruns: int

    def quantile(self, share: float) -> float:
        """Lateness that a share of the ticks stayed below, s."""
        return float(np.quantile(self.lateness, share)) if len(self.lateness) else 0.0

    def sentence(self) -> str:
        """Ticks, jitter and overruns in a sentence."""
        return (
            f"{len(self.lateness)} ticks of {1e3 * self.period_s:g} ms: half began at most"
            f" {1e3 * self.quantile(0.5):.3f} ms late, 99 % at most {1e3 * self.quantile(0.99):.3f} ms,"
            f" the latest {1e3 * self.quantile(1.0):.2f} ms; {self.overruns} overruns"
        )

    def table(self) -> Table:
        """Lateness and work at some quantiles."""
        shares = (0.5, 0.9, 0.99, 1.0)
        rows = [
            [f"{100 * share:g} %", f"{1e3 * self.quantile(share):.3f}", f"{1e3 * self._work(share):.3f}"]
            for share in shares
        ]
        return Table.of("Ticks", ["of the ticks at most", "late, ms", "work, ms"], rows)

    def _work(self, share: float) -> float:
        return float(np.quantile(self.work, share)) if len(self.work) else 0.0

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "period_s": self.period_s,
            "ticks": len(self.lateness),
            "overruns": self.overruns,
            "late_s": {f"{share:g}": self.quantile(share) for share in (0.5, 0.9, 0.99, 1.0)},
            "work_s": {f"{share:g}": self._work(share) for share in (0.5, 0.9, 0.99, 1.0)},
        }


class Pacer:
    """Ticks of a period; call `wait` before the work of each.

    Parameters
    ----------
    period_s : float
    clock, sleep : callable, optional
        Monotonic time in s, and a pause.

    Raises
    ------
    SimulationError
        The period is not positive.

    Examples
    --------
    >>> pacer = Pacer(0.001)
    >>> for _ in range(3):
    ...     pacer.wait()
    >>> len(pacer.timing().lateness)
    3
    """

    def __init__(
        self,
        period_s: float,
        *,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not period_s > 0.0:
            raise SimulationError(f"period: expected a positive time in s, found {period_s:g}")
        self._period, self._clock, self._sleep = period_s, clock, sleep
        self._begin: float | None = None
        self._due = 0.0
        self._began = 0.0
        self._late: list[float] = []
        self._work: list[float] = []
        self._overruns = 0

    def wait(self) -> None:
        """Return when the next tick is due, at once when it is already."""
        now = self._clock()
        if self._begin is None:
            self._begin = self._due = now
        else:
            self._finish(now)
            self._due = self._begin + len(self._late) * self._period
            while (left := self._due - self._clock()) > 0.0:
                if left > _SPIN_S:
                    self._sleep(left - _SPIN_S)
        self._began = self._clock()
        self._late.append(max(0.0, self._began - self._due))

    def timing(self) -> Timing:
        """How the ticks were kept; the one under way is finished."""
        if len(self._work) < len(self._late):
            self._finish(self._clock())
        return Timing(self._period, np.array(self._late), np.array(self._work), self._overruns)

    def _finish(self, now: float) -> None:
        if len(self._work) < len(self._late):
            self._work.append(now - self._began)
            self._overruns += now > self._due + self._period
