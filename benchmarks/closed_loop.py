"""Rate of the closed loop against the open loop of the same vehicle, one core, in one run.

Both step CWolf's whole chain by a quarter of the control period, eight candidates to a vector, every one with
its own coefficients and, closed, with its own gains. Closed loop adds per control period sensors, guidance,
six-point adaptive PID, allocation with the inverse characteristic, safety and the figures of the flight; the
open loop has its criterion. "Noise" gives every sensor channel noise, with one seed for all candidates and
with one each. "Typical" has the sensors that come with the project, by whose samples the autopilot goes, or a
navigation filter of each candidate; what the filter adds to a control period is the time of its step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.speed import seconds
from benchmarks.workload import STEP_S, SUBSTEPS, chain
from seatrial import Vehicle, _core
from seatrial.flight.navigation import filter_of
from seatrial.flight.sensor_channels import SensorChannels, sensor_channels, sensors_of

MISSION = """
format = 1
name = "square"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 200.0
east_m = 0.0
depth_m = 10.0
[[legs]]
north_m = 200.0
east_m = 200.0
depth_m = 5.0
[[legs]]
north_m = 0.0
east_m = 200.0
depth_m = 10.0
"""


@dataclass(frozen=True)
class ClosedLoop:
    """Rates in steps per second of one core, and the time of a step of the navigation filter, s."""

    open_loop: float
    closed: float
    common_noise: float
    own_noise: float
    typical: float
    filtered: float
    filter_step_s: float


def measure(*, rounds: int = 5, samples: int = 1201, candidates: int = 128) -> ClosedLoop:
    """Return the rates over ``rounds`` rounds of ``candidates`` flights of ``samples`` control periods."""
    work = chain(samples)
    values = work.candidates(candidates, dead_times=False)
    recorded = work.open_loop()
    autopilot, mission = _core.Autopilot.load("cwolf"), _core.Mission.from_toml(MISSION)
    coefficients = dict(zip(work.names(), values.T, strict=True))
    gains = {
        "heading.K_P.4": np.linspace(20.0, 40.0, candidates),
        "pitch.K_D.4": np.linspace(100.0, 160.0, candidates),
    }
    duration = (samples - 1) * STEP_S * SUBSTEPS
    quiet, noisy = np.zeros((16, 4)), np.zeros((16, 4))
    noisy[:12, 0] = 0.005
    timing = np.tile([1.0, 1.0, 0.0, np.inf, 0.0], (7, 1))
    timing[5:, 0] = 0.0
    model, period = Vehicle.load("cwolf"), STEP_S * SUBSTEPS
    aboard = sensors_of("typical", model)
    typical = sensor_channels(aboard, period)
    navigation = filter_of("filter", model, aboard, period)
    believed = None if navigation is None else navigation.core

    def fly(sensors: SensorChannels, seeds: list[int], navigation: _core.Filter | None = None) -> object:
        return _core.fly(
            work.vehicle,
            autopilot,
            mission,
            seeds,
            position=np.zeros(3),
            attitude=np.zeros(3),
            nu=np.zeros(6),
            current=[0.0, 0.3, 0.0],
            coefficients=coefficients,
            gains=gains,
            model=None if navigation is None else model,
            errors=sensors.errors,
            timing=sensors.timing,
            navigation=navigation,
            feedback=False,
            max_step_s=STEP_S,
            max_time_s=duration,
            logs=False,
            threads=1,
        )

    same, own = [1] * candidates, list(range(candidates))
    contenders: dict[str, Callable[[], object]] = {
        "open": lambda: recorded.errors(values, threads=1),
        "closed": lambda: fly(SensorChannels(quiet, timing), same),
        "common": lambda: fly(SensorChannels(noisy, timing), same),
        "own": lambda: fly(SensorChannels(noisy, timing), own),
        "typical": lambda: fly(typical, own),
        "filtered": lambda: fly(typical, own, believed),
    }
    best = dict.fromkeys(contenders, np.inf)
    for _ in range(rounds):
        for name, task in contenders.items():
            best[name] = min(best[name], seconds(task))
    steps = candidates * work.steps
    rates = {name: steps / time for name, time in best.items()}
    return ClosedLoop(
        open_loop=rates["open"],
        closed=rates["closed"],
        common_noise=rates["common"],
        own_noise=rates["own"],
        typical=rates["typical"],
        filtered=rates["filtered"],
        filter_step_s=(best["filtered"] - best["typical"]) / (candidates * samples),
    )
