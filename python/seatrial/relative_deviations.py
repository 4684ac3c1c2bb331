"""Standard deviations in percent of coefficients, by name, pattern or group, on top of a covariance.

Tests: ``tests/test_fitted.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import CampaignError, nearest
from seatrial.parameters import actuator_groups

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["widened"]

Array = NDArray[np.float64]


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
