"""A vehicle with what is known of its coefficients, and vehicles drawn from it.

Draws are multivariate normal, ``x = x_0 + D R z`` with D the standard deviations and R the symmetric root of
the correlations. It exists for singular ones (tied coefficients), where a Cholesky factor does not, and does
not depend on the signs that a library gives its eigenvectors. What no vehicle can have
(`seatrial.vehicle.passivity`) is thrown away and drawn again: the normal distribution cut at what is
possible. Draw i depends on the seed and on i alone (`seatrial.statistics.draws`).

Tests: ``tests/identification/test_fitted.py``.

Covariance of the coefficients that an identification set, in a form from which vehicles can be drawn.

The joint estimate's covariance V is that of parameters; a parameter sets its members by factors F, so that
the coefficients have ``F' V F``: what is tied moves together.

Data tell some combinations badly or not at all, and the sandwich has no number for the latter. The campaign's
bounds say how far they may lie. In widths of the bounds no direction is taken as wider than a number anywhere
inside them, a standard deviation of ``1/sqrt(12)`` (that of `seatrial.diagnosis.identifiability`): larger
eigenvalues are cut there, and directions without information, the right singular vectors of zero, get it.
What the data do tell of the same coefficients stays as it is.

The bench test's thrust counts as exact in the joint estimate. Its own standard deviation at the strongest
point comes on top, common to the actuators that were pulled together. It is added without refitting the rest,
although a wrong thrust would move the damping along with it: the vehicles drawn are a little more unlike each
other than they need to be.

It is the covariance of the best model in the class. Where the truth lies outside
(`seatrial.diagnosis.residual_analysis`), it may be many of these standard deviations away; nor does it hold the common factor of all forces, which trials
do not tell (`seatrial.estimation.scale`). The notes say both wherever the covariance is drawn from.

Tests: ``tests/identification/test_coefficient_covariance.py``.

Standard deviations in percent of coefficients, by name, pattern or group, on top of a covariance.

Tests: ``tests/identification/test_fitted.py``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, nearest, reason
from seatrial.base.toml_file import loaded
from seatrial.campaign.parameters import names, spread
from seatrial.estimation.scale import STATIC
from seatrial.statistics.draws import checked_numbers, generator
from seatrial.vehicle.actuators import actuator_groups
from seatrial.vehicle.passivity import PossibleCoefficients

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.result import BenchTest
    from seatrial.diagnosis.assessment import Certainty
    from seatrial.identification.identification import Identification

__all__ = ["CoefficientCovariance", "Drawn", "Fitted", "coefficient_covariance", "widened"]

_UNIFORM = 1.0 / 12.0  # variance of a number somewhere in an interval of length one

_NONE = 1e-5  # singular value, over the largest, that is rounding: the root of the information's 1e-11

_ABSENT = 1e-4  # component of a unit vector that is no part of it


@dataclass(frozen=True, eq=False)
class CoefficientCovariance:
    """How well coefficients are known.

    Attributes
    ----------
    names
        Coefficients (n,).
    at
        Their values (n,), SI.
    matrix
        Covariance (n, n), SI; singular where coefficients are tied.
    notes
        Sentences: what is not in it, and what is there by assumption.
    """

    names: tuple[str, ...]
    at: Array
    matrix: Array
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The same as plain lists."""
        return {
            "names": list(self.names),
            "at": self.at.tolist(),
            "matrix": self.matrix.tolist(),
            "notes": list(self.notes),
        }

    @classmethod
    def from_dict(cls, data: Any, source: str) -> CoefficientCovariance:
        """Covariance of plain lists.

        Raises
        ------
        CampaignError
            They do not fit together; the message begins with `source`.
        """
        try:
            known = tuple(str(name) for name in data["names"])
            at = np.array(data["at"], float).reshape(len(known))
            matrix = np.array(data["matrix"], float).reshape(len(known), len(known))
            notes = tuple(str(note) for note in data.get("notes", ()))
        except (KeyError, TypeError, ValueError, AttributeError):
            raise CampaignError(
                f"{source}: key covariance: expected names, their values under at and a square matrix; let"
                " `seatrial identify` write the file again"
            ) from None
        if not (np.isfinite(at).all() and np.isfinite(matrix).all()):
            raise CampaignError(
                f"{source}: key covariance: expected finite numbers; let `seatrial identify` write the file"
                " again"
            )
        return cls(known, at, matrix, notes)


