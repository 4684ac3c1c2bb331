"""Missions that were flown: what was drawn of each, and what came of it.

Kept between runs as Parquet, bit by bit as they were flown: a verdict does not depend on where its missions
were taken up again.

A mission has some fifty columns, 0.6 kB, and 0.7 kB of error counts. From `StoreSettings.in_memory`
missions on the columns go to Parquet files of a temporary folder (of ``TMPDIR``), which is removed with the
last object that reads from it. What judges them asks for one column after the other, so that a million
missions take the memory of a few columns.

Tests: ``tests/verification/test_verify.py``, ``tests/verification/test_mission_store.py``.
"""

from __future__ import annotations

import io
import shutil
import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array
from seatrial.base.errors import SeatrialError, reason
from seatrial.base.files import before_table, parquet, write_atomic
from seatrial.flight.metrics import DIVERGED, metrics_of

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Flights

Values = NDArray[Any]
KEPT = ("numbers", "mission", "seeds", "perceived_counts", "true_counts")
"""Arrays that are kept between runs, besides metrics and causes."""

_METRIC, _CAUSE = "metric ", "cause "
WORDS = "U24"
"""Type of a column of words, as of endings."""


@dataclass(frozen=True)
class StoreSettings:
    """How many missions are kept in memory."""

    in_memory: int = 16_384  #: Missions from which those that are there go to a file.
    #: Missions whose samples of the cross-track error are kept for the figure of their distribution.
    counted: int = 16_384


STORE_SETTINGS = StoreSettings()


