"""A campaign before it runs: its trials' recordings, its stages' data, its inputs and scale, refusals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seatrial.base.errors import SeatrialError
from seatrial.base.report import Report, Section, Table
from seatrial.trial.feedback import feedback
from seatrial.trial.waves import waves

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.estimation.inputs import InputJudgement
    from seatrial.estimation.scale import ScaleReport
    from seatrial.trial.signals import RecordingReport
    from seatrial.trial.trial import Trial

__all__ = ["CampaignCheck", "StageOutline", "check_campaign"]


_READY = {True: "Ready to identify", False: "Nothing to identify: it only tunes or verifies an autopilot"}


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
    where a problem is found before. ``warnings`` is what an identification says before its first search,
    ``disturbances`` what closed loops and waves the recordings show.
    """

    name: str
    vehicle: str
    reports: dict[str, RecordingReport]
    stages: tuple[StageOutline, ...]
    inputs: InputJudgement | None
    scale: ScaleReport | None
    problems: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    disturbances: tuple[str, ...] = ()

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
            "warnings": list(self.warnings),
            "disturbances": list(self.disturbances),
        }

    def report(self) -> Report:
        """Whether it is ready, the worst problem, what to do next; then trials, stages, inputs, scale."""
        return _report(self)

    def summary(self) -> str:
        """The report as text."""
        return self.report().text()


def _report(check: CampaignCheck) -> Report:
    """Three lines, trials, stages, inputs; what was found about each trial as details."""
    worst, next_step = _worst(check)
    inputs = () if check.inputs is None else tuple(check.inputs.sentences())
    scale = () if check.scale is None else tuple(check.scale.sentences())
    free = tuple(f"{stage.name}: {', '.join(stage.coefficients)}" for stage in check.stages)
    findings = tuple(
        Section(f"Trial {name}", tuple(str(report).splitlines()), details=True)
        for name, report in check.reports.items()
    )
    samples = sum(stage.samples for stage in check.stages)
    minutes = sum(report.duration_s for report in check.reports.values()) / 60.0
    count = sum(len(stage.coefficients) for stage in check.stages)
    return Report(
        title=check.name,
        outcome="not ready" if check.problems else _READY[bool(check.stages)],
        good=(
            f"{len(check.reports)} trials of {check.vehicle} ({minutes:.0f} min); {len(check.stages)} stages"
            f" free {count} coefficients on {samples} samples"
        ),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(sentences=(*check.problems, *check.warnings)),
            Section(sentences=free, tables=(_trial_table(check), _stage_table(check))),
            Section("Closed loops and waves", check.disturbances),
            Section("Inputs over what is fitted", inputs, (_input_table(check),)),
            Section("Scale of all forces", scale),
            *findings,
        ),
    )


def _worst(check: CampaignCheck) -> tuple[str, str]:
    """The worst problem of a campaign, and what to do about it."""
    if check.problems:
        return check.problems[0], "correct the campaign or the recording and check again"
    identify = "run seatrial identify on this campaign"
    if not check.stages:
        identify = "run seatrial tune or seatrial verify on this campaign"
    for severity in ("error", "warning"):
        for name, report in check.reports.items():
            for finding in report.findings:
                if finding.severity == severity:
                    text = str(finding).removeprefix(severity).strip()
                    return (
                        f"trial {name}: {text}",
                        f"correct the trial or its column map if it is used; then {identify}",
                    )
    said = [] if check.scale is None else check.scale.sentences()
    for sentence in (*check.warnings, *([] if check.inputs is None else check.inputs.sentences()), *said):
        if sentence.startswith("WARNING"):
            return sentence.removeprefix("WARNING").strip(" :"), f"settle this first; then {identify}"
    return "no warning about recordings, inputs or scale", identify


def _trial_table(check: CampaignCheck) -> Table:
    rows = [
        (
            name,
            f"{report.duration_s:.1f}",
            f"{report.rate_hz:.4g}",
            str(report.samples),
            str(max(report.masked.values(), default=0)),
            str(sum(finding.severity != "info" for finding in report.findings) or ""),
        )
        for name, report in check.reports.items()
    ]
    return Table.of("Trials", ("trial", "duration, s", "rate, Hz", "samples", "masked", "warnings"), rows)


def _stage_table(check: CampaignCheck) -> Table:
    rows = [
        (
            stage.name,
            ", ".join(stage.trials),
            stage.free,
            str(len(stage.coefficients)),
            str(stage.segments),
            str(stage.samples),
            f"{1e3 * stage.step_s:.3g}",
        )
        for stage in check.stages
    ]
    head = ("stage", "trials", "free", "coefficients", "segments", "samples", "step, ms")
    return Table.of("Stages in the order of their run", head, rows, left=3)


def _input_table(check: CampaignCheck) -> Table:
    drives = () if check.inputs is None else check.inputs.drives
    rows = [(one.actuator, one.group, f"{one.rms_n:.3g}", f"{100.0 * one.ahead:.0f}") for one in drives]
    head = ("actuator", "group", "thrust about its mean, N", "impulse ahead, %")
    return Table.of("", head, rows, left=2)


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
    if not problems and campaign.stages:
        try:
            inputs, scale = judge_inputs(campaign), judge_scale(campaign)
            ready = prepare(campaign) if campaign.stages else None
            warnings = () if ready is None else (*ready.sentences, *ready.no_joint)
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
                for one in (() if ready is None else ready.plans)
            )
        except SeatrialError as error:
            problems.append(str(error))
    disturbances = tuple(
        f"trial {name}: {sentence}" for name in reports for sentence in _disturbances(campaign.trials[name])
    )
    return CampaignCheck(
        campaign.name,
        campaign.vehicle.name,
        reports,
        stages,
        inputs,
        scale,
        tuple(problems),
        warnings,
        disturbances,
    )


def _disturbances(trial: Trial) -> list[str]:
    """Sentences on closed loops and waves in a recording."""
    sentences = []
    closed = [one for one in feedback(trial) if one.closed]
    if closed:
        loops = "; ".join(
            f"{one.command} follows {one.channel} ({100.0 * one.explained:.0f} % of its changes)"
            for one in sorted(closed, key=lambda one: -one.explained)
        )
        sentences.append(
            f"recorded in closed loop: {loops}. A fit on such data may bend gains and damping, and its score"
            " also rates the controller: add a trial with preset steps of these actuators"
        )
    found = waves(trial)
    if found is not None:
        unit = dict.fromkeys("uvw", "m/s") | {"z": "m"} | dict.fromkeys("pqr", "rad/s")
        sizes = ", ".join(
            f"{channel} {size:.2g} {unit.get(channel, 'rad')}" for channel, size in found.amplitude.items()
        )
        sentences.append(
            f"an oscillation with a period of {found.period_s:.1f} s, as of waves (amplitude {sizes}), which"
            " no command explains; the model takes it for its own error"
        )
    return sentences
