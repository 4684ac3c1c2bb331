"""The log of a mission: what the sensors told as a trial, and beside it set points, errors and legs.

A log that `seatrial fly` wrote holds the true motion under the canonical names and what the autopilot was
told as ``measured.…``. No sea trial knows the truth, so it is read by what was told, and the
surface of the flight is known. Logs of other origin are read as any trial is; their columns
``desired.speed_m_s``, ``desired.lateral_m_s``, ``desired.heading_deg``, ``desired.pitch_deg``,
``desired.depth_m``, ``error.cross_track_m``, ``error.vertical_m``, ``leg``, ``distance_m``, ``reaction``,
``power_w``, ``energy_wh``, ``altitude_m`` are taken where they are there.

A reference is thinned to the rate of the log before its errors are taken: commands between two samples are
not known and count as held, smoothed states err more, and so a model that holds misses a slow log further
than a fast one. An offset of a sensor starts every window of a log with the same wrong state; no number of
windows averages it out, so that it belongs to the band like a coefficient that is not known exactly.

Tests: ``test_recorded_mission.py``, ``test_recorded_campaign.py`` and ``test_recorded_validity.py`` in
``tests/verification/``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS
from seatrial.base.errors import TrialError
from seatrial.flight.sensor_channels import sensor_channels, sensors_of
from seatrial.trial.columns import columns_of, parse
from seatrial.trial.readers import read_table
from seatrial.trial.trial import Trial

if TYPE_CHECKING:
    from seatrial._core import Vehicle

_FLOWN_SURFACE_M = 0.0  # flights have the sea's surface at depth 0 (docs/theory/surface.md)

_BESIDE = {
    "desired.speed_m_s": ("speed", 1.0),
    "desired.lateral_m_s": ("lateral", 1.0),
    "desired.heading_deg": ("heading", math.pi / 180.0),
    "desired.pitch_deg": ("pitch", math.pi / 180.0),
    "desired.depth_m": ("depth", 1.0),
    "error.cross_track_m": ("cross_track", 1.0),
    "error.vertical_m": ("vertical", 1.0),
    "leg": ("leg", 1.0),
    "distance_m": ("distance", 1.0),
    "reaction": ("reaction", 1.0),
    "power_w": ("power", 1.0),
    "energy_wh": ("energy_wh", 1.0),
    "altitude_m": ("altitude", 1.0),
}

_MEASURED = "measured."


@dataclass(frozen=True, eq=False)
class MissionLog:
    """A trial, and what guidance wanted meanwhile.

    Attributes
    ----------
    trial
        The log as a trial.
    beside
        speed, lateral, heading, pitch, depth (desired); cross_track, vertical; leg, distance, reaction,
        power, energy_wh, altitude: those that were logged, (n,) on the trial's times, SI and rad.
    """

    trial: Trial
    beside: Mapping[str, Array]

    @classmethod
    def of(cls, trial: Trial) -> MissionLog:
        """Log of a trial that tells nothing of guidance."""
        return cls(trial, {})

    @classmethod
    def read(
        cls, source: Any, *, columns: Mapping[str, Any] | None = None, name: str | None = None, **options: Any
    ) -> MissionLog:
        """Log from a file, a frame, or a run directory of `seatrial fly`.

        Parameters
        ----------
        source
            CSV or Parquet file, frame, or folder with ``flight.parquet``.
        columns
            Map of columns as for `Trial.read`; canonical names need no entry.
        name
            What to call it.
        options
            Further keywords of `Trial.read`.

        Raises
        ------
        TrialError
            The log cannot be read.

        Examples
        --------
        >>> import seatrial as st
        >>> mission = st.Mission.from_toml('''
        ... format = 1
        ... name = "out"
        ... speed_m_s = 1.5
        ... acceptance_radius_m = 5.0
        ... [[legs]]
        ... north_m = 60.0
        ... east_m = 0.0
        ... depth_m = 5.0
        ... ''')
        >>> typical = st.Conditions(sensors="typical")
        >>> log = MissionLog.read(st.fly("cwolf", "cwolf", mission, conditions=typical).table())
        >>> sorted(log.beside)[:3]
        ['cross_track', 'depth', 'distance']
        """
        if isinstance(source, str | Path) and Path(source).is_dir():
            folder = Path(source)
            source = folder / "flight.parquet"
            if not source.exists():
                raise TrialError(
                    f"{folder}: expected flight.parquet, as `seatrial fly --out` writes it, found none;"
                    " give the log's file"
                )
            name = name or folder.name
            options.setdefault("surface", _FLOWN_SURFACE_M)
        read = read_table(source, options.pop("reader", None), columns_of(columns))
        table, file = read.table, read.file
        told = {c.removeprefix(_MEASURED): c for c in table.columns if c.startswith(_MEASURED)}
        told.pop("altitude_m", None)
        if told:  # the table of a flight
            options.setdefault("surface", _FLOWN_SURFACE_M)
        mapped: dict[str, Any] = dict(told) | dict(columns or {})
        if told and any(column in table.columns for column in told):
            table = table.drop([column for column in told if column in table.columns])
        read.refuse_twice(source.column for source in parse(mapped, table.columns, file).values())
        try:
            trial = Trial.read(table, columns=mapped or None, name=name or Path(file).stem, **options)
        except TrialError as error:  # the table was read before, so that the trial knows it as a frame
            what = str(error)
            raise TrialError(f"{file}:{what[6:]}" if what.startswith("frame:") else what) from None
        times = _numbers(table, _time_column(mapped))
        beside = {}
        for column, (key, scale) in _BESIDE.items():
            values = _numbers(table, column) if column in table.columns else np.zeros(0)
            if len(values) and np.isfinite(values).any():
                beside[key] = scale * _held(trial.t, times, values)
        return cls(trial, beside)


def _time_column(columns: Mapping[str, Any]) -> str:
    given = columns.get("t_s", "t_s")
    return str(given["from"] if isinstance(given, Mapping) else given)


def _numbers(table: Any, column: str) -> Array:
    """Column as numbers, nan where it is none."""
    import polars as pl

    if column not in table.columns:
        return np.zeros(0)
    return np.asarray(table[column].cast(pl.Float64, strict=False).fill_null(float("nan")).to_numpy(), float)


def _held(t: Array, times: Array, values: Array) -> Array:
    """Values as they stood at times (n,): zero-order hold."""
    if len(times) != len(values):
        return np.full(len(t), np.nan)
    rows = np.clip(np.searchsorted(times, t + 1e-6, side="right") - 1, 0, len(values) - 1)
    return np.asarray(values[rows])


_FASTER = 1.5  # intervals that differ by less are the same up to rounding to whole samples


def thinned(trial: Trial, dt: float) -> Trial:
    """Trial with every n-th of its samples, as far apart as `dt`, s; itself where it is no faster."""
    if dt < _FASTER * trial.dt:
        return trial
    every, count = round(dt / trial.dt), len(trial)

    def of(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: of(one) for name, one in value.items()}
        return value[::every] if isinstance(value, np.ndarray) and len(value) == count else value

    kept = {one.name: of(getattr(trial, one.name)) for one in dataclasses.fields(trial)}
    return type(trial)(**kept)


_IN_CORE = ("x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r")

_OFFSET = 1  # column of the core's table of sensor errors


def offsets_of(sensors: Any, vehicle: Vehicle) -> dict[str, float]:
    """Standard deviation of the offset of each channel, SI, by a set of sensors as for `seatrial.fly`.

    Examples
    --------
    >>> import seatrial as st
    >>> sorted(offsets_of("typical", st.Vehicle.load("cwolf")))[:3]
    ['p', 'pitch', 'q']
    """
    fitted = sensors_of(sensors, vehicle)
    errors = sensor_channels(fitted, 0.1).errors[: len(_IN_CORE), _OFFSET]
    found = dict(zip(_IN_CORE, (float(x) for x in errors), strict=True))
    # An offset of the position moves start and path alike.
    return {name: found[name] for name in CHANNELS if found[name] > 0.0 and name not in ("x", "y", "z")}
