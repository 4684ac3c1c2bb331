"""Commands of a fixed rate that fall silent are unknown there; commands logged when they change are held."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from seatrial.scoring.record import cut_spans
from seatrial.trial.trial import Trial

Array = NDArray[np.float64]

T = np.arange(0.0, 180.0, 0.1)


def _trial(known: NDArray[np.bool_], command: Array | None = None) -> Trial:
    """Trial of 180 s with a command (n,) in the rows `known` (n,) and empty cells elsewhere."""
    random = np.random.default_rng(3)
    command = np.sin(0.7 * T) if command is None else command
    table: dict[str, Any] = {
        "t_s": T,
        "u_m_s": 1.0 + 0.1 * np.sin(0.3 * T) + 0.01 * random.standard_normal(len(T)),
        "cmd.rudder": [value if here else None for value, here in zip(command.tolist(), known, strict=True)],
        "cmd.propeller": 900.0 + 100.0 * np.sin(0.2 * T),
    }
    return Trial.read(table)


def _said(trial: Trial) -> str:
    return "\n".join(str(one) for one in trial.report.findings if "no command" in one.message)


@pytest.mark.parametrize(
    ("known", "span"),
    [(T < 80.0, (80.0, 180.0)), ((T < 60.0) | (T >= 90.0), (60.0, 90.0)), (T >= 60.0, (0.0, 60.0))],
)
def test_a_command_that_falls_silent_is_reported_and_masks_the_fit(
    known: NDArray[np.bool_], span: tuple[float, float]
) -> None:
    trial = _trial(known)
    inside = (trial.t > span[0] + 0.15) & (trial.t < span[1] - 0.15)
    outside = (trial.t < span[0] - 0.15) | (trial.t > span[1] + 0.15)
    u = trial.valid[:, 0]
    assert not u[inside].any()
    assert u[outside].all()
    said = _said(trial)
    assert said.count("commands: rudder: no command from") == 1
    assert "propeller" not in said
    # Segments of 10 s: none runs across the silence, in which a simulation would follow a wrong command.
    spans = cut_spans(trial, 0, len(trial), 101)
    assert spans
    assert all(not inside[start:stop].any() for start, stop in spans)


def test_a_short_silence_ends_a_segment() -> None:
    trial = _trial((T < 63.0) | (T >= 66.0))
    assert trial.silent is not None
    assert trial.silent.sum() in (29, 30)  # 3 s at 10 Hz, less the usual time of the last command
    assert all(not trial.silent[start:stop].any() for start, stop in cut_spans(trial, 0, len(trial), 101))


def test_a_command_logged_when_it_changes_is_held() -> None:
    random = np.random.default_rng(5)
    steps = np.zeros(len(T), bool)
    steps[random.choice(len(T), 150, replace=False)] = True
    stick = np.zeros(len(T), bool)  # moved for 5 s at 10 Hz, then left alone for 15 s, again and again
    stick[(T % 20.0) < 5.0] = True
    for known in (steps, stick, T < 0.05, np.isin(np.arange(len(T)), [0, 500, 1200])):
        trial = _trial(known)
        assert trial.silent is None
        assert trial.valid[:, 0].all()
        assert not _said(trial)
