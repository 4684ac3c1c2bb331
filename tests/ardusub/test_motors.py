"""What a log of ArduSub owes by its modes, and motors that do not do what the mixer asks for."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial._core import ardusub_rates
from seatrial.ardusub.comparison import Found, Quantity, Replay
from seatrial.ardusub.log_replay import replay
from seatrial.ardusub.parameters import ParameterFile
from seatrial.base.arrays import Array
from seatrial.cli import app
from seatrial.report.plot.mission_log import replay_figure
from tests.ardusub import text_log
from tests.ardusub.text_log import Topics

mpl.use("Agg")

pytest.importorskip("pymavlink")

STABILIZE, ALT_HOLD, GUIDED, MANUAL, UNKNOWN = 0, 2, 4, 19, 77

SMALL = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "ardusub_small" / "small.BIN"

Edit = Callable[[Topics], None]


def replayed(path: Path, edit: Edit = lambda topics: None, mode: int = STABILIZE, **kinds: object) -> Replay:
    """Replay of a log in one mode that was edited."""
    modes = [(0.0, mode)]
    return replay(text_log.write(path / "log.log", minutes=3.0, modes=modes, edit=edit, **kinds))  # type: ignore[arg-type]


def stuck(motor: int, first: float = 0.0, last: float = 1e9, pulse: float = 1500.0) -> Edit:
    """An output that stays at a pulse for a time."""

    def edit(topics: Topics) -> None:
        own = topics["RCOU"]
        own[f"C{motor}"][(own["t"] >= first) & (own["t"] < last)] = pulse

    return edit


def ordered(*outputs: int) -> Edit:
    """Outputs that carry other motors: output k that of `outputs[k - 1]`."""

    def edit(topics: Topics) -> None:
        own = topics["RCOU"]
        pulses = {k: own[f"C{k}"].copy() for k in outputs}
        for k, motor in enumerate(outputs, 1):
            own[f"C{k}"] = pulses[motor]

    return edit


def reversed_motor(motor: int, first: float = 0.0) -> Edit:
    """An output that pushes the other way from a time on."""

    def edit(topics: Topics) -> None:
        own = topics["RCOU"]
        later = own["t"] >= first
        own[f"C{motor}"][later] = 3000.0 - own[f"C{motor}"][later]

    return edit


def all_at_rest(topics: Topics) -> None:
    """All outputs at 1500 us on the second half."""
    for motor in range(1, 7):
        stuck(motor, first=90.0)(topics)


def unmet(found: Replay) -> dict[str, str]:
    """Motors whose check is not met, and why."""
    wrong = [one for one in found.quantities if not one.holds and one.controller == "mixer"]
    return {one.name: one.why for one in wrong}


def test_a_log_in_stabilize_owes_attitude_and_motors(tmp_path: Path) -> None:
    found = replayed(tmp_path)
    assert found.held, found.summary()
    assert found.checks == (18, 18)
    assert found.report().outcome == "replayed"


@pytest.mark.parametrize(
    ("edit", "motors", "why"),
    [
        (stuck(6), {6}, "output 6 stays at 1500 us"),
        (stuck(2), {2}, "output 2 stays at 1500 us"),
        # 5 % of three minutes are nine seconds: what stays off counts by its length, not by its share.
        (stuck(3, 100.0, 106.0), {3}, "off longest from 100.1 to 106.0 s and stays at 1500 us"),
        (stuck(4, 10.0, 20.0, 1400.0), {4}, "off longest from 10.1 to 20.0 s and stays at 1400 us"),
        (stuck(5, pulse=0.0), {5}, "output 5 carries no pulse"),
        (ordered(2, 1, 3, 4, 5, 6), {1, 2}, "output 1 carries the pulses of motor 2"),
        # But for roll, of which there is little, these two are each other's reverse.
        (ordered(1, 2, 3, 4, 6, 5), {5, 6}, "output 5"),
        (ordered(5, 6, 1, 2, 3, 4), {1, 2, 3, 4, 5, 6}, "output 1 carries the pulses of motor 5"),
        (reversed_motor(4, 120.0), {4}, "off longest"),
        (all_at_rest, {1, 2, 3, 4, 5, 6}, "stays at 1500 us"),
    ],
)
def test_a_motor_that_does_not_follow_the_mixer_counts(
    tmp_path: Path, edit: Edit, motors: set[int], why: str
) -> None:
    found = replayed(tmp_path, edit)
    wrong = unmet(found)
    assert set(wrong) == {f"motor {k}" for k in motors}, found.summary()
    assert why in next(iter(wrong.values()))
    assert not found.held
    met, owed = found.checks
    assert (met, owed) == (18 - len(motors), 18)
    first = found.report()
    assert first.outcome == "replayed in part"
    assert first.good.startswith(f"{met} of {owed} checks are what")
    # A direction is told by motors that follow only.
    assert not {one.name for one in found.found} & {f"MOT_{k}_DIRECTION" for k in motors}


def test_outputs_that_are_gone_count(tmp_path: Path) -> None:
    """Six motors of a frame of eight, or four of one of six."""

    def edit(topics: Topics) -> None:
        del topics["RCOU"]["C5"], topics["RCOU"]["C6"]

    found = replayed(tmp_path, edit, parameters={"FRAME_CONFIG": 1.0})
    gone = [one for one in found.impossible if one.controller == "mixer"]
    assert {one.name for one in gone} == {"motor 5", "motor 6"}
    assert found.checks == (16, 18)


def test_parameters_say_which_output_carries_a_motor_and_which_way_it_pushes(tmp_path: Path) -> None:
    """Outputs in an order that ``SERVOn_FUNCTION`` states are not exchanged."""
    functions = {f"SERVO{k}_FUNCTION": 32.0 + motor for k, motor in enumerate((5, 6, 1, 2, 3, 4), 1)}
    assert replayed(tmp_path, ordered(5, 6, 1, 2, 3, 4), parameters=functions).held
    directions = {f"MOT_{k}_DIRECTION": float(d) for k, d in enumerate(text_log.DIRECTION, 1)}
    own = {"FRAME_CONFIG": 1.0, **directions}
    assert replayed(tmp_path, parameters=own).held
    wrong = unmet(replayed(tmp_path, reversed_motor(5), parameters=own))
    assert wrong == {"motor 5": "output 5 pushes against the direction of motor 5"}
    # Without parameters a direction is what the pulses say.
    found = replayed(tmp_path, reversed_motor(5))
    assert found.held
    assert found.parameter("MOT_5_DIRECTION") == -text_log.DIRECTION[4]


@pytest.mark.parametrize(
    ("topic", "mode", "lost"),
    [
        ("ANG", STABILIZE, 3),
        ("PIDP", STABILIZE, 3),
        ("RCIN", STABILIZE, 1),
        ("RCOU", STABILIZE, 1),
        ("PSCD", ALT_HOLD, 2),
        ("PSCN", GUIDED, 2),
    ],
)
def test_a_topic_that_the_modes_ask_for_is_missed_in_the_first_sentence(
    tmp_path: Path, topic: str, mode: int, lost: int
) -> None:
    def edit(topics: Topics) -> None:
        topics.pop(topic, None)

    found = replayed(tmp_path, edit, mode)
    assert topic in found.missing
    assert sum(gap.topic == topic for gap in found.impossible) == lost
    assert not found.held
    sentence = found.report().good
    assert sentence.startswith(topic if len(found.missing) == 1 else ", ".join(found.missing[:-1]))
    assert "missing from the log, so that" in sentence


def test_a_topic_that_ends_early_is_missed(tmp_path: Path) -> None:
    def edit(topics: Topics) -> None:
        topics["ANG"] = {name: column[:1000] for name, column in topics["ANG"].items()}

    found = replayed(tmp_path, edit)
    assert found.partly == ("ANG",)
    assert not found.held
    assert found.report().good.startswith(
        "ANG is missing for part of the log, so that 1 check cannot be made"
    )


def test_a_mode_that_does_not_control_the_depth_owes_no_depth(tmp_path: Path) -> None:
    """Without a known mode the topics tell: nothing of depth and place is there, and nothing is owed."""
    for mode in (STABILIZE, UNKNOWN):
        assert replayed(tmp_path, mode=mode).held
    assert set(replayed(tmp_path, mode=ALT_HOLD).missing) == {"PSCD", "PIDA"}
    assert {"PSCN", "PSCE"} < set(replayed(tmp_path, mode=GUIDED).missing)


def passed_through(topics: Topics) -> None:
    """Demands as sticks give them, and their pulses; the rate controllers rest."""
    rate, sticks, t = topics["RATE"], topics["RCIN"], topics["RATE"]["t"]
    for column, (name, k) in {"ROut": ("C2", 0.31), "POut": ("C1", 0.37), "YOut": ("C4", 0.43)}.items():
        sticks[name] = 1500.0 + np.round(60.0 * np.sin(k * t))
        rate[column] = (sticks[name] - 1500.0) / 400.0
    sticks["C3"] = 1500.0 + np.round(80.0 * np.sin(0.29 * t))
    rate["AOut"] = (sticks["C3"] - 1100.0) / 800.0
    pulses = text_log.pulses_of(text_log.demands_of(topics))
    topics["RCOU"].update({f"C{k + 1}": pulses[:, k] for k in range(6)})
    for letter in "RPY":
        topics[f"PID{letter}"] = {
            name: column if name == "t" else np.full_like(column, 0.01)
            for name, column in topics[f"PID{letter}"].items()
        }


def test_sticks_pass_through_in_manual(tmp_path: Path) -> None:
    found = replayed(tmp_path, passed_through, MANUAL)
    assert found.held, found.summary()
    assert found.checks == (10, 10)
    assert found.frame == ("Vectored", text_log.DIRECTION)

    def without_controllers(topics: Topics) -> None:
        passed_through(topics)
        for name in ("PIDR", "PIDP", "PIDY", "ANG"):
            del topics[name]

    bare = replayed(tmp_path, without_controllers, MANUAL)
    assert bare.held
    assert len(replay_figure(bare).axes) == 6  # throttle, motors 1 and 6


def test_the_figure_shows_what_is_not_met(tmp_path: Path) -> None:
    figure = replay_figure(replayed(tmp_path, stuck(3)))
    titles = [panel.get_title(loc="left") for panel in figure.axes]
    assert any("motor 3" in title for title in titles), titles


def test_demands_that_are_not_the_sticks_count_in_manual(tmp_path: Path) -> None:
    """Rows of a controlled flight under the name of MANUAL: pulses follow the demands, these no stick."""
    found = replayed(tmp_path, mode=MANUAL)
    wrong = {one.name for one in found.quantities if not one.holds}
    assert wrong == {"roll", "pitch", "yaw", "throttle"}
    assert "sticks in MANUAL, roll" in found.report().worst


def test_each_mode_of_a_log_is_held_against_its_own_law(tmp_path: Path) -> None:
    """MANUAL for the first minute, with the rows of controllers that rest, and STABILIZE afterwards."""

    def edit(topics: Topics) -> None:
        own = {name: {key: column.copy() for key, column in rows.items()} for name, rows in topics.items()}
        passed_through(own)
        first = topics["RATE"]["t"] < 60.0
        for name in ("RATE", "RCIN", "RCOU", "PIDR", "PIDP", "PIDY"):
            for key in topics[name]:
                topics[name][key][first] = own[name][key][first]

    modes = [(0.0, MANUAL), (60.0, STABILIZE)]
    log = text_log.write(tmp_path / "both.log", minutes=4.0, modes=modes, edit=edit)
    found = replay(log)
    assert found.held, found.summary()
    assert found.checks == (22, 22)
    # The same rows under one name are what no mode does.
    log = text_log.write(tmp_path / "one.log", minutes=4.0, modes=[(0.0, STABILIZE)], edit=edit)
    assert not replay(log).held


def test_a_disarmed_vehicle_owes_nothing(tmp_path: Path) -> None:
    def edit(topics: Topics) -> None:
        all_at_rest(topics)
        topics["ARM"] = {"t": np.array([90.0]), "ArmState": np.array([0.0])}

    assert replayed(tmp_path, edit).held
    assert not replayed(tmp_path, all_at_rest).held


def test_a_recorded_log_in_manual_is_replayed(tmp_path: Path) -> None:
    if not SMALL.is_file():
        pytest.skip("ardusub_small is not here; set SEATRIAL_DATA")
    found = replay(SMALL)
    assert found.held, found.summary()
    assert found.checks == (10, 10)
    answer = CliRunner().invoke(
        app, ["ardusub", str(SMALL), "--replay-only", "--figures", "none", "--out", str(tmp_path / "run")]
    )
    assert answer.exit_code == 0, answer.output


@pytest.mark.parametrize(
    ("limit", "bound", "value"), [(1100.0, "at least", 240.0), (100.0, "", 100.0), (4.0, "at most", 20.0)]
)
def test_a_bound_is_never_a_value(tmp_path: Path, limit: float, bound: str, value: float) -> None:
    """Half of ATC_ACC_Y_MAX counts within 10 to 120 deg/s2: beyond, the log tells a bound."""

    def edit(topics: Topics) -> None:
        angle, rate = topics["ANG"], topics["RATE"]
        yaw = 12.0 * np.sin(0.7 * angle["t"])
        zeros = np.zeros((len(yaw), 3))
        attitude = np.radians(np.stack([angle["Roll"], angle["Pitch"], yaw], 1))
        most = np.radians([1100.0, 1100.0, limit])
        gains = list(text_log.ANGLE_P.values())
        wanted = np.degrees(np.asarray(ardusub_rates(zeros, attitude, zeros, zeros, gains, most, 0.0025)))
        angle["DesYaw"], angle["Yaw"] = 0.0 * yaw, yaw
        rate["RDes"], rate["PDes"], rate["YDes"] = wanted.T

    found = replayed(tmp_path, edit)
    parameter = next(one for one in found.found if one.name == "ATC_ACC_Y_MAX")
    assert parameter.bound == bound
    assert parameter.value == pytest.approx(value)
    loads = ParameterFile.of_text(found.parameter_file(), "found.param").values
    assert ("ATC_ACC_Y_MAX" in loads) == (not bound)
    told = next(one for one in found.to_dict()["found"] if one["name"] == "ATC_ACC_Y_MAX")
    assert (told["value"] is None) == bool(bound)
    if bound:
        assert f"# ATC_ACC_Y_MAX: {bound} {value:g} (" in found.parameter_file()
        with pytest.raises(KeyError):
            found.parameter("ATC_ACC_Y_MAX")


def test_law_a_bound_agrees_with_what_lies_beyond_it() -> None:
    lower, upper = (Found("X", 240.0, float("nan"), "", bound) for bound in ("at least", "at most"))
    assert [lower.agrees(x) for x in (100.0, 240.0, 1100.0)] == [False, True, True]
    assert [upper.agrees(x) for x in (100.0, 240.0, 1100.0)] == [True, True, False]
    value = Found("X", 240.0, 10.0, "")
    assert [value.agrees(x) for x in (205.0, 215.0, 269.0, 275.0)] == [False, True, True, False]


def test_law_what_is_exact_may_not_stay_off() -> None:
    t: Array = np.asarray(np.arange(1000) * 0.1, float)
    off: Array = np.zeros(1000)
    off[100:112] = 5.0  # 1.1 s, 1.2 % of the rows
    judged = np.ones(1000, bool)

    def quantity(error: Array, exact: bool) -> Quantity:
        return Quantity("c", "q", "us", t, np.zeros(1000), error, judged, 2.0, exact=exact)

    assert not quantity(off, True).holds
    assert quantity(off, False).holds
    assert quantity(off, True).off == pytest.approx((10.0, 11.1))
    scattered: Array = np.asarray(np.where(np.arange(1000) % 25 == 0, 5.0, 0.0), float)
    assert quantity(scattered, True).holds
    missing = Quantity(
        "c", "q", "us", t + 100.0 * (np.arange(1000) > 106), 0.0 * t, off, judged, 2.0, exact=True
    )
    assert missing.holds
