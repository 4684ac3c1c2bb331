"""`NavigationFilter`: motion, current and unmodelled force of a vehicle from its sensors.

An error-state extended Kalman filter in the core, in fixed memory; its process model is the identified
vehicle. Here its sensors, landmarks and noise are checked and told to the core. Theory:
``docs/theory/navigation_filter.md``. Held by ``tests/flight/test_navigation.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import Filter, Vehicle
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError, nearest
from seatrial.base.toml_file import loaded
from seatrial.base.work import takes
from seatrial.flight.checks import (
    FLIGHT_LIMITS,
    checked_bottom,
    checked_times,
    checked_triple,
    checked_turbulence,
    within,
)
from seatrial.flight.disturbances import SeaState
from seatrial.flight.sensor_channels import sensors_of
from seatrial.sensors.sensor import KINDS, Sensor

ACOUSTICS = ("usbl", "altitude", "range", "bearing")
"""Kinds of sensors that only a navigation filter reads; a bearing in degrees, as any angle of a sensor."""

_READ = ("position", "depth", "attitude", "dvl", "gyro", "dvl_water", "gps", "usbl", "range", "bearing")

_TOLD = ("position", "gps", "depth", "attitude", "dvl", "gyro", "dvl_water")

_PERFECT = {
    "position": 0.02,
    "depth": 0.01,
    "attitude": 0.002,
    "dvl": 0.005,
    "gyro": 0.001,
    "dvl_water": 0.005,
}
"""Deviations of a filter's sensors where those of the flight are perfect: m, rad, m/s, rad/s."""


@dataclass(frozen=True)
class Beacon:
    """A transponder at a known place, m: channels ``range.NAME`` in m and ``bearing.NAME`` in rad."""

    north: float
    east: float
    down: float


@dataclass(frozen=True)
class Wall:
    """A known plane through a point (m), its normal `facing` from north over east (rad), of which a sonar
    gives ``range.NAME`` in m at ``bearing.NAME`` in rad.
    """

    north: float
    east: float
    facing: float


@dataclass(frozen=True)
class Pen:
    """A known vertical cylinder (m), a round net or a pile; channels as of a `Wall`."""

    north: float
    east: float
    radius: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ProcessNoise:
    """What moves a vehicle beside its model, as a navigation filter expects it.

    Attributes
    ----------
    force : (6,) array_like, optional
        Standard deviation of the force that the model does not know, N and N m; by default what the vehicle
        file has under ``[model_error]``, as `seatrial.identify` wrote it, else that of 0.03 m/s2 and 0.03
        rad/s2.
    force_time_s : float, optional
        Its time constant; by default that of the file, else 10 s.
    acceleration : (6,) array_like, optional
        Standard deviation of velocity that white noise of acceleration makes in a second, m/s and rad/s;
        by default that of the file, else 0.005.
    current : (3,) array_like, optional
        Standard deviation of the current, north, east, down, m/s.
    current_time_s : float, optional
        Its time constant; 1000 s when omitted.
    turbulence_m_s : float or (3,) array_like
        Standard deviations of its gusts, north, east, down; one number is that of both horizontal ones.
    turbulence_times_s : (float, float)
        Their time constant and that of their second lag, as of `fly`.
    waves : SeaState, optional
        The sea that is expected. Its orbital motion is noise of what is measured against the ground: the
        estimate is that of the motion without it.
    exact_model : bool
        Whether the vehicle is simulated by the model itself. Then the model explains nearly all, and the
        defaults of force, acceleration and current follow from the noise of the sensors.

    Examples
    --------
    >>> import seatrial as st
    >>> st.ProcessNoise(waves=st.SeaState(0.5, 6.0)).exact_model
    False
    """

    force: ArrayLike | None = None
    force_time_s: float | None = None
    acceleration: ArrayLike | None = None
    current: ArrayLike | None = None
    current_time_s: float | None = None
    turbulence_m_s: ArrayLike = 0.0
    turbulence_times_s: tuple[float, float] = FLIGHT_LIMITS.turbulence_times_s
    waves: SeaState | None = None
    exact_model: bool = False

    def numbers(self) -> dict[str, Any]:
        """The same as the core takes it, checked; without the waves."""
        if self.force_time_s is not None:
            within("force_time_s", self.force_time_s, (0.1, 1e5), "s")
        usual = 3e4 if self.exact_model else 1e3
        slow_time = usual if self.current_time_s is None else self.current_time_s
        within("current_time_s", slow_time, (1.0, 1e6), "s")
        gusts = checked_turbulence(self.turbulence_m_s, "turbulence_m_s")
        if not (self.waves is None or isinstance(self.waves, SeaState)):
            raise SimulationError(
                f"waves: expected st.SeaState(height_m, period_s, toward_deg=...), found {self.waves!r}"
            )
        current = _positive("current", self.current, 3)
        return {
            "force": _positive("force", self.force, 6),
            "force_time_s": self.force_time_s,
            "acceleration": _positive("acceleration", self.acceleration, 6),
            "current": np.array([0.2, 0.2, 0.02]) if current is None else current,
            "current_time_s": slow_time,
            "gusts": (*gusts, *checked_times(self.turbulence_times_s)),
            "gyro_walk": 1e-6,
            "exact_model": self.exact_model,
        }


