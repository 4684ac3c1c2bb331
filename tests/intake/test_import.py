"""`seatrial import`: surveys, grouped files, drafted projects, kept edits, damaged and hostile logs."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

import seatrial as st
from seatrial.base.channels import CHANNELS
from seatrial.base.toml_file import tables
from seatrial.campaign.campaign import Campaign
from seatrial.check.campaign import check_campaign
from seatrial.cli import app
from seatrial.intake.survey import survey
from seatrial.logs import open_log
from seatrial.logs.log import READING_SETTINGS, Chunk, Log, Share

T = np.arange(0.0, 120.0, 0.1)


def _commands(t: np.ndarray) -> dict[str, np.ndarray]:
    surge = 120.0 * np.sign(np.sin(0.25 * t))
    turn = 90.0 * np.sign(np.sin(0.17 * t + 0.4))
    heave = 60.0 * np.sign(np.sin(0.11 * t))
    mixed = {
        "thruster_1": surge - turn,
        "thruster_2": surge + turn,
        "thruster_3": -surge + turn,
        "thruster_4": -surge - turn,
    }
    mixed |= {f"thruster_{k}": heave for k in range(5, 9)}
    return {name: 1500.0 + y for name, y in mixed.items()}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three files of one dive (attitude, Doppler log in mm/s, commands), written as loggers do."""
    folder = tmp_path_factory.mktemp("dive")
    vehicle = st.Vehicle.load("bluerov2-heavy")
    run = vehicle.simulate(T, _commands(T), voltage_v=np.full(len(T), 16.0))
    angles = run.euler
    pl.DataFrame({
        "time": T,
        "roll [rad]": angles[:, 0],
        "pitch [rad]": angles[:, 1],
        "yaw [rad]": (angles[:, 2] + np.pi) % (2.0 * np.pi) - np.pi,
        "depth": 5.0 + run.position[:, 2],
    }).write_csv(folder / "nav.csv")
    slow = slice(None, None, 2)
    velocity = {f"v{x} [mm/s]": 1e3 * run.nu[slow, k] for k, x in enumerate("xyz")}
    pl.DataFrame({"time": T[slow] + 0.03, **velocity}).write_csv(folder / "dvl.csv")
    pl.DataFrame({"time": T, **_commands(T), "voltage": np.full(len(T), 16.0)}).write_csv(folder / "esc.csv")
    return folder


def _files(logs: Path) -> list[Path]:
    return [logs / "nav.csv", logs / "dvl.csv", logs / "esc.csv"]


@pytest.fixture(scope="module")
def project(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, st.Imported]:
    folder = tmp_path_factory.mktemp("work") / "project"
    return folder, st.import_logs(_files(logs), out=folder, vehicle="bluerov2-heavy")


def test_survey_lists_every_field_with_rate_range_and_what_it_is_taken_for(logs: Path) -> None:
    rows = {row["field"]: row for row in survey(_files(logs)).rows()}
    assert rows["vx [mm/s]"]["taken_for"] == "u_m_s"
    assert rows["vx [mm/s]"]["unit"] == "mm/s"
    assert rows["vx [mm/s]"]["rate_hz"] == pytest.approx(5.0, rel=0.01)
    assert rows["roll [rad]"]["taken_for"] == "roll_deg"
    assert rows["thruster_3"]["taken_for"] == "cmd.thruster_3"


def test_files_with_different_channels_are_one_trial(project: tuple[Path, st.Imported]) -> None:
    folder, made = project
    assert [one.name for one in made.trials] == [made.trials[0].name]
    assert {"u", "v", "w", "z", "roll", "pitch", "yaw"} <= set(made.trials[0].trial.channels)
    table = pl.read_parquet(folder / "trials" / f"{made.trials[0].name}.parquet")
    # Sparse and raw: the units and names of the log, a cell per sample and no more.
    assert table["dvl.vx [mm/s]"].drop_nulls().len() == len(T[::2])
    assert float(table["dvl.vx [mm/s]"].abs().max()) > 50.0  # type: ignore[arg-type]


