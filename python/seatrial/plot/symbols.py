"""Coefficient names as they are set in print: ``X_udot`` becomes X with the index of a dotted u."""

from __future__ import annotations

import re

__all__ = ["number", "printed_unit", "symbol"]

_NAME = re.compile(r"([A-Za-z])_([a-z0-9]+?)(dot)?")


def symbol(name: str) -> str:
    r"""Mathtext of a coefficient's name; the name of an actuator's or group's coefficient stays as it is.

    Examples
    --------
    >>> symbol("X_udot"), symbol("N_rr"), symbol("m"), symbol("stern.gain")
    ('$X_{\\dot{u}}$', '$N_{rr}$', '$m$', 'stern.gain')
    """
    if len(name) == 1:
        return f"${name}$"
    match = _NAME.fullmatch(name)
    if match is None:
        return name
    letter, index, dotted = match.groups()
    return f"${letter}_{{\\dot{{{index}}}}}$" if dotted else f"${letter}_{{{index}}}$"


def printed_unit(unit: str) -> str:
    """A unit with raised exponents.

    Examples
    --------
    >>> printed_unit("N s2/m2")
    'N s²/m²'
    """
    return re.sub(r"(?<=[a-z])[23]", lambda found: "²³"["23".index(found[0])], unit)


def number(value: float, digits: int = 3) -> str:
    """A number for a figure: significant digits, a true minus sign, no exponent where that can be read.

    Examples
    --------
    >>> number(-0.02), number(2000.0), number(1.5e-7)
    ('−0.02', '2000', '1.5e−07')
    """
    value += 0.0  # no minus before a zero
    exponent = "e" in f"{value:.{digits}g}" and 1e-4 <= abs(value) < 1e7
    text = f"{value:.0f}" if exponent else f"{value:.{digits}g}"
    return text.replace("-", "\N{MINUS SIGN}")
