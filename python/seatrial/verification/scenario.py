"""`Scenario`: what a verification flies and what must hold, checked before anything flies.

The checks are those of a flight (`seatrial.flight.checks`); here each is asked by itself, so that its message
begins with the campaign's file and key. Tests: ``tests/verification/test_verify.py``,
``tests/verification/test_verification_messages.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from seatrial._core import Autopilot, Vehicle
from seatrial.base.errors import CampaignError, SeatrialError, SimulationError, nearest
from seatrial.base.files import file_name, free_name
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import clause_of
from seatrial.base.run import Kind, run_facts, sha256
from seatrial.base.toml_file import is_path, loaded, twice
from seatrial.flight.checks import (
    checked_rows,
    checked_seabed,
    checked_seed,
    checked_supply,
    checked_times,
    checked_turbulence,
    longest,
    within,
)
from seatrial.flight.disturbances import LIMITS, Outage, outage_rows
from seatrial.flight.mission import Mission, Route
from seatrial.flight.sensor_channels import sensor_channels, sensors_of
from seatrial.identification.fitted import Fitted
from seatrial.sensors.sensor import TYPICAL
from seatrial.verification.chosen_missions import check_cases
from seatrial.verification.draws import targets
from seatrial.verification.judgement import check_energy
from seatrial.verification.missions import CampaignFlights
from seatrial.verification.requirement import Requirement, default_requirements, named
from seatrial.verification.table import (
    FaultTable,
    MissionTable,
    OutageTable,
    RequirementTable,
    parse_verification,
)

if TYPE_CHECKING:
    from seatrial.base.work import Clock
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning
    from seatrial.verification.table import Current, DistributionTable, Waves

_PERFECT = "perfect"


@dataclass(frozen=True)
class ScenarioSettings:
    """What the draws of a verification may reach."""

    #: Largest standard deviation of the current, m/s, as of a single flight.
    strongest_turbulence_m_s: float = 5.0
    likely_share: float = 0.99  #: Part of its draws that must be possible where a distribution has no end.


SETTINGS = ScenarioSettings()


@contextmanager
def under(source: str, *keys: str, said: str = "") -> Iterator[None]:
    """Errors inside, their message begun with the campaign file and the keys of its table ``[verification]``.

    Keys go from the outside in. `said`: how the message itself names what they name; it is left out.
    """
    try:
        yield
    except SeatrialError as error:
        place = ", ".join(["verification", *keys[:-1], f"key {keys[-1]}"])
        raise type(error)(f"{source}: {place}: {str(error).removeprefix(f'{said}: ')}") from None


def sensors_of_table(
    sensors: str, source: str, resolve: Callable[[str, str], Path] | None = None
) -> str | Path | None:
    """What the key ``sensors`` names: "typical", a path, or None for perfect ones.

    `resolve` makes a path of what the file says and the key; as it stands when omitted. Raises
    SimulationError where it names neither, CampaignError where the path has a variable that is not set.
    """
    if sensors == _PERFECT:
        return None
    if is_path(sensors):
        return Path(sensors) if resolve is None else resolve(sensors, "verification.sensors")
    if sensors != TYPICAL:
        near = nearest(sensors, (TYPICAL, _PERFECT))
        raise SimulationError(
            f'{source}: verification, key sensors: expected "{TYPICAL}", "{_PERFECT}" or a file'
            f" such as sensors.toml, found {sensors!r}{near if near.startswith('; did') else ''}"
        )
    return sensors


def requirement_of(source: str, asked: RequirementTable, vehicle: Vehicle | None = None) -> Requirement:
    """A requirement that the campaign file states; with a vehicle on metrics that its missions have.

    Raises CampaignError where its expression cannot be read or judged; with file and key.
    """
    said = f'requirement "{asked.name}": holds'
    with under(source, f"requirements {asked.name!r}", "holds", said=said):
        requirement = Requirement(asked.name, asked.holds, asked.probability)
        if vehicle is not None:
            requirement.check()
            check_energy(requirement, vehicle)
        return requirement


def check_table(source: str, flights: CampaignFlights) -> list[Finding]:
    """Keys that do nothing, after everything that vehicle and missions refuse was refused.

    What is refused names the campaign file and the key.
    """
    table, vehicle = flights.table, flights.fitted.vehicle
    routes = [Route.of(mission) for mission in flights.missions]
    remarks = _check_supply(source, flights)
    with under(source, "sensors", said="sensors"):
        sensor_channels(sensors_of(flights.sensors, vehicle), flights.autopilot.period_s)
    with under(source, "max_time_s", said="max_time_s"):
        ends = [longest(route, flights.autopilot, table.max_time_s, logs=False) for route in routes]
    for route in routes:
        with under(source, "seabed", said="seabed"):
            checked_seabed(table.plane, route)
    _check_water(source, table.current)
    if table.waves is not None:
        _check_waves(source, table.waves)
    failures: list[tuple[str, Sequence[FaultTable | OutageTable]]] = [
        ("faults", table.faults),
        ("outages", table.outages),
    ]
    for name, entries in failures:
        for number, entry in enumerate(entries, 1):
            # Which of them it is, where there are several.
            key = name if len(entries) == 1 else f"{name}[{number}]"
            with under(source, key, said=name):
                if isinstance(entry, FaultTable):
                    targets(entry, vehicle)
                else:
                    outage_rows([Outage(entry.sensor, 0.0)], max(ends))
            with under(source, key, "between_s"):
                if entry.between_s is not None and entry.between_s[0] > max(ends):
                    raise SimulationError(
                        f"expected a beginning within the longest flight, 0 to {max(ends):.0f} s, found"
                        f" {entry.between_s[0]:g} s; the failure would never occur"
                    )
    if not isinstance(table.coefficients, str):
        with under(source, "coefficients", said="standard deviations"):
            Fitted.of(flights.fitted, percent=table.coefficients)
    return remarks


def _check_supply(source: str, flights: CampaignFlights) -> list[Finding]:
    given, vehicle = flights.table.voltage_v, flights.fitted.vehicle
    needed = [name for name, facts in vehicle.actuator_info().items() if facts["needs_voltage"]]
    if needed and given is None:
        raise SimulationError(
            f"{source}: verification, key voltage_v: the thrust of {vehicle.name} ({needed[0]}) depends on"
            " the supply voltage; add this key under [verification], in V"
        )
    with under(source, "voltage_v", said="voltage_v"):
        checked_supply(given, vehicle)
    if given is None or needed:
        return []
    return [Finding("supply without effect", Severity.NOTE, vehicle.name, {"voltage_v": given})]


def _check_water(source: str, current: Current) -> None:
    def fastest(asked: DistributionTable) -> float:
        at = 1.0 if asked.uniform is not None else SETTINGS.likely_share
        return float(asked.quantiles(np.array(at), above_zero=True))

    if current.speed_m_s is not None:
        with under(source, "current", "speed_m_s", said="current"):
            checked_rows("current", [fastest(current.speed_m_s), 0.0, 0.0])
    with under(source, "current", "vertical_m_s", said="current"):
        checked_rows("current", [0.0, 0.0, current.vertical_m_s])
    if current.turbulence_m_s is not None:
        with under(source, "current", "turbulence_m_s", said="turbulence"):
            within(
                "turbulence", fastest(current.turbulence_m_s), (0.0, SETTINGS.strongest_turbulence_m_s), "m/s"
            )
    with under(source, "current", "turbulence_times_s", said="turbulence_times_s"):
        checked_times(current.turbulence_times_s)
    with under(source, "current", "walk_m_s", said="current_walk"):
        checked_turbulence(current.walk_m_s, "current_walk")


def _check_waves(source: str, waves: Waves) -> None:
    for key, asked in (("height_m", waves.height_m), ("period_s", waves.period_s)):
        if asked is None:
            continue
        least, most, unit = LIMITS[key]
        ends = (
            (0.0, 1.0) if asked.uniform is not None else (1.0 - SETTINGS.likely_share, SETTINGS.likely_share)
        )
        with under(source, "waves", key, said=key):
            for end in asked.quantiles(np.array(ends), above_zero=True):
                within(key, float(end), (least, most), unit)
    for key in ("spreading_deg", "peakedness"):
        least, most, unit = LIMITS[key]
        with under(source, "waves", key, said=key):
            within(key, getattr(waves, key), (least, most), unit)


_AUTOPILOT_FILE = "autopilot.toml"
WITHOUT_FILE = "verify"
"""Source of a scenario that no campaign file states."""

_WATER = ("current", "waves", "seabed", "obstacles", "rho", "g")
_CONDITIONS = ("sensors", "navigation", "faults", "outages", "start", "voltage_v", "max_time_s", "model")


@dataclass(frozen=True, eq=False, init=False)
class Scenario:
    """What a verification and its strategies fly: vehicles, water, noise and failures that are drawn.

    Every mission has its own vehicle, drawn from what is known of it, water, noise, failures and start; the
    autopilot believes in the vehicle as it was identified. Mission i depends on the seed and on i alone.
    `seatrial.verify` flies it.

    Parameters
    ----------
    fit : Identification, Fitted, Vehicle, str or Path
        What is known of the vehicle: a result of `seatrial.identify`, its run directory, or a vehicle, whose
        coefficients count as exact.
    autopilot : Tuning, Autopilot, str or Path
        A result of `seatrial.tune` or its run directory, an autopilot, a built-in name or a file.
    missions : sequence of Mission, str or Path
    requirements : sequence of Requirement, optional
        What must hold; by default that missions are complete and paths are kept.
    water : mapping, optional
        Distributions of the water: current, waves, seabed, obstacles as in ``[verification]`` of a campaign
        file, and rho (kg/m3) and g (m/s2).
    conditions : mapping, optional
        Distributions of the conditions: sensors, navigation, faults, outages, start, voltage_v, max_time_s
        as in ``[verification]``, and model, the vehicle that the autopilot believes in.
    name : str, optional
        Of the result; that of the vehicle by default.
    seed : int
        Of all draws.
    **settings
        The other keys of ``[verification]``: runs, coefficients, confidence, keep_worst, cases.

    Attributes
    ----------
    flights
        What flies.
    requirements
        What must hold.
    remarks
        What is assumed; ``notes`` says it in sentences.
    name, source, text, inputs
        Of the result; how messages call what states the scenario; that text; SHA-256 of inputs by name.

    Raises
    ------
    CampaignError, SimulationError, TrialError, VehicleError
        A key is unknown, or something cannot be used.

    Examples
    --------
    >>> import seatrial as st
    >>> mission = st.Mission.from_toml('''
    ... format = 1
    ... name = "out"
    ... speed_m_s = 1.5
    ... acceptance_radius_m = 5.0
    ... legs = [{ north_m = 60.0, east_m = 0.0, depth_m = 5.0 }]
    ... ''')
    >>> scenario = st.Scenario(
    ...     "cwolf", "cwolf", [mission], water={"current": {"speed_m_s": [0.0, 0.3]}}, runs=64
    ... )
    >>> scenario.runs, [requirement.name for requirement in scenario.requirements]
    (64, ['is complete', 'keeps its path'])
    """

    flights: CampaignFlights
    requirements: tuple[Requirement, ...]
    remarks: tuple[Finding, ...]
    name: str
    source: str
    text: str
    inputs: Mapping[str, Any]

    def __init__(
        self,
        fit: Identification | Fitted | Vehicle | str | Path,
        autopilot: Tuning | Autopilot | str | Path,
        missions: Sequence[Mission | str | Path],
        *,
        requirements: Sequence[Requirement] = (),
        water: Mapping[str, Any] | None = None,
        conditions: Mapping[str, Any] | None = None,
        name: str | None = None,
        seed: int = 0,
        **settings: Any,
    ) -> None:
        import tomlkit

        around = {**_known("water", water, _WATER), **_known("conditions", conditions, _CONDITIONS)}
        rho, g, model = (around.pop(key, None) for key in ("rho", "g", "model"))
        tables, flown = titled(missions)
        for key in ("missions", *_WATER, *_CONDITIONS):
            if key in settings:
                home = "water" if key in _WATER else "conditions" if key in _CONDITIONS else "a parameter"
                raise CampaignError(f"{key}: expected in {home}, found as a keyword; give it there")
        stated = {
            "missions": [table.title for table in tables],
            **around,
            **settings,
            "requirements": [
                {"name": asked.name, "holds": asked.holds, "probability": asked.probability}
                for asked in requirements
            ],
        }
        fitted = Fitted.of(fit)
        # The text of a campaign file that asks for the same: what a run directory keeps of it.
        head = {"format": 1, "name": name or fitted.vehicle.name, "vehicle": fitted.vehicle.name}
        text = tomlkit.dumps({**head, "seed": checked_seed(seed), "verification": stated})
        table = parse_verification(text, WITHOUT_FILE).model_copy(update={"missions": tables})
        flights = CampaignFlights(
            table=table,
            fitted=fitted,
            autopilot=autopilot_of(autopilot),
            missions=flown,
            seed=seed,
            model=None if model is None else loaded(Vehicle, model, "model"),
            sensors=sensors_of_table(table.sensors, WITHOUT_FILE),
            rho=rho,
            g=g,
        )
        inputs = {"campaign": sha256(text), "vehicle": sha256(fitted.vehicle.to_toml())}
        self._fill(flights, name=head["name"], source=WITHOUT_FILE, text=text, inputs=inputs)

    @classmethod
    def of_flights(cls, flights: CampaignFlights, **stated: Any) -> Self:
        """Scenario of what flies, checked.

        `**stated`: ``name``, ``source``, ``text``, ``inputs``. Raises CampaignError, SimulationError,
        TrialError, VehicleError: something in it cannot be used.
        """
        scenario = cls.__new__(cls)
        scenario._fill(flights, **stated)
        return scenario

    def with_flights(self, flights: CampaignFlights) -> Self:
        """Scenario that flies something else, checked again."""
        return self.of_flights(
            flights, name=self.name, source=self.source, text=self.text, inputs=self.inputs
        )

    @property
    def runs(self) -> int:
        """Number of missions."""
        return self.flights.table.runs

    @property
    def without_file(self) -> bool:
        """Whether no campaign file states it."""
        return self.source == WITHOUT_FILE

    def files(self) -> dict[str, str]:
        """Files of the inputs by name, as they are flown."""
        missions: dict[str, str] = {}
        for title, mission in zip(self.flights.titles, self.flights.missions, strict=True):
            missions[free_name(file_name(title), missions)] = mission.to_toml()
        return {
            "campaign.toml": self.text,
            "vehicle.toml": self.flights.fitted.vehicle.to_toml(),
            "autopilot.toml": self.flights.autopilot.to_toml(),
            **{f"missions/{name}.toml": text for name, text in missions.items()},
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what is assumed."""
        return tuple(clause_of(remark, "verification") for remark in self.remarks)

    def facts(
        self, kind: Kind, *, clock: Clock, options: Mapping[str, Any], interrupted: bool
    ) -> dict[str, Any]:
        """Record of a run over the scenario.

        `kind`: of the run. `clock`: when it ran. `options`: what it was asked for besides. `interrupted`:
        whether it was ended early.
        """
        return run_facts(
            kind,
            self.name,
            clock=clock,
            inputs={**self.inputs, **{name: sha256(text) for name, text in self.files().items()}},
            seed=self.flights.seed,
            options=options,
            interrupted=interrupted,
        )

    def chosen(self, names: Sequence[str]) -> list[Requirement]:
        """Requirements of these names; all when none is named.

        Raises CampaignError: there is no requirement of a name.
        """
        known = {requirement.name: requirement for requirement in self.requirements}
        return named(names or list(known), known)

    def _fill(self, flights: CampaignFlights, **stated: Any) -> None:
        """Check all of it, then set the attributes."""
        source, table = str(stated["source"]), flights.table
        ignored = check_table(source, flights)
        requirements, remarks = _requirements(source, flights)
        remarks.extend(ignored)
        if table.navigation == "filter":
            remarks.append(Finding("navigation filter", Severity.NOTE))
        if table.coefficients == "covariance" and not flights.fitted.names:
            remarks.append(Finding("covariance unknown", Severity.NOTE))
        flights.check()
        check_cases(table.cases, flights, requirements, source)
        fields = {"flights": flights, "requirements": requirements, "remarks": tuple(remarks), **stated}
        for field, value in fields.items():
            object.__setattr__(self, field, value)


