"""Memory of a batch and time of the import, each in a process of its own.

Memory: by how much a large batch raises the peak resident size of its process; stored trajectories would
show.
Import: the time of ``import seatrial`` in a fresh interpreter, and the heavy modules that it must not load.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from dataclasses import dataclass

from benchmarks.workload import chain

HEAVY = ("scipy", "polars", "matplotlib", "plotly", "cma", "pint", "pandas", "pydantic", "rich", "typer")
IMPORT = f"""
import json, sys, time
start = time.perf_counter()
import seatrial
seconds = time.perf_counter() - start
print(json.dumps([seconds, [name for name in {HEAVY!r} if name in sys.modules]]))
"""
STATE_BYTES = 13 * 8


@dataclass(frozen=True)
class Memory:
    """Peak resident size in bytes over the size before the batch, and what stored trajectories would take."""

    growth: int
    trajectories: int
    candidates: int
    samples: int


def peak_growth(candidates: int, samples: int) -> int:
    """Return by how many bytes one evaluation of a batch raises this process's peak resident size."""
    import resource

    work = chain(samples)
    open_loop = work.open_loop()
    values = work.candidates(candidates)
    open_loop.errors(values[:8])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    open_loop.errors(values)
    # Linux counts in KiB.
    return 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)


def memory(candidates: int = 1024, samples: int = 3001) -> Memory:
    """Return the growth of a fresh process's peak during one batch."""
    code = f"from benchmarks.footprint import peak_growth; print(peak_growth({candidates}, {samples}))"
    printed = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    return Memory(int(printed), candidates * samples * STATE_BYTES, candidates, samples)


def import_time(repeats: int = 7) -> tuple[float, list[str]]:
    """Return the median time of ``import seatrial`` in s and the heavy modules that it loads."""
    runs = [
        json.loads(subprocess.run([sys.executable, "-c", IMPORT], check=True, capture_output=True).stdout)
        for _ in range(repeats)
    ]
    return statistics.median(seconds for seconds, _ in runs), runs[0][1]
