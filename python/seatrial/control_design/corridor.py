"""Corridor of a set-point response: a lower and an upper piecewise-linear bound over the time since the step.

The response is normalised, ``y_n = (y - before)/(after - before)``: 0 before the step, 1 at the new set
point, whatever the step's size and direction. Times are in s since the step, bounds are shares of it. Two
points at the same time are a jump, and the later one holds at that time; before its first point a side has
no bound, after its last one it stays there until the corridor ends at ``until_s``.

Source: Taubert et al. (2014), figure 19 (corridor), (55)-(57); the staircase is that of the Nonlinear
Control Design Blockset; rise, overshoot and settling as in Ogata, *Modern Control Engineering* (2010),
section 5.3. Held by tests/control_design/test_corridor.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError


@dataclass(frozen=True)
class CorridorSettings:
    """What figures of a corridor mean where they are not given."""

    risen_share: float = 0.9  #: Share of the step at which a response has risen.
    settling_ratio: float = 2.0  #: Settling time over rise time where it is not given.
    end_ratio: float = 2.0  #: End of the corridor over settling time where it is not given.
    #: Times that differ by less are the same, s: 3 x 0.1 s is 0.3 s but for rounding.
    same_time_s: float = 1e-9


SETTINGS = CorridorSettings()

_ORDERED = ("rise_s", "settling_s", "settled", "steady")


@dataclass(frozen=True)
class Corridor:
    """Bounds of a normalised set-point response, with a weight per side.

    `lower`, `upper`: points (time since the step in s, share of the step) of a bound, by rising time; equal
    times are a jump, an empty bound is none. `target`: what the response goes to, 1 for a step, 0 for a
    channel that stays. Raises CampaignError for times that fall or begin before the step, bounds that cross,
    or weights below zero.

    Examples
    --------
    >>> corridor = Corridor([(0.0, -0.1), (10.0, -0.1), (10.0, 0.9), (40.0, 0.95)], [(0.0, 1.1)])
    >>> corridor.until_s
    40.0
    >>> lower, upper = corridor.sampled([0.0, 9.9, 10.0, 25.0, 50.0])
    >>> lower.tolist()
    [-0.1, -0.1, 0.9, 0.925, -inf]
    >>> upper.tolist()
    [1.1, 1.1, 1.1, 1.1, inf]
    """

    lower: Sequence[tuple[float, float]]
    upper: Sequence[tuple[float, float]]
    weight_lower: float = 1.0
    weight_upper: float = 1.0
    target: float = 1.0

    def __post_init__(self) -> None:
        for side in ("lower", "upper"):
            object.__setattr__(self, side, _checked(side, getattr(self, side)))
        if not self.lower and not self.upper:
            raise CampaignError("a corridor without lower and upper bound excludes nothing; give one of them")
        if self.until_s <= 0.0:
            raise CampaignError("a corridor ends at 0 s, when it begins; give a bound a later point")
        for side, weight in (("lower", self.weight_lower), ("upper", self.weight_upper)):
            if not (np.isfinite(weight) and weight >= 0.0):
                raise CampaignError(f"weight of the {side} bound: expected 0 or more, found {weight:g}")
        if self.weight_lower == self.weight_upper == 0.0:
            raise CampaignError("both weights of the corridor are 0; give one side a weight above 0")
        self._refuse_crossing()

    @classmethod
    def from_figures(
        cls,
        *,
        rise_s: float,
        overshoot: float = 0.1,
        settling_s: float | None = None,
        settled: float = 0.05,
        steady: float | None = None,
        until_s: float | None = None,
        undershoot: float = 0.1,
        dead_s: float = 0.0,
        weight_lower: float = 1.0,
        weight_upper: float = 1.0,
    ) -> Corridor:
        """Corridor of a step response by its usual figures: a staircase below and above.

        By `rise_s` 90 % of the step are reached, and not left again; from `settling_s` on (by default twice
        that) the response stays within `settled`, 0.1 at most, narrowing to `steady` over half the time to
        `until_s`, the end (by default twice `settling_s`). An `overshoot` that is less bounds it above;
        `undershoot` is the way that it may go wrong before it has risen. Rise and settling count from the end
        of the dead time `dead_s`. Shares are of the step. Raises CampaignError for figures that are out of
        range or contradict each other.

        Examples
        --------
        >>> corridor = Corridor.from_figures(rise_s=10.0, overshoot=0.1, settling_s=20.0, steady=0.03)
        >>> lower, upper = corridor.sampled([5.0, 15.0, 20.0, 30.0, 40.0])
        >>> lower.round(2).tolist()
        [-0.1, 0.9, 0.95, 0.97, 0.97]
        >>> upper.round(2).tolist()
        [1.1, 1.1, 1.05, 1.03, 1.03]
        """
        settling_s = SETTINGS.settling_ratio * rise_s if settling_s is None else settling_s
        risen, settles = dead_s + rise_s, dead_s + settling_s
        until_s = SETTINGS.end_ratio * settles if until_s is None else until_s
        steady = settled if steady is None else steady
        _refuse_figures(
            {"rise_s": rise_s, "settling_s": settling_s, "until_s": until_s}
            | {"settled": settled, "steady": steady},
            {"overshoot": overshoot, "undershoot": undershoot, "dead_s": dead_s},
        )
        if settles >= until_s:
            raise CampaignError(
                f"expected until_s after the response has settled at {settles:g} s, found {until_s:g};"
                " let the corridor end later"
            )
        # From settled to steady within half of what is left.
        half = 0.5 * (settles + until_s)
        above, at_end = min(overshoot, settled), min(overshoot, steady)
        return cls(
            # Two points at one time make a step of the bound.
            lower=(
                (0.0, -undershoot),
                (risen, -undershoot),
                (risen, SETTINGS.risen_share),
                (settles, SETTINGS.risen_share),
                (settles, 1.0 - settled),
                (half, 1.0 - steady),
                (until_s, 1.0 - steady),
            ),
            upper=(
                (0.0, 1.0 + overshoot),
                (settles, 1.0 + overshoot),
                (settles, 1.0 + above),
                (half, 1.0 + at_end),
                (until_s, 1.0 + at_end),
            ),
            weight_lower=weight_lower,
            weight_upper=weight_upper,
        )

    @classmethod
    def beside(cls, half_width: float = 1.0, *, until_s: float, weight: float = 1.0) -> Corridor:
        """Corridor of a channel that stays at its set point while another one steps: a band about 0.

        The half-width is in the unit of the response: 1 where the deviation is divided by it, so that what
        leaves the band counts alike whatever the channel's unit. Raises CampaignError where it or the end is
        not above zero.

        Examples
        --------
        >>> Corridor.beside(until_s=40.0).lower
        ((0.0, -1.0), (40.0, -1.0))
        """
        if not (np.isfinite(half_width) and half_width > 0.0):
            raise CampaignError(f"half-width of a band: expected more than 0, found {half_width:g}")
        return cls(
            lower=((0.0, -half_width), (until_s, -half_width)),
            upper=((0.0, half_width), (until_s, half_width)),
            weight_lower=weight,
            weight_upper=weight,
            target=0.0,
        )

    @property
    def until_s(self) -> float:
        """End of the corridor, s since the step."""
        return max(points[-1][0] for points in (self.lower, self.upper) if points)

    def sampled(self, t: ArrayLike) -> tuple[Array, Array]:
        """Lower and upper bound (n,) at times (n,) in s since the step, infinite where there is none: before
        the step and after ``until_s``. A time within 1 ns of a jump is at it.
        """
        at = np.asarray(t, dtype=float)
        return self._side(self.lower, at, -np.inf), self._side(self.upper, at, np.inf)

    def clock(self, t: ArrayLike) -> Array:
        """Time since the step (n,) in s that the tie-breaker weighs by: 0 before it and after ``until_s``."""
        at = np.asarray(t, dtype=float)
        return np.where((at >= 0.0) & (at <= self.until_s + SETTINGS.same_time_s), at, 0.0)

    def _side(self, points: Sequence[tuple[float, float]], at: Array, none: float) -> Array:
        if not points:
            return np.full(at.shape, none)
        times, values = np.array(points).T
        late = at + SETTINGS.same_time_s
        after = np.searchsorted(times, late, side="right")
        low, high = np.maximum(after - 1, 0), np.minimum(after, len(times) - 1)
        span = times[high] - times[low]
        share = np.clip((at - times[low]) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)
        bound = values[low] + share * (values[high] - values[low])
        return np.where((after > 0) & (at <= self.until_s + SETTINGS.same_time_s), bound, none)

    def _refuse_crossing(self) -> None:
        """Refuse bounds that cross: straight lines do so at a point or just before a jump."""
        times = np.unique([time for points in (self.lower, self.upper) for time, _ in points])
        # Just before a jump the earlier value holds, at it the later one.
        for at in np.sort(np.concatenate([times, times[times > 0.0] - 2.0 * SETTINGS.same_time_s])):
            lower, upper = (float(side) for side in self.sampled(at))
            if lower >= upper:
                raise CampaignError(
                    f"the bounds cross: at {at:.4g} s the lower one is {lower:g} and the upper one {upper:g};"
                    " keep lower below upper everywhere"
                )


def _checked(side: str, points: Iterable[Sequence[float]]) -> tuple[tuple[float, float], ...]:
    """Points of a bound as floats, by rising time."""
    checked = []
    for point in points:
        if len(point) != 2 or not np.isfinite(point).all():
            raise CampaignError(
                f"the {side} bound: expected points [time in s, share of the step], found {list(point)}"
            )
        checked.append((float(point[0]), float(point[1])))
    if checked and checked[0][0] < 0.0:
        raise CampaignError(f"the {side} bound begins {-checked[0][0]:g} s before the step; begin at 0 s")
    for (before, _), (time, _) in pairwise(checked):
        if time < before:
            raise CampaignError(
                f"times of the {side} bound: expected to rise, found {time:g} s after {before:g} s; sort them"
            )
    return tuple(checked)


def _refuse_figures(above_zero: dict[str, float], from_zero: dict[str, float]) -> None:
    for name, value in (above_zero | from_zero).items():
        if not (np.isfinite(value) and value >= 0.0) or (name in above_zero and value == 0.0):
            least = "more than 0" if name in above_zero else "0 or more"
            raise CampaignError(f"{name}: expected {least}, found {value:g}; correct the value")
    rise_s, settling_s, settled, steady = (above_zero[name] for name in _ORDERED)
    if settling_s < rise_s:
        raise CampaignError(
            f"settling_s = {settling_s:g} is before rise_s = {rise_s:g}; a response first rises, then settles"
        )
    if settled > 1.0 - SETTINGS.risen_share + 1e-12:
        raise CampaignError(f"settled = {settled:g} is wider than the 0.1 that the rise to 90 % leaves")
    if steady > settled:
        raise CampaignError(
            f"steady = {steady:g} is wider than settled = {settled:g}; the band narrows towards its end"
        )
