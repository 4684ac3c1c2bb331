"""A flight in words, and as plain data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from seatrial.flight.flight import Flight
    from seatrial.flight.leg_figures import Leg

__all__ = ["plain", "sentences"]

_CAUSES = {
    "depth": "the mission's largest depth was passed",
    "altitude": "the bottom came nearer than the mission's smallest altitude",
    "fence": "the vehicle was outside the mission's fence",
    "time": "the mission took longer than its limit",
    "battery": "the battery was low",
    "actuator": "an actuator did not follow its command",
    "progress": "the next waypoint came no nearer for too long",
}
_SWITCHES_PER_MINUTE = 6.0  # more than this looks like a limit cycle around the minimum
_LEAST_S = 20.0  # of a flight from which starts per minute can be told
_SATURATED = 0.05
_OFF_M = 0.05


def sentences(flight: Flight) -> list[str]:
    """What happened on a flight, the most important first."""
    found = [_ending(flight), *_reactions(flight)]
    if flight.diverged:
        return found
    figures = flight.figures
    legs = [leg for leg in flight.legs if not math.isnan(leg.begin_s)]
    found.append(
        f"It went {figures['distance_m']:.0f} m over ground in {_time(figures['duration_s'])}"
        + (
            f" and used {figures['energy_wh']:.1f} Wh."
            if figures["energy_wh"] > 0.0
            else "; the vehicle file tells neither power_w_s3 nor [power], so that its energy is not known."
        )
    )
    straight = [leg for leg in legs if not math.isnan(leg.cross_track_largest_m)]
    if straight:
        worst = max(straight, key=lambda leg: leg.cross_track_largest_m)
        found.append(
            "On the second half of straight legs the cross-track error was"
            f" {figures['cross_track_rms_m']:.2f} m rms and at most {worst.cross_track_largest_m:.2f} m"
            f" ({worst.label}), the vertical error {figures['vertical_rms_m']:.2f} m rms and at most"
            f" {max(leg.vertical_largest_m for leg in straight):.2f} m."
        )
    found += _speeds(flight)
    found += _depth(legs)
    found += _stations(legs)
    found += _loops(flight)
    found += _actuators(flight)
    found += _sensors(flight)
    return found


def plain(flight: Flight) -> dict[str, Any]:
    """A flight as plain data, without its log."""
    return {
        "vehicle": flight.vehicle.name,
        "autopilot": flight.autopilot.name,
        "mission": flight.route.name,
        "ending": flight.ending,
        "complete": flight.complete,
        "figures": dict(flight.figures),
        "legs": [leg.to_dict() for leg in flight.legs],
        "loops": {name: loop.to_dict() for name, loop in flight.loops.items()},
        "actuators": {name: use.to_dict() for name, use in flight.actuator_use.items()},
        "alerts": [{"t_s": a.t_s, "reaction": a.reaction, "cause": a.cause} for a in flight.alerts],
        "circumstances": flight.circumstances.to_dict(),
        "sentences": flight.sentences(),
    }


def _ending(flight: Flight) -> str:
    who = f"{flight.vehicle.name} on {flight.route.name}"
    behind = sum(leg.reached for leg in flight.legs)
    count = f"{behind} of {len(flight.legs)} waypoints reached"
    missed = [leg for leg in flight.legs if not leg.reached and not math.isnan(leg.begin_s)]
    by = "".join(f"; {leg.label} missed by {leg.smallest_m - leg.acceptance_m:.2f} m" for leg in missed[:3])
    what = {
        "complete": "complete" if flight.complete else "flown to its end",
        "surfaced": "the vehicle surfaced before the end",
        "aborted": "aborted",
        "out of time": f"not complete after {_time(float(flight.t[-1]))}, the longest time allowed",
        "diverged": "the motion diverged; check gains, vehicle and the largest step",
    }[flight.ending]
    return f"{who}: {what}, {count}{by if flight.ending == 'complete' else ''}."


def _reactions(flight: Flight) -> list[str]:
    said = [fault.sentence() for fault in flight.circumstances.faults]
    said += [outage.sentence() for outage in flight.circumstances.outages]
    found = [f"Failures: {'; '.join(said)}."] if said else []
    for alert in flight.alerts:
        why = _CAUSES.get(alert.cause, f"no good sample of {alert.cause.removeprefix('stale_')} for too long")
        found.append(f"Reaction at {alert.t_s:.1f} s: {alert.reaction}, because {why}.")
    if said and not flight.alerts:
        found.append("No reaction of the safety was called for.")
    return found


def _speeds(flight: Flight) -> list[str]:
    """Legs that ask for more than guidance gives."""
    asked = max(stop.speed for stop in flight.route.stops)
    most = flight.autopilot.gains()["guidance.speed_max_m_s"]
    if asked <= most:
        return []
    return [f"Legs ask for up to {asked:g} m/s, and guidance keeps to speed_max_m_s = {most:g} m/s."]


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


def _loops(flight: Flight) -> list[str]:
    found = []
    for loop in flight.loops.values():
        if loop.saturated > _SATURATED:
            found.append(
                f"The {loop.name} loop was saturated for {100.0 * loop.saturated:.0f} % of its time; its"
                f" largest demand was {loop.demand_largest:.3g} {loop.demand_unit}."
            )
    return found


def _actuators(flight: Flight) -> list[str]:
    busiest = max(flight.actuator_use.values(), key=lambda use: use.switches_per_minute, default=None)
    if busiest is None or float(flight.t[-1]) < _LEAST_S:
        return []
    if busiest.switches_per_minute == 0.0:
        return []
    rate = f"{busiest.switches_per_minute:.1f} starts and stops a minute"
    if busiest.switches_per_minute > _SWITCHES_PER_MINUTE:
        return [f"{busiest.name} made {rate}: a limit cycle around its smallest command, or noise in a loop."]
    return [f"No actuator made more than {rate}."]


def _sensors(flight: Flight) -> list[str]:
    told = np.stack([flight.measured[name] for name in ("x", "y", "z")], axis=1)
    off = np.hypot(np.hypot(*(told - flight.position).T[:2]), told[:, 2] - flight.position[:, 2])
    off = off[np.isfinite(off)]
    found = []
    if len(off) and np.max(off) > _OFF_M:
        found.append(
            f"The position that the autopilot was told was up to {np.max(off):.1f} m from the true one;"
            " errors of guidance are those that it saw."
        )
    return [*found, *flight.circumstances.sensor_notes]


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
