"""A model against a trial: windows, predictions, baselines, noise limit, score, comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.scoring.windows import Predictions as Predictions

__all__ = ["Predictions"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"Predictions": "windows"})
