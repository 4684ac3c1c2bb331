"""Rates of the core, of CasADi's C and of the textbook model on the same work, all from one run.

Rates are time steps per second. The best of several rounds counts: another process only ever makes a round
slower. The contenders take turns within a round, so that a change of clock frequency meets all of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks import textbook
from benchmarks.casadi_compiled import Compiled
from benchmarks.casadi_model import expressions
from benchmarks.operations import count
from benchmarks.peak import fma_peak
from benchmarks.textbook_vehicle import build
from benchmarks.workload import STEP_S, SUBSTEPS, Workload, chain, hull

REST = np.array([0.0, 0.0, 0.0, 1.0] + [0.0] * 9)


@dataclass(frozen=True)
class Speed:
    """Rates in steps per second, operations per step, and the peak of one core in operations per second."""

    peak: float
    operations: dict[str, float]
    rates: dict[str, float]
    apart_casadi: float
    apart_textbook: float

    def fraction(self, work: str) -> float:
        """Return the share of the peak that the core reaches on ``work`` with one thread."""
        return self.rates[work] * self.operations[work] / self.peak


def seconds(work: Callable[[], object]) -> float:
    """Return the wall time of ``work`` in s."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measure(*, rounds: int = 5, samples: int = 1201, candidates: int = 512) -> Speed:
    """Return all rates, from ``rounds`` rounds over ``candidates`` candidates of a log of ``samples``."""
    whole, bare, short = chain(samples), hull(samples), chain(121)
    core = {"chain": whole.open_loop(), "hull": bare.open_loop()}
    populations = {
        "chain": whole.candidates(candidates, dead_times=False),
        "dead times": whole.candidates(candidates),
        "hull": bare.candidates(candidates),
    }
    few = whole.candidates(max(1, candidates // 8), dead_times=False)
    hoisted = Compiled(expressions(whole.parameters, STEP_S))
    generated = Compiled(expressions(whole.parameters, STEP_S, hoisted=False))
    model = build(whole.parameters)
    contenders: dict[str, tuple[int, Callable[[], object]]] = {
        "chain": (candidates, lambda: core["chain"].errors(populations["chain"], threads=1)),
        "hull": (candidates, lambda: core["hull"].errors(populations["hull"], threads=1)),
        "dead times": (candidates, lambda: core["chain"].errors(populations["dead times"], threads=1)),
        "two threads": (candidates, lambda: core["chain"].errors(populations["chain"], threads=2)),
        "CasADi": (len(few), lambda: run_casadi(hoisted, whole, few)),
        "CasADi as generated": (len(few), lambda: run_casadi(generated, whole, few)),
    }
    best = dict.fromkeys(contenders, np.inf)
    peak = 0.0
    for _ in range(rounds):
        peak = max(peak, fma_peak())
        for name, (_, work) in contenders.items():
            best[name] = min(best[name], seconds(work))
    rates = {name: size * whole.steps / best[name] for name, (size, _) in contenders.items()}
    slow = min(
        seconds(lambda: textbook.simulate(model, short.t, short.commands, substeps=SUBSTEPS))
        for _ in range(2)
    )
    rates["textbook"] = short.steps / slow
    return Speed(
        peak=peak,
        operations={
            "chain": count(whole.parameters).per_step(SUBSTEPS),
            "hull": count(bare.parameters).per_step(SUBSTEPS),
        },
        rates=rates,
        apart_casadi=apart_casadi(hoisted, whole),
        apart_textbook=apart_textbook(short),
    )


def run_casadi(compiled: Compiled, work: Workload, values: np.ndarray) -> object:
    """Run the candidates ``values`` through the compiled model and its criterion."""
    return compiled.run(values, work.t, work.commands, state=REST, observed=work.observed, weight=work.weight)


def apart_casadi(compiled: Compiled, work: Workload) -> float:
    """Return the largest difference of any state (SI) between the core and the compiled CasADi model."""
    run = work.vehicle.simulate(work.t, work.commands, max_step_s=STEP_S)
    _, states = compiled.run(
        [compiled.expressions.values], work.t, work.commands, state=REST, trajectory=True
    )
    assert states is not None
    return float(np.abs(np.hstack([run.position, run.attitude, run.nu]) - states[0]).max())


def apart_textbook(work: Workload) -> float:
    """Return the largest difference of any state (SI) between the core and the textbook model."""
    run = work.vehicle.simulate(work.t, work.commands, max_step_s=STEP_S)
    expected = textbook.simulate(build(work.parameters), work.t, work.commands, substeps=SUBSTEPS)
    found = np.hstack([run.position, run.attitude, run.nu])
    return float(np.abs(found - np.hstack([expected.position, expected.attitude, expected.nu])).max())
