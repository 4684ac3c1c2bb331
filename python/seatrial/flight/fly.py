"""`fly` and `fly_batch`: closed-loop flights of a vehicle with its autopilot on a mission.

Both state the parameters for a user; `seatrial.flight.cases` checks them and flies. Tests:
``tests/flight/test_fly.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from seatrial._core import Autopilot, Flights, State, Vehicle, checked_threads
from seatrial.base.errors import SimulationError
from seatrial.base.progress import Clock
from seatrial.flight.cases import Cases
from seatrial.flight.checks import (
    TURBULENCE_TIMES_S,
    Corridor,
    checked_failures,
    checked_seed,
    checked_turbulence,
    checked_vector,
)
from seatrial.flight.failures import Fault, Outage
from seatrial.flight.flight import Flight
from seatrial.flight.mission import Mission
from seatrial.flight.navigation import NavigationFilter
from seatrial.flight.payload import Payload, sampled
from seatrial.flight.sea import SeaState

if TYPE_CHECKING:
    from seatrial.sensors.sensor import Sensor


def fly(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    model: Vehicle | str | Path | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    turbulence: ArrayLike = (0.0, 0.0, 0.0),
    turbulence_times_s: tuple[float, float] = TURBULENCE_TIMES_S,
    current_trend: ArrayLike = (0.0, 0.0, 0.0),
    current_walk: ArrayLike = (0.0, 0.0, 0.0),
    waves: SeaState | None = None,
    obstacles: Sequence[tuple[float, float, float]] = (),
    initial: State | None = None,
    faults: Sequence[Fault] = (),
    outages: Sequence[Outage] = (),
    seabed: ArrayLike | None = None,
    seed: int = 0,
    voltage_v: float | None = None,
    feedback: bool = True,
    navigation: str | NavigationFilter = "sensors",
    max_step_s: float = 0.02,
    max_time_s: float | None = None,
    rho: float | None = None,
    g: float | None = None,
    payload: Payload | str | Path | None = None,
    dither: Mapping[str, ArrayLike] | None = None,
) -> Flight:
    """Flight of a vehicle with its autopilot on a mission: track, errors, commands, modes, energy, metrics.

    Once per control period the sensors are read and the autopilot steps; its commands hold until the next. A
    flight that diverges or is not complete is a result, never an error: see `Flight.outcome`.

    Parameters
    ----------
    vehicle : Vehicle, str or Path
        That flies: an object, a built-in name or a file.
    autopilot : Autopilot, str or Path
        The same of the autopilot.
    mission : Mission, str or Path
        The mission or its file.
    model : Vehicle, str or Path, optional
        The vehicle that the autopilot believes in; by default the one that flies.
    sensors : mapping of str to Sensor, str or Path, optional
        By kind, "typical", or a file with ``[sensors.KIND]`` tables; perfect sensors when omitted.
    current : (3,) array_like, optional
        Velocity of the water, north, east, down, m/s; its mean where it is turbulent.
    turbulence : float or (3,) array_like, optional
        Standard deviation of the current about its mean, m/s: of both horizontal components, or of north,
        east and down; a second-order Gauss-Markov process that goes by the seed.
    turbulence_times_s : (float, float), optional
        Its correlation time, and the time in which eddies average out along the hull, s.
    current_trend : (3,) array_like, optional
        Steady change of the mean current in an hour, north, east, down, m/s.
    current_walk : float or (3,) array_like, optional
        Standard deviation of its random walk after an hour, m/s, as for `turbulence`.
    waves : SeaState, optional
        The sea whose orbital motion the vehicle meets at its place and depth; it goes by the seed.
    obstacles : sequence of (north, east, radius), optional
        Cylinders in the water, m; the metric ``clearance_m`` is the smallest distance to an edge.
    initial : State, optional
        Where the flight begins; by default at rest at the mission's start, heading as the mission says or to
        the first waypoint.
    faults : sequence of Fault, optional
        Actuators that die or stick.
    outages : sequence of Outage, optional
        Groups of channels without samples.
    seabed : float or (3,) array_like, optional
        Depth of the bottom in m, and its slopes north and east; no bottom when omitted.
    seed : int, optional
        Of the sensors' errors and the water's motion; the same seed, the same flight.
    voltage_v : float, optional
        Supply, V, where thrust depends on it.
    feedback : bool, optional
        Whether the autopilot sees what its actuators do, and so finds a failed one.
    navigation : str or NavigationFilter, optional
        What the autopilot goes by: "sensors", what they show, or "filter", the estimate of a navigation
        filter on `model` with the sensors of the flight, told of turbulence and waves that all flights
        share; or a filter of one's own settings. Its model counts as exact where neither `model` is given nor
        other coefficients fly.
    max_step_s : float, optional
        Largest step of the integration, s.
    max_time_s : float, optional
        Longest duration, s; by default three times the planned time and five minutes.
    rho, g : float, optional
        Density, kg/m3, and gravity, m/s2, instead of the vehicle file's.
    payload : Payload, str or Path, optional
        Water, plumes and the sensors that sample it, an object or a file; see `Flight.samples`.
    dither : mapping of str to (s,) array_like, optional
        ``times``, s, and by actuator what is added to its command from each of them on, in its unit,
        while the vehicle is not stopped. The logged commands contain it.

    Raises
    ------
    VehicleError
        A file is not usable, or the autopilot does not fit the vehicle.
    SimulationError, TrialError
        A number, a failure or a sensor is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> mission = st.Mission.from_toml('''
    ... format = 1
    ... name = "out"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 5.0
    ... [[legs]]
    ... north_m = 100.0
    ... east_m = 0.0
    ... depth_m = 5.0
    ... ''')
    >>> flight = st.fly("cwolf", "cwolf", mission, current=[0.0, 0.3, 0.0])
    >>> flight.outcome, flight.legs[0].reached
    ('complete', True)
    """
    if initial is not None and not isinstance(initial, State):
        raise SimulationError(f"initial: expected an st.State, found {initial!r}")
    clock = Clock()
    if payload is not None and not isinstance(payload, Payload):
        payload = Payload.load(payload)
    cases = Cases.of(
        vehicle,
        autopilot,
        mission,
        seeds=[checked_seed(seed)],
        model=model,
        sensors=sensors,
        current=checked_vector("current", current),
        turbulence=checked_turbulence(turbulence),
        turbulence_times_s=turbulence_times_s,
        current_trend=checked_vector("current_trend", current_trend),
        current_walk=checked_turbulence(current_walk, "current_walk"),
        waves=waves,
        obstacles=obstacles,
        initial=initial,
        faults=checked_failures("faults", faults, Fault, per_case=False),
        outages=checked_failures("outages", outages, Outage, per_case=False),
        seabed=seabed,
        voltage_v=voltage_v,
        feedback=feedback,
        navigation=navigation,
        max_step_s=max_step_s,
        max_time_s=max_time_s,
        rho=rho,
        g=g,
        dither=dither,
        logs=True,
    )
    if payload is not None:
        payload.check_current(cases.circumstances.current)
    flight = Flight.of_case(cases.fly(), cases)
    if payload is not None:
        flight = replace(flight, samples=sampled(payload, flight, cases.channels.errors))
    return replace(flight, clock=clock.stop())


def fly_batch(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    coefficients: Mapping[str, ArrayLike] | None = None,
    gains: Mapping[str, ArrayLike] | None = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    turbulence: ArrayLike = (0.0, 0.0, 0.0),
    turbulence_times_s: tuple[float, float] = TURBULENCE_TIMES_S,
    current_trend: ArrayLike = (0.0, 0.0, 0.0),
    current_walk: ArrayLike = (0.0, 0.0, 0.0),
    waves: SeaState | Sequence[SeaState | None] | None = None,
    obstacles: Sequence[tuple[float, float, float]] = (),
    seeds: int | Sequence[int] = 0,
    faults: Sequence[Fault] | Sequence[Sequence[Fault]] = (),
    model: Vehicle | str | Path | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    initial: State | Sequence[State] | None = None,
    outages: Sequence[Outage] | Sequence[Sequence[Outage]] = (),
    set_points: Mapping[str, ArrayLike] | None = None,
    corridors: Sequence[Corridor] = (),
    seabed: ArrayLike | None = None,
    voltage_v: float | None = None,
    feedback: bool = True,
    navigation: str | NavigationFilter = "sensors",
    max_step_s: float = 0.02,
    max_time_s: float | None = None,
    rho: float | None = None,
    g: float | None = None,
    logs: bool = False,
    threads: int | None = None,
) -> Flights:
    """Flights of k cases of one mission, their metrics in SI and rad; on all threads, eight to a vector.

    What is given once holds for all cases; k is the length of whatever is given per case. A case flies as it
    would alone.

    Parameters
    ----------
    vehicle, autopilot, mission
        As for `seatrial.fly`.
    coefficients : mapping of str to (k,) array_like, optional
        Of the vehicle that flies, by name; the autopilot's model keeps its own.
    gains : mapping of str to (k,) array_like, optional
        Of the autopilot, by the names of `Autopilot.gains`.
    current : (3,) or (k, 3) array_like, optional
        Velocity of the water, north, east, down, m/s; its mean where it is turbulent.
    turbulence : float, (3,) or (k, 3) array_like, optional
        Standard deviation of the current about its mean, m/s, as for `seatrial.fly`.
    current_trend, current_walk : array_like, optional
        As for `seatrial.fly`, for all cases or (k, 3).
    waves : SeaState, or k of them or None, optional
        As for `seatrial.fly`, for all cases or per case.
    turbulence_times_s, obstacles
        As for `seatrial.fly`, for all cases.
    seeds : int or sequence of int, optional
        Of the sensors' errors and the water's motion; one for all cases lets them meet the same noise.
    faults : sequence of Fault, or k of them, optional
        For all cases, or per case.
    initial : State, or k of them, optional
        As for `seatrial.fly`, for all cases or per case.
    outages : sequence of Outage, or k of them, optional
        For all cases, or per case.
    set_points : mapping of str to array_like, optional
        A trial of the loops: ``times`` (s,), and from each of them on ``speed`` and ``lateral`` (m/s),
        ``heading`` and ``pitch`` (rad) or ``depth`` (m), (s,) or (k, s), in place of what guidance asks
        for; ``north``, ``east`` and ``down`` (m) move its plan instead.
    corridors : sequence of tuple, optional
        What the responses are held against, see `seatrial.tuning.step_trial`; sums in ``Flights.violations``.
    model, sensors, seabed, voltage_v, feedback, navigation, max_step_s, max_time_s, rho, g
        As for `seatrial.fly`, for all cases.
    logs : bool, optional
        Whether to keep the logs, some megabytes an hour of flight and case.
    threads : int, optional
        All when omitted.

    Raises
    ------
    VehicleError
        A file or name is not usable.
    SimulationError, TrialError
        Lengths do not fit together, or a number, a failure or a sensor is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> text = '''
    ... format = 1
    ... name = "out"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 5.0
    ... [[legs]]
    ... north_m = 100.0
    ... east_m = 0.0
    ... depth_m = 5.0
    ... '''
    >>> lookahead = {"guidance.lookahead_m": [5.0, 10.0, 20.0]}
    >>> flights = st.fly_batch("cwolf", "cwolf", st.Mission.from_toml(text), gains=lookahead)
    >>> flights.figures["ending"]
    array([1., 1., 1.])
    """
    checked_threads(threads)
    cases = Cases.of(
        vehicle,
        autopilot,
        mission,
        coefficients=coefficients,
        gains=gains,
        current=current,
        turbulence=turbulence,
        turbulence_times_s=turbulence_times_s,
        current_trend=current_trend,
        current_walk=current_walk,
        waves=waves,
        obstacles=obstacles,
        seeds=seeds,
        faults=faults,
        model=model,
        sensors=sensors,
        initial=initial,
        outages=outages,
        set_points=set_points,
        corridors=corridors,
        seabed=seabed,
        voltage_v=voltage_v,
        feedback=feedback,
        navigation=navigation,
        max_step_s=max_step_s,
        max_time_s=max_time_s,
        rho=rho,
        g=g,
        logs=logs,
    )
    return cases.fly(threads=threads)
