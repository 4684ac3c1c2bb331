"""Leave one out: the campaign identified again without each of its trials, and judged on that trial.

A hold-out by time is of the same day, current, battery and manoeuvre as the rest of its trial. A whole trial
that was left out is closer to what the vehicle does next (cross-validation by groups; Stone, *J. R. Stat.
Soc. B* 36 (1974) 111). Per trial of the stages:

1. the stages are searched anew without it, then estimated jointly, and the better of the two is taken as
   always (`seatrial.identification.choice`); a stage that has no other trial is left to the joint estimate;
2. the vehicle and the baselines, which did not see the trial either, predict it ten seconds ahead, on the
   axes that the campaign frees on it.

How a coefficient scatters over the k fits gives its jackknife deviation, ``sqrt((k - 1) / k sum (x_i -
mean)^2)`` (Efron and Tibshirani, *An Introduction to the Bootstrap*, 1993, section 11.2): it holds what
differs from trial to trial, which the deviations of one fit do not know.

Tests: ``tests/identification/test_leave_one_out.py``.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import checked_threads
from seatrial.base.channels import VELOCITIES
from seatrial.base.errors import CampaignError, SeatrialError
from seatrial.base.files import parquet
from seatrial.base.plain import Plain
from seatrial.base.report import Report, report_of
from seatrial.base.run import RunDirectory, RunResult, run_facts, to_json, version
from seatrial.base.work import Clock, Progress, Work, callers_errors_pass, part_of
from seatrial.estimation.stage import StageOrder, plan
from seatrial.identification.hold_out import left_out_score
from seatrial.identification.identify import Conclusion, joint_estimate_of, jointly, staged
from seatrial.identification.preparation import identifiable
from seatrial.problem.problem import stated

if TYPE_CHECKING:
    from seatrial.problem.problem import Asks, Problem


@dataclass(frozen=True)
class LeaveOneOutSettings:
    """When fits without a trial contradict the standard deviations."""

    #: Ratio of deviations below which that of the fit is not that of the trials.
    shared_ratio: float = 0.1
    #: Jackknife deviation over the standard deviation of the fit from which the trials contradict one
    #: another.
    scatter_ratio: float = 3.0


LEAVE_ONE_OUT_SETTINGS = LeaveOneOutSettings()


@dataclass(frozen=True)
class LeftOut:
    """One trial judged by a vehicle that was identified without it."""

    #: Its name.
    trial: str
    #: R2 ten seconds ahead by velocity channel, and by baseline and channel.
    r2: Mapping[str, float]
    baselines: Mapping[str, Mapping[str, float]]
    #: Estimates by name, SI, of what the fit without it found.
    coefficients: Mapping[str, float]
    #: "joint estimate" or "stages".
    result: str
    #: Stages that have no other trial: what they free was left to the joint estimate.
    lost: tuple[str, ...] = ()
    #: Why it could not be identified or judged without this trial; empty otherwise.
    failed: str = ""

    def best_baseline(self, channel: str) -> tuple[str, float] | None:
        """Name and R2 of the best baseline in a channel; None where none is judged."""
        rivals = {name: row[channel] for name, row in self.baselines.items() if channel in row}
        best = max(rivals, key=rivals.__getitem__, default=None)
        return None if best is None else (best, rivals[best])


@dataclass(frozen=True, eq=False, repr=False)
class LeaveOneOut(RunResult, Plain, only="campaign interrupted left_out coefficients"):
    """Every trial predicted by a fit that did not see it; printed, a table of R2 and one of coefficients.

    Attributes
    ----------
    campaign
        Its name.
    left_out
        A `LeftOut` per trial that was finished.
    sigma
        Standard deviations of the fit to all trials by coefficient, SI, as far as they are known.
    units
        Unit by coefficient.
    interrupted, text, facts
        Whether Ctrl-C ended the run early, the campaign file, and what the result rests on.
    """

    campaign: str
    left_out: tuple[LeftOut, ...]
    sigma: Mapping[str, float]
    units: Mapping[str, str]
    interrupted: bool
    text: str
    facts: Mapping[str, Any]

    @property
    def r2(self) -> dict[str, dict[str, float]]:
        """R2 ten seconds ahead by left-out trial and velocity channel."""
        return {trial.trial: dict(trial.r2) for trial in self.left_out if not trial.failed}

    def coefficients(self) -> Iterator[dict[str, Any]]:
        """A row per coefficient: least and most over the fits, jackknife deviation, deviation of the fit.

        The jackknife deviation is NaN where the fit without the trial ``only_from`` could not estimate it.
        """
        fits = {trial.trial: trial.coefficients for trial in self.left_out if not trial.failed}
        for name in dict.fromkeys(name for fit in fits.values() for name in fit):
            values = np.array([fit[name] for fit in fits.values() if name in fit])
            missing = [trial for trial, fit in fits.items() if name not in fit]
            k = len(values)
            jackknife = math.sqrt((k - 1) / k * float(np.sum((values - values.mean()) ** 2)))
            jackknife = math.nan if missing or k < 2 else jackknife
            sigma = self.sigma.get(name, math.nan)
            known = [trial for trial, fit in fits.items() if name in fit]
            far = known[int(np.argmax(np.abs(values - np.median(values))))]
            yield {
                "coefficient": name,
                "unit": self.units.get(name, ""),
                "fits": k,
                "only_from": ", ".join(missing),
                "farthest_without": far,
                "least": float(values.min()),
                "most": float(values.max()),
                "mean": float(values.mean()),
                "jackknife": jackknife,
                "sigma": sigma,
                "ratio": jackknife / sigma if 0.0 < sigma < math.inf else math.nan,
            }

    def report(self) -> Report:
        """How well left-out trials are predicted, the worst one, what to do; then both tables."""
        return report_of(self)

    def files(self) -> dict[str, str | bytes]:
        """Files of the run directory by name, see `save`."""
        import polars as pl

        rows = [
            {"trial": trial.trial, "channel": c, "r2": value}
            | {f"r2 {name}": row.get(c) for name, row in trial.baselines.items()}
            for trial in self.left_out
            for c, value in trial.r2.items()
        ]
        return {
            "leave_one_out.json": to_json(self.to_dict()),
            "scores.parquet": parquet(pl.DataFrame(rows, infer_schema_length=None)),
            "coefficients.parquet": parquet(
                pl.DataFrame(list(self.coefficients()), infer_schema_length=None)
            ),
            **self.report().files(),
            "campaign.toml": self.text,
        }


@callers_errors_pass
def leave_one_out(
    asked: Problem | Asks,
    *,
    sigma: Mapping[str, float] | None = None,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
) -> LeaveOneOut:
    """Every trial of the stages predicted by a vehicle identified without it, and how coefficients scatter.

    Parameters
    ----------
    asked : Problem or Campaign
        With at least two trials in its stages.
    sigma : mapping, optional
        Standard deviation of coefficients by name, SI, as `Identification.sigma` gives them.
    run_dir : str or Path, optional
        Folder for the results. Finished trials and stages are kept beside it while the run goes on.
    progress : callable, optional
        Called in the caller's thread with a `Progress` of the whole.
    resume : bool
        Reuse what an earlier run in this folder finished from the same inputs.
    threads : int, optional
        Threads of the core; the result does not depend on it.

    Returns
    -------
    LeaveOneOut
        After Ctrl-C: the trials that were finished, marked as interrupted.

    Raises
    ------
    CampaignError, TrialError
        Fewer than two trials, or the campaign asks for what cannot be done.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.identification.leave_one_out import leave_one_out
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> print(leave_one_out(campaign))  # doctest: +SKIP
    """
    checked_threads(threads)
    problem = stated(asked)
    names = problem.fitted
    if len(names) < 2:
        raise CampaignError(
            f"{problem.source}: leave one out: expected two trials or more in the stages, found"
            f" {len(names)}: nothing would be left to identify from; hold out a part of the trial"
            " (hold_out_s)"
        )
    plan(problem)  # refuses a bad campaign before a folder appears
    clock = Clock()
    finished: list[LeftOut] = []
    interrupted = False
    hashes = problem.input_hashes()
    with RunDirectory(run_dir, "leave one out", resume=resume) as run:
        try:
            for number, name in enumerate(names):
                part = f"without {name} ({number + 1} of {len(names)})"
                show = None if progress is None else part_of(progress, part, number, len(names), clock)
                inputs = _inputs(problem, name, hashes)
                kept = run.finished(f"without {name}", inputs)
                if kept is not None:
                    kept = {key: value for key, value in kept.items() if key != "inputs"}
                    finished.append(LeftOut(**kept | {"lost": tuple(kept["lost"])}))
                    continue
                finished.append(_without(problem, name, run, show, threads))
                run.keep(f"without {name}", inputs, asdict(finished[-1]))
        except KeyboardInterrupt:
            interrupted = True
        info = problem.vehicle.coefficient_info()
        result = LeaveOneOut(
            problem.name,
            tuple(finished),
            dict(sigma or {}),
            {key: str(info[key]["unit"]) for trial in finished for key in trial.coefficients},
            interrupted,
            problem.text,
            run_facts(
                "leave one out",
                problem.name,
                clock=clock,
                inputs=hashes,
                seed=problem.seed,
                interrupted=interrupted,
            ),
        )
        if run_dir is not None and finished and not interrupted:
            run.publish(result.facts, result.files())
    return result


def _without(
    problem: Problem,
    name: str,
    run: RunDirectory,
    progress: Callable[[Progress], None] | None,
    threads: int | None,
) -> LeftOut:
    """One trial left out of the stages and of the joint estimate, and predicted.

    Raises KeyboardInterrupt: the search was interrupted.
    """
    lost: tuple[str, ...] = ()
    try:
        whole, lost = problem.without_trial(name)
        rest, held = identifiable(whole)
        work = Work(threads=threads, progress=progress)
        order = StageOrder(rest, plan(rest), run, work, part=f"without {name}, ")
        stages = order.stages()
        if order.stop.is_set():
            raise KeyboardInterrupt
        fallbacks = order.fallbacks
        result = Conclusion(rest, staged(rest, stages, fallbacks))
        if fallbacks.findings:  # a stage has no result without the trial
            return LeftOut(name, {}, {}, {}, "", lost, fallbacks.findings[0].sentence)
        vehicle, freed = result.vehicle, {name for stage in stages for name in stage.coefficients}
        if rest.joint is not None and rest.joint.rounds:
            joint = joint_estimate_of(rest, whole, held, vehicle, threads=threads)
            # Of a trial that is left out the stages are nearly all that its progress counts.
            watch = (
                None
                if progress is None
                else lambda step: progress(replace(order.joint_state(step), fraction=1.0))
            )
            result, joint, polished = jointly(result, joint, stages, fallbacks, watch=watch, threads=threads)
            if result.interrupted:
                raise KeyboardInterrupt
            if polished is not None:
                vehicle = joint.identified(polished.values)
                freed |= {member for parameter in joint.estimated for member, _ in parameter.members}
        score = left_out_score(problem, rest, vehicle, name, result.nuisances)
    except SeatrialError as error:
        return LeftOut(name, {}, {}, {}, "", lost, str(error))
    # What kept its start value, for want of a trial, is no estimate.
    values = vehicle.coefficients()
    return LeftOut(
        name,
        {c: value for c, value in score.evidence.items() if c in VELOCITIES},
        score.baselines,
        {key: values[key] for key in values if key in freed},
        "stages" if result.choice is None else result.choice.result,
        lost,
    )


def _inputs(problem: Problem, name: str, hashes: Mapping[str, str]) -> str:
    """SHA-256 of everything that the fit without a trial depends on."""
    described = {
        "version": version("seatrial"),
        "problem": problem.described(),
        "vehicle": problem.vehicle.to_toml(),
        "hashes": dict(hashes),
        "left_out": name,
    }
    digest = hashlib.sha256(to_json(described).encode())
    for trial in problem.trials.values():  # a trial that was given has no file to hash
        for values in (trial.t, trial.observed, trial.valid, *trial.commands.values()):
            digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
