"""`seatrial.verify`: the known case, missions by their number, replay, resuming, verdicts, files."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from xml.etree import ElementTree

import numpy as np
import polars as pl
import pytest
from scipy.stats import binom, norm

import seatrial as st
from seatrial.base.work import Progress
from seatrial.identification.fitted import Fitted
from seatrial.report.plot.verification import WorstFlight, drawings, worst_missions
from seatrial.verification import missions as mission_series
from seatrial.verification.flown_missions import FlownMissions, metrics_for_requirements
from seatrial.verification.judgement import judged
from seatrial.verification.missions import CampaignFlights
from seatrial.verification.requirement import Requirement
from seatrial.verification.verify import Verification, VerifySettings, compared, mcnemar
from tests.base.killed import kill
from tests.flight.flying import OUT
from tests.report.figures import assert_on_page
from tests.verification.verifying import SHORT, campaign

# The obstacle lies 10 km ahead: the clearance after 0.1 s is 10 km less the scatter of the start, and the
# scatter to the east and the motion change it by less than a millimetre.
KNOWN = """
[verification]
runs = 250
missions = ["out.toml"]
sensors = "perfect"
max_time_s = 0.1
current = { speed_m_s = 0.0 }
start = { position_m = 1.0, depth_m = 0.0, heading_deg = 0.0 }
obstacles = { north_m = 10001.0, east_m = 0.0, radius_m = 1.0 }
[[verification.requirements]]
name = "starts behind the line"
holds = "clearance_m >= 9997.55" # of the hull: half its length less
probability = 0.8849303297782918
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("verify")
    campaign(made)  # with its mission
    return made


@pytest.fixture(scope="module")
def found(folder: Path) -> Verification:
    return campaign(folder).verify()


def same(one: Verification, other: Verification, count: int | None = None) -> bool:
    """Whether the first missions are the same bit by bit."""
    a, b = one.flown, other.flown
    columns = [(a.metrics[name], b.metrics[name]) for name in a.metrics]
    columns += [(a.causes[name], b.causes[name]) for name in a.causes]
    columns += [(a.numbers, b.numbers), (a.true_counts, b.true_counts)]
    return all(x[:count].tolist() == y[:count].tolist() or _same(x[:count], y[:count]) for x, y in columns)


def _same(x: Any, y: Any) -> bool:
    return x.dtype.kind == "f" and bool(np.array_equal(x, y, equal_nan=True))


@pytest.mark.long
def test_the_interval_covers_a_known_failure_probability_as_often_as_it_says(tmp_path: Path) -> None:
    # Failure: the start lies more than 1.2 m to the north, P = 1 - Phi(1.2).
    truth, seeds = float(norm.sf(1.2)), 40
    assert math.isclose(truth, 1.0 - 0.8849303297782918)
    rows = [campaign(tmp_path, KNOWN, seed=seed).verify().requirements[0] for seed in range(seeds)]
    inside = sum(row.found.interval[0] <= truth <= row.found.interval[1] for row in rows)
    # The exact interval covers in at least 95 % of the seeds; fewer than this in one of a thousand tests.
    assert inside >= binom.ppf(1e-3, seeds, 0.95)
    # Its requirement allows just this probability: either verdict is wrong with at most 5 %.
    for verdict in ("held", "failed"):
        assert sum(row.verdict == verdict for row in rows) <= binom.isf(1e-3, seeds, 0.05)
    # Failures of all seeds together are those of independent draws.
    failures, runs = sum(row.found.failures for row in rows), sum(row.found.runs for row in rows)
    low, high = binom.ppf([5e-4, 1.0 - 5e-4], runs, truth)
    assert low <= failures <= high
    assert len({row.found.failures for row in rows}) > 5
    # Each seed names what drives the failures, and nothing else as its leader.
    assert {row.causes[0].name for row in rows} == {"start off to the north"}


def test_a_mission_depends_on_its_number_alone(folder: Path, found: Verification) -> None:
    longer = campaign(folder).verify(runs=33, work=st.Work(threads=1))
    assert same(found, longer, 24)
    assert not same(found, campaign(folder, seed=8).verify())
    alone = longer.flights.fly([32])
    for name, values in longer.flown.metrics.items():
        assert np.array_equal(values[32:], alone.metrics[name], equal_nan=values.dtype.kind == "f"), name


