"""The payload of a flight: sensors of the water, their samples along the track and at every stop.

A payload file names the water and the sensors. Each sensor follows the water at the vehicle with its response
time, a first-order lag, and is logged with noise and an offset, together with the position that the vehicle
was told and its standard deviation. The payload has no effect on the flight.

Effluent mixes in proportion: at a share f of it, nitrate, salinity and temperature are
``ambient + f (effluent - ambient)``. A steady plume of a source Q in a current U drifts along x and spreads
across it,

f = Q / (2 pi U s_y s_z) exp(-y^2 / 2 s_y^2) (exp(-(z - z_0)^2 / 2 s_z^2) + exp(-(z + z_0)^2 / 2 s_z^2))

with s_y^2 = width^2 + 2 K_h x / U, s_z^2 = height^2 + 2 K_v x / U and the surface as a mirror. Diffusion
along the current and the bottom are left out; upstream of the source the plume falls off over its width.

Sources: Fischer and others, Mixing in Inland and Coastal Waters (1979), chapter 2; density: Millero and
Poisson, Deep-Sea Research 28A (1981), at one atmosphere; conductivity: the Practical Salinity Scale 1978
(Fofonoff and Millard, UNESCO Technical Papers in Marine Science 44, 1983). Held by
``tests/flight/test_payload.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.plain import Plain
from seatrial.base.toml_file import NotNegative, Number, Positive, Section, checked, tables, text_of
from seatrial.flight.metrics import distance_to_stop

if TYPE_CHECKING:
    import polars as pl

    from seatrial.flight.log import FlightLog


CHANNELS = {
    "nitrate_mg_l": "mg/L",
    "density_kg_m3": "kg/m3",
    "conductivity_s_m": "S/m",
    "salinity_pss": "PSS-78",
}
"""What the payload measures, and the unit of each."""

SLOWEST_M_S = 0.01
"""Slowest current in which a plume is steady within hours."""


class Profile(Section):
    """Nitrate in mg/L, practical salinity and temperature in deg C at the surface, and their change per m of
    depth.
    """

    nitrate_mg_l: NotNegative
    salinity: NotNegative
    temperature_c: Number
    nitrate_per_m: Number = 0.0
    salinity_per_m: Number = 0.0
    temperature_per_m: Number = 0.0

    def at(self, depth: Array) -> Array:
        """Nitrate, salinity and temperature, (n, 3), at depths (n,) in m."""
        surface = np.array([self.nitrate_mg_l, self.salinity, self.temperature_c])
        slope = np.array([self.nitrate_per_m, self.salinity_per_m, self.temperature_per_m])
        return np.asarray(surface + np.maximum(depth, 0.0)[:, None] * slope)


class Plume(Section):
    """A source of effluent at a place, discharge in m3/s: standard deviations of the plume at the source
    across the current and in depth, m, and turbulent diffusivities, m2/s.
    """

    north_m: Number
    east_m: Number
    depth_m: NotNegative
    discharge_m3_s: Positive
    nitrate_mg_l: NotNegative
    salinity: NotNegative
    temperature_c: Number
    width_m: Positive = 2.0
    height_m: Positive = 1.0
    horizontal_m2_s: NotNegative = 0.05
    vertical_m2_s: NotNegative = 1e-3

    def share(self, places: Array, current: ArrayLike) -> Array:
        """Share of effluent in the water, (n,), 0 to 1, at places (n, 3), m, NED, in a current of
        `SLOWEST_M_S` or more.
        """
        flow = np.asarray(current, float)[:2]
        speed = float(np.hypot(*flow))
        along = flow / speed
        away = places[:, :2] - [self.north_m, self.east_m]
        x, y = away @ along, away @ [-along[1], along[0]]
        z = places[:, 2]
        drifted = np.maximum(x, 0.0) / speed
        s_y = np.sqrt(self.width_m**2 + 2.0 * self.horizontal_m2_s * drifted)
        s_z = np.sqrt(self.height_m**2 + 2.0 * self.vertical_m2_s * drifted)
        across = np.exp(-0.5 * (y / s_y) ** 2 - 0.5 * (np.minimum(x, 0.0) / self.width_m) ** 2)
        mirrored = (-0.5 * ((z + sign * self.depth_m) / s_z) ** 2 for sign in (-1.0, 1.0))
        down = np.sum([np.exp(exponent) for exponent in mirrored], axis=0)
        return np.asarray(
            np.minimum(self.discharge_m3_s * across * down / (2.0 * np.pi * speed * s_y * s_z), 1.0)
        )


def properties(profile: Profile, plumes: Sequence[Plume], places: Array, current: ArrayLike) -> Array:
    """`CHANNELS` of the water at places (n, 3), north, east, down in m, as columns (n, 4)."""
    mixed = profile.at(places[:, 2])
    for plume in plumes:
        effluent = np.array([plume.nitrate_mg_l, plume.salinity, plume.temperature_c])
        mixed = mixed + plume.share(places, current)[:, None] * (effluent - mixed)
    nitrate, salinity, temperature = mixed.T
    return np.column_stack([
        nitrate,
        density(salinity, temperature),
        conductivity(salinity, temperature, np.maximum(places[:, 2], 0.0)),
        salinity,
    ])


def density(salinity: Array, temperature: Array) -> Array:
    """Density of sea water in kg/m3 at one atmosphere, of practical salinity and deg C, (n,).

    Examples
    --------
    >>> density(np.array([0.0, 35.0, 35.0]), np.array([5.0, 5.0, 25.0])).round(5).tolist()
    [999.96675, 1027.67547, 1023.34306]
    """
    s, t = np.asarray(salinity, float), np.asarray(temperature, float)
    fresh = polyval(t, [999.842594, 6.793952e-2, -9.09529e-3, 1.001685e-4, -1.120083e-6, 6.536332e-9])
    a = polyval(t, [8.24493e-1, -4.0899e-3, 7.6438e-5, -8.2467e-7, 5.3875e-9])
    b = polyval(t, [-5.72466e-3, 1.0227e-4, -1.6546e-6])
    return np.asarray(fresh + a * s + b * s**1.5 + 4.8314e-4 * s**2)


def conductivity(salinity: Array, temperature: Array, depth: Array) -> Array:
    """Conductivity of sea water in S/m, of practical salinity, deg C and depth in m, (n,).

    The scale gives salinity from conductivity; this is its inverse, by Newton's method in the square root of
    the ratio.

    Examples
    --------
    >>> zero = np.zeros(1)
    >>> conductivity(zero + 35.0, zero + 15.0, zero).round(4).tolist()
    [4.2914]
    """
    s, t = np.asarray(salinity, float), np.asarray(temperature, float)
    warm = (t - 15.0) / (1.0 + 0.0162 * (t - 15.0))
    a = np.array([0.0080, -0.1692, 25.3851, 14.0941, -7.0261, 2.7081])
    b = np.array([0.0005, -0.0056, -0.0066, -0.0375, 0.0636, -0.0144])
    root = np.sqrt(np.maximum(s, 1e-6) / 35.0)
    orders = np.arange(1, 6)
    for _ in range(10):
        value = polyval(root, a) + warm * polyval(root, b)
        slope = polyval(root, orders * a[1:]) + warm * polyval(root, orders * b[1:])
        root = np.maximum(root - (value - s) / slope, 1e-4)
    by_temperature = polyval(t, [0.6766097, 2.00564e-2, 1.104259e-4, -6.9698e-7, 1.0031e-9])
    ratio = root**2 * by_temperature
    # The pressure in dbar is close to the depth in m; its term needs the ratio that it changes.
    pressure = polyval(np.asarray(depth, float), [0.0, 2.070e-5, -6.370e-10, 3.989e-15])
    whole = ratio
    for _ in range(5):
        below = 1.0 + 3.426e-2 * t + 4.464e-4 * t**2 + (4.215e-1 - 3.107e-3 * t) * whole
        whole = ratio * (1.0 + pressure / below)
    return np.asarray(4.2914 * whole)  # S/m at practical salinity 35, 15 deg C and the surface


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
    """Water and sensors of a payload file (`text`): samples a second, and by `CHANNELS`, (4,), the time
    constant in s, standard deviation and offset in the unit of the channel.
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
        """Payload of a file; a SimulationError where it cannot be read, or a key or value is wrong."""
        return cls.from_toml(text_of(path, "a payload file", error=SimulationError), str(path))

    @classmethod
    def from_toml(cls, text: str, source: str = "<text>") -> Payload:
        """Payload of the text of a payload file; `source` is what to call it in messages."""
        file = checked(_File, tables(text, source, error=SimulationError), source, error=SimulationError)
        sensors = [getattr(file.sensors, name) for name in _Sensors.model_fields]
        return cls(
            text,
            file.rate_hz,
            file.water,
            tuple(file.plumes),
            *(np.array([getattr(s, key) for s in sensors]) for key in ("response_s", "noise", "bias")),
        )

    def check_current(self, current: Sequence[float]) -> None:
        """Refuse plumes in a current (m/s, north and east first) slower than `SLOWEST_M_S`: they have nothing
        to drift with.
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
    """Samples of one stop that were taken in the water that the stop is to sample, or of all "under way".

    `on_the_way` and `unsettled` are left out: taken before the stop was reached in three dimensions, and
    after that before depth and, where the stop is long enough, sensors settled. `sensors_settled`: whether
    those that count begin three response times of the slowest sensor later. `position`: as the vehicle was
    told, m, with the deviation of its navigation; `values` by `CHANNELS`, with that of the samples.
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
    stream: int = 0x9A710AD  #: Stream of the payload's noise, apart from those of the flight.


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
    """What a payload logged on a flight: n samples at times `t` (s), rows of the flight's log.

    `position` and `deviation` (n, 3) are what the vehicle was told and how far that may be off, m; `values`
    and `true` (n, 4) are `CHANNELS` as measured and at the vehicle. `stop` is the label of the stop, "" under
    way; `phase` a `Phase`.
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
    """Samples that a payload takes on a flight. The plume drifts with the mean current, and the noise goes by
    the seed of the flight; `errors` (16, 4) are those of `seatrial.flight.sensor_channels.SensorChannels`.
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
    random = np.random.default_rng([flight.circumstances.seed, SETTINGS.stream])
    noise = random.standard_normal((len(rows), len(CHANNELS)))
    perceived = np.column_stack([
        _held(flight.measured[name][:count], flight.position[0, k]) for k, name in enumerate("xyz")
    ])
    at = errors[:3]
    variance = at[:, 0] ** 2 + at[:, 1] ** 2 + at[:, 3] ** 2 / 12.0 + at[:, 2] ** 2 * flight.t[rows, None]
    labels, phase = _stops(flight, perceived)
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


def _stops(flight: FlightLog, perceived: Array) -> tuple[list[str], Rows]:
    """Label of the stop at which the vehicle keeps station, "" elsewhere, and its phase, of n rows.

    A stop is reached as a waypoint is: within its acceptance radius in three dimensions, as the vehicle was
    told. Guidance keeps station as soon as the vehicle is near in the plane, and dives from there. A row is
    settled where the vehicle has been at the stop for ``steady_s`` and its depth has not drifted.
    """
    stops, count = flight.route.stops, len(perceived)
    leg = np.clip(flight.leg[:count], 0, len(stops) - 1)
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
