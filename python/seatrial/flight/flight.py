"""`Flight`: one closed-loop flight, what was desired, done and achieved at every control period.

Arrays are SI and rad, a row per control period; figures carry units in their names.

Held by ``tests/flight/test_flight.py``.

From the columns of the core's log to the fields of a `Flight`.

Held by ``tests/flight/test_flight.py``.

A flight as a table with the canonical columns of a trial, so that it reads back as one.

True motion under the trial's names, what the autopilot was told as ``measured.…``, what guidance wanted as
``desired.…``, the errors as ``error.…``; other columns are of no trial and are passed over when it is read.

Held by ``test_a_flight_reads_back_as_a_trial_of_its_vehicle`` in ``tests/flight/test_flight.py``.

What a flight leaves in its run directory: inputs and their hashes, versions, results, log, figures.

Held by ``tests/cli/test_cli_fly.py``.

A flight in words, and as plain data.
"""

from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial import _core
from seatrial._core import autopilot_names
from seatrial.base.arrays import Array, Mask
from seatrial.base.atomic_write import parquet
from seatrial.base.rotation import from_euler, matrix
from seatrial.base.run import RUN_FILE, RunDirectory, to_json
from seatrial.flight.metrics import (
    CODED,
    DIVERGED,
    ActuatorUse,
    Leg,
    Loop,
    actuators_of,
    ending_of,
    figures_of,
    legs_of,
    loops_of,
)
from seatrial.flight.mission import Route

if TYPE_CHECKING:
    import polars as pl

    from seatrial._core import Autopilot, Flights, Vehicle
    from seatrial.flight.cases import Cases, Circumstances
    from seatrial.flight.mission import Mission

__all__ = ["Alert", "Flight", "facts", "log_fields", "plain", "sentences", "table"]

_AXES = "XYZKMN"

_DESIRED = ("speed", "lateral", "heading", "pitch", "depth")


def log_fields(flights: Flights, vehicle: Vehicle, autopilot: Autopilot, case: int) -> dict[str, Any]:
    """Fields of a flight by name, from the log of a case; SI and rad."""
    columns = dict(zip(flights.columns, np.asarray(flights.log(case)).T, strict=True))
    modes = autopilot.modes

    def several(*names: str) -> Array:
        return np.stack([columns[name] for name in names], axis=1)

    def whole(name: str) -> NDArray[np.int64]:
        return np.asarray(np.nan_to_num(columns[name]).astype(np.int64))

    desired = {name: columns[f"desired_{name}"] for name in _DESIRED}
    mode = np.clip(whole("mode"), 0, len(modes) - 1)
    by_pitch = np.array([one["depth_by"] == "pitch" for one in modes])[mode]
    return {
        "position": several("x", "y", "z"),
        "euler": several("roll", "pitch", "yaw"),
        "nu": several("u", "v", "w", "p", "q", "r"),
        "altitude": columns["altitude"],
        "water": several("u_water", "v_water", "w_water"),
        "measured": {name: columns[f"measured_{name}"] for name in autopilot_names()["channels"]},
        "desired": desired,
        "errors": _errors(columns, desired, by_pitch),
        "distance": columns["distance"],
        "leg": whole("leg"),
        "holding": columns["holding"] > 0.5,
        "done": columns["done"] > 0.5,
        "mode": mode,
        "modes": tuple(str(one["name"]) for one in modes),
        "alert": whole("alert"),
        "cause": whole("cause"),
        "commands": {name: columns[f"cmd.{name}"] for name in vehicle.actuators},
        "actuators": {name: columns[f"act.{name}"] for name in vehicle.actuators},
        "demanded": several(*(f"demanded_{axis}" for axis in _AXES)),
        "achieved": several(*(f"achieved_{axis}" for axis in _AXES)),
        "power": columns["power"],
        "battery": columns["battery"],
    }


