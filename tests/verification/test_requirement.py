"""Requirements: the grammar refuses what it must, three-valued truth, reserves that tell what was held."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seatrial.base.errors import CampaignError
from seatrial.flight.mission import Mission
from seatrial.verification.expression import CALLS, KNOWN, Metric, parse, unit_of
from seatrial.verification.requirement import Judgement, Requirement, default_requirements
from seatrial.verification.table import parse_verification
from tests.flight.flying import flown

NAN, INF = math.nan, math.inf
FLOWN: dict[str, Any] = {
    "cross_track_p95_m": [0.4, 1.5, NAN],
    "depth_excursion_m": [0.2, 0.7, NAN],
    "energy_wh": [50.0, 120.0, NAN],
    "distance_m": [1000.0, 1000.0, NAN],
    "ending": ["complete", "aborted", "diverged"],
    "abort": [False, True, False],
}


def judged(holds: str, **metrics: Any) -> Judgement:
    return Requirement("r", holds).judge(metrics or FLOWN)


@pytest.mark.parametrize(
    ("holds", "held", "reserve", "unit"),
    [
        ("cross_track_p95_m <= 1.0", [True, False, False], [0.6, -0.5, -INF], "m"),
        ("1 >= cross_track_p95_m", [True, False, False], [0.6, -0.5, -INF], "m"),
        ('ending == "complete"', [True, False, False], [INF, -INF, -INF], ""),
        ('ending != "complete"', [False, True, True], [-INF, INF, INF], ""),
        ('ending == "complete" and depth_excursion_m < 0.5', [True, False, False], [0.3, -INF, -INF], "m"),
        ("energy_wh / distance_m < 0.1", [True, False, False], [0.05, -0.02, -INF], "Wh/m"),
        ("not abort", [True, False, True], [INF, -INF, INF], ""),
        ("0.1 < depth_excursion_m <= 0.5", [True, False, False], [0.1, -0.2, -INF], "m"),
        ("max(cross_track_p95_m, 2 * depth_excursion_m) <= 1", [True, False, False], [0.6, -0.5, -INF], "m"),
        ("sqrt(abs(-distance_m * distance_m)) >= 10 ** 3", [True, True, False], [0.0, 0.0, -INF], ""),
        ("cross_track_p95_m <= 1 or depth_excursion_m < 1", [True, True, False], [0.8, 0.3, -INF], "m"),
        # Metres and watt-hours: shares of the thresholds.
        (
            "cross_track_p95_m <= 1 and energy_wh <= 100",
            [True, False, False],
            [0.5, -0.5, -INF],
            "of the threshold",
        ),
    ],
)
def test_a_requirement_tells_what_held_and_by_how_much(
    holds: str, held: list[bool], reserve: list[float], unit: str
) -> None:
    found = judged(holds)
    assert found.held.tolist() == held
    # One subtraction of numbers of the order of the threshold.
    assert found.reserve == pytest.approx(reserve, abs=1e-12)
    assert found.unit == unit
    assert found.failures == held.count(False)


@pytest.mark.parametrize(
    "holds",
    [
        "cross_track_p95_m <= 1",
        "not (cross_track_p95_m > 1)",
        "not not (cross_track_p95_m <= 1)",
        "cross_track_p95_m != 3",
        "0 / (cross_track_p95_m - cross_track_p95_m) <= 1",
        "min(cross_track_p95_m, 3) < 4",
        'not (cross_track_p95_m > 1 and ending == "complete")',
        "cross_track_p95_m < 1 or cross_track_p95_m >= 1",
    ],
)
def test_a_flight_without_a_figure_does_not_hold_what_rests_on_it(holds: str) -> None:
    found = judged(holds, cross_track_p95_m=[NAN], ending=["complete"])
    assert found.held.tolist() == [False]
    assert found.reserve.tolist() == [-INF]


def test_what_holds_without_the_missing_figure_holds() -> None:
    assert judged('ending == "diverged" or cross_track_p95_m < 1').held.tolist() == [True, False, True]
    assert judged("altitude_smallest_m > 2", altitude_smallest_m=[INF]).held.tolist() == [True]


COMPARISONS = st.builds(
    "{} {} {}".format,
    st.sampled_from(["a_m", "b_m", "(a_m + b_m)", "abs(a_m)", "2.0"]),
    st.sampled_from(["<", "<=", ">", ">="]),
    st.sampled_from(["a_m", "b_m", "max(a_m, b_m)", "1.0", "-3.0"]),
).filter(lambda text: "m" in text)
CONDITIONS = st.recursive(
    COMPARISONS,
    lambda inner: (
        st.builds("({} and {})".format, inner, inner)
        | st.builds("({} or {})".format, inner, inner)
        | st.builds("(not {})".format, inner)
    ),
    max_leaves=6,
)
VALUES = st.lists(st.sampled_from([-4.0, -1.0, 0.0, 0.5, 1.0, 2.0, 7.5]), min_size=3, max_size=3)


@given(CONDITIONS, VALUES, VALUES)
def test_law_holds_as_python_says_and_the_reserve_has_its_sign(
    holds: str, a: list[float], b: list[float]
) -> None:
    found = judged(holds, a_m=a, b_m=b)
    for place, (one, two) in enumerate(zip(a, b, strict=True)):
        expected = eval(holds, {"__builtins__": {}}, {"a_m": one, "b_m": two, "abs": abs, "max": max})
        assert found.held[place] == expected
        assert found.reserve[place] >= 0.0 if expected else found.reserve[place] <= 0.0


@given(CONDITIONS)
def test_law_a_flight_without_figures_holds_nothing(holds: str) -> None:
    alone = "(a_m < 1) and " + holds
    assert not judged(alone, a_m=[NAN], b_m=[NAN]).held[0]
    assert not judged(f"not ({alone})", a_m=[NAN], b_m=[NAN]).held[0]


@pytest.mark.parametrize(
    ("holds", "words"),
    [
        (
            "cross_trak_p95_m < 1",
            '"cross_trak_p95_m" is no metric of a mission; did you mean "cross_track_p95_m"?',
        ),
        (
            "cross_track < 1",
            '; did you mean "cross_track_rms_m", "cross_track_p99_m" or "cross_track_p95_m"?',
        ),
        ("depth < 1", '; did you mean "depth_excursion_m", "depth_largest_m" or "depth_smallest_m"?'),
        (
            "fog < 1",
            "; known: duration_s, distance_m, energy_wh, cross_track_rms|largest|p50|p95|p99_m, true_",
        ),
        ("ending == complete", 'write the word in quotes, ending == "complete"'),
        ("ending < 3", "a word cannot be compared with a number"),
        ('ending < "complete"', "words have no order"),
        ('ending == "completed"', 'ending is never "completed"; did you mean "complete"?'),
        ('ending = "complete"', 'write "==" in place of "="'),
        ("abort || duration_s < 3", 'write "or" in place of "||"'),
        ("duration_s < = 3", 'write "<=" in place of "< ="'),
        ("duration_s = = 3", 'write "==" in place of "= ="'),
        ("duration_s => 3", 'write ">=" in place of "=>"'),
        ("duration_s =< 3", 'write "<=" in place of "=<"'),
        ("duration_s <> 3", 'write "!=" in place of "<>"'),
        ("duration_s \N{LESS-THAN OR EQUAL TO} 3", 'write "<=" in place of'),
        ("!abort", 'write "not" in place of "!"'),
        ('ending == "x = y" and duration_s < = 3', 'write "<=" in place of "< ="'),
        ("duration_s < 2,5", "the decimal mark is a point"),
        ("abort < 1", 'write "abort" or "not abort"'),
        ("abort == True", 'say "abort" or "not abort"'),
        ("cross_track_p95_m", 'such as "cross_track_p95_m <= 1.0"'),
        ("duration_s + abort < 3", "expected a number, found the truth value abort"),
        ("duration_s and abort", "expected a comparison, found the number duration_s"),
        ("1 < 2", "names no metric"),
        ("", "found nothing"),
        ("cross_track_p95_m < 1 m", 'at "m" (character 23)'),
        ("duration_s < 5 ^ 2", 'a power is "**"'),
        ("duration_s < 1e999", "expected finite numbers"),
        ("duration_s < 1" + "0" * 400, "expected finite numbers"),
        ("duration_s <= 1/0", '"1 / 0" divides by zero; correct the number'),
        ("duration_s / (2 - 2) <= 1", "divides by zero"),
        ("duration_s <= sqrt(-1)", '"sqrt(-1)" is nan; expected a finite number'),
        ("duration_s <= 5 or duration_s < 1e200 * 1e200", '"1e+200 * 1e+200" is inf'),
        ("duration_s < -(10 ** 400)", '"10 ** 400" is inf'),
        ("duration_s < 1j", '"1j" is not allowed'),
        ("max(duration_s) < 5", "max: expected at least two values"),
        ("abs(duration_s, 1) < 5", "abs: expected one value"),
        ("mx(duration_s, 1) < 5", 'did you mean "max"?'),
        ("-" * 400 + "duration_s < 1", "nested more than 40 deep"),
        ("duration_s < 1" + " " * 400 + "or not abort" * 20, "at most 500 characters"),
    ],
)
def test_what_cannot_be_judged_is_refused_with_a_sentence(holds: str, words: str) -> None:
    with pytest.raises(CampaignError, match=re.escape(words)) as refused:
        Requirement("keeps its path", holds).check()
    assert str(refused.value).startswith('requirement "keeps its path": holds: ')


def test_a_figure_that_is_near_is_named_alone() -> None:
    with pytest.raises(CampaignError) as refused:
        Requirement("r", "cross_track_p95 < 1").check()
    assert str(refused.value).endswith('no metric of a mission; did you mean "cross_track_p95_m"?')


@pytest.mark.parametrize(
    "code",
    [
        '__import__("os").system("true")', "duration_s.real < 1", "(lambda: 1)() < duration_s",
        "[x for x in (1, 2)] == 3", "duration_s if abort else 1", 'f"{abort}" == ending', "{1: 2}",
        "duration_s[0] < 1",
        "(duration_s := 3) < 4", "max(*duration_s, 1) < 3", "abs(x=duration_s) < 3", "ending in (1, 2)",
        "duration_s is 3", "duration_s // 2 < 1", "duration_s % 2 < 1", "~abort", "...", "await abort",
        'b"x" == ending',
    ],
)  # fmt: skip
def test_nothing_but_the_grammar_is_let_in(code: str) -> None:
    with pytest.raises(CampaignError):
        parse(code)


@given(st.text(max_size=60) | st.text("abs(duration_s)<=>!~1.e9+-*/\"' andornot", max_size=60))
def test_law_any_text_is_judged_or_refused(text: str) -> None:
    try:
        found = Requirement("any", text).judge({"duration_s": [1.0, NAN], "abort": [True, False]})
    except CampaignError:
        return
    assert found.held.shape == found.reserve.shape == (2,)


@pytest.mark.parametrize("probability", [0.0, 1.0, -0.1, 1.5, NAN])
def test_a_share_that_no_sample_can_show_is_refused(probability: float) -> None:
    with pytest.raises(CampaignError, match="above 0 and below 1"):
        Requirement("never fails", "not abort", probability)


def test_the_worst_come_first_the_unjudged_before_them() -> None:
    found = judged("a_m <= 1", a_m=[0.5, 3.0, NAN, 0.9, 1.2])
    assert found.worst(4).tolist() == [2, 1, 4, 3]
    assert judged("not abort", abort=[False, True, False, True]).worst(3).tolist() == [1, 3, 0]
    # At the threshold itself both have no reserve: the one that failed is the worse.
    edge = judged("a_m < 1 and b_m <= 2", a_m=[0.5, 1.0], b_m=[2.0, 1.0])
    assert (edge.held.tolist(), edge.reserve.tolist()) == ([True, False], [0.0, 0.0])
    assert edge.worst(2).tolist() == [1, 0]


def test_equal_infinities_have_no_distance() -> None:
    found = judged("a_m >= b_m", a_m=[INF, INF], b_m=[INF, 3.0])
    assert (found.held.tolist(), found.reserve.tolist()) == ([True, True], [0.0, INF])


def test_a_requirement_knows_its_figures_before_anything_flies() -> None:
    made = Requirement("r", "abs(energy_wh) < 3 * distance_m and energy_wh > 0", 0.995)
    assert made.metrics == ("energy_wh", "distance_m")
    assert made.allowed == pytest.approx(0.005)
    made.check()
    with pytest.raises(CampaignError, match="energy_wh"):
        made.check({"distance_m": Metric()})


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("cross_track_p95_m", "m"),
        ("-cross_track_p95_m / 2", "m"),
        ("max(roll_largest_deg, pitch_largest_deg)", "deg"),
        ("duration_s - energy_wh", ""),
        ("depth_excursion_m / depth_largest_m", ""),
        ("1 / duration_s", "1/s"),
        ("travel_per_s * duration_s", "1/s s"),
        ("distance_m ** 2", ""),
        ("3 + 2", None),
    ],
)
def test_units_come_from_the_names(text: str, unit: str | None) -> None:
    assert unit_of(parse(text)) == unit


def test_the_figures_of_a_flight_are_known() -> None:
    numbers = {name for name, values in flown().metrics.items() if isinstance(values, float)}
    assert numbers - {"ending", "alert", "alert_cause"} <= set(KNOWN)
    assert set(CALLS) == {"abs", "min", "max", "sqrt"}


def test_missions_that_only_dive_are_not_asked_for_a_course() -> None:
    table = parse_verification('[verification]\nmissions = ["dive.toml"]', "campaign.toml")
    leg = '[[legs]]\nkind = "waypoint"\nlabel = "{0}"\nnorth_m = {1}\neast_m = 0.0\ndepth_m = {2}\n'
    head = 'format = 1\nname = "dive"\nspeed_m_s = 0.4\nacceptance_radius_m = 2.0\n'
    dive = Mission.from_toml(head + leg.format("down", 0.0, 4.0) + leg.format("up", 3.0, 1.0))
    line = Mission.from_toml(head + leg.format("out", 30.0, 4.0))
    assert [one.holds for one in default_requirements(table, [dive])][1] == "depth_excursion_m <= 2"
    assert [one.holds for one in default_requirements(table, [line])][1] == "true_cross_track_p95_m <= 2"
    assert [one.holds for one in default_requirements(table, [line, dive])][1] == "depth_excursion_m <= 2"
