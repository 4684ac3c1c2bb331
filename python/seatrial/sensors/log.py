"""The log that sensors make of a run: what perfect ones would show, then late, biased, noisy, rounded, with
lost samples, in one table.

A point r in the body frame moves with ``v_r = v_O + omega x r`` and lies at ``p_r = p_O + R(q) r``; through
the water it moves with ``v_r - R(q)' v_c``; a sensor turned by R_s in the body shows ``R_s' x`` (Fossen 2011,
sections 2.2 and 8.3; ``tests/sensors/test_sensors_ideal.py``). A load cell shows the force of a tied vehicle
on its tether, which balances all else: ``load = tau_actuators + sum of the other forces at nu = 0`` (body, N;
``tests/sensors/test_sensors_load_cell.py``).

A sample is ``y = quantum * round((y_true(t - latency) + bias + noise) / quantum)``. Noise, jitter and
drop-outs of each sensor have generators of their own, seeded by the run's seed and the sensor's name, so that
changing one sensor leaves all other samples as they are (``tests/sensors/test_sensors.py``).

A sensor of the log's rate, or of a whole fraction of it, samples in rows of the log. One with a phase, a
jitter or any other rate f samples at ``t_k = t_0 + phase + k / f`` what was true a latency earlier, and
stamps it ``t_k + jitter``, of at most 0.45 / f. The run is then simulated with rows between those of the log:
commands, supply and wrench hold from row to row, a current is linear in between
(``tests/sensors/test_sensors_stamps.py``). Drop-outs are a two-state Markov process with the mean times
`every` and `length` (``tests/sensors/test_sensors_drop_outs.py``).
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import TrialError
from seatrial.base.frames import continuous, from_euler, matrix, to_euler
from seatrial.sensors.sensor import KINDS, Sensor, one_each

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Run, Vehicle


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Circumstances of a run."""

    vehicle: Vehicle | None = None  #: The vehicle that made the run; only a load cell needs it.
    #: Velocity of the water over ground, NED, m/s, (3,) or one row per row of the run; None: still
    #: water.
    current: Array | None = None
    voltage_v: Array | None = None  #: Supply in V, one value per row of the run; None: not known.
    #: Depth of the bottom below the surface; None: within reach everywhere.
    bottom_depth_m: float | None = None
    held: bool = False  #: Whether the vehicle is tied, as in a bollard test.

    def water(self, rows: int) -> Array:
        """Velocity of the water, shape (rows, 3), NED, m/s."""
        current = np.zeros(3) if self.current is None else np.asarray(self.current, float)
        return np.asarray(np.broadcast_to(current, (rows, 3)))


ON_THE_TETHER = ("load_cell", "revolutions", "voltage")
"""Sensors that log while the vehicle is tied."""


def at_sea(sensors: Mapping[str, Sensor]) -> dict[str, Sensor]:
    """Those of a vehicle's sensors that log while no tether holds it: all but the load cell."""
    return {kind: sensor for kind, sensor in sensors.items() if kind != "load_cell"}


def _tether_force(run: Run | Motion, conditions: Surroundings) -> Array:
    """Force (n, 3) of a held vehicle on its tether at the rows of its run, body frame, N."""
    wrench = getattr(run, "tau", None)
    if not conditions.held or conditions.vehicle is None or wrench is None:
        raise TrialError(
            "load_cell: a load cell shows the pull of a tied vehicle, and this one moves freely; hold it"
            " (held = true in a recipe, --held on the command line) or leave the load cell out"
        )
    count = len(run.t)
    at_rest = np.zeros((count, 6))
    terms = conditions.vehicle.forces(at_rest, np.asarray(run.attitude), conditions.water(count))
    return np.asarray((np.asarray(wrench) + np.sum(list(terms.values()), axis=0))[:, :3])


def _turned(vectors: Array, sensor: Sensor) -> Array:
    """Vectors (n, 3) of the body frame along the sensor's own axes."""
    return np.asarray(vectors @ matrix(from_euler(np.array(sensor.tilt)))) if any(sensor.tilt) else vectors


