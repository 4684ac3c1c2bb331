"""Inputs judged first: which combinations of actuators a campaign drives, which thrust gains that can tell.

The thrust f_k(t) of every actuator without inflow, and of a fin its lift at the rms speed, behind limits
and lag, over what the campaign fits. Its columns about their means (a constant thrust cannot be told from a
bias force), each over its own root mean square, have singular values: a small one is a combination
``sum c_k f_k`` that never changes.

A gain error dg makes the wrench error ``sum b_k dg_k f_k``, b_k being the wrench of actuator k per newton.
Where the f_k are independent, every row of the wrench by itself tells every gain that acts in it. Where they
are not, gains differ only by what they couple into other axes, and an offset centre, a lever or off-diagonal
damping of the hull says that as well. So then: one gain per group and direction, whose input is the wrench of
all its actuators, or one per axis: a force is scaled by the gain of the group that makes most of it, a moment
by a group's levers.

Tests: ``tests/estimation/test_inputs.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES
from seatrial.base.errors import SimulationError, TrialError
from seatrial.base.plain import Plain
from seatrial.base.report import wording, words_about
from seatrial.inspect.wiring import each_wrench, thrusts
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.problem.problem import Problem


@dataclass(frozen=True)
class InputSettings:
    """From where on trials drive a combination of actuators."""

    #: Singular value over the largest below which a combination counts as not driven: thrust tables and
    #: bollard curves are good to about five per cent, and what is weaker is the error of the others.
    weak_singular: float = 0.05
    #: Component of a combination, over its largest, below which it is noise of the null space.
    small_component: float = 0.1
    #: Share of the impulse below which a direction tells no gain of its own: a tenth of the data.
    used_impulse: float = 0.1
    #: Share of the largest row below which a row of the wrench is not driven; moments count per half hull
    #: length.
    driven_row: float = 0.02


SETTINGS = InputSettings()


@dataclass(frozen=True)
class Combination:
    """``sum c_k f_k`` that hardly changes: signals with their factors, the largest 1, and its strength.

    ``strength`` is its root mean square over what it would be if the signals were independent.
    """

    parts: tuple[tuple[str, float], ...]
    strength: float

    @property
    def words(self) -> str:
        """The combination as it is written: ``a - b + 0.5 c``."""
        return str(wording("preparation").combination(self))


@dataclass(frozen=True)
class Dependence:
    """How independent signals are."""

    #: All signals, in their order.
    names: tuple[str, ...]
    #: Of the signals that move, each over its own root mean square; relative to the largest.
    singular_values: tuple[float, ...]
    #: Signals that do not move.
    still: tuple[str, ...]
    #: A basis of what is hardly driven, as few signals in each as possible.
    combinations: tuple[Combination, ...]

    @property
    def lost(self) -> int:
        """Number of independent combinations that are hardly driven."""
        return len(self.combinations)

    @property
    def involved(self) -> tuple[str, ...]:
        """Signals in any combination that is hardly driven, in their order."""
        parts = {name for combination in self.combinations for name, _ in combination.parts}
        return tuple(name for name in self.names if name in parts)

    @property
    def families(self) -> list[list[tuple[str, float]]]:
        """Signals that move only together, each with its size for one of the first."""
        return _families([row for row in self.combinations if len(row.parts) == 2], self.names)

    def sentences(self) -> list[str]:
        """A sentence for those that move only together, one per combination of three and more."""
        return list(wording("preparation").dependence(self))


def dependence(signals: Array, names: Sequence[str], *, weak: float = 1e-3) -> Dependence:
    """Dependence of signals.

    ``signals``: about their means, so weighted that the squares of a column sum to a mean square. ``names``:
    what the k signals are called. ``weak``: a signal below this share of the largest does not move.

    Examples
    --------
    >>> t = np.linspace(0.0, 6.0, 50)
    >>> found = dependence(np.stack([np.sin(t), 2.0 * np.sin(t), np.cos(3.0 * t)], axis=1), ["a", "b", "c"])
    >>> found.sentences()
    ['a, b move only together: +1 +2']
    """
    rms = np.sqrt((signals**2).sum(axis=0))
    moving = rms > max(weak * float(rms.max(initial=0.0)), 1e-12)
    still = tuple(name for name, moves in zip(names, moving, strict=True) if not moves)
    if not moving.any():
        return Dependence(tuple(names), (), still, ())
    own = [name for name, moves in zip(names, moving, strict=True) if moves]
    size = rms[moving]
    _, values, modes = np.linalg.svd(np.linalg.qr(signals[:, moving] / size, mode="r"))
    relative = values / values[0]
    rows = _sparse(modes[relative < SETTINGS.weak_singular] / size)
    combinations = []
    for row in rows:
        strength = np.linalg.norm(signals[:, moving] @ row) / np.linalg.norm(row * size)
        parts = tuple((name, float(x)) for name, x in zip(own, row, strict=True) if x)
        combinations.append(Combination(parts, float(strength)))
    return Dependence(tuple(names), tuple(map(float, relative)), still, tuple(combinations))


def _sparse(rows: Array) -> Array:
    """Basis (d, k) of the same space with few signals per row: reduced row echelon form, largest part 1."""
    basis = np.array(rows)
    free = np.ones(basis.shape[1], dtype=bool)
    for i in range(len(basis)):
        rest = np.abs(basis[i:]) * free
        row, column = divmod(int(rest.argmax()), rest.shape[1])
        basis[[i, i + row]] = basis[[i + row, i]]
        basis[i] /= basis[i, column]
        free[column] = False
        for other in range(len(basis)):
            if other != i:
                basis[other] -= basis[other, column] * basis[i]
    for row in basis:
        first = int(np.flatnonzero(np.abs(row) > SETTINGS.small_component * np.abs(row).max())[0])
        row /= np.abs(row).max() * np.sign(row[first])
        row[np.abs(row) < SETTINGS.small_component] = 0.0
    order = sorted(range(len(basis)), key=lambda i: np.flatnonzero(basis[i])[0])
    return np.asarray(basis[order])


def _families(pairs: Sequence[Combination], names: Sequence[str]) -> list[list[tuple[str, float]]]:
    """Signals joined by pairs, in their order, each with its size for one of the first."""
    ratios: dict[str, dict[str, float]] = {}
    for pair in pairs:
        (a, x), (b, y) = pair.parts
        ratios.setdefault(a, {})[b] = -x / y
        ratios.setdefault(b, {})[a] = -y / x
    families, seen = [], set[str]()
    for name in names:
        if name in seen or name not in ratios:
            continue
        family, waiting = {name: 1.0}, [name]
        while waiting:
            here = waiting.pop(0)
            for there, ratio in ratios[here].items():
                if there not in family:
                    family[there] = family[here] * ratio
                    waiting.append(there)
        seen |= set(family)
        families.append([(name, family[name]) for name in names if name in family])
    return families


@dataclass(frozen=True)
class Drive:
    """What one actuator did: root mean square of its thrust about the mean, N, and its impulse ahead.

    ``ahead`` is the share of ``integral |f| dt`` with thrust along the actuator's direction.
    """

    actuator: str
    group: str
    rms_n: float
    ahead: float


@dataclass(frozen=True)
class GainOption:
    """A way to free thrust gains: the campaign's keys, and whether the inputs tell them apart.

    ``singular_values`` are those of the inputs behind the keys, relative to the largest.
    """

    kind: Literal["single", "group and direction", "axis"]
    names: tuple[str, ...]
    singular_values: tuple[float, ...]
    told_apart: bool


def _group_keys(vehicle: Vehicle, group: str, drives: Iterable[Drive]) -> dict[str, float]:
    """Keys of a group's gains with the sign of the thrust that each acts on, 0 for both.

    A quadratic characteristic has a factor per direction; a table, a regression and a direct thrust have one,
    and a ratio of the thrust astern.
    """
    facts, names = vehicle.actuator_info(), actuator_groups(vehicle)[group]
    own = [drive for drive in drives if drive.group == group and drive.rms_n > 0.0]
    if not own:
        return {}
    ahead = float(np.mean([drive.ahead for drive in own]))
    quadratic = all(facts[name]["characteristic"] == "quadratic" for name in names)
    if not (quadratic or SETTINGS.used_impulse <= ahead <= 1.0 - SETTINGS.used_impulse):
        return {f"{group}.gain": 0.0}
    keys = ("p1_ahead", "p1_astern") if quadratic else ("gain", "astern_ratio")
    both = {f"{group}.{keys[0]}": (1.0, ahead), f"{group}.{keys[1]}": (-1.0, 1.0 - ahead)}
    return {key: sign for key, (sign, share) in both.items() if share >= SETTINGS.used_impulse}


def per_group(
    vehicle: Vehicle, each: Array, thrust: Array, weight: Array, drives: tuple[Drive, ...]
) -> GainOption:
    """One gain per group and direction: the input behind each is the wrench of all that it acts on."""
    names, columns = [], []
    for group, members in actuator_groups(vehicle).items():
        index = [vehicle.actuators.index(name) for name in members]
        for key, sign in _group_keys(vehicle, group, drives).items():
            counted = thrust[:, index] * sign >= 0.0
            names.append(key)
            columns.append(centred(np.einsum("nki,nk->ni", each[:, index], counted), weight).ravel())
    if not names:
        return GainOption("group and direction", (), (), False)
    independence = dependence(np.stack(columns, axis=1), names)
    apart = not independence.lost and not independence.still
    return GainOption("group and direction", tuple(names), independence.singular_values, apart)


def per_axis(vehicle: Vehicle, each: Array, weight: Array, rows: Dependence) -> GainOption:
    """One gain per row of the wrench: of forces the strongest group's gain, of moments its levers."""
    groups, values = actuator_groups(vehicle), vehicle.coefficients()
    total = centred(each.sum(axis=1), weight)
    driven = [row for row in AXES if row not in rows.still]
    for combination in rows.combinations:  # of rows that move only together the strongest speak
        beside = [name for name, _ in combination.parts if name in driven]
        driven.remove(min(beside, key=lambda row: float(np.linalg.norm(total[:, AXES.index(row)]))))
    wrenches = {
        group: centred(each[:, [vehicle.actuators.index(name) for name in names]].sum(axis=1), weight)
        for group, names in groups.items()
    }
    keys = []
    for row in driven:
        strength = {group: _own(wrench, AXES.index(row)) for group, wrench in wrenches.items()}
        group = max(strength, key=lambda group: strength[group])
        if row in "XYZ":
            keys.append(f"{group}.gain")
        elif all(values.get(f"{name}.lever_{row}") for name in groups[group]):  # relative bounds need a lever
            keys.append(f"{group}.lever_{row}")
    left = dependence(total[:, [AXES.index(row) for row in driven]], driven)
    return GainOption("axis", tuple(dict.fromkeys(keys)), left.singular_values, bool(keys) and not left.lost)


