"""A campaign before it runs: its trials' recordings, its stages' data, its inputs and scale, refusals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from seatrial.base.errors import SeatrialError
from seatrial.base.plain import Plain
from seatrial.base.report import Reported, sentence_of
from seatrial.inspect.consistency import Proposal, consistency_of_recording, proposals
from seatrial.inspect.corrections import NO_MOTION
from seatrial.inspect.kind_of_data import KindOfData, kind_of_data
from seatrial.intake.imported import clocks_proposed

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.estimation.inputs import InputJudgement
    from seatrial.estimation.scale import ScaleReport
    from seatrial.inspect.corrections import Consistency
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
class CampaignCheck(Reported, Plain, without="reports kinds", also="trials=reports kind_of_data=kinds"):
    """Recording reports by trial, stages in the order of their run, and what stops the campaign.

    ``inputs`` and ``scale`` say what the inputs can tell and what the scale of all forces rests on; None
    where a problem is found before. ``warnings`` is what an identification says before its first search,
    ``kinds`` by trial what kind of data it is, ``data`` the same in sentences, ``consistency`` by trial
    whether its channels tell one motion, ``proposals`` what of it to paste into the campaign.
    """

    name: str
    vehicle: str
    reports: dict[str, RecordingReport]
    stages: tuple[StageOutline, ...]
    inputs: InputJudgement | None
    scale: ScaleReport | None
    problems: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    kinds: Mapping[str, KindOfData] = field(default_factory=dict)
    data: tuple[str, ...] = ()
    consistency: Mapping[str, Consistency] = field(default_factory=dict)
    proposals: tuple[Proposal, ...] = ()


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
    warnings: tuple[str, ...] = ()
    asked = campaign.problem()
    if not problems and asked.stages:
        try:
            inputs, scale = judge_inputs(asked), judge_scale(asked)
            ready = prepare(asked)
            warnings = (*ready.sentences, *ready.no_joint)
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
    unlike = [
        f"WARNING: trial {name}: {sentence}"
        for name, consistency in consistencies.items()
        for sentence in consistency.contradictions
    ]
    return CampaignCheck(
        campaign.name,
        campaign.vehicle.name,
        reports,
        stages,
        inputs,
        scale,
        tuple(problems),
        (*unlike, *warnings),
        kinds,
        _data(campaign, kinds) if kinds else (),
        consistencies,
        proposals(consistencies, reports, clocks_proposed(campaign.folder)),
    )


def _data(campaign: Campaign, kinds: Mapping[str, KindOfData]) -> tuple[str, ...]:
    """What kind of data the trials are, the worst first; then hold-outs for trials that have none."""
    stages = campaign.problem().stages
    fitted = {name for stage in stages for name in stage.trials}
    lines = [f"trial {name}: {sentence}" for name, kind in kinds.items() for sentence in kind.warnings]
    for stage in stages:
        for axis in stage.axes.free:
            seen = [
                excited for name in stage.trials for excited in kinds[name].excitation if excited.axis == axis
            ]
            if seen and all(excited.weak for excited in seen):
                most = max(seen, key=lambda excited: excited.over_noise)
                lines.append(
                    f"stage {stage.name}: {most.channel} hardly moves in {', '.join(stage.trials)}"
                    f" ({most.over_noise:.1f} times its noise): record a manoeuvre, or leave axis {axis} out"
                )
    still = sentence_of(NO_MOTION, "consistency")
    lines += [f"trial {name}: {still}" for name, kind in kinds.items() if kind.still]
    lines += [f"trial {name}: {kind.done}" for name, kind in kinds.items()]
    split = [name for name in kinds if not campaign.source_of(name).hold_out_s and name in fitted]
    return (*lines, *(f"trial {name}: {kinds[name].windows.sentence}" for name in split))