class Motion(Protocol):
    """What sensors look at: a run of the model, or a flight."""

    @property
    def t(self) -> Array:
        """Times (n,), s, uniform."""

    @property
    def position(self) -> Array:
        """Of O, NED, m, (n, 3)."""

    @property
    def attitude(self) -> Array:
        """Unit quaternions (n, 4), body to NED."""

    @property
    def nu(self) -> Array:
        """Velocities (n, 6), body frame, m/s and rad/s."""

    @property
    def actuators(self) -> Mapping[str, Array]:
        """What the actuators do, {name: (n,)}, in the unit of the command."""


class Ideal:
    """Perfect sensors on a run.

    Parameters
    ----------
    run : Run or Motion
        The true motion; a load cell needs the run of a held vehicle.
    conditions : Surroundings
        Water, bottom, supply and tether.
    every : int, optional
        Only every so-many-th row of the run is looked at; values are linear in between.
    """

    def __init__(self, run: Run | Motion, conditions: Surroundings, *, every: int = 1) -> None:
        self._run, self._conditions, self._every = run, conditions, every
        self.t: Array = np.asarray(run.t)[::every]

    def columns(self, kind: str) -> tuple[str, ...]:
        """Columns that a kind of sensor logs of this run."""
        if kind == "revolutions":
            return tuple(f"meas.{name}" for name in self._run.actuators)
        return KINDS[kind].columns

    def values(self, kind: str, sensor: Sensor, t: Array) -> Array:
        """True values (m, columns) at the times `t` (m,), in the columns' units; NaN where unseen."""
        run, r = self._run, np.array(sensor.position)
        if kind in ("dvl", "dvl_water"):
            velocity = self._velocity(r, t)
            if kind == "dvl_water":
                # The velocity through the water is that over ground less the current, in the body's axes.
                water = self._at(self._conditions.water(len(run.t)), t)
                velocity -= np.einsum("nji,nj->ni", matrix(self._attitude(t)), water)
                return _turned(velocity, sensor)
            velocity[self._out_of_range(sensor, t)] = np.nan
            return _turned(velocity, sensor)
        if kind == "gyro":
            return _turned(np.rad2deg(self._at(run.nu[:, 3:], t)), sensor)
        if kind == "attitude":
            return np.rad2deg(to_euler(self._attitude(t)))
        if kind in ("depth", "position", "gps"):
            position = self._position(r, t)
            if kind == "depth":
                return position[:, 2:]
            if kind == "gps":
                position[~self._in_the_air(r, t)] = np.nan
            return position[:, :2]
        if kind == "voltage":
            return self._voltage(t)
        if kind == "load_cell":
            return self._at(_tether_force(run, self._conditions), t)
        return self._at(np.stack(list(run.actuators.values()), axis=1), t)

    def _in_the_air(self, r: Array, t: Array) -> NDArray[np.bool_]:
        """Whether the antenna of a GPS is above the surface; on top of the hull where it has no place."""
        vehicle = self._conditions.vehicle
        antenna = r if r.any() or vehicle is None else np.asarray(vehicle.hull_top())
        return np.asarray(self._position(antenna, t)[:, 2] < 0.0)

    def _at(self, values: ArrayLike, t: Array) -> Array:
        """Values of the run's rows (n, k) at the times `t`, (m, k)."""
        return self._between(np.asarray(values, float)[:: self._every], t)

    def _between(self, table: Array, t: Array) -> Array:
        return np.stack([np.interp(t, self.t, column) for column in table.T], axis=1)

    def _attitude(self, t: Array) -> Array:
        q = self._between(continuous(self._run.attitude[:: self._every])[0], t)
        return np.asarray(q / np.linalg.norm(q, axis=1)[:, None])

    def _velocity(self, r: Array, t: Array) -> Array:
        nu = self._at(self._run.nu, t)
        return np.asarray(nu[:, :3] + np.cross(nu[:, 3:], r))

    def _position(self, r: Array, t: Array) -> Array:
        position = self._at(self._run.position, t)
        return position + matrix(self._attitude(t)) @ r if r.any() else position

    def _out_of_range(self, sensor: Sensor, t: Array) -> NDArray[np.bool_]:
        bottom = self._conditions.bottom_depth_m
        if bottom is None or sensor.max_range_m is None:
            return np.zeros(len(t), bool)
        altitude = bottom - self._position(np.array(sensor.position), t)[:, 2]
        if altitude.min(initial=np.inf) < 0.0:
            raise TrialError(
                f"dvl: the vehicle goes down to {bottom - altitude.min():.1f} m, below the bottom at"
                f" {bottom:g} m; give a deeper bottom or other commands"
            )
        down = matrix(self._attitude(t))[:, 2, 2]
        return np.asarray(altitude > sensor.max_range_m * down)

    def _voltage(self, t: Array) -> Array:
        voltage_v = self._conditions.voltage_v
        if voltage_v is None:
            raise TrialError(
                "voltage: no supply voltage is known; give voltage_v or leave the voltage sensor out"
            )
        held = np.searchsorted(self.t, t + 1e-9, side="right") - 1
        return np.asarray(voltage_v)[:: self._every][np.maximum(held, 0), None]


