"""`Cases`: closed-loop flights of one mission, with what they share and what differs from case to case.

`Cases.of` checks everything once and refuses in the words of `seatrial.fly`; `dataclasses.replace` then puts
in what is drawn (`seatrial.verification`) or searched (`seatrial.tuning`), without asking again; `Cases.fly`
hands all of it to the core in one call. Held by ``tests/flight/test_fly.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import Autopilot, Filter, Flights, State, Vehicle
from seatrial._core import fly as core_fly
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.toml_file import loaded
from seatrial.flight.checks import (
    Corridor,
    checked_columns,
    checked_corridors,
    checked_failures,
    checked_list,
    checked_rows,
    checked_seed,
    checked_set_points,
    checked_turbulence,
)
from seatrial.flight.conditions import CALM, PLAIN, Circumstances, Conditions, Water, circumstances_of
from seatrial.flight.disturbances import Fault, Outage, checked_seas, fault_rows, outage_rows, sea_rows
from seatrial.flight.mission import Mission, Route
from seatrial.flight.sensor_channels import SensorChannels

_HOUR_S = 3600.0  # changes of the current are given per hour

_HIGHEST_START_M = 1.0  # above the surface: a wave, or a depth sensor with an offset, may show as much


@dataclass(frozen=True, eq=False)
class Cases:
    """Flights of one mission that are ready to go; made by `Cases.of`. SI and rad, NED.

    What differs from case to case has a row or value for each of k cases, or one for all: where a case
    begins, `position`, `attitude` (quaternion or roll, pitch, yaw) and `nu` over ground; `current`, its
    standard deviation `turbulence`, and the change of its mean in an hour, steady (`current_trend`) and
    random (`current_walk`), m/s; `waves`, rows of `SeaState.row`; `coefficients` of the vehicle that flies
    and `gains`, (k,) each by name; `sensor_offsets`, (k, 16), in standard deviations of each channel, None:
    drawn from the `seeds`. Rows of `faults` are (case, actuator, time in s, command or nan), of `outages`
    (group, from, until in s), of `case_outages` (case, group, from, until). All share the `circumstances`,
    the sensors as the core takes them (`channels`), the `dither` of the commands and the navigation `filter`;
    None: the autopilot goes by what the sensors show. `set_points` and `corridors` are those of
    `seatrial.fly_batch`.
    """

    vehicle: Vehicle
    autopilot: Autopilot
    mission: Mission
    route: Route
    circumstances: Circumstances
    channels: SensorChannels
    seeds: Sequence[int]
    position: Array
    attitude: Array
    nu: Array
    current: Array
    turbulence: Array
    current_trend: Array
    current_walk: Array
    waves: Array
    coefficients: Mapping[str, Array] = field(default_factory=dict)
    gains: Mapping[str, Array] = field(default_factory=dict)
    faults: Sequence[tuple[int, str, float, float]] = ()
    outages: Sequence[tuple[int, float, float]] = ()
    case_outages: Sequence[tuple[int, int, float, float]] = ()
    sensor_offsets: Array | None = None
    set_points: Mapping[str, Array] | None = None
    corridors: Sequence[Corridor] = ()
    logs: bool = False
    dither: Mapping[str, Array] | None = None
    filter: Filter | None = None

    @classmethod
    def of(
        cls,
        vehicle: Vehicle | str | Path,
        autopilot: Autopilot | str | Path,
        mission: Mission | str | Path,
        *,
        water: Water = CALM,
        conditions: Conditions = PLAIN,
        seeds: int | Sequence[int] = 0,
        coefficients: Mapping[str, ArrayLike] | None = None,
        gains: Mapping[str, ArrayLike] | None = None,
        set_points: Mapping[str, ArrayLike] | None = None,
        corridors: Sequence[Corridor] = (),
        logs: bool = False,
    ) -> Cases:
        """Cases of one mission, checked; parameters and errors are those of `seatrial.fly_batch`."""
        initial = conditions.initial
        starts_differ = not (initial is None or isinstance(initial, State))
        states = None if initial is None else _states(initial)
        failing = checked_failures("faults", conditions.faults, Fault)
        silent = checked_failures("outages", conditions.outages, Outage)
        faults_differ = bool(failing) and not isinstance(failing[0], Fault)
        outages_differ = bool(silent) and not isinstance(silent[0], Outage)
        current = checked_rows("current", water.current)
        trend = checked_rows("current_trend", water.current_trend)
        eddies = _deviations("turbulence", water.turbulence)
        walk = _deviations("current_walk", water.current_walk)
        seas, seas_differ = checked_seas(water.waves)
        changed = checked_columns("coefficients", coefficients), checked_columns("gains", gains)
        steering, lengths = checked_set_points(set_points)
        judged, bases = checked_corridors(corridors)
        lengths = {name: len(values) for some in changed for name, values in some.items()} | lengths | bases
        one_seed = isinstance(seeds, int | np.integer)
        listed = [seeds] if one_seed else checked_list("seeds", seeds, int, "1, 2, 3")
        lengths |= {
            name: len(values)
            for name, values, differs in (
                ("current", current, current.ndim == 2),
                ("turbulence", eddies, eddies.ndim == 2),
                ("current_trend", trend, trend.ndim == 2),
                ("current_walk", walk, walk.ndim == 2),
                ("waves", seas, seas_differ),
                ("initial", states or (), starts_differ),
                ("outages", silent, outages_differ),
                ("seeds", listed, not one_seed),
                ("faults", failing, faults_differ),
            )
            if differs
        }
        k = _count(lengths)
        sources = {"vehicle": vehicle, "autopilot": autopilot, "mission": mission}
        flown = loaded(Vehicle, vehicle), loaded(Autopilot, autopilot), loaded(Mission, mission)
        route = Route.of(flown[2])
        added = checked_set_points(conditions.dither, "dither")[0]
        # What differs from case to case stands in the cases; the circumstances hold what all have in common.
        around, channels = circumstances_of(
            flown,
            route,
            replace(
                water,
                current=np.atleast_2d(current)[0],
                turbulence=_common(eddies),
                current_trend=_common(trend),
                current_walk=_common(walk),
                waves=None if seas_differ else seas[0],
            ),
            replace(
                conditions,
                faults=() if faults_differ else failing,
                outages=() if outages_differ else silent,
                initial=None if starts_differ or not states else states[0],
                dither=added,
            ),
            seed=checked_seed(listed[0]),
            varied=_differs(flown[0], changed[0]),
            logs=logs,
        )
        around = replace(
            around,
            sources={
                name: str(source) if isinstance(source, str | Path) else str(source.name)
                for name, source in sources.items()
            },
        )
        until = around.max_time_s
        position, attitude, nu = _start(route, states, differs=starts_differ)
        return cls(
            *flown,
            route,
            around,
            channels,
            seeds=[checked_seed(seed) for seed in (listed * k if one_seed else listed)],
            position=position,
            attitude=attitude,
            nu=nu,
            current=current,
            turbulence=eddies,
            current_trend=trend,
            current_walk=walk,
            waves=sea_rows(seas),
            coefficients=changed[0],
            gains=changed[1],
            faults=[
                row
                for case, some in enumerate(failing if faults_differ else [failing] * k)
                for row in fault_rows(some, flown[0], until, case=case)
            ],
            outages=outage_rows(() if outages_differ else silent, until),
            case_outages=[
                (case, *row)
                for case, some in enumerate(silent if outages_differ else ())
                for row in outage_rows(some, until)
            ],
            set_points=steering,
            corridors=judged,
            dither=added,
            logs=logs,
            filter=None if around.aboard is None else around.aboard.core,
        )

    def __len__(self) -> int:
        """Number of cases."""
        return len(self.seeds)

    def fly(self, *, threads: int | None = None) -> Flights:
        """Flights of all cases, side by side, on so many threads (all by default), on which the result does
        not depend.
        """
        around = self.circumstances
        return core_fly(
            self.vehicle,
            self.autopilot,
            self.mission.core,
            list(self.seeds),
            model=around.model,
            position=self.position,
            attitude=self.attitude,
            nu=self.nu,
            current=self.current,
            turbulence=self.turbulence,
            current_trend=self.current_trend / _HOUR_S,
            current_walk=self.current_walk / math.sqrt(_HOUR_S),
            waves=self.waves,
            turbulence_times_s=around.turbulence_times_s,
            obstacles=list(around.obstacles),
            coefficients=dict(self.coefficients),
            gains=dict(self.gains),
            faults=list(self.faults),
            errors=self.channels.errors,
            timing=self.channels.timing,
            outages=list(self.outages),
            case_outages=list(self.case_outages),
            sensor_offsets=self.sensor_offsets,
            set_points=self.set_points,
            corridors=list(self.corridors),
            dither=self.dither,
            feedback=around.feedback,
            navigation=self.filter,
            acoustics=dict(self.channels.acoustics),
            transceiver=self.channels.transceiver,
            seabed=around.seabed,
            voltage_v=math.nan if around.voltage_v is None else around.voltage_v,
            rho=around.rho,
            g=around.g,
            max_step_s=around.max_step_s,
            max_time_s=around.max_time_s,
            logs=self.logs,
            threads=threads,
        )


def _differs(vehicle: Vehicle, coefficients: Mapping[str, Array]) -> bool:
    """Whether any case flies with a coefficient other than the vehicle's."""
    nominal = vehicle.coefficients()
    return any(bool(np.any(values != nominal.get(name))) for name, values in coefficients.items())


