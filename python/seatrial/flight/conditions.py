"""`Water` and `Conditions`: what a closed-loop flight meets, and with what it meets it.

Plain values as a person gives them; `seatrial.flight.cases` checks them against vehicle, autopilot and
mission before anything flies. Held by ``tests/flight/test_fly.py`` and ``test_bad_input_flights.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import Autopilot, State, Vehicle
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.plain import Plain
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
from seatrial.flight.disturbances import Fault, Outage, SeaState
from seatrial.flight.mission import Mission, Route
from seatrial.flight.navigation import NavigationFilter, checked_navigation, filter_of
from seatrial.flight.sensor_channels import SensorChannels, sensor_channels, sensors_of
from seatrial.sensors.sensor import KINDS

if TYPE_CHECKING:
    from seatrial.sensors.sensor import Sensor


@dataclass(frozen=True, eq=False, kw_only=True)
class Water:
    """Water of a flight: how it moves, what bounds it and stands in it. Still, deep and empty by default.

    For `seatrial.fly_batch` current, turbulence, trend, walk and waves may have a row for each of k cases.

    Attributes
    ----------
    current : (3,) or (k, 3) array_like
        Velocity of the water, north, east, down, m/s; its mean where it is turbulent.
    turbulence : float, (3,) or (k, 3) array_like
        Standard deviation of the current about its mean, m/s: of both horizontal components, or of north,
        east and down; a second-order Gauss-Markov process that goes by the seed.
    turbulence_times_s : (float, float)
        Its correlation time, and the time in which eddies average out along the hull, s.
    current_trend : (3,) or (k, 3) array_like
        Steady change of the mean current in an hour, north, east, down, m/s.
    current_walk : float, (3,) or (k, 3) array_like
        Standard deviation of its random walk after an hour, m/s, as for `turbulence`.
    waves : SeaState, or k of them or None
        The sea whose orbital motion the vehicle meets at its place and depth; it goes by the seed.
    obstacles : sequence of (north, east, radius)
        Cylinders in the water, m; the metric ``clearance_m`` is the smallest distance to an edge.
    seabed : float or (3,) array_like, optional
        Depth of the bottom in m, and its slopes north and east; no bottom when omitted.
    rho, g : float, optional
        Density, kg/m3, and gravity, m/s2, instead of the vehicle file's.

    Examples
    --------
    >>> import seatrial as st
    >>> water = st.Water(current=[0.0, 0.3, 0.0], waves=st.SeaState(1.0, 6.0, toward_deg=90.0))
    >>> water.turbulence
    (0.0, 0.0, 0.0)
    """

    current: ArrayLike = (0.0, 0.0, 0.0)
    turbulence: ArrayLike = (0.0, 0.0, 0.0)
    turbulence_times_s: tuple[float, float] = FLIGHT_LIMITS.turbulence_times_s
    current_trend: ArrayLike = (0.0, 0.0, 0.0)
    current_walk: ArrayLike = (0.0, 0.0, 0.0)
    waves: SeaState | Sequence[SeaState | None] | None = None
    obstacles: Sequence[tuple[float, float, float]] = ()
    seabed: ArrayLike | None = None
    rho: float | None = None
    g: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Conditions:
    """Conditions of a flight: its sensors, its navigation, its failures, its start and its end.

    For `seatrial.fly_batch` faults, outages and start may be given for each of k cases.

    Attributes
    ----------
    sensors : mapping of str to Sensor, str or Path, optional
        By kind, "typical", or a file with ``[sensors.KIND]`` tables; perfect sensors when omitted.
    navigation : str or NavigationFilter
        What the autopilot uses: "sensors", what they show, or "filter", the estimate of a navigation
        filter on `model` with the sensors of the flight, which knows the turbulence and waves that all
        flights share; or a filter of one's own settings. Its model counts as exact where neither `model` is
        given nor other coefficients fly.
    model : Vehicle, str or Path, optional
        The vehicle that the autopilot believes in; by default the one that flies.
    faults : sequence of Fault, or k of them
        Actuators that die or stick.
    outages : sequence of Outage, or k of them
        Groups of channels without samples.
    feedback : bool
        Whether the autopilot sees what its actuators do, and so finds a failed one.
    voltage_v : float, optional
        Supply, V, where thrust depends on it.
    initial : State, or k of them, optional
        Where the flight begins; by default at rest at the mission's start, heading as the mission says or to
        the first waypoint.
    dither : mapping of str to (s,) array_like, optional
        ``times``, s, and by actuator what is added to its command from each of them on, in its unit,
        while the vehicle is not stopped. The logged commands contain it.
    max_step_s : float
        Largest step of the integration, s.
    max_time_s : float, optional
        Longest duration, s; by default three times the planned time and five minutes.

    Examples
    --------
    >>> import seatrial as st
    >>> st.Conditions(sensors="typical", faults=[st.Fault("stern", 20.0)]).feedback
    True
    """

    sensors: Mapping[str, Sensor] | str | Path | None = None
    navigation: str | NavigationFilter = "sensors"
    model: Vehicle | str | Path | None = None
    faults: Sequence[Fault] | Sequence[Sequence[Fault]] = ()
    outages: Sequence[Outage] | Sequence[Sequence[Outage]] = ()
    feedback: bool = True
    voltage_v: float | None = None
    initial: State | Sequence[State] | None = None
    dither: Mapping[str, ArrayLike] | None = None
    max_step_s: float = 0.02
    max_time_s: float | None = None


CALM = Water()
"""Still, deep, empty water."""

PLAIN = Conditions()
"""Perfect sensors, no failures, at rest at the mission's start."""


