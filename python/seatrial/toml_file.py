"""TOML files that people write: tables whose unknown keys are refused, messages that name file and key.

Every format (campaign, bench test, recipes of generated trials) is a `Section` of sections; `tables` and
`checked` read it, `file_path` resolves the paths in it.

Tests: ``tests/test_campaign_file.py``, ``tests/test_bench_file.py``, ``tests/test_sensors.py``.
"""

from __future__ import annotations

import os
import re
import reprlib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from seatrial.errors import CampaignError, SeatrialError, nearest

__all__ = [
    "Count",
    "FolderName",
    "Interval",
    "Name",
    "NotNegative",
    "Number",
    "Positive",
    "Section",
    "checked",
    "file_path",
    "is_path",
    "tables",
]

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Count = Annotated[int, Field(strict=True, gt=0)]
Interval = tuple[Number, Number]
Name = Annotated[str, Field(min_length=1)]
FolderName = Annotated[str, Field(pattern=r"^[^/\\.][^/\\]*$")]  # results go to a folder of this name


class Section(BaseModel):
    """A table of the file: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    advice: ClassVar[str] = ""

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


_File = TypeVar("_File", bound=Section)

_EXPECTED = {
    "string_type": "expected text in quotes",
    "string_too_short": "expected text that is not empty",
    "string_pattern_mismatch": "expected a name for a folder, without / or \\ and no dot in front",
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
    "too_long": "expected fewer entries",
}
"""What was expected, by pydantic's name of the complaint, where its own words speak of Python."""


def tables(text: str, source: str, *, error: type[SeatrialError] = CampaignError) -> dict[str, Any]:
    """Tables of a TOML text.

    Parameters
    ----------
    text : str
    source : str
        What to call it in messages.
    error : type
        Raised where it is not TOML.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as wrong:
        raise error(f"{source}: not a TOML file: {wrong}") from None


def checked(
    model: type[_File], data: Mapping[str, Any], source: str, *, error: type[SeatrialError] = CampaignError
) -> _File:
    """Tables as a model of a file.

    Parameters
    ----------
    model : type
    data : mapping
        Of `tables`.
    source : str
        What to call the file in messages.
    error : type
        Raised for an unknown key, a missing key or a value that a key may not hold; all of them are listed.

    Examples
    --------
    >>> class Tank(Section):
    ...     length_m: Positive
    >>> checked(Tank, tables("length_m = 12.0", "tank.toml"), "tank.toml").length_m
    12.0
    """
    try:
        return model.model_validate(data)
    except ValidationError as wrong:
        details = wrong.errors()
        places = [detail["loc"] for detail in details]
        # An array whose entries are all wrong is also reported as too short: the entries say why.
        own = [
            d
            for d in details
            if not any(len(p) > len(d["loc"]) and p[: len(d["loc"])] == d["loc"] for p in places)
        ]
        raise error("\n".join(_message(data, source, detail) for detail in own)) from None


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

    Raises
    ------
    CampaignError
        The variable is not set; the message begins with `where`.
    """

    def value(match: re.Match[str]) -> str:
        variable = match.group(1)
        if variable not in os.environ:
            raise CampaignError(
                f"{where}: environment variable {variable} is not set; set it to the folder that {text!r}"
                " begins with"
            )
        return os.environ[variable]

    return folder / Path(re.sub(r"\$\{(\w+)\}", value, text)).expanduser()


def _message(data: Mapping[str, Any], source: str, detail: Any) -> str:
    place = _place(data, detail["loc"])
    found = detail["input"]
    if detail["type"] == "missing":
        return f"{source}: {place}: this key is required and missing; add it"
    text = str(detail["msg"]).removeprefix("Value error, ")
    if detail["type"] == "value_error":
        return f"{source}: {place}: {text}"
    text = _EXPECTED.get(detail["type"]) or text.replace("Input should be", "expected")
    return f"{source}: {place}: {text}, found {reprlib.repr(found)}; correct the value"


def _place(data: Any, loc: tuple[int | str, ...]) -> str:
    """Path of a key as people say it: ``stages 'yaw', key segment_s``."""
    parts: list[str] = []
    for key in loc:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            data = None
        if isinstance(key, int):
            name = data.get("name") if isinstance(data, Mapping) else None
            parts[-1] += f" {name!r}" if isinstance(name, str) else f"[{key + 1}]"
        else:
            parts.append(str(key))
    return ", ".join([*parts[:-1], f"key {parts[-1]}"]) if parts else "the file"
