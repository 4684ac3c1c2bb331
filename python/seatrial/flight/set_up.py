"""What one flight and many have in common: inputs found, checked and brought into the core's form.

Tests: ``tests/test_fly.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial import _core
from seatrial._core import Autopilot, Flights, State, Vehicle
from seatrial.errors import SimulationError
from seatrial.flight.circumstances import Circumstances
from seatrial.flight.failures import Fault, Outage, fault_rows, outage_rows
from seatrial.flight.route import Route
from seatrial.flight.sensor_channels import SensorChannels, sensor_channels, sensors_of
from seatrial.mission import Mission

if TYPE_CHECKING:
    from seatrial.sensors import Sensor

__all__ = ["SetUp", "Sources", "checked_seed", "set_up"]

Array = NDArray[np.float64]
Sources = tuple["Vehicle | str | Path", "Autopilot | str | Path", "Mission | str | Path"]

_TIMES_PLANNED, _MARGIN_S = 3.0, 300.0
_LARGEST_SEED = 2**53
_MOST_ROWS = 1e7


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
        around = self.circumstances
        return _core.fly(
            self.vehicle,
            self.autopilot,
            self.mission.core,
            list(seeds),
            model=around.model,
            position=self.initial.position,
            attitude=self.initial.attitude,
            nu=self.initial.nu,
            current=current,
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
            **batch,
        )


def set_up(
    sources: Sources,
    *,
    model: Vehicle | str | Path | None,
    sensors: Mapping[str, Sensor] | str | Path | None,
    current: ArrayLike,
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
        _loaded(Vehicle, sources[0]),
        _loaded(Autopilot, sources[1]),
        _loaded(Mission, sources[2]),
    )
    path = Route.of(mission)
    longest = _longest(path, autopilot, max_time)
    _positive("max_step", max_step, "s")
    for name, value, unit in (("voltage", voltage, "V"), ("rho", rho, "kg/m3"), ("g", g, "m/s2")):
        if value is not None:
            _positive(name, value, unit)
    if voltage is None and any(facts["needs_voltage"] for facts in vehicle.actuator_info().values()):
        raise SimulationError(
            f"voltage: the thrust of {vehicle.name} depends on the supply voltage; give it in V"
        )
    checked_seed(seed)
    fitted = sensors_of(sensors, vehicle)
    channels = sensor_channels(fitted, autopilot.period_s)
    circumstances = Circumstances(
        current=_vector("current", current),
        model=vehicle if model is None else _loaded(Vehicle, model),
        max_step=max_step,
        max_time=longest,
        sensors={} if fitted is None else {kind: _stated(sensor) for kind, sensor in fitted.items()},
        sensor_notes=channels.sentences,
        faults=tuple(faults),
        outages=tuple(outages),
        seabed=_seabed(seabed, path),
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
    fault_rows(faults, vehicle, longest)
    start = State(path.start, [0.0, 0.0, path.heading]) if initial is None else initial
    if not isinstance(start, State):
        raise SimulationError(f"initial: expected an st.State, found {initial!r}")
    return SetUp(vehicle, autopilot, mission, path, circumstances, channels, outage_rows(outages), start)


def checked_seed(seed: int) -> int:
    """A seed that is one.

    Raises
    ------
    SimulationError
        It is none.
    """
    whole = isinstance(seed, int | np.integer) and not isinstance(seed, bool)
    if not whole or not 0 <= seed < _LARGEST_SEED:
        raise SimulationError(f"seed: expected a whole number from 0 to 2^53 - 1, found {seed!r}")
    return int(seed)


def _loaded(kind: Any, source: Any) -> Any:
    """Vehicle, autopilot or mission itself, or that of a name or path."""
    if isinstance(source, kind):
        return source
    if isinstance(source, str | Path):
        return kind.load(source)
    raise SimulationError(
        f"{kind.__name__.lower()}: expected an st.{kind.__name__}, a name or a path,"
        f" found {type(source).__name__}"
    )


def _longest(path: Route, autopilot: Autopilot, max_time: float | None) -> float:
    """Duration at which a flight ends at the latest, s: well beyond the plan and the mission's own limit."""
    if max_time is None:
        planned = _TIMES_PLANNED * path.planned_time + _MARGIN_S
        limit = path.longest + _MARGIN_S if math.isfinite(path.longest) else 0.0
        max_time = max(planned, limit)
    _positive("max_time", max_time, "s")
    if max_time / autopilot.period_s > _MOST_ROWS:
        raise SimulationError(
            f"max_time: expected at most {_MOST_ROWS:.0e} control periods of {autopilot.period_s:g} s, found"
            f" {max_time:g} s; shorten it"
        )
    return float(max_time)


def _positive(name: str, value: float, unit: str) -> None:
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or value <= 0.0:
        raise SimulationError(f"{name}: expected a positive number in {unit}, found {value!r}")


def _vector(name: str, value: ArrayLike) -> tuple[float, float, float]:
    try:
        vector = np.asarray(value, float)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise SimulationError(
            f"{name}: expected three finite numbers, north, east, down in m/s, found {value!r}"
        )
    return float(vector[0]), float(vector[1]), float(vector[2])


def _seabed(value: ArrayLike | None, path: Route) -> tuple[float, float, float] | None:
    """Depth of the bottom and its slopes; a mission along the bottom needs one."""
    if value is None:
        for k, stop in enumerate(path.stops):
            if stop.vertical == "altitude":
                raise SimulationError(
                    f"seabed: leg {k + 1} ({stop.label}) of {path.name} follows the bottom, and there is"
                    " none; give its depth in m"
                )
        return None
    bottom = np.atleast_1d(np.asarray(value, float))
    if bottom.shape == (1,):
        bottom = np.array([bottom[0], 0.0, 0.0])
    if bottom.shape != (3,) or not np.isfinite(bottom).all():
        raise SimulationError(
            f"seabed: expected its depth in m, or (depth, slope north, slope east), found {value!r}"
        )
    depth, north, east = (float(x) for x in bottom)
    there = depth + north * path.start[0] + east * path.start[1]
    if there <= path.start[2]:
        raise SimulationError(
            f"seabed: expected below the start of {path.name} at a depth of {path.start[2]:g} m, found"
            f" {there:g} m"
        )
    return depth, north, east


def _stated(sensor: Sensor) -> dict[str, Any]:
    """What a sensor's table says, in the units of its kind."""
    default = {field.name: field.default for field in fields(sensor)}
    return {name: value for name, value in asdict(sensor).items() if value != default[name]}
