"""The log of a run: true values, late, with bias, noise and digits, with samples lost, in one table.

A sample is ``y = quantum * round((y_true(t - latency) + bias + noise) / quantum)``. Noise is drawn from a
generator of the sensor's own, seeded by the run's seed and the sensor's name, so that adding or changing one
sensor leaves the others' samples as they are; jitter and drop-outs have generators of their own beside it, so
that they change no noise. Held by tests/test_sensors.py, tests/test_sensors_stamps.py and
tests/test_sensors_drop_outs.py.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.sensors.conditions import Conditions
from seatrial.sensors.drop_outs import silent
from seatrial.sensors.ideal import Ideal
from seatrial.sensors.kinds import KINDS
from seatrial.sensors.sensor import Sensor, one_each
from seatrial.sensors.stamps import asynchronous, own_stamps, rows

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Run

__all__ = ["biases", "measure"]

Array = NDArray[np.float64]

_DIGITS = 6  # of stamps and values in the table
_DROP_OUTS, _JITTER = 1, 2  # generators of a sensor beside that of its noise


def measure(
    run: Run,
    sensors: Mapping[str, Sensor],
    *,
    seed: int,
    conditions: Conditions | None = None,
    inputs: Mapping[str, Array] | None = None,
    every: int = 1,
) -> pl.DataFrame:
    """Table of what the sensors log of a run, with canonical columns; an empty cell means no sample.

    While all sensors are in step with the log it has a row per time of the log; otherwise a row per stamp
    that any sensor gave.

    Parameters
    ----------
    run : Run
        Uniform in time.
    sensors : mapping of str to Sensor
        By kind.
    seed : int
        The same seed gives the same table.
    conditions : Conditions, optional
        Water, bottom, supply and tether; still water, no bottom in sight and a free vehicle when omitted.
    inputs : mapping of str to (n,) array, optional
        Further columns, at the times of the log: commands and the like.
    every : int, optional
        The log's times are every so-many-th row of the run (`seatrial.sensors.stamps.finer`).

    Raises
    ------
    TrialError
        A sensor measures what this run has not.

    Examples
    --------
    >>> import seatrial as st
    >>> run = st.Vehicle.load("cwolf").simulate(np.arange(0.0, 5.0, 0.1))
    >>> measure(run, {"depth": Sensor(noise=0.01, rate_hz=5.0)}, seed=1)["z_m"].null_count()
    25
    """
    import polars as pl

    one_each(sensors)
    around = Conditions() if conditions is None else conditions
    log, fine = Ideal(run, around, every=every), Ideal(run, around)
    in_step = not any(asynchronous(sensor, log.t) for sensor in sensors.values())
    samples: list[tuple[tuple[str, ...], Array, Array]] = []
    for kind, sensor in sensors.items():
        stamps, cells = _samples(kind, sensor, log, fine, seed)
        samples.append((log.columns(kind), np.round(stamps, _DIGITS), np.round(cells, _DIGITS)))
    t = np.round(log.t, _DIGITS)
    if not in_step:
        seen = [stamps[np.isfinite(cells).any(axis=1)] for _, stamps, cells in samples]
        t = np.unique(np.concatenate([*seen, t] if inputs else seen))
    table: dict[str, pl.Series] = {"t_s": pl.Series("t_s", t)}
    for names, stamps, cells in samples:
        row = np.searchsorted(t, stamps)
        known = np.isfinite(cells).any(axis=1)
        for k, name in enumerate(names):
            column = np.full(len(t), np.nan)
            column[row[known]] = cells[known, k]
            table[name] = pl.Series(name, column, nan_to_null=True)
    row = np.searchsorted(t, np.round(log.t, _DIGITS))
    for name, values in (inputs or {}).items():
        column = np.full(len(t), np.nan)
        column[row] = values
        table[name] = pl.Series(name, column, nan_to_null=True)
    return pl.DataFrame(table)


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


def _samples(kind: str, sensor: Sensor, log: Ideal, fine: Ideal, seed: int) -> tuple[Array, Array]:
    """Stamps (m,) and what the sensor logs at them (m, columns); NaN where it gave no sample."""
    random = _generator(kind, seed)
    if asynchronous(sensor, log.t):
        stamps, regular = own_stamps(sensor, log.t, _generator(kind, seed, _JITTER))
        truth = fine.values(kind, sensor, regular - sensor.latency_s)
    else:
        stamps = log.t
        truth = log.values(kind, sensor, stamps - sensor.latency_s)
    logged = truth + random.normal(0.0, sensor.bias, truth.shape[1])
    logged += random.normal(0.0, sensor.noise, truth.shape)
    if sensor.quantum > 0.0:
        logged = sensor.quantum * np.round(logged / sensor.quantum)
    if kind == "attitude":
        logged = (logged + 180.0) % 360.0 - 180.0
    if not asynchronous(sensor, log.t):
        logged[~rows(sensor, stamps)] = np.nan
    logged[silent(sensor, stamps, _generator(kind, seed, _DROP_OUTS))] = np.nan
    return stamps, logged


def _generator(kind: str, seed: int, purpose: int | None = None) -> np.random.Generator:
    entropy = [seed, zlib.crc32(kind.encode())]
    return np.random.default_rng(entropy if purpose is None else [*entropy, purpose])
