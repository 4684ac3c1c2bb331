"""Margins of thousands of candidate gains at once, and by how much they fall short of their limits.

What the laws see of the linear motion does not depend on the gains: it is solved once per breakpoint and
mode. A candidate is then a weighted sum over K_P, K_I, K_D and the restoring feed-forward, whose rows the
margin engine opens (`seatrial.control_design.margins`). Stability comes from the eigenvalues of Phi - Gamma
K. Sensors are a dead time (`seatrial.control_design.operating_points`).

The shortfall of a loop at a point is the largest of 1 - margin/limit over its margins, 0 where all hold and 1
where one is used up, which is the edge of stability. That of a point is the largest of its loops, or 1 + 10 s
times sigma where a motion grows with the rate sigma in 1/s, and 0.3 of the others'; that of a candidate is
the sum over the points. Held by tests/control_design/test_margin_constraint.py and
tests/control_design/test_margin_shortfall.py.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, nearest
from seatrial.control_design.loops import ROW_OF, LoopGain, closed, feedback, law, responses
from seatrial.control_design.margins import (
    LoopMargins,
    decibel,
    frequencies,
    loop_margins,
    neutral_radius,
    open_each,
)
from seatrial.control_design.operating_points import (
    AutopilotFacts,
    ModeLoop,
    autopilot_facts,
    measurement_delays,
    mode_loop,
    operating_points,
    reachable_speeds,
    refuse_other_laws,
)
from seatrial.control_design.tuning_table import Margins

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.sensors.sensor import Sensor

Complex = NDArray[np.complex128]

Gains = Mapping[str, ArrayLike]

_KEYS = ("K_P", "K_I", "K_D")


@dataclass(frozen=True)
class MarginConstraintSettings:
    """How margins of many candidates are computed and weighed."""

    #: Number of frequencies, 12 per octave: within 1 % of python-control on four times as many.
    frequencies: int = 180
    batch_candidates: int = 64  #: Candidates of a batch: their responses lie in the cache at once.
    #: Time, s, in which a motion grows e-fold that counts as much as a margin that is used up.
    growth_weight_s: float = 10.0
    #: Share of the shortfalls beside the largest that is added: no other loop gives its own away.
    other_loops_share: float = 0.3


SETTINGS = MarginConstraintSettings()


@dataclass(frozen=True, eq=False)
class PointMargins:
    """Margins of k candidates in a mode at a desired speed in m/s, per loop."""

    #: `mode`, `speed_m_s`, `loops`: the point and its n loops.
    mode: str
    speed_m_s: float
    loops: tuple[str, ...]
    #: Margins of each loop opened alone, (k, n) each; distances from the edge, on whichever side.
    of: LoopMargins
    growth_per_s: Array  #: Rate at which the fastest motion grows, (k,) in 1/s; 0 where none does.

    def shortfall(self, limits: Margins) -> Array:
        """By how much the margins fall short (k,): 0 where the limits hold or are 0, above 1 unstable."""
        if not limits.at(self.speed_m_s).any:
            return np.zeros(len(self.growth_per_s))
        worst = self.lacking(limits)
        # The others count, too: behind one that is short another one could give its own away.
        largest = worst.max(axis=1)
        others = SETTINGS.other_loops_share * (worst.sum(axis=1) - largest)
        grown = np.where(self.growth_per_s > 0.0, 1.0 + SETTINGS.growth_weight_s * self.growth_per_s, largest)
        return np.asarray(grown + others)

    def lacking(self, limits: Margins) -> Array:
        """By how much each loop's own margins fall short (k, n): 0 where all hold, 1 where one is used up."""
        asked = limits.at(self.speed_m_s)
        worst = np.zeros(self.of.phase_deg.shape)
        for margin, limit in (
            (self.of.phase_deg, asked.phase_deg),
            (decibel(self.of.gain), asked.gain_db),
            (decibel(self.of.reduction), asked.gain_db),
            (self.of.delay_s, asked.delay_s),
        ):
            if limit > 0.0:
                worst = np.maximum(worst, 1.0 - margin / limit)
        return worst


