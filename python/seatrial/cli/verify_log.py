"""`seatrial verify --log`: a campaign and the log of a mission in, a verdict out.

Tests: ``tests/verification/test_recorded_campaign.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from seatrial.base.errors import CampaignError
from seatrial.base.file_names import file_name
from seatrial.cli.report import reported

if TYPE_CHECKING:
    from seatrial.campaign.campaign import Campaign


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
    drawing: tuple[str, ...],
    page: Path | None,
    junit: Path | None,
    verbose: bool,
    json: bool,
) -> None:
    """Judge a log into a run directory, print the verdict, exit with 1 where it is not held."""
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json
    from seatrial.cli.streams import note
    from seatrial.verification.mission_log.campaign import verify_campaign_log

    if len(missions) > 1:
        raise CampaignError(
            f"--mission: a log is one mission, found {len(missions)}; give the one that was flown"
        )
    folder = out or Path("runs") / f"{campaign.name}-log-{_safe(log)}"
    check_writable(folder, "log verdict")
    found, judged = verify_campaign_log(
        campaign,
        campaign.vehicle if fit is None else fit,
        log,
        autopilot=autopilot,
        mission=missions[0] if missions else None,
        references=references,
    )
    found.save(folder, campaign=campaign, source=log)
    if junit is not None:
        write_beside(junit, found.junit())

    def drawn() -> list[Path]:
        if not drawing:
            return []
        from seatrial.report.plot.mission_log import log_verdict_gallery

        return sorted(log_verdict_gallery(found, folder / "figures", formats=drawing))

    if json:
        data = found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]}
        print_json(data)
    else:
        part = "" if judged.span is None else f", {judged.span[0]:g} to {judged.span[1]:g} s, held out"
        note(f"Vehicle: {fit or campaign.vehicle.name}. Log: {log}{part}.")
        results = f"Results in {folder}: verdict.json, junit.xml, summary.txt and the inputs"
        answer(found.report(), verbose=verbose, results=results, draw=drawn)
    reported(page, [folder], quiet=json)
    if not found.held:
        raise typer.Exit(1)


def _safe(log: Path) -> str:
    name = log.stem if log.is_file() else log.name or log.resolve().name
    return file_name(name)


def write_beside(path: Path, text: str) -> None:
    """Write a file that was asked for beside the run directory."""
    from seatrial.base.atomic_write import write_atomic

    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, text.encode())
