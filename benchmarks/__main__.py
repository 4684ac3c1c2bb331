"""Prints the ratios that the project claims, each measured in this run: ``python -m benchmarks``."""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import closed_loop, derivatives, four_stages, four_stages_scipy
from benchmarks.closed_loop import ClosedLoop
from benchmarks.derivatives import Derivatives
from benchmarks.footprint import Memory, import_time, memory
from benchmarks.four_stages import Job
from benchmarks.four_stages_scipy import Rival
from benchmarks.speed import Speed, measure
from seatrial import _core

Row = tuple[str, float, str, str]


def rows(speed: Speed, exact: Derivatives, footprint: Memory, import_s: float, heavy: list[str]) -> list[Row]:
    """Return the claims: what is compared, the figure found, its format and what is aimed at."""
    rate, slope = speed.rates, exact.rates
    return [
        ("hull and hydrodynamics / FMA peak", speed.fraction("hull"), ".0%", "≥ 50 %"),
        ("whole CWolf chain with criterion / FMA peak", speed.fraction("chain"), ".0%", "≥ 30 %"),
        ("two threads / one", rate["two threads"] / rate["chain"], ".2f", "≥ 1.9"),
        ("chain / textbook NumPy, one core", rate["chain"] / rate["textbook"], ",.0f", "≥ 2,000"),
        ("chain / CasADi C, constants hoisted by hand", rate["chain"] / rate["CasADi"], ".1f", ""),
        ("chain / CasADi C as generated", rate["chain"] / rate["CasADi as generated"], ".1f", "≥ 6"),
        ("chain, every candidate its own dead times / chain", rate["dead times"] / rate["chain"], ".2f", ""),
        ("trajectory apart from CasADi C, any state in SI", speed.apart_casadi, ".1e", "≤ 1e-9"),
        ("trajectory apart from textbook, any state in SI", speed.apart_textbook, ".1e", "≤ 1e-9"),
        (
            "exact sensitivities / central differences, plain numbers",
            slope["exact"] / slope["central differences"],
            ".1f",
            "",
        ),
        (
            "exact sensitivities / central differences in lanes, which give the criterion alone",
            slope["exact"] / slope["central differences in lanes"],
            ".1f",
            "",
        ),
        (
            "exact sensitivities / CasADi C, forward, eight unknowns",
            slope["exact, eight unknowns"] / slope["CasADi forward"],
            ".1f",
            "",
        ),
        ("sensitivities apart from CasADi's, relative", exact.apart_casadi, ".1e", "≤ 1e-9"),
        ("sensitivities apart from central differences, relative", exact.apart_differences, ".1e", ""),
        (
            "peak memory of a batch / its trajectories",
            footprint.growth / footprint.trajectories,
            ".1%",
            "flat",
        ),
        ("import seatrial, s", import_s, ".2f", "< 0.3"),
        ("heavy modules that it loads", float(len(heavy)), ".0f", "0"),
    ]


def flight_rows(rates: ClosedLoop) -> list[Row]:
    """Return the claims on the closed loop."""
    share = rates.open_loop
    return [
        ("closed loop with perfect sensors / open loop, one core", rates.closed / share, ".2f", "≥ 0.5"),
        ("the same with noise, one seed for all", rates.common_noise / share, ".2f", ""),
        ("the same with noise, a seed for each", rates.own_noise / share, ".2f", "≥ 0.5"),
        (
            "closed loop on a navigation filter / on its typical sensors",
            rates.filtered / rates.typical,
            ".2f",
            "≥ 0.25",
        ),
        ("step of the navigation filter, µs", 1e6 * rates.filter_step_s, ".1f", ""),
    ]


