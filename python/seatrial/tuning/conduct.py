"""The conduct of a tuning: margins, group after group, the groups that violate once more, judgement.

Held by tests/test_tune.py.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.errors import CampaignError, TrialError
from seatrial.flight.sensor_channels import sensors_of
from seatrial.progress import Progress
from seatrial.search import Step
from seatrial.tuning.group_search import GENERATIONS, ROUNDS, GroupResult, search_group, search_margins
from seatrial.tuning.judged import Judged, judge
from seatrial.tuning.loop_trials import Samples
from seatrial.tuning.margin_constraint import refuse_other_laws
from seatrial.tuning.objective import RESERVE
from seatrial.tuning.step_trial import Rig
from seatrial.tuning.take_back import take_back
from seatrial.tuning.tuning_plan import TuningPlan
from seatrial.tuning.tuning_result import Tuning, tuned_autopilot

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.campaign import Campaign
    from seatrial.fitted import Fitted
    from seatrial.identification import Identification
    from seatrial.run_directory import RunDirectory

__all__ = ["conduct", "plan_of"]

_PASSES = 2
_FRESH, _NOISES = 24, 8  # vehicles drawn for the last judgement, and noises of the vehicle itself
_FINE_STEP_S = 0.02
_OTHER_SEED = 7919
_ANY_MISSION = """
format = 1
name = "fit"
speed_m_s = 1.0
acceptance_radius_m = 1.0
[[legs]]
north_m = 100.0
east_m = 0.0
"""


def conduct(
    campaign: Campaign,
    fit: Identification | Fitted | Vehicle | str | Path | None,
    *,
    run_dir: str | Path | None,
    progress: Callable[[Progress], None] | None,
    resume: bool,
    relay: bool,
    threads: int | None,
) -> Tuning:
    """Tuning of a campaign; see `seatrial.tune`."""
    from seatrial.run_directory import RunDirectory

    plan = plan_of(campaign, fit)
    assert plan.groups is not None  # what cannot be tuned is refused before a directory is made
    directory = None if run_dir is None else RunDirectory(run_dir)
    try:
        found = _Run(campaign, plan, directory, progress, threads, resume).run(relay=relay)
    except BaseException:
        if directory is not None:
            directory.abandon()
        raise
    if directory is not None and not found.interrupted:
        found.publish(directory)
    return found


def plan_of(
    campaign: Campaign, fit: Identification | Fitted | Vehicle | str | Path | None = None
) -> TuningPlan:
    """What a tuning of a campaign does, before it is done. Takes and raises what `tune` does."""
    from seatrial.fitted import Fitted
    from seatrial.tuning.tuning_file import TuningTable

    table = campaign.file.tuning or TuningTable()
    fitted = Fitted.of(campaign.vehicle if fit is None else fit)
    sensors = table.sensors
    if sensors not in ("typical", "perfect"):
        table = table.model_copy(update={"sensors": str(campaign.beside(sensors, "tuning.sensors"))})
    autopilot = campaign.autopilot
    here = set(fitted.vehicle.actuators)
    if here != set(campaign.vehicle.actuators):
        raise CampaignError(
            f"{campaign.source}: expected a fit of {campaign.vehicle.name}, found one of"
            f" {fitted.vehicle.name} with other actuators; give the run directory of this campaign"
        )
    plan = TuningPlan(table, fitted, autopilot)
    _refuse_what_cannot_fly(plan, f"{campaign.source}: tuning")
    return plan


def _refuse_what_cannot_fly(plan: TuningPlan, where: str) -> None:
    """Refuse before the search, and before a directory is made, what its first flight would refuse."""
    from seatrial._core import Mission

    refuse_other_laws(plan.autopilot)
    plan.autopilot.engage(plan.vehicle, Mission.from_toml(_ANY_MISSION))
    try:
        sensors_of(plan.sensors, plan.vehicle)
    except TrialError as error:
        raise CampaignError(f"{where}, key sensors: {error}") from None
    needed = [name for name, facts in plan.vehicle.actuator_info().items() if facts["needs_voltage"]]
    if needed and plan.table.voltage_v is None:
        raise CampaignError(
            f"{where}: the thrust of {plan.vehicle.name} ({needed[0]}) depends on the supply voltage; add"
            " voltage_v, in V"
        )
    if plan.current_m_s >= plan.top_m_s:
        raise CampaignError(
            f"{where}, key current_m_s: expected less than the top speed of {plan.vehicle.name},"
            f" {plan.top_m_s:.2f} m/s, found {plan.current_m_s:g}; no set point is reached against it"
        )


class _Run:
    """One tuning under way."""

    def __init__(
        self,
        campaign: Campaign,
        plan: TuningPlan,
        directory: RunDirectory | None,
        progress: Callable[[Progress], None] | None,
        threads: int | None,
        resume: bool,
    ) -> None:
        self.campaign, self.plan, self.directory = campaign, plan, directory
        self.progress, self.threads, self.resume = progress, threads, resume
        self.began = time.monotonic()
        self.done, self.stages = 0, len(plan.groups) + 1
        self.results: list[GroupResult] = []
        self.gains: dict[str, float] = {}
        self.taken_back: tuple[str, ...] = ()

    def run(self, *, relay: bool) -> Tuning:
        plan, seed = self.plan, self.campaign.seed
        samples = plan.samples(plan.table.samples, seed)
        if self._keep("margins", lambda watch: search_margins(plan, seed=seed, watch=watch)):
            return self._result((), relay=None)
        open_ = list(range(len(plan.groups)))
        for turn in range(_PASSES):
            self.stages = self.done + len(open_)
            for place in open_:
                group = plan.groups[place]
                name = group.name if turn == 0 else f"{group.name}, again ({turn + 1})"
                offset = 1 + place + turn * len(plan.groups)

                def search(
                    watch: Callable[[Step], None], group: Any = group, offset: int = offset
                ) -> GroupResult:
                    rig = self._rig(plan.autopilot.with_gains(self.gains), 2 * _FINE_STEP_S)
                    return search_group(
                        plan, group, rig, samples, seed=seed + offset, start=self.gains, watch=watch
                    )

                if self._keep(name, search):
                    return self._result((), relay=None)
            if turn + 1 == _PASSES:
                break
            again = plan.samples(plan.table.samples, seed, nominal=_NOISES)
            open_ = [k for k in range(len(plan.groups)) if self._violates(k, again)]
            if not open_:
                break
        self.gains, self.taken_back = take_back(plan, self.gains, samples, threads=self.threads)
        fresh = plan.samples(_FRESH, seed + _OTHER_SEED, nominal=_NOISES)
        autopilots: dict[str, Autopilot] = {"start": plan.autopilot}
        relayed = None
        if relay:
            from seatrial.tuning.relay import relay_autopilot

            relayed = relay_autopilot(
                plan.vehicle, plan.autopilot, sensors=plan.sensors, voltage=plan.table.voltage_v
            )
            autopilots["relay"] = relayed.autopilot
        autopilots["tuned"] = self._tuned()
        judged = tuple(
            judge(plan, name, self._rig(autopilot, _FINE_STEP_S), fresh)
            for name, autopilot in autopilots.items()
        )
        return self._result(judged, relay=relayed)

    def _keep(self, name: str, search: Callable[[Callable[[Step], None]], GroupResult | None]) -> bool:
        """Run or reuse a part of the search; whether it was interrupted."""
        inputs = self._inputs(name)
        found: GroupResult | None = None
        if self.directory is not None and self.resume:
            kept = self.directory.finished(name, inputs)
            found = None if kept is None else GroupResult.from_dict(kept)
        if found is None:
            found = search(lambda step: self._report(name, step))
        elif self.directory is not None:
            self.directory.keep(name, found.to_dict() | {"inputs": inputs})  # for the run after this one
        self.done += 1
        if found is None:
            return False
        self.results.append(replace(found, name=name))
        self.gains |= found.gains
        if self.directory is not None and not found.interrupted:
            self.directory.keep(name, found.to_dict() | {"inputs": inputs})
        return found.interrupted

    def _inputs(self, name: str) -> str:
        """Hash of all that a part of the search depends on."""
        fitted = self.plan.fitted
        sensors = sensors_of(self.plan.sensors, self.plan.vehicle)
        text = json.dumps([
            name,
            version("seatrial"),
            repr(sensors),
            [_PASSES, RESERVE, GENERATIONS, ROUNDS],
            self.plan.table.model_dump_json(),
            self.plan.autopilot.to_toml(),
            fitted.vehicle.to_toml(),
            list(fitted.names),
            fitted.covariance.tolist(),
            self.campaign.seed,
            sorted(self.gains.items()),
        ])
        return hashlib.sha256(text.encode()).hexdigest()

    def _rig(self, autopilot: Autopilot, max_step: float) -> Rig:
        return self.plan.rig(autopilot, max_step=max_step, threads=self.threads)

    def _violates(self, place: int, samples: Samples) -> bool:
        """Whether a group leaves a corridor with the gains that the others found since."""
        rig = self._rig(self.plan.autopilot.with_gains(self.gains), 2 * _FINE_STEP_S)
        judged = judge(self.plan, "", rig, samples, only=(self.plan.groups[place],), responses=False)
        return judged.worst_s > 0.0

    def _tuned(self) -> Autopilot:
        return tuned_autopilot(self.plan.autopilot, self.gains, self.campaign.name)

    def _result(self, judged: tuple[Judged, ...], *, relay: Any) -> Tuning:
        interrupted = bool(self.results) and self.results[-1].interrupted
        return Tuning(
            campaign=self.campaign,
            plan=self.plan,
            autopilot=self._tuned(),
            groups=tuple(self.results),
            judged=judged,
            relay=relay,
            taken_back=self.taken_back,
            elapsed_s=time.monotonic() - self.began,
            interrupted=interrupted,
        )

    def _report(self, name: str, step: Step) -> None:
        if self.progress is None:
            return
        part = step.generation / max(step.generations, 1)
        half = {"evolution": 0.0, "simplex": 0.5}.get(step.phase, 0.0)
        fraction = min((self.done + half + 0.5 * part) / self.stages, 1.0)
        elapsed = time.monotonic() - self.began
        self.progress(
            Progress(
                stage=name,
                phase=step.phase,
                generation=step.generation,
                generations=step.generations,
                evaluations=step.evaluations,
                best=step.best,
                stages_done=self.done,
                stages=self.stages,
                fraction=fraction,
                elapsed_s=elapsed,
                left_s=elapsed * (1.0 - fraction) / max(fraction, 1e-3),
            )
        )
