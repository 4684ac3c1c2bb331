"""What a campaign asks of a verification: the scenario of its missions, and a verdict on a log.

The scenario comes from the table ``[verification]``. A log is the run directory of `seatrial fly`, whose
autopilot and mission lie beside it; a trial of the campaign, by its name or its file, of which the part is
judged that was held out of the fit; or a recording, read with the campaign's column map.

How far a valid model may miss a log is told by the campaign's own recordings: what the fitted vehicle leaves
there, restarted as often and sampled no faster than the log. For a trial of the campaign that is the rest of
the same trial, which is motion of the same kind, or all trials where the rest is short; for another log all
trials.

Tests: ``tests/verification/test_verify.py``, ``tests/verification/test_verification_messages.py``,
``tests/verification/test_recorded_campaign.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from seatrial._core import Autopilot, Vehicle
from seatrial.base.arrays import runs
from seatrial.base.errors import CampaignError, SeatrialError, SimulationError, TrialError, nearest
from seatrial.base.files import no_file
from seatrial.base.toml_file import loaded
from seatrial.flight.mission import Mission
from seatrial.identification.fitted import Fitted
from seatrial.scoring.windows import default_input
from seatrial.sensors.sensor import TYPICAL
from seatrial.verification.mission_log.judge_log import USUAL, LogSettings, verify_log
from seatrial.verification.mission_log.log import MissionLog, thinned
from seatrial.verification.mission_log.spread import (
    PredictedLog,
    Spread,
    check_usable,
    restarts,
    spread_of_reference,
)
from seatrial.verification.mission_log.validity import VALIDITY_SETTINGS
from seatrial.verification.missions import CampaignFlights
from seatrial.verification.scenario import Scenario, autopilot_of, requirement_of, sensors_of_table, titled
from seatrial.verification.table import VerificationTable

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign
    from seatrial.control_design.corridor import Corridor
    from seatrial.trial.trial import Input
    from seatrial.verification.mission_log.verdict import LogVerdict


_SHOWN = 6  # names that a message lists


def scenario_of(
    campaign: Campaign,
    fit: Any = None,
    gains: Any = None,
    *,
    model: Any = None,
    runs: int | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    navigation: str | None = None,
) -> Scenario:
    """Scenario of a campaign. See `seatrial.Campaign.scenario` for the parameters and errors."""
    table, flown = _table(campaign, missions)
    if navigation is not None:
        if navigation not in ("sensors", "filter"):
            raise SimulationError(f'navigation: expected "sensors" or "filter", found {navigation!r}')
        table = table.model_copy(update={"navigation": navigation})
    if runs is not None:
        table = table.model_copy(update={"runs": _positive(runs)})
    autopilot = campaign.autopilot if gains is None else autopilot_of(gains)
    fitted = campaign.fitted(fit, in_order=True)
    environment = campaign.file.environment
    flights = CampaignFlights(
        table=table,
        fitted=fitted,
        autopilot=autopilot,
        missions=flown,
        seed=campaign.seed,
        model=None if model is None else loaded(Vehicle, model, "model"),
        sensors=sensors_of_table(table.sensors, campaign.source, campaign.resolve),
        rho=environment.rho_kg_m3,
        g=environment.g_m_s2,
    )
    return Scenario.of_flights(
        flights,
        name=campaign.name,
        source=campaign.source,
        text=campaign.text,
        inputs=campaign.input_hashes(trials=False),
    )


def others_of(campaign: Campaign, gains: Any, compare: bool | Mapping[str, Any]) -> Mapping[str, Any]:
    """Autopilots to compare with, by name: those given, or the campaign's own as "start".

    Raises CampaignError where the campaign's own is the one that is verified.
    """
    if isinstance(compare, Mapping):
        return compare
    if not compare:
        return {}
    if gains is None:
        raise CampaignError(
            f"{campaign.source}: expected another autopilot than the campaign's own to compare with it, found"
            " none; give the tuned one as gains (--autopilot), or others by name"
        )
    return {"start": campaign.autopilot}


def _table(
    campaign: Campaign, missions: Sequence[Mission | str | Path] | None
) -> tuple[VerificationTable, tuple[Mission, ...]]:
    """The table with the missions that fly, and those."""
    table = campaign.file.verification
    if missions is None:
        if table is None:
            raise CampaignError(
                f"{campaign.source}: expected the table [verification], found none; add it with"
                ' missions = ["mission.toml"], or give missions'
            )
        return table, tuple(_mission(campaign, mission.file) for mission in table.missions)
    tables, flown = titled(missions)
    if table is None:
        return VerificationTable(missions=tables), flown
    return table.model_copy(update={"missions": tables}), flown


def _mission(campaign: Campaign, file: str) -> Mission:
    path = campaign.resolve(file, "verification.missions")
    if wrong := no_file(path):
        raise CampaignError(f"{campaign.source}: verification, key missions: {wrong}; correct the path")
    return Mission.load(path)


def _positive(runs: Any) -> int:
    if not isinstance(runs, int) or isinstance(runs, bool) or runs < 1:
        raise CampaignError(f"runs: expected a whole number of missions from 1 on, found {runs!r}")
    return runs


@dataclass(frozen=True, eq=False)
class CampaignLog:
    """A log, and what is known of it.

    `log`: what was recorded. `trial`: its name where it is a trial of the campaign, else empty. `span`: first
    and last moment that is judged, s; None all of it. `input`: what drives the model there. `place`: file or
    folder of the log. `autopilot`, `mission`: files of what was flown, where they lie beside the log.
    """

    log: MissionLog
    trial: str
    span: tuple[float, float] | None
    input: Input
    place: Path | None = None
    autopilot: Path | None = None
    mission: Path | None = None


def campaign_log(campaign: Campaign, source: str | Path) -> CampaignLog:
    """A log by its run directory of `seatrial fly`, its recording or its name among a campaign's trials.

    Raises TrialError where there is no such log or it cannot be read, CampaignError where a recording of the
    campaign is missing.
    """
    path, name = Path(source), str(source)
    if path.is_dir():
        log = MissionLog.read(path, progress=campaign.progress)
        _refuse_other_vehicle(campaign, log)
        beside = [path / "autopilot.toml", path / "mission.toml"]
        flown = [file if file.is_file() else None for file in beside]
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
        MissionLog.of(trial),
        name,
        _held_out(campaign, name),
        campaign.problem().input_of(name),
        _file(campaign, name),
    )


def _read(campaign: Campaign, path: Path) -> MissionLog:
    """A recording with the campaign's column map, or as it is where it has the canonical names."""
    from seatrial.trial.columns import columns_of
    from seatrial.trial.recording import read_table

    file = campaign.file
    try:
        table = read_table(path, file.reader, columns_of(file.columns)).table
    except SeatrialError as error:
        if path.suffix.lower() != ".toml":
            raise
        raise TrialError(f"{path}: no recording, and no recipe of a generated one ({error})") from None
    if any(column.startswith("measured.") for column in table.columns):
        return MissionLog.read(path, progress=campaign.progress)
    return MissionLog.read(
        path,
        columns=file.columns or None,
        reader=file.reader,
        rate_hz=file.rate_hz,
        sensor_positions=file.places.by_sensor(),
        corrections=file.corrections,
        rho=file.environment.rho_kg_m3,
        g=file.environment.g_m_s2,
        surface=file.environment.surface_m,
        progress=campaign.progress,
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
    mask = campaign.problem().held_out(name)
    if mask.all() or not mask.any():
        return None
    first, last = max(runs(mask), key=lambda span: span[1] - span[0])
    t = campaign.trials[name].t
    return float(t[first]), float(t[last - 1])


_GIVE = "give --reference LOG: a log on which the model is known to hold (references=[...] in Python)"

_HAS = {
    "commands": "commands of the actuators",
    "measured": "no commands, but measured signals of the actuators",
    "tau": "no signals of the actuators, but a wrench",
}


def campaign_reference(
    campaign: Campaign, fit: Fitted, judged: CampaignLog, *, ahead_s: float, names: Sequence[str | Path] = ()
) -> Spread:
    """Spread of a valid model's errors: what the fitted vehicle leaves on recordings of the campaign.

    The part of the log that is judged is left out; predictions restart after `ahead_s`, s. `names` are trials
    of the campaign, recordings or run directories of `seatrial fly` instead of the usual ones. Raises
    TrialError where one cannot be read, or all together are too short; CampaignError where a recording of the
    campaign is missing, or none has the input of the log.
    """

    def parts(known: CampaignLog) -> list[PredictedLog]:
        trial = thinned(known.log.trial, judged.log.trial.dt)
        spans: list[tuple[float | None, float | None]] = [(None, None)]
        if known.trial and known.trial == judged.trial:
            if judged.span is None:
                return []
            spans = [(None, judged.span[0]), (judged.span[1], None)]
        return [
            restarts(fit.vehicle, trial, ahead_s=ahead_s, start_s=start, stop_s=stop, input=known.input)
            for start, stop in spans
            # A shorter rest has no window.
            if (trial.t[-1] if stop is None else stop) - (trial.t[0] if start is None else start)
            > 0.5 * ahead_s
        ]

    if names:
        given = [campaign_log(campaign, name) for name in names]
        for name, log in zip(names, given, strict=True):
            if not log.trial and log.place is not None and log.place == judged.place:
                raise TrialError(
                    f"reference {name}: expected a log on which the model is known to hold, found the one"
                    " that is judged; give another one, or leave it out"
                )
        return spread_of_reference([part for log in given for part in parts(log)])
    if judged.trial:
        own = parts(judged)
        if sum(len(reference.spans) for reference in own) >= 2 * VALIDITY_SETTINGS.fewest_windows:
            return spread_of_reference(own)
    _refuse_missing(campaign)
    trials = [name for name in campaign.trials if campaign.problem().input_of(name) == judged.input]
    if not trials:
        raise CampaignError(
            f"{judged.log.trial.name}: the log has {_HAS[judged.input]}, but no trial of {campaign.source}"
            f" has that input; log the same input as the trials, or {_GIVE}"
        )
    return spread_of_reference([part for name in trials for part in parts(campaign_log(campaign, name))])


def _refuse_missing(campaign: Campaign) -> None:
    """Refuse a campaign whose trials do not stand there, with what may stand for them."""
    why = "trials tell what a valid model leaves unexplained"
    if not len(campaign.trials):
        raise CampaignError(f"{campaign.source}: expected trials, found none: {why}; {_GIVE}")
    for name in campaign.trials:
        path = campaign.path_of(name)
        if path is not None and (wrong := no_file(path)):
            raise CampaignError(
                f"{campaign.source}: trial {name!r}, key file: {wrong}, and {why}; correct"
                f" the path, or {_GIVE}"
            )


_LOGGED_LOOPS = ("surge", "sway", "heave", "pitch", "heading", "depth")


def verify_campaign_log(
    campaign: Campaign,
    fit: Any,
    source: str | Path,
    *,
    autopilot: Autopilot | str | Path | None = None,
    mission: Mission | str | Path | None = None,
    references: Sequence[str | Path] = (),
    current: ArrayLike | None = None,
    settings: LogSettings = USUAL,
) -> tuple[LogVerdict, CampaignLog]:
    """Verdict on a log by the requirements and corridors of a campaign, and what is known of the log.

    `fit`: what is known of the vehicle. `source`: as for `campaign_log`. `autopilot`, `mission`: what was
    flown, where it does not lie beside the log. `references`: as names of `campaign_reference`. `current`: of
    the envelope, m/s, NED. `settings`: part, input and seed come from the campaign. Raises TrialError,
    CampaignError, SimulationError, VehicleError: something cannot be used.
    """
    known = campaign.fitted(fit)
    judged = campaign_log(campaign, source)
    check_usable(judged.log.trial, settings.ahead_s)  # before a reference of the same interval is refused
    table = campaign.file.verification
    asked = () if table is None else table.requirements
    start, stop = (None, None) if judged.span is None else judged.span
    verdict = verify_log(
        known,
        judged.log,
        reference=campaign_reference(campaign, known, judged, ahead_s=settings.ahead_s, names=references),
        autopilot=judged.autopilot if autopilot is None else autopilot,
        mission=judged.mission if mission is None else mission,
        requirements=[requirement_of(campaign.source, requirement) for requirement in asked],
        corridors=_corridors(campaign),
        obstacles=None if table is None else table.obstacles,
        sensors=_sensors(campaign),
        current=current,
        settings=replace(settings, start_s=start, stop_s=stop, input=judged.input, seed=campaign.seed),
    )
    return verdict, judged


def _corridors(campaign: Campaign) -> dict[str, Corridor]:
    """Corridors that the campaign states, of loops whose set points a log may tell."""
    table = campaign.file.tuning
    given = {} if table is None else table.loops.given()
    return {
        loop: entry.corridor.corridor(entry.weights)
        for loop, entry in given.items()
        if entry.corridor is not None and loop in _LOGGED_LOOPS
    }


def _sensors(campaign: Campaign) -> str | Path | None:
    """Sensors of the campaign's verification: their offsets belong to the band."""
    table = campaign.file.verification
    return TYPICAL if table is None else sensors_of_table(table.sensors, campaign.source, campaign.resolve)
