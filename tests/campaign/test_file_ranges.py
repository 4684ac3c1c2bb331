"""Numbers, names and lists of campaign and bench files have ranges, and messages say what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from seatrial.base import toml_file
from seatrial.base.errors import CampaignError
from seatrial.bench_test.file import parse as parse_bench
from seatrial.campaign.file import CampaignFile, parse

CAMPAIGN = """
format = 1
name = "trial"
vehicle = "cwolf"
seed = 1
rate_hz = 10.0
budget = { population = 16, generations = 20 }
[trials.dive]
file = "dive.csv"
[[stages]]
name = "heave"
trials = ["dive"]
axes = { free = "Z" }
segment_s = 10.0
[stages.coefficients]
Z_ww = [-1000.0, -50.0]
"""


def complaint(old: str, new: str) -> str:
    assert CAMPAIGN.count(old) == 1
    with pytest.raises(CampaignError) as caught:
        parse(CAMPAIGN.replace(old, new), "c.toml")
    return str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            "rate_hz = 10.0",
            "rate_hz = 1e9",
            "key rate_hz: expected a number from 1e-06 to 10000, found 1e+09; give",
        ),
        (
            "segment_s = 10.0",
            "segment_s = 1e-9",
            "stages 'heave', key segment_s: expected a number from 0.001",
        ),
        (
            "population = 16",
            "population = 100000000",
            "budget, key population: expected a number from 2 to 100000",
        ),
        ("[-1000.0, -50.0]", "[-1e308, -50.0]", "key Z_ww[1]: expected a number from -1e+12 to 1e+12"),
        ("seed = 1", "seed = " + "9" * 400, "key seed: expected"),
        (
            'name = "trial"',
            'name = "tr\\u001bial"',
            "key name: expected text without control characters, found U+001B",
        ),
        ('name = "trial"', f'name = "{"x" * 300}"', "expected at most 200 characters, found 300"),
        ('["dive"]', f"{['dive'] * 20_000}", "key trials: expected at most 2000 entries, found 20000"),
        ("Z_ww", '"Z_\\u0000ww"', "a key of it: expected text without control characters"),
        ("[trials.dive]", f"[trials.{'a.' * 300}b]", "tables or lists within each other"),
    ],
)
def test_what_a_campaign_may_not_hold(old: str, new: str, says: str) -> None:
    found = complaint(old, new)
    assert found.startswith("c.toml: ")
    assert says in found
    assert len(found) < 2_000


def test_a_table_may_not_be_a_list() -> None:
    assert "expected a table" in complaint('axes = { free = "Z" }', 'axes = ["Z"]')


def test_endless_files_are_refused_at_once() -> None:
    with pytest.raises(CampaignError, match="at most 2000000 characters"):
        parse(CAMPAIGN + "#" * 3_000_000, "c.toml")
    with pytest.raises(CampaignError, match="within each other"):
        parse("a = " + "[" * 50_000 + "]" * 50_000, "c.toml")


def test_bench_files_have_the_same_ranges() -> None:
    text = 'format = 1\nname = "b"\nvehicle = "cwolf"\nregression = { knots = 100000 }\n'
    text += 'pulls = [{ name = "a", file = "a.csv", group = "stern", axis = "X", settle_s = 1e7 }]\n'
    with pytest.raises(CampaignError) as caught:
        parse_bench(text, "b.toml")
    assert "pulls 'a', key settle_s: expected a number from 0 to 1e+06" in str(caught.value)
    assert "regression, key knots: expected a number from 4 to 1000" in str(caught.value)


def test_every_key_with_bounds_of_its_own_is_a_key() -> None:
    models = (Path(toml_file.__file__).parents[1]).rglob("*.py")
    source = "\n".join(path.read_text() for path in models if "Section" in path.read_text())
    for key, row in toml_file.RANGES["keys"].items():
        assert f"    {key}: " in source, key
        assert row.least < row.most
        assert row.remedy
    assert {"seed", "rate_hz"} <= set(CampaignFile.model_fields)
    # Longer units before their endings, so that m/s is no second.
    units = list(toml_file.RANGES["units"])
    for i, unit in enumerate(units):
        assert not any(unit.endswith(other) for other in units[:i])
