"""What a page needs to fly: vehicles, autopilots, missions and circumstances, as the core takes them.

The page's core (``crates/seatrial-wasm``) reads requests in TOML. What a reader cannot change stands here as
lines of such a request (`Setup.fixed`); what he can change is data. Numbers go through as they are, so that
the page flies what `seatrial.fly` flies.

An open loop's response is linear in its own gains: what the feed-forward leaves and one part per K_P, K_I and
K_D, which a page adds up with the factors of its sliders, exactly. Held by
``tests/report/test_page_in_browser.py`` and ``tests/report/test_page_loops.py``.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files as resources
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.errors import SeatrialError
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.control_design.tuning_table import Weights
from seatrial.flight.metrics import in_metric_units
from seatrial.report.page.evidence import FIGURE_ROWS, FlownRun, judgement, packed, toml_lines
from seatrial.report.page.run_folder import RunFolder
from seatrial.report.results.tuning import gain_unit

if TYPE_CHECKING:
    from seatrial._core import Autopilot, Vehicle
    from seatrial.control_design.tuning_table import CorridorTable, LoopTable
    from seatrial.flight.cases import Cases
    from seatrial.flight.mission import Mission

_CORE = "core.wasm.gz"

_SAMPLES = ("cage_survey", "lawnmower", "hover")
"""Missions of the examples that a page offers beside those of its runs."""


@dataclass(frozen=True)
class FlyingSettings:
    """What a reader of the page may change, and how responses are packed for it."""

    without_interval: float = 0.2  #: Share by which a coefficient may change where no interval is known.
    corridor_points: int = 401  #: Of the bounds of a response: more than a panel has pixels.
    nothing: float = 1e-9  #: A part of a loop that never exceeds this share of its size is left out.
    least: float = 1e-12  #: Size at which a response counts as zero, where its logarithm would be none.


SETTINGS = FlyingSettings()

_MAIN = (
    *(f"{force}_{motion}" for force, motion in zip("XYZKMN", "uvwpqr", strict=True)),
    *(f"{force}_{motion}{motion}" for force, motion in zip("XYZKMN", "uvwpqr", strict=True)),
)

_STEPS: tuple[tuple[str, str, str, float, float], ...] = (
    ("heading", "yaw", "deg", math.radians(30.0), math.pi / 180.0),
    ("speed", "u", "m/s", 0.3, 1.0),
    ("depth", "z", "m", 2.0, 1.0),
    ("pitch", "pitch", "deg", math.radians(8.0), math.pi / 180.0),
)
"""Set point, channel of the log, unit, step in SI and rad, and what the unit is in them."""

_TABLES_OF_STEP = {
    "heading": ("heading",),
    "speed": ("surge",),
    "depth": ("depth", "heave"),
    "pitch": ("pitch",),
}
"""Loops of a campaign whose steps these are."""

_LOOPS_OF_STEP = {
    "heading": ("heading",),
    "speed": ("surge",),
    "depth": ("heave", "pitch"),
    "pitch": ("pitch",),
}


def core() -> str:
    """The core as WebAssembly, compressed with gzip, in base64; empty where seatrial was built without it."""
    place = resources("seatrial.report.page").joinpath(_CORE)
    return base64.b64encode(place.read_bytes()).decode() if place.is_file() else ""


def setups(runs: Sequence[RunFolder]) -> tuple[list[dict[str, Any]], list[str]]:
    """What can fly, one entry per vehicle of the runs, and a sentence for each vehicle that cannot."""
    vehicles: dict[str, tuple[Vehicle, list[RunFolder]]] = {}
    from seatrial._core import Vehicle

    flown = FlownRun.of(runs)
    for run in runs:
        if (text := run.files.get("vehicle.toml")) is None:
            continue
        try:
            vehicle = Vehicle.from_toml(text)
        except SeatrialError:
            continue
        known, of = vehicles.get(vehicle.name, (vehicle, []))
        # The covariance is about the identified vehicle, so that one flies.
        vehicles[vehicle.name] = (vehicle if run.kind == "identification" else known, [*of, run])
    made, reasons = [], []
    if flown is not None:  # and what a run flew, it flies itself
        try:
            vehicle = Vehicle.from_toml(flown.vehicle, f"vehicle.toml of {flown.run.name}")
            vehicles[vehicle.name] = (vehicle, vehicles.get(vehicle.name, (vehicle, [flown.run]))[1])
        except SeatrialError as error:  # of another version; the page still tells the rest
            reasons.append(f"{flown.run.name} cannot fly in this page: {error}")
            flown = None
    for name, (vehicle, of) in vehicles.items():
        try:
            made.append(_setup(vehicle, of, flown if flown is not None and flown.run in of else None))
        except SeatrialError as error:
            reasons.append(f"{name} cannot fly in this page: {error}")
    return made, reasons


def _setup(vehicle: Vehicle, runs: Sequence[RunFolder], flown: FlownRun | None) -> dict[str, Any]:
    from seatrial._core import Vehicle as CoreVehicle
    from seatrial._core import autopilot_names
    from seatrial.flight.cases import Cases
    from seatrial.flight.conditions import Conditions, Water
    from seatrial.vehicle.actuators import NOMINAL_V

    # What the run flew stands first, so that the page begins with its flight.
    ordered = runs if flown is None else [*(run for run in runs if run is not flown.run), flown.run]
    autopilots, missions = _autopilots(vehicle, ordered), _missions(ordered)
    pilot = autopilots[0][1]
    water = Water() if flown is None else flown.water
    conditions = Conditions() if flown is None else flown.conditions
    if flown is not None and flown.model is not None:
        conditions = replace(conditions, model=CoreVehicle.from_toml(flown.model))
    if conditions.voltage_v is None and any(
        facts["needs_voltage"] for facts in vehicle.actuator_info().values()
    ):
        conditions = replace(conditions, voltage_v=NOMINAL_V)
    cases = Cases.of(
        vehicle,
        pilot,
        missions[0][1],
        water=water,
        conditions=conditions,
        seeds=0 if flown is None else flown.seed,
    )
    circumstances = cases.circumstances
    return {
        "vehicle": vehicle.name,
        "vehicle_file": vehicle.to_toml(),
        "autopilots": [_autopilot(label, autopilot) for label, autopilot in autopilots],
        "missions": [
            _mission(label, mission, cases, flown if place == 0 else None)
            for place, (label, mission) in enumerate(missions)
        ],
        "actuators": [
            [name, facts["unit"], float(facts["neutral"])] for name, facts in vehicle.actuator_info().items()
        ],
        "shape": _shape(vehicle),
        "sensors": _sensors(cases, conditions.sensors, flown),
        "navigation": flown is not None and flown.record["navigation"] == "filter",
        "groups": autopilot_names()["groups"],
        "endings": autopilot_names()["endings"],
        "rows": [[name, label, in_metric_units(name)[1]] for name, label in FIGURE_ROWS],
        "run": None if flown is None else flown.verdict,
        "bottom": None if circumstances.seabed is None else list(circumstances.seabed),
        "fixed": request_lines(cases),
        "nominal": vehicle.coefficients(),
        "current": list(circumstances.current),
        "waves": list(cases.waves[0]),
        "seed": circumstances.seed,
        "faults": [
            [name, at, "stuck" if math.isnan(value) else value] for _, name, at, value in cases.faults
        ],
        "outages": [
            [group, *(at if math.isfinite(at) else None for at in ends)] for group, *ends in cases.outages
        ],
        "coefficients": _coefficients(vehicle, runs),
        "covariance": _covariance(runs),
        "steps": _steps(pilot, runs),
        "loops": [open_loops(vehicle, autopilot) for _, autopilot in autopilots],
        "note": _note(runs, flown, circumstances.voltage_v),
    }


def request_lines(cases: Cases) -> str:
    """Lines of a request that hold for every flight of a page: water that it cannot change, supply, steps."""
    around = cases.circumstances
    lines: dict[str, Any] = {
        "turbulence": cases.turbulence.tolist(),
        "turbulence_times": list(around.turbulence_times_s),
        "current_trend": (cases.current_trend / 3600.0).tolist(),
        "current_walk": (cases.current_walk / math.sqrt(3600.0)).tolist(),
        "obstacles": [list(obstacle) for obstacle in around.obstacles],
        "voltage": math.nan if around.voltage_v is None else around.voltage_v,
        "feedback": around.feedback,
        "max_step": around.max_step_s,
    }
    other = around.model.to_toml()
    model = None if other == cases.vehicle.to_toml() else other
    optional = {"model": model, "seabed": around.seabed, "rho": around.rho, "g": around.g}
    lines |= {key: value for key, value in optional.items() if value is not None}
    return toml_lines(lines)


def _shape(vehicle: Vehicle) -> dict[str, Any]:
    """Hull and placed actuators, for a picture in space; body axes, m."""
    size, values = vehicle.geometry(), vehicle.coefficients()
    placed = [
        {
            "name": name,
            "place": list(facts["position"]),
            "force": list(facts["direction"]),
            "chord": list(facts["chord"]) if facts["kind"] == "fin" else None,
            "side": math.sqrt(float(facts["area"] or 0.0)) if facts["kind"] == "fin" else 0.0,
        }
        for name, facts in vehicle.actuator_info().items()
        if facts["position"] is not None
    ]
    return {
        "size": [float(size.get(key, 0.0)) for key in ("length", "diameter", "height")],
        "box": vehicle.hull_shape in ("box", "frame"),
        "actuators": placed,
        "gravity": [values.get(f"{axis}_g", 0.0) for axis in "xyz"],
        "buoyancy": [values.get(f"{axis}_b", 0.0) for axis in "xyz"],
    }


def _autopilots(vehicle: Vehicle, runs: Sequence[RunFolder]) -> list[tuple[str, Autopilot]]:
    """Autopilots that fit the vehicle, the most tuned first; each text once."""
    from seatrial._core import Autopilot
    from seatrial.control_design.start_autopilot import start_autopilot

    texts: list[tuple[str, str]] = []
    for run in reversed(runs):
        for name, word in (("autopilot.toml", ""), ("start_autopilot.toml", ", before tuning")):
            if name in run.files:
                texts.append((f"of the {run.kind}{word}", run.files[name]))
    if vehicle.name in Autopilot.names():
        texts.append(("built in", Autopilot.load(vehicle.name).to_toml()))
    if not texts:
        texts.append(("start gains, designed for this vehicle", start_autopilot(vehicle)))
    autopilots: list[tuple[str, Autopilot]] = []
    for label, text in texts:
        autopilot = Autopilot.from_toml(text)
        if autopilot.to_toml() not in [other.to_toml() for _, other in autopilots]:
            autopilots.append((f"{autopilot.name} ({label})", autopilot))
    return autopilots


def _autopilot(label: str, autopilot: Autopilot) -> dict[str, Any]:
    return {
        "label": label,
        "name": autopilot.name,
        "file": autopilot.to_toml(),
        "period_s": autopilot.period_s,
        "gains": autopilot.gains(),
        "units": {name: gain_unit(name) for name in autopilot.gains()},
    }


def _missions(runs: Sequence[RunFolder]) -> list[tuple[str, Mission]]:
    """Missions of the runs, the latest first, then those of the examples."""
    from seatrial.flight.mission import Mission

    texts = [
        (run.kind, text)
        for run in reversed(runs)
        for path, text in run.files.items()
        if path == "mission.toml" or path.startswith("missions/")
    ]
    missions: dict[str, tuple[str, Mission]] = {}
    for kind, text in texts:
        mission = Mission.from_toml(text)
        missions.setdefault(mission.core.to_toml(), (f"{mission.name} (of the {kind})", mission))
    examples = resources("seatrial").joinpath("examples", "missions")
    for name in _SAMPLES:
        place = examples.joinpath(f"{name}.toml")
        if place.is_file():
            mission = Mission.from_toml(place.read_text(encoding="utf-8"))
            missions.setdefault(mission.core.to_toml(), (f"{mission.name} (example)", mission))
    return list(missions.values())


def _mission(label: str, mission: Mission, cases: Cases, flown: FlownRun | None) -> dict[str, Any]:
    """A mission that can be flown; the one of the flown run begins and ends as that did."""
    from seatrial.flight.checks import longest
    from seatrial.flight.mission import Route

    until = longest(Route.of(mission), cases.autopilot, None, logs=True)
    if flown is not None:
        until = cases.circumstances.max_time_s
    fence = np.asarray(mission.core.fence)
    return {
        "label": label,
        "name": mission.name,
        "file": mission.core.to_toml(),
        "max_time_s": until,
        "planned_time_s": float(mission.planned_time),
        "lines": "" if flown is None else flown.own_lines(cases.vehicle),
        **judgement(mission),
        "fence": fence.tolist(),
        "obstacles": [
            {key: value for key, value in obstacle.items() if key != "leg"}
            for obstacle in mission.core.obstacles
        ],
    }


def _sensors(cases: Cases, own: Any, flown: FlownRun | None) -> list[dict[str, str]]:
    """Sets of sensors by name as lines of a request, those of the flight first, and each with its filter."""
    from seatrial.flight.navigation import filter_of
    from seatrial.flight.sensor_channels import sensor_channels, sensors_of

    vehicle, period, around = cases.vehicle, cases.autopilot.period_s, cases.circumstances
    gusts = around.turbulence, around.turbulence_times_s
    entries: list[dict[str, str]] = []
    for label, source in (("of the flight", own), ("perfect", None), ("typical", "typical")):
        if label == "of the flight" and own is None:
            continue
        fitted = sensors_of(source, vehicle)
        channels = sensor_channels(fitted, period)
        lines = toml_lines({
            "errors": channels.errors.tolist(),
            "timing": channels.timing.tolist(),
            "acoustics": [[kind, row.tolist()] for kind, row in channels.acoustics.items()],
            "transceiver": list(channels.transceiver),
        })
        entry = {"label": label, "lines": lines}
        # With other coefficients than the model's a filter does not take its model for exact.
        for key, exact in (
            ("filter", cases.vehicle.to_toml() == around.model.to_toml()),
            ("filter_varied", False),
        ):
            aboard = filter_of(
                "filter",
                around.model,
                fitted,
                period,
                landmarks=cases.mission.landmarks,
                gusts=gusts,
                exact=exact,
            )
            entry[key] = "" if aboard is None else toml_lines({"navigation": aboard.to_dict()["numbers"]})
        if flown is not None and not entries and (recorded := flown.filter_lines()):
            entry["filter"] = recorded
            if flown.record["filter"]["own"]:
                entry["filter_varied"] = recorded
        entries.append(entry)
    return entries


def _coefficients(vehicle: Vehicle, runs: Sequence[RunFolder]) -> list[dict[str, Any]]:
    """Coefficients that a reader may change, within their intervals; where none is known, within a share."""
    identified = _identification(runs)
    values, facts = vehicle.coefficients(), vehicle.coefficient_info()
    rows = []
    for coefficient in identified.get("coefficients", ()):
        name, ends = coefficient.get("name"), coefficient.get("interval") or [None]
        if name in values and all(isinstance(x, float) for x in ends):
            rows.append((name, sorted(ends), f"95 % interval, sigma {coefficient['sigma']:.3g}"))
    if not rows:
        for name in _MAIN:
            if (value := values.get(name, 0.0)) != 0.0:
                share = SETTINGS.without_interval
                ends = sorted((value * (1.0 - share), value * (1.0 + share)))
                rows.append((name, ends, f"no interval known, ±{share:.0%}"))
    return [
        {
            "name": name,
            "unit": facts[name]["unit"] if name in facts else "",
            "about": facts[name]["description"] if name in facts else "",
            "value": values[name],
            "lower": ends[0],
            "upper": ends[1],
            "source": source,
        }
        for name, ends, source in rows
    ]


def _covariance(runs: Sequence[RunFolder]) -> dict[str, Any] | None:
    """Names, values and a factor F of the covariance F F' that vehicles are drawn from; None if unknown."""
    covariance = _identification(runs).get("covariance")
    if not covariance or not covariance.get("names"):
        return None
    try:
        matrix = np.array(covariance["matrix"], float)
        size, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    except (ValueError, TypeError, np.linalg.LinAlgError):
        return None
    kept = size > 1e-12 * size.max()
    factor = vectors[:, kept] * np.sqrt(size[kept])
    digits = [[float(f"{x:.6g}") for x in row] for row in factor]
    return {
        "names": covariance["names"],
        "at": covariance["at"],
        "factor": digits,
        "notes": covariance.get("notes", []),
    }


