"""The law of `verify-log`: vehicles with one changed group of coefficients, judged by the unchanged.

``python -m tests.verification.power_law [VEHICLE ...]`` prints the table of docs/validation.md: per vehicle,
axis and group the verdict for the group times 1/4, 1/2, 2 and 4 and the error of the model over that of the
vehicle itself, and how often the true model is called valid.

REMUS 100 and CWolf fly a weave of headings and depths under their autopilots. An autopilot of a BlueROV2
Heavy holds roll and pitch at zero, so that no mission of it tells how they answer: its thrusters are driven
by random steps in open loop.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

import seatrial as st
from seatrial.base.finding import Finding, Severity
from seatrial.identification.fitted import Fitted
from seatrial.sensors.log import Surroundings, measure
from seatrial.sensors.sensor import load_sensors
from seatrial.verification.mission_log.judge_log import settled, state_inside
from seatrial.verification.mission_log.log import MissionLog, offsets_of
from seatrial.verification.mission_log.power import CoefficientGroup, Power, coefficient_groups, group_power
from seatrial.verification.mission_log.spread import PredictedLog, restarts, spread_of_noise
from seatrial.verification.mission_log.validity import VALIDITY_SETTINGS, validity
from seatrial.verification.mission_log.verdict import ModelState

VEHICLES = ("cwolf", "remus100", "bluerov2-heavy")

FACTORS = (0.25, 0.5, 2.0, 4.0)

TRUE = 20

SEED = 11

_SUPPLY_V = 16.0

_LEGS = ((60.0, 0.0, 6.0), (60.0, 50.0, 3.0), (110.0, 50.0, 8.0), (110.0, 0.0, 4.0))

_SPEED_M_S = {"cwolf": 1.3, "remus100": 1.7}


def mission(name: str) -> st.Mission:
    """A weave through headings and depths, with two speeds."""
    legs = "".join(
        f"[[legs]]\nnorth_m = {north}\neast_m = {east}\ndepth_m = {depth}\n"
        f"speed_m_s = {_SPEED_M_S[name] + (0.2 if k % 2 else 0.0)}\n"
        for k, (north, east, depth) in enumerate(_LEGS)
    )
    head = f'format = 1\nname = "weave"\nspeed_m_s = {_SPEED_M_S[name]}\nacceptance_radius_m = 6.0\n'
    return st.Mission.from_toml(head + legs)


def log_of(name: str, changes: Mapping[str, float], seed: int) -> MissionLog:
    """What typical sensors log of a vehicle with other coefficients."""
    model = st.Vehicle.load(name)
    vehicle = model.with_coefficients(dict(changes)) if changes else model
    if name == "bluerov2-heavy":
        return _driven(vehicle, seed)
    flight = st.fly(
        vehicle, name, mission(name), conditions=st.Conditions(sensors="typical", model=model), seed=seed
    )
    return MissionLog.read(flight.table(), name=f"{name} {seed}")


def _driven(vehicle: st.Vehicle, seed: int) -> MissionLog:
    """Two minutes of random steps of all thrusters, which last from half a second to three."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 120.0, 0.1)
    facts = vehicle.actuator_info()
    commands = {}
    for name in vehicle.actuators:
        # A tenth of the reach in pulse width moves a metre-long vehicle by decimetres per second and radian.
        steps = np.repeat(rng.uniform(-60.0, 60.0, len(t)), rng.integers(5, 30, len(t)))[: len(t)]
        commands[name] = np.round(float(facts[name]["neutral"]) + steps)
    # Like those of a flight they sample in step with the log.
    typical = load_sensors("typical", vehicle)
    sensors = {kind: replace(typical[kind], rate_hz=None, phase_s=0.0, jitter_s=0.0) for kind in _LOGGED}
    start = st.State([0.0, 0.0, 20.0])
    run = vehicle.simulate(t, commands, voltage_v=_SUPPLY_V, max_step_s=0.02, initial=start)
    inputs = {f"cmd.{name}": x for name, x in commands.items()}
    inputs |= {"voltage_v": np.full(len(t), _SUPPLY_V)}
    inputs |= {f"current_{way}_m_s": np.zeros(len(t)) for way in ("north", "east")}
    bottom = Surroundings(bottom_depth_m=40.0)
    table = measure(run, sensors, seed=seed, inputs=inputs, conditions=bottom)
    return MissionLog.read(table, name=f"{vehicle.name} {seed}", rate_hz=10.0)


