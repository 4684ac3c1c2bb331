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

_HOMES = {"Problem": "problem"} | dict.fromkeys(("Anchor", "JointSettings", "Stage", "TrialUse"), "settings")

__all__ = sorted(_HOMES)

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, _HOMES)
