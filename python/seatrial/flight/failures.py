"""What fails in a flight: actuators that die or stick, groups of channels that go silent.

Tests: ``tests/flight/test_fly.py``, ``tests/cli/test_cli_fly.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seatrial._core import autopilot_names
from seatrial.base.errors import SimulationError, nearest
from seatrial.flight.checks import is_number
from seatrial.flight.sensor_channels import GROUP_OF_KIND

if TYPE_CHECKING:
    from seatrial._core import Vehicle

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
        """Fault from ``ACTUATOR@TIME``, with ``=stuck`` or ``=VALUE`` behind it.

        Parameters
        ----------
        text : str

        Raises
        ------
        SimulationError
            It is not of this form.

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
        """Outage from ``GROUP@FROM-UNTIL`` or ``GROUP@FROM``.

        Parameters
        ----------
        text : str

        Raises
        ------
        SimulationError
            It is not of this form.

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
    """Rows (case, actuator, time in s, command or nan) of a case, as the core takes them.

    Raises SimulationError where the vehicle has no such actuator, or the fault is outside of the flight or of
    the actuator's range.
    """
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
    """Rows (group, from, until in s) as the core takes them.

    Raises SimulationError where there is no such group or kind of sensor, or the times are not in order or
    beyond the flight.
    """
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
