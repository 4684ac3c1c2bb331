"""The second half of `seatrial demo`: CWolf's autopilot tuned on what was identified, and verified.

The tuner knows the identified vehicle alone. The truth that sailed the trials has couplings that the model
lacks: at last it flies with the tuned autopilot, which believes in the identified one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from seatrial._core import Vehicle
    from seatrial.identification import Identification
    from seatrial.tuning.tuning_result import Tuning

__all__ = ["Chain", "demonstrate"]

_RUNS, _ON_TRUTH = 1000, 400
_DRAWN = ("pitch", "depth")  # the others are drawn by `seatrial tune`


@dataclass
class Chain:
    """What the second half of the demonstration came to."""

    results: dict[str, Any] = field(default_factory=dict)
    interrupted: bool = False
    held: bool = True


def demonstrate(
    console: Console,
    fit: Identification,
    truth: Vehicle,
    out: Path,
    *,
    threads: int | None = None,
    quiet: bool = False,
) -> Chain:
    """CWolf's autopilot tuned and verified, with results in folders beside that of the identification.

    Parameters
    ----------
    console : Console
    fit : Identification
    truth : Vehicle
        That sailed the trials.
    out : Path
        Folder of the demonstration.
    threads : int, optional
        All when omitted.
    quiet : bool, optional
        Whether nothing is printed.
    """
    from seatrial.cli.tune import draw, print_tuning, tuned

    chain = Chain()
    if not quiet:
        console.rule(
            "CWolf: its autopilot tuned from the start gains, on the identified vehicle", align="left"
        )
    found = tuned(
        fit.campaign, fit, out / "cwolf-tuned", relay=True, threads=threads, resume=False, quiet=quiet
    )
    chain.results["cwolf_tuning"] = found.to_dict()
    if found.interrupted:
        chain.interrupted = True
        return chain
    written = draw(found, out / "cwolf-tuned", formats=("png",), loops=_DRAWN)
    if not quiet:
        from seatrial.cli.console import list_figures

        print_tuning(console, found)
        list_figures(console, written)
    _on_truth(console, found, truth, chain, quiet=quiet)
    _verify(console, fit, found, truth, (out, chain), threads=threads, quiet=quiet)
    return chain


def _on_truth(console: Console, found: Tuning, truth: Vehicle, chain: Chain, *, quiet: bool) -> None:
    """The tuned responses on the vehicle that the tuner never saw."""
    from seatrial.tuning.tuning_text import on_another_vehicle

    judged = found.on(truth, name="truth")
    chain.results["cwolf_tuned_on_truth"] = judged.to_dict()
    if not quiet:
        console.print(
            f"- On the vehicle that sailed the trials: {on_another_vehicle(judged)}",
            soft_wrap=True,
            markup=False,
        )


def _verify(
    console: Console,
    fit: Identification,
    found: Tuning,
    truth: Vehicle,
    into: tuple[Path, Chain],
    *,
    threads: int | None,
    quiet: bool,
) -> None:
    """Missions of drawn vehicles, beside the start gains, and missions of the truth."""
    from seatrial.cli.verification_table import print_verification
    from seatrial.cli.verify import draw, verified
    from seatrial.verification.verified_campaign import verified_campaign

    out, chain = into
    campaign = fit.campaign
    if not quiet:
        console.rule("CWolf: missions of vehicles drawn from what is known of it", align="left")
    prepared = verified_campaign(campaign, fit, found, runs=_RUNS, compare=True)
    folder = out / "cwolf-verified"
    verdict = verified(prepared, folder, threads=threads, resume=False, quiet=quiet)
    chain.results["cwolf_verification"] = verdict.to_dict()
    chain.held, chain.interrupted = verdict.held, verdict.interrupted
    if chain.interrupted:
        return
    written = draw(verdict, folder, formats=("png",))
    if not quiet:
        from seatrial.cli.console import list_figures

        print_verification(console, verdict)
        list_figures(console, written)
        console.rule("CWolf: the same missions with the vehicle that sailed the trials", align="left")
    prepared = verified_campaign(campaign, truth, found, model=fit.vehicle, runs=_ON_TRUTH)
    on_truth = verified(prepared, None, threads=threads, quiet=quiet)
    chain.results["cwolf_verification_on_truth"] = on_truth.to_dict()
    chain.held, chain.interrupted = chain.held and on_truth.held, on_truth.interrupted
    if not quiet:
        print_verification(console, on_truth)
