"""Points of a load-cell record: read, cut into plateaus, tared, separated into single actuators.

The cell's zero is the mean load of the plateaus at zero signal. Its own standard error is common to all
points of the record and is kept, so that the regression counts it (`seatrial.bench_test.regression`).
Tests: ``tests/test_bench_records.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.bench_test.bench_columns import BenchTable, listed, read_bench_table
from seatrial.bench_test.bench_file import SENSES
from seatrial.bench_test.plateaus import Plateau, plateaus, rows_as_plateaus
from seatrial.bench_test.pull_signals import behind_motors, repeated, signals_of
from seatrial.bench_test.separation import Separated, force_per_newton, separate
from seatrial.check.actuators import largest
from seatrial.errors import TrialError

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.bench_file import Pull
    from seatrial.bench_test.driven import Unit

__all__ = ["PullPoints", "read_pull"]

Array = NDArray[np.float64]

_ZERO_SHARE = 1e-6
_ZERO_MEASURED = 0.01
_APART = 4.0
_NOTHING_N = 1e-9  # rounding of a load that never changes


@dataclass(frozen=True, eq=False)
class PullPoints:
    """Points (n,) of one record.

    Attributes
    ----------
    name, file
        Of the pull.
    signal, thrust, voltage, error
        Signal in the command's unit, from neutral; thrust of a single actuator, N; supply voltage, V, NaN
        where it is not known; standard error of the thrust from its samples, N, NaN in a table without time.
    places, running
        Row or interval of each, and the actuators that ran.
    zero_effect, zero_error
        Thrust per newton of zero error (n, a), and the standard error of the tare (a,) in N.
    rests
        Steady parts at zero signal behind the tare; none where nothing was subtracted.
    tare
        What was subtracted from the load (a,) in N; None where nothing was.
    factors
        Load of the vehicle per newton of a single actuator, one per set of actuators that ran.
    notes
        Sentences.
    """

    name: str
    file: str
    signal: Array
    thrust: Array
    voltage: Array
    error: Array
    places: tuple[str, ...]
    running: tuple[tuple[str, ...], ...]
    zero_effect: Array
    zero_error: Array
    rests: int
    tare: Array | None
    factors: dict[tuple[str, ...], float]
    notes: tuple[str, ...]


def read_pull(
    pull: Pull,
    unit: Unit,
    vehicle: Vehicle,
    path: Path,
    *,
    where: str,
    reader: str | None = None,
    columns: dict[str, Any] | None = None,
) -> PullPoints:
    """Points of a pull from its file.

    Parameters
    ----------
    pull : Pull
        The bench file's entry.
    unit : Unit
        What was driven.
    vehicle : Vehicle
        Gives geometry and motors.
    path : Path
    where : str
        Beginning of messages.
    reader, columns : optional
        Of the whole bench file; the pull's own go before.

    Raises
    ------
    TrialError
        The record cannot be read or tells no single thrust.
    """
    table = read_bench_table(
        path, vehicle, reader=pull.reader or reader, columns=(columns or {}) | pull.columns
    )
    axes, load = _load(pull, table, where)
    signal, commanded = signals_of(pull, unit, vehicle, table, where)
    voltage = table.voltage
    if voltage is None and pull.voltage_v is not None:
        voltage = np.full(len(load), pull.voltage_v)
    if table.t is None:
        found, left = rows_as_plateaus(signal, load, voltage)
        notes = [f"{left} rows with empty cells left out"] if left else []
        if not found:
            raise TrialError(f"{where}: no row of {table.file} has both signal and load; check the columns")
    else:
        commands = {name: table.commands[name] for name in signal if name in table.commands}
        if not commands.keys() & set(unit.actuators):
            commands = {}  # those of idle groups do not tell where a plateau of this one ends
        found, left = plateaus(table.t, commands, signal, load, voltage, settle_s=pull.settle_s, where=where)
        counts = [plateau.samples for plateau in found]
        notes = [
            f"{len(found)} plateaus, each averaged over {min(counts)} to {max(counts)} steady samples, which"
            " err alike, to one point"
        ]
        notes += [f"{left} plateaus too short to be steady left out"] if left else []
    found = behind_motors(found, vehicle, commanded)
    notes += repeated(found) if table.t is None else []
    limit = max(largest(vehicle.actuator_info()[name], 1.0) for name in unit.actuators)
    zero = (_ZERO_MEASURED if pull.use == "measured" and table.t is not None else _ZERO_SHARE) * limit
    resting = [p for p in found if all(abs(x) <= zero for x in p.signal.values())]
    tare, tare_error, said = _tare(pull, resting, load.shape[1], where)
    notes += said
    geometry = force_per_newton(vehicle, axes)
    points: list[tuple[Plateau, Separated]] = []
    for plateau in found:
        tared = replace(plateau, load=plateau.load - (0.0 if tare is None else tare))
        point = separate(tared, unit, geometry, zero=zero, where=where)
        if point is not None:
            points.append((plateau, point))
    if not points:
        raise TrialError(
            f"{where}: no operating point with a signal: "
            + (
                f"{left} plateaus are too short after {pull.settle_s:g} s; hold each command longer, or lower"
                " settle_s"
                if left and table.t is not None
                else f"every command of {unit.name} is zero"
            )
        )
    return _gathered(pull, table.file, points, tare, tare_error, len(resting), notes)


def _gathered(
    pull: Pull,
    file: str,
    points: Sequence[tuple[Plateau, Separated]],
    tare: Array | None,
    tare_error: Array,
    rests: int,
    notes: list[str],
) -> PullPoints:
    drifting = [plateau.place for plateau, _ in points if plateau.drifting]
    if drifting:
        notes.append(
            f"the load still moved on {len(drifting)} of {len(points)} plateaus (first at {drifting[0]});"
            " hold longer or raise settle_s"
        )
    separated = [point for _, point in points]
    if not any(abs(point.thrust) > _NOTHING_N for point in separated):
        raise TrialError(
            f"{file}: the load is the same at rest and under every command; expected a force that answers the"
            " commands, so check the load cell's column"
        )
    strong = [p for p in separated if abs(p.thrust) > 0.3 * max(abs(q.thrust) for q in separated)]
    across = max(p.across / (abs(p.thrust) * p.factor) for p in strong)
    if across > 0.05:
        notes.append(
            f"WARNING: {100.0 * across:.0f} % of the load acts across the direction of the vehicle file;"
            " check direction of the actuators and alignment of the cell"
        )
    return PullPoints(
        name=pull.name,
        file=file,
        signal=np.array([p.signal for p in separated]),
        thrust=np.array([p.thrust for p in separated]),
        voltage=np.array([plateau.voltage for plateau, _ in points]),
        error=np.array([p.error for p in separated]),
        places=tuple(plateau.place for plateau, _ in points),
        running=tuple(p.running for p in separated),
        zero_effect=np.array([p.weights for p in separated]),
        zero_error=tare_error,
        rests=0 if tare is None else rests,
        tare=tare,
        factors={p.running: p.factor for p in separated},
        notes=tuple(notes),
    )


def _load(pull: Pull, table: BenchTable, where: str) -> tuple[str, Array]:
    """Letters of the cell's axes and the load (n, a) along them."""
    if pull.direction is not None:
        axis, sign = SENSES[pull.direction]
        if "" not in table.loads:
            raise TrialError(
                f'{where}: direction = "{pull.direction}" is for a single cell; expected a column load_n,'
                f" found loads on axes: {listed(table.loads)}; map it or give axis instead"
            )
        return axis, sign * table.loads[""][:, None]
    axes = str(pull.axis)
    missing = [f"load.{letter}_n" for letter in axes if letter not in table.loads]
    if missing:
        raise TrialError(
            f"{where}: no column {', '.join(missing)} in {table.file}; map the load cell's column in columns,"
            ' or, for a single cell (load_n), give direction = "ahead" instead of axis'
        )
    return axes, np.column_stack([table.loads[letter] for letter in axes])


