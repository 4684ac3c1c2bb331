"""The payload of a flight: sensors of the water, their samples along the track and at every stop.

A payload file names the water (`seatrial.flight.water`) and the sensors. Each sensor follows the water at
the vehicle with its response time, a first-order lag, and is logged with noise and an offset, together with
the position that the vehicle was told and its standard deviation. The payload has no effect on the flight.
Held by ``tests/flight/test_payload.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.plain import Plain
from seatrial.base.toml_file import NotNegative, Number, Positive, Section, checked, tables, text_of
from seatrial.flight.metrics import distance_to_stop
from seatrial.flight.water import CHANNELS, SLOWEST_M_S, Plume, Profile, properties

if TYPE_CHECKING:
    import polars as pl

    from seatrial.flight.log import FlightLog

Rows = NDArray[np.intp]


class _Sensor(Section):
    response_s: NotNegative = 0.0
    noise: NotNegative = 0.0
    bias: Number = 0.0


class _Sensors(Section):
    nitrate: _Sensor = Field(default_factory=lambda: _Sensor(response_s=5.0, noise=0.03))
    density: _Sensor = Field(default_factory=lambda: _Sensor(response_s=1.0, noise=0.02))
    conductivity: _Sensor = Field(default_factory=lambda: _Sensor(response_s=0.5, noise=0.001))
    salinity: _Sensor = Field(default_factory=lambda: _Sensor(response_s=1.0, noise=0.01))


class _File(Section):
    format: Literal[1]
    description: str = ""
    rate_hz: Positive = 1.0
    water: Profile
    plumes: list[Plume] = Field(default_factory=list)
    sensors: _Sensors = Field(default_factory=_Sensors)


@dataclass(frozen=True)
class Payload:
    """Water and sensors of a payload file.

    `text`: the file. `rate_hz`: samples a second, of all sensors. `water`, `plumes`: background and sources.
    `response_s`, `noise`, `bias`: by `CHANNELS`, (4,): time constant in s, and in the unit of the channel the
    standard deviation and the offset.

    Examples
    --------
    >>> payload = Payload.from_toml('''
    ... format = 1
    ... [water]
    ... nitrate_mg_l = 0.3
    ... salinity = 33.0
    ... temperature_c = 9.0
    ... ''')
    >>> payload.rate_hz, payload.response_s.tolist()
    (1.0, [5.0, 1.0, 0.5, 1.0])
    """

    text: str
    rate_hz: float
    water: Profile
    plumes: tuple[Plume, ...]
    response_s: Array
    noise: Array
    bias: Array

    @classmethod
    def load(cls, path: str | Path) -> Payload:
        """Payload of a file.

        Raises SimulationError where the file cannot be read, or a key or value is wrong.
        """
        return cls.from_toml(text_of(path, "a payload file", error=SimulationError), str(path))

    @classmethod
    def from_toml(cls, text: str, source: str = "<text>") -> Payload:
        """Payload of the text of a payload file; `source` is what to call it in messages.

        Raises SimulationError where a key or value is wrong.
        """
        file = checked(_File, tables(text, source, error=SimulationError), source, error=SimulationError)
        sensors = (
            file.sensors.nitrate,
            file.sensors.density,
            file.sensors.conductivity,
            file.sensors.salinity,
        )
        return cls(
            text,
            file.rate_hz,
            file.water,
            tuple(file.plumes),
            *(np.array([getattr(s, key) for s in sensors]) for key in ("response_s", "noise", "bias")),
        )

    def check_current(self, current: Sequence[float]) -> None:
        """Refuse plumes in still water; `current` in m/s, north and east first.

        Raises SimulationError where it is slower than `SLOWEST_M_S`.
        """
        speed = math.hypot(*current[:2])
        if self.plumes and speed < SLOWEST_M_S:
            raise SimulationError(
                f"payload: plumes: expected a current of at least {SLOWEST_M_S:g} m/s that they drift with,"
                f" found {speed:g} m/s; give one (--current NORTH EAST DOWN)"
            )


@dataclass(frozen=True)
class Value:
    """Mean of samples and their standard deviation."""

    mean: float
    deviation: float


@dataclass(frozen=True)
class StopSamples(Plain, without="position values"):
    """Samples of one stop: those taken in the water that the stop is to sample.

    `label`: of the stop; "under way" for all samples between stops. `begin_s`, `end_s`, `count`: of the
    samples; NaN, NaN and 0 where none counts. `on_the_way`, `unsettled`: samples that are left out: taken
    while the vehicle kept station but had not reached the stop, in three dimensions, and after that before
    its depth and, where the stop is long enough, its sensors settled. `sensors_settled`: whether those that
    count begin three response times of the slowest sensor after the vehicle settled. `position`: north, east,
    depth as the vehicle was told, m; the deviation is that of its navigation. `values`: by `CHANNELS`; the
    deviation is that of the samples.
    """

    label: str
    begin_s: float
    end_s: float
    count: int
    on_the_way: int
    unsettled: int
    sensors_settled: bool
    position: tuple[Value, Value, Value]
    values: Mapping[str, Value]

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""
        places = zip(("north_m", "east_m", "depth_m"), self.position, strict=True)
        columns = {**dict(places), **self.values}
        return super().to_dict() | {name: asdict(value) for name, value in columns.items()}


UNDER_WAY = "under way"


@dataclass(frozen=True)
class PayloadSettings:
    """When the samples of a stop count."""

    #: Response times after which a first-order sensor shows 95 % of a change of the water.
    response_times: float = 3.0
    #: Time over which the depth is steady at a stop, s: about the period of usual waves, which average out.
    steady_s: float = 6.0
    #: Largest difference of the mean depths in both halves of that time, m: three times a gauge's noise.
    steady_m: float = 0.1
    #: Stream of the payload's noise, apart from those of the flight.
    stream: int = 0x9A710AD


SETTINGS = PayloadSettings()


class Phase(IntEnum):
    """Where a sample stands at its stop."""

    ON_THE_WAY = 0
    """The stop is not reached yet."""
    UNSETTLED = 1
    """It is reached, but depth or sensors still change."""
    SETTLED = 2
    """A sample of the stop."""


@dataclass(frozen=True, eq=False)
class Samples:
    """What a payload logged on a flight.

    Attributes
    ----------
    payload
        Water and sensors.
    t
        Times, (n,), s.
    rows
        Rows of the flight's log, (n,).
    position, deviation
        North, east, depth as the vehicle was told, and their standard deviations, (n, 3), m.
    values, true
        `CHANNELS` as measured, and of the water at the vehicle, (n, 4).
    stop
        Label of the stop at which each was taken, "" under way.
    phase
        What each is at its stop: a `Phase`; ``ON_THE_WAY`` without a stop.
    """

    payload: Payload
    t: Array
    rows: Rows
    position: Array
    deviation: Array
    values: Array
    true: Array
    stop: tuple[str, ...]
    phase: Rows

    def table(self) -> pl.DataFrame:
        """A row per sample: time, stop, whether it counts there, position, channels, deviations, truth."""
        import polars as pl

        instrument = np.hypot(self.payload.noise, self.payload.bias)
        columns: dict[str, Any] = {
            "t_s": np.round(self.t, 9),
            "stop": list(self.stop),
            "settled": self.phase == Phase.SETTLED,
        }
        for k, name in enumerate(("north", "east", "depth")):
            columns |= {f"{name}_m": self.position[:, k], f"{name}_deviation_m": self.deviation[:, k]}
        for k, name in enumerate(CHANNELS):
            columns |= {name: self.values[:, k], f"deviation.{name}": np.full(len(self.t), instrument[k])}
        return pl.DataFrame(columns | {f"true.{name}": self.true[:, k] for k, name in enumerate(CHANNELS)})

    def log_columns(self, rows: int) -> dict[str, Array]:
        """Channels as columns of a log of so many rows; NaN between samples."""
        columns = np.full((rows, len(CHANNELS)), np.nan)
        columns[self.rows] = self.values
        return {f"payload.{name}": columns[:, k] for k, name in enumerate(CHANNELS)}

    @property
    def settling_s(self) -> float:
        """Time after which the slowest sensor shows the water at a stop, s."""
        return SETTINGS.response_times * float(self.payload.response_s.max())

    @property
    def stops(self) -> tuple[StopSamples, ...]:
        """Samples of every stop in the order of the flight, and last those under way."""
        labels = np.array(self.stop)
        summaries = []
        for label in [*dict.fromkeys(name for name in self.stop if name), ""]:
            at = labels == label
            if np.any(at):
                left_out = [
                    int((at & (self.phase == phase)).sum()) for phase in (Phase.ON_THE_WAY, Phase.UNSETTLED)
                ]
                rows = np.flatnonzero(at & (self.phase == Phase.SETTLED)) if label else np.flatnonzero(at)
                summaries.append(self._summary(label or UNDER_WAY, rows, *(left_out if label else (0, 0))))
        return tuple(summaries)

    def _summary(self, label: str, rows: Rows, on_the_way: int, unsettled: int) -> StopSamples:
        later = rows[self.t[rows] >= self.t[rows[0]] + self.settling_s] if len(rows) else rows
        sensors_settled = label == UNDER_WAY or len(later) > 1
        if label != UNDER_WAY and sensors_settled:
            unsettled += len(rows) - len(later)
            rows = later
        nothing = Value(math.nan, math.nan)
        position, values, times = [nothing] * 3, dict.fromkeys(CHANNELS, nothing), (math.nan, math.nan)
        if len(rows):
            measured, places, off = self.values[rows], self.position[rows], self.deviation[rows]
            position = [Value(float(places[:, k].mean()), float(off[:, k].mean())) for k in range(3)]
            values = {
                name: Value(float(measured[:, k].mean()), float(measured[:, k].std()))
                for k, name in enumerate(CHANNELS)
            }
            times = float(self.t[rows[0]]), float(self.t[rows[-1]])
        north, east, depth = position
        place = north, east, depth
        return StopSamples(label, *times, len(rows), on_the_way, unsettled, sensors_settled, place, values)

    def to_dict(self) -> dict[str, Any]:
        """Stops as plain data; the samples are in the table."""
        return {"samples": len(self.t), "stops": [stop.to_dict() for stop in self.stops]}


def sampled(payload: Payload, flight: FlightLog, errors: Array) -> Samples:
    """Samples that a payload takes on a flight.

    `payload`: water and sensors. `flight`: its log; the plume drifts with the mean current, and the noise
    goes by the seed of its circumstances. `errors`: of the navigation's channels: noise, offset, random walk
    after one second and digit, (16, 4), see `seatrial.flight.sensor_channels.SensorChannels`. Raises
    SimulationError: a plume has no current that it drifts with.
    """
    current = flight.circumstances.current
    payload.check_current(current)
    count = int(np.isfinite(flight.position).all(axis=1).sum())  # a diverged flight has a last row
    water = properties(payload.water, payload.plumes, flight.position[:count], current)
    follows = np.column_stack([
        _lagged(water[:, k], payload.response_s[k], flight.period_s) for k in range(len(CHANNELS))
    ])
    every = max(1, round(1.0 / (payload.rate_hz * flight.period_s)))
    rows = np.arange(0, count, every)
    noise = np.random.default_rng([flight.circumstances.seed, SETTINGS.stream]).standard_normal((
        len(rows),
        len(CHANNELS),
    ))
    perceived = np.column_stack([
        _held(flight.measured[name][:count], flight.position[0, k]) for k, name in enumerate("xyz")
    ])
    at = errors[:3]
    variance = at[:, 0] ** 2 + at[:, 1] ** 2 + at[:, 3] ** 2 / 12.0 + at[:, 2] ** 2 * flight.t[rows, None]
    labels, phase = _stops(flight, count)
    return Samples(
        payload,
        flight.t[rows],
        rows,
        perceived[rows],
        np.sqrt(variance),
        follows[rows] + payload.bias + payload.noise * noise,
        water[rows],
        tuple(labels[row] for row in rows),
        phase[rows],
    )


def _stops(flight: FlightLog, count: int) -> tuple[list[str], Rows]:
    """Label of the stop at which the vehicle keeps station, "" elsewhere, and its phase, of `count` rows.

    A stop is reached as a waypoint is: within its acceptance radius in three dimensions, as the vehicle was
    told. Guidance keeps station as soon as the vehicle is near in the plane, and dives from there. A row is
    settled where the vehicle has been at the stop for ``steady_s`` and its depth has not drifted.
    """
    stops = flight.route.stops
    leg = np.clip(flight.leg[:count], 0, len(stops) - 1)
    perceived = np.column_stack([
        _held(flight.measured[name][:count], flight.position[0, k]) for k, name in enumerate("xyz")
    ])
    altitude = _held(flight.measured["altitude"][:count], math.inf)
    half = max(1, round(0.5 * SETTINGS.steady_s / flight.period_s))
    depth = np.concatenate([[0.0], np.cumsum(perceived[:, 2])])
    drift = np.full(count, np.inf)
    drift[2 * half - 1 :] = np.abs(depth[2 * half :] - 2.0 * depth[half:-half] + depth[: -2 * half]) / half
    labels, phase = [""] * count, np.full(count, Phase.ON_THE_WAY)
    for k, stop in enumerate(stops):
        rows = np.flatnonzero((leg == k) & flight.holding[:count])
        if stop.task != "hold" or not len(rows):
            continue
        inside = distance_to_stop(flight, k, perceived[rows], altitude[rows]) <= stop.acceptance
        for row in rows:
            labels[row] = stop.label
        phase[rows[np.cumsum(inside) > 0]] = Phase.UNSETTLED
        last_outside = np.maximum.accumulate(np.where(inside, rows[0] - 1, rows))
        phase[rows[(rows - last_outside > 2 * half) & (drift[rows] <= SETTINGS.steady_m)]] = Phase.SETTLED
    return labels, phase


def _lagged(x: Array, constant_s: float, period_s: float) -> Array:
    """Answer (n,) of a first-order lag to samples at a period, begun at rest."""
    from scipy.signal import lfilter

    if constant_s <= 0.0 or not len(x):
        return x
    kept = math.exp(-period_s / constant_s)
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], x, zi=[kept * x[0]])[0])


def _held(x: Array, first: float) -> Array:
    """Samples (n,) held over rows without one."""
    last = np.maximum.accumulate(np.where(np.isfinite(x), np.arange(len(x)), -1))
    return np.where(last >= 0, x[np.maximum(last, 0)], first)
