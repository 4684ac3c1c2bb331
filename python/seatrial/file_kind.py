"""What a TOML file is, by the keys that only its kind has: so that a wrong one is answered by its kind.

A mission where a vehicle is expected has an unknown key, and a list of the keys of a vehicle helps nobody.

Held by ``tests/test_bad_input_flights.py``.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from seatrial.errors import SimulationError, VehicleError, reason

__all__ = ["AUTOPILOT", "CAMPAIGN", "EMPTY", "MISSION", "VEHICLE", "file_kind", "loaded", "text_of"]

CAMPAIGN, MISSION, AUTOPILOT, VEHICLE = "a campaign", "a mission", "an autopilot", "a vehicle"
EMPTY = "an empty file"

_KEYS = {
    "a bench file": ("pulls", "steps"),
    "the recipe of a generated trial": ("truth",),
    "the truth of generated trials": ("factors",),
    CAMPAIGN: ("stages", "trials"),
    MISSION: ("legs",),
    AUTOPILOT: ("schedule", "modes", "loops"),
    "a set of sensors": ("sensors",),
    VEHICLE: ("geometry", "coefficients", "thrusters", "motors", "characteristics", "fins"),
}


def file_kind(path: str | Path) -> str | None:
    """What the file is; None where it cannot be read or has no key that tells.

    Examples
    --------
    >>> file_kind("cwolf") is None
    True
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
        data = tomllib.loads(text)
    except (OSError, ValueError):
        return None
    if not text.strip():
        return EMPTY
    for kind, keys in _KEYS.items():
        if any(key in data for key in keys):
            return kind
    return None


def loaded(kind: Any, source: Any, name: str | None = None) -> Any:
    """A Vehicle, Autopilot or Mission: itself, or that of a name or path.

    Parameters
    ----------
    kind : type
        Which of them is expected.
    source : Vehicle, Autopilot, Mission, str or Path
    name : str, optional
        Of the argument in messages; the kind's own when omitted.

    Raises
    ------
    VehicleError
        The file cannot be read, is of another kind or not usable.
    SimulationError
        The source is something else.
    """
    if isinstance(source, kind):
        return source
    what = kind.__name__.lower()
    if not isinstance(source, str | Path):
        found = type(source)
        raise SimulationError(
            f"{name or what}: expected an st.{kind.__name__}, a name or a path, found"
            f" {found.__name__ if found.__module__ == 'builtins' else f'{found.__module__}.{found.__name__}'}"
        )
    if not str(source).strip():
        raise VehicleError(f"{name or what}: expected a name or a path, found an empty text")
    try:
        return kind.load(source)
    except VehicleError as error:
        expected = AUTOPILOT if what == "autopilot" else f"a {what}"
        other = file_kind(source)
        if other is None or other == expected:
            raise error from None
        raise VehicleError(
            f"{source}: expected {expected} file, found {other}; check which file goes where"
        ) from None


def text_of(path: Any, what: str) -> str:
    """Text of a file in UTF-8, with or without a byte order mark.

    Raises
    ------
    VehicleError
        It cannot be read.
    """
    if not isinstance(path, str | Path):
        raise VehicleError(f"expected the path of {what} file, found {type(path).__name__}")
    if "\n" in str(path):
        raise VehicleError(f"expected the path of {what} file, found its text; use from_toml for text")
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or a zero byte in the path
        raise VehicleError(
            f"{path}: expected {what} file, but it cannot be read ({reason(error)}); check the path"
        ) from None
