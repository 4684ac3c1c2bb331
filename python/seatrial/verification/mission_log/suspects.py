"""Suspects: which change of the vehicle or its surroundings explains the misfit of a log, sorted by how much.

Residuals r and exact derivatives J are in units of a valid model's spread, without what the state at a
restart explains (`seatrial.verification.mission_log.candidates`). For every candidate alone

    theta = (J'J)^-1 J'r,   gain = (J'r)' (J'J)^-1 (J'r) / r'r,

its scatter by the jackknife over windows (`seatrial.statistics.score_test`). The best ones are then followed
by Gauss-Newton steps with J held and the non-linear model simulated, and sorted by what they truly explain,
less Akaike's share for each unknown. Candidates whose columns run alike (90 % of one's square lies in the
span of the other's) cannot be told apart by the log and are named beside it. Beside the coefficients stand:

*An actuator that did not do what its commands say*: a jam, a lost propeller or a command that was not logged
is no change of a coefficient; where the command says nothing, no gain explains a thrust. Each actuator in
turn is given a steady thrust of its own in each window. With c_w the whitened derivative of window w by that
thrust (a constant wrench along the actuator's, `X_0` ... `N_0`) and r_w its residual,

    f_w = c_w'r_w / c_w'c_w,   gain = sum_w (c_w'r_w)^2 / c_w'c_w

(structured residuals with one unknown input, Isermann, *Fault-Diagnosis Systems* (2006), chapter 10). It has
as many unknowns as windows and pays for them.

*An offset that a sensor has throughout the log*: it shows d more and starts every window d away, so that
measured less predicted moves by ``(e - dy/dx_0) d``, e one in its own channel.

*A steady current that was not logged*: north and east by Gauss-Newton steps on the whitened residuals. On one
heading a current cannot be told from thrust or drag; what it could hide is taken out of the chance that the
log would have shown it (`seatrial.verification.mission_log.verdict`).

Tests: ``tests/verification/test_recorded_suspects.py``, ``tests/verification/test_recorded_current.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.base.finding import Finding
from seatrial.statistics.linearisation import Linearisation, Piece
from seatrial.statistics.score_test import ScoreTests, score_tests
from seatrial.verification.mission_log.candidates import Candidate, Suspect, Whitening, changed
from seatrial.verification.mission_log.spread import SPREAD_SETTINGS, PredictedLog, Slopes, Spread

_WRENCH = ("X_0", "Y_0", "Z_0", "K_0", "M_0", "N_0")


@dataclass(frozen=True)
class SuspectSettings:
    """Which changes count as suspects, and which cannot be told apart."""

    #: Share of the gain from which another explanation is as likely.
    alike_share: float = 0.9
    #: Tidal streams are weaker, but for a few narrows.
    strongest_current_m_s: float = 3.0
    #: Gauss-Newton steps: the current enters nearly linearly.
    steps: int = 4
    #: Share of the cost: less explains nothing that a user would see.
    least_gain: float = 0.02


SETTINGS = SuspectSettings()


@dataclass(frozen=True, eq=False)
class UnloggedThrust:
    """What a thrust of one actuator beyond its commands explains.

    `actuator`: its name. `thrust`: steady thrust of each window beyond the modelled one, (w,), N; at full
    lift of a fin likewise. `gain`: fall of the sum of squares. `p`: of no such thrust: F-test with an
    observation per channel and window, times the actuators tried. `alike`: actuators that explain nearly as
    much.
    """

    actuator: str
    thrust: Array
    gain: float
    p: float
    alike: tuple[str, ...]


def _unlogged(thrust: UnloggedThrust) -> Finding:
    """The thrust beyond the commands, root mean square and mean over the windows, N."""
    size, mean = float(np.sqrt(np.mean(thrust.thrust**2))), float(thrust.thrust.mean())
    return changed("unlogged thrust", thrust.actuator, rms_n=size, mean_n=mean)


def unlogged_thrusts(log: PredictedLog, white: Whitening) -> tuple[UnloggedThrust, ...]:
    """Every actuator with the thrust that its commands do not tell, the best explanation first.

    None where a recorded wrench drives the vehicle.
    """
    from scipy.stats import f as fisher

    if log.input == "tau":
        return ()
    facts = log.vehicle.actuator_info()
    directions: list[Mapping[str, float]] = [
        dict(zip(_WRENCH, (float(x) for x in facts[name]["wrench"]), strict=True))
        for name in log.vehicle.actuators
    ]
    columns = white.columns(log.slopes(directions))
    pull = np.array([np.einsum("ncd,nc->d", one, r) for one, r in zip(columns, white.residual, strict=True)])
    square = np.array([np.einsum("ncd,ncd->d", one, one) for one in columns])  # (w, a)
    known = square > 1e-12 * np.maximum(square.max(axis=0), 1e-300)
    thrust = np.where(known, pull / np.where(known, square, 1.0), 0.0)
    gains = (thrust * pull).sum(axis=0)
    windows = len(columns)
    free = max(windows * (len(white.places) - 1), 1)
    found = []
    for k, name in enumerate(log.vehicle.actuators):
        left = max(white.cost - float(gains[k]), 1e-300)
        chance = float(fisher.sf(float(gains[k]) / windows / (left / free), windows, free))
        near = [
            (float(gains[j]), other)
            for j, other in enumerate(log.vehicle.actuators)
            if j != k and gains[j] > SETTINGS.alike_share * gains[k]
        ]
        alike = tuple(other for _, other in sorted(near, reverse=True))
        found.append(
            UnloggedThrust(name, thrust[:, k], float(gains[k]), min(1.0, len(facts) * chance), alike)
        )
    return tuple(sorted(found, key=lambda one: -one.gain))


def in_current(log: PredictedLog, spread: Spread) -> tuple[PredictedLog, tuple[float, float]]:
    """Log without a recorded current, with the steady one that suits it best, and that north and east, m/s.

    `spread` is that of a valid model's errors.
    """
    current = np.zeros(2)
    found = log.in_water(current)
    for _ in range(SETTINGS.steps):
        slopes = found.slopes([], current=True)
        white = Whitening(found, spread, slopes)
        columns = np.concatenate([one.reshape(-1, 2) for one in white.columns(slopes)])
        residual = np.concatenate([one.ravel() for one in white.residual])
        step = np.linalg.lstsq(columns, residual, rcond=1e-9)[0]
        current = np.clip(current + step, -SETTINGS.strongest_current_m_s, SETTINGS.strongest_current_m_s)
        found = log.in_water(current)
        if float(np.abs(step).max()) < 1e-3:  # m/s: a step of the current that ends the search
            break
    return found, (float(current[0]), float(current[1]))


_SENSED = ("u", "v", "w", "p", "q", "r", "roll", "pitch", "yaw")


def offset_channels(log: PredictedLog) -> list[str]:
    """Channels of a log whose offset shows: not positions, which move start and path alike."""
    return [name for name in log.channels if name in _SENSED]


def offset_slopes(log: PredictedLog, slopes: Sequence[Slopes], channels: Sequence[str]) -> list[Slopes]:
    """Derivatives of measured less predicted by the offset of each channel, per window."""
    own = [CHANNELS.index(name) for name in channels]
    start = np.argsort(SPREAD_SETTINGS.initial_places)[own]
    unit = np.eye(len(CHANNELS))[:, own]
    return [
        Slopes(np.where(mask[:, :, None], unit - one.by_start[:, :, start], 0.0), one.by_start)
        for one, mask in zip(slopes, log.counted, strict=True)
    ]


_ANGLES, _RATES = ("roll", "pitch", "yaw"), ("p", "q", "r")


def suspects(
    log: PredictedLog,
    spread: Spread,
    tried: Sequence[Candidate],
    *,
    sigma: Mapping[str, float] | None = None,
    current: bool = True,
    most: int = 8,  # a joint gain is worked out for each, which costs a fit
) -> tuple[Suspect, ...]:
    """Suspects of a log, the one that explains most first.

    `spread`: of a valid model's errors. `sigma`: standard deviations of the identified coefficients.
    `current`: whether a steady current that was not recorded is tried too. `most`: how many to list.
    """
    directions = [one for candidate in tried for one in candidate.directions()]
    slopes = log.slopes(directions, current=current)
    white = Whitening(log, spread, slopes)
    if not white.cost > 0.0:  # no channel has a spread to measure its error by
        return ()
    sensed = offset_channels(log)
    columns = [
        np.concatenate(pair, axis=2)
        for pair in zip(white.columns(slopes), white.columns(offset_slopes(log, slopes, sensed)), strict=True)
    ]
    tests = score_tests(
        _linearisation(white.residual, white.counted),
        columns,
        fitted=(),
        block=[np.full(len(one), w) for w, one in enumerate(columns)],
    )
    places, first = [], 0
    for candidate in tried:
        places.append(list(range(first, first + len(candidate.scale))))
        first += len(candidate.scale)
    if current:
        places.append([first, first + 1])
        first += 2
    places += [[first + k] for k in range(len(sensed))]
    names = [one.name for one in tried] + ["current"] * current + [f"offset of {one}" for one in sensed]
    squares = white.weight**2
    samples = float(sum(w * mask.sum() for w, mask in zip(squares, white.counted, strict=True)))
    # The score test thins long logs.
    part = white.cost / max(tests.cost, 1e-300)
    fits = [(theta, part * gain) for theta, gain in (_fit(tests, own) for own in places)]
    results = tests.results()
    order = sorted(range(len(places)), key=lambda i: -fits[i][1])
    # Errors of a window hang together: it is worth about one observation per channel.
    # Akaike (1974): two in twice the log-likelihood, per parameter.
    penalty = 2.0 * white.cost / (len(columns) * len(white.places))
    found: list[tuple[float, Suspect]] = []
    for i in order[: 2 * most]:
        theta, linear = fits[i]
        own = places[i]
        units: tuple[str, ...]
        coefficients: dict[str, float]
        spread_of = tuple(float(results.sigma[k]) for k in own)
        if i >= len(tried) + current:
            gain, coefficients = linear, {}
            channel = sensed[i - len(tried) - current]
            name, kind, units = (
                names[i],
                "sensor",
                ("rad" if channel in _ANGLES else "rad/s" if channel in _RATES else "m/s",),
            )
            change = changed("sensor offset", channel, offset=float(theta[0]))
        elif i == len(tried):
            gain, coefficients = linear, {}
            name, kind = "current", "surroundings"
            units = ("m/s", "m/s")
            change = changed("current", north_m_s=float(theta[0]), east_m_s=float(theta[1]))
        else:
            candidate = tried[i]
            theta, gain = white.followed(candidate, columns, own, theta, linear)
            if gain <= 0.0:
                continue
            coefficients = candidate.changes(theta)
            name, kind, units = candidate.name, candidate.kind, candidate.units
            change = candidate.finding(theta)
        share = gain / white.cost
        if share < SETTINGS.least_gain or not _plausible(log, coefficients):
            continue
        if kind == "surroundings" and float(np.hypot(*theta)) > SETTINGS.strongest_current_m_s:
            continue
        known = (sigma or {}).get(name)
        suspect = Suspect(
            name=name,
            kind=kind,
            finding=change,
            values=tuple(float(x) for x in theta),
            units=units,
            sigma=spread_of,
            gain=share,
            left=float(np.sqrt(max(white.cost - gain, 0.0) / max(samples, 1.0))),
            p=min(1.0, sum(map(len, places)) * float(np.min(results.p[own]))),
            sigmas=None if not known else float(theta[0]) / known,
            alike=_alike(tests, places, i, (names, [f[1] for f in fits])),
            coefficients=coefficients,
        )
        # Of two that explain the same, the one that is a thing rather than a number is read first.
        # A hundredth of the cost decides ties only.
        worth = gain - penalty * (len(own) - 1) + (0.01 * white.cost if kind == "group" else 0.0)
        found.append((worth, suspect))
    for one in unlogged_thrusts(log, white):
        if one.gain < SETTINGS.least_gain * white.cost:
            continue
        size = float(one.thrust.std(ddof=1)) / len(one.thrust) ** 0.5
        suspect = Suspect(
            name=one.actuator,
            kind="actuator",
            finding=_unlogged(one),
            values=(float(one.thrust.mean()),),
            units=("N",),
            sigma=(size,),
            gain=one.gain / white.cost,
            left=float(np.sqrt(max(white.cost - one.gain, 0.0) / max(samples, 1.0))),
            p=one.p,
            sigmas=None,
            alike=one.alike,
            coefficients={},
        )
        found.append((one.gain - penalty * (len(one.thrust) - 1), suspect))
    found.sort(key=lambda pair: -pair[0])
    return tuple(suspect for _, suspect in found[:most])


def _plausible(log: PredictedLog, coefficients: Mapping[str, float]) -> bool:
    """Whether no coefficient changes its sign or becomes three times itself, and no actuator's gain twice."""
    present = log.vehicle.coefficients()
    signed = [
        (present[name], value)
        for name, value in coefficients.items()
        if present.get(name) and name[:2] not in ("x_", "y_", "z_")
    ]
    gains = [
        value / present[name]
        for name, value in coefficients.items()
        if name.endswith(".gain") and present[name]
    ]
    return (
        # Beyond three times its own value another vehicle is described.
        all(0.0 <= value / own <= 3.0 for own, value in signed)
        and max(gains, default=0.0) <= 2.0  # no actuator comes to give twice its thrust
    )


