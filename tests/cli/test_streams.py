"""Standard streams that are closed, full, cut or of few letters: no traceback, no exit code of a verdict."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from seatrial.cli.console import Code

CHECK = "check cwolf --figures none"
LIST = "data list"  # a report that takes no time
MISSED = "fly cwolf cwolf m.toml --figures none --max-time 20"  # ends with exit code 1
MISSION = """
format = 1
name = "ahead"
speed_m_s = 1.5
acceptance_radius_m = 5.0
limits = { max_depth_m = 20.0, max_time_s = 200.0 }
legs = [{ north_m = 100.0, east_m = 0.0, depth_m = 2.0 }]
"""


@pytest.fixture
def here(tmp_path: Path) -> Path:
    (tmp_path / "m.toml").write_text(MISSION)
    return tmp_path


def shell(here: Path, line: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """What a shell says to a line with ``seatrial`` in it."""
    defined = f'seatrial() {{ "{sys.executable}" -m seatrial "$@"; }}\nset -o pipefail\n'
    return subprocess.run(
        ["bash", "-c", defined + line],
        cwd=here,
        capture_output=True,
        timeout=120,
        env=os.environ | environment,
    )


@pytest.mark.parametrize("verb", [MISSED, LIST, "--help"])
def test_a_reader_that_goes_away_is_no_failed_verdict(here: Path, verb: str) -> None:
    """The reader is gone before the first letter; the files of the run are there."""
    done = shell(here, f"{{ seatrial {verb}; echo $? > code; }} | true; cat code")
    assert int(done.stdout) == Code.BROKEN_PIPE
    assert done.stderr == b""
    if "fly cwolf" in verb:
        assert (here / "runs/fly-cwolf-ahead/run.json").is_file()


@pytest.mark.parametrize("verb", [LIST, "--help"])
def test_what_a_closed_stream_would_show_is_dropped(here: Path, verb: str) -> None:
    closed = shell(here, f"seatrial {verb} >&-")
    assert (closed.returncode, closed.stderr) == (0, b"")
    unsaid = shell(here, f"seatrial {verb} <&- 2>&-")
    assert unsaid.returncode == 0
    assert len(unsaid.stdout) > 500


def test_all_streams_may_be_closed(here: Path) -> None:
    assert shell(here, f"seatrial {LIST} --json <&- >&- 2>&-").returncode == 0


def test_an_error_keeps_its_exit_code_where_nobody_hears_it(here: Path) -> None:
    for stream in ("2>&-", "2>/dev/full"):
        done = shell(here, f"seatrial check nowhere.toml {stream}")
        assert (done.returncode, done.stdout) == (2, b"")
    assert shell(here, f"seatrial {MISSED} 2>/dev/full").returncode == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no device that is always full")
@pytest.mark.parametrize("verb", [LIST, "--help"])
def test_a_full_output_is_named(here: Path, verb: str) -> None:
    done = shell(here, f"seatrial {verb} > /dev/full")
    assert done.returncode == 2
    assert done.stderr == (
        b"seatrial: standard output: No space left on device; free some space and run again\n"
    )


@pytest.mark.parametrize("verb", [CHECK, MISSED, "check nowhere\N{DEGREE SIGN}.toml"])
@pytest.mark.long
def test_a_terminal_of_few_letters_spells_signs(here: Path, verb: str) -> None:
    plain = shell(here, f"seatrial {verb}", PYTHONIOENCODING="ascii", LANG="C", LC_ALL="C", TERM="dumb")
    full = shell(here, f"seatrial {verb}", PYTHONIOENCODING="utf-8")
    assert plain.returncode == full.returncode
    assert b"Traceback" not in plain.stderr
    said, meant = (plain.stdout + plain.stderr).decode("ascii"), (full.stdout + full.stderr).decode()
    assert "?" not in said
    assert len(said.splitlines()) == len(meant.splitlines())
    if "\N{DEGREE SIGN}" in meant:
        assert "deg" in said


def test_a_working_directory_that_is_gone_is_said(here: Path) -> None:
    done = shell(here, "mkdir gone; cd gone; rmdir ../gone; seatrial check cwolf")
    assert done.returncode == 2
    assert b"seatrial: the working directory is gone; change to a folder that is there" in done.stderr


def test_a_path_of_no_encoding_is_shown(here: Path) -> None:
    done = shell(here, "seatrial check $'bad\\xff.toml'", PYTHONIOENCODING="utf-8")
    assert done.returncode == 2
    assert done.stderr.startswith(b"seatrial: bad")
    assert b"Traceback" not in done.stderr


@pytest.mark.parametrize(("columns", "kind"), [("20", "dumb"), ("300", "xterm-256color")])
def test_a_terminal_of_any_width_shows_a_report(here: Path, columns: str, kind: str) -> None:
    """On a terminal: standard output and error are a pseudo-terminal."""
    run = (
        "import os, pty, sys\n"
        "status = pty.spawn([sys.executable, '-m', 'seatrial', *sys.argv[1:]])\n"
        "sys.exit(os.waitstatus_to_exitcode(status))"
    )
    done = subprocess.run(
        [sys.executable, "-c", run, *CHECK.split()],
        cwd=here,
        capture_output=True,
        timeout=120,
        env=os.environ | {"COLUMNS": columns, "TERM": kind, "NO_COLOR": "1"},
    )
    assert done.returncode == 0, done.stdout
    assert b"Traceback" not in done.stdout
    assert b"cwolf" in done.stdout
