"""Damaged logs: every reader refuses them with its own error or reads what is left, fast and in bounded
memory.

``python -m tests.logs.fuzz SECONDS [FILE…]`` goes on for that long over one log of every format and the
files given; ``python -m tests.logs.fuzz SECONDS FILE… --only`` over the files alone. A case that is not
handled is shown with its trace and kept, with its seed, in the folder named at the end. The cases run in a
process of their own, so that one that ends the interpreter or asks for all memory is found as well.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import tempfile
import time
import traceback
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from seatrial.base.errors import SeatrialError
from seatrial.logs.log import open_log

_PIECES = (b"nan,", b"1e999", b"\xff\xff\xff\x7f", b"-1  ", b"\n\n\n\n", b'",",', b"\0\0\0\0", b"9" * 40)
_LARGE = 400_000
_SLOW_S = 30.0  # a hang, on any machine
_HUNG_S = 120.0  # the process of the cases is ended after that
_MOST_MIB = 1024  # resident while a damaged log of less than 1 MB is read
_LIMIT_BYTES = 6 << 30  # of addresses: what asks for more fails instead of filling the machine


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """The bytes with one to twenty injuries: cut, flipped, overwritten, removed, inserted, repeated."""
    if len(data) > _LARGE:
        begin = int(rng.integers(len(data) // 2))
        data = data[: _LARGE // 2] + data[begin : begin + _LARGE // 4]
    cells = bytearray(data)
    for _ in range(int(rng.choice([1, 1, 2, 5, 20]))):
        if not cells:
            break
        at = int(rng.integers(len(cells) if rng.random() < 0.5 else min(len(cells), 2000)))
        kind = int(rng.integers(8))
        if kind == 0:
            del cells[at:]
        elif kind == 1:
            cells[at] = int(rng.integers(256))
        elif kind == 2:
            cells[at : at + 8] = bytes([int(rng.choice([0, 127, 255]))]) * 8
        elif kind == 3:
            del cells[at : at + int(rng.integers(1, 200))]
        elif kind == 4:
            cells[at:at] = rng.bytes(int(rng.integers(1, 64)))
        elif kind == 5:
            other = int(rng.integers(len(cells)))
            cells[at : at + 64] = cells[other : other + 64]
        else:
            piece = _PIECES[int(rng.integers(len(_PIECES)))]
            cells[at : at + (len(piece) if kind == 6 else 0)] = piece
    return bytes(cells)


def survives(path: Path) -> str | None:
    """What is wrong with how a damaged log is read; None if nothing is."""
    begun = time.monotonic()
    try:
        log = open_log(path)
        topics = log.topics()
        log.events()
        if any(topic.samples < 0 for topic in topics):
            return f"{path.name}: a topic with {min(topic.samples for topic in topics)} samples"
    except SeatrialError as error:
        if len(str(error)) > 1500 or "\x1b" in str(error):
            return f"{path.name}: a message not fit to show: {str(error)[:300]!r}"
    except Exception:
        return f"{path.name}: {traceback.format_exc()}"
    taken = time.monotonic() - begun
    return f"{path.name}: took {taken:.0f} s" if taken > _SLOW_S else None


def peak_mib(*, reset: bool = False) -> int:
    """Most memory that was resident, MiB, since it was last reset; 0 where the system does not say."""
    try:
        if reset:
            Path("/proc/self/clear_refs").write_text("5")
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next(int(line.split()[1]) // 1024 for line in lines if line.startswith("VmHWM"))


def _cases(logs: list[Path], folder: Path, seed: int, seconds: float, told: Connection) -> None:
    """Read damaged logs one after another; tells the seed and file of each case, then what is wrong."""
    resource.setrlimit(resource.RLIMIT_AS, (_LIMIT_BYTES, _LIMIT_BYTES))
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rng = np.random.default_rng(seed)
        source = logs[int(rng.integers(len(logs)))]
        path = folder / source.name
        path.write_bytes(mutated(source.read_bytes(), rng))
        told.send((seed, path))
        before = peak_mib(reset=True)
        complaint = survives(path)
        peak = peak_mib()
        if complaint is None and peak - before > _MOST_MIB:
            complaint = f"{path.name}: {before} MiB before, {peak} MiB at most"
        told.send((complaint, peak))
        seed += 1
    told.send(None)


def main() -> int:
    """Fuzz for some seconds; exit code 1 where something was found."""
    from tests.logs import log_files

    given = [Path(name) for name in sys.argv[2:] if name != "--only"]
    seed = int(time.time())
    found: dict[str, Path] = {}
    kept = Path(tempfile.mkdtemp(prefix="seatrial-fuzz-"))
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # A folder is a ROS 2 bag: its database is damaged alone, as one that was copied without the rest.
        whole = [] if "--only" in sys.argv else list(log_files.write(folder).values())
        own = [file for path in whole for file in ([path] if path.is_file() else path.glob("*.db3"))]
        (folder / "damaged").mkdir()
        end, cases, peak = time.monotonic() + float(sys.argv[1]), 0, 0
        case: tuple[int, Path] = (seed, folder)
        said: Any
        while time.monotonic() < end:
            heard, told = context.Pipe(duplex=False)
            arguments = (own + given, folder / "damaged", seed, end - time.monotonic(), told)
            worker = context.Process(target=_cases, args=arguments)
            worker.start()
            told.close()
            while True:
                try:
                    said = heard.recv() if heard.poll(_HUNG_S) else (f"{case[1].name}: hangs", 0)
                except EOFError:
                    worker.join()
                    said = (f"{case[1].name}: ended the interpreter, exit code {worker.exitcode}", 0)
                if said is None:
                    break
                if isinstance(said[1], Path):
                    case = said
                    continue
                complaint, peak, cases = said[0], max(peak, said[1]), cases + 1
                seed = case[0] + 1
                if complaint is not None and (last := complaint.splitlines()[-1]) not in found:
                    found[last] = kept / f"{case[0]}-{case[1].name}"
                    found[last].write_bytes(case[1].read_bytes())
                    print(f"{found[last]}: {complaint}", flush=True)
                if said[1] == 0:
                    worker.kill()
                    break
            worker.join()
    print(f"{cases} damaged logs, {len(found)} not handled, {peak} MiB at most; kept in {kept}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
