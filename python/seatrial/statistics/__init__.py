"""Statistics of dependent errors: blocks, information, score tests, exact intervals, multiple testing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.statistics.blocks import information_criteria as information_criteria
    from seatrial.statistics.linearisation import Linearisation as Linearisation
    from seatrial.statistics.uncertainty import covariance as covariance

__all__ = ["Linearisation", "covariance", "information_criteria"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {"Linearisation": "linearisation", "covariance": "uncertainty", "information_criteria": "blocks"},
    )
