"""Run directory: what a run leaves behind, never half-written, and what lets it be resumed.

A run works in a sibling folder ``<name>.partial``, where every finished stage is kept with the hash of its
inputs. When the run is over, the whole folder is renamed into place.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import math
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from seatrial.base.atomic_write import write_atomic
from seatrial.base.errors import SeatrialError

__all__ = ["RUN_FILE", "Part", "RunDirectory", "StageStore", "check_writable", "to_json"]

RUN_FILE = "run.json"
"""The file that makes a folder a run directory."""

_STAGES = "stages"

_LONGEST_NAME = 240  # file systems take 255, and ".partial" is put behind


class StageStore(Protocol):
    """Where finished stages are kept and found again."""

    def finished(self, stage: str, inputs: str) -> dict[str, Any] | None:
        """Result of a stage that was finished from the same inputs, if there is one."""

    def keep(self, stage: str, result: Mapping[str, Any]) -> None:
        """Keep the result of a finished stage."""


@dataclass(frozen=True)
class Part:
    """The stages of one part of a run that runs the same stages several times."""

    whole: RunDirectory
    name: str

    def finished(self, stage: str, inputs: str) -> dict[str, Any] | None:
        """Result of this part's stage that was finished from the same inputs, if there is one."""
        return self.whole.finished(f"{self.name}, {stage}", inputs)

    def keep(self, stage: str, result: Mapping[str, Any]) -> None:
        """Keep the result of this part's stage."""
        self.whole.keep(f"{self.name}, {stage}", result)


class RunDirectory:
    """A folder for the results of one run.

    Parameters
    ----------
    path : str or Path
        Made when it does not exist; an earlier run's is replaced when this one is published.

    Raises
    ------
    SeatrialError
        The folder cannot be written, or holds something that is not a run.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).absolute()
        _short_enough(self.path)
        self.workspace = self.path.with_name(self.path.name + ".partial")
        if self.path.exists():
            if not self.path.is_dir():
                raise SeatrialError(
                    f"run directory {self.path}: expected a folder, found a file; choose another name"
                )
            if any(self.path.iterdir()) and not (self.path / RUN_FILE).is_file():
                raise SeatrialError(
                    f"run directory {self.path}: it holds files but no {RUN_FILE}, so it is no earlier run"
                    " and is left alone; choose an empty or another folder"
                )
        try:
            (self.workspace / _STAGES).mkdir(parents=True, exist_ok=True)
            write_atomic(self.workspace / ".probe", b"\0" * 4096)
            (self.workspace / ".probe").unlink()
        except OSError as error:
            raise _refusal(self.workspace, error) from None

    def finished(self, stage: str, inputs: str) -> dict[str, Any] | None:
        """Result of a stage that an earlier run finished from the same inputs, if there is one."""
        for folder in (self.workspace, self.path):
            try:
                kept = json.loads(self._stage_file(folder, stage).read_text(encoding="utf-8"))
            except (OSError, ValueError):
                continue
            if isinstance(kept, dict) and kept.get("inputs") == inputs:
                return kept
        return None

    def keep(self, stage: str, result: Mapping[str, Any]) -> None:
        """Keep the result of a finished stage for a run that resumes this one.

        Raises
        ------
        SeatrialError
            It cannot be written.
        """
        self._put(self._stage_file(self.workspace, stage), to_json(result).encode())

    def abandon(self) -> None:
        """Take the workspace away again when no stage was kept in it: the run was refused."""
        stages = self.workspace / _STAGES
        if stages.is_dir() and not any(stages.iterdir()):
            with contextlib.suppress(OSError):  # what else lies there stays
                stages.rmdir()
                self.workspace.rmdir()

    def discard(self) -> None:
        """Take the workspace away with all that is in it."""
        shutil.rmtree(self.workspace, ignore_errors=True)

    def part(self, name: str) -> Part:
        """Stages of one part of this run, kept apart from those of the other parts."""
        return Part(self, name)

    def publish(self, files: Mapping[str, str | bytes]) -> Path:
        """Path of the run directory after its files, by name, are in place, all of them or none.

        Raises
        ------
        SeatrialError
            They cannot be written; what the run directory held before is still there.
        """
        for name, content in files.items():
            self._put(self.workspace / name, content.encode() if isinstance(content, str) else content)
        with contextlib.suppress(OSError):  # it stays where it holds stages
            (self.workspace / _STAGES).rmdir()
        former = self.path.with_name(self.path.name + ".former")
        try:
            if former.exists():
                shutil.rmtree(former)
            if self.path.exists():
                self.path.rename(former)
            try:
                self.workspace.rename(self.path)
            except OSError:
                if former.exists():
                    former.rename(self.path)
                raise
            if former.exists():
                shutil.rmtree(former)
        except OSError as error:
            raise _refusal(self.path, error) from None
        return self.path

    def stage_name(self, stage: str) -> str:
        """File name of a stage's result inside the run directory."""
        return f"{_STAGES}/{self._stage_file(Path(), stage).name}"

    @staticmethod
    def _stage_file(folder: Path, stage: str) -> Path:
        safe = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in stage)
        tail = "" if safe == stage else "-" + hashlib.sha256(stage.encode()).hexdigest()[:8]
        return folder / _STAGES / f"{safe}{tail}.json"

    def _put(self, path: Path, content: bytes) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, content)
        except OSError as error:
            raise _refusal(path, error) from None


def check_writable(path: str | Path) -> None:
    """Refuse a run directory that cannot be written, before a long run; nothing stays behind.

    Raises
    ------
    SeatrialError
        The folder cannot be written, or holds something that is not a run.
    """
    target = Path(path).absolute()
    _short_enough(target)
    missing = [folder for folder in target.parents if not folder.exists()]
    kept = target.with_name(target.name + ".partial").exists()
    directory = RunDirectory(target)
    if not kept:
        directory.discard()
    for folder in missing:
        with contextlib.suppress(OSError):
            folder.rmdir()


def _short_enough(path: Path) -> None:
    size = len(os.fsencode(path.name))
    if size > _LONGEST_NAME:
        raise SeatrialError(
            f"run directory {path.name[:40]}…: expected a name of at most {_LONGEST_NAME} bytes, found"
            f" {size}; choose a shorter one"
        )


def to_json(value: Any) -> str:
    """JSON text; a number that is not finite becomes null, because JSON has none."""
    return json.dumps(_plain(value), indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _refusal(path: Path, error: OSError) -> SeatrialError:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        existing = next((parent for parent in (path, *path.parents) if parent.exists()), Path("/"))
        free = shutil.disk_usage(existing).free / 2**20
        return SeatrialError(
            f"{path}: the disk is full ({free:.1f} MiB free), nothing was half-written; free some space or"
            " choose a run directory on another disk, then run again: finished stages are reused"
        )
    reason = error.strerror or str(error)
    return SeatrialError(
        f"run directory {path}: cannot be written ({reason}); choose a folder that you may write to"
    )
