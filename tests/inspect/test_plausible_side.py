"""A ratio between channels is blamed on the side that no vehicle can have, and not told of noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial.base.arrays import Array
from seatrial.inspect.consistency import consistency
from seatrial.intake.imported import import_logs
from seatrial.trial.signals import Series
from seatrial.trial.trial import Trial
from tests.inspect.logs import log

WEIGHT = 1025.0 * 9.81  # Pa a metre


def dive() -> dict[str, Array]:
    """A torpedo between 1 and 9 m with pitch, velocity and attitude; no position, gauge pressure in Pa."""
    t = np.arange(0.0, 200.0, 0.1)
    pitch = 0.12 * np.sin(0.13 * t)
    u, w = 1.5 + 0.1 * np.sin(0.05 * t), 0.05 * np.sin(0.5 * t)
    sink = -np.sin(pitch) * u + np.cos(pitch) * w
    depth = 3.0 + np.cumsum(sink) * 0.1
    return {
        "time_s": t,
        "roll_deg": 0.0 * t,
        "pitch_deg": np.rad2deg(pitch),
        "yaw_deg": 10.0 * np.sin(0.02 * t),
        "u_m_s": u,
        "v_m_s": 0.0 * t,
        "w_m_s": w,
        "press": depth * WEIGHT,
    }


MAP = """
format = 1
[columns]
z_m = {{ from = "dive.press", unit = "{unit}", convert = "pressure" }}
roll_deg = "dive.roll_deg"
pitch_deg = "dive.pitch_deg"
yaw_deg = "dive.yaw_deg"
u_m_s = "dive.u_m_s"
v_m_s = "dive.v_m_s"
w_m_s = "dive.w_m_s"
"""


@pytest.mark.parametrize(("unit", "size"), [("bar", 1e5), ("dbar", 1e4), ("kPa", 1e3)])
def test_a_pressure_in_another_unit_is_blamed_and_not_the_velocity(
    tmp_path: Path, unit: str, size: float
) -> None:
    table = dive()
    table["press"] = table["press"] / size
    pl.DataFrame(table).write_csv(tmp_path / "dive.csv")
    (tmp_path / "map.toml").write_text(MAP.format(unit="Pa"))
    made = import_logs(tmp_path / "dive.csv", map=tmp_path / "map.toml")
    (trial,) = made.trials
    (said,) = trial.consistency.contradictions
    assert said.startswith("depth: moves by")
    assert f"a pressure in {unit} that is read as Pa" in said
    assert trial.consistency.corrections == ()
    report = str(trial.trial.report)
    assert "u: " not in report  # nothing is said of the velocity
    # With the unit that it has the depth is right, as pressure above the air's.
    (tmp_path / "map.toml").write_text(MAP.format(unit=unit))
    (right,) = import_logs(tmp_path / "dive.csv", map=tmp_path / "map.toml").trials
    assert right.consistency.contradictions == ()
    depth = right.trial.observed[:, 8]
    assert np.abs(depth - table["press"] * size / WEIGHT).max() < 0.01


def test_a_velocity_that_no_vehicle_has_is_blamed_itself() -> None:
    table = dive()
    depth = table.pop("press") / WEIGHT
    table |= {"z_m": depth} | {name: 1e3 * table[name] for name in ("u_m_s", "v_m_s", "w_m_s")}
    report = str(Trial.read(table, columns={"t_s": "time_s"}).report)
    assert "u: 1e+03 times what the derivative of the recorded depth shows: mm/s?" in report


def test_no_ratio_is_told_of_a_vehicle_that_holds_its_depth() -> None:
    random = np.random.default_rng(1)
    t = np.arange(0.0, 120.0, 0.1)
    # A hundredth of a mm/s of depth and the noise of a Doppler log.
    noise = 0.003 * random.standard_normal((3, len(t)))
    series = {"z": Series(t, 5.0 + 1e-5 * np.sin(t)), "roll": Series(t, 0.0 * t)}
    series |= {"pitch": Series(t, 0.01 * np.sin(0.1 * t)), "yaw": Series(t, 0.2 * np.sin(0.2 * t))}
    series |= {name: Series(t, noise[k]) for k, name in enumerate("uvw")}
    found = consistency(series)
    assert found.corrections == ()
    assert found.contradictions == ()
    assert any("hardly any motion" in said for said in found.missing)


def test_a_gyro_that_shows_nothing_of_an_axis_has_no_ratio() -> None:
    series = log(3, length_s=60.0)
    random = np.random.default_rng(1)
    r = series["r"]
    found = consistency(series | {"r": Series(r.t, 0.3 * random.standard_normal(len(r.t)), r.clock)})
    assert not any("times)" in said for said in found.contradictions)
    assert any("does not show r" in said for said in found.contradictions)


@pytest.mark.parametrize(("speed_m_s", "said"), [(0.05, False), (1.0, True)])
def test_a_velocity_that_has_nothing_of_the_motion_in_it_has_no_ratio(speed_m_s: float, said: bool) -> None:
    random = np.random.default_rng(3)
    t = np.arange(0.0, 260.0, 0.1)

    def wander(rms: float) -> Array:
        slow = np.convolve(random.standard_normal(len(t) + 80), np.hanning(80), "valid")[: len(t)]
        return np.asarray(rms * slow / slow.std())

    series = {name: Series(t, wander(speed_m_s / np.sqrt(3.0))) for name in "uvw"}
    series |= {name: Series(t, wander(0.05)) for name in ("roll", "pitch", "yaw")}
    # A position that hardly moves, as of an estimator that nothing tells where it is.
    series |= {name: Series(t, 0.1 * np.cumsum(wander(0.035))) for name in "xyz"}
    contradictions = consistency(series).contradictions
    assert not any("times)" in sentence for sentence in contradictions)
    assert any("no delay, tilt or scale of the velocity" in one for one in contradictions) is said
