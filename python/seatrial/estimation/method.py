"""Which criterion a joint estimate takes, and what its recordings say against it.

Output error takes all that a simulation misses for noise of the sensors. That holds for open loops, where
waves only widen the intervals. In a closed loop the commands answer the waves, the error is correlated with
the input, and gains are bent (Ljung 1999, section 13.4). In calm water the autopilot answers the noise of its
sensors and what the model lacks. Predictions of a filter are compared then, or recommended where the
campaign asks for output error. So they are where the vehicle runs away while its controls are held: a
simulation then diverges from the log for any coefficients.

Tests: ``tests/estimation/test_method.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from seatrial.inspect.feedback import runs_away
from seatrial.inspect.verdict import REPLAYED, Verdict, best
from seatrial.inspect.waves import waves
from seatrial.problem.problem import Problem
from seatrial.problem.settings import JointSettings

Method = Literal["output", "innovations"]


@dataclass(frozen=True)
class ByItself:
    """A method and why: ``why`` follows "because"; it is empty where nothing speaks against output error."""

    method: Method
    why: str


def method_of(problem: Problem, trials: Sequence[str]) -> ByItself:
    """Method of the joint estimate of some trials: what the campaign asks for, or what they call for.

    Parameters
    ----------
    problem : Problem
    trials : sequence of str
        Names of the trials that are estimated jointly.
    """
    asked = problem.joint
    if asked is None:  # standard deviations only
        return ByItself("output", "")
    if asked.method == "innovations":
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
        verdict for verdict in verdicts.values() if verdict.kind != "open" and not verdict.told >= REPLAYED
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
