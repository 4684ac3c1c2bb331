"""Candidates of missing terms: coefficients that an estimate holds and that act on a free axis."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.campaign_file import AXES
from seatrial.criticism.residuals import block_numbers
from seatrial.criticism.score_test import score_tests
from seatrial.linearisation import Linearisation
from seatrial.parameters import VELOCITIES, actuator_groups
from seatrial.search import Array

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.joint import Joint

OF_AN_AXIS = re.compile(rf"([{AXES}])_(0|[{VELOCITIES}]dot|[{VELOCITIES}]{{1,2}})")
"""A coefficient of a force: the force's letter, and what it is proportional to."""

_AT_ONCE = 3e7
_STRONGEST = 40
_COARSE = 40
_OF_ONE = re.compile(r".+\.(gain|lever_[KMN])")


@dataclass(frozen=True)
class Candidate:
    """A coefficient that might be missing; of an actuator group, the coefficients that it sets together."""

    name: str
    members: tuple[str, ...]


def candidates(vehicle: Vehicle, estimated: Iterable[str], *, free: str) -> tuple[Candidate, ...]:
    """Coefficients of a vehicle that are not estimated and act on a free axis.

    Of an actuator group those of all its actuators together where they are equal, and of each actuator its
    gain and levers.

    Parameters
    ----------
    vehicle : Vehicle
    estimated : iterable of str
        Coefficients that the fit sets.
    free : str
        Letters of the free axes.

    Examples
    --------
    >>> import seatrial as st
    >>> found = candidates(st.Vehicle.load("cwolf"), ["X_u", "X_uu"], free="X")
    >>> [c.name for c in found if c.name.startswith("X_u")]
    ['X_udot']
    """
    fixed = set(estimated)
    known = vehicle.coefficient_info()
    groups = actuator_groups(vehicle)
    actuators, present = set(vehicle.actuators), vehicle.coefficients()
    found = []
    for name in known:
        axis = OF_AN_AXIS.fullmatch(name)
        if name in fixed or (axis and axis[1] not in free):
            continue
        if name.partition(".")[0] not in actuators or _OF_ONE.fullmatch(name):
            found.append(Candidate(name, (name,)))
    for group, own_actuators in groups.items():
        of_first = [name.partition(".")[2] for name in known if name.startswith(f"{own_actuators[0]}.")]
        for suffix in (suffix for suffix in of_first if not suffix.startswith("lever_")):
            own = tuple(f"{member}.{suffix}" for member in own_actuators)
            single = len(own) == 1 and _OF_ONE.fullmatch(own[0])
            equal = len({present.get(name, 0.0) for name in own}) == 1
            if equal and not single and all(name in known and name not in fixed for name in own):
                found.append(Candidate(own[0] if len(own) == 1 else f"{group}.{suffix}", own))
    return tuple(found)


def columns_of(lin: Linearisation, tried: Sequence[Candidate]) -> list[Array]:
    """Columns (n, C, k) per segment of the candidates, whose coefficients are among the unknowns."""
    place = {unknown.name: i for i, unknown in enumerate(lin.unknowns)}
    mix = np.zeros((len(lin.unknowns), len(tried)))
    for column, candidate in enumerate(tried):
        for member in candidate.members:
            mix[place[member], column] = 1.0
    return [np.asarray(piece.jacobian @ mix) for piece in lin.pieces]


def members(tried: Iterable[Candidate]) -> list[str]:
    """Coefficients of the candidates, each once."""
    return list(dict.fromkeys(member for candidate in tried for member in candidate.members))


def fitted_places(lin: Linearisation, tried: Sequence[Candidate]) -> list[int]:
    """Places of the unknowns that are no candidate's."""
    held = {member for candidate in tried for member in candidate.members}
    return [i for i, unknown in enumerate(lin.unknowns) if unknown.name not in held]


def strongest(
    joint: Joint, values: Array, tried: tuple[Candidate, ...], *, initial: Array | None, noise: Array | None
) -> tuple[Candidate, ...]:
    """The candidates of the largest gains, all if the derivatives by all of them fit into memory.

    Parameters
    ----------
    joint : Joint
    values : ndarray, shape (m,)
        The estimate.
    tried : tuple of Candidate
    initial, noise : ndarray, optional
        As for `seatrial.polish.linearise`.
    """
    from seatrial.polish import linearise

    rows = joint.data.samples * len(joint.channels)
    fits = max(round(_AT_ONCE / rows) - len(joint.unknowns), _STRONGEST // 2)
    if len(tried) <= fits:
        return tried
    gains = np.zeros(len(tried))
    for first in range(0, len(tried), fits):
        part = tried[first : first + fits]
        lin = linearise(joint, values, initial=initial, noise=noise, extra=members(part))
        block = block_numbers(lin, rows * lin.dt / len(joint.channels) / _COARSE)
        tests = score_tests(lin, columns_of(lin, part), fitted=fitted_places(lin, part), block=block)
        gains[first : first + len(part)] = tests.results().gain
    return tuple(tried[place] for place in np.argsort(-gains, kind="stable")[:_STRONGEST])


def signal_of(name: str, info: Mapping[str, Mapping[str, Any]] | None = None) -> str:
    """The signal that a coefficient multiplies, in words.

    Examples
    --------
    >>> [signal_of(name) for name in ("Y_ur", "Y_rdot", "N_rr", "K_v", "Z_0")]
    ['u r', 'dr/dt', '|r| r', 'v', 'a constant']
    """
    axis = OF_AN_AXIS.fullmatch(name)
    if axis is None:
        words = (info or {}).get(name, {}).get("description")
        return f"the {words}" if words and "." not in name else name
    what = axis[2]
    if what == "0":
        return "a constant"
    if what.endswith("dot"):
        return f"d{what[0]}/dt"
    if len(what) == 1:
        return what
    return f"|{what[0]}| {what[0]}" if what[0] == what[1] else f"{what[0]} {what[1]}"
