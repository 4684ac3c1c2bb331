"""A page of a run: all that the run says, nothing from the network, and its files come out unharmed."""

from __future__ import annotations

import json
import os
import re
import shutil
import struct
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import seatrial as st
from seatrial.base.errors import SeatrialError
from seatrial.base.report import Report
from seatrial.base.run import sha256
from seatrial.cli import app
from seatrial.report.page.page import ELEMENT, as_embedded, files_of_page, script_json, unpack, write_page
from seatrial.report.page.run_folder import RunFolder
from tests.docs.pages import ROOT

MISSION = """
format = 1
name = "</script><b>out & \\"back\\""
speed_m_s = 1.5
acceptance_radius_m = 5.0
[[legs]]
north_m = 40.0
east_m = 0.0
depth_m = 3.0
"""

SVG = (
    f"""data:image/svg+xml,<svg><path d='M 1.234 2'/><use x='1.23'/><path d='M1.2 2{"L3.9 4" * 40}'/></svg>"""
)

VOID = {"meta", "img", "input", "br", "link", "path", "rect", "line", "hr"}


class Tags(HTMLParser):
    """Elements of a page: well nested, their ids, what they load, and their text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.targets: list[str] = []
        self.loads: list[str] = []
        self.images: list[tuple[str, str]] = []
        self.seen: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag not in VOID:
            self.open.append(tag)
        if "id" in given:
            self.ids.append(str(given["id"]))
        if tag == "a":
            self.targets.append(str(given["href"]))
        if tag == "img":
            self.images.append((str(given["src"]), str(given["alt"])))
        self.loads += [str(given[key]) for key in ("src", "srcset", "data") if key in given]
        assert tag != "link"

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("script", "style"):
            self.seen.append(data)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run directory of a short flight with a name that would like to be markup, one figure drawn."""
    folder = tmp_path_factory.mktemp("page") / "flown"
    st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION), seed=3).save(folder)
    figures = folder / "figures"
    figures.mkdir()
    (figures / "errors.svg").write_text(
        '<?xml version="1.0"?><svg><!-- a -->\n<path d="M 1.234 2"/>'
        f'<use x="1.23456"/><path d="M 1.23456 2{" L 3.98765 4" * 40}"/></svg>'
    )
    (figures / "errors.png").write_bytes(b"older")
    (figures / "track.png").write_bytes(b"\x89PNG")
    return folder


@pytest.fixture(scope="module")
def written(run: Path) -> Path:
    return write_page([run], run.with_name("report.html"))


@pytest.fixture
def changed(written: Path, tmp_path: Path) -> Callable[[object], Path]:
    """Writes a page whose files are others than those of the run."""

    def write(entries: object) -> Path:
        page = tmp_path / "changed.html"
        text = written.read_text()
        inside = re.compile(rf'(<script[^>]*id="{ELEMENT}">).*?(</script>)', re.DOTALL)
        page.write_text(inside.sub(lambda found: found[1] + script_json(entries) + found[2], text))
        return page

    return write


def test_a_page_tells_the_run_and_loads_nothing(run: Path, written: Path) -> None:
    tags = Tags()
    tags.feed(written.read_text(encoding="utf-8"))
    assert tags.open == []
    assert len(tags.ids) == len(set(tags.ids))
    assert {target[1:] for target in tags.targets if target.startswith("#")} <= set(tags.ids)
    assert all(target.startswith("#") for target in tags.targets)
    assert all(load.startswith("data:image/") for load in tags.loads)
    text = " ".join("".join(tags.seen).split())
    report = RunFolder.read(run).report
    for sentence in (report.good, report.worst, report.next_step):
        assert " ".join(sentence.split())[1:-1] in text
    for table in (table for section in report.shown() for table in section.tables):
        for row in table.filled().rows:
            assert all(" ".join(cell.split()) in text for cell in row)
    facts = json.loads((run / "run.json").read_text())
    assert all(digest in text for digest in facts["sha256"].values())
    assert facts["versions"]["numpy"] in text
    # Words and symbols, and the coefficients of the run's vehicle.
    vehicle = st.Vehicle.load(run / "vehicle.toml")
    for meaning in ("Measured minus simulated.", vehicle.coefficient_info()["X_udot"]["description"]):
        assert meaning in text
    # The three views were drawn for the page; of two files of a figure the SVG counts, long paths shorter.
    assert len(tags.images) == 3
    assert SVG in {source for source, _ in tags.images}
    assert all(words for _, words in tags.images)


def test_the_last_section_names_what_others_wrote_with_versions_and_licences(written: Path) -> None:
    tags = Tags()
    tags.feed(
        "<section" + written.read_text(encoding="utf-8").rpartition("<section")[2].partition("</main>")[0]
    )
    notices = " ".join("".join(tags.seen).split())
    assert "Third-party notices" in notices
    libm = re.search(r'name = "libm"\nversion = "(.*)"', (ROOT / "Cargo.lock").read_text())
    assert libm
    assert f"libm {libm[1]}" in notices
    assert f"numpy {np.__version__}" in notices
    assert "Apache-2.0 OR MIT" in notices


