"""Gains of the linear-quadratic regulator with integral action, per mode and breakpoint, and their file.

The linear motion about a trim is sampled behind lag and dead time of the actuators (`loops`); the cost is

    J = sum (x_i / tolerated_i)^2 + sum (tau_j / (share tau_max_j))^2

over deviations, integrals and wrench. The regulator K of that plant would feed back the actuators' lags
and past demands, too, which nobody measures. The static gain of what is measured, C x, that comes closest
to it in the mean square is ``K P C' (C P C')^-1``, with P the covariance of all motions of the regulated
plant that begin with tolerated deviations.

The margins of every row then count on the whole plant: while the phase margin is below 40 deg or
|1/(1 + L)| above 2, that row of the wrench is made dearer and the gain designed again, so that lag and
dead time lower the bandwidth instead of eating the margin. A hull that falls over by itself may have no
such gain; it gets the best of smaller margins (`margin_targets`), or none.

In the autopilot file the regulator takes the place of the PID loops: everything else stays as written,
comments included.

Source: Anderson and Moore, *Optimal Control* (1990), chapters 2 and 3; Bryson and Ho (1975), section 5.2;
Kosut, IEEE Transactions on Automatic Control 15 (1970), 557-563 (static gain of minimum error
excitation). Held by tests/control_design/test_control_design_lqr.py.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial.base.arrays import Array
from seatrial.control_design.loops import (
    LOOP_OF,
    STATES,
    Sampled,
    level,
    plant,
    restoring_law,
    rows_of,
    sampled,
    trim,
    with_law,
)
from seatrial.control_design.margins import LawMargins, law_margins, least_margins
from seatrial.control_design.operating_points import at_work
from seatrial.vehicle.actuators import LOOPS, ROWS, delays, reach

if TYPE_CHECKING:
    from seatrial._core import Vehicle


@dataclass(frozen=True)
class LqrSettings:
    """What a regulator is designed for, and the margins that it must have."""

    #: Motion that is designed for, m/s and rad/s: over a smaller one no gain holds REMUS with the margins.
    design_motion_m_s: float = 0.05
    #: Phase margin in deg and largest |1/(1 + L)|, from the best; less than the last is refused.
    margin_targets: tuple[tuple[float, float], tuple[float, float], tuple[float, float]] = (
        (40.0, 2.0),
        (35.0, 2.2),
        (30.0, 2.5),
    )
    dearness_factor: float = 1.4  #: Factor by which a row with too small margins becomes dearer in a round.
    design_rounds: int = 14  #: Rounds of the design: a row becomes at most 1.4^14, a factor of 111, dearer.


SETTINGS = LqrSettings()


@dataclass(frozen=True)
class Tolerances:
    """Deviations that weigh alike (Bryson's rule), and share of tau_max that weighs the same.

    An integral weighs like its deviation, held for ``integral_s``.
    """

    depth_m: float = 1.0
    roll_deg: float = 15.0
    pitch_deg: float = 10.0
    heading_deg: float = 15.0
    surge_m_s: float = 0.3
    sway_m_s: float = 0.3
    heave_m_s: float = 0.3
    rate_deg_s: float = 10.0
    integral_s: float = 15.0
    wrench_share: float = 0.5

    def of_states(self) -> Array:
        """Tolerated values (15,) of the states in SI."""
        degrees = [self.roll_deg, self.pitch_deg, self.heading_deg, self.rate_deg_s]
        roll, pitch, heading, rate = np.deg2rad(degrees)
        speeds = [self.surge_m_s, self.sway_m_s, self.heave_m_s]
        integrated = [*speeds[:2], self.depth_m, pitch, heading]
        plain = [self.depth_m, roll, pitch, heading, *speeds, rate, rate, rate]
        return np.array(plain + [self.integral_s * x for x in integrated])


@dataclass(frozen=True)
class LqrGains:
    """Gains of one mode: gain (points, 6, 15) and margins per point.

    ``dearness``: by how much less wrench was tolerated for the margins, per point and row; ``trimmed``:
    whether there was a trim, else the gain is of level motion. Where no gain holds the motion with a margin,
    that of the nearest speed is ``borrowed``; the margins tell what it does.
    """

    mode: str
    loops: tuple[str, ...]
    speeds_m_s: tuple[float, ...]
    gain: Array
    margins: tuple[LawMargins, ...]
    dearness: tuple[tuple[float, ...], ...]
    trimmed: tuple[bool, ...]
    borrowed: tuple[bool, ...]


def design_lqr(
    vehicle: Vehicle,
    speeds_m_s: Sequence[float],
    modes: Mapping[str, Sequence[str]],
    *,
    actuators: Mapping[str, Sequence[str]] | None = None,
    tau_max: Mapping[str, float] | None = None,
    tolerances: Tolerances | None = None,
    restoring: bool = True,
    period_s: float = 0.1,
) -> dict[str, LqrGains]:
    """Gains of the regulator per mode, at the breakpoints.

    Parameters
    ----------
    vehicle : Vehicle
    speeds_m_s : sequence of float
        Supporting speeds, m/s.
    modes : {name: loops}
        Names of the loops at work in each mode: surge, sway, heave, roll, pitch, heading.
    actuators : {name: names}
        Those at work in a mode; all where it is missing.
    tau_max : {loop: float}
        Largest demand per loop, N or N m; by default half of what the actuators reach at the fastest speed.
    tolerances : Tolerances
        Weights of the cost in physical units.
    restoring : bool
        Whether the autopilot feeds weight and buoyancy forward at the measured attitude.
    period_s : float
        Control period, s.

    Raises
    ------
    ValueError
        A mode with an unknown loop or one without reach, or one that no gain makes stable at any speed.

    Examples
    --------
    >>> import seatrial as st
    >>> modes = {"cruise": ["surge", "pitch", "heading"]}
    >>> gains = design_lqr(st.Vehicle.load("cwolf"), [1.0, 2.0], modes)["cruise"]
    >>> gains.gain.shape, all(m.stable and m.phase_deg > 40.0 for m in gains.margins)
    ((2, 6, 15), True)
    """
    chosen = tolerances or Tolerances()
    designs = {}
    for name, wanted in modes.items():
        unknown = [loop for loop in wanted if loop not in LOOPS]
        if unknown or not wanted:
            raise ValueError(
                f"modes[{name!r}]: expected names among {', '.join(LOOPS)}, found {list(wanted)}"
            )
        loops = tuple(loop for loop in LOOPS if loop in wanted)
        rows = rows_of(loops)
        late = delays(vehicle, rows)
        limits = _limits(vehicle, max(speeds_m_s, key=abs), rows, tau_max)
        known = restoring_law(vehicle, rows) if restoring else np.zeros((6, len(STATES)))
        systems, trimmed = [], []
        working = tuple(actuators[name]) if actuators and name in actuators else None
        for u in speeds_m_s:
            flight = trim(vehicle, u, rows, working)
            # Without straight level motion at a speed the design is made about the level hull.
            about = flight or level(u, rows, working)
            systems.append(
                sampled(
                    plant(vehicle, about, loops, motion=SETTINGS.design_motion_m_s), late, period_s, loops
                )
            )
            trimmed.append(flight is not None)
        # A speed without a sound gain is no failure as long as another speed has one.
        results: dict[int, tuple[Array, LawMargins, tuple[float, ...]]] = {}
        refusals = []
        for k, system in enumerate(systems):
            try:
                results[k] = _safe_gain(system, known, (chosen, limits))
            except (np.linalg.LinAlgError, ValueError) as error:
                refusals.append(f"{speeds_m_s[k]:g} m/s: {error}")
        if not results:
            raise ValueError(
                f"modes[{name!r}]: no gain makes the motion stable with a margin ({'; '.join(refusals)});"
                " choose other speeds, or control more loops"
            )
        # Such a speed borrows the gain of the nearest speed that has one.
        designed = list(results)
        distance = np.abs(np.subtract.outer(np.array(speeds_m_s), np.array(speeds_m_s)[designed]))
        own = [designed[int(j)] for j in distance.argmin(axis=1)]
        designs[name] = LqrGains(
            mode=name,
            loops=loops,
            speeds_m_s=tuple(speeds_m_s),
            gain=np.stack([results[j][0] for j in own]),
            margins=tuple(
                least_margins(of, results[j][0] + known) for of, j in zip(systems, own, strict=True)
            ),
            dearness=tuple(results[j][2] for j in own),
            trimmed=tuple(trimmed),
            borrowed=tuple(j != k for k, j in enumerate(own)),
        )
    return designs


def lqr_tables(gains: Mapping[str, LqrGains], *, tracking_s: float = 5.0) -> list[dict[str, Any]]:
    """The tables [[lqr]] of the autopilot file, one for each mode, with five digits."""
    return [
        {
            "mode": name,
            "tracking_s": tracking_s,
            "gain": [[[float(f"{x:.5g}") for x in row] for row in point] for point in _of_rates(of_mode)],
        }
        for name, of_mode in gains.items()
    ]


def _of_rates(gains: LqrGains) -> Array:
    """Gain (points, 6, 15) as the autopilot uses it: where heave is held, w stands for the rate of the depth
    ``w - u pitch``, so that the rest of what the gain makes of w goes to the pitch.
    """
    rate_gain = gains.gain.copy()
    if "heave" in gains.loops:
        rate_gain[:, :, 2] += np.array(gains.speeds_m_s)[:, None] * rate_gain[:, :, 6]
    return rate_gain


def _safe_gain(
    system: Sampled, known: Array, weights: tuple[Tolerances, Array]
) -> tuple[Array, LawMargins, tuple[float, ...]]:
    """Gain (6, 15) with the margins asked for, the margins, and how dear each row had to be; ``known`` is the
    feed-forward as a law. Where no dearness brings the margins, as of a hull that falls over, smaller ones
    must do.
    """
    tolerances, limits = weights
    fed = with_law(system, known)
    tried, dearness = [], np.ones(len(limits))
    for _ in range(SETTINGS.design_rounds):
        gain = _gain(fed, tolerances, limits * tolerances.wrench_share / dearness)
        reached = least_margins(system, gain + known)
        tried.append((gain, reached, tuple(map(float, dearness))))
        if _holds(reached, SETTINGS.margin_targets[0]):
            break
        rows = law_margins(system, gain + known).values()
        short = np.array([not _holds(row, SETTINGS.margin_targets[0]) for row in rows])
        dearness = dearness * np.where(short, SETTINGS.dearness_factor, 1.0)
    for target in SETTINGS.margin_targets:
        for design in tried:
            if _holds(design[1], target):
                return design
    most = max((of.phase_deg for _, of, _ in tried if of.stable), default=None)
    raise ValueError("none is stable" if most is None else f"phase margin {most:.0f} deg at most")


def _holds(reached: LawMargins, target: tuple[float, float]) -> bool:
    phase, sensitivity = target
    return reached.stable and reached.phase_deg >= phase and reached.sensitivity <= sensitivity


def _gain(system: Sampled, tolerances: Tolerances, wrench: Array) -> Array:
    """Static gain (6, 15) of the regulator for these tolerances and tolerated wrench (rows,)."""
    from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

    size = len(system.phi)
    pairs = [
        pair for pair in zip(system.columns, system.seen, strict=True) if pair[0] not in _drifting(system)
    ]
    columns, seen = [column for column, _ in pairs], [place for _, place in pairs]
    tolerated = tolerances.of_states()[columns]
    weight = np.zeros(size)
    weight[seen] = tolerated**-2.0
    cost = np.diag(wrench**-2.0)
    p = solve_discrete_are(system.phi, system.gamma, np.diag(weight), cost)
    full = np.linalg.solve(cost + system.gamma.T @ p @ system.gamma, system.gamma.T @ p @ system.phi)
    # Motions from tolerated deviations, uncorrelated, under the full gain.
    begin = np.zeros(size)
    begin[seen] = tolerated**2.0
    motion = solve_discrete_lyapunov(system.phi - system.gamma @ full, np.diag(begin))
    static = np.linalg.solve(motion[np.ix_(seen, seen)].T, (full @ motion[:, seen]).T).T
    gain = np.zeros((6, len(STATES)))
    gain[np.ix_([ROWS.index(row) for row in system.rows], columns)] = static
    return gain


def _drifting(system: Sampled) -> tuple[int, ...]:
    """Columns that a current moves although nothing is amiss: sway and heave over ground that no loop
    holds.
    """
    return tuple(column for column, row in ((5, "Y"), (6, "Z")) if row not in system.rows)


def _limits(vehicle: Vehicle, fastest: float, rows: str, tau_max: Mapping[str, float] | None) -> Array:
    """Largest demand (rows,) in N or N m."""
    if tau_max is not None:
        loops = [LOOP_OF[row] for row in rows]
        if missing := [loop for loop in loops if loop not in tau_max]:
            raise ValueError(
                f"tau_max: expected a largest demand for {', '.join(missing)}, found none; add it"
            )
        return np.array([tau_max[loop] for loop in loops])
    sizes = {row: np.abs(limit) for row, limit in reach(vehicle, fastest, rows).items()}
    reached = {row: 0.5 * float(size.max() if row == "X" else size.min()) for row, size in sizes.items()}
    idle = [row for row, limit in reached.items() if limit < 1e-6]
    if idle:
        raise ValueError(
            f"modes: expected rows with a reach, found {', '.join(idle)} without; leave them out"
        )
    return np.array([reached[row] for row in rows])


def lqr_autopilot(
    vehicle: Vehicle, text: str, *, tolerances: Tolerances | None = None, tracking_s: float = 5.0
) -> str:
    """TOML text of an autopilot file with `control = "lqr"` and its gains, from one with PID loops.

    Parameters
    ----------
    vehicle : Vehicle
        The autopilot's model of the vehicle.
    text : str
        TOML text of an autopilot file.
    tolerances : Tolerances
        Weights of the cost in physical units.
    tracking_s : float
        Time constant of the anti-windup, s.

    Raises
    ------
    ValueError
        The file has gains of a regulator already, or a mode that no gain makes stable.

    Examples
    --------
    >>> import seatrial as st
    >>> lauv = st.Vehicle.load("lauv")
    >>> autopilot = st.Autopilot.from_toml(lqr_autopilot(lauv, st.start_autopilot(lauv)))
    >>> 'control = "lqr"' in autopilot.to_toml()
    True
    """
    import tomlkit

    from seatrial._core import Autopilot

    autopilot = Autopilot.from_toml(text)
    if "lqr" in autopilot.to_dict():
        raise ValueError(
            "lqr: expected an autopilot file without gains of a regulator, found some; remove [[lqr]]"
        )
    gains = design_lqr(
        vehicle,
        autopilot.speeds_m_s,
        {mode["name"]: mode["loop_names"] for mode in autopilot.modes},
        actuators={
            mode["name"]: at_work(vehicle, mode["actuators"]) or ()
            for mode in autopilot.modes
            if mode["actuators"] is not None
        },
        tau_max={name: loop["tau_max"] for name, loop in autopilot.loops().items()},
        tolerances=tolerances,
        restoring=autopilot.feed_forward()["restoring"],
        period_s=autopilot.period_s,
    )
    # The text stays as it was written, comments included: one key changes, and the gains are put behind.
    switched, replaced = re.subn(r"(?m)^control\s*=.*$", 'control = "lqr"', text, count=1)
    if not replaced:
        switched = re.sub(r"(?m)^period_s", 'control = "lqr"\nperiod_s', text, count=1)
    tables = tomlkit.dumps({"lqr": lqr_tables(gains, tracking_s=tracking_s)})
    return f"{switched.rstrip()}\n\n{tables}"
