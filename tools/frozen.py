"""Whether a change of the structure moved a number.

``python tools/frozen.py record DIR`` runs commands as users do (starter, CWolf, a real AUV, a real ROV, a
torpedo in waves, rare failures, C and FMU) with one thread of linear algebra, each recipe in a folder of DIR.
``compare OLD NEW`` prints the keys of JSON and TOML, the cells of CSV and the lines of C that differ between
two such folders, numbers to the last bit; times, versions and paths do not count. Record before the change
and after it, on the same machine. SEATRIAL_DATA names the recordings; recipes that lack theirs are named.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

TUNED = "{examples}/cwolf/campaign.toml --run identified --autopilot tuned"

RECIPES = {
    "starter": (
        "new mine",
        "bench mine/bench.toml --out bench --figures none",
        "identify mine/campaign.toml --out identified --figures none",
        "autopilot mine/vehicle.toml --out autopilot.toml",
        "fly mine/vehicle.toml autopilot.toml mine/mission.toml --current 0 0.2 0 --sensors typical",
    ),
    "cwolf": (
        "identify {examples}/cwolf/campaign.toml --out identified --figures none",
        "tune {examples}/cwolf/campaign.toml --run identified --out tuned --figures none",
        f"verify {TUNED} --runs 1000 --out verified",
        f"rare {TUNED} --population 200 --out rare",
        "export c identified tuned/autopilot.toml --mission {examples}/missions/lawnmower.toml --out c",
        "export fmu identified tuned/autopilot.toml --mission {examples}/missions/lawnmower.toml --out fmu",
    ),
    "beluga": ("identify {examples}/beluga/campaign.toml --out identified --figures none",),
    "ardusub": (
        "import {data}/ardusub_small/*.BIN --out pier",
        "identify pier/campaign.toml --out identified --figures none",
    ),
    "torpedo": (
        "import {data}/field_torpedo/*.csv --vehicle {data}/field_torpedo/vehicle.toml --out log",
        "identify log/campaign.toml --out identified --figures none",
    ),
}
"""Commands of `seatrial` of each recipe in their order; {examples} and {data} are folders."""

PASSING = re.compile(
    r"^pid$|seconds|elapsed|wall|_time|time_|started|ended|_utc|date|version|host|path|folder|python|platform|sha256|hash|command",
    re.IGNORECASE,
)
"""Keys that differ from run to run, or with the sources."""

DURATION = re.compile(r"\b[\d.]+ s\b|\btime=\"[\d.]+\"|/\S*/examples/")
"""How long something took, and where the examples lie, in text; numbers in seconds stand in JSON as well."""

READ = (".json", ".csv", ".toml", ".txt", ".c", ".h", ".xml")
"""Endings that are compared; archives and figures hold the same numbers again."""


def main(arguments: list[str]) -> int:
    """Record or compare; 1 where something differs or a command failed, 2 for a wrong call."""
    match arguments:
        case ["record", folder, *names]:
            return record(Path(folder), names or list(RECIPES))
        case ["compare", old, new]:
            return compare(Path(old), Path(new))
    print(__doc__, file=sys.stderr)
    return 2


def record(folder: Path, names: list[str]) -> int:
    """Run the recipes of these names; their output and exit codes are kept as `log.txt` and `codes.json`."""
    data = os.environ.get("SEATRIAL_DATA")
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    failed = 0
    for name in names:
        if data is None and (name == "beluga" or any("{data}" in command for command in RECIPES[name])):
            print(f"{name}: left out, SEATRIAL_DATA names no folder of recordings")
            continue
        place = folder / name
        place.mkdir(parents=True)
        codes = {}
        for template in RECIPES[name]:
            command = f"{ROOT}/.venv/bin/seatrial {template.format(examples=ROOT / 'examples', data=data)}"
            began = time.monotonic()
            with (place / "log.txt").open("a") as log:
                log.write(f"$ {template}\n")
                log.flush()
                code = subprocess.run(
                    command, shell=True, cwd=place, env=environment, stdout=log, stderr=log
                ).returncode
            codes[template] = code
            print(f"{name}: exit code {code} after {time.monotonic() - began:.0f} s: {template}", flush=True)
            failed += code not in (0, 1)
        (place / "codes.json").write_text(json.dumps(codes, indent=1))
    return min(failed, 1)


def compare(old: Path, new: Path) -> int:
    """Print what differs between two records, at most twenty lines a file."""
    differing = 0
    files = {p.relative_to(root) for root in (old, new) for p in root.rglob("*") if p.suffix in READ}
    names = {name for name in files if name.name != "log.txt"}
    for name in sorted(names):
        if not (old / name).is_file() or not (new / name).is_file():
            print(f"{name}: only in {old if (old / name).is_file() else new}")
            differing += 1
            continue
        before, after = dict(leaves(old / name)), dict(leaves(new / name))
        changed = [key for key in before | after if before.get(key) != after.get(key)]
        differing += bool(changed)
        for key in changed[:20]:
            print(f"{name}: {key}: {before.get(key, 'absent')} before, {after.get(key, 'absent')} after")
        if len(changed) > 20:
            print(f"{name}: {len(changed) - 20} more")
    print(f"{len(names)} files compared, {differing} differ")
    return int(differing > 0)


def leaves(path: Path) -> Iterator[tuple[str, str]]:
    """Every value of a file with its key: the way from the root, or the number of the line."""
    if path.suffix in (".json", ".toml"):
        text = path.read_text()
        yield from below("", json.loads(text) if path.suffix == ".json" else tomllib.loads(text))
    else:
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
            if not PASSING.search(line) or path.suffix == ".csv":
                yield f"line {number}", line if path.suffix == ".csv" else DURATION.sub("_", line)


def below(key: str, value: object) -> Iterator[tuple[str, str]]:
    """The leaves below a value; floating-point numbers as their bits."""
    if isinstance(value, dict):
        for name, child in value.items():
            if not PASSING.search(name):
                yield from below(f"{key}.{name}", child)
    elif isinstance(value, list):
        for i, child in enumerate(value):
            yield from below(f"{key}[{i}]", child)
    elif isinstance(value, str):
        yield key, DURATION.sub("_", value)
    else:
        yield key, value.hex() if isinstance(value, float) else repr(value)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
