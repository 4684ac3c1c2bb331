"""A delay is offered in one place and removed once: as a clock by the import, as delay_s by the check."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import seatrial as st
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign
from tests.inspect.logs import Motion

LATE_S = 0.5


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A navigation unit, a Doppler log whose clock is half a second ahead, and the commands."""
    folder = tmp_path_factory.mktemp("logs")
    motion, random = Motion(3, 240.0), np.random.default_rng(3)
    t = np.arange(0.0, 240.0, 0.1)
    angles = np.rad2deg(motion.at(motion.angles, t) + 0.002 * random.standard_normal((len(t), 3)))
    rates = np.rad2deg(motion.at(motion.omega, t) + 0.005 * random.standard_normal((len(t), 3)))
    place = motion.at(motion.p, t) + 0.01 * random.standard_normal((len(t), 3))
    columns = dict(zip(("roll_deg", "pitch_deg", "yaw_deg"), angles.T, strict=True))
    columns |= dict(zip(("p_deg_s", "q_deg_s", "r_deg_s"), rates.T, strict=True))
    columns |= {"z_m": 30.0 + place[:, 2], "cmd.propeller": 1000.0 + 300.0 * np.sin(0.1 * t)}
    pl.DataFrame({"t_s": t} | columns).write_csv(folder / "nav.csv")
    t = np.arange(0.0, 239.0, 0.16)
    speed = motion.at(motion.v, t) + 0.01 * random.standard_normal((len(t), 3))
    velocity = dict(zip(("u_m_s", "v_m_s", "w_m_s"), speed.T, strict=True))
    pl.DataFrame({"t_s": t + LATE_S} | velocity).write_csv(folder / "dvl.csv")
    return [folder / "nav.csv", folder / "dvl.csv"]


def keys(made: st.Imported) -> list[str]:
    return [one.key for trial in made.trials for one in trial.consistency.corrections]


@pytest.mark.long
def test_a_delay_is_proposed_once_and_removed_once(logs: list[Path], tmp_path: Path) -> None:
    project = tmp_path / "project"
    made = st.import_logs(logs, out=project, vehicle="remus100")
    assert "dvl.csv.offset_s" in keys(made)
    text = (project / "map.toml").read_text()
    assert "# [clocks]" in text
    check = check_campaign(Campaign.load(project / "campaign.toml"))
    assert check.problems == ()
    (offered,) = [one.text for one in check.proposals if "delay_s.velocity" in one.text]
    assert "the same delay as the clock of dvl.csv: accept one of the two" in offered

    # Accepted as the clock: neither offers it again.
    accepted = tmp_path / "map.toml"
    accepted.write_text(text.replace("# [clocks]", "[clocks]").replace('# "dvl.csv"', '"dvl.csv"'))
    other = tmp_path / "other"
    assert "dvl.csv.offset_s" not in keys(st.import_logs(logs, out=other, vehicle="remus100", map=accepted))
    check = check_campaign(Campaign.load(other / "campaign.toml"))
    assert not [one for one in check.proposals if "delay_s.velocity" in one.text]

    # Accepted in the campaign: the import, too, offers it no more.
    campaign = project / "campaign.toml"
    campaign.write_text(campaign.read_text() + "\n[corrections]\ndelay_s.velocity = 0.5\n")
    again = st.import_logs(logs, out=project, vehicle="remus100", force=True)
    assert not [key for key in keys(again) if key.startswith("dvl.csv")]
    assert "[clocks]" not in (project / "map.toml").read_text()
    assert again.twice == ()
    recorded = json.loads((project / "import.json").read_text())
    assert recorded["trials"][0]["consistency"]["corrections"] == [
        one for one in recorded["trials"][0]["consistency"]["corrections"] if one["table"] != "clocks"
    ]

    # Accepted in both: said before all else.
    both = st.import_logs(logs, out=project, vehicle="remus100", map=accepted, force=True)
    (said,) = both.twice
    assert said.endswith("both remove the delay of the velocity: remove one")
    assert both.report().worst == said
