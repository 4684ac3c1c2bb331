"""What is asked of an identification: stages, joint estimate, anchors of the force scale.

A stage says which coefficients it frees, on which trials and after which others; the joint estimate takes
every coefficient, trial and nuisance parameter at once; anchors give the absolute scale of the forces, of
which motion data fix only ratios. All check themselves when they are made, from Python as from a campaign
file.

`without_trial`, `without_free` and `strips_freed` are variants of them.

Tests: ``tests/campaign/test_variant.py``, ``tests/campaign/test_campaign_file.py``,
``tests/estimation/test_anchor.py``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import CampaignError, nearest
from seatrial.base.toml_file import Count, Interval, Name, Number, Positive, Section, twice
from seatrial.inspect.feedback import SEGMENT_S
from seatrial.trial.trial import Input

STRIPS = {"C_Dy": ("Y_vv", "Y_rr", "N_vv", "N_rr"), "C_Dz": ("Z_ww", "Z_qq", "M_ww", "M_qq")}
"""Drag coefficients of the strips of the hull, and the quadratic damping that they stand for."""


def _each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    if (name := twice(names)) is not None:
        raise ValueError(f"trial {name!r} stands twice, and data that count twice look surer; name it once")
    return names


TrialNames = Annotated[tuple[Name, ...], AfterValidator(_each_once)]


class Budget(Section):
    """Limits of a search. What is absent is chosen from the number of its parameters."""

    population: Annotated[int, Field(strict=True, ge=2)] | None = None
    """Candidates per generation, rounded up to full lanes of eight; by default by the number of
    coefficients."""
    generations: Count | None = None
    """Most generations of the global search; by default 100 + 15 per coefficient."""
    simplex_rounds: Count | None = None
    """Most rounds of the fine search; by default by the number of coefficients."""
    tolerance: Positive | None = None
    """End of the fine search: gain over the last rounds; the global search ends at a tenth, or this where
    it is more; by default 1e-4."""


@dataclass(frozen=True)
class TrialUse:
    """How a problem uses a trial.

    ``input`` drives the model; ``hold_out`` holds the whole trial out of the fit, ``hold_out_s`` the
    intervals ``[start, stop)`` of its own time, s.
    """

    input: Input = "commands"
    hold_out: bool = False
    hold_out_s: tuple[tuple[float, float], ...] = ()


class Axes(Section):
    """Modes of the axes by letter; an axis that is not mentioned is frozen."""

    free: str = ""
    """Simulated; at least one."""
    measured: str = ""
    """Replayed from the log."""
    frozen: str = ""
    """Keep their initial value."""

    @model_validator(mode="after")
    def _each_axis_once(self) -> Axes:
        for mode, letters in (("free", self.free), ("measured", self.measured), ("frozen", self.frozen)):
            for letter in letters:
                if letter not in AXES:
                    raise ValueError(f"{mode} holds letters of {AXES}, found {letter!r}")
        letters = self.free + self.measured + self.frozen
        for letter in letters:
            if letters.count(letter) > 1:
                raise ValueError(f"axis {letter} has two modes; name it once in free, measured or frozen")
        return self


def _short_tie(entry: Any) -> Any:
    return {"name": entry} if isinstance(entry, str) else entry


class Tie(Section):
    """A coefficient that follows another one by a factor (symmetry)."""

    name: Name
    """The coefficient that follows."""
    factor: Number = 1.0
    """Its value over the leading one."""


def _short_coefficient(entry: Any) -> Any:
    if entry == "default":
        return {}
    if isinstance(entry, str):
        raise ValueError(f'expected [lower, upper], "default" or a table, found {entry!r}')
    return {"bounds": entry} if isinstance(entry, list | tuple) else entry


class Coefficient(Section):
    """A free coefficient: bounds, start value, how well that is known beforehand, and those tied to it."""

    advice: ClassVar[str] = '. A name with a dot needs quotes: "stern.gain" = [0.5, 2.0].'

    bounds: Interval | None = None
    """In SI; by default default bounds."""
    start: Number | None = None
    """Start of the search, inside the bounds; by default an earlier stage's estimate, else the vehicle's
    value."""
    sd: Positive | None = None
    """Standard deviation of a prior of the joint estimate about the vehicle's value, or ``start``."""
    relative: bool = False
    """``bounds``, ``start`` and ``sd`` are factors of the vehicle's value."""
    tie: tuple[Annotated[Tie, BeforeValidator(_short_tie)], ...] = ()
    """Coefficients that follow by symmetry."""

    @model_validator(mode="after")
    def _bounds_in_order(self) -> Coefficient:
        if self.bounds is not None:
            lower, upper = self.bounds
            if lower >= upper:
                raise ValueError(f"bounds are [lower, upper] with lower < upper, found [{lower}, {upper}]")
        elif self.relative:
            raise ValueError("relative = true needs bounds: two factors of the vehicle's value")
        return self


