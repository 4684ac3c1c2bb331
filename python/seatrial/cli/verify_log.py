"""`seatrial verify --log`: a campaign and the log of a mission in, a verdict out.

Tests: ``tests/test_recorded_campaign.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from seatrial.errors import CampaignError

if TYPE_CHECKING:
    from seatrial.campaign import Campaign

_LONGEST_NAME = 80


def refuse_beside(given: Mapping[str, Any]) -> None:
    """Refuse options that ask for flights, by name, where a log is judged."""
    for name, value in given.items():
        if value is not None and value is not False:
            raise CampaignError(
                f"{name}: --log judges a recorded mission and flies none; leave one of them out"
            )


def verify_log(
    campaign: Campaign,
    fit: Path | str | None,
    log: Path,
    *,
    autopilot: Path | None,
    missions: Sequence[Path],
    references: Sequence[Path],
    out: Path | None,
    figures: bool,
    json: bool,
) -> None:
    """Judge a log into a run directory, print the verdict, exit with 1 where it is not held."""
    from seatrial.cli.console import list_figures, output, print_json
    from seatrial.recorded.campaign_verdict import verify_campaign_log
    from seatrial.recorded.verdict_files import write_verdict
    from seatrial.run_directory import check_writable

    if len(missions) > 1:
        raise CampaignError(
            f"--mission: a log is one mission, found {len(missions)}; give the one that was flown"
        )
    folder = out or Path("runs") / f"{campaign.name}-log-{_safe(log)}"
    check_writable(folder)
    found, judged = verify_campaign_log(
        campaign,
        campaign.vehicle if fit is None else fit,
        log,
        autopilot=autopilot,
        mission=missions[0] if missions else None,
        references=references,
    )
    write_verdict(found, folder, campaign, source=log, figures=figures)
    written = sorted((folder / "figures").glob("*"))
    if json:
        data = found.to_dict() | {"run_directory": str(folder), "figure_files": [str(p) for p in written]}
        print_json(data)
    else:
        console = output()
        part = "" if judged.span is None else f", {judged.span[0]:g} to {judged.span[1]:g} s, held out"
        console.print(
            f"Vehicle: {fit or campaign.vehicle.name}. Log: {log}{part}.", soft_wrap=True, markup=False
        )
        console.print(found.summary(), soft_wrap=True, markup=False)
        console.print(f"VERDICT: {found.verdict}", markup=False, style="bold")
        files = "verdict.json, summary.txt and the inputs"
        console.print(f"Results in {folder}: {files}", soft_wrap=True, markup=False)
        list_figures(console, written)
    if not found.passed:
        raise typer.Exit(1)


def _safe(log: Path) -> str:
    name = log.stem if log.is_file() else log.name or log.resolve().name
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in name)[:_LONGEST_NAME]
