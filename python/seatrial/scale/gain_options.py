"""Thrust gains that a campaign may free: single ones, one per group and direction, or one per axis.

A group's gain multiplies the thrust of all its actuators, so its input is the wrench of them all. Of the rows
of the wrench, a force is scaled by the gain of the group that makes most of it, a moment by a group's levers.

Tests: ``tests/test_inputs.py``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from seatrial.campaign_file import AXES
from seatrial.parameters import actuator_groups
from seatrial.scale.combinations import Dependence, dependence
from seatrial.search import Array

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["Drive", "GainOption", "centred", "offered", "per_axis", "per_group"]

_USED = 0.1
"""A direction with less than this share of the impulse tells no gain of its own: a tenth of the data."""


@dataclass(frozen=True)
class Drive:
    """What one actuator did: root mean square of its thrust about the mean, N, and its impulse ahead.

    ``ahead`` is the share of ``integral |f| dt`` with thrust along the actuator's direction.
    """

    actuator: str
    group: str
    rms_n: float
    ahead: float


@dataclass(frozen=True)
class GainOption:
    """A way to free thrust gains: the campaign's keys, and whether the inputs tell them apart.

    ``singular_values`` are those of the inputs behind the keys, relative to the largest.
    """

    kind: Literal["single", "group and direction", "axis"]
    names: tuple[str, ...]
    singular_values: tuple[float, ...]
    told_apart: bool


def _group_keys(vehicle: Vehicle, group: str, drives: Iterable[Drive]) -> dict[str, float]:
    """Keys of a group's gains with the sign of the thrust that each acts on, 0 for both.

    A quadratic characteristic has a factor per direction; a table, a regression and a direct thrust have one,
    and a ratio of the thrust astern.
    """
    facts, names = vehicle.actuator_info(), actuator_groups(vehicle)[group]
    own = [drive for drive in drives if drive.group == group and drive.rms_n > 0.0]
    if not own:
        return {}
    ahead = float(np.mean([drive.ahead for drive in own]))
    quadratic = all(facts[name]["characteristic"] == "quadratic" for name in names)
    if not (quadratic or _USED <= ahead <= 1.0 - _USED):
        return {f"{group}.gain": 0.0}
    keys = ("p1_ahead", "p1_astern") if quadratic else ("gain", "astern_ratio")
    both = {f"{group}.{keys[0]}": (1.0, ahead), f"{group}.{keys[1]}": (-1.0, 1.0 - ahead)}
    return {key: sign for key, (sign, share) in both.items() if share >= _USED}


def per_group(
    vehicle: Vehicle, each: Array, thrust: Array, weight: Array, drives: tuple[Drive, ...]
) -> GainOption:
    """One gain per group and direction: the input behind each is the wrench of all that it acts on."""
    names, columns = [], []
    for group, members in actuator_groups(vehicle).items():
        index = [vehicle.actuators.index(name) for name in members]
        for key, sign in _group_keys(vehicle, group, drives).items():
            counted = thrust[:, index] * sign >= 0.0
            names.append(key)
            columns.append(centred(np.einsum("nki,nk->ni", each[:, index], counted), weight).ravel())
    if not names:
        return GainOption("group and direction", (), (), False)
    found = dependence(np.stack(columns, axis=1), names)
    apart = not found.lost and not found.still
    return GainOption("group and direction", tuple(names), found.singular_values, apart)


def per_axis(vehicle: Vehicle, each: Array, weight: Array, rows: Dependence) -> GainOption:
    """One gain per row of the wrench: of forces the strongest group's gain, of moments its levers."""
    groups, values = actuator_groups(vehicle), vehicle.coefficients()
    total = centred(each.sum(axis=1), weight)
    driven = [row for row in AXES if row not in rows.still]
    for one in rows.combinations:  # of rows that move only together the strongest speak
        beside = [name for name, _ in one.parts if name in driven]
        driven.remove(min(beside, key=lambda row: float(np.linalg.norm(total[:, AXES.index(row)]))))
    wrenches = {
        group: centred(each[:, [vehicle.actuators.index(name) for name in names]].sum(axis=1), weight)
        for group, names in groups.items()
    }
    keys = []
    for row in driven:
        strength = {group: _own(wrench, AXES.index(row)) for group, wrench in wrenches.items()}
        group = max(strength, key=lambda one: strength[one])
        if row in "XYZ":
            keys.append(f"{group}.gain")
        elif all(values.get(f"{name}.lever_{row}") for name in groups[group]):  # relative bounds need a lever
            keys.append(f"{group}.lever_{row}")
    left = dependence(total[:, [AXES.index(row) for row in driven]], driven)
    return GainOption("axis", tuple(dict.fromkeys(keys)), left.singular_values, bool(keys) and not left.lost)


def _own(wrench: Array, axis: int) -> float:
    """Strength of a row of a group's wrench; of a moment, what does not simply follow the group's force."""
    row = wrench[:, axis]
    if axis >= 3:
        row = row - wrench[:, :3] @ np.linalg.lstsq(wrench[:, :3], row, rcond=1e-9)[0]
    return float(np.linalg.norm(row))


def offered(vehicle: Vehicle, drives: tuple[Drive, ...], found: Dependence) -> tuple[str, ...]:
    """Single gains for the groups whose members are all told apart, else the group's."""
    keys: list[str] = []
    for group, members in actuator_groups(vehicle).items():
        if set(members) & {*found.involved, *found.still}:
            keys += _group_keys(vehicle, group, drives)
        else:
            keys += [f"{name}.gain" for name in members]
    return tuple(keys)


def centred(signals: Array, weight: Array) -> Array:
    """Signals (n, k) about their weighted means, times the weights' roots: norms are standard deviations."""
    return np.asarray((signals - weight @ signals) * np.sqrt(weight)[:, None])
