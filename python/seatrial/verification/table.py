"""The table ``[verification]`` of a campaign: conditions that are drawn, and requirements.

These models are the only owner of its keys; unknown ones are refused with the nearest known name. Every key
but ``missions`` has a default that suits every vehicle; where one depends on vehicle or mission it is None
here and chosen in `seatrial.verification.draws`.

Tests: ``tests/campaign/test_verification_file.py``.

Distributions that people write: a number, an interval, or one named in a table, and their quantiles.

========================  ===============================================================
in the file             meaning
========================  ===============================================================
``0.3``                   always this
``[0.1, 0.4]``            uniform between them
``{ uniform = [a, b] }``  the same
``{ normal = [m, s] }``   normal, mean and standard deviation; a speed or a time is cut at zero
``{ rayleigh = s }``      speed of two normal components of s each (mean 1.25 s)
``{ weibull = [s, k] }``  scale and shape, the usual fit to measured current speeds
========================  ===============================================================

Values are quantiles of given uniform numbers, so that a draw is a function of its number alone
(`seatrial.identification.fitted`).

Tests: ``tests/verification/test_draws.py``, ``tests/campaign/test_verification_file.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from seatrial.base.arrays import Array
from seatrial.base.errors import nearest
from seatrial.base.toml_file import (
    Count,
    Interval,
    Name,
    NotNegative,
    Number,
    Positive,
    Section,
    checked,
    tables,
    twice,
)


class DistributionTable(Section):
    """One distribution by its name."""

    fixed: Number | None = None
    """Always this."""
    uniform: Interval | None = None
    """Between them."""
    normal: tuple[Number, Positive] | None = None
    """Mean and standard deviation; a speed or a time is cut at zero."""
    rayleigh: Positive | None = None
    """Rayleigh: speed of two normal components of this standard deviation each."""
    weibull: tuple[Positive, Positive] | None = None
    """Scale and shape; the usual fit to measured speeds of a current."""

    @model_validator(mode="after")
    def _one(self) -> DistributionTable:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                "expected a number, [from, to], or one of uniform, normal, rayleigh, weibull; found "
                + (" and ".join(given) or "none")
            )
        if self.uniform is not None and self.uniform[0] > self.uniform[1]:
            raise ValueError(
                f"uniform holds [from, to] with from <= to, found [{self.uniform[0]:g}, {self.uniform[1]:g}]"
            )
        return self

    @property
    def is_fixed(self) -> bool:
        """Whether every draw is the same."""
        return self.fixed is not None or (self.uniform is not None and self.uniform[0] == self.uniform[1])

    @property
    def least(self) -> float:
        """Lower end of what it can hold; minus infinity for a normal one."""
        if self.uniform is not None:
            return self.uniform[0]
        if self.normal is not None:
            return -math.inf
        return 0.0 if self.fixed is None else self.fixed

    def quantiles(self, u: Array, *, above_zero: bool = False) -> Array:
        """Values at probabilities u, each strictly between 0 and 1; of the shape of u.

        `above_zero`: whether a normal distribution is cut at zero.
        """
        from scipy.special import ndtr, ndtri

        if self.uniform is not None:
            return np.asarray(self.uniform[0] + (self.uniform[1] - self.uniform[0]) * u)
        if self.normal is not None:
            mean, sd = self.normal
            below = float(ndtr(-mean / sd)) if above_zero else 0.0
            values = mean + sd * ndtri(below + (1.0 - below) * u)
            return np.asarray(np.maximum(values, 0.0) if above_zero else values)
        if self.rayleigh is not None:
            return np.asarray(self.rayleigh * np.sqrt(-2.0 * np.log1p(-u)))
        if self.weibull is not None:
            scale, shape = self.weibull
            return np.asarray(scale * (-np.log1p(-u)) ** (1.0 / shape))
        assert self.fixed is not None
        return np.full(np.shape(u), self.fixed)


def _short(entry: Any) -> Any:
    if isinstance(entry, bool | str):
        raise ValueError(
            "expected a number, [from, to], or one of uniform, normal, rayleigh, weibull; found"
            f" {str(entry).lower() if isinstance(entry, bool) else repr(entry)}"
        )
    if isinstance(entry, int | float):
        return {"fixed": entry}
    return {"uniform": entry} if isinstance(entry, list | tuple) else entry


def _not_below_zero(table: DistributionTable) -> DistributionTable:
    if table.normal is not None and table.normal[0] < 0.0:
        raise ValueError(f"expected a mean from 0 on, found {table.normal[0]:g}")
    if table.normal is None and table.least < 0.0:
        raise ValueError(f"expected values from 0 on, found {table.least:g}")
    return table


def _direction(entry: Any) -> Any:
    if isinstance(entry, str):
        if entry != "any":
            raise ValueError(f'expected degrees, [from, to] or "any", found {entry!r}')
        return {"uniform": (0.0, 360.0)}
    return _short(entry)


def _turn(entry: Any) -> Any:
    """A number is the standard deviation of a turn away from where it should point."""
    if isinstance(entry, str):
        if entry != "any":
            raise ValueError(f'expected a standard deviation in degrees or "any", found {entry!r}')
        return {"uniform": (-180.0, 180.0)}
    if isinstance(entry, int | float) and not isinstance(entry, bool):
        if entry < 0:
            raise ValueError(f"expected a standard deviation from 0 on, found {entry:g}")
        return {"normal": (0.0, entry)} if entry else {"fixed": 0.0}
    return _short(entry)


def _an_angle(table: DistributionTable) -> DistributionTable:
    if table.rayleigh is not None or table.weibull is not None:
        raise ValueError("an angle is a number, uniform or normal, in degrees")
    return table


Distribution = Annotated[DistributionTable, BeforeValidator(_short)]
PositiveDistribution = Annotated[DistributionTable, BeforeValidator(_short), AfterValidator(_not_below_zero)]
Direction = Annotated[DistributionTable, BeforeValidator(_direction), AfterValidator(_an_angle)]
Turn = Annotated[DistributionTable, BeforeValidator(_turn), AfterValidator(_an_angle)]
Probability = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=1)]
Share = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, lt=1)]
Between = tuple[NotNegative, NotNegative]


def _as_list(entry: Any) -> Any:
    return [entry] if isinstance(entry, str | Mapping) else entry


def _short_mission(entry: Any) -> Any:
    return {"file": entry} if isinstance(entry, str) else entry


def _coefficients(entry: Any) -> Any:
    expected = 'expected "covariance", "nominal" or a table of percent, { "*_uu" = 10.0 }'
    if isinstance(entry, str) and entry not in ("covariance", "nominal"):
        raise ValueError(f"{expected}, found {entry!r}{nearest(entry, ('covariance', 'nominal'))}")
    if not isinstance(entry, str | Mapping):
        raise ValueError(f"{expected}, found {entry!r}")
    for name, percent in {} if isinstance(entry, str) else entry.items():
        number = isinstance(percent, int | float) and not isinstance(percent, bool)
        if not number or not 0.0 < percent < 100.0:
            raise ValueError(f"{name!r}: expected percent above 0 and below 100, found {percent!r}")
    return entry


def _short_seabed(entry: Any) -> Any:
    return {"depth_m": entry} if isinstance(entry, int | float) else entry


def _in_order(between: Between | None) -> None:
    if between is not None and between[0] > between[1]:
        raise ValueError(
            f"between_s holds [from, to] with from <= to, found [{between[0]:g}, {between[1]:g}]"
        )


class MissionTable(Section):
    """A mission that is flown, and its weight among the missions."""

    file: Name
    """Mission file."""
    name: str = ""
    """What to call it."""
    weight: Positive = 1.0
    """How often it is flown beside the others."""

    @property
    def title(self) -> str:
        """Its name, by default that of the file without its ending."""
        return self.name or PurePath(self.file).stem


class Current(Section):
    """Water that moves: steady, towards a direction in degrees from north over east, and turbulent about it.

    By default the speed is uniform from zero to a quarter of the slowest speed of the missions, and the
    turbulence a tenth of the speed. ``vertical_m_s`` and ``turbulence_m_s`` are standard deviations,
    ``walk_m_s`` that of a random walk of the mean after an hour.
    """

    speed_m_s: PositiveDistribution | None = None
    """Mean speed of the water, m/s; by default uniform from 0 to a quarter of the slowest speed of the
    missions."""
    direction_deg: Direction = DistributionTable(uniform=(0.0, 360.0))
    """Where it goes, degrees from north over east."""
    vertical_m_s: NotNegative = 0.0
    """Standard deviation of the mean velocity down, m/s."""
    turbulence_m_s: PositiveDistribution | None = None
    """Standard deviation about the mean, north and east; 0.55 of it down, m/s; by default a tenth of the
    speed."""
    turbulence_times_s: tuple[Positive, Positive] = (60.0, 2.0)
    """Its correlation time, and the time in which eddies average out along the hull, s."""
    walk_m_s: NotNegative = 0.0
    """Standard deviation, after an hour, of a random walk of the mean north and east, m/s."""


class Waves(Section):
    """The sea: heights and periods that are drawn, where the waves go, degrees from north over east.

    By default the period goes with the height, 4.3 s for the root of a metre.
    """

    height_m: PositiveDistribution
    """Significant wave height, m."""
    period_s: PositiveDistribution | None = None
    """Peak period, s; made longer where a sea of this height would break; by default 4.3 s for the root
    of a metre."""
    toward_deg: Direction = DistributionTable(uniform=(0.0, 360.0))
    """Where the waves go, degrees from north over east."""
    spreading_deg: NotNegative = 0.0
    """Standard deviation of the directions in one sea, degrees."""
    peakedness: Positive = 3.3
    """γ of the spectrum."""


class FaultTable(Section):
    """An actuator that fails in some missions: one that is named, one of a group, or any.

    Without a command a stuck one stays where it is.
    """

    actuator: Name = "any"
    """Name of an actuator, of a group of which one fails, or any."""
    kind: Literal["dead", "stuck"] = "dead"
    """Gives nothing any more, or stays."""
    command: Number | None = None
    """Where a stuck one stays, in the unit of its command; by default where it is."""
    probability: Probability
    """Share of the missions."""
    between_s: Between | None = None
    """When it begins, s; by default the planned time."""

    @model_validator(mode="after")
    def _consistent(self) -> FaultTable:
        _in_order(self.between_s)
        if self.command is not None and self.kind == "dead":
            raise ValueError('command is where a stuck actuator stays; add kind = "stuck" or leave it out')
        return self


class OutageTable(Section):
    """A group of channels, or the sensor that measures them, silent for a while in some missions."""

    sensor: Name
    """``position``, ``depth``, ``attitude``, ``velocity``, ``rates``, ``altitude``, ``water``, or a kind
    of sensor."""
    probability: Probability
    """Share of the missions."""
    duration_s: PositiveDistribution
    """How long it is silent, s."""
    between_s: Between | None = None
    """When it begins, s; by default the planned time."""

    @model_validator(mode="after")
    def _consistent(self) -> OutageTable:
        _in_order(self.between_s)
        return self


class Start(Section):
    """How far the start lies from that of the mission: standard deviations, and the speed through the water.

    ``position_m`` is that of north and of east; a heading of "any" points anywhere.
    """

    position_m: NotNegative = 1.0
    """North and east, each, m."""
    depth_m: NotNegative = 0.2
    """Depth, m."""
    heading_deg: Turn = DistributionTable(normal=(0.0, 10.0))
    """Turned away from the mission's heading, degrees; a number is a standard deviation."""
    speed_m_s: PositiveDistribution | None = None
    """Speed ahead through the water, m/s; by default drifts with the water."""


