"""Mutation fuzz of the files of vehicle, autopilot, mission, campaign and bench test.

Seeds are all files that ship. A case changes one to three places of one of them: a number to another (zero,
negative, huge, tiny, not a number), a value to another type, a key away, added or doubled, a list to 20,000
entries, text to a long one or one with control characters, tables within tables, or the bytes of the text.
It is read and used for a moment; then it must have been refused by an error of this package, or have given
finite numbers, within seconds.

``python -m tests.check.fuzzed_files [CASES] [KIND]`` runs more cases than the tests do, 20,000 of every kind,
and prints what it finds.
"""

from __future__ import annotations

import copy
import faulthandler
import json
import resource
import sys
import time
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

import seatrial as st
from seatrial._core import Autopilot, Vehicle
from seatrial.base.errors import SeatrialError
from seatrial.bench_test.file import parse as parse_bench
from seatrial.campaign.campaign import Campaign

ROOT = Path(__file__).parents[2]
LONGEST_S = 5.0
"""No case may take longer."""

EXAMPLES = ROOT / "python" / "seatrial" / "examples"
CORE = ROOT / "crates" / "seatrial"


def seeds() -> dict[str, dict[str, str]]:
    """Texts of the files that ship, by kind and name."""
    found: dict[str, dict[str, str]] = {
        "vehicle": {p.stem: p.read_text() for p in sorted((CORE / "vehicles").glob("*.toml"))},
        "autopilot": {p.stem: p.read_text() for p in sorted((CORE / "autopilots").glob("*.toml"))},
        "mission": {p.stem: p.read_text() for p in sorted((EXAMPLES / "missions").glob("*.toml"))},
        "campaign": {},
        "bench": {},
    }
    found["vehicle"]["every term"] = (ROOT / "tests" / "core" / "every_term.toml").read_text()
    for path in sorted(EXAMPLES.rglob("*.toml")):
        text = path.read_text()
        if path.name.startswith("campaign"):
            # A bench test takes seconds; `seatrial new` puts a vehicle beside the campaign of `like`.
            own = "vehicle.toml" if path.with_name("vehicle.toml").exists() else "rov6.toml"
            text = text.replace("\nbench =", "\n# bench =").replace('"vehicle.toml"', f'"{own}"')
            found["campaign"][str(path)] = text
        elif path.name.startswith("bench"):
            found["bench"][str(path)] = text
    return found


NUMBERS: tuple[Any, ...] = (
    *(0, -1, 1, 0.0, -0.0, -1.0, 1e-300, -1e-300, 5e-324, 1e-9, 0.5, -0.5, 1e3, 1e6, 1e9, -1e9, 1e15, 1e16),
    *(1e100, 1e308, -1e308, float("nan"), float("inf"), float("-inf"), 2**31, 2**63 - 1, -(2**63), 90, 360.0),
)
TEXTS = (
    *(
        "",
        " ",
        "a\x1b[31mb",
        "\x00",
        "x\ny",
        "../../x",
        "/dev/zero",
        "\u202e",
        "1/0",
        "x <= 1/0",
        "__import__",
    ),
    *("nan", "é", "😀", "a" * 300, "a" * 50_000, "{", "[", "a.b", "%s", "${HOME}", "N", "XYZKMN", "XX"),
)
ODD: tuple[Any, ...] = (
    True,
    False,
    [],
    {},
    [[]],
    [{}],
    [1, 2, 3],
    ["a"],
    [[1.0, 2.0]],
    [None],
    {"a": 1},
    {"": 1},
)
LONG = 20_000