def test_drafted_campaign_is_ready_and_its_hold_out_lies_inside(project: tuple[Path, st.Imported]) -> None:
    folder, made = project
    campaign = Campaign.load(folder / "campaign.toml")
    check = check_campaign(campaign)
    assert check.problems == ()
    freed = {name for stage in check.stages for name in stage.coefficients}
    assert {"X_udot", "X_uu", "N_rr", "Z_ww", "B"} <= freed
    assert not {"m", "thruster_1.gain"} & freed  # only the ratio to the thrust is told by motion
    held = made.trials[0].hold_out_s
    assert held is not None
    assert 0.15 < (held[1] - held[0]) / T[-1] < 0.45


def test_drafted_map_is_a_map_that_gives_the_same_trials(
    project: tuple[Path, st.Imported], logs: Path, tmp_path: Path
) -> None:
    folder, made = project
    again = st.import_logs(
        _files(logs), map=folder / "map.toml", vehicle="bluerov2-heavy", out=tmp_path / "p"
    )
    assert again.columns == made.columns or {k: v.source for k, v in again.columns.items()} == {
        k: v.source for k, v in made.columns.items()
    }
    np.testing.assert_array_equal(again.trials[0].trial.observed, made.trials[0].trial.observed)


def test_edited_map_wins_and_edited_files_are_kept(logs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "project"
    st.import_logs(_files(logs), out=folder, vehicle="bluerov2-heavy")
    with pytest.raises(st.TrialError, match="--force"):
        st.import_logs(_files(logs), out=folder)
    text = (folder / "map.toml").read_text()
    edited = text.replace('u_m_s = { from = "dvl.vx [mm/s]"', 'u_m_s = { sign = -1, from = "dvl.vx [mm/s]"')
    assert edited != text
    (folder / "map.toml").write_text(edited)
    vehicle = (folder / "vehicle.toml").read_text() + "\n# mine\n"
    (folder / "vehicle.toml").write_text(vehicle)
    made = st.import_logs(_files(logs), out=folder, map=folder / "map.toml", force=True)
    assert made.columns["u_m_s"].sign == -1
    assert (folder / "map.toml").read_text() == edited
    assert (folder / "vehicle.toml").read_text() == vehicle
    assert "sign = -1" in (folder / "campaign.toml").read_text()


def test_foreign_folder_is_not_touched(logs: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("chapter 1")
    with pytest.raises(st.TrialError, match="no import wrote"):
        st.import_logs(_files(logs), out=tmp_path, force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["thesis.txt"]


def test_files_with_the_same_channels_are_a_trial_each(tmp_path: Path) -> None:
    for k, name in enumerate(("one", "two")):
        yaw = 40.0 * np.sin(0.2 * T + k)
        pl.DataFrame({
            "time": T,
            "yaw": yaw,
            "u_m_s": 1.0 + 0.2 * np.sin(0.1 * T),
            "rpm": 500.0 + 9.0 * k * T,
        }).write_csv(tmp_path / f"{name}.csv")
    made = st.import_logs([tmp_path / "one.csv", tmp_path / "two.csv"])
    assert [one.name for one in made.trials] == ["one", "two"]
    assert made.columns["yaw_deg"].source == "yaw"  # one map for both


def test_rows_that_hold_one_sensor_each_lose_nothing(logs: Path, tmp_path: Path) -> None:
    """Empty cells of a table are no samples: they are not masked, and no velocity is lost for them."""
    tables = [pl.read_csv(path) for path in _files(logs)]
    rows = pl.concat(tables, how="diagonal_relaxed").sort("time", maintain_order=True)
    rows.write_csv(tmp_path / "rows.csv")
    (made,) = st.import_logs(tmp_path / "rows.csv", vehicle="bluerov2-heavy").trials
    assert made.trial.valid[:, :3].mean() > 0.95
    assert not [one for one in made.trial.report.findings if "NaN" in one.message]
    assert len(made.trial.samples["u"][0]) == len(T[::2])


def test_stub_says_what_to_fill_in(logs: Path, tmp_path: Path) -> None:
    made = st.import_logs(_files(logs), out=tmp_path / "p")
    assert made.vehicle is None
    assert "fill in" in made.report().next_step
    with pytest.raises(st.VehicleError, match="length_m is still to be filled in"):
        st.Vehicle.load(tmp_path / "p" / "vehicle.toml")


def test_proposed_corrections_are_comments(logs: Path, tmp_path: Path) -> None:
    """A Doppler log that runs 0.4 s late: proposed with its effect, not applied."""
    late = tmp_path / "dvl.csv"
    table = pl.read_csv(logs / "dvl.csv")
    table.with_columns(pl.col("time") + 0.4).write_csv(late)
    made = st.import_logs(
        [logs / "nav.csv", late, logs / "esc.csv"], out=tmp_path / "p", vehicle="bluerov2-heavy"
    )
    proposed = [
        one for one in made.trials[0].consistency.corrections if one.table in ("clocks", "corrections")
    ]
    text = (tmp_path / "p" / "campaign.toml").read_text() + (tmp_path / "p" / "map.toml").read_text()
    assert all(one.key.rpartition(".")[2] in text for one in proposed)
    assert "corrections" not in tables((tmp_path / "p" / "campaign.toml").read_text(), "campaign")
    assert "clocks" not in tables((tmp_path / "p" / "map.toml").read_text(), "map")


def test_truncated_log_is_imported_in_part_and_says_so(tmp_path: Path) -> None:
    import gzip

    t = np.arange(0.0, 3000.0, 0.1)
    yaw = 40.0 * np.sin(0.2 * t)
    text = pl.DataFrame({"time": t, "yaw": yaw, "u_m_s": np.cos(0.1 * t), "rpm": 0.1 * t}).write_csv()
    packed = gzip.compress(text.encode(), 1)
    path = tmp_path / "cut.csv.gz"
    path.write_bytes(packed[: len(packed) * 3 // 4])
    made = st.import_logs(path, out=tmp_path / "p")
    report = made.report()
    assert report.outcome == "imported in part"
    assert "read in part" in report.text()
    assert 600.0 < made.trials[0].trial.t[-1] < 2900.0


def test_hostile_names_stay_inside_the_project_and_are_printable(tmp_path: Path) -> None:
    evil = tmp_path / "..evil\x1b[31m.csv"
    names = ["time", "yaw", "u_m_s", "../../etc/passwd", "rpm\x1b[2J\x07", "rpm"]
    columns = [T, 40.0 * np.sin(0.2 * T), np.cos(0.1 * T), T, T, 500.0 + T]
    pl.DataFrame(dict(zip(names, columns, strict=True))).write_csv(evil)
    made = st.import_logs(evil, out=tmp_path / "out" / "p")
    text = made.report().text() + survey([evil]).report().text()
    assert "\x1b" not in text
    assert "\x07" not in text
    outside = {path.name for path in tmp_path.iterdir()}
    assert outside == {evil.name, "out"}
    for path in (tmp_path / "out" / "p").rglob("*"):
        assert path.name.isprintable()
    for name in ("map.toml", "campaign.toml", "vehicle.toml"):
        tables((tmp_path / "out" / "p" / name).read_text(), name)


def test_command_line_lists_and_writes_and_says_the_next_command(logs: Path, tmp_path: Path) -> None:
    runner = CliRunner()
    listed = runner.invoke(app, ["import", *map(str, _files(logs))])
    assert listed.exit_code == 0
    assert "taken for" in listed.output
    assert not list(tmp_path.iterdir())
    told = runner.invoke(app, ["import", *map(str, _files(logs)), "--json"])
    assert {"logs", "fields"} <= set(json.loads(told.stdout))
    out = tmp_path / "p"
    done = runner.invoke(
        app, ["import", *map(str, _files(logs)), "--out", str(out), "--vehicle", "bluerov2-heavy"]
    )
    assert done.exit_code == 0, done.output
    assert f"seatrial check {out}/campaign.toml" in done.output.replace("\n", "")
    assert (out / "figures" / "log.png").is_file()
    again = runner.invoke(app, ["import", str(tmp_path / "absent.bin"), "--out", str(tmp_path / "q")])
    assert again.exit_code == 2


@pytest.mark.parametrize("at", [0.0, 0.5, 0.95])
@pytest.mark.parametrize("kind", [KeyError, st.TrialError])
def test_an_error_of_the_callers_progress_comes_back_as_it_was_raised(
    logs: Path, kind: type[Exception], at: float
) -> None:
    own = kind("own")

    def progress(share: float, words: str) -> None:
        if share >= at:
            raise own

    with pytest.raises(kind) as raised:
        st.import_logs(_files(logs), progress=progress)
    assert raised.value is own


def test_import_of_the_package_loads_nothing_of_the_intake() -> None:
    code = "import seatrial, sys; print([m for m in sys.modules if m.startswith('seatrial.intake')])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_only_wanted_fields_are_read_in_chunks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After the survey the join asks the log for the mapped fields alone; chunks are bounded."""
    t = np.arange(0.0, 7000.0, 0.1)
    table = {
        "time": t,
        "yaw": 40.0 * np.sin(0.2 * t),
        "depth": 3.0 + np.sin(0.01 * t),
        "rpm": 500.0 + 0.0 * t,
    }
    path = tmp_path / "long.csv"
    pl.DataFrame(table | {f"unused_{k}": t for k in range(8)}).write_csv(path)
    kind = type(open_log(path))
    asked: list[set[str]] = []
    sizes: list[int] = []
    chunks = kind.chunks

    def watched(
        self: Log, wanted: Mapping[str, Sequence[str]], share: Share | None = None
    ) -> Iterator[Chunk]:
        asked.append({name for names in wanted.values() for name in names})
        for chunk in chunks(self, wanted, share):
            sizes.append(len(chunk.t))
            yield chunk

    monkeypatch.setattr(kind, "chunks", watched)
    st.import_logs(path)
    assert asked[-1] == {"yaw", "depth", "rpm"}
    assert max(sizes) <= READING_SETTINGS.chunk_rows < len(t)


def test_a_channel_all_of_whose_samples_are_masked_compares_nothing(tmp_path: Path) -> None:
    rows = [f"{0.1 * k:.1f},{10.0 * np.sin(0.1 * k):.3f},{0 if k < 20 else 40}" for k in range(60)]
    (tmp_path / "nav.csv").write_text("time [s],yaw [deg],depth [m]\n" + "\n".join(rows) + "\n")
    [made] = st.import_logs(tmp_path / "nav.csv").trials
    assert not made.trial.valid[:, CHANNELS.index("z")].any()
    assert made.consistency.corrections == ()


def test_the_shorter_recording_behind_another_in_a_file_is_said_first(tmp_path: Path) -> None:
    t = np.arange(0.0, 60.0, 0.1)
    rows = [f"{x:.1f},{np.sin(x):.3f}" for x in (*t, *t[:400])]
    (tmp_path / "twice.csv").write_text("\n".join(["time_s,u_m_s", *rows]) + "\n")
    report = st.import_logs(tmp_path / "twice.csv").report()
    assert report.outcome == "imported in part"
    assert "time begins again" in report.worst
    assert "split the file" in report.worst


def test_a_log_of_three_seconds_is_called_too_short(tmp_path: Path) -> None:
    t = 0.1 * np.arange(30.0)
    columns = {"t_s": t, "u_m_s": 0.1 * t, "yaw_deg": t, "cmd.PU": 100.0 * t}
    pl.DataFrame(columns).write_csv(tmp_path / "short.csv")
    said = st.import_logs(tmp_path / "short.csv", vehicle="cwolf").summary()
    assert "Worst: The longest trial lasts 2.9 s: too short to identify anything" in said