def _own(wrench: Array, axis: int) -> float:
    """Strength of a row of a group's wrench; of a moment, what does not simply follow the group's force."""
    row = wrench[:, axis]
    if axis >= 3:
        row = row - wrench[:, :3] @ np.linalg.lstsq(wrench[:, :3], row, rcond=1e-9)[0]
    return float(np.linalg.norm(row))


def offered(vehicle: Vehicle, drives: tuple[Drive, ...], independence: Dependence) -> tuple[str, ...]:
    """Single gains for the groups whose members are all told apart, else the group's."""
    keys: list[str] = []
    for group, members in actuator_groups(vehicle).items():
        if set(members) & {*independence.involved, *independence.still}:
            keys += _group_keys(vehicle, group, drives)
        else:
            keys += [f"{name}.gain" for name in members]
    return tuple(keys)


def centred(signals: Array, weight: Array) -> Array:
    """Signals (n, k) about their weighted means, times the weights' roots: norms are standard deviations."""
    return np.asarray((signals - weight @ signals) * np.sqrt(weight)[:, None])


@dataclass(frozen=True)
class InputJudgement(Plain, also="sentences"):
    """The inputs of a campaign, judged before anything is fitted."""

    #: Per actuator, in the vehicle's order; empty where the logged wrench is the only input.
    drives: tuple[Drive, ...]
    #: Singular values and hardly driven combinations of the thrusts.
    thrusts: Dependence
    #: Root mean square of every row of the wrench about its mean, N and N m.
    rows_rms: dict[str, float]
    #: Singular values and hardly driven combinations of the rows that are driven.
    rows: Dependence
    #: Ways to free thrust gains.
    options: tuple[GainOption, ...]
    #: Keys of the gains that may be freed: single ones where the inputs tell them apart, else by group and
    #: direction.
    offered: tuple[str, ...]
    #: Gains that the campaign frees singly although they cannot be told apart.
    freed: tuple[str, ...]
    #: Actuators that are fins: they deflect and lift, and have no thrust.
    fins: tuple[str, ...] = ()

    def sentences(self) -> list[str]:
        """What the inputs tell, for a control engineer."""
        return words_about(self, "preparation")

    def __str__(self) -> str:
        return "\n".join(self.sentences())


