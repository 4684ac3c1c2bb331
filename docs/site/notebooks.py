"""Notebooks of the documentation: executed, and shown as pages of the site.

``python -m docs.site.notebooks`` executes every notebook in ``docs/notebooks`` in the root of the clone and
writes its outputs into it; the site shows them as they stand there (`page`). Held by
``tests/docs/test_notebooks.py``.
"""

from __future__ import annotations

import base64
import importlib
import sys
from pathlib import Path
from typing import Any

nbformat: Any = importlib.import_module("nbformat")  # it states no types of its functions

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = ROOT / "docs" / "notebooks"


def executed(notebook: Path) -> Any:
    """The notebook after all of its cells ran; a cell that fails is an error."""
    from nbclient import NotebookClient

    book = nbformat.read(notebook, as_version=4)
    NotebookClient(book, timeout=300, resources={"metadata": {"path": str(ROOT)}}).execute()
    for cell in book.cells:
        cell.metadata.pop("execution", None)  # times: another run would be another file
    book.metadata.pop("language_info", None)  # the version of Python
    return book


def page(notebook: Path, pictures: Path) -> str:
    """Page of a notebook in Markdown, with the outputs that stand in it; pictures go into a folder.

    Parameters
    ----------
    notebook : Path
    pictures : Path
        Folder beside the page.
    """
    parts: list[str] = []
    for number, cell in enumerate(nbformat.read(notebook, as_version=4).cells):
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for k, output in enumerate(cell.outputs):
            data = output.get("data", {})
            if "image/png" in data:
                pictures.mkdir(parents=True, exist_ok=True)
                name = f"{notebook.stem}-{number}-{k}.png"
                (pictures / name).write_bytes(base64.b64decode(data["image/png"]))
                parts.append(f"![Output of the cell above]({pictures.name}/{name})")
            elif "text/html" in data:
                # A line without a blank one: Markdown ends raw HTML at the first.
                parts.append(" ".join(line for line in data["text/html"].splitlines() if line.strip()))
            elif text := output.get("text") or data.get("text/plain"):
                parts.append(f"```text\n{text.rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    for path in [Path(name) for name in sys.argv[1:]] or sorted(NOTEBOOKS.glob("*.ipynb")):
        nbformat.write(executed(path), path)
        print(path)
