"""Whether a recording can tell how the vehicle answers its commands, axis by axis.

An autopilot in waves moves its actuators because the vehicle moves. Cause and effect are then exchanged: a
fit finds the controller's inverse in place of the vehicle (Soderstrom and Ljung 1989, section 10). What tells
the vehicle is the part of the command that no measurement foretells: steps of set points, a dither, limits.

The commands that push an axis are one signal ``c = sum_i (dtau / dcommand_i) command_i`` from the vehicle's
wrench; where no command is recorded, its component of the recorded wrench. Two regressions follow (the
two-stage method of Van den Hof and Schrama, *Automatica* 29 (1993) 1523):

1. each change of c from its own past changes and those of all measurements; what is left, e, is exogenous;
2. the axis' velocity from the past 30 s of e.

The part of the velocity's variance that the second explains, on blocks of time outside both fits, is the
share that the exogenous command drives. Below `told_share` of a closed loop in waves the axis is dominated by
feedback. Regressions are robust: a set point's step is an outlier of the first and must not bend it.

An axis without a command or with an open loop is never dominated. Where no waves are seen the share is less
sure, for answers to steps of a set point are less linear than those to waves: there only a share below
`untold_share` counts, in a log that is long enough. Held by ``tests/inspect/test_verdict.py``; derivation and
limits: ``docs/theory/feedback.md``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.report import wording
from seatrial.inspect.feedback import SEEN, earlier, explained, means, prediction_errors
from seatrial.inspect.waves import waves
from seatrial.trial.columns import WRENCH
from seatrial.vehicle.actuators import actuator_groups, pushes

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.trial.trial import Trial


@dataclass(frozen=True)
class VerdictSettings:
    """Which share of a velocity's variance commands must drive, and how that share is computed."""

    #: Share of the velocity's variance from which the exogenous command tells the vehicle. Straight missions
    #: in waves of 5 to 14 s show 0.28 at most. Dithers that drove 0.6 and more and depth steps that drove 0.4
    #: to 0.7 told the planes' gain within 3 %, small dithers of 0.4 were up to 15 % wrong.
    told_share: float = 0.45
    #: Share from which a replay of commands that answer waves, without the waves, judges a model.
    replayed_share: float = 0.7
    #: Share below which it does not, whether or not waves were seen, in a log of `long_s` and more.
    untold_share: float = 0.05
    #: Of a command that measurements foretell, from which an axis that passes as open may answer waves.
    foretold_share: float = 0.1
    #: Of the command's power at wave frequencies, from which it does: preset commands have neither together.
    in_waves_share: float = 0.3
    long_s: float = 300.0  #: Shorter logs do not tell so small a share from chance, s.
    way_deviations: float = 3.0  #: Robust deviations of the velocity that an axis keeps its way by.
    #: Of the actuator's largest force or moment: its other axes are no purpose of it.
    main_share: float = 0.1
    least_lever_m: float = 0.03  #: Lever of a moment, m: shorter ones come of the hull's measures alone.
    rate_hz: float = 5.0  #: Of the regressions, Hz: faster than any hull answers.
    own_lags: int = 16  #: Past samples of the command.
    seen_lags: int = 10  #: Past samples of each measurement.
    answer_s: float = 30.0  #: How long the velocity may answer, s.
    fine_lags: int = 20  #: Lags of the answer that are single samples.
    coarse_lags: int = 4  #: Samples that each of the other lags is a mean of.
    settled_samples: int = 100  #: Samples at the start that are left out.
    outlier: float = 3.0  #: Robust deviations of the command's change that count as a step.
    tall: float = 5.0  #: Deviations of a regressor beyond which it is cut.
    wave_band: float = 1.35  #: Band of the waves, as a factor of their frequency.


SETTINGS = VerdictSettings()


_DRAG = ("X_u", "X_uu", "Y_v", "Y_vv", "Z_w", "Z_ww")
Kind = Literal["open", "closed and informative", "feedback-dominated"]


@dataclass(frozen=True)
class Verdict:
    """Whether a recording tells how an axis answers its commands."""

    axis: str  #: Letter among ``XYZKMN``.
    kind: Kind  #: "open", "closed and informative" or "feedback-dominated".
    commands: tuple[str, ...]  #: Actuators that push the axis, or the column of the wrench.
    explained: float  #: Part of the command's unpredicted variance that past measurements foretell.
    #: Share of the velocity's variance that the exogenous part of the command drives; NaN in an open loop.
    told: float
    wave_share: float  #: Share of the command's variance at wave frequencies; NaN without waves.
    wave_period_s: float  #: Of the waves; NaN without.
    #: Whether the vehicle keeps its way along the axis: the mean thrust then tells the drag.
    under_way: bool = False

    @property
    def dominated(self) -> bool:
        """Whether no gain of this axis can be told from the recording."""
        return self.kind == "feedback-dominated"

    @property
    def answers_waves(self) -> bool:
        """Whether the commands of an axis that passes as open answer waves in part."""
        return (
            self.kind == "open"
            and self.explained > SETTINGS.foretold_share
            and self.wave_share > SETTINGS.in_waves_share
        )

    @property
    def trial(self) -> str:
        """The trial that tells a dominated axis; empty where none is needed."""
        return str(wording("trial_findings").TRIAL) if self.dominated else ""

    @property
    def sentence(self) -> str:
        """The verdict with its evidence, and the remedy where there is one."""
        return f"{self.why}. {self.trial[0].upper()}{self.trial[1:]}" if self.dominated else self.why

    @property
    def why(self) -> str:
        """The verdict with its evidence."""
        return str(wording("trial_findings").verdict(self))