def judge_inputs(problem: Problem) -> InputJudgement:
    """Judgement of a campaign's inputs over the training parts of its trials.

    Parameters
    ----------
    problem : Problem

    Raises
    ------
    CampaignError, TrialError, SimulationError
        A trial cannot be read or lacks the input that the campaign drives the model with.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> judge_inputs(campaign).thrusts.combinations[0].words  # doctest: +SKIP
    'SbU - SbL - PU + PL'
    """
    vehicle = problem.vehicle
    parts = [_inputs(problem, name) for name in problem.trained]
    lever = np.array([1.0, 1.0, 1.0, *[max(0.5 * vehicle.geometry().get("length", 2.0), 1e-6)] * 3])
    wrench, weight = _joined([(part.sum(axis=1), dt) for part, dt, _ in parts])
    rows_rms = dict(zip(AXES, map(float, np.linalg.norm(centred(wrench, weight), axis=0)), strict=True))
    rows = dependence(centred(wrench / lever, weight), AXES, weak=SETTINGS.driven_row)
    by_actuator = [(part, dt) for part, dt, logged in parts if not logged]
    if not by_actuator or not vehicle.actuators:
        return InputJudgement((), Dependence((), (), (), ()), rows_rms, rows, (), (), ())
    each, weight = _joined(by_actuator)
    thrust = thrusts(vehicle, each)
    drives = _drives(vehicle, thrust, weight)
    independence = dependence(centred(thrust, weight), vehicle.actuators)
    single = tuple(f"{name}.gain" for name in vehicle.actuators)
    facts = vehicle.actuator_info()
    return InputJudgement(
        drives=drives,
        thrusts=independence,
        rows_rms=rows_rms,
        rows=rows,
        options=(
            GainOption(
                "single",
                single,
                independence.singular_values,
                not independence.lost and not independence.still,
            ),
            per_group(vehicle, each / lever, thrust, weight, drives),
            per_axis(vehicle, each / lever, weight, rows),
        ),
        offered=offered(vehicle, drives, independence),
        freed=_freed(problem, independence.involved),
        fins=tuple(name for name in vehicle.actuators if facts[name]["kind"] == "fin"),
    )