def job_rows(speed: Speed, job: Job, rivals: tuple[Rival, Rival], whole_s: float) -> list[Row]:
    """Return the claims on the four stages of an hour of logs."""
    quick, plain = rivals
    rate = speed.rates
    return [
        ("four stages of an hour of 10 Hz logs, s", job.wall_s, ".1f", "< 10"),
        (
            "the same in vectorised NumPy + SciPy, extrapolated / seatrial",
            quick.wall_s / job.wall_s,
            ",.0f",
            "",
        ),
        (
            "the same in textbook NumPy + SciPy, extrapolated / seatrial",
            plain.wall_s / job.wall_s,
            ",.0f",
            "",
        ),
        ("their steps per s / chain, two threads", job.steps / job.wall_s / rate["two threads"], ".0%", ""),
        ("their steps per s of CPU / chain, one core", job.steps / job.cpu_s / rate["chain"], ".0%", ""),
        ("identify of that hour, polish and assessment included, s", whole_s, ".0f", ""),
    ]


def job_table(job: Job) -> Table:
    """Return what each stage took."""
    table = Table(
        "stage",
        "candidates, global + fine",
        "steps per sample",
        "million steps",
        "wall, s",
        title=f"four stages: {job.steps / 1e6:.0f} million steps, {job.wall_s:.1f} s wall,"
        f" {job.cpu_s:.1f} s CPU; reading the logs {job.read_s:.1f} s more",
    )
    for stage in job.stages:
        coarse, fine = stage.candidates
        table.add_row(
            stage.name,
            f"{coarse} + {fine}",
            "{} and {}".format(*stage.substeps),
            f"{stage.steps / 1e6:.1f}",
            f"{stage.wall_s:.1f}",
        )
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print the figures for machines")
    parser.add_argument("--rounds", type=int, default=5, help="rounds of which the best counts (default 5)")
    arguments = parser.parse_args()
    console = Console()
    with console.status("measuring: about two minutes"):
        import_s, heavy = import_time()
        footprint = memory()
        speed = measure(rounds=arguments.rounds)
        exact = derivatives.measure(rounds=arguments.rounds)
        flights = closed_loop.measure(rounds=arguments.rounds)
        with tempfile.TemporaryDirectory() as folder:
            hour = four_stages.campaign(four_stages.write_logs(Path(folder)))
            job = four_stages.run(hour)
            rivals = four_stages_scipy.measure(job, hour.vehicle)
            whole_s = four_stages.identify(hour)
    found = rows(speed, exact, footprint, import_s, heavy) + flight_rows(flights)
    found += job_rows(speed, job, rivals, whole_s)
    if arguments.json:
        figures = {
            "ratios": {name: value for name, value, _, _ in found},
            "steps_per_s": speed.rates,
            "steps_times_unknowns_per_s": exact.rates,
            "peak_per_s": speed.peak,
            "four_stages": {
                "wall_s": job.wall_s,
                "cpu_s": job.cpu_s,
                "read_s": job.read_s,
                "steps": job.steps,
            }
            | {f"{rival.name}, extrapolated_s": rival.wall_s for rival in rivals},
        }
        print(json.dumps(figures, indent=1))
        return
    ratios = Table("ratio", "found", "aim", title=f"{_core.simd_level()}, {os.cpu_count()} cores")
    for name, value, form, aim in found:
        ratios.add_row(name, format(value, form), aim)
    console.print(ratios)
    rates = Table(
        "contender, one core unless named", "steps/s", "operations per step", "Gop/s", title="rates"
    )
    for name, rate in sorted(speed.rates.items(), key=lambda item: -item[1]):
        counted = speed.operations["hull" if name == "hull" else "chain"]
        rates.add_row(name, f"{rate:,.0f}", f"{counted:.0f}", f"{rate * counted / 1e9:.1f}")
    rates.add_row("FMA peak of one core", "", "", f"{speed.peak / 1e9:.1f}")
    console.print(rates)
    slopes = Table("derivatives, one core", "steps × unknowns/s")
    for name, rate in sorted(exact.rates.items(), key=lambda item: -item[1]):
        slopes.add_row(name, f"{rate:,.0f}")
    console.print(slopes)
    console.print(job_table(job))
    for sentence in four_stages_scipy.sentences(rivals):
        console.print(sentence)


if __name__ == "__main__":
    main()
