"""The words of a survey and of an import: fields, trials that were cut, channels found, what was left out."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import singledispatch

from seatrial.base.channels import CHANNELS
from seatrial.base.errors import printable
from seatrial.base.finding import Severity
from seatrial.base.report import Report, Section, Table, words_of
from seatrial.inspect.consistency import proposals
from seatrial.intake.imported import Imported, ImportedTrial
from seatrial.intake.survey import Survey, chosen
from seatrial.intake.vehicle_draft import opposed


@dataclass(frozen=True)
class ImportWordsSettings:
    """How much of an import is listed, and what is too short."""

    shown: int = 10  #: Problems; the others are details.
    named: int = 4  #: Fields of a log that are not used.
    shortest_s: float = 10.0  #: Of a segment of a stage, unless the campaign says otherwise, s.


SETTINGS = ImportWordsSettings()


@singledispatch
def report(result: object) -> Report:
    """Report of an import, or of a survey of logs."""
    raise TypeError(f"expected an import or a survey, found {type(result).__name__}")


@report.register
def _imported(made: Imported) -> Report:
    """Three lines, columns, trials, doubts and what is missing; every field as a detail."""
    problems = list(dict.fromkeys(_problems(made)))
    seconds = sum(float(imported.trial.t[-1] - imported.trial.t[0]) for imported in made.trials)
    count = len(made.trials)
    partial = any(log.notes for log in made.survey.logs)
    partial |= bool(made.refused or _left_out(made) or _lost(made))
    actuators = sum(name.startswith("cmd.") for name in made.columns)
    channels = [c for c in CHANNELS if any(c in imported.trial.channels for imported in made.trials)]
    # What was done in each trial, and what of it judges the result.
    done = tuple(f"trial {each.name}: {each.kind.done}; {each.why}" for each in made.trials)
    reports = {imported.name: imported.trial.report for imported in made.trials}
    proposed = proposals({imported.name: imported.consistency for imported in made.trials}, reports)
    applied = "none applied" + (" except where marked" if any(p.done for p in proposed) else "")
    return Report(
        title=", ".join(printable(log.path.name, 40) for log in made.survey.logs[:4])
        + (f" and {len(made.survey.logs) - 4} more" if len(made.survey.logs) > 4 else ""),
        outcome="imported in part" if partial else "imported",
        good=(
            f"{count} trial{'s' if count != 1 else ''}, {seconds:.0f} s in all, with"
            f" {' '.join(channels) or 'no channel'} and {actuators} commands; vehicle:"
            f" {made.vehicle_source}"
        ),
        worst=problems[0] if problems else "nothing was found wrong",
        next_step=_next(made),
        sections=(
            Section("Look at this", tuple(problems[1 : SETTINGS.shown])),
            Section("Columns", tables=(_columns(made),)),
            Section("Trials", done, (_trials(made), _modes(made))),
            Section(
                f"Proposed corrections, {applied}: comments in campaign.toml and map.toml",
                tuple(imported.text for imported in proposed),
            ),
            Section("Missing, and what that costs", tuple(_missing(made))),
            Section("Look at this, too", tuple(problems[SETTINGS.shown :]), details=True),
            Section("Every field", tables=(_fields(made.survey),), details=True),
            *(
                Section(
                    f"Trial {imported.name}",
                    (*map(str, imported.notes), *str(imported.trial.report).splitlines()),
                    details=True,
                )
                for imported in made.trials
            ),
        ),
    )


def _left_out(made: Imported) -> list[str]:
    """Recordings that stand in one file behind one another and of which one was read."""
    return [
        f"trial {imported.name}: {note}"
        for imported in made.trials
        for note in imported.notes
        if note.kind == "time begins again"
    ]


def _lost(made: Imported) -> list[str]:
    """Columns that the logs have by name, or that the map names, and that could not be used."""
    sources = None if made.map_source == "proposed" else [column.source for column in made.columns.values()]
    return [loss for imported in made.trials for loss in made.survey.lost(imported.logs, sources)]


def _problems(made: Imported) -> Iterator[str]:
    """What is wrong or doubtful, the worst first."""
    for log in made.survey.logs:
        if log.not_underwater:
            yield (
                f"{printable(log.path.name)} is no log of an underwater vehicle: {log.not_underwater}; its"
                " channels were read, its model will mean nothing"
            )
    yield from made.refused
    yield from made.twice
    yield from _findings(made, Severity.PROBLEM)
    for imported in made.trials:
        yield from (
            f"trial {imported.name}: {contradiction}" for contradiction in imported.consistency.contradictions
        )
    for imported in made.trials:
        yield from (f"trial {imported.name}: {words_of(finding)}" for finding in imported.kind.impossible)
    yield from _findings(made, Severity.WEAKNESS, "mostly masked")
    yield from _findings(made, Severity.WEAKNESS, "uncommanded")
    for log in made.survey.logs:
        yield from (f"{printable(log.path.name)} was read in part: {note}" for note in log.notes)
    yield from _left_out(made)
    yield from _lost(made)
    longest = max(
        (float(imported.trial.t[-1] - imported.trial.t[0]) for imported in made.trials), default=0.0
    )
    if longest < SETTINGS.shortest_s:
        yield (
            f"the longest trial lasts {longest:.3g} s: too short to identify anything; log at least"
            f" {SETTINGS.shortest_s:g} s of a manoeuvre, and as much again to judge the result"
        )
    if not any(imported.trial.inputs for imported in made.trials):
        yield "no commands of actuators and no wrench are in the logs: nothing can be identified"
    elif made.vehicle is not None and made.unmatched:
        yield (
            f"no command for {', '.join(made.unmatched)} of {made.vehicle.name}: map them under [actuators]"
            " in map.toml"
        )
    speeds = {c for imported in made.trials for c in imported.trial.channels if c in "uvw"}
    if not speeds:
        yield (
            "no velocity and no position from which it follows: only rotations can be identified; add a"
            " Doppler log or a positioning system"
        )
    if made.vehicle is None:
        yield (
            f"the vehicle file is {made.vehicle_source}; or give a vehicle with --vehicle FILE, or a"
            f" built-in one"
        )
    elif not made.vehicle_certain:
        yield f"the vehicle is a guess: {made.vehicle_source}"
    yield from _supply(made)
    if made.reversed_thrusters:
        yield (
            f"{', '.join(made.reversed_thrusters)}: thrust opposite to that of the built-in vehicle, judging"
            " by the log's parameters or motion; vehicle.toml sets reversed = true: check in the water"
        )
    yield from _upside_down(made)
    for imported in made.trials:  # of the pose once
        yield from list(_findings(replace(made, trials=(imported,)), Severity.WEAKNESS, "clock jumped"))[:1]
    guesses = [canonical for canonical, column in made.columns.items() if not column.certain]
    if guesses:
        shown = ", ".join(guesses[:4]) + (f" and {len(guesses) - 4} more" if len(guesses) > 4 else "")
        yield (
            f"guessed from names and ranges, not stated in the log: {shown}; check unit and frame in map.toml"
        )
    yield from _findings(made, Severity.WEAKNESS)
    for imported in made.trials:
        yield from (f"trial {imported.name}: {warning}" for warning in imported.kind.warnings)
    for imported in made.trials:
        if imported.absent:
            apart = 2 * len(imported.absent) > len(made.columns) and len(made.trials) > 1
            yield f"trial {imported.name}: its logs have no {', '.join(imported.absent)}" + (
                "; most of their channels have other names: import them separately" if apart else ""
            )
            yield from (f"trial {imported.name}: {unused}" for unused in _unused(made, imported))
        known = [f"{log.path.name}: {note}" for log in made.survey.logs for note in log.notes]
        yield from (f"trial {imported.name}: {note}" for note in imported.notes if str(note) not in known)
    for log in made.survey.logs:
        yield from (f"{printable(log.path.name)}: {remark}" for remark in log.remarks)
    if made.kept:
        yield f"{', '.join(made.kept)} kept as edited; delete a file to have it drafted again"


def _unused(made: Imported, imported: ImportedTrial) -> Iterator[str]:
    """Fields that the logs of a trial have for columns of the map that take another log's."""
    for log in made.survey.logs:
        if log.path.name not in imported.logs:
            continue
        others = {
            canonical: next((p.source for p in log.proposals if p.canonical == canonical), "")
            for canonical in imported.absent
        }
        named = [f"{source} ({canonical})" for canonical, source in others.items() if source]
        if named:
            more = f" and {len(named) - SETTINGS.named} more" if len(named) > SETTINGS.named else ""
            unused = f"{', '.join(named[: SETTINGS.named])}{more}"
            yield (
                f"{printable(log.path.name)} has {unused}, not used: one map reads"
                " all logs, and it takes other fields; import this log separately"
            )


