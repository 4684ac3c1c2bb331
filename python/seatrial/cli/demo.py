"""`seatrial demo`: from trials to a verdict for CWolf, and Beluga identified where its recordings are.

The second half of `seatrial demo`: CWolf's autopilot tuned on what was identified, and verified.

The tuner knows the identified vehicle alone. The truth that sailed the trials has couplings that the model
lacks: at last it flies with the tuned autopilot, which believes in the identified one.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.base.run import RUN_FILE, belongs_to_run
from seatrial.cli.new import EXAMPLES
from seatrial.cli.options import Computing, Threads
from seatrial.cli.report import reported

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from seatrial._core import Vehicle
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning

_FOLDERS = ("cwolf", "cwolf-tuned", "cwolf-verified", "beluga")


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for results.")] = Path("runs/demo"),
    threads: Threads = None,
    json: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
) -> None:
    """Identify CWolf from generated trials, tune and verify its autopilot; identify the AUV Beluga.

    Beluga's turn comes where its recordings are at hand. The exit code is 1 where CWolf's verdict is not
    held.

    Example: seatrial demo
    """
    from seatrial.base.atomic_write import only_user
    from seatrial.cli.console import output, print_json

    with only_user(out):
        console = output()
        campaign, fit, truth = _cwolf(console, out / "cwolf", threads=threads, quiet=json)
        results = {"cwolf": fit.to_dict()}
        interrupted, held = fit.interrupted, True
        asked = campaign.file
        if not interrupted and asked.tuning is not None and asked.verification is not None:
            chain = demonstrate(console, campaign, fit, truth, out, threads=threads, quiet=json)
            results |= chain.results
            interrupted, held = chain.interrupted, chain.held
        if not interrupted and (recorded := _beluga(console, quiet=json)) is not None:
            beluga = _identified(recorded, out / "beluga", threads=threads, quiet=json)
            results["beluga"] = beluga.to_dict()
            interrupted = beluga.interrupted
    if json:
        print_json(results)
    if interrupted:
        raise typer.Exit(130)
    runs = [out / name for name in _FOLDERS if (out / name / RUN_FILE).is_file()]
    reported(out / "report.html", runs, title="CWolf, from trials to a verdict", quiet=json)
    if not held:
        raise typer.Exit(1)


def _cwolf(
    console: Console, folder: Path, *, threads: int | None, quiet: bool
) -> tuple[Campaign, Identification, Vehicle]:
    """CWolf's campaign, what it identified, and the vehicle that sailed its trials."""
    from seatrial.campaign.campaign import Campaign
    from seatrial.trial.generated import Recipe
    from seatrial.trial.truth import Truth

    example = EXAMPLES / "cwolf"
    truth = Truth.load(example / "truth.toml")
    campaign = Campaign.load(example / "campaign.toml")
    if not quiet:
        console.rule(
            "CWolf: stages as in Taubert et al. (2014), and roll; trials GENERATED from a truth vehicle",
            align="left",
        )
    fit = _identified(campaign, folder, threads=threads, quiet=quiet, truth=truth.vehicle.coefficients())
    logs = folder / "trials"
    logs.mkdir(exist_ok=True)
    recipes = {name: path for name in campaign.trials if (path := campaign.path_of(name)) is not None}
    for name, path in recipes.items():
        Recipe.load(path).save(logs / f"generated-{name}.csv")
    belongs_to_run(folder, [logs / f"generated-{name}.csv" for name in recipes])
    if not quiet:
        console.print(f"Generated trials in {logs}\n", soft_wrap=True, markup=False)
    return campaign, fit, truth.vehicle


def _beluga(console: Console, *, quiet: bool) -> Campaign | None:
    """Campaign of Beluga where its recordings are at hand, else a word on how to get them."""
    from seatrial.base.data_sets import data_folder
    from seatrial.campaign.campaign import Campaign

    path = EXAMPLES / "beluga" / "campaign.toml"
    data = data_folder()
    if not path.is_file():
        return None
    if not (data / "beluga").is_dir():
        if not quiet:
            console.print(
                "The AUV Beluga is left out: its recordings are not here. Fetch them with: seatrial data get"
                " beluga, or set SEATRIAL_DATA to the folder that holds beluga/.",
                soft_wrap=True,
            )
        return None
    if not quiet:
        console.rule("Beluga: recorded trials of a real vehicle (Vortex NTNU, 2021)", align="left")
    return Campaign.load(path)


