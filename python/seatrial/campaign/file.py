"""The campaign file: its tables and keys, and what they may hold.

These models are the only owner of the format; unknown keys are refused with the nearest known name. What the
file asks of an identification (stages, joint estimate, anchors) are the objects of `seatrial.problem`; the
tables ``[tuning]`` and ``[verification]`` have files of their own. Held by
``tests/campaign/test_campaign_file.py``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from seatrial.base.errors import CampaignError, TrialError
from seatrial.base.toml_file import (
    CAMPAIGN,
    FolderName,
    Interval,
    Name,
    Number,
    Positive,
    Section,
    checked,
    tables,
)
from seatrial.campaign.mixer_table import MixerTable
from seatrial.campaign.verification_table import VerificationTable
from seatrial.control_design.tuning_table import TuningTable
from seatrial.problem.anchor import Anchor
from seatrial.problem.joint import JointSettings
from seatrial.problem.stage import Budget, Stage
from seatrial.trial.corrections import parse_corrections
from seatrial.trial.trial import Input


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
    polish: JointSettings | None = None
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
