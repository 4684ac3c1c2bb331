"""Reports and figures of results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.report.plot.bench import bollard_test as bollard_test
    from seatrial.report.plot.flight_errors import flight_gallery as flight_gallery
    from seatrial.report.plot.mission_log import log_verdict_gallery as log_verdict_gallery

__all__ = ["bollard_test", "flight_gallery", "log_verdict_gallery"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "bollard_test": "plot.bench",
            "flight_gallery": "plot.flight_errors",
            "log_verdict_gallery": "plot.mission_log",
        },
    )
