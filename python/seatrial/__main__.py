"""Start of the command line, as `seatrial` and as `python -m seatrial`, ready for Ctrl-C from the start.

Loading what a verb needs takes some tenths of a second. Nothing is at stake then, and an exception inside an
import may end as another one or be swallowed: the process leaves at once. Once a verb begins, `seatrial.cli`
answers.
Held by tests/cli/test_cli_start.py.
"""

from __future__ import annotations

import os
import signal

TYPE_CHECKING = False  # as `typing` has it, whose import costs more than this file
if TYPE_CHECKING:
    from types import FrameType

_INTERRUPTED = 130  # exit code of a shell: 128 and the number of SIGINT


def main() -> None:
    """Run the command line."""
    python_answers = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if python_answers:  # not where Ctrl-C is ignored, as behind nohup
        signal.signal(signal.SIGINT, _leave)
    from seatrial.base.work import one_for_this_process

    one_for_this_process()
    from seatrial.cli import main as command_line

    command_line(begins=_answer if python_answers else None)


def _answer() -> None:
    """Let Python answer Ctrl-C again: a verb ends by itself, with what it keeps."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(_signal: int, _frame: FrameType | None) -> None:
    os.write(2, b"seatrial: interrupted\n")
    os._exit(_INTERRUPTED)


if __name__ == "__main__":
    main()