USUAL_NOISE = ProcessNoise()
"""The model error of the vehicle file, a slow current, no gusts and no waves."""


@dataclass(frozen=True, kw_only=True)
class SampleGate:
    """Which samples a navigation filter believes.

    Attributes
    ----------
    deviations : float
        Of an innovation, beyond which a sample is refused.
    patience_s : float
        Time of refusals without a break after which a sensor is believed again.
    longest_age_s : float
        How much later than its latency a sample may be; with the largest latency it says what is kept.

    Examples
    --------
    >>> import seatrial as st
    >>> st.SampleGate(patience_s=10.0).deviations
    5.0
    """

    deviations: float = 5.0
    patience_s: float = 5.0
    longest_age_s: float = 0.5

    def numbers(self) -> dict[str, Any]:
        """The same as the core takes it, checked."""
        within("gate", self.deviations, (1.0, 1000.0), "standard deviations")
        within("patience_s", self.patience_s, (0.1, 3600.0), "s")
        within("longest_age_s", self.longest_age_s, (0.0, 60.0), "s")
        return {
            "gate": (float(self.deviations), float(self.patience_s)),
            "longest_age_s": float(self.longest_age_s),
        }


USUAL_GATE = SampleGate()
"""Five deviations, five seconds, half a second."""


class NavigationFilter:
    """Navigation filter of a vehicle, one step at a time: a measurement in, an estimate out.

    Parameters
    ----------
    vehicle : Vehicle, str or Path
        The process model: the identified vehicle.
    sensors : mapping of str to Sensor, str or Path, optional
        By kind, "typical", or a file with ``[sensors.KIND]`` tables: noise, offset, digits, latency and
        lever arm; of the kinds in `ACOUSTICS` too. Good sensors of every kind when omitted.
    period_s : float, optional
        Time of a step.
    landmarks : mapping of str to Beacon, Wall or Pen, optional
        Known places that acoustic sensors see.
    seabed : float or (3,) array_like, optional
        Depth of the bottom, m, and its slopes north and east: what the altitude is measured to.
    tilt : mapping of str to (3,) array_like, optional
        Roll, pitch and yaw of a sensor's mounting by kind, rad.
    start : (3,) array_like, optional
        Where the vehicle begins unless a sensor says it: north, east, down, m.
    start_deviation_m : float, optional
        Standard deviation of that.
    noise : ProcessNoise, optional
        What moves the vehicle beside its model.
    gate : SampleGate, optional
        Which samples are believed.

    Raises
    ------
    VehicleError, SimulationError, TrialError
        The vehicle, a number or a sensor is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> filter = st.NavigationFilter("cwolf", period_s=0.1)
    >>> filter.waiting_for
    ['roll', 'pitch', 'yaw']
    >>> told = filter.step({"roll": 0.0, "pitch": 0.0, "yaw": 1.0, "x": 5.0, "y": 2.0, "z": 1.0})
    >>> round(told["x"], 1), filter.waiting_for
    (5.0, [])
    """

    @takes(noise=ProcessNoise, gate=SampleGate)
    def __init__(
        self,
        vehicle: Vehicle | str | Path,
        sensors: Mapping[str, Sensor] | str | Path | None = None,
        *,
        period_s: float = 0.1,
        landmarks: Mapping[str, Beacon | Wall | Pen] | None = None,
        seabed: ArrayLike | None = None,
        tilt: Mapping[str, ArrayLike] | None = None,
        start: ArrayLike = (0.0, 0.0, 0.0),
        start_deviation_m: float = 1.0,
        noise: ProcessNoise = USUAL_NOISE,
        gate: SampleGate = USUAL_GATE,
    ) -> None:
        self._vehicle: Vehicle = loaded(Vehicle, vehicle)
        within("period_s", period_s, (1e-3, 10.0), "s")
        within("start_deviation_m", start_deviation_m, (1e-3, 1e5), "m")
        self._period_s = float(period_s)
        numbers = noise.numbers() | gate.numbers()
        place = checked_triple("start", start, "north, east, down in m")
        self._stated: dict[str, Any] = {
            "instruments": _instruments(sensors, self._vehicle, tilt or {}),
            "landmarks": _landmarks(landmarks or {}),
            "bottom": None if seabed is None else _bottom(seabed),
            "start": (*place, float(start_deviation_m)),
            **numbers,
        }
        self._waves = None if noise.waves is None else noise.waves.row
        self._core = Filter(self._vehicle, period_s=self._period_s, waves=self._waves, **self._stated)

    @property
    def core(self) -> Filter:
        """The filter of the core."""
        return self._core

    @property
    def vehicle(self) -> Vehicle:
        """Its process model."""
        return self._vehicle

    @property
    def period_s(self) -> float:
        """Time of a step, s."""
        return self._period_s

    @property
    def stated(self) -> dict[str, Any]:
        """Numbers by name that the core's filter is made of, SI and rad, besides model, period and waves."""
        return dict(self._stated)

    def to_dict(self) -> dict[str, Any]:
        """All that it is made of besides its model, as plain data; ``waves`` as a row of the core."""
        instruments = [[kind, list(row)] for kind, row in self._stated["instruments"].items()]
        waves = None if self._waves is None else list(self._waves)
        numbers = {name: _listed(value) for name, value in self._stated.items()}
        numbers["gusts"] = [numbers["gusts"][:3], numbers["gusts"][3:]]
        return {"period_s": self._period_s, "waves": waves, "numbers": numbers | {"instruments": instruments}}

    def step(
        self,
        measurement: Mapping[str, Any],
        commands: Mapping[str, Any] | None = None,
        signals: Mapping[str, Any] | None = None,
        *,
        ages: Mapping[str, Any] | None = None,
        time_s: float | None = None,
        dt_s: float | None = None,
    ) -> dict[str, float]:
        """Estimate {channel: value} of now, SI and rad, over ground and through the water.

        First the vehicle moves for the time since the last step, under the commands that have held during
        it; then the samples correct the estimate: the order of the exported C. In a control loop the
        commands are thus those that the helm gave after the last step. Empty until roll, pitch and yaw have
        been measured once.

        Parameters
        ----------
        measurement : mapping of str to float
            What arrived since the last step, by channel: those of `Autopilot.engage` in m, rad, m/s and
            rad/s, gps_x, gps_y, usbl_x, usbl_y, usbl_z in m, range.NAME and bearing.NAME of a landmark, and
            voltage in V. A missing channel or nan was not measured; what is impossible was not either, and
            is counted.
        commands : mapping of str to float, optional
            Commands of the actuators, each in its own unit, that have held since the last step; as before
            where none is given.
        signals : mapping of str to float, optional
            What the actuators are measured at now, at the end of the step, in the unit of their commands.
        ages : mapping of str to float, optional
            How much later than its sensor's latency a sample has come, s.
        time_s, dt_s : float, optional
            When the step is, s on a clock that runs forward, or how long after the last one; a period
            without either.

        Raises
        ------
        SimulationError
            An unknown name, what is no number, or a time that does not advance; nothing of such a call is
            taken.

        Examples
        --------
        >>> helm, commands = st.Autopilot.load("cwolf").engage("cwolf", MISSION), None  # doctest: +SKIP
        >>> while not helm.finished:  # doctest: +SKIP
        ...     estimate = filter.step(samples(), commands)
        ...     commands = helm.step(estimate)
        """
        estimate: dict[str, float] = self._core.step(
            measurement, commands, signals, ages=ages, time_s=time_s, dt_s=dt_s
        )
        return estimate

    @property
    def waiting_for(self) -> list[str]:
        """Channels that must be measured before the filter begins."""
        return list(self._core.waiting_for)

    @property
    def channels(self) -> list[str]:
        """Names of all channels that a step takes, besides voltage."""
        return list(self._core.channels)

    @property
    def state(self) -> dict[str, Array]:
        """Force (6,) in N and N m, body frame, current (3,) in m/s, NED, gyro_bias (3,) in rad/s.

        Besides the standard deviation of every part of the state, as ``position_deviation`` (3,) and so on,
        with the constant offsets of the sensors; ``attitude_quaternion`` (4,).
        """
        return dict(self._core.state)

    @property
    def covariance(self) -> Array:
        """Covariance (24, 24), SI, of position, attitude, velocity, force, current, gyro bias."""
        return np.asarray(self._core.covariance)

    @property
    def consistency(self) -> dict[str, tuple[float, float, float, int]]:
        """Per channel the mean normalised innovation squared, its 95 % band and the samples."""
        return {
            name: (row[3], row[4], row[5], int(row[0])) for name, row in self._core.watches.items() if row[0]
        }

    @property
    def refused(self) -> dict[str, tuple[int, str]]:
        """Per channel the samples that were not believed, and why."""
        refusals = {}
        for name, (_, jumps, recovered, _, _, _, _, impossible) in self._core.watches.items():
            reasons = [
                text
                for count, text in (
                    (impossible, f"{impossible:.0f} impossible"),
                    (jumps, f"{jumps:.0f} beyond the gate"),
                    (recovered, f"believed again {recovered:.0f} times after long refusal"),
                )
                if count
            ]
            if reasons:
                refusals[name] = (int(jumps + impossible), ", ".join(reasons))
        return refusals

    @property
    def restarts(self) -> int:
        """How often the filter began anew: lost its lock, a pause beyond a minute, or no sound numbers."""
        return int(self._core.restarts)

    def summary(self) -> str:
        """Lines for a person: consistency and refusals of every channel.

        Examples
        --------
        >>> NavigationFilter("cwolf").summary()
        'no sample has been taken'
        """
        lines = []
        for name, (mean, low, high, count) in self.consistency.items():
            verdict = "consistent" if low <= mean <= high else "too careful" if mean < low else "too sure"
            lines.append(
                f"{name}: mean normalised innovation squared {mean:.2f} (95 % band {low:.2f} to {high:.2f},"
                f" {count} samples): {verdict}"
            )
        lines += [f"{name}: refused {count}: {why}" for name, (count, why) in self.refused.items()]
        return "\n".join(lines) or "no sample has been taken"

    def __repr__(self) -> str:
        return f"NavigationFilter('{self._vehicle.name}')"


