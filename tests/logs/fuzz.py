"""Damaged logs: every reader refuses them with its own error or reads what is left, fast and in bounded
memory.

``python -m tests.logs.fuzz SECONDS`` goes on for that long over one log of every format and files given
after.
"""

from __future__ import annotations

import sys
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np

from seatrial.base.errors import SeatrialError
from seatrial.logs.formats import open_log

_PIECES = (b"nan,", b"1e999", b"\xff\xff\xff\x7f", b"-1  ", b"\n\n\n\n", b'",",', b"\0\0\0\0", b"9" * 40)
_LARGE = 400_000
_SLOW_S = 30.0  # a hang, on any machine


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


def main() -> int:
    """Fuzz for some seconds; exit code 1 where something was found."""
    import resource

    from tests.logs import log_files

    seconds, given = float(sys.argv[1]), [Path(name) for name in sys.argv[2:]]
    rng = np.random.default_rng(int(time.time()))
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = [path for path in log_files.write(folder).values() if path.is_file()] + given
        (folder / "damaged").mkdir()
        end, cases = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            source = logs[int(rng.integers(len(logs)))]
            path = folder / "damaged" / source.name
            path.write_bytes(mutated(source.read_bytes(), rng))
            complaint = survives(path)
            cases += 1
            if complaint is not None and complaint.splitlines()[-1] not in found:
                found[complaint.splitlines()[-1]] = complaint
                print(complaint, flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"{cases} damaged logs, {len(found)} not handled, {peak} MiB at most")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
