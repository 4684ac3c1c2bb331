"""Ends of random starts: which of them are at the optimum, how far they scatter, and what to do.

A stage's end is *at the optimum* where

1. its criterion lies within 0.1 % of the lowest one found, and
2. every estimate lies within 1 % of its bounds' width of that of the lowest one, or, where its standard
   deviation is known, within a quarter of that, at most 5 %: closer together than the data can resolve.

Ends that meet the first rule alone lie along a direction in which the criterion hardly changes. It is the
first principal axis of their estimates in the box of the bounds, and its coefficients are named.

Held by `test_random_starts_find_the_same_optimum`, `test_an_end_elsewhere_is_named_with_its_cost` and
`test_a_flat_direction_is_named`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.atomic_write import parquet
from seatrial.base.progress import Step
from seatrial.base.report import Report, Section, Table
from seatrial.base.run import RunResult, to_json
from seatrial.estimation.stage import StageResult
from seatrial.problem.parameter import Parameter

Verdict = Literal["same optimum", "flat direction", "several optima"]

COST_TOLERANCE = 1e-3
"""Part of the lowest criterion by which an end at the optimum may lie above it."""

_WIDTH, _MOST_WIDTH = 0.01, 0.05

_SIGMAS = 0.25

_IN_DIRECTION, _NAMED = 0.3, 4  # of the largest component, and how many are named


@dataclass(frozen=True, eq=False)
class StageRestarts:
    """One stage from k random starts with m parameters, SI.

    Attributes
    ----------
    name, parameters, units
        Of the stage and of its parameters (m).
    lower, upper, sigma
        Bounds (m,) and standard deviations (m,), not a number where unknown.
    starts, ends
        Start values and estimates (k, m).
    start_costs, costs
        Criterion (k,) at the start and at the end.
    histories
        Course of every search.
    exhausted
        Whether the global search of a start used all of its generations (k,).
    """

    name: str
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    lower: Array
    upper: Array
    sigma: Array
    starts: Array
    ends: Array
    start_costs: Array
    costs: Array
    histories: tuple[tuple[Step, ...], ...]
    exhausted: NDArray[np.bool_]

    @classmethod
    def of(
        cls, results: Sequence[StageResult], parameters: Sequence[Parameter], sigma: Mapping[str, float]
    ) -> StageRestarts:
        """Ends of one stage from the results of all starts."""
        names = [p.name for p in parameters]
        deviations = [sigma.get(p.members[0][0], math.nan) / abs(p.members[0][1] or 1.0) for p in parameters]
        evolutions = [[s for s in r.history if s.phase == "evolution"] for r in results]
        return cls(
            name=results[0].name,
            parameters=tuple(names),
            units=tuple(p.unit for p in parameters),
            lower=np.array([p.lower for p in parameters]),
            upper=np.array([p.upper for p in parameters]),
            sigma=np.array(deviations, dtype=float),
            starts=np.array([[r.starts[n] for n in names] for r in results]),
            ends=np.array([[r.estimates[n] for n in names] for r in results]),
            start_costs=np.array([r.start_cost for r in results]),
            costs=np.array([r.cost for r in results]),
            histories=tuple(r.history for r in results),
            exhausted=np.array([bool(e) and e[-1].generation >= e[-1].generations for e in evolutions]),
        )

    @property
    def best(self) -> int:
        """Place of the start with the lowest criterion."""
        return int(np.argmin(self.costs))

    @property
    def excess(self) -> Array:
        """Criterion (k,) above the lowest one, as a part of it."""
        lowest = float(self.costs[self.best])
        return np.asarray((self.costs - lowest) / max(lowest, np.finfo(float).tiny))

    @property
    def tolerance(self) -> Array:
        """Distance (m,) from the lowest end up to which an end is the same, SI."""
        width = self.upper - self.lower
        known = np.where(np.isfinite(self.sigma), _SIGMAS * self.sigma, 0.0)
        return np.asarray(np.clip(known, _WIDTH * width, _MOST_WIDTH * width))

    @property
    def low(self) -> NDArray[np.bool_]:
        """Starts (k,) whose criterion ends within 0.1 % of the lowest one."""
        return np.asarray(self.excess <= COST_TOLERANCE)

    @property
    def at_optimum(self) -> NDArray[np.bool_]:
        """Starts (k,) that end at the optimum by both rules."""
        near = np.abs(self.ends - self.ends[self.best]) <= self.tolerance
        return np.asarray(self.low & near.all(axis=1))

    @property
    def verdict(self) -> Verdict:
        """Whether all starts end in one optimum, along a flat direction, or some of them elsewhere."""
        if self.at_optimum.all():
            return "same optimum"
        return "flat direction" if self.low.all() else "several optima"

    @property
    def direction(self) -> dict[str, float]:
        """Direction in which the low ends scatter: part of the bounds' width by parameter, the four largest.

        The first principal axis, as long as the distance between its outermost ends.
        """
        box = ((self.ends - self.lower) / (self.upper - self.lower))[self.low]
        away = box - box.mean(axis=0)
        axis = np.linalg.svd(away, full_matrices=False)[2][0]
        axis = axis * float(np.ptp(away @ axis))
        largest = float(np.abs(axis).max())
        named = [i for i in np.argsort(-np.abs(axis)) if abs(axis[i]) >= _IN_DIRECTION * largest > 0.0]
        return {self.parameters[i]: float(axis[i]) for i in named[:_NAMED]}

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row per parameter: estimates of the low ends and their spread."""
        low = self.ends[self.low]
        for i, name in enumerate(self.parameters):
            span, width = float(np.ptp(low[:, i])), float(self.upper[i] - self.lower[i])
            scatter = float(low[:, i].std(ddof=1)) if len(low) > 1 else 0.0
            yield {
                "parameter": name,
                "unit": self.units[i],
                "best": float(self.ends[self.best, i]),
                "least": float(low[:, i].min()),
                "most": float(low[:, i].max()),
                "range_percent_of_bounds": 100.0 * span / width,
                "scatter_in_sigma": scatter / self.sigma[i] if self.sigma[i] > 0.0 else math.nan,
            }

    def sentence(self) -> str:
        """The verdict with its figures."""
        k, low = len(self.costs), int(self.low.sum())
        if k < 2:
            return f"{self.name}: one random start was finished, with nothing to compare it with."
        rows = list(self.rows())
        widest = max(rows, key=lambda row: row["range_percent_of_bounds"])
        spread = (
            f"criterion {self.costs[self.best]:.5g}, at most {100 * self.excess[self.low].max():.2g} % above;"
            f" estimates within {widest['range_percent_of_bounds']:.2g} % of the bounds' width"
            f" ({widest['parameter']})"
        )
        ratios = [r["scatter_in_sigma"] for r in rows if math.isfinite(r["scatter_in_sigma"])]
        if ratios:
            spread += f", scatter at most {max(ratios):.2g} of their standard deviation"
        if self.verdict == "same optimum":
            return f"{self.name}: all {k} random starts end in the same optimum: {spread}."
        flat = ""
        if not self.at_optimum[self.low].all():
            axis = " and ".join(f"{name} by {100 * part:+.2g} %" for name, part in self.direction.items())
            flat = (
                f" Their estimates differ along a direction that hardly changes the criterion: {axis} of the"
                " bounds' width."
            )
        if self.verdict == "flat direction":
            return f"{self.name}: all {k} random starts end at the same value: {spread}.{flat}"
        return f"{self.name}: {low} of {k} random starts end at the lowest value: {spread}.{flat}" + "".join(
            f" Start {i + 1} ends {100 * self.excess[i]:.2g} % above: "
            + (
                "its global search used all of its generations; raise budget.generations."
                if self.exhausted[i]
                else "another optimum."
            )
            for i in np.flatnonzero(~self.low)
        )

    def to_dict(self) -> dict[str, Any]:
        """The stage as plain data."""
        return {
            "name": self.name,
            "verdict": self.verdict,
            "sentence": self.sentence(),
            "cost": float(self.costs[self.best]),
            "costs": self.costs,
            "start_costs": self.start_costs,
            "at_optimum": self.at_optimum,
            "parameters": list(self.rows()),
            "starts": [dict(zip(self.parameters, row, strict=True)) for row in self.starts.tolist()],
            "ends": [dict(zip(self.parameters, row, strict=True)) for row in self.ends.tolist()],
        }