def silent(sensor: Sensor, t: Array, random: np.random.Generator) -> NDArray[np.bool_]:
    """Samples (m,) at the rising times `t` (m,), s, that a sensor's drop-outs swallow."""
    every, length = sensor.dropout_every_s, sensor.dropout_s
    if every is None or not length or len(t) == 0:
        return np.zeros(len(t), bool)
    off = bool(random.random() < length / (every + length))
    now = float(t[0])
    begins, states = [now], [off]
    while now <= t[-1]:
        now += float(random.exponential(length if off else every))
        off = not off
        begins.append(now)
        states.append(off)
    return np.array(states)[np.searchsorted(begins, t, side="right") - 1]


@dataclass(frozen=True)
class SamplingSettings:
    """How a run is sampled between the rows of the log."""

    longest_step_s: float = 0.01  #: s between rows of the run that a sensor with its own base looks at
    largest_jitter: float = 0.45  #: of the interval: a larger one would change the order of stamps
    rounding: float = 1e-6  #: of an interval, or s: rounding of stamps is no deviation
    digits: int = 6  #: of stamps and values in the table


SETTINGS = SamplingSettings()


def asynchronous(sensor: Sensor, t: Array) -> bool:
    """Whether a sensor has a time base of its own beside the log's uniform times `t` (n,).

    Examples
    --------
    >>> t = np.arange(0.0, 10.0, 0.1)
    >>> [asynchronous(Sensor(rate_hz=rate), t) for rate in (5.0, 4.0, 20.0)]
    [False, True, True]
    """
    if sensor.phase_s > 0.0 or sensor.jitter_s > 0.0:
        return True
    if sensor.rate_hz is None or len(t) < 2:
        return False
    intervals = 1.0 / (sensor.rate_hz * _step(t))
    return round(intervals) < 1 or abs(intervals - round(intervals)) > SETTINGS.rounding * intervals


def finer(sensors: Iterable[Sensor], t: Array) -> int:
    """Rows of the run per row of the log `t` (n,): 1, or so many that a sensor may sample in between."""
    if not any(asynchronous(sensor, t) for sensor in sensors):
        return 1
    return max(1, math.ceil(_step(t) / SETTINGS.longest_step_s - SETTINGS.rounding))


def rows(sensor: Sensor, t: Array) -> NDArray[np.bool_]:
    """Rows (n,) of the log in which a sensor in step with it gives a sample."""
    if sensor.rate_hz is None:
        return np.ones(len(t), bool)
    count = np.floor((t - t[0]) * sensor.rate_hz + SETTINGS.rounding)
    return np.concatenate([[True], np.diff(count) > 0.0])


