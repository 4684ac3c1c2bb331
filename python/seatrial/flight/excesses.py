"""Flights that broke a limit, touched the bottom, left the water, or pitched beyond the model.

Too near is a clearance of the hull of at most 0 m, or one short of the mission's promise by more than a tenth
of it. The model knows no surface: a vehicle that rises above it would stay in the water at sea. Held by
``tests/flight/test_excesses.py`` and ``tests/verification/test_verification_messages.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array, Mask
from seatrial.flight.metrics import SETTINGS as METRIC_SETTINGS


@dataclass(frozen=True)
class ExcessSettings:
    """From when a limit counts as broken."""

    #: Height above the surface, m, from which a vehicle has left the water: less is a wave.
    in_the_air_m: float = 0.1
    off_limit_m: float = 0.05  #: Beyond a limit of the mission, m: less is the ripple of a loop.
    steep_deg: float = 45.0  #: Pitch angle, deg, beyond which neither coefficients nor loops hold.
    rounding_m: float = 1e-6  #: Below it two distances are the same, m.


SETTINGS = ExcessSettings()


def too_near(metrics: Mapping[str, Any], promised_m: ArrayLike) -> Mask:
    """Whether the hull touched something, or came nearer than promised (m, 0 where nothing is) by over a
    tenth, (k,).
    """
    clear, reserve = (np.asarray(metrics[name]) for name in ("clearance_m", "clearance_reserve_m"))
    return np.asarray((clear <= 0.0) | (reserve < -METRIC_SETTINGS.short_of_promise * np.asarray(promised_m)))


def promise_counts(clear_m: float, reserve_m: float) -> bool:
    """Whether a promise was what came nearest to being broken, and not an obstacle that has none."""
    return reserve_m < clear_m - SETTINGS.rounding_m


def touched(metrics: Mapping[str, Any]) -> Mask:
    """Whether the origin of the vehicle came down to the bottom, (k,), by metrics of flights."""
    return np.asarray(np.asarray(metrics["altitude_smallest_m"]) <= 0.0)


def too_deep(metrics: Mapping[str, Any], max_depth_m: ArrayLike) -> Mask:
    """Whether the vehicle truly went deeper than the mission's largest depth, (k,)."""
    return np.asarray(np.asarray(metrics["depth_largest_m"]) > np.asarray(max_depth_m) + SETTINGS.off_limit_m)


def too_low(metrics: Mapping[str, Any], min_altitude_m: ArrayLike) -> Mask:
    """Whether the vehicle truly came nearer to the bottom than the mission's least altitude, (k,)."""
    return np.asarray(
        np.asarray(metrics["altitude_smallest_m"]) < np.asarray(min_altitude_m) - SETTINGS.off_limit_m
    )


def unkept(metrics: Mapping[str, Any], promised_m: ArrayLike, limits: Mapping[str, float]) -> dict[str, Mask]:
    """What keeps flights from being complete, whatever the autopilot perceived: (k,) by kind of excess.
    `limits` are ``max_depth_m`` and ``min_altitude_m`` of the mission.
    """
    broken = {}
    for kind, ranges in broken_in(promised_m, limits).items():
        inside = [(metrics[name] >= lowest) & (metrics[name] <= highest) for name, lowest, highest in ranges]
        broken[kind] = np.asarray(np.any(inside, axis=0))
    return broken


def broken_in(
    promised_m: ArrayLike, limits: Mapping[str, float]
) -> dict[str, list[tuple[str, ArrayLike, ArrayLike]]]:
    """Ranges of metrics in which a flight is not complete: name, lowest and highest value in m, both inside.
    The page of a report judges its flights by the same ranges.
    """
    infinity = math.inf
    short = np.nextafter(-METRIC_SETTINGS.short_of_promise * np.asarray(promised_m, dtype=float), -infinity)
    low = float(np.nextafter(limits["min_altitude_m"] - SETTINGS.off_limit_m, -infinity))
    deep = float(np.nextafter(limits["max_depth_m"] + SETTINGS.off_limit_m, infinity))
    above_bottom = float(np.nextafter(0.0, infinity))
    return {
        "too_near": [("clearance_m", -infinity, 0.0), ("clearance_reserve_m", -infinity, short)],
        "bottom_touched": [("altitude_smallest_m", -infinity, 0.0)],
        "too_low": [("altitude_smallest_m", above_bottom, low)],
        "too_deep": [("depth_largest_m", deep, infinity)],
    }


