"""The conduct of an identification: data judged, stages searched, result polished, judged and kept."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from seatrial.campaign import Campaign
from seatrial.certainty.assessment import Certainty, certainty, conditioning
from seatrial.errors import CampaignError, SeatrialError, TrialError
from seatrial.frozen_motion import frozen_sentences
from seatrial.hold_out import part_scores
from seatrial.identification import Identification, estimates
from seatrial.progress import Progress
from seatrial.run_directory import RunDirectory
from seatrial.run_facts import run_facts
from seatrial.scale.anchor import judge_scale
from seatrial.search import Step
from seatrial.stage import plan
from seatrial.stage_order import StageOrder

__all__ = ["conduct"]


def conduct(
    campaign: Campaign,
    *,
    run_dir: str | Path | None,
    progress: Callable[[Progress], None] | None,
    resume: bool,
    threads: int | None,
) -> Identification:
    """Identification of the campaign's vehicle: every stage run, the result polished and judged."""
    began = time.monotonic()
    started = datetime.now(UTC).isoformat(timespec="seconds")
    if not campaign.stages:
        raise CampaignError(
            f"{campaign.source}: expected [[stages]], found none: there is nothing to identify; the campaign"
            " only tunes or verifies an autopilot"
        )
    plans = plan(campaign)  # refuses a bad campaign before a folder appears
    judge_scale(campaign)  # and a bad anchor
    before, notes = _before(campaign, threads)
    before += frozen_sentences(plans)
    directory = None if run_dir is None else RunDirectory(run_dir)
    order = StageOrder(campaign, plans, directory, progress=progress, resume=resume, threads=threads)
    if progress is not None and before:
        progress(replace(order.state(plans[0], None), notes=before))
    try:
        stages = order.stages()
    except SeatrialError:
        if directory is not None:
            directory.abandon()
        raise
    vehicle = campaign.vehicle
    for stage in stages:
        vehicle = vehicle.with_coefficients(stage.coefficients)
    sure: Certainty | None = None
    interrupted = order.stop.is_set()
    if not interrupted and not notes:
        sure = certainty(campaign, vehicle, watch=_watch(order, progress), threads=threads)
        vehicle, interrupted = sure.vehicle, sure.polished.interrupted
    judged = part_scores(campaign, vehicle)
    fit = Identification(
        campaign=campaign,
        vehicle=vehicle,
        coefficients=estimates(campaign, stages, sure),
        stages=stages,
        certainty=sure,
        scores=judged.scores,
        before=before,
        scale=judge_scale(campaign, vehicle),
        notes=(*notes, *judged.missing),
        facts=run_facts(campaign) | {"started_utc": started, "wall_s": time.monotonic() - began},
        interrupted=interrupted,
        not_run=tuple(s.name for s in campaign.stages if s.name not in {stage.name for stage in stages}),
    )
    if directory is not None:
        fit.publish(directory)
    return fit


def _before(campaign: Campaign, threads: int | None) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sentences on what the data cannot tell, and why there can be no joint estimate, if so."""
    try:
        return tuple(conditioning(campaign, threads=threads)), ()
    except (CampaignError, TrialError) as error:
        if campaign.file.polish is not None:
            raise
        return (), (f"no standard deviations: the trials cannot be judged jointly ({error})",)


def _watch(order: StageOrder, progress: Callable[[Progress], None] | None) -> Callable[[Step], None] | None:
    """What the joint polish reports, as progress of the whole."""
    if progress is None:
        return None

    def watch(step: Step) -> None:
        stages = len(order.plans)
        progress(
            Progress(
                stage="joint polish",
                phase=step.phase,
                generation=step.generation,
                generations=step.generations,
                evaluations=step.evaluations,
                best=step.best,
                stages_done=stages,
                stages=stages + 1,
                fraction=1.0,
                elapsed_s=time.monotonic() - order.began,
                left_s=step.left_s,
            )
        )

    return watch
