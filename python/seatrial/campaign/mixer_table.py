"""The table ``[mixer]`` of a campaign and of a trial: from sticks and channels to commands.

What it means is `seatrial.trial.mixer`'s. Held by ``tests/campaign/test_mixer_table.py``.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from seatrial.base.toml_file import Name, NotNegative, Number, Positive, Section
from seatrial.trial.mixer import WRENCH, Mixer, Output, Stick


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
