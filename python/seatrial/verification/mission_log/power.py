"""Which change of the model a log would have shown: per channel and coefficient group, as a factor.

A channel inside its band speaks for a model only where the log could have refuted it. The coefficients of an
axis form three groups (added mass; damping; lift and couplings), the actuators one per group of them. Each is
tried as a factor ``1 + theta`` on all its members, beside all other unknowns of the log with their stated
sizes (`seatrial.verification.mission_log.unknowns`), in the judged windows whole and in pieces of
``horizon_s``: a push shows within seconds, the damping of a slow mode after many.

Least squares with the priors of the unknowns (Schur complements, window by window) give theta, a score test
of each group. Its variance is that of the jackknife over windows or, where larger, that of white noise, with
Satterthwaite's degrees of freedom, as in `seatrial.statistics.significance`. With Student's t, sigma the
deviation of theta, and a level shared by G groups (Holm) and, within a group, by whole windows and pieces, in
each by all C channels together and by each of them alone,

    refuted:            |theta| > t(level / 8 G C) sigma   and   the factor is beyond ``material``,
    shown with 95 %:    |theta| >= max(t(level / 8 G C) sigma, material) + t(5 %) sigma.

The second, of a channel alone, is the smallest change that this channel would have shown. An axis is judged
where a channel would have shown a group of it halved and doubled (``shown``).

What no group explains shows in the error that is left at the best unknowns: beyond ``unexplained`` times the
noise, or, since the noise is known roughly and white noise is no larger in a longer window, beyond ``grown``
times as large in whole windows as in pieces.

Source: Rao (1948), Proc. Camb. Phil. Soc. 44:50 (score test); Kuensch (1989), Ann. Stat. 17:1217 (jackknife
of blocks); Satterthwaite (1946), Biometrics Bulletin 2:110.

Tests: ``tests/verification/test_recorded_power.py``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.base.plain import Plain
from seatrial.statistics.significance import holm
from seatrial.vehicle.actuators import actuator_groups
from seatrial.verification.mission_log.unknowns import (
    UNKNOWNS_SETTINGS,
    Point,
    Unknowns,
    explained_best,
    pieces,
    sensor_noise,
    swept,
    with_prior,
)

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.identification.fitted import Fitted
    from seatrial.verification.mission_log.spread import PredictedLog


@dataclass(frozen=True)
class PowerSettings:
    """When a log would have shown, or refutes, a group of coefficients."""

    #: Least factor, or its inverse, that refutes: the best model of a class that lacks something of the
    #: vehicle is off by what it lacks, in single groups by some percent, and still the best one.
    material: float = 1.25
    #: Error over noise beyond which a channel is not explained. The noise itself is known to within a factor
    #: of 1.7: held samples of a slow sensor look smoother than they are (a true BlueROV2 Heavy, slow DVL).
    unexplained: float = 2.0
    #: Error over noise up to which a channel is explained: true models of three vehicles leave 1.0 to 1.3.
    explained: float = 1.5
    #: Error of whole windows over that of their pieces beyond which it is no noise: true models of three
    #: vehicles leave 0.95 to 1.1.
    grown: float = 1.25
    #: A channel speaks for a group where the group doubled and halved would both have shown: gain margins of
    #: 6 dB forgive a factor of two in a loop and no more.
    shown: float = 2.0
    power: float = 0.95  #: Chance with which a change shows: the usual counterpart of intervals of 95 %.


SETTINGS = PowerSettings()
_ADDED = re.compile(r"[XYZKMN]_[uvwpqr]dot")
_OWN = {axis: re.compile(rf"{axis}_({own})\1?") for axis, own in zip("XYZKMN", "uvwpqr", strict=True)}
_ANY = re.compile(r"[XYZKMN]_[uvwpqr]{1,2}")


@dataclass(frozen=True)
class CoefficientGroup:
    """Coefficients that a factor scales together: of an axis (empty for actuators), of a kind."""

    axis: str
    kind: str
    names: tuple[str, ...]

    @property
    def words(self) -> str:
        """Name of the group for a sentence."""
        return f"{self.kind} of {self.axis}" if self.axis else self.kind


def coefficient_groups(vehicle: Vehicle, *, actuators: bool = True) -> tuple[CoefficientGroup, ...]:
    """Groups of a vehicle: per axis added mass, damping, lift and couplings; gains per group of actuators."""
    values = vehicle.coefficients()
    sorted_in: dict[tuple[str, str], list[str]] = {
        (axis, kind): [] for axis in "XYZKMN" for kind in ("added mass", "damping", "lift and couplings")
    }
    for name, value in values.items():
        axis = name[:1]
        if not value:
            continue
        if _ADDED.fullmatch(name):
            sorted_in[axis, "added mass"].append(name)
        elif _ANY.fullmatch(name):
            own = _OWN[axis].fullmatch(name)
            sorted_in[axis, "damping" if own else "lift and couplings"].append(name)
    groups = [CoefficientGroup(*key, tuple(names)) for key, names in sorted_in.items() if names]
    if actuators:
        facts = vehicle.actuator_info()
        for group, members in actuator_groups(vehicle).items():
            gains = tuple(f"{name}.gain" for name in members if values.get(f"{name}.gain"))
            fins = all(facts[name]["kind"] == "fin" for name in members)
            if gains:
                groups.append(CoefficientGroup("", f"{'lift' if fins else 'thrust'} of {group}", gains))
    return tuple(groups)


@dataclass(frozen=True)
class Shown:
    """Smallest change of a group that a channel would have shown with 95 % power, as factors.

    ``down`` is below one, ``up`` above; None where no factor of that side would have shown.
    """

    down: float | None
    up: float | None

    @property
    def size(self) -> float:
        """Factor up, for the order; infinite where no factor of one side would have shown."""
        return np.inf if self.up is None or self.down is None else self.up

    @property
    def enough(self) -> bool:
        """Whether the group halved and doubled would both have shown."""
        return (
            self.down is not None
            and self.down >= 1.0 / SETTINGS.shown
            and self.up is not None
            and self.up <= SETTINGS.shown
        )


@dataclass(frozen=True)
class GroupTest(
    Plain,
    without="group by_channel",
    also="axis=group.axis kind=group.kind coefficients=group.names shown=by_channel",
):
    """What a log says of a group.

    `group`: its coefficients. `factor`, `sigma`: factor on them that this log asks for beyond the stated
    intervals, and its standard deviation. `p`: of no change, adjusted over the groups (Holm). `refuted`:
    whether the factor is material and no chance. `by_channel`: smallest change that each channel alone would
    have shown. `against`: channels whose own estimate is as far off, where it is refuted.
    """

    group: CoefficientGroup
    factor: float
    sigma: float
    p: float
    refuted: bool
    by_channel: Mapping[str, Shown]
    against: tuple[str, ...]

    @property
    def best(self) -> str:
        """Channel that shows the smallest change; empty where none would have shown one of both sides."""
        able = [name for name, shown in self.by_channel.items() if shown.down is not None]
        return min(able, key=lambda name: self.by_channel[name].size, default="")

    @property
    def enough(self) -> bool:
        """Whether a channel would have shown the group halved and doubled."""
        return any(shown.enough for shown in self.by_channel.values())


@dataclass(frozen=True)
class Power(Plain, only="controlled_axes unjudged_axes windows left grown groups=tests"):
    """What a log could have refuted, and what it refutes.

    `tests`: a test per group. `controlled`: letters of the axes that the vehicle controls. `windows`: how
    many restarts it rests on. `left`: error of each channel over what noise, start and stated intervals
    explain: about one. `grown`: the same in whole windows over that in their pieces: about one.
    """

    tests: tuple[GroupTest, ...]
    controlled: str
    windows: int
    left: Mapping[str, float]
    grown: Mapping[str, float]

    @property
    def controlled_axes(self) -> list[str]:
        """The controlled axes, one by one."""
        return list(self.controlled)

    @property
    def unjudged_axes(self) -> list[str]:
        """The axes of `unjudged`, one by one."""
        return list(self.unjudged)

    @property
    def refuted(self) -> tuple[GroupTest, ...]:
        """Groups that the log refutes, the surest first."""
        refuted = (test for test in self.tests if test.refuted)
        return tuple(sorted(refuted, key=lambda test: -abs(test.factor - 1.0) / test.sigma))

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Channels whose error is far beyond the noise, or grows from piece to window, the farthest first."""
        beyond = (
            name
            for name, x in self.left.items()
            if x > SETTINGS.unexplained or self.grown[name] > SETTINGS.grown
        )
        return tuple(sorted(beyond, key=lambda name: -self.left[name]))

    def doubts(self, channel: str) -> bool:
        """Whether a share outside the band that is hardly chance is left to doubt the model by.

        Not where the channel could have refuted the model and its error is that of its noise.
        """
        explained = (
            self.left.get(channel, np.inf) <= SETTINGS.explained
            and self.grown.get(channel, np.inf) <= SETTINGS.grown
        )
        return not self.shown_in(channel) or not explained

    def shown_in(self, channel: str) -> tuple[GroupTest, ...]:
        """Groups of which a channel would have shown the half and the double, the best shown first."""
        able = [t for t in self.tests if channel in t.by_channel and t.by_channel[channel].enough]
        return tuple(sorted(able, key=lambda test: test.by_channel[channel].size))

    @property
    def unjudged(self) -> str:
        """Letters of the controlled axes of which no channel would have shown a group halved and doubled."""
        judged = {test.group.axis for test in self.tests if test.enough}
        return "".join(axis for axis in self.controlled if axis not in judged)


