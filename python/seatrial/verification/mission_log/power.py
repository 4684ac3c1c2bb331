"""Which change of the model a log would have shown: per channel and coefficient group, as a factor.

A channel inside its band speaks for a model only where the log could have refuted it. The coefficients of an
axis form three groups (added mass; damping; lift and couplings), the actuators one per group of them. Each is
tried as a factor ``1 + theta`` on all its members. Predictions restarted every `HORIZON_S` leave, per window,

    r = J_theta theta + J_n n + J_0 x_0 + e,

J exact derivatives, x_0 the error of the state at the restart, n what all windows share, e the noise of the
sensors. All but theta are unknowns with a stated size:

| unknown | standard deviation |
|---|---|
| noise e | measured less smoothed, per channel: no model has a part in it; and an error that is stated |
| state at a restart x_0 | that of the noise; smoothing makes it no worse |
| offset of each sensor | as stated by the sensors |
| delay of each group of sensors | `DELAY_S` |
| steady current, where the log tells none | `CURRENT_M_S` |
| coefficients | their covariance |

so that neither the errors of the model nor those of a reference widen what is tolerated. Gauss-Newton steps
find the unknowns that explain the log best with the model as it is (`_linearised`); there, least squares with
these priors (Schur complements, window by window) give theta, a score test of each group. Its variance is
that of the jackknife over windows or, where larger, that of white noise, with Satterthwaite's degrees of
freedom, as in `seatrial.statistics.score_test`. With Student's t, sigma the deviation of theta, and a level
shared by G groups (Holm) and, within a group, by all C channels together and by each of them alone,

    refuted:            |theta| > t(level / 4 G C) sigma   and   the factor is beyond `MATERIAL`,
    shown with 95 %:    |theta| >= max(t(level / 4 G C) sigma, material) + t(5 %) sigma.

The second, of a channel alone, is the smallest change that this channel would have shown. An axis is judged
where a channel would have shown a group of it halved and doubled (`SHOWN`). What no group explains shows as
an error beyond `UNEXPLAINED` times the noise.

Windows are short because a prediction is linear in its start only for so long: a hovering vehicle that rolls
leaves it within seconds.

Source: Rao (1948), Proc. Camb. Phil. Soc. 44:50 (score test); Kuensch (1989), Ann. Stat. 17:1217 (jackknife
of blocks); Satterthwaite (1946), Biometrics Bulletin 2:110.

Tests: ``tests/verification/test_recorded_power.py``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import initial_names, nuisance_names
from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import SeatrialError
from seatrial.base.rotation import shorter
from seatrial.statistics.multiple_testing import holm
from seatrial.vehicle.actuators import actuator_groups
from seatrial.verification.mission_log.restarts import FEWEST, PredictedLog, restarts
from seatrial.verification.mission_log.spread import INITIAL_PLACES

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.identification.fitted import Fitted
    from seatrial.trial.trial import Trial

__all__ = [
    "MATERIAL",
    "SHOWN",
    "CoefficientGroup",
    "GroupTest",
    "Power",
    "Shown",
    "coefficient_groups",
    "group_power",
    "sensor_noise",
]

HORIZON_S = 2.0
"""Length of a window, s: long enough for a drag to move a speed by many times its noise, short enough for the
linear start of a vehicle that leaves its attitude within seconds."""

MATERIAL = 1.25
"""Least factor, or its inverse, that refutes: the best model of a class that lacks something of the vehicle
is off by what it lacks, in single groups by some percent, and still the best one."""

UNEXPLAINED = 2.0
"""Error over noise beyond which a channel is not explained. The noise itself is known to within a factor of
1.7: held samples of a slow sensor look smoother than they are (a true BlueROV2 Heavy with a slow DVL)."""

EXPLAINED = 1.5
"""Error over noise up to which a channel is explained: true models of three vehicles leave 1.0 to 1.3."""

SHOWN = 2.0
"""A channel speaks for a group where the group doubled and halved would both have shown: gain margins of 6 dB
forgive a factor of two in a loop and no more."""

POWER = 0.95

DELAY_S = 0.15
"""Delay that an import may have left in a sensor: a Doppler log's ping, processing and line take 0.12 s."""

CURRENT_M_S = 1.0
"""Of a steady current that the log does not tell: a strong tidal stream."""

