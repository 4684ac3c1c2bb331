"""Gains as parameters of a search: factors on the start gains of breakpoints, and numbers of guidance.

A parameter is one factor on a start gain for each breakpoint that the trials move, searched by its
logarithm. A point that no trial comes near goes with the nearest one that a trial does; a point that the
vehicle never reaches takes its value from the nearest one that it does. A gain that starts at zero stays
there.

Held by tests/tuning/test_gain_parameters.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array

GAINS = ("K_P", "K_I", "K_D")

_LEAST_WIDTH = 0.005  # of a factor on either side, where gains at both bounds leave it none


@dataclass(frozen=True)
class Parameter:
    """One factor: its name, and the start values of all that it scales, by name."""

    name: str
    starts: Mapping[str, float]
    lower: float
    upper: float


@dataclass(frozen=True)
class GainParameters:
    """Parameters of a search; candidates are logarithms of factors, (k, m)."""

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
        """The same factors on other gains, and the logarithms (m,) that give exactly these.

        What one factor scales keeps its ratio among itself, and every gain within the bounds about its own
        start value. Gains that are not named are the start values.

        Examples
        --------
        >>> start = {"surge.K_P.1": 10.0, "surge.K_P.2": 20.0}
        >>> one = GainParameters.of_loop("surge", start, free=[0], reached=[0, 1], bounds=(0.1, 10.0))
        >>> now, x = one.through({"surge.K_P.1": 20.0, "surge.K_P.2": 20.0})
        >>> {name: round(float(values[0]), 9) for name, values in now.gains(x).items()}
        {'surge.K_P.1': 20.0, 'surge.K_P.2': 20.0}
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
            lower = min(parameter.lower / min(ratios), factor * (1.0 - _LEAST_WIDTH))
            upper = max(parameter.upper / max(ratios), factor * (1.0 + _LEAST_WIDTH))
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
        """Factors on the gains of a loop.

        Parameters
        ----------
        loop : str
        gains : mapping of str to float
            Start values, by the names of `Autopilot.gains`.
        free : sequence of int
            Breakpoints (from 0) that get a factor of their own.
        taken : sequence of int
            Points that another search sets.
        reached : sequence of int
            Points that the vehicle reaches.
        bounds : (float, float)
            Of every factor.

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
    """Breakpoints (from 0) whose gains trials at some speeds tell of.

    Examples
    --------
    >>> excited_points([1.5, 3.0], [-5.0, -3.0, -1.0, 1.0, 3.0, 5.0])
    [3, 4]
    """
    excited = set()
    for speed in speeds_m_s:
        for point in range(len(points_m_s)):
            weight = np.interp(speed, points_m_s, np.eye(len(points_m_s))[point])
            if weight >= 0.2:  # least weight of a point at the speed of a trial that tells of its gains
                excited.add(point)
    return sorted(excited)
