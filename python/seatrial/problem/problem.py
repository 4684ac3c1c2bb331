"""Problem of an identification: a vehicle, its trials, what is free in stages, and what is known beforehand.

It is made by hand in three lines (vehicle, trials, free coefficients), or filled in by a campaign file. It
does not change: variants (`without_trial`, `with_strips`) are other problems that share trials already read.

Tests: ``tests/problem/test_by_hand.py``, ``tests/campaign/test_campaign.py``.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import CampaignError, nearest
from seatrial.base.front import ByName
from seatrial.base.run import sha256
from seatrial.base.toml_file import loaded
from seatrial.base.work import HERE, Work, takes
from seatrial.inspect.verdict import Verdict, judge_trial
from seatrial.problem.by_hand import SOURCE, as_campaign_file, entries, fitted_and_judging, share, stage_of
from seatrial.problem.parameter import Parameter, coefficient_names, parameters
from seatrial.problem.settings import (
    Anchor,
    Budget,
    Coefficient,
    JointSettings,
    Stage,
    TrialUse,
    axes_of_stages,
    in_order,
    strips_freed,
    without_free,
    without_trial,
)
from seatrial.scoring.windows import Unpredictable, unpredictable

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.evaluate import BenchTest
    from seatrial.identification.identification import Identification
    from seatrial.problem.by_hand import Bounds, Trials
    from seatrial.trial.recording import Recording
    from seatrial.trial.trial import Input, Trial


class Problem:
    """What an identification is asked: vehicle, trials, free coefficients; `seatrial.identify` solves it.

    Parameters
    ----------
    vehicle : Vehicle, str or Path
        The vehicle that the search starts from, its built-in name or its file.
    trials : Trial, frame, str or Path, or several
        A trial, a table or a file with canonical columns, a list of them, or a dict by name.
    free : str, sequence or mapping
        Coefficients to identify: names (``"X_uu"``, ``"stern.gain"``) or patterns (``"N_*"``: those that are
        not zero). As a dict with bounds ``(lower, upper)`` in SI, None for the vehicle's default bounds.
    start : mapping, optional
        Start values by coefficient; the vehicle's own otherwise.
    hold_out : float, or trials
        Share of every trial, at its end, that judges the result and is not fitted; or trials that only judge.
    axes : str, optional
        Letters among ``XYZKMN`` of the axes that are simulated; by default those on which the free
        coefficients act. Others are replayed where all trials recorded them, else frozen.
    channels : sequence or mapping, optional
        Channels that are compared, or their weights; the velocities of the simulated axes by default.
    input : "commands", "measured" or "tau", optional
        What drives the model; the first of these that a trial has by default.
    segment_s : float
        The simulation restarts from the measured state after this time, s.
    joint : bool or JointSettings
        Whether the stage's result is estimated jointly once more, which refines it, and how.
    anchor : Anchor
        What is known of the absolute scale of the forces.
    bench : BenchTest, optional
        Of `seatrial.bench`: its vehicle is taken, and its thrust anchors the scale of all forces.
    name : str, optional
        Of the problem; the vehicle's by default.
    seed : int
        Of the search: the same seed gives the same result.

    Raises
    ------
    CampaignError
        A coefficient is unknown or has no bounds, a trial lacks a channel, two trials share a name.
    TrialError, VehicleError
        A file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> import seatrial as st
    >>> t = np.arange(0.0, 60.0, 0.1)
    >>> vehicle = st.Vehicle.load("cwolf")
    >>> commands = {name: 400.0 * np.sign(np.sin(0.2 * t)) + 500.0 for name in vehicle.actuators}
    >>> run = vehicle.simulate(t, commands)
    >>> table = {"t_s": t, "u_m_s": run.nu[:, 0]} | {f"cmd.{name}": c for name, c in commands.items()}
    >>> problem = st.Problem(vehicle, table, free={"X_uu": (-40.0, -1.0)})
    >>> [(parameter.name, parameter.upper) for parameter in problem.parameters["all"]]
    [('X_uu', -1.0)]
    """

    vehicle: Vehicle
    bench: BenchTest | None
    trials: Mapping[str, Trial]
    uses: Mapping[str, TrialUse]
    files: Mapping[str, Path | None]
    recordings: Mapping[str, Recording | None]
    stages: tuple[Stage, ...]
    joint: JointSettings | None
    anchor: Anchor
    common_budget: Budget
    name: str
    seed: int
    source: str
    given_text: str | None
    parameters: dict[str, tuple[Parameter, ...]]
    _listed: tuple[Stage, ...]
    _parts: dict[tuple[str, bool], Trial | None]
    _verdicts: dict[str, dict[str, Verdict]]
    _limits: dict[str, Unpredictable]

    def __init__(
        self,
        vehicle: Vehicle | str | Path,
        trials: Trials,
        *,
        free: str | Sequence[str] | Mapping[str, Bounds | None],
        start: Mapping[str, float] | None = None,
        hold_out: float | Trials = 0.2,
        axes: str | None = None,
        channels: Sequence[str] | Mapping[str, float] | None = None,
        input: Input | None = None,
        segment_s: float = 10.0,
        joint: bool | JointSettings = True,
        anchor: Anchor | None = None,
        bench: BenchTest | None = None,
        name: str | None = None,
        seed: int = 0,
    ) -> None:
        from seatrial._core import Vehicle
        from seatrial.scoring.windows import default_input

        fitted, judging = fitted_and_judging(trials, hold_out)
        known = loaded(Vehicle, vehicle) if bench is None else bench.vehicle
        stage = stage_of(known, fitted, entries(known, free, start or {}), axes, channels, segment_s)
        own = {label: default_input(known, trial) for label, trial in (fitted | judging).items()}
        self._fill(
            stages=(stage,),
            vehicle=known,
            bench=bench,
            trials=fitted | judging,
            uses={
                **{
                    label: TrialUse(input or own[label], False, share(hold_out, fitted[label]))
                    for label in fitted
                },
                **{label: TrialUse(input or own[label], True) for label in judging},
            },
            joint=joint if isinstance(joint, JointSettings) else JointSettings() if joint else None,
            anchor=anchor or Anchor(),
            name=name or known.name,
            seed=seed,
        )

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{name}: a problem does not change; its methods with_... give another")

    @classmethod
    def of(
        cls,
        *,
        vehicle: Vehicle,
        trials: Mapping[str, Trial],
        uses: Mapping[str, TrialUse],
        stages: Sequence[Stage],
        joint: JointSettings | None = None,
        **known: Any,
    ) -> Self:
        """Problem of several stages, as a campaign file states it.

        Parameters
        ----------
        vehicle : Vehicle
        trials : mapping
            Trials by name; they may be read when first asked for.
        uses : mapping
            How each of them is used, by the same names.
        stages : sequence of Stage
            In any order that their ``after`` allows.
        joint : JointSettings, optional
            The joint estimate after them; None for none.
        **known
            Further attributes: ``bench``, ``files`` and ``recordings`` (by trial the file that it was read
            from, and its signals on their own stamps; None for a trial that was given), ``anchor``,
            ``common_budget``, ``name``, ``seed``, ``source`` (what messages call the problem) and
            ``given_text`` (the campaign file, kept with the results).

        Raises
        ------
        CampaignError
            Stages wait for one another, name trials that are not there or free a coefficient twice.
        """
        problem = cls.__new__(cls)
        problem._fill(vehicle=vehicle, trials=trials, uses=uses, stages=stages, joint=joint, **known)
        return problem

    def _fill(self, *, stages: Sequence[Stage], **known: Any) -> None:
        """Set all attributes, and check them."""
        nothing = dict.fromkeys(known["trials"])
        usual = {
            "bench": None,
            "files": nothing,
            "recordings": nothing,
            "anchor": Anchor(),
            "common_budget": Budget(),
            "name": known["vehicle"].name,
            "seed": 0,
            "source": SOURCE,
            "given_text": None,
        }
        if unknown := sorted(known.keys() - usual.keys() - {"vehicle", "trials", "uses", "joint"}):
            raise CampaignError(f"Problem.of: unknown attribute {unknown[0]!r}{nearest(unknown[0], usual)}")
        vars(self).update(usual | known, _verdicts={}, _limits={})
        self._set_stages(stages)

    def _set_stages(self, stages: Sequence[Stage]) -> None:
        """Take these stages in the order of their run; parts of trials depend on what is held out."""
        ordered = in_order(tuple(stages), self.source)
        freed = {stage.name: parameters(stage, self.vehicle, self.where(stage)) for stage in ordered}
        vars(self).update(_listed=tuple(stages), stages=ordered, parameters=freed, _parts={})
        self._check_trial_names()
        self._check_side_by_side()

    def _variant(self, **changed: Any) -> Self:
        """The same problem with other attributes; trials, verdicts and limits are shared, the text stays."""
        other = copy.copy(self)
        other.__dict__.pop("text", None)
        vars(other).update(changed)
        other._set_stages(changed.get("stages", self._listed))
        return other

    @takes(work=Work)
    def identify(self, *, work: Work = HERE) -> Identification:
        """Identification of the vehicle.

        Parameters
        ----------
        work : Work, optional
            As of `seatrial.identify`, whose result and errors these are.
        """
        from seatrial.identification.identify import identify

        return identify(self, work=work)

    def with_start_values(self, starts: Mapping[str, Mapping[str, float]], *, seed: int) -> Self:
        """Problem with other start values, SI, by stage and parameter, and another seed.

        What ``starts`` leaves out starts where it did.
        """
        stages = []
        for stage in self._listed:
            entries = dict(stage.coefficients)
            for parameter in self.parameters[stage.name]:
                if parameter.name in starts.get(stage.name, {}):
                    entry, value = entries[parameter.name], starts[stage.name][parameter.name]
                    first = self.vehicle.coefficients()[parameter.members[0][0]]
                    scale = first if entry.relative else 1.0
                    entries[parameter.name] = entry.model_copy(update={"start": value / scale})
            stages.append(stage.model_copy(update={"coefficients": entries}))
        return self._variant(stages=tuple(stages), seed=seed)

    def without_trial(self, name: str) -> tuple[Self, tuple[str, ...]]:
        """Problem that does not know a trial, and the stages that no other trial is left for.

        Raises CampaignError: there is no such trial, or the rest is no problem.
        """
        if name not in self.trials:
            raise CampaignError(f"{self.source}: there is no trial {name!r}{nearest(name, self.trials)}")
        stages, joint, lost = without_trial(self._listed, self.joint, name)
        others = [trial for trial in self.trials if trial != name]
        other = self._variant(
            stages=stages,
            joint=joint,
            trials=ByName(others, self.trials.__getitem__),
            uses={trial: self.uses[trial] for trial in others},
        )
        return other, lost

    def without_coefficients(self, names: Collection[str]) -> Self:
        """Problem that frees none of these coefficients, by the names that its stages give them.

        A stage that frees nothing else is gone; there may be none left.
        """
        if not names:
            return self
        stages, joint = without_free(self._listed, self.joint, names)
        return self._variant(stages=stages, joint=joint)

    def with_strips(self, name: str, bounds: tuple[float, float], start: float) -> Self:
        """Problem that frees ``C_Dy`` or ``C_Dz`` in place of the quadratic damping that its strips make.

        ``bounds`` and ``start`` are those of the drag coefficient.
        """
        stages, joint = strips_freed(self._listed, self.joint, name, (bounds, start))
        return self._variant(stages=stages, joint=joint)

    def with_joint(self, joint: JointSettings | None) -> Self:
        """Problem that asks something else of the joint estimate, or nothing."""
        return self._variant(joint=joint)

    def with_vehicle(self, vehicle: Vehicle) -> Self:
        """Problem that begins with other values of the same vehicle's coefficients."""
        return self._variant(vehicle=vehicle)

    def with_stages(self, stages: Sequence[Stage]) -> Self:
        """Problem with other stages on its trials."""
        return self._variant(stages=tuple(stages))

    def with_trials(self, trials: Mapping[str, Trial]) -> Self:
        """Problem on other records of its trials, by the same names; what was judged of the old ones goes."""
        given = dict.fromkeys(trials)
        return self._variant(trials=trials, files=given, recordings=given, _verdicts={}, _limits={})

    def with_uses(self, uses: Mapping[str, TrialUse]) -> Self:
        """Problem that uses its trials otherwise: another input, another part held out."""
        return self._variant(uses={**self.uses, **uses})

    @cached_property
    def text(self) -> str:
        """The campaign file that states this problem: the one it came from, or one written of it."""
        if self.given_text is not None:
            return self.given_text
        return as_campaign_file(
            {"format": 1, "name": self.name, "vehicle": self.vehicle.name, "seed": self.seed},
            trials={name: (self.trials[name].source, use) for name, use in self.uses.items()},
            stages=self.stages,
            joint=self.joint,
            anchor=self.anchor,
        )

    @property
    def fitted(self) -> tuple[str, ...]:
        """Names of the trials that stages fit, each once."""
        return tuple(dict.fromkeys(name for stage in self.stages for name in stage.trials))

    @property
    def trained(self) -> tuple[str, ...]:
        """Names of the trials that stages or the joint estimate fit, in the order of the problem."""
        jointly = () if self.joint is None else self.joint.trials
        return tuple(name for name in self.trials if name in {*self.fitted, *jointly})

    @property
    def freed(self) -> str:
        """Letters of the axes that some stage frees."""
        return "".join(axis for axis in AXES if any(axis in stage.axes.free for stage in self.stages))

    @property
    def replayed(self) -> str:
        """Letters of the axes that no stage frees: every score replays them from the recording."""
        return "".join(axis for axis in AXES if axis not in self.freed)

    @property
    def judged(self) -> dict[str, str]:
        """By trial the letters of the axes on which it is judged: those freed on it, else all of `freed`."""
        own = {
            name: "".join(
                axis
                for axis in self.freed
                if any(axis in stage.axes.free and name in stage.trials for stage in self.stages)
            )
            for name in self.uses
        }
        return {name: axes or self.freed for name, axes in own.items()}

    def joint_stage(self, stages: Sequence[Stage] | None = None) -> Stage:
        """The joint estimate as one stage: by default all that the stages free, on all of their trials.

        ``stages``: those that it follows; by default all. Raises CampaignError: it names an unknown
        coefficient or trial.
        """
        stages = self.stages if stages is None else stages
        asked, where = self.joint or JointSettings(), f"{self.source}: polish"
        freed: dict[str, Coefficient] = {}
        for stage in stages:
            freed |= stage.coefficients
        for name in asked.fixed:
            if freed.pop(name, None) is None:
                raise CampaignError(f"{where}, key fixed: no stage frees {name!r}{nearest(name, freed)}")
        trials = asked.trials or tuple(dict.fromkeys(name for stage in stages for name in stage.trials))
        for name in trials:
            if name not in self.trials:
                raise CampaignError(
                    f"{where}, key trials: unknown trial {name!r}{nearest(name, self.trials)}"
                )
        axes, channels = asked.axes or axes_of_stages(stages), dict(asked.channels)
        if not channels:
            wanted = [CHANNELS[AXES.index(letter)] for letter in axes.free]
            wanted += [c for stage in stages for c in stage.channels if c not in wanted]
            known = [c for c in wanted if all(c in self.trials[name].channels for name in trials)]
            channels = dict.fromkeys(known, 1.0)
        return Stage(
            name="polish",
            trials=trials,
            axes=axes,
            coefficients=freed | asked.coefficients,
            segment_s=asked.segment_s,
            channels=channels,
        )

    @property
    def presumed(self) -> tuple[str, ...]:
        """Coefficients that are known beforehand (``sd`` of the joint estimate) and that no stage frees.

        They stand for what is not known exactly, as a nuisance parameter does.
        """
        staged = {name for stage in self.stages for name in stage.coefficients}
        own = {} if self.joint is None else self.joint.coefficients
        return tuple(name for name, entry in own.items() if entry.sd is not None and name not in staged)

    def where(self, stage: Stage) -> str:
        """File and stage, as messages begin."""
        return f"{self.source}: stage {stage.name!r}"

    def stages_before(self, stage: Stage) -> list[str]:
        """Names of the stages that a stage runs after, directly or not, in the order of their run."""
        names = set(stage.after)
        for earlier in reversed(self.stages):
            if earlier.name in names:
                names |= set(earlier.after)
        return [earlier.name for earlier in self.stages if earlier.name in names]

    def budget(self, stage: Stage) -> Budget:
        """Budget of a stage: its own, then the one of all stages."""
        return stage.budget.over(self.common_budget)

    def input_of(self, trial: str) -> Input:
        """What drives the model in a trial: "commands", "tau" or "measured"."""
        return self.uses[trial].input

    def held_out(self, trial: str) -> NDArray[np.bool_]:
        """Mask (n,): True where a sample of the trial is held out of the fit."""
        use, t = self.uses[trial], self.trials[trial].t
        mask = np.full(len(t), use.hold_out)
        rounding = 1e-6 * self.trials[trial].dt  # a sample that lies on an end up to the clock's rounding
        for start, stop in use.hold_out_s:
            mask |= (t >= start - rounding) & (t < stop - rounding)
            if stop <= t[0] or start > t[-1]:
                raise CampaignError(
                    f"{self.source}: trial {trial!r}, key hold_out_s: [{start:g}, {stop:g}] lies outside the"
                    f" recording, which runs from {t[0]:g} to {t[-1]:g} s; use the trial's own time"
                )
        return mask

    def part(self, trial: str, *, held_out: bool) -> Trial | None:
        """The trial with only what is fitted, or what is `held_out`, valid; None where nothing is.

        The same object at every call, so that its splines are made once.
        """
        key = trial, held_out
        if key not in self._parts:
            whole, mask = self.trials[trial], self.held_out(trial) == held_out
            part = dataclasses.replace(whole, valid=whole.valid & mask[:, None]) if mask.any() else None
            self._parts[key] = whole if mask.all() else part
        return self._parts[key]

    def parts(self, names: Iterable[str], *, held_out: bool) -> dict[str, Trial]:
        """By name those of some trials of which any sample is fitted, or is `held_out`, as of `part`."""
        parts = {name: self.part(name, held_out=held_out) for name in names}
        return {name: trial for name, trial in parts.items() if trial is not None}

    def verdicts(self, trial: str) -> dict[str, Verdict]:
        """By axis whether a trial tells how it answers its commands, judged once."""
        if trial not in self._verdicts:
            self._verdicts[trial] = judge_trial(self.trials[trial], self.vehicle)
        return self._verdicts[trial]

    def limits(self) -> dict[str, Unpredictable]:
        """By trial what no model of the vehicle can predict of it, estimated once."""
        for name in self.trials:
            if name not in self._limits:
                self._limits[name] = unpredictable(self.trials[name], self.verdicts(name))
        return {name: self._limits[name] for name in self.trials}

    def file_hash(self, trial: str) -> str | None:
        """SHA-256 of a trial's file, None for a trial that was given."""
        file = self.files[trial]
        return None if file is None else sha256(file.read_bytes())

    def input_hashes(self, *, trials: bool = True) -> dict[str, Any]:
        """SHA-256 of what a run over the problem reads, by name; of the recordings only with ``trials``."""
        return {
            "campaign": sha256(self.text),
            "vehicle": sha256(self.vehicle.to_toml()),
            **({} if self.bench is None else self.bench.facts["sha256"]),
            **{f"trial {name}": self.file_hash(name) for name in (self.trials if trials else ())},
        }

    def described(self) -> dict[str, Any]:
        """What is asked, as JSON holds it, without vehicle and trials: part of the key of a kept result."""
        return {
            "name": self.name,
            "seed": self.seed,
            "uses": {name: dataclasses.asdict(use) for name, use in self.uses.items()},
            "stages": [stage.model_dump(mode="json") for stage in self.stages],
            "joint": None if self.joint is None else self.joint.model_dump(mode="json"),
            "anchor": self.anchor.model_dump(mode="json"),
            "budget": self.common_budget.model_dump(mode="json"),
        }

    def _check_trial_names(self) -> None:
        for stage in self.stages:
            for name in stage.trials:
                if name not in self.uses:
                    raise CampaignError(
                        f"{self.where(stage)}, key trials: unknown trial {name!r}" + nearest(name, self.uses)
                    )
                if self.uses[name].hold_out:
                    raise CampaignError(
                        f"{self.where(stage)}, key trials: trial {name!r} is held out as a whole;"
                        " remove it from the stage or its hold_out"
                    )

    def _check_side_by_side(self) -> None:
        """Refuse two stages that set one coefficient with no order between them."""
        for i, stage in enumerate(self.stages):
            for other in self.stages[:i]:
                own, others = (set(coefficient_names(self.parameters[s.name])) for s in (stage, other))
                shared = own & others
                if shared and other.name not in self.stages_before(stage):
                    raise CampaignError(
                        f"{self.where(stage)}: coefficient {min(shared)!r} is also freed by stage"
                        f" {other.name!r}, and neither runs after the other; set after = [{other.name!r}]"
                    )


class Asks(Protocol):
    """What states a problem: a campaign."""

    def problem(self) -> Problem:
        """The problem that it states."""


def stated(asked: Problem | Asks) -> Problem:
    """A problem, or the one that a campaign states."""
    return asked if isinstance(asked, Problem) else asked.problem()
