"""The bench file: what it refuses and how it says so, what holds where it says nothing."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

from docs.site.reference import model_tables
from seatrial.base.errors import CampaignError
from seatrial.base.toml_file import Section
from seatrial.bench_test import file as bench_file
from seatrial.bench_test.evaluate import bench
from seatrial.bench_test.file import parse
from tests.bench_test.bench_records import both_ways, pull, write_bench

HEAD = 'format = 1\nname = "basin"\nvehicle = "cwolf"\n'
PULL = pull("ahead")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("format = 1\n[", "not a TOML file"),
        (HEAD, "holds no test; add [[pulls]]"),
        (HEAD.replace("= 1", "= 2", 1) + PULL, "key format: expected 1, found 2"),
        (PULL, "key vehicle: this key is required and missing"),
        (HEAD + "vehicel = 3\n" + PULL, "unknown key 'vehicel'; did you mean \"vehicle\"?"),
        (HEAD + PULL + "setle_s = 3.0\n", "pulls 'ahead': unknown key 'setle_s'; did you mean \"settle_s\"?"),
        (HEAD + PULL + "settle_s = -1.0\n", "settle_s: expected greater than or equal to 0"),
        (HEAD + PULL + 'actuators = ["SbU"]\n', "give what was driven, either group"),
        (HEAD + PULL.replace('group = "stern"\n', ""), "give what was driven, either group"),
        (HEAD + PULL + 'direction = "ahead"\n', 'give the load, either axis = "X"'),
        (HEAD + PULL.replace('axis = "X"\n', ""), 'give the load, either axis = "X"'),
        (HEAD + PULL.replace('"X"', '"K"'), "axis holds letters of XYZ, each once, found 'K'"),
        (HEAD + PULL.replace('"X"', '"XX"'), "each once, found 'XX'"),
        (HEAD + PULL + 'use = "meas"\n', "key use: expected 'command' or 'measured', found 'meas'"),
        (HEAD + PULL + 'sign_of = { column = "pwm" }\n', 'it needs use = "measured"'),
        (HEAD + PULL + PULL, "two pulls are called 'ahead'; rename one"),
        (HEAD + PULL + "[regression]\norder = 4\n", "key order"),
        (
            HEAD + PULL + '[regression]\ninputs = ["voltage"]\n',
            'inputs is ["signal"] or ["signal", "voltage"]',
        ),
        (HEAD + PULL + '[regression]\norder = 2\nkind = "quadratic"\n', 'it needs order = "square"'),
        (HEAD + PULL + '[regression]\norder = 3\nkind = "polynomial"\n', "ends at order 2, found 3"),
        (
            HEAD + PULL + '[regression]\nkind = "polynomial"\ninputs = ["signal", "voltage"]\n',
            'knows no voltage; use kind = "table"',
        ),
        (
            HEAD + PULL + '[regression]\norder = "square"\ninputs = ["signal", "voltage"]\n',
            "knows the signal only",
        ),
        (
            HEAD + PULL + '[regression]\norder = "points"\nkind = "polynomial"\n',
            "makes a table; leave kind out",
        ),
        (HEAD + PULL + '[regression]\noutlier = "keep"\n', 'did you mean "outliers"?'),
        (HEAD + "rho_kg_m3 = 0.0\n" + PULL, "rho_kg_m3: expected greater than or equal to 500"),
    ],
)
def test_what_a_bench_file_may_not_hold_is_refused_in_words(text: str, words: str) -> None:
    with pytest.raises(CampaignError, match=r"basin\.toml") as refusal:
        parse(text, "basin.toml")
    assert words in str(refusal.value)


def test_a_regression_of_one_group_goes_before_that_of_all_and_that_before_the_default() -> None:
    file = parse(
        HEAD
        + PULL
        + '[regression]\nthrough_origin = true\norder = 1\n[regressions.stern]\norder = "square"\n',
        "basin.toml",
    )
    stern, other = file.regression_of("stern"), file.regression_of("vertical")
    assert (stern.order, stern.through_origin, stern.outliers) == ("square", True, "drop")
    assert (other.order, other.through_origin, other.inputs) == (1, True, ("signal",))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('group = "stern"', 'group = "sterm"', "unknown group 'sterm'; did you mean \"stern\"?"),
        ('group = "stern"', 'actuators = ["SbX"]', "unknown thruster 'SbX'; did you mean \"SbU\"?"),
        ('"ahead.csv"', '"gone.csv"', "there is no file"),
        ('"ahead.csv"', '"${NO_SUCH_PLACE}/ahead.csv"', "environment variable NO_SUCH_PLACE is not set"),
        ('vehicle = "cwolf"', 'vehicle = "none.toml"', "none.toml"),
    ],
)
def test_what_a_bench_file_names_must_be_there(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = both_ways(tmp_path)
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ValueError, match=r"\.toml") as refusal:
        bench(path)
    assert words in str(refusal.value)


def test_a_regression_of_a_group_that_is_not_pulled_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match=r'key stirn: no pull tests it; did you mean "stern"\?'):
        bench(both_ways(tmp_path, more="[regressions.stirn]\norder = 1\n"))


def test_actuators_of_a_pull_are_not_tested_under_two_names(tmp_path: Path) -> None:
    path = both_ways(tmp_path)
    path.write_text(path.read_text().replace('group = "stern"', 'actuators = ["SbU", "SbL"]', 1))
    with pytest.raises(CampaignError, match=r"SbL, SbU is also tested as SbU\+SbL"):
        bench(path)


def test_actuators_of_steps_are_not_tested_under_two_names(tmp_path: Path) -> None:
    text = "".join(
        f'[[steps]]\nname = "{name}"\nfile = "ahead.csv"\n{driven}\n'
        for name, driven in (("alone", 'actuators = ["SbU"]'), ("all", 'group = "stern"'))
    )
    path = both_ways(tmp_path)
    path.write_text(path.read_text() + text)
    # Whichever came later in the file would replace the other's motor.
    with pytest.raises(CampaignError, match="steps 'all': SbU is also tested as SbU"):
        bench(path)


def test_a_missing_bench_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="not readable as a bench file"):
        bench(tmp_path / "none.toml")
    assert write_bench(tmp_path, PULL).is_file()


def test_every_key_of_the_bench_file_has_a_meaning_in_the_generated_page() -> None:
    page = model_tables("bench", bench_file.BenchFile)
    rows = re.findall(r"^\| `(\w+)` \| [^|]+ \| [^|]* \| ([^|]*) \|$", page.replace("\\|", ""), re.MULTILINE)
    sections = [
        thing
        for thing in vars(bench_file).values()
        if inspect.isclass(thing) and issubclass(thing, Section) and thing is not Section
    ]
    assert {key for key, meaning in rows if meaning} == {
        field for section in sections for field in section.model_fields
    }
