"""What `seatrial check` says of an autopilot file, by itself and on a vehicle."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from seatrial._core import Autopilot, Vehicle, autopilot_names
from seatrial.base.errors import VehicleError
from seatrial.check.autopilot import AutopilotCheck, check_autopilot
from seatrial.cli import app
from seatrial.control_design.margin_report import report_margins
from tests.control_design.started import started

CWOLF = Vehicle.load("cwolf")
TEXT = """
format = 1
name = "made"
period_s = 0.1
[schedule]
speeds_m_s = [-2.0, -1.0, 0.0, 1.0, 2.0, 3.0]
[loops.surge]
K_P = 100.0
tau_max = 100.0
[loops.heave]
K_P = 20.0
K_D_s = 60.0
tau_max = 20.0
[loops.pitch]
K_P = [40.0, 41.0, 42.0, 43.0, 44.0, 45.0]
K_D_s = 100.0
tau_max = 5.0
[loops.heading]
K_P = 30.0
K_D_s = 60.0
tau_max = 5.0
[[modes]]
name = "hover"
loops = ["surge", "heave", "pitch", "heading"]
depth_by = "heave"
[[modes]]
name = "cruise"
loops = ["surge", "pitch", "heading"]
depth_by = "pitch"
from_speed_m_s = 0.8
actuators = ["stern"]
"""


@cache
def on_cwolf(*changes: tuple[str, str], more: str = "") -> AutopilotCheck:
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return check_autopilot(Autopilot.from_toml(text + more), vehicle=CWOLF)


def said(found: AutopilotCheck, words: str) -> bool:
    return any(words in text for text in (*found.notes, *found.warnings))


def warned(found: AutopilotCheck, words: str) -> bool:
    return any(words in text for text in found.warnings)


def call(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_an_autopilot_that_fits_has_no_warning() -> None:
    found = on_cwolf()
    assert found.warnings == ()
    assert [(mode.name, mode.actuators) for mode in found.modes] == [("hover", ()), ("cruise", ("stern",))]
    gains = {(row.loop, row.gain): row.values for row in found.gains}
    assert gains["pitch", "K_P"] == (40.0, 41.0, 42.0, 43.0, 44.0, 45.0)
    assert gains["heading", "K_P"] == (30.0,) * 6
    assert ("heading", "K_I_per_s") not in gains


def test_loops_with_little_margin_are_warned_of_by_loop_speed_and_margin() -> None:
    found = on_cwolf(("K_P = 30.0\nK_D_s = 60.0\n", "K_P = 30.0\n"))
    assert found.warnings == (
        "keep the speed of missions between 0.85 and 3.00 m/s, or tune the gains (seatrial tune): at 0.00 m/s"
        " heading has little margin (phase 6 deg of 30, gain 3.7 dB of 6, sensitivity 10, at most 2)",
    )
    # What grows comes first, whatever else is wrong.
    unstable = on_cwolf(("K_P = 30.0\nK_D_s = 60.0", "K_P = 3000.0\nK_D_s = 60.0"))
    assert "at 0.00, 1.00, 2.00 and 3.00 m/s a motion grows (heading)" in unstable.warnings[0]
    assert found.report().outcome == "1 warning"
    assert check_autopilot(Autopilot.from_toml(TEXT)).margins is None


def test_margins_are_told_with_perfect_sensors_and_what_typical_ones_leave() -> None:
    remus = Vehicle.load("remus100")
    own = Autopilot.load("remus100")
    found = check_autopilot(own, vehicle=remus)
    assert found.margins is not None
    assert (
        "sound from 1.54 to 2.44 m/s with perfect sensors, phase margin at least 37 deg"
        in found.report().good
    )
    late = report_margins(remus, own, [2.444], sensors="typical")
    phase = min(row.phase_deg for row in late if row.phase_deg is not None)
    assert phase < 25.0
    assert said(found, f"this table: at 2.44 m/s pitch has little margin (phase {phase:.0f} deg of 30")
    plain = found.to_dict()
    assert [row["verdict"] for row in plain["margins"]] == ["sound"] * 6
    assert plain["margins_typical_sensors"][-1]["phase_deg"] == pytest.approx(phase, rel=1e-3)


def test_margins_are_those_of_speeds_that_the_vehicle_reaches() -> None:
    found = on_cwolf(("[-2.0, -1.0, 0.0, 1.0, 2.0, 3.0]", "[-2.0, -1.0, 0.0, 1.0, 2.0, 9.0]"))
    assert found.margins is not None
    assert [row.speed_m_s for row in found.margins.rows] == [-2.0, -1.0, 0.0, 1.0, 2.0]
    assert found.margins.sound is not None
    assert found.margins.sound[1] <= 3.2


def test_supporting_points_are_held_against_the_reachable_speeds() -> None:
    speeds = "[-2.0, -1.0, 0.0, 1.0, 2.0, 3.0]"
    assert said(on_cwolf(), "6 of 6 within the -2.45 to 3.18 m/s")
    assert warned(on_cwolf((speeds, "[-9.0, -7.0, -5.0, 1.0, 5.0, 9.0]")), "hardly adapt to the speed")
    assert warned(
        on_cwolf((speeds, "[-1.0, -0.5, 0.0, 0.2, 0.5, 1.0]")), "far below the top speed of 3.18 m/s"
    )


def test_a_row_that_the_actuators_of_a_mode_do_not_command_is_told() -> None:
    # The vertical thrusters of CWolf lie on its axis: heave and pitch, and no heading.
    verticals = [name for name, facts in CWOLF.actuator_info().items() if facts["group"] != "stern"]
    found = on_cwolf(('actuators = ["stern"]', f"actuators = {verticals}".replace("'", '"')))
    assert warned(found, 'mode "cruise": its actuators do not command N (heading) independently')


def test_a_demand_beyond_the_reach_of_the_actuators_is_told() -> None:
    assert said(on_cwolf(("tau_max = 100.0", "tau_max = 1000.0")), "surge may ask for 1000 N")
    assert not said(on_cwolf(), "may ask for")


def test_a_loop_that_the_vehicle_cannot_have_is_refused() -> None:
    with pytest.raises(VehicleError, match="sway needs the row Y"):
        on_cwolf(
            ("[loops.heave]", "[loops.sway]\nK_P = 1.0\ntau_max = 1.0\n[loops.heave]"),
            ('["surge", "heave"', '["surge", "sway", "heave"'),
        )


def test_abort_of_a_vehicle_that_sinks_is_told() -> None:
    heavy = CWOLF.with_coefficients({"B": CWOLF.coefficients()["B"] - 10.0})
    autopilot = Autopilot.from_toml(TEXT)
    assert any("N heavy: it sinks" in text for text in check_autopilot(autopilot, vehicle=heavy).warnings)
    names = ("stale_depth", "stale_attitude", "stale_rates")
    calm = "[safety]\n" + "".join(f'{n} = {{ after_s = 5.0, reaction = "surface" }}\n' for n in names)
    autopilot = Autopilot.from_toml(TEXT + calm)
    assert check_autopilot(autopilot, vehicle=heavy).warnings == ()


def test_a_loiter_circle_that_is_too_tight_is_told() -> None:
    remus = Vehicle.load("remus100")
    start = TEXT.index("[[modes]]")
    cruise = TEXT[TEXT.index("[[modes]]", start + 1) :].replace(
        'from_speed_m_s = 0.8\nactuators = ["stern"]\n', ""
    )
    head = TEXT[:start].replace("[-2.0, -1.0, 0.0, 1.0, 2.0, 3.0]", "[1.0, 1.2, 1.4, 1.6, 1.8, 2.4]")
    for radius, tight in ((5.0, True), (20.0, False)):
        text = head + cruise + f"[guidance]\nloiter_radius_m = {radius}\n"
        found = check_autopilot(Autopilot.from_toml(text), vehicle=remus)
        assert warned(found, "leaves little room") == tight
        assert said(found, f"station-keeping is a circle of {radius:g} m")


@pytest.mark.parametrize(("name", "law"), [("remus100", "pid"), ("lauv", "lqr")])
def test_a_lookahead_that_is_too_short_is_told(name: str, law: str) -> None:
    vehicle = Vehicle.load(name)
    own = Autopilot.load(name) if law == "pid" else started(name, law)
    assert not warned(check_autopilot(own, vehicle=vehicle), "nearly oscillates")
    table = tomllib.loads(own.to_toml())["guidance"]
    paths = {"lookahead_m": "course", "lookahead_vertical_m": "depth"}
    short = check_autopilot(
        own.with_gains({f"guidance.{key}": 0.3 * table[key] for key in paths}), vehicle=vehicle
    )
    for key, what in paths.items():
        assert warned(short, f"the {what} nearly oscillates about a path: {key}")


def test_every_watch_and_reaction_has_its_words() -> None:
    names, own = autopilot_names(), check_autopilot(Autopilot.load("cwolf"))
    groups = [f"stale_{name}" for name in names["groups"][:6]]
    for reaction in names["reactions"]:
        table = {key: {"after_s": 3.0, "reaction": reaction} for key in groups}
        table |= {
            "battery": {"below": 0.2, "reaction": reaction},
            "actuator": {"deviation": 0.2, "after_s": 2.0, "reaction": reaction},
        }
        table["progress"] = {"after_s": 120.0, "reaction": reaction}
        table["speed"] = {"off_m_s": 0.3, "after_s": 8.0, "reaction": reaction}
        table["contradiction"] = Autopilot.load("cwolf").safety()["contradiction"]
        whole = {**table, **dict.fromkeys(("depth", "altitude", "fence", "time"), reaction)}
        whole |= {"surface_speed_m_s": 0.5, "surfaced_above_m": 0.3, "ascent_after_s": 30.0}  # type: ignore[dict-item]
        found = replace(own, watches=whole).safety
        assert len(found) == len(names["watches"]) + 1
        ends = {
            sentence.rpartition(": ")[2].removeprefix("allocate without it, and ")
            for sentence in found[:-1]
            # What is only told has no reaction; what surfacing ends in follows from that to a lost depth.
            if "told, and" not in sentence and "No higher" not in sentence
        }
        assert len(ends) == 1
        ascent = next(sentence for sentence in found if "No higher" in sentence)
        assert ascent.endswith("stop all actuators") == (reaction == "abort")
    circling = replace(own, watches=whole | {"fence": "hold"}, hovers=False, loiter_radius_m=20.0).safety
    assert any("fence: circle at 20 m" in sentence for sentence in circling)


def test_the_verb_prints_modes_gains_and_safety(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(TEXT)
    result = call("check", path, "--vehicle", "cwolf", "--verbose")
    assert result.exit_code == 0, result.output
    for words in (
        "Modes",
        "Gains",
        "K_P",
        "No position for 60 s",
        "nothing looks wrong",
        "Margins with perfect",
    ):
        assert words in result.stdout
    data = json.loads(call("check", path, "--json").stdout)
    assert data["modes"][1]["from_speed_m_s"] == 0.8
    assert len(data["safety"]) == len(autopilot_names()["watches"]) + 1


@pytest.mark.parametrize("options", [(), ("--vehicle", "cwolf")])
def test_a_mistake_in_the_text_is_said_and_the_file_taken_for_no_vehicle(
    tmp_path: Path, options: tuple[str, ...]
) -> None:
    path = tmp_path / "big.toml"
    path.write_text(TEXT + "\n[safety\n")
    result = call("check", path, *options)
    assert result.exit_code == 2
    said = " ".join(result.stderr.split())
    assert "big.toml: not a TOML file: " in said
    assert "line " in said
    assert "vehicle" not in said


def test_options_that_do_not_belong_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(TEXT)
    result = call("check", path, "--autopilot", "cwolf")
    assert result.exit_code == 2
    assert "--autopilot is for a mission" in result.stderr
    result = call("check", path, "--vehicle", "remus100")
    assert result.exit_code == 2
    assert "the loop heave needs the row Z" in result.stderr
