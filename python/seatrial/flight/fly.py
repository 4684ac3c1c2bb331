"""What one flight and many have in common: inputs found, checked and brought into the core's form.

Tests: ``tests/flight/test_fly.py``.

`fly`: one closed-loop flight of a vehicle with its autopilot on a mission.

Tests: ``tests/flight/test_fly.py``.

`fly_batch`: many flights of one mission side by side, each with other gains, coefficients or faults.

Tests: ``tests/flight/test_fly.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from seatrial import _core
from seatrial._core import Autopilot, Flights, State, Vehicle
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.toml_file import loaded
from seatrial.flight.cases import (
    Corridor,
    checked_corridors,
    checked_list,
    checked_obstacles,
    checked_rows,
    checked_seabed,
    checked_seed,
    checked_set_points,
    checked_step,
    checked_supply,
    checked_threads,
    checked_times,
    checked_turbulence,
    checked_vector,
    longest,
    within,
)
from seatrial.flight.failures import TURBULENCE_TIMES_S, Circumstances, Fault, Outage, fault_rows, outage_rows
from seatrial.flight.flight import Flight
from seatrial.flight.mission import Mission, Route
from seatrial.flight.sensor_channels import SensorChannels, sensor_channels, sensors_of

if TYPE_CHECKING:
    from seatrial.sensors.sensor import Sensor

__all__ = ["SetUp", "Sources", "fly", "fly_batch", "set_up"]

Sources = tuple["Vehicle | str | Path", "Autopilot | str | Path", "Mission | str | Path"]


@dataclass(frozen=True, eq=False)
class SetUp:
    """A flight that is ready to go.

    Attributes
    ----------
    vehicle, autopilot, mission, route
        What flies, and the mission's waypoints.
    circumstances
        Current, sensors, failures, model.
    channels
        The sensors as the core takes them.
    outages
        Rows as the core takes them.
    initial
        Where it begins.
    """

    vehicle: Vehicle
    autopilot: Autopilot
    mission: Mission
    route: Route
    circumstances: Circumstances
    channels: SensorChannels
    outages: list[tuple[int, float, float]]
    initial: State

    @property
    def flown(self) -> tuple[Vehicle, Autopilot, Mission, Route]:
        """Vehicle, autopilot, mission and its route."""
        return self.vehicle, self.autopilot, self.mission, self.route

    def fly(
        self,
        seeds: Sequence[int],
        faults: list[tuple[int, str, float, float]],
        *,
        current: Array,
        logs: bool,
        **batch: Any,
    ) -> Flights:
        """Flights of as many cases as seeds; `batch` is what differs from case to case besides.

        Raises
        ------
        VehicleError
            The autopilot does not fit the vehicle, or a name is unknown.
        """
        around, begin = self.circumstances, self.initial
        own: dict[str, Any] = {
            "position": begin.position,
            "attitude": begin.attitude,
            "nu": begin.nu,
            "turbulence": around.turbulence,
        }
        return _core.fly(
            self.vehicle,
            self.autopilot,
            self.mission.core,
            list(seeds),
            model=around.model,
            current=current,
            turbulence_times=around.turbulence_times,
            obstacles=list(around.obstacles),
            faults=faults,
            errors=self.channels.errors,
            timing=self.channels.timing,
            outages=self.outages,
            feedback=around.feedback,
            seabed=around.seabed,
            voltage=math.nan if around.voltage is None else around.voltage,
            rho=around.rho,
            g=around.g,
            max_step=around.max_step,
            max_time=around.max_time,
            logs=logs,
            **(own | batch),
        )


def set_up(
    sources: Sources,
    *,
    model: Vehicle | str | Path | None,
    sensors: Mapping[str, Sensor] | str | Path | None,
    current: ArrayLike,
    turbulence: ArrayLike = (0.0, 0.0, 0.0),
    turbulence_times: tuple[float, float] = TURBULENCE_TIMES_S,
    obstacles: Sequence[tuple[float, float, float]] = (),
    initial: State | None,
    faults: Sequence[Fault],
    outages: Sequence[Outage],
    seabed: ArrayLike | None,
    seed: int,
    voltage: float | None,
    feedback: bool,
    max_step: float,
    max_time: float | None,
    rho: float | None,
    g: float | None,
    logs: bool = True,
) -> SetUp:
    """A flight that is ready to go. See `seatrial.fly` for the parameters.

    Raises
    ------
    VehicleError
        A file is not usable.
    SimulationError, TrialError
        A number, a failure or a sensor is not.
    """
    vehicle, autopilot, mission = (
        loaded(kind, source) for kind, source in zip((Vehicle, Autopilot, Mission), sources, strict=True)
    )
    path = Route.of(mission)
    most = longest(path, autopilot, max_time, logs=logs)
    checked_step(max_step, autopilot)
    checked_supply(voltage, vehicle)
    if rho is not None:
        within("rho", rho, (500.0, 2000.0), "kg/m3")
    if g is not None:
        within("g", g, (0.1, 100.0), "m/s2")
    if not isinstance(feedback, bool):
        raise SimulationError(f"feedback: expected True or False, found {feedback!r}")
    checked_seed(seed)
    failed = checked_list("faults", faults, Fault, 'st.Fault("NAME", at_s=60)')
    silent = checked_list("outages", outages, Outage, 'st.Outage("position", from_s=100)')
    fitted = sensors_of(sensors, vehicle)
    channels = sensor_channels(fitted, autopilot.period_s)
    circumstances = Circumstances(
        current=checked_vector("current", current),
        turbulence=checked_turbulence(turbulence),
        turbulence_times=checked_times(turbulence_times),
        obstacles=checked_obstacles(obstacles),
        model=vehicle if model is None else _model(model, vehicle),
        max_step=max_step,
        max_time=most,
        sensors={} if fitted is None else {kind: _stated(sensor) for kind, sensor in fitted.items()},
        sensor_notes=channels.sentences,
        faults=failed,
        outages=silent,
        seabed=checked_seabed(seabed, path),
        seed=seed,
        voltage=voltage,
        feedback=feedback,
        rho=rho,
        g=g,
        sources={
            name: str(source) if isinstance(source, str | Path) else str(source.name)
            for name, source in zip(("vehicle", "autopilot", "mission"), sources, strict=True)
        },
    )
    fault_rows(failed, vehicle, most)
    start = State(path.start, [0.0, 0.0, path.heading]) if initial is None else initial
    if not isinstance(start, State):
        raise SimulationError(f"initial: expected an st.State, found {initial!r}")
    return SetUp(vehicle, autopilot, mission, path, circumstances, channels, outage_rows(silent, most), start)


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


def fly(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    model: Vehicle | str | Path | None = None,
    sensors: Mapping[str, Sensor] | str | Path | None = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    turbulence: ArrayLike = (0.0, 0.0, 0.0),
    turbulence_times: tuple[float, float] = TURBULENCE_TIMES_S,
    obstacles: Sequence[tuple[float, float, float]] = (),
    initial: State | None = None,
    faults: Sequence[Fault] = (),
    outages: Sequence[Outage] = (),
    seabed: ArrayLike | None = None,
    seed: int = 0,
    voltage: float | None = None,
    feedback: bool = True,
    max_step: float = 0.02,
    max_time: float | None = None,
    rho: float | None = None,
    g: float | None = None,
) -> Flight:
    """Flight of a vehicle with its autopilot on a mission: track, errors, commands, modes, energy, figures.

    Once per control period the sensors are read and the autopilot steps; its commands hold until the next. A
    flight that diverges or is not complete is a result, never an error: see `Flight.ending`.

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
    turbulence_times : (float, float), optional
        Its correlation time, and the time in which eddies average out along the hull, s.
    obstacles : sequence of (north, east, radius), optional
        Cylinders in the water, m; the figure ``clearance_m`` is the smallest distance to an edge.
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
        Of the sensors' errors; the same seed, the same flight.
    voltage : float, optional
        Supply, V, where thrust depends on it.
    feedback : bool, optional
        Whether the autopilot sees what its actuators do, and so finds a failed one.
    max_step : float, optional
        Largest step of the integration, s.
    max_time : float, optional
        Longest duration, s; by default three times the planned time and five minutes.
    rho, g : float, optional
        Density, kg/m3, and gravity, m/s2, instead of the vehicle file's.

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
    >>> flight.ending, flight.legs[0].reached
    ('complete', True)
    """
    ready = set_up(
        (vehicle, autopilot, mission),
        model=model,
        sensors=sensors,
        current=current,
        turbulence=turbulence,
        turbulence_times=turbulence_times,
        obstacles=obstacles,
        initial=initial,
        faults=faults,
        outages=outages,
        seabed=seabed,
        seed=seed,
        voltage=voltage,
        feedback=feedback,
        max_step=max_step,
        max_time=max_time,
        rho=rho,
        g=g,
    )
    around = ready.circumstances
    rows = fault_rows(faults, ready.vehicle, around.max_time)
    flights = ready.fly([around.seed], rows, current=np.array(around.current), logs=True)
    return Flight.of_case(flights, ready.flown, around)


def fly_batch(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    coefficients: Mapping[str, ArrayLike] | None = None,
    gains: Mapping[str, ArrayLike] | None = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    turbulence: ArrayLike = (0.0, 0.0, 0.0),
    turbulence_times: tuple[float, float] = TURBULENCE_TIMES_S,
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
    voltage: float | None = None,
    feedback: bool = True,
    max_step: float = 0.02,
    max_time: float | None = None,
    rho: float | None = None,
    g: float | None = None,
    logs: bool = False,
    threads: int | None = None,
) -> Flights:
    """Flights of k cases of one mission, their figures in SI and rad; on all threads, eight to a vector.

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
    turbulence_times, obstacles
        As for `seatrial.fly`, for all cases.
    seeds : int or sequence of int, optional
        Of the sensors' errors; one for all cases lets them meet the same noise.
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
    model, sensors, seabed, voltage, feedback, max_step, max_time, rho, g
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
    states = None if initial is None or isinstance(initial, State) else checked_states(initial)
    given = either_or("faults", faults, Fault, 'st.Fault("NAME", at_s=60)')
    silent = either_or("outages", outages, Outage, 'st.Outage("position", from_s=100)')
    per_case = bool(given) and not isinstance(given[0], Fault)
    silent_per_case = bool(silent) and not isinstance(silent[0], Outage)
    rows = checked_rows("current", current)
    eddies = (
        np.asarray(checked_turbulence(turbulence))
        if np.ndim(turbulence) < 2
        else checked_rows("turbulence", turbulence)
    )
    varied: dict[str, Any] = {
        "coefficients": checked_columns("coefficients", coefficients),
        "gains": checked_columns("gains", gains),
    }
    lengths = {name: len(values) for some in varied.values() for name, values in (some or {}).items()}
    varied["set_points"], steered = checked_set_points(set_points)
    varied["corridors"], judged = checked_corridors(corridors)
    lengths |= steered | judged
    if rows.ndim == 2:
        lengths["current"] = len(rows)
    if eddies.ndim == 2:
        lengths["turbulence"] = len(eddies)
    if states is not None:
        lengths["initial"] = len(states)
    if silent_per_case:
        lengths["outages"] = len(silent)
    if not isinstance(seeds, int | np.integer):
        seeds = checked_list("seeds", seeds, int, "1, 2, 3")
        lengths["seeds"] = len(seeds)
    if per_case:
        lengths["faults"] = len(given)
    k = max(lengths.values(), default=1)
    for name, length in lengths.items():
        if length != k:
            raise SimulationError(f"{name}: expected {k} values, one per case, found {length}")
    if k == 0:
        raise SimulationError("fly_batch: expected at least one case, found none")
    checked_threads(threads)
    every = [seeds] * k if isinstance(seeds, int | np.integer) else list(seeds)
    shared: list[Any] = [] if per_case else list(given)
    ready = set_up(
        (vehicle, autopilot, mission),
        model=model,
        sensors=sensors,
        current=rows if rows.ndim == 1 else rows[0],
        turbulence=eddies if eddies.ndim == 1 else (0.0, 0.0, 0.0),
        turbulence_times=turbulence_times,
        obstacles=obstacles,
        initial=initial if initial is None or isinstance(initial, State) else initial[0],
        faults=shared,
        outages=[] if silent_per_case else silent,
        seabed=seabed,
        seed=checked_seed(every[0]),
        voltage=voltage,
        feedback=feedback,
        max_step=max_step,
        max_time=max_time,
        rho=rho,
        g=g,
        logs=logs,
    )
    longest = ready.circumstances.max_time
    each = cast(Sequence[Sequence[Fault]], given) if per_case else [shared] * k
    failing = [
        row for case, some in enumerate(each) for row in fault_rows(some, ready.vehicle, longest, case=case)
    ]
    if silent_per_case:
        varied["case_outages"] = [
            (case, *row) for case, some in enumerate(silent) for row in outage_rows(some, longest)
        ]
    if eddies.ndim == 2:
        varied["turbulence"] = eddies
    if states is not None:
        varied |= {
            name: np.array([getattr(state, name) for state in states])
            for name in ("position", "attitude", "nu")
        }
    seen = [checked_seed(seed) for seed in every]
    return ready.fly(seen, failing, current=rows, logs=logs, threads=threads, **varied)


def checked_states(given: Any) -> tuple[State, ...]:
    """States, one per case."""
    return checked_list("initial", given, State, "st.State(...)")


def either_or(what: str, given: Any, kind: type, example: str) -> tuple[Any, ...]:
    """Failures for all cases, or a list of them per case."""
    found = checked_list(what, given, kind, example)
    alone = [isinstance(one, kind) for one in found]
    if any(alone) and not all(alone):
        raise SimulationError(
            f"{what}: expected either {what} for all cases or a list of them per case, found both"
        )
    if not any(alone):
        for some in found:
            checked_list(what, some, kind, example)
    return found


def checked_columns(what: str, given: Any) -> dict[str, Array] | None:
    """Finite values by name, (k,) each."""
    if given is None:
        return None
    if not isinstance(given, Mapping):
        raise SimulationError(f"{what}: expected {{name: values}}, found {given!r}")
    columns = {}
    for name, values in given.items():
        try:
            column = np.asarray(values, float)
        except (TypeError, ValueError):
            column = np.empty(())
        if column.ndim != 1 or not np.isfinite(column).all():
            raise SimulationError(
                f"{what}: {name}: expected finite numbers (k,), one per case, found {values!r}"
            )
        columns[name] = column
    return columns
