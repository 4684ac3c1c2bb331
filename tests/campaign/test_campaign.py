"""Campaigns: names resolved against the vehicle and the trials, and what is refused before a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial.base.errors import CampaignError, VehicleError
from seatrial.bench_test.evaluate import fingerprint
from seatrial.campaign.campaign import Campaign
from seatrial.estimation.segment_model import cut

HEAD = """
format = 1
name = "tank"
vehicle = "cwolf"
"""
TRIAL = """
[trials.surge]
file = "surge.csv"
"""
STAGE = """
[[stages]]
name = "surge"
trials = ["surge"]
axes = { free = "X" }
segment_s = 5.0
"""
COEFFICIENTS = """
[stages.coefficients]
X_uu = [-40.0, -5.0]
"""
WHOLE = HEAD + TRIAL + STAGE + COEFFICIENTS


def frame(seconds: float = 60.0, **columns: float) -> pl.DataFrame:
    """A recording at 10 Hz: a speed that swings, and constant columns."""
    t = np.arange(0.0, seconds, 0.1)
    constant = {name.replace("__", "."): np.full(len(t), value) for name, value in columns.items()}
    commands = {f"cmd.{name}": np.full(len(t), 500.0) for name in ("SbU", "SbL", "PU", "PL", "VTB", "VTS")}
    return pl.DataFrame({"t_s": t, "u_m_s": np.sin(0.3 * t), **commands, **constant})


def campaign(text: str = WHOLE, recording: pl.DataFrame | None = None) -> Campaign:
    trials = {"surge": frame() if recording is None else recording}
    return Campaign.from_toml(text, source="tank.toml", trials=trials)


def prepare(text: str, recording: pl.DataFrame | None) -> None:
    found = campaign(text, recording)
    for stage in found.problem().stages:
        cut(found.problem(), stage)


def refusal(text: str, recording: pl.DataFrame | None = None) -> str:
    with pytest.raises(CampaignError) as caught:
        prepare(text, recording)
    assert str(caught.value).startswith("tank.toml: ")
    return str(caught.value)


def test_group_name_means_every_actuator_of_the_group() -> None:
    found = campaign(HEAD + TRIAL + STAGE + '[stages.coefficients]\n"stern.gain" = [0.5, 2.0]')
    (parameter,) = found.problem().parameters["surge"]
    assert [name for name, _ in parameter.members] == ["SbU.gain", "SbL.gain", "PU.gain", "PL.gain"]
    assert parameter.coefficients(0.8) == dict.fromkeys(["SbU.gain", "SbL.gain", "PU.gain", "PL.gain"], 0.8)


def test_tied_and_relative_coefficients_keep_their_ratios() -> None:
    found = campaign(
        HEAD
        + TRIAL
        + STAGE
        + "[stages.coefficients]\n"
        + 'Y_vv = { bounds = [0.5, 2.0], relative = true, tie = ["Z_ww", { name = "N_uv", factor = -0.5 }] }'
    )
    (parameter,) = found.problem().parameters["surge"]
    assert (parameter.lower, parameter.upper) == (-615.0, -153.75)  # 2 and 0.5 times -307.5 in cwolf
    assert parameter.coefficients(-400.0) == {"Y_vv": -400.0, "Z_ww": -400.0, "N_uv": 200.0}


def test_default_bounds_are_those_of_the_vehicle() -> None:
    found = campaign(HEAD + TRIAL + STAGE + '[stages.coefficients]\nX_uu = "default"')
    info = found.vehicle.coefficient_info()["X_uu"]
    (parameter,) = found.problem().parameters["surge"]
    assert (parameter.lower, parameter.upper, parameter.unit) == (info["lower"], info["upper"], info["unit"])


def test_both_names_of_a_symmetric_added_mass_are_one_coefficient() -> None:
    text = "[stages.coefficients]\nN_vdot = { bounds = [-20.0, 20.0] }\nY_rdot = { bounds = [-20.0, 20.0] }"
    assert "'Y_rdot' is set by 'N_vdot' and by 'Y_rdot'" in refusal(HEAD + TRIAL + STAGE + text)


def test_trial_given_by_name_replaces_the_file_and_a_further_one_is_held_out() -> None:
    found = Campaign.from_toml(WHOLE, trials={"surge": frame(), "other": frame(30.0)})
    assert len(found.trials["surge"]) == 600
    assert found.trials["surge"] is found.trials["surge"]
    assert not found.problem().held_out("surge").any()
    assert found.problem().held_out("other").all()
    assert list(found.trials) == ["surge", "other"]


def test_held_out_interval_is_in_no_segment() -> None:
    text = HEAD + TRIAL + "hold_out_s = [[20.0, 30.0], [55.0, 70.0]]" + STAGE + COEFFICIENTS
    found = campaign(text)
    assert found.problem().held_out("surge").sum() == 150
    data = cut(found.problem(), found.problem().stages[0])
    covered = np.zeros(600, dtype=bool)
    for piece in data.segments:
        covered[piece.start : piece.stop] = True
    assert not covered[200:300].any()
    assert not covered[550:].any()
    assert covered[:200].all()
    assert covered[300:550].all()
    assert data.counts[0] == sum(piece.stop - piece.start - 1 for piece in data.segments)


def test_scale_is_the_spread_of_the_training_part_alone() -> None:
    recording = frame().with_columns(
        u_m_s=pl.when(pl.col("t_s") < 40).then(pl.col("u_m_s")).otherwise(pl.col("u_m_s") * 9)
    )
    text = HEAD + TRIAL + "hold_out_s = [[40.0, 60.0]]" + STAGE + COEFFICIENTS
    found = campaign(text, recording)
    expected = np.std(np.sin(0.3 * np.arange(0.0, 40.0, 0.1)))
    # Smoothing does not touch the observed samples: equal but for rounding.
    assert cut(found.problem(), found.problem().stages[0]).scale[0] == pytest.approx(expected, rel=1e-9)


def test_overlapping_segments_start_more_often() -> None:
    plain, overlapping = (
        campaign(),
        campaign(WHOLE.replace("segment_s = 5.0", "segment_s = 5.0\noverlap_s = 2.5")),
    )
    starts = [
        [piece.start for piece in cut(c.problem(), c.problem().stages[0]).segments]
        for c in (plain, overlapping)
    ]
    assert np.diff(starts[0]).tolist() == [50] * (len(starts[0]) - 1)
    assert np.diff(starts[1]).tolist() == [25] * (len(starts[1]) - 1)


def test_segment_starts_from_valid_samples_only() -> None:
    recording = frame().with_columns(
        u_m_s=pl.when(pl.col("t_s").is_between(10.0, 13.0)).then(None).otherwise("u_m_s")
    )
    found = campaign(WHOLE, recording)
    data = cut(found.problem(), found.problem().stages[0])
    assert all(data.trials[0].startable[piece.start] for piece in data.segments)
    assert not data.records[0].counted[105:125, 0].any()


def test_stages_run_after_those_they_name() -> None:
    text = WHOLE.replace("segment_s", 'after = ["drag"]\nsegment_s')
    text += STAGE.replace('"surge"\n', '"drag"\n', 1) + "[stages.coefficients]\nX_u = [-9.0, -1.0]"
    found = campaign(text)
    assert [stage.name for stage in found.problem().stages] == ["drag", "surge"]
    assert found.problem().stages_before(found.problem().stages[1]) == ["drag"]


def test_environment_of_a_trial_over_that_of_the_campaign() -> None:
    text = HEAD + "environment = { rho_kg_m3 = 1000.0, g_m_s2 = 9.8 }" + TRIAL
    found = campaign(text + "environment = { rho_kg_m3 = 1025.0 }" + STAGE + COEFFICIENTS)
    assert (found.trials["surge"].rho, found.trials["surge"].g) == (1025.0, 9.8)


def test_path_with_an_environment_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame().write_csv(tmp_path / "surge.csv")
    monkeypatch.setenv("TANK_TRIALS", str(tmp_path))
    file = tmp_path / "elsewhere" / "tank.toml"
    file.parent.mkdir()
    file.write_text(WHOLE.replace("surge.csv", "${TANK_TRIALS}/surge.csv"))
    assert len(Campaign.load(file).trials["surge"]) == 600
    monkeypatch.delenv("TANK_TRIALS")
    with pytest.raises(CampaignError, match="environment variable TANK_TRIALS is not set; set it"):
        Campaign.load(file).trials["surge"]


def test_vehicle_file_beside_the_campaign_file(tmp_path: Path) -> None:
    vehicle = campaign().vehicle.with_coefficients({"X_uu": -20.0})
    (tmp_path / "mine.toml").write_text(vehicle.to_toml())
    (tmp_path / "tank.toml").write_text(WHOLE.replace('"cwolf"', '"mine.toml"'))
    assert Campaign.load(tmp_path / "tank.toml").vehicle.coefficients()["X_uu"] == -20.0


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match=r"absent\.toml: not readable"):
        Campaign.load(tmp_path / "absent.toml")
    (tmp_path / "tank.toml").write_text(WHOLE)
    with pytest.raises(CampaignError, match=r"trial 'surge', key file: there is no file .*surge\.csv"):
        Campaign.load(tmp_path / "tank.toml").trials["surge"]
    (tmp_path / "tank.toml").write_text(WHOLE.replace('"cwolf"', '"cwulf"'))
    with pytest.raises(VehicleError, match="cwolf"):
        Campaign.load(tmp_path / "tank.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (WHOLE.replace("X_uu", "X_uuu"), ["coefficient 'X_uuu'", 'did you mean "X_uu"']),
        (WHOLE.replace("X_uu", '"sterm.gain"'), ["coefficient 'sterm.gain'", '"stern.gain"']),
        (WHOLE.replace("[-40.0, -5.0]", "[-40.0, -20.0]"), ["[-40, -20]", "vehicle's value -9.781", "widen"]),
        (
            WHOLE.replace("[-40.0, -5.0]", "{ bounds = [-40.0, -5.0], start = -50.0 }"),
            ["exclude its start value -50"],
        ),
        (WHOLE.replace("X_uu = [-40.0, -5.0]", 'Y_r = "default"'), ["no default bounds", "in N s"]),
        (
            WHOLE.replace("X_uu = [-40.0, -5.0]", "Y_r = { bounds = [0.5, 2.0], relative = true }"),
            ["'Y_r' is zero", "absolute bounds"],
        ),
        (WHOLE.replace('["surge"]', '["serge"]'), ["unknown trial 'serge'", 'did you mean "surge"']),
        (HEAD + TRIAL + "hold_out = true" + STAGE + COEFFICIENTS, ["held out as a whole"]),
        (HEAD + TRIAL + "hold_out_s = [[0.0, 90.0]]" + STAGE + COEFFICIENTS, ["covers all of it"]),
        (
            HEAD + TRIAL + "hold_out_s = [[90.0, 99.0]]" + STAGE + COEFFICIENTS,
            ["outside the recording", "59.9 s"],
        ),
        (
            WHOLE.replace("segment_s = 5.0", "segment_s = 61.0"),
            ["no piece of 61 s", "lasts 60 s", "shorten segment_s"],
        ),
        (WHOLE.replace("segment_s", "channels = { v = 1.0 }\nsegment_s"), ["no channel 'v'", "it has u"]),
        (WHOLE.replace('"X"', '"X", measured = "N"'), ["axis N is measured", "no channel 'r'"]),
        (
            WHOLE.replace("segment_s", 'after = ["surge"]\nsegment_s'),
            ["it names the stage itself; remove it"],
        ),
        (WHOLE.replace("segment_s", 'after = ["sway"]\nsegment_s'), ["unknown stage 'sway'"]),
        (WHOLE + STAGE + COEFFICIENTS, ["two stages are called 'surge'"]),
        (
            WHOLE + STAGE.replace('"surge"\n', '"again"\n', 1) + COEFFICIENTS,
            ["'X_uu' is also freed by stage 'surge'", "set after = ['surge']"],
        ),
    ],
)
def test_refusal_before_the_run(text: str, words: list[str]) -> None:
    message = refusal(text)
    for word in words:
        assert word in message


def test_channel_that_never_moves_cannot_be_scaled() -> None:
    text = WHOLE.replace("segment_s", "channels = { u = 1.0, w = 1.0 }\nsegment_s")
    assert "channel 'w' never moves" in refusal(text, frame(w_m_s=0.25))


def test_a_bench_record_that_changes_is_read_again(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(
        'format = 1\nname = "basin"\nvehicle = "cwolf"\nregression = { order = "square" }\n'
        'pulls = [{ name = "ahead", file = "ahead.csv", group = "stern", axis = "X" }]\n'
    )
    text = WHOLE.replace("[trials.surge]", 'bench = "bench.toml"\n[trials.surge]')
    p1 = []
    for factor in (1.0, 2.0):
        rows = "".join(f"{n},{factor * 7.5e-5 * n * n}\n" for n in (0, 500, 1000, 1500, 2000))
        (tmp_path / "ahead.csv").write_text(f"cmd.stern,load.X_n\n{rows}")
        loaded = Campaign.from_toml(text, folder=tmp_path, trials={"surge": frame()})
        p1.append(loaded.vehicle.coefficients()["SbU.p1_ahead"])
    # Six written digits.
    assert p1[1] == pytest.approx(2.0 * p1[0], rel=1e-5)


def test_the_truth_of_a_generated_bench_record_is_one_of_its_files(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(
        'format = 1\nname = "basin"\nvehicle = "cwolf"\n'
        'pulls = [{ name = "ahead", file = "ahead.toml", group = "stern", axis = "X" }]\n'
    )
    (tmp_path / "ahead.toml").write_text(
        'format = 1\ndescription = "pull"\ntruth = "truth.toml"\nseed = 1\nheld = true\nduration_s = 9.0\n'
    )
    found = set()
    for factor in (1.0, 1.1):
        (tmp_path / "truth.toml").write_text(f'format = 1\nvehicle = "cwolf"\nfactors = {{ m = {factor} }}\n')
        found.add(fingerprint(tmp_path / "bench.toml"))
    assert len(found) == 2
