"""Files that are made to exhaust who reads them: `tests.logs.bombs`."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from seatrial.base.budget import Budget
from seatrial.base.errors import TrialError
from seatrial.intake.imported import import_logs
from seatrial.logs import bags, delimited
from seatrial.logs.bags import unpacked_chunk
from seatrial.logs.log import Log, open_log
from seatrial.trial.trial import Trial
from tests.logs import bombs


@pytest.mark.long
@pytest.mark.parametrize("format", bombs.BOMBS)
def test_law_a_bomb_ends_in_one_sentence_within_bounded_memory(format: str) -> None:
    counts, wrong, dearest = bombs.run(format, range(60))
    print(dict(counts), dearest)
    assert wrong == []
    # Neither all nor none: most of them are whole files but for one place.
    assert counts["accepted"] > 2
    assert counts["refused"] > 3


@pytest.mark.parametrize("packing", ["bz2", "lz4", "zstd"])
def test_a_chunk_unpacks_to_what_it_holds_and_to_no_more_than_any_log(
    packing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert unpacked_chunk(packing, bombs._packed(packing, b"abc" * 100_000)) == b"abc" * 100_000
    monkeypatch.setattr(bags, "Budget", partial(Budget, unpacked_mb=0.1, unpacked_ratio=10.0))
    with pytest.raises(ValueError, match="unpacks to more than"):
        unpacked_chunk(packing, bombs._packed(packing, bytes(2_000_000)))


def test_a_column_that_sqlite_computes_is_refused_before_it_is_computed(tmp_path: Path) -> None:
    path = bombs.database(tmp_path, " GENERATED ALWAYS AS (zeroblob(900000000))", rows=300, data=b"")
    with pytest.raises(TrialError, match="has a column that SQLite computes"):
        open_log(path)


def test_a_name_of_a_hundred_thousand_brackets_is_refused_before_it_is_matched(tmp_path: Path) -> None:
    (tmp_path / "nav.csv").write_text("(" * 100_000 + ",u\n" + "1.0,2.0\n" * 9)
    with pytest.raises(TrialError, match="a name of 100000 letters; expected at most 10000"):
        open_log(tmp_path / "nav.csv")


@pytest.mark.parametrize("read", [import_logs, Trial.read])
def test_a_refusal_quotes_no_cell_of_100_kb(tmp_path: Path, read: Callable[[Path], object]) -> None:
    path = tmp_path / "nav.csv"
    path.write_text("time,u,v\n" + "0.1,2.0,3\n" * 9000 + '"' * 99_999 + "\n")
    with pytest.raises(TrialError, match=r"not readable as a table of .* repair the file") as refused:
        read(path)
    assert len(str(refused.value)) < 1000


def test_the_time_that_opening_takes_is_not_granted_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log of 60 kB that was looked through for 6 s when it was opened took 7 s more to survey."""
    path = tmp_path / "nav.csv"
    path.write_text("time,u\n" + "1.0,2.0\n" * 9)
    opened = delimited.open_table

    def slowly(path: Path) -> Log:
        end_s = time.thread_time() + 0.2
        while time.thread_time() < end_s:
            pass
        return opened(path)

    monkeypatch.setattr(delimited, "open_table", slowly)
    assert 2.0 < open_log(path).budget.cpu_s <= Budget().cpu_s - 0.2