_MOST_WINDOWS = 150
"""Of a longer log evenly spaced ones: time grows with their number, sigma falls with its root alone."""

_FEWEST_WINDOWS = 6

_ROUNDS = 3

_UNTOLD = np.repeat([0.5, 0.2, 1e-9, 0.1], 3)
"""Of the start in a channel that no sensor tells, m/s, rad/s, m and rad: the smoothed log has zero there, or
what it makes of other channels. A position is told by nothing and acts on nothing."""

_DELAYED = ((0, 1, 2), (3, 4, 5), (6, 7), (8,), (9, 10, 11))
"""Channels that one instrument tells."""

_ADDED = re.compile(r"[XYZKMN]_[uvwpqr]dot")
_OWN = {axis: re.compile(rf"{axis}_({own})\1?") for axis, own in zip("XYZKMN", "uvwpqr", strict=True)}
_ANY = re.compile(r"[XYZKMN]_[uvwpqr]{1,2}")


@dataclass(frozen=True)
class CoefficientGroup:
    """Coefficients that a factor scales together: of an axis (empty for actuators), of a kind."""

    axis: str
    kind: str
    names: tuple[str, ...]

    @property
    def words(self) -> str:
        """Name of the group for a sentence."""
        return f"{self.kind} of {self.axis}" if self.axis else self.kind


def coefficient_groups(vehicle: Vehicle, *, actuators: bool = True) -> tuple[CoefficientGroup, ...]:
    """Groups of a vehicle: per axis added mass, damping, lift and couplings; gains per group of actuators.

    Examples
    --------
    >>> import seatrial as st
    >>> found = coefficient_groups(st.Vehicle.load("cwolf"))
    >>> [one.names for one in found if one.axis == "M"]
    [('M_qdot',), ('M_q', 'M_qq'), ('M_uq', 'M_uw')]
    """
    values = vehicle.coefficients()
    sorted_in: dict[tuple[str, str], list[str]] = {
        (axis, kind): [] for axis in "XYZKMN" for kind in ("added mass", "damping", "lift and couplings")
    }
    for name, value in values.items():
        axis = name[:1]
        if not value:
            continue
        if _ADDED.fullmatch(name):
            sorted_in[axis, "added mass"].append(name)
        elif _ANY.fullmatch(name):
            own = _OWN[axis].fullmatch(name)
            sorted_in[axis, "damping" if own else "lift and couplings"].append(name)
    found = [CoefficientGroup(*key, tuple(names)) for key, names in sorted_in.items() if names]
    if actuators:
        facts = vehicle.actuator_info()
        for group, members in actuator_groups(vehicle).items():
            gains = tuple(f"{one}.gain" for one in members if values.get(f"{one}.gain"))
            fins = all(facts[one]["kind"] == "fin" for one in members)
            if gains:
                found.append(CoefficientGroup("", f"{'lift' if fins else 'thrust'} of {group}", gains))
    return tuple(found)


@dataclass(frozen=True)
class Shown:
    """Smallest change of a group that a channel would have shown with 95 % power, as factors.

    ``down`` is below one, ``up`` above; None where no factor of that side would have shown.
    """

    down: float | None
    up: float | None

    @property
    def enough(self) -> bool:
        """Whether the group halved and doubled would both have shown."""
        return self.down is not None and self.down >= 1.0 / SHOWN and self.up is not None and self.up <= SHOWN


@dataclass(frozen=True)
class GroupTest:
    """What a log says of a group.

    Attributes
    ----------
    group
        Its coefficients.
    factor, sigma
        Factor on them that this log asks for beyond the stated intervals, and its standard deviation.
    p
        Of no change, adjusted over the groups (Holm).
    refuted
        Whether the factor is material and no chance.
    by_channel
        Smallest change that each channel alone would have shown.
    against
        Channels whose own estimate is as far off, where it is refuted.
    """

    group: CoefficientGroup
    factor: float
    sigma: float
    p: float
    refuted: bool
    by_channel: Mapping[str, Shown]
    against: tuple[str, ...]

    @property
    def best(self) -> str:
        """Channel that shows the smallest change; empty where none would have shown one of both sides."""
        able = [name for name, one in self.by_channel.items() if one.down is not None]
        return min(able, key=lambda name: self.by_channel[name].up or np.inf, default="")

    @property
    def enough(self) -> bool:
        """Whether a channel would have shown the group halved and doubled."""
        return any(one.enough for one in self.by_channel.values())

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "axis": self.group.axis,
            "kind": self.group.kind,
            "coefficients": list(self.group.names),
            "factor": self.factor,
            "sigma": self.sigma,
            "p": self.p,
            "refuted": self.refuted,
            "against": list(self.against),
            "shown": {name: {"down": one.down, "up": one.up} for name, one in self.by_channel.items()},
        }