def test_a_replay_has_the_figures_of_its_mission_to_the_bit(found: Verification) -> None:
    flown = found.flown
    for number in (0, 5, *{run.number for run in found.requirement("is complete").worst[:2]}):
        flight = found.replay(number)
        row = flown.place(number)
        assert flight.outcome == flown.metrics["ending"][row]
        for name, value in flight.metrics.items():
            assert np.array_equal(flown.metrics[name][row], value, equal_nan=True), (number, name)
        words = [alert.cause for alert in flight.alerts][-1:] or [""]
        assert flown.metrics["alert"][row] == words[0]
        assert flight.circumstances.seed == flown.seeds[row]
        drawn = flight.vehicle.coefficients()["X_uu"]
        assert drawn != found.flights.fitted.vehicle.coefficients()["X_uu"]
        assert flight.circumstances.model.to_toml() == found.flights.fitted.vehicle.to_toml()


def test_missions_fly_in_the_water_that_the_campaign_states(tmp_path: Path) -> None:
    asked = """
    [verification]
    missions = ["out.toml"]
    confidence = 0.8
    voltage_v = 13.5
    seabed = { depth_m = 30.0, slope_east = 0.1 }
    current = { turbulence_times_s = [30.0, 3.0], walk_m_s = 0.1 }
    waves = { height_m = 0.4, period_s = 6.0, toward_deg = 90.0 }
    obstacles = { north_m = 500.0, east_m = 0.0, radius_m = 1.0 }
    max_time_s = 2.0
    [environment]
    rho_kg_m3 = 1000.0
    g_m_s2 = 9.78
    """
    found = campaign(tmp_path, asked, vehicle="bluerov2-heavy").verify(runs=2)
    around = found.replay(1).circumstances
    assert (around.voltage_v, around.rho, around.g, around.max_time_s) == (13.5, 1000.0, 9.78, 2.0)
    assert (around.seabed, around.turbulence_times_s) == ((30.0, 0.0, 0.1), (30.0, 3.0))
    assert around.current_walk == (0.1, 0.1, 0.0)
    assert around.waves == st.SeaState(0.4, 6.0, toward_deg=90.0)
    assert around.obstacles == ((500.0, 0.0, 1.0),)
    assert {one.found.confidence for one in found.requirements} == {0.8}


def test_failures_that_were_drawn_are_those_of_the_replay(found: Verification) -> None:
    faulty = np.flatnonzero(found.flown.causes["fault"] > 0.0)
    assert len(faulty)
    number = int(found.flown.numbers[faulty[0]])
    (fault,) = found.replay(number).circumstances.faults
    assert found.flown.causes[f"fault of {fault.actuator}"][faulty[0]] == 1.0
    assert not fault.stuck
    assert fault.stuck_at is None
    silent = np.flatnonzero(found.flown.causes["outage of depth, s"] > 0.0)
    (outage,) = found.replay(int(found.flown.numbers[silent[0]])).circumstances.outages
    assert outage.of == "depth"
    assert outage.until_s - outage.from_s == found.flown.causes["outage of depth, s"][silent[0]]


def test_ctrl_c_keeps_what_was_flown_and_the_same_call_goes_on(
    folder: Path, found: Verification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mission_series, "MISSION_SETTINGS", mission_series.MissionSettings(chunk=8))
    flown: list[int] = []
    fly = CampaignFlights.fly

    def counted(self: CampaignFlights, numbers: Any, **options: Any) -> Any:
        flown.extend(np.asarray(numbers).tolist())
        return fly(self, numbers, **options)

    def stop(state: Progress) -> None:
        if state.done == 16:
            raise KeyboardInterrupt

    monkeypatch.setattr(CampaignFlights, "fly", counted)
    run_dir = tmp_path / "run"
    cut = campaign(folder).verify(work=st.Work(run_dir=run_dir, progress=stop))
    assert cut.interrupted
    assert len(cut.flown) == 16
    assert "(interrupted)" in cut.summary()
    assert json.loads((run_dir / "verification.json").read_text())["missions"]["flown"] == 16
    states: list[Progress] = []
    whole = campaign(folder).verify(work=st.Work(run_dir=run_dir, progress=states.append))
    assert flown == list(range(24))
    assert not whole.interrupted
    assert same(whole, found)
    assert [state.done for state in states] == [8, 16, 24]
    # Nothing is known of the time while all missions come from the earlier run.
    assert [math.isnan(state.left_s) for state in states] == [True, True, False]
    assert states[-1].left_s == 0.0
    assert "24 of 24 missions flown" in states[-1].detail
    # More missions begin with those that lie in the run directory; other inputs use none of them.
    flown.clear()
    campaign(folder).verify(work=st.Work(run_dir=run_dir), runs=32)
    assert flown == list(range(24, 32))
    flown.clear()
    campaign(folder, seed=8).verify(work=st.Work(run_dir=run_dir), runs=8)
    assert flown == list(range(8))


