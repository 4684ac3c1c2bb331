"""Corrections that are given are applied on the sensors' stamps, reported, and win over what is found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from seatrial.base.arrays import Array
from seatrial.base.channels import DEGREE
from seatrial.base.errors import CampaignError, TrialError
from seatrial.base.frames import from_euler, matrix
from seatrial.campaign.file import parse
from seatrial.trial.corrections import merged
from seatrial.trial.trial import Trial
from tests.trial import motion

T = np.arange(0.0, 60.0, 0.1)
INNER = slice(10, -10)
OFF = {"automatic": False}


def error(table: dict[str, Array], **corrections: Any) -> float:
    """Largest error of the velocities and rates of a trial with these corrections and no others."""
    trial = Trial.read(table, corrections=OFF | corrections)
    return float(np.abs(trial.nu[INNER] - motion.nu(T)[INNER]).max())


def turned(table: dict[str, Array], angles: list[float]) -> dict[str, Array]:
    """The table with the velocity as a sensor shows it that is mounted at these angles, deg."""
    names = ("u_m_s", "v_m_s", "w_m_s")
    v = np.stack([table[name] for name in names], axis=1) @ matrix(from_euler(np.array(angles) * DEGREE))
    return table | dict(zip(names, v.T, strict=True))


@pytest.mark.parametrize(
    ("table", "corrections"),
    [
        (motion.columns(T, velocity_late=0.24), {"delay_s": {"velocity": 0.24}}),
        (motion.columns(T, rates_late=-0.08), {"delay_s": {"rates": -0.08}}),
        (turned(motion.columns(T), [1.0, -3.0, 5.0]), {"tilt_deg": {"velocity": [1.0, -3.0, 5.0]}}),
        ({k: 1e3 * v if k in "u_m_s v_m_s w_m_s" else v for k, v in motion.columns(T).items()},
         {"scale": {"velocity": 1e-3}}),
        (motion.columns(T) | {"p_deg_s": -motion.columns(T)["p_deg_s"]}, {"signs": {"p": -1}}),
        (motion.columns(T) | {"q_deg_s": motion.columns(T)["q_deg_s"] + 2.0}, {"bias": {"q_deg_s": 2.0}}),
        (motion.columns(T)
         | {"p_deg_s": -motion.columns(T)["q_deg_s"], "q_deg_s": motion.columns(T)["p_deg_s"]},
         {"axes": {"p": "q", "q": "-p"}}),
    ],
)  # fmt: skip
def test_law_what_is_given_undoes_the_error(table: dict[str, Array], corrections: dict[str, Any]) -> None:
    # 1 mm/s and mrad/s: linear interpolation of ten samples a second
    assert error(table, **corrections) < 5e-3 < error(table)


def test_law_a_heading_turns_the_attitude_about_the_vertical() -> None:
    plain = Trial.read(motion.columns(T), corrections=OFF)
    trial = Trial.read(motion.columns(T), corrections=OFF | {"heading_deg": 30.0})
    turn = matrix(from_euler([0.0, 0.0, 30.0 * DEGREE]))
    np.testing.assert_allclose(matrix(trial.attitude), turn @ matrix(plain.attitude), atol=1e-9)


def test_every_correction_is_reported_with_key_and_value() -> None:
    given = {"delay_s": {"velocity": 0.2}, "signs": {"p": -1}, "heading_deg": 3.0}
    report = Trial.read(motion.columns(T), corrections=given).report
    assert report.corrections == {"delay_s.velocity": 0.2, "signs.p": -1, "heading_deg": 3.0}
    assert "delay_s.velocity: 0.2, as given under corrections" in str(report)


def test_what_is_not_recorded_is_said_and_left() -> None:
    table = {name: values for name, values in motion.columns(T).items() if not name.endswith("deg_s")}
    report = Trial.read(table, corrections={"signs": {"p": -1}}).report
    assert report.corrections == {}
    assert "not recorded" in str(report)


def test_what_is_given_wins_over_what_is_found() -> None:
    table = motion.columns(T, velocity_late=0.24) | {"p_deg_s": -motion.columns(T)["p_deg_s"]}
    given = {"delay_s": {"velocity": 0.1}, "signs": {"p": 1}}
    trial = Trial.read(table, corrections=given)
    assert "velocity" not in trial.report.latencies
    assert "sign reversed" not in str(trial.report)
    assert "signs.p = -1 under corrections" in str(trial.report)


def test_nothing_is_corrected_by_itself_on_request() -> None:
    table = motion.columns(T, velocity_late=0.24) | {"p_deg_s": -motion.columns(T)["p_deg_s"]}
    trial = Trial.read(table, corrections=OFF)
    assert trial.report.latencies == {}
    np.testing.assert_allclose(trial.channel("u"), table["u_m_s"])
    np.testing.assert_allclose(trial.channel("p") / DEGREE, table["p_deg_s"])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"sign": {"p": -1}}, "unknown key 'sign'; did you mean \"signs\"?"),
        ({"signs": {"p": 2}}, "signs.p: expected 1 or -1, found 2"),
        ({"signs": {"pp": -1}}, "signs: unknown name 'pp'"),
        ({"delay_s": {"velocity": 1e9}}, "delay_s.velocity: expected a number from -1000 to 1000"),
        ({"delay_s": 0.3}, "delay_s: expected a table"),
        ({"tilt_deg": {"velocity": [1.0]}}, "tilt_deg.velocity: expected 3 angles"),
        ({"scale": {"velocity": -1.0}}, "a factor is positive; give a sign under signs"),
        ({"bias": {"p": 1.0}}, "bias: unknown name 'p'; known: p_deg_s"),
        ({"axes": {"p": "u"}}, "axes.p: expected the recorded channel, one of p, q, r"),
        ({"automatic": 1}, "automatic: expected true or false"),
        ({"heading_deg": "north"}, "heading_deg: expected a number"),
        ({"current": {"t_s": [0.0], "north_m_s": [0.1]}}, "current.east_m_s: expected a list of numbers"),
        (
            {"current": {"t_s": [9, 3], "north_m_s": [0, 0], "east_m_s": [0, 0]}},
            "current.t_s: expected rising",
        ),
        ({"current": {"t_s": [0], "north_m_s": [500], "east_m_s": [0]}}, "north_m_s: expected a number from"),
    ],
)
def test_a_wrong_correction_is_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(TrialError) as caught:
        Trial.read(motion.columns(T), corrections=given)
    assert says in str(caught.value)


CAMPAIGN = """
format = 1
name = "trial"
vehicle = "cwolf"
[corrections]
signs.p = -1
delay_s.velocity = 0.24
[trials.dive]
file = "dive.csv"
[trials.dive.corrections]
signs.q = -1
[[stages]]
name = "heave"
trials = ["dive"]
axes = { free = "Z" }
[stages.coefficients]
Z_ww = [-1000.0, -50.0]
"""


def test_a_slow_current_is_known_water_and_held_beyond_its_knots() -> None:
    knots = {"t_s": [10.0, 50.0], "north_m_s": [0.1, 0.3], "east_m_s": [0.0, -0.2]}
    trial = Trial.read(motion.columns(T), corrections={"current": knots})
    assert trial.current is not None
    for column, values in ((0, [0.1, 0.3]), (1, [0.0, -0.2])):
        told = np.interp(trial.t, knots["t_s"], values)
        # between the knots the water is kept once a second
        np.testing.assert_allclose(trial.current[:, column], told, atol=0.01)
    assert trial.report.corrections["current"] == "2 knots"


def test_a_trials_corrections_come_over_the_campaigns() -> None:
    file = parse(CAMPAIGN, "c.toml")
    both = merged(file.corrections, file.trials["dive"].corrections)
    assert both == {"signs": {"p": -1, "q": -1}, "delay_s": {"velocity": 0.24}}


@pytest.mark.parametrize(
    ("new", "says"),
    [
        ("delay_s.velocity = 1e9", "delay_s.velocity: expected a number from -1000 to 1000"),
        ("delay_s.speed = 0.1", "delay_s: unknown name 'speed'"),
        ("delay.velocity = 0.1", "unknown key 'delay'"),
    ],
)
def test_a_campaign_with_wrong_corrections_is_refused(new: str, says: str) -> None:
    with pytest.raises(CampaignError) as caught:
        parse(CAMPAIGN.replace("delay_s.velocity = 0.24", new), "c.toml")
    assert says.partition(": ")[2] in str(caught.value)
