"""What went wrong on a flight in words: the problem as a clause, what to do about its root, what watches saw.

A wording per kind of `seatrial.flight.findings`. Held by ``tests/flight/test_findings.py``, which follows
remedies as well, ``tests/flight/test_reactions.py`` and ``tests/flight/test_silence.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import autopilot_names
from seatrial.base.finding import Finding
from seatrial.flight.excesses import Excess
from seatrial.flight.findings import GROUPS, group, reaction_key
from seatrial.flight.sensor_channels import CHANNELS_OF_GROUP, GROUP_OF_KIND
from seatrial.report.results.phrases import Phrases, filled, templates

if TYPE_CHECKING:
    from seatrial.flight.log import FlightLog
    from seatrial.flight.metrics import Leg
    from seatrial.verification.missions import CampaignFlights

_THEME = "flight_findings"

ANOTHER = (
    "make one for this vehicle (seatrial autopilot VEHICLE), or hold the file against it (seatrial check"
    " AUTOPILOT --vehicle VEHICLE)"
)
"""What to do about an autopilot of another vehicle."""

_SILENT_S = 1.5
"""A sensor is silent where it shows nothing new for so long, s: longer than the periods of common sensors."""

_JOINT = dict.fromkeys(("position wrong", "out of trim", "vehicle too slow", "loops too weak"), ": ")
"""How a cause follows what it explains, where that is not by a semicolon."""


def _table(name: str) -> dict[str, str]:
    return templates(_THEME)[name]


_own = Phrases(_THEME, "problem")
"""The clause of a finding without its cause."""

_cure = Phrases(_THEME, "remedy", {"down": lambda m_s: f"{math.floor(100.0 * m_s) / 100.0:.2f}"})
"""What to do about a finding, where it is the root."""


def problem(finding: Finding) -> str:
    """The problem and what caused it, a clause; a root that explains several findings comes first."""
    chain = [finding]
    while chain[-1].cause is not None:
        chain.append(chain[-1].cause)
    if len(chain) > 1 and chain[-1].kind in ("pitch unstable", "pitch not held"):
        # What the user has to mend is said before what it led to, which may be the tilt itself.
        if finding.kind == "pitched over":
            return f"{_own(chain[-1])}, {filled(_table('parts')['where'], finding.values)}"
        return f"{_own(chain[-1])}; {_own(finding)}"
    words = _own(finding)
    for link in chain[1:]:
        clause = _own(link)
        words += f"{_JOINT.get(link.kind, '; ')}{clause}" if clause else ""
    return words


def remedy(finding: Finding) -> str:
    """What to do about a finding: about the root of it."""
    chain = [finding]
    while chain[-1].cause is not None:
        chain.append(chain[-1].cause)
    root = chain[-1].kind in ("pitch unstable", "pitch not held")
    words = next(filter(None, (_cure(link) for link in reversed(chain))), "")
    missed = finding.kind == "waypoint missed" and len(chain) > 1 and not root
    if missed and any(link.kind == "loop saturated" for link in chain):
        words += "; a longer leg does not help"
    return words


def doubting(flights: CampaignFlights, worst: str, next_step: str) -> tuple[str, str]:
    """Worst problem and next step of missions, after the doubt about their autopilot where there is one."""
    if flights.doubt is None:
        return worst, next_step
    return f"{problem(flights.doubt)}; {worst}", f"{ANOTHER}; then verify again"


def not_reached(leg: Leg) -> str:
    """How near it came, as perceived, which decides whether the waypoint counts as reached, and in truth."""
    names = ("perceived_m", "acceptance_m", "smallest_m")
    return _own.fill("waypoint missed", subject=leg.label, **{name: getattr(leg, name) for name in names})


@_cure.of("waypoint missed")
def _missed_remedy(finding: Finding) -> str:
    if finding["loop"] == "heading":
        return (
            f"enlarge its acceptance radius beyond {finding['smallest_m']:.1f} m, slow the leg down, or tune"
            " the heading loop (seatrial tune)"
        )
    return (
        "slow the leg down or lengthen it, for its depth was not reached in time; then tune the"
        f" {finding['loop']} loop (seatrial tune)"
    )


@_own.of("out of trim")
def _trim(finding: Finding) -> str:
    net, weight = finding["net_n"], finding["weight_n"]
    kind = "light" if net > 0.0 else "heavy"
    return f"the vehicle is too {kind} by {abs(net):.1f} N ({100.0 * abs(net) / weight:.1f} % of its weight)"


@_cure.of("out of trim")
def _trim_remedy(finding: Finding) -> str:
    change = "take out buoyancy or add ballast" if finding["net_n"] > 0.0 else "add buoyancy"
    faster = " or fly the leg faster, for the force of fins grows with the speed squared"
    return f"trim the vehicle ({change}){faster if finding.subject == 'pitch' else ''}"


@_own.of("leg too steep")
def _steep(finding: Finding) -> str:
    asked, flown = finding["asked_deg"], finding["flown_deg"]
    way = "descends" if finding["depth_m"] > 0.0 else "climbs"
    rest = f"the vehicle flew at most {flown:.0f} deg" if flown < asked else "the rest was made on the spot"
    return (
        f"the leg {way} {abs(finding['depth_m']):.1f} m over {finding['length_m']:.1f} m, a slope of"
        f" {asked:.0f} deg, where guidance allows {finding['limit_deg']:.0f} deg ({finding['limited_by']});"
        f" {rest}"
    )


@_own.of("late")
def _late(finding: Finding) -> str:
    took, planned, allowed = (finding[name] for name in ("took_s", "planned_s", "allowed_s"))
    words = f"it took {took:.0f} s, {took / planned:.2g} times the planned {planned:.0f} s"
    words += f", and the mission allows {allowed:.0f} s" if took > allowed else ""
    if not finding.subject:
        return words
    words += f', furthest behind its plan on the way to "{finding.subject}":'
    words += f" {finding['leg_s']:.0f} s for {finding['leg_planned_s']:.0f} s"
    if finding.cause is not None:
        return words
    return f"{words} ({finding['made_good_m_s']:.2f} m/s made good, {finding['asked_m_s']:g} m/s asked for)"


@_own.of("off course")
def _off_course(finding: Finding) -> str:
    words = f'{finding["error"]} error of {finding["error_m"]:.2f} m on the way to "{finding.subject}", more'
    words += f" than its acceptance radius of {finding['acceptance_m']:g} m"
    if finding["error"] == "vertical" or not finding["crossing"]:
        return words
    current, speed = finding["current_m_s"], finding["speed_m_s"]
    return (
        f"{words}; the current of {current:.2g} m/s is {100.0 * current / speed:.0f} % of its {speed:g} m/s"
    )


@_cure.of("off course")
def _off_course_remedy(finding: Finding) -> str:
    if finding["error"] == "vertical":
        return f"lengthen the leg or slow it down; then tune the {finding['loop']} loop (seatrial tune)"
    keys, turn = f"lookahead_m ({finding['lookahead_m']:g})", "turn onto it earlier or with a longer leg"
    if finding["crossing"]:
        keys = f"integral_gain_m_s ({finding['integral_gain_m_s']:g}) and {keys}"
        turn = f"fly it faster against this current, {turn}"
    return f"{turn}, or tune {keys} under [guidance] of the autopilot file"


@_own.of("safety reaction")
def _reaction(finding: Finding) -> str:
    outage = f" ({finding['outage']})" if finding["outage"] else ""
    words = f"the safety called for {finding['reaction']} at {finding['called_s']:.1f} s, because"
    words += f" {cause(finding['watch'])}{outage}"
    after = still_down(finding.subject, finding.values)
    return f"{words}; {after}" if after else words


def still_down(vehicle: str, ascent: Any) -> str:
    """That a vehicle which was to come up was not up at the end; empty where it was."""
    if "ended" not in ascent:
        return ""
    words, depth = f"{vehicle} did not come up in the {ascent['since_s']:.0f} s after: it", ascent["ended_m"]
    if ascent["ended"] == "rising":
        return f"{words} was still {depth:.1f} m deep, and rose at {ascent['rising_m_s']:.2f} m/s"
    went = f"sank from {ascent['begun_m']:.1f} to" if ascent["ended"] == "sank" else "stayed below, at"
    return f"{words} {went} {depth:.1f} m"


@_cure.of("safety reaction")
def _reaction_remedy(finding: Finding) -> str:
    if finding.values.get("ended") in ("sank", "stayed"):
        return _come_up(finding)
    watch, missed = finding["watch"], finding["group"]
    if finding["too_patient"]:
        return (
            f"shorten {watch}.after_s ({finding['waited_s']:g} s) under [safety], so that it reacts in time,"
            f" or give it {source(missed)}"
        )
    return remedy_of_watch(watch, finding["outage"])


def _come_up(finding: Finding) -> str:
    """How a vehicle is brought up that did not come up."""
    down = finding["down_m_s"]
    # Half a centimetre per second matters to a vehicle that floats up.
    water = f" in water that goes down at {down:g} m/s" if down > 0.005 else ""
    floats = f"give it more buoyancy ({finding['net_n']:+.2g} N{water}) or a weight to drop"
    if finding["last_reaction"] == "surface":
        return f"{floats}, or more speed on the way up (surface_speed_m_s under [safety])"
    if finding["last_watch"] == "actuator":
        return f"{floats}: an abort stops its motors"
    key = reaction_key(finding["last_watch"])
    return (
        f'let it come up under power ({key} = "surface" under [safety] in the autopilot file), for an abort'
        f" stops its motors; or {floats}"
    )


UNKEPT = {
    "too_near": "too near to an obstacle",
    "bottom_touched": "the bottom touched",
    "too_low": "below the mission's least altitude",
    "too_deep": "beyond the mission's largest depth",
}
"""What a flight did not keep, by kind of excess: after "flown to its end"."""


def exceeded(excess: Excess) -> str:
    """What flights of a kind of excess did, after "missions" or the like."""
    return filled(_table("did")[excess.kind], {"limit": excess.limit})


def excess_clauses(
    excesses: Iterable[Excess], name: Callable[[int], str], what: str = "missions"
) -> list[str]:
    """A clause for each excess: how many flights, the worst one and when.

    `name` says what the flight of a place is called ("mission 7"), `what` what several are.
    """
    return [
        f"{excess.count} of {excess.of} {what} {exceeded(excess)}, the worst is {name(excess.worst)}:"
        f" {filled(_table('worst')[excess.kind], {'value': excess.value, 'limit': excess.limit})}"
        f"{'' if math.isnan(excess.at_s) else f' at {excess.at_s:.1f} s'}"
        for excess in excesses
    ]


def cause(watch: str) -> str:
    """What a watch saw, to follow "because".

    Examples
    --------
    >>> cause("stale_velocity")
    'no good sample of the velocity over ground arrived for too long'
    """
    return (
        _table("saw").get(watch)
        or f"no good sample of the {GROUPS[watch.removeprefix('stale_')]} arrived for too long"
    )


def source(missed: str) -> str:
    """What else tells an autopilot a group of channels, to follow "give it".

    Examples
    --------
    >>> source("velocity")
    'another source of the velocity over ground'
    """
    if missed == "position":
        return "a position aid (a GPS fix at the surface, USBL, or ranges to landmarks: the how-to on flying)"
    return f"another source of the {GROUPS[missed]}"


def remedy_of_watch(watch: str, outage: str = "") -> str:
    """What to do after a watch called for a reaction; `outage`: the one that was asked for and is the reason.

    Examples
    --------
    >>> remedy_of_watch("fence")
    'plan the legs farther inside the fence, or widen it'
    """
    if watch in _table("after"):
        return _table("after")[watch]
    name = GROUPS[group(watch)]
    longer = f"allow a longer gap ({watch}.after_s under [safety] in the autopilot file)"
    if outage:
        return f"give it {source(group(watch))}, or {longer}"
    return f"find out why the {name} stopped arriving, or {longer}"


def silence(flight: FlightLog, watch: str, at_s: float) -> str:
    """Whether the samples that a watch missed never came, or came and were refused, to follow its cause.

    The log keeps what the sensors showed: a group was silent while none of its channels changed. Empty where
    the autopilot goes by an estimate, or by perfect sensors, which may rightly repeat a value.
    """
    missed, around = group(watch), flight.circumstances
    sensors = around.sensors or {}
    kinds = [kind for kind in sensors if GROUP_OF_KIND.get(kind) == missed]
    if around.navigation != "sensors" or not any(sensors[kind].get("noise") for kind in kinds):
        return ""
    names = autopilot_names()["channels"]
    shown = np.stack([flight.measured[names[c]] for c in CHANNELS_OF_GROUP[missed]], axis=1)
    came = flight.t[np.flatnonzero(np.any(np.diff(shown, axis=0) != 0.0, axis=1)) + 1]
    before, after = came[came < at_s], came[came >= at_s]
    last = float(before[-1]) if len(before) else 0.0
    if at_s - last < _SILENT_S:
        return "; samples came, and none was believed: they jumped, or a channel repeated one value"
    until = f"until {after[0]:.1f} s" if len(after) else "to the end"
    ends = [outage.until_s for outage in around.outages if outage.group == missed]
    over = max((end for end in ends if last < end < at_s), default=None)
    longer = (
        "" if over is None else f": beyond the outage that ended at {over:.1f} s, by drop-outs of its own"
    )
    return f"; {' and '.join(kinds)} gave no sample from {last:.1f} s {until}{longer}; none was refused"
