"""Corrections and the slow current in a drafted campaign: one key each to accept, with its effect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
import tomlkit

import seatrial as st
from seatrial.base.finding import Finding, Severity
from seatrial.campaign.file import parse
from seatrial.inspect.corrections import Correction, SlowCurrent
from seatrial.intake.campaign_draft import DraftedTrial, campaign_text
from seatrial.problem.parameter import parameters
from tests.trial import motion


@pytest.fixture(scope="module")
def trial() -> st.Trial:
    return st.Trial.read(motion.columns(np.arange(0.0, 20.0, 0.1)), align=False)


def drafted(
    trial: st.Trial, name: str, delay: float | None, current: SlowCurrent | None = None
) -> DraftedTrial:
    found = () if delay is None else (late(delay),)
    file = f"trials/{name}.parquet"
    return DraftedTrial(name, file, trial, {}, None, "too short", "tau", None, found, current)


def late(seconds: float) -> Correction:
    finding = Finding("late sensor", Severity.WEAKNESS, "velocity", {"delay_s": seconds, "sd_s": 0.01})
    return Correction(
        "corrections", "delay_s.velocity", seconds, 0.01, "s", 0.05, 0.02, "rates, m/s", finding
    )


def accepted(text: str, start: str) -> str:
    """The text with the comment taken off the lines that begin so."""
    return "\n".join(
        line.removeprefix("# ") if line.startswith(f"# {start}") else line for line in text.splitlines()
    )


def test_trials_that_agree_give_one_value_and_its_range(trial: st.Trial) -> None:
    text = campaign_text(
        "sea", None, [drafted(trial, n, x) for n, x in (("a", 0.22), ("b", 0.24), ("c", None))]
    )
    assert "# # mean of 2 of 3 trials, weighed by their deviations; by trial 0.22 to 0.24" in text
    made = parse(accepted(accepted(text, "[corrections]"), "delay_s"), "campaign.toml")
    assert made.corrections == {"delay_s": {"velocity": 0.23}}


def test_trials_that_differ_keep_a_value_each(trial: st.Trial) -> None:
    text = campaign_text("sea", None, [drafted(trial, n, x) for n, x in (("a", 0.10), ("b", 0.40))])
    assert "# [corrections]" not in text
    made = parse(accepted(text, "corrections.delay_s"), "campaign.toml")
    assert [one.corrections["delay_s"]["velocity"] for one in made.trials.values()] == [0.1, 0.4]


def test_a_slow_current_is_one_key_with_its_effect(trial: st.Trial) -> None:
    t = np.arange(0.0, 600.0, 60.0)
    water = np.column_stack([1e-4 * t, np.where(t < 300.0, 0.1, 0.1 + 5e-4 * (t - 300.0))])
    current = SlowCurrent(t, water, np.full((10, 2), 0.01), "legs", (0.1, 0.2), (0.01, 0.03))
    text = campaign_text("sea", None, [drafted(trial, "a", None, current)])
    assert "u 0.100 to 0.010 and v 0.200 to 0.030" in text
    [one] = parse(accepted(text, "corrections.current"), "campaign.toml").trials.values()
    given = one.corrections["current"]
    assert given["t_s"] == [0.0, 300.0, 540.0]  # where the lines bend
    assert given["east_m_s"] == [0.1, 0.1, 0.22]


def test_a_hovering_vehicle_may_be_far_from_its_file_in_what_takes_over_an_error_of_thrust() -> None:
    """On a BlueROV2 and on Beluga these ended at the vehicle's bounds, on both sides."""
    table = motion.columns(np.arange(0.0, 20.0, 0.1))
    table |= {f"cmd.thruster_{k}": 1500.0 + 50.0 * np.sin(0.1 * k * table["t_s"]) for k in range(1, 9)}
    vehicle = st.Vehicle.load("bluerov2-heavy")
    one = DraftedTrial("a", "a.parquet", st.Trial.read(table, align=False), {}, None, "short", "commands")
    text = campaign_text("sea", vehicle, [one])
    info = vehicle.coefficient_info()
    assert 'X_udot = "default"' in text
    assert info["N_rdot"]["lower"] == pytest.approx(-1.11)
    assert "N_rdot = [-4.5, " in text  # four times, to two digits
    assert "N_rr = [-6.0, 0.0]" in text


