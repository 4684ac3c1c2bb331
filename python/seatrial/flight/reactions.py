"""Watches of the autopilot (channels, key under ``[safety]``, patience) and what they called for on a flight.

What they saw is put in words by `seatrial.report.results.watches`. Held by ``tests/flight/test_reactions.py``
and ``tests/flight/test_flight.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.finding import Finding, Severity
from seatrial.vehicle.stability import statics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seatrial.flight.log import FlightLog

GROUPS = {
    "position": "position",
    "depth": "depth",
    "attitude": "attitude",
    "velocity": "velocity over ground",
    "rates": "turn rates",
    "altitude": "altitude",
}
"""What a group of channels is called, by its name in ``stale_…``."""


def group(watch: str) -> str:
    """Group of channels whose samples a watch misses; empty for the other watches.

    Examples
    --------
    >>> group("stale_velocity"), group("fence")
    ('velocity', '')
    """
    return watch.removeprefix("stale_") if watch.startswith("stale_") else ""


def reaction_key(watch: str) -> str:
    """Key under ``[safety]`` of the reaction to a watch.

    Examples
    --------
    >>> reaction_key("depth"), reaction_key("stale_velocity")
    ('depth', 'stale_velocity.reaction')
    """
    watch = watch.replace("contradicted_", "stale_") if watch.startswith("contradicted_") else watch
    watch = "stale_depth" if watch == "ascent" else watch
    alone = watch in ("depth", "altitude", "fence", "time")
    return watch if alone else f"{watch}.reaction"


def patience(watch: str, safety: Mapping[str, Any]) -> float:
    """For how long a watch waits after what it misses was there last, s; 0 where it does not wait.

    `safety` is that of ``Autopilot.safety()``.
    """
    if watch.startswith("contradicted_"):
        watch = "contradiction"
    table = safety.get(watch)
    return float(table.get("after_s", 0.0)) if isinstance(table, Mapping) else 0.0


@dataclass(frozen=True)
class ReactionSettings:
    """When a vehicle that is to come up does not."""

    #: Slower it does not come up, m/s.
    rising_m_s: float = 0.02
    #: Time over which that is told, s.
    lately_s: float = 10.0


REACTIONS = ReactionSettings()


@dataclass(frozen=True)
class Alert:
    """A reaction of the autopilot's safety: when, what it did, why."""

    t_s: float
    reaction: str
    cause: str


def injected(flight: FlightLog, group: str, at_s: float) -> str:
    """The outage of a group of channels that was asked for and had begun by a time, in words, or ""."""
    begun = [
        outage for outage in flight.circumstances.outages if outage.group == group and outage.from_s <= at_s
    ]
    return begun[-1].sentence() if begun else ""


def called_for(flight: FlightLog, alerts: Sequence[Alert], others: Sequence[Finding]) -> list[Finding]:
    """The first reaction, why, and what became of the vehicle, in its place among `others`, gravest first.

    It comes first where the vehicle did not come up, or where its cause began before the others did. There is
    at least one alert, in the order in which they were called for.
    """
    first = alerts[0]
    missed = group(first.cause)
    waited = patience(first.cause, flight.autopilot.safety())
    begun = first.t_s - waited
    earlier = any(finding.at_s > begun for finding in others)
    after = ascent(flight, alerts)
    values = {
        "reaction": first.reaction,
        "watch": first.cause,
        "called_s": first.t_s,
        "waited_s": waited,
        "group": missed,
        "outage": injected(flight, missed, first.t_s),
        # A watch of samples that waited while something else went wrong waited too long.
        "too_patient": bool(earlier and missed),
        **after,
    }
    called = Finding("safety reaction", Severity.DANGER, flight.vehicle.name, values, at_s=begun)
    lost = after.get("ended") in ("sank", "stayed")
    return [called, *others] if earlier or lost else [*others, called]


def ascent(flight: FlightLog, alerts: Sequence[Alert]) -> dict[str, Any]:
    """What became of a vehicle that was to come up and was not up at the end; empty where it was.

    ``ended`` is "rising" where it still came nearer to the surface and was only not given the time, "sank" or
    "stayed"; with it go depths in m, the time that it had in s, and what holds it down.
    """
    if not alerts or alerts[-1].reaction not in ("surface", "abort"):
        return {}
    last, depth = alerts[-1], flight.position[:, 2]
    begins, lately = np.searchsorted(flight.t, (last.t_s, flight.t[-1] - REACTIONS.lately_s))
    since = float(flight.t[-1]) - last.t_s
    highest = float(np.nanmin(depth[begins:]))
    up = highest <= flight.autopilot.safety()["surfaced_above_m"]
    if up or since < REACTIONS.lately_s or not math.isfinite(depth[-1]):
        return {}
    rising = float((depth[lately] - depth[-1]) / (flight.t[-1] - flight.t[lately]))
    sank = depth[-1] > depth[begins] + 0.1  # less is the way on of a hull under way
    return {
        "ended": "rising" if rising > REACTIONS.rising_m_s else "sank" if sank else "stayed",
        "since_s": since,
        "rising_m_s": rising,
        "begun_m": float(depth[begins]),
        "ended_m": float(depth[-1]),
        "net_n": statics(flight.vehicle).net_n,
        "down_m_s": float(flight.circumstances.current[2]),
        "last_reaction": last.reaction,
        "last_watch": last.cause,
    }
