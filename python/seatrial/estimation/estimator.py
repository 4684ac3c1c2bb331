"""Ways to compare a joint estimate with the log: which one, what each has to give, and the noise model.

Output error takes all that a simulation misses for noise of the sensors. That holds for open loops. In a
closed loop the commands answer the waves, and in calm water the noise of the sensors and what the model
lacks: the error is correlated with the input, and gains are bent (Ljung 1999, section 13.4). Predictions of a
filter are compared then, or recommended where the campaign asks for output error; so they are where the
vehicle runs away while its controls are held, for a simulation diverges from the log for any coefficients.

Tests: ``tests/estimation/test_method.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.plain import Plain
from seatrial.base.work import Step
from seatrial.inspect.feedback import runs_away
from seatrial.inspect.verdict import SETTINGS as VERDICT_SETTINGS
from seatrial.inspect.verdict import Verdict, best
from seatrial.inspect.waves import waves
from seatrial.problem.problem import Problem
from seatrial.problem.settings import JointSettings, Method
from seatrial.statistics.linearisation import Linearisation


@dataclass(frozen=True)
class Comparison:
    """What a way of comparing with the log can do.

    ``simulates``: segments are simulated freely and independently, so that a part of them leads the way, a
    trial may have a force of its own, and held-out data are predicted by a replay of their commands.
    ``models_noise``: the noises are estimated along, so that it takes long records, has a likelihood and
    states of a filter, and tells in part what feedback hides. ``estimator``: module and class that compare
    so, an `Estimator`.
    """

    method: Method
    simulates: bool
    models_noise: bool
    estimator: str


COMPARISONS: dict[Method, Comparison] = {
    "output": Comparison(
        "output",
        simulates=True,
        models_noise=False,
        estimator="seatrial.estimation.joint_estimate:OutputError",
    ),
    "innovations": Comparison(
        "innovations",
        simulates=False,
        models_noise=True,
        estimator="seatrial.estimation.joint_estimate:PredictionError",
    ),
}
"""By its name in a campaign; another way is its own file, a row here and a name in `Method`."""


@dataclass(frozen=True)
class ByItself:
    """A method and why: ``why`` follows "because"; it is empty where nothing speaks against output error."""

    method: Method
    why: str

    @property
    def comparison(self) -> Comparison:
        """What it can do."""
        return COMPARISONS[self.method]


def method_of(problem: Problem, trials: Sequence[str]) -> ByItself:
    """Method of the joint estimate of some trials: what the campaign asks for, or what they call for.

    ``trials``: names of the trials that are estimated jointly.
    """
    asked = problem.joint
    if asked is None:  # standard deviations only
        return ByItself("output", "")
    if asked.method != "automatic" and asked.method != "output":
        return ByItself(asked.method, "the campaign asks for it")
    if fled := _runs_away(problem, asked, trials):
        if asked.method == "automatic" and not asked.nuisances:
            return ByItself("innovations", fled)
        return ByItself("output", f"{fled}, so that a simulation diverges from the log: {_remedy(asked)}")
    if seen := _answered_waves(problem, trials) or _answered(problem, trials):
        if asked.method == "automatic" and not asked.nuisances:
            return ByItself("innovations", seen)
        return ByItself("output", f"{seen}, which biases gains: {_remedy(asked)}")
    return ByItself("output", "")


def _answered_waves(problem: Problem, trials: Sequence[str]) -> str:
    """Which commands answer measurements in a trial with waves; "" where none do."""
    for name in _commanded(problem, trials):
        closed = [verdict for verdict in problem.verdicts(name).values() if verdict.kind != "open"]
        swell = waves(problem.trials[name]) if closed else None
        if swell is not None:
            return f"in trial {name} feedback drives {_commands(closed)}, in waves of {swell.period_s:.1f} s"
    return ""


def _answered(problem: Problem, trials: Sequence[str]) -> str:
    """Which commands answer measurements in every trial that has them, too much for a replay; "" for none.

    One trial that a replay judges is enough for output error, as it is for the verdict on an axis.
    """
    chosen = _commanded(problem, trials)
    if len(chosen) < len(trials):
        return ""
    verdicts = best(problem.verdicts(name) for name in chosen)
    closed = [
        verdict
        for verdict in verdicts.values()
        if verdict.kind != "open" and not verdict.told >= VERDICT_SETTINGS.replayed_share
    ]
    if not closed:
        return ""
    lowest = min(verdict.told for verdict in closed)
    percent = 100.0 * max(lowest, 0.0)
    share = f", and commands independent of feedback drive only {percent:.0f} % of an axis' motion"
    return f"feedback drives {_commands(closed)} in every trial{share if lowest == lowest else ''}"


def _commanded(problem: Problem, trials: Sequence[str]) -> list[str]:
    """Trials that commands drive: a measured force is none."""
    return [name for name in trials if problem.input_of(name) == "commands"]


def _commands(closed: Sequence[Verdict]) -> str:
    return ", ".join(dict.fromkeys(command for verdict in closed for command in verdict.commands))


def _runs_away(problem: Problem, asked: JointSettings, trials: Sequence[str]) -> str:
    """Why a simulation of the campaign's vehicle leaves these trials; "" where it does not."""
    stages = {letter for stage in problem.stages for letter in stage.axes.free}
    free = asked.axes.free if asked.axes is not None else "".join(stages)
    return runs_away(problem.vehicle, [problem.trials[name] for name in trials], free, asked.segment_s)


