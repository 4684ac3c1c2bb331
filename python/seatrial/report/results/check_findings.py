"""The findings of a check of a vehicle, an autopilot or a mission in words: a sentence per kind.

A warning begins in lower case, as a clause behind "WARNING:" or "Worst:"; a note is a sentence. Held by
``tests/check/test_check_findings.py``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from seatrial.base.finding import Finding, Severity
from seatrial.base.report import listed
from seatrial.control_design.margin_report import MarginRow
from seatrial.report.results.phrases import Phrases


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


def _percent(share: float) -> str:
    """A share in per cent with its sign: two digits of a small one, no decimals of a large one."""
    percent = 100.0 * share
    return f"{percent:+.0f} %" if abs(percent) >= 9.95 else f"{percent:+.2g} %"


def _weakness(rows: Sequence[MarginRow]) -> str:
    """Why breakpoints are not sound, by speed: what grows, or the loop and its margins that fall short."""
    speeds_by_cause: dict[object, tuple[str, list[str]]] = {}
    for row in rows:
        # One and the same motion, whatever moves most in it.
        cause = frozenset(row.grows.split(" and ")) if row.grows else row.weakness
        speeds_by_cause.setdefault(cause, (row.weakness, []))[1].append(f"{row.speed_m_s:.2f}")
    return "; ".join(f"at {listed(speeds)} m/s {why}" for why, speeds in speeds_by_cause.values())


_BY_NAME = {
    "circle": {
        "vehicle": "vehicle's circle",
        "turn_rate_max_deg_s": "circle of the autopilot's turn_rate_max_deg_s",
    },
    "how": {
        "rpm": "in rpm: rev/s times 60",
        "us": "in us from neutral: 1900 us about 1500 us are 400",
        "N": "in N",
        "rad": "in rad: 20 degrees are 0.349",
    },
    "lift": {"course": "N_uv, N_ur, Y_uv, Y_ur", "pitch": "M_uw, M_uq, Z_uw, Z_uq"},
    "raise": {"course": "", "pitch": ", or raise the buoyancy over the weight (z_b)"},
}
"""What a template shows for a name, by its word for that."""

sentence = Phrases(
    "check_findings",
    "sentence",
    {
        **{word: names.__getitem__ for word, names in _BY_NAME.items()},
        "duration": duration,
        "path": lambda loop: "course" if loop == "heading" else "depth",
        "percent": _percent,
        "radius": lambda radius_m: f"{radius_m:.{2 if radius_m < 10.0 else 1}f}",
        "time": lambda time_s: f"{time_s:.2g} s" if time_s < 99.5 else f"{time_s / 60.0:.0f} min",
        "water": water,
        "waters": lambda currents: "; ".join(map(water, currents)),
        "weakness": _weakness,
    },
)
"""A finding in words, without its full stop."""


@sentence.of("buoyancy")
def _buoyancy(finding: Finding) -> str:
    net, share = finding["net_n"], finding["share"]
    if abs(share) < 1e-4:
        return "Buoyancy: neutrally buoyant"
    kind, motion = ("buoyant", "rises") if net > 0.0 else ("heavy", "sinks")
    of_weight = f"{abs(net):.3g} N {kind} ({_percent(share)} of its weight)"
    return f"Buoyancy: {of_weight}: it {motion} with motors stopped"


@sentence.of("not stable at rest")
def _not_stable_at_rest(finding: Finding) -> str:
    height = finding["b_over_g_m"]
    place = f"is {1e3 * abs(height):.3g} mm below" if height < 0.0 else "is not above"
    return (
        f"{finding.subject} not stable at rest: the centre of buoyancy {place} the centre of gravity; z"
        " points down, so z_b has to be smaller than z_g"
    )


@sentence.of("no power")
def _no_power(finding: Finding) -> str:
    silent = {"direct": "thrust commanded in newtons", "table": "a table of thrust"}
    known = [words for kind, words in silent.items() if kind in finding["characteristics"]]
    why = " and ".join(known) or "a characteristic without power_w_s3"
    return f"Endurance: not known; {why} says nothing about power"


@sentence.of("cross-flow drag twice")
def _drag_twice(finding: Finding) -> str:
    included = finding["included"]
    both = listed(included)
    describes = "it describes" if len(included) == 1 else "they describe"
    return (
        f"{listed((finding.subject, *included))} are not zero: the strips of {finding.subject} already"
        f" include {both}; set {both} to 0, unless {describes} an appendage"
    )


@sentence.of("rows not commanded")
def _rows_not_commanded(finding: Finding) -> str:
    several = "," in finding.subject
    advised = ", ".join(f'"{row}"' for row in finding["advised"])
    return (
        f"{finding.subject} {'count' if several else 'counts'} as controllable (every row does in a file"
        f" without this key), and the actuators cannot command {'them' if several else 'it'} independently of"
        f" the others; give controllable = [{advised}], or correct positions and directions"
    )


@sentence.of("astern not sound")
def _astern_not_sound(finding: Finding) -> str:
    rows = finding["rows"]
    least = max(row.speed_m_s for row in rows)
    grows = list(dict.fromkeys(row.grows for row in rows if row.grows))
    why = f"a motion grows ({', '.join(grows)})" if grows else "the margins are small"
    return f"Astern at {-least:.2f} m/s and faster {why}; a mission does not go astern"


@sentence.of("delay of sensors")
def _delay_of_sensors(finding: Finding) -> str:
    others = f", and {finding['others']} more breakpoints are short" if finding["others"] else ""
    first = "Typical" if finding.severity == Severity.NOTE else "typical"
    return (
        f"{first} sensors, whose delay seatrial tune counts, leave less margin than the perfect ones of this"
        f" table: {_weakness(finding['rows'])}{others}"
    )


@sentence.of("energy")
def _energy(finding: Finding) -> str:
    energy = finding["energy"]
    battery, share = energy.battery_wh, ""
    if battery is not None:
        share = f", {100.0 * energy.total_wh / battery:.0f} % of the {battery:g} W h of the battery"
    return (
        f"Energy: {energy.total_wh:.1f} W h ({energy.driving_wh:.1f} W h driving, {energy.hotel_wh:.1f} W h"
        f" hotel load){share}"
    )


@sentence.of("leg too fast against current")
def _against_current(finding: Finding) -> str:
    against, top, over_ground = finding["current_m_s"], finding["top_m_s"], finding["m_s"]
    more = finding["further"]
    further = f" (and {more} further leg{'' if more == 1 else 's'})" if more else ""
    return (
        f'leg {finding["leg"]} "{finding.subject}" asks for {over_ground:g} m/s over ground; against the'
        f" current of {against:.2g} m/s that is {over_ground + against:.2f} m/s through the water, more than"
        f" the top speed of {top:.2f} m/s{further}; fly slower than {max(top - against, 0.0):.2f} m/s"
    )
