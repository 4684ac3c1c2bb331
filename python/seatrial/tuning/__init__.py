"""Tuning of an autopilot by corridors of its set-point responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.tuning.relay import relay_autopilot as relay_autopilot

__all__ = ["relay_autopilot"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"relay_autopilot": "relay"})
