"""The files that an import drafts: the map, and the campaign with a stage per axis that the data can tell.

An axis is freed where an actuator drives it and the trials show its velocity. Mass and thrust stay as the
vehicle file has them: recordings of motion fix only their ratio. Where fins turn a slender vehicle their
lift is freed instead of the added inertia, which follows from the shape of the hull (Fossen 2021, section
8.2.1) while a fin's lift depends on hull, gaps and wake. A slender vehicle with lift has its lateral
pair (Y, N) and its vertical pair (Z, M) in a stage each, a hovering one each axis in its own; the joint
estimate follows. Held by ``tests/intake/test_import.py``.
"""

from __future__ import annotations

import json
import math
import textwrap
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.channels import AXES, CHANNELS, MOTIONS, VELOCITIES
from seatrial.base.errors import printable
from seatrial.inspect.consistency import common, mean
from seatrial.inspect.feedback import runs_away
from seatrial.intake.recordings import Column
from seatrial.vehicle.actuators import actuator_groups, drivers

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.inspect.corrections import Correction, SlowCurrent
    from seatrial.intake.recordings import Recording
    from seatrial.intake.survey import SurveyedLog
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class CampaignDraftSettings:
    """What a drafted campaign asks for, and what it takes for known beforehand."""

    seen_share: float = 0.5  #: of valid samples that a channel needs
    #: rad: a roll or pitch that spreads less tells nothing of what rights the vehicle
    least_angle_rad: float = 0.035
    #: of the bounds of a hovering vehicle's inertia: its thrust and levers are held, right or wrong, and what
    #: turns takes their error over
    inertia_widening: float = 4.0
    damping_widening: float = 3.0  #: the same of its damping
    #: bounds of a fin's gain: the fins of a field mission in another simulator had 0.16 and 0.23 of the lift
    #: that their aspect ratio gives
    fin_gain: tuple[float, float] = (0.1, 3.0)
    #: that a drafted campaign asks for: Beluga's log kept four, and a further one costs a minute
    proposal_rounds: int = 6
    #: m, deviation of a lever: it is measured to the flange, while the thrust acts in the duct and pushes on
    #: the frame by its wash
    lever_sd_m: float = 0.03
    #: the same as a part of it: Beluga's arm about the roll axis is 0.30 m where its file says 0.22
    lever_sd_share: float = 0.1
    #: m off O that the drag of an open frame may act: it bounds ``K_v``, ``M_u`` and ``N_v``
    off_centre_m: float = 0.1
    drift_lift: float = 0.25  #: largest lift along the drift, over that of the vehicle file


SETTINGS = CampaignDraftSettings()


_THRUST = {"bounds": [0.25, 4.0], "sd": 0.15}
"""What is known beforehand of one thruster's thrust over its curve: propellers of a batch differ by some per
cent, the flow about the hull and the wash of the others by more. Another propeller than the table's may push
several times as much: of Beluga's eight, seven were 0.71 to 1.13 and one 2.1."""


_LIFT = ("uv", "ur", "uw", "uq", "ud")


@dataclass(frozen=True)
class DraftedTrial:
    """A trial of the drafted campaign."""

    #: Its name and its file relative to the campaign.
    name: str
    file: str
    trial: Trial  #: As read.
    columns: Mapping[str, Mapping[str, Any]]  #: Column map of its file.
    hold_out_s: tuple[float, float] | None  #: Proposed hold-out (start, stop), s; None for none.
    why: str  #: Why that part.
    input: str  #: "commands" or "tau".
    rate_hz: float | None = None  #: Rate of a recording with very many samples; None for its own.
    #: Proposed by the consistency check, none applied.
    corrections: tuple[Correction, ...] = field(default=())
    current: SlowCurrent | None = None  #: A slow current that it proposes; None for none.


def draft(file: str, part: str, **names: str) -> list[str]:
    """Lines of a part of a drafted file (``drafts.toml``) with names filled in."""
    return Template(_drafts()[file][part]).substitute(names).splitlines()


@cache
def _drafts() -> dict[str, dict[str, str]]:
    return tomllib.loads(Path(__file__).with_name("drafts.toml").read_text(encoding="utf-8"))


