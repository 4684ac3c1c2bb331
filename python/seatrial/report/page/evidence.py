"""What runs left for a page: series of every trial, and the flight as its record states it.

An identification leaves ``trials.parquet`` in its run directory when a page is asked for (`save_trials`); the
page carries its series in 16 bits each, which no screen tells from the exact ones. A flight's record states
every input, so that a page flies it again (`FlownRun`), and its verdict. Held by
``tests/report/test_page_evidence.py`` and ``tests/report/test_page_same_flight.py``.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, runs
from seatrial.base.channels import ANGLES, CHANNELS, readable
from seatrial.base.errors import SeatrialError, TrialError, first_line, reason
from seatrial.base.files import content_inside, parquet, write_atomic
from seatrial.base.run import belongs_to_run, from_json, to_json
from seatrial.flight.excesses import broken_in
from seatrial.flight.metrics import in_metric_units
from seatrial.inspect.manoeuvres import manoeuvres
from seatrial.report.page.run_folder import RunFolder
from seatrial.report.plot.identification import predicted
from seatrial.report.plot.trials import NAMES, beside
from seatrial.report.results.flight_findings import UNKEPT

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Vehicle
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.mission import Mission
    from seatrial.identification.identification import Identification

TRIALS_FILE = "trials.parquet"

_MANOEUVRES = "manoeuvres.json"


@dataclass(frozen=True)
class SeriesSettings:
    """How series are packed for a page."""

    most: int = 1500  #: Samples of a series: about the pixels of a wide screen.
    largest: int = 2**30  #: Bytes of the table of all trials: some 30 million samples.
    steps: int = 65000  #: Of 16 bits, without the one that stands for "none".
    none: int = -32768  #: The least 16 bit number, which no value is packed to.


SETTINGS = SeriesSettings()


def save_trials(fit: Identification, folder: Path) -> Path:
    """Path of the table of all trials: measured and simulated channels, SI and rad, and commands, by time.

    Beside it ``manoeuvres.json`` tells what was done in each trial, and when.

    Columns ``trial``, ``t_s``, ``held_out``, ``restart`` (a prediction begins there), ``measured.<channel>``,
    ``simulated.<channel>`` and ``cmd.<actuator>`` in the actuator's unit.
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
        finished = from_json(content_inside(place.parent, place, most=SETTINGS.largest).decode())
    except (SeatrialError, ValueError):
        return {}
    return finished if isinstance(finished, dict) else {}


