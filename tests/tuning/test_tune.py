"""`tune`: what is found, that threads and interruptions do not change it, what is kept and told."""

from __future__ import annotations

import json
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import tomlkit

import seatrial as st
from seatrial.base.errors import CampaignError, SeatrialError
from seatrial.base.work import Progress
from seatrial.control_design.margin_constraint import MarginConstraint
from seatrial.control_design.tuning_table import TuningTable
from seatrial.report.results.tuning import comparison_head, comparison_rows, gain_rows, sentences, trial_rows
from seatrial.tuning import tuning_run
from seatrial.tuning.result import assess, tuned_autopilot
from seatrial.tuning.search import GroupResult, search_group, search_margins
from tests.base.killed import kill
from tests.tuning.tuning_campaigns import HEADING, campaign, plan, start, tuned

ASTERN = """
[tuning]
samples = 0
current_m_s = 0.1
settle_s = 6.0
sensors = "perfect"
bounds = [0.05, 20.0]
budget = { population = 6, generations = 1, simplex_rounds = 1 }
[tuning.loops.surge]
steps = [0.3]
speeds_m_s = [-1.0]
corridor = { rise_s = 8.0, overshoot = 0.3, settling_s = 12.0, until_s = 15.0 }
"""
"""The start gains do not hold the hull astern, where it is unstable."""

TWO = (
    HEADING
    + """
[tuning.loops.surge]
steps = [0.3]
speeds_m_s = [1.5]
corridor = { rise_s = 6.0, overshoot = 0.3, settling_s = 9.0, until_s = 12.0 }
"""
)


found = tuned


def quick(text: str = HEADING) -> st.Campaign:
    return campaign(
        text.replace("generations = 6, simplex_rounds = 3", "generations = 2, simplex_rounds = 1")
    )


class Watch:
    """What was told of the progress, and a Ctrl-C at the second word on a search."""

    def __init__(self, stop: str = "") -> None:
        self.stop, self.seen = stop, list[Progress]()

    @property
    def stages(self) -> set[str]:
        return {state.what.partition(",")[0] for state in self.seen}

    def __call__(self, state: Progress) -> None:
        self.seen.append(state)
        if state.what == self.stop and state.step is not None and state.step.generation > 1:
            raise KeyboardInterrupt


def test_a_loop_that_leaves_its_corridor_is_tuned_into_it() -> None:
    begun, tuned = found().of("start"), found().of("tuned")
    assert begun is not None
    assert tuned is not None
    assert begun.nominal_s > 0.1
    assert not begun.feasible
    assert found().feasible
    assert tuned.nominal_s == 0.0
    # Twenty-four vehicles, currents and noises that the search has not met.
    assert tuned.samples == begun.samples == 24
    assert tuned.trials[0].held >= 0.9
    assert tuned.trials[0].rise_s < 7.0 < begun.trials[0].rise_s
    group, guidance = found().groups
    assert guidance.name == "guidance"
    assert group.before["violation"] > group.after["violation"] == 0.0


def test_the_autopilot_flies_as_it_was_assessed_and_only_searched_gains_differ() -> None:
    one = found()
    searched = {name for group in one.plan.groups for p in group.parameters.parameters for name in p.starts}
    searched |= {"guidance.lookahead_m", "guidance.integral_gain_m_s"}
    before, after = one.start.gains(), one.autopilot.gains()
    assert {name for name in after if after[name] != before[name]} <= searched
    for name, value in one.groups[0].gains.items():
        assert after[name] == pytest.approx(value, rel=1e-3)  # four digits are written
    again = st.Autopilot.from_toml(one.autopilot.to_toml())
    performance = assess(one.plan, "tuned", one.plan.rig(again, threads=1), one.plan.samples(0, 1))
    assert performance.feasible


def test_law_neither_threads_nor_workers_nor_a_second_run_change_the_result() -> None:
    one, two = (quick().tune(work=st.Work(threads=threads)) for threads in (1, 2))
    with ThreadPoolExecutor(2) as pool:
        other = quick().tune(work=st.Work(executor=pool))
    assert one.autopilot.gains() == two.autopilot.gains() == other.autopilot.gains()
    assert [trial for performance in one.performance for trial in performance.trials] == [
        trial for performance in two.performance for trial in performance.trials
    ]


