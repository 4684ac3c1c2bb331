"""The findings of a check of a vehicle in words: a sentence per kind, or a template of its values.

Held by ``tests/check/test_check_findings.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from seatrial.base.finding import Finding
from seatrial.base.report import listed


def _percent(share: float) -> str:
    """A share in per cent with its sign: two digits of a small one, no decimals of a large one."""
    percent = 100.0 * share
    return f"{percent:+.0f} %" if abs(percent) >= 9.95 else f"{percent:+.2g} %"


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 99.5 else f"{seconds / 60.0:.0f} min"


# Vehicle: at rest, speeds, turns.


def _buoyancy(finding: Finding) -> str:
    net, share = finding["net_n"], finding["share"]
    if abs(share) < 1e-4:
        return "Buoyancy: neutrally buoyant"
    kind, motion = ("buoyant", "rises") if net > 0.0 else ("heavy", "sinks")
    return (
        f"Buoyancy: {abs(net):.3g} N {kind} ({_percent(share)} of its weight): it {motion} with motors"
        " stopped"
    )


def _periods(finding: Finding) -> str:
    periods = ", ".join(f"{axis} {period:.3g} s" for axis, period in finding["periods_s"].items())
    return (
        f"Natural periods: {periods} (centre of buoyancy {1e3 * finding['b_over_g_m']:.3g} mm above gravity)"
    )


def _not_stable_at_rest(finding: Finding) -> str:
    height = finding["b_over_g_m"]
    place = f"is {1e3 * abs(height):.3g} mm below" if height < 0.0 else "is not above"
    return (
        f"{finding.subject} not stable at rest: the centre of buoyancy {place} the centre of gravity; z"
        " points down, so z_b has to be smaller than z_g"
    )


def _net_buoyancy(finding: Finding) -> str:
    return (
        f"B - m g = {finding['net_n']:+.4g} N is {_percent(finding['share'])} of the weight; a submerged"
        " vehicle is trimmed to a few tenths of a per cent. Is B in N?"
    )


def _no_power(finding: Finding) -> str:
    silent = {"direct": "thrust commanded in newtons", "table": "a table of thrust"}
    known = [words for kind, words in silent.items() if kind in finding["characteristics"]]
    why = " and ".join(known) or "a characteristic without power_w_s3"
    return f"Endurance: not known; {why} says nothing about power"


def _radius(turn: Any) -> str:
    return f"{turn.radius_m:.{2 if turn.radius_m < 10.0 else 1}f} m"


def _turn_under_way(finding: Finding) -> str:
    turn = finding["turn"]
    return (
        f"Turn under way, outer side at {turn.command:.4g} {turn.unit}, inner at half: radius"
        f" {_radius(turn)}, {abs(turn.rate_deg_s):.1f} deg/s at {turn.speed_m_s:.2f} m/s"
    )


def _turn_on_the_spot(finding: Finding) -> str:
    turn = finding["turn"]
    return (
        f"Turn on the spot, both sides opposed at {turn.command:.4g} {turn.unit}:"
        f" {abs(turn.rate_deg_s):.1f} deg/s (O moves at {turn.speed_m_s:.2f} m/s)"
    )


def _fin_turn(finding: Finding) -> str:
    turn = finding["turn"]
    return (
        f"Turn by {finding.subject} at {turn.fin_deg:.2g} deg, all ahead at {turn.command:.4g} {turn.unit}:"
        f" radius {_radius(turn)}, {abs(turn.rate_deg_s):.1f} deg/s at {turn.speed_m_s:.2f} m/s, roll and"
        " pitch held"
    )


def _rows_commanded(finding: Finding) -> str:
    lacking = f"; not: {' '.join(finding['lacking'])}" if finding["lacking"] else ""
    return f"Commanded independently: {' '.join(finding['able']) or 'nothing'}{lacking}"


# Vehicle: stability.

_LIFT = {"course": "N_uv, N_ur, Y_uv, Y_ur", "pitch": "M_uw, M_uq, Z_uw, Z_uq"}


def _neutral(finding: Finding) -> str:
    return ", fins at neutral" if finding["fins"] else ""


def _stable(finding: Finding) -> str:
    return (
        f"{finding.subject.capitalize()} stable ahead{_neutral(finding)}: a disturbance halves in"
        f" {_time(finding['halves_s'])} or less"
    )


def _doubles(finding: Finding) -> str:
    return (
        f"unstable at {finding['m_s']:.2f} m/s{_neutral(finding)}: without control a disturbance doubles in"
        f" {_time(finding['doubles_s'])}"
    )


def _unstable_and_held(finding: Finding) -> str:
    return (
        f"{finding.subject.capitalize()} {_doubles(finding)}; usual for a hull that is not slender, and its"
        " actuators can hold it"
    )


def _unstable(finding: Finding) -> str:
    plane, fins = finding.subject, finding["fins"]
    lift = _LIFT[plane]
    if fins:
        cure = (
            "Too little lift aft against the Munk moment; if the real vehicle is stable, check"
            f" {lift} of the hull, and area and C_L_alpha of {' and '.join(fins)}"
        )
    elif finding["slender"]:
        cure = (
            f"Lift of hull and fixed fins ({lift}) balances the Munk moment of a slender hull; give it where"
            " the vehicle has fins"
        )
    else:
        cure = "Usual for a hull that is not slender, but no actuator holds it: keep the vehicle slower"
        cure += ", or raise the buoyancy over the weight (z_b)" if plane == "pitch" else ""
    return f"{plane} {_doubles(finding)}. {cure}"


def _unstable_astern(finding: Finding) -> str:
    return (
        f"{finding.subject.capitalize()} unstable astern: at {finding['m_s']:.2f} m/s a disturbance doubles"
        f" in {_time(finding['doubles_s'])}"
    )


def _energy_added(finding: Finding) -> str:
    forces = "damping, lift and fins at neutral" if finding["fins"] else "damping and lift"
    return (
        f"{forces} add energy: at {finding['m_s']:+.2f} m/s along x a disturbance of {finding['motion']}"
        f" receives {finding['power_w']:.3g} W; check signs and sizes of the off-diagonal and lift"
        " coefficients"
    )


# Vehicle: values that cannot be meant.

_HOW_TO_GIVE = {
    "rpm": "in rpm: rev/s times 60",
    "us": "in us from neutral: 1900 us about 1500 us are 400",
    "N": "in N",
    "rad": "in rad: 20 degrees are 0.349",
}


def _limit_of_command(finding: Finding) -> str:
    unit = finding["unit"]
    return (
        f"{finding.subject}: maximum_{finding['side']} = {finding['limit']:g} is outside the"
        f" {finding['least']:g} to {finding['most']:g} {unit} of any such actuator; give it"
        f" {_HOW_TO_GIVE[unit]}"
    )


def _drag_twice(finding: Finding) -> str:
    included = finding["included"]
    both = listed(included)
    describes = "it describes" if len(included) == 1 else "they describe"
    return (
        f"{listed((finding.subject, *included))} are not zero: the strips of {finding.subject} already"
        f" include {both}; set {both} to 0, unless {describes} an appendage"
    )


def _outside_hull(finding: Finding) -> str:
    position = ", ".join(f"{x:g}" for x in finding["position_m"])
    return f"{finding.subject} at [{position}] m lies far outside the hull; are the positions in m?"


def _advised(finding: Finding) -> str:
    rows = ", ".join(f'"{row}"' for row in finding["advised"])
    return f"give controllable = [{rows}]"


def _rows_not_commanded(finding: Finding) -> str:
    several = "," in finding.subject
    return (
        f"{finding.subject} {'count' if several else 'counts'} as controllable (every row does in a file"
        f" without this key), and the actuators cannot command {'them' if several else 'it'} independently of"
        f" the others; {_advised(finding)}, or correct positions and directions"
    )


def _rows_do_not_steer(finding: Finding) -> str:
    return (
        f"controllable = [{finding.subject}] lets no autopilot steer, which needs X, N and Z or M; its"
        f" actuators can command them: {_advised(finding)}"
    )


WORDS: dict[str, str | Callable[[Finding], str]] = {
    # Vehicle: at rest, speeds, turns.
    "buoyancy": _buoyancy,
    "natural periods": _periods,
    "not stable at rest": _not_stable_at_rest,
    "net buoyancy": _net_buoyancy,
    "speed too high": "Speed: {kn:g} kn is more than its top speed of {top_kn:.1f} kn",
    "speed too low": "Speed: {kn:g} kn is less than the slowest that its motors hold",
    "no driver": "Speed: no actuator drives ahead",
    "no steady speed": "Speed: {sentence}",
    "top speed": "Top speed: {m_s:.2f} m/s ({kn:.1f} kn) at {command:.4g} {unit}",
    "endurance": (
        "Endurance: {top_h:.2g} h at top speed; farthest at {m_s:.2f} m/s: {endurance_h:.2g} h,"
        " {range_km:.0f} km"
    ),
    "no battery": "Endurance: not known without [power]: hotel_w and battery_wh",
    "no power": _no_power,
    "no turn": "Turn: not computed; no two actuators that drive ahead lie on opposite sides",
    "turns never steady": "Turn: {count} of the turns tried never become steady and are left out",
    "turn under way": _turn_under_way,
    "turn on the spot": _turn_on_the_spot,
    "fin turn": _fin_turn,
    "fin turn never steady": "Turn by {subject}: it never becomes steady",
    "rows commanded": _rows_commanded,
    "rows left out": "The actuators can also command {subject}; controllable leaves it out",
    "thrust table exceeded": "{sentence}",
    # Vehicle: stability.
    "plane stable": _stable,
    "plane unstable and held": _unstable_and_held,
    "plane stable up to": (
        "{subject} rights itself up to {m_s:.2f} m/s, and no actuator holds it above: plan missions at"
        " {safe_m_s:.2f} m/s or slower, or raise the buoyancy over the weight (z_b)"
    ),
    "plane unstable": _unstable,
    "plane unstable astern": _unstable_astern,
    "energy added": _energy_added,
    # Vehicle: values that cannot be meant.
    "density": (
        "rho_kg_m3 = {rho_kg_m3:g} is not the density of water, which is 1000 in a lake and 1025 in the sea;"
        " is it in kg/m3?"
    ),
    "mass above displaced": (
        "m = {m_kg:g} kg is more than the {displaced_kg:.4g} kg of water in a box of the hull's measures; are"
        " the mass in kg and the measures in m?"
    ),
    "mass far below displaced": (
        "m = {m_kg:g} kg is only {percent:.2g} % of the {displaced_kg:.4g} kg of water in a box of the hull's"
        " measures; are the mass in kg and the measures in m?"
    ),
    "inertia": (
        "{subject} = {kg_m2:.4g} kg m2 is {ratio:.2g} times that of a solid box of the hull's measures; is it"
        " in kg m2 and about O?"
    ),
    "inertia above sum": (
        "{subject} = {kg_m2:.4g} kg m2 is more than {others} = {sum_kg_m2:.4g} kg m2, which no body has;"
        " correct the moments of inertia"
    ),
    "positive damping": (
        "{subject} = {value:+.4g} is positive: it drives the vehicle on. Damping derivatives are negative"
        " (force on the vehicle)"
    ),
    "added mass": (
        "{subject} = {value:+.4g} against {own:.4g} of the vehicle itself; added-mass derivatives are"
        " negative and rarely above ten times its own"
    ),
    "least speed above largest": (
        "minimum_{side} = {least:g} above maximum_{side} = {most:g} of {subject}: no command lies between;"
        " correct the motor"
    ),
    "limit of command": _limit_of_command,
    "lag": "{subject}: lag or dead time of {lag_s:g} s is longer than any; give it in s",
    "servo rate": (
        "{subject}: n_acc_per_s = {rate:g} rad/s is faster than any servo; give it in rad/s: {rate:g} deg/s"
        " are {if_degrees:.2g}"
    ),
    "fin area": (
        "{subject}: area_m2 = {area_m2:g} is more than half of the hull seen from the side; give it in m2"
    ),
    "thrust above weight": (
        "{subject}: pushes with {force_n:.3g} N, {ratio:.2g} times the weight of the vehicle; check unit and"
        " size of its characteristic"
    ),
    "thrust grows with inflow": (
        "p2 (alpha2) of {subject} is positive: the thrust would grow with the inflow; it is negative"
    ),
    "cross-flow drag twice": _drag_twice,
    "tether without effect": (
        "the tether has no effect: A_tether and k_tether are 0; give the drag area A_tether in m2 (drag"
        " coefficient times diameter times the length that is dragged along), or free it in a stage"
    ),
    "actuator outside hull": _outside_hull,
    "centre outside hull": (
        "the centre of {subject} lies outside the hull; are x_{letter}, y_{letter}, z_{letter} in m?"
    ),
    "row listed twice": "controllable lists {subject} {count} times; name each row once",
    "rows not commanded": _rows_not_commanded,
    "rows do not steer": _rows_do_not_steer,
}
