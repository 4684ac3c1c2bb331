"""Whether commands follow measurements: a closed loop, its gain and lag, and events in which they do not.

A command that an autopilot or a pilot makes from measurements can be foretold from them; one of a preset
manoeuvre only from its own past. Two autoregressions foretell each change of a command, one from its past
changes, one from those and the past changes of the measurements; the second is better by a part
``1 - s2^2 / s1^2`` of the variance, judged on blocks of time outside the fit (Granger 1969). Both see means
over 0.4 s and what lies behind them: at a log's full rate an autopilot's answer to the noise of its own
sensors hides the loop, and a measurement at the same time may be the answer to the command. Changes leave
out what is constant: offsets and set points between their steps; samples at an end of the command's range
say nothing and are left out. A recorded wrench is judged like a command, axis by axis: of a vehicle whose
allocator spreads one axis over many thrusters it shows the loop most clearly. The measurement that alone
improves it most is named, with the slope from it to the command and the lag at which it explains the
command best. Held by ``tests/inspect/test_feedback.py``.

A directionally unstable hull turns away within seconds while its controls are held still; only an autopilot
keeps it straight (`runs_away`). A simulation from a recorded state then leaves the log whatever the
coefficients are, and comparing both says little of them. Held by ``tests/inspect/test_instability.py``.

A routine mission of an autopilot holds open-loop experiments (`events`): the rudder at its limit at the
beginning of a leg, a set point that steps, a test of the actuators. There the command changes at once by a
good part of its range and is held after that, whatever waves do. Held by ``tests/inspect/test_events.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS
from seatrial.trial.columns import WRENCH
from seatrial.vehicle.stability import growth

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial
from typing import TYPE_CHECKING, Literal

from seatrial.base.arrays import runs
from seatrial.base.plain import Plain
from seatrial.vehicle.actuators import drivers

SEEN = ("yaw", "pitch", "roll", "z", "u", "v", "w", "p", "q", "r")
"""Channels that a command may follow."""


@dataclass(frozen=True)
class FeedbackSettings:
    """Thresholds from which a command is judged to follow measurements."""

    #: Part of the variance that measurements explain of what the command's own past does not, from which the
    #: loop is closed.
    closed: float = 0.2
    #: Means that the autoregressions see, s, and how many of them back. Shorter means show an autopilot's
    #: answer to the noise of its own sensors.
    mean_s: float = 0.4
    lags: int = 6
    #: Means at the start that are left out, at most a tenth of the log: a transient there is no loop.
    settled: int = 150
    #: Parts of the log, each judged by a fit to the others, and the regression's ridge per mean, on
    #: standardised regressors.
    blocks: int = 6
    ridge: float = 1e-2
    #: Means below which nothing is judged: a regression on ten channels has sixty unknowns.
    fewest: int = 200
    #: Part of the command's range at either end where it may be saturated, and tells nothing.
    at_the_end: float = 0.01
    #: Robust deviations of a change, and deviations of a regressor, at which they are clipped: steps of set
    #: points are no answer to a measurement.
    outlier: float = 3.0
    tall: float = 4.0
    #: Rate at which the slope is judged; longest lag of a command behind its measurement; time over which
    #: both are differenced, so that set points and offsets drop out.
    rate_hz: float = 10.0
    longest_lag_s: float = 2.0
    apart_s: float = 1.0
    #: A disturbance that grows tenfold within this share of a segment grows by ten thousand in all of it.
    runaway_share: float = 0.25
    rounded_s: float = 0.5  #: A segment is a multiple of it in a report, s.


SETTINGS = FeedbackSettings()
"""Those of every judgement that is given no others."""

LEAST_S = SETTINGS.fewest * SETTINGS.mean_s
"""Length of a trial below which no loop is seen, s."""


@dataclass(frozen=True)
class Feedback:
    """How one command depends on what was measured."""

    command: str  #: Name of the actuator, or column of the wrench (``tau.Z_n``).
    #: Part of the command's unpredicted variance that the measurements foretell, on data outside the fit.
    explained: float
    channel: str  #: The measurement that foretells it best; "" where the loop is open.
    gain: float  #: Slope of the command on that measurement, command's unit (rad for angles) per SI unit.
    lag_s: float  #: How long the command is behind that measurement.

    @property
    def closed(self) -> bool:
        """Whether the command follows measurements."""
        return bool(self.channel)


def feedback(trial: Trial, settings: FeedbackSettings = SETTINGS) -> list[Feedback]:
    """How each command and component of a wrench that changes depends on the measurements, in their order."""
    result = []
    wrench = {} if trial.tau is None else dict(zip(WRENCH, trial.tau.T, strict=True))
    for name, command in (trial.commands | wrench).items():
        judged = _judge(name, command, trial, settings)
        if judged is not None:
            result.append(judged)
    return result


def explained(trial: Trial, command: Array, *, settings: FeedbackSettings = SETTINGS) -> Feedback:
    """How one signal (n,), made of commands, depends on the measurements; open where too little is known."""
    return _judge("", command, trial, settings) or Feedback("", 0.0, "", math.nan, math.nan)


def _judge(name: str, command: Array, trial: Trial, settings: FeedbackSettings) -> Feedback | None:
    stride = max(1, round(settings.mean_s / trial.dt))
    count = len(trial) // stride
    recorded = {c: y for c in SEEN if (y := trial.filled(c)) is not None and y.std() > 0.0}
    if not recorded or count < settings.fewest or np.ptp(command) == 0.0:
        return None
    good = np.logical_and.reduce([trial.valid[:, CHANNELS.index(c)] for c in recorded])
    low, high = float(command.min()), float(command.max())
    margin = settings.at_the_end * (high - low)
    free = good & (command > low + margin) & (command < high - margin)
    # A mean counts where most of its samples and of those before it do.
    usable = np.convolve(means(free.astype(float), stride) < 0.5, np.ones(2), mode="full")[:count] == 0
    usable[: max(settings.lags + 2, min(settings.settled, count // 10))] = False
    y, seen = means(command, stride), {c: means(m, stride) for c, m in recorded.items()}
    change = np.diff(y, prepend=y[0])
    if usable.sum() < settings.fewest or not change[usable].any():
        return Feedback(name, 0.0, "", math.nan, math.nan)
    back = range(1, settings.lags + 1)
    own = earlier(change, back)
    plain = _unpredicted([own], change, usable, settings)
    past = {channel: earlier(np.diff(m, prepend=m[0]), back) for channel, m in seen.items()}
    if plain <= 0.0:
        return Feedback(name, 0.0, "", math.nan, math.nan)
    # All together foretell a loop over several channels; on a short log one alone is not lost among them.
    alone = {
        channel: _unpredicted([own, measured], change, usable, settings) for channel, measured in past.items()
    }
    best = min(alone, key=lambda channel: alone[channel])
    part = 1.0 - min(_unpredicted([own, *past.values()], change, usable, settings), alone[best]) / plain
    if part <= settings.closed:
        return Feedback(name, max(part, 0.0), "", math.nan, math.nan)
    thin = max(1, math.ceil(1.0 / (settings.rate_hz * trial.dt) - 0.01))
    gain, lag = _slope(command[::thin], recorded[best][::thin], free[::thin], thin * trial.dt, settings)
    return Feedback(name, part, best, gain, lag)


def means(y: Array, stride: int) -> Array:
    """Means of `stride` samples each."""
    count = len(y) // stride
    return np.asarray(y[: count * stride].reshape(count, stride).mean(axis=1))


def earlier(y: Array, lags: range) -> Array:
    """Earlier samples (n, k), zero before the first."""
    return np.column_stack([np.concatenate([np.zeros(k), y[: len(y) - k]]) for k in lags])


def _unpredicted(parts: list[Array], y: Array, usable: Mask, settings: FeedbackSettings) -> float:
    """Mean square of what the regression leaves of y (n,) on blocks outside its fit, robust against steps."""
    limit = settings.outlier * 1.4826 * float(np.median(np.abs(y[usable])))
    if limit == 0.0:  # preset steps: most changes are none
        low, high = np.quantile(y[usable], [0.01, 0.99])
        limit = settings.outlier * float(np.sqrt(np.mean(np.clip(y[usable], low, high) ** 2))) or np.inf
    regressors = np.hstack(parts)
    tall = settings.tall * regressors[usable].std(axis=0)
    left = prediction_errors(
        np.clip(regressors, -tall, tall), np.clip(y, -limit, limit), usable, settings=settings
    )
    return float(np.mean(left[usable] ** 2))


def prediction_errors(
    regressors: Array, y: Array, usable: Mask, *, settings: FeedbackSettings = SETTINGS
) -> Array:
    """What a ridge regression leaves of y (n,), each block of time judged by a fit to the others.

    Zero where `usable` is false.
    """
    spread = float(y[usable].std()) or 1.0
    x = (regressors - regressors[usable].mean(axis=0)) / (regressors[usable].std(axis=0) + 1e-12)
    target = (y - y[usable].mean()) / spread
    left = np.zeros(len(y))
    samples = np.flatnonzero(usable)
    whole, moment = x[usable].T @ x[usable], x[usable].T @ target[usable]
    for block in np.array_split(samples, settings.blocks):
        own, aim = x[block], target[block]
        ridge = settings.ridge * (len(samples) - len(block)) * np.eye(x.shape[1])
        left[block] = aim - own @ np.linalg.solve(whole - own.T @ own + ridge, moment - own.T @ aim)
    return left * spread


def _slope(y: Array, m: Array, usable: Mask, dt: float, settings: FeedbackSettings) -> tuple[float, float]:
    """Slope of the command on a measurement and the lag in s at which they go together best.

    Slow parts (set points, offsets) are taken out by differences over a second.
    """
    apart = max(1, round(settings.apart_s / dt))
    best = (0.0, math.nan, math.nan)
    for k in range(max(2, round(settings.longest_lag_s / dt)) + 1):
        a = y[apart + k :] - y[k : len(y) - apart]
        b = m[apart : len(m) - k] - m[: len(m) - apart - k]
        use = usable[apart + k :] & usable[k : len(y) - apart]
        if use.sum() < settings.fewest // 2:
            continue
        a, b = a[use], b[use]
        limit = np.quantile(np.abs(a), 0.98)
        kept = np.abs(a) <= limit  # without the steps of set points
        a, b = a[kept], b[kept]
        power = float(b @ b)
        if power == 0.0:
            continue
        correlation = abs(float(a @ b)) / math.sqrt(power * float(a @ a) + 1e-300)
        if correlation > best[0]:
            best = (correlation, float(a @ b) / power, k * dt)
    return best[1], best[2]


SEGMENT_S = 20.0
"""Length of a simulated segment of the joint estimate, s, unless a campaign says otherwise."""


_PLANES = {"course": ("YN", "yaws"), "pitch": ("ZM", "pitches")}


def runs_away(vehicle: Vehicle, trials: Sequence[Trial], free: str, segment_s: float = SEGMENT_S) -> str:
    """Sentence on a vehicle that leaves straight running, at a trial's median speed ahead, too fast to be
    simulated for a segment; else "". `free`: the simulated axes; the course needs sway and yaw, the pitch
    heave and pitch.
    """
    for trial in trials:
        for verb, speed, tenfold_s in _tenfold(vehicle, trial, free):
            if tenfold_s < SETTINGS.runaway_share * segment_s:
                return (
                    f"with fixed controls the start vehicle {verb} off a straight course at {speed:.1f} m/s,"
                    f" and deviations grow tenfold in {tenfold_s:.1f} s"
                )
    return ""


def judged_s(vehicles: Sequence[Vehicle], trials: Sequence[Trial], free: str, longest_s: float) -> float:
    """How far ahead a simulation judges a model of a vehicle that may run away, s: the time in which a
    disturbance of the fastest grows tenfold, where it grows by ten thousand within `longest_s`.
    """
    times = [time for v in vehicles for trial in trials for *_, time in _tenfold(v, trial, free)]
    shortest = min(times, default=math.inf)
    if shortest >= SETTINGS.runaway_share * longest_s:
        return longest_s
    return max(SETTINGS.rounded_s * round(shortest / SETTINGS.rounded_s), SETTINGS.rounded_s)


def _tenfold(vehicle: Vehicle, trial: Trial, free: str) -> Iterator[tuple[str, float, float]]:
    """Per plane that diverges: its verb, the median speed ahead, and the time of a tenfold growth, s."""
    k = CHANNELS.index("u")
    known = trial.observed[trial.valid[:, k], k]
    speed = float(np.median(known)) if len(known) else 0.0
    for plane, (axes, verb) in _PLANES.items() if speed > 0.0 else ():
        rate = growth(vehicle, speed, plane) if set(axes) <= set(free) else 0.0
        if rate > 0.0:
            yield verb, speed, math.log(10.0) / rate


@dataclass(frozen=True)
class EventLimits:
    """What counts as an event."""

    #: Length, s. Shorter than a wave it is not told from one; after 20 s, four or five time constants of a
    #: torpedo's turn or a hovering vehicle's drift, nothing new is seen.
    least_s: float = 5.0
    most_s: float = 20.0
    #: How long before its command it begins, s: the angle's slope there is the rate that it starts with.
    before_s: float = 1.5
    #: Change of a command, over its range, that counts as none: a servo's report trembles by some counts.
    held: float = 0.003
    #: Change of a command, over its range, that begins an event: below it waves move the vehicle more.
    step: float = 0.15


EVENT_LIMITS = EventLimits()


@dataclass(frozen=True)
class Event(Plain):
    """A stretch of a trial in which the commands of an axis are held.

    Attributes
    ----------
    trial
        Its name.
    axis
        Letter of the axis that the commands push.
    start_s, stop_s
        When the command is held, and when it answers again or the event is long enough.
    command
        What is held, by the first actuator of the axis that moves, in the unit of its command.
    kind
        "limit" where the command is the largest of the trial, "held" elsewhere.
    """

    trial: str
    axis: str
    start_s: float
    stop_s: float
    command: float
    kind: Literal["limit", "held"]


def events(
    trial: Trial, vehicle: Vehicle, axis: str, usable: Mask | None = None, limits: EventLimits = EVENT_LIMITS
) -> tuple[Event, ...]:
    """Events of an axis, a letter among ``XYZKMN``, in the order of time. `usable` (n,): samples that an
    event may use, the time before its command included; all when omitted.
    """
    names = [
        name
        for name in drivers(vehicle).get(axis, ())
        if name in trial.commands and np.ptp(np.asarray(trial.commands[name], float)) > 0.0
    ]
    if not names:
        return ()
    commands = np.column_stack([np.asarray(trial.commands[name], float) for name in names])
    scaled = commands / np.ptp(commands, axis=0)
    allowed = np.ones(len(trial), dtype=bool) if usable is None else usable
    if trial.silent is not None:  # a command that is not logged is no command that is held
        allowed = allowed & ~trial.silent
    still = allowed & (np.abs(np.diff(scaled, axis=0, prepend=scaled[:1])).max(axis=1) <= limits.held)
    before = max(round(limits.before_s / trial.dt), 1)
    longest = round(limits.most_s / trial.dt)
    stretches = []
    for first, end in runs(still):
        last = min(end, first + longest)
        if first < before or (last - first) * trial.dt < limits.least_s:
            continue
        # Held, and not drifting by a little at every sample; and far from where it was a moment before.
        drifted = np.ptp(scaled[first:last], axis=0).max() > 4.0 * limits.held
        stepped = np.abs(scaled[first - before : first] - scaled[first]).max() >= limits.step
        if drifted or not stepped or not allowed[first - before : first].all():
            continue
        # A simulation has to start before the command changes.
        if not trial.startable[first - before : first].any():
            continue
        command = float(commands[first, 0])
        largest = float(np.abs(commands[:, 0]).max())
        stretches.append(
            Event(
                trial.name,
                axis,
                float(trial.t[first]),
                float(trial.t[last - 1]),
                command,
                "limit" if abs(command) >= (1.0 - limits.held) * largest else "held",
            )
        )
    return tuple(stretches)