def _identification(runs: Sequence[RunFolder]) -> Mapping[str, Any]:
    return next((run.results for run in reversed(runs) if run.kind == "identification"), {})


def _steps(autopilot: Autopilot, runs: Sequence[RunFolder]) -> list[dict[str, Any]]:
    """Steps of the loops that the autopilot has, with size and corridor of the campaign where it has them."""
    loops = {name.partition(".")[0] for name in autopilot.gains()}
    asked = _tuned_loops(runs)
    entries = []
    for name, channel, unit, step, in_si in _STEPS:
        if not loops & set(_LOOPS_OF_STEP[name]):
            continue
        table = next((asked[loop] for loop in _TABLES_OF_STEP[name] if loop in asked), None)
        size = step if table is None or not table.steps else float(table.steps[0]) * in_si
        corridor = None if table is None or table.corridor is None else _corridor(table.corridor)
        entry = {"set_point": name, "channel": channel, "unit": unit, "step": size, "one": in_si}
        entries.append(entry | {"corridor": corridor})
    return entries


def _tuned_loops(runs: Sequence[RunFolder]) -> Mapping[str, LoopTable]:
    """Loops of the campaign's table of tuning by name; none where no campaign has one."""
    from seatrial.campaign.file import parse

    for run in reversed(runs):
        if (text := run.files.get("campaign.toml")) is None:
            continue
        try:
            tuning = parse(text, run.name).tuning
        except SeatrialError:  # of another version
            continue
        if tuning is not None:
            return tuning.loops.given()
    return {}


