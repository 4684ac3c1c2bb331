"""What a verdict on a log leaves in its run directory: verdict, summary, inputs and their hashes, figures.

Tests: ``tests/test_recorded_campaign.py``.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.run_directory import RUN_FILE, RunDirectory, to_json
from seatrial.run_facts import run_facts

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.recorded.log_verdict import LogVerdict

__all__ = ["write_verdict"]


def write_verdict(
    found: LogVerdict,
    folder: str | Path,
    campaign: Campaign,
    *,
    source: str | Path,
    figures: bool = True,
    formats: tuple[str, ...] = ("png", "pdf"),
) -> Path:
    """Path of a run directory with a verdict on a log.

    Parameters
    ----------
    found : LogVerdict
    folder : str or Path
        Made when it does not exist; an earlier run's is replaced.
    campaign : Campaign
        What was asked for.
    source : str or Path
        The log, as it was named.
    figures : bool, optional
        Whether to draw.
    formats : tuple of str, optional
        Endings of the figures.

    Raises
    ------
    SeatrialError
        The directory cannot be written; nothing is left half-written.
    """
    inputs = {"campaign.toml": campaign.text, **found.inputs()}
    facts = run_facts(campaign, trials=False)
    facts["sha256"] |= {name: hashlib.sha256(text.encode()).hexdigest() for name, text in inputs.items()}
    if (log := _file(source)) is not None:
        facts["sha256"]["log"] = hashlib.sha256(log.read_bytes()).hexdigest()
    files: dict[str, str | bytes] = {
        RUN_FILE: to_json(facts | {"kind": "log verdict", "log": str(source)}),
        **inputs,
        "verdict.json": to_json(found.to_dict()),
        "summary.txt": found.summary() + "\n",
    }
    directory = RunDirectory(folder)
    try:
        if figures:
            found.save_figures(directory.workspace / "figures", formats=formats)
        return directory.publish(files)
    except BaseException:  # Ctrl-C too: nothing here is worth resuming
        directory.discard()
        raise


def _file(source: str | Path) -> Path | None:
    path = Path(source)
    path = path / "flight.parquet" if path.is_dir() else path
    return path if path.is_file() else None
