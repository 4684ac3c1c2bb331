"""The cases of a verification, drawn: vehicle, water, start, failures and seeds of every flight.

Case i is a function of the campaign's seed and of i alone (`seatrial.numbered_draws`): any one can be flown
again by its number, and a longer campaign begins with the shorter one. The causes are independent of each
other; a further entry of faults or outages changes none of the rest.

What the table leaves open: the current's speed is uniform from zero to a quarter of the slowest speed of the
missions, its turbulence a tenth of it (intensities near 10 % in tidal channels: Thomson, Polagye, Durgesh and
Richmond 2012, IEEE J. Oceanic Eng. 37:363), alike north and east and 0.55 of that down (Nezu and Nakagawa
1993, *Turbulence in Open-Channel Flows*: 1.27 against 2.30). The vehicle starts level and, unless a speed
is given, drifts with the water. A start above the surface is one at the surface.

Tests: ``tests/test_draws.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.errors import CampaignError
from seatrial.fitted import Fitted
from seatrial.flight.checked_numbers import checked_seed
from seatrial.numbered_draws import checked_numbers, uniforms
from seatrial.verification.cases import Cases
from seatrial.verification.cause_columns import cause_columns
from seatrial.verification.distribution_table import DistributionTable
from seatrial.verification.failure_draws import FAULT_WIDTH, OUTAGE_WIDTH, fault_draws, outage_draws
from seatrial.verification.verification_file import VerificationTable

if TYPE_CHECKING:
    from seatrial.mission import Mission

__all__ = ["draw_cases"]

Array = NDArray[np.float64]

_COMMON, _FAULTS, _OUTAGES = 2, 3, 4  # streams; 1 is that of the coefficients
_ORDER = (
    "mission",
    "seed",
    "speed",
    "direction",
    "vertical",
    "turbulence",
    "north",
    "east",
    "depth",
    "heading",
    "ahead",
)  # columns of the common stream; more go behind
_SEEDS = 2.0**53
_QUARTER, _TENTH, _DOWN = 0.25, 0.1, 0.55


def draw_cases(
    table: VerificationTable,
    fitted: Fitted,
    missions: Sequence[Mission],
    *,
    seed: int,
    numbers: int | ArrayLike | None = None,
) -> Cases:
    r"""Cases of a verification, SI and rad.

    Parameters
    ----------
    table : VerificationTable
    fitted : Fitted
        The vehicle that flies, and how well it is known.
    missions : sequence of Mission
        Those of the table, in its order.
    seed : int
        Of the campaign.
    numbers : int or (k,) array_like of int, optional
        How many cases, or their numbers; the table's runs when omitted.

    Raises
    ------
    CampaignError
        A name of a coefficient is unknown, no drawn vehicle is possible, or the missions are not the table's.
    SimulationError
        An actuator, group or sensor is unknown, a command is beyond its range, or the seed is none.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.cli.new import EXAMPLES
    >>> from seatrial.verification.verification_file import parse_verification
    >>> table = parse_verification('[verification]\nmissions = ["farm.toml"]', "campaign.toml")
    >>> farm = st.Mission.load(EXAMPLES / "missions" / "farm.toml")
    >>> fitted = Fitted.of("cwolf", percent={"X_uu": 10.0})
    >>> cases = draw_cases(table, fitted, [farm], seed=1, numbers=100)
    >>> again = draw_cases(table, fitted, [farm], seed=1, numbers=[41])
    >>> bool((again.current[0] == cases.current[41]).all()), list(cases.causes)[0]
    (True, 'current speed, m/s')
    """
    if len(missions) != len(table.missions):
        raise CampaignError(
            f"missions: expected the {len(table.missions)} of the table [verification], found {len(missions)}"
        )
    seed = checked_seed(seed)
    which = checked_numbers(table.runs if numbers is None else numbers)
    if table.coefficients == "nominal":
        fitted = Fitted(fitted.vehicle, (), np.zeros((0, 0)))
    elif not isinstance(table.coefficients, str):
        fitted = Fitted.of(fitted, percent=table.coefficients)
    drawn = fitted.drawn(which, seed)
    columns = uniforms(seed, which, cause=_COMMON, width=len(_ORDER))
    u = {name: columns[:, k] for k, name in enumerate(_ORDER)}
    mission = _mission(table, u["mission"])
    current, turbulence = _water(table, missions, u)
    position, attitude, nu = _start(table, missions, mission, u, current)
    planned = np.array([one.planned_time for one in missions])[mission]
    faults = fault_draws(
        table.faults,
        fitted.vehicle,
        uniforms(seed, which, cause=_FAULTS, width=FAULT_WIDTH * len(table.faults)),
        planned,
    )
    outages = outage_draws(
        table.outages, uniforms(seed, which, cause=_OUTAGES, width=OUTAGE_WIDTH * len(table.outages)), planned
    )
    cases = Cases(
        numbers=np.array(which, dtype=np.int_),
        mission=mission,
        coefficients=drawn.coefficients,
        current=current,
        turbulence=turbulence,
        position=position,
        attitude=attitude,
        nu=nu,
        faults=faults,
        outages=outages,
        seeds=np.asarray(np.floor(u["seed"] * _SEEDS), dtype=np.int_),
        causes={},
        notes=tuple(note for note in (*fitted.notes, drawn.sentence()) if note),
    )
    return replace(cases, causes=cause_columns(table, fitted, missions, cases=cases))


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