def _inputs(problem: Problem, name: str) -> tuple[Array, float, bool]:
    """Wrench of every actuator without inflow (n, actuators, 6) over what is fitted, its step, logged or not.

    A logged wrench stands in place of the actuators, as (n, 1, 6).
    """
    trial, kind = problem.trials[name], problem.input_of(name)
    training = ~problem.held_out(name)
    if kind not in trial.inputs:
        raise TrialError(f"{name}: input {kind} is not recorded; map its columns or choose another input")
    if kind == "tau" and trial.tau is not None:
        return np.nan_to_num(trial.tau[training])[:, None, :], trial.dt, True
    try:
        each = each_wrench(problem.vehicle, trial, measured=kind == "measured")
    except SimulationError as error:
        raise SimulationError(f"{name}: {error}") from None
    return each[training], trial.dt, False


def _drives(vehicle: Vehicle, thrust: Array, weight: Array) -> tuple[Drive, ...]:
    total, ahead = weight @ np.abs(thrust), weight @ np.clip(thrust, 0.0, None)
    groups = {name: group for group, names in actuator_groups(vehicle).items() for name in names}
    rms = np.linalg.norm(centred(thrust, weight), axis=0)
    return tuple(
        Drive(name, groups[name], float(rms[k]), float(ahead[k] / total[k]) if total[k] > 0.0 else 0.0)
        for k, name in enumerate(vehicle.actuators)
    )


def _freed(problem: Problem, lost: Sequence[str]) -> tuple[str, ...]:
    """Gains of single actuators, of those that cannot be told apart, that the campaign frees."""
    names = []
    for parameter in (freed for stage in problem.stages for freed in problem.parameters[stage.name]):
        thrust = [name.split(".")[0] for name, _ in parameter.members if name.endswith(_THRUST)]
        if len(set(thrust)) == 1 and set(thrust) <= set(lost):
            names.append(parameter.name)
    return tuple(dict.fromkeys(names))


_THRUST = (".gain", ".p1_ahead", ".p1_astern")


def _joined(parts: Sequence[tuple[Array, float]]) -> tuple[Array, Array]:
    """Signals of all trials one after the other, and the share (n,) of each sample in their duration."""
    weight = np.concatenate([np.full(len(part), dt) for part, dt in parts])
    return np.concatenate([part for part, _ in parts]), weight / weight.sum()
