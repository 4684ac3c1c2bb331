"""Draws of a verification: vehicle, water, start, failures and seeds of every mission, and their causes.

Mission i is a function of the campaign's seed and of i alone (`seatrial.identification.fitted`): any one can
be flown again by its number, and a longer campaign begins with the shorter one. The inputs are independent of
each other; a further entry of faults or outages changes none of the rest.

What the table leaves open: the current's speed is uniform from zero to a quarter of the slowest speed of the
missions, its turbulence a tenth of it (intensities near 10 % in tidal channels: Thomson, Polagye, Durgesh and
Richmond 2012, IEEE J. Oceanic Eng. 37:363), alike north and east and 0.55 of that down (Nezu and Nakagawa
1993, *Turbulence in Open-Channel Flows*: 1.27 against 2.30). The period of waves is that of a sea of their
height, 4.3 s for the root of a metre; a drawn one that would let them break is made longer. The vehicle
starts level and, unless a speed is given, drifts with the water. A start above the surface is one at the
surface.

A cause has a column where the table scatters it, whatever these missions happened to draw. Coefficients count
in standard deviations; of those that move together, as tied ones do, only the first has a column.

Tests: ``tests/verification/test_draws.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError
from seatrial.flight.checks import checked_seed
from seatrial.flight.disturbances import CALM, LIMITS, Outage, outage_rows, steepest_period
from seatrial.identification.fitted import Fitted, checked_numbers, uniforms
from seatrial.verification.table import DistributionTable, VerificationTable, Waves

if TYPE_CHECKING:
    from seatrial.flight.mission import Mission
from seatrial.base.errors import SimulationError, nearest
from seatrial.flight.disturbances import Fault, fault_rows
from seatrial.vehicle.actuators import actuator_groups
from seatrial.verification.table import FaultTable, OutageTable

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True, eq=False)
class Draws:
    """Drawn cases (k); SI and rad, NED.

    `numbers`: of the cases in the campaign: with them each can be drawn again alone. `mission`: index of the
    mission that each flies, (k,). `coefficients`: of the vehicle that flies, by name, (k,) each. `current`,
    `turbulence`: mean velocity of the water, and standard deviation about it, (k, 3), m/s. `waves`: sea
    states (k, 5), rows of `SeaState.row`. `position`, `attitude`, `nu`: start: place (k, 3), roll, pitch,
    yaw (k, 3), velocities over ground in the body frame (k, 6). `faults`: rows (case, actuator, time in s,
    command or nan) with the case's place among these. `outages`: rows (case, group, from, until in s).
    `seeds`: of the sensors' noise and of the water's motion, (k,). `causes`: what was drawn, by readable
    names with units, (k,) each. `notes`: sentences: how many vehicles were impossible, what is not in the
    covariance. `doubt`: heading where many of the drawn vehicles were impossible; empty otherwise. `offsets`:
    of the sensors' channels in their standard deviations, (k, 16); None: the seeds draw them.
    """

    numbers: NDArray[np.int_]
    mission: NDArray[np.int_]
    coefficients: Mapping[str, Array]
    current: Array
    turbulence: Array
    waves: Array
    position: Array
    attitude: Array
    nu: Array
    faults: list[FaultRow]
    outages: list[OutageRow]
    seeds: NDArray[np.int_]
    causes: Mapping[str, Array]
    notes: tuple[str, ...] = ()
    doubt: str = ""
    offsets: Array | None = None

    def __len__(self) -> int:
        """Number of cases."""
        return len(self.numbers)

    def take(self, places: ArrayLike) -> Draws:
        """Cases at places (m,), in the order given; rows of faults and outages count within them."""
        chosen = np.asarray(places, dtype=np.int_)
        now = {int(old): new for new, old in enumerate(chosen)}
        parts: dict[str, Any] = {}
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                parts[name] = value[chosen]
            elif isinstance(value, Mapping):
                parts[name] = {key: column[chosen] for key, column in value.items()}
            elif isinstance(value, list):  # rows of faults and of outages begin with the case
                parts[name] = [(now[case], *row) for case, *row in value if case in now]
        return replace(self, **parts)


def cause_columns(
    table: VerificationTable, fitted: Fitted, missions: Sequence[Mission], *, draws: Draws
) -> dict[str, Array]:
    """What was drawn by readable names with units, (k,) each; missions are the table's, in its order."""
    begins = np.array([[one.start["north_m"], one.start["east_m"], one.start["depth_m"]] for one in missions])
    bow = np.array([one.start["heading"] for one in missions])
    columns = _of_water(table, draws, bow[draws.mission])
    columns |= _of_start(table, draws, begins[draws.mission], bow[draws.mission])
    columns |= _of_failures(table, fitted, draws)
    # Of two missions either one tells the other.
    titles = list(enumerate(mission.title for mission in table.missions))
    for k, title in titles[1:] if len(titles) <= 2 else titles:
        columns[f"mission {title}"] = np.asarray(draws.mission == k, dtype=float)
    return columns | _of_vehicle(fitted, draws)