@dataclass(frozen=True)
class Power:
    """What a log could have refuted, and what it refutes.

    Attributes
    ----------
    tests
        A test per group.
    controlled
        Letters of the axes that the vehicle controls.
    windows
        How many restarts it rests on.
    left
        Error of each channel over what noise, start and stated intervals explain: about one.
    """

    tests: tuple[GroupTest, ...]
    controlled: str
    windows: int
    left: Mapping[str, float]

    @property
    def refuted(self) -> tuple[GroupTest, ...]:
        """Groups that the log refutes, the surest first."""
        refuted = (one for one in self.tests if one.refuted)
        return tuple(sorted(refuted, key=lambda one: -abs(one.factor - 1.0) / one.sigma))

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Channels whose error is far beyond the noise, the farthest first."""
        return tuple(
            sorted((name for name, x in self.left.items() if x > UNEXPLAINED), key=lambda c: -self.left[c])
        )

    def doubts(self, channel: str) -> bool:
        """Whether a share outside the band that is hardly chance is left to doubt the model by.

        Not where the channel could have refuted the model and its error is that of its noise.
        """
        return not self.shown_in(channel) or self.left.get(channel, np.inf) > EXPLAINED

    def shown_in(self, channel: str) -> tuple[GroupTest, ...]:
        """Groups of which a channel would have shown the half and the double, the best shown first."""
        shown = [one for one in self.tests if channel in one.by_channel and one.by_channel[channel].enough]
        return tuple(sorted(shown, key=lambda one: one.by_channel[channel].up or 0.0))

    @property
    def unjudged(self) -> str:
        """Letters of the controlled axes of which no channel would have shown a group halved and doubled."""
        judged = {one.group.axis for one in self.tests if one.enough}
        return "".join(axis for axis in self.controlled if axis not in judged)

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data."""
        return {
            "controlled_axes": list(self.controlled),
            "unjudged_axes": list(self.unjudged),
            "windows": self.windows,
            "left": dict(self.left),
            "groups": [one.to_dict() for one in self.tests],
        }


def sensor_noise(trial: Trial) -> Array:
    """Noise (12,) of the sensors, SI, by the smoothed log and by third differences; infinite without any."""
    from scipy.spatial.transform import Rotation

    position, attitude, nu = trial.state(np.arange(len(trial)))
    angles = Rotation.from_quat(attitude, scalar_first=True).as_euler("ZYX")[:, ::-1]
    away = trial.observed - np.concatenate([nu, position, angles], axis=1)
    away[:, 9:] = shorter(np.nan_to_num(away[:, 9:]))
    found = np.full(len(CHANNELS), np.inf)
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
        found[c] = max(float(np.sqrt(max(np.mean(away[good, c] ** 2), differed))), 1e-6)
    return found


