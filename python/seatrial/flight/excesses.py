"""Flights that broke a limit, touched the bottom, left the water, or pitched beyond the model.

Too deep or too low is what passes the mission's limit by more than 5 cm, the ripple of a loop. Too near is a
clearance of the hull of at most 0 m, or one short of the mission's promise by more than a tenth of it. The
model knows no surface: a vehicle that rises above it would stay in the water at sea. Coefficients and loops
are made for pitch angles up to about 45 deg.

Tests: ``tests/flight/test_excesses.py``, ``tests/verification/test_verification_messages.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Mask
from seatrial.flight.metrics import OFF_PROMISE

__all__ = [
    "IN_THE_AIR_M",
    "OFF_LIMIT_M",
    "STEEP_DEG",
    "counted",
    "promise_counts",
    "too_deep",
    "too_low",
    "too_near",
    "touched",
    "unkept",
]

IN_THE_AIR_M = 0.1
"""Height above the surface, m, from which a vehicle has left the water: less is a wave."""

OFF_LIMIT_M = 0.05
"""Beyond a limit of the mission, m: less is the ripple of a loop."""

STEEP_DEG = 45.0
"""Pitch angle, deg, beyond which neither coefficients nor loops hold."""


def too_near(metrics: Mapping[str, Any], promised_m: ArrayLike) -> Mask:
    """Whether the hull touched something, or came nearer than promised by more than a tenth, (k,).

    Parameters
    ----------
    metrics : mapping
        Metrics of flights by name, (k,) each.
    promised_m : array_like
        What the mission of each promises, m; 0 where it promises nothing.
    """
    clear, reserve = (np.asarray(metrics[name]) for name in ("clearance_m", "clearance_reserve_m"))
    return np.asarray((clear <= 0.0) | (reserve < -OFF_PROMISE * np.asarray(promised_m)))


def promise_counts(clear_m: float, reserve_m: float) -> bool:
    """Whether a promise was what came nearest to being broken, and not an obstacle that has none."""
    return reserve_m < clear_m - 1e-6


def touched(metrics: Mapping[str, Any]) -> Mask:
    """Whether the origin of the vehicle came down to the bottom, (k,).

    Parameters
    ----------
    metrics : mapping
        Metrics of flights by name, (k,) each.
    """
    return np.asarray(np.asarray(metrics["altitude_smallest_m"]) <= 0.0)


def too_deep(metrics: Mapping[str, Any], max_depth_m: ArrayLike) -> Mask:
    """Whether the vehicle truly went deeper than the mission's largest depth, (k,)."""
    return np.asarray(np.asarray(metrics["depth_largest_m"]) > np.asarray(max_depth_m) + OFF_LIMIT_M)


def too_low(metrics: Mapping[str, Any], min_altitude_m: ArrayLike) -> Mask:
    """Whether the vehicle truly came nearer to the bottom than the mission's least altitude, (k,)."""
    return np.asarray(np.asarray(metrics["altitude_smallest_m"]) < np.asarray(min_altitude_m) - OFF_LIMIT_M)


def unkept(metrics: Mapping[str, Any], promised_m: ArrayLike, limits: Mapping[str, float]) -> dict[str, Mask]:
    """What keeps flights from being complete, whatever the autopilot perceived: (k,) by what happened.

    Parameters
    ----------
    metrics : mapping
        Metrics of flights by name, (k,) each.
    promised_m : array_like
        What the mission of each promises, m.
    limits : mapping of str to float
        ``max_depth_m`` and ``min_altitude_m`` of the mission.
    """
    down = touched(metrics)
    return {
        "too near to an obstacle": too_near(metrics, promised_m),
        "the bottom touched": down,
        "below the mission's least altitude": too_low(metrics, limits["min_altitude_m"]) & ~down,
        "beyond the mission's largest depth": too_deep(metrics, limits["max_depth_m"]),
    }


def counted(
    metrics: Mapping[str, Any],
    promised_m: ArrayLike,
    name: Callable[[int], str],
    what: str = "missions",
    limits: Mapping[str, float] | None = None,
) -> list[str]:
    """A sentence without a full stop for each kind of excess: how many flights, the worst one and when.

    Parameters
    ----------
    metrics : mapping
        Metrics of flights by name, (k,) each.
    promised_m : array_like
        What the mission of each promises, m, (k,) or one number.
    name : callable
        What the flight of a place is called, such as "mission 7".
    what : str
        What several flights are called.
    limits : mapping of str to float, optional
        ``max_depth_m`` and ``min_altitude_m`` of their mission; what is beyond them is not told without.
    """
    deepest, lowest = (limits["max_depth_m"], limits["min_altitude_m"]) if limits else (math.inf, 0.0)
    clear, altitude, depth, pitch = (
        np.asarray(metrics[name], dtype=float)
        for name in ("clearance_m", "altitude_smallest_m", "depth_smallest_m", "pitch_largest_deg")
    )
    down = np.asarray(metrics["depth_largest_m"], dtype=float)
    promised = np.broadcast_to(np.asarray(promised_m, dtype=float), clear.shape)
    kept = np.asarray(metrics["clearance_reserve_m"], dtype=float)

    def nearness(k: int) -> str:
        asked = f" (promised: {promised[k]:g} m)" if promise_counts(clear[k], kept[k]) else ""
        where = f"{clear[k]:.2f} m away" if clear[k] > 0.0 else f"{-clear[k]:.2f} m inside"
        return where + asked

    kinds: tuple[tuple[str, Mask, Any, Callable[[int], str], str], ...] = (
        ("came too near to an obstacle", too_near(metrics, promised), kept, nearness, "clearance_time_s"),
        ("touched the bottom", touched(metrics), altitude, lambda k: f"{-altitude[k]:.2f} m below it", ""),
        (
            f"came below the mission's least altitude of {lowest:g} m",
            too_low(metrics, lowest) & ~touched(metrics),
            altitude,
            lambda k: f"{altitude[k]:.2f} m",
            "",
        ),
        (
            f"went beyond the mission's largest depth of {deepest:g} m",
            too_deep(metrics, deepest),
            -down,
            lambda k: f"{down[k]:.2f} m",
            "",
        ),
        (
            "rose above the surface",
            depth < -IN_THE_AIR_M,
            depth,
            lambda k: f"{-depth[k]:.1f} m high",
            "depth_smallest_time_s",
        ),
        (
            f"pitched beyond {STEEP_DEG:g} deg",
            pitch > STEEP_DEG,
            -pitch,
            lambda k: f"{pitch[k]:.0f} deg",
            "pitch_time_s",
        ),
    )
    found = []
    for words, mask, least, how_far, when in kinds:
        if mask.any():
            k = int(np.argmin(np.where(mask, least, math.inf)))
            found.append(
                f"{int(mask.sum())} of {len(mask)} {what} {words}, the worst is {name(k)}:"
                f" {how_far(k)}{f' at {float(metrics[when][k]):.1f} s' if when else ''}"
            )
    return found