def group_power(
    known: Fitted,
    log: PredictedLog,
    *,
    offsets: Mapping[str, float],
    level: float,
    stated: Mapping[str, float] | None = None,
    hidden: str = "",
    water: bool = True,
    lacking: bool = False,
) -> Power:
    """Power and tests of the coefficient groups on the part of a log that is judged.

    `known`: the model, with the covariance of its coefficients. `log`: what is judged. `offsets`: standard
    deviation of the offset of each channel's sensor, SI. `level`: chance of a false alarm over all groups.
    `stated`: root mean square error of a valid model per channel, SI, as it was stated. `hidden`: letters of
    the axes whose channels tell nothing. `water`: whether the current is unknown: not logged, or fitted to
    this log. `lacking`: whether references tell what a valid model lacks. Within a piece it errs no more than
    the noise, and what that grows to in a whole window they tell. Without any, noise alone explains a whole
    window. Raises TrialError where no window can start.
    """
    whole, cut, first = pieces(log.without(hidden))
    controlled = "".join(log.vehicle.controllable) or "XYZKMN"
    groups = coefficient_groups(log.vehicle, actuators=log.input != "tau")
    nothing = Power((), controlled, len(whole.spans), {}, {})
    if len(whole.spans) < UNKNOWNS_SETTINGS.fewest_windows or not groups:
        return nothing
    noise = np.hypot(sensor_noise(log.trial), [(stated or {}).get(name, 0.0) for name in CHANNELS])
    judging = whole.channels if stated is None else [name for name in whole.channels if name in stated]
    used = [c for c in range(len(CHANNELS)) if CHANNELS[c] in judging and np.isfinite(noise[c])]
    if not used or not all(np.isfinite(shown).all() for shown in (*whole.predicted, *cut.predicted)):
        return nothing
    # The pieces first: whole windows begin with the starts and shared unknowns that pieces were fitted with.
    members = [group.names for group in groups]
    in_pieces, in_whole = (
        Unknowns(known, part, members, noise, offsets, water=water) for part in (cut, whole)
    )
    at, products = explained_best(in_pieces, used, in_pieces.measured)
    fits = [(cut, at, products), (whole, *explained_best(in_whole, used, Point(at.start[first], at.shared)))]
    fits = [fit for fit in fits if np.isfinite(fit[2]).all()]
    if not fits:
        return nothing
    names = [CHANNELS[c] for c in used]
    evidence = [_Evidence.of(at, products, len(groups)) for _, at, products in fits]
    tests = _tests(groups, names, evidence, level)
    # What is left over noise and priors, per channel: in the pieces, and how it grows in whole windows.
    left = [
        np.sqrt(products[:, :, -1, -1].sum(axis=0) / sum(mask[:, used].sum(axis=0) for mask in part.counted))
        for part, _, products in fits
    ]
    grown = left[1] / np.maximum(left[0], 1e-9) if len(left) > 1 else np.full(len(used), np.inf)
    if lacking or stated is not None:
        left, grown = left[:1], np.ones(len(used))
    beyond = dict(zip(names, np.max(left, axis=0).tolist(), strict=True))
    return Power(tests, controlled, len(whole.spans), beyond, dict(zip(names, grown.tolist(), strict=True)))


