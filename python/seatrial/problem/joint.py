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
    """How far it plausibly lies from zero, SI; by default by name."""
    shared: bool | None = None
    """One value for all of its trials; by default true for ``lever_…`` and ``latency_…``."""
    trials: TrialNames = ()
    """Trials that have it."""


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
    method: Literal["automatic", "output", "innovations"] = "automatic"
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
