"""Command line: verbs that call the library's functions and print what they return.

Exit codes: 0 done, 1 verdict failed, 2 bad input, 130 interrupted, 141 the reader of a pipe is gone. Heavy
libraries load with the verb that needs them.
"""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Callable
from textwrap import fill
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from seatrial.base.errors import SeatrialError
from seatrial.cli import check, console, data, demo, export, fly, identify, new, plan, score, tune, verify
from seatrial.cli.console import ExitCodes
from seatrial.cli.options import moved

__all__ = ["app", "main"]


_ELSEWHERE = {
    "coverage": "it is a study of the method: in a clone of the repository, run python -m studies.coverage",
    "identify --random-starts": "it is a study of the method: in a clone of the repository, run"
    " python -m studies.random_starts CAMPAIGN",
}
"""Verbs and options that a reader of older files may ask for, and what to do in their place."""


_HELP_ALL = "--help-all"


class _Verbs(ExitCodes, TyperGroup):
    """The verbs; what they raise on purpose becomes one message and an exit code."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The verb that is asked for, unless it is done elsewhere."""
        if args[0] in _ELSEWHERE:
            raise SeatrialError(f"there is no verb {args[0]}: {_ELSEWHERE[args[0]]}")
        return super().resolve_command(ctx, args)


class _Verb(TyperCommand):
    """A verb: infinity, which a number of the command line may say, is none that it takes."""

    def get_help(self, ctx: Any) -> str:
        """The help on one screen: where there are more options than that, the last ones are only named."""
        text, rest = super().get_help(ctx), ""
        known: list[Any] = self.params
        options = [parameter for parameter in known if parameter.param_type_name == "option"]
        named: list[str] = []
        while options and len(f"{text}{rest}".splitlines()) > 40:  # lines of a terminal that is not maximised
            options[-1].hidden = True
            named.insert(0, options.pop().opts[0])
            text = super().get_help(ctx)
            rest = "\n\n" + fill(f"More options, which {_HELP_ALL} explains: {', '.join(named)}.", width=78)
        for parameter in known:
            parameter.hidden = False
        return text + rest

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """What is left of the arguments; an option that moved is refused with what takes its place."""
        if _HELP_ALL in args:
            typer.echo(super().get_help(ctx))
            ctx.exit()
        for argument in args:
            asked = f"{ctx.info_name} {argument.partition('=')[0]}"
            if asked in _ELSEWHERE:
                raise SeatrialError(f"{asked}: {_ELSEWHERE[asked]}")
        try:
            return super().parse_args(ctx, args)
        except Exception as error:
            if sentence := moved(str(self.name), getattr(error, "option_name", "")):
                vars(error).update(message=sentence, possibilities=None)
            raise

    def invoke(self, ctx: Any) -> Any:
        """Run it, unless a number is not finite."""
        parameters: list[Any] = self.params
        for parameter in parameters:
            given = ctx.params.get(parameter.name)
            for value in given if isinstance(given, list | tuple) else [given]:
                if isinstance(value, float) and not math.isfinite(value):
                    raise SeatrialError(f"{parameter.opts[0]}: expected a finite number, found {value}")
        return super().invoke(ctx)


app = typer.Typer(
    name="seatrial",
    cls=_Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # Rich's panels cut long words and defaults at 80 columns and take "[tuning]" for a style.
    rich_markup_mode=None,
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
    """From sea-trial logs to an identified model of an underwater vehicle and a verified autopilot."""


_VERBS: tuple[Callable[..., None], ...] = (
    demo.demo,
    new.new,
    new.import_,
    data.data,
    check.check,
    fly.simulate,
    identify.bench,
    plan.plan,
    identify.identify,
    score.score,
    tune.autopilot,
    fly.fly,
    fly.realtime,
    tune.tune,
    verify.verify,
    verify.verify_log,
    verify.rare,
    verify.falsify,
    verify.boundary,
    export.report,
    export.export,
    tune.ardusub,
    fly.sitl,
)

for _verb in _VERBS:
    # Said whole: the list of verbs would cut it after a few words.
    _first = inspect.cleandoc(_verb.__doc__ or "").partition("\n\n")[0]
    app.command(_verb.__name__.rstrip("_").replace("_", "-"), cls=_Verb, short_help=" ".join(_first.split()))(
        _verb
    )


def main(begins: Callable[[], None] | None = None) -> None:
    """Run the command line; `begins` is called when a verb does, after all that can be said without it."""
    console.ready()
    try:
        app(obj=begins)
    except OSError as error:  # from a message about the command line itself
        sys.exit(console.exit_code(error))
    finally:
        console.still()