class Seabed(Section):
    """A plane bottom: its depth below the origin, and by how much it deepens per metre."""

    depth_m: Number
    """Below the origin, m."""
    slope_north: Number = 0.0
    """By how much it deepens per metre to the north."""
    slope_east: Number = 0.0
    """The same to the east."""


class Obstacle(Section):
    """A round thing in the water; ``from_mission``: what the mission states, which is there anyway."""

    north_m: Number | None = None
    """Axis of a cylinder from surface to bottom, m."""
    east_m: Number | None = None
    """East of the origin, m."""
    radius_m: NotNegative | None = None
    """Radius, m."""
    from_mission: bool = False
    """Stands alone: the obstacles that the mission states."""

    @model_validator(mode="after")
    def _either(self) -> Obstacle:
        given = [key for key in ("north_m", "east_m", "radius_m") if getattr(self, key) is not None]
        if self.from_mission and given:
            raise ValueError(f"from_mission = true stands alone, found {given[0]} beside it; leave one out")
        if not self.from_mission and len(given) < 3:
            raise ValueError(
                "expected north_m, east_m and radius_m, or from_mission = true; found "
                + (" and ".join(given) or "none")
            )
        return self


class RequirementTable(Section):
    """What must hold in at least a share of all missions."""

    name: Name
    """What to call it."""
    holds: Name
    """Expression over the figures of a mission."""
    probability: Share = 0.95
    """At least this share of the missions must hold it; ``st.Requirement`` in Python asks for 0.99."""