def checked_navigation(navigation: Any) -> str | NavigationFilter:
    """What the autopilot of a flight goes by: "sensors", "filter", or a filter of the caller's making."""
    if isinstance(navigation, NavigationFilter) or navigation in ("sensors", "filter"):
        return navigation if isinstance(navigation, NavigationFilter) else str(navigation)
    raise SimulationError(
        f'navigation: expected "sensors", "filter" or an st.NavigationFilter, found {navigation!r}'
    )


def _listed(value: Any) -> Any:
    """Arrays and tuples as lists."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_listed(item) for item in value] if isinstance(value, list | tuple) else value


def filter_of(
    navigation: str | NavigationFilter,
    model: Vehicle,
    sensors: Mapping[str, Sensor] | None,
    period_s: float,
    *,
    landmarks: Sequence[Mapping[str, Any]] = (),
    waves: SeaState | None = None,
    gusts: tuple[tuple[float, float, float], tuple[float, float]] = (
        (0.0, 0.0, 0.0),
        FLIGHT_LIMITS.turbulence_times_s,
    ),
    exact: bool = False,
) -> NavigationFilter | None:
    """Filter for flights on the vehicle that the autopilot believes in; None for what the sensors show. It
    knows the landmarks and is told of the waves, of deviations (m/s) and time constants (s) of the gusts,
    and whether the vehicle is simulated by the model itself (`exact`).
    """
    if isinstance(navigation, NavigationFilter):
        return navigation
    if navigation == "sensors":
        return None
    shared: dict[str, Any] = {
        "period_s": period_s,
        "noise": ProcessNoise(
            turbulence_m_s=gusts[0], turbulence_times_s=gusts[1], waves=waves, exact_model=exact
        ),
        "gate": SampleGate(longest_age_s=0.0),
        "landmarks": {str(mark["name"]): _landmark(mark) for mark in landmarks},
    }
    # Perfect sensors know where the flight begins.
    if sensors is None:
        return NavigationFilter(model, start_deviation_m=0.02, **shared)
    gps = sensors.get("gps")
    aboard = {kind: _in_step(kind, sensor, period_s) for kind, sensor in sensors.items() if kind in _READ}
    tilt = {kind: sensor.tilt for kind, sensor in aboard.items() if KINDS[kind].aboard and any(sensor.tilt)}
    # The start is as uncertain as a fix: its offset, and at least 5 cm.
    deviation = max(0.05, 0.0 if gps is None else gps.bias)
    return NavigationFilter(model, aboard, start_deviation_m=deviation, tilt=tilt, **shared)


def _in_step(kind: str, sensor: Sensor, period_s: float) -> Sensor:
    """The sensor as a closed loop has it: late by whole control periods; at O, but for acoustics and GPS."""
    placed = KINDS[kind].aboard or kind == "gps"
    late = round(sensor.latency_s / period_s) * period_s
    return replace(sensor, position=sensor.position if placed else (0.0, 0.0, 0.0), latency_s=late)


def _landmark(mark: Mapping[str, Any]) -> Beacon | Wall | Pen:
    """Landmark of a table of a mission file."""
    north, east = float(mark["north_m"]), float(mark["east_m"])
    if mark["kind"] == "beacon":
        return Beacon(north, east, float(mark["depth_m"]))
    if mark["kind"] == "wall":
        return Wall(north, east, math.radians(mark["facing_deg"]))
    return Pen(north, east, float(mark["radius_m"]))


def _instruments(
    sensors: Mapping[str, Sensor] | str | Path | None, vehicle: Vehicle, tilt: Mapping[str, ArrayLike]
) -> dict[str, tuple[float, ...]]:
    """Per kind noise, offset, latency, lever arm and mounting, SI."""
    if sensors is None:
        sensors = {}
        rows = {kind: (noise, 0.0, 0.0, 0.0, 0.0, 0.0) for kind, noise in _PERFECT.items()}
        rows |= {"gps": (1.0, 1.0, 0.0, 0.0, 0.0, 0.0), "usbl": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)}
        rows |= {"altitude": (0.1, 0.0, 0.0, 0.0, 0.0, 0.0), "range": (0.3, 0.0, 0.0, 0.0, 0.0, 0.0)}
        rows |= {"bearing": (0.05, 0.0, 0.0, 0.0, 0.0, 0.0)}
    else:
        own: dict[str, Sensor] = {}
        if isinstance(sensors, Mapping):
            own = {kind: sensor for kind, sensor in sensors.items() if kind in ACOUSTICS}
            sensors = {kind: sensor for kind, sensor in sensors.items() if kind not in ACOUSTICS}
        known = sensors_of(sensors, vehicle) or {} if sensors else {}
        rows = {}
        for kind, sensor in {**known, **own}.items():
            if kind not in (*_TOLD, *ACOUSTICS):
                continue
            if not isinstance(sensor, Sensor):
                raise SimulationError(f"sensors: {kind}: expected a Sensor, found {sensor!r}")
            degrees = kind in KINDS and KINDS[kind].unit.startswith("deg")
            scale = math.pi / 180.0 if degrees else 1.0
            # Rounding to a quantum errs uniformly, with a deviation of quantum / sqrt(12).
            noise = scale * math.hypot(sensor.noise, sensor.quantum / math.sqrt(12.0))
            floor = _PERFECT.get(kind, 0.01) * 0.05
            rows[kind] = (max(noise, floor), scale * sensor.bias, sensor.latency_s, *sensor.position)
    for kind in tilt:
        if kind not in rows:
            raise SimulationError(f'tilt: the vehicle has no sensor "{kind}"{nearest(kind, rows)}')
    level = (0.0, 0.0, 0.0)
    return {
        kind: (*row, *checked_triple(f"tilt: {kind}", tilt.get(kind, level), "roll, pitch, yaw in rad"))
        for kind, row in rows.items()
    }


def _landmarks(landmarks: Mapping[str, Beacon | Wall | Pen]) -> list[tuple[str, str, list[float]]]:
    """Name, kind and numbers of each."""
    rows: list[tuple[str, str, list[float]]] = []
    for name, mark in landmarks.items():
        if not isinstance(mark, Beacon | Wall | Pen):
            raise SimulationError(f"landmarks: {name}: expected a Beacon, Wall or Pen, found {mark!r}")
        numbers = list(vars(mark).values())
        if not all(isinstance(x, int | float) and math.isfinite(x) for x in numbers):
            raise SimulationError(f"landmarks: {name}: expected finite numbers, found {mark!r}")
        if isinstance(mark, Beacon):
            rows.append((name, "beacon", [mark.north, mark.east, mark.down]))
        elif isinstance(mark, Wall):
            cosine, sine = math.cos(mark.facing), math.sin(mark.facing)
            rows.append((name, "wall", [cosine, sine, 0.0, mark.north * cosine + mark.east * sine]))
        else:
            within(f"landmarks: {name}: radius", mark.radius, (0.01, 1e5), "m")
            rows.append((name, "pen", [mark.north, mark.east, mark.radius]))
    return rows


def _bottom(seabed: ArrayLike) -> tuple[float, float, float, float]:
    """Unit normal and offset of the bottom's plane."""
    depth, north, east = checked_bottom(seabed)
    normal = np.array([-north, -east, 1.0])
    size = float(np.linalg.norm(normal))
    return (-north / size, -east / size, 1.0 / size, depth / size)


def _positive(name: str, values: ArrayLike | None, count: int) -> Array | None:
    if values is None:
        return None
    array = np.asarray(values, float)
    if array.shape != (count,) or not (np.isfinite(array).all() and (array >= 0.0).all()):
        raise SimulationError(f"{name}: expected {count} standard deviations from zero on, found {values!r}")
    return array
