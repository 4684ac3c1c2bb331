"""Campaigns that are wrong in many ways end in a result, or are refused before the search.

`mutated` makes one campaign per number: a short trial of a built-in vehicle, then mutations of the vehicle
(unstable, with fast poles, without actuators), of the recording (gaps, outliers, few samples, noise) and of
the campaign (bounds at absurd ends, bad start values, any method of the joint estimate).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
import pytest

from seatrial._core import State, Vehicle
from seatrial.base.channels import AXES
from seatrial.base.errors import SeatrialError
from seatrial.base.work import Progress, Work
from seatrial.campaign.campaign import Campaign

VEHICLES = ("cwolf", "remus100", "bluerov2-heavy")

COLUMNS = ("u_m_s", "v_m_s", "w_m_s", "p_deg_s", "q_deg_s", "r_deg_s")

OWN = (
    ("udot", "u", "uu"),
    ("vdot", "v", "vv"),
    ("wdot", "w", "ww"),
    ("pdot", "p", "pp"),
    ("qdot", "q", "qq"),
    ("rdot", "r", "rr"),
)
"""Suffixes of each axis's own added mass, linear and quadratic damping."""

CROSS = ("Y_uv", "Y_ur", "Z_uw", "Z_uq", "M_uw", "M_uq", "N_uv", "N_ur", "Y_r", "N_v", "Z_q", "M_w")

QUICK = (61, 70, 76, 118, 145, 150, 163)
"""Those of every run of the tests: one is refused, a stage fails in two, the noise of a filter in two."""


@dataclass(frozen=True)
class Mutated:
    """A campaign and what was done to it."""

    campaign: Campaign
    done: tuple[str, ...]


