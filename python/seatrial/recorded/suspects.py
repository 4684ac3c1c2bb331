"""Suspects: which change of the vehicle explains the misfit of a log, sorted by how much of it.

Residuals and exact derivatives J are in units of a valid model's spread, without what the state at a restart
explains (`seatrial.recorded.whitening`). For every candidate (`seatrial.recorded.candidates`) alone

    theta = (J'J)^-1 J'r,   gain = (J'r)' (J'J)^-1 (J'r) / r'r,

its scatter by the jackknife over windows (`seatrial.criticism.score_test`). The best ones are then followed
by Gauss-Newton steps with J held and the non-linear model simulated, and sorted by what they truly explain,
less Akaike's share for each unknown. Beside them stand offsets of sensors (`seatrial.recorded.sensor_offset`)
and actuators that pushed otherwise than their commands say (`seatrial.recorded.unlogged_thrust`), with an
unknown for each window. Candidates whose columns run alike (90 % of one's square lies in the span of the
other's) cannot be told apart by the log and are named beside it.

Tests: ``tests/test_recorded_suspects.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from seatrial.criticism.score_test import ScoreTests, score_tests
from seatrial.linearisation import Linearisation, Piece
from seatrial.recorded.candidates import Candidate
from seatrial.recorded.restarts import Restarts
from seatrial.recorded.sensor_offset import offset_channels, offset_slopes
from seatrial.recorded.sensor_offset import words as offset_words
from seatrial.recorded.spread import Spread
from seatrial.recorded.suspect import Suspect
from seatrial.recorded.unlogged_thrust import unlogged_thrusts
from seatrial.recorded.unrecorded_current import STRONGEST_M_S
from seatrial.recorded.whitening import Whitening

__all__ = ["suspects"]

Array = NDArray[np.float64]

_ANGLES, _RATES = ("roll", "pitch", "yaw"), ("p", "q", "r")
_FOLLOWED = 8
_ALIKE = 0.9
_LEAST_GAIN = 0.02
_AKAIKE = 2.0
_THING = 0.01
_MOST_FACTOR = 3.0
_MOST_GAIN = 2.0
"""No actuator comes to give twice its thrust."""


def suspects(
    log: Restarts,
    spread: Spread,
    tried: Sequence[Candidate],
    *,
    sigma: Mapping[str, float] | None = None,
    current: bool = True,
    most: int = _FOLLOWED,
) -> tuple[Suspect, ...]:
    """Suspects of a log, the one that explains most first.

    Parameters
    ----------
    log : Restarts
    spread : Spread
        Of a valid model's errors.
    tried : sequence of Candidate
    sigma : mapping of str to float, optional
        Standard deviations of the identified coefficients.
    current : bool, optional
        Whether a steady current that was not recorded is tried too.
    most : int, optional
        How many to list.
    """
    directions = [one for candidate in tried for one in candidate.directions()]
    slopes = log.slopes(directions, current=current)
    white = Whitening(log, spread, slopes)
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
    penalty = _AKAIKE * white.cost / (len(columns) * len(white.places))
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
            words = offset_words(channel, float(theta[0]))
        elif i == len(tried):
            gain, coefficients = linear, {}
            name, kind = "current", "surroundings"
            units = ("m/s", "m/s")
            words = f"a current of {theta[0]:+.2f} m/s north and {theta[1]:+.2f} m/s east beyond the recorded"
        else:
            candidate = tried[i]
            theta, gain = white.followed(candidate, columns, own, theta, linear)
            if gain <= 0.0:
                continue
            coefficients = candidate.changes(theta)
            name, kind, units = candidate.name, candidate.kind, candidate.units
            words = candidate.words(theta)
        share = gain / white.cost
        if share < _LEAST_GAIN or not _plausible(log, coefficients):
            continue
        if kind == "surroundings" and float(np.hypot(*theta)) > STRONGEST_M_S:
            continue
        known = (sigma or {}).get(name)
        suspect = Suspect(
            name=name,
            kind=kind,
            change=words,
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
        worth = gain - penalty * (len(own) - 1) + (_THING * white.cost if kind == "group" else 0.0)
        found.append((worth, suspect))
    for one in unlogged_thrusts(log, white):
        if one.gain < _LEAST_GAIN * white.cost:
            continue
        size = float(one.thrust.std(ddof=1)) / len(one.thrust) ** 0.5
        suspect = Suspect(
            name=one.actuator,
            kind="actuator",
            change=one.words,
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


def _plausible(log: Restarts, coefficients: Mapping[str, float]) -> bool:
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
        all(0.0 <= value / own <= _MOST_FACTOR for own, value in signed)
        and max(gains, default=0.0) <= _MOST_GAIN
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
        if i == of or len(other) > len(own) or gains[i] < _ALIKE * gains[of]:
            continue
        square = total[np.ix_(other, other)]
        cross = total[np.ix_(own, other)]
        if np.trace(square) <= 0.0 or np.trace(normal) <= 0.0:
            continue
        inside = cross.T @ np.linalg.lstsq(normal, cross, rcond=1e-9)[0]
        shares = np.linalg.lstsq(square, inside, rcond=1e-9)[0]
        share = float(np.trace(shares)) / len(other)
        if share > _ALIKE:
            found.append((share, names[i]))
    return tuple(name for _, name in sorted(found, reverse=True))
