"""The log's own mission flown again: identified vehicle, recorded parameters, logged targets.

What the model lacks is found on the part of the log that the identification was fitted to: a steady wrench
and current, so that the mean demands are those of the log, and a wandering wrench, so that what the log has
beside the mean flight is as large and as quick as what the flights have. With vehicles drawn from the
identified uncertainty that gives an envelope: at each row 95 % of the flights. It is judged on the part that
was held out. Loop errors of one log depend on each other from row to row: a share outside of a tenth still
counts as inside. Held by ``tests/ardusub/test_reflight.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.ardusub.course import CHANNELS, Cases, Course, Rig, fly_course
from seatrial.ardusub.course import SETTINGS as FLOWN
from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.base.work import HERE, Work, tell

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.identification.fitted import Fitted


@dataclass(frozen=True)
class ReflightSettings:
    """How the unknown of a flight is drawn, and how many rows must lie inside."""

    #: Share of the held-out rows outside an envelope of 95 % that still counts as inside.
    accepted_outside_share: float = 0.1
    envelope_share: float = 0.95  #: Share of the drawn flights inside an envelope.
    #: Time constants of the wandering wrench that are tried, s.
    wander_times_s: tuple[float, float, float] = (0.3, 1.0, 3.0)
    probe_step_m_s: float = 0.05  #: Step of the current that is tried, m/s.
    #: Time after the beginning of a course at which the unknown past no longer counts, s.
    settle_s: float = 3.0
    #: Standard deviation of the current: m/s, and a share of the current.
    current_sd: tuple[float, float] = (0.02, 0.2)


SETTINGS = ReflightSettings()

_PROBES = np.array([0.0, 0.0, 1.0, 0.2, 0.2, 0.2])  # N, N m: steps of the steady wrench
_UNIT_WANDER = np.array([2.0, 2.0, 2.0, 0.3, 0.3, 0.3])  # N, N m: with which its effect is found

_DRIVES = {"roll": (3,), "pitch": (4,), "yaw": (5,), "depth": (2,), "north": (0, 1), "east": (0, 1)}
"""Axes of the wrench that move a loop error most."""


@dataclass(frozen=True, eq=False)
class Envelope:
    """A loop error of a course, and between which bounds 95 % of the flights are."""

    course: str
    channel: str
    unit: str
    t: Array  #: (n,), s.
    measured: Array  #: Of the log (n,): target minus measurement.
    #: `lower`, `upper`, `middle`: of the flights (n,).
    lower: Array
    upper: Array
    middle: Array
    held_out: Any  #: Rows that were not used to fit anything, (n,).

    @property
    def counted(self) -> Any:
        """Rows (n,) that count: without the first seconds of the course."""
        return self.t >= self.t[0] + SETTINGS.settle_s

    @property
    def outside(self) -> Any:
        """Rows (n,) that count and whose measurement is outside."""
        return self.counted & ((self.measured < self.lower) | (self.measured > self.upper))


@dataclass(frozen=True)
class Share(
    Plain, only="channel unit rms half_width=width outside_fit=fit outside_held_out=held_out rows inside"
):
    """How much of a loop error is outside its envelope."""

    channel: str
    unit: str
    rms: float  #: Of the log, over the rows that count.
    width: float  #: Mean half-width of the envelope.
    #: `fit`, `held_out`: share of the rows outside; NaN where there are no rows.
    fit: float
    held_out: float
    rows: int  #: Held-out rows.

    @property
    def inside(self) -> bool:
        """Whether the error of the held-out part (of the fit where nothing is held out) is inside."""
        share = self.fit if np.isnan(self.held_out) else self.held_out
        return bool(share <= SETTINGS.accepted_outside_share)


@dataclass(frozen=True, eq=False)
class Reflight(
    Plain, only="steady_wrench=rig.steady wander wander_s=rig.wander_s current_m_s=current channels=shares"
):
    """The log's mission flown again."""

    rig: Rig  #: With the steady wrench and the time constant that were found.
    wander: Array  #: Standard deviation (6,) of the wandering wrench, N and N m.
    current: Array  #: (3,), NED, m/s; zero where no position was controlled.
    envelopes: tuple[Envelope, ...]  #: One per course and channel.
    shares: tuple[Share, ...]  #: One per channel.

    @property
    def held(self) -> bool:
        """Whether every loop error is inside."""
        return all(share.inside for share in self.shares)

    def share(self, channel: str) -> Share | None:
        """That of a channel; None where the log does not control it."""
        return next((share for share in self.shares if share.channel == channel), None)


