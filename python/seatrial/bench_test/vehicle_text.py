"""The results of a bench test written into the vehicle file; comments of the original are kept (tomlkit).

The test measures the pull of the vehicle, ``(1 - t) F`` at the density of the basin; the file holds F at the
vehicle's density, so that coefficients are multiplied by ``rho / rho_test / (1 - t)``. What a bollard test
does not measure stays: inflow term, wake, torque, power, thrust deduction.

An entry that other actuators use as well is left alone: the tested ones get their own. Factors in
``[coefficients]`` that corrected the old characteristic (gain, astern_ratio, p1 ...) of the tested actuators
are removed, because the test replaces what they corrected; a direction that was not tested keeps its old
thrust, with these corrections taken into the entry. Held by ``tests/bench_test/test_bench_vehicle.py``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.errors import VehicleError
from seatrial.base.finding import Finding, Severity
from seatrial.bench_test.characteristic import SIDES, DirectionFit, UnitFit

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_KEPT = ("p2", "alpha2", "diameter_m", "wake", "thrust_deduction", "q1", "q2", "power_w_s3")
"""Keys that no bollard test measures."""

PER_MINUTE = 3600.0
"""rpm² per (rev/s)²: revolutions are in rpm in the file's regression, in rev/s in p1."""

_TERMS = {"a0": 0, "a1": 1, "a11": 2}

_SAME = 1e-9  # of a number: rounding

_UNREACHABLE = "the motor does not turn this way"

_UNTESTED = "not tested, kept"


def _entry_of(
    fit: UnitFit, old: Mapping[str, Any], users: Sequence[str], vehicle: Vehicle, rho: float | None
) -> tuple[dict[str, Any], dict[str, str]]:
    """Keys of the new entry in place of `old`, which the tested `users` share, and remarks by key (standard
    deviations, what was kept); `rho` is the density of the test's water, kg/m³. A VehicleError where an
    untested direction has nothing to keep.
    """
    factor = 1.0 if rho is None else vehicle.environment()["rho"] / rho
    factor /= 1.0 - vehicle.coefficients().get(f"{users[0]}.t", 0.0)
    if fit.kind == "table":
        return _table(fit, users, vehicle, factor)
    # Quadratic: ``p1 |n| n``, or the alpha form where the old entry has it; else ``a0 + a1 s + a11 s^2``.
    quadratic = fit.kind == "quadratic"
    alpha = quadratic and ("alpha1_ahead" in old or "alpha2" in old)
    divisor = vehicle.environment()["rho"] * float(old["diameter_m"]) ** 4 if alpha else 1.0
    prefix = "alpha1_" if alpha else "p1_" if quadratic else ""
    scale = PER_MINUTE * factor / divisor if quadratic else factor
    entry: dict[str, Any] = {"kind": fit.kind}
    remarks: dict[str, str] = {}
    for side in SIDES:
        key, regression = f"{prefix}{side}", fit.directions.get(side)
        if regression is not None:
            fitted = regression.fit
            rows = [
                values[:1] if quadratic else _padded(regression, values)
                for values in (fitted.coefficients, fitted.standard_deviations)
            ]
            row = [_rounded(float(x) * scale) for x in rows[0]]
            remarks[key] = "+- " + ", ".join(f"{float(x) * scale:.2g}" for x in rows[1])
        elif _unreachable(users, side, vehicle):
            row, remarks[key] = [0.0] * (1 if quadratic else 3), _UNREACHABLE
        else:
            row, remarks[key] = _untested(old, prefix, side, users, vehicle, divisor), _UNTESTED
        entry[key] = row[0] if quadratic else row
    kept = {key: old[key] for key in _KEPT if key in old}
    if not quadratic and "alpha2" not in kept:
        kept.pop("diameter_m", None)  # it is for alpha2
    return entry | kept, remarks


def _untested(
    old: Mapping[str, Any], prefix: str, side: str, users: Sequence[str], vehicle: Vehicle, divisor: float
) -> list[float]:
    """Numbers of a direction that was not tested, from the old entry with its corrections."""
    if prefix and f"{prefix}ahead" not in old:
        raise VehicleError(
            f"{side} was not tested and the old characteristic has no p1 to keep; pull {side} too"
        )
    if prefix:
        # Without its own number astern would follow the new one ahead.
        written = float(old.get(f"{prefix}{side}", old[f"{prefix}ahead"]))
        return [_unchanged(written, _old_thrust(users, "p1", side, vehicle) / divisor)]
    if old.get("kind") == "polynomial":
        return [
            _unchanged(float(written), _old_thrust(users, name, side, vehicle))
            for name, written in zip(_TERMS, old[side], strict=True)
        ]
    if old.get("kind") == "quadratic":
        return [0.0, 0.0, _rounded(_old_thrust(users, "p1", side, vehicle) / PER_MINUTE)]
    raise VehicleError(
        f'{side} was not tested and the old characteristic (kind = "{old.get("kind")}") has no'
        f" regression to keep; pull {side} too"
    )


