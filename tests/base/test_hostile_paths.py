"""Paths that are no files, and names that would lead out of the folder where results go."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

import seatrial as st
from seatrial._core import file_text
from seatrial.base.files import LONGEST_NAME, file_name, free_name, no_file
from seatrial.base.run import part_file
from seatrial.base.toml_file import file_kind, text_of
from seatrial.cli import app

HUGE = 17 << 20

MISSION = """
format = 1
name = "ahead"
speed_m_s = 1.5
acceptance_radius_m = 5.0
limits = { max_depth_m = 20.0, max_time_s = 100.0 }
legs = [{ north_m = 20.0, east_m = 0.0, depth_m = 2.0 }]
"""


@pytest.fixture(params=["device", "pipe", "folder", "huge", "binary", "missing"])
def wrong(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, str]:
    """A path where a file is expected, and what is said about it."""
    path = tmp_path / f"{request.param}.toml"
    match request.param:
        case "device":
            path.symlink_to("/dev/zero")
            return path, "it is a device, a pipe or a socket, not a regular file"
        case "pipe":
            os.mkfifo(path)
            return path, "it is a device, a pipe or a socket, not a regular file"
        case "folder":
            path.mkdir()
            return path, "it is a folder"
        case "huge":
            with path.open("wb") as file:
                file.truncate(HUGE)
            return path, "it is larger than 16 MiB"
        case "binary":
            path.write_bytes(b"\xff\xfe\x00\x01")
            return path, "not a text file in UTF-8"
    return path, "No such file or directory"


@pytest.mark.parametrize("load", [st.Vehicle.load, st.Autopilot.load, st.Mission.load, st.Campaign.load])
def test_every_loader_says_what_is_wrong_with_the_path(load: object, wrong: tuple[Path, str]) -> None:
    path, words = wrong
    with pytest.raises(st.SeatrialError) as refusal:
        load(path)  # type: ignore[operator]
    message = str(refusal.value)
    assert message.startswith(f"{path}: ")
    assert words in message
    assert "os error" not in message
    assert file_kind(path) is None


@pytest.mark.parametrize("key", ["vehicle", "autopilot", "bench", "trial", "mission", "sensors"])
def test_a_campaign_that_names_a_device_is_refused(tmp_path: Path, key: str) -> None:
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    (tmp_path / "log.csv").symlink_to("/dev/zero")
    lines = {"vehicle": 'vehicle = "cwolf"', "autopilot": 'autopilot = "cwolf"'}
    (tmp_path / "mission.toml").write_text(MISSION)
    if key in ("vehicle", "autopilot", "bench"):
        lines[key] = f'{key} = "zero.toml"'
        lines["table"] = "tuning.samples = 1"
    if key == "trial":
        lines[key] = 'trials.there.file = "log.csv"'
        lines["stages"] = (
            '[[stages]]\nname = "a"\ntrials = ["there"]\naxes = { free = "X", measured = "YZKMN" }\n'
            'coefficients = { X_uu = "default" }'
        )
    if key in ("mission", "sensors"):
        sensors = 'sensors = "zero.toml"' if key == "sensors" else ""
        mission = "zero.toml" if key == "mission" else "mission.toml"
        lines[key] = (
            f'[verification]\n{sensors}\nmissions = [{{ file = "{mission}" }}]\n'
            '[[verification.requirements]]\nname = "done"\nholds = "complete"\nprobability = 0.5'
        )
    campaign = tmp_path / "campaign.toml"
    campaign.write_text('format = 1\nname = "c"\n' + "\n".join(lines.values()) + "\n")
    verb = {"autopilot": "tune", "mission": "verify", "sensors": "verify"}.get(key, "check")
    said = CliRunner().invoke(app, [verb, str(campaign)])
    assert said.exit_code == 2, said.output
    assert "a device, a pipe or a socket" in said.output


@pytest.mark.parametrize("verb", ["score", "simulate", "bench", "verify", "fly"])
def test_every_verb_refuses_a_pipe(verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    arguments = {
        "score": ["cwolf", str(pipe)],
        "simulate": ["cwolf", str(pipe)],
        "bench": [str(pipe)],
        "verify": [str(pipe)],
        "fly": ["cwolf", "cwolf", str(pipe)],
    }[verb]
    said = CliRunner().invoke(app, [verb, *arguments])
    assert said.exit_code == 2
    assert "a device, a pipe or a socket" in said.output


@pytest.mark.parametrize("name", ["../../../out", "..", "", "a/b\\c", "\0\n", "é" * 200, "\ud800"])
def test_a_name_becomes_the_name_of_one_file(name: str) -> None:
    safe = file_name(name)
    assert safe
    assert not set(safe) & set("/\\.")
    assert len(os.fsencode(safe)) <= LONGEST_NAME
    assert len(os.fsencode(Path(part_file(name)).name)) <= LONGEST_NAME + 20
    assert Path(part_file(name)).parts[0] == "stages"
    assert free_name(safe, {safe}) != safe


def test_similar_and_long_names_have_files_of_their_own() -> None:
    taken: list[str] = []
    for name in ("keeps its path", "keeps its/path", "k" * 300):
        taken.append(free_name(file_name(name), taken))
    assert taken == ["keeps-its-path", "keeps-its-path-2", "k" * LONGEST_NAME]


@pytest.mark.long
def test_names_inside_files_lead_nowhere_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Vehicle, mission and trial are called ``x/../../../out``; all that is written is below runs."""
    inside = tmp_path / "a" / "b" / "c" / "d"
    inside.mkdir(parents=True)
    monkeypatch.chdir(inside)
    out = "x/../../../out"
    text = st.Vehicle.load("cwolf").to_toml()
    assert 'name = "cwolf"' in text
    (inside / "v.toml").write_text(text.replace('name = "cwolf"', f'name = "{out}"', 1))
    (inside / "m.toml").write_text(MISSION.replace("ahead", out))
    (inside / "log.csv").write_text(
        "t_s,u_m_s,v_m_s,w_m_s,p_deg_s,q_deg_s,r_deg_s,roll_deg,pitch_deg,yaw_deg,"
        "tau.X_n,tau.Y_n,tau.Z_n,tau.K_nm,tau.M_nm,tau.N_nm\n"
        + "".join(f"{0.1 * k:.1f},{1.0 + 0.001 * k}{',0.0' * 14}\n" for k in range(100))
    )
    (inside / "c.toml").write_text(
        f'format = 1\nname = "c"\nvehicle = "v.toml"\ntrials."{out}".file = "log.csv"\n'
        f'[[stages]]\nname = "{out}"\ntrials = ["{out}"]\naxes = {{ free = "X", measured = "YZKMN" }}\n'
        'coefficients = { X_uu = "default" }\n'
    )
    for arguments in (
        ["check", "v.toml"],
        ["check", "m.toml"],
        ["fly", "v.toml", "cwolf", "m.toml", "--figures", "none"],
        ["score", "v.toml", out, "--columns-from", "c.toml", "--free", "X", "--out", "runs/scores"],
        ["plan", "v.toml", "--figures", "none", "--count", "1", "--coefficients", "X_uu", "--duration", "30"],
    ):
        said = CliRunner().invoke(app, arguments)
        assert said.exit_code in (0, 1), (arguments, said.output)
    written = {path for path in tmp_path.rglob("*") if path.is_file()}
    given = {inside / name for name in ("v.toml", "m.toml", "c.toml", "log.csv")}
    assert {path.relative_to(inside).parts[0] for path in written - given} == {"runs"}
    assert {path.name for path in (inside / "runs").iterdir()} == {
        "check-x----------out", "check-m", "fly-x----------out-x----------out", "scores",
        "plan-x----------out",
    }  # fmt: skip


def test_a_link_that_leads_to_no_file_is_called_a_link(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    (tmp_path / "c").symlink_to("away.csv")
    assert no_file(tmp_path / "a") == f"{tmp_path}/a is a link to b, and leads to no file"
    assert no_file(tmp_path / "c") == f"{tmp_path}/c is a link to away.csv, and leads to no file"
    assert no_file(tmp_path / "d") == f"there is no file {tmp_path}/d"


def test_text_of_keeps_its_words(tmp_path: Path) -> None:
    (tmp_path / "bom.toml").write_bytes("\N{BYTE ORDER MARK}a = 1\n".encode())
    assert file_text(tmp_path / "bom.toml") == "a = 1\n"
    with pytest.raises(st.CampaignError, match=r"not readable as a campaign file \(No such file"):
        text_of(tmp_path / "none.toml", "a campaign file")
