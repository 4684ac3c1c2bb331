"""A trial sampled more slowly: what a log of a lower rate would have shown of the same motion.

Commands between two samples are not known and count as held; smoothed states err more. A model that holds
misses a slow log further than a fast one, so a reference is thinned to the log's rate before its errors are
taken.

Tests: ``tests/test_recorded_campaign.py``.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from seatrial.trial import Trial

__all__ = ["thinned"]

_FASTER = 1.5


def thinned(trial: Trial, dt: float) -> Trial:
    """Trial with every n-th of its samples, as far apart as `dt`, s; the trial itself where it is no faster.

    Parameters
    ----------
    trial : Trial
    dt : float
        Interval of the log that it stands beside, s.
    """
    if dt < _FASTER * trial.dt:
        return trial
    every, count = round(dt / trial.dt), len(trial)

    def of(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: of(one) for name, one in value.items()}
        return value[::every] if isinstance(value, np.ndarray) and len(value) == count else value

    kept = {one.name: of(getattr(trial, one.name)) for one in dataclasses.fields(trial)}
    return type(trial)(**kept)