def test_where_fins_turn_the_vehicle_their_lift_is_free_and_the_added_inertia_is_held() -> None:
    table = motion.columns(np.arange(0.0, 20.0, 0.1))
    vehicle = st.Vehicle.load("remus100")
    table["u_m_s"] = np.full(200, 1.5)  # it yaws away there while its rudder is held
    table |= {f"cmd.{name}": 0.1 * np.sin(0.3 * table["t_s"]) for name in vehicle.actuator_info()}
    one = DraftedTrial("a", "a.parquet", st.Trial.read(table, align=False), {}, None, "short", "commands")
    text = campaign_text("sea", vehicle, [one])
    assert '"rudder.gain" = [0.1, 3.0]' in text
    assert '"stern planes.gain" = [0.1, 3.0]' in text
    assert all(f"{inertia}dot" not in text for inertia in ("Y_v", "N_r", "Z_w", "M_q"))
    # The published cross-flow drag lies thirteen times outside the default bounds.
    assert "Y_vv = [-2700.0, " in text
    file = parse(text, "campaign.toml")
    assert file.polish is not None
    assert file.polish.method == "innovations"
    for stage in file.stages:
        assert parameters(stage, vehicle, "campaign.toml")  # bounds hold the vehicle's values


def test_an_axis_that_is_driven_without_a_command_is_not_drafted() -> None:
    table = motion.columns(np.arange(0.0, 20.0, 0.1))
    vehicle = st.Vehicle.load("bluerov2-heavy")
    horizontal = {f"cmd.thruster_{k}": 1500.0 + 50.0 * np.sin(0.1 * k * table["t_s"]) for k in range(1, 5)}
    vertical = {name.replace(str(k), str(k + 4)): y for k, (name, y) in enumerate(horizontal.items(), 1)}

    def text(commands: dict[str, np.ndarray]) -> str:
        read = st.Trial.read(table | commands, align=False)
        one = DraftedTrial("a", "a.parquet", read, {}, None, "short", "commands")
        return campaign_text("sea", vehicle, [one])

    whole, half = text(horizontal | vertical), text(horizontal)
    assert 'name = "heave"' in whole
    assert 'name = "heave"' not in half
    assert 'name = "roll"' not in half  # the vertical thrusters roll it as well
    assert 'name = "surge"' in half
    assert "heave. What drives it has no command" in half.replace("\n# ", " ")
    assert "cmd.thruster_5, cmd.thruster_6, cmd.thruster_7, cmd.thruster_8" in half.replace("\n# ", " ")


def test_a_vehicle_without_actuators_that_a_logged_wrench_drives_is_imported_and_identified(
    tmp_path: Path,
) -> None:
    document = {k: v for k, v in st.Vehicle.load("cwolf").to_dict().items() if k != "thrusters"}
    bare = st.Vehicle.from_toml(tomlkit.dumps({k: v for k, v in document.items() if k != "controllable"}))
    assert not bare.actuators
    t, generator = np.arange(0.0, 60.0, 0.1), np.random.default_rng(4)
    tau = np.zeros((len(t), 6))
    tau[:, 0] = 20.0 + 20.0 * np.repeat(generator.uniform(-1.0, 1.0, 20), 30)
    tau[:, 5] = 8.0 * np.repeat(generator.uniform(-1.0, 1.0, 20), 30)
    nu = np.asarray(bare.simulate(t, {}, tau=tau, max_step_s=0.02).nu)
    nu = nu + generator.normal(0.0, 1.0, nu.shape) * [0.01, 0.01, 0.01, 2e-3, 2e-3, 2e-3]
    log, vehicle = tmp_path / "log.csv", tmp_path / "bare.toml"
    moved = {"u_m_s": nu[:, 0], "v_m_s": nu[:, 1], "r_deg_s": np.degrees(nu[:, 5])}
    pl.DataFrame({"t_s": t} | moved | {"tau.X_n": tau[:, 0], "tau.N_nm": tau[:, 5]}).write_csv(log)
    vehicle.write_text(bare.to_toml())
    st.import_logs(log, out=tmp_path / "project", vehicle=vehicle)
    campaign = st.Campaign.load(tmp_path / "project" / "campaign.toml")
    assert campaign.problem().input_of(next(iter(campaign.trials))) == "tau"
    # The axes that the wrench drives, and no other.
    assert {letter for stage in campaign.problem().stages for letter in stage.axes.free} == {"X", "N"}
    fit = campaign.identify(work=st.Work(threads=1))
    assert not fit.fallbacks
    # 1 % of noise over 60 s; X_uu and X_u share the drag, which is told at the speeds that were sailed.
    found, true = fit.vehicle.coefficients(), bare.coefficients()
    drag = [one["X_u"] * 0.8 + one["X_uu"] * 0.8**2 for one in (found, true)]
    assert drag[0] == pytest.approx(drag[1], rel=0.05)
