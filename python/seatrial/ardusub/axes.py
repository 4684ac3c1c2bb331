"""Which loops of ArduSub the identified model can judge, why not the others, and the margins of those it can.

Gains of a loop are changed only where five things hold: its coefficients were identified from the log; no
search ended at a bound; the apparent mass is one that the vehicle of the file can have
(`seatrial.identification.estimate`); drawn vehicles agree about it; and on held-out data the model
predicts better than the best baseline.
Otherwise the parameters stay, and the report says which trial would tell.

A margin is that of the loop opened at the mixer's demand, all filters, the motor's lag and one and a half
control periods of delay within it (`seatrial.control_design.margins`). The thruster's curve is taken at its
steepest and at its flattest secant. Source: Franklin, Powell and Emami-Naeini, *Feedback Control of Dynamic
Systems* (2010), chapter 6.
Held by ``tests/ardusub/test_tuning.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from seatrial._core import ardusub_defaults, ardusub_pulses
from seatrial.ardusub.course import Rig
from seatrial.base.arrays import Array
from seatrial.base.channels import AXES
from seatrial.base.report import sentence_of, wording
from seatrial.control_design.margins import loop_margins
from seatrial.control_design.tuning_table import ACCEPTED
from seatrial.identification.estimate import ESTIMATE_SETTINGS, implausible_masses
from seatrial.vehicle.actuators import bollard, delays

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.identification.fitted import Fitted
    from seatrial.identification.identification import Identification

SOUGHT: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "roll": {
        "ATC_ANG_RLL_P": (3.0, 12.0), "ATC_RAT_RLL_P": (0.02, 0.3), "ATC_RAT_RLL_I": (0.005, 0.5),
        "ATC_RAT_RLL_D": (0.0005, 0.02),
    },
    "pitch": {
        "ATC_ANG_PIT_P": (3.0, 12.0), "ATC_RAT_PIT_P": (0.02, 0.3), "ATC_RAT_PIT_I": (0.005, 0.5),
        "ATC_RAT_PIT_D": (0.0005, 0.02),
    },
    "yaw": {"ATC_ANG_YAW_P": (1.0, 12.0), "ATC_RAT_YAW_P": (0.02, 0.5), "ATC_RAT_YAW_I": (0.002, 0.05)},
    "depth": {
        "PSC_D_POS_P": (0.5, 4.0), "PSC_D_VEL_P": (1.0, 8.0), "PSC_D_ACC_P": (0.01, 0.15),
        "PSC_D_ACC_I": (0.001, 0.15),
    },
    "place": {"PSC_NE_POS_P": (0.5, 4.0), "PSC_NE_VEL_P": (0.5, 6.0), "PSC_NE_VEL_I": (0.02, 1.0)},
}  # fmt: skip
"""Parameters of each loop and within which they are sought: the ranges of ArduPilot's list, zero apart."""

AXES_OF_LOOPS: Mapping[str, str] = {"roll": "K", "pitch": "M", "yaw": "N", "depth": "Z", "place": "XY"}
"""Axes of the wrench that move each loop."""

_CHANNEL = {"X": "u", "Y": "v", "Z": "w", "K": "p", "M": "q", "N": "r"}

AMPLE = (45.0, 12.0, 1.5)
"""Phase margin, deg, gain margin, dB, and sensitivity that a tuning may come down to where there was more."""


