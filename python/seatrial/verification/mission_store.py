"""Flown missions as they come in, chunk after chunk: the last of them in memory, earlier ones in files.

A mission has some fifty columns, 0.6 kB, and 0.7 kB of error counts. From `IN_MEMORY` missions on the columns
go to Parquet files of a temporary folder (of ``TMPDIR``), which is removed with the last object that reads
from it. What judges them asks for one column after the other, so that a million missions take the memory of
a few columns.

Held by ``tests/verification/test_mission_store.py``.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from dataclasses import replace
from pathlib import Path

from seatrial.base.atomic_write import before_table
from seatrial.base.errors import SeatrialError, reason
from seatrial.verification.flown_missions import COUNTED, FlownMissions

IN_MEMORY = 16_384
"""Missions from which those that are there go to a file."""


class MissionStore:
    """Parts of a series of missions, in their order."""

    def __init__(self) -> None:
        self._parts: list[FlownMissions] = []
        self._files: list[Path] = []
        self._folder: Path | None = None
        self._removal: weakref.finalize[..., object] | None = None
        self._counted: list[FlownMissions] = []
        self._waiting = self._missions = 0
        self._wall_s = 0.0

    def append(self, part: FlownMissions) -> None:
        """Take the next part of the series.

        Raises
        ------
        SeatrialError
            The temporary folder takes no more.
        """
        left = max(COUNTED - self._missions, 0)
        self._parts.append(part)
        self._waiting, self._missions = self._waiting + len(part), self._missions + len(part)
        self._wall_s += part.wall_s
        if left:
            self._counted.append(part.first(left))
        if self._waiting >= IN_MEMORY:
            self._to_file()

    def flown(self) -> FlownMissions | None:
        """All missions; None without one."""
        if not self._missions:
            return None
        counts = FlownMissions.joined(self._counted)
        if self._folder is None:
            return replace(
                FlownMissions.joined(self._parts),
                perceived_counts=counts.perceived_counts,
                true_counts=counts.true_counts,
            )
        import polars as pl

        if self._parts:
            self._to_file()
        found = FlownMissions.of_columns(
            pl.scan_parquet(self._files), (counts.perceived_counts, counts.true_counts), wall_s=self._wall_s
        )
        if self._removal is not None and self._removal.detach():  # now theirs who read from it
            weakref.finalize(found.stored, shutil.rmtree, self._folder, ignore_errors=True)
        return found

    def _to_file(self) -> None:
        before_table()
        whole = FlownMissions.joined(self._parts).to_frame().drop("perceived_counts", "true_counts")
        try:
            if self._folder is None:
                self._folder = Path(tempfile.mkdtemp(prefix="seatrial-missions-"))
                self._removal = weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
            path = self._folder / f"{len(self._files):06}.parquet"
            whole.write_parquet(path, compression="lz4", statistics=False)
        except OSError as error:
            raise SeatrialError(
                f"{self._folder or tempfile.gettempdir()}: the missions cannot be written there"
                f" ({reason(error)}); set TMPDIR to a folder with 0.5 GB per million missions"
            ) from None
        self._files.append(path)
        self._parts, self._waiting = [], 0
