"""Identification: what a campaign found, for people, for machines and as files."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.parameters import actuator_groups
from seatrial.recording.columns import CHANNELS
from seatrial.run_directory import RUN_FILE, RunDirectory, to_json
from seatrial.stage import StageResult

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign import Campaign
    from seatrial.score import Score

_AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
_AT_BOUND = 0.005


@dataclass(frozen=True)
class Estimate:
    """One coefficient: from where it started, where it may lie, where it came to lie.

    ``at_bound`` is "lower" or "upper" where the estimate lies within 0.5 % of the box at a bound, else None.
    """

    name: str
    unit: str
    start: float
    estimate: float
    lower: float
    upper: float
    at_bound: str | None
    stage: str
    parameter: str

    @property
    def factor(self) -> float | None:
        """Estimate over start value, None where that is zero."""
        return self.estimate / self.start if self.start else None


@dataclass(frozen=True)
class Identification:
    """The identified vehicle, its coefficients, stages and scores; made by `seatrial.identify`.

    Attributes
    ----------
    campaign
        What was asked for.
    vehicle
        The campaign's vehicle with the estimates.
    coefficients
        An `Estimate` per coefficient: start value, estimate, bounds, bound hit or not.
    stages
        A `StageResult` per stage that ran: costs, history, segments, step.
    scores
        "fit" (the training part of every trial in a stage) and, where something is held out, "hold_out";
        each holds a `Score` per trial and one pooled under "all", for ten seconds ahead ("ahead") and for a
        free run ("free").
    notes
        Sentences about what could not be scored.
    facts
        Versions, machine, seed, hashes of the inputs, times.
    interrupted, not_run
        Whether Ctrl-C ended the run early, and the stages that it left out.
    """

    campaign: Campaign
    vehicle: Vehicle
    coefficients: tuple[Estimate, ...]
    stages: tuple[StageResult, ...]
    scores: Mapping[str, Mapping[str, Mapping[str, Score]]]
    notes: tuple[str, ...]
    facts: Mapping[str, Any]
    interrupted: bool
    not_run: tuple[str, ...]

    def summary(self) -> str:
        """Text that a control engineer reads: stages, coefficients, what they mean, scores, advice."""
        parts = [self._stage_table(), self._coefficient_table(), self._meaning()]
        parts += [self._score_table(), self._advice()]
        return "\n\n".join(part for part in parts if part)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the trials as plain numbers, texts, lists and dicts."""
        return {
            "campaign": self.campaign.name,
            "vehicle": self.vehicle.name,
            "interrupted": self.interrupted,
            "not_run": list(self.not_run),
            "coefficients": [asdict(row) | {"factor": row.factor} for row in self.coefficients],
            "derived": derived(self.vehicle),
            "stages": [stage.to_dict() for stage in self.stages],
            "scores": {
                part: {
                    kind: {name: score.to_dict() for name, score in row.items()} for kind, row in of.items()
                }
                for part, of in self.scores.items()
            },
            "notes": list(self.notes),
            "facts": dict(self.facts),
        }

    def save(self, run_dir: str | Path) -> Path:
        """Path of a run directory with all results: vehicle file, JSON, Parquet, summary, campaign file.

        Parameters
        ----------
        run_dir : str or Path
            Made when it does not exist; an earlier run's is replaced.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        return self.publish(RunDirectory(run_dir))

    def publish(self, directory: RunDirectory) -> Path:
        """Path of an opened run directory after the results are in it. See `save`."""
        import polars as pl

        coefficients = pl.DataFrame(
            [asdict(row) | {"factor": row.factor} for row in self.coefficients], infer_schema_length=None
        )
        history = pl.DataFrame(
            [{"stage": stage.name} | asdict(step) for stage in self.stages for step in stage.history],
            infer_schema_length=None,
        )
        scores = pl.DataFrame(list(self._score_rows()), infer_schema_length=None)
        files: dict[str, str | bytes] = {
            RUN_FILE: to_json(self.facts),
            "campaign.toml": self.campaign.text,
            "vehicle.toml": self.vehicle.to_toml(),
            "identification.json": to_json(self.to_dict()),
            "summary.txt": self.summary() + "\n",
            "coefficients.parquet": _parquet(coefficients),
            "history.parquet": _parquet(history),
            "scores.parquet": _parquet(scores),
        }
        for stage in self.stages:
            if not stage.interrupted:
                files[directory.stage_name(stage.name)] = to_json(stage.to_dict())
        return directory.publish(files)

    def _stage_table(self) -> str:
        rows = [
            (
                stage.name + (" (interrupted)" if stage.interrupted else " (kept)" if stage.reused else ""),
                ", ".join(stage.trials),
                f"{stage.start_cost:.4g}",
                f"{stage.cost:.4g}",
                f"{stage.evaluations}",
                f"{1e3 * stage.step_s:.3g} ms",
                f"{stage.wall_s:.1f} s",
            )
            for stage in self.stages
        ]
        head = ("Stage", "trials", "cost at start", "best", "candidates", "step", "time")
        return _table(head, rows)

    def _coefficient_table(self) -> str:
        rows = [
            (
                row.name,
                row.unit,
                f"{row.start:.4g}",
                f"{row.estimate:.4g}",
                "" if row.factor is None else f"{row.factor:.3g}",
                f"[{row.lower + 0.0:.4g}, {row.upper + 0.0:.4g}]"
                + (f" at {row.at_bound}" if row.at_bound else ""),
                row.stage,
            )
            for row in self._distinct()
        ]
        return _table(("Coefficient", "unit", "start", "estimate", "factor", "bounds", "stage"), rows)

    def _distinct(self) -> tuple[Estimate, ...]:
        """Rows with one for the equal coefficients of an actuator group, under the group's name."""
        names = {row.name for row in self.coefficients}
        rows: dict[tuple[str, float], Estimate] = {}
        for row in self.coefficients:
            name = row.name if row.parameter in names else row.parameter
            rows.setdefault((name, row.estimate), replace(row, name=name))
        return tuple(rows.values())

    def _meaning(self) -> str:
        return _table(
            ("Quantity", "value"), [(name, f"{value:.4g}") for name, value in derived(self.vehicle).items()]
        )

    def _score_rows(self) -> Iterator[dict[str, Any]]:
        for part, kinds in self.scores.items():
            for kind, row in kinds.items():
                for trial, score in row.items():
                    for channel, one in score.items():
                        yield {"part": part, "kind": kind, "trial": trial, "channel": channel} | asdict(one)

    def _score_table(self) -> str:
        titles = {"ahead": "10 s ahead", "free": "free run"}
        scored = {row["channel"] for row in self._score_rows()}
        channels = [channel for channel in CHANNELS if channel in scored]
        rows = []
        for part, kinds in self.scores.items():
            for kind, per_trial in kinds.items():
                for trial, score in per_trial.items():
                    cells = (f"{score.r2[c]:.3f}" if c in score.r2 else "" for c in channels)
                    rows.append((f"R2 {part.replace('_', ' ')}, {titles[kind]}", trial, *cells))
        return _table(("Score", "trial", *channels), rows) if rows else ""

    def _advice(self) -> str:
        lines = [
            f"{row.name} lies at its {row.at_bound} bound: widen it if the value makes sense; otherwise the"
            " data of its stage cannot tell this coefficient"
            for row in self._distinct()
            if row.at_bound
        ]
        lines += self.notes
        if self.interrupted:
            lines.append(
                "Interrupted: the best so far is shown"
                + (f"; not run: {', '.join(self.not_run)}" if self.not_run else "")
                + ". Run again with the same run directory to go on"
            )
        return "\n".join(lines)