def _remedy(asked: JointSettings) -> str:
    """How to compare with a filter that knows waves."""
    if asked.nuisances:
        return (
            f'to compare with method = "innovations", which cannot estimate {", ".join(asked.nuisances)},'
            " correct the log by [corrections] and [clocks] and delete the nuisances"
        )
    return 'compare with method = "innovations"'


@dataclass(frozen=True)
class FilterLayout:
    """Where what stands in the state of a filter.

    First the ``states`` of the model, of which the first are ``velocities``; then a slow acceleration per
    velocity; then displacement and rate of a shaping filter per axis that waves push (``waved``) and per
    direction in which they carry the water (``water``); last the slow velocity of the water, north and east.
    """

    states: int
    velocities: int
    waved: int
    water: int

    @property
    def width(self) -> int:
        """States of the filter."""
        return self.states + self.velocities + 2 * (self.waved + self.water + 1)

    @property
    def speeds(self) -> slice:
        """The model's velocities."""
        return slice(0, self.velocities)

    @property
    def poses(self) -> slice:
        """The model's angles and places."""
        return slice(self.velocities, self.states)

    @property
    def slow(self) -> slice:
        """Slow accelerations."""
        return slice(self.states, self.states + self.velocities)

    @property
    def waves(self) -> slice:
        """Shaping filters."""
        return slice(self.slow.stop, self.slow.stop + 2 * (self.waved + self.water))

    @property
    def pushes(self) -> range:
        """Displacement of the shaping filter of each axis that waves push; its rate follows."""
        return range(self.waves.start, self.waves.start + 2 * self.waved, 2)

    @property
    def orbits(self) -> range:
        """Displacement of the shaping filter of each direction of the water in waves; its rate follows."""
        return range(self.pushes.stop, self.waves.stop, 2)

    @property
    def orbit_rates(self) -> slice:
        """Rates of the shaping filters of the water."""
        return slice(self.orbits.start + 1, self.orbits.stop, 2)

    @property
    def current(self) -> slice:
        """Slow velocity of the water, north and east."""
        return slice(self.waves.stop, self.waves.stop + 2)


