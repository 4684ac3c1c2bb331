"""Record of what seatrial answers: numbers and keys of whole runs, to the last bit, and the public names.

`python tests/freeze/record.py record FILE` runs the commands below in a temporary folder and writes every
number, string
and key that they print or leave behind; `compare FILE` runs them again and lists what differs. It holds a
rebuild of the house that must change no number. Clock times, paths, versions and hashes are left out.
"""

from __future__ import annotations

import gzip
import hashlib
import inspect
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

LEFT_OUT = re.compile(
    r"(history|run\.json|wall_s|elapsed_s|seconds|sha256|hash|version|platform|simd|path|folder|run_dir|figures_written|written|date|"
    r"times_real|per_second|left_s|\bout\b|machine|threads|rate_per_s|duration_wall|started|finished)"
)

COMMANDS = {
    "check": ["check", "p/vehicle.toml", "--no-figures", "--json"],
    "check cwolf": ["check", "cwolf", "--no-figures", "--json"],
    "check campaign": ["check", "p/campaign.toml", "--no-figures", "--json"],
    "check mission": ["check", "p/mission.toml", "--vehicle", "p/vehicle.toml", "--no-figures", "--json"],
    "check autopilot": ["check", "cwolf", "--no-figures", "--json"],
    "bench": ["bench", "p/bench.toml", "--no-figures", "--json", "-o", "bench"],
    "bench t200": ["bench", "e/t200/bench.toml", "--no-figures", "--json", "-o", "bench-t200"],
    "identify": ["identify", "p/campaign.toml", "--no-figures", "--json", "-o", "starter"],
    "restarts": [
        "identify",
        "p/campaign.toml",
        "--no-figures",
        "--json",
        "-o",
        "starts",
        "--random-starts",
        "2",
    ],
    "score": [
        "score",
        "starter/vehicle.toml",
        "p/logs/straight.csv",
        "--columns-from",
        "p/campaign.toml",
        "--json",
    ],
    "plan": ["plan", "p/campaign.toml", "--count", "1", "--no-figures", "--json", "-o", "plan.csv"],
    "autopilot": ["autopilot", "p/vehicle.toml", "-o", "autopilot.toml", "--json"],
    "autopilot lqr": ["autopilot", "cwolf", "-o", "lqr.toml", "--law", "lqr", "--json"],
    "fly": [
        "fly",
        "p/vehicle.toml",
        "autopilot.toml",
        "p/mission.toml",
        "--current",
        "0",
        "0.1",
        "0",
        "--sensors",
        "typical",
        "--no-figures",
        "--json",
        "-o",
        "fly",
    ],
    "fly seeds": [
        "fly",
        "cwolf",
        "cwolf",
        "e/missions/lawnmower.toml",
        "--current",
        "0.1",
        "0.2",
        "0",
        "--seeds",
        "6",
        "--sensors",
        "typical",
        "--turbulence",
        "0.03",
        "--no-figures",
        "--json",
        "-o",
        "seeds",
    ],
    "fly fault": [
        "fly",
        "bluerov2-heavy",
        "bluerov2-heavy",
        "e/missions/hover.toml",
        "--fault",
        "thruster_1@20",
        "--voltage",
        "15",
        "--no-figures",
        "--json",
        "-o",
        "fault",
    ],
    "fly farm": [
        "fly",
        "cwolf",
        "cwolf",
        "e/missions/farm_geographic.toml",
        "--no-figures",
        "--json",
        "-o",
        "farm",
    ],
    "identify cwolf": ["identify", "e/cwolf/campaign.toml", "--no-figures", "--json", "-o", "cwolf"],
    "tune cwolf": [
        "tune",
        "e/cwolf/campaign.toml",
        "--run",
        "cwolf",
        "--relay",
        "--no-figures",
        "--json",
        "-o",
        "tuned",
    ],
    "verify cwolf": [
        "verify",
        "e/cwolf/campaign.toml",
        "--run",
        "cwolf",
        "--autopilot",
        "tuned",
        "--runs",
        "256",
        "--compare",
        "--no-figures",
        "--json",
        "-o",
        "verified",
    ],
    "verify log": [
        "verify",
        "e/cwolf/campaign.toml",
        "--run",
        "cwolf",
        "--autopilot",
        "tuned",
        "--log",
        "logged",
        "--no-figures",
        "--json",
        "-o",
        "judged",
    ],
    "coverage": ["coverage", "e/cwolf/coverage.toml", "--seeds", "2", "--json", "-o", "coverage"],
    "beluga": ["identify", "e/beluga/campaign.toml", "--no-figures", "--json", "-o", "beluga"],
}
BEFORE = {
    "verify log": [
        "fly",
        "cwolf",
        "tuned/autopilot.toml",
        "e/missions/cage_survey.toml",
        "--current",
        "0.05",
        "0.1",
        "0",
        "--sensors",
        "typical",
        "--no-figures",
        "-o",
        "logged",
    ]
}


