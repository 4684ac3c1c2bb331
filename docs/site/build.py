"""Build of the documentation site: pages, reference and navigation gathered, Sphinx run, every link checked.

``python -m docs.site.build --out target/site --report runs/demo/report.html`` in the root of the clone; no
network. The pages are those of ``docs``: folders give the navigation, ``docs/index.md`` its order and short
titles; a page that the index does not name stands at the end of its folder. The reference is written from
docstrings, verbs and the models of the files (`reference`); formulas become MathML (`formulas`). The build
fails on a warning of Sphinx, a formula that does not convert, a link or an anchor that leads nowhere, and on
anything that a page would fetch from the network. Held by ``tests/docs/test_site.py``.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

HERE = Path(__file__).resolve().parent
DOCS = HERE.parent
REPORT = "report.html"

_LINK = re.compile(r"\[([^\]]+)\]\(([\w./-]+\.md)(?:#[\w-]+)?\)")
_TITLE = re.compile(r"^# (.+)$", re.MULTILINE)
# Links out of docs/ lead to sources, which a site has no copy of.
_SOURCE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+((?:crates|python|tests|benchmarks)/[^)\s]+)\)")

_NOTEBOOK = re.compile(r"(\]\([\w./-]+\.)ipynb(?=\))")

FLYING = """\
<iframe class="flying" src="report.html" loading="lazy"
 title="The report of the demo: a vehicle and its autopilot fly in the page"></iframe>
<p><a href="report.html">Open the report in a page of its own</a>. Change a gain, a coefficient, a waypoint
or the sea: the mission is flown again at once.</p>
"""
STILL = """\
![The report of the demo: CWolf flies its cage survey in the page](report.png)

This site was built without the report of the demo. `make demo` writes it; `make site` then shows it here, and
the vehicle flies.
"""


def pages(docs: Path) -> list[Path]:
    """Pages below a folder, as paths from it, without those of the generator."""
    found = (page.relative_to(docs) for page in docs.rglob("*.md"))
    return sorted(page for page in found if page.parts[0] != HERE.name)


def titles(index: str, names: list[Path], docs: Path) -> dict[Path, str]:
    """Short title by page: words and order of the index, then the headings of pages that it does not name."""
    known = {name.as_posix(): name for name in names}
    found = {known[target]: words for words, target in reversed(_LINK.findall(index)) if target in known}
    found = dict(reversed(found.items()))
    for name in names:
        if name not in found:
            title = _TITLE.search((docs / name).read_text(encoding="utf-8"))
            found[name] = title[1] if title else name.stem
    return found


def navigation(index: str, names: list[Path], reference: list[tuple[str, str]], docs: Path = DOCS) -> str:
    """Tables of contents of the side bar: a part per folder, and the reference that was generated.

    Notebooks, which become pages when the site is built, stand in a part of their own.
    """
    words = titles(index, names, docs)
    parts: dict[str, list[str]] = {
        "First": [],
        "How to": [],
        "Notebooks": [],
        "Files": [],
        "Reference": [],
        "Theory": [],
        "About": [],
    }
    for name, title in words.items():
        entry = f"{title[0].upper()}{title[1:].replace('`', '')} <{name.with_suffix('').as_posix()}>"
        match list(name.parts):
            case ["index.md"]:
                continue
            case ["tour.md"] | ["how-to", "i_have_a_vehicle.md" | "your_own_vehicle.md" | "real_log.md"]:
                parts["First"].append(entry)
            case ["how-to", *_]:
                parts["How to"].append(entry)
            case ["theory", *_]:
                parts["Theory"].append(entry)
            case [_] if name.stem.endswith("-file"):
                parts["Files"].append(entry)
            case ["conventions.md" | "interface.md"]:
                parts["Reference"].append(entry)
            case _:
                parts["About"].append(entry)
    parts["Notebooks"] = [f"notebooks/{path.stem}" for path in sorted((docs / "notebooks").glob("*.ipynb"))]
    parts["Reference"] += [f"{title} <{page}>" for page, title in reference]
    blocks = [
        f"```{{toctree}}\n:hidden:\n:caption: {part}\n\n" + "\n".join(entries) + "\n```\n"
        for part, entries in parts.items()
        if entries
    ]
    return "\n".join(blocks)


def gather(source: Path, report: Path | None) -> None:
    """Write what Sphinx reads: the pages, the reference and the front page with the report."""
    from docs.site.notebooks import NOTEBOOKS, page
    from docs.site.reference import write_reference

    shutil.rmtree(source, ignore_errors=True)
    names = pages(DOCS)
    for name in names:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        text = (DOCS / name).read_text(encoding="utf-8")
        text = _NOTEBOOK.sub(r"\1md", _SOURCE.sub(r"\1 (`\2`)", text))
        (source / name).write_text(text, encoding="utf-8")
    for notebook in sorted(NOTEBOOKS.glob("*.ipynb")):
        target = source / notebook.relative_to(DOCS).with_suffix(".md")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(page(notebook, target.parent / "outputs"), encoding="utf-8")
    for picture in (file for kind in ("png", "svg") for file in DOCS.rglob(f"*.{kind}")):
        target = source / picture.relative_to(DOCS)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(picture, target)
    shutil.copyfile(HERE / "conf.py", source / "conf.py")
    shutil.copytree(HERE / "_static", source / "_static")
    listed = write_reference(source / "reference")
    index = (source / "index.md").read_text(encoding="utf-8")
    title, _, rest = index.partition("\n")
    front = FLYING if report else STILL
    index = f"{title}\n\n{front}\n{rest}\n\n{navigation(index, names, listed)}"
    (source / "index.md").write_text(index, encoding="utf-8")
    if report:
        (source / "_extra").mkdir()
        shutil.copyfile(report, source / "_extra" / REPORT)


class _Page(HTMLParser):
    """Identifiers, links and resources of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.links: list[str] = []
        self.resources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        if "id" in given:
            self.names.add(given["id"])
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag in ("img", "script", "iframe", "source") and given.get("src"):
            self.resources.append(given["src"])
        elif tag == "link" and given.get("rel") not in ("canonical",) and "href" in given:
            self.resources.append(given["href"])


