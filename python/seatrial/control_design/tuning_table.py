"""The table ``[tuning]`` of a campaign: loops and their steps, corridors, margins, search of the gains.

These models are the only owner of its keys; unknown ones are refused with the nearest known name. What is
absent and depends on the vehicle (steps, corridors, speeds) is None here and chosen in `seatrial.tuning`.
Held by ``tests/control_design/test_tuning_file.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from seatrial.base.toml_file import Interval, Name, NotNegative, Number, Positive, Section
from seatrial.control_design.corridor import Corridor
from seatrial.problem.settings import Budget


@dataclass(frozen=True)
class Loop:
    """A loop or path that is tuned: channel of its response, unit of its steps in the file and in SI, the
    ``largest`` step (angles are compared the shorter way round), and the ``usual`` one, as a share of the
    top speed where ``of_top`` holds.
    """

    channel: str
    unit: str
    to_si: float
    largest: float
    usual: float
    of_top: bool = False


_DEG = math.pi / 180.0  # rad per degree

LOOPS = {
    "surge": Loop("u", "m/s", 1.0, math.inf, 0.15, of_top=True),
    "sway": Loop("v", "m/s", 1.0, math.inf, 0.15, of_top=True),
    "heave": Loop("z", "m", 1.0, math.inf, 1.0),
    "roll": Loop("roll", "deg", _DEG, 90.0, 15.0),
    "pitch": Loop("pitch", "deg", _DEG, 90.0, 15.0),
    "heading": Loop("yaw", "deg", _DEG, 120.0, 20.0),
    "depth": Loop("z", "m", 1.0, math.inf, 1.0),
    "cross_track": Loop("cross_track", "m", 1.0, math.inf, 2.0),
}
"""Loops of the autopilot, and the paths over them: the depth by pitch, the cross-track error by heading."""

BESIDE = {
    "surge_m_s": ("u", 1.0),
    "sway_m_s": ("v", 1.0),
    "depth_m": ("z", 1.0),
    "roll_deg": ("roll", _DEG),
    "pitch_deg": ("pitch", _DEG),
    "heading_deg": ("yaw", _DEG),
    "cross_track_m": ("cross_track", 1.0),
    "vertical_error_m": ("vertical_error", 1.0),
}
"""Channel and factor to SI of every key of `Beside`."""


def default_steps(loop: str, *, top_m_s: float, largest: float = math.inf) -> tuple[float, float]:
    """Steps of a loop in both directions where the file gives none, in the file's unit: about half of what
    may just ask for the largest demand (`seatrial.control_design.start_gains.USUAL_ERROR`), at most
    `largest`.
    """
    entry = LOOPS[loop]
    size = min(float(f"{entry.usual * top_m_s:.2g}") if entry.of_top else entry.usual, largest)
    return size, -size


class Weights(Section):
    """Weights of leaving a corridor downwards and upwards."""

    lower: NotNegative = 1.0
    """Weight of a shortfall."""
    upper: NotNegative = 1.0
    """Weight of an excess."""

    @model_validator(mode="after")
    def _one_counts(self) -> Weights:
        if self.lower == self.upper == 0.0:
            raise ValueError(
                "both weights are 0, so no violation counts; give lower or upper a weight above 0"
            )
        return self


def _point(entry: Any) -> Any:
    if isinstance(entry, list | tuple) and len(entry) != 2:
        raise ValueError(f"expected a point [time in s, share of the step], found {list(entry)}")
    return entry


Point = Annotated[Interval, BeforeValidator(_point)]


class CorridorTable(Section):
    """A corridor by its figures, or by the points of its bounds (time since the step in s, share of it)."""

    rise_s: Positive | None = None
    """90 % of the step are reached, and not left again, s; by default required without points."""
    overshoot: NotNegative | None = None
    """Largest excess, share of the step; by default 0.1."""
    settling_s: Positive | None = None
    """Then within ``settled``, s; by default 2 ``rise_s``."""
    settled: Positive | None = None
    """Half-width of the band, share of the step; by default 0.05."""
    steady: Positive | None = None
    """Half-width at the end, share of the step; by default ``settled``."""
    until_s: Positive | None = None
    """End of the corridor, s; by default twice the settling."""
    undershoot: NotNegative | None = None
    """How far the response may go the wrong way, share of the step; by default 0.1."""
    dead_s: NotNegative | None = None
    """Dead time, from the end of which rise and settling count, s; by default 0."""
    lower: tuple[Point, ...] = ()
    """Points of the lower bound; equal times are a jump."""
    upper: tuple[Point, ...] = ()
    """Points of the upper bound."""

    @model_validator(mode="after")
    def _figures_or_points(self) -> CorridorTable:
        figures = [key for key, value in self._figures().items() if value is not None]
        if (self.lower or self.upper) and figures:
            raise ValueError(
                f"gives figures ({', '.join(figures)}) and points (lower, upper); give one or the other"
            )
        if not (self.lower or self.upper) and self.rise_s is None:
            raise ValueError("expected rise_s, or points as lower and upper; found neither; add one")
        self.corridor(Weights())
        return self

    def corridor(self, weights: Weights) -> Corridor:
        """The corridor, with a weight per side."""
        sides = {"weight_lower": weights.lower, "weight_upper": weights.upper}
        if self.lower or self.upper:
            return _of_a_step(Corridor(self.lower, self.upper, **sides))
        given = {key: value for key, value in self._figures().items() if value is not None}
        return Corridor.from_figures(**given, **sides)

    def _figures(self) -> dict[str, Any]:
        return self.model_dump(exclude={"lower", "upper"})


def _of_a_step(corridor: Corridor) -> Corridor:
    """The corridor, unless even a response that begins at 0 and ends at 1 is outside."""
    for at, event, value in ((0.0, "begins", 0.0), (corridor.until_s, "ends", 1.0)):
        lower, upper = (float(side[0]) for side in corridor.sampled([at]))
        if not lower <= value <= upper:
            raise ValueError(
                f"a response {event} at {value:g}, which lies outside at {at:g} s: lower is {lower:g}, upper"
                f" {upper:g} there; let the bounds enclose it"
            )
    return corridor


class Beside(Section):
    """What the other channels may do meanwhile: half-widths about their set points."""

    surge_m_s: Positive | None = None
    """Speed ahead, m/s."""
    sway_m_s: Positive | None = None
    """Speed athwart, m/s."""
    depth_m: Positive | None = None
    """Depth, m."""
    roll_deg: Positive | None = None
    """Roll, degrees."""
    pitch_deg: Positive | None = None
    """Pitch, degrees."""
    heading_deg: Positive | None = None
    """Heading, degrees."""
    cross_track_m: Positive | None = None
    """Cross-track error, m."""
    vertical_error_m: Positive | None = None
    """Vertical error of guidance, m."""

    def half_widths(self) -> dict[str, float]:
        """Half-width in SI (m/s, m, rad) of every channel that is bounded."""
        given = self.model_dump(exclude_none=True)
        return {BESIDE[key][0]: BESIDE[key][1] * value for key, value in given.items()}


class LoopTable(Section):
    """Set-point steps of a loop, and the corridor that the responses shall keep to."""

    steps: Annotated[tuple[Number, ...], Field(min_length=1)] | None = None
    """Steps of the set point; each is flown there and back; by default one size, chosen."""
    speeds_m_s: Annotated[tuple[Number, ...], Field(min_length=1)] | None = None
    """Desired speeds at which it steps, m/s; by default up to three of the reachable breakpoints."""
    corridor: CorridorTable | None = None
    """Bounds of the response; by default from the vehicle's limits."""
    weights: Weights = Weights()
    """What a second below and a second above count."""
    beside: Beside = Beside()
    """What the other channels may do meanwhile."""

    @model_validator(mode="after")
    def _steps_move(self) -> LoopTable:
        if self.steps and 0.0 in self.steps:
            raise ValueError(
                f"steps holds 0 as entry {self.steps.index(0.0) + 1}: the set point stays; remove it"
            )
        for key in ("steps", "speeds_m_s"):
            values = getattr(self, key) or ()
            for k, value in enumerate(values):
                if value in values[:k]:
                    raise ValueError(f"{key} holds {value:g} twice; name it once")
        return self