def line(key: str, value: Any) -> str:
    """A key and its value as TOML."""
    plain = key.replace("_", "").replace("-", "")
    name = key if plain.isascii() and plain.isalnum() else json.dumps(key, ensure_ascii=False)
    return f"{name} = {_value(value)}"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(line(key, entry) for key, entry in value.items()) + " }"
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_value(entry) for entry in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, int) else repr(round(float(value), 6))


def free_axes(vehicle: Vehicle, trials: Sequence[Trial]) -> str:
    """Letters of the axes that a command or a recorded wrench drives in a trial that shows them."""
    return "".join(
        axis
        for axis in AXES
        if any(
            _shown(trial, CHANNELS[AXES.index(axis)]) and _commanded(vehicle, trial, axis) for trial in trials
        )
    )


def _commanded(vehicle: Vehicle, trial: Trial, axis: str) -> bool:
    """Whether a trial has a command, or a force, of what drives an axis: without it nothing explains it."""
    if not trial.commands and trial.tau is not None:
        return bool(np.any(trial.tau[:, AXES.index(axis)]))
    return any(name in trial.commands for name in drivers(vehicle).get(axis, ()))


def _shown(trial: Trial, channel: str) -> bool:
    """Whether a trial has a channel that moves; of roll and pitch rates, whether the angle does, too."""
    angle = {"p": "roll", "q": "pitch"}.get(channel)
    if angle is not None and not (
        angle in trial.channels and _spread(trial, angle) > SETTINGS.least_angle_rad
    ):
        return False
    return channel in trial.channels and _spread(trial, channel) > 0.0


def _spread(trial: Trial, channel: str) -> float:
    """Standard deviation of a channel, SI; 0 where it is hardly ever valid."""
    k = CHANNELS.index(channel)
    good = trial.valid[:, k]
    return float(np.std(trial.observed[good, k])) if good.mean() > SETTINGS.seen_share else 0.0


def campaign_text(name: str, vehicle: Vehicle | None, drafted: Sequence[DraftedTrial]) -> str:
    """Text of the campaign file."""
    shared = drafted[0].columns if all(trial.columns == drafted[0].columns for trial in drafted) else None
    lines = [*draft("campaign", "head", name=line("name", name)), *_corrections(drafted)]
    if shared is not None:
        lines += draft("campaign", "columns")
        lines += [line(canonical, entry) for canonical, entry in shared.items()]
        lines.append("")
    for trial in drafted:
        lines += [f"[trials.{json.dumps(trial.name, ensure_ascii=False)}]", line("file", trial.file)]
        if trial.hold_out_s is not None:
            lines += _comment(trial.why)
            lines.append(line("hold_out_s", [list(trial.hold_out_s)]))
        else:
            lines += _comment(f"no hold-out: {trial.why}")
        if trial.rate_hz is not None:
            lines.append(f"{line('rate_hz', trial.rate_hz)} # of very many samples")
        if trial.input != "commands":
            lines.append(line("input", trial.input))
        lines += _own_corrections(trial, drafted)
        if shared is None:
            lines.append(f"[trials.{json.dumps(trial.name, ensure_ascii=False)}.columns]")
            lines += [line(canonical, entry) for canonical, entry in trial.columns.items()]
        lines.append("")
    stages = _stages(vehicle, drafted) if vehicle is not None else _open_stage(drafted, "open_stage")
    return "\n".join([*lines, *stages]) + "\n"


def _comment(text: str, width: int = 100) -> list[str]:
    return textwrap.wrap(text, width, initial_indent="# ", subsequent_indent="# ")


def _corrections(drafted: Sequence[DraftedTrial]) -> list[str]:
    """Corrections of all trials as comments, by table: nothing is applied in silence."""
    shared = {where: entries for where, entries in _found(drafted).items() if common(entries, len(drafted))}
    if not shared:
        return []
    lines = draft("campaign", "corrections")
    for table in dict.fromkeys(table for table, _ in shared):
        lines.append(f"# [{table}]")
        for (other, _), entries in shared.items():
            if other == table:
                lines += ["# " + text for text in _pooled(drafted, entries)]
    return [*lines, ""]