def _old_thrust(users: Sequence[str], name: str, side: str, vehicle: Vehicle) -> float:
    """Coefficient of the thrust in one direction as the vehicle has it, with gain and astern_ratio; a
    `VehicleError` where the actuators that share the entry have different ones.
    """
    values = vehicle.coefficients()
    each = [
        values[f"{user}.{name}_{side}"]
        * values.get(f"{user}.gain", 1.0)
        * (values.get(f"{user}.astern_ratio", 1.0) if side == "astern" else 1.0)
        for user in users
    ]
    if max(each) - min(each) > _SAME * max(map(abs, each)):
        raise VehicleError(
            f"{side} was not tested and [coefficients] corrects it differently for {', '.join(users)}, which"
            f" share one characteristic; pull {side} too"
        )
    return each[0]


def _unreachable(users: Sequence[str], side: str, vehicle: Vehicle) -> bool:
    """Whether no motor of these actuators turns this way."""
    facts = vehicle.actuator_info()
    return all(facts[user][f"maximum_{side}"] == 0.0 for user in users)


def _unchanged(written: float, value: float) -> float:
    """A number as it was written, or another value where a correction changes it."""
    return written if abs(value - written) <= _SAME * abs(written) else _rounded(value)


def _table(
    fit: UnitFit, users: Sequence[str], vehicle: Vehicle, factor: float
) -> tuple[dict[str, Any], dict[str, str]]:
    table = fit.table
    assert table is not None
    missing = [side for side in SIDES if side not in fit.sides and not _unreachable(users, side, vehicle)]
    if missing:
        raise VehicleError(
            f"{missing[0]} was not tested, and a table holds both directions; pull {missing[0]} too"
        )
    entry: dict[str, Any] = {"kind": "table", "signal": [_rounded(x) for x in table.signal]}
    if len(table.voltage_v) > 1:
        entry["voltage_v"] = [_rounded(x) for x in table.voltage_v]
    entry["force_n"] = [[round(float(x) * factor, 3) + 0.0 for x in row] for row in table.force]
    rms = float(np.sqrt(np.mean(table.residual**2)))
    return entry, {"kind": f"the points lie {rms:.2g} N (rms) from it"}


def _padded(regression: DirectionFit, values: np.typing.NDArray[np.float64]) -> list[float]:
    """Three numbers a0, a1, a11; zero for a term that the fit has not."""
    row = [0.0, 0.0, 0.0]
    for name, value in zip(regression.fit.names, values, strict=True):
        row[_TERMS[name]] = float(value)
    return row


def _rounded(value: float) -> float:
    """Six digits: far finer than any standard deviation, short enough to read."""
    return float(f"{float(value):.6g}")


_REPLACED = re.compile(r"(gain|astern_ratio|p1_ahead|p1_astern|a(0|1|11)_(ahead|astern))$")


@dataclass(frozen=True)
class Written:
    """Text of the file, sentences on what was changed, what was lost, and groups that were not written."""

    text: str
    notes: tuple[str, ...]
    lost: tuple[Finding, ...]
    refused: tuple[Finding, ...]


