"""Distributions that people write: a number, an interval, or one named in a table, and their quantiles.

========================  ===============================================================
in the file             meaning
========================  ===============================================================
``0.3``                   always this
``[0.1, 0.4]``            uniform between them
``{ uniform = [a, b] }``  the same
``{ normal = [m, s] }``   normal, mean and standard deviation; a speed or a time is cut at zero
``{ rayleigh = s }``      speed of two normal components of s each (mean 1.25 s)
``{ weibull = [s, k] }``  scale and shape, the usual fit to measured current speeds
========================  ===============================================================

Values are quantiles of given uniform numbers, so that a draw is a function of its number alone
(`seatrial.numbered_draws`).

Tests: ``tests/test_draws.py``, ``tests/test_verification_file.py``.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, model_validator

from seatrial.toml_file import Interval, Number, Positive, Section

__all__ = ["Direction", "Distribution", "DistributionTable", "PositiveDistribution", "Turn"]

Array = NDArray[np.float64]


class DistributionTable(Section):
    """One distribution by its name."""

    fixed: Number | None = None
    uniform: Interval | None = None
    normal: tuple[Number, Positive] | None = None
    rayleigh: Positive | None = None
    weibull: tuple[Positive, Positive] | None = None

    @model_validator(mode="after")
    def _one(self) -> DistributionTable:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                "expected a number, [from, to], or one of uniform, normal, rayleigh, weibull; found "
                + (" and ".join(given) or "none")
            )
        if self.uniform is not None and self.uniform[0] > self.uniform[1]:
            raise ValueError(
                f"uniform holds [from, to] with from <= to, found [{self.uniform[0]:g}, {self.uniform[1]:g}]"
            )
        return self

    @property
    def is_fixed(self) -> bool:
        """Whether every draw is the same."""
        return self.fixed is not None or (self.uniform is not None and self.uniform[0] == self.uniform[1])

    @property
    def least(self) -> float:
        """Lower end of what it can hold; minus infinity for a normal one."""
        if self.uniform is not None:
            return self.uniform[0]
        if self.normal is not None:
            return -math.inf
        return 0.0 if self.fixed is None else self.fixed

    def quantiles(self, u: Array, *, above_zero: bool = False) -> Array:
        """Values at probabilities u, each strictly between 0 and 1; of the shape of u.

        Parameters
        ----------
        u : array
        above_zero : bool
            Whether a normal distribution is cut at zero.

        Examples
        --------
        >>> import numpy as np
        >>> DistributionTable(uniform=(1.0, 3.0)).quantiles(np.array([0.25, 0.5]))
        array([1.5, 2. ])
        """
        from scipy.special import ndtr, ndtri

        if self.uniform is not None:
            return np.asarray(self.uniform[0] + (self.uniform[1] - self.uniform[0]) * u)
        if self.normal is not None:
            mean, sd = self.normal
            below = float(ndtr(-mean / sd)) if above_zero else 0.0
            found = mean + sd * ndtri(below + (1.0 - below) * u)
            return np.asarray(np.maximum(found, 0.0) if above_zero else found)
        if self.rayleigh is not None:
            return np.asarray(self.rayleigh * np.sqrt(-2.0 * np.log1p(-u)))
        if self.weibull is not None:
            scale, shape = self.weibull
            return np.asarray(scale * (-np.log1p(-u)) ** (1.0 / shape))
        assert self.fixed is not None
        return np.full(np.shape(u), self.fixed)


def _short(entry: Any) -> Any:
    if isinstance(entry, bool | str):
        raise ValueError(
            "expected a number, [from, to], or one of uniform, normal, rayleigh, weibull; found"
            f" {str(entry).lower() if isinstance(entry, bool) else repr(entry)}"
        )
    if isinstance(entry, int | float):
        return {"fixed": entry}
    return {"uniform": entry} if isinstance(entry, list | tuple) else entry


def _not_below_zero(table: DistributionTable) -> DistributionTable:
    if table.normal is not None and table.normal[0] < 0.0:
        raise ValueError(f"expected a mean from 0 on, found {table.normal[0]:g}")
    if table.normal is None and table.least < 0.0:
        raise ValueError(f"expected values from 0 on, found {table.least:g}")
    return table


def _direction(entry: Any) -> Any:
    if isinstance(entry, str):
        if entry != "any":
            raise ValueError(f'expected degrees, [from, to] or "any", found {entry!r}')
        return {"uniform": (0.0, 360.0)}
    return _short(entry)


def _turn(entry: Any) -> Any:
    """A number is the standard deviation of a turn away from where it should point."""
    if isinstance(entry, str):
        if entry != "any":
            raise ValueError(f'expected a standard deviation in degrees or "any", found {entry!r}')
        return {"uniform": (-180.0, 180.0)}
    if isinstance(entry, int | float) and not isinstance(entry, bool):
        if entry < 0:
            raise ValueError(f"expected a standard deviation from 0 on, found {entry:g}")
        return {"normal": (0.0, entry)} if entry else {"fixed": 0.0}
    return _short(entry)


def _an_angle(table: DistributionTable) -> DistributionTable:
    if table.rayleigh is not None or table.weibull is not None:
        raise ValueError("an angle is a number, uniform or normal, in degrees")
    return table


Distribution = Annotated[DistributionTable, BeforeValidator(_short)]
PositiveDistribution = Annotated[DistributionTable, BeforeValidator(_short), AfterValidator(_not_below_zero)]
Direction = Annotated[DistributionTable, BeforeValidator(_direction), AfterValidator(_an_angle)]
Turn = Annotated[DistributionTable, BeforeValidator(_turn), AfterValidator(_an_angle)]