def _read(place: Path) -> pl.DataFrame:
    import polars as pl

    try:
        return pl.read_parquet(content_inside(place.parent, place, most=SETTINGS.largest))
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
            scale, unit = readable(channel)
            simulated[restart] = np.nan  # a line per prediction
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
    step = max(1, -(-len(t) // SETTINGS.most))
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
    """A series in 16 bits a number: the least, the step and the numbers in base64."""
    values = np.asarray(values, float)
    known = np.isfinite(values)
    least = float(values[known].min()) if known.any() else 0.0
    step = (float(values[known].max()) - least) / SETTINGS.steps if known.any() else 0.0
    counted = np.zeros(len(values)) if step == 0.0 else np.round((values - least) / step)
    whole = np.where(known, np.where(known, counted, 0.0) - SETTINGS.steps // 2, SETTINGS.none).astype("<i2")
    return {"least": least, "step": step, "data": base64.b64encode(whole.tobytes()).decode()}


FIGURE_ROWS = (
    ("duration", "duration, s"),
    ("distance", "distance, m"),
    ("cross_track_rms", "cross track rms as perceived, m"),
    ("true_cross_track_rms", "true cross track rms, m"),
    ("cross_track_largest", "cross track largest as perceived, m"),
    ("true_cross_track_largest", "true cross track largest, m"),
    ("vertical_rms", "vertical rms as perceived, m"),
    ("missed_by", "largest miss of a waypoint as perceived, m"),
    ("clearance", "clearance, m"),
    ("depth_largest", "depth largest, m"),
    ("altitude_smallest", "altitude smallest, m"),
    ("energy", "energy, Wh"),
    ("pitch_largest", "pitch largest, deg"),
    ("roll_largest", "roll largest, deg"),
)
"""Figures of the core that a page shows of its flights, and what it calls them."""


@dataclass(frozen=True)
class FlownRun:
    """A run of kind "flight" with all its inputs.

    Files of the vehicle that flew, of the one that the autopilot believed in and of the filter's; the latter
    two are None where they are the same.
    """

    run: RunFolder
    vehicle: str
    model: str | None
    filter_model: str | None
    water: Water
    conditions: Conditions
    seed: int

    @classmethod
    def of(cls, runs: Sequence[RunFolder]) -> FlownRun | None:
        """The last flight of the runs; None without one, or where its record is that of another version."""
        run = next((run for run in reversed(runs) if run.kind == "flight"), None)
        if run is None or not {"vehicle.toml", "autopilot.toml", "mission.toml"} <= set(run.files):
            return None
        try:
            inputs = _flown_in(run.facts.get("options") or {})
        except (KeyError, TypeError, ValueError):
            return None
        files = run.files
        return cls(
            run, files["vehicle.toml"], files.get("model.toml"), files.get("filter_model.toml"), *inputs
        )

    @property
    def record(self) -> Mapping[str, Any]:
        """Options as the run's record has them."""
        return self.run.facts["options"] or {}

    def own_lines(self, vehicle: Vehicle) -> str:
        """Lines of a request for this flight alone: where it began, and what was added to its commands."""
        lines: dict[str, Any] = {}
        if (start := self.record.get("start")) is not None:
            lines["start"] = [start["position_m"], start["attitude"], start["velocities"]]
        if dither := self.record.get("dither"):
            lines["dither_times"] = dither["times"]
            lines["dither"] = [[name, dither[name]] for name in vehicle.actuators if name in dither]
        return toml_lines(lines)

    def filter_lines(self) -> str:
        """Lines of a request of the navigation filter that flew; empty without one."""
        filter_record = self.record.get("filter")
        if filter_record is None:
            return ""
        from seatrial.flight.disturbances import sea_rows

        lines = {"navigation": filter_record["numbers"], "navigation_period": filter_record["period_s"]}
        if self.filter_model is not None:
            lines["navigation_model"] = self.filter_model
        if filter_record["own"]:  # it goes by waves of its own, whatever the reader changes
            lines["navigation_waves"] = filter_record["waves"] or sea_rows([None])[0].tolist()
        return toml_lines(lines)

    @property
    def verdict(self) -> dict[str, Any]:
        """How the run ended, in its own words, and its metrics by figures of the core; None: not finite."""
        metrics = self.run.results.get("metrics") or {}
        figures = {name: metrics.get(in_metric_units(name)[0]) for name, _ in FIGURE_ROWS}
        return {"ending": self.run.report.outcome, "metrics": figures}


def judgement(mission: Mission) -> dict[str, Any]:
    """How a flight of a mission is judged, as data: ranges of figures that make it fail, and limits."""
    limits = mission.limits
    ranges = broken_in(mission.promised_m, limits)
    shown = {
        "clearance": (mission.promised_m, "at least"),
        "depth_largest": (limits["max_depth_m"], "at most"),
        "altitude_smallest": (limits["min_altitude_m"], "at least"),
    }
    return {
        "broken": [
            [
                UNKEPT[kind],
                [
                    [_FIGURE[name], _end(low), _end(high)]
                    for name, low, high in rows
                    if not np.isposinf(np.asarray(low, float))
                ],
            ]
            for kind, rows in ranges.items()
        ],
        "limits": {
            name: f"{side} {limit:g}"
            for name, (limit, side) in shown.items()
            if math.isfinite(limit) and limit > 0.0
        },
    }


_FIGURE = {
    in_metric_units(name)[0]: name
    for name in ("clearance", "clearance_reserve", "altitude_smallest", "depth_largest")
}
"""Figures of the core by the name of the metric; metres both."""


def _end(value: Any) -> float | None:
    """End of a range, which JSON can hold: None for an infinite one."""
    return float(value) if math.isfinite(value) else None


def _flown_in(record: Mapping[str, Any]) -> tuple[Water, Conditions, int]:
    """Water, conditions and seed of a run from its record."""
    from seatrial._core import State
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.disturbances import Fault, Outage, SeaState
    from seatrial.sensors.sensor import Sensor

    sensors, start = record["sensors"], record["start"]
    record["filter"]  # a record without this key is of another version
    water = Water(
        current=record["current_m_s"],
        turbulence=record["turbulence_m_s"],
        turbulence_times_s=tuple(record["turbulence_times_s"]),
        current_trend=record["current_trend_m_s_per_h"],
        current_walk=record["current_walk_m_s_after_1_h"],
        waves=None if record["waves"] is None else SeaState(**record["waves"]),
        obstacles=[tuple(row) for row in record["obstacles_m"]],
        seabed=record["seabed"],
        rho=record["rho_kg_m3"],
        g=record["g_m_s2"],
    )
    conditions = Conditions(
        sensors=None
        if sensors == "perfect"
        else {kind: Sensor(**stated) for kind, stated in sensors.items()},
        faults=[Fault(**fault) for fault in record["faults"]],
        outages=[
            Outage(**{name: value for name, value in outage.items() if value is not None})
            for outage in record["outages"]
        ],
        voltage_v=record["voltage_v"],
        feedback=record["feedback"],
        max_step_s=record["max_step_s"],
        max_time_s=record["max_time_s"],
        initial=None
        if start is None
        else State(start["position_m"], start["attitude"], np.asarray(start["velocities"])),
        dither=record["dither"],
    )
    return water, conditions, int(record["seed"])


def toml_lines(values: Mapping[str, Any]) -> str:
    """Lines of a request in TOML: numbers with every digit, tables without what is None."""
    return "".join(f"{key} = {_toml(value)}\n" for key, value in values.items())


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, list | tuple | np.ndarray):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, Mapping):
        given = (f"{key} = {_toml(item)}" for key, item in value.items() if item is not None)
        return f"{{ {', '.join(given)} }}"
    return repr(float(value))
