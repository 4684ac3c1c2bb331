"""Keys of vehicle, autopilot and mission files, read from the Rust structs that own these files.

A key's meaning is the comment of its field, its default that of serde: `Default`, a named function, or none.
Held by ``tests/docs/test_public_names.py``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

SUFFIX = ".md"
SOURCES = Path(__file__).resolve().parents[2] / "crates" / "seatrial" / "src"

FILES = {
    "vehicle": (
        "description/vehicle_file.rs",
        "description/geometry.rs",
        "description/vehicle_file/cross_flow_table.rs",
        "description/vehicle_file/tether_table.rs",
        "description/vehicle_file/model_error_table.rs",
        "description/vehicle_file/fin_table.rs",
    ),
    "autopilot": (
        "control/autopilot/file.rs",
        "control/control_law.rs",
        "control/guidance/table.rs",
        "control/allocation/table.rs",
        "control/safety.rs",
        "control/safety/table.rs",
        "control/contradiction.rs",
        "control/lqr/table.rs",
    ),
    "mission": ("mission/file.rs", "mission/legs.rs", "mission/landmarks.rs"),
}
"""The sources of each file, in the order of its tables."""

HEADINGS = {
    "VehicleFile": "Top level",
    "Environment": "`[environment]`",
    "Trim": "`[trim]`",
    "Power": "`[power]`",
    "MotorTable": "`[motors.NAME]`",
    "CharacteristicTable.Table": '`[characteristics.NAME]`, `kind = "table"`',
    "Quadratic": '`[characteristics.NAME]`, `kind = "quadratic"`',
    "Polynomial": '`[characteristics.NAME]`, `kind = "polynomial"`',
    "Thruster": "`[[thrusters]]`",
    "Geometry": "`[geometry]`",
    "Appendage": "`[[geometry.appendages]]`",
    "CrossFlowTable": "`[cross_flow]`",
    "TetherTable": "`[tether]`",
    "ModelErrorTable": "`[model_error]`",
    "FinTable": "`[[fins]]`",
    "AutopilotFile": "Top level",
    "ScheduleTable": "`[schedule]`",
    "ModeTable": "`[[modes]]`",
    "LoopTables": "`[loops]`",
    "LoopTable": "`[loops.NAME]`",
    "FeedForwardTable": "`[feed_forward]`",
    "GuidanceTable": "`[guidance]`",
    "AllocationTable": "`[allocation]`",
    "Stale": "`stale_…` and `progress` of `[safety]`",
    "Battery": "`battery` of `[safety]`",
    "ActuatorWatch": "`actuator` of `[safety]`",
    "SpeedWatch": "`speed` of `[safety]`",
    "SafetyTable": "`[safety]`",
    "Thresholds": "`[safety.contradiction]`",
    "LqrTable": "`[[lqr]]`",
    "MissionFile": "Top level",
    "Origin": "`[origin]`",
    "StartTable": "`[start]`",
    "LimitsTable": "`[limits]`",
    "WaypointLeg": '`[[legs]]`, `kind = "waypoint"`',
    "Lawnmower": '`[[legs]]`, `kind = "lawnmower"`',
    "Spiral": '`[[legs]]`, `kind = "spiral"`',
    "Perimeter": '`[[legs]]`, `kind = "perimeter"`',
    "ObstacleTable": "`[[obstacles]]`",
    "LandmarkTable.Beacon": '`[[landmarks]]`, `kind = "beacon"`',
    "LandmarkTable.Wall": '`[[landmarks]]`, `kind = "wall"`',
    "LandmarkTable.Pen": '`[[landmarks]]`, `kind = "pen"`',
}
"""Headings of the tables by the names of their structs."""

_READ = re.compile(
    r"^(?P<doc>(?:^///[^\n]*\n)+)#\[derive\([^)]*\bDeserialize\b[^)]*\)\]\n(?P<attributes>(?:#\[[^\n]*\]\n)*)"
    r"pub (?P<kind>struct|enum) (?P<name>\w+) \{\n(?P<body>.*?)^\}",
    re.MULTILINE | re.DOTALL,
)
_FIELD = re.compile(
    r"(?P<doc>(?: *///[^\n]*\n)+)(?P<attributes>(?: *#\[[^\n]*\]\n)*)"
    r" *(?:pub )?(?P<name>\w+): (?P<type>[^\n]+),\n"
)
_VARIANT = re.compile(
    r"^    (?P<doc>///[^\n]*\n(?:    ///[^\n]*\n)*)(?P<attributes>(?:    #\[[^\n]*\]\n)*)    (?P<name>\w+)"
    r"(?:,| \{\n(?P<body>.*?)^    \},|\((?P<inner>\w+)\),)",
    re.MULTILINE | re.DOTALL,
)
_WORDS = {"f64": "number", "u32": "integer", "String": "text", "bool": "true or false"}
_NUMBERS = {"2": "two", "3": "three", "6": "six", "POINTS": "six"}


@dataclass(frozen=True)
class Key:
    """A key of a table: its name, type and default in words of the file, and its meaning."""

    name: str
    type: str
    default: str
    meaning: str


@dataclass(frozen=True)
class Choice:
    """The values of an enumeration as they are written in a file, and its default."""

    values: str
    default: str


@dataclass(frozen=True)
class Table:
    """A table of a file: its name, what it is, and its keys."""

    name: str
    meaning: str
    keys: tuple[Key, ...]


def tables(file: str) -> list[Table]:
    """Every table of a file of `FILES`, in the order of the sources."""
    sources = [(SOURCES / name).read_text(encoding="utf-8") for name in FILES[file]]
    everywhere = {name: choice for code in sources for name, choice in _choices(code).items()}
    return [table for code in sources for table in _tables(code, everywhere | _choices(code))]


def _tables(code: str, choices: dict[str, Choice]) -> Iterator[Table]:
    for match in _READ.finditer(code):
        if match["kind"] == "struct":
            parts = [(match["name"], match["doc"], match["body"], match["attributes"])]
        else:
            parts = [
                (f"{match['name']}.{variant['name']}", variant["doc"], variant["body"], "")
                for variant in _VARIANT.finditer(match["body"])
                if variant["body"]
            ]
        for name, doc, body, attributes in parts:
            values = _values(name, code) if re.search(r"\bdefault\b", attributes) else None
            keys = tuple(_key(field, values, code, choices) for field in _FIELD.finditer(body))
            if keys:
                yield Table(HEADINGS.get(name, name), _prose(doc), keys)


def page(file: str) -> str:
    """The tables as a page of the reference."""
    parts = [
        f"Keys of the {file} file as the program reads them. What it is for, with an example: "
        f"[{file} file](../{file}-file{SUFFIX}). An unknown key is refused with the nearest known name, "
        "a number beyond its physical range with the range."
    ]
    for table in tables(file):
        rows = [f"| `{key.name}` | {key.type} | {key.default} | {key.meaning} |" for key in table.keys]
        parts += [
            f"## {table.name}",
            table.meaning,
            "\n".join(["| key | type | default | meaning |", "|---|---|---|---|", *rows]),
        ]
    return "\n\n".join(parts) + "\n"


def _key(field: re.Match[str], values: dict[str, str] | None, code: str, choices: dict[str, Choice]) -> Key:
    renamed = re.search(r'rename = "(\w+)"', field["attributes"])
    return Key(
        renamed[1] if renamed else field["name"],
        _type(field["type"], choices),
        _default(field, values, code, choices),
        _prose(field["doc"]),
    )


def _prose(comment: str) -> str:
    words = " ".join(line.strip().removeprefix("///").strip() for line in comment.splitlines())
    words = re.sub(r"\[`([^`\]]+)`\](?:\([^)]*\))?", r"`\1`", words)  # links of rustdoc
    return re.sub(r"(?<!`)\[(\w+)\](?!`)", r"`[\1]`", words).replace("|", "\\|")


def _choices(code: str) -> dict[str, Choice]:
    """The enumerations of a source by name: their values as they are written, and which is the default."""
    found = {}
    for match in _READ.finditer(code):
        if match["kind"] == "struct" or re.search(r"^    \w+[ (]", match["body"], re.MULTILINE):
            continue
        joint = "-" if "kebab-case" in match["attributes"] else ""
        values, default = [], ""
        for variant in re.finditer(r"((?:    #\[[^\n]*\]\n)*)    (\w+),\n", match["body"]):
            renamed = re.search(r'rename = "(\w+)"', variant[1])
            value = renamed[1] if renamed else re.sub(r"(?<!^)(?=[A-Z])", joint, variant[2]).lower()
            values.append(f'`"{value}"`')
            default = values[-1] if "#[default]" in variant[1] else default
        found[match["name"]] = Choice(", ".join(values), default)
    return found


def _type(written: str, choices: dict[str, Choice]) -> str:
    if inner := re.fullmatch(r"Option<(.+)>", written):
        return _type(inner[1], choices)
    if inner := re.fullmatch(r"Vec<(.+)>", written):
        return f"list of {_type(inner[1], choices)}"
    if inner := re.fullmatch(r"BTreeMap<String, (.+)>", written):
        return f"{_type(inner[1], choices)} by name"
    if inner := re.fullmatch(r"\[f64; (\w+)\]", written):
        return f"{_NUMBERS[inner[1]]} numbers"
    if written == "Gain":
        return "number, or six"
    return _WORDS.get(written) or (choices[written].values if written in choices else "table")


def _default(
    field: re.Match[str], values: dict[str, str] | None, code: str, choices: dict[str, Choice]
) -> str:
    if named := re.search(r'default = "(\w+)"', field["attributes"]):
        body = re.search(rf"^fn {named[1]}\(\)[^\n]*\{{\n(.+?)^\}}", code, re.MULTILINE | re.DOTALL)
        return _literal(body[1].strip()) if body else ""
    if values is not None and field["name"] in values:
        return _literal(values[field["name"]])
    if field["type"].startswith("Option"):
        return ""
    if values is not None or re.search(r"\bdefault\b", field["attributes"]):
        if field["type"] in choices:
            return choices[field["type"]].default
        return {"f64": "0", "u32": "0", "bool": "false", "Gain": "0"}.get(field["type"], "")
    return "required"


def _values(name: str, code: str) -> dict[str, str]:
    """What `Default` gives each field of a struct; empty where it is derived."""
    pattern = rf"^impl Default for {name} \{{.*?^        Self \{{\n?(.*?)\}}\n    \}}"
    body = re.search(pattern, code, re.MULTILINE | re.DOTALL)
    if body is None:
        return {}
    uncommented = re.sub(r"//[^\n]*", "", body[1])
    return dict(re.findall(r"(\w+): ((?:[^,({]|\([^)]*\)|\{[^}]*\})+)", uncommented))


def _literal(expression: str) -> str:
    """The numbers and names of an expression as they are written in a file."""
    expression = expression.strip()
    if "crate::" in expression:
        return ""
    if expression.startswith("[") or re.fullmatch(r"[-\d.e]+|true|false", expression):
        return re.sub(r"\.0\b", "", expression)
    parts = re.findall(r"\w+::(?!default|new)([A-Z]\w+)|(?<![\w.])(\d[\d.]*)", expression)
    return ", ".join(
        f'`"{re.sub(r"(?<!^)(?=[A-Z])", "-", name).lower()}"`' if name else number.removesuffix(".0")
        for name, number in parts
    )
