"""Work that tests cut into chunks; workers import it from here."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

from seatrial.base.chunks import Chunk, Format, Shared
from seatrial.base.errors import TrialError

FORM: Format[dict[str, Any]] = Format(pack=dict, unpack=dict)


def square(shared: dict[str, Any], number: int) -> dict[str, Any]:
    """Square of a number; a file beside says that it was computed once more."""
    if number == shared.get("bad"):
        raise TrialError(f"number {number}: expected another one; choose it")
    time.sleep(shared.get("sleep_s", 0.0))
    if folder := shared.get("folder"):
        (Path(folder) / f"{number}-{os.getpid()}-{time.monotonic_ns()}").touch()
    return {"square": number * number}


def squares(count: int, **shared: Any) -> list[Chunk[dict[str, Any]]]:
    """Chunks of the first numbers."""
    packed = Shared(shared)
    return [Chunk(f"number {n}", "inputs", square, packed, (n,)) for n in range(count)]


def main(folder: str, address: str, count: str, sleep_s: str) -> None:
    """Squares into a run directory on a Dask cluster, as a process of its own."""
    from seatrial.base.chunks import run_chunks
    from seatrial.base.fleet import fleet_of
    from seatrial.base.run import RunDirectory

    chunks = squares(int(count), sleep_s=float(sleep_s), folder=folder)
    with (
        RunDirectory(Path(folder) / "run") as run,
        fleet_of(address, tell=lambda line: print(line, flush=True)) as fleet,
    ):
        for done in run_chunks(chunks, run, FORM, fleet=fleet):
            print(done.chunk.part, done.value["square"], done.record["attempts"], flush=True)


if __name__ == "__main__":
    import sys

    main(*sys.argv[1:])