def _findings(made: Imported, severity: Severity, kind: str = "") -> Iterator[str]:
    """What the readers found about the recordings, of one severity, and of one kind if given."""
    for imported in made.trials:
        for finding in imported.trial.report.findings:
            if finding.severity == severity and kind in ("", finding.kind):
                yield f"trial {imported.name}: {finding.line}"


def _upside_down(made: Imported) -> Iterator[str]:
    """Trials whose axes point to port and upwards, as their thrusters and their depth tell together."""
    if made.vehicle is None:
        return
    names = [
        imported.name
        for imported in made.trials
        if any(finding.kind == "above the surface" for finding in imported.trial.report.findings)
        and set("YZN") <= set(against := opposed(made.vehicle, imported.trial))
        and "X" not in against
    ]
    if names:
        yield (
            f"trial {', '.join(names)}: Y, Z and N answer against the thrusters, and z is above the surface:"
            ' all axes point to port and upwards. Give in map.toml frame = "FLU" to velocities and rates,'
            ' frame = "FLU/NWU" to the attitude and frame = "NWU" to the position (ENU where x is east), not'
            " sign = -1 to z alone"
        )


def _supply(made: Imported) -> Iterator[str]:
    """What to do about trials without the supply voltage that the vehicle's thrust depends on."""
    if made.vehicle is None or not any(
        actuator["needs_voltage"] for actuator in made.vehicle.actuator_info().values()
    ):
        return
    bare = [imported.name for imported in made.trials if imported.trial.voltage_v is None]
    if bare:
        yield (
            f"trial {', '.join(bare)}: the thrust of {made.vehicle.name} depends on the supply voltage, which"
            " is not in the log: give it in campaign.toml, mixer = { supply_v = 16.0 }"
        )