@dataclass(frozen=True, eq=False)
class Restarts(RunResult):
    """Ends of all stages from random starts; printed, a sentence per stage.

    Attributes
    ----------
    campaign
        Its name.
    stages
        A `StageRestarts` per stage; none where no start was finished.
    seed
        Seed of the starts.
    interrupted
        Whether Ctrl-C ended the run before all starts were finished.
    text
        The campaign file.
    facts
        What the result rests on, see `seatrial.base.run.run_facts`.
    """

    campaign: str
    stages: tuple[StageRestarts, ...]
    seed: int
    interrupted: bool
    text: str
    facts: Mapping[str, Any]

    @property
    def starts(self) -> int:
        """Number of starts that were finished."""
        return len(self.stages[0].costs) if self.stages else 0

    @property
    def same_optimum(self) -> bool:
        """Whether all starts end in the same optimum in every stage."""
        return self.starts > 1 and all(stage.verdict == "same optimum" for stage in self.stages)

    def sentences(self) -> tuple[str, ...]:
        """A sentence per stage."""
        return tuple(stage.sentence() for stage in self.stages)

    def report(self) -> Report:
        """How many starts agree, the stage that agrees least, what to do, then the ends by coefficient."""
        return _report(self)

    def summary(self) -> str:
        """The report as text."""
        return self.report().text()

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def to_dict(self) -> dict[str, Any]:
        """The result as plain data."""
        return {
            "campaign": self.campaign,
            "seed": self.seed,
            "starts": self.starts,
            "interrupted": self.interrupted,
            "same_optimum": self.same_optimum,
            "stages": [stage.to_dict() for stage in self.stages],
        }

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        import polars as pl

        return {
            "random_starts.json": to_json(self.to_dict()),
            "random_starts.parquet": parquet(pl.DataFrame(list(self._ends()), infer_schema_length=None)),
            "history.parquet": parquet(pl.DataFrame(list(self._steps()), infer_schema_length=None)),
            **self.report().files(),
            "campaign.toml": self.text,
        }

    def _ends(self) -> Iterator[dict[str, Any]]:
        for stage in self.stages:
            for i in range(self.starts):
                for j, name in enumerate(stage.parameters):
                    yield {
                        "stage": stage.name,
                        "start": i + 1,
                        "parameter": name,
                        "unit": stage.units[j],
                        "lower": float(stage.lower[j]),
                        "upper": float(stage.upper[j]),
                        "from": float(stage.starts[i, j]),
                        "to": float(stage.ends[i, j]),
                        "start_cost": float(stage.start_costs[i]),
                        "cost": float(stage.costs[i]),
                        "at_optimum": bool(stage.at_optimum[i]),
                    }

    def _steps(self) -> Iterator[dict[str, Any]]:
        for stage in self.stages:
            for i, history in enumerate(stage.histories):
                for step in history:
                    yield {"stage": stage.name, "start": i + 1} | asdict(step)