def _tests(
    groups: Sequence[CoefficientGroup], names: Sequence[str], evidence: Sequence[_Evidence], level: float
) -> tuple[GroupTest, ...]:
    """A test per group from the evidence of pieces and of whole windows."""
    adjusted = holm(np.minimum(np.min([part.p for part in evidence], axis=0) * len(evidence), 1.0).tolist())
    own = level / (2.0 * len(names) * len(groups) * len(evidence))
    tests = []
    for g, group in enumerate(groups):
        surest = min((estimate for part in evidence for estimate in part.all), key=lambda e: e.p[g])
        refuted = bool(adjusted[g] < level and _material(surest.theta[g]))
        shown, against = {}, []
        for k, name in enumerate(names):
            alone = [part.alone[k] for part in evidence]
            shown[name] = min((_smallest(estimate, g, own) for estimate in alone), key=lambda s: s.size)
            if refuted and any(estimate.refutes(g, own) for estimate in alone):
                against.append(name)
        factor, sigma = 1.0 + float(surest.theta[g]), float(surest.sigma[g])
        tests.append(GroupTest(group, factor, sigma, float(adjusted[g]), refuted, shown, tuple(against)))
    return tuple(tests)


def _material(theta: float) -> bool:
    return not 1.0 / SETTINGS.material <= 1.0 + theta <= SETTINGS.material


