"""The figure of a recording shows all channels and commands, and shades what is held out."""

from __future__ import annotations

import numpy as np

import seatrial as st
from seatrial.report.plot.recording import recording
from seatrial.report.plot.style import SHADE


def test_recording_shows_channels_commands_modes_and_hold_out() -> None:
    t = np.arange(0.0, 600.0, 0.1)
    u = 1.0 + np.sin(0.1 * t)
    u[3000] = 9.0  # a spike that thinning must keep: it is what one looks for
    table = {"t_s": t, "u_m_s": u, "yaw_deg": (0.9 * t + 180.0) % 360.0 - 180.0, "cmd.port": 1500.0 + t}
    trial = st.Trial.read(table, align=False)
    figure = recording(trial, held_out=[(400.0, 600.0)], marks=[(100.0, "MANUAL"), (300.0, "GUIDED")])
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles[0] == "velocity"
    assert "yaw" in titles
    assert "commands" in titles
    yaw = figure.axes[titles.index("yaw")].get_lines()[0].get_ydata()
    assert np.abs(np.diff(np.asarray(yaw, float))).max() < 10.0  # no line across where the angle wraps
    shaded = [patch for patch in figure.axes[0].patches if patch.get_facecolor()[:3] != (1.0, 1.0, 1.0)]
    assert len(shaded) == 1
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts == ["MANUAL", "GUIDED"]
    assert SHADE


def test_a_recording_shows_stated_units_and_both_parts_of_a_wrench() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    table = {"t_s": t, "u_m_s": np.sin(t), "cmd.port": 1150.0 + t, "cmd.pump": 1500.0 + t}
    trial = st.Trial.read(table | {"tau.X_n": t, "tau.N_nm": -t}, align=False)
    many = [(0.1 * k, "MANUAL") for k in range(200)]
    figure = recording(trial, marks=many, units={"port": "rpm", "pump": "us"})
    panels = {axes.get_ylabel(): [line.get_label() for line in axes.get_lines()] for axes in figure.axes}
    assert panels == {"m/s": ["u"], "µs": ["pump"], "rpm": ["port"], "N": ["X"], "N m": ["N"]}
