"""What was driven in a bench test: actuators of one group, by name. Tests: ``tests/test_bench_file.py``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from seatrial.errors import CampaignError, nearest
from seatrial.parameters import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["Unit", "unit_of"]


@dataclass(frozen=True)
class Unit:
    """Actuators that share one characteristic in this test: a whole group, or some that are named.

    Attributes
    ----------
    name
        The group's name; names of the actuators joined by ``+`` where they are not a whole group.
    actuators
        In the vehicle's order.
    command
        Unit of their command: rpm, us or N.
    """

    name: str
    actuators: tuple[str, ...]
    command: str


def unit_of(vehicle: Vehicle, group: str | None, actuators: Sequence[str] | None, where: str) -> Unit:
    """Unit of a group or of named actuators.

    Raises
    ------
    CampaignError
        The vehicle has no such group or actuator, or their commands have unlike units. The message begins
        with `where`.
    """
    facts = vehicle.actuator_info()
    thrusters = [name for name in vehicle.actuators if facts[name]["kind"] == "thruster"]
    members_of = {
        name: [one for one in members if one in thrusters]
        for name, members in actuator_groups(vehicle).items()
    }
    groups = {name: members for name, members in members_of.items() if members}
    if group is not None:
        if group not in groups:
            raise CampaignError(f"{where}, key group: unknown group {group!r}{nearest(group, groups)}")
        members = groups[group]
    else:
        for name in actuators or ():
            if name not in thrusters:
                raise CampaignError(
                    f"{where}, key actuators: unknown thruster {name!r}{nearest(name, thrusters)}"
                )
        members = [name for name in thrusters if name in (actuators or ())]
    units = {str(facts[name]["unit"]) for name in members}
    if len(units) > 1:
        raise CampaignError(
            f"{where}: {', '.join(members)} are commanded in unlike units ({', '.join(sorted(units))});"
            " test those of each unit on their own"
        )
    whole = next((name for name, own in groups.items() if own == members), None)
    return Unit(whole or "+".join(members), tuple(members), units.pop())
