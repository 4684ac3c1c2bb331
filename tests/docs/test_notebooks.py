"""The notebooks of the documentation run from end to end, and the site shows them with their outputs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

nbformat = pytest.importorskip("nbformat", reason="no nbformat: make setup")

from docs.site.notebooks import NOTEBOOKS, executed, page  # noqa: E402

BOOKS = sorted(NOTEBOOKS.glob("*.ipynb"))


def kinds(book: Any) -> list[list[tuple[str, ...]]]:
    """Per cell of code what each of its outputs is."""
    return [
        [(output.output_type, *sorted(output.get("data", {}))) for output in cell.outputs]
        for cell in book.cells
        if cell.cell_type == "code"
    ]


def words(book: Any) -> list[str]:
    """Text of the results, without numbers, which another machine may round otherwise."""
    texts = (
        o.get("text") or o.get("data", {}).get("text/plain", "")
        for c in book.cells
        for o in c.get("outputs", ())
    )
    return [re.sub(r"[-\d.e]+|\s+", " ", text) for text in texts]


@pytest.mark.long
@pytest.mark.parametrize("book", BOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_gives_the_outputs_that_it_shows(book: Path) -> None:
    pytest.importorskip("nbclient", reason="no nbclient: make setup")
    shown, now = nbformat.read(book, as_version=4), executed(book)
    assert kinds(now) == kinds(shown)
    assert words(now) == words(shown)


@pytest.mark.parametrize("book", BOOKS, ids=lambda path: path.stem)
def test_a_notebook_becomes_a_page_with_its_outputs(book: Path, tmp_path: Path) -> None:
    text = page(book, tmp_path / "outputs")
    cells = nbformat.read(book, as_version=4).cells
    assert text.startswith("# ")
    assert all(cell.source in text for cell in cells)
    pictures = {path.name for path in (tmp_path / "outputs").iterdir()}
    assert len(pictures) >= 1
    assert set(re.findall(r"\(outputs/(.+?)\)", text)) == pictures
    assert "<table" in text
    assert all(cell.outputs for cell in cells if cell.cell_type == "code")  # it was executed