def used_only(given: Water | Conditions, *names: str, by: str) -> None:
    """Refuse, with a SimulationError, fields not at their default that what flies (`by`) does not use."""
    for entry in fields(given):
        if entry.name not in names and getattr(given, entry.name) is not entry.default:
            raise SimulationError(
                f"{entry.name}: {by} does not use it; leave it out, or fly with `seatrial.fly`"
            )


@dataclass(frozen=True)
class Circumstances(
    Plain,
    only="sources model=model.name current_m_s=current turbulence_m_s=turbulence turbulence_times_s"
    " current_trend_m_s_per_h=current_trend current_walk_m_s_after_1_h=current_walk waves"
    " obstacles_m=obstacles sensors=_sensors sensor_notes faults outages seabed seed voltage_v feedback"
    " navigation filter=_filter start=_start dither rho_kg_m3=rho g_m_s2=g max_step_s max_time_s",
):
    """What a flight was exposed to: the checked values of `Water` and `Conditions` that all its cases share.

    `sensors` holds per kind what its table says, `sensor_notes` where the flight's differ from that; `model`
    is the vehicle that the autopilot believes in. `start` is None where the flight began at rest where the
    mission begins; `aboard` the navigation filter, `own_filter` whether the caller made it. `sources`: names
    or paths that were asked for, by "vehicle", "autopilot", "mission".
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

    @property
    def _sensors(self) -> dict[str, Any] | str:
        """Numbers of the sensors by kind."""
        return self.sensors or "perfect"

    @property
    def _filter(self) -> dict[str, Any] | None:
        """The navigation filter as plain data."""
        return None if self.aboard is None else self.aboard.to_dict() | {"own": self.own_filter}

    @property
    def _start(self) -> dict[str, list[float]] | None:
        """Where it began as plain data: NED in m, quaternion, velocities in m/s and rad/s."""
        if self.start is None:
            return None
        parts = self.start.position, self.start.attitude, self.start.nu
        names = "position_m", "attitude", "velocities"
        return {name: part.tolist() for name, part in zip(names, parts, strict=True)}


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
    """What all cases share, checked, and the sensors as the core takes them; `varied`: whether a case flies
    with other coefficients, so that a navigation filter's model is not exact.
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


def _triple(row: ArrayLike) -> tuple[float, float, float]:
    north, east, down = np.asarray(row, float).tolist()
    return north, east, down
