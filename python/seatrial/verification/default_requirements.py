"""Requirements of a campaign that states none: what every mission is meant to do.

To be complete without an abort; on settled legs to lie within the sphere of acceptance of the tightest
waypoint in 95 % of the time; to touch neither an obstacle nor the bottom, and to stay above the mission's
depth limit, where there are such. Each must hold in 95 % of the missions.

Tests: ``tests/test_verify.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.verification.obstacles import obstacles
from seatrial.verification.requirement import Requirement
from seatrial.verification.verification_file import VerificationTable

if TYPE_CHECKING:
    from seatrial.mission import Mission

__all__ = ["default_requirements"]

_SHARE = 0.95


def default_requirements(table: VerificationTable, missions: Sequence[Mission]) -> tuple[Requirement, ...]:
    r"""Requirements of missions where the campaign states none.

    Parameters
    ----------
    table : VerificationTable
    missions : sequence of Mission
        Those of the table.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.cli.new import EXAMPLES
    >>> from seatrial.verification.verification_file import parse_verification
    >>> table = parse_verification('[verification]\nmissions = ["farm.toml"]', "campaign.toml")
    >>> farm = st.Mission.load(EXAMPLES / "missions" / "farm.toml")
    >>> [one.holds for one in default_requirements(table, [farm])][1:]
    ['cross_track_p95_m <= 3', 'clearance_m > 0', 'depth_largest_m <= 15']
    """
    radius = min(float(np.min(one.waypoints["acceptance_radius_m"])) for one in missions)
    deepest = min(float(one.limits["max_depth_m"]) for one in missions)
    asked = [
        ("is complete", 'ending == "complete" and not abort'),
        ("keeps its path", f"cross_track_p95_m <= {radius:g}"),
    ]
    if any(obstacles(table.obstacles, one) for one in missions):
        asked.append(("touches nothing", "clearance_m > 0"))
    if table.seabed is not None:
        asked.append(("stays off the bottom", "altitude_smallest_m > 0"))
    if np.isfinite(deepest):
        asked.append(("keeps its depth limit", f"depth_largest_m <= {deepest:g}"))
    return tuple(Requirement(name, holds, _SHARE) for name, holds in asked)
