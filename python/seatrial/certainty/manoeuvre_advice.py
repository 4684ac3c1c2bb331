"""Sentences about what the data cannot tell, and the manoeuvre or measurement that would tell it.

What `seatrial.certainty.identifiability` finds as numbers is said here in words, by physics alone: from the
coefficients' names (`seatrial.certainty.excitation`), for any vehicle.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from seatrial.certainty.excitation import (
    BOTH_WAYS,
    FORCES,
    INCLINE,
    VELOCITIES,
    WEIGH,
    Role,
    axis,
    manoeuvre,
    role,
)

_SWING = "swing the vehicle in air (bifilar pendulum) for"
_VERBS = ("surges", "sways", "heaves", "rolls", "pitches", "yaws")
# What a bench, scales or a tape measure gives without a trial, the surest first.
_BENCH = ("mass", "inertia", "lever", "thrust", "buoyancy", "gravity", "buoyancy centre", "inflow")


def anchor(names: Sequence[str]) -> str | None:
    """Member of a combination that a bench, scales or a tape measure gives; None where none does.

    Examples
    --------
    >>> anchor(["M_qdot", "I_y"])
    'I_y'
    """
    kinds = {role(name).kind: name for name in reversed(names)}
    return next((kinds[kind] for kind in _BENCH if kind in kinds), None)


def unexcited(
    names: Sequence[str], *, moving: Collection[str], silent: Collection[str], seen: Collection[str]
) -> dict[tuple[str, ...], str]:
    """Sentences, by names, about coefficients that the data would not show even if all others were known.

    Parameters
    ----------
    names : sequence of str
    moving : collection of str
        Velocities among u v w p q r that move in the trials.
    silent : collection of str
        Those of the names that change no channel at all.
    seen : collection of str
        Coefficients that the data do show.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for name in names:
        one = role(name)
        groups.setdefault((_why(one, moving, name in silent), manoeuvre(one)), []).append(name)
    return {
        tuple(members): f"{join(members)}: {why} {what}{_cross_flow(members, seen)}"
        for (why, what), members in groups.items()
    }


def absorbed(names: Sequence[str], nuisance: str) -> str:
    """Sentence about coefficients that a nuisance parameter of a trial hides.

    Examples
    --------
    >>> absorbed(["T_t"], "turn: latency_r")
    "T_t: not to be told from latency_r of turn; add sharp steps, or measure the channel's latency on the
    bench"
    """
    trial, _, what = nuisance.rpartition(": ")
    remedy = {
        "current": "run the same leg in opposite directions, or a full circle",
        "tilt": "record a minute at rest in trim",
        "lever": "measure the sensor's place with a tape",
        "latency": "add sharp steps, or measure the channel's latency on the bench",
        "bias": "record a minute at rest, or calibrate the sensor",
    }.get(what.partition("_")[0], f"take {what} from another source")
    return f"{join(names)}: not to be told from {what}{f' of {trial}' if trial else ''}; {remedy}"


def scaled(names: Sequence[str], factor_sd: float) -> str:
    """Sentence about coefficients that scale together: the homogeneous direction.

    Parameters
    ----------
    names : sequence of str
    factor_sd : float
        Standard deviation of their common factor.
    """
    only = "the motion fixes only their ratios"
    if factor_sd < 1.0:
        only += f" (the common factor to {_percent(factor_sd)} at best, through what is held fixed)"
    if any(role(name).actuator for name in names):
        how = "thrust scale comes from a bench (bollard) test only; until then fix one of them"
    else:
        how = f"the absolute scale comes from a known weight: {INCLINE}"
    return f"all of {', '.join(names)} scale together, {only}: {how}"


def inseparable(names: Sequence[str]) -> str:
    """Sentence about coefficients of which the data show only a combination, and what would separate them.

    Examples
    --------
    >>> inseparable(["X_u", "X_uu"])
    'X_u and X_uu: surge speed varies too little to tell them apart; run a staircase of speeds, slow to fast,
    ahead and astern, with a coast-down after each step'
    """
    roles = [role(name) for name in names]
    for rule in _RULES:
        if told := rule(roles):
            return f"{join(names)}: {told[0]}; {told[1]}"
    return f"{join(names)}: only a combination of them acts on this data; {_ways(roles)}"


