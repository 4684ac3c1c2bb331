"""A log of a campaign: where it stands, what was flown, and what the model leaves on the campaign's trials.

A log is the run directory of `seatrial fly`, whose autopilot and mission lie beside it; a trial of the
campaign, of which the part is judged that was held out of the fit; or a recording, read with the campaign's
column map.

How far a valid model misses a log is told by the campaign's own recordings: what the fitted vehicle leaves
there, restarted as often. For a trial of the campaign that is the rest of the same trial, which is motion
of the same kind, or all trials where the rest is short; for another log all trials.

Tests: ``tests/test_recorded_campaign.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.errors import CampaignError, TrialError, nearest
from seatrial.fitted import Fitted
from seatrial.prediction import default_input
from seatrial.recorded.judge_log import verify_log
from seatrial.recorded.mission_log import MissionLog
from seatrial.recorded.restarts import Restarts, restarts
from seatrial.recorded.spread import Spread, spread_of_reference
from seatrial.recorded.validity import FEWEST_WINDOWS

if TYPE_CHECKING:
    from seatrial._core import Autopilot
    from seatrial.campaign import Campaign
    from seatrial.mission import Mission
    from seatrial.recorded.log_verdict import LogVerdict
    from seatrial.trial import Input
    from seatrial.tuning.corridor import Corridor

__all__ = ["CampaignLog", "campaign_log", "campaign_reference", "verify_campaign_log"]

_LOGGED_LOOPS = ("surge", "sway", "heave", "pitch", "heading", "depth")


@dataclass(frozen=True, eq=False)
class CampaignLog:
    """A log, and what is known of it.

    Attributes
    ----------
    log
        What was recorded.
    trial
        Its name where it is a trial of the campaign, else empty.
    span
        First and last moment that is judged, s; None all of it.
    input
        What drives the model there.
    autopilot, mission
        Files of what was flown, where they lie beside the log.
    """

    log: MissionLog
    trial: str
    span: tuple[float, float] | None
    input: Input
    autopilot: Path | None = None
    mission: Path | None = None


def campaign_log(campaign: Campaign, source: str | Path) -> CampaignLog:
    """A log by its file, its folder or its name in a campaign.

    Parameters
    ----------
    campaign : Campaign
    source : str or Path
        Run directory of `seatrial fly`, recording, or name of a trial of the campaign.

    Raises
    ------
    TrialError
        There is no such log, or it cannot be read.
    CampaignError
        A recording of the campaign is missing.
    """
    path, name = Path(source), str(source)
    if path.is_dir():
        log = MissionLog.read(path)
        beside = [path / "autopilot.toml", path / "mission.toml"]
        flown = [one if one.is_file() else None for one in beside]
        return CampaignLog(log, "", None, default_input(campaign.vehicle, log.trial), *flown)
    if path.is_file():
        log = _read(campaign, path)
        return CampaignLog(log, "", None, _input(campaign, log))
    if name not in campaign.trials:
        raise TrialError(
            f"{source}: expected a recording, a run directory of `seatrial fly` or a trial of"
            f" {campaign.source}, found none{nearest(name, campaign.trials)}"
        )
    trial = campaign.trials[name]
    return CampaignLog(MissionLog.of(trial), name, _held_out(campaign, name), campaign.input_of(name))


def campaign_reference(
    campaign: Campaign, fit: Fitted, judged: CampaignLog, *, ahead_s: float, names: Sequence[str | Path] = ()
) -> Spread:
    """Spread of a valid model's errors: what the fitted vehicle leaves on recordings of the campaign.

    Parameters
    ----------
    campaign : Campaign
    fit : Fitted
    judged : CampaignLog
        Its own part is left out.
    ahead_s : float
        Time after which the prediction restarts, s.
    names : sequence of str or Path, optional
        Trials of the campaign, recordings or run directories of `seatrial fly` instead of the usual ones.

    Raises
    ------
    TrialError
        One cannot be read, or all together are too short.
    CampaignError
        A recording of the campaign is missing, or none has the input of the log.
    """

    def parts(one: CampaignLog) -> list[Restarts]:
        trial = one.log.trial
        spans: list[tuple[float | None, float | None]] = [(None, None)]
        if one.trial and one.trial == judged.trial:
            if judged.span is None:
                return []
            spans = [(None, judged.span[0]), (judged.span[1], None)]
        found = []
        for start, stop in spans:
            first = trial.t[0] if start is None else start
            last = trial.t[-1] if stop is None else stop
            if last - first > 0.5 * ahead_s:
                found.append(
                    restarts(fit.vehicle, trial, ahead_s=ahead_s, start_s=start, stop_s=stop, input=one.input)
                )
        return found

    if names:
        return spread_of_reference([part for name in names for part in parts(campaign_log(campaign, name))])
    if judged.trial:
        own = parts(judged)
        if sum(len(one.spans) for one in own) >= 2 * FEWEST_WINDOWS:
            return spread_of_reference(own)
    trials = [name for name in campaign.trials if campaign.input_of(name) == judged.input]
    if not trials:
        raise CampaignError(
            f"{campaign.source}: no trial is driven by {judged.input} as the log is; name logs on which the"
            " model is known to hold as references"
        )
    return spread_of_reference([part for name in trials for part in parts(campaign_log(campaign, name))])


def verify_campaign_log(
    campaign: Campaign,
    fit: Any,
    source: str | Path,
    *,
    autopilot: Autopilot | str | Path | None = None,
    mission: Mission | str | Path | None = None,
    references: Sequence[str | Path] = (),
    ahead_s: float = 10.0,
    **options: Any,
) -> tuple[LogVerdict, CampaignLog]:
    """Verdict on a log by the requirements and corridors of a campaign, and what is known of the log.

    Parameters
    ----------
    campaign : Campaign
    fit : Fitted, Identification, Vehicle, str or Path
        What is known of the vehicle.
    source : str or Path
        As for `campaign_log`.
    autopilot, mission : optional
        What was flown, where it does not lie beside the log.
    references : sequence of str or Path, optional
        As names of `campaign_reference`.
    ahead_s : float, optional
        Time after which the prediction restarts from the log, s.
    options
        Further keywords of `seatrial.recorded.verify_log`.

    Raises
    ------
    TrialError, CampaignError, SimulationError, VehicleError
        Something cannot be used.
    """
    from seatrial.verification.requirement import Requirement

    known, judged = Fitted.of(fit), campaign_log(campaign, source)
    table = campaign.file.verification
    asked = () if table is None else table.requirements
    start, stop = (None, None) if judged.span is None else judged.span
    found = verify_log(
        known,
        judged.log,
        reference=campaign_reference(campaign, known, judged, ahead_s=ahead_s, names=references),
        autopilot=judged.autopilot if autopilot is None else autopilot,
        mission=judged.mission if mission is None else mission,
        requirements=[Requirement(one.name, one.holds, one.probability) for one in asked],
        corridors=_corridors(campaign),
        obstacles=None if table is None else table.obstacles,
        sensors=_sensors(campaign),
        ahead_s=ahead_s,
        start_s=start,
        stop_s=stop,
        input=judged.input,
        seed=campaign.seed,
        **options,
    )
    return found, judged


def _read(campaign: Campaign, path: Path) -> MissionLog:
    """A recording with the campaign's column map, or as it is where it has the canonical names."""
    from seatrial.campaign_file import Places
    from seatrial.readers import read_table

    file = campaign.file
    table, _ = read_table(path, file.reader)
    if any(column.startswith("measured.") for column in table.columns):
        return MissionLog.read(path)
    return MissionLog.read(
        path,
        columns=file.columns or None,
        reader=file.reader,
        rate_hz=file.rate_hz,
        places=file.places.over(Places()),
        rho=file.environment.rho_kg_m3,
        g=file.environment.g_m_s2,
    )


