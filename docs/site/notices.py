"""Third-party notices of the wheel and of the page of a report, from what the tools of both languages tell.

``python -m docs.site.notices`` in the root of the clone writes two files; with ``--check`` it compares them
and fails where they differ, as `make check` does.

- ``THIRD_PARTY_NOTICES.txt``, which the wheel carries beside its licence: every crate that is linked into the
  core or into the core of a page, with the text of its licence, and every Python package that is asked for.
- ``python/seatrial/report/page/third_party.json``: names and licences, for the last section of a report.

Crates come from ``cargo metadata``: what the binding and the page's core depend on, on any machine. What only
builds or tests them is not in a binary, and neither are procedural macros. The packages are those that
``pyproject.toml`` asks for, extras that users install included, and theirs in turn, as `constraints.txt`
pins them; their licences are what pip-licenses reads. Each is installed from a package of its own, which
brings the text. Held by ``tests/docs/test_notices.py``.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
TEXTS = ROOT / "THIRD_PARTY_NOTICES.txt"
NAMES = ROOT / "python/seatrial/report/page/third_party.json"

LINKED = ("seatrial-python", "seatrial-wasm")
"""Packages of the workspace that ship, compiled."""

EXTRAS = ("logs", "distributed", "live")
"""Extras of ``pyproject.toml`` that users install."""

_MACHINE = {
    "python_version": "3.11",
    "python_full_version": "3.11.5",
    "sys_platform": "linux",
    "platform_system": "Linux",
    "platform_machine": "x86_64",
    "os_name": "posix",
}
"""The oldest Python that is supported: the list is the same wherever it is made."""

_LICENCE = re.compile(r"(licen[sc]e|copying|notice|unlicense)", re.IGNORECASE)

_HEAD = """\
Third-party notices of seatrial

1. Compiled into the core, and into the core that flies in the page of a report

{crates}
The Rust standard library ({rustc}), MIT OR Apache-2.0, copyright The Rust Project Developers.

2. Python packages that seatrial asks for, in the versions it is tested with

Each is installed from a package of its own, which brings the text of its licence.

{packages}

3. Texts of the licences of 1.
"""


def linked_crates(facts: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Packages of others that are linked into what ships, by name, as ``cargo metadata`` describes them.

    Parameters
    ----------
    facts : mapping
        Output of ``cargo metadata`` as JSON.
    """
    packages = {package["id"]: package for package in facts["packages"]}
    needs = {node["id"]: node["deps"] for node in facts["resolve"]["nodes"]}
    todo = [key for key, package in packages.items() if package["name"] in LINKED]
    linked: set[str] = set()
    while todo:
        key = todo.pop()
        if key in linked:
            continue
        linked.add(key)
        for need in needs[key]:
            macro = any("proc-macro" in target["kind"] for target in packages[need["pkg"]]["targets"])
            if not macro and any(use["kind"] is None for use in need["dep_kinds"]):
                todo.append(need["pkg"])
    foreign = [packages[key] for key in linked if packages[key]["source"] is not None]
    return sorted(foreign, key=lambda package: (package["name"], package["version"]))


def licence_texts(package: Mapping[str, Any]) -> list[str]:
    """Texts of a crate's licence: of a choice that of MIT alone, which asks for the least.

    Raises
    ------
    SystemExit
        The crate brings none.
    """
    files = [
        path
        for path in sorted(Path(package["manifest_path"]).parent.iterdir())
        if path.is_file() and _LICENCE.match(path.name)
    ]
    chosen = [path for path in files if "mit" in path.name.lower()] if "MIT" in package["license"] else []
    notices = [path for path in files if path.name.lower().startswith("notice") and path not in chosen]
    if not files:
        crate = f"{package['name']} {package['version']}"
        sys.exit(f"{crate}: expected a file with its licence, found none; ask its authors for one")
    return [path.read_text(encoding="utf-8").strip() for path in (chosen + notices if chosen else files)]


def required_packages(project: Mapping[str, Any]) -> list[str]:
    """Names of the Python packages that users install with seatrial, by name and with theirs in turn."""
    asked = [
        *project["dependencies"],
        *(line for e in EXTRAS for line in project["optional-dependencies"][e]),
    ]
    names: dict[str, str] = {}
    todo = [(Requirement(line), "") for line in asked]
    done: set[tuple[str, str]] = set()
    while todo:
        need, extra = todo.pop()
        if need.marker is not None and not need.marker.evaluate(_MACHINE | {"extra": extra}):
            continue
        package = metadata.distribution(need.name)
        name = package.metadata["Name"]
        names[name.lower()] = name
        for wanted in {"", *need.extras}:
            if (name, wanted) not in done:
                done.add((name, wanted))
                todo += [(Requirement(line), wanted) for line in package.requires or ()]
    return [names[key] for key in sorted(names)]


def _licences(names: list[str]) -> dict[str, dict[str, str]]:
    """Version and licence of Python packages, as pip-licenses reads them."""
    # The policy of pyproject.toml and its exceptions are for the check of the environment.
    tool = str(Path(sys.executable).with_name("pip-licenses"))
    command = [tool, "--format=json", "--with-system", "--allow-only=", "--ignore-packages", "-"]
    read = subprocess.run([*command, "--packages", *names], check=True, capture_output=True, text=True)
    by_name = {row["Name"].lower(): row for row in json.loads(read.stdout)}
    return {name: by_name[name.lower()] for name in names}


def _blocks(crates: list[dict[str, Any]]) -> Iterator[str]:
    """Every text once, under the crates whose it is."""
    owners: dict[str, list[str]] = {}
    shown: dict[str, str] = {}
    for package in crates:
        for text in licence_texts(package):
            key = re.sub(r"\s+", " ", text)
            shown.setdefault(key, text)
            owners.setdefault(key, []).append(f"{package['name']} {package['version']}")
    for key, text in shown.items():
        yield f"{'-' * 80}\n{', '.join(owners[key])}\n\n{text}\n"


def notices() -> dict[Path, str]:
    """Content of both files."""
    command = ["cargo", "metadata", "--locked", "--format-version", "1"]
    facts = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT)
    crates = linked_crates(json.loads(facts.stdout))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    packages = _licences(required_packages(project))
    rustc = tomllib.loads((ROOT / "rust-toolchain.toml").read_text())["toolchain"]["channel"]
    head = _HEAD.format(
        crates="\n".join(f"{one['name']} {one['version']}, {one['license']}" for one in crates),
        rustc=rustc,
        packages="\n".join(f"{name} {row['Version']}, {row['License']}" for name, row in packages.items()),
    )
    names = {
        "crates": [[one["name"], one["version"], one["license"]] for one in crates]
        + [["Rust standard library", rustc, "MIT OR Apache-2.0"]],
        "packages": {name: row["License"] for name, row in packages.items()},
    }
    return {
        TEXTS: head + "\n" + "\n".join(_blocks(crates)),
        NAMES: json.dumps(names, indent=1, ensure_ascii=False) + "\n",
    }


def main() -> None:
    """Write both files, or compare them."""
    for path, text in notices().items():
        if "--check" not in sys.argv[1:]:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            sys.exit(f"{path.relative_to(ROOT)} differs from what is linked and asked for: run make notices")


if __name__ == "__main__":
    main()
