"""`seatrial fly`: a vehicle with its autopilot on a mission, and what became of it.

The same mission under many seeds of the sensors' noise: how they end, how the figures spread.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray
    from rich.console import Console
    from rich.table import Table

    from seatrial.flight.flight import Flight
    from seatrial.flight.metrics import Leg

__all__ = ["Seeds", "fly", "fly_seeds"]

_MOST_LEGS = 30

_LONGEST_NAME = 80

_LABEL = 16  # characters of a waypoint's name: the table is to fit 80 columns

_FIGURES = {
    "duration_s": ("duration, s", 1),
    "distance_m": ("way over ground, m", 1),
    "energy_wh": ("energy, Wh", 2),
    "cross_track_rms_m": ("cross-track error, rms, m", 3),
    "cross_track_largest_m": ("cross-track error, largest, m", 3),
    "vertical_rms_m": ("vertical error, rms, m", 3),
    "vertical_largest_m": ("vertical error, largest, m", 3),
    "depth_excursion_m": ("excursion from the depths of a leg, m", 3),
    "depth_largest_m": ("largest depth, m", 2),
    "altitude_smallest_m": ("smallest altitude, m", 2),
    "pitch_largest_deg": ("largest pitch, deg", 1),
    "roll_largest_deg": ("largest roll, deg", 1),
    "switches_per_minute": ("starts and stops per minute and actuator", 2),
}


def fly(
    vehicle: Annotated[str, typer.Argument(help="Vehicle file or built-in vehicle that flies.")],
    autopilot: Annotated[str, typer.Argument(help="Autopilot file or built-in autopilot.")],
    mission: Annotated[str, typer.Argument(help="Mission file.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Run directory; runs/fly-VEHICLE-MISSION by default.")
    ] = None,
    current: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="NORTH EAST DOWN", help="Velocity of the water, m/s."),
    ] = (0.0, 0.0, 0.0),
    turbulence: Annotated[
        float,
        typer.Option(
            metavar="M_S", min=0.0, help="Standard deviation of the water's north and east velocity, m/s."
        ),
    ] = 0.0,
    sensors: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Sensors of the vehicle, or: typical. Perfect ones when missing."),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Of sensors' errors and turbulence; the same seed, the same flight.")
    ] = 0,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ACTUATOR@TIME[=stuck|=VALUE]",
            help="An actuator is dead from a time in s on, or stuck there, or stuck at a value; repeatable.",
        ),
    ] = None,
    outage: Annotated[
        list[str] | None,
        typer.Option(
            metavar="GROUP@FROM[-UNTIL]",
            help="No samples of position, depth, attitude, velocity, rates, altitude or water between two"
            " times in s; repeatable.",
        ),
    ] = None,
    seabed: Annotated[float | None, typer.Option(metavar="DEPTH", help="Depth of the bottom, m.")] = None,
    model: Annotated[
        str | None, typer.Option(help="Vehicle that the autopilot believes in, if it is another.")
    ] = None,
    voltage: Annotated[float | None, typer.Option(help="Supply, V, where thrust depends on it.")] = None,
    feedback: Annotated[bool, typer.Option(help="The autopilot sees what its actuators do.")] = True,
    max_time: Annotated[
        float | None,
        typer.Option(help="Longest duration, s; three times the planned one and five minutes by default."),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=2, max=100_000, help="Fly so many seeds, from --seed on, and tell how the figures spread."
        ),
    ] = None,
    figures: Annotated[bool, typer.Option(help="Write figures (PNG and PDF) into the run directory.")] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Fly a mission in closed loop: vehicle, sensors, autopilot and current together.

    The exit code is 0 when the mission was complete and every waypoint reached, 1 when not, 2 for bad input.
    """
    from seatrial.base.run import check_writable
    from seatrial.cli.console import list_figures, output, print_json
    from seatrial.flight.failures import Fault, Outage
    from seatrial.flight.fly import fly as flown
    from seatrial.report.plot.flight_errors import flight_gallery

    if out is not None:
        check_writable(out)
    sources = (vehicle, autopilot, mission)
    options: dict[str, Any] = {
        "model": model,
        "sensors": sensors,
        "current": current,
        "turbulence": turbulence,
        "faults": [Fault.parse(text) for text in fault or []],
        "outages": [Outage.parse(text) for text in outage or []],
        "seabed": seabed,
        "voltage": voltage,
        "feedback": feedback,
        "max_time": max_time,
    }
    flight = flown(*sources, seed=seed, **options)
    many = None if seeds is None else fly_seeds(sources, seeds, seed, options)
    beside = {} if many is None else {"seeds.parquet": many.parquet()}
    folder = flight.save(out or Path("runs") / _folder(flight), beside=beside)
    written = sorted(flight_gallery(flight, folder / "figures")) if figures else []
    if json:
        found = flight.to_dict() | {"run_directory": str(folder), "figure_files": [str(p) for p in written]}
        print_json(found if many is None else found | {"seeds": many.to_dict()})
    else:
        console = output()
        _print(console, flight)
        if many is not None:
            console.print(many.table(_FIGURES))
            console.print(f"- {many.sentence()}", soft_wrap=True, markup=False)
        console.print(
            f"Results in {folder}: flight.json, flight.parquet, summary.txt and the inputs",
            soft_wrap=True,
            markup=False,
        )
        list_figures(console, written)
    if not flight.complete or (many is not None and not many.all_complete):
        raise typer.Exit(1)


