"""The campaign file: its tables and keys, and what they may hold.

These models are the only owner of the format; unknown keys are refused with the nearest known name. What
the file asks of an identification (stages, joint estimate, anchors) are the objects of `seatrial.problem`;
the tables ``[tuning]`` and ``[verification]`` have files of their own.

`with_locked_axes` is a variant of a file with other modes of the axes that a stage locks. The paper
(Taubert et al. 2014, equation 6) freezes the axes that a stage does not free, V_const = 0: in every segment
they keep their initial velocity. Replayed from the recording they enter the forces as they were. The joint
estimate stays as it is.

Held by ``tests/campaign/test_campaign_file.py``, ``tests/campaign/test_mixer_table.py`` and
``tests/campaign/test_variant.py``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from seatrial.base.channels import AXES
from seatrial.base.errors import CampaignError, TrialError, nearest
from seatrial.base.toml_file import (
    CAMPAIGN,
    FolderName,
    Interval,
    Name,
    NotNegative,
    Number,
    Positive,
    Section,
    checked,
    tables,
)
from seatrial.control_design.tuning_table import TuningTable
from seatrial.problem.settings import Anchor, Budget, JointSettings, Stage
from seatrial.trial.columns import WRENCH, Mixer, Output, Stick
from seatrial.trial.corrections import parse_corrections
from seatrial.trial.trial import Input
from seatrial.verification.table import VerificationTable


class StickTable(Section):
    """A channel: its column, value at rest and at the ends."""

    column: Name
    trim: Number = 1500.0
    min: Number = 1100.0
    max: Number = 1900.0
    dead_zone: NotNegative = 0.0
    reversed: bool = False


class OutputTable(Section):
    """A command: factors by input, value at full deflection and at rest, and their unit."""

    mix: Annotated[dict[str, Number], Field(min_length=1)]
    full: Number
    neutral: Number = 0.0
    unit: Name | None = None


class MixerTable(Section):
    """Sticks, radio or servo channels through a mixer to actuators, and a constant supply."""

    inputs: dict[str, StickTable] = Field(default_factory=dict)
    outputs: dict[str, OutputTable] = Field(default_factory=dict)
    frame: Name | None = None
    motors: tuple[Name, ...] = ()
    reversed: tuple[Name, ...] = ()
    supply_v: Positive | None = None

    @model_validator(mode="after")
    def _fits(self) -> MixerTable:
        for name in self.outputs:
            if name.startswith("tau.") and name not in WRENCH:
                raise ValueError(f"outputs: {name!r} is no component of the wrench; use {', '.join(WRENCH)}")
        if self.supply_v is None and self.frame is None and not self.outputs:
            raise ValueError("commands nothing; add frame, outputs or supply_v")
        if (wrong := self.mixer().complaint()) is not None:
            raise ValueError(wrong)
        return self

    def mixer(self) -> Mixer:
        """The mixer that it describes."""
        return Mixer(
            inputs={name: Stick(**entry.model_dump()) for name, entry in self.inputs.items()},
            outputs={name: Output(**entry.model_dump()) for name, entry in self.outputs.items()},
            frame=self.frame,
            motors=self.motors,
            reversed=self.reversed,
            supply_v=self.supply_v,
        )


class Environment(Section):
    """Water, gravity, and where the water ends."""

    rho_kg_m3: Positive | None = None
    """Density, kg/m³; by default the vehicle's."""
    g_m_s2: Positive | None = None
    """Gravity, m/s²; by default the vehicle's."""
    surface_m: Number | None = None
    """Where the surface is, m down from the zero of z: 0 where z is the depth; without it the vehicle is
    under water; by default not known."""


Position = tuple[Number, Number, Number]


class SensorPositions(Section):
    """Where sensors sit, m forward, starboard and down of O."""

    velocity_m: Position | None = None
    """Place of the velocity sensor, over ground and through water (Doppler log); by default O."""
    position_m: Position | None = None
    """Place of the positioning antenna, transponder or marker frame; by default O."""
    depth_m: Position | None = None
    """Place of the pressure cell; by default that of the position."""

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


