"""A plan as a result: trials in their order, the room each needs and the standard deviations it leaves."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.base.atomic_write import write_atomic, writing
from seatrial.base.errors import TrialError
from seatrial.base.plain import Plain
from seatrial.base.run import RunResult, to_json

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.experiment.dither import Dither
    from seatrial.experiment.fisher import Instruments
    from seatrial.experiment.forecast import Forecast
    from seatrial.experiment.manoeuvre import Manoeuvre


VEHICLE, IDENTIFIED, START = "vehicle", "identification", "start values"
"""Whence the coefficients are at which a plan is made."""


@dataclass(frozen=True)
class Change(Plain, also="relative_before relative_after"):
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
        return abs(self.value) > 0.01 * self.relative_to  # a smaller share is one of zero

    @property
    def whole(self) -> float:
        """What is printed is relative to it: the value, or what the score takes where that is about zero."""
        return abs(self.value) if self.of_value else self.relative_to

    def told(self, deviation: float, unit: str = "") -> str:
        """A deviation in per cent of the value, or as ± in its unit where the value is about zero."""
        if self.of_value:
            return _percent(deviation / self.whole)
        return f"± {deviation:.2g} {unit}".rstrip()


@dataclass(frozen=True)
class Ranked(
    Plain,
    without="manoeuvre",
    also="name=manoeuvre.name kind=manoeuvre.kind words=manoeuvre.words start=manoeuvre.start.words"
    " duration_s=manoeuvre.duration_s pause_s=manoeuvre.pause_s",
):
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


@dataclass(frozen=True, repr=False)
class Plan(RunResult, Plain, without="facts model", also="score_after"):
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
    model
        The vehicle that was planned for; its figures need it.
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
    model: Vehicle | None = None

    @property
    def score_after(self) -> float:
        """Sum of the relative standard deviations after the sequence."""
        return self.sequence[-1].score

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        files: dict[str, str | bytes] = {"plan.json": to_json(self.to_dict()), **self.report().files()}
        for number, ranked in enumerate(self.sequence, 1):
            name = "trial" if number == 1 else f"trial-{number}"
            files[f"{name}.csv"] = ranked.manoeuvre.table().write_csv()
            files[f"{name}.toml"] = self.sheet(ranked, f"{name}.csv", number)
        files |= {dither.file_name: dither.csv() for dither in self.dithers}
        return files

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
        with writing(target, TrialError):
            target.parent.mkdir(parents=True, exist_ok=True)
            ranked.manoeuvre.write_csv(target)
            write_atomic(sheet, self.sheet(ranked, target.name, trial).encode())
        return [target, sheet]

    def write_dithers(self, folder: str | Path) -> list[Path]:
        """Paths of the tables of the dithers, written into a folder."""
        paths = [Path(folder) / dither.file_name for dither in self.dithers]
        for path, dither in zip(paths, self.dithers, strict=True):
            with writing(path, TrialError):
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomic(path, dither.csv().encode())
        return paths

    def sheet(self, ranked: Ranked, commands: str, trial: int) -> str:
        """TOML text for the operator of `ranked`, a trial of the sequence or ranking: manoeuvre, times, room,
        warnings, deviations.

        `commands` is the name of its command file, `trial` its number in the sequence, from 1.
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
        lines += [_tells(change) for change in ranked.gains[:8]]  # those that it tells most of
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


@dataclass(frozen=True)
class PlanWordingSettings:
    """Which deviations a plan calls unknown or better."""

    unknown_sd: float = 0.5  #: Relative deviation from which a coefficient is unknown.
    better_share: float = 0.9  #: Of that deviation: a trial helps below it.


PLAN_RESULT_SETTINGS = PlanWordingSettings()


def _percent(share: float) -> str:
    """A share in per cent with two digits."""
    return f"{100.0 * share:.0f}" if share >= 0.1 else f"{100.0 * share:.2g}"