def _known(name: str, given: Mapping[str, Any] | None, keys: Sequence[str]) -> Mapping[str, Any]:
    """A part of a scenario, refused where it has keys that do not belong to it."""
    if given is not None and not isinstance(given, Mapping):
        raise CampaignError(
            f"{name}: expected a mapping of {', '.join(keys)} as in [verification], found {given!r}; the"
            " water and conditions of a scenario are drawn"
        )
    for key in given or {}:
        if key not in keys:
            raise CampaignError(f"{name}: unknown key {key!r}{nearest(key, keys)}")
    return given or {}


def titled(missions: Sequence[Mission | str | Path]) -> tuple[tuple[MissionTable, ...], tuple[Mission, ...]]:
    """Tables and objects of missions that were given, each with a title of its own.

    Raises CampaignError where there is none, or two have the same title.
    """
    if isinstance(missions, str | Path | Mission) or not missions:
        raise CampaignError(f"missions: expected a list of missions or files, found {missions!r}")
    given = [(Path(m).stem, Mission.load(m)) if isinstance(m, str | Path) else (m.name, m) for m in missions]
    titles, flown = [title for title, _ in given], tuple(mission for _, mission in given)
    if (title := twice(titles)) is not None:
        raise CampaignError(f"missions: two are called {title!r}; rename one of them")
    return tuple(MissionTable(file=title, name=title) for title in titles), flown


def autopilot_of(source: Any) -> Autopilot:
    """Autopilot of a tuning, a run directory of it, a file, a built-in name, or itself.

    Raises VehicleError, SimulationError where it is none.
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


def _requirements(source: str, flights: CampaignFlights) -> tuple[tuple[Requirement, ...], list[Finding]]:
    """What must hold, every expression checked, and a remark where nobody said what."""
    table = flights.table
    if table.requirements:
        vehicle = flights.fitted.vehicle
        return tuple(requirement_of(source, asked, vehicle) for asked in table.requirements), []
    off = flights.position_sd_m
    asked = default_requirements(table, flights.missions, position_sd_m=off)
    holds = {requirement.name: requirement.holds for requirement in asked}
    return asked, [Finding("no requirements", Severity.NOTE, values={"holds": holds, "position_sd_m": off})]
