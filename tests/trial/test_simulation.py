"""What a simulated run says of itself: commands beyond their limits, and how high it rose."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.trial.simulation import SimulatedTrial


def _run(vehicle: str, depth_m: float, **commands: float) -> SimulatedTrial:
    t = np.arange(0.0, 20.0, 0.1)
    columns = {"t_s": t, "z_m": np.full(len(t), depth_m)}
    columns |= {f"cmd.{name}": np.where(t < 5.0, 0.0, value) for name, value in commands.items()}
    trial = st.Trial.read(pl.DataFrame(columns), name="run")
    return SimulatedTrial(st.Vehicle.load(vehicle), trial, "XYZKMN", False, None, None)


def test_commands_within_their_limits_stand_out_by_nothing() -> None:
    made = _run("remus100", 10.0, propeller=1500.0, rudder_upper=0.1, rudder_lower=-0.2374)
    said = made.report("run", "score it")
    assert said.worst == "nothing stands out: the run is finite and stays below the surface"
    smallest = float(np.asarray(made.run.position)[:, 2].min())
    assert made.summary()["smallest depth, m"] == pytest.approx(smallest)
    assert f"smallest depth, m    {smallest:.2f}" in said.text()


def test_commands_in_degrees_are_asked_about() -> None:
    worst = (
        _run("remus100", 10.0, propeller=1500.0, rudder_upper=15.0, rudder_lower=-0.3).report("", "").worst
    )
    assert worst.startswith(
        "75 % of the commands of rudder_upper are beyond its limit of 0.2374 rad and are held there, the"
        " largest is 15 rad: are these degrees?; so are commands of rudder_lower"
    )


def test_revolutions_for_a_thruster_commanded_in_newtons_are_asked_about() -> None:
    name, fact = next(
        (name, fact) for name, fact in st.Vehicle.load("lauv").actuator_info().items() if fact["unit"] == "N"
    )
    worst = _run("lauv", 10.0, **{name: 1500.0}).report("", "").worst
    assert f"beyond its limit of {fact['maximum_ahead']:g} N" in worst
    assert worst.endswith("the largest is 1500 N: are these revolutions per minute?")


@pytest.mark.parametrize("depth_m", [1.2, 1.8])
def test_a_run_above_the_surface_is_never_said_to_stay_below(depth_m: float) -> None:
    made = _run("remus100", depth_m, propeller=1500.0)
    rise = -made.summary()["smallest depth, m"]
    assert 0.05 < rise < 1.0
    assert made.report("", "").worst.startswith(f"the vehicle rises {rise:.2f} m above the surface")
