"""Frames by name: vectors and attitudes of a recording into NED (earth) and FRD (body).

Body frames: FRD (x forward, y starboard, z down), FLU (y port, z up). Earth frames: NED, NWU (z up, y west),
ENU (x east, y north, z up). An attitude turns the body frame into the earth frame and names both: "FLU/ENU".
With ``v_NED = E v`` and ``v_FRD = B v`` for the recording's frames, its rotation R becomes ``E R B'``.
ROS uses FLU and ENU (REP 103). Held by the ``test_law_`` functions of tests/test_frames.py.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import TrialError
from seatrial.rotation import product

__all__ = ["attitude_to_ned", "body_matrix", "earth_matrix"]

Array = NDArray[np.float64]

_Z_UP = np.diag([1.0, -1.0, -1.0])
_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_BODY = {"FRD": np.eye(3), "FLU": _Z_UP}
_EARTH = {"NED": np.eye(3), "NWU": _Z_UP, "ENU": _ENU}
_HALF_TURN = {  # the same matrices as quaternions: half turns about x and about the diagonal of x and y
    "FRD": np.array([1.0, 0.0, 0.0, 0.0]),
    "NED": np.array([1.0, 0.0, 0.0, 0.0]),
    "FLU": np.array([0.0, 1.0, 0.0, 0.0]),
    "NWU": np.array([0.0, 1.0, 0.0, 0.0]),
    "ENU": np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0]),
}
_PARTNER = {"FRD": "NED", "NED": "FRD", "FLU": "NWU", "NWU": "FLU", "ENU": "FLU"}
_Z_NAMES = {"ZUP": "FLU", "ZDOWN": "FRD"}


def _names(frame: str) -> list[str]:
    """Frame names in the text; "FLU -> FRD" says the same as "FLU", since FRD and NED are always the goal."""
    source = re.split(r"->|→", frame)[0].strip().upper()
    plain = re.sub(r"[\s_-]", "", source)
    return [_Z_NAMES[plain]] if plain in _Z_NAMES else re.split(r"\s*/\s*", source)


def body_matrix(frame: str, where: str) -> Array:
    """Matrix (3, 3) from the body frame of that name to FRD.

    Raises
    ------
    TrialError
        If it is no body frame; the message begins with `where`.
    """
    names = _names(frame)
    if len(names) == 1 and names[0] in _BODY:
        return _BODY[names[0]]
    raise TrialError(f'{where}: frame "{frame}" is no body frame; expected "FRD" (as inside) or "FLU"')


def earth_matrix(frame: str, where: str) -> Array:
    """Matrix (3, 3) from the earth frame of that name to NED; "FLU" is taken as its earth frame, NWU.

    Raises
    ------
    TrialError
        If it is no earth frame; the message begins with `where`.
    """
    names = _names(frame)
    if len(names) == 1:
        name = _PARTNER[names[0]] if names[0] in _BODY else names[0]
        if name in _EARTH:
            return _EARTH[name]
    raise TrialError(
        f'{where}: frame "{frame}" is no earth frame; expected "NED" (as inside), "NWU" or "ENU"'
    )


def attitude_to_ned(q: Array, frame: str, where: str) -> Array:
    """Quaternions (n, 4) FRD -> NED from those between the two frames that `frame` names.

    One name implies its usual partner: "FLU" and "NWU" are "FLU/NWU", "ENU" is "FLU/ENU".

    Raises
    ------
    TrialError
        If the name is unknown; the message begins with `where`.
    """
    names = _names(frame)
    if len(names) == 1 and names[0] in _PARTNER:
        names = [names[0], _PARTNER[names[0]]]
    body, earth = sorted(names, key=lambda name: name in _EARTH)[:2] if len(names) == 2 else ("", "")
    if body not in _BODY or earth not in _EARTH:
        raise TrialError(
            f'{where}: frame "{frame}" is no attitude; expected body/earth: '
            '"FRD/NED" (as inside), "FLU/NWU" or "FLU/ENU"'
        )
    back = _HALF_TURN[body] * np.array([1.0, -1.0, -1.0, -1.0])
    return product(product(_HALF_TURN[earth], q), back)
