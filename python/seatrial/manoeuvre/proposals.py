"""Proposals: the repertoire at the amplitudes and durations that fit into given limits.

Each manoeuvre is tried at full amplitude and then at less until it fits; where the area or the depth is too
small for the whole duration, shorter ones are tried too, which are sailed several times instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from seatrial._core import Vehicle
from seatrial.check.actuators import NOMINAL_V
from seatrial.check.stability import statics
from seatrial.manoeuvre import repertoire
from seatrial.manoeuvre.decay import free_decay
from seatrial.manoeuvre.definition import Manoeuvre
from seatrial.manoeuvre.drive import AHEAD, Drive, Thrusters
from seatrial.manoeuvre.forecast import Forecast, Limits, forecast, uneven

__all__ = ["Proposal", "proposals"]

_AMPLITUDES = (0.9, 0.65, 0.45, 0.3, 0.2, 0.14, 0.1, 0.07, 0.05)
_SMALL = 0.4  # of the largest amplitude that fits: the second one proposed
_PARTS = (1, 2, 4)
_SHORTEST_S = 20.0
_ANGLES_DEG = (30.0, 20.0, 10.0)
_PERIODS, _LEAST_DECAY_S, _LONGEST_DECAY_S = 6.0, 15.0, 90.0
_RISE_S = 40.0

Build = Callable[[float, float], Manoeuvre]


@dataclass(frozen=True)
class Proposal:
    """A manoeuvre with its forecast and the share of the thrust that it uses; 0 for a free decay."""

    manoeuvre: Manoeuvre
    forecast: Forecast
    amplitude: float = 0.0


def proposals(
    vehicle: Vehicle, *, duration_s: float, limits: Limits | None = None, voltage_v: float = NOMINAL_V
) -> tuple[list[Proposal], dict[str, str]]:
    """Manoeuvres that fit into the limits, and why the others do not, by name.

    Parameters
    ----------
    vehicle : Vehicle
    duration_s : float
        Length of the longest, s.
    limits : Limits, optional
    voltage_v : float
        Supply voltage at which tables of thrust are read, V.

    Examples
    --------
    >>> import seatrial as st
    >>> found, refused = proposals(
    ...     st.Vehicle.load("cwolf"), duration_s=60.0, limits=Limits(depth_m=10.0, area_m=(30.0, 30.0)))
    >>> max(proposal.forecast.deepest_m for proposal in found) <= 10.0
    True
    """
    limits = limits or Limits()
    thrusters, other = Thrusters(vehicle, voltage_v=voltage_v), uneven(vehicle)
    found: list[Proposal] = []
    refused: dict[str, str] = {}
    for build in _sketches(thrusters):
        fitting, reason = _fitted(build, vehicle, other, limits, duration_s, voltage_v)
        found += fitting
        if not fitting:
            refused[build(duration_s, _AMPLITUDES[0]).name] = reason
    for manoeuvre in _decays(thrusters, duration_s, limits):
        seen = forecast(manoeuvre, vehicle, other, limits=limits, voltage_v=voltage_v)
        if seen.excess is None:
            found.append(Proposal(manoeuvre, seen))
        else:
            refused[manoeuvre.name] = seen.excess
    return found, refused


def _fitted(
    build: Build, vehicle: Vehicle, other: Vehicle, limits: Limits, duration_s: float, voltage_v: float
) -> tuple[list[Proposal], str]:
    """Versions of a manoeuvre that fit: whole, then shorter, each large and small; or why none does."""

    def tried(span: float, amplitude: float) -> Proposal:
        manoeuvre = build(span, amplitude)
        seen = forecast(manoeuvre, vehicle, other, limits=limits, voltage_v=voltage_v)
        return Proposal(manoeuvre, seen, amplitude)

    found: list[Proposal] = []
    reason, largest = "", 0.0
    pause = build(duration_s, _AMPLITUDES[0]).pause_s
    for parts in _PARTS:
        span = (duration_s - (parts - 1) * pause) / parts
        if largest == _AMPLITUDES[0] or (parts > 1 and span < _SHORTEST_S):
            break
        fits = tried(span, _AMPLITUDES[0])
        reason = fits.forecast.excess or reason
        low, high = 1, len(_AMPLITUDES)
        while fits.forecast.excess and low < high:  # bisection: what is smaller fits better
            middle = (low + high) // 2
            one = tried(span, _AMPLITUDES[middle])
            reason = one.forecast.excess or reason
            low, high = (middle + 1, high) if one.forecast.excess else (low, middle)
            if low == high < len(_AMPLITUDES):
                fits = tried(span, _AMPLITUDES[low])
        # What is shorter is only better where it can be larger.
        if fits.forecast.excess is None and fits.amplitude > largest:
            largest = fits.amplitude
            small = tried(span, round(_SMALL * largest, 3))
            found += [fits, *([small] if small.forecast.excess is None else [])]
    return found, reason


def _sketches(thrusters: Thrusters) -> Iterator[Build]:
    """Builders by duration and amplitude of all that the vehicle's drives can do."""

    def of(make: Callable[..., Manoeuvre], what: object, **fixed: object) -> Build:
        return lambda span, size: make(thrusters, what, duration_s=span, amplitude=size, **fixed)

    surge = bool(thrusters.drives_of("X"))
    for drive in thrusters.drives:
        yield of(repertoire.staircase, drive)
        if drive.axis == "X":
            yield of(repertoire.staircase, drive, both=False)
        yield of(repertoire.coast_down, drive)
        yield of(repertoire.multisine, [drive])
        vertical = drive.axis in "ZM"
        if vertical:
            yield of(repertoire.dive, drive)
        for ahead in AHEAD if surge and drive.axis != "X" else ():
            yield of(repertoire.dive if vertical else repertoire.zigzag, drive, ahead=ahead)
            if drive.axis == "N":
                yield of(repertoire.spiral, drive, ahead=ahead)
    together = _one_per_axis(thrusters)
    if len(together) > 1:
        yield of(repertoire.multisine, together)
        for ahead in AHEAD if surge else ():
            yield of(repertoire.multisine, together, ahead=ahead)


def _one_per_axis(thrusters: Thrusters) -> list[Drive]:
    """The purest drive of every axis."""
    return [drives[0] for axis in "XYZKMN" if (drives := thrusters.drives_of(axis))]


def _decays(thrusters: Thrusters, duration_s: float, limits: Limits) -> Iterator[Manoeuvre]:
    """Free decays of what has a righting moment, and of heave where the vehicle rises or sinks."""
    rest = statics(thrusters.vehicle)
    ways = (None, "half") if thrusters.drives_of("X") else (None,)
    angle = max((a for a in _ANGLES_DEG if a <= 0.9 * limits.tilt_deg), default=0.5 * limits.tilt_deg)
    for axis, period in (("K", rest.roll_period_s), ("M", rest.pitch_period_s)):
        if period is None:
            continue
        span = min(max(_PERIODS * period, _LEAST_DECAY_S), _LONGEST_DECAY_S, duration_s)
        for ahead in ways:
            yield free_decay(thrusters, axis, duration_s=span, angle_deg=angle, ahead=ahead)
    if abs(rest.net_n) > 1e-4 * rest.weight_n:
        yield free_decay(thrusters, "Z", duration_s=min(_RISE_S, duration_s))
