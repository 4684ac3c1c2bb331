"""From signals to the arrays of a trial: one time base, derived motion, and the current.

Velocities and rates that no sensor gave are derived from the smoothed pose. A Doppler log that sees bottom
and water gives the current: at one instant ``v_c,n = R (v_ground - v_water)``; the lever arm cancels, since
both velocities come from the same instrument. A steady current is the median over the record; where the
medians of parts of it differ clearly, the current runs linearly between them. The model takes it as known
input of a trial (Fossen 2011, section 8.3); without it drag would be fitted to the speed over ground. Held by
``tests/trial/test_trial.py`` and ``tests/trial/test_water_current.py``.

Values and derivatives for restarts come from a smoothing spline of the samples that are not masked:
penalised least squares on the uniform base, ``min sum w (y - f)^2 + lambda sum (third difference of f)^2``
(Whittaker 1923; Eilers, Anal. Chem. 75 (2003) 3631), then the cubic spline through f. Without masks its
gain is ``1 / (1 + lambda (2 sin(omega h / 2))^6)``: a zero-phase low-pass. lambda is chosen by generalised
cross-validation with the effective degrees of freedom counted 1.4-fold, which guards against
under-smoothing (Kim and Gu, J. R. Stat. Soc. B 66 (2004) 337). Held by the ``test_law_`` functions of
``tests/trial/test_smoothing.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seatrial.base.arrays import Array, Mask
from seatrial.base.channels import CHANNELS
from seatrial.base.finding import Finding
from seatrial.base.frames import body_rates, matrix, to_euler
from seatrial.trial.signals import SETTINGS as RESAMPLING_SETTINGS
from seatrial.trial.signals import RecordingReport, Signal, angles, held, linear, silences

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline


@dataclass(frozen=True)
class AssemblySettings:
    """How a current is derived, which gaps and masks are reported, and how hard the pose is smoothed."""

    current_part_s: float = 60.0  #: s, parts of a record whose median currents are compared
    fewest_with_both_velocities: int = 50  #: samples; fewer tell no current
    steady_current_m_s: float = 0.02  #: m/s: parts that differ by less have one current
    certain_deviations: float = 4.0  #: deviations by which parts must differ for a current that changes
    #: m/s: no steady water is as uncertain after minutes of Doppler samples
    doubtful_current_m_s: float = 0.1
    #: good data have a few per cent masked, and a rule that masks more may be wrong
    reported_masked_share: float = 0.25
    samples_beside_gap: int = 20  #: on either side of a gap, that tell the speed across it
    #: usual ways between samples: a gap crossed by less may be a jump of the clock
    one_interval_ways: float = 5.0
    #: of the record in which a position from another sensor than the depth is known
    whole_record_share: float = 0.5
    most_silences_named: int = 5  #: silences of a command that a report lists
    stencil_rows: int = 2  #: a derivative is valid where so many samples on both sides are valid
    #: factor on the effective degrees of freedom, against under-smoothing
    cross_validation_caution: float = 1.4
    #: of a straight bridge over masked samples: it bounds the swing over a long gap
    bridge_weight: float = 1e-3
    shortest_cutoff_samples: float = 2.5  #: shortest cut-off period that is searched
    longest_cutoff_samples: float = 200.0  #: longest one: the equations of longer periods are ill-conditioned


SETTINGS = AssemblySettings()


@dataclass(frozen=True)
class WaterCurrent:
    """Current (n, 3) north, east, down in m/s at the times of the record, its deviation (3,), m/s.

    ``steady``: one median holds for the whole record.
    """

    current: Array
    deviation: Array
    steady: bool


def _add_current(
    parts: dict[str, object], t: Array, ground: Mask, water: Mask, report: RecordingReport
) -> None:
    """Fill ``parts["current"]`` from the velocities over ground and through water, in place, and report it.
    `ground` and `water` (n,) say where either velocity is valid.
    """
    nu, through, attitude = (np.asarray(parts[name]) for name in ("nu", "water", "attitude"))
    derived = water_current(t, nu[:, :3] - through, attitude, ground & water)
    if derived is None:
        report.info("current not derived", "current")
        return
    parts["current"] = derived.current
    note = report.warning if derived.deviation.max() > SETTINGS.doubtful_current_m_s else report.info
    mean = derived.current.mean(axis=0)
    note("current derived", "current", steady=derived.steady, mean=mean, sd=derived.deviation)


def water_current(t: Array, difference: Array, attitude: Array, known: Mask) -> WaterCurrent | None:
    """Current from body velocities over ground less those through water, (n, 3) in m/s; None if unclear.

    `t` (n,) are uniform times, s, `attitude` (n, 4) quaternions from body to NED; `known` (n,) says where the
    difference may be used.

    >>> t = np.arange(0.0, 100.0, 0.1)
    >>> upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    >>> found = water_current(t, np.tile([0.2, -0.1, 0.0], (len(t), 1)), upright, t >= 0.0)
    >>> found.current[0].round(3).tolist(), found.steady
    ([0.2, -0.1, 0.0], True)
    """
    index = np.flatnonzero(known)
    if len(index) < SETTINGS.fewest_with_both_velocities:
        return None
    earth = np.einsum("nij,nj->ni", matrix(attitude[index]), difference[index])
    count = max(2, round(float(t[-1] - t[0]) / SETTINGS.current_part_s))
    parts = np.array_split(
        np.arange(len(index)), min(count, len(index) // (SETTINGS.fewest_with_both_velocities // 2))
    )
    medians = np.array([np.median(earth[part], axis=0) for part in parts])
    centre = np.median(earth, axis=0)
    # The scatter of the parts' medians is the median's uncertainty, coloured noise included.
    deviation = medians.std(axis=0, ddof=1) / np.sqrt(len(medians))
    white = 1.2533 * np.median(np.abs(earth - centre), axis=0) / 0.6745 / np.sqrt(len(index))
    deviation = np.maximum(deviation, white)
    # Four quarters estimate a part's own deviation badly; pooled over the parts they estimate the common one.
    within = np.sqrt(np.mean([_sure(earth[part]) ** 2 for part in parts], axis=0))
    apart = np.abs(medians - centre)
    changing = (apart > SETTINGS.steady_current_m_s) & (apart > SETTINGS.certain_deviations * within)
    if not changing.any():
        return WaterCurrent(np.tile(centre, (len(t), 1)), deviation, True)
    middles = np.array([t[index[part]].mean() for part in parts])
    course = np.stack([np.interp(t, middles, medians[:, k]) for k in range(3)], axis=1)
    return WaterCurrent(course, within, False)


def _sure(samples: Array) -> Array:
    """Deviation (3,) of the median of samples (m, 3), from the medians of their quarters."""
    quarters = np.array([np.median(part, axis=0) for part in np.array_split(samples, 4)])
    return np.asarray(quarters.std(axis=0, ddof=1) / 2.0)


def assemble(signals: Mapping[str, Signal], t: Array, report: RecordingReport) -> dict[str, Any]:
    """Arrays of a `seatrial.trial.trial.Trial` by the names of its fields, at the uniform times `t` (n,)."""
    observed = np.full((len(t), 12), np.nan)
    filled = np.zeros((len(t), 9))
    valid = np.zeros((len(t), 12), bool)
    # Vectors are linear between their samples; what is far from any is filled, and not valid.
    for name in ("position", "depth", "velocity", "rates"):
        if name in signals:
            _report_gaps(signals[name], report)
            columns = [CHANNELS.index(channel) for channel in signals[name].channels]
            filled[:, columns], valid[:, columns] = linear(signals[name], t)
            observed[:, columns] = filled[:, columns]
    _only_fixes(signals, valid, report)
    # An attitude turns: it is interpolated as a quaternion. What no sensor of velocity or rates gave follows
    # from the pose.
    if "attitude" in signals:
        _report_gaps(signals["attitude"], report)
        attitude, good = angles(signals["attitude"], t)
        columns = [CHANNELS.index(channel) for channel in signals["attitude"].channels]
        observed[:, columns] = to_euler(attitude)[:, [k - 9 for k in columns]]
        valid[:, columns] = good[:, [k - 9 for k in columns]]
        turned = np.logical_and.reduce(valid[:, columns], axis=1)
        _derive(observed, valid, filled, attitude, turned, t, report)
    else:
        attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    # Where the command in force is unknown, nothing may be compared with a simulation.
    silent = _silent(signals, t, report)
    valid[silent] = False
    for k in range(12):
        observed[~np.isfinite(observed[:, k]), k] = np.nan
    absent = np.logical_and.reduce(np.isnan(observed), axis=0)
    # The report tells of the common time base, and which channels are masked or missing in it.
    report.samples, report.duration_s = len(t), float(t[-1] - t[0])
    report.rate_hz = (len(t) - 1) / report.duration_s
    report.masked = {
        channel: int((~valid[:, k]).sum()) for k, channel in enumerate(CHANNELS) if not absent[k]
    }
    _report_masked(report)
    if absent.any():
        missing = [channel for channel, gone in zip(CHANNELS, absent, strict=True) if gone]
        report.info("not recorded", "channels", channels=missing)
    parts = {
        "observed": observed,
        "valid": valid,
        "position": filled[:, 6:9],
        "attitude": attitude,
        "nu": filled[:, :6],
        "commands": {
            n.removeprefix("cmd."): held(signals[n], t)[:, 0] for n in signals if n.startswith("cmd.")
        },
        "silent": silent if silent.any() else None,
        "measured": {
            n.removeprefix("meas."): linear(signals[n], t)[0][:, 0] for n in signals if n.startswith("meas.")
        },
        "tau": _wrench(signals, t),
        "voltage_v": linear(signals["voltage"], t)[0][:, 0] if "voltage" in signals else None,
        "current": _vector(signals, t, "current", ("north", "east", "down")),
        "water": _vector(signals, t, "water velocity", ("u_water", "v_water", "w_water")),
    }
    # One Doppler log that sees bottom and water gives the current, unless one was recorded.
    if "water velocity" in signals and "current" not in signals and "velocity" in signals:
        known = [linear(signals[name], t)[1] for name in ("velocity", "water velocity")]
        whole = [k.shape[1] == 3 for k in known]
        if all(whole) and "attitude" in signals:
            ground, water = (np.logical_and.reduce(k, axis=1) for k in known)
            upright = np.logical_and.reduce(valid[:, 9:], axis=1)
            _add_current(parts, t, np.asarray(ground & upright), np.asarray(water), report)
    return parts


def _report_masked(report: RecordingReport) -> None:
    """Report channels that are masked in more than a quarter of the record, with the largest cause."""
    lost: list[tuple[Finding | None, list[str]]] = []
    for channel, count in report.masked.items():
        if count > SETTINGS.reported_masked_share * report.samples:
            cause = _cause(channel, report)
            same = next((channels for other, channels in lost if other is cause), None)
            if same is None:
                lost.append((cause, [channel]))
            else:
                same.append(channel)
    for cause, channels in lost:
        share = max(report.masked[channel] for channel in channels) / report.samples
        report.warning("mostly masked", " ".join(channels), cause=cause, share=share)


_GROUP_OF = {c: name for name, cs in (("position", "xyz"), ("velocity", "uvw"), ("rates", "pqr")) for c in cs}
_GROUP_OF |= dict.fromkeys(("roll", "pitch", "yaw"), "attitude")


_MASKING = frozenset((
    "clock jumped", "codes", "frozen", "gaps in time", "jumps", "no unit quaternion", "not finite",
    "rows repeated", "spikes", "uncommanded", "zeros",
))  # fmt: skip
"""Kinds of findings that mask samples."""


def _cause(channel: str, report: RecordingReport) -> Finding | None:
    """The finding that masks most samples of a channel; None where none does."""
    group = _GROUP_OF[channel]
    columns = {f"{channel}_{unit}" for unit in ("m", "m_s", "deg", "deg_s")}
    own = {channel, group, "log", "commands", *columns}
    own |= {"depth"} if channel == "z" else set()
    # Of derived channels the pose is masked.
    own |= {"attitude", "position", "depth"} if group in ("velocity", "rates") else set()
    masking = [
        finding
        for finding in report.findings
        if finding.kind in _MASKING and finding.subject in own and not finding.values.get("held")
    ]
    return max(masking, key=lambda finding: finding.count or 0, default=None)


def _derive(
    observed: Array,
    valid: Mask,
    filled: Array,
    attitude: Array,
    turned: Mask,
    t: Array,
    report: RecordingReport,
) -> None:
    """Fill velocities and rates that no sensor gave from the smoothed pose, in place. `turned` (n,): where
    the whole recorded attitude is known.
    """
    from scipy.ndimage import minimum_filter1d

    absent = np.logical_and.reduce(np.isnan(observed[:, :6]), axis=0)
    if not absent.any():
        return
    placed = np.logical_and.reduce(valid[:, 6:9], axis=1)
    curve = spline(t, attitude, turned)
    q = curve(t)
    size = np.linalg.norm(q, axis=1)[:, None]
    derived = {
        "rates": (3, body_rates(q / size, curve(t, 1) / size), turned, ("attitude",)),
        "velocity": (0, np.zeros((len(t), 3)), turned & placed, ("position", "attitude")),
    }
    if placed.any() and absent[:3].any():
        path = spline(t, filled[:, 6:9], placed)
        v = np.einsum("nji,nj->ni", matrix(q / size), path(t, 1))
        derived["velocity"] = (0, v, turned & placed, ("position", "attitude"))
    for first, motion, known, origin in derived.values():
        missing = [k for k in range(3) if absent[first + k]]
        if not missing or not known.any():
            continue
        window = 2 * SETTINGS.stencil_rows + 1
        good = np.asarray(minimum_filter1d(known.astype(np.uint8), window, mode="nearest")).astype(bool)
        columns = [first + k for k in missing]
        observed[:, columns] = filled[:, columns] = motion[:, missing]
        valid[:, columns] = good[:, None]
        names = " ".join(CHANNELS[k] for k in columns)
        report.info("derived", names, origin=origin)


def _only_fixes(signals: Mapping[str, Signal], valid: Mask, report: RecordingReport) -> None:
    """Mask a horizontal position that is known in less than half of the record, in place: segments start
    where it is known, and with fixes at the surface alone none could start below.
    """
    position = signals.get("position")
    if position is None or "z" in position.channels:
        return
    columns = [CHANNELS.index(channel) for channel in position.channels]
    share = float(valid[:, columns].any(axis=1).mean())
    if 0.0 < share < SETTINGS.whole_record_share:
        valid[:, columns] = False
        report.warning("only fixes", " ".join(position.channels), share=share)


def _report_gaps(signal: Signal, report: RecordingReport) -> None:
    intervals = np.diff(signal.t)
    gaps = intervals > RESAMPLING_SETTINGS.gap_intervals * signal.interval
    longest = float(intervals.max()) if gaps.any() else 0.0
    jumped = gaps.any() and _goes_on(signal, int(intervals.argmax()))
    kind = "clock jumped" if jumped else "gaps in time"
    report.warning(kind, signal.label, count=int(gaps.sum()), longest_s=longest)


def _goes_on(signal: Signal, at: int) -> bool:
    """Whether a pose goes on across the gap after a sample as if no time had passed, while under way."""
    if signal.name not in ("position", "attitude"):
        return False
    good = signal.good
    sides = [
        np.flatnonzero(good[: at + 1])[-SETTINGS.samples_beside_gap :],
        at + 1 + np.flatnonzero(good[at + 1 :])[: SETTINGS.samples_beside_gap],
    ]
    if min(map(len, sides)) < SETTINGS.samples_beside_gap:
        return False
    steps = [np.linalg.norm(np.diff(signal.y[side], axis=0), axis=1) for side in sides]
    ways = [float(np.linalg.norm(signal.y[side[-1]] - signal.y[side[0]])) for side in sides]
    speed = min(way / (signal.t[side[-1]] - signal.t[side[0]]) for way, side in zip(ways, sides, strict=True))
    usual = float(np.median(np.concatenate(steps)))
    across = float(np.linalg.norm(signal.y[sides[1][0]] - signal.y[sides[0][-1]]))
    # A vehicle at rest, or noise alone, has no way to go on.
    under_way = min(ways) > SETTINGS.one_interval_ways * usual
    lost = speed * (signal.t[sides[1][0]] - signal.t[sides[0][-1]])
    return (
        under_way
        and across < SETTINGS.one_interval_ways * usual
        and lost > 2.0 * SETTINGS.one_interval_ways * usual
    )


def _silent(signals: Mapping[str, Signal], t: Array, report: RecordingReport) -> Mask:
    """Times (n,) at which the command in force is unknown, because its stream is silent; reports them."""
    streams: dict[bytes, list[Signal]] = {}
    for name, signal in signals.items():
        if name.startswith("cmd."):
            streams.setdefault(signal.t.tobytes(), []).append(signal)
    silent = np.zeros(len(t), bool)
    for stream in streams.values():
        stamps = stream[0].t
        spans = silences(stamps, np.concatenate([signal.y for signal in stream], axis=1), t)
        if not spans:
            continue
        usual = float(np.median(np.diff(stamps)))
        for start, end in spans:
            # The last command acts for its usual time; before the first one, none is known.
            first = start if start <= t[0] else start + usual
            silent |= (t >= first) & ((t < end) | (end >= t[-1]))
        longest = sorted(sorted(spans, key=lambda span: span[0] - span[1])[: SETTINGS.most_silences_named])
        report.warning(
            "uncommanded",
            "commands",
            actuators=[signal.name.removeprefix("cmd.") for signal in stream],
            longest=longest,
            shorter=len(spans) - len(longest),
            usual_s=usual,
        )
    return silent


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


def smooth(y: Array, valid: Mask) -> Array:
    """Smoothed columns (n, k) of uniform samples of one vector (a velocity, a quaternion), `valid` (n,): all
    get the same low-pass, scaled by their common noise.
    """
    from scipy.linalg import solveh_banded

    n = len(y)
    good = np.flatnonzero(valid)
    if len(good) < 5 or np.ptp(y[good], axis=0).max() == 0.0:
        return _bridged(y, good)
    # Masked samples get a weak straight bridge, so that the spline does not swing over a gap.
    filled = _bridged(y, good)
    weight = np.where(valid, 1.0, SETTINGS.bridge_weight)
    penalty = _penalty_bands(n)
    frequency = (2.0 * np.sin(0.5 * np.pi * np.arange(n) / n)) ** 6

    def solve(strength: float) -> tuple[float, Array]:
        bands = strength * penalty
        bands[-1] += weight
        f: Array = solveh_banded(bands, weight[:, None] * filled, check_finite=False)
        # Trace of the smoother from its gain at the frequencies of the uniform base, instead of an inverse.
        freedom = SETTINGS.cross_validation_caution * np.sum(1.0 / (1.0 + strength * frequency)) / n
        residual = np.mean((y[good] - f[good]) ** 2)
        return (float(residual / (1.0 - freedom) ** 2) if freedom < 1.0 else np.inf), f

    periods = np.geomspace(SETTINGS.shortest_cutoff_samples, SETTINGS.longest_cutoff_samples, 24)
    strengths = (2.0 * np.sin(np.pi / periods)) ** -6.0
    return min((solve(strength) for strength in strengths), key=lambda result: result[0])[1]


def spline(t: Array, y: Array, valid: Mask) -> CubicSpline:
    """Cubic spline through the smoothed columns of `y` (n, k) over the uniform times `t` (n,)."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, smooth(y, valid), axis=0)


def _bridged(y: Array, good: NDArray[np.intp]) -> Array:
    """Samples with straight bridges over what is not good, constant at the ends, zero where nothing is."""
    if len(good) == 0:
        return np.zeros_like(y)
    index = np.arange(len(y))
    return np.stack([np.interp(index, good, y[good, k]) for k in range(y.shape[1])], axis=1)


def _penalty_bands(n: int) -> Array:
    """Upper bands (4, n) of D'D, D the third difference, as `scipy.linalg.solveh_banded` wants them."""
    difference = np.array([-1.0, 3.0, -3.0, 1.0])
    bands = np.zeros((4, n))
    for i in range(4):
        for j in range(i, 4):
            # D'D[r + i, r + j] collects the product of the two entries from each row r of D.
            bands[3 - (j - i), j : n - 3 + j] += difference[i] * difference[j]
    return bands
