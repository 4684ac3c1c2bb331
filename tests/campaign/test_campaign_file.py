"""The campaign file's format: what is read, what is refused, and with which words."""

from __future__ import annotations

import pytest

from seatrial.base.errors import CampaignError
from seatrial.campaign.file import CampaignFile, parse

HEAD = """
format = 1
name = "tank"
vehicle = "cwolf"
"""
TRIAL = """
[trials.surge]
file = "surge.csv"
"""
STAGE = """
[[stages]]
name = "surge"
trials = ["surge"]
axes = { free = "X" }
"""
COEFFICIENTS = """
[stages.coefficients]
X_uu = [-40.0, -5.0]
"""


def read(text: str) -> CampaignFile:
    return parse(text, "tank.toml")


def refusal(text: str) -> str:
    with pytest.raises(CampaignError) as caught:
        read(text)
    return str(caught.value)


def test_shortest_file_and_its_defaults() -> None:
    file = read(HEAD + TRIAL + STAGE + COEFFICIENTS)
    stage = file.stages[0]
    assert stage.coefficients["X_uu"].bounds == (-40.0, -5.0)
    assert (stage.loss, stage.start, stage.segment_s, stage.overlap_s) == ("absolute", "smoothed", 10.0, 0.0)
    assert stage.weights() == {"u": 1.0}
    assert (file.seed, file.input) == (0, "commands")


def test_every_form_of_a_coefficient() -> None:
    file = read(
        HEAD
        + TRIAL
        + STAGE
        + """
[stages.coefficients]
X_u = "default"
X_uu = [-40, -5]
"stern.gain" = { bounds = [0.5, 2.0], start = 1.1 }
Y_vv = { bounds = [0.25, 4.0], relative = true, tie = ["Z_ww", { name = "N_v", factor = -1.0 }] }
"""
    )
    found = file.stages[0].coefficients
    assert found["X_u"].bounds is None
    assert found["X_uu"].bounds == (-40, -5)
    assert found["stern.gain"].start == 1.1
    assert [(tie.name, tie.factor) for tie in found["Y_vv"].tie] == [("Z_ww", 1.0), ("N_v", -1.0)]


def test_default_channels_are_the_velocities_of_the_free_axes() -> None:
    text = (HEAD + TRIAL + STAGE + COEFFICIENTS).replace('free = "X"', 'free = "NX", measured = "Y"')
    assert list(read(text).stages[0].weights().items()) == [("u", 1.0), ("r", 1.0)]


