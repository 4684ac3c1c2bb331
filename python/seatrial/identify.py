"""Identification of a campaign: the public function.

The work is in `seatrial.conduct`, loaded at the call: `import seatrial` stays light.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.progress import Progress

if TYPE_CHECKING:
    from seatrial.campaign import Campaign
    from seatrial.identification import Identification

__all__ = ["Progress", "identify"]


def identify(
    campaign: Campaign,
    *,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    threads: int | None = None,
) -> Identification:
    """Identification of the campaign's vehicle from its trials.

    Parameters
    ----------
    campaign : Campaign
    run_dir : str or Path, optional
        Folder for the results. Finished stages are kept beside it while the run goes on.
    progress : callable, optional
        Called in the caller's thread with a `Progress` after every batch of candidates.
    resume : bool
        Reuse the stages that an earlier run in this folder finished from the same inputs.
    threads : int, optional
        Threads of the core; by default all. The result does not depend on it.

    Returns
    -------
    Identification
        After Ctrl-C: the best so far, marked as interrupted.

    Raises
    ------
    CampaignError, TrialError, VehicleError
        The campaign asks for what cannot be done.
    SimulationError
        Every candidate of a stage diverged.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> fit = st.identify(st.Campaign.load("examples/cwolf/campaign.toml"))  # doctest: +SKIP
    >>> print(fit.summary())  # doctest: +SKIP
    """
    from seatrial.conduct import conduct

    return conduct(campaign, run_dir=run_dir, progress=progress, resume=resume, threads=threads)
