"""Missing terms: coefficients that the campaign holds and the residuals ask for, ranked, with alternatives.

Candidates are the coefficients that an estimate holds and that act on a free axis. Each is tried by an exact
score test (`seatrial.statistics.significance`), at a false discovery rate over all that are tried. Among the
significant ones that of the largest gain leads; one that adds nothing beside it, and beside which it adds
nothing, is an alternative that these data cannot tell from it ("free Y_ur or Y_rdot"). Then the leader counts
as fitted and the rest is tried again.

Lag and dead time are tried for every group of actuators, as one change of all that are held, whether or not
their values are equal. Neither can be negative: where the data ask for that, the sentence says that the
actuators respond faster than the file says; a lag or dead time that is zero already is left out.

Tests: ``tests/diagnosis/test_residual_analysis.py``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.channels import AXES, VELOCITIES
from seatrial.base.finding import Finding, Severity
from seatrial.base.plain import Plain
from seatrial.base.report import sentence_of
from seatrial.diagnosis.residual_signals import autocorrelations, block_length, block_numbers
from seatrial.problem.parameter import OF_AN_AXIS, axes_of
from seatrial.problem.settings import STRIPS
from seatrial.statistics.linearisation import Linearisation
from seatrial.statistics.significance import ScoreTests, false_discovery, score_tests, unexplained
from seatrial.vehicle.actuators import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.estimation.joint import Joint


@dataclass(frozen=True)
class MissingTermSettings:
    """How many missing terms are tested, and which are named."""

    #: Derivatives that are held at once.
    at_once: float = 3e7
    #: Derivatives of the part of the segments by which the strongest are chosen where they are more.
    to_choose: float = 5e6
    #: Segments of that part at least.
    fewest_segments: int = 20
    #: Terms that are tested in full after a first ranking of all.
    strongest: int = 40
    #: Blocks that a record is cut into where its correlation is not known yet.
    coarse_blocks: int = 40
    #: Level of the test that tells two alternatives apart.
    apart_level: float = 0.05
    #: Alternatives that are named; more hide what is said.
    named: int = 3
    #: Strongest terms whose part is taken out of the residuals before their correlation is judged.
    explaining: int = 3
    #: Energy over that of the strongest channel from which a channel of the axis that a term acts on is
    #: preferred.
    fair_share: float = 0.2


SETTINGS = MissingTermSettings()


_OF_ONE = re.compile(r".+\.(gain|lever_[KMN])")

DELAYS = ("T_t", "T_1")
"""Dead time and lag of an actuator: neither can be negative."""


@dataclass(frozen=True)
class Candidate:
    """A coefficient that might be missing; of an actuator group, the coefficients that it sets together.

    With ``factors`` each member changes in proportion to its value: the first's change times its factor. With
    a ``trial`` it is a constant force of that trial alone, and its member the bias of all of them.
    """

    name: str
    members: tuple[str, ...]
    trial: str = ""
    factors: tuple[float, ...] = ()


def candidates(vehicle: Vehicle, estimated: Iterable[str], *, free: str) -> tuple[Candidate, ...]:
    """Coefficients that are not `estimated` and act on a `free` axis. Of an actuator group those of all its
    actuators together where they are equal, its levers in proportion, and of each actuator gain and levers.
    Lag and dead time of a group are there always, of those actuators that are not estimated.

    >>> import seatrial as st
    >>> found = candidates(st.Vehicle.load("cwolf"), ["X_u", "X_uu"], free="X")
    >>> [c.name for c in found if c.name.startswith("X_u")]
    ['X_udot']
    """
    fixed = set(estimated)
    known = vehicle.coefficient_info()
    groups = actuator_groups(vehicle)
    actuators, present = set(vehicle.actuators), vehicle.coefficients()
    candidates = []
    for name in known:
        axes = axes_of(name)
        if name in fixed or (axes and not set(axes) & set(free)):
            continue
        if name.partition(".")[0] not in actuators or _OF_ONE.fullmatch(name):
            candidates.append(Candidate(name, (name,)))
    # Of a group one candidate for all members: levers in proportion, delays whatever their values.
    for group, own_actuators in groups.items():
        of_first = [name.partition(".")[2] for name in known if name.startswith(f"{own_actuators[0]}.")]
        for suffix in of_first:
            own = tuple(f"{member}.{suffix}" for member in own_actuators)
            if suffix.startswith("lever_"):
                arms = [present.get(name, 0.0) for name in own]
                if len(own) > 1 and all(arms) and not fixed & set(own):
                    factors = tuple(arm / arms[0] for arm in arms)
                    candidates.append(Candidate(f"{group}.{suffix}", own, factors=factors))
                continue
            if suffix in DELAYS:
                held = tuple(name for name in own if name in known and name not in fixed)
                if held:
                    whole = len(held) == len(own) > 1
                    candidates.append(Candidate(f"{group}.{suffix}" if whole else held[0], held))
                continue
            single = len(own) == 1 and _OF_ONE.fullmatch(own[0])
            equal = len({present.get(name, 0.0) for name in own}) == 1
            if equal and not single and all(name in known and name not in fixed for name in own):
                candidates.append(Candidate(own[0] if len(own) == 1 else f"{group}.{suffix}", own))
    return tuple(candidates)


def trial_forces(trials: Sequence[str], estimated: Iterable[str], *, free: str) -> tuple[Candidate, ...]:
    """Constant forces of single trials on the free axes, where neither they nor the bias are estimated. One
    trial alone has no force of its own: there it is the bias.

    >>> [one.name for one in trial_forces(["out", "back"], ["Y_0", "out: force_X"], free="XY")]
    ['back: force_X']
    """
    fixed, several = set(estimated), len(trials) > 1
    return tuple(
        Candidate(name, (f"{axis}_0",), trial)
        for axis in free
        for trial in trials
        if several and not fixed & {f"{axis}_0", f"force_{axis}", name := f"{trial}: force_{axis}"}
    )


def columns_of(lin: Linearisation, tried: Sequence[Candidate]) -> list[Array]:
    """Columns (n, C, k) per segment of the candidates, whose coefficients are among the unknowns."""
    place = {unknown.name: i for i, unknown in enumerate(lin.unknowns)}
    first = [place[candidate.members[0]] for candidate in tried]
    # Most candidates are one coefficient: their columns are taken, and only those of groups are added up.
    others = [
        (column, [place[member] for member in candidate.members[1:]], candidate.factors[1:] or 1.0)
        for column, candidate in enumerate(tried)
        if len(candidate.members) > 1
    ]
    pieces = []
    for piece in lin.pieces:
        columns = piece.jacobian[:, :, first]
        columns[:, :, [bool(candidate.trial) and candidate.trial != piece.trial for candidate in tried]] = 0.0
        for column, places, factors in others:
            columns[:, :, column] += (piece.jacobian[:, :, places] * factors).sum(axis=2)
        pieces.append(columns)
    return pieces


def members(tried: Iterable[Candidate]) -> list[str]:
    """Coefficients of the candidates, each once."""
    return list(dict.fromkeys(member for candidate in tried for member in candidate.members))


def fitted_places(lin: Linearisation, tried: Sequence[Candidate]) -> list[int]:
    """Places of the unknowns that are no candidate's."""
    held = {member for candidate in tried for member in candidate.members}
    return [i for i, unknown in enumerate(lin.unknowns) if unknown.name not in held]