Triple = tuple[Number, Number, Number]


class CaseFault(Section):
    """An actuator of a regression case that fails at a time; without a command it stays where it is."""

    actuator: Name
    """Name of an actuator, of a group of which one fails, or any."""
    at_s: NotNegative
    """From when on, s."""
    command: Number | None = None
    """Where a stuck one stays, in the unit of its command; by default where it is."""


class CaseOutage(Section):
    """A time without samples of a group of sensors in a regression case."""

    sensor: Name
    """``position``, ``depth``, ``attitude``, ``velocity``, ``rates``, ``altitude``, ``water``, or a kind
    of sensor."""
    from_s: NotNegative
    """From when, s."""
    until_s: Positive
    """Until when, s."""


class CaseTable(Section):
    """A mission that is flown as it is written here, and must hold: a failure that was found and mended.

    ``requirements`` names those that it must hold, all when empty. What is not given has its mean: still
    water, the mission's start at rest in the water, the identified vehicle, sensors without offset.
    ``sensor_offsets`` are in standard deviations, by channel; ``velocity`` is over ground in the body frame,
    m/s and rad/s; ``waves`` height, m, peak period, s, direction, spreading, deg, and peakedness.
    """

    name: Name
    """What to call it."""
    mission: Name | None = None
    """Name of the mission; by default the first."""
    requirements: tuple[Name, ...] = ()
    """Names of those that must hold."""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**53)] = 0
    """Of noise and gusts."""
    current_m_s: Triple = (0.0, 0.0, 0.0)
    """Its mean, north, east, down, m/s."""
    turbulence_m_s: Triple = (0.0, 0.0, 0.0)
    """Standard deviation about it, m/s."""
    waves: tuple[Number, Number, Number, Number, Number] | None = None
    """Height, peak period, direction, spreading, peakedness, m, s, deg, deg."""
    position_m: Triple | None = None
    """North, east, down, m; by default the mission's start."""
    attitude_deg: Triple | None = None
    """Roll, pitch, yaw, deg; by default level, along the mission."""
    velocity: tuple[Number, Number, Number, Number, Number, Number] | None = None
    """Over ground in the body frame, six numbers, m/s, rad/s; by default at rest in the water."""
    coefficients: dict[str, Number] = Field(default_factory=dict)
    """By name, SI."""
    sensor_offsets: dict[str, Number] = Field(default_factory=dict)
    """By channel: ``x``, ``y``, ``z``, ``roll``, ``pitch``, ``yaw``, ``u``, ``v``, ``w``, ``p``, ``q``,
    ``r``, ``altitude``, ``u_water``, ``v_water``, ``w_water``, standard deviations."""
    faults: Annotated[tuple[CaseFault, ...], BeforeValidator(_as_list)] = ()
    """Actuators that fail."""
    outages: Annotated[tuple[CaseOutage, ...], BeforeValidator(_as_list)] = ()
    """Sensors that fall silent."""


