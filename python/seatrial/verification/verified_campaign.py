"""What a campaign asks of a verification, checked and ready to fly.

Tests: ``tests/test_verify.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from seatrial._core import Autopilot, Vehicle
from seatrial.errors import CampaignError, SimulationError
from seatrial.file_kind import loaded
from seatrial.fitted import Fitted
from seatrial.mission import Mission
from seatrial.verification.campaign_flights import CampaignFlights
from seatrial.verification.checked_table import check_table, requirement_of, sensors_of_table, under
from seatrial.verification.default_requirements import default_requirements
from seatrial.verification.figures_without_value import check_energy
from seatrial.verification.requirement import Requirement
from seatrial.verification.verification_file import MissionTable, RequirementTable, VerificationTable

if TYPE_CHECKING:
    from seatrial.campaign import Campaign

__all__ = ["VerifiedCampaign", "autopilot_of", "verified_campaign"]

_AUTOPILOT_FILE = "autopilot.toml"
_VERIFIED, _START = "verified", "start"


@dataclass(frozen=True, eq=False)
class VerifiedCampaign:
    """A verification that is ready to fly.

    Attributes
    ----------
    campaign
        What was asked for.
    flights
        What flies.
    requirements
        What must hold.
    others
        Autopilots to compare with, by name.
    runs
        Number of missions.
    notes
        Sentences on what is assumed.
    """

    campaign: Campaign
    flights: CampaignFlights
    requirements: tuple[Requirement, ...]
    others: dict[str, Autopilot]
    runs: int
    notes: tuple[str, ...]


def verified_campaign(
    campaign: Campaign,
    fit: Any = None,
    gains: Any = None,
    *,
    model: Any = None,
    runs: int | None = None,
    missions: Sequence[Mission | str | Path] | None = None,
    compare: bool | Mapping[str, Any] = False,
) -> VerifiedCampaign:
    """A verification that is ready to fly. See `seatrial.verify` for the parameters.

    Raises
    ------
    CampaignError, SimulationError, TrialError, VehicleError
        Something in it cannot be used.
    """
    table, flown = _table(campaign, missions)
    number = table.runs if runs is None else _positive(runs)
    autopilot = campaign.autopilot if gains is None else autopilot_of(gains)
    others = _others(campaign, gains, compare)
    fitted = Fitted.of(campaign.vehicle if fit is None else fit)
    if list(fitted.vehicle.actuators) != list(campaign.vehicle.actuators):
        raise CampaignError(
            f"{campaign.source}: expected a fit of {campaign.vehicle.name}, found one of"
            f" {fitted.vehicle.name} with other actuators; give the run directory of this campaign"
        )
    environment = campaign.file.environment
    flights = CampaignFlights(
        table=table.model_copy(update={"runs": number}),
        fitted=fitted,
        autopilot=autopilot,
        missions=flown,
        seed=campaign.seed,
        model=None if model is None else loaded(Vehicle, model, "model"),
        sensors=sensors_of_table(campaign, table.sensors),
        rho=environment.rho_kg_m3,
        g=environment.g_m_s2,
    )
    ignored = check_table(campaign.source, flights)
    requirements, notes = _requirements(campaign, flights)
    notes.extend(ignored)
    if table.coefficients == "covariance" and not flights.fitted.names:
        notes.append("Every vehicle flies with the same coefficients, for no covariance of them is known.")
    flights.check()
    for other in others.values():
        flights.with_autopilot(other).check()
    return VerifiedCampaign(campaign, flights, requirements, others, number, tuple(notes))


def autopilot_of(source: Any) -> Autopilot:
    """Autopilot of a tuning, a run directory of it, a file, a built-in name, or itself.

    Raises
    ------
    VehicleError, SimulationError
        It is none.
    """
    found = getattr(source, "autopilot", source)
    if isinstance(found, str | Path) and Path(found).is_dir():
        found = Path(found) / _AUTOPILOT_FILE
        if not found.is_file():
            raise SimulationError(
                f"{found.parent}: expected a run directory of `seatrial tune` with {_AUTOPILOT_FILE}, found"
                " none there; give the folder that it printed, or an autopilot file"
            )
    autopilot: Autopilot = loaded(Autopilot, found)
    return autopilot


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
        return table, tuple(_mission(campaign, one.file) for one in table.missions)
    if isinstance(missions, str | Path | Mission) or not missions:
        raise CampaignError(f"missions: expected a list of missions or files, found {missions!r}")
    flown = tuple(Mission.load(one) if isinstance(one, str | Path) else one for one in missions)
    titles = [
        Path(one).stem if isinstance(one, str | Path) else loaded_one.name
        for one, loaded_one in zip(missions, flown, strict=True)
    ]
    for title in titles:
        if titles.count(title) > 1:
            raise CampaignError(f"missions: two are called {title!r}; rename one of them")
    tables = tuple(MissionTable(file=title, name=title) for title in titles)
    if table is None:
        return VerificationTable(missions=tables), flown
    return table.model_copy(update={"missions": tables}), flown


def _mission(campaign: Campaign, file: str) -> Mission:
    path = campaign.beside(file, "verification.missions")
    if not path.is_file():
        raise CampaignError(
            f"{campaign.source}: verification, key missions: there is no file {path}; correct the path"
        )
    return Mission.load(path)


def _requirements(campaign: Campaign, flights: CampaignFlights) -> tuple[tuple[Requirement, ...], list[str]]:
    """What must hold, every expression checked, and a sentence where nobody said what."""
    table = flights.table
    if table.requirements:
        return tuple(_stated(campaign, one, flights.fitted.vehicle) for one in table.requirements), []
    off = flights.position_sd_m
    asked = default_requirements(table, flights.missions, position_sd_m=off)
    listed = "; ".join(f"{one.name}: {one.holds}" for one in asked)
    allowed = (
        f" The path allows for a position that is off by {off:.2g} m (1 sd) on each axis." if off else ""
    )
    return asked, [
        f"The campaign states no requirements; these are judged, each in 95 % of the missions: {listed}."
        f"{allowed}"
    ]


def _stated(campaign: Campaign, asked: RequirementTable, vehicle: Vehicle) -> Requirement:
    requirement = requirement_of(campaign.source, asked)
    said = f'requirement "{asked.name}": holds'
    with under(campaign.source, f"requirements {asked.name!r}", "holds", said=said):
        requirement.check()
        check_energy(requirement, vehicle)
    return requirement


def _others(campaign: Campaign, gains: Any, compare: bool | Mapping[str, Any]) -> dict[str, Autopilot]:
    """Autopilots to compare with, by name."""
    if isinstance(compare, Mapping):
        if _VERIFIED in compare:
            raise CampaignError(f'compare: "{_VERIFIED}" is the autopilot that is verified; use another name')
        return {str(name): autopilot_of(source) for name, source in compare.items()}
    if not compare:
        return {}
    if gains is None:
        raise CampaignError(
            f"{campaign.source}: expected another autopilot than the campaign's own to compare with it, found"
            " none; give the tuned one as gains (--autopilot), or others by name"
        )
    return {_START: campaign.autopilot}


def _positive(runs: Any) -> int:
    if not isinstance(runs, int) or isinstance(runs, bool) or runs < 1:
        raise CampaignError(f"runs: expected a whole number of missions from 1 on, found {runs!r}")
    return runs
