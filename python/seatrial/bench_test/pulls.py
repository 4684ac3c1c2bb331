"""Operating points of load-cell records: read, cut into plateaus, tared, separated into single actuators.

A characteristic is a function of the command behind the settled motor or of measured revolutions. The settled
motor is the model's own chain: the vehicle is held and the command kept until every limit and lag has
settled, so that no rule of the motor (lift to the minimum, dead band, clipping, K_V) is written twice.

The cell's zero is the mean load of the plateaus at zero signal. Its own standard error is common to all
points of the record and is kept, so that the regression counts it (`seatrial.bench_test.regression`). Held by
``tests/bench_test/test_bench_records.py`` and ``tests/bench_test/test_bench_coverage.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial.base.arrays import Array, runs
from seatrial.base.errors import TrialError
from seatrial.base.finding import Finding, Severity
from seatrial.bench_test.file import SENSES, BenchTable, listed, read_bench_table
from seatrial.bench_test.plateaus import (
    Plateau,
    Separated,
    force_per_newton,
    held,
    plateaus,
    rows_as_plateaus,
    separate,
)
from seatrial.vehicle.actuators import NOMINAL_V, largest, settling_s, voltage_for

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.file import Pull, Unit


@dataclass(frozen=True)
class PullSettings:
    """What of a pull is rounding or noise."""

    step_s: float = 0.05  #: Of the simulation of motors until they settle, s.
    log_rows: int = 5  #: Rows with one signal that no table of points has: it is a log.
    zero_command_share: float = 1e-6  #: Of the limit: rounding of a command.
    zero_measured_share: float = 0.01  #: Of the limit: a resting motor's measured revolutions are noise.
    apart: float = 4.0  #: Standard errors of a difference: further apart it is no noise.
    nothing_n: float = 1e-9  #: Rounding of a load that never changes, N.


SETTINGS = PullSettings()


def distance(vehicle: Vehicle, actuator: str, values: ArrayLike) -> Array:
    """Signal (n,): commands or measured values from neutral, positive where they push along the direction."""
    facts = vehicle.actuator_info()[actuator]
    sense = -1.0 if facts["reversed"] else 1.0
    return np.asarray(sense * (np.asarray(values, dtype=float) - facts["neutral"]))


def settled(vehicle: Vehicle, actuator: str, commands: ArrayLike) -> Array:
    """Signal (n,) behind the settled motor for steady commands (n,); NaN stays NaN.

    Examples
    --------
    >>> import seatrial as st
    >>> settled(st.Vehicle.load("cwolf"), "SbU", [0.0, 60.0, -1000.0, 2500.0]).round().tolist()
    [0.0, 150.0, -1000.0, 2000.0]
    """
    wanted = np.asarray(commands, dtype=float)
    distinct = np.unique(wanted[np.isfinite(wanted)])
    facts = vehicle.actuator_info()[actuator]
    steps = int(np.ceil(settling_s(vehicle) / SETTINGS.step_s))
    held: dict[str, ArrayLike] = {actuator: np.repeat(distinct, steps)}
    t: Array = SETTINGS.step_s * np.arange(steps * len(distinct), dtype=float)
    if len(distinct) == 0:
        return np.full(wanted.shape, np.nan)
    run = vehicle.simulate(
        t, held, free="", voltage_v=voltage_for(vehicle, t, NOMINAL_V), max_step_s=SETTINGS.step_s
    )
    last = distance(vehicle, actuator, np.asarray(run.actuators[actuator])[steps - 1 :: steps])
    last[np.abs(last) < 1e-9 * largest(facts, 1.0)] = 0.0
    result = np.full(wanted.shape, np.nan)
    finite = np.isfinite(wanted)
    result[finite] = last[np.searchsorted(distinct, wanted[finite])]
    return result


def _signals_of(
    pull: Pull, unit: Unit, vehicle: Vehicle, table: BenchTable, where: str
) -> tuple[dict[str, Array], list[str]]:
    """Per thruster its command or measured signal (n,), counted from neutral, and the names of those that are
    commands yet.
    """
    chosen = table.commands if pull.use == "command" else table.measured
    _refuse_missing(pull, unit, table, chosen, where)
    signals: dict[str, Array] = {}
    commanded = []
    # A fin does not pull a vehicle that stands still.
    for name in force_per_newton(vehicle, "X"):
        if pull.use == "measured" and name in chosen:
            signals[name] = distance(vehicle, name, chosen[name])
        elif name in table.commands:
            values = table.commands[name]
            signals[name] = values if table.t is None else held(values)
            commanded.append(name)
    if pull.sign_of is not None:
        side = np.sign(table.column(pull.sign_of.column, f"{where}, key sign_of") - pull.sign_of.neutral)
        for name in unit.actuators:
            if (signals[name] < 0.0).any():
                raise TrialError(
                    f"{where}, key sign_of: meas.{name} has negative values, so it has a sign of its own;"
                    " remove sign_of"
                )
            signals[name] = signals[name] * side
    return signals, commanded


def _behind_motors(steady: Sequence[Plateau], vehicle: Vehicle, commanded: Sequence[str]) -> list[Plateau]:
    """Plateaus whose commands are replaced by what the settled motors make of them, from neutral."""
    signals = [dict(plateau.signal) for plateau in steady]
    for name in commanded:
        for signal, value in zip(
            signals, settled(vehicle, name, [signal_of[name] for signal_of in signals]), strict=True
        ):
            signal[name] = float(value)
    return [replace(plateau, signal=signal) for plateau, signal in zip(steady, signals, strict=True)]


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


def _repeated(name: str, rows: Sequence[Plateau]) -> list[Finding]:
    """That a log was given without its time, from its rows."""
    table = np.array([list(row.signal.values()) for row in rows])
    same = (np.diff(table, axis=0) == 0.0).all(axis=1) & (table[1:] != 0.0).any(axis=1)
    longest = 1 + max((end - start for start, end in runs(same)), default=0)
    if longest < SETTINGS.log_rows:
        return []
    return [Finding("log without time", Severity.PROBLEM, name, {"rows": longest})]


@dataclass(frozen=True, eq=False)
class PullPoints:
    """Points (n,) of one record: signal in the command's unit from neutral, thrust of a single actuator in N,
    supply in V (NaN where it is not known), standard error of the thrust from its samples in N (NaN
    without time).

    `zero_effect` (n, a) is the thrust per newton of zero error of the cell, `zero_error` (a,) the standard
    error of the `tare` (a,) in N, from so many `rests`; None and 0 where nothing was subtracted. `factors`:
    load of the vehicle per newton of one actuator, by the actuators that ran.
    """

    name: str
    file: str
    signal: Array
    thrust: Array
    voltage_v: Array
    error: Array
    labels: tuple[str, ...]
    running: tuple[tuple[str, ...], ...]
    zero_effect: Array
    zero_error: Array
    rests: int
    tare: Array | None
    factors: dict[tuple[str, ...], float]
    notes: tuple[str, ...]
    doubts: tuple[Finding, ...]


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
    """Points of a pull from its file; `reader` and `columns` are those of the whole bench file, the pull's
    own have precedence. A TrialError, begun with `where`, where the record determines no single thrust.
    """
    table = read_bench_table(
        path, vehicle, reader=pull.reader or reader, columns=(columns or {}) | pull.columns
    )
    axes, load = _load(pull, table, where)
    signal, commanded = _signals_of(pull, unit, vehicle, table, where)
    voltage_v = table.voltage_v
    if voltage_v is None and pull.voltage_v is not None:
        voltage_v = np.full(len(load), pull.voltage_v)
    if table.t is None:
        steady, left = rows_as_plateaus(signal, load, voltage_v)
        notes = [f"{left} rows with empty cells left out"] if left else []
        if not steady:
            raise TrialError(f"{where}: no row of {table.file} has both signal and load; check the columns")
    else:
        commands = {name: table.commands[name] for name in signal if name in table.commands}
        if not commands.keys() & set(unit.actuators):
            commands = {}  # those of idle groups do not end a plateau of this one
        steady, left = plateaus(
            table.t, commands, signal, load, voltage_v, settle_s=pull.settle_s, where=where
        )
        counts = [plateau.samples for plateau in steady]
        notes = [
            f"{len(steady)} plateaus, each averaged over {min(counts)} to {max(counts)} steady samples, which"
            " err alike, to one point"
        ]
        notes += [f"{left} plateaus too short to be steady left out"] if left else []
    # Thrust is a function of what the motor settles at, not of the command.
    steady = _behind_motors(steady, vehicle, commanded)
    doubts = _repeated(pull.name, steady) if table.t is None else []
    limit = max(largest(vehicle.actuator_info()[name], 1.0) for name in unit.actuators)
    zero = (
        SETTINGS.zero_measured_share
        if pull.use == "measured" and table.t is not None
        else SETTINGS.zero_command_share
    ) * limit
    # Plateaus at rest show the zero of the cell, by which the others are tared.
    resting = [p for p in steady if all(abs(x) <= zero for x in p.signal.values())]
    tare, tare_error, remarks = _tare(pull, resting, load.shape[1], where)
    notes += remarks
    geometry = force_per_newton(vehicle, axes)
    points: list[tuple[Plateau, Separated]] = []
    for plateau in steady:
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
    gathered = _gathered(pull, table.file, points, tare_error, notes)
    doubts += _across(pull.name, [point for _, point in points])
    return replace(gathered, tare=tare, rests=0 if tare is None else len(resting), doubts=tuple(doubts))


def _across(name: str, points: Sequence[Separated]) -> list[Finding]:
    """That much of the load acts across the direction of the vehicle file."""
    # Across weak pulls noise alone makes a large share.
    strong = [p for p in points if abs(p.thrust) > 0.3 * max(abs(q.thrust) for q in points)]
    share = max(p.across / (abs(p.thrust) * p.factor) for p in strong)
    if share <= 0.05:
        return []
    return [Finding("load across", Severity.PROBLEM, name, {"share_percent": 100.0 * share})]


def _gathered(
    pull: Pull, file: str, points: Sequence[tuple[Plateau, Separated]], tare_error: Array, notes: list[str]
) -> PullPoints:
    drifting = [plateau.label for plateau, _ in points if plateau.drifting]
    if drifting:
        notes.append(
            f"the load still moved on {len(drifting)} of {len(points)} plateaus (first at {drifting[0]});"
            " hold longer or raise settle_s"
        )
    separated = [point for _, point in points]
    if not any(abs(point.thrust) > SETTINGS.nothing_n for point in separated):
        raise TrialError(
            f"{file}: the load is the same at rest and under every command; expected a force that answers the"
            " commands, so check the load cell's column"
        )
    return PullPoints(
        name=pull.name,
        file=file,
        signal=np.array([p.signal for p in separated]),
        thrust=np.array([p.thrust for p in separated]),
        voltage_v=np.array([plateau.voltage_v for plateau, _ in points]),
        error=np.array([p.error for p in separated]),
        labels=tuple(plateau.label for plateau, _ in points),
        running=tuple(p.running for p in separated),
        zero_effect=np.array([p.weights for p in separated]),
        zero_error=tare_error,
        rests=0,
        tare=None,
        factors={p.running: p.factor for p in separated},
        notes=tuple(notes),
        doubts=(),
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
    """Zero of the cell (a,), its standard error (a,), and remarks."""
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
    remarks = [
        f"tared by {', '.join(f'{x:+.3g}' for x in tare)} N, the mean of {len(loads)} steady parts at zero"
        " signal"
    ]
    if len(loads) > 1 and np.isfinite(own).all():
        apart = np.ptp(loads, axis=0)
        if (apart > SETTINGS.apart * np.sqrt(2.0) * own.max(axis=0)).any() and apart.max() > 0.0:
            remarks.append(f"the cell's zero moved by {apart.max():.2g} N between its steady parts")
    return tare, error, remarks


@dataclass(frozen=True, eq=False)
class Points:
    """Points (n,) of a group, with the names of pull and place of each. ``zero`` (n, m) is the thrust per
    newton of zero error of each cell, ``zero_error`` (m,) the tares' standard errors in N, ``rests`` (m,)
    the steady parts behind each tare.
    """

    signal: Array
    thrust: Array
    voltage_v: Array
    error: Array
    zero: Array
    zero_error: Array
    rests: Array
    pull: tuple[str, ...]
    label: tuple[str, ...]
    running: tuple[tuple[str, ...], ...]

    @classmethod
    def pooled(cls, pulls: Sequence[PullPoints]) -> Points:
        """Points of several pulls together; each has a cell of its own."""
        from scipy.linalg import block_diag

        return cls(
            signal=np.concatenate([p.signal for p in pulls]),
            thrust=np.concatenate([p.thrust for p in pulls]),
            voltage_v=np.concatenate([p.voltage_v for p in pulls]),
            error=np.concatenate([p.error for p in pulls]),
            zero=np.asarray(block_diag(*[p.zero_effect for p in pulls])),
            zero_error=np.concatenate([p.zero_error for p in pulls]),
            rests=np.concatenate([np.full(len(p.zero_error), float(p.rests)) for p in pulls]),
            pull=tuple(p.name for p in pulls for _ in p.labels),
            label=tuple(f"{Path(p.file).name}, {label}" for p in pulls for label in p.labels),
            running=tuple(names for p in pulls for names in p.running),
        )

    def zero_columns(self, sigma: float) -> Array:
        """Columns (n, m) of one standard deviation each of the tares' errors: at least what the points
        scatter by, ``sigma`` in N, over the root of the number of rests, as a plateau at rest repeats no
        better than the others.
        """
        per_newton = np.abs(self.zero).max(axis=0, initial=0.0)
        repeated = sigma / np.maximum(per_newton, 1e-12) / np.sqrt(np.maximum(self.rests, 1.0))
        own = np.maximum(self.zero_error, repeated)
        return np.asarray(self.zero * np.where(self.rests > 0.0, own, 0.0))
