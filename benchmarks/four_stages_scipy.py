"""The four stages in NumPy and SciPy: costs per step measured on a part of the job, the whole extrapolated.

The same stages, bounds, criterion, RK4 steps and numbers of candidates in the global and in the fine search
as seatrial's run took: ``scipy.optimize.differential_evolution`` (the whole population in one call) instead
of the evolution strategy, ``scipy.optimize.minimize`` (Nelder-Mead) instead of simplexes abreast and
descent. Whether it would get as far with as many candidates is not asked, and the derivatives that the
descent takes besides are not charged to it. Part: the first seconds of every segment, a few candidates.
Cost is linear in samples and candidates; the ratio of the costs per step of two sizes shows how linear. Two
cores are given to it as if its candidates shared them perfectly.
Held by tests/benchmarks/test_benchmarks.py.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import seatrial as st
from benchmarks.four_stages import Job
from benchmarks.stage_arrays import StageArrays, arrays
from benchmarks.stage_numpy import Vectorised, textbook_cost

Array = NDArray[np.float64]

CORES = 2
# Samples per segment of the two sizes of a part; a textbook's step is a thousand times slower.
SAMPLES = (11, 21)
TEXTBOOK_SEGMENTS = 2
SIMPLEX_CANDIDATES = 4


@dataclass(frozen=True)
class Phase:
    """One search of one stage: seconds per candidate and step on two sizes of a part, and the whole job."""

    stage: str
    search: str
    per_step: tuple[float, float]
    steps: int
    candidates: int

    @property
    def extrapolated_s(self) -> float:
        """Return the seconds of one core for all candidates."""
        return self.per_step[1] * self.steps * self.candidates

    @property
    def linearity(self) -> float:
        """Return the cost per step of the larger part over that of the smaller one."""
        return self.per_step[1] / self.per_step[0]


@dataclass(frozen=True)
class Rival:
    """All searches of all stages in one way of writing them."""

    name: str
    phases: tuple[Phase, ...]

    @property
    def wall_s(self) -> float:
        """Return the extrapolated wall time on two cores, shared perfectly."""
        return sum(phase.extrapolated_s for phase in self.phases) / CORES

    @property
    def steps_per_s(self) -> float:
        """Return the steps per second of one core, all searches together."""
        return sum(phase.steps * phase.candidates for phase in self.phases) / (CORES * self.wall_s)

    @property
    def linearity(self) -> tuple[float, float]:
        """Return the lowest and highest linearity of all searches."""
        found = [phase.linearity for phase in self.phases]
        return min(found), max(found)


def measure(job: Job, vehicle: st.Vehicle) -> tuple[Rival, Rival]:
    """Return the vectorised and the textbook's way for the stages of a job, each extrapolated from a part.

    Parameters
    ----------
    job : Job
        Gives plans, numbers of candidates and steps.
    vehicle : Vehicle
        The campaign's; each stage gets the estimates of those before.
    """
    quick: list[Phase] = []
    plain: list[Phase] = []
    for planned, taken, found in zip(job.plans, job.stages, job.found, strict=True):
        for search, count, substeps in zip(("global", "fine"), taken.candidates, taken.substeps, strict=True):
            whole = arrays(planned, vehicle, substeps)
            clock = global_search if search == "global" else fine_search
            parts = [whole.part(samples) for samples in SAMPLES]
            costs = [clock(part) / part.steps for part in parts]
            quick.append(Phase(taken.name, search, (costs[0], costs[1]), whole.steps, count))
            parts = [whole.part(samples, TEXTBOOK_SEGMENTS) for samples in SAMPLES]
            costs = [one_candidate(part) / part.steps for part in parts]
            plain.append(Phase(taken.name, search, (costs[0], costs[1]), whole.steps, count))
        vehicle = vehicle.with_coefficients(found.coefficients)
    return Rival("vectorised NumPy", tuple(quick)), Rival("textbook NumPy", tuple(plain))


def global_search(part: StageArrays) -> float:
    """Return the seconds per candidate of differential evolution, a population in one call."""
    from scipy.optimize import differential_evolution

    cost = Vectorised(part)
    bounds = list(zip(part.lower, part.upper, strict=True))

    def search() -> int:
        asked = []  # the search's own count is of calls, not of candidates

        def costs(x: Array) -> Array:
            asked.append(x.shape[1])
            return cost(x.T)

        options = {"vectorized": True, "updating": "deferred", "tol": 0.0, "polish": False}
        differential_evolution(costs, bounds, maxiter=1, seed=1, **options)
        return sum(asked)

    return best_of(search)


def fine_search(part: StageArrays) -> float:
    """Return the seconds per candidate of a simplex, one at a time."""
    from scipy.optimize import minimize

    cost = Vectorised(part)
    bounds = list(zip(part.lower, part.upper, strict=True))

    def search() -> int:
        found = minimize(
            lambda x: float(cost(x[None, :])[0]),
            0.5 * (part.lower + part.upper),
            method="Nelder-Mead",
            bounds=bounds,
            options={"maxfev": SIMPLEX_CANDIDATES},
        )
        return int(found.nfev)

    return best_of(search)


def one_candidate(part: StageArrays) -> float:
    """Return the seconds of one candidate in the textbook's way; what a search adds is nothing beside it."""
    middle = 0.5 * (part.lower + part.upper)

    def fly() -> int:
        textbook_cost(part, middle)
        return 1

    return best_of(fly)


def best_of(work: Callable[[], int], *, rounds: int = 3) -> float:
    """Return the least CPU seconds per candidate of several rounds of ``work``, which returns their number.

    None of it runs in several threads: on a quiet machine this is the wall time, on a busy one less.
    """
    found = []
    for _ in range(rounds):
        began = time.process_time()
        count = work()
        found.append((time.process_time() - began) / count)
    return min(found)


def sentences(rivals: Sequence[Rival]) -> list[str]:
    """Return what was measured and what extrapolated, with the versions."""
    import scipy

    lines = [f"NumPy {np.__version__}, SciPy {scipy.__version__}, one core each, halved for two."]
    for rival in rivals:
        low, high = rival.linearity
        lines.append(
            f"{rival.name}: {rival.steps_per_s:,.0f} steps/s, measured on the first {SAMPLES[1] - 1} samples"
            f" of segments, extrapolated to {rival.wall_s:,.0f} s; cost per step of twice the part over the"
            f" part: {low:.2f} to {high:.2f}."
        )
    return lines