class Loops(Section):
    """Tables of the loops that are tuned, by name."""

    surge: LoopTable | None = None
    """Speed ahead; steps in m/s."""
    sway: LoopTable | None = None
    """Speed athwart; steps in m/s."""
    heave: LoopTable | None = None
    """Depth by vertical thrusters; steps in m."""
    roll: LoopTable | None = None
    """Refused by the tuner; its margins count all the same."""
    pitch: LoopTable | None = None
    """Pitch of the mode that holds the depth by it; steps in degrees below 90."""
    heading: LoopTable | None = None
    """Heading; steps in degrees below 120."""
    depth: LoopTable | None = None
    """Path over pitch, with guidance; steps in m."""
    cross_track: LoopTable | None = None
    """Path over heading, with guidance; steps in m."""

    @model_validator(mode="after")
    def _fit_their_loop(self) -> Loops:
        for name, table in self.given().items():
            loop = LOOPS[name]
            for step in table.steps or ():
                if abs(step) >= loop.largest:
                    raise ValueError(
                        f"steps of {name}: expected angles between -{loop.largest:g} and {loop.largest:g}"
                        f" {loop.unit}, found {step:g}; choose a smaller step"
                    )
            for key in table.beside.model_fields_set:
                if BESIDE[key][0] == loop.channel:
                    raise ValueError(
                        f"beside of {name} bounds {key}, the response of the loop itself; its corridor does"
                        " that, so remove the key"
                    )
        return self

    def given(self) -> dict[str, LoopTable]:
        """Tables that the file holds, by loop, in the order of `LOOPS`."""
        return {name: table for name in LOOPS if (table := getattr(self, name)) is not None}