def _own_corrections(drafted_trial: DraftedTrial, drafted: Sequence[DraftedTrial]) -> list[str]:
    """Corrections of one trial alone, and its slow current, as comments within its table."""
    lines = []
    for (table, _), entries in _found(drafted).items():
        if not common(entries, len(drafted)) and drafted_trial.name in entries:
            correction = entries[drafted_trial.name]
            own = f"{table}.{correction.line}"
            lines += draft("campaign", "own_correction", effect=_effect(correction), line=own)
    if (current := drafted_trial.current) is not None:
        words = {"source": current.source, "effect": current.effect, "line": current.line}
        lines += draft("campaign", "current", **words)
    return lines


def _found(drafted: Sequence[DraftedTrial]) -> dict[tuple[str, str], dict[str, Correction]]:
    """By table and key the correction of each trial that has one; clocks belong to the map."""
    corrections: dict[tuple[str, str], dict[str, Correction]] = {}
    for trial in drafted:
        for correction in trial.corrections:
            if correction.table != "clocks":
                corrections.setdefault((correction.table, correction.key), {})[trial.name] = correction
    return corrections


def _pooled(drafted: Sequence[DraftedTrial], entries: Mapping[str, Correction]) -> list[str]:
    """A correction's key with the mean of the trials, and how it was pooled."""
    worst = max(entries.values(), key=lambda correction: correction.before / max(correction.after, 1e-12))
    if len(drafted) == 1:
        return [f"{worst.line} # {_effect(worst)}"]
    of = f"{len(entries)} of {len(drafted)} trials" if len(entries) < len(drafted) else "all trials"
    values = [correction.value for correction in entries.values()]
    if all(value == values[0] for value in values):
        return [f"{worst.line} # {of}; {_effect(worst)}"]
    spread = np.array(values, float).reshape(len(values), -1)
    ranges = ", ".join(
        f"{low:.4g} to {high:.4g}" for low, high in zip(spread.min(0), spread.max(0), strict=True)
    )
    remark = f"mean of {of}, weighed by their deviations; by trial {ranges}"
    return [f"# {remark}", f"{replace(worst, value=mean(entries)[1]).line} # {_effect(worst)}"]


def _effect(correction: Correction) -> str:
    effect = f"{correction.of}: {correction.before:.3g} to {correction.after:.3g} rms"
    return f"{correction.unit}; {effect}" if correction.unit else effect


def _open_stage(drafted: Sequence[DraftedTrial], why: str) -> list[str]:
    """A stage of one axis where none can be drafted, and why as a part of ``drafts.toml``."""
    trials = line("trials", [trial.name for trial in drafted])
    return draft("campaign", why) + draft("campaign", "surge", trials=trials)


def _stages(vehicle: Vehicle, drafted: Sequence[DraftedTrial]) -> list[str]:
    """Stages for the axes that the trials can tell, then the joint estimate."""
    usable = [drafted_trial for drafted_trial in drafted if drafted_trial.trial.inputs]
    free = free_axes(vehicle, [drafted_trial.trial for drafted_trial in usable])
    slender = any(vehicle.coefficients().get(f"{axis}_u{other}") for axis in "YZMN" for other in "vrwq")
    groups = ["X", "YN", "ZM", "K"] if slender else list(AXES)
    groups = [kept for group in groups if (kept := "".join(axis for axis in group if axis in free))]
    finned = _finned(vehicle) if slender else {}
    lines = draft("campaign", "stages")
    if any(axis in finned for axis in free):
        lines += draft("campaign", "fins")
    # Axes that cannot be identified are named, with what would change that.
    missing = [
        axis
        for axis in drivers(vehicle)
        if usable and not any(_commanded(vehicle, drafted_trial.trial, axis) for drafted_trial in usable)
    ]
    for axis in missing:
        names = ", ".join(f"cmd.{name}" for name in drivers(vehicle)[axis])
        lines += _comment(draft("campaign", "no_command", motion=MOTIONS[axis], names=names)[0])
    still = [axis for axis in "KM" if axis not in free and axis not in missing and usable]
    if still:
        names = " and ".join(MOTIONS[axis] for axis in still)
        lines += draft("campaign", "still", motions=names)
    first, freed = len(lines), ""
    # A stage per group of axes, on the trials that show and command all of them.
    for group in groups:
        shown = [
            drafted_trial
            for drafted_trial in usable
            if all(
                _shown(drafted_trial.trial, CHANNELS[AXES.index(a)])
                and _commanded(vehicle, drafted_trial.trial, a)
                for a in group
            )
        ]
        if shown:
            freed += group
            lines += [*_stage(vehicle, group, shown, "K" if "K" in free else "M", finned), ""]
    if len(lines) == first:
        return _open_stage(drafted, "nothing_driven")
    lines += draft("campaign", "joint")
    if instability := runs_away(vehicle, [drafted_trial.trial for drafted_trial in usable], freed):
        lines += _comment(draft("campaign", "innovations", instability=instability)[0], 95)
        lines.append(line("method", "innovations"))
    elif not any(trial.rate_hz for trial in usable):
        lines += draft("campaign", "rounds", line=line("proposal_rounds", SETTINGS.proposal_rounds))
    frame = [] if slender else [*_levers(vehicle, freed), *_off_centre(vehicle, freed)]
    return lines + _known(vehicle, usable, frame)