def coefficient_covariance(identification: Identification) -> CoefficientCovariance | None:
    """Covariance of the coefficients of an identification; None without a joint estimate.

    Parameters
    ----------
    identification : Identification
    """
    certainty = identification.certainty
    if certainty is None:
        return None
    parameters, own = certainty.parameters, identification.vehicle.coefficients()
    matrix, notes = _bounded(certainty)
    factors = spread(parameters)
    found, among = names(parameters), factors.T @ matrix @ factors
    notes += _beyond(identification)
    alone = [row.name for row in identification.coefficients if row.name not in found]
    if alone:
        notes.append(
            f"{_listed(alone)}: set by a stage and not in the joint estimate, so there is no standard"
            " deviation; draws keep the estimate."
        )
    if (bench := identification.campaign.bench) is not None:
        found, among = _with_thrust(found, among, bench, own, notes)
    at = np.array([own.get(name, 0.0) for name in found])
    return CoefficientCovariance(tuple(found), at, 0.5 * (among + among.T), tuple(notes))


def _beyond(identification: Identification) -> list[str]:
    """Sentences on what no draw contains: what the model class lacks, and another scale of all forces."""
    certainty, scale, said = identification.certainty, identification.scale, []
    if certainty is not None and certainty.criticism.warning:
        said.append(
            f"{certainty.criticism.warning}. Draws stay within that class; deviations on top, such as"
            ' coefficients = { "*_uu" = 10.0 } under [verification], stand for what it lacks.'
        )
    if not scale.tested and any(one.kind != STATIC for one in scale.homogeneity.held):
        rests = scale.homogeneity.sentences()[1]
        said.append(
            f"{rests}; draws do not vary it, all forces and masses together may be larger or smaller."
        )
    return said


def _bounded(certainty: Certainty) -> tuple[Array, list[str]]:
    """Covariance (p, p) of the parameters with the bounds in place of what the data do not tell."""
    uncertainty, told = certainty.uncertainty, certainty.identifiability
    known = [parameter.name for parameter in certainty.parameters]
    places = [uncertainty.names.index(name) for name in known]
    width = np.array([parameter.upper - parameter.lower for parameter in certainty.parameters])
    scaled = uncertainty.covariance[np.ix_(places, places)] / np.outer(width, width)
    absent = ~np.isfinite(uncertainty.sigma[places])
    silent = _silent(
        told.singular_values, told.vectors[:, [told.names.index(name) for name in known]], absent
    )
    rest = np.eye(len(known)) - silent @ silent.T
    values, vectors = np.linalg.eigh(rest @ scaled @ rest)
    cut = values > _UNIFORM
    if not cut.any() and not silent.shape[1]:
        return width[:, None] * scaled * width, []
    bounded = (vectors * np.clip(values, 0.0, _UNIFORM)) @ vectors.T + _UNIFORM * silent @ silent.T
    along = absent | (np.abs(vectors[:, cut]).max(axis=1, initial=0.0) > 0.5)
    weak = [name for name, one in zip(known, along, strict=True) if one]
    said = [
        f"{_listed(weak)}: the data tell less than the campaign's bounds, and draws vary as a number anywhere"
        " inside them (standard deviation 0.29 of their width); what hangs on that varies less with it."
    ]
    return width[:, None] * bounded * width, said if weak else []


def _silent(singular: Array, vectors: Array, absent: NDArray[np.bool_]) -> Array:
    """Orthonormal directions (p, s), in widths of the bounds, of which the data tell nothing."""
    if not absent.any():
        return np.zeros((len(absent), 0))
    rows = [row for value, row in zip(singular, vectors, strict=True) if value <= _NONE * singular[0]]
    for place in np.flatnonzero(absent):
        if not any(abs(row[place]) > _ABSENT for row in rows):
            rows.append(np.eye(len(absent))[place])
    return np.asarray(np.linalg.qr(np.array(rows).T)[0])


