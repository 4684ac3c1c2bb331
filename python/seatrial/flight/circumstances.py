"""`Circumstances`: what a closed-loop flight is exposed to, checked against vehicle, autopilot and mission.

Held by ``tests/flight/test_fly.py`` and ``test_bad_input_flights.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import Autopilot, State, Vehicle
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.toml_file import loaded
from seatrial.flight.checks import (
    FLIGHT_LIMITS,
    checked_obstacles,
    checked_seabed,
    checked_step,
    checked_supply,
    checked_times,
    longest,
    within,
)
from seatrial.flight.conditions import Conditions, Water
from seatrial.flight.failures import Fault, Outage
from seatrial.flight.mission import Mission, Route
from seatrial.flight.navigation import NavigationFilter, checked_navigation, filter_of
from seatrial.flight.sea import SeaState
from seatrial.flight.sensor_channels import SensorChannels, sensor_channels, sensors_of
from seatrial.sensors.sensor import KINDS

if TYPE_CHECKING:
    from seatrial.sensors.sensor import Sensor


@dataclass(frozen=True)
class Circumstances:
    """What a flight was exposed to.

    Attributes
    ----------
    current
        Mean, north, east, down, m/s.
    turbulence, turbulence_times_s
        Standard deviation of the current about its mean, m/s, and its two time constants, s.
    current_trend, current_walk
        Change of the mean in an hour, m/s, and the standard deviation of its random walk after an hour, m/s.
    waves
        The sea state; None: no waves.
    obstacles
        What stands in the water: north, east and radius of each cylinder, m.
    sensors
        Name of the set, and per kind its numbers; perfect ones without kinds.
    sensor_notes
        Where the sensors of the flight differ from those of the set.
    faults, outages
        What failed.
    seabed
        Depth of the bottom below the origin, m, and its slopes north and east; None: no bottom.
    seed
        Of the sensors' noise and of the water's motion.
    model
        The vehicle that the autopilot believes in.
    voltage_v
        Supply, V; None where it does not matter.
    feedback
        Whether the autopilot sees what its actuators do.
    navigation
        What it goes by: "sensors", or "filter", the estimate of a navigation filter.
    rho, g
        Density and gravity where they are not the vehicle file's.
    max_step_s, max_time_s
        Largest step of the integration and longest duration, s.
    start
        Where it began; None: at rest where the mission begins.
    dither
        What was added to the commands, by name; None: nothing.
    aboard
        The navigation filter; None without one. `own_filter`: made by the caller, not for this flight.
    sources
        Names or paths that were asked for, by "vehicle", "autopilot", "mission".
    """

    current: tuple[float, float, float]
    model: Vehicle
    max_step_s: float
    max_time_s: float
    turbulence: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turbulence_times_s: tuple[float, float] = FLIGHT_LIMITS.turbulence_times_s
    current_trend: tuple[float, float, float] = (0.0, 0.0, 0.0)
    current_walk: tuple[float, float, float] = (0.0, 0.0, 0.0)
    waves: SeaState | None = None
    obstacles: tuple[tuple[float, float, float], ...] = ()
    sensors: dict[str, Any] = field(default_factory=dict)
    sensor_notes: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    outages: tuple[Outage, ...] = ()
    seabed: tuple[float, float, float] | None = None
    seed: int = 0
    voltage_v: float | None = None
    feedback: bool = True
    navigation: str = "sensors"
    rho: float | None = None
    g: float | None = None
    sources: dict[str, str] = field(default_factory=dict)
    start: State | None = None
    dither: Mapping[str, Array] | None = None
    aboard: NavigationFilter | None = None
    own_filter: bool = False

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data: every input of the flight but the files; the models by their names."""
        return {
            "sources": dict(self.sources),
            "model": self.model.name,
            "current_m_s": list(self.current),
            "turbulence_m_s": list(self.turbulence),
            "turbulence_times_s": list(self.turbulence_times_s),
            "current_trend_m_s_per_h": list(self.current_trend),
            "current_walk_m_s_after_1_h": list(self.current_walk),
            "waves": None if self.waves is None else asdict(self.waves),
            "obstacles_m": [list(cylinder) for cylinder in self.obstacles],
            "sensors": self.sensors or "perfect",
            "sensor_notes": list(self.sensor_notes),
            "faults": [asdict(fault) for fault in self.faults],
            "outages": [asdict(outage) for outage in self.outages],
            "seabed": None if self.seabed is None else list(self.seabed),
            "seed": self.seed,
            "voltage_v": self.voltage_v,
            "feedback": self.feedback,
            "navigation": self.navigation,
            "filter": None if self.aboard is None else self.aboard.to_dict() | {"own": self.own_filter},
            "start": None if self.start is None else _placed(self.start),
            "dither": None if self.dither is None else {k: list(v) for k, v in self.dither.items()},
            "rho_kg_m3": self.rho,
            "g_m_s2": self.g,
            "max_step_s": self.max_step_s,
            "max_time_s": self.max_time_s,
        }


