"""`tune`: from a vehicle as well as it is known to an autopilot whose responses stay in their corridors.

Margins first, then group after group by evolution strategy and simplex on the full non-linear closed loop
with limits, dead band, dead time, sensor noise, currents and drawn vehicles, the groups that violate once
more; at last everything is assessed again on samples that the search never saw, beside the start gains. What
cannot be tuned is refused before the search. Ctrl-C at any time ends it with the best gains so far.

The time left is that of the searches that are still to come, if each uses its whole budget: what a search
costs to the processor is about proportional to the time that its candidates fly. A second turn of all
groups counts from the beginning and falls away where it is not needed, so that the time left may shorten
and hardly ever grows. What an earlier run left behind counts as done, but says nothing of the pace.

Held by tests/tuning/test_tune.py, tests/tuning/test_second_turn.py, tests/tuning/test_tuning_kept_stages.py,
tests/tuning/test_tuning_draws.py and tests/tuning/test_tuning_progress.py.

Source: Taubert et al. (2014), section "Constraint Criteria Optimization".
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial._core import Autopilot, checked_threads
from seatrial.base.errors import CampaignError, SeatrialError
from seatrial.base.fleet import fleet_of
from seatrial.base.run import RunDirectory, run_facts, version
from seatrial.base.work import HERE, Clock, Progress, Step, Work, callers_errors_pass, takes
from seatrial.estimation.search import SEARCH_SETTINGS, batch_size
from seatrial.flight.sensor_channels import sensors_of
from seatrial.identification.fitted import Fitted
from seatrial.tuning.control_problem import ControlProblem, Group
from seatrial.tuning.loop_steps import path_work_s, search_paths
from seatrial.tuning.objective import SETTINGS as OBJECTIVE_SETTINGS
from seatrial.tuning.result import (
    Performance,
    Tuning,
    assess,
    assess_without_noise,
    revert_gains,
    tuned_autopilot,
    without_table,
)
from seatrial.tuning.search import GUIDANCE_SEARCH, GroupResult, search_group, search_margins
from seatrial.tuning.search import SETTINGS as GROUP_SEARCH_SETTINGS
from seatrial.tuning.step_trial import Rig, Samples

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.base.fleet import Fleet
    from seatrial.identification.identification import Identification


@dataclass(frozen=True)
class TuningRunSettings:
    """How much work a tuning spends on its parts."""

    first_progress: float = 0.02  #: Share of all work that the first guess of the pace counts as.
    turns: int = 2  #: Turns of all groups: the second one takes up groups that the gains of others spoilt.
    fresh_vehicles: int = 24  #: Vehicles drawn for the last assessment.
    fresh_noises: int = 8  #: Noises of the vehicle itself in the last assessment.
    #: Longest step of the vehicle in the last assessment, s; searches take twice as long ones.
    fine_step_s: float = 0.02
    seed_offset: int = 7919  #: Added to the seed of the last assessment: samples that no search drew.
    #: Share of a group's budget for the evolution strategy; the simplexes get the rest.
    evolution_share: float = 0.7


SETTINGS = TuningRunSettings()

_ASSESSMENT = "assessment"


class TuningRun:
    """One tuning under way: finished groups are kept in `run`; candidates of a search fly in the `fleet`, or
    in this process.
    """

    def __init__(
        self,
        plan: ControlProblem,
        run: RunDirectory,
        *,
        progress: Callable[[Progress], None] | None = None,
        threads: int | None = None,
        fleet: Fleet | None = None,
    ) -> None:
        self.fleet = fleet
        self.plan, self.directory = plan, run
        self.progress, self.threads = progress, threads
        self.clock = Clock()
        self.done, self.stages = 0, len(plan.groups) + 1
        self.stopped = False
        self.notes = without_table(plan)
        self.work = WorkLeft(self._planned())
        self.results: list[GroupResult] = []
        self.gains: dict[str, float] = {}
        self.reverted: tuple[str, ...] = ()

    def run(self) -> Tuning:
        """Tuning, interrupted after Ctrl-C."""
        try:
            if self._search():
                return self._result(())
            self._revert()
            self._guide()
            return self._assess()
        except KeyboardInterrupt:
            self.stopped = True
            return self._result(())

    def _search(self) -> bool:
        """Search the margins, then the groups; whether Ctrl-C ended it."""
        plan, seed = self.plan, self.plan.seed
        samples = plan.samples(plan.table.samples, seed)
        if self._keep("margins", lambda watch: search_margins(plan, seed=seed, watch=watch)):
            return True
        open_ = list(range(len(plan.groups)))
        for turn in range(SETTINGS.turns):
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
                    rig = self._rig(plan.autopilot.with_gains(self.gains), 2 * SETTINGS.fine_step_s)
                    return search_group(
                        plan,
                        group,
                        rig,
                        met,
                        seed=seed + offset,
                        start=self.gains,
                        watch=watch,
                        fleet=self.fleet,
                    )

                if self._keep(_name(group, turn), search):
                    return True
            if turn + 1 == SETTINGS.turns:
                break
            # The second turn flies what shows who needs it.
            samples = plan.samples(plan.table.samples, seed, nominal=SETTINGS.fresh_noises)
            open_ = [k for k in range(len(plan.groups)) if self._spoils(k) or self._violates(k, samples)]
            self.work.keep_only({
                GUIDANCE_SEARCH,
                _ASSESSMENT,
                *(_name(plan.groups[k], turn + 1) for k in open_),
            })
            if not open_:
                break
        return False

    def _revert(self) -> None:
        """Give groups their start gains again where these are better at the last assessment."""
        gains_of = {result.name: result.gains for result in self.results}
        first = {
            group.name: gains_of[group.name]
            for group in self.plan.groups
            if _name(group, SETTINGS.turns - 1) in gains_of
        }
        self.gains, self.reverted = revert_gains(
            self.plan, self.gains, self._fresh(), first=first, threads=self.threads
        )

    def _guide(self) -> None:
        """Numbers of guidance that go with the loops as they are."""
        plan, rig = self.plan, self._rig(self._tuned(), 2 * SETTINGS.fine_step_s)
        if not plan.followed:
            return

        def search(_: Callable[[Step], None]) -> GroupResult:
            numbers = search_paths(plan, rig, plan.followed, seed=plan.seed)
            return GroupResult(
                name=GUIDANCE_SEARCH, history=(), at_bound=(), interrupted=False, **vars(numbers)
            )

        self.stages = self.done + 2
        self._keep(GUIDANCE_SEARCH, search)

    def _fresh(self) -> Samples:
        """Samples of the last assessment, which no search has seen."""
        return self.plan.samples(
            SETTINGS.fresh_vehicles, self.plan.seed + SETTINGS.seed_offset, nominal=SETTINGS.fresh_noises
        )

    def _assess(self) -> Tuning:
        """Tuning with its assessment."""
        plan, fresh = self.plan, self._fresh()
        autopilots = {"start": plan.autopilot, "tuned": self._tuned()}
        performance = tuple(
            assess(plan, name, self._rig(autopilot, SETTINGS.fine_step_s), fresh)
            for name, autopilot in autopilots.items()
        )
        quiet = None
        if not performance[-1].feasible:
            quiet = assess_without_noise(plan, self._rig(autopilots["tuned"], SETTINGS.fine_step_s))
        return replace(self._result(performance), quiet=quiet)

    def _planned(self) -> dict[str, float]:
        """Time that each part flies at most, s; the margins, which do not fly, as a share of it."""
        budget, parts = self.plan.table.budget, dict[str, float]()
        count = 1 + self.plan.table.samples
        for turn in range(SETTINGS.turns):
            for group in self.plan.groups:
                size = budget.population or batch_size(len(group.parameters))
                generations = budget.generations or GROUP_SEARCH_SETTINGS.generations
                rounds = budget.simplex_rounds or GROUP_SEARCH_SETTINGS.rounds
                sets = size * generations + SEARCH_SETTINGS.lanes * rounds
                each = sum(len(trials) * trials.duration_s for trials in group.trials)
                parts[_name(group, turn)] = (
                    sets * each * (count if turn == 0 else count - 1 + SETTINGS.fresh_noises)
                )
        flown = sum(parts.values())
        each = sum(len(t) * t.duration_s for group in self.plan.groups for t in group.trials)
        last = (SETTINGS.fresh_vehicles + SETTINGS.fresh_noises) * 2 * 2 * each
        after = {GUIDANCE_SEARCH: path_work_s(self.plan, self.plan.followed), _ASSESSMENT: last}
        # Margins take a tenth of the work of the searches that fly.
        return {"margins": 0.1 * flown / SETTINGS.turns} | parts | after

    def _keep(self, name: str, search: Callable[[Callable[[Step], None]], GroupResult | None]) -> bool:
        """Run or reuse a part of the search; whether it was interrupted."""
        inputs = self._inputs(name)
        self.work.begin(name)
        kept = self.directory.finished(name, inputs)
        result = (
            search(lambda step: self._report(name, step)) if kept is None else GroupResult.from_dict(kept)
        )
        self.done += 1
        self.work.end(name, kept=kept is not None)
        if result is None:
            return False
        self.results.append(replace(result, name=name))
        self.gains |= result.gains
        if kept is None and not result.interrupted:
            self.directory.keep(name, inputs, result.to_dict())
        return result.interrupted

    def _inputs(self, name: str) -> str:
        """Hash of all that a part of the search depends on."""
        fitted = self.plan.fitted
        sensors = sensors_of(self.plan.sensors, self.plan.vehicle)
        text = json.dumps([
            name,
            version("seatrial"),
            repr(sensors),
            [
                SETTINGS.turns,
                SETTINGS.fresh_noises,
                OBJECTIVE_SETTINGS.headroom_share,
                GROUP_SEARCH_SETTINGS.generations,
                GROUP_SEARCH_SETTINGS.rounds,
            ],
            self.plan.table.model_dump_json(),
            self.plan.to_dict(),  # what the table leaves to its defaults
            self.plan.current_m_s,
            self.plan.autopilot.to_toml(),
            fitted.vehicle.to_toml(),
            list(fitted.names),
            fitted.covariance.tolist(),
            self.plan.seed,
            sorted(self.gains.items()),
        ])
        return hashlib.sha256(text.encode()).hexdigest()

    def _rig(self, autopilot: Autopilot, max_step_s: float) -> Rig:
        return self.plan.rig(autopilot, max_step_s=max_step_s, threads=self.threads)

    def _spoils(self, place: int) -> bool:
        """Whether the search of a group gave margins away, caught between them and its corridors."""
        name = _name(self.plan.groups[place], 0)
        result = next(result for result in self.results if result.name == name)
        return result.after["margin"] > result.before["margin"] + GROUP_SEARCH_SETTINGS.margin_rounding

    def _violates(self, place: int, samples: Samples) -> bool:
        """Whether a group leaves a corridor with the gains that the others found since."""
        rig = self._rig(self.plan.autopilot.with_gains(self.gains), 2 * SETTINGS.fine_step_s)
        performance = assess(self.plan, "", rig, samples, only=(self.plan.groups[place],), responses=False)
        return performance.worst_s > 0.0

    def _tuned(self) -> Autopilot:
        plan = self.plan
        return tuned_autopilot(plan.autopilot, self.gains, plan.name, plan.origin, plan.vehicle.name)

    def _result(self, performance: tuple[Performance, ...]) -> Tuning:
        interrupted = self.stopped or (bool(self.results) and self.results[-1].interrupted)
        return Tuning(
            plan=self.plan,
            autopilot=self._tuned(),
            groups=tuple(self.results),
            performance=performance,
            reverted=self.reverted,
            elapsed_s=self.clock.elapsed_s,
            interrupted=interrupted,
            facts=run_facts(
                "tuning",
                self.plan.name,
                clock=self.clock,
                inputs=self.plan.inputs,
                seed=self.plan.seed,
                interrupted=interrupted,
            ),
        )

    def _report(self, name: str, step: Step) -> None:
        if self.progress is None:
            return
        part = step.generation / max(step.generations, 1)
        # Of a group's budget the evolution strategy takes about two thirds.
        begun, share = {
            "evolution": (0.0, SETTINGS.evolution_share),
            "simplex": (SETTINGS.evolution_share, 1.0 - SETTINGS.evolution_share),
        }.get(step.phase, (0.0, 1.0))
        share = part if name == "margins" else begun + share * part
        self.progress(
            Progress(
                what=name,
                done=self.done,
                total=self.stages,
                fraction=min(self.work.done(name, share), 1.0),
                elapsed_s=self.clock.elapsed_s,
                left_s=self.work.left_s(name, share),
                step=step,
                notes=self.notes,
            )
        )
        self.notes = ()


def _name(group: Group, turn: int) -> str:
    return group.name if turn == 0 else f"{group.name}, again ({turn + 1})"


class WorkLeft:
    """Work of named parts, s flown at most by each, done and to do.

    Examples
    --------
    >>> now = iter([0.0, 10.0])
    >>> work = WorkLeft({"heave": 1e6, "surge": 3e6}, clock=lambda: next(now))
    >>> work.begin("heave")
    >>> round(work.done("heave", 1.0), 2)
    0.25
    """

    def __init__(self, parts: Mapping[str, float], *, clock: Callable[[], float] = time.monotonic) -> None:
        self._left = dict(parts)
        self._all = max(sum(self._left.values()), 1e-9)
        self._clock = clock
        self._worked, self._took = 0.0, 0.0
        self._began = 0.0

    def begin(self, name: str) -> None:
        """A part is searched from now on; one that was not planned comes on top."""
        self._left.setdefault(name, 0.0)
        self._began = self._clock()

    def done(self, name: str, share: float) -> float:
        """Share of all work that is done, when of the part that was begun this share is."""
        return 1.0 - (self._sum() - share * self._left[name]) / self._all

    def left_s(self, name: str, share: float) -> float:
        """Time left, s, if every part uses its whole budget."""
        part = self._left[name]
        first = SETTINGS.first_progress * self._all
        worked = self._worked + share * part
        took = self._took + (self._clock() - self._began if part > 0.0 else 0.0)
        # Before anything was measured: what about two cores take, s per s of flight.
        pace = (first / 60_000.0 + took) / (first + worked)
        return max(pace * (self._sum() - share * part), 0.0)

    def end(self, name: str, *, kept: bool = False) -> None:
        """A part is over, or was kept by an earlier run."""
        part = self._left.pop(name, 0.0)
        if not kept and part > 0.0:
            self._worked += part
            self._took += self._clock() - self._began

    def keep_only(self, names: Collection[str]) -> None:
        """Parts that are still to do; all others are not needed."""
        self._left = {name: part for name, part in self._left.items() if name in names}

    def _sum(self) -> float:
        return sum(self._left.values())


@takes(work=Work)
@callers_errors_pass
def tune(
    problem: ControlProblem | Identification | Fitted | Vehicle | str | Path,
    autopilot: Autopilot | str | Path | None = None,
    *,
    loops: Mapping[str, Mapping[str, Any]] | None = None,
    settings: Mapping[str, Any] | None = None,
    name: str | None = None,
    seed: int = 0,
    work: Work = HERE,
    **others: Any,
) -> Tuning:
    """Tuning: an autopilot with tuned gains, how its responses keep to their corridors, and its margins.

    ``tune(fit, autopilot, loops=...)`` tunes a `ControlProblem` of these; ``Campaign.load(file).tune(fit)``
    the one that a campaign file states.

    Parameters
    ----------
    problem : ControlProblem; or Identification, run directory, Vehicle, built-in name or file
        What is asked; or what is known of the vehicle.
    autopilot : Autopilot, built-in name or file
        Beside a vehicle: with the start gains.
    loops, name, seed
        Beside a vehicle: as of `ControlProblem`.
    settings : mapping, optional
        Beside a vehicle: its other keys, for example samples, sensors, margins, budget; they may stand among
        the arguments as ``others``, too.
    work : Work, optional
        Threads, executor, run directory and progress. Finished groups are kept in the run directory; an
        executor flies the candidates of the searches.

    Returns
    -------
    Tuning
        ``interrupted`` after Ctrl-C, with the best gains so far.

    Raises
    ------
    CampaignError
        The campaign or its tables ask for what the vehicle or the autopilot cannot do.
    VehicleError, TrialError
        A file is not usable.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> tuning = campaign.tune(campaign.identify())  # doctest: +SKIP
    >>> tuning.autopilot.gains()["surge.K_P.4"]  # doctest: +SKIP

    Without a file, and with a search that is much too short:

    >>> corridor = {"rise_s": 5.0, "overshoot": 0.3, "settling_s": 10.0, "settled": 0.1}
    >>> tuning = st.tune(
    ...     "remus100",
    ...     "remus100",
    ...     loops={"heading": {"steps": [20.0], "speeds_m_s": [2.0], "corridor": corridor}},
    ...     settings={
    ...         "samples": 0,
    ...         "settle_s": 6.0,
    ...         "budget": {"population": 8, "generations": 1, "simplex_rounds": 1},
    ...     },
    ... )
    >>> [group.name for group in tuning.groups[:2]]
    ['margins', 'heading']
    """
    if "relay" in others:
        raise CampaignError(
            "tune: relay: relay tuning is not offered, as the search by corridors was better on every loop"
            " that was measured; leave it out, and take start gains from seatrial.start_autopilot"
        )
    checked_threads(work.threads)
    asked = {"loops": loops, "settings": settings, "name": name, "seed": seed or None} | others
    asked = {key: value for key, value in asked.items() if value is not None}
    if not isinstance(problem, ControlProblem):
        if callable(getattr(problem, "control_problem", None)):
            raise CampaignError("tune: found a campaign; use campaign.tune(fit, work=st.Work(...))")
        if autopilot is None:
            raise CampaignError(
                "tune: expected a ControlProblem, or a vehicle and its autopilot, found a vehicle alone; give"
                " an Autopilot, a built-in name or a file as second argument"
            )
        problem = ControlProblem(problem, autopilot, **asked.pop("settings", {}), **asked)
    elif autopilot is not None or asked:
        given = "autopilot" if autopilot is not None else next(iter(asked))
        raise CampaignError(f"tune: {given}: the problem says that; give it only beside a vehicle")
    assert problem.groups is not None  # what cannot be tuned is refused before a directory is made
    with RunDirectory(work.run_dir, "tuning", resume=work.resume) as run, fleet_of(work.executor) as fleet:
        tuning = TuningRun(problem, run, progress=work.progress, threads=work.threads, fleet=fleet).run()
        if tuning.interrupted and tuning.groups:
            with contextlib.suppress(SeatrialError):  # the gains are in what is returned all the same
                # The best gains so far are an autopilot file beside the finished groups.
                tuning = replace(tuning, kept=run.leave("autopilot.toml", tuning.autopilot.to_toml()))
        elif work.run_dir is not None and not tuning.interrupted:
            run.publish(tuning.facts, tuning.files())
    return tuning
