"""The convention of an attitude, from what gyro, velocity, position and depth show of the motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from seatrial.base.arrays import Array
from seatrial.base.frames import attitude_to_ned, conjugate, from_euler, product, to_euler
from seatrial.inspect.consistency import consistency, convention_of
from seatrial.inspect.corrections import Consistency
from seatrial.intake.imported import import_logs
from seatrial.trial.signals import Series
from seatrial.trial.trial import Trial
from tests.inspect.logs import log
from tests.trial import motion

ENU = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0])


def written(q: Array, last: bool, inverse: bool, frame: str) -> Array:
    """Quaternions (n, 4), scalar first, FRD to NED, as a logger of this convention writes four columns."""
    if frame == "FLU/NWU":
        q = attitude_to_ned(q, frame, "test")  # its own inverse
    if frame == "FLU/ENU":
        q = product(product(conjugate(ENU), q), [0.0, 1.0, 0.0, 0.0])
    q = conjugate(q) if inverse else q
    return q[:, [1, 2, 3, 0]] if last else q


def recorded(seed: int, last: bool, inverse: bool, frame: str, without: str = "") -> dict[str, Series]:
    """A log whose quaternion is read as scalar first, FRD to NED, whatever it is."""
    series = log(seed, length_s=60.0)
    old = series["roll"]
    q = from_euler(np.stack([series[name].value for name in ("roll", "pitch", "yaw")], axis=1))
    angles = to_euler(written(q, last, inverse, frame))
    series |= {name: Series(old.t, angles[:, k], "ahrs") for k, name in enumerate(("roll", "pitch", "yaw"))}
    return {name: one for name, one in series.items() if name not in without}


@pytest.mark.parametrize(
    ("last", "inverse", "frame"),
    [
        (True, False, "FRD/NED"),
        (False, True, "FRD/NED"),
        (True, True, "FRD/NED"),
        (False, False, "FLU/NWU"),
        (False, False, "FLU/ENU"),
        (True, False, "FLU/ENU"),
    ],
)
@pytest.mark.parametrize("without", ["", "xy", "pqr"])
def test_law_the_convention_is_told_by_what_moves(
    last: bool, inverse: bool, frame: str, without: str
) -> None:
    found = convention_of(recorded(1, last, inverse, frame, without))
    assert found is not None
    assert (found.last, found.inverse) == (last, inverse)
    # Two earth frames that differ by a heading are one to gyro and depth.
    assert frame in found.frames
    assert without == "xy" or found.frames == (frame,)
    assert found.share > 0.9 > found.before
    assert not found.either


@pytest.mark.parametrize("without", ["", "xy", "pqr", "xyuvw"])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_convention_that_was_read_is_left_where_it_is_right(seed: int, without: str) -> None:
    assert convention_of(recorded(seed, False, False, "FRD/NED", without)) is None


def test_gyro_and_attitude_alone_do_not_tell_whose_axes_point_up() -> None:
    found = consistency(recorded(1, False, False, "FLU/ENU", "xyuvw"))
    (said,) = found.contradictions
    assert 'frame = "FLU/NWU" or frame = "FLU/ENU"' in said
    assert 'or the gyro has them (give frame = "FLU"' in said
    assert not found.corrections  # nobody's signs are reversed before that is known
    report = found.report()
    assert report.outcome == "contradictory"
    assert "column map" in report.next_step


def test_what_follows_is_compared_with_the_attitude_that_it_is() -> None:
    found: Consistency = consistency(recorded(2, True, False, "FRD/NED"))
    assert len(found.contradictions) == 1
    assert "x y z w, the scalar last" in found.contradictions[0]
    assert found.corrections == ()


def table(last: bool) -> dict[str, Array]:
    """A recording with a quaternion in numbered columns."""
    t = np.arange(0.0, 60.0, 0.1)
    made = motion.columns(t, noise=2e-3)
    q = np.stack([made.pop(f"q_{c}") for c in "wxyz"], axis=1)
    return made | {f"q{k}": one for k, one in enumerate(written(q, last, False, "FRD/NED").T)}


@pytest.mark.parametrize("last", [True, False])
def test_an_import_puts_a_numbered_quaternion_in_order(tmp_path: Path, last: bool) -> None:
    pl.DataFrame(table(last)).write_csv(tmp_path / "dive.csv")
    made = import_logs(tmp_path / "dive.csv")
    sources = [made.columns[name].source.rpartition(".")[2] for name in ("q_w", "q_x", "q_y", "q_z")]
    assert sources == (["q3", "q0", "q1", "q2"] if last else ["q0", "q1", "q2", "q3"])
    (trial,) = made.trials
    assert trial.consistency.contradictions == ()
    assert trial.consistency.corrections == ()


def test_reading_says_the_convention_and_reverses_no_sign() -> None:
    columns = {f"q_{c}": f"q{k}" for k, c in enumerate("wxyz")}
    report = str(Trial.read(table(last=True), columns=columns).report)
    assert "attitude: the attitude has another convention than the map says" in report
    assert "sign reversed" not in report
    stated = {f"q_{c}": f"q{k}" for k, c in enumerate("xyzw")}
    assert "another convention" not in str(Trial.read(table(last=True), columns=stated).report)