def _tare(
    pull: Pull, resting: Sequence[Plateau], axes: int, where: str
) -> tuple[Array | None, Array, list[str]]:
    """Zero of the cell (a,), its standard error (a,), and what to say."""
    nothing = np.zeros(axes)
    if pull.tare is False:
        return None, nothing, []
    if not resting:
        if pull.tare:
            raise TrialError(
                f"{where}, key tare: there is no steady part at zero command to take the cell's zero from;"
                " record one, or remove tare"
            )
        return None, nothing, ["not tared: no steady part at zero command"]
    loads = np.array([plateau.load for plateau in resting])
    tare = loads.mean(axis=0)
    own = np.array([plateau.error for plateau in resting])
    if len(loads) > 2:
        error = loads.std(axis=0, ddof=1) / np.sqrt(len(loads))
    else:
        error = np.sqrt((np.nan_to_num(own) ** 2).sum(axis=0)) / len(loads)
    said = [
        f"tared by {', '.join(f'{x:+.3g}' for x in tare)} N, the mean of {len(loads)} steady parts at zero"
        " signal"
    ]
    if len(loads) > 1 and np.isfinite(own).all():
        apart = np.ptp(loads, axis=0)
        if (apart > _APART * np.sqrt(2.0) * own.max(axis=0)).any() and apart.max() > 0.0:
            said.append(f"the cell's zero moved by {apart.max():.2g} N between its steady parts")
    return tare, error, said
