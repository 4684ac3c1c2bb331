"""What hostile files cost: the block that reads one ends with one sentence, honest work is left alone."""

from __future__ import annotations

import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from seatrial.base.budget import Budget, claim, guarded, size_of
from seatrial.base.errors import CampaignError, SeatrialError, TrialError

SMALL = Budget(cpu_s=0.2, cpu_s_per_mb=0.0, memory_mb=60.0, memory_mb_per_mb=0.0)


def run(
    work: Callable[[], object], budget: Budget = SMALL, *, refusal: type[SeatrialError] = TrialError
) -> None:
    """Do some work within a budget."""
    with guarded("a.log", "reading it", "fetch it again", size=2048, budget=budget, refusal=refusal):
        work()


def robust_parser() -> None:
    """A loop that never ends and swallows every exception."""
    while True:
        try:
            sum(range(1000))
        except Exception:
            continue


def thrown(error: BaseException) -> Callable[[], None]:
    """Work that fails."""

    def work() -> None:
        raise error

    return work


def test_a_loop_that_never_ends_is_ended_though_it_swallows_every_exception() -> None:
    with pytest.raises(TrialError, match=r"a\.log: reading it takes more than 0 s of processor.*2,048 bytes"):
        run(robust_parser)


def test_memory_that_grows_is_ended_before_it_is_spent() -> None:
    kept: list[bytearray] = []

    def work() -> None:
        while len(kept) < 2_000:  # 2 GB at most
            kept.append(bytearray(b"x" * 1_000_000))

    with pytest.raises(TrialError, match="more than 60 MB of memory"):
        run(work, Budget(cpu_s=60.0, memory_mb=60.0))
    assert len(kept) < 1_000


def test_memory_that_is_asked_for_in_one_go_is_refused_before() -> None:
    with pytest.raises(TrialError, match="more than 60 MB of memory"):
        run(lambda: claim(10**12))
    claim(10**12)  # outside of a block nothing is counted


def test_time_that_passes_without_work_costs_nothing() -> None:
    run(lambda: time.sleep(0.4), Budget(cpu_s=0.1))


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (ValueError("x\x1b[31m" + "y" * 900), r"reading it failed \(ValueError: x\\x1b"),
        (KeyError("a"), r"failed \(KeyError: 'a'\)"),
        (RecursionError(), "goes deeper than any honest file is nested"),
        (MemoryError(), "asks for more memory than there is"),
        (FileNotFoundError(2, "No such file or directory"), r"failed \(No such file or directory\)"),
        (type("PanicException", (BaseException,), {})("rust"), "failed .PanicException: rust"),
    ],
)
def test_what_a_parser_raises_becomes_one_sentence(error: BaseException, said: str) -> None:
    with pytest.raises(CampaignError, match=said) as caught:
        run(thrown(error), Budget(), refusal=CampaignError)
    assert caught.value.__cause__ is error
    assert len(str(caught.value)) < 400
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("error", [TrialError("ours"), KeyboardInterrupt(), BrokenPipeError(32, "gone")])
def test_our_own_errors_and_those_of_streams_pass(error: BaseException) -> None:
    with pytest.raises(type(error)) as caught:
        run(thrown(error), Budget())
    assert caught.value is error


def test_nobody_is_warned_of_what_a_file_holds() -> None:
    def work() -> None:
        np.array([1e300]) ** 2
        np.nanmean(np.array([np.nan]))

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(work, Budget())


def test_blocks_in_one_another_each_end_their_own() -> None:
    before = threading.active_count()
    with (
        pytest.raises(TrialError, match="outer"),
        guarded("outer", "reading", "stop", budget=Budget(cpu_s=0.1)),
    ):
        run(robust_parser, Budget(cpu_s=60.0))
    time.sleep(0.1)  # nothing arrives later
    assert threading.active_count() <= before


def test_law_the_budget_grows_with_the_size_and_stays_below_a_gibibyte_up_to_10_mb() -> None:
    budget = Budget()
    assert budget.cpu_of(10_000_000) <= 10.0
    assert budget.memory_of(10_000_000) <= 850.0
    assert budget.cpu_of(10**9) > 20 * budget.cpu_of(0)
    assert budget.memory_of(10**9) > 20 * budget.memory_of(0)


def test_the_size_of_a_folder_is_that_of_its_files(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"x" * 10)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "c").write_bytes(b"x" * 5)
    assert (size_of(tmp_path), size_of(tmp_path / "a"), size_of(tmp_path / "none")) == (15, 10, 0)