def strongest(
    joint: Joint, values: Array, tried: tuple[Candidate, ...], *, initial: Array | None, noise: Array | None
) -> tuple[Candidate, ...]:
    """The candidates of the largest gains, all if the derivatives by all of them fit into memory. ``values``
    (m,), ``initial``, ``noise``: of the estimate.
    """
    from seatrial.estimation.joint_estimate import linearise

    if len(tried) <= (fits := _fits(joint)):
        return tried
    if joint.comparison.simulates:
        # A part of the segments tells which are to be looked at on all of them.
        each = joint.data.samples * len(joint.channels) * (len(joint.unknowns) + len(tried))
        joint, places = joint.thinned(
            max(round(len(joint.data.segments) * SETTINGS.to_choose / each), SETTINGS.fewest_segments)
        )
        initial = None if initial is None else initial[places]
        fits = _fits(joint)
    gains = np.zeros(len(tried))
    for first in range(0, len(tried), fits):
        part = tried[first : first + fits]
        lin = linearise(joint, values, initial=initial, noise=noise, extra=members(part))
        block = block_numbers(lin, joint.data.samples * lin.dt / SETTINGS.coarse_blocks)
        tests = score_tests(lin, columns_of(lin, part), fitted=fitted_places(lin, part), block=block)
        gains[first : first + len(part)] = tests.results().gain
    return tuple(tried[place] for place in np.argsort(-gains, kind="stable")[: SETTINGS.strongest])


