"""Advice on coefficients in words: what tells them, what hides them, which act only together.

The sums are those of the equations of motion: M_RB + M_A and C(nu) are made of the same entries, and so are
lift and Munk moment (Fossen 2021, chapter 6). Held by ``tests/diagnosis/test_manoeuvre_advice.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from seatrial.base.channels import AXES, MOTIONS, VELOCITIES
from seatrial.base.report import listed
from seatrial.diagnosis.roles import Manoeuvre, Role, Unexcited, manoeuvre, role
from seatrial.problem.settings import STRIPS
from seatrial.report.results.phrases import Formats, filled, templates

_INCLINE = "do an inclining test (shift or hang on a known ballast and record the angle at rest)"

_WEIGH = "weigh the vehicle in air, with the water of its free-flooding spaces, for m"

_BOTH_WAYS = "run the same straight legs in opposite directions, and lie at rest"

_WITH_TETHER = "turn and run straight at two speeds or more with the tether paid out, and without it"

_TAUT = "pull the tether taut and let the vehicle come back"


def imperative(way: Manoeuvre) -> str:
    """A manoeuvre or measurement as an imperative.

    Examples
    --------
    >>> imperative(manoeuvre(role("Z_uw")))
    'dive with the vertical thrusters under way, at two forward speeds or more'
    >>> imperative(manoeuvre(role("Z_uw", pushed="X")))
    'dive by the planes at two forward speeds or more'
    """
    words = templates("coefficient_advice")
    if way.part == "unpushed":
        return words[f"unpushed {way.kind}"][way.of]
    if (known := words.get(way.kind, {}).get(way.of)) is not None:
        return known
    formats: Formats = {"axis": _axis, "tether": lambda name: _WITH_TETHER if name == "A_tether" else _TAUT}
    return filled(words["way"][way.kind], {"of": way.of, "part": way.part}, formats)


def of_role(role: Role) -> str:
    """What tells a coefficient, as an imperative."""
    return imperative(manoeuvre(role))


def _axis(letter: str) -> str:
    """Word for the axis of a force or velocity letter."""
    return MOTIONS[letter if letter in AXES else AXES[VELOCITIES.index(letter)]]


_VERBS = ("surges", "sways", "heaves", "rolls", "pitches", "yaws")

Clauses = tuple[str, str]
"""The problem, and what to do about it."""


def unexcited(group: Unexcited) -> Clauses:
    """Coefficients that the data would not show even if all others were known."""
    letters, names = list(group.letters), listed(group.names)
    way = imperative(group.manoeuvre)
    if group.product:
        product = "C_Dy C_Dr" if group.product == "N_rr" else "C_Dz C_Dq"
        way += f" (of the cross-flow drag only the product {product} shows, as {group.product})"
    if group.why == "still":
        moved = listed([_VERBS[VELOCITIES.index(letter)] for letter in letters])
        return f"{names}: nothing {moved} in these trials", way
    if group.why == "weak":
        return f"{names}: excited too weakly", f"at larger amplitude or for longer, {way}"
    if group.why == "locked":
        axes = listed([_axis(letter) for letter in letters])
        problem = f"{names}: not excited: no trial leaves the vehicle free to move in {axes}"
        return problem, f"free {listed(letters)} and {way}"
    return f"{names}: {'these trials do not run it' if group.why == 'idle' else 'not excited'}", way


def absorbed(names: Sequence[str], nuisance: str) -> Clauses:
    """Coefficients that a nuisance parameter of a trial hides.

    Examples
    --------
    >>> absorbed(["T_t"], "turn: latency_r")[0]
    'T_t: cannot be separated from latency_r of turn'
    """
    trial, _, what = nuisance.rpartition(": ")
    other = f"take {what} from another source"
    remedy = templates("coefficient_advice")["parted"].get(what.partition("_")[0], other)
    return f"{listed(names)}: cannot be separated from {what}{f' of {trial}' if trial else ''}", remedy


def strayed(name: str, value: str, *, away: float, prior: str) -> Clauses:
    """A nuisance parameter that ended far from its prior.

    ``name`` is that of the joint estimate: the trials, a colon and the parameter, or the parameter alone for
    all; ``value`` and ``prior`` have their units, ``away`` is the distance in standard deviations of it.

    Examples
    --------
    >>> strayed("turn: lever_x", "1.2 m", away=4.0, prior="0 ± 0.3 m")[0]
    'lever_x of trial turn is 1.2 m, 4 standard deviations from its prior (0 ± 0.3 m)'
    """
    trial, _, what = name.rpartition(": ")
    check = templates("coefficient_advice")["strayed"].get(what.partition("_")[0], f"check {what}")
    where = f"trial{'s' if ', ' in trial else ''} {trial}" if trial else "all trials"
    return (
        f"{what} of {where} is {value}, {away:.2g} standard deviations from its prior ({prior})",
        f"{check}; if the value is real, raise its standard deviation under [polish.nuisances]",
    )


def scaled(names: Sequence[str], factor_sd: float, *, fins: Collection[str] = ()) -> Clauses:
    """Coefficients that scale together by a factor of this standard deviation: the homogeneous direction."""
    only = "the motion fixes only their ratios"
    if factor_sd < 1.0:
        percent = f"{100.0 * factor_sd:.2g} %"
        only += f" (the common factor to {percent} at best, through what is held fixed)"
    driven = [driver for driver in (role(name, fins=fins) for name in names) if driver.actuator]
    if driven and all(driver.of_fin for driver in driven):
        how = "take the fin's lift from its area and lift slope, or hold one of them"
    elif driven:
        how = "measure the thrust on a bench (bollard test), give an [anchor], or hold one of them"
    else:
        how = f"the absolute scale comes from a known weight: {_INCLINE}"
    return f"all of {', '.join(names)} scale together, {only}", how


def inseparable(names: Sequence[str], *, pushed: str = AXES, fins: Collection[str] = ()) -> Clauses:
    """Coefficients of which the data show only a combination, and what would separate them.

    Examples
    --------
    >>> inseparable(["X_u", "X_uu"])[0]
    'X_u and X_uu: surge speed varies too little to tell them apart'
    """
    roles = [role(name, pushed=pushed, fins=fins) for name in names]
    for rule in _RULES:
        if advice := rule(roles):
            return f"{listed(names)}: {advice[0]}", advice[1]
    return f"{listed(names)}: only a combination of them acts on this data", _ways(roles)


def _inertia(roles: Sequence[Role]) -> Clauses | None:
    """Rigid body and added mass: M_RB + M_A acts, and C(nu) is made of the same sums."""
    added = [role for role in roles if role.kind == "added mass"]
    rigid = [role for role in roles if role.kind in ("mass", "inertia")]
    weight = [role for role in roles if role.kind == "buoyancy"]
    if not added or len(added) + len(rigid) + len(weight) < len(roles):
        return None
    if not rigid and len({role.force for role in added}) == 1:
        return "their accelerations keep one proportion", _ways(added)
    # M_A is minus the derivatives; products of inertia enter I_O with a minus too.
    signs = {role.name: "+" if len(role.force) == 2 else "-" for role in rigid}
    sums = [f"{a.name} {signs[a.name]} {b.name}" for a in rigid for b in added if _same_entry(a, b)]
    if not sums:
        return None
    sums += ["the net weight m g - B" for role in rigid if weight and role.kind == "mass"]
    ways = [
        _WEIGH if role.kind == "mass" else f"swing the vehicle in air (bifilar pendulum) for {role.name}"
        for role in rigid
    ]
    only = f"only their sum {sums[0]} acts" if len(sums) == 1 else f"only {listed(sums)} act"
    return f"{only} on this data", "; ".join(ways)


def _same_entry(rigid: Role, added: Role) -> bool:
    """Whether both stand in one entry of the mass matrix."""
    row, column = AXES.index(added.force), VELOCITIES.index(added.velocities)
    if rigid.kind == "mass":
        return row == column < 3
    axes = sorted(AXES.index(letter) for letter in rigid.force)
    return sorted((row, column)) == (axes * 2 if len(axes) == 1 else axes)


def _munk(roles: Sequence[Role]) -> Clauses | None:
    """Lift and the Munk moment of added mass are the same product of velocities under way."""
    names = {role.name for role in roles}
    for lift, masses, total in (
        ("N_uv", {"X_udot", "Y_vdot"}, "N_uv + Y_vdot - X_udot"),
        ("M_uw", {"X_udot", "Z_wdot"}, "M_uw + X_udot - Z_wdot"),
    ):
        if lift in names and names - {lift} and names <= masses | {lift}:
            added = [role for role in roles if role.name != lift]
            return f"only the sum of lift and Munk moment, {total}, acts on this data", _ways(added)
    return None


def _static(roles: Sequence[Role]) -> Clauses | None:
    kinds = {role.kind for role in roles}
    if not kinds <= {"mass", "buoyancy", "gravity", "buoyancy centre", "bias"}:
        return None
    if kinds == {"mass", "buoyancy"}:
        return "only the net weight m g - B acts on this data", f"{_WEIGH}, and in the water for B"
    if "bias" in kinds:
        return "they act alike at the attitudes of these trials", f"pitch and roll further, or {_INCLINE}"
    return "only their common moment of weight and buoyancy acts on this data", _INCLINE


def _actuators(roles: Sequence[Role]) -> Clauses | None:
    kinds, who = {role.kind for role in roles}, sorted({role.actuator for role in roles})
    if not all(who):
        return None
    if all(role.of_fin for role in roles):
        if len(who) > 1:
            return (
                "they deflect in one proportion in these trials",
                f"run steps of each of {listed(who)} alone",
            )
        if kinds == {"motor"}:
            return "lag, dead time and rate limits look alike in these trials", of_role(roles[0])
        return "only the force that results acts on this data", of_role(roles[0])
    if len(who) > 1:
        return "they push in one proportion in these trials", f"run steps of each of {listed(who)} alone"
    if kinds == {"motor"}:
        return "lag, dead time and rate limits look alike in these trials", of_role(roles[0])
    if "lever" in kinds:
        return "only their product acts on this data", f"measure the lever of {who[0]} with a tape"
    if any(role.part == "K_V" for role in roles):
        return "only the thrust that results acts on this data", f"log the revolutions of {who[0]}"
    if "inflow" in kinds:
        way = f"take p1 of {who[0]} from a bench (bollard) test and {of_role(roles[0])}"
        return "revolutions and speed through the water keep one proportion", way
    return "only their product acts on this data", "free one of them and take the others from the bench test"


def _thrust_and_hull(roles: Sequence[Role]) -> Clauses | None:
    thrust = [role for role in roles if role.actuator]
    hull = [role for role in roles if not role.actuator]
    if not thrust or not hull:
        return None
    who = listed(sorted({role.actuator for role in thrust}))
    if all(role.of_fin for role in thrust):
        way = f"take the lift slope of {who} from its shape, or {of_role(hull[0])}"
        return "only the ratio of the fin's lift to the hull's force acts on this data", way
    way = f"do a bench (bollard) test of {who}, or {of_role(hull[0])}"
    return "only the ratio of thrust to the hull's force acts on this data", way


def _strips(roles: Sequence[Role]) -> Clauses | None:
    """Strips of the hull are quadratic damping of both axes of their plane already."""
    names = {role.name for role in roles}
    for name, made in STRIPS.items():
        if name in names and names & set(made) and names <= {name, *made}:
            return strips_twice(name, made)
    return None


def strips_twice(name: str, made: Sequence[str]) -> Clauses:
    """What is wrong with strips and quadratic damping that are both free, and what to do."""
    return (
        f"the strips of {name} make {listed(made)} already, both must not be free",
        f"hold {listed(made)} at 0, or leave {name} out",
    )


def _one_force(roles: Sequence[Role]) -> Clauses | None:
    """Derivatives of one force: one must vary without the other."""
    hull = {"added mass", "linear", "quadratic", "lift", "bias"}
    if len({role.force for role in roles}) > 1 or not {role.kind for role in roles} <= hull:
        return None
    kinds = {role.kind for role in roles}
    rates = sorted({role.rates for role in roles if role.rates})
    if "bias" in kinds:
        return "a constant force and drag look alike in one direction of motion", _BOTH_WAYS
    if len(rates) > 1:
        return f"{listed(rates)} move in one proportion in these trials", _ways(roles)
    if "added mass" in kinds:
        moved = [role for role in roles if role.kind == "added mass"]
        return "too little acceleration to tell inertia from drag", _ways(moved)
    lifts = [role for role in roles if role.kind == "lift"]
    if lifts:
        way = of_role(lifts[0])
        if lifts[0].force in lifts[0].pushed:
            way += ", and the same without way"
        return "forward speed varies too little to tell them apart", way
    return f"{_axis(rates[0])} speed varies too little to tell them apart", _ways(roles)


_RULES: tuple[Callable[[Sequence[Role]], Clauses | None], ...]

_RULES = (_inertia, _strips, _munk, _static, _actuators, _thrust_and_hull, _one_force)


def _ways(roles: Sequence[Role]) -> str:
    return "; ".join(dict.fromkeys(of_role(role) for role in roles))
