"""Operating points that no gains hold: there a motion grows whatever the loops do.

A hull that its flow upsets in pitch, without an actuator for pitch, tumbles above some speed with any gains
of the other loops. Margins that are asked for there cannot be had, and a search for them would only drive
the gains from bound to bound. A point counts as beyond all gains where a motion grows with the start gains,
and with every set within the bounds that a search for the slowest growth tries: each gain of the point's
loops by a factor of its own. It takes no flight.

Held by tests/tuning/test_holdable.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.estimation.search import evolve
from seatrial.tuning.gain_parameters import GainParameters

if TYPE_CHECKING:
    from seatrial.control_design.margin_constraint import MarginConstraint

_POPULATION, _GENERATIONS, _TOLERANCE = 32, 100, 1e-2


def beyond_gains(
    limits: MarginConstraint, start: Mapping[str, float], *, bounds: tuple[float, float]
) -> tuple[tuple[str, float], ...]:
    """Points (mode, speed in m/s) of some limits that no gains within the bounds keep stable.

    Parameters
    ----------
    limits : MarginConstraint
        Of the autopilot; points where no margin is asked for are left out.
    start : mapping of str to float
        Start gains, by the names of `Autopilot.gains`.
    bounds : (float, float)
        Of the factors on the start gains.

    Examples
    --------
    >>> import seatrial as st
    >>> from seatrial.control_design.margin_constraint import MarginConstraint
    >>> autopilot = st.Autopilot.load("cwolf")
    >>> limits = MarginConstraint(st.Vehicle.load("cwolf"), autopilot, [3.021])
    >>> beyond_gains(limits, autopilot.gains(), bounds=(0.1, 10.0))
    ()
    """
    beyond = []
    for mode, speed in limits.points:
        point = limits.only([(mode, speed)])
        grows = limits.limits.at(speed).any and float(point.growth({})[0]) > 0.0
        if grows and _slowest_growth(point, start, bounds) > 0.0:
            beyond.append((mode, speed))
    return tuple(beyond)


def _slowest_growth(
    point: MarginConstraint, start: Mapping[str, float], bounds: tuple[float, float]
) -> float:
    """Least rate of growth at a single point over factors on its loops' gains, 1/s."""
    parameters = GainParameters(())
    for loop in point.loops:
        parameters += GainParameters.of_loop(loop, start, free=[0], reached=[0], bounds=bounds)
    if not len(parameters):
        return float(point.growth({})[0])
    least = np.inf

    def growth(x: Array) -> Array:
        nonlocal least
        rates = point.growth(parameters.gains(x))
        least = min(least, float(rates.min()))
        return rates

    lower, upper = parameters.bounds
    evolve(
        growth,
        np.zeros(len(parameters)),
        lower=lower,
        upper=upper,
        seed=0,
        population=_POPULATION,
        generations=_GENERATIONS,
        tolerance=_TOLERANCE,
        enough=lambda: least == 0.0,
    )
    return least
