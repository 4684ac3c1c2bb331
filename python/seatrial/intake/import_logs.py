"""From logs to a project: map, vehicle file, campaign, trials; everything proposed, said and kept apart.

A project is a folder with import.json. Files that the user edited since are kept, and a map that is given
wins over what the logs offer. Held by ``tests/intake/test_import.py``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.errors import TrialError, printable
from seatrial.base.files import only_user
from seatrial.base.work import callers_errors_pass, one_blas_thread
from seatrial.inspect.consistency import consistency, convention_of, series_of
from seatrial.inspect.corrections import Consistency
from seatrial.inspect.kind_of_data import KindOfData, kind_of_data, moved, moves
from seatrial.intake.imported import (
    Imported,
    ImportedTrial,
    delays_given,
    edited,
    map_text,
    refuse_foreign,
    write_project,
)
from seatrial.intake.map_file import Column, ImportMap, load_map
from seatrial.intake.recordings import (
    INTAKE_SETTINGS,
    Recorded,
    Recording,
    proposed_columns,
    rate_of_long,
    recordings,
    table_of,
)
from seatrial.intake.survey import Survey, importing, survey
from seatrial.intake.vehicle_draft import VehicleDraft, draft_vehicle, matched, thruster_signs, turned
from seatrial.trial.columns import GROUPS
from seatrial.trial.recording import RawTable, recording
from seatrial.trial.signals import Series

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial

_NEAR = 0.08  # of a trial's length: a change of mode or its end this near to a proposed hold-out counts

Progress = Callable[[float, str], None]


@callers_errors_pass
def import_logs(
    paths: str | Path | Iterable[str | Path],
    *,
    out: str | Path | None = None,
    map: str | Path | None = None,
    vehicle: str | Path | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> Imported:
    """Import of some logs; with `out` a project with map, vehicle file, campaign and trials.

    Parameters
    ----------
    paths
        Logs of any format of `seatrial.logs`. Files that hold different channels make one recording, files
        that hold the same channels a trial each.
    out
        Folder of the project.
    map
        A map to use instead of what the logs offer (map.toml of a project, edited).
    vehicle
        Vehicle file or built-in vehicle; by ArduSub's frame, or a stub to fill in, when omitted.
    force
        Whether to overwrite a project that an import made; files that were edited since are kept.
    progress
        Called with the share of the work that is done and what is being done.
    """
    logs = [paths] if isinstance(paths, str | Path) else [*paths]
    if out is None:
        with importing(logs), one_blas_thread():
            return _imported_logs(logs, None, map, vehicle, progress)
    folder = Path(out)
    refuse_foreign(folder, force)
    with importing(logs), only_user(folder), one_blas_thread():
        refuse_foreign(folder, force)  # another import may have ended meanwhile
        return _imported_logs(logs, folder, map, vehicle, progress)


def _imported_logs(
    logs: Sequence[str | Path],
    folder: Path | None,
    map: str | Path | None,
    vehicle: str | Path | None,
    progress: Progress | None,
) -> Imported:
    """The import, into a folder that nobody else writes."""
    say = progress or (lambda share, words: None)
    seen = survey(logs, share=lambda s, w: say(0.5 * s, w))
    given = None if map is None else load_map(map)
    # Which files are one recording, and which of their fields are which columns.
    made = recordings(seen.logs, given.trials if given else None)
    columns = given.columns if given else proposed_columns(made)
    if not columns:
        raise TrialError(_nothing_known(seen))
    commands = {
        name.removeprefix("cmd."): column.unit for name, column in columns.items() if name.startswith("cmd.")
    }
    # Actuators of the log get the names that the vehicle has for them.
    draft = draft_vehicle(seen.logs, commands, _kept_vehicle(folder, vehicle))
    unmatched: tuple[str, ...] = ()
    if draft.vehicle is not None and given is None:
        columns, unmatched = _for_vehicle(columns, draft.vehicle)
    wanted = ImportMap(
        given.source if given else "the proposed map", columns, given.clocks if given else {}, {}
    )
    read: list[tuple[Recording, Recorded, Trial]] = []
    refused = []
    for k, logged in enumerate(made):

        def part(share: float, k: int = k, logged: Recording = logged) -> None:
            say(0.5 + 0.45 * (k + share) / len(made), f"trial {logged.name}")

        # A recording that cannot be read is left out and named, unless it is the only one.
        try:
            recorded = table_of(logged, wanted, part)
            if given is None and not read and (other := _reordered(columns, recorded)) is not None:
                columns, wanted = other, replace(wanted, columns=other)
                recorded = table_of(logged, wanted, part)
            read.append((logged, recorded, _trial(logged, recorded)))
        except TrialError as error:
            if len(made) == 1:
                raise
            refused.append(f"trial {logged.name}: {error}")
    if not read:
        raise TrialError("\n".join(refused))
    # The first trial shows which thrusters push against the direction of the draft.
    text, reversed_ = _turned(draft, read[0][2], seen)
    whole = _vehicle(text) if draft.vehicle is not None else None
    trials = tuple(_imported(logged, recorded, trial, whole) for logged, recorded, trial in read)
    # A delay that the edited campaign removes is proposed for no clock again.
    delays = {} if folder is None else delays_given(folder)
    trials = tuple(
        _without_given(trial, delays.get("", set()) | delays.get(trial.name, set())) for trial in trials
    )
    result = Imported(
        folder=folder,
        survey=seen,
        columns=columns,
        trials=trials,
        vehicle=whole,
        vehicle_source=draft.source,
        vehicle_certain=draft.certain,
        reversed_thrusters=reversed_,
        unmatched=unmatched,
        refused=tuple(refused),
        kept=(),
        map_source="proposed" if given is None else given.source,
        twice=tuple(_twice(read, wanted, delays)),
    )
    if folder is not None:
        say(0.96, f"files of {folder}")
        mapped = map_text(result, made) if map is None else Path(map).read_text(encoding="utf-8")
        kept = write_project(result, folder, text, mapped, [recorded for _, recorded, _ in read])
        result = replace(result, kept=kept)
    say(1.0, "done")
    return result


def _without_given(trial: ImportedTrial, delayed: set[str]) -> ImportedTrial:
    """The trial without proposals of clocks whose delay the edited campaign removes already."""
    kept = tuple(c for c in trial.consistency.corrections if c.table != "clocks" or c.sensor not in delayed)
    return replace(trial, consistency=replace(trial.consistency, corrections=kept))


def _twice(
    read: Sequence[tuple[Recording, Recorded, Trial]], wanted: ImportMap, delays: Mapping[str, set[str]]
) -> Iterator[str]:
    """Sensors whose delay the clocks of the map and the edited campaign both remove."""
    for logged, recorded, _ in read:
        for sensor in sorted(delays.get("", set()) | delays.get(logged.name, set())):
            columns = [c for group in GROUPS if group.name.replace(" ", "_") == sensor for c in group.columns]
            for file in dict.fromkeys(recorded.clocks[c] for c in columns if c in recorded.clocks):
                if file in wanted.clocks:
                    yield (
                        f"trial {logged.name}: delay_s.{sensor} of campaign.toml and the clock of"
                        f" {printable(file)} in the map both remove the delay of the {sensor}: remove one"
                    )


def _nothing_known(seen: Survey) -> str:
    """What to do about logs of which no field is recognised, and what could not be read of them."""
    names = ", ".join(printable(log.path.name) for log in seen.logs)
    lost = "; ".join(note for log in seen.logs for note in log.notes)
    return (
        f"{names}: no field is recognised{f' ({lost})' if lost else ''}; list them with seatrial import LOG,"
        " write map.toml with [columns], and give it with --map"
    )


def _for_vehicle(
    columns: Mapping[str, Column], vehicle: Vehicle
) -> tuple[dict[str, Column], tuple[str, ...]]:
    """The columns with commands by the names of the vehicle's actuators, and actuators without any."""
    commands = {
        name.removeprefix("cmd."): column for name, column in columns.items() if name.startswith("cmd.")
    }
    match = matched(list(commands), vehicle)
    result = {name: column for name, column in columns.items() if not name.startswith("cmd.")}
    result |= {f"cmd.{actuator}": commands[name] for actuator, name in match.items()}
    used = set(match.values())
    result |= {f"cmd.{name}": column for name, column in commands.items() if name not in used and not match}
    return result, tuple(actuator for actuator in vehicle.actuators if actuator not in match)


