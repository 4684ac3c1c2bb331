"""Which errors of a verification are those that guidance saw, and which are of the vehicle itself.

Guidance knows where the sensors say it is: where dead reckoning walks away, ``cross_track_…`` stays small and
the vehicle leaves its path. Both are kept; a requirement says which of them it means.

Tests: ``tests/test_seen_and_true.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seatrial.verification.expression import SEEN
from seatrial.verification.flown_missions import FlownMissions
from seatrial.verification.requirement import Requirement

__all__ = ["seen_and_true"]

_SAME_M = 1e-3


def seen_and_true(requirements: Sequence[Requirement], flown: FlownMissions) -> tuple[str, ...]:
    """A sentence on which errors are seen and which are true, with their sizes; none where they are the same.

    Parameters
    ----------
    requirements : sequence of Requirement
    flown : FlownMissions
    """
    seen, true = (
        np.asarray(flown.figures[name], float) for name in ("cross_track_p95_m", "true_cross_track_p95_m")
    )
    known = np.isfinite(seen) & np.isfinite(true)
    if not known.any() or np.allclose(seen[known], true[known], rtol=0.0, atol=_SAME_M):
        return ()
    asked = [f'"{one.name}"' for one in requirements if set(one.figures) & set(SEEN)]
    who = f" (which {' and '.join(asked)} ask{'s' if len(asked) == 1 else ''} for)" if asked else ""
    return (
        "Errors that guidance saw, from what its sensors told it, are cross_track_…, vertical_… and"
        f" missed_by_m{who}; true_cross_track_…, clearance, depths, altitude and attitude are of the vehicle"
        f" itself. Cross-track p95, median of the missions: {np.median(seen[known]):.2g} m seen,"
        f" {np.median(true[known]):.2g} m true.",
    )
