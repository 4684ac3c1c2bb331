"""Tables of a flight's report: metrics, legs, loops, the water's samples, and many seeds with sentences.

Held by ``tests/cli/test_cli_fly.py``, ``tests/flight/test_payload.py`` and ``tests/flight/test_findings.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.report import Column, Section, Table
from seatrial.flight.flight import Seeds
from seatrial.flight.metrics import Leg, Loop, differs
from seatrial.flight.payload import CHANNELS, UNDER_WAY, Samples, Value
from seatrial.report.results.flight_findings import excess_clauses

_METRICS = {
    "duration_s": ("duration", "s", 1),
    "distance_m": ("distance over ground", "m", 1),
    "energy_wh": ("energy", "Wh", 2),
    "cross_track_rms_m": ("cross-track error, rms", "m", 3),
    "cross_track_largest_m": ("cross-track error, largest", "m", 3),
    "true_cross_track_rms_m": ("true cross-track error, rms", "m", 3),
    "true_cross_track_largest_m": ("true cross-track error, largest", "m", 3),
    "vertical_rms_m": ("vertical error, rms", "m", 3),
    "vertical_largest_m": ("vertical error, largest", "m", 3),
    "true_vertical_rms_m": ("true vertical error, rms", "m", 3),
    "true_vertical_largest_m": ("true vertical error, largest", "m", 3),
    "depth_excursion_m": ("depth outside the leg's range, largest", "m", 3),
    "clearance_m": ("hull clearance, smallest", "m", 2),
    "clearance_reserve_m": ("hull clearance beyond the promised one, smallest", "m", 2),
    "depth_smallest_m": ("depth, smallest", "m", 2),
    "depth_largest_m": ("depth, largest", "m", 2),
    "altitude_smallest_m": ("altitude, smallest", "m", 2),
    "pitch_largest_deg": ("pitch angle, largest", "deg", 1),
    "roll_largest_deg": ("roll angle, largest", "deg", 1),
    "switches_per_minute": ("starts and stops of an actuator, mean", "1/min", 2),
    "navigation_nis": ("filter: normalised innovation squared, 1 expected", "", 2),
    "navigation_samples": ("filter: samples taken", "", 0),
    "navigation_refused": ("filter: samples refused", "", 0),
}
"""Label, unit and decimals of the metrics that are shown."""

_MOST_LEGS = 30  # rows that fit a page

_LEGS_NOTE = (
    "closest: smallest true distance from the waypoint; cross-track error (positive to starboard) and"
    " vertical error: second half of straight legs; depth overshoot: in % of the change of depth"
)

_LABEL = 14  # characters of a waypoint's name: the table is to fit 80 columns


def metrics_table(metrics: Mapping[str, float]) -> Table:
    """The whole flight in numbers; metrics without a value, or that only repeat another, are left out."""
    rows = [
        (label, _number(metrics[name], decimals), unit)
        for name, (label, unit, decimals) in _METRICS.items()
        if math.isfinite(metrics.get(name, math.nan)) and not _idle(metrics, name)
    ]
    return Table.of("Whole flight", ("metric", "value", Column("unit", align="left")), rows)


def navigation_table(metrics: Mapping[str, float]) -> Table | None:
    """A row per sensor of the navigation filter: consistency, and what it refused; None without a filter."""
    samples = "_samples"
    rows = []
    for name in metrics:
        kind = name.removeprefix("navigation_").removesuffix(samples)
        if name != f"navigation_{kind}{samples}":
            continue
        taken, refused = metrics[name], metrics[f"navigation_{kind}_refused"]
        nis = metrics[f"navigation_{kind}_nis"]
        half = 1.96 * math.sqrt(2.0 / max(taken, 1.0))
        band = f"{max(1.0 - half, 0.0):.2f} to {1.0 + half:.2f}"
        rows.append((kind, f"{taken:.0f}", f"{refused:.0f}", _number(nis, 2), band))
    head = ("sensor", "taken", "refused", "innovation squared", "95 % band")
    return Table.of("Navigation filter; normalised innovation squared", head, rows) if rows else None


def legs_table(legs: Sequence[Leg]) -> Table:
    """A row per leg; of many legs those that were missed and those with the largest errors."""
    shown = list(legs)
    title = "Legs"
    # The worst legs, yet in the order of the mission.
    if len(shown) > _MOST_LEGS:
        kept = {id(leg) for leg in sorted(legs, key=_importance, reverse=True)[:_MOST_LEGS]}
        shown = [leg for leg in legs if id(leg) in kept]
        title = f"The {_MOST_LEGS} worst of {len(legs)} legs"
    numbers = {id(leg): number for number, leg in enumerate(legs, start=1)}
    rows = [
        (
            _shortened(f"{numbers[id(leg)]} {leg.label}"),
            "yes" if leg.reached else "no",
            _number(leg.smallest_m, 1),
            _number(leg.time_s, 1),
            _number(leg.cross_track_mean_m, 2),
            _number(leg.cross_track_largest_m, 2),
            _number(leg.vertical_largest_m, 2),
            _number(leg.depth_overshoot_percent, 1),
        )
        for leg in shown
    ]
    head = (
        "waypoint",
        "reached",
        Column("closest", "m"),
        Column("time", "s"),
        Column("cross-track mean", "m"),
        Column("cross-track max", "m"),
        Column("vertical max", "m"),
        Column("depth overshoot", "%"),
    )
    return Table.of(title, head, rows, note=_LEGS_NOTE)


def loops_table(loops: Mapping[str, Loop]) -> Table:
    """A row per control loop that was at work."""
    rows = [
        (
            loop.name,
            f"{loop.error_rms:.3g}",
            f"{loop.error_largest:.3g}",
            loop.error_unit,
            f"{loop.demand_rms:.3g}",
            f"{loop.demand_largest:.3g}",
            loop.demand_unit,
            f"{100.0 * loop.saturated:.1f}",
            f"{100.0 * loop.unmet:.1f}",
        )
        for loop in loops.values()
    ]
    head = (
        "loop",
        "error rms",
        "error max",
        Column("unit", align="left"),
        "demand rms",
        "demand max",
        Column("unit", align="left"),
        Column("saturated", "%"),
        Column("not met", "%"),
    )
    return Table.of("Control loops while they were at work", head, rows)


def spread_table(metrics: Mapping[str, Array], count: int) -> Table:
    """Least, median and largest of every metric over many flights."""
    rows = []
    for name, (label, unit, decimals) in _METRICS.items():
        if name not in metrics:  # of the navigation filter, where there is none
            continue
        perceived = metrics[name.removeprefix("true_")]
        if name.startswith("true_") and not any(map(differs, perceived, metrics[name])):
            continue
        values = metrics[name][np.isfinite(metrics[name])]
        if len(values):
            spread = (values.min(), np.median(values), values.max())
            rows.append((label, *(f"{value:.{decimals}f}" for value in spread), unit))
    head = ("metric", "least", "median", "largest", Column("unit", align="left"))
    return Table.of(f"Over {count} seeds", head, rows)


def seeds_section(seeds: Seeds) -> Section:
    """Flights of many seeds: how they ended, what they exceeded, and the spread of their metrics."""
    sentences = (seeds_sentence(seeds), *(f"{clause}." for clause in seeds_exceeded(seeds)))
    return Section(sentences=sentences, tables=(spread_table(seeds.metrics, len(seeds.seeds)),))


def seeds_exceeded(seeds: Seeds) -> list[str]:
    """Flights that broke a limit, touched the bottom, left the water or pitched beyond reason, as clauses."""
    return excess_clauses(seeds.excesses, lambda place: f"seed {seeds.seeds[place]}", "flights")


def seeds_sentence(seeds: Seeds) -> str:
    """How many flights ended in which way, and the seeds that did not complete the mission."""
    counts = {ending: seeds.endings.count(ending) for ending in dict.fromkeys(seeds.endings)}
    ends = ", ".join(f"{count} {ending}" for ending, count in counts.items())
    kinds = {
        "not complete": [
            seed for seed, end in zip(seeds.seeds, seeds.endings, strict=True) if end != "complete"
        ],
        "too near to an obstacle": seeds.too_near,
        "touched the bottom": seeds.touched,
        "beyond the mission's limits": seeds.off_limits,
    }
    unkept = "".join(
        f"; {words}: seed {', '.join(map(str, which[:8]))}" for words, which in kinds.items() if which
    )
    return f"{len(seeds.seeds)} seeds from {seeds.seeds[0]} on: {ends}{unkept}."


def samples_section(samples: Samples) -> Section:
    """Tables of the stops, and where the most nitrate was."""
    stops = samples.stops
    places = Table.of(
        "Position of the samples, m; ± deviation of the navigation",
        ("stop", "samples", "left out", "north", "east", "depth"),
        [
            (
                stop.label,
                str(stop.count),
                str(stop.on_the_way + stop.unsettled),
                *(value_text(value, 2) for value in stop.position),
            )
            for stop in stops
            if stop.label != UNDER_WAY
        ],
    )
    values = Table.of(
        "Measured; ± standard deviation of the samples",
        ("stop", "nitrate, mg/L", "density, kg/m3", "cond., S/m", "salinity"),
        [
            (stop.label, *(value_text(stop.values[name], _DECIMALS[name]) for name in CHANNELS))
            for stop in stops
        ],
    )
    tables = (places, values) if any(stop.label != UNDER_WAY for stop in stops) else (values,)
    return Section("Water samples", tuple(_samples(samples)), tables=tables)


def _samples(samples: Samples) -> list[str]:
    """What is left out at stops, the largest nitrate, and how far measured and true values are apart."""
    if not len(samples.t):
        return ["The payload took no sample."]
    top = int(np.argmax(samples.values[:, 0]))
    north, east, depth = samples.position[top]
    off = np.sqrt(np.mean((samples.values - samples.true) ** 2, axis=0))
    apart = ", ".join(
        f"{name.split('_')[0]} {off[k]:.2g} {unit}".strip() for k, (name, unit) in enumerate(CHANNELS.items())
    )
    return [
        *_left_out(samples),
        f"{len(samples.t)} samples; the most nitrate was {samples.values[top, 0]:.2f} mg/L at"
        f" {samples.t[top]:.0f} s, north {north:.1f} m, east {east:.1f} m, {depth:.1f} m deep, where the"
        f" background is {samples.payload.water.at(np.array([depth]))[0, 0]:.2f} mg/L.",
        f"Measured and true water at the vehicle differ by {apart} rms: response, noise and offset.",
    ]


def _left_out(samples: Samples) -> list[str]:
    stops = [stop for stop in samples.stops if stop.on_the_way + stop.unsettled]
    if not stops:
        return []
    on_the_way, unsettled = (
        sum(getattr(stop, name) for stop in stops) for name in ("on_the_way", "unsettled")
    )
    sentences = [
        f"Samples at stops that do not count: {on_the_way} before the vehicle was within the acceptance"
        f" radius, {unsettled} before depth and sensors had settled."
    ]
    empty = [stop.label for stop in stops if not stop.count]
    if empty:
        sentences.append(
            f"No sample counts at {_some(empty)}: the vehicle was still diving; give a longer hold_s, or"
            " first a waypoint at the depth of the stop."
        )
    lagging = [stop.label for stop in stops if stop.count and not stop.sensors_settled]
    if lagging:
        sentences.append(
            f"The sensors had not settled at {_some(lagging)}: the slowest needs {samples.settling_s:.3g} s"
            " at the stop's depth; give a longer hold_s."
        )
    return sentences


_DECIMALS = {"nitrate_mg_l": 2, "density_kg_m3": 2, "conductivity_s_m": 3, "salinity_pss": 2}


def value_text(value: Value, decimals: int) -> str:
    """Mean and deviation with so many decimals, a dash where there are none."""
    if math.isnan(value.mean):
        return "–"
    return f"{value.mean:.{decimals}f} ± {value.deviation:.{decimals}f}"


def _some(labels: Sequence[str]) -> str:
    named = ", ".join(f'"{label}"' for label in labels[:3])
    return named + (f" and {len(labels) - 3} more" if len(labels) > 3 else "")


def _idle(metrics: Mapping[str, float], name: str) -> bool:
    """Whether a metric tells nothing: energy that is not known, a true error that is as it was perceived."""
    if name == "energy_wh":
        return metrics[name] <= 0.0
    return name.startswith("true_") and not differs(metrics[name.removeprefix("true_")], metrics[name])


def _importance(leg: Leg) -> tuple[bool, float]:
    largest = leg.cross_track_largest_m
    return not leg.reached, largest if math.isfinite(largest) else -1.0


def _shortened(label: str) -> str:
    """A label without its middle where it is long: what tells waypoints of a pattern apart is at the end."""
    if len(label) <= _LABEL:
        return label
    tail = _LABEL // 2 - 1
    return f"{label[: _LABEL - 1 - tail]}…{label[-tail:]}"


def _number(value: float, decimals: int) -> str:
    """A number with so many decimals and no minus before zero; nothing where there is none."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else ""
