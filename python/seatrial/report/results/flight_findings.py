"""The findings of a flight in words: the problem as a clause, and what to do about its root.

A wording per kind of `seatrial.flight.findings`. Held by ``tests/flight/test_findings.py``, which follows
remedies as well, and ``tests/flight/test_reactions.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from seatrial.base.finding import Finding
from seatrial.flight.excesses import Excess
from seatrial.flight.findings import reaction_key
from seatrial.report.results.watches import cause, source
from seatrial.report.results.watches import remedy as remedy_of_watch

if TYPE_CHECKING:
    from seatrial.verification.missions import CampaignFlights

CHECK = "check signs and margins of the autopilot (seatrial check AUTOPILOT --vehicle VEHICLE)"

ANOTHER = (
    "make one for this vehicle (seatrial autopilot VEHICLE), or hold the file against it (seatrial check"
    " AUTOPILOT --vehicle VEHICLE)"
)
"""What to do about an autopilot of another vehicle."""

_FARTHER = "plan the legs farther from the bottom, or slow down before the depth changes"


def problem(finding: Finding) -> str:
    """The problem and what caused it, a clause; a root that explains several findings comes first."""
    chain = [finding]
    while chain[-1].cause is not None:
        chain.append(chain[-1].cause)
    if len(chain) > 1 and chain[-1].kind in ("pitch unstable", "pitch not held"):
        # What the user has to mend is said before what it led to, which may be the tilt itself.
        after = where(finding) if finding.kind == "pitched over" else _own(finding)
        return f"{_own(chain[-1])}{', ' if finding.kind == 'pitched over' else '; '}{after}"
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
    words = next(filter(None, (_REMEDIES[link.kind](link) for link in reversed(chain))), "")
    missed = finding.kind == "waypoint missed" and len(chain) > 1 and not root
    if missed and any(link.kind == "loop saturated" for link in chain):
        words += "; a longer leg does not help"
    return words


def doubting(flights: CampaignFlights, worst: str, next_step: str) -> tuple[str, str]:
    """Worst problem and next step of missions, after the doubt about their autopilot where there is one."""
    if flights.doubt is None:
        return worst, next_step
    return f"{problem(flights.doubt)}; {worst}", f"{ANOTHER}; then verify again"


def _own(finding: Finding) -> str:
    """The clause of a finding without its cause."""
    return _PROBLEMS[finding.kind](finding)


_JOINT = dict.fromkeys(("position wrong", "out of trim", "vehicle too slow", "loops too weak"), ": ")
"""How a cause follows what it explains, where that is not by a semicolon."""


def where(finding: Finding) -> str:
    """When and where a finding was."""
    return (
        f"at {finding['at_s']:.1f} s, north {finding['north_m']:.1f} m, east {finding['east_m']:.1f} m,"
        f' {finding["depth_m"]:.1f} m deep, on the way to "{finding["leg"]}"'
    )


def not_reached(label: str, values: Any) -> str:
    """How near it came, as perceived, which decides whether the waypoint counts as reached, and in truth."""
    return (
        f'"{label}" not reached: the autopilot perceived it at {values["perceived_m"]:.2f} m at the nearest'
        f" (radius {values['acceptance_m']:g} m), the true distance was {values['smallest_m']:.2f} m"
    )


def _missed(finding: Finding) -> str:
    words = not_reached(finding.subject, finding.values)
    if "deep_m" not in finding.values:
        return words
    way = "deep" if finding["deep_m"] > 0.0 else "shallow"
    return f"{words}, {finding['aside_m']:.1f} m aside and {abs(finding['deep_m']):.1f} m too {way}"


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


def _near(finding: Finding) -> str:
    clear, reserve, promised = (finding[name] for name in ("clearance_m", "reserve_m", "promised_m"))
    near = f"the hull came to {clear:.2f} m from" if clear > 0.0 else f"the hull was {-clear:.2f} m inside"
    words = f"{near} an obstacle, {where(finding)}"
    if math.isnan(promised):
        return words
    return (
        f"{words}; the mission promises {promised:g} m{f', {-reserve:.2f} m more' if reserve < 0.0 else ''}"
    )


def _wrong_position(finding: Finding) -> str:
    if math.isfinite(finding["off_m"]):
        return f"the position that the autopilot was told was {finding['off_m']:.1f} m off there"
    outage = finding["outage"]
    return f"its position was wrong by so much{f' ({outage})' if outage else ''}"


def _position_remedy(finding: Finding) -> str:
    """What to do about a position that was wrong: what the flight did not have already.

    A navigation filter bridges samples that are missing. Alone it takes an offset of the fix for the truth;
    USBL and ranges to landmarks, which only the filter reads, show it (docs/validation.md, acoustics).
    """
    fixes = f"give it {source('position')}, or position fixes more often or more exact ones"
    if finding["filtered"]:
        return fixes
    if finding["missing"]:
        return f"{fixes}, or fly by the navigation filter (--navigation filter), which bridges the outage"
    return f"{fixes}; USBL and ranges need --navigation filter, which alone does not find an offset"


def _unstable(finding: Finding) -> str:
    return (
        f"pitch of {finding.subject} is unstable above {finding['from_m_s']:.2f} m/s, and no loop commands"
        f" it; at up to {finding['flown_m_s']:.2f} m/s it pitched to {finding['pitch_deg']:.0f} deg"
    )


def _unstable_remedy(finding: Finding) -> str:
    slower = f"fly at {math.floor(100.0 * finding['safe_m_s']) / 100.0:.2f} m/s or slower (speed_m_s)"
    return (
        f"{slower}, or raise the centre of buoyancy to {1e3 * finding['b_over_g_needed_m']:.0f} mm above the"
        f" centre of gravity (now {1e3 * finding['b_over_g_m']:.0f} mm), or add thrusters that command pitch"
    )


def _not_held(finding: Finding) -> str:
    return (
        f'no loop of mode "{finding["mode"]}" holds the pitch of {finding.subject}, and it pitched to'
        f" {finding['pitch_deg']:.0f} deg"
    )


def _trim(finding: Finding) -> str:
    net, weight = finding["net_n"], finding["weight_n"]
    kind = "light" if net > 0.0 else "heavy"
    return f"the vehicle is too {kind} by {abs(net):.1f} N ({100.0 * abs(net) / weight:.1f} % of its weight)"


def _trim_remedy(finding: Finding) -> str:
    change = "take out buoyancy or add ballast" if finding["net_n"] > 0.0 else "add buoyancy"
    faster = " or fly the leg faster, for the force of fins grows with the speed squared"
    return f"trim the vehicle ({change}){faster if finding.subject == 'pitch' else ''}"


def _steep(finding: Finding) -> str:
    asked, flown = finding["asked_deg"], finding["flown_deg"]
    way = "descends" if finding["depth_m"] > 0.0 else "climbs"
    rest = f"the vehicle flew at most {flown:.0f} deg" if flown < asked else "the rest was made on the spot"
    return (
        f"the leg {way} {abs(finding['depth_m']):.1f} m over {finding['length_m']:.1f} m, a slope of"
        f" {asked:.0f} deg, where guidance allows {finding['limit_deg']:.0f} deg ({finding['limited_by']});"
        f" {rest}"
    )


def _steep_remedy(finding: Finding) -> str:
    longer = (
        f"lengthen the leg to at least {finding['needed_m']} m, or begin the change of depth a leg earlier"
    )
    return f"{longer}; a larger acceptance radius would only hide it" if finding["missed"] else longer


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


def _late_remedy(finding: Finding) -> str:
    if not finding.subject:
        return "allow more time, or plan for the speed that the vehicle makes good"
    return "plan the legs for the speed that the vehicle makes good in this water, or allow more time"


def _off_course(finding: Finding) -> str:
    words = f'{finding["error"]} error of {finding["error_m"]:.2f} m on the way to "{finding.subject}", more'
    words += f" than its acceptance radius of {finding['acceptance_m']:g} m"
    if finding["error"] == "vertical" or not finding["crossing"]:
        return words
    current, speed = finding["current_m_s"], finding["speed_m_s"]
    return (
        f"{words}; the current of {current:.2g} m/s is {100.0 * current / speed:.0f} % of its {speed:g} m/s"
    )


def _off_course_remedy(finding: Finding) -> str:
    if finding["error"] == "vertical":
        return f"lengthen the leg or slow it down; then tune the {finding['loop']} loop (seatrial tune)"
    keys, turn = f"lookahead_m ({finding['lookahead_m']:g})", "turn onto it earlier or with a longer leg"
    if finding["crossing"]:
        keys = f"integral_gain_m_s ({finding['integral_gain_m_s']:g}) and {keys}"
        turn = f"fly it faster against this current, {turn}"
    return f"{turn}, or tune {keys} under [guidance] of the autopilot file"


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


def saturation(finding: Finding) -> str:
    """How long a loop was saturated, and what it asked for at most, a sentence."""
    return (
        f"The {finding.subject} loop was saturated for {100.0 * finding['share']:.0f} % of its time; its"
        f" largest demand was {finding['demand']:.3g} {finding['unit']}."
    )


_PROBLEMS: dict[str, Callable[[Finding], str]] = {
    "diverged": lambda _: "the motion diverged",
    "another vehicle": lambda f: (
        f"the autopilot was made for {f['made_for']}, and {f.subject} flies"
        if f["made_for"]
        else f"the autopilot {f['autopilot']} does not fit {f.subject}"
    ),
    "vehicle too slow": lambda f: (
        f"at the crossover of its {f.subject} loop the delay of this vehicle costs {f['phase_deg']:.0f} deg"
        " of phase, by its gains and the apparent mass alone, and may leave little margin"
    ),
    "loops too weak": lambda f: (
        f"its loops ask for at most {100.0 * f['share']:.0f} % of what the actuators of this vehicle give"
        f" ({f.subject})"
    ),
    "loops doubtful": lambda _: "",
    "too near": _near,
    "bottom touched": lambda f: f"{f.subject} touched the bottom, {where(f)}",
    "too low": lambda f: (
        f"{f.subject} came to {f['altitude_m']:.2f} m above the bottom, {where(f)}; the mission's least"
        f" altitude is {f['limit_m']:g} m"
    ),
    "outside the fence": lambda f: (
        f"{f.subject} was up to {f['beyond_m']:.1f} m outside the mission's fence, {where(f)}"
    ),
    "too deep": lambda f: (
        f"{f.subject} went {f['deepest_m']:.2f} m deep, {where(f)}; the mission's largest depth is"
        f" {f['limit_m']:g} m"
    ),
    "safety reaction": _reaction,
    "waypoint out of time": lambda f: f'"{f.subject}" was not reached: {f["outcome"]}',
    "waypoint missed": _missed,
    "position wrong": _wrong_position,
    "loop saturated": lambda f: (
        f"the {f.subject} loop was saturated for {100.0 * f['share']:.0f} % {f['of']}"
    ),
    "out of trim": _trim,
    "leg too steep": _steep,
    "pitch unstable": _unstable,
    "pitch not held": _not_held,
    "pitched over": lambda f: (
        f"{f.subject} pitched to {f['pitch_deg']:.0f} deg, {where(f)}; more than {f['limit_deg']:g} deg is"
        " beyond what coefficients and loops are made for"
    ),
    "left the water": lambda f: (
        f"{f.subject} rose to {f['height_m']:.1f} m above the surface, {where(f)}: it leapt out of the water,"
        " which coefficients and loops are not made for"
    ),
    "late": _late,
    "off course": _off_course,
    "thrust table exceeded": lambda f: str(f["sentence"]),
    "loop busy": saturation,
}
"""The clause of each kind."""

_SHALLOW = "begin deeper ([start] depth_m) or under way, and limit the pitch (pitch_max_deg)"

_REMEDIES: dict[str, Callable[[Finding], str]] = {
    "diverged": lambda _: CHECK,
    "loops doubtful": lambda _: CHECK,
    "too near": lambda _: (
        "lay the way farther out (margin_m of the perimeter, or other waypoints), slow down before stops, or"
        " wait for less current; seatrial check with --vehicle, --autopilot and --current tells beforehand"
    ),
    "bottom touched": lambda _: _FARTHER,
    "too low": lambda _: _FARTHER,
    "outside the fence": lambda _: "plan the legs and their turns farther inside the fence, or widen it",
    "too deep": lambda _: "plan shallower legs, or raise the mission's largest depth",
    "safety reaction": _reaction_remedy,
    "waypoint out of time": lambda _: (
        "give the flight more time (--max-time), or a speed that the vehicle can hold in this current"
    ),
    "waypoint missed": _missed_remedy,
    "position wrong": _position_remedy,
    "loop saturated": lambda _: "fly faster if fins steer it, or fit stronger actuators",
    "out of trim": _trim_remedy,
    "leg too steep": _steep_remedy,
    "pitch unstable": _unstable_remedy,
    "pitch not held": lambda f: (
        f'add "pitch" to the loops of mode "{f["mode"]}" in the autopilot file: the actuators can command it'
        " (seatrial autopilot gives start gains)"
    ),
    "pitched over": lambda _: _SHALLOW,
    "left the water": lambda _: _SHALLOW,
    "late": _late_remedy,
    "off course": _off_course_remedy,
    "thrust table exceeded": lambda _: (
        "fly with a supply that the table was measured at (--voltage), or measure it there"
    ),
    "loop busy": lambda _: "lower the speed or the gains of this loop; its actuators have no more to give",
}
"""What to do about each kind, where it is the root."""


UNKEPT = {
    "too_near": "too near to an obstacle",
    "bottom_touched": "the bottom touched",
    "too_low": "below the mission's least altitude",
    "too_deep": "beyond the mission's largest depth",
}
"""What a flight did not keep, by kind of excess: after "flown to its end"."""

_DID = {
    "too_near": "came too near to an obstacle",
    "bottom_touched": "touched the bottom",
    "too_low": "came below the mission's least altitude of {limit:g} m",
    "too_deep": "went beyond the mission's largest depth of {limit:g} m",
    "above_surface": "rose above the surface",
    "too_steep": "pitched beyond {limit:g} deg",
    "not_complete": "did not end complete",
    "battery": "used more energy than the battery of {limit:g} Wh holds",
}


def exceeded(excess: Excess) -> str:
    """What flights of a kind of excess did, after "missions" or the like."""
    return _DID[excess.kind].format(limit=excess.limit)


def _how_far(excess: Excess) -> str:
    """What the worst flight came to."""
    value, limit = excess.value, excess.limit
    if excess.kind == "too_near":
        where = f"{value:.2f} m away" if value > 0.0 else f"{-value:.2f} m inside"
        return where + (f" (promised: {limit:g} m)" if limit > 0.0 else "")
    return {
        "bottom_touched": f"{-value:.2f} m below it",
        "above_surface": f"{-value:.1f} m high",
        "too_steep": f"{value:.0f} deg",
        "not_complete": "the first of them",
        "battery": f"{value:.1f} Wh",
    }.get(excess.kind, f"{value:.2f} m")


def excess_clauses(
    excesses: Iterable[Excess], name: Callable[[int], str], what: str = "missions"
) -> list[str]:
    """A clause for each excess: how many flights, the worst one and when.

    `name` says what the flight of a place is called ("mission 7"), `what` what several are.
    """
    return [
        f"{excess.count} of {excess.of} {what} {exceeded(excess)}, the worst is {name(excess.worst)}:"
        f" {_how_far(excess)}{'' if math.isnan(excess.at_s) else f' at {excess.at_s:.1f} s'}"
        for excess in excesses
    ]
