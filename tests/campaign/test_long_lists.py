"""Files with many thousand entries are answered in time that grows with their length, not with its square."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from seatrial.base.errors import CampaignError, VehicleError
from seatrial.bench_test.file import parse as parse_bench
from seatrial.campaign.file import CampaignFile, parse
from seatrial.flight.mission import Mission
from seatrial.problem.settings import in_order
from seatrial.verification.table import parse_verification

HEAD = 'format = 1\nname = "long"\nvehicle = "cwolf"\n'
STAGE = (
    '[[stages]]\nname = "s{k}"\ntrials = ["there"]\naxes = {{ free = "X", measured = "YZKMN" }}\n'
    'coefficients = {{ X_uu = "default" }}\n'
)
MISSION = (
    'format = 1\nname = "long"\nspeed_m_s = 1.0\nacceptance_radius_m = 3.0\n'
    "origin = { latitude_deg = 63.8, longitude_deg = 8.9 }\n"
    "start = { latitude_deg = 63.8, longitude_deg = 8.9 }\n"
)
MANY = 2000

STAGES = 960


def least_s(work: Callable[[], Any], *, runs: int = 5) -> float:
    """Processor time of the fastest run, s: what the collector or a neighbour takes is not the work's."""
    spent = []
    collects = gc.isenabled()
    gc.disable()
    try:
        for _ in range(runs):
            begun = time.process_time()
            work()
            spent.append(time.process_time() - begun)
    finally:
        if collects:
            gc.enable()
    return min(spent)


def stages(afters: list[str]) -> str:
    text = HEAD + 'trials.there.file = "log.csv"\n'
    return text + "".join(STAGE.format(k=k) + after for k, after in enumerate(afters))


def campaign(count: int) -> CampaignFile:
    """Stages of which each waits for the one that follows it in the file."""
    afters = [f'after = ["s{k + 1}"]\n' if k + 1 < count else "" for k in range(count)]
    return parse(stages(afters), "long.toml")


def test_the_order_of_many_stages_takes_linear_time() -> None:
    files = {count: campaign(count).stages for count in (STAGES // 8, STAGES)}
    spent = {}
    for count, given in files.items():
        ordered = in_order(given, "long.toml")
        assert [stage.name for stage in ordered] == [f"s{k}" for k in reversed(range(count))]
        spent[count] = least_s(partial(in_order, given, "long.toml"))
    assert spent[STAGES] < 30.0 * spent[STAGES // 8] + 0.02  # 64 times with the square


def test_more_stages_than_can_be_planned_are_refused() -> None:
    with pytest.raises(CampaignError, match=r"at most 1000 \[\[stages\]\], found 1001"):
        campaign(1001)


def test_stages_keep_the_order_of_the_file_where_nothing_waits() -> None:
    given = parse(stages(["", 'after = ["s3"]\n', "", "", 'after = ["s1", "s0"]\n']), "long.toml").stages
    names = [stage.name for stage in in_order(given, "long.toml")]
    assert names == ["s0", "s2", "s3", "s1", "s4"]


def test_stages_that_wait_for_one_another_are_named() -> None:
    given = parse(stages(['after = ["s1"]\n', 'after = ["s0"]\n', ""]), "long.toml").stages
    with pytest.raises(CampaignError, match="the stages 's0', 's1' wait for one another"):
        in_order(given, "long.toml")


def named_entries(kind: str, count: int) -> None:
    if kind == "pulls":
        pull = '[[pulls]]\nname = "p{k}"\nfile = "log.csv"\ngroup = "stern"\naxis = "X"\n'
        parse_bench(HEAD + "".join(pull.format(k=k) for k in range(count)), "bench.toml")
    elif kind == "geographic legs":
        leg = '{ latitude_deg = 63.8, longitude_deg = 8.9, depth_m = 5.0, label = "x" }'
        with pytest.raises(VehicleError, match="expected a table, found array"):
            Mission.from_toml(MISSION + f"legs = [[{', '.join([leg] * count)}]]")
    elif kind == "missions":
        missions = ", ".join(f'"m{k}.toml"' for k in range(count))
        parse_verification(f"[verification]\nmissions = [{missions}]\n", "long.toml")
    else:
        table = '[[verification.requirements]]\nname = "r{k}"\nholds = "complete"\n'
        text = '[verification]\nmissions = ["m.toml"]\n'
        parse_verification(text + "".join(table.format(k=k) for k in range(count)), "long.toml")


@pytest.mark.parametrize("kind", ["pulls", "requirements", "missions", "geographic legs"])
def test_names_are_compared_in_linear_time(kind: str) -> None:
    few, many = (least_s(partial(named_entries, kind, count), runs=2) for count in (MANY // 8, MANY))
    assert many < 30.0 * few + 0.05


def test_a_name_that_stands_twice_is_still_refused(tmp_path: Path) -> None:
    text = stages(["", ""]).replace('"s1"', '"s0"')
    with pytest.raises(CampaignError, match="two stages are called 's0'"):
        in_order(parse(text, str(tmp_path)).stages, "long.toml")