EntryOfCoefficient = Annotated[Coefficient, BeforeValidator(_short_coefficient)]
"""A coefficient, also as ``[lower, upper]`` or ``"default"``."""


class Stage(Section):
    """One step of the identification: these coefficients from those trials.

    Parameters
    ----------
    name : str
    trials : tuple of str
        Names of the trials it is fitted to.
    axes : Axes
        Letters of the simulated, replayed and frozen axes.
    coefficients : dict
        `Coefficient` by name: bounds, start, prior, ties.
    after : tuple of str
        Stages whose results it starts from.
    segment_s, overlap_s : float
        Length of a segment and how much of it is shared with the next, s.
    channels : dict
        Weight by channel; the velocities of the free axes when empty.
    loss, knee
        Loss of a residual; ``"huber"`` counts those beyond ``knee`` standard deviations linearly.
    start : "smoothed" or "estimated"
        Initial velocities of segments: smoothed from the recording, or estimated.
    budget : Budget
        Limits of the search.
    """

    name: Name
    """Unique."""
    trials: Annotated[TrialNames, Field(min_length=1)]
    """What is fitted."""
    axes: Axes
    """Modes of the axes."""
    coefficients: dict[str, EntryOfCoefficient] = Field(default_factory=dict)
    """What is identified."""
    after: tuple[Name, ...] = ()
    """Stages whose estimates this one starts from and keeps."""
    segment_s: Positive = 10.0
    """Restart after this time, s."""
    overlap_s: Annotated[float, Field(strict=True, ge=0)] = 0.0
    """Overlap of one segment with the next, s."""
    channels: dict[str, Positive] = Field(default_factory=dict)
    """What is compared: names of ``u v w p q r x y z roll pitch yaw``."""
    loss: Literal["absolute", "squared", "huber"] = "absolute"
    """Criterion."""
    knee: Positive = 1.8
    """Knee of ``"huber"``, standard deviations."""
    start: Literal["smoothed", "estimated"] = "smoothed"
    """Initial velocities of the segments: from the smoothed log, or estimated as nuisance parameters."""
    budget: Budget = Budget()
    """How long it searches."""

    @model_validator(mode="after")
    def _consistent(self) -> Stage:
        for channel in self.channels:
            if channel not in CHANNELS:
                raise ValueError(f"unknown channel {channel!r}{nearest(channel, CHANNELS)}")
        if self.overlap_s >= self.segment_s:
            raise ValueError(
                f"overlap_s = {self.overlap_s} must be shorter than segment_s = {self.segment_s}"
            )
        if not self.axes.free:
            raise ValueError('frees no axis, so nothing can be identified; set axes = { free = "X", ... }')
        if not self.coefficients:
            raise ValueError("frees no coefficient; list at least one under [stages.coefficients]")
        return self

    def weights(self) -> dict[str, float]:
        """Weight per channel; by default 1 for the velocity of every free axis."""
        if self.channels:
            return dict(self.channels)
        return {CHANNELS[AXES.index(axis)]: 1.0 for axis in sorted(self.axes.free, key=AXES.index)}


def axes_of_stages(stages: Sequence[Stage]) -> Axes:
    """Axes that any of some stages frees, and those that one replays and none frees."""
    free = {axis for stage in stages for axis in stage.axes.free}
    replayed = {axis for stage in stages for axis in stage.axes.measured} - free
    return Axes(
        free="".join(axis for axis in AXES if axis in free),
        measured="".join(axis for axis in AXES if axis in replayed),
    )


