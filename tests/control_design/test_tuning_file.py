"""The campaign file's [tuning]: what is read, its defaults, what is refused and with which words."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest

from seatrial.base.errors import CampaignError
from seatrial.base.toml_file import Section, checked, tables
from seatrial.control_design.corridor import Corridor
from seatrial.control_design.tuning_table import BESIDE, LOOPS, Beside, Loops, TuningTable, default_steps

CONTRACT = """
[tuning]
samples = 6
robust = "worst"
current_m_s = 0.3
sensors = "typical"
margins = { phase_deg = 35.0, gain_db = 6.0, delay_s = 0.2 }
smoothness = 0.05
bounds = [0.1, 10.0]
settle_s = 30.0
budget = { population = 12, generations = 40 }
[tuning.loops.surge]
steps = [0.4, -0.4]
speeds_m_s = [1.0, 3.0]
corridor = { rise_s = 10.0, overshoot = 0.10, settling_s = 20.0, settled = 0.05, steady = 0.03 }
weights = { lower = 1.0, upper = 2.0 }
[tuning.loops.surge.beside]
depth_m = 0.5
heading_deg = 5.0
[tuning.loops.depth]
corridor = { lower = [[0.0, -0.1], [10.0, 0.9]], upper = [[0.0, 1.1]] }
"""


class File(Section):
    """A campaign file of which only this table is looked at."""

    tuning: TuningTable


def read(text: str) -> TuningTable:
    return checked(File, tables(text, "tank.toml"), "tank.toml").tuning


def refusal(text: str) -> str:
    with pytest.raises(CampaignError) as caught:
        read("[tuning]\n" + text)
    return str(caught.value)


def test_every_key_is_read() -> None:
    table = read(CONTRACT)
    assert (table.budget.population, table.budget.generations, table.settle_s) == (12, 40, 30.0)
    given = table.loops.given()
    assert list(given) == ["surge", "depth"]
    surge = given["surge"]
    assert (surge.steps, surge.speeds_m_s) == ((0.4, -0.4), (1.0, 3.0))
    assert surge.corridor is not None
    assert surge.corridor.corridor(surge.weights) == Corridor.from_figures(
        rise_s=10.0, overshoot=0.1, settling_s=20.0, settled=0.05, steady=0.03, until_s=40.0, weight_upper=2.0
    )
    assert surge.beside.half_widths() == {"z": 0.5, "yaw": pytest.approx(math.radians(5.0))}
    depth = given["depth"].corridor
    assert depth is not None
    assert depth.corridor(given["depth"].weights) == Corridor([(0.0, -0.1), (10.0, 0.9)], [(0.0, 1.1)])


def test_an_empty_table_has_defaults_that_do_not_depend_on_the_vehicle() -> None:
    table = read("[tuning]")
    assert (table.samples, table.robust, table.current_m_s, table.sensors) == (3, "worst", None, "typical")
    margins = table.margins
    assert (margins.phase_deg, margins.gain_db, margins.delay_s) == (30.0, 6.0, 0.2)
    assert (table.smoothness, table.bounds, table.settle_s) == (0.05, (0.1, 10.0), None)
    assert table.loops.given() == {}
    surge = read("[tuning.loops.surge]").loops.given()["surge"]
    assert (surge.steps, surge.speeds_m_s, surge.corridor) == (None, None, None)


def test_one_figure_is_enough_for_a_corridor() -> None:
    table = read("[tuning.loops.pitch]\ncorridor = { rise_s = 4.0 }").loops.given()["pitch"]
    assert table.corridor is not None
    assert table.corridor.corridor(table.weights) == Corridor.from_figures(rise_s=4.0)


def test_every_loop_and_every_key_beside_has_a_channel() -> None:
    assert list(Loops.model_fields) == list(LOOPS)
    assert list(Beside.model_fields) == list(BESIDE)
    for loop in LOOPS:
        ahead, back = default_steps(loop, top_m_s=2.0)
        assert 0.0 < ahead == -back < LOOPS[loop].largest
    for key, (_, factor) in BESIDE.items():
        assert (factor != 1.0) == key.endswith("_deg")


def test_default_steps_are_values_of_the_file() -> None:
    for loop in LOOPS:
        steps = list(default_steps(loop, top_m_s=3.18))
        assert read(f"[tuning.loops.{loop}]\nsteps = {steps}").loops.given()[loop].steps == tuple(steps)


LOOP = "[tuning.loops.surge]\n"
REFUSED = {
    "smothness = 1.0": "unknown key 'smothness'; did you mean \"smoothness\"?",
    "robust = 1.2": 'expected "worst" or a quantile over the samples from 0 to 1, found 1.2',
    'robust = "best"': "found 'best'",
    "samples = -1": "tuning, key samples: expected greater than or equal to 0, found -1",
    "samples = 2.5": "expected a whole number, found 2.5",
    "current_m_s = -0.1": "expected greater than or equal to 0",
    "bounds = [2.0, 3.0]": "0 < lower <= 1 <= upper and lower < upper, found [2, 3]",
    "bounds = [1.0, 1.0]": "found [1, 1]",
    "margins = { phase_deg = 100.0 }": "tuning, margins, key phase_deg: expected less than or equal to 90",
    "settle_s = 0.0": "expected greater than 0",
    "budget = { population = 1 }": "budget, key population",
    "[tuning.loops.surg]": "unknown key 'surg'; did you mean \"surge\"?",
    LOOP + "steps = []": "expected at least one entry",
    LOOP + "steps = [0.4, 0.0]": "steps holds 0 as entry 2",
    LOOP + "steps = [0.4, 0.4]": "steps holds 0.4 twice",
    LOOP + "speeds_m_s = [1.0, 1.0]": "speeds_m_s holds 1 twice",
    "[tuning.loops.pitch]\nsteps = [95.0]": "expected angles between -90 and 90 deg, found 95",
    "[tuning.loops.heading]\nsteps = [-120.0]": "steps of heading: expected angles between -120 and 120 deg",
    LOOP
    + "corridor = { lower = [[0.0, 0.5], [9.0, 0.9]] }": "a response begins at 0, which lies outside at 0 s",
    LOOP + "corridor = { lower = [[0.0, -0.1]], upper = [[0.0, 1.1], [9.0, 0.8]] }": "a response ends at 1",
    LOOP + "corridor = { rise = 3.0 }": 'did you mean "rise_s"?',
    LOOP + "corridor = 3": "key corridor: expected a table, found 3",
    LOOP + "corridor = { overshoot = 0.1 }": "expected rise_s, or points as lower and upper",
    LOOP + "corridor = { rise_s = 1.0, lower = [[0.0, 1.0]] }": "gives figures (rise_s) and points",
    LOOP + "corridor = { rise_s = 10.0, settling_s = 5.0 }": "settling_s = 5 is before rise_s = 10",
    LOOP + "corridor = { lower = [[0.0, 0.1, 3.0]] }": "key lower[1]: expected a point [time in s, share of",
    LOOP
    + "corridor = { lower = [[0.0, 0.0], [9.0, 1.2]], upper = [[0.0, 1.1]] }": "the bounds cross: at 9 s",
    LOOP + "weights = { lower = 0.0, upper = 0.0 }": "both weights are 0",
    LOOP + "weights = { lower = -1.0 }": "weights, key lower: expected greater than or equal to 0",
    LOOP + "beside = { depth = 0.5 }": 'did you mean "depth_m"?',
    LOOP
    + "beside = { surge_m_s = 0.5 }": "beside of surge bounds surge_m_s, the response of the loop itself",
    "[tuning.loops.depth.beside]\ndepth_m = 0.5": "beside of depth bounds depth_m",
}


@pytest.mark.parametrize("text", REFUSED)
def test_wrong_values_are_refused_in_one_sentence(text: str) -> None:
    message = refusal(text)
    assert REFUSED[text] in message
    assert "\n" not in message
    assert message.startswith("tank.toml: ")


def test_reading_the_table_loads_no_heavy_library() -> None:
    code = (
        "import sys, seatrial.control_design.tuning_table, seatrial.tuning.criterion\n"
        "print([m for m in ('scipy', 'polars', 'matplotlib', 'control', 'pint', 'cma') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
