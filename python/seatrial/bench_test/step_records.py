"""Records of commanded and measured revolutions, one per actuator, and the motor that follows from them.

Signals are counted from neutral, positive along the actuator's direction. The estimate itself is
`seatrial.motor_dynamics`. Tests: ``tests/test_bench_steps.py``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.bench_test.bench_columns import listed, read_bench_table
from seatrial.bench_test.steady_signal import distance
from seatrial.errors import TrialError

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.bench_test.bench_file import Steps
    from seatrial.bench_test.driven import Unit
    from seatrial.motor_dynamics import StepRecord

__all__ = ["read_steps"]


def read_steps(
    steps: Steps,
    unit: Unit,
    vehicle: Vehicle,
    path: Path,
    *,
    where: str,
    reader: str | None = None,
    columns: dict[str, Any] | None = None,
) -> list[StepRecord]:
    """Step records of the unit's actuators that have both a command and a measurement in the file.

    Raises
    ------
    TrialError
        The file cannot be read, has no time, or no actuator of the unit has both columns.
    """
    from seatrial.motor_dynamics import StepRecord

    table = read_bench_table(
        path, vehicle, reader=steps.reader or reader, columns=(columns or {}) | steps.columns
    )
    if table.t is None:
        raise TrialError(f'{where}: no time in {table.file}; map a column as t_s, for example t_s = "Time"')
    both = [name for name in unit.actuators if name in table.commands and name in table.measured]
    if not both:
        raise TrialError(
            f"{where}: no actuator of {unit.name} has both its command and its revolutions; expected columns"
            f" cmd.{unit.actuators[0]} and meas.{unit.actuators[0]}; {table.file} gives"
            f" {listed([f'cmd.{n}' for n in table.commands] + [f'meas.{n}' for n in table.measured])}"
        )
    records = []
    for name in both:
        given = np.isfinite(table.measured[name])
        if not given.any():
            raise TrialError(
                f"{where}: meas.{name}: no cell of {table.file} is a number; check the column of the"
                " revolutions"
            )
        try:
            records.append(
                StepRecord(
                    table.t,
                    distance(vehicle, name, table.commands[name]),
                    distance(vehicle, name, table.measured[name])[given],
                    name,
                    table.t[given],
                )
            )
        except TrialError as error:
            raise TrialError(f"{where}: {error}") from None
    return records
