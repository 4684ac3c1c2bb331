"""The words of a campaign's check: trials, stages, channels that contradict one another."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from seatrial.base.finding import Severity
from seatrial.base.report import Report, Section, Table, sentence_of
from seatrial.check.campaign import CampaignCheck
from seatrial.inspect.consistency import accepted
from seatrial.inspect.corrections import NO_MOTION
from seatrial.report.results import trial_findings
from seatrial.report.results.consistency import correction_table, current_sentence

if TYPE_CHECKING:
    from seatrial.inspect.corrections import Consistency


_READY = {True: "Ready to identify", False: "Nothing to identify: it only tunes or verifies an autopilot"}


def report(check: CampaignCheck) -> Report:
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
            f"{len(check.reports)} trial{'s' if len(check.reports) != 1 else ''} of {check.vehicle}"
            f" ({minutes:.0f} min); {len(check.stages)} stages free {count} coefficients on {samples} samples"
        ),
        worst=worst,
        next_step=next_step,
        sections=(
            Section(sentences=(*check.problems, *check.warnings)),
            Section(sentences=free, tables=(_trial_table(check), _stage_table(check))),
            Section(
                # More are among the details.
                "Corrections proposed",
                tuple(proposal.text for proposal in check.proposals[:6]),
            ),
            Section("Kind of data", check.data),
            Section("Inputs over what is fitted", inputs, (_input_table(check),)),
            Section("Scale of all forces", scale),
            *findings,
            *(_consistency(name, consistency) for name, consistency in check.consistency.items()),
            *(Section(f"Motion of trial {n}", k.details, details=True) for n, k in check.kinds.items()),
        ),
    )


def warnings(check: CampaignCheck) -> list[str]:
    """Channels that contradict one another, then what an identification says before its first search."""
    unlike = [
        f"WARNING: trial {name}: {sentence}"
        for name, consistency in check.consistency.items()
        for sentence in consistency.contradictions
    ]
    return [*unlike, *check.prepared]


def data(check: CampaignCheck) -> list[str]:
    """What kind of data the trials are, the worst first; then hold-outs for trials that have none."""
    kinds = check.kinds
    lines = [f"trial {name}: {sentence}" for name, kind in kinds.items() for sentence in kind.warnings]
    for weak in check.weak:
        most, trials = weak["most"], ", ".join(weak["trials"])
        lines.append(
            f"stage {weak.subject}: {most.channel} hardly moves in {trials} ({most.over_noise:.1f} times its"
            f" noise): record a manoeuvre, or leave axis {weak['axis']} out"
        )
    still = sentence_of(NO_MOTION, "consistency")
    lines += [f"trial {name}: {still}" for name, kind in kinds.items() if kind.still]
    lines += [f"trial {name}: {kind.done}" for name, kind in kinds.items()]
    return [*lines, *(f"trial {name}: {kinds[name].windows.sentence}" for name in check.unsplit)]


def _consistency(name: str, consistency: Consistency) -> Section:
    """Everything about the channels of one trial, as details."""
    statements = [*(correction.sentence for correction in consistency.corrections), *consistency.missing]
    if (current := accepted(consistency)) is not None:
        statements.append(
            f"a slow current, {current_sentence(current)}: [trials.{name}.corrections] {current.line}"
        )
    return Section(
        f"Consistency of trial {name}", tuple(statements), (correction_table(consistency),), details=True
    )


def _worst(check: CampaignCheck) -> tuple[str, str]:
    """The worst problem of a campaign, and what to do about it."""
    if check.problems:
        return check.problems[0], "correct the campaign or the recording and check again"
    identify = "run seatrial identify on this campaign"
    if not check.stages:
        identify = "run seatrial tune or seatrial verify on this campaign"
    correct = f"correct the trial or its column map if it is used; then {identify}"
    findings = [
        (finding, f"trial {name}: {finding.line}")
        for name, report in check.reports.items()
        for finding in report.findings
    ]
    open_ = [proposal.text for proposal in check.proposals if not proposal.done]
    unlike = [
        f"trial {name}: {contradiction}"
        for name, channels in check.consistency.items()
        for contradiction in channels.contradictions
    ]
    impossible = [
        replace(finding, subject=name) for name, kind in check.kinds.items() for finding in kind.impossible
    ]
    mapped = [text for finding, text in findings if finding.kind in ("uncommanded", "mostly masked")]
    if (
        text := next((text for finding, text in findings if finding.severity == Severity.PROBLEM), None)
    ) is not None:
        return text, correct
    if unlike:
        return unlike[0], correct
    if impossible:
        problem, remedy = trial_findings.problem(impossible[0]), trial_findings.remedy(impossible[0])
        return problem, f"{remedy}; then {identify}"
    if mapped:
        return mapped[0], correct
    if open_:
        return open_[0], f"paste the corrections that you accept into the campaign; then {identify}"
    if warned := [text for finding, text in findings if finding.severity == Severity.WEAKNESS]:
        return warned[0], correct
    scale_sentences = [] if check.scale is None else check.scale.sentences()
    for sentence in (
        *check.warnings,
        *([] if check.inputs is None else check.inputs.sentences()),
        *scale_sentences,
    ):
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
            str(sum(finding.severity > Severity.NOTE for finding in report.findings) or ""),
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
    rows = [
        (drive.actuator, drive.group, f"{drive.rms_n:.3g}", f"{100.0 * drive.ahead:.0f}") for drive in drives
    ]
    head = ("actuator", "group", "thrust about its mean, N", "impulse ahead, %")
    return Table.of("", head, rows, left=2)