def _corridor(table: CorridorTable) -> dict[str, list[float | None]]:
    """Bounds of a response over the time since its step, as shares of it; none where it is not bound."""
    corridor = table.corridor(Weights())
    t = np.linspace(0.0, corridor.until_s, SETTINGS.corridor_points)
    sides = [[float(x) if math.isfinite(x) else None for x in side] for side in corridor.sampled(t)]
    return {"t": t.round(6).tolist(), "lower": sides[0], "upper": sides[1]}


def _note(runs: Sequence[RunFolder], flown: FlownRun | None, voltage_v: float | None) -> str:
    """What the page assumes, and whether its flight is that of the run."""
    sentences = []
    if flown is None and any(run.kind == "flight" for run in runs):
        sentences.append(
            "The record of the flight is that of another version: the page flies in calm water with perfect"
            " sensors. Fly it again to see the run's flight here."
        )
    elif flown is None:
        sentences.append("This report has no flight: the page begins in calm water with perfect sensors.")
    if voltage_v is not None:
        sentences.append(f"The supply is {voltage_v:g} V.")
    return " ".join(sentences)


_KEYS = ("K_P", "K_I", "K_D")


def open_loops(vehicle: Vehicle, autopilot: Autopilot) -> dict[str, Any]:
    """Open loops of an autopilot at its breakpoints, or why there are none.

    ``points`` has per mode and desired speed (m/s) and per loop the parts of L by gain, ``rest`` for what
    no gain scales; ``omega`` is the first and the last of the frequencies in rad/s, even by their logarithm,
    and their count. ``said`` tells why nothing is drawn; else it is empty.
    """
    try:
        constraint = MarginConstraint(vehicle, autopilot)
        own = {name: float(value) for name, value in autopilot.gains().items()}
        tuned = dict.fromkeys(name.split(".")[0] for name in own if ".K_" in name)
        names = {loop: [name for name in own if name.startswith(f"{loop}.K_")] for loop in tuned}
        whole, margins = constraint.open_loops({}), constraint.margins({})
        # L is linear in each gain: the part of a gain is L less L without it.
        without = {
            (loop, key): constraint.open_loops({
                name: 0.0 for name in given if name.startswith(f"{loop}.{key}.")
            })
            for loop, given in names.items()
            for key in _KEYS
        }
    except (SeatrialError, np.linalg.LinAlgError) as error:
        return {"points": [], "omega": [1.0, 1.0, 0], "said": f"The margins cannot be drawn: {error}"}
    points = []
    for k, ((_, responses), point) in enumerate(zip(whole, margins, strict=True)):
        loops = []
        for i, loop in enumerate(point.loops):
            response = responses[0, i]
            parts = {key: response - without[loop, key][k][1][0, i] for key in _KEYS}
            # What feed-forward leaves is not scaled by any gain.
            parts["rest"] = response - sum(parts.values())
            least = SETTINGS.nothing * np.abs(response).max()
            loops.append({
                "loop": loop,
                "parts": {key: _polar(part) for key, part in parts.items() if np.abs(part).max() > least},
            })
        stable = float(point.growth_per_s[0]) == 0.0
        points.append({"mode": point.mode, "speed": point.speed_m_s, "stable": stable, "loops": loops})
    omega = whole[0][0]
    return {"points": points, "omega": [float(omega[0]), float(omega[-1]), len(omega)], "said": ""}


def _polar(response: NDArray[np.complex128]) -> list[dict[str, Any]]:
    """Natural logarithm of the size and angle in rad without jumps of a response."""
    size = np.log(np.maximum(np.abs(response), SETTINGS.least))
    return [packed(size), packed(np.unwrap(np.angle(response)))]
