"""`seatrial demo`: from trials to a verdict for CWolf, and Beluga identified where its recordings are.

The tuner knows the identified vehicle alone. The truth that sailed the trials has couplings that the model
lacks: at last it flies with the tuned autopilot, which believes in the identified one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from seatrial.base.run import RUN_FILE, belongs_to_run
from seatrial.cli.new import EXAMPLES
from seatrial.cli.options import Computing, Json, Threads, end

if TYPE_CHECKING:
    from seatrial._core import Vehicle
    from seatrial.base.report import Report
    from seatrial.campaign.campaign import Campaign
    from seatrial.identification.identification import Identification
    from seatrial.tuning.result import Tuning

_FOLDERS = ("cwolf", "cwolf-tuned", "cwolf-verified", "beluga")

_ENDINGS = ("png", "svg")

_MISSIONS = 1000
"""Of a verification: with so many a share near 95 % is known to 1.4 % (95 %)."""


def demo(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for results.")] = Path("runs/demo"),
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Identify CWolf from generated trials, tune and verify its autopilot; identify the AUV Beluga.

    Beluga's turn comes where its recordings are at hand. The exit code is 1 where CWolf's verdict is not
    held.

    Example: seatrial demo
    """
    from seatrial.base.files import only_user
    from seatrial.cli.console import print_json, reported

    with only_user(out):
        shown = Demonstration(out, threads, json)
        shown.run()
    if json:
        print_json(shown.results)
    end(interrupted=shown.interrupted)
    runs = [out / name for name in _FOLDERS if (out / name / RUN_FILE).is_file()]
    reported(out / "report.html", runs, title="CWolf, from trials to a verdict", quiet=json)
    end(held=shown.held)


