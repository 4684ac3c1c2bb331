"""What vehicle, autopilot and missions refuse of a table ``[verification]``, before anything flies.

The checks are those of a flight (`seatrial.flight.set_up`); here each is asked by itself, so that its message
begins with the campaign's file and key. Tests: ``tests/test_verification_messages.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.errors import SeatrialError, SimulationError, nearest
from seatrial.fitted import Fitted
from seatrial.flight.checked_numbers import checked_rows, checked_seabed, checked_supply, longest, within
from seatrial.flight.failures import Outage, outage_rows
from seatrial.flight.route import Route
from seatrial.flight.sensor_channels import sensor_channels, sensors_of
from seatrial.flight.surroundings import checked_times
from seatrial.sensors.sensor_file import TYPICAL
from seatrial.toml_file import is_path
from seatrial.verification.failure_draws import targets

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.verification.campaign_flights import CampaignFlights
    from seatrial.verification.distribution_table import DistributionTable
    from seatrial.verification.requirement import Requirement
    from seatrial.verification.verification_file import Between, Current, RequirementTable

__all__ = ["check_table", "requirement_of", "sensors_of_table", "under"]

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
        return campaign.beside(sensors, "verification.sensors")
    if sensors != TYPICAL:
        near = nearest(sensors, (TYPICAL, _PERFECT))
        raise SimulationError(
            f'{campaign.source}: verification, key sensors: expected "{TYPICAL}", "{_PERFECT}" or a file'
            f" such as sensors.toml, found {sensors!r}{near if near.startswith('; did') else ''}"
        )
    return sensors


def requirement_of(source: str, asked: RequirementTable) -> Requirement:
    """A requirement that the campaign file states, on figures that there are.

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
    with under(source, "max_time_s", said="max_time"):
        ends = [longest(route, flights.autopilot, table.max_time_s, logs=False) for route in routes]
    bottom = table.seabed
    for route in routes:
        with under(source, "seabed", said="seabed"):
            checked_seabed(
                None if bottom is None else (bottom.depth_m, bottom.slope_north, bottom.slope_east), route
            )
    _check_water(source, table.current)
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
    with under(source, "voltage_v", said="voltage"):
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
    with under(source, "current", "turbulence_times_s", said="turbulence_times"):
        checked_times(current.turbulence_times_s)


def _begins_in_flight(between: Between | None, end_s: float) -> None:
    if between is not None and between[0] > end_s:
        raise SimulationError(
            f"expected a beginning within the longest flight, 0 to {end_s:.0f} s, found"
            f" {between[0]:g} s; nothing would ever fail"
        )


def _keys(name: str, entries: Sequence[object]) -> list[str]:
    """The key of each entry; which one it is, where there are several."""
    return [name] if len(entries) == 1 else [f"{name}[{k + 1}]" for k in range(len(entries))]
