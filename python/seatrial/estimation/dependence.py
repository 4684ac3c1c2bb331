"""Combinations of signals that are hardly driven: the null space of their matrix, in readable form.

Source: Golub & Van Loan, *Matrix Computations* (2013), section 2.4 (singular values), 5.5 (rank deficiency).
Tests: ``tests/estimation/test_inputs.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seatrial.base.arrays import Array

WEAK = 0.05
"""Relative singular value below which a combination counts as not driven.

Thrust tables and bollard curves are good to about five per cent: what is weaker is no input, it is the
error of the others.
"""

_SMALL = 0.1  # a part this small beside the largest is noise of the null space


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
        text = ""
        for i, (name, factor) in enumerate(self.parts):
            size = "" if abs(abs(factor) - 1.0) < 0.05 else f"{abs(factor):.2g} "
            sign = "-" if factor < 0.0 else "" if i == 0 else "+"
            text += f"{sign}{size}{name}" if i == 0 else f" {sign} {size}{name}"
        return text


@dataclass(frozen=True)
class Dependence:
    """How independent signals are.

    Attributes
    ----------
    names
        All signals, in their order.
    singular_values
        Of the signals that move, each over its own root mean square; relative to the largest.
    still
        Signals that do not move.
    combinations
        A basis of what is hardly driven, as few signals in each as possible.
    """

    names: tuple[str, ...]
    singular_values: tuple[float, ...]
    still: tuple[str, ...]
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

    def sentences(self) -> list[str]:
        """A sentence for those that move only together, one per combination of three and more."""
        pairs = [combination for combination in self.combinations if len(combination.parts) == 2]
        texts = [
            f"{', '.join(name for name, _ in family)} move only together:"
            f" {' '.join(_proportion(factor) for _, factor in family)}"
            for family in _families(pairs, self.names)
        ]
        return texts + [
            f"Hardly driven: {combination.words} ({_share(combination.strength)} of what they would give"
            " independently)"
            for combination in self.combinations
            if len(combination.parts) != 2
        ]


def dependence(signals: Array, names: Sequence[str], *, weak: float = 1e-3) -> Dependence:
    """Dependence of signals.

    Parameters
    ----------
    signals : array (n, k)
        About their means, so weighted that the squares of a column sum to a mean square.
    names : sequence of str
        What the k signals are called.
    weak : float
        A signal below this share of the largest does not move.

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
    rows = _sparse(modes[relative < WEAK] / size)
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
        first = int(np.flatnonzero(np.abs(row) > _SMALL * np.abs(row).max())[0])
        row /= np.abs(row).max() * np.sign(row[first])
        row[np.abs(row) < _SMALL] = 0.0
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


def _proportion(factor: float) -> str:
    return f"{round(factor):+d}" if abs(abs(factor) - 1.0) < 0.05 else f"{factor:+.2g}"


def _share(strength: float) -> str:
    return f"{100.0 * strength:.1g} %" if strength >= 5e-4 else "less than 0.05 %"