def _folder(flight: Flight) -> str:
    """Name of the run directory, no longer than file systems take."""
    name = f"fly-{flight.vehicle.name}-{flight.route.name}"[:_LONGEST_NAME]
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in name)


def _print(console: Console, flight: Flight) -> None:
    console.print(
        _whole(flight.figures, f"{flight.vehicle.name} on {flight.route.name}: {flight.outcome_in_words}")
    )
    console.print(_legs(flight))
    if not flight.diverged:
        console.print(_loops(flight))
    for line in flight.sentences():
        console.print(f"- {line}", soft_wrap=True, markup=False)


def _whole(figures: Mapping[str, float], title: str) -> Table:
    from seatrial.cli.console import table

    rows = [
        [label, _number(figures[name], decimals)]
        for name, (label, decimals) in _FIGURES.items()
        if math.isfinite(figures.get(name, math.nan)) and (name != "energy_wh" or figures[name] > 0.0)
    ]
    return table(title, ["figure", "value"], rows)


def _legs(flight: Flight) -> Table:
    from seatrial.cli.console import table

    shown = list(flight.legs)
    title = "Legs; errors of the second half of straight ones, m"
    if len(shown) > _MOST_LEGS:
        shown = sorted(shown, key=_importance, reverse=True)[:_MOST_LEGS]
        shown = [leg for leg in flight.legs if leg in shown]
        title = f"The {_MOST_LEGS} of {len(flight.legs)} legs that say most; errors of the second half, m"
    numbers = {id(leg): number for number, leg in enumerate(flight.legs, start=1)}
    rows = [
        [
            _shortened(f"{numbers[id(leg)]} {leg.label}"),
            "yes" if leg.reached else "no",
            _number(leg.smallest_m, 1),
            _number(leg.time_s, 1),
            _number(leg.cross_track_mean_m, 2),
            _number(leg.cross_track_largest_m, 2),
            _number(leg.vertical_largest_m, 2),
            _number(leg.depth_overshoot_percent, 1),
        ]
        for leg in shown
    ]
    head = ["waypoint", "reached", "near, m", "time, s", "across", "most", "vert.", "over, %"]
    return table(title, head, rows)


def _shortened(label: str) -> str:
    """A label without its middle where it is long: what tells waypoints of a pattern apart is at the end."""
    if len(label) <= _LABEL:
        return label
    tail = _LABEL // 2 - 1
    return f"{label[: _LABEL - 1 - tail]}…{label[-tail:]}"


def _importance(leg: Leg) -> tuple[bool, float]:
    return not leg.reached, leg.cross_track_largest_m if _known(leg.cross_track_largest_m) else -1.0


def _loops(flight: Flight) -> Table:
    from seatrial.cli.console import table

    rows = [
        [
            loop.name,
            f"{loop.error_rms:.3g}",
            f"{loop.error_largest:.3g}",
            loop.error_unit,
            f"{loop.demand_rms:.3g}",
            f"{loop.demand_largest:.3g}",
            loop.demand_unit,
            f"{100.0 * loop.saturated:.1f} %",
        ]
        for loop in flight.loops.values()
    ]
    head = ["loop", "error, rms", "largest", "", "demand, rms", "largest", "", "saturated"]
    return table("Control loops while they were at work", head, rows)


def _known(value: Any) -> bool:
    return bool(math.isfinite(value))


def _number(value: float, decimals: int) -> str:
    """A number with so many decimals and no minus before zero; nothing where there is none."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if _known(value) else ""


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
        from seatrial.flight.metrics import ending_of

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

        from seatrial.base.atomic_write import parquet
        from seatrial.flight.metrics import CODED

        columns: dict[str, Any] = {"seed": self.seeds, "ending": self.endings}
        columns |= {name: values for name, values in self.figures.items() if name not in CODED}
        return parquet(pl.DataFrame(columns))

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {"seeds": self.seeds, "endings": self.endings, "figures": self.figures}


def fly_seeds(sources: tuple[Any, Any, Any], count: int, first: int, options: dict[str, Any]) -> Seeds:
    """Flights of `count` seeds from `first` on; `options` as for `seatrial.fly_batch`."""
    from seatrial.flight.fly import fly_batch
    from seatrial.flight.metrics import figures_of

    seeds = list(range(first, first + count))
    return Seeds(seeds, figures_of(fly_batch(*sources, seeds=seeds, **options)))
