"""Requirements on missions: what must hold, in which share of them, and by how much a mission held it.

``holds`` (k,) is three-valued inside (Kleene 1952, strong logic of three values): a comparison with a metric
that is not a number, as a diverged flight has, is neither true nor false, its negation neither, and a mission
of which the whole is not true does not hold the requirement. So ``not (roll_largest_deg > 30)`` is not held
by a flight that diverged.

The reserve is the distance to the threshold, positive where the requirement is held: ``b - a`` of ``a <= b``,
``-|a - b|`` of ``a == b``, the smallest over ``and``, the largest over ``or``, negated by ``not``; words and
truths are infinitely far. Where the comparisons have different units, each is divided by the size of its
threshold. It ranks missions; it is no probability.

A campaign that states no requirements gets those that every mission is meant for, each in 95 % of the
missions: to be complete without an abort; on settled legs to be truly no further from the path than the
sphere of acceptance of the tightest waypoint in 95 % of the time, with what the position of the sensors is
off by in 95 % of the missions (1.96 standard deviations) on top; to touch neither an obstacle nor the bottom,
to keep the distance that the mission promises of what stands in the water, less a tenth, and to stay above
its depth limit, where there are such.

What the mission states stands in the water, the farms it goes about and its obstacles; the campaign may add
circles. Clearances are of the hull, horizontal (`seatrial._core`, flight/obstacle.rs).

Held by ``test_requirement.py``, ``test_verify.py`` and ``test_draws.py`` in ``tests/verification/``.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, nearest
from seatrial.flight.metrics import SETTINGS as METRIC_SETTINGS
from seatrial.verification.expression import KNOWN, Metric, check, names_in, parse, unit_of
from seatrial.verification.table import Obstacle, VerificationTable

if TYPE_CHECKING:
    from seatrial.flight.mission import Mission

Values = NDArray[Any]
_T = TypeVar("_T")
_SHARE = "of the threshold"


@dataclass(frozen=True)
class Judgement:
    """Of k missions: whether the requirement was ``held`` (k,), and its ``reserve`` (k,) in ``unit``.

    The reserve is positive where it was held, and minus infinity where a metric is not a number.
    """

    held: NDArray[np.bool_]
    reserve: Array
    unit: str

    @property
    def failures(self) -> int:
        """Number of missions that did not hold it."""
        return int(np.count_nonzero(~self.held))

    def worst(self, count: int) -> NDArray[np.intp]:
        """Numbers of the missions with the least reserve, failed ones first; equal ones in their order."""
        return np.lexsort((self.reserve, self.held))[:count]


@dataclass(frozen=True)
class Requirement:
    """An expression over the metrics of a mission that must hold in a share of all missions.

    Parameters
    ----------
    name : str
        How reports call it.
    holds : str
        The expression, see `seatrial.verification.expression`.
    probability : float
        Share of the missions that must hold it at least, between 0 and 1.

    Raises
    ------
    CampaignError
        The expression cannot be read or is not allowed, or the share cannot be shown by any sample.

    Examples
    --------
    >>> path = Requirement("keeps its path", 'cross_track_p95_m <= 1.0 and ending == "complete"')
    >>> flown = {"cross_track_p95_m": [0.4, 1.5, 0.9], "ending": ["complete", "complete", "aborted"]}
    >>> judged = path.judge(flown)
    >>> judged.held.tolist(), judged.reserve.tolist(), judged.unit
    ([True, False, False], [0.6, -0.5, -inf], 'm')
    """

    name: str
    holds: str
    probability: float = 0.99
    _tree: ast.expr = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 0.0 < self.probability < 1.0:
            raise CampaignError(
                f'requirement "{self.name}": probability: expected a share above 0 and below 1, found'
                f" {self.probability:g}; no number of missions shows that none will ever fail"
            )
        try:
            object.__setattr__(self, "_tree", parse(self.holds))
            _refuse_not_finite(self._tree)
        except CampaignError as error:
            raise self._refused(error) from None

    @property
    def allowed(self) -> float:
        """Failure probability that it allows."""
        return 1.0 - self.probability

    @property
    def metrics(self) -> tuple[str, ...]:
        """Names of the metrics that it needs."""
        return names_in(self._tree)

    def check(self, metrics: Mapping[str, Metric] = KNOWN) -> None:
        """Refuse what cannot be judged by these metrics, before anything flies.

        Raises CampaignError: a name is no metric, kinds do not fit, or the whole is no condition.
        """
        try:
            check(self._tree, metrics)
        except CampaignError as error:
            raise self._refused(error) from None

    def judge(self, metrics: Mapping[str, Any]) -> Judgement:
        """Whether each of k missions held it, and with which reserve.

        `metrics` (k,): numbers, words (``ending``) and truths (``abort``) of the missions; with
        ``completion`` (`seatrial.verification.judgement`) a mission is not infinitely far from being
        complete. Raises CampaignError: as for `check`.
        """
        # Of a long campaign each column is read from a file: only those that are asked for.
        values = {name: np.asarray(metrics[name]) for name in (*self.metrics, COMPLETION) if name in metrics}
        known = {
            name: Metric(_kind_of(array), KNOWN.get(name, _ANY).values) for name, array in values.items()
        }
        self.check({name: known.get(name, _ANY) for name in metrics})
        units = {unit_of(side) or "" for side in _sides(self._tree)}
        if COMPLETION in values and any(_of_completion(node) for node in ast.walk(self._tree)):
            units.add("")
        mixed = len(units) > 1
        with np.errstate(all="ignore"):
            truth, reserve = _judged(self._tree, values, mixed)
        shape = np.broadcast_shapes(*(values[name].shape for name in self.metrics))
        held = np.broadcast_to(truth > 0.0, shape).copy()
        reserve = np.broadcast_to(np.where(truth == 0.0, -np.inf, reserve), shape).copy()
        return Judgement(held, reserve, _SHARE if mixed else (units.pop() if units else ""))

    def _refused(self, error: CampaignError) -> CampaignError:
        return CampaignError(f'requirement "{self.name}": holds: {error}')


_ANY = Metric("number", ())
"""A metric that is not asked for."""


def _kind_of(array: Values) -> Any:
    if array.dtype == np.bool_:
        return "truth"
    return "number" if np.issubdtype(array.dtype, np.number) else "word"


def _sides(tree: ast.expr) -> list[ast.expr]:
    """Of every comparison of numbers, a side that names a metric."""
    comparisons = [[node.left, *node.comparators] for node in ast.walk(tree) if isinstance(node, ast.Compare)]
    return [
        next((side for side in sides if unit_of(side) is not None), sides[0])
        for sides in comparisons
        if not any(isinstance(side, ast.Constant) and isinstance(side.value, str) for side in sides)
    ]


def _judged(node: ast.expr, metrics: Mapping[str, Values], mixed: bool) -> tuple[Array, Array]:
    """Truth (1: true, -1: false, 0: neither) and reserve (not a number where neither) of a condition."""
    match node:
        case ast.UnaryOp(operand=operand):
            truth, reserve = _judged(operand, metrics, mixed)
            return -truth, -reserve
        case ast.BoolOp(op=op, values=values):
            return _joined(op, [_judged(value, metrics, mixed) for value in values])
        case ast.Compare(left=left, ops=ops, comparators=comparators):
            sides = [left, *comparators]
            links = zip(sides, ops, comparators, strict=False)
            return _joined(ast.And(), [_compared(one, op, two, metrics, mixed) for one, op, two in links])
        case ast.Name(id=name):
            return _certain(metrics[name])
    raise AssertionError(ast.dump(node))  # `check` lets nothing else through


def _joined(op: ast.boolop, parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    truths, reserves = zip(*(np.broadcast_arrays(*part) for part in parts), strict=True)
    pick, among = (np.minimum, np.fmin) if isinstance(op, ast.And) else (np.maximum, np.fmax)
    truth, reserve = reduce(pick, truths), reduce(among, reserves)
    return truth, np.where(truth == 0.0, np.nan, reserve)


def _certain(truth: Values) -> tuple[Array, Array]:
    sign = np.where(truth, 1.0, -1.0)
    return sign, sign * np.inf


def _compared(
    one: ast.expr, op: ast.cmpop, other: ast.expr, metrics: Mapping[str, Values], mixed: bool
) -> tuple[Array, Array]:
    a, b = _value(one, metrics), _value(other, metrics)
    if not np.issubdtype(a.dtype, np.number):
        held = (a == b) == isinstance(op, ast.Eq)
        if COMPLETION in metrics and _of_completion(ast.Compare(one, [op], [other])):
            return np.where(held, 1.0, -1.0), metrics[COMPLETION] * (1.0 if isinstance(op, ast.Eq) else -1.0)
        return _certain(held)
    apart = np.abs(a - b)
    compare, reserve = {
        ast.Lt: (np.less, b - a),
        ast.LtE: (np.less_equal, b - a),
        ast.Gt: (np.greater, a - b),
        ast.GtE: (np.greater_equal, a - b),
        ast.Eq: (np.equal, -apart),
        ast.NotEq: (np.not_equal, apart),
    }[type(op)]
    truth = np.where(np.isnan(a) | np.isnan(b), 0.0, np.where(compare(a, b), 1.0, -1.0))
    if mixed:
        reserve = reserve / _threshold(one, other, a, b)
    # Equal infinities have no distance, yet they compare.
    reserve = np.where(np.isnan(reserve), 0.0, reserve)
    return truth, np.where(truth == 0.0, np.nan, reserve)


COMPLETION = "completion"
"""Metric that grades ``ending == "complete"``, where it is given."""


def _of_completion(node: ast.AST) -> bool:
    """Whether a condition compares the ending with "complete"."""
    if not isinstance(node, ast.Compare) or len(node.comparators) != 1:
        return False
    sides = (node.left, node.comparators[0])
    named = any(isinstance(side, ast.Name) and side.id == "ending" for side in sides)
    return named and any(isinstance(side, ast.Constant) and side.value == "complete" for side in sides)


def _threshold(one: ast.expr, other: ast.expr, a: Values, b: Values) -> Values:
    """Size that makes reserves of different units comparable: that of the plain number, if it is not zero."""
    for node, value in ((other, b), (one, a)):
        if unit_of(node) is None and np.all(value != 0.0):
            return np.asarray(np.abs(value))
    return np.asarray(np.maximum(np.maximum(np.abs(a), np.abs(b)), np.finfo(np.float64).tiny))


def _value(node: ast.expr, metrics: Mapping[str, Values]) -> Values:
    """Value of a number or word, (k,) or a single one."""
    match node:
        case ast.Constant(value=value):
            return np.asarray(value if isinstance(value, str) else float(value))  # type: ignore[arg-type]
        case ast.Name(id=name):
            array = metrics[name]
            return array.astype(np.float64) if np.issubdtype(array.dtype, np.number) else array
        case ast.UnaryOp(op=op, operand=operand):
            inner = _value(operand, metrics)
            return -inner if isinstance(op, ast.USub) else inner
        case ast.BinOp(left=left, op=op, right=right):
            return np.asarray(_SUMS[type(op)](_value(left, metrics), _value(right, metrics)))
        case ast.Call(func=ast.Name(id=name), args=args):
            first, *others = [_value(argument, metrics) for argument in args]
            if not others:
                return np.asarray(_FUNCTIONS[name](first))
            return np.asarray(reduce(_FUNCTIONS[name], others, first))
    raise AssertionError(ast.dump(node))  # `check` lets nothing else through


def _refuse_not_finite(tree: ast.expr) -> None:
    """Refuse sums without a metric that give no finite number, and divisions by such a sum that is zero.

    Raises CampaignError: with the smallest part that is wrong.
    """
    for node in reversed(list(ast.walk(tree))):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div) and _constant(node.right) == 0.0:
            raise CampaignError(f'"{ast.unparse(node)}" divides by zero; correct the number')
        value = _constant(node)
        if value is not None and not np.isfinite(value):
            raise CampaignError(f'"{ast.unparse(node)}" is {value:g}; expected a finite number')


def _constant(node: ast.AST) -> float | None:
    """Value of a sum of numbers; None where it names a metric or is none."""
    parts = list(ast.walk(node))
    words = any(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in parts)
    truths = any(isinstance(part, ast.Compare | ast.BoolOp | ast.Not) for part in parts)
    if not isinstance(node, ast.expr) or words or truths or names_in(node):
        return None
    with np.errstate(all="ignore"):
        return float(_value(node, {}))


_SUMS = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power}
_FUNCTIONS = {"abs": np.abs, "sqrt": np.sqrt, "min": np.minimum, "max": np.maximum}
Circle = tuple[float, float, float]


def obstacles(entries: Sequence[Obstacle]) -> list[Circle]:
    """Circles (north, east, radius), m, of a campaign; what a mission itself states stands there anyway.

    An entry ``from_mission`` adds nothing.
    """
    return [
        (entry.north_m, entry.east_m, entry.radius_m)
        for entry in entries
        if entry.north_m is not None and entry.east_m is not None and entry.radius_m is not None
    ]


_SURE = 1.96  # normal quantile of 95 % on two sides


def named(names: Sequence[str], known: Mapping[str, _T]) -> list[_T]:
    """Those of these names, of all that are known by the names of their requirements.

    Raises CampaignError where there is no requirement of such a name.
    """
    for name in names:
        if name not in known:
            raise CampaignError(f'requirement: unknown "{name}"{nearest(name, known)}')
    return [known[name] for name in names]


def _has_course(mission: Mission) -> bool:
    """Whether some straight leg is long enough for a cross-track error: it counts on the second half."""
    points = mission.waypoints
    places = np.stack([points["north_m"], points["east_m"]], axis=1)
    start = [[mission.start["north_m"], mission.start["east_m"]]]
    lengths = np.hypot(*np.diff(np.vstack([start, places]), axis=0).T)
    straight = np.asarray(points["circle_radius_m"]) == 0.0
    return bool(np.any(straight & (0.5 * lengths > np.asarray(points["acceptance_radius_m"]))))


def default_requirements(
    table: VerificationTable, missions: Sequence[Mission], *, position_sd_m: float = 0.0
) -> tuple[Requirement, ...]:
    """Requirements of missions where the campaign states none.

    A mission that only dives has no course: then the depths between the ends of each leg are to be kept.

    `missions`: those of the table. `position_sd_m`: standard deviation of the position that the sensors give,
    along an axis.
    """
    radius = min(float(np.min(one.waypoints["acceptance_radius_m"])) for one in missions)
    # Rounded up to a decimetre: nobody states a finer one.
    allowance = math.ceil(10.0 * _SURE * position_sd_m) / 10.0
    deepest = min(float(one.limits["max_depth_m"]) for one in missions)
    asked = [
        ("is complete", 'ending == "complete" and not abort'),
        ("keeps its path", f"true_cross_track_p95_m <= {radius + allowance:g}")
        if all(_has_course(one) for one in missions)
        else ("keeps its depths", f"depth_excursion_m <= {radius:g}"),
    ]
    if obstacles(table.obstacles) or any(one.obstacles for one in missions):
        asked.append(("touches nothing", "clearance_m > 0"))
    if promised := [one.promised_m for one in missions if one.promised_m > 0.0]:
        asked.append((
            "keeps its distance",
            f"clearance_reserve_m >= {-METRIC_SETTINGS.short_of_promise * min(promised):g}",
        ))
    if table.seabed is not None:
        asked.append(("stays off the bottom", "altitude_smallest_m > 0"))
    if np.isfinite(deepest):
        asked.append(("keeps its depth limit", f"depth_largest_m <= {deepest:g}"))
    # Where nothing is said, 95 % of the missions have to hold a requirement.
    return tuple(Requirement(name, holds, 0.95) for name, holds in asked)
