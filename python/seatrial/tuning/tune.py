"""`tune`: from a vehicle as well as it is known to an autopilot whose responses stay in their corridors.

Margins first, then group after group by evolution strategy and simplex on the full non-linear closed loop
with limits, dead band, dead time, sensor noise, currents and drawn vehicles; at last everything is assessed
again on samples that the search never saw, beside the start gains
(`seatrial.tuning.tuning_run`). What cannot be tuned is refused before the search.

Source: Taubert et al. (2014), section "Constraint Criteria Optimization". Held by tests/tuning/test_tune.py.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from seatrial._core import Autopilot, checked_threads
from seatrial.base.errors import CampaignError, SeatrialError
from seatrial.base.fleet import fleet_of
from seatrial.base.progress import callers_errors_pass
from seatrial.base.run import RunDirectory
from seatrial.base.work import HERE, Work, takes
from seatrial.identification.fitted import Fitted
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.result import Tuning
from seatrial.tuning.tuning_run import TuningRun

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.identification.identification import Identification


@overload
def tune(problem: ControlProblem, *, work: Work = HERE) -> Tuning: ...


@overload
def tune(
    fit: Identification | Fitted | Vehicle | str | Path,
    autopilot: Autopilot | str | Path,
    /,
    *,
    loops: Mapping[str, Mapping[str, Any]] | None = None,
    settings: Mapping[str, Any] | None = None,
    name: str | None = None,
    seed: int = 0,
    work: Work = HERE,
) -> Tuning: ...


@takes(work=Work)
@callers_errors_pass
def tune(
    problem: ControlProblem | Identification | Fitted | Vehicle | str | Path,
    autopilot: Autopilot | str | Path | None = None,
    *,
    work: Work = HERE,
    **asked: Any,
) -> Tuning:
    """Tuning: an autopilot with tuned gains, how its responses keep to their corridors, and its margins.

    ``tune(fit, autopilot, loops=...)`` tunes a `ControlProblem` of these; ``Campaign.load(file).tune(fit)``
    the one that a campaign file states.

    Parameters
    ----------
    problem : ControlProblem; or Identification, run directory, Vehicle, built-in name or file
        What is asked; or what is known of the vehicle.
    autopilot : Autopilot, built-in name or file
        Beside a vehicle: with the start gains.
    loops, name, seed
        Beside a vehicle: as of `ControlProblem`.
    settings : mapping, optional
        Beside a vehicle: its other keys, for example samples, sensors, margins, budget.
    work : Work, optional
        Threads, executor, run directory and progress. Finished groups are kept in the run directory; an
        executor flies the candidates of the searches.

    Returns
    -------
    Tuning
        ``interrupted`` after Ctrl-C, with the best gains so far.

    Raises
    ------
    CampaignError
        The campaign or its tables ask for what the vehicle or the autopilot cannot do.
    VehicleError, TrialError
        A file is not usable.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> tuning = campaign.tune(campaign.identify())  # doctest: +SKIP
    >>> tuning.autopilot.gains()["surge.K_P.4"]  # doctest: +SKIP

    Without a file, and with a search that is much too short:

    >>> corridor = {"rise_s": 5.0, "overshoot": 0.3, "settling_s": 10.0, "settled": 0.1}
    >>> tuning = st.tune(
    ...     "remus100",
    ...     "remus100",
    ...     loops={"heading": {"steps": [20.0], "speeds_m_s": [2.0], "corridor": corridor}},
    ...     settings={
    ...         "samples": 0,
    ...         "settle_s": 6.0,
    ...         "budget": {"population": 8, "generations": 1, "simplex_rounds": 1},
    ...     },
    ... )
    >>> [group.name for group in tuning.groups[:2]]
    ['margins', 'heading']
    """
    if "relay" in asked:
        raise CampaignError(
            "tune: relay: relay tuning is not offered, as the search by corridors was better on every loop"
            " that was measured; leave it out, and take start gains from seatrial.start_autopilot"
        )
    checked_threads(work.threads)
    if not isinstance(problem, ControlProblem):
        if callable(getattr(problem, "control_problem", None)):
            raise CampaignError("tune: found a campaign; use campaign.tune(fit, work=st.Work(...))")
        if autopilot is None:
            raise CampaignError(
                "tune: expected a ControlProblem, or a vehicle and its autopilot, found a vehicle alone; give"
                " an Autopilot, a built-in name or a file as second argument"
            )
        problem = ControlProblem(problem, autopilot, **asked.pop("settings", None) or {}, **asked)
    elif autopilot is not None or asked:
        given = "autopilot" if autopilot is not None else next(iter(asked))
        raise CampaignError(f"tune: {given}: the problem says that; give it only beside a vehicle")
    assert problem.groups is not None  # what cannot be tuned is refused before a directory is made
    with RunDirectory(work.run_dir, "tuning", resume=work.resume) as run, fleet_of(work.executor) as fleet:
        tuning = TuningRun(problem, run, progress=work.progress, threads=work.threads, fleet=fleet).run()
        if tuning.interrupted and tuning.groups:
            with contextlib.suppress(SeatrialError):  # the gains are in what is returned all the same
                # The best gains so far are an autopilot file beside the finished groups.
                tuning = replace(tuning, kept=run.leave("autopilot.toml", tuning.autopilot.to_toml()))
        elif work.run_dir is not None and not tuning.interrupted:
            run.publish(tuning.facts, tuning.files())
    return tuning