@pytest.mark.long
def test_a_killed_tuning_goes_on_and_equals_an_undisturbed_one(tmp_path: Path) -> None:
    """kill -9 in the second group."""
    kill(
        """
        import seatrial as st
        from tests.tuning.test_tune import TWO, quick
        def watch(state):
            if state.what == "surge":
                die()
        quick(TWO).tune(work=st.Work(run_dir=folder / "run", progress=watch, threads=1))
        """,
        tmp_path,
    )
    assert not (tmp_path / "run").exists()
    whole, seen = quick(TWO).tune(work=st.Work(threads=1)), Watch()
    resumed = quick(TWO).tune(work=st.Work(run_dir=tmp_path / "run", progress=seen, threads=1))
    assert "heading" not in seen.stages
    assert resumed.autopilot.gains() == whole.autopilot.gains()
    assert resumed.performance[-1].trials == whole.performance[-1].trials
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]


@pytest.mark.long
def test_ctrl_c_keeps_the_best_and_the_next_run_goes_on_from_it(tmp_path: Path) -> None:
    whole = quick(TWO).tune(work=st.Work(threads=1))
    first = quick(TWO).tune(work=st.Work(run_dir=tmp_path / "run", progress=Watch(stop="surge"), threads=1))
    assert first.interrupted
    assert first.performance == ()
    assert not first.feasible
    assert not (tmp_path / "run").exists()
    assert "interrupted" in first.summary()
    done = [group.name for group in first.groups if not group.interrupted]
    assert done == ["heading"]
    last = first.groups[-1]
    assert last.name == "surge"
    # What it has so far is an autopilot that flies, and the summary says where.
    assert first.kept == tmp_path / "run.partial" / "autopilot.toml"
    kept = st.Autopilot.load(first.kept)
    assert kept.gains() == first.autopilot.gains() != first.start.gains()
    assert "run.partial/autopilot.toml, which `seatrial fly` takes" in first.summary()
    assert last.after["violation"] <= last.before["violation"]

    seen = Watch()
    second = quick(TWO).tune(work=st.Work(run_dir=tmp_path / "run", progress=seen, threads=1))
    assert not second.interrupted
    assert {state.what for state in seen.seen[:1]} == {"surge"}
    assert second.autopilot.gains() == whole.autopilot.gains()
    assert (tmp_path / "run" / "tuning.json").is_file()

    third = Watch()
    quick(TWO).tune(work=st.Work(run_dir=tmp_path / "run", progress=third, threads=1))
    assert third.seen == []  # all of it is there

    fresh = Watch(stop="heading")
    quick(TWO).tune(work=st.Work(run_dir=tmp_path / "run", progress=fresh, resume=False, threads=1))
    assert fresh.stages == {"heading"}


def test_progress_grows_from_search_to_search() -> None:
    seen = Watch()
    quick(TWO).tune(work=st.Work(progress=seen, threads=1))
    # A search that has to be done again was planned from the beginning.
    shares = [state.fraction for state in seen.seen]
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < shares[-1] <= 1.0
    assert all(state.left_s >= 0.0 for state in seen.seen)


def test_ctrl_c_while_start_gains_are_tried_again_keeps_what_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(tuning_run, "revert_gains", stopped)
    one = quick().tune(work=st.Work(run_dir=tmp_path / "run", threads=1))
    assert one.interrupted
    assert one.performance == ()
    assert one.kept is not None
    assert st.Autopilot.load(one.kept).gains() == one.autopilot.gains()


@pytest.mark.long
def test_margins_come_first_where_the_start_gains_leave_the_motion_unstable() -> None:
    one = plan(ASTERN)
    limits = one.table.margins
    shortfall = MarginConstraint(one.vehicle, one.autopilot, (-1.0,), limits=limits).margins({})
    assert any(point.growth_per_s[0] > 0.0 for point in shortfall)
    result = search_margins(one, seed=1)
    assert result is not None
    after = MarginConstraint(
        one.vehicle,
        tuned_autopilot(one.autopilot, result.gains, "small", "the campaign small", one.vehicle.name),
        (-1.0,),
    )
    assert all(point.growth_per_s[0] == 0.0 for point in after.margins({}))
    assert result.after["margin"] < 0.2 * result.before["margin"]
    # The speeds ahead have margins: their gains stay.
    assert not any(name.startswith("heading.") and name.endswith(".5") for name in result.gains)
    # With them the hull goes astern on its heading, which the start gains do not.
    still = one.samples(0, 1)
    calm, wild = (
        assess(one, "", one.rig(pilot, threads=1), still)
        for pilot in (
            tuned_autopilot(one.autopilot, result.gains, "small", "the campaign small", one.vehicle.name),
            one.autopilot,
        )
    )
    assert calm.nominal_s < wild.nominal_s


