"""What disturbs a flight: waves, actuators that die or stick, groups of channels that go silent.

The core makes the motion of the water from a sea state (``flight/waves.rs``). Tests:
``tests/flight/test_waves.py``, ``tests/flight/test_fly.py``, ``tests/cli/test_cli_fly.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial._core import autopilot_names
from seatrial.base.arrays import Array
from seatrial.base.errors import SimulationError, nearest
from seatrial.flight.checks import is_number, within
from seatrial.flight.sensor_channels import GROUP_OF_KIND

if TYPE_CHECKING:
    from seatrial._core import Vehicle


CALM = (0.0, 8.0, 0.0, 0.0, 3.3)
"""The core's row for no waves."""

LIMITS: dict[str, tuple[float, float, str]] = {
    "height_m": (0.0, 20.0, "m"),
    "period_s": (1.0, 30.0, "s"),
    "toward_deg": (-360.0, 360.0, "degrees"),
    "spreading_deg": (0.0, 60.0, "degrees"),
    "peakedness": (1.0, 7.0, "without unit, 1 (Pierson-Moskowitz) to 7"),
}
"""Least, most and unit of every number of a sea state."""


@dataclass(frozen=True)
class SeaState:
    """Waves of a JONSWAP spectrum in deep water, by linear theory.

    A vehicle meets their orbital velocity and acceleration at its place and depth; the phases go by the seed.

    Attributes
    ----------
    height_m
        Significant wave height, m: four standard deviations of the surface.
    period_s
        Peak period, s.
    toward_deg
        Where the waves go, degrees from north over east; as that of a current, not as that of a wind.
    spreading_deg
        Standard deviation of the directions of the components; 0: long-crested.
    peakedness
        The peak enhancement factor; 3.3 for a young sea, 1 for Pierson-Moskowitz's grown one.

    Raises
    ------
    SimulationError
        A number is none, or one that no sea has.

    Examples
    --------
    >>> SeaState(0.5, 6.0, toward_deg=90.0)
    SeaState(height_m=0.5, period_s=6.0, toward_deg=90.0, spreading_deg=0.0, peakedness=3.3)
    """

    height_m: float
    period_s: float
    toward_deg: float = 0.0
    spreading_deg: float = 0.0
    peakedness: float = 3.3

    def __post_init__(self) -> None:
        for name, (least, most, unit) in LIMITS.items():
            within(f"waves: {name}", getattr(self, name), (least, most), unit)
        shortest = float(steepest_period(self.height_m))
        if self.period_s < shortest:
            raise SimulationError(
                f"waves: expected a significant height of at most a {1 / STEEPEST:.0f}th of the length of a"
                f" wave of the peak period, {self.height_m * (self.period_s / shortest) ** 2:.2g} m at"
                f" {self.period_s:g} s, found {self.height_m:g} m; steeper seas break"
            )

    @classmethod
    def of_row(cls, row: ArrayLike) -> SeaState | None:
        """Sea state of a row of the core; None for a calm one."""
        height, period, toward, spreading, peakedness = np.asarray(row, float).tolist()
        turned = math.degrees(toward), math.degrees(spreading)
        return cls(height, period, *turned, peakedness) if height > 0.0 else None

    @property
    def row(self) -> tuple[float, float, float, float, float]:
        """The same in SI and rad, as the core takes it."""
        toward, spreading = math.radians(self.toward_deg), math.radians(self.spreading_deg)
        return self.height_m, self.period_s, toward, spreading, self.peakedness


STEEPEST = 1.0 / 15.0
"""Steepest sea, height over wave length: DNV-RP-C205 (2010), section 3.5.4, at peak periods up to 8 s."""


def steepest_period(height_m: Any) -> Any:
    """Shortest peak period, s, of a sea of this significant height, m, that does not break, in deep water."""
    return np.sqrt(2.0 * math.pi * np.asarray(height_m) / (9.81 * STEEPEST))


