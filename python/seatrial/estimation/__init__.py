"""Estimation of coefficients: stages, global search, joint estimate, scale of the forces."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.estimation.inputs import judge_inputs as judge_inputs
    from seatrial.estimation.joint import Joint as Joint
    from seatrial.estimation.joint_estimate import linearise as linearise
    from seatrial.estimation.joint_estimate import polish as polish
    from seatrial.estimation.scale import judge_scale as judge_scale

__all__ = ["Joint", "judge_inputs", "judge_scale", "linearise", "polish"]

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(
        __name__,
        {
            "Joint": "joint",
            "judge_inputs": "inputs",
            "judge_scale": "scale",
            "linearise": "joint_estimate",
            "polish": "joint_estimate",
        },
    )
