"""A log of a campaign: where it stands, what was flown, which part of it is judged.

A log is the run directory of `seatrial fly`, whose autopilot and mission lie beside it; a trial of the
campaign, by its name or its file, of which the part is judged that was held out of the fit; or a recording,
read with the campaign's column map.

Tests: ``tests/test_recorded_campaign.py``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from seatrial.errors import CampaignError, SeatrialError, TrialError, nearest
from seatrial.prediction import default_input
from seatrial.recorded.mission_log import MissionLog

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.trial import Input

__all__ = ["CampaignLog", "campaign_log"]

_SHOWN = 6


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
    place
        File or folder of the log.
    autopilot, mission
        Files of what was flown, where they lie beside the log.
    """

    log: MissionLog
    trial: str
    span: tuple[float, float] | None
    input: Input
    place: Path | None = None
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
        _refuse_other_vehicle(campaign, log)
        beside = [path / "autopilot.toml", path / "mission.toml"]
        flown = [one if one.is_file() else None for one in beside]
        return CampaignLog(log, "", None, default_input(campaign.vehicle, log.trial), path, *flown)
    if path.is_file():
        name = _trial_of(campaign, path)
        if not name:
            log = _read(campaign, path)
            _refuse_other_vehicle(campaign, log)
            return CampaignLog(log, "", None, _input(campaign, log), path)
    if name not in campaign.trials:
        raise TrialError(
            f"{source}: expected a recording, a run directory of `seatrial fly` or a trial of"
            f" {campaign.source}, found none{nearest(name, campaign.trials)}"
        )
    trial = campaign.trials[name]
    return CampaignLog(
        MissionLog.of(trial), name, _held_out(campaign, name), campaign.input_of(name), _file(campaign, name)
    )


def _read(campaign: Campaign, path: Path) -> MissionLog:
    """A recording with the campaign's column map, or as it is where it has the canonical names."""
    from seatrial.campaign_file import Places
    from seatrial.readers import read_table

    file = campaign.file
    try:
        table, _ = read_table(path, file.reader)
    except SeatrialError as error:
        if path.suffix.lower() != ".toml":
            raise
        raise TrialError(f"{path}: no recording, and no recipe of a generated one ({error})") from None
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


def _file(campaign: Campaign, name: str) -> Path | None:
    """File of a trial, where that can be told."""
    try:
        return campaign.path_of(name)
    except CampaignError:  # an environment variable of another trial is not set
        return None


def _trial_of(campaign: Campaign, path: Path) -> str:
    """Name of the trial that a file is, else empty: the model was fitted to it and knows it too well."""
    own = path.resolve()
    for name in campaign.trials:
        file = _file(campaign, name)
        if file is not None and file.resolve() == own:
            return name
    return ""


def _refuse_other_vehicle(campaign: Campaign, log: MissionLog) -> None:
    vehicle, commands = campaign.vehicle, log.trial.commands
    if commands and log.trial.tau is None and not set(commands) & set(vehicle.actuators):
        raise TrialError(
            f"{log.trial.name}: the log has commands of {_some(commands)}, and the vehicle {vehicle.name} the"
            f" actuators {_some(vehicle.actuators)}; give a log of this vehicle, or map the columns"
            " cmd.<actuator>"
        )


def _some(names: Iterable[str]) -> str:
    shown = list(names)
    return ", ".join(shown[:_SHOWN]) + (f" and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else "")


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
