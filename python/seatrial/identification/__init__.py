"""Identification of a vehicle from its trials."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.identification.fitted import filter_noise as filter_noise
    from seatrial.identification.hold_out import FilterNoise as FilterNoise

__all__ = ["FilterNoise", "filter_noise"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"FilterNoise": "hold_out", "filter_noise": "fitted"})
