"""What spoils a trial is said first, and the check of a campaign says it, too."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import seatrial as st
from seatrial.base.finding import Finding, Severity
from seatrial.check.campaign import check_campaign
from seatrial.inspect.corrections import NO_MOTION, Consistency
from seatrial.inspect.kind_of_data import kind_of_data

EXAMPLES = Path(__file__).parents[2] / "examples"


def closed_loop(waves: float) -> st.Trial:
    """Heading under a proportional loop, 10 minutes at 10 Hz."""
    rng = np.random.default_rng(5)
    n = 6000
    t, yaw, rate, moment = 0.1 * np.arange(n), np.zeros(n), np.zeros(n), np.zeros(n)
    noise, target = rng.normal(0.0, 0.004, n), 0.0
    for k in range(1, n):
        target += rng.choice([-1.0, 1.0]) if k % 300 == 0 else 0.0
        seen = yaw[k - 1] + noise[k - 1]
        moment[k] = np.clip(0.8 * (target - seen) - 0.4 * rate[k - 1], -0.25, 0.25)
        swell = waves * np.sin(2.0 * np.pi * t[k] / 6.0)
        rate[k] = rate[k - 1] + 0.1 * (0.4 * moment[k - 1] - rate[k - 1] + swell) / 1.2
        yaw[k] = yaw[k - 1] + 0.1 * rate[k]
    v = waves * np.sin(2.0 * np.pi * t / 6.0) + rng.normal(0.0, 0.002, n)
    u = 1.0 + 0.01 * rng.normal(size=n)
    table = {"t_s": t, "u_m_s": u, "v_m_s": v, "r_deg_s": np.rad2deg(rate), "cmd.rudder": moment}
    return st.Trial.read(table | {"yaw_deg": np.rad2deg(yaw + noise)}, align=False)


def test_closed_loop_and_waves_are_said_before_what_was_done() -> None:
    kind = kind_of_data(closed_loop(0.05))
    assert kind.sentences[0].startswith("recorded in closed loop: rudder follows yaw")
    assert kind.sentences[1].startswith(
        "an oscillation with a period of 6.0 s, as of waves (amplitude v 0.05"
    )
    assert "turn" in kind.done
    assert kind.sentences[-1].startswith("hold out ")
    assert [one.channel for one in kind.weak] == ["u"]
    json.dumps(kind.to_dict())


def test_waves_that_only_a_crude_regression_leaves_are_told_as_a_guess() -> None:
    kind = kind_of_data(closed_loop(0.05))
    assert kind.waves is not None
    assert kind.waves.line
    (said,) = [one for one in replace(kind, waves=replace(kind.waves, line=False)).warnings if "waves" in one]
    assert "no command explains" not in said
    assert "perhaps waves" in said


@pytest.mark.long
def test_the_check_of_a_campaign_says_what_kind_of_data_it_has() -> None:
    found = check_campaign(st.Campaign.load(EXAMPLES / "cwolf" / "campaign.toml"))
    assert not [one for one in found.data if "closed loop" in one or "waves" in one]
    (surge,) = [one for one in found.data if one.startswith("trial surge: ")]
    assert "steps of X" in surge
    assert "coast-downs of X" in surge
    assert surge.endswith("u, q, r moved clearly")
    details = [one for section in found.report().shown() for one in section.sentences]
    assert "free decay of roll from 30 deg with 12 extremes from 0 s on" in details


@pytest.mark.long
@pytest.mark.skipif("SEATRIAL_DATA" not in os.environ, reason="SEATRIAL_DATA is not set")
def test_beluga_is_told_by_its_excited_axes() -> None:
    campaign = st.Campaign.load(EXAMPLES / "beluga" / "campaign.toml")
    heave = kind_of_data(campaign.trials["heave-1"], campaign.vehicle)
    assert "6 dives" in heave.done or "7 dives" in heave.done
    assert heave.contacts == ()
    random = kind_of_data(campaign.trials["random-1"], campaign.vehicle)
    assert random.windows.kept[0] >= random.windows.kept[1] - 2
    assert 0.2 <= np.ptp(np.array(random.windows.hold_out)) / 666.0 <= 0.36


def test_harmonics_of_a_row_of_preset_steps_are_no_waves() -> None:
    vehicle, t = st.Vehicle.load("cwolf"), np.arange(0.0, 120.0, 0.1)
    swing = 500.0 * np.sign(np.sin(0.4 * t))
    commands = dict.fromkeys(("SbU", "SbL"), 900.0 + swing) | dict.fromkeys(("PU", "PL"), 900.0 - swing)
    commands |= dict.fromkeys(("VTB", "VTS"), 0.0 * t)
    run = vehicle.simulate(t, commands)
    table = {"t_s": t, "v_m_s": run.nu[:, 1], "r_deg_s": np.rad2deg(run.nu[:, 5])}
    trial = st.Trial.read(table | {f"cmd.{name}": values for name, values in commands.items()}, align=False)
    assert kind_of_data(trial, vehicle).waves is None


def test_a_trial_without_motion_is_told_and_compares_nothing() -> None:
    t = np.arange(0.0, 120.0, 0.1)
    noise = np.random.default_rng(1).standard_normal((2, len(t)))
    kind = kind_of_data(
        st.Trial.read({"t_s": t, "u_m_s": 1e-3 * noise[0], "r_deg_s": 0.01 * noise[1]}, align=False)
    )
    assert kind.still
    found = Consistency((), (Finding("not recorded", Severity.NOTE, "depth"),)).without_motion()
    assert found.untold[0] == NO_MOTION
    assert found.missing[1].startswith("no depth: ")
