"""A campaign before it runs: its trials' recordings, its stages' data, its inputs and scale, refusals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seatrial.base.errors import SeatrialError

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.estimation.inputs import InputJudgement
    from seatrial.estimation.scale import ScaleReport
    from seatrial.trial.signals import RecordingReport

__all__ = ["CampaignCheck", "StageOutline", "check_campaign"]


@dataclass(frozen=True)
class StageOutline:
    """A stage in numbers: segments and samples that count, the step in s, the free coefficients."""

    name: str
    trials: tuple[str, ...]
    free: str
    coefficients: tuple[str, ...]
    segments: int
    samples: int
    step_s: float


@dataclass(frozen=True)
class CampaignCheck:
    """Recording reports by trial, stages in the order of their run, and what stops the campaign.

    ``inputs`` and ``scale`` say what the inputs can tell and what the scale of all forces rests on; None
    where a problem is found before.
    """

    name: str
    vehicle: str
    reports: dict[str, RecordingReport]
    stages: tuple[StageOutline, ...]
    inputs: InputJudgement | None
    scale: ScaleReport | None
    problems: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """The check as plain data for JSON."""
        return {
            "name": self.name,
            "vehicle": self.vehicle,
            "trials": {name: report.to_dict() for name, report in self.reports.items()},
            "stages": [vars(stage) for stage in self.stages],
            "inputs": self.inputs.to_dict() if self.inputs else None,
            "scale": self.scale.to_dict() if self.scale else None,
            "problems": list(self.problems),
        }


def check_campaign(campaign: Campaign) -> CampaignCheck:
    """Check of a campaign: every trial is read, every stage planned, nothing is run.

    Examples
    --------
    >>> import seatrial as st
    >>> check_campaign(st.Campaign.load("examples/cwolf/campaign.toml")).problems  # doctest: +SKIP
    ()
    """
    from seatrial.estimation.inputs import judge_inputs
    from seatrial.estimation.scale import judge_scale
    from seatrial.estimation.stage import plan

    reports: dict[str, RecordingReport] = {}
    problems: list[str] = []
    for name in campaign.trials:
        try:
            reports[name] = campaign.trials[name].report
        except SeatrialError as error:
            problems.append(str(error))
    stages: tuple[StageOutline, ...] = ()
    inputs, scale = None, None
    if not problems:
        try:
            inputs, scale = judge_inputs(campaign), judge_scale(campaign)
            stages = tuple(
                StageOutline(
                    name=one.stage.name,
                    trials=one.stage.trials,
                    free=one.stage.axes.free,
                    coefficients=tuple(parameter.name for parameter in one.parameters),
                    segments=len(one.data.segments),
                    samples=one.data.samples,
                    step_s=one.data.dt / one.step.substeps,
                )
                for one in plan(campaign)
            )
        except SeatrialError as error:
            problems.append(str(error))
    return CampaignCheck(
        campaign.name, campaign.vehicle.name, reports, stages, inputs, scale, tuple(problems)
    )
