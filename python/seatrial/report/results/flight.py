"""The words of a flight: three lines, metrics, legs, loops, samples of the water, what happened; many seeds.

What is worst comes from the findings of `seatrial.flight.findings`. Held by ``tests/report/test_report.py``,
``tests/flight/test_findings.py``, ``tests/flight/test_payload.py`` and ``tests/cli/test_cli_fly.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import Column, Report, Section, Table, as_sentence
from seatrial.flight.findings import ascent, beyond_the_model, clearance, saturated_loops
from seatrial.flight.flight import Flight, Seeds
from seatrial.flight.metrics import Leg, Loop, differs, true_vertical
from seatrial.flight.payload import CHANNELS, UNDER_WAY, Samples, Value
from seatrial.report.results.flight_findings import (
    ANOTHER,
    UNKEPT,
    cause,
    excess_clauses,
    not_reached,
    problem,
    remedy,
    silence,
    still_down,
)
from seatrial.vehicle.actuators import beyond_tables


@dataclass(frozen=True)
class FlightWordsSettings:
    """What of a flight is worth a sentence."""

    least_s: float = 20.0  #: Starts per minute are known of a flight that lasts so long, s.
    saturated: float = 0.05  #: A loop that is saturated for less of its time is not named.
    off_m: float = 0.05  #: A smaller error of the perceived position is rounding, m.


SETTINGS = FlightWordsSettings()


def sentences(flight: Flight) -> list[str]:
    """What happened on a flight, the most important first."""
    found = [_ending(flight), *flight.warnings, *_reactions(flight)]
    if flight.diverged:
        return found
    metrics = flight.metrics
    legs = [leg for leg in flight.legs if not math.isnan(leg.begin_s)]
    found.append(
        f"It went {metrics['distance_m']:.0f} m over ground in {_time(metrics['duration_s'])}"
        + (
            f" and used {metrics['energy_wh']:.1f} Wh."
            if metrics["energy_wh"] > 0.0
            else "; the vehicle file tells neither power_w_s3 nor [power], so that its energy is not known."
        )
    )
    straight = [leg for leg in legs if not math.isnan(leg.cross_track_largest_m)]
    if straight:
        worst = max(straight, key=lambda leg: leg.cross_track_largest_m)
        found.append(
            "On the second half of straight legs the cross-track error was"
            f" {metrics['cross_track_rms_m']:.2f} m rms and at most {worst.cross_track_largest_m:.2f} m"
            f" ({worst.label}), the vertical error {metrics['vertical_rms_m']:.2f} m rms and at most"
            f" {max(leg.vertical_largest_m for leg in straight):.2f} m."
        )
    near = Finding("too near", Severity.NOTE, flight.vehicle.name, clearance(flight, metrics))
    found += [as_sentence(problem(near))] if math.isfinite(metrics["clearance_m"]) else []
    found += [as_sentence(problem(beyond)) for beyond in beyond_the_model(flight, metrics)]
    found += [f"WARNING: {one}." for one in _beyond_tables(flight)]
    found += _speeds(flight)
    found += _depth(legs)
    found += _stations(legs)
    found += [*map(problem, saturated_loops(flight.loops)), *_unmet(flight)]
    found += _actuators(flight)
    found += _sensors(flight)
    return found


def report(flight: Flight, *, sections: Sequence[Section] = (), doubted: bool = True) -> Report:
    """Three lines, metrics, legs and loops, further sections, sentences."""
    worst, next_step = _worst(flight, doubted=doubted)
    tables = [metrics_table({**flight.metrics, **true_vertical(flight)}), legs_table(flight.legs)]
    if not flight.diverged:
        tables.append(loops_table(flight.loops))
    filtered = navigation_table(flight.metrics)
    if filtered is not None:
        tables.append(filtered)
    return Report(
        title=f"{flight.vehicle.name} on {flight.route.name}",
        outcome=flight.outcome_in_words,
        good=_how_good(flight),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(sentences=tuple(_reactions(flight)), tables=tuple(tables)),
            *(() if flight.samples is None else (samples_section(flight.samples),)),
            *sections,
            Section("What happened", tuple(sentences(flight)), details=True),
        ),
    )


def outcome(flight: Flight) -> str:
    """How a flight ended; one that missed waypoints or kept no distance or limit is not called complete."""
    if flight.outcome != "complete" or flight.complete:
        return flight.outcome
    faults = [UNKEPT[kind] for kind in flight.unkept]
    faults += [] if all(leg.reached for leg in flight.legs) else ["waypoints missed"]
    return f"flown to its end, {' and '.join(faults)}"


def _how_good(flight: Flight) -> str:
    """Waypoints reached and cross-track error."""
    metrics = flight.metrics
    reached = f"{sum(leg.reached for leg in flight.legs)} of {len(flight.legs)} waypoints reached"
    if flight.diverged:
        return f"{reached} before the motion diverged at {float(flight.t[-1]):.1f} s"
    across = ""
    if math.isfinite(metrics["cross_track_rms_m"]):
        largest = metrics["cross_track_largest_m"]
        most = f", at most {largest:.2f} m" if math.isfinite(largest) else ""
        across = f"; cross-track error {metrics['cross_track_rms_m']:.2f} m rms{most}{_truly(metrics)}"
    clear = f"; {metrics['clearance_m']:.1f} m clear" if math.isfinite(metrics["clearance_m"]) else ""
    way = f"{metrics['distance_m']:.0f} m over ground"
    return f"{reached} in {_time(metrics['duration_s'])}, {way}{clear}{across}"


def _truly(metrics: Mapping[str, float]) -> str:
    """The true cross-track error, where it is another than the one that the autopilot perceived."""
    names = ("cross_track_rms_m", "cross_track_largest_m")
    if not any(differs(metrics[name], metrics[f"true_{name}"]) for name in names):
        return ""
    rms, largest = (metrics[f"true_{name}"] for name in names)
    return f" as perceived; truly {rms:.2f} m rms, at most {largest:.2f} m"


def _worst(flight: Flight, *, doubted: bool) -> tuple[str, str]:
    """The worst problem of a flight, and what to do about it; a second one beside it where both are grave.

    An autopilot of another vehicle comes behind what went wrong, and before what did not.
    """
    findings = flight.findings
    grave = findings and findings[0].severity > Severity.WEAKNESS
    if flight.warnings and doubted:
        doubt = "; ".join(warning.removesuffix(".") for warning in flight.warnings)
        if grave:
            return f"{problem(findings[0])}; {doubt}", f"{remedy(findings[0])}; and {ANOTHER}"
        return f"{doubt}; {_good(flight)[0]}", f"{ANOTHER}; then fly again"
    if not grave:
        return _good(flight)
    # What one and the same root explains is said once.
    others = [finding for finding in findings[1:2] if finding.root is not findings[0].root]
    return "; ".join(map(problem, (findings[0], *others))), remedy(findings[0])


def _good(flight: Flight) -> tuple[str, str]:
    """The weakness of a flight that succeeded, and what to do about it; what stands out least without one."""
    if findings := flight.findings:
        return "; ".join(map(problem, findings)), remedy(findings[0])
    actuators = _actuators(flight)
    if actuators and "limit cycle" in actuators[0]:
        return actuators[0], "lower the gain or filter the sensor of the loop that drives it"
    verify = "verify it over many vehicles, currents and seeds (seatrial verify CAMPAIGN, or --seeds 100)"
    errors = [
        (size, f'{name} error of {size:.2f} m on the way to "{leg.label}"')
        for leg in flight.legs
        for name, size in (("cross-track", leg.cross_track_largest_m), ("vertical", leg.vertical_largest_m))
        if math.isfinite(size)
    ]
    if errors:
        return f"{max(errors)[1]}{_truly(flight.metrics)}", verify
    if held := _stations([leg for leg in flight.legs if not math.isnan(leg.begin_s)]):
        return held[0], verify
    return "nothing stands out", verify


def _ending(flight: Flight) -> str:
    who = f"{flight.vehicle.name} on {flight.route.name}"
    behind = sum(leg.reached for leg in flight.legs)
    count = f"{behind} of {len(flight.legs)} waypoints reached"
    missed = [leg for leg in flight.legs if not leg.reached and not math.isnan(leg.begin_s)]
    by = "".join(f"; {not_reached(leg)}" for leg in missed[:3])
    what = {
        "complete": flight.outcome_in_words,
        "surfaced": "the vehicle surfaced before the end",
        "aborted": "aborted",
        "out of time": f"not complete after {_time(float(flight.t[-1]))}, the longest time allowed",
        "diverged": "the motion diverged; check gains, vehicle and the largest step",
    }[flight.outcome]
    return f"{who}: {what}, {count}{by if flight.outcome == 'complete' else ''}."


def _beyond_tables(flight: Flight) -> list[str]:
    """Tables of thrust that were not measured at the supply of the flight."""
    supply = flight.circumstances.voltage_v
    return [] if supply is None else beyond_tables(flight.vehicle, supply)


def _reactions(flight: Flight) -> list[str]:
    said = [fault.sentence() for fault in flight.circumstances.faults]
    said += [outage.sentence() for outage in flight.circumstances.outages]
    found = [f"Failures: {'; '.join(said)}."] if said else []
    for alert in flight.alerts:
        found.append(
            f"Reaction at {alert.t_s:.1f} s: {alert.reaction}, because {cause(alert.cause)}"
            f"{silence(flight, alert.cause, alert.t_s)}."
        )
    if after := still_down(flight.vehicle.name, ascent(flight, flight.alerts)):
        found.append(f"{after}.")
    if said and not flight.alerts:
        found.append("No reaction of the safety was called for.")
    return found


def _speeds(flight: Flight) -> list[str]:
    """Legs that ask for more than guidance gives, or for a stop of who cannot stop."""
    asked = max(stop.speed for stop in flight.route.stops)
    most = flight.autopilot.gains()["guidance.speed_max_m_s"]
    found = []
    if asked > most:
        found.append(f"Legs ask for up to {asked:g} m/s, and guidance keeps to speed_max_m_s = {most:g} m/s.")
    stops = sum(stop.task == "hold" for stop in flight.route.stops)
    if stops and flight.loiter_radius > 0.0:
        found.append(
            f"{flight.vehicle.name} cannot stop: at {stops} stop{'s' if stops > 1 else ''} it circles with a"
            f" radius of {flight.loiter_radius:g} m, that much nearer to any obstacle."
        )
    return found


def _depth(legs: Sequence[Leg]) -> list[str]:
    changed = [leg for leg in legs if not math.isnan(leg.depth_overshoot_m)]
    if not changed:
        return []
    worst = max(changed, key=lambda leg: leg.depth_overshoot_percent)
    return [
        f"The depth went at most {worst.depth_overshoot_m:.2f} m beyond a change of"
        f" {abs(worst.depth_step_m):.1f} m ({worst.depth_overshoot_percent:.1f} %, {worst.label})."
    ]


def _stations(legs: Sequence[Leg]) -> list[str]:
    held = [leg for leg in legs if not math.isnan(leg.hold_largest_m)]
    if not held:
        return []
    worst = max(held, key=lambda leg: leg.hold_largest_m)
    return [
        f"Station was kept within {worst.hold_largest_m:.2f} m ({worst.label}, {worst.hold_rms_m:.2f} m rms)."
    ]


def _unmet(flight: Flight) -> list[str]:
    """Loops whose demands the actuators did not meet although none was at its limit."""
    return [
        f"The actuators did not meet the demand of the {loop.name} loop for {100.0 * loop.unmet:.0f} % of its"
        " time, though they were not at their limits: they produce it only together with another motion, or"
        " rest below their start."
        for loop in flight.loops.values()
        if loop.unmet - loop.saturated > SETTINGS.saturated
    ]


def _actuators(flight: Flight) -> list[str]:
    busiest = max(flight.actuator_use.values(), key=lambda use: use.switches_per_minute, default=None)
    if busiest is None or float(flight.t[-1]) < SETTINGS.least_s:
        return []
    if busiest.switches_per_minute == 0.0:
        return []
    rate = f"{busiest.switches_per_minute:.1f} starts and stops a minute"
    if busiest.switches_per_minute > 6.0:  # more looks like a limit cycle around the minimum
        return [f"{busiest.name} made {rate}: a limit cycle around its smallest command, or noise in a loop."]
    return [f"No actuator made more than {rate}."]


def _sensors(flight: Flight) -> list[str]:
    told = np.stack([flight.measured[name] for name in ("x", "y", "z")], axis=1)
    off = np.hypot(np.hypot(*(told - flight.position).T[:2]), told[:, 2] - flight.position[:, 2])
    off = off[np.isfinite(off)]
    found = []
    if len(off) and np.max(off) > SETTINGS.off_m:
        found.append(
            f"The position that the autopilot was told was up to {np.max(off):.1f} m from the true one;"
            " errors of guidance are those that it perceived."
        )
    return [*found, *flight.circumstances.sensor_notes]


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


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