def broken(site: Path) -> list[str]:
    """What leads nowhere in a built site, and what would be fetched from elsewhere, as sentences."""
    parsed: dict[Path, _Page] = {}
    for file in sorted(site.rglob("*.html")):
        if file.name != REPORT:  # a page of its own, checked where it is made
            parsed[file] = _Page()
            parsed[file].feed(file.read_text(encoding="utf-8"))
    found = []
    for file, page in parsed.items():
        for kind, targets in (("link", page.links), ("resource", page.resources)):
            for target in targets:
                parts = urlsplit(target)
                if parts.scheme or parts.netloc:
                    if kind == "resource" and parts.scheme != "data":
                        found.append(f"{file.relative_to(site)}: fetches {target}")
                    continue
                aim = (file.parent / unquote(parts.path)).resolve() if parts.path else file
                if not aim.exists():
                    found.append(f"{file.relative_to(site)}: {kind} {target} leads nowhere")
                elif parts.fragment and aim in parsed and unquote(parts.fragment) not in parsed[aim].names:
                    found.append(f"{file.relative_to(site)}: {target} names an anchor that is not there")
    return found


def build(out: Path, report: Path | None) -> int:
    """Build the site in a folder; 0 when everything is in order."""
    from sphinx.cmd.build import main as sphinx

    source, site = out / "source", out / "html"
    if report and not report.exists():
        print(
            f"site: {report} is not there, so the front page shows a picture: make demo writes it",
            file=sys.stderr,
        )
        report = None
    gather(source, report)
    shutil.rmtree(site, ignore_errors=True)
    extra = ["-D", "html_extra_path=_extra"] if report else []
    status = sphinx([
        "-q",
        "-W",
        "--keep-going",
        "-E",
        *extra,
        "-d",
        str(out / "doctrees"),
        str(source),
        str(site),
    ])
    wrong = broken(site) if site.exists() else ["nothing was built"]
    for line in wrong:
        print(f"site: {line}", file=sys.stderr)
    if not status and not wrong:
        print(f"site: {len(list(site.rglob('*.html')))} pages; open {site / 'index.html'}")
    return 1 if status or wrong else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Build the documentation site.")
    parser.add_argument("--out", type=Path, default=Path("target/site"), help="folder to build in")
    parser.add_argument("--report", type=Path, help="the demo's report, which flies on the front page")
    given = parser.parse_args()
    sys.exit(build(given.out, given.report))
