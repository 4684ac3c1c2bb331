"""Run directory: the one life cycle of everything that writes results into a folder.

A run works in a sibling folder ``<name>.partial``. There every finished part (a stage, a group of gains, a
chunk of missions) is kept as ``stages/<part>.json`` with the hash of its inputs, and a table that belongs to
it as ``stages/<part>.parquet``. The same command finds it again by that hash: after Ctrl-C, ``kill -9``, or
after the run was published. When the run is over, the whole folder is renamed into place, so that a
reader sees all of it or nothing. While a process works in the folder it holds ``<name>.lock``, and a second
one is refused at once.

A run replaces an earlier one of its own kind alone, and of that only what the earlier one wrote: files that
somebody else put into the folder are there afterwards, too.

``run.json`` has the same keys in every verb (`run_facts`):

=============== ====================================================================================
kind            identification, plan, tuning, verification, log verdict, flight, bench test and so on
                (`Kind`)
name            of the campaign, the mission or the bench file
options         what the caller asked for beside the files, by name
seed            of all random numbers, null without any
started_utc     time at which the work began, ISO 8601
finished_utc    time at which its results were complete
wall_s          time that it took, s
interrupted     whether Ctrl-C ended it early
versions        of seatrial, of the packages that numbers depend on, and of Python
simd            instruction set that the core ran on
platform        operating system and machine
sha256          SHA-256 of every input, by name
files           what `RunDirectory.publish` wrote, and what was drawn into the folder later (`belongs_to_run`)
=============== ====================================================================================

Held by ``tests/base/test_run.py``.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import math
import os
import platform
import shutil
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Self, TypeVar, get_args

from seatrial._core import simd_level
from seatrial.base.errors import SeatrialError
from seatrial.base.files import (
    absolute,
    file_name,
    lock,
    make_folders,
    refusal,
    refuse_name,
    remove,
    unlock,
    write_atomic,
)
from seatrial.base.report import Reported
from seatrial.base.work import Clock, one_blas_thread

T = TypeVar("T")

Content = str | bytes | Callable[[Path], None]
"""What stands in a file, or what writes it to a path: for a table that memory may not hold."""

RUN_FILE = "run.json"
"""The file that makes a folder a run directory."""

Kind = Literal[
    "ardusub", "bench test", "failure boundary", "falsification", "flight", "identification", "leave one out",
    "log verdict", "plan", "rare failures", "replay", "tuning", "verification",
]  # fmt: skip
"""What ``run.json`` calls a run."""

_PARTS = "stages"

_FIGURES = "figures"
"""Folder of figures in a run directory."""

_FILES = "files"
"""Key of ``run.json``."""

_CONTAINS: Mapping[str, tuple[str, ...]] = {"ardusub": ("replay",)}
"""Kinds whose files are among those of another one, which may therefore replace them."""

_PACKAGES = ("seatrial", "numpy", "scipy", "cma", "polars")


class RunDirectory:
    """Folder of one run, locked until the run is published or closed. Use it in a ``with`` statement.

    `path`: made when it does not exist; an earlier run's is replaced by `publish`; None: nothing is kept, so
    that a caller needs no second path through its code. `kind`: of the run: a folder with one of another kind
    is refused now rather than by `publish`. `resume`: whether `finished` finds what an earlier run kept.
    Raises `SeatrialError`: the folder cannot be written, holds something that is not a run or one of another
    kind, or another process works in it.
    """

    def __init__(self, path: str | Path | None, kind: Kind | None = None, *, resume: bool = True) -> None:
        self.path = None if path is None else absolute(path)
        self.kind = kind
        self.resume = resume
        self._temporary: set[str] = set()  # entries of the workspace that only a published run needs
        self._carried: set[str] = set()
        self._limit = one_blas_thread()  # while the run is worked on
        self._made: list[Path] = []
        self._release: weakref.finalize[..., Any] | None = None
        if self.path is None:
            return
        refuse_name(self.path)
        try:
            self._made = make_folders(self.path.parent)
            self._release = weakref.finalize(self, unlock, *lock(self.path))
            self._open()
        except OSError as error:
            self.close()
            raise refusal(self.workspace, error) from None
        except BaseException:
            self.close()
            raise

    @property
    def workspace(self) -> Path:
        """Folder that is renamed into place when the run is published."""
        return _beside(self.path, "{}.partial")

    def __enter__(self) -> Self:
        self._limit.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._limit.__exit__(kind, error, trace)
        self.close()

    def finished(self, part: str, inputs: str) -> dict[str, Any] | None:
        """Result of a part that an earlier run finished from the same inputs, if there is one."""

        def usable(content: bytes) -> dict[str, Any] | None:
            kept = from_json(content.decode())
            return kept if isinstance(kept, dict) and kept.get("inputs") == inputs else None

        return self._kept(part_file(part), usable) if self.resume else None

    def table(self, part: str, expected: str) -> bytes | None:
        """Content of the table that belongs to a part, if it is there and has this SHA-256."""
        name = part_file(part, ".parquet")
        return self._kept(name, lambda content: content if sha256(content) == expected else None)

    def _kept(self, name: str, usable: Callable[[bytes], T | None]) -> T | None:
        """What can be used of a file of the workspace, else of the run directory, which then goes with it."""
        if self.path is None:
            return None
        for folder in (self.workspace, self.path):
            try:
                kept = usable((folder / name).read_bytes())
            except (OSError, ValueError):  # not kept, or not whole: the part is computed again
                continue
            if kept is not None:
                if folder == self.path:
                    self._carried.add(name)
                return kept
        return None

    def keep(self, part: str, inputs: str, result: Mapping[str, Any], *, table: bytes | None = None) -> None:
        """Keep the result of a finished part for a run that resumes this one, or raise a `SeatrialError`.

        `table` is the content of a Parquet file beside it, there before the part counts as finished.
        """
        if table is not None:
            self.leave(part_file(part, ".parquet"), table)
        self.leave(part_file(part), to_json({**result, "inputs": inputs}))

    def leave(self, name: str, content: Content) -> Path | None:
        """Path of a file that is written into the workspace, or a `SeatrialError`."""
        if self.path is None:
            return None
        target = self.workspace / name
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(target, content.encode() if isinstance(content, str) else content)
        except OSError as error:
            raise refusal(target, error) from None
        return target

    def bring(self, earlier: Path, part: str) -> None:
        """Copy a part that a run in another folder kept; it counts only where the hash of its inputs fits."""
        if self.path is None:
            return
        source, name = earlier / part_file(part), part_file(part)
        if source.is_file() and not (self.path / name).is_file():
            self.leave(name, source.read_bytes())

    def publish(self, facts: Mapping[str, Any], files: Mapping[str, Content]) -> Path:
        """Path of the run directory after its files, by name, are in place, all of them or none.

        `facts`: content of ``run.json``, see `run_facts`. Raises `SeatrialError`: they cannot be written, and
        what the run directory held before is still there.
        """
        if self.path is None:
            raise ValueError("publish: expected a run with a folder, found one without")
        _refuse_kind(self.path, facts.get("kind"))
        names = {RUN_FILE, *(Path(name).parts[0] for name in files)} - {_PARTS}
        self._temporary |= names
        facts = {**facts, _FILES: sorted(files)}
        try:
            for name in self._carried:
                if not (self.workspace / name).exists():
                    self.leave(name, (self.path / name).read_bytes())
            for name, content in {**files, RUN_FILE: to_json(facts)}.items():
                self.leave(name, content)
            self._sweep(self._temporary | {_PARTS})
            self._temporary |= _carry_foreign(self.path, self.workspace)
            self._rename()
        except OSError as error:
            raise refusal(self.path, error) from None
        self._unlock()
        return self.path

    def close(self) -> None:
        """Give the folder free. Kept parts stay; a workspace without any is removed."""
        if self._release is not None and self._release.alive:
            for name in self._temporary:
                with contextlib.suppress(OSError):  # a leftover in a hidden folder: the next run sweeps it
                    remove(self.workspace / name)
            for folder in (self.workspace / _PARTS, self.workspace):
                with contextlib.suppress(OSError):  # what else lies there stays
                    folder.rmdir()
        self._unlock()
        for folder in reversed(self._made):
            with contextlib.suppress(OSError):  # it holds the run, or what others put there
                folder.rmdir()
        self._made = []

    def _open(self) -> None:
        """Recover from a crash, refuse what is no run, and try whether the workspace takes a file."""
        assert self.path is not None
        former = _beside(self.path, ".{}.former")
        if former.is_dir() and not self.path.exists():  # killed between the two renames of `publish`
            former.rename(self.path)
        _refuse_content(self.path)
        if self.kind is not None:
            _refuse_kind(self.path, self.kind)
        for folder, _, _ in (*os.walk(former), *os.walk(self.path)):
            if not os.access(folder, os.W_OK | os.X_OK):  # after the work it could not be replaced
                raise refusal(Path(folder), PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
        remove(former)
        parts = self.workspace / _PARTS
        parts.mkdir(parents=True, exist_ok=True)
        for torn in parts.glob("*.writing"):
            torn.unlink()
        probe = self.workspace / ".probe"
        write_atomic(probe, b"\0" * 4096)
        probe.unlink()

    def _sweep(self, wanted: set[str]) -> None:
        """Remove from the workspace what an earlier run left there and this one does not publish."""
        for entry in self.workspace.iterdir():
            if entry.name not in wanted:
                remove(entry)
        with contextlib.suppress(OSError):  # it stays where it holds parts
            (self.workspace / _PARTS).rmdir()

    def _rename(self) -> None:
        """Put the workspace in the place of the run directory."""
        assert self.path is not None
        former = _beside(self.path, ".{}.former")
        if self.path.exists():
            self.path.rename(former)
        try:
            self.workspace.rename(self.path)
        except OSError:  # said by who called; the former run is back in its place
            if former.exists():
                former.rename(self.path)
            raise
        if former.exists():
            _carry_foreign(former, self.path)  # what came while the folders changed places
            shutil.rmtree(former, ignore_errors=True)  # the next run says what lasts

    def _unlock(self) -> None:
        if self._release is not None:
            self._release()


class RunResult(Reported, ABC):
    """A result of a run, with ``facts`` for ``run.json`` (`run_facts`) and `files` that `save` writes."""

    if TYPE_CHECKING:
        facts: Mapping[str, Any]

    @abstractmethod
    def files(self) -> Mapping[str, Content]:
        """Files of the run directory by name, see `save`."""

    def save(self, run_dir: str | Path) -> Path:
        """Path of a run directory with all results: tables, JSON, summary and inputs.

        Parameters
        ----------
        run_dir : str or Path
            Made when it does not exist; an earlier run of this kind is replaced.

        Raises
        ------
        SeatrialError
            The directory cannot be written, holds a run of another kind, or another process works in it;
            nothing is left half-written.
        """
        with RunDirectory(run_dir) as run:
            return run.publish(self.facts, self.files())


def check_writable(path: str | Path, kind: Kind) -> None:
    """Refuse a run directory that a run of this kind cannot write, before a long run; nothing stays behind.

    Raises `SeatrialError`: see `RunDirectory`.
    """
    RunDirectory(path, kind).close()


def belongs_to_run(folder: Path, written: Iterable[Path]) -> None:
    """Note what was written into a published run: it goes with the run when another one replaces that.

    `folder`: run directory, or its folder of figures; nothing happens where it is neither; `written`: files
    in it. Raises `OSError`: the run's ``run.json`` cannot be written.
    """
    run = folder.parent if folder.name == _FIGURES and not (folder / RUN_FILE).is_file() else folder
    names = {path.relative_to(run).as_posix() for path in written}
    if not (run / RUN_FILE).is_file():
        return
    with _alone_in(run):
        facts = _facts_in(run)
        known = facts.get(_FILES)
        if isinstance(known, list) and not names <= set(known):
            write_atomic(run / RUN_FILE, to_json({**facts, _FILES: sorted({*known, *names})}).encode())


def run_facts(
    kind: Kind,
    name: str,
    *,
    clock: Clock,
    inputs: Mapping[str, str],
    seed: int | None = None,
    options: Mapping[str, Any] | None = None,
    interrupted: bool = False,
) -> dict[str, Any]:
    """Content of ``run.json``: what a result rests on. The keys are listed at the head of this module.

    `clock`: started with the work; `inputs`: SHA-256 by name.
    """
    return {
        "kind": kind,
        "name": name,
        "options": dict(options or {}),
        "seed": seed,
        "started_utc": clock.started.isoformat(timespec="seconds"),
        "finished_utc": clock.reached.isoformat(timespec="seconds"),
        "wall_s": clock.elapsed_s,
        "interrupted": interrupted,
        "versions": {package: version(package) for package in _PACKAGES}
        | {"python": platform.python_version()},
        "simd": simd_level(),
        "platform": platform.platform(),
        "sha256": dict(inputs),
    }


def version(package: str) -> str:
    """Version of an installed package."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def sha256(content: str | bytes) -> str:
    """SHA-256 of a text or of bytes, hexadecimal."""
    given = content.encode(errors="surrogatepass") if isinstance(content, str) else content
    return hashlib.sha256(given).hexdigest()