def refly(
    fitted: Fitted,
    rig: Rig,
    courses: Sequence[Course],
    parameters: Mapping[str, float],
    *,
    hold_out_s: tuple[float, float] | None,
    flights: int = 200,
    seed: int = 0,
    work: Work = HERE,
) -> Reflight:
    """Envelope of the loop errors of a log's courses, by `flights` drawn vehicles per course.

    `parameters` are those the log was flown with; nothing is fitted to its times `hold_out_s`, s.
    """
    first, last = hold_out_s or (np.inf, np.inf)
    settled = [course.t >= course.t[0] + SETTINGS.settle_s for course in courses]
    fits = [~course.between(first, last) & rows for course, rows in zip(courses, settled, strict=True)]
    missing = _Calibration(fitted.vehicle, courses, fits, dict(parameters), work.threads)
    tell(work, 0.0, "steady wrench and current")
    rig, current = missing.steady(rig)
    drawn = fitted.draws(flights, seed)
    few = {name: values[:24] for name, values in drawn.items()}
    tell(work, 0.2, "wandering wrench")
    rig, wander = missing.wander(rig, current, few, seed)
    # The current is known no better than its estimate allows, in the plane.
    rng, (least, share) = np.random.default_rng(seed), SETTINGS.current_sd
    sd = least + share * np.hypot(*current[:2])
    currents = current + rng.normal(size=(flights, 3)) * np.array([sd, sd, 0.0])
    cases = Cases.of(flights, seed=seed, coefficients=drawn, current=currents, wander=wander)
    tail = 0.5 - 0.5 * SETTINGS.envelope_share
    envelopes: list[Envelope] = []
    for k, course in enumerate(courses):
        tell(work, 0.5 + 0.5 * k / len(courses), f"{course.name} again, {flights} drawn vehicles")
        flown = fly_course(fitted.vehicle, rig, course, parameters, cases=cases, threads=work.threads)
        for channel, values in course.errors(flown).items():
            if channel not in course.measured:
                continue
            sound = np.where(np.isfinite(values), values, np.inf)
            lower, middle, upper = np.quantile(
                sound, [tail, 0.5, 0.5 + 0.5 * SETTINGS.envelope_share], axis=0
            )
            envelopes.append(
                Envelope(
                    course.name, channel, CHANNELS[channel][0], course.t, course.measured[channel], lower,
                    upper, middle, course.between(first, last),
                )
            )  # fmt: skip
    return Reflight(rig, wander, current, tuple(envelopes), _shares(envelopes))


def _shares(envelopes: Sequence[Envelope]) -> tuple[Share, ...]:
    shares = []
    for channel, (unit, _) in CHANNELS.items():
        own = [envelope for envelope in envelopes if envelope.channel == channel]
        if not own:
            continue
        counted = np.concatenate([envelope.counted for envelope in own])
        held = np.concatenate([envelope.held_out for envelope in own]) & counted
        fit, outside = counted & ~held, np.concatenate([envelope.outside for envelope in own])
        measured = np.concatenate([envelope.measured for envelope in own])
        width = 0.5 * np.concatenate([envelope.upper - envelope.lower for envelope in own])
        shares.append(
            Share(
                channel, unit, float(np.sqrt(np.mean(measured[counted] ** 2))),
                float(np.mean(width[counted])),
                float(outside[fit].mean()) if fit.any() else np.nan,
                float(outside[held].mean()) if held.any() else np.nan, int(held.sum()),
            )
        )  # fmt: skip
    return tuple(shares)


