"""Numbers and texts that stand for no sample, and small corrections that are samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray

from seatrial._core import Vehicle
from seatrial.base.errors import VehicleError
from seatrial.trial.misread import sentinels
from seatrial.trial.trial import Trial

Array = NDArray[np.float64]

T = 0.1 * np.arange(600.0)

MEASURED = {
    "depth": 15.0 + 3.0 * np.sin(T / 5.0) + 0.01 * np.cos(97.0 * T),
    "speed": np.round(1.5 + 0.1 * np.sin(T), 3),
    "voltage": np.round(15.0 - 0.01 * T, 1),
    "northing": np.round(6e6 + T, 2),
}
COMMANDS = {
    "pulse width": np.round(1500.0 + 300.0 * np.sin(T)),
    "bang-bang": 1000.0 * np.sign(np.sin(T / 3.0)),
    "short pulses": np.where(np.arange(600) % 37 == 0, 1500.0, 0.0),
    "at rest": np.zeros(600),
}
CODES = (-9999.0, 9999.0, 99999.0, 65535.0, 32767.0, -32768.0, 1e30)


def spoilt(y: Array, code: float) -> tuple[Array, Array]:
    at = np.random.default_rng(3).choice(np.arange(5, 595, 7), 12, replace=False)
    result = y.copy()
    result[at] = code
    return result, np.sort(at)


@pytest.mark.parametrize("code", [*CODES, -999.25, 0.0, -1.0, 777777.0])
@pytest.mark.parametrize("name", MEASURED)
def test_a_code_in_a_measured_column_is_found_and_nothing_else(name: str, code: float) -> None:
    assert sentinels(MEASURED[name]) == []
    y, at = spoilt(MEASURED[name], code)
    (found,) = sentinels(y)
    assert found.value == code
    np.testing.assert_array_equal(np.flatnonzero(found.at), at)


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_code_in_a_command_is_found_and_no_pulse_is(name: str, code: float) -> None:
    assert sentinels(COMMANDS[name], jumps=True) == []
    y, at = spoilt(COMMANDS[name], code)
    (found,) = sentinels(y, jumps=True)
    np.testing.assert_array_equal(np.flatnonzero(found.at), at)


@pytest.mark.parametrize(
    "code", [-32.768, 32.767, 327.67, 655.35, -214.7483648, 6553.5, float(np.float32(-32.768))]
)
def test_the_end_of_an_integer_type_in_the_unit_of_the_column_is_a_code(code: float) -> None:
    speed = MEASURED["speed"].copy()
    speed[[20, 400]] = code
    (found,) = sentinels(speed)
    assert (found.value, found.count) == (code, 2)
    # A depth that passes through the number keeps it.
    deep = np.round(np.linspace(20.0, 45.0, 600), 3)
    deep[300] = abs(code) if abs(code) < 45.0 else deep[300]
    assert sentinels(deep) == []


def test_several_codes_in_one_column_are_all_found() -> None:
    y, _ = spoilt(MEASURED["depth"], -9999.0)
    y[[3, 300]] = 99999.0
    assert {one.value for one in sentinels(y)} == {-9999.0, 99999.0}


def test_codes_are_masked_and_named_and_the_command_before_is_held() -> None:
    depth, at = spoilt(MEASURED["depth"], -9999.0)
    command, held = spoilt(COMMANDS["pulse width"], 65535.0)
    trial = Trial.read({"t_s": T, "z_m": depth, "cmd.thruster": command}, align=False)
    assert not trial.valid[at, 8].any()
    assert np.nanmin(trial.observed[trial.valid[:, 8], 8]) > 11.0
    np.testing.assert_allclose(trial.commands["thruster"][held], COMMANDS["pulse width"][held - 1])
    said = str(trial.report)
    assert "z_m: 12 samples of -9999 stand for no sample; masked" in said
    assert "cmd.thruster: 12 samples of 65535 stand for no sample; the value before is held" in said


@pytest.mark.parametrize("word", ["NaN", "N/A", "null", "--", "None", "inf"])
def test_words_for_no_sample_are_masked(word: str) -> None:
    cells = [f"{value:.4f}" for value in MEASURED["depth"]]
    cells[50] = word
    trial = Trial.read(pl.DataFrame({"t_s": T, "z_m": cells}), align=False)
    assert not trial.valid[50, 8]
    assert trial.valid[[48, 52], 8].all()


def corrected(rate_hz: float, every_s: float, stamps: str, digits: int | None) -> dict[str, Any]:
    """Depth and attitude as a filter gives them: smooth, but corrected by small lone steps that stay."""
    random = np.random.default_rng(5)
    count = int(40.0 * rate_hz)
    t = np.arange(count) / rate_hz
    steps = np.zeros(count)
    at = np.arange(7, count, round(every_s * rate_hz))
    steps[at] = random.laplace(0.0, 0.02, len(at))
    depth = 5.0 + 0.5 * np.sin(t / 3.0) + np.cumsum(steps)
    yaw = 60.0 * np.sin(t / 5.0) + np.rad2deg(np.cumsum(np.roll(steps, 3)))
    late = (0.45 if stamps == "jitter" else 0.0) * random.uniform(-1.0, 1.0, count) / rate_hz
    return {
        "t_s": t + late,
        "z_m": depth if digits is None else np.round(depth, digits),
        "roll_deg": 2.0 * np.sin(t),
        "pitch_deg": 2.0 * np.cos(t),
        "yaw_deg": yaw,
    }


@pytest.mark.parametrize("digits", [None, 3])
@pytest.mark.parametrize("stamps", ["even", "jitter"])
@pytest.mark.parametrize(("rate_hz", "every_s"), [(200.0, 0.1), (200.0, 0.5), (50.0, 0.3)])
def test_corrections_of_a_filter_are_kept(
    rate_hz: float, every_s: float, stamps: str, digits: int | None
) -> None:
    trial = Trial.read(corrected(rate_hz, every_s, stamps, digits), align=False)
    # A single step in the far tail of the corrections may cost the samples beside it.
    assert trial.valid[:, 8:].mean() > 0.995
    assert "frozen" not in str(trial.report)


def test_a_wrong_solution_among_corrections_is_masked() -> None:
    table = corrected(50.0, 0.3, "even", None)
    table["z_m"][700:740] += 3.0
    trial = Trial.read(table, align=False)
    assert not trial.valid[700:740, 8].any()
    assert trial.valid[:650, 8].mean() > 0.99


def test_a_fin_limit_in_degrees_is_refused_with_its_value_in_rad() -> None:
    text = Vehicle.load("lauv").to_toml()
    with pytest.raises(
        VehicleError, match=r"at most 1\.571 rad .* found 20; give it in rad: 20 degrees are 0\.34"
    ):
        Vehicle.from_toml(text.replace("maximum_ahead = 0.5236", "maximum_ahead = 20.0", 1))
