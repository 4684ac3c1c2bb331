"""Chunks on a Dask cluster of this machine: overhead per chunk, two workers over one, memory of the client.

Run it as ``python -m benchmarks.many_machines``. The pairs of one and two workers fly the same missions one
after the other, so that what else the machine does hits both alike; the median of the pairs counts.
"""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Iterator
from dataclasses import replace
from tempfile import TemporaryDirectory
from typing import Any

import seatrial as st
from seatrial.base.chunks import Chunk, Format, Shared, run_chunks
from seatrial.base.fleet import Fleet, fleet_of
from seatrial.base.run import RunDirectory
from seatrial.identification.fitted import Fitted
from seatrial.verification.missions import MISSION_SETTINGS, CampaignFlights, Flyer, fly_series

MISSION = """
format = 1
name = "out"
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 120.0
east_m = 0.0
depth_m = 5.0
"""

_PAIRS, _RUNS = 3, 32_768

FORM: Format[dict[str, int]] = Format(pack=dict, unpack=dict)


def nothing(shared: Any, number: int) -> dict[str, int]:
    """A chunk without work."""
    return {"number": number}


def empty(count: int) -> Iterator[Chunk[dict[str, int]]]:
    """Chunks without work."""
    shared = Shared(b"\0" * 15_000)  # what a verification sends
    return (Chunk(f"{n}", "", nothing, shared, (n,)) for n in range(count))


def flights() -> CampaignFlights:
    """Short missions of CWolf with what is drawn of it."""
    fitted = Fitted.of("cwolf", percent={"*_uu": 10.0, "stern.gain": 5.0})
    mission = st.Mission.from_toml(MISSION)
    water = {"current": {"speed_m_s": [0.0, 0.3]}}
    return st.Scenario(fitted, "cwolf", [mission], water=water, seed=1, runs=_RUNS).flights


def flown_s(asked: CampaignFlights, fleet: Fleet | None) -> float:
    """Wall time of the missions, s."""
    began = time.monotonic()
    with RunDirectory(None) as run:
        fly_series(asked, _RUNS, Flyer(run, threads=1, fleet=fleet))
    return time.monotonic() - began


def main() -> None:
    """Print the figures."""
    asked = flights()
    with fleet_of("local:1") as one, fleet_of("local:2") as two:
        for fleet in (one, two):  # workers load the code
            flown_s(replace(asked, seed=2), fleet)
        pairs = [(flown_s(asked, one), flown_s(asked, two)) for _ in range(_PAIRS)]
        alone = flown_s(asked, None)
        ratios = [first / second for first, second in pairs]
        print(
            f"{_RUNS} missions, s: one worker {min(a for a, _ in pairs):.2f},"
            f" two {min(b for _, b in pairs):.2f}"
            f", in this process with one thread {alone:.2f}"
        )
        print(
            f"two workers over one: median {statistics.median(ratios):.2f}, pairs"
            f" {', '.join(f'{ratio:.2f}' for ratio in ratios)}"
        )
        with TemporaryDirectory() as folder:
            began, busy = time.monotonic(), time.process_time()
            with RunDirectory(f"{folder}/run") as run:
                fly_series(asked, _RUNS, Flyer(run, threads=1, fleet=two))
            busy, took = time.process_time() - busy, time.monotonic() - began
        print(
            f"with a run directory {took:.2f} s; the client works"
            f" {1e3 * busy * MISSION_SETTINGS.chunk / _RUNS:.1f} ms per chunk of missions"
        )
        for count in (2_000, 10_000):
            began = time.monotonic()
            with RunDirectory(None) as run:
                done = sum(1 for _ in run_chunks(empty(count), run, FORM, fleet=two))
            took = time.monotonic() - began
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            print(f"{done} empty chunks: {1e3 * took / count:.2f} ms each, peak of the client {peak:.0f} MiB")


if __name__ == "__main__":
    main()