def checked_seas(given: Any) -> tuple[tuple[SeaState | None, ...], bool]:
    """Sea states, one for all cases or one each, and whether they differ from case to case."""
    if given is None or isinstance(given, SeaState):
        return (given,), False
    seas = tuple(given) if isinstance(given, Sequence) and not isinstance(given, str) else ("",)
    for sea in seas:
        if not (sea is None or isinstance(sea, SeaState)):
            raise SimulationError(
                f"waves: expected st.SeaState(height_m, period_s, toward_deg=...), found {given!r}"
            )
    return seas, True


def sea_rows(seas: Sequence[SeaState | None]) -> Array:
    """The sea states (k, 5) as the core takes them."""
    return np.array([CALM if sea is None else sea.row for sea in seas])


_FAULT = re.compile(r"(?P<actuator>[^@=]+)@(?P<time>[^=]+)(?:=(?P<value>.+))?")

_OUTAGE = re.compile(r"(?P<what>[^@=]+)@(?P<times>.+)")


@dataclass(frozen=True)
class Fault:
    """The failure of an actuator: dead, unless it is stuck.

    Attributes
    ----------
    actuator
        Its name in the vehicle file.
    at_s
        From this time on, s.
    stuck
        It stays where it is at that moment.
    stuck_at
        It stays at this value, in the unit of its command.

    Examples
    --------
    >>> Fault("SbU", at_s=60)
    Fault(actuator='SbU', at_s=60, stuck=False, stuck_at=None)
    """

    actuator: str
    at_s: float
    stuck: bool = False
    stuck_at: float | None = None

    @classmethod
    def parse(cls, text: str) -> Fault:
        """Fault from a `text` ``ACTUATOR@TIME``, with ``=stuck`` or ``=VALUE`` behind it; a SimulationError
        where it is not of this form.

        Examples
        --------
        >>> Fault.parse("rudder@60=0.1").stuck_at
        0.1
        """
        match = _FAULT.fullmatch(text.strip())
        if match is None:
            raise SimulationError(
                f"fault {text!r}: expected ACTUATOR@SECONDS, ACTUATOR@SECONDS=stuck or"
                " ACTUATOR@SECONDS=VALUE, for example SbU@60"
            )
        time = _number(match["time"], f"fault {text!r}", "a time in s behind @")
        actuator, value = match["actuator"].strip(), match["value"]
        if value is None or value == "dead":
            return cls(actuator, time)
        if value == "stuck":
            return cls(actuator, time, stuck=True)
        where = "stuck, dead or a value in the unit of the command behind ="
        return cls(actuator, time, stuck_at=_number(value, f"fault {text!r}", where))

    def sentence(self) -> str:
        """What fails, in words."""
        how = "dead" if not self.stuck and self.stuck_at is None else "stuck"
        at = "" if self.stuck_at is None else f" at {self.stuck_at:g}"
        return f"{self.actuator} is {how}{at} from {_shown(self.at_s)} s on"


@dataclass(frozen=True)
class Outage:
    """A time without samples.

    Attributes
    ----------
    of
        Group of channels (position, depth, attitude, velocity, rates, altitude, water) or kind of sensor.
    from_s, until_s
        Beginning and end, s; to the end of the flight when missing.

    Examples
    --------
    >>> Outage("position", from_s=100.0).until_s
    inf
    """

    of: str
    from_s: float
    until_s: float = math.inf

    @classmethod
    def parse(cls, text: str) -> Outage:
        """Outage from a `text` ``GROUP@FROM-UNTIL`` or ``GROUP@FROM``; a SimulationError where it is not of
        this form.

        Examples
        --------
        >>> Outage.parse("position@100-200").until_s
        200.0
        """
        match = _OUTAGE.fullmatch(text.strip())
        if match is None:
            raise SimulationError(
                f"outage {text!r}: expected GROUP@FROM-UNTIL in s or GROUP@FROM, for example position@100-200"
            )
        begins, dash, ends = match["times"].partition("-")
        where, what = f"outage {text!r}", "times in s as FROM-UNTIL behind @"
        return cls(
            match["what"].strip(),
            _number(begins, where, what),
            _number(ends, where, what) if dash else math.inf,
        )

    def sentence(self) -> str:
        """What is silent and when, in words."""
        until = "on" if math.isinf(self.until_s) else f"to {_shown(self.until_s)} s"
        return f"no samples of {self.of} from {_shown(self.from_s)} s {until}"

    @property
    def group(self) -> str:
        """Group of channels that is silent."""
        return GROUP_OF_KIND.get(str(self.of), str(self.of))