def _known(vehicle: Vehicle, usable: Sequence[DraftedTrial], frame: Sequence[str]) -> list[str]:
    """Coefficients of the joint estimate alone: gains of thrusters, and what an open frame needs."""
    kinds = {name: facts["kind"] for name, facts in vehicle.actuator_info().items()}
    known = vehicle.coefficient_info()
    gains = [name for name, kind in kinds.items() if kind != "fin" and f"{name}.gain" in known]
    if len(gains) < 2 or all(trial.input != "commands" for trial in usable):
        return []
    lines = draft("campaign", "gains") + [line(f"{name}.gain", _THRUST) for name in gains]
    return lines + ([*draft("campaign", "levers"), *frame] if frame else [])


def _levers(vehicle: Vehicle, freed: str) -> list[str]:
    """Levers of every group of thrusters about the free axes, in proportion."""
    present, kinds = vehicle.coefficients(), vehicle.actuator_info()
    lines = []
    for group, members in actuator_groups(vehicle).items():
        if len(members) < 2 or any(kinds[name]["kind"] == "fin" for name in members):
            continue
        for axis in (axis for axis in "KMN" if axis in freed):
            arms = [present.get(f"{name}.lever_{axis}", 0.0) for name in members]
            if all(arms):
                sd = max(SETTINGS.lever_sd_share, SETTINGS.lever_sd_m / float(np.mean(np.abs(arms))))
                bounds = [1.0 - 4.0 * sd, 1.0 + 4.0 * sd]
                entry = {"bounds": [round(end, 2) for end in bounds], "relative": True, "sd": round(sd, 2)}
                lines.append(line(f"{group}.lever_{axis}", entry))
    return lines


def _off_centre(vehicle: Vehicle, freed: str) -> list[str]:
    """Moments of a drag that acts off O, where both the force's and the moment's axis are free."""
    info = vehicle.coefficient_info()
    lines = []
    for moment, force, velocity in (("K", "Y", "v"), ("M", "X", "u"), ("N", "Y", "v")):
        name = f"{moment}_{velocity}"
        if {moment, force} <= set(freed) and name in info:
            start = info[f"{force}_{velocity}"]["start"] or 0.0
            most = _rounded(
                SETTINGS.off_centre_m * max(SETTINGS.damping_widening * 10.0 * abs(float(start)), 100.0)
            )
            lines.append(line(name, [-most, most]))
    return lines