def _of_water(table: VerificationTable, draws: Draws, bow: Array) -> dict[str, Array]:
    asked, (north, east, down) = table.current, draws.current.T
    found: dict[str, Array] = {}
    steady = asked.speed_m_s is not None and asked.speed_m_s.is_fixed
    if not steady:
        found["current speed, m/s"] = np.hypot(north, east)
    if not steady or not asked.direction_deg.is_fixed:
        found["current from ahead at the start, m/s"] = -north * np.cos(bow) - east * np.sin(bow)
        found["current from port at the start, m/s"] = east * np.cos(bow) - north * np.sin(bow)
    if not asked.direction_deg.is_fixed:
        found["current towards, deg from north"] = np.degrees(np.arctan2(east, north)) % 360.0
    if asked.vertical_m_s > 0.0:
        found["current down, m/s"] = down
    if asked.turbulence_m_s is not None and not asked.turbulence_m_s.is_fixed:
        found["turbulence, m/s"] = draws.turbulence[:, 0]
    if table.waves is not None:
        found |= _of_waves(table.waves, draws.waves, bow)
    return found


def _of_waves(asked: Waves, rows: Array, bow: Array) -> dict[str, Array]:
    height, period, toward = rows[:, 0], rows[:, 1], rows[:, 2]
    found: dict[str, Array] = {}
    if not asked.height_m.is_fixed:
        found["wave height, m"] = height
    if asked.period_s is not None and not asked.period_s.is_fixed:
        found["wave period, s"] = period
    if not asked.toward_deg.is_fixed:
        found["waves from ahead at the start, share"] = -np.cos(toward - bow)
    return found


def _of_start(table: VerificationTable, draws: Draws, begins: Array, bow: Array) -> dict[str, Array]:
    asked, off = table.start, draws.position - begins
    yaw = draws.attitude[:, 2]
    found: dict[str, Array] = {}
    if asked.position_m > 0.0:
        found |= {"start off to the north, m": off[:, 0], "start off to the east, m": off[:, 1]}
    if asked.depth_m > 0.0:
        found["start below the mission's, m"] = off[:, 2]
    if not asked.heading_deg.is_fixed:
        found["start heading off to starboard, deg"] = np.degrees(yaw - bow)
    if asked.speed_m_s is not None and not asked.speed_m_s.is_fixed:
        drift = draws.current[:, 0] * np.cos(yaw) + draws.current[:, 1] * np.sin(yaw)
        found["start speed through the water, m/s"] = draws.nu[:, 0] - drift
    return found


def _of_failures(table: VerificationTable, fitted: Fitted, draws: Draws) -> dict[str, Array]:
    found: dict[str, Array] = {}
    if table.faults:
        names = sorted({name for entry in table.faults for name in targets(entry, fitted.vehicle)})
        found["fault"] = np.zeros(len(draws))
        if len(names) > 1:
            found |= {f"fault of {name}": np.zeros(len(draws)) for name in names}
        for case, name, _, _ in draws.faults:
            for column in ("fault", f"fault of {name}"):
                if column in found:
                    found[column][case] = 1.0
    groups = autopilot_names()["groups"]
    for entry in table.outages:
        ((group, _, _),) = outage_rows([Outage(entry.sensor, 0.0)], math.inf)
        found[f"outage of {groups[group]}, s"] = np.zeros(len(draws))
    for case, group, start, stop in draws.outages:
        found[f"outage of {groups[group]}, s"][case] += stop - start
    return found


