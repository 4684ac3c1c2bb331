"""A slow current from velocity over ground, as a random walk of its north and east components.

With the velocity through the water ``R (v_ground - v_water) = c`` is measured directly. Without it legs and
turns over several headings tell it: under a held propeller command, or a held thrust (by its root), the
hull's motion through the water follows the yaw rate alone,
``u = a n + f(r^2) + (1 - k) cos theta (cos psi c_n + sin psi c_e)`` and
``v = b + g(r) - sin psi c_n + cos psi c_e``, with n the propeller's command (one where none is logged), b
the sensor's own sway, and f and g sums of the yaw rate through first-order lags. The share k of the current
that the speed over ground does not follow is zero for a propeller alone and towards one under a speed
control over ground. Current and coefficients are linear least squares with a random walk between knots; its
intensity, k and the noises of straight and turning parts are those of the greatest marginal likelihood.
Parts without way or where it is gained are left out: there a hull is slower than its thrust says.
Held by ``tests/inspect/test_consistency.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import DEGREE
from seatrial.base.finding import Finding, Severity
from seatrial.inspect.corrections import SlowCurrent
from seatrial.statistics.blocks import lag_one_correlation, variance_inflation
from seatrial.trial.kinematics import Channels, earth_velocity


@dataclass(frozen=True)
class SlowCurrentSettings:
    """From which legs a slow current is told, and how freely it may walk."""

    part_s: float = 2.0  #: Samples are averaged over so long, s: shorter than any turn.
    most_parts: int = 10_000  #: Parts of a log of many hours, which are longer then.
    knot_s: float = 60.0  #: The current runs linearly between knots, s.
    most_knots: int = 120  #: Knots in a log of many hours, further apart then.
    settled_s: float = 15.0  #: After a turn, s, from which a leg is straight.
    straight_rate: float = 1.0 * DEGREE  #: Yaw rate, rad/s, above which the vehicle turns: 1 deg/s.
    #: Deviation, s, of the smoothing of the yaw rate, lest waves count as turns.
    rate_smoothed_s: float = 3.0
    #: Relative change of the propeller's command within the time to settle up to which it is held.
    steady_change: float = 0.02
    no_way_share: float = 0.5  #: Of the median speed: a hull below it has no way.
    under_way_share: float = 0.95  #: Of the median speed ahead in time: a hull that reaches it is under way.
    ahead_s: float = 60.0  #: Seconds that follow, over which that median is taken.
    lags_s: tuple[float, float, float] = (0.0, 2.0, 6.0)  #: Lags of the hull behind its yaw rate, s.
    widest_m_s: float = 0.10  #: Mean deviation, m/s: a less certain current is not told.
    fewest_parts: int = 50  #: Known parts that tell a current.
    start_m_s: float = 1.0  #: Prior deviation of the current, m/s.
    walk_m_s: float = 3e-3  #: Prior deviation of its change in a minute, m/s.
    sway_m_s: float = 0.05  #: Prior deviation of the sensor's own sway, m/s: a degree at three m/s.
    held_out_s: float = 60.0  #: Blocks of time, s, that are predicted from the others.
    folds: int = 5  #: How many sets of such blocks are predicted by turns.
    hull_lag_s: float = 6.0  #: By which the speed of a hull follows its propeller, s.
    share_sd: float = 0.3  #: Prior deviation of the share k.


SETTINGS = SlowCurrentSettings()


def slow_current(channels: Channels) -> SlowCurrent | Finding:
    """Current over time, or why the log does not tell it."""
    have = set(channels.curves)
    if "yaw" not in have or not {"u", "v"} <= have:
        return _untold("channels")
    names = ("u", "v", "w", "roll", "pitch", "yaw")
    water = {"u_water", "v_water"} <= have
    used = (*names, *(("u_water", "v_water", "w_water") if water else ()))
    grid = channels.grid(used, 2.0)
    if grid is None:
        return _untold("times")
    t = grid.t
    known = channels.known(used, t, {})
    pitch, yaw = (channels.at(name, t, {}) for name in ("pitch", "yaw"))
    ground = np.stack([channels.at(name, t, {}) for name in "uvw"], axis=1)
    design = np.zeros((len(t), 2, 2))
    if water:
        through = np.stack([channels.at(f"{name}_water", t, {}) for name in "uvw"], axis=1)
        if "w_water" not in have:
            through[:, 2] = ground[:, 2]
        measured = earth_velocity(channels.rotation(t), ground - through)[:, :2]
        design[:, 0, 0] = design[:, 1, 1] = 1.0
        legs = _Legs(t, known, np.zeros(len(t), bool), measured, design, np.zeros((len(t), 2, 0)), False)
        return _told(legs, "velocity over ground less that through the water")
    # Without it the hull is the instrument: where its propeller is held and it does not gain way.
    rate, course_rate = _rate(t, yaw, 0.5), _rate(t, yaw, SETTINGS.rate_smoothed_s)
    held, n, source = _held(channels, t)
    known &= held & ~_gains_way(np.hypot(ground[:, 0], ground[:, 1]), known, t)
    turning = _recently(np.abs(course_rate) > SETTINGS.straight_rate, t)
    if (known & ~turning).sum() * grid.step < 2.0 * SETTINGS.settled_s:
        return _untold("no leg")
    if 1.0 - np.abs(np.mean(np.exp(1j * yaw[known]))) < 0.3:
        return _untold("one heading")
    design[:, 0, 0], design[:, 0, 1] = np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw)
    design[:, 1, 0], design[:, 1, 1] = -np.sin(yaw), np.cos(yaw)
    # What the hull itself makes of its turns, at several lags: sway, and a loss of speed.
    turns = [_lagged(rate, lag, grid.step) for lag in SETTINGS.lags_s]
    slowed = [_lagged(rate**2, lag, grid.step) for lag in SETTINGS.lags_s]
    own = np.zeros((len(t), 2, 2 + 2 * len(SETTINGS.lags_s)))
    own[:, 0, 0], own[:, 1, 1] = n, SETTINGS.sway_m_s
    for k, (turn, slow) in enumerate(zip(turns, slowed, strict=True)):
        own[:, 1, 2 + 2 * k], own[:, 0, 3 + 2 * k] = turn, slow
    return _told(_Legs(t, known, turning, ground[:, :2], design, own, True), source)


def _untold(why: str, **values: Any) -> Finding:
    return Finding("current untold", Severity.NOTE, why, values)


def _rate(t: Array, yaw: Array, over_s: float) -> Array:
    """Yaw rate (n,), smoothed by a Gaussian of this deviation."""
    from scipy.ndimage import gaussian_filter1d

    step = float(t[1] - t[0])
    return np.asarray(gaussian_filter1d(yaw, over_s / step, order=1) / step)


def _gains_way(speed: Array, known: Mask, t: Array) -> Mask:
    """Where the hull lies still, or gains way and does not yet move as its thrust says, (n,)."""
    from scipy.ndimage import uniform_filter1d

    step = float(t[1] - t[0])
    speed = uniform_filter1d(speed, max(1, round(10.0 / step)))
    still = known & (speed < SETTINGS.no_way_share * np.median(speed[known])) if known.any() else ~known
    settled, ahead = still.copy(), round(SETTINGS.ahead_s / step)
    for end in np.flatnonzero(still[:-1] & ~still[1:]) + 1:
        later = speed[end:] >= SETTINGS.under_way_share * np.median(speed[end : end + ahead])
        settled[end : end + int(np.argmax(later))] = True
    return _recently(settled, t)


def _recently(here: Mask, t: Array) -> Mask:
    """Where it was so within the last seconds of settling, (n,)."""
    from scipy.ndimage import maximum_filter1d

    length = max(1, round(SETTINGS.settled_s / float(t[1] - t[0])))
    return np.asarray(maximum_filter1d(here.astype(np.uint8), length, origin=(length - 1) // 2)).astype(bool)


def _lagged(x: Array, lag: float, step: float) -> Array:
    """Signal (n,) behind a first-order lag of so many seconds."""
    from scipy.signal import lfilter

    if lag == 0.0:
        return x
    keep = np.exp(-step / lag)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], x))


def _held(channels: Channels, t: Array) -> tuple[Mask, Array, str]:
    """Where the propeller's command is held (n,), the command with median one (n,), and the source."""
    # A thrust holds the square of a speed, a revolution the speed itself.
    inputs = {
        name.removeprefix("cmd."): (c, 1.0) for name, c in channels.curves.items() if name[:4] == "cmd."
    }
    if "tau.X_n" in channels.curves:
        inputs["thrust"] = (channels.curves["tau.X_n"], 0.5)
    step, everywhere = float(t[1] - t[0]), np.ones(len(t), bool)
    candidates: list[tuple[float, str, Array]] = []
    for name, (curve, power) in inputs.items():
        index = np.clip(np.searchsorted(curve.t, t, side="right") - 1, 0, len(curve.t) - 1)
        values = np.abs(curve.values[index]) ** power
        level = float(np.median(values))
        # A propeller is never near zero for long; a rudder is.
        if level > 0.0 and np.std(values) < 0.5 * level:
            candidates.append((level, name, values / level))
    # Revolutions and pulses are larger numbers than angles of a plane that is held up or down.
    candidates.sort(key=lambda candidate: -candidate[0])
    for _, name, n in candidates:
        still = ~_recently(np.abs(np.gradient(n, t)) * SETTINGS.settled_s > SETTINGS.steady_change, t)
        if np.mean(still) > 0.5:
            return still, n, f"legs and turns at held {name}"
    if candidates:
        _, name, n = candidates[0]
        return everywhere, _lagged(n, SETTINGS.hull_lag_s, step), f"legs, turns and the command of {name}"
    return everywhere, np.ones(len(t)), "legs and turns at an assumed constant thrust"


