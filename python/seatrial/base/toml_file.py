"""TOML files that people write: read, checked against a model, told apart; messages name file and key.

Every format (campaign, bench test, sensors, generated trial) is a `Section` of sections: `text_of` reads the
file, `tables` and `checked` make the model, `file_path` resolves the paths in it. `loaded` takes a vehicle,
an autopilot or a mission as object, name or path. The core tells kinds of file apart, by their keys.

A key carries its unit, and the unit says how large a number of a vehicle may be; a key with bounds of its own
stands in ``ranges.toml``. What one number demands of another is the model's. Held by
``tests/campaign/test_campaign_file.py``, ``tests/campaign/test_file_ranges.py`` and
``tests/flight/test_bad_input_flights.py``.
"""

from __future__ import annotations

import math
import os
import re
import reprlib
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from seatrial._core import file_kind as kind_of_keys
from seatrial._core import file_text, wrong_kind
from seatrial.base.errors import CampaignError, SeatrialError, SimulationError, VehicleError, nearest
from seatrial.base.files import VARIABLE, data_folder

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]

Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]

NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]

Count = Annotated[int, Field(strict=True, gt=0)]

Interval = tuple[Number, Number]

Name = Annotated[str, Field(min_length=1)]

# Results go to a folder of this name.
FolderName = Annotated[str, Field(pattern=r"^[^/\\.\x00-\x1f\x7f][^/\\\x00-\x1f\x7f]*$")]


class Section(BaseModel):
    """A table of the file: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    advice: ClassVar[str] = ""
    file_kind: ClassVar[str] = ""
    """Kind of the file that it is the whole of, as the core calls it."""

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, Mapping):
            for key in data:
                if key not in cls.model_fields:
                    raise ValueError(
                        f"unknown key {key!r}{nearest(str(key), cls.model_fields)}; correct or remove it"
                        + cls.advice
                    )
        return data

    def over(self, other: Self) -> Self:
        """The same section with what is absent here taken from the other one."""
        return type(self)(**(other.model_dump(exclude_none=True) | self.model_dump(exclude_none=True)))


_File = TypeVar("_File", bound=Section)


@dataclass(frozen=True)
class FileLimits:
    """How much of a file is read, how long and deep its text may be, and how much is said about it."""

    most_messages: int = 20  #: Lines of one error: who has more mistakes than that has one, made often.
    #: Most characters of a file: more takes the reader seconds, and no one writes it.
    most_characters: int = 2_000_000
    most_entries: int = 2_000  #: Most entries of a list or a table: more is no file that a person wrote.
    longest_text: int = 4_096  #: Most characters of a text: the longest path on Linux (PATH_MAX).
    most_depth: int = 20  #: Most tables within each other: our deepest file has five.


LIMITS = FileLimits()

_EXPECTED = {
    "string_type": "expected text in quotes",
    "string_too_short": "expected text that is not empty",
    "string_pattern_mismatch": "expected a name for a folder: no /, \\, control characters or dot in front",
    "bool_type": "expected true or false",
    "bool_parsing": "expected true or false",
    "int_type": "expected a whole number",
    "int_from_float": "expected a whole number",
    "float_type": "expected a number",
    "tuple_type": "expected a list [...]",
    "list_type": "expected a list [...]",
    "dict_type": "expected a table",
    "model_type": "expected a table",
    "too_short": "expected at least one entry",
}
"""What was expected, by pydantic's name of the error, where its own words speak of Python."""

_WRONG_LENGTH = "too_long"  # pydantic's name for a list of fixed length with too many entries


def text_of(
    path: Any, what: str, *, error: type[SeatrialError] = CampaignError, advice: str = "check the path"
) -> str:
    """Text of a regular file of bounded size in UTF-8, with or without a byte order mark.

    Where it cannot be read `error` is raised: `what` is what is expected ("a mission file"), `advice` its
    end.
    """
    if not isinstance(path, str | Path):
        raise error(f"expected the path of {what}, found {type(path).__name__}")
    if "\n" in str(path):
        raise error(f"expected the path of {what}, found its text; use from_toml for text")
    try:
        return file_text(path)
    except ValueError as wrong:  # of the file, or of a zero byte in the path
        remedy = "save it as UTF-8" if "UTF-8" in str(wrong) else advice
        raise error(f"{path}: not readable as {what} ({wrong}); {remedy}") from None