_QUATERNION = ("q_w", "q_x", "q_y", "q_z")


def _reordered(columns: Mapping[str, Column], recorded: Recorded) -> dict[str, Column] | None:
    """The columns with the scalar of a numbered quaternion last; None where its order is right or unknown.

    Numbers (q0 to q3) say no order: the first was taken for the scalar, and the motion shows whether it is.
    """
    sources = [columns[name].source for name in _QUATERNION if name in columns]
    if len(sources) < 4 or not all(re.search(r"\d\]?$", source) for source in sources):
        return None
    convention = convention_of(_series(recorded))
    if convention is None or not convention.order:
        return None
    why = f"scalar last: so it explains {100.0 * convention.share:.0f} % of the motion"
    last = dict(zip(_QUATERNION, [sources[3], *sources[:3]], strict=True))
    return {
        name: replace(column, source=last[name], why=why, certain=True) if name in last else column
        for name, column in columns.items()
    }


def _trial(recording: Recording, recorded: Recorded) -> Trial:
    from seatrial.trial.trial import Trial

    files = ", ".join(str(log.path) for log in recording.logs)
    trial = Trial.read(
        RawTable(recorded.table, files),
        columns=recorded.columns,
        name=recording.name,
        rate_hz=rate_of_long(recorded.table),
    )
    return replace(trial, source=recording.name, report=replace(trial.report, source=recording.name))


