"""Requirements of a campaign that states none: what every mission is meant to do.

To be complete without an abort; on settled legs to be really no further from the path than the sphere of
acceptance of the tightest waypoint in 95 % of the time; to touch neither an obstacle nor the bottom, and to
stay above the mission's depth limit, where there are such. Each must hold in 95 % of the missions.

No autopilot is nearer to its path than its sensors know: what their position is off by in 95 % of the
missions, 1.96 standard deviations across the path, is allowed on top.

Tests: ``tests/test_verify.py``.
"""

from __future__ import annotations

import math
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
_SURE = 1.96  # normal quantile of 95 % on two sides


def default_requirements(
    table: VerificationTable, missions: Sequence[Mission], *, position_sd_m: float = 0.0
) -> tuple[Requirement, ...]:
    r"""Requirements of missions where the campaign states none.

    Parameters
    ----------
    table : VerificationTable
    missions : sequence of Mission
        Those of the table.
    position_sd_m : float
        Standard deviation of the position that the sensors give, along an axis.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.cli.new import EXAMPLES
    >>> from seatrial.verification.verification_file import parse_verification
    >>> table = parse_verification('[verification]\nmissions = ["farm.toml"]', "campaign.toml")
    >>> farm = st.Mission.load(EXAMPLES / "missions" / "farm.toml")
    >>> [one.holds for one in default_requirements(table, [farm])][1:]
    ['true_cross_track_p95_m <= 3', 'clearance_m > 0', 'depth_largest_m <= 15']
    """
    radius = min(float(np.min(one.waypoints["acceptance_radius_m"])) for one in missions)
    # Rounded up to a decimetre: nobody states a finer one.
    allowance = math.ceil(10.0 * _SURE * position_sd_m) / 10.0
    deepest = min(float(one.limits["max_depth_m"]) for one in missions)
    asked = [
        ("is complete", 'ending == "complete" and not abort'),
        ("keeps its path", f"true_cross_track_p95_m <= {radius + allowance:g}"),
    ]
    if any(obstacles(table.obstacles, one) for one in missions):
        asked.append(("touches nothing", "clearance_m > 0"))
    if table.seabed is not None:
        asked.append(("stays off the bottom", "altitude_smallest_m > 0"))
    if np.isfinite(deepest):
        asked.append(("keeps its depth limit", f"depth_largest_m <= {deepest:g}"))
    return tuple(Requirement(name, holds, _SHARE) for name, holds in asked)
