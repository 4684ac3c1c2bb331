"""A plan as a result: trials in their order, the room each needs and the standard deviations it leaves."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.base.errors import TrialError
from seatrial.base.run import RunDirectory, to_json

if TYPE_CHECKING:
    from seatrial.experiment.fisher import Instruments
    from seatrial.experiment.forecast import Forecast
    from seatrial.experiment.manoeuvre import Manoeuvre

__all__ = ["Change", "Plan", "Ranked"]

_SHEET_ROWS = 8


@dataclass(frozen=True)
class Change:
    """Standard deviation of one coefficient before and after, in its unit; relative to ``relative_to``."""

    name: str
    unit: str
    value: float
    relative_to: float
    before: float
    after: float

    @property
    def relative_before(self) -> float:
        """Relative standard deviation before; one is 100 %."""
        return self.before / self.relative_to

    @property
    def relative_after(self) -> float:
        """Relative standard deviation after."""
        return self.after / self.relative_to

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
class Plan:
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
            "instruments": {
                "noise": dict(self.instruments.noise),
                "correlation_s": self.instruments.correlation_s,
                "segment_s": self.instruments.segment_s,
                "current_m_s": self.instruments.current_m_s,
            },
            "coefficients": [change.to_dict() for change in self.coefficients],
            "sequence": [one.to_dict() for one in self.sequence],
            "ranking": [one.to_dict() for one in self.ranking],
            "refused": dict(self.refused),
        }

    def save(self, run_dir: str | Path) -> Path:
        """Path of a run directory with the plan, and the command file and sheet of every trial.

        Parameters
        ----------
        run_dir : str or Path
            Made when it does not exist; an earlier run's is replaced.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        with RunDirectory(run_dir) as run:
            return run.publish(self.facts, self.files())

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        files: dict[str, str | bytes] = {"plan.json": to_json(self.to_dict())}
        for number, one in enumerate(self.sequence, 1):
            name = "trial" if number == 1 else f"trial-{number}"
            files[f"{name}.csv"] = one.manoeuvre.table().write_csv()
            files[f"{name}.toml"] = self.sheet(one, f"{name}.csv", number)
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
        one = self.sequence[trial - 1]
        sheet = target.with_suffix(".toml")
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            one.manoeuvre.write_csv(target)
            sheet.write_text(self.sheet(one, target.name, trial), encoding="utf-8")
        except OSError as error:
            raise TrialError(
                f"{target}: cannot be written ({error.strerror}); choose a folder that you may write to"
            ) from None
        return [target, sheet]

    def sheet(self, one: Ranked, commands: str, trial: int) -> str:
        """TOML text for the operator of a trial: manoeuvre, times, room, warnings, standard deviations."""
        manoeuvre, seen = one.manoeuvre, one.forecast
        depth = f"{seen.start_depth_m:.1f} m deep or deeper"
        lines = [
            f"# Trial {trial} of {len(self.sequence)} for {self.vehicle}. Depths are those of O.",
            f"name = {_text(manoeuvre.name)}",
            f"vehicle = {_text(self.vehicle)}",
            f"commands = {_text(commands)}",
            f"what = {_text(manoeuvre.words)}",
            f"start = {_text(f'{manoeuvre.start.words}, {depth}')}",
            f"duration_s = {manoeuvre.duration_s:.1f}",
            f"repeats = {one.repeats}",
            f"pause_s = {manoeuvre.pause_s:.1f} # between repeats",
            f"area_m = [{seen.along_m:.0f}, {seen.across_m:.0f}] # along the course at the start, across it",
            f"start_depth_m = {seen.start_depth_m:.1f}",
            f"deepest_m = {seen.deepest_m:.1f}",
            f"largest_roll_deg = {seen.roll_deg:.0f}",
            f"largest_pitch_deg = {seen.pitch_deg:.0f}",
            f"top_speed_m_s = {seen.speed_m_s:.2f}",
            f"warnings = [{', '.join(_text(warning) for warning in seen.warnings)}]",
            "",
            "# Standard deviations in per cent of the coefficient, before and after this trial.",
            "[tells]",
        ]
        lines += [
            f"{_text(change.name)} = {{ before = {100 * change.relative_before:.1f},"
            f" after = {100 * change.relative_after:.1f} }}"
            for change in one.gains[:_SHEET_ROWS]
        ]
        return "\n".join(lines) + "\n"


def _text(words: str) -> str:
    """A TOML basic string."""
    return json.dumps(words, ensure_ascii=False)
