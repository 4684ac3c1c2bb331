"""What besides the coefficients moves the predictions of a log, fitted to it: starts, sensors, water.

Predictions of a log in windows leave, per window, with exact derivatives J,

    r = J_theta theta + J_n n + J_0 x_0 + e,

x_0 the error of the state at the restart, n what all windows share, e the noise of the sensors, theta the
change of a coefficient group (`seatrial.verification.mission_log.power`). All but theta are unknowns with a
stated size:

| unknown | standard deviation |
|---|---|
| noise e | measured less smoothed, per channel: no model has a part in it; and an error that is stated |
| state at a restart x_0 | that of the noise; smoothing makes it no worse |
| offset of each sensor | as stated by the sensors |
| delay of each group of sensors | `DELAY_S` |
| steady current, where the log tells none | `CURRENT_M_S` |
| coefficients | their covariance |

so that neither the errors of the model nor those of a reference widen what is tolerated. Gauss-Newton steps
find the unknowns that explain the log best with the model as it is.

A window of ten seconds is far from linear in its start where a vehicle leaves its attitude within seconds.
Its fit therefore begins with the starts and the shared unknowns that pieces of `HORIZON_S` were fitted with.

Tests: ``tests/verification/test_recorded_power.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import initial_names, nuisance_names
from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import SeatrialError
from seatrial.base.frames import shorter
from seatrial.scoring.record import restarted
from seatrial.verification.mission_log.spread import SPREAD_SETTINGS, PredictedLog

if TYPE_CHECKING:
    from seatrial.identification.fitted import Fitted
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class UnknownsSettings:
    """Sizes of what besides the coefficients moves the predictions of a log."""

    #: Length of a piece, s: long enough for a drag to move a speed by many times its noise, short enough for
    #: the linear start of a vehicle that leaves its attitude within seconds.
    horizon_s: float = 2.0
    #: Delay that an import may have left in a sensor, s: a Doppler log's ping, processing and line take 0.12
    #: s.
    delay_s: float = 0.15
    current_m_s: float = 1.0  #: Of a steady current that the log does not tell: a strong tidal stream.
    #: Of the start in a channel that no sensor tells, m/s, rad/s, m and rad: the smoothed log has zero there,
    #: or what it makes of other channels. A position is told by nothing and acts on nothing.
    untold: tuple[float, ...] = (0.5, 0.5, 0.5, 0.2, 0.2, 0.2, 1e-9, 1e-9, 1e-9, 0.1, 0.1, 0.1)
    #: Nothing tells what the actuators did before a log begins, and the prediction takes them for settled:
    #: after five time constants of a slow thruster (0.4 s) that is forgotten.
    warm_up_s: float = 2.0
    fewest_windows: int = 6  #: Fewer windows tell nothing of how they scatter.
    #: Of a longer log evenly spaced windows: time grows with their number, sigma falls with its root alone.
    most_windows: int = 30
    #: Longest step of the integration, s: the yaw of a half-metre ROV is off by half its noise after ten
    #: seconds of steps of 0.05 s.
    step_s: float = 0.025
    rounds: int = 8  #: Rounds of Gauss-Newton; three to five are usual.
    #: Channels that one instrument tells.
    delayed: tuple[tuple[int, ...], ...] = ((0, 1, 2), (3, 4, 5), (6, 7), (8,), (9, 10, 11))


UNKNOWNS_SETTINGS = UnknownsSettings()


def sensor_noise(trial: Trial) -> Array:
    """Noise (12,) of the sensors, SI, by the smoothed log and by third differences; infinite without any."""
    from scipy.spatial.transform import Rotation

    position, attitude, nu = trial.state(np.arange(len(trial)))
    angles = Rotation.from_quat(attitude, scalar_first=True).as_euler("ZYX")[:, ::-1]
    away = trial.observed - np.concatenate([nu, position, angles], axis=1)
    away[:, 9:] = shorter(np.nan_to_num(away[:, 9:]))
    noise = np.full(len(CHANNELS), np.inf)
    steps = np.diff(trial.observed, axis=0)
    steps[:, 9:] = shorter(np.nan_to_num(steps[:, 9:]))
    third = np.diff(steps, n=2, axis=0)
    for c in range(len(CHANNELS)):
        good = trial.valid[:, c]
        # A channel that never changes is a column of a model in fewer axes, and no reading of a sensor.
        if not good.any() or np.ptp(trial.observed[good, c]) == 0.0:
            continue
        whole = good[:-3] & good[1:-2] & good[2:-1] & good[3:]
        # A smoother may follow the noise; third differences of white noise have 20 times its variance.
        differed = np.mean(third[whole, c] ** 2) / 20.0 if whole.any() else 0.0
        # Samples without noise have that of their last digit, which is not nothing.
        noise[c] = max(float(np.sqrt(max(np.mean(away[good, c] ** 2), differed))), 1e-6)
    return noise


def pieces(log: PredictedLog) -> tuple[PredictedLog, PredictedLog, Array]:
    """The windows of a log that can be judged whole and cut into pieces, and the piece that each begins with.

    Left out are the first moments of a record.
    """
    trial, startable = log.trial, log.trial.startable
    warm = int(np.searchsorted(trial.t, trial.t[0] + UNKNOWNS_SETTINGS.warm_up_s - 1e-9))
    whole = []
    for start, stop in log.spans:
        begin = next((k for k in range(max(start, warm), stop) if startable[k]), stop)
        if begin == start or 2 * (stop - begin) > stop - start:
            whole.append((begin, stop))
    if len(whole) > UNKNOWNS_SETTINGS.most_windows:
        whole = [whole[k] for k in np.linspace(0, len(whole) - 1, UNKNOWNS_SETTINGS.most_windows).astype(int)]
    length = max(round(UNKNOWNS_SETTINGS.horizon_s / trial.dt), SPREAD_SETTINGS.least_samples)
    cut: list[tuple[int, int]] = []
    first: list[int] = []
    for start, stop in whole:
        first.append(len(cut))
        starts = range(start, stop - 1, length)
        # A stump tells nothing and goes with the piece before it.
        starts = starts[:-1] if len(starts) > 1 and stop - 1 - starts[-1] <= length // 2 else starts
        cut += [
            (a, b + 1 if b < stop else stop)
            for a, b in zip(starts, [*starts[1:], stop], strict=True)
            if startable[a]
        ]
    return _restarted(log, whole), _restarted(log, cut), np.array(first, dtype=int)


def _restarted(log: PredictedLog, spans: Sequence[tuple[int, int]]) -> PredictedLog:
    if not spans:
        return PredictedLog(replace(log.replay, segments=()), (), ())
    substeps = max(1, int(np.ceil(log.trial.dt / UNKNOWNS_SETTINGS.step_s - 1e-9)))
    replay = replace(log.replay, segments=tuple(restarted(log.trial, spans)), substeps=substeps)
    shown = replay.simulated()
    return PredictedLog(replay, tuple(shown), tuple(replay.errors_of(shown)))


@dataclass(frozen=True)
class Point:
    """Where the predictions are linear: values of the unknowns, in units of their standard deviations.

    ``start`` (windows, 12) of the channels at each restart; ``shared`` (k,) of what all windows share.
    """

    start: Array
    shared: Array

    def towards(self, other: Point, share: float) -> Point:
        """The point so far on the way to another one."""
        return Point(
            self.start + share * (other.start - self.start),
            self.shared + share * (other.shared - self.shared),
        )


class Unknowns:
    """A log's residuals and derivatives by all unknowns, each scaled to a prior of one."""

    def __init__(
        self,
        known: Fitted,
        log: PredictedLog,
        groups: Sequence[Sequence[str]],
        noise: Array,
        offsets: Mapping[str, float],
        *,
        water: bool,
    ) -> None:
        self.log, self.groups = log, groups
        self.noise = np.where(np.isfinite(noise), noise, 1.0)
        self.scale = np.where(np.isfinite(noise), noise, UNKNOWNS_SETTINGS.untold)
        self.offsets = np.array([offsets.get(channel, 0.0) for channel in CHANNELS])
        self.root = _root(known.covariance)
        values = log.vehicle.coefficients()
        directions = [{name: values[name] for name in group} for group in groups]
        directions += [{name: 1.0} for name in known.names]
        names = tuple(sorted({name for direction in directions for name in direction}))
        self.replay = replace(log.replay, names=names)
        self.values = np.array([values.get(name, 0.0) for name in names])
        self.rows = np.array([[part.get(name, 0.0) for name in names] for part in directions])
        self.water = ["current_north", "current_east"] if water else []
        self.edges = np.cumsum([0, *(len(part) for part in (groups, known.names, self.water)), 12, 12, 12])
        self.rates = np.stack([_rates(log, w) for w in range(len(log.spans))])
        self.shared = len(CHANNELS) + len(UNKNOWNS_SETTINGS.delayed) + len(self.water) + len(known.names)
        self.delays = np.zeros((len(CHANNELS), len(UNKNOWNS_SETTINGS.delayed)))
        for k, own in enumerate(UNKNOWNS_SETTINGS.delayed):
            self.delays[list(own), k] = UNKNOWNS_SETTINGS.delay_s

    @property
    def measured(self) -> Point:
        """The smoothed starts, and nothing in the sensors or the water."""
        return Point(np.zeros((len(self.log.spans), len(CHANNELS))), np.zeros(self.shared))

    def products(self, at: Point) -> Array:
        """Products (windows, 12, k, k) of start, shared unknowns, groups and residual in units of noise."""
        offset, delay, water, values = self._split(at.shared)
        nuisance = dict.fromkeys(nuisance_names(), 0.0)
        nuisance |= {f"bias_{name}": float(x) for name, x in zip(CHANNELS, offset, strict=True)}
        nuisance |= {f"latency_{name}": float(x) for name, x in zip(CHANNELS, delay, strict=True)}
        nuisance |= dict(zip(self.water, water.tolist(), strict=True))
        # What a sensor reads too late is wrong at the restart too; the core does the same with its bias.
        start = at.start * self.scale + delay * self.rates
        shown = self.replay.sensitivities(
            self.values + values @ self.rows[len(self.groups) :],
            self.rows,
            nuisances=[*self.water, *(f"{kind}_{name}" for kind in ("latency", "bias") for name in CHANNELS)],
            initials=initial_names(),
            nuisance=np.array([list(nuisance.values())]),
            initial=start[:, list(SPREAD_SETTINGS.initial_places)],
        )
        place = np.argsort(SPREAD_SETTINGS.initial_places)  # of each channel among the initial conditions
        products = []
        for w, (residual, slopes) in enumerate(shown):
            by_group, by_name, by_water, by_delay, by_bias, by_start = (
                slopes[:, :, a:b] for a, b in zip(self.edges[:-1], self.edges[1:], strict=True)
            )
            by_start = by_start[:, :, place]
            columns = np.concatenate(
                [
                    by_start * self.scale,
                    by_bias * self.offsets,
                    (by_delay + by_start * self.rates[w]) @ self.delays,
                    UNKNOWNS_SETTINGS.current_m_s * by_water,
                    by_name @ self.root,
                    by_group,
                    residual[:, :, None],
                ],
                axis=2,
            )
            columns = columns / self.noise[:, None]
            by_channel = columns.transpose(1, 0, 2)
            # A vehicle of the wrong coefficients may diverge within a window: its products are not finite.
            with np.errstate(over="ignore", invalid="ignore"):
                products.append(by_channel.transpose(0, 2, 1) @ by_channel)
        return np.array(products)

    def fitted(self, at: Point, products: Array) -> Point:
        """The unknowns that explain the log best with the model as it is, to first order about a point."""
        starts = len(CHANNELS)
        own = with_prior(products, at.start)
        reduced = swept(own, starts).sum(axis=0)
        total = with_prior(reduced[None], at.shared[None])[0]
        last, count = total.shape[0] - 1, self.shared
        step = np.linalg.solve(total[:count, :count] + np.eye(count), total[:count, last])
        pull = own[:, :starts, -1] - own[:, :starts, starts : starts + count] @ step
        moved = np.linalg.solve(own[:, :starts, :starts] + np.eye(starts), pull[:, :, None])[:, :, 0]
        return Point(at.start + moved, at.shared + step)

    def cost(self, at: Point, products: Array) -> float:
        """Sum of squares of residual and priors."""
        return float(products[:, -1, -1].sum() + (at.start**2).sum() + (at.shared**2).sum())

    def _split(self, shared: Array) -> tuple[Array, Array, Array, Array]:
        parts = np.split(shared, np.cumsum([len(CHANNELS), len(UNKNOWNS_SETTINGS.delayed), len(self.water)]))
        return (
            parts[0] * self.offsets,
            self.delays @ parts[1],
            UNKNOWNS_SETTINGS.current_m_s * parts[2],
            self.root @ parts[3],
        )