def join(names: Sequence[str]) -> str:
    """Names as in a sentence: a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def _why(one: Role, moving: Collection[str], silent: bool) -> str:
    still = dict.fromkeys(v for v in one.velocities if v not in moving)
    if still:
        return f"nothing {join([_VERBS[VELOCITIES.index(v)] for v in still])} in these trials;"
    if not silent:
        return "excited too weakly; do more of it, longer or larger:"
    if one.force:
        letters = dict.fromkeys(one.force)
        words, keys = join([axis(f) for f in letters]), join(list(letters))
        return f"not excited, no trial lets the vehicle answer in {words}; free {keys} and"
    return "these trials do not run it;" if one.kind == "thrust" else "not excited;"


def _cross_flow(members: Collection[str], seen: Collection[str]) -> str:
    """Strip theory: one drag coefficient makes Y_vv and, times C_Dr, N_rr (Taubert et al. 2014, 27 to 30)."""
    for force, moment, product in (("Y_vv", "N_rr", "C_Dy C_Dr"), ("Z_ww", "M_qq", "C_Dz C_Dq")):
        if force in members and moment in seen:
            return f" (of the cross-flow drag only the product {product} shows, as {moment})"
    return ""


def _percent(part: float) -> str:
    return f"{100.0 * part:.2g} %"


_Told = tuple[str, str] | None


def _inertia(roles: Sequence[Role]) -> _Told:
    """Rigid body and added mass: M_RB + M_A acts, and C(nu) is made of the same sums."""
    added = [one for one in roles if one.kind == "added mass"]
    rigid = [one for one in roles if one.kind in ("mass", "inertia")]
    weight = [one for one in roles if one.kind == "buoyancy"]
    if not added or len(added) + len(rigid) + len(weight) < len(roles):
        return None
    if not rigid and len({one.force for one in added}) == 1:
        return "their accelerations keep one proportion", _ways(added)
    sums = [f"{a.name} {_sign(a)} {b.name}" for a in rigid for b in added if _same_entry(a, b)]
    if not sums:
        return None
    sums += ["the net weight m g - B" for one in rigid if weight and one.kind == "mass"]
    ways = [WEIGH if one.kind == "mass" else f"{_SWING} {one.name}" for one in rigid]
    only = f"only their sum {sums[0]} acts" if len(sums) == 1 else f"only {join(sums)} act"
    return f"{only} on this data", "; ".join(ways)


def _same_entry(rigid: Role, added: Role) -> bool:
    """Whether both stand in one entry of the mass matrix."""
    row, column = FORCES.index(added.force), VELOCITIES.index(added.velocities)
    if rigid.kind == "mass":
        return row == column < 3
    axes = sorted(FORCES.index(letter) for letter in rigid.force)
    return sorted((row, column)) == (axes * 2 if len(axes) == 1 else axes)


def _sign(rigid: Role) -> str:
    """M_A is minus the derivatives; products of inertia enter I_O with a minus too."""
    return "+" if len(rigid.force) == 2 else "-"


def _munk(roles: Sequence[Role]) -> _Told:
    """Lift and the Munk moment of added mass are the same product of velocities under way."""
    names = {one.name for one in roles}
    for lift, masses, total in (
        ("N_uv", {"X_udot", "Y_vdot"}, "N_uv + Y_vdot - X_udot"),
        ("M_uw", {"X_udot", "Z_wdot"}, "M_uw + X_udot - Z_wdot"),
    ):
        if lift in names and names - {lift} and names <= masses | {lift}:
            added = [one for one in roles if one.name != lift]
            return f"only the sum of lift and Munk moment, {total}, acts on this data", _ways(added)
    return None


def _static(roles: Sequence[Role]) -> _Told:
    kinds = {one.kind for one in roles}
    if not kinds <= {"mass", "buoyancy", "gravity", "buoyancy centre", "bias"}:
        return None
    if kinds == {"mass", "buoyancy"}:
        return "only the net weight m g - B acts on this data", f"{WEIGH}, and in the water for B"
    if "bias" in kinds:
        return "they act alike at the attitudes of these trials", f"pitch and roll further, or {INCLINE}"
    return "only their common moment of weight and buoyancy acts on this data", INCLINE


def _actuators(roles: Sequence[Role]) -> _Told:
    kinds, who = {one.kind for one in roles}, sorted({one.actuator for one in roles})
    if not all(who):
        return None
    if len(who) > 1:
        return "they push in one proportion in these trials", f"run steps of each of {join(who)} alone"
    if kinds == {"motor"}:
        return "lag, dead time and rate limits look alike in these trials", manoeuvre(roles[0])
    if "lever" in kinds:
        return "only their product acts on this data", f"measure the lever of {who[0]} with a tape"
    if any(one.part == "K_V" for one in roles):
        return "only the thrust that results acts on this data", f"log the revolutions of {who[0]}"
    if "inflow" in kinds:
        way = f"take p1 of {who[0]} from a bench (bollard) test and {manoeuvre(roles[0])}"
        return "revolutions and speed through the water keep one proportion", way
    return "only their product acts on this data", "free one of them and take the others from the bench test"


def _thrust_and_hull(roles: Sequence[Role]) -> _Told:
    thrust = [one for one in roles if one.actuator]
    hull = [one for one in roles if not one.actuator]
    if not thrust or not hull:
        return None
    who = join(sorted({one.actuator for one in thrust}))
    way = f"do a bench (bollard) test of {who}, or {manoeuvre(hull[0])}"
    return "only the ratio of thrust to the hull's force acts on this data", way


def _one_force(roles: Sequence[Role]) -> _Told:
    """Derivatives of one force: one must vary without the other."""
    hull = {"added mass", "linear", "quadratic", "lift", "bias"}
    if len({one.force for one in roles}) > 1 or not {one.kind for one in roles} <= hull:
        return None
    kinds = {one.kind for one in roles}
    rates = sorted({one.rates for one in roles if one.rates})
    if "bias" in kinds:
        return "a constant force and drag look alike in one direction of motion", BOTH_WAYS
    if len(rates) > 1:
        return f"{join(rates)} move in one proportion in these trials", _ways(roles)
    if "added mass" in kinds:
        moved = [one for one in roles if one.kind == "added mass"]
        return "too little acceleration to tell inertia from drag", _ways(moved)
    lifts = [one for one in roles if one.kind == "lift"]
    if lifts:
        way = f"{manoeuvre(lifts[0])}, and the same without way"
        return "forward speed varies too little to tell them apart", way
    return f"{axis(rates[0])} speed varies too little to tell them apart", _ways(roles)


_RULES: tuple[Callable[[Sequence[Role]], _Told], ...]
_RULES = (_inertia, _munk, _static, _actuators, _thrust_and_hull, _one_force)


def _ways(roles: Sequence[Role]) -> str:
    return "; ".join(dict.fromkeys(manoeuvre(one) for one in roles))