@dataclass(frozen=True)
class _Estimates:
    """Relative changes (G,) of the groups, each alone, their deviations, degrees of freedom and p-values."""

    theta: Array
    sigma: Array
    freedom: Array
    p: Array

    def refutes(self, g: int, level: float) -> bool:
        """Whether this alone says that a group is off by a material factor."""
        return bool(self.p[g] < level and _material(self.theta[g]))


def _estimates(products: Array, at: Point, groups: int) -> _Estimates:
    """Estimates from the products (windows, k, k) of one channel, or of several together."""
    from scipy.stats import t as student

    own = swept(with_prior(products, at.start), len(CHANNELS))  # the start of each window is its own
    total = own.sum(axis=0)
    shared = len(at.shared)
    full = swept(with_prior(total[None], at.shared[None]), shared)[0]
    without = swept(with_prior(total - own, at.shared[None]), shared)  # jackknife: all windows but one
    square, pull = np.diag(full)[:-1], full[:-1, -1]
    squares = np.diagonal(without, axis1=1, axis2=2)[:, :-1]
    # What the unknowns explain nearly whole is not told.
    known = square > 1e-9 * np.maximum(np.diag(total)[shared:-1], 1e-300)
    size = np.where(known, square, 1.0)
    theta = np.where(known, pull / size, 0.0)
    away = np.where(known, without[:, :-1, -1] / np.maximum(squares, 1e-9 * size) - theta, 0.0)
    count = len(own)
    sigma = np.sqrt(np.maximum((count - 1) / count * (away**2).sum(axis=0), 1.0 / size))
    share = np.maximum(square - squares, 0.0)
    freedom = share.sum(axis=0) ** 2 / np.maximum((share**2).sum(axis=0), 1e-300) - 1.0
    known &= freedom >= 1.0
    freedom, sigma = np.maximum(freedom, 1.0), np.where(known, sigma, np.inf)
    p = np.where(known, 2.0 * student.sf(np.abs(theta) / sigma, freedom), 1.0)
    return _Estimates(theta, sigma, freedom, p)


@dataclass(frozen=True)
class _Evidence:
    """Estimates of all channels together and of each alone; p (G,) of no change by any of them."""

    together: _Estimates
    alone: tuple[_Estimates, ...]
    p: Array

    @classmethod
    def of(cls, at: Point, products: Array, groups: int) -> _Evidence:
        together = _estimates(products.sum(axis=1), at, groups)
        alone = tuple(_estimates(products[:, k], at, groups) for k in range(products.shape[1]))
        # Half of the level for all channels together, half for each of them alone.
        least = np.min([estimate.p for estimate in alone], axis=0)
        return cls(together, alone, np.minimum(2.0 * together.p, 2.0 * len(alone) * least))

    @property
    def all(self) -> tuple[_Estimates, ...]:
        """All of them."""
        return (self.together, *self.alone)


def _smallest(of: _Estimates, g: int, level: float) -> Shown:
    """Smallest factors that would be refuted with the chance `PowerSettings.power`."""
    from scipy.stats import t as student

    sigma = float(of.sigma[g])
    if not np.isfinite(sigma):
        return Shown(None, None)
    critical, beyond = student.isf([0.5 * level, 1.0 - SETTINGS.power], of.freedom[g]) * sigma
    up = max(critical, SETTINGS.material - 1.0) + beyond
    down = max(critical, 1.0 - 1.0 / SETTINGS.material) + beyond
    return Shown(float(1.0 - down) if down < 1.0 else None, float(1.0 + up))