class MarginConstraint:
    """Limits on the margins of an autopilot's loops on a vehicle's model, for many candidates of its gains at
    once.

    At desired speeds in m/s, by default the breakpoints that the vehicle reaches, every mode that can work
    there counts, and at every switching speed between them both modes. The loops bear latency and interval of
    the sensors; perfect ones when missing. Raises `CampaignError` for a regulator in place of PID loops, or
    no speed.

    Examples
    --------
    >>> import seatrial as st
    >>> constraint = MarginConstraint(st.Vehicle.load("cwolf"), st.Autopilot.load("cwolf"), [0.881, 3.021])
    >>> constraint.points
    [('hover', 0.881), ('hover', 1.11), ('cruise', 1.11), ('cruise', 3.021)]
    >>> constraint.shortfall({"heading.K_P.4": [32.0, 3200.0]}) > 0.0
    array([False,  True])
    """

    def __init__(
        self,
        vehicle: Vehicle,
        autopilot: Autopilot,
        speeds_m_s: Sequence[float] | None = None,
        *,
        limits: Margins | None = None,
        sensors: Mapping[str, Sensor] | str | Path | None = None,
    ) -> None:
        refuse_other_laws(autopilot)
        facts = autopilot_facts(autopilot)
        if speeds_m_s is None:
            speeds_m_s = reachable_speeds(vehicle, autopilot)
        if not len(speeds_m_s):
            raise CampaignError(
                f"{autopilot.name}: expected breakpoints that {vehicle.name} reaches, found none;"
                " give schedule.speeds_m_s between its top speeds"
            )
        self.limits = limits or Margins()
        self.points = operating_points(facts, speeds_m_s)
        self._gains = {name: float(value) for name, value in autopilot.gains().items()}
        late = measurement_delays(sensors, vehicle)
        self._systems = [
            _Point(mode_loop(vehicle, facts, *point, measured_late_s=late), facts) for point in self.points
        ]

    def beside(self, gains: Mapping[str, float]) -> MarginConstraint:
        """The same limits where gains that a candidate does not name are these; no motion is solved again."""
        other = copy(self)
        other._gains = self._gains | {name: float(value) for name, value in gains.items()}
        return other

    def only(self, points: Collection[tuple[str, float]]) -> MarginConstraint:
        """The same limits at some of the points (mode, speed in m/s); no motion is solved again."""
        other = copy(self)
        kept = [k for k, point in enumerate(self.points) if point in points]
        other.points = [self.points[k] for k in kept]
        other._systems = [self._systems[k] for k in kept]
        return other

    @property
    def loops(self) -> tuple[str, ...]:
        """Loops at work at the points."""
        return tuple(dict.fromkeys(loop for point in self._systems for loop in point.at.loops))

    def growth(self, gains: Gains) -> Array:
        """Rate of the fastest motion that grows at any point, (k,) in 1/s; 0 where none does."""
        rates = [point.growth(weights) for point, weights in self._weighed(gains)]
        return np.asarray(np.max([np.zeros(self._count(gains)), *rates], axis=0))

    def margins(self, gains: Gains) -> list[PointMargins]:
        """Margins of k candidates, per point. Gains are (k,) or one for all, by the names of
        `Autopilot.gains`; others keep those of the autopilot. A CampaignError for a name that it does not
        have.
        """
        return [point.margins(weights) for point, weights in self._weighed(gains)]

    def open_loops(self, gains: Gains) -> list[tuple[Array, Complex]]:
        """Per point the frequencies (F,) in rad/s and each loop opened alone, the others closed, (k, n,
        F).
        """
        return [(point.omega, point.opened(weights)) for point, weights in self._weighed(gains)]

    def shortfall(self, gains: Gains) -> Array:
        """By how much k candidates fall short of the limits, (k,): 0 where all hold."""
        total = np.zeros(self._count(gains))
        for point in self.margins(gains):
            total += point.shortfall(self.limits)
        return total

    def _weighed(self, gains: Gains) -> list[tuple[_Point, Array]]:
        """Per point its K_P, K_I, K_D of every loop, (k, n, 3)."""
        count = self._count(gains)
        # A loop has the same gains at every point: one table per loop, and the points weigh it.
        tables: dict[str, Array] = {}
        for point in self._systems:
            for loop in point.at.loops:
                if loop not in tables:
                    tables[loop] = np.empty((len(_KEYS), len(point.shares), count))
                    for key, rows in zip(_KEYS, tables[loop], strict=True):
                        for place, row in enumerate(rows):
                            name = f"{loop}.{key}.{place + 1}"
                            row[:] = gains.get(name, self._gains[name])
        weighed = []
        for point in self._systems:
            given = np.array([tables[loop] for loop in point.at.loops])
            weighed.append((point, np.einsum("nbsk,s->knb", given, point.shares)))
        return weighed

    def _count(self, gains: Gains) -> int:
        lengths = {}
        for name, values in gains.items():
            if name not in self._gains:
                raise CampaignError(f'no gain "{name}"{nearest(name, self._gains)}')
            if np.ndim(values):
                lengths[name] = len(np.asarray(values))
        if len(set(lengths.values())) > 1:
            raise CampaignError(f"expected as many values of each gain, found {lengths}")
        return next(iter(lengths.values()), 1)


