"""What an identification is asked: vehicle, trials, free coefficients, stages, joint estimate, anchors."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.problem.problem import Problem as Problem
    from seatrial.problem.settings import Anchor as Anchor
    from seatrial.problem.settings import JointSettings as JointSettings
    from seatrial.problem.settings import Stage as Stage
    from seatrial.problem.settings import TrialUse as TrialUse

__all__ = ["Anchor", "JointSettings", "Problem", "Stage", "TrialUse"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "Anchor": "settings",
            "JointSettings": "settings",
            "Problem": "problem",
            "Stage": "settings",
            "TrialUse": "settings",
        },
    )
