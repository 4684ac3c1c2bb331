"""A vehicle with what is known of its coefficients, vehicles drawn from it, and the random numbers of draws.

Draws are multivariate normal, ``x = x_0 + D R z`` with D the standard deviations and R the symmetric root of
the correlations. It exists for singular ones (tied coefficients), where a Cholesky factor does not, and does
not depend on the signs that a library gives its eigenvectors. What no vehicle can have
(`seatrial.vehicle.stability`) is thrown away and drawn again: the normal distribution cut at what is
possible.

The random numbers of draw i depend on seed, cause and i alone (`generator`). Philox is a counter-based
generator: its output is a keyed bijection of a counter, so that streams whose counters differ never meet
(Salmon, Moraes, Dror and Shaw 2011, *Parallel random numbers: as easy as 1, 2, 3*, SC'11). The key holds the
seed and the cause, the counter the number of the draw and of the attempt; a stream may run for 2^64 blocks
before it would meet the next attempt. A draw can be repeated alone, and a further cause changes no other.

Tests: ``tests/identification/test_fitted.py``, ``tests/verification/test_draws.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, SimulationError, nearest, reason
from seatrial.base.finding import Finding, Severity
from seatrial.base.report import sentence_of
from seatrial.base.run import from_json
from seatrial.base.toml_file import loaded
from seatrial.diagnosis.roles import manoeuvre, role
from seatrial.identification.estimate import CoefficientCovariance
from seatrial.identification.hold_out import FilterNoise, fitted_records, residual_noise
from seatrial.identification.identification import Identification
from seatrial.vehicle.actuators import actuator_groups, pushed_axes
from seatrial.vehicle.stability import PossibleCoefficients

if TYPE_CHECKING:
    from seatrial._core import Vehicle


RESULT = "identification.json"


@dataclass(frozen=True)
class FittedSettings:
    """How vehicles are drawn from a covariance."""

    #: Stream of random numbers of the coefficients.
    stream: int = 1
    #: Attempts at once for a vehicle that is physically possible.
    tries: int = 8
    #: Rounds of attempts before a draw is given up.
    rounds: int = 125
    #: Vehicles drawn at a time, so that memory does not grow with the number asked for.
    chunk: int = 4096
    #: Share of impossible draws that heads a report.
    doubtful_share: float = 0.1
    #: Relative difference of two values that are the same: a file of text keeps more digits.
    same_share: float = 1e-6


SETTINGS = FittedSettings()


@dataclass(frozen=True, eq=False)
class Drawn:
    """Coefficients of k drawn vehicles."""

    #: Coefficients (n,), and their values (k, n), SI.
    names: tuple[str, ...]
    values: Array
    #: How many impossible draws went before each, (k,).
    thrown: NDArray[np.int_]
    #: How often a coefficient had a part in what made a draw impossible, (n,).
    outside: Array
    #: Letters of the axes that the vehicle's thrusters push directly, for the words.
    pushed: str = "XYZKMN"

    @property
    def coefficients(self) -> dict[str, Array]:
        """Values (k,) by name, as `seatrial.fly_batch` takes them."""
        return {name: self.values[:, k].copy() for k, name in enumerate(self.names)}

    @property
    def impossible(self) -> float:
        """Share of all that was drawn that no vehicle can be."""
        lost = int(self.thrown.sum())
        return lost / max(lost + len(self.values), 1)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """How many draws were thrown away; a problem where they were a tenth or more."""
        lost = int(self.thrown.sum())
        values = {"lost": lost, "drawn": lost + len(self.values), "share": self.impossible}
        if not lost:
            return ()
        note = Finding("draws impossible", Severity.NOTE, values=values)
        if self.impossible < SETTINGS.doubtful_share:
            return (note,)
        name = self.names[int(self.outside.argmax())]
        way = manoeuvre(role(name, pushed=self.pushed))
        return note, Finding("draws doubtful", Severity.PROBLEM, name, {**values, "manoeuvre": way})

    def sentence(self) -> str:
        """How many draws were thrown away, in words; empty if none was."""
        return self._said(0)

    def doubt(self) -> str:
        """Heading where a tenth or more was thrown away: how many, by which coefficient, what to do."""
        return self._said(1)

    def _said(self, place: int) -> str:
        return "".join(sentence_of(finding, "diagnosis") for finding in self.findings[place : place + 1])


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
    >>> import seatrial as st
    >>> fitted = st.Fitted.of("cwolf", percent={"X_uu": 10.0, "stern.gain": 5.0})
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
        """Coefficients of drawn vehicles by name, (k,) each, SI.

        Parameters
        ----------
        k : int or (k,) array_like of int
            How many, or the numbers of the draws.
        seed : int
        nominal_first : bool
            Whether draw 0 is the vehicle itself.
        """
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
        thrown, outside = np.zeros(len(numbers), dtype=np.int_), np.zeros(len(self.names))
        asked = np.array([place for place, i in enumerate(numbers) if not (nominal_first and i == 0)], int)
        if self.names:
            root, possible = self._root, self._possible
            for start in range(0, len(asked), SETTINGS.chunk):
                self._fill(
                    asked[start : start + SETTINGS.chunk],
                    numbers,
                    seed,
                    root,
                    possible,
                    (values, thrown, outside),
                )
        return Drawn(self.names, values, thrown, outside, pushed_axes(self.vehicle))

    def at(self, normals: Array) -> tuple[dict[str, Array], NDArray[np.bool_]]:
        """Coefficients by name, (k,) each, of standard normal numbers, and which vehicles are possible.

        Parameters
        ----------
        normals : (k, n) array
            One number per name; several give the distribution of `draws`, before anything is cut.
        """
        if not self.names:
            return {}, np.ones(len(normals), dtype=bool)
        values = self.nominal + normals @ self._root
        return {name: values[:, k].copy() for k, name in enumerate(self.names)}, self._possible.mask(values)

    @cached_property
    def _root(self) -> Array:
        return _root(self.covariance)

    @cached_property
    def _possible(self) -> PossibleCoefficients:
        return PossibleCoefficients(self.vehicle, self.names)

    def doubt(self, *, draws: int = 200) -> str:
        """Heading where many vehicles drawn from the covariance are impossible, see `Drawn.doubt`."""
        if not self.names:
            return ""
        try:
            return self.drawn(draws, 0).doubt()
        except CampaignError as error:
            return str(error)

    def _fill(
        self,
        open_: NDArray[np.int_],
        numbers: list[int],
        seed: int,
        root: Array,
        possible: PossibleCoefficients,
        into: tuple[Array, NDArray[np.int_], Array],
    ) -> None:
        """Draw until every place has a possible vehicle."""
        values, thrown, wrong = into
        centre = self.nominal
        for round_ in range(SETTINGS.rounds):
            normal = np.array([
                generator(seed, numbers[place], cause=SETTINGS.stream, attempt=round_).standard_normal((
                    SETTINGS.tries,
                    len(self.names),
                ))
                for place in open_
            ])
            left = np.arange(len(open_))
            for attempt in range(SETTINGS.tries):
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
            f"{self.vehicle.name}: {SETTINGS.tries * SETTINGS.rounds} vehicles drawn for number"
            f" {numbers[open_[0]]} are all"
            f" physically impossible, most often by {name} = {centre[worst]:.4g} {unit} with a standard"
            f" deviation of {self.sigma[worst]:.3g}; identify it better, give it narrower bounds, or draw no"
            " coefficients"
        )


def _found(source: Any) -> Fitted:
    """A vehicle and its covariance of an identification, a run directory or a vehicle."""
    from seatrial._core import Vehicle, file_text

    if isinstance(source, Identification):
        return _with(source.vehicle, source.covariance, f"the identification {source.problem.name}")
    if isinstance(source, str | Path) and Path(source).is_dir():
        folder = Path(source)
        path = folder / RESULT
        try:
            data = from_json(file_text(path))
        except ValueError as error:
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
        if abs(own.get(name, 0.0) - value) > SETTINGS.same_share * max(abs(value), 1e-9):
            raise CampaignError(
                f"{source}: the covariance holds about {name} = {value:.6g}, and the vehicle beside it has"
                f" {own.get(name, 0.0):.6g}; they belong to different runs: identify again, or give the"
                " vehicle file alone"
            )
    return Fitted(vehicle, known.names, known.matrix, known.notes)


def _root(covariance: Array) -> Array:
    """Matrix S (n, n) with ``S' S`` the covariance; what is rounding beside the largest part is zero."""
    own = np.sqrt(np.diag(covariance))
    size = np.where(own > 0.0, own, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    values = np.where(values > len(size) * np.finfo(float).eps * values.max(initial=0.0), values, 0.0)
    root = (vectors * np.sqrt(values)) @ vectors.T
    return np.asarray(root * own)  # what has no variance keeps its value to the last bit


def filter_noise(fit: Identification) -> FilterNoise:
    """Noise of a navigation filter on the identified vehicle, from the residuals of the fitted samples.

    Parameters
    ----------
    fit : Identification
        With its campaign: its trials are read again.

    Returns
    -------
    FilterNoise
        ``force`` (6,), deviations of the unmodelled force in N and N m, ``force_time_s``, its time constant,
        and ``acceleration`` (6,), deviations of the velocities in m/s and rad/s after a second of white
        acceleration: keywords of `seatrial.NavigationFilter`. The vehicle that `seatrial.identify` gives has
        them in its file, so that a filter on it takes them by itself.

    Raises
    ------
    TrialError
        No trial has three seconds of fitted samples without a gap.
    """
    return residual_noise(fit.vehicle, fitted_records(fit.problem))


_HALF_STEP = 2.0**-54  # NumPy's uniforms are multiples of 2^-53, 0 among them, whose quantile may be infinite


def generator(seed: int, number: int, *, cause: int, attempt: int = 0) -> np.random.Generator:
    """Generator of one draw of one cause.

    `seed`, `number`: from 0 on. `cause`: different causes are independent. `attempt`: for draws that are
    repeated until they are possible.

    Examples
    --------
    >>> bool(generator(1, 7, cause=0).random() == generator(1, 7, cause=0).random())
    True
    """
    return np.random.Generator(np.random.Philox(key=[seed, cause], counter=[0, attempt, number, 0]))


def uniforms(seed: int, numbers: Sequence[int], *, cause: int, width: int) -> Array:
    """Numbers (k, width) strictly between 0 and 1, a row per draw.

    `numbers`: of the draws. `width`: the first columns do not depend on it.

    Examples
    --------
    >>> many = uniforms(1, range(10), cause=3, width=4)
    >>> bool((many[7] == uniforms(1, [7], cause=3, width=4)[0]).all())
    True
    """
    rows = [generator(seed, number, cause=cause).random(width) for number in numbers]
    return np.maximum(np.array(rows).reshape(len(rows), width), _HALF_STEP)


def checked_numbers(numbers: int | ArrayLike) -> list[int]:
    """Numbers of draws: 0 to k - 1 for k, or those given.

    Raises SimulationError where they are not whole numbers from 0 on.

    Examples
    --------
    >>> checked_numbers(3), checked_numbers([41])
    ([0, 1, 2], [41])
    """
    if isinstance(numbers, int | np.integer) and not isinstance(numbers, bool) and numbers >= 0:
        return list(range(int(numbers)))
    try:
        given = np.asarray(numbers)
    except ValueError:
        given = np.empty(())
    if given.ndim != 1 or (given.size and (given.dtype.kind not in "iu" or given.min() < 0)):
        raise SimulationError(
            f"draws: expected how many, or their numbers, whole and from 0 on, found {numbers!r}"
        )
    return [int(number) for number in given]


def widened(
    vehicle: Vehicle, percent: Mapping[str, float], *, names: Sequence[str], covariance: Array
) -> tuple[tuple[str, ...], Array]:
    """Names (m,) and covariance (m, m), SI, with further relative standard deviations.

    ``vehicle``: of whose values the percentages are. ``percent``: by name, by pattern (``"*_uu"``: each for
    itself) or by group (``"stern.gain"``: all together). ``names``, ``covariance``: what they are added to.
    Raises CampaignError: a name is unknown or its value zero, or a percentage is impossible.

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
    matches = [[name] for name in own if fnmatchcase(name, pattern) and own[name] != 0.0]
    if not matches:
        zero = [name for name in own if fnmatchcase(name, pattern)]
        raise CampaignError(
            f"standard deviations: {zero[0]} of {vehicle.name} is zero, and so is any percentage of it;"
            " leave it out"
            if zero
            else f"standard deviations: {vehicle.name} has no coefficient {pattern!r}{nearest(pattern, own)}"
        )
    return matches
