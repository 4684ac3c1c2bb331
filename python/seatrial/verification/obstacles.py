"""What stands in the water of a mission, as circles: those of the campaign, and the farms of the mission.

A net cage is a circle. Several cages within a polygon become circles of a metre (less in a narrow polygon)
along the inside of its edges, close enough together that between two of them at most 5 cm of the farm lie
open, and a point at every corner: clearances are those of the polygon to 5 cm along the edges, and contact
cannot slip through.

Tests: ``tests/test_draws.py``.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.verification.verification_file import Obstacle

if TYPE_CHECKING:
    from seatrial.mission import Mission

__all__ = ["Circle", "obstacles"]

Array = NDArray[np.float64]
Circle = tuple[float, float, float]

_RADIUS_M = 1.0
_OPEN_M = 0.05


def obstacles(entries: Sequence[Obstacle], mission: Mission) -> list[Circle]:
    """Circles (north, east, radius), m, that a flight of the mission must not touch.

    Parameters
    ----------
    entries : sequence of Obstacle
        Of the campaign.
    mission : Mission

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.cli.new import EXAMPLES
    >>> farm = st.Mission.load(EXAMPLES / "missions" / "farm.toml")
    >>> obstacles([Obstacle(from_mission=True)], farm)
    [(60.0, 20.0, 25.0)]
    """
    found: list[Circle] = []
    for entry in entries:
        if entry.from_mission:
            found += [circle for circle in _farms(mission) if circle not in found]
        elif entry.north_m is not None and entry.east_m is not None and entry.radius_m is not None:
            found.append((entry.north_m, entry.east_m, entry.radius_m))
    return found


def _farms(mission: Mission) -> list[Circle]:
    found: list[Circle] = []
    for leg in tomllib.loads(mission.to_toml()).get("legs", []):
        if leg.get("kind") != "perimeter":
            continue
        if leg.get("corners_m"):
            found += _along(np.asarray(leg["corners_m"], dtype=float))
        else:
            found.append((float(leg["north_m"]), float(leg["east_m"]), float(leg["radius_m"])))
    return found


def _along(corners: Array) -> list[Circle]:
    """Circles inside the edges of a convex polygon (n, 2), whose corners run either way."""
    centre = corners.mean(axis=0)
    edges = [
        (one, other)
        for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True)
        if math.dist(one, other) > 0.0
    ]
    inward = []
    for one, other in edges:
        along = (other - one) / math.dist(one, other)
        normal = np.array([-along[1], along[0]])
        inward.append(normal if normal @ (centre - one) > 0.0 else -normal)
    reach = min(float(normal @ (centre - one)) for normal, (one, _) in zip(inward, edges, strict=True))
    radius = min(_RADIUS_M, reach)
    spacing = 2.0 * math.sqrt(max(radius**2 - max(radius - _OPEN_M, 0.0) ** 2, 1e-6))
    found: list[Circle] = [(float(north), float(east), 0.0) for north, east in corners]
    for normal, (one, other) in zip(inward, edges, strict=True):
        length = math.dist(one, other)
        count = max(math.ceil(length / spacing), 1)
        for share in (np.arange(count) + 0.5) / count:
            place = one + share * (other - one) + radius * normal
            if all(n @ (place - a) >= radius - 1e-9 for n, (a, _) in zip(inward, edges, strict=True)):
                found.append((float(place[0]), float(place[1]), radius))
    return found
