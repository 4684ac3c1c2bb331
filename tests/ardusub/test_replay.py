"""Replay of ArduSub's controllers: a recorded dive, and logs whose gains are known."""

from __future__ import annotations

import json
import os
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from typer.testing import CliRunner

from seatrial import TrialError
from seatrial.ardusub.comparison import Replay
from seatrial.ardusub.log_replay import replay
from seatrial.ardusub.parameters import ParameterFile
from seatrial.cli import app
from seatrial.report.plot import gallery
from seatrial.report.plot.mission_log import replay_figure
from tests.ardusub import text_log

mpl.use("Agg")

pytest.importorskip("pymavlink")

RECORDED = Path(os.environ.get("SEATRIAL_DATA", "/nonexistent")) / "bluerov2_heavy" / "00000029_filtered.BIN"


@pytest.fixture(scope="module")
def dive() -> Replay:
    if not RECORDED.is_file():
        pytest.skip("the recording of BlueROV2 Heavy is not here; set SEATRIAL_DATA to its folder")
    return replay(RECORDED)


def test_a_recorded_dive_is_what_the_law_makes_of_its_inputs(dive: Replay) -> None:
    assert dive.held
    assert dive.checks == (29, 29)
    terms = [one for one in dive.quantities if one.name in ("P term", "FF term", "output", "throttle")]
    assert len(terms) >= 8
    assert all(one.p95 < 1e-6 * one.rms for one in terms)
    pulses = [one for one in dive.quantities if one.unit == "us"]
    assert len(pulses) == 8
    assert all(np.abs(one.error).max() <= 2.0 for one in pulses)


def test_parameters_of_a_recorded_dive_are_found(dive: Replay) -> None:
    """The firmware's defaults for this frame, to which the dive was set back, and what its file says."""
    expected = {
        "ATC_ANG_RLL_P": 6.0, "ATC_ANG_PIT_P": 6.0, "ATC_ANG_YAW_P": 6.0, "ATC_RAT_RLL_P": 0.135,
        "ATC_RAT_YAW_P": 0.18, "PSC_D_POS_P": 1.0, "PSC_D_VEL_P": 8.0, "PSC_D_ACC_P": 0.05,
        "PSC_D_ACC_I": 0.01, "PSC_NE_POS_P": 2.0, "PSC_NE_VEL_P": 6.0, "ATC_ANGLE_MAX": 45.0,
    }  # fmt: skip
    for name, value in expected.items():
        assert dive.parameter(name) == pytest.approx(value, rel=0.02), name
    assert dive.frame == ("Vectored_6DOF", (-1, -1, 1, 1, -1, 1, 1, -1))
    (bound,) = (one for one in dive.found if one.bound)
    assert (bound.name, bound.bound) == ("ATC_ACC_Y_MAX", "at least")
    assert bound.value == pytest.approx(240.0)
    assert bound.agrees(1100.0)


def test_every_panel_of_the_figure_shows_rows(dive: Replay, tmp_path: Path) -> None:
    figure = replay_figure(dive)
    assert len(figure.axes) == 12
    assert all(np.isfinite(line.get_ydata()).any() for panel in figure.axes for line in panel.get_lines())
    assert [path.name for path in gallery(dive, tmp_path)] == ["replay.png"]


def test_gains_and_frame_of_another_vehicle_are_found(tmp_path: Path) -> None:
    found = replay(text_log.write(tmp_path / "vectored.log"))
    assert found.held, found.summary()
    for name, (p, i) in text_log.GAINS.items():
        assert found.parameter(f"ATC_RAT_{name}_P") == pytest.approx(p, rel=1e-4)
        assert found.parameter(f"ATC_RAT_{name}_I") == pytest.approx(i, rel=0.1)
        assert found.parameter(f"ATC_ANG_{name}_P") == pytest.approx(text_log.ANGLE_P[name], rel=0.01)
    assert found.frame == ("Vectored", text_log.DIRECTION)
    assert any("PSCD" in note for note in found.notes)


def test_a_term_that_the_law_does_not_give_is_named(tmp_path: Path) -> None:
    """A sceptic's check: a P term five percent too large on the rows that judge is found out."""
    found = replay(text_log.write(tmp_path / "odd.log", p_term=1.05))
    wrong = [(one.controller, one.name) for one in found.quantities if not one.holds]
    assert ("rate, yaw", "P term") in wrong
    assert not any(controller == "rate, roll" for controller, _ in wrong)
    assert "replayed in part" in found.summary()


