"""Flights that differ only in the seed of sensor noise and turbulence: how they end, how metrics spread.

Held by tests/cli/test_cli_fly.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.base.arrays import Array, Mask
from seatrial.base.plain import Plain
from seatrial.base.report import Section
from seatrial.base.toml_file import loaded
from seatrial.flight.excesses import excesses, sentences, unkept
from seatrial.flight.metrics import CODED, ending_of, metrics_of
from seatrial.flight.mission import Mission
from seatrial.flight.tables import spread_table

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.flight.conditions import Conditions, Water


@dataclass(frozen=True, eq=False)
class Seeds(Plain, only="seeds endings metrics"):
    """Flights of one mission under many seeds.

    Attributes
    ----------
    seeds
        Of the flights.
    metrics
        Metrics by name, one value per seed.
    endings
        How each flight ended.
    too_near
        Seeds of the flights that touched something or came nearer than the mission promises.
    touched
        Seeds of the flights that touched the bottom.
    off_limits
        Seeds of the flights that went deeper, or nearer to the bottom, than the mission allows.
    excesses
        Sentences on flights that broke a limit, touched the bottom, left the water or pitched beyond reason.
    """

    seeds: tuple[int, ...]
    metrics: Mapping[str, Array]
    endings: tuple[str, ...]
    too_near: tuple[int, ...] = ()
    touched: tuple[int, ...] = ()
    off_limits: tuple[int, ...] = ()
    excesses: tuple[str, ...] = ()

    @property
    def all_complete(self) -> bool:
        """Whether every flight came to the end of the mission and kept its distances and limits."""
        complete = all(ending == "complete" for ending in self.endings)
        return complete and not (self.too_near or self.touched or self.off_limits)

    def sentence(self) -> str:
        """How many flights ended in which way, and the seeds that did not complete the mission."""
        counts = {ending: self.endings.count(ending) for ending in dict.fromkeys(self.endings)}
        ends = ", ".join(f"{count} {ending}" for ending, count in counts.items())
        others = [seed for seed, end in zip(self.seeds, self.endings, strict=True) if end != "complete"]
        which = f"; not complete: seed {', '.join(map(str, others[:8]))}" if others else ""
        kinds = {
            "too near to an obstacle": self.too_near,
            "touched the bottom": self.touched,
            "beyond the mission's limits": self.off_limits,
        }
        unkept = "".join(
            f"; {words}: seed {', '.join(map(str, seeds[:8]))}" for words, seeds in kinds.items() if seeds
        )
        return f"{len(self.seeds)} seeds from {self.seeds[0]} on: {ends}{which}{unkept}."

    def section(self) -> Section:
        """What a report shows of them."""
        return Section(
            sentences=(self.sentence(), *(f"{excess}." for excess in self.excesses)),
            tables=(spread_table(self.metrics, len(self.seeds)),),
        )

    def parquet(self) -> bytes:
        """Metrics and endings, a row per seed."""
        import polars as pl

        from seatrial.base.atomic_write import parquet

        columns: dict[str, Any] = {"seed": list(self.seeds), "ending": list(self.endings)}
        columns |= {name: values for name, values in self.metrics.items() if name not in CODED}
        return parquet(pl.DataFrame(columns))


def fly_seeds(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    count: int,
    first: int,
    water: Water,
    conditions: Conditions,
) -> Seeds:
    """Flights of `count` seeds from `first` on in the same water and conditions."""
    from seatrial.flight.fly import fly_batch

    seeds = tuple(range(first, first + count))
    metrics = metrics_of(
        fly_batch(vehicle, autopilot, mission, seeds=list(seeds), water=water, conditions=conditions)
    )
    flown = loaded(Mission, mission)
    promised, limits = flown.promised_m, flown.limits
    near, down, low, deep = unkept(metrics, promised, limits).values()

    def which(mask: Mask) -> tuple[int, ...]:
        return tuple(seed for seed, marked in zip(seeds, mask, strict=True) if marked)

    return Seeds(
        seeds,
        metrics,
        tuple(ending_of(metrics, case) for case in range(count)),
        too_near=which(near),
        touched=which(down),
        off_limits=which(low | deep),
        excesses=tuple(
            sentences(
                excesses(
                    metrics,
                    promised,
                    max_depth_m=limits["max_depth_m"],
                    min_altitude_m=limits["min_altitude_m"],
                ),
                lambda k: f"seed {seeds[k]}",
                "flights",
            )
        ),
    )
