"""Fisher information of a manoeuvre about the sought coefficients, and what is known before it.

The manoeuvre is simulated and cut into segments, each restarted from the simulated state. Rows are readings
of the instruments in standard deviations of their noise; columns are exact derivatives (dual numbers). The
initial conditions of each segment are unknown, with the priors that they have in the joint estimate, and
eliminated;
an unknown steady current is eliminated once per run (Schur complement). Errors of a model repeat from sample
to sample, so that only one sample per correlation time counts.

A bound is weak prior knowledge: a uniform distribution between the bounds has the standard deviation of their
distance over the square root of twelve. Recorded trials of a campaign add their information, one sample per
correlation time, nuisance parameters eliminated.

Held by ``tests/experiment/test_plan.py``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from seatrial._core import OpenLoop, Record, initial_names
from seatrial.base.arrays import Array
from seatrial.base.channels import CHANNELS, DEGREE
from seatrial.base.errors import CampaignError, SimulationError, nearest
from seatrial.estimation.joint import JOINT_PRIOR_SETTINGS
from seatrial.estimation.segment_model import stage_step
from seatrial.experiment.forecast import simulated
from seatrial.problem.parameter import Parameter, coefficient_names, expansion_matrix
from seatrial.problem.parameter import parameters as parsed
from seatrial.problem.settings import Axes, Coefficient, Stage
from seatrial.sensors.sensor import KINDS
from seatrial.statistics.blocks import variance_inflation
from seatrial.statistics.linearisation import eliminate
from seatrial.vehicle.actuators import NOMINAL_V, voltage_for

if TYPE_CHECKING:
    from seatrial._core import Run, Vehicle
    from seatrial.experiment.manoeuvre import Manoeuvre
    from seatrial.problem.problem import Problem
    from seatrial.statistics.linearisation import Linearisation

NOISE = {"dvl": 0.01, "gyro": 0.2, "attitude": 0.5, "depth": 0.02}
"""Instruments and the standard deviation of their noise, m/s, deg/s, deg and m, unless others are given."""

_OF_KIND = {
    "dvl": ("u", "v", "w"),
    "gyro": ("p", "q", "r"),
    "attitude": ("roll", "pitch", "yaw"),
    "depth": ("z",),
    "position": ("x", "y"),
}

_CURRENTS = ("current_north", "current_east")


@dataclass(frozen=True)
class Instruments:
    """What is measured and how well: standard deviation of the noise per channel in SI."""

    noise: Mapping[str, float]
    #: Time over which residuals repeat one another, s: one sample in that time counts.
    correlation_s: float = 1.0
    segment_s: float = 20.0  #: Length of the segments, s.
    #: Standard deviation of an unknown steady current, north and east, m/s; 0 if there is none.
    current_m_s: float = 0.1

    def __post_init__(self) -> None:
        for channel, value in self.noise.items():
            if channel not in CHANNELS:
                raise CampaignError(f"noise: {channel!r} is no channel{nearest(channel, CHANNELS)}")
            if not (np.isfinite(value) and value > 0.0):
                raise CampaignError(f"noise of {channel!r}: expected a positive number, found {value:g}")
        if not self.noise:
            raise CampaignError("nothing is measured; give at least one instrument")
        for name, least in (("correlation_s", 0.0), ("segment_s", 1.0)):
            if not getattr(self, name) > least:
                raise CampaignError(f"{name}: expected more than {least:g}, found {getattr(self, name):g}")
        if not self.current_m_s >= 0.0:
            raise CampaignError(f"current_m_s: expected zero or more, found {self.current_m_s:g}")

    @classmethod
    def on_board(cls, kinds: Mapping[str, float | None] | None = None, **further: float) -> Instruments:
        """Instruments by kind, each with its noise in its own unit, m/s, deg/s, deg, m; None: the usual.

        `kinds` are of `seatrial.sensors.sensor.KINDS`, by default those of `NOISE`; `further` are attributes.
        Raises CampaignError where a kind is unknown or a noise is not positive.

        Examples
        --------
        >>> Instruments.on_board({"gyro": 0.1}).noise["p"]
        0.0017
        """
        usual = NOISE | {"position": 0.5}  # m, where none is given
        noise: dict[str, float] = {}
        for kind, value in (NOISE if kinds is None else kinds).items():
            if kind not in _OF_KIND:
                raise CampaignError(f"instruments: unknown kind {kind!r}{nearest(kind, _OF_KIND)}")
            size = usual[kind] if value is None else float(value)
            factor = DEGREE if KINDS[kind].unit.startswith("deg") else 1.0
            noise |= dict.fromkeys(_OF_KIND[kind], factor * size)
        return cls(noise, **further)


def information(
    vehicle: Vehicle,
    manoeuvre: Manoeuvre,
    parameters: Sequence[Parameter],
    instruments: Instruments,
    *,
    voltage_v: float = NOMINAL_V,
    threads: int | None = None,
) -> Array:
    """Information (m, m) that one run of a manoeuvre adds about the parameters, one over their units squared.

    The derivatives are taken at the vehicle's coefficients, with tables of thrust read at `voltage_v`. The
    result does not depend on the number of threads.
    """
    run = simulated(vehicle, manoeuvre, voltage_v=voltage_v)
    if not (np.isfinite(run.nu).all() and np.isfinite(run.position).all()):
        raise SimulationError(
            f"{manoeuvre.name}: the simulation diverges; reduce the commands or check the vehicle's masses"
        )
    channels = [channel for channel in CHANNELS if channel in instruments.noise]
    currents = _CURRENTS if instruments.current_m_s > 0.0 else ()
    names, initials, values = coefficient_names(parameters), _initial_sd(instruments), vehicle.coefficients()
    supply = voltage_for(vehicle, manoeuvre.t, voltage_v)
    # As many steps per sample as the fastest motion needs.
    speeds = np.abs(np.asarray(run.nu)).max(axis=0)
    loop = OpenLoop(
        vehicle,
        [Record(manoeuvre.t, dict(manoeuvre.commands), voltage_v=supply)],
        _segments(run, manoeuvre, instruments),
        names=names,
        substeps=stage_step(vehicle, (), free="XYZKMN", speeds=speeds, dt=manoeuvre.dt).substeps,
    )
    shown = loop.sensitivities(
        [values.get(name, 0.0) for name in names],
        expansion_matrix(parameters),
        nuisances=currents,
        initials=list(initials),
        channels=channels,
        threads=threads,
    )
    size, share = len(parameters), min(manoeuvre.dt / instruments.correlation_s, 1.0)
    total = np.zeros((size + len(currents), size + len(currents)))
    for rows, slopes in shown:
        # The first sample of a segment is its initial condition and adds nothing.
        weighted = slopes / _noise(rows, channels, instruments)[:, :, None]
        flat = weighted[1:].reshape(-1, weighted.shape[2])
        sought, own = flat[:, : total.shape[0]], flat[:, total.shape[0] :] * list(initials.values())
        both = share * own.T @ sought
        known = np.eye(own.shape[1]) + share * own.T @ own
        total += share * sought.T @ sought - both.T @ np.linalg.solve(known, both)
    if not currents:
        return total
    # The current is a nuisance with a prior; the Schur complement leaves the parameters' own information.
    total[size:, size:] += np.eye(len(currents)) * instruments.current_m_s**-2.0
    return eliminate(total, range(size), range(size, size + len(currents)))


def _segments(
    run: Run, manoeuvre: Manoeuvre, instruments: Instruments
) -> list[tuple[int, int, int, Array, Array, Array]]:
    """Segments of about the same length, each with the simulated state at its start."""
    last = len(manoeuvre.t) - 1
    count = max(round(manoeuvre.duration_s / instruments.segment_s), 1)
    edges = np.round(np.linspace(0, last, count + 1)).astype(int)
    position, attitude, nu = (np.asarray(part) for part in (run.position, run.attitude, run.nu))
    return [
        (0, int(first), int(end) + 1, position[first], attitude[first], nu[first])
        for first, end in pairwise(edges)
        if end > first
    ]


def _noise(rows: Array, channels: Sequence[str], instruments: Instruments) -> Array:
    """Standard deviation (n, C): that of roll and yaw grows with the trim, near 90 deg without bound."""
    noise = np.tile([instruments.noise[channel] for channel in channels], (len(rows), 1))
    upright = np.maximum(np.abs(np.cos(rows[:, CHANNELS.index("pitch")])), 1e-3)
    for column, channel in enumerate(channels):
        if channel in ("roll", "yaw"):
            noise[:, column] /= upright
    return noise


def _initial_sd(instruments: Instruments) -> dict[str, float]:
    """Prior standard deviations of a segment's initial conditions, as the joint estimate has them, SI.

    Those of axes that nothing measures are not estimated.
    """
    noise = instruments.noise
    deviations = {
        f"initial_{name}": JOINT_PRIOR_SETTINGS.velocity_noises * noise[name]
        for name in CHANNELS[:6]
        if name in noise
    }
    turning = any(name in noise for name in CHANNELS[3:6])
    for name in CHANNELS[9:]:
        if name in noise or (turning and name != "yaw"):
            deviations[f"initial_{name}"] = JOINT_PRIOR_SETTINGS.angle_sd
    deviations |= {
        f"initial_{name}": JOINT_PRIOR_SETTINGS.place_sd for name in CHANNELS[6:9] if name in noise
    }
    return {name: deviations[name] for name in initial_names() if name in deviations}


_HULL = re.compile(r"[XYZKMN]_(?:[uvwpqr]{1,2}|[uvwpqr]dot)$|C_D[yz]$")
_RESTORING = ("B", "z_b")


def of_vehicle(vehicle: Vehicle, names: Sequence[str] = ()) -> tuple[Parameter, ...]:
    """Coefficients of the hull that a vehicle has, buoyancy and its height, and others by name.

    Mass, inertia and thrust are taken as known from scales, tape measure and bench test. The bounds are the
    default ones, widened where the vehicle's value lies outside.
    """
    values, info = vehicle.coefficients(), vehicle.coefficient_info()
    own = [name for name, x in values.items() if x != 0.0 and (_HULL.match(name) or name in _RESTORING)]
    wanted: dict[str, Coefficient] = {}
    for name in dict.fromkeys([*sorted(own, key=list(info).index), *names]):
        facts, value = info.get(name, {}), values.get(name, 0.0)
        lower, upper = facts.get("lower"), facts.get("upper")
        if lower is not None and upper is not None:
            wanted[name] = Coefficient(bounds=(min(float(lower), value), max(float(upper), value)))
        elif name in names:
            wanted[name] = Coefficient()
    if not wanted:
        raise CampaignError(f"{vehicle.name}: it has no coefficient to plan for; name some")
    return _parsed(wanted, vehicle, "plan")


def _parsed(wanted: Mapping[str, Coefficient], vehicle: Vehicle, where: str) -> tuple[Parameter, ...]:
    """Parameters of coefficients that no stage of a campaign has together."""
    stage = Stage(name="plan", trials=("next",), axes=Axes(free="X"), coefficients=dict(wanted))
    return parsed(stage, vehicle, where)


def of_campaign(problem: Problem, names: Sequence[str] = ()) -> tuple[Parameter, ...]:
    """Parameters of all stages of a campaign and of its joint estimate, and others of the vehicle by name.

    What the joint estimate frees besides (a thruster's gain) leaves less to tell the rest by.
    """
    scales = {
        parameter.name: parameter for stage in problem.stages for parameter in problem.parameters[stage.name]
    }
    polish = problem.joint
    if polish is not None and polish.coefficients:
        scales |= {
            p.name: p for p in _parsed(polish.coefficients, problem.vehicle, f"{problem.source}: polish")
        }
    missing = [name for name in names if name not in scales]
    if missing:
        scales |= {p.name: p for p in of_vehicle(problem.vehicle, missing) if p.name in missing}
    return tuple(scales.values())


def prior_information(parameters: Sequence[Parameter]) -> Array:
    """Information (m, m) of the bounds and of the standard deviations that are known beforehand."""
    return np.diag([12.0 / (p.upper - p.lower) ** 2 + p.sd**-2.0 for p in parameters])


def recorded_information(
    recorded: Linearisation, parameters: Sequence[Parameter], instruments: Instruments
) -> Array:
    """Information (m, m) about the parameters in what was recorded alone; zero for one not estimated there.

    The noise is that of the instruments where they measure the channel, otherwise that of the linearisation.
    """
    size = len(recorded.unknowns)
    noise = np.array([
        instruments.noise.get(channel, own)
        for channel, own in zip(recorded.channels, recorded.noise, strict=True)
    ])
    factor = recorded.noise / noise
    total = np.zeros((size, size))
    for piece in recorded.pieces:
        rows = (piece.jacobian * factor[None, :, None]).reshape(-1, size)
        total += rows.T @ rows
    total *= min(recorded.dt / instruments.correlation_s, 1.0)
    rows_of = {unknown.name: row for row, unknown in enumerate(recorded.unknowns)}
    shared = [index for index, parameter in enumerate(parameters) if parameter.name in rows_of]
    keep = [rows_of[parameters[index].name] for index in shared]
    # Coefficients that were estimated but are not sought stay unknown; their bounds hold for them too.
    drop = [row for row in range(size) if row not in keep]
    for row in drop:
        unknown = recorded.unknowns[row]
        total[row, row] += unknown.prior_sd**-2.0
        if unknown.kind == "coefficient" and math.isfinite(unknown.scale):
            total[row, row] += 12.0 / unknown.scale**2
    information = np.zeros((len(parameters), len(parameters)))
    information[np.ix_(shared, shared)] = eliminate(total, keep, drop)
    return information


def seen_by(recorded: Linearisation) -> Instruments:
    """Instruments as good as the residuals of what was recorded: noise and correlation time from them.

    A current is unknown in the next trial as it was in those: if they did not estimate one, there is none.
    """
    power, lagged = 0.0, 0.0
    for piece in recorded.pieces:
        error = np.where(piece.counted, piece.residual, 0.0)
        power += float((error[1:] ** 2).sum())
        lagged += float((error[1:] * error[:-1]).sum())
    r = min(max(lagged / power, 0.0), 0.99) if power > 0.0 else 0.0
    return Instruments(
        dict(zip(recorded.channels, map(float, recorded.noise), strict=True)),
        correlation_s=recorded.dt * variance_inflation(r),
        current_m_s=max(
            (
                unknown.prior_sd
                for unknown in recorded.unknowns
                if unknown.name.rpartition(": ")[2] in _CURRENTS
            ),
            default=0.0,
        ),
    )
