"""Absolute anchors of the force scale: motion data fix only ratios of mass, damping and thrust.

Tests: ``tests/campaign/test_campaign_file.py``, ``tests/estimation/test_anchor.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from seatrial.base.toml_file import Number, Positive, Section


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