def group_power(
    known: Fitted,
    log: PredictedLog,
    *,
    offsets: Mapping[str, float],
    level: float,
    stated: Mapping[str, float] | None = None,
    hidden: str = "",
    water: bool = True,
) -> Power:
    """Power and tests of the coefficient groups on the part of a log that is judged.

    Parameters
    ----------
    known : Fitted
        The model, with the covariance of its coefficients.
    log : PredictedLog
        What is judged.
    offsets : mapping of str to float
        Standard deviation of the offset of each channel's sensor, SI.
    level : float
        Chance of a false alarm over all groups.
    stated : mapping of str to float, optional
        Root mean square error of a valid model per channel, SI, as it was stated.
    hidden : str, optional
        Letters of the axes whose channels tell nothing.
    water : bool, optional
        Whether the current is unknown: not logged, or fitted to this log.

    Raises
    ------
    TrialError
        No window can start.
    """
    short = _short_windows(log).without(hidden)
    controlled = "".join(log.vehicle.controllable) or "XYZKMN"
    groups = coefficient_groups(log.vehicle, actuators=log.input != "tau")
    count = len(short.spans)
    if count < _FEWEST_WINDOWS or not groups or not all(np.isfinite(one).all() for one in short.predicted):
        return Power((), controlled, count, {})
    noise = np.hypot(sensor_noise(short.trial), [(stated or {}).get(name, 0.0) for name in CHANNELS])
    told = short.channels if stated is None else [name for name in short.channels if name in stated]
    used = [c for c in range(len(CHANNELS)) if CHANNELS[c] in told and np.isfinite(noise[c])]
    if not used:
        return Power((), controlled, count, {})
    at, products = _linearised(_Unknowns(known, short, groups, noise, offsets, water=water), used)
    if not np.isfinite(products).all():
        return Power((), controlled, count, {})
    together = _estimates(products.sum(axis=1), at, len(groups))
    alone = [_estimates(products[:, k], at, len(groups)) for k in range(len(used))]
    names = [CHANNELS[c] for c in used]
    # Half of the level for all channels together, half for each of them alone.
    least = np.minimum(2.0 * together.p, 2.0 * len(used) * np.min([one.p for one in alone], axis=0))
    adjusted = holm(np.minimum(least, 1.0).tolist())
    own = level / (2.0 * len(used) * len(groups))
    tests = []
    for g, group in enumerate(groups):
        surest = min([together, *alone], key=lambda one: one.p[g])
        refuted = bool(adjusted[g] < level and _material(surest.theta[g]))
        against = [one.p[g] < own and _material(one.theta[g]) for one in alone]
        tests.append(
            GroupTest(
                group,
                1.0 + float(surest.theta[g]),
                float(surest.sigma[g]),
                float(adjusted[g]),
                refuted,
                {name: _smallest(one, g, own) for name, one in zip(names, alone, strict=True)},
                tuple(name for name, here in zip(names, against, strict=True) if here and refuted),
            )
        )
    samples = sum(mask[:, used].sum(axis=0) for mask in short.counted)
    left = np.sqrt(products[:, :, -1, -1].sum(axis=0) / samples)
    return Power(tuple(tests), controlled, count, dict(zip(names, left.tolist(), strict=True)))


def _material(theta: float) -> bool:
    return not 1.0 / MATERIAL <= 1.0 + theta <= MATERIAL


def _short_windows(log: PredictedLog) -> PredictedLog:
    """The same part of the log, restarted every `HORIZON_S`; evenly spaced ones of many."""
    trial = log.trial
    short = restarts(
        log.vehicle,
        trial,
        ahead_s=max(HORIZON_S, FEWEST * trial.dt),
        start_s=float(trial.t[log.spans[0][0]]),
        stop_s=float(trial.t[log.spans[-1][1] - 1]) + 0.5 * trial.dt,
        input=log.input,
    )
    count = len(short.spans)
    if count <= _MOST_WINDOWS:
        return short
    kept = np.unique(np.linspace(0, count - 1, _MOST_WINDOWS).astype(int))
    return PredictedLog(
        replace(short.replay, segments=tuple(short.replay.segments[k] for k in kept)),
        tuple(short.predicted[k] for k in kept),
        tuple(short.residual[k] for k in kept),
    )


@dataclass(frozen=True)
class _Point:
    """Where the predictions are linear: values of the unknowns, in units of their standard deviations.

    ``start`` (windows, 12) of the channels at each restart; ``shared`` (k,) of what all windows share.
    """

    start: Array
    shared: Array