def test_a_report_survives_its_way_through_plain_data(run: Path) -> None:
    kept = Report.of_dict(json.loads((run / "report.json").read_text()))
    assert kept.text() + "\n" == (run / "summary.txt").read_text()


def test_a_run_from_before_reports_were_kept_tells_its_three_lines(run: Path, tmp_path: Path) -> None:
    for name in ("run.json", "summary.txt"):
        (tmp_path / name).write_text((run / name).read_text())
    assert RunFolder.read(tmp_path).report.lines()[1:] == RunFolder.read(run).report.lines()[1:]


def test_the_files_come_back_as_they_were(run: Path, written: Path, tmp_path: Path) -> None:
    folder = tmp_path / "back"
    said = CliRunner().invoke(app, ["new", str(folder), "--from-report", str(written)])
    assert said.exit_code == 0, said.output
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["autopilot.toml", "mission.toml", "vehicle.toml"]
    assert all((folder / name).read_bytes() == (run / name).read_bytes() for name in names)
    again = st.fly(*(folder / f"{name}.toml" for name in ("vehicle", "autopilot", "mission")), seed=3)
    assert again.metrics == st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION), seed=3).metrics


def test_equal_files_of_several_runs_are_carried_once(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "flown"
    st.fly("cwolf", "cwolf", st.Mission.from_toml(MISSION.replace("40.0", "30.0"))).save(other)
    page = write_page([run, run, other], tmp_path / "two.html")
    assert sorted(files_of_page(page)) == [
        "flown/autopilot.toml", "flown/mission-2.toml", "flown/mission.toml", "flown/vehicle.toml",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "path",
    [
        "../evil.toml", "/etc/evil.toml", "a/../../evil.toml", "C:\\evil.toml", "a//b.toml", ".bashrc.toml",
        "evil.sh", "con.toml", "a\x00.toml", "a/b/c/d/e.toml", "x" * 200 + ".toml", "~/evil.toml", "",
    ],
)  # fmt: skip
def test_a_path_that_leads_elsewhere_is_refused(
    changed: Callable[[object], Path], tmp_path: Path, path: str
) -> None:
    page = changed([{"path": path, "sha256": sha256("x"), "text": "x"}])
    with pytest.raises(SeatrialError, match="not to be trusted"):
        unpack(page, tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ([{"path": "a.toml", "sha256": sha256("x"), "text": "y"}], "SHA-256"),
        (as_embedded({"a.toml": "x"}) * 2, "twice"),
        (as_embedded({"a.toml": "x", "a.toml/b.toml": "y"}), "also a file"),
        ([{"path": 1}], "no path, hash or text"),
        ({}, "expected a list"),
    ],
)
def test_a_changed_page_is_refused(
    changed: Callable[[object], Path], tmp_path: Path, entries: object, said: str
) -> None:
    with pytest.raises(SeatrialError, match=said):
        unpack(changed(entries), tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ("{}", "found no kind; repeat the run"),
        ('{"kind": 3, "versions": [1]}', r"found kind 3, versions \[1\]; repeat the run"),
    ],
)
def test_facts_that_no_run_wrote_are_bad_input(tmp_path: Path, facts: str, words: str) -> None:
    (tmp_path / "run.json").write_text(facts)
    (tmp_path / "summary.txt").write_text("One: it is\nTwo: bad\nThree: go on\n")
    with pytest.raises(SeatrialError, match=words):
        RunFolder.read(tmp_path)
    (tmp_path / "run.json").write_text('{"kind": "tuning"}')
    assert "Run directory" in write_page([tmp_path], tmp_path / "a.html").read_text()


def _link(target: str) -> Callable[[Path], object]:
    return lambda path: path.symlink_to(target)


def _bytes(content: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content)


def _picture(width: int, height: int) -> Callable[[Path], object]:
    return _bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II", width, height) + bytes(20))