@pytest.mark.long
def test_a_killed_verification_goes_on_and_equals_an_undisturbed_one(
    folder: Path, found: Verification, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """kill -9 after the second chunk of missions."""
    kill(
        """
        import seatrial as st
        from seatrial.verification import missions
        from tests.verification.verifying import campaign
        missions.MISSION_SETTINGS = missions.MissionSettings(chunk=8)
        work = st.Work(run_dir=folder / "run", progress=lambda state: state.done == 16 and die())
        campaign(folder).verify(work=work)
        """,
        tmp_path,
    )
    assert not (tmp_path / "run").exists()
    monkeypatch.setattr(mission_series, "MISSION_SETTINGS", mission_series.MissionSettings(chunk=8))
    flown: list[int] = []
    fly = CampaignFlights.fly

    def counted(self: CampaignFlights, numbers: Any, **options: Any) -> Any:
        flown.extend(np.asarray(numbers).tolist())
        return fly(self, numbers, **options)

    monkeypatch.setattr(CampaignFlights, "fly", counted)
    resumed = campaign(tmp_path).verify(work=st.Work(run_dir=tmp_path / "run"))
    assert flown == list(range(16, 24))
    assert same(resumed, found)
    assert resumed.outcome == found.outcome


def test_law_kept_missions_are_taken_up_for_the_same_inputs_alone(folder: Path) -> None:
    flights = campaign(folder).scenario().flights
    vehicle, table = flights.fitted.vehicle, flights.table
    names, matrix = ("X_uu",), np.array([[1.0]])
    (farther,) = (st.Mission.from_toml(one.to_toml().replace("60.0", "61.0")) for one in flights.missions)
    others = {
        "seed": {"seed": 8},
        "gains": {"autopilot": flights.autopilot.with_gains({"guidance.integral_gain_m_s": 0.0})},
        "vehicle": {"fitted": Fitted.of(vehicle.with_coefficients({"X_uu": -9.0}))},
        "coefficients that vary": {"fitted": Fitted(vehicle, names, matrix)},
        "how far they vary": {"fitted": Fitted(vehicle, names, 2.0 * matrix)},
        "model": {"model": vehicle.with_coefficients({"X_uu": -9.0})},
        "mission": {"missions": (farther,)},
        "sensors": {"sensors": None},
        "water": {"rho": 1000.0},
        "gravity": {"g": 9.78},
        "table": {"table": table.model_copy(update={"max_time_s": 100.0})},
    }
    digests = {name: replace(flights, **changed).digest for name, changed in others.items()}  # type: ignore[arg-type]
    assert len({flights.digest, *digests.values()}) == 1 + len(others), digests
    # What is asked of missions that are flown does not change them.
    asked = table.model_copy(update={"runs": 9, "requirements": (), "confidence": 0.9, "keep_worst": 1})
    assert replace(flights, table=asked).digest == flights.digest


def test_ctrl_c_before_the_first_missions_leaves_nothing(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(self: CampaignFlights, numbers: Any, **options: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(CampaignFlights, "fly", stop)
    with pytest.raises(KeyboardInterrupt):
        campaign(folder).verify(work=st.Work(run_dir=tmp_path / "run"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cross_track_p95_m <=", "cross_trak_p95_m <=", "did you mean"),
        ('"out.toml"', '"away.toml"', "there is no file"),
        ('"stern", prob', '"sterm", prob', "did you mean"),
        ('"depth", prob', '"dept", prob', "did you mean"),
        ('"*_uu" = 10.0', '"*_uuu" = 10.0', "_uuu"),
        ("runs = 24", 'runs = 24\nsensors = "usual"', "usual"),
    ],
)
def test_bad_input_is_refused_before_anything_flies(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, old: str, new: str, words: str
) -> None:
    monkeypatch.delattr(CampaignFlights, "fly")
    with pytest.raises(st.SeatrialError, match=words):
        campaign(folder, SHORT.replace(old, new)).verify(work=st.Work(run_dir=tmp_path / "run"))
    assert not list(tmp_path.iterdir())


def test_a_campaign_without_verification_needs_missions(folder: Path) -> None:
    with pytest.raises(st.CampaignError, match=r"campaign.toml: expected the table \[verification\]"):
        campaign(folder, "").verify()
    found = campaign(folder, "").verify(missions=[folder / "out.toml"], runs=2)
    assert found.flights.titles == ("out",)
    asked = {one.requirement.name: one.requirement.holds for one in found.requirements}
    assert asked == {
        "is complete": 'ending == "complete" and not abort',
        # The tightest sphere of 5 m, and 1.96 times the 1.5 m by which a dive's GPS fix is off.
        "keeps its path": "true_cross_track_p95_m <= 8",
    }
    assert any("off by 1.5 m (1 sd)" in note for note in found.notes)
    exact = campaign(folder, SHORT[: SHORT.index("[[")].replace("runs = 24", 'runs = 2\nsensors = "perfect"'))
    (path,) = (one for one in exact.verify().requirements if one.requirement.name == "keeps its path")
    assert path.requirement.holds == "true_cross_track_p95_m <= 5"
    assert any("states no requirements" in note for note in found.notes)
    assert any("same coefficients" in note for note in found.notes)
    with pytest.raises(st.CampaignError, match="expected another autopilot"):
        campaign(folder).verify(compare=True)
    with pytest.raises(st.CampaignError, match="two are called 'out'"):
        campaign(folder).verify(missions=[folder / "out.toml", folder / "out.toml"])


def test_a_diverged_mission_has_no_numbers_and_holds_nothing_that_rests_on_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    endings, watches = (st._core.autopilot_names()[name] for name in ("endings", "watches"))
    raw = {
        "duration_s": np.array([50.0, np.nan, 60.0]),
        "clearance_m": np.array([9.0, 9.0, 1.0]),
        "ending": np.array([float(endings.index(one)) for one in ("complete", "complete", "aborted")]),
        "alert": np.array([0.0, 0.0, 1.0]),
        "alert_cause": np.array([0.0, np.nan, 1.0]),
        "alert_time_s": np.array([0.0, 0.0, 33.0]),
    }
    monkeypatch.setattr("seatrial.verification.flown_missions.metrics_of", lambda _: raw)
    counts = np.array([[4, 1], [0, 0], [9, 9]])
    flights = SimpleNamespace(cross_track_counts=counts, true_cross_track_counts=counts)
    found, (seen, _) = metrics_for_requirements(cast(Any, flights))
    assert found["ending"].tolist() == ["complete", "diverged", "aborted"]
    assert found["abort"].tolist() == [False, True, True]
    assert found["alert"].tolist() == ["", "", watches[0]]
    assert np.isnan(found["alert_time_s"]).tolist() == [True, True, False]
    assert seen.tolist() == [[3.0, 1.0], [0.0, 0.0], [0.0, 9.0]]
    for holds in ("clearance_m > 5", "not (clearance_m < 5)", "not abort", 'ending == "complete"'):
        assert not Requirement("r", holds).judge(found).held[1], holds


def test_requirements_are_judged_by_the_figures_of_the_missions(found: Verification) -> None:
    metrics, complete = found.flown.metrics, found.requirement("is complete")
    assert complete.verdict == "held"
    assert complete.found.failures == np.count_nonzero(metrics["ending"] != "complete")
    path = found.requirement("keeps its path")
    assert path.found.failures == np.count_nonzero(~(metrics["cross_track_p95_m"] <= 1.0))
    assert [run.reserve for run in path.worst] == sorted(run.reserve for run in path.worst)
    assert len(path.worst) == 5
    with pytest.raises(KeyError):
        found.requirement("floats")
    # Held by words none is the worst.
    asked = [Requirement("ends", 'ending != "diverged"')]
    (ends,) = judged(asked, found.flown, missions=found.flights.titles, confidence=0.9, keep_worst=3)
    assert (ends.found.failures, ends.worst, ends.found.confidence) == (0, (), 0.9)


@pytest.mark.parametrize(
    ("holds", "verdict"),
    [
        ("duration_s < 0", "failed"),
        # 24 missions without a failure show at most 1 - 0.05^(1/24) = 12 %.
        ("duration_s > 0", "undecided"),
    ],
)
def test_the_verdict_is_that_of_the_worst_requirement(folder: Path, holds: str, verdict: str) -> None:
    further = f'[[verification.requirements]]\nname = "lasts"\nholds = "{holds}"\nprobability = 0.99\n'
    # 13 of 24 missions leave the path or never settle on it, at most 72 % at 95 % confidence.
    lenient = SHORT.replace("probability = 0.5", "probability = 0.2")
    found = campaign(folder, lenient + further).verify()
    assert [one.verdict for one in found.requirements] == ["held", "held", verdict]
    assert found.outcome == verdict
    assert not found.held
    assert campaign(folder, lenient).verify().held


def test_missions_are_mixed_by_weight_and_told_apart(folder: Path) -> None:
    (folder / "back.toml").write_text((folder / "out.toml").read_text().replace("60.0", "-60.0"))
    mixed = SHORT.replace('["out.toml"]', '["out.toml", { file = "back.toml", weight = 3.0 }]')
    found = campaign(folder, mixed).verify()
    (path, _) = found.requirements
    assert list(path.by_mission) == ["out", "back"]
    assert sum(part.runs for part in path.by_mission.values()) == 24
    assert path.by_mission["back"].runs > path.by_mission["out"].runs
    assert sum(part.failures for part in path.by_mission.values()) == path.found.failures
    number = int(np.flatnonzero(found.flown.mission == 1)[0])
    flight = found.replay(number)
    assert flight.mission.to_toml() == found.flights.missions[1].to_toml()
    assert flight.metrics["distance_m"] == found.flown.metrics["distance_m"][number]


def test_autopilots_are_compared_on_the_same_draws(folder: Path) -> None:
    lazy = st.Autopilot.load("cwolf").with_gains({"guidance.integral_gain_m_s": 0.0})
    strict = SHORT.replace("<= 1.0", "<= 0.6")
    found = campaign(folder, strict).verify(gains="cwolf", compare={"lazy": lazy, "same": "cwolf"})
    assert found.comparison is not None
    assert found.comparison.runs == 24
    same_as = found.comparison.pair("keeps its path", "same")
    assert (same_as.only_verified, same_as.only_other, same_as.p_value) == (0, 0, 1.0)
    assert same_as.words == "no difference shown"
    pair = found.comparison.pair("keeps its path", "lazy")
    verified, other, _ = found.comparison.autopilots
    difference = other.failures["keeps its path"].failures - verified.failures["keeps its path"].failures
    assert pair.only_other - pair.only_verified == difference
    assert "on the same 24 draws" in found.summary()


def test_a_part_of_many_missions_is_compared(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("seatrial.verification.verify.SETTINGS", VerifySettings(least_compared=3))
    found = campaign(folder).verify(gains="cwolf", compare={"same": "cwolf"}, runs=6)
    assert found.comparison is not None
    verified, other = found.comparison.autopilots
    assert found.comparison.runs == verified.failures["keeps its path"].runs == 3
    assert verified.failures == other.failures
    assert found.requirement("keeps its path").found.runs == 6


def test_lit_mcnemar_1947_is_the_binomial_test_of_the_pairs_that_differ() -> None:
    # Fay 2011 (R package exact2x2, vignette): 2 and 9 of the pairs differ, p = 0.06543 on two sides.
    held = np.array([False] * 2 + [True] * 9 + [True] * 30)
    other = np.array([True] * 2 + [False] * 9 + [True] * 30)
    b, c, p = mcnemar(held, other)
    assert (b, c) == (2, 9)
    assert p == pytest.approx(0.06543, abs=5e-6)


def test_comparisons_are_corrected_for_their_number() -> None:
    def flown(times: list[float]) -> FlownMissions:
        k, none = np.arange(len(times)), np.zeros((len(times), 1))
        metrics = {"duration_s": np.array(times), "distance_m": np.array(times)}
        return FlownMissions(k, 0 * k, k, metrics, {}, none, none, 1.0)

    asked = [Requirement("soon", "duration_s < 5"), Requirement("short", "distance_m < 5")]
    every = {"verified": flown([1.0] * 10), "start": flown([1.0] * 4 + [9.0] * 6)}
    # Six against none: 2 / 2^6 alone, twice that of two requirements (Holm).
    (one,) = compared(asked[:1], every, confidence=0.95).pairs
    assert (one.corrected, one.better, one.words) == (0.03125, "verified", "verified is better")
    both = compared(asked, every, confidence=0.95).pairs
    assert [(pair.p_value, pair.corrected, pair.better) for pair in both] == [(0.03125, 0.0625, None)] * 2
    turned = dict(reversed(every.items()))
    (one,) = compared(asked[:1], turned, confidence=0.95).pairs
    assert (one.only_verified, one.only_other, one.better) == (6, 0, "verified")


def test_the_run_directory_tells_all(folder: Path, found: Verification, tmp_path: Path) -> None:
    run = found.save(tmp_path / "run")
    names = {path.relative_to(run).as_posix() for path in run.rglob("*") if path.is_file()}
    assert names == {
        "run.json", "campaign.toml", "vehicle.toml", "autopilot.toml", "missions/out.toml",
        "verification.json", "chunks.json",
        "summary.txt", "report.json", "junit.xml", "worst_runs.json", "missions.parquet",
    }  # fmt: skip
    data = json.loads((run / "verification.json").read_text())
    assert data["outcome"] == found.outcome
    assert [row["failures"] for row in data["requirements"]] == [r.found.failures for r in found.requirements]
    suite = ElementTree.fromstring((run / "junit.xml").read_text())
    assert suite.get("failures") == str(sum(one.verdict != "held" for one in found.requirements))
    worst = json.loads((run / "worst_runs.json").read_text())
    assert [row["number"] for row in worst["keeps its path"]] == found.worst()["keeps its path"]
    missions = pl.read_parquet(run / "missions.parquet")
    assert missions.height == 24
    for name in ("cross_track_p95_m", "true_cross_track_p95_m"):
        np.testing.assert_array_equal(missions[name].to_numpy(), found.flown.metrics[name])
    facts = json.loads((run / "run.json").read_text())
    assert facts["seed"] == 7
    summary = (run / "summary.txt").read_text()
    assert summary.startswith(f"{found.scenario.name}: {found.outcome}. ")
    assert "seatrial verify campaign.toml --replay" in summary


def test_missions_of_similar_names_have_files_of_their_own(folder: Path, tmp_path: Path) -> None:
    texts = {}
    for north in (60, 61, 62):
        texts[north] = OUT.replace("60.0", f"{north}.0")
        (folder / f"leg{north}.toml").write_text(texts[north])
    names = ("leg, north", "leg--north", "leg " + "n" * 190)
    rows = [
        f'{{ file = "leg{north}.toml", name = "{name}" }}' for north, name in zip(texts, names, strict=True)
    ]
    found = campaign(folder, SHORT.replace('"out.toml"', ", ".join(rows))).verify(runs=6)
    run = found.save(tmp_path / "run")
    kept = {path.stem: st.Mission.load(path).to_toml() for path in (run / "missions").iterdir()}
    assert set(kept) == {"leg--north", "leg--north-2", "leg-" + "n" * 76}
    assert sorted(kept.values()) == sorted(one.to_toml() for one in found.flights.missions)


def test_what_the_draws_do_not_contain_is_said_wherever_the_verdict_is_read(folder: Path) -> None:
    fitted = Fitted.of("cwolf", percent={"X_uu": 10.0})
    doubted = replace(fitted, notes=("The truth lies outside the model class.",))
    found = campaign(folder).verify(doubted, runs=2)
    (note,) = doubted.notes
    assert note in found.notes
    assert note in found.summary()
    assert note in found.to_dict()["notes"]
    assert f'value="{note}"' in found.junit()


def test_figures_can_be_printed_and_show_the_worst_missions(found: Verification) -> None:
    names = list(drawings(found))
    assert names[:2] == ["requirements", "cross_track"]
    assert {"worst_keeps_its_path", "causes_keeps_its_path"} <= set(names)
    flight = found.replay(found.worst()["keeps its path"][0])
    figure = worst_missions([WorstFlight("mission 3", flight)], heading="worst")
    assert_on_page(figure)
    lines = [line for axes in figure.axes for line in axes.get_lines() if line.get_label() == "mission 3"]
    assert np.allclose(np.asarray(lines[0].get_xdata(), dtype=float), flight.position[:, 1])