def with_prior(products: Array, values: Array) -> Array:
    """Products whose first unknowns have moved to values (b, k): their prior pulls them back to zero."""
    count = values.shape[1]
    pulled = products.copy()
    pulled[:, :count, -1] -= values
    pulled[:, -1, :count] -= values
    pulled[:, -1, -1] += (values**2).sum(axis=1)
    return pulled


def explained_best(unknowns: Unknowns, used: Sequence[int], at: Point) -> tuple[Point, Array]:
    """Point where the model explains the log best, and the products (windows, used, k, k) there.

    At the smoothed start a vehicle that never rolled rolls by the noise and the offset of its sensor, and
    that motion would show what the log does not.
    """
    products = unknowns.products(at)[:, used]
    if not np.isfinite(products).all():
        return at, products
    least = unknowns.cost(at, products.sum(axis=1))
    for _ in range(UNKNOWNS_SETTINGS.rounds):
        full, share, gained = unknowns.fitted(at, products.sum(axis=1)), 1.0, 0.0
        # Below a tenth of a step no descent is expected any more.
        while share > 0.1 and not gained:
            point = at.towards(full, share)
            share *= 0.4
            try:
                there = unknowns.products(point)[:, used]
            except SeatrialError:  # no vehicle has such coefficients
                continue
            if not np.isfinite(there).all():  # it diverges within a window
                continue
            cost = unknowns.cost(point, there.sum(axis=1))
            if cost < least:
                at, products, gained, least = point, there, least - cost, cost
        if gained < 0.01 * least:
            break
    return at, products


def _rates(log: PredictedLog, w: int) -> Array:
    """Rates (12,) of the channels at the restart of a window, SI, as the smoothed log has them."""
    trial, start = log.trial, log.spans[w][0]
    nu, rate = trial.smooth_nu(trial.t[start])
    moved = (log.predicted[w][1, 6:9] - log.predicted[w][0, 6:9]) / trial.dt
    return np.concatenate([rate, moved, nu[3:]])  # initial attitudes are small turns about the body axes


def _root(covariance: Array) -> Array:
    values, vectors = np.linalg.eigh(covariance) if len(covariance) else (np.zeros(0), np.zeros((0, 0)))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def swept(products: Array, first: int) -> Array:
    """Products (b, k, k) of what follows the first unknowns, whose prior is one, once these are fitted."""
    if not first:
        return products
    normal = products[:, :first, :first] + np.eye(first)
    cross = products[:, :first, first:]
    return np.asarray(products[:, first:, first:] - cross.transpose(0, 2, 1) @ np.linalg.solve(normal, cross))