_LOGGED = ("dvl", "gyro", "attitude", "depth")


def judged(name: str, changes: Mapping[str, float], seed: int) -> tuple[ModelState, Finding, Power]:
    """State of the unchanged vehicle's model on a log of the changed one, why, and the power of the log."""
    return _judged(name, restarts(st.Vehicle.load(name), log_of(name, changes, seed).trial))


def _judged(name: str, windows: PredictedLog) -> tuple[ModelState, Finding, Power]:
    """As `seatrial.verify_log` decides it, without the search for suspects, which takes most of its time."""
    known = Fitted.of(name)
    offsets = offsets_of("typical", known.vehicle)
    within = validity(windows, spread_of_noise(windows), offsets=offsets)
    power = group_power(known, windows, offsets=offsets, level=VALIDITY_SETTINGS.level, water=False)
    within = settled(within, power)
    if within.failing:
        names = [channel.channel for channel in within.failing]
        return "re-identify", Finding("outside the band", Severity.PROBLEM, ", ".join(names)), power
    return *state_inside(within, power), power


def changed(name: str, group: CoefficientGroup, factor: float, seed: int = SEED) -> ModelState:
    """State of the model on a log of the vehicle with a group of coefficients times a factor."""
    values = st.Vehicle.load(name).coefficients()
    return judged(name, {member: factor * values[member] for member in group.names}, seed)[0]


@dataclass(frozen=True)
class LawRow:
    """Verdict on a group times a factor, and the largest error of the model over that of the vehicle itself.

    ``excess`` is of all channels, root mean square over windows of ten seconds.
    """

    group: CoefficientGroup
    factor: float
    state: ModelState
    excess: float

    @property
    def row(self) -> str:
        """Cell of the table: the verdict in a word, and the excess."""
        return f"{self.group.words} x{self.factor:g}: {_WORDS[self.state]} {self.excess:.2f}"


def law(name: str, seed: int, factors: Sequence[float] = FACTORS) -> Iterator[LawRow]:
    """A row per group and factor."""
    model = st.Vehicle.load(name)
    values = model.coefficients()
    for group in coefficient_groups(model, actuators=False):
        for factor in factors:
            changes = {member: factor * values[member] for member in group.names}
            trial = log_of(name, changes, seed).trial
            windows = restarts(model, trial)
            ours, own = (
                np.sqrt(np.mean(np.concatenate(log.residual) ** 2, axis=0))
                for log in (windows, restarts(model.with_coefficients(changes), trial))
            )
            seen = own > 0.0
            state = _judged(name, windows)[0]
            yield LawRow(group, factor, state, float((ours[seen] / own[seen]).max()))


_WORDS = {
    "model still valid": "VALID",
    "re-identify": "refuted",
    "not judged": "not judged",
    "log too short or too quiet to tell": "undecided",
}


def main() -> None:
    """Print the table."""
    for name in sys.argv[1:] or VEHICLES:
        verdicts = [judged(name, {}, seed) for seed in range(1, TRUE + 1)]
        valid = sum(state == "model still valid" for state, _, _ in verdicts)
        able = sum(not power.unjudged for _, _, power in verdicts)
        print(f"{name}: power on every controlled axis in {able} of {TRUE} logs, true model valid in {valid}")
        for state, reason, _ in verdicts:
            if state != "model still valid":
                print(f"  {state}: {reason}")
        print("| axis | group | 1/4 | 1/2 | 2 | 4 |\n|---|---|---|---|---|---|")
        rows = list(law(name, SEED))
        for k in range(0, len(rows), len(FACTORS)):
            cells = [f"{_WORDS[part.state]} {part.excess:.3g}" for part in rows[k : k + len(FACTORS)]]
            print(f"| {rows[k].group.axis} | {rows[k].group.kind} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
