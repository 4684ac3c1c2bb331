"""Run directories: whole or not at all, resumable, for one writer, and clear about what stops them."""

from __future__ import annotations

import errno
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap
from pathlib import Path

import polars as pl
import pytest
from typer.testing import CliRunner

from seatrial.base.errors import SeatrialError, TrialError
from seatrial.base.files import only_user, whole_folder, write_atomic, write_table
from seatrial.base.run import (
    RUN_FILE,
    Kind,
    RunDirectory,
    belongs_to_run,
    check_writable,
    from_json,
    part_file,
    run_facts,
    to_json,
)
from seatrial.base.work import Clock
from seatrial.cli import app
from seatrial.export import c_code
from seatrial.intake.imported import import_logs

KEYS = [
    "kind", "name", "options", "seed", "started_utc", "finished_utc", "wall_s", "interrupted", "versions",
    "simd", "platform", "sha256",
]  # fmt: skip


def publish(path: Path, name: str = "x", **files: str) -> None:
    with RunDirectory(path) as run:
        run.publish({"name": name}, {file.replace("_", "."): text for file, text in files.items()})


def name_in(path: Path) -> str:
    return str(json.loads((path / RUN_FILE).read_text())["name"])


def entries(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def test_published_directory_holds_every_file_and_no_trace_of_the_work(tmp_path: Path) -> None:
    with RunDirectory(tmp_path / "run") as run:
        run.leave("autopilot.toml", "of a run that was interrupted")
        assert run.publish({}, {"data/table.bin": b"\x00\x01"}) == tmp_path / "run"
    assert (tmp_path / "run/data/table.bin").read_bytes() == b"\x00\x01"
    assert entries(tmp_path) == ["run"]
    assert entries(tmp_path / "run") == ["data", RUN_FILE]
    assert not list((tmp_path / "run").rglob("*.writing"))


def test_second_run_replaces_the_first_as_a_whole(tmp_path: Path) -> None:
    publish(tmp_path / "run", "1", old_txt="old")
    publish(tmp_path / "run", "2")
    assert name_in(tmp_path / "run") == "2"
    assert entries(tmp_path / "run") == [RUN_FILE]
    assert entries(tmp_path) == ["run"]


def publish_kind(path: Path, kind: Kind, **files: str) -> None:
    with RunDirectory(path, kind) as run:
        facts = run_facts(kind, "x", clock=Clock().stop(), inputs={})
        run.publish(facts, {file.replace("_", "."): text for file, text in files.items()})


def test_a_run_of_another_kind_is_left_alone(tmp_path: Path) -> None:
    publish_kind(tmp_path / "run", "identification", vehicle_toml="fitted")
    words = r"expected an earlier flight or an empty folder, found a run of another kind \(identification\)"
    with pytest.raises(SeatrialError, match=words):
        RunDirectory(tmp_path / "run", "flight")
    with pytest.raises(SeatrialError, match=words):
        check_writable(tmp_path / "run", "flight")
    with RunDirectory(tmp_path / "run") as run, pytest.raises(SeatrialError, match=words):
        run.publish({"kind": "flight"}, {})
    assert (tmp_path / "run/vehicle.toml").read_text() == "fitted"
    assert entries(tmp_path) == ["run"]


def test_a_file_called_run_json_of_another_program_is_left_alone(tmp_path: Path) -> None:
    for text in ("{}", '{"kind": "marathon"}', "[1]", "no JSON"):
        (tmp_path / RUN_FILE).write_text(text)
        with pytest.raises(SeatrialError, match=r"found a run\.json of another program"):
            RunDirectory(tmp_path, "flight")


def test_a_tuning_of_parameters_replaces_the_replay_that_is_part_of_it(tmp_path: Path) -> None:
    publish_kind(tmp_path / "run", "replay")
    publish_kind(tmp_path / "run", "ardusub")
    with pytest.raises(SeatrialError, match=r"another kind \(ardusub\)"):
        publish_kind(tmp_path / "run", "replay")


def test_files_of_somebody_else_outlive_a_replaced_run(tmp_path: Path) -> None:
    run = tmp_path / "run"
    publish_kind(run, "flight", flight_json="old", seeds_csv="old")
    (run / "figures").mkdir()
    (run / "figures/track.png").write_text("drawn")
    belongs_to_run(run / "figures", [run / "figures/track.png"])
    (run / "figures/mine.png").write_text("mine")
    (run / "notes/empty").mkdir(parents=True)
    (run / "notes/my_notes.txt").write_text("mine")
    (run / "notes/link").symlink_to("nowhere")
    (run / "elsewhere").symlink_to(tmp_path)
    for _ in range(2):
        publish_kind(run, "flight", flight_json="new")
        assert (run / "flight.json").read_text() == "new"
        assert entries(run) == ["elsewhere", "figures", "flight.json", "notes", RUN_FILE]
        assert entries(run / "figures") == ["mine.png"]
        assert entries(run / "notes") == ["empty", "link", "my_notes.txt"]
        assert (run / "elsewhere").readlink() == tmp_path
        assert json.loads((run / RUN_FILE).read_text())["files"] == ["flight.json"]
    assert entries(tmp_path) == ["run"]


def test_a_run_that_does_not_tell_its_files_keeps_all_but_its_figures(tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / "figures").mkdir(parents=True)
    for name in ("figures/old.png", "my_notes.txt", "flight.json"):
        (run / name).write_text("old")
    (run / RUN_FILE).write_text('{"kind": "flight"}')
    publish_kind(run, "flight", flight_json="new")
    assert entries(run) == ["flight.json", "my_notes.txt", RUN_FILE]
    assert (run / "flight.json").read_text() == "new"


def test_a_full_disk_leaves_no_copy_of_what_is_somebody_elses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish_kind(tmp_path / "run", "flight")
    (tmp_path / "run/my_notes.txt").write_text("mine")
    run = RunDirectory(tmp_path / "run", "flight")

    def full(self: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "rename", full)
    with run, pytest.raises(SeatrialError, match="the disk is full"):
        run.publish({"kind": "flight"}, {})
    assert entries(tmp_path) == ["run"]
    assert (tmp_path / "run/my_notes.txt").read_text() == "mine"


def test_files_drawn_by_many_processes_are_all_noted(tmp_path: Path) -> None:
    run = tmp_path / "run"
    publish_kind(run, "flight")
    code = """
    from pathlib import Path
    from seatrial.base.run import belongs_to_run
    print("ready", flush=True)
    for number in range(20):
        belongs_to_run(Path(sys.argv[1]), [Path(sys.argv[1]) / f"{sys.argv[2]}-{number}.png"])
    """
    drawing = [other_process(code, run, letter) for letter in "abc"]
    assert [one.wait(60) for one in drawing] == [0, 0, 0]
    assert len(json.loads((run / RUN_FILE).read_text())["files"]) == 60


def test_the_root_is_no_run_and_the_folder_above_goes_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for call in (RunDirectory, lambda path: only_user(path).__enter__()):
        with pytest.raises(SeatrialError, match="/: expected a folder with a name of its own"):
            call("/")
    with pytest.raises(SeatrialError, match=f"{tmp_path}: it holds files but no run.json"):
        RunDirectory("..")
    with only_user(".."):
        assert (tmp_path.parent / f"{tmp_path.name}.lock").is_file()


def test_finished_part_is_found_again_only_for_the_same_inputs(tmp_path: Path) -> None:
    with RunDirectory(tmp_path / "run") as run:
        run.keep("turn left/right", "abc", {"cost": 1.5})
    with RunDirectory(tmp_path / "run") as resumed:
        assert resumed.finished("turn left/right", "abc") == {"inputs": "abc", "cost": 1.5}
        assert resumed.finished("turn left/right", "abd") is None
        assert resumed.finished("turn left_right", "abc") is None
    with RunDirectory(tmp_path / "run", resume=False) as fresh:
        assert fresh.finished("turn left/right", "abc") is None


def test_finished_part_survives_publishing_and_the_publishing_of_the_run_that_used_it(tmp_path: Path) -> None:
    with RunDirectory(tmp_path / "run") as run:
        run.keep("surge", "abc", {})
        run.publish({}, {})
    for _ in range(2):
        with RunDirectory(tmp_path / "run") as run:
            assert run.finished("surge", "abc") == {"inputs": "abc"}
            run.publish({}, {})


def test_parts_of_a_run_in_another_folder_are_brought(tmp_path: Path) -> None:
    with RunDirectory(tmp_path / "earlier") as run:
        run.keep("surge", "abc", {})
        run.publish({}, {})
    with RunDirectory(tmp_path / "run") as run:
        run.bring(tmp_path / "earlier", "surge")
        run.bring(tmp_path / "earlier", "heave")
        assert run.finished("surge", "abc") == {"inputs": "abc"}
        assert run.finished("heave", "abc") is None


def test_damaged_part_file_is_no_result(tmp_path: Path) -> None:
    with RunDirectory(tmp_path / "run") as run:
        run.keep("surge", "abc", {})
        file = run.workspace / part_file("surge")
        file.write_text(file.read_text()[:5])
        assert run.finished("surge", "abc") is None


def test_a_run_without_a_folder_keeps_nothing() -> None:
    with RunDirectory(None) as run:
        run.keep("surge", "abc", {})
        assert run.finished("surge", "abc") is None
        assert run.leave("autopilot.toml", "") is None
        with pytest.raises(ValueError, match="without"):
            run.publish({}, {})


def test_a_run_that_is_not_published_leaves_its_parts_and_nothing_else(tmp_path: Path) -> None:
    RunDirectory(tmp_path / "a/b/run").close()
    assert entries(tmp_path) == []
    with RunDirectory(tmp_path / "run") as run:
        run.keep("one", "a", {})
    check_writable(tmp_path / "run", "flight")
    assert entries(tmp_path) == ["run.partial"]
    assert entries(tmp_path / "run.partial") == ["stages"]


def test_every_verb_has_the_same_facts() -> None:
    facts = run_facts("flight", "out", clock=Clock().stop(), inputs={"vehicle": "0"}, seed=3)
    assert list(facts) == KEYS
    assert facts["versions"]["seatrial"]
    assert facts["versions"]["python"]


def other_process(code: str, *arguments: object) -> subprocess.Popen[str]:
    """A Python process that has printed a line, and goes on."""
    text = "import sys, time\nfrom seatrial.base.run import RunDirectory\n" + textwrap.dedent(code)
    process = subprocess.Popen(
        [sys.executable, "-c", text, *map(str, arguments)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.readline()
    return process


HOLD = """
run = RunDirectory(sys.argv[1])
run.keep("one", "a", {})
print("ready", flush=True)
time.sleep(600)
"""


def test_a_second_writer_is_refused_at_once_and_a_killed_one_is_no_obstacle(tmp_path: Path) -> None:
    other = other_process(HOLD, tmp_path / "run")
    try:
        with pytest.raises(SeatrialError) as refused:
            RunDirectory(tmp_path / "run")
        for words in (f"process {other.pid} on {socket.gethostname()}, since 20", "choose another folder"):
            assert words in str(refused.value)
        with pytest.raises(SeatrialError, match="in use by process"):
            check_writable(tmp_path / "run", "flight")
        assert entries(tmp_path) == ["run.lock", "run.partial"]
    finally:
        other.send_signal(signal.SIGKILL)
        other.wait()
    assert entries(tmp_path) == ["run.lock", "run.partial"]  # the lock file is stale
    with RunDirectory(tmp_path / "run") as run:
        assert run.finished("one", "a") is not None
        run.publish({}, {})
    assert entries(tmp_path) == ["run"]


def test_a_lock_file_that_says_nothing_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / "run.lock").write_text("garbage")
    publish(tmp_path / "run")
    assert entries(tmp_path) == ["run"]


def test_a_run_that_is_given_free_takes_another_one(tmp_path: Path) -> None:
    first = RunDirectory(tmp_path / "run")
    with pytest.raises(SeatrialError, match=f"in use by process {os.getpid()} on"):
        RunDirectory(tmp_path / "run")
    first.close()
    first.close()
    RunDirectory(tmp_path / "run").close()
    assert entries(tmp_path) == []


def test_a_run_that_nobody_closed_is_free_when_it_is_forgotten(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    run.keep("one", "a", {})
    del run
    assert entries(tmp_path) == ["run.partial"]


def test_writers_that_come_one_by_one_never_meet(tmp_path: Path) -> None:
    """law: whoever holds the lock is alone, also while others remove and make the lock file again."""
    code = """
    from seatrial.base.errors import SeatrialError
    from pathlib import Path
    print("ready", flush=True)
    held = 0
    end = time.monotonic() + 0.7
    while time.monotonic() < end:
        try:
            run = RunDirectory(sys.argv[1])
        except SeatrialError as refused:
            assert "in use" in str(refused), refused
            continue
        with run:
            (Path(sys.argv[1]).parent / "alone").mkdir()
            held += 1
            (Path(sys.argv[1]).parent / "alone").rmdir()
    print(held)
    """
    others = [other_process(code, tmp_path / "run") for _ in range(3)]
    said = [other.communicate()[0] for other in others]
    assert [other.returncode for other in others] == [0, 0, 0]
    assert all(int(text) > 0 for text in said)


def test_a_process_killed_between_the_two_renames_leaves_the_former_run(tmp_path: Path) -> None:
    publish(tmp_path / "run", "former")
    code = """
    import os, signal
    from pathlib import Path
    renamed = Path.rename
    def killed(self, target):
        if self.name == "run.partial":
            print("ready", flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
        return renamed(self, target)
    Path.rename = killed
    with RunDirectory(sys.argv[1]) as run:
        run.keep("one", "a", {})
        run.publish({"name": "latter"}, {})
    """
    assert other_process(code, tmp_path / "run").wait() == -signal.SIGKILL
    assert not (tmp_path / "run").exists()
    with RunDirectory(tmp_path / "run") as run:
        assert name_in(tmp_path / "run") == "former"
        assert run.finished("one", "a") is not None
        run.publish({"name": "latter"}, {})
    assert name_in(tmp_path / "run") == "latter"
    assert entries(tmp_path) == ["run"]


def test_law_killed_at_any_change_the_directory_is_whole_and_the_run_goes_on(tmp_path: Path) -> None:
    """kill -9 in front of the n-th change of the file system: one run is whole, and no part is lost."""
    code = """
    import os, signal
    from pathlib import Path
    left = 0
    def counted(call):
        def counting(*given, **options):
            global left
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            return call(*given, **options)
        return counting
    os.fsync = lambda descriptor: None  # slow, and of use only when the power fails
    for change in ("replace", "rename", "fsync", "unlink", "mkdir", "rmdir"):
        setattr(os, change, counted(getattr(os, change)))
    for number in range(1, 30):
        folder = Path(sys.argv[1]) / f"{number:02}"
        folder.mkdir()
        with RunDirectory(folder / "run") as run:
            run.publish({"name": "former"}, {})
        child = os.fork()
        if not child:
            left = number
            with RunDirectory(folder / "run") as run:
                run.keep("one", "a", {})
                run.keep("two", "a", {})
                run.publish({"name": "latter"}, {"big.txt": "b" * 100000})
            os._exit(0)
        _, ended = os.waitpid(child, 0)
        (folder / "ended").write_text(str(ended))
    print("ready", flush=True)
    """
    assert other_process(code, tmp_path).wait() == 0
    ended = [int((folder / "ended").read_text()) for folder in sorted(tmp_path.iterdir())]
    changes = ended.index(0)
    assert changes > 15
    assert ended == [signal.SIGKILL] * changes + [0] * (len(ended) - changes)
    names = []
    for folder in sorted(tmp_path.iterdir()):
        (folder / "ended").unlink()
        partial = folder / "run.partial"
        kept = {part for part in ("one", "two") if (partial / part_file(part)).exists()}
        with RunDirectory(folder / "run") as run:
            names.append(name_in(folder / "run"))
            assert {part for part in ("one", "two") if run.finished(part, "a")} >= kept
            run.publish({"name": "last"}, {})
        assert entries(folder) == ["run"]
        assert not list(folder.rglob("*.writing"))
    assert names == sorted(names)  # the former run, until the latter is there
    assert set(names) == {"former", "latter"}


def test_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(SeatrialError, match=r"no run\.json.*choose an empty or another folder"):
        RunDirectory(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "precious"


def test_file_in_the_place_of_the_directory(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("a file")
    with pytest.raises(SeatrialError, match="expected a folder, found a file"):
        RunDirectory(tmp_path / "run")


def test_directory_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SeatrialError, match=r"cannot be written.*choose a folder"):
        RunDirectory(tmp_path / "file" / "run")


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unwritable for the superuser")
def test_directory_without_permission(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(SeatrialError, match=r"cannot be written \(Permission denied\)"):
        RunDirectory(tmp_path / "run")


def test_full_disk_keeps_the_former_run_and_leaves_no_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish(tmp_path / "run", "former")
    run = RunDirectory(tmp_path / "run")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with run, pytest.raises(SeatrialError, match=r"the disk is full \(.* MiB free\)"):
        run.publish({"name": "latter"}, {"vehicle.toml": ""})
    assert name_in(tmp_path / "run") == "former"
    assert entries(tmp_path) == ["run"]


def test_json_nested_beyond_all_use_is_no_json() -> None:
    assert from_json('{"a": [1]}') == {"a": [1]}
    with pytest.raises(ValueError, match="nested too deeply"):
        from_json("[" * 100_000)


def test_json_has_null_for_numbers_that_are_not_finite() -> None:
    assert json.loads(to_json({"a": float("inf"), "b": (1, float("nan"), 2.5)})) == {
        "a": None,
        "b": [1, None, 2.5],
    }


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
def test_a_file_that_cannot_be_finished_leaves_the_former_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / name).write_text("former")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(TrialError, match=r"cannot be written \(No space left on device\)"):
        write_table(pl.DataFrame({"t_s": [0.0]}), tmp_path / name)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["former"]


@pytest.mark.parametrize("there", [False, True], ids=["new", "empty"])
@pytest.mark.parametrize(
    "arguments",
    [
        ["new", "p/q"],
        ["import", "log.csv", "--out", "p/q", "--figures", "none"],
        ["export", "c", "cwolf", "--out", "p/q"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_folder_that_cannot_be_finished_is_as_it_was(
    arguments: list[str], there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that is full at the first file or at a later one leaves no half of a project."""
    monkeypatch.chdir(tmp_path)
    # What is exported does not matter here, and folding what repeats takes most of an export.
    monkeypatch.setattr(c_code, "folded", str)
    (tmp_path / "log.csv").write_text(
        "time_s,u_m_s\n" + "".join(f"{0.1 * k:.1f},{0.01 * k:.2f}\n" for k in range(50))
    )
    if there:
        (tmp_path / "p/q").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    synced = os.fsync
    left = 0

    def full(descriptor: int) -> None:
        nonlocal left
        left -= 1
        if left < 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        synced(descriptor)

    for last in (1, 2):
        left = last
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", full)
            result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 2, result.output
        assert "No space left on device" in result.stderr
        assert sorted(tmp_path.rglob("*")) == before
    assert CliRunner().invoke(app, arguments).exit_code == 0


def test_a_folder_that_holds_something_keeps_what_was_finished_in_it(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "link").symlink_to("nowhere")
    with pytest.raises(FileExistsError), whole_folder(tmp_path):  # noqa: PT012
        (tmp_path / "new.txt").touch(exist_ok=False)
        (tmp_path / "mine.txt").touch(exist_ok=False)
    with pytest.raises(FileExistsError), whole_folder(tmp_path / "link"):
        pass
    assert entries(tmp_path) == ["link", "mine.txt", "new.txt"]


def test_of_many_writers_of_a_new_file_one_wins_and_its_file_is_whole(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from seatrial.base.files import write_atomic\n"
        "sys.stdin.readline()\n"
        "try: write_atomic(Path(sys.argv[1]), sys.argv[2].encode() * 100_000, new=True)\n"
        "except FileExistsError: sys.exit(3)"
    )
    path = tmp_path / "autopilot.toml"
    writers = [
        subprocess.Popen([sys.executable, "-c", code, str(path), letter], stdin=subprocess.PIPE)
        for letter in "abcd"
    ]
    for one in writers:
        assert one.stdin is not None
        one.stdin.write(b"go\n")
        one.stdin.flush()
    codes = [one.wait(60) for one in writers]
    for one in writers:
        assert one.stdin is not None
        one.stdin.close()
    assert sorted(codes) == [0, 3, 3, 3]
    assert path.read_text() == "abcd"[codes.index(0)] * 100_000
    assert [one.name for one in tmp_path.iterdir()] == ["autopilot.toml"]


def test_a_new_file_without_hard_links_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", none)
    write_atomic(tmp_path / "a.toml", b"first", new=True)
    with pytest.raises(FileExistsError):
        write_atomic(tmp_path / "a.toml", b"second", new=True)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["first"]


EXAMPLES = Path(__file__).parents[2] / "examples"
CWOLF = str(EXAMPLES / "cwolf" / "campaign.toml")
CAGE = str(EXAMPLES / "missions" / "cage_survey.toml")


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly", "cwolf", "cwolf", CAGE, "--figures", "none"],
        ["check", "cwolf"],
        ["check", CAGE],
        ["plan", "cwolf"],
        ["demo"],
        ["identify", CWOLF],
        ["tune", CWOLF],
        ["verify", CWOLF],
        ["bench", str(EXAMPLES / "t200" / "bench.toml"), "--figures", "none"],
    ],
    ids=lambda arguments: " ".join(Path(word).name for word in arguments),
)
def test_every_verb_that_writes_is_refused_a_folder_in_use(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The message names the process, and nothing is left behind."""
    monkeypatch.chdir(tmp_path)
    out = tmp_path / ("out.csv" if arguments[0] == "plan" else "out")
    with only_user(out):
        said = CliRunner().invoke(app, [*arguments, "--out", str(out)])
        assert said.exit_code == 2, said.output
        assert f"run directory {out}: expected to be its only user, found it in use by process" in said.stderr
        assert f"kill {os.getpid()}" in said.stderr
        assert [path.name for path in tmp_path.iterdir()] == [f"{out.name}.lock"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly", "cwolf", "cwolf", CAGE],
        ["realtime", "cwolf", "cwolf", CAGE, "--speed", "1000"],
        ["identify", CWOLF],
        ["tune", CWOLF],
        ["verify", CWOLF],
        ["rare", CWOLF],
        ["falsify", CWOLF],
        ["boundary", CWOLF, "current_speed_m_s=0:1"],
        ["verify-log", CWOLF, CWOLF],
        ["bench", str(EXAMPLES / "t200" / "bench.toml"), "--figures", "none"],
        ["ardusub", CWOLF],
        ["ardusub", CWOLF, "--replay-only"],
    ],
    ids=lambda arguments: " ".join(Path(word).name for word in arguments),
)
def test_every_verb_leaves_a_run_of_another_kind_alone(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refused before any work; nothing of the run, and nothing that somebody else put there, is gone."""
    monkeypatch.chdir(tmp_path)
    publish_kind(tmp_path / "out", "plan", plan_json="{}")
    (tmp_path / "out/my_notes.txt").write_text("mine")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    said = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "out")])
    assert said.exit_code == 2, said.output
    assert "found a run of another kind (plan), which is left alone; choose another folder" in said.stderr
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_an_import_is_refused_a_folder_in_use(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("time_s,u_m_s\n" + "".join(f"{0.1 * k:.1f},{0.01 * k:.2f}\n" for k in range(50)))
    with only_user(tmp_path / "project"), pytest.raises(SeatrialError, match="in use by process"):
        import_logs(log, out=tmp_path / "project")
    assert not (tmp_path / "project").exists()
    assert import_logs(log, out=tmp_path / "project").folder == tmp_path / "project"


@pytest.mark.parametrize("fixed", ["", "stages", "of another user"])
def test_a_run_that_cannot_be_replaced_is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fixed: str
) -> None:
    """And a former one that could not be removed is no reason to say that the new one was not written."""
    run = tmp_path / "run"
    with RunDirectory(run, "flight") as first:
        first.keep("a", "abc", {})
        first.publish({"kind": "flight"}, {})
    # Root may write anywhere: what an ordinary user may is told instead.
    may = os.access
    if fixed == "of another user":
        monkeypatch.setattr("seatrial.base.run.shutil.rmtree", lambda path, ignore_errors=False: None)
        publish_kind(run, "flight")
        former = tmp_path / ".run.former"
        assert former.is_dir()
        monkeypatch.undo()
        kept = former
    else:
        kept = run / fixed
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != kept and may(path, mode))
    with pytest.raises(
        SeatrialError, match=rf"run directory {kept}: cannot be written \(Permission denied\)"
    ):
        check_writable(run, "flight")
    monkeypatch.undo()
    publish_kind(run, "flight")
    assert entries(tmp_path) == ["run"]


def test_a_disk_that_is_full_for_polars_is_full_for_the_run(tmp_path: Path) -> None:
    """It writes large tables itself, and says so by an error of its own that quotes the system's."""

    def sink(path: Path) -> None:
        path.write_bytes(b"PAR1")
        raise pl.exceptions.ComputeError(f"parquet: No space left on device (os error {errno.ENOSPC})")

    with (
        RunDirectory(tmp_path / "run", "flight") as run,
        pytest.raises(SeatrialError, match="the disk is full"),
    ):
        run.publish({"kind": "flight"}, {"missions.parquet": sink})
    assert entries(tmp_path) == []
