"""The campaign file: what a person writes, read into a problem, and changed by a suggestion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.campaign.suggestion import follow as follow
    from seatrial.campaign.suggestion import try_suggestion as try_suggestion

__all__ = ["follow", "try_suggestion"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"follow": "suggestion", "try_suggestion": "suggestion"})
