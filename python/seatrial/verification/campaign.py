"""What a campaign asks of a verification, checked before anything flies.

The checks are those of a flight (`seatrial.flight.checks`); here each is asked by itself, so that its message
begins with the campaign's file and key. Tests: ``tests/verification/test_verify.py``,
``tests/verification/test_verification_messages.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import Autopilot, Vehicle
from seatrial.base.errors import CampaignError, SeatrialError, SimulationError, nearest
from seatrial.base.file_names import no_file
from seatrial.base.toml_file import is_path, loaded, twice
from seatrial.campaign.verification_table import MissionTable, RequirementTable, VerificationTable
from seatrial.flight.checks import (
    checked_rows,
    checked_seabed,
    checked_seed,
    checked_supply,
    checked_times,
    checked_turbulence,
    longest,
    within,
)
from seatrial.flight.failures import Outage, outage_rows
from seatrial.flight.mission import Mission, Route
from seatrial.flight.sea import LIMITS
from seatrial.flight.sensor_channels import sensor_channels, sensors_of
from seatrial.identification.fitted import Fitted
from seatrial.sensors.sensor import TYPICAL
from seatrial.verification.failure_draws import targets
from seatrial.verification.judgement import check_energy
from seatrial.verification.missions import CampaignFlights
from seatrial.verification.regression import check_cases
from seatrial.verification.requirement import Requirement, default_requirements
from seatrial.verification.verification import WITHOUT_FILE

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.campaign.verification_table import Between, Current, DistributionTable, Waves

_PERFECT = "perfect"

_STRONGEST_M_S = 5.0  # turbulence, as of a single flight

_SELDOM = 0.99  # the part of its draws below which a distribution without an end must be possible


@contextmanager
def under(source: str, *keys: str, said: str = "") -> Iterator[None]:
    """Errors inside, their message begun with the file and the keys of its table ``[verification]``.

    Parameters
    ----------
    source : str
        The campaign file.
    *keys : str
        From the outside in.
    said : str
        How the message itself names what the keys name; it is left out.

    Examples
    --------
    >>> try:
    ...     with under("farm.toml", "current", "speed_m_s", said="current"):
    ...         raise SimulationError("current: expected less, found more")
    ... except SimulationError as error:
    ...     print(error)
    farm.toml: verification, current, key speed_m_s: expected less, found more
    """
    try:
        yield
    except SeatrialError as error:
        place = ", ".join(["verification", *keys[:-1], f"key {keys[-1]}"])
        raise type(error)(f"{source}: {place}: {str(error).removeprefix(f'{said}: ')}") from None


def sensors_of_table(campaign: Campaign, sensors: str) -> str | Path | None:
    """What the key ``sensors`` names: "typical", a path, or None for perfect ones.

    Raises
    ------
    SimulationError
        It names neither.
    CampaignError
        The path has a variable that is not set.
    """
    if sensors == _PERFECT:
        return None
    if is_path(sensors):
        return campaign.resolve(sensors, "verification.sensors")
    if sensors != TYPICAL:
        near = nearest(sensors, (TYPICAL, _PERFECT))
        raise SimulationError(
            f'{campaign.source}: verification, key sensors: expected "{TYPICAL}", "{_PERFECT}" or a file'
            f" such as sensors.toml, found {sensors!r}{near if near.startswith('; did') else ''}"
        )
    return sensors


def requirement_of(source: str, asked: RequirementTable) -> Requirement:
    """A requirement that the campaign file states, on metrics that there are.

    Raises
    ------
    CampaignError
        Its expression cannot be read; with file and key.
    """
    from seatrial.verification.requirement import Requirement

    said = f'requirement "{asked.name}": holds'
    with under(source, f"requirements {asked.name!r}", "holds", said=said):
        return Requirement(asked.name, asked.holds, asked.probability)


def check_table(source: str, flights: CampaignFlights) -> tuple[str, ...]:
    """Sentences on keys that do nothing, after everything that vehicle and missions refuse was refused.

    Parameters
    ----------
    source : str
        The campaign file.
    flights : CampaignFlights
        What flies.

    Raises
    ------
    SimulationError, TrialError, CampaignError, VehicleError
        With file and key.
    """
    table, vehicle = flights.table, flights.fitted.vehicle
    routes = [Route.of(mission) for mission in flights.missions]
    notes = _check_supply(source, flights)
    with under(source, "sensors", said="sensors"):
        sensor_channels(sensors_of(flights.sensors, vehicle), flights.autopilot.period_s)
    with under(source, "max_time_s", said="max_time_s"):
        ends = [longest(route, flights.autopilot, table.max_time_s, logs=False) for route in routes]
    bottom = table.seabed
    for route in routes:
        with under(source, "seabed", said="seabed"):
            checked_seabed(
                None if bottom is None else (bottom.depth_m, bottom.slope_north, bottom.slope_east), route
            )
    _check_water(source, table.current)
    if table.waves is not None:
        _check_waves(source, table.waves)
    for entry, keys in zip(table.faults, _keys("faults", table.faults), strict=True):
        with under(source, keys, said="faults"):
            targets(entry, vehicle)
        with under(source, keys, "between_s"):
            _begins_in_flight(entry.between_s, max(ends))
    for outage, keys in zip(table.outages, _keys("outages", table.outages), strict=True):
        with under(source, keys, said="outages"):
            outage_rows([Outage(outage.sensor, 0.0)], max(ends))
        with under(source, keys, "between_s"):
            _begins_in_flight(outage.between_s, max(ends))
    if not isinstance(table.coefficients, str):
        with under(source, "coefficients", said="standard deviations"):
            Fitted.of(flights.fitted, percent=table.coefficients)
    return notes


def _check_supply(source: str, flights: CampaignFlights) -> tuple[str, ...]:
    given, vehicle = flights.table.voltage_v, flights.fitted.vehicle
    needed = [name for name, facts in vehicle.actuator_info().items() if facts["needs_voltage"]]
    if needed and given is None:
        raise SimulationError(
            f"{source}: verification, key voltage_v: the thrust of {vehicle.name} ({needed[0]}) depends on"
            " the supply voltage; add this key under [verification], in V"
        )
    with under(source, "voltage_v", said="voltage_v"):
        checked_supply(given, vehicle)
    if given is None or needed:
        return ()
    return (
        f"voltage_v = {given:g} under [verification] does nothing: no thrust of {vehicle.name} depends on"
        " the supply voltage.",
    )


def _check_water(source: str, current: Current) -> None:
    def fastest(asked: DistributionTable) -> float:
        at = 1.0 if asked.uniform is not None else _SELDOM
        return float(asked.quantiles(np.array(at), above_zero=True))

    if current.speed_m_s is not None:
        with under(source, "current", "speed_m_s", said="current"):
            checked_rows("current", [fastest(current.speed_m_s), 0.0, 0.0])
    with under(source, "current", "vertical_m_s", said="current"):
        checked_rows("current", [0.0, 0.0, current.vertical_m_s])
    if current.turbulence_m_s is not None:
        with under(source, "current", "turbulence_m_s", said="turbulence"):
            within("turbulence", fastest(current.turbulence_m_s), (0.0, _STRONGEST_M_S), "m/s")
    with under(source, "current", "turbulence_times_s", said="turbulence_times_s"):
        checked_times(current.turbulence_times_s)
    with under(source, "current", "walk_m_s", said="current_walk"):
        checked_turbulence(current.walk_m_s, "current_walk")


def _check_waves(source: str, waves: Waves) -> None:
    for key, asked in (("height_m", waves.height_m), ("period_s", waves.period_s)):
        if asked is None:
            continue
        least, most, unit = LIMITS[key]
        ends = (0.0, 1.0) if asked.uniform is not None else (1.0 - _SELDOM, _SELDOM)
        with under(source, "waves", key, said=key):
            for end in asked.quantiles(np.array(ends), above_zero=True):
                within(key, float(end), (least, most), unit)
    for key in ("spreading_deg", "peakedness"):
        least, most, unit = LIMITS[key]
        with under(source, "waves", key, said=key):
            within(key, getattr(waves, key), (least, most), unit)


def _begins_in_flight(between: Between | None, end_s: float) -> None:
    if between is not None and between[0] > end_s:
        raise SimulationError(
            f"expected a beginning within the longest flight, 0 to {end_s:.0f} s, found"
            f" {between[0]:g} s; the failure would never occur"
        )


def _keys(name: str, entries: Sequence[object]) -> list[str]:
    """The key of each entry; which one it is, where there are several."""
    return [name] if len(entries) == 1 else [f"{name}[{k + 1}]" for k in range(len(entries))]


_AUTOPILOT_FILE = "autopilot.toml"

_VERIFIED, _START = "verified", "start"


@dataclass(frozen=True, eq=False)
class VerifiedCampaign:
    """A verification that is ready to fly.

    Attributes
    ----------
    campaign
        What was asked for.
    flights
        What flies.
    requirements
        What must hold.
    others
        Autopilots to compare with, by name.
    runs
        Number of missions.
    notes
        Sentences on what is assumed.
    """

    campaign: Campaign
    flights: CampaignFlights
    requirements: tuple[Requirement, ...]
    others: dict[str, Autopilot]
    runs: int
    notes: tuple[str, ...]


def verified_campaign(
    campaign: Campaign,
    fit: Any = None,
    gains: Any = None,
    *,
    model: Any = None,
    runs: int | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    compare: bool | Mapping[str, Any] = False,
    navigation: str | None = None,
) -> VerifiedCampaign:
    """A verification that is ready to fly. See `seatrial.verify` for the parameters.

    Raises
    ------
    CampaignError, SimulationError, TrialError, VehicleError
        Something in it cannot be used.
    """
    table, flown = _table(campaign, missions)
    if navigation is not None:
        if navigation not in ("sensors", "filter"):
            raise SimulationError(f'navigation: expected "sensors" or "filter", found {navigation!r}')
        table = table.model_copy(update={"navigation": navigation})
    number = table.runs if runs is None else _positive(runs)
    autopilot = campaign.autopilot if gains is None else autopilot_of(gains)
    others = _others(campaign, gains, compare)
    fitted = Fitted.of(campaign.vehicle if fit is None else fit)
    if list(fitted.vehicle.actuators) != list(campaign.vehicle.actuators):
        raise CampaignError(
            f"{campaign.source}: expected a fit of {campaign.vehicle.name}, found one of"
            f" {fitted.vehicle.name} with other actuators; give the run directory of this campaign"
        )
    environment = campaign.file.environment
    flights = CampaignFlights(
        table=table.model_copy(update={"runs": number}),
        fitted=fitted,
        autopilot=autopilot,
        missions=flown,
        seed=campaign.seed,
        model=None if model is None else loaded(Vehicle, model, "model"),
        sensors=sensors_of_table(campaign, table.sensors),
        rho=environment.rho_kg_m3,
        g=environment.g_m_s2,
    )
    ignored = check_table(campaign.source, flights)
    requirements, notes = _requirements(campaign, flights)
    notes.extend(ignored)
    if table.navigation == "filter":
        notes.append(
            "The autopilot goes by the estimate of a navigation filter on the vehicle that it believes in;"
            " the filter assumes the mid-range of the drawn gusts and seas."
        )
    if table.coefficients == "covariance" and not flights.fitted.names:
        notes.append("Every vehicle flies with the same coefficients, because their covariance is unknown.")
    flights.check()
    check_cases(table.cases, flights, requirements, str(campaign.source))
    for other in others.values():
        flights.with_autopilot(other).check()
    return VerifiedCampaign(campaign, flights, requirements, others, number, tuple(notes))


def campaign_of(
    vehicle: Vehicle,
    missions: Sequence[Mission | str | Path],
    *,
    requirements: Sequence[Requirement],
    seed: int,
    settings: Mapping[str, Any],
    name: str | None = None,
) -> Campaign:
    """Campaign of a verification that no file describes; its text states what a file would.

    Parameters
    ----------
    vehicle : Vehicle
    missions : sequence of Mission, str or Path
    requirements : sequence of Requirement
    seed : int
    settings : mapping
        Other keys of the table ``[verification]``.
    name : str, optional
        That of the vehicle by default.

    Raises
    ------
    CampaignError
        A key is unknown, or a value is not one that it may hold.
    """
    import tomlkit

    from seatrial.campaign.campaign import Campaign

    for key in ("missions", "requirements"):
        if key in settings:
            raise CampaignError(f"settings: key {key} is a parameter of its own; leave it out here")
    titles = [Path(one).stem if isinstance(one, str | Path) else one.name for one in _listed(missions)]
    table = {
        "missions": titles,
        **settings,
        "requirements": [
            {"name": one.name, "holds": one.holds, "probability": one.probability} for one in requirements
        ],
    }
    asked = {"format": 1, "name": name or vehicle.name, "vehicle": vehicle.name, "seed": checked_seed(seed)}
    text = tomlkit.dumps({**asked, "verification": table})
    return Campaign.from_toml(text, source=WITHOUT_FILE, vehicle=vehicle)


def _listed(missions: Any) -> Sequence[Mission | str | Path]:
    if isinstance(missions, str | Path | Mission) or not missions:
        raise CampaignError(f"missions: expected a list of missions or files, found {missions!r}")
    return list(missions)


def autopilot_of(source: Any) -> Autopilot:
    """Autopilot of a tuning, a run directory of it, a file, a built-in name, or itself.

    Raises
    ------
    VehicleError, SimulationError
        It is none.
    """
    found = getattr(source, "autopilot", source)
    if isinstance(found, str | Path) and Path(found).is_dir():
        found = Path(found) / _AUTOPILOT_FILE
        if not found.is_file():
            raise SimulationError(
                f"{found.parent}: expected a run directory of `seatrial tune` with {_AUTOPILOT_FILE}, found"
                " none there; give the folder that it printed, or an autopilot file"
            )
    autopilot: Autopilot = loaded(Autopilot, found)
    return autopilot


def _table(
    campaign: Campaign, missions: Sequence[Mission | str | Path] | None
) -> tuple[VerificationTable, tuple[Mission, ...]]:
    """The table with the missions that fly, and those."""
    table = campaign.file.verification
    if missions is None:
        if table is None:
            raise CampaignError(
                f"{campaign.source}: expected the table [verification], found none; add it with"
                ' missions = ["mission.toml"], or give missions'
            )
        return table, tuple(_mission(campaign, one.file) for one in table.missions)
    missions = _listed(missions)
    flown = tuple(Mission.load(one) if isinstance(one, str | Path) else one for one in missions)
    titles = [
        Path(one).stem if isinstance(one, str | Path) else loaded_one.name
        for one, loaded_one in zip(missions, flown, strict=True)
    ]
    if (title := twice(titles)) is not None:
        raise CampaignError(f"missions: two are called {title!r}; rename one of them")
    tables = tuple(MissionTable(file=title, name=title) for title in titles)
    if table is None:
        return VerificationTable(missions=tables), flown
    return table.model_copy(update={"missions": tables}), flown


def _mission(campaign: Campaign, file: str) -> Mission:
    path = campaign.resolve(file, "verification.missions")
    if wrong := no_file(path):
        raise CampaignError(f"{campaign.source}: verification, key missions: {wrong}; correct the path")
    return Mission.load(path)


def _requirements(campaign: Campaign, flights: CampaignFlights) -> tuple[tuple[Requirement, ...], list[str]]:
    """What must hold, every expression checked, and a sentence where nobody said what."""
    table = flights.table
    if table.requirements:
        return tuple(_stated(campaign, one, flights.fitted.vehicle) for one in table.requirements), []
    off = flights.position_sd_m
    asked = default_requirements(table, flights.missions, position_sd_m=off)
    listed = "; ".join(f"{one.name}: {one.holds}" for one in asked)
    allowed = (
        f" The path allows for a position that is off by {off:.2g} m (1 sd) on each axis." if off else ""
    )
    return asked, [
        f"The campaign states no requirements; these are judged, each in 95 % of the missions: {listed}."
        f"{allowed}"
    ]


def _stated(campaign: Campaign, asked: RequirementTable, vehicle: Vehicle) -> Requirement:
    requirement = requirement_of(campaign.source, asked)
    said = f'requirement "{asked.name}": holds'
    with under(campaign.source, f"requirements {asked.name!r}", "holds", said=said):
        requirement.check()
        check_energy(requirement, vehicle)
    return requirement


def _others(campaign: Campaign, gains: Any, compare: bool | Mapping[str, Any]) -> dict[str, Autopilot]:
    """Autopilots to compare with, by name."""
    if isinstance(compare, Mapping):
        if _VERIFIED in compare:
            raise CampaignError(f'compare: "{_VERIFIED}" is the autopilot that is verified; use another name')
        return {str(name): autopilot_of(source) for name, source in compare.items()}
    if not compare:
        return {}
    if gains is None:
        raise CampaignError(
            f"{campaign.source}: expected another autopilot than the campaign's own to compare with it, found"
            " none; give the tuned one as gains (--autopilot), or others by name"
        )
    return {_START: campaign.autopilot}


def _positive(runs: Any) -> int:
    if not isinstance(runs, int) or isinstance(runs, bool) or runs < 1:
        raise CampaignError(f"runs: expected a whole number of missions from 1 on, found {runs!r}")
    return runs
