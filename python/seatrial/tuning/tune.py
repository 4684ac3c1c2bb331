"""`tune`: from a campaign and what was identified to an autopilot whose responses stay in their corridors.

Margins first, then group after group by evolution strategy and simplex on the full non-linear closed loop
with limits, dead band, dead time, sensor noise, currents and drawn vehicles; at last everything is judged
again on samples that the search never saw, beside the start gains and a relay autotuning. The work is in
`seatrial.tuning.tune`, loaded at the call: `import seatrial` stays light.

Source: Taubert et al. (2014), section "Constraint Criteria Optimization". Held by tests/tuning/test_tune.py.

The conduct of a tuning: what cannot be tuned is refused, the run is made, its results are left behind.

The run itself is `seatrial.tuning.tune`. Held by tests/tuning/test_tune.py.

One tuning under way: margins, group after group, the groups that violate once more, judgement.

Ctrl-C at any time ends it with the best gains so far. Held by tests/tuning/test_tune.py,
tests/tuning/test_second_turn.py,
tests/tuning/test_tuning_kept_stages.py and tests/tuning/test_tuning_draws.py.

How much of a tuning is done, and how long the rest takes at most.

The work of a search is the time that its candidates fly if it uses its whole budget: what it costs to the
processor is about proportional to that. A second turn of all groups counts from the beginning and falls away
where it is not needed, so that the time left is one that may shorten and hardly ever grows. What an earlier
run left behind counts as done, but says nothing of the pace.

Held by tests/tuning/test_tuning_progress.py.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial.base.errors import CampaignError, SeatrialError, TrialError
from seatrial.base.progress import Clock, Progress, Step
from seatrial.base.run import RunDirectory, run_facts, version
from seatrial.campaign.campaign import input_hashes
from seatrial.control_design.autopilot_facts import refuse_other_laws
from seatrial.estimation.search import LANES, batch_size
from seatrial.flight.sensor_channels import sensors_of
from seatrial.tuning.judgement import Judged, judge, judged_without_noise
from seatrial.tuning.objective import RESERVE
from seatrial.tuning.plan import Group, TuningPlan
from seatrial.tuning.result import Tuning, tuned_autopilot, without_table
from seatrial.tuning.search import GENERATIONS, ROUNDS, GroupResult, search_group, search_margins, take_back
from seatrial.tuning.step_trial import Rig, Samples

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification

__all__ = ["TuningRun", "WorkLeft", "conduct", "plan_of", "tune"]


def tune(
    campaign: Campaign,
    fit: Identification | Fitted | Vehicle | str | Path | None = None,
    *,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    relay: bool = False,
    threads: int | None = None,
) -> Tuning:
    """Tuning: an autopilot with tuned gains, how its responses keep to their corridors, and its margins.

    Parameters
    ----------
    campaign : Campaign
        Its ``[tuning]`` says what the loops shall do, its ``autopilot`` gives the start gains.
    fit : Identification, run directory, Vehicle, built-in name or file, optional
        What is known of the vehicle; the campaign's own vehicle, taken as exact, when missing.
    run_dir : str or Path, optional
        Where the results go, and where finished groups are kept for a run that resumes this one.
    progress : callable, optional
        Called with a `Progress` after every batch of candidates.
    resume : bool, optional
        Whether groups that an earlier run finished from the same inputs are reused.
    relay : bool, optional
        Whether a relay autotuning of the same loops is judged beside.
    threads : int, optional
        All when omitted; the result does not depend on it.

    Returns
    -------
    Tuning
        ``interrupted`` after Ctrl-C, with the best gains so far.

    Raises
    ------
    CampaignError
        The campaign asks for what the vehicle or the autopilot cannot do.
    VehicleError, TrialError
        A file is not usable.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> tuning = st.tune(campaign, st.identify(campaign))  # doctest: +SKIP
    >>> tuning.autopilot.gains()["surge.K_P.4"]  # doctest: +SKIP
    """
    return conduct(
        campaign, fit, run_dir=run_dir, progress=progress, resume=resume, relay=relay, threads=threads
    )


_PACE = 1.0 / 60_000.0  # s per s of flight before anything was measured: about two cores

_BEGUN = 0.02  # of all work, that the first guess of the pace counts as


class WorkLeft:
    """Work of named parts, done and to do.

    Parameters
    ----------
    parts : mapping of str to float
        Time flown at most by each part, s.
    clock : callable, optional
        Now, s.

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
        first = _BEGUN * self._all
        worked = self._worked + share * part
        took = self._took + (self._clock() - self._began if part > 0.0 else 0.0)
        pace = (_PACE * first + took) / (first + worked)
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
    run : RunDirectory
        Where finished groups are kept.
    progress : callable, optional
        Called with a `Progress`.
    threads : int, optional
        All by default.
    """

    def __init__(
        self,
        campaign: Campaign,
        plan: TuningPlan,
        run: RunDirectory,
        progress: Callable[[Progress], None] | None,
        threads: int | None,
    ) -> None:
        self.campaign, self.plan, self.directory = campaign, plan, run
        self.progress, self.threads = progress, threads
        self.clock = Clock()
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
        self.work.begin(name)
        kept = self.directory.finished(name, inputs)
        found = search(lambda step: self._report(name, step)) if kept is None else GroupResult.from_dict(kept)
        self.done += 1
        self.work.end(name, kept=kept is not None)
        if found is None:
            return False
        self.results.append(replace(found, name=name))
        self.gains |= found.gains
        if kept is None and not found.interrupted:
            self.directory.keep(name, inputs, found.to_dict())
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
            elapsed_s=self.clock.elapsed_s,
            interrupted=interrupted,
            facts=run_facts(
                "tuning",
                self.campaign.name,
                clock=self.clock,
                inputs=input_hashes(self.campaign, trials=False),
                seed=self.campaign.seed,
                interrupted=interrupted,
            ),
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
    plan = plan_of(campaign, fit)
    assert plan.groups is not None  # what cannot be tuned is refused before a directory is made
    with RunDirectory(run_dir, resume=resume) as run:
        found = TuningRun(campaign, plan, run, progress, threads).run(relay=relay)
        if found.interrupted and found.groups:
            with contextlib.suppress(SeatrialError):  # the gains are in what is returned all the same
                # The best gains so far are an autopilot file beside the finished groups.
                found = replace(found, kept=run.leave("autopilot.toml", found.autopilot.to_toml()))
        elif run_dir is not None and not found.interrupted:
            run.publish(found.facts, found.files())
    return found


def plan_of(
    campaign: Campaign, fit: Identification | Fitted | Vehicle | str | Path | None = None
) -> TuningPlan:
    """What a tuning of a campaign does, before it is done. Takes and raises what `tune` does."""
    from seatrial.campaign.tuning_table import TuningTable
    from seatrial.identification.fitted import Fitted

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
