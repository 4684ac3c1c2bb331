"""A plan as a result: trials in their order, the room each needs and the standard deviations it leaves."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.base.atomic_write import write_atomic
from seatrial.base.channels import DEGREE
from seatrial.base.errors import TrialError
from seatrial.base.report import Report, Section, Table
from seatrial.base.run import RunResult, to_json

if TYPE_CHECKING:
    from seatrial.experiment.dither import Dither
    from seatrial.experiment.fisher import Instruments
    from seatrial.experiment.forecast import Forecast
    from seatrial.experiment.manoeuvre import Manoeuvre

_SHEET_ROWS = 8

_ZERO = 0.01
"""Share of what the score takes a deviation relative to: a smaller value is one of zero."""


VEHICLE, IDENTIFIED, START = "vehicle", "identification", "start values"
"""Whence the coefficients are at which a plan is made."""

_AT = {
    VEHICLE: "",
    IDENTIFIED: "; planned at the identified coefficients",
    START: "; planned at the campaign's start values, not at identified coefficients",
}


@dataclass(frozen=True)
class Change:
    """Standard deviation of one coefficient before and after, in its unit.

    The score takes it relative to ``relative_to``, which is no less than a tenth of the bounds' width; what
    is printed is relative to the value.
    """

    name: str
    unit: str
    value: float
    relative_to: float
    before: float
    after: float

    @property
    def relative_before(self) -> float:
        """Relative standard deviation before, as the score has it; one is 100 %."""
        return self.before / self.relative_to

    @property
    def relative_after(self) -> float:
        """Relative standard deviation after, as the score has it."""
        return self.after / self.relative_to

    @property
    def of_value(self) -> bool:
        """Whether a deviation is told in per cent of the value; one of a value of about zero is not."""
        return abs(self.value) > _ZERO * self.relative_to

    @property
    def whole(self) -> float:
        """What is printed is relative to it: the value, or what the score takes where that is about zero."""
        return abs(self.value) if self.of_value else self.relative_to

    def told(self, deviation: float, unit: str = "") -> str:
        """A deviation in per cent of the value, or as ± in its unit where the value is about zero."""
        if self.of_value:
            return _percent(deviation / self.whole)
        return f"± {deviation:.2g} {unit}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self) | {"relative_before": self.relative_before, "relative_after": self.relative_after}


@dataclass(frozen=True)
class Ranked:
    """A trial that could be next.

    Attributes
    ----------
    manoeuvre, forecast
        The manoeuvre, and the room that it needs.
    amplitude
        Share of the thrust that it uses; 0 where that does not apply.
    repeats
        How often it is run within the time of one trial, pauses included.
    score
        Sum of the relative standard deviations that it leaves.
    gains
        Standard deviations of every coefficient that counts, the greatest relative gain first.
    """

    manoeuvre: Manoeuvre
    forecast: Forecast
    amplitude: float
    repeats: int
    score: float
    gains: tuple[Change, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain data, without the commands."""
        manoeuvre = self.manoeuvre
        return {
            "name": manoeuvre.name,
            "kind": manoeuvre.kind,
            "words": manoeuvre.words,
            "start": manoeuvre.start.words,
            "duration_s": manoeuvre.duration_s,
            "pause_s": manoeuvre.pause_s,
            "amplitude": self.amplitude,
            "repeats": self.repeats,
            "score": self.score,
            "forecast": asdict(self.forecast),
            "gains": [change.to_dict() for change in self.gains],
        }


