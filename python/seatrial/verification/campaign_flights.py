"""The flights of a verification: which vehicle with which autopilot flies which mission through what.

The autopilot's own model is the identified vehicle; those that fly are drawn from its covariance. Mission i
is a function of the campaign's seed and of i alone, whatever else is flown beside it: lanes give the same
bits wherever a case stands in a batch. A batch of one takes another path through the core, whose last bits
differ, so that a mission that is alone is flown in two lanes.

Tests: ``tests/test_verify.py``.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from seatrial import _core
from seatrial.fitted import Fitted
from seatrial.flight.failures import Fault, Outage
from seatrial.flight.flight import Flight
from seatrial.flight.set_up import SetUp, set_up
from seatrial.verification.cases import Cases
from seatrial.verification.draws import draw_cases
from seatrial.verification.expression import KNOWN
from seatrial.verification.flown_missions import FlownMissions, figures_for_requirements
from seatrial.verification.obstacles import obstacles
from seatrial.verification.verification_file import VerificationTable

if TYPE_CHECKING:
    from pathlib import Path

    from seatrial._core import Autopilot, Flights, Vehicle
    from seatrial.mission import Mission

__all__ = ["CampaignFlights"]

_LARGEST_STEP_S = 0.02


@dataclass(frozen=True, eq=False)
class CampaignFlights:
    """What a verification flies.

    Attributes
    ----------
    table
        What is asked for.
    fitted
        The identified vehicle and how well it is known.
    autopilot
        With the gains that are verified.
    missions
        Those of the table, in its order.
    seed
        Of the campaign.
    model
        The vehicle that the autopilot believes in; None: the identified one.
    sensors
        "typical", a file, or None for perfect ones.
    rho, g
        Density, kg/m3, and gravity, m/s2, where they are not the vehicle's.
    """

    table: VerificationTable
    fitted: Fitted
    autopilot: Autopilot
    missions: tuple[Mission, ...]
    seed: int
    model: Vehicle | None = None
    sensors: str | Path | None = "typical"
    rho: float | None = None
    g: float | None = None

    @property
    def titles(self) -> tuple[str, ...]:
        """Names of the missions."""
        return tuple(one.title for one in self.table.missions)

    def cases(self, numbers: int | ArrayLike) -> Cases:
        """What is drawn for missions of these numbers, or for the first so many."""
        return draw_cases(self.table, self.fitted, self.missions, seed=self.seed, numbers=numbers)

    def with_autopilot(self, autopilot: Autopilot) -> CampaignFlights:
        """The same draws for another autopilot."""
        return replace(self, autopilot=autopilot)

    def check(self) -> None:
        """Refuse what cannot be flown before anything flies.

        Raises
        ------
        SimulationError, TrialError, VehicleError, CampaignError
            A number, name, sensor or file is not usable.
        """
        self.cases([0])
        for one in self._ready:
            self.autopilot.engage(self.fitted.vehicle if self.model is None else self.model, one.mission.core)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Sentences on where the sensors of the flights differ from those of the set."""
        return self._ready[0].circumstances.sensor_notes

    @property
    def position_sd_m(self) -> float:
        """Standard deviation of the sensors' position along an axis at the end of the longest mission, m."""
        _, offset, walk, _ = self._ready[0].channels.errors[:2].max(axis=0).tolist()
        longest = max(one.planned_time for one in self.missions)
        return math.sqrt(offset**2 + walk**2 * longest)

    def fly(self, numbers: ArrayLike, *, threads: int | None = None) -> FlownMissions:
        """Missions of these numbers, flown side by side.

        Parameters
        ----------
        numbers : (k,) array_like of int
        threads : int, optional
            All when omitted; the result does not depend on it.
        """
        began = time.monotonic()
        cases = self.cases(numbers)
        figures: dict[str, Any] = {}
        seen, true = np.zeros((2, len(cases), len(_core.error_edges()) + 1))
        for index in np.unique(cases.mission).tolist():
            rows = np.flatnonzero(cases.mission == index)
            found, samples = figures_for_requirements(self._flights(cases.take(rows), index, threads=threads))
            seen[rows], true[rows] = (counts[: len(rows)] for counts in samples)
            for name, values in found.items():
                if name not in figures:
                    words = values.dtype.kind == "U"
                    figures[name] = np.empty(len(cases), dtype="U24" if words else values.dtype)
                figures[name][rows] = values[: len(rows)]
        return FlownMissions(
            numbers=cases.numbers,
            mission=cases.mission,
            seeds=cases.seeds,
            figures=figures,
            causes=dict(cases.causes),
            seen_counts=seen,
            true_counts=true,
            wall_s=time.monotonic() - began,
        )

    def replay(self, number: int) -> Flight:
        """Flight of the mission with this number, with its log; its figures are those of the verification.

        The vehicle of the flight is the drawn one, and the autopilot believes in the identified one.
        """
        case = self.cases([number])
        index = int(case.mission[0])
        flights = self._flights(case, index, logs=True)
        ready = self._ready[index]
        names = _core.autopilot_names()["groups"]
        around = replace(
            ready.circumstances,
            current=tuple(case.current[0].tolist()),
            turbulence=tuple(case.turbulence[0].tolist()),
            faults=tuple(_fault(row, self.fitted.vehicle) for row in case.faults),
            outages=tuple(Outage(names[group], begin, end) for _, group, begin, end in case.outages),
            seed=int(case.seeds[0]),
        )
        drawn = self.fitted.vehicle.with_coefficients({
            name: float(values[0]) for name, values in case.coefficients.items()
        })
        return Flight.of_case(flights, (drawn, *ready.flown[1:]), around, case=0)

    @cached_property
    def digest(self) -> str:
        """Hash of everything that a flight depends on."""
        asked = self.table.model_dump(
            mode="json", exclude={"runs", "requirements", "confidence", "keep_worst"}
        )
        around = self._ready[0].circumstances
        fitted = self.fitted
        what = [
            metadata.version("seatrial"),
            [*KNOWN, *self.cases([0]).causes],
            _core.simd_level(),
            self.seed,
            asked,
            [self.rho, self.g, around.sensors],
            [fitted.vehicle.to_toml(), fitted.names, fitted.covariance.tolist()],
            self.autopilot.to_toml(),
            None if self.model is None else self.model.to_toml(),
            [one.to_toml() for one in self.missions],
        ]
        return hashlib.sha256(json.dumps(what).encode()).hexdigest()

    @cached_property
    def _ready(self) -> tuple[SetUp, ...]:
        """A set-up per mission, in which everything that is drawn still has its mean."""
        return tuple(self._set_up(mission) for mission in self.missions)

    def _set_up(self, mission: Mission) -> SetUp:
        table, bottom = self.table, self.table.seabed
        return set_up(
            (self.fitted.vehicle, self.autopilot, mission),
            model=self.model,
            sensors=self.sensors,
            current=(0.0, 0.0, 0.0),
            turbulence_times=table.current.turbulence_times_s,
            obstacles=obstacles(table.obstacles, mission),
            initial=None,
            faults=(),
            outages=(),
            seabed=None if bottom is None else (bottom.depth_m, bottom.slope_north, bottom.slope_east),
            seed=0,
            voltage=table.voltage_v,
            feedback=True,
            max_step=_LARGEST_STEP_S,
            max_time=table.max_time_s,
            rho=self.rho,
            g=self.g,
            logs=False,
        )

    def _flights(
        self, cases: Cases, index: int, *, threads: int | None = None, logs: bool = False
    ) -> Flights:
        """Flights of cases of one mission, at least two of them."""
        if len(cases) == 1:
            cases = _twice(cases)
        return self._ready[index].fly(
            cases.seeds.tolist(),
            cases.faults,
            current=cases.current,
            logs=logs,
            threads=threads,
            coefficients=dict(cases.coefficients),
            turbulence=cases.turbulence,
            position=cases.position,
            attitude=cases.attitude,
            nu=cases.nu,
            case_outages=cases.outages,
        )


def _twice(cases: Cases) -> Cases:
    """A case alone beside itself, so that it flies in lanes as it does among others."""
    return replace(
        cases.take([0, 0]),
        faults=[(lane, *row[1:]) for lane in (0, 1) for row in cases.faults],
        outages=[(lane, *row[1:]) for lane in (0, 1) for row in cases.outages],
    )


def _fault(row: tuple[int, str, float, float], vehicle: Vehicle) -> Fault:
    """A drawn fault as a person would give it."""
    _, actuator, at, command = row
    if np.isnan(command):
        return Fault(actuator, at, stuck=True)
    dead = command == float(vehicle.actuator_info()[actuator]["neutral"])
    return Fault(actuator, at, stuck_at=None if dead else command)
