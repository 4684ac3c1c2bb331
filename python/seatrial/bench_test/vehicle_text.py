"""The vehicle file with the results of a bench test written in; comments of the original are kept (tomlkit).

An entry that other actuators use as well is left alone: the tested ones get their own. Factors in
``[coefficients]`` that corrected the old characteristic (gain, astern_ratio, p1 ...) of the tested actuators
are taken out, because the test replaces what they corrected; a direction that was not tested keeps them in
its entry (`seatrial.bench_test.vehicle_entry`).

Tests: ``tests/test_bench_vehicle.py``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from seatrial.bench_test.vehicle_entry import entry_of
from seatrial.errors import VehicleError

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.unit_fit import UnitFit

__all__ = ["Written", "write_results"]

_REPLACED = re.compile(r"(gain|astern_ratio|p1_ahead|p1_astern|a(0|1|11)_(ahead|astern))$")


@dataclass(frozen=True)
class Written:
    """Text of the file, the sentences on what was changed, and the groups that could not be written."""

    text: str
    notes: tuple[str, ...]
    refused: tuple[str, ...]


def write_results(
    text: str,
    vehicle: Vehicle,
    fits: Sequence[UnitFit],
    motors: Mapping[str, tuple[tuple[str, ...], Mapping[str, Any]]],
    *,
    name: str,
    rho: float | None = None,
) -> Written:
    """Vehicle file with fitted characteristics and motors.

    Parameters
    ----------
    text : str
        The file as it is.
    vehicle : Vehicle
        What it says.
    fits : sequence of UnitFit
    motors : mapping
        Per group its actuators and the keys of their motor's entry.
    name : str
        Of the bench test, for the remarks.
    rho : float, optional
        Density of the water of the test, kg/m³.
    """
    import tomlkit

    document: Any = tomlkit.parse(text)
    notes: list[str] = []
    refused: list[str] = []
    for fit in fits:
        members = fit.unit.actuators
        try:
            # All of the group's entries before the first one is put in: a refusal leaves none behind.
            made = [
                (old_name, users, old, entry_of(fit, old, users, vehicle, rho))
                for old_name, users in _entries(document, "characteristic", members).items()
                for old in (document["characteristics"][old_name].unwrap(),)
            ]
        except VehicleError as error:
            refused.append(f"{fit.unit.name} is not written into the vehicle file: {error}")
            continue
        for old_name, users, old, (entry, remarks) in made:
            new = _own_entry(document, "characteristics", "characteristic", old_name, users, fit.unit.name)
            _put(document["characteristics"][new], entry, remarks, name, drop=True)
            notes.append(_said("characteristic", old_name, new, fit.unit.name, fit.kind))
            lost = sorted(key for key in ("p2", "alpha2") if old.get(key) and key not in entry)
            if lost:
                notes.append(
                    f"WARNING: kind {fit.kind} knows no inflow: {', '.join(lost)} of {old_name} dropped"
                )
        removed = _remove_factors(document, members)
        if removed:
            notes.append(f"removed from [coefficients], which the test replaces: {', '.join(removed)}")
    for unit, (members, keys) in motors.items():
        for old_name, users in _entries(document, "motor", members).items():
            new = _own_entry(document, "motors", "motor", old_name, users, unit)
            _put(document["motors"][new], keys, {}, name, drop=False)
            notes.append(_said("motor", old_name, new, unit, ", ".join(keys)))
    return Written(tomlkit.dumps(document), tuple(notes), tuple(refused))


def _entries(document: Any, key: str, members: Sequence[str]) -> dict[str, list[str]]:
    """Members by the entry that they name under a key; by "" those that name none."""
    found: dict[str, list[str]] = {}
    for thruster in document["thrusters"]:
        if thruster["name"] in members:
            found.setdefault(str(thruster.get(key, "")), []).append(str(thruster["name"]))
    return found


def _own_entry(document: Any, section: str, key: str, old_name: str, users: Sequence[str], unit: str) -> str:
    """Name of an entry that only these actuators use; made, and they are led to it, where there is none."""
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
