"""Start of the command line: Ctrl-C while libraries load, and help that is said whole."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import seatrial

# Sends the signal of Ctrl-C to the process itself when it begins to load a module.
FINGER = """
import os, signal, sys
class Finger:
    @staticmethod
    def find_spec(name, path=None, target=None):
        if name == {module!r}:
            sys.meta_path.remove(Finger)
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finger)
sys.argv = ["seatrial", "--version"]
"""
STARTS = {
    "seatrial": "from seatrial.__main__ import main\nsys.exit(main())",  # as the script of the package
    "python -m seatrial": "import runpy\nrunpy.run_module('seatrial', run_name='__main__', alter_sys=True)",
}
VERBS = (
    "demo", "new", "check", "simulate", "bench", "plan", "identify", "score", "autopilot", "fly", "tune",
    "verify",
)  # fmt: skip


def started(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | environment
    )


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("module", ["seatrial.cli", "typer", "numpy"])
def test_ctrl_c_while_libraries_load_ends_without_a_traceback(start: str, module: str) -> None:
    done = started(FINGER.format(module=module) + STARTS[start])
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "seatrial: interrupted\n")


def test_an_ignored_ctrl_c_stays_ignored() -> None:
    ignoring = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)"
    done = started(ignoring + FINGER.format(module="numpy") + STARTS["seatrial"])
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("seatrial ")


def test_python_answers_ctrl_c_again_once_a_verb_runs() -> None:
    """A verb ends by itself, with what it keeps: both come from `KeyboardInterrupt`."""
    asks = (
        "import signal, sys, seatrial.cli\n"
        "def verb(): print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)\n"
        "seatrial.cli.app.command('asked')(verb)\n"
        "sys.argv = ['seatrial', 'asked']\n"
    )
    assert started(asks + STARTS["seatrial"]).stdout == "True\n"


def test_ctrl_c_before_the_verb_is_known_ends_without_a_traceback() -> None:
    hurried = (
        "import os, signal, sys, typer.main\n"
        "def get_command(_): os.kill(os.getpid(), signal.SIGINT)\n"
        "typer.main.get_command = get_command\n"
    )
    done = started(hurried + STARTS["seatrial"])
    assert (done.returncode, done.stderr) == (130, "seatrial: interrupted\n")


def test_the_package_loads_nothing_before_it_is_asked() -> None:
    """Else Ctrl-C would meet an import before the command line is ready for it."""
    done = started(
        "import sys, seatrial\n"
        "print([name for name in sys.modules if name.startswith(('numpy', 'typing', 'typer', 'seatrial.'))])"
    )
    assert done.stdout == "[]\n"


def test_a_function_keeps_its_name_when_the_module_of_that_name_is_imported() -> None:
    names = ("identify", "score", "verify")
    modules = ("identification.identify", "scoring.score", "verification.verify")
    done = started(
        "import seatrial\n"
        + "".join(f"import seatrial.{name}\n" for name in modules)
        + f"print([callable(getattr(seatrial, name)) for name in {names}])"
    )
    assert done.stdout == "[True, True, True]\n"


def test_no_public_name_is_that_of_a_room() -> None:
    """An imported submodule becomes an attribute of the package and would hide a function of its name."""
    rooms = {path.name.removesuffix(".py") for path in Path(seatrial.__file__).parent.iterdir()}
    assert not rooms & set(seatrial.__all__)


def test_the_script_of_the_package_starts_where_ctrl_c_is_answered() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    assert project["project"]["scripts"] == {"seatrial": "seatrial.__main__:main"}


def test_help_cuts_nothing_at_80_columns() -> None:
    said = started(
        "import sys\nfrom typer.testing import CliRunner\nfrom seatrial.cli import app\n"
        f"for verb in [[]] + [[verb] for verb in {VERBS}]:\n"
        "    print(CliRunner().invoke(app, [*verb, '--help'], prog_name='seatrial').stdout)",
        COLUMNS="80",
    ).stdout
    assert said.count("Usage: seatrial") == 1 + len(VERBS)
    assert max(map(len, said.splitlines())) <= 80
    assert "\N{HORIZONTAL ELLIPSIS}" not in said
    words = " ".join(said.split())
    assert "autopilot; identify the AUV Beluga." in words  # the end of the first row of the list of verbs
    assert "Campaign file (TOML) with [tuning]." in words  # no style
    assert re.search(r"a margin falls short, after all\. Ctrl-C keeps the best so far", words)