@dataclass(frozen=True)
class NoiseModel:
    """Intensities of the noises.

    ``process`` (N,) variance per sample of what drives each state, ``sensors`` (Y,) variance of each measured
    channel, ``wave_hz`` the frequency of the waves, ``waved`` the axes (places among the velocities) that
    they push and ``water`` the directions (0 north, 1 east, 2 down) in which they carry the water.
    ``damping`` is the damping ratio of their shaping filters: the broader the spectrum, the larger.
    ``toward`` is where the waves go, rad from north over east: a vehicle meets them at another frequency on
    every course then, and ``wave_hz`` is that of a point adrift. Without it they are met at ``wave_hz``.
    ``carried`` says whether the water of the waves carries the vehicle along, or flows past it.
    """

    process: Array
    sensors: Array
    wave_hz: float | None
    waved: tuple[int, ...]
    water: tuple[int, ...]
    damping: float
    toward: float | None = None
    carried: bool = True

    def layout(self, states: int) -> FilterLayout:
        """Places of the filter's states, beside so many of the model."""
        waved, water = len(self.waved), len(self.water)
        return FilterLayout(states, len(self.process) - states - 2 * (waved + water) - 2, waved, water)

    def shaped(self, wave_hz: float, damping: float) -> NoiseModel:
        """The same waves with another frequency and damping ratio, their rates' variances as they were."""
        assert self.wave_hz is not None
        process = self.process.copy()
        # Where the waves stand does not depend on how many of the states before are the model's.
        process[self.layout(0).waves] *= damping * wave_hz / (self.damping * self.wave_hz)
        return replace(self, process=process, wave_hz=wave_hz, damping=damping)

    def waves(self) -> dict[str, float | bool | None] | None:
        """Period, s, where they go, degrees from north over east, damping ratio and whether they carry.

        None without waves.
        """
        if self.wave_hz is None:
            return None
        toward_deg = None if self.toward is None else math.degrees(self.toward) % 360.0
        return {
            "period_s": 1.0 / self.wave_hz,
            "toward_deg": toward_deg,
            "damping_ratio": self.damping,
            "carried": self.carried if self.water else None,
        }


@dataclass(frozen=True)
class Horizon:
    """Estimates (m,) from predictions ``ahead_s`` ahead, and how far from those of the fit.

    ``away`` (m,) is the difference in its own standard deviations; ``refused`` names the coefficients that
    are not identified because of it.
    """

    ahead_s: float
    values: Array
    away: Array
    refused: tuple[str, ...]

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """The same by the unknowns' names."""
        return {
            "ahead_s": self.ahead_s,
            "values": dict(zip(names, self.values.tolist(), strict=True)),
            "away": dict(zip(names, self.away.tolist(), strict=True)),
            "refused": list(self.refused),
        }


@dataclass(frozen=True)
class OtherDamping(Plain, only="strips damping own values away refused"):
    """Estimates with another model of the damping, which the log cannot tell from that of the fit.

    ``strips`` names the drag coefficient that stands against quadratic damping, which ``replaced`` names;
    ``by_strips`` says whether this model, and not that of the fit, is the one with strips. ``values`` and
    ``away`` are those of the coefficients that both have; ``refused`` names those that are not identified
    because of it.
    """

    strips: str
    replaced: tuple[str, ...]
    by_strips: bool
    values: Mapping[str, float]
    away: Mapping[str, float]
    refused: tuple[str, ...]

    @property
    def damping(self) -> str:
        """Name of the other model."""
        return damping_model(self.strips, self.replaced, by_strips=self.by_strips)

    @property
    def own(self) -> str:
        """Name of that of the fit."""
        return damping_model(self.strips, self.replaced, by_strips=not self.by_strips)

    @property
    def short(self) -> str:
        """Coefficients of the other model."""
        return self.strips if self.by_strips else " and ".join(self.replaced)


def damping_model(strips: str, replaced: Sequence[str], *, by_strips: bool) -> str:
    """Name of a model of the damping, with its coefficients."""
    return (
        f"cross-flow drag by strips ({strips})"
        if by_strips
        else f"quadratic damping ({' and '.join(replaced)})"
    )


@dataclass(frozen=True)
class LogAlone:
    """Estimates (m,) free of what commands answer beyond the log, and how far from those of the fit.

    ``commands`` names the actuators whose commands do, ``sure`` by how many of its deviations chi squared of
    the prediction errors on the innovations of each says so. ``away`` and ``refused`` as of a `Horizon`.
    """

    commands: tuple[str, ...]
    sure: tuple[float, ...]
    values: Array
    away: Array
    refused: tuple[str, ...]

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """The same by the names of actuators and unknowns."""
        return {
            "commands": dict(zip(self.commands, self.sure, strict=True)),
            "values": dict(zip(names, self.values.tolist(), strict=True)),
            "away": dict(zip(names, self.away.tolist(), strict=True)),
            "refused": list(self.refused),
        }


