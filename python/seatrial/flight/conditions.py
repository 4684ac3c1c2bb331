"""`Water` and `Conditions`: what a closed-loop flight meets, and with what it meets it.

Plain values as a person gives them; `seatrial.flight.cases` checks them against vehicle, autopilot and
mission before anything flies. Held by ``tests/flight/test_fly.py`` and ``test_bad_input_flights.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from seatrial._core import State, Vehicle
from seatrial.base.errors import SimulationError
from seatrial.flight.checks import FLIGHT_LIMITS
from seatrial.flight.failures import Fault, Outage
from seatrial.flight.navigation import NavigationFilter
from seatrial.flight.sea import SeaState

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
    for field in fields(given):
        if field.name not in names and getattr(given, field.name) is not field.default:
            raise SimulationError(
                f"{field.name}: {by} does not use it; leave it out, or fly with `seatrial.fly`"
            )