def judge(trials: Sequence[Trial], vehicle: Vehicle) -> dict[str, Verdict]:
    """Verdict per axis on several trials, the worst axis first: the best trial decides for an axis."""
    return best([judge_trial(trial, vehicle) for trial in trials])


def best(judged: Iterable[Mapping[str, Verdict]]) -> dict[str, Verdict]:
    """The best verdict per axis of several trials, the worst axis first."""
    best_of: dict[str, Verdict] = {}
    for verdicts in judged:
        for axis, verdict in verdicts.items():
            kept = best_of.get(axis)
            if kept is None or _order(verdict) > _order(kept):
                best_of[axis] = verdict
    return {
        axis: best_of[axis]
        for axis in sorted(best_of, key=lambda axis: (_order(best_of[axis]), AXES.index(axis)))
    }


def judge_trial(trial: Trial, vehicle: Vehicle) -> dict[str, Verdict]:
    """Verdict per axis that recorded inputs push and whose velocity was recorded, the worst first."""
    stride = max(1, math.ceil(1.0 / (SETTINGS.rate_hz * trial.dt) - 0.01))
    seen = {c: means(y, stride) for c in SEEN if (y := trial.filled(c)) is not None and y.std() > 0.0}
    swell = waves(trial)
    verdicts = {}
    pushed = pushed_by(vehicle)
    recorded = any(name in trial.commands for name in vehicle.actuators)
    for index, axis in enumerate(AXES):
        # One signal per axis: the sum of its commands by what each pushes, or the recorded wrench.
        channel, slopes = VELOCITIES[index], pushed.get(axis, {})
        used = {name: slope for name, slope in slopes.items() if name in trial.commands}
        moving = tuple(name for name in used if np.ptp(trial.commands[name]) > 0.0)
        command = sum((used[name] * trial.commands[name] for name in moving), np.zeros(len(trial)))
        if trial.tau is not None and not recorded:
            moving, command = (WRENCH[index],), trial.tau[:, index]
        if channel not in seen or np.ptp(command) <= 1e-9 * np.abs(command).max(initial=0.0):
            continue
        follows = explained(trial, command)
        closed = follows.closed
        independent = wave_share = period = math.nan
        if swell is not None:
            period = swell.period_s
            wave_share = _share(command, trial.dt, period)
        # In a closed loop the share that commands independent of feedback drive decides.
        kind: Kind = "closed and informative" if closed else "open"
        if closed:
            independent = _told(means(command, stride), seen, channel, stride * trial.dt)
            unseen = SETTINGS.untold_share if len(trial) * trial.dt >= SETTINGS.long_s else -math.inf
            if independent < (unseen if swell is None else SETTINGS.told_share):
                kind = "feedback-dominated"
        way = axis in AXES[:3] and _under_way(seen[channel])
        verdicts[axis] = Verdict(axis, kind, moving, follows.explained, independent, wave_share, period, way)
    return {a: verdicts[a] for a in sorted(verdicts, key=lambda a: (_order(verdicts[a]), AXES.index(a)))}


def blind(verdicts: Mapping[str, Verdict], *, waves: bool = False) -> str:
    """Letters of the axes on which a replay of a trial's commands judges no model, for they answer waves: the
    true vehicle fails it where feedback dominates, where the log is informative by less than
    `replayed_share`, and where a loop passes as open for it uses what was not logged. Sway and heave that no
    command pushes ride on yaw and pitch. `waves`: whether they were found otherwise.
    """
    axes = {
        axis
        for axis, verdict in verdicts.items()
        if (waves or math.isfinite(verdict.wave_period_s))
        and (verdict.dominated or verdict.told < SETTINGS.replayed_share or verdict.answers_waves)
    }
    axes |= {axis for axis, on in (("Y", "N"), ("Z", "M")) if on in axes and axis not in verdicts}
    return "".join(axis for axis in AXES if axis in axes)


