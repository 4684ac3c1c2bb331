"""The runs behind the tutorial on a real log: every command of the page, its output, and its figures.

``SEATRIAL_DATA=... python -m docs.site.real_log`` runs the commands of `PAGE` in a temporary folder and
writes the figures beside the page. ``tests/docs/test_real_log.py`` runs them again and compares
page and figures with what they say.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import tempfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from PIL import Image
from typer.testing import CliRunner

from docs.site.build import DOCS
from seatrial.cli import app

__all__ = ["FIGURES", "LOG", "PAGE", "run", "written"]

PAGE = DOCS / "how-to" / "real_log.md"
LOG = "00000029_filtered.BIN"
FIGURES = {
    "log": "pier/figures/log.png",
    "trial": "runs/first/figures/trial_00000029_filtered.png",
    "intervals": "runs/first/figures/intervals.png",
    "residuals": "runs/first/figures/residual_analysis.png",
}
"""Figures of the page, by the name they have there, as the commands write them."""

_COMMAND = re.compile(r"^\$ seatrial (.+)$", re.MULTILINE)
_EDIT = re.compile(r"^```toml\n# (\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_WIDE = 960  # pixels of a figure on the page


def run(folder: Path) -> str:
    """Output of every command of the page, run one after the other in a folder that is empty.

    Parameters
    ----------
    folder : Path
        Where the log is linked to and the commands write.

    Raises
    ------
    RuntimeError
        A command of the page fails.
    """
    source = Path(os.environ["SEATRIAL_DATA"]) / "bluerov2_heavy" / LOG
    (folder / LOG).symlink_to(source)
    page, told = PAGE.read_text(encoding="utf-8"), []
    steps = sorted([*_COMMAND.finditer(page), *_EDIT.finditer(page)], key=lambda step: step.start())
    with contextlib.chdir(folder):
        for step in steps:
            if step.re is _EDIT:
                _edit(Path(step[1]), step[2])
                continue
            result = CliRunner().invoke(app, shlex.split(step[1], comments=True))
            if result.exit_code:
                raise RuntimeError(f"seatrial {step[1]}: exit code {result.exit_code}\n{result.output}")
            told.append(result.output)
    return "\n".join(told)


def _edit(file: Path, lines: str) -> None:
    """Lines of the page put into a file: where they stand as comments, or behind the line above them."""
    text = file.read_text(encoding="utf-8")
    for above, line in zip(["", *lines.splitlines()], lines.splitlines(), strict=False):
        if f"\n{line}" in text:
            continue
        if f"\n# {line}" in text:
            text = text.replace(f"\n# {line}", f"\n{line}", 1)
        else:
            assert f"{above}\n" in text, f"{file}: {above}"
            text = text.replace(f"{above}\n", f"{above}\n{line}\n", 1)
    file.write_text(text, encoding="utf-8")


def _figure(file: Path) -> bytes:
    """A figure as the page shows it: as wide as a column, in 64 colours."""
    with Image.open(file) as drawn:
        tall = round(drawn.height * _WIDE / drawn.width)
        small = drawn.convert("RGB").resize((_WIDE, tall), Image.Resampling.LANCZOS)
    stream = BytesIO()
    small.quantize(64, dither=Image.Dither.NONE).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def written(folder: Path) -> Iterator[tuple[Path, bytes]]:
    """Files of the figures beside the page, and what belongs into them after the runs in a folder."""
    for name, drawn in FIGURES.items():
        yield PAGE.with_name(f"{PAGE.stem}_{name}.png"), _figure(folder / drawn)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        print(run(Path(scratch)))
        for path, content in written(Path(scratch)):
            path.write_bytes(content)