@dataclass(frozen=True)
class _Legs:
    """Velocities (n, 2) as `design` (n, 2, 2) times the current plus `own` (n, 2, k) times constants."""

    t: Array
    known: Mask
    turning: Mask
    measured: Array
    design: Array
    own: Array
    shared: bool


def _told(legs: _Legs, source: str) -> SlowCurrent | Finding:
    """Current of the greatest marginal likelihood, or why it is not told."""
    from scipy.optimize import minimize

    parts = _averaged(legs)
    if parts is None:
        return _untold("few samples")
    start = np.array([np.log(SETTINGS.walk_m_s), *np.log([0.02, 0.02, 0.05, 0.05]), 0.0])
    used = start.size if legs.shared else 3
    options = {"xatol": 0.02, "fatol": 0.05, "maxfev": 400}
    best, least = start, np.inf
    # The likelihood may have one maximum where the propeller explains the speed and one where k does.
    for share in (0.0, 0.5) if legs.shared else (0.0,):
        first = np.append(start[:-1], share)
        simplex = np.vstack([first[:used], first[:used] + np.diag([1.0, 0.5, 0.5, 0.5, 0.5, 0.2][:used])])
        result = minimize(
            lambda x: parts.solve(np.append(x, start[used:]))[0],
            first[:used],
            method="Nelder-Mead",
            options=options | {"initial_simplex": simplex},
        )
        if result.fun < least:
            best, least = np.append(result.x, start[used:]), float(result.fun)
    _, current, sd = parts.solve(best)
    if legs.shared:
        sd = np.hypot(sd, parts.by_share(best))
    wide = float(np.sqrt(np.mean(sd**2)))
    if wide > SETTINGS.widest_m_s:
        return _untold("uncertain", source=source, sd_m_s=wide)
    return SlowCurrent(
        parts.knots,
        current,
        sd,
        source,
        parts.predicted(best, current=False),
        parts.predicted(best, current=True),
    )