def _with_thrust(
    known: list[str], matrix: Array, bench: BenchTest, own: Mapping[str, float], notes: list[str]
) -> tuple[list[str], Array]:
    """Coefficients and covariance with the bench test's own uncertainty of the thrust."""
    said = []
    for name, fit in bench.pulls.items():
        share = _thrust_sd(fit)
        gains = [gain for actuator in fit.unit.actuators if (gain := f"{actuator}.gain") in own]
        if share <= 0.0 or not gains:
            continue
        new = [gain for gain in gains if gain not in known]
        known = [*known, *new]
        matrix = np.pad(matrix, (0, len(new)))
        along = np.zeros(len(known))
        along[[known.index(gain) for gain in gains]] = [share * own[gain] for gain in gains]
        matrix = matrix + np.outer(along, along)
        said.append(f"{name} {100.0 * share:.2g} %")
    if said:
        notes.append(f"Thrust varies by the bench test's own standard deviation: {', '.join(said)}.")
    return known, matrix


def _thrust_sd(fit: Any) -> float:
    """Relative standard deviation of a group's fitted thrust at the strongest point, the worse direction."""
    worst = 0.0
    for direction in fit.directions.values():
        strongest = direction.points[np.argmax(np.abs(fit.points.signal[direction.points]))]
        inputs = [abs(float(fit.points.signal[strongest]))]
        if len(direction.fit.scale) > 1:
            inputs.append(float(fit.points.voltage_v[strongest]))
        curve = float(direction.fit.bands([inputs])[0][0]) / direction.fit.quantile
        worst = max(worst, curve / abs(float(direction.fit.at([inputs])[0])))
    return worst if np.isfinite(worst) else 0.0


def _listed(known: list[str]) -> str:
    return ", ".join(known)


def widened(
    vehicle: Vehicle, percent: Mapping[str, float], *, names: Sequence[str], covariance: Array
) -> tuple[tuple[str, ...], Array]:
    """Names (m,) and covariance (m, m), SI, with further relative standard deviations.

    Parameters
    ----------
    vehicle : Vehicle
        Of whose values the percentages are.
    percent : mapping of str to float
        By name, by pattern (``"*_uu"``: each for itself) or by group (``"stern.gain"``: all together).
    names, covariance : (n,) sequence of str, (n, n) array
        What they are added to.

    Raises
    ------
    CampaignError
        A name is unknown or its value zero, or a percentage is impossible.

    Examples
    --------
    >>> import seatrial as st
    >>> own = st.Vehicle.load("cwolf")
    >>> names, matrix = widened(own, {"m": 2.0}, names=(), covariance=np.zeros((0, 0)))
    >>> names, matrix.round(2).tolist()
    (('m',), [[7.29]])
    """
    own = vehicle.coefficients()
    known, matrix = list(names), covariance
    for pattern, share in percent.items():
        number = isinstance(share, int | float) and not isinstance(share, bool)
        if not number or not 0.0 < share < 100.0:
            raise CampaignError(
                f"standard deviations: {pattern!r}: expected percent above 0 and below 100, found {share!r}"
            )
        for together in _meant(pattern, vehicle, own):
            new = [name for name in together if name not in known]
            known += new
            matrix = np.pad(matrix, (0, len(new)))
            along = np.zeros(len(known))
            along[[known.index(name) for name in together]] = [0.01 * share * own[name] for name in together]
            matrix = matrix + np.outer(along, along)
    return tuple(known), matrix


def _meant(pattern: str, vehicle: Vehicle, own: Mapping[str, float]) -> list[list[str]]:
    """Coefficients behind a name, a pattern or a group, those that vary together in one list."""
    group, _, suffix = pattern.partition(".")
    groups = actuator_groups(vehicle)
    if pattern not in own and group in groups:
        together = [name for actuator in groups[group] if (name := f"{actuator}.{suffix}") in own]
        if together:
            return [together]
    found = [[name] for name in own if fnmatchcase(name, pattern) and own[name] != 0.0]
    if not found:
        zero = [name for name in own if fnmatchcase(name, pattern)]
        raise CampaignError(
            f"standard deviations: {zero[0]} of {vehicle.name} is zero, and so is any percentage of it;"
            " leave it out"
            if zero
            else f"standard deviations: {vehicle.name} has no coefficient {pattern!r}{nearest(pattern, own)}"
        )
    return found


RESULT = "identification.json"

_CAUSE = 1  # stream of the coefficients

_TRIES, _ROUNDS = 8, 125  # attempts at once, and how often, before a draw is given up

_CHUNK = 4096