def test_no_limits_ask_for_no_search_of_margins() -> None:
    assert search_margins(plan(), seed=1) is None


def test_a_search_goes_on_from_the_gains_so_far() -> None:
    one = plan()
    (group,) = one.groups
    gains = dict(found().groups[0].gains)
    rig = one.rig(one.autopilot.with_gains(gains), max_step_s=0.04, threads=1)
    again = search_group(one, group, rig, one.samples(1, 5), seed=1, start=gains)
    assert again.before["violation"] == 0.0
    assert again.after["violation"] == 0.0


def test_a_group_s_result_reads_back_from_json() -> None:
    group, _ = found().groups
    kept = GroupResult.from_dict(json.loads(json.dumps(group.to_dict())))
    assert kept.to_dict() == group.to_dict()
    assert group.flown_s > 1000.0
    assert group.evaluations == sum(step.evaluations for step in group.history[-1:]) > 10


def test_the_worst_samples_are_among_the_responses_that_are_kept() -> None:
    begun = found().of("start")
    assert begun is not None
    kept = begun.responses["heading"]
    assert kept.values.shape == (1, 9, len(kept.t))
    since = kept.t - kept.trials.settle_s
    y = kept.normalised(0)[0]
    there = (since > 0.0) & (since < kept.trials.until_s)
    assert begun.trials[0].overshoot == pytest.approx(max(y[there].max() - 1.0, 0.0), abs=1e-9)
    assert kept.base(0) == 0.0


def test_a_vehicle_that_the_autopilot_does_not_know_is_assessed() -> None:
    one = found()
    own = one.on(one.plan.vehicle)
    assert own.trials[0].nominal_s == 0.0
    heavy = one.plan.vehicle.with_coefficients({"N_rdot": -400.0})
    other = one.on(heavy, name="truth")
    assert other.name == "truth"
    assert other.trials[0].rise_s != own.trials[0].rise_s


def test_summary_and_tables_tell_verdict_gains_and_margins() -> None:
    one = found()
    text = one.summary()
    for words in (
        "The response of the vehicle itself stays within its corridor, there and back",
        "Responses with the start gains",
        "Responses with the tuned gains",
        "Side by side",
        "heading K_P",
        "N m/rad",
        "Margins with the tuned gains",
    ):
        assert words in text, words
    tuned = one.of("tuned")
    assert tuned is not None
    assert trial_rows(tuned)[0][:3] == ("heading", "3.00", "+20 deg")
    (row,) = comparison_rows(one.performance)
    assert len(row) == len(comparison_head(one.performance))
    assert row[0] == "heading"
    units = {row[0]: row[1] for row in gain_rows(one.start, one.autopilot, one.plan.places)}
    assert {units[name] for name in units if name.endswith("K_D")} <= {"N s2/m", "N s/m", "N m s/rad"}
    assert {row[0] for row in gain_rows(one.start, one.autopilot, one.plan.places)} >= {
        "heading K_P",
        "heading K_I",
        "heading K_D",
    }


def test_a_response_outside_its_corridor_is_named() -> None:
    hard = HEADING.replace("rise_s = 7.0", "rise_s = 1.2")
    one = quick(hard).tune(work=st.Work(threads=1))
    vars(one)["margins"] = found().margins  # taking them takes seconds
    assert not one.feasible
    said = " ".join(sentences(one))
    assert "1 of 1 responses of the vehicle itself leaves its corridor" in said
    assert "heading at 3.00 m/s, step of +20 deg: outside by" in said
    # It says why: the motors cannot do that, noise or not.
    assert "1.2 s are asked; raise rise_s, or take smaller steps" in said
    assert one.quiet is not None
    assert one.quiet.trials[0].rise_s > 1.2