def tables(text: str, source: str, *, error: type[SeatrialError] = CampaignError) -> dict[str, Any]:
    """Tables of a TOML text.

    `source`: what to call it in messages; `error`: raised where it is not TOML.
    """
    if len(text) > (most := LIMITS.most_characters):
        raise error(
            f"{source}: expected a file of at most {most} characters, found {len(text)}; is it the right"
            " file?"
        )
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as wrong:
        raise error(f"{source}: {_given_twice(text, str(wrong)) or f'not a TOML file: {wrong}'}") from None
    except RecursionError:
        raise error(f"{source}: too many tables or lists within each other; remove some") from None


def _given_twice(text: str, wrong: str) -> str | None:
    """Which key or table stands in a text twice, where that is what the reader says is `wrong`."""
    complaint = re.match(r"Cannot (?:overwrite a value|declare .* twice) \(at (?:line (\d+)|end)", wrong)
    if complaint is None:
        return None
    lines = text.rstrip().splitlines()
    line = int(complaint[1] or len(lines))
    key = lines[line - 1].partition("=")[0].strip()
    return f"line {line}: {key} stands there for the second time; keep one of them"


def checked(
    model: type[_File], data: Mapping[str, Any], source: str, *, error: type[SeatrialError] = CampaignError
) -> _File:
    """Tables as a model of a file.

    `data`: of `tables`; `source`: what to call the file in messages; `error`: raised for a file of another
    kind, an unknown key, a missing key or a value that a key may not hold; all of them are listed.

    Examples
    --------
    >>> class Tank(Section):
    ...     length_m: Positive
    >>> checked(Tank, tables("length_m = 12.0", "tank.toml"), "tank.toml").length_m
    12.0
    """
    if model.file_kind and (wrong := wrong_kind(model.file_kind, list(data))):
        raise error(f"{source}: {wrong}")
    # Text first: no message quotes what a terminal should not meet.
    _refuse(data, source, text_complaints(data), error)
    try:
        tables = model.model_validate(data)
    except ValidationError as invalid:
        details = invalid.errors()
        paths = [detail["loc"] for detail in details]
        # An array whose entries are all wrong is also reported as too short: the entries say why.
        own = [
            d
            for d in details
            if not any(len(p) > len(d["loc"]) and p[: len(d["loc"])] == d["loc"] for p in paths)
        ]
        own = _whole_lists(data, own)
        lines = [_message(data, source, detail) for detail in own[: LIMITS.most_messages]]
        if len(own) > LIMITS.most_messages:
            lines.append(f"{source}: {len(own) - LIMITS.most_messages} more of this kind")
        raise error("\n".join(lines)) from None
    _refuse(data, source, number_complaints(data), error)
    return tables


def _refuse(
    data: Mapping[str, Any], source: str, complaints: Iterable[tuple[Any, str]], error: type[SeatrialError]
) -> None:
    """Raises the complaints, each with its key; a list does not repeat its own a thousand times."""
    shown = list(islice(complaints, LIMITS.most_messages))
    if shown:
        raise error("\n".join(f"{source}: {_key_path(data, where)}: {text}" for where, text in shown))


def _whole_lists(data: Any, details: Iterable[Any]) -> list[Any]:
    """The details, with one for each list that is too short in place of one for each entry that it lacks."""
    kept: list[Any] = []
    for detail in details:
        *outer, place = detail["loc"] or ("",)
        if detail["type"] != "missing" or not isinstance(place, int):
            kept.append(detail)
            continue
        if kept and kept[-1]["type"] == _WRONG_LENGTH and kept[-1]["loc"] == tuple(outer):
            kept.pop()  # the last entry that is missing tells how many there should be
        count = {"max_length": place + 1, "actual_length": len(detail["input"])}
        kept.append({"type": _WRONG_LENGTH, "loc": tuple(outer), "input": detail["input"], "ctx": count})
    return kept


