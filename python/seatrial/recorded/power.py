"""What a log would have shown: the chance that a usual change of the vehicle is noticed on it.

A log on which nothing could have been seen does not speak for the model. Three changes that happen to
vehicles are tried to first order; their predictions move by ``J theta``, and the share outside the band
follows from the spread of a valid model's errors, and is held against the share that the verdict itself
would call no chance (`seatrial.recorded.validity`).

Tests: ``tests/test_recorded_validity.py``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from seatrial.parameters import actuator_groups
from seatrial.recorded.log_verdict import Detectable
from seatrial.recorded.validity import LEVEL, Validity, powers

__all__ = ["detectable_changes"]

Array = NDArray[np.float64]

_DRAG, _THRUST, _WEIGHT = 0.25, -0.15, 0.01


def detectable_changes(
    of: Validity, *, level: float = LEVEL, current: bool = False
) -> tuple[Detectable, ...]:
    """Chances that drag ahead +25 %, all thrust -15 % and 1 % more weight in water are noticed.

    Parameters
    ----------
    of : Validity
        Gives windows, band and spread.
    level : float, optional
        Chance of a false alarm.
    current : bool, optional
        Whether a steady current was fitted to the log: what it would take up is not shown.
    """
    vehicle = of.log.vehicle
    values = vehicle.coefficients()
    g = float(vehicle.environment()["g"])
    drag = {name: _DRAG * values[name] for name in ("X_u", "X_uu") if values.get(name)}
    gains = [f"{a}.gain" for group in actuator_groups(vehicle).values() for a in group]
    gains = [name for name in gains if name in values]
    weight = _WEIGHT * values["m"]
    tried = [
        (f"drag ahead {100 * _DRAG:+.0f} %", drag),
        (f"all thrust {100 * _THRUST:+.0f} %", {name: _THRUST * values[name] for name in gains}),
        (f"{weight:.2g} kg more weight in water", {"B": -g * weight}),
    ]
    if of.log.input == "tau":
        tried.pop(1)
    tried = [(words, change) for words, change in tried if change]
    slopes = of.log.slopes([change for _, change in tried], current=current)
    moved = [[np.asarray(one.by_direction[:, :, k]) for one in slopes] for k in range(len(tried))]
    if current:
        moved = [
            _beside_current(of, one, [slope.by_direction[:, :, -2:] for slope in slopes]) for one in moved
        ]
    chances = powers(of, moved, level=level)
    return tuple(Detectable(words, chance) for (words, _), chance in zip(tried, chances, strict=True))


def _beside_current(of: Validity, moved: list[Array], water: list[Array]) -> list[Array]:
    """What of a move (n, 12) per window no steady current, whose derivatives are (n, 12, 2), takes up."""
    scale = [1.0 / of.spread.at(of.log.since_restart(w)) for w in range(len(moved))]
    columns = np.concatenate([
        (one * s[:, :, None]).reshape(-1, 2) for one, s in zip(water, scale, strict=True)
    ])
    sought = np.concatenate([(one * s).ravel() for one, s in zip(moved, scale, strict=True)])
    taken = np.linalg.lstsq(columns, sought, rcond=1e-9)[0]
    return [one - part @ taken for one, part in zip(moved, water, strict=True)]
