"""What a tuning is asked and does: trials of every loop, and groups of loops searched together.

A loop is tried at up to three of the breakpoints that the vehicle reaches (`seatrial.tuning.loop_steps`).
Depth goes over pitch and the cross-track error over heading: they are searched with the loop that they ride
on, with their lookahead and integral of guidance. Gains of the pitch loop at points where it only holds the
hull level are searched with heave, which disturbs it there.

A hull that its flow upsets in pitch, without an actuator for pitch, tumbles above some speed with any gains
of the other loops. Margins that are asked for there cannot be had, and a search for them would only drive
the gains from bound to bound. A point counts as beyond all gains where a motion grows with the start gains,
and with every set within the bounds that a search for the slowest growth tries: each gain of the point's
loops by a factor of its own. It takes no flight.

Held by tests/tuning/test_tuning_plan.py and tests/tuning/test_holdable.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from seatrial._core import Autopilot
from seatrial.base.arrays import Array
from seatrial.base.errors import CampaignError, TrialError
from seatrial.base.run import sha256
from seatrial.base.toml_file import checked, loaded
from seatrial.control_design.operating_points import autopilot_facts, refuse_misfit, refuse_other_laws
from seatrial.control_design.tuning_table import LoopTable, TuningTable
from seatrial.estimation.search import evolve
from seatrial.flight.sensor_channels import sensors_of
from seatrial.identification.fitted import Fitted
from seatrial.tuning.loop_steps import GUIDANCE, course_lookahead, steps_of, usual_speeds
from seatrial.tuning.scope import GainParameters, TuningScope, excited_points
from seatrial.tuning.step_trial import CHANNELS, PATHS, RIDES_ON, LoopTrials

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.control_design.margin_constraint import MarginConstraint
    from seatrial.identification.identification import Identification

GROUPS = (("heave",), ("heading", "cross_track"), ("surge",), ("sway",), ("pitch", "depth"))
"""Loops and paths that are searched together, in the order of the search: what holds the hull level first."""


@dataclass(frozen=True)
class ControlProblemSettings:
    """How far numbers of guidance may go, and how points beyond gains are searched."""

    #: Factors on numbers of guidance: half a decade either way.
    guidance_factors: tuple[float, float] = (0.3, 3.0)
    #: Factors on the lookahead that goes with the loop: they are always within the bounds.
    lookahead_factors: tuple[float, float] = (0.5, 2.0)
    #: Candidates per generation of the search for points beyond gains: less than a second in all.
    search_population: int = 32
    search_generations: int = 100  #: Generations of that search.
    search_tolerance: float = 1e-2  #: Change of the result at which that search ends.


SETTINGS = ControlProblemSettings()


@dataclass(frozen=True)
class Group:
    """Loops and paths that are searched together, and the factors of their gains."""

    name: str
    trials: tuple[LoopTrials, ...]
    parameters: GainParameters


@dataclass(frozen=True, eq=False, init=False)
class ControlProblem(TuningScope):
    """What a tuning is asked: a vehicle as well as it is known, its autopilot, what the loops shall do.

    `seatrial.tune` solves it.

    Parameters
    ----------
    fit : Identification, run directory, Vehicle, built-in name or file
        What is known of the vehicle; a vehicle is taken as known exactly.
    autopilot : Autopilot, built-in name or file
        With the start gains.
    loops : mapping, optional
        The loops to tune, each with its steps, speeds_m_s, corridor, weights and beside, as in the tables
        ``[tuning.loops.NAME]`` of a campaign file; every loop at work, in default corridors, when missing.
    name : str, optional
        Of the result; that of the vehicle by default.
    seed : int
        Of draws and searches.
    **settings
        The other keys of ``[tuning]``: margins, samples, sensors, current_m_s, budget and so on.

    Raises
    ------
    CampaignError
        A key is unknown, or the vehicle or the autopilot cannot do what is asked.
    VehicleError, TrialError
        A file is not usable.

    Examples
    --------
    >>> import seatrial as st
    >>> problem = st.ControlProblem("remus100", "remus100", loops={"heading": {"steps": [20.0]}}, samples=0)
    >>> [group.name for group in problem.groups]
    ['heading']
    """

    def __init__(
        self,
        fit: Identification | Fitted | Vehicle | str | Path,
        autopilot: Autopilot | str | Path,
        *,
        loops: Mapping[str, Mapping[str, Any]] | None = None,
        name: str | None = None,
        seed: int = 0,
        **settings: Any,
    ) -> None:
        table = checked(TuningTable, {"loops": loops or {}} | settings, "tune")
        fitted, pilot = Fitted.of(fit), loaded(Autopilot, autopilot)
        vehicle = fitted.vehicle
        TuningScope.__init__(
            self,
            table,
            fitted,
            pilot,
            name=name or vehicle.name,
            seed=seed,
            origin=f"the vehicle {vehicle.name}",
            inputs={
                "autopilot": sha256(pilot.to_toml()),
                "tuning": sha256(table.model_dump_json()),
                "vehicle": sha256(vehicle.to_toml()),
            },
        )
        self.refuse_what_cannot_fly("tune")

    @classmethod
    def of_table(cls, table: TuningTable, fitted: Fitted, autopilot: Autopilot, **known: Any) -> Self:
        """Problem of a table ``[tuning]`` for a fitted vehicle and an autopilot with the start gains;
        `known`: ``name``, ``seed``, ``origin``, ``given_text``, ``inputs``.
        """
        problem = cls.__new__(cls)
        TuningScope.__init__(problem, table, fitted, autopilot, **known)
        return problem

    def refuse_what_cannot_fly(self, where: str) -> None:
        """Refuse before the search, and before a directory is made, what its first flight would refuse: a
        CampaignError, begun with `where`.
        """
        refuse_other_laws(self.autopilot)
        refuse_misfit(self.autopilot, self.vehicle)
        try:
            sensors_of(self.sensors, self.vehicle)
        except TrialError as error:
            raise CampaignError(f"{where}, key sensors: {error}") from None
        needed = [name for name, facts in self.vehicle.actuator_info().items() if facts["needs_voltage"]]
        if needed and self.table.voltage_v is None:
            raise CampaignError(
                f"{where}: the thrust of {self.vehicle.name} ({needed[0]}) depends on the supply voltage; add"
                " voltage_v, in V"
            )
        if self.current_m_s >= self.top_m_s:
            raise CampaignError(
                f"{where}, key current_m_s: expected less than the top speed of {self.vehicle.name},"
                f" {self.top_m_s:.2f} m/s, found {self.current_m_s:g}; no set point is reached against it"
            )

    @cached_property
    def loops(self) -> dict[str, LoopTable]:
        """Loops and paths that are tuned, with their tables: those of the file, or every loop at work."""
        given = self.table.loops.given()
        if not given:
            names = [name for name in CHANNELS if name not in RIDES_ON and self.modes_of(name)]
            # One that no speed is far enough from a switching speed for, or without gains, has no trial.
            gains = self.autopilot.gains()
            return {
                name: LoopTable()
                for name in names
                if usual_speeds(self, name)
                and any(v for key, v in gains.items() if key.startswith(f"{name}.K_"))
            }
        for name in given:
            if name not in CHANNELS:
                raise CampaignError(
                    f"[tuning.loops.{name}]: the set point of {name} does not move, so there is no response"
                    " to hold against a corridor; leave the table out, its margins count all the same"
                )
            if not self.modes_of(name):
                raise CampaignError(
                    f"[tuning.loops.{name}]: no mode of the autopilot {self.autopilot.name} uses"
                    f" {RIDES_ON.get(name, name)} for it; leave the table out or add the loop to a mode"
                )
        return {name: given[name] for name in CHANNELS if name in given}

    @cached_property
    def margins(self) -> MarginConstraint | None:
        """Limits of the margins at the points that gains can hold; None where the campaign asks for none."""
        every = self._asked_margins
        if every is None or not self.beyond_gains:
            return every
        return every.only([point for point in every.points if point not in self.beyond_gains])

    @cached_property
    def beyond_gains(self) -> tuple[tuple[str, float], ...]:
        """Points (mode, speed in m/s) that no gains within the bounds keep stable: no margin counts there."""
        if self._asked_margins is None:
            return ()
        return beyond_gains(self._asked_margins, self.autopilot.gains(), bounds=self.table.bounds)

    @cached_property
    def _asked_margins(self) -> MarginConstraint | None:
        """Limits of the margins at every point that the vehicle reaches."""
        from seatrial.control_design.margin_constraint import MarginConstraint

        limits = self.table.margins
        if not limits.any_at_all:
            return None
        return MarginConstraint(self.vehicle, self.autopilot, limits=limits, sensors=self.sensors)

    @property
    def steered(self) -> tuple[str, ...]:
        """Loops that a response is held against a corridor for: their own, or that of a path over them."""
        return tuple(dict.fromkeys(RIDES_ON.get(name, name) for name in self.loops))

    def speeds_of(self, loop: str) -> tuple[float, ...]:
        """Speeds at which a loop is tried where the file gives none, m/s."""
        return usual_speeds(self, loop)

    @property
    def followed(self) -> tuple[str, ...]:
        """Paths whose numbers are chosen after the loops: over a tuned loop, in no group of the search."""
        if autopilot_facts(self.autopilot).guidance["method"] == "pursuit":
            return ()
        return tuple(
            path
            for path in PATHS
            if RIDES_ON[path] in self.loops and path not in self.loops and self.modes_of(path)
            if self.speeds_of(path)
        )

    def trials(self, loop: str) -> LoopTrials:
        """Steps of a loop at its speeds."""
        if loop not in self._trials:
            self._trials[loop] = steps_of(self, loop, self.loops[loop])
        return self._trials[loop]

    @cached_property
    def _trials(self) -> dict[str, LoopTrials]:
        return {}

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """What is searched together, in order."""
        every = {name: self.trials(name) for name in self.loops}
        points = self.autopilot.speeds_m_s
        gains = self.autopilot.gains()
        excited = {name: excited_points(trials.speeds, points) for name, trials in every.items()}
        groups = []
        for members in GROUPS:
            chosen = [name for name in members if name in every]
            if not chosen:
                continue
            parameters = GainParameters(())
            rider = members[0]
            # Only gains at points that a trial tells of are free; the others follow the nearest of these.
            free = sorted({p for name in chosen for p in excited[name]} & set(self.places))
            parts: list[tuple[str, list[int], list[int]]] = [(rider, free, [])]
            # Where pitch only holds the hull level it is searched with heave, and not again by itself.
            if rider == "heave" and any(name in every for name in ("pitch", "depth")):
                moved = {p for name in ("pitch", "depth") for p in excited.get(name, [])}
                level = [p for p in free if p not in moved]
                parts.append(("pitch", level, sorted(moved)))
            if rider == "pitch" and "heave" in every:
                parts = [(rider, free, [p for p in excited["heave"] if p not in free])]
            for loop, own, taken in parts:
                parameters += GainParameters.of_loop(
                    loop, gains, free=own, taken=taken, reached=self.places, bounds=self.table.bounds
                )
            # A reference filter and numbers of guidance shape the response as gains do.
            if filtered := gains.get(f"{rider}.reference_rad_s", 0.0):
                # Half a decade either way of the filter's corner.
                parameters += GainParameters.of_number(f"{rider}.reference_rad_s", filtered, (0.3, 3.0))
            for path in chosen:
                for name in GUIDANCE.get(path, ()):
                    bounds = (
                        self._lookahead_bounds(path) if "lookahead" in name else SETTINGS.guidance_factors
                    )
                    parameters += GainParameters.of_number(name, gains.get(name, 0.0), bounds)
            if not len(parameters):
                raise CampaignError(
                    f"[tuning.loops.{chosen[0]}]: expected gains that a factor moves, found only zeros for"
                    f" {rider} in {self.autopilot.name}; give it start gains, or leave the table out"
                )
            groups.append(Group(" and ".join(chosen), tuple(every[name] for name in chosen), parameters))
        return tuple(groups)

    def _lookahead_bounds(self, path: str) -> tuple[float, float]:
        """Bounds of the factor on a lookahead, which reach to what goes with the loop as well."""
        fits = course_lookahead(self, self.autopilot, path)[0] / self.autopilot.gains()[GUIDANCE[path][0]]
        least, most = SETTINGS.guidance_factors
        return min(least, SETTINGS.lookahead_factors[0] * fits), max(
            most, SETTINGS.lookahead_factors[1] * fits
        )

    def to_dict(self) -> dict[str, Any]:
        """Trials and parameters as plain data."""
        return {
            "followed": list(self.followed),
            "reachable_speeds_m_s": [self.autopilot.speeds_m_s[i] for i in self.places],
            "groups": [
                {
                    "name": group.name,
                    "parameters": list(group.parameters.names),
                    "trials": [trials.to_dict() for trials in group.trials],
                }
                for group in self.groups
            ],
        }


def beyond_gains(
    limits: MarginConstraint, start: Mapping[str, float], *, bounds: tuple[float, float]
) -> tuple[tuple[str, float], ...]:
    """Points (mode, speed in m/s) of some limits that no gains within bounds of the factors on the start
    gains keep stable; points where no margin is asked for are left out.
    """
    beyond = []
    for mode, speed in limits.points:
        point = limits.only([(mode, speed)])
        grows = limits.limits.at(speed).any and float(point.growth({})[0]) > 0.0
        if grows and _slowest_growth(point, start, bounds) > 0.0:
            beyond.append((mode, speed))
    return tuple(beyond)


def _slowest_growth(
    point: MarginConstraint, start: Mapping[str, float], bounds: tuple[float, float]
) -> float:
    """Least rate of growth at a single point over factors on its loops' gains, 1/s."""
    parameters = GainParameters(())
    for loop in point.loops:
        parameters += GainParameters.of_loop(loop, start, free=[0], reached=[0], bounds=bounds)
    if not len(parameters):
        return float(point.growth({})[0])
    least = np.inf

    def growth(x: Array) -> Array:
        nonlocal least
        rates = point.growth(parameters.gains(x))
        least = min(least, float(rates.min()))
        return rates

    lower, upper = parameters.bounds
    evolve(
        growth,
        np.zeros(len(parameters)),
        lower=lower,
        upper=upper,
        seed=0,
        population=SETTINGS.search_population,
        generations=SETTINGS.search_generations,
        tolerance=SETTINGS.search_tolerance,
        enough=lambda: least == 0.0,
    )
    return least
