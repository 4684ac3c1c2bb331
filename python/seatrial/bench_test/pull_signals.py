"""What the characteristic of a pull is a function of: commands behind their motors, or measured revolutions.

Commands stay as they were logged until the plateaus are known; then each plateau's command goes through the
settled motor once. Tests: ``tests/test_bench_records.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.bench_test.bench_columns import BenchTable, listed
from seatrial.bench_test.plateaus import Plateau, held
from seatrial.bench_test.separation import force_per_newton
from seatrial.bench_test.steady_signal import distance, settled
from seatrial.errors import TrialError

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.bench_file import Pull
    from seatrial.bench_test.driven import Unit

__all__ = ["behind_motors", "repeated", "signals_of"]

Array = NDArray[np.float64]

_LOG = 5


def signals_of(
    pull: Pull, unit: Unit, vehicle: Vehicle, table: BenchTable, where: str
) -> tuple[dict[str, Array], list[str]]:
    """Per thruster its command or measured signal (n,), and the names of those that are commands yet.

    Measured signals are counted from neutral; of other groups there is only what is logged.

    Raises
    ------
    TrialError
        A column is missing, or a sign is given to what has one.
    """
    chosen = table.commands if pull.use == "command" else table.measured
    _refuse_missing(pull, unit, table, chosen, where)
    found: dict[str, Array] = {}
    commanded = []
    # A fin does not pull a vehicle that stands still.
    for name in force_per_newton(vehicle, "X"):
        if pull.use == "measured" and name in chosen:
            found[name] = distance(vehicle, name, chosen[name])
        elif name in table.commands:
            values = table.commands[name]
            found[name] = values if table.t is None else held(values)
            commanded.append(name)
    if pull.sign_of is not None:
        side = np.sign(table.column(pull.sign_of.column, f"{where}, key sign_of") - pull.sign_of.neutral)
        for name in unit.actuators:
            if (found[name] < 0.0).any():
                raise TrialError(
                    f"{where}, key sign_of: meas.{name} has negative values, so it has a sign of its own;"
                    " remove sign_of"
                )
            found[name] = found[name] * side
    return found, commanded


def behind_motors(found: Sequence[Plateau], vehicle: Vehicle, commanded: Sequence[str]) -> list[Plateau]:
    """Plateaus whose commands are replaced by what the settled motors make of them, from neutral."""
    signals = [dict(plateau.signal) for plateau in found]
    for name in commanded:
        for signal, value in zip(
            signals, settled(vehicle, name, [one[name] for one in signals]), strict=True
        ):
            signal[name] = float(value)
    return [replace(plateau, signal=signal) for plateau, signal in zip(found, signals, strict=True)]


def _refuse_missing(
    pull: Pull, unit: Unit, table: BenchTable, chosen: Mapping[str, Array], where: str
) -> None:
    kind = "cmd" if pull.use == "command" else "meas"
    missing = [name for name in unit.actuators if name not in chosen]
    if len(missing) == len(unit.actuators):
        raise TrialError(
            f"{where}: no column {kind}.{missing[0]}; the recording {table.file} gives"
            f" {listed([f'cmd.{n}' for n in table.commands] + [f'meas.{n}' for n in table.measured])}; map it"
            f' in columns, for a whole group as "{kind}.{unit.name}"'
        )
    if missing:
        raise TrialError(
            f"{where}: no column {', '.join(f'{kind}.{name}' for name in missing)}, so it is not known"
            " whether they ran; map them, or list under actuators only those that were driven"
        )


def repeated(rows: Sequence[Plateau]) -> list[str]:
    """Warning about a log that was given without its time, from its rows."""
    table = np.array([list(row.signal.values()) for row in rows])
    same = (np.diff(table, axis=0) == 0.0).all(axis=1) & (table[1:] != 0.0).any(axis=1)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
    longest = 1 + int((ends[1::2] - ends[::2]).max(initial=0))
    if longest < _LOG:
        return []
    return [
        f"WARNING: {longest} rows in a row have the same signal; if this is a log, map its time as t_s: its"
        " samples err alike, and intervals of rows taken as points are too narrow"
    ]
