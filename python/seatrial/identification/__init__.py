"""Identification of a vehicle from its trials."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.identification.noise_of_filter import FilterNoise as FilterNoise
    from seatrial.identification.noise_of_filter import filter_noise as filter_noise

__all__ = ["FilterNoise", "filter_noise"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"FilterNoise": "noise_of_filter", "filter_noise": "noise_of_filter"})