def _of_vehicle(fitted: Fitted, draws: Draws) -> dict[str, Array]:
    sigma, centre = fitted.sigma, fitted.nominal
    found: dict[str, Array] = {}
    kept: list[int] = []
    for k, name in enumerate(fitted.names):
        if sigma[k] == 0.0:
            continue
        # From such a correlation on two coefficients are one.
        if not any(abs(fitted.covariance[j, k]) >= (1.0 - 1e-9) * sigma[j] * sigma[k] for j in kept):
            kept.append(k)
            found[f"coefficient {name}, sigmas"] = (draws.coefficients[name] - centre[k]) / sigma[k]
    return found


_COMMON, _FAULTS, _OUTAGES = 2, 3, 4  # streams; 1 is that of the coefficients

_ORDER = (
    "mission", "seed", "speed", "direction", "vertical", "turbulence", "north", "east", "depth", "heading",
    "ahead", "height", "period", "toward",
)  # fmt: skip # columns of the common stream; more go behind

_SEEDS = 2.0**53  # whole numbers that a float holds

# Defaults: largest current over the slowest speed; turbulence over current, and vertical over horizontal.
_QUARTER, _TENTH, _DOWN = 0.25, 0.1, 0.55


def draw_missions(
    table: VerificationTable,
    fitted: Fitted,
    missions: Sequence[Mission],
    *,
    seed: int,
    numbers: int | ArrayLike | None = None,
) -> Draws:
    """Draws of a verification, SI and rad.

    `fitted`: the vehicle that flies, and how well it is known. `missions`: those of the table, in its order.
    `seed`: of the campaign. `numbers`: how many cases, or their numbers; the table's runs when omitted.
    Raises CampaignError where a name of a coefficient is unknown, no drawn vehicle is possible, or the
    missions are not the table's. Raises SimulationError where an actuator, group or sensor is unknown, a
    command is beyond its range, or the seed is none.
    """
    if len(missions) != len(table.missions):
        raise CampaignError(
            f"missions: expected the {len(table.missions)} of the table [verification], found {len(missions)}"
        )
    seed = checked_seed(seed)
    which = checked_numbers(table.runs if numbers is None else numbers)
    # Every kind of cause has a stream of its own: more of one changes none of the others.
    fitted = scattered(table, fitted)
    drawn = fitted.drawn(which, seed)
    return composed(
        table,
        fitted,
        missions,
        numbers=which,
        coefficients=drawn.coefficients,
        uniform=(
            uniforms(seed, which, cause=_COMMON, width=len(_ORDER)),
            uniforms(seed, which, cause=_FAULTS, width=FAULT_WIDTH * len(table.faults)),
            uniforms(seed, which, cause=_OUTAGES, width=OUTAGE_WIDTH * len(table.outages)),
        ),
        notes=tuple(note for note in (*fitted.notes, drawn.sentence()) if note),
        doubt=drawn.doubt(),
    )


def scattered(table: VerificationTable, fitted: Fitted) -> Fitted:
    """The vehicle with the uncertainty that a table gives its coefficients."""
    if table.coefficients == "nominal":
        return Fitted(fitted.vehicle, (), np.zeros((0, 0)))
    if not isinstance(table.coefficients, str):
        return Fitted.of(fitted, percent=table.coefficients)
    return fitted


COMMON_WIDTH, SEED_COLUMN = len(_ORDER), _ORDER.index("seed")
"""Random numbers that every case has, and which of them is the seed of its noise."""


def composed(
    table: VerificationTable,
    fitted: Fitted,
    missions: Sequence[Mission],
    *,
    numbers: Sequence[int],
    coefficients: Mapping[str, Array],
    uniform: tuple[Array, Array, Array],
    notes: tuple[str, ...] = (),
    doubt: str = "",
) -> Draws:
    """Cases from their random numbers.

    `fitted`: as `scattered` gives it. `numbers`: of the cases (k). `coefficients`: of the vehicles, SI.
    `uniform`: numbers from 0 to 1 of what every case has (`COMMON_WIDTH`), of the faults and of the outages
    (`FAULT_WIDTH` and `OUTAGE_WIDTH` of each entry). `notes`, `doubt`: as of `Draws`.
    """
    common, faults, outages = uniform
    # What every mission has, then failures: these need the time that its mission takes.
    u = {name: common[:, k] for k, name in enumerate(_ORDER)}
    mission = _mission(table, u["mission"])
    current, turbulence = _water(table, missions, u)
    position, attitude, nu = _start(table, missions, mission, u, current)
    planned = np.array([one.planned_time for one in missions])[mission]
    draws = Draws(
        numbers=np.array(numbers, dtype=np.int_),
        mission=mission,
        coefficients=coefficients,
        current=current,
        turbulence=turbulence,
        waves=_waves(table.waves, u),
        position=position,
        attitude=attitude,
        nu=nu,
        faults=fault_draws(table.faults, fitted.vehicle, faults, planned),
        outages=outage_draws(table.outages, outages, planned),
        seeds=np.asarray(np.floor(u["seed"] * _SEEDS), dtype=np.int_),
        causes={},
        notes=notes,
        doubt=doubt,
    )
    return replace(draws, causes=cause_columns(table, fitted, missions, draws=draws))


