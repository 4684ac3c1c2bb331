"""Forecast of a manoeuvre: the depth, area and tilt it needs; and proposals that fit into given limits.

A manoeuvre is simulated twice: as planned, and with a vehicle whose sides push a little unevenly and that
starts a little tilted. Without feedback the second one drifts away; there must be room for both. The model
knows no surface, so the depth at the start follows from how far the vehicle rises.

Each proposed manoeuvre is tried at full amplitude and then at less until it fits. Where the area or the depth
is too small for the whole duration, shorter versions are tried too and repeated instead.

Held by ``tests/experiment/test_manoeuvre.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import State, Vehicle
from seatrial.base.channels import AXES
from seatrial.base.errors import DivergenceError, VehicleError
from seatrial.experiment import manoeuvre
from seatrial.experiment.combinations import AHEAD, Thrusters
from seatrial.experiment.manoeuvre import Manoeuvre, free_decay
from seatrial.vehicle.actuators import NOMINAL_V, voltage_for
from seatrial.vehicle.stability import statics

if TYPE_CHECKING:
    from seatrial._core import Run


@dataclass(frozen=True)
class ForecastSettings:
    """What a forecast flies, and which sizes of a manoeuvre are tried."""

    uneven: float = 0.03  #: How much the sides of the uneven vehicle push more and less, of their thrust.
    start_tilt_deg: float = 1.0  #: How much it is heeled and trimmed at the start besides, deg.
    steep_deg: float = 45.0  #: Tilt from which a forecast says so, deg.
    longest_step_s: float = 0.05  #: Longest step of a forecast's simulation, s.
    #: Shares of the largest commands, each about 0.7 of the one before; the largest within limits is taken.
    amplitudes: tuple[float, ...] = (0.9, 0.65, 0.45, 0.3, 0.2, 0.14, 0.1, 0.07, 0.05)
    small: float = 0.4  #: Of the largest amplitude that fits: the second one proposed.
    #: Runs that a manoeuvre is cut into where the limits do not admit it in one.
    parts: tuple[int, int, int] = (1, 2, 4)
    shortest_s: float = 20.0  #: A run is cut no shorter, s.
    decay_periods: float = 6.0  #: Natural periods that a decay is recorded for.
    shortest_decay_s: float = 15.0  #: Shortest decay, s.
    longest_decay_s: float = 90.0  #: Longest decay, s.


SETTINGS = ForecastSettings()


@dataclass(frozen=True)
class Limits:
    """Room for a manoeuvre; None is no limit."""

    depth_m: float | None = None  #: Greatest depth, m.
    area_m: tuple[float, float] | None = None  #: Area, m x m.
    tilt_deg: float = 60.0  #: Greatest heel and trim, deg.

    def __post_init__(self) -> None:
        for name, value in (("depth", self.depth_m), ("tilt", self.tilt_deg)):
            if value is not None and not value > 0.0:
                raise VehicleError(f"limits: expected a positive {name}, found {value:g}")
        if self.area_m is not None and not min(self.area_m) > 0.0:
            raise VehicleError(f"limits: expected an area of two positive lengths, found {self.area_m}")


@dataclass(frozen=True)
class Forecast:
    """What a manoeuvre takes, for both vehicles together.

    `along_m`, `across_m`: room along the course at the start and across it, hull included. `start_depth_m`,
    `deepest_m`: least depth of O to start at, and the greatest reached from there. `roll_deg`, `pitch_deg`,
    `speed_m_s`: largest heel, trim and speed. `drift_m`: largest distance between the two. `warnings`:
    sentences. `excess`: why it does not fit the limits; None if it does.
    """

    along_m: float
    across_m: float
    start_depth_m: float
    deepest_m: float
    roll_deg: float
    pitch_deg: float
    speed_m_s: float
    drift_m: float
    warnings: tuple[str, ...]
    excess: str | None


def simulated(
    vehicle: Vehicle, manoeuvre: Manoeuvre, *, voltage_v: float = NOMINAL_V, tilt_deg: float = 0.0
) -> Run:
    """Run of a manoeuvre from position zero; it starts heeled and trimmed by `tilt_deg` more."""
    start, t = manoeuvre.start, manoeuvre.t
    state = State(
        attitude=np.deg2rad([start.roll_deg + tilt_deg, start.pitch_deg + tilt_deg, 0.0]),
        nu=[start.surge_m_s, 0.0, 0.0, 0.0, 0.0, 0.0],
        actuators={name: float(values[0]) for name, values in manoeuvre.commands.items()},
    )
    return vehicle.simulate(
        t,
        dict(manoeuvre.commands),
        state,
        voltage_v=voltage_for(vehicle, t, voltage_v),
        max_step_s=SETTINGS.longest_step_s,
    )


def uneven(vehicle: Vehicle) -> Vehicle:
    """The vehicle with thrusters that push some per cent more on one side than on the other."""
    known = vehicle.coefficient_info()
    matrix = np.asarray(vehicle.allocation_matrix()).reshape(6, -1)
    gains = {}
    for k, name in enumerate(vehicle.actuators):
        if f"{name}.gain" not in known:
            continue
        # Yaw first: port against starboard; what does not turn the vehicle may pitch or heel it.
        turns = next((float(m) for m in (matrix[5, k], matrix[4, k], matrix[3, k]) if abs(m) > 1e-3), 1.0)
        gains[f"{name}.gain"] = vehicle.coefficients()[f"{name}.gain"] * (
            1.0 + SETTINGS.uneven * np.sign(turns)
        )
    return vehicle.with_coefficients(gains)


def forecast(
    manoeuvre: Manoeuvre,
    vehicle: Vehicle,
    other: Vehicle,
    *,
    limits: Limits | None = None,
    voltage_v: float = NOMINAL_V,
) -> Forecast:
    """Forecast of a manoeuvre for a vehicle and its `uneven` other."""
    limits = limits or Limits()
    try:
        runs = [
            simulated(vehicle, manoeuvre, voltage_v=voltage_v),
            simulated(other, manoeuvre, voltage_v=voltage_v, tilt_deg=SETTINGS.start_tilt_deg),
        ]
    except DivergenceError:
        none = float("nan")
        return Forecast(none, none, none, none, none, none, none, none, (), "the simulation diverges")
    # The worse of two vehicles counts: as modelled, and with uneven thrust and a tilt at the start.
    position = np.array([run.position for run in runs])
    euler = np.rad2deg([run.euler for run in runs])
    nu = np.array([run.nu for run in runs])
    # The place that the hull sweeps; the start is as deep as keeps it clear of the surface.
    measures = vehicle.geometry()
    hull = measures.get("length", 1.0)
    clearance = 2.0 * max(measures.get("diameter", 0.25), measures.get("height", 0.0))  # two diameters
    along, across = (float(np.ptp(position[:, :, axis])) + hull for axis in (0, 1))
    start_depth = clearance - float(position[:, :, 2].min())
    deepest = start_depth + float(position[:, :, 2].max())
    roll, pitch = (float(np.abs(euler[:, :, axis]).max()) for axis in (0, 1))
    # What the two differ by tells how far the plan can be trusted without feedback.
    drift = float(np.linalg.norm(position[0] - position[1], axis=1).max())
    path = float(np.linalg.norm(np.diff(position[0], axis=0), axis=1).sum())
    steep = SETTINGS.steep_deg
    warnings = [
        f"{word} above {steep:g} deg: {angle:.0f} deg"
        for word, angle in (("heel", roll), ("trim", pitch))
        if angle > steep
    ]
    if drift > max(2.0 * hull, 0.1 * path):
        warnings.append(
            f"open loop: thrust {100 * SETTINGS.uneven:.0f} % uneven and"
            f" {SETTINGS.start_tilt_deg:g} deg of tilt at the start end {drift:.0f} m off the plan"
        )
    if manoeuvre.start.roll_deg or manoeuvre.start.pitch_deg:
        warnings.append("hands or lines at the vehicle before each release" + _heavy(vehicle, manoeuvre))
    return Forecast(
        along_m=along,
        across_m=across,
        start_depth_m=start_depth,
        deepest_m=deepest,
        roll_deg=roll,
        pitch_deg=pitch,
        speed_m_s=float(np.linalg.norm(nu[0, :, :3], axis=1).max()),
        drift_m=drift,
        warnings=tuple(warnings),
        excess=_excess(limits, (along, across), deepest, max(roll, pitch)),
    )


def _excess(limits: Limits, area: tuple[float, float], deepest: float, tilt: float) -> str | None:
    """Why something does not fit, None if it does."""
    if tilt > limits.tilt_deg:
        return f"it tilts by {tilt:.0f} deg"
    if limits.depth_m is not None and deepest > limits.depth_m:
        return f"it needs {deepest:.0f} m of depth"
    if limits.area_m is not None and any(
        wanted > given for wanted, given in zip(sorted(area), sorted(limits.area_m), strict=True)
    ):
        return f"it needs {area[0]:.0f} m x {area[1]:.0f} m"
    return None


def _heavy(vehicle: Vehicle, manoeuvre: Manoeuvre) -> str:
    """What it takes to tilt a vehicle that is heavy to tilt."""
    start = manoeuvre.start
    attitude = np.deg2rad([start.roll_deg, start.pitch_deg, 0.0])
    moments = np.asarray(vehicle.forces(np.zeros(6), attitude)["restoring"])[3:]
    size = float(np.linalg.norm(moments))
    # Such a tilt takes more than hands.
    return f", {size:.0f} N m: a line to a boat or shifted ballast" if size > 60.0 else ""


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
    """Manoeuvres up to this duration that fit into the limits, and why the others do not, by name."""
    limits = limits or Limits()
    thrusters, other = Thrusters(vehicle, voltage_v=voltage_v), uneven(vehicle)
    accepted: list[Proposal] = []
    refused: dict[str, str] = {}
    for build in _sketches(thrusters):
        fitting, reason = _fitted(build, vehicle, other, limits, duration_s, voltage_v)
        accepted += fitting
        if not fitting:
            refused[build(duration_s, SETTINGS.amplitudes[0]).name] = reason
    for decay in _decays(thrusters, duration_s, limits):
        seen = forecast(decay, vehicle, other, limits=limits, voltage_v=voltage_v)
        if seen.excess is None:
            accepted.append(Proposal(decay, seen))
        else:
            refused[decay.name] = seen.excess
    return accepted, refused


def _fitted(
    build: Build, vehicle: Vehicle, other: Vehicle, limits: Limits, duration_s: float, voltage_v: float
) -> tuple[list[Proposal], str]:
    """Versions of a manoeuvre that fit: whole, then shorter, each large and small; or why none does."""

    def tried(span: float, amplitude: float) -> Proposal:
        manoeuvre = build(span, amplitude)
        seen = forecast(manoeuvre, vehicle, other, limits=limits, voltage_v=voltage_v)
        return Proposal(manoeuvre, seen, amplitude)

    accepted: list[Proposal] = []
    reason, largest = "", 0.0
    pause = build(duration_s, SETTINGS.amplitudes[0]).pause_s
    for parts in SETTINGS.parts:
        span = (duration_s - (parts - 1) * pause) / parts
        if largest == SETTINGS.amplitudes[0] or (parts > 1 and span < SETTINGS.shortest_s):
            break
        fits = tried(span, SETTINGS.amplitudes[0])
        reason = fits.forecast.excess or reason
        low, high = 1, len(SETTINGS.amplitudes)
        while fits.forecast.excess and low < high:  # bisection: what is smaller fits better
            middle = (low + high) // 2
            smaller = tried(span, SETTINGS.amplitudes[middle])
            reason = smaller.forecast.excess or reason
            low, high = (middle + 1, high) if smaller.forecast.excess else (low, middle)
            if low == high < len(SETTINGS.amplitudes):
                fits = tried(span, SETTINGS.amplitudes[low])
        # What is shorter is only better where it can be larger.
        if fits.forecast.excess is None and fits.amplitude > largest:
            largest = fits.amplitude
            small = tried(span, round(SETTINGS.small * largest, 3))
            accepted += [fits, *([small] if small.forecast.excess is None else [])]
    return accepted, reason


def _sketches(thrusters: Thrusters) -> Iterator[Build]:
    """Builders by duration and amplitude of all that the vehicle's combinations can do."""

    def of(make: Callable[..., Manoeuvre], what: object, **fixed: object) -> Build:
        return lambda span, size: make(thrusters, what, duration_s=span, amplitude=size, **fixed)

    surge = bool(thrusters.drivers)
    for combination in thrusters.combinations:
        vertical = combination.axis in "ZM"
        if not combination.needs_way:
            yield of(manoeuvre.staircase, combination)
            if combination.axis == "X":
                yield of(manoeuvre.staircase, combination, both=False)
            yield of(manoeuvre.coast_down, combination)
            yield of(manoeuvre.multisine, [combination])
            if vertical:
                yield of(manoeuvre.dive, combination)
        for ahead in AHEAD if surge and combination.axis != "X" else ():
            yield of(manoeuvre.dive if vertical else manoeuvre.zigzag, combination, ahead=ahead)
            if combination.axis == "N":
                yield of(manoeuvre.spiral, combination, ahead=ahead)
            if combination.needs_way:
                yield of(manoeuvre.multisine, [combination], ahead=ahead)
    for ahead in (None, *(AHEAD if surge else ())):
        # The purest combination of every axis, at rest or under way.
        usable = ([c for c in thrusters.combinations_of(axis) if ahead or not c.needs_way] for axis in AXES)
        together = [combinations[0] for combinations in usable if combinations]
        if len(together) > 1:
            yield of(manoeuvre.multisine, together, ahead=ahead)


def _decays(thrusters: Thrusters, duration_s: float, limits: Limits) -> Iterator[Manoeuvre]:
    """Free decays of what has a righting moment, and of heave where the vehicle rises or sinks."""
    rest = statics(thrusters.vehicle)
    ways = (None, "half") if thrusters.drivers else (None,)
    # The largest release well inside the limits is taken.
    angle = max((a for a in (30.0, 20.0, 10.0) if a <= 0.9 * limits.tilt_deg), default=0.5 * limits.tilt_deg)
    for axis, period in (("K", rest.roll_period_s), ("M", rest.pitch_period_s)):
        if period is None:
            continue
        span = min(
            max(SETTINGS.decay_periods * period, SETTINGS.shortest_decay_s),
            SETTINGS.longest_decay_s,
            duration_s,
        )
        for ahead in ways:
            yield free_decay(thrusters, axis, duration_s=span, angle_deg=angle, ahead=ahead)
    if abs(rest.net_n) > 1e-4 * rest.weight_n:
        yield free_decay(thrusters, "Z", duration_s=min(40.0, duration_s))  # a free rise takes no longer