def _report(found: Restarts) -> Report:
    """Three lines, ends by stage and coefficient, a sentence per stage."""
    agreed = [stage.name for stage in found.stages if stage.verdict == "same optimum"]
    worst, next_step = _worst(found)
    return Report(
        title=f"{found.campaign}, random starts",
        outcome=_outcome(found),
        good=(
            f"{len(agreed)} of {len(found.stages)} stages reach the same optimum from all {found.starts}"
            f" random starts (seed {found.seed})"
        ),
        worst=worst,
        next_step=next_step,
        sections=(Section(sentences=found.sentences(), tables=(_end_table(found),)),),
    )


def _outcome(found: Restarts) -> str:
    if found.interrupted:
        return "interrupted"
    return "same optimum" if found.same_optimum else "starts disagree"


def _worst(found: Restarts) -> tuple[str, str]:
    """The stage whose starts agree least, and what to do about it."""
    if found.interrupted:
        return (
            f"Ctrl-C ended the run after {found.starts} finished starts",
            "run the same command again; finished stages are kept",
        )
    for stage in found.stages:
        if stage.verdict == "several optima":
            away = int((~stage.low).sum())
            return (
                f"{stage.name}: {away} of {found.starts} starts end up to {100 * stage.excess.max():.2g} %"
                " above the lowest criterion",
                "raise generations under [budget], or narrow the bounds of this stage",
            )
    for stage in found.stages:
        if stage.verdict == "flat direction":
            return (
                f"{stage.name}: estimates differ at the same criterion: {', '.join(stage.direction)}",
                f"hold one of {', '.join(stage.direction)} or add a trial that separates them (see the"
                " identifiability remarks of seatrial identify)",
            )
    widths = [(row["range_percent_of_bounds"], row["parameter"]) for s in found.stages for row in s.rows()]
    widest = max(widths, default=(0.0, "no coefficient"))
    return (
        f"{widest[1]} scatters most, by {widest[0]:.2g} % of the width of its bounds",
        "rely on the search: the optimum does not depend on the start values",
    )


def _end_table(found: Restarts) -> Table:
    rows = []
    for stage in found.stages:
        for k, row in enumerate(stage.rows()):
            ratio = row["scatter_in_sigma"]
            rows.append((
                "" if k else stage.name,
                row["parameter"],
                row["unit"],
                f"{row['least']:.5g} to {row['most']:.5g}",
                f"{row['range_percent_of_bounds']:.2g}",
                "" if math.isnan(ratio) else f"{ratio:.2g}",
            ))
    head = ("stage", "coefficient", "unit", "ends", "% of bounds", "scatter in sd")
    return Table.of(f"Ends of {found.starts} random starts (seed {found.seed})", head, rows, left=3)
