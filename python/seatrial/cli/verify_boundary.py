"""`seatrial verify --boundary`: in which values of one or two variables an autopilot is still safe."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from seatrial.base.errors import CampaignError

if TYPE_CHECKING:
    from seatrial.verification.campaign import VerifiedCampaign


def verify_boundary(
    prepared: VerifiedCampaign,
    asked: str,
    names: list[str],
    *,
    out: Path | None,
    resume: bool,
    threads: int | None,
    dask: str | None,
    drawing: tuple[str, ...],
    verbose: bool,
    json: bool,
) -> None:
    """The boundaries into a run directory of their own, with a figure each."""
    from seatrial.base.run import check_writable
    from seatrial.cli.console import answer, print_json, search_progress, workers
    from seatrial.report.plot.boundary import boundary_gallery
    from seatrial.verification.boundary import run_boundary

    folder = out or Path("runs") / f"{prepared.campaign.name}-boundary"
    variables = _ranges(asked)
    check_writable(folder, "failure boundary")
    with workers(dask) as fleet, search_progress("first missions", quiet=json) as progress:
        found = run_boundary(
            prepared,
            variables,
            names=names,
            run_dir=folder,
            progress=progress,
            resume=resume,
            threads=threads,
            executor=fleet,
        )

    def drawn() -> list[Path]:
        if not drawing or found.interrupted:
            return []
        return boundary_gallery(found, folder / "figures", formats=drawing)

    if json:
        print_json(found.to_dict() | {"run_directory": str(folder), "figures": [str(p) for p in drawn()]})
    else:
        results = f"Results in {folder}: boundary.json, summary.txt and the inputs"
        answer(found.report(), verbose=verbose, results=results, draw=drawn)
    if found.interrupted:
        raise typer.Exit(130)


def _ranges(asked: str) -> dict[str, tuple[float, float]]:
    """Variables and ranges of ``NAME=FROM:TO[,NAME=FROM:TO]``."""
    found: dict[str, tuple[float, float]] = {}
    for one in asked.split(","):
        name, _, ends = one.strip().partition("=")
        low, _, high = ends.partition(":")
        try:
            found[name.strip()] = float(low), float(high)
        except ValueError:
            raise CampaignError(
                "--boundary: expected NAME=FROM:TO, or two of them with a comma, such as"
                f" current_speed_m_s=0:1,payload_kg=0:5; found {one.strip()!r}"
            ) from None
    if len(found) != len(asked.split(",")):
        raise CampaignError(f"--boundary: a variable stands twice in {asked!r}; name two different ones")
    return found
