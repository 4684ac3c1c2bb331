"""The words of a flight: three lines, metrics, legs and loops, and what happened in sentences.

What is worst comes from the findings of `seatrial.flight.findings`.
Held by ``tests/report/test_report.py`` and ``tests/flight/test_findings.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from seatrial.base.finding import Finding, Severity
from seatrial.base.report import Report, Section, as_sentence
from seatrial.flight.findings import ascent, beyond_the_model, clearance, saturated_loops
from seatrial.flight.flight import Flight
from seatrial.flight.metrics import Leg, differs, true_vertical
from seatrial.report.results import watches
from seatrial.report.results.flight_findings import (
    ANOTHER,
    UNKEPT,
    not_reached,
    problem,
    remedy,
    saturation,
    still_down,
)
from seatrial.report.results.flight_tables import (
    legs_table,
    loops_table,
    metrics_table,
    navigation_table,
    samples_section,
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
    found += [*map(saturation, saturated_loops(flight.loops)), *_unmet(flight)]
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
    by = "".join(f"; {not_reached(leg.label, asdict(leg))}" for leg in missed[:3])
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
            f"Reaction at {alert.t_s:.1f} s: {alert.reaction}, because {watches.cause(alert.cause)}"
            f"{watches.silence(flight, alert.cause, alert.t_s)}."
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
