"""Small campaigns with `[tuning]` that several tests use."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

import seatrial as st
from seatrial.control_design.corridor import Corridor
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.result import Tuning
from seatrial.tuning.step_trial import LoopTrials, Rig, Samples

START = Path(__file__).parents[2] / "examples" / "cwolf" / "start_autopilot.toml"

HEAD = f"""
format = 1
name = "small"
vehicle = "cwolf"
seed = 5
autopilot = "{START.as_posix()}"
[trials.dive]
file = "dive.csv"
[[stages]]
name = "heave"
trials = ["dive"]
axes = {{ free = "Z" }}
[stages.coefficients]
Z_ww = [-1000.0, -50.0]
"""
"""A campaign of CWolf with the start gains; its trial is never read by a tuning."""

HEADING = """
[tuning]
samples = 1
current_m_s = 0.1
settle_s = 6.0
margins = { phase_deg = 0.0, gain_db = 0.0, delay_s = 0.0 }
budget = { population = 8, generations = 6, simplex_rounds = 3 }
[tuning.loops.heading]
steps = [20.0]
speeds_m_s = [3.0]
corridor = { rise_s = 7.0, overshoot = 0.1, settling_s = 12.0, settled = 0.08, until_s = 15.0 }
"""
"""One loop at one speed, at which the start gains are too slow, and no limits of the margins."""


def campaign(tuning: str = HEADING, head: str = HEAD, folder: str | Path = ".") -> st.Campaign:
    return st.Campaign.from_toml(head + tuning, source="small.toml", folder=folder)


def plan(tuning: str = HEADING, head: str = HEAD) -> ControlProblem:
    return campaign(tuning, head).control_problem()


@cache
def start() -> st.Autopilot:
    return st.Autopilot.load(START)


@cache
def cwolf() -> st.Vehicle:
    return st.Vehicle.load("cwolf")


def rig(sensors: str | None = None) -> Rig:
    return Rig(cwolf(), cwolf(), start(), sensors=sensors, max_step_s=0.05)


def still(count: int = 1, **coefficients: list[float]) -> Samples:
    """Vehicles in still water, the same one unless coefficients are given."""
    values = {name: np.array(each) for name, each in coefficients.items()}
    return Samples(values, np.zeros((count, 3)), tuple(range(1, count + 1)))


def trials(
    loop: str = "heading",
    speeds: tuple[float, ...] = (1.5,),
    sizes: tuple[float, ...] = (0.3,),
    *,
    rise_s: float = 5.0,
    until_s: float = 12.0,
    beside: dict[str, float] | None = None,
    weight_upper: float = 1.0,
) -> LoopTrials:
    corridor = Corridor.from_figures(
        rise_s=rise_s,
        overshoot=0.02,
        settling_s=0.8 * until_s,
        settled=0.02,
        until_s=until_s,
        weight_upper=weight_upper,
    )
    return LoopTrials(loop, corridor, beside or {}, speeds, sizes, settle_s=4.0)


@cache
def tuned() -> Tuning:
    """The tuning of `HEADING`."""
    return campaign().tune(work=st.Work(threads=1))
