"""Work that is left: no search lets it grow, what is not needed falls away, its pace is that of what flew."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as some

from seatrial.tuning.tuning_run import WorkLeft

PARTS = {"margins": 1.0e5, "heave": 1.0e6, "surge": 2.0e6, "heave, again": 1.0e6, "surge, again": 2.0e6}


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@given(some.floats(1e-6, 1e-3))
def test_law_at_an_even_pace_the_time_left_is_the_rest(pace: float) -> None:
    clock = Clock()
    work = WorkLeft(PARTS, clock=clock)
    shares, left = [0.0], list[float]()
    rest = sum(PARTS.values())
    for name, part in PARTS.items():
        work.begin(name)
        for _ in range(10):
            clock.now += 0.1 * part * pace
            share = round(10.0 * (clock.now - (sum(PARTS.values()) - rest) * pace) / (part * pace)) / 10.0
            shares.append(work.done(name, share))
            left.append(work.left_s(name, share) / pace / (rest - share * part + 1.0))
        work.end(name)
        rest -= part
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    # The guess that it begins with counts as 2 % of all: from a tenth on the estimate is right to a fifth.
    guess = 1.0 / 60_000.0 / pace
    assert all(min(guess, 1.0) * 0.8 <= each <= max(guess, 1.0) * 1.2 for each in left[20:-1])


def test_a_second_turn_that_is_not_needed_shortens_the_time_left() -> None:
    clock = Clock()
    work = WorkLeft(PARTS, clock=clock)
    for name in ("margins", "heave", "surge"):
        work.begin(name)
        clock.now += PARTS[name] * 1e-5
        before, share = work.left_s(name, 1.0), work.done(name, 1.0)
        work.end(name)
    work.keep_only({"heave, again"})
    work.begin("heave, again")
    assert work.left_s("heave, again", 0.0) == pytest.approx(10.0, rel=0.1)
    assert work.left_s("heave, again", 0.0) < 0.5 * before
    assert work.done("heave, again", 0.0) > share


def test_what_an_earlier_run_left_behind_says_nothing_of_the_pace() -> None:
    clock = Clock()
    work = WorkLeft(PARTS, clock=clock)
    for name in ("margins", "heave"):
        work.begin(name)
        work.end(name, kept=True)
    work.begin("surge")
    clock.now += 20.0
    assert work.left_s("surge", 1.0) == pytest.approx(30.0, rel=0.1)  # 3e6 s at 1e-5
