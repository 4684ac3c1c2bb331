"""One tuning under way: margins, group after group, the groups that violate once more, judgement.

Ctrl-C at any time ends it with the best gains so far. Held by tests/test_tune.py, tests/test_second_turn.py,
tests/test_tuning_kept_stages.py and tests/test_tuning_draws.py.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from seatrial.flight.sensor_channels import sensors_of
from seatrial.optimize import batch_size
from seatrial.progress import Progress
from seatrial.search import LANES, Step
from seatrial.tuning.group_search import GENERATIONS, ROUNDS, GroupResult, search_group, search_margins
from seatrial.tuning.judged import Judged, judge
from seatrial.tuning.loop_trials import Samples
from seatrial.tuning.objective import RESERVE
from seatrial.tuning.step_trial import Rig
from seatrial.tuning.take_back import take_back
from seatrial.tuning.tuning_plan import Group, TuningPlan
from seatrial.tuning.tuning_result import Tuning, tuned_autopilot
from seatrial.tuning.tuning_text import without_table
from seatrial.tuning.why_outside import judged_without_noise
from seatrial.tuning.work_left import WorkLeft

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.campaign import Campaign
    from seatrial.run_directory import RunDirectory

__all__ = ["TuningRun"]

_PASSES = 2
_FRESH, _NOISES = 24, 8  # vehicles drawn for the last judgement, and noises of the vehicle itself
_FINE_STEP_S = 0.02
_OTHER_SEED = 7919
_OF_MARGINS = 0.1  # of the work of the searches that fly
_EVOLUTION = 0.7  # of the budget of a group
_JUDGEMENT = "judgement"
_GIVEN_AWAY = 0.01  # of a margin, as much as the frequency grid and four digits of a gain leave


class TuningRun:
    """One tuning under way.

    Parameters
    ----------
    campaign : Campaign
    plan : TuningPlan
    directory : RunDirectory, optional
        Where finished groups are kept.
    progress : callable, optional
        Called with a `Progress`.
    threads : int, optional
        All by default.
    resume : bool
        Whether groups that an earlier run finished are reused.
    """

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
        self.stopped = False
        self.notes = without_table(campaign)
        self.work = WorkLeft(self._planned())
        self.results: list[GroupResult] = []
        self.gains: dict[str, float] = {}
        self.taken_back: tuple[str, ...] = ()

    def run(self, *, relay: bool) -> Tuning:
        """Tuning, interrupted after Ctrl-C.

        Parameters
        ----------
        relay : bool
            Whether a relay autotuning is judged beside.
        """
        try:
            if self._search():
                return self._result((), relay=None)
            self._take_back()
            return self._judge(relay=relay)
        except KeyboardInterrupt:
            self.stopped = True
            return self._result((), relay=None)

    def _search(self) -> bool:
        """Search the margins, then the groups; whether Ctrl-C ended it."""
        plan, seed = self.plan, self.campaign.seed
        samples = plan.samples(plan.table.samples, seed)
        if self._keep("margins", lambda watch: search_margins(plan, seed=seed, watch=watch)):
            return True
        open_ = list(range(len(plan.groups)))
        for turn in range(_PASSES):
            self.stages = self.done + len(open_)
            for place in open_:
                group = plan.groups[place]
                offset = 1 + place + turn * len(plan.groups)

                def search(
                    watch: Callable[[Step], None],
                    group: Group = group,
                    offset: int = offset,
                    met: Samples = samples,
                ) -> GroupResult:
                    rig = self._rig(plan.autopilot.with_gains(self.gains), 2 * _FINE_STEP_S)
                    return search_group(
                        plan, group, rig, met, seed=seed + offset, start=self.gains, watch=watch
                    )

                if self._keep(_name(group, turn), search):
                    return True
            if turn + 1 == _PASSES:
                break
            # The second turn flies what shows who needs it.
            samples = plan.samples(plan.table.samples, seed, nominal=_NOISES)
            open_ = [k for k in range(len(plan.groups)) if self._spoils(k) or self._violates(k, samples)]
            self.work.keep_only({_JUDGEMENT, *(_name(plan.groups[k], turn + 1) for k in open_)})
            if not open_:
                break
        return False

    def _take_back(self) -> None:
        """Give groups their start gains again where these are better at the last judgement."""
        self.gains, self.taken_back = take_back(self.plan, self.gains, self._fresh(), threads=self.threads)

    def _fresh(self) -> Samples:
        """Samples of the last judgement, which no search has seen."""
        return self.plan.samples(_FRESH, self.campaign.seed + _OTHER_SEED, nominal=_NOISES)

    def _judge(self, *, relay: bool) -> Tuning:
        """Tuning with its judgement."""
        plan, fresh = self.plan, self._fresh()
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
        quiet = None
        if not judged[-1].feasible:
            quiet = judged_without_noise(plan, self._rig(autopilots["tuned"], _FINE_STEP_S))
        return replace(self._result(judged, relay=relayed), quiet=quiet)

    def _planned(self) -> dict[str, float]:
        """Time that each part flies at most, s; the margins, which do not fly, as a share of it."""
        budget, parts = self.plan.table.budget, dict[str, float]()
        count = 1 + self.plan.table.samples
        for turn in range(_PASSES):
            for group in self.plan.groups:
                size = budget.population or batch_size(len(group.parameters))
                sets = size * (budget.generations or GENERATIONS) + LANES * (budget.simplex_rounds or ROUNDS)
                each = sum(len(trials) * trials.duration_s for trials in group.trials)
                parts[_name(group, turn)] = sets * each * (count if turn == 0 else count - 1 + _NOISES)
        flown = sum(parts.values())
        each = sum(len(t) * t.duration_s for group in self.plan.groups for t in group.trials)
        last = (_FRESH + _NOISES) * 2 * 2 * each
        return {"margins": _OF_MARGINS * flown / _PASSES} | parts | {_JUDGEMENT: last}

    def _keep(self, name: str, search: Callable[[Callable[[Step], None]], GroupResult | None]) -> bool:
        """Run or reuse a part of the search; whether it was interrupted."""
        inputs = self._inputs(name)
        found: GroupResult | None = None
        kept = None
        self.work.begin(name)
        if self.directory is not None and self.resume:
            kept = self.directory.finished(name, inputs)
            found = None if kept is None else GroupResult.from_dict(kept)
        if found is None:
            found = search(lambda step: self._report(name, step))
        elif self.directory is not None:
            self.directory.keep(name, found.to_dict() | {"inputs": inputs})  # for the run after this one
        self.done += 1
        self.work.end(name, kept=kept is not None)
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
            [_PASSES, _NOISES, RESERVE, GENERATIONS, ROUNDS],
            self.plan.table.model_dump_json(),
            self.plan.to_dict(),  # what the table leaves to its defaults
            self.plan.current_m_s,
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

    def _spoils(self, place: int) -> bool:
        """Whether the search of a group gave margins away, caught between them and its corridors."""
        name = _name(self.plan.groups[place], 0)
        found = next(result for result in self.results if result.name == name)
        return found.after["margin"] > found.before["margin"] + _GIVEN_AWAY

    def _violates(self, place: int, samples: Samples) -> bool:
        """Whether a group leaves a corridor with the gains that the others found since."""
        rig = self._rig(self.plan.autopilot.with_gains(self.gains), 2 * _FINE_STEP_S)
        judged = judge(self.plan, "", rig, samples, only=(self.plan.groups[place],), responses=False)
        return judged.worst_s > 0.0

    def _tuned(self) -> Autopilot:
        return tuned_autopilot(self.plan.autopilot, self.gains, self.campaign.name)

    def _result(self, judged: tuple[Judged, ...], *, relay: Any) -> Tuning:
        interrupted = self.stopped or (bool(self.results) and self.results[-1].interrupted)
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
        # Of a group's budget the evolution strategy takes about two thirds.
        begun, share = {"evolution": (0.0, _EVOLUTION), "simplex": (_EVOLUTION, 1.0 - _EVOLUTION)}.get(
            step.phase, (0.0, 1.0)
        )
        share = part if name == "margins" else begun + share * part
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
                fraction=min(self.work.done(name, share), 1.0),
                elapsed_s=time.monotonic() - self.began,
                left_s=self.work.left_s(name, share),
                notes=self.notes,
            )
        )
        self.notes = ()


def _name(group: Group, turn: int) -> str:
    return group.name if turn == 0 else f"{group.name}, again ({turn + 1})"