def part_file(part: str, ending: str = ".json") -> str:
    """Name inside the run directory of the file that keeps a part; different parts have different names."""
    safe = file_name(part, instead="_")
    tail = "" if safe == part else "-" + sha256(part)[:8]
    return f"{_PARTS}/{safe}{tail}{ending}"


def from_json(text: str) -> Any:
    """The data of a JSON text.

    Raises `ValueError`: the text is no JSON, or is nested deeper than any file that seatrial writes.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def to_json(value: Any) -> str:
    """JSON text; a number that is not finite becomes null, because JSON has none."""
    return json.dumps(_plain(value), indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _beside(path: Path | None, pattern: str) -> Path:
    if path is None:
        raise ValueError("expected a run with a folder, found one without")
    return path.with_name(pattern.format(path.name))


@contextlib.contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Nobody else changes the ``run.json`` of a published run; its lock may be held by our own verb."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _facts_in(folder: Path) -> dict[str, Any]:
    """Content of the ``run.json`` of a folder; empty where there is none that can be read."""
    try:
        facts = from_json((folder / RUN_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):  # no run of ours: who asks refuses the folder
        return {}
    return facts if isinstance(facts, dict) else {}


def _carry_foreign(source: Path, target: Path) -> set[str]:
    """Put what somebody else left in a run into the one that replaces it; the entries of that, by name.

    A file keeps its inode where the file system has hard links. A name that the new run has stays the run's.
    """
    carried = set()
    for name in _foreign(source) if source.is_dir() else ():
        old, new = source / name, target / name
        if os.path.lexists(new):
            continue
        carried.add(name.parts[0])
        new.parent.mkdir(parents=True, exist_ok=True)
        if old.is_dir() and not old.is_symlink():
            new.mkdir()
            continue
        try:
            os.link(old, new, follow_symlinks=False)
        except OSError:  # a file system without hard links; a copy that fails is said
            shutil.copy2(old, new, follow_symlinks=False)
    return carried


def _foreign(run: Path) -> Iterator[Path]:
    """Files, links and empty folders in a run that the run did not write, relative to it."""
    known = _facts_in(run).get(_FILES)
    # Before runs told their files, what lay in these two folders was theirs.
    folders = (_PARTS,) if isinstance(known, list) else (_PARTS, _FIGURES)
    own = {RUN_FILE, *map(str, known if isinstance(known, list) else ())}

    def refuse(error: OSError) -> None:
        raise error

    for top, inside, files in os.walk(run, onerror=refuse):
        place = Path(top)
        links = [name for name in inside if (place / name).is_symlink()]
        empty = [] if inside or files or place == run else [place]
        for path in (*empty, *(place / name for name in (*links, *files))):
            name = path.relative_to(run)
            if name.parts[0] not in folders and name.as_posix() not in own:
                yield name


def _refuse_content(path: Path) -> None:
    if not path.exists():
        return
    if not path.is_dir():
        raise SeatrialError(f"run directory {path}: expected a folder, found a file; choose another name")
    if any(path.iterdir()) and not (path / RUN_FILE).is_file():
        raise SeatrialError(
            f"run directory {path}: it holds files but no {RUN_FILE}, so it is no earlier run"
            " and is left alone; choose an empty or another folder"
        )


def _refuse_kind(path: Path, kind: object) -> None:
    """Refuse to replace a run by one of another kind."""
    if not (path / RUN_FILE).is_file():
        return
    earlier = _facts_in(path).get("kind")
    if earlier != kind and earlier not in _CONTAINS.get(str(kind), ()):
        known = earlier in get_args(Kind)
        what = f"a run of another kind ({earlier})" if known else f"a {RUN_FILE} of another program"
        raise SeatrialError(
            f"run directory {path}: expected an earlier {kind} or an empty folder, found {what}, which is"
            " left alone; choose another folder, or move this one away"
        )