def in_order(stages: tuple[Stage, ...], source: str) -> tuple[Stage, ...]:
    """Stages so that each comes after those it names, otherwise as in the file."""
    known = [stage.name for stage in stages]
    if (name := twice(known)) is not None:
        raise CampaignError(f"{source}: two stages are called {name!r}; rename one")
    names = set(known)
    for stage in stages:
        for name in stage.after:
            if name == stage.name:
                raise CampaignError(
                    f"{source}: stage {name!r}, key after: it names the stage itself; remove it"
                )
            if name not in names:
                raise CampaignError(
                    f"{source}: stage {stage.name!r}, key after: unknown stage {name!r}{nearest(name, known)}"
                )
    # The first of the file that waits for nothing comes next: by their places, smallest first.
    open_ = [set(stage.after) for stage in stages]
    after: dict[str, list[int]] = {}
    for k, waits in enumerate(open_):
        for name in waits:
            after.setdefault(name, []).append(k)
    ready = [k for k, waits in enumerate(open_) if not waits]
    ordered: list[Stage] = []
    while ready:
        stage = stages[heappop(ready)]
        ordered.append(stage)
        for k in after.get(stage.name, ()):
            open_[k].discard(stage.name)
            if not open_[k]:
                heappush(ready, k)
    if len(ordered) < len(stages):
        done = {stage.name for stage in ordered}
        waiting = ", ".join(repr(name) for name in known if name not in done)
        raise CampaignError(f"{source}: the stages {waiting} wait for one another; remove one of their after")
    return tuple(ordered)


def _short_nuisance(entry: Any) -> Any:
    if entry == "default":
        return {}
    return {"sd": entry} if isinstance(entry, int | float) else entry


class Nuisance(Section):
    """A nuisance parameter: how far it may plausibly lie from zero, and whether all trials share it."""

    sd: Positive | None = None
    """How far it plausibly lies from zero, SI; by default by name."""
    shared: bool | None = None
    """One value for all of its trials; by default true for ``lever_…`` and ``latency_…``."""
    trials: TrialNames = ()
    """Trials that have it."""


Method = Literal["output", "innovations"]
"""Ways to compare with the log; `seatrial.estimation.estimator.COMPARISONS` has what each can do and does."""


class JointSettings(Section):
    """The joint estimate after the stages: every coefficient, trial and nuisance parameter at once.

    Parameters
    ----------
    trials : tuple of str
        All of the stages when empty.
    axes : Axes, optional
        Those of the stages together when absent.
    coefficients, fixed
        Entries of coefficients that no stage frees, and names of those that keep the stages' values.
    nuisances : dict
        `Nuisance` by name: sensors' biases and latencies, current, a trial's own.
    channels : dict
        Weight by channel; the velocities of the free axes when empty.
    segment_s : float
        Length of a segment, s.
    loss, knee
        ``"huber"`` counts residuals beyond ``knee`` standard deviations linearly, ``"squared"`` none.
    start : "estimated" or "smoothed"
        Whether initial velocities of segments are estimated, or those of the smoothed recording.
    starts, rounds : int
        Starts, and rounds of Gauss and Newton at most; 0 rounds keep the stages' result.
    proposal_rounds : int
        Rounds of proposals of the residual analysis that are tried (`seatrial.identification.rounds`).
    method : "automatic", "output" or "innovations"
        Residuals of a simulation, or innovations of a Kalman filter.
    horizon_s, horizons_s
        How far ahead innovations look, s; 0 for the next sample; ``horizons_s`` are compared with it.
    """

    trials: TrialNames = ()
    """What is fitted jointly."""
    axes: Axes | None = None
    """Modes of the axes, as in a stage; by default free where any stage frees, measured where one
    measures."""
    coefficients: dict[str, EntryOfCoefficient] = Field(default_factory=dict)
    """Further ones, or other bounds, as in a stage."""
    fixed: tuple[Name, ...] = ()
    """Parameters of the stages that keep the stages' value."""
    nuisances: dict[str, Annotated[Nuisance, BeforeValidator(_short_nuisance)]] = Field(default_factory=dict)
    """Nuisance parameters: ``NAME = sd``, ``NAME = "default"`` or a table."""
    channels: dict[str, Positive] = Field(default_factory=dict)
    """What is compared; a weight divides the variance."""
    segment_s: Positive = SEGMENT_S
    """Restart after this time, s."""
    loss: Literal["squared", "huber"] = "huber"
    """Loss of the residuals."""
    knee: Positive = 3.0
    """Knee of ``"huber"``, standard deviations of the residual."""
    start: Literal["smoothed", "estimated"] = "estimated"
    """Initial conditions of the segments: from the smoothed log, or estimated with the rest."""
    starts: Count = 1
    """Further starts lie in the middle half of the bounds."""
    rounds: Annotated[int, Field(strict=True, ge=0)] = 20
    """Most rounds; 0 judges the stages' result."""
    proposal_rounds: Annotated[int, Field(strict=True, ge=0)] = 0
    """With a simulation compared: most rounds in which what the residuals ask for is tried, and kept where it
    predicts parts better that it has not seen."""
    method: Literal["automatic", Method] = "automatic"
    """What is compared with the log: a simulation of each segment, or predictions of a filter, without
    ``nuisances``; ``"automatic"`` chooses."""
    horizon_s: Annotated[float, Field(strict=True, ge=0)] = 0.0
    """With ``"innovations"``: how far ahead the filter predicts, s; 0 is one sample."""
    horizons_s: tuple[Positive, ...] = (0.2, 0.5, 2.0)
    """With ``"innovations"``: other horizons, s, whose estimates must agree."""

    @model_validator(mode="after")
    def _measured_by_the_filter(self) -> JointSettings:
        if self.method == "innovations" and self.nuisances:
            raise ValueError(
                'nuisances: method = "innovations" estimates the current in its filter and no other'
                f" nuisance parameter, found {', '.join(self.nuisances)}; correct the log by [corrections]"
                ' and [clocks], or use method = "output"'
            )
        return self

    @model_validator(mode="after")
    def _known_channels(self) -> JointSettings:
        for channel in self.channels:
            if channel not in CHANNELS:
                raise ValueError(f"unknown channel {channel!r}{nearest(channel, CHANNELS)}")
        return self


