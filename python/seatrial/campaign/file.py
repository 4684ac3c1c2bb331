"""The campaign file: its tables and keys, what they may hold, and the order in which its stages run.

These models are the only owner of the format; unknown keys are refused with the nearest known name. The
tables ``[tuning]`` and ``[verification]`` have files of their own. Held by
``tests/campaign/test_campaign_file.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from heapq import heappop, heappush
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from seatrial.base.channels import AXES, CHANNELS
from seatrial.base.errors import CampaignError, TrialError, nearest
from seatrial.base.toml_file import (
    CAMPAIGN,
    Count,
    FolderName,
    Interval,
    Name,
    Number,
    Positive,
    Section,
    checked,
    tables,
    twice,
)
from seatrial.campaign.mixer_table import MixerTable
from seatrial.campaign.search_budget import Budget
from seatrial.campaign.tuning_table import TuningTable
from seatrial.campaign.verification_table import VerificationTable
from seatrial.trial.corrections import parse_corrections
from seatrial.trial.instability import SEGMENT_S

Input = Literal["commands", "tau", "measured"]


class Environment(Section):
    """Water, gravity, and where the water ends."""

    rho_kg_m3: Positive | None = None
    g_m_s2: Positive | None = None
    surface_m: Number | None = None


Position = tuple[Number, Number, Number]


class SensorPositions(Section):
    """Where sensors sit, m forward, starboard and down of O."""

    velocity_m: Position | None = None
    position_m: Position | None = None
    depth_m: Position | None = None

    def by_sensor(self) -> dict[str, Position]:
        """Positions that are given, by sensor."""
        given = self.model_dump(exclude_none=True)
        return {key.removesuffix("_m"): position for key, position in given.items()}


def _valid_corrections(given: dict[str, Any]) -> dict[str, Any]:
    try:
        parse_corrections(given, "corrections")
    except TrialError as error:
        raise ValueError(str(error)) from None
    return given


Corrections = Annotated[dict[str, Any], AfterValidator(_valid_corrections)]


def _each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    if (name := twice(names)) is not None:
        raise ValueError(f"trial {name!r} stands twice, and data that count twice look surer; name it once")
    return names


TrialNames = Annotated[tuple[Name, ...], AfterValidator(_each_once)]


class TrialSource(Section):
    """One recording: where it is, how it is read, what of it is held out."""

    file: Name
    reader: str | None = None
    columns: dict[str, Any] = Field(default_factory=dict)
    rate_hz: Positive | None = None
    environment: Environment = Environment()
    places: SensorPositions = SensorPositions()
    corrections: Corrections = Field(default_factory=dict)
    mixer: MixerTable | None = None
    hold_out: bool = False
    hold_out_s: tuple[Interval, ...] = ()
    input: Input | None = None

    @model_validator(mode="after")
    def _intervals_run_forwards(self) -> TrialSource:
        for start, stop in self.hold_out_s:
            if start >= stop:
                raise ValueError(f"hold_out_s holds [start, stop] with start < stop, found [{start}, {stop}]")
        return self


class Axes(Section):
    """Modes of the axes by letter; an axis that is not mentioned is frozen."""

    free: str = ""
    measured: str = ""
    frozen: str = ""

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
    factor: Number = 1.0


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
    start: Number | None = None
    sd: Positive | None = None
    relative: bool = False
    tie: tuple[Annotated[Tie, BeforeValidator(_short_tie)], ...] = ()

    @model_validator(mode="after")
    def _bounds_in_order(self) -> Coefficient:
        if self.bounds is not None:
            lower, upper = self.bounds
            if lower >= upper:
                raise ValueError(f"bounds are [lower, upper] with lower < upper, found [{lower}, {upper}]")
        elif self.relative:
            raise ValueError("relative = true needs bounds: two factors of the vehicle's value")
        return self


class Stage(Section):
    """One step of the identification: these coefficients from those trials."""

    name: Name
    trials: Annotated[TrialNames, Field(min_length=1)]
    axes: Axes
    coefficients: dict[str, Annotated[Coefficient, BeforeValidator(_short_coefficient)]] = Field(
        default_factory=dict
    )
    after: tuple[Name, ...] = ()
    segment_s: Positive = 10.0
    overlap_s: Annotated[float, Field(strict=True, ge=0)] = 0.0
    channels: dict[str, Positive] = Field(default_factory=dict)
    loss: Literal["absolute", "squared", "huber"] = "absolute"
    knee: Positive = 1.8
    start: Literal["smoothed", "estimated"] = "smoothed"
    budget: Budget = Budget()

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


def _short_nuisance(entry: Any) -> Any:
    if entry == "default":
        return {}
    return {"sd": entry} if isinstance(entry, int | float) else entry


class Nuisance(Section):
    """A nuisance parameter: how far it may plausibly lie from zero, and whether all trials share it."""

    sd: Positive | None = None
    shared: bool | None = None
    trials: TrialNames = ()


class Polish(Section):
    """The joint estimate after the stages: every coefficient, trial and nuisance parameter at once."""

    trials: TrialNames = ()
    axes: Axes | None = None
    coefficients: dict[str, Annotated[Coefficient, BeforeValidator(_short_coefficient)]] = Field(
        default_factory=dict
    )
    fixed: tuple[Name, ...] = ()
    nuisances: dict[str, Annotated[Nuisance, BeforeValidator(_short_nuisance)]] = Field(default_factory=dict)
    channels: dict[str, Positive] = Field(default_factory=dict)
    segment_s: Positive = SEGMENT_S
    loss: Literal["squared", "huber"] = "huber"
    knee: Positive = 3.0
    start: Literal["smoothed", "estimated"] = "estimated"
    starts: Count = 1
    rounds: Annotated[int, Field(strict=True, ge=0)] = 20
    method: Literal["automatic", "output", "innovations"] = "automatic"
    horizon_s: Annotated[float, Field(strict=True, ge=0)] = 0.0
    horizons_s: tuple[Positive, ...] = (0.2, 0.5, 2.0)

    @model_validator(mode="after")
    def _measured_by_the_filter(self) -> Polish:
        if self.method == "innovations" and self.nuisances:
            raise ValueError(
                'nuisances: method = "innovations" estimates the current in its filter and no other'
                f" nuisance parameter, found {', '.join(self.nuisances)}; correct the log by [corrections]"
                ' and [clocks], or use method = "output"'
            )
        return self

    @model_validator(mode="after")
    def _known_channels(self) -> Polish:
        for channel in self.channels:
            if channel not in CHANNELS:
                raise ValueError(f"unknown channel {channel!r}{nearest(channel, CHANNELS)}")
        return self


def _as_list(entry: Any) -> Any:
    return [entry] if isinstance(entry, Mapping) else entry


class DryMass(Section):
    """Mass on the scales and the water carried along; ``added`` is added mass over both, [least, most]."""

    mass_kg: Positive
    water_kg: Annotated[float, Field(strict=True, ge=0)] = 0.0
    axis: Literal["X", "Y", "Z"] = "X"
    added: tuple[Positive, Positive] | None = None
    sd_percent: Positive | None = None


class Bollard(Section):
    """Force measured at rest under steady commands of actuators or groups."""

    commands: Annotated[dict[str, Number], Field(min_length=1)]
    force_n: Number
    axis: Literal["X", "Y", "Z"] = "X"
    voltage_v: Positive | None = None
    sd_percent: Positive | None = None


class Ballast(Section):
    """A known ballast and one answer to it: steady sinking, an angle at rest or commands that hold depth."""

    mass_kg: Positive
    volume_m3: Annotated[float, Field(strict=True, ge=0)] = 0.0
    sink_m_s: Number | None = None
    roll_deg: Number | None = None
    pitch_deg: Number | None = None
    position_m: tuple[Number, Number, Number] | None = None
    commands: dict[str, Number] = Field(default_factory=dict)
    voltage_v: Positive | None = None
    sd_percent: Positive | None = None

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
    """Absolute anchors of the force scale: motion data fix only ratios of mass, damping and thrust."""

    dry_mass: DryMass | None = None
    bollard: Annotated[tuple[Bollard, ...], BeforeValidator(_as_list)] = ()
    ballast: Annotated[tuple[Ballast, ...], BeforeValidator(_as_list)] = ()


_MOST_STAGES = 1000  # each is planned by itself, in about a millisecond


class CampaignFile(Section):
    """The whole file."""

    file_kind = CAMPAIGN

    format: Literal[1]
    name: FolderName
    vehicle: Name
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    description: str = ""
    bench: Name | None = None
    environment: Environment = Environment()
    places: SensorPositions = SensorPositions()
    corrections: Corrections = Field(default_factory=dict)
    reader: str | None = None
    rate_hz: Positive | None = None
    input: Input = "commands"
    columns: dict[str, Any] = Field(default_factory=dict)
    mixer: MixerTable | None = None
    budget: Budget = Budget()
    trials: dict[str, TrialSource] = Field(default_factory=dict)
    stages: tuple[Stage, ...] = ()
    polish: Polish | None = None
    anchor: Anchor = Anchor()
    autopilot: Name | None = None
    tuning: TuningTable | None = None
    verification: VerificationTable | None = None

    @model_validator(mode="after")
    def _something_to_do(self) -> CampaignFile:
        if len(self.stages) > _MOST_STAGES:
            raise ValueError(
                f"expected at most {_MOST_STAGES} [[stages]], found {len(self.stages)}; free the coefficients"
                " of several in one"
            )
        alone = self.tuning is not None or self.verification is not None
        for key, given in (("trials", self.trials), ("stages", self.stages)):
            if not given and not alone:
                entry = "[trials.NAME]" if key == "trials" else "[[stages]]"
                is_ = "is empty" if key in self.model_fields_set else "is missing"
                raise ValueError(
                    f"{key} {is_}; add {entry} to identify a vehicle, or [tuning] or [verification] to tune"
                    " or verify an autopilot"
                )
        return self


def parse(text: str, source: str) -> CampaignFile:
    """Campaign file from its text.

    Raises
    ------
    CampaignError
        Not TOML, an unknown key, a missing key or a value that a key may not hold; all of them are listed.
    """
    document = tables(text, source)
    if "joint" in document:
        if "polish" in document:
            raise CampaignError(
                f"{source}: [joint] and [polish] are the same table; move the keys of [polish] to [joint]"
            )
        document["polish"] = document.pop("joint")
    return checked(CampaignFile, document, source)


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
