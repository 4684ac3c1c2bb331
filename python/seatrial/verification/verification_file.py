"""The table ``[verification]`` of a campaign: what a tuned autopilot has to stand, and what it must hold.

These models are the only owner of its keys; unknown ones are refused with the nearest known name. Every key
but ``missions`` has a default that suits every vehicle; where one depends on vehicle or mission it is None
here and chosen in `seatrial.verification.draws`.

Tests: ``tests/test_verification_file.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from seatrial.errors import nearest
from seatrial.toml_file import Count, Name, NotNegative, Number, Positive, Section, checked, tables
from seatrial.verification.distribution_table import Direction, DistributionTable, PositiveDistribution, Turn

__all__ = [
    "Current",
    "FaultTable",
    "MissionTable",
    "Obstacle",
    "OutageTable",
    "RequirementTable",
    "Seabed",
    "Start",
    "VerificationTable",
    "parse_verification",
]

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
    """A mission that is flown, and how often beside the others."""

    file: Name
    name: str = ""
    weight: Positive = 1.0

    @property
    def title(self) -> str:
        """Its name, by default that of the file without its ending."""
        return self.name or PurePath(self.file).stem


class Current(Section):
    """Water that moves: steady, towards a direction in degrees from north over east, and turbulent about it.

    By default the speed is uniform from zero to a quarter of the slowest speed of the missions, and the
    turbulence a tenth of the speed. ``vertical_m_s`` and ``turbulence_m_s`` are standard deviations.
    """

    speed_m_s: PositiveDistribution | None = None
    direction_deg: Direction = DistributionTable(uniform=(0.0, 360.0))
    vertical_m_s: NotNegative = 0.0
    turbulence_m_s: PositiveDistribution | None = None
    turbulence_times_s: tuple[Positive, Positive] = (60.0, 2.0)


class FaultTable(Section):
    """An actuator that fails in some missions: one that is named, one of a group, or any.

    Without a command a stuck one stays where it is.
    """

    actuator: Name = "any"
    kind: Literal["dead", "stuck"] = "dead"
    command: Number | None = None
    probability: Probability
    between_s: Between | None = None

    @model_validator(mode="after")
    def _consistent(self) -> FaultTable:
        _in_order(self.between_s)
        if self.command is not None and self.kind == "dead":
            raise ValueError('command is where a stuck actuator stays; add kind = "stuck" or leave it out')
        return self


class OutageTable(Section):
    """A group of channels, or the sensor that tells them, silent for a while in some missions."""

    sensor: Name
    probability: Probability
    duration_s: PositiveDistribution
    between_s: Between | None = None

    @model_validator(mode="after")
    def _consistent(self) -> OutageTable:
        _in_order(self.between_s)
        return self


class Start(Section):
    """How far the start lies from that of the mission: standard deviations, and the speed through the water.

    ``position_m`` is that of north and of east; a heading of "any" points anywhere.
    """

    position_m: NotNegative = 1.0
    depth_m: NotNegative = 0.2
    heading_deg: Turn = DistributionTable(normal=(0.0, 10.0))
    speed_m_s: PositiveDistribution | None = None


class Seabed(Section):
    """A plane bottom: its depth below the origin, and by how much it deepens per metre."""

    depth_m: Number
    slope_north: Number = 0.0
    slope_east: Number = 0.0


class Obstacle(Section):
    """A round thing in the water, or with ``from_mission`` the farms that the mission goes about."""

    north_m: Number | None = None
    east_m: Number | None = None
    radius_m: NotNegative | None = None
    from_mission: bool = False

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
    holds: Name
    probability: Share = 0.95


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
    runs: Count = 1000
    sensors: Name = "typical"
    confidence: Share = 0.95
    keep_worst: Annotated[int, Field(strict=True, ge=0)] = 5
    coefficients: Annotated[str | dict[str, float], BeforeValidator(_coefficients)] = "covariance"
    current: Current = Current()
    faults: Annotated[tuple[FaultTable, ...], BeforeValidator(_as_list)] = ()
    outages: Annotated[tuple[OutageTable, ...], BeforeValidator(_as_list)] = ()
    start: Start = Start()
    seabed: Annotated[Seabed | None, BeforeValidator(_short_seabed)] = None
    obstacles: Annotated[tuple[Obstacle, ...], BeforeValidator(_as_list)] = (Obstacle(from_mission=True),)
    voltage_v: Positive | None = None
    max_time_s: Positive | None = None
    requirements: Annotated[tuple[RequirementTable, ...], BeforeValidator(_as_list)] = ()

    @model_validator(mode="after")
    def _names_once(self) -> VerificationTable:
        for what, given in (
            ("missions", [one.title for one in self.missions]),
            ("requirements", [one.name for one in self.requirements]),
        ):
            for name in given:
                if given.count(name) > 1:
                    raise ValueError(f"{what}: the name {name!r} stands twice; give each its own name")
        return self


def parse_verification(text: str, source: str) -> VerificationTable:
    r"""Table ``[verification]`` of a TOML text that holds it.

    Parameters
    ----------
    text : str
    source : str
        What to call it in messages.

    Raises
    ------
    CampaignError
        Not TOML, no such table, an unknown key, a missing key or a value that a key may not hold.

    Examples
    --------
    >>> table = parse_verification('[verification]\nmissions = ["farm.toml"]', "campaign.toml")
    >>> table.runs, table.missions[0].title
    (1000, 'farm')
    """

    class File(Section):
        verification: VerificationTable

    return checked(
        File, {k: v for k, v in tables(text, source).items() if k == "verification"}, source
    ).verification