def _next(made: Imported) -> str:
    if made.folder is None:
        return "seatrial import with --out PROJECT writes map, vehicle, campaign and trials"
    if made.vehicle is None:
        file = shlex.quote(f"{made.folder}/vehicle.toml")
        return f"fill in {file}, then seatrial check {file}"
    file = shlex.quote(f"{made.folder}/campaign.toml")
    return f"seatrial check {file}, then seatrial identify {file}"


def _columns(made: Imported) -> Table:
    rows = [
        (
            canonical,
            printable(column.source, 30),
            printable(column.unit, 8),
            column.frame + (" -" if column.sign < 0 else ""),
            printable(column.why, 42) + ("" if column.certain else " ?"),
        )
        for canonical, column in made.columns.items()
    ]
    head = ("column", "from", "unit", "frame, sign", "why")
    guessed = not all(column.certain for column in made.columns.values())
    return Table.of("", head, rows, left=5, note="?: a guess" if guessed else "")


def _trials(made: Imported) -> Table:
    rows = []
    for imported in made.trials:
        masked = max(imported.trial.report.masked.values(), default=0) / max(len(imported.trial), 1)
        held = (
            ""
            if imported.hold_out_s is None
            else f"{imported.hold_out_s[0]:.0f} to {imported.hold_out_s[1]:.0f}"
        )
        rows.append((
            imported.name,
            f"{imported.trial.t[0]:.1f}",
            f"{imported.trial.t[-1]:.1f}",
            f"{1.0 / imported.trial.dt:.3g}",
            f"{100.0 * masked:.0f}",
            held,
        ))
    head = ("trial", "from, s", "to, s", "rate, Hz", "most masked, %", "held out, s")
    return Table.of("", head, rows)