@dataclass(frozen=True)
class Plan(RunResult):
    """The next trials.

    Attributes
    ----------
    vehicle, budget_s
        Name of the vehicle and time of one trial, s.
    coefficients
        Standard deviations before the first trial and after the last one of the sequence.
    score_before
        Sum of the relative standard deviations before.
    ranking
        All manoeuvres that fit, as the next trial, the best first.
    sequence
        The trials to run, each the best after those before.
    staircases_score
        What as many trials of staircases alone, the best of them, would leave; None if none fits.
    refused
        Why other manoeuvres do not fit, by name.
    instruments
        Noise, correlation time and current that were assumed.
    recorded
        Whether recorded trials count.
    at
        Whence the coefficients are at which the plan is made: `VEHICLE`, `IDENTIFIED` or `START`, the start
        values of a campaign.
    dithers
        What to add to the autopilot's output where feedback dominates an axis of the recorded trials.
    facts
        What the plan rests on, see `seatrial.base.run.run_facts`.
    """

    vehicle: str
    budget_s: float
    coefficients: tuple[Change, ...]
    score_before: float
    ranking: tuple[Ranked, ...]
    sequence: tuple[Ranked, ...]
    staircases_score: float | None
    refused: Mapping[str, str]
    instruments: Instruments
    recorded: bool
    at: str = VEHICLE
    dithers: tuple[Dither, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def score_after(self) -> float:
        """Sum of the relative standard deviations after the sequence."""
        return self.sequence[-1].score

    def to_dict(self) -> dict[str, Any]:
        """The plan as plain data for JSON."""
        return {
            "vehicle": self.vehicle,
            "budget_s": self.budget_s,
            "score_before": self.score_before,
            "score_after": self.score_after,
            "staircases_score": self.staircases_score,
            "recorded": self.recorded,
            "at": self.at,
            "instruments": {
                "noise": dict(self.instruments.noise),
                "correlation_s": self.instruments.correlation_s,
                "segment_s": self.instruments.segment_s,
                "current_m_s": self.instruments.current_m_s,
            },
            "coefficients": [change.to_dict() for change in self.coefficients],
            "sequence": [ranked.to_dict() for ranked in self.sequence],
            "ranking": [ranked.to_dict() for ranked in self.ranking],
            "dithers": [dither.to_dict() for dither in self.dithers],
            "refused": dict(self.refused),
        }

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        files: dict[str, str | bytes] = {"plan.json": to_json(self.to_dict()), **self.report().files()}
        for number, ranked in enumerate(self.sequence, 1):
            name = "trial" if number == 1 else f"trial-{number}"
            files[f"{name}.csv"] = ranked.manoeuvre.table().write_csv()
            files[f"{name}.toml"] = self.sheet(ranked, f"{name}.csv", number)
        files |= {dither.file_name: dither.csv() for dither in self.dithers}
        return files

    def report(self) -> Report:
        """What the trials leave of the uncertainty, what stays unknown, what to do; then the trials."""
        return _report(self)

    def summary(self) -> str:
        """The report as plain text."""
        return self.report().text()

    def __str__(self) -> str:
        return self.summary()

    def write(self, path: str | Path, *, trial: int = 1) -> list[Path]:
        """Paths of the command file (CSV) and the sheet (TOML) of one trial of the sequence.

        Parameters
        ----------
        path : str or Path
            The command file, ending .csv; the sheet lies beside it.
        trial : int
            Its place in the sequence, from 1 on.

        Raises
        ------
        TrialError
            The ending is another one, or the files cannot be written.
        """
        target = Path(path)
        if target.suffix != ".csv":
            raise TrialError(f'{target}: expected the ending .csv, found "{target.suffix}"')
        if not 1 <= trial <= len(self.sequence):
            raise TrialError(f"trial {trial}: the plan has trials 1 to {len(self.sequence)}")
        ranked = self.sequence[trial - 1]
        sheet = target.with_suffix(".toml")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            ranked.manoeuvre.write_csv(target)
            write_atomic(sheet, self.sheet(ranked, target.name, trial).encode())
        except OSError as error:
            raise TrialError(
                f"{target}: cannot be written ({error.strerror}); choose a folder that you may write to"
            ) from None
        return [target, sheet]

    def write_dithers(self, folder: str | Path) -> list[Path]:
        """Paths of the tables of the dithers, written into a folder.

        Raises
        ------
        TrialError
            They cannot be written.
        """
        paths = [Path(folder) / dither.file_name for dither in self.dithers]
        for path, dither in zip(paths, self.dithers, strict=True):
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(path, dither.csv().encode())
            except OSError as error:
                raise TrialError(
                    f"{path}: cannot be written ({error.strerror}); choose a folder that you may write to"
                ) from None
        return paths

    def sheet(self, ranked: Ranked, commands: str, trial: int) -> str:
        """TOML text for the operator of a trial: manoeuvre, times, room, warnings, standard deviations.

        Parameters
        ----------
        ranked : Ranked
            The trial, one of `sequence` or `ranking`.
        commands : str
            Name of its command file.
        trial : int
            Its number in the sequence, from 1.
        """
        manoeuvre, seen = ranked.manoeuvre, ranked.forecast
        depth = f"{seen.start_depth_m:.1f} m deep or deeper"
        lines = [
            f"# Trial {trial} of {len(self.sequence)} for {self.vehicle}. Depths are those of O.",
            f"name = {_text(manoeuvre.name)}",
            f"vehicle = {_text(self.vehicle)}",
            f"commands = {_text(commands)}",
            f"what = {_text(manoeuvre.words)}",
            f"start = {_text(f'{manoeuvre.start.words}, {depth}')}",
            f"duration_s = {manoeuvre.duration_s:.1f}",
            f"repeats = {ranked.repeats}",
            f"pause_s = {manoeuvre.pause_s:.1f} # between repeats",
            f"area_m = [{seen.along_m:.0f}, {seen.across_m:.0f}] # along the course at the start, across it",
            f"start_depth_m = {seen.start_depth_m:.1f}",
            f"deepest_m = {seen.deepest_m:.1f}",
            f"largest_roll_deg = {seen.roll_deg:.0f}",
            f"largest_pitch_deg = {seen.pitch_deg:.0f}",
            f"top_speed_m_s = {seen.speed_m_s:.2f}",
            f"warnings = [{', '.join(_text(warning) for warning in seen.warnings)}]",
            "",
            "# Standard deviations before and after this trial, in per cent of the coefficient's value;",
            "# where that is about zero, in its unit.",
            "[tells]",
        ]
        lines += [_tells(change) for change in ranked.gains[:_SHEET_ROWS]]
        return "\n".join(lines) + "\n"


def _tells(change: Change) -> str:
    """Line of a sheet on what a trial tells about a coefficient."""
    if change.of_value:
        before, after = (f"{100 * x / change.whole:.1f}" for x in (change.before, change.after))
        unit = ""
    else:
        before, after, unit = f"{change.before:.3g}", f"{change.after:.3g}", f", unit = {_text(change.unit)}"
    return f"{_text(change.name)} = {{ before = {before}, after = {after}{unit} }}"


def _text(words: str) -> str:
    """A TOML basic string."""
    return json.dumps(words, ensure_ascii=False)


_HEAD = ("thrust", "run", "area, m", "to depth, m", "score", "determines best")

_OTHERS = 6

_WORTH = 0.99

_MOST_REFUSED = 4

_UNKNOWN, _BETTER = 0.5, 0.9


def _report(found: Plan) -> Report:
    first, count = found.sequence[0].manoeuvre, len(found.sequence)
    unknown = _still_unknown(found)
    basis = (
        "bounds and recorded trials, with sensor noise as the only error"
        if found.recorded
        else "the bounds only, nothing recorded"
    )
    return Report(
        title=found.vehicle,
        outcome=f"{count} {'trial' if count == 1 else 'trials'} planned",
        good=(
            f"{'it reduces' if count == 1 else 'they reduce'} the sum of the relative standard deviations of"
            f" {len(found.coefficients)} coefficients from {_number(found.score_before)} to"
            f" {_number(found.score_after)}; known so far:"
            f" {basis}{_AT[found.at]}"
        ),
        worst=unknown[0] if unknown else f"no coefficient stays unknown to more than {100 * _UNKNOWN:.0f} %",
        next_step=(
            "identify first (seatrial identify) and plan again: at the identified coefficients a forecast is"
            f" nearer to what a trial gives; otherwise run trial 1 ({first.name})"
            if found.at == START and found.recorded
            else f"run trial 1 ({first.name}), identify again, and plan again"
        ),
        sections=(
            Section(tables=(_trials(found),), sentences=tuple(_sheets(found))),
            *([Section(sentences=tuple(_on_top(found)))] if found.dithers else []),
            Section(tables=(_precision(found),), sentences=tuple(unknown)),
            Section(tables=(_others(found),), sentences=tuple(_rest(found)), details=True),
        ),
    )


def _trials(found: Plan) -> Table:
    rows = [["", "so far", "", "", "", "", _number(found.score_before), ""]]
    rows += [[str(number), *_cells(ranked)] for number, ranked in enumerate(found.sequence, 1)]
    title = (
        f"Next trials of {found.budget_s:g} s, in this order (score: sum of relative std. deviations left)"
    )
    return Table.of(title, ["trial", "manoeuvre", *_HEAD], rows, left=2)


def _sheets(found: Plan) -> Iterator[str]:
    """How each trial is run, and what it may bring about."""
    for number, ranked in enumerate(found.sequence, 1):
        start = (
            f"start {ranked.manoeuvre.start.words}, O {ranked.forecast.start_depth_m:.1f} m deep or deeper"
        )
        yield (
            f"Trial {number}: {ranked.manoeuvre.words}; {start}; {_times(ranked)}; speed to"
            f" {ranked.forecast.speed_m_s:.1f} m/s, heel to {ranked.forecast.roll_deg:.0f}, trim to"
            f" {ranked.forecast.pitch_deg:.0f} deg."
        )
        yield from (f"WARNING: trial {number}: {warning}" for warning in ranked.forecast.warnings)


def _on_top(found: Plan) -> Iterator[str]:
    """What to add to the autopilot's output where feedback dominates an axis."""
    for dither in found.dithers:
        yield f"With the autopilot on, {dither.sentence}. Table: {dither.file_name}."


def _precision(found: Plan) -> Table:
    """Standard deviation of every coefficient, before and after each trial."""
    after = [{change.name: change for change in ranked.gains} for ranked in found.sequence]
    rows = [
        [
            change.name,
            change.unit,
            f"{change.value:.4g}",
            change.told(change.before),
            *(change.told(changes[change.name].after) for changes in after),
        ]
        for change in found.coefficients
    ]
    numbered = (f"after {number}" for number in range(1, len(after) + 1))
    head = ["coefficient", "unit", "value", "so far", *numbered]
    zero = "" if all(change.of_value for change in found.coefficients) else "; where it is zero, in its unit"
    return Table.of(f"Standard deviations in per cent of the value{zero}", head, rows, left=2)


def _others(found: Plan) -> Table:
    """The best manoeuvres instead of the first one, those that leave less than what is known already."""
    others, seen = [], {found.sequence[0].manoeuvre.name}
    for ranked in found.ranking:
        if ranked.manoeuvre.name not in seen and ranked.score < _WORTH * found.score_before:
            seen.add(ranked.manoeuvre.name)
            others.append(_cells(ranked, names=2))
    title = f"The best of {len(others)} others"
    return Table.of(title, ["instead of trial 1", *_HEAD], others[:_OTHERS])


def _rest(found: Plan) -> Iterator[str]:
    """The same time in staircases, manoeuvres that do not fit, what was assumed."""
    if found.staircases_score is not None:
        yield (
            f"The same time in staircases alone would leave {_number(found.staircases_score)} instead of"
            f" {_number(found.score_after)}."
        )
    refused = list(found.refused.items())
    if refused:
        words = "; ".join(f"{name}: {reason}" for name, reason in refused[:_MOST_REFUSED])
        more = f"; and {len(refused) - _MOST_REFUSED} more" if len(refused) > _MOST_REFUSED else ""
        yield f"Left out, even at its smallest: {words}{more}"
    groups: dict[str, list[str]] = {}
    for channel, noise in found.instruments.noise.items():
        angle = channel in ("p", "q", "r", "roll", "pitch", "yaw")
        unit = ("deg" if angle else "m") + ("/s" if channel in "uvwpqr" else "")
        groups.setdefault(f"{noise / DEGREE if angle else noise:.3g} {unit}", []).append(channel)
    sizes = ", ".join(f"{' '.join(channels)} {size}" for size, channels in groups.items())
    yield (
        f"Assumed: noise of {sizes}; one sample per {found.instruments.correlation_s:.2g} s counts; unknown"
        f" current {found.instruments.current_m_s:g} m/s; the model as it is."
    )


def _still_unknown(found: Plan) -> list[str]:
    """What stays unknown after the trials, and which manoeuvre would show it best."""
    groups: dict[str, list[str]] = {}
    for change in found.coefficients:
        if change.after / change.whole <= _UNKNOWN:
            continue
        best, left = "", change.after
        for ranked in found.ranking:
            after = next(gain.after for gain in ranked.gains if gain.name == change.name)
            if after < _BETTER * left:
                best, left = ranked.manoeuvre.name, after
        told = change.told(left, change.unit) + (" %" if change.of_value else "")
        groups.setdefault(best, []).append(f"{change.name} ({told})" if best else change.name)
    return [
        f"Still unknown to more than {100 * _UNKNOWN:.0f} %, "
        + (f"best shown by {best}" if best else "and no manoeuvre that fits improves it")
        + f": {', '.join(names)}"
        for best, names in groups.items()
    ]


def _cells(ranked: Ranked, *, names: int = 3) -> list[str]:
    """Cells of a trial: name, thrust, times, area, depth, score, what it determines best."""
    seen = ranked.forecast
    return [
        ranked.manoeuvre.name,
        f"{100 * ranked.amplitude:.0f} %" if ranked.amplitude else "none",
        _times(ranked),
        f"{seen.along_m:.0f} x {seen.across_m:.0f}",
        f"{seen.deepest_m:.0f}",
        _number(ranked.score),
        ", ".join(change.name for change in ranked.gains[:names]),
    ]


def _times(ranked: Ranked) -> str:
    duration = f"{ranked.manoeuvre.duration_s:.0f} s"
    return f"{ranked.repeats} x {duration}" if ranked.repeats > 1 else duration


def _percent(share: float) -> str:
    """A share in per cent with two digits."""
    return f"{100.0 * share:.0f}" if share >= 0.1 else f"{100.0 * share:.2g}"


def _number(value: float) -> str:
    return f"{value:.3g}"
