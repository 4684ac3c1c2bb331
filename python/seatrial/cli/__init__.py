"""Command line: verbs that call the library's functions and print what they return.

Exit codes: 0 done, 1 verdict failed, 2 bad input, 130 interrupted. Heavy libraries load with the verb that
needs them.
"""

from __future__ import annotations

import errno
from typing import Any

import typer
from typer.core import TyperGroup

from seatrial.cli import (
    autopilot,
    bench,
    check,
    coverage,
    demo,
    fly,
    gallery,
    identify,
    new,
    plan,
    score,
    simulate,
    tune,
    verify,
)
from seatrial.cli.console import complain
from seatrial.errors import SeatrialError

__all__ = ["app", "main"]

BAD_INPUT, INTERRUPTED = 2, 130


class _Verbs(TyperGroup):
    """The verbs; what they raise on purpose becomes one message and an exit code."""

    def invoke(self, ctx: Any) -> Any:
        """Result of the verb that was called."""
        try:
            return super().invoke(ctx)
        except SeatrialError as error:
            complain(str(error))
        except OSError as error:
            if error.errno == errno.EPIPE:
                ctx.exit(0)
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            place = f"{error.filename}: " if error.filename else ""
            advice = "free some space and run again" if full else "check the path and its permissions"
            complain(f"{place}{error.strerror or error}; {advice}")
        except KeyboardInterrupt:
            complain("interrupted")
            ctx.exit(INTERRUPTED)
        ctx.exit(BAD_INPUT)
        return None


app = typer.Typer(
    name="seatrial",
    cls=_Verbs,
    help="From sea-trial logs to an identified model of a marine vehicle.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"seatrial {version('seatrial')}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and stop."
    ),
) -> None:
    """From sea-trial logs to an identified model of a marine vehicle."""


app.command("demo")(demo.demo)
app.command("new")(new.new)
app.command("check")(check.check)
app.command("simulate")(simulate.simulate)
app.command("bench")(bench.bench)
app.command("plan")(plan.plan)
app.command("identify")(identify.identify)
app.command("score")(score.score)
app.command("autopilot")(autopilot.autopilot)
app.command("fly")(fly.fly)
app.command("tune")(tune.tune)
app.command("verify")(verify.verify)
app.command("gallery")(gallery.gallery)
app.command("coverage")(coverage.coverage)


def main() -> None:
    """Run the command line."""
    app()
