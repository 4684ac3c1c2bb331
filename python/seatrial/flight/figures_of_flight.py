"""The figures of a flight under names that carry their units.

The core sums them while it flies (`closed_loop/tally.rs`). Errors of guidance count on the second half of
straight legs, where the vehicle has had time to settle, and are those that guidance saw; ``true_...`` is
where the vehicle really was. Without a settled sample there is none. The depth excursion is how far the
vehicle leaves the band between the depths of a leg's two ends. The quantiles p50, p95 and p99 are those of
one flight's error over time; the clearance is the smallest distance to an obstacle's edge, and travel the
mean rate at which commands move, in shares of an actuator's range.

Held by ``test_figures_of_the_core_are_those_of_the_log`` in ``tests/test_flight.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from seatrial._core import Flights, autopilot_names, error_edges

__all__ = ["CODED", "DIVERGED", "ending_of", "figures_of", "quantile"]

Array = NDArray[np.float64]

DIVERGED = "diverged"

CODED = ("ending", "alert", "alert_cause", "alert_time_s")
"""Figures that a single flight tells in words: its ending and its alerts."""

_DEG = 180.0 / math.pi
_NAMES = {
    "duration": ("duration_s", 1.0),
    "distance": ("distance_m", 1.0),
    "energy": ("energy_wh", 1.0 / 3600.0),
    "cross_track_largest": ("cross_track_largest_m", 1.0),
    "cross_track_rms": ("cross_track_rms_m", 1.0),
    "true_cross_track_largest": ("true_cross_track_largest_m", 1.0),
    "true_cross_track_rms": ("true_cross_track_rms_m", 1.0),
    "vertical_largest": ("vertical_largest_m", 1.0),
    "vertical_rms": ("vertical_rms_m", 1.0),
    "excursion": ("depth_excursion_m", 1.0),
    "depth_largest": ("depth_largest_m", 1.0),
    "altitude_smallest": ("altitude_smallest_m", 1.0),
    "waypoints": ("waypoints_behind", 1.0),
    "missed_by": ("missed_by_m", 1.0),
    "switches": ("switches_per_minute", 1.0),
    "alert_time": ("alert_time_s", 1.0),
    "roll_largest": ("roll_largest_deg", _DEG),
    "pitch_largest": ("pitch_largest_deg", _DEG),
    "clearance": ("clearance_m", 1.0),
    "travel": ("travel_per_s", 1.0),
}
_QUANTILES = {"p50": 0.50, "p95": 0.95, "p99": 0.99}


def figures_of(flights: Flights) -> dict[str, Array]:
    """Figures of all cases by name, (k,) each; a diverged flight has no duration.

    ``ending``, ``alert`` and ``alert_cause`` are numbers of a list, see `ending_of` and
    ``seatrial._core.autopilot_names``.
    """
    found: dict[str, Array] = {}
    for name, values in flights.figures.items():
        renamed, scale = _NAMES.get(name, (name, 1.0))
        found[renamed] = scale * np.asarray(values)
    for error in ("cross_track", "true_cross_track", "vertical"):
        counts = getattr(flights, f"{error}_counts")
        for name, share in _QUANTILES.items():
            found[f"{error}_{name}_m"] = quantile(counts, share, largest=found[f"{error}_largest_m"])
    return found


def quantile(counts: Array, share: float, *, largest: Array) -> Array:
    """Quantile (k,), m, of the magnitude of an error from its counts, log-linear between the thresholds.

    Parameters
    ----------
    counts : (k, 1 + edges) ndarray
        Samples, and those above each of ``seatrial._core.error_edges``.
    share : float
        Of the samples that the error is at most the quantile for.
    largest : (k,) ndarray
        Largest error, m, which bounds the quantile.
    """
    edges = np.log(np.asarray(error_edges()))
    samples, above = counts[:, :1], counts[:, 1:]
    exceeding = above / np.maximum(samples, 1.0)
    found = np.empty(len(counts))
    for case, row in enumerate(exceeding):
        # From the rarest threshold down, as np.interp wants rising shares.
        found[case] = np.exp(np.interp(1.0 - share, row[::-1], edges[::-1]))
        if row[-1] > 1.0 - share:  # beyond the last threshold only the largest is known
            found[case] = np.inf
    return np.where(samples[:, 0] > 0.0, np.minimum(found, largest), np.nan)


def ending_of(figures: Mapping[str, Array], case: int = 0) -> str:
    """How a case ended: complete, surfaced, aborted, out of time or diverged."""
    if not np.isfinite(figures["duration_s"][case]):
        return DIVERGED
    return autopilot_names()["endings"][int(figures["ending"][case])]