def untold(names: Iterable[str], verdicts: Mapping[str, Verdict], vehicle: Vehicle) -> dict[str, list[str]]:
    """By dominated axis: those of the named coefficients that only this axis and others like it could tell.
    Even with the true gain, damping and lift come out wrong by factors: the loop shapes the motion. Drag
    along an axis on which the vehicle keeps its way is told by the mean thrust. ``B`` in waves is not: of two
    generated logs of an ROV it was 2 N off, six of its deviations.
    """
    dominated = [axis for axis, verdict in verdicts.items() if verdict.dominated]
    actuators = {member: group for group, own in actuator_groups(vehicle).items() for member in own}
    lost: dict[str, list[str]] = {}
    heaves = "Z" in verdicts and math.isfinite(verdicts["Z"].wave_period_s)  # in waves
    for name in names if dominated else ():
        owner, dot, _ = name.partition(".")
        if dot:
            # An actuator that drives any other axis can be told there.
            drives = {
                axis
                for axis, verdict in verdicts.items()
                for actuator in verdict.commands
                if owner in (actuator, actuators[actuator])
            }
        else:
            drives = {"Z"} if name == "B" and heaves else {name[0]}
            if name in _DRAG and name[0] in verdicts and verdicts[name[0]].under_way:
                continue
        if drives and drives <= set(dominated):
            # Fins and propellers that turn the vehicle roll it, too, and roll is no reason to name them.
            axis = min(drives, key=lambda driven: (driven == "K", dominated.index(driven)))
            lost.setdefault(axis, []).append(name)
    return lost


def pushed_by(vehicle: Vehicle) -> dict[str, dict[str, float]]:
    """By axis: actuators that push it and their force or moment per unit of command, N or N m. A fin counts
    by its moment: waves and turns drive what its side force drives far more.
    """
    slopes: dict[str, dict[str, list[float]]] = {}
    facts = vehicle.actuator_info()
    for push in pushes(vehicle):
        first = 3 if facts[push.actuator]["kind"] == "fin" else 0
        wrench = np.asarray(push.wrench)
        force, moment = float(np.abs(wrench[:3]).max()), float(np.abs(wrench[3:]).max())
        for index, axis in enumerate(AXES):
            size, largest = abs(wrench[index]), force if index < 3 else moment
            if (
                index >= first
                and size > SETTINGS.main_share * largest
                and (index < 3 or size > SETTINGS.least_lever_m * force)
            ):
                slopes.setdefault(axis, {}).setdefault(push.actuator, []).append(
                    float(wrench[index]) / push.step
                )
    return {a: {name: float(np.mean(s)) for name, s in slopes[a].items()} for a in AXES if a in slopes}


def _order(verdict: Verdict) -> int:
    return ("feedback-dominated", "closed and informative", "open").index(verdict.kind)


def _under_way(velocity: Array) -> bool:
    """Whether the vehicle moves one way all along."""
    middle = float(np.median(velocity))
    return abs(middle) > SETTINGS.way_deviations * 1.4826 * float(np.median(np.abs(velocity - middle)))


def _share(command: Array, dt: float, period_s: float) -> float:
    """Share of a command's variance at wave frequencies."""
    from scipy.signal import welch

    f, power = welch(command, 1.0 / dt, nperseg=min(len(command), round(100.0 / dt)), detrend="linear")
    inside = (f > 1.0 / (period_s * SETTINGS.wave_band)) & (f < SETTINGS.wave_band / period_s)
    return float(power[inside].sum() / power[1:].sum())


def _told(command: Array, seen: dict[str, Array], channel: str, dt: float) -> float:
    """Share of a velocity's variance that the exogenous part of its command drives."""
    usable = np.arange(len(command)) >= SETTINGS.settled_samples
    if usable.sum() < 2 * SETTINGS.settled_samples:
        return math.nan
    velocity = seen[channel]
    change = np.diff(command, prepend=command[0])
    past = [earlier(change, range(1, SETTINGS.own_lags))]
    past += [earlier(np.diff(m, prepend=m[0]), range(SETTINGS.seen_lags)) for m in seen.values()]
    regressors = np.hstack(past)
    limit = SETTINGS.outlier * 1.4826 * float(np.median(np.abs(change)))
    if limit > 0.0:
        tall = SETTINGS.tall * regressors.std(axis=0)
        clipped = np.clip(change, -limit, limit)
        # The part that was clipped is a step of a set point: exogenous as a whole.
        exogenous = prediction_errors(np.clip(regressors, -tall, tall), clipped, usable) + change - clipped
    else:
        exogenous = prediction_errors(regressors, change, usable)
    coarse = np.convolve(exogenous, np.ones(SETTINGS.coarse_lags) / SETTINGS.coarse_lags)[: len(exogenous)]
    late = range(SETTINGS.fine_lags, round(SETTINGS.answer_s / dt), SETTINGS.coarse_lags)
    answer = np.hstack([earlier(exogenous, range(SETTINGS.fine_lags)), earlier(coarse, late)])
    error = prediction_errors(answer, velocity, usable)
    whole = float(np.var(velocity[usable]))
    return 1.0 - float(np.var(error[usable])) / whole if whole > 0.0 else math.nan
