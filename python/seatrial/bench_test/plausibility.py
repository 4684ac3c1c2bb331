"""What a fitted characteristic must not do between n_min and n_max: fall, push the wrong way, be guessed.

Checked on a fine grid from the motor's smallest to its largest signal; where the motor has no limit, from the
smallest to the largest tested one. Tests: ``tests/test_bench.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from seatrial.bench_test.thrust_table import dead_band
from seatrial.bench_test.unit_fit import SIDES

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.unit_fit import UnitFit
    from seatrial.motor_dynamics import MotorEstimate

__all__ = ["motor_warnings", "warnings_of"]

_POINTS = 400
_NOISE = 1e-3
_BEYOND = 1.05
_POOR = 0.9
_SAGGED = 1.05
_QUIET = 3
_SLOWEST_S = 10.0  # no propeller or servo of an underwater vehicle lags so long


def motor_warnings(unit: str, motor: MotorEstimate) -> list[str]:
    """Sentences about what looks wrong in a group's motor."""
    return [
        f"{unit} motor: {name} = {one.value:.3g} s is not that of a motor; is t_s in seconds?"
        for name, one in motor.parameters.items()
        if name in ("T_1", "T_t") and one.value is not None and one.value > _SLOWEST_S
    ]


def warnings_of(fit: UnitFit, vehicle: Vehicle) -> list[str]:
    """Sentences about what looks wrong in a group's characteristic."""
    facts = vehicle.actuator_info()[fit.unit.actuators[0]]
    unit = fit.unit.command
    found = []
    for side in fit.sides:
        sign = SIDES[side]
        tested = np.abs(fit.points.signal[sign * fit.points.signal > 0.0])
        low = float(facts[f"minimum_{side}"]) or float(tested.min())
        limit = float(facts[f"maximum_{side}"])
        high = limit if np.isfinite(limit) else float(tested.max())
        place = f"{fit.unit.name} {side}"
        if high > _BEYOND * tested.max():
            found.append(
                f"{place}: tested up to {tested.max():.4g} of {high:.4g} {unit}; beyond, the curve is a guess"
            )
        grid = np.linspace(low, high, _POINTS)
        for voltage in _voltages(fit):
            at = None if voltage is None else np.full(_POINTS, voltage)
            thrust = sign * fit.thrust(sign * grid, at)
            words = "" if voltage is None else f" at {voltage:.3g} V"
            below = np.flatnonzero(thrust < np.maximum.accumulate(thrust) - _NOISE * np.abs(thrust).max())
            if len(below):
                top = int(thrust[: below[0] + 1].argmax())
                bottom = top + int(thrust[top : below[-1] + 1].argmin())
                found.append(
                    f"{place}: the curve falls between {grid[top]:.4g} and {grid[bottom]:.4g}"
                    f" {unit}{words}, which no propeller does; more points there, or a lower order"
                )
            against = np.flatnonzero(thrust < -_NOISE * np.abs(thrust).max())
            if len(against):
                found.append(
                    f"{place}: the curve pushes the wrong way up to {grid[against[-1]]:.4g} {unit}{words};"
                    " try through_origin = true, or tare the cell"
                )
    silent = dead_band(fit.points.signal, fit.points.thrust)
    inside = (fit.points.signal >= silent[0]) & (fit.points.signal <= silent[1])
    if fit.directions and inside.sum() >= _QUIET:
        found.append(
            f"{fit.unit.name}: no thrust from {silent[0]:+.4g} to {silent[1]:+.4g} {unit}, a dead band that a"
            ' polynomial smears; take order = "points"'
        )
    volts = fit.points.voltage
    if fit.unit.command != "rpm" and not fit.regression.with_voltage and np.isfinite(volts).all():
        low, high = float(volts.min()), float(volts.max())
        if high > _SAGGED * low:
            found.append(
                f"{fit.unit.name}: the supply ran from {low:.3g} to {high:.3g} V and thrust follows it; take"
                ' inputs = ["signal", "voltage"]'
            )
    for side, one in fit.directions.items():
        if one.fit.r2 < _POOR:
            found.append(
                f"{fit.unit.name} {side}: R2 is only {one.fit.r2:.3f}; the order does not fit, or the load is"
                " noisy"
            )
    return found


def _voltages(fit: UnitFit) -> list[float | None]:
    if fit.table is not None and len(fit.table.voltage):
        return [float(v) for v in fit.table.voltage]
    return [None]