def _modes(made: Imported) -> Table:
    rows: list[tuple[str, ...]] = []
    for imported in made.trials:
        if not imported.modes:
            continue
        ends = [*(t for t, _ in imported.modes[1:]), float(imported.trial.t[-1])]
        rows += [
            (imported.name, printable(mode, 20), f"{t:.1f}", f"{end:.1f}")
            for (t, mode), end in zip(imported.modes, ends, strict=True)
        ]
    return Table.of("Modes of the autopilot", ("trial", "mode", "from, s", "to, s"), rows, left=2)


def _missing(made: Imported) -> Iterator[str]:
    missing: dict[str, list[str]] = {}
    for imported in made.trials:
        for sentence in imported.consistency.missing:
            missing.setdefault(sentence, []).append(imported.name)
    for sentence, names in missing.items():
        yield sentence if len(names) == len(made.trials) else f"trial {', '.join(names)}: {sentence}"


@report.register
def _survey(survey: Survey) -> Report:
    """What the logs hold, what could not be read, and the command that goes on."""
    fields = sum(len(topic.fields) for log in survey.logs for topic in log.topics)
    topics = sum(len(log.topics) for log in survey.logs)
    taken = [canonical for log in survey.logs for canonical in chosen(log)]
    notes = [f"{printable(log.path.name)}: {note}" for log in survey.logs for note in log.notes]
    odd = [f"{printable(log.path.name)}: {log.not_underwater}" for log in survey.logs if log.not_underwater]
    worst = [
        *(f"{reason}: this is no underwater vehicle" for reason in odd),
        *notes,
        *survey.lost([log.path.name for log in survey.logs]),
        *([] if taken else ["no field is recognised; write a map with [columns] by hand"]),
    ]
    remarks = [f"{printable(log.path.name)}: {remark}" for log in survey.logs for remark in log.remarks]
    names = " ".join(printable(str(log.path), 200) for log in survey.logs)
    return Report(
        title=", ".join(printable(log.path.name) for log in survey.logs),
        outcome="surveyed",
        good=f"{topics} topics with {fields} fields; {len(taken)} are taken for columns of a trial",
        worst=worst[0] if worst else "nothing; all of it was read",
        next_step=f"seatrial import {names} --out PROJECT",
        sections=(Section(sentences=(*worst[1:], *remarks), tables=(_fields(survey),)),),
    )


def _fields(survey: Survey) -> Table:
    """Every field: topic, field, rate, range, unit, what it is taken for."""
    several = len(survey.logs) > 1
    rows = []
    for row in survey.rows():
        guess = row["taken_for"] or (f"({row['could_be']})" if row["could_be"] else "")
        rows.append((
            printable(row["file"], 24) if several else "",
            printable(row["topic"], 28),
            printable(row["field"], 24),
            _number(row["rate_hz"]),
            _number(row["minimum"]),
            _number(row["maximum"]),
            printable(row["unit"], 10),
            printable(guess, 20),
        ))
    head = ("file", "topic", "field", "Hz", "least", "most", "unit", "taken for")
    note = "(in brackets): could be that, but another field is better or it never changes"
    return Table.of("Fields", head, rows, left=3, note=note)


def _number(x: float) -> str:
    return f"{x:.4g}" if x == x else ""
