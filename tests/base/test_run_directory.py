"""Run directories: whole or not at all, resumable, and clear about what stops them."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import polars as pl
import pytest

from seatrial.base.atomic_write import write_table
from seatrial.base.errors import SeatrialError, TrialError
from seatrial.base.run import RUN_FILE, RunDirectory, to_json


def test_published_directory_holds_every_file_and_no_trace_of_the_work(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    assert run.publish({RUN_FILE: "{}", "data/table.bin": b"\x00\x01"}) == tmp_path / "run"
    assert (tmp_path / "run/data/table.bin").read_bytes() == b"\x00\x01"
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]
    assert not list((tmp_path / "run").rglob("*.writing"))


def test_second_run_replaces_the_first_as_a_whole(tmp_path: Path) -> None:
    RunDirectory(tmp_path / "run").publish({RUN_FILE: "1", "old.txt": "old"})
    RunDirectory(tmp_path / "run").publish({RUN_FILE: "2"})
    assert (tmp_path / "run" / RUN_FILE).read_text() == "2"
    assert not (tmp_path / "run/old.txt").exists()
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]


def test_finished_stage_is_found_again_only_for_the_same_inputs(tmp_path: Path) -> None:
    RunDirectory(tmp_path / "run").keep("turn left/right", {"inputs": "abc", "cost": 1.5})
    resumed = RunDirectory(tmp_path / "run")
    found = resumed.finished("turn left/right", "abc")
    assert found is not None
    assert found["cost"] == 1.5
    assert resumed.finished("turn left/right", "abd") is None
    assert resumed.finished("turn left_right", "abc") is None


def test_finished_stage_survives_publishing(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    run.keep("surge", {"inputs": "abc"})
    run.publish({RUN_FILE: "{}"})
    assert RunDirectory(tmp_path / "run").finished("surge", "abc") == {"inputs": "abc"}


def test_damaged_stage_file_is_no_result(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    run.keep("surge", {"inputs": "abc"})
    file = tmp_path / "run.partial" / run.stage_name("surge")
    file.write_text(file.read_text()[:5])
    assert run.finished("surge", "abc") is None


def test_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(SeatrialError, match=r"no run\.json.*choose an empty or another folder"):
        RunDirectory(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_file_in_the_place_of_the_directory(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("a file")
    with pytest.raises(SeatrialError, match="expected a folder, found a file"):
        RunDirectory(tmp_path / "run")


def test_directory_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SeatrialError, match=r"cannot be written.*choose a folder"):
        RunDirectory(tmp_path / "file" / "run")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unwritable for the superuser")
def test_directory_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(SeatrialError, match=r"cannot be written \(Permission denied\)"):
        RunDirectory(tmp_path / "run")


def test_full_disk_keeps_the_former_run_and_leaves_no_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    RunDirectory(tmp_path / "run").publish({RUN_FILE: "{}", "vehicle.toml": "former"})
    run = RunDirectory(tmp_path / "run")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(SeatrialError, match=r"the disk is full \(.* MiB free\)"):
        run.publish({RUN_FILE: "{}", "vehicle.toml": "latter"})
    assert (tmp_path / "run/vehicle.toml").read_text() == "former"
    assert not list(tmp_path.rglob("*.writing"))


def test_json_has_null_for_numbers_that_are_not_finite() -> None:
    assert json.loads(to_json({"a": float("inf"), "b": (1, float("nan"), 2.5)})) == {
        "a": None,
        "b": [1, None, 2.5],
    }


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_a_file_that_cannot_be_finished_leaves_the_former_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / name).write_text("former")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(TrialError, match=r"cannot be written \(No space left on device\)"):
        write_table(pl.DataFrame({"t_s": [0.0]}), tmp_path / name)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["former"]
