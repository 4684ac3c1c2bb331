"""Roles of coefficients: which force one makes, what must move for it to act, which manoeuvre tells it.

A name says it for any vehicle: ``N_uv`` is a yaw moment that needs forward and sideways speed, ``K_pdot`` a
roll moment that needs roll acceleration, ``stern.p1_astern`` a thrust that needs revolutions astern. Names
behind a dot are parts of an actuator, or of a group of actuators as campaigns free them. The manoeuvres are
those of sea trials (ITTC 7.5-04-02-01) and of the tank: free decay, bollard pull, inclining test; their words
are in `seatrial.report.results.coefficient_advice`.

Tests: ``tests/diagnosis/test_manoeuvre_advice.py``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from seatrial.base.channels import AXES, VELOCITIES
from seatrial.problem.parameter import axes_of
from seatrial.problem.settings import STRIPS

_PARTS_OF = {
    "thrust": "gain p1_ahead p1_astern",
    "inflow": "p2 w t",
    "torque": "q1 q2",
    "motor": "K_V T_1 T_t n_acc n_dec",
    "lever": "lever_K lever_M lever_N",
    "ratio": "astern_ratio",
    "wash": "loss",
    "fin": "C_La C_Lmax C_D0 C_D90",
}
_PARTS = {part: kind for kind, parts in _PARTS_OF.items() for part in parts.split()}

_DERIVATIVES = (
    (re.compile(r"([XYZKMN])_([uvwpqr])dot"), "added mass"),
    (re.compile(r"([XYZKMN])_([uvwpqr])"), "linear"),
    (re.compile(r"([XYZKMN])_([uvwpqr])\2"), "quadratic"),
    (re.compile(r"([YZMN])_(u[vwqr])"), "lift"),
    (re.compile(r"([XYZKMN])_()0"), "bias"),
)


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
    """Role of a coefficient or of a campaign's parameter, from its name. ``pushed``: axes that thrusters push
    directly. ``fins``: fins and groups of fins.

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


class Manoeuvre(NamedTuple):
    """What tells a coefficient: a kind of motion or measurement, of which actuator, and which part of it.

    ``of`` is a velocity or an actuator; ``part`` a side of it or an axis, "unpushed" where no thruster pushes
    along the axis of the motion.
    """

    kind: str
    of: str = ""
    part: str = ""


_STATIC = {
    "mass": "weigh",
    "buoyancy": "float",
    "gravity": "incline",
    "buoyancy centre": "incline",
    "bias": "reverse",
}

# Axis that a thruster has to push along for a motion; a torpedo makes it by rudder and planes under way.
_PUSHED_BY = {
    (kind, velocity): axis
    for kind in ("damping", "acceleration")
    for velocity, axis in (("v", "Y"), ("w", "Z"), ("r", "N"))
}
_PUSHED_BY["lift", "w"] = "Z"


def manoeuvre(role: Role) -> Manoeuvre:
    """Manoeuvre or measurement that tells a coefficient.

    >>> manoeuvre(role("Z_uw"))
    Manoeuvre(kind='lift', of='w', part='')
    >>> manoeuvre(role("Z_uw", pushed="X"))
    Manoeuvre(kind='lift', of='w', part='unpushed')
    """
    if role.kind in ("linear", "quadratic", "strips"):
        return _motion(role, "damping", _damped(role))
    if role.kind == "lift":
        return _motion(role, "lift", role.rates)
    if role.kind in ("added mass", "inertia"):
        return _motion(role, "acceleration", role.velocities[0])
    if role.kind in _STATIC:
        return Manoeuvre(_STATIC[role.kind])
    if role.of_fin and role.kind in ("fin", "thrust", "other"):
        return Manoeuvre("deflect", role.actuator)
    if role.of_fin and role.kind in ("motor", "lever"):
        return Manoeuvre(f"fin-{role.kind}", role.actuator)
    if role.kind == "thrust":
        return Manoeuvre("thrust", role.actuator, role.part.partition("_")[2])
    if role.kind in ("ratio", "wash", "inflow", "torque", "motor", "lever"):
        return Manoeuvre(role.kind, role.actuator, role.force)
    return Manoeuvre("tether", role.name) if role.name.endswith("_tether") else Manoeuvre("other")


def _damped(role: Role) -> str:
    """Velocity that a damping takes energy from."""
    return VELOCITIES[AXES.index(role.force[1])] if role.kind == "strips" else role.velocities


def _motion(role: Role, kind: str, velocity: str) -> Manoeuvre:
    """A motion of the hull; one free decay tells damping and inertia in roll."""
    if velocity == "p":
        return Manoeuvre("decay", velocity)
    needed = _PUSHED_BY.get((kind, velocity), "")
    return Manoeuvre(kind, velocity, "unpushed" if needed and needed not in role.pushed else "")


# What a bench, scales or a tape measure gives without a trial, the surest first.
_BENCH = ("mass", "inertia", "lever", "thrust", "buoyancy", "gravity", "buoyancy centre", "inflow")


def anchor(names: Sequence[str]) -> str | None:
    """Member of a combination that a bench, scales or a tape measure gives; None where none does.

    >>> anchor(["M_qdot", "I_y"])
    'I_y'
    """
    kinds = {role(name).kind: name for name in reversed(names)}
    return next((kinds[kind] for kind in _BENCH if kind in kinds), None)


class Unexcited(NamedTuple):
    """Coefficients that nothing in the trials excites, for one reason and with one remedy.

    ``why`` is "still" (velocities of ``letters`` do not move), "weak", "locked" (axes of ``letters`` are not
    free), "idle" (an actuator that does not run) or "silent"; ``product`` is the coefficient in which the
    cross-flow drag of one of them shows.
    """

    names: tuple[str, ...]
    why: str
    letters: tuple[str, ...]
    manoeuvre: Manoeuvre
    product: str


def unexcited(
    names: Sequence[str],
    *,
    moving: Collection[str],
    silent: Collection[str],
    seen: Collection[str],
    pushed: str = AXES,
    fins: Collection[str] = (),
) -> list[Unexcited]:
    """Why the data would not show these coefficients even if all others were known, those alike together.
    ``moving`` velocities move in the trials, ``silent`` names change no channel, ``seen`` ones the data show.
    """
    groups: dict[tuple[str, tuple[str, ...], Manoeuvre], list[str]] = {}
    for name in names:
        asked = role(name, pushed=pushed, fins=fins)
        key = (*_why(asked, moving, name in silent), manoeuvre(asked))
        groups.setdefault(key, []).append(name)
    return [Unexcited(tuple(members), *key, _product(members, seen)) for key, members in groups.items()]


def _why(role: Role, moving: Collection[str], silent: bool) -> tuple[str, tuple[str, ...]]:
    """Why a coefficient is not excited, and the letters of what stands still or is locked."""
    if still := tuple(dict.fromkeys(v for v in role.velocities if v not in moving)):
        return "still", still
    if not silent:
        return "weak", ()
    if role.force:
        return "locked", tuple(dict.fromkeys(role.force))
    return ("idle" if role.kind == "thrust" else "silent"), ()


def _product(members: Collection[str], seen: Collection[str]) -> str:
    """Moment in which a drag shows: strips make N_rr of Y_vv too (Taubert et al. 2014, 27 to 30)."""
    pairs = (("Y_vv", "N_rr"), ("Z_ww", "M_qq"))
    return next((moment for force, moment in pairs if force in members and moment in seen), "")