def _message(data: Mapping[str, Any], source: str, detail: Any) -> str:
    where = _key_path(data, detail["loc"])
    value = detail["input"]
    if detail["type"] == "missing":
        return f"{source}: {where}: this key is required and missing; add it"
    if detail["type"] == _WRONG_LENGTH:
        most, count = detail["ctx"]["max_length"], detail["ctx"]["actual_length"]
        return f"{source}: {where}: expected {most} entries, found {count}; correct the list"
    text = str(detail["msg"]).removeprefix("Value error, ")
    if detail["type"] == "value_error":
        return f"{source}: {where}: {text}"
    text = _EXPECTED.get(detail["type"]) or text.replace("Input should be", "expected")
    return f"{source}: {where}: {text}, found {reprlib.repr(value)}; correct the value"


def _key_path(data: Any, loc: tuple[int | str, ...]) -> str:
    """Path of a key as people say it: ``stages 'yaw', key segment_s``."""
    parts: list[str] = []
    for key in loc:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            data = None
        if isinstance(key, int):
            name = data.get("name") if isinstance(data, Mapping) else None
            parts[-1] += f" {name[:80]!r}" if isinstance(name, str) else f"[{key + 1}]"
        else:
            parts.append(str(key))
    return ", ".join([*parts[:-1], f"key {parts[-1]}"]) if parts else "the file"


def twice(names: Iterable[str]) -> str | None:
    """The first name that stands there for the second time.

    Examples
    --------
    >>> twice(["ahead", "astern", "ahead"]), twice(["ahead"])
    ('ahead', None)
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def is_path(name: str) -> bool:
    """Whether the name of a vehicle is a path and not that of a built-in one.

    Examples
    --------
    >>> is_path("cwolf"), is_path("my_vehicle.toml"), is_path("fleet/one")
    (False, True, True)
    """
    return name.endswith(".toml") or "/" in name or "\\" in name


def file_path(text: str, folder: Path, where: str) -> Path:
    """Path relative to a folder, ``${VARIABLE}`` replaced by the environment's value.

    ``SEATRIAL_DATA`` is the user's cache where it is not set and `seatrial data get` has filled that.

    Raises `CampaignError`: the variable is not set; the message begins with `where`.
    """

    def value(match: re.Match[str]) -> str:
        variable = match.group(1)
        if variable in os.environ:
            return os.environ[variable]
        hint = ""
        if variable == VARIABLE:
            if (cache := data_folder()).is_dir():
                return str(cache)
            hint = ", or fetch recordings with seatrial data get"
        raise CampaignError(
            f"{where}: environment variable {variable} is not set; set it to the folder that {text!r}"
            f" begins with{hint}"
        )

    return folder / Path(re.sub(r"\$\{(\w+)\}", value, text)).expanduser()


CAMPAIGN, VEHICLE = "a campaign", "a vehicle"

_EMPTY = "an empty file"


def file_kind(path: str | Path) -> str | None:
    """Kind of the file; None where it cannot be read or no key identifies it.

    Examples
    --------
    >>> file_kind("cwolf") is None
    True
    """
    try:
        text = file_text(path)
        data = tables(text, str(path))
    except ValueError:
        return None
    if not text.strip():
        return _EMPTY
    return kind_of_keys(list(data))


def loaded(kind: Any, source: Any, name: str | None = None) -> Any:
    """A Vehicle, Autopilot or Mission: itself, or that of a name or path.

    `kind`: which of them is expected; `name`: of the argument in messages; the kind's own when omitted.
    Raises `VehicleError`: the file cannot be read, is of another kind or not usable. Raises
    `SimulationError`: the source is something else.
    """
    if isinstance(source, kind):
        return source
    what = kind.__name__.lower()
    if not isinstance(source, str | Path):
        own_type = type(source)
        module = "" if own_type.__module__ == "builtins" else f"{own_type.__module__}."
        raise SimulationError(
            f"{name or what}: expected an st.{kind.__name__}, a name or a path, found"
            f" {module}{own_type.__name__}"
        )
    if not str(source).strip():
        raise VehicleError(f"{name or what}: expected a name or a path, found an empty text")
    return kind.load(source)


_LONGEST = {"name": 200, "label": 200, "description": 20_000}
"""Most characters of the text of a key; of another one, `longest_text`: a path, a requirement."""

Where = tuple[str | int, ...]


@dataclass(frozen=True)
class Range:
    """From `least` to `most`, both included; `remedy` says what to do about another number."""

    least: float
    most: float
    remedy: str

    def complaint(self, x: float) -> str | None:
        """What was expected, what was found and what to do; None within the range."""
        if self.least <= x <= self.most:
            return None
        expected = f"a number from {self.least:g} to {self.most:g}" if math.isfinite(x) else "a finite number"
        return f"expected {expected}, found {x:g}; {self.remedy}"


_ROWS: dict[str, Any] = tomllib.loads(Path(__file__).with_name("ranges.toml").read_text(encoding="utf-8"))

_ANY = Range(*_ROWS.pop("any"))

RANGES = {table: {key: Range(*row) for key, row in rows.items()} for table, rows in _ROWS.items()}
"""By the unit that ends a key ("units"), by its name ("keys"), and of tables of corrections ("entries")."""

_OPEN = {
    "actuators", "columns", "commands", "channels", "mix", "coefficients", "factors", "values", "nuisances",
    "trials",
}  # fmt: skip
"""Tables whose keys are names of the user's: their numbers have the widest range."""