@dataclass
class Demonstration:
    """The demonstration, step by step: where it writes, how it computes, and what it came to."""

    out: Path
    threads: int | None
    quiet: bool
    results: dict[str, Any] = field(default_factory=dict)
    interrupted: bool = False
    held: bool = True

    def run(self) -> None:
        """CWolf from trials to a verdict, then Beluga."""
        campaign, fit, truth = self._cwolf()
        asked = campaign.file
        if not self.interrupted and asked.tuning is not None and asked.verification is not None:
            tuning = self._tuned(campaign, fit)
            if not self.interrupted:
                self._on_truth(tuning, truth)
                self._verified(campaign, fit, tuning)
            if not self.interrupted:
                self._verified_on_truth(campaign, fit, tuning, truth)
        if not self.interrupted and (recorded := self._beluga()) is not None:
            self._identified("beluga", recorded)

    @property
    def _computing(self) -> Computing:
        return Computing(threads=self.threads, resume=False)

    def _head(self, text: str) -> None:
        if not self.quiet:
            from seatrial.cli.console import output

            output().rule(text, align="left")

    def _say(self, text: str) -> None:
        if not self.quiet:
            from seatrial.cli.console import say

            say(text)

    def _answer(
        self, report: Report, results: str = "", draw: Callable[[], list[Path]] | None = None
    ) -> None:
        """Print a report and draw its figures; only draw where nothing is printed."""
        from seatrial.cli.console import answer

        if not self.quiet:
            answer(report, results=results, draw=draw)
        elif draw is not None:
            draw()

    def _cwolf(self) -> tuple[Campaign, Identification, Vehicle]:
        """CWolf's campaign, what it identified, and the vehicle that sailed its trials."""
        from seatrial.campaign.campaign import Campaign
        from seatrial.trial.generated import Recipe
        from seatrial.trial.truth import Truth

        example = EXAMPLES / "cwolf"
        truth = Truth.load(example / "truth.toml").vehicle
        campaign = Campaign.load(example / "campaign.toml")
        self._head(
            "CWolf: stages as in Taubert et al. (2014), and roll; trials GENERATED from a truth vehicle"
        )
        fit = self._identified("cwolf", campaign, truth=truth.coefficients())
        logs = self.out / "cwolf" / "trials"
        logs.mkdir(exist_ok=True)
        written = []
        for name in campaign.trials:
            if (recipe := campaign.path_of(name)) is not None:
                written.append(logs / f"generated-{name}.csv")
                Recipe.load(recipe).save(written[-1])
        belongs_to_run(self.out / "cwolf", written)
        self._say(f"Generated trials in {logs}\n")
        return campaign, fit, truth

    def _beluga(self) -> Campaign | None:
        """Campaign of Beluga where its recordings are at hand, else a word on how to get them."""
        from seatrial.base.files import data_folder
        from seatrial.campaign.campaign import Campaign

        path = EXAMPLES / "beluga" / "campaign.toml"
        if not path.is_file():
            return None
        if not (data_folder() / "beluga").is_dir():
            self._say(
                "The AUV Beluga is left out: its recordings are not here. Fetch them with: seatrial data get"
                " beluga, or set SEATRIAL_DATA to the folder that holds beluga/."
            )
            return None
        self._head("Beluga: recorded trials of a real vehicle (Vortex NTNU, 2021)")
        return Campaign.load(path)

    def _identified(
        self, name: str, campaign: Campaign, truth: Mapping[str, float] | None = None
    ) -> Identification:
        """Identification of a campaign into a folder of this name, beside the truth where it is known."""
        from seatrial.cli.identify import draw, run_identification

        folder = self.out / name
        began = time.monotonic()
        fit = run_identification(campaign, folder, computing=self._computing, quiet=self.quiet)
        took = time.monotonic() - began
        results = f"Identified in {took:.1f} s; results in {folder}"
        self._answer(fit.report(truth=truth), results, partial(draw, fit, folder, _ENDINGS))
        self.results[name] = fit.to_dict()
        self.interrupted = fit.interrupted
        return fit

    def _tuned(self, campaign: Campaign, fit: Identification) -> Tuning:
        """CWolf's autopilot tuned; its figures are those of pitch and depth, `seatrial tune` draws all."""
        from seatrial.cli.tune import tuned
        from seatrial.report.plot import gallery

        self._head("CWolf: its autopilot tuned from the start gains, on the identified vehicle")
        folder = self.out / "cwolf-tuned"
        tuning = tuned(campaign, fit, folder, computing=self._computing, quiet=self.quiet)
        self.results["cwolf_tuning"] = tuning.to_dict()
        self.interrupted = tuning.interrupted
        if not tuning.interrupted:
            self._answer(
                tuning.report(),
                draw=lambda: gallery(tuning, folder / "figures", formats=_ENDINGS, wanted=_drawn),
            )
        return tuning

    def _on_truth(self, tuning: Tuning, truth: Vehicle) -> None:
        """The tuned responses on the vehicle that the tuner never saw."""
        from seatrial.report.results.tuning import on_another_vehicle

        performance = tuning.on(truth, name="truth")
        self.results["cwolf_tuned_on_truth"] = performance.to_dict()
        self._say(f"- On the vehicle that sailed the trials: {on_another_vehicle(performance)}")

    def _verified(self, campaign: Campaign, fit: Identification, tuning: Tuning) -> None:
        """Missions of vehicles drawn from what is known, beside the start gains."""
        from seatrial.cli.verify import verified
        from seatrial.report.plot import gallery

        self._head("CWolf: missions of vehicles drawn from what is known of it")
        folder = self.out / "cwolf-verified"
        verdict = verified(
            campaign.scenario(fit, tuning, runs=_MISSIONS),
            folder,
            compare={"start": campaign.autopilot},
            computing=self._computing,
            quiet=self.quiet,
        )
        self.results["cwolf_verification"] = verdict.to_dict()
        self.held, self.interrupted = verdict.held, verdict.interrupted
        if not verdict.interrupted:
            self._answer(
                verdict.report(), draw=lambda: gallery(verdict, folder / "figures", formats=_ENDINGS)
            )

    def _verified_on_truth(
        self, campaign: Campaign, fit: Identification, tuning: Tuning, truth: Vehicle
    ) -> None:
        """As many missions of the vehicle that sailed the trials."""
        from seatrial.cli.verify import verified

        self._head("CWolf: the same missions with the vehicle that sailed the trials")
        scenario = campaign.scenario(truth, tuning, model=fit.vehicle, runs=_MISSIONS)
        verdict = verified(scenario, None, computing=Computing(threads=self.threads), quiet=self.quiet)
        self.results["cwolf_verification_on_truth"] = verdict.to_dict()
        self.held, self.interrupted = self.held and verdict.held, verdict.interrupted
        self._answer(verdict.report())


def _drawn(name: str) -> bool:
    """Whether a figure of the tuning is drawn."""
    kind, _, loop = name.partition("_")
    return kind not in ("corridor", "responses") or loop in ("pitch", "depth")
