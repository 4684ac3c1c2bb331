"""The payload of a flight: sensors of the water, their samples along the track and at every stop.

A payload file names the water (`seatrial.flight.water`) and the sensors. Each sensor follows the water at
the vehicle with its response time, a first-order lag, and is logged with noise and an offset, together with
the position that the vehicle was told and its standard deviation. The payload has no effect on the flight.
Held by ``tests/flight/test_payload.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError
from seatrial.base.report import Section as ReportSection
from seatrial.base.report import Table
from seatrial.base.toml_file import NotNegative, Number, Positive, Section, checked, tables, text_of
from seatrial.flight.water import CHANNELS, SLOWEST_M_S, Plume, Profile, properties

if TYPE_CHECKING:
    import polars as pl

    from seatrial.flight.log import FlightLog

__all__ = ["Payload", "Samples", "StopSamples", "Value", "sampled"]

Rows = NDArray[np.intp]


class _Water(Section):
    nitrate_mg_l: NotNegative
    salinity: NotNegative
    temperature_c: Number
    nitrate_per_m: Number = 0.0
    salinity_per_m: Number = 0.0
    temperature_per_m: Number = 0.0


class _Plume(Section):
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
    water: _Water
    plumes: list[_Plume] = Field(default_factory=list)
    sensors: _Sensors = Field(default_factory=_Sensors)


@dataclass(frozen=True)
class Payload:
    """Water and sensors of a payload file.

    Attributes
    ----------
    text
        The file.
    rate_hz
        Samples a second, of all sensors.
    water, plumes
        Background and sources.
    response_s, noise, bias
        By `CHANNELS`, (4,): time constant in s, and in the unit of the channel the standard deviation and the
        offset.

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

        Raises
        ------
        SimulationError
            The file cannot be read, or a key or value is wrong.
        """
        return cls.from_toml(text_of(path, "a payload file", error=SimulationError), str(path))

    @classmethod
    def from_toml(cls, text: str, source: str = "<text>") -> Payload:
        """Payload of the text of a payload file; `source` is what to call it in messages.

        Raises
        ------
        SimulationError
            A key or value is wrong.
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
            Profile(**file.water.model_dump()),
            tuple(Plume(**plume.model_dump()) for plume in file.plumes),
            *(np.array([getattr(s, key) for s in sensors]) for key in ("response_s", "noise", "bias")),
        )

    def check_current(self, current: Sequence[float]) -> None:
        """Refuse plumes in still water; `current` in m/s, north and east first.

        Raises
        ------
        SimulationError
            It is slower than `SLOWEST_M_S`.
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

    def text(self, decimals: int) -> str:
        """Both with so many decimals."""
        return f"{self.mean:.{decimals}f} ± {self.deviation:.{decimals}f}"


@dataclass(frozen=True)
class StopSamples:
    """Samples of one stop, from three response times after its begin on.

    Attributes
    ----------
    label
        Of the stop; "under way" for all samples between stops.
    begin_s, end_s, count
        Of the samples.
    position
        North, east, depth as the vehicle was told, m; the deviation is that of its navigation.
    values
        By `CHANNELS`; the deviation is that of the samples.
    """

    label: str
    begin_s: float
    end_s: float
    count: int
    position: tuple[Value, Value, Value]
    values: Mapping[str, Value]

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""
        places = zip(("north_m", "east_m", "depth_m"), self.position, strict=True)
        found = {**dict(places), **self.values}
        numbers = {name: {"mean": one.mean, "deviation": one.deviation} for name, one in found.items()}
        return {
            "label": self.label,
            "begin_s": self.begin_s,
            "end_s": self.end_s,
            "count": self.count,
        } | numbers


UNDER_WAY = "under way"


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
    """

    payload: Payload
    t: Array
    rows: Rows
    position: Array
    deviation: Array
    values: Array
    true: Array
    stop: tuple[str, ...]

    def table(self) -> pl.DataFrame:
        """A row per sample: time, stop, position and channels, each with its deviation, and the truth."""
        import polars as pl

        instrument = np.hypot(self.payload.noise, self.payload.bias)
        columns: dict[str, Any] = {"t_s": np.round(self.t, 9), "stop": list(self.stop)}
        for k, name in enumerate(("north", "east", "depth")):
            columns |= {f"{name}_m": self.position[:, k], f"{name}_deviation_m": self.deviation[:, k]}
        for k, name in enumerate(CHANNELS):
            columns |= {name: self.values[:, k], f"deviation.{name}": np.full(len(self.t), instrument[k])}
        return pl.DataFrame(columns | {f"true.{name}": self.true[:, k] for k, name in enumerate(CHANNELS)})

    def log_columns(self, rows: int) -> dict[str, Array]:
        """Channels as columns of a log of so many rows; NaN between samples."""
        found = np.full((rows, len(CHANNELS)), np.nan)
        found[self.rows] = self.values
        return {f"payload.{name}": found[:, k] for k, name in enumerate(CHANNELS)}

    @property
    def stops(self) -> tuple[StopSamples, ...]:
        """Samples of every stop in the order of the flight, and last those under way."""
        labels = np.array(self.stop)
        settle = 3.0 * float(self.payload.response_s.max())
        found = []
        for label in [*dict.fromkeys(name for name in self.stop if name), ""]:
            rows = np.flatnonzero(labels == label)
            if not len(rows):
                continue
            settled = rows[self.t[rows] >= self.t[rows[0]] + settle]
            rows = settled if label and len(settled) > 1 else rows
            found.append(self._summary(label or UNDER_WAY, rows))
        return tuple(found)

    def _summary(self, label: str, rows: Rows) -> StopSamples:
        mean, spread = self.values[rows].mean(axis=0), self.values[rows].std(axis=0)
        values = {name: Value(float(mean[k]), float(spread[k])) for k, name in enumerate(CHANNELS)}
        place, off = self.position[rows].mean(axis=0), self.deviation[rows].mean(axis=0)
        north, east, depth = (Value(float(place[k]), float(off[k])) for k in range(3))
        return StopSamples(
            label, float(self.t[rows[0]]), float(self.t[rows[-1]]), len(rows), (north, east, depth), values
        )

    def section(self) -> ReportSection:
        """Tables of the stops, and where the most nitrate was."""
        stops = self.stops
        places = Table.of(
            "Position of the samples, m; ± deviation of the navigation",
            ("stop", "samples", "north", "east", "depth"),
            [
                (one.label, str(one.count), *(value.text(2) for value in one.position))
                for one in stops
                if one.label != UNDER_WAY
            ],
        )
        values = Table.of(
            "Measured; ± standard deviation of the samples",
            ("stop", "nitrate, mg/L", "density, kg/m3", "cond., S/m", "salinity"),
            [(one.label, *(one.values[name].text(_DECIMALS[name]) for name in CHANNELS)) for one in stops],
        )
        tables = (places, values) if any(one.label != UNDER_WAY for one in stops) else (values,)
        return ReportSection("Water samples", tuple(self.sentences()), tables=tables)

    def sentences(self) -> list[str]:
        """The largest nitrate, and how far measured and true values are apart."""
        if not len(self.t):
            return ["The payload took no sample."]
        top = int(np.argmax(self.values[:, 0]))
        north, east, depth = self.position[top]
        off = np.sqrt(np.mean((self.values - self.true) ** 2, axis=0))
        apart = ", ".join(
            f"{name.split('_')[0]} {off[k]:.2g} {unit}".strip()
            for k, (name, unit) in enumerate(CHANNELS.items())
        )
        return [
            f"{len(self.t)} samples; the most nitrate was {self.values[top, 0]:.2f} mg/L at"
            f" {self.t[top]:.0f} s, north {north:.1f} m, east {east:.1f} m, {depth:.1f} m deep, where the"
            f" background is {self.payload.water.at(np.array([depth]))[0, 0]:.2f} mg/L.",
            f"Measured and true water at the vehicle differ by {apart} rms: response, noise and offset.",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Stops as plain data; the samples are in the table."""
        return {"samples": len(self.t), "stops": [one.to_dict() for one in self.stops]}


_DECIMALS = {"nitrate_mg_l": 2, "density_kg_m3": 2, "conductivity_s_m": 3, "salinity_pss": 2}


def sampled(payload: Payload, flight: FlightLog, errors: Array) -> Samples:
    """Samples that a payload takes on a flight.

    Parameters
    ----------
    payload
        Water and sensors.
    flight
        Its log; the plume drifts with the mean current, and the noise goes by the seed of its circumstances.
    errors
        Of the navigation's channels: noise, offset, random walk after one second and digit, (16, 4), see
        `seatrial.flight.sensor_channels.SensorChannels`.

    Raises
    ------
    SimulationError
        A plume has no current that it drifts with.
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
    noise = np.random.default_rng([flight.circumstances.seed, _STREAM]).standard_normal((
        len(rows),
        len(CHANNELS),
    ))
    told = np.column_stack([
        _held(flight.measured[name][:count], flight.position[0, k]) for k, name in enumerate("xyz")
    ])
    at = errors[:3]
    variance = at[:, 0] ** 2 + at[:, 1] ** 2 + at[:, 3] ** 2 / 12.0 + at[:, 2] ** 2 * flight.t[rows, None]
    stops = flight.route.stops
    labels = [
        stops[leg].label if holding and stops[leg].task == "hold" else ""
        for leg, holding in zip(
            np.clip(flight.leg[rows], 0, len(stops) - 1), flight.holding[rows], strict=True
        )
    ]
    return Samples(
        payload,
        flight.t[rows],
        rows,
        told[rows],
        np.sqrt(variance),
        follows[rows] + payload.bias + payload.noise * noise,
        water[rows],
        tuple(labels),
    )


_STREAM = 0x9A710AD  # of the payload's noise, apart from those of the flight


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
