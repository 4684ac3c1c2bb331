"""Units by name (pint): the factor from a recording's unit to the one used inside."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from seatrial.base.errors import TrialError

ACTUATOR_UNITS = ("rpm", "us", "N", "rad")
"""What a command may be: revolutions, pulse width, force or angle, told apart by dimension."""


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("newton_meter = newton * meter = Nm")
    registry.define("rev = 2 * pi * radian")
    return registry


@lru_cache(maxsize=256)
def factor(unit: str, wanted: tuple[str, ...], where: str) -> float:
    """Factor that turns a number in `unit` into one in that of the `wanted` units which has its dimension.

    Raises
    ------
    TrialError
        If the unit is unknown or has another dimension; the message begins with `where`.

    Examples
    --------
    >>> factor("km/h", ("m/s",), "u_m_s")
    0.2777777777777778
    """
    registry = _registry()
    example = f'for example "{wanted[0]}"'
    try:
        quantity = registry.Quantity(1.0, unit)
    except Exception:  # pint raises errors of its parser as well as its own
        raise TrialError(f'{where}: unknown unit "{unit}"; write it as a formula, {example}') from None
    for target in wanted:
        if quantity.check(registry.Quantity(1.0, target).dimensionality):
            return float(quantity.to(target).magnitude)
    expected = " or ".join(f'"{target}"' for target in wanted)
    raise TrialError(
        f'{where}: unit "{unit}" has the dimension {quantity.dimensionality}; '
        f"expected one that converts to {expected}"
    )


@lru_cache(maxsize=256)
def known(unit: str) -> bool:
    """Whether a text is a unit.

    Examples
    --------
    >>> known("mm/s"), known("filtered"), known("")
    (True, False, False)
    """
    if not unit:
        return False
    try:
        _registry().Quantity(1.0, unit)
    except Exception:  # pint raises errors of its parser as well as its own
        return False
    return True