@dataclass(frozen=True)
class Excess:
    """Flights of many (`count` of `of`) that did what every user calls a failure of a kind of `KINDS`.
    `worst` is the place of the flight that went farthest, `value` what it came to and `limit` what it
    broke, in the unit of the kind, `at_s` when; NaN where there is none.
    """

    kind: str
    count: int
    of: int
    worst: int
    value: float
    limit: float
    at_s: float

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data; ``worst`` is the place of the flight among all."""
        return {**vars(self), "share": self.count / self.of, "unit": KINDS[self.kind].unit}


@dataclass(frozen=True)
class Kind:
    """A kind of excess: unit of value and limit, the `metrics` of which any is asked for where a requirement
    decides on this kind by itself, and the metric with the `time` at which it happened.
    """

    unit: str
    metrics: tuple[str, ...]
    time: str = ""


KINDS: Mapping[str, Kind] = {
    "too_near": Kind("m", ("clearance_reserve_m",), "clearance_time_s"),
    "bottom_touched": Kind("m", ("altitude_smallest_m",)),
    "too_low": Kind("m", ("altitude_smallest_m",)),
    "too_deep": Kind("m", ("depth_largest_m",)),
    "above_surface": Kind("m", ("depth_smallest_m",), "depth_smallest_time_s"),
    "too_steep": Kind("deg", ("pitch_largest_deg",), "pitch_time_s"),
    "not_complete": Kind("", ("ending", "abort", "alert", "waypoints_behind")),
    "battery": Kind("Wh", ("energy_wh",)),
}
"""Kinds of excess, the gravest first."""


def excesses(
    metrics: Mapping[str, Any],
    promised_m: ArrayLike,
    *,
    max_depth_m: ArrayLike = math.inf,
    min_altitude_m: ArrayLike = 0.0,
    complete: ArrayLike = True,
    battery_wh: float = math.inf,
) -> list[Excess]:
    """Excesses of flights, in the order of `KINDS`. Metrics by name, (k,) each; (k,) or one number: what the
    mission of each promises and allows, m, and whether it was flown to its end. `battery_wh`: energy of a
    full battery.
    """
    names = "clearance_m clearance_reserve_m altitude_smallest_m depth_smallest_m depth_largest_m"
    clear, beyond, altitude, shallowest, deepest, pitch = (
        np.asarray(metrics[name], dtype=float) for name in f"{names} pitch_largest_deg".split()
    )
    energy = np.asarray(metrics.get("energy_wh", np.zeros_like(clear)), dtype=float)
    # What came nearest to being broken may be an obstacle without a promise: then zero is the limit.
    promised = np.where(beyond < clear - SETTINGS.rounding_m, np.asarray(promised_m, dtype=float), 0.0)
    down = touched(metrics)
    # By kind: which flights, the value that is told, what is smallest in the worst flight, and the limit.
    kinds: dict[str, tuple[Mask, Array, Array, ArrayLike]] = {
        "too_near": (too_near(metrics, promised_m), clear, beyond, promised),
        "bottom_touched": (down, altitude, altitude, 0.0),
        "too_low": (too_low(metrics, min_altitude_m) & ~down, altitude, altitude, min_altitude_m),
        "too_deep": (too_deep(metrics, max_depth_m), deepest, -deepest, max_depth_m),
        "above_surface": (shallowest < -SETTINGS.in_the_air_m, shallowest, shallowest, 0.0),
        "too_steep": (pitch > SETTINGS.steep_deg, pitch, -pitch, SETTINGS.steep_deg),
        "not_complete": (
            np.broadcast_to(~np.asarray(complete, dtype=bool), clear.shape),
            np.full_like(clear, math.nan),
            np.arange(len(clear), dtype=float),
            math.nan,
        ),
        "battery": (energy > battery_wh, energy, -energy, battery_wh),
    }
    exceeded = []
    for kind, (mask, value, least, limit) in kinds.items():
        if mask.any():
            k = int(np.argmin(np.where(mask, least, math.inf)))
            when, of = KINDS[kind].time, len(mask)
            at_s = float(metrics[when][k]) if when else math.nan
            broken = float(np.broadcast_to(limit, mask.shape)[k])
            exceeded.append(Excess(kind, int(mask.sum()), of, k, float(value[k]), broken, at_s))
    return exceeded
