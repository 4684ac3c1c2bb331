"""Memory of a verification in this process over the number of its missions, and its time.

Run it as ``python -m benchmarks.campaign_memory 10000 100000 1000000``; each number in a process of its own.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import time
from tempfile import TemporaryDirectory

import seatrial as st
from benchmarks.many_machines import MISSION

ASKED = [
    st.Requirement("keeps its path", "true_cross_track_p95_m <= 0.5", probability=0.9),
    st.Requirement("is complete", 'ending == "complete"', probability=0.99),
]

WATER = {"current": {"speed_m_s": [0.0, 0.3]}}


def verified(runs: int) -> None:
    """Fly a campaign and print what it took."""
    began = time.monotonic()
    with TemporaryDirectory() as folder:
        found = st.verify(
            "cwolf",
            "cwolf",
            [st.Mission.from_toml(MISSION)],
            requirements=ASKED,
            water=WATER,
            coefficients={"*_uu": 10.0, "stern.gain": 5.0},
            runs=runs,
            work=st.Work(run_dir=f"{folder}/run"),
        )
        print(found.report().good)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{runs} missions: {time.monotonic() - began:.1f} s, peak {peak:.0f} MiB", flush=True)


def main() -> None:
    """Print the figures."""
    spawn = multiprocessing.get_context("spawn")
    for runs in map(int, sys.argv[1:]):
        process = spawn.Process(target=verified, args=(runs,))
        process.start()
        process.join()


if __name__ == "__main__":
    main()
