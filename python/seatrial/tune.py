"""`tune`: from a campaign and what was identified to an autopilot whose responses stay in their corridors.

Margins first, then group after group by evolution strategy and simplex on the full non-linear closed loop
with limits, dead band, dead time, sensor noise, currents and drawn vehicles; at last everything is judged
again on samples that the search never saw, beside the start gains and a relay autotuning. The work is in
`seatrial.tuning.conduct`, loaded at the call: `import seatrial` stays light.

Source: Taubert et al. (2014), section "Constraint Criteria Optimization". Held by tests/test_tune.py.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from seatrial.progress import Progress

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.campaign import Campaign
    from seatrial.fitted import Fitted
    from seatrial.identification import Identification
    from seatrial.tuning.tuning_result import Tuning

__all__ = ["tune"]


def tune(
    campaign: Campaign,
    fit: Identification | Fitted | Vehicle | str | Path | None = None,
    *,
    run_dir: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    resume: bool = True,
    relay: bool = False,
    threads: int | None = None,
) -> Tuning:
    """Tuning: an autopilot with tuned gains, how its responses keep to their corridors, and its margins.

    Parameters
    ----------
    campaign : Campaign
        Its ``[tuning]`` says what the loops shall do, its ``autopilot`` gives the start gains.
    fit : Identification, run directory, Vehicle, built-in name or file, optional
        What is known of the vehicle; the campaign's own vehicle, taken as exact, when missing.
    run_dir : str or Path, optional
        Where the results go, and where finished groups are kept for a run that resumes this one.
    progress : callable, optional
        Called with a `Progress` after every batch of candidates.
    resume : bool, optional
        Whether groups that an earlier run finished from the same inputs are reused.
    relay : bool, optional
        Whether a relay autotuning of the same loops is judged beside.
    threads : int, optional
        All when omitted; the result does not depend on it.

    Returns
    -------
    Tuning
        ``interrupted`` after Ctrl-C, with the best gains so far.

    Raises
    ------
    CampaignError
        The campaign asks for what the vehicle or the autopilot cannot do.
    VehicleError, TrialError
        A file is not usable.
    SeatrialError
        The run directory cannot be written.

    Examples
    --------
    >>> import seatrial as st
    >>> campaign = st.Campaign.load("examples/cwolf/campaign.toml")  # doctest: +SKIP
    >>> tuning = st.tune(campaign, st.identify(campaign))  # doctest: +SKIP
    >>> tuning.autopilot.gains()["surge.K_P.4"]  # doctest: +SKIP
    """
    from seatrial.tuning.conduct import conduct

    return conduct(
        campaign, fit, run_dir=run_dir, progress=progress, resume=resume, relay=relay, threads=threads
    )
