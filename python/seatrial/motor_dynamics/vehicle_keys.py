"""Keys of the vehicle file's ``[motors.NAME]`` that an identified motor gives.

Only what is determined is written, so that merging keeps the rest. But the file lets an absent key follow its
partner (astern as ahead, shrinking as growing): where only one of the two is determined, the other is
written too, as the vehicle had it, or as the least rate that the records allow where it had none.
Held by `tests/test_motor_dynamics.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from seatrial.motor_dynamics.comparison import Directions
from seatrial.motor_dynamics.motor_model import SIDES
from seatrial.motor_dynamics.motor_parameter import MotorParameter

__all__ = ["rates", "vehicle_keys"]

_KEYS = {"n_max_ahead": "maximum_ahead", "n_max_astern": "maximum_astern", "n_min_ahead": "minimum_ahead"}
_KEYS |= {"n_min_astern": "minimum_astern", "K_V": "K_V", "T_1": "T_1_s", "T_t": "T_t_s"}
_PARTNER = {"n_acc": "n_dec", "n_dec": "n_acc"}


def vehicle_keys(
    parameters: Mapping[str, MotorParameter], directions: Sequence[Directions], below_minimum: str | None
) -> dict[str, float | str]:
    """Keys with their values, rounded to what the data tell."""
    table: dict[str, float | str] = {}
    for name, key in _KEYS.items():
        one = parameters[name]
        if one.value is not None and one.sigma is not None:
            table[key] = _rounded(one.value, one.sigma)
    for limit in ("maximum", "minimum"):
        kept = parameters[f"n_{limit[:3]}_astern"].kept
        missing = f"{limit}_ahead" in table and f"{limit}_astern" not in table
        if missing and kept is not None and math.isfinite(kept):
            table[f"{limit}_astern"] = kept
    for limit, (rate, _) in rates(parameters, directions).items():
        table[f"{limit}_per_s"] = rate
    if below_minimum is not None:
        table["below_minimum"] = below_minimum
    return table


def rates(
    parameters: Mapping[str, MotorParameter], directions: Sequence[Directions]
) -> dict[str, tuple[float, str]]:
    """Rate limits of the file by name, each with where it comes from: "found", "kept" or "least"."""
    found = {limit: _common(limit, parameters, directions) for limit in _PARTNER}
    written = {}
    for limit, partner in _PARTNER.items():
        both = [parameters[f"{limit}_{side}"] for side in SIDES]
        common, kept = found[limit], both[0].kept
        least = [one.at_least for one in both if one.at_least is not None]
        if common is not None:
            written[limit] = (common, "found")
        elif found[partner] is not None and kept is not None and math.isfinite(kept):
            written[limit] = (kept, "kept")
        elif found[partner] is not None and least:
            written[limit] = (float(f"{max(least):.3g}"), "least")
    return written


def _common(
    limit: str, parameters: Mapping[str, MotorParameter], directions: Sequence[Directions]
) -> float | None:
    """One rate limit for both directions, of those that are determined."""
    for pair in directions:
        if pair.name == limit:
            return _rounded(pair.pooled, pair.sigma)
    for side in SIDES:
        one = parameters[f"{limit}_{side}"]
        if one.value is not None and one.sigma is not None:
            return _rounded(one.value, one.sigma)
    return None


def _rounded(value: float, sigma: float) -> float:
    """Value to a tenth of its standard deviation or finer."""
    if not sigma > 0:
        return value
    return round(value, 1 - math.floor(math.log10(sigma)))
