"""`fly`, `fly_batch`, `fly_seeds`: closed-loop flights of a vehicle with its autopilot on a mission.

Both state the parameters for a user; `seatrial.flight.cases` checks them and flies. Tests:
``tests/flight/test_fly.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from seatrial._core import Autopilot, Flights, State, Vehicle, checked_threads
from seatrial.base.arrays import Array, Mask
from seatrial.base.errors import SimulationError
from seatrial.base.plain import Plain
from seatrial.base.toml_file import loaded
from seatrial.base.work import Clock, takes
from seatrial.flight.cases import Cases
from seatrial.flight.checks import (
    Corridor,
    checked_failures,
    checked_seed,
    checked_turbulence,
    checked_vector,
)
from seatrial.flight.conditions import CALM, PLAIN, Conditions, Water
from seatrial.flight.excesses import Excess, excesses, unkept
from seatrial.flight.failures import Fault, Outage
from seatrial.flight.flight import Flight
from seatrial.flight.metrics import CODED, ending_of, metrics_of
from seatrial.flight.mission import Mission
from seatrial.flight.payload import Payload, sampled


@takes(water=Water, conditions=Conditions)
def fly(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    water: Water = CALM,
    conditions: Conditions = PLAIN,
    seed: int = 0,
    payload: Payload | str | Path | None = None,
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
    water : Water, optional
        Current, turbulence, waves, seabed, obstacles; still, deep and empty by default.
    conditions : Conditions, optional
        Sensors, navigation, failures, start and end; perfect sensors and no failure by default.
    seed : int, optional
        Of the sensors' errors and the water's motion; the same seed, the same flight.
    payload : Payload, str or Path, optional
        Water, plumes and the sensors that sample it, an object or a file; see `Flight.samples`.

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
    >>> flight = st.fly("cwolf", "cwolf", mission, water=st.Water(current=[0.0, 0.3, 0.0]))
    >>> flight.outcome, flight.legs[0].reached
    ('complete', True)
    """
    if conditions.initial is not None and not isinstance(conditions.initial, State):
        raise SimulationError(f"initial: expected an st.State, found {conditions.initial!r}")
    clock = Clock()
    if payload is not None and not isinstance(payload, Payload):
        payload = Payload.load(payload)
    cases = Cases.of(
        vehicle,
        autopilot,
        mission,
        water=replace(
            water,
            current=checked_vector("current", water.current),
            turbulence=checked_turbulence(water.turbulence),
            current_trend=checked_vector("current_trend", water.current_trend),
            current_walk=checked_turbulence(water.current_walk, "current_walk"),
        ),
        conditions=replace(
            conditions,
            faults=checked_failures("faults", conditions.faults, Fault, per_case=False),
            outages=checked_failures("outages", conditions.outages, Outage, per_case=False),
        ),
        seeds=[checked_seed(seed)],
        logs=True,
    )
    if payload is not None:
        payload.check_current(cases.circumstances.current)
    flight = Flight.of_case(cases.fly(), cases)
    if payload is not None:
        flight = replace(flight, samples=sampled(payload, flight, cases.channels.errors))
    return replace(flight, clock=clock.stop())


@takes(water=Water, conditions=Conditions)
def fly_batch(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    water: Water = CALM,
    conditions: Conditions = PLAIN,
    coefficients: Mapping[str, ArrayLike] | None = None,
    gains: Mapping[str, ArrayLike] | None = None,
    seeds: int | Sequence[int] = 0,
    set_points: Mapping[str, ArrayLike] | None = None,
    corridors: Sequence[Corridor] = (),
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
    water : Water, optional
        As for `seatrial.fly`; its current, turbulence, trend, walk and waves for all cases or per case.
    conditions : Conditions, optional
        As for `seatrial.fly`; its faults, outages and start for all cases or per case.
    coefficients : mapping of str to (k,) array_like, optional
        Of the vehicle that flies, by name; the autopilot's model keeps its own.
    gains : mapping of str to (k,) array_like, optional
        Of the autopilot, by the names of `Autopilot.gains`.
    seeds : int or sequence of int, optional
        Of the sensors' errors and the water's motion; one for all cases lets them meet the same noise.
    set_points : mapping of str to array_like, optional
        A trial of the loops: ``times`` (s,), and from each of them on ``speed`` and ``lateral`` (m/s),
        ``heading`` and ``pitch`` (rad) or ``depth`` (m), (s,) or (k, s), in place of what guidance asks
        for; ``north``, ``east`` and ``down`` (m) move its plan instead.
    corridors : sequence of tuple, optional
        What the responses are held against, see `seatrial.tuning.step_trial`; sums in ``Flights.violations``.
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
        water=water,
        conditions=conditions,
        coefficients=coefficients,
        gains=gains,
        seeds=seeds,
        set_points=set_points,
        corridors=corridors,
        logs=logs,
    )
    return cases.fly(threads=threads)


@dataclass(frozen=True, eq=False)
class Seeds(Plain, only="seeds endings metrics"):
    """Flights of one mission under many seeds.

    Attributes
    ----------
    seeds
        Of the flights.
    metrics
        Metrics by name, one value per seed.
    endings
        How each flight ended.
    too_near
        Seeds of the flights that touched something or came nearer than the mission promises.
    touched
        Seeds of the flights that touched the bottom.
    off_limits
        Seeds of the flights that went deeper, or nearer to the bottom, than the mission allows.
    excesses
        What they did that every user calls a failure.
    """

    seeds: tuple[int, ...]
    metrics: Mapping[str, Array]
    endings: tuple[str, ...]
    too_near: tuple[int, ...] = ()
    touched: tuple[int, ...] = ()
    off_limits: tuple[int, ...] = ()
    excesses: tuple[Excess, ...] = ()

    @property
    def all_complete(self) -> bool:
        """Whether every flight came to the end of the mission and kept its distances and limits."""
        complete = all(ending == "complete" for ending in self.endings)
        return complete and not (self.too_near or self.touched or self.off_limits)

    def parquet(self) -> bytes:
        """Metrics and endings, a row per seed."""
        import polars as pl

        from seatrial.base.files import parquet

        columns: dict[str, Any] = {"seed": list(self.seeds), "ending": list(self.endings)}
        columns |= {name: values for name, values in self.metrics.items() if name not in CODED}
        return parquet(pl.DataFrame(columns))


def fly_seeds(
    vehicle: Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    mission: Mission | str | Path,
    *,
    count: int,
    first: int,
    water: Water,
    conditions: Conditions,
) -> Seeds:
    """Flights of `count` seeds from `first` on in the same water and conditions."""
    seeds = tuple(range(first, first + count))
    metrics = metrics_of(
        fly_batch(vehicle, autopilot, mission, seeds=list(seeds), water=water, conditions=conditions)
    )
    flown = loaded(Mission, mission)
    promised, limits = flown.promised_m, flown.limits
    near, down, low, deep = unkept(metrics, promised, limits).values()

    def which(mask: Mask) -> tuple[int, ...]:
        return tuple(seed for seed, one in zip(seeds, mask, strict=True) if one)

    return Seeds(
        seeds,
        metrics,
        tuple(ending_of(metrics, case) for case in range(count)),
        too_near=which(near),
        touched=which(down),
        off_limits=which(low | deep),
        excesses=tuple(
            excesses(
                metrics, promised, max_depth_m=limits["max_depth_m"], min_altitude_m=limits["min_altitude_m"]
            )
        ),
    )
