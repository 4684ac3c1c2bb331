"""What to say about course and pitch stability: a warning where a value is doubtful, a note where usual.

A slender hull without enough lift behind is driven round by the Munk moment (Fossen 2011, chapter 12), which
is a warning. A vehicle that is hardly longer than wide has no stable course either, and thrusters hold it.
Held by tests/test_check_fins.py.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np

from seatrial.check.stability import growth

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["stability_sentences"]

_GROWS = 1e-3  # 1/s; what grows more slowly than in ten minutes is as good as stable
_SLENDER = 3.0  # length over the larger of diameter and height
_LIFT = {"course": "N_uv, N_ur, Y_uv, Y_ur", "pitch": "M_uw, M_uq, Z_uw, Z_uq"}
_MOMENT = {"course": ("N", 5), "pitch": ("M", 4)}


def stability_sentences(
    vehicle: Vehicle, running: Sequence[float], able: Collection[str]
) -> tuple[list[str], list[str]]:
    """Notes and warnings on course and pitch stability at half and top speed, ahead and astern.

    Parameters
    ----------
    vehicle : Vehicle
    running : sequence of float
        Steady speeds ahead, rising, m/s.
    able : collection of str
        Rows of the wrench that the actuators command independently.
    """
    middle, top = running[len(running) // 2], running[-1]
    notes, warnings = [], []
    for plane in _LIFT:
        worst, rate = max(((s, growth(vehicle, s, plane)) for s in (middle, top)), key=lambda pair: pair[1])
        held = ", fins at neutral" if _fins(vehicle, plane) else ""
        if rate <= _GROWS:
            time = np.log(2.0) / max(-rate, 1e-9)
            notes.append(
                f"{plane.capitalize()} stable ahead{held}: a disturbance halves in {_time(time)} or less"
            )
        else:
            doubles = f"unstable at {worst:.2f} m/s{held}: without control a disturbance doubles in"
            doubles += f" {_time(np.log(2.0) / rate)}"
            if _MOMENT[plane][0] in able and not _slender(vehicle) and not held:
                notes.append(
                    f"{plane.capitalize()} {doubles}; usual for a hull that is not slender, and its actuators"
                    " can hold it"
                )
            else:
                warnings.append(f"{plane} {doubles}. {_cure(vehicle, plane)}")
        astern = growth(vehicle, -0.5 * middle, plane)
        if astern > _GROWS:
            notes.append(
                f"{plane.capitalize()} unstable astern: at {0.5 * middle:.2f} m/s a disturbance doubles in"
                f" {_time(np.log(2.0) / astern)}"
            )
    return notes, warnings


def _cure(vehicle: Vehicle, plane: str) -> str:
    lift = _LIFT[plane]
    fins = _fins(vehicle, plane)
    if not fins:
        return (
            f"Lift of hull and fixed fins ({lift}) balances the Munk moment of a slender hull; give it where"
            " the vehicle has fins"
        )
    return (
        f"Too little lift behind against the Munk moment; if it is not so at sea, look at {lift} of the hull"
        f" and at area and C_L_alpha of {' and '.join(fins)}"
    )


def _fins(vehicle: Vehicle, plane: str) -> list[str]:
    """Movable fins that steer in the plane, by group where they have one."""
    matrix, row = np.asarray(vehicle.allocation_matrix()), _MOMENT[plane][1]
    facts = vehicle.actuator_info()
    names = [
        str(facts[name]["group"] or name)
        for k, name in enumerate(vehicle.actuators)
        if facts[name]["kind"] == "fin" and abs(matrix[row, k]) > 0.1 * np.abs(matrix[3:, k]).max()
    ]
    return list(dict.fromkeys(names))


def _slender(vehicle: Vehicle) -> bool:
    """Whether the hull is slender; one without measures is taken for slender."""
    box = vehicle.geometry()
    return not box or box["length"] > _SLENDER * max(box["diameter"], box["height"])


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds < 99.5 else f"{seconds / 60.0:.0f} min"