def _own_stamps(sensor: Sensor, t: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Stamps (m,) of a sensor with its own base within the log's times `t` (n,), and its regular times, s."""
    interval = _step(t) if sensor.rate_hz is None else 1.0 / sensor.rate_hz
    first = t[0] + sensor.phase_s
    count = max(int(np.floor((t[-1] - first) / interval + SETTINGS.rounding)) + 1, 0)
    regular = first + interval * np.arange(count)
    miss = np.clip(
        random.normal(0.0, sensor.jitter_s, count),
        -SETTINGS.largest_jitter * interval,
        SETTINGS.largest_jitter * interval,
    )
    stamps = regular + miss
    logged = (stamps >= t[0]) & (stamps <= t[-1] + SETTINGS.rounding)
    return stamps[logged], regular[logged]


def _step(t: Array) -> float:
    return float(t[-1] - t[0]) / (len(t) - 1)


def times(t: Array, every: int) -> Array:
    """Uniform times with `every` rows per row of `t` (n,), ((n - 1) every + 1,).

    Examples
    --------
    >>> times(np.array([0.0, 0.1, 0.2]), 2).tolist()
    [0.0, 0.05, 0.1, 0.15, 0.2]
    """
    return np.asarray(np.linspace(t[0], t[-1], (len(t) - 1) * every + 1)) if every > 1 else t


def held(values: ArrayLike, every: int) -> Array:
    """Rows of `values` (n, ...) each repeated `every` times, but for the last."""
    rows = np.asarray(values, float)
    return np.repeat(rows, every, axis=0)[: (len(rows) - 1) * every + 1]


def linear(values: ArrayLike, every: int) -> Array:
    """Rows of `values` (n, k) with straight lines in between."""
    rows = np.asarray(values, float)
    index = np.arange((len(rows) - 1) * every + 1) / every
    return np.stack([np.interp(index, np.arange(len(rows)), column) for column in rows.T], axis=1)


_DROP_OUTS, _JITTER = 1, 2  # generators of a sensor beside that of its noise


def measure(
    run: Run | Motion,
    sensors: Mapping[str, Sensor],
    *,
    seed: int,
    conditions: Surroundings | None = None,
    inputs: Mapping[str, Array] | None = None,
    every: int = 1,
) -> pl.DataFrame:
    """Table of what the sensors log of a run, with canonical columns; an empty cell means no sample.

    While all sensors are in step with the log it has a row per time of the log; otherwise a row per stamp
    that any sensor gave.

    Parameters
    ----------
    run : Run or Motion
        Uniform in time.
    sensors : mapping of str to Sensor
        By kind.
    seed : int
        The same seed gives the same table.
    conditions : Surroundings, optional
        Water, bottom, supply and tether; still water, no bottom in sight and a free vehicle when omitted.
    inputs : mapping of str to (n,) array, optional
        Further columns, at the times of the log: commands and the like.
    every : int, optional
        The log's times are every so-many-th row of the run (`seatrial.sensors.log.finer`).

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
    aboard = [kind for kind in sensors if KINDS[kind].aboard]
    if aboard:
        raise TrialError(
            f"sensors: {', '.join(aboard)}: only the navigation filter of a flight reads it, and a log has no"
            ' column of it; leave it out, or fly with navigation = "filter"'
        )
    around = Surroundings() if conditions is None else conditions
    # Perfect sensors in the rows of the log, and between them for those with stamps of their own.
    log, fine = Ideal(run, around, every=every), Ideal(run, around)
    in_step = not any(asynchronous(sensor, log.t) for sensor in sensors.values())
    samples: list[tuple[tuple[str, ...], Array, Array]] = []
    for kind, sensor in sensors.items():
        stamps, cells = _samples(kind, sensor, log, fine, seed)
        samples.append((
            log.columns(kind),
            np.round(stamps, SETTINGS.digits),
            np.round(cells, SETTINGS.digits),
        ))
    # Rows of the table: those of the log, or every stamp at which a sensor gave something.
    t = np.round(log.t, SETTINGS.digits)
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
    # Inputs are known in the rows of the log alone.
    row = np.searchsorted(t, np.round(log.t, SETTINGS.digits))
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
    offsets_si = {}
    for kind, sensor in sensors.items():
        columns, unit = KINDS[kind].columns, KINDS[kind].unit
        offsets = _generator(kind, seed).normal(0.0, sensor.bias, len(columns))
        for column, offset in zip(columns, offsets, strict=True):
            si = np.deg2rad(offset) if unit.startswith("deg") else offset
            offsets_si[column.removesuffix(f"_{unit}")] = float(si)
    return offsets_si


def _samples(kind: str, sensor: Sensor, log: Ideal, fine: Ideal, seed: int) -> tuple[Array, Array]:
    """Stamps (m,) and what the sensor logs at them (m, columns); NaN where it gave no sample."""
    random = _generator(kind, seed)
    if asynchronous(sensor, log.t):
        stamps, regular = _own_stamps(sensor, log.t, _generator(kind, seed, _JITTER))
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
