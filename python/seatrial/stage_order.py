"""The stages of an identification: dependent ones in order, independent ones side by side, resumable."""

from __future__ import annotations

import contextlib
import hashlib
import math
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import astuple, replace
from importlib import metadata

import numpy as np

from seatrial import _core
from seatrial.campaign import Campaign
from seatrial.progress import Progress
from seatrial.run_directory import StageStore, to_json
from seatrial.search import Step
from seatrial.stage import StagePlan, StageResult, run_stage

__all__ = ["StageOrder"]


class StageOrder:
    """Workspace of one identification: one thread per running stage, the caller's thread directs them."""

    def __init__(
        self,
        campaign: Campaign,
        plans: tuple[StagePlan, ...],
        directory: StageStore | None,
        *,
        progress: Callable[[Progress], None] | None,
        resume: bool,
        threads: int | None,
    ) -> None:
        self.campaign, self.plans, self.directory = campaign, plans, directory
        self.progress, self.resume, self.threads = progress, resume, threads
        self.stop = threading.Event()
        self.steps: queue.SimpleQueue[tuple[StagePlan, Step] | None] = queue.SimpleQueue()
        self.outcomes: dict[str, StageResult | BaseException] = {}
        self.results: dict[str, StageResult] = {}
        self.began = time.monotonic()

    def stages(self) -> tuple[StageResult, ...]:
        """Results of the stages that ran, in the order of the campaign."""
        waiting = list(self.plans)
        running: list[StagePlan] = []
        failure: BaseException | None = None
        while running or (waiting and not self.stop.is_set()):
            try:
                for plan in [plan for plan in waiting if self._ready(plan) and not self.stop.is_set()]:
                    waiting.remove(plan)
                    running.append(plan)
                    threading.Thread(target=self._run, args=(plan,), daemon=True).start()
                # Outcomes wait in a dict, not in the queue: an interrupt may lose what the queue just gave.
                with contextlib.suppress(queue.Empty):
                    step = self.steps.get(timeout=0.5)
                    if step is not None and self.progress is not None and not self.stop.is_set():
                        self.progress(self.state(*step))
                for plan in [plan for plan in running if plan.stage.name in self.outcomes]:
                    running.remove(plan)
                    self._finish(self.outcomes[plan.stage.name])
            except KeyboardInterrupt:
                if self.stop.is_set() and failure is None:
                    raise
                self.stop.set()
            except BaseException as error:  # raised when the other stages have ended
                failure = failure or error
                self.stop.set()
        if failure is not None:
            raise failure
        return tuple(self.results[p.stage.name] for p in self.plans if p.stage.name in self.results)

    def _ready(self, plan: StagePlan) -> bool:
        return all(name in self.results for name in plan.stage.after)

    def _finish(self, outcome: StageResult | BaseException) -> None:
        if isinstance(outcome, StageResult):
            self.results[outcome.name] = outcome
            if outcome.interrupted:
                self.stop.set()
            elif self.directory is not None and not outcome.reused:
                self.directory.keep(outcome.name, outcome.to_dict())
        elif not isinstance(outcome, KeyboardInterrupt):
            raise outcome

    def _run(self, plan: StagePlan) -> None:
        """One stage, in its own thread."""

        def watch(step: Step) -> None:
            self.steps.put((plan, step))
            if self.stop.is_set():
                raise KeyboardInterrupt

        name = plan.stage.name
        try:
            found: dict[str, float] = {}
            for earlier in self.campaign.before(plan.stage):
                found |= self.results[earlier].coefficients
            vehicle = self.campaign.vehicle.with_coefficients(found)
            inputs = _inputs(self.campaign, plan, vehicle, found)
            kept = self.directory.finished(name, inputs) if self.directory and self.resume else None
            if kept is not None:
                self.outcomes[name] = replace(StageResult.from_dict(kept), reused=True)
            else:
                self.outcomes[name] = run_stage(
                    self.campaign,
                    plan,
                    vehicle=vehicle,
                    found=found,
                    inputs=inputs,
                    watch=watch,
                    threads=self.threads,
                )
        except BaseException as error:  # raised again in the caller's thread
            self.outcomes[name] = error
        self.steps.put(None)

    def state(self, plan: StagePlan, step: Step | None) -> Progress:
        """Progress of the whole after a step of a stage, or before the first one."""
        planned = {p.stage.name: p.work for p in self.plans}
        for name, result in self.results.items():
            if result.reused:
                planned[name] = 0.0
        done = sum(planned[name] for name in self.results) + (plan.done(step) if step else 0.0)
        fraction = min(done / max(sum(planned.values()), done, 1.0), 1.0)
        elapsed = time.monotonic() - self.began
        return Progress(
            stage=plan.stage.name,
            phase=step.phase if step else "starting",
            generation=step.generation if step else 0,
            generations=step.generations if step else plan.generations,
            evaluations=step.evaluations if step else 0,
            best=step.best if step else math.inf,
            stages_done=len(self.results),
            stages=len(self.plans),
            fraction=fraction,
            elapsed_s=elapsed,
            left_s=elapsed * (1.0 - fraction) / max(fraction, 1e-6),
        )


def _inputs(campaign: Campaign, plan: StagePlan, vehicle: _core.Vehicle, found: Mapping[str, float]) -> str:
    """SHA-256 of everything that the result of a stage depends on."""
    data = plan.data
    digest = hashlib.sha256()
    described = {
        "version": version("seatrial"),
        "stage": plan.stage.model_dump(),
        "inputs": [campaign.input_of(name) for name in plan.stage.trials],
        "vehicle": vehicle.to_toml(),
        "found": found,
        "plan": [
            plan.seed,
            plan.population,
            plan.generations,
            plan.rounds,
            plan.tolerance,
            plan.step.substeps,
            plan.step.search,
        ],
        "segments": [astuple(segment) for segment in data.segments],
        "environment": [(trial.rho, trial.g) for trial in data.trials],
    }
    digest.update(to_json(described).encode())
    for trial, counted in zip(data.trials, data.counted, strict=True):
        signals = [trial.t, trial.observed, counted, trial.nu, trial.tau, trial.voltage, trial.current]
        for values in (*signals, *trial.commands.values(), *trial.measured.values()):
            digest.update(b"-" if values is None else np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def version(package: str) -> str:
    """Version of an installed package."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"
