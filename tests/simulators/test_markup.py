"""XML without trust: what a hostile file can declare, how deep and long it may be, and expressions of
xacro.
"""

from __future__ import annotations

import pytest

from seatrial.base.errors import VehicleError
from seatrial.simulators.markup import expanded, numbers, parse, read_bytes

LAUGHS = b"""<?xml version="1.0"?>
<!DOCTYPE lolz [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
<sdf>&b;</sdf>"""


@pytest.mark.parametrize(
    "content",
    [
        LAUGHS,
        LAUGHS.decode().replace("utf-8", "utf-16").encode("utf-16"),
        b'<!DOCTYPE a SYSTEM "file:///etc/passwd"><a/>',
        b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>',
    ],
)
def test_declarations_are_refused_in_every_encoding(content: bytes) -> None:
    with pytest.raises(VehicleError, match=r"without a document type and entities"):
        parse(content, "bad.sdf")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "expected XML"),
        (b"<a>", "expected XML"),
        (b"\x00\x01\x02", "expected XML"),
        (b"<a>&unknown;</a>", "expected XML"),
        (b"<a>" * 200 + b"</a>" * 200, "100 deep"),
        (b"<r>" + b"<a/>" * 100_001 + b"</r>", "at most 100000 elements"),
    ],
)
def test_what_is_no_model_is_refused(content: bytes, words: str) -> None:
    with pytest.raises(VehicleError, match=words):
        parse(content, "bad.sdf")


def test_large_and_missing_files_are_refused(tmp_path: object) -> None:
    from pathlib import Path

    path = Path(str(tmp_path)) / "big.sdf"
    path.write_bytes(b" " * 5_000_001)
    with pytest.raises(VehicleError, match="at most 5 MB"):
        read_bytes(path)
    with pytest.raises(VehicleError, match="cannot be read"):
        read_bytes(path.with_name("none.sdf"))


def _expression(text: str, properties: str = "") -> str:
    root = parse(f"<robot>{properties}<v>{text}</v></robot>".encode(), "robot.xacro")
    return expanded(root, "robot.xacro")[-1].text or ""


def test_expressions_are_worked_out_from_the_properties() -> None:
    given = '<property name="r" value="0.5"/><property name="area" value="${pi*r*r}"/>'
    assert float(_expression("${2*area}", given)) == pytest.approx(1.5707963267948966)
    assert _expression("${-(r + 1) / 2} 0 ${r}", given) == "-0.75 0 0.5"
    # A name from another file stays; the number that it should be is then missing.
    assert _expression("${volume}") == "${volume}"
    with pytest.raises(VehicleError, match="expand the file with xacro first"):
        numbers(_expression("${volume}"), "volume")


@pytest.mark.parametrize("text", ["${1/0}", "${9**9**9}", "${(1).real}", "${[1]*3}", "${1;2}", "${'a'*9}"])
def test_expressions_of_anything_but_arithmetic_are_refused(text: str) -> None:
    with pytest.raises(VehicleError, match="plain arithmetic"):
        _expression(text)


def test_calls_are_never_made() -> None:
    text = "${__import__('os').system('true')}"
    assert _expression(text) == text


def test_properties_in_a_circle_end() -> None:
    given = '<property name="a" value="${b} 1"/><property name="b" value="${a} 1"/>'
    with pytest.raises(VehicleError, match="in a circle"):
        _expression("${a}", given)


LONG = "x" * 100_000


@pytest.mark.parametrize(
    ("properties", "text"),
    [
        ([LONG], "${p0}" * 100_000),
        ([LONG], "</v><v>".join(["${p0}"] * 1_000)),
        ([LONG, *(f"${{p{k}}}${{p{k}}}" for k in range(60))], "${p60}"),
        (["1"], "${p0 + 1}" * 20_001),
        (["1"], "</v><v>".join(["${p0 + unknown}"] * 20_001)),
    ],
    ids=["often", "in many places", "doubled", "expressions", "unknown names"],
)
def test_properties_that_multiply_a_file_are_refused(properties: list[str], text: str) -> None:
    rows = "".join(f'<property name="p{k}" value="{value}"/>' for k, value in enumerate(properties))
    with pytest.raises(VehicleError, match="expected properties that make a model of at most 5 MB"):
        _expression(text, rows)
