"""Which motion excites which coefficient: what its name says, and the manoeuvre that makes it act.

A name says which force the coefficient makes and what must move for that force to act: ``N_uv`` is a yaw
moment that needs forward and sideways speed, ``K_pdot`` a roll moment that needs roll acceleration,
``stern.p1_astern`` a thrust that needs revolutions astern. Names behind a dot are parts of an actuator, or
of a group of actuators as campaigns free them. The manoeuvres are those of sea trials (ITTC 7.5-04-02-01,
full-scale manoeuvring trials) and of the tank: free decay, bollard pull, inclining test.

From the names alone, for any vehicle, follow the sentences about what the data cannot tell
(`seatrial.diagnosis.identifiability`) and the manoeuvre or measurement that would tell it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

from seatrial.base.channels import AXES, MOTIONS, VELOCITIES
from seatrial.base.report import listed
from seatrial.problem.parameter import STRIPS, axes_of

ROLL_DECAY = "record a free decay in roll (heel the vehicle by hand by 20 to 30 deg, motors stopped, let go)"

PITCH_DECAY = "record a free decay in pitch (trim it by hand by 10 to 20 deg, motors stopped, let go)"

INCLINE = "do an inclining test (shift or hang on a known ballast and record the angle at rest)"

WEIGH = "weigh the vehicle in air, with the water of its free-flooding spaces, for m"

BOTH_WAYS = "run the same straight legs in opposite directions, and lie at rest"

_PARTS = {
    "gain": "thrust",
    "p1_ahead": "thrust",
    "p1_astern": "thrust",
    "p2": "inflow",
    "w": "inflow",
    "t": "inflow",
    "q1": "torque",
    "q2": "torque",
    "K_V": "motor",
    "T_1": "motor",
    "T_t": "motor",
    "n_acc": "motor",
    "n_dec": "motor",
    "lever_K": "lever",
    "lever_M": "lever",
    "lever_N": "lever",
    "astern_ratio": "ratio",
    "loss": "wash",
    "C_La": "fin",
    "C_Lmax": "fin",
    "C_D0": "fin",
    "C_D90": "fin",
}

_DERIVATIVES = (
    (re.compile(r"([XYZKMN])_([uvwpqr])dot"), "added mass"),
    (re.compile(r"([XYZKMN])_([uvwpqr])"), "linear"),
    (re.compile(r"([XYZKMN])_([uvwpqr])\2"), "quadratic"),
    (re.compile(r"([YZMN])_(u[vwqr])"), "lift"),
    (re.compile(r"([XYZKMN])_()0"), "bias"),
)

_DAMPING = {
    "u": "run a staircase of speeds, slow to fast, ahead and astern, with a coast-down after each step",
    "v": "push the vehicle sideways at several levels, or run turning circles and zigzags with sway free",
    "w": "dive and rise with the vertical thrusters at several levels, and let it rise or sink freely",
    "p": ROLL_DECAY,
    "q": f"run pitch dives with several trim moments, or {PITCH_DECAY}",
    "r": "run turning circles to both sides at several rates of turn, some on the spot",
}

# Where no thruster pushes along the axis (a torpedo's rudder and planes do it under way).
_WITHOUT_THRUST = {
    ("damping", "v"): ("Y", "run turning circles and zigzags with sway free"),
    ("damping", "w"): ("Z", "dive and rise by the planes at several speeds, and let it rise or sink freely"),
    ("damping", "r"): ("N", "run turning circles to both sides at several rates of turn"),
    ("acceleration", "v"): ("Y", "run zigzags with quick reversals and sway free"),
    ("acceleration", "w"): ("Z", "run quick steps of the planes under way"),
    ("acceleration", "r"): ("N", "run zigzags with quick reversals of the rudder"),
    ("lift", "w"): ("Z", "dive by the planes at two forward speeds or more"),
}

_ACCELERATION = {
    "u": "run steps of thrust from rest, reversals and coast-downs",
    "v": "run steps or a multisine of side force with sway free",
    "w": "run steps or a multisine of vertical thrust",
    "p": ROLL_DECAY,
    "q": f"run pitch doublets, or {PITCH_DECAY}",
    "r": "run zigzags with quick reversals, or a multisine of yaw moment",
}

_LIFT = {
    "v": "run turning circles and zigzags with sway free at two forward speeds or more",
    "w": "dive with the vertical thrusters under way, at two forward speeds or more",
    "q": "run pitch doublets under way, at two forward speeds or more",
    "r": "run zigzags with quick reversals and turning circles at two forward speeds or more",
}

_STATIC = {
    "mass": WEIGH,
    "buoyancy": "let it rise or sink freely, or weigh it in the water with a known ballast",
    "gravity": INCLINE,
    "buoyancy centre": INCLINE,
    "bias": BOTH_WAYS,
}


@dataclass(frozen=True)
class Role:
    """What a coefficient is: ``kind``, ``force`` letters that it makes, ``velocities`` that must move.

    ``kind`` is mass, inertia, added mass, gravity (its centre), buoyancy, buoyancy centre, linear, quadratic,
    strips (cross-flow), lift, bias, thrust, inflow, torque, motor, lever, ratio, wash, fin or other; ``part``
    is the name behind the ``actuator``, which is a fin where `of_fin`. ``pushed`` are the axes that thrusters
    push directly.
    """

    name: str
    kind: str
    force: str = ""
    velocities: str = ""
    actuator: str = ""
    part: str = ""
    of_fin: bool = False
    pushed: str = AXES

    @property
    def rates(self) -> str:
        """Velocities whose magnitude the force follows: of a lift ``u`` only multiplies, and is left out."""
        return self.velocities[1:] if self.kind == "lift" else self.velocities


def role(name: str, *, pushed: str = AXES, fins: Collection[str] = ()) -> Role:
    """Role of a coefficient or of a campaign's parameter, from its name.

    Parameters
    ----------
    name : str
    pushed : str
        Letters of the axes that the vehicle's thrusters push directly.
    fins : collection of str
        Its fins and groups of fins.

    Examples
    --------
    >>> role("N_uv").kind, role("N_uv").force, role("N_uv").velocities
    ('lift', 'N', 'uv')
    >>> role("stern.gain").kind, role("stern.gain").actuator
    ('thrust', 'stern')
    """
    return replace(_role(name, fins), pushed=pushed)


def _role(name: str, fins: Collection[str]) -> Role:
    actuator, _, part = name.rpartition(".")
    if actuator:
        kind = "thrust" if re.fullmatch(r"a(0|1|11)_(ahead|astern)", part) else _PARTS.get(part, "other")
        force, of_fin = part[-1] if kind == "lever" else "", kind == "fin" or actuator in fins
        return Role(name, kind, force=force, actuator=actuator, part=part, of_fin=of_fin)
    if name in ("m", "B"):
        return Role(name, "mass" if name == "m" else "buoyancy")
    if match := re.fullmatch(r"I_([xyz])([xyz])?", name):
        axes = ["xyz".index(letter) + 3 for letter in match.groups() if letter]
        return Role(name, "inertia", "".join(AXES[i] for i in axes), "".join(VELOCITIES[i] for i in axes))
    if re.fullmatch(r"[xyz]_[gb]", name):
        return Role(name, "gravity" if name.endswith("g") else "buoyancy centre")
    if name in STRIPS:
        return Role(name, "strips", axes_of(name))
    for pattern, kind in _DERIVATIVES:
        if match := pattern.fullmatch(name):
            return Role(name, kind, match[1], match[2])
    return Role(name, "other")


def manoeuvre(role: Role) -> str:
    """Manoeuvre that excites a coefficient, as an imperative.

    Examples
    --------
    >>> manoeuvre(role("Z_uw"))
    'dive with the vertical thrusters under way, at two forward speeds or more'
    >>> manoeuvre(role("Z_uw", pushed="X"))
    'dive by the planes at two forward speeds or more'
    """
    if role.kind in ("linear", "quadratic"):
        return _without_thrust(role, "damping", role.velocities) or _DAMPING[role.velocities]
    if role.kind == "strips":
        velocity = VELOCITIES[AXES.index(role.force[1])]
        return _without_thrust(role, "damping", velocity) or _DAMPING[velocity]
    if role.kind == "lift":
        return _without_thrust(role, "lift", role.rates) or _LIFT[role.rates]
    if role.kind in ("added mass", "inertia"):
        velocity = role.velocities[0]
        return _without_thrust(role, "acceleration", velocity) or _ACCELERATION[velocity]
    if role.kind in _STATIC:
        return _STATIC[role.kind]
    who = role.actuator
    if role.of_fin and role.kind in ("fin", "thrust", "other"):
        return f"deflect {who} in steps over its range at two forward speeds or more"
    if role.of_fin and role.kind == "motor":
        return f"run steps of {who} with its angle logged, at 20 Hz or more"
    if role.of_fin and role.kind == "lever":
        return f"measure the lever of {who} with a tape"
    if role.kind == "thrust":
        _, _, side = role.part.partition("_")
        return f"run {who} {side or 'both ways'} in steps over its range, or on the bench (bollard test)"
    if role.kind == "ratio":
        return f"run {who} ahead and astern in the same steps"
    if role.kind == "wash":
        return f"run steps of {who} with the other groups at rest and at work"
    if role.kind == "inflow":
        return f"run steps of revolutions of {who} at several speeds through the water"
    if role.kind == "torque":
        return f"run steps of {who} alone with roll free, or measure its torque on the bench"
    if role.kind == "motor":
        return f"run steps of {who} with its revolutions logged, at 20 Hz or more"
    if role.kind == "lever":
        return f"run steps of {who} alone with {axis(role.force)} free, or measure the lever with a tape"
    return _TETHER.get(role.name, "add a trial in which it acts")


_TETHER = {
    "A_tether": "turn and run straight at two speeds or more with the tether paid out, and without it",
    "k_tether": "pull the tether taut and let the vehicle come back",
}


def _without_thrust(role: Role, kind: str, velocity: str) -> str | None:
    """Manoeuvre of a vehicle whose thrusters do not push along the axis of this motion; None if they do."""
    needed, remark = _WITHOUT_THRUST.get((kind, velocity), ("", ""))
    return remark if needed and needed not in role.pushed else None


def axis(letter: str) -> str:
    """Word for the axis of a force or velocity letter.

    Examples
    --------
    >>> axis("N"), axis("r")
    ('yaw', 'yaw')
    """
    return MOTIONS[letter if letter in AXES else AXES[VELOCITIES.index(letter)]]


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
    names: Sequence[str],
    *,
    moving: Collection[str],
    silent: Collection[str],
    seen: Collection[str],
    pushed: str = AXES,
    fins: Collection[str] = (),
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
    pushed, fins
        As for `role`.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for name in names:
        asked = role(name, pushed=pushed, fins=fins)
        groups.setdefault((_why(asked, moving, name in silent), manoeuvre(asked)), []).append(name)
    return {
        tuple(members): f"{listed(members)}: {why} {what}{_cross_flow(members, seen)}"
        for (why, what), members in groups.items()
    }


def absorbed(names: Sequence[str], nuisance: str) -> str:
    """Sentence about coefficients that a nuisance parameter of a trial hides.

    Examples
    --------
    >>> absorbed(["T_t"], "turn: latency_r")
    "T_t: cannot be separated from latency_r of turn; add sharp steps, or measure the channel's latency on the
    bench"
    """
    trial, _, what = nuisance.rpartition(": ")
    remedy = {
        "current": "run the same leg in opposite directions, or a full circle",
        "tilt": "record a minute at rest in trim",
        "lever": "measure the sensor's place with a tape",
        "latency": "add sharp steps, or measure the channel's latency on the bench",
        "bias": "record a minute at rest, or calibrate the sensor",
        "force": BOTH_WAYS,
    }.get(what.partition("_")[0], f"take {what} from another source")
    return f"{listed(names)}: cannot be separated from {what}{f' of {trial}' if trial else ''}; {remedy}"


def strayed(name: str, value: str, *, away: float, prior: str) -> str:
    """Sentence about a nuisance parameter that ended far from its prior.

    Parameters
    ----------
    name : str
        As the joint estimate names it: the trials, a colon and the parameter; the parameter alone for all.
    value, prior : str
        Estimate, and prior with its standard deviation, with their units.
    away : float
        Distance from the prior in its standard deviations.

    Examples
    --------
    >>> strayed("turn: lever_x", "1.2 m", away=4.0, prior="0 ± 0.3 m")
    'lever_x of trial turn is 1.2 m, 4 standard deviations from its prior (0 ± 0.3 m); measure the position of
    the sensor with a tape; if the value is real, raise its standard deviation under [polish.nuisances]'
    """
    trial, _, what = name.rpartition(": ")
    check = {
        "current": "compare the heading (declination, mounting) and the velocity with another source",
        "tilt": "check how the frame of the positions was levelled and how the sensor is mounted",
        "lever": "measure the position of the sensor with a tape",
        "latency": "compare the clock of this channel with that of the commands",
        "bias": "check the zero of this channel in a record at rest",
        "force": "look for what pushed in this trial (a tether, a trim weight, a bent fin)",
    }.get(what.partition("_")[0], f"check {what}")
    where = f"trial{'s' if ', ' in trial else ''} {trial}" if trial else "all trials"
    return (
        f"{what} of {where} is {value}, {away:.2g} standard deviations from its prior ({prior}); {check}; if"
        " the value is real, raise its standard deviation under [polish.nuisances]"
    )


def scaled(names: Sequence[str], factor_sd: float, *, fins: Collection[str] = ()) -> str:
    """Sentence about coefficients that scale together: the homogeneous direction.

    Parameters
    ----------
    names : sequence of str
    factor_sd : float
        Standard deviation of their common factor.
    fins : collection of str
        Names of the vehicle's fins and groups of fins.
    """
    only = "the motion fixes only their ratios"
    if factor_sd < 1.0:
        only += f" (the common factor to {_percent(factor_sd)} at best, through what is held fixed)"
    driven = [driver for driver in (role(name, fins=fins) for name in names) if driver.actuator]
    if driven and all(driver.of_fin for driver in driven):
        how = "take the fin's lift from its area and lift slope, or hold one of them"
    elif driven:
        how = "measure the thrust on a bench (bollard test), give an [anchor], or hold one of them"
    else:
        how = f"the absolute scale comes from a known weight: {INCLINE}"
    return f"all of {', '.join(names)} scale together, {only}; {how}"


def inseparable(names: Sequence[str], *, pushed: str = AXES, fins: Collection[str] = ()) -> str:
    """Sentence about coefficients of which the data show only a combination, and what would separate them.

    Examples
    --------
    >>> inseparable(["X_u", "X_uu"])
    'X_u and X_uu: surge speed varies too little to tell them apart; run a staircase of speeds, slow to fast,
    ahead and astern, with a coast-down after each step'
    """
    roles = [role(name, pushed=pushed, fins=fins) for name in names]
    for rule in _RULES:
        if advice := rule(roles):
            return f"{listed(names)}: {advice[0]}; {advice[1]}"
    return f"{listed(names)}: only a combination of them acts on this data; {_ways(roles)}"


def _why(role: Role, moving: Collection[str], silent: bool) -> str:
    still = dict.fromkeys(v for v in role.velocities if v not in moving)
    if still:
        return f"nothing {listed([_VERBS[VELOCITIES.index(v)] for v in still])} in these trials;"
    if not silent:
        return "excited too weakly; at larger amplitude or for longer,"
    if role.force:
        letters = dict.fromkeys(role.force)
        words, keys = listed([axis(f) for f in letters]), listed(list(letters))
        return f"not excited: no trial leaves the vehicle free to move in {words}; free {keys} and"
    return "these trials do not run it;" if role.kind == "thrust" else "not excited;"


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
    added = [role for role in roles if role.kind == "added mass"]
    rigid = [role for role in roles if role.kind in ("mass", "inertia")]
    weight = [role for role in roles if role.kind == "buoyancy"]
    if not added or len(added) + len(rigid) + len(weight) < len(roles):
        return None
    if not rigid and len({role.force for role in added}) == 1:
        return "their accelerations keep one proportion", _ways(added)
    sums = [f"{a.name} {_sign(a)} {b.name}" for a in rigid for b in added if _same_entry(a, b)]
    if not sums:
        return None
    sums += ["the net weight m g - B" for role in rigid if weight and role.kind == "mass"]
    ways = [WEIGH if role.kind == "mass" else f"{_SWING} {role.name}" for role in rigid]
    only = f"only their sum {sums[0]} acts" if len(sums) == 1 else f"only {listed(sums)} act"
    return f"{only} on this data", "; ".join(ways)


def _same_entry(rigid: Role, added: Role) -> bool:
    """Whether both stand in one entry of the mass matrix."""
    row, column = AXES.index(added.force), VELOCITIES.index(added.velocities)
    if rigid.kind == "mass":
        return row == column < 3
    axes = sorted(AXES.index(letter) for letter in rigid.force)
    return sorted((row, column)) == (axes * 2 if len(axes) == 1 else axes)


def _sign(rigid: Role) -> str:
    """M_A is minus the derivatives; products of inertia enter I_O with a minus too."""
    return "+" if len(rigid.force) == 2 else "-"


def _munk(roles: Sequence[Role]) -> _Told:
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


def _static(roles: Sequence[Role]) -> _Told:
    kinds = {role.kind for role in roles}
    if not kinds <= {"mass", "buoyancy", "gravity", "buoyancy centre", "bias"}:
        return None
    if kinds == {"mass", "buoyancy"}:
        return "only the net weight m g - B acts on this data", f"{WEIGH}, and in the water for B"
    if "bias" in kinds:
        return "they act alike at the attitudes of these trials", f"pitch and roll further, or {INCLINE}"
    return "only their common moment of weight and buoyancy acts on this data", INCLINE


def _actuators(roles: Sequence[Role]) -> _Told:
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
            return "lag, dead time and rate limits look alike in these trials", manoeuvre(roles[0])
        return "only the force that results acts on this data", manoeuvre(roles[0])
    if len(who) > 1:
        return "they push in one proportion in these trials", f"run steps of each of {listed(who)} alone"
    if kinds == {"motor"}:
        return "lag, dead time and rate limits look alike in these trials", manoeuvre(roles[0])
    if "lever" in kinds:
        return "only their product acts on this data", f"measure the lever of {who[0]} with a tape"
    if any(role.part == "K_V" for role in roles):
        return "only the thrust that results acts on this data", f"log the revolutions of {who[0]}"
    if "inflow" in kinds:
        way = f"take p1 of {who[0]} from a bench (bollard) test and {manoeuvre(roles[0])}"
        return "revolutions and speed through the water keep one proportion", way
    return "only their product acts on this data", "free one of them and take the others from the bench test"


def _thrust_and_hull(roles: Sequence[Role]) -> _Told:
    thrust = [role for role in roles if role.actuator]
    hull = [role for role in roles if not role.actuator]
    if not thrust or not hull:
        return None
    who = listed(sorted({role.actuator for role in thrust}))
    if all(role.of_fin for role in thrust):
        way = f"take the lift slope of {who} from its shape, or {manoeuvre(hull[0])}"
        return "only the ratio of the fin's lift to the hull's force acts on this data", way
    way = f"do a bench (bollard) test of {who}, or {manoeuvre(hull[0])}"
    return "only the ratio of thrust to the hull's force acts on this data", way


def _strips(roles: Sequence[Role]) -> _Told:
    """Strips of the hull are quadratic damping of both axes of their plane already."""
    names = {role.name for role in roles}
    for name, made in STRIPS.items():
        if name in names and names & set(made) and names <= {name, *made}:
            return strips_twice(name, made)
    return None


def strips_twice(name: str, made: Sequence[str]) -> tuple[str, str]:
    """What is wrong with strips and quadratic damping that are both free, and what to do."""
    return (
        f"the strips of {name} make {listed(made)} already, both must not be free",
        f"hold {listed(made)} at 0, or leave {name} out",
    )


def _one_force(roles: Sequence[Role]) -> _Told:
    """Derivatives of one force: one must vary without the other."""
    hull = {"added mass", "linear", "quadratic", "lift", "bias"}
    if len({role.force for role in roles}) > 1 or not {role.kind for role in roles} <= hull:
        return None
    kinds = {role.kind for role in roles}
    rates = sorted({role.rates for role in roles if role.rates})
    if "bias" in kinds:
        return "a constant force and drag look alike in one direction of motion", BOTH_WAYS
    if len(rates) > 1:
        return f"{listed(rates)} move in one proportion in these trials", _ways(roles)
    if "added mass" in kinds:
        moved = [role for role in roles if role.kind == "added mass"]
        return "too little acceleration to tell inertia from drag", _ways(moved)
    lifts = [role for role in roles if role.kind == "lift"]
    if lifts:
        way = manoeuvre(lifts[0])
        if lifts[0].force in lifts[0].pushed:
            way += ", and the same without way"
        return "forward speed varies too little to tell them apart", way
    return f"{axis(rates[0])} speed varies too little to tell them apart", _ways(roles)


_RULES: tuple[Callable[[Sequence[Role]], _Told], ...]

_RULES = (_inertia, _strips, _munk, _static, _actuators, _thrust_and_hull, _one_force)


def _ways(roles: Sequence[Role]) -> str:
    return "; ".join(dict.fromkeys(manoeuvre(role) for role in roles))
