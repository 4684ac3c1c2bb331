"""Result of a tuning: autopilot, responses and margins; as report, plain data and files.

Held by tests/tuning/test_tune.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.files import parquet
from seatrial.base.plain import plain
from seatrial.base.run import RunResult, to_json
from seatrial.flight.mismatch import tuned_for
from seatrial.tuning.performance import Performance
from seatrial.tuning.search import GROUP_SEARCH_SETTINGS, GroupResult

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.margin_report import ReportedMargins
    from seatrial.control_design.tuning_table import Margins
    from seatrial.tuning.control_problem import ControlProblem

_DIGITS = 4  # of gains in a file: no more is read or set by hand

_ANY = ", with any gains within the bounds"


@dataclass(frozen=True, eq=False, repr=False)
class Tuning(RunResult):
    """What a tuning found; made by `seatrial.tune`.

    Attributes
    ----------
    plan
        What was asked, with its trials and samples.
    autopilot
        With the tuned gains.
    groups
        A `GroupResult` per search, in the order of the searches.
    performance
        Responses of the start gains ("start") and of the tuned ones ("tuned") on samples that the search
        never saw.
    reverted
        Groups that have their start gains again, because everything together is better with them.
    elapsed_s
        Wall time.
    interrupted
        Whether Ctrl-C ended it; then nothing is assessed.
    kept
        Autopilot file with the best gains so far, of an interrupted tuning with a run directory.
    quiet
        The tuned gains with perfect sensors, where a response leaves its corridor: what noise has to do with
        it.
    facts
        What the result rests on, see `seatrial.base.run.run_facts`.
    """

    plan: ControlProblem
    autopilot: Autopilot
    groups: tuple[GroupResult, ...]
    performance: tuple[Performance, ...]
    reverted: tuple[str, ...]
    elapsed_s: float
    interrupted: bool
    kept: Path | None = None
    quiet: Performance | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        groups = ", ".join(group.name for group in self.groups)
        state = "interrupted" if self.interrupted else f"feasible={self.feasible}"
        return f"Tuning({self.plan.name}: {state}, searched: {groups})"

    @property
    def start(self) -> Autopilot:
        """The autopilot with the start gains."""
        return self.plan.autopilot

    def of(self, name: str) -> Performance | None:
        """The assessment of that name."""
        return next((performance for performance in self.performance if performance.name == name), None)

    @property
    def feasible(self) -> bool:
        """Whether the vehicle itself violates no corridor with the tuned gains."""
        tuned = self.of("tuned")
        return tuned is not None and tuned.feasible

    @property
    def held(self) -> bool:
        """Whether corridors and margins are held: by the vehicle itself, and by its linear loops."""
        return self.feasible and not self.short_margins

    @property
    def outcome(self) -> str:
        """In a word or two: tuned, requirements not met, or interrupted."""
        if self.interrupted:
            return "interrupted"
        return "tuned" if self.held else "tuned, requirements not met"

    @cached_property
    def margins(self) -> Mapping[str, list[ReportedMargins]]:
        """Margins per mode, reachable breakpoint and loop, "start" and "tuned"."""
        from seatrial.control_design.margin_report import report_margins

        pairs = {"start": self.start, "tuned": self.autopilot}
        plan = self.plan
        return {
            name: report_margins(plan.vehicle, autopilot, sensors=plan.sensors)
            for name, autopilot in pairs.items()
        }

    @property
    def short_margins(self) -> tuple[str, ...]:
        """Loops whose margins fall short of the campaign's, with what there is and what was asked."""
        if self.interrupted:
            return ()
        rows = self.margins["tuned"]
        # A motion that grows is no matter of limits: it counts where no margin is asked for, too.
        unstable = dict.fromkeys((row.mode, row.speed_m_s) for row in rows if not row.stable)
        beyond = self.plan.beyond_gains
        shortfalls = [
            f"{mode} at {speed:.2f} m/s (unstable{_ANY if (mode, speed) in beyond else ''})"
            for mode, speed in sorted(
                unstable, key=lambda point: (point in beyond, point[1] < 0.0, abs(point[1]))
            )
        ]
        for row in rows:
            short = _told_short(row, self.plan.table.margins)
            if short and row.stable:  # margins of an unstable loop mean something else
                shortfalls.append(f"{row.loop} in {row.mode} at {row.speed_m_s:.2f} m/s ({', '.join(short)})")
        return tuple(shortfalls)

    def on(self, vehicle: Vehicle | str | Path, *, name: str = "another vehicle") -> Performance:
        """How the tuned responses keep to their corridors on a vehicle that the autopilot does not know.

        Parameters
        ----------
        vehicle : Vehicle, built-in name or file
            That flies, in still water; the autopilot's own model stays the identified one.
        name : str, optional
            What to call it.

        Raises
        ------
        VehicleError
            It cannot be loaded.
        SimulationError
            Its actuators are others.
        """
        from seatrial._core import Vehicle
        from seatrial.base.toml_file import loaded
        from seatrial.tuning.performance import assess
        from seatrial.tuning.step_trial import Samples

        flown = loaded(Vehicle, vehicle)
        still = Samples({}, np.zeros((1, 3)), (1,))
        return assess(self.plan, name, self.plan.rig(self.autopilot, vehicle=flown), still)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data."""
        return {
            "campaign": self.plan.name,
            "vehicle": self.plan.vehicle.name,
            "autopilot": self.autopilot.name,
            "feasible": self.feasible,
            "held": self.held,
            "short_margins": list(self.short_margins),
            "interrupted": self.interrupted,
            "kept": None if self.kept is None else str(self.kept),
            "elapsed_s": self.elapsed_s,
            "plan": self.plan.to_dict(),
            "gains": {"start": self.start.gains(), "tuned": self.autopilot.gains()},
            "reverted": list(self.reverted),
            "groups": [group.to_dict() for group in self.groups],
            "performance": [performance.to_dict() for performance in self.performance],
            "margins": {} if self.interrupted else plain(self.margins),
            "notes": list(self.plan.fitted.notes),
        }

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        from dataclasses import asdict

        import polars as pl
        import tomlkit

        history = [{"search": group.name} | asdict(step) for group in self.groups for step in group.history]
        trials = [
            {"autopilot": performance.name} | asdict(trial)
            for performance in self.performance
            for trial in performance.trials
        ]
        asked = {"tuning": self.plan.table.model_dump(mode="json", exclude_none=True, exclude_defaults=True)}
        return {
            **(
                {"tuning.toml": tomlkit.dumps(asked)}
                if self.plan.given_text is None
                else {"campaign.toml": self.plan.given_text}
            ),
            "autopilot.toml": self.autopilot.to_toml(),
            "start_autopilot.toml": self.start.to_toml(),
            "vehicle.toml": self.plan.vehicle.to_toml(),
            "tuning.json": to_json(self.to_dict()),
            **self.report().files(),
            "history.parquet": parquet(pl.DataFrame(history, infer_schema_length=None)),
            "trials.parquet": parquet(pl.DataFrame(trials, infer_schema_length=None)),
        }


def tuned_autopilot(
    start: Autopilot, gains: Mapping[str, float], name: str, origin: str, vehicle: str
) -> Autopilot:
    """The autopilot with other gains, four digits each, under a name that says where they come from.

    The description says for which vehicle (`seatrial.flight.mismatch`).
    """
    rounded = {name: float(f"{value:.{_DIGITS}g}") for name, value in gains.items()}
    tuned = start.with_gains(rounded) if rounded else start
    return tuned.renamed(f"{name} tuned", tuned_for(start.name, vehicle, origin))


def _told_short(row: ReportedMargins, margins: Margins) -> list[str]:
    """Margins of a loop that fall short of a campaign's limits, with what was asked."""
    return [
        f"{shown_below(value, limit)} {unit} of {limit:g}"
        for value, limit, unit in missed_limits(row, margins)
    ]


def missed_limits(row: ReportedMargins, margins: Margins) -> list[tuple[float, float, str]]:
    """Margins of a loop that fall short of a campaign's limits: value, limit, unit."""
    limits = margins.at(row.speed_m_s)
    return [
        (value, limit, unit)
        for value, limit, unit in (
            (row.phase_deg, limits.phase_deg, "deg"),
            (row.gain_up_db, limits.gain_db, "dB"),
            (row.gain_down_db, limits.gain_db, "dB down"),
            (row.delay_s, limits.delay_s, "s"),
        )
        if value is not None and value < (1.0 - GROUP_SEARCH_SETTINGS.margin_rounding) * limit
    ]


def shown_below(value: float, limit: float) -> str:
    """A number below a limit, with as many digits as tell the two apart."""
    for digits in range(2, 6):
        if float(text := f"{value:.{digits}g}") < limit:
            break
    return text


def without_table(problem: ControlProblem) -> tuple[str, ...]:
    """A sentence where a campaign does not say what to tune."""
    if problem.given_text is None or problem.table.model_fields_set:
        return ()
    return (
        "The campaign has no [tuning]: steps, corridors and speeds are the defaults of its vehicle and its"
        " autopilot; a table [tuning] says what the loops shall do.",
    )