def derived(vehicle: Vehicle) -> dict[str, float]:
    """What the coefficients mean: apparent masses and inertias, net buoyancy, gains and lags per group."""
    values = vehicle.coefficients()
    mass = vehicle.mass_matrix()
    found = {
        f"apparent {'mass' if axis < 3 else 'inertia'} in {name}, {'kg' if axis < 3 else 'kg m2'}": float(
            mass[axis][axis]
        )
        for axis, name in enumerate(_AXES)
    }
    found["net buoyancy B - m g, N"] = values.get("B", 0.0) - values["m"] * vehicle.environment()["g"]
    groups = actuator_groups(vehicle)
    for suffix, words in (("gain", "thrust gain"), ("T_1", "lag T_1, s"), ("T_t", "dead time T_t, s")):
        for group, actuators in groups.items():
            each = {
                actuator: values[key] for actuator in actuators if (key := f"{actuator}.{suffix}") in values
            }
            if len(set(each.values())) == 1:
                found[f"{group} {words}"] = next(iter(each.values()))
            else:
                found |= {f"{actuator} {words}": value for actuator, value in each.items()}
    return found


def estimates(campaign: Campaign, stages: tuple[StageResult, ...]) -> tuple[Estimate, ...]:
    """Rows for every coefficient that a stage set; the last stage that set it counts."""
    initial, info = campaign.vehicle.coefficients(), campaign.vehicle.coefficient_info()
    rows: dict[str, Estimate] = {}
    for stage in stages:
        for parameter in campaign.parameters[stage.name]:
            value = stage.estimates[parameter.name]
            near = _AT_BOUND * (parameter.upper - parameter.lower)
            for member, factor in parameter.members:
                lower, upper = sorted((factor * parameter.lower, factor * parameter.upper))
                at_bound = None
                if value - parameter.lower < near:
                    at_bound = "lower" if factor > 0 else "upper"
                elif parameter.upper - value < near:
                    at_bound = "upper" if factor > 0 else "lower"
                start = (
                    stage.starts[parameter.name] * factor
                    if parameter.start_given
                    else initial.get(member, 0.0)
                )
                rows[member] = Estimate(
                    name=member,
                    unit=info[member]["unit"],
                    start=start,
                    estimate=factor * value,
                    lower=lower,
                    upper=upper,
                    at_bound=at_bound,
                    stage=stage.name,
                    parameter=parameter.name,
                )
    return tuple(rows.values())


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Text table with aligned columns; empty without rows."""
    if not rows:
        return ""
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in [head, *rows]
    ]
    return "\n".join(line.rstrip() for line in lines)


def _parquet(frame: Any) -> bytes:
    stream = io.BytesIO()
    frame.write_parquet(stream)
    return stream.getvalue()
