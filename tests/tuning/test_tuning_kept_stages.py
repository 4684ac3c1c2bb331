"""A finished part of a tuning is taken from an earlier run for the same inputs, and for no other."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import seatrial as st
from seatrial.base.run import RunDirectory, part_file
from seatrial.identification.fitted import Fitted
from seatrial.tuning import loop_steps, tuning_run
from seatrial.tuning.control_problem import ControlProblem
from seatrial.tuning.loop_steps import LoopStepSettings
from seatrial.tuning.objective import ObjectiveSettings
from seatrial.tuning.search import GroupSearchSettings
from tests.tuning.tuning_campaigns import HEAD, campaign, cwolf, start
from tests.tuning.tuning_runs import Told

NOISY = "format = 1\n[sensors.depth]\nnoise_m = {noise}\n"
TWO = """
[tuning]
samples = 1
sensors = "FILE"
current_m_s = 0.1
margins = { phase_deg = 0.0, gain_db = 0.0, delay_s = 0.0 }
budget = { population = 8, generations = 6, simplex_rounds = 3 }
[tuning.loops.heading]
steps = [20.0]
speeds_m_s = [3.0]
corridor = { rise_s = 7.0 }
[tuning.loops.surge]
steps = [-0.3]
speeds_m_s = [3.0]
corridor = { rise_s = 6.0 }
"""
BOTH = ["heading", "surge"]
OF_HEADING, OF_SURGE = "heading.K_P.5", "surge.K_P.5"


class Bench:
    """Tunings in one run directory, in which the searches of the first one are kept."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, sensors: Path, folder: Path) -> None:
        self.monkeypatch, self.sensors, self.directory = monkeypatch, sensors, RunDirectory(folder / "run")
        self.sensors.write_text(NOISY.format(noise=0.01))
        self.text, self.seed, self.autopilot = TWO, 5, start()
        self.fitted = Fitted.of("cwolf", percent={"X_uu": 10.0})
        self.found = {"heading": {OF_HEADING: 40.0}, "surge": {OF_SURGE: 300.0}}

    def searched(self) -> list[str]:
        """Groups that a run had to search, in order; the others it took from an earlier one."""
        given = campaign(self.text, HEAD.replace("seed = 5", f"seed = {self.seed}"))
        table = given.file.tuning
        assert table is not None
        if table.sensors == "FILE":
            table = table.model_copy(update={"sensors": str(self.sensors)})
        told = Told(lambda group, gains: self.found[group])
        # What comes after the searches takes time and keeps nothing.
        self.monkeypatch.setattr(tuning_run, "revert_gains", lambda _, gains, *__, **___: (dict(gains), ()))
        self.monkeypatch.setattr(tuning_run, "tuned_autopilot", lambda start, *_: start)
        plan = ControlProblem.of_table(table, self.fitted, self.autopilot, name=given.name, seed=given.seed)
        told.run(self.monkeypatch, given, plan, self.directory)
        return [search.group for search in told.searches]

    def stage(self, name: str) -> Path:
        """File of what a search found."""
        return self.directory.workspace / part_file(name)

    @property
    def keys(self) -> dict[str, str]:
        """Hash of the inputs that each group was kept with."""
        return {name: json.loads(self.stage(name).read_text())["inputs"] for name in ("heading", "surge")}

    def change(self, **attributes: object) -> None:
        for name, value in attributes.items():
            setattr(self, name, value)

    def write(self, old: str, new: str) -> None:
        """Change the campaign."""
        assert old in self.text
        self.text = self.text.replace(old, new, 1)


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run that had to search everything."""
    folder = tmp_path_factory.mktemp("first")
    with pytest.MonkeyPatch.context() as monkeypatch:
        assert Bench(monkeypatch, folder / "sensors.toml", folder).searched() == BOTH
    return folder


@pytest.fixture
def bench(first: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Bench:
    copied = shutil.copytree(first, tmp_path / "copied")
    return Bench(monkeypatch, first / "sensors.toml", copied)


def pilot(name: str) -> st.Autopilot:
    """The start gains with one that is larger by a tenth."""
    return start().with_gains({name: 1.1 * start().gains()[name]})


def fit(**given: Any) -> Fitted:
    return replace(Fitted.of("cwolf", percent={"X_uu": 10.0}), **given)


CHANGES: dict[str, Callable[[Bench], object]] = {
    "seed": lambda bench: bench.change(seed=6),
    "noise in the file of sensors": lambda bench: bench.sensors.write_text(NOISY.format(noise=0.02)),
    "perfect sensors": lambda bench: bench.write("FILE", "perfect"),
    "corridor": lambda bench: bench.write("rise_s = 7.0", "rise_s = 6.9"),
    "step": lambda bench: bench.write("[20.0]", "[21.0]"),
    "budget": lambda bench: bench.write("simplex_rounds = 3", "simplex_rounds = 4"),
    "current": lambda bench: bench.write("current_m_s = 0.1", "current_m_s = 0.11"),
    "margins": lambda bench: bench.write("phase_deg = 0.0", "phase_deg = 1.0"),
    "start gain that is searched": lambda bench: bench.change(autopilot=pilot(OF_HEADING)),
    "start gain that nothing searches": lambda bench: bench.change(autopilot=pilot("heave.K_P.3")),
    "vehicle": lambda bench: bench.change(fitted=fit(vehicle=cwolf().with_coefficients({"X_uu": -12.0}))),
    "how well it is known": lambda bench: bench.change(fitted=Fitted.of("cwolf", percent={"X_uu": 11.0})),
    "which coefficient is uncertain": lambda bench: bench.change(fitted=fit(names=("Y_vv",))),
}


def test_a_second_run_of_the_same_searches_nothing(bench: Bench) -> None:
    before = bench.keys
    assert bench.searched() == []
    assert bench.keys == before


def test_two_groups_have_two_keys_whatever_was_found_between_them(bench: Bench) -> None:
    bench.stage("heading").unlink()
    bench.found["heading"] = {}
    bench.searched()
    assert bench.keys["heading"] != bench.keys["surge"]


@pytest.mark.parametrize("change", CHANGES)
def test_law_what_a_search_depends_on_is_searched_anew_when_it_changes(change: str, bench: Bench) -> None:
    before = bench.keys
    CHANGES[change](bench)
    assert bench.searched() == BOTH
    assert not set(bench.keys.values()) & set(before.values())


@pytest.mark.parametrize(
    ("module", "name", "settings"),
    [
        (tuning_run, "OBJECTIVE_SETTINGS", ObjectiveSettings(headroom_share=0.03)),
        (tuning_run, "GROUP_SEARCH_SETTINGS", GroupSearchSettings(generations=31)),
        (loop_steps, "SETTINGS", LoopStepSettings(least_settle_s=30.0)),
    ],
)
def test_what_the_file_leaves_open_counts_too(
    module: object, name: str, settings: object, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, name, settings)
    assert bench.searched() == BOTH


@pytest.mark.parametrize(("gain", "searched"), [(40.0, ["heading"]), (41.0, ["heading", "surge"])])
def test_a_group_is_searched_anew_when_an_earlier_one_finds_other_gains(
    gain: float, searched: list[str], bench: Bench
) -> None:
    before = bench.keys
    bench.stage("heading").unlink()  # its result is lost, and found again or not
    bench.found["heading"] = {OF_HEADING: gain}
    assert bench.searched() == searched
    assert bench.keys["heading"] == before["heading"]
    assert (bench.keys["surge"] == before["surge"]) == (searched == ["heading"])