class _Unknowns:
    """A log's residuals and derivatives by all unknowns, each scaled to a prior of one."""

    def __init__(
        self,
        known: Fitted,
        log: PredictedLog,
        groups: Sequence[CoefficientGroup],
        noise: Array,
        offsets: Mapping[str, float],
        *,
        water: bool,
    ) -> None:
        self.log, self.groups = log, groups
        self.noise = np.where(np.isfinite(noise), noise, 1.0)
        self.scale = np.where(np.isfinite(noise), noise, _UNTOLD)
        self.offsets = np.array([offsets.get(channel, 0.0) for channel in CHANNELS])
        self.root = _root(known.covariance)
        values = log.vehicle.coefficients()
        directions = [{name: values[name] for name in one.names} for one in groups]
        directions += [{name: 1.0} for name in known.names]
        names = tuple(sorted({name for one in directions for name in one}))
        self.replay = replace(log.replay, names=names)
        self.values = np.array([values.get(name, 0.0) for name in names])
        self.rows = np.array([[one.get(name, 0.0) for name in names] for one in directions])
        self.water = ["current_north", "current_east"] if water else []
        self.edges = np.cumsum([0, *(len(one) for one in (groups, known.names, self.water)), 12, 12, 12])
        self.rates = np.stack([_rates(log, w) for w in range(len(log.spans))])
        self.shared = len(CHANNELS) + len(_DELAYED) + len(self.water) + len(known.names)
        self.delays = np.zeros((len(CHANNELS), len(_DELAYED)))
        for k, own in enumerate(_DELAYED):
            self.delays[list(own), k] = DELAY_S

    @property
    def measured(self) -> _Point:
        """The smoothed starts, and nothing in the sensors or the water."""
        return _Point(np.zeros((len(self.log.spans), len(CHANNELS))), np.zeros(self.shared))

    def products(self, at: _Point) -> Array:
        """Products (windows, 12, k, k) of start, shared unknowns, groups and residual in units of noise."""
        offset, delay, water, values = self._split(at.shared)
        nuisance = dict.fromkeys(nuisance_names(), 0.0)
        nuisance |= {f"bias_{name}": float(x) for name, x in zip(CHANNELS, offset, strict=True)}
        nuisance |= {f"latency_{name}": float(x) for name, x in zip(CHANNELS, delay, strict=True)}
        nuisance |= dict(zip(self.water, water.tolist(), strict=True))
        # What a sensor reads too late is wrong at the restart too; the core does the same with its bias.
        start = at.start * self.scale + delay * self.rates
        found = self.replay.sensitivities(
            self.values + values @ self.rows[len(self.groups) :],
            self.rows,
            nuisances=[*self.water, *(f"{kind}_{name}" for kind in ("latency", "bias") for name in CHANNELS)],
            initials=initial_names(),
            nuisance=np.array([list(nuisance.values())]),
            initial=start[:, list(INITIAL_PLACES)],
        )
        place = np.argsort(INITIAL_PLACES)  # of each channel among the initial conditions
        products = []
        for w, (residual, slopes) in enumerate(found):
            by_group, by_name, by_water, by_delay, by_bias, by_start = (
                slopes[:, :, a:b] for a, b in zip(self.edges[:-1], self.edges[1:], strict=True)
            )
            by_start = by_start[:, :, place]
            columns = np.concatenate(
                [
                    by_start * self.scale,
                    by_bias * self.offsets,
                    (by_delay + by_start * self.rates[w]) @ self.delays,
                    CURRENT_M_S * by_water,
                    by_name @ self.root,
                    by_group,
                    residual[:, :, None],
                ],
                axis=2,
            )
            columns = columns / self.noise[:, None]
            by_channel = columns.transpose(1, 0, 2)
            products.append(by_channel.transpose(0, 2, 1) @ by_channel)
        return np.array(products)

    def fitted(self, at: _Point, products: Array) -> _Point:
        """The unknowns that explain the log best with the model as it is, to first order about a point."""
        starts = len(CHANNELS)
        own = _with_prior(products, at.start)
        reduced = _swept(own, starts).sum(axis=0)
        total = _with_prior(reduced[None], at.shared[None])[0]
        last, count = total.shape[0] - 1, self.shared
        step = np.linalg.solve(total[:count, :count] + np.eye(count), total[:count, last])
        pull = own[:, :starts, -1] - own[:, :starts, starts : starts + count] @ step
        moved = np.linalg.solve(own[:, :starts, :starts] + np.eye(starts), pull[:, :, None])[:, :, 0]
        return _Point(at.start + moved, at.shared + step)

    def cost(self, at: _Point, products: Array) -> float:
        """Sum of squares of residual and priors."""
        return float(products[:, -1, -1].sum() + (at.start**2).sum() + (at.shared**2).sum())

    def _split(self, shared: Array) -> tuple[Array, Array, Array, Array]:
        parts = np.split(shared, np.cumsum([len(CHANNELS), len(_DELAYED), len(self.water)]))
        return (parts[0] * self.offsets, self.delays @ parts[1], CURRENT_M_S * parts[2], self.root @ parts[3])