def test_results_are_plain_data_and_files(tmp_path: Path) -> None:
    one = found()
    plain: dict[str, Any] = json.loads(json.dumps(one.to_dict(), allow_nan=True))
    assert plain["feasible"] is True
    assert plain["gains"]["tuned"] == one.autopilot.gains()
    assert [performance["name"] for performance in plain["performance"]] == ["start", "tuned"]
    run = one.save(tmp_path / "run")
    assert run == tmp_path / "run"
    files = {path.name for path in run.iterdir()}
    assert files >= {
        "autopilot.toml",
        "campaign.toml",
        "history.parquet",
        "run.json",
        "start_autopilot.toml",
        "summary.txt",
        "trials.parquet",
        "tuning.json",
        "vehicle.toml",
    }
    written = st.Autopilot.load(run / "autopilot.toml")
    assert written.name == "small tuned"
    assert written.gains() == one.autopilot.gains()
    trials = pl.read_parquet(run / "trials.parquet")
    assert trials["autopilot"].to_list() == ["start", "tuned"]
    assert pl.read_parquet(run / "history.parquet")["best"].is_not_null().all()
    assert json.loads((run / "run.json").read_text())["kind"] == "tuning"


def test_a_refused_tuning_leaves_nothing_behind(tmp_path: Path) -> None:
    lost = HEADING.replace("samples = 1", 'samples = 1\nsensors = "lost.toml"')
    with pytest.raises(SeatrialError, match=r"lost\.toml"):
        campaign(lost, folder=tmp_path).tune(work=st.Work(run_dir=tmp_path / "run", threads=1))
    with pytest.raises(SeatrialError, match="expected a fit of cwolf, found one of lauv"):
        campaign().tune("lauv", work=st.Work(run_dir=tmp_path / "run", threads=1))
    assert not list(tmp_path.iterdir())


def test_without_loops_every_loop_at_work_is_planned() -> None:
    assert set(campaign("[tuning]").control_problem().loops) == {"surge", "heave", "pitch", "heading"}
    assert start().name == plan().autopilot.name == "cwolf start"


CORRIDOR = {"rise_s": 5.0, "overshoot": 0.3, "settling_s": 10.0, "settled": 0.1, "until_s": 12.0}
LOOPS = {"heading": {"steps": [20.0], "speeds_m_s": [1.5], "corridor": CORRIDOR}}
SHORT = {
    "samples": 0,
    "settle_s": 6.0,
    "margins": {"phase_deg": 0.0, "gain_db": 0.0, "delay_s": 0.0},
    "budget": {"population": 8, "generations": 1, "simplex_rounds": 1},
}


@pytest.mark.long
def test_law_a_tuning_without_a_file_is_that_of_the_campaign_that_says_the_same(tmp_path: Path) -> None:
    text = tomlkit.dumps({"format": 1, "name": "small", "seed": 5, "vehicle": "cwolf", "autopilot": "cwolf"})
    text += tomlkit.dumps({"tuning": {"loops": LOOPS} | SHORT})
    by_file = st.Campaign.from_toml(text).tune(work=st.Work(threads=1))
    given = st.tune(
        "cwolf",
        "cwolf",
        loops=LOOPS,
        settings=SHORT,
        name="small",
        seed=5,
        work=st.Work(run_dir=tmp_path / "run", threads=1),
    )
    assert given.plan.given_text is None
    assert given.autopilot.gains() == by_file.autopilot.gains()
    assert given.performance[-1].trials == by_file.performance[-1].trials
    assert sentences(given) == sentences(by_file)
    written = tomllib.loads((tmp_path / "run" / "tuning.toml").read_text())["tuning"]
    assert TuningTable.model_validate(written) == given.plan.table


def test_what_a_tuning_without_a_file_lacks_is_named() -> None:
    with pytest.raises(CampaignError, match="a vehicle and its autopilot"):
        st.tune("cwolf")
    with pytest.raises(CampaignError, match=r"relay tuning is not offered.* seatrial\.start_autopilot"):
        st.tune("cwolf", "cwolf", relay=True)
    with pytest.raises(CampaignError, match="heding"):
        st.tune("cwolf", "cwolf", loops={"heding": {}})
    with pytest.raises(CampaignError, match="seed: the problem says that"):
        st.tune(st.ControlProblem("cwolf", "cwolf"), seed=3)
    with pytest.raises(CampaignError, match=r"use campaign\.tune\("):
        st.tune(campaign())  # type: ignore[arg-type]
    with pytest.raises(CampaignError, match="voltage_v"):
        st.tune("bluerov2-heavy", "bluerov2-heavy")
