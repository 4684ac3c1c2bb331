"""What the trials of a campaign propose, and that a proposal that is accepted is not made again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import seatrial
from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.finding import Finding, Severity
from seatrial.base.frames import from_euler, matrix, product
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign
from seatrial.inspect.consistency import (
    LateVelocity,
    consistency_of_recording,
    late_velocity,
    mean,
    proposals,
)
from seatrial.inspect.corrections import Consistency, Correction
from seatrial.report.results.trial_findings import problem, remedy
from seatrial.sensors.log import held, measure, times
from seatrial.sensors.sensor import parse_sensors
from seatrial.trial.signals import RecordingReport
from tests.trial import motion

CWOLF = Path(seatrial.__file__).parent / "examples" / "cwolf"

CAMPAIGN = """
format = 1
name = "sea"
vehicle = "cwolf"
{head}
[trials.turn]
file = "trials/turn.toml"
reader = "generated"
[[stages]]
name = "sway and yaw"
trials = ["turn"]
axes = {{ free = "YN" }}
[stages.coefficients]
N_rr = [-1000.0, -50.0]
"""


def campaign(head: str = "", **trials: Any) -> Campaign:
    return Campaign.from_toml(CAMPAIGN.format(head=head), folder=CWOLF, trials=trials)


def compared(made: Campaign) -> Consistency:
    recording = made.problem().recordings["turn"]
    assert recording is not None
    return consistency_of_recording(recording)


def late(made: Campaign) -> LateVelocity | None:
    problem = made.problem()
    return late_velocity(problem.trials, problem.recordings, problem="sea.toml")


PLACES = "places = { velocity_m = [0.35, 0.0, 0.12] }\n"


def wrong() -> dict[str, Array]:
    """A recording with a turned heading, a reversed gyro, a late velocity in mm/s and a tilted sensor."""
    t = np.arange(0.0, 200.0, 0.1)
    table = motion.columns(t, velocity_late=0.3, noise=2e-3)
    q = product(from_euler([0.0, 0.0, -30.0 * DEGREE]), np.stack([table[f"q_{c}"] for c in "wxyz"], axis=1))
    names = ("u_m_s", "v_m_s", "w_m_s")
    v = 1e3 * np.stack([table[n] for n in names], axis=1) @ matrix(from_euler([0.0, 3.0 * DEGREE, 0.0]))
    table |= dict(zip(("q_w", "q_x", "q_y", "q_z"), q.T, strict=True)) | dict(zip(names, v.T, strict=True))
    return table | {"q_deg_s": -table["q_deg_s"]}


def test_law_accepted_proposals_leave_nothing_to_propose() -> None:
    frame = pl.DataFrame(wrong())
    made = campaign(turn=frame)
    found = compared(made)
    keys = {"heading_deg", "signs.q", "delay_s.velocity", "scale.velocity", "tilt_deg.velocity"}
    assert {one.key for one in found.corrections} == keys
    head = "[corrections]\n" + "\n".join(one.line for one in found.corrections)
    again = compared(campaign(head, turn=frame))
    assert again.corrections == ()


def test_what_reading_does_by_itself_comes_last_and_says_so() -> None:
    made = campaign(turn=pl.DataFrame(wrong()))
    found = compared(made)
    told = proposals({"turn": found}, {"turn": made.trials["turn"].report})
    assert [one.done for one in told] == sorted(one.done for one in told)
    assert "signs.q = -1 (applied on reading)" in next(one.text for one in told if "signs.q" in one.text)


def test_a_trial_that_was_given_as_one_is_not_compared() -> None:
    made = campaign()
    assert check_campaign(campaign(turn=made.trials["turn"])).consistency == {}


@pytest.mark.long
def test_a_check_proposes_nothing_where_all_is_well() -> None:
    assert "Corrections proposed" not in check_campaign(campaign(PLACES)).summary()


def test_a_check_shows_the_line_to_paste_on_top_of_what_is_given() -> None:
    head = PLACES + "corrections.signs.q = -1\ncorrections.delay_s.rates = 0.5"
    made = check_campaign(campaign(head))
    lines = [one.text.partition("[corrections] ")[2] for one in made.proposals]
    assert "signs.q = 1" in lines
    delay = next(float(line.partition(" = ")[2]) for line in lines if line.startswith("delay_s.rates"))
    assert abs(delay) < 0.01
    assert made.report().worst == made.proposals[0].text


def slowly_placed(velocity_late: float) -> pl.DataFrame:
    """A recording whose position comes every two seconds, as an acoustic one does, and its depth at 10 Hz."""
    t = np.arange(0.0, 80.0, 0.1)
    table = motion.columns(t, velocity_late=velocity_late, noise=2e-3)
    place = {name: table.pop(name)[::20] for name in ("x_m", "y_m")} | {"t_s": t[::20] + 0.013}
    return pl.concat([pl.DataFrame(table), pl.DataFrame(place)], how="diagonal").sort("t_s")


def test_a_late_velocity_that_reading_leaves_is_said_with_the_command_to_run() -> None:
    made = campaign(turn=slowly_placed(0.3))
    found = late(made)
    assert found is not None
    assert problem(found.finding).startswith("the velocity of trial turn is 0.30 s late")
    assert "seatrial check" in remedy(found.finding)
    assert "delay_s.velocity = 0." in remedy(found.finding)
    assert "the log has too few positions" in problem(found.finding)
    assert found.spoils == (found.before > 1.5 * found.after)
    # Without any position as well.
    bare = late(campaign(turn=slowly_placed(0.3).drop("x_m", "y_m").drop_nulls("z_m")))
    assert bare is not None
    assert bare.delay_s == pytest.approx(0.3, abs=0.03)


def test_a_velocity_that_reading_corrects_or_that_is_on_time_or_that_is_given_is_not_called_late() -> None:
    assert late(campaign(turn=pl.DataFrame(wrong()))) is None
    assert late(campaign(turn=slowly_placed(0.0))) is None
    given = campaign("[corrections]\ndelay_s.velocity = 0.3", turn=slowly_placed(0.3))
    assert late(given) is None


def test_identify_heads_its_lines_with_a_late_velocity() -> None:
    t = np.arange(0.0, 80.0, 0.1)
    side = np.sign(np.sin(2.0 * np.pi * t / 16.0))
    commands = dict.fromkeys(("SbU", "SbL"), 1000.0 + 400.0 * side)
    commands |= dict.fromkeys(("PU", "PL"), 1000.0 - 400.0 * side)
    commands |= {name: 600.0 * np.sign(np.sin(2.0 * np.pi * t / 22.0)) for name in ("VTB", "VTS")}
    given = {name: held(values, 10) for name, values in commands.items()}
    run = seatrial.Vehicle.load("cwolf").simulate(
        times(t, 10), given, seatrial.State(position=[0.0, 0.0, 9.0])
    )
    sensors: dict[str, dict[str, Any]] = {kind: {"rate_hz": 10.0} for kind in ("gyro", "attitude", "depth")}
    sensors |= {"dvl": {"rate_hz": 5.0, "latency_s": 0.4}, "position": {"rate_hz": 0.5}}
    inputs = {f"cmd.{name}": values for name, values in commands.items()}
    fit = campaign(turn=measure(run, parse_sensors(sensors), seed=2, inputs=inputs, every=10)).identify()
    report = fit.report()
    assert report.worst.startswith("the velocity of trial turn is 0.4"), report.worst
    assert report.next_step.startswith("run seatrial check")
    assert fit.findings[0].kind == "late velocity"
    assert fit.before[0].startswith(report.worst)


def bias(value: float, sd: float) -> Consistency:
    """A trial that proposes a bias of the yaw rate alone."""
    finding = Finding("bias", Severity.WEAKNESS, "r", {"value": value, "sd": sd, "unit": "deg/s"})
    found = Correction("corrections", "bias.r_deg_s", value, sd, "deg/s", 0.04, 0.03, "rates, rad/s", finding)
    return Consistency((found,), ())


def test_the_printed_correction_is_the_one_of_the_drafted_campaign() -> None:
    """The mean of trials that agree; each trial's own value where they do not."""
    agreed = {"a": bias(1.026, 0.06), "b": bias(0.97, 0.06), "c": bias(0.98, 0.03)}
    reports = {name: RecordingReport(name) for name in agreed}
    (told,) = proposals(agreed, reports)
    value = mean({name: one.corrections[0] for name, one in agreed.items()})[1]
    assert 0.97 < value < 1.0
    assert told.text.endswith(f"[corrections] bias.r_deg_s = {value:g} (their mean)")
    (apart,) = proposals({"a": bias(1.0, 0.01), "b": bias(-1.0, 0.01)}, reports)
    assert "[trials.a.corrections] bias.r_deg_s = 1, [trials.b.corrections] bias.r_deg_s = -1" in apart.text
