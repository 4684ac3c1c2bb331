"""From logs to a project: map, vehicle file, campaign, trials; everything proposed, said and kept apart.

A project is a folder with import.json, which says what the import wrote and is written last: a folder without
it is not touched, and a file whose content differs from what it says was edited by the user and stays. A map
that is given wins over what the logs offer. Held by ``tests/intake/test_import.py``.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import Vehicle
from seatrial.base.errors import TrialError, printable
from seatrial.base.files import only_user, whole_folder, write_atomic, write_table, writing
from seatrial.base.report import Reported
from seatrial.base.run import from_json
from seatrial.base.work import callers_errors_pass, one_blas_thread
from seatrial.inspect.consistency import accepted, consistency, convention_of, series_of
from seatrial.inspect.corrections import Consistency
from seatrial.inspect.kind_of_data import KindOfData, kind_of_data, moved, moves
from seatrial.intake.campaign_draft import DraftedTrial, campaign_text, map_text
from seatrial.intake.recordings import (
    INTAKE_SETTINGS,
    Column,
    ImportMap,
    Recorded,
    Recording,
    load_map,
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
from seatrial.trial.trial import Trial

if TYPE_CHECKING:
    from seatrial.logs.log import Note


@dataclass(frozen=True, eq=False)
class ImportedTrial:
    """A trial of the project."""

    name: str  #: Its name in the campaign.
    trial: Trial  #: As read from its file with the column map.
    hold_out_s: tuple[float, float] | None  #: Proposed part to hold out (start, stop), s; None for none.
    why: str  #: Why that part.
    modes: tuple[tuple[float, str], ...]  #: Changes of mode: time in s and name.
    consistency: Consistency  #: Whether its channels tell one motion.
    kind: KindOfData  #: What was done in it and what spoils it.
    notes: tuple[Note, ...]  #: What the readers and the join did or could not do.
    absent: tuple[str, ...]  #: Columns of the map whose field its logs have not.
    logs: tuple[str, ...]  #: Names of its logs.


@dataclass(frozen=True, eq=False, repr=False)
class Imported(Reported):
    """What an import made of some logs.

    Attributes
    ----------
    folder
        The project; None where nothing was written.
    survey
        Every topic and field.
    columns
        The map by canonical column (actuators as cmd.<actuator>).
    trials
        In the order of the campaign.
    vehicle
        The vehicle, None while its file is a stub; `vehicle_source` says where it comes from and
        `vehicle_certain` whether the log or the user says so.
    reversed_thrusters
        Those that push against the built-in vehicle's direction; the vehicle file says so.
    unmatched
        Actuators of the vehicle without a command.
    map_source
        The file of the map, or "proposed".
    twice
        Delays that the map's clocks remove and the edited campaign, too.
    refused
        Recordings that made no trial, and why.
    kept
        Files of the project that were edited since the last import and left as they are.
    """

    folder: Path | None
    survey: Survey
    columns: Mapping[str, Column]
    trials: tuple[ImportedTrial, ...]
    vehicle: Vehicle | None
    vehicle_source: str
    vehicle_certain: bool
    reversed_thrusters: tuple[str, ...]
    unmatched: tuple[str, ...]
    refused: tuple[str, ...]
    kept: tuple[str, ...]
    map_source: str
    twice: tuple[str, ...] = ()

    def summary(self) -> str:
        """The report as text."""
        return self.report().text(verbose=False)

    def to_dict(self) -> dict[str, Any]:
        """The import as plain data for JSON."""
        return {
            "folder": None if self.folder is None else str(self.folder),
            "map": self.map_source,
            "columns": {canonical: column.to_dict() for canonical, column in self.columns.items()},
            "trials": [
                {
                    "name": trial.name,
                    "start_s": float(trial.trial.t[0]),
                    "end_s": float(trial.trial.t[-1]),
                    "rate_hz": 1.0 / trial.trial.dt,
                    "channels": trial.trial.channels,
                    "hold_out_s": trial.hold_out_s,
                    "hold_out_why": trial.why,
                    "modes": [{"t": t, "mode": mode} for t, mode in trial.modes],
                    "report": trial.trial.report.to_dict(),
                    "consistency": {
                        key: value
                        for key, value in trial.consistency.to_dict().items()
                        if key in ("corrections", "missing", "compared")
                    },
                    "kind_of_data": trial.kind.to_dict(),
                    "notes": list(map(str, trial.notes)),
                    "absent": list(trial.absent),
                }
                for trial in self.trials
            ],
            "vehicle": {
                "source": self.vehicle_source,
                "certain": self.vehicle_certain,
                "complete": self.vehicle is not None,
                "reversed": list(self.reversed_thrusters),
                "without_command": list(self.unmatched),
            },
            "refused": list(self.refused),
            "kept": list(self.kept),
            "survey": self.survey.to_dict(),
        }


_OWN = "import.json"


def refuse_foreign(folder: Path, force: bool) -> None:
    """Refuse a folder with files that no import wrote, and without `force` one that an import wrote."""
    if folder.exists() and not folder.is_dir():
        raise TrialError(f"{folder}: expected a folder for the project, found a file; choose another name")
    if not folder.is_dir() or not any(folder.iterdir()):
        return
    if not (folder / _OWN).is_file():
        raise TrialError(
            f"{folder}: expected an empty or a new folder, found files that no import wrote; choose another"
            " one"
        )
    if not force:
        raise TrialError(
            f"{folder}: an import wrote this project before; overwrite it with --force (force=True), which"
            " keeps files that you edited, or choose another folder"
        )


def delays_given(folder: Path) -> dict[str, set[str]]:
    """Sensors whose delay the project's edited campaign removes, by trial; those of all trials under ""."""
    if not edited(folder, "campaign.toml"):
        return {}
    try:
        data = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}  # said where the campaign is read
    trials = data.get("trials", {})
    tables = {"": data} | (trials if isinstance(trials, dict) else {})
    sensors = {}
    for name, table in tables.items():
        given = table.get("corrections", {}) if isinstance(table, dict) else {}
        delays = given.get("delay_s", {}) if isinstance(given, dict) else {}
        sensors[name] = set(delays) if isinstance(delays, dict) else set()
    return sensors