def _errors(
    columns: Mapping[str, Array], desired: Mapping[str, Array], by_pitch: NDArray[np.bool_]
) -> dict[str, Array]:
    """Errors of guidance as it saw them, and of the loops, desired less true."""
    pitch = np.where(by_pitch, desired["pitch"], 0.0)
    return {
        "cross_track": columns["cross_track"],
        "vertical": columns["vertical_error"],
        "surge": desired["speed"] - columns["u"],
        "sway": desired["lateral"] - columns["v"],
        "heave": desired["depth"] - columns["z"],
        "roll": -columns["roll"],
        "pitch": pitch - columns["pitch"],
        "heading": (desired["heading"] - columns["yaw"] + np.pi) % (2.0 * np.pi) - np.pi,
    }


Numbers = NDArray[np.int64]

_ABORT = 3


@dataclass(frozen=True)
class Alert:
    """A reaction of the autopilot's safety: when, what it did, why."""

    t_s: float
    reaction: str
    cause: str


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight of a vehicle with its autopilot on a mission.

    Attributes
    ----------
    vehicle, autopilot, mission, route
        What flew, and the mission's waypoints.
    circumstances
        Current, sensors, faults, outages, seed: what the flight was exposed to.
    period_s, t
        Control period; times (n,), s.
    position, euler, nu
        True motion: NED in m, roll pitch yaw in rad, m/s and rad/s; (n, 3), (n, 3), (n, 6).
    altitude, water
        Above the bottom, (n,), m (infinite without one); velocity through the water, (n, 3), m/s.
    measured
        What the autopilot was told, by channel, (n,).
    desired
        By guidance: speed, lateral, heading, pitch, depth, (n,).
    errors
        cross_track, vertical (as guidance saw them, m), and per loop desired less true, (n,).
    distance, leg, holding, done
        To the active waypoint, m; its index; whether station was kept; whether all was done; (n,).
    mode, modes
        Index of the mode, (n,), and the names.
    alert, cause
        Level of the reaction and number of the watch that called for it, (n,); `alerts` in words.
    commands, actuators
        Asked for, and done by the actuators, {name: (n,)} in the unit of the command.
    demanded, achieved
        Wrench of the loops, and what the allocation reached of it, (n, 6), N and N m.
    power, battery
        Electrical power, W, and share of the charge that is left, (n,).
    ending
        "complete", "surfaced", "aborted", "out of time" or "diverged".
    figures
        Figures of the whole flight, units in the names.
    """

    vehicle: Vehicle
    autopilot: Autopilot
    mission: Mission
    route: Route
    circumstances: Circumstances
    period_s: float
    t: Array
    position: Array
    euler: Array
    nu: Array
    altitude: Array
    water: Array
    measured: Mapping[str, Array]
    desired: Mapping[str, Array]
    errors: Mapping[str, Array]
    distance: Array
    leg: Numbers
    holding: Mask
    done: Mask
    mode: Numbers
    modes: tuple[str, ...]
    alert: Numbers
    cause: Numbers
    commands: Mapping[str, Array]
    actuators: Mapping[str, Array]
    demanded: Array
    achieved: Array
    power: Array
    battery: Array
    ending: str
    figures: Mapping[str, float]

    @classmethod
    def of_case(cls, flights: Flights, cases: Cases, *, case: int = 0) -> Flight:
        """Flight of a case of a batch that kept its log.

        Parameters
        ----------
        flights : Flights
        cases : Cases
            What was flown; their circumstances are those of the case.
        case : int, optional
        """
        figures = figures_of(flights)
        return cls(
            vehicle=cases.vehicle,
            autopilot=cases.autopilot,
            mission=cases.mission,
            route=cases.route,
            circumstances=cases.circumstances,
            period_s=cases.autopilot.period_s,
            t=np.asarray(flights.t(case)),
            ending=ending_of(figures, case),
            figures={name: float(values[case]) for name, values in figures.items() if name not in CODED},
            **log_fields(flights, cases.vehicle, cases.autopilot, case),
        )

    @property
    def diverged(self) -> bool:
        """Whether the motion ended in numbers that are none."""
        return self.ending == DIVERGED

    @property
    def complete(self) -> bool:
        """Whether the mission was flown to its end and every waypoint reached."""
        return self.ending == "complete" and all(leg.reached for leg in self.legs)

    @property
    def verdict(self) -> str:
        """How it ended, in words that do not call a mission complete whose waypoints were missed."""
        missed = self.ending == "complete" and not self.complete
        return "flown to its end, waypoints missed" if missed else self.ending

    @property
    def under_way(self) -> Mask:
        """Rows on the mission: not complete yet and without any reaction, (n,)."""
        return np.asarray((self.alert == 0) & ~self.done & np.isfinite(self.position).all(axis=1))

    @cached_property
    def active(self) -> Mask:
        """Loops at work, (n, 6), in the order surge, sway, heave, roll, pitch, heading."""
        table = np.array([one["loops"] for one in self.autopilot.modes]) > 0.5
        live = (self.alert < _ABORT) & np.isfinite(self.nu).all(axis=1)
        return np.asarray(table[self.mode] & live[:, None])

    @cached_property
    def energy_wh(self) -> Array:
        """Electrical energy used up to each row, (n,), Wh."""
        used = np.cumsum(self.power[:-1]) * self.period_s / 3600.0
        return np.concatenate([[0.0], used])

    @property
    def loiter_radius(self) -> float:
        """Radius of the circle that is flown where station cannot be kept, m; 0 for a vehicle that can."""
        can_stop = self.autopilot.modes[0]["depth_by"] == "heave"
        return 0.0 if can_stop else float(self.autopilot.gains().get("guidance.loiter_radius_m", 0.0))

    @cached_property
    def alerts(self) -> tuple[Alert, ...]:
        """Reactions in the order in which they were called for."""
        names = autopilot_names()
        rows = np.flatnonzero(np.diff(self.alert, prepend=0) > 0)
        return tuple(
            Alert(
                float(self.t[row]), names["reactions"][self.alert[row]], names["watches"][self.cause[row] - 1]
            )
            for row in rows
        )

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """What became of every leg, one per waypoint."""
        return legs_of(self)

    @cached_property
    def loops(self) -> dict[str, Loop]:
        """How the control loops did that were at work, by name."""
        return loops_of(self)

    @cached_property
    def actuator_use(self) -> dict[str, ActuatorUse]:
        """What was asked of every actuator, by name."""
        return actuators_of(self)

    def sentences(self) -> list[str]:
        """What happened, in sentences for a reader of a report."""
        return sentences(self)

    def to_dict(self) -> dict[str, Any]:
        """Figures, legs, loops, actuators, reactions and circumstances as plain data, without the log."""
        return plain(self)

    def table(self) -> pl.DataFrame:
        """Log with the canonical columns of a trial, and beside them what was measured and desired."""
        return table(self)

    def save(self, folder: str | Path, *, beside: Mapping[str, bytes] | None = None) -> Path:
        """Path of a run directory with the flight: JSON, Parquet, summary and inputs.

        `seatrial.report.plot.flight_errors.flight_gallery` draws its figures.

        Parameters
        ----------
        folder : str or Path
            Made when it does not exist; an earlier run's is replaced.
        beside : mapping of str to bytes, optional
            Further files by name.

        Raises
        ------
        SeatrialError
            The directory cannot be written; nothing is left half-written.
        """
        files: dict[str, str | bytes] = {
            RUN_FILE: to_json(facts(self)),
            **{f"{name}.toml": text for name, text in _inputs(self).items()},
            "flight.json": to_json(self.to_dict()),
            "summary.txt": "\n".join(self.sentences()) + "\n",
            "flight.parquet": parquet(self.table()),
            **(beside or {}),
        }
        directory = RunDirectory(folder)
        try:
            return directory.publish(files)
        except BaseException:  # Ctrl-C too: nothing here is worth resuming
            directory.discard()
            raise

    def __str__(self) -> str:
        return "\n".join(self.sentences())


_DEG = 180.0 / math.pi

_UNIT = {"x": "m", "y": "m", "z": "m", "altitude": "m"}

_UNIT |= dict.fromkeys(("roll", "pitch", "yaw"), "deg") | dict.fromkeys(("p", "q", "r"), "deg_s")

_UNIT |= dict.fromkeys(("u", "v", "w", "u_water", "v_water", "w_water"), "m_s")

_DESIRED_COLUMNS = {"speed": "m_s", "lateral": "m_s", "heading": "deg", "pitch": "deg", "depth": "m"}

_ERRORS = {"cross_track": "m", "vertical": "m", "surge": "m_s", "sway": "m_s", "heave": "m"}

_ERRORS |= dict.fromkeys(("roll", "pitch", "heading"), "deg")

_FORCES = ("X_n", "Y_n", "Z_n", "K_nm", "M_nm", "N_nm")


def table(flight: Flight) -> pl.DataFrame:
    """Log of a flight, a row per control period."""
    import polars as pl

    rows = len(flight.t)
    columns: dict[str, Any] = {"t_s": np.round(flight.t, 9)}
    true = np.column_stack([flight.position, flight.euler, flight.nu, flight.water])
    for name, values in zip(_TRUE, true.T, strict=True):
        columns[f"{name}_{_UNIT[name]}"] = _given(values, _UNIT[name])
    columns |= {f"cmd.{name}": values for name, values in flight.commands.items()}
    columns |= {f"meas.{name}": values for name, values in flight.actuators.items()}
    around = flight.circumstances
    for axis, values in zip(("north", "east", "down"), _current(flight).T, strict=True):
        columns[f"current_{axis}_m_s"] = values
    if around.voltage is not None:
        columns["voltage_v"] = np.full(rows, around.voltage)
    if np.isfinite(flight.altitude).all():
        columns["altitude_m"] = flight.altitude
    for name, values in flight.measured.items():
        columns[f"measured.{name}_{_UNIT[name]}"] = _given(values, _UNIT[name])
    for name, unit in _DESIRED_COLUMNS.items():
        columns[f"desired.{name}_{unit}"] = _given(flight.desired[name], unit)
    for name, unit in _ERRORS.items():
        columns[f"error.{name}_{unit}"] = _given(flight.errors[name], unit)
    for k, name in enumerate(_FORCES):
        columns[f"demanded.{name}"] = flight.demanded[:, k]
        columns[f"achieved.{name}"] = flight.achieved[:, k]
    columns |= {"leg": flight.leg, "mode": [flight.modes[k] for k in flight.mode], "reaction": flight.alert}
    columns |= {"distance_m": flight.distance, "power_w": flight.power, "energy_wh": flight.energy_wh}
    return pl.DataFrame(columns | {"battery": flight.battery})


_TRUE = (
    *("x", "y", "z", "roll", "pitch", "yaw"),
    *("u", "v", "w", "p", "q", "r", "u_water", "v_water", "w_water"),
)


def _given(values: Array, unit: str) -> Array:
    """Values in the unit of their column."""
    return values * _DEG if unit.startswith("deg") else values


def _current(flight: Flight) -> Array:
    """Velocity of the water (n, 3), north, east, down, m/s: of a turbulent one, as met."""
    around = flight.circumstances
    if not any(around.turbulence):
        return np.tile(np.asarray(around.current, dtype=float), (len(flight.t), 1))
    turned = matrix(from_euler(flight.euler))
    return np.asarray(np.einsum("nij,nj->ni", turned, flight.nu[:, :3] - flight.water))


_DIGEST = "sha256"


def facts(flight: Flight) -> dict[str, Any]:
    """What a flight rests on: versions, machine, seed, hashes of the inputs."""
    return {
        "kind": "flight",
        "name": flight.route.name,
        "versions": {name: metadata.version(name) for name in ("seatrial", "numpy", "polars")}
        | {"python": platform.python_version()},
        "machine": platform.machine(),
        "simd": _core.simd_level(),
        "seed": flight.circumstances.seed,
        _DIGEST: {name: hashlib.sha256(text.encode()).hexdigest() for name, text in _inputs(flight).items()},
        "circumstances": flight.circumstances.to_dict(),
    }


def _inputs(flight: Flight) -> dict[str, str]:
    """Files of the inputs by name, as they were used."""
    found = {
        "vehicle": flight.vehicle.to_toml(),
        "autopilot": flight.autopilot.to_toml(),
        "mission": flight.mission.to_toml(),
    }
    model = flight.circumstances.model.to_toml()
    return found if model == found["vehicle"] else found | {"model": model}


_CAUSES = {
    "depth": "the mission's largest depth was passed",
    "altitude": "the bottom came nearer than the mission's smallest altitude",
    "fence": "the vehicle was outside the mission's fence",
    "time": "the mission took longer than its limit",
    "battery": "the battery was low",
    "actuator": "an actuator did not follow its command",
    "progress": "the next waypoint came no nearer for too long",
}

_SWITCHES_PER_MINUTE = 6.0  # more than this looks like a limit cycle around the minimum

_LEAST_S = 20.0  # of a flight from which starts per minute can be told

_SATURATED = 0.05

_OFF_M = 0.05


def sentences(flight: Flight) -> list[str]:
    """What happened on a flight, the most important first."""
    found = [_ending(flight), *_reactions(flight)]
    if flight.diverged:
        return found
    figures = flight.figures
    legs = [leg for leg in flight.legs if not math.isnan(leg.begin_s)]
    found.append(
        f"It went {figures['distance_m']:.0f} m over ground in {_time(figures['duration_s'])}"
        + (
            f" and used {figures['energy_wh']:.1f} Wh."
            if figures["energy_wh"] > 0.0
            else "; the vehicle file tells neither power_w_s3 nor [power], so that its energy is not known."
        )
    )
    straight = [leg for leg in legs if not math.isnan(leg.cross_track_largest_m)]
    if straight:
        worst = max(straight, key=lambda leg: leg.cross_track_largest_m)
        found.append(
            "On the second half of straight legs the cross-track error was"
            f" {figures['cross_track_rms_m']:.2f} m rms and at most {worst.cross_track_largest_m:.2f} m"
            f" ({worst.label}), the vertical error {figures['vertical_rms_m']:.2f} m rms and at most"
            f" {max(leg.vertical_largest_m for leg in straight):.2f} m."
        )
    found += _speeds(flight)
    found += _depth(legs)
    found += _stations(legs)
    found += _loops(flight)
    found += _actuators(flight)
    found += _sensors(flight)
    return found


def plain(flight: Flight) -> dict[str, Any]:
    """A flight as plain data, without its log."""
    return {
        "vehicle": flight.vehicle.name,
        "autopilot": flight.autopilot.name,
        "mission": flight.route.name,
        "ending": flight.ending,
        "complete": flight.complete,
        "figures": dict(flight.figures),
        "legs": [leg.to_dict() for leg in flight.legs],
        "loops": {name: loop.to_dict() for name, loop in flight.loops.items()},
        "actuators": {name: use.to_dict() for name, use in flight.actuator_use.items()},
        "alerts": [{"t_s": a.t_s, "reaction": a.reaction, "cause": a.cause} for a in flight.alerts],
        "circumstances": flight.circumstances.to_dict(),
        "sentences": flight.sentences(),
    }


def _ending(flight: Flight) -> str:
    who = f"{flight.vehicle.name} on {flight.route.name}"
    behind = sum(leg.reached for leg in flight.legs)
    count = f"{behind} of {len(flight.legs)} waypoints reached"
    missed = [leg for leg in flight.legs if not leg.reached and not math.isnan(leg.begin_s)]
    by = "".join(f"; {leg.label} missed by {leg.smallest_m - leg.acceptance_m:.2f} m" for leg in missed[:3])
    what = {
        "complete": "complete" if flight.complete else "flown to its end",
        "surfaced": "the vehicle surfaced before the end",
        "aborted": "aborted",
        "out of time": f"not complete after {_time(float(flight.t[-1]))}, the longest time allowed",
        "diverged": "the motion diverged; check gains, vehicle and the largest step",
    }[flight.ending]
    return f"{who}: {what}, {count}{by if flight.ending == 'complete' else ''}."


def _reactions(flight: Flight) -> list[str]:
    said = [fault.sentence() for fault in flight.circumstances.faults]
    said += [outage.sentence() for outage in flight.circumstances.outages]
    found = [f"Failures: {'; '.join(said)}."] if said else []
    for alert in flight.alerts:
        why = _CAUSES.get(alert.cause, f"no good sample of {alert.cause.removeprefix('stale_')} for too long")
        found.append(f"Reaction at {alert.t_s:.1f} s: {alert.reaction}, because {why}.")
    if said and not flight.alerts:
        found.append("No reaction of the safety was called for.")
    return found


def _speeds(flight: Flight) -> list[str]:
    """Legs that ask for more than guidance gives."""
    asked = max(stop.speed for stop in flight.route.stops)
    most = flight.autopilot.gains()["guidance.speed_max_m_s"]
    if asked <= most:
        return []
    return [f"Legs ask for up to {asked:g} m/s, and guidance keeps to speed_max_m_s = {most:g} m/s."]


def _depth(legs: Sequence[Leg]) -> list[str]:
    changed = [leg for leg in legs if not math.isnan(leg.depth_overshoot_m)]
    if not changed:
        return []
    worst = max(changed, key=lambda leg: leg.depth_overshoot_percent)
    return [
        f"The depth went at most {worst.depth_overshoot_m:.2f} m beyond a change of"
        f" {abs(worst.depth_step_m):.1f} m ({worst.depth_overshoot_percent:.1f} %, {worst.label})."
    ]


def _stations(legs: Sequence[Leg]) -> list[str]:
    held = [leg for leg in legs if not math.isnan(leg.hold_largest_m)]
    if not held:
        return []
    worst = max(held, key=lambda leg: leg.hold_largest_m)
    return [
        f"Station was kept within {worst.hold_largest_m:.2f} m ({worst.label}, {worst.hold_rms_m:.2f} m rms)."
    ]


def _loops(flight: Flight) -> list[str]:
    found = []
    for loop in flight.loops.values():
        if loop.saturated > _SATURATED:
            found.append(
                f"The {loop.name} loop was saturated for {100.0 * loop.saturated:.0f} % of its time; its"
                f" largest demand was {loop.demand_largest:.3g} {loop.demand_unit}."
            )
    return found


def _actuators(flight: Flight) -> list[str]:
    busiest = max(flight.actuator_use.values(), key=lambda use: use.switches_per_minute, default=None)
    if busiest is None or float(flight.t[-1]) < _LEAST_S:
        return []
    if busiest.switches_per_minute == 0.0:
        return []
    rate = f"{busiest.switches_per_minute:.1f} starts and stops a minute"
    if busiest.switches_per_minute > _SWITCHES_PER_MINUTE:
        return [f"{busiest.name} made {rate}: a limit cycle around its smallest command, or noise in a loop."]
    return [f"No actuator made more than {rate}."]


def _sensors(flight: Flight) -> list[str]:
    told = np.stack([flight.measured[name] for name in ("x", "y", "z")], axis=1)
    off = np.hypot(np.hypot(*(told - flight.position).T[:2]), told[:, 2] - flight.position[:, 2])
    off = off[np.isfinite(off)]
    found = []
    if len(off) and np.max(off) > _OFF_M:
        found.append(
            f"The position that the autopilot was told was up to {np.max(off):.1f} m from the true one;"
            " errors of guidance are those that it saw."
        )
    return [*found, *flight.circumstances.sensor_notes]


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