_AWAY = 1e-6  # relative; a file of text keeps more digits


@dataclass(frozen=True, eq=False)
class Drawn:
    """Coefficients of k drawn vehicles.

    Attributes
    ----------
    names, values
        Coefficients (n,), and their values (k, n), SI.
    thrown
        How many impossible draws went before each, (k,).
    """

    names: tuple[str, ...]
    values: Array
    thrown: NDArray[np.int_]

    @property
    def coefficients(self) -> dict[str, Array]:
        """Values (k,) by name, as `seatrial.fly_batch` takes them."""
        return {name: self.values[:, k].copy() for k, name in enumerate(self.names)}

    def sentence(self) -> str:
        """How many draws were thrown away, in words; empty if none was."""
        lost = int(self.thrown.sum())
        if not lost:
            return ""
        share = lost / (lost + len(self.values))
        return (
            f"{lost} of {lost + len(self.values)} drawn vehicles ({100 * share:.2g} %) were physically"
            " impossible (damping that adds energy, negative mass or gain) and drawn again."
        )


@dataclass(frozen=True, eq=False)
class Fitted:
    """A vehicle and how well its coefficients are known.

    Attributes
    ----------
    vehicle
        With the best values: the centre of the draws.
    names
        Coefficients that are uncertain (n,).
    covariance
        Their covariance (n, n), SI.
    notes
        Sentences: what is not in the covariance, and what is there by assumption.

    Examples
    --------
    >>> fitted = Fitted.of("cwolf", percent={"X_uu": 10.0, "stern.gain": 5.0})
    >>> drawn = fitted.draws(100, 7)
    >>> sorted(drawn), bool((drawn["X_uu"] < 0.0).all())
    (['PL.gain', 'PU.gain', 'SbL.gain', 'SbU.gain', 'X_uu'], True)
    """

    vehicle: Vehicle
    names: tuple[str, ...]
    covariance: Array
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        source: Fitted | Identification | Vehicle | str | Path,
        *,
        percent: Mapping[str, float] | None = None,
    ) -> Fitted:
        """A vehicle and how well it is known, from wherever that stands.

        Parameters
        ----------
        source : Fitted, Identification, Vehicle, str or Path
            A result of `seatrial.identify`, its run directory, or a vehicle, whose coefficients count as
            exact.
        percent : mapping of str to float, optional
            Further standard deviations in percent of the value, independent of everything else, by name, by
            pattern (``"*_uu"``: each for itself) or by group (``"stern.gain"``: all of the group together).

        Raises
        ------
        CampaignError
            The run directory cannot be read or does not belong together; a name is unknown, a percentage
            impossible.
        VehicleError
            The vehicle cannot be loaded.
        """
        fitted = source if isinstance(source, Fitted) else _found(source)
        if not percent:
            return fitted
        names, matrix = widened(fitted.vehicle, percent, names=fitted.names, covariance=fitted.covariance)
        return cls(fitted.vehicle, names, matrix, fitted.notes)

    @property
    def nominal(self) -> Array:
        """Values of the uncertain coefficients (n,), SI."""
        own = self.vehicle.coefficients()
        return np.array([own.get(name, 0.0) for name in self.names])

    @property
    def sigma(self) -> Array:
        """Standard deviations of the uncertain coefficients (n,), SI, before anything is cut."""
        return np.sqrt(np.diag(self.covariance))

    def draws(self, k: int | ArrayLike, seed: int, *, nominal_first: bool = False) -> dict[str, Array]:
        """Coefficients of k drawn vehicles by name, (k,) each, SI; see `drawn`."""
        return self.drawn(k, seed, nominal_first=nominal_first).coefficients

    def drawn(self, k: int | ArrayLike, seed: int, *, nominal_first: bool = False) -> Drawn:
        """Vehicles drawn, and how many impossible ones were thrown away.

        Parameters
        ----------
        k : int or (k,) array_like of int
            How many, or the numbers of the draws: number 17 is the same in both ways.
        seed : int
        nominal_first : bool
            Whether draw 0 is the vehicle itself.

        Raises
        ------
        CampaignError
            A thousand draws in a row were impossible.
        """
        numbers = checked_numbers(k)
        values = np.tile(self.nominal, (len(numbers), 1))
        thrown = np.zeros(len(numbers), dtype=np.int_)
        asked = np.array([place for place, i in enumerate(numbers) if not (nominal_first and i == 0)], int)
        if self.names:
            root = _root(self.covariance)
            possible = PossibleCoefficients(self.vehicle, self.names)
            for start in range(0, len(asked), _CHUNK):
                self._fill(asked[start : start + _CHUNK], numbers, seed, root, possible, (values, thrown))
        return Drawn(self.names, values, thrown)

    def _fill(
        self,
        open_: NDArray[np.int_],
        numbers: list[int],
        seed: int,
        root: Array,
        possible: PossibleCoefficients,
        into: tuple[Array, NDArray[np.int_]],
    ) -> None:
        """Draw until every place has a possible vehicle."""
        values, thrown = into
        centre, wrong = self.nominal, np.zeros(len(self.names))
        for round_ in range(_ROUNDS):
            normal = np.array([
                generator(seed, numbers[place], cause=_CAUSE, attempt=round_).standard_normal((
                    _TRIES,
                    len(self.names),
                ))
                for place in open_
            ])
            left = np.arange(len(open_))
            for attempt in range(_TRIES):
                tried = centre + normal[left, attempt] @ root
                good = possible.mask(tried)
                values[open_[left[good]]] = tried[good]
                thrown[open_[left[~good]]] += 1
                wrong += possible.outside(tried).sum(axis=0)
                left = left[~good]
                if not left.size:
                    return
            open_ = open_[left]
        worst = int(wrong.argmax())
        name, unit = self.names[worst], self.vehicle.coefficient_info()[self.names[worst]]["unit"]
        raise CampaignError(
            f"{self.vehicle.name}: {_TRIES * _ROUNDS} vehicles drawn for number {numbers[open_[0]]} are all"
            f" physically impossible, most often by {name} = {centre[worst]:.4g} {unit} with a standard"
            f" deviation of {self.sigma[worst]:.3g}; identify it better, give it narrower bounds, or draw no"
            " coefficients"
        )


