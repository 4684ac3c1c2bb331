"""Reports and figures of results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.report.plot import gallery as gallery
    from seatrial.report.plot.bench import bollard_test as bollard_test

__all__ = ["bollard_test", "gallery"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, {"bollard_test": "plot.bench", "gallery": "plot"})
