"""What is public is documented: names, verbs, options, parameters, keys of files, columns, coefficients."""

from __future__ import annotations

import inspect
import re
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from pydantic import BaseModel

import seatrial as st
from docs.site.file_keys import tables
from docs.site.reference import command_line, key_meanings
from seatrial import _core
from seatrial.base.channels import CHANNELS
from seatrial.base.toml_file import Section
from seatrial.campaign import file as campaign_file
from seatrial.cli import app
from seatrial.control_design import tuning_table as tuning_file
from seatrial.flight import mission
from seatrial.problem import settings
from seatrial.trial.columns import CANONICAL
from seatrial.trial.corrections import KEYS as CORRECTION_KEYS
from seatrial.verification import table as verification_file
from tests.docs.pages import NAMES, ROOT, blocks, text

ASKED = (settings,)
"""What a campaign file asks of an identification."""

INTERFACE = "docs/interface.md"
ROW = re.compile(r"^\| `(\w+)` \|", re.MULTILINE)
# A field of a Rust struct of the vehicle file, its serde name first where it has one.
PARTS = (
    "vehicle_file/cross_flow_table.rs",
    "vehicle_file/fin_table.rs",
    "vehicle_file/model_error_table.rs",
    "vehicle_file/tether_table.rs",
)
FIELD = re.compile(r"(?:rename = \"(\w+)\"[^\n]*\n\s*)?(?:pub )?(\w+): (?!Self)[A-Z\[fbu]")
# A public Rust struct that is read from a file: its body.
READ = re.compile(
    r"^#\[derive\([^)]*\bDeserialize\b[^)]*\)\]\n(?:#\[[^\n]*\]\n)*pub struct \w+ \{\n(.*?)^\}",
    re.MULTILINE | re.DOTALL,
)


@pytest.mark.parametrize("name", st.__all__)
def test_every_public_name_is_in_the_documentation(name: str) -> None:
    assert f"st.{name}" in text(INTERFACE)


def _verbs() -> dict[str, Any]:
    found: dict[str, Any] = getattr(typer.main.get_command(app), "commands")  # noqa: B009
    return found


@pytest.mark.parametrize("verb", _verbs())
def test_every_verb_and_option_says_what_it_does_in_the_generated_reference(verb: str) -> None:
    section = command_line().split(f"## `{verb}`\n")[1].split("\n## ")[0]
    for parameter in _verbs()[verb].params:
        assert parameter.help, f"{verb}: {parameter.name}"
        for option in (*parameter.opts, *parameter.secondary_opts):
            if option.startswith("--") and not parameter.hidden:
                assert option in section, f"{verb}: {option}"


def _callables() -> Iterator[tuple[str, Any, str]]:
    """Public functions, classes and methods with the text that may document their parameters."""
    for name in st.__all__:
        thing = getattr(st, name)
        own = inspect.getdoc(thing) or ""
        if not (inspect.isclass(thing) and issubclass(thing, Exception)):
            yield name, thing, own
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for member in vars(thing):
                method = getattr(thing, member)
                if not member.startswith("_") and callable(method):
                    yield f"{name}.{member}", method, f"{inspect.getdoc(method)}\n{own}"


@pytest.mark.parametrize(
    ("name", "thing", "doc"), [pytest.param(*found, id=found[0]) for found in _callables()]
)
def test_every_parameter_is_documented(name: str, thing: Any, doc: str) -> None:
    # The compiled core's parameters may be documented on the page instead.
    page = text(INTERFACE) if name.partition(".")[0] in _core.__all__ else ""
    for parameter in inspect.signature(thing).parameters:
        if parameter not in ("self", "cls"):
            shown = re.search(rf"\b{parameter}\b", doc) or re.search(rf"`[^`\n]*\b{parameter}\b", page)
            assert shown, f"{name}: {parameter}"


def _sections() -> Iterator[type[BaseModel]]:
    for module in (campaign_file, *ASKED, tuning_file, verification_file):
        for thing in vars(module).values():
            if inspect.isclass(thing) and issubclass(thing, Section):
                yield thing


def test_every_key_of_the_campaign_file_has_a_meaning_in_the_generated_page() -> None:
    known = {field for section in _sections() for field in section.model_fields}
    assert {"stages", "rise_s", "heading_deg", "delay_s", "requirements", "weibull"} <= known
    for section in _sections():
        if section.__name__ in ("MixerTable", "StickTable", "OutputTable"):  # they stand on the page by hand
            assert set(section.model_fields) <= set(
                re.findall(r"`(?:\w+\.)*(\w+)", text("docs/campaign-file.md"))
            )
            continue
        meanings = key_meanings(section)
        assert {field for field in section.model_fields if len(meanings.get(field, "")) < 5} == set(), section
    assert set(CORRECTION_KEYS) <= set(ROW.findall(text("docs/campaign-file.md")))


