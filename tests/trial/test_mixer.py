"""Sticks and channels become commands: trims, ends, reversal, frames by name, wrench, supply voltage."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.base.errors import TrialError
from seatrial.logs.log import open_log
from seatrial.trial.columns import FRAMES, Mixer, Output, Stick

T = np.arange(0.0, 10.0, 0.1)


def pulses(deflection: np.ndarray) -> np.ndarray:
    return 1500.0 + 400.0 * deflection


def log(**columns: np.ndarray) -> dict[str, np.ndarray]:
    return {"t_s": T, "u_m_s": np.sin(T)} | columns


def test_a_stick_has_trim_ends_dead_zone_and_direction() -> None:
    stick = Stick("c", trim=1520.0, min=1100.0, max=2000.0, dead_zone=20.0)
    found = stick.value(np.array([1000.0, 1100.0, 1510.0, 1540.0, 1770.0, 2000.0, 2100.0]))
    assert found == pytest.approx([-1.0, -1.0, 0.0, 0.0, 230.0 / 460.0, 1.0, 1.0])
    assert Stick("c", reversed=True).value(np.array([1900.0])).item() == -1.0


def test_servo_channels_become_fins_in_their_unit_and_sums_are_clipped() -> None:
    mixer = Mixer(
        inputs={"yaw": Stick("C4"), "pitch": Stick("C2")},
        outputs={
            "upper": Output({"yaw": 1.0, "pitch": 0.5}, full=25.0, unit="deg"),
            "lower": Output({"yaw": 1.0, "pitch": -0.5}, full=25.0, unit="deg"),
        },
    )
    yaw, pitch = np.where(T < 5.0, 0.8, -0.2), np.full(len(T), 0.6)
    trial = st.Trial.read(log(C4=pulses(yaw), C2=pulses(pitch)), mixer=mixer, align=False)
    assert np.rad2deg(trial.commands["upper"][[10, 90]]) == pytest.approx([25.0, 2.5])
    assert np.rad2deg(trial.commands["lower"][[10, 90]]) == pytest.approx([12.5, -12.5])
    assert "not used" not in str(trial.report)


@pytest.mark.parametrize(
    ("frame", "stick", "signs"),
    [
        ("VECTORED", "forward", [-1, -1, 1, 1, 0, 0]),
        ("VECTORED", "yaw", [1, -1, -1, 1, 0, 0]),
        ("VECTORED_6DOF", "throttle", [0, 0, 0, 0, -1, -1, -1, -1]),
        ("VECTORED_6DOF", "roll", [0, 0, 0, 0, 1, -1, 1, -1]),
        ("VECTORED_6DOF", "pitch", [0, 0, 0, 0, -1, -1, 1, 1]),
        ("VECTORED_6DOF", "lateral", [1, -1, 1, -1, 0, 0, 0, 0]),
        ("BLUEROV1", "throttle", [0, 0, 0.45, 0.45, 1, 0]),
        ("SIMPLEROV_3", "forward", [1, 1, 0]),
    ],
)
def test_lit_ardupilot_frames_send_sticks_to_their_motors(frame: str, stick: str, signs: list[float]) -> None:
    mixer = Mixer(inputs={stick: Stick("C1")}, frame=frame)
    trial = st.Trial.read(log(C1=pulses(np.full(len(T), 0.5))), mixer=mixer, align=False)
    assert list(trial.commands) == [f"thruster_{k + 1}" for k in range(len(FRAMES[frame]))]
    assert [(y[0] - 1500.0) / 200.0 for y in trial.commands.values()] == pytest.approx(signs)


def test_motors_have_the_vehicles_names_and_some_run_backwards() -> None:
    mixer = Mixer(
        inputs={"forward": Stick("C5")}, frame="SIMPLEROV_3", motors=("a", "b", "c"), reversed=("b",)
    )
    trial = st.Trial.read(log(C5=pulses(np.full(len(T), 0.25))), mixer=mixer, align=False)
    assert {name: y[0] for name, y in trial.commands.items()} == {"a": 1600.0, "b": 1400.0, "c": 1500.0}


def test_sticks_of_other_rates_are_held_and_at_rest_before_their_first_sample() -> None:
    yaw: list[float | None] = [None] * len(T)
    yaw[20], yaw[60] = 1900.0, 1500.0
    frame = pl.DataFrame({"t_s": T, "u_m_s": np.sin(T), "C4": yaw, "C5": pulses(np.full(len(T), 0.5))})
    mixer = Mixer(
        inputs={"yaw": Stick("C4"), "forward": Stick("C5")},
        outputs={"port": Output({"forward": 1.0, "yaw": 0.25}, full=1000.0)},
    )
    command = st.Trial.read(frame, mixer=mixer, align=False).commands["port"]
    assert command[[10, 30, 70]] == pytest.approx([500.0, 750.0, 500.0])


def test_a_wrench_and_a_constant_supply() -> None:
    mixer = Mixer(
        inputs={"surge": Stick("thrust_percent", trim=0.0, min=-100.0, max=100.0)},
        outputs={"tau.X_n": Output({"surge": 1.0}, full=0.2, unit="kN")},
        supply_v=15.2,
    )
    trial = st.Trial.read(log(thrust_percent=np.full(len(T), -25.0)), mixer=mixer, align=False)
    assert trial.tau is not None
    assert trial.voltage_v is not None
    assert trial.tau[:, 0] == pytest.approx(np.full(len(T), -50.0))
    assert trial.voltage_v == pytest.approx(np.full(len(T), 15.2))
    assert trial.inputs == ["tau"]


@pytest.mark.parametrize(
    ("mixer", "message"),
    [
        (Mixer(inputs={"yaw": Stick("C9")}, frame="VECTORED"), r'inputs\.yaw: there is no column "C9"'),
        (Mixer(inputs={"yaw": Stick("C4")}, frame="VECTORD"), r"unknown frame 'VECTORD'.*VECTORED"),
        (Mixer(inputs={"yaw": Stick("C4")}, frame="VECTORED", motors=("a",)), "expected 6 actuators"),
        (Mixer(inputs={"yaw": Stick("C4", min=1900.0, max=1100.0)}, frame="VECTORED"), "min < trim < max"),
        (
            Mixer(inputs={"yaw": Stick("C4")}, outputs={"rudder": Output({"yow": 1.0}, 1.0)}),
            r"unknown input 'yow'.*yaw",
        ),
        (Mixer(inputs={"stick": Stick("C4")}, frame="VECTORED"), "needs at least one of roll, pitch"),
        (Mixer(supply_v=12.0), "voltage_v is in the recording or its column map, too"),
        (Mixer(inputs={"yaw": Stick("C4")}, frame="VECTORED", reversed=("d",)), "unknown motor 'd'"),
        (
            Mixer(inputs={"yaw": Stick("C4")}, outputs={"rudder": Output({"yaw": 1.0}, 1.0, unit="kg")}),
            r'outputs\.rudder: unit "kg" has the dimension',
        ),
    ],
)
def test_a_mixer_that_does_not_fit_is_refused(mixer: Mixer, message: str) -> None:
    table = log(C4=pulses(np.zeros(len(T))), voltage_v=np.full(len(T), 12.0))
    with pytest.raises(TrialError, match=message):
        st.Trial.read(table, mixer=mixer)


@pytest.mark.long
def test_real_sticks_through_the_frame_give_the_outputs_of_ardusub_in_manual() -> None:
    """A telemetry log of ArduSub 4.1.1, VECTORED_6DOF, mode MANUAL: RC_CHANNELS against SERVO_OUTPUT_RAW."""
    path = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "ardusub_small" / "small.tlog"
    if not path.is_file():
        pytest.skip("ardusub_small is not here; set SEATRIAL_DATA")
    log = open_log(path)
    channels = {"throttle": "chan3_raw", "yaw": "chan4_raw", "forward": "chan5_raw", "lateral": "chan6_raw"}
    outputs = [f"servo{number}_raw" for number in range(1, 9)]
    read = log.read({"RC_CHANNELS": list(channels.values()), "SERVO_OUTPUT_RAW[0]": outputs})
    rc, servo = read["RC_CHANNELS"], read["SERVO_OUTPUT_RAW[0]"]
    held = np.searchsorted(rc.t, servo.t, side="right") - 1
    sticks = pl.DataFrame({name: rc.fields[channel][held] for name, channel in channels.items()})
    reversed_ = [f"thruster_{n}" for n in range(1, 9) if log.parameters[f"MOT_{n}_DIRECTION"] < 0.0]
    mixer = Mixer({name: Stick(name) for name in channels}, frame="VECTORED_6DOF", reversed=reversed_)
    found = mixer.mixed(sticks, path.name)
    away = (sticks - 1500.0).select(pl.max_horizontal(pl.all().abs())).to_series().to_numpy() > 100.0
    assert away.sum() >= 3
    for number, name in enumerate(outputs, start=1):
        commanded = found[f"cmd.thruster_{number}"].to_numpy()
        # The output is a whole number of microseconds.
        np.testing.assert_allclose(servo.fields[name][away], commanded[away], atol=1.0)