@pytest.mark.parametrize(
    ("name", "made", "words"),
    [
        ("figures/z.svg", _link("/dev/zero"), "found a link to /dev/zero"),
        ("figures/z.png", _link("/etc/hostname"), "found a link to /etc/hostname"),
        ("figures/z.svg", os.mkfifo, "found a device, a pipe or a folder"),
        ("figures/z.svg", _link("z.svg"), "cannot be read"),
        ("figures/z.svg", _link("nowhere"), "cannot be read"),
        ("figures/z.svg", _bytes(b"\xff\xfe\0" * 100), "expected an SVG in UTF-8"),
        ("figures/z.svg", _bytes(b"<svg>" + b"<!--" * 1_000_000), "a comment in it has no end"),
        ("figures/z.svg", _bytes(b"<svg>" + b"<metadata>" * 1_000_000), "the metadata in it has no end"),
        ("figures/z.svg", _bytes(b" " * (16 * 2**20 + 1)), "expected at most 16 MiB, found more"),
        ("figures/z.png", _picture(30_000, 30_000), "found 30,000 by 30,000"),
        ("z.toml", _link("/etc/hostname"), "found a link to /etc/hostname"),
        ("z.toml", _link("/dev/zero"), "found a link to /dev/zero"),
        ("z.toml", os.mkfifo, "found a device, a pipe or a folder"),
        ("report.json", _link("/dev/zero"), "found a link to /dev/zero"),
        ("report.json", os.mkfifo, "found a device, a pipe or a folder"),
        ("report.json", _bytes(b"[" * 1_000_000), "nested too deeply"),
        ("report.json", _bytes(b'{"title": "a", "sections": 3}'), "expected a report as seatrial writes it"),
        ("flight.json", _bytes(b"[]"), "expected a JSON object"),
    ],
)
def test_a_foreign_run_gives_only_regular_files_of_its_own_and_of_bounded_size(
    run: Path, tmp_path: Path, name: str, made: Callable[[Path], object], words: str
) -> None:
    """No link out of the folder reaches a page, nothing that never ends is read, no text is read twice."""
    foreign = shutil.copytree(run, tmp_path / "foreign")
    place = foreign / name
    place.unlink(missing_ok=True)
    made(place)
    with pytest.raises(SeatrialError, match=words) as caught:
        write_page([foreign], tmp_path / "a.html")
    assert str(place) in str(caught.value)
    assert not (tmp_path / "a.html").exists()


def test_a_run_whose_vehicle_is_none_is_told_and_does_not_fly(run: Path, tmp_path: Path) -> None:
    foreign = shutil.copytree(run, tmp_path / "foreign")
    (foreign / "vehicle.toml").write_text('format = 1\nname = "x"\n')
    page = write_page([foreign], tmp_path / "a.html").read_text()
    assert "cannot fly in this page: vehicle.toml of" in page
    assert "Third-party notices" in page


@pytest.mark.parametrize("inside", [b"1" * 300_000, b" " * 300_000, b" M" * 150_000, b"1.2" * 100_000])
def test_law_the_time_of_a_figure_is_in_proportion_to_its_length(
    run: Path, tmp_path: Path, inside: bytes
) -> None:
    """Quadratic work would take hours: 10^10 steps at least."""
    foreign = shutil.copytree(run, tmp_path / "foreign")
    (foreign / "figures" / "z.svg").write_bytes(b'<svg><path d="' + inside + b'"/><!-- a --></svg>')
    assert "data:image/svg+xml" in write_page([foreign], tmp_path / "a.html").read_text()


def test_a_link_to_another_file_of_the_run_and_a_folder_named_like_a_figure_are_left_alone(
    run: Path, tmp_path: Path
) -> None:
    foreign = shutil.copytree(run, tmp_path / "foreign")
    (foreign / "figures" / "again.svg").symlink_to("errors.svg")
    (foreign / "figures" / "folder.svg").mkdir()
    (foreign / "folder.toml").mkdir()
    page = write_page([foreign], tmp_path / "a.html").read_text()
    assert 'alt="Again"' in page
    assert files_of_page(tmp_path / "a.html").keys() == {"vehicle.toml", "autopilot.toml", "mission.toml"}


def test_what_is_no_page_or_no_run_is_bad_input(written: Path, run: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.html"
    text = written.read_text()
    cut.write_text(text[: text.index(f'id="{ELEMENT}"') + 200])
    (tmp_path / "noise.html").write_bytes(bytes(range(256)))
    (tmp_path / "plain.html").write_text("<p>no page of ours</p>")
    (tmp_path / "run.json").write_text("{")
    calls = [
        *(["new", str(tmp_path / "n"), "--from-report", str(tmp_path / f"{name}.html")]
          for name in ("cut", "noise", "plain", "none")),
        ["new", str(run), "--from-report", str(written)],
        ["report", str(tmp_path / "nothing"), "-o", str(tmp_path / "a.html")],
        ["report", str(tmp_path), "-o", str(tmp_path / "a.html")],
        ["report", str(run.parent), "-o", str(tmp_path / "a.html")],
        ["report", str(run), "-o", str(tmp_path / "a.txt")],
        ["report", str(run), "-o", str(tmp_path / "none" / "a.html")],
    ]  # fmt: skip
    for call in calls:
        said = CliRunner().invoke(app, call)
        assert said.exit_code == 2, (call, said.output)
        assert len(said.stderr.strip().splitlines()) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "cut.html", "noise.html", "plain.html", "run.json",
    ]  # fmt: skip


def test_every_verb_that_writes_a_run_offers_a_page() -> None:
    command = typer.main.get_command(app)
    for verb in ("identify", "bench", "plan", "tune", "verify", "fly"):
        options = {name for one in command.commands[verb].params for name in one.opts}  # type: ignore[attr-defined]
        assert "--report" in options, verb
