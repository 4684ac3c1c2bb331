"""What a tuning acts on: vehicle, autopilot, speeds and modes that count, gains as parameters of a search.

Held by tests/tuning/test_tuning_plan.py, test_tuning_draws.py and test_gain_parameters.py beside them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.control_design.operating_points import SETTINGS as MODE_TABLE_SETTINGS
from seatrial.control_design.operating_points import (
    autopilot_facts,
    breakpoint_speeds,
    reachable_points,
    top_speeds,
)
from seatrial.control_design.start_autopilot import steady_speed
from seatrial.control_design.tuning_table import TuningTable
from seatrial.tuning.step_trial import RIDES_ON, Rig, Samples
from seatrial.vehicle.actuators import LOOPS, NOMINAL_V, ROWS, reach

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.identification.fitted import Fitted


@dataclass(frozen=True)
class ScopeSettings:
    """Samples of a tuning, and what parameters of a search are worth."""

    #: Current of the samples as a share of the top speed, where the file gives none.
    current_share: float = 0.05
    #: Added to the seed of the samples: a verification's missions are other draws.
    seed_offset: int = 1_000_003
    #: Golden angle between the currents of successive samples, rad: from all sides, whatever their number.
    current_turn_rad: float = 2.399963
    speed_rounding: float = 0.005  #: Relative rounding of breakpoints, which have four digits.
    #: Least width of a factor's range on either side, where gains at both bounds leave it none.
    least_factor_width: float = 0.005


SETTINGS = ScopeSettings()


@dataclass(frozen=True, eq=False)
class TuningScope:
    """A vehicle and its autopilot under the table of a tuning."""

    table: TuningTable  #: The campaign's ``[tuning]``.
    fitted: Fitted  #: The vehicle and how well it is known.
    autopilot: Autopilot  #: With the start gains.
    #: `name`, `seed`: of the tuning; all its draws come from the seed.
    name: str = "tuning"
    seed: int = 0
    origin: str = ""  #: What the gains are tuned on, in words.
    #: The campaign file that asks for the tuning, kept with the results; None without one.
    given_text: str | None = None
    inputs: Mapping[str, str] = field(default_factory=dict)  #: SHA-256 of what the tuning reads, by name.

    @property
    def vehicle(self) -> Vehicle:
        """The best values."""
        return self.fitted.vehicle

    @property
    def sensors(self) -> str | None:
        """Name of a set of sensors or a file; None for perfect ones."""
        return None if self.table.sensors == "perfect" else self.table.sensors

    @cached_property
    def reached(self) -> NDArray[np.bool_]:
        """Whether the vehicle reaches each breakpoint, (6,)."""
        return reachable_points(self.vehicle, self.autopilot, voltage_v=self.supply_v)

    @cached_property
    def places(self) -> list[int]:
        """Breakpoints that it reaches, from 0."""
        return [int(i) for i in np.flatnonzero(self.reached)]

    @property
    def supply_v(self) -> float:
        """Supply voltage, V: that of the file, or the one at which tables of thrust are read."""
        return NOMINAL_V if self.table.voltage_v is None else self.table.voltage_v

    @cached_property
    def top_speeds(self) -> tuple[float, float]:
        """Top speeds astern and ahead, m/s."""
        return top_speeds(self.vehicle, voltage_v=self.supply_v)

    @property
    def top_m_s(self) -> float:
        """Top speed ahead, m/s."""
        return self.top_speeds[1]

    @property
    def current_m_s(self) -> float:
        """Speed of the samples' currents, m/s: a twentieth of the top speed where the file gives none."""
        given = self.table.current_m_s
        return SETTINGS.current_share * self.top_m_s if given is None else given

    def top_of(self, loop: str) -> float:
        """Largest steady speed of a loop's channel, m/s: sideways for sway, ahead for all others."""
        if loop != "sway" or "sway" not in autopilot_facts(self.autopilot).loops:
            return self.top_m_s
        ends = np.abs(reach(self.vehicle, 0.0, "Y", voltage_v=self.supply_v)["Y"])
        force = min(float(ends.min()), autopilot_facts(self.autopilot).loops["sway"]["tau_max"])
        return steady_speed(self.vehicle, np.zeros(6), ROWS.index("Y"), force)

    def largest_step(self, loop: str) -> float:
        """Largest step of a loop from its level set point in the file's unit, inf where nothing limits it:
        the pitch that guidance asks for, and 95 % of the top speed less the current.
        """
        if loop == "pitch":
            return float(autopilot_facts(self.autopilot).guidance["pitch_max_deg"])
        if loop == "sway":
            return MODE_TABLE_SETTINGS.speed_range_share * self.top_of(loop) - self.current_m_s
        return np.inf

    def modes_of(self, loop: str) -> list[tuple[float, float]]:
        """Speeds from and to which modes work whose set point of this loop moves, m/s."""
        modes = autopilot_facts(self.autopilot).modes
        ranges: list[tuple[float, float]] = []
        for k, mode in enumerate(modes):
            moves = {
                "pitch": mode.depth_by == "pitch",
                "depth": mode.depth_by == "pitch",
                "heave": mode.depth_by == "heave",
            }.get(loop, True)
            if RIDES_ON.get(loop, loop) in mode.loops and moves:
                begin = mode.from_speed_m_s if k else -np.inf
                end = modes[k + 1].from_speed_m_s if k + 1 < len(modes) else np.inf
                if ranges and ranges[-1][1] == begin:  # nothing changes for the loop there
                    begin = ranges.pop()[0]
                ranges.append((begin, end))
        return ranges

    @cached_property
    def slowest_m_s(self) -> float | None:
        """Least speed of level flight, m/s; None for a vehicle that hovers."""
        return slowest_level_m_s(self.vehicle, self.autopilot)

    def rig(
        self,
        autopilot: Autopilot,
        *,
        vehicle: Vehicle | None = None,
        max_step_s: float = 0.02,
        threads: int | None = None,
    ) -> Rig:
        """The closed loop of an autopilot, with the sensors of the campaign; the vehicle is by default that
        with the best values, which the autopilot takes it for.
        """
        return Rig(
            self.vehicle if vehicle is None else vehicle,
            self.vehicle,
            autopilot,
            sensors=self.sensors,
            max_step_s=max_step_s,
            voltage_v=self.table.voltage_v,
            threads=threads,
        )

    def samples(self, count: int, seed: int, *, nominal: int = 1) -> Samples:
        """The vehicle itself in still water, `nominal` times with other noise, then `count` drawn vehicles
        with a current from all sides.
        """
        size = nominal + count
        drawn = self.fitted.draws(count, seed + SETTINGS.seed_offset)
        own = self.fitted.vehicle.coefficients()
        values = {
            name: np.concatenate([np.full(nominal, own.get(name, 0.0)), column])
            for name, column in drawn.items()
        }
        bearing = SETTINGS.current_turn_rad * (seed % 997 + np.arange(size))
        current = self.current_m_s * np.stack([np.cos(bearing), np.sin(bearing), np.zeros(size)], axis=1)
        current[:nominal] = 0.0
        return Samples(values, current, tuple(range(seed * 1000 + 1, seed * 1000 + size + 1)), nominal)


