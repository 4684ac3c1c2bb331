"""A trial written back as a table with canonical columns, in the units that their names carry."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from seatrial.errors import TrialError
from seatrial.recording.columns import CHANNELS, GROUPS
from seatrial.whole_file import write_table

if TYPE_CHECKING:
    import polars as pl

    from seatrial.trial import Trial

__all__ = ["table", "write"]

Array = NDArray[np.float64]


def table(trial: Trial) -> pl.DataFrame:
    """Polars table of a trial; masked samples are empty cells, an attitude is a quaternion."""
    import polars as pl

    known = np.where(trial.valid, trial.observed, np.nan)
    columns: dict[str, Array] = {"t_s": trial.t}
    present = trial.channels
    extra = {
        "force": None if trial.tau is None else trial.tau[:, :3],
        "moment": None if trial.tau is None else trial.tau[:, 3:],
        "current": trial.current,
        "water velocity": trial.water,
        "voltage": None if trial.voltage is None else trial.voltage[:, None],
    }
    for group in GROUPS:
        if group.name == "quaternion":
            if {"roll", "pitch", "yaw"} <= set(present):
                attitude = np.where(trial.valid[:, 9:10], trial.attitude, np.nan)
                columns |= dict(zip(group.columns, attitude.T, strict=True))
        elif (values := extra.get(group.name)) is not None:
            columns |= dict(zip(group.columns, values.T, strict=True))
        elif group.name != "euler" or "q_w" not in columns:
            for column, channel in zip(group.columns, group.channels, strict=True):
                if channel in present:
                    columns[column] = known[:, CHANNELS.index(channel)] / group.factor
    columns |= {f"cmd.{actuator}": values for actuator, values in trial.commands.items()}
    columns |= {f"meas.{actuator}": values for actuator, values in trial.measured.items()}
    return pl.DataFrame(columns, nan_to_null=True)


def write(frame: pl.DataFrame, path: Path) -> None:
    """Write the table to a .csv or .parquet file.

    Raises
    ------
    TrialError
        If the ending is another one or the file cannot be written.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise TrialError(f'{path}: expected the ending .csv or .parquet, found "{path.suffix}"')
    write_table(frame, path)
