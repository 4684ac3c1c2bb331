"""The C compiler of this machine, a shared library by it, and programs that cannot outlive a limit.

A compiler is a driver that starts others; killing it alone leaves them, and their hold on its output. So a
program runs in a session of its own, and all of the session ends with it.
Tests: ``tests/export/test_fmu.py``.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from seatrial.base.errors import SimulationError

_LIMIT_S = 600.0  # a unit is built in half a minute

_OPTIONS: Sequence[str] = ("-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-fvisibility=hidden")


def c_compiler() -> str:
    """C compiler that is there, or nothing."""
    own = os.environ.get("CC", "")
    paths = (shutil.which(candidate) for candidate in (own, "cc", "gcc", "clang") if candidate)
    return next((path for path in paths if path), "")


def platform() -> str:
    """The platform's name in FMI 3.0."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(os.uname().machine, os.uname().machine)
    return f"{machine}-{'darwin' if sys.platform == 'darwin' else 'linux'}"


def ran(
    command: Sequence[str | Path],
    *,
    limit_s: float = _LIMIT_S,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """A program that ran to its end, without anything to read; its output as text.

    Parameters
    ----------
    command : sequence of str or Path
        Program and arguments.
    limit_s : float, optional
        After this time, s, the program and all that it started are killed.
    folder : Path, optional
        Where it runs; by default here.
    environment : mapping of str to str, optional
        Variables beside those of this process.

    Raises
    ------
    OSError
        It cannot be started.
    subprocess.TimeoutExpired, subprocess.CalledProcessError
        It took too long, or failed; its output is in the error.
    """
    with subprocess.Popen(
        [str(word) for word in command],
        cwd=folder,
        env=None if environment is None else os.environ | dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            output, errors = process.communicate(timeout=limit_s)
        except BaseException:
            # The session first: what it leaves behind would hold the pipes that the end waits for.
            with suppress(OSError):  # it has ended, and with it the session
                os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            raise
    completed = subprocess.CompletedProcess(process.args, process.returncode, output, errors)
    completed.check_returncode()
    return completed


def shared_library(sources: Mapping[str, str], compiled: Sequence[str], compiler: str) -> bytes:
    """The bytes of a shared library out of sources by name, of which the compiler is given some.

    Raises
    ------
    SimulationError
        The compiler fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text)
        try:
            ran([compiler, *_OPTIONS, *compiled, "-o", "unit.bin", "-lm"], folder=Path(folder))
        except (OSError, subprocess.SubprocessError) as error:
            output = getattr(error, "stderr", "") or str(error)
            raise SimulationError(
                f"{compiler}: cannot build the unit: {str(output).strip()[:400]}; set CC to a C99 compiler,"
                " or build none with --no-binary"
            ) from None
        return (Path(folder) / "unit.bin").read_bytes()