@dataclass(frozen=True, eq=False)
class FlownMissions:
    """Missions that were flown (k), in the order of their numbers.

    `numbers`, `mission`, `seeds`: number in the campaign, index of the mission and seed of its noise, (k,).
    `metrics`: numbers, words (``ending``, ``alert``) and truths (``abort``) by name, (k,). `causes`: what was
    drawn, by readable names with units, (k,). `perceived_counts`, `true_counts`: samples of the cross-track
    error on settled legs between the edges of `seatrial._core.error_edges`, (n, edges + 1): as guidance
    perceived it, and of where the vehicle really was; of the first n missions only,
    `StoreSettings.counted` at most. `wall_s`: time that they took, s. `stored`: the same as columns of files,
    as of `to_frame`, where metrics and causes are read from there; None where all is in memory.
    """

    numbers: NDArray[np.int_]
    mission: NDArray[np.int_]
    seeds: NDArray[np.int_]
    metrics: Mapping[str, Values]
    causes: Mapping[str, Array]
    perceived_counts: Array
    true_counts: Array
    wall_s: float
    stored: pl.LazyFrame | None = field(default=None, repr=False)

    def __len__(self) -> int:
        """Number of missions."""
        return len(self.numbers)

    @property
    def flown_s(self) -> float:
        """Time that was flown in all of them together, s; a diverged one counts nothing."""
        return float(np.nansum(self.metrics["duration_s"]))

    @property
    def real_time_factor(self) -> float:
        """Time flown over the time that it took."""
        return self.flown_s / self.wall_s if self.wall_s > 0.0 else float("nan")

    @property
    def per_second(self) -> float:
        """Missions flown in a second."""
        return len(self) / self.wall_s if self.wall_s > 0.0 else float("nan")

    def place(self, number: int) -> int:
        """Row of the mission with a number.

        Raises ValueError where it was not flown.
        """
        rows = np.flatnonzero(self.numbers == number)
        if not len(rows):
            raise ValueError(f"mission {number} was not flown")
        return int(rows[0])

    def first(self, count: int) -> FlownMissions:
        """The first of them."""
        kept: dict[str, Any] = {name: getattr(self, name)[:count] for name in KEPT}
        return FlownMissions(
            **kept,
            metrics={name: column[:count] for name, column in self.metrics.items()},
            causes={name: column[:count] for name, column in self.causes.items()},
            wall_s=self.wall_s * min(count, len(self)) / max(len(self), 1),
        )

    def rows(self, places: Sequence[int]) -> list[tuple[dict[str, Any], dict[str, float]]]:
        """Metrics, and what was drawn, at some places (rows, not numbers), by name."""
        # Column by column: each is read from a file once.
        metrics = {name: values[list(places)].tolist() for name, values in self.metrics.items()}
        causes = {name: values[list(places)].astype(float).tolist() for name, values in self.causes.items()}
        return [
            (
                {name: column[k] for name, column in metrics.items()},
                {name: column[k] for name, column in causes.items()},
            )
            for k in range(len(places))
        ]

    def table(self, missions: Sequence[str]) -> pl.DataFrame:
        """Table with a row per mission: number, name, seed, metrics, and what was drawn ("drawn: ...")."""
        before_table()
        return self._told(missions).collect()

    def write_table(self, missions: Sequence[str], path: Path) -> None:
        """Write the table to a Parquet file, part by part, so that memory never holds all of it."""
        before_table()
        self._told(missions).sink_parquet(path, row_group_size=16_384)

    def to_frame(self) -> pl.DataFrame:
        """Columns that lose nothing."""
        import polars as pl

        columns: dict[str, Any] = {name: getattr(self, name) for name in KEPT}
        columns |= {f"{_METRIC}{name}": values for name, values in self.metrics.items()}
        columns |= {f"{_CAUSE}{name}": values for name, values in self.causes.items()}
        return pl.DataFrame({name: pl.Series(values) for name, values in columns.items()})

    def to_parquet(self) -> bytes:
        """Content of a Parquet file that loses nothing; `from_parquet` reads it."""
        return parquet(self.to_frame())

    @classmethod
    def of_columns(cls, stored: pl.LazyFrame, counts: tuple[Array, Array], *, wall_s: float) -> FlownMissions:
        """Missions whose metrics and causes are read from files, column by column.

        `stored`: rows of `to_frame`, without counts; `counts`: perceived and true, of the first of them.
        """
        names = stored.collect_schema().names()
        every = _Stored(stored, names, "")
        return cls(
            numbers=every["numbers"],
            mission=every["mission"],
            seeds=every["seeds"],
            metrics=_Stored(stored, names, _METRIC),
            causes=_Stored(stored, names, _CAUSE),
            perceived_counts=counts[0],
            true_counts=counts[1],
            wall_s=wall_s,
            stored=stored,
        )

    def _told(self, missions: Sequence[str]) -> pl.LazyFrame:
        import polars as pl

        rows = self.to_frame().lazy() if self.stored is None else self.stored
        mission, title = pl.col("mission"), pl.lit(missions[-1])
        for index, name in enumerate(missions[:-1]):  # `replace` would gather all rows in memory
            title = pl.when(mission == index).then(pl.lit(name)).otherwise(title)
        return rows.select(
            pl.col("numbers").alias("number"),
            title.alias("mission"),
            pl.col("seeds").alias("seed"),
            *(pl.col(f"{_METRIC}{name}").alias(name) for name in self.metrics),
            *(pl.col(f"{_CAUSE}{name}").alias(f"drawn: {name}") for name in self.causes),
        )

    @classmethod
    def from_parquet(cls, content: bytes, *, wall_s: float = 0.0) -> FlownMissions:
        """Missions of a Parquet file that `to_parquet` made; `wall_s`: time that they took, s."""
        import polars as pl

        before_table()
        table = pl.read_parquet(io.BytesIO(content))
        found = {column.name: _values(column) for column in table.get_columns()}

        def named(head: str) -> dict[str, Values]:
            return {name.removeprefix(head): found[name] for name in found if name.startswith(head)}

        kept: dict[str, Any] = {name: found[name] for name in KEPT}
        return cls(**kept, metrics=named(_METRIC), causes=named(_CAUSE), wall_s=wall_s)

    @classmethod
    def joined(cls, parts: Sequence[FlownMissions]) -> FlownMissions:
        """Parts, at least one, one behind the other."""
        first = parts[0]
        kept: dict[str, Any] = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in KEPT
        }
        return cls(
            **kept,
            metrics={name: np.concatenate([part.metrics[name] for part in parts]) for name in first.metrics},
            causes={name: np.concatenate([part.causes[name] for part in parts]) for name in first.causes},
            wall_s=sum(part.wall_s for part in parts),
        )


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

        Raises SeatrialError where the temporary folder takes no more.
        """
        left = max(STORE_SETTINGS.counted - self._missions, 0)
        self._parts.append(part)
        self._waiting, self._missions = self._waiting + len(part), self._missions + len(part)
        self._wall_s += part.wall_s
        if left:
            self._counted.append(part.first(left))
        if self._waiting >= STORE_SETTINGS.in_memory:
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
            write_atomic(path, partial(whole.write_parquet, compression="lz4", statistics=False))
        except OSError as error:
            raise SeatrialError(
                f"{self._folder or tempfile.gettempdir()}: the missions cannot be written there"
                f" ({reason(error)}); set TMPDIR to a folder with 0.5 GB per million missions"
            ) from None
        self._files.append(path)
        self._parts, self._waiting = [], 0


class _Stored(Mapping[str, Values]):
    """Columns of files with a common head, each read when it is asked for and not kept."""

    def __init__(self, stored: pl.LazyFrame, names: Sequence[str], head: str) -> None:
        self._stored, self._head = stored, head
        self._names = {name.removeprefix(head): None for name in names if name.startswith(head)}

    def __getitem__(self, name: str) -> Values:
        if name not in self._names:
            raise KeyError(name)
        return _shared_words(self._stored.select(self._head + name).collect().to_series())

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def metrics_for_requirements(flights: Flights) -> tuple[dict[str, Values], tuple[Array, Array]]:
    """Metrics of all cases as requirements name them, (k,), and counts of two errors, (k, bins) each.

    These are of the cross-track error as guidance perceived it, and of where the vehicle really was.
    ``ending`` and ``alert`` become words; without an alert its time is not a number.
    """
    found: dict[str, Values] = dict(metrics_of(flights))
    names = autopilot_names()
    endings, watches = np.array(names["endings"]), np.array(["", *names["watches"]])
    diverged = ~np.isfinite(found["duration_s"])
    codes = np.where(diverged, 0.0, found["ending"]).astype(int)
    found["ending"] = np.where(diverged, DIVERGED, endings[codes])
    causes = np.nan_to_num(found.pop("alert_cause")).astype(int)
    called = np.nan_to_num(found["alert"]) > 0.0
    found["alert"] = np.where(called, watches[causes], "")
    found["alert_time_s"] = np.where(called, found["alert_time_s"], np.nan)
    # Of a diverged mission no metric may hold a requirement.
    for name, values in found.items():
        if values.dtype.kind == "f":
            found[name] = np.where(diverged, np.nan, values)
    found["abort"] = np.isin(found["ending"], ("aborted", DIVERGED))
    return found, (
        _between_edges(flights.cross_track_counts),
        _between_edges(flights.true_cross_track_counts),
    )


def _between_edges(above: Array) -> Array:
    """Samples between the edges (k, edges + 1) from all samples and those above each edge."""
    samples = np.asarray(above, dtype=float)
    return np.asarray(samples - np.append(samples[:, 1:], np.zeros((len(samples), 1)), axis=1))


def _shared_words(column: pl.Series) -> Values:
    """Values of a column; of words one object each, however often it stands there."""
    import polars as pl

    if column.dtype != pl.String:
        return _values(column)
    words = column.unique().to_list()
    places = column.replace_strict(words, list(range(len(words))), return_dtype=pl.UInt16)
    return np.asarray(np.array(words, dtype=object)[places.to_numpy()])


def _values(column: pl.Series) -> Values:
    """Values of a column as they were before it was kept."""
    import polars as pl

    values = column.to_numpy()
    return values.astype(WORDS) if column.dtype == pl.String else values
