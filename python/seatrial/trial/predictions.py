"""Predictions of a model from elsewhere: a table of times and channels, to be scored beside ours.

The table has stamps of its own. At the samples of a trial a channel is read off linearly, angles the shorter
way round, and only between stamps that are no gap apart. Units come from the header: canonical names
(``u_m_s``, ``yaw_deg``), or a channel's name with its unit (``u [knot]``, ``yaw [rad]``). A column ``trial``
tells the trials apart. Held by ``tests/trial/test_predictions.py``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.base.channels import ANGLES, CHANNELS
from seatrial.base.errors import TrialError, nearest
from seatrial.logs.stamps import usual_interval
from seatrial.trial.columns import GROUPS, columns_of, parse
from seatrial.trial.own_samples import own_samples
from seatrial.trial.readers import FORMATS, Recording, read_table
from seatrial.trial.signals import RecordingReport
from seatrial.trial.table import signals, time_base

if TYPE_CHECKING:
    import polars as pl

    from seatrial.trial.trial import Trial

_TIMES = ("t", "time", "timestamp")
_GAP = 1.5  # times the usual interval
_TRIAL = "trial"
_BRACKETS = re.compile(r"\s*(.*?)\s*[\[(]([^\])]*)[\])]\s*$")

Samples = Mapping[str, tuple[Array, Array]]
"""Stamps in s (m,) and values in SI (m,) by channel."""


@dataclass(frozen=True, eq=False)
class Predictions:
    """What another model predicts, made by `read`.

    Attributes
    ----------
    name, source
        What to call it, and the file.
    samples
        By trial, "" for any, what is predicted: stamps in s and values in SI by channel.
    """

    name: str
    source: str
    samples: Mapping[str, Samples]

    @classmethod
    def read(
        cls, source: Any, *, columns: Mapping[str, Any] | None = None, name: str | None = None
    ) -> Predictions:
        """Predictions from a table of text, a Parquet file or a frame.

        Parameters
        ----------
        source
            Path or frame. Time in s from the same start as the trial's, a column per channel.
        columns
            As for `Trial.read`, where the header does not say it.
        name
            What to call it; the file's stem when omitted.

        Raises
        ------
        TrialError
            The table cannot be read, a channel has no unit, or none is there.

        Examples
        --------
        >>> t = np.arange(0.0, 2.0, 0.1)
        >>> found = Predictions.read({"time": t, "u_m_s": t, "yaw_deg": 10.0 * t})
        >>> list(found.samples[""])
        ['u', 'yaw']
        """
        recording = read_table(source, columns=columns_of(columns))
        table, file = recording.table, recording.file
        parts: dict[str, pl.DataFrame] = {"": table}
        if _TRIAL in table.columns:
            parts = {
                str(key[0]): part.drop(_TRIAL)
                for key, part in table.partition_by(_TRIAL, as_dict=True, maintain_order=True).items()
            }
        read = {trial: _samples(recording._replace(table=part), columns) for trial, part in parts.items()}
        return cls(name or Path(file).stem, file, read)

    @property
    def channels(self) -> list[str]:
        """Channels that are predicted, in the order of `CHANNELS`."""
        return [name for name in CHANNELS if any(name in one for one in self.samples.values())]

    def on(self, trial: Trial) -> Array:
        """Predictions at the samples of a trial, (n, 12) in SI; NaN where nothing is predicted.

        Raises
        ------
        TrialError
            The table is for other trials.
        """
        own = self.samples.get(trial.name, self.samples.get(""))
        if own is None:
            raise TrialError(
                f'{self.source}: column {_TRIAL}: expected rows of the trial "{trial.name}", found those of'
                f" {', '.join(self.samples)}{nearest(trial.name, self.samples)}"
            )
        track = np.full((len(trial), len(CHANNELS)), np.nan)
        for channel, (t, y) in own.items():
            track[:, CHANNELS.index(channel)] = _between(trial.t, t, y, channel)
        return track


def is_table(path: str) -> bool:
    """Whether a name is that of a table of predictions, and not of a vehicle."""
    return path.lower().endswith((*FORMATS["csv"], *FORMATS["parquet"]))


def _samples(recording: Recording, columns: Mapping[str, Any] | None) -> Samples:
    table, file, units, _ = recording
    entries = _short_names(table.columns, units, file) | dict(columns or {})
    sources = parse(entries, table.columns, file, units)
    recording.refuse_twice(source.column for source in sources.values())
    kept = {name: source for name, source in sources.items() if not name.startswith(("cmd.", "meas."))}
    t = time_base(table, kept["t_s"], file)
    known = signals(table, t, kept, file, RecordingReport(file)) if len(kept) > 1 else {}
    found = own_samples(known)
    if not found:
        raise TrialError(
            f"{file}: no channel is predicted; expected a column such as u_m_s, yaw_deg or u [m/s]"
        )
    return found


def _short_names(present: list[str], units: Mapping[str, str], file: str) -> dict[str, Any]:
    """Column map of a header with plain names: a time, and channels with their units."""
    canonical = {
        channel: column
        for group in GROUPS
        for column, channel in zip(group.columns, group.channels, strict=True)
        if channel in CHANNELS
    }
    entries: dict[str, Any] = {}
    for column in present:
        found = _BRACKETS.match(column)
        name, unit = found.groups() if found else (column, units.get(column, ""))
        if name.lower() in _TIMES and "t_s" not in present:
            entries["t_s"] = {"from": column} | ({"unit": unit} if unit else {})
        elif name in canonical and canonical[name] not in present:
            if not unit:
                raise TrialError(
                    f'{file}: column "{column}": expected its unit in the header, "{name} [...]", or the'
                    f" name {canonical[name]}"
                )
            entries[canonical[name]] = {"from": column, "unit": unit}
    return entries


def _between(at: Array, t: Array, y: Array, channel: str) -> Array:
    """Values between stamps (m,) at other times (n,); NaN outside and in gaps."""
    if len(t) < 2:
        return np.full(len(at), np.nan)
    rounding = 1e-6 * max(1.0, abs(float(t[-1])) * 1e-3)
    path = np.unwrap(y) if channel in ANGLES else y
    values = np.interp(at, t, path)
    after = np.clip(np.searchsorted(t, at - rounding), 0, len(t) - 1)
    before = np.clip(np.searchsorted(t, at + rounding, side="right") - 1, 0, len(t) - 1)
    gap = t[after] - t[before] > _GAP * usual_interval(t)
    outside = (at < t[0] - rounding) | (at > t[-1] + rounding)
    return np.where(gap | outside, np.nan, values)