def slowest_level_m_s(vehicle: Vehicle, autopilot: Autopilot) -> float | None:
    """Least speed ahead at which the vehicle holds its depth, m/s; None where a mode of it hovers."""
    facts = autopilot_facts(autopilot)
    if facts.hovers:
        return None
    used = {loop for mode in facts.modes for loop in mode.loops}
    rows = "".join(row for row, loop in zip(ROWS, LOOPS, strict=True) if loop in used)
    slowest = breakpoint_speeds(vehicle, rows, top_speeds(vehicle))[0]
    return slowest * (1.0 - SETTINGS.speed_rounding)


GAINS = ("K_P", "K_I", "K_D")


@dataclass(frozen=True)
class Parameter:
    """One factor: its name, and the start values of all that it scales, by name."""

    name: str
    starts: Mapping[str, float]
    lower: float
    upper: float


@dataclass(frozen=True)
class GainParameters:
    """Parameters of a search; candidates are logarithms of factors, (k, m).

    A parameter is one factor on a start gain for each breakpoint that the trials move. A point that no trial
    comes near goes with the nearest one that a trial does; one that the vehicle never reaches takes its value
    from the nearest one that it does. A gain that starts at zero stays there.
    """

    parameters: tuple[Parameter, ...]

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the factors."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the logarithms, (m,) each."""
        lower = np.log([parameter.lower for parameter in self.parameters])
        return lower, np.log([parameter.upper for parameter in self.parameters])

    def gains(self, x: Array) -> dict[str, Array]:
        """Gains of k candidates (k, m), by name, (k,) each."""
        factors = np.exp(np.atleast_2d(x))
        return {
            name: start * factors[:, place]
            for place, parameter in enumerate(self.parameters)
            for name, start in parameter.starts.items()
        }

    def through(self, gains: Mapping[str, float]) -> tuple[GainParameters, Array]:
        """The same factors on other gains (start values where not named), and the logarithms (m,) that give
        exactly these. What one factor scales keeps its ratio, and every gain the bounds about its own
        start value.
        """
        moved, logarithms = [], []
        for parameter in self.parameters:
            # The point that gave the parameter its name, or the first that it scales.
            name = parameter.name if parameter.name in parameter.starts else next(iter(parameter.starts))
            factor = float(
                np.clip(
                    gains.get(name, parameter.starts[name]) / parameter.starts[name],
                    parameter.lower,
                    parameter.upper,
                )
            )
            scaled = {key: gains.get(key, value) / factor for key, value in parameter.starts.items()}
            ratios = [scaled[key] / value for key, value in parameter.starts.items()]
            lower = min(parameter.lower / min(ratios), factor * (1.0 - SETTINGS.least_factor_width))
            upper = max(parameter.upper / max(ratios), factor * (1.0 + SETTINGS.least_factor_width))
            moved.append(Parameter(parameter.name, scaled, lower, upper))
            logarithms.append(np.log(factor))
        return GainParameters(tuple(moved)), np.array(logarithms)

    @classmethod
    def of_loop(
        cls,
        loop: str,
        gains: Mapping[str, float],
        *,
        free: Sequence[int],
        taken: Sequence[int] = (),
        reached: Sequence[int],
        bounds: tuple[float, float],
    ) -> GainParameters:
        """Factors on the gains of a loop from their start values: `free` breakpoints (from 0) get a factor of
        their own, `taken` ones are set by another search, `reached` are those that the vehicle reaches.

        Examples
        --------
        >>> start = {f"surge.K_P.{i}": 10.0 * i for i in range(1, 7)}
        >>> found = GainParameters.of_loop("surge", start, free=[2, 3], reached=[2, 3, 4], bounds=(0.1, 10.0))
        >>> [dict(one.starts) for one in found.parameters]  # doctest: +NORMALIZE_WHITESPACE
        [{'surge.K_P.1': 30.0, 'surge.K_P.2': 30.0, 'surge.K_P.3': 30.0},
         {'surge.K_P.4': 40.0, 'surge.K_P.5': 50.0, 'surge.K_P.6': 50.0}]
        """
        points = sorted({
            int(name.rpartition(".")[2]) - 1 for name in gains if name.startswith(f"{loop}.K_P.")
        })

        def nearest(point: int, among: Iterable[int]) -> int:
            return min(among, key=lambda other: (abs(other - point), other))

        parameters = []
        for gain in GAINS:
            starts: dict[int, dict[str, float]] = {place: {} for place in free}
            for point in points:
                # A point beyond the top speed is never flown: it takes the gain of the nearest that is.
                own = point if point in reached else nearest(point, reached)
                if own in taken or not free:
                    continue
                value = gains.get(f"{loop}.{gain}.{own + 1}", 0.0)
                # One factor moves a free point and all that follow it.
                if value > 0.0:
                    starts[own if own in free else nearest(own, free)][f"{loop}.{gain}.{point + 1}"] = value
            parameters += [
                Parameter(f"{loop}.{gain}.{place + 1}", scaled, *bounds)
                for place, scaled in starts.items()
                if scaled
            ]
        return cls(tuple(parameters))

    @classmethod
    def of_number(cls, name: str, start: float, bounds: tuple[float, float]) -> GainParameters:
        """A factor on one number: a reference filter, a lookahead; none where it is zero."""
        return cls((Parameter(name, {name: start}, *bounds),) if start > 0.0 else ())

    def __add__(self, other: GainParameters) -> GainParameters:
        return GainParameters(self.parameters + other.parameters)


def excited_points(speeds_m_s: Iterable[float], points_m_s: Sequence[float]) -> list[int]:
    """Breakpoints (from 0) whose gains trials at some speeds tell of."""
    excited = set()
    for speed in speeds_m_s:
        for point in range(len(points_m_s)):
            weight = np.interp(speed, points_m_s, np.eye(len(points_m_s))[point])
            if weight >= 0.2:  # least weight of a point at the speed of a trial that tells of its gains
                excited.add(point)
    return sorted(excited)
