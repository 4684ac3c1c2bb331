"""Logs of vehicles and middleware: topics with fields, read in chunks, joined on one clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.logs.log import open_log as open_log
    from seatrial.logs.recognise import propose as propose

__all__ = ["open_log", "propose"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"open_log": "log", "propose": "recognise"})
