"""What is asked of the joint estimate: every coefficient, trial and nuisance parameter at once.

Tests: ``tests/campaign/test_campaign_file.py``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from seatrial.base.channels import CHANNELS
from seatrial.base.errors import nearest
from seatrial.base.toml_file import Count, Name, Positive, Section
from seatrial.problem.stage import Axes, EntryOfCoefficient, TrialNames
from seatrial.trial.instability import SEGMENT_S


def _short_nuisance(entry: Any) -> Any:
    if entry == "default":
        return {}
    return {"sd": entry} if isinstance(entry, int | float) else entry


class Nuisance(Section):
    """A nuisance parameter: how far it may plausibly lie from zero, and whether all trials share it."""

    sd: Positive | None = None
    shared: bool | None = None
    trials: TrialNames = ()


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
    method : "automatic", "output" or "innovations"
        Residuals of a simulation, or innovations of a Kalman filter.
    horizon_s, horizons_s
        How far ahead innovations look, s; 0 for the next sample; ``horizons_s`` are compared with it.
    """

    trials: TrialNames = ()
    axes: Axes | None = None
    coefficients: dict[str, EntryOfCoefficient] = Field(default_factory=dict)
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
