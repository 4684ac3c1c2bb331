"""Series that a page draws: what was measured and simulated in every trial, with its commands.

An identification leaves ``trials.parquet`` in its run directory when a page is asked for (`save_trials`). The
page carries at most `_MOST` samples of a series in 16 bits each, which no screen tells from the exact ones;
tables and the Parquet file have those. Held by ``tests/report/test_page_evidence.py``.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, runs
from seatrial.base.atomic_write import parquet, write_atomic
from seatrial.base.channels import CHANNELS, DEGREE
from seatrial.base.errors import SeatrialError, TrialError, first_line, reason
from seatrial.base.file_names import content_inside
from seatrial.base.run import belongs_to_run, from_json, to_json
from seatrial.inspect.manoeuvres import manoeuvres
from seatrial.report.page.run_folder import RunFolder
from seatrial.report.plot.identification import predicted
from seatrial.report.plot.trials import ANGLES, IN_DEGREES, NAMES, beside

if TYPE_CHECKING:
    import polars as pl

    from seatrial.identification.identification import Identification

TRIALS_FILE = "trials.parquet"

_MANOEUVRES = "manoeuvres.json"

_MOST = 1500  # samples of a series: about the pixels of a wide screen

_LARGEST = 2**30  # bytes of the table of all trials: some 30 million samples

_STEPS = 65000  # of 16 bits, without the one that stands for "none"

_NONE = -32768  # the least 16 bit number, which no value is packed to


def save_trials(fit: Identification, folder: Path) -> Path:
    """Path of the table of all trials: measured and simulated channels, SI and rad, and commands, by time.

    Beside it ``manoeuvres.json`` tells what was done in each trial, and when.

    Columns ``trial``, ``t_s``, ``held_out``, ``restart`` (a prediction begins there), ``measured.<channel>``,
    ``simulated.<channel>`` and ``cmd.<actuator>`` in the actuator's unit.

    Raises
    ------
    SeatrialError
        The file cannot be written.
    """
    import polars as pl

    tables, done = [], {}
    for name, trial in fit.problem.trials.items():
        try:
            tables.append(_table(fit, name))
        except TrialError:  # such a trial is named among the notes of the identification
            continue
        done[name] = [
            _window(manoeuvre.kind, manoeuvre.start_s, manoeuvre.end_s)
            for manoeuvre in manoeuvres(trial, fit.vehicle)
        ]
    target = folder / TRIALS_FILE
    table = pl.concat(tables, how="diagonal") if tables else pl.DataFrame()
    try:
        write_atomic(target, parquet(table))
        write_atomic(folder / _MANOEUVRES, to_json(done).encode())
        belongs_to_run(folder, (target, folder / _MANOEUVRES))
    except OSError as error:
        raise SeatrialError(f"{target}: cannot be written ({reason(error)})") from None
    return target


def _window(kind: str, start_s: float, end_s: float) -> dict[str, Any]:
    """A manoeuvre as a page offers it."""
    return {"label": f"{kind}, {start_s:.0f} to {end_s:.0f} s", "from": float(start_s), "to": float(end_s)}


def _table(fit: Identification, name: str) -> pl.DataFrame:
    import polars as pl

    trial, windows, channels = predicted(fit, name)
    columns: dict[str, Any] = {"t_s": trial.t, "held_out": fit.problem.held_out(name)}
    restart = np.zeros(len(trial.t), bool)
    restart[[window.start for window in windows]] = True
    columns["restart"] = restart
    for channel in channels:
        k = CHANNELS.index(channel)
        columns[f"measured.{channel}"] = np.where(trial.valid[:, k], trial.observed[:, k], np.nan)
        simulated = np.full(len(trial.t), np.nan)
        for window in windows:
            simulated[window.start : window.stop] = window.simulated[:, k]
        columns[f"simulated.{channel}"] = simulated
    columns |= {f"cmd.{actuator}": values for actuator, values in trial.commands.items()}
    return pl.DataFrame({"trial": [name] * len(trial.t)} | columns)


def evidence(run: RunFolder) -> list[dict[str, Any]]:
    """Groups of panels of a run: a title, panels with their lines, and the spans of time that are shaded."""
    if run.path is None:
        return []
    place = run.path / TRIALS_FILE
    if run.kind == "identification" and place.is_file():
        return list(_trials(_read(place), _units(run), _done(run.path / _MANOEUVRES)))
    return []


def _units(run: RunFolder) -> dict[str, str]:
    """Unit of every actuator's command."""
    from seatrial._core import Vehicle

    try:
        vehicle = Vehicle.from_toml(run.files["vehicle.toml"])
    except (KeyError, SeatrialError):
        return {}
    return {name: str(facts["unit"]) for name, facts in vehicle.actuator_info().items()}


