"""Trials: recordings read, corrected and put on one time base; and such that were generated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.trial.generated import Recipe as Recipe
    from seatrial.trial.truth import Truth as Truth

__all__ = ["Recipe", "Truth"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"Recipe": "generated", "Truth": "truth"})