@dataclass(frozen=True, eq=False)
class _Calibration:
    """What the model lacks, from the rows of the fit."""

    vehicle: Vehicle
    courses: Sequence[Course]
    fits: Sequence[Any]
    parameters: dict[str, float]
    threads: int | None

    def steady(self, rig: Rig) -> tuple[Rig, Array]:
        """Steady wrench and current with which the mean demands are those of the log.

        Gauss and Newton: demands of roll, pitch, yaw and throttle for the wrench, forward and lateral, turned
        to north and east, for the current.
        """
        known = [course for course, fit in zip(self.courses, self.fits, strict=True) if fit.any()]
        place = any(course.channels[-1] == "east" for course in known)
        x = np.zeros(6)  # Z, K, M, N, current north and east
        steps = np.array([*_PROBES[2:], SETTINGS.probe_step_m_s, SETTINGS.probe_step_m_s])
        free = 6 if place else 4
        for _ in range(4):
            tried = np.vstack([x, *(x + np.eye(6)[i] * steps[i] for i in range(free))])
            means = self._mean_demands(rig, tried)
            if not np.isfinite(means).all():
                break
            slopes = (means[1:] - means[0]).T / steps[:free]
            use = slice(0, 6 if place else 4)
            move, *_ = np.linalg.lstsq(slopes[use], -means[0][use], rcond=1e-3)
            x[:free] += np.clip(move, -10.0 * steps[:free], 10.0 * steps[:free])
        return replace(rig, steady=(0.0, 0.0, *x[:4].tolist())), np.array([x[4], x[5], 0.0])

    def _mean_demands(self, rig: Rig, tried: Array) -> Array:
        """Mean difference (k, 6) of the demands to the log's: roll, pitch, yaw, throttle, north, east."""
        own = self.vehicle.coefficients()
        bias = {name: own.get(name, 0.0) + tried[:, i] for i, name in enumerate(("Z_0", "K_0", "M_0", "N_0"))}
        current = np.concatenate([tried[:, 4:], np.zeros((len(tried), 1))], 1)
        cases = Cases.of(len(tried), coefficients=bias, current=current)
        still = replace(rig, noise=(0.0, 0.0), steady=(0.0,) * 6)
        sums, counts = np.zeros((len(tried), 6)), np.zeros(6)
        for course, fit in zip(self.courses, self.fits, strict=True):
            if not fit.any():
                continue
            rows = fly_course(self.vehicle, still, course, self.parameters, cases=cases, threads=self.threads)
            apart = rows[:, :, 12:18] - course.demands
            if "east" in course.channels:
                yaw = rows[:, :, 5]
                forward, lateral = apart[..., 4].copy(), apart[..., 5].copy()
                apart[..., 4] = forward * np.cos(yaw) - lateral * np.sin(yaw)
                apart[..., 5] = forward * np.sin(yaw) + lateral * np.cos(yaw)
            else:
                apart[..., 4:] = 0.0
            sums += apart[:, fit].sum(axis=1)
            counts += np.array([fit.sum()] * 4 + [fit.sum() if "east" in course.channels else 0] * 2)
        return np.asarray(sums / np.maximum(counts, 1.0))

    def wander(self, rig: Rig, current: Array, drawn: Mapping[str, Array], seed: int) -> tuple[Rig, Array]:
        """Time constant and standard deviation of the wandering wrench.

        What the log has beside the mean of the drawn vehicles is to be as large as what the flights have
        beside it, and as quick.
        """
        quickest: list[tuple[float, Rig]] = []
        for wander_s in SETTINGS.wander_times_s:
            tried = replace(rig, wander_s=wander_s)
            left, whole = self._beside(tried, current, drawn, seed, _UNIT_WANDER)
            miss = sum(math.log(whole[name][1] / left[name][1]) ** 2 for name in left if left[name][1] > 0.0)
            quickest.append((miss, tried))
        chosen = min(quickest, key=lambda attempt: attempt[0])[1]
        sd = _UNIT_WANDER.copy()
        left, without = self._beside(chosen, current, drawn, seed, np.zeros(6))
        for _ in range(4):
            _, whole = self._beside(chosen, current, drawn, seed, sd)
            sd = _scaled(sd, left, without, whole)
        return chosen, sd

    def _beside(
        self, rig: Rig, current: Array, drawn: Mapping[str, Array], seed: int, wander: Array
    ) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
        """Sizes of what the log and of what flights have beside the mean flight, on the rows of the fit.

        Per channel the mean square, and the mean square of what changes in 0.3 s over it.
        """
        k = len(next(iter(drawn.values()))) if drawn else 24
        cases = Cases.of(k, seed=seed, coefficients=drawn, current=current, wander=wander)
        lag = round(0.3 / FLOWN.row_s)
        sums: dict[str, Array] = {}
        for course, fit in zip(self.courses, self.fits, strict=True):
            if not fit.any():
                continue
            flown = fly_course(self.vehicle, rig, course, self.parameters, cases=cases, threads=self.threads)
            for channel, errors in course.errors(flown).items():
                if channel not in course.measured:
                    continue
                # A flight that diverged counts as very far off.
                values = np.where(np.isfinite(errors), errors, 1e6)
                middle = values.mean(axis=0)
                # Beside the mean flight: what gains and steady wrench explain is in it.
                for own, signals in enumerate((course.measured[channel] - middle, values - middle)):
                    change = (signals[..., lag:] - signals[..., :-lag])[..., fit[lag:]]
                    squares = [np.mean(np.atleast_2d(part) ** 2) for part in (signals[..., fit], change)]
                    sums.setdefault(channel, np.zeros((2, 2)))[own] += fit.sum() * np.array(squares)
        sizes_and_rates = {
            name: [(float(size), float(change / max(size, 1e-12))) for size, change in rows]
            for name, rows in sums.items()
        }
        of_log = {name: pair[0] for name, pair in sizes_and_rates.items()}
        return of_log, {name: pair[1] for name, pair in sizes_and_rates.items()}


def _scaled(
    sd: Array,
    left: Mapping[str, tuple[float, float]],
    without: Mapping[str, tuple[float, float]],
    whole: Mapping[str, tuple[float, float]],
) -> Array:
    """Standard deviations with which flights are beside their mean as the log is: mean squares add up."""
    factors: dict[int, list[float]] = {}
    for channel, axes in _DRIVES.items():
        if channel not in left or channel not in whole:
            continue
        more = whole[channel][0] - without[channel][0]
        lacking = left[channel][0] - without[channel][0]
        factor = np.sqrt(np.clip(lacking / more, 0.0, 100.0)) if more > 0.0 else 0.0
        for axis in axes:
            factors.setdefault(axis, []).append(float(factor))
    return np.array([sd[i] * (float(np.mean(factors[i])) if i in factors else 0.0) for i in range(6)])