def _finned(vehicle: Vehicle) -> dict[str, list[str]]:
    """Groups of fins by the axis that they turn, each group by one axis: yaw, else pitch."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for fin in vehicle.actuator_info().values():
        groups.setdefault(str(fin["group"]), []).append(fin)
    groups_by_axis: dict[str, list[str]] = {}
    for name, members in groups.items():
        if any(fin["kind"] != "fin" for fin in members):
            continue
        axes = (axis for axis in "NM" if all(fin["wrench"][AXES.index(axis)] for fin in members))
        if (axis := next(axes, None)) is not None:
            groups_by_axis.setdefault(axis, []).append(name)
    return groups_by_axis


def _stage(
    vehicle: Vehicle,
    group: str,
    shown: Sequence[DraftedTrial],
    upright: str,
    finned: Mapping[str, Sequence[str]],
) -> list[str]:
    measured = "".join(
        axis
        for axis in AXES
        if axis not in group and all(CHANNELS[AXES.index(axis)] in trial.trial.channels for trial in shown)
    )
    channels = {CHANNELS[AXES.index(axis)]: 1.0 for axis in group}
    angles = {"K": "roll", "M": "pitch"}
    for axis in group:
        angle = angles.get(axis)
        if angle is not None and all(angle in trial.trial.channels for trial in shown):
            channels[angle] = 1.0
    if "Z" in group and all(_shown(trial.trial, "z") for trial in shown):
        channels["z"] = 0.5
    lines = ["[[stages]]", line("name", " and ".join(MOTIONS[axis] for axis in group))]
    lines.append(line("trials", [trial.name for trial in shown]))
    lines.append(line("axes", {"free": group} | ({"measured": measured} if measured else {})))
    lines.append(line("channels", channels))
    lines.append("[stages.coefficients]")
    speeds = {axis: _speed([trial.trial for trial in shown], CHANNELS[AXES.index(axis)]) for axis in group}
    held = any(finned.get(axis) for axis in group)
    for axis in group:
        fins = finned.get(axis, ())
        lines += _coefficients(vehicle, axis, speeds[axis], "z" in channels, upright, fins, held=held)
    return lines


def _coefficients(
    vehicle: Vehicle, axis: str, speed: float, depth: bool, upright: str, finned: Sequence[str], *, held: bool
) -> list[str]:
    """Coefficients of one axis: added mass, damping, lift and what holds it upright or afloat.

    `upright`: the axis that frees the righting arm, which roll and pitch share. `finned`: groups of fins that
    turn the vehicle about this axis. `held`: whether to leave out the added inertia, because fins push this
    axis or the one that it is identified with: their gain takes its place.
    """
    info, present = vehicle.coefficient_info(), vehicle.coefficients()

    def bounds(name: str, factor: float = 1.0, to_zero: bool = False) -> Any:
        return _reaching(info[name], present.get(name, info[name]["start"]), factor, to_zero)

    own = VELOCITIES[AXES.index(axis)]
    wide = not any(info.get(f"{other}_uv", {}).get("start") for other in "YN")
    inertia, linear, quadratic = f"{axis}_{own}dot", f"{axis}_{own}", f"{axis}_{own}{own}"
    lines = [line(f"{group}.gain", list(SETTINGS.fin_gain)) for group in finned]
    if _bounded(info, inertia) and not held:
        lines.append(
            line(inertia, bounds(inertia, SETTINGS.inertia_widening if wide and axis in "KMN" else 1.0))
        )
    if _bounded(info, linear) and info[linear]["start"]:
        lines.append(line(linear, bounds(linear, SETTINGS.damping_widening if wide else 1.0, wide)))
    else:
        size = abs(float(info[quadratic]["start"])) * max(speed, 0.1)
        low = 10.0 * size if size else 100.0
        lines.append(line(linear, [-_rounded((SETTINGS.damping_widening if wide else 1.0) * low), 0.0]))
    if _bounded(info, quadratic) and info[quadratic]["start"]:
        lines.append(line(quadratic, bounds(quadratic, 1.0, wide)))
    for other in _LIFT:
        name = f"{axis}_{other}"
        if _bounded(info, name) and info[name]["start"]:
            lines.append(line(name, _opposing(name, info[name], bounds(name))))
    if axis == "Z" and depth and _bounded(info, "B"):
        lines.append(line("B", bounds("B")))
    if axis == "M" and _bounded(info, "x_b"):
        lines.append(line("x_b", bounds("x_b")))
    if axis == upright and _bounded(info, "z_b") and float(info["z_b"]["start"]) < 0.0:
        lines.append(line("z_b", [2.0 * float(info["z_b"]["lower"]), 0.0]))
    if axis in "KN" and _bounded(info, f"{axis}_0"):
        lines.append(line(f"{axis}_0", bounds(f"{axis}_0")))
    return lines


def _opposing(name: str, known: Mapping[str, Any], bounds: Any) -> Any:
    """Bounds of a lift, which opposes the drift that makes it, save for a small part that fins may take off.

    A large lift along the drift and a large linear damping cancel at one speed and stand for what is missing.
    """
    if name not in ("Y_uv", "Z_uw") or float(known["start"]) >= 0.0:
        return bounds
    low, high = (float(known["lower"]), float(known["upper"])) if bounds == "default" else bounds
    return [low, min(high, SETTINGS.drift_lift * abs(float(known["start"])))]


def _reaching(known: Mapping[str, Any], present: float, factor: float, to_zero: bool) -> Any:
    """Bounds of a coefficient, the lower one so many times as far, the upper one zero where asked.

    They reach twice as far as the vehicle's value `present` where the default ones exclude it.
    """
    low, high = float(known["lower"]), float(known["upper"])
    if low < 0.0 and (factor != 1.0 or to_zero):
        low, high = -_rounded(-factor * low), 0.0 if to_zero else high
    elif low <= present <= high:
        return "default"
    if present < low:
        low = -_rounded(-2.0 * present) if present < 0.0 else 0.0
    if present > high:
        high = _rounded(2.0 * present) if present > 0.0 else 0.0
    return [low, high]


def _bounded(info: Mapping[str, Any], name: str) -> bool:
    return name in info and info[name]["lower"] is not None


def _speed(trials: Sequence[Trial], channel: str) -> float:
    k = CHANNELS.index(channel)
    parts = [np.abs(trial.observed[trial.valid[:, k], k]) for trial in trials if channel in trial.channels]
    return float(np.quantile(np.concatenate(parts), 0.95)) if parts else 0.0


def _rounded(x: float) -> float:
    """A number to two digits, upwards."""
    if x <= 0.0:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(x)) - 1)
    return float(f"{math.ceil(x / step) * step:.3g}")


def map_text(
    folder: Path,
    columns: Mapping[str, Column],
    logs: Sequence[SurveyedLog],
    spans: Sequence[tuple[Recording, tuple[float, float]]],
    corrections: Sequence[Correction],
) -> str:
    """Text of the proposed map: every choice with its reason, every other candidate as a comment.

    `spans`: first and last time of each recording, s; `corrections`: of all trials, for their clocks.
    """
    lines = draft("map", "head", folder=str(folder))
    for canonical, column in columns.items():
        if not canonical.startswith("cmd."):
            lines.append(line(canonical, _entry(column)))
            lines += _others(logs, canonical, column)
    actuators = {name: column for name, column in columns.items() if name.startswith("cmd.")}
    if actuators:
        lines += draft("map", "actuators")
        lines += [line(name.removeprefix("cmd."), _entry(column)) for name, column in actuators.items()]
    lines += ["", *_clock_lines(corrections)]
    for part, (start, stop) in spans:
        files = [log.path.name for log in part.logs]
        if all(name.isprintable() for name in files):
            lines += [f"[trials.{json.dumps(part.name, ensure_ascii=False)}]", line("logs", files)]
            lines += [f"# start_s = {start:.1f}", f"# stop_s = {stop:.1f}", ""]
    return "\n".join(lines)


def _entry(column: Column) -> dict[str, Any]:
    given = column.entry(column.source)
    given |= {"convert": column.convert} if column.convert else {}
    why = printable(column.why, 120) + ("" if column.certain else " (a guess: check it)")
    return given | ({"why": why} if column.why else {})


def _others(logs: Sequence[SurveyedLog], canonical: str, column: Column) -> list[str]:
    """Other fields that could be the column, as comments."""
    comments = []
    for log in logs:
        for other in log.proposals:
            if other.canonical != canonical or other.source == column.source.partition("/")[0]:
                continue
            if other.name == column.source or not other.source.isprintable():
                continue
            source = other.source + (f"/{other.per}" if other.per else "")
            entry = Column(source, other.unit, other.frame, other.sign, other.convert)
            comments.append(f"# or {line(canonical, _entry(entry))}")
    return list(dict.fromkeys(comments))[:3]


def _clock_lines(corrections: Sequence[Correction]) -> list[str]:
    """Clocks that the consistency check proposes, as comments."""
    proposed: dict[str, dict[str, float]] = {}
    effects: dict[str, str] = {}
    for correction in corrections:
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