def test_pulses_of_no_frame_count_as_not_met(tmp_path: Path) -> None:
    found = replay(text_log.write(tmp_path / "noisy.log", frame_noise_us=60.0))
    assert found.frame is None
    assert any("FRAME_CONFIG may be custom" in note for note in found.notes)
    assert {gap.name for gap in found.impossible} == {f"output {k}" for k in range(1, 7)}
    assert not found.held
    assert found.checks == (12, 18)


def test_parameters_that_are_given_are_compared(tmp_path: Path) -> None:
    log = text_log.write(tmp_path / "vectored.log")
    own = ParameterFile("own.param", {"ATC_RAT_RLL_P": 0.11, "ATC_RAT_YAW_P": 0.3, "PSC_POSZ_P": 1.0})
    found = replay(log, parameters=own)
    agrees = {one.name: same for one, _, same in found.against()}
    assert agrees == {"ATC_RAT_RLL_P": True, "ATC_RAT_YAW_P": False}
    assert "ATC_RAT_YAW_P 0.22 for 0.3" in found.summary()
    mixed = ParameterFile("mixed.param", {"PSC_POSZ_P": 1.0, "PSC_D_POS_P": 1.0})
    with pytest.raises(TrialError, match="one generation"):
        replay(log, parameters=mixed)


def test_logs_that_cannot_be_replayed_are_refused(tmp_path: Path) -> None:
    table = tmp_path / "nav.csv"
    table.write_text("t_s,u_m_s\n" + "\n".join(f"{0.1 * k},1" for k in range(50)) + "\n")
    with pytest.raises(TrialError, match="found no RATE, PIDR, PIDP, PIDY; let LOG_BITMASK include PID"):
        replay(table)
    with pytest.raises(TrialError, match=r"missing\.BIN"):
        replay(tmp_path / "missing.BIN")
    short = text_log.write(tmp_path / "short.log", minutes=0.02)
    with pytest.raises(TrialError, match="no controller could be replayed"):
        replay(short)


@pytest.mark.parametrize("damage", ["cut", "nan", "twice", "backwards", "still"])
def test_an_ugly_log_is_replayed_in_part(tmp_path: Path, damage: str) -> None:
    lines = text_log.write(tmp_path / "log.log", minutes=1.0).read_text().splitlines()
    head, rows = lines[:9], lines[9:]
    match damage:
        case "cut":
            rows = [*rows[: len(rows) // 2], rows[-1][:17]]
        case "nan":
            rows = [row.replace("0.0", "nan") if k % 7 == 0 else row for k, row in enumerate(rows)]
        case "twice":
            rows = [row for row in rows for _ in range(2)]
        case "backwards":
            rows.reverse()
        case _:
            first = rows[0].split(",")[0]
            rows = [row for row in rows if not row.startswith(first)] + [
                f"{first}, {k * 100_000}, " + ", ".join(["0"] * rows[0].count(",")) for k in range(600)
            ]
    (tmp_path / "log.log").write_text("\n".join([*head, *rows]) + "\n")
    found = replay(tmp_path / "log.log")
    assert found.quantities
    json.dumps(found.to_dict())


def test_the_verb_writes_its_run_and_says_by_its_code_what_came_out(tmp_path: Path) -> None:
    log, cli = text_log.write(tmp_path / "vectored.log"), CliRunner()
    folder = tmp_path / "run"
    answer = cli.invoke(app, ["ardusub", str(log), "--replay-only", "--out", str(folder), "--json"])
    assert answer.exit_code == 0, answer.output
    told = json.loads(answer.stdout)
    assert told["held"]
    assert (folder / "figures" / "replay.png").is_file()
    read = ParameterFile.load(folder / "found.param").values
    assert read["MOT_3_DIRECTION"] == -1.0
    assert read["ATC_RAT_RLL_P"] == pytest.approx(0.11)
    odd = text_log.write(tmp_path / "odd.log", p_term=1.05)
    answer = cli.invoke(
        app, ["ardusub", str(odd), "--replay-only", "--out", str(tmp_path / "odd"), "--figures", "none"]
    )
    assert answer.exit_code == 1
    answer = cli.invoke(app, ["ardusub", str(tmp_path / "none.BIN"), "--out", str(tmp_path / "none")])
    assert answer.exit_code == 2
    assert not (tmp_path / "none").exists()
