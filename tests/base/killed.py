"""Runs that another process makes and that `kill -9` ends."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

HEAD = """
import os, signal, sys
from pathlib import Path
folder = Path(sys.argv[1])
def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)
"""


def kill(code: str, folder: Path) -> None:
    """Run the code in a process of its own, with this ``folder``, until it calls ``die()``."""
    command = [sys.executable, "-c", HEAD + textwrap.dedent(code), str(folder)]
    repository = Path(__file__).parents[2]
    ended = subprocess.run(command, cwd=repository, capture_output=True, text=True, timeout=300)
    assert ended.returncode == -signal.SIGKILL, ended.stderr