def _turned(draft: VehicleDraft, trial: Trial, seen: Survey) -> tuple[str, tuple[str, ...]]:
    """Text of the drafted vehicle with the thrusters' directions as the log tells them."""
    ardupilot = any(log.format in ("dataflash", "mavlink") for log in seen.logs)
    if draft.vehicle is None or not ardupilot or not draft.built_in:
        return draft.text, ()
    parameters = {key: value for log in seen.logs for key, value in log.parameters.items()}
    signs = thruster_signs(draft.vehicle, trial, parameters)
    return turned(draft.text, signs), tuple(name for name, against in signs.items() if against)


def _vehicle(text: str) -> Vehicle:
    from seatrial._core import Vehicle

    return Vehicle.from_toml(text)


def _imported(
    recording: Recording, recorded: Recorded, trial: Trial, vehicle: Vehicle | None
) -> ImportedTrial:
    kind = kind_of_data(trial, vehicle)
    first, last = float(trial.t[0]), float(trial.t[-1])
    hold_out, why = _hold_out(trial, kind, recorded.events)
    return ImportedTrial(
        recording.name,
        trial,
        hold_out,
        why,
        tuple((max(t, first), mode) for t, mode in recorded.events if t < last),
        _compared(recorded, kind),
        kind,
        recorded.notes,
        recorded.absent,
        tuple(log.path.name for log in recording.logs),
    )


def _hold_out(
    trial: Trial, kind: KindOfData, events: Sequence[tuple[float, str]]
) -> tuple[tuple[float, float] | None, str]:
    """The proposed hold-out from a change of mode where one is near, to the end where little is left."""
    proposed = kind.windows
    if kind.still:
        return None, "the vehicle does not move: hold out another trial"
    if proposed.hold_out is None:
        return None, proposed.sentence
    (start, stop), first, last = proposed.hold_out, float(trial.t[0]), float(trial.t[-1])
    near = [t for t, _ in events if abs(t - start) < _NEAR * (last - first)]
    begin = float(np.round(min(near, key=lambda t: abs(t - start)), 1)) if near else start
    end = float(np.ceil(last)) if last - stop < _NEAR * (last - first) else stop
    if (begin, end) == (start, stop) or not moves(trial, proposed, (begin, end)):
        return (start, stop), proposed.sentence
    words = ["from a change of mode"] if begin != start else []
    words += ["to the end of the trial"] if end != stop else []
    return (
        begin,
        end,
    ), f"{moved(trial, kind.manoeuvres, proposed, (begin, end)).sentence}; {' '.join(words)}"


def _compared(recorded: Recorded, kind: KindOfData) -> Consistency:
    """Whether the channels tell one motion; without motion only what is missing."""
    quaternion = "q_w" in recorded.columns or "q_w" in recorded.table.columns
    compared = consistency(_series(recorded), quaternion=quaternion)
    if "current_north_m_s" in recorded.columns:
        compared = replace(compared, current=None)
    return compared.without_motion() if kind.still else compared


def _series(recorded: Recorded) -> dict[str, Series]:
    """Channels of a recording at their own stamps, each with the clock of its file."""
    channels = series_of(recording(recorded.table, columns=recorded.columns))
    result = {}
    for channel, series in channels.items():
        stride = max(1, -(-len(series.t) // INTAKE_SETTINGS.most_samples))
        result[channel] = Series(series.t[::stride], series.value[::stride], _clock(channel, recorded))
    return result


# Canonical columns of the channels that are called otherwise.
_COLUMN_OF = {
    channel: column for group in GROUPS for column, channel in zip(group.columns, group.channels, strict=True)
}


def _clock(channel: str, recorded: Recorded) -> str:
    """File whose clock stamped a channel; "" where it is derived."""
    attitude = "q_w" if channel in ("roll", "pitch", "yaw") else ""
    for column in (channel, _COLUMN_OF.get(channel, ""), attitude):
        if column in recorded.clocks:
            return recorded.clocks[column]
    return ""


def _kept_vehicle(folder: Path | None, vehicle: str | Path | None) -> str | Path | None:
    """The vehicle given, or that of the project where the user edited it."""
    if vehicle is not None or folder is None:
        return vehicle
    own = folder / "vehicle.toml"
    return own if own.is_file() and edited(folder, own.name) else None
