"""The paced loop on a clock of its own: a fixed grid, jitter and overruns as they were made."""

from __future__ import annotations

import numpy as np
import pytest

from seatrial.base.errors import SimulationError
from seatrial.realtime.flight import Pacer
from seatrial.report.results.links import kept_time


class Clock:
    """Time that passes where the test says so; a sleep oversleeps by `late`."""

    def __init__(self, late: float = 0.0) -> None:
        self.now, self.late = 100.0, late

    def read(self) -> float:
        self.now += 1e-6  # looking takes time, so that a wait by looking ends
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds + self.late


def test_ticks_stay_on_the_grid_whatever_the_work_takes() -> None:
    clock = Clock()
    pacer = Pacer(0.1, clock=clock.read, sleep=clock.sleep)
    begun = []
    for work in (0.05, 0.01, 0.09, 0.0, 0.02):
        pacer.wait()
        begun.append(clock.now - 100.0)
        clock.now += work
    np.testing.assert_allclose(begun, 0.1 * np.arange(5), atol=1e-4)
    timing = pacer.timing()
    assert timing.overruns == 0
    np.testing.assert_allclose(timing.work, [0.05, 0.01, 0.09, 0.0, 0.02], atol=1e-4)
    assert timing.quantile(1.0) < 1e-4


def test_an_overrun_is_counted_and_caught_up() -> None:
    clock = Clock()
    pacer = Pacer(0.1, clock=clock.read, sleep=clock.sleep)
    begun = []
    for work in (0.0, 0.25, 0.0, 0.0, 0.0):
        pacer.wait()
        begun.append(clock.now - 100.0)
        clock.now += work
    timing = pacer.timing()
    assert timing.overruns == 2  # the long one, and the next, which ended after its own end of period
    np.testing.assert_allclose(begun, [0.0, 0.1, 0.35, 0.35, 0.4], atol=1e-3)
    np.testing.assert_allclose(timing.lateness, [0.0, 0.0, 0.15, 0.05, 0.0], atol=1e-3)


def test_jitter_of_an_oversleeping_system_is_what_it_oversleeps() -> None:
    clock = Clock(late=0.003)
    pacer = Pacer(0.01, clock=clock.read, sleep=clock.sleep)
    for _ in range(50):
        pacer.wait()
    # Sleep ends 0.2 ms before the tick by plan, so 2.8 ms after it.
    assert pacer.timing().quantile(0.5) == pytest.approx(2.8e-3, abs=1e-4)
    assert "50 ticks of 10 ms" in kept_time(pacer.timing())


def test_a_period_must_be_positive() -> None:
    with pytest.raises(SimulationError, match="expected a positive time"):
        Pacer(0.0)
