"""Signals put on one time base and into the arrays of a trial; missing motion derived from the pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seatrial.recording.columns import CHANNELS
from seatrial.recording.report import RecordingReport
from seatrial.recording.resampling import GAP, held, linear
from seatrial.recording.signal import Signal
from seatrial.recording.smoothing import spline
from seatrial.recording.water_current import add_current
from seatrial.rotation import body_rates, matrix, to_euler

__all__ = ["assemble"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_FIXES = 0.5  # share of the record in which a position from another sensor than the depth is known
_STENCIL = 2  # a derivative is believed where this many samples on both sides are valid


def assemble(signals: Mapping[str, Signal], t: Array, report: RecordingReport) -> dict[str, Any]:
    """Arrays of a `seatrial.trial.Trial` by the names of its fields, at the uniform times `t` (n,)."""
    observed = np.full((len(t), 12), np.nan)
    filled = np.zeros((len(t), 12))
    valid = np.zeros((len(t), 12), bool)
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    for name in ("position", "depth", "velocity", "rates"):
        if name in signals:
            _report_gaps(signals[name], report)
            place = [CHANNELS.index(channel) for channel in signals[name].channels]
            filled[:, place], valid[:, place] = linear(signals[name], t)
            observed[:, place] = filled[:, place]
    _only_fixes(signals, valid, report)
    if "attitude" in signals:
        _report_gaps(signals["attitude"], report)
        attitude, good = linear(signals["attitude"], t)
        place = [CHANNELS.index(channel) for channel in signals["attitude"].channels]
        observed[:, place] = to_euler(attitude)[:, [k - 9 for k in place]]
        valid[:, place] = good[:, :1]
        _derive(observed, valid, filled, attitude, t, report)
    observed[~np.isfinite(observed)] = np.nan
    absent = np.logical_and.reduce(np.isnan(observed), axis=0)
    report.samples, report.duration_s = len(t), float(t[-1] - t[0])
    report.rate_hz = (len(t) - 1) / report.duration_s
    report.masked = {
        channel: int((~valid[:, k]).sum()) for k, channel in enumerate(CHANNELS) if not absent[k]
    }
    if absent.any():
        missing = " ".join(channel for channel, gone in zip(CHANNELS, absent, strict=True) if gone)
        report.add("info", "channels", f"not recorded: {missing}")
    parts = {
        "observed": observed,
        "valid": valid,
        "position": filled[:, 6:9],
        "attitude": attitude,
        "nu": filled[:, :6],
        "commands": _actuators(signals, t, "cmd."),
        "measured": {name: y[:, 0] for name, y in _continuous(signals, t, "meas.").items()},
        "tau": _wrench(signals, t),
        "voltage": _scalar(signals, t, "voltage"),
        "current": _vector(signals, t, "current", ("north", "east", "down")),
        "water": _vector(signals, t, "water velocity", ("u_water", "v_water", "w_water")),
    }
    if "water velocity" in signals and "current" not in signals and "velocity" in signals:
        known = [linear(signals[name], t)[1] for name in ("velocity", "water velocity")]
        whole = [k.shape[1] == 3 for k in known]
        if all(whole) and "attitude" in signals:
            ground, water = (np.logical_and.reduce(k, axis=1) for k in known)
            upright = np.logical_and.reduce(valid[:, 9:], axis=1)
            add_current(parts, t, np.asarray(ground & upright), np.asarray(water), report)
    return parts


def _derive(
    observed: Array, valid: Mask, filled: Array, attitude: Array, t: Array, report: RecordingReport
) -> None:
    """Fill velocities and rates that no sensor gave from the derivative of the smoothed pose, in place."""
    from scipy.ndimage import minimum_filter1d

    absent = np.logical_and.reduce(np.isnan(observed[:, :6]), axis=0)
    turned = np.logical_or.reduce(valid[:, 9:], axis=1)
    placed = np.logical_and.reduce(valid[:, 6:9], axis=1)
    curve = spline(t, attitude, turned)
    q = curve(t)
    size = np.linalg.norm(q, axis=1)[:, None]
    derived = {
        "rates": (3, body_rates(q / size, curve(t, 1) / size), turned, "the attitude"),
        "velocity": (0, np.zeros((len(t), 3)), turned & placed, "position and attitude"),
    }
    if placed.any() and absent[:3].any():
        path = spline(t, filled[:, 6:9], placed)
        v = np.einsum("nji,nj->ni", matrix(q / size), path(t, 1))
        derived["velocity"] = (0, v, turned & placed, "position and attitude")
    for first, motion, known, origin in derived.values():
        missing = [k for k in range(3) if absent[first + k]]
        if not missing or not known.any():
            continue
        window = 2 * _STENCIL + 1
        good = np.asarray(minimum_filter1d(known.astype(np.uint8), window, mode="nearest")).astype(bool)
        place = [first + k for k in missing]
        observed[:, place] = filled[:, place] = motion[:, missing]
        valid[:, place] = good[:, None]
        names = " ".join(CHANNELS[k] for k in place)
        report.add("info", names, f"derived from {origin} by smoothing differentiation")


def _only_fixes(signals: Mapping[str, Signal], valid: Mask, report: RecordingReport) -> None:
    """Mask a horizontal position that is known in less than half of the record, in place.

    Segments start where their position is known: with fixes at the surface alone none could start below.
    """
    position = signals.get("position")
    if position is None or "z" in position.channels:
        return
    place = [CHANNELS.index(channel) for channel in position.channels]
    share = float(valid[:, place].any(axis=1).mean())
    if 0.0 < share < _FIXES:
        valid[:, place] = False
        names = " ".join(position.channels)
        report.add(
            "warning",
            names,
            f"known in {100.0 * share:.0f} % of the record only, as fixes at the surface; masked",
        )


def _report_gaps(signal: Signal, report: RecordingReport) -> None:
    intervals = np.diff(signal.t)
    gaps = intervals > GAP * signal.step
    longest = float(intervals.max()) if gaps.any() else 0.0
    report.add("warning", signal.name, f"gaps in time, the longest {longest:.2f} s; masked", int(gaps.sum()))


def _actuators(signals: Mapping[str, Signal], t: Array, prefix: str) -> dict[str, Array]:
    return {
        name.removeprefix(prefix): held(signal, t)[:, 0]
        for name, signal in signals.items()
        if name.startswith(prefix)
    }


def _continuous(signals: Mapping[str, Signal], t: Array, prefix: str) -> dict[str, Array]:
    return {
        name.removeprefix(prefix): linear(signal, t)[0]
        for name, signal in signals.items()
        if name.startswith(prefix)
    }


def _scalar(signals: Mapping[str, Signal], t: Array, name: str) -> Array | None:
    return linear(signals[name], t)[0][:, 0] if name in signals else None


def _vector(signals: Mapping[str, Signal], t: Array, name: str, order: tuple[str, ...]) -> Array | None:
    """Vector (n, 3); a component that was not recorded is zero."""
    if name not in signals:
        return None
    result = np.zeros((len(t), 3))
    result[:, [order.index(channel) for channel in signals[name].channels]] = linear(signals[name], t)[0]
    return result


def _wrench(signals: Mapping[str, Signal], t: Array) -> Array | None:
    """Wrench (n, 6), held between samples as a command is; a component that was not recorded is zero."""
    given = [signals[name] for name in ("force", "moment") if name in signals]
    if not given:
        return None
    tau = np.zeros((len(t), 6))
    for signal in given:
        good = signal.good
        known = Signal(signal.name, signal.channels, signal.t[good], signal.y[good], signal.bad[good])
        tau[:, ["XYZKMN".index(channel) for channel in signal.channels]] = held(known, t)
    return tau
