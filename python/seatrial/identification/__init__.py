"""Identification of a vehicle from the trials of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.identification.noise_of_filter import FilterNoise as FilterNoise
    from seatrial.identification.noise_of_filter import filter_noise as filter_noise
    from seatrial.identification.suggestion import follow as follow
    from seatrial.identification.suggestion import try_suggestion as try_suggestion

__all__ = ["FilterNoise", "filter_noise", "follow", "try_suggestion"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "FilterNoise": "noise_of_filter",
            "filter_noise": "noise_of_filter",
            "follow": "suggestion",
            "try_suggestion": "suggestion",
        },
    )