def _as_list(entry: Any) -> Any:
    return [entry] if isinstance(entry, Mapping) else entry


class DryMass(Section):
    """Mass on the scales and the water carried along; ``added`` is added mass over both, [least, most]."""

    mass_kg: Positive
    """Mass in air, kg."""
    water_kg: Annotated[float, Field(strict=True, ge=0)] = 0.0
    """Water that is carried along inside, kg."""
    axis: Literal["X", "Y", "Z"] = "X"
    """Apparent mass that is compared."""
    added: tuple[Positive, Positive] | None = None
    """Added mass over mass; by default Lamb's factor of the hull's ellipsoid times the vehicle's own
    displacement … times the ellipsoid."""
    sd_percent: Positive | None = None
    """Standard deviation of the factor that it leads to, per cent; not stated where absent."""


class Bollard(Section):
    """Force measured at rest under steady commands of actuators or groups."""

    commands: Annotated[dict[str, Number], Field(min_length=1)]
    """Steady commands of actuators or groups, in their units; the others at neutral."""
    force_n: Number
    """Measured force on the vehicle along the axis, N."""
    axis: Literal["X", "Y", "Z"] = "X"
    """Body axis of the force."""
    voltage_v: Positive | None = None
    """Supply voltage, where a table needs it; by default 14.8."""
    sd_percent: Positive | None = None
    """Standard deviation of the factor that it leads to, per cent; not stated where absent."""


class Ballast(Section):
    """A known ballast and one answer to it: steady sinking, an angle at rest or commands that hold depth."""

    mass_kg: Positive
    """Mass in air, kg."""
    volume_m3: Annotated[float, Field(strict=True, ge=0)] = 0.0
    """Its volume, m³."""
    sink_m_s: Number | None = None
    """Steady sinking with the ballast, motors stopped, level, m/s; negative: it still rises."""
    roll_deg: Number | None = None
    """Roll at rest with the ballast; without it the vehicle lies level."""
    pitch_deg: Number | None = None
    """Pitch at rest, likewise."""
    position_m: tuple[Number, Number, Number] | None = None
    """Where it hangs, from O; by default with an angle required."""
    commands: dict[str, Number] = Field(default_factory=dict)
    """Steady commands that hold depth with the ballast."""
    voltage_v: Positive | None = None
    """Supply voltage, V, where a table needs it."""
    sd_percent: Positive | None = None
    """Standard deviation of the factor that it leads to, per cent; not stated where absent."""

    @model_validator(mode="after")
    def _one_answer(self) -> Ballast:
        angles = [key for key in ("roll_deg", "pitch_deg") if getattr(self, key) is not None]
        given = [*angles, *(["sink_m_s"] if self.sink_m_s is not None else [])]
        given += ["commands"] if self.commands else []
        if len(given) != 1:
            raise ValueError(
                "give one answer to the ballast: sink_m_s, roll_deg, pitch_deg or commands; found"
                f" {' and '.join(given) or 'none'}"
            )
        if angles and self.position_m is None:
            raise ValueError(f"{angles[0]} needs position_m, where the ballast hangs")
        return self


