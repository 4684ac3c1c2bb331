"""How near a mission's straight ways come to its fence. Held by tests/test_check_mission.py."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from seatrial.mission import Mission

__all__ = ["clearance", "fence_sentences"]

Array = NDArray[np.float64]


def clearance(points: Array, fence: Array) -> tuple[float, int]:
    """Smallest distance in m of a polyline (n, 2) inside a fence (m, 2), and the index of its leg."""
    ends = np.roll(fence, -1, axis=0)
    nearest, leg = np.inf, 0
    for k, (a, b) in enumerate(pairwise(points)):
        found = min(
            float(_to_stretches(np.stack([a, b]), fence, ends).min()),
            float(_to_stretches(fence, a[None], b[None]).min()),
        )
        if found < nearest:
            nearest, leg = found, k
    return nearest, leg


def _to_stretches(places: Array, begin: Array, end: Array) -> Array:
    """Distances (places, stretches) in m."""
    along = end - begin
    square = np.maximum((along * along).sum(axis=1), 1e-30)
    share = np.clip(((places[:, None] - begin) * along).sum(axis=2) / square, 0.0, 1.0)
    rest = places[:, None] - begin - share[..., None] * along
    return np.asarray(np.hypot(rest[..., 0], rest[..., 1]))


def fence_sentences(mission: Mission) -> tuple[list[str], list[str]]:
    """Notes and warnings about the way and the fence."""
    if not len(mission.fence):
        return [], []
    points = mission.waypoints
    start = [[mission.start["north_m"], mission.start["east_m"]]]
    places = np.vstack([start, np.stack([points["north_m"], points["east_m"]], axis=1)])
    nearest, leg = clearance(places, mission.fence)
    label, radius = points["label"][leg], float(points["acceptance_radius_m"][leg])
    if nearest < radius:
        return [], [
            f'the way to "{label}" comes within {nearest:.1f} m of the fence, less than its radius of'
            f" acceptance of {radius:g} m; a turn or a current may carry the vehicle out"
        ]
    return [f'Fence: {nearest:.1f} m from the nearest way, that to "{label}"'], []