def _commands(vehicle: Vehicle, t: np.ndarray, generator: np.random.Generator) -> dict[str, np.ndarray]:
    """Stepped commands within a third of what each actuator takes."""
    found = {}
    for name, facts in vehicle.actuator_info().items():
        most = facts["maximum_ahead"]
        most = 0.3 * most if math.isfinite(most) and most > 0.0 else 0.2
        levels = generator.uniform(-1.0, 1.0, 1 + len(t) // max(int(3.0 / (t[1] - t[0])), 1))
        centre = 1500.0 if facts["unit"] == "us" else 0.0
        step = 150.0 if facts["unit"] == "us" else most
        found[name] = centre + step * np.repeat(levels, max(int(3.0 / (t[1] - t[0])), 1))[: len(t)]
    return found


def _recording(vehicle: Vehicle, seconds: float, dt: float, generator: np.random.Generator) -> dict[str, Any]:
    """A noisy log of a built-in vehicle under stepped commands."""
    t = np.arange(0.0, seconds, dt)
    commands = _commands(vehicle, t, generator)
    supplied = vehicle.name == "bluerov2-heavy"
    voltage: dict[str, Any] = {"voltage_v": np.full(len(t), 16.0)} if supplied else {}
    run = vehicle.simulate(t, commands, State(nu=[0.5, 0, 0, 0, 0, 0]), max_step_s=0.02, **voltage)
    nu = np.asarray(run.nu) + generator.normal(0.0, 1.0, (len(t), 6)) * [0.01, 0.01, 0.01, 2e-3, 2e-3, 2e-3]
    nu[:, 3:] = np.degrees(nu[:, 3:])
    table: dict[str, Any] = {"t_s": t} | voltage | dict(zip(COLUMNS, nu.T, strict=True))
    if generator.random() < 0.5:
        attitude = np.asarray(run.attitude)
        table |= {f"q_{letter}": attitude[:, k] for k, letter in enumerate("wxyz")}
    if generator.random() < 0.1:  # reading a whole pose takes seconds: it is aligned with the velocities
        table |= {f"{letter}_m": np.asarray(run.position)[:, k] for k, letter in enumerate("xyz")}
    table |= {f"cmd.{name}": signal for name, signal in commands.items()}
    tau = np.asarray(run.tau)
    table |= {f"tau.{a}_n{'' if k < 3 else 'm'}": tau[:, k] for k, a in enumerate(AXES)}
    return table


def _spoil(table: dict[str, Any], generator: np.random.Generator, done: list[str]) -> dict[str, Any]:
    """The log with gaps, outliers, silent or missing channels."""
    often = ["none"] * 6
    kind = generator.choice([*often, "gap", "holes", "outliers", "silent", "missing", "stop", "huge", "jump"])
    done.append(f"log: {kind}")
    n = len(table["t_s"])
    moved = [name for name in table if name in COLUMNS]
    name = moved[int(generator.integers(len(moved)))]
    if kind == "gap":
        first = int(generator.integers(n // 4, n // 2))
        kept = np.r_[0:first, first + n // 4 : n]
        return {key: values[kept] for key, values in table.items()}
    if kind == "holes":
        table[name] = np.where(generator.random(n) < 0.4, np.nan, table[name])
    if kind == "outliers":
        table[name] = np.where(generator.random(n) < 0.02, 1e4, table[name])
    if kind == "silent":
        table[name] = np.zeros(n)
    if kind == "missing":
        del table[name]
    if kind == "stop":
        half = n // 2
        for column in (*moved, *(key for key in table if key.startswith("cmd."))):
            table[column][half:] = table[column][half]
    if kind == "huge":
        table[name] = table[name] * 1e5
    if kind == "jump":
        table["t_s"] = table["t_s"] + np.where(np.arange(n) > n // 2, 500.0, 0.0)
    return table


def _mutated_vehicle(vehicle: Vehicle, generator: np.random.Generator, done: list[str]) -> Vehicle:
    """The vehicle that the search starts from."""
    kind = str(generator.choice(["own", "scaled", "unstable", "fast", "undamped", "gone", "neutral"]))
    own = vehicle.coefficients()
    changed: dict[str, float] = {}
    damping = [n for n in own if "." not in n and n.count("_") == 1 and n.split("_")[1] in "uvwpqr"]
    quadratic = [n for n in own if n.split("_")[-1] in ("uu", "vv", "ww", "pp", "qq", "rr") and own[n]]
    if kind == "scaled":
        changed = {n: own[n] * 10 ** generator.uniform(-2, 2) for n in (*damping, *quadratic)}
    elif kind == "unstable":
        changed = {n: abs(own[n]) * 3.0 for n in quadratic[:2]} | {"M_w": 50.0, "N_v": -80.0}
    elif kind == "fast":
        changed = {"M_q": -80.0 * own["I_y"], "N_r": -95.0 * own["I_z"], "K_p": -300.0 * own["I_x"]}
    elif kind == "undamped":
        changed = dict.fromkeys((*damping, *quadratic), 0.0)
    elif kind == "neutral":
        changed = {"z_g": -0.05}
    done.append(f"vehicle: {vehicle.name}, {kind}")
    if kind == "gone":
        document = vehicle.to_dict()
        for key in ("thrusters", "fins", "actuators", "groups", "controllable"):
            document.pop(key, None)
        import tomlkit

        return Vehicle.from_toml(tomlkit.dumps(document))
    known = vehicle.coefficient_info()
    return vehicle.with_coefficients({n: v for n, v in changed.items() if n in known})


def _bounds(name: str, value: float, generator: np.random.Generator) -> list[float]:
    """Bounds of a coefficient, some of them absurd."""
    size = max(abs(value), 1e-2)
    kind = int(generator.integers(8))
    if kind == 0:
        return [-1e9, 1e9]
    if kind == 1:
        return [-1e4 * size, -1e-9]
    if kind == 2:
        return [1e-6, 1e3 * size]
    if kind == 3:
        return [value - 1e-12 * size, value + 1e-9 * size]
    if kind == 4:
        return [value * 50.0 - 1.0, value * 50.0 + 1.0]
    return [value - 0.9 * size, value + 0.9 * size]


def _stage(
    number: int, vehicle: Vehicle, letters: str, generator: np.random.Generator, names: list[str]
) -> dict[str, Any]:
    """A stage that frees some axes and coefficients."""
    own = vehicle.coefficients()
    known = vehicle.coefficient_info()
    can: list[str] = []
    for letter in letters:
        can += [f"{letter}_{suffix}" for suffix in OWN[AXES.index(letter)]]
    can += [name for name in CROSS if name[0] in letters]
    can += ["m", "I_z", "z_b", "B"]
    can += [name for name in own if name.endswith((".gain", ".T_1"))][:2]
    can = [name for name in can if name in known]
    chosen = generator.choice(can, size=min(int(generator.integers(1, 5)), len(can)), replace=False)
    coefficients: dict[str, Any] = {}
    for name in map(str, chosen):
        entry: dict[str, Any] = {"bounds": _bounds(name, own.get(name, 0.0), generator)}
        lower, upper = entry["bounds"]
        if generator.random() < 0.2 or not lower <= own.get(name, 0.0) <= upper:
            entry["start"] = float(generator.choice([lower, upper, 0.5 * (lower + upper)]))
        coefficients[name] = entry
    others = "".join(letter for letter in AXES if letter not in letters)
    return {
        "name": f"stage{number}",
        "trials": names,
        "axes": {"free": letters, "measured": others if generator.random() < 0.5 else ""},
        "segment_s": float(generator.choice([1.0, 2.0, 5.0, 10.0])),
        "start": str(generator.choice(["smoothed", "estimated"])),
        "loss": str(generator.choice(["absolute", "squared", "huber"])),
        "budget": {"population": 8, "generations": int(generator.integers(1, 8)), "simplex_rounds": 5},
        "coefficients": coefficients,
    }


def mutated(number: int) -> Mutated:
    """Campaign of a number; it may be refused when it is made.

    Raises
    ------
    SeatrialError
        The campaign, its vehicle or its trial is refused.
    """
    import tomlkit

    generator = np.random.default_rng([43, number])
    done: list[str] = []
    true = Vehicle.load(VEHICLES[number % len(VEHICLES)])
    start = _mutated_vehicle(true, generator, done)
    names = ["first", "second"][: int(generator.integers(1, 3))]
    tables = {}
    for name in names:
        seconds = float(generator.choice([4.0, 12.0, 15.0, 15.0, 25.0]))
        dt = float(generator.choice([0.1, 0.1, 0.2, 0.2, 0.5]))
        done.append(f"{seconds:g} s by {dt:g} s")
        table = _recording(true, seconds, dt, generator)
        if not start.actuators:
            table = {key: values for key, values in table.items() if not key.startswith("cmd.")}
        tables[name] = pl.DataFrame(_spoil(table, generator, done))
    letters = str(generator.choice(["X", "Z", "N", "YN", "ZM", "XN", "XYZKMN", "K"]))
    count = int(generator.integers(1, 3))
    stages = [
        _stage(k, start, letters if k == 0 else str(generator.choice(["X", "YN", "ZM"])), generator, names)
        for k in range(count)
    ]
    if count > 1 and generator.random() < 0.7:
        stages[1]["after"] = ["stage0"]
    file: dict[str, Any] = {
        "format": 1,
        "name": f"mutated{number}",
        "vehicle": true.name,
        "input": "commands" if start.actuators and generator.random() < 0.7 else "tau",
        "trials": {name: {"file": f"{name}.csv"} for name in names},
        "stages": stages,
    }
    if generator.random() < 0.3:
        file["trials"][names[0]]["hold_out_s"] = [[0.0, float(generator.choice([0.5, 3.0, 3.0, 100.0]))]]
    if generator.random() < 0.8:
        method = str(generator.choice(["automatic", "output", "innovations"]))
        file["polish"] = {
            "method": method,
            "rounds": int(generator.choice([0, 1, 3])),
            "segment_s": float(generator.choice([1.0, 2.0, 5.0])),
            "loss": str(generator.choice(["squared", "huber"])),
        }
        if method == "output" and generator.random() < 0.5:
            file["polish"]["nuisances"] = {"current_north": {}, "force_Z": {}}
        if generator.random() < 0.3:
            file["polish"]["coefficients"] = {"N_rr": {"bounds": [-1e6, 1e6], "sd": 10.0}}
    text = tomlkit.dumps(file)
    return Mutated(Campaign.from_toml(text, source="mutated.toml", trials=tables, vehicle=start), tuple(done))


def ends_well(number: int) -> str:
    """How a campaign ends: "refused", before any search, or "result", whole and finite."""
    searched: list[str] = []

    def progress(step: Progress) -> None:
        if step.step is not None:
            searched.append(step.what)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # overflows of vehicles that diverge
        try:
            fit = mutated(number).campaign.identify(work=Work(progress=progress, threads=1))
        except SeatrialError:
            if searched:
                raise
            return "refused"
        assert all(map(math.isfinite, fit.vehicle.coefficients().values())), number
        assert all(math.isfinite(row.estimate) for row in fit.coefficients), number
        text = fit.report().text()
        assert Vehicle.from_toml(str(fit.files()["vehicle.toml"])).name == fit.vehicle.name
    if fit.fallbacks:
        assert f"{fit.fallbacks[0].name} failed".lower() in text.lower(), number
    return "result"


@pytest.mark.parametrize("number", QUICK)
def test_a_mutated_campaign_ends_in_a_result_or_is_refused_before_the_search(number: int) -> None:
    ends_well(number)


@pytest.mark.long
def test_sixty_mutated_campaigns_end_in_results_or_are_refused_before_the_search() -> None:
    ends = [ends_well(number) for number in range(60)]
    # The generator is no use where nearly everything is refused.
    assert ends.count("result") >= 15