def test_keys_of_the_vehicle_file_are_those_of_its_generated_page() -> None:
    known: set[str] = set()
    for source in ("vehicle_file.rs", *PARTS, "geometry.rs"):
        code = (ROOT / "crates" / "seatrial" / "src" / "description" / source).read_text(encoding="utf-8")
        code = re.sub(r"//.*", "", code)
        for body in re.findall(r"^pub (?:struct|enum) \w+ \{\n(.*?)^\}", code, re.MULTILINE | re.DOTALL):
            known |= {renamed or field for renamed, field in FIELD.findall(body)}
    assert {"format", "T_1_s", "force_n", "arm_m"} <= known
    assert _generated("vehicle") == known


def _generated(file: str) -> set[str]:
    """Keys of the generated page of a file, each with a meaning."""
    keys = [key for table in tables(file) for key in table.keys]
    assert all(len(key.meaning) > 4 and key.type for key in keys)
    return {key.name for key in keys}


def _keys_of_rust(*sources: str) -> set[str]:
    """Keys of the structs that are read from a file, with their names there."""
    known: set[str] = set()
    for source in sources:
        code = (ROOT / "crates" / "seatrial" / "src" / source).read_text(encoding="utf-8")
        for body in READ.findall(re.sub(r"//.*", "", code)):
            known |= {renamed or field for renamed, field in FIELD.findall(body)}
    return known


def test_keys_of_the_mission_file_are_those_of_its_pages() -> None:
    known = _keys_of_rust("mission/file.rs", "mission/legs.rs")
    marks = (ROOT / "crates" / "seatrial" / "src" / "mission" / "landmarks.rs").read_text(encoding="utf-8")
    known |= set(re.findall(r"^ {8}(\w+): (?:f64|String),$", marks, flags=re.MULTILINE))
    assert {"format", "hold_s", "corners_m", "latitude_deg", "facing_deg"} <= known
    assert _generated("mission") == known
    assert set(ROW.findall(text("docs/mission-file.md"))) == {*mission.PLACE, *mission.CORNERS}


def test_keys_of_the_autopilot_file_are_those_of_its_generated_page() -> None:
    files = (
        "autopilot/file",
        "guidance/table",
        "allocation/table",
        "safety/table",
        "contradiction",
        "lqr/table",
    )
    known = _keys_of_rust(*(f"control/{file}.rs" for file in files))
    assert {"format", "K_I_per_s", "lookahead_m", "fin_inflow", "after_s", "tracking_s"} <= known
    assert _generated("autopilot") == known


def test_defaults_of_the_autopilot_file_are_those_of_its_generated_page() -> None:
    least = next(block.text for block in blocks("docs/autopilot-file.md") if block.language == "toml")
    written = tomllib.loads(st.Autopilot.from_toml(least).to_toml())
    written["safety.contradiction"] = written["safety"]["contradiction"]
    compared = 0
    for table in tables("autopilot"):
        for key in table.keys:
            section = written.get(table.name.strip("`[]"))
            value = section.get(key.name) if isinstance(section, dict) else None
            if isinstance(value, int | float | str):
                assert tomllib.loads(f"x = {key.default.strip('`')}")["x"] == value, key
                compared += 1
    assert compared > 40


def test_every_column_channel_and_coefficient_is_in_the_conventions() -> None:
    page = text("docs/conventions.md")
    for column in CANONICAL:
        assert f"`{column}`" in page, column
    assert " ".join(CHANNELS) in page
    polynomial = st.Vehicle.load(ROOT / "tests" / "core" / "every_term.toml")
    for vehicle in (st.Vehicle.load("cwolf"), polynomial):
        for name in vehicle.coefficient_info():
            short = name.partition(".")[2] or name
            off_diagonal = re.fullmatch(r"[XYZKMN]_(?:[uvwpqr]dot|([uvwpqr])\1?)", short)
            assert f"`{short}`" in page or off_diagonal, name


def test_the_index_leads_to_every_page() -> None:
    index = text("docs/index.md")
    for name in NAMES:
        if name.startswith("docs/") and name != "docs/index.md":
            assert f"({name.removeprefix('docs/')})" in index, name
