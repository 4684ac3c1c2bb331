"""Diagnosis of an estimate: uncertainty, identifiability, residual analysis, missing terms, advice."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seatrial.base.front import front

if TYPE_CHECKING:
    from seatrial.diagnosis.assessment import Assessment as Assessment
    from seatrial.diagnosis.assessment import assess as assess
    from seatrial.diagnosis.assessment import bootstrap as bootstrap
    from seatrial.diagnosis.assessment import conditioning as conditioning
    from seatrial.diagnosis.assessment import profile as profile
    from seatrial.diagnosis.identifiability import judge as judge
    from seatrial.diagnosis.identifiability import warnings_before as warnings_before
    from seatrial.diagnosis.residual_analysis import analyse_joint as analyse_joint

_HOMES = {
    "Assessment": "assessment",
    "analyse_joint": "residual_analysis",
    "assess": "assessment",
    "bootstrap": "assessment",
    "conditioning": "assessment",
    "judge": "identifiability",
    "profile": "assessment",
    "warnings_before": "identifiability",
}

__all__ = sorted(_HOMES)

if not TYPE_CHECKING:  # a type checker would take any misspelt name for `object`
    __getattr__ = front(__name__, _HOMES)
