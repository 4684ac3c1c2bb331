"""Parameter files of ArduSub."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from seatrial import TrialError
from seatrial.ardusub.parameters import Change, ParameterFile, changes, generation, in_metres, write_changes

NAMES = some.from_regex(r"[A-Z][A-Z0-9_]{0,15}", fullmatch=True)
NUMBERS = some.floats(width=32, allow_nan=False, allow_infinity=False)


@pytest.mark.long
@given(some.dictionaries(NAMES, NUMBERS, min_size=1, max_size=20))
def test_law_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, values: dict[str, float]
) -> None:
    path = tmp_path_factory.mktemp("round") / "own.param"
    written = [Change(name, math.nan, value, "why", (0.0, 1.0)) for name, value in values.items()]
    write_changes(path, written, title="What changes")
    read = ParameterFile.load(path).values
    # The vehicle keeps single precision.
    assert {name: np.float32(value) for name, value in read.items()} == values


def test_three_spellings_are_one() -> None:
    planner = "ATC_RAT_RLL_P,0.135\nANGLE_MAX,4500\n"
    proxy = "# comment\nATC_RAT_RLL_P   0.135  # of the rate\nANGLE_MAX\t4500\n"
    ground = "1\t1\tATC_RAT_RLL_P\t0.135\t9\n1\t1\tANGLE_MAX\t4500\t4\n"
    first, *others = (ParameterFile.of_text(text, "x").values for text in (planner, proxy, ground))
    assert first == {"ATC_RAT_RLL_P": 0.135, "ANGLE_MAX": 4500.0}
    assert all(other == first for other in others)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "found none"),
        ("# nothing\n", "found none"),
        ("ATC_RAT_RLL_P\n", "row 1: expected NAME,VALUE"),
        ("atc_rat_rll_p,1\n", "row 1: expected NAME,VALUE"),
        ("A_NAME_OF_FAR_TOO_MANY_LETTERS,1\n", "row 1: expected NAME,VALUE"),
        ("A,1\nB,one\n", "row 2: B: expected a finite number, found 'one'"),
        ("A,nan\n", "row 1: A: expected a finite number"),
        ("A,1e999\n", "row 1: A: expected a finite number"),
        ("A,1\nA,2\n", "row 2: A stands there twice, with 1 and 2"),
        ("A,1,2\n", "row 1: expected NAME,VALUE"),
    ],
)
def test_a_row_that_is_no_parameter_is_refused_by_its_number(text: str, told: str) -> None:
    with pytest.raises(TrialError, match=r"^own\.param: ") as caught:
        ParameterFile.of_text(text, "own.param")
    assert told in str(caught.value)


def test_files_that_are_no_parameter_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "log.bin").write_bytes(b"\xa3\x95\x80\xff" * 100)
    with pytest.raises(TrialError, match="expected text, found other bytes at 0"):
        ParameterFile.load(tmp_path / "log.bin")
    (tmp_path / "long.param").write_bytes(b"A,1\n" * 600_000)
    with pytest.raises(TrialError, match=r"at most 2 MB, found 2\.4 MB; is it a log"):
        ParameterFile.load(tmp_path / "long.param")
    with pytest.raises(TrialError, match="cannot be read"):
        ParameterFile.load(tmp_path / "missing.param")
    with pytest.raises(TrialError, match="cannot be read"):
        ParameterFile.load(tmp_path)


def test_a_generation_is_told_by_its_names_and_two_are_refused() -> None:
    assert generation(["PSC_POSZ_P", "ATC_RAT_YAW_P"]) == "4.0 to 4.6"
    assert generation(["PSC_D_POS_P"]) == "4.7 and later"
    assert generation(["VEL_Z_P"]) == "3.5"
    assert not generation(["ATC_RAT_YAW_P"])
    with pytest.raises(TrialError, match=r"PSC_POSZ_P of 4\.0 to 4\.6; PSC_D_POS_P of 4\.7 and later"):
        generation(["PSC_D_POS_P", "PSC_POSZ_P"], "mixed.param")
    old = ParameterFile("old.param", {"PSC_ACCZ_P": 0.5, "ANGLE_MAX": 4500.0})
    new = ParameterFile("new.param", {"PSC_D_ACC_P": 0.05, "ATC_ANGLE_MAX": 45.0})
    assert in_metres(old) == new.values
    with pytest.raises(TrialError, match=r"old\.param is of ArduSub 4\.0 to 4\.6, new\.param of"):
        changes(old, new)


def test_only_what_differs_is_a_change() -> None:
    before = ParameterFile("a", {"A": 1.0, "B": 2.0, "C": 3.0})
    after = ParameterFile("b", {"A": 1.0, "B": 2.5, "D": 4.0})
    found = changes(before, after)
    assert [one.name for one in found] == ["B", "C", "D"]
    assert (found[0].before, found[0].after) == (2.0, 2.5)
    assert math.isnan(found[1].after)
    assert math.isnan(found[2].before)


def test_a_written_change_says_before_bounds_and_reason(tmp_path: Path) -> None:
    one = Change("ATC_RAT_YAW_P", 0.18, 0.25, "yaw was slow", (0.1, 0.5))
    write_changes(tmp_path / "a.param", [one], title="Tuned")
    assert (tmp_path / "a.param").read_text() == (
        "# Tuned\n# before 0.18; within 0.1 to 0.5; yaw was slow\nATC_RAT_YAW_P,0.25\n"
    )
    (tmp_path / "file").write_text("")
    with pytest.raises(TrialError, match="cannot be written"):
        write_changes(tmp_path / "file" / "a.param", [one], title="Tuned")