def _done(place: Path) -> Mapping[str, Any]:
    """Manoeuvres by trial; none where no file tells them."""
    try:
        finished = from_json(content_inside(place.parent, place, most=_LARGEST).decode())
    except (SeatrialError, ValueError):
        return {}
    return finished if isinstance(finished, dict) else {}


def _read(place: Path) -> pl.DataFrame:
    import polars as pl

    try:
        return pl.read_parquet(content_inside(place.parent, place, most=_LARGEST))
    except pl.exceptions.PolarsError as error:
        raise SeatrialError(f"{place}: expected a Parquet table, found none ({first_line(error)})") from None


def _trials(
    table: pl.DataFrame, units: Mapping[str, str], done: Mapping[str, Any]
) -> Iterator[dict[str, Any]]:
    for (name,), part in table.partition_by("trial", as_dict=True, maintain_order=True).items():
        t = part["t_s"].to_numpy()
        held, restart = part["held_out"].to_numpy(), part["restart"].to_numpy()
        panels = []
        for channel in (column.removeprefix("measured.") for column in part.columns):
            if channel not in CHANNELS or part[f"measured.{channel}"].null_count() == len(part):
                continue
            measured = part[f"measured.{channel}"].to_numpy().copy()
            simulated = part[f"simulated.{channel}"].to_numpy().copy()
            if channel in ANGLES:
                measured, simulated = _unwound(measured, simulated, np.flatnonzero(restart))
            scale = 1.0 / DEGREE if channel in IN_DEGREES else 1.0
            simulated[restart] = np.nan  # a line per prediction
            unit = ("deg" if channel in IN_DEGREES else "m") + ("/s" if CHANNELS.index(channel) < 6 else "")
            panels.append({
                "name": NAMES[channel],
                "unit": unit,
                "lines": [
                    {"name": "measured", "look": "first", "y": scale * measured},
                    {"name": "simulated", "look": "second", "y": scale * simulated},
                ],
            })
        panels += _commands(part, units)
        group = _group(f"Trial {name}: measured against simulated, commands below", t, panels, held)
        yield group | {"windows": done.get(name, [])}


def _commands(part: pl.DataFrame, units: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """A panel per command; actuators with the same one share it."""
    alike: dict[bytes, list[str]] = {}
    for column in part.columns:
        if column.startswith("cmd.") and part[column].null_count() < len(part):
            alike.setdefault(part[column].to_numpy().tobytes(), []).append(column)
    for columns in alike.values():
        names = [column.removeprefix("cmd.") for column in columns]
        yield {
            "name": f"command {', '.join(names)}",
            "unit": units.get(names[0], "as recorded"),
            "lines": [{"name": "command", "look": "third", "y": part[columns[0]].to_numpy()}],
        }


def _unwound(measured: Array, simulated: Array, restarts: NDArray[np.intp]) -> tuple[Array, Array]:
    """Angles without jumps, every prediction beside what was measured."""
    known = np.isfinite(measured)
    measured[known] = np.unwrap(measured[known])
    for first, end in zip(restarts, [*restarts[1:], len(simulated)], strict=True):
        simulated[first:end] = beside(np.unwrap(simulated[first:end]), measured[first:end])
    return measured, simulated


def _group(title: str, t: Array, panels: Sequence[dict[str, Any]], held: Array) -> dict[str, Any]:
    step = max(1, -(-len(t) // _MOST))
    whole = bool(held.all())
    return {
        "title": title + (" (held out as a whole)" if whole else ""),
        "t": packed(t[::step]),
        "shade": []
        if whole
        else [[float(t[first]), float(t[min(end, len(t) - 1)])] for first, end in runs(held.astype(bool))],
        "panels": [
            panel | {"lines": [line | {"y": packed(line["y"][::step])} for line in panel["lines"]]}
            for panel in panels
        ],
    }


def packed(values: Array) -> dict[str, Any]:
    """A series in 16 bits a number: the least, the step and the numbers in base64.

    Examples
    --------
    >>> packed(np.array([0.0, 1.0]))["least"]
    0.0
    """
    values = np.asarray(values, float)
    known = np.isfinite(values)
    least = float(values[known].min()) if known.any() else 0.0
    step = (float(values[known].max()) - least) / _STEPS if known.any() else 0.0
    counted = np.zeros(len(values)) if step == 0.0 else np.round((values - least) / step)
    whole = np.where(known, np.where(known, counted, 0.0) - _STEPS // 2, _NONE).astype("<i2")
    return {"least": least, "step": step, "data": base64.b64encode(whole.tobytes()).decode()}