class VerificationTable(Section):
    """The whole table.

    ``coefficients`` is "covariance" (that of the identification), "nominal", or a table of further standard
    deviations in percent, ``{ "*_uu" = 10.0 }``.
    """

    missions: Annotated[
        tuple[Annotated[MissionTable, BeforeValidator(_short_mission)], ...],
        BeforeValidator(_as_list),
        Field(min_length=1),
    ]
    """What is flown."""
    runs: Count = 1000
    """Number of missions in all."""
    sensors: Name = "typical"
    """``"typical"``, ``"perfect"`` or a file of sensors."""
    navigation: Literal["sensors", "filter"] = "sensors"
    """What the autopilot goes by: sensors, or the estimate of a navigation filter on the identified
    vehicle."""
    confidence: Share = 0.95
    """Of the verdicts and intervals."""
    keep_worst: Annotated[int, Field(strict=True, ge=0)] = 5
    """Worst missions listed per requirement, to be flown again by number."""
    coefficients: Annotated[str | dict[str, float], BeforeValidator(_coefficients)] = "covariance"
    """Drawn from the identified covariance, not drawn, or ``{ "X_uu" = 10.0 }``: further standard
    deviations in per cent; ``*`` stands for any letters."""
    current: Current = Current()
    """Steady and turbulent water."""
    waves: Waves | None = None
    """The sea."""
    faults: Annotated[tuple[FaultTable, ...], BeforeValidator(_as_list)] = ()
    """Actuators that fail."""
    outages: Annotated[tuple[OutageTable, ...], BeforeValidator(_as_list)] = ()
    """Sensors that fall silent."""
    start: Start = Start()
    """Scatter of the start."""
    seabed: Annotated[Seabed | None, BeforeValidator(_short_seabed)] = None
    """Depth of the bottom, m."""
    obstacles: Annotated[tuple[Obstacle, ...], BeforeValidator(_as_list)] = (Obstacle(from_mission=True),)
    """What must not be touched."""
    voltage_v: Positive | None = None
    """Supply, V; by default required where thrust depends on it."""
    max_time_s: Positive | None = None
    """Longest flight, s; by default three times the planned time and five minutes."""
    requirements: Annotated[tuple[RequirementTable, ...], BeforeValidator(_as_list)] = ()
    """What must hold."""
    cases: Annotated[tuple[CaseTable, ...], BeforeValidator(_as_list)] = ()
    """Regression cases, flown as they stand."""

    @property
    def plane(self) -> tuple[float, float, float] | None:
        """The bottom as `Water` takes it: depth, m, and slopes north and east; None without one."""
        bottom = self.seabed
        return None if bottom is None else (bottom.depth_m, bottom.slope_north, bottom.slope_east)

    @model_validator(mode="after")
    def _names_once(self) -> VerificationTable:
        for what, given in (
            ("missions", [mission.title for mission in self.missions]),
            ("requirements", [requirement.name for requirement in self.requirements]),
            ("cases", [case.name for case in self.cases]),
        ):
            if (name := twice(given)) is not None:
                raise ValueError(f"{what}: the name {name!r} stands twice; give each its own name")
        return self


def parse_verification(text: str, source: str) -> VerificationTable:
    """Table ``[verification]`` of a TOML text that holds it.

    `source`: what to call it in messages. Raises CampaignError: not TOML, no such table, an unknown key, a
    missing key or a value that a key may not hold.
    """

    class File(Section):
        verification: VerificationTable

    return checked(
        File, {k: v for k, v in tables(text, source).items() if k == "verification"}, source
    ).verification
