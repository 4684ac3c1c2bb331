"""Groups get their start gains again where everything together is better with them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from seatrial.tuning import result as module
from seatrial.tuning.result import Standing, revert_gains, standing
from tests.tuning.tuning_campaigns import plan

SPOILT = 0.02
"""Of the start gains: a heading loop this weak does not turn."""


def test_a_group_that_is_worse_than_its_start_gets_its_start_gains_again() -> None:
    one = plan()
    samples = one.samples(0, 1)
    start = one.autopilot.gains()
    spoilt = {name: SPOILT * value for name, value in start.items() if name.startswith("heading.K_P.")}
    kept, back = revert_gains(one, spoilt, samples, threads=1)
    assert back == ("heading",)
    assert all(kept[name] == start[name] for name in spoilt)
    begun, mended, spoiled = (standing(one, gains, samples, threads=1) for gains in ({}, kept, spoilt))
    assert spoiled.worse(begun) == ("heading",)
    assert mended.worse(begun) == ()
    assert mended.score < spoiled.score


def test_a_second_turn_that_spoilt_a_loop_gives_way_to_the_first() -> None:
    one = plan()
    samples = one.samples(0, 1)
    start = one.autopilot.gains()
    names = [name for name in start if name.startswith("heading.K_P.")]
    spoilt, first = ({name: factor * start[name] for name in names} for factor in (SPOILT, 1.01))
    kept, back = revert_gains(one, spoilt, samples, first={"heading": first}, threads=1)
    assert kept == first
    assert back == ()


def test_what_is_better_stays() -> None:
    one = plan()
    samples = one.samples(0, 1)
    kept, back = revert_gains(one, {}, samples, threads=1)
    assert back == ()
    assert kept == {}
    once, again = (standing(one, kept, samples, threads=threads) for threads in (1, None))
    assert once == again


GOOD = Standing({"heading": (0.0, 0.0), "surge": (0.0, 0.1)}, 0.0)


@pytest.mark.parametrize(
    ("now", "loops"),
    [
        (GOOD, ()),
        (replace(GOOD, outside_s={"heading": (0.001, 0.001), "surge": (0.0, 0.1)}), ("heading",)),
        # One sample of the drawn ones may be unlucky, by so much and no more.
        (replace(GOOD, outside_s={"heading": (0.0, 0.09), "surge": (0.0, 0.24)}), ()),
        (replace(GOOD, outside_s={"heading": (0.0, 0.11), "surge": (0.0, 0.26)}), ("heading", "surge")),
    ],
)
def test_a_loop_is_worse_when_the_vehicle_itself_is_further_outside(
    now: Standing, loops: tuple[str, ...]
) -> None:
    assert now.worse(GOOD) == loops


def told(monkeypatch: pytest.MonkeyPatch, stands: dict[frozenset[str], Standing]) -> tuple[str, ...]:
    """Groups reverted when a set of gains stands by the loops whose gains differ from the start."""
    one = plan("[tuning.loops]\nheading = {}\nsurge = {}")
    start = one.autopilot.gains()

    def stood(_plan: object, gains: dict[str, float], *_: object, **__: object) -> Standing:
        moved = {name.partition(".")[0] for name, value in gains.items() if value != start[name]}
        return stands[frozenset(moved)]

    monkeypatch.setattr(module, "standing", stood)
    found = {name: 2.0 * start[name] for name in ("heading.K_P.5", "surge.K_P.5")}
    kept, back = revert_gains(one, found, one.samples(0, 1), threads=1)
    moved = frozenset(name.partition(".")[0] for name, value in kept.items() if value != start[name])
    best = min(stands.values(), key=lambda each: (len(each.worse(stands[frozenset()])), each.score))
    if all(each.own <= stands[BOTH].own for each in stands.values()):
        assert stands[moved] == best  # found by one group after the other here
    return back


def stand(heading_s: float, surge_s: float, lacking: float = 0.0) -> Standing:
    return Standing({"heading": (heading_s, heading_s), "surge": (surge_s, surge_s)}, lacking)


BOTH, HEADING, SURGE, NONE = (
    frozenset(names) for names in (("heading", "surge"), ("heading",), ("surge",), ())
)


def test_of_two_groups_that_are_only_bad_together_none_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    # Each alone is worse still: only both at once lead back to the start.
    stands = {BOTH: stand(1.0, 1.0), HEADING: stand(2.0, 1.0), SURGE: stand(1.0, 2.0), NONE: stand(0.5, 0.5)}
    assert told(monkeypatch, stands) == ("heading", "surge")


def test_a_loop_that_is_worse_for_another_one_gets_its_start_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    stands = {BOTH: stand(0.0, 0.1), HEADING: stand(0.0, 0.0), SURGE: stand(3.0, 0.1), NONE: stand(3.0, 0.0)}
    assert told(monkeypatch, stands) == ("surge",)


def test_margins_are_not_given_up_for_a_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    unstable = stand(0.0, 0.0, lacking=4.8)
    stands = {BOTH: stand(0.02, 0.0), HEADING: stand(0.02, 0.0), SURGE: unstable, NONE: unstable}
    assert told(monkeypatch, stands) == ()
    # Unless everything together is better for it.
    stands = {BOTH: stand(9.0, 0.0), HEADING: stand(9.0, 0.0), SURGE: stand(0.0, 0.0, 0.2), NONE: unstable}
    assert told(monkeypatch, stands) == ("heading",)


def test_responses_are_not_given_up_for_margins_that_nobody_asked_for() -> None:
    start = Standing({"heading": (0.003, 0.01)}, 0.8, frozenset({("cruise", 2.4, "pitch")}), inside=2)
    traded = Standing({"heading": (0.8, 0.9)}, 0.1, inside=0)
    assert traded.worse_than(start, margins_asked=False)
    assert not traded.worse_than(start, margins_asked=True)  # a trade that the campaign invites
    assert not start.worse_than(start, margins_asked=False)
    # As many responses inside: the seconds outside decide. A motion that grows counts before all.
    assert replace(start, outside_s={"heading": (0.2, 0.2)}).worse_than(start, margins_asked=False)
    assert not traded.worse_than(replace(start, growth=0.1), margins_asked=False)


def test_what_the_vehicle_itself_keeps_to_is_not_given_up_for_a_drawn_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # With the start gains of surge no drawn vehicle tumbles, and the vehicle itself leaves its corridor.
    tumbles = Standing({"heading": (0.0, 70.0), "surge": (0.0, 0.0)}, 0.0)
    leaves = Standing({"heading": (0.0, 0.0), "surge": (2.0, 2.0)}, 0.0)
    stands = {BOTH: tumbles, HEADING: leaves, SURGE: tumbles, NONE: leaves}
    assert told(monkeypatch, stands) == ()


def test_margins_that_the_start_gains_have_are_worth_more_than_a_corridor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pitch, surge = ("cruise", 2.0, "pitch"), ("cruise", 2.0, "surge")
    lost = replace(stand(0.0, 0.0, 0.1), short=frozenset({pitch}))
    assert lost.lost(stand(0.0, 0.0)) == {pitch}
    outside = stand(0.0, 5.0)
    stands = {BOTH: lost, HEADING: outside, SURGE: lost, NONE: outside}
    assert told(monkeypatch, stands) == ("surge",)
    # Those that the start gains lack are no loss, and are not lacked again for others.
    lacking = replace(stand(0.0, 0.0, 0.5), short=frozenset({surge}))
    stands = {BOTH: lost, HEADING: lacking, SURGE: lost, NONE: lacking}
    assert told(monkeypatch, stands) == ()


def test_a_loop_is_short_where_its_margin_falls_short_by_more_than_rounding() -> None:
    one = plan("[tuning]\nmargins = { phase_deg = 0.0, gain_db = 0.0 }\n[tuning.loops.heading]")
    limits = one.margins
    assert limits is not None
    loops = module._short(limits, {})
    assert all(
        (mode, speed, loop) in loops
        for mode, speed in limits.points
        if limits.only([(mode, speed)]).growth({})[0] > 0.0
        for loop in ("surge", "heave", "pitch", "heading")
    )
    of = next(point for point in limits.margins({}) if (point.mode, point.speed_m_s) == ("cruise", 3.0))
    for loop, delay in zip(of.loops, of.of.delay_s[0], strict=True):
        assert (("cruise", 3.0, loop) in loops) == (delay < 0.99 * 0.2)