def _shown(time_s: float) -> str:
    """A time in s of four digits at most, in full from there on."""
    return f"{float(f'{time_s:.4g}'):g}"


def fault_rows(
    faults: Sequence[Fault], vehicle: Vehicle, max_time_s: float, *, case: int = 0
) -> list[tuple[int, str, float, float]]:
    """Rows (case, actuator, time in s, command or nan) of a case, as the core takes them."""
    facts = vehicle.actuator_info()
    rows: list[tuple[int, str, float, float]] = []
    for fault in faults:
        name = fault.actuator
        if name not in facts:
            raise SimulationError(
                f'faults: the vehicle {vehicle.name} has no actuator "{name}"{nearest(name, facts)}'
            )
        if any(name == other for _, other, _, _ in rows):
            raise SimulationError(f"faults: {name} fails twice; the first failure lasts, give one of them")
        if not is_number(fault.at_s) or not 0.0 <= fault.at_s <= max_time_s:
            raise SimulationError(
                f"faults: {name}: expected a time within the flight, 0 to {max_time_s:.0f} s,"
                f" found {fault.at_s if is_number(fault.at_s) else repr(fault.at_s)}"
            )
        if fault.stuck and fault.stuck_at is not None:
            raise SimulationError(f"faults: {name}: give stuck or stuck_at, not both")
        rows.append((case, name, float(fault.at_s), _command(fault, facts[name])))
    return rows


def _command(fault: Fault, facts: dict[str, Any]) -> float:
    """The command that the actuator keeps: neutral when dead, nan where it is."""
    if fault.stuck:
        return math.nan
    neutral = float(facts["neutral"])
    if fault.stuck_at is None:
        return neutral
    astern, ahead = float(facts["maximum_astern"]), float(facts["maximum_ahead"])
    if facts["reversed"]:
        astern, ahead = ahead, astern
    if not is_number(fault.stuck_at) or not neutral - astern <= fault.stuck_at <= neutral + ahead:
        raise SimulationError(
            f"faults: {fault.actuator}: stuck_at: expected {neutral - astern:g} to {neutral + ahead:g}"
            f" {facts['unit']}, found {fault.stuck_at!r}"
        )
    return float(fault.stuck_at)


def outage_rows(outages: Sequence[Outage], max_time_s: float) -> list[tuple[int, float, float]]:
    """Rows (group, from, until in s) as the core takes them."""
    groups = autopilot_names()["groups"]
    rows = []
    for outage in outages:
        name = outage.group
        if name not in groups:
            known = [*groups, *(kind for kind in GROUP_OF_KIND if kind not in groups)]
            raise SimulationError(
                f'outages: there is no group or kind of sensor "{outage.of}"{nearest(str(outage.of), known)}'
            )
        if not (is_number(outage.from_s) and is_number(outage.until_s)):
            raise SimulationError(
                f"outages: {outage.of}: expected times in s, found {outage.from_s!r} and {outage.until_s!r}"
            )
        if not 0.0 <= outage.from_s < outage.until_s:
            raise SimulationError(
                f"outages: {outage.of}: expected a beginning from 0 on and a later end, found"
                f" {outage.from_s:g} to {outage.until_s:g} s"
            )
        if outage.from_s > max_time_s:
            raise SimulationError(
                f"outages: {outage.of}: expected a beginning within the flight, 0 to {max_time_s:.0f} s,"
                f" found {outage.from_s:g}"
            )
        rows.append((groups.index(name), float(outage.from_s), float(outage.until_s)))
    return rows


def _number(text: str, where: str, expected: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise SimulationError(f"{where}: expected {expected}, found {text!r}")
    return number