def clocks_proposed(folder: Path) -> dict[str, dict[str, str]]:
    """By trial and sensor the file whose clock the import of a folder proposed to set, if it did."""
    try:
        trials = from_json((folder / _OWN).read_text(encoding="utf-8"))["trials"]
        return {
            trial["name"]: {
                correction["sensor"]: correction["key"].rpartition(".")[0]
                for correction in trial["consistency"]["corrections"]
                if correction["table"] == "clocks" and correction["key"].endswith(".offset_s")
            }
            for trial in trials
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}  # no project of an import, or of an earlier one


def write_project(
    made: Imported, folder: Path, vehicle_text: str, map_text: str, recorded: Sequence[Recorded]
) -> tuple[str, ...]:
    """Write the project, import.json last; names of edited files that were kept."""
    drafted = [
        DraftedTrial(
            trial.name,
            f"trials/{trial.name}.parquet",
            trial.trial,
            table.columns,
            trial.hold_out_s,
            trial.why,
            "commands" if trial.trial.commands or trial.trial.tau is None else "tau",
            rate_of_long(table.table),
            trial.consistency.corrections,
            accepted(trial.consistency),
        )
        for trial, table in zip(made.trials, recorded, strict=True)
    ]
    texts = {
        "map.toml": map_text,
        "vehicle.toml": vehicle_text,
        "campaign.toml": campaign_text(folder.resolve().name or "imported", made.vehicle, drafted),
    }
    kept = []
    with writing(folder), whole_folder(folder):
        (folder / "trials").mkdir(parents=True, exist_ok=True)
        for trial, table in zip(drafted, recorded, strict=True):
            write_table(table.table, folder / trial.file)
        for name, text in texts.items():
            if edited(folder, name) and (folder / name).read_text(encoding="utf-8") != text:
                kept.append(name)
            else:
                write_atomic(folder / name, text.encode())
        hashes = {
            name: hashlib.sha256(text.encode()).hexdigest()
            for name, text in texts.items()
            if name not in kept
        }
        hashes |= {name: _hashes(folder).get(name, "") for name in kept}
        record = {"format": 1, "written": hashes} | made.to_dict() | {"kept": kept}
        write_atomic(folder / _OWN, json.dumps(_plain(record), indent=1, ensure_ascii=False).encode())
    return tuple(kept)


