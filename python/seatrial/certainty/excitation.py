"""Which motion excites which coefficient: what its name says, and the manoeuvre that makes it act.

A name says which force the coefficient makes and what must move for that force to act: ``N_uv`` is a yaw
moment that needs forward and sideways speed, ``K_pdot`` a roll moment that needs roll acceleration,
``stern.p1_astern`` a thrust that needs revolutions astern. Names behind a dot are parts of an actuator, or
of a group of actuators as campaigns free them. The manoeuvres are those of sea trials (ITTC 7.5-04-02-01,
full-scale manoeuvring trials) and of the tank: free decay, bollard pull, inclining test.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

FORCES, VELOCITIES = "XYZKMN", "uvwpqr"
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")

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
    lift, bias, thrust, inflow, torque, motor, lever, ratio, wash or other; ``part`` is the name behind the
    ``actuator``.
    """

    name: str
    kind: str
    force: str = ""
    velocities: str = ""
    actuator: str = ""
    part: str = ""

    @property
    def rates(self) -> str:
        """Velocities whose magnitude the force follows: of a lift ``u`` only multiplies, and is left out."""
        return self.velocities[1:] if self.kind == "lift" else self.velocities


def role(name: str) -> Role:
    """Role of a coefficient or of a campaign's parameter, from its name.

    Examples
    --------
    >>> role("N_uv").kind, role("N_uv").force, role("N_uv").velocities
    ('lift', 'N', 'uv')
    >>> role("stern.gain").kind, role("stern.gain").actuator
    ('thrust', 'stern')
    """
    actuator, _, part = name.rpartition(".")
    if actuator:
        kind = "thrust" if re.fullmatch(r"a(0|1|11)_(ahead|astern)", part) else _PARTS.get(part, "other")
        return Role(name, kind, force=part[-1] if kind == "lever" else "", actuator=actuator, part=part)
    if name in ("m", "B"):
        return Role(name, "mass" if name == "m" else "buoyancy")
    if found := re.fullmatch(r"I_([xyz])([xyz])?", name):
        axes = ["xyz".index(letter) + 3 for letter in found.groups() if letter]
        return Role(name, "inertia", "".join(FORCES[i] for i in axes), "".join(VELOCITIES[i] for i in axes))
    if re.fullmatch(r"[xyz]_[gb]", name):
        return Role(name, "gravity" if name.endswith("g") else "buoyancy centre")
    for pattern, kind in _DERIVATIVES:
        if found := pattern.fullmatch(name):
            return Role(name, kind, found[1], found[2])
    return Role(name, "other")


def manoeuvre(one: Role) -> str:
    """Manoeuvre that excites a coefficient, as an imperative.

    Examples
    --------
    >>> manoeuvre(role("Z_uw"))
    'dive with the vertical thrusters under way, at two forward speeds or more'
    """
    if one.kind in ("linear", "quadratic"):
        return _DAMPING[one.velocities]
    if one.kind == "lift":
        return _LIFT[one.rates]
    if one.kind in ("added mass", "inertia"):
        return _ACCELERATION[one.velocities[0]]
    if one.kind in _STATIC:
        return _STATIC[one.kind]
    who = one.actuator
    if one.kind == "thrust":
        _, _, side = one.part.partition("_")
        return f"run {who} {side or 'both ways'} in steps over its range, or on the bench (bollard test)"
    if one.kind == "ratio":
        return f"run {who} ahead and astern in the same steps"
    if one.kind == "wash":
        return f"run steps of {who} with the other groups at rest and at work"
    if one.kind == "inflow":
        return f"run steps of revolutions of {who} at several speeds through the water"
    if one.kind == "torque":
        return f"run steps of {who} alone with roll free, or measure its torque on the bench"
    if one.kind == "motor":
        return f"run steps of {who} with its revolutions logged, at 20 Hz or more"
    if one.kind == "lever":
        return f"run steps of {who} alone with {axis(one.force)} free, or measure the lever with a tape"
    return "add a trial in which it acts"


def axis(letter: str) -> str:
    """Word for the axis of a force or velocity letter.

    Examples
    --------
    >>> axis("N"), axis("r")
    ('yaw', 'yaw')
    """
    return AXES[(FORCES if letter in FORCES else VELOCITIES).index(letter)]