def range_of(key: str) -> Range:
    """Range of the numbers of a key: its own, else that of the unit at its end, else any.

    Examples
    --------
    >>> range_of("depth_m").most, range_of("runs").most
    (1000000.0, 1000000.0)
    """
    own = RANGES["keys"].get(key)
    return own or next((row for unit, row in RANGES["units"].items() if key.endswith(unit)), _ANY)


def number_complaints(value: Any, where: Where = (), row: Range | None = None) -> Iterator[tuple[Where, str]]:
    """Place and complaint of every number beyond its range; `row` is that of a number or a list."""
    if isinstance(value, Mapping):
        table = where[-1] if where else ""
        every = RANGES["entries"].get(str(table)) or (_ANY if table in _OPEN else None)
        for key, entry in value.items():
            yield from number_complaints(entry, (*where, key), every or range_of(key))
    elif isinstance(value, list):
        for i, entry in enumerate(value):
            yield from number_complaints(entry, (*where, i), row)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        # An integer of TOML may be larger than any number of the machine.
        huge = isinstance(value, int) and abs(value) > 2**1000
        if complaint := (row or _ANY).complaint(math.inf if huge else value):
            yield where, complaint


def text_complaints(value: Any, where: Where = ()) -> Iterator[tuple[Where, str]]:
    """Place and complaint of text that no terminal and no file name should meet, and of endless lists."""
    if isinstance(value, str):
        yield from ((where, complaint) for complaint in _text(value, str(where[-1]) if where else ""))
    elif isinstance(value, Mapping | list):
        count, most, deepest = len(value), LIMITS.most_entries, LIMITS.most_depth
        if count > most:
            yield where, f"expected at most {most} entries, found {count}; split the file"
            return
        if len(where) >= deepest:
            yield where[:3], f"expected at most {deepest} tables or lists within each other; remove some"
            return
        for key, entry in value.items() if isinstance(value, Mapping) else enumerate(value):
            wrong = list(_text(key, "name")) if isinstance(key, str) else []
            yield from ((where, f"a key of it: {complaint}") for complaint in wrong)
            if not wrong:
                yield from text_complaints(entry, (*where, key))


def _text(value: str, key: str) -> Iterator[str]:
    """Complaints about the text of a key; a description may have several lines."""
    most = _LONGEST.get(key, LIMITS.longest_text)
    allowed = "\n\r\t" if key == "description" else ""
    wrong = next((c for c in value if (ord(c) < 32 or 127 <= ord(c) < 160) and c not in allowed), None)
    if wrong is not None:
        yield f"expected text without control characters, found U+{ord(wrong):04X}; remove it"
    if len(value) > most:
        yield f"expected at most {most} characters, found {len(value)}; shorten it"
