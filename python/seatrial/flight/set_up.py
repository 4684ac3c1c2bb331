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
from seatrial.file_kind import loaded
from seatrial.flight.checked_numbers import (
    checked_list,
    checked_seabed,
    checked_seed,
    checked_step,
    checked_supply,
    checked_vector,
    longest,
    within,
)
from seatrial.flight.circumstances import TURBULENCE_TIMES_S, Circumstances
from seatrial.flight.failures import Fault, Outage, fault_rows, outage_rows
from seatrial.flight.route import Route
from seatrial.flight.sensor_channels import SensorChannels, sensor_channels, sensors_of
from seatrial.flight.surroundings import checked_obstacles, checked_times, checked_turbulence
from seatrial.mission import Mission

if TYPE_CHECKING:
    from seatrial.sensors import Sensor

__all__ = ["SetUp", "Sources", "set_up"]

Array = NDArray[np.float64]
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