def _linearisation(residual: Sequence[Array], counted: Sequence[NDArray[np.bool_]]) -> Linearisation:
    pieces = tuple(
        Piece(
            trial="log",
            t=np.arange(len(one), dtype=float),
            residual=one,
            counted=mask,
            weight=np.ones_like(one),
            jacobian=np.zeros((*one.shape, 0)),
            nu=np.zeros((len(one), 6)),
        )
        for one, mask in zip(residual, counted, strict=True)
    )
    width = residual[0].shape[1]
    return Linearisation((), np.zeros(0), tuple("c" * width), np.ones(width), 1.0, pieces)


def _fit(tests: ScoreTests, own: Sequence[int]) -> tuple[Array, float]:
    """Values of the unknowns at places `own`, and the fall of the sum of squares, both to first order."""
    total = tests.reduced[0]
    normal, pull = total[np.ix_(own, own)], total[own, -1]
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(size, size) + 1e-9 * np.eye(len(own))
    theta = np.linalg.solve(scaled, pull / size) / size
    if not (np.diag(normal) > 1e-12 * tests.cost).all():
        return np.zeros(len(own)), 0.0
    return theta, float(theta @ pull)


def _alike(
    tests: ScoreTests, places: Sequence[list[int]], of: int, known: tuple[list[str], list[float]]
) -> tuple[str, ...]:
    """Candidates most of whose column lies in the span of this one's, and which explain nearly as much."""
    names, gains = known
    total, own = tests.reduced[0], places[of]
    normal = total[np.ix_(own, own)]
    found = []
    for i, other in enumerate(places):
        if i == of or len(other) > len(own) or gains[i] < SETTINGS.alike_share * gains[of]:
            continue
        square = total[np.ix_(other, other)]
        cross = total[np.ix_(own, other)]
        if np.trace(square) <= 0.0 or np.trace(normal) <= 0.0:
            continue
        inside = cross.T @ np.linalg.lstsq(normal, cross, rcond=1e-9)[0]
        shares = np.linalg.lstsq(square, inside, rcond=1e-9)[0]
        share = float(np.trace(shares)) / len(other)
        if share > SETTINGS.alike_share:
            found.append((share, names[i]))
    return tuple(name for _, name in sorted(found, reverse=True))
