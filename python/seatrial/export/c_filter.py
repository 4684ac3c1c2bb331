"""The navigation filter as C99: which filter it is, and its program.

The core writes it (``crates/seatrial/src/export/filter.rs``). Tests: ``tests/export/test_c_filter.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial._core import Vehicle, filter_c
from seatrial.base.errors import SimulationError
from seatrial.export.names import commented
from seatrial.flight.mission import Mission, Route
from seatrial.flight.navigation import NavigationFilter, checked_navigation, filter_of
from seatrial.flight.sensor_channels import sensors_of

if TYPE_CHECKING:
    from seatrial.sensors.sensor import Sensor

_PERIOD_S = 0.1
"""Period of a filter without autopilot that was not made by hand, s: that of `NavigationFilter`."""


def recorded_filter(
    prefix: str,
    model: Vehicle,
    *,
    autopilot: tuple[str, list[str]] | None,
    period_s: float | None,
    mission: Mission | None,
    navigation: str | NavigationFilter,
    sensors: Mapping[str, Sensor] | str | Path | None,
    voltage_v: float,
    origin: Sequence[str],
) -> tuple[dict[str, Any], float] | None:
    """Program of a navigation filter and its period, s; None where none is asked for.

    Parameters
    ----------
    prefix
        Of all of its public names.
    model
        The vehicle that it believes in, unless it was made by hand.
    autopilot, period_s
        Prefix and inputs of the program of the autopilot that takes the estimate, and its period, s.
    mission
        Its mission, whose landmarks and start the filter knows.
    navigation, sensors
        As of `export_c`.
    voltage_v
        Supply; not a number where it does not matter.
    origin
        Lines for the head of the files.

    Raises
    ------
    SimulationError
        The filter cannot be exported, or sensors are named for none.
    """
    asked = checked_navigation(navigation)
    if sensors is not None and asked != "filter":
        raise SimulationError(
            "sensors: they are those of a navigation filter; expected navigation"
            f' = "filter" beside them, found {navigation!r}'
        )
    if period_s is None:
        period_s = asked.period_s if isinstance(asked, NavigationFilter) else _PERIOD_S
    filter = filter_of(
        asked,
        model,
        sensors_of(sensors, model),
        period_s,
        landmarks=() if mission is None else mission.landmarks,
    )
    if filter is None:
        return None
    # A filter that was made by hand has its own start.
    start: dict[str, Any] = {}
    if mission is not None and not isinstance(asked, NavigationFilter):
        start["start"] = Route.of(mission).start
    about = [f"Navigation filter of {commented(filter.vehicle.name)}: one period of {period_s:g} s.", *origin]
    facts = filter_c(
        filter.core, prefix, about, period_s=period_s, autopilot=autopilot, voltage_v=voltage_v, **start
    )
    return facts, period_s