def flat(value: Any, key: str, into: dict[str, Any]) -> None:
    """Flatten plain data under keys of dots, floats to the last bit."""
    if isinstance(value, dict):
        into[f"{key}.{{}}"] = sorted(str(k) for k in value)
        for name, item in value.items():
            if not LEFT_OUT.search(str(name)):
                flat(item, f"{key}.{name}", into)
    elif isinstance(value, list):
        if len(value) > 40:
            into[key] = hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
        else:
            for i, item in enumerate(value):
                flat(item, f"{key}[{i}]", into)
    elif isinstance(value, float):
        into[key] = value.hex()
    else:
        into[key] = value


def names() -> dict[str, Any]:
    """Public names with their parameters and members."""
    import seatrial as st

    found: dict[str, Any] = {}
    for name in sorted(st.__all__):
        thing = getattr(st, name)
        try:
            found[name] = str(inspect.signature(thing))
        except (TypeError, ValueError):
            found[name] = "?"
        if inspect.isclass(thing):
            found[f"{name}.members"] = sorted(m for m in dir(thing) if not m.startswith("_"))
    return found


def record(only: list[str]) -> dict[str, Any]:
    """Answers of all commands."""
    root = Path(__file__).resolve().parents[2]
    python = os.environ.get("SEATRIAL_FREEZE_PYTHON", sys.executable)
    found: dict[str, Any] = {"names": names()}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "e").symlink_to(root / "examples")
        subprocess.run([python, "-m", "seatrial", "new", "p"], cwd=folder, check=True, capture_output=True)
        for name, command in COMMANDS.items():
            if (only and name not in only) or (name == "beluga" and "SEATRIAL_DATA" not in os.environ):
                continue
            if name in BEFORE:
                subprocess.run([python, "-m", "seatrial", *BEFORE[name]], cwd=folder, capture_output=True)
            done = subprocess.run(
                [python, "-m", "seatrial", *command], cwd=folder, capture_output=True, text=True
            )
            into: dict[str, Any] = {"exit": done.returncode}
            try:
                flat(json.loads(done.stdout), "json", into)
            except json.JSONDecodeError:
                into["error"] = done.stderr[-2000:]
            where = command[command.index("-o") + 1] if "-o" in command else None
            if where and (Path(folder) / where).is_dir():
                for file in sorted((Path(folder) / where).rglob("*")):
                    key = str(file.relative_to(Path(folder) / where))
                    if LEFT_OUT.search(key):
                        continue
                    if file.suffix == ".json":
                        flat(json.loads(file.read_text()), key, into)
                    elif file.suffix == ".parquet":
                        import polars

                        table = polars.read_parquet(file)
                        into[f"{key}.columns"] = table.columns
                        into[key] = hashlib.sha256(repr(table.rows()).encode()).hexdigest()
                    elif file.suffix == ".toml":
                        into[key] = hashlib.sha256(file.read_bytes()).hexdigest()
            found[name] = into
            print(name, done.returncode, len(into), flush=True)
    return found


def main() -> int:
    """Record or compare."""
    verb, file, only = sys.argv[1], Path(sys.argv[2]), sys.argv[3:]
    found = record(only)
    if verb == "record":
        file.write_bytes(gzip.compress(json.dumps(found, sort_keys=True).encode(), mtime=0))
        return 0
    kept = json.loads(gzip.decompress(file.read_bytes()))
    found = json.loads(json.dumps(found))
    differing = 0
    for name in found:
        for key in sorted({*kept.get(name, {}), *found[name]}):
            before, after = kept.get(name, {}).get(key, "-"), found[name].get(key, "-")
            if before != after:
                differing += 1
                if differing <= 200:
                    print(f"{name}: {key}: {before} -> {after}")
    print(f"{differing} differences")
    return differing > 0


if __name__ == "__main__":
    raise SystemExit(main())