def _averaged(legs: _Legs) -> _Parts | None:
    """Means over parts of time that are known for the most part."""
    part_s = max(SETTINGS.part_s, float(legs.t[-1] - legs.t[0]) / SETTINGS.most_parts)
    part = ((legs.t - legs.t[0]) / part_s).astype(int)
    count = int(part.max()) + 1
    number = np.bincount(part[legs.known], minlength=count)
    whole = number >= 0.5 * part_s / (legs.t[1] - legs.t[0])
    if whole.sum() < SETTINGS.fewest_parts:
        return None

    def mean(y: Array) -> Array:
        flat = y[legs.known].reshape(int(legs.known.sum()), -1)
        sums = np.zeros((count, flat.shape[1]))
        for k, column in enumerate(flat.T):
            sums[:, k] = np.bincount(part[legs.known], column, count)
        return np.asarray(
            (sums / np.maximum(number, 1)[:, None])[whole].reshape(int(whole.sum()), *y.shape[1:])
        )

    t = mean(legs.t[:, None])[:, 0]
    places = min(round((t[-1] - t[0]) / SETTINGS.knot_s) + 1, SETTINGS.most_knots)
    knots = np.linspace(t[0], t[-1], max(2, places))
    turning = mean(legs.turning[:, None].astype(float))[:, 0] > 0.5
    return _Parts(t, knots, turning, mean(legs.measured), mean(legs.design), mean(legs.own))