def _with_prior(products: Array, values: Array) -> Array:
    """Products whose first unknowns have moved to values (b, k): their prior pulls them back to zero."""
    count = values.shape[1]
    found = products.copy()
    found[:, :count, -1] -= values
    found[:, -1, :count] -= values
    found[:, -1, -1] += (values**2).sum(axis=1)
    return found


def _linearised(unknowns: _Unknowns, used: Sequence[int]) -> tuple[_Point, Array]:
    """Point where the model explains the log best, and the products (windows, used, k, k) there.

    At the smoothed start a vehicle that never rolled rolls by the noise and the offset of its sensor, and
    that motion would show what the log does not.
    """
    at = unknowns.measured
    products = unknowns.products(at)[:, used]
    least = unknowns.cost(at, products.sum(axis=1))
    for _ in range(_ROUNDS):
        tried = unknowns.fitted(at, products.sum(axis=1))
        try:
            there = unknowns.products(tried)[:, used]
        except SeatrialError:  # no vehicle has such coefficients
            break
        cost = unknowns.cost(tried, there.sum(axis=1))
        if not (np.isfinite(there).all() and cost < least):
            break
        at, products, gained, least = tried, there, least - cost, cost
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


@dataclass(frozen=True)
class _Estimates:
    """Relative changes (G,) of the groups, each alone, their deviations, degrees of freedom and p-values."""

    theta: Array
    sigma: Array
    freedom: Array
    p: Array


def _estimates(products: Array, at: _Point, groups: int) -> _Estimates:
    """Estimates from the products (windows, k, k) of one channel, or of several together."""
    from scipy.stats import t as student

    own = _swept(_with_prior(products, at.start), len(CHANNELS))  # the start of each window is its own
    total = own.sum(axis=0)
    shared = len(at.shared)
    full = _swept(_with_prior(total[None], at.shared[None]), shared)[0]
    without = _swept(_with_prior(total - own, at.shared[None]), shared)  # jackknife: all windows but one
    square, pull = np.diag(full)[:-1], full[:-1, -1]
    squares = np.diagonal(without, axis1=1, axis2=2)[:, :-1]
    # What the unknowns explain nearly whole is not told.
    known = square > 1e-9 * np.maximum(np.diag(total)[shared:-1], 1e-300)
    size = np.where(known, square, 1.0)
    theta = np.where(known, pull / size, 0.0)
    away = np.where(known, without[:, :-1, -1] / np.maximum(squares, 1e-9 * size) - theta, 0.0)
    count = len(own)
    sigma = np.sqrt(np.maximum((count - 1) / count * (away**2).sum(axis=0), 1.0 / size))
    share = np.maximum(square - squares, 0.0)
    freedom = share.sum(axis=0) ** 2 / np.maximum((share**2).sum(axis=0), 1e-300) - 1.0
    known &= freedom >= 1.0
    freedom, sigma = np.maximum(freedom, 1.0), np.where(known, sigma, np.inf)
    p = np.where(known, 2.0 * student.sf(np.abs(theta) / sigma, freedom), 1.0)
    return _Estimates(theta, sigma, freedom, p)


def _swept(products: Array, first: int) -> Array:
    """Products (b, k, k) of what follows the first unknowns, whose prior is one, once these are fitted."""
    if not first:
        return products
    normal = products[:, :first, :first] + np.eye(first)
    cross = products[:, :first, first:]
    return np.asarray(products[:, first:, first:] - cross.transpose(0, 2, 1) @ np.linalg.solve(normal, cross))


def _smallest(of: _Estimates, g: int, level: float) -> Shown:
    """Smallest factors that would be refuted with the chance `POWER`."""
    from scipy.stats import t as student

    sigma = float(of.sigma[g])
    if not np.isfinite(sigma):
        return Shown(None, None)
    critical, beyond = student.isf([0.5 * level, 1.0 - POWER], of.freedom[g]) * sigma
    up = max(critical, MATERIAL - 1.0) + beyond
    down = max(critical, 1.0 - 1.0 / MATERIAL) + beyond
    return Shown(float(1.0 - down) if down < 1.0 else None, float(1.0 + up))
