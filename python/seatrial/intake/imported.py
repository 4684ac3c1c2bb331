"""What an import made of some logs, and the files of its project: what is written, overwritten or kept as
edited.

import.json says what the import wrote: a folder without it is not touched, and a file whose content differs
from what it says was edited by the user and stays. It is written last. Held by
``tests/intake/test_import.py``.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import TrialError, printable
from seatrial.base.files import whole_folder, write_atomic, write_table, writing
from seatrial.base.report import Reported
from seatrial.base.run import from_json
from seatrial.inspect.consistency import accepted
from seatrial.inspect.corrections import Consistency
from seatrial.inspect.kind_of_data import KindOfData
from seatrial.intake.campaign_draft import DraftedTrial, campaign_text, draft, line
from seatrial.intake.map_file import Column
from seatrial.intake.recordings import rate_of_long
from seatrial.intake.survey import Survey

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.intake.recordings import Recorded, Recording
    from seatrial.logs.log import Note
from seatrial.trial.trial import Trial


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


def map_text(made: Imported, recorded: Sequence[Recording]) -> str:
    """Text of the proposed map: every choice with its reason, every other candidate as a comment."""
    lines = draft("map", "head", folder=str(made.folder))
    for canonical, column in made.columns.items():
        if not canonical.startswith("cmd."):
            lines.append(line(canonical, _entry(column)))
            lines += _others(made, canonical, column)
    actuators = {name: column for name, column in made.columns.items() if name.startswith("cmd.")}
    if actuators:
        lines += draft("map", "actuators")
        lines += [line(name.removeprefix("cmd."), _entry(column)) for name, column in actuators.items()]
    lines += ["", *_clock_lines(made)]
    for recording in recorded:
        files = [log.path.name for log in recording.logs]
        if all(name.isprintable() for name in files):
            lines += [f"[trials.{json.dumps(recording.name, ensure_ascii=False)}]", line("logs", files)]
            start, stop = _span(made, recording.name)
            lines += [f"# start_s = {start:.1f}", f"# stop_s = {stop:.1f}", ""]
    return "\n".join(lines)


def _entry(column: Column) -> dict[str, Any]:
    given = column.entry(column.source)
    given |= {"convert": column.convert} if column.convert else {}
    why = printable(column.why, 120) + ("" if column.certain else " (a guess: check it)")
    return given | ({"why": why} if column.why else {})


def _others(made: Imported, canonical: str, column: Column) -> list[str]:
    """Other fields that could be the column, as comments."""
    comments = []
    for log in made.survey.logs:
        for other in log.proposals:
            if other.canonical != canonical or other.source == column.source.partition("/")[0]:
                continue
            if other.name == column.source or not other.source.isprintable():
                continue
            entry = Column(
                other.source + (f"/{other.per}" if other.per else ""),
                other.unit,
                other.frame,
                other.sign,
                other.convert,
            )
            comments.append(f"# or {line(canonical, _entry(entry))}")
    return list(dict.fromkeys(comments))[:3]


def _clock_lines(made: Imported) -> list[str]:
    """Clocks that the consistency check proposes, as comments."""
    proposed: dict[str, dict[str, float]] = {}
    effects: dict[str, str] = {}
    for trial in made.trials:
        for correction in trial.consistency.corrections:
            file, _, key = correction.key.rpartition(".")
            if correction.table == "clocks" and key not in proposed.setdefault(file, {}):
                proposed[file][key] = correction.value
                effects.setdefault(
                    file, f"{correction.of}: {correction.before:.3g} to {correction.after:.3g} rms"
                )
    if not proposed:
        return []
    lines = draft("map", "clocks")
    for file, values in proposed.items():
        entry = ", ".join(f"{key} = {value:.6g}" for key, value in values.items())
        lines.append(f"# {json.dumps(file)} = {{ {entry} }} # {effects[file]}")
    return [*lines, ""]


def _span(made: Imported, name: str) -> tuple[float, float]:
    trial = next((imported.trial for imported in made.trials if imported.name == name), None)
    return (0.0, 0.0) if trial is None else (float(trial.t[0]), float(trial.t[-1]))


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
