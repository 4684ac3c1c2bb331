"""The flight of a run as its record states it: every input, so that a page flies it again, and its verdict.

Held by ``tests/report/test_page_same_flight.py``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.flight.excesses import broken_in
from seatrial.flight.metrics import in_metric_units
from seatrial.report.page.run_folder import RunFolder
from seatrial.report.results.flight_findings import UNKEPT

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.flight.mission import Mission

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
    """A run of kind "flight".

    Attributes
    ----------
    run
        Its folder.
    vehicle, model, filter_model
        Files of the vehicle that flew, of the one that the autopilot believed in and of the filter's; None
        where they are the same.
    water, conditions, seed
        All other inputs.
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
        from seatrial.flight.sea import sea_rows

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
    from seatrial.flight.failures import Fault, Outage
    from seatrial.flight.sea import SeaState
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
