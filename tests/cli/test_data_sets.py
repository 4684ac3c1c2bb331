"""Recordings come from a server with their hash, once, and never over another file."""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from typer.testing import CliRunner

from seatrial.base.errors import TrialError
from seatrial.base.files import data_folder
from seatrial.cli import app
from seatrial.cli.data import DATA_SETS, DataFile, DataSet, get

CONTENT = {"one.csv": b"t_s,u_m_s\n0,1\n", "two.csv": b"t_s,u_m_s\n0,2\n"}


class _Quiet(SimpleHTTPRequestHandler):
    asked: list[str] = []  # noqa: RUF012

    def log_message(self, *_: object) -> None:
        self.asked.append(self.path)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    root = tmp_path / "served"
    (root / "tank").mkdir(parents=True)
    for name, content in CONTENT.items():
        (root / "tank" / name).write_bytes(content)
    _Quiet.asked.clear()
    site = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(root)))
    thread = threading.Thread(target=site.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{site.server_port}", root / "tank"
    site.shutdown()
    thread.join()
    site.server_close()


@pytest.fixture
def folder(server: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of recordings, and a data set whose original source is the server."""
    url = server[0]
    files = tuple(
        DataFile(name, hashlib.sha256(content).hexdigest(), len(content), f"{url}/tank/{name}")
        for name, content in CONTENT.items()
    )
    monkeypatch.setitem(DATA_SETS, "tank", DataSet("tank", "two trials", "MIT", files))
    monkeypatch.setenv("SEATRIAL_DATA", str(tmp_path / "data"))
    return tmp_path / "data" / "tank"


def test_files_are_fetched_once(folder: Path) -> None:
    assert get("tank") == {folder / "one.csv": True, folder / "two.csv": True}
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == CONTENT
    asked = len(_Quiet.asked)
    assert get("tank") == {folder / "one.csv": False, folder / "two.csv": False}
    assert len(_Quiet.asked) == asked


@pytest.mark.parametrize(
    "content", [b"t_s,u_m_s\n0,9\n", b"t", b"x" * 5_000_000], ids=["other", "cut", "huge"]
)
def test_another_file_than_the_published_one_is_not_kept(
    folder: Path, server: tuple[str, Path], content: bytes
) -> None:
    (server[1] / "two.csv").write_bytes(content)
    with pytest.raises(TrialError, match=r"two\.csv: expected .*(found another|found more).*--from"):
        get("tank")
    assert [path.name for path in folder.iterdir()] == ["one.csv"]


def test_a_file_that_is_there_is_never_overwritten(folder: Path) -> None:
    folder.mkdir(parents=True)
    (folder / "one.csv").write_text("mine")
    with pytest.raises(TrialError, match=r"one\.csv: expected SHA-256 .*, found .*; move it away"):
        get("tank")
    assert (folder / "one.csv").read_text() == "mine"


def test_a_mirror_takes_the_place_of_the_source(
    folder: Path, server: tuple[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    url = server[0]
    dead = tuple(DataFile(one.name, one.sha256, one.size) for one in DATA_SETS["tank"].files)
    monkeypatch.setitem(DATA_SETS, "tank", DataSet("tank", "two trials", "MIT", dead, "ask the authors"))
    with pytest.raises(TrialError, match="no site has this file: ask the authors"):
        get("tank")
    assert all(get("tank", source=f"{url}/").values())
    assert folder.is_dir()


@pytest.mark.parametrize(
    ("name", "source", "message"),
    [
        ("tonk", None, 'there is no data set "tonk"; did you mean "tank"'),
        ("tank", "ftp://x", "expected a URL that begins with https"),
        ("tank", "http://127.0.0.1:9", r"cannot be fetched .*check the network, or name a mirror"),
        ("tank", "file:///etc", "expected a URL that begins with https"),
    ],
)
def test_what_cannot_be_fetched_is_said(folder: Path, name: str, source: str | None, message: str) -> None:
    with pytest.raises(TrialError, match=message):
        get(name, source=source)
    assert not folder.exists() or not list(folder.iterdir())


def test_a_missing_page_is_said(folder: Path, server: tuple[str, Path]) -> None:
    (server[1] / "one.csv").unlink()
    with pytest.raises(TrialError, match="404"):
        get("tank")


def test_the_verb_fetches_lists_and_refuses(folder: Path, server: tuple[str, Path]) -> None:
    call = partial(CliRunner().invoke, app)
    answer = call(["data", "get", "tank", "--from", server[0]])
    assert answer.exit_code == 0, answer.output
    assert "2 files in" in answer.output
    again = json.loads(call(["data", "get", "tank", "--json"]).output)
    assert again["sets"]["tank"] == {str(folder / name): False for name in CONTENT}
    listed = json.loads(call(["data", "list", "--json"]).output)
    assert {one["name"]: one["files"] for one in listed["sets"]}["tank"] == "2 of 2"
    assert call(["data", "get"]).exit_code == 2
    assert call(["data", "get", "nothing"]).exit_code == 2


def test_published_hashes_are_those_of_the_recordings() -> None:
    held = os.environ.get("SEATRIAL_DATA", "")
    if not held:
        pytest.skip("SEATRIAL_DATA is not set")
    here = [name for name, one in DATA_SETS.items() if (Path(held) / one.folder).is_dir()]
    if not here:
        pytest.skip("no published recording is in SEATRIAL_DATA")
    for name in here:
        for path, fetched in get(name).items():
            assert not fetched
            assert path.stat().st_size in {one.size for one in DATA_SETS[name].files}


def test_a_campaign_finds_recordings_in_the_users_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from seatrial.base.errors import CampaignError
    from seatrial.base.toml_file import file_path

    monkeypatch.delenv("SEATRIAL_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(CampaignError, match=r"is not set; .* or fetch recordings with seatrial data get"):
        file_path("${SEATRIAL_DATA}/beluga/a.csv", tmp_path, "c.toml")
    data_folder().mkdir(parents=True)
    found = file_path("${SEATRIAL_DATA}/beluga/a.csv", tmp_path, "c.toml")
    assert found == tmp_path / "seatrial" / "beluga" / "a.csv"
