"""What the safety called for on a flight, why, what became of the vehicle then, and what to do about it.

Held by ``tests/flight/test_reactions.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.flight import watches
from seatrial.flight.findings import Finding, injected
from seatrial.vehicle.stability import statics

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seatrial.flight.log import FlightLog

_SANK_M = 0.1  # below where the reaction began: less is the way on of a hull under way

_RISING_M_S, _LATELY_S = 0.02, 10.0  # slower it does not come up; time over which that is told

_DOWN_M_S = 0.005  # of the current: what matters to a vehicle that floats up


@dataclass(frozen=True)
class Alert:
    """A reaction of the autopilot's safety: when, what it did, why."""

    t_s: float
    reaction: str
    cause: str


def called_for(
    flight: FlightLog, alerts: Sequence[Alert], others: Sequence[Finding], *, otherwise: str = ""
) -> list[Finding]:
    """The first reaction, why, what became of the vehicle and what to do, in its place among `others`.

    It comes first where the vehicle did not come up, or where its cause began before the others did.

    Parameters
    ----------
    flight : FlightLog
    alerts : sequence of Alert
        In the order in which they were called for, at least one.
    others : sequence of Finding
        What else went wrong, the gravest first.
    otherwise : str, optional
        What to do where it is not the watch that tells it.
    """
    first = alerts[0]
    missed = watches.group(first.cause)
    outage = injected(flight, missed, first.t_s)
    waited = watches.patience(first.cause, flight.autopilot.safety())
    begun = first.t_s - waited
    earlier = any(one.at_s > begun for one in others)
    words = f"the safety called for {first.reaction} at {first.t_s:.1f} s, because"
    words += f" {watches.cause(first.cause)}{f' ({outage})' if outage else ''}"
    remedy = watches.remedy(first.cause, outage)
    if earlier and missed:
        remedy = f"shorten {first.cause}.after_s ({waited:g} s) under [safety], so that it reacts in time, or"
        remedy += f" give it {watches.source(missed)}"
    left = ascent(flight, alerts)
    lost = left is not None and bool(left.remedy)
    if left is not None:
        words, remedy = f"{words}; {left.words}", left.remedy or remedy
    found = Finding(words, otherwise or remedy, begun)
    return [found, *others] if earlier or lost else [*others, found]


def ascent(flight: FlightLog, alerts: Sequence[Alert]) -> Finding | None:
    """That a vehicle which was to come up was not up at the end; None where it was.

    Without a remedy where it still came nearer to the surface: it was only not given the time.
    """
    if not alerts or alerts[-1].reaction not in ("surface", "abort"):
        return None
    last, depth = alerts[-1], flight.position[:, 2]
    begins, lately = np.searchsorted(flight.t, (last.t_s, flight.t[-1] - _LATELY_S))
    since = float(flight.t[-1]) - last.t_s
    highest = float(np.nanmin(depth[begins:]))
    up = highest <= flight.autopilot.safety()["surfaced_above_m"]
    if up or since < _LATELY_S or not math.isfinite(depth[-1]):
        return None
    words = f"{flight.vehicle.name} did not come up in the {since:.0f} s after: it"
    rising = float((depth[lately] - depth[-1]) / (flight.t[-1] - flight.t[lately]))
    if rising > _RISING_M_S:
        return Finding(f"{words} was still {depth[-1]:.1f} m deep, and rose at {rising:.2f} m/s", "")
    sank = depth[-1] > depth[begins] + _SANK_M
    went = f"sank from {depth[begins]:.1f} to" if sank else "stayed below, at"
    return Finding(f"{words} {went} {depth[-1]:.1f} m", _come_up(flight, last))


def _come_up(flight: FlightLog, last: Alert) -> str:
    """How a vehicle is brought up that did not come up."""
    net, down = statics(flight.vehicle).net_n, float(flight.circumstances.current[2])
    water = f" in water that goes down at {down:g} m/s" if down > _DOWN_M_S else ""
    floats = f"give it more buoyancy ({net:+.2g} N{water}) or a weight to drop"
    if last.reaction == "surface":
        return f"{floats}, or more speed on the way up (surface_speed_m_s under [safety])"
    if last.cause == "actuator":
        return f"{floats}: an abort stops its motors"
    key = watches.reaction_key(last.cause)
    return (
        f'let it come up under power ({key} = "surface" under [safety] in the autopilot file), for an abort'
        f" stops its motors; or {floats}"
    )
