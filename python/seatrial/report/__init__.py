"""Reports and figures of results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.report.plot import gallery as gallery

__all__ = ["gallery"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"gallery": "plot"})
