"""Sensors: what a vehicle's instruments would have logged of a simulated run.

Each sensor is described by five numbers, all optional: white noise (standard deviation), bias (standard
deviation of an offset that is drawn once per run and channel), quantum (step of its digits), rate and
latency. Noise is drawn from a generator of the sensor's own, seeded by the run's seed and the sensor's name,
so that adding or changing one sensor leaves the others' samples as they are.

Every sensor sits in O and reports body axes; the depth is that of O. Held by tests/test_sensors.py.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import TrialError, nearest
from seatrial.rotation import continuous, to_euler

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Run

__all__ = ["KINDS", "Kind", "Sensor", "biases", "measure"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kind:
    """A kind of sensor: the columns that it logs and the unit of its numbers."""

    columns: tuple[str, ...]
    unit: str


KINDS: dict[str, Kind] = {
    "dvl": Kind(("u_m_s", "v_m_s", "w_m_s"), "m_s"),
    "gyro": Kind(("p_deg_s", "q_deg_s", "r_deg_s"), "deg_s"),
    "attitude": Kind(("roll_deg", "pitch_deg", "yaw_deg"), "deg"),
    "depth": Kind(("z_m",), "m"),
    "position": Kind(("x_m", "y_m"), "m"),
    "revolutions": Kind((), "rpm"),
}
"""Kinds by name; "revolutions" logs one column per actuator, in the unit of its command."""


@dataclass(frozen=True)
class Sensor:
    """A sensor's imperfections, in the unit of its kind, Hz and s; a rate of None is that of the log."""

    noise: float = 0.0
    bias: float = 0.0
    quantum: float = 0.0
    rate_hz: float | None = None
    latency_s: float = 0.0

    @classmethod
    def parse(cls, kind: str, table: Mapping[str, Any], where: str = "sensors") -> Sensor:
        """Sensor from its table in a file, whose keys carry the unit: ``noise_m_s``, ``latency_s``.

        Raises
        ------
        TrialError
            An unknown kind or key, or a value that is no number from zero on.

        Examples
        --------
        >>> Sensor.parse("dvl", {"noise_m_s": 0.01, "rate_hz": 5.0}).noise
        0.01
        """
        if kind not in KINDS:
            raise TrialError(f'{where}: unknown sensor "{kind}"{nearest(kind, KINDS)}')
        keys = {f"{name}_{KINDS[kind].unit}": name for name in ("noise", "bias", "quantum")}
        keys |= {"rate_hz": "rate_hz", "latency_s": "latency_s"}
        values: dict[str, float] = {}
        for key, value in table.items():
            if key not in keys:
                raise TrialError(f'{where}, {kind}: unknown key "{key}"{nearest(key, keys)}')
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not np.isfinite(value) or value < 0 or (key == "rate_hz" and value == 0):
                raise TrialError(f"{where}, {kind}, key {key}: expected a positive number, found {value!r}")
            values[keys[key]] = float(value)
        return cls(**values)


def measure(run: Run, sensors: Mapping[str, Sensor], *, seed: int) -> pl.DataFrame:
    """Table of what the sensors log of a run, with canonical columns; an empty cell means no sample.

    Parameters
    ----------
    run : Run
        Its uniform times are those of the log.
    sensors : mapping of str to Sensor
        By kind.
    seed : int
        The same seed gives the same table.

    Examples
    --------
    >>> import seatrial as st
    >>> run = st.Vehicle.load("cwolf").simulate(np.arange(0.0, 5.0, 0.1))
    >>> measure(run, {"depth": Sensor(noise=0.01, rate_hz=5.0)}, seed=1)["z_m"].null_count()
    25
    """
    import polars as pl

    t = np.asarray(run.t)
    table = pl.DataFrame({"t_s": np.round(t, 6)})
    for kind, sensor in sensors.items():
        random = _generator(kind, seed)
        columns, truth = _truth(run, kind, t - sensor.latency_s)
        logged = truth + random.normal(0.0, sensor.bias, truth.shape[1])
        logged += random.normal(0.0, sensor.noise, truth.shape)
        if sensor.quantum > 0.0:
            logged = sensor.quantum * np.round(logged / sensor.quantum)
        if kind == "attitude":
            logged = (logged + 180.0) % 360.0 - 180.0
        sampled = _sampled(t, sensor.rate_hz)
        cells = np.where(sampled[:, None], logged, np.nan)
        table = table.with_columns(
            pl.Series(name, np.round(cells[:, k], 6), nan_to_null=True) for k, name in enumerate(columns)
        )
    return table


def biases(sensors: Mapping[str, Sensor], *, seed: int) -> dict[str, float]:
    """Offset of each channel that `measure` adds with this seed, SI; late or rounded samples keep it.

    Examples
    --------
    >>> list(biases({"depth": Sensor(bias=0.1)}, seed=1))
    ['z']
    """
    found = {}
    for kind, sensor in sensors.items():
        columns, unit = KINDS[kind].columns, KINDS[kind].unit
        offsets = _generator(kind, seed).normal(0.0, sensor.bias, len(columns))
        for column, offset in zip(columns, offsets, strict=True):
            si = np.deg2rad(offset) if unit.startswith("deg") else offset
            found[column.removesuffix(f"_{unit}")] = float(si)
    return found


def _generator(kind: str, seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(kind.encode())])


def _truth(run: Run, kind: str, t: Array) -> tuple[tuple[str, ...], Array]:
    """Columns of a kind of sensor and their true values (n, k) at the times `t`, in the columns' units."""
    base = np.asarray(run.t)

    def at(values: Array) -> Array:
        return np.stack([np.interp(t, base, column) for column in np.asarray(values).T], axis=1)

    columns = KINDS[kind].columns
    if kind == "dvl":
        return columns, at(run.nu[:, :3])
    if kind == "gyro":
        return columns, np.rad2deg(at(run.nu[:, 3:]))
    if kind == "attitude":
        q = at(continuous(run.attitude)[0])
        return columns, np.rad2deg(to_euler(q / np.linalg.norm(q, axis=1)[:, None]))
    if kind == "depth":
        return columns, at(run.position[:, 2:])
    if kind == "position":
        return columns, at(run.position[:, :2])
    names = tuple(f"meas.{name}" for name in run.actuators)
    return names, at(np.stack(list(run.actuators.values()), axis=1))


def _sampled(t: Array, rate_hz: float | None) -> NDArray[np.bool_]:
    """Rows (n,) in which a sensor of this rate gives a sample."""
    if rate_hz is None:
        return np.ones(len(t), bool)
    count = np.floor((t - t[0]) * rate_hz + 1e-6)
    return np.concatenate([[True], np.diff(count) > 0.0])