def _identified(
    campaign: Campaign,
    folder: Path,
    *,
    threads: int | None,
    quiet: bool,
    truth: Mapping[str, float] | None = None,
) -> Identification:
    from seatrial.cli.console import answer
    from seatrial.cli.identify import draw, run_identification

    began = time.monotonic()
    fit = run_identification(
        campaign, folder, computing=Computing(threads=threads, resume=False), quiet=quiet
    )
    took = time.monotonic() - began

    def drawn() -> list[Path]:
        return [] if fit.interrupted else draw(fit, folder, _ENDINGS)

    if quiet:
        drawn()
    else:
        results = f"Identified in {took:.1f} s; results in {folder}"
        answer(fit.report(truth=truth), results=results, draw=drawn)
    return fit


_ENDINGS = ("png", "svg")


def _drawn(name: str) -> bool:
    """Whether a figure of the tuning is drawn: of pitch and depth; `seatrial tune` draws all loops."""
    kind, _, loop = name.partition("_")
    return kind not in ("corridor", "responses") or loop in ("pitch", "depth")


@dataclass
class Chain:
    """What the second half of the demonstration came to."""

    results: dict[str, Any] = field(default_factory=dict)
    interrupted: bool = False
    held: bool = True


def demonstrate(
    console: Console,
    campaign: Campaign,
    fit: Identification,
    truth: Vehicle,
    out: Path,
    *,
    threads: int | None = None,
    quiet: bool = False,
) -> Chain:
    """CWolf's autopilot tuned and verified, with results in folders beside that of the identification.

    `truth` sailed the trials; `out` is the folder of the demonstration.
    """
    from seatrial.cli.console import answer
    from seatrial.cli.tune import tuned
    from seatrial.report.plot import gallery

    chain = Chain()
    if not quiet:
        console.rule(
            "CWolf: its autopilot tuned from the start gains, on the identified vehicle", align="left"
        )
    found = tuned(
        campaign, fit, out / "cwolf-tuned", computing=Computing(threads=threads, resume=False), quiet=quiet
    )
    chain.results["cwolf_tuning"] = found.to_dict()
    if found.interrupted:
        chain.interrupted = True
        return chain

    def drawn() -> list[Path]:
        return gallery(found, out / "cwolf-tuned" / "figures", formats=_ENDINGS, wanted=_drawn)

    if quiet:
        drawn()
    else:
        answer(found.report(), draw=drawn)
    _on_truth(console, found, truth, chain, quiet=quiet)
    _verify(console, campaign, fit, found, truth, (out, chain), threads=threads, quiet=quiet)
    return chain


def _on_truth(console: Console, found: Tuning, truth: Vehicle, chain: Chain, *, quiet: bool) -> None:
    """The tuned responses on the vehicle that the tuner never saw."""
    from seatrial.report.results.tuning import on_another_vehicle

    performance = found.on(truth, name="truth")
    chain.results["cwolf_tuned_on_truth"] = performance.to_dict()
    if not quiet:
        console.print(
            f"- On the vehicle that sailed the trials: {on_another_vehicle(performance)}",
            soft_wrap=True,
            markup=False,
        )


def _verify(
    console: Console,
    campaign: Campaign,
    fit: Identification,
    found: Tuning,
    truth: Vehicle,
    into: tuple[Path, Chain],
    *,
    threads: int | None,
    quiet: bool,
) -> None:
    """Missions of drawn vehicles, beside the start gains, and missions of the truth."""
    from seatrial.cli.console import answer
    from seatrial.cli.verify import verified
    from seatrial.report.plot import gallery

    out, chain = into
    if not quiet:
        console.rule("CWolf: missions of vehicles drawn from what is known of it", align="left")
    # With a thousand missions a share near 95 % is known to 1.4 % (95 %).
    scenario = campaign.scenario(fit, found, runs=1000)
    folder = out / "cwolf-verified"
    verdict = verified(
        scenario,
        folder,
        compare={"start": campaign.autopilot},
        computing=Computing(threads=threads, resume=False),
        quiet=quiet,
    )
    chain.results["cwolf_verification"] = verdict.to_dict()
    chain.held, chain.interrupted = verdict.held, verdict.interrupted
    if chain.interrupted:
        return

    def drawn() -> list[Path]:
        return gallery(verdict, folder / "figures", formats=_ENDINGS)

    if quiet:
        drawn()
    else:
        answer(verdict.report(), draw=drawn)
        console.rule("CWolf: the same missions with the vehicle that sailed the trials", align="left")
    scenario = campaign.scenario(truth, found, model=fit.vehicle, runs=1000)  # as many missions as above
    on_truth = verified(scenario, None, computing=Computing(threads=threads), quiet=quiet)
    chain.results["cwolf_verification_on_truth"] = on_truth.to_dict()
    chain.held, chain.interrupted = chain.held and on_truth.held, on_truth.interrupted
    if not quiet:
        answer(on_truth.report())
