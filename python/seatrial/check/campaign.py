"""A campaign before it runs: its trials' recordings, its stages' data, its inputs and scale, refusals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from seatrial.base.errors import SeatrialError
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, writer_of
from seatrial.inspect.consistency import Proposal, consistency_of_recording, proposals
from seatrial.inspect.kind_of_data import KindOfData, kind_of_data
from seatrial.intake.imported import clocks_proposed

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.estimation.inputs import InputJudgement
    from seatrial.estimation.scale import ScaleReport
    from seatrial.inspect.corrections import Consistency
    from seatrial.problem.problem import Problem
    from seatrial.trial.signals import RecordingReport


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


@dataclass(frozen=True, repr=False)
class CampaignCheck(
    Reported,
    Plain,
    without="reports kinds prepared weak unsplit",
    also="warnings data trials=reports kind_of_data=kinds",
):
    """A campaign before it runs: recordings, stages in the order of their run, and what stops it."""

    name: str
    vehicle: str
    reports: dict[str, RecordingReport]  #: By trial.
    stages: tuple[StageOutline, ...]
    #: What the inputs can tell and what the scale of all forces rests on; None where a problem comes before.
    inputs: InputJudgement | None
    scale: ScaleReport | None
    problems: tuple[str, ...]
    prepared: tuple[str, ...] = ()  #: What an identification says before its first search.
    kinds: Mapping[str, KindOfData] = field(default_factory=dict)  #: By trial.
    consistency: Mapping[str, Consistency] = field(default_factory=dict)  #: By trial.
    proposals: tuple[Proposal, ...] = ()  #: What of it to paste into the campaign.
    weak: tuple[Finding, ...] = ()  #: Free axes that hardly move in the trials of their stage.
    unsplit: tuple[str, ...] = ()  #: Trials that are fitted and hold nothing out.

    @property
    def warnings(self) -> tuple[str, ...]:
        """Channels that contradict one another, and `prepared`."""
        return tuple(writer_of(self).warnings(self))

    @property
    def data(self) -> tuple[str, ...]:
        """What kind of data the trials are, in sentences."""
        return tuple(writer_of(self).data(self))


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
    from seatrial.identification.preparation import prepare

    reports: dict[str, RecordingReport] = {}
    problems: list[str] = []
    for name in campaign.trials:
        try:
            reports[name] = campaign.trials[name].report
        except SeatrialError as error:
            problems.append(str(error))
    stages: tuple[StageOutline, ...] = ()
    inputs, scale = None, None
    prepared: tuple[str, ...] = ()
    asked = campaign.problem()
    if not problems and asked.stages:
        try:
            inputs, scale = judge_inputs(asked), judge_scale(asked)
            ready = prepare(asked)
            prepared = (*ready.sentences, *ready.no_joint)
            stages = tuple(
                StageOutline(
                    name=plan.stage.name,
                    trials=plan.stage.trials,
                    free=plan.stage.axes.free,
                    coefficients=tuple(parameter.name for parameter in plan.parameters),
                    segments=len(plan.data.segments),
                    samples=plan.data.samples,
                    step_s=plan.data.dt / plan.step.substeps,
                )
                for plan in ready.plans
            )
        except SeatrialError as error:
            problems.append(str(error))
    kinds: dict[str, KindOfData] = {}
    consistencies: dict[str, Consistency] = {}
    if not problems:
        kinds = {name: kind_of_data(campaign.trials[name], campaign.vehicle) for name in reports}
        for name in reports:
            if (recording := asked.recordings[name]) is not None:  # a trial that was given has none
                consistency = consistency_of_recording(recording)
                consistencies[name] = consistency.without_motion() if kinds[name].still else consistency
    fitted = {name for stage in asked.stages for name in stage.trials}
    return CampaignCheck(
        campaign.name,
        campaign.vehicle.name,
        reports,
        stages,
        inputs,
        scale,
        tuple(problems),
        prepared,
        kinds,
        consistencies,
        proposals(consistencies, reports, clocks_proposed(campaign.folder)),
        tuple(_weak(asked, kinds)) if kinds else (),
        tuple(n for n in kinds if n in fitted and not campaign.source_of(n).hold_out_s),
    )


def _weak(asked: Problem, kinds: Mapping[str, KindOfData]) -> Iterator[Finding]:
    """Free axes that hardly move in any trial of their stage."""
    for stage in asked.stages:
        for axis in stage.axes.free:
            seen = [moved for name in stage.trials for moved in kinds[name].excitation if moved.axis == axis]
            if seen and all(moved.weak for moved in seen):
                most = max(seen, key=lambda moved: moved.over_noise)
                values = {"axis": axis, "trials": stage.trials, "most": most}
                yield Finding("axis hardly moves", Severity.WEAKNESS, stage.name, values)