def test_budget_of_the_stage_over_that_of_the_campaign() -> None:
    text = HEAD + "budget = { generations = 50, tolerance = 1e-3 }\n" + TRIAL + STAGE
    text += "budget = { generations = 20 }\n" + COEFFICIENTS
    file = read(text)
    budget = file.stages[0].budget.over(file.budget)
    assert (budget.generations, budget.tolerance, budget.population) == (20, 1e-3, None)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("format = 1\nname = ", ["tank.toml", "not a TOML file", "Invalid value"]),
        (HEAD + TRIAL, ["stages is missing", "[[stages]]"]),
        (HEAD + TRIAL + "sede = 3\n" + STAGE + COEFFICIENTS, ["'sede'", "trials", "surge"]),
        (HEAD + "sede = 3\n" + TRIAL + STAGE + COEFFICIENTS, ["'sede'", 'did you mean "seed"']),
        (HEAD.replace("1", "2") + TRIAL + STAGE + COEFFICIENTS, ["key format", "expected 1", "found 2"]),
        (HEAD + TRIAL + STAGE + "segmet_s = 5.0" + COEFFICIENTS, ["stages 'surge'", 'mean "segment_s"']),
        (
            HEAD + TRIAL + STAGE + 'segment_s = "5 s"' + COEFFICIENTS,
            ["key segment_s", "number", "found '5 s'"],
        ),
        (HEAD + TRIAL + STAGE + "segment_s = -5.0" + COEFFICIENTS, ["segment_s", "greater than 0", "-5.0"]),
        (HEAD + TRIAL + STAGE + "segment_s = nan" + COEFFICIENTS, ["segment_s", "finite number", "nan"]),
        (HEAD + TRIAL + STAGE + "overlap_s = 10.0" + COEFFICIENTS, ["overlap_s = 10.0", "shorter than"]),
        (HEAD + TRIAL + STAGE + 'loss = "l2"' + COEFFICIENTS, ["key loss", "'absolute'", "found 'l2'"]),
        (HEAD + TRIAL + STAGE + "channels = { U = 1.0 }" + COEFFICIENTS, ["'U'", 'did you mean "u"']),
        (HEAD + TRIAL + STAGE.replace('"X"', '"XQ"') + COEFFICIENTS, ["letters of XYZKMN", "'Q'"]),
        (
            HEAD + TRIAL + STAGE.replace('"X"', '"X", measured = "XY"') + COEFFICIENTS,
            ["axis X has two modes"],
        ),
        (HEAD + TRIAL + STAGE.replace('free = "X"', 'measured = "X"') + COEFFICIENTS, ["frees no axis"]),
        (HEAD + TRIAL + STAGE, ["stages 'surge'", "frees no coefficient"]),
        (
            HEAD + TRIAL + STAGE + "[stages.coefficients]\nX_u = [-1.0, -4.0]",
            ["lower < upper", "[-1.0, -4.0]"],
        ),
        (HEAD + TRIAL + STAGE + "[stages.coefficients]\nX_u = [-1.0]", ["X_u", "bounds"]),
        (HEAD + TRIAL + STAGE + '[stages.coefficients]\nX_u = "auto"', ["[lower, upper]", "'auto'"]),
        (HEAD + TRIAL + STAGE + "[stages.coefficients]\nstern.gain = [0.5, 2.0]", ["'gain'", "needs quotes"]),
        (HEAD + TRIAL + STAGE + "[stages.coefficients]\nX_u = { relative = true }", ["relative", "bounds"]),
        (HEAD + TRIAL + "hold_out_s = [[50.0, 20.0]]" + STAGE + COEFFICIENTS, ["trials", "start < stop"]),
        (HEAD + TRIAL + 'input = "force"' + STAGE + COEFFICIENTS, ["input", "'tau'", "found 'force'"]),
        (HEAD + "environment = { rho = 1000.0 }" + TRIAL + STAGE + COEFFICIENTS, ["'rho'", "rho_kg_m3"]),
    ],
)
def test_refusal_says_where_what_and_what_was_found(text: str, words: list[str]) -> None:
    message = refusal(text)
    assert message.startswith("tank.toml: ")
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + "[trials]" + STAGE + COEFFICIENTS, "trials is empty; add [trials.NAME]"),
        (HEAD + STAGE + COEFFICIENTS, "trials is missing; add [trials.NAME]"),
        (
            HEAD + TRIAL + "places = { velocity_m = [1.0] }" + STAGE + COEFFICIENTS,
            "tank.toml: trials, surge, places, key velocity_m: expected 3 entries, found 1; correct the list",
        ),
        (
            HEAD + TRIAL + "hold_out_s = [[1.0, 2.0, 3.0]]" + STAGE + COEFFICIENTS,
            "tank.toml: trials, surge, key hold_out_s[1]: expected 2 entries, found 3; correct the list",
        ),
        (
            HEAD + TRIAL + 'file = "other.csv"',
            "tank.toml: line 8: file stands there for the second time; keep one of them",
        ),
        (
            HEAD + TRIAL + STAGE.replace('["surge"]', '["surge", "surge"]') + COEFFICIENTS,
            "tank.toml: stages 'surge', key trials: trial 'surge' stands twice",
        ),
        (HEAD + TRIAL + TRIAL, "tank.toml: line 9: [trials.surge] stands there for the second time"),
    ],
)
def test_what_is_empty_short_or_given_twice_is_named(text: str, words: str) -> None:
    found = refusal(text)
    assert words in found
    assert "\n" not in found


def test_all_mistakes_are_listed_at_once() -> None:
    text = HEAD + TRIAL + 'rate_hz = "10"' + STAGE + "segment_s = 0.0" + COEFFICIENTS
    lines = refusal(text).splitlines()
    assert len(lines) == 2
    assert "rate_hz" in lines[0]
    assert "segment_s" in lines[1]