def _mission(table: VerificationTable, u: Array) -> NDArray[np.int_]:
    edges = np.cumsum([one.weight for one in table.missions])
    return np.asarray(np.searchsorted(edges[:-1] / edges[-1], u, side="right"), dtype=np.int_)


def _water(table: VerificationTable, missions: Sequence[Mission], u: dict[str, Array]) -> tuple[Array, Array]:
    """Mean current and the standard deviation of its turbulence, (k, 3), m/s."""
    asked, slowest = table.current, min(float(np.min(one.waypoints["speed_m_s"])) for one in missions)
    speeds = asked.speed_m_s or DistributionTable(uniform=(0.0, _QUARTER * slowest))
    speed = speeds.quantiles(u["speed"], above_zero=True)
    towards = np.radians(asked.direction_deg.quantiles(u["direction"]))
    down = _scatter(asked.vertical_m_s, u["vertical"])
    strength = (
        _TENTH * speed
        if asked.turbulence_m_s is None
        else asked.turbulence_m_s.quantiles(u["turbulence"], above_zero=True)
    )
    current = np.column_stack([speed * np.cos(towards), speed * np.sin(towards), down])
    return current, np.outer(strength, [1.0, 1.0, _DOWN])


def _waves(asked: Waves | None, u: dict[str, Array]) -> Array:
    """Sea states (k, 5), SI and rad; a period is no shorter than a sea of its height has."""
    if asked is None:
        return np.tile(CALM, (len(u["height"]), 1))
    height = np.minimum(asked.height_m.quantiles(u["height"], above_zero=True), LIMITS["height_m"][1])
    period = (
        4.3 * np.sqrt(height)  # s per root of a metre, between 3.6 and 5 of DNV-RP-C205 (2010), section 3.5.5
        if asked.period_s is None
        else asked.period_s.quantiles(u["period"], above_zero=True)
    )
    toward = np.radians(asked.toward_deg.quantiles(u["toward"]))
    spreading = np.full(len(height), math.radians(asked.spreading_deg))
    peakedness = np.full(len(height), asked.peakedness)
    least, most, _ = LIMITS["period_s"]
    period = np.clip(period, np.maximum(steepest_period(height), least), most)
    return np.column_stack([height, period, toward, spreading, peakedness])


def _start(
    table: VerificationTable,
    missions: Sequence[Mission],
    mission: NDArray[np.int_],
    u: dict[str, Array],
    current: Array,
) -> tuple[Array, Array, Array]:
    """Place (k, 3), roll, pitch, yaw (k, 3) and velocities over ground (k, 6)."""
    asked = table.start
    begins = np.array([
        [one.start["north_m"], one.start["east_m"], one.start["depth_m"], one.start["heading"]]
        for one in missions
    ])[mission]
    position = begins[:, :3] + np.column_stack([
        _scatter(asked.position_m, u["north"]),
        _scatter(asked.position_m, u["east"]),
        _scatter(asked.depth_m, u["depth"]),
    ])
    position[:, 2] = np.maximum(position[:, 2], np.minimum(begins[:, 2], 0.0))
    attitude = np.zeros((len(mission), 3))
    attitude[:, 2] = begins[:, 3] + np.radians(asked.heading_deg.quantiles(u["heading"]))
    ahead = 0.0 if asked.speed_m_s is None else asked.speed_m_s.quantiles(u["ahead"], above_zero=True)
    cosine, sine = np.cos(attitude[:, 2]), np.sin(attitude[:, 2])
    nu = np.zeros((len(mission), 6))
    nu[:, 0] = cosine * current[:, 0] + sine * current[:, 1] + ahead
    nu[:, 1] = -sine * current[:, 0] + cosine * current[:, 1]
    nu[:, 2] = current[:, 2]
    return position, attitude, nu