def _fits(joint: Joint) -> int:
    """Coefficients whose derivatives are held at once beside those of the unknowns."""
    rows = joint.data.samples * len(joint.channels)
    return max(round(SETTINGS.at_once / rows) - len(joint.unknowns), SETTINGS.strongest // 2)


def signal_of(name: str, info: Mapping[str, Mapping[str, Any]] | None = None) -> str:
    """The signal that a coefficient multiplies, in words.

    >>> [signal_of(name) for name in ("Y_ur", "Y_rdot", "N_rr", "K_v", "Z_0")]
    ['u r', 'dr/dt', '|r| r', 'v', 'a constant']
    >>> signal_of("C_Dz")
    '|w - x q| (w - x q) along the hull'
    >>> signal_of("stern.T_1")
    'the rate of change of the command of stern'
    """
    actuator, _, part = name.rpartition(".")
    if part in DELAYS:
        return f"the rate of change of the command of {actuator}"
    if ": force_" in name:
        return f"a constant in trial {name.partition(': ')[0]}"
    if name in STRIPS:
        across = "v + x r" if name == "C_Dy" else "w - x q"
        return f"|{across}| ({across}) along the hull"
    axis = OF_AN_AXIS.fullmatch(name)
    if axis is None:
        words = (info or {}).get(name, {}).get("description")
        return f"the {words}" if words and "." not in name else name
    what = axis[2]
    if what == "0":
        return "a constant"
    if what.endswith("dot"):
        return f"d{what[0]}/dt"
    if len(what) == 1:
        return what
    return f"|{what[0]}| {what[0]}" if what[0] == what[1] else f"{what[0]} {what[1]}"


@dataclass(frozen=True)
class Suggestion(Plain, also="sentence"):
    """A coefficient to free."""

    #: The coefficient as a campaign file names it.
    name: str
    unit: str
    #: Coefficients that these data cannot tell from it.
    alternatives: tuple[str, ...]
    #: The channel whose residual it explains most, and the signal that this residual follows.
    channel: str
    follows: str
    #: Value that it is held at, first-order estimate of its value, standard deviation.
    present: float
    value: float
    sigma: float
    #: Fall of the cost in percent when it is freed (of the first: alone; of the next: after those before).
    gain: float
    #: P-value adjusted for all coefficients that were tried.
    p: float
    #: Coefficients that it sets, all alike; empty where that is itself.
    members: tuple[str, ...] = ()
    #: Line for the campaign's coefficients that frees it; empty where nothing is to be freed.
    line: str = ""
    #: Whether its members keep their proportion: `present` and `value` are those of the first.
    relative: bool = False

    @property
    def faster(self) -> bool:
        """Whether it is a lag or dead time of which the data ask for none: its `value` is zero then."""
        return self.name.rpartition(".")[2] in DELAYS and self.value <= 0.0

    @property
    def tied(self) -> tuple[str, ...]:
        """Coefficients that have to follow the named one: the name alone does not stand for them."""
        return self.members[1:] if self.name in self.members else ()

    @property
    def nuisance(self) -> tuple[str, str] | None:
        """Trial and name of a nuisance parameter; None of a coefficient."""
        trial, separator, key = self.name.partition(": force_")
        return (trial, f"force_{key}") if separator else None

    @property
    def sentence(self) -> str:
        """All of it in words."""
        return sentence_of(Finding("missing term", Severity.WEAKNESS, self.name, {"term": self}), "diagnosis")


def missing_terms(
    lin: Linearisation,
    tried: Sequence[Candidate],
    *,
    block: Sequence[NDArray[np.intp]],
    info: Mapping[str, Mapping[str, Any]] | None = None,
    tests: ScoreTests | None = None,
    tested: int | None = None,
    level: float = 0.05,
    least_gain: float = 0.25,
    most: int = 5,
) -> tuple[Suggestion, ...]:
    """Suggestions of coefficients to free, the one with the largest gain first.

    ``lin``: its unknowns include the candidates' coefficients, which count as not fitted. ``block`` (n,):
    block of each sample of each segment, of `independent_blocks`. ``info``: ``Vehicle.coefficient_info()``:
    descriptions for the words. ``tests``: those of the candidates in these blocks, where they are known.
    ``tested``: number of coefficients tried in all, if more than are given here. ``level``: false discovery
    rate: the chance of any suggestion where nothing is missing. ``least_gain``: percent of the cost that a
    suggestion gains at least: less may be significant but moves no prediction. ``most``: suggestions at most.
    """
    if not tried:
        return ()
    columns, fitted = columns_of(lin, tried), fitted_places(lin, tried)
    if tests is None:
        tests = score_tests(lin, columns, fitted=fitted, block=block)
    count = max(tested or 0, int(tests.testable.sum()))
    open_ = tests.testable.copy()
    place = {unknown.name: i for i, unknown in enumerate(lin.unknowns)}
    # A force of one trial comes on top of the vehicle's bias: none is present. Where members keep their
    # proportion, the first stands for them.
    present = np.array([
        0.0
        if candidate.trial
        else lin.values[place[candidate.members[0]]]
        if candidate.factors
        else np.mean([lin.values[place[name]] for name in candidate.members])
        for candidate in tried
    ])
    delays = np.array([candidate.members[0].rpartition(".")[2] in DELAYS for candidate in tried], dtype=bool)
    leaders: list[int] = []
    suggestions: list[Suggestion] = []
    while len(suggestions) < most:
        results = tests.results()
        adjusted = np.ones(len(tried))
        adjusted[open_] = false_discovery(results.p[open_], count)
        # No delay is shorter than none.
        possible = ~(delays & (present <= 0.0) & (results.step < 0.0))
        significant = np.flatnonzero(possible & (adjusted < level) & (results.gain >= least_gain / 100.0))
        if not len(significant):
            break
        best = int(significant[np.argmax(results.gain[significant])])
        rivals = np.flatnonzero(possible & open_ & (results.p < SETTINGS.apart_level))
        group = sorted([best, *_alternatives(tests, best, rivals)], key=lambda rival: -results.gain[rival])
        leader = group[0]
        channel = _channel(
            lin, columns, fitted=fitted, leaders=leaders, leader=leader, name=tried[leader].members[0]
        )
        own = place[tried[leader].members[0]]
        value = float(present[leader] + results.step[leader])
        suggestion = Suggestion(
            name=tried[leader].name,
            unit=lin.unknowns[own].unit,
            alternatives=tuple(tried[rival].name for rival in group[1:]),
            channel=channel,
            follows=signal_of(tried[leader].name, info),
            present=float(present[leader]),
            value=max(value, 0.0) if delays[leader] else value,
            sigma=float(results.sigma[leader]),
            gain=100.0 * float(results.gain[leader]),
            p=float(adjusted[group].min()),
            members=tried[leader].members if len(tried[leader].members) > 1 else (),
            relative=bool(tried[leader].factors),
        )
        suggestions.append(suggestion)
        open_[group] = False
        leaders.append(leader)
        tests = tests.beside(leader)
    return tuple(suggestions)


def independent_blocks(
    lin: Linearisation, tried: Sequence[Candidate]
) -> tuple[list[NDArray[np.intp]], float]:
    """Block of each sample (n,) per segment, and the blocks' length in s. They outlast the memory of the
    residual that the best candidates leave: what a missing term makes it remember is no noise.
    """
    duration = sum(len(piece.t) for piece in lin.pieces) * lin.dt
    number = block_numbers(lin, max(duration / SETTINGS.coarse_blocks, lin.dt))
    left = lin
    if tried:
        columns, fitted = columns_of(lin, tried), fitted_places(lin, tried)
        tests = score_tests(lin, columns, fitted=fitted, block=number)
        best: list[int] = []
        for _ in range(SETTINGS.explaining):
            best.append(int(np.argmax(np.where(tests.testable, tests.results().gain, 0.0))))
            tests = tests.beside(best[-1])
        explaining = _explaining(lin, columns, fitted=fitted, places=best)
        residual = unexplained(lin, explaining, [piece.residual for piece in lin.pieces])
        pieces = (replace(p, residual=r) for p, r in zip(lin.pieces, residual, strict=True))
        left = replace(lin, pieces=tuple(pieces))
    length = block_length(autocorrelations(left), duration)
    return block_numbers(lin, length), length


def _explaining(
    lin: Linearisation, columns: Sequence[Array], *, fitted: Sequence[int], places: Sequence[int]
) -> list[Array]:
    """Columns (n, C, k) per segment of what is fitted and of some candidates."""
    return [
        np.concatenate([piece.jacobian[:, :, list(fitted)], own[:, :, list(places)]], axis=2)
        for piece, own in zip(lin.pieces, columns, strict=True)
    ]


def _alternatives(tests: ScoreTests, leader: int, rivals: NDArray[np.intp]) -> list[int]:
    """Rivals that add nothing beside the leader and beside which the leader adds nothing."""
    others = [int(rival) for rival in rivals if rival != leader]
    pairs = [(rival, tests.among([leader, rival])) for rival in others]
    return [
        rival
        for rival, pair in pairs
        if pair.beside(0).results().p[1] >= SETTINGS.apart_level
        and pair.beside(1).results().p[0] >= SETTINGS.apart_level
    ]


def _channel(
    lin: Linearisation,
    columns: Sequence[Array],
    *,
    fitted: Sequence[int],
    leaders: Sequence[int],
    leader: int,
    name: str,
) -> str:
    """The channel, a velocity where there is one, in which a candidate shows most beside what is fitted; that
    of the force's own axis where it shows a fair part.
    """
    explaining = _explaining(lin, columns, fitted=fitted, places=leaders)
    left = unexplained(lin, explaining, [own[:, :, leader] for own in columns])
    energy = np.sum(
        [
            (p.weight * p.counted * residual**2).sum(axis=0)
            for p, residual in zip(lin.pieces, left, strict=True)
        ],
        axis=0,
    )
    velocity = np.array([channel in VELOCITIES for channel in lin.channels])
    energy = np.where(velocity, energy, 0.0) if velocity.any() else energy
    for axis in axes_of(name):
        if (own := VELOCITIES[AXES.index(axis)]) in lin.channels:
            energy[lin.channels.index(own)] /= SETTINGS.fair_share
    return lin.channels[int(np.argmax(energy))]
