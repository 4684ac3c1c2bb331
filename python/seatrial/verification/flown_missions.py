"""Missions that were flown: what was drawn of each, and what came of it.

Kept between runs as Parquet, bit by bit as they were flown: a verdict does not depend on where its missions
were taken up again.

Tests: ``tests/verification/test_verify.py``.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array
from seatrial.base.atomic_write import parquet
from seatrial.base.forked import before_table
from seatrial.flight.metrics import DIVERGED, metrics_of

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Flights

__all__ = ["KEPT", "WORDS", "FlownMissions", "metrics_for_requirements"]

Values = NDArray[Any]

KEPT = ("numbers", "mission", "seeds", "perceived_counts", "true_counts")
"""Arrays that are kept between runs, besides metrics and causes."""

_METRIC, _CAUSE = "metric ", "cause "


WORDS = "U24"
"""Type of a column of words, as of endings."""


@dataclass(frozen=True, eq=False)
class FlownMissions:
    """Missions that were flown (k), in the order of their numbers.

    Attributes
    ----------
    numbers, mission, seeds
        Number in the campaign, index of the mission and seed of its noise, (k,).
    metrics
        Numbers, words (``ending``, ``alert``) and truths (``abort``) by name, (k,).
    causes
        What was drawn, by readable names with units, (k,).
    perceived_counts, true_counts
        Samples of the cross-track error on settled legs between the edges of `seatrial._core.error_edges`,
        (k, edges + 1): as guidance perceived it, and of where the vehicle really was.
    wall_s
        Time that they took, s.
    """

    numbers: NDArray[np.int_]
    mission: NDArray[np.int_]
    seeds: NDArray[np.int_]
    metrics: Mapping[str, Values]
    causes: Mapping[str, Array]
    perceived_counts: Array
    true_counts: Array
    wall_s: float

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

        Raises
        ------
        ValueError
            It was not flown.
        """
        rows = np.flatnonzero(self.numbers == number)
        if not len(rows):
            raise ValueError(f"mission {number} was not flown")
        return int(rows[0])

    def first(self, count: int) -> FlownMissions:
        """The first of them."""
        return FlownMissions(
            self.numbers[:count],
            self.mission[:count],
            self.seeds[:count],
            {name: column[:count] for name, column in self.metrics.items()},
            {name: column[:count] for name, column in self.causes.items()},
            self.perceived_counts[:count],
            self.true_counts[:count],
            self.wall_s * min(count, len(self)) / max(len(self), 1),
        )

    def table(self, missions: Sequence[str]) -> pl.DataFrame:
        """Table with a row per mission: number, mission, seed, metrics, and what was drawn ("drawn: ...").

        Parameters
        ----------
        missions : sequence of str
            Their names.
        """
        import polars as pl

        return pl.DataFrame(
            {
                "number": self.numbers,
                "mission": [missions[k] for k in self.mission.tolist()],
                "seed": self.seeds,
            }
            | {name: pl.Series(values) for name, values in self.metrics.items()}
            | {f"drawn: {name}": pl.Series(values) for name, values in self.causes.items()}
        )

    def to_parquet(self) -> bytes:
        """Content of a Parquet file that loses nothing; `from_parquet` reads it."""
        import polars as pl

        columns: dict[str, Any] = {name: getattr(self, name) for name in KEPT}
        columns |= {f"{_METRIC}{name}": values for name, values in self.metrics.items()}
        columns |= {f"{_CAUSE}{name}": values for name, values in self.causes.items()}
        return parquet(pl.DataFrame({name: pl.Series(values) for name, values in columns.items()}))

    @classmethod
    def from_parquet(cls, content: bytes, *, wall_s: float = 0.0) -> FlownMissions:
        """Missions of a Parquet file that `to_parquet` made.

        Parameters
        ----------
        content : bytes
        wall_s : float
            Time that they took, s.
        """
        import polars as pl

        before_table()
        table = pl.read_parquet(io.BytesIO(content))
        found = {column.name: _values(column) for column in table.get_columns()}

        def named(head: str) -> dict[str, Values]:
            return {name.removeprefix(head): found[name] for name in found if name.startswith(head)}

        return cls(
            **{name: found[name] for name in KEPT},
            metrics=named(_METRIC),
            causes=named(_CAUSE),
            wall_s=wall_s,
        )

    @classmethod
    def joined(cls, parts: Sequence[FlownMissions]) -> FlownMissions:
        """Parts one behind the other.

        Parameters
        ----------
        parts : sequence of FlownMissions
            At least one.
        """
        first = parts[0]
        return cls(
            **{name: np.concatenate([getattr(part, name) for part in parts]) for name in KEPT},
            metrics={name: np.concatenate([part.metrics[name] for part in parts]) for name in first.metrics},
            causes={name: np.concatenate([part.causes[name] for part in parts]) for name in first.causes},
            wall_s=sum(part.wall_s for part in parts),
        )


def metrics_for_requirements(flights: Flights) -> tuple[dict[str, Values], tuple[Array, Array]]:
    """Metrics of all cases as requirements name them, (k,), and counts of two errors, (k, bins) each.

    These are of the cross-track error as guidance perceived it, and of where the vehicle really was.

    ``ending`` and ``alert`` become words; without an alert its time is not a number.

    Parameters
    ----------
    flights : Flights
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


def _values(column: pl.Series) -> Values:
    """Values of a column as they were before it was kept."""
    import polars as pl

    values = column.to_numpy()
    return values.astype(WORDS) if column.dtype == pl.String else values