def places(tree: Any, where: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Places of all values of a tree."""
    if where:
        yield where
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from places(value, (*where, key))
    elif isinstance(tree, list):
        for i, value in enumerate(tree[:40]):
            yield from places(value, (*where, i))


def odd(random: Random) -> Any:
    """Something else."""
    return copy.deepcopy(random.choice((*ODD, *NUMBERS, *TEXTS)))


def mutated(tree: dict[str, Any], random: Random) -> dict[str, Any]:
    """A copy of the tree with one to three changes."""
    tree = copy.deepcopy(tree)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        all_places = list(places(tree))
        if not all_places:
            break
        *path, last = random.choice(all_places)
        owner: Any = tree
        for key in path:
            owner = owner[key]
        value = owner[last]
        kind = random.random()
        if kind < 0.4:
            if isinstance(value, int | float) and not isinstance(value, bool):
                scaled = value * random.choice((-1, 0, 1e-6, 0.1, 10, 1e3, 1e6))
                owner[last] = random.choice((random.choice(NUMBERS), scaled))
            elif isinstance(value, str):
                owner[last] = random.choice(TEXTS)
            else:
                owner[last] = odd(random)
        elif kind < 0.55:
            owner[last] = odd(random)
        elif kind < 0.65:
            del owner[last]
        elif kind < 0.72 and isinstance(value, dict):
            value[random.choice((*TEXTS, *value, "extra"))] = odd(random)
        elif kind < 0.78 and isinstance(value, list):
            value.extend(copy.deepcopy(value[:3]))
        elif kind < 0.84 and isinstance(value, dict):
            owner[last] = list(value.values())
        elif kind < 0.87 and len(list(places(value))) < 20 and len(str(value)) < 2000:
            owner[last] = [
                copy.deepcopy(value[0] if isinstance(value, list) and value else value)
            ] * random.choice((300, 300, 300, LONG))
            break  # its entries are one: another change would be made 20,000 times
        elif kind < 0.89:
            nested: Any = value
            for _ in range(random.choice((10, 60, 400))):
                nested = [nested] if random.random() < 0.5 else {"a": nested}
            owner[last] = nested
        elif kind < 0.91 and isinstance(owner, dict) and len(list(places(value))) < 5:
            owner.update({f"k{i}": value for i in range(random.choice((3, 30, 300, 300, 300, 300, LONG)))})
            break
        elif isinstance(owner, dict):
            other = random.choice(all_places)
            source: Any = tree
            for key in other:
                source = source[key]
            owner[last] = copy.deepcopy(source)
    return tree


def written(value: Any) -> str:
    """A value as TOML, tables inline."""
    parts: list[str] = []
    stack: list[Any] = [value]
    # Without recursion: the nesting is the point of some cases.
    while stack:
        item = stack.pop()
        if isinstance(item, _Literal):
            parts.append(item.text)
        elif isinstance(item, dict):
            pieces: list[Any] = [_Literal("{")]
            for i, (key, entry) in enumerate(item.items()):
                pieces += [_Literal(f"{', ' if i else ''}{quoted(key)} = "), entry]
            stack.extend(reversed([*pieces, _Literal("}")]))
        elif isinstance(item, list) and len(item) > 1 and all(entry is item[0] for entry in item):
            parts.append(f"[{(written(item[0]) + ', ') * len(item)}]")
        elif isinstance(item, list):
            pieces = [_Literal("[")]
            for entry in item:
                pieces += [entry, _Literal(", ")]
            stack.extend(reversed([*pieces, _Literal("]")]))
        elif isinstance(item, bool):
            parts.append("true" if item else "false")
        elif isinstance(item, str):
            parts.append(quoted(item))
        elif isinstance(item, float):
            parts.append(repr(item) if "e" not in repr(item) or "." in repr(item) else f"{item:.1e}")
        elif item is None:
            parts.append("null")
        else:
            parts.append(str(item))
    return "".join(parts)


class _Literal:
    def __init__(self, text: str) -> None:
        self.text = text


@cache
def quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


parsed = cache(tomllib.loads)


def case(text: str, random: Random) -> str:
    """One mutated file."""
    kind = random.random()
    if kind < 0.85:
        tree = mutated(parsed(text), random)
        return "".join(f"{quoted(key)} = {written(value)}\n" for key, value in tree.items())
    at, other = random.randrange(len(text)), random.randrange(len(text))
    if kind < 0.89:
        return text[:at]
    if kind < 0.93:
        noise = "".join(
            chr(random.choice((random.randrange(128), random.randrange(0x2000)))) for _ in range(8)
        )
        return text[:at] + noise + text[at:]
    if kind < 0.97:
        return text[: min(at, other)] + text[max(at, other) :]
    lines = text.splitlines(keepends=True)
    lines.insert(random.randrange(len(lines)), random.choice(lines) * random.choice((1, 1, 300)))
    return "".join(lines)


def finite(what: str, *values: Any) -> None:
    for value in values:
        if not np.all(np.isfinite(np.asarray(value, dtype=float))):
            raise AssertionError(f"{what} is accepted and gives {value}")


def use_vehicle(text: str, seed: str) -> None:
    vehicle = Vehicle.from_toml(text, seed)
    nu = [0.5, 0.1, -0.1, 0.02, 0.03, -0.05]
    finite("mass matrix", vehicle.mass_matrix())
    finite("allocation", vehicle.allocation_matrix())
    finite("power", list(vehicle.power().values()))
    finite("coefficients", list(vehicle.coefficients().values()))
    finite("acceleration", vehicle.acceleration(nu, [0.1, 0.2, 0.3], np.ones(6)))
    vehicle.coefficient_info()
    vehicle.to_toml()
    # A fin on a mast of 300 m makes a stiff vehicle: its numbers are possible, and ask for a short step.
    run = vehicle.simulate([0.0, 1e-7, 2e-7], voltage_v=np.full(3, 16.0), max_step_s=1e-7)
    finite("simulation", run.nu, run.position, run.tau)


def use_autopilot(text: str, seed: str) -> None:
    autopilot = Autopilot.from_toml(text, seed)
    vehicle = Vehicle.load(seed)
    finite("tunables", list(autopilot.gains().values()))
    helm = autopilot.engage(vehicle, MISSION.core)
    channels = dict.fromkeys(["x", "y", "z", "roll", "pitch", "yaw", "u", "v", "w", "p", "q", "r"], 0.01)
    for _ in range(3):
        finite("command", list(helm.step(channels | {"altitude": 5.0, "voltage": 16.0}).values()))


def use_mission(text: str, seed: str) -> None:
    mission = st.Mission.from_toml(text, seed)
    points = mission.core.waypoints
    finite("waypoints", *(points[key] for key in ("north_m", "east_m", "speed_m_s") if key in points))
    finite("planned time", mission.planned_time)
    finite("length", mission.length)
    mission.to_toml(expanded=True)


def use_campaign(text: str, seed: str) -> None:
    campaign = Campaign.from_toml(text, folder=Path(seed).parent)
    for parameters in campaign.problem().parameters.values():
        finite("bounds", [(p.lower, p.upper, p.start) for p in parameters])


def use_bench(text: str, seed: str) -> None:
    file = parse_bench(text, seed)
    for group in ("stern", "vertical"):
        file.regression_of(group)


MISSION = st.Mission.load(EXAMPLES / "missions" / "hover.toml")
USES: dict[str, Callable[[str, str], None]] = {
    "vehicle": use_vehicle,
    "autopilot": use_autopilot,
    "mission": use_mission,
    "campaign": use_campaign,
    "bench": use_bench,
}


def fuzz(kind: str, cases: int, *, first: int = 0) -> tuple[Counter[str], list[tuple[int, str]]]:
    """How many cases were accepted and refused, and number and complaint of those that were neither."""
    texts = seeds()[kind]
    names = sorted(texts)
    counts: Counter[str] = Counter()
    wrong: list[tuple[int, str]] = []
    for number in range(first, first + cases):
        random = Random(f"{kind} {number}")
        seed = random.choice(names)
        text = case(texts[seed], random)
        began = time.perf_counter()
        try:
            USES[kind](text, seed)
            counts["accepted"] += 1
        except SeatrialError as error:
            counts["refused"] += 1
            if not str(error).strip() or len(str(error)) > 20_000:
                wrong.append((number, f"a message of {len(str(error))} characters"))
        except Exception:
            wrong.append((number, "".join(traceback.format_exc().splitlines(keepends=True)[-6:])[:1500]))
        took = time.perf_counter() - began
        counts["slowest, ms"] = max(counts["slowest, ms"], int(1e3 * took))
        if took > LONGEST_S:
            wrong.append((number, f"took {took:.1f} s"))
    return counts, wrong


def main() -> int:
    """Runs the cases of every kind, or of one."""
    cases = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    kinds = sys.argv[2:] or list(USES)
    found = 0
    for kind in kinds:
        faulthandler.dump_traceback_later(1800, exit=True)
        counts, wrong = fuzz(kind, cases)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{kind}: {dict(counts)}, {len(wrong)} wrong, at most {memory:.0f} MiB", flush=True)
        for number, complaint in wrong[:12]:
            print(f"--- {kind} {number}\n{complaint}", flush=True)
        found += len(wrong)
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