def _found(source: Any) -> Fitted:
    """A vehicle and its covariance of an identification, a run directory or a vehicle."""
    from seatrial._core import Vehicle
    from seatrial.identification.identification import Identification

    if isinstance(source, Identification):
        return _with(source.vehicle, source.covariance, f"the identification {source.campaign.name}")
    if isinstance(source, str | Path) and Path(source).is_dir():
        folder = Path(source)
        path = folder / RESULT
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise CampaignError(
                f"{folder}: expected a run directory of `seatrial identify`, but {RESULT} cannot be read"
                f" ({reason(error)}); give the folder that it printed, or a vehicle file"
            ) from None
        if not isinstance(data, dict) or "covariance" not in data:
            raise CampaignError(
                f"{path}: expected the key covariance, found none; let `seatrial identify` write it again"
            )
        given = data["covariance"]
        known = None if given is None else CoefficientCovariance.from_dict(given, str(path))
        return _with(Vehicle.load(folder / "vehicle.toml"), known, str(path))
    vehicle: Vehicle = loaded(Vehicle, source)
    return Fitted(vehicle, (), np.zeros((0, 0)))


def _with(vehicle: Vehicle, known: CoefficientCovariance | None, source: str) -> Fitted:
    if known is None:
        note = f"{source} has no joint estimate: its coefficients count as exact."
        return Fitted(vehicle, (), np.zeros((0, 0)), (note,))
    own = vehicle.coefficients()
    for name, value in zip(known.names, known.at.tolist(), strict=True):
        if abs(own.get(name, 0.0) - value) > _AWAY * max(abs(value), 1e-9):
            raise CampaignError(
                f"{source}: the covariance holds about {name} = {value:.6g}, and the vehicle beside it has"
                f" {own.get(name, 0.0):.6g}; they belong to different runs: identify again, or give the"
                " vehicle file alone"
            )
    return Fitted(vehicle, known.names, known.matrix, known.notes)


def _root(covariance: Array) -> Array:
    """Matrix S (n, n) with ``S' S`` the covariance; what is rounding beside the largest part is zero."""
    size = np.sqrt(np.diag(covariance))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    values = np.where(values > len(size) * np.finfo(float).eps * values.max(initial=0.0), values, 0.0)
    root = (vectors * np.sqrt(values)) @ vectors.T
    return np.asarray(root * size)
