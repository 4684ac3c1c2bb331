"""Failure rate along a cause: in fifths of its values, in eight sectors of a direction, or by category.

Held by ``tests/verification/test_causes.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

_SECTORS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


@dataclass(frozen=True)
class Groups:
    """Groups of missions along a cause: their names, their missions, and how many of these failed.

    ``edges`` are the ends of the fifths of a number, one more than groups, else empty.
    """

    labels: tuple[str, ...]
    runs: tuple[int, ...]
    failures: tuple[int, ...]
    edges: tuple[float, ...] = ()

    @property
    def rates(self) -> tuple[float, ...]:
        """Share of failures of each group, not a number of an empty one."""
        return tuple(k / n if n else math.nan for k, n in zip(self.failures, self.runs, strict=True))


def grouped(values: NDArray[Any], failed: NDArray[np.bool_], *, kind: str) -> Groups:
    """Groups of k missions by finite numbers, directions in rad within 0 to 2 pi, or words.

    Examples
    --------
    >>> found = grouped(np.arange(10.0), np.arange(10) > 7, kind="number")
    >>> found.labels, found.rates
    (('0 to 1.8', '1.8 to 3.6', '3.6 to 5.4', '5.4 to 7.2', '7.2 to 9'), (0.0, 0.0, 0.0, 0.0, 1.0))
    """
    edges: NDArray[Any] = np.empty(0)
    if kind == "category":
        names, place = np.unique(values, return_inverse=True)
        labels = [str(name) for name in names]
    elif kind == "direction":
        labels = list(_SECTORS)
        place = np.rint(values / (0.25 * np.pi)).astype(int) % len(_SECTORS)
    else:
        # Fifths: fewer hide a hump, more are too small to count failures in. Values that are often met may
        # fill several of them: fewer groups are left.
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, 6)))
        if len(edges) == 2:
            return _apart(values, failed, least=float(edges[0]), most=float(edges[1]))
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        # A thousandth of the range is enough: no 9.5e-05 beside 0.1.
        digits = max(0, 2 - math.floor(math.log10(edges[-1] - edges[0])))
        shown = [f"{round(float(edge), digits) + 0.0:.4g}" for edge in edges]
        labels = [f"{low} to {high}" for low, high in pairwise(shown)]
    runs = np.bincount(place, minlength=len(labels))
    lost = np.bincount(place[failed], minlength=len(labels))
    return Groups(tuple(labels), tuple(map(int, runs)), tuple(map(int, lost)), tuple(map(float, edges)))


def _apart(values: NDArray[Any], failed: NDArray[np.bool_], *, least: float, most: float) -> Groups:
    """Two groups of numbers that nearly all are the smallest or the largest one: these, and the others."""
    usual = least if np.sum(values == least) >= np.sum(values == most) else most
    same = values == usual
    labels = (f"{usual:.3g}", f"above {usual:.3g}" if usual == least else f"below {usual:.3g}")
    parts = (same, ~same)
    return Groups(
        labels, tuple(int(part.sum()) for part in parts), tuple(int(failed[part].sum()) for part in parts)
    )