def _input(campaign: Campaign, log: MissionLog) -> Input:
    """The campaign's own input where the log has it, else the first that it has."""
    return (
        campaign.file.input
        if campaign.file.input in log.trial.inputs
        else default_input(campaign.vehicle, log.trial)
    )


def _held_out(campaign: Campaign, name: str) -> tuple[float, float] | None:
    """The longest part of a trial that was held out, in its own time; None where all or nothing was."""
    mask = campaign.held_out(name)
    if mask.all() or not mask.any():
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    first, last = max(zip(edges[::2], edges[1::2], strict=True), key=lambda span: span[1] - span[0])
    t = campaign.trials[name].t
    return float(t[first]), float(t[last - 1])


def _corridors(campaign: Campaign) -> dict[str, Corridor]:
    """Corridors that the campaign states, of loops whose set points a log may tell."""
    table = campaign.file.tuning
    given = {} if table is None else table.loops.given()
    return {
        loop: one.corridor.corridor(one.weights)
        for loop, one in given.items()
        if one.corridor is not None and loop in _LOGGED_LOOPS
    }


def _sensors(campaign: Campaign) -> str | Path | None:
    """Sensors of the campaign's verification: their offsets belong to the band."""
    from seatrial.toml_file import is_path

    table = campaign.file.verification
    if table is None or table.sensors == "perfect":
        return None if table is not None else "typical"
    return campaign.beside(table.sensors, "verification.sensors") if is_path(table.sensors) else table.sensors
