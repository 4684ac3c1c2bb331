"""Control design: trim, loop models, margins, start gains, linear-quadratic regulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.control_design.lqr import Tolerances as Tolerances
    from seatrial.control_design.lqr import design_lqr as design_lqr
    from seatrial.control_design.lqr import lqr_autopilot as lqr_autopilot
    from seatrial.control_design.margin_report import autopilot_margins as autopilot_margins
    from seatrial.control_design.margin_report import sound_speeds as sound_speeds
    from seatrial.control_design.start_gains import physical_gains as physical_gains

__all__ = ["Tolerances", "autopilot_margins", "design_lqr", "lqr_autopilot", "physical_gains", "sound_speeds"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "Tolerances": "lqr",
            "autopilot_margins": "margin_report",
            "design_lqr": "lqr",
            "lqr_autopilot": "lqr",
            "physical_gains": "start_gains",
            "sound_speeds": "margin_report",
        },
    )