class _Parts:
    """Averaged measurements and their linear model in the current's knots and the constants."""

    def __init__(self, t: Array, knots: Array, turning: Mask, y: Array, design: Array, own: Array) -> None:
        from scipy.sparse import csr_array

        self.t, self.knots, self.turning, self.y = t, knots, turning, y
        place = np.interp(t, knots, np.arange(len(knots)))
        before = np.minimum(place.astype(int), len(knots) - 2)
        hat = np.zeros((len(t), len(knots)))
        hat[np.arange(len(t)), before] = 1.0 - (place - before)
        hat[np.arange(len(t)), before + 1] = place - before
        # Columns: north at the knots, east at the knots, constants; rows: both velocities of a part.
        self.current = np.concatenate([design[:, :, i, None] * hat[:, None, :] for i in range(2)], axis=2)
        self.own = own
        # A part is tied to two knots and the constants: the rows of both are mostly zeros.
        self._rows = csr_array(np.concatenate([self.current, own], axis=2).reshape(2 * len(t), -1))

    def solve(self, x: Array) -> tuple[float, Array, Array]:
        """Negative log marginal likelihood, current (m, 2) and deviations (m, 2), m/s, for `x`: logarithms of
        the walk per minute and of the noise of both velocities on legs and in turns, m/s, and the share k.
        """
        walk = np.exp(np.clip(x[0], -12.0, 0.0))
        noise = np.exp(np.clip(x[1:5], -9.0, 1.0)).reshape(2, 2)
        y, m = self.y, len(self.knots)
        flat, target = self._rows.copy(), y.ravel()
        along = np.repeat(np.arange(flat.shape[0]) % 2 == 0, np.diff(flat.indptr))
        flat.data *= 1.0 - x[5] * (along & (flat.indices < 2 * m))
        sigma = np.where(self.turning[:, None], noise[1], noise[0]).ravel()
        prior = self._prior(walk, flat.shape[1])
        weight = 1.0 / sigma**2
        solution = np.zeros(flat.shape[1])
        for _ in range(3):  # Huber's weights: a part with a jerk counts as one three deviations off
            weighted = flat.multiply(weight[:, None]).T
            normal = (weighted @ flat).toarray() + prior
            solution = np.linalg.solve(normal, weighted @ target)
            error = np.abs(target - flat @ solution) / sigma
            weight = 1.0 / sigma**2 / np.maximum(error / 3.0, 1.0)
        loss = float(np.sum(np.where(error < 3.0, 0.5 * error**2, 3.0 * error - 4.5)))
        cost = loss + float(np.sum(np.log(sigma))) + 0.5 * float(solution @ prior @ solution)
        cost += 0.5 * float(np.linalg.slogdet(normal)[1] - np.linalg.slogdet(prior)[1])
        # A current walks slowly: half of the intensities are below 3 mm/s a minute (log-normal prior).
        cost += 0.5 * ((x[0] - np.log(SETTINGS.walk_m_s)) / 1.0) ** 2 + 0.5 * (x[5] / SETTINGS.share_sd) ** 2
        # Neighbouring parts share waves and what the hull's model misses.
        residual = (target - flat @ solution).reshape(y.shape) / sigma.reshape(y.shape)
        memory = max(lag_one_correlation(residual[:, i], most=0.95) for i in range(2))
        variance = np.diag(np.linalg.inv(normal))[: 2 * m] * variance_inflation(memory)
        return cost, solution[: 2 * m].reshape(2, m).T, np.sqrt(variance).reshape(2, m).T

    def predicted(self, x: Array, *, current: bool) -> tuple[float, float]:
        """Root mean square error of both velocities, m/s, each block of time predicted from the others."""
        own, m = self.own, len(self.knots)
        walk = np.exp(np.clip(x[0], -12.0, 0.0))
        sigma = np.exp(np.clip(x[1:5], -9.0, 1.0)).reshape(2, 2)[self.turning.astype(int)]
        design = own
        if current:
            design = np.concatenate([self.current, own], axis=2)
            design[:, 0, : 2 * m] *= 1.0 - x[5]
        prior = self._prior(walk, 2 * m + own.shape[2])
        prior = prior if current else prior[2 * m :, 2 * m :]
        block = ((self.t - self.t[0]) // SETTINGS.held_out_s).astype(int)
        error = self.y.copy()  # as it is where nothing predicts it
        for fold in range(SETTINGS.folds if design.shape[2] else 0):
            held_out = block % SETTINGS.folds == fold
            a = (design / sigma[:, :, None])[~held_out].reshape(-1, design.shape[2])
            b = (self.y / sigma)[~held_out].ravel()
            error[held_out] = self.y[held_out] - design[held_out] @ np.linalg.solve(a.T @ a + prior, a.T @ b)
        north, east = np.sqrt(np.mean(error**2, axis=0))
        return float(north), float(east)

    def by_share(self, x: Array) -> Array:
        """What the uncertainty of the share k adds to the current's deviations, (m, 2)."""
        step = np.zeros_like(x)
        step[5] = 0.1
        (more, above, _), (cost, _, _), (less, below, _) = (self.solve(y) for y in (x + step, x, x - step))
        curvature = (more - 2.0 * cost + less) / step[5] ** 2
        sd = 1.0 / np.sqrt(max(curvature, 1.0 / SETTINGS.share_sd**2))
        return np.asarray(np.abs(above - below) / (2.0 * step[5]) * sd)

    def _prior(self, walk: float, size: int) -> Array:
        """Information of the random walk from a wide start, and of constants that are hardly known."""
        m = len(self.knots)
        steps = np.diff(np.eye(m), axis=0)
        interval = float(self.knots[1] - self.knots[0])
        steady = steps.T @ steps / (walk**2 * interval / 60.0)
        steady[0, 0] += 1.0 / SETTINGS.start_m_s**2
        prior = np.eye(size) * 1e-4
        prior[:m, :m], prior[m : 2 * m, m : 2 * m] = steady, steady
        if size > 2 * m:
            prior[2 * m + 1, 2 * m + 1] = 1.0  # sway in units of its prior deviation
        return prior