def _plain(value: Any) -> Any:
    """Plain data without NaN, which JSON does not know."""
    if isinstance(value, Mapping):
        return {_plain(str(key)): _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]
    if isinstance(value, str):  # a name of a file may hold bytes that are no UTF-8
        return value.encode(errors="replace").decode()
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    return value


def _hashes(folder: Path) -> dict[str, str]:
    try:
        written = from_json((folder / _OWN).read_text(encoding="utf-8"))["written"]
    except (OSError, ValueError, KeyError, TypeError):  # then every file counts as edited, and is kept
        return {}
    return written if isinstance(written, dict) else {}


def edited(folder: Path, name: str) -> bool:
    """Whether a file of the project is not as the last import wrote it."""
    path = folder / name
    if not path.is_file():
        return False
    known = _hashes(folder).get(name)
    return known != hashlib.sha256(path.read_bytes()).hexdigest()


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
    whole = None if draft.vehicle is None else Vehicle.from_toml(text)
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
        spans = {trial.name: (float(trial.trial.t[0]), float(trial.trial.t[-1])) for trial in trials}
        mapped = map_text(
            folder,
            columns,
            seen.logs,
            [(logged, spans.get(logged.name, (0.0, 0.0))) for logged in made],
            [correction for trial in trials for correction in trial.consistency.corrections],
        )
        if map is not None:
            mapped = Path(map).read_text(encoding="utf-8")
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


def _trial(logged: Recording, recorded: Recorded) -> Trial:
    files = ", ".join(str(log.path) for log in logged.logs)
    trial = Trial.read(
        RawTable(recorded.table, files),
        columns=recorded.columns,
        name=logged.name,
        rate_hz=rate_of_long(recorded.table),
    )
    return replace(trial, source=logged.name, report=replace(trial.report, source=logged.name))


def _turned(draft: VehicleDraft, trial: Trial, seen: Survey) -> tuple[str, tuple[str, ...]]:
    """Text of the drafted vehicle with the thrusters' directions as the log tells them."""
    ardupilot = any(log.format in ("dataflash", "mavlink") for log in seen.logs)
    if draft.vehicle is None or not ardupilot or not draft.built_in:
        return draft.text, ()
    parameters = {key: value for log in seen.logs for key, value in log.parameters.items()}
    signs = thruster_signs(draft.vehicle, trial, parameters)
    return turned(draft.text, signs), tuple(name for name, against in signs.items() if against)


def _imported(logged: Recording, recorded: Recorded, trial: Trial, vehicle: Vehicle | None) -> ImportedTrial:
    kind = kind_of_data(trial, vehicle)
    first, last = float(trial.t[0]), float(trial.t[-1])
    hold_out, why = _hold_out(trial, kind, recorded.events)
    return ImportedTrial(
        logged.name,
        trial,
        hold_out,
        why,
        tuple((max(t, first), mode) for t, mode in recorded.events if t < last),
        _compared(recorded, kind),
        kind,
        recorded.notes,
        recorded.absent,
        tuple(log.path.name for log in logged.logs),
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
    sentence = moved(trial, kind.manoeuvres, proposed, (begin, end)).sentence
    return (begin, end), f"{sentence}; {' '.join(words)}"


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