def _count(lengths: Mapping[str, int]) -> int:
    """Number of cases, from the lengths of what is given per case."""
    k = max(lengths.values(), default=1)
    for name, length in lengths.items():
        if length != k:
            raise SimulationError(f"{name}: expected {k} values, one per case, found {length}")
    if k == 0:
        raise SimulationError("fly_batch: expected at least one case, found none")
    return k


def _states(initial: Any) -> tuple[State, ...]:
    """Where the cases begin: one for all of them, or one per case."""
    given = (
        (initial,) if isinstance(initial, State) else checked_list("initial", initial, State, "st.State(...)")
    )
    for state in given:
        if not isinstance(state, State):
            raise SimulationError(f"initial: expected an st.State, found {state!r}")
        if (depth := float(state.position[2])) < -_HIGHEST_START_M:
            raise SimulationError(
                f"initial: expected a place in the water, found a depth of {depth:g} m, {-depth:g} m above"
                " the surface; depth is positive down"
            )
    return given


def _start(route: Route, states: tuple[State, ...] | None, *, differs: bool) -> tuple[Array, Array, Array]:
    """Position, attitude and velocities at the start, a row for all cases or one per case."""
    begin = states or (State(route.start, [0.0, 0.0, route.heading]),)
    rows = [np.array([getattr(state, name) for state in begin]) for name in ("position", "attitude", "nu")]
    position, attitude, nu = rows if differs else [row[0] for row in rows]
    return position, attitude, nu


def _deviations(name: str, given: ArrayLike) -> Array:
    """Standard deviations of a velocity of the water, (3,) or (k, 3), m/s."""
    return np.asarray(checked_turbulence(given, name)) if np.ndim(given) < 2 else checked_rows(name, given)


def _common(rows: Array) -> Array:
    """Deviations that all cases share, (3,); zero where they differ."""
    return rows if rows.ndim == 1 else np.zeros(3)
