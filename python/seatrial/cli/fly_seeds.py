"""The same mission under many seeds of the sensors' noise: how they end, how the figures spread."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from rich.table import Table

__all__ = ["Seeds", "fly_seeds"]


class Seeds:
    """Flights that differ in their seed alone.

    Attributes
    ----------
    seeds
        Of the flights.
    figures
        By name, one per seed.
    endings
        How each ended.
    """

    def __init__(self, seeds: list[int], figures: dict[str, NDArray[np.float64]]) -> None:
        from seatrial.flight.figures_of_flight import ending_of

        self.seeds, self.figures = seeds, figures
        self.endings = [ending_of(figures, case) for case in range(len(seeds))]

    @property
    def all_complete(self) -> bool:
        """Whether every flight came to the end of the mission."""
        return all(ending == "complete" for ending in self.endings)

    def sentence(self) -> str:
        """How they ended."""
        counts = {ending: self.endings.count(ending) for ending in dict.fromkeys(self.endings)}
        ends = ", ".join(f"{count} {ending}" for ending, count in counts.items())
        others = [seed for seed, end in zip(self.seeds, self.endings, strict=True) if end != "complete"]
        which = f"; not complete: seed {', '.join(map(str, others[:8]))}" if others else ""
        return f"{len(self.seeds)} seeds from {self.seeds[0]} on: {ends}{which}."

    def table(self, names: dict[str, tuple[str, int]]) -> Table:
        """Least, median and largest of the figures with these labels and decimals."""
        from seatrial.cli.console import table

        rows = []
        for name, (label, decimals) in names.items():
            values = self.figures[name][np.isfinite(self.figures[name])]
            if len(values):
                spread = (values.min(), np.median(values), values.max())
                rows.append([label, *(f"{value:.{decimals}f}" for value in spread)])
        return table(f"Over {len(self.seeds)} seeds", ["figure", "least", "median", "largest"], rows)

    def parquet(self) -> bytes:
        """Figures and endings, a row per seed."""
        import polars as pl

        from seatrial.flight.figures_of_flight import CODED
        from seatrial.whole_file import parquet

        columns: dict[str, Any] = {"seed": self.seeds, "ending": self.endings}
        columns |= {name: values for name, values in self.figures.items() if name not in CODED}
        return parquet(pl.DataFrame(columns))

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {"seeds": self.seeds, "endings": self.endings, "figures": self.figures}


def fly_seeds(sources: tuple[Any, Any, Any], count: int, first: int, options: dict[str, Any]) -> Seeds:
    """Flights of `count` seeds from `first` on; `options` as for `seatrial.fly_batch`."""
    from seatrial.flight import fly_batch
    from seatrial.flight.figures_of_flight import figures_of

    seeds = list(range(first, first + count))
    return Seeds(seeds, figures_of(fly_batch(*sources, seeds=seeds, **options)))