class _Point:
    """A mode at a speed: what each gain adds to the loops and to the step of the closed loop."""

    def __init__(self, at: ModeLoop, facts: AutopilotFacts) -> None:
        self.at, of = at, at.system
        self.shares = facts.shares(at.speed_m_s)
        self.omega = frequencies(of.period_s, SETTINGS.frequencies)
        seen = responses(of, self.omega)
        self.known = feedback(of, at.known)[:, of.seen] @ seen  # (F, n, n)
        self.step = closed(of, at.known)
        self.neutral = np.log(neutral_radius(of.period_s)) / of.period_s
        loops, steps = [], []
        for loop in at.loops:
            row = of.rows.index(ROW_OF[loop])
            for unit in np.eye(len(_KEYS)):
                gain = LoopGain(float(unit[0]), float(unit[1]), float(unit[2]), np.nan)
                own = feedback(of, law({loop: gain}, at.speed_m_s))
                loops.append((own[row, of.seen] @ seen).T)
                steps.append(np.outer(of.gamma[:, row], own[row]))
        shape = (len(at.loops), len(_KEYS), -1)
        self.loops = np.ascontiguousarray(loops).reshape(shape)  # each row's own gains: (n, 3, n F)
        self.steps = np.array(steps).reshape(len(steps), -1)

    def margins(self, weights: Array) -> PointMargins:
        """Margins of candidates with the gains weights (k, n, 3)."""
        batches = range(0, len(weights), SETTINGS.batch_candidates)
        parts = [
            loop_margins(self.opened(weights[begin : begin + SETTINGS.batch_candidates]), self.omega)
            for begin in batches
        ]
        return PointMargins(
            self.at.mode, self.at.speed_m_s, self.at.loops, LoopMargins.joined(parts), self.growth(weights)
        )

    def opened(self, weights: Array) -> Complex:
        """Each row's loop with the others closed, (k, n, F)."""
        count, n = weights.shape[:2]
        whole = np.empty((n, n, count, len(self.omega)), dtype=complex)
        for row in range(n):
            # A real product: the weights are.
            parts = (weights[:, row] @ self.loops[row].view(float)).view(complex)
            whole[row] = parts.reshape(count, n, -1).swapaxes(0, 1) + self.known[:, row].T[:, None]
        return np.ascontiguousarray(open_each(whole).swapaxes(0, 1))

    def growth(self, weights: Array) -> Array:
        """Rate of growth (k,) in 1/s of the fastest motion, 0 where none grows."""
        closed = self.step - (weights.reshape(len(weights), -1) @ self.steps).reshape(-1, *self.step.shape)
        radius = np.abs(np.linalg.eigvals(closed)).max(axis=1)
        growth: Array = np.maximum(np.log(radius) / self.at.system.period_s - self.neutral, 0.0)
        return growth
