"""A fitted characteristic as an entry of the vehicle file.

The entry keeps what a bollard test does not measure: inflow term, wake, torque, power, thrust deduction. The
test measures the pull of the vehicle, ``(1 - t) F`` at the density of the basin; the file holds F at the
vehicle's density, so that coefficients are multiplied by ``rho / rho_test / (1 - t)``. A direction that was
not tested keeps its old regression.

Tests: ``tests/test_bench_vehicle.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.bench_test.unit_fit import SIDES, DirectionFit, UnitFit
from seatrial.errors import VehicleError

if TYPE_CHECKING:
    from seatrial._core import Vehicle

__all__ = ["KEPT", "entry_of"]

KEPT = ("p2", "alpha2", "diameter_m", "wake", "thrust_deduction", "q1", "q2", "power_w_s3")
"""Keys that no bollard test measures."""

PER_MINUTE = 3600.0
"""rpm² per (rev/s)²: revolutions are in rpm in the file's regression, in rev/s in p1."""

_TERMS = {"a0": 0, "a1": 1, "a11": 2}


def entry_of(
    fit: UnitFit, old: Mapping[str, Any], actuator: str, vehicle: Vehicle, rho: float | None
) -> tuple[dict[str, Any], dict[str, str]]:
    """Keys of the new entry, and remarks by key (standard deviations, what was kept).

    Parameters
    ----------
    fit : UnitFit
    old : mapping
        The entry that is replaced.
    actuator : str
        One that uses it.
    vehicle : Vehicle
        The vehicle as it was.
    rho : float, optional
        Density in kg/m³ of the water of the test, the vehicle's where omitted.

    Raises
    ------
    VehicleError
        A direction was not tested and the old entry has no regression to keep for it.
    """
    coefficients = vehicle.coefficients()
    factor = 1.0 if rho is None else vehicle.environment()["rho"] / rho
    factor /= 1.0 - coefficients.get(f"{actuator}.t", 0.0)
    if fit.kind == "table":
        return _table(fit, factor)
    kept = {key: old[key] for key in KEPT if key in old}
    if fit.kind == "quadratic":
        return _quadratic(fit, old, kept, vehicle, factor)
    return _polynomial(fit, old, kept, actuator, coefficients, factor)


def _quadratic(
    fit: UnitFit, old: Mapping[str, Any], kept: dict[str, Any], vehicle: Vehicle, factor: float
) -> tuple[dict[str, Any], dict[str, str]]:
    """``p1 |n| n``, or the alpha form where the old entry has it."""
    alpha = "alpha1_ahead" in old or "alpha2" in old
    divisor = vehicle.environment()["rho"] * float(old["diameter_m"]) ** 4 if alpha else 1.0
    name = "alpha1" if alpha else "p1"
    entry: dict[str, Any] = {"kind": "quadratic"}
    remarks = {}
    if "ahead" not in fit.directions and f"{name}_ahead" not in old:
        raise VehicleError(
            "ahead was not tested and the old characteristic has no p1 to keep; pull ahead too"
        )
    for side in SIDES:
        found, key = fit.directions.get(side), f"{name}_{side}"
        if found is None:
            # Without its own number astern would follow the new one ahead.
            entry[key] = old.get(key, old.get(f"{name}_ahead"))
            remarks[key] = "not tested, kept"
            continue
        scale = PER_MINUTE * factor / divisor
        entry[key] = rounded(float(found.fit.coefficients[0]) * scale)
        remarks[key] = f"+- {float(found.fit.standard_deviations[0]) * scale:.2g}"
    if entry["alpha1_astern" if alpha else "p1_astern"] is None:
        raise VehicleError(
            "astern was not tested and the old characteristic has no p1 to keep; pull astern too"
        )
    return entry | kept, remarks


def _polynomial(
    fit: UnitFit,
    old: Mapping[str, Any],
    kept: dict[str, Any],
    actuator: str,
    coefficients: Mapping[str, float],
    factor: float,
) -> tuple[dict[str, Any], dict[str, str]]:
    """``F = a0 + a1 s + a11 s^2`` per direction."""
    entry: dict[str, Any] = {"kind": "polynomial"}
    remarks = {}
    for side in SIDES:
        found = fit.directions.get(side)
        if found is not None:
            entry[side] = [rounded(factor * x) for x in _padded(found, found.fit.coefficients)]
            deviations = _padded(found, found.fit.standard_deviations)
            remarks[side] = "+- " + ", ".join(f"{factor * x:.2g}" for x in deviations)
        elif old.get("kind") == "polynomial":
            entry[side], remarks[side] = list(old[side]), "not tested, kept"
        elif old.get("kind") == "quadratic":
            p1 = coefficients[f"{actuator}.p1_{side}"]
            entry[side], remarks[side] = [0.0, 0.0, rounded(p1 / PER_MINUTE)], "not tested, kept"
        else:
            raise VehicleError(
                f'{side} was not tested and the old characteristic (kind = "{old.get("kind")}") has no'
                f" regression to keep; pull {side} too"
            )
    if "alpha2" not in kept:
        kept.pop("diameter_m", None)  # it is for alpha2
    return entry | kept, remarks


def _table(fit: UnitFit, factor: float) -> tuple[dict[str, Any], dict[str, str]]:
    table = fit.table
    assert table is not None
    missing = [side for side in SIDES if side not in fit.sides]
    if missing:
        raise VehicleError(
            f"{missing[0]} was not tested, and a table holds both directions; pull {missing[0]} too"
        )
    entry: dict[str, Any] = {"kind": "table", "signal": [rounded(x) for x in table.signal]}
    if len(table.voltage) > 1:
        entry["voltage_v"] = [rounded(x) for x in table.voltage]
    entry["force_n"] = [[round(float(x) * factor, 3) + 0.0 for x in row] for row in table.force]
    rms = float(np.sqrt(np.mean(table.residual**2)))
    return entry, {"kind": f"the points lie {rms:.2g} N (rms) from it"}


def _padded(found: DirectionFit, values: np.typing.NDArray[np.float64]) -> list[float]:
    """Three numbers a0, a1, a11; zero for a term that the fit has not."""
    row = [0.0, 0.0, 0.0]
    for name, value in zip(found.fit.names, values, strict=True):
        row[_TERMS[name]] = float(value)
    return row


def rounded(value: float) -> float:
    """Six digits: far finer than any standard deviation, short enough to read."""
    return float(f"{float(value):.6g}")