@dataclass(frozen=True)
class AxisVerdict:
    """Whether the model can judge a loop."""

    loop: str  #: roll, pitch, yaw, depth or place.
    judged: bool
    why: str  #: A sentence: what speaks for it or against.
    trial: str  #: What would tell, where it cannot.
    #: Whether the log was identified with a mass or an inertia that the vehicle cannot have.
    implausible: bool = False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters of the loop that would be sought."""
        return tuple(SOUGHT[self.loop])


def axis_verdicts(
    identified: Identification, fitted: Fitted, *, draws: int = 200, seed: int = 0
) -> tuple[AxisVerdict, ...]:
    """Which loops the identified model can judge."""
    words, masses = wording("ardusub"), _masses(fitted, draws, seed)
    odd_masses = implausible_masses(
        identified.problem.vehicle,
        identified.coefficients,
        {axis: mass for axis, (mass, _) in masses.items()},
    )
    verdicts = []
    for loop, axes in AXES_OF_LOOPS.items():
        odd = {axis: sentence_of(odd_masses[axis], "estimates") for axis in axes if axis in odd_masses}
        doubts = {axis: _doubt(identified, axis, masses[axis]) for axis in axes}
        against = [
            odd.get(axis) or words.doubt(axis, *doubt)
            for axis, doubt in doubts.items()
            if odd.get(axis) or doubt
        ]
        apparent = ", ".join(f"apparent {wording('estimates').mass(axis, *masses[axis])}" for axis in axes)
        # A mass that no vehicle has asks for another manoeuvre than noise does.
        trial = words.trial(loop, implausible=bool(odd)) if against else ""
        why = "; ".join(against) or f"identified: {apparent}"
        verdicts.append(AxisVerdict(loop, not against, why, trial, bool(odd)))
    return tuple(verdicts)


def _doubt(identified: Identification, axis: str, mass: tuple[float, float]) -> tuple[Any, ...]:
    """What speaks against a judgement of an axis, by its kind and numbers; empty where nothing does.

    `mass`: apparent mass of the axis and its standard deviation, kg or kg m2.
    """
    own = [coefficient for coefficient in identified.coefficients if coefficient.name.startswith(f"{axis}_")]
    if not own:
        hidden = any(parameter.parameter.startswith(f"{axis}_") for parameter in identified.held)
        return ("hidden" if hidden else "unmoved",)
    inertia = next((coefficient for coefficient in own if coefficient.name.endswith("dot")), None)
    damping = [coefficient for coefficient in own if not coefficient.name.endswith(("dot", "_0"))]
    stuck = [coefficient for coefficient in own if coefficient.at_bound and not _at_zero(coefficient)]
    if inertia is not None and inertia.at_bound:
        return "bound", inertia.name, inertia.estimate
    # One damping term may rest at its bound where another one takes its part.
    if stuck and all(coefficient in stuck for coefficient in damping):
        return "bound", stuck[0].name, stuck[0].estimate
    if not mass[1] <= ESTIMATE_SETTINGS.agree * mass[0]:
        return "draws", *mass
    # Data that no coefficient has seen judge the axes, where there are any.
    scores = identified.scores.get("hold_out", {}).get("ahead", {}).get("all")
    channel = _CHANNEL[axis]
    if scores is not None and channel in scores:
        r2 = scores[channel].r2
        best = max((row[channel] for row in identified.baselines.values() if channel in row), default=-np.inf)
        if not r2 > best:
            return "baseline", channel, r2, best
    return ()


def _at_zero(coefficient: Any) -> bool:
    """Whether a coefficient rests at a bound of zero: damping that is not there."""
    return bool(abs(coefficient.estimate) <= 1e-6 * max(abs(coefficient.lower), abs(coefficient.upper)))


def _masses(fitted: Fitted, draws: int, seed: int) -> dict[str, tuple[float, float]]:
    """Apparent mass of every axis and its standard deviation over drawn vehicles."""
    diagonal = _diagonals(fitted.vehicle, fitted.draws(draws, seed), draws)
    own = np.diag(np.asarray(fitted.vehicle.mass_matrix()))
    return {axis: (float(own[i]), float(diagonal[:, i].std())) for i, axis in enumerate(AXES)}


def _diagonals(vehicle: Vehicle, drawn: Mapping[str, Array], k: int) -> Array:
    """Diagonal (k, 6) of the mass matrix of drawn vehicles."""
    if not drawn:
        return np.tile(np.diag(np.asarray(vehicle.mass_matrix())), (k, 1))
    rows = []
    for i in range(k):
        drawn_vehicle = vehicle.with_coefficients({name: float(values[i]) for name, values in drawn.items()})
        rows.append(np.diag(np.asarray(drawn_vehicle.mass_matrix())))
    return np.array(rows)


@dataclass(frozen=True)
class Margins:
    """Least margins of a loop over drawn vehicles."""

    loop: str
    #: `phase_deg`, `gain_db`, `sensitivity`: least phase margin, least gain margin upwards, largest
    #: sensitivity.
    phase_deg: float
    gain_db: float
    sensitivity: float

    @property
    def accepted(self) -> bool:
        """Whether all are what is accepted of a tuned loop."""
        return self.lacking() <= 0.0

    def lacking(self, before: Margins | None = None) -> float:
        """By how much they fall short, relative; zero where they do not.

        Of what is accepted of a tuned loop; where those before were better, of these, up to what is ample.
        """
        own = before or self
        phase = max(ACCEPTED.phase_deg, min(own.phase_deg, AMPLE[0])) if before else ACCEPTED.phase_deg
        gain = max(ACCEPTED.gain_db, min(own.gain_db, AMPLE[1])) if before else ACCEPTED.gain_db
        most = min(ACCEPTED.sensitivity, max(own.sensitivity, AMPLE[2])) if before else ACCEPTED.sensitivity
        return float(
            max(0.0, 1.0 - self.phase_deg / phase)
            + max(0.0, 1.0 - self.gain_db / gain)
            + max(0.0, self.sensitivity / most - 1.0)
        )


class MarginModel:
    """Linear loops of a vehicle and those drawn from it; made once, asked for many gains."""

    def __init__(
        self, fitted: Fitted, rig: Rig, *, period_s: float, voltage_v: float, draws: int = 60, seed: int = 0
    ) -> None:
        self.fitted, self.rig, self._period_s = fitted, rig, period_s
        drawn = fitted.draws(draws, seed)
        self._mass = _diagonals(fitted.vehicle, drawn, draws)
        own = fitted.vehicle.coefficients()
        names = ("X_u", "Y_v", "Z_w", "K_p", "M_q", "N_r")
        self._damping = np.stack(
            [-np.broadcast_to(drawn.get(name, own.get(name, 0.0)), draws) for name in names], 1
        )
        self._secants = _secants(fitted.vehicle, rig, voltage_v)
        self._delays = delays(fitted.vehicle, AXES)
        self._omega = np.geomspace(0.02, 0.9 * np.pi / period_s, 400)

    def of(self, loop: str, parameters: Mapping[str, float]) -> Margins:
        """Margins of a loop with some parameters."""
        s = 1j * self._omega
        law = loop_law(loop, {**ardusub_defaults(), **parameters}, s)
        every = []
        for axis in AXES_OF_LOOPS[loop]:
            i = AXES.index(axis)
            late = self._delays[axis]
            chain = np.exp(-s * (1.5 * self._period_s + late.dead_s)) / (1.0 + s * (late.lag_s + late.ramp_s))
            motion = 1.0 / (self._mass[:, i, None] * s + self._damping[:, i, None])
            for secant in self._secants[axis]:
                every.append(law * chain * motion * secant)
        margins = loop_margins(np.concatenate(every), self._omega)
        return Margins(
            loop,
            float(margins.phase_deg.min()),
            float(20.0 * np.log10(margins.gain.min())),
            float(margins.sensitivity.max()),
        )


def loop_law(loop: str, values: Mapping[str, float], s: Any) -> Any:
    """Demand per velocity of the loop's axis, with the sign of a feedback that holds."""

    def lag(name: str) -> Any:
        cut_off = values.get(name, 0.0)
        return 1.0 / (1.0 + s / (2.0 * np.pi * cut_off)) if cut_off > 0.0 else 1.0

    def pid(name: str) -> Any:
        slope = values[f"{name}_D"] * s * lag(f"{name}_FLTD")
        return lag(f"{name}_FLTE") * (values[f"{name}_P"] + values[f"{name}_I"] / s + slope)

    if loop in ("roll", "pitch", "yaw"):
        axis = {"roll": "RLL", "pitch": "PIT", "yaw": "YAW"}[loop]
        rate, outer = f"ATC_RAT_{axis}", lag(f"ATC_RAT_{axis}_FLTT") * values[f"ATC_ANG_{axis}_P"] / s
        return pid(rate) * (1.0 + outer) + values[f"{rate}_FF"] * outer
    if loop == "depth":
        velocity = pid("PSC_D_VEL") * (1.0 + values["PSC_D_POS_P"] / s)
        return 2.0 * pid("PSC_D_ACC") * (s + velocity)
    lean = 9.80665 * np.radians(values["ATC_ANGLE_MAX"])
    return pid("PSC_NE_VEL") * (1.0 + values["PSC_NE_POS_P"] / s) / lean


def _secants(vehicle: Vehicle, rig: Rig, voltage_v: float) -> dict[str, tuple[float, float]]:
    """Steepest and flattest force or moment per demand, N or N m, of each axis.

    Between demands of 0.2 and 0.8, both ways.
    """
    columns = {"K": 0, "M": 1, "N": 2, "Z": 3, "X": 4, "Y": 5}
    secants = {}
    for axis, column in columns.items():
        slopes = []
        for size in (0.2, 0.5, 0.8):
            demands = np.zeros((2, 6))
            demands[:, column] = size, -size
            pulses = np.asarray(ardusub_pulses(rig.frame, demands, np.asarray(rig.direction, float)))
            both = [
                bollard(vehicle, dict(zip(vehicle.actuators, row.tolist(), strict=True)), voltage_v=voltage_v)
                for row in pulses
            ]
            slopes.append(abs(float((both[0] - both[1])[AXES.index(axis)])) / (2.0 * size))
        secants[axis] = max(slopes), min(slopes)
    return secants