def write_results(
    text: str,
    vehicle: Vehicle,
    fits: Sequence[UnitFit],
    motors: Mapping[str, tuple[tuple[str, ...], Mapping[str, Any]]],
    *,
    name: str,
    rho: float | None = None,
) -> Written:
    """Vehicle file `text`, which says `vehicle`, with fitted characteristics and motors (per group its
    actuators and keys); `name` and `rho` are the bench test's, and the density of its water, kg/m³.
    """
    import tomlkit

    document: Any = tomlkit.parse(text)
    notes: list[str] = []
    refused: list[Finding] = []
    lost: list[Finding] = []
    for fit in fits:
        members = fit.unit.actuators
        try:
            # All of the group's entries before the first one is put in: a refusal leaves none behind.
            made = [
                (old_name, users, old, _entry_of(fit, old, users, vehicle, rho))
                for old_name, users in _entries(document, "characteristic", members).items()
                for old in (document["characteristics"][old_name].unwrap(),)
            ]
        except VehicleError as error:
            refused.append(Finding("not written", Severity.PROBLEM, fit.unit.name, {"why": str(error)}))
            continue
        for old_name, users, old, (entry, remarks) in made:
            new = _own_entry(document, "characteristics", "characteristic", old_name, users, fit.unit.name)
            _put(document["characteristics"][new], entry, remarks, name, drop=True)
            notes.append(_said("characteristic", old_name, new, fit.unit.name, fit.kind))
            notes += [
                f"{fit.unit.name}: {side} was not tested; the thrust {side} that the vehicle file had is kept"
                for side in SIDES
                if any(remark == _UNTESTED and key.endswith(side) for key, remark in remarks.items())
            ]
            if inflow := sorted(key for key in ("p2", "alpha2") if old.get(key) and key not in entry):
                values = {"kind": fit.kind, "keys": ", ".join(inflow)}
                lost.append(Finding("inflow dropped", Severity.WEAKNESS, old_name, values))
        removed = _remove_factors(document, members)
        if removed:
            notes.append(f"removed from [coefficients], which the test replaces: {', '.join(removed)}")
    for unit, (members, keys) in motors.items():
        for old_name, users in _entries(document, "motor", members).items():
            new = _own_entry(document, "motors", "motor", old_name, users, unit)
            _put(document["motors"][new], keys, {}, name, drop=False)
            notes.append(_said("motor", old_name, new, unit, ", ".join(keys)))
    return Written(tomlkit.dumps(document), tuple(notes), tuple(lost), tuple(refused))


def _entries(document: Any, key: str, members: Sequence[str]) -> dict[str, list[str]]:
    """Members by the entry that they name under a key; by "" those that name none."""
    users: dict[str, list[str]] = {}
    for thruster in document["thrusters"]:
        if thruster["name"] in members:
            users.setdefault(str(thruster.get(key, "")), []).append(str(thruster["name"]))
    return users


def _own_entry(document: Any, section: str, key: str, old_name: str, users: Sequence[str], unit: str) -> str:
    """Name of an entry that only these actuators use; where there is none it is made and they refer to it."""
    import tomlkit
    from tomlkit.items import InlineTable

    sharing = [str(t["name"]) for t in document["thrusters"] if str(t.get(key, "")) == old_name]
    if old_name and set(sharing) <= set(users):
        return old_name
    if section not in document:
        document[section] = tomlkit.table(is_super_table=True)
    base = re.sub(r"[^A-Za-z0-9]+", "_", f"{old_name}_{unit}" if old_name else unit).strip("_")
    new, count = base, 2
    while new in document[section]:
        new, count = f"{base}_{count}", count + 1
    inline = isinstance(document[section], InlineTable)
    made: Any = tomlkit.inline_table() if inline else tomlkit.table()
    if old_name:
        for entry, value in document[section][old_name].unwrap().items():
            made.add(entry, _item(value))
    if not inline:
        made.add(tomlkit.nl())
    document[section].append(new, made)
    for thruster in document["thrusters"]:
        if str(thruster["name"]) in users:
            thruster[key] = new
    return new


def _put(table: Any, entry: Mapping[str, Any], remarks: Mapping[str, str], name: str, *, drop: bool) -> None:
    """Set the keys of an entry; keys that have the same value keep their comments."""
    from tomlkit.items import InlineTable

    # What comes after a new key is put behind it, so that the entry reads in its usual order.
    first_new = next((k for k, key in enumerate(entry) if key not in table), len(entry))
    later = list(entry)[first_new:]
    former = {key: table.item(key) for key in table}
    for key in list(former) if drop else []:
        if key not in entry or key in later:
            del table[key]
    for key, value in entry.items():
        if key in former and former[key].unwrap() == value and key not in remarks:
            if key not in table:
                table.add(key, former[key])
            continue
        table[key] = _item(value)
        if not isinstance(table, InlineTable):  # which has no room for a comment
            table[key].comment(f"bench test {name}" + (f", {remarks[key]}" if key in remarks else ""))


def _item(value: Any) -> Any:
    import tomlkit

    if isinstance(value, list) and value and isinstance(value[0], list):
        outer = tomlkit.array()
        for row in value:
            outer.append(row)
        return outer.multiline(True)
    return tomlkit.item(value)


def _remove_factors(document: Any, members: Sequence[str]) -> list[str]:
    table = document["coefficients"]
    removed = [
        key
        for key in list(table.keys())
        if "." in key and key.partition(".")[0] in members and _REPLACED.match(key.partition(".")[2])
    ]
    for key in removed:
        del table[key]
    return removed


def _said(what: str, old: str, new: str, unit: str, how: str) -> str:
    where = f"{what} {new}" if new == old else f"{what} {new}, split from {old or 'an ideal one'}"
    return f"{unit}: written as {where} ({how})"