@dataclass(frozen=True)
class AcceptedMarginLimits:
    """Margins that a control loop is accepted by.

    Every verdict on margins and the default limits of a tuning are these. Source: Åström and Murray,
    *Feedback Systems* (2008), section 9.3: phase margin 30 to 60 deg, gain margin 2 to 5, stability margin
    (one over the largest sensitivity) 0.5 to 0.8.
    """

    phase_deg: float = 30.0  #: Least phase margin, deg: the lower end of what the source recommends.
    #: Least gain margin, dB: a factor of two, the lower end of what the source recommends.
    gain_db: float = 6.0
    sensitivity: float = 2.0  #: Largest sensitivity: the lower end of the source's stability margins.


ACCEPTED = AcceptedMarginLimits()


class LeastMargins(Section):
    """Least margins of the linearised loop; 0 requires none, but an unstable motion always falls short."""

    phase_deg: Annotated[float, Field(strict=True, ge=0, le=90)] = ACCEPTED.phase_deg
    """Phase margin, degrees."""
    gain_db: NotNegative = ACCEPTED.gain_db
    """Gain margin upwards and downwards, dB."""
    delay_s: NotNegative = 0.2
    """Delay margin, s."""

    @property
    def any(self) -> bool:
        """Whether a margin is asked for."""
        return bool(self.phase_deg or self.gain_db or self.delay_s)


class Margins(LeastMargins):
    """Least margins at every supporting point, and others astern, where many a hull is unstable."""

    astern: LeastMargins | None = None
    """Other margins at speeds below 0; by default the same."""

    @property
    def any_at_all(self) -> bool:
        """Whether a margin is asked for at some speed."""
        return self.any or (self.astern is not None and self.astern.any)

    def at(self, speed_m_s: float) -> LeastMargins:
        """Those at a desired speed, m/s; negative is astern."""
        return self.astern if speed_m_s < 0.0 and self.astern is not None else self


def _quantile(entry: Any) -> Any:
    number = isinstance(entry, int | float) and not isinstance(entry, bool)
    if entry == "worst" or (number and 0.0 <= entry <= 1.0):
        return entry
    raise ValueError(
        f'expected "worst" or a quantile over the samples from 0 to 1, found {entry!r}; correct the value'
    )


def _factors(entry: Any) -> Any:
    if isinstance(entry, list | tuple) and len(entry) == 2:
        lower, upper = entry
        if all(isinstance(x, int | float) and math.isfinite(x) for x in entry) and not (
            0.0 < lower <= 1.0 <= upper and lower < upper
        ):
            raise ValueError(
                "bounds are [lower, upper], factors on the start gains with 0 < lower <= 1 <= upper and"
                f" lower < upper, found [{lower:g}, {upper:g}]"
            )
    return entry


class TuningTable(Section):
    """How gains are searched, and what the closed loop shall do with them."""

    loops: Loops = Loops()
    """What is tuned."""
    samples: Annotated[int, Field(strict=True, ge=0)] = 3
    """Vehicles drawn from the identified covariance, each in a current, beside the vehicle itself in
    still water."""
    robust: Annotated[Literal["worst"] | float, BeforeValidator(_quantile)] = "worst"
    """What counts over the samples: the worst, or a quantile."""
    current_m_s: NotNegative | None = None
    """Steady current that the samples meet, from all sides, m/s; by default a twentieth of the top speed."""
    sensors: Name = "typical"
    """``"typical"``, ``"perfect"`` or a file of sensors."""
    margins: Margins = Margins()
    """Least margins of the linearised loops."""
    smoothness: NotNegative = 0.05
    """Weight of the second differences of ln(gain) along the breakpoints."""
    bounds: Annotated[Interval, BeforeValidator(_factors)] = (0.1, 10.0)
    """Factors on the start gains between which is searched."""
    settle_s: Positive | None = None
    """Time at the set point before the step, s; by default 15 or ``until_s``, the longer; 1.6 ``until_s``
    for a corridor of the defaults."""
    voltage_v: Positive | None = None
    """Supply, V; by default required where thrust depends on it."""
    budget: Budget = Budget()
    """As above, for each group of loops."""
