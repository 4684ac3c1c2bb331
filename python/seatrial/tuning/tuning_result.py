"""Tuning: the autopilot that was found, how its responses and margins are, for people, machines and as files.

Held by tests/test_tune.py.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.run_directory import RUN_FILE, RunDirectory, to_json
from seatrial.tuning.group_search import GroupResult
from seatrial.tuning.judged import Judged
from seatrial.whole_file import parquet

if TYPE_CHECKING:
    from collections.abc import Mapping

    from seatrial._core import Autopilot, Vehicle
    from seatrial.campaign import Campaign
    from seatrial.tuning.margin_report import ReportedMargins
    from seatrial.tuning.relay import RelayTuning
    from seatrial.tuning.tuning_plan import TuningPlan

__all__ = ["Tuning", "tuned_autopilot"]

_DIGITS = 4
_ROUNDING = 0.01  # what the frequency grid and four digits of a gain leave


@dataclass(frozen=True, eq=False, repr=False)
class Tuning:
    """What a tuning found; made by `seatrial.tune`.

    Attributes
    ----------
    campaign, plan
        What was asked for, and the trials and samples that it became.
    autopilot
        With the tuned gains.
    groups
        A `GroupResult` per search, in the order of the searches.
    judged
        Responses of the start gains ("start"), of a relay autotuning where asked for ("relay") and of the
        tuned ones ("tuned") on samples that the search never saw.
    relay
        The relay autotuning; None where not asked for.
    taken_back
        Groups that have their start gains again, because everything together is better with them.
    elapsed_s
        Wall time.
    interrupted
        Whether Ctrl-C ended it; then nothing is judged.
    kept
        Autopilot file with the best gains so far, of an interrupted tuning with a run directory.
    quiet
        The tuned gains with perfect sensors, where a response leaves its corridor: what noise has to do with
        it.
    """

    campaign: Campaign
    plan: TuningPlan
    autopilot: Autopilot
    groups: tuple[GroupResult, ...]
    judged: tuple[Judged, ...]
    relay: RelayTuning | None
    taken_back: tuple[str, ...]
    elapsed_s: float
    interrupted: bool
    kept: Path | None = None
    quiet: Judged | None = None

    def __repr__(self) -> str:
        groups = ", ".join(group.name for group in self.groups)
        state = "interrupted" if self.interrupted else f"feasible={self.feasible}"
        return f"Tuning({self.campaign.name}: {state}, searched: {groups})"

    @property
    def start(self) -> Autopilot:
        """The autopilot with the start gains."""
        return self.plan.autopilot

    def of(self, name: str) -> Judged | None:
        """The judgement of that name."""
        return next((judged for judged in self.judged if judged.name == name), None)

    @property
    def feasible(self) -> bool:
        """Whether the vehicle itself violates no corridor with the tuned gains."""
        tuned = self.of("tuned")
        return tuned is not None and tuned.feasible

    @property
    def held(self) -> bool:
        """Whether corridors and margins are held: by the vehicle itself, and by its linear loops."""
        return self.feasible and not self.short_margins

    @cached_property
    def margins(self) -> Mapping[str, list[ReportedMargins]]:
        """Margins by python-control per mode, reachable supporting point and loop, "start" and "tuned"."""
        from seatrial.tuning.margin_report import report_margins

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
        found = [f"{mode} at {speed:.2f} m/s (unstable)" for mode, speed in unstable]
        for row in rows:
            limits = self.plan.table.margins.at(row.speed_m_s)
            short = [
                f"{_below(value, limit)} {unit} of {limit:g}"
                for value, limit, unit in (
                    (row.phase_deg, limits.phase_deg, "deg"),
                    (row.gain_up_db, limits.gain_db, "dB"),
                    (row.gain_down_db, limits.gain_db, "dB down"),
                    (row.delay_s, limits.delay_s, "s"),
                )
                if value is not None and value < (1.0 - _ROUNDING) * limit
            ]
            if short and row.stable:  # margins of an unstable loop mean something else
                found.append(f"{row.loop} in {row.mode} at {row.speed_m_s:.2f} m/s ({', '.join(short)})")
        return tuple(found)

    def on(self, vehicle: Vehicle | str | Path, *, name: str = "another vehicle") -> Judged:
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
        from seatrial.file_kind import loaded
        from seatrial.tuning.judged import judge
        from seatrial.tuning.loop_trials import Samples

        flown = loaded(Vehicle, vehicle)
        still = Samples({}, np.zeros((1, 3)), (1,))
        return judge(self.plan, name, self.plan.rig(self.autopilot, vehicle=flown), still)

    def summary(self) -> str:
        """Text that a control engineer reads."""
        from seatrial.tuning.tuning_text import summary

        return summary(self)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data."""
        return {
            "campaign": self.campaign.name,
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
            "taken_back": list(self.taken_back),
            "groups": [group.to_dict() for group in self.groups],
            "judged": [judged.to_dict() for judged in self.judged],
            "margins": {} if self.interrupted else _plain_margins(self.margins),
            "relay": None if self.relay is None else self.relay.to_dict(),
            "notes": list(self.plan.fitted.notes),
        }

    def save(self, run_dir: str | Path) -> Path:
        """Path of a run directory with all results; an earlier run's is replaced.

        Parameters
        ----------
        run_dir : str or Path
            Made when it does not exist.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        return self.publish(RunDirectory(run_dir))

    def publish(self, directory: RunDirectory) -> Path:
        """Path of an opened run directory after the results are in it. See `save`."""
        from dataclasses import asdict

        import polars as pl

        from seatrial.run_facts import run_facts

        history = [{"search": group.name} | asdict(step) for group in self.groups for step in group.history]
        trials = [
            {"autopilot": judged.name} | asdict(trial) for judged in self.judged for trial in judged.trials
        ]
        files: dict[str, str | bytes] = {
            RUN_FILE: to_json(run_facts(self.campaign, trials=False) | {"kind": "tuning"}),
            "campaign.toml": self.campaign.text,
            "autopilot.toml": self.autopilot.to_toml(),
            "start_autopilot.toml": self.start.to_toml(),
            "vehicle.toml": self.plan.vehicle.to_toml(),
            "tuning.json": to_json(self.to_dict()),
            "summary.txt": self.summary() + "\n",
            "history.parquet": parquet(pl.DataFrame(history, infer_schema_length=None)),
            "trials.parquet": parquet(pl.DataFrame(trials, infer_schema_length=None)),
        }
        return directory.publish(files)


def tuned_autopilot(start: Autopilot, gains: Mapping[str, float], campaign: str) -> Autopilot:
    """The autopilot with other gains, four digits each, under a name that says where they come from."""
    import tomlkit

    from seatrial._core import Autopilot

    rounded = {name: float(f"{value:.{_DIGITS}g}") for name, value in gains.items()}
    text = tomlkit.parse(start.with_gains(rounded).to_toml() if rounded else start.to_toml())
    text["name"] = f"{campaign} tuned"
    text["description"] = f"Gains of {start.name} tuned on the campaign {campaign} by constraint criteria"
    return Autopilot.from_toml(tomlkit.dumps(text), "tuned")


def _plain_margins(margins: Mapping[str, list[ReportedMargins]]) -> dict[str, list[dict[str, Any]]]:
    return {name: [row.to_dict() for row in rows] for name, rows in margins.items()}


def _below(value: float, limit: float) -> str:
    """A number below a limit, with as many digits as tell the two apart."""
    for digits in range(2, 6):
        if float(told := f"{value:.{digits}g}") < limit:
            break
    return told