class Anchor(Section):
    """Absolute anchors of the force scale: motion data fix only ratios of mass, damping and thrust.

    Parameters
    ----------
    dry_mass : DryMass, optional
        Mass on the scales, and the water that the hull carries along, kg.
    bollard : tuple of Bollard
        Forces measured at rest, N, under steady commands.
    ballast : tuple of Ballast
        Known weights, kg, and how the vehicle answered each.
    """

    dry_mass: DryMass | None = None
    """Mass on the scales."""
    bollard: Annotated[tuple[Bollard, ...], BeforeValidator(_as_list)] = ()
    """Pulls measured at rest."""
    ballast: Annotated[tuple[Ballast, ...], BeforeValidator(_as_list)] = ()
    """Known weights, and what answered them."""


Stages = tuple[Stage, ...]


def without_trial(
    stages: Stages, joint: JointSettings | None, name: str
) -> tuple[Stages, JointSettings | None, tuple[str, ...]]:
    """Stages and joint estimate without a trial, and the stages that no other trial is left for.

    What such a stage frees is estimated with everything else, where a joint estimate is asked for.
    """
    kept: list[Stage] = []
    lost: list[Stage] = []
    for stage in stages:
        others = tuple(trial for trial in stage.trials if trial != name)
        (kept if others else lost).append(stage.model_copy(update={"trials": others}))
    gone = {stage.name for stage in lost}
    left = tuple(
        stage.model_copy(update={"after": tuple(before for before in stage.after if before not in gone)})
        for stage in kept
    )
    if joint is not None:
        staged = {key for stage in left for key in stage.coefficients}
        unstaged = {
            key: entry
            for stage in lost
            for key, entry in stage.coefficients.items()
            if key not in staged and key not in joint.fixed
        }
        joint = joint.model_copy(
            update={
                "trials": tuple(trial for trial in joint.trials if trial != name),
                # Without axes of its own it takes those of all stages, the lost ones among them.
                "axes": joint.axes or axes_of_stages(stages),
                "coefficients": unstaged | joint.coefficients,
                "fixed": tuple(key for key in joint.fixed if key in staged),
                "nuisances": _nuisances(joint, name),
            }
        )
    return left, joint, tuple(stage.name for stage in lost)


def without_free(
    stages: Stages, joint: JointSettings | None, names: Collection[str]
) -> tuple[Stages, JointSettings | None]:
    """Stages and joint estimate that free none of these coefficients; stages that have no other are gone."""
    left = {
        stage.name: {name: entry for name, entry in stage.coefficients.items() if name not in names}
        for stage in stages
    }
    after = {stage.name: stage.after for stage in stages}

    def kept(before: tuple[str, ...]) -> tuple[str, ...]:
        # What followed a stage that is gone follows those before it.
        earlier = [e for name in before for e in ([name] if left.get(name, True) else kept(after[name]))]
        return tuple(dict.fromkeys(earlier))

    others = tuple(
        stage.model_copy(update={"coefficients": left[stage.name], "after": kept(stage.after)})
        for stage in stages
        if left[stage.name]
    )
    if joint is not None:
        freed = {name: entry for name, entry in joint.coefficients.items() if name not in names}
        fixed = tuple(name for name in joint.fixed if name not in names)
        joint = joint.model_copy(update={"coefficients": freed, "fixed": fixed})
    return others, joint


def strips_freed(
    stages: Stages, joint: JointSettings | None, name: str, entry: tuple[tuple[float, float], float]
) -> tuple[Stages, JointSettings | None]:
    """Stages that free the strips ``C_Dy`` or ``C_Dz`` in place of the quadratic damping that they make.

    They stand in the stage that frees the first of what they replace, in these bounds and from this start.
    """
    replaced = set(STRIPS[name])
    bounds, start = entry
    first = next((stage for stage in stages if replaced & stage.coefficients.keys()), None)
    others, joint = without_free(stages, joint, replaced)
    if first is None:
        return others, joint
    coefficients: dict[str, Coefficient] = {}
    for key, given in first.coefficients.items():
        if key not in replaced:
            coefficients[key] = given
        else:
            coefficients.setdefault(name, Coefficient(bounds=bounds, start=start))
    kept = {stage.name: stage for stage in others}
    kept[first.name] = first.model_copy(update={"coefficients": coefficients})
    return tuple(kept[stage.name] for stage in stages if stage.name in kept), joint


def _nuisances(joint: JointSettings, name: str) -> dict[str, Nuisance]:
    """Nuisance parameters without those that belong to one trial alone."""
    kept = {}
    for key, entry in joint.nuisances.items():
        others = tuple(trial for trial in entry.trials if trial != name)
        if others or not entry.trials:
            kept[key] = entry.model_copy(update={"trials": others})
    return kept
