"""The findings of a check of a vehicle, an autopilot or a mission in words: a sentence per kind.

A warning begins in lower case, as a clause behind "WARNING:" or "Worst:"; a note is a sentence. Held by
``tests/check/test_check_findings.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from seatrial.base.finding import Finding, Severity
from seatrial.base.report import listed
from seatrial.control_design.margin_report import MarginRow
from seatrial.report.results import check_vehicle_findings


def sentence(finding: Finding) -> str:
    """A finding in words, without its full stop."""
    words = _WORDS[finding.kind]
    if isinstance(words, str):
        more = _further(finding.values.get("further", 0), "leg")
        return words.format(subject=finding.subject, more=more, **finding.values)
    return words(finding)


def duration(seconds: float) -> str:
    """Time as people say it.

    Examples
    --------
    >>> duration(42.0), duration(576.3), duration(7300.0)
    ('42 s', '9 min 36 s', '2 h 1 min')
    """
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def water(current: Sequence[float]) -> str:
    """A current in words: north, east, down, m/s.

    Examples
    --------
    >>> water((0.0, -0.3, 0.0))
    'a current of 0.3 m/s to the west'
    """
    north, east, down = current
    if not any(current):
        return "still water"
    speed = math.sqrt(north**2 + east**2 + down**2)
    sides = (("north", north), ("south", -north), ("east", east), ("west", -east))
    names = [name for name, x in sides if x > 0.0]
    if len(names) == 1 and down == 0.0:
        return f"a current of {speed:g} m/s to the {names[0]}"
    return f"a current of {speed:.2g} m/s (north {north:g}, east {east:g}, down {down:g})"


def waypoints(count: int) -> str:
    """How many waypoints."""
    return f"{count} waypoint{'' if count == 1 else 's'}"


def _further(more: int, what: str) -> str:
    """How many further legs or ways are meant."""
    return f" (and {more} further {what}{'' if more == 1 else 's'})" if more else ""


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


# Autopilot.


def _loop(finding: Finding) -> str:
    shaped = finding["reference_rad_s"]
    reference = f"reference filtered at {shaped:g} rad/s" if shaped else "reference not filtered"
    return (
        f"{finding.subject.capitalize()}: at most {finding['demand']:g} {finding['unit']}, {reference},"
        f" anti-windup {finding['anti_windup']}"
    )


def _weakness(rows: Sequence[MarginRow]) -> str:
    """Why breakpoints are not sound, by speed: what grows, or the loop and its margins that fall short."""
    speeds_by_cause: dict[object, tuple[str, list[str]]] = {}
    for row in rows:
        # One and the same motion, whatever moves most in it.
        cause = frozenset(row.grows.split(" and ")) if row.grows else row.weakness
        speeds_by_cause.setdefault(cause, (row.weakness, []))[1].append(f"{row.speed_m_s:.2f}")
    return "; ".join(f"at {listed(speeds)} m/s {why}" for why, speeds in speeds_by_cause.values())


def _no_speed_sound(finding: Finding) -> str:
    why = f": {_weakness(finding['rows'])}" if finding["rows"] else ""
    return f"no speed ahead is sound{why}; look at what is not commanded, or tune (seatrial tune)"


def _astern_not_sound(finding: Finding) -> str:
    rows = finding["rows"]
    least = max(row.speed_m_s for row in rows)
    grows = list(dict.fromkeys(row.grows for row in rows if row.grows))
    why = f"a motion grows ({', '.join(grows)})" if grows else "the margins are small"
    return f"Astern at {-least:.2f} m/s and faster {why}; a mission does not go astern"


def _speeds_not_sound(finding: Finding) -> str:
    return (
        f"keep the speed of missions between {finding['low_m_s']:.2f} and {finding['high_m_s']:.2f} m/s, or"
        f" tune the gains (seatrial tune): {_weakness(finding['rows'])}"
    )


def _delay_of_sensors(finding: Finding) -> str:
    others = f", and {finding['others']} more breakpoints are short" if finding["others"] else ""
    first = "Typical" if finding.severity == Severity.NOTE else "typical"
    return (
        f"{first} sensors, whose delay seatrial tune counts, leave less margin than the perfect ones of this"
        f" table: {_weakness(finding['rows'])}{others}"
    )


def _short_lookahead(finding: Finding) -> str:
    path = "course" if finding.subject == "heading" else "depth"
    return (
        f"at {finding['m_s']:.2f} m/s the {path} nearly oscillates about a path: {finding['key']} ="
        f" {finding['given_m']:g} is short of the {finding['needed_m']:.3g} m that the {finding.subject} loop"
        " needs; raise it or fly slower"
    )


# Mission.


def _path(finding: Finding) -> str:
    return (
        f"Path: {finding['length_m']:.0f} m in {duration(finding['time_s'])},"
        f" {waypoints(finding['waypoints'])}; straight, at the speeds of its legs, in still water"
    )


def _steepest(finding: Finding) -> str:
    slope = finding["slope_deg"]
    return (
        f'Steepest: {abs(slope):.0f} deg {"up" if slope > 0.0 else "down"} on the way to "{finding.subject}"'
    )


def _deepest(finding: Finding) -> str:
    limit = finding["limit_m"]
    words = f"limit {limit:g} m" if math.isfinite(limit) else "no limit"
    return f"Deepest: {finding['depth_m']:g} m, {words}"


def _lowest(finding: Finding) -> str:
    limit = finding["limit_m"]
    words = f"limit {limit:g} m" if limit else "no limit"
    return f"Lowest above the bottom: {finding['altitude_m']:g} m, {words}"


def _energy(finding: Finding) -> str:
    energy = finding["energy"]
    battery = energy.battery_wh
    of_battery = (
        ""
        if battery is None
        else f", {100.0 * energy.total_wh / battery:.0f} % of the {battery:g} W h of the battery"
    )
    return (
        f"Energy: {energy.total_wh:.1f} W h ({energy.driving_wh:.1f} W h driving, {energy.hotel_wh:.1f} W h"
        f" hotel load){of_battery}"
    )


def _silent(finding: Finding) -> str:
    speeds = _numbers(finding["speeds_m_s"])
    return f"Energy: without the thrusters at {speeds} m/s, for which the model gives no power"


def _cannot_turn(finding: Finding) -> str:
    speeds = _numbers(finding["speeds_m_s"])
    return f"{finding.subject} cannot turn while it runs at {speeds} m/s; fly slower or faster"


def _against_current(finding: Finding) -> str:
    against, top, over_ground = finding["current_m_s"], finding["top_m_s"], finding["m_s"]
    return (
        f'leg {finding["leg"]} "{finding.subject}" asks for {over_ground:g} m/s over ground; against the'
        f" current of {against:.2g} m/s that is {over_ground + against:.2f} m/s through the water, more than"
        f" the top speed of {top:.2f} m/s{_further(finding['further'], 'leg')}; fly slower than"
        f" {max(top - against, 0.0):.2f} m/s"
    )


def _too_steep(finding: Finding) -> str:
    circle = finding["circle_m"]
    end = "on the spot" if circle is None else f"in circles of {circle:g} m"
    return (
        f'the way to "{finding.subject}" is {finding["size"]:.0f} deg steep, more than pitch_max_deg ='
        f" {finding['limit']:g}{_further(finding['further'], 'way')}: the rest of its depth is made {end};"
        " begin earlier or lengthen the leg"
    )


def _depth_too_fast(finding: Finding) -> str:
    return (
        f'the way to "{finding.subject}" changes the depth at {finding["size"]:.2f} m/s, faster than'
        f" depth_rate_max_m_s = {finding['limit']:g}{_further(finding['further'], 'way')}; it lags, fly"
        " slower or lengthen the leg"
    )


_CIRCLES = {
    "vehicle": "vehicle's circle",
    "turn_rate_max_deg_s": "circle of the autopilot's turn_rate_max_deg_s",
}


def _tight_turns(finding: Finding) -> str:
    return (
        f"{finding['count']} of {finding['turns']} turns are tighter than the {_CIRCLES[finding['of']]} of"
        f" {finding['radius_m']:.1f} m at {finding['m_s']:g} m/s, most of all at"
        f' "{finding.subject}" with room for {finding["room_m"]:.1f} m; widen the pattern or, with thrusters,'
        " fly slower"
    )


def _tight_circle(finding: Finding) -> str:
    return (
        f'the circle of {finding["asked_m"]:g} m about "{finding.subject}" is tighter than the'
        f" {_CIRCLES[finding['of']]} of {finding['radius_m']:.1f} m at {finding['m_s']:g} m/s; widen it or,"
        " with thrusters, fly slower"
    )


def _flown(finding: Finding) -> str:
    clear = finding["clearance_m"]
    near = f", at least {clear:.1f} m clear" if math.isfinite(clear) else ""
    waters = "; ".join(map(water, finding["currents"]))
    return (
        f"Flown with {finding.subject}: every waypoint reached{near}, at most {finding['slowest_s']:.0f} s,"
        f" in {waters}"
    )


def _not_as_promised(finding: Finding) -> str:
    flight = finding["flight"]
    missed = f"; missed {flight.missed}" if flight.missed else ""
    return (
        f"flown in {water(flight.current)} with {finding.subject}: {flight.outcome}; {flight.reached} of"
        f" {flight.waypoints} waypoints reached{missed}; {flight.worst}"
    )


_WORDS: dict[str, str | Callable[[Finding], str]] = {
    **check_vehicle_findings.WORDS,
    # Autopilot.
    "made for another vehicle": "{sentence}",
    "control law": "Control: {subject} every {period_s:g} s",
    "guidance": (
        "Guidance: {method}, lookahead {lookahead_m:g} m, pitch to {pitch_max_deg:g} deg, speed to"
        " {speed_max_m_s:g} m/s"
    ),
    "loop": _loop,
    "regulators": "LQR: gains of {subject}",
    "no hovering": (
        "No mode keeps the depth without speed: station-keeping is a circle of {loiter_radius_m:g} m"
    ),
    "breakpoints": (
        "Breakpoints: {inside} of {count} within the {astern_m_s:.2f} to {top_m_s:.2f} m/s that the vehicle"
        " reaches; gains are linear between points and constant beyond the ends"
    ),
    "few breakpoints within reach": (
        "{inside} of the {count} breakpoints lie within {astern_m_s:.2f} to {top_m_s:.2f} m/s: the gains"
        " hardly adapt to the speed; set schedule.speeds_m_s over that range"
    ),
    "breakpoints below top speed": (
        "the last breakpoint, {last_m_s:g} m/s, is far below the top speed of {top_m_s:.2f} m/s; gains stay"
        " constant above it"
    ),
    "speed limit without effect": (
        "speed_max_m_s = {limit_m_s:g} is more than the top speed of {top_m_s:.2f} m/s: it limits nothing"
    ),
    "row not commanded": (
        'mode "{subject}": its actuators do not command {row} ({loop}) independently at {m_s:.2f} m/s; leave'
        " the loop out or add actuators"
    ),
    "demand beyond reach": (
        'Mode "{subject}": {loop} may ask for {demand:g} {unit}, and the actuators reach {reach:.3g} {unit}'
        " at"
        " {m_s:.2f} m/s; anti-windup then works"
    ),
    "no speed sound": _no_speed_sound,
    "astern not sound": _astern_not_sound,
    "speeds not sound": _speeds_not_sound,
    "delay of sensors": _delay_of_sensors,
    "short lookahead": _short_lookahead,
    "tight loiter circle": (
        "loiter_radius_m = {radius_m:g} leaves little room beside the vehicle's tightest circle of"
        " {tightest_m:.1f} m; widen it"
    ),
    "abort sinks": (
        "abort stops all actuators, and {subject} is {heavy_n:.3g} N heavy: it sinks; choose surface, or trim"
        " it buoyant"
    ),
    # Mission: the plan.
    "path": _path,
    "steepest": _steepest,
    "deepest": _deepest,
    "lowest": _lowest,
    "no limit": (
        "No limit of {subject}: the mission sets none, so the autopilot watches none; add it under [limits]"
    ),
    "start": "Start: latitude {latitude_deg:.6f}, longitude {longitude_deg:.6f} deg",
    "lawnmower": "Leg {leg}: {lines} lines {apart_m:.3g} m apart, at most {asked_m:g} m asked for",
    "spiral": "Leg {leg}: a spiral of {turns:.3g} turns, arms {apart_m:g} m apart",
    "fence": 'Fence: {distance_m:.1f} m from the nearest way, that to "{subject}"',
    "way near fence": (
        'the way to "{subject}" comes within {distance_m:.1f} m of the fence, less than its radius of'
        " acceptance of {acceptance_m:g} m; a turn or a current may carry the vehicle out"
    ),
    "widest turn": 'Widest turn: {beyond_m:.1f} m beyond the next leg, at "{subject}"',
    "tight turns": _tight_turns,
    "tight circle": _tight_circle,
    # Mission: with its vehicle and autopilot.
    "energy unknown": "Energy: unknown, as the file of {subject} gives neither power_w_s3 nor [power]",
    "energy": _energy,
    "energy without thrusters": _silent,
    "energy of station-keeping": "Energy: station-keeping counts with the hotel load alone",
    "battery exceeded": (
        "the mission takes {total_wh:.0f} W h, more than the battery holds ({battery_wh:g} W h); shorten the"
        " mission or fly slower"
    ),
    "battery nearly empty": (
        "only {left_percent:.0f} % of the battery is left at the end in still water; a current takes more"
    ),
    "nothing drives ahead": "no actuator of {subject} drives ahead",
    "no top speed": "{sentence}",
    "leg too fast": (
        'leg {leg} "{subject}" asks for {m_s:g} m/s, more than the top speed of {top_m_s:.2f} m/s{more}; fly'
        " slower"
    ),
    "leg too fast against current": _against_current,
    "no station-keeping": (
        'leg {leg} "{subject}" asks for station-keeping, and {vehicle} commands no {lacking} at rest{more};'
        " it"
        " circles there instead; better plan circle_radius_m and turns"
    ),
    "cannot turn": _cannot_turn,
    "leg above speed limit": (
        'leg {leg} "{subject}" asks for {m_s:g} m/s, and speed_max_m_s of the autopilot is {limit_m_s:g}; it'
        " flies at that speed"
    ),
    "leg below breakpoints": (
        'leg {leg} "{subject}" asks for {m_s:g} m/s, below the first breakpoint of the gains at'
        " {first_m_s:g} m/s; fly faster"
    ),
    "no mode keeps station": (
        'leg {leg} "{subject}" asks for station-keeping, and no mode of the autopilot keeps the depth by'
        " heave: it circles at loiter_radius_m = {radius_m:g} m"
    ),
    "way too steep": _too_steep,
    "depth changes too fast": _depth_too_fast,
    # Mission: flown beforehand.
    "too long to fly": "Not flown here: planned to take more than {longest_h:g} h; fly it (seatrial fly)",
    "not flown": "Not flown here: {why}",
    "cannot be flown": "it cannot be flown: {why}",
    "flown as promised": _flown,
    "not flown as promised": _not_as_promised,
}
