"""Tuned parameters of ArduSub: set-point steps in a corridor, over the identified uncertainty.

A mission steps yaw, depth and place one after the other, with a drawn vehicle, current, tether, battery and
wandering wrench. How far a response leaves its corridor, in s, is its violation (Taubert et al. 2014,
(55)-(57)). The search lowers the mean of the worst tenth of the missions and keeps the margins; missions that
it never saw judge the result. Steps are those of ArduSub: the attitude asked for steps, its target turns
there (`crates/seatrial/src/control/ardusub/shaping.rs`), and targets of depth and place move with limited
speed and acceleration. Held by ``tests/ardusub/test_tuning.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import ardusub_defaults
from seatrial.ardusub.axes import SOUGHT, AxisVerdict, MarginModel, Margins
from seatrial.ardusub.course import SETTINGS as FLOWN
from seatrial.ardusub.course import Cases, Course, Rig, fly_course, still_targets
from seatrial.ardusub.parameters import Change
from seatrial.base.arrays import Array
from seatrial.base.report import wording
from seatrial.base.work import HERE, Work, tell
from seatrial.control_design.corridor import Corridor

if TYPE_CHECKING:
    from seatrial.identification.fitted import Fitted

STEPS = ("yaw", "depth", "north")
"""Channels that step, one after the other."""

_COLUMNS = {"yaw": 2, "depth": 6, "north": 4}  # of the targets


@dataclass(frozen=True)
class ArdusubTuningSettings:
    """Steps that a tuning for ArduSub flies, and how they are judged."""

    first_step_s: float = 6.0  #: Time of the first step, s.
    between_steps_s: float = 12.0  #: Time between two steps, s.
    #: Sizes of the steps: deg of yaw, m of depth, m of place.
    step_sizes: tuple[tuple[float, float, float], ...] = (
        (30.0, 0.5, 1.0),
        (60.0, -0.5, -1.0),
        (-90.0, 0.3, 2.0),
        (-45.0, -0.3, -2.0),
    )
    rise_step_deg: float = 60.0  #: Step whose rise is measured, deg.
    #: Rate at which a yaw target turns, deg/s: the default of ``ATC_RATE_WPY_MAX``.
    slew_rate_deg_s: float = 60.0
    target_speed_m_s: float = 0.4  #: Speed of a target that moves, m/s.
    #: Acceleration of a target that moves, m/s2: the default of PILOT_ACC_Z.
    target_acceleration_m_s2: float = 1.0
    shortest_rise_s: float = 0.4  #: Shortest rise time that a corridor asks for, s: four rows of a response.
    tail_share: float = 0.1  #: Share of the missions, the worst, that the search looks at.
    generations: int = 10  #: Of the search, with eight candidates each.
    #: Violation that stands for a response that diverged: worse than any other.
    diverged_violation: float = 1e3


SETTINGS = ArdusubTuningSettings()

LENGTH_S = SETTINGS.first_step_s + len(STEPS) * SETTINGS.between_steps_s

_CHUNK = 64  # missions that fly at a time: their rows fit into memory

SIZES_DEG = tuple(size for size, _, _ in SETTINGS.step_sizes)
"""Steps of yaw of the courses, deg."""


@dataclass(frozen=True)
class Spread:
    """What is drawn beside the vehicle."""

    current_m_s: float = 0.25  #: Largest speed of the current; any direction.
    #: Largest pull of the tether; any direction in the plane, up to half of it upwards.
    tether_n: float = 5.0
    battery: float = 0.8  #: Least thrust at the beginning, as a share of that at full voltage.
    fall: float = 0.1  #: Largest share that is lost until the end.
    sag: float = 0.1  #: Largest share that is lost at full load.


SPREAD = Spread()


@dataclass(frozen=True, eq=False)
class Step:
    """A step of a course: channel, time, size, corridor of the normalised response."""

    channel: str
    at_s: float
    size: float
    corridor: Corridor


@dataclass(frozen=True, eq=False)
class Missions:
    """Violations of many missions."""

    violations: Mapping[str, Array]  #: (k,) by channel, s.
    #: Normalised responses (5, n) by channel over the time since the step, of the first course: the least,
    #: 2.5 %, the median, 97.5 %, the largest at each time.
    bands: Mapping[str, Array]
    since: Array  #: (n,), s.

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "violations": {name: own.round(6).tolist() for name, own in self.violations.items()},
            "bands": {name: own.round(5).tolist() for name, own in self.bands.items()},
            "since": self.since.round(6).tolist(),
        }

    @classmethod
    def of_dict(cls, data: Mapping[str, Any]) -> Missions:
        """The missions of plain data."""
        violations, bands = (
            {n: np.array(x) for n, x in data[key].items()} for key in ("violations", "bands")
        )
        return cls(violations, bands, np.array(data["since"]))

    def worst(self, channel: str) -> float:
        """Largest violation, s."""
        return float(self.violations[channel].max())

    def row(self, channel: str) -> tuple[float, float, float]:
        """Largest violation, that which 95 % stay within, s, and share of the missions without any."""
        own = self.violations[channel]
        return float(own.max()), float(np.quantile(own, 0.95)), float(np.mean(own <= 0.0))


@dataclass(frozen=True, eq=False)
class Tuned:
    """Parameters before and after."""

    #: `before`, `after`: all parameters of the cascade that differ from ArduSub's defaults, or were found.
    before: Mapping[str, float]
    after: Mapping[str, float]
    changes: tuple[Change, ...]  #: What changes, with why and bounds.
    margins: Mapping[str, tuple[Margins, Margins]]  #: By loop: before and after.
    evaluations: int  #: Candidates that were flown.


def step_courses(
    channels: Sequence[str], rise_s: float, *, period_s: float, slew_deg_s: float = SETTINGS.slew_rate_deg_s
) -> tuple[tuple[Course, tuple[Step, ...]], ...]:
    """Courses of four sizes that step some of yaw, depth and north, and their steps.

    `rise_s` is that of a step of yaw of 60 deg, see `rise_of`; a yaw target turns by `slew_deg_s`.
    """
    every = round(FLOWN.row_s / period_s)
    own = tuple(name for name in STEPS if name in channels)
    length_s = SETTINGS.first_step_s + len(own) * SETTINGS.between_steps_s
    n = round(length_s / FLOWN.row_s) * every
    t: Array = np.asarray(period_s * np.arange(n), float)
    made = []
    for sizes in SETTINGS.step_sizes:
        targets, steps = still_targets(n), []
        corridors = corridors_of(rise_s, size_deg=sizes[0], slew_deg_s=slew_deg_s)
        for i, channel in enumerate(own):
            at, size = SETTINGS.first_step_s + i * SETTINGS.between_steps_s, sizes[STEPS.index(channel)]
            steps.append(Step(channel, at, size, corridors[channel]))
            if channel == "yaw":
                targets[:, 2] = np.where(t >= at, math.radians(size), 0.0)
                continue
            for offset, values in zip((0, 3, 6), _moved(t - at, size), strict=True):
                targets[:, _COLUMNS[channel] + offset] += values
        course = Course(
            ", ".join(f"{step.channel} {step.size:+g}" for step in steps), t[::every], targets, period_s,
            np.array([0.0, 0.0, 5.0]), np.zeros(3), np.zeros(6), np.zeros(7),
        )  # fmt: skip
        made.append((course, tuple(steps)))
    return tuple(made)


def _moved(since: Array, size: float) -> tuple[Array, Array, Array]:
    """Place, velocity and acceleration (n,) of a target that moves by a size, m, m/s, m/s2.

    It speeds up, moves on and slows down; a short way is over before it is at full speed.
    """
    most = SETTINGS.target_acceleration_m_s2
    speed = min(SETTINGS.target_speed_m_s, math.sqrt(most * abs(size)))
    ramp = speed / most
    lasts = abs(size) / speed + ramp
    up, down = np.clip(since, 0.0, ramp), np.clip(since - (lasts - ramp), 0.0, ramp)
    sign = math.copysign(most, size)
    within = (since >= 0.0) & (since < lasts)
    acceleration = sign * (within & (since < ramp)) - sign * (within & (since >= lasts - ramp))
    steady = np.clip(since - ramp, 0.0, lasts - 2.0 * ramp)
    place = sign * (0.5 * up**2 + ramp * steady + ramp * down - 0.5 * down**2)
    return place, sign * (up - down), acceleration


def corridors_of(
    rise_s: float, *, size_deg: float = SETTINGS.rise_step_deg, slew_deg_s: float = SETTINGS.slew_rate_deg_s
) -> dict[str, Corridor]:
    """Corridors of the steps: yaw has risen by `rise_s`; depth and place follow a target that moves.

    A yaw target turns with `slew_deg_s`: a step that is larger than 60 deg rises later by the time that 90
    % of the rest takes, a smaller one sooner.
    """
    moving = {
        name: Corridor.from_figures(
            rise_s=rise, overshoot=0.15, settled=0.1, undershoot=0.15, until_s=11.0, settling_s=9.0
        )
        for name, rise in (("depth", 5.5), ("north", 8.0))
    }
    more = 0.9 * (abs(size_deg) - SETTINGS.rise_step_deg) / slew_deg_s if slew_deg_s > 0.0 else 0.0
    rise = min(max(rise_s + more, SETTINGS.shortest_rise_s), 5.0)
    own = Corridor.from_figures(
        rise_s=rise, overshoot=0.1, settled=0.05, settling_s=min(2.0 * rise, 10.0), until_s=11.0
    )
    return {"yaw": own, **moving}


def slew_of(parameters: Mapping[str, float]) -> float:
    """Rate at which a yaw target turns with some parameters, deg/s."""
    slew, most = (
        parameters.get("ATC_RATE_WPY_MAX", SETTINGS.slew_rate_deg_s),
        parameters.get("ATC_RATE_Y_MAX", 0.0),
    )
    return min(slew, most) if most > 0.0 else slew


def draw_cases(fitted: Fitted, wander: Array, k: int, *, seed: int) -> Cases:
    """Cases of missions: vehicle, current, tether, battery and wandering wrench, as far as `SPREAD` goes."""
    rng = np.random.default_rng([seed, 20])
    toward, pulls = rng.uniform(0.0, 2.0 * np.pi, (2, k))
    speed, force = rng.uniform(0.0, SPREAD.current_m_s, k), rng.uniform(0.0, SPREAD.tether_n, k)
    current = np.stack([speed * np.cos(toward), speed * np.sin(toward), np.zeros(k)], 1)
    tether = np.stack([force * np.cos(pulls), force * np.sin(pulls), -rng.uniform(0.0, 0.5, k) * force], 1)
    full, fall = rng.uniform(SPREAD.battery, 1.0, k), rng.uniform(0.0, SPREAD.fall, k) / LENGTH_S
    supply = np.stack([full, fall, rng.uniform(0.0, SPREAD.sag, k)], 1)
    return Cases.of(
        k, seed=1_000_000 * (seed + 1), coefficients=fitted.draws(k, seed), current=current, wander=wander,
        tether=tether, supply=supply,
    )  # fmt: skip


def fly_missions(
    fitted: Fitted,
    rig: Rig,
    courses: Sequence[tuple[Course, tuple[Step, ...]]],
    parameters: Mapping[str, Any],
    *,
    cases: Cases,
    work: Work = HERE,
    what: str = "missions",
) -> Missions:
    """Violations of the cases, which are dealt out to the courses in turn; progress tells `what` flies."""
    channels = [step.channel for step in courses[0][1]]
    violations = {name: np.zeros(len(cases)) for name in channels}
    responses: dict[str, list[Array]] = {name: [] for name in channels}
    since = np.zeros(0)
    done = 0
    for c, (course, steps) in enumerate(courses):
        # Dealt out in turn: every course meets the same spread of vehicles.
        mine = np.arange(c, len(cases), len(courses))
        for first in range(0, len(mine), _CHUNK):
            own = mine[first : first + _CHUNK]
            given = {
                name: np.asarray(value, float)[own] if np.ndim(value) else value
                for name, value in parameters.items()
            }
            flown = fly_course(
                fitted.vehicle, rig, course, given, cases=cases.take(own), threads=work.threads
            )
            errors = course.errors(flown)
            for step in steps:
                since, response = _response(step, errors, course)
                violations[step.channel][own] = _violation(step.corridor, since, response)
                # Steps of one size can be drawn together: those of the first course.
                if c == 0:
                    responses[step.channel].append(response)
            done += len(own)
            tell(work, done / len(cases), what)
    shares = [0.0, 0.025, 0.5, 0.975, 1.0]
    bands = {
        name: np.quantile(_finite(np.concatenate(parts)), shares, axis=0) for name, parts in responses.items()
    }
    return Missions(violations, bands, since)


def _finite(response: Array) -> Array:
    """A response with what stands for numbers of one that diverged."""
    return np.where(np.isfinite(response), response, SETTINGS.diverged_violation)


def _response(step: Step, errors: Mapping[str, Array], course: Course) -> tuple[Array, Array]:
    """Times (n,) since a step until the next one, s, and normalised responses (k, n) to it."""
    end = step.at_s + SETTINGS.between_steps_s
    rows = course.between(step.at_s - 1e-6, end - 1e-6)
    return course.t[rows] - step.at_s, _normalised(step, errors[step.channel], course)[:, rows]


def _normalised(step: Step, errors: Array, course: Course) -> Array:
    """Response (k, n): 0 before the step and 1 at the new set point, against where it stood before."""
    before = course.between(step.at_s - 1.0, step.at_s - 1e-6)
    offset = errors[:, before].mean(axis=1, keepdims=True)
    target = course.targets[:: course.every, _COLUMNS[step.channel]]
    way = target - target[before].mean()
    if step.channel == "yaw":
        way = np.degrees(way)
    # A standing error before the step is not the step's.
    return np.asarray((way - errors + offset) / step.size)


def _violation(corridor: Corridor, since: Array, response: Array) -> Array:
    """Time integral (k,) of what is outside, s."""
    lower, upper = corridor.sampled(since)
    sound = _finite(response)
    below, above = np.maximum(lower - sound, 0.0), np.maximum(sound - upper, 0.0)
    outside = corridor.weight_lower * below + corridor.weight_upper * above
    return np.asarray(outside.sum(axis=1) * FLOWN.row_s)


def rise_of(fitted: Fitted, rig: Rig, parameters: Mapping[str, float], *, period_s: float) -> float:
    """Time after which yaw has risen by 90 % of a step of 60 deg, s: nominal vehicle, still water."""
    course, steps = step_courses(("yaw",), 2.0, period_s=period_s)[SIZES_DEG.index(SETTINGS.rise_step_deg)]
    still = replace(rig, noise=(0.0, 0.0))
    errors = course.errors(fly_course(fitted.vehicle, still, course, parameters, cases=Cases.of(1)))
    response = _normalised(steps[0], errors["yaw"], course)[0]
    risen = np.flatnonzero((course.t >= steps[0].at_s) & (response >= 0.9))
    rise = course.t[risen[0]] - steps[0].at_s if len(risen) else 5.0
    return float(np.clip(rise, 0.5, 4.5))


def tune_parameters(
    model: MarginModel,
    courses: Sequence[tuple[Course, tuple[Step, ...]]],
    before: Mapping[str, float],
    verdicts: Sequence[AxisVerdict],
    *,
    cases: Cases,
    generations: int = SETTINGS.generations,
    seed: int = 0,
    work: Work = HERE,
) -> Tuned:
    """Parameters of the loops that can be judged, sought by CMA-ES over their logarithms.

    Vehicle and rig are those of `model`. Cost: mean violation of the worst tenth of the missions over all
    steps, a hundredth of the mean deviation, and ten times what the margins lack. The recorded parameters
    stay where no candidate is better, and changes without which the cost is nearly the same are put back.
    """
    import cma

    loops = [verdict.loop for verdict in verdicts if verdict.judged]
    start = {**ardusub_defaults(), **before}
    sought = {name: ends for loop in loops for name, ends in SOUGHT[loop].items()}
    if not sought:
        return Tuned(dict(before), dict(before), (), {}, 0)
    names, margins_before = list(sought), [model.of(loop, start) for loop in loops]
    # A recorded value beyond ArduPilot's range widens it: nothing has to change.
    bounds = {
        name: (min(low, start[name]) if start[name] > 0.0 else low, max(high, start[name]))
        for name, (low, high) in sought.items()
    }
    low, high = np.log(list(bounds.values())).T
    first = np.clip(np.log([max(start[name], bounds[name][0]) for name in names]), low, high)
    flights = _Flights(model, courses, before, cases, work.threads)

    def costs(candidates: Array) -> Array:
        """Cost (m,) of candidates (m, p), logarithms of the parameters: all of them in one batch."""
        values = np.exp(candidates)
        worst = flights.worst(names, values)
        lacking = []
        for row in values.tolist():
            tried = {**start, **dict(zip(names, row, strict=True))}
            own = [model.of(loop, tried) for loop in loops]
            lacking.append(sum(a.lacking(b) for a, b in zip(own, margins_before, strict=True)))
        return np.asarray(worst + 10.0 * np.array(lacking))

    # The recorded values are the first candidate: none that is worse is taken.
    as_flown = float(costs(first[None])[0])
    best, best_cost, evaluations = first, as_flown, 1
    search = cma.CMAEvolutionStrategy(
        first, 0.35, {"bounds": [low.tolist(), high.tolist()], "seed": seed + 1, "verbose": -9, "popsize": 8}
    )
    for generation in range(1, generations + 1):
        tried = np.array(search.ask())
        cost = costs(tried)
        search.tell(list(tried), cost.tolist())
        evaluations += len(tried)
        if cost.min() < best_cost:
            best, best_cost = tried[int(cost.argmin())], float(cost.min())
        state = f"gains, generation {generation} of {generations}, cost {best_cost:.3g} of {as_flown:.3g}"
        tell(work, generation / generations, state)
    # Three digits are loaded; what differs by less than two percent stays as it is.
    rounded = {name: float(f"{value:.3g}") for name, value in zip(names, np.exp(best).tolist(), strict=True)}
    changed = {
        name: value for name, value in rounded.items() if abs(value - start[name]) > 0.02 * start[name]
    }

    def without(left_out: Sequence[str]) -> Array:
        """Costs of all changes without one, for each one of them."""
        rows = [
            [changed.get(name, start[name]) if name != left else start[name] for name in names]
            for left in left_out
        ]
        return costs(np.log(np.maximum(np.array(rows), np.exp(low))))

    # What changes little is put back: the file holds only what it needs.
    alone: dict[str, float] = {}
    while changed:
        reached = float(without([""])[0])
        alone = dict(zip(changed, without(list(changed)).tolist(), strict=True))
        evaluations += 1 + len(alone)
        least = min(alone, key=lambda name: alone[name])
        if alone[least] > 1.1 * reached + 0.05 * (as_flown - reached):
            best_cost = reached
            break
        del changed[least]
    margins = [(own, model.of(own.loop, {**start, **changed})) for own in margins_before]
    why = wording("ardusub").why_changed
    changes = tuple(
        Change(
            name, float(f"{start[name]:.4g}"), value,
            why(len(cases), (as_flown, best_cost, alone[name]), at_end=value > 0.95 * bounds[name][1]),
            bounds[name],
        )
        for name, value in changed.items()
    )  # fmt: skip
    after = {**before, **changed}
    return Tuned(dict(before), after, changes, {own.loop: (own, new) for own, new in margins}, evaluations)


@dataclass(frozen=True)
class _Flights:
    """The missions that every candidate of a search flies."""

    model: MarginModel
    courses: Sequence[tuple[Course, tuple[Step, ...]]]
    before: Mapping[str, float]
    cases: Cases
    threads: int | None

    def worst(self, names: Sequence[str], values: Array) -> Array:
        """Mean violation (m,) of the worst tenth of the missions of candidates (m, p), s.

        A hundredth of the mean deviation counts too, so that a search sees a slope inside of the corridors.
        """
        count, every = len(self.cases), len(self.courses)
        tiled = self.cases.take(np.tile(np.arange(count), len(values)))
        own = {name: np.repeat(values[:, i], count) for i, name in enumerate(names)}
        # Each candidate flies the same cases on the same courses.
        violation = np.zeros((len(values), count))
        for c, (course, steps) in enumerate(self.courses):
            mine = np.concatenate([m * count + np.arange(c, count, every) for m in range(len(values))])
            given = {**self.before, **{name: values_of[mine] for name, values_of in own.items()}}
            vehicle, rig, cases = self.model.fitted.vehicle, self.model.rig, tiled.take(mine)
            errors = course.errors(fly_course(vehicle, rig, course, given, cases=cases, threads=self.threads))
            total = np.zeros(len(mine))
            for step in steps:
                since, response = _response(step, errors, course)
                total += _violation(step.corridor, since, response)
                total += 0.01 * np.abs(_finite(response) - 1.0).sum(axis=1) * FLOWN.row_s
            violation.reshape(-1)[mine] = total
        tail = max(round(SETTINGS.tail_share * count), 1)
        return np.asarray(np.sort(violation, axis=1)[:, -tail:].mean(axis=1))