@dataclass(frozen=True)
class Polished:
    """What the joint estimate found.

    ``values`` (m,) of the unknowns, ``initial`` (segments, 12) initial conditions, ``noise`` (C,) standard
    deviation of each channel's residual, ``cost`` half the robust sum of squares and priors in these units
    over the ``samples`` that count in all channels. ``start_cost`` is that of the start in the same noise, or
    by how much its negative log-likelihood lies above where that is more: it never lies below ``cost``.
    ``spread`` (starts, m) is where the starts ended, ``costs`` (starts,) the negative log-likelihood there.
    ``method_reason`` says why the method is what it is, "" where nothing speaks against output error.
    With the method "innovations" ``horizons`` are what predictions over other horizons say, once they were
    made (`Estimator.otherwise`), ``log_alone`` what the log says without commands that answer more than it
    holds, where there are such, ``others`` what other models of the damping say that are as likely, and
    ``waves`` the waves of its noise model (`NoiseModel.waves`). ``stopped`` says why a round had no result,
    mostly "": the values are then those of the round before.
    """

    values: Array
    initial: Array
    noise: Array
    cost: float
    start_cost: float
    samples: int
    rounds: int
    evaluations: int
    converged: bool
    interrupted: bool
    wall_s: float
    spread: Array
    costs: Array
    method: Method = "output"
    method_reason: str = ""
    horizons: tuple[Horizon, ...] = ()
    log_alone: LogAlone | None = None
    others: tuple[OtherDamping, ...] = ()
    waves: Mapping[str, float | bool | None] | None = None
    stopped: str = ""

    def rms(self, cost: float) -> float:
        """Root mean square residual in its standard deviation, outliers bounded, that a cost stands for."""
        return float(np.sqrt(2.0 * cost / max(self.samples, 1)))

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """The polish as plain numbers, values by the unknowns' names."""
        costs = ("cost", "start_cost", "samples")
        kept = (*costs, "rounds", "evaluations", "converged", "interrupted", "wall_s")
        return {key: getattr(self, key) for key in kept} | {
            "method": self.method,
            "method_reason": self.method_reason,
            "stopped": self.stopped,
            "horizons": [horizon.to_dict(names) for horizon in self.horizons],
            "log_alone": None if self.log_alone is None else self.log_alone.to_dict(names),
            "others": [other.to_dict() for other in self.others],
            "waves": None if self.waves is None else dict(self.waves),
            "values": dict(zip(names, self.values.tolist(), strict=True)),
            "noise": self.noise.tolist(),
            "starts": [
                {"cost": cost, "values": dict(zip(names, row, strict=True))}
                for cost, row in zip(self.costs.tolist(), self.spread.tolist(), strict=True)
            ],
        }


class Estimator(Protocol):
    """A joint estimate that is compared with the log in one way.

    `seatrial.estimation.joint_estimate` chooses it by the name of its `Comparison`. A further one is a class
    in a file of its own, its `Comparison` here, and its name there.
    """

    def estimate(
        self, start: Array | None, *, rounds: int, near: bool, watch: Callable[[Step], None] | None
    ) -> Polished:
        """The estimate that a start (m,) leads to (`seatrial.estimation.joint_estimate.polish`)."""

    def linearised(
        self, values: Array, *, initial: Array | None, noise: Array | None, extra: Sequence[str]
    ) -> Linearisation:
        """Residuals and derivatives at a point; as `seatrial.estimation.joint_estimate.linearise`."""

    def otherwise(self, polished: Polished) -> Polished:
        """The estimate with what it would be under other assumptions of its method."""

    def diverges(self, polished: Polished) -> bool:
        """Whether the model leaves the log on every segment."""
