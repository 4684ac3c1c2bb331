"""The four stages of CWolf's identification on an hour of 10 Hz logs: wall time, and where it goes.

The hour is GENERATED: four trials of fifteen minutes (surge, dive, turn, dive by stern propellers), sailed
by the truth vehicle of ``examples/cwolf``. Each repeats the commands of the example's trial, from the
second time on with levels that a fixed seed varies by up to 20 %. The stages are those of the example's
campaign; nothing is held out. `run` isolates the stages: their plan, step and search, without reading the
logs; `identify` is the whole, with joint estimate, standard deviations and residual analysis.
Held by tests/benchmarks/test_benchmarks.py.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import seatrial as st
from seatrial.base.run import RunDirectory
from seatrial.campaign.file import parse
from seatrial.estimation.stage import StageOrder, StagePlan, StageResult, plan
from seatrial.trial.generated import Recipe

EXAMPLE = Path(__file__).parents[1] / "examples" / "cwolf"
TRIALS = ("surge", "dive", "turn", "dive_stern")
TRIAL_S = 900.0
DEPTH_M = 200.0  # CWolf is buoyant: 60 m of the example would not last
SPREAD = 0.2
FASTEST_RPM = 2000.0


@dataclass(frozen=True)
class StageCost:
    """What one stage took: candidates of the global and of the fine search, samples, steps per sample."""

    name: str
    candidates: tuple[int, int]
    samples: int
    substeps: tuple[int, int]
    wall_s: float

    @property
    def steps(self) -> int:
        """Return the time steps of all candidates."""
        return self.samples * sum(n * s for n, s in zip(self.candidates, self.substeps, strict=True))


@dataclass(frozen=True)
class Job:
    """The four stages: wall and CPU time in s of plan and search together, reading apart."""

    stages: tuple[StageCost, ...]
    plans: tuple[StagePlan, ...]
    found: tuple[StageResult, ...]
    wall_s: float
    cpu_s: float
    read_s: float

    @property
    def steps(self) -> int:
        """Return the time steps of all candidates of all stages; those of derivatives are not counted."""
        return sum(stage.steps for stage in self.stages)


def write_logs(folder: Path, *, duration_s: float = TRIAL_S) -> dict[str, Path]:
    """Write the generated logs as CSV files; return their paths by trial.

    Parameters
    ----------
    folder : Path
        An existing, empty one.
    duration_s : float
        Of each trial.
    """
    paths = {}
    for name in TRIALS:
        recipe = folder / f"{name}.toml"
        recipe.write_text(recipe_text(name, duration_s=duration_s))
        paths[name] = folder / f"{name}.csv"
        logged = Recipe.load(recipe).table()
        # Still water: without the Doppler log's water track no current is derived.
        logged.drop([column for column in logged.columns if "_water" in column]).write_csv(paths[name])
    return paths


def recipe_text(name: str, *, duration_s: float) -> str:
    """Return a recipe of ``duration_s``: the example's commands over and over, levels varied by its seed."""
    example = tomllib.loads((EXAMPLE / "trials" / f"{name}.toml").read_text())
    rng = np.random.default_rng(example["seed"])
    rows = []
    for again in range(int(np.ceil(duration_s / example["duration_s"]))):
        for row in example["commands"]:
            t = row["t_s"] + again * example["duration_s"]
            factor = 1.0 + SPREAD * rng.uniform(-1.0, 1.0) if again else 1.0
            levels = {k: np.clip(factor * v, -FASTEST_RPM, FASTEST_RPM) for k, v in row.items() if k != "t_s"}
            if t < duration_s:
                rows.append(", ".join([f"t_s = {t:.1f}", *(f"{k} = {v:.1f}" for k, v in levels.items())]))
    commands = "".join(f"    {{ {row} }},\n" for row in rows)
    return (
        f'format = 1\ndescription = "{example["description"]}, extended"\n'
        f'truth = "{(EXAMPLE / "truth.toml").as_posix()}"\nseed = {example["seed"]}\n'
        f"duration_s = {duration_s:.1f}\ninitial = {{ depth_m = {DEPTH_M} }}\ncommands = [\n{commands}]\n"
    )


def campaign(paths: Mapping[str, Path]) -> st.Campaign:
    """Return the example's campaign with its first four stages, on these logs, nothing held out."""
    text = (EXAMPLE / "campaign.toml").read_text()
    file = parse(text, "four stages")
    trials = {name: file.trials[name].model_copy(update={"hold_out_s": ()}) for name in TRIALS}
    stages = tuple(stage for stage in file.stages if set(stage.trials) <= set(TRIALS))
    changed = file.model_copy(update={"trials": trials, "stages": stages})
    return st.Campaign(changed, text=text, source="four stages", folder=EXAMPLE, trials=dict(paths))


def run(sailed: st.Campaign, *, threads: int | None = None) -> Job:
    """Return what the four stages took, without polish and standard deviations."""
    began = time.perf_counter()
    for name in sailed.trials:
        assert len(sailed.trials[name])
    read, busy = time.perf_counter(), time.process_time()
    plans = plan(sailed.problem())
    found = StageOrder(sailed.problem(), plans, RunDirectory(None), st.Work(threads=threads)).stages()
    wall, cpu = time.perf_counter() - read, time.process_time() - busy
    costs = tuple(cost(one, result) for one, result in zip(plans, found, strict=True))
    return Job(costs, plans, found, wall_s=wall, cpu_s=cpu, read_s=read - began)


def cost(planned: StagePlan, found: StageResult) -> StageCost:
    """Return what a stage took."""
    coarse = max(step.evaluations for step in found.history if step.phase == "evolution")
    fine = found.evaluations - coarse
    steps = (planned.step.search, found.substeps)
    return StageCost(found.name, (coarse, fine), found.samples, steps, found.wall_s)


def identify(sailed: st.Campaign) -> float:
    """Return the wall time in s of the whole identification, trials already read."""
    began = time.perf_counter()
    sailed.identify()
    return time.perf_counter() - began