def circumstances_of(
    flown: tuple[Vehicle, Autopilot, Mission],
    route: Route,
    water: Water,
    conditions: Conditions,
    *,
    seed: int,
    varied: bool,
    logs: bool,
) -> tuple[Circumstances, SensorChannels]:
    """What all cases share, checked, and the sensors as the core takes them.

    A navigation filter takes its model for exact only where no case flies with other coefficients (`varied`).
    """
    vehicle, autopilot, mission = flown
    # In the order in which a person corrects them: time, supply, medium, feedback, navigation, sensors.
    until = longest(route, autopilot, conditions.max_time_s, logs=logs)
    checked_step(conditions.max_step_s, autopilot)
    checked_supply(conditions.voltage_v, vehicle)
    if water.rho is not None:
        within("rho", water.rho, (500.0, 2000.0), "kg/m3")
    if water.g is not None:
        within("g", water.g, (0.1, 100.0), "m/s2")
    if not isinstance(conditions.feedback, bool):
        raise SimulationError(f"feedback: expected True or False, found {conditions.feedback!r}")
    navigation = checked_navigation(conditions.navigation)
    fitted = sensors_of(conditions.sensors, vehicle)
    channels = sensor_channels(fitted, autopilot.period_s)
    unheard = _unheard(fitted, navigation, mission.landmarks)
    channels = replace(channels, sentences=channels.sentences + unheard)
    own = isinstance(navigation, NavigationFilter)
    around = Circumstances(
        current=_triple(water.current),
        turbulence=_triple(water.turbulence),
        turbulence_times_s=checked_times(water.turbulence_times_s),
        current_trend=_triple(water.current_trend),
        current_walk=_triple(water.current_walk),
        waves=cast("SeaState | None", water.waves),
        obstacles=checked_obstacles(water.obstacles),
        model=vehicle if conditions.model is None else _model(conditions.model, vehicle),
        max_step_s=conditions.max_step_s,
        max_time_s=until,
        sensors={} if fitted is None else {kind: _stated(sensor) for kind, sensor in fitted.items()},
        sensor_notes=channels.sentences,
        faults=cast("tuple[Fault, ...]", conditions.faults),
        outages=cast("tuple[Outage, ...]", conditions.outages),
        seabed=checked_seabed(water.seabed, route),
        seed=seed,
        start=cast("State | None", conditions.initial),
        dither=cast("Mapping[str, Array] | None", conditions.dither),
        voltage_v=conditions.voltage_v,
        feedback=conditions.feedback,
        navigation="filter" if own else str(navigation),
        rho=water.rho,
        g=water.g,
        own_filter=own,
    )
    aboard = filter_of(
        navigation,
        around.model,
        fitted,
        autopilot.period_s,
        landmarks=mission.landmarks,
        waves=around.waves,
        gusts=(around.turbulence, around.turbulence_times_s),
        exact=conditions.model is None and not varied,
    )
    return replace(around, aboard=aboard), channels


def _unheard(
    sensors: Mapping[str, Sensor] | None,
    navigation: str | NavigationFilter,
    landmarks: Sequence[Mapping[str, Any]],
) -> tuple[str, ...]:
    """Sentences on acoustic sensors that tell nothing in this flight."""
    notes = []
    for kind in sensors or {}:
        if not KINDS[kind].aboard:
            continue
        if navigation == "sensors":
            notes.append(f'{kind} is left out: only a navigation filter reads it (navigation = "filter").')
        elif kind != "usbl" and not landmarks:
            notes.append(f"{kind} sees nothing: the mission has no [[landmarks]].")
    if sensors and ("range" in sensors) != ("bearing" in sensors):
        surfaces = [str(mark["name"]) for mark in landmarks if mark["kind"] != "beacon"]
        if surfaces and navigation != "sensors":
            raise SimulationError(
                f"sensors: {surfaces[0]} is a wall or a net, of which a sonar gives a range along a bearing:"
                " expected sensors of both kinds, range and bearing, found one; add the other"
            )
    return tuple(notes)


def _model(source: Any, vehicle: Vehicle) -> Vehicle:
    """Vehicle that the autopilot believes in, with the actuators of the one that flies."""
    model: Vehicle = loaded(Vehicle, source, "model")
    here, there = vehicle.actuator_info(), model.actuator_info()
    if list(here) != list(there):
        raise SimulationError(
            f"model: expected the actuators of {vehicle.name}, {', '.join(here)}, found those of"
            f" {model.name}, {', '.join(there)}"
        )
    for name, facts in here.items():
        if facts["unit"] != there[name]["unit"]:
            raise SimulationError(
                f"model: {name}: expected commands in {facts['unit']} as {vehicle.name} takes them, found"
                f" {there[name]['unit']}"
            )
    return model


def _stated(sensor: Sensor) -> dict[str, Any]:
    """What a sensor's table says, in the units of its kind."""
    default = {field.name: field.default for field in fields(sensor)}
    return {name: value for name, value in asdict(sensor).items() if value != default[name]}


def _placed(state: State) -> dict[str, list[float]]:
    """A state as plain data: NED in m, quaternion, velocities in m/s and rad/s."""
    return {
        "position_m": state.position.tolist(),
        "attitude": state.attitude.tolist(),
        "velocities": state.nu.tolist(),
    }


def _triple(row: ArrayLike) -> tuple[float, float, float]:
    north, east, down = np.asarray(row, float).tolist()
    return north, east, down
