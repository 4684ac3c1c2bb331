"""Keys of ``[motors.NAME]`` that an identified motor gives, scored on its records before they are written.

Only what is determined is written, so that merging keeps the rest. But the file lets an absent key follow
its partner (astern as ahead, shrinking as growing). Where only one rate limit is determined, the other is
taken as the vehicle had it, left to follow, left out with its partner, or, last, written as the least that
the records allow: the first of these whose motor follows the records about as well as the best does. A limit
that the records merely bound can be far below the motor's own. The file has one rate limit for both
directions: the mean of the two, weighted by their precision. Held by
``tests/bench_test/test_motor_table.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from seatrial.bench_test.motor_estimate import Directions, MotorParameter, WrittenMotor
from seatrial.bench_test.motor_model import SIDES, MotorModel, StepRecord

Keys = dict[str, float | str]

_KEYS = {"n_max_ahead": "maximum_ahead", "n_max_astern": "maximum_astern", "n_min_ahead": "minimum_ahead"}

_KEYS |= {"n_min_astern": "minimum_astern", "K_V": "K_V", "T_1": "T_1_s", "T_t": "T_t_s"}

_PARTNER = {"n_acc": "n_dec", "n_dec": "n_acc"}

_AS_WELL = 1.1  # root mean square errors that are about as small as the smallest


def written_motor(
    parameters: Mapping[str, MotorParameter],
    directions: Sequence[Directions],
    below_minimum: str | None,
    records: Sequence[StepRecord],
    start: Mapping[str, Any],
) -> WrittenMotor:
    """What to write of a motor, chosen by how the motor of the file would follow the records.

    Parameters
    ----------
    parameters : mapping
        By name.
    directions : sequence of Directions
    below_minimum : str, optional
        "lift" or "zero", where the records tell.
    records : sequence of StepRecord
    start : mapping
        The entry of the vehicle file into which the keys are merged.
    """
    base = _static_keys(parameters, below_minimum)
    limits = {limit: _common(limit, parameters, directions) for limit in _PARTNER}
    found: Keys = {f"{limit}_per_s": rate for limit, rate in limits.items() if rate is not None}
    choices: list[tuple[Keys, str | None]] = [(base | found, None)]
    missing = [limit for limit, rate in limits.items() if rate is None]
    if len(missing) == 1:
        key, both = f"{missing[0]}_per_s", [parameters[f"{missing[0]}_{side}"] for side in SIDES]
        kept = both[0].kept
        if kept is not None and math.isfinite(kept):
            choices.insert(0, (base | found | {key: kept}, None))
        choices.append((dict(base), None))
        least = [one.at_least for one in both if one.at_least is not None]
        if least:
            choices.append((base | found | {key: float(f"{max(least):.3g}")}, key))
    errors = [_rms(MotorModel.from_table(dict(start) | table), records) for table, _ in choices]
    best = next(k for k, error in enumerate(errors) if error <= _AS_WELL * min(errors))
    scatter = float(np.std(np.concatenate([record.sampled[1] for record in records])))
    r2 = 1.0 - (errors[best] / scatter) ** 2 if scatter > 0.0 else math.nan
    return WrittenMotor(choices[best][0], r2, choices[best][1])


def _rms(model: MotorModel, records: Sequence[StepRecord]) -> float:
    """Root mean square error of a motor over records."""
    errors = [record.sampled[1] - model.response(record, record.sampled[0]) for record in records]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))


def _static_keys(parameters: Mapping[str, MotorParameter], below_minimum: str | None) -> Keys:
    """Keys but those of the rate limits, with their values rounded to their precision."""
    table: Keys = {}
    for name, key in _KEYS.items():
        one = parameters[name]
        if one.value is not None:
            table[key] = _rounded(one.value, one.sigma)
    for limit in ("maximum", "minimum"):
        astern = parameters[f"n_{limit[:3]}_astern"]
        missing = f"{limit}_ahead" in table and f"{limit}_astern" not in table
        if missing and astern.kept is not None and math.isfinite(astern.kept) and not astern.contradicted:
            table[f"{limit}_astern"] = astern.kept
    if below_minimum is not None:
        table["below_minimum"] = below_minimum
    return table


def _common(
    limit: str, parameters: Mapping[str, MotorParameter], directions: Sequence[Directions]
) -> float | None:
    """One rate limit for both directions, of those that are determined."""
    for pair in directions:
        if pair.name == limit:
            return _rounded(pair.pooled, pair.sigma)
    values = [one for side in SIDES if (one := parameters[f"{limit}_{side}"]).value is not None]
    return _rounded(values[0].value or 0.0, values[0].sigma) if values else None


def _rounded(value: float, sigma: float | None) -> float:
    """Value to a tenth of its standard deviation or finer; to four digits where there is none."""
    if sigma is None:
        return float(f"{value:.4g}")
    if not sigma > 0:
        return value
    return round(value, 1 - math.floor(math.log10(sigma)))
