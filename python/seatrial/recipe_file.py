"""The files of generated trials: which keys truth, recipe and sensor files have, what they may hold.

These models are the only owner of the formats, but for the keys of a sensor, which
`seatrial.sensors.sensor.Sensor` owns; unknown keys are refused with the nearest known name.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, model_validator

from seatrial.errors import TrialError, reason
from seatrial.toml_file import Name, Number, Positive, Section, checked, tables

__all__ = ["RecipeFile", "SensorFile", "TruthFile", "read_as"]


class SensorFile(Section):
    """A set of sensors by kind; a truth file is one too."""

    format: Literal[1]
    description: str = ""
    sensors: dict[str, dict[str, Any]] = Field(default_factory=dict)


class TruthFile(SensorFile):
    """A truth vehicle: factors on, or values instead of, coefficients, and its sensors.

    ``vehicle_file`` holds tables that replace entries of the vehicle's file first, for what is no coefficient
    (limits of a motor).
    """

    vehicle: Name
    vehicle_file: dict[str, Any] = Field(default_factory=dict)
    factors: dict[str, Number] = Field(default_factory=dict)
    values: dict[str, Number] = Field(default_factory=dict)


class _Initial(Section):
    """State at the start, at rest over ground but for surge."""

    depth_m: Number = 0.0
    roll_deg: Number = 0.0
    pitch_deg: Number = 0.0
    yaw_deg: Number = 0.0
    surge_m_s: Number = 0.0


class _Current(Section):
    """Steady current over ground, NED."""

    north_m_s: Number = 0.0
    east_m_s: Number = 0.0
    down_m_s: Number = 0.0


class RecipeFile(Section):
    """A generated trial."""

    format: Literal[1]
    description: str
    truth: Name
    seed: Annotated[int, Field(strict=True, ge=0)]
    duration_s: Positive
    rate_hz: Positive = 10.0
    held: Annotated[bool, Field(strict=True)] = False
    voltage_v: Positive | None = None
    bottom_depth_m: Positive | None = None
    initial: _Initial = _Initial()
    current: _Current = _Current()
    commands: tuple[dict[str, Number], ...] = ()

    @model_validator(mode="after")
    def _a_held_vehicle_is_at_rest(self) -> RecipeFile:
        if self.held and self.initial.surge_m_s != 0.0:
            raise ValueError(
                f"a held vehicle does not move, found initial surge_m_s = {self.initial.surge_m_s:g};"
                " leave it out, or held"
            )
        return self


_OF_THE_VEHICLE = ("vehicle", "vehicle_file", "factors", "values")
_File = TypeVar("_File", bound=Section)


def read_as(model: type[_File], path: Path) -> _File:
    """Contents of a TOML file as one of the models.

    Raises
    ------
    TrialError
        The file cannot be read, is no TOML, or a key or value is wrong.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        what = "a set of sensors" if model is SensorFile else "the file of a generated trial"
        advice = "check the path, or say typical" if model is SensorFile else "check the path"
        raise TrialError(f"{path}: not readable as {what} ({reason(error)}); {advice}") from None
    data = tables(text, str(path), error=TrialError)
    if model is SensorFile:
        # What a truth file says of its vehicle is another reader's business.
        data = {key: value for key, value in data.items() if key not in _OF_THE_VEHICLE}
    return checked(model, data, str(path), error=TrialError)