class TrialSource(Section):
    """One recording: where it is, how it is read, what of it is held out."""

    file: Name
    """Recording."""
    reader: str | None = None
    """As in the campaign, instead of its own."""
    columns: dict[str, Any] = Field(default_factory=dict)
    """Entries beside or instead of the campaign's."""
    rate_hz: Positive | None = None
    """Common time base, Hz; by default the campaign's."""
    environment: Environment = Environment()
    """Water and gravity of this trial."""
    places: SensorPositions = SensorPositions()
    """Where its sensors sat."""
    corrections: Corrections = Field(default_factory=dict)
    """What was wrong with its sensors."""
    mixer: MixerTable | None = None
    """Instead of the campaign's as a whole; by default the campaign's."""
    hold_out: bool = False
    """The whole trial judges and is never fitted."""
    hold_out_s: tuple[Interval, ...] = ()
    """Parts that judge and are never fitted, s of the trial's own time."""
    input: Input | None = None
    """As in the campaign, instead of its own."""

    @model_validator(mode="after")
    def _intervals_run_forwards(self) -> TrialSource:
        for start, stop in self.hold_out_s:
            if start >= stop:
                raise ValueError(f"hold_out_s holds [start, stop] with start < stop, found [{start}, {stop}]")
        return self


_MOST_STAGES = 1000  # each is planned by itself, in about a millisecond


class CampaignFile(Section):
    """The whole file."""

    file_kind = CAMPAIGN

    format: Literal[1]
    """Version of the format: 1."""
    name: FolderName
    """Name of the campaign and, under ``runs/``, of its results."""
    vehicle: Name
    """Built-in name or path of a vehicle file."""
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    """Of every random number."""
    description: str = ""
    """What it is for."""
    bench: Name | None = None
    """Bench file whose results replace characteristics and motors of the vehicle."""
    environment: Environment = Environment()
    """Water and gravity of all trials."""
    places: SensorPositions = SensorPositions()
    """Where the sensors sit."""
    corrections: Corrections = Field(default_factory=dict)
    """What was wrong with the sensors."""
    reader: str | None = None
    """A reader of read a log, or ``generated``; for all trials; by default by file ending."""
    rate_hz: Positive | None = None
    """Common time base of all trials; by default the recording's."""
    input: Input = "commands"
    """What drives the model: commands, logged wrench, measured actuator signals."""
    columns: dict[str, Any] = Field(default_factory=dict)
    """Column map of all trials."""
    mixer: MixerTable | None = None
    """Commands from sticks, radio or servo channels, and a constant supply voltage."""
    budget: Budget = Budget()
    """Budget of all stages."""
    trials: dict[str, TrialSource] = Field(default_factory=dict)
    """The recordings."""
    stages: tuple[Stage, ...] = ()
    """The steps of the identification."""
    polish: JointSettings | None = None
    """The joint estimate after the stages."""
    anchor: Anchor = Anchor()
    """What fixes the absolute scale of all forces."""
    autopilot: Name | None = None
    """Start of a tuning, and verified where no tuned one is given: built-in name or path; by default the
    built-in one of a built-in vehicle."""
    tuning: TuningTable | None = None
    """What the loops of the autopilot shall do; by default every loop, all defaults."""
    verification: VerificationTable | None = None
    """What the missions meet, and what must hold."""

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

    Raises CampaignError: not TOML, an unknown key, a missing key or a value that a key may not hold; all of
    them are listed.
    """
    document = tables(text, source)
    if "joint" in document:
        if "polish" in document:
            raise CampaignError(
                f"{source}: [joint] and [polish] are the same table; move the keys of [polish] to [joint]"
            )
        document["polish"] = document.pop("joint")
    return checked(CampaignFile, document, source)


LockedAxes = Literal["frozen", "measured"]

_MODES = ("frozen", "measured")


def with_locked_axes(text: str, mode: LockedAxes, source: str) -> str:
    """Text of a campaign file with every axis that a stage does not free in one mode; comments are kept.

    Raises CampaignError where there is no such mode.
    """
    import tomlkit

    if mode not in _MODES:
        raise CampaignError(
            f"locked axes: expected {' or '.join(map(repr, _MODES))}, found {mode!r}{nearest(mode, _MODES)}"
        )
    document: Any = tomlkit.parse(text)
    file = parse(text, source)
    if file.polish is not None and file.polish.axes is None:
        # Without axes of its own the joint estimate takes those of the stages, which are about to change.
        free = {axis for stage in file.stages for axis in stage.axes.free}
        replayed = {axis for stage in file.stages for axis in stage.axes.measured} - free
        after = set(AXES) - free if mode == "measured" else set()
        if replayed != after:
            document["polish"]["axes"] = _axes(free, measured=replayed)
    for table in document["stages"]:
        free = set(table["axes"]["free"])
        table["axes"] = _axes(free, **{mode: set(AXES) - free})
    return tomlkit.dumps(document)


def _axes(free: set[str], **modes: set[str]) -> Any:
    """Inline table of modes in the order of the axes."""
    import tomlkit

    table = tomlkit.inline_table()
    for name, axes in {"free": free, **modes}.items():
        if axes:
            table[name] = "".join(axis for axis in AXES if axis in axes)
    return table