def _scatter(sd: float, u: Array) -> Array:
    return np.zeros(len(u)) if sd == 0.0 else DistributionTable(normal=(0.0, sd)).quantiles(u)


FaultRow = tuple[int, str, float, float]
OutageRow = tuple[int, int, float, float]
FAULT_WIDTH = OUTAGE_WIDTH = 4
"""Random numbers of an entry and case: whether, which or how long, when, and one to spare."""


def targets(entry: FaultTable, vehicle: Vehicle) -> dict[str, float]:
    """Actuators that an entry means, each with the command that it keeps (nan: where it is).

    Raises SimulationError where there is no such actuator or group, or the command is beyond an actuator's
    range.

    Examples
    --------
    >>> import seatrial as st
    >>> targets(FaultTable(actuator="stern", probability=0.1), st.Vehicle.load("cwolf"))
    {'PL': 0.0, 'PU': 0.0, 'SbL': 0.0, 'SbU': 0.0}
    """
    groups, actuators = actuator_groups(vehicle), list(vehicle.actuators)
    if entry.actuator == "any":
        meant = actuators
    elif entry.actuator in actuators:
        meant = [entry.actuator]
    elif entry.actuator in groups:
        meant = groups[entry.actuator]
    else:
        raise SimulationError(
            f"faults: the vehicle {vehicle.name} has no actuator or group"
            f' "{entry.actuator}"{nearest(entry.actuator, ["any", *groups, *actuators])}'
        )
    if not meant:
        raise SimulationError(f"faults: the vehicle {vehicle.name} has no actuator that could fail")
    stuck = entry.kind == "stuck" and entry.command is None
    faults = [Fault(name, 0.0, stuck, entry.command) for name in sorted(meant)]
    try:
        rows = fault_rows(faults, vehicle, math.inf)
    except SimulationError as error:
        # An entry's key for what a flight calls stuck_at.
        raise SimulationError(str(error).replace("stuck_at", "command")) from None
    return {name: command for _, name, _, command in rows}


def fault_draws(
    entries: tuple[FaultTable, ...], vehicle: Vehicle, u: Array, longest: Array
) -> list[FaultRow]:
    """Rows (case, actuator, time in s, command or nan); an actuator that fails twice fails the first time.

    `u` (k, entries * FAULT_WIDTH) are uniform numbers; `longest` (k,), s: until when a fault begins where the
    entry does not say.
    """
    first: dict[tuple[int, str], tuple[float, float]] = {}
    for number, entry in enumerate(entries):
        commands = targets(entry, vehicle)
        names = list(commands)
        happens, which, when, _ = u[:, number * FAULT_WIDTH : (number + 1) * FAULT_WIDTH].T
        for case in np.flatnonzero(happens < entry.probability).tolist():
            name = names[int(which[case] * len(names))]
            at = _between(entry.between_s, float(longest[case]), float(when[case]))
            if (case, name) not in first or at < first[case, name][0]:
                first[case, name] = (at, commands[name])
    return sorted((case, name, at, command) for (case, name), (at, command) in first.items())


def outage_draws(entries: tuple[OutageTable, ...], u: Array, longest: Array) -> list[OutageRow]:
    """Rows (case, group, from, until in s).

    `u` (k, entries * OUTAGE_WIDTH) are uniform numbers; `longest` (k,), s: until when an outage begins where
    the entry does not say. Raises SimulationError where there is no such group or kind of sensor.
    """
    found: list[OutageRow] = []
    for number, entry in enumerate(entries):
        ((group, _, _),) = outage_rows([Outage(entry.sensor, 0.0)], math.inf)
        happens, long, when, _ = u[:, number * OUTAGE_WIDTH : (number + 1) * OUTAGE_WIDTH].T
        duration = entry.duration_s.quantiles(long, above_zero=True)
        for case in np.flatnonzero((happens < entry.probability) & (duration > 0.0)):
            at = _between(entry.between_s, float(longest[case]), float(when[case]))
            found.append((int(case), group, at, at + float(duration[case])))
    return sorted(found)


def _between(between: tuple[float, float] | None, longest: float, share: float) -> float:
    start, stop = (0.0, longest) if between is None else between
    return start + share * (stop - start)
