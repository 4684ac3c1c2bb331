"""Figures that a requirement asks for and no mission has: a verdict that rests on one says nothing.

Without a bottom the altitude is infinite, without obstacles the clearance is, and a requirement on them is
held whatever is flown. A figure that is not a number in all missions, as the time of an alert where none was
raised, lets its requirement fail whatever is flown. Both are told after the flights. Energy that the vehicle
file does not tell would be 0 Wh, which any requirement on it allows: that is refused beforehand.

Tests: ``tests/test_verification_messages.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.errors import CampaignError
from seatrial.verification.expression import KNOWN
from seatrial.verification.flown_missions import FlownMissions
from seatrial.verification.requirement import Requirement

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["check_energy", "figures_without_value"]

_MISSING = {
    "altitude_smallest_m": "there is no bottom; add seabed under [verification]",
    "clearance_m": "nothing stands in the water; add obstacles under [verification]",
}


def check_energy(requirement: Requirement, vehicle: Vehicle) -> None:
    """Refuse a requirement on the energy of a vehicle that tells no power.

    Raises
    ------
    CampaignError
        It is one.

    Examples
    --------
    >>> import seatrial as st
    >>> check_energy(Requirement("battery", "energy_wh <= 60"), st.Vehicle.load("cwolf"))
    """
    if "energy_wh" not in requirement.figures:
        return
    told = [facts["power_w_s3"] or 0.0 for facts in vehicle.actuator_info().values()]
    if max([*told, vehicle.power().get("hotel_w", 0.0)]) <= 0.0:
        raise CampaignError(
            f"energy_wh is not known, {vehicle.name} tells neither power_w_s3 nor [power]; add them to the"
            " vehicle file, or ask for something else"
        )


def figures_without_value(requirements: Sequence[Requirement], flown: FlownMissions) -> tuple[str, ...]:
    """Sentences on requirements that every mission had to hold, or none could.

    Parameters
    ----------
    requirements : sequence of Requirement
    flown : FlownMissions
    """
    said = []
    for one in requirements:
        none_held = not one.judge(flown.figures).held.any()
        for name in one.figures:
            if KNOWN[name].kind != "number":
                continue
            values = np.asarray(flown.figures[name], dtype=float)
            known = values[~np.isnan(values)]
            if not len(known) and none_held:
                said.append(f'"{one.name}" asks for {name}, which no mission has: it was bound to fail.')
            if name in _MISSING and len(known) and np.isposinf(known).all():
                said.append(
                    f'"{one.name}" asks for {name}, and {_MISSING[name]}: as it is, the figure is infinite'
                    " in all missions and shows nothing."
                )
    return tuple(said)
